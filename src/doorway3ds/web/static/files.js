// Images given to the page: dropped, pasted, chosen from a file, or one of its own examples.
import { byId } from "./svg.js";
import { shortened } from "./words.js";

// A file whose kind the browser does not know may be an image all the same: the server says.
export const isPicture = (file) => file.type.startsWith("image/");
const mayBePicture = (file) => isPicture(file) || !file.type;

// The one file to look at, and what to say of the others.
export function chosen(files) {
  const file = files.find(isPicture) || files.find(mayBePicture);
  if (!file) {
    const problem = files.length === 1
      ? `${shortened(files[0].name)} is not an image.`
      : `None of these ${files.length} files is an image.`;
    return { problem };
  }
  const remark = files.length > 1
    ? `${files.length} files came; only ${shortened(file.name)} is looked at.`
    : "";
  return { file, remark };
}

export function prepareFiles(take) {
  byId("choose").addEventListener("click", () => byId("file").click());
  byId("file").addEventListener("change", (event) => {
    take([...event.target.files]);
    event.target.value = "";
  });
  document.addEventListener("paste", (event) => take(event.clipboardData?.files));
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
    take(event.dataTransfer?.files);
  });
}

export function prepareExamples(take) {
  for (const button of byId("examples").querySelectorAll("button")) {
    button.addEventListener("click", async () => {
      const { src } = button.querySelector("img");
      const blob = await (await fetch(src)).blob();
      take([new File([blob], src.split("/").at(-1), { type: blob.type })]);
    });
  }
}
