//! The worker that path traces, for as long as the reference is looked at.

use std::sync::Arc;

use relume::image::Image;
use relume::reference::{Progressive, Settings};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::{Error, LightRig, Result, Scene};

use crate::lighting::Frame;
use crate::worker::{Desk, Worker};

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

/// The worker; an order of `None` ends the reference that is being made.
pub(crate) type PathTracing = Worker<Option<Order>, Result<Truth>>;

/// Starts it; `wake` is called whenever there is a better one.
pub(crate) fn start(wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<PathTracing> {
    // not the pool of frames, which would wait for its tiles
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(rayon::current_num_threads())
        .thread_name(|number| format!("path tracing {number}"))
        .build();
    let pool = pool.map_err(std::io::Error::other)?;
    Worker::start("path tracing", wake, move |desk: &Desk<Option<Order>, _>| {
        let mut known: Option<(Arc<Scene>, Geometry, Accel)> = None;
        while let Some(order) = desk.take() {
            let Some(order) = order else { continue };
            let same = known.take_if(|(scene, ..)| Arc::ptr_eq(scene, &order.scene));
            let (_, geometry, accel) = known.insert(same.unwrap_or_else(|| {
                let geometry = Geometry::new(&order.scene);
                let accel = pool.install(|| Accel::new(&order.scene, &geometry));
                (Arc::clone(&order.scene), geometry, accel)
            }));
            match order.refine(geometry, accel, desk, &pool) {
                Ok(()) | Err(Error::Cancelled) => {}
                Err(error) => desk.tell(Err(error)),
            }
        }
    })
}

impl Order {
    /// Passes until it is good enough, or another order comes.
    fn refine(
        &self,
        geometry: &Geometry,
        accel: &Accel,
        desk: &Desk<Option<Self>, Result<Truth>>,
        pool: &rayon::ThreadPool,
    ) -> Result<()> {
        let Self { scene, camera, lit } = self;
        let (width, height) = (lit.layers.direct.width, lit.layers.direct.height);
        let settings = Settings { width, height, camera: *camera, spp: FIRST, ..Settings::default() };
        let mut progressive = Progressive::new(settings);
        while progressive.paths() < MOST {
            let pass = || progressive.refine(scene, geometry, accel, &lit.rig, desk).cloned();
            let reference = pool.install(pass)?;
            desk.tell(Ok(Truth {
                scene: Arc::clone(scene),
                rig: lit.rig.clone(),
                image: Arc::new(reference.layers.full()),
                paths: progressive.paths(),
                noise: reference.noise.full,
            }));
        }
        Ok(())
    }
}
