//! The lines below the picture: how the work is, and what there is to say.

use std::time::Duration;

use eframe::egui::{self, Color32, ProgressBar, Ui};
use relume::image::Layers;

use crate::export::Export;
use crate::lighting::Frame;
use crate::messages::{Kind, Messages};
use crate::shot::{Shot, Stage, Work};
use crate::wording::{bytes, duration};

/// Images that are being written.
pub(crate) fn exports(ui: &mut Ui, exports: &[Export]) {
    for export in exports {
        let (written, of) = export.progress();
        ui.horizontal(|ui| {
            ui.spinner();
            let left = export
                .left()
                .map_or(String::new(), |left| format!(", about {} left", duration(left.as_secs_f64())));
            let what = if of == 1 {
                "writing".to_owned()
            } else {
                format!("writing frame {} of {of}{left}", (written + 1).min(of))
            };
            ui.label(format!("{what}: {}", export.path().display()));
            if of > 1
                && ui.small_button("Stop").on_hover_text("End it; frames that are written stay").clicked()
            {
                export.stop();
            }
        });
    }
}

/// Preparation, last frame, memory.
pub(crate) fn status(
    ui: &mut Ui,
    shot: Option<&Shot>,
    lit: Option<&Frame>,
    latency: Option<Duration>,
    reads: bool,
) {
    ui.horizontal(|ui| {
        if reads {
            ui.spinner();
            ui.label("reading a file");
            ui.separator();
        }
        match shot {
            Some(shot) => preparation(ui, shot),
            None => drop(ui.weak("Nothing is open: File, Open, or drop a scene here")),
        }
        let Some(lit) = lit else { return };
        ui.separator();
        let shown = if lit.preview { "coarse, while dragged" } else { "full" };
        let latency = latency.map_or(String::new(), |latency| format!(", {:.0} ms after the edit", latency.as_secs_f64() * 1e3));
        ui.label(format!("frame {:.0} ms{latency} ({shown})", lit.stats.frame_ms)).on_hover_text(frame_parts(lit));
        ui.separator();
        if lit.transfer.is_direct_only() {
            ui.label("direct light only");
        } else if let Some(error) = lit.transfer.report.gather_error.expected {
            let settings = &lit.transfer.report.settings;
            ui.label(format!("transfer error about {:.1}%", 100.0 * error)).on_hover_text(format!(
                "What storing the transfer loses of indirect light, as expected; {} gather samples, {:?} quality",
                settings.gather, settings.quality
            ));
        }
        ui.separator();
        ui.label(memory(lit)).on_hover_text("What of the program lies in memory, and what the transfer takes of it");
    });
}

fn frame_parts(lit: &Frame) -> String {
    let stats = &lit.stats;
    format!(
        "direct {:.0} ms, cloud {:.0} ms, bounces {:.0} ms, final gather {:.0} ms, spreading {:.0} ms, sum {:.0} ms; {} lights relit, {} shadow rays",
        stats.direct_ms,
        stats.cloud_ms,
        stats.bounces_ms,
        stats.gather_ms,
        stats.upsample_ms,
        stats.sum_ms,
        stats.relit,
        stats.shadow_rays
    )
}

fn memory(lit: &Frame) -> String {
    let transfer = lit.transfer.bytes_per_pixel() * lit.transfer.view.pixels() as f64;
    match relume::transfer::resident_bytes() {
        Some(resident) => format!("{} of memory, transfer {}", bytes(resident), bytes(transfer as u64)),
        None => format!("transfer {}", bytes(transfer as u64)),
    }
}

/// How often progress is drawn, where nothing else is.
const TOLD_EVERY: Duration = Duration::from_millis(250);

fn preparation(ui: &mut Ui, shot: &Shot) {
    let stage = shot.stage();
    if !matches!(stage, Stage::Ready | Stage::Stopped) && !shot.is_paused() {
        ui.ctx().request_repaint_after(TOLD_EVERY);
    }
    match stage {
        Stage::Reading => {
            ui.spinner();
            ui.label("reading");
        }
        Stage::Saving => {
            ui.spinner();
            ui.label("writing the cache");
        }
        Stage::Ready => drop(ui.label("ready")),
        Stage::Stopped => {
            ui.label("the preparation has ended").on_hover_text(
                "What is there can be lit; open the scene again, and it goes on from what is done",
            );
        }
        Stage::Preparing(Work { status, for_so_long, left }) => {
            let share = if status.of > 0 { status.done as f32 / status.of as f32 } else { 0.0 };
            let text = if status.stage.is_empty() { "preparing".to_owned() } else { status.stage.clone() };
            ui.add(ProgressBar::new(share).desired_width(130.0).text(format!("{:.0}%", 100.0 * share)));
            ui.label(text)
                .on_hover_text("What the preparation is at; the picture gets finer while it goes on");
            let left = left.map_or(String::new(), |left| {
                format!(", about {} left of this", duration(left.as_secs_f64()))
            });
            ui.label(format!("{}{left}", duration(for_so_long.as_secs_f64()))).on_hover_text(
                "How long the preparation has been at work; the stages before the last ones take seconds",
            );
            let paused = shot.is_paused();
            let name = if paused { "Go on" } else { "Pause" };
            if ui.small_button(name).on_hover_text("Pause the preparation, or let it go on").clicked() {
                shot.pause(!paused);
            }
            let end = ui
                .small_button("End")
                .on_hover_text("End the preparation; what is done is kept for the next time");
            if end.clicked() {
                shot.cancel();
            }
        }
    }
}

/// What there is to say; errors stay until they are dismissed.
pub(crate) fn messages(ui: &mut Ui, messages: &mut Messages) {
    let mut read = None;
    for (index, message) in messages.iter().enumerate() {
        ui.horizontal(|ui| {
            let (sign, color) = match message.kind {
                Kind::Error => ("Error:", Color32::from_rgb(235, 87, 87)),
                Kind::Warning => ("Warning:", Color32::from_rgb(235, 170, 60)),
                Kind::Notice => ("", ui.visuals().text_color()),
            };
            if super::cross(ui, "Dismiss") {
                read = Some(index);
            }
            if !sign.is_empty() {
                ui.colored_label(color, sign);
            }
            ui.add(egui::Label::new(&message.text).selectable(true).wrap());
        });
    }
    if let Some(index) = read {
        messages.dismiss(index);
    }
}

/// Scene-linear values under the pointer.
pub(crate) fn probe_text(lit: &Frame, (column, row): (usize, usize)) -> Option<String> {
    let view = &lit.transfer.view;
    let index = row * view.width + column;
    let sample = view.centers.get(index)?;
    let Layers { direct, indirect, .. } = &lit.layers;
    let (direct, indirect) = (*direct.pixels.get(index)?, *indirect.pixels.get(index)?);
    let full = direct + indirect;
    // what is rounded away has no sign
    let number = |value: f32| format!("{:.4}", if value.abs() < 5e-5 { 0.0 } else { value });
    let rgb = |color: relume::glam::Vec3| color.to_array().map(number).join(" ");
    let mut text =
        format!("{column}, {row}   full {}   direct {}   indirect {}", rgb(full), rgb(direct), rgb(indirect));
    for light in &lit.layers.per_light {
        text +=
            &format!("   {} {}", light.name, rgb(light.direct.pixels[index] + light.indirect.pixels[index]));
    }
    if sample.is_sky() {
        text += "   no surface";
    } else {
        let material = lit.transfer.report.materials.get(sample.material as usize);
        text += &format!("   {} at {:.2} m", material.map_or("", String::as_str), sample.depth);
    }
    Some(text)
}
