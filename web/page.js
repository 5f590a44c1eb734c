// The page: the chosen pair, the effects of the sliders, and when it is matched: with `fast` while a slider
// moves, with `robust` once it rests. One match runs at a time; of the requests in the meantime, only the
// latest counts.

import { openCameras } from "./cameras.js";
import { createMatcher } from "./matcher.js";
import { downloads } from "./downloads.js";
import { readPair } from "./photographs.js";
import { NUM_DISPARITIES, renderPair, SCENES } from "./render.js";
import { movedPoint, NOTHING, pointBefore, spoiled } from "./spoil.js";

const REST = 300; // milliseconds after the last move of a slider
const NOISE = 1; // gray levels, of rendered pairs; photographs have their own
const SEEDS = { left: 1, right: 2 }; // of this noise
const OWN = "own"; // the name of the user's pair in the list

const pair = { left: null, right: null, plain: null, truth: null, noise: 0, note: "", range: null, focal: null, isNew: true };
const asked = { ...NOTHING };
let next = null; // the preset to match with next
let timer = 0;
let busy = false;
let matcher = null;
let cameras = null; // open: each frame is matched with `fast`

const root = document.documentElement;

// The pair to match, with the current effects of the sliders.
function spoiledPair() {
  const side = element("side-left").checked ? "left" : "right";
  const worse = spoiled(pair[side], asked, pair.noise, SEEDS[side]);
  return { ...pair.plain, [side]: worse, truth: pair.truth && movedTruth(side), range: pair.range };
}

// The disparities of a pair with one image turned and shifted.
function movedTruth(side) {
  if (!asked.turn && !asked.rows) return pair.truth;
  const { width, height } = pair.left;
  return Float32Array.from(pair.truth, (_, at) => {
    const [x, y] = [at % width, Math.floor(at / width)];
    const [fromX, fromY] = side === "left" ? pointBefore(x, y, pair.left, asked) : [x, y];
    const [column, row] = [Math.round(fromX), Math.round(fromY)];
    if (column < 0 || row < 0 || column >= width || row >= height) return NaN;
    const matchX = fromX - pair.truth[row * width + column];
    return x - (side === "left" ? matchX : movedPoint(matchX, fromY, pair.left, asked)[0]);
  });
}

// Match with `fast` at once, and with `robust` when nothing has changed for a while.
function changed() {
  delete root.dataset.matched;
  clearTimeout(timer);
  timer = setTimeout(() => ask("robust"), REST);
  ask("fast");
}

function ask(preset) {
  next = preset;
  if (!busy && matcher) work();
}

async function work() {
  busy = true;
  while (next || cameras) {
    if (cameras) await takeFrame();
    const preset = cameras ? "fast" : next;
    next = null;
    if (!preset) break;
    try {
      await matched(preset);
      trouble("");
    } catch (error) {
      trouble(`Not matched: ${error.message}`);
    }
  }
  busy = false;
}

async function matched(preset) {
  const { left, right, truth, range } = spoiledPair();
  const isLast = preset === "robust";
  const checked = isLast ? (await matcher.check(left, right)).findings : [];
  if (isLast) tellFindings(checked);
  if (next) return; // it has changed since
  const result = await matcher.match(left, right, { preset, ...(range ?? { numDisparities: 0 }) });
  if (isLast) tellFindings([...result.found.findings, ...checked]);
  startViewer();
  showPair(left, right);
  showResult(result, { truth, isLast });
  tellFigures(result, truth, preset);
  if (!isLast || next) return;
  keepRange(result.found);
  if (pair.isNew && cloud?.gl) cloud.reset(); // its points are elsewhere
  pair.isNew = false;
  startScene();
  for (const id of Object.keys(downloads)) element(id).disabled = false;
  root.dataset.matched = preset;
}

// Searches the same range again, so that `fast` does not have to estimate it.
function keepRange({ range: { minDisparity, numDisparities, origin } }) {
  if (origin === "found") pair.range = { minDisparity, numDisparities };
}

// The viewer has nothing to show before the first result, and the points before the first of `robust`.
let startViewer = () => {
  startViewer = () => {};
  bindTabs();
  bindControls();
  bindReadout();
};

let startScene = () => {
  startScene = () => {};
  makeScene();
};

function trouble(text) {
  element("trouble").textContent = text;
  element("trouble").hidden = !text;
  if (text) root.dataset.matched = "no";
}

// Each sentence once, the worst first.
function tellFindings(found) {
  const order = ["warning", "note", "ok"];
  const isFirst = ({ sentence }, at) => found.findIndex((one) => one.sentence === sentence) === at;
  const said = found.filter(isFirst)
    .sort((one, other) => order.indexOf(one.severity) - order.indexOf(other.severity));
  element("findings").replaceChildren(...said.map(({ severity, sentence }) =>
    made("li", { className: severity }, made("b", { textContent: severity }), ` ${sentence}`)));
}

// Pixels that are off by more than 1 px or have no estimate are wrong; this needs a known truth.
function tellFigures(result, truth, preset) {
  const share = (counts) => `${((100 * maps.flags.reduce((sum, _, at) => sum + counts(at), 0)) / maps.flags.length).toFixed(1)} %`;
  element("trusted-shown").textContent = share(isTrusted);
  element("wrong-shown").textContent = truth ? share((at) => !(maps.error[at] <= 1)) : "";
  element("wrong-shown").parentElement.hidden = !truth;
  element("time-shown").textContent = `${Math.max(1, Math.round(result.milliseconds))} ms`;
  const by = `with ${preset}, ${result.engine}`;
  Object.assign(element("preset-shown"), { textContent: by, title: by }); // a long name is cut off on a phone
}

// The pair

function takeScene(name) {
  const rendered = renderPair(name);
  const range = { minDisparity: 0, numDisparities: NUM_DISPARITIES };
  take({ ...rendered, noise: NOISE, range, focal: null, note: "Rendered here: the truth is known." });
}

async function takeFiles(files) {
  try {
    const read = await readPair(files);
    if (![...element("pair").options].some(({ value }) => value === OWN)) {
      element("pair").append(made("option", { value: OWN, textContent: "Your photographs" }));
    }
    element("pair").value = OWN;
    element("pair").querySelector(`[value=${OWN}]`).pair = read;
    takeOwn(read);
  } catch (error) {
    trouble(error.message);
  }
}

const OWN_PAIR = { truth: null, noise: 0, range: null };
const takeOwn = (read) => take({ ...read, ...OWN_PAIR });

// Cameras are watched until the button is pressed again, or another pair is chosen: the last frame is matched
// with `robust`.
async function watch() {
  element("cameras").disabled = true;
  try {
    if (cameras) takeOwn(await cameras.frame());
    else {
      const opened = await openCameras();
      takeOwn(await opened.frame());
      clearTimeout(timer);
      cameras = opened;
      element("cameras").setAttribute("aria-pressed", "true");
      ask("fast");
    }
  } catch (error) {
    trouble(`Cameras: ${error.message.replace(/^cameras: /, "")}`);
  }
  element("cameras").disabled = false;
}

function closeCameras() {
  cameras?.close();
  cameras = null;
  element("cameras").setAttribute("aria-pressed", "false");
}

async function takeFrame() {
  const frame = await cameras.frame();
  if (!cameras) return; // closed in the meantime
  Object.assign(pair, frame, OWN_PAIR);
  takePlain();
}

function take(taken) {
  closeCameras();
  Object.assign(pair, taken, { isNew: true });
  Object.assign(known, { factor: 1, unit: null, share: 0, focal: pair.focal ?? null });
  Object.assign(marks, { A: null, B: null });
  takePlain();
  element("pair-note").textContent = pair.note;
  trouble("");
  setSliders(NOTHING);
}

// The images as a good camera would take them.
function takePlain() {
  const [left, right] = ["left", "right"].map((side) => spoiled(pair[side], NOTHING, pair.noise, SEEDS[side]));
  pair.plain = { left, right };
}

function exchange() {
  [pair.left, pair.right] = [pair.right, pair.left];
  takePlain();
  pair.truth = null; // it is the left image's
  pair.range = null;
  pair.isNew = true;
  changed();
}

// Controls

function setSliders(values) {
  for (const [name, value] of Object.entries(values)) {
    element(name).value = value;
    tellSlider(name);
  }
  changed();
}

function tellSlider(name) {
  const { value, dataset } = element(name);
  asked[name] = Number(value);
  const text = `${numberOf(asked[name], asked[name] % 1 ? 2 : 0)}${dataset.unit}`;
  element(`${name}-shown`).textContent = text;
  element(name).setAttribute("aria-valuetext", text);
}

function bindPage() {
  for (const [name, { label }] of Object.entries(SCENES)) {
    element("pair").append(made("option", { value: name, textContent: label }));
  }
  element("pair").addEventListener("change", ({ target }) => {
    const [chosen] = target.selectedOptions;
    if (chosen.pair) takeOwn(chosen.pair);
    else takeScene(chosen.value);
  });
  element("files").addEventListener("change", ({ target }) => {
    if (target.files.length) takeFiles(target.files);
    target.value = ""; // so that the same files can be chosen again
  });
  for (const name of Object.keys(NOTHING)) {
    element(name).addEventListener("input", () => { tellSlider(name); changed(); });
  }
  for (const side of document.querySelectorAll("input[name=side]")) side.addEventListener("change", changed);
  element("exchange").addEventListener("click", exchange);
  element("cameras").addEventListener("click", watch);
  element("reset").addEventListener("click", () => setSliders(NOTHING));
  element("tabs").addEventListener("change", forgetWanted);
  for (const [id, [name, write]] of Object.entries(downloads)) {
    element(id).addEventListener("click", () => {
      const url = URL.createObjectURL(new Blob([write()]));
      made("a", { href: url, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(url));
    });
  }
  bindDrop();
}

// Files may be dropped anywhere on the page.
function bindDrop() {
  addEventListener("dragover", (event) => {
    event.preventDefault();
    root.classList.add("over");
  });
  addEventListener("dragleave", (event) => root.classList.toggle("over", event.relatedTarget !== null));
  addEventListener("drop", (event) => {
    event.preventDefault();
    root.classList.remove("over");
    takeFiles(event.dataTransfer.files);
  });
}

// The left image, until there are disparities.
function showFirst() {
  const { left, right } = pair.plain;
  showPair(left, right);
  stage.fit(left.width, left.height);
  stage.draw = (context) => (maps.disparity ? drawStage(context) : context.drawImage(pictures.left.canvas, 0, 0));
  stage.refresh();
}

async function start() {
  bindPage();
  const device = new URLSearchParams(location.search).get("device") ?? "auto";
  const loading = createMatcher({ wasm: "phasestereo.wasm", device }); // on a thread of its own, while this one renders
  takeScene(element("pair").value);
  showFirst();
  try {
    matcher = await loading;
  } catch (error) {
    trouble(`The matcher could not be loaded: ${error.message}`);
    return;
  }
  if (next) work();
}

start();
