//! The search of `phasestereo` on a GPU, with the same bits.
//!
//! [`Gpu`] is an [`Engine`]: a matcher that has one asks it for the candidates of each chunk of bands, and
//! the processor does the rest, as well as every chunk that the GPU does not take. `phasestereo::Matcher` has
//! the same method:
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use phasestereo_gpu::Gpu;
//! use phasestereo_match::matcher::Matcher;
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
//! It takes searches by the optimizers `"so"` and `"sgm"`, by phase codes and fixed windows of up to 31
//! pixels, where a byte holds every total (as with the presets `fast` and `robust`). It leaves to the
//! processor: masks, ranges by panel, and volumes that its memory does not hold.
//!
//! `search.wgsl` has all kernels and describes them. It needs no optional feature of WebGPU. All arithmetic
//! is that of integers, so a driver either computes the bits of the core or is wrong; its
//! tests compare the two on any adapter, as Mesa's lavapipe, which needs no GPU.

mod device;
mod kernels;
mod request;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::Mutex;

use phasestereo_match::base::error::Result;
use phasestereo_match::optimization::engine::{Chunk, Engine};
use phasestereo_match::optimization::evidence::Evidence;

pub use self::device::{Adapter, Kind, adapters};

use self::device::Device;
use self::kernels::{Memory, SHADER};
use self::request::Request;

/// Bytes of the largest volume, unless [`Gpu::with_memory`] changes it: not swept, for lack of a device.
const MOST_BYTES: u64 = 256 << 20;

/// A GPU that searches. Any number of threads may use one; it works on one chunk at a time.
#[derive(Debug)]
pub struct Gpu {
    device: Device,
    memory: Mutex<Memory>,
    most_bytes: u64,
}

impl Gpu {
    /// The first adapter whose name contains `name`, whatever its letters' case; `None`: the first one that
    /// is not a processor, discrete ones before others. An error names the adapters if none is of this name, or
    /// says why it cannot be opened.
    pub fn new(name: Option<&str>) -> Result<Self> {
        let (device, memory) = (Device::open(name)?, Mutex::new(Memory::new(SHADER)));
        Ok(Self { device, memory, most_bytes: MOST_BYTES })
    }

    /// The same with at most this many bytes for each of the volumes of costs and totals, of which `"so"` has
    /// two and `"sgm"` three; by default 256 MiB. Chunks are cut into parts for that.
    pub fn with_memory(self, most_bytes: u64) -> Self {
        Self { most_bytes, ..self }
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.device.adapter
    }

    /// Why the processor has taken over: the device was lost, had too little memory, or did not answer for a
    /// minute. From then on it is not asked again. `None`: nothing failed.
    pub fn failure(&self) -> Option<String> {
        self.device.failure()
    }
}

impl Engine for Gpu {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        let request = Request::new(chunk, self.device.limits(), self.most_bytes);
        let (Some(request), None, Ok(mut memory)) = (request, self.failure(), self.memory.lock())
        else {
            return Ok(false);
        };

        evidence.begin(rows.len(), chunk.search.size.1, chunk.search.is_weighed())?;
        for part in request.parts(rows.clone()) {
            chunk.search.control.checkpoint()?;
            let first = part.start - rows.start;
            let Some(found) = memory.run(&self.device, &request.task(part.clone())) else {
                return Ok(false);
            };
            request.write(part, &found, evidence, first);
        }
        Ok(true)
    }
}
