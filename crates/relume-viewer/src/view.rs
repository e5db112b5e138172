//! What of the light is shown.

use std::sync::Arc;

use relume::glam::Vec3;
use relume::image::Image;

use crate::lighting::Frame;

/// Something to show in the picture, or in one half of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum View {
    /// All light.
    #[default]
    Full,
    /// Light straight from lights, and what surfaces emit.
    Direct,
    /// Light that met another surface on its way.
    Indirect,
    /// One light alone, direct and indirect, by its name.
    Light(String),
    /// Diffuse albedo.
    Albedo,
    /// Shading normals.
    Normals,
    /// Distance from the camera.
    Depth,
    /// Luminance in stops, as colours.
    Luminance,
    /// The path-traced picture.
    Reference,
    /// A stored picture, by its number.
    Snapshot(u64),
}

/// Views that need no further word, in the order of their menu.
pub(crate) const PLAIN: [View; 8] = [
    View::Full,
    View::Direct,
    View::Indirect,
    View::Albedo,
    View::Normals,
    View::Depth,
    View::Luminance,
    View::Reference,
];

impl View {
    /// Its name in menus.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Full => "Full".to_owned(),
            Self::Direct => "Direct".to_owned(),
            Self::Indirect => "Indirect".to_owned(),
            Self::Light(name) => format!("Light {name}"),
            Self::Albedo => "Albedo".to_owned(),
            Self::Normals => "Normals".to_owned(),
            Self::Depth => "Depth".to_owned(),
            Self::Luminance => "Luminance".to_owned(),
            Self::Reference => "Reference".to_owned(),
            Self::Snapshot(number) => format!("Snapshot {number}"),
        }
    }

    /// What it shows, for its tooltip.
    pub(crate) fn explanation(&self) -> &'static str {
        match self {
            Self::Full => "All light, as the camera sees it",
            Self::Direct => "Light straight from the lights, and what surfaces emit",
            Self::Indirect => "Light that met another surface on its way",
            Self::Light(_) => "One light alone, direct and indirect",
            Self::Albedo => "Diffuse albedo, with edited base colours",
            Self::Normals => "Normals that light is shaded by: red is +X, green +Y, blue +Z",
            Self::Depth => "Distance from the camera; near is bright",
            Self::Luminance => {
                "How many stops each pixel is above or below middle grey (18%), with the exposure"
            }
            Self::Reference => "The path-traced picture, which is refined while you look at it",
            Self::Snapshot(_) => "A picture that was stored earlier",
        }
    }
}

/// An image to develop, and how.
#[derive(Clone)]
pub(crate) struct Source {
    pub(crate) light: LightOf,
    pub(crate) scale: Scale,
}

/// Where an image comes from.
#[derive(Clone)]
pub(crate) enum LightOf {
    Full(Arc<Frame>),
    Direct(Arc<Frame>),
    Indirect(Arc<Frame>),
    Light(Arc<Frame>, String),
    Albedo(Arc<Frame>),
    Normals(Arc<Frame>),
    Depth(Arc<Frame>),
    Image(Arc<Image>),
}

/// How values become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// By exposure and tone curve.
    Exposed,
    /// By exposure, each stop a colour.
    Stops,
    /// Values from 0 to 1, as they are.
    Plain,
    /// From -1 to 1.
    Signed,
    /// Distances: near is bright.
    Distance,
}

impl View {
    /// What is to be developed for it, where it is there.
    pub(crate) fn source(
        &self,
        frame: &Arc<Frame>,
        reference: Option<&Arc<Image>>,
        snapshot: impl Fn(u64) -> Option<Arc<Image>>,
    ) -> Option<Source> {
        let of = |light, scale| Some(Source { light, scale });
        let frame = || Arc::clone(frame);
        match self {
            Self::Full => of(LightOf::Full(frame()), Scale::Exposed),
            Self::Direct => of(LightOf::Direct(frame()), Scale::Exposed),
            Self::Indirect => of(LightOf::Indirect(frame()), Scale::Exposed),
            Self::Light(name) => of(LightOf::Light(frame(), name.clone()), Scale::Exposed),
            Self::Albedo => of(LightOf::Albedo(frame()), Scale::Plain),
            Self::Normals => of(LightOf::Normals(frame()), Scale::Signed),
            Self::Depth => of(LightOf::Depth(frame()), Scale::Distance),
            Self::Luminance => of(LightOf::Full(frame()), Scale::Stops),
            Self::Reference => of(LightOf::Image(Arc::clone(reference?)), Scale::Exposed),
            Self::Snapshot(number) => of(LightOf::Image(snapshot(*number)?), Scale::Exposed),
        }
    }
}

impl LightOf {
    /// The image itself; black of a light that is off. A frame without albedo has none yet: black.
    pub(crate) fn image(&self) -> Image {
        let black = |frame: &Frame| Image::new(frame.layers.direct.width, frame.layers.direct.height);
        match self {
            Self::Full(frame) => frame.layers.full(),
            Self::Direct(frame) => frame.layers.direct.clone(),
            Self::Indirect(frame) => frame.layers.indirect.clone(),
            Self::Light(frame, name) => {
                let light = frame.layers.per_light.iter().find(|light| light.name == *name);
                light.map_or_else(|| black(frame), |light| sum(&light.direct, &light.indirect))
            }
            Self::Albedo(frame) => frame.albedo.clone().unwrap_or_else(|| black(frame)),
            Self::Normals(frame) => frame.transfer.view.normals(),
            Self::Depth(frame) => frame.transfer.view.depths(),
            Self::Image(image) => Image::clone(image),
        }
    }
}

fn sum(a: &Image, b: &Image) -> Image {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| *a + *b).collect::<Vec<Vec3>>();
    Image { pixels, ..*a }
}
