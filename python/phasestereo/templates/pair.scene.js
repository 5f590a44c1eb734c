// The points in three dimensions, by Plotly: to turn around, and each a way back to its pixel.

let drawn = new Uint32Array(); // pixels that have a point

const depthOf = (disparity) => page.scene.scale / (disparity + page.scene.doffs);

// Left camera's coordinates of a pixel: x to the right, y down, z ahead.
function pointOf(at) {
  const { focal, centre } = page.scene;
  const z = depthOf(maps.disparity[at]);
  const x = (at % page.cols) * page.step - centre[0];
  const y = Math.floor(at / page.cols) * page.step - centre[1];
  return [(x * z) / focal[0], (y * z) / focal[1], z];
}

const TINTS = {
  picture: { label: "left image", of: (at) => pictures.left.bytes.subarray(4 * at, 4 * at + 3) },
  disparity: { label: "disparity", of: (at) => colourOf(viewOf("disparity"), maps.disparity[at]) },
  confidence: { label: "confidence", of: (at) => colourOf(viewOf("confidence"), maps.confidence[at]) },
  error: { label: "error", of: (at) => colourOf(viewOf("error"), maps.error[at]) },
  flags: { label: "flags", of: (at) => flagColour(maps.flags[at]) },
};

const seen = () =>
  (element("trusted").checked ? drawn.filter((at) => maps.flags[at] === 0) : drawn);

function cloudTrace() {
  const pixels = seen();
  const points = Array.from(pixels, pointOf);
  const axis = (offset) => Float32Array.from(points, (point) => point[offset]);
  const tint = TINTS[element("tint").value];
  const color = Array.from(pixels, (at) => `rgb(${[...tint.of(at)].join(",")})`);
  element("cloud-told").textContent = `${pixels.length.toLocaleString("en")} points`;
  return {
    type: "scatter3d", mode: "markers", x: axis(0), y: axis(1), z: axis(2), customdata: Array.from(pixels),
    // squares are two triangles each, Plotly's discs some sixty
    marker: { size: Number(element("dot").value), symbol: "square", color, line: { width: 0 } }, hoverinfo: "none",
  };
}

// The box round all points, whichever of them are seen: its ends along each axis.
function boxOf(points) {
  const ends = [0, 1, 2].map((offset) => [Infinity, -Infinity]);
  for (const point of points) {
    ends.forEach((end, offset) => {
      end[0] = Math.min(end[0], point[offset]);
      end[1] = Math.max(end[1], point[offset]);
    });
  }
  return ends.map(([low, high]) => (high > low ? [low, high] : [low - 0.5, high + 0.5]));
}

// Look from a little behind, right of and above the left camera at what is in the middle of its
// image. Plotly's unit is the cube root of the box's volume, its origin the middle of the box.
function cameraOf(box, unit, { clientWidth, clientHeight }) {
  const { focal, centre } = page.scene;
  const back = 0.22 + Math.max(0, clientHeight / clientWidth - 0.6); // narrow windows see less
  const z = depthOf(middleOf(Float32Array.from(drawn, (at) => maps.disparity[at])));
  const x = (((page.cols * page.step) / 2 - centre[0]) * z) / focal[0];
  const y = (((page.rows * page.step) / 2 - centre[1]) * z) / focal[1];
  const placed = (...point) => {
    const [px, py, pz] = point.map((value, offset) => (value - (box[offset][0] + box[offset][1]) / 2) / unit);
    return { x: px, y: py, z: pz };
  };
  return { up: { x: 0, y: -1, z: 0 }, center: placed(x, y, z), eye: placed(0.2 * z, -0.18 * z, -back * z) };
}

const middleOf = (numbers) => numbers.sort()[numbers.length >> 1];

function cloudLayout(place) {
  const box = boxOf(Array.from(drawn, pointOf));
  const unit = Math.cbrt(box.reduce((volume, [low, high]) => volume * (high - low), 1));
  const [x, y, z] = box.map(([low, high]) => (high - low) / unit);
  const axis = (text, range) => ({
    title: { text }, range, color: styleOf("--soft"), gridcolor: styleOf("--line"), showbackground: false,
    zeroline: false, showspikes: false, nticks: 6,
  });
  return {
    scene: {
      xaxis: axis("x", box[0]), yaxis: axis("y", box[1]), zaxis: axis(`depth ${page.scene.unit}`, box[2]),
      aspectmode: "manual", aspectratio: { x, y, z }, dragmode: "orbit", camera: cameraOf(box, unit, place),
    },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: styleOf("--soft"), activecolor: styleOf("--accent") },
    uirevision: "kept", // other colours leave the camera where it is
    margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, autosize: true,
    font: { family: "system-ui, sans-serif", color: styleOf("--text"), size: 11 },
  };
}

const CLOUD_BUTTONS = {
  displaylogo: false, responsive: true,
  modeBarButtonsToRemove: ["tableRotation", "resetCameraLastSave3d"],
};

async function makeScene() {
  const place = element("cloud");
  if (!place) return;
  drawn = await unpacked(page.scene.pixels, Uint32Array);
  for (const [key, { label }] of Object.entries(TINTS)) {
    if (key === "picture" || maps[key]) element("tint").append(made("option", { value: key, textContent: label }));
  }
  if (!seen().length) element("trusted").checked = false;
  let listening = false;
  const draw = async () => {
    await Plotly.react(place, [cloudTrace()], cloudLayout(place), CLOUD_BUTTONS);
    if (listening) return;
    listening = true;
    place.on("plotly_click", ({ points: [point] }) => showPixel(point.customdata));
    for (const id of ["tint", "trusted", "dot"]) element(id).addEventListener("change", draw);
  };
  whenNear(place, draw);
}

function showPixel(at) {
  hold({ x: at % page.cols, y: Math.floor(at / page.cols) });
  if (!stage.shows(state.pixel)) stage.move(state.pixel.x + 0.5, state.pixel.y + 0.5);
}
