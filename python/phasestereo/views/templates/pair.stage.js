// The stage: one canvas that shows images of one size, all at the same place.
//
// Image coordinates: pixel (x, y) covers [x, x + 1) x [y, y + 1).

class Stage {
  constructor(canvas, cols, rows) {
    Object.assign(this, { canvas, cols, rows, zoom: 1, x: cols / 2, y: rows / 2, waiting: false });
    this.context = canvas.getContext("2d");
    this.draw = () => {};
    this.grab = () => null; // of a pointer that goes down: what moves with it, in place of the image
    this.follow();
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.refresh());
  }

  // Show images of another size, whole.
  fit(cols, rows) {
    if (cols === this.cols && rows === this.rows) return;
    Object.assign(this, { cols, rows, zoom: 1, x: cols / 2, y: rows / 2 });
  }

  // Screen pixels (CSS) per image pixel.
  get scale() {
    const { clientWidth, clientHeight } = this.canvas;
    return this.zoom * Math.min(clientWidth / this.cols, clientHeight / this.rows);
  }

  get origin() {
    const { clientWidth, clientHeight } = this.canvas;
    return [clientWidth / 2 - this.x * this.scale, clientHeight / 2 - this.y * this.scale];
  }

  resize() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.refresh();
  }

  refresh() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
    });
  }

  paint() {
    const { context, canvas } = this;
    const ratio = canvas.width / Math.max(1, canvas.clientWidth);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = getComputedStyle(canvas).getPropertyValue("--sunken");
    context.fillRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    context.translate(...this.origin);
    context.scale(this.scale, this.scale);
    context.imageSmoothingEnabled = this.scale * ratio < 1; // enlarged, pixels are to be seen
    context.imageSmoothingQuality = "high";
    this.draw(context);
  }

  // The part of the image that is in sight, in image coordinates: left, right.
  get sight() {
    const [left] = this.origin;
    const end = (this.canvas.clientWidth - left) / this.scale;
    return [Math.max(0, -left / this.scale), Math.min(this.cols, end)];
  }

  // Whether all of a pixel is in sight, but for what rounding takes.
  shows({ x, y }) {
    const [left, top] = this.origin;
    const fits = (start, room) => start >= -1 && start + this.scale <= room + 1;
    return fits(left + x * this.scale, this.canvas.clientWidth)
      && fits(top + y * this.scale, this.canvas.clientHeight);
  }

  // Image coordinates of a pointer.
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    const [left, top] = this.origin;
    return [(event.clientX - box.left - left) / this.scale, (event.clientY - box.top - top) / this.scale];
  }

  // Zoom so that what is at a point stays there.
  zoomBy(factor, [x, y] = [this.x, this.y]) {
    const zoom = Math.min(64, Math.max(1, this.zoom * factor));
    this.move(x + (this.x - x) * (this.zoom / zoom), y + (this.y - y) * (this.zoom / zoom), zoom);
  }

  // Bring a point to the middle, as far as the image leaves no gap.
  move(x, y, zoom = this.zoom) {
    this.zoom = zoom;
    const within = (value, size, room) => {
      const half = Math.min(size, room / this.scale) / 2;
      return Math.min(size - half, Math.max(half, value));
    };
    this.x = within(x, this.cols, this.canvas.clientWidth);
    this.y = within(y, this.rows, this.canvas.clientHeight);
    this.refresh();
  }

  // Follow the pointer: drag to move, wheel to zoom, two fingers for both. One finger moves up and
  // down on the page, as everywhere on it, and only across on the image.
  follow() {
    const pointers = new Map();
    let held = null; // what was grabbed
    this.dragged = false;
    const middle = ([a, b]) => [(a.clientX + b.clientX) / 2, (a.clientY + b.clientY) / 2];
    const spread = ([a, b]) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    this.canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, event);
      held = pointers.size === 1 ? this.grab(event) : null;
      this.dragged = Boolean(held);
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const was = [...pointers.values()];
      pointers.set(event.pointerId, event);
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      if (held) held(event);
      else if (pointers.size === 2) this.pinch(was, [...pointers.values()], middle, spread);
      else if (this.zoom > 1) this.move(this.x - dx / this.scale, this.y - dy / this.scale);
      this.dragged ||= Math.hypot(dx, dy) > 2;
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(end, (event) => {
        pointers.delete(event.pointerId);
        held = null;
      });
    }
    this.canvas.addEventListener("wheel", (event) => {
      if (event.deltaY > 0 && this.zoom <= 1 && !event.ctrlKey) return; // nothing to zoom: the page scrolls
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 400), this.at(event));
    }, { passive: false });
    this.canvas.addEventListener("dblclick", (event) => this.zoomBy(2, this.at(event)));
  }

  // Two fingers: what was between them stays between them.
  pinch(was, are, middle, spread) {
    const place = (point) => this.at({ clientX: point[0], clientY: point[1] });
    const [x, y] = place(middle(was));
    this.zoomBy(spread(are) / Math.max(1, spread(was)), [x, y]);
    const [nx, ny] = place(middle(are));
    this.move(this.x + x - nx, this.y + y - ny);
  }
}
