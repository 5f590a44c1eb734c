//! Threads and the clock, and what stands in for them in a browser's WebAssembly, which has neither.

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
pub use self::native::{Instant, Pool};
#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub use self::web::{Instant, Pool};

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
mod native {
    pub use std::time::Instant;

    use crate::error::{Error, Result};

    /// Threads to work on.
    #[derive(Debug)]
    pub struct Pool(rayon::ThreadPool);

    impl Pool {
        /// So many threads.
        pub fn new(threads: usize) -> Result<Self> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map(Self).map_err(|error| Error::Threads(error.to_string()))
        }

        /// Has the threads do some work, and waits for it.
        pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
            self.0.install(work)
        }

        /// Has the threads do some work, and does not wait for it, which must not panic.
        pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
            self.0.spawn(work);
        }
    }
}

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
mod web {
    use std::time::Duration;

    use crate::error::Result;

    /// The thread that calls, whatever number is asked for: parallel iterators of rayon's run on it, too.
    #[derive(Debug)]
    pub struct Pool;

    impl Pool {
        /// No thread but that which calls.
        pub fn new(_threads: usize) -> Result<Self> {
            Ok(Self)
        }

        /// Does some work.
        pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
            work()
        }

        /// Does some work, at once.
        pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
            work();
        }
    }

    /// A clock that stands still; whoever loads the module has a clock of its own.
    #[derive(Debug, Clone, Copy)]
    pub struct Instant;

    impl Instant {
        /// Now.
        pub fn now() -> Self {
            Self
        }

        /// No time.
        pub fn elapsed(&self) -> Duration {
            Duration::ZERO
        }
    }
}
