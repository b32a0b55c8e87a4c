// The image with the marks on it, and what a pointer does there: two clicks, or an edge dragged.
import { byId, shape } from "./svg.js";
import { stateOf, wayOf } from "./label-marks.js";

const NEAR_PX = 14; // of the screen, within which an edge is taken hold of
const SNAP = 0.01; // of the width, within which the image's own edge is meant
const MOVED_PX = 3;

const stage = byId("stage");
const marks = byId("marks");
const tags = byId("tags");
const photo = byId("photo");

let seen = null; // { width, height, openings, selected, guess, pending }
let cursor = null;
let held = null; // { index, side, from, column }
let tell = { edge() {}, moved() {} };

// edge(column): a click. moved(index, left, right): an edge was dragged.
export function listen(handlers) {
  tell = handlers;
}

export function showPicture(url, width, height, words) {
  stage.style.setProperty("--aspect", `${width} / ${height}`);
  stage.style.setProperty("--ratio", (width / height).toFixed(4));
  if (photo.getAttribute("src") !== url) photo.src = url;
  photo.alt = words;
  photo.hidden = false;
}

export function clear() {
  seen = null;
  photo.hidden = true;
  photo.removeAttribute("src");
  marks.replaceChildren();
  tags.replaceChildren();
}

export function draw(next = seen) {
  seen = next;
  marks.replaceChildren();
  tags.replaceChildren();
  if (!seen) return;
  const { width, height, selected, guess } = seen;
  marks.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  marks.setAttribute("preserveAspectRatio", "none");
  const drawn = [shape("path", { class: "l-middle", d: `M-0.5 ${height / 2}H${width}` })];
  openings().forEach((opening, i) => drawn.push(...outline(opening, i === selected, guess)));
  if (seen.pending !== null) drawn.push(...upright("l-edge", seen.pending));
  if (cursor !== null && !held) drawn.push(...upright("l-cursor", cursor));
  marks.replaceChildren(...drawn);
  openings().forEach((opening, i) => tag(opening, i));
}

// The openings, with the one that is being dragged as it would be.
function openings() {
  return seen.openings.map((opening, i) => {
    if (!held || held.index !== i || held.column === null) return opening;
    const other = held.side === "left_px" ? opening.right_px : opening.left_px;
    return { ...opening, left_px: Math.min(held.column, other), right_px: Math.max(held.column, other) };
  });
}

const upright = (kind, x) => {
  const d = `M${x} -0.5V${seen.height}`;
  return [shape("path", { class: `${kind} case`, d }), shape("path", { class: kind, d })];
};

function outline({ left_px: left, right_px: right }, selected, guess) {
  const kind = `l-edge${selected ? "" : " other"}${guess ? " guess" : ""}`;
  const found = [shape("rect", { class: "l-shade", x: left, y: -0.5, width: right - left, height: seen.height })];
  return [...found, ...upright(kind, left), ...upright(kind, right)];
}

function tag(opening, index) {
  const label = document.createElement("span");
  label.className = `tag ${seen.guess ? "guess" : "best"}`;
  const which = seen.openings.length > 1 ? `${index + 1} · ` : "";
  label.textContent = `${which}${stateOf(opening)} · ${wayOf(opening)}`;
  tags.append(label);
  const box = tags.getBoundingClientRect();
  const half = label.offsetWidth / 2 + 4;
  const middle = (((opening.left_px + opening.right_px + 1) / 2) / seen.width) * box.width;
  label.style.left = `${Math.min(Math.max(middle, half), Math.max(box.width - half, half))}px`;
  label.style.top = `${93 - 9 * index}%`; // the upper edge is for what the page has to say
}

// The image's column under a pointer, to a tenth of a pixel.
function columnAt(event) {
  const box = stage.getBoundingClientRect();
  const share = (event.clientX - box.left) / box.width;
  if (share < SNAP) return -0.5;
  if (share > 1 - SNAP) return seen.width - 0.5;
  return Math.round((share * seen.width - 0.5) * 10) / 10;
}

function edgeNear(event) {
  const box = stage.getBoundingClientRect();
  let best = null;
  seen.openings.forEach((opening, index) => {
    for (const side of ["left_px", "right_px"]) {
      const x = box.left + ((opening[side] + 0.5) / seen.width) * box.width;
      const gap = Math.abs(event.clientX - x) - (index === seen.selected ? 0.5 : 0);
      if (gap <= NEAR_PX && (!best || gap < best.gap)) best = { index, side, gap };
    }
  });
  return best;
}

stage.addEventListener("pointerdown", (event) => {
  if (!seen || event.button !== 0 || !event.isPrimary) return;
  const near = seen.pending === null ? edgeNear(event) : null;
  held = { index: near?.index, side: near?.side, from: event.clientX, column: null };
  if (near) stage.setPointerCapture(event.pointerId);
});

stage.addEventListener("pointermove", (event) => {
  if (!seen) return;
  if (held?.side && Math.abs(event.clientX - held.from) > MOVED_PX) held.column = columnAt(event);
  cursor = event.pointerType === "touch" ? null : columnAt(event);
  stage.classList.toggle("moving", Boolean(held?.side || (seen.pending === null && edgeNear(event))));
  draw();
});

stage.addEventListener("pointerup", (event) => {
  if (!seen || !held) return;
  const { index, column, from } = held;
  const moved = column === null ? null : openings()[index];
  held = null;
  if (moved) tell.moved(index, moved.left_px, moved.right_px);
  else if (Math.abs(event.clientX - from) <= 10) tell.edge(columnAt(event));
  else draw();
});

stage.addEventListener("pointercancel", () => { held = null; draw(); });
stage.addEventListener("pointerleave", () => { cursor = null; draw(); });
stage.addEventListener("dragstart", (event) => event.preventDefault());
new ResizeObserver(() => draw()).observe(stage);
