//! The worker that path traces, for as long as the reference is looked at.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use relume::image::Image;
use relume::reference::{Progressive, Settings};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::{Error, LightRig, Progress, Result, Scene};

use crate::lighting::Frame;
use crate::mailbox::Mailbox;

/// Paths a pixel of the first pass; each pass has as many as all before.
const FIRST: u32 = 4;
/// When it is good enough.
const MOST: u32 = 4096;

/// A reference that is wanted.
#[derive(Clone)]
pub(crate) struct Order {
    pub(crate) scene: Arc<Scene>,
    pub(crate) camera: usize,
    /// The relit image of the same lights.
    pub(crate) lit: Arc<Frame>,
}

/// One that is there.
pub(crate) struct Truth {
    pub(crate) scene: Arc<Scene>,
    pub(crate) rig: LightRig,
    pub(crate) image: Arc<Image>,
    /// Paths a pixel.
    pub(crate) paths: u32,
    /// Relative L2 of the image's own noise.
    pub(crate) noise: f64,
}

/// The worker, for as long as this lives.
pub(crate) struct PathTracing {
    orders: Arc<Mailbox<Option<Order>>>,
    truths: Receiver<Result<Truth>>,
}

impl PathTracing {
    /// Starts it; `wake` is called whenever there is something to [`Self::next`].
    pub(crate) fn start(wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<Self> {
        let orders = Arc::new(Mailbox::default());
        let (sender, truths) = channel();
        // not the pool of frames, which would wait for its tiles
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(rayon::current_num_threads())
            .thread_name(|number| format!("path tracing {number}"))
            .build();
        let pool = pool.map_err(std::io::Error::other)?;
        let worker = Worker { orders: Arc::clone(&orders), truths: sender, wake: Box::new(wake) };
        std::thread::Builder::new().name("path tracing".to_owned()).spawn(move || worker.run(&pool))?;
        Ok(Self { orders, truths })
    }

    /// Begins another reference, or with `None` ends the one at work.
    pub(crate) fn order(&self, order: Option<Order>) {
        self.orders.put(order);
    }

    /// The newest one since the last call.
    pub(crate) fn next(&self) -> Option<Result<Truth>> {
        self.truths.try_iter().last()
    }
}

impl Drop for PathTracing {
    fn drop(&mut self) {
        self.orders.close();
    }
}

struct Worker {
    orders: Arc<Mailbox<Option<Order>>>,
    truths: Sender<Result<Truth>>,
    wake: Box<dyn Fn() + Send + Sync>,
}

struct Abandon<'a>(&'a Mailbox<Option<Order>>);

impl Progress for Abandon<'_> {
    fn cancelled(&self) -> bool {
        self.0.is_waiting()
    }
}

impl Worker {
    fn run(self, pool: &rayon::ThreadPool) {
        let mut known: Option<(Arc<Scene>, Geometry, Accel)> = None;
        while let Some(order) = self.orders.take() {
            let Some(order) = order else { continue };
            let same = known.take_if(|(scene, ..)| Arc::ptr_eq(scene, &order.scene));
            let (_, geometry, accel) = known.insert(same.unwrap_or_else(|| {
                let geometry = Geometry::new(&order.scene);
                let accel = pool.install(|| Accel::new(&order.scene, &geometry));
                (Arc::clone(&order.scene), geometry, accel)
            }));
            match pool.install(|| self.refine(&order, geometry, accel)) {
                Ok(()) | Err(Error::Cancelled) => {}
                Err(error) => self.tell(Err(error)),
            }
        }
    }

    fn tell(&self, truth: Result<Truth>) {
        // a window that has closed need not be told
        let _ = self.truths.send(truth);
        (self.wake)();
    }

    /// Passes until it is good enough, or another order comes.
    fn refine(&self, order: &Order, geometry: &Geometry, accel: &Accel) -> Result<()> {
        let Order { scene, camera, lit } = order;
        let (width, height) = (lit.layers.direct.width, lit.layers.direct.height);
        let settings = Settings { width, height, camera: *camera, spp: FIRST, ..Settings::default() };
        let mut progressive = Progressive::new(settings);
        while progressive.paths() < MOST {
            let reference = progressive.refine(scene, geometry, accel, &lit.rig, &Abandon(&self.orders))?;
            let (image, noise) = (reference.layers.full(), reference.noise.full);
            let (rig, image, paths) = (lit.rig.clone(), Arc::new(image), progressive.paths());
            self.tell(Ok(Truth { scene: Arc::clone(scene), rig, image, paths, noise }));
        }
        Ok(())
    }
}
