// What a match has found, given to the viewer while the page is open: by the page that matches in the browser, and by that of
// `phasestereo live`.

const LEVELS = 0xffff - 1; // codes of disparities; the one after stands for none
const FINEST = 1 / 128; // pixels
const [LOWEST, HIGHEST] = [0.01, 0.99]; // shares of the disparities beyond which colors stay
const FAR = 1.5; // depths beyond this multiple of the 90th percentile are left out: they dwarf the rest
const SAMPLES = 20_000; // of a map, to find its percentiles

// Show the images alone, at once: disparities follow.
function showPair(left, right) {
  for (const [side, image] of Object.entries({ left, right })) {
    const canvas = made("canvas", { width: image.width, height: image.height });
    canvas.getContext("2d").putImageData(image, 0, 0);
    pictures[side] = { canvas, bytes: image.data };
  }
  if (state.view === "left" || state.view === "right") stage.refresh();
}

let wanted = null; // the layer that is shown again once there is a map for it

// Show a result, every step-th pixel of every step-th row, and the truth if it is known. `scene` is the geometry as the report
// page has it, nominal without one; `ends` are the disparities at the ends of the colors. Points in space are drawn anew only
// of the last result, not of those that are on their way.
function showResult(result, { step = 1, truth = null, scene = null, ends = null, isLast = true } = {}) {
  const { width, height } = result;
  Object.assign(page, { cols: width, rows: height, step });
  for (const [name, value] of [["--shape", `${width} / ${height}`], ["--ratio", width / height]]) {
    document.querySelector(".desk").style.setProperty(name, value);
  }
  for (const name of ["truth", "error"]) if (element(`value-${name}`)) element(`value-${name}`).parentElement.hidden = !truth;
  fillMaps(result, truth);
  fillLayers(truth ?? result.disparity, ends);
  fillFlags(result.flags);
  fillScene(scene ?? nominalScene(width * step, height * step));
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
function forgetWanted() {
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

function fillLayers(map, ends) {
  const sample = sortedSample(map);
  const [low, high] = ends ?? (sample.length ? [LOWEST, HIGHEST].map((share) => quantile(sample, share)) : [0, 1]);
  for (const layer of page.layers) {
    if (layer.key === "uncertainty" && maps.uncertainty) {
      const bars = sortedSample(maps.uncertainty);
      layer.high = (bars.length && quantile(bars, HIGHEST)) || 1;
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

const quantile = (sorted, share) => sorted[Math.round(share * (sorted.length - 1))];

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

// Without a calibration the focal length is the images' width, or what the photographs say, and the cameras look the same way
// from one unit apart, or as far apart as a known length has it.
function nominalScene(width, height) {
  const focal = known.focal ?? width;
  return {
    nominal: true,
    focal: [focal, focal],
    center: [(width - 1) / 2, (height - 1) / 2],
    scale: focal * known.factor,
    doffs: 0,
    right: [focal, (width - 1) / 2],
    share: [0, 0, 0],
    unit: known.unit ?? "baselines",
  };
}

function fillScene(scene) {
  Object.assign(page.scene, scene);
  const { doffs } = page.scene;
  const deep = sortedSample(maps.disparity).filter((value) => value + doffs > 0);
  const [low, high] = deep.length ? [deep[0], deep.at(-1)] : [0, 0];
  const between = Math.max(FINEST, (high - low) / LEVELS);
  page.codings = { disparity: [low, between] };
  page.scene.limit = deep.length ? FAR * depthOf(quantile(deep, 0.1)) : 0;
  maps.codes = Uint16Array.from(maps.disparity, (value) => (
    value + doffs > 0 ? Math.min(LEVELS, Math.max(0, Math.round((value - low) / between))) : LEVELS + 1));
}
