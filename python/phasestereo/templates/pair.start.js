// The order of it all: the viewer as soon as its data is there, then what Plotly draws.

const stage = new Stage(element("stage"), page.cols, page.rows);

async function startViewer() {
  await Promise.all([loadMaps(), loadPicture("left"), loadPicture("right")]);
  for (const copy of document.querySelectorAll("img[data-picture]")) {
    copy.src = element(`picture-${copy.dataset.picture}`).src;
  }
  bindTabs();
  bindControls();
  bindReadout();
  element("picture-left").hidden = true;
  stage.draw = drawStage;
  tell({ x: Math.floor(page.cols / 2), y: Math.floor(page.rows / 2) });
  choose("disparity");
}

async function start() {
  const loaded = new Promise((done) => addEventListener("DOMContentLoaded", done)); // Plotly, too
  await startViewer();
  await loaded;
  makeCharts();
  await makeScene();
  document.documentElement.dataset.ready = "yes";
}

start();
