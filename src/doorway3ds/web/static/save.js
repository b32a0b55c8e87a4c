// The two files of one frame: what was decided, and the annotated image.
import * as api from "./api.js";

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const stem = (frame) => frame.name.replace(/\.[^.]*$/, "") || "image";

export function saveJson(frame) {
  const { view, ...decision } = frame.told || frame.decision;
  save(new Blob([JSON.stringify(decision, null, 2)], { type: "application/json" }), `${stem(frame)}_3ds.json`);
}

export async function savePicture(frame) {
  const page = frame.number === undefined
    ? await api.annotate(frame.blob, frame.fields)
    : (await frame.page) || (await api.frame("page", frame.number));
  save(page, `${stem(frame)}_3ds.jpg`);
}
