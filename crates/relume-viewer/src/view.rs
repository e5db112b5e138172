//! What of the light is shown.

use std::borrow::Cow;
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
    /// Its pixels, row by row; `None` for black: of a light that is off, and of a frame that has no albedo yet.
    pub(crate) fn pixels(&self) -> Option<Pixels<'_>> {
        Some(match self {
            Self::Full(frame) => Pixels::Sum(&frame.layers.direct.pixels, &frame.layers.indirect.pixels),
            Self::Direct(frame) => Pixels::One(Cow::Borrowed(&frame.layers.direct.pixels)),
            Self::Indirect(frame) => Pixels::One(Cow::Borrowed(&frame.layers.indirect.pixels)),
            Self::Light(frame, name) => {
                let light = frame.layers.per_light.iter().find(|light| light.name == *name)?;
                Pixels::Sum(&light.direct.pixels, &light.indirect.pixels)
            }
            Self::Albedo(frame) => Pixels::One(Cow::Borrowed(&frame.albedo.as_ref()?.pixels)),
            Self::Normals(frame) => Pixels::One(Cow::Owned(frame.transfer.view.normals().pixels)),
            Self::Depth(frame) => Pixels::One(Cow::Owned(frame.transfer.view.depths().pixels)),
            Self::Image(image) => Pixels::One(Cow::Borrowed(&image.pixels)),
        })
    }
}

/// Pixels as they are stored, or the sum of two layers.
pub(crate) enum Pixels<'a> {
    One(Cow<'a, [Vec3]>),
    Sum(&'a [Vec3], &'a [Vec3]),
}

impl Pixels<'_> {
    pub(crate) fn at(&self, index: usize) -> Vec3 {
        match self {
            Self::One(pixels) => pixels[index],
            Self::Sum(a, b) => a[index] + b[index],
        }
    }
}
