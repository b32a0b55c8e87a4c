// The browser's own camera: its image is shown at its own pace, decisions follow as they come.
const LONGER_SIDE = 640;
const EVERY_MS = 100;
const IDLE_MS = 200;

export class Camera {
  constructor(video) {
    this.video = video;
    this.stream = null;
    this.paused = false;
    this.facing = "environment";
    this.canvas = document.createElement("canvas");
  }

  static problem() {
    if (!window.isSecureContext) {
      return "Browsers lend a camera only to https:// and to localhost. Start the server with --tls and open its https:// link.";
    }
    return navigator.mediaDevices?.getUserMedia ? "" : "This browser gives pages no camera.";
  }

  get running() {
    return this.stream !== null;
  }

  async start() {
    this.stop();
    const wanted = { facingMode: { ideal: this.facing }, width: { ideal: 1280 }, height: { ideal: 720 } };
    const stream = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    this.stream = stream;
    this.video.srcObject = stream;
    stream.getVideoTracks()[0].addEventListener("ended", () => this.stop());
    await this.video.play();
    return stream;
  }

  async several() {
    const devices = await navigator.mediaDevices.enumerateDevices();
    return devices.filter((device) => device.kind === "videoinput").length > 1;
  }

  turnAround() {
    this.facing = this.facing === "environment" ? "user" : "environment";
    return this.start();
  }

  stop() {
    for (const track of this.stream?.getTracks() || []) track.stop();
    this.stream = null;
    this.video.srcObject = null;
  }

  async snap() {
    const { videoWidth: width, videoHeight: height } = this.video;
    if (!width) return null;
    const scale = Math.min(1, LONGER_SIDE / Math.max(width, height));
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(height * scale);
    this.canvas.getContext("2d").drawImage(this.video, 0, 0, this.canvas.width, this.canvas.height);
    return new Promise((done) => this.canvas.toBlob(done, "image/jpeg", 0.85));
  }

  // Calls `each` with an image's Blob, again once it is done, while the same stream runs.
  async follow(each) {
    const { stream } = this;
    while (stream && this.stream === stream) {
      const start = performance.now();
      const blob = document.hidden || this.paused ? null : await this.snap();
      const pause = blob ? await each(blob) : IDLE_MS;
      const left = Math.max(EVERY_MS - (performance.now() - start), pause || 0, 4);
      await new Promise((done) => setTimeout(done, left));
    }
  }
}
