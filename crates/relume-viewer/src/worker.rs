//! A thread that does what the window wants, newest order first.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use relume::Progress;

use crate::mailbox::{Found, Mailbox};

/// A thread at work, for as long as this lives: orders go to it, results come back, and nobody waits.
pub(crate) struct Worker<O, R> {
    orders: Arc<Mailbox<O>>,
    results: Receiver<R>,
    has_failed: Cell<bool>,
}

/// What the thread itself has: its orders, and where its results go.
pub(crate) struct Desk<O, R> {
    orders: Arc<Mailbox<O>>,
    results: Sender<R>,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl<O: Send + 'static, R: Send + 'static> Worker<O, R> {
    /// Starts it; `wake` is called whenever there is something to [`Self::next`].
    pub(crate) fn start(
        name: &str,
        wake: impl Fn() + Send + Sync + 'static,
        run: impl FnOnce(&Desk<O, R>) + Send + 'static,
    ) -> std::io::Result<Self> {
        let orders = Arc::new(Mailbox::default());
        let (sender, results) = channel();
        let desk = Desk { orders: Arc::clone(&orders), results: sender, wake: Box::new(wake) };
        std::thread::Builder::new().name(name.to_owned()).spawn(move || run(&desk))?;
        Ok(Self { orders, results, has_failed: Cell::new(false) })
    }
}

impl<O, R> Worker<O, R> {
    /// Wants something; what was wanted before and is not begun yet is forgotten.
    pub(crate) fn order(&self, order: O) {
        self.orders.put(order);
    }

    /// The next result that is there.
    pub(crate) fn next(&self) -> Option<R> {
        match self.results.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.has_failed.set(true);
                None
            }
        }
    }

    /// The newest result since the last call; those before it are forgotten.
    pub(crate) fn newest(&self) -> Option<R> {
        std::iter::from_fn(|| self.next()).last()
    }

    /// Whether the thread has come to an end that nothing here foresees: nothing more will come.
    pub(crate) fn has_failed(&self) -> bool {
        self.has_failed.get()
    }
}

impl<O, R> Drop for Worker<O, R> {
    fn drop(&mut self) {
        self.orders.close();
    }
}

impl<O, R> Desk<O, R> {
    /// Waits for an order; `None` once nothing more is wanted.
    pub(crate) fn take(&self) -> Option<O> {
        self.orders.take()
    }

    /// Waits for one for so long.
    pub(crate) fn take_within(&self, time: std::time::Duration) -> Found<O> {
        self.orders.take_within(time)
    }

    /// Hands a result over. A window that has closed wants none.
    pub(crate) fn tell(&self, result: R) {
        if self.results.send(result).is_ok() {
            (self.wake)();
        }
    }
}

/// Work stops where there is a newer order.
impl<O: Send, R: Send> Progress for Desk<O, R> {
    fn cancelled(&self) -> bool {
        self.orders.is_waiting()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn until(done: impl Fn() -> bool) {
        let end = Instant::now() + Duration::from_secs(20);
        while !done() {
            assert!(Instant::now() < end, "waited in vain");
            std::thread::yield_now();
        }
    }

    #[test]
    fn the_newest_order_is_done_and_older_ones_are_told_to_stop() {
        let worker = Worker::start(
            "doubling",
            || {},
            |desk: &Desk<u32, u32>| {
                while let Some(order) = desk.take() {
                    // as long work does, which is asked to stop
                    while order < 9 && !desk.cancelled() {
                        std::thread::yield_now();
                    }
                    if !desk.cancelled() {
                        desk.tell(2 * order);
                    }
                }
            },
        )
        .unwrap();
        for order in 1..=9 {
            worker.order(order);
        }
        let seen = Cell::new(None);
        until(|| {
            seen.set(worker.newest().or(seen.get()));
            seen.get() == Some(18)
        });
        assert!(!worker.has_failed());
    }

    #[test]
    fn a_worker_that_fails_is_noticed() {
        let worker: Worker<(), ()> = Worker::start("failing", || {}, |_| {}).unwrap();
        until(|| worker.next().is_none() && worker.has_failed());
    }
}
