//! From scene-linear light to what a display is sent: exposure, tone curve, sRGB encoding.

use std::sync::LazyLock;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::Image;

/// The curve that brings scene-linear light, which has no upper end, into the range of a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tonemap {
    /// Khronos PBR Neutral: base colours under grey light come out as they were put in, highlights are
    /// compressed and desaturated.
    /// Khronos Group, "PBR Neutral Tone Mapper", <https://github.com/KhronosGroup/ToneMapping>.
    #[default]
    Neutral,
    /// AgX with its default look, by Troy Sobotka: flatter, with saturated lights that go to white as film
    /// does. The Rec. 709 form and the polynomial fit of its curve are those of B. Wrensch, "Minimal AgX
    /// Implementation", 2023, <https://iolite-engine.com/blog_posts/minimal_agx_implementation>.
    AgX,
    /// No curve: values outside `0..=1` are clipped.
    Srgb,
}

/// Pixels that one task encodes.
const CHUNK: usize = 4096;

/// 8-bit sRGB pixels of `image`, row by row: [`Encoder::bytes`] of each.
pub fn display(image: &Image, exposure: f32, tonemap: Tonemap) -> Vec<[u8; 3]> {
    let encoder = Encoder::new(exposure, tonemap);
    let mut bytes = vec![[0; 3]; image.pixels.len()];
    bytes.par_chunks_mut(CHUNK).zip(image.pixels.par_chunks(CHUNK)).for_each(|(bytes, pixels)| {
        for (to, &pixel) in bytes.iter_mut().zip(pixels) {
            *to = encoder.bytes(pixel);
        }
    });
    bytes
}

/// [`encode`] for many colours: to bytes, by tables.
#[derive(Clone, Copy)]
pub struct Encoder {
    gain: f32,
    tonemap: Tonemap,
    steps: &'static Steps,
}

impl Encoder {
    /// At an exposure in stops.
    pub fn new(exposure: f32, tonemap: Tonemap) -> Self {
        Self { gain: exposure.exp2(), tonemap, steps: &STEPS }
    }

    /// [`encode`], times 255, rounded to nearest, without a power for each channel.
    #[inline]
    pub fn bytes(&self, color: Vec3) -> [u8; 3] {
        curve(color * self.gain, self.tonemap).to_array().map(|linear| self.byte(linear))
    }

    /// [`srgb_from_linear`] of `0..=1`, times 255, rounded to nearest. What is outside is clipped, and NaN counts as 0.
    #[inline]
    pub fn byte(&self, linear: f32) -> u8 {
        let bits = if linear > 0.0 { linear.min(1.0).to_bits() } else { 0 };
        let bucket = bits.saturating_sub(Steps::LEAST.to_bits()) >> Steps::SHIFT;
        let byte = self.steps.guess[bucket as usize % Steps::BUCKETS];
        // a bucket has one step at most
        byte + u8::from(linear >= self.steps.first[usize::from(byte) + 1])
    }
}

/// Where bytes step on from one to the next.
struct Steps {
    /// Of values from [`Self::LEAST`] to 1, in buckets of equal leading bits, the byte at the beginning of each.
    guess: [u8; Self::BUCKETS],
    /// The least value of each byte, and after the last one NaN, which nothing reaches.
    first: [f32; 257],
}

static STEPS: LazyLock<Steps> = LazyLock::new(Steps::new);

impl Steps {
    /// Below the first step, which is at 0.00015.
    const LEAST: f32 = 1.0 / 8192.0;
    /// Leaves the exponent and eight bits of the mantissa: the widest bucket is a fifth of a byte.
    const SHIFT: u32 = 15;
    /// A power of two, of which those up to 1 are used.
    const BUCKETS: usize = 4096;

    fn new() -> Self {
        let byte = |bits: u32| (srgb_from_linear(f32::from_bits(bits).min(1.0)) * 255.0 + 0.5) as u8;
        let mut first = [f32::NAN; 257];
        for (wanted, first) in (0..=255).zip(&mut first) {
            // bits of positive numbers are in the order of the numbers
            let (mut low, mut high) = (0, 1.0_f32.to_bits());
            while low < high {
                let middle = low + (high - low) / 2;
                if byte(middle) < wanted { low = middle + 1 } else { high = middle }
            }
            *first = f32::from_bits(low);
        }
        let least = Self::LEAST.to_bits();
        let mut guess = [0; Self::BUCKETS];
        for (bucket, guess) in (0..).zip(&mut guess) {
            *guess = byte(least + (bucket << Self::SHIFT));
        }
        Self { guess, first }
    }
}

/// The sRGB-encoded display value, each channel in `0..=1`, of a scene-linear `color` at an exposure in
/// stops.
///
/// Negative and NaN channels count as 0, infinite ones as very bright.
pub fn encode(color: Vec3, exposure: f32, tonemap: Tonemap) -> Vec3 {
    let linear = curve(color * exposure.exp2(), tonemap);
    Vec3::from_array(linear.to_array().map(|value| srgb_from_linear(value.clamp(0.0, 1.0))))
}

/// Exposed light as linear display light, which may leave `0..=1`.
fn curve(exposed: Vec3, tonemap: Tonemap) -> Vec3 {
    // The bound keeps the curves below clear of infinity; all of them are at their end long before it.
    let exposed = exposed.to_array().map(|value| if value > 0.0 { value.min(1e9) } else { 0.0 });
    match tonemap {
        Tonemap::Neutral => neutral(exposed.into()),
        Tonemap::AgX => agx(exposed.into()),
        Tonemap::Srgb => exposed.into(),
    }
}

/// The Khronos PBR Neutral curve, from non-negative linear light to linear light in `0..=1`.
fn neutral(color: Vec3) -> Vec3 {
    /// The peak from which on highlights are compressed, after the offset of 0.04 (the Fresnel reflection of
    /// dielectrics) is taken away.
    const COMPRESSION_START: f32 = 0.8 - 0.04;
    /// How fast compressed highlights lose their colour.
    const DESATURATION: f32 = 0.15;

    let least = color.min_element();
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let color = color - offset;
    let peak = color.max_element();
    if peak < COMPRESSION_START {
        return color;
    }
    let room = 1.0 - COMPRESSION_START;
    let compressed_peak = 1.0 - room * room / (peak + room - COMPRESSION_START);
    let compressed = color * (compressed_peak / peak);
    let to_white = 1.0 - 1.0 / (DESATURATION * (peak - compressed_peak) + 1.0);
    compressed.lerp(Vec3::splat(compressed_peak), to_white)
}

/// The AgX curve, from non-negative linear light to linear light in `0..=1`.
fn agx(color: Vec3) -> Vec3 {
    /// Rec. 709 to AgX's log space primaries, by columns.
    const INSET: Mat3 = Mat3::from_cols(
        Vec3::new(0.842_479_05, 0.042_328_242, 0.042_375_656),
        Vec3::new(0.078_433_6, 0.878_468_63, 0.078_433_6),
        Vec3::new(0.079_223_745, 0.079_166_13, 0.879_143),
    );
    /// Back again.
    const OUTSET: Mat3 = Mat3::from_cols(
        Vec3::new(1.196_879, -0.052_896_857, -0.052_971_635),
        Vec3::new(-0.098_020_88, 1.151_903_1, -0.098_043_45),
        Vec3::new(-0.099_029_74, -0.098_961_174, 1.151_073_7),
    );
    /// The range of exposures the curve spans, log2 of linear light.
    const EXPOSURES: [f32; 2] = [-12.473_93, 4.026_069];

    let [low, high] = EXPOSURES;
    let curve = |light: f32| {
        let x = (light.max(1e-10).log2().clamp(low, high) - low) / (high - low);
        let polynomial = [-0.00232, 0.1191, 0.4298, -6.868, 31.96, -40.14, 15.5];
        polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    };
    let compressed = Vec3::from_array((INSET * color).to_array().map(curve));
    // The curve's output is meant for a display of gamma 2.2.
    let linear = |encoded: f32| encoded.clamp(0.0, 1.0).powf(2.2);
    Vec3::from_array((OUTSET * compressed).to_array().map(linear))
}

/// The sRGB transfer function (IEC 61966-2-1), from linear to encoded; both `0..=1`.
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_from_linear`].
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Tonemap; 3] = [Tonemap::Neutral, Tonemap::AgX, Tonemap::Srgb];

    #[test]
    fn srgb_has_its_published_values() {
        // Middle grey, half, and the joint of the two pieces.
        for (linear, byte) in [(0.0, 0), (0.18, 118), (0.215_86, 128), (0.5, 188), (1.0, 255), (0.001, 3)] {
            assert_eq!((srgb_from_linear(linear) * 255.0).round() as u8, byte, "at {linear}");
        }
        for step in 0..=1000 {
            let linear = step as f32 / 1000.0;
            assert!((linear_from_srgb(srgb_from_linear(linear)) - linear).abs() < 1e-5, "at {linear}");
        }
    }

    /// The table against the formula: everywhere, and on both sides of every step.
    #[test]
    fn bytes_are_those_of_the_formula() {
        let formula = |linear: f32| (srgb_from_linear(linear.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
        let encoder = Encoder::new(0.5, Tonemap::Srgb);
        for bits in (0..1.2_f32.to_bits()).step_by(1009) {
            let linear = f32::from_bits(bits);
            assert_eq!(encoder.byte(linear), formula(linear), "at {linear}");
        }
        let steps: Vec<u32> = STEPS.first[1..256].iter().map(|first| first.to_bits()).collect();
        for (byte, step) in steps.iter().enumerate() {
            assert_eq!(usize::from(encoder.byte(f32::from_bits(*step))), byte + 1);
            assert_eq!(usize::from(encoder.byte(f32::from_bits(step - 1))), byte);
        }
        for (odd, byte) in [(-1.0, 0), (-0.0, 0), (f32::NAN, 0), (f32::INFINITY, 255), (1.0, 255)] {
            assert_eq!(encoder.byte(odd), byte, "{odd}");
        }
        // steps are in buckets of their own
        let bucket = |bits: &u32| bits.saturating_sub(Steps::LEAST.to_bits()) >> Steps::SHIFT;
        assert!(steps.windows(2).all(|pair| bucket(&pair[0]) < bucket(&pair[1])));
        let color = Vec3::new(0.7, 0.02, 3.0);
        for tonemap in ALL {
            let encoded = encode(color, 0.5, tonemap).to_array().map(|value| (value * 255.0 + 0.5) as u8);
            assert_eq!(Encoder::new(0.5, tonemap).bytes(color), encoded);
        }
    }

    #[test]
    fn neutral_keeps_colours_below_the_knee_but_for_the_offset() {
        let color = Vec3::new(0.5, 0.3, 0.1);
        assert_eq!(neutral(color), color - 0.04);
        // Near black the offset is the whole least channel less its 6.25-fold square.
        let dark = Vec3::new(0.3, 0.2, 0.04);
        assert!((neutral(dark) - (dark - 0.03)).abs().max_element() < 1e-6);
        assert_eq!(neutral(Vec3::ZERO), Vec3::ZERO);
    }

    #[test]
    fn neutral_compresses_peaks_as_the_formula_says() {
        // Grey 1.0: the peak is 0.96, so 1 - 0.24^2 / (0.96 + 0.24 - 0.76) = 0.869090...
        let grey = neutral(Vec3::ONE);
        assert!((grey - 0.869_090_9).abs().max_element() < 1e-5, "{grey}");
        // Continuous at the knee.
        let knee = neutral(Vec3::splat(0.8));
        assert!((knee - 0.76).abs().max_element() < 1e-5, "{knee}");
        assert!(neutral(Vec3::splat(1e9)).max_element() <= 1.0);
    }

    #[test]
    fn neutral_keeps_hue_while_it_compresses() {
        let hue = |c: Vec3| {
            let (least, most) = (c.min_element(), c.max_element());
            ((c.y - least) / (most - least), c.x == most, c.z == least)
        };
        for scale in [0.5, 1.0, 4.0, 32.0] {
            let color = Vec3::new(1.0, 0.6, 0.2) * scale;
            let ((before, ..), (after, largest, least)) = (hue(color), hue(neutral(color)));
            assert!((before - after).abs() < 1e-4 && largest && least, "at {scale}");
        }
    }

    #[test]
    fn every_curve_rises_and_stays_in_range() {
        for tonemap in ALL {
            let mut last = -1.0;
            for step in -80..=120 {
                let shown = encode(Vec3::splat((step as f32 * 0.1).exp2()), 0.0, tonemap);
                assert!(shown.min_element() >= last, "{tonemap:?} falls at step {step}");
                assert!((0.0..=1.0).contains(&shown.x), "{tonemap:?} leaves the range at step {step}");
                last = shown.max_element() - 1e-3; // AgX tints grey by less than this
            }
            assert!(last > 0.98, "{tonemap:?} ends at {last}");
        }
    }

    #[test]
    fn agx_puts_middle_grey_near_the_middle() {
        // 0.18 is 10 of 16.5 stops up the curve, which is where AgX puts its pivot of 0.5.
        let grey = encode(Vec3::splat(0.18), 0.0, Tonemap::AgX);
        assert!((grey - 0.5).abs().max_element() < 0.005, "{grey}");
        assert!(encode(Vec3::ZERO, 0.0, Tonemap::AgX).max_element() < 1e-3);
    }

    #[test]
    fn exposure_is_in_stops() {
        let color = Vec3::new(0.02, 0.1, 0.3);
        for tonemap in ALL {
            assert_eq!(encode(color, 2.0, tonemap), encode(color * 4.0, 0.0, tonemap));
            assert_ne!(encode(color, 2.0, tonemap), encode(color, 0.0, tonemap));
        }
    }

    #[test]
    fn display_rounds_to_bytes_and_survives_bad_pixels() {
        let mut image = Image::new(2, 2);
        image.pixels[1] = Vec3::new(1.0, 0.5, -3.0);
        image.pixels[2] = Vec3::new(f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
        let shown = display(&image, 0.0, Tonemap::Srgb);
        assert_eq!(shown, [[0, 0, 0], [255, 188, 0], [0, 255, 0], [0, 0, 0]]);
        for tonemap in ALL {
            assert!(display(&image, 200.0, tonemap).iter().all(|pixel| pixel[0] <= pixel[1].max(254)));
        }
    }
}
