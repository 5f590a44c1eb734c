// Matches stereo pairs in the browser: the core runs as WebAssembly on a thread of its own, with the GPU where there is WebGPU,
// and nothing leaves the machine.

/**
 * Starts the core.
 *
 * @param {{wasm?: string | URL, device?: "auto" | "cpu" | "gpu"}} options - `wasm`: where the module is, relative to this file;
 *   `device`: what searches, with the same bits: "gpu" the browser's adapter, even if it is software, which is slower than the
 *   core; "auto" one that is not, where the browser has WebGPU and JavaScript Promise Integration, else the core.
 * @returns {Promise<Matcher>} once it is loaded and warmed up; an Error if it cannot be.
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
   * Finds out of a pair what keeps it from being matched well.
   *
   * @param {ImageData} left - RGBA, 8 bits a channel; what has alpha 0 is not matched.
   * @param {ImageData} right - the same, of the same size.
   * @param {{numDisparities?: number, minDisparity?: number}} options - as `match` takes them.
   * @returns {Promise<Found>}
   *   - range: minDisparity, numDisparities, origin ("given", "found", "default"), confidence of a rough match (0 to 1),
   *     low, high (what was seen, pixels), swapped, mixed
   *   - rows: null or coefficients (8) of the field of vertical offsets, rms, error, spread,
   *     sway (largest offset of a row from the field; pixels all), blocks, applied
   *   - blur: list, largest area first, of side ("none", "left", "right": the softer one), kind ("none", "gaussian", "disk",
   *     "motion", "annulus", "other"), size (pixels), angle (degrees), share of the image; empty if it was not looked for;
   *     where each image has a blur that the other one has not, both blurs, each with the whole share
   *   - certainty (0 to 1) of the first of them, contrast of the left image relative to the right one
   *   - noise, impulses, coding: [left, right], in gray levels
   *   - inverted: whether the images match once one of them is inverted
   *   - findings: list of what this means, each a topic, a severity ("ok", "note", "warning") and a sentence; of a check all
   *     that was looked at, of a match what is worth knowing, the worst first
   *
   *   Numbers that could not be found out are null.
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
   *   the disparities [minDisparity, minDisparity + numDisparities) are searched; numDisparities 0: they are found.
   * @returns {Promise<{width: number, height: number, disparity: Float32Array, flags: Uint16Array,
   *   confidence: Float32Array | null, uncertainty: Float32Array | null, found: Found, milliseconds: number,
   *   engine: string}>} disparities in pixels, NaN without an estimate; confidences from 0 to 1, and error bars in pixels
   *   (half the width of what holds the true disparity with a probability of 90 %), null where the preset has none; the time
   *   of the core and the GPU alone; the name of the adapter if it searched, else "WebAssembly". A GPU that fails is not
   *   asked again: the core searches, and a finding reports it.
   */
  match(left, right, { preset = "robust", numDisparities = 0, minDisparity = 0 } = {}) {
    return this.call("match", { left, right, preset, numDisparities, minDisparity });
  }

  /** Ends the worker; calls that wait are rejected. */
  close() {
    this.#worker.terminate();
    this.#end("the matcher was closed");
  }

  /** Has the worker do something, after all that was asked before. */
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

/** Images without what cannot be sent, as methods of a stand-in for ImageData. */
function plain({ left, right }) {
  const image = ({ width, height, data }) => ({ width, height, data });
  return left && right ? { left: image(left), right: image(right) } : {};
}
