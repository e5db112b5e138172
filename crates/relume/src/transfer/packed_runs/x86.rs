//! The sums for processors with AVX2 and FMA.
//!
//! How wide a run is changes from one to the next, and nothing foretells it: a branch on it is mostly lost. So all widths of at most 8 bits are unpacked in
//! the same steps, with what differs in a table: bytes of a lane are brought together by shuffles, and shifts by a number of bits cut the values out.
//! (AVX-512 does the same in half the steps, and gained nothing on a processor that has it, an AMD EPYC that takes two for each.)

#[allow(clippy::wildcard_imports, reason = "intrinsics are known by their names")]
use std::arch::x86_64::*;

use super::{LANES, Product, RUN, Runs, run_bytes};

/// Bytes that a run is unpacked from: those of the widest by the table.
const MOST: usize = 64;

/// Sixteen lanes.
type Floats = [__m256; PARTS];
/// Vectors to them.
const PARTS: usize = 2;

/// How runs of a width are unpacked.
#[derive(Clone, Copy)]
struct Unpacking {
    /// For each byte of the lanes' words, the lowest first, and each lane: its place among 16 bytes of the run, which begin at 16 times that byte's number.
    /// Where there is none, none that [`_mm_shuffle_epi8`] takes.
    planes: [[u8; LANES]; 4],
    /// Bits of the last eight lanes' words that are in their place. Those above are four too high: a byte has the highest four bits of two lanes.
    in_place: [u32; LANES / 2],
    /// By how many bits each of a word's values is shifted up to its end.
    up: [i32; RUN / LANES],
    /// By how many these are then shifted down: one a lane, since shifts of all lanes by one number take longer.
    down: [u32; LANES / PARTS],
}

/// By width, up to 8.
static UNPACKING: [Unpacking; 9] = unpackings();

const fn unpackings() -> [Unpacking; 9] {
    // of nothing: all is shifted out
    let nothing = Unpacking {
        planes: [[0x80; LANES]; 4],
        in_place: [!0; LANES / 2],
        up: [32; RUN / LANES],
        down: [0; LANES / PARTS],
    };
    let mut all = [nothing; 9];
    let mut width = 1;
    while width < all.len() {
        let (whole, mut lane) = (width / 2, 0);
        while lane < LANES {
            let mut byte = 0;
            while byte < whole {
                all[width].planes[byte][lane] = lane as u8;
                byte += 1;
            }
            if width % 2 == 1 {
                all[width].planes[whole][lane] = (lane % (LANES / 2)) as u8;
                all[width].in_place[lane % (LANES / 2)] = (1 << (8 * whole)) - 1;
            }
            lane += 1;
        }
        let mut value = 0;
        while value < RUN / LANES {
            all[width].up[value] = 32 - (width * (value + 1)) as i32;
            value += 1;
        }
        all[width].down = [32 - width as u32; LANES / PARTS];
        width += 1;
    }
    all
}

/// Adds as [`Product::add`] has it; false, with nothing done, where the processor has not what that takes.
pub(super) fn add(product: Product<'_>, light: [&[f32]; 3], bright: &[bool], sums: [&mut [f32]; 3]) -> bool {
    if !is_x86_feature_detected!("avx2") || !is_x86_feature_detected!("fma") {
        return false;
    }
    #[expect(unsafe_code, reason = "the processor was asked")]
    unsafe {
        add_fused(product, light, bright, sums);
    }
    true
}

/// One of the four values of each word.
#[inline]
#[target_feature(enable = "avx2")]
fn cut(words: __m256i, up: i32, down: __m256i) -> __m256 {
    _mm256_cvtepi32_ps(_mm256_srav_epi32(_mm256_sllv_epi32(words, _mm256_set1_epi32(up)), down))
}

/// Eight values of 16 bits.
#[inline]
#[target_feature(enable = "avx2")]
fn wide(bytes: &[u8; LANES]) -> __m256 {
    _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(load_bytes(bytes)))
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_bytes(from: &[u8; LANES]) -> __m128i {
    #[expect(unsafe_code, reason = "sixteen bytes")]
    unsafe {
        _mm_loadu_si128(from.as_ptr().cast())
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_words(from: &[u32; LANES / PARTS]) -> __m256i {
    #[expect(unsafe_code, reason = "eight words")]
    unsafe {
        _mm256_loadu_si256(from.as_ptr().cast())
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load(from: &[f32; RUN], place: usize) -> __m256 {
    let from = &from.as_chunks::<{ LANES / PARTS }>().0[place];
    #[expect(unsafe_code, reason = "eight numbers")]
    unsafe {
        _mm256_loadu_ps(from.as_ptr())
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store(to: &mut [f32; RUN], place: usize, values: __m256) {
    let to = &mut to.as_chunks_mut::<{ LANES / PARTS }>().0[place];
    #[expect(unsafe_code, reason = "eight numbers")]
    unsafe {
        _mm256_storeu_ps(to.as_mut_ptr(), values);
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn sum([low, high]: Floats) -> f32 {
    let eight = _mm256_add_ps(low, high);
    let four = _mm_add_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
    let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
}

/// The four times 16 values of a run, from its width and the bytes that begin with its own. A macro, and no closure in it or where it is used: a compiler may leave
/// either out of line, as it did, and vectors then go through memory, which takes ten times as long. What is called is a few instructions long each.
macro_rules! values {
    ($width:expr, $bytes:expr) => {{
        let (width, bytes): (u8, &[u8]) = ($width, $bytes);
        let mut values: [Floats; RUN / LANES] = [[_mm256_setzero_ps(); PARTS]; RUN / LANES];
        if width > 8 {
            let (halves, _) = bytes.as_chunks::<LANES>();
            for value in 0..RUN / LANES {
                for part in 0..PARTS {
                    values[value][part] = wide(&halves[value * PARTS + part]);
                }
            }
        } else {
            let unpacking = &UNPACKING[usize::from(width)];
            let mut last = [0; MOST];
            let bytes: &[u8; MOST] = match bytes.first_chunk() {
                Some(bytes) => bytes,
                None => {
                    last[..bytes.len()].copy_from_slice(bytes);
                    &last
                }
            };
            let (planes, _) = bytes.as_chunks::<LANES>();
            let a = _mm_shuffle_epi8(load_bytes(&planes[0]), load_bytes(&unpacking.planes[0]));
            let b = _mm_shuffle_epi8(load_bytes(&planes[1]), load_bytes(&unpacking.planes[1]));
            let c = _mm_shuffle_epi8(load_bytes(&planes[2]), load_bytes(&unpacking.planes[2]));
            let d = _mm_shuffle_epi8(load_bytes(&planes[3]), load_bytes(&unpacking.planes[3]));
            // bytes to pairs, pairs to words
            let (low_a, low_b) = (_mm_unpacklo_epi8(a, b), _mm_unpacklo_epi8(c, d));
            let (high_a, high_b) = (_mm_unpackhi_epi8(a, b), _mm_unpackhi_epi8(c, d));
            let first = _mm256_set_m128i(_mm_unpackhi_epi16(low_a, low_b), _mm_unpacklo_epi16(low_a, low_b));
            let last =
                _mm256_set_m128i(_mm_unpackhi_epi16(high_a, high_b), _mm_unpacklo_epi16(high_a, high_b));
            let in_place = load_words(&unpacking.in_place);
            let down = _mm256_andnot_si256(in_place, _mm256_srli_epi32::<4>(last));
            let words = [first, _mm256_or_si256(_mm256_and_si256(in_place, last), down)];
            let down = load_words(&unpacking.down);
            for value in 0..RUN / LANES {
                for part in 0..PARTS {
                    values[value][part] = cut(words[part], unpacking.up[value], down);
                }
            }
        }
        values
    }};
}

#[target_feature(enable = "avx2,fma")]
fn add_fused(product: Product<'_>, light: [&[f32]; 3], bright: &[bool], sums: [&mut [f32]; 3]) {
    let [red, green, blue] = light;
    let (red, green, blue) =
        (red.as_chunks::<RUN>().0, green.as_chunks::<RUN>().0, blue.as_chunks::<RUN>().0);
    let [reds, greens, blues] = sums;
    let reds = reds.as_chunks_mut::<RUN>().0;
    let (greens, blues) = (greens.as_chunks_mut::<RUN>().0, blues.as_chunks_mut::<RUN>().0);
    let Product { v: Runs { widths: mut v_widths, bytes: mut v }, v_scales, u_scales, .. } = product;
    let Runs { widths: mut u_widths, bytes: mut u } = product.u;
    for (&v_scale, &u_scale) in v_scales.iter().zip(u_scales) {
        let (of_v, of_u);
        (of_v, v_widths) = v_widths.split_at(bright.len());
        (of_u, u_widths) = u_widths.split_at(reds.len());
        let mut y = [[_mm256_setzero_ps(); PARTS]; 3];
        for (run, &width) in of_v.iter().enumerate() {
            let bytes = v;
            v = &bytes[run_bytes(width)..];
            if !bright[run] {
                continue;
            }
            let values = values!(width, bytes);
            let (red, green, blue) = (&red[run], &green[run], &blue[run]);
            for value in 0..RUN / LANES {
                for part in 0..PARTS {
                    let (q, place) = (values[value][part], value * PARTS + part);
                    y[0][part] = _mm256_fmadd_ps(q, load(red, place), y[0][part]);
                    y[1][part] = _mm256_fmadd_ps(q, load(green, place), y[1][part]);
                    y[2][part] = _mm256_fmadd_ps(q, load(blue, place), y[2][part]);
                }
            }
        }
        let red = _mm256_set1_ps(sum(y[0]) * v_scale * u_scale);
        let green = _mm256_set1_ps(sum(y[1]) * v_scale * u_scale);
        let blue = _mm256_set1_ps(sum(y[2]) * v_scale * u_scale);
        for (run, &width) in of_u.iter().enumerate() {
            let bytes = u;
            u = &bytes[run_bytes(width)..];
            let values = values!(width, bytes);
            let (reds, greens, blues) = (&mut reds[run], &mut greens[run], &mut blues[run]);
            for value in 0..RUN / LANES {
                for part in 0..PARTS {
                    let (q, place) = (values[value][part], value * PARTS + part);
                    store(reds, place, _mm256_fmadd_ps(q, red, load(reds, place)));
                    store(greens, place, _mm256_fmadd_ps(q, green, load(greens, place)));
                    store(blues, place, _mm256_fmadd_ps(q, blue, load(blues, place)));
                }
            }
        }
    }
}
