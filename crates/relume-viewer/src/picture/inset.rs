//! What the selected light sees, in a corner of the picture.

use eframe::egui::{
    self, Color32, ColorImage, CursorIcon, Key, PointerButton, Rect, Sense, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use relume::glam::{Quat, Vec3};
use relume::{Camera, Light, LightKind};

/// Points along its side.
const SIDE: f32 = 240.0;
/// From the corner of the picture, points.
const MARGIN: f32 = 12.0;

/// The inset, while it is open.
#[derive(Default)]
pub(crate) struct Inset {
    texture: Option<TextureHandle>,
    pub(crate) is_open: bool,
    /// While the light is being turned in it: the light as it was.
    held: Option<Light>,
}

impl Inset {
    /// Takes up what the light sees now.
    pub(crate) fn take(&mut self, ctx: &egui::Context, image: ColorImage) {
        match &mut self.texture {
            Some(texture) => texture.set(image, TextureOptions::LINEAR),
            None => self.texture = Some(ctx.load_texture("inset", image, TextureOptions::LINEAR)),
        }
    }

    /// Whether the light is being turned in it.
    pub(super) fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// Lets the light go.
    pub(super) fn let_go(&mut self) {
        self.held = None;
    }

    /// Forgets what is shown.
    pub(super) fn clear(&mut self) {
        (self.texture, self.held) = (None, None);
    }

    /// Draws it; dragging in it turns the light, as if one held it.
    pub(crate) fn ui(&mut self, ui: &Ui, room: Rect, light: &mut Light, eye: &Camera) {
        let Some(texture) = self.texture.clone().filter(|_| self.is_open) else { return };
        let side = SIDE.min(0.5 * room.height()).min(0.5 * room.width());
        let rect =
            Rect::from_min_size(room.right_bottom() - egui::Vec2::splat(side + MARGIN), vec2(side, side));
        let response = ui.interact(rect, ui.scope_id().with("inset"), Sense::drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Through the light"));
        let response = response.on_hover_and_drag_cursor(CursorIcon::Grab);
        if response.drag_started_by(PointerButton::Primary) {
            self.held = Some(light.clone());
        }
        if ui.input(|input| input.key_pressed(Key::Escape) && input.pointer.any_down())
            && let Some(held) = self.held.take().filter(|held| held.name == light.name)
        {
            *light = held;
        }
        if !response.dragged() {
            self.held = None;
        } else if self.held.is_some() {
            turn(light, eye, response.drag_delta() / side);
        }
        let painter = ui.painter_at(room);
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        painter.image(texture.id(), rect, whole, Color32::WHITE);
        let line = Stroke::new(1.0, Color32::from_rgb(255, 210, 90));
        if let LightKind::Spot { inner_angle, outer_angle, .. } = light.kind {
            let half = (0.5 * eye.vertical_fov).tan();
            for angle in [inner_angle, outer_angle] {
                let radius = angle.to_radians().tan() / half * 0.5 * side;
                painter.with_clip_rect(rect).circle_stroke(rect.center(), radius, line);
            }
        }
        painter.rect_stroke(rect, 0.0, Stroke::new(1.0, Color32::from_gray(200)), StrokeKind::Outside);
        super::label(
            ui,
            rect.left_top() + vec2(6.0, 6.0),
            egui::Align2::LEFT_TOP,
            &format!("through {}", light.name),
        );
    }
}

/// Turns the light by a drag, in shares of what it sees: what was under the pointer goes with it.
fn turn(light: &mut Light, eye: &Camera, by: egui::Vec2) {
    let axis = |axis: Vec3| eye.world_from_camera.transform_vector3(axis);
    let (about_y, about_x) = (by.x * eye.vertical_fov, by.y * eye.vertical_fov);
    light.turn(Quat::from_axis_angle(axis(Vec3::Y), about_y) * Quat::from_axis_angle(axis(Vec3::X), about_x));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dragged_goes_with_the_pointer() {
        let kind = LightKind::Spot {
            position: Vec3::new(0.0, 3.0, 0.0),
            target: Vec3::new(0.5, 0.0, -4.0),
            intensity: Vec3::ONE,
            inner_angle: 10.0,
            outer_angle: 20.0,
            radius: 0.0,
        };
        let mut light = Light { name: "spot".to_owned(), enabled: true, kind };
        let eye = light.camera(Vec3::ZERO, 1.0).unwrap();
        let held = eye.position() + eye.direction(120.0, 120.0, 240, 240) * 3.0;
        turn(&mut light, &eye, vec2(0.1, -0.05));
        let (at, _) = light.camera(Vec3::ZERO, 1.0).unwrap().project(held, 240, 240).unwrap();
        assert!((at.x - 144.0).abs() < 2.5 && (at.y - 108.0).abs() < 2.5, "{at}");
        assert_eq!(light.position(), Some(Vec3::new(0.0, 3.0, 0.0)));
    }
}
