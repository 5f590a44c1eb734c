// The built-in pairs: small scenes, ray-cast from two cameras, with exact disparities.
//
// Camera coordinates: x to the right, y down, z ahead, in baselines. The left camera is at the origin, the
// right one at x = 1; both look along z. With a focal length of the images' width, a point at depth z has the
// disparity width / z.

const WIDTH = 448;
const HEIGHT = 336;
const FINE = 0.25; // pixels from the middle of a pixel where rays at a border are cast
const LIGHT = unit([-0.45, -0.75, -0.5]); // toward it
const STRENGTHS = [0.36, 0.36, 0.3, 0.26, 0.22]; // of the sizes of a texture, the finest first
const NEAREST = 1e-3; // baselines: a nearer hit is where the ray starts

export const NUM_DISPARITIES = 64; // all disparities of all scenes are below

const floor = (y, color) => ({ kind: "plane", axis: 1, at: y, color, grain: [1, 1, 1], depth: 18 });
const wall = (z, color) => ({ kind: "plane", axis: 2, at: z, color, grain: [1, 0.35, 1], depth: z });
const ball = (center, radius, color) => ({ kind: "ball", center, radius, color, grain: [1, 1, 1], depth: center[2] });
const block = (low, high, color, grain = [1, 1, 1]) => ({ kind: "block", low, high, color, grain, depth: low[2] });

export const SCENES = {
  table: {
    label: "Things on a table",
    parts: [
      wall(44, [178, 186, 190]),
      floor(5, [172, 132, 92]),
      ball([-2.3, 2.6, 12.5], 2.4, [196, 88, 66]),
      ball([4.6, 3.3, 13], 1.7, [92, 142, 178]),
      ball([9.2, 2.2, 25], 2.8, [214, 178, 84]),
      block([-13, -3, 25], [-6.5, 5, 30], [112, 150, 116], [1, 0.25, 1]),
      block([0.6, 0.4, 18], [5.4, 5, 22], [206, 200, 186], [0.3, 1, 1]),
      block([11, -6, 32], [16, 5, 36], [150, 112, 140]),
    ],
  },
  street: {
    label: "A street",
    parts: [
      wall(54, [178, 198, 220]),
      floor(4, [158, 156, 150]),
      block([-18, -4.5, 19], [-7.5, 4, 27], [204, 134, 102], [1, 0.4, 1]),
      block([-20, -7, 31], [-9, 4, 42], [216, 196, 158]),
      block([8, -11, 20], [20, 4, 31], [150, 164, 186], [1, 0.4, 1]),
      block([9.5, -8, 35], [20, 4, 46], [196, 170, 148]),
      block([0.6, 1.4, 21], [4.6, 4, 28], [196, 62, 54]),
      block([-3, -3, 16], [-2.5, 4, 16.5], [104, 112, 100]),
      ball([-2.75, -3.6, 16.3], 2, [104, 156, 90]),
      ball([4.6, 2.9, 10.5], 1.1, [232, 196, 78]),
    ],
  },
};

// A pair of a scene: {left, right, truth}; truth is a Float32Array, the disparities of the left image.
export function renderPair(name) {
  const { parts } = SCENES[name];
  const truth = new Float32Array(WIDTH * HEIGHT);
  const left = photograph(parts, 0, truth);
  return { left, right: photograph(parts, 1, null), truth };
}

function photograph(parts, camera, truth) {
  const image = new ImageData(WIDTH, HEIGHT);
  const seen = new Uint8Array(WIDTH * HEIGHT); // the part that the middle of each pixel shows, from 1 on
  for (let y = 0, at = 0; y < HEIGHT; y++) {
    for (let x = 0; x < WIDTH; x++, at++) {
      const met = cast(parts, camera, x, y);
      seen[at] = met.part + 1;
      if (truth) truth[at] = WIDTH / met.z;
      image.data.set(shade(parts, met), 4 * at);
      image.data[4 * at + 3] = 255;
    }
  }
  smoothBorders(parts, camera, image, seen);
  return image;
}

// Cast four rays in place of one where two parts meet.
function smoothBorders(parts, camera, image, seen) {
  for (let y = 0, at = 0; y < HEIGHT - 1; y++, at++) {
    for (let x = 0; x < WIDTH - 1; x++, at++) {
      if (seen[at] === seen[at + 1] && seen[at] === seen[at + WIDTH]) continue;
      const colors = [[-FINE, -FINE], [FINE, -FINE], [-FINE, FINE], [FINE, FINE]].map(([dx, dy]) =>
        shade(parts, cast(parts, camera, x + dx, y + dy)));
      image.data.set([0, 1, 2].map((channel) => colors.reduce((sum, color) => sum + color[channel] / 4, 0)), 4 * at);
    }
  }
}

function cast(parts, camera, x, y) {
  const way = [(x + 0.5 - WIDTH / 2) / WIDTH, (y + 0.5 - HEIGHT / 2) / WIDTH, 1];
  let met = { far: Infinity };
  const from = [camera, 0, 0];
  for (let part = 0; part < parts.length; part++) {
    const found = MEET[parts[part].kind](parts[part], from, way);
    if (found && found.far < met.far) met = Object.assign(found, { part });
  }
  const point = [camera + met.far * way[0], met.far * way[1], met.far];
  return Object.assign(met, { point, z: met.far });
}

// Where a ray first meets a part: the distance in ray lengths, and the normal there.
const MEET = {
  plane({ axis, at }, from, way) {
    const far = (at - from[axis]) / way[axis];
    return far > NEAREST && { far, normal: facing(axis, way) };
  },

  ball({ center, radius }, from, way) {
    const off = [from[0] - center[0], from[1] - center[1], from[2] - center[2]];
    const [a, b, c] = [dot(way, way), dot(way, off), dot(off, off) - radius * radius];
    const rest = b * b - a * c;
    if (rest < 0) return null;
    const far = (-b - Math.sqrt(rest)) / a;
    return far > NEAREST && { far, normal: off.map((value, n) => (value + far * way[n]) / radius) };
  },

  block({ low, high }, from, way) {
    let [into, out, side] = [-Infinity, Infinity, 0];
    for (let n = 0; n < 3; n++) {
      const [one, other] = [(low[n] - from[n]) / way[n], (high[n] - from[n]) / way[n]];
      const first = Math.min(one, other);
      if (first > into) [into, side] = [first, n];
      out = Math.min(out, Math.max(one, other));
    }
    if (into > out || into < NEAREST) return null;
    return { far: into, normal: facing(side, way) };
  },
};

function shade(parts, { part, point, normal, z }) {
  const { color, grain, depth } = parts[part];
  const start = point.map((value, n) => value + 1e-3 * normal[n]);
  const isShaded = parts.some((other) => MEET[other.kind](other, start, LIGHT));
  const light = 0.5 + (isShaded ? 0 : 0.62 * Math.max(0, dot(normal, LIGHT)));
  const shown = light * (1 + texture(point, grain, depth / WIDTH, z / WIDTH, part));
  return color.map((value) => value * shown);
}

// Noise of several sizes, the finest three pixels at the approximate depth of a part; sizes too small for a
// pixel at a larger distance fade out.
function texture([x, y, z], [dx, dy, dz], pixel, shown, seed) {
  let [sum, size] = [0, 3 * pixel];
  for (let octave = 0; octave < STRENGTHS.length; octave++, size *= 2.1) {
    const weight = Math.min(1, Math.max(0, size / shown / 1.5 - 1));
    if (weight) sum += weight * STRENGTHS[octave] * noise((x * dx) / size, (y * dy) / size, (z * dz) / size, 7 * seed + octave);
  }
  return sum;
}

const blend = (share) => share * share * (3 - 2 * share);

// Smooth noise from -1 to 1: hashes of the corners of a cube, blended.
function noise(x, y, z, seed) {
  const [i, j, k] = [Math.floor(x), Math.floor(y), Math.floor(z)];
  const [u, v, w] = [blend(x - i), blend(y - j), blend(z - k)];
  const near = side(i, j, k, u, v, seed);
  return near + w * (side(i, j, k + 1, u, v, seed) - near);
}

function side(i, j, k, u, v, seed) {
  const first = edge(i, j, k, u, seed);
  return first + v * (edge(i, j + 1, k, u, seed) - first);
}

function edge(i, j, k, u, seed) {
  const first = hash(i, j, k, seed);
  return first + u * (hash(i + 1, j, k, seed) - first);
}

function hash(i, j, k, seed) {
  let value = Math.imul(i, 0x27d4eb2d) ^ Math.imul(j, 0x165667b1) ^ Math.imul(k, 0x1b873593) ^ Math.imul(seed + 1, 0x2545f491);
  value = Math.imul(value ^ (value >>> 15), 0x85ebca6b);
  value = Math.imul(value ^ (value >>> 13), 0xc2b2ae35);
  return ((value ^ (value >>> 16)) >>> 0) / 2 ** 31 - 1;
}

// The normal along an axis, toward the origin of a ray.
function facing(axis, way) {
  const normal = [0, 0, 0];
  normal[axis] = -Math.sign(way[axis]);
  return normal;
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function unit(way) {
  const length = Math.hypot(...way);
  return way.map((value) => value / length);
}
