// Keeps what matters in the picture, calmly, until a hand takes the camera.
//
// Balls are to be seen in full. The camera moves when they are about to leave the picture, or fill
// little of it, and then to where there is some room around them.
import { button, element, readAddress, writeAddress } from "./words.js";

const THREE = MeshCat.THREE;
const ROOM = 1.12; // how much farther away than needed
const TIGHT = 1.03; // nearer than this it moves away
const LOOSE = 1.7; // farther than this it comes nearer
const ASIDE = 0.5; // of half the picture, from which on what is seen is moved to its middle
const GLIDE = 0.45; // [s] for most of the way

// From what is looked at to the camera, in the world.
const PRESETS = {
  overview: { title: "all that matters", direction: [1, -0.35, 0.42] },
  top: { title: "from above", direction: [0.001, -0.02, 1] },
  front: { title: "from the front", direction: [1, 0, 0.12] },
  follow: { title: "what decides", direction: [1, -0.35, 0.42] },
};

export class Camera {
  constructor(viewer) {
    this.viewer = viewer;
    this.balls = { arm: [], bodies: [], pair: [] };
    this.goal = null; // { target, distance }
    this.last = performance.now();
    this.buttons = {};
    const asked = readAddress().get("camera");
    this.preset = asked in PRESETS ? asked : "overview";
    for (const [name, { title }] of Object.entries(PRESETS)) {
      this.buttons[name] = button(name, title, () => this.choose(name));
      element("presets").append(this.buttons[name]);
    }
    viewer.controls.addEventListener("start", () => this.take());
    // Wheels and fingers are hands as well, and tell no start of their own.
    viewer.dom_element.addEventListener("wheel", () => this.take(), { passive: true });
    this.show();
  }

  choose(name) {
    this.preset = name;
    this.goal = null;
    writeAddress("camera", name);
    this.show();
    this.viewer.set_dirty();
  }

  take() {
    if (this.preset === "own") return;
    this.preset = "own";
    writeAddress("camera", null);
    this.show();
  }

  show() {
    for (const [name, made] of Object.entries(this.buttons)) {
      made.setAttribute("aria-pressed", String(name === this.preset));
    }
  }

  // A command: balls (x, y, z, radius) of the arm and of moving bodies, and the deciding line.
  aim(command) {
    const balls = (numbers) => Array.from({ length: numbers.length / 4 }, (_, k) => ({
      at: new THREE.Vector3(numbers[4 * k], numbers[4 * k + 1], numbers[4 * k + 2]),
      radius: numbers[4 * k + 3],
    }));
    const pair = command.pair;
    this.balls = {
      arm: balls(command.arm),
      bodies: balls(command.bodies),
      pair: [0, 3].filter((k) => k < pair.length).map((k) => ({
        at: new THREE.Vector3(pair[k], pair[k + 1], pair[k + 2]), radius: 0.3 })),
    };
  }

  // The balls that the present choice is to show.
  subjects() {
    if (this.preset === "follow" && this.balls.pair.length) return this.balls.pair;
    return [...this.balls.arm, ...this.balls.bodies];
  }

  // Look at a point, given in the viewer's own world, which is the camera's.
  focus(point) {
    this.take();
    const { camera, controls } = this.viewer;
    const away = camera.position.clone().sub(controls.target).multiplyScalar(0.6);
    controls.target.copy(point);
    camera.position.copy(point).add(away);
    controls.update();
    this.viewer.set_dirty();
  }

  // Called before each frame is drawn.
  move() {
    const now = performance.now(), passed = (now - this.last) / 1000;
    this.last = now;
    const subjects = this.preset === "own" ? [] : this.subjects();
    if (!subjects.length) return;
    const axes = frame(PRESETS[this.preset].direction);
    const { camera, controls } = this.viewer;
    const half = THREE.MathUtils.degToRad(camera.fov / 2);
    const slopes = [Math.tan(half) * camera.aspect, Math.tan(half)];
    const wanted = fit(subjects, axes, slopes);
    const goal = this.goal;
    const least = goal && needed(subjects, goal.target, axes, slopes);
    const isFirst = goal === null || goal.preset !== this.preset || goal.aspect !== camera.aspect;
    const isAside = goal && wanted.target.distanceTo(goal.target)
      > ASIDE * Math.min(...slopes) * goal.distance;
    if (isFirst || isAside || least * TIGHT > goal.distance
        || wanted.distance * LOOSE < goal.distance) {
      this.goal = {
        target: wanted.target, distance: wanted.distance * ROOM,
        preset: this.preset, aspect: camera.aspect,
      };
    }
    const target = toCamera(this.goal.target);
    const place = toCamera(this.goal.target.clone().addScaledVector(axes.away, this.goal.distance));
    const share = this.hasMoved && !reduced() ? 1 - Math.exp(-passed / GLIDE) : 1;
    const still = camera.position.distanceTo(place) + controls.target.distanceTo(target) < 1e-3;
    if (still) return;
    this.hasMoved = true;
    camera.position.lerp(place, share);
    controls.target.lerp(target, share);
    this.viewer.set_dirty();
  }
}

const reduced = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

function toCamera(point) {
  return new THREE.Vector3(point.x, point.z, -point.y);
}

function frame(direction) {
  const away = new THREE.Vector3(...direction).normalize();
  const right = new THREE.Vector3(0, 0, 1).cross(away).normalize();
  return { away, right, up: away.clone().cross(right) };
}

// Extents of a ball across the picture: it is inside where |x| <= slope * depth for its silhouette.
function needed(balls, target, axes, slopes) {
  let least = 0.2;
  for (const { at, radius } of balls) {
    const rel = at.clone().sub(target);
    const depth = rel.dot(axes.away);
    [axes.right, axes.up].forEach((axis, k) => {
      const spread = radius * Math.hypot(1, slopes[k]);
      least = Math.max(least, depth + (Math.abs(rel.dot(axis)) + spread) / slopes[k]);
    });
  }
  return least;
}

// Where to look at and from how far, so that all is seen in full and both sides are as near.
function fit(balls, axes, slopes) {
  const target = new THREE.Vector3();
  balls.forEach(({ at }) => target.addScaledVector(at, 1 / balls.length));
  for (let round = 0; round < 6; round++) {
    const distance = needed(balls, target, axes, slopes);
    [axes.right, axes.up].forEach((axis, k) => {
      let low = Infinity, high = Infinity;
      for (const { at, radius } of balls) {
        const rel = at.clone().sub(target);
        const room = slopes[k] * (distance - rel.dot(axes.away)) - radius * Math.hypot(1, slopes[k]);
        high = Math.min(high, room - rel.dot(axis));
        low = Math.min(low, room + rel.dot(axis));
      }
      target.addScaledVector(axis, (low - high) / 2);
    });
  }
  return { target, distance: needed(balls, target, axes, slopes) };
}
