// Play, pause, step, speed, the next STOP, and back to the present.
import { button, clock, element } from "./words.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5];

export class Transport {
  // show: draws the moment of a number, null for the present; calls back when it is drawn.
  constructor(strip, show, { hasPresent }) {
    this.strip = strip;
    this.show = show;
    this.hasPresent = hasPresent;
    this.at = null;
    this.isPlaying = false;
    this.isBusy = false;
    this.due = null;
    this.clock = 0; // [s] of the monitor, while it plays
    this.slider = document.createElement("input");
    this.slider.type = "range";
    this.slider.setAttribute("aria-label", "time");
    this.slider.addEventListener("input", () => {
      const moments = strip.moments;
      if (moments.length) this.go(moments[Number(this.slider.value)].number);
    });
    this.play = button("❚❚", "pause", () => this.toggle());
    this.speed = document.createElement("select");
    this.speed.setAttribute("aria-label", "speed");
    this.speed.className = "extra";
    this.speed.append(...SPEEDS.map((value) => new Option(`${value}×`, value, value === 1, value === 1)));
    this.live = button("live", "back to the present", () => this.goLive());
    this.live.hidden = !hasPresent;
    this.told = document.createElement("span");
    const step = (by, title) => {
      const made = button(by < 0 ? "◂" : "▸", title, () => this.step(by));
      made.classList.add("extra");
      return made;
    };
    element("transport").append(
      this.play, step(-1, "one moment back"), step(1, "one moment on"),
      button("next STOP", "jump to the next STOP", () => this.nextStop()),
      this.live, this.speed, this.slider, this.told);
    requestAnimationFrame((now) => this.run(now));
  }

  get index() {
    const { moments } = this.strip;
    if (this.at === null) return moments.length - 1;
    const found = moments.findIndex(({ number }) => number >= this.at);
    return found < 0 ? moments.length - 1 : found;
  }

  // Show a moment, and stay there.
  go(number) {
    this.isPlaying = false;
    this.see(number);
  }

  goLive() {
    this.isPlaying = false;
    this.see(null);
  }

  toggle() {
    const { moments } = this.strip;
    if (!moments.length) return;
    if (this.at === null) return this.go(this.strip.last.number); // pause
    this.isPlaying = !this.isPlaying;
    if (this.isPlaying && this.index >= moments.length - 1 && !this.hasPresent) this.see(moments[0].number);
    this.clock = this.strip.find(this.at).now;
    this.tell();
  }

  step(by) {
    const { moments } = this.strip;
    if (!moments.length) return;
    this.go(moments[Math.min(Math.max(this.index + by, 0), moments.length - 1)].number);
  }

  nextStop() {
    const stops = this.strip.events.filter(({ kind }) => kind === "stop" || kind === "latch");
    if (!stops.length) return;
    const at = this.at === null ? Infinity : this.at;
    this.go((stops.find(({ number }) => number > at) || stops[0]).number);
  }

  see(number) {
    this.at = number;
    this.strip.at = number;
    this.strip.draw();
    this.due = { number };
    // The present is shown at once, whatever becomes of a moment that is still waited for.
    if (number === null) this.isBusy = false;
    this.flush();
    this.tell();
  }

  // One moment at a time is asked for: the last one that was wanted.
  flush() {
    if (this.isBusy || this.due === null) return;
    const { number } = this.due;
    this.due = null;
    this.isBusy = true;
    this.show(number, () => { this.isBusy = false; this.flush(); });
  }

  run(now) {
    requestAnimationFrame((later) => this.run(later));
    const passed = (now - (this.before || now)) / 1000;
    this.before = now;
    const { moments } = this.strip;
    if (!this.isPlaying || this.at === null || !moments.length) return;
    this.clock += passed * Number(this.speed.value);
    const reached = this.strip.moments.findLast((moment) => moment.now <= this.clock) || moments[0];
    if (reached.number > this.at) this.see(reached.number);
    if (reached === this.strip.last) this.isPlaying = false;
  }

  tell() {
    const { moments } = this.strip;
    this.play.textContent = this.at === null || this.isPlaying ? "❚❚" : "▶";
    this.play.title = this.at === null || this.isPlaying ? "pause" : "play";
    this.play.setAttribute("aria-label", this.play.title);
    this.live.setAttribute("aria-pressed", String(this.at === null));
    this.slider.max = Math.max(moments.length - 1, 1);
    this.slider.value = this.index;
    if (!moments.length) return;
    const moment = moments[this.index];
    this.told.textContent = clock(moment.wall, moment.now);
    this.slider.setAttribute("aria-valuetext", this.at === null ? "the present" : this.told.textContent);
  }
}
