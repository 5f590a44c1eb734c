// The pictures of a JPEG file: one, or several as cameras with two lenses write (MPO, CIPA DC-007). Behind the marker APP2
// and "MPF", a TIFF directory says where each picture begins, counted from that directory's header, and how long it is.

const MOST_HEADER = 2 ** 18; // bytes before the pixels of the first picture
const [START, APP2, SCAN] = [0xffd8, 0xffe2, 0xffda];
const MPF = 0x4d504600;
const [LITTLE, COUNT, ENTRIES] = [0x4949, 0xb001, 0xb002];

// The first two pictures of a file, as blobs; the file alone if it holds one.
export async function picturesOf(file) {
  const view = new DataView(await file.slice(0, MOST_HEADER).arrayBuffer());
  try {
    const parts = partsOf(view).filter(([start, length]) => length > 0 && start + length <= file.size);
    if (parts.length === 2) return parts.map(([start, length]) => file.slice(start, start + length, "image/jpeg"));
  } catch (error) {
    if (!(error instanceof RangeError)) throw error; // the header ends early: there is nothing to be read of it
  }
  return [file];
}

// [start, length] of the first two pictures.
function partsOf(view) {
  if (view.byteLength < 4 || view.getUint16(0) !== START) return [];
  for (let at = 2; at + 4 <= view.byteLength && view.getUint16(at) !== SCAN; at += 2 + view.getUint16(at + 2)) {
    if (view.getUint16(at) === APP2 && view.getUint32(at + 4) === MPF) return entriesOf(view, at + 8);
  }
  return [];
}

function entriesOf(view, base) {
  const isLittle = view.getUint16(base) === LITTLE;
  const short = (at) => view.getUint16(at, isLittle);
  const long = (at) => view.getUint32(at, isLittle);

  const directory = base + long(base + 4);
  const fields = new Map();
  for (let n = 0; n < short(directory); n += 1) {
    const field = directory + 2 + 12 * n;
    fields.set(short(field), long(field + 8));
  }
  if (!(fields.get(COUNT) >= 2)) return [];

  return [0, 1].map((n) => {
    const entry = base + fields.get(ENTRIES) + 16 * n;
    const offset = long(entry + 8);
    return [offset && base + offset, long(entry + 4)]; // 0: the file begins with it
  });
}
