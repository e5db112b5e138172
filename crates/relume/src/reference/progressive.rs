//! A path-traced frame that gets better for as long as one waits.

use glam::Vec3;

use super::film::judged;
use super::{Reference, Settings, render};
use crate::image::{Image, Layers};
use crate::scene::{Geometry, LightRig, Scene};
use crate::trace::Accel;
use crate::{Progress, Result};

/// Renders the same frame again and again, with other random numbers each time, and keeps the mean of all. The first pass has the paths of the settings; each
/// later one as many as all before it, so that noise falls by the same factor from pass to pass.
#[derive(Clone, Debug)]
pub struct Progressive {
    settings: Settings,
    mean: Option<Reference>,
    paths: u32,
    passes: u32,
}

impl Progressive {
    /// Begins with none. `settings.seed` is that of the first pass; images by bounce and by light are left out.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings: Settings { per_bounce: false, per_light: false, ..settings },
            mean: None,
            paths: 0,
            passes: 0,
        }
    }

    /// Paths a pixel so far.
    pub fn paths(&self) -> u32 {
        self.paths
    }

    /// One more pass; returns the mean of all. The arguments are those of [`render`], and the same in each pass.
    ///
    /// # Errors
    /// As [`render`]; what was there before stays.
    pub fn refine(
        &mut self,
        scene: &Scene,
        geometry: &Geometry,
        accel: &Accel,
        rig: &LightRig,
        progress: &dyn Progress,
    ) -> Result<&Reference> {
        let spp = self.paths.max(self.settings.spp);
        // far from the seeds of others, which are small numbers
        let seed = self.settings.seed.wrapping_add(self.passes.wrapping_mul(0x9e37_79b9));
        let settings = Settings { spp, seed, ..self.settings.clone() };
        let pass = render(scene, geometry, accel, rig, &settings, progress)?;
        let mean = match self.mean.take() {
            Some(mean) => pooled(mean, self.paths, pass, spp),
            None => pass,
        };
        (self.paths, self.passes) = (self.paths + spp, self.passes + 1);
        Ok(self.mean.insert(mean))
    }
}

/// The mean of two independent references, by their paths; each half of one goes with a half of the other.
fn pooled(mut a: Reference, a_paths: u32, b: Reference, b_paths: u32) -> Reference {
    let share = b_paths as f32 / (a_paths + b_paths) as f32;
    let mix = |a: &mut Image, b: &Image| {
        let mixed = |(a, b): (&mut Vec3, &Vec3)| *a = a.lerp(*b, share);
        a.pixels.iter_mut().zip(&b.pixels).for_each(mixed);
    };
    let add = |a: &mut Layers, b: &Layers| {
        mix(&mut a.direct, &b.direct);
        mix(&mut a.indirect, &b.indirect);
    };
    a.halves.iter_mut().zip(&b.halves).for_each(|(a, b)| add(a, b));
    add(&mut a.layers, &b.layers);
    let (deviation, noise) = judged(&a.halves);
    a.layers.noise = Some(deviation);
    Reference { noise, ..a }
}
