"""A simulated controller of a Universal Robots arm, for clients that speak RTDE.

It has the ports of a real controller: RTDE (30004), three that take scripts (30001 to 30003), and
the dashboard (29999). It speaks as much of them as the clients of `ur_rtde` and armguard's driver
need. A program swings the joints to and fro; the speed slider scales it, and `pause`, `stopj` and
the watchdog of an RTDE input end or pause it. Of the program by which `ur_rtde` moves an arm it
obeys `servoJ`, `servoStop` and the watchdog. Faults can be made: see the methods.

How fast a real controller slows down is not known here, so it is a parameter.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import struct
import threading
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

RTDE_PORT = 30004
SCRIPT_PORTS = (30001, 30002, 30003)
DASHBOARD_PORT = 29999

READY = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
"""Where the arm begins, in [rad]."""

JOINTS = len(READY)

STOPPED, PLAYING, PAUSING, PAUSED = 1, 2, 3, 4
"""States of the program, as RTDE's `runtime_state` has them."""

NORMAL, PROTECTIVE_STOP = 1, 3
"""Safety modes."""

POWER_OFF, RUNNING = 3, 7
"""Robot modes."""

_Handler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]

_SERVO, _SERVO_STOP, _SET_WATCHDOG, _STOP_SCRIPT = 11, 16, 35, 255
"""Commands of the program of `ur_rtde`."""

_SERVO_LAG, _SERVO_ACCELERATION = 0.03, 40.0
"""How far a servoed joint is behind, in [s], and how fast it speeds up, in [rad/s²]."""

_HEADER = struct.Struct(">HB")

_SIZES = {"DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT8": "B", "VECTOR6D": "6d"}

_OUTPUTS = {
    "timestamp": "DOUBLE",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "payload": "DOUBLE",
}

_INPUTS = {"speed_slider_mask": "UINT32", "speed_slider_fraction": "DOUBLE"}


class Received(NamedTuple):
    """Something that a client ordered."""

    time: float
    """When it was taken, in [s] of the machine's monotonic clock."""
    order: str
    """Such as "slider", "pause", "play", "stopj"."""
    value: float
    """Of the slider, or the deceleration in [rad/s²]; otherwise 0."""


class UrController:
    """A simulated controller; a context that serves on the ports of one address.

    Args:
        host: The address; each of 127.0.0.0/8 is another robot of this machine.
        model: What the dashboard answers to `get robot model`.
        rate: Packages a second that it can send, in [Hz]: 500, or 125 for a CB3.
        version: Of its software: major, minor, bug fix, build.
        speed: Of the swinging joints at most, in [rad/s].
        deceleration: By which it slows down for a pause or a slider, in [rad/s²].
        reaction: From an order until it begins to slow down, in [s].
        has_watchdog: Whether its program has set a watchdog on the slider's input, with "pause".

    Attributes:
        received: All orders of clients so far, the slider's where it changed.
        started: How often `play` was obeyed.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        model: str = "UR5",
        rate: float = 500.0,
        *,
        version: tuple[int, int, int, int] = (5, 12, 6, 1102099),
        speed: float = 0.5,
        deceleration: float = 4.0,
        reaction: float = 0.004,
        has_watchdog: bool = False,
    ) -> None:
        self.host = host
        self.received: list[Received] = []
        self.started = 0
        self.refuses = False
        """Whether it ends every connection at once."""
        self.is_remote = True
        self.loses = 0.0
        """Which share of the packages is lost."""
        self.is_frozen = False
        """Whether it sends nothing and takes nothing."""
        self.slider_in_use = False
        """Whether another client has the slider."""
        self.obeys_pause = True
        self.ignores_slider = False
        self.payload = 0.0
        self._model = model
        self._rate = rate
        self._version = version
        self._speed = speed
        self._deceleration = deceleration
        self._reaction = reaction
        self._watchdog = 0.1 if has_watchdog else math.inf
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._ending = asyncio.Event()
        self._connections: set[asyncio.StreamWriter] = set()
        self._streams: dict[asyncio.StreamWriter, list[str]] = {}
        self._begun = time.monotonic()
        self._fed = -math.inf
        self.slider = 1.0
        """Fraction of its speed that the program gets."""
        self._pending: list[tuple[float, Callable[[], None]]] = []
        self._random = np.random.default_rng(0)
        self.q: NDArray[np.float64] = np.array(READY)
        self.v: NDArray[np.float64] = np.zeros(JOINTS)
        self.program = PLAYING
        self.safety = NORMAL
        self.mode = RUNNING
        self.is_controlled = False
        """Whether the program of `ur_rtde` runs."""
        self._inputs: dict[str, float] = {}
        self._servo: NDArray[np.float64] | None = None
        self._control_state = 0
        self._is_executing = False
        self._braking = self._deceleration
        self._target = 1.0
        self.pace = 0.0
        """Fraction of its speed at which the program moves the arm."""
        self._phase = 0.0

    # Life.

    def __enter__(self) -> UrController:
        listening = threading.Event()
        problems: list[BaseException] = []

        def serve() -> None:
            try:
                asyncio.run(self._serve(listening))
            except OSError as error:
                problems.append(error)
                listening.set()

        self._thread = threading.Thread(target=serve, name="ur controller", daemon=True)
        self._thread.start()
        listening.wait()
        if problems:
            raise problems[0]
        return self

    def __exit__(self, *_: object) -> None:
        self._call(self._ending.set)
        if self._thread is not None:
            self._thread.join()

    def _call(self, order: Callable[[], object]) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(order)

    async def _serve(self, listening: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        self._ending = asyncio.Event()
        async with contextlib.AsyncExitStack() as stack:
            for port, handle in (
                (RTDE_PORT, self._serve_rtde),
                *((port, self._serve_script) for port in SCRIPT_PORTS),
                (DASHBOARD_PORT, self._serve_dashboard),
            ):
                server = await asyncio.start_server(self._guard(handle), self.host, port)
                stack.callback(server.close)
            listening.set()
            await self._tick()
            self.cut()
            while self._connections:
                await asyncio.sleep(0.01)

    def _guard(self, handle: _Handler) -> _Handler:
        """A handler whose connection is known, and closed however it ends."""

        async def guarded(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._connections.add(writer)
            try:
                if not self.refuses:
                    await handle(reader, writer)
            except (OSError, asyncio.IncompleteReadError, struct.error):
                pass
            finally:
                self._connections.discard(writer)
                self._streams.pop(writer, None)
                writer.close()

        return guarded

    # Faults made on purpose.

    @property
    def clients(self) -> int:
        """Connections that are sent packages."""
        return len(self._streams)

    def cut(self) -> None:
        """End all connections; new ones are taken."""

        def close() -> None:
            for writer in list(self._connections):
                writer.transport.abort()

        self._call(close)

    def send_garbage(self, data: bytes) -> None:
        """Send bytes that are no package to all clients of RTDE."""

        def send() -> None:
            for writer in list(self._streams):
                writer.write(data)

        self._call(send)

    def stop_protectively(self) -> None:
        """A protective stop: the arm stops hard, and its program pauses."""
        self.safety = PROTECTIVE_STOP
        self.pace, self.v = 0.0, np.zeros(JOINTS)
        self.program = PAUSED

    def recover(self) -> None:
        """Somebody unlocks the protective stop; the program stays paused."""
        self.safety = NORMAL

    def play(self) -> bool:
        """Start or resume the program, as the button on the pendant does."""
        if self.safety != NORMAL or self.mode != RUNNING:
            return False
        self._pending.clear()
        self.is_controlled = False
        self.program, self._target = PLAYING, 1.0
        self.started += 1
        return True

    # Motion.

    async def _tick(self) -> None:
        period = 1.0 / self._rate
        deadline = time.monotonic()
        while not self._ending.is_set():
            deadline = max(deadline + period, time.monotonic() - 10.0 * period)
            await asyncio.sleep(max(0.0, deadline - time.monotonic()))
            if self.is_frozen:
                continue
            now = time.monotonic()
            for entry in [one for one in self._pending if one[0] <= now]:
                self._pending.remove(entry)
                entry[1]()
            if self.program == PLAYING and self._fed + self._watchdog < now and self._fed > 0.0:
                self._note("watchdog")
                if self.is_controlled:
                    self._stop()
                else:
                    self._pause(now)
            if self.is_controlled:
                self._control(period)
            else:
                self._move(period)
            for writer, names in list(self._streams.items()):
                if self._random.random() >= self.loses:
                    self._write(writer, 85, self._pack(names))

    def _move(self, period: float) -> None:
        """One period of the program, at its pace, or of a stop."""
        wanted = (1.0 if self.ignores_slider else self.slider) * self._target
        wanted = wanted if self.program in (PLAYING, PAUSING) else 0.0
        step = period * self._deceleration / self._speed
        self.pace += float(np.clip(wanted - self.pace, -step, step))
        if self.program == PAUSING and self.pace == 0.0:
            self.program = PAUSED
        self._phase += period * self.pace
        # Each joint swings with the same speed in the middle of its way.
        before, self.q = self.q, np.array(READY)
        self.q[:3] += 0.5 * np.sin(self._phase * self._speed / 0.5) * np.array([1.0, 0.5, 0.25])
        self.v = (self.q - before) / period

    def _control(self, period: float) -> None:
        """One period of the program of `ur_rtde`: take its command, and move."""
        if self.program == PLAYING:
            self._take_command()
        if self.program != PLAYING or self.safety != NORMAL:
            self._servo = None
        if self._servo is None:
            step = period * self._braking
            wanted = self.v - np.clip(self.v, -step, step)
        else:
            step = period * _SERVO_ACCELERATION
            wanted = (self._servo - self.q) / _SERVO_LAG
            wanted = self.v + np.clip(wanted - self.v, -step, step)
        self.v = wanted
        self.q = self.q + period * wanted
        if self._is_executing and not self.v.any():
            self._control_state = 2  # done

    def _take_command(self) -> None:
        command = int(self._inputs.get("input_int_register_0", 0))
        values = [self._inputs.get(f"input_double_register_{k}", 0.0) for k in range(JOINTS)]
        if command in (0, _SERVO):
            self._is_executing, self._control_state = False, 1  # ready
            if command == _SERVO:
                self._servo = np.array(values)
        elif not self._is_executing:
            self._is_executing = True
            if command == _SERVO_STOP:
                self._note("servo stop", values[0])
                self._servo = None
            elif command == _SET_WATCHDOG:
                self._watchdog = 1.0 / values[0]
                self._fed = time.monotonic()
            elif command == _STOP_SCRIPT:
                self._stop()

    def _later(self, order: Callable[[], None]) -> None:
        self._pending.append((time.monotonic() + self._reaction, order))

    def _note(self, order: str, value: float = 0.0) -> None:
        self.received.append(Received(time.monotonic(), order, value))

    def _pause(self, now: float) -> None:
        self.program, self._target = PAUSING, 0.0

    def _stop(self) -> None:
        self.program, self._target = STOPPED, 0.0
        if self.is_controlled:
            self._braking, self._watchdog, self._inputs = self._deceleration, math.inf, {}

    def _start_control(self) -> None:
        """The program of `ur_rtde` takes the place of the one before."""
        if self.safety == NORMAL and self.mode == RUNNING:
            self._note("control")
            self._stop()
            self.is_controlled, self.program = True, PLAYING
            self._servo, self._inputs, self._watchdog = None, {}, math.inf

    # RTDE.

    async def _serve_rtde(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        inputs: list[list[str]] = []
        outputs: list[str] = []
        while True:
            size, kind = _HEADER.unpack(await reader.readexactly(_HEADER.size))
            data = await reader.readexactly(size - _HEADER.size)
            while self.is_frozen and not self._ending.is_set():
                await asyncio.sleep(0.01)
            if kind == ord("V"):
                self._write(writer, kind, bytes([data == b"\0\x02"]))
            elif kind == ord("v"):
                self._write(writer, kind, struct.pack(">4I", *self._version))
            elif kind == ord("O"):
                outputs = [name for name in data[8:].decode().split(",") if name]
                types = ",".join(map(self._find_type, outputs))
                self._write(writer, kind, b"\x01" + types.encode())
            elif kind == ord("I"):
                inputs.append([name for name in data.decode().split(",") if name])
                types = ",".join(map(self._find_input_type, inputs[-1]))
                self._write(writer, kind, bytes([len(inputs)]) + types.encode())
            elif kind == ord("S"):
                self._write(writer, kind, b"\x01")
                self._streams[writer] = outputs
            elif kind == ord("P"):
                self._streams.pop(writer, None)
                self._write(writer, kind, b"\x01")
            elif kind == ord("U"):
                self._take(inputs[data[0] - 1], data[1:])

    def _write(self, writer: asyncio.StreamWriter, kind: int, data: bytes) -> None:
        writer.write(_HEADER.pack(_HEADER.size + len(data), kind) + data)

    def _find_type(self, name: str) -> str:
        if re.fullmatch(r"output_int_register_\d+", name):
            return "INT32"
        if re.fullmatch(r"output_double_register_\d+", name):
            return "DOUBLE"
        return _OUTPUTS.get(name, "NOT_FOUND")

    def _find_input_type(self, name: str) -> str:
        if name in _INPUTS:
            return "IN_USE" if self.slider_in_use else _INPUTS[name]
        if name.startswith(("input_double_register_", "standard_analog_output_")):
            return "UINT8" if name.endswith(("mask", "type")) else "DOUBLE"
        return "INT32" if name.startswith("input_int_register_") else "UINT8"

    def _pack(self, names: list[str]) -> bytes:
        values: dict[str, Sequence[float] | NDArray[np.float64]] = {
            "timestamp": [time.monotonic() - self._begun],
            "actual_q": self.q,
            "actual_qd": self.v,
            "robot_mode": [self.mode],
            "safety_mode": [self.safety],
            "runtime_state": [self.program],
            "robot_status_bits": [3],
            "safety_status_bits": [1 if self.safety == NORMAL else 4],
            "speed_scaling": [self.pace],
            "target_speed_fraction": [self.slider],
            "payload": [self.payload],
            "output_int_register_0": [self._control_state],
        }
        packed = [
            struct.pack(f">{_SIZES[self._find_type(name)]}", *values.get(name, [0]))
            for name in names
        ]
        return b"\x01" + b"".join(packed)

    def _take(self, names: list[str], data: bytes) -> None:
        """Take a package of inputs."""
        form = ">" + "".join(_SIZES[self._find_input_type(name)] for name in names)
        values = dict(zip(names, struct.unpack(form, data), strict=True))
        self._inputs |= {name: value for name, value in values.items() if "_register_" in name}
        if "input_int_register_0" in values:
            self._fed = time.monotonic()
        if values.get("speed_slider_mask") == 1:
            self._fed = time.monotonic()
            slider = values["speed_slider_fraction"]
            if slider != self.slider:
                self._note("slider", slider)
            if slider == 0.0 and self.program == PLAYING:
                # What real controllers were seen to do when it rises again.
                self.stop_protectively()
            self.slider = slider

    # Scripts and the dashboard.

    async def _serve_script(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        writer.write(b"\0" * 16)  # in place of its states, which no client reads
        while line := (await reader.readline()).decode():
            stop = re.fullmatch(r"\s*stopj\(([\d.]+)\)\s*", line)
            if stop and not self.is_frozen and self.is_remote:
                self._note("stopj", float(stop[1]))
                self._later(self._stop)
            if line.startswith("def rtde_control") and not self.is_frozen and self.is_remote:
                self._later(self._start_control)

    async def _serve_dashboard(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        writer.write(b"Connected: Universal Robots Dashboard Server\n")
        while line := (await reader.readline()).decode().strip():
            while self.is_frozen and not self._ending.is_set():
                await asyncio.sleep(0.01)
            writer.write(f"{self._answer(line)}\n".encode())

    def _answer(self, line: str) -> str:
        if line in ("pause", "play", "stop"):
            self._note(line)
            return self._obey(line)
        answers = {
            "robotmode": f"Robotmode: {'RUNNING' if self.mode == RUNNING else 'POWER_OFF'}",
            "PolyscopeVersion": "URSoftware {}.{}.{}.{} (Aug 09 2022)".format(*self._version),
            "get robot model": self._model,
            "get serial number": "20225500001",
            "is in remote control": str(self.is_remote).lower(),
            "running": f"Program running: {str(self.program == PLAYING).lower()}",
        }
        return answers.get(line, f"could not understand: '{line}'")

    def _obey(self, line: str) -> str:
        failure = f"Failed to execute: {line}"
        if not self.is_remote:
            return f"Command is not allowed due to safety reasons: {line}"
        if line == "play":
            return "Starting program" if self.play() else failure
        if self.program not in (PLAYING, PAUSING, PAUSED):
            return failure
        if line == "pause" and self.obeys_pause:
            self._later(lambda: self._pause(time.monotonic()))
        if line == "stop":
            self._later(self._stop)
        return "Pausing program" if line == "pause" else "Stopped"
