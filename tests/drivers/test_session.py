import os
import time

import pytest

from armguard.drivers import loop as driving
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.loop import DriveLoop
from armguard.drivers.measurement import Measurement
from armguard.drivers.program import ProgramConduct
from armguard.drivers.session import Session
from support.driven_cell import OPTIONS
from support.fake_arms import FakeArm, FakeStreams


@pytest.mark.parametrize("count", [0, 1])
def test_a_session_ends_with_its_measurement(monkeypatch, count):
    monkeypatch.setattr(driving.signal, "setitimer", lambda *_: None)
    arm, streams, measurement = FakeArm(), FakeStreams(), Measurement(count)
    with open(os.devnull, "w") as nowhere:
        session = Session(OPTIONS, Latencies(time.monotonic()), Link(nowhere.fileno()), measurement)
        DriveLoop(arm, ProgramConduct(arm, session), session, [streams], streams).run()
    assert len(measurement.stops) == count
    assert arm.orders.count("pause") == count
