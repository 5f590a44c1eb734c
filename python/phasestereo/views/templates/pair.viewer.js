// The viewer: which layer the stage shows, mixed with the left image or flickering with the right.

const NO_ESTIMATE = [112, 112, 112];
const NOT_SCORED = [190, 190, 190];
const HANDLE = 14; // screen pixels
const UNFLAGGED = [236, 235, 230];

const hex = (color) => [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));

const views = page.views.map(([key, label]) => page.layers.find((layer) => layer.key === key) ?? { key, label });
for (const layer of page.layers) layer.table = bytesOf(layer.lookup);

const state = { view: "disparity", mix: 1, how: "wipe", timer: 0, pixel: null, held: false, only: 0, hatched: true };
const shown = {}; // canvases by view, painted when first seen
const viewOf = (key) => views.find((view) => view.key === key);
const isThere = (key) => Boolean(pictures[key] ?? maps[key]);

// Color of a value of a layer of numbers.
function colorOf(layer, value) {
  if (Number.isNaN(value)) return layer.key === "error" ? NOT_SCORED : NO_ESTIMATE;
  if (!Number.isFinite(value)) return NO_ESTIMATE;
  const share = (value - layer.low) / (layer.high - layer.low);
  const place = 3 * Math.min(255, Math.max(0, Math.floor(share * 256)));
  return layer.table.subarray(place, place + 3);
}

// Color of a pixel's flags: that of the first reason, or of the one that is picked out.
function flagColor(flags) {
  const kind = page.flags.find(({ bit }) => flags & bit && (!state.only || state.only === bit));
  return kind ? (kind.rgb ??= hex(kind.color)) : UNFLAGGED;
}

function canvasOf(key) {
  if (pictures[key]) return pictures[key].canvas;
  return (shown[key] ??= painted(viewOf(key)));
}

// A layer in its colors, every step-th pixel of every step-th row.
function painted(view, step = 1) {
  const [cols, rows] = [Math.ceil(page.cols / step), Math.ceil(page.rows / step)];
  const canvas = made("canvas", { width: cols, height: rows });
  const context = canvas.getContext("2d");
  const image = context.createImageData(cols, rows);
  const colors = new Uint32Array(image.data.buffer);
  const values = maps[view.key];
  const color = view.table ? colorsOf(view) : rememberedOf(flagColor);
  for (let y = 0, to = 0; y < page.rows; y += step) {
    for (let x = 0; x < page.cols; x += step) colors[to++] = color(values[y * page.cols + x]);
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

const word = ([red, green, blue]) => ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;

// Colors as `colorOf` has them, in one number each.
function colorsOf(layer) {
  const words = Uint32Array.from({ length: 256 }, (_, n) => word(layer.table.subarray(3 * n, 3 * n + 3)));
  const scale = 256 / (layer.high - layer.low);
  return (value) => (Number.isFinite(value)
    ? words[Math.min(255, Math.max(0, Math.floor((value - layer.low) * scale)))] : word(colorOf(layer, value)));
}

function rememberedOf(color) {
  const known = new Map();
  return (value) => {
    if (!known.has(value)) known.set(value, word(color(value)));
    return known.get(value);
  };
}

// Column of the line between the layer and the left image; null elsewhere.
function edgeOf() {
  if (state.view === "left" || state.how !== "wipe") return null;
  const [first, last] = stage.sight;
  return first + state.mix * (last - first);
}

function drawStage(context) {
  const over = canvasOf(state.view);
  const edge = edgeOf();
  const whole = state.mix >= 1 || state.view === "left";
  if (!whole) context.drawImage(canvasOf("left"), 0, 0);
  context.save();
  if (!whole && state.how === "fade") context.globalAlpha = state.mix;
  if (!whole && edge !== null) {
    context.beginPath();
    context.rect(0, 0, edge, page.rows);
    context.clip();
  }
  context.drawImage(over, 0, 0);
  if (state.hatched && viewOf(state.view).table) context.drawImage((shown.hatches ??= hatches()), 0, 0);
  context.restore();
  if (edge !== null) drawEdge(context, edge);
  drawMeasures(context);
  if (state.pixel) drawMarks(context);
}

// Stripes over what is not trusted.
function hatches() {
  const canvas = made("canvas", { width: page.cols, height: page.rows });
  const context = canvas.getContext("2d");
  const image = context.createImageData(page.cols, page.rows);
  const every = Math.max(6, Math.round(page.cols / 90));
  const colors = new Uint32Array(image.data.buffer);
  for (let at = 0; at < colors.length; at++) {
    if (isTrusted(at)) continue;
    const place = ((at % page.cols) + Math.floor(at / page.cols)) % every;
    colors[at] = 3 * place < every ? 0xd0000000 : 3 * place < 2 * every ? 0x80ffffff : 0;
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

function drawEdge(context, edge) {
  const thick = 1.5 / stage.scale;
  context.fillStyle = "rgb(0 0 0 / .5)";
  context.fillRect(edge - thick, 0, 2 * thick, page.rows);
  context.fillStyle = "white";
  context.fillRect(edge - thick / 2, 0, thick, page.rows);
  drawHandle(context, edge, stage.y);
}

// What the line is dragged by: two arrows on a disc, in the middle of what is in sight.
function drawHandle(context, x, y) {
  context.save();
  context.translate(x, y);
  context.scale(1 / stage.scale, 1 / stage.scale);
  context.beginPath();
  context.arc(0, 0, HANDLE, 0, 2 * Math.PI);
  context.fillStyle = "rgb(0 0 0 / .6)";
  context.fill();
  context.strokeStyle = "white";
  context.lineWidth = 1.5;
  context.stroke();
  context.beginPath();
  for (const side of [-1, 1]) {
    context.moveTo(4 * side, -4);
    context.lineTo(8 * side, 0);
    context.lineTo(4 * side, 4);
  }
  context.stroke();
  context.restore();
}

// The line goes with a pointer that has gone down on it, or on its handle.
function grabEdge(event) {
  if (!nearEdge(event)) return null;
  return (moved) => {
    const [first, last] = stage.sight;
    setMix(Math.min(1, Math.max(0, (stage.at(moved)[0] - first) / (last - first))));
  };
}

function nearEdge(event) {
  const edge = edgeOf();
  if (edge === null) return false;
  const [x, y] = stage.at(event);
  const across = Math.abs(x - edge) * stage.scale;
  return across < 6 || Math.hypot(across, (y - stage.y) * stage.scale) < HANDLE + 4;
}

// A box round the pixel; on the right image round its match, joined by the disparity.
function drawMarks(context) {
  const { x, y } = state.pixel;
  const found = maps.disparity[y * page.cols + x];
  if (state.view !== "right") return drawBox(context, x, y, "white");
  drawBox(context, x, y, "rgb(255 255 255 / .45)");
  if (!Number.isFinite(found)) return;
  const match = x - found / page.step;
  context.strokeStyle = "#ffd33d";
  context.lineWidth = 1.5 / stage.scale;
  context.beginPath();
  context.moveTo(x + 0.5, y + 0.5);
  context.lineTo(match + 0.5, y + 0.5);
  context.stroke();
  drawBox(context, match, y, "#ffd33d");
}

function drawBox(context, x, y, color) {
  const room = Math.max(0, 9 / stage.scale - 1) / 2; // at least nine screen pixels wide
  for (const [style, width] of [["rgb(0 0 0 / .75)", 3.5], [color, 1.5]]) {
    context.strokeStyle = style;
    context.lineWidth = width / stage.scale;
    context.strokeRect(x - room, y - room, 1 + 2 * room, 1 + 2 * room);
  }
}

function choose(key) {
  state.view = key;
  for (const input of document.querySelectorAll("#tabs input")) input.checked = input.value === key;
  element("mix-to").textContent = key === "left" ? "Left image" : viewOf(key).label;
  element("mix").disabled = key === "left";
  element("now").textContent = viewOf(key).label;
  showScale(viewOf(key));
  stage.refresh();
}

// Flicker: left and right in turn, at the same place.
const swap = () => choose(state.view === "left" ? "right" : "left");

function flicker(on) {
  clearInterval(state.timer);
  const rate = Number(element("rate").value);
  state.timer = on ? setInterval(swap, 1000 / rate) : 0;
  element("flicker").setAttribute("aria-pressed", String(on));
  if (on) setMix(1);
  if (on && state.view !== "right") choose("left");
}

function setMix(share) {
  state.mix = share;
  element("mix").value = 100 * share;
  element("mix").setAttribute("aria-valuetext", `${Math.round(100 * share)} % ${viewOf(state.view).label}`);
  stage.refresh();
}

function bindTabs() {
  for (const input of document.querySelectorAll("#tabs input")) {
    input.addEventListener("change", () => {
      flicker(false);
      choose(input.value);
    });
  }
}

// Show the maps and pictures as they are now, which may be others than before: the same layer, and
// the same pixel, if they are still there.
function renew() {
  for (const key of Object.keys(shown)) delete shown[key];
  stage.fit(page.cols, page.rows);
  for (const input of document.querySelectorAll("#tabs input")) {
    input.parentElement.hidden = !isThere(input.value);
    if (isThere(input.value)) drawSmall(input.parentElement.querySelector("canvas"), input.value);
  }
  delete element("scale").dataset.view;
  choose(isThere(state.view) ? state.view : "disparity");
  const { x, y } = state.pixel ?? {};
  readOut(inside(x, y) ? state.pixel : { x: page.cols >> 1, y: page.rows >> 1 });
  keepMarks();
}

// As much of a layer as fills a small canvas.
function drawSmall(small, key) {
  const step = Math.max(1, Math.floor(Math.min(page.cols / small.width, page.rows / small.height) / 2));
  const canvas = pictures[key]?.canvas ?? painted(viewOf(key), step);
  const context = small.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  const scale = Math.max(small.width / page.cols, small.height / page.rows);
  context.imageSmoothingQuality = "high";
  context.imageSmoothingEnabled = scale < 1;
  context.translate((small.width - page.cols * scale) / 2, (small.height - page.rows * scale) / 2);
  context.drawImage(canvas, 0, 0, page.cols * scale, page.rows * scale);
}

function bindControls() {
  element("flicker").addEventListener("click", () => flicker(!state.timer));
  element("swap").addEventListener("click", () => { flicker(false); swap(); });
  element("rate").addEventListener("input", () => {
    element("rate-shown").textContent = `${element("rate").value} / s`;
    if (state.timer) flicker(true);
  });
  stage.grab = grabEdge;
  stage.canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) stage.canvas.classList.toggle("edge", nearEdge(event));
  });
  element("mix").addEventListener("input", () => setMix(element("mix").value / 100));
  for (const input of document.querySelectorAll("input[name=how]")) {
    input.addEventListener("change", () => { state.how = input.value; stage.refresh(); });
  }
  element("hatched").addEventListener("change", () => { state.hatched = element("hatched").checked; stage.refresh(); });
  element("closer").addEventListener("click", () => stage.zoomBy(2));
  element("farther").addEventListener("click", () => stage.zoomBy(0.5));
  element("whole").addEventListener("click", () => stage.zoomBy(0));
  bindMeasure();
  document.addEventListener("keydown", pressed);
}

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// What has the focus and no use of its own for the space bar, such as the layer just chosen.
const IDLE = "body, input[type=range], input[type=radio]:checked";

function pressed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select, textarea, input[type=text], input[type=number]")) return;
  const view = views[Number(event.key) - 1];
  const key = event.key.toLowerCase(); // also with Caps Lock
  const onStage = event.target === stage.canvas;
  if (view && isThere(view.key)) { flicker(false); choose(view.key); }
  else if (key === "f") flicker(!state.timer);
  else if (event.key === "+" || event.key === "=") stage.zoomBy(2, middle());
  else if (event.key === "-") stage.zoomBy(0.5, middle());
  else if (event.key === "0") stage.zoomBy(0);
  else if (key === "a" || key === "b") mark(key.toUpperCase());
  else if (event.key === "Escape") hold(null);
  else if (event.key === " " && (onStage || event.target.matches(IDLE))) { flicker(false); swap(); }
  else if (STEPS[event.key] && onStage) stepBy(STEPS[event.key], event.shiftKey ? 10 : 1);
  else return;
  event.preventDefault();
}

// Where keys zoom to: the pixel that is held, else the middle.
const middle = () => (state.held ? [state.pixel.x + 0.5, state.pixel.y + 0.5] : undefined);
