//! Base colours that the rig edits.
//!
//! Visibility knows nothing of them: operators stay. What changes is linear: `k_d` of view samples, and of the cloud's albedo the
//! diffuse part. How fast light fades within the cloud depends on its albedo, and is found anew.

use glam::Vec3;

use crate::sample::{GatherCloud, kept_base_color};
use crate::scene::LightRig;
use crate::transfer::{CloudBounces, Multibounce, Report, Transfer};
use crate::{Error, Result};

/// The base colour of each of the shot's materials under `rig`, by number, linear RGB.
///
/// # Errors
/// [`Error::Setting`] for an edit of a material that is not there, repeated, or with a colour out of range, and for any other colour where the
/// colours of the scene are within the bounces.
pub(super) fn base_colors(report: &Report, rig: &LightRig) -> Result<Vec<Vec3>, Error> {
    let edits = rig.edits_of(report.materials.iter().map(String::as_str))?;
    let color = |(prepared, edit): (&[f32; 3], Option<usize>)| {
        edit.map_or(Vec3::from(*prepared), |edit| rig.materials[edit].base_color)
    };
    let edited = |(_, (prepared, edit)): &(&String, (&[f32; 3], &Option<usize>))| {
        edit.is_some_and(|edit| rig.materials[edit].base_color != Vec3::from(**prepared))
    };
    let mut materials = report.materials.iter().zip(report.base_colors.iter().zip(&edits));
    if report.settings.multibounce == Multibounce::Photon
        && let Some((name, _)) = materials.find(edited)
    {
        return Err(Error::Setting(format!(
            "material `{name}`: the shot was prepared with photons, whose bounces have its colours in them; take it \
             out of the rig, or prepare it with --multibounce iterated"
        )));
    }
    Ok(report.base_colors.iter().zip(edits).map(color).collect())
}

/// What base colours make of a shot.
pub(super) struct Edits {
    /// By material.
    colors: Vec<Vec3>,
    /// By material, what the `k_d` that view samples keep is multiplied by; none where that is 1 for all.
    scales: Option<Vec<Vec3>>,
    /// The cloud and its bounces where they are not those that were prepared.
    cloud: Option<(GatherCloud, CloudBounces)>,
}

impl Edits {
    /// `colors` has one entry a material.
    pub(super) fn new(transfer: &Transfer, colors: Vec<Vec3>) -> Self {
        let prepared = || transfer.report.base_colors.iter().map(|&rgb| Vec3::from(rgb)).zip(&colors);
        let scales: Vec<Vec3> = prepared().map(|(prepared, now)| *now / kept_base_color(prepared)).collect();
        let changes: Vec<Vec3> = prepared().map(|(prepared, now)| *now - prepared).collect();
        let edited = changes.iter().any(|change| *change != Vec3::ZERO);
        let cloud = if edited { transfer.cloud.recolored(&changes) } else { None };
        Self {
            cloud: cloud.map(|cloud| {
                let bounces = CloudBounces::new(transfer, &cloud);
                (cloud, bounces)
            }),
            scales: scales.iter().any(|scale| *scale != Vec3::ONE).then_some(scales),
            colors,
        }
    }

    /// Whether these are edits to other base colours than `colors`.
    pub(super) fn differ_from(&self, colors: &[Vec3]) -> bool {
        self.colors != colors
    }

    /// By material, what the `k_d` that view samples keep is multiplied by; none where that is 1 for all.
    pub(super) fn scales(&self) -> Option<&[Vec3]> {
        self.scales.as_deref()
    }

    /// The cloud as light falls on it.
    pub(super) fn cloud<'a>(&'a self, transfer: &'a Transfer) -> &'a GatherCloud {
        self.cloud.as_ref().map_or(&transfer.cloud, |(cloud, _)| cloud)
    }

    /// Bounces within that cloud. `prepared` are those within the cloud as it was prepared.
    pub(super) fn bounces<'a>(&'a self, prepared: &'a CloudBounces) -> &'a CloudBounces {
        self.cloud.as_ref().map_or(prepared, |(_, bounces)| bounces)
    }
}
