//! The worker that relights: the window never waits for it, and it never works for long on what nobody wants to see any more.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::{Duration, Instant};

use relume::image::{Image, Layers};
use relume::relight::{FrameStats, RelightSettings};
use relume::{Error, LightRig, Progress, Relighter, Transfer};

use crate::develop::{Print, Recipe};
use crate::mailbox::{Found, Mailbox};

/// How long a light that is dragged must rest until its full frame is begun: frames that come every 16 ms do not start it.
const REST: Duration = Duration::from_millis(120);

/// A picture that is wanted.
#[derive(Clone)]
pub(crate) struct Order {
    pub(crate) transfer: Arc<Transfer>,
    pub(crate) rig: LightRig,
    /// Whether each light's layers are to be shown.
    pub(crate) per_light: bool,
    /// Whether the albedo is.
    pub(crate) albedo: bool,
    /// Whether something is being dragged: a coarse frame comes first, and the full one once no newer order comes.
    pub(crate) dragging: bool,
    /// When the edit was made; `None` for a picture of the same lights.
    pub(crate) asked: Option<Instant>,
    /// How it will be shown, so that it need not be asked for again.
    pub(crate) recipe: Recipe,
}

/// A picture, as it was to be shown when it was ordered.
pub(crate) struct Lit {
    pub(crate) frame: Arc<Frame>,
    pub(crate) recipe: Recipe,
    pub(crate) print: Print,
}

/// A picture.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) transfer: Arc<Transfer>,
    pub(crate) rig: LightRig,
    pub(crate) layers: Layers,
    pub(crate) albedo: Option<Image>,
    pub(crate) stats: FrameStats,
    /// Whether it is a coarse one.
    pub(crate) preview: bool,
    pub(crate) asked: Option<Instant>,
}

/// The worker, for as long as this lives.
pub(crate) struct Lighting {
    orders: Arc<Mailbox<Order>>,
    frames: Receiver<Result<Lit, Error>>,
    has_failed: Cell<bool>,
}

impl Lighting {
    /// Starts it; `wake` is called whenever there is something to [`Self::next`].
    pub(crate) fn start(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let orders = Arc::new(Mailbox::default());
        let (sender, frames) = channel();
        let worker =
            Worker { orders: Arc::clone(&orders), frames: sender, wake: Box::new(wake), relighter: None };
        std::thread::Builder::new().name("lighting".to_owned()).spawn(move || worker.run())?;
        Ok(Self { orders, frames, has_failed: Cell::new(false) })
    }

    /// Wants another picture; what was wanted before is forgotten.
    pub(crate) fn order(&self, order: Order) {
        self.orders.put(order);
    }

    /// The next picture that is there, or why there is none.
    pub(crate) fn next(&self) -> Option<Result<Lit, Error>> {
        match self.frames.try_recv() {
            Ok(frame) => Some(frame),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.has_failed.set(true);
                None
            }
        }
    }

    /// Whether the worker has come to an end that nothing here foresees: no more pictures will come.
    pub(crate) fn has_failed(&self) -> bool {
        self.has_failed.get()
    }
}

impl Drop for Lighting {
    fn drop(&mut self) {
        self.orders.close();
    }
}

struct Worker {
    orders: Arc<Mailbox<Order>>,
    frames: Sender<Result<Lit, Error>>,
    wake: Box<dyn Fn() + Send>,
    relighter: Option<Relighter>,
}

/// Stops a frame for which there is a newer order.
struct Abandon<'a>(&'a Mailbox<Order>);

impl Progress for Abandon<'_> {
    fn cancelled(&self) -> bool {
        self.0.is_waiting()
    }
}

impl Worker {
    fn run(mut self) {
        let mut next = self.orders.take();
        while let Some(order) = next {
            next = self.fill(order);
        }
    }

    /// Does an order, and returns the next one; `None` where there will be none.
    fn fill(&mut self, order: Order) -> Option<Order> {
        if order.dragging {
            // Not abandoned: while edits come faster than frames are made, there would be none at all.
            self.light(&order, true);
            match self.orders.take_within(REST) {
                Found::Letter(newer) => return Some(newer),
                Found::Closed => return None,
                Found::Nothing => {}
            }
        }
        self.light(&order, false);
        self.orders.take()
    }

    fn light(&mut self, order: &Order, preview: bool) {
        let known = self.relighter.take_if(|relighter| std::ptr::eq(relighter.transfer(), &*order.transfer));
        let relighter =
            self.relighter.insert(known.unwrap_or_else(|| Relighter::new(Arc::clone(&order.transfer))));
        let settings = RelightSettings { preview, per_light: order.per_light, ..RelightSettings::default() };
        let lit = if preview {
            relighter.relight(&order.rig, &settings)
        } else {
            relighter.relight_watched(&order.rig, &settings, &Abandon(&self.orders))
        };
        let frame = match lit {
            Err(Error::Cancelled) => return,
            Err(error) => Err(error),
            Ok(layers) => {
                let frame = Arc::new(Frame {
                    transfer: Arc::clone(&order.transfer),
                    rig: order.rig.clone(),
                    albedo: order.albedo.then(|| relighter.albedo()),
                    stats: *relighter.stats(),
                    layers,
                    preview,
                    // what follows a coarse frame is the same edit, which was seen
                    asked: order.asked.filter(|_| preview || !order.dragging),
                });
                Ok(Lit { print: order.recipe.print(&frame), recipe: order.recipe.clone(), frame })
            }
        };
        // a window that has closed wants no more pictures
        if self.frames.send(frame).is_ok() {
            (self.wake)();
        }
    }
}
