"""What an operator's reset forgets of the obstacles, and what it never does."""

import numpy as np
import pytest

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import FAR, HOME, STILL, make_monitor, panda, see, subjects
from support.stream_messages import MONOTONIC, World, obstacles

PERIOD = 0.01
FORGOTTEN = ReasonKind.FORGOTTEN


def run(table, monitor, start, count):
    """Verdicts of ticks in which the camera is heard."""
    verdicts = []
    for k in range(start, start + count):
        see(table, k * PERIOD, FAR, ["man"], source="camera")
        verdicts.append(monitor.step(k * PERIOD, HOME, STILL))
    return verdicts


def start(**settings):
    table, monitor = make_monitor(obstacles=Obstacles(**settings), rate=1.0 / PERIOD)
    assert run(table, monitor, 0, 50)[-1].level > Level.STOP
    return table, monitor


NONSENSE = {
    "stamped long ago": lambda table: see(table, -1e300, FAR, ["ghost"], source="camera"),
    "stamped at the beginning of time": lambda table: see(
        table, -1.7e308, FAR, ["ghost"], source="camera", speed=100.0
    ),
    "stamped far ahead": lambda table: see(table, 1e300, FAR, ["ghost"], source="camera"),
    "nowhere": lambda table: see(table, 0.495, [np.nan] * 3, ["ghost"], source="camera"),
}


@pytest.mark.parametrize("nonsense", NONSENSE)
def test_an_obstacle_that_was_never_believable_is_forgotten_by_a_reset_alone(nonsense):
    table, monitor = start(sources=["camera"])
    NONSENSE[nonsense](table)
    verdicts = run(table, monitor, 50, 100)
    assert {one.level for one in verdicts} == {Level.STOP}
    monitor.reset()
    verdicts = run(table, monitor, 150, 50)
    assert subjects(verdicts[0], FORGOTTEN) == {"ghost"}
    assert not any(subjects(one, FORGOTTEN) for one in verdicts[1:])
    assert verdicts[-1].level is Level.CLEAR
    assert table.row("man") >= 0
    # If it was real after all, it comes again.
    see(table, 2.0, FAR, ["ghost"], source="camera")
    assert table.row("ghost") >= 0


def test_what_was_believable_once_outlasts_every_reset():
    """Whatever nonsense came of it before, or since."""
    table, monitor = start(sources=["camera"])
    see(table, -1e300, FAR, ["first nonsense"], source="camera")
    monitor.step(0.495, HOME, STILL)
    for name in ("gone", "first nonsense", "then nonsense"):
        see(table, 0.496, FAR, [name], source="camera")
    monitor.step(0.497, HOME, STILL)
    see(table, 1e300, FAR, ["then nonsense"], source="camera")
    run(table, monitor, 50, 300)
    monitor.reset()
    verdicts = run(table, monitor, 350, 50)
    assert not any(subjects(one, FORGOTTEN) for one in verdicts)
    assert verdicts[-1].level is Level.STOP
    assert min(map(table.row, ("gone", "first nonsense", "then nonsense"))) >= 0


def test_what_no_tick_has_seen_yet_is_not_forgotten():
    table, monitor = start(sources=["camera"])
    see(table, 0.495, FAR, ["new"], source="camera")
    monitor.reset()
    assert table.row("new") >= 0
    assert not subjects(run(table, monitor, 50, 1)[0], FORGOTTEN)
    # Nor is an old one that no tick believed, where news of it came in since.
    see(table, -1e300, FAR, ["late"], source="camera")
    run(table, monitor, 51, 1)
    see(table, 0.515, FAR, ["late"], source="camera")
    monitor.reset()
    assert table.row("late") >= 0


def test_a_silent_source_that_nobody_named_is_forgotten_until_it_speaks():
    table, monitor = start(sources=["camera"])
    table.update([], 0.495, source="camrea")
    verdicts = run(table, monitor, 50, 100)
    assert subjects(verdicts[-1], ReasonKind.SOURCE_SILENT) == {"camrea"}
    monitor.reset()
    verdicts = run(table, monitor, 150, 50)
    (reason,) = [one for one in verdicts[0].reasons if one.kind is FORGOTTEN]
    assert str(reason) == (
        "forgotten by a reset: camrea (source that was not named, and is silent)"
    )
    assert verdicts[-1].level is Level.CLEAR
    table.update([], 2.0, source="camrea")
    assert run(table, monitor, 200, 1)[0].level is Level.CLEAR
    verdicts = run(table, monitor, 201, 40)
    assert subjects(verdicts[-1], ReasonKind.SOURCE_SILENT) == {"camrea"}


DISBELIEVED = {
    "rows": lambda table: see(
        table, 0.495, np.full((6, 3), np.nan), [f"ghost-{k}" for k in range(6)], source="camrea"
    ),
    "points": lambda table: table.update_cloud(
        "camrea", 0.495, np.full((50, 3), np.nan), [0.0, 0.0, 0.0]
    ),
}


@pytest.mark.parametrize("what", DISBELIEVED)
def test_what_was_refused_of_a_source_is_forgotten_with_it(what):
    table, monitor = start(sources=["camera"])
    DISBELIEVED[what](table)
    verdicts = run(table, monitor, 50, 100)
    assert subjects(verdicts[-1], ReasonKind.SOURCE_NOT_BELIEVED) == {"camrea"}
    monitor.reset()
    verdicts = run(table, monitor, 150, 50)
    assert "camrea" in subjects(verdicts[0], FORGOTTEN)
    assert not subjects(verdicts[0], ReasonKind.SOURCE_NOT_BELIEVED)
    assert verdicts[-1].level is Level.CLEAR


def test_an_obstacle_whose_stamp_was_ahead_of_the_clock_can_be_removed():
    """Its source has told of it, once with a stamp of nonsense, and then that it is gone."""
    table, monitor = start(sources=["camera"])
    see(table, 0.495, FAR, ["guest"], source="camera")
    run(table, monitor, 50, 10)
    see(table, 1e300, FAR, ["guest"], source="camera")
    table.remove(["guest"], 0.595, "camera")
    assert table.row("guest") >= 0, "no tick has found out that the stamp was wrong"
    assert run(table, monitor, 60, 10)[-1].level is Level.STOP
    table.remove(["guest"], 0.595, "camera")
    assert table.row("guest") >= 0, "older than what the source has told since"
    table.remove(["guest"], 0.695, "camera")
    assert table.row("guest") < 0
    assert run(table, monitor, 70, 50)[-1].level is Level.CLEAR


@pytest.mark.parametrize("sources", [["camera", "lidar"], None])
def test_a_source_that_was_named_or_where_none_was_is_missed_after_a_reset(sources):
    table, monitor = make_monitor(obstacles=Obstacles(sources=sources), rate=1.0 / PERIOD)
    table.update([], 0.0, source="lidar")
    run(table, monitor, 0, 50)
    monitor.reset()
    verdict = run(table, monitor, 50, 1)[0]
    assert subjects(verdict, ReasonKind.SOURCE_SILENT) == {"lidar"}


def test_a_source_that_speaks_or_has_obstacles_is_missed_after_a_reset():
    table, monitor = start(sources=["camera"])
    see(table, 0.495, FAR, ["other"], source="lidar")
    table.update([], 0.495, source="radar")
    run(table, monitor, 50, 1)
    monitor.reset()
    verdict = run(table, monitor, 51, 50)[-1]
    assert subjects(verdict, ReasonKind.SOURCE_SILENT) == {"lidar", "radar"}
    # Once its obstacle was removed, the lidar is forgotten as well.
    table.remove(["other"], 1.0, "lidar")
    run(table, monitor, 101, 50)
    monitor.reset()
    verdict = run(table, monitor, 151, 1)[0]
    assert subjects(verdict, FORGOTTEN) == {"lidar", "radar"}


@pytest.mark.parametrize(
    "message",
    [
        obstacles(ids=["ghost"], stamp=-1e300),
        obstacles(ids=["ghost"], stamp=-1e300, source="camrea"),
        obstacles(ids=[], position=..., velocity=..., radius=..., source="camrea"),
    ],
)
def test_one_message_does_not_stop_a_cell_for_good(message):
    """Over the wire: the reset of an operator ends it, and nothing else needs to."""
    world = World(sources=["cam0"], reset_token="sesame")
    monitor = Monitor(panda(), world.obstacles, rate=1.0 / PERIOD)

    def go_on(count):
        verdicts = []
        for _ in range(count):
            world.clock.sleep_until(world.clock.now() + PERIOD)
            world.send(
                obstacles(
                    ids=["man"],
                    stamp=MONOTONIC + world.clock.now(),
                    velocity=[[0.0, 0.0, 0.0]],
                    position=[FAR],
                )
            )
            if world.edge.requests.is_reset:
                world.edge.requests.is_reset = False
                monitor.reset()
            verdicts.append(monitor.step(world.clock.now(), HOME, STILL))
        return verdicts

    assert go_on(50)[-1].level is Level.CLEAR
    world.send(message)
    assert {one.level for one in go_on(100)[30:]} == {Level.STOP}
    world.send({"type": "reset", "token": "open"})
    assert go_on(50)[-1].level is Level.STOP
    world.send({"type": "reset", "token": "sesame"})
    verdicts = go_on(50)
    assert subjects(verdicts[0], FORGOTTEN)
    assert verdicts[-1].level is Level.CLEAR
