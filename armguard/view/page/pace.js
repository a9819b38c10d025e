// No picture is begun before the last one is finished, and where pictures take long they get fewer
// pixels: a browser without a graphics card stays in time, and its panels stay quick. What a page in
// the background takes, whose pictures the browser holds back, says nothing of that.
import { readAddress } from "./words.js";

const LONG = 60; // [ms] for a picture
const AMONG = 12; // pictures, half of which must have taken longer
const SHARES = [1, 0.75, 0.55]; // of the pixels of a row
const KEPT = 240; // durations

export class Pace {
  // tell: is told what to say about it.
  constructor(viewer, tell) {
    this.viewer = viewer;
    this.tell = tell;
    this.begun = this.finished = 0; // pictures
    this.times = []; // [ms] from a picture's begin to its end, the newest last
    this.step = 0;
    this.since = 0; // pictures with this share of pixels
    this.full = viewer.renderer.getPixelRatio();
    const fixed = Number(readAddress().get("pixels"));
    this.isFixed = fixed > 0;
    if (this.isFixed) viewer.renderer.setPixelRatio(Math.min(fixed, 2));
    this.isHeldBack = document.hidden; // whether the picture under way was, at any time
    document.addEventListener("visibilitychange", () => { this.isHeldBack = true; });
  }

  // Draw, unless nothing has changed or the last picture is not finished.
  draw() {
    const gl = this.viewer.renderer.getContext();
    if (this.fence) {
      if (gl.clientWaitSync(this.fence, 0, 0) === gl.TIMEOUT_EXPIRED) return;
      gl.deleteSync(this.fence);
      this.fence = null;
      this.finished += 1;
      if (!this.isHeldBack) this.count(performance.now() - this.begin);
    }
    if (!this.viewer.needs_render) return;
    this.begin = performance.now();
    this.isHeldBack = document.hidden;
    this.begun += 1;
    this.viewer.render();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  count(time) {
    this.times.push(time);
    if (this.times.length > KEPT) this.times.shift();
    this.since += 1;
    if (this.isFixed || this.since < AMONG || this.step === SHARES.length - 1) return;
    const median = this.times.slice(-AMONG).sort((a, b) => a - b)[AMONG / 2];
    if (median <= LONG) return;
    this.step += 1;
    this.since = 0;
    this.viewer.renderer.setPixelRatio(SHARES[this.step] * this.full);
    this.viewer.set_dirty();
    this.tell(`a frame takes ${median.toFixed(0)} ms in this browser, so it is drawn with fewer pixels`);
  }
}
