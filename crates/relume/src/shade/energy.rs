//! How much the specular lobe reflects: its directional albedo, as the split-sum pair of Karis 2013 ("Real
//! Shading in Unreal Engine 4"), integrated from our own lobe.

use std::sync::OnceLock;

use glam::{Vec2, Vec3};

use super::MIN_ROUGHNESS;
use super::ggx::{reflection_weight, sample_visible_normal, schlick};
use crate::trace::sampling::sobol_2d;

/// Nodes along each axis. More make the table finer and slower to build; 32 keep it within 0.005 of the
/// integral (a test holds this).
const NODES: usize = 32;
/// Samples of the lobe a node.
const SAMPLES: u32 = 256;
/// Midpoints of the average over view directions.
const AVERAGE_STEPS: usize = 256;

/// The pair `(a, b)` for which a lobe with reflectance `f0` along the normal and `f90` at grazing reflects
/// `f0 * a + f90 * b` of the light that arrives along a direction.
pub(super) struct EnergyTable {
    /// By roughness, then by the square root of the view's cosine: albedo changes fastest at grazing angles.
    directional: [[Vec2; NODES]; NODES],
    /// By roughness: averages over view directions, cosine-weighted.
    average: [Vec2; NODES],
}

/// The table; built on first use.
pub(super) fn table() -> &'static EnergyTable {
    static TABLE: OnceLock<EnergyTable> = OnceLock::new();
    TABLE.get_or_init(EnergyTable::new)
}

/// The pair for one cosine and perceptual roughness, from the lobe itself.
pub(super) fn integrate(cos_view: f32, roughness: f32, points: &[Vec2]) -> Vec2 {
    let alpha = roughness * roughness;
    let view = Vec3::new((1.0 - cos_view * cos_view).max(0.0).sqrt(), 0.0, cos_view);
    let mut sum = Vec2::ZERO;
    for &point in points {
        let half = sample_visible_normal(view, alpha, point);
        let cos_half_view = view.dot(half);
        let cos_light = 2.0 * cos_half_view * half.z - view.z;
        if cos_light > 0.0 {
            let weight = reflection_weight(cos_view, cos_light, alpha);
            let grazing = schlick(cos_half_view);
            sum += weight * Vec2::new(1.0 - grazing, grazing);
        }
    }
    sum / points.len() as f32
}

/// Where a coordinate in `0..=1` lies among the nodes: the node below and the way to the next.
fn place(x: f32) -> (usize, f32) {
    let scaled = x.clamp(0.0, 1.0) * (NODES - 1) as f32;
    let node = (scaled as usize).min(NODES - 2);
    (node, scaled - node as f32)
}

impl EnergyTable {
    fn new() -> Self {
        let points: Vec<Vec2> = (0..SAMPLES).map(|i| sobol_2d(i, 0, 0x5eed)).collect();
        let node = |i: usize| i as f32 / (NODES - 1) as f32;
        let directional = std::array::from_fn(|row| {
            let roughness = node(row).max(MIN_ROUGHNESS);
            std::array::from_fn(|column| {
                let cos_view = (node(column) * node(column)).max(1e-4);
                integrate(cos_view, roughness, &points)
            })
        });
        let mut table = Self { directional, average: [Vec2::ZERO; NODES] };
        for row in 0..NODES {
            // with cos = x^2 the weight 2 cos dcos becomes 4 x^3 dx
            let mut sum = Vec2::ZERO;
            for step in 0..AVERAGE_STEPS {
                let x = (step as f32 + 0.5) / AVERAGE_STEPS as f32;
                sum += table.pair(x * x, node(row)) * (4.0 * x * x * x);
            }
            table.average[row] = sum / AVERAGE_STEPS as f32;
        }
        table
    }

    /// The pair for light that leaves along a direction at `cos_view` from the normal.
    pub(super) fn pair(&self, cos_view: f32, roughness: f32) -> Vec2 {
        let (row, down) = place(roughness);
        let (column, right) = place(cos_view.max(0.0).sqrt());
        let along = |row: &[Vec2; NODES]| row[column].lerp(row[column + 1], right);
        along(&self.directional[row]).lerp(along(&self.directional[row + 1]), down)
    }

    /// The pair's cosine-weighted average over all directions.
    pub(super) fn average_pair(&self, roughness: f32) -> Vec2 {
        let (row, down) = place(roughness);
        self.average[row].lerp(self.average[row + 1], down)
    }
}
