// The effects of the sliders on one image of a pair, in the order in which they occur in a camera: it is
// turned or shifted, its lens is out of focus, it shakes during the exposure, it receives less light; noise
// comes last.

const ANGLE = 20; // degrees: the direction of a motion
const NOISE_SEED = 0x9e3779b9;

// The settings of a good camera: turn in degrees, rows and blurs in pixels, dim in percent.
export const NOTHING = { defocus: 0, shake: 0, dim: 0, turn: 0, rows: 0 };

// A spoiled copy of an image; `noise` is a standard deviation in gray levels.
export function spoiled(image, asked, noise = 0, seed = 1) {
  let copy = new ImageData(image.data.slice(), image.width, image.height);
  if (asked.turn || asked.rows) copy = moved(copy, asked);
  if (asked.defocus) copy = convolved(copy, disk(asked.defocus));
  if (asked.shake) copy = convolved(copy, path(asked.shake));
  expose(copy, 1 - asked.dim / 100, noise, seed);
  return copy;
}

// The place of the point (x, y) of an image after turning and shifting it; both count from the first pixel's
// middle.
export function movedPoint(x, y, { width, height }, { turn, rows }) {
  const [cos, sin] = [Math.cos((turn * Math.PI) / 180), Math.sin((turn * Math.PI) / 180)];
  const [dx, dy] = [x - (width - 1) / 2, y - (height - 1) / 2];
  return [(width - 1) / 2 + cos * dx - sin * dy, (height - 1) / 2 + sin * dx + cos * dy + rows];
}

// The original place of the point (x, y) of a turned and shifted image.
export function pointBefore(x, y, size, { turn, rows }) {
  return movedPoint(x, y - rows, size, { turn: -turn, rows: 0 });
}

// The image turned and shifted, by cubic interpolation, which keeps it sharp.
function moved(image, asked) {
  const { width, height, data } = image;
  const copy = new ImageData(width, height);
  const [startX, startY] = pointBefore(0, 0, image, asked);
  const [nextX, nextY] = pointBefore(1, 0, image, asked);
  const [cos, sin] = [nextX - startX, nextY - startY];
  for (let y = 0, to = 0; y < height; y++) {
    for (let x = 0; x < width; x++, to += 4) {
      sample(data, width, height, startX + cos * x - sin * y, startY + sin * x + cos * y, copy.data, to);
    }
  }
  return copy;
}

const across = new Float64Array(4);
const down = new Float64Array(4);

function sample(data, width, height, x, y, out, to) {
  const [column, row] = [Math.floor(x), Math.floor(y)];
  cubicWeights(x - column, across);
  cubicWeights(y - row, down);
  let [red, green, blue] = [0, 0, 0];
  for (let j = 0; j < 4; j++) {
    const start = width * Math.min(height - 1, Math.max(0, row + j - 1));
    for (let i = 0; i < 4; i++) {
      const at = 4 * (start + Math.min(width - 1, Math.max(0, column + i - 1)));
      const weight = across[i] * down[j];
      red += weight * data[at];
      green += weight * data[at + 1];
      blue += weight * data[at + 2];
    }
  }
  out[to] = red;
  out[to + 1] = green;
  out[to + 2] = blue;
  out[to + 3] = 255;
}

// Catmull and Rom's weights of four neighbors for a place between the second and the third.
function cubicWeights(t, weights) {
  weights[0] = 0.5 * t * (-1 + t * (2 - t));
  weights[1] = 1 + 0.5 * t * t * (-5 + 3 * t);
  weights[2] = 0.5 * t * (1 + t * (4 - 3 * t));
  weights[3] = 0.5 * t * t * (t - 1);
}

// Point-spread functions are pieces of rows: {dy, from, to}, in pixels from the middle.

function disk(radius) {
  const reach = Math.ceil(radius) - 1;
  return Array.from({ length: 2 * reach + 1 }, (_, n) => {
    const half = Math.sqrt(radius * radius - (n - reach) ** 2);
    return { dy: n - reach, from: -half, to: half };
  });
}

// A straight motion of this many pixels: for each row, the piece of the path in it.
function path(length) {
  const [cos, sin] = [Math.cos((ANGLE * Math.PI) / 180), Math.sin((ANGLE * Math.PI) / 180)];
  const end = (length * cos) / 2;
  const reach = Math.round((length * sin) / 2);
  return Array.from({ length: 2 * reach + 1 }, (_, n) => {
    const dy = n - reach;
    const [from, to] = [dy - 0.5, dy + 0.5].map((y) => Math.min(end, Math.max(-end, (y * cos) / sin)));
    return { dy, from, to };
  }).filter(({ from, to }) => to > from);
}

// The image convolved with such pieces, each by the difference of two running sums; its borders continue.
function convolved(image, pieces) {
  const { width, height } = image;
  const reach = Math.ceil(Math.max(...pieces.map(({ to }) => to))) + 1;
  const total = pieces.reduce((sum, { from, to }) => sum + to - from, 0);
  const sums = runningSums(image, reach);
  const stride = width + 2 * reach + 1;
  const copy = new ImageData(new Uint8ClampedArray(image.data), width, height);
  const line = new Float64Array(width);
  for (let y = 0; y < height; y++) {
    for (let channel = 0; channel < 3; channel++) {
      line.fill(0);
      for (const { dy, from, to } of pieces) {
        const row = Math.min(height - 1, Math.max(0, y + dy));
        const start = (channel * height + row) * stride + reach;
        addSums(line, sums, start, to + 0.5, 1 / total);
        addSums(line, sums, start, from + 0.5, -1 / total);
      }
      for (let x = 0, at = 4 * y * width + channel; x < width; x++, at += 4) copy.data[at] = line[x];
    }
  }
  return copy;
}

// Sums of each channel's rows from the left, up to before each pixel, with this many more pixels at either
// end.
function runningSums({ width, height, data }, reach) {
  const sums = new Float64Array(3 * height * (width + 2 * reach + 1));
  let at = 0;
  for (let channel = 0; channel < 3; channel++) {
    for (let y = 0; y < height; y++) {
      let sum = 0;
      for (let x = -reach; x < width + reach; x++) {
        sums[at++] = sum;
        sum += data[4 * (y * width + Math.min(width - 1, Math.max(0, x))) + channel];
      }
      sums[at++] = sum;
    }
  }
  return sums;
}

function addSums(line, sums, start, offset, factor) {
  const whole = Math.floor(offset);
  const share = offset - whole;
  for (let x = 0, at = start + whole; x < line.length; x++, at++) {
    line[x] += factor * (sums[at] + share * (sums[at + 1] - sums[at]));
  }
}

// Less light, and the noise of the sensor: the same for the same seed.
function expose({ data }, gain, noise, seed) {
  if (gain === 1 && !noise) return;
  let state = Math.imul(seed, NOISE_SEED);
  const random = () => ((state = (Math.imul(state, 1664525) + 1013904223) | 0) >>> 0) / 2 ** 32;
  for (let at = 0; at < data.length; at++) {
    if (at % 4 === 3) continue;
    // Three uniform numbers, each of variance 1/12, have a sum that is about Gaussian.
    const deviation = noise ? 2 * noise * (random() + random() + random() - 1.5) : 0;
    data[at] = Math.round(gain * data[at] + deviation);
  }
}
