// Loads the core's WebAssembly and handles the requests of matcher.js, one call after another: while the core
// waits for the GPU, nothing else may call it.

import { openGpu } from "./gpu.js";

// Sizes of the C interface's structs, see rust/c/phasestereo.h; each begins with its own, except for those in
// lists. Pointers and sizes take four bytes.
const IMAGE = 28;
const MAP = 36;
const FOUND = 488;
const BLUR = 32;
const FINDING = 16;
const RGBA = 2;

const STATUS_OK = 0;
const SEVERITIES = ["ok", "note", "warning"];
const ORIGINS = ["given", "found", "default"];
const SIDES = ["none", "left", "right"];
const KINDS = ["none", "gaussian", "disk", "motion", "annulus", "other"];

// Size of the pair to warm up with: enough for the browser to compile hot code with all optimizations.
const WARM_UP = { width: 160, height: 120, numDisparities: 32, shift: 5, rounds: 3 };

const PRESETS = ["fast", "robust"]; // to warm up with, and to compare a GPU with the core

let module = null; // compiled
let core = null; // the exports of its instance
let matchers = new Map(); // by preset
let gpu = null; // searches for the core; null: the core itself
let last = Promise.resolve(); // the previous call

const tasks = { load, check, match };

onmessage = ({ data }) => {
  last = last.then(() => answer(data));
};

async function answer({ id, task, options }) {
  try {
    const value = await tasks[task](options);
    const sent = [value?.disparity, value?.flags, value?.confidence, value?.uncertainty];
    postMessage({ id, value }, sent.filter(Boolean).map((array) => array.buffer));
  } catch (error) {
    // A trap leaves the memory inconsistent: the next call uses a new instance.
    if (error instanceof WebAssembly.RuntimeError) core = null;
    postMessage({ id, error: error.message });
  }
}

async function load({ wasm, device }) {
  const opening = openGpu(device);
  opening.catch(() => {}); // it is awaited below
  const response = await fetch(wasm);
  if (!response.ok) throw new Error(`${wasm}: ${response.status} ${response.statusText}`);
  module = await WebAssembly.compile(await response.arrayBuffer());

  const [left, right] = [0, WARM_UP.shift].map(texture);
  const warmUp = (preset) => match({ left, right, preset, minDisparity: 0, numDisparities: WARM_UP.numDisparities });
  const known = {};
  for (let round = 0; round < WARM_UP.rounds; round++) {
    for (const preset of PRESETS) known[preset] = await warmUp(preset);
  }

  gpu = await opening;
  if (!gpu) return;
  core = null; // the next instance can wait for it
  for (const preset of PRESETS) {
    const { disparity } = await warmUp(preset);
    const isSame = disparity.every((value, at) => Object.is(value, known[preset].disparity[at]));
    if (!isSame) gpu.failure ||= "its results differ from those of the processor";
  }
}

/** An image of noise, moved by this many pixels to the left. */
function texture(shift) {
  const { width, height } = WARM_UP;
  const data = new Uint8ClampedArray(4 * width * height);
  for (let pixel = 0; pixel < width * height; pixel++) {
    const x = (pixel % width) + shift;
    const hash = Math.imul(x + 1031 * Math.floor(pixel / width), 2654435761) >>> 24;
    data.fill(hash, 4 * pixel, 4 * pixel + 3);
  }
  return { width, height, data };
}

async function check({ left, right, minDisparity, numDisparities }) {
  await start();
  return borrowed(async ({ image, sized }) => {
    const [first, second, found] = [image(left, "left"), image(right, "right"), sized(FOUND)];
    const matcher = await matcherOf("robust");
    refuse(await called("check", matcher, first, second, minDisparity, numDisparities, found));
    return { ...readFound(found), findings: readFindings(sized(FINDING)) };
  });
}

async function match({ left, right, preset, minDisparity, numDisparities }) {
  await start();
  return borrowed(async ({ image, memory, sized }) => {
    const { width, height } = left;
    const [first, second, found] = [image(left, "left"), image(right, "right"), sized(FOUND)];
    const planes = [4, 2, 4, 4].map((bytes) => ({ start: memory(bytes * width * height), bytes }));
    const map = memory(MAP);
    const fields = [MAP, ...planes.flatMap(({ start, bytes }) => [start, bytes * width])];
    new Uint32Array(core.memory.buffer, map, fields.length).set(fields);

    const matcher = await matcherOf(preset);
    const [started, before] = [performance.now(), gpu?.tasks];
    const status = await called("match", matcher, first, second, minDisparity, numDisparities, map, found);
    const milliseconds = performance.now() - started;
    refuse(status);

    const [disparity, flags, confidence, uncertainty] = planes.map(({ start }, index) => {
      const kind = index === 1 ? Uint16Array : Float32Array;
      return new kind(core.memory.buffer, start, width * height).slice();
    });
    return {
      width,
      height,
      disparity,
      flags,
      confidence: Number.isNaN(confidence[0]) ? null : confidence,
      uncertainty: Number.isNaN(confidence[0]) ? null : uncertainty, // both exist, or neither
      found: { ...readFound(found), findings: readFindings(sized(FINDING)) },
      milliseconds,
      engine: gpu?.tasks > before && !gpu.failure ? gpu.name : "WebAssembly",
    };
  });
}

async function start() {
  if (core === null) {
    const page = { phasestereo_search: gpu ? new WebAssembly.Suspending(search) : search };
    core = (await WebAssembly.instantiate(module, { page })).exports;
    matchers = new Map();
  }
}

/** Calls a function that may search. */
function called(name, ...given) {
  const work = core[`phasestereo_${name}`];
  return gpu ? WebAssembly.promising(work)(...given) : work(...given);
}

/**
 * Runs the core's plan on the GPU while the core waits; returns 0, or the length in bytes of the reason for a
 * failure.
 */
async function search(start, length) {
  const bytes = ([at, count]) => new Uint8Array(core.memory.buffer, at, count);
  const plan = JSON.parse(new TextDecoder().decode(bytes([start >>> 0, length])));
  return new TextEncoder().encodeInto(await gpu.search(plan, bytes), bytes(plan.reason)).written;
}

/** The matcher with the settings of a preset, kept with its memory. */
async function matcherOf(preset) {
  if (!matchers.has(preset)) {
    const matcher = await borrowed(({ text }) => core.phasestereo_new(text(preset), 0, 0, 1));
    if (matcher === 0) throw new Error(readError());
    const { threads, buffer } = gpu?.limits ?? {};
    matchers.set(preset, gpu ? core.phasestereo_with_gpu(matcher, threads, buffer) : matcher);
  }
  return matchers.get(preset);
}

/** Does some work with memory of the core, which is freed afterward. */
async function borrowed(work) {
  const taken = [];
  const memory = (bytes) => {
    const start = core.phasestereo_allocate(bytes);
    if (start === 0) throw new Error(`out of memory: ${bytes} bytes could not be had`);
    taken.push([start, bytes]);
    return start;
  };
  try {
    return await work({
      memory,
      sized: (bytes) => {
        const start = memory(bytes);
        new Uint32Array(core.memory.buffer, start, 1).set([bytes]);
        return start;
      },
      image: (image, name) => writeImage(memory, image, name),
      text: (text) => writeText(memory, text),
    });
  } finally {
    for (const [start, bytes] of taken) core.phasestereo_release(start, bytes);
  }
}

function writeImage(memory, { width, height, data }, name) {
  if (data.length !== 4 * width * height) {
    const accepts = `RGBA of ${width} x ${height} pixels`;
    throw new Error(`${name}: got ${data.length} values; accepts ${accepts}`);
  }
  const pixels = memory(data.length);
  const image = memory(IMAGE);
  new Uint8Array(core.memory.buffer, pixels, data.length).set(data);
  const fields = [IMAGE, pixels, 4 * width, width, height, RGBA, 8];
  new Uint32Array(core.memory.buffer, image, fields.length).set(fields);
  return image;
}

function writeText(memory, text) {
  const bytes = new TextEncoder().encode(`${text}\0`);
  const start = memory(bytes.length);
  new Uint8Array(core.memory.buffer, start, bytes.length).set(bytes);
  return start;
}

function refuse(status) {
  if (status !== STATUS_OK) throw new Error(readError());
}

function readError() {
  return readText(core.phasestereo_error());
}

/** The findings of the last call, read through memory for one finding. */
function readFindings(place) {
  const findings = [];
  while (core.phasestereo_get_finding(findings.length, place) === 1) {
    const [, topic, sentence, severity] = new Uint32Array(core.memory.buffer, place, 4);
    findings.push({
      topic: readText(topic),
      severity: SEVERITIES[severity],
      sentence: readText(sentence),
    });
  }
  return findings;
}

function readText(start) {
  const bytes = new Uint8Array(core.memory.buffer, start);
  return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
}

/** The estimates, in the form that matcher.js returns. */
function readFound(start) {
  const view = new DataView(core.memory.buffer, start, FOUND);
  const number = (offset) => {
    const value = view.getFloat64(offset, true);
    return Number.isNaN(value) ? null : value;
  };
  const both = (offset) => (number(offset) === null ? null : [number(offset), number(offset + 8)]);
  const count = (offset) => view.getInt32(offset, true);
  const blur = (index) => {
    const offset = 184 + BLUR * index;
    return {
      size: number(offset),
      angle: number(offset + 8),
      share: number(offset + 16),
      side: SIDES[count(offset + 24)],
      kind: KINDS[count(offset + 28)],
    };
  };
  const rows = {
    coefficients: Array.from({ length: 8 }, (_, term) => number(32 + 8 * term)),
    rms: number(96),
    error: number(104),
    spread: number(112),
    sway: number(480),
    blocks: count(444),
    applied: count(448) === 1,
  };
  return {
    range: {
      minDisparity: count(452),
      numDisparities: count(456),
      origin: ORIGINS[count(460)],
      confidence: number(8),
      low: number(16),
      high: number(24),
      swapped: count(464) === 1,
      mixed: count(468) === 1,
    },
    rows: rows.blocks > 0 ? rows : null,
    blur: Array.from({ length: count(440) }, (_, index) => blur(index)),
    certainty: number(120),
    contrast: number(128),
    noise: both(136),
    impulses: both(152),
    coding: both(168),
    inverted: count(472) === 1,
  };
}
