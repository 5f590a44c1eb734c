// The page of `phasestereo live`: asks for news, shows it, and sends what is set.

"use strict";

const element = (id) => document.getElementById(id);
const SLIDERS = ["num_disparities", "p1", "p2", "uniqueness", "speckle_size"];
const WORDS = { ok: "fine", note: "note", warning: "warning" };
const shown = { version: -1, frame: null, cursor: null, unit: "", metric: false, touched: 0, range: "" };

async function ask(path) {
  const answer = await fetch(path);
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error ?? answer.statusText);
  return content;
}

async function send(path, what) {
  const answer = await fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(what),
  });
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error ?? answer.statusText);
  return content;
}

// A text that is read out only when it is another one.
function setText(id, text, { hides = false } = {}) {
  const place = element(id);
  if (place.textContent !== text) place.textContent = text;
  if (hides) place.hidden = !text;
}

async function follow() {
  for (;;) {
    let news;
    try {
      news = await ask(`state?after=${shown.version}`);
    } catch {
      setText("status", "The run has ended.");
      setText("trouble", "", { hides: true });
      for (const control of document.querySelectorAll("button, input")) control.disabled = true;
      document.documentElement.dataset.ready = "ended";
      return;
    }
    shown.version = news.version;
    await show(news);
    if (news.closed) await new Promise((done) => setTimeout(done, 500)); // until nobody answers
  }
}

async function show(news) {
  const troubles = [news.ended, ...news.notes];
  if (news.failure) troubles.push(news.failure.text + (news.failure.times > 1 ? ` (${news.failure.times} times)` : ""));
  setText("trouble", troubles.filter(Boolean).join(" \u2013 "), { hides: true });
  shown.unit = news.unit;
  shown.metric = news.metric;
  showFindings(news);
  if (Date.now() - shown.touched > 1000) showSettings(news.settings);
  const frame = news.frame;
  if (!frame) return;
  const failed = news.failed ? `, ${news.failed} failed` : "";
  const verdict = frame.verdict && `${frame.verdict[0].toUpperCase()}${frame.verdict.slice(1)}. `;
  element("status").textContent =
    `${verdict}${frame.width} \u00d7 ${frame.height}, frame ${frame.index}${failed}, ${frame.rate} a second, ${frame.trusted}\u00a0% trusted`;
  if (shown.frame?.index === frame.index && shown.frame.low === frame.low && shown.frame.high === frame.high) return;
  await showFrame(frame);
  await showValue();
  document.documentElement.dataset.ready = "yes";
}

async function showFrame(frame) {
  document.documentElement.style.setProperty("--aspect", `${frame.width} / ${frame.height}`);
  document.documentElement.style.setProperty("--ratio", frame.width / frame.height);
  const query = `?frame=${frame.index}-${frame.low}-${frame.high}`;
  await Promise.all([swap("#left img", `left.jpg${query}`), swap("#disparity img", `disparity.png${query}`)]);
  const range = `${frame.low}-${frame.high}`;
  if (shown.range !== range) {
    element("scale").src = `scale.png?${range}`;
    element("scale").hidden = false;
    setText("low", String(frame.low));
    setText("high", String(frame.high));
    shown.range = range;
  }
  shown.frame = frame;
}

// A picture takes the place of another once it is decoded, so that nothing flickers.
async function swap(selector, address) {
  const next = new Image();
  next.src = address;
  try {
    await next.decode();
  } catch {
    return; // the run has gone on, or ended: the next question tells
  }
  const image = document.querySelector(selector);
  image.src = address;
  image.hidden = false;
}

function showFindings(news) {
  const list = element("findings");
  const key = JSON.stringify(news.findings);
  if (!news.findings.length || list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...news.findings.map(([, severity, sentence]) => {
    const [item, word, text] = ["li", "b", "span"].map((name) => document.createElement(name));
    item.className = severity;
    word.textContent = WORDS[severity] ?? severity;
    text.textContent = sentence;
    item.append(word, text);
    return item;
  }));
}

function showSettings(settings) {
  for (const name of SLIDERS) {
    const slider = element(name);
    slider.max = Math.max(slider.max, settings[name]); // what was set elsewhere
    slider.value = settings[name];
    showSetting(name);
  }
  element("fill").checked = settings.fill > 0;
}

function showSetting(name) {
  const value = Number(element(name).value);
  setText(`${name}-shown`, name === "num_disparities" && !value ? "found" : String(value));
}

// One change after the other, so that the last one holds, and what is said is of the last one.
let changing = Promise.resolve();
const change = (what) => (changing = changing.then(() => changed(what)));

async function changed(what) {
  shown.touched = Date.now();
  try {
    await send("settings", what);
    setText("refused", "", { hides: true });
  } catch (error) {
    setText("refused", error.message, { hides: true });
    shown.touched = 0; // what holds is shown again
  }
}

function bindSettings() {
  for (const name of SLIDERS) {
    const slider = element(name);
    slider.addEventListener("input", () => { shown.touched = Date.now(); showSetting(name); });
    slider.addEventListener("change", () => change({ [name]: Number(slider.value) }));
  }
  element("fill").addEventListener("change", () => change({ fill: Number(element("fill").checked) }));
  element("settings").addEventListener("submit", (event) => event.preventDefault());
}

// The cursor: where the pointer is, or where arrow keys have led it.
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function point(x, y) {
  const { width, height } = shown.frame;
  shown.cursor = [Math.min(width - 1, Math.max(0, x)), Math.min(height - 1, Math.max(0, y))];
  for (const cross of document.querySelectorAll(".cross")) {
    cross.hidden = false;
    cross.style.left = `${(100 * (shown.cursor[0] + 0.5)) / width}%`;
    cross.style.top = `${(100 * (shown.cursor[1] + 0.5)) / height}%`;
  }
  showValue();
}

let asking = false;
async function showValue() {
  if (!shown.cursor || asking) return;
  asking = true;
  const [x, y] = shown.cursor;
  try {
    const value = await ask(`value?x=${x}&y=${y}`);
    setText("at", `${x}, ${y}`);
    setText("value", disparityOf(value));
    setText("depth", depthOf(value));
    setText("flags", value.flags.join(", ") || "none");
  } catch {
    shown.cursor = null; // frames have another size now
  } finally {
    asking = false;
  }
  if (shown.cursor && (shown.cursor[0] !== x || shown.cursor[1] !== y)) showValue();
}

function disparityOf({ disparity, uncertainty }) {
  if (disparity === null) return "no estimate";
  const bar = uncertainty === null ? "" : ` \u00b1 ${uncertainty.toFixed(2)}`;
  return `${disparity.toFixed(2)}${bar} px`;
}

// A depth, and the ends of its error bar; the far one may be infinite, which JSON does not have.
function depthOf({ depth, near, far }) {
  if (!shown.metric) return "needs a calibration";
  if (depth === null) return "no estimate";
  const ends = near === null ? "" : ` (${near.toPrecision(4)} to ${far === null ? "\u221e" : far.toPrecision(4)})`;
  return `${depth.toPrecision(4)}${ends} ${shown.unit}`.trim();
}

function bindViews() {
  for (const view of document.querySelectorAll(".view")) {
    const at = (event) => {
      if (!shown.frame) return;
      const box = view.getBoundingClientRect();
      const share = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      point(Math.floor(share[0] * shown.frame.width), Math.floor(share[1] * shown.frame.height));
    };
    view.addEventListener("pointermove", at);
    view.addEventListener("pointerdown", at);
    view.addEventListener("keydown", (event) => {
      const step = STEPS[event.key];
      if (!step || !shown.frame) return;
      event.preventDefault();
      const [x, y] = shown.cursor ?? [shown.frame.width >> 1, shown.frame.height >> 1];
      const far = event.shiftKey ? 10 : 1;
      point(x + far * step[0], y + far * step[1]);
    });
  }
}

function bindDeeds() {
  element("save").addEventListener("click", async () => {
    element("save").disabled = true;
    setText("saved", "Saving \u2026");
    try {
      const saved = await send("save", null);
      setText("saved", `Saved ${saved.saved.join(", ")} in ${saved.folder}`);
    } catch (error) {
      setText("saved", `Not saved: ${error.message}`);
    } finally {
      element("save").disabled = false;
    }
  });
  element("close").addEventListener("click", () => send("close", null).catch(() => {}));
}

bindSettings();
bindViews();
bindDeeds();
follow();
