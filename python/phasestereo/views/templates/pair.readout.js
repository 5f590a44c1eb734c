// The read-out: the values of one pixel, what is around it in both images, and the scale.

const LENS = 15; // image pixels across

const named = (flags) => page.flags.filter(({ bit }) => flags & bit).map(({ name }) => name);
const inside = (x, y) => x >= 0 && y >= 0 && x < page.cols && y < page.rows;

function intensity(side, x, y) {
  if (!inside(x, y)) return "outside";
  const at = 4 * (y * page.cols + x);
  const [r, g, b] = pictures[side].bytes.subarray(at, at + 3);
  return page.gray[side] ? `${r}` : `${r} ${g} ${b}`;
}

// The texts on a pixel, by the rows of the read-out, also of rows that are not on this page.
function valuesOf({ x, y }) {
  const at = y * page.cols + x;
  const found = maps.disparity[at];
  const known = Number.isFinite(found);
  const none = "\u2013";
  const match = x * page.step - found;
  const depth = depthOf(found);
  return {
    pixel: `${x * page.step}, ${y * page.step}`,
    disparity: known ? numberOf(found, 2, "px") : "no estimate",
    match: known ? numberOf(match, 2) : none,
    confidence: maps.confidence && numberOf(maps.confidence[at], 2),
    uncertainty: maps.uncertainty && (known ? `\u00b1${numberOf(maps.uncertainty[at], 2, "px")}` : none),
    flags: named(maps.flags[at]).join(", ") || "none",
    truth: Number.isFinite(maps.truth?.[at]) ? numberOf(maps.truth[at], 2, "px") : "unknown",
    error: !maps.scored?.[at] ? "not scored" : known ? numberOf(found - maps.truth[at], 2, "px") : "missing",
    depth: depth > 0 ? withUnit(depthText(depth, x * page.step, at)) : none,
    left: intensity("left", x, y),
    right: known ? intensity("right", Math.round(match / page.step), y) : none,
  };
}

const figures = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(4))) : "\u221e");

// A depth, and the ends of its error bar.
function depthText(depth, x, at) {
  if (!maps.uncertainty) return figures(depth);
  const [near, far] = depthEnds(x, maps.disparity[at], maps.uncertainty[at]).map(figures);
  return `${figures(depth)} (${near} to ${far})`;
}

function readOut(pixel) {
  state.pixel = pixel;
  const values = valuesOf(pixel);
  for (const cell of element("values").querySelectorAll("dd")) {
    cell.textContent = values[cell.id.replace("value-", "")];
  }
  drawLens("left", pixel.x, pixel.y);
  drawLens("right", pixel.x - maps.disparity[pixel.y * page.cols + pixel.x] / page.step, pixel.y);
  pointAtScale();
  stage.refresh();
}

// What an image shows around a place, enlarged, the place in the middle.
function drawLens(side, x, y) {
  const canvas = element(`lens-${side}`);
  const context = canvas.getContext("2d");
  const scale = canvas.width / LENS;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!Number.isFinite(x)) return;
  context.imageSmoothingEnabled = false;
  context.setTransform(scale, 0, 0, scale, (LENS / 2 - x - 0.5) * scale, (LENS / 2 - y - 0.5) * scale);
  context.drawImage(pictures[side].canvas, 0, 0);
  for (const [style, width] of [["black", 0.3], [side === "left" ? "white" : "#ffd33d", 0.12]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.strokeRect(x, y, 1, 1);
  }
}

// Hold a pixel, so that the pointer may leave; null: let go.
function hold(pixel) {
  state.held = Boolean(pixel);
  element("pinned").textContent = pixel ? "Held. Click or press Esc to let go." : "Click to hold a pixel.";
  if (pixel) readOut(pixel);
}

function stepBy([dx, dy], count) {
  const within = (value, size) => Math.min(size - 1, Math.max(0, value));
  const { x, y } = state.pixel;
  hold({ x: within(x + dx * count, page.cols), y: within(y + dy * count, page.rows) });
  if (!stage.shows(state.pixel)) stage.move(state.pixel.x + 0.5, state.pixel.y + 0.5);
  const rows = [...element("values").children];
  element("spoken").textContent = rows.map(({ children: [name, value] }) => `${name.textContent} ${value.textContent}`).join("; ");
}

function bindReadout() {
  const pixelAt = (event) => {
    const [x, y] = stage.at(event).map(Math.floor);
    return inside(x, y) ? { x, y } : null;
  };
  stage.canvas.addEventListener("pointermove", (event) => {
    const pixel = pixelAt(event);
    if (pixel && !state.held) readOut(pixel);
  });
  stage.canvas.addEventListener("click", (event) => {
    if (stage.dragged) return;
    hold(state.held ? null : pixelAt(event));
    if (!state.held && pixelAt(event)) readOut(pixelAt(event));
  });
}

// The scale below the stage: a bar of colors, or the flags to pick out.
function showScale(view) {
  const scale = element("scale");
  if (scale.dataset.view === view.key) return;
  scale.dataset.view = view.key;
  scale.replaceChildren(...(view.table ? barOf(view) : view.key === "flags" ? legend() : []));
  pointAtScale();
}

function barOf(layer) {
  const stops = Array.from({ length: 33 }, (_, n) => {
    const at = 3 * Math.round((n * 255) / 32);
    return `rgb(${layer.table.subarray(at, at + 3).join(" ")})`;
  });
  if (layer.key === "error") stops.splice(0, stops.length, ...hardStops(layer));
  const bar = made("div", { className: "colors" }, made("i", { id: "needle" }));
  bar.style.background = `linear-gradient(90deg, ${stops})`;
  const ticks = made("div", { className: "ticks" });
  const places = Math.max(0, Math.ceil(1 - Math.log10(layer.high - layer.low)));
  for (let n = 0; n <= 4; n++) {
    const value = layer.low + (n * (layer.high - layer.low)) / 4;
    const beyond = n === 4 && layer.key === "error" ? "+" : "";
    ticks.append(made("span", { textContent: `${numberOf(value, places)}${beyond}` }));
  }
  const unit = layer.unit ? `${layer.label}, ${layer.unit}` : layer.label;
  const chips = [chip(NO_ESTIMATE, layer.key === "truth" ? "unknown" : "no estimate")];
  if (layer.key === "error") chips.push(chip(NOT_SCORED, "not scored"));
  const words = made("p", { className: "note" }, made("strong", { textContent: unit }), ` \u2013 ${layer.hint}`, ...chips);
  return [bar, ticks, words];
}

// All 256 colors, each as wide as it is: a gradient would blur where white ends.
const hardStops = ({ table }) => Array.from({ length: 256 }, (_, n) =>
  `rgb(${table.subarray(3 * n, 3 * n + 3).join(" ")}) ${n / 2.56}% ${(n + 1) / 2.56}%`);

function chip(color, text) {
  const box = made("i", {});
  box.style.background = `rgb(${[...color].join(" ")})`;
  return made("span", { className: "key" }, box, text);
}

function legend() {
  const held = made("div", { className: "flags" });
  for (const kind of page.flags) {
    const button = made("button", { type: "button", title: `${kind.meaning}; ${kind.pixels} pixels. Press to pick it out.` },
      ...chip(hex(kind.color), `${kind.name} ${(100 * kind.share).toFixed(1)} %`).childNodes);
    button.setAttribute("aria-pressed", String(state.only === kind.bit));
    button.addEventListener("click", () => pick(state.only === kind.bit ? 0 : kind.bit));
    held.append(button);
  }
  const rest = page.flags.length ? "Press a flag to pick it out; pixels with several have the color of the first." : "No pixel has a flag.";
  return [held, made("p", { className: "note" }, rest, chip(UNFLAGGED, "nothing held against it"))];
}

function pick(bit) {
  state.only = bit;
  delete shown.flags;
  page.flags.forEach((kind, place) => {
    element("scale").querySelectorAll("button")[place].setAttribute("aria-pressed", String(bit === kind.bit));
  });
  stage.refresh();
}

// The needle on the scale: where the value of the pixel lies.
function pointAtScale() {
  const needle = element("needle");
  const layer = viewOf(state.view);
  if (!needle || !layer.table) return;
  const value = state.pixel ? maps[state.view][state.pixel.y * page.cols + state.pixel.x] : NaN;
  const share = Math.min(1, Math.max(0, (value - layer.low) / (layer.high - layer.low)));
  needle.hidden = !Number.isFinite(value);
  needle.style.left = `${100 * share}%`;
}
