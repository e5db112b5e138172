//! A preparation that runs beside whoever started it.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::{Preparation, Transfer};
use crate::scene::Scene;
use crate::{Error, Progress, Result};

/// A preparation at work on threads of its own, so that its caller can relight meanwhile: how far it is, the best transfer so far, and ways to
/// pause and to end it. Dropping it asks it to end and does not wait.
///
/// ```no_run
/// # use std::sync::Arc;
/// # use relume::{Preparation, transfer::Preparing};
/// # fn relight_with(_: &relume::Transfer) {}
/// # fn main() -> relume::Result<()> {
/// # let scene = Arc::new(relume::scene::Scene::default());
/// let preparing = Preparing::start(scene, 0, |scene| Preparation::new(scene).size(640, 480))?;
/// let mut seen = 0;
/// while !preparing.is_finished() {
///     let status = preparing.status();
///     println!("{}: {} of {}", status.stage, status.done, status.of);
///     if let Some(transfer) = preparing.current().filter(|_| status.transfers > seen) {
///         seen = status.transfers;
///         relight_with(&transfer); // coarse at first
///     }
///     std::thread::sleep(std::time::Duration::from_millis(50));
/// }
/// relight_with(&*preparing.wait()?);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Preparing {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<Result<Arc<Transfer>>>>,
}

/// How far a preparation is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// The stage at work; empty before the first one and after the last.
    pub stage: String,
    /// Steps of the stage that are done,
    pub done: u64,
    /// of so many.
    pub of: u64,
    /// Transfers that are there: [`Preparing::current`] returns the last of them.
    pub transfers: u32,
    /// Whether it rests.
    pub paused: bool,
}

#[derive(Debug, Default)]
struct Shared {
    cancelled: AtomicBool,
    done: AtomicU64,
    state: Mutex<State>,
    resumed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    stage: String,
    of: u64,
    current: Option<Arc<Transfer>>,
    transfers: u32,
    paused: bool,
}

impl Shared {
    /// What a panicking thread held is still whole: every change is a single assignment.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, transfer: Arc<Transfer>) {
        let mut state = self.state();
        state.current = Some(transfer);
        state.transfers += 1;
    }
}

impl Progress for Shared {
    fn stage(&self, name: &str, steps: u64) {
        let mut state = self.state();
        name.clone_into(&mut state.stage);
        state.of = steps;
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    /// Asked often, so that this is where a paused preparation rests.
    fn cancelled(&self) -> bool {
        let mut state = self.state();
        while state.paused && !self.cancelled.load(Ordering::Relaxed) {
            state = self.resumed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl Preparing {
    /// Starts what `configure` makes of the scene, in steps ([`Preparation::run_in_steps`]), on so many threads; 0 stands for one a processor.
    ///
    /// # Errors
    /// [`Error::Io`] where the system gives no threads. What is wrong with scene or settings comes from [`Self::wait`].
    pub fn start<F>(scene: Arc<Scene>, threads: usize, configure: F) -> Result<Self>
    where
        F: for<'a> FnOnce(&'a Scene) -> Preparation<'a> + Send + 'static,
    {
        let shared = Arc::new(Shared::default());
        let no_threads =
            |error| Error::io("threads for the preparation", "start", std::io::Error::other(error));
        // not the pool of the caller, whose frames would wait for blocks, and for ever while the preparation rests
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|number| format!("preparation {number}"))
            .build()
            .map_err(no_threads)?;
        let work = {
            let shared = Arc::clone(&shared);
            move || {
                let told = Arc::clone(&shared);
                let show = move |transfer| {
                    told.show(Arc::new(transfer));
                    Ok(())
                };
                let whole = pool.install(|| configure(&scene).run_in_steps(&*shared, show)).map(Arc::new);
                if let Ok(whole) = &whole {
                    shared.show(Arc::clone(whole));
                }
                shared.stage("", 0);
                whole
            }
        };
        let thread = std::thread::Builder::new().name("preparation".to_owned()).spawn(work);
        let thread = thread.map_err(|error| Error::io("threads for the preparation", "start", error))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// How far it is.
    pub fn status(&self) -> Status {
        let state = self.shared.state();
        Status {
            stage: state.stage.clone(),
            done: self.shared.done.load(Ordering::Relaxed).min(state.of),
            of: state.of,
            transfers: state.transfers,
            paused: state.paused,
        }
    }

    /// The best transfer so far.
    pub fn current(&self) -> Option<Arc<Transfer>> {
        self.shared.state().current.clone()
    }

    /// Lets it rest, or go on. It rests once its threads are done with the blocks at hand.
    pub fn pause(&self, paused: bool) {
        self.shared.state().paused = paused;
        self.shared.resumed.notify_all();
    }

    /// Asks it to end, paused or not.
    pub fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
        // whoever is about to wait has asked before, or sees this
        drop(self.shared.state());
        self.shared.resumed.notify_all();
    }

    /// Whether it has ended, well or not: [`Self::wait`] returns at once.
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the last transfer; one that rests goes on.
    ///
    /// # Errors
    /// As of [`Preparation::run`]; [`Error::Cancelled`] after [`Self::cancel`].
    ///
    /// # Panics
    /// If the preparation did.
    pub fn wait(mut self) -> Result<Arc<Transfer>> {
        self.pause(false);
        let outcome = self.thread.take().map(JoinHandle::join);
        match outcome {
            Some(Ok(outcome)) => outcome,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Err(Error::Cancelled),
        }
    }
}

impl Drop for Preparing {
    fn drop(&mut self) {
        if self.thread.is_some() {
            self.cancel();
        }
    }
}
