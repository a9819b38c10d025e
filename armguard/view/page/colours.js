// Which colours of the palette are seen: dark on screens, light on paper or where the address says so;
// those of buckets of imminence, or of levels where the address says so.
import { element, readAddress, writeAddress } from "./words.js";

export class Colours {
  // changed: called when everything has to be drawn in other colours.
  constructor(changed) {
    this.changed = changed;
    this.palettes = null; // { dark, light }, each a row of red, green, blue from 0 to 1
    this.isPrinting = false;
    this.boxes = {
      level: this.offer("by-level", "colours", "level"), light: this.offer("light", "theme", "light") };
    const print = (isPrinting) => { this.isPrinting = isPrinting; this.apply(); };
    matchMedia("print").addEventListener("change", ({ matches }) => print(matches));
    addEventListener("beforeprint", () => print(true));
    addEventListener("afterprint", () => print(false));
    this.mark();
  }

  // A box of the page that is remembered in its address.
  offer(id, name, value) {
    const box = element(id);
    box.checked = readAddress().get(name) === value;
    box.addEventListener("change", () => {
      writeAddress(name, box.checked ? value : null);
      this.apply();
    });
    return box;
  }

  get isLight() {
    return this.isPrinting || this.boxes.light.checked;
  }

  get isByLevel() {
    return this.boxes.level.checked;
  }

  get palette() {
    return this.palettes === null ? null : this.palettes[this.isLight ? "light" : "dark"];
  }

  // Of a drawing command: the number of the colour of each body.
  paints(command) {
    return this.isByLevel ? command.levels : command.buckets;
  }

  show(palettes) {
    this.palettes = palettes;
    this.apply();
  }

  mark() {
    document.documentElement.classList.toggle("light", this.isLight);
    document.body.classList.toggle("by-level", this.isByLevel);
  }

  apply() {
    this.mark();
    const { palette } = this;
    for (let k = 0; palette !== null && 3 * k < palette.length; k++) {
      const parts = palette.subarray(3 * k, 3 * k + 3).map((part) => Math.round(255 * part));
      document.documentElement.style.setProperty(`--paint-${k}`, `rgb(${parts.join()})`);
    }
    this.changed();
  }
}

// A colour of the palette, for styles.
export const paint = (number) => `var(--paint-${number})`;

// A colour of the page, for canvases.
export const tone = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
