// Meshcat's viewer with furniture of our own: light, floor, table, and a size that is the pane's.

const THREE = MeshCat.THREE;

export function makeStage(pane) {
  const viewer = new MeshCat.Viewer(pane, false);
  viewer.set_3d_pane_size = () => {
    const width = Math.max(1, pane.clientWidth), height = Math.max(1, pane.clientHeight);
    viewer.camera.aspect = width / height;
    viewer.camera.updateProjectionMatrix();
    viewer.renderer.setSize(width, height);
    viewer.set_dirty();
  };
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
  viewer.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  viewer.set_property(["Grid"], "visible", false);
  viewer.set_property(["Axes"], "visible", false);
  // One light from afar: every other one costs as much again for each corner of each triangle.
  viewer.set_property(["Lights", "PointLightNegativeX"], "visible", false);
  viewer.set_property(["Lights", "PointLightPositiveX"], "visible", false);
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.45);
  viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.6);
  viewer.set_property(["Lights", "FillLight", "<object>"], "position", [8, -5, 7]);
  viewer.renderer.domElement.setAttribute("role", "img");
  viewer.renderer.domElement.setAttribute("aria-label", "the arm and what is around it, in 3D");
  // The camera's own frame has y up: world x, z, -y.
  viewer.camera.fov = 38;
  viewer.camera.near = 0.05;
  viewer.camera.position.set(4.0, 1.9, -0.7);
  viewer.controls.target.set(0.0, 0.5, 0.6);
  viewer.set_3d_pane_size();
  return viewer;
}

const LOOKS = {
  dark: {
    top: [0.17, 0.21, 0.26], bottom: [0.05, 0.065, 0.085], fog: 0x1b222b, plate: 0x1d252e,
    fine: 0x2a343f, coarse: 0x4a5968, edge: 0x3b4855, wood: 0x39444f,
  },
  light: {
    top: [0.93, 0.94, 0.96], bottom: [1, 1, 1], fog: 0xf4f6f8, plate: 0xf0f2f5,
    fine: 0xdde2e8, coarse: 0xaab4bf, edge: 0xc6ced6, wood: 0xb9c2cb,
  },
};

// The floor, and where it lies below the arm's base, a table for the arm.
export function layFloor(viewer, height, isLight) {
  const look = LOOKS[isLight ? "light" : "dark"];
  viewer.set_property(["Background"], "top_color", look.top);
  viewer.set_property(["Background"], "bottom_color", look.bottom);
  viewer.scene.fog = new THREE.Fog(look.fog, 9, 22);
  const floor = new THREE.Group();
  const plate = new THREE.Mesh(
    new THREE.CircleGeometry(16, 64), new THREE.MeshBasicMaterial({ color: look.plate }));
  const fine = new THREE.GridHelper(8, 32, look.fine, look.fine).rotateX(Math.PI / 2);
  const coarse = new THREE.GridHelper(16, 16, look.coarse, look.edge).rotateX(Math.PI / 2);
  plate.position.z = height - 0.004;
  fine.position.z = height - 0.002;
  coarse.position.z = height;
  floor.add(plate, fine, coarse);
  if (height < -0.05) {
    const wood = new THREE.MeshPhongMaterial({ color: look.wood });
    const top = new THREE.Mesh(new THREE.BoxGeometry(0.9, 0.9, 0.04), wood);
    top.position.z = -0.022;
    floor.add(top);
    for (const [x, y] of [[-0.4, -0.4], [-0.4, 0.4], [0.4, -0.4], [0.4, 0.4]]) {
      const leg = new THREE.Mesh(new THREE.BoxGeometry(0.05, 0.05, -height - 0.04), wood);
      leg.position.set(x, y, height / 2 - 0.02);
      floor.add(leg);
    }
  }
  viewer.set_object(["Floor"], floor);
  viewer.set_dirty();
}
