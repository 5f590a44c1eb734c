// The results of a match, as files for the user.

// The visible points, in the left camera's coordinates, with the colors of the left image.
function cloudFile() {
  const seen = pointsSeen();
  const chosen = Array.from(maps.disparity.keys()).filter((at) => seen[at] && isKept(at, element("keep").value));
  const axes = ["x", "y", "z"].map((name) => `property float ${name}\n`).join("");
  const colors = ["red", "green", "blue"].map((name) => `property uchar ${name}\n`).join("");
  const head = `ply\nformat binary_little_endian 1.0\nelement vertex ${chosen.length}\n${axes}${colors}end_header\n`;
  const bytes = new DataView(new ArrayBuffer(15 * chosen.length));
  chosen.forEach((at, n) => {
    pointOf(at).forEach((value, axis) => bytes.setFloat32(15 * n + 4 * axis, value, true));
    for (let channel = 0; channel < 3; channel++) bytes.setUint8(15 * n + 12 + channel, pictures.left.bytes[4 * at + channel]);
  });
  return new Blob([head, bytes]);
}

// The disparities in pixels, infinite where missing, the last row first, as in PFM.
function mapFile() {
  const { cols, rows } = page;
  const bytes = new DataView(new ArrayBuffer(4 * cols * rows));
  maps.disparity.forEach((value, at) => {
    const row = rows - 1 - Math.floor(at / cols);
    bytes.setFloat32(4 * (row * cols + (at % cols)), Number.isFinite(value) ? value : Infinity, true);
  });
  return new Blob([`Pf\n${cols} ${rows}\n-1\n`, bytes]);
}

export const downloads = { "save-cloud": ["cloud.ply", cloudFile], "save-map": ["disparities.pfm", mapFile] };
