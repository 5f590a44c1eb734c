// What the viewer shows: a description, maps and pictures. Whoever starts it fills them in.

const page = JSON.parse(document.getElementById("page").textContent);
const maps = {}; // typed arrays by name, row by row
const pictures = {}; // canvases and their RGBA bytes by name: left, right

const element = (id) => document.getElementById(id);

function made(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

const numberOf = (value, places, unit = "") =>
  `${value.toFixed(places).replace("-", "\u2212")}${unit && ` ${unit}`}`;

// Infinite where an estimate is missing that counts, NaN where nothing counts.
function errorOf(found, at) {
  if (!maps.scored[at]) return NaN;
  return Number.isFinite(found) ? Math.abs(found - maps.truth[at]) : Infinity;
}

// Draw when it comes near: what is further down may never be looked at.
function whenNear(place, draw) {
  new IntersectionObserver(async ([entry], observer) => {
    if (!entry.isIntersecting) return;
    observer.disconnect();
    await draw();
    place.dataset.drawn = "yes";
  }, { rootMargin: "300px" }).observe(place);
}
