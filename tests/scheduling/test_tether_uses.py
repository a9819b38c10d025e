"""When a tether is broken, and when what was proved by one ends."""

import copy

import numpy as np
import pytest

from armguard import Obstacles
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.table import make_states
from armguard.obstacles.tethers import TIED
from armguard.scheduling.tether_uses import CERTIFICATE, USES, find_excess, make_uses, resize_uses
from armguard.verdict import ReasonKind
from support.panda_monitor import HOME, STILL, make_monitor, subjects

PERIOD = 2e-3
LENGTH = 0.35
SHOULDER = np.array([1.3, 0.0, 0.6])
ELBOW = np.array([1.0, 0.0, 0.6])


def beside(away):
    """A place beside the shoulder, in [m] from there."""
    return SHOULDER + np.array([away, 0.0, 0.0])


def fill(states, points, stamp, *, error=0.0, accel=0.0, speed=0.0):
    points = np.atleast_2d(points)
    states.points[0, : len(points)] = points
    states.velocities[0] = 0.0
    states.point_count[0] = len(points)
    states.accel[0], states.speed[0], states.stamp[0] = accel, speed, stamp
    states.position_error[0], states.velocity_error[0] = error, speed
    return states


def test_bodies_are_too_far_apart_only_where_no_motion_within_bounds_and_errors_explains_it():
    rng = np.random.default_rng(5)
    beyond = 0
    for _ in range(4000):
        count = int(rng.choice([1, 2, 8]))
        accel, speed = rng.uniform(0.0, 20.0, 2), rng.uniform(0.0, 3.0, 2)
        length, gap = rng.uniform(0.0, 0.5), rng.uniform(-0.05, 0.05) * rng.integers(0, 2)
        errors = rng.uniform(0.0, 0.02, 2)
        hull = rng.uniform(-0.5, 0.5, (count, 3))
        weights = rng.dirichlet(np.ones(count))
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        # In truth the point is as far from one of the hull's as the tether allows.
        point = weights @ hull + length * direction
        # The other one moves at full speed until it is measured, and both measurements are off.
        moved = speed[1] * abs(gap) if rng.random() < 0.5 else 0.0
        seen = point + direction * (moved + errors[1])
        one = fill(make_states(1, 8), hull - direction * errors[0], 1.0, error=errors[0],
                   accel=accel[0], speed=3.0)  # fmt: skip
        other = fill(make_states(1, 8), seen, 1.0 + gap, error=errors[1], accel=accel[1],
                     speed=speed[1])  # fmt: skip
        assert find_excess(one, 0, other, 0, length) == 0.0
        far = other._replace(points=other.points + 1e-3 * direction)
        beyond += find_excess(one, 0, far, 0, length) > 0.0
    assert beyond > 300, "it is not idle"


def test_a_body_without_a_state_contradicts_nothing():
    none, other = make_states(1, 2), fill(make_states(1, 2), [5.0, 0.0, 0.0], 0.0)
    assert find_excess(none, 0, other, 0, 0.1) == 0.0


def test_uses_are_kept_when_room_is_made():
    uses = make_uses(2, 1)
    uses.partner[USES], uses.length[USES] = 1, 0.3
    uses.states.points[USES], uses.states.point_count[USES] = [[1.0, 2.0, 3.0]], 1
    more = resize_uses(uses, 8, 4)
    assert more.partner.tolist() == [*uses.partner.tolist(), *[NO_PARTNER] * (6 * USES)]
    assert more.length[USES] == 0.3
    assert more.states.points[USES, 0].tolist() == [1.0, 2.0, 3.0]


class Scene:
    """A shoulder that stands, and an elbow that is hidden from the second sample on."""

    def __init__(self, length=LENGTH, **settings):
        self.obstacles = Obstacles()
        self.obstacles.tether("elbow", "shoulder", length, "measured")
        _, self.monitor = make_monitor(
            obstacles=self.obstacles, rate=1.0 / PERIOD, operating="published", **settings
        )
        self.now = 0.0
        self.see(SHOULDER, ELBOW)
        self.step()
        for _ in range(60):
            self.now += PERIOD
            self.see(SHOULDER)
            self.step()
        self.row, self.partner = self.obstacles.row("elbow"), self.obstacles.row("shoulder")

    elbow_bounds = (10.0, 2.0)

    def see(self, shoulder=None, elbow=None, *, stamp=None, radius=0.08, **bounds):
        fields = {"accel": 2.0, "speed": 0.0, "position_error": 0.01, "velocity_error": 0.0}
        for name, place in (("shoulder", shoulder), ("elbow", elbow)):
            if place is not None:
                own = dict(zip(("accel", "speed"), self.elbow_bounds, strict=True))
                told = fields | (bounds if name == "shoulder" else own)
                self.obstacles.update(
                    [name], self.now if stamp is None else stamp, [place], [[0.0, 0.0, 0.0]],
                    radius=radius, **told,
                )  # fmt: skip

    def step(self):
        self.verdict = self.monitor.step(self.now, HOME, STILL)
        return self.verdict

    def tick(self, shoulder=None, elbow=None, **fields):
        self.now += PERIOD
        self.see(shoulder, elbow, **fields)
        return self.step()

    @property
    def is_used(self):
        """Whether the elbow's certificates rest on the shoulder."""
        uses = self.monitor._scheduler.certificates.uses
        return bool(uses.partner[self.row * USES + CERTIFICATE] == self.partner)

    @property
    def is_fresh(self):
        """Whether the elbow was evaluated in the last tick."""
        evaluated_at = self.monitor._scheduler.certificates.evaluated_at
        return bool(abs(evaluated_at[self.row] - self.now) < 0.5 * PERIOD)


def test_a_hidden_elbow_is_judged_by_its_shoulder():
    scene = Scene()
    assert scene.is_used
    assert not scene.is_fresh
    contact = scene.verdict.contact_time
    for _ in range(200):
        scene.tick(SHOULDER)
        assert scene.verdict.contact_time > 0.7 * contact


@pytest.mark.parametrize(
    ("change", "ends"),
    [
        (lambda scene: scene.tick(beside(0.005)), False),
        (lambda scene: scene.tick(SHOULDER, position_error=0.04), False),
        (lambda scene: scene.tick(SHOULDER, ELBOW), False),
        (lambda scene: scene.tick(beside(0.1)), True),
        (lambda scene: scene.tick(SHOULDER, radius=0.09), True),
        (lambda scene: scene.tick(SHOULDER, accel=3.0), True),
        (lambda scene: scene.tick(SHOULDER, speed=0.1), True),
        (lambda scene: scene.tick([np.nan, 0.0, 0.0]), True),
        (lambda scene: (scene.obstacles.remove(["shoulder"]), scene.tick()), True),
        (lambda scene: (scene.obstacles.untether("elbow", "shoulder"), scene.tick(SHOULDER)), True),
        (lambda scene: (scene.obstacles.tether("elbow", "shoulder", 0.4, "?"), scene.tick()), True),
        (lambda scene: (scene.see(SHOULDER, stamp=scene.now + 1e-3), scene.tick(SHOULDER)), True),
        (lambda scene: (scene.obstacles.distrust(scene.partner), scene.tick()), True),
    ],
)
def test_what_was_proved_by_a_tether_ends_with_its_premises(change, ends):
    scene = Scene()
    assert scene.is_used
    assert not scene.is_fresh
    change(scene)
    assert scene.is_fresh is ends


def test_a_proof_rests_on_the_state_that_it_was_made_of_and_not_on_a_newer_one():
    """Each state of the shoulder agrees with the one before, and the last not with the first."""
    for drift, ends in ((0.0075, False), (0.018, True)):
        scene = Scene()
        assert scene.is_used
        scene.tick(beside(drift))
        assert not scene.is_fresh
        # The shoulder is evaluated anew: its own certificates rest on what was seen last.
        scene.monitor._scheduler.watch_anew(np.array([scene.partner]))
        scene.tick()
        assert not scene.is_fresh
        reference = scene.obstacles.table.reference_states.points[scene.partner, 0, 0]
        assert reference == SHOULDER[0] + drift
        verdict = scene.tick(beside(2.0 * drift))
        assert not subjects(verdict, ReasonKind.OBSTACLE_REFUSED)
        assert not subjects(verdict, ReasonKind.BOUND_BROKEN)
        assert scene.is_fresh is ends


def test_a_proof_by_a_tether_survives_a_growing_table():
    scene = Scene()
    ids = [f"far {number}" for number in range(100)]
    scene.now += PERIOD
    scene.obstacles.update(ids, scene.now, [[50.0, 0.0, 0.0]] * 100, radius=0.1)
    scene.see(SHOULDER)
    scene.step()
    assert scene.is_used
    scene.tick(beside(0.1))
    assert scene.is_fresh


def test_two_that_are_seen_too_far_apart_break_their_tether_until_they_agree_for_a_while():
    scene = Scene()
    assert not subjects(scene.verdict, ReasonKind.TETHER_BROKEN)
    far = beside(LENGTH + 0.05)
    scene.obstacles.remove(["elbow"])
    scene.tick(SHOULDER)
    verdict = scene.tick(SHOULDER, far)
    assert subjects(verdict, ReasonKind.TETHER_BROKEN) == {"elbow and shoulder"}
    (detail,) = [one.detail for one in verdict.reasons if one.kind is ReasonKind.TETHER_BROKEN]
    assert detail == "30 mm farther apart than 0.35 m (measured)"
    row = scene.obstacles.row("elbow")
    assert row == scene.row
    # Hidden again: it is named still, and nothing is judged by the shoulder.
    for _ in range(400):
        verdict = scene.tick(SHOULDER)
        assert subjects(verdict, ReasonKind.TETHER_BROKEN)
        assert not scene.is_used
    # A sample that agrees is no proof yet; those of 0.3 s are.
    scene.obstacles.remove(["elbow"])
    verdict = scene.tick(SHOULDER)
    assert not subjects(verdict, ReasonKind.TETHER_BROKEN), "one of them is gone"
    told = []
    for _ in range(170):
        verdict = scene.tick(SHOULDER, ELBOW)
        told.append(bool(subjects(verdict, ReasonKind.TETHER_BROKEN)))
    assert 150 <= sum(told) <= 152
    assert told == sorted(told, reverse=True)
    for _ in range(100):
        scene.tick(SHOULDER)
    assert scene.is_used


def test_what_breaks_again_while_it_mends_takes_as_long_again():
    scene = Scene()
    scene.obstacles.remove(["elbow"])
    scene.elbow_bounds = np.inf, np.inf
    told = []
    for away in [-0.45] + [-0.40] * 3 + [-0.35] * 100 + [-0.40] + [-0.35] * 200:
        verdict = scene.tick(SHOULDER, beside(away))
        told.append(bool(subjects(verdict, ReasonKind.TETHER_BROKEN)))
    assert told[0]
    assert 100 + 150 < sum(told) < 100 + 160, sum(told)


def test_tethers_of_a_monitor_cost_no_memory_in_a_tick():
    scene = Scene()
    tethers = scene.obstacles.table.tethers
    assert tethers.numbers[TIED] == 1
    before = [
        array.ctypes.data
        for array in (*tethers, scene.monitor._scheduler.certificates.uses.partner)
    ]
    for _ in range(50):
        scene.tick(SHOULDER)
    tethers = scene.obstacles.table.tethers
    after = [
        array.ctypes.data
        for array in (*tethers, scene.monitor._scheduler.certificates.uses.partner)
    ]
    assert before == after
    assert copy.deepcopy(scene.obstacles).tethers == scene.obstacles.tethers
