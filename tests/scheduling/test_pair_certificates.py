import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.hull_gap import lay_out_hulls
from armguard.pairs.scene import DISTANCE, ISOTROPIC
from armguard.robot import Kinematics
from armguard.scheduling.flagged_pairs import FlaggedCheck
from armguard.scheduling.pair_certificates import NOBODY, PairCertificates
from support.panda_monitor import HOME, panda

LINKS = 3
KINEMATICS, MOTION = Kinematics(panda()), ArmMotion(panda(), 0.02, with_joints=False)
KINEMATICS.compute(HOME, np.zeros(7))
EXACT = HullDistance(panda(), KINEMATICS)
HULLS = lay_out_hulls(EXACT.vertices, EXACT.joints)


class Scene:
    """Certificates beside a table, with all pairs looked at only when a test says so."""

    def __init__(self, watched=None, *, keeps_certificates=True, **bounds):
        self.obstacles = Obstacles(**bounds)
        self.state = TickState(KINEMATICS, MOTION, self.obstacles, margin=0.0, by_distance=False)
        self.certificates = PairCertificates(
            LINKS,
            watched or (lambda row: np.ones(LINKS, dtype=bool)),
            keeps_certificates=keeps_certificates,
        )
        self.tick = 0

    def follow(self):
        added, removed = self.obstacles.drain_membership()
        return self.certificates.change(added, removed, len(self.obstacles.table.alive))

    def enter(self, pairs, time=5.0, now=0.0):
        self.tick += 1
        self.state.begin(now, 0.0, 0.0)
        times = np.full(len(pairs), time)
        bounds = np.full(len(pairs), ISOTROPIC, dtype=np.int8)
        self.certificates.record(
            pairs, times, np.zeros_like(pairs), bounds, now, self.tick, self.state
        )

    def earliest(self, now, tick):
        """The pair whose certificate ends first, what is left of it, and pairs overdue."""
        pair, expiry, overdue = self.certificates.earliest(now, tick)
        return pair, max(0.0, expiry - now), overdue

    def disturbed(self, now=0.0):
        self.state.begin(now, 0.0, 0.0)
        grown, broken = self.certificates.disturbed(self.state, self.obstacles.table.revision)
        return grown.tolist(), broken.tolist()

    def check(self, pairs, now, tick):
        """What is flagged, measured exactly."""
        self.state.begin(now, 0.0, 0.0)
        check = FlaggedCheck(HULLS, MOTION.isotropic, self.state)
        return self.certificates.extend(check, np.array(pairs), now, tick, math.inf)

    def see(self, stamp, x, name="ball", v=0.0, radius=0.1, **fields):
        self.obstacles.update(
            [name], stamp, [[x, 0.0, 0.0]], [[v, 0.0, 0.0]], radius=radius, **fields
        )
        return self.obstacles.row(name)


def pairs_of(row):
    return [row * LINKS + link for link in range(LINKS)]


def test_rows_that_come_and_go():
    scene = Scene()
    row = scene.see(0.0, 3.0)
    fresh, gone = scene.follow()
    assert (fresh.tolist(), gone.tolist()) == (pairs_of(row), [])
    assert scene.certificates.pairs.tolist() == pairs_of(row)
    scene.obstacles.remove(["ball"])
    fresh, gone = scene.follow()
    assert (fresh.tolist(), gone.tolist()) == ([], pairs_of(row))
    assert scene.earliest(0.0, 1) == (NOBODY, math.inf, 0)


def test_a_row_with_another_occupant_starts_anew():
    scene = Scene()
    row = scene.see(0.0, 3.0)
    fresh, _ = scene.follow()
    scene.enter(fresh)
    assert scene.earliest(0.0, scene.tick)[2] == 0
    scene.obstacles.remove(["ball"])
    assert scene.see(0.1, 0.5, name="other") == row
    fresh, gone = scene.follow()
    assert fresh.tolist() == gone.tolist() == pairs_of(row)
    pair, time, overdue = scene.earliest(0.1, scene.tick + 1)
    assert (pair, time, overdue) == (pairs_of(row)[0], 0.0, LINKS)
    assert scene.disturbed() == ([], [])


def test_doubt_touches_all_pairs_once():
    scene = Scene()
    scene.see(0.0, 3.0)
    fresh, _ = scene.follow()
    scene.enter(fresh)
    assert scene.disturbed() == ([], [])
    scene.certificates.invalidate_all()
    assert scene.disturbed() == (fresh.tolist(), [])
    assert scene.disturbed() == ([], [])


def test_pairs_that_nobody_watches():
    scene = Scene(lambda row: np.array([True, False, True]))
    row = scene.see(0.0, 3.0)
    fresh, _ = scene.follow()
    assert fresh.tolist() == [pairs_of(row)[0], pairs_of(row)[2]]
    scene.obstacles.remove(["ball"])
    assert scene.follow()[1].tolist() == fresh.tolist()


def test_the_table_may_grow_for_rows_that_never_were():
    scene = Scene()
    row = scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    names = [f"brief{i}" for i in range(200)]
    scene.obstacles.update(names, 0.1, np.full((200, 3), 9.0), radius=0.1)
    scene.obstacles.remove(names)
    assert all(len(part) == 0 for part in scene.follow())
    assert scene.disturbed() == ([], [])
    assert scene.see(0.2, -3.0) == row
    scene.disturbed()


def test_a_clear_ledger_knows_nothing():
    scene = Scene()
    scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    scene.certificates.clear()
    assert scene.earliest(0.0, 1) == (NOBODY, math.inf, 0)
    scene.obstacles.start_watching()
    fresh, gone = scene.follow()
    assert (len(fresh), len(gone)) == (LINKS, 0)
    assert scene.earliest(0.0, 1)[2] == LINKS


@given(st.floats(0.0, 1e7), st.floats(0.0, 1e4), st.floats(0.0, 1e4))
def test_deadlines_are_never_late(now, contact_time, wait):
    """Also where time is far from its epoch: what is left never exceeds what was proved."""
    scene = Scene(keeps_certificates=False)
    scene.see(0.0, 3.0)
    pairs, _ = scene.follow()
    scene.enter(pairs, contact_time, now)
    later = now + wait
    _, left, overdue = scene.earliest(later, scene.tick + 1)
    exact = Fraction(now) + Fraction(contact_time) - Fraction(later)
    assert Fraction(left) <= max(exact, Fraction(0))
    assert left >= float(exact) - 1e-14 * (now + contact_time + 1.0)
    assert overdue == (LINKS if left == 0.0 else 0)


def test_never_stays_never():
    scene = Scene()
    scene.see(0.0, 3.0)
    pairs, _ = scene.follow()
    scene.enter(pairs, math.inf)
    assert scene.earliest(7.0, scene.tick)[1] == math.inf


def test_the_earliest_of_all_certificates_counts():
    scene = Scene()
    scene.see(0.0, 3.0)
    pairs, _ = scene.follow()
    scene.enter(pairs, 5.0)
    scene.enter(pairs[1:2], 2.0)
    pair, time, overdue = scene.earliest(1.0, 9)
    assert pair == pairs[1]
    assert time == pytest.approx(1.0)
    assert overdue == 0
    assert scene.earliest(2.0, 9)[2] == 1
    # A look in this very tick is not overdue, whatever it found.
    assert scene.earliest(2.0, scene.tick)[2] == 0
    scene.certificates.invalidate(pairs)
    assert scene.earliest(0.0, 9)[1:] == (0.0, LINKS)


def test_motion_within_bounds_disturbs_nothing():
    scene = Scene()
    scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    for i in range(1, 50):
        t = 0.01 * i
        scene.see(
            t,
            3.0 + 0.5 * 9.9 * t * t if t < 0.2 else 3.198 + 1.98 * (t - 0.2),
            v=min(9.9 * t, 1.98),
        )
        assert scene.obstacles.take_faults() == []
        assert scene.disturbed(t) == ([], [])


@pytest.mark.parametrize("change", [{"position_error": 0.01}, {"velocity_error": 0.1}])
def test_a_vaguer_sample_takes_nothing_from_certificates(change):
    """What was known before holds on, and the sample says nothing against it."""
    scene = Scene()
    scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    scene.see(0.1, 3.0, **change)
    assert scene.obstacles.take_faults() == []
    assert scene.disturbed() == ([], [])


@pytest.mark.parametrize(
    "change",
    [
        {"radius": 0.2},
        {"accel": 11.0},
        {"speed": 2.1},
    ],
    ids=lambda change: next(iter(change)),
)
def test_growth_is_no_broken_bound(change):
    scene = Scene()
    row = scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    scene.see(0.1, 3.0, **change)
    assert scene.obstacles.take_faults() == []
    assert scene.disturbed() == (pairs_of(row), [])
    # Told once; a look would renew the ground, and shrinking needs none.
    scene.enter(np.array(pairs_of(row)))
    scene.see(0.2, 3.0)
    assert scene.disturbed() == ([], [])
    scene.see(0.3, 3.0, **change)
    assert scene.disturbed() == ([], [])


def test_bounds_that_grow_back_after_a_look_at_smaller_ones():
    scene = Scene()
    row = scene.see(0.0, 3.0, radius=0.5)
    pairs, _ = scene.follow()
    scene.enter(pairs, 0.01)
    scene.see(0.1, 3.0, radius=0.1)
    assert scene.disturbed() == ([], [])
    scene.check(pairs_of(row)[1:2], 0.1, 2)
    assert scene.certificates.bound[pairs_of(row)].tolist() == [ISOTROPIC, DISTANCE, ISOTROPIC]
    scene.see(0.2, 3.0, radius=0.5)
    assert scene.disturbed() == ([pairs_of(row)[1]], [])


def test_an_extension_that_adds_nothing_leaves_the_older_proof():
    scene = Scene()
    row = scene.see(0.0, 3.0, radius=0.5)
    pairs, _ = scene.follow()
    scene.enter(pairs, 5.0)
    scene.see(0.1, 3.0, radius=0.1)
    scene.disturbed()
    scene.check(pairs_of(row)[:1], 0.1, 2)
    assert (scene.certificates.bound[pairs_of(row)] == ISOTROPIC).all()
    assert scene.earliest(0.1, 2)[1] == pytest.approx(4.9)
    scene.see(0.2, 3.0, radius=0.5)
    assert scene.disturbed() == ([], [])


def test_a_state_may_be_inside_the_last_one_and_outside_an_older_one():
    """Each step is plausible by itself, all together are not: the reference state tells."""
    scene = Scene(accel=10.0, speed=2.0)
    row = scene.see(0.0, 3.0, position_error=0.05)
    pairs, _ = scene.follow()
    scene.enter(pairs)
    broken = []
    for i in range(1, 12):
        scene.see(0.001 * i, 3.0 - 0.09 * i, position_error=0.05)
        assert scene.obstacles.take_faults() == []
        broken = scene.disturbed(0.001 * i)[1]
        if broken:
            break
    assert broken == pairs_of(row)
    assert i == 2


def test_a_refused_sample_grows_and_a_new_track_breaks():
    scene = Scene()
    row = scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    for i in range(1, 5):
        scene.see(0.01 * i, 1.0)
        assert scene.disturbed() == (pairs_of(row), [])
        scene.enter(np.array(pairs_of(row)))
    scene.see(0.05, 1.0)
    assert scene.disturbed() == ([], pairs_of(row))


def test_the_first_state_after_refused_ones_breaks_nothing():
    scene = Scene()
    row = scene.see(0.0, math.nan)
    scene.enter(scene.follow()[0], 0.0)
    assert scene.disturbed() == (pairs_of(row), [])
    scene.see(0.1, 3.0)
    assert scene.disturbed() == (pairs_of(row), [])


def test_a_distrusted_state_is_looked_at_again():
    scene = Scene()
    row = scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    scene.obstacles.distrust(row)
    assert scene.disturbed() == (pairs_of(row), [])
    scene.enter(np.array(pairs_of(row)), 0.0)
    scene.see(0.1, 0.7)
    assert scene.disturbed() == (pairs_of(row), [])


def test_statics_are_never_disturbed():
    scene = Scene()
    scene.obstacles.add_static("table", [1.0, 0.0, 0.0], 0.1)
    scene.enter(scene.follow()[0])
    assert scene.disturbed(1e6) == ([], [])


def test_pairs_never_looked_at_cannot_be_disturbed():
    scene = Scene()
    scene.see(0.0, 3.0)
    scene.follow()
    scene.see(0.1, 3.0, radius=0.5)
    assert scene.disturbed() == ([], [])
    assert scene.earliest(0.0, 1)[1:] == (0.0, LINKS)


def test_reference_states_of_balls_and_boxes_side_by_side():
    """A box that comes later gives every reference state more room; those of balls still hold."""
    scene = Scene()
    ball = scene.see(0.0, 3.0)
    scene.enter(scene.follow()[0])
    points = np.random.default_rng(0).normal(size=(1, 8, 3)) + 5.0
    still = np.zeros((1, 8, 3))
    scene.obstacles.update(["box"], 0.0, points, still, radius=0.1)
    fresh, _ = scene.follow()
    scene.see(0.01, 3.0)
    assert scene.disturbed() == ([], [])
    scene.enter(fresh)
    box = scene.obstacles.row("box")
    assert fresh.tolist() == pairs_of(box)
    scene.obstacles.update(["box"], 0.02, points, still, radius=0.1)
    assert scene.disturbed() == ([], [])
    scene.obstacles.update(["box"], 0.04, points, still, radius=0.2)
    assert scene.disturbed() == (pairs_of(box), [])
    scene.enter(fresh)
    for i in range(5):
        moved = points.copy()
        moved[0, 7] += 1.0
        scene.obstacles.update(["box"], 0.05 + 0.01 * i, moved, still, radius=0.2)
    assert scene.disturbed() == ([], pairs_of(box))
    scene.see(0.1, 3.0, radius=0.3)
    assert scene.disturbed() == (pairs_of(ball), [])
