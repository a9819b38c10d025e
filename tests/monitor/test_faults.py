"""What must stop the arm: faults that stay until a reset, and faults that stay while they last."""

import functools
import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles, Source
from armguard.obstacles import table as obstacle_table
from armguard.scheduling import scheduler
from armguard.verdict import Effect, Level, ReasonKind
from support.panda_monitor import (
    FAR,
    HOME,
    PERIOD,
    STILL,
    keep,
    kinds,
    make_monitor,
    panda,
    see,
    steps,
    subjects,
)

HOLD = 0.3

PAIR_SCHEDULES = ["full", "daa"]
SCHEDULES = ["deadline", *PAIR_SCHEDULES]


@pytest.fixture(params=SCHEDULES)
def schedule(request):
    return request.param


def changed(vector, joint, value):
    vector = vector.copy()
    vector[joint] = value
    return vector


LATCHING = {
    "q not finite": (lambda m: m.step(0.01, changed(HOME, 2, math.nan), STILL), "MALFORMED"),
    "v not finite": (lambda m: m.step(0.01, HOME, changed(STILL, 2, math.inf)), "MALFORMED"),
    "q too short": (lambda m: m.step(0.01, HOME[:6], STILL), "MALFORMED"),
    "v too long": (lambda m: m.step(0.01, HOME, np.zeros(8)), "MALFORMED"),
    "q of strings": (lambda m: m.step(0.01, ["0"] * 7, STILL), "MALFORMED"),
    "q missing": (lambda m: m.step(0.01, None, STILL), "MALFORMED"),
    "v missing": (lambda m: m.step(0.01, HOME, None), "MALFORMED"),
    "q beyond limits": (lambda m: m.step(0.01, changed(HOME, 0, 3.0), STILL), "BEYOND_LIMITS"),
    "v beyond limits": (lambda m: m.step(0.01, HOME, changed(STILL, 0, -3.0)), "BEYOND_LIMITS"),
    "q jumped": (lambda m: m.step(0.01, HOME + 0.1, STILL), "JUMPED"),
    "v jumped": (lambda m: m.step(0.01, HOME, STILL + 1.0), "JUMPED"),
    "gap in stamps": (lambda m: m.step(0.2, HOME, STILL), "GAP"),
    "state too old": (lambda m: m.step(0.01, HOME, STILL, 0.08), "GAP"),
    "state from ahead": (lambda m: m.step(0.06, HOME, STILL, 0.005), "GAP"),
}
LATCHING = {name: (act, f"JOINT_STATE_{kind}") for name, (act, kind) in LATCHING.items()}
LATCHING |= {
    f"{part} {bad!r}": (act, "TIME_INVALID")
    for bad in (math.nan, math.inf, -math.inf, "0.01", None, [0.01], 10**400, True, Decimal(1))
    for part, act in (
        ("stamp", lambda m, bad=bad: m.step(bad, HOME, STILL, 0.01)),
        ("now", lambda m, bad=bad: m.step(0.01, HOME, STILL, bad)),
    )
    if not (part == "now" and bad is None)
}
LATCHING |= {
    "stamp backwards": (lambda m: m.step(0.003, HOME, STILL, 0.01), "TIME_BACKWARDS"),
    "clock backwards": (lambda m: m.step(0.005, HOME, STILL, 0.004), "TIME_BACKWARDS"),
}


@pytest.mark.parametrize("name", LATCHING)
def test_latched_faults_stay_until_reset(name):
    act, expected = LATCHING[name]
    kind = ReasonKind[expected]
    obstacles, monitor = make_monitor(joint_timeout=0.05)
    assert {one.level for one in keep(obstacles, monitor, 0, 6)} == {Level.CLEAR}
    verdict = act(monitor)
    assert kind.effect is Effect.LATCHED
    assert verdict.reasons[0].kind is kind
    assert (verdict.level, verdict.speed_scale, verdict.complete) == (Level.STOP, 0.0, False)
    assert (verdict.contact_time, verdict.stop_time) == (0.0, math.inf)
    assert (verdict.link, verdict.obstacle) == (None, None)
    assert monitor.faults == 1
    sequence = verdict.sequence
    for later in keep(obstacles, monitor, 300, 5) + keep(obstacles, monitor, 2000, 5):
        sequence += 1
        assert (later.level, later.speed_scale) == (Level.STOP, 0.0)
        assert kind in kinds(later)
        assert later.sequence == sequence
    monitor.reset()
    first, *_, last = keep(obstacles, monitor, 2010, 302)
    assert (first.level, kinds(first)) == (Level.STOP, {ReasonKind.HOLD})
    assert first.sequence == sequence + 1
    assert (last.level, last.reasons) == (Level.CLEAR, ())


def test_after_a_state_that_is_refused_no_certificate_of_before_counts(schedule):
    """An arm that reports the impossible may have left what they rest on."""
    obstacles, monitor = make_monitor(schedule)
    see(obstacles, 0.0, [3.0, 0.0, 0.5])
    before = steps(monitor, 0, 3)
    assert schedule != "deadline" or before[-1].evaluated == 0
    monitor.step(3 * PERIOD, HOME + np.nan, STILL)
    others, anew = make_monitor(schedule)
    see(others, 0.0, [3.0, 0.0, 0.5])
    (later,), (first,) = steps(monitor, 4, 1), steps(anew, 4, 1)
    assert later.evaluated == first.evaluated > 0
    assert later.contact_time == first.contact_time


@pytest.mark.hazard("H-25")
def test_an_error_inside_is_a_latched_stop(schedule, monkeypatch):
    obstacles, monitor = make_monitor(schedule)
    keep(obstacles, monitor, 0, 5)
    with monkeypatch.context() as patch:
        part = "_advance" if schedule == "deadline" else "_evaluate_due"
        patch.setattr(monitor._scheduler, part, lambda *_: 1 // 0)
        (verdict,) = keep(obstacles, monitor, 5, 1)
    assert (verdict.level, verdict.contact_time) == (Level.STOP, 0.0)
    assert subjects(verdict, ReasonKind.INTERNAL_ERROR) == {"ZeroDivisionError"}
    assert {one.level for one in keep(obstacles, monitor, 6, 400)} == {Level.STOP}
    monitor.reset()
    first, *_, last = keep(obstacles, monitor, 406, 302)
    assert (first.level, first.complete) == (Level.STOP, True)
    assert (last.level, last.complete) == (Level.CLEAR, True)


PARTS = [
    *(("deadline", part) for part in ("insert", "remove", "_advance", "_evaluate_due")),
    *(
        (schedule, method)
        for schedule in PAIR_SCHEDULES
        for method in ("insert", "remove", "due", "settle", "flagged")
    ),
]


@pytest.mark.parametrize(("schedule", "part"), PARTS)
def test_an_error_in_a_schedule_loses_no_pair(schedule, part, monkeypatch):
    """Wherever it strikes: after a reset each pair is watched."""
    obstacles, monitor = make_monitor(schedule)
    see(obstacles, 0.0, [FAR, FAR], ("stays", "goes"))
    steps(monitor, 0, 1)
    obstacles.remove(["goes"])
    see(obstacles, PERIOD, [0.6, 0.0, 0.5], ("comes",))
    place = scheduler if schedule == "deadline" else monitor._scheduler.schedule
    with monkeypatch.context() as patch:
        place = monitor._scheduler if part.startswith("_") else place
        patch.setattr(place, part, lambda *_: 1 // 0, raising=True)
        (verdict,) = steps(monitor, 1, 1)
    assert ReasonKind.INTERNAL_ERROR in kinds(verdict)
    monitor.reset()
    (verdict,) = steps(monitor, 2, 1)
    assert verdict.complete
    assert (verdict.level, verdict.obstacle) == (Level.STOP, "comes")
    watched = {(report.link, report.obstacle) for report in monitor.pairs(99)}
    assert watched == {(link, name) for link in panda().links for name in ("stays", "comes")}


def test_two_monitors_cannot_share_a_table():
    obstacles, older = make_monitor()
    keep(obstacles, older, 0, 2)
    _, newer = make_monitor(obstacles=obstacles)
    (verdict,) = steps(newer, 2, 1)
    assert (verdict.level, verdict.obstacle) == (Level.CLEAR, "ball")
    (verdict,) = steps(older, 2, 1)
    assert verdict.level is Level.STOP
    assert ReasonKind.INTERNAL_ERROR in kinds(verdict)


def test_reset_before_the_first_tick_and_twice(schedule):
    obstacles, monitor = make_monitor(schedule)
    for start in (0, 302):
        monitor.reset()
        monitor.reset()
        verdicts = keep(obstacles, monitor, start, 302)
        assert {one.level for one in verdicts[:299]} == {Level.STOP}
        assert all(kinds(one) == {ReasonKind.HOLD} for one in verdicts[:299])
        assert verdicts[-1].level is Level.CLEAR


def assert_lasts_and_holds(obstacles, monitor, kind, present, until, subject=None):
    """`present` are verdicts under the fault; it ended before tick number `until`."""
    assert kind.effect is Effect.STANDING
    for verdict in present:
        assert (verdict.level, verdict.speed_scale) == (Level.STOP, 0.0)
        assert kind in kinds(verdict)
        assert subject is None or subject in subjects(verdict, kind)
    held = round(HOLD / PERIOD) - 2
    after = keep(obstacles, monitor, until, held)
    assert {verdict.level for verdict in after} == {Level.STOP}
    for verdict in after:
        assert kind not in kinds(verdict)
        assert ReasonKind.HOLD in kinds(verdict)
    assert keep(obstacles, monitor, until + held, 5)[-1].level is Level.CLEAR


def test_a_required_source_that_is_not_heard(schedule):
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles(sources=["default"]))
    silent = steps(monitor, 0, 50)
    assert_lasts_and_holds(
        obstacles, monitor, ReasonKind.SOURCE_SILENT, silent, 50, subject="default"
    )


@pytest.mark.hazard("H-01")
def test_a_source_that_has_spoken_and_falls_silent(schedule):
    obstacles, monitor = make_monitor(schedule)
    assert keep(obstacles, monitor, 0, 1)[0].level is Level.CLEAR
    assert {verdict.level for verdict in steps(monitor, 1, 200)} == {Level.CLEAR}
    assert_lasts_and_holds(
        obstacles, monitor, ReasonKind.SOURCE_SILENT, steps(monitor, 201, 100), 301
    )


def test_a_heartbeat_is_enough():
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=["camera"]))
    obstacles.update([], 0.0, source="camera")
    (verdict,) = steps(monitor, 0, 1)
    assert (verdict.level, verdict.contact_time) == (Level.CLEAR, math.inf)


@pytest.mark.hazard("H-03")
def test_a_stamp_far_ahead_of_the_clock(schedule):
    """The state is not believed, nor is any before it: the obstacle could be anywhere."""
    obstacles, monitor = make_monitor(schedule)
    keep(obstacles, monitor, 0, 2)
    see(obstacles, 0.3, FAR)
    kind, present = ReasonKind.STAMP_AHEAD, steps(monitor, 2, 90)
    assert ReasonKind.OBSTACLE_REFUSED in kinds(present[-1])
    assert_lasts_and_holds(obstacles, monitor, kind, present, 92, subject="default")


def test_a_sample_that_is_no_number_says_nothing_for_the_rise_delay(schedule):
    """However good the samples are that follow it; then the level waits for evidence."""
    obstacles, monitor = make_monitor(schedule)
    keep(obstacles, monitor, 0, 2)
    see(obstacles, 2 * PERIOD, [math.nan, 0.0, 0.0])
    lasting = round(HOLD / PERIOD)
    unknown = steps(monitor, 2, 1) + keep(obstacles, monitor, 3, lasting - 2)
    for verdict in unknown:
        assert (verdict.level, verdict.contact_time) == (Level.STOP, 0.0)
        assert "ball" in subjects(verdict, ReasonKind.OBSTACLE_REFUSED)
    after = keep(obstacles, monitor, lasting + 4, lasting - 6)
    for verdict in after:
        assert (verdict.level, verdict.contact_time > 1.0) == (Level.STOP, True)
        assert kinds(verdict) == {ReasonKind.HOLD}
    assert keep(obstacles, monitor, 2 * lasting, 6)[-1].level is Level.CLEAR
    assert monitor.faults == 1


def test_an_obstacle_that_finds_no_room_stops_the_arm_for_as_long(schedule, monkeypatch):
    monkeypatch.setattr(obstacle_table, "MAXIMUM_ROWS", 64)
    obstacles, monitor = make_monitor(schedule)
    names = [f"b{k}" for k in range(65)]
    obstacles.update(names, 0.0, np.full((65, 3), 20.0), radius=0.1)
    tick = 0
    for change in (lambda: None, lambda: obstacles.remove(["b7"])):
        change()
        for _ in range(400):
            obstacles.update([], tick * PERIOD)
            verdict = monitor.step(tick * PERIOD, HOME, STILL)
            assert (verdict.level, verdict.contact_time) == (Level.STOP, 0.0)
            assert (verdict.link, verdict.obstacle) == (None, None)
            assert "b64" in subjects(verdict, ReasonKind.OBSTACLE_REFUSED)
            tick += 1
    obstacles.update(["b64"], tick * PERIOD, [FAR], radius=0.1)
    (verdict,) = steps(monitor, tick, 1)
    assert verdict.contact_time > 1.0
    obstacles.update([], (tick + 150) * PERIOD)
    later = steps(monitor, tick + 1, 302)
    assert later[-4].level is Level.STOP
    assert later[-1].level is Level.CLEAR


def test_another_track_is_believed_after_five_samples(schedule):
    obstacles, monitor = make_monitor(schedule)
    keep(obstacles, monitor, 0, 2)
    near = [1.2, 0.0, 0.5]
    for i in range(2, 6):
        see(obstacles, i * PERIOD, near)
        (verdict,) = steps(monitor, i, 1)
        assert 0.0 < verdict.contact_time < 1.0
        assert verdict.level in (Level.STOP, Level.SLOW, Level.AWARE)
        assert ReasonKind.OBSTACLE_REFUSED in kinds(verdict)
    see(obstacles, 6 * PERIOD, near)
    (verdict,) = steps(monitor, 6, 1)
    assert kinds(verdict) >= {ReasonKind.BOUND_BROKEN, ReasonKind.OBSTACLE_REFUSED}
    assert obstacles.table.points[obstacles.row("ball"), 0].tolist() == near
    for i in range(7, 320):
        see(obstacles, i * PERIOD, near)
        (verdict,) = steps(monitor, i, 1)
        # The track before may be true for as long as what was refused.
        assert (ReasonKind.OBSTACLE_REFUSED in kinds(verdict)) == (i <= 306) or i in (305, 307)
    assert Effect.STANDING not in {reason.kind.effect for reason in verdict.reasons}


def test_a_malformed_call(schedule):
    obstacles, monitor = make_monitor(schedule)
    keep(obstacles, monitor, 0, 2)
    with pytest.raises(ArmguardError):
        obstacles.update(["ball"], 0.002, [[1.0, 2.0]], radius=0.1)
    kind = ReasonKind.CALL_REFUSED
    assert_lasts_and_holds(obstacles, monitor, kind, steps(monitor, 2, 1), 3, subject="default")


def test_a_joint_that_runs_into_its_stop():
    obstacles, monitor = make_monitor()
    q, v = changed(HOME, 6, 2.88), changed(STILL, 6, 1.5)
    (verdict,) = keep(obstacles, monitor, 0, 1, q, v)
    assert verdict.level is Level.STOP
    assert subjects(verdict, ReasonKind.JOINT_STOP_AHEAD) == {"panda_joint7"}
    assert verdict.contact_time > 0.0
    q, v = changed(HOME, 6, 2.8812), changed(STILL, 6, 1.5 - 0.02)
    back = changed(HOME, 6, -2.88), changed(STILL, 6, -1.5)
    monitor.reset()
    (verdict,) = keep(obstacles, monitor, 0, 1, *back)
    assert subjects(verdict, ReasonKind.JOINT_STOP_AHEAD) == {"panda_joint7"}
    monitor.reset()
    away = changed(HOME, 6, 2.88), changed(STILL, 6, -1.5)
    assert not subjects(keep(obstacles, monitor, 0, 1, *away)[0], ReasonKind.JOINT_STOP_AHEAD)


def test_steps_that_each_fit_but_not_together():
    """Every sample agrees with the one before; the certificate behind them tells the truth."""
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, FAR, position_error=0.05)
    assert steps(monitor, 0, 1)[0].level is Level.CLEAR
    broken = []
    for i in range(1, 8):
        see(obstacles, i * PERIOD, [FAR[0] - 0.09 * i, 0.0, 0.5], position_error=0.05)
        broken += [subjects(verdict, ReasonKind.BOUND_BROKEN) for verdict in steps(monitor, i, 1)]
    assert {"ball"} in broken


@pytest.mark.parametrize("name", LATCHING)
def test_a_latched_fault_says_since_when_in_every_verdict(name):
    act, expected = LATCHING[name]
    obstacles, monitor = make_monitor(joint_timeout=0.05)
    keep(obstacles, monitor, 0, 6)
    first = act(monitor)
    since = first.reasons[0].detail
    when = since.rpartition("latched since ")[2]
    assert since.endswith(f"latched since {when}")
    assert 0.004 <= float(when.removesuffix(" s")) <= 0.2
    for later in keep(obstacles, monitor, 300, 3):
        assert since in {r.detail for r in later.reasons if r.kind is ReasonKind[expected]}


def test_a_fault_before_the_first_tick_is_latched_since_then():
    _, monitor = make_monitor()
    verdict = monitor.step(math.nan, HOME, STILL)
    assert "latched since before the first tick" in str(verdict.reasons[0])


@pytest.mark.hazard("H-04")
@pytest.mark.parametrize("clock", ["its own", "none"])
def test_a_joint_stamp_that_never_changes_is_a_gap(schedule, clock):
    """A driver that hangs goes on telling its last state, perhaps with a stamp ahead."""
    obstacles, monitor = make_monitor(schedule, joint_timeout=0.05)
    see(obstacles, 0.0, FAR)
    stopped = None
    for tick in range(60):
        now = 0.04 + tick * PERIOD if clock == "its own" else None
        verdict = monitor.step(0.07, HOME, STILL, now)
        if ReasonKind.JOINT_STATE_GAP in kinds(verdict) and stopped is None:
            stopped = tick
            (reason,) = verdict.reasons
            assert "0.07" in reason.detail
            assert "0.05" in reason.detail
    assert stopped == 51
    assert verdict.level is Level.STOP


@pytest.mark.parametrize("settings", [{}, {"joint_timeout": 0.2}, {"rate": 100.0}])
def test_joint_states_slower_than_ticks_are_no_stamps_that_never_change(settings):
    obstacles, monitor = make_monitor(source_timeout=100.0, **settings)
    see(obstacles, 0.0, FAR)
    for tick in range(300):
        now = tick * PERIOD
        verdict = monitor.step(now // 0.04 * 0.04, HOME, STILL, now)
        assert verdict.level is Level.CLEAR, verdict.reasons


@pytest.mark.hazard("H-10")
def test_a_pattern_that_matches_nothing_is_a_stop_until_it_does(schedule):
    obstacles, monitor = make_monitor(schedule, ignore=[("panda_hand", "tabel"), ("*", "p?")])
    kind, names = ReasonKind.IGNORE_UNMATCHED, [f"thing{k}" for k in range(4)]
    (verdict,) = keep(obstacles, monitor, 0, 1)
    assert subjects(verdict, kind) == {"'tabel'", "'p?'"}
    assert all("there are ball;" in r.detail for r in verdict.reasons if r.kind is kind)
    obstacles.update(names, 0.0, np.full((4, 3), 20.0), radius=0.1)
    obstacles.add_static("p1", FAR, 0.1)
    (verdict,) = keep(obstacles, monitor, 1, 1)
    assert subjects(verdict, kind) == {"'tabel'"}
    (reason,) = (r for r in verdict.reasons if r.kind is kind)
    assert all(name in reason.detail for name in ["ball", *names])
    assert "p1" not in reason.detail
    assert "third element" in reason.detail
    assert verdict.level is Level.STOP
    obstacles.add_static("tabel", FAR, 0.1)
    held = keep(obstacles, monitor, 2, 301)
    assert not any(subjects(one, kind) for one in held)
    assert (held[0].level, held[-1].level) == (Level.STOP, Level.CLEAR)
    # What was there once need not stay, also over a reset and another tool.
    obstacles.remove(["tabel", "p1"])
    monitor.reset()
    after = keep(obstacles, monitor, 303, 302)
    assert not any(subjects(one, kind) for one in after)
    assert after[-1].level is Level.CLEAR


def test_what_a_source_is_to_report_may_be_ignored_before_it_comes():
    table = Obstacles(sources=["camera", "scanner"])
    obstacles, monitor = make_monitor(obstacles=table, ignore=[("*", "part*", "camera")])

    def see_both(tick, names=()):
        now = tick * PERIOD
        for source in ("camera", "scanner"):
            obstacles.update(
                [f"{name}-{source}" for name in names],
                now,
                np.full((len(names), 3), 0.5),
                radius=0.1,
                source=source,
            )
        return monitor.step(now, HOME, STILL)

    verdict = see_both(0)
    assert not subjects(verdict, ReasonKind.IGNORE_UNMATCHED)
    assert verdict.level is Level.CLEAR
    verdict = see_both(1, ["part"])
    assert (verdict.level < Level.AWARE, verdict.obstacle) == (True, "part-scanner")
    assert {one.obstacle for one in monitor.pairs()} == {"part-scanner"}


garbage = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=3),
    st.binary(max_size=3),
    st.lists(st.one_of(st.floats(), st.none(), st.text(max_size=2)), max_size=8),
    st.lists(st.floats(-2.0, 2.0), min_size=7, max_size=7),
    st.just(HOME),
    st.just(STILL),
    st.complex_numbers(),
    st.dictionaries(st.text(max_size=1), st.integers(), max_size=2),
    st.just(object()),
    st.just(np.zeros((7, 7))),
    st.just(np.array("x")),
    st.just(np.float64(1.0)),
    st.just(np.datetime64("2026-01-01")),
)


# Not when tests are collected, where kernels would compile in each process before any test runs.
make_garbage_scene = functools.cache(make_monitor)


@pytest.mark.hazard("H-23")
@settings(max_examples=150)
@given(st.lists(st.tuples(garbage, garbage, garbage, garbage), max_size=5))
def test_step_never_raises(calls):
    obstacles, monitor = make_garbage_scene()
    monitor.reset()
    see(obstacles, 0.0, FAR)
    for call in calls:
        verdict = monitor.step(*call)
        assert isinstance(verdict.level, Level)
        assert isinstance(verdict.stamp, float)
        assert not math.isnan(verdict.contact_time)
        assert verdict.valid_until < math.inf
        if any(reason.kind.effect is Effect.LATCHED for reason in verdict.reasons):
            assert (verdict.level, verdict.speed_scale) == (Level.STOP, 0.0)
        assert ReasonKind.INTERNAL_ERROR not in kinds(verdict)
    assert isinstance(monitor.pairs(), list)


def test_who_comes_in_the_middle_of_a_step_is_watched_from_the_next_one():
    obstacles, monitor = make_monitor(rise_delay=0.0)
    keep(obstacles, monitor, 0, 3)

    class Interrupted(set):
        def add(self, row):
            steps(monitor, 3, 1)
            super().add(row)

    obstacles._added = Interrupted(obstacles._added)
    see(obstacles, 3 * PERIOD, [0.55, 0.0, 0.6], ["near"])
    (verdict,) = steps(monitor, 4, 1)
    assert (verdict.level, verdict.obstacle) == (Level.STOP, "near")


def test_after_a_reset_silence_that_another_monitor_heard_of_is_heard_again():
    named = Obstacles(sources=[Source("late", required=False)])
    obstacles, monitor = make_monitor(obstacles=named, rise_delay=0.0)
    see(obstacles, 1.0, FAR)
    steps(monitor, 1000, 2)
    _, other = make_monitor(obstacles=obstacles)
    obstacles.update([], 0.7, source="late")
    steps(other, 1002, 1)
    monitor.reset()
    (verdict,) = steps(monitor, 1003, 1)
    assert subjects(verdict, ReasonKind.SOURCE_SILENT) == {"late"}
