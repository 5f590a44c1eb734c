// What was found out of a pair, in a sentence each, as `check` of the command line says it; from where on something is
// worth a note or a warning is the library's own table, `levels`.

const ORDER = ["warning", "note", "ok"];
const EXTREMES = [1, 254]; // gray levels that count as dark and bright ends of the scale

const KINDS = {
  gaussian: (size) => `a Gaussian of sigma ${size.toFixed(1)} px: check its focus`,
  disk: (size) => `a disk of radius ${size.toFixed(1)} px: it is out of focus`,
  annulus: (size) => `an annulus of outer radius ${size.toFixed(1)} px: it is out of focus`,
  motion: (size, angle) => `a motion of ${size.toFixed(1)} px at ${angle.toFixed(0)} degrees: it shook while it was exposed`,
  other: (size) => `a blur of no simple shape, of radius ${size.toFixed(1)} px`,
};

// Standard deviations along an axis, or along the path, of a blur of size 1.
const SPREADS = {
  gaussian: (size) => size,
  disk: (size) => size / 2,
  annulus: (size) => size / 1.6,
  motion: (size) => (size - 1) / Math.sqrt(12),
  other: (size) => size / Math.SQRT2,
};

// [{topic, severity, sentence}], the worst first, of what the matcher found, with the `size` of the images, and of the images themselves.
export function sentences(found, { left, right }, levels) {
  const all = [
    ...rangeOf(found), rowsOf(found, levels), ...blurOf(found, levels),
    contrastOf(left, right, levels), noiseOf(found, levels), saturationOf(left, right, levels),
  ];
  return all.sort((one, other) => ORDER.indexOf(one.severity) - ORDER.indexOf(other.severity));
}

function finding(topic, severity, sentence) {
  return { topic, severity, sentence };
}

function severityOf(value, [note, warning]) {
  return value >= warning ? "warning" : value >= note ? "note" : "ok";
}

const percent = (share) => `${(100 * share).toFixed(0)} %`;

function rangeOf({ range, inverted }) {
  if (range.low === null) {
    return [finding("range", "warning", "hardly anything in one image is found in the other: these are no pair, or far from rectified")];
  }
  const ends = `${Math.round(range.low)} to ${Math.round(range.high)} px`;
  const findings = [finding("range", "ok", `disparities are ${ends}`)];
  if (inverted) findings.push(finding("contrast", "warning", "what is bright in one image is dark in the other: its negative is matched"));
  if (range.swapped) findings.push(finding("swap", "warning", `left and right seem to be swapped, all disparities are negative (${ends}): exchange them`));
  else if (range.mixed) findings.push(finding("swap", "note", `disparities of both signs (${ends}): the cameras are toed in, or the images are cropped`));
  else findings.push(finding("swap", "ok", "left and right are in their places"));
  return findings;
}

function rowsOf({ rows, size }, levels) {
  if (!rows) return finding("alignment", "note", "too little is found in both images to tell whether rows correspond");
  const { rms, error, coefficients } = rows;
  const ends = [0, 1].map((n) => Math.max(levels.rows[n], levels.errors[n] * error));
  const severity = severityOf(rms, ends);
  const off = `${rms.toFixed(2)} px rms, known to ${error.toFixed(2)} px`;
  if (severity === "ok") return finding("alignment", "ok", `rows correspond as well as can be told (${off})`);
  const parts = partsOf(coefficients, size, error, levels).join(" and ") || "is out of line";
  return finding("alignment", severity, `the right image ${parts} (${off}): robust straightens it`);
}

// The parts of a misalignment that are seen.
function partsOf([shift, turn, scale], { width, height }, error, levels) {
  const [center, border] = levels.part.map((part) => Math.max(part, levels.part_errors * error));
  const parts = [];
  if (Math.abs(shift) >= center) parts.push(`shows things ${Math.abs(shift).toFixed(1)} px ${shift > 0 ? "lower" : "higher"} than the left one`);
  if (Math.abs(turn) >= border) {
    const degrees = (Math.atan(Math.abs(turn) / (width / 2)) * 180) / Math.PI;
    parts.push(`is rotated ${turn > 0 ? "" : "counter-"}clockwise by ${degrees.toFixed(2)} degrees`);
  }
  if (Math.abs(scale) >= border) parts.push(`shows things at ${(1 + scale / (height / 2)).toFixed(3)} times the height`);
  return parts;
}

function blurOf({ blur, certainty }, levels) {
  if (!blur.length) return [finding("blur", "note", "the images have too little in common to tell which one is softer")];
  const seen = blur.filter(({ kind, size, share }) =>
    (SPREADS[kind]?.(size) ?? 0) >= levels.blur[0] && share >= levels.blur_share);
  if (!seen.length) return [finding("blur", "ok", "the images are equally sharp")];
  // Blurs of both images in the same place each have the whole share.
  const isOfBoth = blur.reduce((sum, { share }) => sum + share, 0) > 1.5;
  return seen.map(({ side, kind, size, angle, share }) => {
    const isSure = certainty >= levels.sure;
    const severity = isSure && SPREADS[kind](size) >= levels.blur[1] ? "warning" : "note";
    const where = blur.length > 1 && !isOfBoth ? `, over ${percent(share)} of the image,` : "";
    const what = isOfBoth ? "blurred" : `softer than the ${side === "left" ? "right" : "left"}`;
    return finding("blur", severity, `the ${side} image${where} is ${isSure ? "" : "probably "}${what} by ${KINDS[kind](size, angle)}; robust compensates`);
  });
}

function contrastOf(left, right, levels) {
  const ratio = (meanOf(left) + 1e-6) / (meanOf(right) + 1e-6);
  const severity = severityOf(Math.abs(Math.log(ratio)), levels.contrast);
  if (severity === "ok") return finding("contrast", "ok", "both images are equally bright");
  const [darker, other] = ratio < 1 ? ["left", "right"] : ["right", "left"];
  return finding("contrast", severity, `the ${darker} image is darker, its gray levels ${Math.min(ratio, 1 / ratio).toFixed(2)} times the ${other} one's`);
}

function noiseOf({ noise }, levels) {
  if (!noise) return finding("noise", "note", "the images have too little in common to tell the noise");
  const [left, right] = noise.map((deviation) => deviation.toPrecision(2));
  return finding("noise", severityOf(Math.max(...noise) / 255, levels.noise), `noise of ${left} gray levels in the left image, ${right} in the right, of 255`);
}

function saturationOf(left, right, levels) {
  const shares = Object.entries({ left, right }).flatMap(([side, image]) => {
    const [dark, bright] = endsOf(image);
    return [[bright, `of the ${side} image is as bright as it can be`], [dark, `of the ${side} image is as dark as it can be`]];
  });
  const [worst, words] = shares.reduce((one, other) => (other[0] > one[0] ? other : one));
  const severity = severityOf(worst, levels.saturated);
  return finding("saturation", severity, severity === "ok" ? "hardly any pixel is at an end of the scale" : `${percent(worst)} ${words}`);
}

function grayAt(data, at) {
  return 0.299 * data[at] + 0.587 * data[at + 1] + 0.114 * data[at + 2];
}

function meanOf({ data }) {
  let sum = 0;
  for (let at = 0; at < data.length; at += 4) sum += grayAt(data, at);
  return sum / (data.length / 4);
}

// Shares of the pixels at the dark and at the bright end of the scale.
function endsOf({ data }) {
  const counts = [0, 0];
  for (let at = 0; at < data.length; at += 4) {
    const gray = grayAt(data, at);
    if (gray < EXTREMES[0]) counts[0]++;
    else if (gray > EXTREMES[1]) counts[1]++;
  }
  return counts.map((count) => count / (data.length / 4));
}
