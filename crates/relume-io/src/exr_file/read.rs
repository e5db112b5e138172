use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::error::Error as ExrError;
use exr::image::read::image::ReadLayers;
use exr::image::read::layers::ReadChannels;
use exr::image::read::read;
use exr::image::{AnyChannel, AnyChannels, FlatImage, FlatSamples, Layer};
use exr::meta::attribute::{AttributeValue, SampleType, Text};
use exr::meta::header::Header;
use relume::glam::Vec3;
use relume::image::{Image, LightLayers};
use relume::{Error, Result};

use super::{Attribute, DIRECT, EDGES, ExrImage, INDIRECT, NOISE, SOFTWARE};

/// Reads an EXR file of Relume or of any other program that holds channels `R`, `G` and `B`: scan lines or
/// tiles, any number of parts, half, float and integer channels. The data window is the image, wherever it
/// stands in the display window.
///
/// # Errors
/// [`Error::File`] in one sentence for a file that is cut short, altered, too large to be meant, or without
/// `R G B`; [`Error::Io`] where the system refuses to read it.
pub fn read_exr(path: impl AsRef<Path>) -> Result<ExrImage> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|error| Error::io(path, "read", error))?;
    let file_bytes = file.metadata().map_err(|error| Error::io(path, "read", error))?.len();
    let chunks = exr::block::read(BufReader::new(file), false).map_err(|error| refused(path, error))?;
    check_sizes(path, chunks.headers(), file_bytes)?;
    let exr = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_chunks(chunks)
        .map_err(|error| refused(path, error))?;
    collect(&Channels { path, parts: &exr.layer_data }, &exr)
}

fn refused(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "read", error),
        ExrError::NotSupported(feature) => Error::file(
            path,
            format!("uses an EXR feature Relume does not read ({feature}); save it as flat scan lines"),
        ),
        ExrError::Invalid(what) => {
            Error::file(path, format!("is no EXR file, cut short or altered ({what}); write it again"))
        }
        ExrError::Aborted => Error::Cancelled,
    }
}

/// Refuses a header that asks for more memory than its file can have pixels for.
fn check_sizes(path: &Path, headers: &[Header], file_bytes: u64) -> Result<()> {
    /// No EXR compression packs a rendered image tighter.
    const LARGEST_RATIO: u64 = 4096;
    const ALWAYS_ALLOWED: u64 = 64 << 20;
    let bytes = headers.iter().map(|header| {
        let pixels = (header.layer_size.width() as u64).saturating_mul(header.layer_size.height() as u64);
        let sample = |sample_type| if sample_type == SampleType::F16 { 2 } else { 4 };
        let pixel: u64 = header.channels.list.iter().map(|channel| sample(channel.sample_type)).sum();
        pixels.saturating_mul(pixel)
    });
    let bytes = bytes.fold(0_u64, u64::saturating_add);
    if bytes > ALWAYS_ALLOWED.max(file_bytes.saturating_mul(LARGEST_RATIO)) {
        return Err(Error::file(
            path,
            format!(
                "is altered: its header asks for {bytes} bytes of pixels, the file has {file_bytes}; write it again"
            ),
        ));
    }
    Ok(())
}

type Part = Layer<AnyChannels<FlatSamples>>;

/// All channels of all parts by name.
struct Channels<'f> {
    path: &'f Path,
    parts: &'f [Part],
}

fn utf8(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

/// True where `channel` of `part` is what `name` asks for. Parts may carry the layer as their own name.
fn is_named(part: &Part, channel: &AnyChannel<FlatSamples>, name: &str) -> bool {
    let written = channel.name.as_slice();
    let by_part = || {
        let part = part.attributes.layer_name.as_ref()?.as_slice();
        let rest = name.as_bytes().strip_prefix(part)?.strip_prefix(b".")?;
        Some(rest == written)
    };
    written == name.as_bytes() || by_part() == Some(true)
}

impl Channels<'_> {
    /// The channels called `names` of the first part that has them all.
    fn find<const N: usize>(&self, names: [&str; N]) -> Option<(&Part, [&AnyChannel<FlatSamples>; N])> {
        self.parts.iter().find_map(|part| {
            let channel = |name| part.channel_data.list.iter().find(|channel| is_named(part, channel, name));
            let found: Vec<_> = names.into_iter().map_while(channel).collect();
            Some((part, found.try_into().ok()?))
        })
    }

    /// The layer as an image, `None` where the file has no such layer.
    fn image(&self, layer: &str) -> Result<Option<Image>> {
        let dot = if layer.is_empty() { "" } else { "." };
        let names = ["R", "G", "B"].map(|letter| format!("{layer}{dot}{letter}"));
        let Some((part, channels)) = self.find(names.each_ref().map(String::as_str)) else { return Ok(None) };
        let (width, height) = (part.size.width(), part.size.height());
        let mut pixels = vec![Vec3::ZERO; width * height];
        for (index, channel) in channels.into_iter().enumerate() {
            self.check_length(channel, pixels.len())?;
            for (pixel, value) in pixels.iter_mut().zip(channel.sample_data.values_as_f32()) {
                pixel[index] = value;
            }
        }
        Ok(Some(Image { width, height, pixels }))
    }

    fn check_length(&self, channel: &AnyChannel<FlatSamples>, pixels: usize) -> Result<()> {
        if channel.sample_data.len() == pixels {
            return Ok(());
        }
        let name = utf8(&channel.name);
        Err(Error::file(
            self.path,
            format!("channel `{name}` is subsampled; save it with one value for each pixel"),
        ))
    }

    /// An optional layer, which must be of the size of the full image.
    fn layer(&self, layer: &str, full: &Image) -> Result<Option<Image>> {
        let image = self.image(layer)?;
        match &image {
            Some(image) if (image.width, image.height) != (full.width, full.height) => Err(Error::file(
                self.path,
                format!(
                    "layer `{layer}` is {}x{}, but the image {}x{}; write it again",
                    image.width, image.height, full.width, full.height
                ),
            )),
            _ => Ok(image),
        }
    }

    fn edges(&self, full: &Image) -> Result<Option<Vec<bool>>> {
        let Some((_, [channel])) = self.find([EDGES]) else { return Ok(None) };
        self.check_length(channel, full.pixels.len())?;
        Ok(Some(channel.sample_data.values_as_f32().map(|value| value > 0.5).collect()))
    }

    fn per_light(&self, full: &Image) -> Result<Vec<LightLayers>> {
        let suffix = format!(".{DIRECT}.R");
        let mut lights = Vec::new();
        for channel in self.parts.iter().flat_map(|part| &part.channel_data.list) {
            let channel = utf8(&channel.name);
            let Some(name) = channel.strip_suffix(&suffix) else { continue };
            let direct = self.layer(&format!("{name}.{DIRECT}"), full)?;
            let indirect = self.layer(&format!("{name}.{INDIRECT}"), full)?;
            if let (Some(direct), Some(indirect)) = (direct, indirect) {
                lights.push(LightLayers { name: name.to_owned(), direct, indirect });
            }
        }
        Ok(lights)
    }

    fn names(&self) -> String {
        let channels = self.parts.iter().flat_map(|part| &part.channel_data.list);
        let names: Vec<_> = channels.take(12).map(|channel| utf8(&channel.name)).collect();
        names.join(", ")
    }
}

fn collect(channels: &Channels<'_>, exr: &FlatImage) -> Result<ExrImage> {
    let Some(image) = channels.image("")? else {
        return Err(Error::file(
            channels.path,
            format!("has no channels R, G and B in one part (it has {}); save it as RGB", channels.names()),
        ));
    };
    Ok(ExrImage {
        direct: channels.layer(DIRECT, &image)?,
        indirect: channels.layer(INDIRECT, &image)?,
        per_light: channels.per_light(&image)?,
        edges: channels.edges(&image)?,
        noise: channels.layer(NOISE, &image)?,
        attributes: attributes(exr),
        image,
    })
}

fn attributes(exr: &FlatImage) -> Vec<(String, Attribute)> {
    let part = exr.layer_data.first().map(|part| &part.attributes);
    let others = exr.attributes.other.iter().chain(part.into_iter().flat_map(|part| &part.other));
    let mut attributes: Vec<_> =
        others.filter_map(|(name, value)| Some((utf8(name), attribute(value)?))).collect();
    if let Some(software) = part.and_then(|part| part.software_name.as_ref()) {
        attributes.push((SOFTWARE.to_owned(), Attribute::Text(utf8(software))));
    }
    attributes.sort_by(|a, b| a.0.cmp(&b.0));
    attributes
}

fn attribute(value: &AttributeValue) -> Option<Attribute> {
    match value {
        AttributeValue::F64(number) => Some(Attribute::Number(*number)),
        AttributeValue::F32(number) => Some(Attribute::Number(f64::from(*number))),
        AttributeValue::I32(number) => Some(Attribute::Number(f64::from(*number))),
        AttributeValue::Text(text) => Some(Attribute::Text(utf8(text))),
        _ => None,
    }
}
