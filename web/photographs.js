// Photographs of the user's own: two files, or one with both views: side by side, or as two pictures (MPO). They are read
// here and go nowhere.

import { picturesOf } from "./mpo.js";

const MOST_PIXELS = 500_000; // of an image: larger ones are made smaller, so that a match takes seconds at most
const LEAST_RATIO = 1.2; // width by height from which on one file is taken for two views side by side
const LARGEST_UNLIKE = 0.02; // share by which width by height of two images may differ, since sizes are rounded

// The pair in some files: {left, right, note}, `note` in words. Throws an Error that says what is wrong.
export async function readPair(files) {
  const pictures = [...files];
  if (pictures.length !== 1 && pictures.length !== 2) {
    throw new Error(`files: got ${pictures.length}; accepts two images, or one with both views side by side`);
  }
  if (pictures.length === 1) {
    const views = await Promise.all((await picturesOf(pictures[0])).map((blob) => opened(blob, pictures[0].name)));
    const isPair = views.length === 2 && sizeOf(views[0]) === sizeOf(views[1]); // others are previews
    return isPair ? pairOfTwo(views) : pairOfOne(views[0], pictures[0].name);
  }
  return pairOfTwo(await Promise.all(inOrder(pictures).map((file) => opened(file, file.name))));
}

// The left image first, as far as names say: left.png before right.png, im0 before im1, img_1 before img_2.
function inOrder(files) {
  return files.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
}

async function opened(blob, name) {
  try {
    return await createImageBitmap(blob);
  } catch {
    throw new Error(`${name}: is no image that this browser reads; accepts PNG, JPEG, WebP and others`);
  }
}

function pairOfTwo([left, right]) {
  const unlike = (left.width * right.height) / (left.height * right.width);
  if (Math.abs(Math.log(unlike)) > LARGEST_UNLIKE) {
    throw new Error(`images: got ${sizeOf(left)} and ${sizeOf(right)} pixels; accepts two of one shape`);
  }
  const parts = [left, right].map(({ width, height }) => [0, width, height]);
  return pairOf([left, right], parts, left.width, left.height);
}

function pairOfOne(both, name) {
  if (both.width < LEAST_RATIO * both.height) {
    throw new Error(`${name}: got ${sizeOf(both)} pixels, too narrow for two views side by side; accepts two images then`);
  }
  const width = Math.floor(both.width / 2);
  return pairOf([both, both], [0, both.width - width].map((x) => [x, width, both.height]), width, both.height);
}

const sizeOf = ({ width, height }) => `${width} \u00d7 ${height}`;

// The parts of two bitmaps, [start, width, height] each, at the size of the first or smaller.
function pairOf(bitmaps, parts, width, height) {
  const scale = Math.min(1, Math.sqrt(MOST_PIXELS / (width * height)));
  const [cols, rows] = [width, height].map((length) => Math.max(1, Math.round(length * scale)));
  const [left, right] = bitmaps.map((bitmap, n) => {
    const canvas = Object.assign(document.createElement("canvas"), { width: cols, height: rows });
    const context = canvas.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(bitmap, parts[n][0], 0, parts[n][1], parts[n][2], 0, 0, cols, rows);
    return context.getImageData(0, 0, cols, rows);
  });
  const note = `${sizeOf({ width, height })} pixels${scale < 1 ? `, matched at ${cols} \u00d7 ${rows}` : ""}.`;
  return { left, right, note };
}
