// The user's own photographs: two files, or one with both views: side by side, or as two pictures (MPO). They
// are read here and are not sent anywhere.

import { focal35Of, picturesOf } from "./jpeg.js";
import { canvasOfDeep, deepImageOf } from "./png.js";

const MOST_PIXELS = 500_000; // of an image: larger ones are made smaller, so that a match takes seconds at most
const LEAST_RATIO = 1.2; // width by height from which on one file counts as two views side by side
const LARGEST_UNLIKE = 0.02; // share by which width by height of two images may differ, since sizes are rounded
const FILM = Math.hypot(36, 24); // mm, the diagonal that focal lengths refer to

// The pair in some files: {left, right, focal, note}: `focal` in pixels if the photographs have it, `note` in
// words. Throws an Error with the reason for a failure.
export async function readPair(files) {
  const pictures = inOrder([...files]);
  if (pictures.length !== 1 && pictures.length !== 2) {
    throw new Error(`files: got ${pictures.length}; accepts two images, or one with both views side by side`);
  }
  const blobs = pictures.length === 1 ? await picturesOf(pictures[0]) : pictures;
  const views = await opened(blobs, pictures.map(({ name }) => name));
  const isPair = pictures.length === 2 || (views.length === 2 && sizeOf(views[0]) === sizeOf(views[1])); // others are previews
  if (!isPair) return pairOfOne(views[0], pictures[0].name);
  return pairOfTwo(views, await focal35Of(pictures[0]));
}

// The left image first, judging by the names: left.png before right.png, im0 before im1, img_1 before img_2.
function inOrder(files) {
  return files.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
}

// The drawable image of each file; 16-bit ones are stretched equally.
async function opened(blobs, names) {
  const read = await Promise.all(blobs.map(async (blob, n) => {
    try {
      return (await deepImageOf(blob)) ?? (await createImageBitmap(blob));
    } catch (error) {
      const isOurs = error.constructor === Error; // the browser's are less helpful
      const said = isOurs ? error.message : "is not an image that this browser reads; accepts PNG, JPEG, WebP and others";
      throw new Error(`${names[n] ?? names[0]}: ${said}`);
    }
  }));
  const bits = Math.max(...read.map((one) => one.bits ?? 8));
  return read.map((one) => (one.values ? canvasOfDeep(one, bits) : one));
}

function pairOfTwo([left, right], focal35) {
  const unlike = (left.width * right.height) / (left.height * right.width);
  if (Math.abs(Math.log(unlike)) > LARGEST_UNLIKE) {
    throw new Error(`images: got ${sizeOf(left)} and ${sizeOf(right)} pixels; accepts two of one shape`);
  }
  const parts = [left, right].map(({ width, height }) => [0, width, height]);
  const pair = pairOf([left, right], parts, left.width, left.height);
  if (!focal35) return pair;
  const focal = (focal35 / FILM) * Math.hypot(pair.left.width, pair.left.height);
  return { ...pair, focal, note: `${pair.note} Focal length ${focal35} mm (of 35 mm film), as the photographs say.` };
}

function pairOfOne(both, name) {
  if (both.width < LEAST_RATIO * both.height) {
    throw new Error(`${name}: got ${sizeOf(both)} pixels, too narrow for two views side by side; accepts two images then`);
  }
  const width = Math.floor(both.width / 2);
  return pairOf([both, both], [0, both.width - width].map((x) => [x, width, both.height]), width, both.height);
}

const sizeOf = ({ width, height }) => `${width} \u00d7 ${height}`;

// The parts of two pictures, [start, width, height] each, at the size of the first or smaller.
export function pairOf(bitmaps, parts, width, height) {
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
  return { left, right, focal: null, note };
}
