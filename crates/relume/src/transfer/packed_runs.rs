//! Small integers in few bits: runs of [`RUN`], each in as few bits as its largest needs.
//!
//! The parts of a low-rank block are quantised in equal steps, so that one more bit is spent where values are twice as large. Most values
//! are a few steps or none: runs take 0, 2, 4, 8 or 16 bits a value, which shifts and masks unpack in step with the sums.

use multiversion::multiversion;

use super::Buffer;

/// Values that share a width.
pub(super) const RUN: usize = 64;
/// Values that are unpacked side by side.
const LANES: usize = 16;

/// Runs of integers, one after the other.
#[derive(Clone, Debug, Default)]
pub struct PackedRuns {
    /// One a run: bits a value, 0, 2, 4, 8 or 16.
    pub widths: Buffer<u8>,
    /// `8 * width` bytes a run: two's complement, the values of lane `i` in the same byte (or 16-bit word), the first in the lowest bits.
    pub bytes: Buffer<u8>,
}

/// Some runs, borrowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs<'a> {
    pub(super) widths: &'a [u8],
    pub(super) bytes: &'a [u8],
}

/// Runs that are being written.
#[derive(Clone, Debug, Default)]
pub(super) struct RunWriter {
    pub(super) widths: Vec<u8>,
    pub(super) bytes: Vec<u8>,
}

/// How many runs so many values take.
pub(super) fn runs_of(values: usize) -> usize {
    values.div_ceil(RUN)
}

/// Bytes of a run of this width.
fn run_bytes(width: u8) -> usize {
    usize::from(width) * RUN / 8
}

fn width_of(run: &[i16]) -> u8 {
    let (low, high) = run.iter().fold((0, 0), |(low, high), &value| (value.min(low), value.max(high)));
    [0_u8, 2, 4, 8]
        .into_iter()
        .find(|&width| {
            let half = if width == 0 { 0 } else { 1_i16 << (width - 1) };
            low >= -half && high < half.max(1)
        })
        .unwrap_or(16)
}

impl RunWriter {
    /// Adds values, and zeros up to the end of the last run.
    pub(super) fn add(&mut self, values: &[i16]) {
        for part in values.chunks(RUN) {
            let mut run = [0; RUN];
            run[..part.len()].copy_from_slice(part);
            let width = width_of(&run);
            self.widths.push(width);
            match width {
                0 => {}
                16 => self.bytes.extend(run.iter().flat_map(|value| value.to_le_bytes())),
                8 => self.bytes.extend(run.iter().map(|&value| value as u8)),
                width => self.pack(&run, width),
            }
        }
    }

    /// Several values a byte.
    fn pack(&mut self, run: &[i16; RUN], width: u8) {
        let mask = (1_u8 << width) - 1;
        for block in run.chunks_exact(LANES * usize::from(8 / width)) {
            for lane in 0..LANES {
                let values = block.iter().skip(lane).step_by(LANES);
                let byte = values.enumerate().fold(0, |byte, (place, &value)| {
                    byte | (value as u8 & mask) << (place * usize::from(width))
                });
                self.bytes.push(byte);
            }
        }
    }
}

impl PackedRuns {
    /// Bytes of both arrays.
    pub fn bytes(&self) -> usize {
        self.widths.len() + self.bytes.len()
    }

    /// Whether all widths are known and the bytes are theirs.
    pub(super) fn is_sound(&self) -> bool {
        let known = self.widths.iter().all(|width| matches!(width, 0 | 2 | 4 | 8 | 16));
        known && self.widths.iter().map(|&width| run_bytes(width)).sum::<usize>() == self.bytes.len()
    }

    /// All of them.
    pub(super) fn runs(&self) -> Runs<'_> {
        Runs { widths: &self.widths, bytes: &self.bytes }
    }
}

impl<'a> Runs<'a> {
    /// Parts the first `count` runs off.
    pub(super) fn take(&mut self, count: usize) -> Self {
        let (widths, rest) = self.widths.split_at(count);
        self.widths = rest;
        let (bytes, rest) = self.bytes.split_at(widths.iter().map(|&width| run_bytes(width)).sum());
        self.bytes = rest;
        Self { widths, bytes }
    }

    /// `sum q x` for three vectors `x`, as long as the runs, over those runs that are `bright`.
    pub(super) fn dot(self, bright: &[bool], [red, green, blue]: [&[f32]; 3]) -> [f32; 3] {
        dot(self.widths, self.bytes, bright, red, green, blue)
    }

    /// `sum q q`.
    pub(super) fn square(self) -> f32 {
        let mut sum = 0.0;
        for_lanes(self.widths, self.bytes, |_| true, |_, q| sum += q.iter().map(|q| q * q).sum::<f32>());
        sum
    }

    /// Adds `q q scale` to a vector, as long as the runs.
    pub(super) fn add_squares(self, scale: f32, sums: &mut [f32]) {
        let add = |place: usize, q: [f32; LANES]| {
            sums[place..place + LANES].iter_mut().zip(q).for_each(|(sum, q)| *sum += scale * q * q);
        };
        for_lanes(self.widths, self.bytes, |_| true, add);
    }

    /// Adds `q y` to three vectors, as long as the runs.
    pub(super) fn add_weighted(self, y: [f32; 3], [red, green, blue]: [&mut [f32]; 3]) {
        add_weighted(self.widths, self.bytes, y, red, green, blue);
    }
}

/// Calls `each` with the place of the first and the values of every `LANES` values, but for runs of zeros and those that are not to be
/// `taken`.
#[inline(always)]
fn for_lanes(
    widths: &[u8],
    bytes: &[u8],
    taken: impl Fn(usize) -> bool,
    mut each: impl FnMut(usize, [f32; LANES]),
) {
    let mut rest = bytes;
    for (run, &width) in widths.iter().enumerate() {
        let (bytes, after) = rest.split_at(run_bytes(width));
        rest = after;
        if !taken(run) {
            continue;
        }
        let mut place = run * RUN;
        match width {
            2 => {
                for shift in [6, 4, 2, 0] {
                    each(place, std::array::from_fn(|lane| f32::from((bytes[lane] << shift) as i8 >> 6)));
                    place += LANES;
                }
            }
            4 => {
                for block in bytes.chunks_exact(LANES) {
                    for shift in [4, 0] {
                        each(place, std::array::from_fn(|lane| f32::from((block[lane] << shift) as i8 >> 4)));
                        place += LANES;
                    }
                }
            }
            8 => {
                for block in bytes.chunks_exact(LANES) {
                    each(place, std::array::from_fn(|lane| f32::from(block[lane] as i8)));
                    place += LANES;
                }
            }
            16 => {
                for block in bytes.chunks_exact(2 * LANES) {
                    let word = |lane: usize| i16::from_le_bytes([block[2 * lane], block[2 * lane + 1]]);
                    each(place, std::array::from_fn(|lane| f32::from(word(lane))));
                    place += LANES;
                }
            }
            _ => {}
        }
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn dot(widths: &[u8], bytes: &[u8], bright: &[bool], red: &[f32], green: &[f32], blue: &[f32]) -> [f32; 3] {
    let mut sums = [[0.0_f32; LANES]; 3];
    let taken = |run: usize| bright[run];
    for_lanes(widths, bytes, taken, |place, q| {
        let lanes = place..place + LANES;
        let (r, g, b) = (&red[lanes.clone()], &green[lanes.clone()], &blue[lanes]);
        for lane in 0..LANES {
            sums[0][lane] += q[lane] * r[lane];
            sums[1][lane] += q[lane] * g[lane];
            sums[2][lane] += q[lane] * b[lane];
        }
    });
    sums.map(|lanes| lanes.iter().sum())
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn add_weighted(
    widths: &[u8],
    bytes: &[u8],
    y: [f32; 3],
    red: &mut [f32],
    green: &mut [f32],
    blue: &mut [f32],
) {
    for_lanes(
        widths,
        bytes,
        |_| true,
        |place, q| {
            let lanes = place..place + LANES;
            let (r, g, b) = (&mut red[lanes.clone()], &mut green[lanes.clone()], &mut blue[lanes]);
            for lane in 0..LANES {
                r[lane] += q[lane] * y[0];
                g[lane] += q[lane] * y[1];
                b[lane] += q[lane] * y[2];
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    /// One value of a run.
    fn value(run: &[u8], width: u8, place: usize) -> i16 {
        match width {
            0 => 0,
            16 => i16::from_le_bytes([run[2 * place], run[2 * place + 1]]),
            8 => i16::from(run[place] as i8),
            width => {
                let a_byte = usize::from(8 / width);
                let (block, within) = (place / (LANES * a_byte), place % (LANES * a_byte));
                let byte = run[block * LANES + within % LANES];
                let up = 8 - width - (within / LANES) as u8 * width;
                i16::from((byte << up) as i8 >> (8 - width))
            }
        }
    }

    /// The plain twin of what the sums unpack.
    fn values(runs: Runs<'_>) -> Vec<i16> {
        let mut values = Vec::with_capacity(runs.widths.len() * RUN);
        let mut rest = runs.bytes;
        for &width in runs.widths {
            let (run, after) = rest.split_at(run_bytes(width));
            rest = after;
            values.extend((0..RUN).map(|place| value(run, width, place)));
        }
        values
    }

    /// Runs whose largest values are those of each width, and one of zeros.
    fn some() -> Vec<i16> {
        let largest: [i16; 8] = [1, 7, 127, 32_767, 0, 1, 100, 5];
        let random = |i: usize| unit(hash(i as u32, 3));
        let value = |i: usize| {
            let most = f32::from(largest[i / RUN % largest.len()]);
            ((2.0 * random(i) - 1.0) * (most + 0.5)).round().clamp(-most - 1.0, most) as i16
        };
        (0..largest.len() * RUN - 9).map(value).collect()
    }

    fn packed(values: &[i16]) -> PackedRuns {
        let mut writer = RunWriter::default();
        writer.add(values);
        PackedRuns { widths: writer.widths.into(), bytes: writer.bytes.into() }
    }

    #[test]
    fn what_is_packed_comes_back_in_no_more_bits_than_it_needs() {
        let all = some();
        let packed = packed(&all);
        assert_eq!(*packed.widths, [2, 4, 8, 16, 0, 2, 8, 4]);
        assert!(packed.is_sound());
        let back = values(packed.runs());
        assert_eq!(back[..all.len()], all);
        assert!(back[all.len()..].iter().all(|&value| value == 0));
    }

    #[test]
    fn sums_are_those_of_the_values_one_by_one() {
        let packed = packed(&some());
        let plain = values(packed.runs());
        let x: [Vec<f32>; 3] = std::array::from_fn(|c| {
            (0..plain.len()).map(|i| unit(hash(i as u32, 10 + c as u32)) - 0.5).collect()
        });
        let mut bright = vec![true; packed.widths.len()];
        bright[2] = false;
        let dots = packed.runs().dot(&bright, x.each_ref().map(|x| &x[..]));
        let mut sums = x.clone();
        let [red, green, blue] = &mut sums;
        packed.runs().add_weighted([1.0, -2.0, 0.5], [red, green, blue]);
        for c in 0..3 {
            let terms: Vec<f64> =
                plain.iter().zip(&x[c]).map(|(&q, &x)| f64::from(q) * f64::from(x)).collect();
            let terms = || terms.iter().enumerate().filter(|(i, _)| bright[i / RUN]).map(|(_, term)| term);
            let (expected, scale) = (terms().sum::<f64>(), terms().map(|term| term.abs()).sum::<f64>());
            assert!((f64::from(dots[c]) - expected).abs() < 1e-6 * scale, "{} {expected}", dots[c]);
            let squares: f32 = plain.iter().map(|&q| f32::from(q).powi(2)).sum();
            assert!((packed.runs().square() / squares - 1.0).abs() < 1e-5);
            for (i, &q) in plain.iter().enumerate() {
                let expected = x[c][i] + f32::from(q) * [1.0, -2.0, 0.5][c];
                assert!((sums[c][i] - expected).abs() <= 1e-6 * expected.abs(), "{} {expected}", sums[c][i]);
            }
        }
    }

    #[test]
    fn damaged_runs_are_found_out() {
        let whole = packed(&some());
        let widths = |widths: Vec<u8>| PackedRuns { widths: widths.into(), ..whole.clone() };
        let mut other = whole.widths.to_vec();
        other[0] = 3;
        assert!(!widths(other.clone()).is_sound());
        other[0] = 4;
        assert!(!widths(other).is_sound());
        let cut = whole.bytes[1..].to_vec();
        assert!(!PackedRuns { bytes: cut.into(), ..whole }.is_sound());
    }
}
