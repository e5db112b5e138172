//! Small integers in few bits: runs of [`RUN`], each in as few bits as its largest needs.
//!
//! The parts of a low-rank block are quantised in equal steps, so that one more bit is spent where values are twice as large. Most values
//! are a few steps or none: runs take from 0 to 8 bits a value, or 16, which shifts unpack in step with the sums.
//!
//! The sums are most of what a frame does. `scalar.rs` has them for every processor, `x86.rs` for those with AVX2 and FMA:
//! their last bits differ, since FMA rounds once where others round twice.

mod scalar;
#[cfg(target_arch = "x86_64")]
mod x86;

use super::Buffer;

/// Values that share a width.
pub(super) const RUN: usize = 64;
/// Values that are unpacked side by side.
const LANES: usize = 16;

/// Runs of integers, one after the other.
#[derive(Clone, Debug, Default)]
pub struct PackedRuns {
    /// One a run: bits a value, 0 to 8, or 16.
    pub widths: Buffer<u8>,
    /// `8 * width` bytes a run, two's complement. Of 16 bits: value after value, the low byte first. Of fewer: value `i` belongs to lane
    /// `i % 16`, whose four values stand one above the other in a word of `4 * width` bits, the first in the lowest. The lowest bytes of all lanes
    /// come first, then the next ones; for odd widths the highest four bits last: those of lane `i` below those of lane `i + 8` in one byte.
    pub bytes: Buffer<u8>,
}

/// Some runs, borrowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs<'a> {
    pub(super) widths: &'a [u8],
    pub(super) bytes: &'a [u8],
}

/// Runs that are being written.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
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
    // the bits of a number, or of the complement of a negative one, and its sign
    let bits = run.iter().fold(0, |bits, &value| bits | if value < 0 { !value } else { value } as u16);
    let negative = run.iter().any(|&value| value < 0);
    match (16 - bits.leading_zeros() as u8, negative) {
        (0, false) => 0,
        (bits @ 0..=7, _) => bits + 1,
        _ => 16,
    }
}

/// Whether all widths are known and so many bytes are theirs.
fn are_sound(widths: &[u8], bytes: &[u8]) -> bool {
    let known = widths.iter().all(|width| matches!(width, 0..=8 | 16));
    known && widths.iter().map(|&width| run_bytes(width)).sum::<usize>() == bytes.len()
}

impl RunWriter {
    /// Whether all widths are known and the bytes are theirs.
    pub(super) fn is_sound(&self) -> bool {
        are_sound(&self.widths, &self.bytes)
    }

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
                width => self.pack(&run, width),
            }
        }
    }

    /// The values of a lane in one word.
    fn pack(&mut self, run: &[i16; RUN], width: u8) {
        let mask = (1_u32 << width) - 1;
        let words: [u32; LANES] = std::array::from_fn(|lane| {
            let values = run.iter().skip(lane).step_by(LANES).zip(0..);
            values.fold(0, |word, (&value, place)| word | (value as u32 & mask) << (place * u32::from(width)))
        });
        for byte in 0..width / 2 {
            self.bytes.extend(words.map(|word| (word >> (8 * byte)) as u8));
        }
        if width % 2 == 1 {
            let high = words.map(|word| (word >> (4 * (width - 1))) as u8);
            self.bytes.extend((0..LANES / 2).map(|lane| high[lane] | high[lane + LANES / 2] << 4));
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
        are_sound(&self.widths, &self.bytes)
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
        let bits: u32 = widths.iter().map(|&width| u32::from(width)).sum();
        let (bytes, rest) = self.bytes.split_at(bits as usize * RUN / 8);
        self.bytes = rest;
        Self { widths, bytes }
    }

    /// `sum q q`.
    pub(super) fn square(self) -> f32 {
        let mut sum = 0.0;
        scalar::for_runs(self, |_, q| sum += q.iter().map(|q| q * q).sum::<f32>());
        sum
    }

    /// Adds `q q scale` to a vector, as long as the runs.
    pub(super) fn add_squares(self, scale: f32, sums: &mut [f32]) {
        scalar::for_runs(self, |run, q| {
            sums[run * RUN..][..RUN].iter_mut().zip(q).for_each(|(sum, q)| *sum += scale * q * q);
        });
    }
}

/// A matrix of low rank, `U V`: a sum of outer products.
#[derive(Clone, Copy, Debug)]
pub(super) struct Product<'a> {
    /// The rows of `V`, one after the other, each as long as the light.
    pub(super) v: Runs<'a>,
    /// One a row.
    pub(super) v_scales: &'a [f32],
    /// The columns of `U`, one after the other, each as long as the sums.
    pub(super) u: Runs<'a>,
    /// One a column.
    pub(super) u_scales: &'a [f32],
}

impl Product<'_> {
    /// Adds `U V light` to `sums`, for three colours, all whole runs long, but for those runs of the light that are not `bright`.
    pub(super) fn add(self, light: [&[f32]; 3], bright: &[bool], mut sums: [&mut [f32]; 3]) {
        #[cfg(target_arch = "x86_64")]
        if x86::add(self, light, bright, sums.each_mut().map(|sums| &mut **sums)) {
            return;
        }
        scalar::add(self, light, bright, sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    const WIDTHS: [u8; 12] = [2, 4, 8, 16, 0, 1, 3, 5, 7, 6, 2, 4];

    /// One value of a run.
    fn value(run: &[u8], width: u8, place: usize) -> i16 {
        if width == 16 {
            return i16::from_le_bytes([run[2 * place], run[2 * place + 1]]);
        }
        let (width, lane) = (usize::from(width), place % LANES);
        let bit = |bit: usize| {
            let half = bit / 8 == width / 2;
            let (byte, up) = if half { (lane % 8, bit % 8 + 4 * (lane / 8)) } else { (lane, bit % 8) };
            i32::from(run[bit / 8 * LANES + byte] >> up & 1)
        };
        let first = place / LANES * width;
        let value: i32 = (0..width).map(|place| bit(first + place) << place).sum();
        (if width > 0 && bit(first + width - 1) == 1 { value - (1 << width) } else { value }) as i16
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

    /// Runs of each width.
    fn some() -> Vec<i16> {
        let random = |i: usize| unit(hash(i as u32, 3));
        let value = |i: usize| {
            let half = (f32::from(WIDTHS[i / RUN]) - 1.0).exp2();
            if half < 1.0 { 0 } else { ((2.0 * random(i) - 1.0) * half).floor() as i16 }
        };
        (0..WIDTHS.len() * RUN - 9).map(value).collect()
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
        assert_eq!(*packed.widths, WIDTHS);
        assert!(packed.is_sound());
        let back = values(packed.runs());
        assert_eq!(back[..all.len()], all);
        assert!(back[all.len()..].iter().all(|&value| value == 0));
    }

    type Add = fn(Product<'_>, [&[f32]; 3], &[bool], [&mut [f32]; 3]);

    /// The twin, and what this processor is given where it has something of its own.
    fn forms() -> Vec<Add> {
        #[cfg(target_arch = "x86_64")]
        {
            let nothing = Runs { widths: &[], bytes: &[] };
            let product = Product { v: nothing, v_scales: &[], u: nothing, u_scales: &[] };
            if x86::add(product, [&[]; 3], &[], [&mut [], &mut [], &mut []]) {
                return vec![scalar::add, |product, light, bright, sums| {
                    assert!(x86::add(product, light, bright, sums));
                }];
            }
        }
        println!("skipped: no AVX2 and FMA here, only the scalar form is tested");
        vec![scalar::add]
    }

    /// A run of this width: the ends of its range, then what is random.
    fn run_of(width: u8, seed: u32) -> Vec<i16> {
        let half = (f32::from(width) - 1.0).exp2();
        let random = |i: usize| ((2.0 * unit(hash(i as u32, seed)) - 1.0) * half).floor();
        let value = |i: usize| match i {
            _ if width == 0 => 0.0,
            _ if i % 17 == 3 => -half,
            _ if i % 17 == 11 => half - 1.0,
            _ => random(i),
        };
        (0..RUN).map(|i| value(i) as i16).collect()
    }

    /// Light on one coefficient brings one product of whole numbers to each row: nothing is rounded away, whatever the form.
    #[test]
    fn every_value_of_every_width_is_multiplied() {
        let widths = [0, 1, 2, 3, 4, 5, 6, 7, 8, 16];
        for form in forms() {
            for (number, &of_v) in (0..).zip(&widths) {
                for &of_u in &widths {
                    // in the middle of the bytes, and at their end
                    let v: Vec<i16> =
                        [of_v, 5, of_v].iter().zip(0..).flat_map(|(&w, i)| run_of(w, number + i)).collect();
                    let u: Vec<i16> =
                        [of_u, 3, of_u].iter().zip(7..).flat_map(|(&w, i)| run_of(w, number + i)).collect();
                    let (packed_v, packed_u) = (packed(&v), packed(&u));
                    let product = Product {
                        v: packed_v.runs(),
                        v_scales: &[1.0],
                        u: packed_u.runs(),
                        u_scales: &[1.0],
                    };
                    for lit in (0..v.len()).step_by(5) {
                        let mut light = [vec![0.0; v.len()], vec![0.0; v.len()], vec![0.0; v.len()]];
                        [light[0][lit], light[1][lit], light[2][lit]] = [1.0, -1.0, 2.0];
                        let mut sums = [vec![0.0; u.len()], vec![0.0; u.len()], vec![0.0; u.len()]];
                        let lanes = sums.each_mut().map(|sums| &mut sums[..]);
                        form(product, light.each_ref().map(|light| &light[..]), &[true; 3], lanes);
                        for (row, &weight) in u.iter().enumerate() {
                            let expected = f64::from(weight) * f64::from(v[lit]);
                            let found = sums.each_ref().map(|sums| sums[row]);
                            let factors = [1.0, -1.0, 2.0].map(|factor| (factor * expected) as f32);
                            assert_eq!(found, factors, "widths {of_v} and {of_u}, value {lit}, row {row}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn products_are_those_of_the_values_one_by_one() {
        let packed = packed(&some());
        let plain = values(packed.runs());
        // rows and columns of four and two runs: three directions of each kind of run
        let (v, u) = (packed.runs(), packed.runs().take(6));
        let (kept, rows) = (4 * RUN, 2 * RUN);
        let random = |i: usize, seed: u32| unit(hash(i as u32, seed)) - 0.5;
        let light: [Vec<f32>; 3] =
            std::array::from_fn(|c| (0..kept).map(|i| random(i, 10 + c as u32)).collect());
        let start: [Vec<f32>; 3] =
            std::array::from_fn(|c| (0..rows).map(|i| random(i, 20 + c as u32)).collect());
        let (v_scales, u_scales, bright) = ([1.0, -0.5, 2.0], [0.25, 1.5, -1.0], [true, true, false, true]);
        let product = Product { v, v_scales: &v_scales, u, u_scales: &u_scales };
        let form = |add: Add| {
            let mut sums = start.clone();
            add(
                product,
                light.each_ref().map(|x| &x[..]),
                &bright,
                sums.each_mut().map(|sums| &mut sums[..]),
            );
            sums
        };
        for sums in [form(scalar::add), form(|product, light, bright, sums| product.add(light, bright, sums))]
        {
            for c in 0..3 {
                for row in 0..rows {
                    let (mut expected, mut scale) = (f64::from(start[c][row]), 0.0);
                    for direction in 0..3 {
                        for at in (0..kept).filter(|at| bright[at / RUN]) {
                            let of_v =
                                f64::from(plain[direction * kept + at]) * f64::from(v_scales[direction]);
                            let of_u =
                                f64::from(plain[direction * rows + row]) * f64::from(u_scales[direction]);
                            let term = of_u * of_v * f64::from(light[c][at]);
                            expected += term;
                            scale += term.abs();
                        }
                    }
                    let off = (f64::from(sums[c][row]) - expected).abs();
                    assert!(off <= 1e-6 * (scale + 1.0), "{} {expected}", sums[c][row]);
                }
            }
        }
    }

    #[test]
    fn squares_are_those_of_the_values_one_by_one() {
        let packed = packed(&some());
        let plain = values(packed.runs());
        let squares: f32 = plain.iter().map(|&q| f32::from(q).powi(2)).sum();
        assert!((packed.runs().square() / squares - 1.0).abs() < 1e-5);
        let mut sums = vec![1.0; plain.len()];
        packed.runs().add_squares(0.5, &mut sums);
        for (sum, q) in sums.iter().zip(plain) {
            let expected = 1.0 + 0.5 * f32::from(q).powi(2);
            assert!((sum - expected).abs() <= 1e-6 * expected, "{sum} {expected}");
        }
    }

    #[test]
    fn damaged_runs_are_found_out() {
        let whole = packed(&some());
        let widths = |widths: Vec<u8>| PackedRuns { widths: widths.into(), ..whole.clone() };
        let mut other = whole.widths.to_vec();
        other[0] = 9;
        assert!(!widths(other.clone()).is_sound());
        other[0] = 4;
        assert!(!widths(other).is_sound());
        let cut = whole.bytes[1..].to_vec();
        assert!(!PackedRuns { bytes: cut.into(), ..whole }.is_sound());
    }
}
