// A guided calibration of the server's source. The server keeps all of it; a page only shows how far
// it is, so that one that is opened again, or another one, goes on where the first was.
import * as answer from "./answer.js";
import * as api from "./api.js";
import * as stage from "./stage.js";
import { byId, path, shape } from "./svg.js";
import { asSentence, why } from "./words.js";

const EVERY_MS = 200;
const FIELD = { width: 400, height: 300 };
const TILTS = ["left", "right", "up", "down"];
const board = byId("board");

export class Calibrate {
  constructor() {
    this.round = 0; // counts up whenever the page turns to something else
    this.told = { state: "none" };
    board.addEventListener("input", () => this.prepare());
    board.addEventListener("submit", (event) => {
      event.preventDefault();
      if (board.checkValidity()) this.ask(() => api.calibrate(this.fields()));
    });
    byId("calibrate-finish").addEventListener("click", () => this.ask(api.finishCalibration));
    byId("calibrate-drop").addEventListener("click", () => this.ask(api.dropCalibration));
    this.prepare();
  }

  fields() {
    return {
      board: board.board.value,
      square_mm: board.square_mm.valueAsNumber,
      charuco: Boolean(board.charuco.value),
    };
  }

  prepare() {
    const [label] = byId("board-size").childNodes;
    label.textContent = board.charuco.value ? "Squares " : "Inner corners ";
    if (board.checkValidity()) byId("board-pdf").href = api.boardPdf(this.fields());
  }

  async ask(request) {
    byId("board-problem").hidden = true;
    try {
      this.show(await request());
    } catch (error) {
      byId("board-problem").hidden = false;
      byId("board-problem").textContent = why(error);
    }
  }

  async start() {
    const round = (this.round += 1);
    const wanted = () => round === this.round;
    while (wanted()) {
      if (!document.hidden) await this.look(wanted);
      await new Promise((done) => setTimeout(done, EVERY_MS));
    }
  }

  stop() {
    this.round += 1;
    for (const id of ["calibrate-finish", "calibrate-file", "calibrate-drop"]) byId(id).hidden = true;
  }

  async look(wanted) {
    try {
      const told = await api.calibration();
      if (!wanted()) return;
      this.show(told);
      const blob = await api.frame("plain", told.state === "taking" ? told.frame : null);
      const photo = await stage.photo(blob);
      if (!wanted()) return;
      delete document.body.dataset.stale;
      byId("welcome").hidden = true;
      stage.fit(photo.naturalWidth, photo.naturalHeight);
      stage.put(photo);
      marks(this.told.state === "taking" ? told : null, photo);
    } catch (error) {
      if (!wanted() || error.code === "frame_gone") return;
      document.body.dataset.stale = "";
      answer.rename("No image", why(error), "silent");
    }
  }

  show(told) {
    this.told = told;
    const taking = told.state === "taking";
    const busy = taking || told.state === "computing";
    byId("board-card").hidden = busy;
    board.hidden = told.state === "done";
    byId("board-title").textContent = board.hidden ? "Camera" : "Board";
    byId("calibrate-start").textContent = told.state === "failed" ? "Start again" : "Start";
    byId("calibrate-finish").hidden = !taking || told.frames.taken < told.frames.fewest;
    byId("calibrate-file").hidden = told.state !== "done";
    byId("calibrate-drop").hidden = told.state === "none" || told.state === "failed";
    byId("calibrate-drop").textContent = told.state === "done" ? "Calibrate again" : "Cancel";
    const [headline, sentence, reason] = words(told);
    answer.rename(headline, sentence, reason);
    coverage(told);
    result(told.result);
  }
}

function words(told) {
  const { state, verdict, frames, next, problem, result: found } = told;
  if (state === "none") {
    return ["Calibrate this camera", "Print the board at 100 %, glue it to something flat, and start.", "none"];
  }
  if (state === "computing") return ["Computing …", `From ${frames.taken} images of the board.`, "taking"];
  if (state === "failed") return ["No camera came of it", asSentence(problem), "failed"];
  if (state === "done") {
    return [
      `Calibrated to ${found.rms_px.toFixed(2)} px`,
      `Field of view ${found.hfov_deg.toFixed(1)}° x ${found.vfov_deg.toFixed(1)}°. `
        + (found.doubts.length ? "Take it with care: see below." : "Start the server with this file as --camera."),
      found.doubts.length ? "unsure" : "done",
    ];
  }
  const taken = verdict === "taken";
  return [asSentence(next || "Enough").replace(/\.$/, ""), asSentence(problem || verdict), taken ? "taken" : "taking"];
}

function coverage({ frames, zones, tilts, distances }) {
  const { columns, rows } = zones || { columns: 4, rows: 3 };
  const covered = new Set(zones?.covered);
  const [width, height] = [FIELD.width / columns, FIELD.height / rows];
  const drawn = [];
  for (let zone = 0; zone < columns * rows; zone += 1) {
    const [x, y] = [(zone % columns) * width, Math.floor(zone / columns) * height];
    drawn.push(shape("rect", { x, y, width, height, class: covered.has(zone) ? "covered" : "" }));
    // A second sign besides the colour.
    if (covered.has(zone)) drawn.push(shape("path", { d: path([[x + 34, y + 52], [x + 46, y + 64], [x + 68, y + 38]], false) }));
  }
  byId("coverage-zones").setAttribute("viewBox", `0 0 ${FIELD.width} ${FIELD.height}`);
  byId("coverage-zones").replaceChildren(...drawn);
  byId("coverage-frames").textContent = frames ? `${frames.taken} of ${frames.wanted} images` : "–";
  byId("zones-said").textContent = `${covered.size} of ${columns * rows}`;
  const lacking = tilts ? TILTS.filter((side) => !tilts[side]) : TILTS;
  byId("tilts-said").textContent = lacking.length ? `${lacking.join(", ")} missing` : "all four";
  byId("distances-said").textContent = distances
    ? `x${distances.spread.toFixed(1)} of x${distances.wanted}` : "–";
}

function result(found) {
  byId("calibrated").hidden = byId("doubts").hidden = !found;
  if (!found) return;
  const facts = {
    Error: `${found.rms_px.toFixed(3)} px`,
    Images: found.frames,
    "Field of view": `${found.hfov_deg.toFixed(1)}° x ${found.vfov_deg.toFixed(1)}°`,
    "Lens model": found.model,
    "Focal length": `${found.fx.toFixed(1)}, ${found.fy.toFixed(1)} px`,
    "Image covered": `${Math.round(100 * found.coverage)} %`,
  };
  byId("calibrated").replaceChildren(...Object.entries(facts).map(([label, value]) => {
    const fact = Object.assign(document.createElement("div"), { className: "fact" });
    fact.append(
      Object.assign(document.createElement("dt"), { textContent: label }),
      Object.assign(document.createElement("dd"), { textContent: value }),
    );
    return fact;
  }));
  byId("doubts").replaceChildren(...found.doubts.map((doubt) =>
    Object.assign(document.createElement("li"), { textContent: asSentence(doubt) })));
}

function marks(told, photo) {
  const svg = byId("marks");
  stage.clear();
  if (!told?.zones) return;
  const { naturalWidth: width, naturalHeight: height } = photo;
  const { columns, rows } = told.zones;
  svg.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  svg.setAttribute("preserveAspectRatio", "none");
  const [w, h] = [width / columns, height / rows];
  for (let zone = 0; zone < columns * rows; zone += 1) {
    const covered = told.zones.covered.includes(zone) ? " covered" : "";
    svg.append(shape("rect", {
      x: (zone % columns) * w - 0.5, y: Math.floor(zone / columns) * h - 0.5, width: w, height: h, class: `c-zone${covered}`,
    }));
  }
  if (told.seen) {
    for (const kind of [" case", ""]) svg.append(shape("path", { class: `c-seen${kind}`, d: path(told.seen) }));
  }
}
