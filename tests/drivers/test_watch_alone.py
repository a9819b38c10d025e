"""Watching a driver's process, without a robot or its client library."""

import sys

from armguard.drivers import watch as watching
from armguard.drivers.options import DriveOptions

OPTIONS = DriveOptions(
    driver="ur",
    host="127.0.0.1",
    model="UR5e",
    rate=500.0,
    names=("a",),
    timeout=0.1,
    speed=1.0,
    stop_within=1.0,
    deceleration=4.0,
    payload=0.0,
    joints="tcp://127.0.0.1:1",
    verdicts="tcp://127.0.0.1:1",
)


def test_what_the_library_prints_is_no_sign_of_life(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/echo")  # prints, and sends nothing by the link
    driver = watching._Driver(OPTIONS)
    try:
        driver.process.wait()
        driver.heard = 0.0
        lines = driver.read(1.0) + driver.read(0.1)
        assert any("client library" in text for _, text in lines)
        assert driver.heard == 0.0
    finally:
        driver.close()
