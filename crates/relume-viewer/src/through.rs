//! The worker that looks through the selected light.

use std::sync::Arc;

use eframe::egui::{Color32, ColorImage};
use relume::image::display::srgb_from_linear;
use relume::relight::look_through;
use relume::{Camera, Transfer};

use crate::worker::{Desk, Worker};

/// Pixels along a side of what a light sees.
pub(crate) const SIDE: usize = 240;

/// A light to look through.
#[derive(Clone)]
pub(crate) struct Order {
    pub(crate) transfer: Arc<Transfer>,
    pub(crate) eye: Camera,
}

impl PartialEq for Order {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.transfer, &other.transfer) && self.eye == other.eye
    }
}

/// The worker; images come with what they are of.
pub(crate) type Looking = Worker<Order, (Arc<Transfer>, ColorImage)>;

/// Starts it; `wake` is called whenever there is an image.
pub(crate) fn start(wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<Looking> {
    Worker::start("looking", wake, |desk: &Desk<Order, _>| {
        while let Some(order) = desk.take() {
            let image = order.look();
            desk.tell((order.transfer, image));
        }
    })
}

impl Order {
    fn look(&self) -> ColorImage {
        let image = look_through(&self.transfer, &self.eye, SIDE, SIDE);
        let byte = |value: f32| (srgb_from_linear(value.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
        let color = |pixel: &relume::glam::Vec3| {
            let [r, g, b] = pixel.to_array().map(byte);
            Color32::from_rgb(r, g, b)
        };
        ColorImage::new([SIDE, SIDE], image.pixels.iter().map(color).collect())
    }
}
