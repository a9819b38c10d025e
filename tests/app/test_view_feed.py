"""From a monitor's tick to the message that a view draws."""

import coal
import numpy as np
import pytest

from armguard import Monitor, Obstacles, OperatingLimits, Path, Plan, Robot, Shield
from armguard.app.loop import Durations, Resets
from armguard.app.view_feed import (
    INTERVAL,
    LONGEST_WAIT,
    PAIR_LIMIT,
    ROW_LIMIT,
    MonitorFeed,
)
from armguard.verdict import Level, Reason, ReasonKind
from armguard.view import FrameMessage, SceneMessage
from armguard.view.messages import Origin, decode_message, encode_message

READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


class Messages:
    """Stands for a publisher: keeps each message as a view would read it."""

    def __init__(self):
        self.all = []

    def publish_scene(self, message):
        self.all.append(decode_message(encode_message(message)))

    publish_frame = publish_scene

    @property
    def frames(self):
        return [message for message in self.all if isinstance(message, FrameMessage)]


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


def observe(robot, count=3, ticks=1, q=READY, **changes):
    obstacles = Obstacles(sources=[])
    monitor, messages = Monitor(robot, obstacles), Messages()
    feed = MonitorFeed(monitor, messages)
    positions = np.random.default_rng(0).uniform(1.0, 3.0, (count, 3))
    durations = Durations()
    for tick in range(1, ticks + 1):
        now = 1e-3 * tick
        names = [f"ball{number}" for number in range(count)]
        obstacles.update(names, now, positions, **({"radius": 0.1} | changes))
        verdict = monitor.step(now, q, np.zeros(7))
        durations.add(20e-6)
        feed.observe(verdict, now, durations, 0)
    return monitor, verdict, messages


def test_the_scene_comes_first_and_has_the_whole_cover(robot):
    _, _, messages = observe(robot)
    scene = messages.all[0]
    assert isinstance(scene, SceneMessage)
    assert scene.robot == "panda"
    assert scene.joints == tuple(robot.joints)
    for cover in scene.cover:
        assert np.allclose(cover.spheres, robot.cover.spheres(cover.link), atol=1e-6)


def test_a_frame_says_what_the_verdict_says(robot):
    _, verdict, messages = observe(robot)
    (frame,) = messages.frames
    assert frame.verdict.level == verdict.level.name
    assert frame.verdict.contact_time == verdict.contact_time
    assert (frame.verdict.link, frame.verdict.obstacle) == (verdict.link, verdict.obstacle)
    assert frame.q == tuple(READY)
    assert frame.load.ticks == 1
    assert frame.obstacles.times[0] == frame.pairs.times[0] == np.float32(verdict.contact_time)
    assert frame.pairs.buckets.sum() == 3 * len(robot.links)
    assert frame.verdict.effects == tuple(one.kind.effect.value for one in verdict.reasons)
    assert frame.obstacles.ids[0] == verdict.obstacle


@pytest.mark.parametrize(("contact_speed", "harm_time"), [(None, None), (0.0, 0.5), (0.21, 0.5)])
def test_a_frame_has_what_contact_limits_permit_where_they_are_stated(
    robot, contact_speed, harm_time
):
    monitor, verdict, messages = observe(robot)
    allowed = Reason(
        ReasonKind.CONTACT_ALLOWED, "panda_hand and ball0", "at most 0.21 of 0.9 m/s (hand: a test)"
    )
    feed = MonitorFeed(monitor, messages)
    told = verdict._replace(
        level=Level.AWARE, harm_time=0.5, contact_speed=contact_speed, reasons=(allowed,)
    )
    feed.observe(told, 0.5, Durations(), 0)
    shown = messages.frames[-1].verdict
    assert (shown.harm_time, shown.contact_speed) == (harm_time, contact_speed)
    assert (shown.reasons, shown.effects, shown.cause) == ((str(allowed),), ("note",), str(allowed))


def test_frames_keep_their_pace(robot):
    _, _, messages = observe(robot, ticks=200)
    assert len(messages.frames) == pytest.approx(0.2 / INTERVAL, abs=1.1)


@pytest.mark.parametrize(("idle", "wait"), [(1e3, 0.0), (1e-9, INTERVAL), (0.0, LONGEST_WAIT)])
def test_a_frame_waits_for_time_to_make_it_but_not_for_ever(robot, idle, wait):
    obstacles, messages = Obstacles(sources=[]), Messages()
    monitor = Monitor(robot, obstacles)
    feed = MonitorFeed(monitor, messages)
    feed.publish(0.0, Durations(), 0)
    assert not messages.frames, "there is no verdict yet"
    made = []
    for tick in range(1, 800):
        now = 1e-3 * tick
        feed.note(monitor.step(now, READY, np.zeros(7)), now)
        feed.publish(now, Durations(), 0, idle=idle)
        if len(messages.frames) > len(made):
            made.append(now)
    # The first one says nothing of the pace: it is due from the beginning.
    assert np.diff(made)[1:] == pytest.approx(max(INTERVAL, wait), abs=2e-3)
    assert messages.frames[-1].sequence == round(1e3 * made[-1]), "it tells the newest verdict"


def test_a_frame_is_bounded_whatever_the_number_of_obstacles(robot):
    _, _, messages = observe(robot, count=ROW_LIMIT + 50)
    (frame,) = messages.frames
    assert len(frame.obstacles.ids) == ROW_LIMIT
    assert len(frame.pairs.times) == PAIR_LIMIT
    assert frame.omitted == 50


def test_an_arm_that_is_not_believed_is_about_to_touch_anything(robot):
    _, verdict, messages = observe(robot, q=READY * np.nan)
    assert verdict.link is None
    (frame,) = messages.frames
    assert not np.frombuffer(frame.sphere_times, "<f4").any()


def test_what_was_refused_is_marked_and_stays_where_it_was_accepted(robot):
    obstacles = Obstacles(sources=[])
    monitor, messages = Monitor(robot, obstacles), Messages()
    feed = MonitorFeed(monitor, messages)
    for now, x in ((0.001, 2.0), (0.1, np.nan)):
        obstacles.update(["good", "bad"], now, [[2.0, 0.0, 1.0], [x, 1.0, 1.0]], radius=0.1)
        feed.observe(monitor.step(now, READY, np.zeros(7)), now, Durations(), 0)
    before, after = (frame.obstacles for frame in messages.frames)
    assert not any(before.refused)
    marks = dict(zip(after.ids, after.refused, strict=True))
    assert (bool(marks["good"]), bool(marks["bad"])) == (False, True)
    place = after.points[list(after.ids).index("bad")]
    assert place == pytest.approx([2.0, 1.0, 1.0])


def test_an_attached_tool_comes_with_a_new_scene():
    robot, obstacles, messages = Robot.load("panda"), Obstacles(sources=[]), Messages()
    monitor = Monitor(robot, obstacles)
    feed = MonitorFeed(monitor, messages)
    robot.attach("tool", "panda_hand", coal.Sphere(0.05))
    for tick in range(2):
        verdict = monitor.step(1e-3 * tick, READY, np.zeros(7))
        feed.observe(verdict, float(tick), Durations(), 0)
    scenes = [message for message in messages.all if isinstance(message, SceneMessage)]
    assert [len(scene.cover) for scene in scenes] == [10, 11]
    spheres = sum(len(cover.spheres) for cover in scenes[-1].cover)
    assert len(messages.frames[-1].sphere_times) == 4 * spheres


def test_a_stop_between_two_frames_is_told_with_the_next_one(robot):
    obstacles, messages = Obstacles(sources=[]), Messages()
    monitor = Monitor(robot, obstacles, rise_delay=0.0)
    feed, verdicts = MonitorFeed(monitor, messages), []
    for tick in range(60):
        now = 1e-3 * tick
        # For five ticks there is something where the arm is.
        if tick in (10, 15):
            place = [0.3, 0.0, 0.6] if tick == 10 else [9.0, 0.0, 0.6]
            obstacles.update([f"ball{tick}"], now, [place], radius=0.1)
        if tick == 15:
            obstacles.remove(["ball10"], now)
        verdicts.append(monitor.step(now, READY, np.zeros(7)))
        feed.observe(verdicts[-1], now, Durations(), 0)
    stops = [verdict.sequence for verdict in verdicts if verdict.level.name == "STOP"]
    assert 0 < len(stops) < 20
    # Since when it held is told with it, within the tick.
    (stop,) = [frame for frame in messages.frames if frame.verdict.level == "STOP"]
    assert stop.verdict.since == pytest.approx(1e-3 * (stops[0] - 1), abs=1.5e-3)
    told = [frame.verdict.level for frame in messages.frames]
    assert told.count("STOP") == 1
    assert told[-1] != "STOP"
    # One that was left and taken on again between two frames is told twice.
    count = len(messages.frames)
    clear, stop = (
        next(one for one in verdicts if (one.level.name == "STOP") == is_stop)
        for is_stop in (False, True)
    )
    again = stop._replace(sequence=stop.sequence + 5)
    for now, verdict in ((0.07, stop), (0.071, clear), (0.072, again)):
        feed.note(verdict, now)
    feed.publish(0.2, Durations(), 0)
    assert [frame.verdict.level for frame in messages.frames[count:]] == ["STOP", "STOP"]


def test_a_latch_tells_since_when_and_a_source_how_it_is_heard(robot):
    obstacles, messages = Obstacles(sources=["camera"]), Messages()
    monitor = Monitor(robot, obstacles)
    feed = MonitorFeed(
        monitor, messages, Origin(reset_address="ipc:///x", obeys_reset=True, recording="/y")
    )
    for tick in range(1, 400):
        now = 2e-3 * tick
        obstacles.update([], now, source="camera")
        q = READY * np.nan if tick == 100 else READY
        feed.observe(monitor.step(now, q, np.zeros(7)), now, Durations(), 0, resets=Resets(1, 2))
    scene, frame = messages.all[0], messages.frames[-1]
    told = (scene.reset_address, scene.obeys_reset, scene.recording)
    assert told == ("ipc:///x", True, "/y")
    assert frame.latches[0].since == pytest.approx(0.2, abs=INTERVAL)
    # Of two clocks a page shows one.
    assert frame.latches[0].reason == "joint state malformed: panda_joint1 (q is nan)"
    assert frame.verdict.cause == ""
    assert (frame.obeyed_resets, frame.refused_resets) == (1, 2)
    heard = {source.name: source for source in frame.sources}
    assert heard["camera"].rate == pytest.approx(500.0, rel=0.05)
    assert heard["robot"].rate == pytest.approx(500.0, rel=0.05)
    assert heard["camera"].timeout == monitor.settings.source_timeout


def test_a_level_that_is_held_tells_what_it_began_with_and_when_it_may_rise(robot):
    obstacles, messages = Obstacles(sources=[]), Messages()
    monitor = Monitor(robot, obstacles, rise_delay=0.1)
    feed, first = MonitorFeed(monitor, messages), None
    for tick in range(200):
        now = 1e-3 * tick
        if tick == 10:
            obstacles.update(["ball"], now, [[0.3, 0.0, 0.6]], radius=0.1)
        if tick == 15:
            obstacles.remove(["ball"], now)
        verdict = monitor.step(now, READY, np.zeros(7))
        if first is None and verdict.level.name == "STOP" and tick >= 10:
            first = verdict
        feed.observe(verdict, now, Durations(), 0)
    frames = [frame for frame in messages.frames if frame.now > 0.02]
    held = [frame for frame in frames if frame.verdict.rises_at is not None]
    cause = f"{first.link} and ball, contact time 0 ms, stop time {1e3 * first.stop_time:.0f} ms"
    assert len(held) > 1
    for frame in held:
        summary = frame.verdict
        assert (summary.level, summary.since, summary.cause) == ("STOP", first.stamp, cause)
        assert summary.rises_at == pytest.approx(0.114, abs=2e-3)
        # In fields of its own, and not again among the reasons.
        assert not any("waiting for evidence" in reason for reason in summary.reasons)
        assert len(summary.reasons) == len(summary.effects)
    assert frames[-1].verdict.level == "CLEAR"
    assert (frames[-1].verdict.cause, frames[-1].verdict.rises_at) == ("", None)


def test_a_stop_that_is_held_after_a_reset_began_with_the_reset(robot):
    obstacles, messages = Obstacles(sources=[]), Messages()
    monitor = Monitor(robot, obstacles, rise_delay=0.1)
    feed = MonitorFeed(monitor, messages)
    for tick in range(1, 250):
        now = 1e-3 * tick
        q = READY * np.nan if tick == 100 else READY
        if tick == 150:
            monitor.reset()
        feed.observe(monitor.step(now, q, np.zeros(7)), now, Durations(), 0)
    held = [frame.verdict for frame in messages.frames if frame.verdict.rises_at is not None]
    (told,) = {(one.level, one.cause, one.since) for one in held if one.since > 0.12}
    assert told == ("STOP", "reset", 0.15)


def test_what_is_told_of_a_stop_in_a_recording_is_why(robot):
    for is_recorded in (False, True):
        obstacles, messages = Obstacles(sources=[]), Messages()
        monitor = Monitor(robot, obstacles)
        feed = MonitorFeed(monitor, messages, Origin(is_recorded=is_recorded))
        for tick in range(1, 40):
            now = 1e-3 * tick
            place = [[0.3 if tick > 5 else 5.0, 0.0, 0.6]]
            obstacles.update([f"ball{tick > 5}"], now, place, radius=0.1)
            feed.observe(monitor.step(now, READY, np.zeros(7)), now, Durations(), 0, wall=7.0)
        frame = messages.frames[-1]
        assert frame.verdict.level == "STOP"
        assert frame.wall == 7.0
        assert bool(frame.explanation) is is_recorded
        assert not is_recorded or any("less latency" in line for line in frame.explanation)


def test_the_most_imminent_obstacle_has_its_reach_and_a_told_path_its_samples(robot):
    obstacles, messages = Obstacles(sources=[]), Messages()
    obstacles.add_static("wall", [5.0, 0.0, 1.0], 0.1)
    obstacles.add_entrance("door", [6.0, 0.0, 1.0], 0.5, 0.1)
    monitor = Monitor(robot, obstacles, motion="planned")
    feed = MonitorFeed(monitor, messages)
    obstacles.update(["ball"], 0.0, [[2.0, 0.0, 1.0]], radius=0.1)
    monitor.step(0.0, READY, np.zeros(7))
    plan = Plan(0.0, [0.0, 0.1], np.stack([READY, READY]), np.zeros((2, 7)), np.full(7, 1e-3))
    assert monitor.commit(plan).safe
    feed.observe(monitor.step(0.001, READY, np.zeros(7)), 0.001, Durations(), 0)
    (frame,) = messages.frames
    ((*center, radius),) = frame.reach.values
    assert center == pytest.approx([2.0, 0.0, 1.0])
    assert radius > 0.1
    marks = dict(zip(frame.obstacles.ids, frame.obstacles.statics, strict=True))
    assert marks == {"wall": True, "door": True, "ball": False}
    entrances = dict(zip(frame.obstacles.ids, frame.obstacles.entrances, strict=True))
    assert entrances == {"wall": False, "door": True, "ball": False}
    rows = np.frombuffer(frame.plan, "<f4").reshape(-1, 7)
    assert np.allclose(rows, READY, atol=1e-5)


def test_a_frame_tells_how_fast_a_shield_moves_the_arm_where_to_and_why_not_faster(robot):
    obstacles, messages = Obstacles(sources=["camera"]), Messages()
    operating = OperatingLimits.fraction(robot, velocity=0.4, acceleration=0.25)
    monitor = Monitor(robot, obstacles, rate=100.0, motion="planned", operating=operating)
    shield = Shield(monitor, jerk=500.0, rate=100.0)
    feed = MonitorFeed(monitor, messages)
    shield.set_path(Path([READY, READY + 0.3]))
    q, v = READY, np.zeros(7)
    for tick in range(130):
        now = 0.01 * tick
        place = [[max(1.5 - now, 0.75), 0.0, 0.5]]
        obstacles.update(["hand"], now, place, radius=0.1, speed=1.5, source="camera")
        command = shield.step(now, q, v)
        feed.note(command.verdict, now, command)
        feed.publish(now, Durations(), 0, shield=shield)
        q, v, _ = command.at(now + 0.01)
    frames = messages.frames
    free = next(frame for frame in frames if frame.now > 0.3)
    assert free.command.scale == pytest.approx(1.0)
    assert (free.command.reason, free.command.is_proved) == ("", True)
    path = np.frombuffer(free.path, "<f4").reshape(-1, 7)
    assert path[0] == pytest.approx(READY + 0.3 * (path[0, 0] / 0.3), abs=1e-4)
    assert path[-1] == pytest.approx(READY + 0.3, abs=1e-5)
    # Before that it sets off.
    slower = [frame for frame in frames if frame.now > 0.3 and frame.command.scale < 0.95]
    assert slower
    assert all("hand" in frame.command.reason for frame in slower)
    # An arm that is only watched has none of it.
    feed.note(command.verdict, 2.0)
    feed.publish(2.0, Durations(), 0)
    assert (messages.frames[-1].command, messages.frames[-1].path) == (None, b"")
