// Measuring: two marks, A and B, in the left image. Their depths and their distance have error bars; the line between them is a
// cross section, and the rectangle that they span is fitted by a plane.
//
// A point P of disparity d moves along its ray: dP/dd = -P / (d + doffs). The errors of two pixels are independent, so their
// distance L, in direction u, has the variance (u dP1/dd1)^2 s1^2 + (u dP2/dd2)^2 s2^2 (propagation of uncertainty, JCGM 100:2008,
// 5.1.2), s being an error bar by 1.645, as 90 % are within one. A yaw of the cameras moves both at once: what it does to L at
// most is added, as phasestereo.depth_interval adds it.

const NINETY = 1.645; // standard deviations on either side hold 90 %
const SURE = 0.5; // least confidence of what is trusted, as phasestereo.Result.trusted has it
const marks = { A: null, B: null };
// What a known length has set: the factor of all lengths, their unit, and the share of each that it leaves open; the focal
// length that photographs name, in pixels.
const known = { factor: 1, unit: null, share: 0, focal: null };

const placeOf = ({ x, y }) => y * page.cols + x;
const isPoint = (at) => Number.isFinite(maps.disparity[at]) && depthOf(maps.disparity[at]) > 0;
const isTrusted = (at) => Number.isFinite(maps.disparity[at]) && (maps.confidence ? maps.confidence[at] >= SURE : !maps.flags[at]);
const dot = (one, other) => one.reduce((sum, value, axis) => sum + value * other[axis], 0);
const withUnit = (text) => (page.scene.unit ? `${text} ${page.scene.unit}` : text);
const inUnit = (value) => withUnit(figures(value));
const rounded = (value) => String(Number(value.toPrecision(2)));

// The distance of two pixels' points and its error bar, which holds the true one with a probability of 90 %.
function lengthBetween(first, second) {
  const [one, other] = [first, second].map(pointOf);
  const apart = other.map((value, axis) => value - one[axis]);
  const length = Math.hypot(...apart);
  if (!maps.uncertainty) return { length, bar: NaN };
  const direction = apart.map((value) => value / (length || 1));
  const [near, far] = [[one, first], [other, second]].map(([point, at]) => {
    const disparity = maps.disparity[at];
    const slope = -dot(direction, point) / (disparity + page.scene.doffs);
    return { own: slope * maps.uncertainty[at], common: slope * yawOf((at % page.cols) * page.step, disparity) };
  });
  const matched = Math.hypot(near.own, far.own) + Math.abs(far.common - near.common);
  return { length, bar: Math.hypot(matched, known.share * length) };
}

// The plane of the trusted pixels of a rectangle: least squares in disparity, where errors are alike and a plane in space is
// one, too: d + doffs = a x + b y + c are the points with n P = scale, n = (a fx, b fy, a cx + b cy + c).
function planeIn({ x: x0, y: y0 }, { x: x1, y: y1 }) {
  const [left, right, top, bottom] = [Math.min(x0, x1), Math.max(x0, x1), Math.min(y0, y1), Math.max(y0, y1)];
  const chosen = [];
  for (let y = top; y <= bottom; y++) for (let x = left; x <= right; x++) if (isTrusted(y * page.cols + x) && isPoint(y * page.cols + x)) chosen.push([x, y]);
  const pixels = (right - left + 1) * (bottom - top + 1);
  const size = Math.max(right - left, bottom - top, 1);
  const terms = ([x, y]) => [(x - left) / size, (y - top) / size, 1];
  const matrix = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  const wanted = [0, 0, 0];
  for (const pixel of chosen) {
    const term = terms(pixel);
    const shift = maps.disparity[placeOf({ x: pixel[0], y: pixel[1] })] + page.scene.doffs;
    term.forEach((one, row) => {
      wanted[row] += one * shift;
      term.forEach((other, column) => (matrix[row][column] += one * other));
    });
  }
  const found = solved(matrix, wanted, chosen.length);
  if (!found) return { pixels, trusted: chosen.length };
  const { focal: [fx, fy], center: [cx, cy], scale } = page.scene;
  const [a, b] = [found[0] / (size * page.step), found[1] / (size * page.step)];
  const c = found[2] - (found[0] * left + found[1] * top) / size;
  const across = [a * fx, b * fy, a * cx + b * cy + c];
  const norm = Math.hypot(...across);
  let [sum, shifts] = [0, 0];
  for (const [x, y] of chosen) {
    const at = y * page.cols + x;
    sum += ((dot(across, pointOf(at)) - scale) / norm) ** 2;
    shifts += (maps.disparity[at] + page.scene.doffs - dot(found, terms([x, y]))) ** 2;
  }
  const normal = across.map((value) => -value / norm); // towards the camera
  const [rms, rmsShift] = [sum, shifts].map((value) => Math.sqrt(value / chosen.length));
  return { normal, distance: scale / norm, rms, rmsShift, pixels, trusted: chosen.length };
}

// Three equations by Cramer's rule; null where pixels lie on a line.
function solved(matrix, wanted, count) {
  const determinant = ([p, q, r]) =>
    p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0]) + p[2] * (q[0] * r[1] - q[1] * r[0]);
  const whole = determinant(matrix);
  if (!(whole > 1e-9 * count ** 3)) return null;
  return [0, 1, 2].map((column) =>
    determinant(matrix.map((row, at) => row.map((value, place) => (place === column ? wanted[at] : value)))) / whole);
}

// The pixels of the line from A to B, one for each column or row.
function lineBetween(first, second) {
  const count = Math.max(Math.abs(second.x - first.x), Math.abs(second.y - first.y), 1);
  return Array.from({ length: count + 1 }, (_, n) => placeOf({
    x: Math.round(first.x + ((second.x - first.x) * n) / count), y: Math.round(first.y + ((second.y - first.y) * n) / count),
  }));
}

// The depths along the line with their error bars, hatched where they are not trusted.
function sectionOf(line) {
  const [width, height, room] = [640, 150, 12];
  const points = line.map((at) => (isPoint(at) ? depthOf(maps.disparity[at]) : NaN));
  const sure = points.filter((depth, n) => Number.isFinite(depth) && isTrusted(line[n]));
  const shown = sure.length ? sure : points.filter(Number.isFinite);
  if (!shown.length) return "";
  let [low, high] = shown.reduce(([least, most], depth) => [Math.min(least, depth), Math.max(most, depth)], [Infinity, -Infinity]);
  const spread = 0.08 * (high - low) || 0.01 * high;
  [low, high] = [low - spread, high + spread];
  const x = (n) => ((n * width) / (line.length - 1)).toFixed(1);
  const y = (depth) => (room + (height - 2 * room) * (1 - (Math.min(high, Math.max(low, depth)) - low) / (high - low))).toFixed(1);
  const bars = [], path = [], doubt = [];
  const half = width / (line.length - 1) / 2;
  line.forEach((at, n) => {
    if (!isTrusted(at)) doubt.push(`M${x(n - 0.5)} 0h${2 * half}V${height}h${-2 * half}z`);
    if (!Number.isFinite(points[n])) return;
    path.push(`${Number.isFinite(points[n - 1]) ? "L" : "M"}${x(n)} ${y(points[n])}`);
    if (!maps.uncertainty) return;
    const [near, far] = depthEnds((at % page.cols) * page.step, maps.disparity[at], maps.uncertainty[at]);
    bars.push(`M${x(n)} ${y(near)}V${y(far)}`);
  });
  const label = `Cross section from A to B: trusted depths from ${inUnit(low + spread)} to ${inUnit(high - spread)}`;
  return `<svg viewBox="0 0 ${width} ${height}" preserveAspectRatio="none" role="img" aria-label="${label}">
    <pattern id="hatch" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><path d="M0 0V7"/></pattern>
    <path class="doubt" d="${doubt.join("")}"/><path class="bars" style="stroke-width:${Math.max(1, 2 * half)}" d="${bars.join("")}"/>
    <path class="line" d="${path.join("")}"/></svg>
    <p class="note">Depth from A to B: ${inUnit(low + spread)} below, ${inUnit(high - spread)} above; the band is the error bar, hatched where it is not trusted.</p>`;
}

// The sentences on the marks, one each.
function measured() {
  const said = [];
  const given = Object.entries(marks).filter(([, mark]) => mark);
  for (const [name, mark] of given) {
    const at = placeOf(mark);
    const depth = isPoint(at) ? `depth ${withUnit(depthText(depthOf(maps.disparity[at]), mark.x * page.step, at))}` : "no depth";
    said.push(`${name} at ${mark.x * page.step}, ${mark.y * page.step}: ${depth}${isTrusted(at) ? "" : ", not trusted"}.`);
  }
  if (given.length < 2) return said;
  const [first, second] = [marks.A, marks.B].map(placeOf);
  if (!isPoint(first) || !isPoint(second)) return [...said, "No length: a mark has no depth."];
  const { length, bar } = lengthBetween(first, second);
  said.push(`Length from A to B: ${Number.isFinite(bar) ? `${withUnit(`${figures(length)} \u00b1 ${rounded(bar)}`)} (90 %)` : inUnit(length)}.`);
  const plane = planeIn(marks.A, marks.B);
  const share = `${plane.trusted.toLocaleString("en")} of ${plane.pixels.toLocaleString("en")} pixels trusted`;
  said.push(plane.normal
    ? `Plane of the rectangle: normal ${plane.normal.map((value) => numberOf(value, 3)).join(", ")}; distance ${inUnit(plane.distance)}; `
      + `rms ${figures(plane.rms)} (${numberOf(plane.rmsShift, 3)} px); ${share}.`
    : `No plane in the rectangle: ${share}.`);
  return said;
}

function tellMeasures() {
  const said = measured();
  element("measured").replaceChildren(...said.map((textContent) => made("li", { textContent })));
  const both = marks.A && marks.B;
  element("scaling").hidden = !page.scene.nominal; // a calibration has set it
  element("section").innerHTML = both ? sectionOf(lineBetween(marks.A, marks.B)) : "";
  element("set-scale").disabled = !both || !isPoint(placeOf(marks.A)) || !isPoint(placeOf(marks.B));
  stage.refresh();
}

function mark(name) {
  if (!state.pixel) return;
  marks[name] = { ...state.pixel };
  hold(state.pixel);
  tellMeasures();
}

function forgetMarks() {
  Object.assign(marks, { A: null, B: null });
  tellMeasures();
}

// The length from A to B is known: all others follow from it.
function setScale() {
  const length = Number(element("known").value);
  const found = lengthBetween(placeOf(marks.A), placeOf(marks.B));
  if (!(length > 0 && Number.isFinite(length) && found.length > 0)) {
    element("known").setCustomValidity("A length is a positive number.");
    element("known").reportValidity();
    return;
  }
  known.share = 0;
  const { bar } = lengthBetween(placeOf(marks.A), placeOf(marks.B));
  known.share = Number.isFinite(bar) ? bar / found.length : 0;
  const factor = length / found.length;
  Object.assign(known, { factor: known.factor * factor, unit: element("unit").value.trim() });
  page.scene.scale *= factor;
  page.scene.limit *= factor;
  page.scene.unit = known.unit;
  readOut(state.pixel);
  tellMeasures();
  renewScene();
  if (cloud?.gl) cloud.reset();
}

// Marks of a map that has changed its size are elsewhere.
function keepMarks() {
  for (const name of ["A", "B"]) if (marks[name] && !inside(marks[name].x, marks[name].y)) marks[name] = null;
  tellMeasures();
}

function drawMeasures(context) {
  const width = 1.5 / stage.scale;
  const { A, B } = marks;
  for (const [style, thick] of [["rgb(0 0 0 / .75)", 3 * width], ["white", width]]) {
    context.strokeStyle = style;
    context.lineWidth = thick;
    if (A && B) {
      context.beginPath();
      context.moveTo(A.x + 0.5, A.y + 0.5);
      context.lineTo(B.x + 0.5, B.y + 0.5);
      context.stroke();
      context.strokeRect(Math.min(A.x, B.x), Math.min(A.y, B.y), Math.abs(A.x - B.x) + 1, Math.abs(A.y - B.y) + 1);
    }
  }
  context.font = `700 ${16 / stage.scale}px system-ui`;
  for (const [name, at] of Object.entries(marks)) {
    if (!at) continue;
    drawBox(context, at.x, at.y, "white");
    context.strokeStyle = "black";
    context.lineWidth = 3 * width;
    context.strokeText(name, at.x + 8 / stage.scale, at.y - 6 / stage.scale);
    context.fillStyle = "white";
    context.fillText(name, at.x + 8 / stage.scale, at.y - 6 / stage.scale);
  }
}

function bindMeasure() {
  for (const name of ["A", "B"]) element(`mark-${name}`).addEventListener("click", () => mark(name));
  element("unmark").addEventListener("click", forgetMarks);
  element("known").addEventListener("input", () => element("known").setCustomValidity(""));
  element("scaling").addEventListener("submit", (event) => {
    event.preventDefault();
    setScale();
  });
}
