// Watches that what the page says is fresh: an order that nobody stands behind any more is worse
// than none.
const LIMIT_MS = 1500;
const LOOK_MS = 200;

export class Watch {
  // silent: called once when nothing new has come for too long, or the page itself was asleep.
  constructor(silent) {
    this.silent = silent;
    this.since = null;
    setInterval(() => this.look(), LOOK_MS);
    document.addEventListener("visibilitychange", () => this.slept());
    window.addEventListener("pageshow", (event) => event.persisted && this.slept());
  }

  seen() {
    // One of them stands still while the machine sleeps, the other jumps when it is set.
    this.since = [performance.now(), Date.now()];
  }

  rest() {
    this.since = null;
  }

  look() {
    if (!this.since) return;
    const age = Math.max(performance.now() - this.since[0], Date.now() - this.since[1]);
    if (age > LIMIT_MS) this.give("nothing");
  }

  slept() {
    if (this.since) this.give("asleep");
  }

  give(reason) {
    this.rest();
    this.silent(reason);
  }
}
