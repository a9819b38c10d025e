"""How the process of a driver ends, without a robot."""

import contextlib
import os

import msgspec
import pytest
import zmq

from armguard.drivers import __main__ as main
from armguard.drivers.arm import ArmLostError, WrongArmError
from armguard.drivers.link import Link
from armguard.drivers.options import ENDED, LOST, WRONG_ARM
from armguard.drivers.program import ProgramConduct
from armguard.messages.incoming import decode
from support.driven_cell import OPTIONS
from support.fake_arms import FakeArm


class Ended(Exception):  # noqa: N818
    """In place of the end of the process."""


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Runs with what `connect` does; the exit code, and the lines for people."""

    def end(code):
        raise Ended(code)

    def run(connect):
        reading, writing = os.pipe()
        joints = tuple(f"ipc://{tmp_path}/joints{number}" for number in (1, 2))
        addresses = {"joints": joints, "verdicts": f"ipc://{tmp_path}/verdicts"}
        monkeypatch.setattr(main, "connect", connect)
        with pytest.raises(Ended) as ended:
            main.run(msgspec.structs.replace(OPTIONS, **addresses), Link(writing))
        os.close(writing)
        with open(reading) as file:
            return ended.value.args[0], file.read()

    monkeypatch.setattr(main.os, "_exit", end)
    monkeypatch.setattr(main.signal, "alarm", lambda _: None)
    monkeypatch.setattr(main.signal, "setitimer", lambda *_: None)
    monkeypatch.setattr(main, "stop_alone", lambda _: "STOPPED ALONE")
    return run


@pytest.mark.hazard("H-20")
@pytest.mark.parametrize(
    ("error", "code", "stops"),
    [
        (KeyboardInterrupt(), LOST, True),
        (ArmLostError("lost"), LOST, True),
        (MemoryError(), LOST, True),
        (WrongArmError("another"), WRONG_ARM, False),
    ],
)
def test_whatever_ends_the_connecting_stops_the_robot_unless_it_is_another(run, error, code, stops):
    def connect(session):
        raise error

    ended, lines = run(connect)
    assert ended == code
    assert ("STOPPED ALONE" in lines) == stops


class LeftArm(FakeArm):
    """Is interrupted when it is read, and as often again when it is left."""

    def __init__(self, interrupts):
        super().__init__()
        self.interrupts = interrupts

    def read(self):
        raise KeyboardInterrupt

    def leave(self):
        super().leave()
        if self.interrupts:
            raise KeyboardInterrupt


@pytest.mark.parametrize("interrupts", [0, 1])
def test_an_arm_is_left_and_one_that_cannot_be_left_in_peace_is_stopped(run, interrupts):
    arm = LeftArm(interrupts)
    ended, lines = run(lambda session: (arm, ProgramConduct(arm, session)))
    assert (ended, arm.orders) == (LOST if interrupts else ENDED, ["leave"])
    assert "leaving" in lines
    assert ("STOPPED ALONE" in lines) == bool(interrupts)


class HeardArm(FakeArm):
    """Is read until it was heard by each monitor."""

    def __init__(self, sockets):
        super().__init__()
        self.speed, self.waiting = 0.0, sockets

    def read(self):
        self.waiting = [socket for socket in self.waiting if not socket.poll(0)]
        if not self.waiting:
            raise KeyboardInterrupt
        return super().read()._replace(q=[0.0] * 2, v=[0.0] * 2)


def test_every_monitor_gets_the_joint_states(run, tmp_path):
    with zmq.Context() as context, contextlib.ExitStack() as sockets:
        bound = [sockets.enter_context(context.socket(zmq.SUB)) for _ in range(2)]
        for number, socket in enumerate(bound, 1):
            socket.subscribe(b"")
            socket.bind(f"ipc://{tmp_path}/joints{number}")
        arm = HeardArm(bound)
        ended, _ = run(lambda session: (arm, ProgramConduct(arm, session)))
        assert (ended, arm.orders[-1]) == (ENDED, "leave")
        first, second = (decode(socket.recv(zmq.NOBLOCK)) for socket in bound)
        assert first.names == second.names == list(OPTIONS.names)
