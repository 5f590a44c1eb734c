//! Adapters, the device of one of them, and the first failure.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use phasestereo_match::base::error::{Error, Result};
use pollster::block_on;

/// Longest time that a part of a chunk may take: drivers reset a hanging device sooner.
const PATIENCE: Duration = Duration::from_secs(60);

/// The kind of an adapter's device; those that are tried first come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the memory of the processor.
    Integrated,
    /// A virtual GPU.
    Virtual,
    /// Of unknown kind.
    Other,
    /// A driver that computes on the processor, more slowly than the core: used only by name.
    Processor,
}

/// A device and its driver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adapter {
    /// The name of the device.
    pub name: String,
    /// The kind of the device.
    pub kind: Kind,
    /// The interface, `vulkan` or `metal`.
    pub backend: &'static str,
    /// The driver and its version, in its own words; may be empty.
    pub driver: String,
}

impl Adapter {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => Kind::Discrete,
            wgpu::DeviceType::IntegratedGpu => Kind::Integrated,
            wgpu::DeviceType::VirtualGpu => Kind::Virtual,
            wgpu::DeviceType::Other => Kind::Other,
            wgpu::DeviceType::Cpu => Kind::Processor,
        };
        let driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
        Self { name: info.name, kind, backend: info.backend.to_str(), driver }
    }
}

/// All adapters that Vulkan or Metal offers, in the order in which they are tried; empty without a loader or
/// a driver.
pub fn adapters() -> Vec<Adapter> {
    found().into_iter().map(|(adapter, _)| adapter).collect()
}

fn found() -> Vec<(Adapter, wgpu::Adapter)> {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL;
    let flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        flags,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let all = block_on(instance.enumerate_adapters(backends));
    let mut all: Vec<_> = all.into_iter().map(|adapter| (Adapter::of(&adapter), adapter)).collect();
    all.sort_by_key(|(adapter, _)| adapter.kind);
    all
}

/// Where the driver's callbacks store the first failure.
type Failure = Arc<Mutex<Option<String>>>;

fn fail(failure: &Failure, reason: String) {
    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
}

/// An open device.
#[derive(Debug)]
pub struct Device {
    pub adapter: Adapter,
    pub handle: wgpu::Device,
    pub queue: wgpu::Queue,
    failure: Failure,
}

impl Device {
    /// Opens the first adapter whose name contains `name`; `None`: the first one that is not a processor.
    pub fn open(name: Option<&str>) -> Result<Self> {
        let wanted = name.map(str::to_lowercase);
        let all = found();
        let names: Vec<_> = all.iter().map(|(adapter, _)| format!("'{}'", adapter.name)).collect();
        let is_wanted = |adapter: &Adapter| match &wanted {
            Some(part) => adapter.name.to_lowercase().contains(part),
            None => adapter.kind != Kind::Processor,
        };
        let Some((adapter, raw)) = all.into_iter().find(|(adapter, _)| is_wanted(adapter)) else {
            let accepts = match (name, names.join(", ").as_str()) {
                (_, "") => "an adapter of Vulkan or Metal, of which this machine has none".to_owned(),
                (Some(_), all) => format!("a part of the name of an adapter: {all}"),
                (None, all) => format!("a GPU; software drivers have to be named: {all}"),
            };
            return Err(Error::value("device", name.unwrap_or("gpu"), accepts));
        };

        let limits = raw.limits();
        let descriptor = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
        let (handle, queue) = block_on(raw.request_device(&descriptor)).map_err(|error| {
            Error::value("device", &adapter.name, format!("an adapter that can be opened: {error}"))
        })?;

        let failure = Failure::default();
        let (lost, wrong) = (failure.clone(), failure.clone());
        handle.set_device_lost_callback(move |_, reason| {
            fail(&lost, format!("device lost: {reason}"));
        });
        handle.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            fail(&wrong, error.to_string());
        }));
        Ok(Self { adapter, handle, queue, failure })
    }

    pub fn limits(&self) -> wgpu::Limits {
        self.handle.limits()
    }

    pub fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The first bytes of a buffer, once the submitted work is done; `None`: something failed.
    pub fn read(&self, buffer: &wgpu::Buffer, bytes: u64) -> Option<Vec<u32>> {
        let slice = buffer.slice(..bytes);
        let failure = self.failure.clone();
        slice.map_async(wgpu::MapMode::Read, move |result| {
            if let Err(error) = result {
                fail(&failure, error.to_string());
            }
        });
        let patience = wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) };
        if let Err(error) = self.handle.poll(patience) {
            fail(&self.failure, error.to_string());
        }
        if self.failure().is_some() {
            return None;
        }

        let read = slice.get_mapped_range();
        let words = read.ok().map(|view| bytemuck::pod_collect_to_vec(&view));
        buffer.unmap();
        words
    }
}
