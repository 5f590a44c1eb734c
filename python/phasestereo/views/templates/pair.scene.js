// The points in three dimensions, by WebGL: every pixel with a depth, to turn around, and each a
// way back to its pixel. What the graphics card gets of a point are its disparity, 16 bits, and a
// color; its place follows from its number and the geometry.

const depthOf = (disparity) => page.scene.scale / (disparity + page.scene.doffs);

// What a yaw adds to the error bar of a disparity.
function yawOf(x, disparity) {
  const { right: [focal, center], share: [constant, slope, middle] } = page.scene;
  const t = (x - disparity - center) / focal;
  return constant + slope * Math.abs(t * t - middle);
}

// The nearest and the farthest depth of a pixel's error bar, as phasestereo.depth_interval has them.
function depthEnds(x, disparity, uncertainty) {
  const bar = uncertainty + yawOf(x, disparity);
  return [bar, -bar].map((end) => (disparity + page.scene.doffs + end > 0 ? depthOf(disparity + end) : Infinity));
}

// Left camera's coordinates of a pixel: x to the right, y down, z ahead.
function pointOf(at) {
  const { focal, center } = page.scene;
  const z = depthOf(maps.disparity[at]);
  const x = (at % page.cols) * page.step - center[0];
  const y = Math.floor(at / page.cols) * page.step - center[1];
  return [(x * z) / focal[0], (y * z) / focal[1], z];
}

const TINTS = {
  picture: { label: "left image", of: (at) => pictures.left.bytes.subarray(4 * at, 4 * at + 3) },
  disparity: { label: "disparity", of: (at) => colorOf(viewOf("disparity"), maps.disparity[at]) },
  confidence: { label: "confidence", of: (at) => colorOf(viewOf("confidence"), maps.confidence[at]) },
  uncertainty: { label: "error bars", of: (at) => colorOf(viewOf("uncertainty"), maps.uncertainty[at]) },
  error: { label: "error", of: (at) => colorOf(viewOf("error"), maps.error[at]) },
  flags: { label: "flags", of: (at) => flagColor(maps.flags[at]) },
};

const VERTEX = `#version 300 es
precision highp float;
precision highp int;
layout(location = 0) in uint code;
layout(location = 1) in vec4 tint; // its alpha: whether it is seen
uniform int cols;
uniform vec4 lens; // focal lengths, center
uniform vec4 depths; // step between pixels, scale, doffs, size of a point as far away as it is deep
uniform vec2 coding; // disparity of code 0, step between codes
uniform vec3 eye;
uniform mat3 turn; // to the right, down, ahead
uniform vec4 shape; // stretch of x and y, near, far
out vec3 color;
void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = 1.0;
  if (tint.a == 0.0) return;
  float z = depths.y / (coding.x + float(code) * coding.y + depths.z);
  vec2 pixel = vec2(gl_VertexID % cols, gl_VertexID / cols) * depths.x;
  vec3 seen = turn * (vec3((pixel - lens.zw) * z / lens.xy, z) - eye);
  float near = shape.z, far = shape.w;
  float deep = (seen.z * (far + near) - 2.0 * far * near) / (far - near);
  gl_Position = vec4(seen.x * shape.x, -seen.y * shape.y, deep, seen.z);
  gl_PointSize = clamp(depths.w * z / max(seen.z, near), 1.0, 40.0);
  color = tint.rgb;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 color;
out vec4 shown;
void main() { shown = vec4(color, 1.0); }`;

const BACK = 1.15; // how far the eye is behind what it looks at, in its depth
const FRAME = 1.25; // room around the image, as the left camera sees it
const NARROW = 1.2; // and more across, where the eye is beside it

class Cloud {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
    if (!this.gl) return;
    this.program = this.compiled();
    this.places = {};
    for (const name of ["cols", "lens", "depths", "coding", "eye", "turn", "shape"]) {
      this.places[name] = this.gl.getUniformLocation(this.program, name);
    }
    this.codes = this.gl.createBuffer();
    this.renew();
    this.reset();
    this.follow();
    new ResizeObserver(() => this.refresh()).observe(canvas);
  }

  compiled() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  }

  // Take the disparities as they are now.
  renew() {
    const { gl } = this;
    this.near = pointsSeen();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.codes);
    gl.bufferData(gl.ARRAY_BUFFER, maps.codes, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_SHORT, 0, 0);
  }

  // Color the points, and choose the visible ones; return their number.
  color(tint, keep) {
    const bytes = new Uint8Array(4 * this.near.length);
    let count = 0;
    for (let at = 0; at < this.near.length; at++) {
      if (!this.near[at] || !isKept(at, keep)) continue;
      bytes.set(tint.of(at), 4 * at);
      bytes[4 * at + 3] = 255;
      count++;
    }
    this.seen = bytes;
    const { gl } = this;
    if (this.tints) gl.deleteBuffer(this.tints);
    this.tints = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.tints);
    gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 0, 0);
    this.refresh();
    return count;
  }

  // Look from a little behind, right of and above the left camera at what is in its middle.
  reset() {
    const some = [];
    const every = Math.max(1, Math.floor(this.near.length / 20000));
    for (let at = 0; at < this.near.length; at += every) if (this.near[at]) some.push(maps.disparity[at]);
    const z = depthOf(some.sort((a, b) => a - b)[some.length >> 1] ?? maps.disparity.find((value, at) => this.near[at]));
    const { focal, center } = page.scene;
    const x = (((page.cols * page.step) / 2 - center[0]) * z) / focal[0];
    const y = (((page.rows * page.step) / 2 - center[1]) * z) / focal[1];
    this.image = [(page.cols * page.step) / (2 * focal[0]), (page.rows * page.step) / (2 * focal[1])];
    Object.assign(this, { target: [x, y, z], yaw: -0.22, pitch: 0.16, distance: BACK * z });
    this.refresh();
  }

  // Tangent of half the angle that is seen up and down: the left camera's, and what a narrow view
  // needs to see as much across.
  get sight() {
    return (FRAME * Math.max(this.image[1], (NARROW * this.image[0]) / this.aspect)) / BACK;
  }

  get aspect() {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  // Where the eye is, and which way is right, down and ahead.
  get view() {
    const { yaw, pitch, target, distance } = this;
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    const ahead = [sy * cp, sp, cy * cp];
    const right = [cy, 0, -sy];
    const down = [-sy * sp, cp, -cy * sp];
    return { eye: target.map((value, axis) => value - ahead[axis] * distance), right, down, ahead };
  }

  refresh() {
    if (this.waiting || !this.seen) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
    });
  }

  paint() {
    const { gl, canvas, places } = this;
    const ratio = devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    const { eye, right, down, ahead } = this.view;
    const { focal, center, scale, doffs } = page.scene;
    gl.uniform1i(places.cols, page.cols);
    gl.uniform4f(places.lens, ...focal, ...center);
    const { sight } = this;
    const dot = (Number(element("dot").value) * (page.step / focal[0]) * canvas.height) / (2 * sight);
    gl.uniform4f(places.depths, page.step, scale, doffs, dot);
    gl.uniform2f(places.coding, ...page.codings.disparity);
    gl.uniform3f(places.eye, ...eye);
    gl.uniformMatrix3fv(places.turn, true, [...right, ...down, ...ahead]);
    gl.uniform4f(places.shape, 1 / (sight * this.aspect), 1 / sight, this.distance / 100, this.distance * 1000);
    gl.drawArrays(gl.POINTS, 0, this.near.length);
  }

  rotate(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(1.5, Math.max(-1.5, this.pitch + pitch));
    this.refresh();
  }

  approach(factor) {
    this.distance *= factor;
    this.refresh();
  }

  // Move by screen pixels.
  shift(dx, dy) {
    const { right, down } = this.view;
    const unit = (2 * this.sight * this.distance) / this.canvas.clientHeight;
    this.target = this.target.map((value, axis) => value - unit * (dx * right[axis] + dy * down[axis]));
    this.refresh();
  }

  // The pixel whose point is the nearest to the eye of those close to a place on the screen.
  pick(event) {
    const box = this.canvas.getBoundingClientRect();
    const { eye, right, down, ahead } = this.view;
    const unit = box.height / (2 * this.sight);
    let [best, nearest] = [-1, Infinity];
    for (let at = 0; at < this.near.length; at++) {
      if (!this.seen[4 * at + 3]) continue;
      const seen = pointOf(at).map((value, axis) => value - eye[axis]);
      const deep = seen[0] * ahead[0] + seen[1] * ahead[1] + seen[2] * ahead[2];
      if (deep <= 0 || deep >= nearest) continue;
      const x = (unit * (seen[0] * right[0] + seen[1] * right[1] + seen[2] * right[2])) / deep + box.width / 2;
      const y = (unit * (seen[0] * down[0] + seen[1] * down[1] + seen[2] * down[2])) / deep + box.height / 2;
      if (Math.hypot(x - event.clientX + box.left, y - event.clientY + box.top) < 4) [best, nearest] = [at, deep];
    }
    return best;
  }

  // Drag to turn, with the right button or Shift to move, wheel to come closer; two fingers for
  // both. One finger up or down is the page's.
  follow() {
    const { canvas } = this;
    const pointers = new Map();
    let far = 0;
    const middle = (points) => ["clientX", "clientY"].map((axis) => points.reduce((sum, one) => sum + one[axis], 0) / points.length);
    canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, event);
      far = 0;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!pointers.has(event.pointerId)) return;
      const was = [...pointers.values()];
      pointers.set(event.pointerId, event);
      const are = [...pointers.values()];
      const [dx, dy] = middle(are).map((value, axis) => value - middle(was)[axis]);
      far += Math.hypot(dx, dy);
      if (are.length === 2) {
        const [before, now] = [was, are].map(([a, b]) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
        this.approach(before / Math.max(1, now));
        this.shift(dx, dy);
      } else if (event.buttons & 2 || event.shiftKey) this.shift(dx, dy);
      else this.rotate(-dx / 200, -dy / 200);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("click", (event) => {
      const at = far < 3 ? this.pick(event) : -1;
      if (at >= 0) showPixel(at);
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // it fills the window: the page scrolls
      event.preventDefault();
      this.approach(Math.exp(event.deltaY / 600));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.pressed(event));
  }

  pressed(event) {
    const turn = STEPS[event.key];
    if (turn) this.rotate(-0.08 * turn[0], -0.08 * turn[1]);
    else if (event.key === "+" || event.key === "=") this.approach(0.85);
    else if (event.key === "-") this.approach(1 / 0.85);
    else if (event.key === "0") this.reset();
    else return;
    event.preventDefault();
    event.stopPropagation(); // the same keys do other things to the viewer
  }
}

// Which pixels have a point: those with a depth that is in the range.
function pointsSeen() {
  const nearest = page.scene.nearest ?? 0;
  return Uint8Array.from(maps.disparity, (found) => {
    const depth = depthOf(found);
    return Number.isFinite(found) && depth > 0 && depth >= nearest && depth <= page.scene.limit ? 1 : 0;
  });
}

// Whether the estimate of a pixel is used, as phasestereo.point_cloud(keep=) has it: but for "all" the error bar of its depth has
// a far end.
function isKept(at, keep) {
  if (keep === "all") return true;
  if (!isTrusted(at) || (keep === "checked" && maps.flags[at])) return false;
  return !maps.uncertainty || Number.isFinite(depthEnds((at % page.cols) * page.step, maps.disparity[at], maps.uncertainty[at])[1]);
}

let cloud = null; // once it has come near

function makeScene() {
  const place = element("cloud");
  if (!place) return;
  offerTints();
  whenNear(place, () => {
    cloud = new Cloud(place);
    if (!cloud.gl) {
      element("cloud-shown").textContent = "This browser has no WebGL 2.";
      return;
    }
    if (!drawCloud()) {
      element("keep").value = "all";
      drawCloud();
    }
    for (const id of ["tint", "keep"]) element(id).addEventListener("change", drawCloud);
    element("dot").addEventListener("input", () => cloud.refresh());
    element("home").addEventListener("click", () => cloud.reset());
  });
}

// The colors that there are maps for; the one that is chosen stays.
function offerTints() {
  const chosen = element("tint").value;
  const there = Object.entries(TINTS).filter(([key]) => key === "picture" || maps[key]);
  element("tint").replaceChildren(...there.map(([value, { label }]) => made("option", { value, textContent: label })));
  if (there.some(([key]) => key === chosen)) element("tint").value = chosen;
}

// Draw the points in the chosen color; return their number.
function drawCloud() {
  const count = cloud.color(TINTS[element("tint").value], element("keep").value);
  element("cloud-shown").textContent = `${count.toLocaleString("en")} points`;
  return count;
}

// Show the maps as they are now, if the points are shown at all.
function renewScene() {
  offerTints();
  if (!cloud?.gl) return;
  cloud.renew();
  drawCloud();
}

function showPixel(at) {
  hold({ x: at % page.cols, y: Math.floor(at / page.cols) });
  if (!stage.shows(state.pixel)) stage.move(state.pixel.x + 0.5, state.pixel.y + 0.5);
}
