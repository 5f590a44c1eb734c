// The charts, by Plotly, in the colours of the page.

const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const figures = []; // what is drawn, to be given other colours when the theme changes

// Draw when it comes near: most of Plotly's work is for what is further down.
function whenNear(place, draw) {
  new IntersectionObserver(async ([entry], observer) => {
    if (!entry.isIntersecting) return;
    observer.disconnect();
    await draw();
    figures.push(draw);
    place.dataset.drawn = "yes";
  }, { rootMargin: "300px" }).observe(place);
}

function look(across, up) {
  const axis = (text) => ({
    title: { text, font: { size: 12 }, standoff: 8 }, gridcolor: styleOf("--line"), linecolor: styleOf("--line"),
    zeroline: false, automargin: true, fixedrange: true,
  });
  return {
    xaxis: { ...axis(across.text), ...across.more }, yaxis: { ...axis(up.text), rangemode: "tozero", ...up.more },
    font: { family: "system-ui, sans-serif", color: styleOf("--text"), size: 12 },
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true, bargap: 0,
    margin: { l: 48, r: 12, t: 28, b: 44 }, showlegend: true, hovermode: "x unified",
    legend: { orientation: "h", x: 1, xanchor: "right", y: 1.02, yanchor: "bottom", font: { size: 11 } },
    hoverlabel: { bgcolor: styleOf("--raised"), bordercolor: styleOf("--line"), font: { color: styleOf("--text") } },
  };
}

const middles = (edges) => edges.slice(1).map((end, at) => (edges[at] + end) / 2);

function disparityChart({ edges, found, wanted }) {
  const layer = viewOf("disparity");
  const x = middles(edges);
  const traces = [];
  if (found) {
    const color = x.map((value) => `rgb(${colourOf(layer, value).join(",")})`);
    traces.push({ type: "bar", x, y: found, marker: { color, line: { width: 0 } }, name: "found", showlegend: false, hovertemplate: "%{y:.2f} %" });
  }
  if (wanted) {
    traces.push({ type: "scatter", mode: "lines", x, y: wanted, line: { color: styleOf("--text"), width: 1.25, shape: "hvh" }, name: "truth", hovertemplate: "%{y:.2f} %" });
  }
  return { traces, layout: look({ text: "disparity, px", more: { hoverformat: ".2f" } }, { text: "% of pixels" }) };
}

function errorChart({ thresholds, wrong }) {
  const line = { color: styleOf("--accent"), width: 2.5 };
  const traces = [{
    type: "scatter", mode: "lines", x: thresholds, y: wrong, line, fill: "tozeroy", name: "wrong",
    showlegend: false, hovertemplate: "%{y:.2f} % are off by more",
  }];
  const tickvals = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
  const ticks = { type: "log", tickvals, ticktext: tickvals.map(String), tickangle: 0, hoverformat: ".2f" };
  return { traces, layout: look({ text: "off by more than, px", more: ticks }, { text: "% of scored pixels" }) };
}

function reliabilityChart({ middles: x, right, pixels }) {
  const total = pixels.reduce((sum, count) => sum + count, 0);
  const share = pixels.map((count) => (100 * count) / total);
  const soft = styleOf("--soft");
  const traces = [
    { type: "bar", x, y: share, marker: { color: styleOf("--line") }, name: "pixels", hovertemplate: "%{y:.1f} % of the pixels" },
    { type: "scatter", mode: "lines", x: [0, 1], y: [0, 100], line: { color: soft, dash: "dot", width: 1 }, name: "ideal", hoverinfo: "skip" },
    {
      type: "scatter", mode: "lines+markers", x, y: right.map((value) => value && 100 * value), name: "within 1 px",
      line: { color: styleOf("--accent"), width: 2.5 }, hovertemplate: "%{y:.1f} % within 1 px",
    },
  ];
  return { traces, layout: look({ text: "confidence" }, { text: "%", more: { range: [0, 100] } }) };
}

function confidenceChart({ edges, shares }) {
  const layer = viewOf("confidence");
  const x = middles(edges);
  const color = x.map((value) => `rgb(${colourOf(layer, value).join(",")})`);
  const traces = [{ type: "bar", x, y: shares, marker: { color, line: { width: 0 } }, showlegend: false, hovertemplate: "%{y:.2f} %" }];
  return { traces, layout: look({ text: "confidence" }, { text: "% of pixels" }) };
}

const CHARTS = {
  disparities: disparityChart, errors: errorChart, reliability: reliabilityChart, confidences: confidenceChart,
};

function makeCharts() {
  for (const [key, told] of Object.entries(page.charts)) {
    const place = element(`chart-${key}`);
    whenNear(place, () => {
      const { traces, layout } = CHARTS[key](told);
      return Plotly.react(place, traces, layout, { displayModeBar: false, responsive: true });
    });
  }
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  stage.refresh();
  for (const draw of figures) draw();
});
