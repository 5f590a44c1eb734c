// Maps and pictures that the page itself holds, unpacked once.

// An array as `packed` wrote it: differences of neighbors, first all first bytes, then all second.
async function unpacked(text, Numbers) {
  const packed = new Blob([bytesOf(text)]).stream();
  const plain = packed.pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(plain).arrayBuffer());
  const size = Numbers.BYTES_PER_ELEMENT;
  const count = planes.length / size;
  const bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < size; plane++) {
    const from = plane * count;
    for (let at = 0, to = plane; at < count; at++, to += size) bytes[to] = planes[from + at];
  }
  const numbers = new Numbers(bytes.buffer);
  for (let at = 1; at < count; at++) numbers[at] += numbers[at - 1]; // and wraps, as it did there
  return numbers;
}

// The values of a map from their codes; the last code stands for none.
function decoded(codes, [low, step]) {
  return Float32Array.from(codes, (code) => (code === 0xffff ? NaN : low + code * step));
}

async function loadMaps() {
  const types = {
    disparity: Uint16Array, confidence: Uint8Array, uncertainty: Uint16Array, truth: Uint16Array, flags: Uint16Array,
    scored: Uint8Array,
  };
  for (const [name, Numbers] of Object.entries(types)) {
    const holder = element(`array-${name}`);
    if (holder) maps[name] = await unpacked(holder.textContent, Numbers);
  }
  maps.codes = maps.disparity;
  for (const [name, coding] of Object.entries(page.codings)) if (maps[name]) maps[name] = decoded(maps[name], coding);
  if (maps.confidence) maps.confidence = Float32Array.from(maps.confidence, (code) => code / 255);
  if (maps.truth) maps.error = maps.disparity.map((found, at) => errorOf(found, at));
}

async function loadPicture(side) {
  const image = element(`picture-${side}`);
  await image.decode();
  const canvas = made("canvas", { width: page.cols, height: page.rows });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, page.cols, page.rows);
  pictures[side] = { canvas, bytes: context.getImageData(0, 0, page.cols, page.rows).data };
}
