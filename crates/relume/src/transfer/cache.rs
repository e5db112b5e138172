//! The transfer in a file: safetensors, described in `docs/CACHE.md`.
//!
//! One metadata entry, `relume`, holds a JSON [`Header`] (version, report, shapes, a checksum a tensor) and a seal over
//! its text. Everything is checked before anything is used: a file that was cut short, altered, made by
//! another program or by another version is refused with one sentence.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use bytemuck::Pod;
use glam::{Vec2, Vec3};
use memmap2::Mmap;
use rayon::prelude::*;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, Metadata, TensorInfo};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::haar_blocks::HaarBlocks;
use super::haar_rows::HaarRows;
use super::low_rank::LowRank;
use super::packed_runs::PackedRuns;
use super::tensors::Tensors;
use super::{
    Buffer, Encoding, EncodingError, ImageLayout, Interpolation, Matrix, Occluders, Operator, Report,
    Timings, Transfer,
};
use crate::sample::{
    Chains, Emitted, GatherCloud, Receivers, SUB_SAMPLES, SkyCells, ViewGrid, ViewSample, ViewSamples,
};
use crate::scene::{Camera, Wrap};
use crate::trace::{AlphaMask, AlphaMasks};
use crate::{Error, Result, atomic_write};

/// Version of the file format. A file of another version is refused: preparing again takes minutes, guessing at old
/// files costs trust.
pub const FORMAT_VERSION: u32 = 11;

const KEY: &str = "relume";

/// Everything in the file but the arrays.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    version: u32,
    report: Report,
    width: usize,
    height: usize,
    camera: Camera,
    gather: OperatorHeader,
    glossy: Option<OperatorHeader>,
    bounce: OperatorHeader,
    masks: Vec<MaskHeader>,
    /// xxh3 of each tensor's type, shape and bytes, in hexadecimal.
    checksums: BTreeMap<String, String>,
}

/// The header as it stands in the file.
#[derive(Debug, Serialize, Deserialize)]
struct Sealed {
    /// xxh3 of the header's text, in hexadecimal.
    seal: String,
    header: Box<RawValue>,
}

#[derive(Debug, Serialize, Deserialize)]
struct OperatorHeader {
    encoding: Encoding,
    rows: usize,
    /// Coefficients a row of `haar-rows`.
    per_row: usize,
    /// Width and height of the image that `haar-blocks` lays rows in.
    image: [usize; 2],
    expected_error: EncodingError,
}

#[derive(Debug, Serialize, Deserialize)]
struct MaskHeader {
    width: usize,
    height: usize,
    wrap: [Wrap; 2],
    cutoff: f32,
}

/// Emission as (sample, RGB): 16 bytes each.
fn emission_bytes(emission: &[(u32, Vec3)]) -> Vec<[u32; 4]> {
    emission.iter().map(|(index, rgb)| [*index, rgb.x.to_bits(), rgb.y.to_bits(), rgb.z.to_bits()]).collect()
}

fn emission_from(bytes: &[[u32; 4]]) -> Vec<(u32, Vec3)> {
    bytes.iter().map(|&[index, r, g, b]| (index, Vec3::from([r, g, b].map(f32::from_bits)))).collect()
}

impl Transfer {
    /// Writes the transfer to `path`, whole or not at all. The same transfer gives the same bytes.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if self.is_direct_only() {
            return Err(Error::Setting(
                "this transfer has no indirect light yet and cannot be saved".to_owned(),
            ));
        }
        let alpha: Vec<u8> =
            self.occluders.masks.masks.iter().flat_map(|m| m.alpha.iter().copied()).collect();
        let (centers, quads) =
            (emission_bytes(&self.view.center_emission), emission_bytes(&self.view.quad_emission));
        let behind_centers = emission_bytes(&self.view.center_chains.emission);
        let behind_quads = emission_bytes(&self.view.quad_chains.emission);
        let mut tensors = Tensors::default();
        tensors.add("view.centers", Dtype::U8, &[48], &self.view.centers);
        tensors.add("view.quads", Dtype::U8, &[48], &self.view.quads);
        tensors.add("view.center_emission", Dtype::U32, &[4], &centers);
        tensors.add("view.quad_emission", Dtype::U32, &[4], &quads);
        tensors.add("view.receivers_of_centers", Dtype::U32, &[], &self.receivers_of_centers);
        tensors.add("view.receivers_of_quads", Dtype::U32, &[], &self.receivers_of_quads);
        tensors.add_chains("view.center", (&self.view.center_chains, &behind_centers));
        tensors.add_chains("view.quad", (&self.view.quad_chains, &behind_quads));
        tensors.add("view.receivers_of_center_branches", Dtype::U32, &[], &self.receivers_of_center_branches);
        tensors.add("view.receivers_of_quad_branches", Dtype::U32, &[], &self.receivers_of_quad_branches);
        tensors.add("cloud.samples", Dtype::U8, &[64], &self.cloud.samples);
        tensors.add("cloud.sky", Dtype::U32, &[], self.cloud.sky.starts());
        tensors.add("cloud.sub_samples", Dtype::U8, &[24], &self.cloud.sub_samples);
        tensors.add("cloud.diffuse", Dtype::U8, &[10], &self.cloud.diffuse);
        tensors.add("cloud.emitted", Dtype::U8, &[20], &self.cloud.emitted);
        // that of the reflections is the same
        tensors.add_interpolation("gather", &self.gather);
        tensors.add_interpolation("bounce", &self.bounce);
        tensors.add_operator("gather", &self.gather);
        if let Some(glossy) = &self.glossy {
            tensors.add_operator("glossy", glossy);
        }
        tensors.add_operator("bounce", &self.bounce);
        let occluders = &self.occluders;
        tensors.add("occluders.positions", Dtype::F32, &[3], &occluders.positions);
        tensors.add("occluders.triangles", Dtype::U32, &[3], &occluders.triangles);
        tensors.add("masks.triangles", Dtype::U32, &[], &occluders.masks.triangles);
        tensors.add("masks.ids", Dtype::U32, &[], &occluders.masks.mask_ids);
        tensors.add("masks.uvs", Dtype::F32, &[3, 2], &occluders.masks.uvs);
        tensors.add("masks.alpha", Dtype::U8, &[], &alpha);
        let refused = |error| Error::io(path, "write", error);
        let head = self.head(&mut tensors).map_err(|message| refused(std::io::Error::other(message)))?;
        // array after array: all of them in one piece would be the whole cache in memory once more
        let parts = tensors.0.iter().map(|&(.., bytes)| bytes);
        atomic_write(path, |file| {
            std::iter::once(&*head).chain(parts).try_for_each(|part| file.write_all(part)).map_err(refused)
        })
    }

    /// What a file of `tensors` begins with; puts them in the order in which they follow it: that of the library, large elements first, by name.
    fn head(&self, tensors: &mut Tensors<'_>) -> Result<Vec<u8>, String> {
        let checksum = |(name, dtype, shape, bytes): &(String, Dtype, Vec<usize>, &[u8])| {
            (name.clone(), checksum(*dtype, shape, bytes))
        };
        let header = Header {
            version: FORMAT_VERSION,
            report: self.report.clone(),
            width: self.view.width,
            height: self.view.height,
            camera: self.view.camera.clone(),
            gather: OperatorHeader::new(&self.gather),
            glossy: self.glossy.as_ref().map(OperatorHeader::new),
            bounce: OperatorHeader::new(&self.bounce),
            masks: self.occluders.masks.masks.iter().map(MaskHeader::new).collect(),
            checksums: tensors.0.par_iter().map(checksum).collect(),
        };
        let header = serde_json::value::to_raw_value(&header).map_err(|error| error.to_string())?;
        let sealed = Sealed { seal: seal(&header), header };
        let json = serde_json::to_string(&sealed).map_err(|error| error.to_string())?;
        tensors.0.sort_by(|(a, large, ..), (b, larger, ..)| larger.cmp(large).then(a.cmp(b)));
        let mut end = 0;
        let place = |(name, dtype, shape, bytes): &(String, Dtype, Vec<usize>, &[u8])| {
            let data_offsets = (end, end + bytes.len());
            end = data_offsets.1;
            (name.clone(), TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets })
        };
        let places = tensors.0.iter().map(place).collect();
        let metadata = Metadata::new(Some(HashMap::from([(KEY.to_owned(), json)])), places);
        let mut text = serde_json::to_vec(&metadata.map_err(|error| error.to_string())?)
            .map_err(|error| error.to_string())?;
        text.resize(text.len().next_multiple_of(8), b' ');
        Ok([&(text.len() as u64).to_le_bytes()[..], &text].concat())
    }

    /// Opens a file that [`Self::save`] wrote. The operators stay in the mapped file; the rest is read.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::File`] where it is not whole, not ours or of another version.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let unreadable = |error| Error::io(path, "read", error);
        let file = File::open(path).map_err(unreadable)?;
        if !file.metadata().map_err(unreadable)?.is_file() {
            return Err(Error::file(path, "is no file; name a .relume file that `relume prepare` wrote"));
        }
        // SAFETY: the file is opened for reading and never written through the map. Files are replaced by renaming,
        // never changed in place, by this library; a program that truncates one while it is mapped breaks that rule,
        // as it would for every reader of mapped files.
        #[expect(unsafe_code, reason = "mapping a file")]
        let map = Arc::new(unsafe { Mmap::map(&file) }.map_err(unreadable)?);
        Opened::new(path, map)?.transfer()
    }
}

impl OperatorHeader {
    fn new(operator: &Operator) -> Self {
        Self {
            encoding: operator.encoding(),
            rows: operator.records(),
            per_row: match &operator.matrix {
                Matrix::HaarRows(matrix) => matrix.per_row,
                Matrix::LowRank(_) | Matrix::HaarBlocks(_) => 0,
            },
            image: match &operator.matrix {
                Matrix::HaarBlocks(matrix) => [matrix.layout.width, matrix.layout.height],
                Matrix::LowRank(_) | Matrix::HaarRows(_) => [0, 0],
            },
            expected_error: operator.expected_error,
        }
    }
}

impl MaskHeader {
    fn new(mask: &AlphaMask) -> Self {
        Self { width: mask.width, height: mask.height, wrap: mask.wrap, cutoff: mask.cutoff }
    }
}

fn is_light(radiance: Vec3) -> bool {
    radiance.is_finite() && radiance.min_element() >= 0.0
}

fn is_length(value: f32) -> bool {
    value.is_finite() && value >= 0.0
}

/// Of a tensor's type, shape and bytes: one without elements has no other bytes to tell that it was altered.
fn checksum(dtype: Dtype, shape: &[usize], bytes: &[u8]) -> String {
    let mut hash = Xxh3::new();
    hash.update(format!("{dtype:?} {shape:?}").as_bytes());
    hash.update(bytes);
    format!("{:016x}", hash.digest())
}

fn seal(header: &RawValue) -> String {
    format!("{:016x}", xxh3_64(header.get().as_bytes()))
}

/// A file whose header and checksums hold.
struct Opened<'a> {
    path: &'a Path,
    map: Arc<Mmap>,
    header: Header,
    /// First byte and the byte after the last of each tensor.
    places: HashMap<String, (usize, usize)>,
}

impl<'a> Opened<'a> {
    fn new(path: &'a Path, map: Arc<Mmap>) -> Result<Self> {
        const MEND: &str = "prepare the scene again with `relume prepare`";
        let refuse = |message: String| Error::file(path, message);
        let tensors = SafeTensors::deserialize(&map).map_err(|error| {
            refuse(format!(
                "is no whole Relume cache ({error}): it was cut short or is another kind of file; {MEND}"
            ))
        })?;
        let (_, metadata) = SafeTensors::read_metadata(&map)
            .map_err(|error| refuse(format!("has a broken header ({error}); {MEND}")))?;
        let json = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
        let json = json
            .ok_or_else(|| refuse(format!("is a safetensors file, but not one that Relume wrote; {MEND}")))?;
        let altered = |error: String| refuse(format!("has an altered header ({error}); {MEND}"));
        let sealed: Sealed = serde_json::from_str(json).map_err(|error| altered(error.to_string()))?;
        let value: serde_json::Value =
            serde_json::from_str(sealed.header.get()).map_err(|error| altered(error.to_string()))?;
        let version = value["version"].as_u64().unwrap_or(0);
        if version != u64::from(FORMAT_VERSION) {
            return Err(refuse(format!(
                "is a cache of format {version}, and this program reads format {FORMAT_VERSION}; {MEND}"
            )));
        }
        if seal(&sealed.header) != sealed.seal {
            return Err(altered("its seal is broken".into()));
        }
        let header: Header = serde_json::from_value(value).map_err(|error| altered(error.to_string()))?;
        let base = map.as_ptr() as usize;
        let places: HashMap<String, (usize, usize)> = tensors
            .iter()
            .map(|(name, view)| {
                let start = view.data().as_ptr() as usize - base;
                (name.to_owned(), (start, start + view.data().len()))
            })
            .collect();
        let altered = header.checksums.par_iter().find_map_first(|(name, expected)| {
            let sum = tensors.tensor(name).map(|view| checksum(view.dtype(), view.shape(), view.data()));
            (sum.ok().as_ref() != Some(expected)).then(|| name.clone())
        });
        if let Some(name) = altered {
            return Err(refuse(format!("is damaged: the checksum of `{name}` does not match; {MEND}")));
        }
        Ok(Self { path, map: Arc::clone(&map), header, places })
    }

    fn refuse(&self, what: &str) -> Error {
        Error::file(
            self.path,
            format!(
                "is damaged: `{what}` does not fit the rest; prepare the scene again with `relume prepare`"
            ),
        )
    }

    fn buffer<T: Pod>(&self, name: &str) -> Result<Buffer<T>> {
        // only tensors with a checksum are trusted
        let place = self.places.get(name).filter(|_| self.header.checksums.contains_key(name));
        place.and_then(|&place| Buffer::from_map(&self.map, place)).ok_or_else(|| self.refuse(name))
    }

    /// A part of an operator that is packed.
    fn runs(&self, operator: &str, part: &str) -> Result<PackedRuns> {
        let widths = self.buffer(&format!("{operator}.{part}_widths"))?;
        Ok(PackedRuns { widths, bytes: self.buffer(&format!("{operator}.{part}"))? })
    }

    fn values<T: Pod>(&self, name: &str) -> Result<Vec<T>> {
        Ok(self.buffer(name)?.to_vec())
    }

    /// `spread_by` is the operator that holds its interpolation.
    fn operator(
        &self,
        (name, spread_by): (&str, &str),
        header: &OperatorHeader,
        count: usize,
    ) -> Result<Operator> {
        let part = |part: &str| format!("{name}.{part}");
        let matrix = match header.encoding {
            Encoding::LowRank => Matrix::LowRank(LowRank {
                shapes: self.buffer(&part("shapes"))?,
                indices: self.buffer(&part("indices"))?,
                high: self.buffer(&part("high"))?,
                v: self.runs(name, "v")?,
                v_scales: self.buffer(&part("v_scales"))?,
                u: self.runs(name, "u")?,
                u_scales: self.buffer(&part("u_scales"))?,
            }),
            Encoding::HaarRows => Matrix::HaarRows(HaarRows {
                per_row: header.per_row,
                indices: self.buffer(&part("indices"))?,
                high: self.buffer(&part("high"))?,
                values: self.buffer(&part("values"))?,
                scales: self.buffer(&part("scales"))?,
            }),
            Encoding::HaarBlocks => {
                let [width, height] = header.image;
                Matrix::HaarBlocks(HaarBlocks {
                    layout: ImageLayout { width, height, places: self.buffer(&part("places"))? },
                    tiles: self.buffer(&part("tiles"))?,
                    blocks: self.buffer(&part("blocks"))?,
                    texels: self.buffer(&part("texels"))?,
                })
            }
        };
        let weights = (self.buffer(&part("sample_weights"))?, self.buffer(&part("weights"))?);
        let operator = Operator::new(header.rows, matrix, weights, header.expected_error);
        let operator = match self.interpolation(spread_by, header.rows)? {
            Some(interpolation) => operator.interpolated(interpolation),
            None => operator,
        };
        if operator.is_sound(count) { Ok(operator) } else { Err(self.refuse(name)) }
    }

    fn interpolation(&self, name: &str, records: usize) -> Result<Option<Arc<Interpolation>>> {
        let part = |part: &str| format!("{name}.interpolation_{part}");
        if !self.header.checksums.contains_key(&part("runs")) {
            return Ok(None);
        }
        Ok(Some(Arc::new(Interpolation {
            records,
            runs: self.buffer(&part("runs"))?,
            table: self.buffer(&part("table"))?,
            counts: self.buffer(&part("counts"))?,
            shares: self.buffer(&part("shares"))?,
        })))
    }

    fn view(&self) -> Result<ViewSamples> {
        let (width, height) = (self.header.width, self.header.height);
        let view = ViewSamples {
            width,
            height,
            camera: self.header.camera.clone(),
            centers: self.values("view.centers")?,
            quads: self.values("view.quads")?,
            center_emission: emission_from(&self.buffer("view.center_emission")?),
            quad_emission: emission_from(&self.buffer("view.quad_emission")?),
            center_chains: self.chains("view.center")?,
            quad_chains: self.chains("view.quad")?,
        };
        let pixels = width.checked_mul(height);
        let materials = self.header.report.materials.len();
        let known = |sample: &ViewSample| !sample.is_lit() || (sample.material as usize) < materials;
        let fits = pixels == Some(view.centers.len())
            && pixels.and_then(|pixels| pixels.checked_mul(4)) == Some(view.quads.len());
        if !fits || pixels == Some(0) || !view.camera.is_usable() {
            return Err(self.refuse("view"));
        }
        let sound = |grid: ViewGrid<'_>| {
            let ViewGrid { samples, chains: Chains { branches, sky, .. }, .. } = grid;
            let owned = |owner: u32| (owner as usize) < samples.len();
            let emits = |sample: Option<&ViewSample>, radiance: Vec3| {
                sample.is_some_and(|sample| (sample.material as usize) < materials) && is_light(radiance)
            };
            samples.par_iter().all(known)
                && branches.par_iter().all(|branch| known(&branch.sample) && owned(branch.owner))
                && branches.is_sorted_by_key(|branch| branch.owner)
                && branches.iter().all(|branch| branch.eye.is_finite() && is_length(branch.last))
                && branches.iter().all(|branch| is_length(branch.spread) && is_length(branch.width))
                && sky.iter().all(|view| owned(view.owner) && is_light(view.throughput))
                && sky.iter().all(|view| view.direction.is_normalized() && view.origin.is_finite())
                && sky.iter().all(|view| is_length(view.spread) && is_length(view.width))
                && grid.emission.iter().all(|&(index, light)| emits(samples.get(index as usize), light))
                && grid.chains.emission.iter().all(|&(index, light)| {
                    emits(branches.get(index as usize).map(|branch| &branch.sample), light)
                })
        };
        let fits = [1, 2].into_iter().all(|aa| sound(view.grid(aa)));
        if fits { Ok(view) } else { Err(self.refuse("view")) }
    }

    fn chains(&self, name: &str) -> Result<Chains> {
        Ok(Chains {
            branches: self.values(&format!("{name}_branches"))?,
            emission: emission_from(&self.buffer(&format!("{name}_branch_emission"))?),
            sky: self.values(&format!("{name}_sky"))?,
        })
    }

    fn cloud(&self) -> Result<GatherCloud> {
        let cloud = GatherCloud {
            samples: self.values("cloud.samples")?,
            sub_samples: self.values("cloud.sub_samples")?,
            diffuse: self.values("cloud.diffuse")?,
            emitted: self.values("cloud.emitted")?,
            sky: SkyCells::from_starts(self.values("cloud.sky")?).ok_or_else(|| self.refuse("cloud"))?,
        };
        if cloud.sky.len() > cloud.len() {
            return Err(self.refuse("cloud"));
        }
        let materials = self.header.report.materials.len();
        let known = |part: &Emitted| {
            (part.sample as usize) < cloud.len()
                && (part.material as usize) < materials
                && is_light(part.radiance)
        };
        let fits = cloud.len().is_power_of_two()
            && cloud.len().trailing_zeros().is_multiple_of(2)
            && cloud.sub_samples.len() == SUB_SAMPLES * cloud.surfaces().len()
            && cloud.diffuse.len() == cloud.sub_samples.len()
            && cloud.diffuse.iter().all(|part| (part.material() as usize) < materials)
            && cloud.emitted.iter().all(known)
            && cloud.emitted.is_sorted_by(|a, b| {
                a.sample < b.sample || (a.sample == b.sample && a.material != b.material)
            });
        if fits { Ok(cloud) } else { Err(self.refuse("cloud")) }
    }

    fn occluders(&self) -> Result<Occluders> {
        let alpha: Buffer<u8> = self.buffer("masks.alpha")?;
        let mut rest = &alpha[..];
        let mut masks = AlphaMasks {
            masks: Vec::new(),
            triangles: self.values("masks.triangles")?,
            mask_ids: self.values("masks.ids")?,
            uvs: self.values::<[Vec2; 3]>("masks.uvs")?,
        };
        for mask in &self.header.masks {
            let size = mask.width.checked_mul(mask.height).filter(|&size| size > 0 && size <= rest.len());
            let size = size.ok_or_else(|| self.refuse("masks"))?;
            let (alpha, after) = rest.split_at(size);
            rest = after;
            masks.masks.push(AlphaMask {
                width: mask.width,
                height: mask.height,
                alpha: alpha.to_vec(),
                wrap: mask.wrap,
                cutoff: mask.cutoff,
            });
        }
        let (positions, triangles) =
            (self.values("occluders.positions")?, self.values("occluders.triangles")?);
        let occluders = Occluders::new(positions, triangles, masks);
        let (masks, vertices) = (&occluders.masks, occluders.positions.len());
        let fits = occluders.triangles.iter().flatten().all(|&vertex| (vertex as usize) < vertices)
            && masks.triangles.len() == masks.mask_ids.len()
            && masks.triangles.len() == masks.uvs.len()
            && masks.triangles.is_sorted()
            && masks.mask_ids.iter().all(|&id| (id as usize) < masks.masks.len());
        if fits { Ok(occluders) } else { Err(self.refuse("occluders")) }
    }

    fn transfer(self) -> Result<Transfer> {
        let Report { materials, base_colors, .. } = &self.header.report;
        if base_colors.len() != materials.len()
            || !base_colors.iter().flatten().all(|channel| (0.0..=1.0).contains(channel))
        {
            return Err(self.refuse("base_colors"));
        }
        let (view, cloud) = (self.view()?, self.cloud()?);
        let gather = self.operator(("gather", "gather"), &self.header.gather, cloud.len())?;
        let [behind_centers, behind_quads] =
            [&view.center_chains, &view.quad_chains].map(|chains| chains.branches.len());
        if gather.rows > view.centers.len() + view.quads.len() + behind_centers + behind_quads {
            return Err(self.refuse("gather"));
        }
        let glossy = self.header.glossy.as_ref();
        let glossy =
            glossy.map(|header| self.operator(("glossy", "gather"), header, cloud.len())).transpose()?;
        if glossy.as_ref().is_some_and(|glossy| glossy.rows != gather.rows) {
            return Err(self.refuse("glossy"));
        }
        let bounce = self.operator(("bounce", "bounce"), &self.header.bounce, cloud.len())?;
        if bounce.rows != cloud.surfaces().len() {
            return Err(self.refuse("bounce"));
        }
        let receivers = |name: &str, samples: usize| -> Result<Buffer<u32>> {
            let receivers: Buffer<u32> = self.buffer(name)?;
            let known = |&number: &u32| number == Receivers::NONE || (number as usize) < gather.rows;
            let fits = receivers.len() == samples && receivers.iter().all(known);
            if fits { Ok(receivers) } else { Err(self.refuse(name)) }
        };
        let receivers_of_centers = receivers("view.receivers_of_centers", view.centers.len())?;
        let receivers_of_quads = receivers("view.receivers_of_quads", view.quads.len())?;
        let receivers_of_center_branches = receivers("view.receivers_of_center_branches", behind_centers)?;
        let receivers_of_quad_branches = receivers("view.receivers_of_quad_branches", behind_quads)?;
        let occluders = self.occluders()?;
        let report = self.header.report;
        Ok(Transfer {
            report,
            timings: Timings::default(),
            view,
            cloud,
            gather,
            glossy,
            bounce,
            receivers_of_centers,
            receivers_of_quads,
            receivers_of_center_branches,
            receivers_of_quad_branches,
            occluders,
        })
    }
}
