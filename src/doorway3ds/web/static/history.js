// Belief in an open doorway over the last minute.
import { byId, path, shape } from "./svg.js";

const SPAN_S = 60;
const WIDTH = 320;
const HEIGHT = 84;
const picture = byId("history");
let samples = [];

export function clear() {
  samples = [];
  draw();
}

// What stands there is of the past only.
export function rest() {
  byId("belief").textContent = "–";
  byId("history-to").textContent = "last";
}

export function add(belief) {
  const now = performance.now() / 1000;
  samples.push([now, belief]);
  samples = samples.filter(([at]) => now - at <= SPAN_S);
  draw();
}

function draw() {
  const end = samples.at(-1);
  byId("belief").textContent = end ? end[1].toFixed(2) : "–";
  byId("history-to").textContent = "now";
  const parts = [
    shape("rect", { class: "h-ground", width: WIDTH, height: HEIGHT, rx: 6 }),
    shape("path", { class: "h-half", d: `M0 ${HEIGHT / 2}H${WIDTH}` }),
  ];
  if (end) {
    // The axis grows until there is a minute to show.
    const span = Math.min(SPAN_S, Math.max(10, end[0] - samples[0][0]));
    byId("history-from").textContent = `${Math.round(span)} s ago`;
    const points = samples.map(([at, p]) => [
      WIDTH * (1 - (end[0] - at) / span),
      HEIGHT - 4 - (HEIGHT - 8) * p,
    ]);
    if (points.length === 1) points.unshift([0, points[0][1]]);
    const ground = [[points[0][0], HEIGHT], ...points, [points.at(-1)[0], HEIGHT]];
    parts.push(shape("path", { class: "h-area", d: path(ground) }));
    parts.push(shape("path", { class: "h-line", d: path(points, false) }));
  }
  picture.replaceChildren(...parts);
}
