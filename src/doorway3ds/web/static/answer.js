// The answer in words and figures: what to do, why, how sure, and what it goes by.
import { byId, shape } from "./svg.js";

const SIGNS = {
  turn: "M74 76V40H27M43 22L25 40L43 58",
  aligned: "M50 78V25M30 43L50 23L70 43",
  blocked: "M24 50H76",
  unsure: "M35 38a15 15 0 1 1 22 13q-7 4-7 12M50 79v.1",
  no_door: "M30 30L70 70M70 30L30 70",
  lost: "M50 24V56M50 77v.1",
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
  say(decision);
}

export function reset(headline, sentence, reason = "none") {
  byId("answer").dataset.reason = reason;
  byId("headline").textContent = headline;
  byId("sentence").textContent = sentence;
  byId("chance-figure").textContent = "–";
  byId("chance-bar").style.width = "0";
  sign(reason, null);
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

function facts(list) {
  const rows = (list.length ? list : [{ label: "Nothing yet", value: "–", note: "" }]).map((fact) => {
    const row = document.createElement("div");
    row.className = "fact";
    const cells = [["dt", fact.label, ""], ["dd", fact.value, ""]];
    if (fact.note) cells.push(["dd", fact.note, "more"]);
    for (const [name, words, kind] of cells) {
      const cell = document.createElement(name);
      cell.textContent = words;
      cell.className = kind;
      row.append(cell);
    }
    return row;
  });
  byId("facts").replaceChildren(...rows);
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
function say(decision) {
  const now = performance.now() / 1000;
  const turn = decision.turn_deg === null ? null : Math.round(decision.turn_deg / 5);
  const key = `${decision.reason} ${turn}`;
  if (key === said.words || now - said.at < SAID_AGAIN_S) return;
  said = { words: key, at: now };
  byId("announce").textContent = `${decision.view.headline}. ${decision.view.sentence}`;
}
