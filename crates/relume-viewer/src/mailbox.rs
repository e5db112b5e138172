//! A place for one letter, where a newer one takes the place of an older one that nobody has read.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Where a worker finds what to do next: the newest order, and none that it has come too late for.
#[derive(Debug)]
pub(crate) struct Mailbox<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Slot<T> {
    letter: Option<T>,
    closed: bool,
}

/// What a worker finds after waiting for a while.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Found<T> {
    Letter(T),
    Nothing,
    /// Nothing will come any more.
    Closed,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self { slot: Mutex::new(Slot { letter: None, closed: false }), changed: Condvar::new() }
    }
}

impl<T> Mailbox<T> {
    /// What a panicking thread held is still whole: every change is a single assignment.
    fn slot(&self) -> MutexGuard<'_, Slot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves a letter, in place of one that is still there.
    pub(crate) fn put(&self, letter: T) {
        self.slot().letter = Some(letter);
        self.changed.notify_all();
    }

    /// Whether a letter is waiting, or none will come: whoever works on an older one may stop.
    pub(crate) fn is_waiting(&self) -> bool {
        let slot = self.slot();
        slot.letter.is_some() || slot.closed
    }

    /// Waits for a letter; `None` once the box is closed.
    pub(crate) fn take(&self) -> Option<T> {
        let mut slot = self.slot();
        loop {
            if slot.closed {
                return None;
            }
            if let Some(letter) = slot.letter.take() {
                return Some(letter);
            }
            slot = self.changed.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits for a letter for so long.
    pub(crate) fn take_within(&self, time: Duration) -> Found<T> {
        let end = Instant::now() + time;
        let mut slot = self.slot();
        loop {
            if slot.closed {
                return Found::Closed;
            }
            if let Some(letter) = slot.letter.take() {
                return Found::Letter(letter);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Found::Nothing;
            }
            slot = self.changed.wait_timeout(slot, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Ends all waiting.
    pub(crate) fn close(&self) {
        self.slot().closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_letter_is_read_and_no_other() {
        let mailbox = Mailbox::default();
        mailbox.put(1);
        mailbox.put(2);
        assert!(mailbox.is_waiting());
        assert_eq!(mailbox.take(), Some(2));
        assert!(!mailbox.is_waiting());
        assert_eq!(mailbox.take_within(Duration::from_millis(1)), Found::Nothing);
        mailbox.put(3);
        assert_eq!(mailbox.take_within(Duration::ZERO), Found::Letter(3));
    }

    #[test]
    fn whoever_waits_is_woken() {
        let mailbox = Mailbox::default();
        std::thread::scope(|scope| {
            let reader =
                scope.spawn(|| (mailbox.take(), mailbox.take(), mailbox.take_within(Duration::MAX / 4)));
            mailbox.put(7);
            while mailbox.is_waiting() {
                std::thread::yield_now();
            }
            mailbox.close();
            assert_eq!(reader.join().unwrap(), (Some(7), None, Found::Closed));
        });
    }
}
