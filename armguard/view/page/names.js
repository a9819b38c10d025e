// Names on hover or tap, and where a double click points.
import { element, seconds } from "./words.js";

const THREE = MeshCat.THREE;

export class Names {
  constructor(viewer, shapes, camera) {
    this.viewer = viewer;
    this.shapes = shapes;
    this.caster = new THREE.Raycaster();
    const pane = viewer.dom_element;
    let waiting = null;
    pane.addEventListener("pointermove", (event) => {
      if (event.buttons) return this.hide();
      clearTimeout(waiting);
      waiting = setTimeout(() => this.show(event), 60);
    });
    pane.addEventListener("pointerleave", () => { clearTimeout(waiting); this.hide(); });
    pane.addEventListener("click", (event) => this.show(event));
    pane.addEventListener("dblclick", (event) => {
      const hit = this.find(event);
      if (hit) camera.focus(hit.point);
    });
  }

  hide() {
    element("tip").hidden = true;
  }

  show(event) {
    const hit = this.find(event), tip = element("tip");
    tip.hidden = hit === null;
    if (hit === null) return;
    tip.textContent = hit.time === undefined ? hit.name
      : `${hit.name}: ${hit.time < Infinity ? `contact time ${seconds(hit.time)}` : "no contact possible"}`;
    const { width, height } = this.viewer.dom_element.getBoundingClientRect();
    const x = event.offsetX, y = event.offsetY;
    tip.style.left = x > width - 200 ? "" : `${x + 14}px`;
    tip.style.right = x > width - 200 ? `${width - x + 8}px` : "";
    tip.style.top = `${Math.min(y + 12, height - 30)}px`;
  }

  // The nearest body with a name under the pointer; the arm's cover lies around its meshes.
  find(event) {
    const { width, height } = this.viewer.dom_element.getBoundingClientRect();
    const at = new THREE.Vector2(2 * event.offsetX / width - 1, 1 - 2 * event.offsetY / height);
    this.caster.setFromCamera(at, this.viewer.camera);
    let best = null;
    for (const object of this.shapes.drawn.values()) {
      const { names, times, owners } = object.userData.command;
      if (!names || !names.length || !isShown(object)) continue;
      for (const hit of this.caster.intersectObject(object, false)) {
        if (best !== null && hit.distance >= best.distance) continue;
        const index = hit.instanceId === undefined ? findOwner(owners, hit.faceIndex) : hit.instanceId;
        if (index >= names.length) continue;
        best = {
          distance: hit.distance, point: hit.point, name: names[index],
          time: times && times.length ? times[index] : undefined,
        };
      }
    }
    return best;
  }
}

function isShown(object) {
  for (let one = object; one; one = one.parent) if (!one.visible) return false;
  return true;
}

function findOwner(owners, face) {
  let before = 0;
  return owners.findIndex((count) => (before += count) > face);
}
