import math
from functools import partial

import numpy as np
import pinocchio
import pytest
from coal import Sphere

from armguard.bounds import Plan, stop_on_path
from armguard.bounds.planned import contact, curve, following, slabs, stop
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor, PlanVerdict, committed_pieces
from armguard.obstacles import Obstacles, table
from armguard.robot import Robot
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Effect, Level, ReasonKind
from support.example_arms import load_holding
from support.panda_monitor import (
    FAR,
    HOME,
    PERIOD,
    STILL,
    kinds,
    make_monitor,
    panda,
    ranged_panda,
    see,
    subjects,
)
from support.plan_cases import Hermite
from support.plan_hunt import PlanHunt

DURATION = 0.6
TIMES = np.linspace(0.0, DURATION, 61)
ERROR, SPEED_ERROR = 2e-3, 0.02
HEAD, HAND = 1, 11
TURN = 0.2
"""How far the first joint turns on the way, in [rad]."""


def make_plan(turn=TURN, stamp=0.0, **changes):
    """From rest to rest, by the first joint alone."""
    angle = np.pi * TIMES / DURATION
    q, v = np.tile(HOME, (len(TIMES), 1)), np.zeros((len(TIMES), 7))
    q[:, 0] += 0.5 * turn * (1.0 - np.cos(angle))
    v[:, 0] = 0.5 * turn * np.pi / DURATION * np.sin(angle)
    plan = Plan(stamp, TIMES.copy(), q, v, np.full(7, ERROR), np.full(7, SPEED_ERROR))
    return plan._replace(**changes)


def make_rest(q, stamp):
    """To rest where the arm is."""
    return make_plan(stamp=stamp, times=[0.0, 0.1], q=np.tile(q, (2, 1)), v=np.zeros((2, 7)))


def put_post(obstacles, bearing, *, distance=0.5, radius=0.03):
    """A ball at the height of the fingers, at an angle about the first joint's axis, in [rad]."""
    place = [distance * np.cos(bearing), distance * np.sin(bearing), 0.65]
    obstacles.add_static("post", place, radius)
    return np.array(place)


def start(bearing=None, **settings):
    """A monitor that plans are told to, after one tick, and its obstacles."""
    obstacles, monitor = make_monitor(motion="planned", **settings)
    if bearing is not None:
        put_post(obstacles, bearing)
    monitor.step(0.0, HOME, STILL)
    return obstacles, monitor


def follow(monitor, plan, before=None):
    """Verdicts of an arm that is where the plan has it, at its samples up to some place."""
    return [
        monitor.step(float(TIMES[k]), plan.q[k], plan.v[k])
        for k in range(1, len(TIMES) if before is None else before)
    ]


def test_a_piece_that_nothing_can_come_near_is_safe():
    _, monitor = start()
    assert monitor.commit(make_plan()) == PlanVerdict(True, math.inf, None, None, ())
    obstacles, monitor = start()
    see(obstacles, PERIOD, FAR)
    monitor.step(PERIOD, HOME, STILL)
    assert monitor.commit(make_plan()).safe


def make_sharp_turn():
    """Out by the first joint, sharply round, harder than brakes would, and gently to rest."""
    rates, lasting = [5.0, -11.0, 2.0], [0.15, 0.0955, 0.15]
    times, angle, pace = [0.0], [0.0], [0.0]
    for rate, whole in zip(rates, lasting, strict=True):
        for dt in np.diff(np.linspace(0.0, whole, 11)):
            angle.append(angle[-1] + pace[-1] * dt + 0.5 * rate * dt * dt)
            pace.append(pace[-1] + rate * dt)
            times.append(times[-1] + dt)
    pace[-1] = 0.0
    q, v = np.tile(HOME, (len(times), 1)), np.zeros((len(times), 7))
    q[:, 0] += angle
    v[:, 0] = pace
    return Plan(0.0, np.array(times), q, v, np.full(7, ERROR), np.full(7, SPEED_ERROR))


def test_a_piece_that_may_be_left_allows_for_brakes_on_the_way():
    plan = make_sharp_turn()
    fastest = int(np.argmax(plan.v[:, 0]))
    brake = panda().braking_deceleration[0]
    lasting = plan.v[fastest, 0] / brake
    times = np.linspace(0.0, lasting, 41)
    q = np.tile(plan.q[fastest], (41, 1))
    q[:, 0] += plan.v[fastest, 0] * times - 0.5 * brake * times**2
    left = plan._replace(times=times, q=q)
    told = []
    for bearing in np.linspace(0.40, 0.56, 9):
        safe = []
        for leave in ("never", "any"):
            obstacles, monitor = make_monitor(motion="planned", leave=leave)
            place = put_post(obstacles, bearing, distance=0.42)
            monitor.step(0.0, HOME, STILL)
            safe.append(monitor.commit(plan).safe)
        touches = first_touch(left, place, 0.03) < math.inf
        assert not (safe[1] and (touches or not safe[0]))
        told.append((*safe, touches))
    # Somewhere an arm that is braked on the way touches what it would not reach on its piece.
    assert (True, False, True) in told
    assert (True, True, False) in told


def test_a_piece_that_may_be_left_does_not_begin_out_of_nothing():
    _, monitor = start(leave="any")
    answer = monitor.commit(make_plan(stamp=0.02))
    assert not answer.safe
    assert "begins in 0.02 s" in answer.reasons[0].detail
    assert monitor.commit(make_plan()).safe
    later = make_plan()
    again = later._replace(stamp=0.02, times=later.times[2:] - 0.02, q=later.q[2:], v=later.v[2:])
    assert monitor.commit(again).safe
    assert len(monitor._judge.pieces._pieces) == 2, "it may leave the first one until then"


def first_touch(plan, place, radius):
    """When the arm's true geometry first touches a ball on its way along a plan, in [s]; or inf."""
    model, shapes = panda().model, pinocchio.GeometryModel()
    for shape in panda().collision_model.geometryObjects:
        shapes.addGeometryObject(shape)
    ball = shapes.addGeometryObject(
        pinocchio.GeometryObject("ball", 0, pinocchio.SE3(np.eye(3), place), Sphere(radius))
    )
    for index in range(ball):
        if shapes.geometryObjects[index].parentJoint > 0:
            shapes.addCollisionPair(pinocchio.CollisionPair(index, ball))
    data, placed = model.createData(), pinocchio.GeometryData(shapes)
    for time, q in zip(plan.times, plan.q, strict=True):
        pinocchio.computeDistances(model, data, shapes, placed, q)
        if min(result.min_distance for result in placed.distanceResults) <= 0.0:
            return float(time)
    return math.inf


def test_a_piece_into_an_obstacle_is_unsafe_and_one_away_from_it_is_safe():
    plan = make_plan()
    # The fingers pass there on the way; where it begins, there is still room.
    obstacles, monitor = make_monitor(motion="planned")
    place = put_post(obstacles, 0.45, distance=0.42)
    monitor.step(0.0, HOME, STILL)
    found, touch = monitor.commit(plan), first_touch(plan, place, 0.03)
    assert 0.1 < touch < DURATION
    assert not found.safe
    assert 0.5 * touch < found.contact_time <= touch
    assert found.obstacle == "post"
    assert found.link in panda().links
    (reason,) = found.reasons
    assert reason.kind is ReasonKind.PLAN_UNSAFE
    assert reason.kind.effect is Effect.NOTE
    assert reason.subject == f"{found.link} and post"
    assert monitor.commit(make_plan(-TURN)).safe


def test_what_could_walk_into_the_way_makes_a_piece_unsafe():
    """The same piece, a person farther and farther away: once it is safe, it stays so."""
    safe, times = [], []
    for distance in (0.7, 1.0, 1.3, 1.6, 2.0):
        obstacles, monitor = make_monitor(motion="planned")
        see(obstacles, 0.0, [distance, 0.0, 0.6], velocity=[[0.0, 0.0, 0.0]])
        monitor.step(0.0, HOME, STILL)
        found = monitor.commit(make_plan())
        safe.append(found.safe)
        times.append(found.contact_time)
    assert not safe[0]
    assert safe[-1]
    assert safe == sorted(safe)
    assert times == sorted(times)


REFUSED = {
    "starts elsewhere": (make_plan()._replace(q=make_plan().q + 0.01), "panda_joint1"),
    "in the past": (make_plan(stamp=-1.0), "plan"),
    "far ahead": (make_plan(stamp=1.0), "plan"),
    "faster than joints are": (make_plan(1.2), "panda_joint1"),
    "harder to a stop than brakes are": (make_plan(0.5), "panda_joint1"),
    "moving at its end": (make_plan(v=make_plan().v + 0.1), "panda_joint1"),
    "with a hole": (make_plan(times=np.delete(TIMES, 5)), "q"),
    "malformed": (make_plan(q=HOME), "q"),
    "without an error": (make_plan(tracking_error=np.zeros(7)), "tracking_error"),
    "not finite": (make_plan(v=np.full((61, 7), np.nan)), "v"),
    "no plan": ("along here", "plan"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_plan_is_refused_with_its_reason(case):
    plan, subject = REFUSED[case]
    _, monitor = start()
    found = monitor.commit(plan)
    assert (found.safe, found.contact_time, found.link, found.obstacle) == (False, 0.0, None, None)
    (reason,) = found.reasons
    assert (reason.kind, reason.subject) == (ReasonKind.PLAN_REFUSED, subject)
    assert reason.detail
    assert monitor.step(PERIOD, HOME, STILL).level is Level.CLEAR


@pytest.mark.parametrize(
    "junk",
    [
        None,
        7,
        [],
        (1, 2, 3, 4, 5),
        Plan(None, None, None, None, None),
        Plan("now", [0.0, "1"], {}, object(), [[]]),
        Plan(math.nan, [0.0, 1.0], [[1.0]], [[1.0]], [math.inf]),
        Plan(0.0, [1e308, -1e308], np.zeros((2, 7)), np.zeros((2, 7)), np.ones(7)),
        Plan(0.0, [0.0, 5e-324], np.full((2, 7), 1e308), np.full((2, 7), -1e308), np.ones(7)),
        Plan(0.0, np.zeros((2, 2, 2)), HOME, HOME, HOME, "fast"),
        Plan(10**400, [0, 1], [HOME] * 2, [STILL] * 2, [1e-3] * 7, [-1.0] * 7),
        Plan(0.0, [0.0, 1j], [HOME] * 2, [STILL] * 2, [1e-3] * 7),
        make_plan(tracking_error=np.full(7, 1e300)),
    ],
)
def test_nothing_in_a_plan_raises(junk):
    _, monitor = start(0.8)
    assert not monitor.commit(junk).safe
    assert monitor.step(PERIOD, HOME, STILL).level > Level.STOP


def test_on_its_piece_an_arm_may_go_where_it_would_have_to_stop_without():
    for commits in (False, True):
        _, monitor = start(0.3, reaction_time=0.1)
        plan = make_plan()
        if commits:
            assert monitor.commit(plan).safe
        verdicts = follow(monitor, plan)
        assert all(ReasonKind.PLAN_VOID not in kinds(verdict) for verdict in verdicts)
        # Before the commit it had to stop; until that is believed to be over, it is to finish.
        assert {verdict.stop for verdict in verdicts} == (
            {"finish", None} if commits else {"brake"}
        )
        assert (verdicts[-1].level is Level.AWARE) is commits
        assert verdicts[-1].speed_scale == (1.0 if commits else 0.0)


def test_on_a_proved_piece_no_level_asks_for_less_speed_and_the_verdict_says_until_when():
    obstacles, monitor = make_monitor(motion="planned", reaction_time=0.1)
    see(obstacles, 0.0, [-0.85, 0.0, 0.5], accel=0.1, speed=0.1)
    before = [monitor.step(k * PERIOD, HOME, STILL) for k in range(2)][-1]
    assert (before.level, before.proved_until) == (Level.SLOW, None)
    piece = make_plan(stamp=PERIOD)
    assert monitor.commit(piece).safe
    held = [monitor.step((2 + k) * PERIOD, HOME, STILL) for k in range(2)]
    for verdict in held:
        # The SLOW of before is not over, and costs nothing here.
        assert (verdict.level, verdict.speed_scale) == (Level.AWARE, 1.0)
        # A joint that is off the piece by its velocity error rests a little later.
        assert 0.0 <= verdict.proved_until - (PERIOD + DURATION) < 0.05
        assert verdict.stop is None
    strayed = monitor.step(5 * PERIOD, HOME + 0.01, STILL)
    assert strayed.level < Level.AWARE
    assert strayed.proved_until is None
    assert strayed.speed_scale < 1.0


def test_a_piece_that_nothing_new_is_seen_on_is_judged_once():
    _, monitor = start(0.3)
    plan = make_plan()
    assert monitor.commit(plan).safe
    pieces = monitor._judge.pieces
    for k in range(1, len(TIMES)):
        verdict = monitor.step(float(TIMES[k]), plan.q[k], plan.v[k])
        assert pieces.evaluated == 0
        assert verdict.level > Level.STOP


def test_an_unsafe_or_refused_piece_leaves_the_one_before_in_force():
    _, monitor = start(0.3)
    plan = make_plan()
    assert monitor.commit(plan).safe
    assert not monitor.commit(make_plan(q=HOME)).safe
    assert not monitor.commit(make_plan(tracking_error=np.full(7, 0.5))).safe
    assert all(verdict.level > Level.STOP for verdict in follow(monitor, plan))


@pytest.mark.parametrize(("joint", "push"), [(0, 0.0), (6, 7.0)])
def test_a_plan_that_the_arm_strays_from_is_void(joint, push):
    """One joint goes on as it was instead of slowing down, or sets off by itself."""
    plan, left = make_plan(), 15
    monitors = [start(0.3, reaction_time=0.1)[1] for _ in range(2)]
    assert monitors[0].commit(plan).safe
    for k in range(1, len(TIMES)):
        q, v, away = plan.q[k].copy(), plan.v[k].copy(), max(TIMES[k] - TIMES[left], 0.0)
        if away > 0.0:
            v[joint] = plan.v[left, joint] + push * away
            q[joint] = plan.q[left, joint] + plan.v[left, joint] * away + 0.5 * push * away**2
        strayed = bool((np.abs(v - plan.v[k]) > SPEED_ERROR + 2.0 * panda().velocity_error).any())
        verdict, other = (monitor.step(float(TIMES[k]), q, v) for monitor in monitors)
        # Told once; from then on the arm is one like any other.
        told = subjects(verdict, ReasonKind.PLAN_VOID)
        if strayed:
            assert told == {panda().joints[joint]}
            break
        assert not told
    assert k < len(TIMES) - 5
    assert not verdict.level > other.level
    following = [monitor.step(float(TIMES[k]) + PERIOD, q, v) for monitor in monitors]
    assert ReasonKind.PLAN_VOID not in kinds(following[0])
    assert following[0].contact_time == following[1].contact_time
    assert following[0].level is following[1].level is Level.STOP


def test_what_is_within_errors_is_no_straying():
    _, monitor = start()
    plan = make_plan()
    assert monitor.commit(plan).safe
    off = 0.99 * (ERROR + panda().position_error)
    for k in range(1, len(TIMES)):
        verdict = monitor.step(float(TIMES[k]), plan.q[k] + (-1.0) ** (k // 10) * off, plan.v[k])
        if k % 10 != 0:
            assert ReasonKind.PLAN_VOID not in kinds(verdict)
        else:
            break


def test_after_its_end_the_arm_stays_there_until_it_is_seen_to_leave():
    _, monitor = start(0.3)
    plan = make_plan()
    assert monitor.commit(plan).safe
    follow(monitor, plan)
    for k in range(1, 20):
        after = monitor.step(DURATION + k * PERIOD, plan.q[-1], STILL)
        assert ReasonKind.PLAN_VOID not in kinds(after)
        assert after.level > Level.STOP
    gone = []
    for k in range(1, 21):
        q, v = plan.q[-1].copy(), STILL.copy()
        q[0], v[0] = q[0] + 0.5 * 10.0 * (k * PERIOD) ** 2, 10.0 * k * PERIOD
        gone.append(monitor.step(DURATION + (19 + k) * PERIOD, q, v))
    assert not monitor._rule.latched
    assert sum(ReasonKind.PLAN_VOID in kinds(verdict) for verdict in gone) == 1
    assert not monitor._judge.pieces.is_proved


def cut_part(plan, first, last):
    """The piece between two samples."""
    return plan._replace(
        stamp=plan.stamp + float(TIMES[first]),
        times=TIMES[first : last + 1] - TIMES[first],
        q=plan.q[first : last + 1],
        v=plan.v[first : last + 1],
    )


def cut(plan, first, last, monitor):
    """The piece between two samples, with its own stop."""
    return monitor.with_stop(cut_part(plan, first, last))


@pytest.mark.parametrize("on_path", [False, True])
def test_pieces_with_their_own_stops_follow_each_other(on_path):
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    put_post(obstacles, 0.3)
    monitor.step(0.0, HOME, STILL)
    plan, most = make_plan(), 0
    for k in range(len(TIMES) - 1):
        piece = cut_part(plan, k, min(k + 3, len(TIMES) - 1))
        stopped = stop_on_path(panda(), piece) if on_path else monitor.with_stop(piece)
        answer = monitor.commit(stopped)
        assert answer.safe, answer
        pieces = monitor._judge.pieces._pieces
        most = max(most, len(pieces))
        # What the proof of each rests on is its own.
        assert len({piece.place for piece in pieces}) == len(pieces)
        verdict = monitor.step(float(TIMES[k + 1]), plan.q[k + 1], plan.v[k + 1])
        # Before the first one, where nothing was known of its way, the arm had to stop.
        assert verdict.level > Level.STOP or verdict.stop == "finish"
        assert ReasonKind.PLAN_VOID not in kinds(verdict)
    assert verdict.level > Level.STOP
    # Those that the arm has not stopped by are told apart, if not at once.
    assert 2 < most < 15


def test_a_piece_that_the_next_one_does_not_go_on_from_refuses_it():
    _, monitor = make_monitor(motion="planned", rate=100.0, latency=0.05)
    monitor.step(0.0, HOME, STILL)
    plan = make_plan()
    assert monitor.commit(plan).safe
    other = make_plan(-TURN)
    found = monitor.commit(other)
    assert not found.safe
    (reason,) = found.reasons
    assert (reason.kind, reason.subject) == (ReasonKind.PLAN_REFUSED, "panda_joint1")
    assert "off the committed piece by" in reason.detail
    assert "at 0.05 s" in reason.detail
    # From what it has, it may go on to another one once that can have been told.
    for k in range(1, 21):
        monitor.step(float(TIMES[k]), plan.q[k], plan.v[k])
    assert monitor.commit(cut(plan, 20, 30, monitor)).safe


def test_until_joint_states_tell_them_apart_the_arm_may_be_on_either_piece():
    """The answer may have been lost: a way that is blocked later is a STOP on both of them."""
    plan = make_plan()
    for goes_on in (True, False):
        _, monitor = make_monitor(motion="planned", rate=100.0)
        monitor.step(0.0, HOME, STILL)
        first, second = cut(plan, 0, 10, monitor), plan
        assert monitor.commit(first).safe
        assert monitor.commit(second).safe
        pieces = monitor._judge.pieces
        followed = second if goes_on else first
        curve = Hermite(followed.times, followed.q, followed.v)
        for k in range(1, 11):
            monitor.step(0.01 * k, curve(0.01 * k), curve(0.01 * k, 1))
            assert len(pieces._pieces) == 2
        for k in range(11, 25):
            at = min(0.01 * k, float(followed.times[-1]))
            verdict = monitor.step(0.01 * k, curve(at), curve(at, 1))
            assert ReasonKind.PLAN_VOID not in kinds(verdict)
        (left,) = pieces._pieces
        assert left.plan.end == pytest.approx(followed.times[-1])


def test_a_new_obstacle_in_the_way_is_a_stop_in_that_tick_and_the_piece_is_left():
    for bearing, is_in_the_way in ((0.45, True), (2.5, False)):
        obstacles, monitor = make_monitor(motion="planned")
        monitor.step(0.0, HOME, STILL)
        plan = make_plan()
        assert monitor.commit(plan).safe
        follow(monitor, plan, 5)
        put_post(obstacles, bearing, distance=0.42)
        verdict = monitor.step(float(TIMES[5]), plan.q[5], plan.v[5])
        assert (ReasonKind.PIECE_UNSAFE in kinds(verdict)) is is_in_the_way
        if not is_in_the_way:
            assert verdict.level > Level.STOP
            continue
        assert (verdict.level, verdict.stop) == (Level.STOP, "brake")
        (subject,) = subjects(verdict, ReasonKind.PIECE_UNSAFE)
        assert subject.endswith("and post")
        after = monitor.step(float(TIMES[6]), plan.q[6], plan.v[6])
        assert (after.level, after.stop) == (Level.STOP, "brake")


@pytest.mark.parametrize("left", [1.0, 0.5, 0.2, 0.1, 0.02])
def test_news_counts_until_the_very_end_of_a_piece(left):
    """A post appears right where the arm is, so much of its piece before that ends."""
    lasting = 0.6
    pace = 0.3
    plan = make_way([(0.0, lasting - 0.15), (-2.0, 0.15)], 0.0, pace, 0.0)
    curve, end = Hermite(plan.times, plan.q, plan.v), float(plan.times[-1])
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    monitor.step(0.0, HOME, plan.v[0])
    assert monitor.commit(plan).safe
    when = 0.01 * math.floor(100.0 * (1.0 - left) * end + 1.0)
    for now in np.arange(0.01, when - 1e-9, 0.01):
        assert monitor.step(float(now), curve(now), curve(now, 1)).level > Level.STOP
    assert when < end
    obstacles.add_static("post", find_hand(curve(when)), 0.03)
    verdict = monitor.step(when, curve(when), curve(when, 1))
    assert ReasonKind.PIECE_UNSAFE in kinds(verdict)
    assert (verdict.level, verdict.stop) == (Level.STOP, "brake")


def find_hand(q):
    """Where the hand's joint is, in [m]."""
    robot = panda()
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, np.asarray(q))
    return data.oMi[robot.joint_index("panda_hand")].translation.copy()


def see_person(obstacles, stamp, distance=1.6, **fields):
    see(obstacles, stamp, [distance, 0.0, 0.6], velocity=[[0.0, 0.0, 0.0]], **fields)


NEWS = {
    "it jumps nearer": lambda obstacles, now: see_person(obstacles, now, 0.9),
    "it is larger": lambda obstacles, now: see_person(obstacles, now, radius=0.7),
    "it may be faster": lambda obstacles, now: see_person(obstacles, now, speed=90.0, accel=900.0),
    "it is known less exactly": lambda obstacles, now: see_person(
        obstacles, now, position_error=0.7
    ),
    "another is there": lambda obstacles, now: see(
        obstacles, now, [0.8, 0.0, 0.6], ["late"], velocity=[[0.0, 0.0, 0.0]]
    ),
    "nothing": lambda obstacles, now: see_person(obstacles, now),
    "it came away faster than it can": lambda obstacles, now: see_person(obstacles, now, 1.62),
}


@pytest.mark.parametrize("news", NEWS)
def test_whatever_the_proof_does_not_allow_for_judges_a_piece_anew_in_that_tick(news):
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    plan = make_plan()
    see_person(obstacles, 0.0)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(plan).safe
    for k in range(1, 10):
        see_person(obstacles, float(TIMES[k]))
        verdict = monitor.step(float(TIMES[k]), plan.q[k], plan.v[k])
        assert verdict.level > Level.STOP
    NEWS[news](obstacles, float(TIMES[10]))
    verdict = monitor.step(float(TIMES[10]), plan.q[10], plan.v[10])
    # What came away is refused, or breaks its bounds: wherever it is by then, the piece is safe.
    # A vaguer state takes nothing from what is known already.
    harmless = ("nothing", "it came away faster than it can", "it is known less exactly")
    how = None if news in harmless else "brake"
    assert (ReasonKind.PIECE_UNSAFE in kinds(verdict)) is (how == "brake")
    assert verdict.stop == how


def test_a_body_that_comes_back_with_a_vaguer_velocity_stops_no_piece():
    """A body that was hidden for 20 ms: the state from before still bounds it."""
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    plan = make_plan()
    for k in range(len(TIMES) - 1):
        now = float(TIMES[k])
        if k not in (20, 21):
            error = 1.0 if k in (22, 23, 24) else 0.05
            see_person(obstacles, now, 1.05, velocity_error=error)
        verdict = monitor.step(now, plan.q[k], plan.v[k])
        if k > 0:
            assert verdict.level > Level.STOP
        assert monitor.commit(cut(plan, k, min(k + 2, len(TIMES) - 1), monitor)).safe, k


def test_a_piece_that_has_yet_to_begin_is_kept_whatever_comes_between():
    """P1 begins in 90 ms. The answer to P2, which begins now, is lost: the arm goes on along P1."""
    obstacles, monitor = make_monitor(motion="planned", latency=0.0)
    begin, pace = 0.09, 0.4
    first = make_way([(0.0, 0.2), (-3.0, pace / 3.0)], 0.0, pace, 0.0)
    second = make_way([(0.0, 0.4), (-2.0, pace / 2.0)], begin, pace, pace * begin)
    third = make_way([(-3.0, pace / 3.0)], 0.0, pace, 0.0)
    monitor.step(0.0, HOME, first.v[0])
    for plan in (first, second, third):
        assert monitor.commit(plan).safe
    curve = Hermite(second.times, second.q, second.v)
    for now in np.arange(PERIOD, 0.1, PERIOD):
        on_second = now >= begin
        q = curve(now - begin) if on_second else HOME + np.eye(7)[0] * pace * now
        v = curve(now - begin, 1) if on_second else np.eye(7)[0] * pace
        assert monitor.step(float(now), q, v).level > Level.STOP
    # It appears where only the second piece leads.
    put_post(obstacles, 0.54, distance=0.42)
    assert first_touch(first, obstacles.table.accepted.points[0, 0], 0.03) == math.inf
    assert first_touch(second, obstacles.table.accepted.points[0, 0], 0.03) < math.inf
    verdict = monitor.step(0.1, curve(0.1 - begin), curve(0.1 - begin, 1))
    assert ReasonKind.PIECE_UNSAFE in kinds(verdict)
    assert (verdict.level, verdict.stop) == (Level.STOP, "brake")


@pytest.mark.parametrize("leave", ["never", "any"])
def test_pieces_that_are_kept_as_one_are_judged_as_all_of_them(leave):
    """A pole appears where only the fastest of many leads, or only the first: a STOP for it."""
    for bearing, is_in_the_way in ((0.02, True), (2.5, False)):
        obstacles, monitor = make_monitor(motion="planned", latency=0.02, leave=leave)
        pieces = monitor._judge.pieces
        for k in range(1, 80):
            now = k * PERIOD
            q, v = HOME + np.eye(7)[0] * 0.3 * (now - 0.079), np.eye(7)[0] * 0.3
            monitor.step(now, q, v)
            plan = make_way([(0.0, 0.05)], now, 0.3, q[0])
            plan.v[-1, 0] = 0.3
            assert monitor.commit(monitor.with_stop(plan)).safe
        # Fewer are kept than the arm may be on, and wider ones than were shown.
        assert len(monitor.plans) <= committed_pieces.MANY_PIECES
        widest = max(plan.deviation[0] for plan in monitor.plans)
        assert widest > 1.01 * min(plan.deviation[0] for plan in monitor.plans)
        assert len({piece.place for piece in pieces._pieces}) == len(pieces._pieces)
        put_post(obstacles, bearing, distance=0.45)
        verdict = monitor.step(0.08, q + v * PERIOD, v)
        assert (ReasonKind.PIECE_UNSAFE in kinds(verdict)) is is_in_the_way


@pytest.mark.parametrize("latency", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("speed", [0.0, 0.02, 0.3])
def test_a_piece_in_each_tick_at_1_khz_is_refused_for_no_number_of_pieces(speed, latency):
    """Slow pieces, which no joint state tells apart, and pieces that last until answers arrive."""
    _, monitor = make_monitor(motion="planned", latency=latency)
    lasting = 0.02 + latency
    for k in range(1, 300):
        now = k * PERIOD
        turn, pace = np.eye(7)[0] * speed * now, np.eye(7)[0] * speed
        monitor.step(now, HOME + turn, pace)
        times = np.linspace(0.0, lasting, 5)
        q = HOME + turn + np.outer(times, pace)
        plan = Plan(now, times, q, np.tile(pace, (5, 1)), np.full(7, ERROR), np.full(7, 0.02))
        answer = monitor.commit(monitor.with_stop(plan))
        assert answer.safe, answer


def test_a_piece_is_finished_while_a_source_is_silent_and_left_where_nothing_is_known():
    obstacles, monitor = make_monitor(
        motion="planned", rate=100.0, obstacles=Obstacles(sources=["camera"]), source_timeout=0.1
    )
    see(obstacles, 0.0, FAR, source="camera")
    monitor.step(0.0, HOME, STILL)
    plan = make_plan()
    assert monitor.commit(plan).safe
    verdicts = follow(monitor, plan)
    silent = [ReasonKind.SOURCE_SILENT in kinds(verdict) for verdict in verdicts]
    assert any(silent)
    for verdict, is_silent in zip(verdicts, silent, strict=True):
        assert verdict.stop == ("finish" if is_silent else None)
        assert (verdict.level is Level.STOP) is is_silent
    # A joint state that is not believed: who knows where the arm is.
    nowhere = monitor.step(DURATION + 0.01, np.full(7, np.nan), STILL)
    assert nowhere.stop == "brake"


def test_with_stop_ends_at_rest_and_is_committed():
    for ends in (lambda monitor: monitor.with_stop, lambda _: partial(stop_on_path, panda())):
        _, monitor = make_monitor(motion="planned")
        append = ends(monitor)
        monitor.step(0.0, HOME, STILL)
        plan = make_plan()
        half = plan._replace(times=TIMES[:31], q=plan.q[:31], v=plan.v[:31])
        whole = append(half)
        assert (np.asarray(whole.v)[-1] == 0.0).all()
        assert np.array_equal(np.asarray(whole.q)[:31], half.q)
        pace, braking = half.v[-1, 0], panda().braking_deceleration[0]
        assert whole.times[-1] == pytest.approx(TIMES[30] + pace / braking, abs=2e-6)
        assert whole.q[-1, 0] == pytest.approx(half.q[-1, 0] + 0.5 * pace**2 / braking, abs=1e-6)
        assert monitor.commit(whole).safe
        assert append(plan).times[-1] == pytest.approx(DURATION, abs=1e-5)
        for junk in (None, make_plan(q=HOME), make_plan(stamp=np.nan)):
            with pytest.raises(ArmguardError):
                append(junk)


def test_while_its_state_is_not_believed_an_arm_can_commit_to_nothing():
    _, monitor = make_monitor(motion="planned")
    assert not monitor.commit(make_plan()).safe
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(make_plan()).safe
    monitor.step(PERIOD, np.full(7, np.nan), STILL)
    (reason,) = monitor.commit(make_plan()).reasons
    assert (reason.kind, reason.subject) == (ReasonKind.PLAN_REFUSED, "arm")
    assert "latched since" in reason.detail
    monitor.reset()
    monitor.step(2.0 * PERIOD, HOME, STILL)
    assert monitor.commit(make_plan()).safe


@pytest.mark.parametrize(("length", "is_safe"), [(0.05, True), (0.5, False)])
def test_a_tool_that_comes_on_the_way_judges_the_piece_anew(length, is_safe):
    robot, obstacles = Robot.load("panda"), Obstacles(sources=[])
    obstacles.add_static("post", [0.9 * np.cos(0.1), 0.9 * np.sin(0.1), 0.55], 0.02)
    monitor = Monitor(robot, obstacles, motion="planned")
    monitor.step(0.0, HOME, STILL)
    plan = make_plan()
    assert monitor.commit(plan).safe
    follow(monitor, plan, 3)
    forward = np.array([0.0, 0.0, length])
    robot.attach("stick", "panda_hand", Sphere(0.02 + length), pinocchio.SE3(np.eye(3), forward))
    verdict = monitor.step(float(TIMES[3]), plan.q[3], plan.v[3])
    assert (ReasonKind.PIECE_UNSAFE in kinds(verdict)) is not is_safe
    if is_safe:
        assert verdict.level > Level.STOP
    else:
        assert verdict.stop == "brake"


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_only_a_monitor_of_planned_motion_takes_plans(motion):
    _, monitor = make_monitor(motion=motion)
    monitor.step(0.0, HOME, STILL)
    for ask in (monitor.commit, monitor.with_stop):
        with pytest.raises(ArmguardError, match="planned"):
            ask(make_plan())


def refusal(monitor):
    answer = monitor.commit(make_plan(stamp=monitor._now))
    assert (answer.safe, answer.contact_time) == (False, 0.0)
    (reason,) = answer.reasons
    assert reason.kind is ReasonKind.PLAN_REFUSED
    return reason


def test_a_source_that_falls_silent_lets_nothing_more_be_committed():
    obstacles, monitor = start()
    obstacles.update(["far"], 0.0, [[40.0, 0.0, 0.5]], radius=0.1, source="camera")
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(make_plan()).safe
    for tick in range(1, 5000):
        now = tick * PERIOD
        verdict = monitor.step(now, HOME, STILL)
        silent = ReasonKind.SOURCE_SILENT in kinds(verdict)
        assert silent == (now > 0.2)
        if tick in (202, 2000, 4999):
            assert "source silent: camera" in refusal(monitor).detail


@pytest.mark.parametrize(
    ("settings", "balls", "words"),
    [
        ({"ignore": [("panda_hand", "tabel")]}, 0, "'tabel'"),
        ({"budget": 1}, 40, "overdue"),
        ({}, 65, "found no room"),
        ({"sources": ["camera"]}, 0, "source silent: camera"),
        ({"wrist": (2.88, 1.5)}, 0, "joint runs into its stop"),
    ],
)
def test_what_was_wrong_in_the_last_step_lets_nothing_be_committed(
    monkeypatch, settings, balls, words
):
    monkeypatch.setattr(table, "MAXIMUM_ROWS", 64)
    settings = dict(settings)
    obstacles = Obstacles(sources=settings.pop("sources", []))
    q, v = HOME.copy(), STILL.copy()
    q[6], v[6] = settings.pop("wrist", (HOME[6], 0.0))
    _, monitor = make_monitor(motion="planned", obstacles=obstacles, **settings)
    places = np.array([[1.2 + 0.2 * k, 0.0, 0.5] for k in range(balls)])
    if balls:
        see(obstacles, 0.0, places, [f"ball {k}" for k in range(balls)])
    assert monitor.step(0.0, q, v).level is Level.STOP
    assert words in refusal(monitor).detail


def test_a_tool_or_payload_that_no_step_has_seen_lets_nothing_be_committed():
    """Either way: judged without the tool, the piece would have it hit what only it can reach."""
    robot = Robot.load("panda")
    monitor = Monitor(robot, Obstacles(sources=[]), motion="planned", payload=0.0)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(make_plan()).safe
    for tick, (change, subject) in enumerate(
        (
            (lambda: robot.attach("rod", "panda_hand", Sphere(0.02)), "tool"),
            (lambda: robot.detach("rod"), "tool"),
            (lambda: setattr(monitor, "payload", 1.0), "payload"),
        ),
        start=1,
    ):
        change()
        assert refusal(monitor).subject == subject
        monitor.step(tick * PERIOD, HOME, STILL)
        if subject == "tool":
            assert monitor.commit(make_plan(stamp=tick * PERIOD)).safe


def refuse_a_row(obstacles):
    see(obstacles, PERIOD, [math.nan, 0.0, 0.0])


def refuse_a_call(obstacles):
    with pytest.raises(ArmguardError):
        obstacles.update(["ball"], PERIOD, [[1.0, 2.0]], radius=0.1)


def hurry(obstacles):
    obstacles.update([], 9.0, source="camera")


def break_a_bound(obstacles):
    see(obstacles, PERIOD, [FAR[0] + 0.5, 0.0, 0.5])


@pytest.mark.parametrize("act", [refuse_a_call, hurry])
def test_what_no_step_has_seen_yet_and_what_was_wrong_then_lets_nothing_be_committed(act):
    obstacles, monitor = start()
    see(obstacles, 0.0, FAR)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(make_plan()).safe
    act(obstacles)
    assert refusal(monitor)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert verdict.level is Level.STOP
    assert "was a STOP" in str(refusal(monitor))


@pytest.mark.parametrize(("act", "safe"), [(refuse_a_row, False), (break_a_bound, True)])
def test_a_refused_sample_that_no_step_has_seen_lets_nothing_be_committed_and_then_counts(
    act, safe
):
    """As anything that may be true: where it is far away, the next piece is safe all the same."""
    obstacles, monitor = start()
    see(obstacles, 0.0, FAR)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(make_plan()).safe
    act(obstacles)
    assert refusal(monitor)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert (verdict.level > Level.STOP) == safe
    assert monitor.commit(make_plan(stamp=PERIOD)).safe == safe


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.fixture(scope="module")
def kinova():
    return Robot.load("kinova")


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("whose", ["driver", "planner", "both", "neither"])
def test_a_continuous_joint_may_wrap_under_a_plan(kinova, side, whose):
    """Driver and planner, each in its own way: the arm is followed all the same."""
    robot = kinova
    monitor = Monitor(robot, Obstacles(sources=[]), motion="planned")
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    turning = np.flatnonzero(np.isinf(lower))
    start = np.array(
        [0.5 * (a + b) if np.isfinite(a) else 0.0 for a, b in zip(lower, upper, strict=True)]
    )
    start[turning] = side * (np.pi - 0.02)
    pace = side * 0.4
    drives = wrap if whose in ("driver", "both") else np.array
    plans = wrap if whose in ("planner", "both") else lambda angle: angle + 6.0 * np.pi

    def true(now):
        swing = 0.5 * DURATION / np.pi * pace
        q, v = start.copy(), np.zeros(6)
        q[turning] += swing * (1.0 - np.cos(np.pi * now / DURATION))
        v[turning] = 0.5 * pace * np.sin(np.pi * now / DURATION)
        return q, v

    def drive(now):
        q, v = true(now)
        q[turning] = drives(q[turning])
        return monitor.step(now, q, v)

    drive(0.0)
    states = [true(float(now)) for now in TIMES]
    q, v = np.array([q for q, _ in states]), np.array([v for _, v in states])
    assert np.abs(q[-1, turning]).min() > np.pi
    q[:, turning] = plans(q[:, turning])
    plan = Plan(0.0, TIMES.copy(), q, v, np.full(6, ERROR), np.full(6, SPEED_ERROR))
    answer = monitor.commit(plan)
    assert answer.safe, answer
    for now in TIMES[1:]:
        assert ReasonKind.PLAN_VOID not in kinds(drive(float(now)))
    # It is followed, not let go.
    assert monitor._judge.pieces.is_proved


def test_what_is_handed_over_is_a_copy():
    """A controller may write its next piece into the same arrays."""
    plan = make_plan()
    levels = []
    for overwrites in (False, True):
        _, monitor = start(0.3)
        buffers = make_plan()
        assert monitor.commit(buffers).safe
        if overwrites:
            buffers.q[:], buffers.v[:] = HOME, 1e3
        levels.append([verdict.level for verdict in follow(monitor, plan)])
    assert levels[0] == levels[1]


@pytest.mark.parametrize("times_told", [1, 2])
def test_told_again_a_piece_that_is_yet_to_begin_leaves_joints_as_free_until_then(times_told):
    obstacles, monitor = start()
    for _ in range(times_told):
        assert monitor.commit(make_plan(stamp=0.1)).safe
    put_post(obstacles, -0.3)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert ReasonKind.PIECE_UNSAFE in kinds(verdict)
    assert verdict.stop == "brake"


def test_an_arm_that_leaves_its_piece_is_not_on_the_way_to_the_next():
    _, monitor = start()
    plan = make_plan()
    assert monitor.commit(plan).safe
    # The rest of it, from a place that is yet to come, and less closely.
    rest = plan._replace(
        stamp=float(TIMES[9]),
        times=TIMES[9:] - TIMES[9],
        q=plan.q[9:],
        v=plan.v[9:],
        tracking_error=np.full(7, 5.0 * ERROR),
    )
    assert monitor.commit(rest).safe
    # It could still get to where that begins, but turns its last joint meanwhile.
    q, v = plan.q[1].copy(), plan.v[1].copy()
    q[6], v[6] = HOME[6] + 7.5e-4, 0.15
    verdict = monitor.step(float(TIMES[1]), q, v)
    assert ReasonKind.PLAN_VOID in kinds(verdict)


def test_obstacles_that_found_no_room_leave_no_piece_to_finish(monkeypatch):
    monkeypatch.setattr(table, "MAXIMUM_ROWS", 64)
    obstacles, monitor = start()
    ids = [f"ball{i}" for i in range(64)]
    see(obstacles, PERIOD, np.tile(FAR, (64, 1)), ids)
    monitor.step(PERIOD, HOME, STILL)
    assert monitor.commit(make_plan(turn=0.0)).safe
    see(obstacles, 2 * PERIOD, FAR, ["one more"])
    assert obstacles.unplaced()
    verdict = monitor.step(2 * PERIOD, HOME, STILL)
    assert verdict.level is Level.STOP
    assert verdict.stop == "brake"
    assert ReasonKind.PIECE_UNSAFE in kinds(verdict)


@pytest.mark.parametrize("speed", [5e-324, 1e-310, 1e-160])
def test_speeds_next_to_nothing_or_beyond_all_bounds_are_told_of_if_they_matter(speed):
    _, monitor = start()
    plan = make_plan(turn=0.0)
    plan.v[5] = speed
    assert monitor.commit(plan).safe
    plan.v[5:] = 1e200
    with pytest.raises(ArmguardError, match="no stop can be computed"):
        monitor.with_stop(plan)


def make_way(segments, stamp, pace, angle, **changes):
    """By the first joint, from a pace and an angle on, through (acceleration, time) to rest."""
    times, angles, paces = [0.0], [angle], [pace]
    for rate, whole in segments:
        for dt in np.diff(np.linspace(0.0, whole, max(2, math.ceil(whole / 0.002) + 1))):
            angles.append(angles[-1] + paces[-1] * dt + 0.5 * rate * dt * dt)
            paces.append(paces[-1] + rate * dt)
            times.append(times[-1] + dt)
    paces[-1] = 0.0
    q, v = np.tile(HOME, (len(times), 1)), np.zeros((len(times), 7))
    q[:, 0], v[:, 0] = angles, paces
    plan = Plan(stamp, np.array(times), q, v, np.full(7, 1e-3), np.full(7, 0.01))
    return plan._replace(**changes)


@pytest.mark.parametrize("leave", ["never", "any"])
def test_a_piece_that_is_left_is_kept_while_one_that_goes_on_from_it_has_not_begun(leave):
    """Two pieces wait: the second disagrees with the first of all, on which the arm still is."""
    hard, soft, begin, later = -3.3, -3.0, 0.05, 0.048
    pace = 1.0 + hard * begin
    now = make_way([(hard, begin), (hard, -pace / hard)], 0.0, 1.0, 0.0)
    angle = begin + 0.5 * hard * begin**2
    nxt = make_way([(0.5, 0.01), (soft, (pace + 0.005) / -soft)], begin, pace, angle)
    gone = later - 0.01
    pace2 = pace + 0.005 + soft * gone
    angle2 = angle + pace * 0.01 + 0.25e-4 + (pace + 0.005) * gone + 0.5 * soft * gone**2
    last = make_way([(soft, pace2 / -soft)], begin + later, pace2, angle2)
    _, monitor = make_monitor(motion="planned", leave=leave, payload=0.0, latency=0.0)
    monitor.step(0.0, HOME, now.v[0])
    assert monitor.commit(now).safe
    assert monitor.commit(nxt).safe
    assert monitor.commit(last).safe
    kept = [piece.plan.stamp for piece in monitor._judge.pieces._pieces]
    assert kept == pytest.approx([0.0, begin, begin + later])


def test_a_piece_is_not_covered_by_one_that_promises_to_be_less_fast_off_its_curve():
    _, monitor = start(leave="any")
    plan = make_plan()
    sure = plan._replace(velocity_tracking_error=np.full(7, 1e-4))
    assert monitor.commit(plan).safe
    assert monitor.commit(sure).safe
    assert len(monitor._judge.pieces._pieces) == 2
    assert monitor.commit(plan).safe
    assert len(monitor._judge.pieces._pieces) == 1, "both are covered by the last one"


@pytest.mark.parametrize("leave", ["never", "any"])
def test_a_piece_that_waits_is_joined_with_what_comes_before_it_or_not_at_all(leave):
    """An arm that may leave the older one before the newer begins is on the course of neither."""
    _, monitor = make_monitor(motion="planned", rate=100.0, leave=leave)
    monitor.step(0.0, HOME, STILL)
    stays = make_plan(times=[0.0, 2.0], q=np.tile(HOME, (2, 1)), v=np.zeros((2, 7)))
    waits = make_plan(turn=0.01, stamp=0.1)
    for plan in (stays, make_plan(turn=0.05), waits):
        assert monitor.commit(plan).safe
    pieces, (tick, _) = monitor._judge.pieces, monitor._last
    _, older, newer = pieces._pieces
    told = [id(plan) for plan in newer.before]
    assert id(older.plan) not in told, "the newer one does not go on from it"
    one = pieces._join(older, newer, tick)
    if leave == "any":
        assert one is None
    else:
        assert {id(older.plan), *told} <= {id(plan) for plan in one.before}


def test_a_piece_that_waits_longer_is_not_joined_with_a_newer_one_that_has_begun():
    """Until it begins the arm may be where neither of the two has it."""
    _, monitor = make_monitor(motion="planned", rate=100.0)
    monitor.step(0.0, HOME, STILL)
    stays = make_plan(times=[0.0, 2.0], q=np.tile(HOME, (2, 1)), v=np.zeros((2, 7)))
    for plan in (stays, make_plan(turn=0.01, stamp=0.1), make_plan(turn=0.05)):
        assert monitor.commit(plan).safe
    pieces, (tick, _) = monitor._judge.pieces, monitor._last
    first, older, newer = pieces._pieces
    assert older.plan.stamp > newer.plan.stamp
    assert pieces._join(older, newer, tick) is None
    assert pieces._join(first, newer, tick) is not None, "those that have begun are"


@pytest.mark.parametrize("is_joined", [False, True])
def test_pieces_that_are_kept_as_one_rest_on_what_is_known_when_they_are_joined(is_joined):
    """A person is known vaguely when they are committed, and better when they are joined."""
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    see_person(obstacles, 0.0, 1.9, position_error=0.05, velocity_error=0.5)
    monitor.step(0.0, HOME, STILL)
    for turn in (0.05, 0.06):
        assert monitor.commit(make_plan(turn=turn)).safe
    see_person(obstacles, 0.01, 1.9, position_error=0.01, velocity_error=0.05)
    monitor.step(0.01, HOME, STILL)
    pieces, (tick, _) = monitor._judge.pieces, monitor._last
    assert len(pieces._pieces) == 2
    if is_joined:
        pieces._pieces = pieces._join_two(pieces._pieces, tick)
        assert len(pieces._pieces) == 1
    # It goes on in a way that the vague state allows for, and the better one does not.
    for stamp, distance in ((0.02, 1.915), (0.03, 1.93)):
        see_person(obstacles, stamp, distance, position_error=0.01, velocity_error=0.05)
    assert not obstacles.table.refused[obstacles.row("ball")]
    places = [piece.place for piece in pieces._pieces]
    assert [pieces._known.has_changed(place) for place in places] == [is_joined] * len(places)


@pytest.mark.parametrize("takes_up", [True, False])
def test_while_the_arm_may_still_take_up_a_piece_none_is_committed(takes_up):
    """The first answer was lost, so the arm waits at rest for a piece that begins later."""
    _, monitor = make_monitor(motion="planned", rate=100.0)
    out = make_way([(3.0, 0.025), (-3.0, 0.05), (3.0, 0.025)], 0.0, 0.0, 0.0)
    later = make_way([(1.0, 0.1), (-1.0, 0.1)], 0.1, 0.0, 0.0)
    monitor.step(0.0, HOME, STILL)
    for plan in (out, later):
        assert monitor.commit(plan).safe
    verdicts = [monitor.step(0.01 * k, HOME, STILL) for k in range(1, 9)]
    assert sum(ReasonKind.PLAN_VOID in kinds(verdict) for verdict in verdicts) == 1
    # The arm is on no piece, and counts as free; but it still can take up the later one.
    assert [plan.stamp for plan in monitor.plans] == [0.1]
    assert all(verdict.stop != "finish" for verdict in verdicts)
    stays = make_plan(times=[0.0, 0.3], q=np.tile(HOME, (2, 1)), v=np.zeros((2, 7)))
    committed = []
    for k in range(9, 40):
        time = 0.01 * k
        q, v = HOME.copy(), STILL.copy()
        if takes_up:
            q[0] = np.interp(time - 0.1, later.times, later.q[:, 0])
            v[0] = np.interp(time - 0.1, later.times, later.v[:, 0])
        monitor.step(time, q, v)
        answer = monitor.commit(stays._replace(stamp=time, q=np.tile(q, (2, 1))))
        if answer.safe:
            committed.append(time)
        elif v[0] == 0.0:
            assert "answered safe before" in answer.reasons[0].detail
    # Until joint states show that it rests instead, or it has come to the end of that piece.
    assert committed[0] == pytest.approx(0.3 if takes_up else 0.15, abs=0.03)


def test_after_a_change_of_payload_the_piece_that_the_arm_is_on_ends_first():
    _, monitor = make_monitor(motion="planned", rate=100.0, robot=ranged_panda(), payload=0.0)
    way = make_way([(0.5, 0.1), (-0.5, 0.1)], 0.0, 0.0, 0.0)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(way).safe
    answers = {}
    for k in range(1, 24):
        q, v = HOME.copy(), STILL.copy()
        q[0] = np.interp(0.01 * k, way.times, way.q[:, 0])
        v[0] = np.interp(0.01 * k, way.times, way.v[:, 0])
        if k == 5:
            monitor.payload = 1.0
        verdict = monitor.step(0.01 * k, q, v)
        assert (ReasonKind.PLAN_VOID in kinds(verdict)) == (k == 5)
        if k >= 5:
            answers[k] = monitor.commit(make_rest(q, 0.01 * k))
    assert all("answered safe before" in answers[k].reasons[0].detail for k in range(5, 20))
    assert answers[21].safe


@pytest.mark.parametrize("obeys", [True, False])
def test_after_an_unsafe_piece_none_is_committed_while_the_arm_may_be_on_it(obeys):
    """An obstacle appears in its way. The STOP may be late, and so may the next answer."""
    obstacles, monitor = make_monitor(motion="planned")
    way = make_plan()
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(way).safe
    follow(monitor, way, 5)
    put_post(obstacles, 0.45, distance=0.42)
    verdict = monitor.step(float(TIMES[5]), way.q[5], way.v[5])
    assert ReasonKind.PIECE_UNSAFE in kinds(verdict)
    refused = []
    for k in range(6, 10):
        place = 5 if obeys else k
        q, v = way.q[place], STILL if obeys else way.v[place]
        verdict = monitor.step(float(TIMES[k]), q, v)
        assert (verdict.level, verdict.stop) == (Level.STOP, "brake")
        # What it shows now stays clear of the obstacle.
        rest = make_rest(q, float(TIMES[k])) if obeys else cut(way, k, k + 2, monitor)
        answer = monitor.commit(rest)
        refused.append("answered safe before" in str(answer.reasons))
        if answer.safe:
            break
    assert answer.safe is obeys
    assert refused == ([False] if obeys else [True] * 4)


def swing(monitor, k):
    """Tick k of an arm that swings off where it was for 0.1 s, by 4 mrad, and back."""
    angle = np.pi * max(k - 1, 0) / 10.0
    q, v = HOME.copy(), STILL.copy()
    q[0] += 4e-3 * np.sin(angle) ** 2
    v[0] = 0.04 * np.pi * np.sin(2.0 * angle)
    return monitor.step(0.01 * k, q, v)


@pytest.mark.parametrize(("latency", "is_kept"), [(0.1, True), (0.04, False)])
def test_where_the_arm_is_before_an_answer_has_arrived_rules_out_nothing(latency, is_kept):
    """On the piece before, it may be off the next one by more than that allows."""
    obstacles, monitor = make_monitor(motion="planned", latency=latency, rate=100.0)
    stays = make_plan(times=[0.0, 2.0], q=np.tile(HOME, (2, 1)), v=np.zeros((2, 7)))
    loose = stays._replace(tracking_error=np.full(7, 5e-3), velocity_tracking_error=None)
    goes = make_plan()
    rows = [0, *range(len(TIMES))]
    times = np.concatenate([[0.0], 0.1 + TIMES])
    sure = goes._replace(stamp=0.01, times=times, q=goes.q[rows], v=goes.v[rows])
    swing(monitor, 0)
    assert monitor.commit(loose).safe
    swing(monitor, 1)
    assert monitor.commit(sure).safe
    assert {swing(monitor, k).stop for k in range(2, 7)} == {None}
    assert [plan.stamp for plan in monitor.plans] == ([0.0, 0.01] if is_kept else [0.0])
    # What appears in its way is news for an arm that will follow it.
    put_post(obstacles, 0.45, distance=0.42)
    assert (ReasonKind.PIECE_UNSAFE in kinds(swing(monitor, 7))) == is_kept


@pytest.mark.parametrize("leave", ["never", "any"])
def test_an_arm_is_always_on_a_kept_piece_and_touches_nothing(leave):
    """Pieces that overlap, replace one another, lose answers; brakes and balls at any time."""
    hunt = PlanHunt(load_holding("panda"), 7, latency=0.1, leave=leave)
    for _ in range(12):
        hunt.play()
    score = hunt.score
    assert score.contacts == score.astray == 0
    # Else nothing would be shown.
    assert min(score.safe, score.lost, score.followed) > 50
    assert min(score.balls, score.brakes, score.near, score.aside, score.vague) > 0


def test_pieces_that_begin_ahead_do_not_add_up_where_they_may_be_left():
    _, monitor = start(leave="any")
    q = np.tile(HOME, (2, 1))
    for k in range(1, 100):
        now = k * PERIOD
        monitor.step(now, HOME, STILL)
        ahead = 0.0 if k == 1 else 0.5 * PERIOD
        piece = make_plan(stamp=now + ahead, times=[0.0, 0.2], q=q, v=0.0 * q)
        assert monitor.commit(piece).safe, k
        assert len(monitor._judge.pieces._pieces) <= 3


def test_pieces_beyond_those_that_room_was_made_for_keep_what_was_known(monkeypatch):
    monkeypatch.setattr(committed_pieces, "USUAL_PIECES", 1)
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    see(obstacles, 0.0, FAR)
    monitor.step(0.0, HOME, STILL)
    plan, most = make_plan(), 0
    pieces = monitor._judge.pieces
    for k in range(15):
        assert monitor.commit(cut(plan, k, k + 3, monitor)).safe
        most = max(most, len(pieces._pieces))
        monitor.step(float(TIMES[k + 1]), plan.q[k + 1], plan.v[k + 1])
        # None is judged anew, for none has lost what its proof rests on.
        assert pieces.evaluated == 0
    assert most > 2


def test_everything_is_compiled_before_the_first_plan():
    modules = (contact, curve, following, slabs, stop, committed_pieces)
    kernels = [
        one for module in modules for one in vars(module).values() if hasattr(one, "signatures")
    ]
    obstacles, monitor = make_monitor(motion="planned", rate=100.0)
    before = [len(one.signatures) for one in kernels]
    plan = make_plan()
    obstacles.add_static("post", [0.9, 0.0, 0.5], 0.05)
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(monitor.with_stop(plan)).safe
    follow(monitor, plan, 5)
    assert [len(one.signatures) for one in kernels] == before


def test_the_pieces_that_the_arm_may_be_on_are_there_to_be_looked_at_until_a_reset():
    _, monitor = start(0.3)
    assert monitor.plans == []
    plan = make_plan()
    assert monitor.commit(plan).safe
    (known,) = monitor.plans
    assert np.array_equal(known.q, plan.q)
    follow(monitor, plan, 3)
    monitor.reset()
    assert monitor.plans == []
    (reason,) = monitor.commit(plan).reasons
    assert (reason.kind, reason.subject) == (ReasonKind.PLAN_REFUSED, "arm")
    verdicts = [monitor.step(float(TIMES[k]), plan.q[k], plan.v[k]) for k in range(3, len(TIMES))]
    assert min(verdict.level for verdict in verdicts) is Level.STOP


def permit_hands(speed):
    """Limits by which a hand may be touched at so many [m]/[s], and pressed for 1 m."""
    if speed == 0.0:
        return ContactLimits({"hand": ContactLimit(speed=0.0, source="test")})
    given = {"force": 100.0, "stiffness": 100.0, "body_mass": 100.0 / speed**2}
    return ContactLimits({"hand": ContactLimit(source="test", **given)})


@pytest.mark.parametrize("leave", ["never", "any"])
def test_a_slow_piece_is_safe_beside_a_hand_where_contact_is_permitted(leave):
    for limits, region, is_safe in (
        (None, HAND, False),
        (permit_hands(0.9), HAND, True),
        (permit_hands(0.9), HEAD, False),
        (permit_hands(0.05), HAND, False),
        (permit_hands(0.0), HAND, False),
    ):
        obstacles, monitor = make_monitor(
            motion="planned", leave=leave, reaction_time=0.02, contact_limits=limits
        )
        put_post(obstacles, 0.4, distance=0.42)
        obstacles.table.marks.regions[:] = 2**region
        monitor.step(0.0, HOME, STILL)
        answer = monitor.commit(make_plan())
        assert answer.safe == is_safe, (limits, region)
        if not is_safe:
            assert kinds(answer) == {ReasonKind.PLAN_UNSAFE}
            told = (limits is not None) * "may never be touched"
            if limits is not None and region == HAND and limits.by_region["hand"].max_speed > 0.0:
                told = (
                    "at most 0.05 m/s and, where it can be clamped, 1e+03 mm of way are permitted"
                )
            assert told in answer.reasons[0].detail
            assert (limits is None) == ("; " not in answer.reasons[0].detail)
