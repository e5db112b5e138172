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

    /// CIE 1931 colour matching functions at a wavelength in nm, by the fit of Wyman, Sloan and Shirley, "Simple analytic approximations to the CIE XYZ color
    /// matching functions", JCGT 2(2), 2013.
    fn matching(nm: f64) -> [f64; 3] {
        let lobe = |height: f64, middle: f64, left: f64, right: f64| {
            let width = if nm < middle { left } else { right };
            height * (-0.5 * ((nm - middle) / width).powi(2)).exp()
        };
        [
            lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7) + lobe(-0.065, 501.1, 20.4, 26.2),
            lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
            lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
        ]
    }

    /// Chromaticity of a black body, by Planck's law.
    fn planck(kelvin: f64) -> [f64; 2] {
        let mut sums = [0.0; 3];
        for nm in 360..=830 {
            let metres = f64::from(nm) * 1e-9;
            let radiance = metres.powi(-5) / ((1.438_777e-2 / (metres * kelvin)).exp() - 1.0);
            let matching = matching(f64::from(nm));
            sums.iter_mut().zip(matching).for_each(|(sum, matching)| *sum += radiance * matching);
        }
        let all: f64 = sums.iter().sum();
        [sums[0] / all, sums[1] / all]
    }

    fn chromaticity(kelvin: f32) -> [f64; 2] {
        let xyz = REC709_FROM_XYZ.inverse() * black_body_color(kelvin);
        [xyz.x, xyz.y].map(|value| f64::from(value / xyz.element_sum()))
    }

    #[test]
    fn colours_are_those_of_black_bodies() {
        // beyond these some of a black body's light is outside Rec. 709
        for kelvin in [2000_u16, 2700, 3500, 5000, 6500, 9000, 14_000, 20_000] {
            let (found, law) = (chromaticity(f32::from(kelvin)), planck(f64::from(kelvin)));
            let off = (found[0] - law[0]).hypot(found[1] - law[1]);
            assert!(off < 0.005, "{kelvin}: {found:?}, by the law {law:?}");
        }
        // CIE standard illuminant A
        let [x, y] = chromaticity(2856.0);
        assert!((x - 0.447_57).abs() < 1e-3 && (y - 0.407_45).abs() < 1e-3, "{x} {y}");
        assert_eq!(black_body_color(3000.0).max_element(), 1.0);
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
