//! The worker that looks through the selected light.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use eframe::egui::{Color32, ColorImage};
use relume::image::display::srgb_from_linear;
use relume::relight::look_through;
use relume::{Camera, Transfer};

use crate::mailbox::Mailbox;

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

/// The worker, for as long as this lives.
pub(crate) struct Looking {
    orders: Arc<Mailbox<Order>>,
    images: Receiver<(Arc<Transfer>, ColorImage)>,
}

impl Looking {
    /// Starts it; `wake` is called whenever there is something to [`Self::next`].
    pub(crate) fn start(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let orders = Arc::new(Mailbox::<Order>::default());
        let (sender, images) = channel();
        let waiting = Arc::clone(&orders);
        std::thread::Builder::new().name("looking".to_owned()).spawn(move || {
            while let Some(order) = waiting.take() {
                let image = order.look();
                if sender.send((order.transfer, image)).is_err() {
                    break;
                }
                wake();
            }
        })?;
        Ok(Self { orders, images })
    }

    /// Looks through another light, or the same one from elsewhere.
    pub(crate) fn order(&self, order: Order) {
        self.orders.put(order);
    }

    /// The newest image since the last call, and of what it is.
    pub(crate) fn next(&self) -> Option<(Arc<Transfer>, ColorImage)> {
        self.images.try_iter().last()
    }
}

impl Drop for Looking {
    fn drop(&mut self) {
        self.orders.close();
    }
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
