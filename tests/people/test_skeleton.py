import json
import math
import re
import time
import tomllib
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zmq

import armguard
from armguard.body_regions import REGIONS
from armguard.bridges.skeletons import MODELS
from armguard.exceptions import ArmguardError
from armguard.obstacles import Obstacles
from armguard.obstacles.tethers import MOST_TETHERS
from armguard.people import BOUNDS, UPPER_BODY, Skeleton
from armguard.people.proportions import SEGMENTS, THICKNESSES
from armguard.people.skeleton import BONES, PARTS, Ball, find_points, infer_points
from armguard.streams import Publisher
from support.kits import write_frame
from support.walking_person import WalkingPerson

ERROR = 0.02
RATE = 30.0
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
LENGTHS = {bone: SEGMENTS[segment].length for bone, segment in BONES.items()}
KITS = [model for kit in ("openpose", "kinect", "mediapipe", "zed") for model in MODELS[kit][-1:]]
KITS.append(MODELS["openpose"][0])


class Sink:
    """What a publisher takes."""

    def __init__(self):
        self.calls = []

    def update(self, ids, stamp, *arguments, **options):
        self.calls.append((list(ids), stamp, arguments, options))


def measure(truth, names, rng):
    """What a kit sees of some joints, within its error."""
    off = rng.normal(size=(len(names), 3))
    off *= ERROR * rng.uniform(0.0, 1.0, (len(names), 1)) / np.linalg.norm(off, axis=1)[:, None]
    return {name: truth[name] + off[k] for k, name in enumerate(names)}


def hide(names, hidden_until, time, rng):
    """Names of joints that are seen, each now and then hidden for up to half a second."""
    for name in names:
        if rng.random() < 0.02:
            hidden_until[name] = time + rng.uniform(0.03, 0.5)
    return [name for name in names if hidden_until.get(name, -1.0) < time]


def check_row(obstacles, row, truth, time, tolerance=1e-6):
    """The true points of a part are where the table's state and its bounds allow."""
    states = obstacles.table.accepted
    elapsed = time - states.stamp[row]
    errors = states.position_error[row], states.velocity_error[row]
    accel, speed = states.accel[row], states.speed[row]
    for k, at in enumerate(truth):
        point, velocity = states.points[row, k], states.velocities[row, k]
        straying = errors[0] + errors[1] * elapsed + 0.5 * accel * elapsed**2
        assert np.linalg.norm(at - point - velocity * elapsed) <= straying + tolerance
        assert np.linalg.norm(at - point) <= errors[0] + speed * elapsed + tolerance


def distance_to_hull(point, hull):
    """From a point to the hull of up to four points, by sampling its mixtures: an upper bound."""
    rng = np.random.default_rng(0)
    weights = np.vstack([np.eye(len(hull)), rng.dirichlet(np.ones(len(hull)), 50)])
    return np.linalg.norm(weights @ np.array(hull) - point, axis=1).min()


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("model", KITS, ids=lambda model: model.name)
def test_every_true_point_is_inside_what_the_table_was_told(model, seed):
    """A walking person of whom joints are hidden: nothing is refused, and nothing is outside."""
    rng = np.random.default_rng(seed)
    person = WalkingPerson(seed)
    height = None if seed == 1 else 2.2
    skeleton = Skeleton("anna", height=height, learn=seed == 2)
    obstacles = Obstacles()
    names = [name for name in model.joints if name in person.locate(0.0)]
    hidden_until, seen_once = {}, set()
    for step in range(90):
        time = step / RATE
        truth = person.locate(time)
        seen = hide(names, hidden_until, time, rng)
        if 50 <= step < 56:
            seen = []  # behind a pillar
        skeleton.update(obstacles, time, measure(truth, seen, rng), ERROR)
        assert obstacles.take_faults() == []
        later = time + rng.uniform(0.0, 1.0 / RATE)
        truth = person.locate(later)
        for name, part in PARTS.items():
            row = obstacles.row(f"anna/{name}") if f"anna/{name}" in obstacles.ids else -1
            if row < 0:
                continue
            seen_once.add(name)
            points = [truth[point] for point in part.points]
            check_row(obstacles, row, points, later)
            assert obstacles.table.accepted.radius[row] == THICKNESSES[part.thickness].radius
        for tether in skeleton.tethers if step % 20 == 0 else ():
            a, b = (
                [truth[point] for point in PARTS[id.removeprefix("anna/")].points]
                for id in (tether.a, tether.b)
            )
            for one, other in ((a, b), (b, a)):
                assert all(distance_to_hull(at, other) <= tether.length + 1e-9 for at in one)
    assert seen_once == set(PARTS)


def test_a_hidden_joint_is_within_its_bones_and_a_lens_of_two():
    rng = np.random.default_rng(5)
    tighter = 0
    for seed in range(60):
        person = WalkingPerson(seed, rng.uniform(0.6, 1.0))
        truth = person.locate(rng.uniform(0.0, 9.0))
        names = [name for name in truth if name not in ("head", "collar", "neck")]
        names = [name for name in names if "knuckles" not in name]
        seen = [name for name in names if rng.random() < 0.6]
        found = find_points(measure(truth, seen, rng), ERROR)
        for point, ball in infer_points(found, LENGTHS).items():
            assert np.linalg.norm(truth[point] - ball.centre) <= ball.radius + 1e-9, point
            if point not in found and point.endswith("elbow"):
                tighter += ball.radius < 0.99 * (LENGTHS["left_elbow", "left_wrist"] + ERROR)
    assert tighter > 3


def test_two_balls_are_bounded_by_one_that_holds_what_they_share():
    rng = np.random.default_rng(6)
    lengths = dict.fromkeys(BONES, 0.0)
    upper, lower = ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist")
    shared = 0
    for _ in range(400):
        lengths[upper], lengths[lower] = rng.uniform(0.01, 1.0, 2)
        shoulder, wrist = rng.normal(0.0, 0.5, (2, 3))
        seen = {"left_shoulder": Ball(shoulder, 0.0), "left_wrist": Ball(wrist, 0.0)}
        ball = infer_points(seen, lengths).get("left_elbow")
        points = shoulder + lengths[upper] * rng.normal(0.0, 0.5, (500, 3))
        to_shoulder = np.linalg.norm(points - shoulder, axis=1)
        to_wrist = np.linalg.norm(points - wrist, axis=1)
        both = points[(to_shoulder <= lengths[upper]) & (to_wrist <= lengths[lower])]
        if ball is None:
            assert np.linalg.norm(wrist - shoulder) > lengths[upper] + lengths[lower]
            assert not len(both)
        elif len(both):
            shared += 1
            assert np.linalg.norm(both - ball.centre, axis=1).max() <= ball.radius
            assert ball.radius <= min(lengths[upper], lengths[lower])
    assert shared > 100


def test_lengths_that_contradict_what_is_seen_say_nothing():
    seen = {"left_shoulder": Ball(np.zeros(3), 0.0), "left_wrist": Ball(np.full(3, 2.0), 0.0)}
    assert "left_elbow" not in infer_points(seen, LENGTHS)
    sink = Sink()
    joints = {"left_shoulder": np.zeros(3), "left_wrist": np.full(3, 2.0)}
    Skeleton().update(sink, 0.0, joints, ERROR)
    ids = {id for call in sink.calls for id in call[0]}
    assert "person/left_upper_arm" not in ids
    assert "person/left_hand" in ids


def test_a_part_is_sent_with_the_end_that_is_seen_and_not_without():
    sink = Sink()
    Skeleton("anna").update(sink, 1.0, {"left_shoulder": [0.0, 0.2, 1.4]}, ERROR)
    errors = {}
    for ids, stamp, (points, _), options in sink.calls:
        assert stamp == 1.0
        for k, id in enumerate(ids):
            errors[id] = options["position_error"][k]
            assert np.linalg.norm(points[k] - [0.0, 0.2, 1.4], axis=-1).max() < 1e-9
    assert errors["anna/left_shoulder"] == ERROR
    assert errors["anna/left_upper_arm"] == pytest.approx(ERROR + SEGMENTS["upper_arm"].length)
    assert "anna/left_forearm" not in errors
    assert "anna/right_shoulder" not in errors
    assert "anna/head" not in errors


def test_nobody_is_a_heartbeat():
    sink, obstacles = Sink(), Obstacles(sources=["camera"])
    for one in (sink, obstacles):
        Skeleton(source="camera").update(one, 2.0, {"nose": [math.nan, 0.0, 0.0]}, ERROR)
    ((ids, stamp, *_),) = sink.calls
    assert (ids, stamp) == ([], 2.0)
    assert obstacles.silent_sources(2.1, 0.2) == []
    assert obstacles.silent_sources(2.3, 0.2) == ["camera"]


def test_a_publisher_sends_what_a_table_takes(tmp_path):
    address = f"ipc://{tmp_path}/obstacles"
    person, skeleton = WalkingPerson(1), Skeleton("anna", frame="camera", source="camera")
    with zmq.Context() as context, Publisher(address, source="camera") as publisher:
        receiver = context.socket(zmq.SUB)
        receiver.subscribe(b"")
        receiver.bind(address)
        ids = set()
        deadline = time.monotonic() + 30.0
        while ids != set(skeleton.ids) and time.monotonic() < deadline:
            now = time.monotonic()
            skeleton.update(publisher, now, person.locate(now % 10.0), ERROR)
            while receiver.poll(50):
                message = msgspec.msgpack.decode(receiver.recv())
                ids |= set(message["ids"])
                assert message["frame"] == "camera"
        receiver.close()
    assert ids == set(skeleton.ids)


def test_bounds_regions_and_tethers_are_those_of_the_parts():
    for name, part in PARTS.items():
        assert part.bounds in BOUNDS, name
        assert part.thickness in THICKNESSES, name
        assert part.region is None or part.region in REGIONS, name
    skeleton = Skeleton("anna")
    counts = Counter(id for one in skeleton.tethers for id in one[:2])
    assert set(counts) == set(skeleton.ids)
    assert max(counts.values()) <= MOST_TETHERS
    obstacles = Obstacles()
    truth = WalkingPerson(1).locate(0.0)
    skeleton.update(obstacles, 0.0, truth, ERROR)
    assert {(one.a, one.b, one.length) for one in obstacles.tethers} == {
        (one.a, one.b, one.length) for one in skeleton.tethers
    }
    # A hand is as near to its elbow as both bones are long, wherever the rest of the arm is.
    lengths = {(one.a, one.b): one.length for one in skeleton.tethers}
    whole = SEGMENTS["forearm"].length + SEGMENTS["palm"].length
    assert lengths["anna/left_elbow", "anna/left_hand"] == pytest.approx(whole)
    hand = obstacles.row("anna/left_hand")
    assert obstacles.table.accepted.accel[hand] == BOUNDS["hand"].accel
    assert obstacles.table.accepted.speed[hand] == BOUNDS["hand"].speed


def test_velocities_are_within_their_errors_and_better_than_nothing():
    person, rng = WalkingPerson(3), np.random.default_rng(3)
    skeleton, sink = Skeleton(), Sink()
    known = 0
    for step in range(60):
        sink.calls.clear()
        time = step / RATE
        joints = measure(person.locate(time), list(person.locate(time)), rng)
        skeleton.update(sink, time, joints, ERROR)
        before, after = person.locate(time - 1e-5), person.locate(time + 1e-5)
        for ids, _, (_, velocities), options in sink.calls:
            for k, id in enumerate(ids):
                points = PARTS[id.partition("/")[2]].points
                true = [(after[point] - before[point]) / 2e-5 for point in points]
                off = np.linalg.norm(velocities[k] - true, axis=1).max()
                assert off <= options["velocity_error"][k] + 1e-6
                known += options["velocity_error"][k] < options["speed"][k]
    assert known > 300


def test_a_jump_ends_what_is_known_of_the_velocity():
    skeleton, sink = Skeleton(parts=["head"]), Sink()
    for step in range(20):
        at = [0.0, 0.0, 1.7] if step < 15 else [0.0, 1.0, 1.7]
        skeleton.update(sink, step / RATE, {"left_ear": at, "right_ear": at}, 0.005)
    errors = [options["velocity_error"][0] for *_, options in sink.calls]
    speed = BOUNDS["head"].speed
    assert errors[0] == speed
    assert errors[14] < speed
    assert errors[15] == errors[16] == speed
    assert errors[19] < speed
    assert all(np.linalg.norm(arguments[1]) < 0.5 for _, _, arguments, _ in sink.calls)


def test_one_wrong_sample_makes_no_later_velocity_wrong():
    """One sample jumps, far or near: what comes after it must not count with its way back."""
    rng = np.random.default_rng(8)
    wrong = 0
    for trial in range(60):
        person = WalkingPerson(trial)
        skeleton, sink = Skeleton(parts=["left_hand"]), Sink()
        jump = rng.normal(size=3)
        jump *= rng.uniform(0.05, 0.2) / np.linalg.norm(jump)
        for step in range(25):
            time = step / RATE
            truth = person.locate(time)
            joints = measure(truth, ["left_wrist", "left_index", "left_pinky"], rng)
            if step == 12:
                joints = {name: at + jump for name, at in joints.items()}
            skeleton.update(sink, time, joints, ERROR)
            before, after = person.locate(time - 1e-5), person.locate(time + 1e-5)
            *_, (_, velocities), options = sink.calls[-1]
            true = [(after[at] - before[at]) / 2e-5 for at in PARTS["left_hand"].points]
            off = np.linalg.norm(velocities[0] - true, axis=1).max()
            if step != 12:
                wrong += off > options["velocity_error"][0] + 1e-6
    assert wrong == 0


def learn(skeleton, obstacles, person, steps, start=0, change=None):
    rng = np.random.default_rng(9)
    for step in range(start, start + steps):
        truth = person.locate(step / RATE)
        joints = measure(truth, list(truth), rng)
        if change is not None:
            change(joints)
        skeleton.update(obstacles, step / RATE, joints, ERROR)


def test_lengths_are_learned_from_two_seconds_without_a_fault_and_named():
    person, obstacles = WalkingPerson(2), Obstacles()
    skeleton = Skeleton("anna", learn=True)
    published = {(one.a, one.b): one for one in skeleton.tethers}
    learn(skeleton, obstacles, person, int(1.9 * RATE))
    assert {(one.a, one.b): one for one in skeleton.tethers} == published
    learn(skeleton, obstacles, person, int(0.3 * RATE), int(1.9 * RATE))
    arm = ("anna/left_shoulder", "anna/left_upper_arm")
    learned = {(one.a, one.b): one for one in skeleton.tethers}[arm]
    true = person.lengths["upper_arm"]
    assert true <= learned.length <= true + 4.0 * ERROR < published[arm].length
    assert learned.source == "learned from 2 s of samples of anna"
    told = {(one.a, one.b): one for one in obstacles.tethers}[arm]
    assert (told.length, told.source) == (learned.length, learned.source)
    # A sample that is longer proves it wrong, and what was published counts again.
    longer = np.array([0.0, 0.0, -0.2])

    def stretch(joints):
        joints["left_elbow"] = joints["left_elbow"] + longer

    learn(skeleton, obstacles, person, 1, int(2.2 * RATE), stretch)
    again = {(one.a, one.b): one for one in skeleton.tethers}[arm]
    assert (again.length, again.source) == (published[arm].length, published[arm].source)


def test_faults_begin_learning_anew():
    person, obstacles = WalkingPerson(2), Obstacles()
    skeleton = Skeleton("anna", learn=True)

    def swap(joints):
        joints["left_wrist"], joints["right_wrist"] = joints["right_wrist"], joints["left_wrist"]

    learn(skeleton, obstacles, person, int(1.5 * RATE))
    learn(skeleton, obstacles, person, 1, int(1.5 * RATE), swap)
    assert obstacles.fault_count > 0
    learn(skeleton, obstacles, person, int(1.5 * RATE), int(1.5 * RATE) + 1)
    assert not any("learned" in one.source for one in skeleton.tethers)


def test_an_arm_that_is_hidden_beside_a_seen_shoulder_stops_nothing_far_away():
    """Elbow and wrist are hidden for 3 s, 2.5 m from the robot: tethers bound what is not sent."""
    robot = armguard.Robot.load("panda")
    joints = {f"{side}_shoulder": [2.5, y, 1.4] for side, y in (("left", 0.2), ("right", -0.2))}
    joints |= {f"{side}_ear": [2.5, y, 1.7] for side, y in (("left", 0.07), ("right", -0.07))}
    joints |= {f"{side}_hip": [2.5, y, 0.9] for side, y in (("left", 0.1), ("right", -0.1))}
    arm = {"left_elbow": [2.5, 0.3, 1.1], "left_wrist": [2.4, 0.3, 0.9]}
    levels = {}
    for is_tethered in (True, False):
        obstacles = Obstacles()
        monitor = armguard.Monitor(robot, obstacles, rate=100.0)
        skeleton = Skeleton(parts=UPPER_BODY)
        for step in range(90):
            time = step / RATE
            skeleton.update(obstacles, time, joints | (arm if step < 5 else {}), 0.01)
            if not is_tethered and step == 0:
                for one in skeleton.tethers:
                    obstacles.untether(one.a, one.b)
            verdict = monitor.step(time, READY, [0.0] * 7)
        levels[is_tethered] = verdict.level
    assert levels[True] > armguard.Level.STOP
    assert levels[False] == armguard.Level.STOP


def test_one_who_has_left_leaves_nothing_and_may_come_again():
    person, obstacles = WalkingPerson(1), Obstacles()
    skeletons = [Skeleton("anna"), Skeleton("bert", parts=UPPER_BODY)]
    for one in skeletons:
        one.update(obstacles, 0.0, {"left_shoulder": [0.0, 0.0, 1.4]}, ERROR)
    skeletons[0].remove(obstacles)
    assert not any(id.startswith("anna/") for id in obstacles.ids)
    assert all(one.a.startswith("bert/") for one in obstacles.tethers)
    assert obstacles.tethers
    skeletons[1].remove(obstacles)
    assert (len(obstacles), obstacles.tethers, obstacles.fault_count) == (0, (), 0)
    skeletons[0].update(obstacles, 1.0, person.locate(1.0), ERROR)
    assert len(obstacles) == len(PARTS)
    assert len(obstacles.tethers) == len(skeletons[0].tethers)
    assert obstacles.fault_count == 0


def test_the_parts_that_are_named_are_sent_alone():
    skeleton, sink = Skeleton(parts=["left_hand", "left_forearm"]), Sink()
    skeleton.update(sink, 0.0, WalkingPerson(0).locate(0.0), ERROR)
    assert {id for call in sink.calls for id in call[0]} == set(skeleton.ids)
    assert [(one.a, one.b) for one in skeleton.tethers] == [
        ("person/left_forearm", "person/left_hand")
    ]
    legs = {f"{side}_{part}" for side in ("left", "right") for part in ("thigh", "shank", "foot")}
    assert set(PARTS) - set(UPPER_BODY) == legs


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"person": ""}, "person: is ''"),
        ({"person": "a/b"}, "person: is 'a/b'"),
        ({"height": 180.0}, "height: is 180.0; expected 1.3 to 2.3 m"),
        ({"height": math.nan}, "height: is nan"),
        ({"parts": ["paw"]}, "parts: names 'paw'"),
        ({"parts": []}, "parts: names none"),
        ({"bounds": {}}, "bounds: has none for 'head'"),
    ],
)
def test_what_is_malformed_is_refused_by_name(options, message):
    with pytest.raises(ArmguardError, match=message):
        Skeleton(**options)


def test_what_the_page_shows_runs(capsys):
    page = (Path(__file__).parents[2] / "docs" / "skeletons.md").read_text(encoding="utf-8")
    snippets = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    obstacles = Obstacles(sources=["camera"])
    scope = {"obstacles": obstacles}
    exec(snippets[0], scope)
    for step in range(3):
        time = step / RATE
        bodies = {id: WalkingPerson(id).locate(time) for id in (1, 2)} if step else {}
        scope["take"](json.dumps(write_frame("zed", time, bodies)), time)
    scope["take"]("rubbish", 1.0)
    assert scope["reader"].bad_frames.total() == 1
    assert len(obstacles) == 2 * len(UPPER_BODY)
    assert obstacles.take_faults() == []
    exec(snippets[1], scope)
    told = tomllib.loads(capsys.readouterr().out)["tethers"]
    assert {(one["a"], one["b"], one["length"]) for one in told} == {
        (one.a, one.b, one.length) for one in obstacles.tethers if one.a.startswith("person1/")
    }


def test_calls_that_are_malformed_are_refused_by_name():
    with pytest.raises(ArmguardError, match="position_error: is nan"):
        Skeleton().update(Sink(), 0.0, {}, math.nan)
    for place in ([0.0, 0.0], "here", ["x", 0.0, 0.0], None, [[0.0, 0.0, 0.0]]):
        with pytest.raises(ArmguardError, match="joint 'nose': is no point"):
            Skeleton().update(Sink(), 0.0, {"nose": place}, ERROR)
    with pytest.raises(ArmguardError, match="learn: needs the table of obstacles"):
        Skeleton(learn=True).update(Sink(), 0.0, {}, ERROR)
