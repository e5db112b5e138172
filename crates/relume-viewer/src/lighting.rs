//! The worker that relights: the window never waits for it, and it never works for long on what nobody wants to see any more.

use std::sync::Arc;
use std::time::{Duration, Instant};

use relume::image::{Image, Layers};
use relume::relight::{FrameStats, RelightSettings};
use relume::{Error, LightRig, Relighter, Transfer};

use crate::develop::{Print, Recipe};
use crate::mailbox::Found;
use crate::worker::{Desk, Worker};

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

/// The worker.
pub(crate) type Lighting = Worker<Order, Result<Lit, Error>>;

/// Starts it; `wake` is called whenever there is a picture.
pub(crate) fn start(wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<Lighting> {
    Worker::start("lighting", wake, |desk| {
        let mut bench = Bench { desk, relighter: None };
        let mut next = desk.take();
        while let Some(order) = next {
            next = bench.fill(order);
        }
    })
}

/// Where it works.
struct Bench<'a> {
    desk: &'a Desk<Order, Result<Lit, Error>>,
    relighter: Option<Relighter>,
}

impl Bench<'_> {
    /// Does an order, and returns the next one; `None` where there will be none.
    fn fill(&mut self, order: Order) -> Option<Order> {
        if order.dragging {
            // Not abandoned: while edits come faster than frames are made, there would be none at all.
            self.light(&order, true);
            match self.desk.take_within(REST) {
                Found::Letter(newer) => return Some(newer),
                Found::Closed => return None,
                Found::Nothing => {}
            }
        }
        self.light(&order, false);
        self.desk.take()
    }

    fn light(&mut self, order: &Order, preview: bool) {
        let known = self.relighter.take_if(|relighter| std::ptr::eq(relighter.transfer(), &*order.transfer));
        let relighter =
            self.relighter.insert(known.unwrap_or_else(|| Relighter::new(Arc::clone(&order.transfer))));
        let settings = RelightSettings { preview, per_light: order.per_light, ..RelightSettings::default() };
        let lit = if preview {
            relighter.relight(&order.rig, &settings)
        } else {
            relighter.relight_watched(&order.rig, &settings, self.desk)
        };
        let frame = match lit {
            Err(Error::Cancelled) => return,
            Err(error) => return self.desk.tell(Err(error)),
            Ok(layers) => Arc::new(Frame {
                transfer: Arc::clone(&order.transfer),
                rig: order.rig.clone(),
                albedo: order.albedo.then(|| relighter.albedo()),
                stats: *relighter.stats(),
                layers,
                preview,
                // what follows a coarse frame is the same edit, which was seen
                asked: order.asked.filter(|_| preview || !order.dragging),
            }),
        };
        self.desk.tell(Ok(Lit { print: order.recipe.print(&frame), recipe: order.recipe.clone(), frame }));
    }
}
