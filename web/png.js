// PNG files with 16 bits per channel. Browsers keep the upper 8, which are black if a camera uses the lower
// 10 or 12.

const SIGNATURE = 0x89504e47;
const [HEAD, DATA, END] = [0x49484452, 0x49444154, 0x49454e44]; // names of chunks
const CHANNELS = { 0: 1, 2: 3, 4: 2, 6: 4 }; // by the type of color
const MOST_PIXELS = 100_000_000;

// {width, height, channels, values, bits}: 16-bit `values` row by row, using the lower `bits`; null for any
// other file.
export async function deepImageOf(file) {
  const head = new DataView(await file.slice(0, 29).arrayBuffer());
  if (head.byteLength < 29 || head.getUint32(0) !== SIGNATURE || head.getUint32(12) !== HEAD) return null;
  const [width, height, depth, color, interlaced] = [
    head.getUint32(16), head.getUint32(20), head.getUint8(24), head.getUint8(25), head.getUint8(28),
  ];
  const channels = CHANNELS[color];
  if (depth !== 16 || interlaced || !channels) return null;
  if (!(width * height > 0 && width * height <= MOST_PIXELS)) {
    throw new Error(`got ${width} \u00d7 ${height} pixels; accepts 1 to ${MOST_PIXELS.toLocaleString("en")} in all`);
  }

  const plain = new Blob(await chunksOf(file)).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(limited(plain, height * (1 + 2 * channels * width))).arrayBuffer());
  const values = unfiltered(bytes, width, height, channels);
  const bits = 32 - Math.clz32(values.reduce((most, value) => Math.max(most, value), 0));
  return { width, height, channels, values, bits };
}

// The parts of a file that contain pixels.
async function chunksOf(file) {
  const parts = [];
  for (let at = 8; at + 12 <= file.size;) {
    const chunk = new DataView(await file.slice(at, at + 8).arrayBuffer());
    const [length, name] = [chunk.getUint32(0), chunk.getUint32(4)];
    if (name === DATA) parts.push(file.slice(at + 8, at + 8 + length));
    if (name === END) break;
    at += 12 + length;
  }
  return parts;
}

// At most this many bytes of a stream, however large it would unpack; an Error if it is shorter.
function limited(stream, size) {
  let left = size;
  return stream.pipeThrough(new TransformStream({
    transform(part, control) {
      control.enqueue(part.subarray(0, left));
      left -= Math.min(left, part.length);
      if (!left) control.terminate();
    },
    flush() {
      if (left) throw new Error("the file ends early");
    },
  }));
}

// Each row is filtered by one of five rules, which go back to the bytes to the left and above (PNG, 9.2).
function unfiltered(bytes, width, height, channels) {
  const [reach, length] = [2 * channels, 2 * channels * width];
  const plain = new Uint8Array(height * length);
  for (let y = 0; y < height; y++) {
    const [rule, from, to] = [bytes[y * (length + 1)], y * (length + 1) + 1, y * length];
    const rest = RULES[rule];
    if (!rest) throw new Error("the file is damaged");
    for (let x = 0; x < length; x++) {
      const left = x >= reach ? plain[to + x - reach] : 0;
      const above = y ? plain[to + x - length] : 0;
      const corner = y && x >= reach ? plain[to + x - length - reach] : 0;
      plain[to + x] = bytes[from + x] + rest(left, above, corner);
    }
  }
  const view = new DataView(plain.buffer);
  return Uint16Array.from({ length: plain.length / 2 }, (_, at) => view.getUint16(2 * at));
}

const RULES = [() => 0, (left) => left, (left, above) => above, (left, above) => (left + above) >> 1, paeth];

function paeth(left, above, corner) {
  const guess = left + above - corner;
  const [a, b, c] = [left, above, corner].map((one) => Math.abs(guess - one));
  return a <= b && a <= c ? left : b <= c ? above : corner;
}

// The image as a canvas with 8 bits per channel, from the `bits` in use.
export function canvasOfDeep({ width, height, channels, values }, bits) {
  const shift = Math.max(0, bits - 8);
  const image = new ImageData(width, height);
  for (let at = 0; at < width * height; at++) {
    for (let channel = 0; channel < 3; channel++) {
      image.data[4 * at + channel] = values[at * channels + (channels > 2 ? channel : 0)] >> shift;
    }
    image.data[4 * at + 3] = 255;
  }
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
