// How to decide: the form, and the fields that it stands for.
import { byId } from "./svg.js";

const OWN = "";
const ANGLE = "fov";
const form = byId("settings");

function fill(select, choices) {
  select.replaceChildren(...choices.map(([value, words]) => new Option(words, value)));
}

export function prepare(info, changed) {
  const methods = { opening: "Opening", paper: "Paper (2020)" };
  fill(form.method, info.methods.map((name) => [name, methods[name] || name]));
  fill(form.network, info.networks.map(({ name }) => [name, name.split("/").at(-1)]));
  fill(form.camera, [
    ...(info.camera_given ? [[OWN, "The server's camera"]] : []),
    ["auto", "From the image, else 60.9°"],
    ...info.cameras.map((c) => [c.name, `${c.name} (${c.hfov_deg.toFixed(1)}°)`]),
    [ANGLE, "By field of view"],
  ]);
  const back = () => {
    form.method.value = info.method;
    form.network.value = info.network;
    form.camera.value = info.camera_given ? OWN : "auto";
    update();
  };
  const update = () => {
    byId("fov-label").hidden = form.camera.value !== ANGLE;
    const able = info.networks.find(({ name }) => name === form.network.value)?.methods || [];
    for (const option of form.method.options) option.disabled = !able.includes(option.value);
    if (form.method.selectedOptions[0]?.disabled && able.length) [form.method.value] = able;
    byId("settings-now").textContent = [form.method, form.network, form.camera]
      .map((select) => select.selectedOptions[0]?.textContent || "")
      .join(" · ");
  };
  let timer = 0;
  const changedSoon = () => {
    update();
    clearTimeout(timer);
    timer = setTimeout(() => {
      problem(form.checkValidity() ? "" : "A number is out of range.");
      if (form.checkValidity()) changed(fields());
    }, 250);
  };
  form.addEventListener("input", changedSoon);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => { back(); changedSoon(); }));
  back();
}

export function fields() {
  const found = { method: form.method.value, network: form.network.value };
  if (form.camera.value === ANGLE) found.fov_deg = form.fov_deg.valueAsNumber;
  else if (form.camera.value !== OWN) found.camera = form.camera.value;
  for (const name of ["height_m", "pitch_deg", "roll_deg", "width_m", "max_unseen_m"]) {
    if (form[name].value !== "") found[name] = form[name].valueAsNumber;
  }
  return found;
}

export function problem(words) {
  byId("settings-problem").hidden = !words;
  byId("settings-problem").textContent = words;
}
