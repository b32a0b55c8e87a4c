// The server's own source: decisions as events, each with the image it was made on.
import * as api from "./api.js";
import { why } from "./words.js";

const AGAIN_MS = 2000;
const DEAF_MS = 10_000; // a connection that is cut in silence raises no error

export class Source {
  constructor({ decision, state, problem }) {
    this.heard = { decision, state, problem };
    this.events = null;
    this.newest = null;
    this.busy = false;
    this.paused = false;
    this.running = false;
    this.last = 0;
    this.connection = 0; // counts up once one is lost: what was under way is void then
    setInterval(() => this.revive(), AGAIN_MS);
  }

  start() {
    if (this.events) return;
    this.events = new EventSource("/v1/stream?view=true&max_hz=15");
    this.last = performance.now();
    this.events.addEventListener("decision", (event) => {
      this.last = performance.now();
      this.newest = JSON.parse(event.data);
      this.next();
    });
    this.events.addEventListener("source", (event) => {
      const state = JSON.parse(event.data);
      this.running = state.state === "running";
      this.heard.state(state);
    });
    this.events.addEventListener("error", () => this.failed());
  }

  // A browser tries again by itself after a lost connection, but not after a refusal, and does not
  // say why: another route does.
  async failed() {
    this.newest = null;
    this.connection += 1;
    this.heard.problem("The server does not answer; trying again.");
    if (this.events?.readyState !== EventSource.CLOSED) return;
    this.stop();
    this.timer = setTimeout(() => this.start(), AGAIN_MS);
    try {
      await api.info();
      this.heard.problem("Too many pages follow this source; trying again.");
    } catch (error) {
      this.heard.problem(why(error));
    }
  }

  revive() {
    if (!this.events || !this.running || performance.now() - this.last < DEAF_MS) return;
    this.stop();
    this.start();
  }

  stop() {
    clearTimeout(this.timer);
    this.events?.close();
    this.events = null;
    this.newest = null;
    this.connection += 1;
  }

  // One image at a time; what came in between is passed over.
  async next() {
    if (this.busy || this.paused || document.hidden || !this.newest || !this.events) return;
    this.busy = true;
    const { connection, newest: decision } = this;
    const wanted = () => connection === this.connection && !this.paused;
    this.newest = null;
    try {
      const blob = await api.frame("plain", decision.frame);
      if (wanted()) await this.heard.decision(decision, blob, wanted);
    } catch (error) {
      // An image that is gone already: a newer one is on its way.
      if (wanted() && error.code !== "frame_gone") {
        this.heard.problem(why(error));
        await new Promise((done) => setTimeout(done, 1000 * (error.retryAfterS || 1)));
      }
    } finally {
      this.busy = false;
    }
    this.next();
  }
}
