use glam::{Mat3, Vec3};

/// Colour temperatures that a colour is known of, kelvin, both included.
pub const TEMPERATURES: std::ops::RangeInclusive<f32> = 1667.0..=25_000.0;

/// CIE XYZ to linear Rec. 709 (IEC 61966-2-1), by columns.
const REC709_FROM_XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(3.240_454, -0.969_266, 0.055_643_4),
    Vec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
    Vec3::new(-0.498_531_4, 0.041_556, 1.057_225_2),
);

/// The linear Rec. 709 colour of a black body of so many kelvin, its largest channel 1. Temperatures beyond [`TEMPERATURES`] count as the nearest one.
///
/// The Planckian locus by the cubic splines of Kim et al., "Design of advanced color temperature control system for HDTV applications", Journal of the
/// Korean Physical Society 41(6), 2002. A candle is at about 1900, a household lamp at 2700, noon at 5500, a clear sky at 10,000 and above. The white of
/// Rec. 709 (D65) is a little greener than any black body.
pub fn black_body_color(kelvin: f32) -> Vec3 {
    let kelvin = f64::from(kelvin.clamp(*TEMPERATURES.start(), *TEMPERATURES.end()));
    let cubic = |x: f64, [a, b, c, d]: [f64; 4]| ((a * x + b) * x + c) * x + d;
    let of_reciprocal = if kelvin <= 4000.0 {
        [-0.266_123_9e9, -0.234_358_9e6, 0.877_695_6e3, 0.179_910]
    } else {
        [-3.025_846_9e9, 2.107_037_9e6, 0.222_634_7e3, 0.240_390]
    };
    let x = cubic(1.0 / kelvin, of_reciprocal);
    let of_x = if kelvin <= 2222.0 {
        [-1.106_381_4, -1.348_110_2, 2.185_558_32, -0.202_196_83]
    } else if kelvin <= 4000.0 {
        [-0.954_947_6, -1.374_185_93, 2.091_370_15, -0.167_488_67]
    } else {
        [3.081_758, -5.873_386_7, 3.751_129_97, -0.370_014_83]
    };
    let y = cubic(x, of_x);
    let xyz = Vec3::new((x / y) as f32, 1.0, ((1.0 - x - y) / y) as f32);
    let color = (REC709_FROM_XYZ * xyz).max(Vec3::ZERO);
    color / color.max_element()
}

/// The temperature whose [`black_body_color`] is nearest to `color` in all but brightness, kelvin; `None` for black.
pub fn nearest_temperature(color: Vec3) -> Option<f32> {
    let chroma = color / color.max_element();
    if !chroma.is_finite() {
        return None;
    }
    // evenly in reciprocals, in which colours change evenly
    let (most, least) = (1.0 / TEMPERATURES.start(), 1.0 / TEMPERATURES.end());
    let at = |step: u16| 1.0 / (least + (most - least) * f32::from(step) / 1000.0);
    let distance = |kelvin: f32| black_body_color(kelvin).distance_squared(chroma);
    (0..=1000).map(at).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_published_tables() {
        // M. Charity, "What color is a blackbody?" (CIE 1931 2 degrees, D65), sRGB encoded; its figures are of Planck's law, not of a fit
        for (kelvin, published) in [
            (2000.0, [255, 137, 14]),
            (3000.0, [255, 180, 107]),
            (5000.0, [255, 228, 206]),
            (10_000.0, [202, 218, 255]),
        ] {
            let encoded = black_body_color(kelvin)
                .to_array()
                .map(|channel| crate::image::display::srgb_from_linear(channel) * 255.0);
            for (found, published) in encoded.into_iter().zip(published) {
                assert!((found - published as f32).abs() < 6.0, "{kelvin}: {encoded:?}, not {published}");
            }
        }
    }

    #[test]
    fn temperatures_are_found_again() {
        for kelvin in [1700.0, 2700.0, 4000.0, 6500.0, 12_000.0] {
            let found = nearest_temperature(black_body_color(kelvin) * 37.0).unwrap();
            assert!((found / kelvin - 1.0).abs() < 0.02, "{found} for {kelvin}");
        }
        assert_eq!(nearest_temperature(Vec3::ZERO), None);
    }
}
