// A matcher without a core, for tests of the page: a slope of disparities at once, and all calls remembered.

export async function createMatcher() {
  window.calls = [];
  return { check, match, close() {} };
}

const found = {
  range: { minDisparity: -2, numDisparities: 40, origin: "found", confidence: 0.9, low: 3, high: 31, swapped: false, mixed: false },
  rows: { coefficients: [2.5, 0, 0, 0, 0, 0, 0, 0], rms: 2.5, error: 0.05, spread: 0.1, blocks: 90, applied: true },
  blur: [{ side: "left", kind: "disk", size: 3.04, angle: 0, share: 1 }],
  certainty: 0.9,
  contrast: 1,
  noise: [1.04, 8.2],
  impulses: [0, 0],
  coding: [0, 0],
  inverted: false,
  findings: [
    { topic: "blur", severity: "note", sentence: "the left image is softer than the right" },
    { topic: "noise", severity: "ok", sentence: "noise of 1.0 gray levels" },
  ],
};

// What a match says besides.
const failure = { topic: "match", severity: "warning", sentence: "about 40 % of the pixels are probably wrong" };

async function check(left, right) {
  if (window.refusal) throw new Error(window.refusal);
  window.calls.push({ task: "check", size: [left.width, left.height, right.width, right.height] });
  return found;
}

async function match({ width, height, data }, right, options) {
  if (window.refusal) throw new Error(window.refusal);
  window.calls.push({ task: "match", ...options, size: [width, height], first: data[0], second: right.data[0] });
  const disparity = Float32Array.from({ length: width * height }, (_, at) => 10 + Math.floor(at / width) / height);
  disparity[0] = NaN;
  const flags = new Uint16Array(width * height);
  flags[0] = 2;
  const [confidence, uncertainty] = [0.75, 0.5].map((value) =>
    (options.preset === "robust" ? new Float32Array(width * height).fill(value) : null));
  const range = { ...found.range, origin: options.numDisparities ? "given" : "found" };
  const findings = [failure, found.findings[0]];
  return {
    width, height, disparity, flags, confidence, uncertainty, found: { ...found, range, findings }, milliseconds: 12.3,
    engine: "nvidia ampere",
  };
}
