//! Thread pools and memory that calls from Python share, and the number of simultaneous calls.
//!
//! After a fork, the child process has none of its parent's threads, and their work stays half done. So a
//! pool belongs to one process: another one neither uses nor drops it, since dropping would wait for its
//! threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;
use std::{hint, mem, process};

use pyo3::prelude::*;

use crate::arguments::read_threads;
use crate::engine::Device;
use crate::failure::Result;

use phasestereo_match::base::control::Control;
use phasestereo_match::base::simd::Level;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};

/// Most calls that run in one pool at once; others wait for their turn. Each holds the codes of a pair. Also,
/// a thread that waits for others starts the next call meanwhile, on the same stack.
const MOST_CALLS: usize = 64;

/// Most bytes of working memory that a kept pool holds between calls.
const MOST_KEPT: usize = 64 << 20;

/// Bytes of a block that is freed before the first match of a pool. glibc's allocator keeps up to twice the
/// largest freed block at the end of its heap. Memory freed beyond that returns to the system, and the next
/// match takes it again, page by page: 32 % of the time of `fast` on 741 x 497, 6 to 10 % of others. Blocks
/// that were separate mappings then come from the heap, whose gaps take 3 to 4 MB more there. With half of
/// it, `fast` takes a tenth longer from 1280 x 720 on, and the peak of `robust` at 1920 x 1080 is 10 MB
/// lower.
const FREED: usize = 8 << 20;

/// Pools that calls without [`Workers`] leave to later ones: one that is used by one call at a time, and one
/// shared by all calls that do not set the number of threads.
static KEPT: Mutex<[Option<Arc<Pool>>; 2]> = Mutex::new([None, None]);

/// Threads of this process, and a matcher with its memory.
#[derive(Debug)]
pub struct Pool {
    matcher: Matcher,
    threads: usize,
    process: u32,
    /// Most bytes of working memory between calls.
    most_kept: usize,
    /// Number of running calls.
    calls: Mutex<usize>,
    call_ended: Condvar,
}

impl Pool {
    /// A pool with its own threads, which keeps all memory that a call has taken.
    pub fn new(threads: usize) -> phasestereo::Result<Arc<Self>> {
        Ok(Self::keeping(usize::MAX, threads, Matcher::new(threads)?))
    }

    /// The same, with a device that searches, if any.
    fn with_device(threads: usize, device: Option<&Arc<Device>>) -> phasestereo::Result<Arc<Self>> {
        let Some(device) = device else { return Self::new(threads) };
        let matcher = Matcher::new(threads)?.with_engine(device.clone());
        Ok(Self::keeping(usize::MAX, threads, matcher))
    }

    fn keeping(most_kept: usize, threads: usize, matcher: Matcher) -> Arc<Self> {
        // Nothing is written to it, so it takes no memory.
        drop(hint::black_box(Vec::<u8>::with_capacity(FREED)));

        let (calls, call_ended) = (Mutex::default(), Condvar::default());
        Arc::new(Self { matcher, threads, process: process::id(), most_kept, calls, call_ended })
    }

    /// The pool for an argument `threads`: [`Workers`], a number of threads of its own, or None for the
    /// shared pool.
    pub fn for_argument(threads: &Bound<'_, PyAny>) -> Result<Arc<Self>> {
        if let Ok(workers) = threads.cast::<Workers>() {
            return Ok(workers.get().pool()?);
        }

        Ok(Self::kept(read_threads(threads)?, threads.is_none())?)
    }

    /// A kept pool of this many threads, or a new one, which replaces it unless it is in use.
    ///
    /// Nobody waits for the lock: in a child forked while another thread holds it, it would never be
    /// released.
    fn kept(threads: usize, is_shared: bool) -> phasestereo::Result<Arc<Self>> {
        let fresh = || Ok(Self::keeping(MOST_KEPT, threads, Matcher::new(threads)?));
        let Ok(mut kept) = KEPT.try_lock() else {
            return fresh();
        };
        let kept = &mut kept[usize::from(is_shared)];

        if let Some(pool) = kept.as_ref().filter(|pool| pool.is_ours()) {
            // Its users hold it, too.
            let is_free = Arc::strong_count(pool) == 1;
            if pool.threads == threads && (is_free || is_shared) {
                return Ok(Arc::clone(pool));
            }
            if !is_free {
                return fresh();
            }
        }

        let pool = fresh()?;
        kept.replace(Arc::clone(&pool)).into_iter().for_each(Self::leave);
        Ok(pool)
    }

    /// Drops a pool, but leaks one of another process: dropping would wait for threads that are not here.
    fn leave(self: Arc<Self>) {
        if !self.is_ours() {
            mem::forget(self);
        }
    }

    fn is_ours(&self) -> bool {
        self.process == process::id()
    }

    /// Waits for the turn of a call to run; `None` if it does not come within `patience`.
    pub fn turn(self: &Arc<Self>, patience: Duration) -> Option<Turn> {
        let calls = self.calls.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.call_ended.wait_timeout_while(calls, patience, |calls| *calls >= MOST_CALLS);

        let (mut calls, _) = waited.unwrap_or_else(PoisonError::into_inner);
        (*calls < MOST_CALLS).then(|| {
            *calls += 1;
            Turn(Arc::clone(self))
        })
    }
}

/// The work of a call on the threads of its pool.
pub type Work = dyn FnOnce(Runtime<'_>) -> phasestereo::Result<()> + Send;

/// The permission of one call to run, until it is dropped.
#[derive(Debug)]
pub struct Turn(Arc<Pool>);

impl Turn {
    /// Starts the work of the call on the threads. If it panics, the receiver is disconnected.
    pub fn start(self, control: &Arc<Control>, work: Box<Work>) -> Receiver<phasestereo::Result<()>> {
        let (finish, finished) = channel();
        let pool = Arc::clone(&self.0);
        let control = Arc::clone(control);

        pool.matcher.spawn(move || {
            // A panic must not end rayon's thread: the process would abort.
            let execution = Execution { threads: self.0.threads, level: Level::best() };
            let runtime = Runtime { matcher: &self.0.matcher, execution, control: &control };
            let outcome = catch_unwind(AssertUnwindSafe(|| work(runtime)));
            self.0.matcher.keep_at_most(self.0.most_kept);

            // Dropped first, so that the receiver is the last to hold a pool of its own, and drops its
            // memory.
            drop(self);
            if let Ok(outcome) = outcome {
                // The caller may have given up waiting.
                let _ = finish.send(outcome);
            }
        });

        finished
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *self.0.calls.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        self.0.call_ended.notify_one();
    }
}

/// Frees the threads and working memory that calls without [`Workers`] left to later ones.
#[pyfunction]
pub fn release_memory() {
    // If a thread holds the lock, it is starting a call, which will leave something again.
    if let Ok(mut kept) = KEPT.try_lock() {
        mem::take(&mut *kept).into_iter().flatten().for_each(Pool::leave);
    }
}

/// Threads and memory that are kept from one match to the next. Any number of threads may use them at once
/// without waiting for each other.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug)]
pub struct Workers {
    pool: Arc<Pool>,
    device: Option<Arc<Device>>,
    /// The pool of a process that was forked later.
    forked: Mutex<Option<Arc<Pool>>>,
}

#[pymethods]
impl Workers {
    #[new]
    #[pyo3(signature = (threads, device=None))]
    fn new(threads: &Bound<'_, PyAny>, device: Option<Bound<'_, PyAny>>) -> Result<Self> {
        let device = device.map(Device::new).transpose()?.map(Arc::new);
        let pool = Pool::with_device(read_threads(threads)?, device.as_ref())?;
        Ok(Self { pool, device, forked: Mutex::default() })
    }

    #[getter]
    fn count(&self) -> usize {
        self.pool.threads
    }
}

impl Workers {
    /// The pool of this process: another one after a fork.
    fn pool(&self) -> phasestereo::Result<Arc<Pool>> {
        if self.pool.is_ours() {
            return Ok(Arc::clone(&self.pool));
        }

        // No waiting: a thread that does not exist in this process may hold the lock.
        let Ok(mut forked) = self.forked.try_lock() else {
            return Pool::with_device(self.pool.threads, self.device.as_ref());
        };
        if let Some(pool) = forked.as_ref().filter(|pool| pool.is_ours()) {
            return Ok(Arc::clone(pool));
        }

        let pool = Pool::with_device(self.pool.threads, self.device.as_ref())?;
        forked.replace(Arc::clone(&pool)).into_iter().for_each(Pool::leave);

        Ok(pool)
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        let forked = self.forked.get_mut().unwrap_or_else(PoisonError::into_inner).take();

        forked.into_iter().chain([Arc::clone(&self.pool)]).for_each(Pool::leave);
    }
}
