//! Kernels, their buffers, and how a task runs on a device.

use std::collections::HashMap;

use phasestereo_match::optimization::tasks::{MOST_RADIUS, Task};
use phasestereo_match::optimization::{BAND, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, PANEL};

use crate::device::Device;

/// The shader, after the constants.
pub const SHADER: &str = include_str!("search.wgsl");

/// Threads of a workgroup, at least: those of a path, or of several. It is the width of most GPUs.
const THREADS: u32 = 32;
/// Words and columns of a workgroup that sums, and rows that it sums one after another. Not swept, for lack of
/// a device, as the next one.
const SUMMED_WORDS: u32 = 8;
const SUMMED_COLUMNS: u32 = 32;
// Some of the columns that are summed are those of windows' centers.
const _: () = assert!(SUMMED_COLUMNS > 2 * MOST_RADIUS as u32);
const SUMMED_ROWS: u32 = 64;
/// Columns of a workgroup that chooses.
const CHOSEN_COLUMNS: u32 = 64;

/// Task, left and right codes, pixels; costs, totals, totals from below, and what is found.
const BUFFERS: usize = 8;
const FOUND: usize = BUFFERS - 1;

/// What is kept from one task to the next.
#[derive(Debug)]
pub struct Memory {
    shader: &'static str,
    /// Kernels by the words of the candidates of a pixel.
    kernels: HashMap<u32, Kernels>,
    /// Each is replaced when a task needs a larger one.
    buffers: [Option<wgpu::Buffer>; BUFFERS],
    /// What the processor reads.
    read: Option<wgpu::Buffer>,
}

/// The kernels for a number of words, in the order in which they run.
#[derive(Debug)]
struct Kernels {
    layout: wgpu::BindGroupLayout,
    /// Paths of a workgroup.
    paths: u32,
    aggregate: wgpu::ComputePipeline,
    along_rows: wgpu::ComputePipeline,
    climb_columns: wgpu::ComputePipeline,
    fall_columns: wgpu::ComputePipeline,
    choose: wgpu::ComputePipeline,
}

/// Paths of a workgroup, where each has this many threads.
fn paths(words: u32) -> u32 {
    (THREADS / words).max(1)
}

impl Memory {
    pub fn new(shader: &'static str) -> Self {
        Self { shader, kernels: HashMap::new(), buffers: Default::default(), read: None }
    }

    /// What is found for a task; `None`: the device failed.
    pub fn run(&mut self, device: &Device, task: &Task) -> Option<Vec<u32>> {
        let kernels = self
            .kernels
            .entry(task.words())
            .or_insert_with(|| Kernels::new(device, self.shader, task.words()));
        let volume = task.volume_bytes();
        let from_below = if task.is_along_columns() { volume } else { 4 };
        let found = 4 * task.found_words() as u64;
        let inputs = [bytemuck::cast_slice(&task.numbers), task.left, task.right, task.pixels];
        let sizes = inputs.map(|bytes| bytes.len() as u64);
        let sizes = sizes.into_iter().chain([volume, volume, from_below, found]);

        let usages =
            [wgpu::BufferUsages::UNIFORM].into_iter().chain([wgpu::BufferUsages::STORAGE; BUFFERS - 1]);
        for ((buffer, size), usage) in self.buffers.iter_mut().zip(sizes).zip(usages) {
            let copied = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
            fit(buffer, device, size, usage | copied);
        }
        let read =
            fit(&mut self.read, device, found, wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let buffers: Vec<_> = self.buffers.iter().flatten().collect();
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
            for (kernel, [x, y, z]) in kernels.steps(task) {
                pass.set_pipeline(kernel);
                pass.dispatch_workgroups(x, y, z);
            }
        }
        encoder.copy_buffer_to_buffer(buffers[FOUND], 0, read, 0, found);
        device.queue.submit([encoder.finish()]);
        device.read(read, found)
    }
}

/// A buffer of at least this size: the one that is there, or a new one.
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
        let (device, paths) = (&device.handle, paths(words));
        let source = format!(
            "const WORDS: u32 = {words}u;\nconst PATHS: u32 = {paths}u;\nconst PANEL: i32 = {PANEL};\n\
             const BAND: i32 = {BAND};\nconst COLUMNS_AHEAD: i32 = {LOOKAHEAD_COLUMNS};\n\
             const ROWS_AHEAD: i32 = {LOOKAHEAD_ROWS};\nconst SUMMED_WORDS: u32 = {SUMMED_WORDS}u;\n\
             const SUMMED_COLUMNS: u32 = {SUMMED_COLUMNS}u;\nconst SUMMED_ROWS: i32 = {SUMMED_ROWS};\n\
             const CHOSEN_COLUMNS: u32 = {CHOSEN_COLUMNS}u;\n{shader}"
        );
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
        let whole = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        let kernel = |name| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&whole),
                module: &module,
                entry_point: Some(name),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };

        Self {
            aggregate: kernel("aggregate"),
            along_rows: kernel("along_rows"),
            climb_columns: kernel("climb_columns"),
            fall_columns: kernel("fall_columns"),
            choose: kernel("choose"),
            paths,
            layout,
        }
    }

    /// The kernels of a task, each with its workgroups.
    fn steps(&self, task: &Task) -> Vec<(&wgpu::ComputePipeline, [u32; 3])> {
        let (cols, rows) = (task.cols(), task.rows());
        let summed = SUMMED_COLUMNS - 2 * task.radius();
        let sums = [
            cols.div_ceil(summed),
            task.words().div_ceil(SUMMED_WORDS),
            task.seen_rows().div_ceil(SUMMED_ROWS),
        ];
        let mut steps = vec![(&self.aggregate, sums), (&self.along_rows, [rows.div_ceil(self.paths), 1, 1])];
        if task.is_along_columns() {
            let bands = [cols.div_ceil(self.paths), task.bands(), 1];
            steps.extend([(&self.climb_columns, bands), (&self.fall_columns, bands)]);
        }
        steps.push((&self.choose, [cols.div_ceil(CHOSEN_COLUMNS), rows, 1]));
        steps
    }
}
