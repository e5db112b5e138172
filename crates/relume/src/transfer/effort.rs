//! How much time and space a preparation spends: what [`Quality`] stands for.

use super::low_rank::LowRankSettings;
use super::rows::RowSettings;
use super::tiles::{Spread, TILE};

/// How much time and space to spend.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// For the first seconds.
    Glance,
    /// For a first look.
    Draft,
    /// For lighting.
    #[default]
    Standard,
    /// For the last picture: several times the time.
    Final,
}

/// What [`Quality`] stands for.
pub(super) struct Effort {
    /// For large images; see [`Effort::gather_rows_of`].
    gather_rows: RowSettings,
    pub(super) bounce_rows: RowSettings,
    pub(super) gather_encoding: LowRankSettings,
    pub(super) bounce_encoding: LowRankSettings,
    pub(super) training_lights: usize,
    /// Rays that tell who sees what.
    pub(super) sight_rays: usize,
}

/// Gather samples that share a basis of the bounce operator: a 64th of the scene, within these bounds; powers of four.
const BOUNCE_BLOCK: (usize, usize) = (64, 1024);
/// Blocks of small images are one run of points, with few tiles to take the mean of: less counts as faint there, by this factor.
const FAINT_ALONE: f32 = 0.4;
impl Effort {
    /// For blocks of so many receivers.
    pub(super) fn gather_rows_of(&self, length: usize) -> RowSettings {
        let alone = if length <= TILE { FAINT_ALONE } else { 1.0 };
        RowSettings { faint: alone * self.gather_rows.faint, ..self.gather_rows }
    }
}

impl Quality {
    pub(super) fn effort(self) -> Effort {
        let rows = |hemisphere_rays, tile_rays, faint, (tile, tent)| RowSettings {
            hemisphere_rays,
            tile_rays,
            faint,
            lobe_rays: hemisphere_rays,
            spread: Spread { tile, tent },
        };
        let low_rank = |rank, kept, price| LowRankSettings { rank, kept, price };
        match self {
            Self::Glance => Effort {
                gather_rows: rows(16, 64, 1e-1, (0.2, 0.4)),
                bounce_rows: rows(16, 48, 1e-1, (0.4, 0.4)),
                gather_encoding: low_rank(64, 2048, 5.5e-5),
                bounce_encoding: low_rank(64, 2048, 2.4e-5),
                training_lights: 64,
                sight_rays: 300_000,
            },
            Self::Draft => Effort {
                gather_rows: rows(16, 512, 4e-3, (0.1, 0.25)),
                bounce_rows: rows(16, 256, 1e-2, (0.4, 0.4)),
                gather_encoding: low_rank(96, 3072, 8.5e-6),
                bounce_encoding: low_rank(96, 3072, 1.2e-5),
                training_lights: 128,
                sight_rays: 2_500_000,
            },
            Self::Standard => Effort {
                gather_rows: rows(64, 768, 2e-3, (0.04, 0.09)),
                bounce_rows: rows(32, 512, 4e-3, (0.25, 0.4)),
                gather_encoding: low_rank(256, 6144, 3.2e-6),
                bounce_encoding: low_rank(256, 6144, 1.2e-5),
                training_lights: 384,
                sight_rays: 20_000_000,
            },
            Self::Final => Effort {
                gather_rows: rows(128, 2048, 4e-4, (0.025, 0.06)),
                bounce_rows: rows(64, 1024, 1e-3, (0.15, 0.3)),
                gather_encoding: low_rank(512, 12_288, 2.1e-7),
                bounce_encoding: low_rank(512, 12_288, 1.1e-6),
                training_lights: 576,
                sight_rays: 20_000_000,
            },
        }
    }
}

/// Receivers that share a basis: fewer in small images, whose pixels lie farther apart and share less.
pub(super) fn receiver_block(pixels: usize) -> usize {
    match pixels {
        0..40_000 => 64,
        40_000..160_000 => 256,
        _ => 1024,
    }
}

/// Gather samples that share a basis of the bounce operator, of `count` in all.
pub(super) fn bounce_block(count: usize) -> usize {
    (count / 64).clamp(BOUNCE_BLOCK.0, BOUNCE_BLOCK.1)
}
