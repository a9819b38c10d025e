import msgspec
import numpy as np
import pinocchio
import pytest

from armguard import ArmObstacles, Obstacles, OperatingLimits, Plan
from armguard.exceptions import ArmguardError
from armguard.messages.answers import PlanVerdictMessage, VerdictMessage
from armguard.messages.events import (
    DroppedPoints,
    PromiseBroken,
    StaticObstacle,
    TetherEnded,
    TetherStated,
)
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.recording import Recorder, Recording, Replay, replay
from armguard.recording.events import Gap
from armguard.recording.json_form import write_json
from armguard.recording.reading import TimedEvent
from armguard.recording.replay import UNEXPLAINED
from armguard.verdict import ReasonKind
from support import eventful_runs
from support.depth_camera import DepthCamera
from support.eventful_runs import MOTIONS
from support.panda_monitor import HOME, STILL, make_monitor
from support.recordings_made import record, record_pause


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "run.mcap"
    record(path, ticks=700)
    return path


class Edited(Recording):
    """A recording with some of its events changed; the file stays as it is."""

    def __init__(self, path, edit):
        super().__init__(path)
        self._edit = edit

    def events(self):
        for number, (nanoseconds, event, _) in enumerate(super().events()):
            for one in self._edit(number, event):
                yield TimedEvent(nanoseconds, one, write_json(one))


def run(recording, changes=None):
    one = Replay(recording, changes)
    return list(one.ticks()), one.report()


@pytest.mark.parametrize("motion", MOTIONS)
def test_verdicts_of_an_eventful_run_are_the_same_to_the_bit(motion, tmp_path):
    path = tmp_path / "run.mcap"
    verdicts, answers = record(path, motion)
    ticks, report = run(Recording(path))
    assert report.difference is None
    assert report.is_identical
    assert report.ticks == report.compared == len(verdicts)
    assert report.differences == ()
    assert len({verdict.level for verdict in verdicts}) > 1, "an eventful run"
    if MOTIONS[motion].get("motion") == "planned":
        assert {answer.safe for answer in answers} == {True, False}
    assert repr([tick.replayed for tick in ticks]) == repr(verdicts)
    assert repr([tick.recorded for tick in ticks]) == repr(verdicts)


def test_clouds_and_entrances_are_replayed_to_the_bit(tmp_path):
    camera = DepthCamera([0.0, -2.5, 0.5], [0.0, 0.0, 0.5], (60, 50))
    obstacles, monitor = make_monitor()
    obstacles.add_entrance("door", [-3.0, 0.0, 0.0], 0.3, 0.1)
    path = tmp_path / "cloud.mcap"
    with Recorder(path, monitor):
        obstacles.add_entrance("gate", [[0.0, 3.0, 0.0], [0.0, 3.0, 2.0]], 0.1, 0.1, speed=1.5)
        for tick in range(120):
            now = 0.001 * tick
            if tick % 10 == 0:
                ends, met = camera.see([[0.012 * tick - 0.7, -1.2, 0.5]], [0.15])
                ends[tick::500] = np.nan
                obstacles.update_cloud("depth", now, ends, camera.origin, 0.1, occupied=met >= 0)
            monitor.step(now, HOME, STILL)
    voxels = {name for name in obstacles.ids if name.startswith("voxel")}
    assert obstacles.count_of("depth") == len(voxels) > 5
    recording = Recording(path)
    told = [type(event) for _, event, _ in recording.events()]
    assert told.count(StaticObstacle) == 2
    assert told.count(DroppedPoints) == 12
    assert told.count(RemoveMessage) > 2, "what was seen to be empty"
    one = Replay(recording)
    assert len(list(one.ticks())) == 120
    assert one.report().is_identical
    assert {name for name in one.obstacles.ids if name.startswith("voxel")} == voxels
    table, again = obstacles.table, one.obstacles.table
    rows = obstacles.entrance_rows
    assert rows.tolist() == one.obstacles.entrance_rows.tolist()
    assert table.radius[rows].tolist() == again.radius[rows].tolist()


def test_tethers_are_replayed_to_the_bit(tmp_path):
    path, obstacles = tmp_path / "run.mcap", Obstacles()
    obstacles.tether("elbow", "shoulder", 0.36, "measured")
    obstacles.tether("hand", "elbow", 0.3, "guessed")
    _, monitor = make_monitor(obstacles=obstacles, rate=500.0, operating="published")
    verdicts = []
    with Recorder(path, monitor):
        for tick in range(500):
            now = 0.002 * tick
            if tick == 150:
                obstacles.untether("hand", "elbow")
            if tick == 200:
                obstacles.tether("elbow", "shoulder", 0.34, "learned")
            if tick % 5 == 0:
                # The elbow is hidden at first; it is too far away when it comes into view.
                places = {"shoulder": 1.3, "hand": 0.95} | ({"elbow": 0.9} if tick > 250 else {})
                places |= {"elbow": 1.0} if tick == 0 else {}
                points = [[x, 0.0, 0.6] for x in places.values()]
                bounds = {"position_error": 0.01, "velocity_error": 0.05}
                obstacles.update(list(places), now, points, 0.0 * np.array(points), 0.08, **bounds)
            verdicts.append(monitor.step(now, HOME, STILL))
    told = {reason.kind for verdict in verdicts for reason in verdict.reasons}
    assert ReasonKind.TETHER_BROKEN in told
    events = [type(event) for _, event, _ in Recording(path).events()]
    assert (events.count(TetherStated), events.count(TetherEnded)) == (3, 1)
    one = Replay(Recording(path))
    assert repr([tick.replayed for tick in one.ticks()]) == repr(verdicts)
    assert one.report().is_identical
    assert one.obstacles.tethers == obstacles.tethers


def test_late_data_are_replayed_to_the_bit(tmp_path):
    path = tmp_path / "late.mcap"
    verdicts = record_pause(path)
    assert any(
        reason.kind is ReasonKind.LATE_DATA for verdict in verdicts for reason in verdict.reasons
    )
    ticks, report = run(Recording(path))
    assert report.is_identical
    assert repr([tick.replayed for tick in ticks]) == repr(verdicts)


def test_a_break_of_another_arm_is_replayed_to_the_bit(tmp_path):
    path, obstacles = tmp_path / "run.mcap", Obstacles(sources=["right"])
    _, monitor = make_monitor(obstacles=obstacles)
    robot = monitor.robot
    limits = OperatingLimits.fraction(robot, velocity=0.2, acceleration=0.1)
    base = pinocchio.SE3(np.eye(3), np.array([0.0, 1.5, 0.0]))
    other = ArmObstacles(robot, "right", base_placement=base, operating=limits)
    still = np.tile(STILL, (2, 1))
    told = []
    with Recorder(path, monitor):
        for tick in range(60):
            now, speed = 0.002 * tick, 0.1 if tick == 40 else 0.0
            if tick == 20:
                errors = np.full(7, 1e-3), np.full(7, 0.01)
                plan = Plan(now, np.array([0.0, 0.5]), still + HOME, still, *errors)
                other.take_plan(plan, now + 0.5)
            other.publish(obstacles, now, HOME, np.full(7, speed))
            told += monitor.step(now, HOME, STILL).reasons
    assert [one.subject for one in told if one.kind is ReasonKind.OTHER_ARM_BROKE] == ["right"] * 2
    recording = Recording(path)
    events = [type(event) for _, event, _ in recording.events()]
    assert events.count(PromiseBroken) == 2, "the operating limits, and the plan"
    one = Replay(recording)
    again = [reason for tick in one.ticks() for reason in tick.replayed.reasons]
    assert one.report().is_identical
    assert again == told


def test_one_bit_of_one_input_is_found_out(path):
    def edit(number, event):
        if isinstance(event, ObstaclesMessage) and event.ids and number > 600:
            shifted = np.nextafter(np.frombuffer(event.position), 9.0)
            event = msgspec.structs.replace(event, position=shifted.tobytes())
        yield event

    ticks, report = run(Edited(path, edit))
    difference = report.difference
    assert difference is not None
    assert not report.is_identical
    first = next(tick for tick in ticks if not tick.is_identical)
    assert (difference.sequence, difference.now) == (first.replayed.sequence, first.now)
    assert difference.causes == (UNEXPLAINED,)
    assert f"tick {first.replayed.sequence}" in str(difference)


@pytest.mark.parametrize("name", ["stop_time", "harm_time"])
def test_one_bit_of_one_verdict_is_found_out_with_the_field_and_the_cause(name, path):
    def edit(_, event):
        if isinstance(event, VerdictMessage) and event.sequence == 200:
            later = float(np.nextafter(getattr(event, name), 9.0))
            event = msgspec.structs.replace(event, **{name: later})
        yield event

    recording = Edited(path, edit)
    recording.provenance |= {"numba": "0.61.0", "processor": "pentium", "cover": "other"}
    _, report = run(recording)
    assert report.difference.sequence == 200
    (field,) = report.difference.fields
    assert field.startswith(f"{name}: 0.")
    told = str(report.difference)
    for cause in ("another compiler (numba): 0.61.0 recorded", "another processor: pentium"):
        assert cause in told
    assert "another cover: other recorded" in told


def test_a_contact_speed_that_one_of_the_two_lacks_is_found_out(path):
    def edit(_, event):
        if isinstance(event, VerdictMessage) and event.sequence == 200:
            event = msgspec.structs.replace(event, contact_speed=0.21)
        yield event

    _, report = run(Edited(path, edit))
    assert report.difference.fields == ("contact_speed: 0.21 recorded, None replayed",)


def test_one_bit_of_one_answer_to_a_plan_is_found_out(tmp_path):
    path = tmp_path / "run.mcap"
    record(path, "committed", ticks=60, start=680)
    assert run(Recording(path))[1].is_identical
    seen = []

    def edit(_, event):
        if isinstance(event, PlanVerdictMessage):
            seen.append(event)
            event = msgspec.structs.replace(event, safe=not event.safe)
        yield event

    _, report = run(Edited(path, edit))
    assert seen
    assert not report.is_identical
    (field,) = report.difference.fields
    assert field.startswith("safe: ")


def test_after_a_gap_nothing_is_compared_and_that_is_told(path):
    def edit(number, event):
        if number == 400:
            yield Gap(events=7, seconds=0.01)
        elif not 400 < number < 420:
            yield event

    ticks, report = run(Edited(path, edit))
    assert report.lost == 7
    assert report.difference is None
    assert not report.is_identical
    assert report.compared < report.ticks
    assert [tick.is_compared for tick in ticks] == sorted(
        (tick.is_compared for tick in ticks), reverse=True
    )


@pytest.mark.parametrize(
    "changes", [{"motion": "isotropic"}, {"payload": "0.1"}, {"schedule": "full"}]
)
def test_plans_and_payloads_of_the_recording_do_not_hinder_a_change(changes, tmp_path):
    path = tmp_path / "run.mcap"
    record(path, "committed", ticks=60, start=680)
    ticks, _ = run(Recording(path), changes)
    assert len(ticks) == 60


def test_a_recording_is_the_same_on_a_machine_without_the_robots_files(path, monkeypatch):
    from armguard.robot import robot as robot_module

    def refuse(*_):
        raise AssertionError("a file of a robot was opened")

    for name in ("find_robot", "read_description", "read_model"):
        monkeypatch.setattr(robot_module, name, refuse)
    assert replay(path).is_identical


def test_between_two_ticks_the_monitor_may_be_asked_anything(path):
    one = Replay(Recording(path))
    for number, _ in enumerate(one.ticks()):
        if number % 50 == 10:
            one.monitor.explain()
            one.monitor.attention()
            one.monitor.snapshot(pair_limit=5, row_limit=5)
    assert one.report().is_identical


def test_settings_that_are_damaged_are_refused(path):
    recording = Recording(path)
    del recording.settings["monitor"]["latency"]
    with pytest.raises(ArmguardError, match="settings that cannot be read"):
        Replay(recording)


def test_events_that_are_damaged_are_refused(path):
    def edit(_, event):
        if isinstance(event, ObstaclesMessage) and event.ids:
            event = msgspec.structs.replace(event, position=event.position[:-8])
        yield event

    with pytest.raises(ArmguardError, match="ObstaclesMessage that cannot be replayed"):
        run(Edited(path, edit))


def test_a_run_of_users_in_python_is_replayed(tmp_path):
    """As in the README: `Recorder` beside a loop of one's own."""
    path = tmp_path / "run.mcap"
    obstacles, monitor = make_monitor()
    with Recorder(path, monitor):
        eventful_runs.stand(monitor, 20)
    assert replay(path).is_identical
    assert len(obstacles) == 0
