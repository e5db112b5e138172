//! Direct-to-indirect transfer: what is prepared once and applied for every change of light.
//!
//! [`Preparation`] turns a scene into a [`Transfer`]: view samples, the gather cloud, and two operators, one from the
//! cloud to the view samples and one from the cloud to itself. [`Transfer::save`] and [`Transfer::load`] keep it in a
//! file.

mod atlas;
mod block_file;
mod block_lengths;
mod blocks;
mod bounces;
mod budget;
mod buffer;
mod cache;
mod coefficients;
mod compute;
mod culling;
mod directions;
mod effort;
mod faint;
mod form_factors;
mod gathering;
mod gemm;
mod glossy_rows;
pub mod haar;
pub mod haar_blocks;
mod haar_blocks_encoder;
pub mod haar_rows;
mod image_layout;
mod interpolation;
pub mod low_rank;
mod low_rank_encoder;
mod low_rank_run;
mod memory;
mod multibounce;
mod needs;
mod occluders;
mod operator;
mod outlook;
mod packed_runs;
mod paper_rows;
mod photons;
mod preparation;
mod preparing;
mod prior;
mod rectangles;
mod rows;
mod selection;
mod settings;
mod shot;
mod sight;
mod tensors;
mod tiles;
mod training;
mod workers;

pub use block_file::{BlocksOf, Shard};
pub use bounces::BounceSeries;
pub use buffer::Buffer;
pub use cache::FORMAT_VERSION;
pub use coefficients::Coefficients;
pub use culling::Work;
pub use effort::Quality;
pub use image_layout::ImageLayout;
pub use interpolation::{Interpolation, RecordShare, RunEnds};
pub use memory::resident_bytes;
pub use multibounce::{CloudBounces, Multibounce};
pub use occluders::Occluders;
pub use operator::{Encoding, EncodingError, Matrix, Operator};
pub use photons::PhotonSettings;
pub use preparation::Preparation;
pub use preparing::{Preparing, Status};
pub use selection::Selection;
pub use settings::{RowMethod, Settings};

use std::collections::BTreeSet;

use glam::Vec3;

use crate::sample::{GatherCloud, Receivers, ViewSamples};

/// A prepared shot: all that relighting needs, and nothing of the scene file.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// How it was prepared, and what that took.
    pub report: Report,
    /// How long that took; zero for a transfer that was loaded, so that files do not depend on the weather.
    pub timings: Timings,
    /// What the camera sees.
    pub view: ViewSamples,
    /// What can light it.
    pub cloud: GatherCloud,
    /// `F_d`: from light on the cloud to the receivers of the view samples.
    pub gather: Operator,
    /// `F_g`: the same along the specular lobes of the receivers, as a share of what these reflect. As many rows, by the same interpolation; `None` where it
    /// was left out.
    pub glossy: Option<Operator>,
    /// From light on the cloud to the cloud itself; albedo is applied outside. One row a gather sample of a surface: those of the sky, the
    /// last ones, receive nothing. One bounce, or all of them: see [`Self::multibounce`].
    pub bounce: Operator,
    /// The receiver that each of the view's centres takes its light from; [`Receivers::NONE`] where nothing is gathered.
    pub receivers_of_centers: Buffer<u32>,
    /// The same for the view's quads.
    pub receivers_of_quads: Buffer<u32>,
    /// The same for the branches of the view's centres.
    pub receivers_of_center_branches: Buffer<u32>,
    /// The same for those of its quads.
    pub receivers_of_quad_branches: Buffer<u32>,
    /// What casts shadows.
    pub occluders: Occluders,
}

/// How a transfer was made.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Report {
    /// Settings it was prepared with.
    pub settings: Settings,
    /// Name of the scene's file, without its folder, as the caller gave it.
    pub scene: String,
    /// Names of the scene's materials, by number.
    pub materials: Vec<String>,
    /// Their base colour factors, linear RGB, `0..=1` each: what a rig's edits take the place of.
    pub base_colors: Vec<[f32; 3]>,
    /// Numbers of those that emit light, ascending, whether the shot has any of it or not.
    pub emissive: Vec<u32>,
    /// xxh3 hash of all that was read of the scene: geometry, materials, textures, camera.
    pub scene_hash: String,
    /// Triangles.
    pub triangles: u64,
    /// Visibility and hemisphere rays of the final gather, a pixel whose centre gathers light.
    pub rays_per_pixel: f64,
    /// The same of the bounces, a gather sample; with photons, the rays on which these fly and those by which samples look around.
    pub rays_per_gather_sample: f64,
    /// Expected error of the final gather's encoding alone.
    pub gather_error: EncodingError,
    /// The same of the reflections along specular lobes; `None` where there are none.
    pub glossy_error: Option<EncodingError>,
    /// The same of the bounces' encoding.
    pub bounce_error: EncodingError,
}

/// How long a preparation took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings {
    /// Wall-clock seconds, all told.
    pub seconds: f64,
    /// The same by stage, in order.
    pub stages: Vec<(String, f64)>,
}

impl Report {
    /// The scene's materials by their names, and whether they emit light.
    pub fn named_materials(&self) -> impl Iterator<Item = (&str, bool)> + Clone {
        let emits = |number: u32| self.emissive.binary_search(&number).is_ok();
        (0..).zip(&self.materials).map(move |(number, name)| (name.as_str(), emits(number)))
    }
}

/// How many pixels' centres take light from anywhere, by themselves or by their branches; `from` says where each of both does.
fn gathering_pixels(view: &ViewSamples, [centers, branches]: [&[u32]; 2]) -> usize {
    let mut gathers: Vec<bool> = centers.iter().map(|&from| from != Receivers::NONE).collect();
    for (branch, &from) in view.center_chains.branches.iter().zip(branches) {
        gathers[branch.owner as usize] |= from != Receivers::NONE;
    }
    gathers.into_iter().filter(|&gathers| gathers).count()
}

impl Transfer {
    /// Whether this is what [`Preparation::direct_first`] shows first: without gather samples, and so without light from other surfaces, from domes
    /// but for their suns, and from emissive surfaces, which are seen to shine. Such a transfer is for looking and cannot be saved.
    pub fn is_direct_only(&self) -> bool {
        self.cloud.is_empty()
    }

    /// Bytes of all operators a pixel of the image, with their interpolation.
    pub fn bytes_per_pixel(&self) -> f64 {
        let bytes =
            self.gather.bytes() + self.glossy_bytes() + self.bounce.bytes() + self.interpolation_bytes();
        bytes as f64 / self.view.pixels().max(1) as f64
    }

    /// What of the view samples of a grid takes its light from which receiver: of the samples themselves, and of their branches.
    pub fn receivers_of(&self, aa: u32) -> [&[u32]; 2] {
        if aa == 1 {
            [&self.receivers_of_centers, &self.receivers_of_center_branches]
        } else {
            [&self.receivers_of_quads, &self.receivers_of_quad_branches]
        }
    }

    /// Bytes of what takes rows to the points at which light arrives; 0 where each of these has a row.
    pub fn interpolation_bytes(&self) -> usize {
        let of = |operator: &Operator| operator.interpolation.as_ref().map_or(0, |spread| spread.bytes());
        of(&self.gather) + of(&self.bounce)
    }

    /// Bytes of the glossy operator; 0 without.
    pub fn glossy_bytes(&self) -> usize {
        self.glossy.as_ref().map_or(0, Operator::bytes)
    }

    /// `F_d g` and, where there are reflections, `F_g g`, interpolated: one RGB a receiver. `epsilon` is that of culling
    /// ([`Operator::apply_coefficients`]); 0 leaves out nothing. Also returns how much there was to do.
    ///
    /// # Panics
    /// If `light` has not one entry a gather sample.
    pub fn gather_from(&self, light: &[Vec3], epsilon: f32) -> (Vec<Vec3>, Option<Vec<Vec3>>, Work) {
        let mut work = Work::default();
        let mut apply = |operator: &Operator, coefficients: &Coefficients| {
            let mut out = bytemuck::zeroed_vec(operator.rows);
            work += operator.apply_coefficients(coefficients, epsilon, &mut out);
            out
        };
        let coefficients = self.gather.coefficients(light);
        let glossy = self.glossy.as_ref().map(|glossy| {
            // both learn from the same prior, unless a file says otherwise
            if glossy.weighs_like(&self.gather) {
                apply(glossy, &coefficients)
            } else {
                apply(glossy, &glossy.coefficients(light))
            }
        });
        (apply(&self.gather, &coefficients), glossy, work)
    }

    /// Numbers of the materials that the camera sees shine or whose light the cloud has, ascending.
    pub fn emissive_materials(&self) -> Vec<u32> {
        let seen = [1, 2].into_iter().flat_map(|aa| self.view.grid(aa).emitted());
        let seen = seen.map(|(_, material, _)| material);
        let cloud = self.cloud.emitted.iter().map(|part| part.material);
        seen.chain(cloud).collect::<BTreeSet<u32>>().into_iter().collect()
    }

    /// Numbers of the materials that the camera sees or that reflect light to what it sees, ascending: those whose edits show.
    pub fn shown_materials(&self) -> Vec<u32> {
        let grids = [1, 2].map(|aa| self.view.grid(aa));
        let straight = grids.iter().flat_map(|grid| grid.samples);
        let behind = grids.iter().flat_map(|grid| &grid.chains.branches).map(|branch| &branch.sample);
        let samples = straight.chain(behind).filter(|sample| sample.is_lit());
        let cloud =
            self.cloud.diffuse.iter().zip(&self.cloud.sub_samples).filter(|(_, sub)| sub.weight() > 0.0);
        let mut shown = vec![false; self.report.materials.len()];
        for material in samples.map(|sample| sample.material).chain(cloud.map(|(part, _)| part.material())) {
            shown[material as usize] = true;
        }
        (0..).zip(shown).filter(|&(_, shown)| shown).map(|(material, _)| material).collect()
    }

    /// What `bounce` holds.
    pub fn multibounce(&self) -> Multibounce {
        self.report.settings.multibounce
    }

    /// Pixels whose centre gathers light, by itself or by what it shows in mirrors and through glass.
    pub fn lit_pixels(&self) -> usize {
        gathering_pixels(&self.view, [&self.receivers_of_centers, &self.receivers_of_center_branches])
    }
}
