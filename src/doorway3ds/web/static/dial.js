// The robot from above: what the camera sees, where the openings lie, the turn to make.
import { byId, path, shape } from "./svg.js";
import { faint, turned } from "./stage.js";

const dial = byId("dial");
const SPANS = [50, 70, 90];
const HALF_WIDTH = 146; // that the arc may take, its figures left out
const HIGHEST = 172;
let R = HIGHEST;

// Bearings are + left, 0 is up.
const at = (degrees, reach) => {
  const turn = (degrees * Math.PI) / 180;
  return [-reach * R * Math.sin(turn), -reach * R * Math.cos(turn)];
};

function arc(start, stop, reach) {
  const steps = Math.max(2, Math.ceil(Math.abs(stop - start) / 2));
  return Array.from({ length: steps + 1 }, (_, i) => at(start + ((stop - start) * i) / steps, reach));
}

const wedge = (left, right) => path([[0, 0], ...arc(left, right, 1)]);

function head(tip, degrees, length, kind) {
  const turn = (degrees * Math.PI) / 180;
  const along = [-Math.sin(turn), -Math.cos(turn)];
  const back = [tip[0] - along[0] * length, tip[1] - along[1] * length];
  const half = 0.58 * length;
  return shape("path", {
    class: kind,
    d: path([tip, [back[0] - along[1] * half, back[1] + along[0] * half], [back[0] + along[1] * half, back[1] - along[0] * half]]),
  });
}

export function draw(decision) {
  const shown = decision || { reason: "none" };
  dial.dataset.reason = shown.reason;
  const seen = shown.view?.field_of_view_deg || [30, -30];
  const bearing = shown.open && shown.reason !== "lost" ? shown.bearing_deg : null;
  const widest = Math.max(...seen.map(Math.abs), Math.abs(bearing ?? 0));
  const span = SPANS.find((limit) => widest <= limit - 4) || 90;
  R = Math.min(HALF_WIDTH / Math.sin((span * Math.PI) / 180), HIGHEST);
  const parts = [shape("path", { class: "d-seen", d: wedge(seen[0], seen[1]) })];
  const [first, ...others] = shown.view?.openings || [];
  for (const opening of others.filter((other) => !faint(other))) {
    parts.push(shape("path", { class: "d-other", d: wedge(opening.left_deg, opening.right_deg) }));
  }
  if (first && (bearing !== null || !faint(first))) {
    const kind = bearing === null ? "d-other" : "d-best";
    parts.push(shape("path", { class: kind, d: wedge(first.left_deg, first.right_deg) }));
  }
  parts.push(shape("path", { class: "d-rim", d: path(arc(span, -span, 1), false) }));
  for (let degrees = -span; degrees <= span; degrees += 10) {
    const inner = degrees % 30 === 0 ? 0.93 : 0.965;
    parts.push(shape("path", { class: "d-tick", d: path([at(degrees, inner), at(degrees, 1)], false) }));
    if (degrees % 30 === 0) {
      const [x, y] = at(degrees, 1 + 17 / R);
      const sign = degrees > 0 ? "+" : degrees < 0 ? "−" : "";
      parts.push(shape("text", { x, y }, `${sign}${Math.abs(degrees)}°`));
    }
  }
  parts.push(shape("path", { class: "d-ahead", d: path([at(0, 0), at(0, 1)], false) }));
  if (bearing !== null) parts.push(...needle(shown, bearing));
  parts.push(shape("rect", { class: "d-robot", x: -22, y: -9, width: 44, height: 21, rx: 10.5 }));
  parts.push(shape("circle", { class: "d-robot", cx: 0, cy: -3, r: 11 }));
  parts.push(shape("circle", { class: "d-eye", cx: 0, cy: -9, r: 2.8 }));
  dial.replaceChildren(...parts);
  byId("turn").textContent = words(shown);
}

function needle(decision, bearing) {
  const turn = decision.turn_deg;
  if (turn === null) {
    return [shape("path", { class: "d-needle held", d: path([at(bearing, 0), at(bearing, 0.96)], false) })];
  }
  const parts = [
    shape("path", { class: "d-needle", d: path([at(bearing, 0), at(bearing, 0.88)], false) }),
    head(at(bearing, 0.98), bearing, 17, "d-head"),
  ];
  const length = (Math.abs(turn) * Math.PI * 0.62 * R) / 180;
  if (decision.reason === "turn" && length >= 10) {
    const size = Math.min(14, 0.6 * length);
    const stop = turn * (1 - (0.8 * size) / length);
    parts.push(shape("path", { class: "d-bow", d: path(arc(0, stop, 0.62), false) }));
    parts.push(head(at(turn, 0.62), turn + Math.sign(turn) * 90, size, "d-bow-head"));
  }
  return parts;
}

function words(decision) {
  if (decision.reason === "none") return "–";
  if (decision.reason === "aligned") return "no turn needed";
  return decision.turn_deg === null ? "no turn" : turned(decision.turn_deg);
}
