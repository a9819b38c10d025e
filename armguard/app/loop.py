"""The rate loop: drain inputs, step the monitor, publish the verdict, sleep to the deadline.

One thread, no locks. Deadlines are absolute, on a grid that never drifts; a tick that overruns
skips the deadlines it has missed, and they are counted. Garbage is collected in the idle time.
Whatever draws or records is another process: five milliseconds of Python in a thread make one tick
in thirty late.
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
"""Part of a period that taking messages may last at most; what is left waits for the next tick."""


class Spread(NamedTuple):
    """How long something took over all ticks, in [s]; nan without any tick."""

    p50: float
    """Half of all ticks took no longer."""
    p99: float
    p999: float
    longest: float


class LoopReport(NamedTuple):
    """What a run was like."""

    ticks: int
    late: int
    """Ticks that were not done before the next deadline."""
    missed: int
    """Deadlines that passed without a tick of their own."""
    tick: Spread
    """Whole ticks, from the first message that is taken until the verdict was observed."""
    drain: Spread
    """Taking messages."""
    step: Spread
    """Judging the joint state, with the resets and exemptions that were asked for."""
    publish: Spread
    """Sending the verdict."""
    received: int
    """Messages taken."""
    faults: dict[str, int]
    """Faults of messages, by kind and source."""
    monitor_faults: int
    """Refused rows and calls, and joint states not believed."""
    realtime: Realtime | None = None
    """What the system granted; None: it was not asked."""
    cut_short: int = 0
    """How often an input had more messages than one tick takes; the rest waited for the next."""
    lost: int | None = None
    """Events that the recording lacks; None: nothing was recorded."""


class Resets(NamedTuple):
    """How many of the resets that came were obeyed, and how many were refused."""

    obeyed: int = 0
    refused: int = 0


NO_RESETS = Resets()


class Observer:
    """Sees what a loop does; nothing in it may block."""

    def observe(self, loop: RateLoop, verdict: Verdict) -> None:
        """Called with each verdict after it was published."""

    def rest(self, loop: RateLoop, idle: float) -> None:
        """Called where there is time before the next tick, in [s], for what can wait until then."""


class RateLoop:
    """Steps a monitor at its rate from an edge and its inputs.

    Args:
        stepper: Steps the monitor, and answers what is asked of it.
        edge: What the inputs' messages go through.
        inputs: Where messages come from; the loop ends when one that can end has ended.
        clock: Tells time and sleeps; the same as the edge's.
        publish: Takes each verdict; must never block.
        answer: Takes the number of each reset that came, and the answer to it; must never block.
        observers: Told of each verdict and of time to rest, one after the other.

    Attributes:
        stepper: As above.
        monitor: What is stepped.
        clock: Tells time.
        durations: How long ticks took so far.
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
        """Numbers that the monitor knows exemptions by, by those of their senders."""

    @property
    def resets(self) -> Resets:
        """What became of resets so far."""
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
        """Drain, step, publish."""
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
        """Begin or end an exemption that was asked for; what is refused is counted, and told."""
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
        """What the run was like so far."""
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


PROVING_TIME = 0.5e-3
"""What a proof, which is made now and then, and what was left are done within, in [s]."""

RECORDING_CHECK_INTERVAL = 1.0
"""Between two looks whether a recording is still being written, in [s]."""


class RunRecording(Observer):
    """What a run adds to the recording of its monitor.

    Verdicts while there is no joint state to judge, and lines about messages that could not be
    used. Of the recording it says, once, that it has a gap, and when it is not written any more.

    Args:
        recorder: Is closed with this.
        faults: What tells of faulty messages.
        tell: Takes a line for people; None: it is logged.
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
        """Take a verdict that was published."""
        if verdict.sequence == 0:
            self.recorder.note_verdict(verdict)
        if self.recorder.lost and not self._is_gap_told:
            self._is_gap_told = True
            self._tell("the recording has a gap: what writes it does not keep up")
        # A loop that never rests looks all the same.
        if loop.clock.now() >= self._next_check + RECORDING_CHECK_INTERVAL:
            self._check_writer(loop)

    def rest(self, loop: RateLoop, idle: float) -> None:
        """Write what was left for when there is time, and prove the verdict if there is enough."""
        self.recorder.write_pending()
        if idle > PROVING_TIME:
            self.recorder.prove_pending()
        if loop.clock.now() >= self._next_check:
            self._check_writer(loop)

    def _check_writer(self, loop: RateLoop) -> None:
        """Tell, once, of what keeps the recording from being written, and when that is over."""
        self._next_check = loop.clock.now() + RECORDING_CHECK_INTERVAL
        trouble = self.recorder.find_trouble()
        if bool(trouble) != bool(self._trouble):
            self._tell(
                f"the recording is {f'not written: {trouble}' if trouble else 'written again'}"
            )
        self._trouble = trouble

    def close(self) -> None:
        """End the recording; what went wrong with it is told on standard error."""
        problem = self.recorder.close()
        if problem:
            complain(problem)


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """Options of a run that do not stand in its cell file."""

    obstacles_address: str = OBSTACLES_ADDRESS
    """Bound for publishers of obstacles; "-" reads JSON lines from standard input, with the joint
    states among them unless they have an address."""
    joints_address: str | None = None
    """Bound for publishers of joint states; may be the same as that of obstacles. None:
    `JOINTS_ADDRESS`, or standard input."""
    verdicts_address: str = VERDICTS_ADDRESS
    """Bound for readers of verdicts."""
    record: Path | None = None
    """Where to write a recording: a new file, or a folder for one; None: nowhere."""
    recorder_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Further keywords of `Recorder`."""
    duration: float = math.inf
    """How long to run, in [s]."""
    reset_token: str | None = None
    """What a reset message must carry; without one, none is obeyed."""
    realtime: bool = False
    """Whether to ask the system for real-time scheduling and locked memory; what it refuses is told
    on standard error."""
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
    """Supervise a cell from streams until interrupted, or the end of standard input.

    Args:
        cell: Robot, obstacles and monitor.
        options: Addresses, and what else is asked of the run.
        authenticator: Lets in clients, and stays open; None: one is made where the cell has keys.
        observer: Sees what the loop does.
        prepared: Called with the monitor and the digest of its configuration when everything is
            compiled, before the first tick.
        listening: Called with the addresses that were bound ("obstacles", "joints", "verdicts"),
            before the first tick.
        tell: Takes a line about a faulty message; must not block. Default: the log
            `armguard.streams`, which may.

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
    """The digest of what a monitor was made with.

    Raises:
        ArmguardError: Another one is expected.
    """
    # Loaded here, since a monitor by itself needs none.
    from armguard.monitor.configuration import digest_configuration

    digest = digest_configuration(monitor, cell.describe())
    if expected not in (None, digest):
        raise ArmguardError(
            "--expect",
            f"is {expected}, and the digest of this configuration is {digest}",
            remedy="find out what was changed since the other one was approved",
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
    """However what is inside ends, the last verdict that readers get is a STOP, with the cause.

    It saves them the time until their last verdict expires, and tells them why; where it is lost,
    they stop when that time is over.

    Args:
        publisher: Sends it.
        clock: The monitor's.
        note: Takes the cause as a line for the recording; None: there is none.
    """
    detail = "its time was over, or it was told to end"
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
    """What obstacles that bring no bound can do, as their table takes it, [m/s] or [m/s²]."""
    default = inspect.signature(Obstacles).parameters[name].default
    return float(given(cell.tables.bounds).get(name, default))


def _open_input(address: str, authenticator: Authenticator | None) -> tuple[Input, str]:
    """An input, and the address that it is bound to: that which the system chose, if it did."""
    if address != "-":
        source = SocketInput(address, authenticator)
        return source, source.address
    return LineInput(), address


def _inputs(options: RunOptions) -> tuple[str, str]:
    """Where obstacles and joint states come from."""
    obstacles_address, joints_address = options.obstacles_address, options.joints_address
    if joints_address is None:
        joints_address = "-" if obstacles_address == "-" else JOINTS_ADDRESS
    return obstacles_address, joints_address


_PER_OCTAVE = 64
_SHORTEST = 1e-7
_OCTAVES = 27  # up to 13 s; what is longer is counted there, its maximum is exact


class Durations:
    """Durations in [s], kept to about one percent; the longest exactly."""

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
