// The answer in words and figures: what to do, why, how sure, and what it goes by.
import { byId, shape } from "./svg.js";

const SIGNS = {
  turn: "M74 76V40H27M43 22L25 40L43 58",
  aligned: "M50 78V25M30 43L50 23L70 43",
  blocked: "M24 50H76",
  unsure: "M35 38a15 15 0 1 1 22 13q-7 4-7 12M50 79v.1",
  no_door: "M30 30L70 70M70 30L30 70",
  lost: "M50 24V56M50 77v.1",
  silent: "M28 50h.1M50 50h.1M72 50h.1",
  paused: "M38 28V72M62 28V72",
  taking: "M22 36V22H36M64 22H78V36M78 64V78H64M36 78H22V64",
  taken: "M26 52L43 69L75 33",
  done: "M26 52L43 69L75 33",
  failed: "M30 30L70 70M70 30L30 70",
  none: "M34 78V22h32v56M34 22l18 7v52l-18-3",
};
const SAID_AGAIN_S = 2;
let said = { words: "", reason: "", at: 0 };

export function show(decision, belief) {
  const view = decision.view;
  byId("answer").dataset.reason = decision.reason;
  byId("headline").textContent = view.headline;
  byId("sentence").textContent = view.sentence;
  sign(decision.reason, decision.turn_deg);
  byId("chance-figure").textContent = belief.toFixed(2);
  byId("chance-bar").style.width = `${100 * Math.min(Math.max(belief, 0), 1)}%`;
  facts(view.facts);
  depth(view.depth);
  timings(decision.timings_ms);
  const turn = decision.turn_deg === null ? null : Math.round(decision.turn_deg / 5);
  say(`${decision.reason} ${turn}`, `${view.headline}. ${view.sentence}`);
}

// Another headline over the same figures.
export function rename(headline, sentence, reason) {
  byId("answer").dataset.reason = reason;
  byId("headline").textContent = headline;
  byId("sentence").textContent = sentence;
  sign(reason, null);
  say(`${reason} ${headline}`, `${headline}. ${sentence}`, true);
}

export function reset(headline, sentence, reason = "none") {
  rename(headline, sentence, reason);
  byId("chance-figure").textContent = "–";
  byId("chance-bar").style.width = "0";
  facts([]);
  depth(null);
  byId("timings").textContent = "";
}

function sign(reason, turn) {
  const mirrored = reason === "turn" && turn < 0 ? { transform: "matrix(-1 0 0 1 100 0)" } : {};
  byId("sign").replaceChildren(
    shape("svg", { viewBox: "0 0 100 100" }, shape("path", { d: SIGNS[reason] || SIGNS.none, ...mirrored })),
  );
}

// Written in place, and left alone while somebody selects them to copy.
function facts(list) {
  const shown = list.length ? list : [{ label: "Nothing yet", value: "–", note: "" }];
  const box = byId("facts");
  const selected = document.getSelection();
  if (list.length && !selected.isCollapsed && box.contains(selected.anchorNode)) return;
  while (box.children.length > shown.length) box.lastElementChild.remove();
  shown.forEach((fact, i) => {
    const row = box.children[i] || box.appendChild(emptyFact());
    [fact.label, fact.value, fact.note].forEach((words, n) => {
      const cell = n === 1 && fact.link ? linked(row.children[n], fact.link) : row.children[n];
      if (cell.textContent !== words) cell.textContent = words;
    });
    row.children[2].hidden = !fact.note;
  });
}

// In a tab of its own: this page goes on deciding.
function linked(cell, href) {
  let link = cell.querySelector("a");
  if (!link) {
    link = Object.assign(document.createElement("a"), { target: "_blank", rel: "noopener" });
    cell.replaceChildren(link);
  }
  link.href = href;
  return link;
}

function emptyFact() {
  const row = document.createElement("div");
  row.className = "fact";
  row.append(...["dt", "dd", "dd"].map((name) => document.createElement(name)));
  row.lastChild.className = "more";
  return row;
}

function depth(found) {
  const image = byId("depth");
  image.hidden = !found;
  byId("ramp").hidden = !found;
  byId("depth-range").textContent = found ? "" : "none";
  if (!found) return;
  image.src = found.png;
  byId("ramp-end").textContent = `${found.limit_m} m`;
}

function timings(stages) {
  const parts = Object.entries(stages).map(([stage, ms]) => `${stage} ${ms.toFixed(1)} ms`);
  byId("timings").textContent = parts.join(" · ");
}

// A screen reader hears what changes the robot's turn, not every frame.
function say(key, words, atOnce = false) {
  const now = performance.now() / 1000;
  if (key === said.words || (!atOnce && now - said.at < SAID_AGAIN_S)) return;
  said = { words: key, at: now };
  byId("announce").textContent = words;
}
