// Puts the page together: what is looked at, and what happens with each decision.
import * as answer from "./answer.js";
import * as api from "./api.js";
import { Camera } from "./camera.js";
import * as dial from "./dial.js";
import * as history from "./history.js";
import * as settings from "./settings.js";
import { Source } from "./source.js";
import * as stage from "./stage.js";
import { byId } from "./svg.js";
import { prepareShare, prepareTheme } from "./chrome.js";

const photo = byId("photo");
const video = byId("video");
const camera = new Camera(video);
const source = new Source({ decision: showFrame, state: showState, problem: note });
const now = { mode: "picture", blob: null, name: "picture", decision: null, info: null, request: null };
const pace = { last: 0, mean: 0 };

const modes = byId("modes");
const welcome = {
  picture: ["Drop a picture of a room here, paste one, or choose a file.", "Choose a picture", "JPEG, PNG, WebP, TIFF or BMP. A photograph's EXIF focal length is used."],
  camera: ["Walk your phone or laptop through the room: it becomes the robot.", "Start the camera", "Pictures go to this server alone, are decided on and forgotten."],
  source: ["Waiting for the first picture of the source.", "", ""],
};

function note(words, bad = true) {
  byId("note").hidden = !words;
  byId("note").textContent = words || "";
  byId("note").toggleAttribute("data-bad", Boolean(words) && bad);
}

function empty() {
  const [words, button, fine] = welcome[now.mode];
  const problem = now.mode === "camera" ? Camera.problem() : "";
  byId("stage").dataset.empty = "";
  byId("welcome").hidden = false;
  byId("welcome-text").textContent = problem || words;
  byId("welcome-button").textContent = button;
  byId("welcome-button").hidden = !button || Boolean(problem);
  byId("welcome-fine").textContent = problem ? "" : fine;
  photo.hidden = true;
  video.hidden = true;
  byId("pace").hidden = true;
  stage.clear();
  dial.draw(null);
  history.clear();
  keep(null, null);
}

// What the save buttons save.
function keep(decision, blob) {
  now.decision = decision;
  now.blob = blob;
  byId("save-json").disabled = !decision;
  byId("save-picture").disabled = !decision;
}

function show(decision, belief = decision.p_open) {
  byId("welcome").hidden = true;
  stage.fit(decision.view.width, decision.view.height);
  answer.show(decision, belief);
  dial.draw(decision);
  stage.draw(decision);
  history.add(belief);
}

function showPhoto(blob) {
  const url = URL.createObjectURL(blob);
  const old = photo.src;
  photo.src = url;
  photo.hidden = false;
  if (old.startsWith("blob:")) URL.revokeObjectURL(old);
  return photo.decode().catch(() => {});
}

function tick(decision) {
  const at = performance.now();
  const gap = at - pace.last;
  pace.last = at;
  if (gap > 3000) { pace.mean = 0; return; }
  pace.mean = pace.mean ? 0.85 * pace.mean + 0.15 * gap : gap;
  const spent = Object.values(decision.timings_ms).reduce((sum, ms) => sum + ms, 0);
  byId("pace").hidden = false;
  byId("pace").textContent = `${(1000 / pace.mean).toFixed(1)} a second · ${spent.toFixed(0)} ms each`;
}

// --- A picture

async function decideOn(blob, name) {
  now.request?.abort();
  now.request = new AbortController();
  note("Deciding …", false);
  byId("welcome").hidden = true;
  try {
    const decision = await api.decide(blob, { ...settings.fields(), name: name.slice(0, 255) }, now.request.signal);
    await showPhoto(blob);
    if (now.mode !== "picture") return;
    now.name = name;
    keep(decision, blob);
    history.clear();
    show(decision);
    note("");
  } catch (error) {
    if (error.name === "AbortError") return;
    if (!now.decision) empty();
    note(error.message);
  }
}

function take(file) {
  if (!file) return;
  setMode("picture");
  decideOn(file, file.name || "pasted");
}

// --- The browser's camera

async function startCamera(start = () => camera.start()) {
  try {
    await start();
  } catch (error) {
    camera.stop();
    empty();
    const reasons = { NotAllowedError: "The camera was not allowed.", NotFoundError: "There is no camera." };
    note(reasons[error.name] || `The camera did not start: ${error.message}`);
    return;
  }
  note("");
  video.hidden = false;
  photo.hidden = true;
  buttons();
  byId("switch").hidden = !(await camera.several());
  await camera.follow(async (blob) => {
    try {
      const decision = await api.decide(blob, { ...settings.fields(), name: "camera.jpg" });
      if (now.mode !== "camera" || !camera.running) return 0;
      now.name = "camera";
      keep(decision, blob);
      show(decision);
      tick(decision);
      note("");
      return 0;
    } catch (error) {
      note(error.message);
      return 1000 * (error.retryAfterS || 1);
    }
  });
  buttons();
}

// --- The server's source

async function showFrame(decision, blob) {
  await showPhoto(blob);
  if (now.mode !== "source") return;
  now.name = `frame-${decision.frame}`;
  keep(decision, blob);
  // What is remembered from frame to frame outranks what this one alone would say.
  const { belief, ...tracked } = decision.tracked;
  show({ ...decision, ...tracked }, belief);
  tick(decision);
}

function showState(state) {
  const words = { ended: "The source has ended.", lost: state.problem, waiting: state.problem };
  note(words[state.state] || "", state.state !== "ended");
  if (state.state !== "running") byId("pace").hidden = true;
}

// --- What is looked at

function setMode(mode) {
  if (now.mode === mode) return;
  now.mode = mode;
  document.body.dataset.mode = mode;
  modes.querySelector(`[value="${mode}"]`).checked = true;
  camera.stop();
  source.stop();
  now.request?.abort();
  note("");
  answer.reset("Ready", welcome[mode][0]);
  empty();
  buttons();
  if (mode === "source") source.start();
}

function buttons() {
  byId("choose").hidden = now.mode !== "picture";
  byId("toggle").hidden = now.mode !== "camera" || Boolean(Camera.problem());
  byId("toggle").textContent = camera.running ? "Stop" : "Start the camera";
  if (!camera.running) byId("switch").hidden = true;
}

function toggleCamera() {
  if (camera.running) {
    camera.stop();
    // The last picture stays, with what was said of it.
    if (now.blob) showPhoto(now.blob).then(() => { video.hidden = true; });
    byId("pace").hidden = true;
    buttons();
  } else {
    startCamera();
  }
}

// --- Saving

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const stem = () => now.name.replace(/\.[^.]*$/, "") || "picture";

function saveJson() {
  const { view, ...decision } = now.decision;
  save(new Blob([JSON.stringify(decision, null, 2)], { type: "application/json" }), `${stem()}_3ds.json`);
}

async function savePicture() {
  const { blob, decision } = now;
  try {
    const page = now.mode === "source"
      ? await api.frame("page", decision.frame)
      : await api.annotate(blob, settings.fields());
    save(page, `${stem()}_3ds.jpg`);
  } catch (error) {
    note(error.message);
  }
}

// --- What people do

modes.addEventListener("change", (event) => setMode(event.target.value));
byId("choose").addEventListener("click", () => byId("file").click());
byId("file").addEventListener("change", (event) => {
  take(event.target.files[0]);
  event.target.value = "";
});
byId("welcome-button").addEventListener("click", () =>
  (now.mode === "camera" ? startCamera() : byId("file").click()));
byId("toggle").addEventListener("click", toggleCamera);
byId("switch").addEventListener("click", () => startCamera(() => camera.turnAround()));
byId("save-json").addEventListener("click", saveJson);
byId("save-picture").addEventListener("click", savePicture);

const pictureOf = (transfer) => [...(transfer?.files || [])].find((f) => f.type.startsWith("image/"));
document.addEventListener("paste", (event) => take(pictureOf(event.clipboardData)));
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  byId("stage").classList.add("dragging");
});
document.addEventListener("dragleave", (event) => {
  if (!event.relatedTarget) byId("stage").classList.remove("dragging");
});
document.addEventListener("drop", (event) => {
  event.preventDefault();
  byId("stage").classList.remove("dragging");
  const file = pictureOf(event.dataTransfer);
  if (file) take(file);
  else note("That is no picture.");
});

async function changed(fields) {
  try {
    if (now.mode === "source") await api.changeSource(numbers(fields));
    else if (now.mode === "picture" && now.blob) await decideOn(now.blob, now.name);
    settings.problem("");
  } catch (error) {
    settings.problem(error.message);
  }
}

const numbers = (fields) => Object.fromEntries(Object.entries(fields).map(([name, value]) =>
  [name, /_(deg|m)$/.test(name) ? Number(value) : value]));

async function begin() {
  prepareTheme();
  answer.reset("Ready", welcome.picture[0]);
  try {
    now.info = await api.info();
  } catch (error) {
    note(error.message);
    return;
  }
  settings.prepare(now.info, changed);
  prepareShare(now.info.link);
  byId("version").textContent = `doorway3ds ${now.info.version}`;
  now.mode = "";
  if (now.info.source) {
    byId("mode-source").hidden = false;
    byId("mode-source").title = now.info.source.name;
  }
  setMode(now.info.source ? "source" : "picture");
}

begin();
