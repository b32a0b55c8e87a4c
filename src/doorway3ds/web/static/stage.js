// The image and the marks on it, drawn from the outlines that the server sends.
import { byId, path, shape } from "./svg.js";

const stage = byId("stage");
const marks = byId("marks");
const tags = byId("tags");
const layers = byId("layers");
const depthLayer = byId("depth-layer");
const DECODE_MS = 2000;
let last = null;

const FAINT = 0.1; // score below which a candidate is noise to a person who looks

export const faint = (opening) => opening.score < FAINT;

const on = (name) => layers.querySelector(`[value="${name}"]`).checked;

layers.addEventListener("change", () => last && draw(last));

export function clear() {
  last = null;
  marks.replaceChildren();
  tags.replaceChildren();
  depthLayer.hidden = true;
}

// A decoded image that can be put on the stage without waiting for anything.
export async function photo(blob) {
  const image = new Image();
  image.id = "photo";
  image.alt = "The image that is decided on";
  image.src = URL.createObjectURL(blob);
  // Browsers read fewer kinds than the server, and may leave a page out of sight waiting.
  const late = new Promise((done) => setTimeout(done, DECODE_MS));
  await Promise.race([image.decode().catch(() => {}), late]);
  return image;
}

export function put(image) {
  const old = byId("photo");
  old.replaceWith(image);
  if (old.src.startsWith("blob:")) URL.revokeObjectURL(old.src);
}

export function fit(width, height) {
  delete stage.dataset.empty;
  for (const place of [stage, byId("depth-box")]) {
    place.style.setProperty("--aspect", `${width} / ${height}`);
    place.style.setProperty("--ratio", (width / height).toFixed(4));
  }
}

export function draw(decision) {
  last = decision;
  const view = decision.view;
  const { width, height } = view;
  marks.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  marks.setAttribute("preserveAspectRatio", "none");
  const drawn = [hatch(width)];
  tags.replaceChildren();
  if (on("floor") && view.floor.length) {
    drawn.push(shape("path", { class: "m-floor", d: view.floor.map((p) => path(p)).join("") }));
  }
  if (on("way")) drawn.push(...way(view));
  if (on("openings")) {
    drawn.push(...openings(view, decision));
    drawn.push(...(view.paper ? paperMarks(view) : aim(view)));
  }
  marks.replaceChildren(...drawn);
  depthLayer.hidden = !(on("depth") && view.depth);
  if (!depthLayer.hidden) depthLayer.src = view.depth.png;
}

function hatch(width) {
  const step = width / 55;
  const line = shape("path", { d: `M0 0H${step}`, stroke: "rgb(213 94 0 / 75%)", "stroke-width": step * 0.7 });
  const ground = shape("rect", { width: step, height: step, fill: "rgb(213 94 0 / 22%)" });
  return shape("defs", {}, shape("pattern", {
    id: "hatch", width: step, height: step,
    patternUnits: "userSpaceOnUse", patternTransform: "rotate(-45)",
  }, ground, line));
}

const cased = (kind, d) => [
  shape("path", { class: `${kind} case`, d }),
  shape("path", { class: kind, d }),
];

function way(view) {
  const found = [];
  if (view.corridor.length >= 3) {
    const seen = view.clear === true ? "free" : view.clear === false ? "blocked" : "unseen";
    found.push(...cased(`m-way ${seen}`, path(view.corridor)));
  }
  if (view.obstacle.length) {
    found.push(...cased("m-obstacle", view.obstacle.map((p) => path(p)).join("")));
  }
  return found;
}

function openings(view, decision) {
  const { width, height } = view;
  const found = [];
  const trusted = decision.open && decision.reason !== "lost";
  view.openings.forEach((opening, i) => {
    if (i === 0 && trusted) return;
    if (faint(opening) && !on("faint")) return;
    const { left_px: left, right_px: right } = opening;
    const top = 0.22 * height;
    const foot = 0.78 * height;
    // One line over both jambs: they are seen to belong together.
    const start = ["left", "both"].includes(opening.cut) ? `M${left} ${top}` : `M${left} ${foot}V${top}`;
    const end = ["right", "both"].includes(opening.cut) ? `H${right}` : `H${right}V${foot}`;
    found.push(...cased("m-other", start + end));
    tag(opening.score.toFixed(2), (left + right) / 2, 0.3 * height, view, "");
  });
  if (trusted && view.openings.length) found.push(...best(view, decision, view.openings[0]));
  return found;
}

function best(view, decision, opening) {
  const { width, height } = view;
  const { left_px: left, right_px: right } = opening;
  const top = 0.07 * height;
  const far = view.corridor.length >= 3 ? Math.min(...view.corridor.map((p) => p[1])) : 0.88 * height;
  const bottom = Math.min(Math.max(far, 0.6 * height), 0.94 * height);
  const cutLeft = ["left", "both"].includes(opening.cut);
  const cutRight = ["right", "both"].includes(opening.cut);
  const from = cutLeft ? -width : left;
  const to = cutRight ? 2 * width : right;
  const reach = Math.min(0.03 * Math.max(width, height), 0.3 * (right - left));
  let d;
  if (!cutLeft && !cutRight) {
    d = [[left, reach], [right, -reach]].map(([x, inward]) =>
      `M${x + inward} ${top}H${x}V${bottom}H${x + inward}`).join("");
  } else if (cutLeft && cutRight) {
    d = `M${from} ${top}H${to}M${from} ${bottom}H${to}`;
  } else {
    const [jamb, edge] = cutLeft ? [right, from] : [left, to];
    d = `M${edge} ${top}H${jamb}V${bottom}H${edge}`;
  }
  const size = 0.016 * Math.max(width, height);
  const middle = (top + bottom) / 2;
  for (const [cut, x, way] of [[cutLeft, size, -1], [cutRight, width - size, 1]]) {
    if (!cut) continue;
    for (const tip of [x, x - way * 1.2 * size]) {
      d += `M${tip - way * size} ${middle - 1.5 * size}L${tip} ${middle}L${tip - way * size} ${middle + 1.5 * size}`;
    }
  }
  // With memory, the decision's own figures are calmer than this frame's.
  const range = decision.range_m ?? opening.range_m;
  const parts = [turned(decision.bearing_deg ?? opening.bearing_deg)];
  if (range !== null) parts.push(`${range.toFixed(1)} m`);
  const middleX = (Math.max(left, 0) + Math.min(right, width)) / 2;
  tag(parts.join(" · "), middleX, top, view, "best");
  return [
    shape("rect", { class: "m-shade", x: from, y: top, width: Math.max(to - from, 0), height: bottom - top }),
    ...cased("m-best", d),
  ];
}

function aim(view) {
  if (!view.pixel) return [];
  const [row, column] = view.pixel;
  const r = 0.008 * Math.max(view.width, view.height);
  return ["m-aim case", "m-aim"].map((kind) => shape("circle", { class: kind, cx: column, cy: row, r }));
}

function paperMarks(view) {
  const { max, best: aimed, trigger } = view.paper;
  const found = [];
  if (max && aimed) found.push(...cased("m-paper", path([max, aimed], false)));
  if (aimed && trigger) {
    const kind = view.clear === false ? "blocked" : "free";
    found.push(...cased(`m-paper ${kind}`, path([aimed, trigger], false)));
  }
  const r = 0.012 * Math.max(view.width, view.height);
  const outline = { max: [[-1, 0], [0, -1], [1, 0], [0, 1]], trigger: [[-1, -1.6], [1, -1.6], [0, 0]] };
  const color = { max: "#e69f00", trigger: view.clear === false ? "#d55e00" : "#009e73" };
  for (const name of ["trigger", "max", "best"]) {
    const at = view.paper[name];
    if (!at) continue;
    if (name === "best") {
      found.push(...["m-aim case", "m-aim"].map((kind) =>
        shape("circle", { class: kind, cx: at[0], cy: at[1], r: 0.7 * r })));
    } else {
      const d = path(outline[name].map(([x, y]) => [at[0] + x * r, at[1] + y * r]));
      found.push(shape("path", { d, fill: "#fff", stroke: "#1b2029", "stroke-width": 6 }));
      found.push(shape("path", { d, fill: color[name], stroke: "#fff", "stroke-width": 3 }));
    }
    // Outside of the way between Max and Best, so that both can be read.
    const leftward = max && aimed && max[0] < aimed[0];
    const side = name !== "trigger" && leftward === (name === "max") ? -4.5 : 4.5;
    tag(name[0].toUpperCase() + name.slice(1), at[0] + side * r, at[1] - 2 * r, view, "");
  }
  return found;
}

export function turned(degrees) {
  const size = Math.abs(degrees).toFixed(1);
  return size === "0.0" ? "0.0°" : `${size}° ${degrees > 0 ? "left" : "right"}`;
}

function tag(words, x, y, view, kind) {
  const label = document.createElement("span");
  label.className = `tag ${kind}`;
  label.textContent = words;
  tags.append(label);
  // Kept inside of the image by its own width.
  const box = tags.getBoundingClientRect();
  const half = label.offsetWidth / 2 + 4;
  const px = (x / view.width) * box.width;
  label.style.left = `${Math.min(Math.max(px, half), Math.max(box.width - half, half))}px`;
  label.style.top = `${Math.max((y / view.height) * 100, 3.5)}%`;
}

new ResizeObserver(() => last && draw(last)).observe(stage);
