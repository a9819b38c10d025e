// The drawing commands that Meshcat lacks: what changes thirty times a second refills its buffers.

const THREE = MeshCat.THREE;

const geometries = {
  ball: (segments) => new THREE.SphereGeometry(1, segments, Math.round(0.6 * segments)),
  rod: (segments) => new THREE.CylinderGeometry(1, 1, 1, segments, 1, true),
};

export const split = (path) => path.split("/").filter((step) => step.length > 0);

export class Shapes {
  constructor(viewer, colours) {
    this.viewer = viewer;
    this.colours = colours;
    this.drawn = new Map(); // path -> the object that is refilled
  }

  forget() {
    this.drawn.clear();
  }

  draw(command) {
    const make = {
      instances: () => this.fillInstances(command),
      lines: () => this.fillVertices(command, (geometry) => new THREE.LineSegments(
        geometry, new THREE.LineBasicMaterial(look(command.opacity, { vertexColors: true })))),
      surface: () => this.fillVertices(command, (geometry) => new THREE.Mesh(
        geometry, new THREE.MeshPhongMaterial(look(command.opacity, {
          vertexColors: true, flatShading: true, side: THREE.DoubleSide, depthWrite: false,
          depthTest: !command.top })))),
    }[command.type];
    if (make === undefined) return false;
    make();
    this.viewer.set_dirty();
    return true;
  }

  // The same bodies in other colours.
  repaint() {
    for (const object of this.drawn.values()) this.paint(object);
    this.viewer.set_dirty();
  }

  // Colour each corner of each body, or each instance.
  paint(object) {
    const { palette } = this.colours;
    if (palette === null) return; // the legend brings it, and has all painted anew
    const { command } = object.userData, paints = this.colours.paints(command);
    const buffer = object.isInstancedMesh ? object.instanceColor : object.geometry.attributes.color;
    let at = 0;
    paints.forEach((paint, k) => {
      const corners = object.isInstancedMesh ? 1 : command.owners ? 3 * command.owners[k] : 2;
      const [red, green, blue] = palette.subarray(3 * paint, 3 * paint + 3);
      for (let corner = 0; corner < corners; corner++) {
        buffer.array[at++] = red;
        buffer.array[at++] = green;
        buffer.array[at++] = blue;
      }
    });
    buffer.needsUpdate = true;
  }

  // Buffers grow by doubling, and are never replaced while they are large enough.
  provide(command, needed, make) {
    let object = this.drawn.get(command.path);
    const fits = object !== undefined && object.userData.capacity >= needed
      && object.userData.segments === command.segments
      && object.userData.opacity === command.opacity;
    if (!fits) {
      const capacity = Math.max(16, 2 ** Math.ceil(Math.log2(Math.max(1, needed))));
      if (object !== undefined && object.dispose) object.dispose();
      object = make(capacity);
      object.userData.capacity = capacity;
      object.userData.segments = command.segments;
      object.userData.opacity = command.opacity;
      object.frustumCulled = false;
      this.drawn.set(command.path, object);
      this.viewer.set_object(split(command.path), object);
    }
    object.userData.command = command; // names and times, for a pointer
    return object;
  }

  fillInstances(command) {
    const count = command.buckets.length;
    const object = this.provide(command, count, (capacity) => {
      // Lit at corners, not at pixels: what is round looks the same, and costs half.
      const material = new THREE.MeshLambertMaterial(
        look(command.opacity, { wireframe: Boolean(command.wire) }));
      const geometry = geometries[command.shape](command.segments);
      const mesh = new THREE.InstancedMesh(geometry, material, capacity);
      mesh.instanceColor = new THREE.InstancedBufferAttribute(new Float32Array(3 * capacity), 3);
      if (material.transparent) hideInside(mesh, capacity, material.depthWrite);
      return mesh;
    });
    object.instanceMatrix.array.set(command.matrices);
    object.instanceMatrix.needsUpdate = true;
    this.paint(object);
    object.count = count;
    for (const child of object.children) child.count = count;
  }

  fillVertices(command, make) {
    const count = command.positions.length / 3;
    const object = this.provide(command, count, (capacity) => {
      const geometry = new THREE.BufferGeometry();
      for (const name of ["position", "color"]) {
        geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * capacity), 3));
      }
      // What is refilled may be anywhere: a pointer looks at every triangle.
      geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(), 1000);
      return make(geometry);
    });
    const { position } = object.geometry.attributes;
    position.array.set(command.positions);
    position.needsUpdate = true;
    this.paint(object);
    object.geometry.setDrawRange(0, count);
  }
}

function look(opacity, options) {
  return { opacity, transparent: opacity < 1, depthWrite: opacity >= 0.5, ...options };
}

// Of translucent bodies that touch, only the outside is seen, and once: where surfaces coincide the
// stencil lets the first one through; of opaque enough ones depth is drawn before colour.
function hideInside(mesh, capacity, deep) {
  Object.assign(mesh.material, {
    stencilWrite: true, stencilRef: deep ? SOLID : nextStencil(), stencilFunc: THREE.NotEqualStencilFunc,
    stencilZPass: THREE.ReplaceStencilOp,
  });
  mesh.renderOrder = 2;
  if (!deep) return;
  const depth = new THREE.MeshBasicMaterial({ colorWrite: false, transparent: true });
  const inside = new THREE.InstancedMesh(mesh.geometry, depth, capacity);
  inside.instanceMatrix = mesh.instanceMatrix;
  inside.frustumCulled = false;
  inside.renderOrder = 1;
  mesh.add(inside);
}

// Solid bodies hide each other; of faint ones only those of one object do.
const SOLID = 1;
let stencils = SOLID;
function nextStencil() {
  stencils = stencils < 255 ? stencils + 1 : SOLID + 1;
  return stencils;
}
