// What is drawn beside arm and obstacles, each to be switched on and off; remembered in the address.
import { element, readAddress, writeAddress } from "./words.js";

const LAYERS = [
  { name: "cover", title: "cover", paths: ["cover"], on: true },
  { name: "lines", title: "nearest pairs", paths: ["pairs"], on: true },
  { name: "reach", title: "reachable ball", paths: ["reach"], on: false,
    help: "where the most imminent obstacle can be when the arm is at rest" },
  { name: "volume", title: "stopping volume", paths: ["volume"], on: false,
    help: "where the arm can be until it is at rest" },
  { name: "plan", title: "planned path", paths: ["plan"], on: true,
    help: "the path of the plan, the arm at its end, and the rest of the shield's path" },
  { name: "statics", title: "statics", paths: ["statics"], on: true },
  { name: "sensors", title: "sensor frames", paths: ["sensors"], on: false },
  { name: "meshes", title: "meshes", paths: ["arm"], on: true },
];

export class Layers {
  // changed: is told whether the stopping volume is asked for.
  constructor(viewer, changed) {
    this.viewer = viewer;
    this.changed = changed;
    const asked = readAddress().get("layers");
    const chosen = asked === null ? null : new Set(asked.split(","));
    this.boxes = LAYERS.map((layer) => {
      const box = document.createElement("input");
      box.type = "checkbox";
      box.id = `layer-${layer.name}`;
      box.checked = chosen === null ? layer.on : chosen.has(layer.name);
      box.addEventListener("change", () => this.choose());
      const label = document.createElement("label");
      label.title = layer.help || "";
      label.append(box, layer.title);
      element("layers").append(label);
      return { ...layer, box, label };
    });
    this.apply();
  }

  get wantsVolume() {
    return this.boxes.some(({ name, box }) => name === "volume" && box.checked);
  }

  // Some scenes have nothing to show in a layer.
  limit(scene) {
    const isModel = scene.tree.length > 0;
    for (const { name, label, box } of this.boxes) {
      label.hidden = (name === "volume" && !scene.has_volume)
        || (name === "sensors" && !scene.sensors.length)
        || (isModel && !["cover", "meshes"].includes(name));
      // Of an arm alone the levels of the tree are shown, and the finest only on request.
      if (isModel && name === "cover" && readAddress().get("layers") === null) box.checked = false;
    }
  }

  choose() {
    const names = this.boxes.filter(({ box }) => box.checked).map(({ name }) => name);
    writeAddress("layers", names.join(","));
    this.apply();
    this.changed(this.wantsVolume);
  }

  apply() {
    if (this.viewer === null) return;
    for (const { paths, box } of this.boxes) {
      for (const path of paths) {
        this.viewer.scene_tree.find(["armguard", path]).object.visible = box.checked;
      }
    }
    this.viewer.set_dirty();
  }
}
