"""The process of a driver, for one connection to the robot; started by `watch`.

It ends when the connection is lost: what the client library was left in is nobody's to mend.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import time
import traceback
from typing import NoReturn

import msgspec

from armguard.drivers.arm import Arm, ArmLostError, WrongArmError
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import CONNECTING, MEASURED, Link
from armguard.drivers.loop import SMALLEST_SCALE, DriveLoop, Limits
from armguard.drivers.measurement import Measurement, describe
from armguard.drivers.options import LOST, WRONG_ARM, DriveOptions
from armguard.drivers.ur_lines import stop_by_script
from armguard.streams.nodes import Publisher, VerdictReader

CONNECT_TIMEOUT = 10
"""How long connecting may take, in whole seconds; then the system ends this process."""


def connect(options: DriveOptions) -> Arm:
    """Connect the arm; its module, and the library that it needs, are loaded here.

    Raises:
        ArmLostError: It cannot be connected.
        WrongArmError: Another arm answers.
    """
    from armguard.drivers.ur import UrArm

    # The library may wait without end, and lets no other thread of Python run meanwhile.
    signal.alarm(CONNECT_TIMEOUT)
    arm = UrArm(options)
    signal.alarm(0)
    return arm


def drive(arm: Arm, options: DriveOptions, link: Link) -> None:
    """Drive until a measurement is done, or for ever; the program is left paused.

    Raises:
        ArmLostError: The arm cannot be driven any more.
        KeyboardInterrupt: This process was told to end, or what started it has ended.
    """
    keys = options.load_keys()
    latencies = Latencies(time.monotonic())
    measurement = Measurement(options.measure) if options.measure else None
    limits = Limits(options.speed, options.stop_within, options.parent)
    with (
        Publisher(options.joints, keys=keys) as publisher,
        VerdictReader(options.verdicts, keys) as reader,
    ):
        loop = DriveLoop(
            arm,
            options.names,
            publisher,
            reader,
            latencies,
            link,
            limits,
            arm_name=options.arm,
            measurement=measurement,
        )
        try:
            loop.run()
        finally:
            link.count(latencies.counts)
            with contextlib.suppress(ArmLostError):
                arm.scale(SMALLEST_SCALE)
                arm.pause()
    if measurement is not None:
        text = measurement.problem or describe(measurement.stops, options.names, options.payload)
        link.send(MEASURED, msgspec.json.encode([bool(measurement.problem), text]).decode())


def run(options: DriveOptions, link: Link) -> NoReturn:
    """Connect, drive, and end the process at once, with an exit code that says how it went."""
    arm: Arm | None = None
    code = 0
    try:
        arm = connect(options)
        link.tell(f"{options.model} at {options.host}: connected")
        drive(arm, options, link)
    except ArmLostError as error:
        # What cannot be driven must not move.
        stop_by_script(options.host, options.deceleration)
        link.tell(f"{options.model} at {options.host}: {error}")
        code = LOST
    except WrongArmError as error:
        link.tell(str(error))
        code = WRONG_ARM
    except KeyboardInterrupt:
        pass
    except BaseException:
        stop_by_script(options.host, options.deceleration)
        traceback.print_exc()
        sys.stderr.flush()
        code = LOST
    # The library would take half a second to disconnect, and for ever from a robot that hangs.
    os._exit(code)


def main() -> int:
    """Run the driver that the command line describes. Returns the exit code of a mistake."""
    try:
        options = msgspec.json.decode(" ".join(sys.argv[1:]), type=DriveOptions)
    except msgspec.DecodeError:
        sys.stderr.write("this is a process of armguard's: call armguard drive CELL instead\n")
        return WRONG_ARM
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    link = Link(options.link)
    link.send(CONNECTING)
    gc.freeze()
    run(options, link)


if __name__ == "__main__":
    sys.exit(main())
