//! The gather cloud: points on all surfaces that can light the view samples.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::cells::Facet;
use super::refine::{Cuts, Part, Refinement};
use super::sightings::Sightings;
use super::sky::{SKY_SHARE, SkyCells, SkySightings, SkySphere};
use super::speakers::Speaker;
use super::{
    CellMap, DiffusePart, Emitted, GatherSample, PackedNormal, PackedUnit, SUB_SAMPLES, SubSample, TARGETS,
    reach, tree,
};
use crate::progress::Progress;
use crate::scene::{Geometry, Scene};
use crate::trace::sampling::hash;
use crate::trace::{Accel, Hit, offset_origin};
use crate::{Error, Result};

/// Gather samples in the order of the cluster tree (which is the Morton order of the flattened gather image), with
/// [`SUB_SAMPLES`] sub-samples each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GatherCloud {
    /// `4^k` samples: first those of surfaces, then those of the sky, if there are any: far away, without albedo.
    pub samples: Vec<GatherSample>,
    /// `SUB_SAMPLES` a sample of surfaces, neighbours close together.
    pub sub_samples: Vec<SubSample>,
    /// One a sub-sample.
    pub diffuse: Vec<DiffusePart>,
    /// The samples' emission, material by material; in the order of samples.
    pub emitted: Vec<Emitted>,
    /// The cells of the sky, one for each of the last samples; a sixteenth of all, or none.
    pub sky: SkyCells,
}

/// How finely surfaces are parted, and where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CloudMethod {
    /// Cells of equal area.
    Uniform,
    /// Cells of equal importance to the view, with a floor by area (Hasan 2006, section 4.1).
    Importance,
    /// Cells small where single view samples depend on them strongly; the default.
    #[default]
    Adaptive,
}

/// What a cloud is made with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CloudSettings {
    /// Gather samples: a power of four from 256 to 4^10.
    pub count: usize,
    /// Where they are dense.
    pub method: CloudMethod,
    /// Whether a sixteenth of them are of the sky, if it can be seen.
    pub sky: bool,
    /// Rays that all view samples together send at most, to tell who sees what: memory does not grow with the image.
    pub rays: usize,
    /// Of all random numbers.
    pub seed: u32,
}

/// What a cell takes where a ray is one step of making a cloud: to be parted coarsely, to be parted for good, to have its
/// portrait taken. Measured at 4096 to 65,536 cells.
const CELL_STEPS: [u64; 3] = [16, 32, 64];
/// Steps of parting for good a ray from a view sample: one in so many.
const RAYS_A_STEP: u64 = 8;

/// The sides of triangles that may reflect: fronts, and the backs of two-sided materials.
fn facets(scene: &Scene, geometry: &Geometry) -> Vec<Facet> {
    (0..geometry.triangles.len() as u32)
        .into_par_iter()
        .flat_map_iter(|triangle| {
            let material = geometry.materials[triangle as usize] as usize;
            let backs = scene.materials[material].shows_back();
            [false, true]
                .into_iter()
                .filter(move |&back| !back || backs)
                .filter_map(move |back| Facet::new(geometry, triangle, back))
        })
        .collect()
}

impl GatherCloud {
    /// A cloud over all surfaces from which light can find a way to the camera.
    ///
    /// `seen` are the camera's first hits with the directions of their rays.
    ///
    /// # Errors
    /// [`Error::Setting`] unless `count` is a power of four from 256 to 4^10; [`Error::Cancelled`].
    pub fn new(
        scene: &Scene,
        geometry: &Geometry,
        accel: &Accel,
        seen: &[(Hit, Vec3)],
        settings: &CloudSettings,
        progress: &dyn Progress,
    ) -> Result<(Self, CellMap)> {
        check_count(settings.count)?;
        let cells = settings.count as u64;
        let rays = seen.len() as u64 * u64::from(Sightings::rays(seen.len(), settings.rays));
        let [coarsely, for_good, portrait] = CELL_STEPS;
        let for_good = for_good * cells + rays / RAYS_A_STEP;
        let other = (coarsely + reach::RAYS as u64 + portrait) * cells + tree::ordering_steps(settings.count);
        progress.stage("gather cloud", other + for_good + rays);
        let bounds = geometry.bounds().unwrap_or_default();
        let diagonal = bounds.0.distance(bounds.1).max(1e-6);
        let build = Build { scene, geometry, accel, seen, settings, diagonal };
        let (facets, sightings, sky_sightings) = build.reached(progress)?;
        let sky = if settings.sky {
            SkyCells::new(sky_sightings, settings.method, settings.count / SKY_SHARE, progress)?
        } else {
            SkyCells::default()
        };
        let surfaces = settings.count - sky.len();
        let refinement =
            Refinement { geometry, sightings: &sightings, normal_scale: tree::normal_scale(diagonal) };
        let (parts, cuts) = refinement.run(facets, settings.method, surfaces, (progress, for_good))?;
        if parts.len() < surfaces {
            return Err(too_few(settings.count));
        }
        let take = |(cell, part)| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let taken = build.portrait(cell, part, &sightings);
            progress.advance(portrait);
            Ok(taken)
        };
        let cells: Vec<Portrait> = parts.par_iter().enumerate().map(take).collect::<Result<_>>()?;
        let (mut cloud, mut map) = ordered(&cells, cuts, diagonal, progress)?;
        add_sky(&mut cloud, &mut map, sky, SkySphere::around(bounds.0, bounds.1), settings.seed);
        progress.advance(tree::ordering_steps(settings.count) - tree::ordering_steps(surfaces));
        progress.advance(portrait * (settings.count - surfaces) as u64);
        Ok((cloud, map))
    }

    /// The cloud with other base colours, for light to fall on and be reflected by: it cannot be recoloured again. `changes` is what is
    /// added to each material's factor, linear RGB. `None` where no surface of the cloud has a material that changes.
    ///
    /// Albedo is what both lobes return; the part of the diffuse one is linear in the base colour, the other stays.
    ///
    /// # Panics
    /// If a material has no entry in `changes`.
    pub fn recolored(&self, changes: &[Vec3]) -> Option<Self> {
        let change = |part: &DiffusePart| changes[part.material() as usize];
        if !self.diffuse.par_iter().any(|part| change(part) != Vec3::ZERO) {
            return None;
        }
        let mut cloud = Self {
            samples: self.samples.clone(),
            sub_samples: self.sub_samples.clone(),
            emitted: self.emitted.clone(),
            sky: self.sky.clone(),
            diffuse: Vec::new(),
        };
        let patches = cloud.sub_samples.par_chunks_exact_mut(SUB_SAMPLES);
        let patches = patches.zip(self.diffuse.par_chunks_exact(SUB_SAMPLES));
        cloud.samples.par_iter_mut().zip(patches).for_each(|(sample, (sub_samples, parts))| {
            let (mut added, mut weight) = (Vec3::ZERO, 0.0);
            for (sub, part) in sub_samples.iter_mut().zip(parts) {
                let more = part.white.get() * change(part);
                if more != Vec3::ZERO {
                    sub.albedo = PackedUnit::new(sub.albedo.get() + more);
                }
                added += more * sub.weight();
                weight += sub.weight();
            }
            if added != Vec3::ZERO {
                sample.albedo = (sample.albedo + added / weight).clamp(Vec3::ZERO, Vec3::ONE);
            }
        });
        Some(cloud)
    }

    /// Number of gather samples, `n_g`.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Those of surfaces: they come first.
    pub fn surfaces(&self) -> &[GatherSample] {
        &self.samples[..self.samples.len() - self.sky.len()]
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }
}

/// Puts the cells in the order of the cluster tree.
fn ordered(
    cells: &[Portrait],
    mut cuts: Cuts,
    diagonal: f32,
    progress: &dyn Progress,
) -> Result<(GatherCloud, CellMap)> {
    let keys: Vec<_> =
        cells.iter().map(|cell| tree::key(cell.sample.position, cell.sample.normal, diagonal)).collect();
    // beside a sky there are fifteen sixteenths of a power of four: three clusters of four, and three that the sky goes with
    let run = if cells.len().is_power_of_two() { 1 } else { cells.len() / (SKY_SHARE - 1) };
    let order = tree::order(&keys, [4, 1].map(|runs| if run > 1 { runs * run } else { 1 }), progress)?;
    let mut numbers = vec![0; cells.len()];
    for (number, &cell) in order.iter().enumerate() {
        numbers[cell as usize] = number as u32;
    }
    cuts.renumber(&numbers);
    let in_order = || order.iter().map(|&cell| &cells[cell as usize]);
    let cloud = GatherCloud {
        samples: in_order().map(|cell| cell.sample).collect(),
        sub_samples: in_order().flat_map(|cell| cell.sub_samples).collect(),
        diffuse: in_order().flat_map(|cell| cell.diffuse).collect(),
        emitted: (0..).zip(in_order()).flat_map(|(sample, cell)| cell.emitted(sample)).collect(),
        sky: SkyCells::default(),
    };
    let map = CellMap {
        cuts,
        targets: in_order().flat_map(|cell| cell.targets.map(|(place, _)| place)).collect(),
        target_normals: in_order().flat_map(|cell| cell.targets.map(|(_, normal)| normal)).collect(),
        middles: in_order().map(|cell| cell.middle).collect(),
        sky: SkyCells::default(),
        sphere: SkySphere::default(),
    };
    Ok((cloud, map))
}

/// Adds samples of the sky, in the order of its cells, which follow each other closely on the sphere.
fn add_sky(cloud: &mut GatherCloud, map: &mut CellMap, sky: SkyCells, sphere: SkySphere, seed: u32) {
    for cell in 0..sky.len() {
        let direction = sky.direction(cell, Vec2::splat(0.5));
        let position = sphere.at(direction);
        cloud.samples.push(GatherSample {
            position,
            area: sphere.area(sky.solid_angle(cell)),
            normal: -direction,
            triangle: u32::MAX,
            albedo: Vec3::ZERO,
            reserved: 0,
            emission: Vec3::ZERO,
            reserved2: 0,
        });
        map.middles.push((position, -direction));
        for target in sky.targets(cell, seed) {
            map.targets.push(sphere.at(target));
            map.target_normals.push(PackedNormal::new(-target));
        }
    }
    cloud.sky = sky.clone();
    (map.sky, map.sphere) = (sky, sphere);
}

fn check_count(count: usize) -> Result<()> {
    let power_of_four = count.is_power_of_two() && count.trailing_zeros().is_multiple_of(2);
    if power_of_four && (256..=1 << 20).contains(&count) {
        return Ok(());
    }
    Err(Error::Setting(format!(
        "{count} gather samples: the number must be a power of four from 256 to 1048576, such as 16384, 65536 or 262144"
    )))
}

fn nothing() -> Error {
    Error::Setting(
        "the camera sees no surface that reflects light, but for mirrors and glass: nothing to relight; take another camera, or make surfaces double-sided that it sees from behind"
            .into(),
    )
}

fn too_few(count: usize) -> Error {
    Error::Setting(format!("too few surfaces that light the view for {count} gather samples; ask for fewer"))
}

/// A cell as a gather sample.
struct Portrait {
    sample: GatherSample,
    sub_samples: [SubSample; SUB_SAMPLES],
    diffuse: [DiffusePart; SUB_SAMPLES],
    targets: [(Vec3, PackedNormal); TARGETS],
    middle: (Vec3, Vec3),
    /// Mean emission by material; few have any.
    emitted: Vec<(u32, Vec3)>,
}

impl Portrait {
    fn emitted(&self, sample: u32) -> impl Iterator<Item = Emitted> + '_ {
        self.emitted.iter().map(move |&(material, radiance)| Emitted { sample, material, radiance })
    }
}

/// What a cloud is built from.
struct Build<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    accel: &'a Accel,
    seen: &'a [(Hit, Vec3)],
    settings: &'a CloudSettings,
    diagonal: f32,
}

impl Build<'_> {
    /// The sides of triangles from which light can leave for the camera, judged by coarse cells, who sees them, and who sees the sky.
    fn reached(&self, progress: &dyn Progress) -> Result<(Vec<Facet>, Sightings, SkySightings)> {
        let facets = facets(self.scene, self.geometry);
        if facets.is_empty() {
            return Err(nothing());
        }
        let normal_scale = tree::normal_scale(self.diagonal);
        let none = Sightings::none(self.geometry);
        let coarse = Refinement { geometry: self.geometry, sightings: &none, normal_scale };
        let CloudSettings { count, seed, rays, .. } = *self.settings;
        let steps = CELL_STEPS[0] * count as u64;
        let (parts, cuts) = coarse.run(facets.clone(), CloudMethod::Uniform, count, (progress, steps))?;
        let surroundings = reach::explore(self.geometry, self.accel, &parts, &cuts, seed, progress)?;
        let reached = reach::reached(self.geometry, &surroundings, &cuts, self.seen);
        let facets = reach::keep_reached(&parts, &reached, facets);
        if facets.is_empty() {
            return Err(nothing());
        }
        // only what can reach the camera speaks
        let (mut others, mut others_sky) = (Vec::new(), Vec::new());
        for (surroundings, _) in surroundings.into_iter().zip(reached).filter(|&(_, reached)| reached) {
            others.extend(surroundings.sightings);
            others_sky.extend(surroundings.sky);
        }
        let others = (&others[..], &others_sky[..]);
        let seen = (self.seen, Sightings::rays(self.seen.len(), rays));
        let (sightings, sky) = Sightings::new(self.geometry, self.accel, seen, others, seed, progress)?;
        Ok((facets, sightings, sky))
    }

    fn portrait(&self, cell: usize, part: &Part, sightings: &Sightings) -> Portrait {
        let seed = hash(cell as u32, self.settings.seed);
        let spread = part.cell.points(self.geometry, TARGETS, seed);
        let solid: Vec<_> = spread
            .iter()
            .filter(|(facet, uv)| self.accel.masks().is_solid(facet.triangle, uv.x, uv.y))
            .map(|&(facet, uv)| Speaker::new(self.geometry, facet.side(), uv, 1.0 / TARGETS as f32))
            .collect();
        let seen = Speaker::of_sightings(self.geometry, &part.sightings(sightings));
        let area = part.area * solid.len() as f32 / TARGETS as f32;
        let speakers = Speaker::chosen(&solid, &seen, seed);
        let sub_samples = speakers.map(|speaker| speaker.sub_sample(self.scene, self.geometry));
        let diffuse = speakers.map(|speaker| speaker.diffuse_part(self.scene, self.geometry));
        let typical = Speaker::typical(&speakers, area);
        let middle = match solid.len() {
            TARGETS => part.cell.middle(self.geometry),
            _ => (typical.position, typical.normal),
        };
        let surface = |speaker: &Speaker| speaker.surface(self.scene, self.geometry);
        let mut emitted: Vec<(u32, Vec3)> = Vec::new();
        for speaker in &speakers {
            let surface = surface(speaker);
            let radiance = surface.emission * speaker.weight;
            if radiance == Vec3::ZERO {
                continue;
            }
            match emitted.iter_mut().find(|(material, _)| *material == surface.material) {
                Some((_, sum)) => *sum += radiance,
                None => emitted.push((surface.material, radiance)),
            }
        }
        let mean = |of: fn(&crate::shade::Surface) -> Vec3| {
            speakers.iter().map(|speaker| of(&surface(speaker)) * speaker.weight).sum::<Vec3>()
        };
        let lifted = |speaker: &Speaker| {
            (offset_origin(speaker.position, speaker.normal), PackedNormal::new(speaker.normal))
        };
        let alone = (typical.position, PackedNormal::new(typical.normal));
        Portrait {
            sample: GatherSample {
                position: typical.position,
                area,
                normal: typical.normal,
                triangle: (typical.side / 2) as u32,
                albedo: mean(|surface| surface.hemispherical_reflectance()),
                reserved: 0,
                emission: emitted.iter().map(|&(_, radiance)| radiance).sum(),
                reserved2: 0,
            },
            sub_samples,
            diffuse,
            middle,
            emitted,
            targets: std::array::from_fn(|i| solid.get(i % solid.len().max(1)).map_or(alone, lifted)),
        }
    }
}
