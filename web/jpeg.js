// The metadata of JPEG files: the two pictures of cameras with two lenses (MPO, CIPA DC-007), and the focal
// length (Exif). Both are in TIFF directories, whose offsets count from their header.

const MOST_HEADER = 2 ** 18; // bytes before the pixels of the first picture
const [START, APP1, APP2, SCAN] = [0xffd8, 0xffe1, 0xffe2, 0xffda];
const [MPF, EXIF] = [0x4d504600, 0x45786966]; // "MPF\0" and "Exif"
const LITTLE = 0x4949;
const [COUNT, ENTRIES] = [0xb001, 0xb002]; // of a directory of pictures
const [PHOTOGRAPH, FOCAL_35] = [0x8769, 0xa405]; // where the directory of the photograph is, and in it the focal length
const SHORT = 3; // the type of a field

// The first two pictures of a file, as blobs; only the file if it contains one.
export async function picturesOf(file) {
  const parts = (await told(file, APP2, MPF, 4, entriesOf)) ?? [];
  const inside = parts.filter(([start, length]) => length > 0 && start + length <= file.size);
  return inside.length === 2 ? inside.map(([start, length]) => file.slice(start, start + length, "image/jpeg")) : [file];
}

// The focal length in mm with this angle of view on a film of 36 mm x 24 mm; null if the file does not have
// it.
export async function focal35Of(file) {
  return (await told(file, APP1, EXIF, 6, (directory) => directory.at(directory.first.get(PHOTOGRAPH)).get(FOCAL_35))) || null;
}

// The contents of the directory behind a marker and a name; null if it is missing or ends early.
async function told(file, marker, name, skipped, read) {
  const view = new DataView(await file.slice(0, MOST_HEADER).arrayBuffer());
  try {
    if (view.getUint16(0) !== START) return null;
    for (let at = 2; view.getUint16(at) !== SCAN; at += 2 + view.getUint16(at + 2)) {
      if (view.getUint16(at) === marker && view.getUint32(at + 4) === name) return read(new Directory(view, at + 4 + skipped));
    }
  } catch (error) {
    if (!(error instanceof RangeError)) throw error;
  }
  return null;
}

class Directory {
  constructor(view, base) {
    const isLittle = view.getUint16(base) === LITTLE;
    Object.assign(this, { base, short: (at) => view.getUint16(at, isLittle), long: (at) => view.getUint32(at, isLittle) });
    this.first = this.at(this.long(base + 4));
  }

  // The fields of a directory: their values, or where these are.
  at(offset) {
    const start = this.base + offset;
    const fields = new Map();
    for (let n = 0; n < this.short(start); n++) {
      const field = start + 2 + 12 * n;
      const read = this.short(field + 2) === SHORT ? this.short : this.long;
      fields.set(this.short(field), read(field + 8));
    }
    return fields;
  }
}

// [start, length] of the first two pictures.
function entriesOf({ base, first, long }) {
  if (!(first.get(COUNT) >= 2)) return [];
  return [0, 1].map((n) => {
    const entry = base + first.get(ENTRIES) + 16 * n;
    const offset = long(entry + 8);
    return [offset && base + offset, long(entry + 4)]; // 0: the file begins with it
  });
}
