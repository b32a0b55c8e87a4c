// Puts the page together: what is looked at, and what happens with each decision.
import * as answer from "./answer.js";
import * as api from "./api.js";
import { Calibrate } from "./calibrate.js";
import { Camera } from "./camera.js";
import { prepareShare, prepareTheme } from "./chrome.js";
import * as dial from "./dial.js";
import { chosen, prepareExamples, prepareFiles } from "./files.js";
import { Watch } from "./fresh.js";
import * as history from "./history.js";
import { saveJson, savePicture } from "./save.js";
import * as settings from "./settings.js";
import { Source } from "./source.js";
import * as stage from "./stage.js";
import { byId } from "./svg.js";
import { asSentence, shortened, why } from "./words.js";

const NOTE_MS = 8000;
const NO_IMAGE = { bad_image: true, no_image: true, too_large: true, unreadable: true };
const DECIDING_MS = 300; // before an image on its way takes the place of the last answer
const video = byId("video");
const camera = new Camera(video);
const source = new Source({ decision: showFrame, state: showState, problem: lose });
const calibrate = new Calibrate();
const watch = new Watch((reason) => lose(reason === "asleep" ? "This page was asleep." : silenceOf()));
const now = { mode: "", frame: null, info: null, picture: null, request: null, source: null, paused: false };
const pace = { last: 0, mean: 0 };
const modes = byId("modes");
const welcome = {
  picture: ["Drop an image of a room here, paste one, or choose a file.", "Choose an image", "JPEG, PNG, WebP, TIFF or BMP. A photograph's EXIF focal length is used."],
  camera: ["Walk your phone or laptop through the room: it becomes the robot.", "Start the camera", "Images go to this server only and are not kept."],
  source: ["Waiting for the first image of the source.", "", ""],
  calibrate: ["Waiting for the first image of the source.", "", ""],
};

let noteTimer = 0;
function note(words, bad = true) {
  clearTimeout(noteTimer);
  byId("note").hidden = !words;
  byId("note").textContent = words || "";
  byId("note").toggleAttribute("data-bad", Boolean(words) && bad);
  if (words) noteTimer = setTimeout(note, NOTE_MS);
}

// What the save buttons save: the frame in sight, with the settings that it was decided by.
function keep(frame) {
  now.frame = frame;
  byId("save-json").disabled = !frame;
  byId("save-picture").disabled = !frame;
  byId("pause").disabled = !frame && !now.paused;
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
  byId("examples").hidden = now.mode !== "picture";
  byId("photo").hidden = true;
  byId("origin").hidden = true;
  video.hidden = true;
  history.clear();
  hush();
}

// Nothing on the page is an order any more.
function hush() {
  watch.rest();
  byId("pace").hidden = true;
  pace.mean = 0;
  stage.clear();
  dial.draw(null);
  history.rest();
  keep(null);
}

function lose(words, headline = "No answer") {
  if (now.paused) return;
  document.body.dataset.stale = "";
  hush();
  answer.reset(headline, words, "silent");
}

function silenceOf() {
  if (now.mode === "source" && now.source?.problem) return asSentence(now.source.problem);
  return "Nothing new has come; what was seen last is out of date.";
}

// Image, marks, answer and dial change in one paint: nothing is waited for in between.
async function show(decision, frame, stillWanted, belief = decision.p_open) {
  const photo = await stage.photo(frame.blob);
  if (!stillWanted() || now.paused) return false;
  delete document.body.dataset.stale;
  byId("welcome").hidden = true;
  stage.fit(decision.view.width, decision.view.height);
  stage.put(photo);
  answer.show(decision, belief);
  dial.draw(decision);
  stage.draw(decision);
  history.add(belief);
  origin(frame.name);
  keep({ ...frame, decision });
  return true;
}

function origin(name) {
  const words = now.mode === "source" ? now.info.source.name : now.mode === "camera" ? "This camera" : name;
  byId("origin").hidden = false;
  byId("origin").title = words;
  byId("origin").textContent = words.includes("://") ? words : words.split("/").at(-1);
}

function tick(decision) {
  const at = performance.now();
  const gap = at - pace.last;
  pace.last = at;
  watch.seen();
  if (gap > 3000) { pace.mean = 0; return; }
  pace.mean = pace.mean ? 0.85 * pace.mean + 0.15 * gap : gap;
  const spent = Object.values(decision.timings_ms).reduce((sum, ms) => sum + ms, 0);
  byId("pace").hidden = false;
  byId("pace").textContent = `${(1000 / pace.mean).toFixed(1)} a second · ${spent.toFixed(0)} ms each`;
}

// --- An image

async function decideOn(blob, name, remark = "") {
  now.request?.abort();
  const request = (now.request = new AbortController());
  const fields = settings.fields();
  const again = blob === now.picture?.blob;
  now.picture = { blob, name };
  note("");
  const waiting = setTimeout(() => lose(shortened(name), "Deciding …"), DECIDING_MS);
  try {
    const decision = await api.decide(blob, { ...fields, name: name.slice(0, 255) }, request.signal);
    history.clear();
    await show(decision, { blob, name, fields }, () => now.request === request);
    note(remark, false);
  } catch (error) {
    if (now.request !== request) return;
    if (!again) empty();
    if (NO_IMAGE[error.code]) now.picture = null;
    lose(why(error, name));
  } finally {
    clearTimeout(waiting);
  }
}

function take(files) {
  if (!files?.length) return;
  const { file, remark, problem } = chosen([...files]);
  if (!file) {
    if (now.mode !== "picture") { note(problem); return; }
    forget();
    empty();
    lose(problem);
    return;
  }
  setMode("picture");
  decideOn(file, file.name || "pasted", remark);
}

function forget() {
  now.request?.abort();
  now.request = now.picture = null;
}

// --- The browser's camera

async function startCamera(start = () => camera.start()) {
  try {
    await start();
  } catch (error) {
    camera.stop();
    empty();
    const reasons = {
      NotAllowedError: "The browser was not allowed to use the camera.",
      NotFoundError: "This device has no camera.",
      NotReadableError: "Another program is using the camera.",
    };
    lose(reasons[error.name] || `The camera did not start: ${error.message}`);
    buttons();
    return;
  }
  video.hidden = false;
  byId("photo").hidden = true;
  byId("welcome").hidden = true;
  delete byId("stage").dataset.empty;
  buttons();
  byId("switch").hidden = !(await camera.several());
  const wanted = () => now.mode === "camera" && camera.running && !document.hidden;
  await camera.follow(async (blob) => {
    const fields = settings.fields();
    try {
      const decision = await api.decide(blob, { ...fields, name: "camera.jpg" });
      if (await show(decision, { blob, name: "camera", fields }, wanted)) tick(decision);
      return 0;
    } catch (error) {
      if (wanted()) lose(why(error));
      return 1000 * (error.retryAfterS || 1);
    }
  });
  if (now.mode === "camera" && !camera.running) lose("The camera is off.", "Stopped");
  buttons();
}

// --- The server's source

async function showFrame(decision, blob, stillWanted) {
  // What is remembered from frame to frame outranks what this one alone would say.
  const { belief, ...tracked } = decision.tracked;
  const frame = { blob, name: `frame-${decision.frame}`, number: decision.frame, told: decision };
  const wanted = () => stillWanted() && !document.hidden && !GONE[now.source?.state];
  if (await show({ ...decision, ...tracked }, frame, wanted, belief)) tick(decision);
}

const GONE = { ended: "Ended", lost: "No answer", stopped: "No answer" };

function showState(state) {
  now.source = state;
  byId("warning").hidden = !state.warning;
  byId("warning").textContent = asSentence(state.warning);
  const headline = GONE[state.state];
  if (headline) lose(state.state === "ended" ? "The source has ended." : silenceOf(), headline);
  else if (state.state === "waiting" && !now.frame) lose(silenceOf());
}

// --- What is looked at

function setMode(mode) {
  if (now.mode === mode) return;
  now.mode = mode;
  document.body.dataset.mode = mode;
  modes.querySelector(`[value="${mode}"]`).checked = true;
  camera.stop();
  source.stop();
  calibrate.stop();
  forget();
  resume();
  note("");
  byId("warning").hidden = true;
  delete document.body.dataset.stale;
  answer.reset("Ready", welcome[mode][0]);
  empty();
  buttons();
  if (mode === "source") source.start();
  if (mode === "calibrate") calibrate.start();
}

function buttons() {
  byId("choose").hidden = now.mode !== "picture";
  byId("pause").hidden = now.mode !== "source" && !(now.mode === "camera" && camera.running);
  byId("pause").textContent = now.paused ? "Resume" : "Pause";
  byId("toggle").hidden = now.mode !== "camera" || Boolean(Camera.problem());
  byId("toggle").textContent = camera.running ? "Stop" : "Start the camera";
  if (!camera.running) byId("switch").hidden = true;
}

// Holds one frame, so that both files saved are of it; it is a record then, not an order.
function pause() {
  const { decision, number } = now.frame;
  now.paused = camera.paused = source.paused = true;
  watch.rest();
  byId("pace").hidden = true;
  document.body.dataset.paused = "";
  answer.rename("Paused", `This frame: ${decision.view.headline}. ${decision.view.sentence}`, "paused");
  // The server keeps a frame's image only for a moment.
  if (number !== undefined) now.frame.page = api.frame("page", number).catch(() => null);
  buttons();
}

function resume() {
  if (!now.paused) return;
  now.paused = camera.paused = source.paused = false;
  delete document.body.dataset.paused;
  lose("Waiting for the next image.");
  if (now.mode === "source" && GONE[now.source?.state]) showState(now.source);
  buttons();
}

function toggleCamera() {
  if (camera.running) {
    resume();
    camera.stop();
    lose("The camera is off.", "Stopped");
    buttons();
  } else {
    startCamera();
  }
}

// --- What people do

modes.addEventListener("change", (event) => setMode(event.target.value));
byId("welcome-button").addEventListener("click", () =>
  (now.mode === "camera" ? startCamera() : byId("file").click()));
byId("toggle").addEventListener("click", toggleCamera);
byId("switch").addEventListener("click", () => startCamera(() => camera.turnAround()));
byId("pause").addEventListener("click", () => (now.paused ? resume() : pause()));
byId("save-json").addEventListener("click", () => saveJson(now.frame));
byId("save-picture").addEventListener("click", () => savePicture(now.frame).catch((error) => note(why(error))));
document.addEventListener("visibilitychange", () => document.hidden || source.next());

async function changed(fields) {
  try {
    if (now.mode === "source") await api.changeSource(numbers(fields));
    else if (now.picture) await decideOn(now.picture.blob, now.picture.name);
    settings.problem("");
  } catch (error) {
    settings.problem(why(error));
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
    lose(why(error));
    return;
  }
  settings.prepare(now.info, changed);
  prepareShare(now.info.link);
  prepareFiles(take);
  prepareExamples(take);
  byId("version").textContent = `doorway3ds ${now.info.version}`;
  if (now.info.source) {
    byId("mode-source").hidden = false;
    byId("mode-source").title = now.info.source.name;
    byId("mode-calibrate").hidden = false;
  }
  setMode(!now.info.source ? "picture" : now.info.calibrating ? "calibrate" : "source");
}

begin();
