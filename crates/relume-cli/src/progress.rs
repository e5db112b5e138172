//! How far long work is: a bar with the time left on a terminal, a line now and then anywhere else.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relume::Progress;

use crate::console::to_stderr;
use crate::interrupt;
use crate::report::duration;

/// Shorter stages leave no line behind.
const WORTH_A_LINE: Duration = Duration::from_secs(1);
/// The time between two lines of one stage where there is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(5);
/// How often a bar is drawn.
const TICK: Duration = Duration::from_millis(200);

/// Shows the stages of long work on stderr, one after the other. The last one ends when this is dropped.
pub(crate) struct StageProgress {
    quiet: bool,
    terminal: bool,
    current: Mutex<Option<Stage>>,
}

struct Stage {
    name: String,
    steps: u64,
    done: u64,
    began: Instant,
    last_line: Instant,
    bar: Option<ProgressBar>,
}

impl StageProgress {
    pub(crate) fn new(quiet: bool, terminal: bool) -> Self {
        Self { quiet, terminal, current: Mutex::new(None) }
    }

    fn replace(&self, next: Option<Stage>) {
        let Ok(mut current) = self.current.lock() else { return };
        if let Some(stage) = current.take() {
            stage.end();
        }
        if let Some(stage) = &next
            && stage.bar.is_none()
        {
            to_stderr(&stage.name);
        }
        *current = next;
    }
}

impl Progress for StageProgress {
    fn stage(&self, name: &str, steps: u64) {
        if !self.quiet {
            self.replace(Some(Stage::new(name, steps, self.terminal)));
        }
    }

    fn advance(&self, steps: u64) {
        if self.quiet {
            return;
        }
        if let Ok(mut current) = self.current.lock()
            && let Some(stage) = current.as_mut()
        {
            stage.advance(steps);
        }
    }

    fn notice(&self, text: &str) {
        if self.quiet {
            return;
        }
        let bar = self.current.lock().ok().and_then(|current| current.as_ref()?.bar.clone());
        match bar {
            Some(bar) => bar.suspend(|| to_stderr(text)),
            None => to_stderr(text),
        }
    }

    fn cancelled(&self) -> bool {
        interrupt::requested()
    }
}

impl Drop for StageProgress {
    fn drop(&mut self) {
        self.replace(None);
    }
}

impl Stage {
    fn new(name: &str, steps: u64, terminal: bool) -> Self {
        let now = Instant::now();
        let bar = terminal.then(|| bar(name, steps));
        Self { name: name.to_owned(), steps, done: 0, began: now, last_line: now, bar }
    }

    fn advance(&mut self, steps: u64) {
        self.done += steps;
        if let Some(bar) = &self.bar {
            bar.inc(steps);
        } else if self.last_line.elapsed() >= BETWEEN_LINES {
            self.last_line = Instant::now();
            to_stderr(&self.line(self.began.elapsed()));
        }
    }

    /// How far it is after `elapsed`.
    fn line(&self, elapsed: Duration) -> String {
        let share = self.done as f64 / self.steps.max(1) as f64;
        if !(share > 0.0 && share <= 1.0) {
            return format!("{}: {} so far", self.name, duration(elapsed.as_secs_f64()));
        }
        let left = elapsed.as_secs_f64() * (1.0 - share) / share;
        format!("{}: {:.0}%, about {} left", self.name, share * 100.0, duration(left))
    }

    fn end(self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        let elapsed = self.began.elapsed();
        if elapsed >= WORTH_A_LINE {
            to_stderr(&format!("{}: done in {}", self.name, duration(elapsed.as_secs_f64())));
        }
    }
}

fn bar(name: &str, steps: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
    let template = if steps > 1 {
        "{msg:<24} {bar:30} {percent:>3}%  {elapsed} so far, {eta} left"
    } else {
        "{msg:<24} {spinner} {elapsed} so far"
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(name.to_owned());
    bar.enable_steady_tick(TICK);
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_tell_share_and_time_left() {
        let mut stage = Stage::new("final gather", 200, false);
        assert_eq!(stage.line(Duration::from_secs(7)), "final gather: 7.0 s so far");
        stage.advance(50);
        assert_eq!(stage.line(Duration::from_secs(10)), "final gather: 25%, about 30.0 s left");
        stage.advance(150);
        assert_eq!(stage.line(Duration::from_secs(10)), "final gather: 100%, about 0.0 s left");
    }
}
