import numpy as np

from armguard.bounds.joint_table import make_table
from armguard.jit.handle import pack
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs.contact_time import RESTS, rests_in_time
from armguard.pairs.separations import (
    FAILED,
    REACH,
    ProofScene,
    find_separations,
    make_separations,
    tabulate,
)
from support.panda_monitor import HOME, panda
from support.permitted_contact import find_front

NODES = 9


def make_scene(place, *, end=0.1, radius=0.05):
    obstacles = Obstacles(accel=5.0, speed=1.0)
    monitor = Monitor(panda(), obstacles)
    obstacles.update(["it"], 0.0, [place], [[0.0, 0.0, 0.0]], radius=radius)
    v = np.full(7, 0.1)
    monitor.step(0.0, HOME, v)
    arm = monitor._scheduler.arm
    monitor._scheduler.prepare(monitor._last[0])
    box = arm.motion.table.box
    table = make_table(
        np.linspace(0.0, end, NODES), box.turning, box.position_error,
        interpolates=False, with_velocities=False,
    )  # fmt: skip
    found = make_separations(len(arm.state.tree.parent), NODES)
    scene = ProofScene(arm.state.scene, table, found, np.zeros((7, 6)))
    handle = pack(scene)
    tabulate(handle, HOME, v, 0.0, np.inf)
    return arm, scene, handle


def is_inside(tree, node, ancestors):
    while node >= 0 and node not in ancestors:
        node = tree.parent[node]
    return node >= 0


def test_the_spheres_hold_the_link_and_each_is_kept_apart_to_the_end():
    kinds = set()
    center, radius = find_front()
    for away in (0.02, 0.05, 0.1, 0.3, 2.0):
        place = center + np.array([radius + 0.05 + away, 0.0, 0.0])
        arm, scene, handle = make_scene(place, end=0.06)
        tree = arm.state.tree
        for link in range(len(arm.links)):
            count = find_separations(handle, link, 0, 0, 0.0, False)
            if count == FAILED:
                continue
            spheres, steps = scene.found.sphere[:count], scene.found.steps[:count]
            ends = np.split(scene.found.end[: steps.sum()], np.cumsum(steps)[:-1])
            assert all(one[-1] == NODES - 1 and (np.diff(one) > 0).all() for one in ends)
            normals = scene.found.normal[: steps.sum()]
            assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
            kinds.add("reach" if spheres[0] == REACH else "many" if count > 1 else "one")
            if spheres[0] != REACH:
                own = np.flatnonzero((arm.state.link_of == link) & (tree.first_child < 0))
                assert all(is_inside(tree, leaf, set(spheres.tolist())) for leaf in own)
    assert kinds == {"reach", "many", "one"}


def test_nothing_is_found_where_both_may_touch():
    arm, _, handle = make_scene(find_front()[0])
    assert FAILED in [
        find_separations(handle, link, 0, 0, 0.0, False) for link in range(len(arm.links))
    ]


def test_the_table_is_wider_than_the_tick_s():
    arm, scene, handle = make_scene([2.0, 0.0, 0.6])
    arm.motion.braking.tabulate(HOME, np.full(7, 0.1), 0.0, 0.003)
    braking, table = arm.motion.braking.table, scene.table
    table.time[:] = braking.time[: len(table.time)]
    tabulate(handle, HOME, np.full(7, 0.1), 0.0, 0.003 + arm.motion.braking.reaction_time)
    places = slice(0, len(table.time))
    assert (table.high >= np.minimum(braking.high[places], braking.highest)).all()
    assert (table.low <= np.maximum(braking.low[places], braking.lowest)).all()
    assert rests_in_time(arm.state.handle, 0, 0, 0.0, 1000)[0] == RESTS
