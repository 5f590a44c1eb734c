//! How a task runs on a device.

use std::collections::HashMap;

use phasestereo_match::optimization::kernels::{BUFFERS, FOUND, constants, sizes, steps};
use phasestereo_match::optimization::tasks::Task;

use crate::device::Device;

/// The state kept from one task to the next.
#[derive(Debug)]
pub struct Memory {
    shader: &'static str,
    /// Kernels by the words of the candidates of a pixel.
    kernels: HashMap<u32, Kernels>,
    /// Each is replaced when a task needs a larger one.
    buffers: [Option<wgpu::Buffer>; BUFFERS],
    /// The buffer that the processor reads.
    read: Option<wgpu::Buffer>,
}

/// The kernels for a number of words, which are compiled when a task first runs them.
#[derive(Debug)]
struct Kernels {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    whole_layout: wgpu::PipelineLayout,
    pipelines: HashMap<&'static str, wgpu::ComputePipeline>,
}

impl Memory {
    pub fn new(shader: &'static str) -> Self {
        Self { shader, kernels: HashMap::new(), buffers: Default::default(), read: None }
    }

    /// The result of a task; `None`: the device failed.
    pub fn run(&mut self, device: &Device, task: &Task) -> Option<Vec<u32>> {
        let kernels = self
            .kernels
            .entry(task.words())
            .or_insert_with(|| Kernels::new(device, self.shader, task.words()));
        let steps = steps(task);
        for (kernel, _) in &steps {
            kernels.compile(device, kernel);
        }

        let sizes = sizes(task);
        let found = sizes[FOUND];
        let usages =
            [wgpu::BufferUsages::UNIFORM].into_iter().chain([wgpu::BufferUsages::STORAGE; BUFFERS - 1]);
        for ((buffer, size), usage) in self.buffers.iter_mut().zip(sizes).zip(usages) {
            let copied = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
            fit(buffer, device, size, usage | copied);
        }
        let read =
            fit(&mut self.read, device, found, wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let buffers: Vec<_> = self.buffers.iter().flatten().collect();
        let inputs = [bytemuck::cast_slice(&task.numbers), task.left, task.right, task.pixels];
        for (buffer, bytes) in buffers.iter().zip(inputs) {
            device.queue.write_buffer(buffer, 0, bytes);
        }

        let entries: Vec<_> = (0..)
            .zip(&buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let layout = &kernels.layout;
        let group = device.handle.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        });

        let mut encoder = device.handle.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &group, &[]);
            for (kernel, [x, y, z]) in steps {
                pass.set_pipeline(&kernels.pipelines[kernel]);
                pass.dispatch_workgroups(x, y, z);
            }
        }
        encoder.copy_buffer_to_buffer(buffers[FOUND], 0, read, 0, found);
        device.queue.submit([encoder.finish()]);
        device.read(read, found)
    }
}

/// A buffer of at least this size: the existing one, or a new one.
fn fit<'a>(
    buffer: &'a mut Option<wgpu::Buffer>,
    device: &Device,
    size: u64,
    usage: wgpu::BufferUsages,
) -> &'a wgpu::Buffer {
    let kept = buffer.take().filter(|buffer| buffer.size() >= size);
    buffer.insert(kept.unwrap_or_else(|| {
        let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        device.handle.create_buffer(&descriptor)
    }))
}

impl Kernels {
    fn new(device: &Device, shader: &str, words: u32) -> Self {
        let device = &device.handle;
        let source = format!("{}{shader}", constants(words));
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });

        let buffer = |binding: u32| {
            let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
            let ty = if binding == 0 { wgpu::BufferBindingType::Uniform } else { storage(binding < 4) };
            wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
                count: None,
            }
        };
        let entries: Vec<_> = (0..BUFFERS as u32).map(buffer).collect();
        let entries = &entries;
        let layout =
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries });
        let whole_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        Self { module, layout, whole_layout, pipelines: HashMap::new() }
    }

    fn compile(&mut self, device: &Device, kernel: &'static str) {
        self.pipelines.entry(kernel).or_insert_with(|| {
            device.handle.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(kernel),
                layout: Some(&self.whole_layout),
                module: &self.module,
                entry_point: Some(kernel),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        });
    }
}
