// What a match has found, given to the viewer, which is the report page's: its scripts, loaded before as viewer.js, hold
// `page`, `maps`, `pictures`, `stage` and the functions that are called here.

const LEVELS = 0xffff - 1; // codes of disparities; the one after stands for none
const FINEST = 1 / 128; // pixels
const [LOWEST, HIGHEST] = [0.01, 0.99]; // shares of the disparities beyond which colors stay
const FAR = 1.5; // depths beyond so many times the 90th percentile are left out: they dwarf the rest
const TRUSTED = 0.5; // least confidence of what is trusted
const SAMPLES = 20_000; // of a map, to find its percentiles

// Show the images alone, at once: disparities follow.
export function showPair(left, right) {
  for (const [side, image] of Object.entries({ left, right })) {
    const canvas = made("canvas", { width: image.width, height: image.height });
    canvas.getContext("2d").putImageData(image, 0, 0);
    pictures[side] = { canvas, bytes: image.data };
  }
  if (state.view === "left" || state.view === "right") stage.refresh();
}

let wanted = null; // the layer that is shown again once there is a map for it

// Show a result, and the truth if it is known. Points in space are drawn anew only of the last result, not of those
// that are on their way.
export function showResult(result, truth, isLast) {
  const { width, height } = result;
  const size = `${width} / ${height}`;
  Object.assign(page, { cols: width, rows: height });
  for (const [name, value] of [["--shape", size], ["--ratio", width / height]]) {
    document.querySelector(".desk").style.setProperty(name, value);
  }
  for (const name of ["truth", "error"]) element(`value-${name}`).parentElement.hidden = !truth;
  fillMaps(result, truth);
  fillLayers(truth ?? result.disparity);
  fillFlags(result.flags);
  fillScene(width, height);
  const before = state.view;
  renew();
  if (state.view !== before) wanted = before;
  else if (wanted && maps[wanted]) {
    choose(wanted);
    wanted = null;
  }
  if (isLast) renewScene();
}

// Whoever chooses a layer wants that one.
export function forgetWanted() {
  wanted = null;
}

function fillMaps({ disparity, flags, confidence, uncertainty }, truth) {
  Object.assign(maps, { disparity, flags });
  maps.confidence = confidence ?? undefined;
  maps.uncertainty = uncertainty ?? undefined;
  maps.truth = truth ?? undefined;
  maps.scored = truth ? Uint8Array.from(truth, (value) => Number(Number.isFinite(value))) : undefined;
  maps.error = truth ? disparity.map((found, at) => errorOf(found, at)) : undefined;
}

function fillLayers(map) {
  const known = sortedSample(map);
  const [low, high] = known.length ? [LOWEST, HIGHEST].map((share) => at(known, share)) : [0, 1];
  for (const layer of page.layers) {
    if (layer.key === "uncertainty" && maps.uncertainty) {
      const bars = sortedSample(maps.uncertainty);
      layer.high = (bars.length && at(bars, HIGHEST)) || 1;
    }
    if (layer.key !== "disparity" && layer.key !== "truth") continue;
    Object.assign(layer, high > low ? { low, high } : { low: low - 0.5, high: low + 0.5 });
  }
}

function sortedSample(map) {
  const every = Math.max(1, Math.floor(map.length / SAMPLES));
  const sample = [];
  for (let place = 0; place < map.length; place += every) if (Number.isFinite(map[place])) sample.push(map[place]);
  return Float32Array.from(sample).sort();
}

const at = (sorted, share) => sorted[Math.round(share * (sorted.length - 1))];

// The flags that a pixel has, in the page's order.
function fillFlags(flags) {
  const counts = new Map();
  for (const value of flags) counts.set(value, (counts.get(value) ?? 0) + 1);
  page.flags = page.kinds.flatMap((kind) => {
    let pixels = 0;
    for (const [value, count] of counts) if (value & kind.bit) pixels += count;
    return pixels ? [{ ...kind, pixels, share: pixels / flags.length }] : [];
  });
  if (!page.flags.some(({ bit }) => bit === state.only)) state.only = 0;
}

// The geometry of the points: the focal length is the images' width, the cameras look the same way from one unit apart.
function fillScene(width, height) {
  const positive = sortedSample(maps.disparity).filter((value) => value > 0);
  const [low, high] = positive.length ? [positive[0], positive.at(-1)] : [0, 0];
  const step = Math.max(FINEST, (high - low) / LEVELS);
  Object.assign(page.scene, {
    focal: [width, width],
    center: [(width - 1) / 2, (height - 1) / 2],
    scale: width * known.factor,
    doffs: 0,
    right: [width, (width - 1) / 2],
    share: [0, 0, 0],
    unit: known.unit ?? "baselines",
  });
  page.codings = { disparity: [low, step] };
  page.scene.limit = positive.length ? FAR * depthOf(at(positive, 0.1)) : 0;
  maps.codes = Uint16Array.from(maps.disparity, (value) => (
    value > 0 ? Math.min(LEVELS, Math.max(0, Math.round((value - low) / step))) : LEVELS + 1));
}

// Shares of the pixels: {trusted, wrong}; trusted as phasestereo.Result.trusted has it; wrong, off by more than 1 px or
// without an estimate, only against a truth.
export function sharesOf({ disparity, flags, confidence }, truth) {
  let [trusted, wrong] = [0, 0];
  for (let place = 0; place < disparity.length; place++) {
    const isSure = confidence ? confidence[place] >= TRUSTED : !flags[place];
    if (Number.isFinite(disparity[place]) && isSure) trusted++;
    if (truth && !(Math.abs(disparity[place] - truth[place]) <= 1)) wrong++;
  }
  return { trusted: trusted / disparity.length, wrong: truth ? wrong / disparity.length : null };
}
