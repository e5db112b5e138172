//! The textures that materials use: each image decoded once, kept once per sampler and colour space.

use std::collections::HashMap;

use ::gltf::json::image::Image;
use ::gltf::json::texture::{MagFilter, Sampler, WrappingMode};
use ::gltf::json::validation::Checked;
use rayon::prelude::*;
use relume::Result;
use relume::scene::{ColorSpace, Texture, Wrap};

use super::document::Document;
use crate::bitmap::{Bitmap, MOST_TEXELS, decode, texel_count};

/// What makes two uses of an image one texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Key {
    image: usize,
    mirror: [bool; 2],
    clamp: [bool; 2],
    srgb: bool,
}

/// A texture to be decoded.
#[derive(Debug)]
struct Request {
    image: usize,
    wrap: [Wrap; 2],
    color_space: ColorSpace,
    /// The first material that asked for it, for messages.
    material: String,
}

/// The textures asked for so far.
#[derive(Debug)]
pub(super) struct Textures<'a> {
    document: &'a Document<'a>,
    requests: Vec<Request>,
    index_of: HashMap<Key, usize>,
    /// Textures that ask not to be filtered.
    nearest: usize,
}

impl<'a> Textures<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self { document, requests: Vec::new(), index_of: HashMap::new(), nearest: 0 }
    }

    /// The scene's index of glTF texture `texture` read as `color_space`.
    pub(super) fn request(
        &mut self,
        texture: usize,
        color_space: ColorSpace,
        material: &str,
    ) -> Result<usize> {
        let root = &self.document.root;
        let missing = || {
            self.document.fail(format!("material `{material}` names texture {texture}, which does not exist"))
        };
        let json = root.textures.get(texture).ok_or_else(missing)?;
        let image = json.source.value();
        let sampler = json.sampler.and_then(|sampler| root.samplers.get(sampler.value()));
        let wrap = sampler.map_or([Wrap::Repeat; 2], wrap_modes);
        let key = Key {
            image,
            mirror: wrap.map(|w| w == Wrap::Mirror),
            clamp: wrap.map(|w| w == Wrap::Clamp),
            srgb: color_space == ColorSpace::Srgb,
        };
        if let Some(&known) = self.index_of.get(&key) {
            return Ok(known);
        }
        self.nearest +=
            usize::from(sampler.is_some_and(|s| s.mag_filter == Some(Checked::Valid(MagFilter::Nearest))));
        self.requests.push(Request { image, wrap, color_space, material: material.to_owned() });
        self.index_of.insert(key, self.requests.len() - 1);
        Ok(self.requests.len() - 1)
    }

    /// Decodes all images asked for, side by side; the first error is the first in the file's order.
    pub(super) fn decode(self, warnings: &mut Vec<String>) -> Result<Vec<Texture>> {
        if self.nearest > 0 {
            warnings.push(format!(
                "{} textures ask for nearest filtering; all are filtered bilinearly",
                self.nearest
            ));
        }
        let mut first_use: Vec<&Request> = Vec::new();
        let mut slot_of: HashMap<usize, usize> = HashMap::new();
        for request in &self.requests {
            slot_of.entry(request.image).or_insert_with(|| {
                first_use.push(request);
                first_use.len() - 1
            });
        }
        let encoded = first_use.iter().map(|request| self.encoded(request)).collect::<Result<Vec<_>>>()?;
        self.check_size(&first_use, &encoded)?;
        let decoded: Vec<_> = encoded.par_iter().map(|bytes| decode(bytes)).collect();
        let bitmaps = decoded
            .into_iter()
            .zip(&first_use)
            .map(|(bitmap, request)| bitmap.map_err(|message| self.image_error(request, &message)))
            .collect::<Result<Vec<_>>>()?;
        Ok(self
            .requests
            .iter()
            .map(|request| self.texture(request, &bitmaps[slot_of[&request.image]]))
            .collect())
    }

    fn texture(&self, request: &Request, bitmap: &Bitmap) -> Texture {
        Texture {
            name: self.image_name(request.image),
            width: bitmap.width,
            height: bitmap.height,
            texels: bitmap.texels.clone(),
            color_space: request.color_space,
            wrap: request.wrap,
        }
    }

    fn image(&self, index: usize) -> Option<&Image> {
        self.document.root.images.get(index)
    }

    /// The image's name, or its file, or its number.
    fn image_name(&self, index: usize) -> String {
        let image = self.image(index);
        image
            .and_then(|image| image.name.clone().filter(|name| !name.is_empty()))
            .or_else(|| image?.uri.clone().filter(|uri| !uri.starts_with("data:")))
            .unwrap_or_else(|| format!("image {index}"))
    }

    fn image_error(&self, request: &Request, message: &str) -> relume::Error {
        let name = self.image_name(request.image);
        self.document.fail(format!("material `{}`, image `{name}`: {message}", request.material))
    }

    /// The bytes of an image file.
    fn encoded(&self, request: &Request) -> Result<Vec<u8>> {
        let read = || -> Result<Vec<u8>, String> {
            let image = self.image(request.image).ok_or("it does not exist")?;
            match (&image.uri, image.buffer_view) {
                (Some(uri), _) => Ok(self.document.read_uri(uri)?.0),
                (None, Some(view)) => Ok(self.document.view(view.value())?.0.to_vec()),
                (None, None) => Err("it has neither a `uri` nor a buffer view".to_owned()),
            }
        };
        read().map_err(|message| self.image_error(request, &message))
    }

    fn check_size(&self, requests: &[&Request], encoded: &[Vec<u8>]) -> Result<()> {
        let mut total = 0_u64;
        for (request, bytes) in requests.iter().zip(encoded) {
            total += texel_count(bytes).map_err(|message| self.image_error(request, &message))?;
        }
        if total > MOST_TEXELS {
            return Err(self.document.fail(format!(
                "has images of {total} texels together, more than {MOST_TEXELS}; scale them down"
            )));
        }
        Ok(())
    }
}

fn wrap_modes(sampler: &Sampler) -> [Wrap; 2] {
    [sampler.wrap_s, sampler.wrap_t].map(|mode| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    })
}
