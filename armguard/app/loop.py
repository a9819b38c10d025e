"""The rate loop: reads inputs, steps the monitor, publishes the verdict, sleeps until the deadline.

The loop has one thread and no locks. Deadlines are absolute, on a grid that never drifts. A tick
that overruns skips the deadlines that it missed, and the loop counts them. Garbage is collected in
the idle time. Drawing and recording run in other processes: 5 ms of Python in another thread make
one tick in thirty late.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import armguard
from armguard.app.cell.cell import Cell
from armguard.app.cell.schema import given
from armguard.app.processes import complain, noted_interrupts
from armguard.app.realtime import IdleCollector, Realtime, release_compiler, request_realtime
from armguard.app.stepper import Stepper, take_shared_plan, tell_unknown
from armguard.clock import Clock, MonotonicClock
from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.streams.addresses import JOINTS_ADDRESS, OBSTACLES_ADDRESS, VERDICTS_ADDRESS
from armguard.streams.authentication import Authenticator
from armguard.streams.edge import Edge, EdgeSettings
from armguard.streams.faults import FaultLog, logger
from armguard.streams.inputs import Input, LineInput, SocketInput
from armguard.streams.nodes import VerdictPublisher
from armguard.streams.other_arm_intake import OtherArm
from armguard.streams.requests import ExemptionRequest
from armguard.streams.stamp_clocks import StampClock
from armguard.verdict import Reason, ReasonKind, ResetVerdict, Verdict

if TYPE_CHECKING:
    from armguard.shield.shield import Shield

LONGEST_SPELL = 0.19
REST = 0.01
"""[s]. A loop that had no time to sleep for so long sleeps for so long: with real-time scheduling,
no other process may have run meanwhile. Linux keeps the same part of the time for others."""

DRAIN_SHARE = 0.5
"""Greatest part of a period in which messages are read; further ones wait for the next tick."""


class Spread(NamedTuple):
    """Percentiles of a duration over all ticks, in [s]; nan without any tick."""

    p50: float
    """Half of all ticks took no longer."""
    p99: float
    p999: float
    longest: float


class LoopReport(NamedTuple):
    """Statistics of a run."""

    ticks: int
    late: int
    """Ticks that were not done before the next deadline."""
    missed: int
    """Deadlines that passed without a tick of their own."""
    tick: Spread
    """Whole ticks, from reading the first message to the end of the observers' calls."""
    drain: Spread
    """Taking messages."""
    step: Spread
    """Judging the joint state, including requested resets and exemptions."""
    publish: Spread
    """Sending the verdict."""
    received: int
    """Messages taken."""
    faults: dict[str, int]
    """Faults of messages, by kind and source."""
    monitor_faults: int
    """Refused rows and calls, and joint states that were not believed."""
    realtime: Realtime | None = None
    """Real-time properties that the system granted; None: none were requested."""
    cut_short: int = 0
    """How often an input had more messages than one tick reads; the rest waited for the next
    tick."""
    lost: int | None = None
    """Events that are missing in the recording; None: nothing was recorded."""


class Resets(NamedTuple):
    """Numbers of resets that were obeyed and refused."""

    obeyed: int = 0
    refused: int = 0


NO_RESETS = Resets()


class Observer:
    """Observes a loop; its methods must not block."""

    def observe(self, loop: RateLoop, verdict: Verdict) -> None:
        """Called with each verdict after it was published."""

    def rest(self, loop: RateLoop, idle: float) -> None:
        """Do work that is not urgent; called with the idle time before the next tick, in [s]."""


class RateLoop:
    """Steps a monitor at its rate from an edge and its inputs.

    Args:
        stepper: Steps the monitor, and answers requests.
        edge: Decodes and checks the messages of the inputs.
        inputs: Sources of messages. The loop ends when an input ends, such as standard input.
        clock: Clock to read and to sleep by; must be that of the edge.
        publish: Called with each verdict; must never block.
        answer: Called with the number of each reset and the answer to it; must never block.
        observers: Called with each verdict and in idle time, in this order.

    Attributes:
        stepper: As above.
        monitor: The monitor that is stepped.
        clock: The clock, as above.
        durations: Durations of all ticks so far.
        late: Ticks so far that were not done before the next deadline.
        missed: Deadlines so far that passed without a tick of their own.
    """

    def __init__(
        self,
        stepper: Stepper,
        edge: Edge,
        inputs: Sequence[Input],
        clock: Clock,
        publish: Callable[[Verdict], None],
        answer: Callable[[int, ResetVerdict], None],
        observers: Sequence[Observer] = (),
    ) -> None:
        self.stepper = stepper
        self.monitor = stepper.monitor
        self._edge = edge
        self._inputs = list(inputs)
        self.clock = clock
        self._publish = publish
        self._answer = answer
        self._observers = observers
        self.durations = Durations()
        self._drain, self._step, self._sending = Durations(), Durations(), Durations()
        self._ticks = 0
        self.late = 0
        self.missed = 0
        self._obeyed_resets = 0
        self._exemptions: dict[int, int] = {}
        """The monitor's numbers of exemptions, by the senders' numbers."""

    @property
    def resets(self) -> Resets:
        """Numbers of resets so far that were obeyed and refused."""
        return Resets(self._obeyed_resets, self._edge.faults.count("reset refused"))

    def run(self, duration: float = math.inf) -> LoopReport:
        """Loop for `duration` [s], until Ctrl-C (KeyboardInterrupt), or the end of an input."""
        with noted_interrupts() as was_interrupted, IdleCollector(self.clock) as collector:
            self._loop(duration, collector, was_interrupted)
        return self.report()

    def _loop(
        self, duration: float, collector: IdleCollector, was_interrupted: Callable[[], bool]
    ) -> None:
        clock, period = self.clock, self.monitor.period
        start = end = slept = clock.now()
        tick = 0
        try:
            while tick * period < duration and not was_interrupted():
                deadline = start + tick * period
                if end < deadline:
                    for observer in self._observers:
                        observer.rest(self, deadline - end)
                        end = clock.now()
                    collector.collect(deadline - end)
                    clock.sleep_until(deadline)
                    slept = deadline
                elif end - slept > LONGEST_SPELL:
                    collector.collect(0.0)
                    slept = end + REST
                    clock.sleep_until(slept)
                begin = clock.now()
                ended = any(source.ended for source in self._inputs)
                self.tick()
                end = clock.now()
                self.durations.add(end - begin)
                self._ticks += 1
                tick += 1
                behind = end - (start + tick * period)
                if behind > 0.0:
                    skipped = int(behind / period)
                    self.late += 1
                    self.missed += skipped
                    tick += skipped
                if ended:
                    break
        except KeyboardInterrupt:
            pass

    def tick(self) -> Verdict:
        """Read all inputs, step the monitor, publish the verdict."""
        edge, read_clock = self._edge, self.clock.now
        begin = read_clock()
        # The end of the drain is the tick's time: a state that was fresh then is not stale in it.
        now = edge.drain(self._inputs)
        drained = read_clock()
        if edge.requests.is_reset:
            edge.requests.is_reset = False
            self.stepper.reset()
            self._obeyed_resets += 1
        for exemption in edge.requests.exemptions:
            self._take_exemption(exemption)
        verdict = self.stepper.step(now)
        judged = read_clock()
        self._publish(verdict)
        self._sending.add(read_clock() - judged)
        self._step.add(judged - drained)
        self._drain.add(drained - begin)
        for number, obeyed in edge.requests.reset_verdicts:
            self._answer(number, obeyed)
        self.stepper.answer()
        for observer in self._observers:
            observer.observe(self, verdict)
        return verdict

    def _take_exemption(self, request: ExemptionRequest) -> None:
        """Begin or end a requested exemption; refused requests are counted and reported."""
        monitor, number = self.monitor, request.number
        lasting = {one.number for one in monitor.exemptions}
        self._exemptions = {
            told: known for told, known in self._exemptions.items() if known in lasting
        }
        if request.is_end:
            # One that has ended by itself needs no end.
            known = self._exemptions.get(number)
            if known is not None:
                monitor.watch(known)
            return
        try:
            if number in self._exemptions:
                raise ArmguardError("number", f"{number} is in use", expected="one of its own")
            self._exemptions[number] = monitor.ignore(
                request.link, request.ids, request.source, until=request.until, zone=request.zone
            )
        except ArmguardError as error:
            self._edge.faults.add("ignore refused", "exemptions", number, str(error))

    def report(self) -> LoopReport:
        """Statistics of the run so far."""
        return LoopReport(
            ticks=self._ticks,
            late=self.late,
            missed=self.missed,
            tick=self.durations.spread(),
            drain=self._drain.spread(),
            step=self._step.spread(),
            publish=self._sending.spread(),
            received=self._edge.received,
            faults={
                f"{key.kind}: {key.source}": number
                for key, number in sorted(self._edge.faults.counts.items())
            },
            monitor_faults=self.monitor.faults,
            cut_short=self._edge.cut_short,
        )


RECORDING_CHECK_INTERVAL = 1.0
"""Interval between two checks that the recording is still being written, in [s]."""


class RunRecording(Observer):
    """Adds the events of a run to the recording of its monitor.

    These events are verdicts without a joint state to judge, and lines about unusable messages. It
    also reports once when the recording has a gap, and when it is no longer written.

    Args:
        recorder: Writes the recording; closed together with this object.
        faults: The log of unusable messages.
        tell: Called with a line to print; None: the line is logged.
    """

    def __init__(
        self,
        recorder: armguard.Recorder,
        faults: FaultLog,
        tell: Callable[[str], None] | None,
    ) -> None:
        self.recorder = recorder
        recorder.defer()
        self._tell = logger.warning if tell is None else tell
        self._is_gap_told = False
        self._trouble, self._next_check = "", -math.inf
        faults.also_emit(recorder.note)

    def observe(self, loop: RateLoop, verdict: Verdict) -> None:
        """Record a verdict that was published."""
        if verdict.sequence == 0:
            self.recorder.note_verdict(verdict)
        if self.recorder.lost and not self._is_gap_told:
            self._is_gap_told = True
            self._tell("the recording has a gap: its writer is too slow")
        # A loop that never rests looks all the same.
        if loop.clock.now() >= self._next_check + RECORDING_CHECK_INTERVAL:
            self._check_writer(loop)

    def rest(self, loop: RateLoop, idle: float) -> None:
        """Write postponed events, and record a proof of the verdict if there is time."""
        begin = loop.clock.now()
        self.recorder.write_pending()
        self.recorder.prove_pending(idle - (loop.clock.now() - begin))
        if loop.clock.now() >= self._next_check:
            self._check_writer(loop)

    def _check_writer(self, loop: RateLoop) -> None:
        """Report once why the recording cannot be written, and once when it is written again."""
        self._next_check = loop.clock.now() + RECORDING_CHECK_INTERVAL
        trouble = self.recorder.find_trouble()
        if bool(trouble) != bool(self._trouble):
            self._tell(
                f"the recording is {f'not written: {trouble}' if trouble else 'written again'}"
            )
        self._trouble = trouble

    def close(self) -> None:
        """End the recording; errors are printed on standard error."""
        problem = self.recorder.close()
        if problem:
            complain(problem)


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """Options of a run that are not in its cell file."""

    obstacles_address: str = OBSTACLES_ADDRESS
    """Address to bind for publishers of obstacles; "-" reads JSON lines from standard input, which
    include the joint states unless `joints` is given."""
    joints_address: str | None = None
    """Address to bind for publishers of joint states; can be that of obstacles. None:
    `JOINTS_ADDRESS`, or standard input."""
    verdicts_address: str = VERDICTS_ADDRESS
    """Address to bind for readers of verdicts."""
    record: Path | None = None
    """Path of the recording: a new file, or a folder; None: nothing is recorded."""
    recorder_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Further keywords of `Recorder`."""
    duration: float = math.inf
    """How long to run, in [s]."""
    reset_token: str | None = None
    """Token that a reset message must carry; None: every reset is refused."""
    realtime: bool = False
    """Whether to request real-time scheduling and locked memory; a refusal is printed on standard
    error."""
    json_verdicts: bool = False
    """Whether verdicts, commands and answers are sent as JSON, not as msgpack."""
    moves: bool = False
    """Whether a shield moves the arm, as `[shield]` of the cell says."""
    expect: str | None = None
    """Digest that the configuration must have; None: any."""


def run(
    cell: Cell,
    options: RunOptions,
    *,
    authenticator: Authenticator | None = None,
    observer: Observer | None = None,
    prepared: Callable[[Monitor, str], None] | None = None,
    listening: Callable[[Mapping[str, str]], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> LoopReport:
    """Supervise a cell from streams until an interrupt or the end of standard input.

    Args:
        cell: Robot, obstacles and monitor.
        options: Addresses and further options of the run.
        authenticator: Authenticates clients; is not closed here. None: made here if the cell has
            keys.
        observer: Called with each verdict and in idle time.
        prepared: Called with the monitor and the digest of its configuration, after all kernels are
            compiled and before the first tick.
        listening: Called before the first tick with the bound addresses, by "obstacles", "joints"
            and "verdicts".
        tell: Called with a line about an unusable message; must not block. Default: the logger
            `armguard.streams`, which can block.

    Raises:
        StreamError: If an address cannot be used.
        ArmguardError: If the cell cannot be made.
    """
    robot, obstacles, monitor = cell.build()
    shield = cell.make_shield(monitor) if options.moves else None
    others = {
        other.name: OtherArm(
            other.robot.joints,
            functools.partial(other.publish, obstacles),
            functools.partial(take_shared_plan, other),
        )
        for other in cell.make_other_arms()
    }
    configuration = _digest_configuration(monitor, cell, options.expect)
    if prepared is not None:
        prepared(monitor, configuration)
    joint_state = cell.tables.joint_state
    clock = MonotonicClock()
    edge = Edge(
        obstacles,
        robot.joints,
        clock,
        FaultLog(clock.now) if tell is None else FaultLog(clock.now, tell),
        EdgeSettings(
            stamp_clocks={
                name: StampClock(source.clock, source.latency, source.clock_error)
                for name, source in cell.sources.items()
            },
            # What this clock is off by is in the robot's joint errors already.
            joint_clock=StampClock(joint_state.clock, joint_state.latency, joint_state.clock_error),
            joint_timeout=monitor.settings.longest_joint_step,
            reset_token=options.reset_token,
            limits=cell.source_limits,
            own_points=cell.make_own_points(robot),
            drain_time=DRAIN_SHARE * monitor.period,
            speed=_read_bound(cell, "speed"),
            accel=_read_bound(cell, "accel"),
            arm=cell.arm,
            others=others,
        ),
    )
    log: RunRecording | None = None
    observers = [] if observer is None else [observer]
    with contextlib.ExitStack() as resources:
        if authenticator is None:
            authenticator = cell.make_authenticator()
            if authenticator is not None:
                resources.enter_context(authenticator)
        if options.record is not None:
            recorder = armguard.Recorder(
                options.record, monitor, configuration=configuration, **options.recorder_options
            )
            log = RunRecording(recorder, edge.faults, tell)
            resources.callback(log.close)
            observers.insert(0, log)
        inputs: list[Input] = []
        bound: dict[str, str] = {}
        addresses = _inputs(options)
        for address in dict.fromkeys(addresses):
            source, bound[address] = _open_input(address, authenticator)
            inputs.append(source)
            resources.callback(source.close)
        # Verdicts must not be valid for longer than they are.
        offset = edge.times.offset - edge.times.offset_error
        publisher = VerdictPublisher(
            options.verdicts_address,
            offset,
            authenticator,
            as_json=options.json_verdicts,
            configuration=configuration,
            arm=cell.arm,
        )
        resources.callback(publisher.close)
        if listening is not None:
            obstacles_bound, joints_bound = (bound[address] for address in addresses)
            listening(
                {
                    "obstacles": obstacles_bound,
                    "joints": joints_bound,
                    "verdicts": publisher.address,
                }
            )
        note = None if log is None else log.recorder.note
        stepper = _make_stepper(monitor, shield, edge, publisher)
        loop = RateLoop(
            stepper, edge, inputs, clock, publisher.publish, publisher.answer, observers
        )
        release_compiler()
        with _ending_with_a_stop(publisher, clock, note):
            if not options.realtime:
                report = loop.run(options.duration)
            else:
                with request_realtime() as granted:
                    for line in granted.refusals:
                        complain(line)
                    report = loop.run(options.duration)._replace(realtime=granted)
        if log is None:
            return report
        log.recorder.write_pending()
        return report._replace(lost=log.recorder.lost)


def _digest_configuration(monitor: Monitor, cell: Cell, expected: str | None) -> str:
    """The digest of a monitor's configuration.

    Raises:
        ArmguardError: The digest is not the expected one.
    """
    # Loaded here, since a monitor by itself needs none.
    from armguard.monitor.configuration import digest_configuration

    digest = digest_configuration(monitor, cell.describe())
    if expected not in (None, digest):
        raise ArmguardError(
            "--expect",
            f"is {expected}, and the digest of this configuration is {digest}",
            remedy="find out what was changed since that configuration was approved",
        )
    return digest


def _make_stepper(
    monitor: Monitor, shield: Shield | None, edge: Edge, publisher: VerdictPublisher
) -> Stepper:
    if shield is None:
        return Stepper(monitor, edge, publisher.answer)
    from armguard.app.shield_stepper import ShieldStepper

    return ShieldStepper(shield, monitor, edge, publisher)


@contextlib.contextmanager
def _ending_with_a_stop(
    publisher: VerdictPublisher, clock: Clock, note: Callable[[str], None] | None
) -> Iterator[None]:
    """Publish a STOP with the cause as the last verdict, however the body of the context ends.

    Readers then stop at once and know why. If this verdict is lost, they stop when their last
    verdict expires.

    Args:
        publisher: Publishes the STOP.
        clock: The monitor's.
        note: Called with the cause as a line for the recording; None: there is no recording.
    """
    detail = "its duration was over, or it was asked to end"
    try:
        yield
    except BaseException as error:
        detail = f"{type(error).__name__}: {error}"
        raise
    finally:
        reason = Reason(ReasonKind.ENDED, "", detail)
        with contextlib.suppress(Exception):  # what ended the loop may be the publisher itself
            publisher.publish(tell_unknown(clock.now(), reason))
        if note is not None:
            note(str(reason))


def _read_bound(cell: Cell, name: str) -> float:
    """A default bound of obstacles, in [m/s] or [m/s²], as the table of obstacles expects it."""
    default = inspect.signature(Obstacles).parameters[name].default
    return float(given(cell.tables.bounds).get(name, default))


def _open_input(address: str, authenticator: Authenticator | None) -> tuple[Input, str]:
    """Open an input; returns it and its address, with the port that the system chose."""
    if address != "-":
        source = SocketInput(address, authenticator)
        return source, source.address
    return LineInput(), address


def _inputs(options: RunOptions) -> tuple[str, str]:
    """Open the inputs of obstacles and joint states."""
    obstacles_address, joints_address = options.obstacles_address, options.joints_address
    if joints_address is None:
        joints_address = "-" if obstacles_address == "-" else JOINTS_ADDRESS
    return obstacles_address, joints_address


_PER_OCTAVE = 64
_SHORTEST = 1e-7
_OCTAVES = 27  # up to 13 s; what is longer is counted there, its maximum is exact


class Durations:
    """Histogram of durations in [s], precise to about 1 %; the longest is kept exactly."""

    def __init__(self) -> None:
        self._counts = [0] * (_PER_OCTAVE * _OCTAVES)
        self.count = 0
        self.longest = 0.0

    def add(self, duration: float) -> None:
        """Count one duration, in [s]."""
        place = int(_PER_OCTAVE * math.log2(max(duration, _SHORTEST) / _SHORTEST))
        self._counts[min(place, len(self._counts) - 1)] += 1
        self.count += 1
        self.longest = max(self.longest, duration)

    def spread(self) -> Spread:
        """Percentiles, and the longest."""
        p50, p99, p999 = (self.percentile(percent) for percent in (50.0, 99.0, 99.9))
        return Spread(p50, p99, p999, self.longest)

    def percentile(self, percent: float) -> float:
        """A duration in [s] that `percent` of all do not exceed; nan if there is none."""
        if not self.count:
            return math.nan
        reached = np.searchsorted(np.cumsum(self._counts), percent / 100.0 * self.count)
        if reached >= len(self._counts) - 1:
            return self.longest
        upper: float = _SHORTEST * 2.0 ** ((int(reached) + 1) / _PER_OCTAVE)
        return min(upper, self.longest)
