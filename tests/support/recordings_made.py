"""Recordings that tests make, and what is in them."""

import contextlib
import os

from armguard.messages.answers import VerdictMessage, read_verdict
from armguard.recording import Recorder, Recording
from support import eventful_runs


def record(path, motion="joint", *, robot=None, **options):
    """An eventful run on a file; its verdicts and answers to plans."""
    _, obstacles, monitor = eventful_runs.make_monitor(motion, robot)
    with Recorder(path, monitor) as recorder:
        answers = eventful_runs.drive(monitor, obstacles, **options)
        assert recorder.close() == ""
    return answers


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
