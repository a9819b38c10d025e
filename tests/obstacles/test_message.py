"""Messages of many rows, against the same rows told one by one."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Frame, Obstacles
from armguard.obstacles.message import LEAST_ROOM, MessageMemory
from armguard.obstacles.obstacles import MESSAGES_REMEMBERED
from armguard.obstacles.reference_states import keep_reference_state
from armguard.obstacles.table import clear_changed_rows
from support.obstacle_samples import check_invariants, kinds

HOSTILE = (math.nan, math.inf, -math.inf, -1.0, 0.0, 1e308, 1e-308, 2000.0, 300.0)
FIELDS = ("radius", "accel", "speed", "position_error", "velocity_error")
ROTATION = np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])
FRAMES = {"camera": Frame(ROTATION, [0.1, -0.2, 0.3], 0.002)}


def read_table(obstacles):
    """All that a table holds, as bits, and what it says of its sources."""
    table = obstacles.table
    groups = (table.accepted, table.refused_states, table.candidates, table.marks)
    groups += (table.refusals, table.reference_states, table.spreads)
    bits = [array.tobytes() for group in groups for array in group]
    # Those that are new are noted first.
    bits.append(np.sort(table.changed[: table.changed_count[0]]).tobytes())
    sources = [
        (state.source.name, state.stamp, state.newest, state.describe_refusals())
        for state in obstacles._sources.states
    ]
    faults = [
        (fault.kind, fault.source, fault.id, fault.field, repr(fault.value), fault.stamp)
        for fault in obstacles.take_faults()
    ]
    settled = obstacles.is_settled(0.0, 0.2), obstacles.rows_ahead(0.0, 0.2).tolist()
    return bits, sources, faults, obstacles.late_count, settled, obstacles.refused_rows().tolist()


class Scene:
    """Bodies that move about, and messages about them, some hostile."""

    def __init__(self, rng, count, points_each):
        self.rng, self.count = rng, count
        self.ids = [f"{'hand' if i % 3 else 'ball'}{i}" for i in range(count)]
        self.x = rng.uniform(-2.0, 2.0, (count, points_each, 3))
        self.v = np.repeat(rng.uniform(-0.5, 0.5, (count, 1, 3)), points_each, axis=1)
        self.hostile = rng.choice([0.0, 0.02, 0.2])
        self.jumps = rng.choice([0.0, 0.1, 0.5])

    def measure(self, step):
        """One number for each row in every field: ids, positions and the fields of a message."""
        rng, count = self.rng, self.count
        self.v = self.v + rng.normal(size=(count, 1, 3)) * 2.0 * step
        self.x = self.x + self.v * step
        position, velocity = self.x.copy(), self.v.copy()
        jumped = rng.random(count) < self.jumps
        position[jumped] += rng.normal(size=(jumped.sum(), 1, 3)) * rng.choice([0.02, 0.3, 3.0])
        fields = {
            "radius": rng.choice([0.05, 0.06], count),
            "accel": rng.choice([10.0, 12.0, math.inf], count, p=[0.8, 0.1, 0.1]),
            "speed": rng.choice([2.0, 3.0, math.inf], count, p=[0.8, 0.1, 0.1]),
            "position_error": rng.choice([0.0, 0.003], count),
            "velocity_error": rng.choice([0.0, 0.05], count),
        }
        for row in np.flatnonzero(rng.random(count) < self.hostile):
            array = [position[row], velocity[row], *fields.values()][rng.integers(7)]
            place = row if array.ndim == 1 else rng.integers(array.size)
            array.flat[place] = HOSTILE[rng.integers(len(HOSTILE))]
        return position, velocity, fields


@pytest.mark.parametrize("seed", range(12))
def test_a_message_of_many_rows_is_as_good_as_a_message_for_each(seed):
    rng = np.random.default_rng(seed)
    bounds = [("hand*", 40.0, 3.0)] if seed % 2 else []
    together, one_by_one = (Obstacles(frames=FRAMES, bounds=bounds) for _ in range(2))
    scene = Scene(rng, count := int(rng.choice([2, 9, 70])), int(rng.choice([1, 1, 2, 8])))
    time, step = 0.0, float(rng.choice([0.01, 0.05]))
    for _ in range(60):
        time += step
        position, velocity, fields = scene.measure(step)
        chosen = rng.permutation(count) if rng.random() < 0.3 else np.arange(count)
        chosen = chosen[: rng.integers(count + 1)] if rng.random() < 0.2 else chosen
        ids = [scene.ids[i] for i in chosen]
        given = [name for name in FIELDS if name == "radius" or rng.random() < 0.7]
        uniform = [name for name in given if rng.random() < 0.3]
        for name in uniform:
            fields[name][:] = fields[name][0]
        knows_velocity = rng.random() < 0.8
        # Late ones, one from the future, and the same moment again.
        stamp = time + float(rng.choice([0.0, -2.5 * step, -step, 0.5], p=[0.85, 0.05, 0.05, 0.05]))
        frame = "camera" if rng.random() < 0.3 else "world"
        together.update(
            ids,
            stamp,
            position[chosen],
            velocity[chosen] if knows_velocity else None,
            **{
                name: float(fields[name][0]) if name in uniform else fields[name][chosen]
                for name in given
            },
            frame=frame,
        )
        for i in chosen:
            one_by_one.update(
                [scene.ids[i]],
                stamp,
                position[i : i + 1],
                velocity[i : i + 1] if knows_velocity else None,
                **{name: float(fields[name][i]) for name in given},
                frame=frame,
            )
        if not len(chosen):
            one_by_one.update([], stamp)
        assert read_table(together) == read_table(one_by_one)
        check_invariants(together)
        reads = rng.random() < 0.3
        for obstacles in (together, one_by_one):
            if reads:
                table = obstacles.table
                for row in table.changed[: table.changed_count[0]].tolist():
                    states = table.accepted, table.reference_states
                    keep_reference_state(*states, table.marks, row, row)
                clear_changed_rows(table.changed_rows)
            obstacles.forget_refused(time, 0.3)


def tell(obstacles, stamp, ids, **fields):
    """Balls that rest where their numbers say."""
    position = np.array([[float(id), 0.0, 0.0] for id in ids]).reshape(-1, 3)
    obstacles.update(ids, stamp, position, np.zeros((len(ids), 3)), radius=0.1, **fields)


def find_places(obstacles):
    """Where each obstacle is, and when it was seen there."""
    table = obstacles.table
    rows = {obstacles.ids[row]: row for row in np.flatnonzero(table.alive)}
    return {id: (table.points[row, 0, 0], table.stamp[row]) for id, row in rows.items()}


def test_ids_in_another_order_are_who_they_say():
    rng, obstacles = np.random.default_rng(0), Obstacles()
    ids = [str(k) for k in range(50)]
    for tick in range(20):
        tell(obstacles, 0.1 * tick, [ids[k] for k in rng.permutation(50)])
        assert find_places(obstacles) == {id: (float(id), 0.1 * tick) for id in ids}
    assert not obstacles.take_faults()


def test_remembered_ids_are_forgotten_with_their_rows():
    obstacles, ids = Obstacles(), ["1", "2", "3"]
    tell(obstacles, 0.0, ids)
    obstacles.remove(["2"])
    tell(obstacles, 0.1, ["7"])
    tell(obstacles, 0.2, ids)
    expected = {"1": (1.0, 0.2), "2": (2.0, 0.2), "3": (3.0, 0.2), "7": (7.0, 0.1)}
    assert find_places(obstacles) == expected
    check_invariants(obstacles)
    # One that may not come in must be asked for again.
    obstacles.remove(["2"], stamp=0.5)
    tell(obstacles, 0.4, ids)
    tell(obstacles, 0.4, ids)
    assert "2" not in find_places(obstacles)
    tell(obstacles, 0.6, ids)
    assert find_places(obstacles)["2"] == (2.0, 0.6)
    # And so must one that a snapshot did not show.
    tell(obstacles, 0.7, ["1"], snapshot=True)
    tell(obstacles, 0.8, ids)
    assert find_places(obstacles) == {id: (float(id), 0.8) for id in ids}
    assert not obstacles.take_faults()


def test_remembered_ids_belong_to_a_source_and_not_to_the_caller():
    obstacles, ids = Obstacles(), ["1", "2"]
    tell(obstacles, 0.0, ids, source="left")
    tell(obstacles, 0.0, ids, source="right")
    tell(obstacles, 0.1, ids, source="right")
    left, right = (obstacles.row("2", source) for source in ("left", "right"))
    assert obstacles.table.stamp[[left, right]].tolist() == [0.0, 0.1]
    ids[1] = "3"
    tell(obstacles, 0.2, ids, source="left")
    assert obstacles.row("3", "left") >= 0
    for same in (tuple(ids), np.array(ids), [np.str_(id) for id in ids]):
        tell(obstacles, 0.3, same, source="left")
    assert obstacles.table.stamp[obstacles.row("3", "left")] == 0.3


class Echo:
    """Something that calls itself equal to everything."""

    def __eq__(self, other):
        return True

    def __hash__(self):
        return 0


@pytest.mark.parametrize("other", [Echo(), b"2", 2, None, np.zeros(3), np.array("2")])
def test_what_is_no_id_is_none_beside_remembered_ones(other):
    obstacles = Obstacles()
    position = np.zeros((2, 3))
    obstacles.update(["1", "2"], 0.0, position, radius=0.1)
    with pytest.raises(ObstacleError, match="strings only"):
        obstacles.update(["1", other], 0.1, position, radius=0.1)
    assert kinds(obstacles) == [FaultKind.MALFORMED]
    assert (obstacles.table.stamp[:2] == 0.0).all()


def test_the_id_that_is_named_twice_is_told():
    with pytest.raises(ObstacleError, match="names '2' twice"):
        tell(Obstacles(), 0.0, ["1", "2", "3", "2", "1"])


def test_one_number_for_all_says_what_one_for_each_does():
    scalar, array, mixed = (Obstacles() for _ in range(3))
    numbers = {"radius": 0.1, "accel": 5.0, "speed": 1.0}
    numbers |= {"position_error": 0.01, "velocity_error": 0.02}
    ids, position = ["a", "b", "c"], np.arange(9.0).reshape(3, 3)
    for tick in range(5):
        arrays = {name: np.full(3, value) for name, value in numbers.items()}
        scalar.update(ids, 0.1 * tick, position, np.zeros((3, 3)), **numbers)
        array.update(ids, 0.1 * tick, position, np.zeros((3, 3)), **arrays)
        # What stood in the place of a field before must not count.
        some = {name: arrays[name] for k, name in enumerate(numbers) if k % 5 == tick}
        mixed.update(ids, 0.1 * tick, position, np.zeros((3, 1, 3)), **{**numbers, **some})
    assert read_table(scalar) == read_table(array) == read_table(mixed)


def test_numbers_of_any_kind_are_read_as_they_are():
    obstacles = Obstacles()
    obstacles.update(
        ["a"],
        0,
        np.array([[1, 2, 3]], dtype=">i2"),
        np.zeros((1, 3), dtype=np.float32),
        radius=np.float32(0.5),
        accel=3,
        speed=np.array(2, dtype=np.uint8),
        position_error=[0],
        velocity_error=np.ma.masked_array([0.5], mask=[False]),
    )
    table = obstacles.table
    assert table.points[0, 0].tolist() == [1.0, 2.0, 3.0]
    assert (table.radius[0], table.accel[0], table.speed[0]) == (0.5, 3.0, 2.0)
    assert not obstacles.take_faults()
    obstacles.update(["a"], 0.1, np.ma.masked_array([[1.0, 2.0, 3.0]], [[0, 1, 0]]), radius=0.5)
    assert kinds(obstacles) == [FaultKind.NOT_FINITE]


def test_memory_fits_whatever_comes_and_is_not_taken_anew():
    memory = MessageMemory([FRAMES["camera"]])
    rng = np.random.default_rng(0)
    before = memory.handle
    for count in (3, LEAST_ROOM, 0, 1):
        memory.take_points(np.zeros((count, 3)), None)
        assert memory.handle is before
    for shape in [(5, 8, 3), (200, 3), (150, 2, 3), (7, 3), (1000, 8, 3), (2, 1, 3)]:
        points, velocities = rng.normal(size=(2, *shape))
        memory.take_points(points, velocities)
        count, points_each = shape[0], memory.points_each
        found = memory.data.points[:count, :points_each].reshape(shape)
        assert (found == points).all()
        assert (memory.data.velocities[:count, :points_each].reshape(shape) == velocities).all()
        assert all(len(field) >= count for field in (*memory.fields, memory.data.codes))
    room = memory.data.points.shape
    memory.take_points(np.zeros(room), None)
    assert memory.data.points.shape == room


def test_a_copy_has_memory_of_its_own():
    memory = MessageMemory([FRAMES["camera"]])
    memory.take_points(np.zeros((2, 3)), None)
    copied = pickle.loads(pickle.dumps(memory))
    memory.take_points(np.ones((2, 3)), None)
    assert (memory.data.points[:2] == 1.0).all()
    assert not copied.data.points.any()
    assert (copied.data.frames.rotation == memory.data.frames.rotation).all()


def test_many_lists_of_ids_are_remembered_and_many_more_forgotten():
    obstacles = Obstacles()
    ids = [str(k) for k in range(40)]
    for tick in range(6):
        for first in range(0, 40, 2 if tick < 3 else 10):
            tell(obstacles, 0.1 * tick, ids[first : first + 10])
        assert find_places(obstacles) == {id: (float(id), 0.1 * tick) for id in ids}
        assert len(obstacles._resolved[0]) <= MESSAGES_REMEMBERED
    tell(obstacles, 0.6, [])
    assert not obstacles.take_faults()
