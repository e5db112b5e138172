//! The picture: what is shown of the light, and what can be done to lights in it.

mod frame;
mod gizmo;
mod inset;
mod tool;

use std::sync::Arc;

use eframe::egui::{
    self, Align2, Color32, ColorImage, CursorIcon, FontId, PointerButton, Pos2, Rect, Response, Sense,
    Stroke, StrokeKind, TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use relume::Light;
use relume::glam::Vec3;

use crate::develop::{Print, STOPS, color_of_stops};
use crate::document::Document;
use crate::lighting;
use frame::{Frame, Framing};
use gizmo::{Drag, Gizmo, Handle};

pub(crate) use inset::Inset;
pub(crate) use tool::Tool;

/// How near the pointer must be to a light to select it, points.
const LIGHT_REACH: f32 = 11.0;
/// Half the width of what can be taken of a wipe's line.
const WIPE_REACH: f32 = 6.0;
/// How much a point of scrolling enlarges, natural logarithm.
const SCROLL: f32 = 0.004;
/// From this zoom on pixels are shown as squares, so that they can be judged.
const SHARP: f32 = 3.0;

/// The middle of the window.
pub(crate) struct Picture {
    framing: Framing,
    left: Option<TextureHandle>,
    right: Option<TextureHandle>,
    /// What the textures are of, and whether their pixels are shown as squares.
    images: Option<(Arc<ColorImage>, Option<Arc<ColorImage>>)>,
    is_sharp: bool,
    size: (usize, usize),
    /// Where there is room for it.
    room: Rect,
    /// Where the wipe's line is, a share of the image's width; `None` shows the left picture alone.
    pub(crate) wipe: Option<f32>,
    pub(crate) tool: Tool,
    /// Whether lights and handles are drawn.
    pub(crate) shows_lights: bool,
    held: Held,
    /// The pixel under the pointer: column and row.
    pub(crate) probe: Option<(usize, usize)>,
    /// What the selected light sees.
    pub(crate) inset: Inset,
}

/// What the pressed pointer has taken hold of.
#[derive(Debug)]
enum Held {
    Nothing,
    /// The image, at one of its points.
    Image(egui::Vec2),
    /// A tool, at work on this light as it was.
    Tool(Light),
    Handle(Drag),
}

/// What the picture is drawn with.
pub(crate) struct Around<'a> {
    /// The last picture that was lit.
    pub(crate) lit: Option<&'a Arc<lighting::Frame>>,
    /// Where handles of lights from far away are.
    pub(crate) anchor: Vec3,
    /// Names of what is left and right of a wipe.
    pub(crate) names: [String; 2],
    /// Whether the left one shows stops as colours.
    pub(crate) in_stops: bool,
    /// Whether anything is open.
    pub(crate) is_open: bool,
    /// What the selected light is looked through with.
    pub(crate) eye: Option<relume::Camera>,
}

impl Default for Picture {
    fn default() -> Self {
        Self {
            framing: Framing::default(),
            left: None,
            right: None,
            images: None,
            is_sharp: false,
            size: (0, 0),
            room: Rect::ZERO,
            wipe: None,
            tool: Tool::Select,
            shows_lights: true,
            held: Held::Nothing,
            probe: None,
            inset: Inset::default(),
        }
    }
}

impl Picture {
    /// Takes up what was developed.
    pub(crate) fn take(&mut self, ctx: &egui::Context, print: Print) {
        self.size = (print.left.size[0], print.left.size[1]);
        self.images = Some((print.left, print.right));
        self.upload(ctx);
    }

    fn upload(&mut self, ctx: &egui::Context) {
        let Some((left, right)) = &self.images else { return };
        let magnification =
            if self.is_sharp { egui::TextureFilter::Nearest } else { egui::TextureFilter::Linear };
        let options = TextureOptions { magnification, ..TextureOptions::LINEAR };
        let set = |texture: &mut Option<TextureHandle>, image: &Arc<ColorImage>, name: &str| match texture {
            Some(texture) => texture.set(Arc::clone(image), options),
            None => *texture = Some(ctx.load_texture(name, Arc::clone(image), options)),
        };
        set(&mut self.left, left, "picture");
        match right {
            Some(right) => set(&mut self.right, right, "picture beside"),
            None => self.right = None,
        }
    }

    /// Forgets what is shown.
    pub(crate) fn clear(&mut self) {
        (self.left, self.right, self.images) = (None, None, None);
        (self.held, self.tool) = (Held::Nothing, Tool::Select);
        self.inset.clear();
    }

    /// Whether the pointer holds a light: keys that would change the list wait.
    pub(crate) fn is_held(&self) -> bool {
        self.inset.is_held() || matches!(self.held, Held::Handle(_) | Held::Tool(_))
    }

    pub(crate) fn fit(&mut self) {
        self.framing.fit();
    }

    /// Shows a pixel of the image as one of the screen.
    pub(crate) fn show_actual(&mut self, ctx: &egui::Context) {
        let frame = self.framing.frame(self.room, self.size);
        self.framing.set_zoom(&frame, 1.0 / ctx.pixels_per_point());
    }

    pub(crate) fn ui(&mut self, ui: &mut Ui, document: &mut Document, around: &Around<'_>) {
        let room = ui.available_rect_before_wrap();
        self.room = room;
        let response = ui.allocate_rect(room, Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Picture"));
        let frame = self.framing.frame(room, self.size);
        self.navigate(ui, &response, &frame);
        let frame = self.framing.frame(room, self.size);
        if (frame.zoom >= SHARP) != self.is_sharp {
            self.is_sharp = frame.zoom >= SHARP;
            self.upload(ui.ctx());
        }
        self.probe = response.hover_pos().and_then(|at| frame.pixel(at));
        self.drag_line(ui, &frame);
        if let Some(lit) = around.lit {
            self.edit(ui, &response, (&frame, lit), document, around.anchor);
        }
        self.paint(ui, &frame, around);
        if let Some(lit) = around.lit.filter(|_| self.shows_lights) {
            self.paint_lights(ui, &response, (&frame, lit), document, around.anchor);
        }
        match (&around.eye, document.selected_light()) {
            (Some(eye), Some(light)) => self.inset.ui(ui, room, light, eye),
            _ => self.inset.let_go(),
        }
        if let Some(hint) = self.tool.hint() {
            label(ui, room.left_bottom() + vec2(10.0, -10.0), Align2::LEFT_BOTTOM, hint);
        }
    }

    /// Zoom and pan.
    fn navigate(&mut self, ui: &Ui, response: &Response, frame: &Frame) {
        if let Some(at) = response.hover_pos() {
            let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let by = (scroll * SCROLL).exp() * pinch;
            if by != 1.0 {
                self.framing.enlarge(frame, by, at);
            }
        }
        let others = [PointerButton::Middle, PointerButton::Secondary];
        if others.into_iter().any(|button| response.drag_started_by(button))
            && let Some(from) = ui.input(|input| input.pointer.press_origin())
        {
            self.held = Held::Image(frame.image_from_screen(from));
        }
        if let (Held::Image(held), Some(at)) = (&self.held, response.interact_pointer_pos()) {
            self.framing.hold(frame, *held, at);
        }
    }

    /// The line between the two halves of a wipe.
    fn drag_line(&mut self, ui: &Ui, frame: &Frame) {
        let Some(wipe) = &mut self.wipe else { return };
        let image = frame.image().intersect(frame.room);
        let x = frame.image().left() + *wipe * frame.image().width();
        let line =
            Rect::from_min_max(pos2(x - WIPE_REACH, image.top()), pos2(x + WIPE_REACH, image.bottom()));
        let response = ui.interact(line, ui.scope_id().with("wipe"), Sense::drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, "Wipe"));
        let response = response.on_hover_and_drag_cursor(CursorIcon::ResizeHorizontal);
        if let Some(at) = response.interact_pointer_pos() {
            *wipe = ((at.x - frame.image().left()) / frame.image().width()).clamp(0.0, 1.0);
        }
    }

    /// What pointer and keys do to lights.
    fn edit(
        &mut self,
        ui: &Ui,
        response: &Response,
        (frame, lit): (&Frame, &Arc<lighting::Frame>),
        document: &mut Document,
        anchor: Vec3,
    ) {
        let camera = &lit.transfer.view.camera;
        if ui.input(|input| input.key_pressed(egui::Key::Escape)) {
            // of one that was let go in the same moment, nothing is taken back
            let is_down = ui.input(|input| input.pointer.any_down());
            let before = match &self.held {
                _ if !is_down => None,
                Held::Handle(drag) => Some(drag.before()),
                Held::Tool(before) => Some(before),
                Held::Nothing | Held::Image(_) => None,
            };
            if let Some((before, light)) = before.zip(document.selected_light())
                && before.name == light.name
            {
                light.clone_from(before);
            }
            (self.held, self.tool) = (Held::Nothing, Tool::Select);
        }
        if response.drag_started_by(PointerButton::Primary) {
            // what was typed into is done
            ui.memory_mut(|memory| memory.focused().map(|id| memory.surrender_focus(id)));
            let from = ui.input(|input| input.pointer.press_origin());
            self.held = from.map_or(Held::Nothing, |from| self.hold(frame, camera, document, anchor, from));
        }
        if let Some(at) = response.interact_pointer_pos() {
            let surface = |at| tool::seen(lit, frame.pixel(at)).map(|seen| seen.position);
            match (&self.held, document.selected_light()) {
                (Held::Handle(drag), Some(light))
                    if response.dragged() && drag.before().name == light.name =>
                {
                    *light = drag.light(frame, camera, at, surface);
                }
                (Held::Tool(before), Some(light)) if response.dragged() && before.name == light.name => {
                    // from where it was, not from where the pointer has led it meanwhile
                    light.clone_from(before);
                    self.tool.apply(lit, frame.pixel(at), light, false);
                }
                (_, Some(light)) if response.clicked() && self.tool != Tool::Select => {
                    self.tool.apply(lit, frame.pixel(at), light, true);
                }
                _ if response.clicked() && self.shows_lights => {
                    if let Some(light) = light_at(frame, camera, &document.rig.lights, at) {
                        document.selected = Some(light);
                    }
                }
                _ => {}
            }
        }
        if response.drag_stopped() {
            self.held = Held::Nothing;
        }
    }

    fn hold(
        &self,
        frame: &Frame,
        camera: &relume::Camera,
        document: &mut Document,
        anchor: Vec3,
        from: Pos2,
    ) -> Held {
        if let Some(light) = document.selected_light().filter(|_| self.tool.is_dragged()) {
            return Held::Tool(light.clone());
        }
        let taken = document.selected_light().filter(|_| self.shows_lights).and_then(|light| {
            let gizmo = Gizmo { frame, camera, light, anchor };
            Some(gizmo.take(gizmo.handle_at(from)?, from))
        });
        if let Some(drag) = taken {
            return Held::Handle(drag);
        }
        // a light that is not selected yet is taken where it stands
        match light_at(frame, camera, &document.rig.lights, from).filter(|_| self.shows_lights) {
            Some(index) => {
                document.selected = Some(index);
                let gizmo = Gizmo { frame, camera, light: &document.rig.lights[index], anchor };
                Held::Handle(gizmo.take(Handle::InPlane, from))
            }
            None => Held::Image(frame.image_from_screen(from)),
        }
    }

    fn paint(&self, ui: &Ui, frame: &Frame, around: &Around<'_>) {
        let painter = ui.painter_at(frame.room);
        for beside in around_of(frame.room, self.left.is_some().then(|| frame.image())) {
            painter.rect_filled(beside, 0.0, ui.visuals().extreme_bg_color);
        }
        let Some(left) = &self.left else {
            let color = ui.visuals().weak_text_color();
            let text = if around.is_open { "Opening ..." } else { "Drop a scene or a cache here" };
            painter.text(frame.room.center(), Align2::CENTER_CENTER, text, FontId::proportional(18.0), color);
            return;
        };
        let image = frame.image();
        let part = |texture: &TextureHandle, from: f32, to: f32| {
            let x = |share: f32| image.left() + share * image.width();
            let rect = Rect::from_min_max(pos2(x(from), image.top()), pos2(x(to), image.bottom()));
            painter.image(
                texture.id(),
                rect,
                Rect::from_min_max(pos2(from, 0.0), pos2(to, 1.0)),
                Color32::WHITE,
            );
        };
        match (self.wipe, &self.right) {
            (Some(wipe), Some(right)) => {
                part(left, 0.0, wipe);
                part(right, wipe, 1.0);
                let x = image.left() + wipe * image.width();
                let seen = image.intersect(frame.room);
                painter.vline(x, seen.y_range(), Stroke::new(1.5, Color32::WHITE));
                painter.circle_filled(pos2(x, seen.center().y), 5.0, Color32::WHITE);
                let [left, right] = &around.names;
                label(ui, pos2(x - 10.0, seen.top() + 8.0), Align2::RIGHT_TOP, left);
                label(ui, pos2(x + 10.0, seen.top() + 8.0), Align2::LEFT_TOP, right);
            }
            _ => part(left, 0.0, 1.0),
        }
        if self.wipe.is_none() && around.names[0].contains(':') {
            label(ui, frame.room.center(), Align2::CENTER_CENTER, &around.names[0]);
        }
        if around.in_stops {
            paint_legend(ui, frame.room);
        }
    }

    fn paint_lights(
        &self,
        ui: &Ui,
        response: &Response,
        (frame, lit): (&Frame, &Arc<lighting::Frame>),
        document: &mut Document,
        anchor: Vec3,
    ) {
        let (painter, camera) = (ui.painter_at(frame.room), &lit.transfer.view.camera);
        for (index, light) in document.rig.lights.iter().enumerate() {
            let Some(at) = light.position().and_then(|place| frame.screen_from_world(camera, place)) else {
                continue;
            };
            let selected = document.selected == Some(index);
            let color = light.color() / light.color().max_element().max(f32::MIN_POSITIVE);
            let [r, g, b] = color.to_array().map(|channel| (255.0 * channel.sqrt()) as u8);
            let fill = if light.enabled { Color32::from_rgb(r, g, b) } else { Color32::from_gray(70) };
            painter.circle(at, 5.0, fill, Stroke::new(1.5, Color32::BLACK));
            if selected {
                label(ui, at + vec2(12.0, 12.0), Align2::LEFT_TOP, &light.name);
            }
        }
        let Some(light) = document.selected_light() else { return };
        let gizmo = Gizmo { frame, camera, light, anchor };
        let hot = match &self.held {
            Held::Handle(drag) => Some(drag.handle),
            _ => {
                response.hover_pos().filter(|_| self.tool == Tool::Select).and_then(|at| gizmo.handle_at(at))
            }
        };
        painter.extend(gizmo.shapes(hot));
        if hot.is_some() {
            ui.ctx().set_cursor_icon(CursorIcon::Grab);
        }
    }
}

/// What of the room an image leaves bare: painting under it would be for nothing, which tells where the processor paints.
fn around_of(room: Rect, image: Option<Rect>) -> Vec<Rect> {
    let Some(image) = image.map(|image| image.intersect(room)).filter(Rect::is_positive) else {
        return vec![room];
    };
    let rows = [(room.top(), image.top()), (image.bottom(), room.bottom())];
    let sides = [(room.left(), image.left()), (image.right(), room.right())];
    let across = rows.map(|(top, bottom)| Rect::from_x_y_ranges(room.x_range(), top..=bottom));
    let beside = sides.map(|(left, right)| Rect::from_x_y_ranges(left..=right, image.y_range()));
    across.into_iter().chain(beside).filter(Rect::is_positive).collect()
}

/// The light that stands at a point of the screen.
fn light_at(frame: &Frame, camera: &relume::Camera, lights: &[Light], at: Pos2) -> Option<usize> {
    let distance = |light: &Light| Some(frame.screen_from_world(camera, light.position()?)?.distance(at));
    let distances = lights.iter().enumerate().filter_map(|(index, light)| Some((index, distance(light)?)));
    let nearest = distances.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    (nearest.1 < LIGHT_REACH).then_some(nearest.0)
}

/// Text that can be read on any picture.
fn label(ui: &Ui, at: Pos2, align: Align2, text: &str) {
    let painter = ui.painter();
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::from_gray(235));
    let rect = align.anchor_size(at, galley.size());
    painter.rect_filled(rect.expand2(vec2(6.0, 3.0)), 3.0, Color32::from_black_alpha(170));
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// Which colour stands for how many stops.
fn paint_legend(ui: &Ui, room: Rect) {
    const STEP: f32 = 16.0;
    let painter = ui.painter_at(room);
    let corner = room.right_top() + vec2(-70.0, 12.0);
    for (row, stops) in STOPS.rev().enumerate() {
        let [r, g, b] = color_of_stops(stops as f32).to_array().map(|channel| (channel * 255.0) as u8);
        let box_of = Rect::from_min_size(corner + vec2(0.0, row as f32 * STEP), vec2(20.0, STEP));
        painter.rect(
            box_of,
            0.0,
            Color32::from_rgb(r, g, b),
            Stroke::new(1.0, Color32::BLACK),
            StrokeKind::Inside,
        );
        label(ui, box_of.right_center() + vec2(8.0, 0.0), Align2::LEFT_CENTER, &format!("{stops:+}"));
    }
}
