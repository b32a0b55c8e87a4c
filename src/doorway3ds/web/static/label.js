// Puts the page of `3ds label` together: which image, what is marked, what keys and buttons do.
import { Book, folder, unmarkedAfter } from "./label-book.js";
import * as edit from "./label-marks.js";
import * as stage from "./label-stage.js";
import { prepareShare, prepareTheme } from "./chrome.js";
import { byId } from "./svg.js";

const panel = byId("panel");
const book = new Book((entry) => {
  if (entry !== now.entry) return;
  tellConflict(entry);
  show();
});
const now = {
  info: null,
  entry: null,
  asked: -1, // the image that was asked for last
  waiting: 0, // for images on their way: meanwhile nothing is marked, it would be the old one
  selected: 0,
  pending: null, // the first of two clicks
  adding: false,
  half: null, // whether the next opening is half open; null: as it was
};

const shown = () => now.entry.marks ?? now.entry.guess ?? edit.NOTHING;
const isGuess = () => now.entry.marks === null;

function note(words, bad = false) {
  byId("note").hidden = !words;
  byId("note").textContent = words;
  byId("note").toggleAttribute("data-bad", bad);
}

function tellConflict(entry) {
  if (entry.conflict) note(entry.conflict, true);
  entry.conflict = "";
}

// --- Which image

async function meanwhile(work) {
  now.waiting += 1;
  try {
    return await work;
  } catch (error) {
    note(error.message, true);
    return undefined;
  } finally {
    now.waiting -= 1;
  }
}

async function go(number) {
  if (number < 0 || number >= now.info.pictures) return;
  now.asked = number;
  const entry = await meanwhile(book.open(number));
  if (!entry || now.asked !== number) return;
  Object.assign(now, { entry, selected: 0, pending: null, adding: false, half: null });
  history.replaceState(null, "", `#${number + 1}`);
  note(entry.problem ?? "", true);
  if (entry.image) stage.showPicture(entry.image, entry.width, entry.height, entry.name);
  else stage.clear();
  show();
  lookAhead(number);
}

// The next unmarked image is decoded and guessed at while this one is looked at.
async function lookAhead(number) {
  try {
    const next = await unmarkedAfter(number);
    if (next === null || next === number || now.asked !== number) return;
    const entry = await book.open(next);
    if (entry.image) new Image().src = entry.image;
  } catch { /* it will be asked for again */ }
}

async function goOn() {
  const next = await meanwhile(unmarkedAfter(now.entry.number));
  if (next === null || next === now.entry.number) note("Every other image is marked.");
  else if (next !== undefined) await go(next);
}

async function take() {
  if (isGuess() && now.entry.width) {
    if (!now.entry.guess) {
      note("Nothing is marked yet: click the opening's edges, or press C or N.");
      return;
    }
    book.change(now.entry, now.entry.guess);
  }
  await goOn();
}

// --- What is marked

function change(marks, selected = now.selected) {
  if (!now.entry?.width || now.waiting) return;
  Object.assign(now, { selected, pending: null, adding: false, half: null });
  note("");
  book.change(now.entry, marks);
  show();
}

function setOpen(half) {
  const marks = shown();
  if (marks.openings.length && !now.adding) {
    change(edit.patch(marks, now.selected, { half_open: half }));
  } else {
    now.half = half;
    note("Click the opening's left and right edge.");
    show();
  }
}

function clicked(column) {
  if (!now.entry?.width || now.waiting) return;
  if (now.pending === null) {
    now.pending = column;
    note("Now the other edge.");
    show();
    return;
  }
  if (Math.abs(column - now.pending) < Math.max(1, 0.004 * now.entry.width)) {
    now.pending = null;
    note("Both clicks were at the same place: the edge was let go.");
    show();
    return;
  }
  const marks = shown();
  const index = now.adding ? marks.openings.length : now.selected;
  const more = now.half === null ? {} : { half_open: now.half };
  change(edit.place(marks, index, now.pending, column, more), index);
}

function moved(index, left, right) {
  if (right - left < 1) show();
  else change(edit.place(shown(), index, left, right), index);
}

function typed() {
  const [left, right] = [byId("left").valueAsNumber, byId("right").valueAsNumber];
  if (!(left < right)) {
    note("The left edge lies left of the right one.", true);
    return;
  }
  change(edit.place(shown(), now.selected, left, right));
}

function onOpening(changeTo) {
  const marks = shown();
  if (marks.openings.length) change(changeTo(marks));
  else note("There is no opening: click its left and right edge.");
}

function add() {
  now.adding = true;
  now.pending = null;
  note("Click the further opening's left and right edge.");
  show();
}

function select(step) {
  const count = shown().openings.length;
  if (count) now.selected = (now.selected + step + count) % count;
  show();
}

function letGo() {
  Object.assign(now, { pending: null, adding: false, half: null });
  note("");
  show();
}

async function back(step, words) {
  const entry = await meanwhile(step);
  if (!entry) {
    if (entry === null) note(words);
    return;
  }
  if (entry === now.entry) letGo();
  else await go(entry.number);
  tellConflict(entry);
}

const confidence = (value) => () => change(edit.sure(shown(), now.selected, value));
const way = (clear) => () => onOpening((marks) => edit.patch(marks, now.selected, { clear }));

const keys = {
  o: () => setOpen(false),
  h: () => setOpen(true),
  c: () => change(edit.shut(shown(), true), 0),
  n: () => change(edit.shut(shown(), false), 0),
  s: add,
  x: () => onOpening((marks) => edit.remove(marks, now.selected)),
  w: way(true),
  b: way(false),
  q: way(null),
  1: confidence(1),
  2: confidence(2),
  3: confidence(3),
  z: () => back(book.undo(), "There is nothing to undo."),
  y: () => back(book.redo(), "There is nothing to do again."),
  u: goOn,
  l: () => byId("left").select(),
  r: () => byId("right").select(),
  Enter: take,
  " ": take,
  Escape: letGo,
  Delete: () => now.entry.marks && change(null, 0),
  Backspace: () => now.entry.marks && change(null, 0),
  ArrowLeft: () => go(now.asked - 1),
  ArrowRight: () => go(now.asked + 1),
  ArrowUp: () => select(-1),
  ArrowDown: () => select(1),
};

function act(key) {
  if (now.entry && (!now.waiting || key === "ArrowLeft" || key === "ArrowRight")) keys[key]();
}

// --- What is shown

function show() {
  const { entry } = now;
  const marks = shown();
  now.selected = Math.min(now.selected, Math.max(marks.openings.length - 1, 0));
  if (entry.width) {
    const { width, height } = entry;
    stage.draw({ width, height, openings: marks.openings, selected: now.selected, guess: isGuess(), pending: now.pending });
  }
  byId("name").textContent = entry.name;
  byId("guess").textContent = entry.p_open === null ? "" : `the network: open doorway ${entry.p_open.toFixed(2)}`;
  byId("goto").value = entry.number + 1;
  byId("count").textContent = `${book.marked} of ${now.info.pictures} marked`;
  byId("progress").value = book.marked;
  byId("take-words").textContent = isGuess() && entry.guess ? "Take it, go on" : "Go on";
  showSaved(entry);
  showPanel(entry, marks);
}

function showSaved(entry) {
  let [state, words] = ["saved", "Saved"];
  if (entry.trouble) [state, words] = ["failed", `Not saved: ${entry.trouble}`];
  else if (book.unsaved(entry)) [state, words] = ["saving", "Saving …"];
  else if (!entry.marks) [state, words] = ["none", entry.guess ? "A guess, not saved" : "Not marked"];
  byId("saved").dataset.state = state;
  if (byId("saved").textContent !== words) byId("saved").textContent = words;
}

function press(box, key) {
  for (const button of byId(box).querySelectorAll("button[data-key]")) {
    button.setAttribute("aria-pressed", String(button.dataset.key === key));
  }
}

function showPanel(entry, marks) {
  const opening = marks.openings[now.selected];
  const nothing = isGuess() && !entry.guess;
  const half = now.half ?? opening?.half_open;
  panel.toggleAttribute("data-guess", isGuess());
  panel.querySelectorAll("button, input").forEach((e) => { e.disabled = !entry.width; });
  let state = nothing ? "" : marks.closed ? "c" : "n";
  if (opening || now.half !== null) state = half ? "h" : "o";
  press("states", state);
  press("ways", opening ? { true: "w", false: "b", null: "q" }[String(opening.clear)] : "");
  press("sureness", nothing ? "" : String(opening ? opening.confidence : marks.confidence));
  for (const e of byId("ways").querySelectorAll("button")) e.disabled = !opening;
  for (const [id, side] of [["left", "left_px"], ["right", "right_px"]]) {
    byId(id).disabled = !opening;
    byId(id).min = -0.5;
    byId(id).max = (entry.width ?? 1) - 0.5;
    byId(id).value = opening ? opening[side] : "";
  }
  byId("remove").disabled = !opening;
  byId("add").disabled = !opening;
  byId("unmark").disabled = !entry.marks;
  byId("undo").disabled = !book.done.length;
  byId("redo").disabled = !book.undone.length;
  showList(marks);
}

function showList(marks) {
  const rows = marks.openings.map((opening, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", String(i === now.selected));
    const [from, to] = [opening.left_px, opening.right_px].map((x) => x.toFixed(0));
    button.textContent = `${i + 1}: ${from} to ${to} px, ${edit.stateOf(opening)}, ${edit.wayOf(opening)}`;
    button.addEventListener("click", () => { now.selected = i; show(); });
    return button;
  });
  const none = document.createElement("p");
  none.textContent = "None: click its left and right edge.";
  const list = byId("list");
  const focused = [...list.children].indexOf(document.activeElement);
  list.replaceChildren(...(rows.length ? rows : [none]));
  if (focused >= 0) list.children[focused]?.focus();
}

// --- What people do

// A button that was clicked lets go of the focus, so that Enter goes on to the next image.
document.addEventListener("click", (event) => {
  const button = event.target.closest?.("main button");
  if (!button) return;
  if (event.detail > 0) button.blur();
  if (button.dataset.key) act(button.dataset.key);
});
for (const [id, key] of [["previous", "ArrowLeft"], ["next", "ArrowRight"], ["take", "Enter"], ["unmarked", "u"]]) {
  byId(id).addEventListener("click", () => act(key));
}
byId("goto").addEventListener("change", () => go(byId("goto").valueAsNumber - 1));
for (const id of ["left", "right"]) byId(id).addEventListener("change", typed);
panel.addEventListener("submit", (event) => event.preventDefault());

document.addEventListener("keydown", (event) => {
  if (!now.entry || byId("share-box").open) return;
  const typing = event.target.matches("input");
  const command = event.ctrlKey || event.metaKey;
  let { key } = event;
  if (key.length === 1) key = key.toLowerCase();
  if (command && !typing && key === "z") key = event.shiftKey ? "y" : "z";
  else if (command && !typing && key === "y") key = "y";
  else if (command || event.altKey) return;
  if (typing) {
    if (key === "Enter" || key === "Escape") event.target.blur();
    return;
  }
  // A button in focus is pressed by these two.
  if ((key === "Enter" || key === " ") && event.target.matches("button, a")) return;
  if (!Object.hasOwn(keys, key)) return;
  event.preventDefault();
  if (!event.repeat || key.startsWith("Arrow")) act(key);
});

window.addEventListener("beforeunload", (event) => {
  if (book.pending) event.preventDefault();
});

async function begin() {
  prepareTheme();
  stage.listen({ edge: clicked, moved });
  try {
    now.info = await folder();
  } catch (error) {
    note(error.message, true);
    return;
  }
  const { info } = now;
  book.marked = info.marked;
  prepareShare(info.link);
  document.title = `${info.name}: doorway3ds label`;
  byId("folder").textContent = info.name;
  byId("total").textContent = info.pictures;
  byId("goto").max = info.pictures;
  byId("progress").max = info.pictures;
  const wanted = Number.parseInt(location.hash.slice(1), 10) - 1;
  await go(wanted >= 0 && wanted < info.pictures ? wanted : info.start);
  document.body.dataset.mode = "label";
}

begin();
