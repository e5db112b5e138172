//! The sums for processors with AVX2 and FMA.
//!
//! How wide a run is changes from one to the next, and nothing foretells it: a branch on it is mostly lost. So all widths of at most 8 bits are unpacked in
//! the same steps, with what differs in a table: bytes of a lane are brought together by shuffles, and shifts by a number of bits cut the values out.
//! (AVX-512 does the same in half the steps, and gained nothing on a processor that has it, an AMD EPYC that takes two for each.)

use std::arch::x86_64::*;
use std::sync::LazyLock;

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
    down: [i32; LANES / PARTS],
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
        all[width].down = [32 - width as i32; LANES / PARTS];
        width += 1;
    }
    all
}

static IS_THERE: LazyLock<bool> =
    LazyLock::new(|| is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));

/// Whether the processor has both.
pub(super) fn is_there() -> bool {
    *IS_THERE
}

/// See [`Product::add`].
///
/// # Panics
/// Unless the processor [`is_there`].
pub(super) fn add(product: Product<'_>, light: [&[f32]; 3], bright: &[bool], sums: [&mut [f32]; 3]) {
    assert!(is_there());
    #[expect(unsafe_code, reason = "the processor was asked")]
    unsafe {
        add_fused(product, light, bright, sums);
    }
}

/// The first bytes, then any.
#[inline(always)]
fn head(bytes: &[u8]) -> [u8; MOST] {
    bytes.first_chunk().copied().unwrap_or_else(|| {
        let mut head = [0; MOST];
        head[..bytes.len()].copy_from_slice(bytes);
        head
    })
}

#[inline]
#[target_feature(enable = "avx2")]
fn words(unpacking: &Unpacking, bytes: &[u8; MOST]) -> [__m256i; PARTS] {
    let (planes, _) = bytes.as_chunks::<LANES>();
    let plane = |byte: usize| -> __m128i {
        _mm_shuffle_epi8(bytemuck::cast(planes[byte]), bytemuck::cast(unpacking.planes[byte]))
    };
    let [a, b, c, d] = [plane(0), plane(1), plane(2), plane(3)];
    // bytes to pairs, pairs to words
    let (low, high) = (
        [_mm_unpacklo_epi8(a, b), _mm_unpacklo_epi8(c, d)],
        [_mm_unpackhi_epi8(a, b), _mm_unpackhi_epi8(c, d)],
    );
    let words = |[low, high]: [__m128i; 2]| {
        _mm256_set_m128i(_mm_unpackhi_epi16(low, high), _mm_unpacklo_epi16(low, high))
    };
    let in_place: __m256i = bytemuck::cast(unpacking.in_place);
    let last = words(high);
    let down = _mm256_andnot_si256(in_place, _mm256_srli_epi32::<4>(last));
    [words(low), _mm256_or_si256(_mm256_and_si256(in_place, last), down)]
}

#[inline]
#[target_feature(enable = "avx2")]
fn cut(words: __m256i, up: i32, down: &[i32; LANES / PARTS]) -> __m256 {
    let up = _mm256_sllv_epi32(words, _mm256_set1_epi32(up));
    _mm256_cvtepi32_ps(_mm256_srav_epi32(up, bytemuck::cast(*down)))
}

#[inline]
#[target_feature(enable = "avx2")]
fn wide(bytes: &[u8; 2 * LANES]) -> Floats {
    let halves: [__m128i; PARTS] = bytemuck::pod_read_unaligned(bytes);
    halves.map(|half| _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(half)))
}

#[inline]
#[target_feature(enable = "avx2")]
fn load(from: &[f32; RUN], place: usize) -> __m256 {
    bytemuck::pod_read_unaligned(bytemuck::bytes_of(&from.as_chunks::<{ LANES / PARTS }>().0[place]))
}

#[inline]
#[target_feature(enable = "avx2")]
fn store(to: &mut [f32; RUN], place: usize, values: __m256) {
    to.as_chunks_mut::<{ LANES / PARTS }>().0[place] = bytemuck::cast(values);
}

#[inline]
#[target_feature(enable = "avx2")]
fn sum([low, high]: Floats) -> f32 {
    let lanes: [f32; LANES / PARTS] = bytemuck::cast(_mm256_add_ps(low, high));
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

/// Calls `each` with the number of every run that is `taken` and its four times 16 values; `bytes` are afterwards those that follow. Everything is
/// put in place where it is called: calls within the loop cost more than the sums.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn for_runs(
    widths: &[u8],
    bytes: &mut &[u8],
    taken: impl Fn(usize) -> bool,
    mut each: impl FnMut(usize, [Floats; RUN / LANES]),
) {
    for (run, &width) in widths.iter().enumerate() {
        let rest = *bytes;
        *bytes = &rest[run_bytes(width)..];
        if !taken(run) {
            continue;
        }
        let values = if width > 8 {
            let (blocks, _) = rest.as_chunks::<{ 2 * LANES }>();
            std::array::from_fn(|value| wide(&blocks[value]))
        } else {
            let unpacking = &UNPACKING[usize::from(width)];
            let words = words(unpacking, &head(rest));
            unpacking.up.map(|up| words.map(|words| cut(words, up, &unpacking.down)))
        };
        each(run, values);
    }
}

#[target_feature(enable = "avx2,fma")]
fn add_fused(product: Product<'_>, light: [&[f32]; 3], bright: &[bool], sums: [&mut [f32]; 3]) {
    let [(red, _), (green, _), (blue, _)] = light.map(|light| light.as_chunks::<RUN>());
    let [(reds, _), (greens, _), (blues, _)] = sums.map(|sums| sums.as_chunks_mut::<RUN>());
    let Product {
        v: Runs { widths: mut v_widths, bytes: mut v },
        u: Runs { widths: mut u_widths, bytes: mut u },
        ..
    } = product;
    for (&v_scale, &u_scale) in product.v_scales.iter().zip(product.u_scales) {
        let of_v = v_widths.split_off(..bright.len()).unwrap_or_default();
        let of_u = u_widths.split_off(..reds.len()).unwrap_or_default();
        let mut y = [[_mm256_setzero_ps(); PARTS]; 3];
        for_runs(
            of_v,
            &mut v,
            |run| bright[run],
            |run, values| {
                let light = [&red[run], &green[run], &blue[run]];
                for (value, q) in values.iter().enumerate() {
                    for (y, light) in y.iter_mut().zip(light) {
                        for part in 0..PARTS {
                            y[part] = _mm256_fmadd_ps(q[part], load(light, value * PARTS + part), y[part]);
                        }
                    }
                }
            },
        );
        let y = y.map(|lanes| _mm256_set1_ps(sum(lanes) * v_scale * u_scale));
        for_runs(
            of_u,
            &mut u,
            |_| true,
            |run, values| {
                let mut sums = [&mut reds[run], &mut greens[run], &mut blues[run]];
                for (value, q) in values.iter().enumerate() {
                    for (sums, y) in sums.iter_mut().zip(y) {
                        for part in 0..PARTS {
                            let place = value * PARTS + part;
                            store(sums, place, _mm256_fmadd_ps(q[part], y, load(sums, place)));
                        }
                    }
                }
            },
        );
    }
}
