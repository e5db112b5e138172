//! What radiates by itself: emissive surfaces, and the sky under a dome. It is light on the cloud from the start, and lights the view samples by
//! the same operators as its bounces.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::{EMISSION, Lit, Only, RelightSettings, Relighter, add_scaled, direct, milliseconds};
use crate::image::LightLayers;
use crate::sample::illuminate_sky;
use crate::scene::LightRig;
use crate::shade::Dome;
use crate::{Error, Progress, Result};

/// What some emissive materials do as they are in the scene.
pub(super) struct Glow {
    /// Ascending.
    materials: Vec<u32>,
    settings: RelightSettings,
    /// What it was multiplied by in the last frame; `None` where that had other groups.
    pub(super) scale: Option<Vec3>,
    lit: Lit,
}

/// Groups of emissive materials that are kept for frames that name others.
const SPARE_GLOWS: usize = 4;

impl Relighter {
    /// Emissive materials that shine in the shot, in groups, with what each group is multiplied by: one group for each emitter of
    /// the rig, one for all other materials.
    pub(super) fn glows(&self, rig: &LightRig) -> Result<Vec<(Vec<u32>, Vec3)>> {
        let emitters = rig.emitters_of(self.transfer.report.named_materials())?;
        let mut groups = vec![Vec::new(); rig.emitters.len() + 1];
        for &material in &self.emissive {
            groups[emitters[material as usize].unwrap_or(rig.emitters.len())].push(material);
        }
        let scales = rig.emitters.iter().map(|emitter| emitter.scale).chain([Vec3::ONE]);
        Ok(groups.into_iter().zip(scales).filter(|(materials, _)| !materials.is_empty()).collect())
    }

    /// Emissive surfaces: what the camera sees of them, their light on the view samples (direct), and its bounces.
    pub(super) fn light_emission(
        &mut self,
        glows: Vec<(Vec<u32>, Vec3)>,
        settings: &RelightSettings,
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut before = std::mem::take(&mut self.emission);
        before.retain(|glow| glow.settings.serve(settings));
        before.iter_mut().for_each(|glow| glow.scale = None);
        for (materials, scale) in glows {
            if let Some(place) = before.iter().position(|glow| glow.materials == materials) {
                self.emission.push(Glow { scale: Some(scale), ..before.swap_remove(place) });
            } else if scale != Vec3::ZERO {
                if progress.cancelled() {
                    self.emission.append(&mut before);
                    return Err(Error::Cancelled);
                }
                let lit = self.glow(&materials, settings);
                self.emission.push(Glow { materials, settings: *settings, scale: Some(scale), lit });
            }
            progress.advance(1);
        }
        self.emission.extend(before.into_iter().take(SPARE_GLOWS));
        Ok(())
    }

    fn glow(&mut self, materials: &[u32], settings: &RelightSettings) -> Lit {
        let transfer = Arc::clone(&self.transfer);
        let shines = |material: u32| materials.binary_search(&material).is_ok();
        let mut emitted = vec![Vec3::ZERO; transfer.cloud.len()];
        for part in transfer.cloud.emitted.iter().filter(|part| shines(part.material)) {
            emitted[part.sample as usize] += part.radiance;
        }
        let mut lit = self.shine(&emitted, settings);
        if settings.only != Only::Indirect {
            direct::add_emission(transfer.view.grid(settings.aa), shines, &mut lit.direct.pixels);
        }
        lit
    }

    /// A dome: its light on the view samples (direct), and its bounces. Suns in its map are lights of their own. A closed scene lets in
    /// neither: what rays find there between its walls is no sky.
    pub(super) fn dome(&mut self, dome: &Dome, settings: &RelightSettings) -> Lit {
        let direct_only = self.transfer.is_direct_only();
        if self.transfer.cloud.sky.is_empty() && !direct_only {
            return Lit { direct: self.black(), indirect: self.black() };
        }
        let began = Instant::now();
        let mut emitted = vec![Vec3::ZERO; self.transfer.cloud.surfaces().len()];
        emitted.extend(illuminate_sky(&self.transfer.cloud.sky, dome));
        self.stats.cloud_ms += milliseconds(began);
        let mut lit = self.shine(&emitted, settings);
        if settings.only != Only::Indirect {
            direct::add_sky(self.transfer.view.grid(settings.aa), dome, &mut lit.direct.pixels);
        }
        for sun in dome.suns() {
            let sunlit = self.lamp(&sun, settings);
            add_scaled(&mut lit.direct, &sunlit.direct, Vec3::ONE);
            add_scaled(&mut lit.indirect, &sunlit.indirect, Vec3::ONE);
        }
        lit
    }

    /// What samples of the cloud radiate by themselves.
    fn shine(&mut self, emitted: &[Vec3], settings: &RelightSettings) -> Lit {
        let transfer = Arc::clone(&self.transfer);
        let mut lit = Lit { direct: self.black(), indirect: self.black() };
        if transfer.is_direct_only() {
            return lit;
        }
        if settings.only != Only::Indirect {
            lit.direct.pixels = self.gather(emitted, Some(0), settings);
        }
        if settings.only != Only::Direct && settings.bounces != Some(0) {
            let began = Instant::now();
            let times = settings.bounces.map(|bounces| bounces - 1);
            let (bounce, bounces) = (&transfer.bounce, self.bounces_for(settings));
            let bounced = bounces.sum_reflected(bounce, emitted, times, settings.epsilon(bounce));
            lit.indirect.pixels = self.gather_bounced(bounced, began, settings);
        }
        lit
    }

    /// What all emissive surfaces do together; `None` where none shines.
    pub(super) fn emission_layers(&self) -> Option<LightLayers> {
        let mut shining = self.emission.iter().filter_map(|glow| Some((glow.scale?, &glow.lit))).peekable();
        shining.peek()?;
        let mut all = LightLayers { name: EMISSION.to_owned(), direct: self.black(), indirect: self.black() };
        for (scale, lit) in shining {
            add_scaled(&mut all.direct, &lit.direct, scale);
            add_scaled(&mut all.indirect, &lit.indirect, scale);
        }
        Some(all)
    }
}
