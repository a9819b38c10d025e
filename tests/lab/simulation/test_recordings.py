"""Recordings: strict reading, dropouts kept, velocities from the past with honest errors."""

import os
from pathlib import Path

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.simulation import Recording
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.recordings import estimate_velocities
from armguard.obstacles import FaultKind, Obstacles
from support.checking_sink import GrowthSink

FOLDER = Path(
    os.environ.get(
        "ARMGUARD_RECORDINGS",
        Path(__file__).parents[2] / ".." / "shared" / "data" / "human-motion",
    )
)

# Length in [s] and missing samples in percent, as published with the recordings.
PUBLISHED = {
    "handball-0": (13.7, 0.0),
    "stacking-2": (17.6, 0.0),
    "handover-0": (14.5, 0.0),
    "hammering-0": (17.1, 1.9),
    "pick-place-close-6": (12.7, 3.2),
}

ORDER = [
    "collar",
    "head",
    "left_elbow",
    "left_hand",
    "left_shoulder",
    "right_elbow",
    "right_hand",
    "right_shoulder",
    "hip",
]


def load(name):
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        pytest.skip(f"{path} is not there; set ARMGUARD_RECORDINGS to the recordings' folder")
    return Recording(path)


def make_lines(frames, rate="100"):
    """A file in which body b of frame f is at (f, 10 b, 1000) mm."""
    lines = [
        "\ufeffObjects",
        rate,
        ",," + ",,,,,,".join(f"Global Angle {name}:{name}" for name in ORDER) + ",,,,,",
        "Frame,Sub Frame" + ",RX,RY,RZ,TX,TY,TZ" * 9,
        "," + ",rad,rad,rad,mm,mm,mm" * 9,
    ]
    for frame in range(frames):
        cells = [f"0,0,0,{frame},{10 * body},1000" for body in range(9)]
        lines.append(f"{frame + 1},0," + ",".join(cells))
    return lines


def write(tmp_path, lines):
    path = tmp_path / "made.csv"
    path.write_text("\n".join(lines) + "\n\n", encoding="utf-8")
    return path


def hide(lines, frame, body):
    """Empties the cells of one body in one frame, both counted from 0."""
    cells = lines[5 + frame].split(",")
    cells[2 + 6 * body : 8 + 6 * body] = [""] * 6
    lines[5 + frame] = ",".join(cells)


@pytest.mark.parametrize("name", PUBLISHED)
def test_lengths_and_dropouts_are_those_published(name):
    recording = load(name)
    length, missing = PUBLISHED[name]
    assert recording.rate == 100.0
    assert recording.duration == pytest.approx(length, abs=0.06)
    hidden = np.isnan(recording.position).any(axis=2)
    assert 100.0 * hidden.mean() == pytest.approx(missing, abs=0.051)
    assert np.array_equal(np.isnan(recording.position).all(axis=2), hidden)
    assert np.array_equal(np.isnan(recording.velocity).all(axis=2), hidden)
    assert np.nanmax(np.abs(recording.position)) < 3.0  # metres
    sink = GrowthSink()
    recording.publish(sink, recording.duration)
    published = {(name, call[1]) for call in sink.calls for name in call[0]}
    for point in ("head", "collar", "left_hand", "right_hand"):
        frames = np.flatnonzero(~hidden[:, POINTS.index(point)])
        assert {stamp for name, stamp in published if name == point} == {k / 100 for k in frames}
    # A capsule is seen where both its ends are.
    both = ~hidden[:, POINTS.index("left_elbow")] & ~hidden[:, POINTS.index("left_hand")]
    assert sum(name == "left_elbow" for name, _ in published) == both.sum()


def count_refusals(recording):
    """Rows that the table refused as beyond their bounds, and all rows."""
    table, rows, refused = Obstacles(), 0, 0

    class Counter:
        def update(self, ids, *arguments, **keywords):
            nonlocal rows
            rows += len(ids)
            table.update(ids, *arguments, **keywords)

    kinds = (FaultKind.BEYOND_ACCEL, FaultKind.BEYOND_SPEED)
    for frame in range(round(recording.duration * recording.rate) + 1):
        recording.publish(Counter(), frame / recording.rate)
        faults = table.take_faults()
        refused += sum(fault.kind in kinds for fault in faults)
        assert all(fault.kind in (*kinds, FaultKind.TRACK_CHANGED) for fault in faults)
    return refused, rows


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("handball-0", 0.0, 0.001),
        ("stacking-2", 0.0, 0.001),
        ("hammering-0", 0.0001, 0.1),
        ("pick-place-close-6", 0.0001, 0.1),
    ],
)
def test_clean_recordings_are_taken_almost_throughout_and_glitches_refused(name, least, most):
    refused, rows = count_refusals(load(name))
    assert rows > 10_000
    assert least * rows <= refused <= most * rows


def test_the_velocity_error_holds_for_any_motion_within_its_bounds():
    """At full acceleration, reversed at random, seen with the worst measurement errors."""
    random = np.random.default_rng(0)
    rate, fine, accel, error = 100.0, 50, 10.0, 0.002
    turns = random.choice([-accel, accel], size=200)
    a = np.repeat(turns, 10 * fine // 2)
    dt = 1.0 / rate / fine
    v = np.concatenate([[0.0], np.cumsum(a) * dt])
    x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * dt)])
    position = np.zeros((len(x[::fine]), 1, 3))
    position[:, 0, 1] = x[::fine] + random.choice([-error, error], size=len(x[::fine]))
    velocity, stated = estimate_velocities(position, rate, accel, 100.0, error)
    off = np.abs(velocity[:, 0, 1] - v[::fine])
    assert (off <= stated[:, 0] + 1e-9).all()
    assert off.max() > 0.7 * stated[3:].max()  # and it is no wild overestimate
    # The window is the best whole number of samples.
    lags = np.arange(1, 50) / rate
    assert stated[-1, 0] == pytest.approx((accel * lags / 2 + 2 * error / lags).min())


def test_gaps_break_the_window_and_hidden_bodies_are_not_published(tmp_path):
    lines = make_lines(9)
    hide(lines, 4, ORDER.index("head"))
    for body in range(9):
        hide(lines, 7, body)
    recording = Recording(write(tmp_path, lines))
    head = POINTS.index("head")
    errors = recording.velocity_error[:, head]
    one, two, three = (10.0 * n / 200 + 0.4 / n for n in (1, 2, 3))
    expected = [2.0, one, two, three, 2.0, 2.0, one, 2.0, 2.0]
    assert errors == pytest.approx(expected)
    # All bodies move at 1 mm a frame along x.
    speeds = recording.velocity[[0, 1, 2, 3, 5, 6, 8], head, 0]
    assert speeds == pytest.approx([0.0, 0.1, 0.1, 0.1, 0.0, 0.1, 0.0])
    sink = GrowthSink()
    recording.publish(sink, 1.0)
    assert not any("head" in call[0] for call in sink.calls if call[1] == 0.04)
    assert [call[0] for call in sink.calls if call[1] == 0.07] == [[]]  # a heartbeat
    assert {call[-1] for call in sink.calls} == {"made"}
    table = Obstacles(sources=["made"])
    Recording(write(tmp_path, lines)).publish(table, 1.0)
    assert len(table) == 9
    assert table.take_faults() == []


def test_a_placement_moves_positions_and_turns_velocities(tmp_path):
    path = write(tmp_path, make_lines(5))
    plain = Recording(path)
    quarter = np.array([[0, -1, 0, 1.0], [1, 0, 0, 2.0], [0, 0, 1, 3.0], [0, 0, 0, 1]])
    placed = Recording(path, placement=quarter)
    assert np.allclose(placed.position[..., 0], 1.0 - plain.position[..., 1])
    assert np.allclose(placed.position[..., 1], 2.0 + plain.position[..., 0])
    assert np.allclose(placed.velocity[..., 1], plain.velocity[..., 0])
    assert plain.position[2, POINTS.index("hip")] == pytest.approx([0.002, 0.08, 1.0])


def edit(line, old, new):
    def change(lines):
        assert old in lines[line - 1]
        lines[line - 1] = lines[line - 1].replace(old, new, 1)

    return change


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda lines: lines.clear(), "empty"),
        (lambda lines: lines.__delitem__(slice(3, None)), "line 4: is missing"),
        (lambda lines: lines.__delitem__(slice(5, None)), "line 5: is the last"),
        (edit(1, "Objects", "Frames"), "line 1: is 'Frames'; expected the header 'Objects'"),
        (edit(2, "100", "0"), "line 2: is '0'"),
        (edit(2, "100", "nan"), "line 2: is 'nan'"),
        (edit(3, "hip:hip", "hat:hat"), "line 3: names collar, .* hat; expected once each"),
        (edit(3, ",,Global", ",Global"), "line 3: has names in columns"),
        (edit(3, "Global Angle hip:hip", ""), "line 3: names collar, .*; expected once each"),
        (edit(4, "RZ,TX", "TX,RZ"), "line 4: has 'TX' in column 5; expected 'RZ'"),
        (edit(5, "mm", "m"), "line 5: has 'm' in column 6; expected 'mm'"),
        (edit(7, ",1000", ""), "line 7: has 55 cells; expected 56"),
        (edit(7, ",1000", ",1_000"), "line 7: has '1_000' for collar TZ"),
        (edit(7, ",1000", ",nan"), "line 7: has 'nan' for collar TZ"),
        (edit(7, ",1000", ","), "line 7: has '' for collar TZ"),
        (edit(7, "2,0", "3,0"), "line 7: is frame 3; expected frame 2"),
        (edit(6, "1,0", "one,0"), "line 6: has 'one' for Frame"),
        (lambda lines: lines.insert(6, ""), "line 7: has 1 cells"),
    ],
)
def test_a_malformed_file_is_refused_with_file_line_and_value(tmp_path, change, named):
    lines = make_lines(4)
    Recording(write(tmp_path, lines))
    change(lines)
    with pytest.raises(ArmguardError, match=named) as caught:
        Recording(write(tmp_path, lines))
    assert "made.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unreadable_file_is_refused_by_name(tmp_path):
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01" * 50)
    for path in (tmp_path / "none.csv", tmp_path, binary):
        with pytest.raises(ArmguardError, match="cannot be read") as caught:
            Recording(path)
        assert str(path) in str(caught.value)
