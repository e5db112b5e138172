//! Arrays that are either owned or lie in a mapped file.

use std::ops::Deref;
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;

/// An array of plain values: owned, or a part of a mapped cache file.
#[derive(Clone, Debug)]
pub enum Buffer<T> {
    /// In memory.
    Owned(Vec<T>),
    /// In a file; `bytes` are a whole number of aligned values.
    Mapped {
        /// The file.
        map: Arc<Mmap>,
        /// First byte and the byte after the last.
        bytes: (usize, usize),
    },
}

impl<T: Pod> Buffer<T> {
    /// The part `bytes` of `map`; copied if it is not aligned for `T`. `None` where it is out of range or holds no
    /// whole number of values.
    pub(super) fn from_map(map: &Arc<Mmap>, bytes: (usize, usize)) -> Option<Self> {
        let part = map.get(bytes.0..bytes.1)?;
        if part.len() % size_of::<T>() != 0 {
            return None;
        }
        match bytemuck::try_cast_slice::<u8, T>(part) {
            Ok(_) => Some(Self::Mapped { map: Arc::clone(map), bytes }),
            Err(_) => Some(Self::Owned(bytemuck::pod_collect_to_vec(part))),
        }
    }
}

impl<T: Pod> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Owned(values) => values,
            Self::Mapped { map, bytes } => bytemuck::cast_slice(&map[bytes.0..bytes.1]),
        }
    }
}

impl<T> From<Vec<T>> for Buffer<T> {
    fn from(values: Vec<T>) -> Self {
        Self::Owned(values)
    }
}

impl<T> Default for Buffer<T> {
    fn default() -> Self {
        Self::Owned(Vec::new())
    }
}
