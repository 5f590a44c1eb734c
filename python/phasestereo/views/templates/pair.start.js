// The order of it all: the page is painted, then the viewer, then what is further down.

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
  renew();
}

// Words are seen before maps are unpacked, which keeps a browser busy. A page in the background
// is not painted at all.
function firstPaint() {
  return new Promise((done) => {
    new PerformanceObserver(done).observe({ type: "paint", buffered: true });
    setTimeout(done, 800);
  });
}

async function start() {
  await firstPaint();
  await startViewer();
  makeCharts();
  makeScene();
  document.documentElement.dataset.ready = "yes";
}

start();
