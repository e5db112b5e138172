use std::sync::OnceLock;

use glam::{Vec2, Vec3, Vec4};

/// How texture coordinates outside `0..1` are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, every other time mirrored.
    Mirror,
    /// The edge goes on for ever.
    Clamp,
}

/// What the stored bytes mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorSpace {
    /// RGB is sRGB-encoded, alpha linear.
    Srgb,
    /// All channels are linear.
    Linear,
}

/// An 8-bit RGBA image with its sampler. Always filtered bilinearly.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The name in the file.
    pub name: String,
    /// Pixels a row.
    pub width: usize,
    /// Rows; row 0 is at v = 0.
    pub height: usize,
    /// `width * height` texels.
    pub texels: Vec<[u8; 4]>,
    /// Meaning of RGB.
    pub color_space: ColorSpace,
    /// Outside `0..1`, along u and v.
    pub wrap: [Wrap; 2],
}

impl Wrap {
    /// The texel index in `0..size` that stands at `index`.
    pub fn texel(self, index: i64, size: usize) -> usize {
        let size = size as i64;
        let texel = match self {
            Self::Repeat => index.rem_euclid(size),
            Self::Mirror => {
                let twice = index.rem_euclid(2 * size);
                twice.min(2 * size - 1 - twice)
            }
            Self::Clamp => index.clamp(0, size - 1),
        };
        texel as usize
    }
}

fn linear_from_srgb() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            let encoded = byte as f32 / 255.0;
            if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
        })
    })
}

impl Texture {
    fn texel(&self, x: i64, y: i64) -> Vec4 {
        let column = self.wrap[0].texel(x, self.width);
        let row = self.wrap[1].texel(y, self.height);
        let [r, g, b, a] = self.texels[row * self.width + column];
        let alpha = f32::from(a) / 255.0;
        match self.color_space {
            ColorSpace::Srgb => {
                let table = linear_from_srgb();
                Vec3::new(table[r as usize], table[g as usize], table[b as usize]).extend(alpha)
            }
            ColorSpace::Linear => (Vec3::new(f32::from(r), f32::from(g), f32::from(b)) / 255.0).extend(alpha),
        }
    }

    /// The mean of the red channel as it is stored, `0..=1`; of a linear texture.
    pub fn mean_red(&self) -> f32 {
        let sum: u64 = self.texels.iter().map(|texel| u64::from(texel[0])).sum();
        (sum as f64 / (255.0 * self.texels.len().max(1) as f64)) as f32
    }

    /// Linear RGB and alpha at `uv`, bilinear between texel centres.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        // Coordinates beyond a few thousand repeats carry no texel precision; NaN reads as 0.
        let u = (uv.x * self.width as f32 - 0.5).clamp(-1e9, 1e9);
        let v = (uv.y * self.height as f32 - 0.5).clamp(-1e9, 1e9);
        let (x, y) = (u.floor(), v.floor());
        let (fx, fy) = (u - x, v - y);
        let (x, y) = (x as i64, y as i64);
        let top = self.texel(x, y).lerp(self.texel(x + 1, y), fx);
        let bottom = self.texel(x, y + 1).lerp(self.texel(x + 1, y + 1), fx);
        top.lerp(bottom, fy)
    }
}
