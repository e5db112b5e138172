//! The transfer by a fixed quadrature that no cloud and no compression has part in.

use std::f32::consts::PI;

use rayon::prelude::*;
use relume::glam::{Vec2, Vec3};
use relume::image::Image;
use relume::scene::Geometry;
use relume::shade::{PreparedLight, Surface, shadow_ray, surface_at};
use relume::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use relume::trace::{Accel, Hit, Ray, offset_origin};
use relume::{Camera, Light, Progress, Scene};

/// A shot, each pixel of which gathers light along the same rays under every light.
pub(crate) struct Quadrature<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) geometry: &'a Geometry,
    pub(crate) accel: &'a Accel,
    pub(crate) camera: &'a Camera,
    /// Pixels: width and height.
    pub(crate) size: (usize, usize),
    /// Hemisphere rays from each pixel's centre, cosine-distributed.
    pub(crate) rays: u32,
}

/// Where a pixel's ray met a surface.
struct Point {
    position: Vec3,
    /// Unit, geometric, on the side that was hit.
    normal: Vec3,
    /// Hemispherical reflectance over pi.
    reflected: Vec3,
}

impl Quadrature<'_> {
    /// Indirect light of one bounce, an image for each of `lights`, which have no extent. Surfaces reflect as the diffuse transfer models
    /// it: the camera's by its diffuse lobe and shading normal, the other by its hemispherical reflectance and geometric normal.
    /// Another seed gives independent rays.
    pub(crate) fn images(&self, lights: &[Light], seed: u32, progress: &dyn Progress) -> Vec<Image> {
        let (width, height) = self.size;
        progress.stage("exact transfer", height as u64);
        let prepared: Vec<_> = lights.iter().map(PreparedLight::new).collect();
        let rows: Vec<Vec<Vec<Vec3>>> = (0..height)
            .into_par_iter()
            .map(|row| {
                let pixels = (0..width).map(|column| self.pixel(column, row, &prepared, seed)).collect();
                progress.advance(1);
                pixels
            })
            .collect();
        let image = |light: usize| {
            let pixels = rows.iter().flatten().map(|by_light| by_light[light]).collect();
            Image { width, height, pixels }
        };
        (0..lights.len()).map(image).collect()
    }

    /// A pixel's centre under each light.
    fn pixel(&self, column: usize, row: usize, lights: &[PreparedLight], seed: u32) -> Vec<Vec3> {
        let (width, height) = self.size;
        let direction = self.camera.direction(column as f32 + 0.5, row as f32 + 0.5, width, height);
        let hit = self.accel.closest(&Ray::new(self.camera.position(), direction));
        let surface = hit.is_hit().then(|| surface_at(self.scene, self.geometry, &hit, direction));
        let Some(surface) = surface.filter(|surface| surface.lit) else {
            return vec![Vec3::ZERO; lights.len()];
        };
        let reflectance = surface.diffuse(-direction.dot(surface.shading_normal));
        let points = self.points(&surface, hash((row * width + column) as u32, seed));
        lights.iter().map(|light| reflectance * self.gathered(light, &points)).collect()
    }

    /// What the rays from a surface hit and what reflects light there.
    fn points(&self, surface: &Surface, seed: u32) -> Vec<Point> {
        let origin = offset_origin(surface.position, surface.geometric_normal);
        let rays: Vec<Ray> = (0..self.rays)
            .map(|index| cosine_hemisphere(surface.shading_normal, sobol_2d(index, 0, seed)))
            .filter(|direction| surface.geometric_normal.dot(*direction) > 0.0)
            .map(|direction| Ray::new(origin, direction))
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        self.accel.closest_batch(&rays, &mut hits);
        let point = |(ray, hit): (&Ray, &Hit)| {
            let surface = hit.is_hit().then(|| surface_at(self.scene, self.geometry, hit, ray.direction))?;
            let reflected = surface.hemispherical_reflectance() / PI;
            let Surface { position, geometric_normal: normal, lit, .. } = surface;
            (lit && reflected != Vec3::ZERO).then_some(Point { position, normal, reflected })
        };
        rays.iter().zip(&hits).filter_map(point).collect()
    }

    /// The mean radiance along a pixel's rays: irradiance over pi.
    fn gathered(&self, light: &PreparedLight, points: &[Point]) -> Vec3 {
        let (mut rays, mut shares) = (Vec::new(), Vec::new());
        for point in points {
            let Some(sample) = light.sample(point.position, Vec2::ZERO) else { continue };
            let cosine = point.normal.dot(sample.direction);
            if cosine > 0.0 {
                rays.push(shadow_ray(point.position, point.normal, &sample));
                shares.push(point.reflected * sample.irradiance * cosine);
            }
        }
        let mut hidden = vec![false; rays.len()];
        self.accel.occluded_batch(&rays, &mut hidden);
        let seen = shares.iter().zip(&hidden).filter(|&(_, &hidden)| !hidden);
        seen.map(|(share, _)| *share).sum::<Vec3>() / self.rays as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::reference::{Paths, Settings};
    use relume_tests::scenes::{TestScene, box_room, omni, rig};
    use relume_tests::truth::{trace_bounces, unbiased_relative_l2};

    /// The path tracer's first bounce is the same light; another lamp's is not.
    #[test]
    fn it_agrees_with_the_path_tracer() {
        let built = box_room();
        let size = (12, 9);
        let lamp = |x: f32| rig([omni(Vec3::new(x, 2.2, 2.6), Vec3::splat(10.0), 0.0)]);
        let (width, height) = size;
        let settings =
            Settings { width, height, spp: 512, aa: 1, paths: Paths::DiffuseTransfer, ..Settings::default() };
        let TestScene { scene, geometry, accel } = &built;
        let truths = trace_bounces(scene, geometry, accel, &lamp(2.6), &settings, &[Some(1)], &()).unwrap();
        let quadrature = Quadrature { scene, geometry, accel, camera: &scene.cameras[0], size, rays: 1024 };
        let lights: Vec<Light> = [2.6, 2.2].into_iter().flat_map(|x| lamp(x).lights).collect();
        let images = quadrature.images(&lights, 1, &());
        let errors: Vec<f64> =
            images.iter().map(|image| unbiased_relative_l2(image, &truths.indirect[0])).collect();
        println!("{errors:.4?}");
        assert!(errors[0] < 0.02, "{errors:.4?}");
        assert!(errors[1] > 0.05, "{errors:.4?}");
    }
}
