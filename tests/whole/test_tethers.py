"""No contact with what is tethered comes before it was said: exact geometry, and a world at war.

In each case of the law a link stands still, and two tethered bodies may be wherever their errors
and bounds let them. In the world people of three tethered parts attack an arm that moves: their
parts are hidden at times, they know when, and they keep to their bounds and tethers exactly.
"""

import math
import os

import numpy as np
import pytest

from armguard import ContactLimit, ContactLimits, Obstacles, Plan
from armguard.contact.certificate import verify
from armguard.jit.kernels import kernel
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.tethers import TIED
from armguard.pairs.contact_time import arm_reach_time, pair_time, partner_of
from armguard.pairs.scene import prepare_arm
from armguard.verdict import ReasonKind
from support import true_arm
from support.example_arms import load_holding
from support.panda_monitor import HOME, STILL, make_monitor, panda
from support.tethered_people import TetheredHunt, TetheredPlanHunt

CASES = int(os.environ.get("ARMGUARD_TETHER_CASES", "30000"))
"""Of the law; a hundred thousand take half a minute."""


@kernel
def _can_touch(place, states, row, h, reach):
    """Whether a body that was measured h seconds ago can surely be within reach of a place.

    It was off by all that it may be, and accelerates evenly since.
    """
    along = np.zeros(3)
    distance = 0.0
    for axis in range(3):
        there = states.points[row, 0, axis] + states.velocities[row, 0, axis] * h
        along[axis] = place[axis] - there
        distance += along[axis] ** 2
    distance = math.sqrt(distance)
    error = states.velocity_error[row]
    lacks = distance - reach - states.position_error[row]
    if lacks <= 0.0:
        return True
    faster = min(error, lacks / h)
    rate = max(2.0 * (lacks - faster * h) / (h * h), 0.0)
    at_first = at_last = 0.0
    for axis in range(3):
        velocity = states.velocities[row, 0, axis] + faster * along[axis] / distance
        at_first += velocity**2
        at_last += (velocity + rate * h * along[axis] / distance) ** 2
    fastest = math.sqrt(max(at_first, at_last))
    return rate <= states.accel[row] and fastest <= states.speed[row]


@kernel
def count_misses(handle, q, v, places, link, rows, length, cases, random):
    """Cases in which a contact can come before it was said, and what else was seen of them."""
    scene = handle.content
    prepare_arm(scene, q, v, 0.0)
    bodies, now, middle = scene.bodies, 0.0, places[0]
    misses = sooner = used = later = 0
    for _ in range(cases):
        scene.tethers.length[0] = length * random.random()
        for k in range(2):
            row = rows[k]
            speed = random.uniform(0.1, 3.0)
            bodies.accel[row], bodies.speed[row] = random.uniform(1.0, 40.0), speed
            bodies.radius[row] = random.uniform(0.0, 0.1)
            bodies.position_error[row] = random.uniform(0.0, 0.03)
            bodies.velocity_error[row] = random.uniform(0.0, 0.3)
            bodies.stamp[row] = -random.uniform(0.0, 0.3)
            square = 0.0
            for axis in range(3):
                bodies.velocities[row, 0, axis] = random.uniform(-1.0, 1.0)
                square += bodies.velocities[row, 0, axis] ** 2
            for axis in range(3):
                bodies.velocities[row, 0, axis] *= 0.9 * speed * random.random() / math.sqrt(square)
        first, second = rows[0], rows[1]
        for axis in range(3):
            bodies.points[first, 0, axis] = middle[axis] + random.uniform(-1.2, 1.2)
            offset = scene.tethers.length[0] * random.uniform(-0.57, 0.57)
            bodies.points[second, 0, axis] = bodies.points[first, 0, axis] + offset
        radius = bodies.radius[second]
        floor, _ = arm_reach_time(scene, second, now)
        time, _, _, _ = pair_time(scene, link, second, now, 0.0, floor, 2.0, np.inf)
        scene.tethers.numbers[TIED] = 0
        alone, _, _, _ = pair_time(scene, link, second, now, 0.0, floor, 2.0, np.inf)
        scene.tethers.numbers[TIED] = 1
        partner = partner_of(scene, second, now, 2.0).row != NO_PARTNER
        used += partner
        # The first time at which some place of the link can be within both reaches.
        first_time = np.inf
        for number in range(100):
            t = number * 0.01
            h0, h1 = t - bodies.stamp[first], t - bodies.stamp[second]
            touches = False
            for p in range(places.shape[0]):
                touches = _can_touch(
                    places[p], bodies, first, h0, scene.tethers.length[0] + radius
                ) and _can_touch(places[p], bodies, second, h1, radius)
                if touches:
                    break
            if touches:
                first_time = t
                break
        misses += time > first_time
        sooner += time < alone
        later += time > 1.1 * alone
    return misses, sooner, used, later


def test_no_place_of_a_link_is_within_both_reaches_before_the_contact_time():
    obstacles = Obstacles(sources=[])
    obstacles.tether("a", "b", 0.5, "drawn")
    _, monitor = make_monitor(obstacles=obstacles)
    obstacles.update(["a", "b"], 0.0, [[1.0, 0.0, 0.5]] * 2, [[0.0] * 3] * 2, radius=0.1)
    monitor.step(0.0, HOME, STILL)
    scheduler = monitor._scheduler
    robot = panda()
    scheduler._place(-7, HOME)
    link = len(robot.links) - 1
    places = find_places(link)
    rows = np.array([obstacles.row("a"), obstacles.row("b")])
    random = np.random.default_rng(3)
    misses, sooner, used, later = count_misses(
        scheduler.arm.state.handle, HOME, STILL, places, link, rows, 0.5, CASES, random
    )
    assert (misses, sooner) == (0, 0)
    assert used > 0.2 * CASES
    assert later > 0.1 * CASES, "tethers decide"


def find_places(link):
    """Some points of a link's true surface, in [m]. Shape (m, 3)."""
    arm = true_arm.make_skeleton(panda())
    room = true_arm.make_room(arm)
    true_arm.place_leaves(arm, HOME, *room)
    return np.array(
        [
            true_arm.get_point(arm, *room[:2], leaf, index)
            for leaf in np.flatnonzero(arm.link == link)
            for index in range(arm.first[leaf], arm.first[leaf + 1], 8)
        ]
    )


@pytest.mark.hazard("H-02")
@pytest.mark.parametrize(
    ("seed", "settings"),
    [(1, {}), (3, {"close": True}), (5, {"rate": 250.0, "latency": 0.004}), (6, {"budget": 200})],
)
def test_people_with_hidden_parts_are_never_missed(seed, settings):
    hunt = TetheredHunt(panda(), seed, **settings)
    score = hunt.run(1.5e5)
    found = score.missed, score.hits, score.early, score.too_fast, score.faults
    assert found == (0, 0, 0, 0, 0), score
    assert hunt.used > 0.3 * score.ticks, "tethers decide"
    assert score.goes > 0.05 * score.ticks
    assert score.worst < 0.6


def test_people_find_what_is_wrong():
    """Else the test above would prove nothing: here tethers are told that are too short."""
    score = TetheredHunt(panda(), 11, 3, close=True, told=0.2).run(6e5)
    assert score.missed + score.early > 0


@pytest.mark.parametrize(("leave", "seed"), [("never", 3), ("any", 2)])
def test_an_arm_on_pieces_touches_nothing_that_is_hidden_and_tethered(leave, seed):
    hunt = TetheredPlanHunt(load_holding("panda"), seed, latency=0.1, leave=leave)
    for _ in range(12):
        hunt.play()
    score = hunt.score
    assert score.contacts == score.astray == 0
    assert min(score.safe, score.followed) > 50
    assert min(score.balls, score.near, hunt.used) > 0


def test_tethers_let_the_arm_go_on():
    goes = [TetheredHunt(panda(), 2, told=told).run(2e5).goes for told in (None, 1.0)]
    assert goes[1] > 1.1 * goes[0]


RATE = 500.0


class Person:
    """A shoulder that is seen, and an elbow that is hidden since some time, beside an arm."""

    def __init__(self, *, tethered=True, hidden_for=0.3, elbow=1.0, **settings):
        self.obstacles = Obstacles()
        if tethered:
            self.obstacles.tether("elbow", "shoulder", 0.36, "measured")
        _, self.monitor = make_monitor(
            obstacles=self.obstacles, rate=RATE, operating="published", **settings
        )
        self.tick = 0
        self.elbow = elbow
        for number in range(int(hidden_for * RATE)):
            self.step(sees_elbow=number == 0)

    def step(self, shoulder=1.3, *, sees_elbow=False):
        now = self.tick / RATE
        places = {"shoulder": shoulder} | ({"elbow": self.elbow} if sees_elbow else {})
        for name, x in places.items():
            self.obstacles.update(
                [name], now, [[x, 0.0, 0.6]], [[0.0] * 3], radius=0.08, position_error=0.01,
                velocity_error=0.05, region="hand" if name == "elbow" else "",
            )  # fmt: skip
        self.tick += 1
        self.verdict = self.monitor.step(now, HOME, STILL)
        return self.verdict


def make_piece(now):
    """From rest to rest within 0.1 s, by the first joint alone."""
    times = np.linspace(0.0, 0.1, 11)
    q, v = np.tile(HOME, (11, 1)), np.zeros((11, 7))
    angle = np.pi * times / times[-1]
    q[:, 0] += 0.002 * (1.0 - np.cos(angle))
    v[:, 0] = 0.002 * np.pi / times[-1] * np.sin(angle)
    return Plan(now, times, q, v, np.full(7, 2e-3), np.full(7, 0.02))


def test_pieces_are_committed_beside_a_hidden_part_and_judged_anew_when_its_tether_is_lost():
    person = Person(tethered=False, motion="planned")
    now = (person.tick - 1) / RATE
    assert not person.monitor.commit(make_piece(now)).safe

    def lose_none(person):
        person.step()

    def contradict(person):
        person.step(shoulder=1.1)

    def end(person):
        person.obstacles.untether("elbow", "shoulder")
        assert not person.monitor.commit(make_piece((person.tick - 1) / RATE)).safe, "step first"
        person.step()

    for change, stays in ((lose_none, True), (contradict, False), (end, False)):
        person = Person(motion="planned")
        assert person.monitor.commit(make_piece((person.tick - 1) / RATE)).safe
        change(person)
        told = {reason.kind for reason in person.verdict.reasons}
        assert (ReasonKind.PIECE_UNSAFE not in told) == stays, person.verdict.reasons


def test_a_part_keeps_its_own_contact_limit_when_it_is_judged_by_another_one():
    limits = ContactLimits({"hand": ContactLimit(speed=0.5, source="assumed")})
    levels = []
    for settings in ({"contact_limits": limits}, {}):
        person = Person(hidden_for=0.2, elbow=0.75, **settings)
        levels.append(person.verdict.level)
        assert np.isfinite(person.verdict.contact_time)
    assert levels[0] >= levels[1]


def test_the_certificate_of_a_verdict_proves_what_a_partner_shows():
    proved = []
    for tethered in (False, True):
        person = Person(tethered=tethered, certify=True)
        certificate = person.verdict.certificate
        assert verify(certificate, **person.monitor.certificate_inputs)
        proved.append(certificate.contact_time)
    assert proved[1] > proved[0]


def test_what_is_told_of_a_hidden_part_knows_of_its_tether():
    person = Person()
    (reason,) = [one for one in person.verdict.reasons if one.kind is ReasonKind.CONTACT]
    assert reason.subject.endswith("elbow")
    assert reason.detail.endswith(", as it is tethered to shoulder")
    told = person.monitor.explain()
    assert told.obstacle == "elbow"
    assert told.contact_time * 0.99 < told.fresh_contact_time < 1.6 * told.contact_time
    assert person.monitor.attention()
    assert person.monitor.headroom().evaluations >= 0.0
    alone = Person(tethered=False)
    assert alone.monitor.explain().fresh_contact_time < told.fresh_contact_time
