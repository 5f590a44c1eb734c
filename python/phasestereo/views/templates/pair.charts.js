// The charts: SVG of this page's own, in its colors.

const SPACE = { left: 46, right: 12, top: 26, bottom: 40 }; // screen pixels around the axes
const SVG = "http://www.w3.org/2000/svg";

function drawn(tag, attributes, text = "") {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.textContent = text;
  return node;
}

// Round numbers between two others, about `count`.
function ticksOf(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) found.push(Number((n * step).toPrecision(12)));
  return found;
}

// A figure: what it shows is drawn by `paint`, with functions from values to screen pixels.
function figure(place, { x, y, names = [], say, paint }) {
  const svg = drawn("svg", { width: "100%", height: "100%", "aria-hidden": "true" });
  const label = made("p", { className: "shown-here" });
  place.replaceChildren(svg, label);
  const bend = x.log ? Math.log : (value) => value;
  let valueAt = null;
  const redraw = () => {
    const { clientWidth: width, clientHeight: height } = place;
    const size = [width - SPACE.left - SPACE.right, height - SPACE.top - SPACE.bottom];
    const at = {
      x: (value) => SPACE.left + (size[0] * (bend(value) - bend(x.low))) / (bend(x.high) - bend(x.low)),
      y: (value) => SPACE.top + size[1] * (1 - value / y.high),
      bottom: height - SPACE.bottom,
    };
    valueAt = (pixel) => {
      const value = bend(x.low) + ((pixel - SPACE.left) / size[0]) * (bend(x.high) - bend(x.low));
      return x.log ? Math.exp(value) : value;
    };
    svg.replaceChildren(...axes(x, y, at, [width, height]), ...paint(at), ...legendOf(names, width));
  };
  new ResizeObserver(redraw).observe(place);
  redraw();
  place.addEventListener("pointermove", (event) => {
    const value = valueAt(event.clientX - place.getBoundingClientRect().left);
    label.textContent = value >= x.low && value <= x.high ? say(value) : "";
  });
  place.addEventListener("pointerleave", () => (label.textContent = ""));
}

function axes(x, y, at, [width, height]) {
  const found = [];
  for (const value of ticksOf(0, y.high, 5)) {
    found.push(drawn("line", { class: "grid", x1: SPACE.left, x2: width - SPACE.right, y1: at.y(value), y2: at.y(value) }));
    found.push(drawn("text", { x: SPACE.left - 6, y: at.y(value) + 4, "text-anchor": "end" }, String(value)));
  }
  for (const value of x.ticks ?? ticksOf(x.low, x.high, Math.max(2, width / 90))) {
    if (value < x.low || value > x.high) continue;
    found.push(drawn("text", { x: at.x(value), y: at.bottom + 16, "text-anchor": "middle" }, String(value)));
  }
  found.push(drawn("text", { class: "xtitle", x: (SPACE.left + width - SPACE.right) / 2, y: height - 5, "text-anchor": "middle" }, x.label));
  found.push(drawn("text", { x: 4, y: 14 }, y.label));
  return found;
}

function legendOf(names, width) {
  return names.flatMap(([name, style], place) => {
    const left = width - SPACE.right - 92 * (names.length - place) + 8;
    return [
      drawn("line", { class: style, x1: left, x2: left + 16, y1: 10, y2: 10 }),
      drawn("text", { x: left + 21, y: 14 }, name),
    ];
  });
}

const pathOf = (points) => points.map(([x, y], place) => `${place ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");

function barsOf(edges, shares, at, color) {
  return shares.map((share, place) => drawn("rect", {
    x: at.x(edges[place]), y: at.y(share), fill: color(place),
    width: Math.max(0.5, at.x(edges[place + 1]) - at.x(edges[place]) + 0.3), height: Math.max(0, at.bottom - at.y(share)),
  }));
}

const binOf = (edges, value) => Math.min(edges.length - 2, Math.max(0, edges.findIndex((edge) => edge > value) - 1));
const topOf = (...rows) => 1.05 * Math.max(1e-9, ...rows.flat());
const layerColor = (layer, value) => `rgb(${[...colorOf(layer, value)].join(" ")})`;
const middleAt = (edges, place) => (edges[place] + edges[place + 1]) / 2;

function disparityChart({ edges, found, wanted }) {
  const layer = viewOf("disparity");
  return {
    x: { label: "disparity, px", low: edges[0], high: edges.at(-1) },
    y: { label: "% of pixels", high: topOf(found ?? [], wanted ?? []) },
    names: wanted ? [["truth", "line text"]] : [],
    say: (value) => {
      const place = binOf(edges, value);
      const truth = wanted ? `, truth ${wanted[place].toFixed(2)} %` : "";
      return `${middleAt(edges, place).toFixed(2)} px: ${found ? `${found[place].toFixed(2)} %` : "none"}${truth}`;
    },
    paint: (at) => [
      ...(found ? barsOf(edges, found, at, (place) => layerColor(layer, middleAt(edges, place))) : []),
      ...(wanted ? [drawn("path", {
        class: "line text",
        d: pathOf(wanted.flatMap((share, place) => [[at.x(edges[place]), at.y(share)], [at.x(edges[place + 1]), at.y(share)]])),
      })] : []),
    ],
  };
}

function errorChart({ thresholds, wrong }) {
  return {
    x: { label: "off by more than, px", low: thresholds[0], high: thresholds.at(-1), log: true, ticks: [0.1, 0.25, 0.5, 1, 2, 4, 8, 16] },
    y: { label: "% of scored pixels", high: topOf(wrong) },
    say: (value) => {
      const place = binOf(thresholds, value);
      return `${wrong[place].toFixed(2)} % are off by more than ${thresholds[place].toFixed(2)} px`;
    },
    paint: (at) => {
      const points = thresholds.map((limit, place) => [at.x(limit), at.y(wrong[place])]);
      const area = [...points, [at.x(thresholds.at(-1)), at.bottom], [at.x(thresholds[0]), at.bottom]];
      return [drawn("path", { class: "area", d: pathOf(area) }), drawn("path", { class: "line accent", d: pathOf(points) })];
    },
  };
}

function reliabilityChart({ middles, right, pixels }) {
  const total = pixels.reduce((sum, count) => sum + count, 0);
  const edges = [...middles.map((middle) => middle - 0.05), 1];
  const known = middles.map((middle, place) => [middle, right[place]]).filter(([, share]) => share !== null);
  return {
    x: { label: "confidence", low: 0, high: 1 },
    y: { label: "%", high: 100 },
    names: [["ideal", "line dotted"], ["within 1 px", "line accent"]],
    say: (value) => {
      const place = binOf(edges, value);
      const share = right[place] === null ? "none there" : `${(100 * right[place]).toFixed(1)} % within 1 px`;
      return `${middles[place].toFixed(2)}: ${share}, ${((100 * pixels[place]) / total).toFixed(1)} % of the pixels`;
    },
    paint: (at) => [
      ...barsOf(edges, pixels.map((count) => (100 * count) / total), at, () => "var(--line)"),
      drawn("path", { class: "line dotted", d: pathOf([[at.x(0), at.y(0)], [at.x(1), at.y(100)]]) }),
      drawn("path", { class: "line accent", d: pathOf(known.map(([middle, share]) => [at.x(middle), at.y(100 * share)])) }),
      ...known.map(([middle, share]) => drawn("circle", { cx: at.x(middle), cy: at.y(100 * share), r: 3.5, fill: "var(--accent)" })),
    ],
  };
}

function confidenceChart({ edges, shares }) {
  const layer = viewOf("confidence");
  return {
    x: { label: "confidence", low: 0, high: 1 },
    y: { label: "% of pixels", high: topOf(shares) },
    say: (value) => `${middleAt(edges, binOf(edges, value)).toFixed(2)}: ${shares[binOf(edges, value)].toFixed(2)} %`,
    paint: (at) => barsOf(edges, shares, at, (place) => layerColor(layer, middleAt(edges, place))),
  };
}

const CHARTS = {
  disparities: disparityChart, errors: errorChart, reliability: reliabilityChart, confidences: confidenceChart,
};

function makeCharts() {
  for (const [key, numbers] of Object.entries(page.charts)) {
    const place = element(`chart-${key}`);
    whenNear(place, () => figure(place, CHARTS[key](numbers)));
  }
}
