// The panels: what the verdict says, what it rests on, who is heard, and what the colours mean.
import { paint } from "./colours.js";
import { age, brief, clock, element, item, microseconds, prose, seconds, speed, stopTime } from "./words.js";

const GREY = "var(--none)";
const SLUGGISH = 0.5; // share of its timeout after which a source is called slow

export class Panels {
  constructor(reset, chooseDepth) {
    this.levels = new Map(); // name -> { sign, colour, row }
    this.columns = []; // { number, bar, column, text } of each bucket
    this.scene = null;
    this.depth = 0;
    this.latest = null; // the verdict that the panels show
    element("reset").addEventListener("submit", (event) => {
      event.preventDefault();
      this.tellOutcome("sending …");
      reset(element("token").value);
    });
    element("depth").addEventListener("input", () => chooseDepth(Number(element("depth").value)));
  }

  get isModel() {
    return this.scene !== null && this.scene.tree.length > 0;
  }

  colour(level) {
    return this.levels.has(level) ? this.levels.get(level).colour : GREY;
  }

  showScene(scene) {
    this.scene = scene;
    this.levels.clear();
    element("levels").replaceChildren(...scene.levels.map((level) => {
      const { name, sign } = level, colour = paint(level.paint);
      const row = legendRow(sign, colour, name, level.text);
      this.levels.set(name, { sign, colour, row });
      return row;
    }));
    element("others").replaceChildren(
      ...scene.others.map((other) => legendRow(other.sign, paint(other.paint), null, other.text)));
    element("configuration").textContent = `configuration ${scene.configuration}`;
    element("configuration").hidden = !scene.configuration;
    this.layBuckets(scene);
    for (const id of ["times", "cause", "figures", "structure", "legend"]) element(id).hidden = this.isModel;
    element("model").hidden = !this.isModel;
    if (this.isModel) element("depth").max = scene.tree.length - 1;
    element("token").disabled = !scene.obeys_reset;
    element("reset").hidden = !scene.obeys_reset;
  }

  showDepth(depth) {
    const balls = this.scene.tree[depth];
    element("depth").value = depth;
    element("depths").textContent =
      `level ${depth} of ${this.scene.tree.length - 1}: ${balls} balls contain the whole arm`;
  }

  tellPace(text) {
    element("pace").textContent = text;
  }

  tellOutcome(text) {
    element("outcome").textContent = text;
  }

  show(verdict) {
    this.latest = verdict;
    this.showTime("contact", verdict.contact_time, verdict.contact_level);
    this.showLimited(verdict);
    element("stop").textContent = stopTime(verdict.stop_time);
    this.showSpeed(verdict);
    this.showCause(verdict);
    this.showProved(verdict);
    element("link").textContent = verdict.link || "none";
    element("obstacle").textContent = verdict.obstacle || "none";
    // What is latched stands in its own panel, with what to do about it.
    const lines = verdict.reasons.map((text, k) => item(text, verdict.effects[k]))
      .filter((_, k) => verdict.effects[k] !== "latched" || !verdict.latches.length);
    if (!verdict.complete && verdict.sequence > 0) {
      lines.push(item("not every pair was evaluated in time"));
    }
    lines.push(...verdict.notes.map((text) => item(text, "remark")));
    update(element("reasons"), lines);
    element("why").hidden = !verdict.explanation.length && !verdict.asking;
    update(element("explanation"), verdict.explanation.map((text) => item(text)));
    element("asking").hidden = !verdict.asking;
    element("hint").textContent = this.scene.is_being_recorded
      ? "the recording of this run shows what would have avoided it:"
      : "a recording shows what would have avoided it: start the run with --record FILE, then run";
    update(element("command"), verdict.asking.split(/( )/).map((word) => {
      const part = document.createElement("span"); // a line ends between words, never at a hyphen
      part.textContent = word;
      return part;
    }));
    const load = verdict.load;
    element("evaluated").textContent = load === null ? "–" : load.evaluated;
    element("duration").textContent =
      load === null ? "–" : `${microseconds(load.p50)} · ${microseconds(load.p99)}`;
    element("late").textContent = load === null ? "–" : load.late;
    this.showSources(verdict.sources);
    this.showLatches(verdict);
    this.showBuckets(verdict.buckets);
    for (const [name, { row }] of this.levels) row.classList.toggle("now", name === verdict.level);
    const count = `${verdict.obstacles} obstacle${verdict.obstacles === 1 ? "" : "s"}`;
    element("source").textContent = this.isModel ? this.scene.robot
      : `${this.scene.robot} · ${count} · tick ${verdict.sequence} · ${clock(verdict.wall, verdict.now)}`;
  }

  // The number has the colour of the level that it earns by itself.
  showTime(id, time, level) {
    element(id).textContent = seconds(time);
    const own = this.colour(this.latest.sequence > 0 ? level : "");
    element(id).style.color = `color-mix(in srgb, ${own} 65%, var(--pole))`;
  }

  // Where a shield moves the arm, how fast it goes, and why it is slower than it was asked to be.
  showSpeed({ speed_scale, command }) {
    const share = command === null ? speed_scale : command.scale;
    element("going").textContent = command === null ? "allowed speed" : "pace";
    element("speed").textContent = `${(100 * share).toFixed(0)} %`;
    const text = command === null ? ""
      : command.is_proved ? command.reason && `slower: ${command.reason}`
      : `not proved any more, the arm must brake${command.reason && ": "}${command.reason}`;
    element("slower").textContent = text;
    element("slower").hidden = command === null;
  }

  // What there is only where contact limits are stated.
  showLimited({ harm_time, harm_level, contact_speed }) {
    const isLimited = harm_time !== null;
    for (const id of ["harm", "touch"]) element(id).parentElement.hidden = !isLimited;
    element("by").textContent = isLimited ? "harm" : "contact";
    if (!isLimited) return;
    this.showTime("harm", harm_time, harm_level);
    element("touch").textContent = speed(contact_speed);
  }

  // What there is only on a committed piece that is proved safe to its end.
  showProved({ proved_until, now }) {
    element("proved").parentElement.hidden = proved_until === null;
    if (proved_until !== null) element("proved").textContent = seconds(Math.max(0, proved_until - now));
  }

  // A level that is held tells what it began with, since when, and when it may rise.
  showCause({ sequence, now, wall, since, cause, rises_at }) {
    const isKnown = sequence > 0 && since !== null, isHeld = isKnown && rises_at !== null;
    element("began").textContent = isKnown
      ? `since ${tellTime(since, now, wall)}${cause && ": "}${cause}` : "";
    element("rises").textContent = isHeld ? `; may rise in ${Math.max(0, rises_at - now).toFixed(1)} s` : "";
  }

  showSources(sources) {
    element("sources").hidden = !sources.length;
    update(element("heard"), sources.map(({ name, age: old, rate, timeout }) => {
      const row = document.createElement("tr");
      const late = old === null || (timeout !== null && old > timeout);
      const slow = !late && timeout !== null && old > SLUGGISH * timeout;
      const told = old === null ? "nothing received"
        : `${(1000 * Math.max(old, 0)).toFixed(0)} ms${late || slow ? "" : " old"}`;
      for (const text of [
        name,
        rate === null ? "" : `${rate < 10 ? rate.toFixed(1) : rate.toFixed(0)} Hz`,
        `${late ? "✕ late, " : slow ? "! slow, " : ""}${told}`,
      ]) {
        const cell = document.createElement("td");
        cell.textContent = text;
        row.append(cell);
      }
      row.className = late || slow ? "late" : "";
      return row;
    }));
  }

  showLatches({ latches, now, wall }) {
    document.body.classList.toggle("latched", latches.length > 0);
    if (!latches.length) {
      if (element("latch").contains(document.activeElement)) element("panels").focus();
      element("outcome").textContent = "";
      element("token").value = "";
      element("latch").hidden = true;
      return;
    }
    element("latch").hidden = false;
    const begin = Math.min(...latches.map(({ since }) => since));
    element("since").textContent = `since ${tellTime(begin, now, wall)}, for ${age(Math.max(0, now - begin))}`;
    update(element("latches"), latches.map(({ reason, since, remedy }) => {
      const row = item(since > begin ? `${tellTime(since, now, wall)} ${reason}` : reason);
      const advice = prose(document.createElement("div"), remedy);
      advice.className = "remedy";
      row.append(advice);
      return row;
    }));
    element("remedy").textContent = this.scene.obeys_reset
      ? "The token is on the command line of the run."
      : "This run refuses resets: restart it with --reset-token TOKEN.";
  }

  // The legend of the buckets: the colour and the times of each, and room for how many pairs it has.
  layBuckets({ period, buckets }) {
    this.columns = Array.from({ length: buckets }, (_, k) => {
      const [column, number, bar, swatch, label] = ["div", "b", "i", "u", "b"].map(
        (name) => document.createElement(name));
      const begin = k ? period * 2 ** k : 0, end = k < buckets - 1 ? period * 2 ** (k + 1) : Infinity;
      const text = end < Infinity ? `${seconds(begin)} to ${seconds(end)}` : `${seconds(begin)} and more`;
      column.setAttribute("role", "listitem");
      bar.style.background = swatch.style.background = paint(k);
      // Where each third one begins: more would touch.
      const isLabelled = k % 3 === 0 && k < buckets - 1;
      label.textContent = isLabelled ? (k ? brief(begin) : "0") : "";
      column.append(number, bar, swatch, label);
      return { column, number, bar, text: `bucket ${k}, ${text}` };
    });
    element("buckets").replaceChildren(...this.columns.map(({ column }) => column));
  }

  showBuckets(counts) {
    const most = Math.max(...counts, 1);
    this.columns.forEach(({ column, number, bar, text }, k) => {
      const count = counts[k] || 0;
      number.textContent = count || "";
      bar.style.height = `${count ? 6 + 30 * Math.log1p(count) / Math.log1p(most) : 0}px`;
      column.title = counts.length ? `${text}: ${count} pair${count === 1 ? "" : "s"}` : text;
      column.setAttribute("aria-label", column.title);
    });
  }

  headline(text, level) {
    const known = this.levels.get(level);
    element("level").textContent = text;
    element("sign").textContent = known ? known.sign : "○";
    element("headline").classList.toggle("long", text.length > 9);
    document.documentElement.style.setProperty("--level", known ? known.colour : GREY);
  }
}

// A time of the monitor on the clock of the page.
function tellTime(time, now, wall) {
  return clock(wall > 0 ? wall - (now - time) : 0, time);
}

function legendRow(sign, colour, name, text) {
  const row = document.createElement("li");
  const mark = document.createElement("i");
  mark.textContent = sign;
  mark.style.color = colour;
  row.append(mark);
  if (name !== null) {
    const word = document.createElement("b");
    word.textContent = name;
    row.append(word);
  }
  const meaning = document.createElement("span");
  meaning.textContent = text;
  row.append(meaning);
  return row;
}

// Text that is the same stays as it is, so that it can be selected.
function update(parent, children) {
  const made = document.createElement(parent.tagName);
  made.append(...children);
  if (made.innerHTML !== parent.innerHTML) parent.replaceChildren(...made.childNodes);
}
