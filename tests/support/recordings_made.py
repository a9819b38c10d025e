"""Recordings that tests make, and what is in them."""

import contextlib
import os

from armguard.messages.answers import VerdictMessage, read_verdict
from armguard.obstacles import Obstacles, Source
from armguard.recording import Recorder, Recording
from support import eventful_runs
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, see


def record(path, motion="joint", *, robot=None, recorder_options=None, **options):
    """An eventful run on a file; its verdicts and answers to plans."""
    _, obstacles, monitor = eventful_runs.make_monitor(motion, robot)
    with Recorder(path, monitor, **recorder_options or {}) as recorder:
        answers = eventful_runs.drive(monitor, obstacles, **options)
        assert recorder.close() == ""
    return answers


def record_pause(path):
    """A run beside a hand whose camera pauses for 170 ms, which stops the arm; its verdicts."""
    source = Source("camera", latency=0.005, rate=100.0)
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=[source]))
    verdicts = []
    with Recorder(path, monitor) as recorder:
        for tick in range(1200):
            now = tick * PERIOD
            if tick % 10 == 0 and not 0.8 <= now < 0.97:
                see(obstacles, now - 0.005, [0.95, 0.0, 0.5], ("hand",), source="camera")
            verdicts.append(monitor.step(now, HOME, STILL, now))
        assert recorder.close() == ""
    return verdicts


def read_events(path):
    """All events of a recording, its times left out."""
    return [event for _, event, _ in Recording(path).events()]


def read_verdicts(path):
    """The verdicts of a recording."""
    return [read_verdict(event) for event in read_events(path) if isinstance(event, VerdictMessage)]


def is_running(pid):
    """Whether a process is there, and is no zombie."""
    with contextlib.suppress(OSError), open(f"/proc/{pid}/stat") as file:
        return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def drain(descriptor):
    """Read all that is in a pipe now."""
    content = b""
    with contextlib.suppress(BlockingIOError):
        while part := os.read(descriptor, 1 << 16):
            content += part
    return content
