//! Threads and memory that calls from Python share, and how many of them may use these at once.
//!
//! After a fork the child has none of its parent's threads, and whatever these were at stays half done. So a
//! pool is of one process: in any other it is neither used nor dropped, which would wait for its threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::time::Duration;
use std::{mem, process};

use pyo3::prelude::*;

use super::arguments::read_threads;
use crate::error::Result;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::Matcher;

/// Most calls at work at once in one pool; others wait for their turn. Each holds the codes of a pair; and a
/// thread that waits for others takes up the next call meanwhile, on top of its own on one stack.
const MOST_CALLS: usize = 64;

/// The pool of all calls that leave the number of threads open. It lives as long as any of them is at work:
/// threads and memory are shared by those that overlap, and none are left behind.
static SHARED: Mutex<Weak<Pool>> = Mutex::new(Weak::new());

/// Threads of this process and memory to match in.
#[derive(Debug)]
pub struct Pool {
    matcher: Matcher,
    threads: usize,
    process: u32,
    /// Calls at work.
    calls: Mutex<usize>,
    call_ended: Condvar,
}

impl Pool {
    /// So many threads of their own.
    pub fn new(threads: usize) -> Result<Arc<Self>> {
        let (matcher, process) = (Matcher::new(threads)?, process::id());
        let (calls, call_ended) = (Mutex::default(), Condvar::default());
        Ok(Arc::new(Self { matcher, threads, process, calls, call_ended }))
    }

    /// The pool for an argument `threads`: [`Workers`], a number of threads, or None for those that are shared.
    pub fn of(threads: &Bound<'_, PyAny>) -> PyResult<Arc<Self>> {
        if let Ok(workers) = threads.cast::<Workers>() {
            return Ok(workers.get().pool()?);
        }
        let count = read_threads(threads)?;
        Ok(if threads.is_none() { Self::shared(count)? } else { Self::new(count)? })
    }

    /// Locked by none but threads that hold the interpreter, as does who forks a process; and never waited for,
    /// lest one was forked by other means.
    fn shared(threads: usize) -> Result<Arc<Self>> {
        let Ok(mut shared) = SHARED.try_lock() else { return Self::new(threads) };
        let pool = shared.upgrade().filter(|pool| pool.is_ours() && pool.threads == threads);
        let pool = pool.map_or_else(|| Self::new(threads), Ok)?;
        *shared = Arc::downgrade(&pool);
        Ok(pool)
    }

    /// How many threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    fn is_ours(&self) -> bool {
        self.process == process::id()
    }

    /// A call's turn to be at work; `None` if it does not come within that time.
    pub fn turn(self: &Arc<Self>, patience: Duration) -> Option<Turn> {
        let calls = self.calls.lock().unwrap_or_else(PoisonError::into_inner);
        let waited =
            self.call_ended.wait_timeout_while(calls, patience, |calls| *calls >= MOST_CALLS);
        let (mut calls, _) = waited.unwrap_or_else(PoisonError::into_inner);
        (*calls < MOST_CALLS).then(|| {
            *calls += 1;
            Turn(Arc::clone(self))
        })
    }
}

/// The right of one call to be at work, until it is dropped.
#[derive(Debug)]
pub struct Turn(Arc<Pool>);

impl Turn {
    /// Has the threads do the work of the call; a panic shows in that nothing is ever received.
    pub fn start<T: Send + 'static>(
        self,
        control: &Arc<Control>,
        work: impl FnOnce(&Matcher, &Control) -> Result<T> + Send + 'static,
    ) -> Receiver<Result<T>> {
        let (finish, finished) = channel();
        let (pool, control) = (Arc::clone(&self.0), Arc::clone(control));
        pool.matcher.spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| work(&self.0.matcher, &control)));
            // First, so that whoever receives is the last to hold a pool of its own, and drops its memory.
            drop(self);
            if let Ok(outcome) = outcome {
                // Nobody receives what was given up.
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

/// Threads and memory that are kept from one match to the next. Any number of threads may ask for them at
/// once, of which none waits for another one.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug)]
pub struct Workers {
    pool: Arc<Pool>,
    /// That of a process that was forked since.
    forked: Mutex<Option<Arc<Pool>>>,
}

#[pymethods]
impl Workers {
    #[new]
    fn new(threads: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self { pool: Pool::new(read_threads(threads)?)?, forked: Mutex::default() })
    }

    #[getter]
    fn count(&self) -> usize {
        self.pool.threads
    }
}

impl Workers {
    /// The pool of this process: another one after a fork.
    fn pool(&self) -> Result<Arc<Pool>> {
        if self.pool.is_ours() {
            return Ok(Arc::clone(&self.pool));
        }
        // Never waited for: a thread that is not in this process may hold it.
        let Ok(mut forked) = self.forked.try_lock() else { return Pool::new(self.pool.threads) };
        if let Some(pool) = forked.as_ref().filter(|pool| pool.is_ours()) {
            return Ok(Arc::clone(pool));
        }
        let pool = Pool::new(self.pool.threads)?;
        mem::forget(forked.replace(Arc::clone(&pool)));
        Ok(pool)
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        let forked = self.forked.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        for pool in forked.into_iter().chain([Arc::clone(&self.pool)]) {
            if !pool.is_ours() {
                mem::forget(pool);
            }
        }
    }
}
