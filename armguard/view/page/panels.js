// The panels: what the verdict says, what it rests on, who is heard, and what the colours mean.
import { age, clock, element, item, microseconds, seconds, stopTime } from "./words.js";

const GREY = "#93a1b0";
const SLUGGISH = 0.5; // share of its timeout after which a source is called slow

export class Panels {
  constructor(reset, chooseDepth) {
    this.levels = new Map(); // name -> { sign, colour, row }
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
    element("levels").replaceChildren(...scene.levels.map(({ name, sign, colour, text }) => {
      const row = legendRow(sign, colour, name, text);
      this.levels.set(name, { sign, colour, row });
      return row;
    }));
    element("others").replaceChildren(
      ...scene.others.map(({ sign, colour, text }) => legendRow(sign, colour, null, text)));
    for (const id of ["times", "figures", "legend"]) element(id).hidden = this.isModel;
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
    element("contact").textContent = seconds(verdict.contact_time);
    // The number has the colour of the level that it earns by itself.
    const own = this.colour(verdict.sequence > 0 ? verdict.contact_level : "");
    element("contact").style.color = `color-mix(in srgb, ${own} 65%, white)`;
    element("stop").textContent = stopTime(verdict.stop_time);
    element("speed").textContent = `${(100 * verdict.speed_scale).toFixed(0)} %`;
    element("link").textContent = verdict.link || "none";
    element("obstacle").textContent = verdict.obstacle || "none";
    const lines = verdict.reasons.map((text, k) => item(text, verdict.effects[k]));
    if (!verdict.complete && verdict.sequence > 0) {
      lines.push(item("not every pair was looked at in time"));
    }
    lines.push(...verdict.notes.map((text) => item(text, "remark")));
    update(element("reasons"), lines);
    element("why").hidden = !verdict.explanation.length && !verdict.asking;
    update(element("explanation"), verdict.explanation.map((text) => item(text)));
    element("asking").hidden = !verdict.asking;
    element("hint").textContent = this.scene.is_being_recorded
      ? "the recording of this run tells what would have avoided it:"
      : "what would have avoided it a recording tells: start the run with --record FILE, and then ask";
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

  showSources(sources) {
    element("sources").hidden = !sources.length;
    update(element("heard"), sources.map(({ name, age: old, rate, timeout }) => {
      const row = document.createElement("tr");
      const late = old === null || (timeout !== null && old > timeout);
      const slow = !late && timeout !== null && old > SLUGGISH * timeout;
      const told = old === null ? "never heard"
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
    element("latch").hidden = !latches.length;
    document.body.classList.toggle("latched", latches.length > 0);
    if (!latches.length) {
      element("outcome").textContent = "";
      element("token").value = "";
      return;
    }
    const rows = latches.map(({ reason, since }) => {
      const row = item(reason);
      const when = document.createElement("div");
      when.className = "since";
      const begin = wall > 0 ? clock(wall - (now - since), since) : clock(0, since);
      when.textContent = `since ${begin}, for ${age(Math.max(0, now - since))}`;
      row.append(when);
      return row;
    });
    if (!this.scene.obeys_reset) {
      rows.push(item("remedy: this run obeys no reset; start it again, with --reset-token TOKEN"));
    } else {
      rows.push(item("remedy: see that its cause has gone, then reset with the token that the command line has"));
    }
    update(element("latches"), rows);
  }

  showBuckets(counts) {
    element("structure").hidden = !counts.length;
    if (!counts.length) return;
    const most = Math.max(...counts, 1);
    const { period } = this.scene;
    update(element("buckets"), counts.map((count, k) => {
      const column = document.createElement("div");
      const number = document.createElement("b"), bar = document.createElement("i");
      number.textContent = count || "";
      bar.style.height = `${count ? 6 + 34 * Math.log1p(count) / Math.log1p(most) : 0}px`;
      bar.style.background = this.colour(this.levelOf(period * 2 ** k));
      column.title = `bucket ${k}, from ${seconds(k ? period * 2 ** k : 0)}: ${count} pairs`;
      column.append(number, bar);
      const label = document.createElement("b");
      label.textContent = k % 5 === 0 ? seconds(period * 2 ** k).replace(" ", "") : "\u00a0";
      column.append(label);
      return column;
    }));
  }

  // As the colours of what is drawn: never lower than the verdict's own level.
  levelOf(time) {
    const verdict = this.latest, names = [...this.levels.keys()];
    const margins = this.scene.margins;
    let found = 0;
    for (const margin of [0, ...margins]) found += time > verdict.stop_time + margin ? 1 : 0;
    return names[Math.max(found, names.indexOf(verdict.level))];
  }

  headline(text, level) {
    const known = this.levels.get(level);
    element("level").textContent = text;
    element("sign").textContent = known ? known.sign : "○";
    element("headline").classList.toggle("long", text.length > 9);
    document.documentElement.style.setProperty("--level", known ? known.colour : GREY);
  }
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
