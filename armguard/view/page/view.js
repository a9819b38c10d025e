// The page of the view: Meshcat's viewer, the furniture around it, and the commands it lacks.
// Each bundle of commands is answered by "done" once it is drawn; only then comes the next one.
"use strict";

const THREE = MeshCat.THREE;
const SILENCE = 1.5; // [s] without news after which the picture is no longer the present
const RETRY = 1000; // [ms]
const LEVEL_COLOURS = { STOP: "#ff3b52", SLOW: "#ff9a1f", AWARE: "#ffe23d", CLEAR: "#4fce82" };
const element = (id) => document.getElementById(id);

const viewer = new MeshCat.Viewer(element("pane"));
furnish();

function furnish() {
  viewer.set_property(["Background"], "top_color", [0.17, 0.21, 0.26]);
  viewer.set_property(["Background"], "bottom_color", [0.05, 0.065, 0.085]);
  viewer.set_property(["Grid"], "visible", false);
  viewer.set_property(["Axes"], "visible", false);
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.5);
  viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.42);
  viewer.set_property(["Lights", "FillLight", "<object>"], "position", [8, -5, 7]);
  viewer.scene.fog = new THREE.Fog(0x1b222b, 6, 14);

  const floor = new THREE.Group();
  const plate = new THREE.Mesh(
    new THREE.CircleGeometry(12, 64), new THREE.MeshBasicMaterial({ color: 0x1d252e }));
  plate.position.z = -0.004;
  const fine = new THREE.GridHelper(12, 48, 0x2a343f, 0x2a343f).rotateX(Math.PI / 2);
  const coarse = new THREE.GridHelper(12, 12, 0x4a5968, 0x3b4855).rotateX(Math.PI / 2);
  fine.position.z = -0.002;
  floor.add(plate, fine, coarse);
  viewer.set_object(["Floor"], floor);

  // The camera's own frame has y up: world x, z, -y.
  viewer.camera.fov = 38;
  viewer.camera.position.set(4.0, 1.9, -0.7);
  viewer.controls.target.set(0.0, 0.5, 0.6);
}

// ---- commands -------------------------------------------------------------------------------

const shapes = {
  ball: () => new THREE.SphereGeometry(1, 24, 16),
  rod: () => new THREE.CylinderGeometry(1, 1, 1, 20, 1, true),
};
const drawn = new Map(); // path -> the object that is refilled

function split(path) {
  return path.split("/").filter((step) => step.length > 0);
}

// Buffers grow by doubling, and are never replaced while they are large enough.
function provide(path, needed, make) {
  let object = drawn.get(path);
  if (object === undefined || object.userData.capacity < needed) {
    const capacity = Math.max(16, 2 ** Math.ceil(Math.log2(Math.max(1, needed))));
    if (object !== undefined && object.dispose) object.dispose();
    object = make(capacity);
    object.userData.capacity = capacity;
    object.frustumCulled = false;
    drawn.set(path, object);
    viewer.set_object(split(path), object);
  }
  return object;
}

function look(opacity, options) {
  return {
    opacity, transparent: opacity < 1, depthWrite: opacity >= 0.5, ...options,
  };
}

function fillInstances(command) {
  const count = command.colours.length / 3;
  const object = provide(command.path, count, (capacity) => {
    const material = new THREE.MeshPhongMaterial(look(command.opacity, { shininess: 12 }));
    const mesh = new THREE.InstancedMesh(shapes[command.shape](), material, capacity);
    mesh.instanceColor = new THREE.InstancedBufferAttribute(new Float32Array(3 * capacity), 3);
    if (material.transparent && material.depthWrite) hideInside(mesh, capacity);
    return mesh;
  });
  object.instanceMatrix.array.set(command.matrices);
  object.instanceMatrix.needsUpdate = true;
  object.instanceColor.array.set(command.colours);
  object.instanceColor.needsUpdate = true;
  object.count = count;
  for (const child of object.children) child.count = count;
}

// Of translucent bodies that touch, only the outside is seen, and once: depth is drawn before
// colour, and where surfaces coincide the stencil lets the first one through.
function hideInside(mesh, capacity) {
  Object.assign(mesh.material, {
    stencilWrite: true, stencilRef: 1, stencilFunc: THREE.NotEqualStencilFunc,
    stencilZPass: THREE.ReplaceStencilOp,
  });
  const depth = new THREE.MeshBasicMaterial({ colorWrite: false, transparent: true });
  const inside = new THREE.InstancedMesh(mesh.geometry, depth, capacity);
  inside.instanceMatrix = mesh.instanceMatrix;
  inside.frustumCulled = false;
  inside.renderOrder = 1;
  mesh.renderOrder = 2;
  mesh.add(inside);
}

function fillVertices(command, make) {
  const count = command.positions.length / 3;
  const object = provide(command.path, count, (capacity) => {
    const geometry = new THREE.BufferGeometry();
    for (const name of ["position", "color"]) {
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * capacity), 3));
    }
    return make(geometry);
  });
  const { position, color } = object.geometry.attributes;
  position.array.set(command.positions);
  color.array.set(command.colours);
  position.needsUpdate = color.needsUpdate = true;
  object.geometry.setDrawRange(0, count);
}

const commands = {
  instances: fillInstances,
  lines: (command) => fillVertices(command, (geometry) => new THREE.LineSegments(
    geometry, new THREE.LineBasicMaterial(look(command.opacity, { vertexColors: true })))),
  surface: (command) => fillVertices(command, (geometry) => new THREE.Mesh(
    geometry, new THREE.MeshPhongMaterial(look(command.opacity, {
      vertexColors: true, flatShading: true, side: THREE.DoubleSide, depthWrite: false })))),
  banner: showBanner,
  legend: showLegend,
  news: showNews,
};

const meshcatCommand = viewer.handle_command.bind(viewer);
viewer.handle_command = (command) => {
  if (Array.isArray(command)) {
    command.forEach(viewer.handle_command);
  } else if (command.type in commands) {
    commands[command.type](command);
    viewer.set_dirty();
  } else {
    if (command.type === "delete") drawn.clear();
    meshcatCommand(command);
  }
};

// ---- panels ---------------------------------------------------------------------------------

let steps = []; // of the legend: { start [s], row, mark }
let level = "…";
let lastNews = null; // [ms], of performance.now()

function seconds(value) {
  if (!(value < Infinity)) return value === Infinity ? "none in sight" : "unknown";
  return value < 0.9995 ? `${(1000 * value).toFixed(0)} ms` : `${value.toFixed(value < 10 ? 2 : 1)} s`;
}

function microseconds(value) {
  return value < 0.9995e-3 ? `${(1e6 * value).toFixed(0)} µs` : `${(1e3 * value).toFixed(1)} ms`;
}

function item(text, colour) {
  const row = document.createElement("li");
  if (colour !== undefined) {
    const swatch = document.createElement("i");
    swatch.style.background = colour;
    row.append(swatch);
  }
  const label = document.createElement("span");
  label.textContent = text;
  row.append(label);
  return row;
}

function showLegend(command) {
  steps = command.steps.map(({ text, colour, start }) => {
    const row = item(text, colour);
    const mark = document.createElement("b");
    row.append(mark);
    return { start, row, mark };
  });
  element("steps").replaceChildren(...steps.map(({ row }) => row));
  element("others").replaceChildren(...command.others.map(({ text, colour }) => item(text, colour)));
}

function stepOf(time) {
  return steps.reduce((found, step, index) => (time >= step.start ? index : found), 0);
}

function showBanner(command) {
  level = command.level;
  element("contact").textContent = seconds(command.contact_time);
  element("stop").textContent =
    command.stop_time < Infinity ? seconds(command.stop_time) : "unknown";
  element("speed").textContent = `${(100 * command.speed_scale).toFixed(0)} %`;
  element("link").textContent = command.link || "none";
  element("obstacle").textContent = command.obstacle || "none";
  const lines = command.reasons.map((text) => item(text));
  if (!command.complete) lines.push(item("not every pair was looked at in time"));
  for (const text of command.notes) {
    const line = item(text);
    line.className = "note";
    lines.push(line);
  }
  element("reasons").replaceChildren(...lines);
  const load = command.load;
  element("evaluated").textContent = load === null ? "–" : load.evaluated;
  element("duration").textContent =
    load === null ? "–" : `${microseconds(load.p50)} · ${microseconds(load.p99)}`;
  element("late").textContent = load === null ? "–" : load.late;
  element("source").textContent =
    `${command.robot} · ${command.obstacles} obstacles · tick ${command.sequence}`;
  const now = stepOf(command.contact_time);
  const stop = stepOf(command.stop_time);
  steps.forEach(({ row, mark }, index) => {
    row.classList.toggle("now", index === now && command.contact_time < Infinity);
    mark.textContent = index === stop ? "time to stop" : "";
  });
  showState();
}

// Comes before all other commands of a bundle and says how old they are, in [s].
function showNews(command) {
  lastNews = command.silence === null ? null : performance.now() - 1000 * command.silence;
  if (lastNews === null) element("source").textContent = `feed: ${command.address}`;
  showState();
}

// A picture of the past must never pass for the present.
function showState() {
  const age = lastNews === null ? Infinity : (performance.now() - lastNews) / 1000;
  const silent = age > SILENCE;
  document.body.classList.toggle("silent", silent);
  element("level").textContent = silent ? "NO DATA" : level;
  element("silence").textContent = age < Infinity
    ? `no data for ${age.toFixed(1)} s (last: ${level})` : "no data yet";
  const colour = silent ? "#93a1b0" : LEVEL_COLOURS[level] || "#93a1b0";
  element("banner").style.setProperty("--level", colour);
}
setInterval(showState, 100);

// ---- feed -----------------------------------------------------------------------------------

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/feed`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    try {
      viewer.handle_command_bytearray(new Uint8Array(data));
    } finally {
      requestAnimationFrame(() => socket.readyState === WebSocket.OPEN && socket.send("done"));
    }
  };
  socket.onclose = () => setTimeout(connect, RETRY);
}
connect();
