//! Threads and the clock, and their replacements in browser WebAssembly, which has neither.

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
pub use self::native::{Instant, ThreadPool};
#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub use self::web::{Instant, ThreadPool};

use crate::base::error::Result;

/// Does the same for the left and the right image (sides 0 and 1) at the same time. Two threads wait for each
/// other less often than if they shared the work on each.
pub fn both<T: Send>(of: impl Fn(usize) -> Result<T> + Sync) -> Result<[T; 2]> {
    let (left, right) = rayon::join(|| of(0), || of(1));
    Ok([left?, right?])
}

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
mod native {
    pub use std::time::Instant;

    use crate::base::error::{Error, Result};

    /// Threads of rayon.
    #[derive(Debug)]
    pub struct ThreadPool(rayon::ThreadPool);

    impl ThreadPool {
        /// A pool of this many threads.
        pub fn new(threads: usize) -> Result<Self> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map(Self).map_err(|error| Error::Threads(error.to_string()))
        }

        /// Runs work on the threads and waits for it.
        pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
            self.0.install(work)
        }

        /// Starts work on the threads without waiting for it. The work must not panic.
        pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
            self.0.spawn(work);
        }
    }
}

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
mod web {
    use std::time::Duration;

    use crate::base::error::Result;

    /// Only the calling thread, whatever number is requested; rayon's parallel iterators run on it, too.
    #[derive(Debug)]
    pub struct ThreadPool;

    impl ThreadPool {
        /// Only the calling thread.
        pub fn new(_threads: usize) -> Result<Self> {
            Ok(Self)
        }

        /// Does the work.
        pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
            work()
        }

        /// Does the work at once.
        pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
            work();
        }
    }

    /// A clock that stands still: the code that loads the module measures time itself.
    #[derive(Debug, Clone, Copy)]
    pub struct Instant;

    impl Instant {
        /// Now.
        pub fn now() -> Self {
            Self
        }

        /// Always zero.
        pub fn elapsed(&self) -> Duration {
            Duration::ZERO
        }
    }
}
