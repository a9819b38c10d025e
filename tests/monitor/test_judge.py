"""What a verdict carries beside its level, by the real monitor."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from armguard import monitor as room_of_monitor
from armguard.contact import certificate
from armguard.obstacles import Obstacles
from armguard.pairs import SeparationRule
from armguard.robot.operating_limits import OperatingLimits
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, STILL, kinds, make_monitor, panda, see, steps
from support.permitted_contact import Encounter

FAR, NEAR, AT_HAND = [8.0, 0.0, 0.5], [1.6, 0.0, 0.5], [0.55, 0.0, 0.5]


def one(position, **settings):
    obstacles, monitor = make_monitor(**settings)
    see(obstacles, 0.0, position)
    return monitor, steps(monitor, 0, 1)[0]


@pytest.mark.parametrize("motion", ["joint", "isotropic", "planned"])
def test_what_is_far_is_clear_at_any_speed(motion):
    _, verdict = one(FAR, motion=motion)
    assert verdict.level is Level.CLEAR
    assert verdict.speed_scale == 1.0
    assert verdict.reasons == ()
    assert verdict.separation is None
    assert verdict.certificate is None


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_a_stop_leaves_no_speed(motion):
    monitor, verdict = one(AT_HAND, motion=motion)
    assert verdict.level is Level.STOP
    assert verdict.speed_scale == 0.0
    assert verdict.contact_time <= verdict.stop_time
    pair = monitor.pairs(1)[0]
    assert (verdict.link, verdict.obstacle) == (pair.link, pair.obstacle)


def test_what_is_near_says_by_which_bound():
    monitor, verdict = one(NEAR)
    assert verdict.level < Level.CLEAR
    (reason,) = [r for r in verdict.reasons if r.kind is ReasonKind.CONTACT]
    assert reason.subject == f"{verdict.link} and ball"
    assert reason.detail.endswith(f"by the {monitor.pairs(1)[0].bound} bound")
    assert f"{verdict.contact_time:.4g} s" in reason.detail


@pytest.mark.parametrize("position", [FAR, NEAR, AT_HAND])
def test_without_contact_limits_harm_is_contact(position):
    monitor, verdict = one(position)
    refused = monitor.step(1e-3, [float("nan")] * 7, STILL)
    for told in (verdict, refused):
        assert (told.harm_time, told.contact_speed) == (told.contact_time, None)
    assert refused.harm_time == 0.0


@pytest.mark.parametrize("case", ["no sources", "refused", "exempt"])
def test_what_holds_a_stop_is_the_weightiest_reason_and_no_note(case):
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[]))
    if case == "exempt":
        see(obstacles, 0.0, FAR, ids=("part",))
        monitor.ignore("panda_hand", "part", until=1.0)
    obstacles.add_static("post", AT_HAND, radius=0.3)
    if case == "refused":
        see(obstacles, 0.0, FAR)
        steps(monitor, 0, 1)
        see(obstacles, 1e-3, [-20.0, 0.0, 0.5])
    first = steps(monitor, 1, 1)[0]
    assert {"no sources": ReasonKind.NO_SOURCES_EXPECTED}.get(case) in {None, *kinds(first)}
    assert len(first.reasons) > 1
    assert first.reasons[0].kind is ReasonKind.CONTACT
    obstacles.remove(["post"], 2e-3)
    held = steps(monitor, 2, 1)[0]
    assert (held.level, held.reasons[0].kind) == (Level.STOP, ReasonKind.HOLD)
    assert held.held.reason.kind is ReasonKind.CONTACT
    assert "and post, contact time" in held.held.describe_cause()


def test_the_certificate_is_about_the_pair_and_no_later_than_the_verdict():
    monitor, verdict = one(NEAR, certify=True)
    assert 0.0 < verdict.certificate.contact_time <= verdict.contact_time * (1.0 + 1e-9)
    assert certificate.verify(verdict.certificate, **monitor.certificate_inputs)
    bad = monitor.step(math.nan, HOME, STILL)
    assert bad.level is Level.STOP
    assert bad.certificate is None
    assert monitor.certificate_inputs is None


def test_the_separation_margin_grows_with_the_distance():
    margins = [
        one([x, 0.0, 0.5], separation=SeparationRule())[1].separation for x in (1.0, 2.0, 4.0)
    ]
    assert margins[0] < margins[1] < margins[2]
    assert margins[2] - margins[1] == pytest.approx(2.0, abs=0.1)


def test_a_plan_that_nobody_made_changes_nothing():
    rng = np.random.default_rng(0)
    joint, planned = [make_monitor(motion=motion) for motion in ("joint", "planned")]
    places = rng.uniform([0.9, -1.0, 0.0], [3.0, 1.0, 1.0], (3, 3))
    for i in range(30):
        position = places[i // 10]
        answers = []
        for obstacles, monitor in (joint, planned):
            see(obstacles, i * 1e-3, position, ids=(f"ball{i // 10}",))
            answers.append(steps(monitor, i, 1)[0])
        assert answers[0] == answers[1]


def test_what_found_no_room_could_be_anywhere(monkeypatch):
    monkeypatch.setattr("armguard.obstacles.table.MAXIMUM_ROWS", 64)
    obstacles, monitor = make_monitor(separation=SeparationRule())
    names = [f"ball{i}" for i in range(65)]
    see(obstacles, 0.0, np.tile(FAR, (65, 1)), ids=names)
    (verdict,) = steps(monitor, 0, 1)
    assert verdict.level is Level.STOP
    assert verdict.contact_time == 0.0
    assert (verdict.link, verdict.obstacle) == (None, None)
    assert verdict.separation == -math.inf
    assert ReasonKind.OBSTACLE_REFUSED in kinds(verdict)
    obstacles.update([], 1e-3, snapshot=True)
    see(obstacles, 2e-3, FAR)
    # The other faults of that call were taken: what is left has room.
    assert steps(monitor, 2, 1)[0].separation > 0.0


def live(motion, seed, *, asks):
    """Verdicts of a life with people who come near and go, hiccups, doubts and new faces.

    And the answers to questions in between, if any are asked.
    """
    rng = np.random.default_rng(seed)
    obstacles, monitor = make_monitor(motion=motion, rate=200.0, joint_timeout=0.2)
    said, answers = [], []
    phase, pose = rng.uniform(0.0, 6.0, 3), rng.uniform(0.0, 6.0, 7)
    for tick in range(1500):
        now = 0.005 * tick
        if tick % 4 == 0:
            radius = 7.0 + 6.0 * np.sin(0.3 * now + phase)
            bearing = 0.1 * now + phase
            where = np.stack([radius * np.cos(bearing), radius * np.sin(bearing), 0.5 + 0 * radius])
            names = ["ann", "bob", "cid" if tick % 400 < 200 else "dot"]
            see(obstacles, now, where.T, ids=names, snapshot=True)
        if tick % 700 == 332:
            see(obstacles, now, [math.nan] * 3, ids=["ann"])
        if tick == 900:
            monitor.reset()
        stamp = now - (0.003 if tick % 20 == 7 else 0.0)
        q, v = HOME + 0.2 * np.sin(stamp + pose), 0.2 * np.cos(stamp + pose)
        said.append(monitor.step(stamp, q, v, now))
        if asks and tick % 25 == 0:
            answers.append((monitor.pairs(3), monitor.headroom(), monitor.explain()))
            answers.append((monitor.attention(), monitor.snapshot(pair_limit=3, row_limit=2)))
    return said, answers


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_verdicts_are_the_same_to_the_bit_whether_questions_are_asked_or_not(motion):
    asked, answers = live(motion, 1, asks=True)
    alone, none = live(motion, 1, asks=False)
    assert list(map(repr, asked)) == list(map(repr, alone))
    assert {verdict.level for verdict in alone} == set(Level)
    assert len(answers) > 0 == len(none)


def test_a_verdict_is_made_in_one_place():
    room = Path(room_of_monitor.__file__).parent
    makers = [
        (path.name, function.name)
        for path in room.rglob("*.py")
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
        if isinstance(node, ast.Call)
        and any(
            isinstance(one, ast.Name) and one.id == "Verdict" for one in (node.func, *node.args)
        )
    ]
    assert makers == [("judge.py", "_make_verdict")]


def test_a_permitted_contact_before_the_arm_rests_leaves_no_level_above_aware():
    """Harm is far off by the margins, so that the level would be CLEAR without it."""
    slow = OperatingLimits.fraction(panda(), velocity=0.05, acceleration=0.05)
    encounter = Encounter(0.02, operating=slow, slow_margin=0.001, aware_margin=0.002)
    verdict = encounter.go(5)
    assert verdict.contact_time < verdict.stop_time < verdict.harm_time - 0.002
    assert verdict.level is Level.AWARE
    assert ReasonKind.CONTACT_ALLOWED in kinds(verdict)
    assert Encounter(0.5, operating=slow, slow_margin=0.001).go(5).level is Level.CLEAR


@pytest.mark.parametrize("away", [0.04, 1.0])
def test_harm_may_come_with_contact_where_a_wall_is_within_the_gap(away):
    """The gap is 0.05 m; the wall is farther off than the hand."""
    slow = OperatingLimits.fraction(panda(), velocity=0.05, acceleration=0.05)
    encounter = Encounter(0.02, operating=slow)
    encounter.obstacles.add_static("wall", encounter.place(away), 0.05)
    verdict = encounter.go(5)
    assert verdict.obstacle == "p/hand"
    assert (verdict.harm_time > verdict.contact_time) == (away > 0.5)
