use std::collections::HashSet;
use std::io::{Cursor, Write};
use std::path::Path;

use exr::error::Error as ExrError;
use exr::image::write::WritableImage;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image as ExrFile, Layer};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Chromaticities, LineOrder, Text};
use exr::meta::header::LayerAttributes;
use half::f16;
use relume::image::{Image, Layers};
use relume::{Error, Result, atomic_write};

use super::header::sort_attributes;
use super::{Attribute, DIRECT, EDGES, ExrMeta, INDIRECT, NOISE, Precision, SOFTWARE};

/// Writes every layer of a frame; see the [module](super) for the channels. The file appears whole or not at
/// all.
///
/// In channel names, characters of light names other than ASCII letters, digits, `_` and `-` become `_`, and
/// a number is added where two lights would share one.
///
/// # Errors
/// [`Error::Setting`] for layers of different sizes, a value that is not finite (its layer and pixel are
/// named) or an attribute that cannot be written; otherwise as [`atomic_write`].
pub fn write_exr(path: impl AsRef<Path>, layers: &Layers, meta: &ExrMeta) -> Result<()> {
    let size = (layers.direct.width, layers.direct.height);
    let mut channels = Channels { size, precision: meta.precision, list: Vec::new() };
    // The parts first: a sum of images of two sizes would be wrong, not refused.
    channels.add_image(DIRECT, &layers.direct)?;
    channels.add_image(INDIRECT, &layers.indirect)?;
    channels.add_image("", &layers.full())?;
    let names = channel_names(layers.per_light.iter().map(|light| light.name.as_str()));
    for (light, name) in layers.per_light.iter().zip(names) {
        channels.add_image(&format!("{name}.{DIRECT}"), &light.direct)?;
        channels.add_image(&format!("{name}.{INDIRECT}"), &light.indirect)?;
    }
    if let Some(noise) = &layers.noise {
        channels.add_image(NOISE, noise)?;
    }
    if !layers.edges.is_empty() {
        channels.add_edges(&layers.edges)?;
    }
    write_channels(path.as_ref(), channels, &meta.attributes)
}

/// Writes `R G B` alone.
///
/// # Errors
/// As [`write_exr`].
pub fn write_exr_image(path: impl AsRef<Path>, image: &Image, meta: &ExrMeta) -> Result<()> {
    let size = (image.width, image.height);
    let mut channels = Channels { size, precision: meta.precision, list: Vec::new() };
    channels.add_image("", image)?;
    write_channels(path.as_ref(), channels, &meta.attributes)
}

struct Channels {
    size: (usize, usize),
    precision: Precision,
    list: Vec<AnyChannel<FlatSamples>>,
}

impl Channels {
    fn pixel_count(&self) -> usize {
        self.size.0.saturating_mul(self.size.1)
    }

    /// Adds `layer.R/G/B`, or `R/G/B` where `layer` is empty.
    fn add_image(&mut self, layer: &str, image: &Image) -> Result<()> {
        let shown = if layer.is_empty() { "full image" } else { layer };
        if (image.width, image.height) != self.size || image.pixels.len() != self.pixel_count() {
            return Err(Error::Setting(format!(
                "layer `{shown}` is {}x{} with {} pixels in a frame of {}x{}",
                image.width,
                image.height,
                image.pixels.len(),
                self.size.0,
                self.size.1
            )));
        }
        if let Some(pixel) = image.pixels.iter().position(|color| !color.is_finite()) {
            return Err(Error::Setting(format!(
                "layer `{shown}` has the value {} at column {}, row {}; it was not written",
                image.pixels[pixel],
                pixel % image.width,
                pixel / image.width
            )));
        }
        for (channel, letter) in ["R", "G", "B"].into_iter().enumerate() {
            let name = if layer.is_empty() { letter.to_owned() } else { format!("{layer}.{letter}") };
            let values = image.pixels.iter().map(|color| color[channel]);
            let samples = match self.precision {
                Precision::Half => FlatSamples::F16(values.map(half).collect()),
                Precision::Float => FlatSamples::F32(values.collect()),
            };
            self.add(&name, samples);
        }
        Ok(())
    }

    fn add_edges(&mut self, edges: &[bool]) -> Result<()> {
        if edges.len() != self.pixel_count() {
            return Err(Error::Setting(format!(
                "{} edge marks in a frame of {}x{}",
                edges.len(),
                self.size.0,
                self.size.1
            )));
        }
        let samples = edges.iter().map(|&edge| if edge { f16::ONE } else { f16::ZERO }).collect();
        self.add(EDGES, FlatSamples::F16(samples));
        Ok(())
    }

    fn add(&mut self, name: &str, sample_data: FlatSamples) {
        let name = text(name);
        self.list.push(AnyChannel { name, sample_data, quantize_linearly: false, sampling: Vec2(1, 1) });
    }
}

/// The nearest half; what is beyond the largest becomes the largest instead of infinity.
fn half(value: f32) -> f16 {
    f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

/// UTF-8 in the bytes of an EXR text.
fn text(text: &str) -> Text {
    Text::from_slice_unchecked(text.as_bytes())
}

/// A name for each light that EXR and every compositing program takes, all different.
fn channel_names<'n>(lights: impl Iterator<Item = &'n str>) -> Vec<String> {
    /// Channel names end at 255 characters; this leaves room for number, layer and letter.
    const LONGEST: usize = 200;
    let mut taken = HashSet::new();
    lights
        .map(|name| {
            let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
            let mut plain: String = name.chars().take(LONGEST).map(plain).collect();
            if plain.is_empty() {
                plain.push_str("light");
            }
            let numbered = (2_usize..).map(|number| format!("{plain}_{number}"));
            let mut candidates = std::iter::once(plain.clone()).chain(numbered);
            let unique = candidates.find(|candidate| !taken.contains(candidate)).unwrap_or(plain);
            taken.insert(unique.clone());
            unique
        })
        .collect()
}

fn write_channels(path: &Path, channels: Channels, attributes: &[(String, Attribute)]) -> Result<()> {
    let (width, height) = channels.size;
    if width == 0 || height == 0 || width.max(height) > i32::MAX as usize / 2 {
        return Err(Error::Setting(format!("an image of {width}x{height} pixels cannot be written as EXR")));
    }
    let encoding = Encoding {
        compression: exr::compression::Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let list = AnyChannels::sort(channels.list.into());
    let mut file =
        ExrFile::from_layer(Layer::new((width, height), layer_attributes(attributes)?, encoding, list));
    file.attributes.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.3, 0.6),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.329),
    });
    let mut bytes = Vec::new();
    file.write().to_buffered(Cursor::new(&mut bytes)).map_err(|error| refused(path, error))?;
    sort_attributes(&mut bytes);
    atomic_write(path, |file| file.write_all(&bytes).map_err(|error| Error::io(path, "write", error)))
}

fn layer_attributes(attributes: &[(String, Attribute)]) -> Result<LayerAttributes> {
    let software = concat!("Relume ", env!("CARGO_PKG_VERSION"));
    let mut header = LayerAttributes { software_name: Some(text(software)), ..Default::default() };
    for (name, value) in attributes {
        let plain = |c: char| c.is_ascii_alphanumeric() || "_.:-".contains(c);
        if name.is_empty() || name.len() > 255 || !name.chars().all(plain) || name == SOFTWARE {
            return Err(Error::Setting(format!(
                "`{name}` cannot name an EXR attribute; use ASCII letters, digits and _.:- only, and not `{SOFTWARE}`"
            )));
        }
        let value = match value {
            Attribute::Number(number) => AttributeValue::F64(*number),
            Attribute::Text(value) => AttributeValue::Text(text(value)),
        };
        if header.other.insert(text(name), value).is_some() {
            return Err(Error::Setting(format!("the EXR attribute `{name}` is given twice")));
        }
    }
    Ok(header)
}

fn refused(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "write", error),
        ExrError::Invalid(message) | ExrError::NotSupported(message) => {
            Error::Setting(format!("{} cannot be written as EXR: {message}", path.display()))
        }
        ExrError::Aborted => Error::Cancelled,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_names_become_channel_names_that_differ() {
        let lights = ["key", "key.left", "key left", "key_left", "", "lämpchen", "light"];
        let expected = ["key", "key_left", "key_left_2", "key_left_3", "light", "l_mpchen", "light_2"];
        assert_eq!(channel_names(lights.into_iter()), expected);
        let long = ["x".repeat(300), "x".repeat(301)];
        let names = channel_names(long.iter().map(String::as_str));
        assert!(names[0] != names[1] && names.iter().all(|name| name.len() < 240));
    }

    #[test]
    fn halves_end_at_the_largest() {
        assert_eq!(half(1e30), f16::MAX);
        assert_eq!(half(-65_519.0), f16::MIN);
        assert_eq!(half(0.1).to_f32(), 0.099_975_586);
    }
}
