//! Two sides trace the same rays by turns.

use std::time::Instant;

use rayon::ThreadPool;
use rayon::prelude::*;

/// Turns of each side.
const TURNS: usize = 30;
/// So many rays in a thousand may be answered otherwise: those along edges.
const MAY_DIFFER: usize = 5;

/// Columns of [`Contest::run`]'s line.
pub(crate) const HEADER: &str = "\
| rays | threads | ours, M/s | Embree, M/s | by | ours / Embree | aim | robust, M/s | ours / robust | 2 threads / 1: ours | Embree |
|---|---|---|---|---|---|---|---|---|---|---|";

/// Rays in one side's layout.
pub(crate) trait Traced {
    fn name(&self) -> &'static str;
    /// As if they had not been traced.
    fn reset(&mut self);
    fn trace(&mut self, pool: &ThreadPool);
    /// What was found of each ray: see [`closest_answer`], or 1 where something lies on it.
    fn answers(&self) -> Vec<f32>;
}

/// Chunks of rays, and what is to be done to each.
pub(crate) struct Batch<C, Trace, Answers> {
    name: &'static str,
    fresh: Vec<C>,
    chunks: Vec<C>,
    trace: Trace,
    answers: Answers,
}

impl<C: Clone, Trace, Answers> Batch<C, Trace, Answers>
where
    Trace: Fn(&mut C) + Sync,
    Answers: Fn(&C) -> Vec<f32>,
{
    pub(crate) fn new(name: &'static str, chunks: Vec<C>, trace: Trace, answers: Answers) -> Self {
        Self { name, fresh: chunks.clone(), chunks, trace, answers }
    }
}

impl<C: Clone + Send, Trace, Answers> Traced for Batch<C, Trace, Answers>
where
    Trace: Fn(&mut C) + Sync,
    Answers: Fn(&C) -> Vec<f32>,
{
    fn name(&self) -> &'static str {
        self.name
    }

    fn reset(&mut self) {
        self.chunks.clone_from(&self.fresh);
    }

    fn trace(&mut self, pool: &ThreadPool) {
        let (chunks, trace) = (&mut self.chunks, &self.trace);
        pool.install(|| chunks.par_iter_mut().for_each(trace));
    }

    fn answers(&self) -> Vec<f32> {
        self.chunks.iter().flat_map(&self.answers).collect()
    }
}

/// What a first hit at a distance is compared by: misses are far away, but not infinitely.
pub(crate) fn closest_answer(distance: f32) -> f32 {
    distance.min(1e30)
}

/// One kind of rays.
pub(crate) struct Contest<'a> {
    pub(crate) name: &'static str,
    pub(crate) rays: usize,
    /// Of ours over Embree's.
    pub(crate) aim: Option<f64>,
    pub(crate) ours: Box<dyn Traced + 'a>,
    /// Ways of Embree's: at its fastest, and robust.
    pub(crate) embree: [Vec<Box<dyn Traced + 'a>>; 2],
}

/// Millions of rays a second at each turn, on one thread and on two.
type Rates = [Vec<f64>; 2];

impl Contest<'_> {
    /// Lets both sides trace by turns on each pool; a line of the table for each.
    ///
    /// # Errors
    /// Where they do not see the same.
    pub(crate) fn run(&mut self, pools: &[ThreadPool; 2]) -> Result<String, String> {
        let millions = self.rays as f64 * 1e-6;
        let count = 1 + self.embree.iter().map(Vec::len).sum::<usize>();
        let mut rates: Vec<Rates> = vec![Rates::default(); count];
        for _ in 0..TURNS {
            for (threads, pool) in pools.iter().enumerate() {
                let sides = std::iter::once(&mut self.ours).chain(self.embree.iter_mut().flatten());
                for (side, rates) in sides.zip(&mut rates) {
                    side.reset();
                    let began = Instant::now();
                    side.trace(pool);
                    rates[threads].push(millions / began.elapsed().as_secs_f64().max(1e-9));
                }
            }
        }
        self.agree()?;
        let (ours, embree) = rates.split_at(1);
        let (fast, robust) = embree.split_at(self.embree[0].len());
        let lines = [0, 1].map(|threads| self.line(threads, &ours[0], fast, robust));
        Ok(lines.join("\n"))
    }

    fn agree(&self) -> Result<(), String> {
        let ours = self.ours.answers();
        for side in self.embree.iter().flatten() {
            let theirs = side.answers();
            let differ = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-3 * a.abs().max(b.abs());
            let differing = ours.iter().zip(&theirs).filter(|&pair| differ(pair)).count();
            if theirs.len() != ours.len() || 1000 * differing > MAY_DIFFER * ours.len() {
                let name = side.name();
                return Err(format!(
                    "{}: {name} answers {differing} of {} rays otherwise",
                    self.name,
                    ours.len()
                ));
            }
        }
        Ok(())
    }

    fn line(&self, threads: usize, ours: &Rates, fast: &[Rates], robust: &[Rates]) -> String {
        let best = |ways: &[Rates]| {
            let rate = |way: &usize| median(&ways[*way][threads]);
            (0..ways.len()).max_by(|a, b| rate(a).total_cmp(&rate(b))).unwrap_or_default()
        };
        let (best_fast, best_robust) = (best(fast), best(robust));
        let (fast, robust) = (&fast[best_fast], &robust[best_robust]);
        let scaling = |rates: &Rates| match threads {
            0 => String::new(),
            _ => format!("{:.2}", median_ratio(&rates[1], &rates[0])),
        };
        format!(
            "| {} | {} | {:.2} | {:.2} | {} | {:.2} | {} | {:.2} | {:.2} | {} | {} |",
            self.name,
            threads + 1,
            median(&ours[threads]),
            median(&fast[threads]),
            self.embree[0][best_fast].name(),
            median_ratio(&ours[threads], &fast[threads]),
            self.aim.map_or_else(String::new, |aim| aim.to_string()),
            median(&robust[threads]),
            median_ratio(&ours[threads], &robust[threads]),
            scaling(ours),
            scaling(fast),
        )
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or_default()
}

/// The median over turns of the ratio within a turn.
fn median_ratio(over: &[f64], under: &[f64]) -> f64 {
    let ratios: Vec<f64> = over.iter().zip(under).map(|(over, under)| over / under).collect();
    median(&ratios)
}
