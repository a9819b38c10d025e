import numpy as np
import pytest

from armguard import Monitor, Obstacles, Recorder, Robot
from armguard.exceptions import ArmguardError
from armguard.lab.commission.observations import _find_plan_ends, _find_stops, observe
from armguard.recording import Recording
from support import recordings_made
from support.panda_monitor import HOME, STILL


def test_only_a_stop_that_follows_another_level_is_one():
    told = [(0.0, True), (0.1, False), (0.2, True), (0.3, True), (0.4, False), (0.5, True)]
    assert _find_stops(told) == [(0.2, 0.4), (0.5, 0.5)]
    assert _find_stops([(0.0, True), (0.1, True)]) == []
    assert _find_stops([]) == []


def test_a_plan_ends_with_the_next_one_or_a_stop():
    class Piece:
        def __init__(self, stamp):
            self.stamp = stamp

    first, second = Piece(1.0), Piece(3.0)
    stops = _find_stops([(3.5, False), (4.0, True)])
    ended = [plan.ended for plan in _find_plan_ends([(0.9, first), (2.5, second)], stops, 9.0)]
    assert ended == [3.0, 4.0]


def test_a_recording_without_an_arm_at_work_is_refused(tmp_path):
    path = tmp_path / "run.mcap"
    recordings_made.record(path)
    recording = Recording(path)
    recording.events = lambda: iter(())
    with pytest.raises(ArmguardError, match=r"run\.mcap: has 0 joint states"):
        observe(recording)


@pytest.mark.parametrize("shape", [(0,), (0, 3)])
def test_a_message_without_obstacles_counts_as_a_message(tmp_path, shape):
    path = tmp_path / "run.mcap"
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(Robot.load("panda"), obstacles, rate=500.0)
    with Recorder(path, monitor) as recorder:
        for tick in range(40):
            now = tick / 500.0
            if tick % 2:
                obstacles.update([], now, np.zeros(shape), source="camera", radius=0.1)
            else:
                obstacles.update(["ball"], now, [[4.0, 3.0, 0.5]], source="camera", radius=0.1)
            monitor.step(now, HOME, STILL)
        assert recorder.close() == ""
    camera = observe(Recording(path)).sources["camera"]
    assert len(camera.stamps) == len(camera.ages) == 40
    assert len(camera.tracks["ball"][0]) == 20
