//! Where the image lies on the screen.

use eframe::egui::{Pos2, Rect, Vec2, vec2};
use relume::glam;

/// Zooms, screen pixels an image pixel.
const ZOOMS: std::ops::RangeInclusive<f32> = 0.05..=64.0;

/// How far the image is enlarged, and what of it is in the middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Framing {
    /// Screen points an image pixel; `None` fits the image into the window, however large that is.
    zoom: Option<f32>,
    /// From the image's middle to what is in the middle of the window, image pixels.
    offset: Vec2,
}

/// The image as it lies on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    /// Where there is room for it.
    pub(crate) room: Rect,
    /// Of the image, pixels.
    pub(crate) size: Vec2,
    /// Screen points an image pixel.
    pub(crate) zoom: f32,
    middle: Vec2,
}

impl Framing {
    pub(crate) fn frame(&self, room: Rect, (width, height): (usize, usize)) -> Frame {
        let size = vec2(width.max(1) as f32, height.max(1) as f32);
        let fit = (room.width() / size.x).min(room.height() / size.y).max(*ZOOMS.start());
        Frame { room, size, zoom: self.zoom.unwrap_or(fit), middle: 0.5 * size + self.offset }
    }

    /// Fits the image into the window.
    pub(crate) fn fit(&mut self) {
        *self = Self::default();
    }

    /// Enlarges by so much, around a point of the screen; beyond a limit no more.
    pub(crate) fn enlarge(&mut self, frame: &Frame, by: f32, around: Pos2) {
        let zoom = (frame.zoom * by).clamp(*ZOOMS.start(), *ZOOMS.end());
        let held = frame.image_from_screen(around);
        self.offset = held - (around - frame.room.center()) / zoom - 0.5 * frame.size;
        self.zoom = Some(zoom);
    }

    /// Shows so many screen points an image pixel, with the same in the middle.
    pub(crate) fn set_zoom(&mut self, frame: &Frame, zoom: f32) {
        self.enlarge(frame, zoom / frame.zoom, frame.room.center());
    }

    /// Moves the image so that its point `held` is at a point of the screen, as long as some of it stays in sight.
    pub(crate) fn hold(&mut self, frame: &Frame, held: Vec2, at: Pos2) {
        self.zoom = Some(frame.zoom);
        let limit = 0.5 * frame.size;
        self.offset = (held - (at - frame.room.center()) / frame.zoom - limit).clamp(-limit, limit);
    }
}

impl Frame {
    /// Where the image is, in whole or beyond the window.
    pub(crate) fn image(&self) -> Rect {
        Rect::from_min_size(self.screen_from_image(Vec2::ZERO), self.size * self.zoom)
    }

    pub(crate) fn screen_from_image(&self, at: Vec2) -> Pos2 {
        self.room.center() + (at - self.middle) * self.zoom
    }

    pub(crate) fn image_from_screen(&self, at: Pos2) -> Vec2 {
        (at - self.room.center()) / self.zoom + self.middle
    }

    /// The pixel at a point of the screen: column and row.
    pub(crate) fn pixel(&self, at: Pos2) -> Option<(usize, usize)> {
        let at = self.image_from_screen(at);
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size.x && at.y < self.size.y;
        inside.then_some((at.x as usize, at.y as usize))
    }

    /// Where on the screen a point in front of the camera is.
    pub(crate) fn screen_from_world(&self, camera: &relume::Camera, point: glam::Vec3) -> Option<Pos2> {
        let (at, _) = camera.project(point, self.size.x as usize, self.size.y as usize)?;
        Some(self.screen_from_image(vec2(at.x, at.y)))
    }

    /// Unit, from the camera through a point of the screen.
    pub(crate) fn direction(&self, camera: &relume::Camera, at: Pos2) -> glam::Vec3 {
        let at = self.image_from_screen(at);
        camera.direction(at.x, at.y, self.size.x as usize, self.size.y as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::pos2;

    const ROOM: Rect = Rect { min: pos2(100.0, 50.0), max: pos2(1100.0, 650.0) };

    #[test]
    fn images_fit_in_the_middle() {
        let frame = Framing::default().frame(ROOM, (640, 480));
        assert_eq!((frame.zoom, frame.image().center()), (1.25, ROOM.center()));
        assert_eq!(frame.image().height(), ROOM.height());
        assert_eq!(frame.pixel(ROOM.center()), Some((320, 240)));
        assert_eq!(frame.pixel(pos2(101.0, 300.0)), None, "beside the image");
    }

    #[test]
    fn what_is_under_the_pointer_stays_there() {
        let (mut framing, at) = (Framing::default(), pos2(700.0, 200.0));
        let before = framing.frame(ROOM, (640, 480)).image_from_screen(at);
        for by in [1.5, 3.0, 0.2] {
            let frame = framing.frame(ROOM, (640, 480));
            framing.enlarge(&frame, by, at);
            let after = framing.frame(ROOM, (640, 480)).image_from_screen(at);
            assert!((after - before).length() < 1e-2, "{before} {after}");
        }
        let frame = framing.frame(ROOM, (640, 480));
        framing.enlarge(&frame, 1e9, at);
        assert_eq!(framing.frame(ROOM, (640, 480)).zoom, *ZOOMS.end());
        framing.fit();
        assert_eq!(framing.frame(ROOM, (640, 480)).zoom, 1.25);
    }

    #[test]
    fn a_pan_follows_the_pointer_and_keeps_the_image_in_sight() {
        let mut framing = Framing::default();
        let frame = framing.frame(ROOM, (640, 480));
        let held = frame.image_from_screen(pos2(400.0, 300.0));
        framing.hold(&frame, held, pos2(460.0, 280.0));
        let after = framing.frame(ROOM, (640, 480));
        assert!((after.image_from_screen(pos2(460.0, 280.0)) - held).length() < 1e-3);
        framing.hold(&after, held, pos2(1e6, 280.0));
        assert!(framing.frame(ROOM, (640, 480)).image().intersects(ROOM));
    }
}
