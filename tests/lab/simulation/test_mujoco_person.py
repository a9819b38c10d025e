"""The simulated person is where the tracked points are."""

import numpy as np
import pytest

from armguard.lab.simulation.bodies import BODIES, POINTS
from armguard.lab.simulation.person import ProceduralPerson

mujoco = pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
from armguard.lab.simulation.mujoco_person import LEGS, MujocoPerson  # noqa: E402


@pytest.fixture(scope="module")
def simulated():
    spec = mujoco.MjSpec()
    person = MujocoPerson(spec, floor=-0.75)
    spec.worldbody.add_body(name="probe", mocap=True).add_geom(
        name="probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0]
    )
    model = spec.compile()
    return person, model, mujoco.MjData(model)


@pytest.mark.parametrize("time", [0.0, 5.0, 9.0])
def test_distances_from_bodies_are_those_from_their_points(simulated, time):
    person, model, data = simulated
    position = ProceduralPerson(1, 20.0).sample(time)[0]
    person.place(model, data, position)
    random, probe = np.random.default_rng(1), model.geom("probe").id
    for _ in range(20):
        place = position.mean(axis=0) + random.uniform(-2.0, 2.0, 3)
        data.mocap_pos[model.body("probe").mocapid[0]] = place
        mujoco.mj_kinematics(model, data)
        for body, geom in zip((*BODIES, LEGS), person.find_geoms(model), strict=True):
            start, end = (position[POINTS.index(body.points[k])] for k in (0, -1))
            if body is LEGS:
                end = np.array([start[0], start[1], -0.75 + LEGS.radius])
            along = (place - start) @ (end - start) / max((end - start) @ (end - start), 1e-12)
            nearest = start + np.clip(along, 0.0, 1.0) * (end - start)
            expected = np.linalg.norm(place - nearest) - body.radius - 0.01
            found = mujoco.mj_geomDistance(model, data, probe, geom, 9.0, None)
            assert found == pytest.approx(expected, abs=1e-6)
