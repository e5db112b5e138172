//! How far long work is: a bar with the time left on a terminal, a line now and then anywhere else.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relume::Progress;

/// The time between two lines of one job where there is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(10);
/// Steps of a part on the bar, however many it reports itself.
const PART: f64 = 1000.0;

/// One job of some parts of like length, each of which is a stage of the library's. Ends when dropped.
pub struct Job {
    state: Mutex<State>,
}

struct State {
    name: String,
    parts: u64,
    /// Parts that have begun.
    begun: u64,
    /// Steps of the current part, and those done.
    steps: (u64, u64),
    /// Whether every stage is a job of its own.
    by_stage: bool,
    began: Instant,
    last_line: Instant,
    bar: Option<ProgressBar>,
}

impl Job {
    /// A job of `parts` stages.
    pub fn new(name: impl Into<String>, parts: u64) -> Self {
        Self { state: Mutex::new(State::new(name.into(), parts, false)) }
    }

    /// A job whose stages differ: each has a time left of its own.
    pub fn by_stage(name: impl Into<String>) -> Self {
        Self { state: Mutex::new(State::new(name.into(), 1, true)) }
    }
}

impl Progress for Job {
    fn stage(&self, name: &str, steps: u64) {
        if let Ok(mut state) = self.state.lock() {
            if state.by_stage {
                let job = state.name.split(": ").next().unwrap_or_default().to_owned();
                state.end();
                *state = State::new(format!("{job}: {name}"), 1, true);
            }
            state.begun += 1;
            state.steps = (steps.max(1), 0);
        }
    }

    fn advance(&self, steps: u64) {
        if let Ok(mut state) = self.state.lock() {
            state.steps.1 += steps;
            state.show();
        }
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        if let Ok(state) = self.state.lock() {
            state.end();
        }
    }
}

impl State {
    fn new(name: String, parts: u64, by_stage: bool) -> Self {
        let now = Instant::now();
        let bar = std::io::stderr().is_terminal().then(|| bar(&name, parts));
        Self { name, parts, begun: 0, steps: (1, 0), by_stage, began: now, last_line: now, bar }
    }

    /// `0..=1`.
    fn share(&self) -> f64 {
        let part = self.steps.1 as f64 / self.steps.0 as f64;
        ((self.begun.saturating_sub(1) as f64 + part.min(1.0)) / self.parts.max(1) as f64).min(1.0)
    }

    fn show(&mut self) {
        if let Some(bar) = &self.bar {
            bar.set_position((self.share() * self.parts as f64 * PART) as u64);
        } else if self.last_line.elapsed() >= BETWEEN_LINES {
            self.last_line = Instant::now();
            say(&line(&self.name, self.share(), self.began.elapsed()));
        }
    }

    fn end(&self) {
        match &self.bar {
            Some(bar) => bar.finish_and_clear(),
            None if self.begun > 0 && self.began.elapsed() >= Duration::from_secs(1) => {
                say(&format!("{}: done in {}", self.name, duration(self.began.elapsed().as_secs_f64())));
            }
            None => {}
        }
    }
}

/// How far a job is after `elapsed`.
fn line(name: &str, share: f64, elapsed: Duration) -> String {
    if share <= 0.0 {
        return format!("{name}: {} so far", duration(elapsed.as_secs_f64()));
    }
    let left = elapsed.as_secs_f64() * (1.0 - share) / share;
    format!("{name}: {:.0}%, about {} left", share * 100.0, duration(left))
}

fn bar(name: &str, parts: u64) -> ProgressBar {
    let steps = (parts as f64 * PART) as u64;
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
    let template = "{msg:<40} {bar:30} {percent:>3}%  {elapsed} so far, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(name.to_owned());
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Seconds as people say them.
pub fn duration(seconds: f64) -> String {
    if seconds < 100.0 {
        format!("{seconds:.1} s")
    } else if seconds < 5400.0 {
        format!("{:.0} min {:02.0} s", (seconds / 60.0).floor(), (seconds % 60.0).floor())
    } else {
        format!("{:.1} h", seconds / 3600.0)
    }
}

/// A line on stderr; when nobody listens there, there is nobody to tell.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_and_tell_the_time_left() {
        let job = Job::new("references", 4);
        job.stage("path tracing", 10);
        job.advance(10);
        job.stage("path tracing", 20);
        job.advance(10);
        let share = job.state.lock().unwrap().share();
        assert!((share - 0.375).abs() < 1e-12, "{share}");
        assert_eq!(line("references", 0.25, Duration::from_secs(30)), "references: 25%, about 90.0 s left");
        assert_eq!(line("references", 0.0, Duration::from_secs(3)), "references: 3.0 s so far");
        assert_eq!(duration(125.0), "2 min 05 s");
    }
}
