// The page of `phasestereo live`: asks for news, gives frames to the viewer, and sends what is set.

const SLIDERS = ["num_disparities", "p1", "p2", "uniqueness", "speckle_size"];
const live = { version: -1, frame: -1, touched: 0, held: false };

async function answerOf(path, options) {
  const answer = await fetch(path, options);
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error ?? answer.statusText);
  return content;
}

const send = (path, what) =>
  answerOf(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(what) });

// A text that is read out only when it is another one.
function setText(id, text, { hides = false } = {}) {
  const place = element(id);
  if (place.textContent !== text) place.textContent = text;
  if (hides) place.hidden = !text;
}

async function followNews() {
  for (;;) {
    let news;
    try {
      news = await answerOf(`state?after=${live.version}`);
    } catch {
      setText("status", "The run has ended.");
      setText("trouble", "", { hides: true });
      for (const control of document.querySelectorAll("#deeds button, #settings input")) control.disabled = true;
      document.documentElement.dataset.ready = "ended";
      return;
    }
    live.version = news.version;
    await showNews(news);
    if (news.closed) await new Promise((done) => setTimeout(done, 500)); // until nobody answers
  }
}

async function showNews(news) {
  const troubles = [...news.notes];
  if (news.failure) troubles.push(news.failure.text + (news.failure.times > 1 ? ` (${news.failure.times} times)` : ""));
  setText("trouble", troubles.filter(Boolean).join(" \u2013 "), { hides: true });
  showFindings(news.findings);
  if (Date.now() - live.touched > 1000) showSettings(news.settings);
  const frame = news.frame;
  if (!frame) return setText("status", news.ended ?? "Waiting for the first pair");
  const failed = news.failed ? `, ${news.failed} failed` : "";
  const verdict = frame.verdict && `${frame.verdict[0].toUpperCase()}${frame.verdict.slice(1)}. `;
  setText("status", `${verdict}${frame.width} \u00d7 ${frame.height}, frame ${frame.index}${failed}, ${frame.rate} a second, ${frame.trusted}\u00a0% trusted${news.ended ? `: ${news.ended}` : ""}`);
  if (live.frame !== frame.index && !live.held) await showFrame();
}

// The last frame, as frames.py packs it. Where the run has ended meanwhile, the next request shows it.
async function showFrame() {
  const answer = await fetch("frame").catch(() => null);
  if (!answer?.ok) return;
  const buffer = await answer.arrayBuffer();
  let place = 4;
  const taken = (Numbers, count) => {
    const numbers = new Numbers(buffer, place, count);
    place += numbers.byteLength;
    return numbers;
  };
  const head = JSON.parse(new TextDecoder().decode(taken(Uint8Array, new DataView(buffer).getUint32(0, true))));
  const { width, height, step, scene, ends } = head;
  const result = { width, height };
  for (const name of head.maps) result[name] = taken(Float32Array, width * height);
  const [left, right] = [0, 1].map(() => new ImageData(taken(Uint8ClampedArray, 4 * width * height), width));
  result.flags = taken(Uint16Array, width * height);
  startViewer();
  showPair(left, right);
  showResult(result, { step, scene, ends });
  live.frame = head.index;
  document.documentElement.dataset.ready = "yes";
}

let startViewer = () => {
  startViewer = () => {};
  bindTabs();
  bindControls();
  bindReadout();
  element("tabs").addEventListener("change", forgetWanted);
  element("measured").ariaLive = "off"; // while frames come it would be read out without an end
  stage.draw = drawStage;
  makeScene();
};

function showFindings(found) {
  const list = element("findings");
  const key = JSON.stringify(found);
  if (!found.length || list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...found.map(([, severity, sentence]) =>
    made("li", { className: severity }, made("b", { textContent: severity }), ` ${sentence}`)));
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

// One change after the other, so that the last one holds, and the message is of the last one.
let changing = Promise.resolve();
const change = (what) => (changing = changing.then(() => changed(what)));

async function changed(what) {
  live.touched = Date.now();
  try {
    await send("settings", what);
    setText("refused", "", { hides: true });
  } catch (error) {
    setText("refused", error.message, { hides: true });
    live.touched = 0; // what holds is shown again
  }
}

function bindSettings() {
  for (const name of SLIDERS) {
    const slider = element(name);
    slider.addEventListener("input", () => { live.touched = Date.now(); showSetting(name); });
    slider.addEventListener("change", () => change({ [name]: Number(slider.value) }));
  }
  element("fill").addEventListener("change", () => change({ fill: Number(element("fill").checked) }));
  element("settings").addEventListener("submit", (event) => event.preventDefault());
}

function bindDeeds() {
  element("hold-frame").addEventListener("click", async () => {
    live.held = !live.held;
    element("hold-frame").setAttribute("aria-pressed", String(live.held));
    element("measured").ariaLive = live.held ? "polite" : "off";
    await send("hold", live.held);
    await showFrame();
  });
  element("save").addEventListener("click", () => save(true));
  element("save-pair").addEventListener("click", () => save(false));
  element("close").addEventListener("click", () => send("close", null).catch(() => {}));
}

async function save(withReport) {
  const buttons = [element("save"), element("save-pair")];
  for (const button of buttons) button.disabled = true;
  setText("saved", "Saving \u2026");
  try {
    const saved = await send("save", withReport);
    setText("saved", `Saved ${saved.saved.join(", ")} in ${saved.folder}`);
  } catch (error) {
    setText("saved", `Not saved: ${error.message}`);
  } finally {
    for (const button of buttons) button.disabled = false;
  }
}

bindSettings();
bindDeeds();
followNews();
