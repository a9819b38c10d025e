// Meshes of an arm with no more triangles than an eye can tell.
//
// Makers' meshes have hundreds of thousands of triangles in dozens of pieces: without a graphics
// card, or on a phone, they cost more than all else. Corners that share a cell of a grid become one
// at their mean; normals are kept apart by direction, so that edges stay sharp; pieces of one
// material are drawn as one.

const THREE = MeshCat.THREE;
const CELLS = 64; // along the diagonal of a mesh
const FEW = 1500; // triangles that are left as they are

export function simplify(root) {
  root.traverse((object) => {
    if (!object.isMesh || object.isInstancedMesh || object.userData.isSimple) return;
    object.userData.isSimple = true;
    const materials = [object.material].flat();
    const made = cluster(object.geometry, materials);
    if (made === null) return;
    object.geometry.dispose();
    object.geometry = made.geometry;
    object.material = made.materials;
  });
}

// The pieces of a geometry: where each begins in its index, how long it is, and its material.
function findPieces(geometry, materials) {
  const count = (geometry.index || geometry.attributes.position).count;
  if (!geometry.groups.length) return [{ start: 0, count, material: materials[0] }];
  return geometry.groups.map((group) => ({
    start: group.start, count: Math.min(group.count, count - group.start),
    material: materials[group.materialIndex] || materials[0],
  }));
}

const describe = ({ color, opacity, side }) => [color.getHex(), opacity, side].join();

// Lit at corners, not at pixels.
const repaint = ({ color, opacity, side }) => new THREE.MeshLambertMaterial(
  { color, opacity, side, transparent: opacity < 1 });

function cluster(geometry, materials) {
  const { position, normal } = geometry.attributes, { index } = geometry;
  if (!position || !normal || (index || position).count < 3 * FEW) return null;
  // A picture on a surface must not be torn.
  if (materials.some(({ map, color }) => map || !color)) return null;
  geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox;
  const cell = min.distanceTo(max) / CELLS;
  const cells = new Map(), corners = new Map();
  const places = [], normals = []; // sums: x, y, z, count of a cell; cell, x, y, z of a corner

  const findCorner = (at) => {
    const x = position.getX(at), y = position.getY(at), z = position.getZ(at);
    const key = Math.floor((x - min.x) / cell)
      + 256 * (Math.floor((y - min.y) / cell) + 256 * Math.floor((z - min.z) / cell));
    let place = cells.get(key);
    if (place === undefined) {
      place = places.length / 4;
      cells.set(key, place);
      places.push(0, 0, 0, 0);
    }
    [x, y, z, 1].forEach((value, k) => { places[4 * place + k] += value; });
    const n = [normal.getX(at), normal.getY(at), normal.getZ(at)];
    const side = n.reduce((sum, value) => 3 * sum + Math.round(value) + 1, 0);
    const cornerKey = 27 * place + side;
    let corner = corners.get(cornerKey);
    if (corner === undefined) {
      corner = normals.length / 4;
      corners.set(cornerKey, corner);
      normals.push(place, 0, 0, 0);
    }
    n.forEach((value, k) => { normals[4 * corner + 1 + k] += value; });
    return corner;
  };

  const looks = new Map(); // material's description -> { material, indices, seen }
  for (const { start, count, material } of findPieces(geometry, materials)) {
    const key = describe(material);
    if (!looks.has(key)) looks.set(key, { material, indices: [], seen: new Set() });
    const { indices, seen } = looks.get(key);
    for (let first = start; first + 2 < start + count; first += 3) {
      const three = [0, 1, 2].map((k) => findCorner(index ? index.getX(first + k) : first + k));
      const [a, b, c] = three.map((corner) => normals[4 * corner]);
      if (a === b || b === c || c === a) continue;
      const same = three.join();
      if (seen.has(same)) continue;
      seen.add(same);
      indices.push(...three);
    }
  }

  const made = new THREE.BufferGeometry(), count = normals.length / 4;
  const points = new Float32Array(3 * count), directions = new Float32Array(3 * count);
  for (let corner = 0; corner < count; corner++) {
    const place = normals[4 * corner], among = places[4 * place + 3];
    const n = normals.slice(4 * corner + 1, 4 * corner + 4), length = Math.hypot(...n) || 1;
    for (let k = 0; k < 3; k++) {
      points[3 * corner + k] = places[4 * place + k] / among;
      directions[3 * corner + k] = n[k] / length;
    }
  }
  made.setAttribute("position", new THREE.BufferAttribute(points, 3));
  made.setAttribute("normal", new THREE.BufferAttribute(directions, 3));
  const all = [];
  [...looks.values()].forEach(({ indices }, k) => {
    made.addGroup(all.length, indices.length, k);
    for (const one of indices) all.push(one);
  });
  made.setIndex(all);
  return { geometry: made, materials: [...looks.values()].map(({ material }) => repaint(material)) };
}
