"""Contact that is wanted for the time being, and nothing beyond it: arms that obey, and bodies."""

import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.exceptions import ArmguardError
from armguard.messages.incoming import IgnoreMessage, WatchMessage
from armguard.obstacles import Obstacles, Source
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, STILL, kinds, make_monitor, panda, subjects
from support.told_journal import Journal

PERIOD = 2e-3
PACE = 0.8
"""Of the first joint, which carries the arm round its base, in [rad]/[s]."""
KINEMATICS = Kinematics(panda())
EXACT = HullDistance(panda(), KINEMATICS)
LINKS = range(len(panda().links))
BOX = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [0.0, 1.0])).reshape(3, 8).T


def round_to(angle):
    return HOME + angle * np.eye(7)[0]


def hand_at(angle):
    """Where the middle of the hand is, in [m], turned so far about the base."""
    KINEMATICS.compute(round_to(angle), STILL)
    link = panda().links.index("panda_hand")
    pose = KINEMATICS.data.oMi[EXACT.joints[link]]
    return EXACT.vertices[link].mean(axis=0) @ pose.rotation.T + pose.translation


def distance(angle, place, radius):
    KINEMATICS.compute(round_to(angle), STILL)
    return min(EXACT.distance(link, [place], radius)[0] for link in LINKS)


class Swing:
    """An arm that turns about its base, and brakes as late and as gently as it may after a STOP."""

    def __init__(self, monitor):
        self.monitor = monitor
        self.angle, self.rate, self.brakes_at = 0.0, PACE, np.inf
        settings = monitor.settings
        self._delay = settings.latency + settings.reaction_time
        self._slowing = float(panda().braking_deceleration[0])
        self.verdicts = []

    def step(self, tick):
        verdict = self.monitor.step(tick * PERIOD, round_to(self.angle), self.rate * np.eye(7)[0])
        self.verdicts.append(verdict)
        if verdict.level is Level.STOP:
            self.brakes_at = min(self.brakes_at, tick * PERIOD + self._delay)
        # Substeps: brakes bite in the middle of a tick.
        for part in range(10):
            if tick * PERIOD + part * PERIOD / 10 >= self.brakes_at:
                self.rate = max(0.0, self.rate - self._slowing * PERIOD / 10)
            self.angle += self.rate * PERIOD / 10
        return verdict


FIXTURE = hand_at(0.9)
"""In the way of the hand, which reaches it after some 0.7 s."""
RADIUS = 0.05


def exempt_all(monitor, ids, **until):
    """Every link: whatever else touches first would end the test early."""
    return [monitor.ignore(link, ids, **until) for link in panda().links]


@pytest.fixture(scope="module")
def cell():
    """One monitor for all, which takes a while to make."""
    obstacles = Obstacles(sources=[Source("mover", required=False, timeout=1e9)])
    obstacles.add_static("fixture", FIXTURE, RADIUS)
    # After a reset levels rise at once, so that the arm of the next test may move.
    _, monitor = make_monitor(obstacles=obstacles, rate=1.0 / PERIOD, rise_delay=0.0)
    return obstacles, monitor


def fresh(cell):
    obstacles, monitor = cell
    for one in monitor.exemptions:
        monitor.watch(one.number)
    monitor.reset()
    return obstacles, monitor


def test_contact_is_let_be_before_its_time_and_the_arm_rests_at_it(cell):
    """By times before the arm would be at the fixture, while it would, and after."""
    _, monitor = cell
    found = []
    for until in (0.0, 1.1, 1.6, 2.4):
        fresh(cell)
        if until > 0.0:
            exempt_all(monitor, "fixture", until=until)
        swing, touched = Swing(monitor), False
        assert distance(swing.angle, FIXTURE, RADIUS) > 0.1
        for tick in range(1100):
            now = tick * PERIOD
            if swing.rate == 0.0:
                # An arm that rests moves nothing, whatever it touches.
                break
            if distance(swing.angle, FIXTURE, RADIUS) <= 0.0:
                assert now < until
                touched = True
            verdict = swing.step(tick)
            if now + verdict.stop_time > until:
                assert ReasonKind.PAIR_IGNORED not in kinds(verdict)
            assert not any("JOINT" in kind.name for kind in kinds(verdict))
        found.append((touched, swing.rate == 0.0))
    assert [rests for _, rests in found] == [True, True, True, False]
    assert not found[0][0]
    assert found[2][0]


@pytest.mark.parametrize("rate", [0.0, PACE])
def test_a_pair_is_watched_as_soon_as_an_arm_that_keeps_to_a_scale_might_rest_too_late(cell, rate):
    """It is told to stop at the end of that scale, not by the next verdict already."""
    _, monitor = fresh(cell)
    until, told = 1.0, []
    monitor.ignore("panda_hand", "fixture", until=until)
    for tick in range(500):
        now = tick * PERIOD
        verdict = monitor.step(now, round_to(rate * now), rate * np.eye(7)[0])
        rests_at = now + monitor._last[0].late_stop_time
        assert rests_at > now + verdict.stop_time
        assert (ReasonKind.PAIR_IGNORED in kinds(verdict)) == (rests_at < until)
        told.append(rests_at < until)
    assert any(told)
    assert not all(told)


def test_an_obstacle_that_leaves_its_zone_is_watched_before_it_can_be_touched(cell):
    """It sets off when it likes, within its bounds, to be in the way of an arm that swings."""
    obstacles, monitor = cell
    goal = hand_at(0.7)
    start = goal + np.array([0.0, 0.0, 0.3])
    corners = start + 0.2 * np.array(np.meshgrid(*3 * [[-1.0, 1.0]])).reshape(3, 8).T
    low, high = corners.min(axis=0), corners.max(axis=0)
    ignored = 0
    for leaves_at in (0.0, 0.2):
        fresh(cell)
        exempt_all(monitor, "fixture", until=9.0)
        for link in panda().links:
            monitor.ignore(link, "cart", "mover", zone=corners)
        swing, place, pace = Swing(monitor), start.copy(), 0.4
        for tick in range(700):
            now = tick * PERIOD
            way = goal - place if now >= leaves_at else np.zeros(3)
            step = min(pace * PERIOD, float(np.linalg.norm(way)))
            velocity = way / np.linalg.norm(way) * step / PERIOD if step > 0.0 else np.zeros(3)
            if swing.rate == 0.0:
                break
            if not ((place - 0.04 >= low) & (place + 0.04 <= high)).all():
                assert distance(swing.angle, place, 0.04) > 0.0
            obstacles.update(["cart"], now, [place], [velocity], 0.04, np.inf, pace, source="mover")
            verdict = swing.step(tick)
            ignored += any(
                one.kind is ReasonKind.PAIR_IGNORED and "cart" in one.subject
                for one in verdict.reasons
            )
            place = place + velocity * PERIOD
        assert swing.rate == 0.0
        obstacles.remove(["cart"])
    assert ignored > 10


@pytest.mark.parametrize("schedule", ["deadline", "full", ("powers", "partial")])
def test_a_pair_that_is_watched_again_is_judged_as_if_it_had_always_been(schedule):
    tables = [Obstacles(sources=["camera"]) for _ in range(2)]
    monitors = [make_monitor(schedule, obstacles=one, rate=1.0 / PERIOD)[1] for one in tables]
    tables[0].add_static("bench", [0.0, 3.0, 0.0], 0.1)
    tables[1].add_static("bench", [0.0, 3.0, 0.0], 0.1)
    number, rng = 0, np.random.default_rng(3)
    is_exempt, again = False, 0
    for tick in range(120):
        now = tick * PERIOD
        place = np.array([0.9 - 0.3 * now, 0.1, 0.6])
        place += rng.uniform(-1e-3, 1e-3, 3)
        for table in tables:
            table.update(
                ["part"], now, [place], [[-0.3, 0.0, 0.0]], 0.05, source="camera",
                position_error=2e-3, velocity_error=0.1,
            )  # fmt: skip
        if tick in (10, 60):
            number = monitors[0].ignore("*", "part", until=0.8)
        if tick in (40, 90):
            monitors[0].watch(number)
        exempt, never = (one.step(now, round_to(0.1 * now), 0.1 * np.eye(7)[0]) for one in monitors)
        was, is_exempt = is_exempt, ReasonKind.PAIR_IGNORED in kinds(exempt)
        if is_exempt:
            assert exempt.obstacle != "part"
            assert exempt.contact_time >= never.contact_time
            continue
        assert exempt.complete
        if was:
            again += 1
            assert "part" in str(subjects(exempt, ReasonKind.PAIR_WATCHED))
        if schedule == "full":
            # How far a scale has risen depends on what was before.
            fields = {"evaluated": 0, "reasons": (), "speed_scale": 1.0}
            assert exempt._replace(**fields) == never._replace(**fields)
        else:
            # They were evaluated in other ticks, each of them lately.
            assert 0.7 * never.contact_time <= exempt.contact_time <= never.contact_time / 0.7
    assert again == 2


def test_what_begins_and_ends_is_told_in_verdicts_and_to_the_journal(cell):
    _, monitor = fresh(cell)
    # What ended before is told in the next step.
    monitor.step(0.0, HOME, STILL)
    monitor.journal = journal = Journal()
    number = monitor.ignore("panda_hand", "fixture", until=1.0)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert subjects(verdict, ReasonKind.PAIR_IGNORED) == {"panda_hand and fixture"}
    (reason,) = (one for one in verdict.reasons if one.kind is ReasonKind.PAIR_IGNORED)
    assert "until 1.000 s" in reason.detail
    (one,) = monitor.exemptions
    assert (one.number, one.pair.link, one.until) == (number, "panda_hand", 1.0)
    monitor.watch(number)
    verdict = monitor.step(2 * PERIOD, HOME, STILL)
    assert subjects(verdict, ReasonKind.PAIR_WATCHED) == {"panda_hand and fixture"}
    assert kinds(monitor.step(3 * PERIOD, HOME, STILL)).isdisjoint(
        {ReasonKind.PAIR_IGNORED, ReasonKind.PAIR_WATCHED}
    )
    monitor.journal = None
    told = [kind for kind in journal.kinds() if kind not in ("note_state", "note_verdict")]
    assert told == [IgnoreMessage, "note", WatchMessage, "note"]
    lines = [arguments[0] for name, arguments, _ in journal.told if name == "note"]
    assert "not watched: panda_hand and fixture" in lines[0]
    assert "no longer exempt: panda_hand and fixture" in lines[1]


def test_a_pattern_that_fits_nothing_is_a_stop_until_its_time_is_over(cell):
    _, monitor = fresh(cell)
    monitor.ignore("panda_hand", "fixtrue", until=0.01)
    verdict = monitor.step(0.0, HOME, STILL)
    assert verdict.level is Level.STOP
    assert subjects(verdict, ReasonKind.IGNORE_UNMATCHED) == {"'fixtrue'"}
    assert ReasonKind.IGNORE_UNMATCHED not in kinds(monitor.step(0.01, HOME, STILL))


def test_what_is_refused_raises_in_the_call_and_changes_nothing(cell):
    _, monitor = fresh(cell)
    monitor.reset()
    monitor.step(5.0, HOME, STILL)
    for wrong in ({}, {"until": 5.0}, {"until": np.nan}, {"zone": 0 * BOX}):
        with pytest.raises(ArmguardError):
            monitor.ignore("panda_hand", "fixture", **wrong)
    with pytest.raises(ArmguardError, match="panda_thumb"):
        monitor.ignore("panda_thumb", "fixture", until=6.0)
    with pytest.raises(ArmguardError, match="does not exist"):
        monitor.watch(10**6)
    assert monitor.exemptions == ()
    assert kinds(monitor.step(5.0 + PERIOD, HOME, STILL)) <= {ReasonKind.HOLD, ReasonKind.CONTACT}


def test_a_reset_ends_what_has_a_time_for_the_clock_may_be_another(cell):
    _, monitor = fresh(cell)
    monitor.step(1000.0, HOME, STILL)
    monitor.ignore("panda_hand", "fixture", until=1001.0)
    monitor.step(1000.0 + PERIOD, HOME, STILL)
    monitor.reset()
    verdict = monitor.step(0.0, HOME, STILL)
    assert monitor.exemptions == ()
    assert subjects(verdict, ReasonKind.PAIR_WATCHED) == {"panda_hand and fixture"}


def test_no_plan_is_judged_by_less_than_all_pairs():
    """It is run to its end, whatever verdicts say then."""
    obstacles = Obstacles(sources=[])
    obstacles.add_static("fixture", FIXTURE, RADIUS)
    _, monitor = make_monitor(obstacles=obstacles, rate=1.0 / PERIOD, motion="planned")
    monitor.ignore("*", "fix*", until=1000.0)
    verdict = monitor.step(0.0, HOME, STILL)
    assert ReasonKind.PAIR_IGNORED in kinds(verdict)
    times = np.linspace(0.0, 2.0, 41)
    share = 10 * (times / 2) ** 3 - 15 * (times / 2) ** 4 + 6 * (times / 2) ** 5
    rate = (30 * (times / 2) ** 2 - 60 * (times / 2) ** 3 + 30 * (times / 2) ** 4) / 2
    error = np.full(7, 1e-3)
    for reach, is_safe in ((0.9, False), (-0.3, True)):
        q, v = HOME + reach * share[:, None] * np.eye(7)[0], reach * rate[:, None] * np.eye(7)[0]
        answer = monitor.commit(Plan(2 * PERIOD, times, q, v, error))
        assert answer.safe is is_safe, answer
        verdict = monitor.step(PERIOD, HOME, STILL)
        assert (ReasonKind.PAIR_IGNORED in kinds(verdict)) is not is_safe
    assert any("on a plan" in one.detail for one in verdict.reasons)
