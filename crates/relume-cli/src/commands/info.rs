//! `relume info`: what is in a scene or a cache.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use relume::scene::Geometry;
use relume::transfer::{FORMAT_VERSION, Matrix, Multibounce, Operator, Report, Settings};
use relume::{Camera, Error, Light, LightKind, LightRig, Result, Transfer};
use relume_io::{Imported, save_rig};
use serde::Serialize;

use crate::console::Console;
use crate::output::{check_output, ending};
use crate::report::{Table, bytes, count, percent, plural};
use crate::scene_file;

use super::prepare::{add_encoding_errors, of_the_sky};

/// Show what is in a scene or a cache: counts, sizes, bytes per pixel, expected error.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// A scene (.glb, .gltf, .obj) or a cache (.relume).
    file: PathBuf,
    /// Write the lights stored in the scene as a rig.
    #[arg(long, value_name = "OUT.toml")]
    rig: Option<PathBuf>,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example:
  relume info assets/arcade.glb
The lights stored in a scene of yours, as a rig:
  relume info SCENE.glb --rig lights.toml";

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let file = &arguments.file;
    if ending(file).as_deref() == Some("relume") {
        if arguments.rig.is_some() {
            return Err(Error::file(file, "is a cache, which holds no lights; give --rig with the scene"));
        }
        let transfer = console.stage("reading the cache", || Transfer::load(file))?;
        let shown = CacheContents::new(file, &transfer)?;
        return if arguments.json { console.json(&shown) } else { console.result(&shown.to_string()) };
    }
    if let Some(rig) = &arguments.rig {
        check_output(rig, "the name of a rig", &["toml"], &[file])?;
    }
    let imported = scene_file::read(file, console)?;
    if let Some(rig) = &arguments.rig {
        write_lights(&imported.scene.lights, rig, file)?;
        let lights = plural(imported.scene.lights.lights.len(), "light", "lights");
        console.notice(&format!("{lights} written to {}", rig.display()));
    }
    let shown = console.stage("measuring the scene", || Ok(SceneContents::new(file, &imported)))?;
    if arguments.json { console.json(&shown) } else { console.result(&shown.to_string()) }
}

fn write_lights(lights: &LightRig, rig: &Path, scene: &Path) -> Result<()> {
    if lights.lights.is_empty() {
        return Err(Error::file(
            scene,
            "holds no lights (KHR_lights_punctual) to write as a rig; write one by hand",
        ));
    }
    save_rig(lights, rig)
}

/// What `--json` prints of a scene.
#[derive(Serialize)]
struct SceneContents<'a> {
    kind: &'static str,
    scene: &'a Path,
    meshes: usize,
    instances: usize,
    /// With every instance counted.
    triangles: usize,
    materials: usize,
    textures: usize,
    texture_bytes: usize,
    cameras: Vec<CameraContents<'a>>,
    lights: Vec<LightContents<'a>>,
    /// Names of materials that shine.
    emitters: Vec<&'a str>,
    /// Materials with a name.
    named_materials: Vec<NamedColor<'a>>,
    /// Lowest and highest corner of the box round everything, metres, world space.
    bounds: Option<[[f32; 3]; 2]>,
    warnings: &'a [String],
}

/// A material and its base colour factor, linear RGB: what a rig can edit.
#[derive(Clone, Copy, PartialEq, PartialOrd, Serialize)]
struct NamedColor<'a> {
    name: &'a str,
    base_color: [f32; 3],
}

#[derive(Serialize)]
struct CameraContents<'a> {
    name: &'a str,
    position: [f32; 3],
    vertical_fov_degrees: f32,
}

#[derive(Serialize)]
struct LightContents<'a> {
    name: &'a str,
    r#type: &'static str,
}

impl<'a> SceneContents<'a> {
    fn new(path: &'a Path, Imported { scene, warnings }: &'a Imported) -> Self {
        let geometry = Geometry::new(scene);
        Self {
            kind: "scene",
            scene: path,
            meshes: scene.meshes.len(),
            instances: scene.instances.len(),
            triangles: geometry.triangles.len(),
            materials: scene.materials.len(),
            textures: scene.textures.len(),
            texture_bytes: scene.textures.iter().map(|texture| size_of_val(&*texture.texels)).sum(),
            cameras: scene.cameras.iter().map(CameraContents::new).collect(),
            lights: scene.lights.lights.iter().map(LightContents::new).collect(),
            emitters: emitters(scene.named_materials()),
            named_materials: named_colors(scene.materials.iter().map(|material| NamedColor {
                name: &material.name,
                base_color: material.base_color.truncate().to_array(),
            })),
            bounds: geometry.bounds().map(|(low, high)| [low.to_array(), high.to_array()]),
            warnings,
        }
    }
}

impl<'a> CameraContents<'a> {
    fn new(camera: &'a Camera) -> Self {
        Self {
            name: &camera.name,
            position: camera.position().to_array(),
            vertical_fov_degrees: camera.vertical_fov.to_degrees(),
        }
    }
}

impl<'a> LightContents<'a> {
    fn new(light: &'a Light) -> Self {
        let kind = match light.kind {
            LightKind::Omni { .. } => "omni",
            LightKind::Spot { .. } => "spot",
            LightKind::Distant { .. } => "distant",
            LightKind::Dome { .. } => "dome",
        };
        Self { name: &light.name, r#type: kind }
    }
}

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

/// Names of those that emit light, each once: what a rig's emitters can name.
fn emitters<'m>(materials: impl Iterator<Item = (&'m str, bool)>) -> Vec<&'m str> {
    let named = materials.filter(|(name, emits)| *emits && !name.is_empty()).map(|(name, _)| name);
    named.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Those with a name, in order of it; one that several materials share with one colour is there once.
fn named_colors<'m>(materials: impl Iterator<Item = NamedColor<'m>>) -> Vec<NamedColor<'m>> {
    let mut named: Vec<_> = materials.filter(|material| !material.name.is_empty()).collect();
    named.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    named.dedup();
    named
}

/// Most materials that are shown; `--json` has all.
const SHOWN_MATERIALS: usize = 40;

fn add_materials(table: &mut Table, materials: &[NamedColor<'_>]) {
    for NamedColor { name, base_color: [r, g, b] } in materials.iter().take(SHOWN_MATERIALS) {
        table.line("material", format!("`{name}`, base colour {r:.3} {g:.3} {b:.3}"));
    }
    if let Some(more) = materials.len().checked_sub(SHOWN_MATERIALS).filter(|&more| more > 0) {
        table.line("", format!("and {more} more; --json lists all"));
    }
}

fn point([x, y, z]: [f32; 3]) -> String {
    format!("({x:.2}, {y:.2}, {z:.2})")
}

impl std::fmt::Display for SceneContents<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut table = Table::new();
        table.line(
            "geometry",
            format!(
                "{} triangles in {} of {}",
                count(self.triangles as u64),
                plural(self.instances, "instance", "instances"),
                plural(self.meshes, "mesh", "meshes")
            ),
        );
        table.line(
            "materials",
            format!(
                "{}, {} in {}",
                self.materials,
                bytes(self.texture_bytes as u64),
                plural(self.textures, "texture", "textures")
            ),
        );
        for (number, camera) in self.cameras.iter().enumerate() {
            table.line(
                &format!("camera {number}"),
                format!(
                    "`{}` at {}, {:.1} degrees high",
                    camera.name,
                    point(camera.position),
                    camera.vertical_fov_degrees
                ),
            );
        }
        for light in &self.lights {
            table.line("light", format!("`{}`, {}", light.name, light.r#type));
        }
        if self.lights.is_empty() {
            table.line("lights", "none in the file");
        }
        if !self.emitters.is_empty() {
            table.line("emitters", quoted(&self.emitters));
        }
        add_materials(&mut table, &self.named_materials);
        if let Some([low, high]) = self.bounds {
            table.line("bounds", format!("{} to {} m", point(low), point(high)));
        }
        write!(f, "{table}")
    }
}

/// What `--json` prints of a cache.
#[derive(Serialize)]
struct CacheContents<'a> {
    kind: &'static str,
    cache: &'a Path,
    format_version: u32,
    cache_bytes: u64,
    bytes_per_pixel: f64,
    width: usize,
    height: usize,
    lit_pixels: usize,
    receivers: usize,
    /// View samples that are seen in mirrors and through glass.
    branches: usize,
    gather_samples: usize,
    /// Receivers that have a row of the final gather; the others take theirs from near ones.
    records: usize,
    /// Those of them that are of the sky.
    sky_samples: usize,
    /// Names of materials that shine.
    emitters: Vec<&'a str>,
    /// Materials with a name that the shot shows or that light it.
    shown_materials: Vec<NamedColor<'a>>,
    /// Sizes in memory, which are those in the file but for its header.
    parts: Parts,
    /// How wavelet lights are packed, with `haar-blocks`.
    blocks: Blocks,
    #[serde(flatten)]
    report: &'a Report,
}

#[derive(Serialize)]
struct Parts {
    gather_bytes: usize,
    /// Its reflections; 0 without.
    glossy_bytes: usize,
    bounce_bytes: usize,
    /// From rows to the points that take their light from several; 0 where each has a row of its own.
    interpolation_bytes: usize,
    view_samples_bytes: usize,
    gather_samples_bytes: usize,
    occluders_bytes: usize,
}

impl Parts {
    fn of(transfer: &Transfer) -> Self {
        let (view, cloud, occluders) = (&transfer.view, &transfer.cloud, &transfer.occluders);
        let masks: usize = occluders.masks.masks.iter().map(|mask| size_of_val(&*mask.alpha)).sum();
        Self {
            gather_bytes: transfer.gather.bytes(),
            glossy_bytes: transfer.glossy_bytes(),
            bounce_bytes: transfer.bounce.bytes(),
            interpolation_bytes: transfer.interpolation_bytes(),
            view_samples_bytes: size_of_val(&*view.centers)
                + size_of_val(&*view.quads)
                + size_of_val(&*transfer.receivers_of_centers)
                + size_of_val(&*transfer.receivers_of_quads)
                + view.center_chains.bytes()
                + view.quad_chains.bytes()
                + size_of_val(&*transfer.receivers_of_center_branches)
                + size_of_val(&*transfer.receivers_of_quad_branches),
            gather_samples_bytes: size_of_val(&*cloud.samples)
                + size_of_val(&*cloud.sub_samples)
                + size_of_val(&*cloud.diffuse),
            occluders_bytes: size_of_val(&*occluders.positions) + size_of_val(&*occluders.triangles) + masks,
        }
    }
}

/// Of each operator; `null` in other encodings.
#[derive(Serialize)]
struct Blocks {
    gather: Option<Packed>,
    glossy: Option<Packed>,
    bounce: Option<Packed>,
}

/// Images of wavelet lights in their atlases.
#[derive(Serialize)]
struct Packed {
    blocks: usize,
    atlases: usize,
    /// Texels of the atlases.
    texels: usize,
    /// Those that belong to a block.
    used: usize,
    /// Those of them that stand for zero: of coefficients that their row does not keep, or of no row at all. In `haar-rows` they would
    /// not be stored.
    zeros: usize,
}

impl Blocks {
    fn of(transfer: &Transfer) -> Self {
        let packed = |operator: &Operator| match &operator.matrix {
            Matrix::HaarBlocks(matrix) => Some(Packed {
                blocks: matrix.blocks.len(),
                atlases: matrix.atlases(),
                texels: matrix.texels.len(),
                used: matrix.used_texels(),
                zeros: matrix.zeros(),
            }),
            Matrix::LowRank(_) | Matrix::HaarRows(_) => None,
        };
        Self {
            gather: packed(&transfer.gather),
            glossy: transfer.glossy.as_ref().and_then(packed),
            bounce: packed(&transfer.bounce),
        }
    }
}

impl std::fmt::Display for Packed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let share = |part: usize, whole: usize| percent(part as f64 / whole.max(1) as f64);
        write!(
            f,
            "{} in {}, {} full, {} of it zeros",
            plural(self.blocks, "block", "blocks"),
            plural(self.atlases, "atlas", "atlases"),
            share(self.used, self.texels),
            share(self.zeros, self.used)
        )
    }
}

impl<'a> CacheContents<'a> {
    fn new(path: &'a Path, transfer: &'a Transfer) -> Result<Self> {
        Ok(Self {
            kind: "cache",
            cache: path,
            format_version: FORMAT_VERSION,
            cache_bytes: path.metadata().map_err(|error| Error::io(path, "read", error))?.len(),
            bytes_per_pixel: transfer.bytes_per_pixel(),
            width: transfer.view.width,
            height: transfer.view.height,
            lit_pixels: transfer.lit_pixels(),
            receivers: transfer.gather.rows,
            branches: transfer.view.center_chains.branches.len() + transfer.view.quad_chains.branches.len(),
            gather_samples: transfer.cloud.len(),
            records: transfer.gather.records(),
            sky_samples: transfer.cloud.sky.len(),
            emitters: emitters(transfer.report.named_materials()),
            shown_materials: named_colors(transfer.shown_materials().into_iter().map(|number| NamedColor {
                name: &transfer.report.materials[number as usize],
                base_color: transfer.report.base_colors[number as usize],
            })),
            parts: Parts::of(transfer),
            blocks: Blocks::of(transfer),
            report: &transfer.report,
        })
    }
}

/// The name by which a setting is chosen on the command line.
fn setting_name(setting: impl Serialize) -> String {
    match serde_json::to_value(setting) {
        Ok(serde_json::Value::String(name)) => name,
        _ => "unknown".to_owned(),
    }
}

/// How the bounces were prepared.
fn multibounce(settings: &Settings) -> String {
    let name = setting_name(settings.multibounce);
    if settings.multibounce != Multibounce::Photon {
        return name;
    }
    let photons = settings.photons;
    let path = photons
        .path_length
        .map_or("that end by roulette".to_owned(), |length| format!("of up to {length} hits"));
    format!(
        "{name}: {} photons {path}, {} a row; bounces cannot be told apart, materials keep their colours",
        count(photons.count as u64),
        count(photons.nearest as u64)
    )
}

impl std::fmt::Display for CacheContents<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (report, parts) = (self.report, &self.parts);
        let settings = &report.settings;
        let size = |bytes_of: usize| bytes(bytes_of as u64);
        let mut table = Table::new();
        table.line(
            "scene",
            format!("{}, {} triangles, hash {}", report.scene, count(report.triangles), report.scene_hash),
        );
        table.line(
            "image",
            format!(
                "{}x{}, {} pixels lit, {} receivers",
                self.width,
                self.height,
                count(self.lit_pixels as u64),
                count(self.receivers as u64)
            ),
        );
        if self.branches > 0 {
            let seen = format!("{} view samples", count(self.branches as u64));
            table.line("mirrors and glass", seen);
        }
        table.line(
            "prepared with",
            format!(
                "camera {}, {} gather samples, {}, quality {}, encoding {}, selection {}, rows {}, seed {}",
                settings.camera,
                count(self.gather_samples as u64),
                of_the_sky(self.sky_samples, settings),
                setting_name(settings.quality),
                setting_name(settings.encoding),
                setting_name(settings.selection()),
                setting_name(settings.rows),
                settings.seed
            ),
        );
        let spaced = if settings.spacing > 0.0 {
            format!(", spaced by {} of the distance of what they see", settings.spacing)
        } else {
            String::new()
        };
        table.line("records", format!("{} receivers with a row{spaced}", count(self.records as u64)));
        table.line("multibounce", multibounce(settings));
        if !self.emitters.is_empty() {
            table.line("emitters", quoted(&self.emitters));
        }
        add_materials(&mut table, &self.shown_materials);
        table.line("transfer", format!("{:.1} bytes a pixel", self.bytes_per_pixel));
        for (name, size_in_bytes, blocks) in [
            ("  diffuse gather", parts.gather_bytes, &self.blocks.gather),
            ("  glossy gather", parts.glossy_bytes, &self.blocks.glossy),
            ("  bounces", parts.bounce_bytes, &self.blocks.bounce),
        ] {
            let blocks = blocks.as_ref().map_or(String::new(), |blocks| format!(", {blocks}"));
            table.line(name, format!("{}{blocks}", size(size_in_bytes)));
        }
        if parts.interpolation_bytes > 0 {
            table.line("  interpolation", size(parts.interpolation_bytes));
        }
        table.line("view samples", size(parts.view_samples_bytes));
        table.line("gather samples", size(parts.gather_samples_bytes));
        table.line("triangles and masks", size(parts.occluders_bytes));
        table.line("file", format!("{}, format {}", bytes(self.cache_bytes), self.format_version));
        add_encoding_errors(&mut table, report.gather_error, report.glossy_error, report.bounce_error);
        table.line(
            "rays",
            format!(
                "{:.0} a lit pixel, {:.0} a gather sample",
                report.rays_per_pixel, report.rays_per_gather_sample
            ),
        );
        write!(f, "{table}")
    }
}
