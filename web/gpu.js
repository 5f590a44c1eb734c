// Runs the core's searches on the browser's GPU. The core plans each task (rust/c/src/web.rs): the kernels,
// their buffers and workgroups.

const PATIENCE = 60_000; // milliseconds that a task may take: drivers reset a hanging device sooner
const LIMITS = [
  "maxBufferSize", "maxStorageBufferBindingSize",
  "maxComputeInvocationsPerWorkgroup", "maxComputeWorkgroupSizeX", "maxComputeWorkgroupStorageSize",
];
const DEVICES = ["auto", "cpu", "gpu"];

/**
 * Opens the GPU.
 *
 * @param {"auto" | "cpu" | "gpu"} wanted - as for `createMatcher`.
 * @returns {Promise<Gpu | null>} null: the core searches; an Error if a requested GPU cannot be opened.
 */
export async function openGpu(wanted) {
  if (!DEVICES.includes(wanted)) refuse(wanted, DEVICES.map((name) => `'${name}'`).join(", "));
  if (wanted === "cpu") return null;
  try {
    return await opened(wanted === "gpu");
  } catch (error) {
    if (wanted === "gpu") refuse(wanted, `'auto' or 'cpu' here: ${error.message}`);
    return null;
  }
}

function refuse(got, accepts) {
  throw new Error(`device: got '${got}'; accepts ${accepts}`);
}

async function opened(isSoftwareAccepted) {
  if (!navigator.gpu) throw new Error("the browser has no WebGPU");
  // Lets WebAssembly wait for asynchronous calls.
  if (!WebAssembly.Suspending) throw new Error("the browser has no JavaScript Promise Integration");
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Error("the browser offers no adapter");
  // Slower than the core.
  const isSoftware = adapter.info.isFallbackAdapter ?? adapter.isFallbackAdapter;
  if (isSoftware && !isSoftwareAccepted) throw new Error("the adapter is software");

  const requiredLimits = Object.fromEntries(LIMITS.map((name) => [name, adapter.limits[name]]));
  return new Gpu(adapter.info, await adapter.requestDevice({ requiredLimits }));
}

class Gpu {
  /** The name of the adapter. */
  name;
  /** Threads of a workgroup, and bytes of a buffer. */
  limits;
  /** Number of finished tasks. */
  tasks = 0;
  /** Why it no longer searches. */
  failure = "";
  #device;
  #lost;
  #kernels = new Map(); // by words
  #buffers = []; // by binding, each replaced when a task needs a larger one; then the one that is read

  constructor({ description, vendor, architecture }, device) {
    this.name = description || `${vendor} ${architecture}`.trim() || "WebGPU";
    const most = device.limits;
    this.limits = {
      threads: Math.min(most.maxComputeInvocationsPerWorkgroup, most.maxComputeWorkgroupSizeX),
      buffer: Math.min(most.maxBufferSize, most.maxStorageBufferBindingSize),
    };
    this.#device = device;
    this.#lost = device.lost.then(({ message, reason }) => {
      throw new Error(`device lost: ${message || reason}`);
    });
    this.#lost.catch(() => {}); // the next task reports it
  }

  /**
   * Runs a task, and writes the results of its kernels.
   *
   * @param {object} plan - from the core.
   * @param {(place: [number, number]) => Uint8Array} bytes - at a place of the core's memory.
   * @returns {Promise<string>} the reason for a failure; empty on success.
   */
  async search(plan, bytes) {
    if (this.failure) return this.failure;
    let timer = 0;
    const late = new Promise((_, reject) => {
      timer = setTimeout(() => reject(new Error(`no answer in ${PATIENCE / 1000} seconds`)), PATIENCE);
    });
    try {
      const read = await Promise.race([this.#run(plan, bytes), this.#lost, late]);
      const found = bytes(plan.found);
      found.set(new Uint8Array(read.getMappedRange(0, found.length)));
      read.unmap();
      this.tasks++;
    } catch (error) {
      [this.failure] = (error.message || error.name).split("\n"); // a stack trace follows
      this.#device.destroy();
    }
    clearTimeout(timer);
    return this.failure;
  }

  /** The buffer to read, mapped, once everything has finished without an error. */
  async #run(plan, bytes) {
    const device = this.#device;
    const scopes = ["validation", "out-of-memory", "internal"];
    for (const scope of scopes) device.pushErrorScope(scope);

    const { COPY_DST, COPY_SRC, MAP_READ, STORAGE, UNIFORM } = GPUBufferUsage;
    const buffers = plan.sizes.map((size, binding) =>
      this.#fit(binding, size, COPY_DST | COPY_SRC | (binding === 0 ? UNIFORM : STORAGE)));
    const [[, length], last] = [plan.found, buffers.at(-1)];
    const read = this.#fit(buffers.length, length, COPY_DST | MAP_READ);
    plan.inputs.forEach((place, binding) => device.queue.writeBuffer(buffers[binding], 0, bytes(place)));

    const { layout, compiled } = this.#kernelsOf(plan, bytes);
    const entries = buffers.map((buffer, binding) => ({ binding, resource: { buffer } }));
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    pass.setBindGroup(0, device.createBindGroup({ layout, entries }));
    plan.kernels.forEach((kernel, step) => {
      pass.setPipeline(compiled(kernel));
      pass.dispatchWorkgroups(...plan.groups[step]);
    });
    pass.end();
    encoder.copyBufferToBuffer(last, 0, read, 0, length);
    device.queue.submit([encoder.finish()]);

    const errors = scopes.map(() => device.popErrorScope());
    const done = await Promise.allSettled([...errors, read.mapAsync(GPUMapMode.READ, 0, length)]);
    const error = done.map(({ value, reason }) => value ?? reason).find(Boolean);
    if (error) throw error;
    return read;
  }

  /** A buffer of at least this size: the existing one, or a new one. */
  #fit(at, size, usage) {
    const kept = this.#buffers[at];
    if (kept?.size >= size) return kept;
    kept?.destroy();
    return (this.#buffers[at] = this.#device.createBuffer({ size, usage }));
  }

  /** The kernels for a number of words, which are compiled when a task first runs them. */
  #kernelsOf({ words, source, inputs, sizes }, bytes) {
    if (!this.#kernels.has(words)) {
      const device = this.#device;
      const module = device.createShaderModule({ code: new TextDecoder().decode(bytes(source)) });
      const type = (binding) => {
        if (binding === 0) return "uniform";
        return binding < inputs.length ? "read-only-storage" : "storage";
      };
      const entries = sizes.map((_, binding) =>
        ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type: type(binding) } }));
      const layout = device.createBindGroupLayout({ entries });
      const whole = device.createPipelineLayout({ bindGroupLayouts: [layout] });
      const pipelines = new Map();
      const compiled = (entryPoint) => {
        if (!pipelines.has(entryPoint)) {
          const compute = { module, entryPoint };
          pipelines.set(entryPoint, device.createComputePipeline({ layout: whole, compute }));
        }
        return pipelines.get(entryPoint);
      };
      this.#kernels.set(words, { layout, compiled });
    }
    return this.#kernels.get(words);
  }
}
