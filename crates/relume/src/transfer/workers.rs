//! Blocks side by side: on as many threads at once as there are, and as memory has room for.
//!
//! Each thread takes one block after the other and keeps its memory between them. One that no longer has room, because finished blocks have
//! taken it, ends and leaves the rest to the others: none waits, and what is made does not depend on how many there are.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::memory::{Memory, too_little};
use super::needs::BlockNeeds;
use crate::Result;

/// Memory that a thread keeps from block to block.
pub(super) trait Workplace: Default {
    /// What it takes, bytes.
    fn bytes(&self) -> u64;
}

/// What `work` makes of each of `blocks` blocks, in order. It is told the block's number, and says how many bytes stay in use of what it made.
/// `stays` is how many it is expected to be for all of them.
///
/// # Errors
/// What `work` returns; [`crate::Error::Setting`] where there is no room for a single block.
pub(super) fn side_by_side<W: Workplace, T: Send>(
    blocks: usize,
    (memory, needs, stays): (Memory, BlockNeeds, u64),
    work: impl Fn(usize, &mut W) -> Result<(T, u64)> + Sync,
) -> Result<Vec<T>> {
    let threads = rayon::current_num_threads().min(blocks);
    let (room, threads) = match Room::new(memory, needs, stays, threads)? {
        Some((room, threads)) => (Some(room), threads),
        None => (None, threads),
    };
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let of_thread = |_: usize| -> Result<Vec<(usize, T)>> {
        let (mut workplace, mut done) = (W::default(), Vec::new());
        while !failed.load(Ordering::Relaxed) {
            let block = next.fetch_add(1, Ordering::Relaxed);
            if block >= blocks {
                break;
            }
            let (made, bytes) = work(block, &mut workplace)?;
            done.push((block, made));
            let is_over = next.load(Ordering::Relaxed) >= blocks;
            if let Some(room) = room.as_ref().filter(|_| !is_over)
                && !room.goes_on(workplace.bytes(), bytes)?
            {
                break;
            }
        }
        Ok(done)
    };
    let of_thread = |thread: usize| of_thread(thread).inspect_err(|_| failed.store(true, Ordering::Relaxed));
    let done: Vec<_> = (0..threads).into_par_iter().with_max_len(1).map(of_thread).collect::<Result<_>>()?;
    let mut done: Vec<(usize, T)> = done.into_iter().flatten().collect();
    done.sort_unstable_by_key(|&(block, _)| block);
    Ok(done.into_iter().map(|(_, made)| made).collect())
}

/// What is left of a limit of memory.
struct Room {
    limit: u64,
    memory: Memory,
    state: Mutex<State>,
}

/// All in bytes but the last.
struct State {
    /// In use before the first block, and what has come since that was not foreseen.
    base: u64,
    /// Of blocks that are finished.
    kept: u64,
    encoder: u64,
    /// Of a thread at work.
    workplace: u64,
    /// Threads at work.
    threads: u64,
}

impl State {
    fn needed(&self) -> u64 {
        self.base + self.kept + self.threads * self.workplace
    }
}

impl Room {
    /// And for how many threads it is, of up to `most`. `None` without a limit.
    fn new(memory: Memory, needs: BlockNeeds, stays: u64, most: usize) -> Result<Option<(Self, usize)>> {
        let Some((limit, base)) = memory.limit_and_use() else { return Ok(None) };
        let workplace = needs.bytes().max(1);
        let threads = limit.saturating_sub(base + stays) / workplace;
        if threads == 0 && most > 0 {
            return Err(too_little(base + stays + workplace, limit));
        }
        let threads = threads.min(most as u64);
        let state = State { base, kept: 0, encoder: needs.encoder, workplace, threads };
        Ok(Some((Self { limit, memory, state: Mutex::new(state) }, threads as usize)))
    }

    /// Whether a thread whose workplace takes so much, and of whose block so much is kept, may begin another one.
    fn goes_on(&self, workplace: u64, kept: u64) -> Result<bool> {
        let used = self.memory.limit_and_use().map_or(0, |(_, used)| used);
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.kept += kept;
        state.workplace = state.workplace.max(workplace + state.encoder);
        state.base += used.saturating_sub(state.needed());
        if state.needed() <= self.limit {
            return Ok(true);
        }
        if state.threads == 1 {
            return Err(too_little(state.needed(), self.limit));
        }
        state.threads -= 1;
        Ok(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Desk(u64);

    impl Workplace for Desk {
        fn bytes(&self) -> u64 {
            self.0
        }
    }

    /// A limit that is so much above what is in use; the rest of the process takes less than a gibibyte more meanwhile.
    fn above(bytes: u64) -> Memory {
        let (_, used) = Memory::new(Some(0)).limit_and_use().unwrap();
        Memory::new(Some(used + bytes))
    }

    const GIB: u64 = 1 << 30;

    /// How many of 64 blocks of `each` bytes were at work at once within `limit`, each of which leaves `kept` bytes.
    fn at_once(limit: Memory, each: u64, kept: u64) -> Result<usize> {
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let needs = BlockNeeds { rows: each, encoder: 0 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let made = pool.install(|| {
            side_by_side(64, (limit, needs, 0), |block, _: &mut Desk| {
                most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                std::thread::sleep(std::time::Duration::from_millis(2));
                now.fetch_sub(1, Ordering::SeqCst);
                Ok((block * block, kept))
            })
        })?;
        assert_eq!(made, (0..64).map(|block| block * block).collect::<Vec<_>>());
        Ok(most.into_inner())
    }

    #[test]
    fn as_many_are_at_work_as_fit() {
        assert_eq!(at_once(Memory::new(None), 64 * GIB, 0).unwrap(), 8);
        assert_eq!(at_once(above(200 * GIB), 64 * GIB, 0).unwrap(), 3);
        assert_eq!(at_once(above(100 * GIB), 64 * GIB, 0).unwrap(), 1);
        let told = at_once(above(60 * GIB), 64 * GIB, 0).unwrap_err();
        assert!(told.to_string().contains("needs about"), "{told}");
    }

    #[test]
    fn room_that_finished_blocks_take_is_no_longer_there() {
        // 100 left in the end of 292, for one more: one of four goes on
        assert!(at_once(above(292 * GIB), 64 * GIB, 3 * GIB).is_ok());
        let told = at_once(above(200 * GIB), 64 * GIB, 3 * GIB).unwrap_err();
        assert!(told.is_bad_input(), "{told}");
    }

    #[test]
    fn the_first_fault_ends_the_work() {
        let began = AtomicUsize::new(0);
        let made = side_by_side(1000, (Memory::new(None), BlockNeeds::default(), 0), |_, _: &mut Desk| {
            began.fetch_add(1, Ordering::Relaxed);
            Err::<((), u64), _>(crate::Error::Cancelled)
        });
        assert!(made.is_err() && began.into_inner() < 1000);
    }
}
