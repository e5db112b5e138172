use glam::{DVec3, Vec3};

use super::tile::TileArea;
use super::{MAX_BOUNCE_IMAGES, Noise, Reference, Settings};
use crate::image::{Image, Layers, LightLayers};

/// Which sums a render keeps, and where: two halves of the direct layer, two of the indirect one, then one image a
/// bounce, then two a light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Film {
    bounces: usize,
    lights: usize,
    /// Paths per pixel and half.
    samples: u32,
}

/// Where light belongs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    /// Which half's path found it; `None` where it holds for both.
    pub(super) half: Option<u32>,
    /// Indirect bounces; 0 is direct.
    pub(super) bounce: u32,
    /// The light it comes from; `None` for emissive triangles.
    pub(super) light: Option<u32>,
}

/// Sums over a tile's paths; in `f64`, so that no number of paths loses digits.
#[derive(Clone, Debug)]
pub(super) struct TileSums {
    film: Film,
    pixels: usize,
    sums: Vec<DVec3>,
}

impl Film {
    pub(super) fn new(settings: &Settings, lights: usize) -> Self {
        let bounces = settings.bounces.unwrap_or(MAX_BOUNCE_IMAGES).min(MAX_BOUNCE_IMAGES);
        Self {
            bounces: if settings.per_bounce { bounces as usize } else { 0 },
            lights: if settings.per_light { lights } else { 0 },
            samples: settings.samples() * settings.aa * settings.aa,
        }
    }

    pub(super) fn sums(self, pixels: usize) -> TileSums {
        TileSums { film: self, pixels, sums: vec![DVec3::ZERO; pixels * self.layers()] }
    }

    fn layers(&self) -> usize {
        4 + self.bounces + 2 * self.lights
    }

    /// One image from its sums in all tiles, divided by the number of paths.
    fn image(&self, layer: usize, settings: &Settings, areas: &[TileArea], tiles: &[Vec<Vec3>]) -> Image {
        let mut image = Image::new(settings.width, settings.height);
        for (area, tile) in areas.iter().zip(tiles) {
            let pixels = &tile[layer * area.pixels()..][..area.pixels()];
            for (row, pixels) in pixels.chunks_exact(area.width).enumerate() {
                let start = (area.y + row) * settings.width + area.x;
                image.pixels[start..start + area.width].copy_from_slice(pixels);
            }
        }
        image
    }

    /// Puts the tiles together. `names` are the enabled lights'.
    pub(super) fn assemble(
        &self,
        settings: &Settings,
        areas: &[TileArea],
        tiles: &[Vec<Vec3>],
        names: Vec<String>,
    ) -> Reference {
        let image = |layer| self.image(layer, settings, areas, tiles);
        let halves =
            [0, 1].map(|half| Layers { direct: image(half), indirect: image(2 + half), ..Layers::default() });
        let [a, b] = &halves;
        let direct = mean(&a.direct, &b.direct);
        let indirect = mean(&a.indirect, &b.indirect);
        let (deviation, noise) = judged(&halves);
        let lights = names.into_iter().take(self.lights).enumerate();
        let first = 4 + self.bounces;
        let per_light = lights
            .map(|(light, name)| LightLayers {
                name,
                direct: image(first + 2 * light),
                indirect: image(first + 2 * light + 1),
            })
            .collect();
        Reference {
            layers: Layers { direct, indirect, per_light, edges: Vec::new(), noise: Some(deviation) },
            indirect_by_bounce: (4..first).map(image).collect(),
            halves,
            noise,
        }
    }
}

impl TileSums {
    /// Adds the radiance `light` at `pixel` of the tile, as found by `paths` paths.
    pub(super) fn add(&mut self, pixel: u32, share: Share, light: Vec3, paths: u32) {
        let light = light.as_dvec3() * f64::from(paths);
        let direct = share.bounce == 0;
        let first = if direct { 0 } else { 2 };
        if let Some(half) = share.half {
            self.add_to(first + half as usize, pixel, light);
            self.add_to_parts(pixel, share, light);
        } else {
            self.add_to(first, pixel, light);
            self.add_to(first + 1, pixel, light);
            self.add_to_parts(pixel, share, 2.0 * light);
        }
    }

    /// Adds to the images of bounces and lights, which do not tell the halves apart.
    fn add_to_parts(&mut self, pixel: u32, share: Share, light: DVec3) {
        let bounce = share.bounce as usize;
        if (1..=self.film.bounces).contains(&bounce) {
            self.add_to(3 + bounce, pixel, light);
        }
        if let Some(source) = share.light
            && (source as usize) < self.film.lights
        {
            let layer = 4 + self.film.bounces + 2 * source as usize;
            self.add_to(layer + usize::from(bounce > 0), pixel, light);
        }
    }

    fn add_to(&mut self, layer: usize, pixel: u32, light: DVec3) {
        self.sums[layer * self.pixels + pixel as usize] += light;
    }

    /// Means over the paths: all layers, one after the other.
    pub(super) fn means(&self) -> Vec<Vec3> {
        let halves = 4 * self.pixels;
        let per_half = 1.0 / f64::from(self.film.samples);
        self.sums
            .iter()
            .enumerate()
            .map(|(i, &sum)| (sum * if i < halves { per_half } else { 0.5 * per_half }).as_vec3())
            .collect()
    }
}

/// Each pixel's standard error and the noise of the whole, as two independent halves show them.
pub(super) fn judged([a, b]: &[Layers; 2]) -> (Image, Noise) {
    let deviation = half_difference(&a.full(), &b.full());
    let noise = Noise {
        full: norm(&deviation) / norm(&mean(&a.full(), &b.full())).max(f64::MIN_POSITIVE),
        direct: relative_noise(&a.direct, &b.direct),
        indirect: relative_noise(&a.indirect, &b.indirect),
    };
    (deviation, noise)
}

fn combine(a: &Image, b: &Image, f: impl Fn(Vec3, Vec3) -> Vec3) -> Image {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(&a, &b)| f(a, b)).collect();
    Image { pixels, ..*a }
}

fn mean(a: &Image, b: &Image) -> Image {
    combine(a, b, |a, b| 0.5 * (a + b))
}

/// The standard error of the mean of two independent halves, as one pair of them shows it.
fn half_difference(a: &Image, b: &Image) -> Image {
    combine(a, b, |a, b| 0.5 * (a - b).abs())
}

fn norm(image: &Image) -> f64 {
    image.pixels.iter().map(|pixel| pixel.as_dvec3().length_squared()).sum::<f64>().sqrt()
}

fn relative_noise(a: &Image, b: &Image) -> f64 {
    norm(&half_difference(a, b)) / norm(&mean(a, b)).max(f64::MIN_POSITIVE)
}
