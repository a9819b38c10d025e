// The strip: contact time (logarithmic) with the stop time below it, the pace of the arm, or the speed
// that it is allowed, and the level as a band; over the last half minute, or over a whole recording.
// What happened stands on top.
import { tone } from "./colours.js";
import { Markers } from "./markers.js";
import { clock, element } from "./words.js";

const SPAN = 30; // [s] of a live monitor
const SHORTEST = 0.01, LONGEST = 30; // [s] of contact and stop time
const LINES = [0.1, 1, 10];
const GAP = 0.5; // [s] without moments is a gap
const TOP = 22; // [px], for what happened

const clamp = (share) => Math.max(0, Math.min(1, share || 0));

export class Strip {
  // seek: shows the moment of a number.
  constructor(seek) {
    this.seek = seek;
    this.moments = []; // { number, now, wall, level, contact, stop, speed, harm, pace }
    this.events = [];
    this.levels = []; // { name, paint }, the lowest first
    this.at = null; // number of the moment that is shown; null: the present
    this.isWhole = false; // whether all is shown, as of a recording
    this.end = null; // where the window ends while the past is looked at, [s]
    this.canvas = element("curves");
    this.markers = new Markers(element("events"), (event) => this.seek(event.number));
    const pick = (event) => {
      if (!this.moments.length) return;
      const { left, width } = this.canvas.getBoundingClientRect();
      const [begin, end] = this.window();
      const time = begin + (event.clientX - left) / width * (end - begin);
      this.seek(this.nearest(time).number);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      pick(event);
    });
    this.canvas.addEventListener("pointermove", (event) => { if (event.buttons) pick(event); });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  take(news) {
    if (news.anew) this.moments = this.events = [];
    const fresh = news.moments.map(([number, now, wall, level, contact, stop, speed, harm, pace]) => (
      { number, now, wall, level, contact, stop, speed, harm, pace }));
    const keep = ({ number }) => number >= news.first;
    this.moments = [...this.moments, ...fresh].filter(keep);
    this.events = [...this.events, ...news.events].filter(keep);
    if (fresh.length || news.anew) this.draw();
  }

  get last() {
    return this.moments[this.moments.length - 1];
  }

  find(number) {
    return this.moments.findLast((moment) => moment.number <= number) || this.moments[0];
  }

  nearest(time) {
    return this.moments.reduce((best, moment) => (
      Math.abs(moment.now - time) < Math.abs(best.now - time) ? moment : best));
  }

  // Begin and end of what is shown, in [s] of the monitor.
  window() {
    if (!this.moments.length) return [0, SPAN];
    const first = this.moments[0].now, last = this.last.now;
    if (this.isWhole) return [first, Math.max(last, first + 1)];
    if (this.at === null) this.end = last;
    else {
      const shown = this.find(this.at).now;
      if (this.end === null || shown > this.end) this.end = shown;
      if (shown < this.end - SPAN) this.end = shown + SPAN;
    }
    return [this.end - SPAN, this.end];
  }

  draw() {
    const { canvas } = this;
    const ratio = Math.min(devicePixelRatio, 2);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    // A new size is new memory; the same one is wiped.
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const [begin, end] = this.window();
    const x = (now) => (now - begin) / (end - begin) * width;
    // Where a shield moves the arm its pace tells more than what is allowed, and has more room.
    const isMoved = this.moments.some(({ pace }) => pace !== null);
    const band = height > 100 ? 12 : 8, speed = (height > 100 ? 14 : 8) * (isMoved ? 2 : 1);
    const floor = height - band - speed - 4;
    const y = (time) => {
      const share = Math.log(Math.min(Math.max(time, SHORTEST), LONGEST) / SHORTEST)
        / Math.log(LONGEST / SHORTEST);
      return floor - share * (floor - TOP);
    };
    const shown = this.moments.filter(({ now }) => now >= begin - 1 && now <= end + 1);
    pen.font = "10px system-ui, sans-serif";
    pen.fillStyle = tone("--edge");
    for (const time of LINES) pen.fillRect(0, Math.round(y(time)), width, 1);
    const box = (run) => {
      const left = x(run.begin);
      return { left, wide: Math.max(1, x(run.end) - left) + 0.5 };
    };
    for (const run of this.findRuns(shown, ({ level }) => level)) {
      this.drawLevel(pen, { level: run.value }, { ...box(run), height, band });
    }
    pen.fillStyle = tone("--share");
    for (const run of this.findRuns(shown, (moment) => Math.round(speed * clamp(moment.pace ?? moment.speed)))) {
      const { left, wide } = box(run);
      pen.fillRect(left, height - band - 2 - run.value, wide, run.value);
    }
    this.drawCurve(pen, shown, x, (moment) => y(moment.stop), { dash: [4, 3], colour: tone("--pole") });
    this.drawCurve(pen, shown, x, (moment) => y(moment.contact), { dash: [], colour: tone("--curve") });
    const limited = shown.filter(({ harm }) => harm !== null);
    this.drawCurve(pen, limited, x, (moment) => y(moment.harm), { dash: [1, 3], colour: tone("--remark") });
    if (height > 100) {
      for (const time of LINES) this.write(pen, `${time} s`, tone("--faint"), 2, y(time) - 2);
    }
    this.drawKey(pen, height > 100 ? 40 : 2, limited.length > 0, isMoved);
    if (this.at !== null && this.moments.length) {
      pen.fillStyle = tone("--pole");
      pen.fillRect(Math.round(x(this.find(this.at).now)) - 1, 0, 2, height);
    }
    this.showEvents(x, begin, end, width);
  }

  // Moments in a row that look the same: a few boxes, where each moment's own would be hundreds.
  findRuns(moments, look) {
    const runs = [];
    moments.forEach((moment, k) => {
      const next = moments[k + 1], value = look(moment);
      const end = next === undefined || next.now - moment.now > this.longestGap()
        ? moment.now + 0.1 : next.now;
      const last = runs[runs.length - 1];
      if (last && last.value === value && last.end === moment.now) last.end = end;
      else runs.push({ value, begin: moment.now, end });
    });
    return runs;
  }

  longestGap() {
    return this.isWhole ? Infinity : GAP;
  }

  // On the left, where it covers what is oldest.
  drawKey(pen, left, isLimited, isMoved) {
    const words = [
      ["— contact time", tone("--curve")], ...(isLimited ? [["··· harm time", tone("--remark")]] : []),
      ["-- stop time", tone("--pole")], [isMoved ? "▮ pace" : "▮ allowed speed", tone("--faint")],
    ];
    for (const [text, colour] of words) {
      this.write(pen, text, colour, left, TOP + 12);
      left += pen.measureText(text).width + 12;
    }
  }

  // Words over curves.
  write(pen, text, colour, left, bottom) {
    pen.fillStyle = tone("--veil");
    pen.fillRect(left - 3, bottom - 10, pen.measureText(text).width + 6, 13);
    pen.fillStyle = colour;
    pen.fillText(text, left, bottom);
  }

  // A band in the level's colour; STOP and SLOW are told apart by their height as well.
  drawLevel(pen, { level }, { left, wide, height, band }) {
    const known = this.levels[level];
    const tall = band * [1, 0.75, 0.5, 0.3][Math.max(level, 0)];
    pen.fillStyle = tone(known ? `--paint-${known.paint}` : "--none");
    pen.fillRect(left, height - tall, wide, tall);
  }

  drawCurve(pen, moments, x, y, { dash, colour }) {
    pen.beginPath();
    pen.setLineDash(dash);
    pen.strokeStyle = colour;
    pen.lineWidth = 1.5;
    let before = null;
    for (const moment of moments) {
      const isGap = before === null || moment.now - before.now > this.longestGap();
      if (isGap) pen.moveTo(x(moment.now), y(moment));
      else pen.lineTo(x(moment.now), y(moment));
      before = moment;
    }
    pen.stroke();
    pen.setLineDash([]);
  }

  showEvents(x, begin, end, width) {
    const { markers } = this;
    // Where many happen at once the weighty ones stand; all are in the moments. Focus keeps its
    // marker while that is in the window.
    const weight = { latch: 0, stop: 1, reset: 2, refused: 3, fault: 4, go: 5 };
    const held = markers.focused;
    const rank = (event) => (identify(event) === held ? -1 : weight[event.kind]);
    const chosen = [];
    for (const event of this.events.filter(({ now }) => now >= begin && now <= end)
      .sort((a, b) => rank(a) - rank(b))) {
      const at = Math.min(Math.max(x(event.now), 9), width - 9);
      if (chosen.every((other) => Math.abs(other.at - at) >= 18)) chosen.push({ ...event, at });
    }
    chosen.sort((a, b) => a.at - b.at);
    markers.show(chosen.map((event) => ({ ...event, key: identify(event) })), (event) => {
      const { wall } = this.find(event.number);
      return `${clock(wall, event.now)} ${event.kind}: ${event.text}`;
    });
  }
}

const identify = ({ number, kind }) => `${number} ${kind}`;
