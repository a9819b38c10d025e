import copy
import json

import coal
import msgspec
import numpy as np
import pinocchio
import pytest

import armguard
from armguard.exceptions import ArmguardError
from armguard.messages.answers import VerdictMessage
from armguard.messages.events import Payload
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.messages.proof import Proof, seal
from armguard.recording.agreement import Agreement
from armguard.recording.events import BodiesChanged, Gap, JointState
from armguard.recording.reading import Recording
from armguard.recording.replay import Replay
from armguard.robot import Robot
from armguard.verdict import Level
from armguard_check import verify
from support.panda_monitor import HOME, PERIOD, STILL, ranged_panda
from support.permitted_contact import LIMITS

PLACE = pinocchio.SE3(np.eye(3), np.array([0.1, -0.2, 0.05]))


def record(path, robot, changes, *, region=None, regions=None, **settings):
    """A ball that comes near, and what changes in some ticks."""
    obstacles = armguard.Obstacles(sources=["camera"], accel=10.0, speed=1.6, regions=regions)
    settings = {"rise_delay": 0.0, "base_placement": PLACE} | settings
    monitor = armguard.Monitor(robot, obstacles, **settings)
    with armguard.Recorder(path, monitor, proof_interval=0.01):
        for tick in range(100):
            if tick in changes:
                changes[tick](monitor)
            place = [[1.0 - 0.002 * tick, 0.0, 0.5]]
            obstacles.update(
                ["ball"], tick * PERIOD, place, source="camera", radius=0.1, region=region
            )
            monitor.step(tick * PERIOD, HOME, STILL)
    return Recording(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record(tmp_path_factory.mktemp("proved") / "run.mcap", ranged_panda(), {})


def compare(recording, events=None):
    """What each proof contradicts."""
    agreement = Agreement(recording)
    said = []
    for event in [one.event for one in recording.events()] if events is None else events:
        problem = agreement.take(event)
        if isinstance(event, Proof):
            said.append(problem)
    assert agreement.agreeing == said.count("")
    return said


def test_proofs_of_a_recording_agree(recording):
    said = compare(recording)
    assert len(said) > 4
    assert set(said) == {""}


def test_it_follows_payload_bodies_and_broken_limits(tmp_path):
    robot = Robot.load("panda")
    operating = armguard.OperatingLimits.fraction(robot, velocity=0.001)
    faster = np.array([0.045, *STILL[1:]])
    changes = {
        20: lambda monitor: setattr(monitor, "payload", 0.0),
        40: lambda monitor: robot.attach("gripper", "panda_hand", coal.Sphere(0.2)),
        60: lambda monitor: monitor.step(59.5 * PERIOD, HOME, faster),
    }
    recording = record(tmp_path / "run.mcap", robot, changes, operating=operating, rise_delay=0.02)
    events = [one.event for one in recording.events()]
    assert {""} == set(compare(recording))
    digests = {event.arm.digest for event in events if isinstance(event, Proof)}
    assert len(digests) == 3  # as it begins, without payload, and with the hardware's limits
    # Limits that are broken are not those of a proof, even where they make it claim less.
    exchanged = copy.deepcopy(events)
    proofs = [event for event in exchanged if isinstance(event, Proof)]
    slow = [one.arm for one in proofs if one.arm.operating_velocity[0] < 0.01]
    wide = [one for one in proofs if one.arm.operating_velocity[0] > 0.01]
    assert slow
    assert len(wide) > 1
    for proof in wide:
        proof.arm = slow[-1]
    said = compare(recording, exchanged)
    assert len([one for one in said if "other joints, limits" in one]) == len(wide)
    for kind in (Payload, BodiesChanged):
        left = [event for event in events if not isinstance(event, kind)]
        assert any("recorded" in one for one in compare(recording, left))


def change(path, value):
    *steps, last = path

    def do(proof, verdict):
        part = proof
        for step in steps:
            part = part[step] if isinstance(step, int) else getattr(part, step)
        if isinstance(last, int):
            part[last] = value(part[last])
        else:
            setattr(part, last, value(getattr(part, last)))

    return do


def name_node_of_no_tree(proof, verdict):
    proof.cover.parents = [-1] * 9999
    proof.cover.balls[0].node = 9998


def level(proof, verdict):
    verdict.level = Level.CLEAR.name


CONTRADICTIONS = {
    "sequence": (change(["sequence"], lambda x: x + 1), "does not precede it"),
    "now": (change(["now"], lambda x: x + 1e-6), "now is"),
    "stamp": (change(["stamp"], lambda x: x - 1e-6), "stamp is"),
    "level": (level, "level is"),
    "link": (change(["link"], lambda x: "panda_link0"), "link is"),
    "obstacle": (change(["obstacle"], lambda x: "hand"), "that of the verdict is ball"),
    "positions": (change(["q", 0], lambda x: x + 1e-9), "q is"),
    "velocities": (change(["v", 0], lambda x: x + 1e-9), "v is"),
    "period": (change(["period"], lambda x: 0.5 * x), "that of the settings"),
    "latency": (change(["latency"], lambda x: 0.0), "latency is"),
    "reaction time": (change(["reaction_time"], lambda x: 0.0), "reaction_time is"),
    "margin": (change(["margin"], lambda x: x - 1e-3), "margin is"),
    "told": (change(["motions", -1, "told"], lambda x: "this"), "brakes after this verdict"),
    "max_speed": (change(["max_speed"], lambda x: 0.25), "contact limit is 0.0 m/s"),
    "max_speed that is no number": (change(["max_speed"], lambda x: np.nan), "max_speed is nan"),
    "end that is no number": (change(["motions", -1, "times", -1], lambda x: np.nan), "in nan s"),
    "no times": (change(["motions", -1, "times"], lambda x: []), "malformed (list index out"),
    "short reach": (change(["cover", "reach"], lambda x: x[:3]), "other spheres"),
    "long tree": (name_node_of_no_tree, "is malformed (index"),
    "end": (change(["motions", -1, "times", -1], lambda x: 2.0 * x), "by the verdict in"),
    "limits": (change(["arm", "acceleration", 0], lambda x: 0.99 * x), "other joints, limits"),
    "brakes": (change(["arm", "brakes", 0, "deceleration", 0], lambda x: 1.1 * x), "or brakes"),
    "joint": (change(["arm", "joints", 1, "name"], lambda x: "x"), "other joints"),
    "radius": (change(["cover", "balls", 0, "radius"], lambda x: 0.5 * x), "other spheres"),
    "lever": (change(["cover", "balls", 0, "lever", 0], lambda x: 0.9 * x - 1e-6), "other spheres"),
    "reach": (change(["cover", "reach", 3], lambda x: 0.9 * x), "other spheres"),
    "tree": (change(["cover", "parents"], lambda x: x[:-1]), "other spheres"),
    "node": (change(["cover", "balls", 0, "node"], lambda x: 999), "to no link"),
    "obstacle far away": (change(["states", 0, "points", 0], lambda x: x + 50.0), "no state as"),
    "obstacle at rest": (change(["states", 0, "velocities", 0], lambda x: x + 1.0), "no state as"),
    "obstacle of later": (change(["states", 0, "stamp"], lambda x: x + 1e-3), "no state as"),
    "thin obstacle": (change(["states", 0, "radius"], lambda x: 0.9 * x), "no state as"),
    "slow obstacle": (change(["states", 0, "speed"], lambda x: 0.9 * x), "no state as"),
    "lazy obstacle": (change(["states", 0, "accel"], lambda x: 0.9 * x), "no state as"),
    "obstacle of no error": (change(["states", 0, "position_error"], lambda x: -1.0), "no state"),
    "obstacle of no states": (change(["states"], lambda x: []), "no state as"),
    "cover": (change(["cover", "link"], lambda x: "panda_link99"), "to no link"),
    "configuration": (
        lambda proof, verdict: setattr(verdict, "configuration", "0" * 16),
        "has configuration 0000",
    ),
}


@pytest.mark.parametrize("kind", CONTRADICTIONS)
def test_a_proof_that_contradicts_what_stands_beside_it_is_told_of(recording, kind):
    events = copy.deepcopy([one.event for one in recording.events()])
    place = next(
        k
        for k, event in enumerate(events)
        if isinstance(event, Proof) and event.level != "STOP" and event.cover.balls
    )
    verdict = next(event for event in events[place::-1] if isinstance(event, VerdictMessage))
    spoil, why = CONTRADICTIONS[kind]
    spoil(events[place], verdict)
    said = compare(recording, events)
    assert [one for one in said if why in one] == [one for one in said if one], said
    assert len(said) == said.count("") + 1


def test_a_stop_that_is_to_finish_a_piece_is_no_braking(recording):
    events = copy.deepcopy([one.event for one in recording.events()])
    stops = [event for event in events if isinstance(event, VerdictMessage)]
    for event in stops:
        event.stop = "finish" if event.level == "STOP" else None
    said = compare(recording, events)
    assert any("its arm brakes after this verdict" in one for one in said)


def test_a_proof_without_its_verdict_is_told_of(recording):
    events = [one.event for one in recording.events()]
    place = next(k for k, event in enumerate(events) if isinstance(event, Proof))
    spoiled = [*events[:place], Gap(events=1, seconds=0.0), *events[place:]]
    assert compare(recording, spoiled)[0] == "the verdict of its tick does not precede it"
    without = [event for event in events if not isinstance(event, VerdictMessage)]
    assert "" not in compare(recording, without)


(SPEED,) = {limit.max_speed for limit in LIMITS.by_region.values()}


@pytest.mark.parametrize(
    ("stated", "permitted"),
    [
        ({"region": "hand"}, SPEED),
        ({"regions": {"b*": "hand"}}, SPEED),
        ({"region": "face"}, 0.0),
        ({"region": "face", "regions": {"b*": "hand"}}, 0.0),
        ({}, 0.0),
    ],
)
def test_speeds_of_contact_are_those_of_the_obstacles_own_regions(stated, permitted, tmp_path):
    recording = record(tmp_path / "run.mcap", ranged_panda(), {}, contact_limits=LIMITS, **stated)
    assert set(compare(recording)) == {""}
    events = copy.deepcopy([one.event for one in recording.events()])
    first = next(event for event in events if isinstance(event, Proof))
    assert first.max_speed == permitted
    first.max_speed = SPEED
    assert bool(compare(recording, events)[0]) == (permitted == 0.0)
    first.max_speed = 2.0 * SPEED
    assert compare(recording, events)[0].startswith(f"max_speed is {2.0 * SPEED}")


def test_an_obstacle_that_was_removed_begins_without_regions(tmp_path):
    """The limit is that of what was stated since; one that is gone may not be touched."""
    recording = record(
        tmp_path / "run.mcap",
        ranged_panda(),
        {50: lambda monitor: monitor.obstacles.remove(["ball"], 49.5 * PERIOD, "camera")},
        contact_limits=LIMITS,
        region="hand",
    )
    assert set(compare(recording)) == {""}
    events = [one.event for one in recording.events()]
    place = next(k for k, event in enumerate(events) if isinstance(event, RemoveMessage))
    events[:place] = [
        msgspec.structs.replace(event, region="face")
        if isinstance(event, ObstaclesMessage)
        else event
        for event in events[:place]
    ]
    said = compare(recording, events)
    after = sum(isinstance(event, Proof) for event in events[place:])
    assert after > 3
    assert set(said[-after:]) == {""}
    assert all("max_speed" in one for one in said[:-after])


def test_a_joint_state_of_half_a_number_is_no_agreement(recording):
    events = copy.deepcopy([one.event for one in recording.events()])
    for event in events:
        if isinstance(event, JointState):
            event.q = event.q[:-4]
    assert all("malformed (buffer size" in one for one in compare(recording, events))


def test_a_message_that_cannot_be_read_is_named(recording):
    events = copy.deepcopy([one.event for one in recording.events()])
    first = next(event for event in events if isinstance(event, ObstaclesMessage))
    first.position = first.position[:-4]
    with pytest.raises(ArmguardError, match="has a ObstaclesMessage that cannot be read"):
        compare(recording, events)


def test_a_contradiction_can_hold_by_itself(recording):
    proof = copy.deepcopy(
        next(one.event for one in recording.events() if isinstance(one.event, Proof))
    )
    proof.latency *= 0.9
    proof.obstacle = "another"
    proof.arm.acceleration[0] *= 0.999
    seal(proof.arm)
    assert verify(json.loads(proof.to_json()))


def test_states_of_a_glitch_agree(tmp_path):
    """Samples that are refused for a while, and one that is believed again."""

    def jump(monitor):
        now = monitor.obstacles.table.stamp[0] + 0.5 * PERIOD
        monitor.obstacles.update(["ball"], now, [[2.5, 1.0, 0.5]], source="camera", radius=0.1)

    changes = dict.fromkeys((20, 21, 22, 50, 51, 70), jump)
    recording = record(tmp_path / "run.mcap", ranged_panda(), changes)
    proofs = [one.event for one in recording.events() if isinstance(one.event, Proof)]
    assert max(len(proof.states) for proof in proofs) > 1
    assert set(compare(recording)) == {""}


@pytest.mark.parametrize(
    "spoil",
    [
        lambda settings: settings.clear(),
        lambda settings: settings["monitor"].update(rate={}),
        lambda settings: settings["obstacles"].update(bounds=[[]]),
    ],
)
def test_settings_that_cannot_be_read_are_told_of(recording, spoil):
    spoiled = copy.copy(recording)
    spoiled.settings = copy.deepcopy(recording.settings)
    spoil(spoiled.settings)
    with pytest.raises(ArmguardError, match="settings that cannot be read"):
        Replay(spoiled)
    with pytest.raises(ArmguardError, match="settings that cannot be read"):
        Agreement(spoiled)
