"""What is taken, what is refused and kept beside it, and when another track is believed."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

import numpy as np
import pytest

from armguard.jit import kernel, pack
from armguard.obstacles import Fault, FaultKind, Obstacles
from armguard.obstacles.acceptance import TAKEN, _find_flaw, _is_flawless
from armguard.obstacles.broken_bounds import (
    BODY_LIMITS,
    BROKEN_FACTOR,
    BROKEN_FOR,
    FURTHER_SAMPLES,
)
from armguard.obstacles.table import MOST_REFUSED, clear_changed_rows, copy_state, make_states
from support.obstacle_samples import check_invariants, kinds, possible, refused, see

INF = math.inf
RECORDINGS = Path(
    os.environ.get("ARMGUARD_RECORDINGS", Path(__file__).parents[2] / "../shared/data/human-motion")
)


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("position", [[0, math.nan, 0]], FaultKind.NOT_FINITE),
        ("position", [[0, INF, 0]], FaultKind.NOT_FINITE),
        ("velocity", [[0, 0, math.nan]], FaultKind.NOT_FINITE),
        ("velocity", [[2.5, 0, 0]], FaultKind.BEYOND_SPEED),
        ("radius", math.nan, FaultKind.NOT_FINITE),
        ("radius", INF, FaultKind.NOT_FINITE),
        ("radius", -0.1, FaultKind.NEGATIVE),
        ("accel", math.nan, FaultKind.NOT_FINITE),
        ("accel", -1.0, FaultKind.NEGATIVE),
        ("accel", -INF, FaultKind.NOT_FINITE),
        ("speed", math.nan, FaultKind.NOT_FINITE),
        ("speed", -1.0, FaultKind.NEGATIVE),
        ("position_error", INF, FaultKind.NOT_FINITE),
        ("position_error", -1.0, FaultKind.NEGATIVE),
        ("velocity_error", INF, FaultKind.NOT_FINITE),
        ("velocity_error", -1.0, FaultKind.NEGATIVE),
    ],
)
def test_a_bad_row_is_refused_and_the_good_one_beside_it_taken(field, value, kind):
    good = {
        "position": [[0.0, 0, 0]],
        "velocity": [[0.0, 0, 0]],
        "radius": 0.1,
        "accel": 10.0,
        "speed": 2.0,
        "position_error": 0.0,
        "velocity_error": 0.0,
    }
    both = {
        name: np.concatenate([np.atleast_1d(one), np.atleast_1d(value if name == field else one)])
        for name, one in good.items()
    }
    for fresh in (True, False):
        obstacles = Obstacles()
        if not fresh:
            obstacles.update(
                ["good", "bad"],
                0.0,
                **{k: [v, v] for k, v in good.items()}
                | {"position": np.zeros((2, 3)), "velocity": np.zeros((2, 3))},
            )
        obstacles.update(["good", "bad"], 0.01, **both, source="default")
        table, row = obstacles.table, obstacles.row("bad")
        assert table.stamp[obstacles.row("good")] == 0.01
        assert not table.refused[obstacles.row("good")]
        assert table.refused[row]
        assert table.has_state[row] == (not fresh)
        assert table.unknown[row] == (kind is not FaultKind.BEYOND_SPEED)
        (fault,) = obstacles.take_faults()
        assert (fault.kind, fault.source, fault.id) == (kind, "default", "bad")
        assert (fault.field, fault.stamp) == (field, 0.01)
        assert obstacles.refused_rows().tolist() == [row]
        check_invariants(obstacles)
        # One good sample does not clear what was refused; time does.
        see(obstacles, 0.02, id="bad")
        assert table.has_state[row]
        for now, lasts in ((0.02, True), (0.3, True), (0.33, False)):
            obstacles.forget_refused(now, 0.3)
            assert bool(table.refused[row]) == bool(len(obstacles.refused_rows())) == lasts
        assert not table.unknown[row]
        check_invariants(obstacles)


def test_a_jump_leaves_the_accepted_state_and_keeps_the_sample_aside():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    revision = obstacles.table.revision[row]
    see(obstacles, 0.01, x=1.0, radius=0.2)
    table = obstacles.table
    assert table.points[row, 0, 0] == 0.0
    assert table.stamp[row] == 0.0
    assert table.revision[row] == revision + 1
    assert table.refused[row]
    assert not table.unknown[row]
    assert refused(obstacles, row) == [1.0]
    states, place, age = possible(obstacles, row, 0.05)[1]
    assert (states.radius[place], states.stamp[place], age) == (0.2, 0.01, 0.04)
    assert obstacles.take_faults() == [
        Fault(FaultKind.BEYOND_ACCEL, "default", "a", "position", 1.0, 0.01)
    ]
    see(obstacles, 0.02, x=0.001)
    assert refused(obstacles, row) == [1.0]
    assert table.points[row, 0, 0] == 0.001
    assert table.revision[row] == revision + 2


def test_another_track_is_believed_after_five_samples_that_agree():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    revision = obstacles.table.revision[row]
    for i in range(1, 5):
        see(obstacles, 0.01 * i, x=1.0)
        assert obstacles.table.refused[row]
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL] * 4
    see(obstacles, 0.05, x=1.0)
    assert kinds(obstacles) == [FaultKind.TRACK_CHANGED]
    assert obstacles.table.points[row, 0, 0] == 1.0
    assert obstacles.table.revision[row] == revision + 5
    # What was believed before may be true all the same, for as long as any refused sample.
    assert refused(obstacles, row) == [1.0, 0.0]
    obstacles.forget_refused(0.05, 0.3)
    obstacles.forget_refused(0.36, 0.3)
    assert not obstacles.table.refused[row]


def test_another_shape_is_another_track():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i in range(1, 6):
        obstacles.update(["a"], 0.01 * i, np.zeros((1, 2, 3)), radius=0.1)
    assert kinds(obstacles) == [FaultKind.SHAPE_CHANGED] * 4 + [FaultKind.TRACK_CHANGED]
    assert obstacles.table.point_count[row] == 2


@pytest.mark.hazard("H-14")
def test_samples_that_do_not_agree_never_make_a_track():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i in range(1, 40):
        see(obstacles, 0.01 * i, x=2.0 + 2.0 * (i % 4 == 0))
        assert obstacles.table.refused[row]
        assert obstacles.table.points[row, 0, 0] == 0.0
    # Two tracks, each of which bounds what is seen of it later.
    assert refused(obstacles, row) == [2.0, 4.0]
    # A repeated message is no further evidence.
    for _ in range(10):
        see(obstacles, 0.5, x=9.0)
    assert obstacles.table.points[row, 0, 0] == 0.0
    # Nor is one that cannot be reckoned with.
    for i in range(10):
        see(obstacles, 0.6 + 0.01 * i, x=9.0, velocity=[[5.0, 0.0, 0.0]])
        assert obstacles.table.refused[row]


def test_a_larger_body_or_wider_bounds_are_news_not_implausible():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i, change in enumerate(
        [{"radius": 0.5}, {"accel": 50.0}, {"speed": 5.0}, {"position_error": 0.1}]
    ):
        revision = obstacles.table.revision[row]
        see(obstacles, 0.01 * (i + 1), **change)
        assert not obstacles.table.refused[row]
        assert obstacles.table.revision[row] == revision + 1
    assert not obstacles.take_faults()


def test_late_messages_that_agree_are_ignored_and_counted():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    for stamp in (0.9, 1.0, 0.95, 1.0):
        see(obstacles, stamp)
    assert obstacles.late_count == 4
    assert obstacles.table.stamp[row] == 1.0
    assert not obstacles.table.refused[row]
    assert not obstacles.take_faults()
    see(obstacles, 0.99, x=1.0)
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL]
    assert obstacles.table.refused[row]


def test_a_stamp_far_ahead_does_not_lock_a_row():
    obstacles = Obstacles()
    row = see(obstacles, 1e6)
    assert obstacles.rows_ahead(0.0, 0.2).tolist() == [row]
    obstacles.distrust(row)
    see(obstacles, 0.01, x=3.0)
    assert obstacles.table.stamp[row] == 0.01
    assert refused(obstacles, row) == [0.0]
    obstacles.forget_refused(0.02, 0.3)
    see(obstacles, 0.02, x=3.0)
    obstacles.forget_refused(0.33, 0.3)
    assert not obstacles.table.refused[row]


@pytest.mark.parametrize("period", [0.01, 0.002])
def test_jitter_is_no_fault(period):
    """A body that speeds up and slows down, its messages late by up to a tenth of a second."""
    rng = np.random.default_rng(11)
    times = np.arange(0.0, 20.0, period)
    arrival = times + rng.uniform(0.0, 0.1, len(times))
    obstacles = Obstacles()
    for time in times[np.argsort(arrival)]:
        # |a| <= 9.9 and |v| <= 1.65, close to both bounds.
        see(
            obstacles,
            time,
            0.275 * math.sin(6.0 * time),
            velocity=[[1.65 * math.cos(6.0 * time), 0, 0]],
        )
    assert not obstacles.take_faults()
    assert not obstacles.table.refused.any()
    assert obstacles.late_count > len(times) / 4


def test_late_samples_that_disagree_are_refused_and_make_no_track():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    table = obstacles.table
    for k in range(10):
        see(obstacles, 0.9 + 0.005 * k, x=1.0, radius=0.3)
        assert table.refused[row]
        assert (table.points[row, 0, 0], table.radius[row], table.stamp[row]) == (0.0, 0.1, 1.0)
        assert refused(obstacles, row) == [1.0]
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL] * 10
    # One that goes on from there, and is newer than the accepted state, is another track.
    see(obstacles, 1.01, x=1.0, radius=0.3)
    assert kinds(obstacles) == [FaultKind.TRACK_CHANGED]
    assert table.points[row, 0, 0] == 1.0


def test_the_older_of_two_samples_says_what_the_newer_may_be():
    """Whichever came first: bounds of the older one count, and all that were told lately."""
    for late_first in (False, True):
        obstacles = Obstacles(accel=1.0)
        older = {"x": 0.0, "velocity": [[0.0, 0.0, 0.0]], "accel": 50.0}
        newer = {"x": 0.0625, "velocity": [[2.0, 0.0, 0.0]], "accel": 1.0}
        samples = [(1.0, older), (1.05, newer)]
        for stamp, sample in samples[::-1] if late_first else samples:
            row = see(obstacles, stamp, **sample)
        assert not obstacles.table.refused[row], late_first
        # That it was told to be agile still counts while messages are under way, not for ever.
        see(obstacles, 1.1, x=0.1, velocity=[[0.0, 0.0, 0.0]], accel=1.0)
        assert not obstacles.table.refused[row], late_first
        for k in range(1, 60):
            see(obstacles, 1.1 + 0.01 * k, x=0.1, accel=1.0)
        assert not obstacles.table.refused[row], late_first
        see(obstacles, 1.7, x=0.12, accel=1.0)
        assert obstacles.table.refused[row], late_first


@pytest.mark.parametrize("bound", [{"accel": 50.0}, {"speed": 20.0, "accel": 1e3}])
def test_bounds_that_were_told_just_now_count_whenever_they_are_narrowed(bound):
    """However long the source has spoken before: nothing depends on where its time is cut."""
    for begun in (0.0, 0.1, 0.195, 0.3, 0.395):
        obstacles = Obstacles(accel=1.0, speed=1.0)
        row = see(obstacles, 1.0 - begun)
        see(obstacles, 1.0, **bound)
        see(obstacles, 1.01)
        # As the wider bound allows, and the narrower one does not.
        by_speed = "speed" in bound
        fields = {"x": 0.03, "accel": 1e3} if by_speed else {"x": 1e-3}
        see(obstacles, 1.02, velocity=[[0.2, 0.0, 0.0]], **fields)
        assert not obstacles.table.refused[row], begun


def test_positions_that_were_summed_up_are_as_exact_as_sums():
    obstacles = Obstacles()
    step, x = 0.1 / 3.0, 0.0
    for k in range(2900):
        see(obstacles, 0.01 * k, x, velocity=[[100.0 * step, 0.0, 0.0]], accel=0.0, speed=4.0)
        x += step
    assert not obstacles.take_faults()
    see(obstacles, 29.0, x + 1e-7, velocity=[[100.0 * step, 0.0, 0.0]], accel=0.0, speed=4.0)
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL]


@pytest.mark.parametrize(
    ("fields", "kind", "field", "value"),
    [
        ({"x": 1500.0}, FaultKind.BEYOND_EXTENT, "position", 1500.0),
        ({"x": -100.1}, FaultKind.BEYOND_EXTENT, "position", -100.1),
        ({"speed": 2000.0}, FaultKind.BOUND_TOO_LARGE, "speed", 2000.0),
        ({"accel": 9810.0}, FaultKind.BOUND_TOO_LARGE, "accel", 9810.0),
    ],
)
def test_other_units_than_metres_are_refused_and_the_body_could_be_anywhere(
    fields, kind, field, value
):
    for fresh in (True, False):
        obstacles = Obstacles()
        if not fresh:
            see(obstacles, 0.0)
        row = see(obstacles, 0.01, **fields)
        (fault,) = obstacles.take_faults()
        assert (fault.kind, fault.field, fault.value) == (kind, field, value)
        assert obstacles.table.refused[row]
        assert obstacles.table.unknown[row]
    for none in ({"speed": INF}, {"accel": INF}):
        obstacles = Obstacles()
        see(obstacles, 0.0, **none)
        assert not obstacles.take_faults()
    obstacles = Obstacles(extent=2000.0)
    see(obstacles, 0.0, x=1500.0)
    assert not obstacles.take_faults()


def test_of_two_descriptions_with_one_stamp_the_larger_stands():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    table, revision = obstacles.table, obstacles.table.revision[row]
    see(obstacles, 1.0)
    see(obstacles, 1.0, radius=0.05)
    assert table.revision[row] == revision
    see(obstacles, 1.0, x=0.01, radius=0.5, accel=20.0, position_error=0.02)
    assert table.revision[row] == revision + 1
    see(obstacles, 0.9, radius=0.7)
    assert (table.radius[row], table.accel[row], table.speed[row]) == (0.5, 20.0, 2.0)
    assert (table.points[row, 0, 0], table.position_error[row]) == (0.0, 0.02)
    see(obstacles, 1.1)
    assert table.radius[row] == 0.1
    assert not obstacles.take_faults()


def test_late_messages_do_not_hide_a_track_that_is_about_to_be_believed():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    for i in range(1, 6):
        see(obstacles, 0.9 + 0.01 * i)
        see(obstacles, 1.0 + 0.01 * i, x=1.0)
    assert obstacles.table.points[row, 0, 0] == 1.0
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL] * 4 + [FaultKind.TRACK_CHANGED]


def test_jumps_beyond_bounds_and_errors_are_always_refused():
    rng = np.random.default_rng(8)
    count = 500
    obstacles = Obstacles()
    names = [f"n{i}" for i in range(count)]
    position = rng.normal(size=(count, 3))
    obstacles.update(names, 0.0, position, np.zeros((count, 3)), radius=0.1, position_error=0.01)
    h = 0.02
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    reach = (10.0 * h * h / 2 + 0.02) * rng.uniform(1.0 + 1e-9, 3.0, size=(count, 1))
    obstacles.update(names, h, position + away * reach, radius=0.1, position_error=0.01)
    assert obstacles.table.refused.sum() == count


def punch(period, accel=60.0, speed=5.0, begins=0.1):
    """Stamps, places and velocities of a body at rest that begins to move, and keeps its speed."""
    stamps = np.arange(0.0, 0.5, period)
    since = np.maximum(stamps - begins, 0.0)
    ramp = np.minimum(since, speed / accel)
    return stamps, 0.5 * accel * ramp**2 + speed * (since - ramp), accel * ramp


def allows(states, place, age, x):
    """Whether a body in this state can be at a place on the x axis after some time."""
    stray = abs(x - states.points[place, 0, 0] - states.velocities[place, 0, 0] * age)
    reach = (states.velocity_error[place] + 0.5 * states.accel[place] * age) * age
    return stray <= states.position_error[place] + reach + 1e-9


@pytest.mark.parametrize("period", [0.002, 0.01, 0.033])
@pytest.mark.parametrize("is_known", [True, False])
def test_a_body_that_moved_keeps_wider_bounds_for_a_while(period, is_known):
    obstacles, table = Obstacles(), None
    for stamp, x, velocity in zip(*punch(period), strict=True):
        told = {"velocity": [[velocity, 0.0, 0.0]] if is_known else None, "position_error": 1e-3}
        row = see(obstacles, stamp, x, **told)
        table = obstacles.table
        # The body is where one of the states that may be true allows it to be.
        assert any(
            allows(states, place, age, x) for states, place, age in possible(obstacles, row, stamp)
        )
    breaks = table.breaks
    assert breaks.until[row] > 0.1 + BROKEN_FOR
    assert table.speed[row] >= 5.0
    if is_known:
        assert table.accel[row] == pytest.approx(BROKEN_FACTOR * 60.0, rel=0.2)
    after = float(breaks.until[row])
    for late in (0.0, 1e-3):
        obstacles.remove(["b"])
        see(obstacles, after + late, x, position_error=50.0, velocity_error=50.0)
        assert (table.accel[row] > 10.0) == (late == 0.0)


@pytest.mark.parametrize("period", [0.01, 0.033])
@pytest.mark.parametrize("jump", [0.05, 0.2, 1.0])
def test_a_jump_leaves_no_wider_bounds(period, jump):
    obstacles = Obstacles()
    for k in range(40):
        there = 0.0 if k < 10 else jump
        row = see(obstacles, period * k, there, position_error=2e-3)
        table = obstacles.table
        states = possible(obstacles, row)
        widest = max(states.accel[place] for states, place, _ in states)
        is_decided = k < 10 or k >= 10 + FURTHER_SAMPLES
        may_be_wide = not is_decided and 2.0 * (jump - 4e-3) / period**2 < BODY_LIMITS[1]
        assert widest == 10.0 or may_be_wide
    assert table.points[row, 0, 0] == jump
    obstacles.forget_refused(period * k, 0.3)
    obstacles.forget_refused(period * k + 0.31, 0.3)
    assert len(possible(obstacles, row)) == 1


def test_of_an_undecided_sample_both_explanations_count():
    """The state of before as it was, the sample as it is stated, and with what it may show."""
    obstacles = Obstacles()
    see(obstacles, 0.0)
    row = see(obstacles, 0.01, x=0.002, velocity=[[0.4, 0.0, 0.0]])
    counted = [states.accel[place] for states, place, _ in possible(obstacles, row)]
    assert counted == pytest.approx([10.0, 10.0, 1.5 * 40.0], rel=1e-6)
    # Nothing more comes: then all of that ends with the refused sample.
    obstacles.forget_refused(0.01, 0.3)
    obstacles.forget_refused(0.32, 0.3)
    assert len(possible(obstacles, row)) == 1


def test_a_touched_body_shows_nothing_of_its_bounds():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    obstacles.table.touched[row] = True
    see(obstacles, 0.01, x=0.002, velocity=[[0.4, 0.0, 0.0]])
    assert {states.accel[place] for states, place, _ in possible(obstacles, row)} == {10.0}


def test_another_track_breaks_no_bound():
    """What would have had to move by far more than bodies do is another one, or no measurement."""
    for x, velocity in ((0.2, 0.0), (5.0, 0.0), (0.0, 9.0), (0.001, -3.0)):
        obstacles = Obstacles()
        see(obstacles, 0.0)
        row = see(obstacles, 0.01, x=x, velocity=[[velocity, 0.0, 0.0]])
        table = obstacles.table
        assert refused(obstacles, row) == [x]
        assert (table.accel[row], table.speed[row]) == (10.0, 2.0)
        # But what is faster than it may be counts with what was seen, for itself.
        speed = table.refused_states.speed[row * MOST_REFUSED]
        assert speed == max(2.0, 1.5 * abs(velocity))
        assert table.breaks.further[row] == 0


def test_bounds_that_others_broke_or_said_before_do_not_count():
    obstacles = Obstacles()
    see(obstacles, 0.0)
    see(obstacles, 0.01, x=0.002, velocity=[[0.4, 0.0, 0.0]])
    row = see(obstacles, 0.01, id="b")
    assert obstacles.table.accel[row] == 10.0
    obstacles.remove(["a"])
    row = see(obstacles, 0.02)
    assert obstacles.table.accel[row] == 10.0


def test_rows_that_are_no_news_are_as_they_were():
    """Whatever samples come, in whatever order: what may matter to a watcher is told."""
    rng = np.random.default_rng(3)
    obstacles = Obstacles()
    names = [f"n{i}" for i in range(6)]
    for name in names:
        see(obstacles, 1.0, id=name)
    table = obstacles.table

    def known():
        marks = [table.has_state, table.refused, table.unknown, table.revision]
        kept = np.stack([array.astype(float) for array in marks], axis=1)
        aside = table.refused_states
        told = np.stack([aside.points[:, 0, 0], aside.radius, aside.position_error, aside.stamp])
        told = told.T.reshape(len(kept), MOST_REFUSED, -1)
        is_there = np.arange(MOST_REFUSED) < table.refused_count[:, None]
        told = np.where(is_there[:, :, None], told, 0.0).reshape(len(kept), -1)
        return np.hstack([kept, table.points[:, 0], table.radius[:, None], told])

    quiet = 0
    for step in range(600):
        clear_changed_rows(table.changed_rows)
        obstacles.forget_refused(1.0 + 0.01 * (step // 6), 0.05)
        before = known()
        for name in rng.choice(names, 2, replace=False):
            stamp = 1.0 + 0.01 * (step // 6) + rng.choice([-0.02, 0.0, 0.01])
            x = rng.choice([0.0, 0.0, 1.0, 5.0, math.nan], p=[0.4, 0.3, 0.2, 0.05, 0.05])
            source = rng.choice(["default", "default", "default", "other"])
            see(obstacles, stamp, x, id=name, radius=rng.choice([0.1, 0.2]), source=str(source))
        after = known()
        same = ((before == after) | (np.isnan(before) & np.isnan(after))).all(axis=1)
        assert same[~table.is_changed].all()
        quiet += int((~table.is_changed[:6]).sum())
    assert quiet > 2000


def read_recording(path):
    """Names, times and positions in [m] of a Vicon table. Shape (frames, bodies, 3)."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = list(csv.reader(file))
    bodies = [cell.split(":")[-1] for cell in lines[2] if cell]
    frames = [
        [float(cell) if cell else math.nan for cell in line[2 : 2 + 6 * len(bodies)]]
        for line in lines[5:]
        if len(line) >= 2 + 6 * len(bodies)
    ]
    positions = np.array(frames).reshape(len(frames), len(bodies), 6)[:, :, 3:] / 1000.0
    return bodies, np.arange(len(frames)) / float(lines[1][0]), positions


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings on this machine")
@pytest.mark.parametrize(
    ("name", "glitches"),
    [
        ("handball-0", False),
        ("stacking-2", False),
        ("handover-0", True),
        ("hammering-0", True),
        ("pick-place-close-6", True),
    ],
)
def test_glitches_in_recordings_are_refused_and_people_are_not(name, glitches):
    bodies, times, positions = read_recording(RECORDINGS / f"{name}.csv")
    obstacles = Obstacles(accel=10.0, speed=2.0)
    found = set()
    for time, position in zip(times, positions, strict=True):
        seen = np.isfinite(position).all(axis=1)
        ids = [body for body, there in zip(bodies, seen, strict=True) if there]
        obstacles.forget_refused(time, 0.3)
        obstacles.update(ids, time, position[seen], radius=0.1, position_error=0.005)
        found.update(obstacles.ids[row] for row in obstacles.refused_rows())
        check_invariants(obstacles)
    assert bool(found) == glitches
    assert len(obstacles) == len(bodies)


def test_what_a_certificate_rests_on_is_possible_no_longer_than_a_refused_sample():
    """Each step keeps the bounds within its errors, and all of them together do not."""
    obstacles = Obstacles()
    table = obstacles.table
    x, velocity = 1.0, -1.5
    told = {"position_error": 0.01, "velocity_error": 0.05}
    row = see(obstacles, 0.0, x=x, velocity=[[velocity, 0.0, 0.0]], **told)
    copy_state(table.accepted, row, table.reference_states, row)
    clear_changed_rows(table.changed_rows)
    stamp = 0.0
    while not table.refused[row]:
        stamp += 0.01
        x, velocity = x + 0.01 * velocity, velocity + 0.105
        see(obstacles, stamp, x=x, velocity=[[velocity, 0.0, 0.0]], **told)
    assert kinds(obstacles) == []
    assert refused(obstacles, row) == [1.0]
    check_invariants(obstacles)
    assert not obstacles.is_quiet(stamp, 0.2)
    obstacles.forget_refused(stamp, 0.3)
    obstacles.forget_refused(stamp + 0.31, 0.3)
    assert len(possible(obstacles, row)) == 1


def test_a_vaguer_sample_is_compared_itself_with_what_a_certificate_rests_on():
    """Not what the accepted state makes of it, which would hide that it contradicts the other."""
    obstacles = Obstacles()
    table = obstacles.table
    told = {"position_error": 0.1, "velocity_error": 0.05}
    row = see(obstacles, 0.0, velocity=[[0.0, 0.0, 0.0]], **told)
    copy_state(table.accepted, row, table.reference_states, row)
    clear_changed_rows(table.changed_rows)
    # As fast as bounds and errors allow; then somewhat faster, with a larger error.
    see(obstacles, 0.01, velocity=[[0.19, 0.0, 0.0]], **told)
    assert not table.is_changed[row]
    see(obstacles, 0.02, velocity=[[0.49, 0.0, 0.0]], **told | {"velocity_error": 0.16})
    assert kinds(obstacles) == []
    assert table.is_changed[row]


def test_what_was_taken_by_wider_bounds_than_the_accepted_states_is_not_made_more_exact():
    """A source may narrow its bounds while the body still moves by those before."""
    obstacles = Obstacles()
    states = obstacles.table.accepted
    see(obstacles, 0.0, velocity=[[0.0, 0.0, 0.0]], accel=50.0, velocity_error=0.05)
    row = see(obstacles, 0.01, velocity=[[0.0, 0.0, 0.0]], accel=1.0, velocity_error=0.05)
    see(obstacles, 0.02, velocity=[[0.4, 0.0, 0.0]], accel=1.0, velocity_error=0.2)
    assert kinds(obstacles) == []
    assert states.velocities[row, 0, 0] == 0.4
    assert states.velocity_error[row] == 0.2


@kernel
def judge_fields(handle, speed_is_error, extent):
    return (
        _is_flawless(handle.content, speed_is_error, extent),
        _find_flaw(handle.content, speed_is_error, extent)[0],
    )


def test_what_is_clearly_without_flaw_has_none():
    """Whatever each number is; and usual samples are clear."""
    rng = np.random.default_rng(14)
    usual = (0.0, 0.1, 0.5, 1.0, 1.9, 2.0, 50.0)
    odd = (math.nan, INF, -INF, -0.1, -0.0, 100.1, 1000.1, 1e200, 1.8e308, 5e-324)
    sample = make_states(1, 2)
    handle, clear, flawed = pack(sample), 0, 0
    for _ in range(20_000):
        sample.point_count[0] = rng.integers(1, 3)
        for array in sample:
            if array is not sample.point_count:
                array[...] = rng.choice(usual, array.shape)
        array = sample[rng.integers(len(sample))]
        if array is not sample.point_count and rng.random() < 0.5:
            array[(0, *(rng.integers(size) for size in array.shape[1:]))] = rng.choice(odd)
        is_clear, flaw = judge_fields(
            handle, bool(rng.integers(2)), float(rng.choice([1.0, 60.0, INF]))
        )
        assert not (is_clear and flaw != TAKEN)
        clear += is_clear
        flawed += flaw != TAKEN
    assert clear > 500
    assert flawed > 5000


@pytest.mark.parametrize("seed", range(20))
def test_the_accepted_state_holds_the_truth_and_no_vaguer_sample_takes_from_it(seed):
    """Samples of any errors, of a body that moves as its bounds allow."""
    random = np.random.default_rng(seed)
    accel, speed, dt = 10.0, 2.0, 0.01
    obstacles = Obstacles(accel=accel, speed=speed)
    states = obstacles.table.accepted
    place, pace = random.normal(size=3), np.zeros(3)
    kept = 0
    position_room = velocity_room = INF
    for k in range(300):
        push = random.normal(size=3)
        push *= accel * random.random() / np.linalg.norm(push)
        after = pace + push * dt
        after *= min(1.0, speed / max(np.linalg.norm(after), 1e-12))
        # Straight on average, which no acceleration within the bound leaves by more.
        place, pace = place + 0.5 * dt * (pace + after), after
        error, slip = random.choice([0.001, 0.02, 0.5]), random.choice([0.01, 0.1, 3.0])
        noise = random.normal(size=(2, 3))
        noise *= random.random((2, 1)) / np.linalg.norm(noise, axis=1, keepdims=True)
        if random.random() < 0.7:
            told = pace + slip * noise[1]
            told *= min(1.0, (speed + 0.9 * slip) / max(np.linalg.norm(told), 1e-12))
            faults = obstacles.fault_count
            obstacles.update(
                ["body"], k * dt, [place + error * noise[0]], [told], radius=0.1,
                position_error=error, velocity_error=slip,
            )  # fmt: skip
            assert obstacles.fault_count == faults
            kept += states.velocity_error[0] < slip
            position_room, velocity_room = states.position_error[0], states.velocity_error[0]
        if not len(obstacles):
            continue
        age = k * dt - states.stamp[0]
        room = position_room + (velocity_room + 0.5 * accel * age) * age
        seen, heading = states.points[0, 0], states.velocities[0, 0]
        assert np.linalg.norm(place - seen - heading * age) <= room + 1e-9
        assert np.linalg.norm(pace - heading) <= velocity_room + accel * age + 1e-9
    assert kept > 30


@pytest.mark.parametrize("seed", range(20))
def test_what_is_known_is_within_the_sample_or_what_was_known(seed):
    """Whatever bounds, errors and radius a later sample states: sets of places and velocities."""
    random = np.random.default_rng(seed)
    kept = 0
    for _ in range(100):
        obstacles = Obstacles()
        states, h = obstacles.table.accepted, random.uniform(1e-3, 0.2)
        told = [
            {
                "accel": random.choice([5.0, 20.0]),
                "speed": random.choice([2.0, 3.0]),
                "radius": random.choice([0.1, 0.1, 0.2]),
                "position_error": random.choice([0.01, 0.5]),
                "velocity_error": random.choice([0.05, 3.0]),
            }
            for _ in range(2)
        ]
        row = see(obstacles, 0.0, velocity=[[0.5, 0.0, 0.0]], **told[0])
        see(obstacles, h, 0.5 * h, velocity=[[0.5, 0.0, 0.0]], **told[1])
        assert not obstacles.take_faults()
        # Rooms of the body, and of its velocity, both about the same place and velocity.
        accel = max(told[0]["accel"], told[1]["accel"])
        rate = told[0]["velocity_error"] + accel * h
        room = told[0]["position_error"] + (told[0]["velocity_error"] + 0.5 * accel * h) * h
        room += told[0]["radius"]
        stated = told[1]["position_error"] + told[1]["radius"]
        found = states.position_error[row] + states.radius[row]
        assert states.points[row, 0, 0] == pytest.approx(0.5 * h)
        assert found <= stated * (1.0 + 1e-12)
        assert states.velocity_error[row] <= told[1]["velocity_error"]
        # It is one of the two sets, so the truth, which lies in both, lies in it.
        assert found == pytest.approx(stated) or found == pytest.approx(room)
        surer = states.velocity_error[row]
        assert surer == pytest.approx(told[1]["velocity_error"]) or surer == pytest.approx(rate)
        if told[1]["radius"] > told[0]["radius"]:
            assert states.radius[row] == told[1]["radius"]
            assert found == pytest.approx(stated)
        elif told[1]["radius"] == told[0]["radius"]:
            assert found <= room * (1.0 + 1e-9)
            assert surer <= rate * (1.0 + 1e-9)
        assert (states.accel[row], states.speed[row]) == (told[1]["accel"], told[1]["speed"])
        kept += found < stated or surer < told[1]["velocity_error"]
    assert kept > 0


@pytest.mark.parametrize(("stamp", "points"), [(1.0, 1), (0.99, 1), (1.2, 1), (1.01, 3)])
def test_without_limits_of_a_body_nothing_is_made_of_samples_that_cannot_be_compared(stamp, points):
    table = Obstacles(accel=10.0, speed=2.0, body_limits=(np.inf, np.inf))
    table.update(["hand"], 1.0, [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], radius=0.1)
    places = np.full((1, points, 3), 5.0)
    table.update(["hand"], stamp, places, np.zeros((1, points, 3)), radius=0.1)
    assert table.take_faults()
    breaks, row = table.table.breaks, table.row("hand")
    assert breaks.further[row] == 0
    assert (breaks.accel[row], breaks.speed[row]) == (0.0, 0.0)
    assert (table.table.accel[row], table.table.speed[row]) == (10.0, 2.0)
