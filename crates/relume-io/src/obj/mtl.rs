//! MTL materials as metallic-roughness ones.
//!
//! - `Kd` and `map_Kd` are the base colour, `Kd` taken as linear;
//! - `Ns` n becomes the perceptual roughness `(2 / (n + 2))^(1/4)`, the GGX lobe as wide as Phong's (Walter et al. 2007,
//!   section 5.2: `alpha = sqrt(2 / (n + 2))`, and glTF's roughness is its root); `Pr` and `Pm` go before it;
//! - `Ks` is left out: every surface is a dielectric with 4% reflectance unless `Pm` says metal;
//! - `Ke` and `map_Ke` are the emitted radiance;
//! - `d` (or `Tr`) and `map_d` cut out where they are below 0.5;
//! - `norm` is a normal map; height maps (`bump`) are left out;
//! - surfaces are two-sided, since MTL cannot say otherwise.

use std::collections::{HashMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use relume::glam::{Affine2, Vec2, Vec3};
use relume::scene::{AlphaMode, ColorSpace, Material, Texture, TextureRef, Wrap};
use relume::{Error, Result};

use super::{check, relative, text_of};
use crate::bitmap::{Bitmap, MOST_TEXELS, decode};
use crate::import::read_file;

/// Below this alpha a surface is cut out.
const CUTOFF: f32 = 0.5;

/// The material libraries of an OBJ file and what was found wrong with them.
#[derive(Debug)]
pub(super) struct Library<'a> {
    folder: &'a Path,
    pub(super) warnings: Vec<String>,
    failed: Option<Error>,
    /// Libraries already read: a file may name one again and again.
    read: HashSet<PathBuf>,
    textures: Vec<Texture>,
    texture_of: HashMap<TextureKey, usize>,
}

/// What makes two uses of files one texture.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct TextureKey {
    color: Option<PathBuf>,
    alpha: Option<PathBuf>,
    srgb: bool,
    clamp: bool,
}

/// A `map_` statement: the file and its options.
#[derive(Clone, Debug, PartialEq)]
struct Map {
    file: PathBuf,
    texture_from_mesh: Affine2,
    clamp: bool,
}

impl<'a> Library<'a> {
    pub(super) fn new(folder: &'a Path) -> Self {
        Self {
            folder,
            warnings: Vec::new(),
            failed: None,
            read: HashSet::new(),
            textures: Vec::new(),
            texture_of: HashMap::new(),
        }
    }

    /// Reads one library. A missing one is a warning; a malformed one fails [`Self::convert`].
    pub(super) fn read(&mut self, name: &Path) -> tobj::MTLLoadResult {
        let path = relative(self.folder, &name.to_string_lossy());
        if !self.read.insert(path.clone()) {
            return Ok(Default::default());
        }
        let text = match text_of(&path) {
            Ok(text) => text,
            Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
                let shown = path.display();
                self.warnings
                    .push(format!("the material library {shown} is missing; its materials are grey"));
                return Err(tobj::LoadError::OpenFileFailed);
            }
            Err(error) => {
                self.failed.get_or_insert(error);
                return Err(tobj::LoadError::OpenFileFailed);
            }
        };
        let text = check::prepare_mtl(&text, &mut self.warnings);
        let result = tobj::load_mtl_buf(&mut text.as_bytes());
        if let Err(error) = &result {
            let message = format!("cannot be read as MTL: {error}; mend it");
            self.failed.get_or_insert(Error::file(&path, message));
        }
        result
    }

    /// All materials in the libraries' order, and a grey one at the end where `grey` asks for it.
    pub(super) fn convert(
        &mut self,
        materials: &[tobj::Material],
        grey: bool,
    ) -> Result<(Vec<Material>, Vec<Texture>)> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        let mut converted = materials.iter().map(|mtl| self.material(mtl)).collect::<Result<Vec<_>>>()?;
        if grey {
            converted.push(Material {
                name: "grey".to_owned(),
                base_color: Vec3::splat(0.5).extend(1.0),
                double_sided: true,
                ..Material::default()
            });
        }
        Ok((converted, std::mem::take(&mut self.textures)))
    }

    /// For messages: the library, or the folder where there are several.
    fn blamed(&self) -> &Path {
        match self.read.iter().next() {
            Some(only) if self.read.len() == 1 => only,
            _ => self.folder,
        }
    }

    fn material(&mut self, mtl: &tobj::Material) -> Result<Material> {
        let fail = |what: &str| {
            Error::file(
                self.blamed(),
                format!("MTL material `{}`: {what} is negative or not a finite number", mtl.name),
            )
        };
        let extra = |key: &str| mtl.unknown_param.get(key).map(String::as_str);
        let number = |key: &str| -> Result<Option<f32>> {
            let value: Option<f32> = extra(key).map(str::parse).transpose().map_err(|_| fail(key))?;
            checked(value.as_slice()).then_some(value).ok_or_else(|| fail(key))
        };
        let diffuse = mtl.diffuse.unwrap_or([if mtl.diffuse_texture.is_some() { 1.0 } else { 0.5 }; 3]);
        let emission_map = extra("map_Ke");
        let emission = mtl.emissive.unwrap_or([if emission_map.is_some() { 1.0 } else { 0.0 }; 3]);
        let shininess = mtl.shininess;
        if !(checked(&diffuse) && checked(&emission) && checked(shininess.as_slice())) {
            return Err(fail("Kd, Ke or Ns"));
        }
        let roughness = number("Pr")?.or(shininess.map(|n| (2.0 / (n + 2.0)).powf(0.25)));
        let metallic = number("Pm")?.unwrap_or(0.0);
        let opacity = mtl.dissolve.or(number("Tr")?.map(|tr| 1.0 - tr)).unwrap_or(1.0);
        if !opacity.is_finite() {
            return Err(fail("d"));
        }
        let masked = opacity < 1.0 || mtl.dissolve_texture.is_some();
        if opacity < 1.0 {
            self.warnings.push(format!(
                "MTL material `{}` is transparent; it is cut out where its opacity is below {CUTOFF}",
                mtl.name
            ));
        }
        if mtl.normal_texture.is_some() {
            self.warnings.push(format!("MTL material `{}` has a height map, which is left out", mtl.name));
        }
        let [color, alpha] =
            [&mtl.diffuse_texture, &mtl.dissolve_texture].map(|map| map.as_deref().map(|m| self.map(m)));
        let [emissive, normal] = [emission_map, extra("norm")].map(|map| map.map(|m| self.map(m)));
        Ok(Material {
            name: mtl.name.clone(),
            base_color: Vec3::from_array(diffuse).min(Vec3::ONE).extend(opacity.clamp(0.0, 1.0)),
            base_color_texture: self.texture(&mtl.name, color, alpha, ColorSpace::Srgb)?,
            metallic: metallic.min(1.0),
            roughness: roughness.unwrap_or(1.0).min(1.0),
            normal_texture: self.texture(&mtl.name, normal, None, ColorSpace::Linear)?,
            emission: Vec3::from_array(emission),
            emission_texture: self.texture(&mtl.name, emissive, None, ColorSpace::Srgb)?,
            alpha_mode: if masked { AlphaMode::Mask { cutoff: CUTOFF } } else { AlphaMode::Opaque },
            double_sided: true,
            ..Material::default()
        })
    }

    /// Reads `[options] file`: `-s` and `-o` scale and move, `-clamp on` clamps, all others are passed over.
    fn map(&self, statement: &str) -> Map {
        let words: Vec<&str> = statement.split_whitespace().collect();
        let (mut scale, mut offset, mut clamp) = (Vec2::ONE, Vec2::ZERO, false);
        let mut rest = 0;
        while let Some(option) = words.get(rest).filter(|word| word.starts_with('-')) {
            let arguments = &words[rest + 1..];
            let numbers: Vec<f32> = arguments.iter().take(3).map_while(|word| word.parse().ok()).collect();
            let pair = |default: f32| {
                let at = |i: usize| numbers.get(i).copied().filter(|n| n.is_finite()).unwrap_or(default);
                Vec2::new(at(0), at(1))
            };
            rest += 1 + match *option {
                "-s" => {
                    scale = pair(1.0);
                    numbers.len()
                }
                "-o" => {
                    offset = pair(0.0);
                    numbers.len()
                }
                "-t" => numbers.len(),
                "-mm" => 2,
                "-clamp" => {
                    clamp = arguments.first() == Some(&"on");
                    1
                }
                "-blendu" | "-blendv" | "-cc" | "-bm" | "-boost" | "-texres" | "-imfchan" | "-type" => 1,
                _ => break,
            };
        }
        let file = relative(self.folder, &words.get(rest..).unwrap_or_default().join(" "));
        // MTL's v points up: v' = s v + o there is 1 - v' = s (1 - v) + o with v downwards.
        let translation = Vec2::new(offset.x, 1.0 - scale.y - offset.y);
        let texture_from_mesh =
            Affine2::from_cols(Vec2::new(scale.x, 0.0), Vec2::new(0.0, scale.y), translation);
        Map { file, texture_from_mesh, clamp }
    }

    /// The texture of a colour map, its alpha replaced by a second map where there is one.
    fn texture(
        &mut self,
        material: &str,
        color: Option<Map>,
        alpha: Option<Map>,
        color_space: ColorSpace,
    ) -> Result<Option<TextureRef>> {
        let Some(first) = color.as_ref().or(alpha.as_ref()) else { return Ok(None) };
        let key = TextureKey {
            color: color.as_ref().map(|map| map.file.clone()),
            alpha: alpha.as_ref().map(|map| map.file.clone()),
            srgb: color_space == ColorSpace::Srgb,
            clamp: first.clamp,
        };
        let texture = match self.texture_of.get(&key) {
            Some(&known) => known,
            None => {
                let bitmap = combined(material, key.color.as_deref(), key.alpha.as_deref())?;
                let Bitmap { width, height, texels } = bitmap;
                let total: usize = self.textures.iter().map(|texture| texture.texels.len()).sum();
                if (total + texels.len()) as u64 > MOST_TEXELS {
                    let message = format!(
                        "has more than {MOST_TEXELS} texels with the textures before it; scale them down"
                    );
                    return Err(Error::file(&first.file, message));
                }
                let name =
                    first.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                let wrap = [if first.clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
                self.textures.push(Texture { name, width, height, texels, color_space, wrap });
                self.texture_of.insert(key, self.textures.len() - 1);
                self.textures.len() - 1
            }
        };
        Ok(Some(TextureRef { texture, texture_from_mesh: first.texture_from_mesh }))
    }
}

/// Finite and not negative.
fn checked(numbers: &[f32]) -> bool {
    numbers.iter().all(|n| n.is_finite() && *n >= 0.0)
}

fn bitmap(material: &str, file: &Path) -> Result<Bitmap> {
    let needed = |error: &dyn std::fmt::Display| {
        Error::file(file, format!("{error}; MTL material `{material}` needs it"))
    };
    let bytes = read_file(file).map_err(|error| match error {
        Error::Io { source, .. } => needed(&format!("cannot read: {source}")),
        other => other,
    })?;
    decode(&bytes).map_err(|message| needed(&message))
}

/// Colour from one file (white without one) and alpha from another (opaque without one), at the colour's size.
fn combined(material: &str, color: Option<&Path>, alpha: Option<&Path>) -> Result<Bitmap> {
    let Some(alpha) = alpha else {
        let mut bitmap = color.map_or_else(
            || Ok(Bitmap { width: 1, height: 1, texels: vec![[255; 4]] }),
            |file| bitmap(material, file),
        )?;
        bitmap.texels.iter_mut().for_each(|texel| texel[3] = 255);
        return Ok(bitmap);
    };
    let mask = bitmap(material, alpha)?;
    let from_alpha = mask.texels.iter().any(|texel| texel[3] != 255);
    let opacity = |[r, g, b, a]: [u8; 4]| {
        if from_alpha { a } else { ((u16::from(r) + u16::from(g) + u16::from(b)) / 3) as u8 }
    };
    let mut result = match color {
        Some(file) => bitmap(material, file)?,
        None => Bitmap { texels: vec![[255; 4]; mask.texels.len()], ..mask },
    };
    let (width, height) = (result.width, result.height);
    for (i, texel) in result.texels.iter_mut().enumerate() {
        let column = (i % width) * mask.width / width;
        let row = (i / width) * mask.height / height;
        texel[3] = opacity(mask.texels[row * mask.width + column]);
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_options_are_read() {
        let library = Library::new(Path::new("d"));
        let plain = library.map("a b.png");
        assert_eq!(
            plain,
            Map { file: "d/a b.png".into(), texture_from_mesh: Affine2::IDENTITY, clamp: false }
        );
        let map = library.map("-s 2 4 1 -bm 0.5 -o 0.25 0.5 -clamp on tex\\x.png");
        assert_eq!(map.file, PathBuf::from("d/tex/x.png"));
        assert!(map.clamp);
        // v = 0.75 downwards is 0.25 upwards: 4 * 0.25 + 0.5 = 1.5 upwards is -0.5 downwards.
        let uv = map.texture_from_mesh.transform_point2(Vec2::new(0.5, 0.75));
        assert_eq!(uv, Vec2::new(1.25, -0.5));
        assert_eq!(library.map("-s").file, PathBuf::from("d/"));
    }
}
