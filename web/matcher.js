// Matches stereo pairs in the browser: the core runs as WebAssembly on a thread of its own, with the GPU if
// there is WebGPU, and nothing leaves the machine.

/**
 * Starts the core.
 *
 * @param {{wasm?: string | URL, device?: "auto" | "cpu" | "gpu"}} options - `wasm`: the module, relative to
 *   this file; `device`: the device that searches, with identical bits: "gpu" the browser's adapter, even
 *   software, which is slower than the core; "auto" a hardware adapter if the browser has WebGPU and
 *   JavaScript Promise Integration, else the core.
 * @returns {Promise<Matcher>} once it is loaded and warmed up; an Error if that fails.
 */
export async function createMatcher({ wasm = "phasestereo.wasm", device = "auto" } = {}) {
  const matcher = new Matcher();
  await matcher.call("load", { wasm: new URL(wasm, import.meta.url).href, device });
  return matcher;
}

class Matcher {
  #worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
  #waiting = new Map();
  #calls = 0;

  constructor() {
    this.#worker.onmessage = ({ data: { id, value, error } }) => {
      const { resolve, reject } = this.#waiting.get(id);
      this.#waiting.delete(id);
      if (error === undefined) resolve(value);
      else reject(new Error(error));
    };
    this.#worker.onerror = (event) => {
      this.#end(event.message || "the worker could not be started");
    };
  }

  /**
   * Finds the faults of a pair that keep it from matching well.
   *
   * @param {ImageData} left - RGBA, 8 bits a channel; what has alpha 0 is not matched.
   * @param {ImageData} right - the same, of the same size.
   * @param {{numDisparities?: number, minDisparity?: number}} options - as for `match`.
   * @returns {Promise<Found>}
   *   - range: minDisparity, numDisparities, origin ("given", "found", "default"), confidence of a rough
   *     match (0 to 1), low, high (of the disparities found, pixels), swapped, mixed
   *   - rows: null or coefficients (8) of the field of vertical offsets, rms, error, spread,
   *     sway (largest offset of a row from the field; pixels all), blocks, applied
   *   - blur: list, largest area first, of side ("none", "left", "right": the softer one), kind ("none",
   *     "gaussian", "disk", "motion", "annulus", "other"), size (pixels), angle (degrees), share of the
   *     image; empty if it was not estimated; if each image has a blur that the other does not, both blurs,
   *     each with the whole share
   *   - certainty (0 to 1) of the first of them, contrast of the left image relative to the right one
   *   - noise, impulses, coding: [left, right], in gray levels
   *   - inverted: whether the images match only after one of them is inverted
   *   - findings: list of conclusions, each a topic, a severity ("ok", "note", "warning") and a sentence; a
   *     check has one for everything it examined, a match has noteworthy ones, the worst first
   *
   *   Unknown numbers are null.
   */
  check(left, right, { numDisparities = 0, minDisparity = 0 } = {}) {
    return this.call("check", { left, right, numDisparities, minDisparity });
  }

  /**
   * Matches a rectified pair: left pixel (x, y) corresponds to right pixel (x - d, y).
   *
   * @param {ImageData} left - RGBA, 8 bits a channel; what has alpha 0 is not matched.
   * @param {ImageData} right - the same, of the same size.
   * @param {{preset?: "robust" | "fast" | "paper", numDisparities?: number, minDisparity?: number}} options -
   *   the disparities [minDisparity, minDisparity + numDisparities) are searched; numDisparities 0: they are
   *   estimated.
   * @returns {Promise<{width: number, height: number, disparity: Float32Array, flags: Uint16Array,
   *   confidence: Float32Array | null, uncertainty: Float32Array | null, found: Found, milliseconds: number,
   *   engine: string}>} disparities in pixels, NaN without an estimate; confidences from 0 to 1, and error
   *   bars in pixels (half the width of the interval that holds the true disparity with a probability of 90
   *   %), null if the preset has none; the time of the core and the GPU alone; the name of the adapter if it
   *   searched, else "WebAssembly". A GPU that fails is not used again: the core searches, and a finding
   *   reports it.
   */
  match(left, right, { preset = "robust", numDisparities = 0, minDisparity = 0 } = {}) {
    return this.call("match", { left, right, preset, numDisparities, minDisparity });
  }

  /** Ends the worker; calls that wait are rejected. */
  close() {
    this.#worker.terminate();
    this.#end("the matcher was closed");
  }

  /** Lets the worker do something, after all earlier requests. */
  call(task, options) {
    const id = this.#calls++;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject });
      this.#worker.postMessage({ id, task, options: { ...options, ...plain(options) } });
    });
  }

  #end(message) {
    for (const { reject } of this.#waiting.values()) reject(new Error(message));
    this.#waiting.clear();
  }
}

/** Images without parts that cannot be sent, such as methods of a stand-in for ImageData. */
function plain({ left, right }) {
  const image = ({ width, height, data }) => ({ width, height, data });
  return left && right ? { left: image(left), right: image(right) } : {};
}
