// What happened, as buttons on the strip. They are one tab stop: arrow keys, Home and End go from one
// to the next. A marker stays the same element as long as it is shown, so that it keeps the focus.

const SIGNS = { stop: "■", go: "▶", fault: "!", latch: "◆", reset: "○", refused: "✕" };
const STEPS = { ArrowLeft: -1, ArrowRight: 1, Home: -Infinity, End: Infinity };

export class Markers {
  // place: the element that holds them; open: called with the event of a marker that was pressed.
  constructor(place, open) {
    this.place = place;
    this.open = open;
    this.made = new Map(); // key -> { button, event }, the earliest first
    this.stop = null; // key of the marker that Tab leads to; null: there is none
    place.tabIndex = -1; // takes the focus of the last marker that leaves
    place.addEventListener("keydown", (event) => {
      if (!(event.key in STEPS) || event.altKey || event.ctrlKey || event.metaKey) return;
      const keys = [...this.made.keys()];
      if (!keys.length) return;
      event.preventDefault();
      const next = keys.indexOf(this.stop) + STEPS[event.key];
      this.focus(keys[Math.min(Math.max(next, 0), keys.length - 1)]);
    });
  }

  // Key of the marker that has the focus; null: none has.
  get focused() {
    return this.place.contains(document.activeElement) ? this.stop : null;
  }

  focus(key) {
    this.moveStop(key);
    this.made.get(key).button.focus({ preventScroll: true });
  }

  moveStop(key) {
    this.stop = key;
    for (const [other, { button }] of this.made) button.tabIndex = other === key ? 0 : -1;
  }

  // events: { key, kind, at }, the earliest first; describe: what one of them says, in words.
  show(events, describe) {
    const held = this.focused, before = [...this.made.keys()];
    const made = new Map(events.map((event) => [
      event.key, { button: this.made.get(event.key)?.button || this.make(event), event }]));
    for (const [key, { button }] of this.made) if (!made.has(key)) button.remove();
    this.made = made;
    let previous = null;
    for (const { button, event } of made.values()) {
      const title = describe(event);
      if (button.title !== title) {
        button.title = title;
        button.setAttribute("aria-label", title);
      }
      button.style.left = `${event.at}px`;
      // An element that moves in the document loses the focus: only those move that are not in order.
      const next = previous === null ? this.place.firstChild : previous.nextSibling;
      if (next !== button) this.place.insertBefore(button, next);
      previous = button;
    }
    const newest = [...made.keys()].at(-1) ?? null;
    if (held === null || made.has(held)) this.moveStop(held ?? newest);
    else if (newest === null) this.place.focus();
    else this.focus(before.slice(before.indexOf(held)).find((key) => made.has(key)) ?? newest);
  }

  make({ key, kind }) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = kind;
    button.textContent = SIGNS[kind];
    button.addEventListener("focus", () => this.moveStop(key));
    button.addEventListener("click", () => this.open(this.made.get(key).event));
    return button;
  }
}
