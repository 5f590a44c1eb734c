// What the page holds: numbers, maps and pictures, unpacked once.

const page = JSON.parse(document.getElementById("page").textContent);
const maps = {}; // typed arrays by name, row by row
const pictures = {}; // canvases and their RGBA bytes by name: left, right

const element = (id) => document.getElementById(id);

function made(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

// An array as `packed` wrote it: first all first bytes of its numbers, then all second ones ...
async function unpacked(text, Numbers) {
  const packed = new Blob([bytesOf(text)]).stream();
  const plain = packed.pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(plain).arrayBuffer());
  const size = Numbers.BYTES_PER_ELEMENT;
  const count = planes.length / size;
  const bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < size; plane++) {
    for (let at = 0; at < count; at++) bytes[at * size + plane] = planes[plane * count + at];
  }
  return new Numbers(bytes.buffer);
}

async function loadMaps() {
  const types = {
    disparity: Float32Array, confidence: Float32Array, truth: Float32Array,
    flags: Uint16Array, scored: Uint8Array,
  };
  for (const [name, Numbers] of Object.entries(types)) {
    const holder = element(`array-${name}`);
    if (holder) maps[name] = await unpacked(holder.textContent, Numbers);
  }
  if (maps.truth) maps.error = maps.disparity.map((found, at) => errorOf(found, at));
}

// Infinite where an estimate is missing that counts, NaN where nothing counts.
function errorOf(found, at) {
  if (!maps.scored[at]) return NaN;
  return Number.isFinite(found) ? Math.abs(found - maps.truth[at]) : Infinity;
}

async function loadPicture(side) {
  const image = element(`picture-${side}`);
  await image.decode();
  const canvas = made("canvas", { width: page.cols, height: page.rows });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, page.cols, page.rows);
  pictures[side] = { canvas, bytes: context.getImageData(0, 0, page.cols, page.rows).data };
}

const numberOf = (value, places, unit = "") =>
  `${value.toFixed(places).replace("-", "\u2212")}${unit && ` ${unit}`}`;
