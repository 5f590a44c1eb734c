//! Reusable buffers that start at a cache line.

use std::ops::{Deref, DerefMut};

use crate::base::error::{Error, Result};
use crate::base::value::{LANES, Lanes};

/// Bytes of a cache line: a vector register loaded from the start of a line never spans two lines.
pub const LINE: usize = 64;

/// A reusable buffer, as long as the last [`Self::resize`] asked; its values are then unspecified.
#[derive(Debug)]
pub struct Memory<T> {
    values: Vec<T>,
    start: usize,
    count: usize,
}

impl<T> Default for Memory<T> {
    fn default() -> Self {
        Self { values: vec![], start: 0, count: 0 }
    }
}

impl<T: Clone + Default> Memory<T> {
    /// A buffer of `count` values; an error as for [`Self::resize`].
    pub fn new(count: usize) -> Result<Self> {
        let mut memory = Self::default();
        memory.resize(count)?;
        Ok(memory)
    }

    /// Makes the buffer `count` values long; an error, not an abort, if the memory cannot be allocated.
    pub fn resize(&mut self, count: usize) -> Result<()> {
        let needed = count.saturating_add(LINE);
        // The start may move by up to a line.
        if let Some(missing) = needed.checked_sub(self.values.len()) {
            self.values
                .try_reserve_exact(missing)
                .map_err(|_| Error::OutOfMemory { bytes: needed.saturating_mul(size_of::<T>()) })?;
            self.values.resize(needed, T::default());
        }

        // If the size of a type does not divide a line, no element starts at one: then any start will do.
        let start = self.values.as_ptr().align_offset(LINE);
        self.start = if start < LINE { start } else { 0 };

        self.count = count;
        Ok(())
    }
}

impl<T> Deref for Memory<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        &self.values[self.start..][..self.count]
    }
}

impl<T> DerefMut for Memory<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.start..][..self.count]
    }
}

/// A reusable buffer of runs of lanes that starts at a cache line.
///
/// It is a [`Memory`] of single values, since an array's alignment is that of its values: an array of 32-byte
/// elements might never start at a line.
#[derive(Debug)]
pub struct RunMemory<T>(Memory<T>);

impl<T> Default for RunMemory<T> {
    fn default() -> Self {
        Self(Memory::default())
    }
}

impl<T: Clone + Default> RunMemory<T> {
    /// Makes the buffer `count` runs long; see [`Memory::resize`].
    pub fn resize(&mut self, count: usize) -> Result<()> {
        self.0.resize(count.saturating_mul(LANES))
    }
}

impl<T> Deref for RunMemory<T> {
    type Target = [Lanes<T>];

    #[inline(always)]
    fn deref(&self) -> &[Lanes<T>] {
        self.0.as_chunks().0
    }
}

impl<T> DerefMut for RunMemory<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [Lanes<T>] {
        self.0.as_chunks_mut().0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_starts_with_a_cache_line_and_does_not_shrink() {
        let mut memory = Memory::<u16>::default();
        assert!(memory.is_empty());

        for count in [3, 1000, 0, 70] {
            memory.resize(count).expect("memory");
            assert_eq!(memory.len(), count);
            assert_eq!(memory.as_ptr().align_offset(LINE), 0);
            memory.fill(7);
        }
        assert!(memory.values.len() >= 1000);
    }

    #[test]
    fn runs_of_lanes_start_with_a_cache_line() {
        let mut memory = RunMemory::<u8>::default();
        for count in [3, 0, 1000] {
            memory.resize(count).expect("memory");
            assert_eq!(memory.len(), count);
            assert_eq!(memory.as_ptr().addr() % LINE, 0);
        }
    }

    #[test]
    fn too_large_a_buffer_is_an_error() {
        let refused = Memory::<u64>::default().resize(usize::MAX / 2);
        assert!(matches!(refused, Err(Error::OutOfMemory { .. })));
    }
}
