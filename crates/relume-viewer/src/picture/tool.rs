//! Placing the selected light by what it is to do.

use relume::Light;
use relume::glam::Vec3;
use relume::scene::SeenPoint;
use relume::trace::{Ray, offset_origin};

use crate::lighting::Frame;

/// Of the way from a surface to the next one, how much a light may go.
const WITHIN: f32 = 0.95;

/// A light is put no nearer to a surface, metres.
const NEAREST: f32 = 0.05;

/// What a click in the picture does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Tool {
    /// Selects lights, and drags handles.
    #[default]
    Select,
    /// Aims the selected spot.
    Aim,
    /// Puts the selected light where its highlight is seen under the pointer.
    Highlight,
    /// Puts it where it throws the shadow of a first point to a second one.
    Shadow {
        /// The first point.
        edge: Option<SeenPoint>,
    },
}

impl Tool {
    pub(crate) const SHADOW: Self = Self::Shadow { edge: None };

    /// What to do next.
    pub(crate) fn hint(self) -> Option<&'static str> {
        match self {
            Self::Select => None,
            Self::Aim => Some("Aim: click or drag where the spot shall point. Esc ends it."),
            Self::Highlight => {
                Some("Highlight: click or drag where the light's reflection shall be seen. Esc ends it.")
            }
            Self::Shadow { edge: None } => {
                Some("Shadow, first: click what throws it, at its edge. Esc ends it.")
            }
            Self::Shadow { edge: Some(_) } => {
                Some("Shadow, second: click or drag where that edge's shadow shall fall.")
            }
        }
    }

    /// Whether it follows a pressed pointer.
    pub(super) fn is_dragged(self) -> bool {
        !matches!(self, Self::Select | Self::Shadow { edge: None })
    }

    /// Does it with the surface that is seen at a pixel. Where none is, nothing is done.
    pub(super) fn apply(
        &mut self,
        lit: &Frame,
        pixel: Option<(usize, usize)>,
        light: &mut Light,
        clicked: bool,
    ) {
        let Some(at) = seen(lit, pixel) else { return };
        match *self {
            Self::Select => {}
            Self::Aim => {
                light.aim_at(at.position);
            }
            Self::Highlight => {
                // a bent normal may mirror the view into the surface: there is no place for a light then
                let farthest = WITHIN * free_way(lit, at.position, at.normal, at.mirrored());
                if farthest > NEAREST {
                    light.place_by_highlight(at, farthest);
                }
            }
            Self::Shadow { edge: None } => *self = Self::Shadow { edge: Some(at) },
            Self::Shadow { edge: Some(edge) } => {
                let way = (edge.position - at.position).normalize_or(at.normal);
                // past what is in the way there is its own far side first: that is no wall to stay before
                let leaves = way.dot(edge.normal) > 0.0;
                let farthest =
                    if leaves { WITHIN * free_way(lit, edge.position, way, way) } else { f32::INFINITY };
                if farthest > NEAREST {
                    light.place_by_shadow(edge.position, at.position, farthest);
                }
                if clicked {
                    *self = Self::SHADOW;
                }
            }
        }
    }
}

/// What the camera sees at a pixel, if that is a surface.
pub(crate) fn seen(lit: &Frame, pixel: Option<(usize, usize)>) -> Option<SeenPoint> {
    let ((column, row), view) = (pixel?, &lit.transfer.view);
    let sample = view.centers.get(row * view.width + column).filter(|sample| !sample.is_sky())?;
    let eye = view.camera.position();
    Some(SeenPoint { position: sample.position, normal: sample.shading_normal.get(), eye })
}

/// How far it is from a surface to the next one, metres; infinite into the open.
fn free_way(lit: &Frame, from: Vec3, normal: Vec3, way: Vec3) -> f32 {
    let hit = lit.transfer.occluders.accel().closest(&Ray::new(offset_origin(from, normal), way));
    if hit.is_hit() { hit.t } else { f32::INFINITY }
}
