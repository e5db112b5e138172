//! From the rows of the final gather, which are those of records, to the receivers: a few weights for each.
//!
//! Receivers are numbered so that those which follow each other lie together. A run of them takes its light from few records, which a table names;
//! a weight with its record is then two bytes.

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::Buffer;
use crate::sample::{MOST_SHARES, Records};

/// Receivers of a run. With as many records each as there may be, the run's table has 256.
const RUN: usize = 256 / MOST_SHARES;
/// A weight of one.
const WHOLE: f32 = 255.0;
/// Runs that a task takes.
const TASK: usize = 128;

/// Where the parts of a run of receivers end.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct RunEnds {
    /// In [`Interpolation::table`].
    pub table: u32,
    /// In [`Interpolation::shares`].
    pub shares: u32,
}

/// What a receiver takes of one record.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct RecordShare {
    /// Its place in the run's part of the table.
    pub place: u8,
    /// 255 is all; a receiver's add up to that.
    pub weight: u8,
}

/// What each receiver takes of the rows.
#[derive(Clone, Debug, Default)]
pub struct Interpolation {
    /// Rows that there are.
    pub records: usize,
    /// One a run of 32 receivers; the last may be shorter.
    pub runs: Buffer<RunEnds>,
    /// Rows that the receivers of each run take light from, run after run.
    pub table: Buffer<u32>,
    /// Shares of each receiver: 1 to 8.
    pub counts: Buffer<u8>,
    /// Those of all receivers, one after the other.
    pub shares: Buffer<RecordShare>,
}

/// Weights that add up to one in 255ths that add up to 255: rounded down, and what is left over given to those that lost most.
fn quantised(shares: &[(u32, f32)]) -> impl Iterator<Item = (u32, u8)> + use<> {
    let mut parts: Vec<(u32, u8, f32)> = shares
        .iter()
        .map(|&(record, weight)| {
            let exact = weight.clamp(0.0, 1.0) * WHOLE;
            (record, exact as u8, exact.fract())
        })
        .collect();
    let given: usize = parts.iter().map(|&(_, weight, _)| usize::from(weight)).sum();
    parts.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
    let count = parts.len().max(1);
    for part in 0..(WHOLE as usize).saturating_sub(given) {
        parts[part % count].1 += 1;
    }
    parts.into_iter().filter(|&(_, weight, _)| weight > 0).map(|(record, weight, _)| (record, weight))
}

impl Interpolation {
    /// `rows` are those of the records, in their order.
    pub(super) fn new(records: &Records, rows: &[u32]) -> Self {
        let (mut runs, mut table) = (Vec::new(), Vec::new());
        let (mut counts, mut all_shares) = (Vec::with_capacity(records.ends.len()), Vec::new());
        let mut first = 0;
        for ends in records.ends.chunks(RUN) {
            let start = table.len();
            let mut named: Vec<u32> = Vec::new();
            for &end in ends {
                let shares = quantised(&records.shares[first as usize..end as usize]);
                let before = all_shares.len();
                for (record, weight) in shares {
                    let place = named.iter().position(|&other| other == record).unwrap_or_else(|| {
                        named.push(record);
                        named.len() - 1
                    });
                    all_shares.push(RecordShare { place: place as u8, weight });
                }
                counts.push((all_shares.len() - before) as u8);
                first = end;
            }
            table.extend(named.iter().map(|&record| rows[record as usize]));
            debug_assert!(table.len() - start <= 256);
            runs.push(RunEnds { table: table.len() as u32, shares: all_shares.len() as u32 });
        }
        let records = records.receivers.len();
        Self {
            records,
            runs: runs.into(),
            table: table.into(),
            counts: counts.into(),
            shares: all_shares.into(),
        }
    }

    /// How many receivers there are.
    pub fn receivers(&self) -> usize {
        self.counts.len()
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.runs)
            + size_of_val(&*self.table)
            + size_of_val(&*self.counts)
            + size_of_val(&*self.shares)
    }

    /// Whether its parts fit each other.
    pub(super) fn is_sound(&self) -> bool {
        let (mut table, mut shares) = (0_u32, 0_u32);
        let whole = |shares: &[RecordShare]| {
            (1..=MOST_SHARES).contains(&shares.len())
                && shares.iter().map(|share| f32::from(share.weight)).sum::<f32>() == WHOLE
        };
        let run = |(ends, counts): (&RunEnds, &[u8])| {
            let of_run: u32 = counts.iter().map(|&count| u32::from(count)).sum();
            let (first_name, first_share) = (table, shares);
            (table, shares) = (ends.table, ends.shares);
            if table < first_name || table as usize > self.table.len() || shares as usize > self.shares.len()
            {
                return false;
            }
            let names = table - first_name;
            if first_share.checked_add(of_run) != Some(shares) {
                return false;
            }
            let shares = &self.shares[first_share as usize..shares as usize];
            let mut left = shares;
            let of_point = |&count: &u8| {
                let (own, rest) = left.split_at(usize::from(count));
                left = rest;
                whole(own)
            };
            shares.iter().all(|share| u32::from(share.place) < names) && counts.iter().all(of_point)
        };
        self.runs.len() == self.counts.len().div_ceil(RUN)
            && self.runs.iter().zip(self.counts.chunks(RUN)).all(run)
            && table as usize == self.table.len()
            && shares as usize == self.shares.len()
            && self.table.iter().all(|&row| (row as usize) < self.records)
    }

    /// One value a receiver of one a row.
    ///
    /// # Panics
    /// If `rows` or `out` has not one value for each.
    pub fn apply(&self, rows: &[Vec3], out: &mut [Vec3]) {
        assert!(rows.len() == self.records && out.len() == self.receivers());
        let task = |(task, out): (usize, &mut [Vec3])| {
            let runs = &self.runs[task * TASK..self.runs.len().min((task + 1) * TASK)];
            let before = (task * TASK).checked_sub(1).map(|run| self.runs[run]);
            let mut start = before.unwrap_or(RunEnds { table: 0, shares: 0 });
            let counts = &self.counts[task * TASK * RUN..];
            let mut named = [Vec3A::ZERO; 256];
            for ((end, out), counts) in runs.iter().zip(out.chunks_mut(RUN)).zip(counts.chunks(RUN)) {
                let names = &self.table[start.table as usize..end.table as usize];
                for (value, &row) in named.iter_mut().zip(names) {
                    *value = Vec3A::from(rows[row as usize]) * (1.0 / WHOLE);
                }
                let mut shares = &self.shares[start.shares as usize..end.shares as usize];
                for (out, &count) in out.iter_mut().zip(counts) {
                    let (own, rest) = shares.split_at(usize::from(count));
                    let part =
                        |share: &RecordShare| named[usize::from(share.place)] * f32::from(share.weight);
                    *out = own.iter().map(part).sum::<Vec3A>().into();
                    shares = rest;
                }
                start = *end;
            }
        };
        out.par_chunks_mut(TASK * RUN).enumerate().for_each(task);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 70 receivers over 40 records; the receivers' shares are uneven.
    fn records() -> Records {
        let (mut shares, mut ends) = (Vec::new(), Vec::new());
        for receiver in 0..70_u32 {
            let count = 1 + receiver % MOST_SHARES as u32;
            let total = (count * (count + 1) / 2) as f32;
            shares.extend((0..count).map(|k| ((receiver / 2 + 3 * k) % 40, (k + 1) as f32 / total)));
            ends.push(shares.len() as u32);
        }
        Records { receivers: (0..40).collect(), shares, ends }
    }

    #[test]
    fn receivers_get_the_weighted_mean_of_their_records() {
        let records = records();
        let rows: Vec<u32> = (0..40).map(|record| (record * 7) % 40).collect();
        let interpolation = Interpolation::new(&records, &rows);
        assert!(interpolation.is_sound() && interpolation.receivers() == 70);
        let light = |row: u32| Vec3::new(row as f32, 1.0, (row * row) as f32);
        let mut found = vec![Vec3::ZERO; 70];
        interpolation.apply(&(0..40).map(light).collect::<Vec<_>>(), &mut found);
        let mut first = 0;
        for (found, &end) in found.iter().zip(&records.ends) {
            let shares = &records.shares[first..end as usize];
            let expected: Vec3 =
                shares.iter().map(|&(record, weight)| weight * light(rows[record as usize])).sum();
            assert!((found.y - 1.0).abs() < 1e-5, "weights add up to {}", found.y);
            // half a 255th of each of eight rows of up to 39
            assert!((found.x - expected.x).abs() < 0.5, "{found} instead of {expected}");
            first = end as usize;
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let sound = Interpolation::new(&records(), &(0..40).collect::<Vec<_>>());
        assert!(sound.is_sound());
        let refuse = |break_it: &dyn Fn(&mut Interpolation)| {
            let mut broken = sound.clone();
            break_it(&mut broken);
            assert!(!broken.is_sound());
        };
        refuse(&|broken| broken.records = 39);
        refuse(&|broken| broken.counts = broken.counts[1..].to_vec().into());
        refuse(&|broken| broken.shares = broken.shares[1..].to_vec().into());
        refuse(&|broken| broken.runs = broken.runs[1..].to_vec().into());
        refuse(&|broken| broken.table = broken.table[1..].to_vec().into());
        refuse(&|broken| {
            let mut shares = broken.shares.to_vec();
            shares[3].place = 255;
            broken.shares = shares.into();
        });
        refuse(&|broken| {
            let mut shares = broken.shares.to_vec();
            shares[3].weight ^= 1;
            broken.shares = shares.into();
        });
    }
}
