// The server's own source: decisions as events, each with the picture it was made on.
import * as api from "./api.js";

export class Source {
  constructor({ decision, state, problem }) {
    this.heard = { decision, state, problem };
    this.events = null;
    this.newest = null;
    this.busy = false;
  }

  start() {
    if (this.events) return;
    this.events = new EventSource("/v1/stream?view=true&max_hz=15");
    this.events.addEventListener("decision", (event) => {
      this.newest = JSON.parse(event.data);
      this.next();
    });
    this.events.addEventListener("source", (event) => this.heard.state(JSON.parse(event.data)));
    this.events.addEventListener("error", () => this.failed());
    this.events.addEventListener("open", () => this.heard.problem(""));
  }

  // A browser tries again by itself after a lost connection, but not after a refusal.
  failed() {
    this.heard.problem("The server does not send; trying again.");
    if (this.events?.readyState !== EventSource.CLOSED) return;
    this.stop();
    this.timer = setTimeout(() => this.start(), 5000);
  }

  stop() {
    clearTimeout(this.timer);
    this.events?.close();
    this.events = null;
    this.newest = null;
  }

  // One picture at a time; what came in between is passed over.
  async next() {
    if (this.busy || !this.newest || !this.events) return;
    this.busy = true;
    const decision = this.newest;
    this.newest = null;
    try {
      const blob = await api.frame("plain", decision.frame);
      if (this.events) await this.heard.decision(decision, blob);
    } catch (error) {
      this.heard.problem(error.message);
      await new Promise((done) => setTimeout(done, 1000 * (error.retryAfterS || 1)));
    } finally {
      this.busy = false;
    }
    this.next();
  }
}
