//! The search of `phasestereo` on a GPU, with the same bits.
//!
//! [`Gpu`] is an [`Engine`]: a matcher that has one asks it for the candidates of each chunk of bands; the
//! processor does the rest, including every chunk that the GPU does not support. `phasestereo::Matcher` has
//! the same method:
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use phasestereo_gpu::Gpu;
//! use phasestereo_match::matcher::Matcher;
//! use phasestereo_match::optimization::engine::Engine;
//!
//! let gpu = Arc::new(Gpu::new(None)?);
//! let matcher = Matcher::new(2)?.with_engine(gpu.clone());
//! // match pairs ...
//! if let Some(reason) = gpu.failure() {
//!     eprintln!("the processor took over: {reason}");
//! }
//! # Ok::<(), phasestereo_match::base::error::Error>(())
//! ```
//!
//! It supports the same chunks as [`tasks::choose`], such as the searches of the presets `fast` and `robust`,
//! and leaves those that do not fit its memory to the processor.
//!
//! The feature `python` turns it into the extension module of the Python distribution `phasestereo-gpu`.
//!
//! [`SHADER`] contains and describes all kernels. It does not need any optional feature of WebGPU. All
//! arithmetic is on integers, so a driver either computes the bits of the core or is wrong; the tests here
//! compare the two on any adapter, for example Mesa's lavapipe, which does not need a GPU.

mod device;
mod kernels;
#[cfg(feature = "python")]
mod python;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::Mutex;

use phasestereo_match::base::error::Result;
use phasestereo_match::optimization::engine::{Chunk, Engine};
use phasestereo_match::optimization::evidence::Evidence;
use phasestereo_match::optimization::kernels::{MOST_BYTES, SHADER};
use phasestereo_match::optimization::tasks::{self, Limits, Task};

pub use self::device::{Adapter, Kind, adapters};

use self::device::Device;
use self::kernels::Memory;

/// A GPU that searches. Any number of threads may use one; it works on one chunk at a time.
#[derive(Debug)]
pub struct Gpu {
    device: Device,
    memory: Mutex<Memory>,
    most_bytes: u64,
}

impl Gpu {
    /// The first adapter whose name contains `name`, in any letter case; `None`: the first one that is not a
    /// processor, discrete ones before others. If no adapter has this name, the error lists the adapters; if
    /// it cannot be opened, the error has the reason.
    pub fn new(name: Option<&str>) -> Result<Self> {
        let (device, memory) = (Device::open(name)?, Mutex::new(Memory::new(SHADER)));
        Ok(Self { device, memory, most_bytes: MOST_BYTES })
    }

    /// Limits each of the volumes of costs and totals, of which `"so"` has two and `"sgm"` three, to this
    /// many bytes; the default is 256 MiB. Chunks are cut into parts to fit.
    pub fn with_memory(self, most_bytes: u64) -> Self {
        Self { most_bytes, ..self }
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.device.adapter
    }

    /// The limits of the device.
    pub fn limits(&self) -> Limits {
        let limits = self.device.limits();
        let threads = limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x);
        let buffer = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        Limits { threads: threads.into(), buffer, volume: self.most_bytes }
    }

    /// The result of the kernels for a task; `None`: it failed, and [`Engine::failure`] has the reason.
    pub fn run(&self, task: &Task) -> Option<Vec<u32>> {
        let mut memory = self.memory.lock().ok()?;
        if self.failure().is_some() {
            return None;
        }
        memory.run(&self.device, task)
    }
}

impl Engine for Gpu {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        if self.failure().is_some() {
            return Ok(false);
        }
        tasks::choose(rows, chunk, self.limits(), evidence, |task| self.run(task))
    }

    /// The device was lost, had too little memory, or did not answer for a minute. From then on it is not
    /// used again.
    fn failure(&self) -> Option<String> {
        self.device.failure()
    }
}
