// The order of it all: the viewer as soon as its data is there, then what Plotly draws.

const stage = new Stage(element("stage"), page.cols, page.rows);

async function start() {
  await Promise.all([loadMaps(), loadPicture("left"), loadPicture("right")]);
  for (const copy of document.querySelectorAll("img[data-picture]")) {
    copy.src = element(`picture-${copy.dataset.picture}`).src;
  }
  makeTabs();
  bindControls();
  bindReadout();
  element("picture-left").hidden = true;
  stage.draw = drawStage;
  tell({ x: Math.floor(page.cols / 2), y: Math.floor(page.rows / 2) });
  choose("disparity");
  makeCharts();
  await makeScene();
  document.documentElement.dataset.ready = "yes";
}

document.addEventListener("DOMContentLoaded", start);
