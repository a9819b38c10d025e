"""The process of a driver, for one connection to the robot; started by `watch`.

It ends when the connection is lost, since the client library cannot be used after that. `watch`
starts another one.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from typing import NoReturn

import msgspec

from armguard.drivers.arm import Arm, ArmLostError, MotionArm, ProgramArm, WrongArmError
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import CONNECTING, LEAVING, MEASURED, WRONG, Link
from armguard.drivers.loop import DriveLoop
from armguard.drivers.measurement import Measurement, describe
from armguard.drivers.moment import Conduct
from armguard.drivers.motion import MotionConduct
from armguard.drivers.options import ENDED, LOST, WRONG_ARM, DriveOptions
from armguard.drivers.override import OverrideConduct
from armguard.drivers.program import ProgramConduct
from armguard.drivers.session import Session
from armguard.drivers.stop_alone import stop_alone
from armguard.drivers.trajectory import TrajectoryConduct
from armguard.streams.nodes import Publisher, VerdictReader

_KEPT: list[Arm] = []
"""Connections, which end with the process: the library takes half a second to disconnect, and
blocks for ever if the robot hangs."""

CONNECT_TIMEOUT = 15
"""How long connecting may take, in whole seconds; then the system ends this process."""


def connect(session: Session) -> tuple[Arm, Conduct]:
    """Connect to the robot; returns the robot and its conduct.

    The module of the robot, and the library that it needs, are loaded here.

    Raises:
        ArmLostError: It cannot be connected.
        WrongArmError: Another arm answers.
    """
    options = session.options
    if options.driver == "ros2":
        from armguard.drivers.ros2 import Ros2Arm

        ros2 = Ros2Arm(options, session.link.tell)
        follows = options.follows
        return ros2, (TrajectoryConduct if follows else OverrideConduct)(ros2, session)
    follow: Callable[[DriveOptions], MotionArm]
    run: Callable[[DriveOptions], ProgramArm]
    if options.driver == "franka":
        from armguard.drivers.franka import FrankaMotionArm, FrankaProgramArm

        follow, run = FrankaMotionArm, FrankaProgramArm
    else:
        from armguard.drivers.ur import UrMotionArm, UrProgramArm

        follow, run = UrMotionArm, UrProgramArm
    if options.follows:
        moved = follow(options)
        return moved, MotionConduct(moved, session)
    running = run(options)
    return running, ProgramConduct(running, session)


def drive(options: DriveOptions, link: Link) -> int:
    """Connect, and drive until a measurement is done or the process must end, with the arm at rest.

    Returns:
        The exit code: 0 if a measurement is done, otherwise `ENDED`.

    Raises:
        ArmLostError: The arm can no longer be driven, or may not be at rest.
        WrongArmError: Another arm answers.
        KeyboardInterrupt: A signal ends this process while the arm may move.
    """
    keys = options.load_keys()
    latencies = Latencies(time.monotonic())
    measurement = Measurement(options.measure) if options.measure else None
    with contextlib.ExitStack() as resources:
        publishers = [
            resources.enter_context(Publisher(address, keys=keys)) for address in options.joints
        ]
        reader = resources.enter_context(VerdictReader(options.verdicts, keys))
        # The library may wait without end, and lets no other thread of Python run meanwhile. Each
        # read of the robot sets this timer anew.
        signal.alarm(CONNECT_TIMEOUT)
        session = Session(options, latencies, link, measurement)
        arm, conduct = connect(session)
        _KEPT.append(arm)
        link.tell(f"{options.model} at {options.host}: connected")
        loop = DriveLoop(arm, conduct, session, publishers, reader)
        code = 0
        try:
            loop.run()
        except KeyboardInterrupt:
            code = ENDED  # by a signal, or the process that watches this one has ended
        finally:
            link.count(latencies.counts)
        link.send(LEAVING)
        signal.setitimer(signal.ITIMER_REAL, options.longest_end)
        arm.leave()
    if measurement is not None and measurement.is_done:
        text = measurement.problem or describe(measurement.stops, options.names, options.payload)
        link.send(MEASURED, msgspec.json.encode([bool(measurement.problem), text]).decode())
    return code


def run(options: DriveOptions, link: Link) -> NoReturn:
    """Connect, drive, and end the process at once, with an exit code that states the result."""
    name = f"{options.model} at {options.host}"
    try:
        code = drive(options, link)
    except ArmLostError as error:
        # What cannot be driven must not move.
        link.tell(f"{name}: {error}; {stop_alone(options)}")
        code = LOST
    except WrongArmError as error:
        link.send(WRONG, str(error))
        code = WRONG_ARM
    except KeyboardInterrupt:
        # While it connected, or again while the arm was left.
        link.tell(f"{name}: ended before the arm was at rest; {stop_alone(options)}")
        code = LOST
    except BaseException as error:
        link.tell(f"{name}: the driver has failed ({type(error).__name__}); {stop_alone(options)}")
        traceback.print_exc()
        sys.stderr.flush()
        code = LOST
    os._exit(code)


def main() -> int:
    """Run the driver that the command line describes. Returns the exit code of a mistake."""
    try:
        options = msgspec.json.decode(" ".join(sys.argv[1:]), type=DriveOptions)
    except msgspec.DecodeError:
        sys.stderr.write("armguard starts this process itself: call armguard drive CELL instead\n")
        return WRONG_ARM
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    link = Link(options.link)
    link.send(CONNECTING)
    gc.freeze()
    run(options, link)


if __name__ == "__main__":
    sys.exit(main())
