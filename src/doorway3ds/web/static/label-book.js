// The images that were looked at, their marks, and their way to the server: one change at a time
// for each image, again and again until it is written.
import { ask } from "./api.js";

const AGAIN_MS = 2000;
const json = async (url, options) => (await ask(url, options)).json();

export const folder = () => json("/v1/folder");
export const unmarkedAfter = async (number) => (await json(`/v1/unmarked?after=${number}`)).number;

export class Book {
  // changed(entry): what the page should show of an image has changed.
  constructor(changed) {
    this.changed = changed;
    this.entries = new Map();
    this.done = [];
    this.undone = [];
    this.marked = 0;
  }

  // Fresh from the server, unless a change of ours is still on its way or was made meanwhile.
  async open(number) {
    const before = this.entries.get(number);
    if (before && this.unsaved(before)) return before;
    const revision = before?.revision;
    const fresh = await json(`/v1/pictures/${number}`);
    const known = this.entries.get(number) ?? {};
    if (known.revision === revision && !this.unsaved(known)) {
      // What was done to rows that somebody else has changed since cannot be undone.
      if (before && fresh.revision !== revision) this.forget(number);
      Object.assign(known, fresh, { written: fresh.marks, trouble: "", saving: false });
    }
    this.entries.set(number, known);
    return known;
  }

  unsaved(entry) {
    return entry.saving || entry.marks !== entry.written;
  }

  get pending() {
    return [...this.entries.values()].some((entry) => this.unsaved(entry));
  }

  forget(number) {
    this.done = this.done.filter((step) => step.number !== number);
    this.undone = this.undone.filter((step) => step.number !== number);
  }

  // marks null: not marked.
  change(entry, marks) {
    if (JSON.stringify(marks) === JSON.stringify(entry.marks)) return;
    this.done.push({ number: entry.number, before: entry.marks, after: marks });
    this.undone = [];
    this.set(entry, marks);
  }

  set(entry, marks) {
    entry.marks = marks;
    this.save(entry);
  }

  async save(entry) {
    clearTimeout(entry.again);
    if (entry.saving) return;
    entry.saving = true;
    entry.trouble = "";
    this.changed(entry);
    while (entry.marks !== entry.written && !entry.trouble) await this.send(entry);
    entry.saving = false;
    this.changed(entry);
  }

  async send(entry) {
    const marks = entry.marks;
    try {
      const answer = await json(`/v1/pictures/${entry.number}`, {
        method: "PUT",
        body: JSON.stringify({ marks, revision: entry.revision }),
        headers: { "Content-Type": "application/json" },
      });
      entry.revision = answer.revision;
      entry.written = marks;
      this.marked = answer.marked;
    } catch (error) {
      if (error.status === 409) await this.yieldTo(entry, marks);
      else this.keepTrying(entry, error);
    }
  }

  // Somebody else was first: theirs is shown, and redo puts ours in its place.
  async yieldTo(entry, ours) {
    let theirs;
    try {
      theirs = await json(`/v1/pictures/${entry.number}`);
    } catch (error) {
      this.keepTrying(entry, error);
      return;
    }
    this.forget(entry.number);
    this.undone = [{ number: entry.number, before: theirs.marks, after: ours }];
    Object.assign(entry, { marks: theirs.marks, written: theirs.marks, revision: theirs.revision });
    entry.conflict = "Somebody else marked this image meanwhile. Theirs is shown; Redo puts yours in its place.";
  }

  keepTrying(entry, error) {
    entry.trouble = error.message;
    const passes = error.status === 0 || error.status === 408 || error.status === 429 || error.status >= 500;
    if (passes) entry.again = setTimeout(() => this.save(entry), AGAIN_MS);
  }

  // The image whose last change is taken back or made again, with its new marks; null: none.
  async step(from, to, side) {
    const last = this[from].at(-1);
    if (!last) return null;
    const entry = await this.open(last.number);
    if (this[from].at(-1) !== last) {
      entry.conflict = "Somebody else has marked this image since. Theirs is shown.";
      return entry;
    }
    this[from].pop();
    this[to].push(last);
    this.set(entry, last[side]);
    return entry;
  }

  undo() {
    return this.step("done", "undone", "before");
  }

  redo() {
    return this.step("undone", "done", "after");
  }
}
