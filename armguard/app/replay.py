"""`armguard replay`: replays a recording; compares, explains, verifies or exports its verdicts.

Recordings of other software have no verdicts; the monitor of a cell file judges them.
"""

from __future__ import annotations

import contextlib
import csv
import math
import re
import sys
import tempfile
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from rich.table import Table

from armguard.app.cell.cell import Cell
from armguard.app.loop import Durations
from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import make_console, print_json
from armguard.app.view_feed import MonitorFeed
from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.recording.bags import BagInputs, BagRun
from armguard.recording.reading import Recording
from armguard.recording.recorder import Recorder, check_new
from armguard.recording.replay import Replay, ReplayedTick, ReplayReport
from armguard.recording.signing import read_signing_key
from armguard.recording.verification import verify
from armguard.robot.description import list_robots
from armguard.verdict import Level, Verdict, find_weightiest
from armguard.view.export import check_export
from armguard.view.messages import Origin, StatusMessage
from armguard.view.process import launch
from armguard.view.publisher import FramePublisher

if TYPE_CHECKING:
    from armguard.app import cli

_AS_THEY_ARE = (
    "contact_time",
    "harm_time",
    "contact_speed",
    "stop_time",
    "speed_scale",
    "link",
    "obstacle",
    "complete",
    "evaluated",
    "stop",
    "proved_until",
)
"""Fields of a verdict that the table contains unchanged."""

COLUMNS = ("time", "now", "sequence", "level", *_AS_THEY_ARE, "reasons", "identical")
"""Columns of the table that `--csv` writes."""

PAIRS_SHOWN = 5

STANDARD_OUTPUT = Path("-")


class Stop(NamedTuple):
    """One recorded STOP, from its first verdict to its last; times in [s] of the monitor."""

    begin: float
    end: float
    reason: str
    """The weightiest reason of its first verdict."""
    ticks: int
    kept: int
    """Number of these ticks that are a STOP in the replay as well."""


def replay(wishes: cli.Replay) -> int:
    """Replay a recording of armguard or of other software, and print the results.

    Args:
        wishes: What the command line says.

    Returns:
        The exit code: 0, or 1 if verdicts differ, if not all could be compared, or if the recording
        is incomplete.

    Raises:
        ArmguardError: A file or an option is unusable.
    """
    if wishes.verify:
        return verify_chain(wishes)
    is_of_others = bool(wishes.topics) or wishes.cell is not None
    check_options(wishes, is_of_others=is_of_others)
    return replay_bag(wishes) if is_of_others else replay_own(wishes)


def check_options(wishes: cli.Replay, *, is_of_others: bool) -> None:
    """Refuse options that contradict each other, and files that cannot be written.

    Args:
        wishes: What the command line says.
        is_of_others: Whether other software wrote the recording.

    Raises:
        ArmguardError: An option or file cannot be used.
    """
    if wishes.json and wishes.csv == STANDARD_OUTPUT:
        raise ArmguardError(
            "--csv -", "and --json both take standard output", expected="a file for the table"
        )
    if is_of_others and not (wishes.topics and wishes.cell):
        missing = "--cell" if wishes.topics else "--topics"
        raise ArmguardError(missing, "is missing: a recording of other software needs both")
    if is_of_others and wishes.what_if is not None:
        raise ArmguardError(
            "--what-if", "is for armguard's own recordings", remedy="make one by --record"
        )
    if wishes.key is not None:
        raise ArmguardError("--key", "is for signatures", expected="--verify beside it")
    plain = type(wishes)(wishes.file)
    for name in ("radius", "snapshot", "stamps", "record"):
        if not is_of_others and getattr(wishes, name) != getattr(plain, name):
            raise ArmguardError(
                f"--{name}",
                "is for recordings of other software",
                expected="--cell and --topics beside it",
            )
    check_table(wishes.csv, wishes.file)
    if wishes.export is not None:
        check_export(wishes.export)


def verify_chain(wishes: cli.Replay) -> int:
    """Find changes of a recording since it was written, and print them.

    Args:
        wishes: What the command line says.

    Returns:
        The exit code: 0, or 1 if something was changed or is missing, or if the recording has no
        end.

    Raises:
        ArmguardError: The file or the key cannot be used, or an option does not apply to --verify.
    """
    plain = type(wishes)(wishes.file, verify=True, key=wishes.key, json=wishes.json)
    if wishes != plain:
        raise ArmguardError(
            "--verify", "replays nothing", expected="no other option than --key and --json"
        )
    results = verify(wishes.file, None if wishes.key is None else read_signing_key(wishes.key))
    console = make_console(stderr=wishes.json, soft_wrap=True)
    for one in results:
        told = "intact" if one.is_intact else "not intact"
        signed = f"signed by {', '.join(one.keys)}" if one.keys else "not signed"
        console.print(
            f"{one.path}: part {one.part}, {told}; {one.chunks} chunks are as they were, {signed}"
        )
        for problem in one.problems:
            console.print(f"  {problem}")
    first = results[0].part
    console.print(f"verified from part {first} on")
    if first > 1:
        missed = "part 1 was" if first == 2 else f"parts 1 to {first - 1} were"
        console.print(f"{missed} not verified; --keep-days removes old parts, and so can anybody")
    is_intact = all(one.is_intact for one in results)
    if is_intact and wishes.key is None:
        console.print(
            "without --key the author is unknown: anybody who can write the file can replace all "
            "of it"
        )
    if wishes.json:
        found = [
            {**one._asdict(), "path": str(one.path), "intact": one.is_intact} for one in results
        ]
        print_json(
            lambda: {
                "intact": is_intact,
                "first_part": first,
                "unverified_parts": first - 1,
                "files": found,
            }
        )
    return 0 if is_intact else COMPLAINT


def replay_own(wishes: cli.Replay) -> int:
    """Replay a recording that `--record` or a `Recorder` wrote; returns the exit code."""
    recording = Recording(wishes.file)
    changes = {} if wishes.what_if is None else read_changes(wishes.what_if)
    if shows_page(wishes):
        check_drawable(str(recording.robot.get("name")))
    run = Replay(recording, changes)
    stops, watch, took = lead(run.monitor, run.ticks(), wishes)
    report, explained = run.report(), explain_tick(run.monitor, watch)
    configuration = recording.provenance.get("configuration", "")
    found = summarise(report, stops, took, changes, configuration)
    words: Sequence[str | Table] = describe_replay(recording, report, stops, took)
    if changes:
        words = describe_changes(stops, changes)
    show(wishes, found, explained, explained or words)
    return 0 if changes or explained or report.is_identical else COMPLAINT


def replay_bag(wishes: cli.Replay) -> int:
    """Replay a recording of other software through a cell's monitor; returns the exit code."""
    if wishes.record is not None:
        check_new(wishes.record)
    assert wishes.cell is not None, "checked"
    cell = Cell.load(wishes.cell)
    _, _, monitor = cell.build()
    inputs = BagInputs(wishes.topics, wishes.radius, wishes.snapshot, wishes.stamps)
    bag = BagRun(wishes.file, monitor, inputs)
    recorder = None if wishes.record is None else Recorder(wishes.record, monitor)
    with recorder or contextlib.nullcontext():
        stops, watch, took = lead(monitor, bag.ticks(), wishes, cell.urdf)
        problem = "" if recorder is None else recorder.close()
    explained = explain_tick(monitor, watch)
    found = {
        "ticks": stops.ticks,
        "seconds": stops.seconds,
        "took": took,
        "stops": [stop._asdict() for stop in stops.stops],
        "passed_over": bag.passed_over,
    }
    words = explained[:] or [
        f"{wishes.file}: {stops.ticks} verdicts, {len(stops.stops)} stops in {stops.seconds:.1f} s",
        *(f"{one.begin:.3f} s to {one.end:.3f} s: {one.reason}" for one in stops.stops),
    ]
    words += [f"passed over: {count} {kind}" for kind, count in bag.passed_over.items()]
    if monitor.choice is not None:
        words += [f"settings chosen: {line}" for line in monitor.choice.summary]
    show(wishes, found, explained, words)
    if problem:
        complain(problem)
    return COMPLAINT if problem else 0


def shows_page(wishes: cli.Replay) -> bool:
    """Whether a page is needed, to be shown or only to be exported."""
    return wishes.view or wishes.export is not None


def show(
    wishes: cli.Replay,
    found: dict[str, Any],
    explained: Sequence[str],
    words: Sequence[str | Table],
) -> None:
    """Print the results: one JSON object, or text.

    Args:
        wishes: The command line. With a table on standard output, nothing else is printed there.
        found: Results for programs.
        explained: Explanation of the requested verdict.
        words: Results for people.
    """
    if wishes.json:
        print_json(lambda: found | ({"explained": "\n".join(explained)} if explained else {}))
        return
    console = make_console(stderr=wishes.csv == STANDARD_OUTPUT, soft_wrap=True)
    for one in words:
        console.print(one)


def lead(
    monitor: Monitor,
    ticks: Iterator[ReplayedTick],
    wishes: cli.Replay,
    urdf: tuple[str, list[str]] = ("", []),
) -> tuple[StopList, Watch, float]:
    """Replay all ticks, or those up to the one to explain.

    Args:
        monitor: The replayed monitor.
        ticks: Iterator that replays the next tick.
        wishes: What the command line says.
        urdf: Path of the arm's URDF and its package folders, unless armguard knows the arm by name.

    Returns:
        The stops, the verdict to explain, and the duration in [s].

    Raises:
        ArmguardError: There is no verdict at the requested time.
    """
    stops, watch = StopList(), Watch(wishes.explain)
    begin = time.monotonic()
    with contextlib.ExitStack() as resources:
        observers: list[Callable[[ReplayedTick], None]] = [stops.take, watch.take]
        if wishes.csv is not None:
            observers.append(resources.enter_context(open_table(wishes.csv)))
        if shows_page(wishes):
            observers.append(resources.enter_context(show_page(monitor, urdf, wishes)))
        for tick in ticks:
            for observe in observers:
                observe(tick)
            if watch.found is not None:
                break
    if wishes.explain is not None and watch.found is None:
        raise ArmguardError(
            "--explain",
            f"is {wishes.explain}",
            expected=f"a time from {watch.first} to {watch.last}",
        )
    return stops, watch, time.monotonic() - begin


def check_table(csv_file: Path | None, path: Path) -> None:
    """Refuse to overwrite the recording with a table.

    Args:
        csv_file: Path of the table; None: no table.
        path: The recording, or its folder.

    Raises:
        ArmguardError: The table would replace the recording.
    """
    if csv_file is None or csv_file == STANDARD_OUTPUT:
        return
    table, recording = csv_file.resolve(), path.resolve()
    is_linked = table.exists() and recording.exists() and table.samefile(recording)
    if is_linked or table == recording or recording in table.parents:
        raise ArmguardError(
            "--csv", f"is {csv_file}, the recording itself", expected="another file"
        )


def check_drawable(robot: str) -> None:
    """Refuse to draw an arm without meshes.

    Raises:
        ArmguardError: armguard does not know the arm by name.
    """
    if robot not in list_robots():
        raise ArmguardError(
            "--view",
            f"cannot draw {robot!r}",
            expected=f"one of {', '.join(list_robots())}: meshes are in no recording",
        )


def read_changes(text: str) -> dict[str, str]:
    """Settings and their values from the text of `--what-if`.

    Raises:
        ArmguardError: It is no list of name=value.
    """
    changes = {}
    for part in text.split(","):
        name, equals, value = map(str.strip, part.partition("="))
        if not (name and equals and value):
            raise ArmguardError(
                "--what-if", f"holds {part!r}", expected="name=value, such as latency=0.01"
            )
        changes[name] = value
    return changes


class StopList:
    """Finds the STOPs of a recording, and how much of each is a STOP in the replay as well.

    Attributes:
        stops: All STOPs so far, including the present one.
        ticks: Number of ticks so far.
        new: Ticks that are a STOP only in the replay.
        seconds: From the first tick to the last, in [s] of the monitor's clock.
    """

    def __init__(self) -> None:
        self.stops: list[Stop] = []
        self.ticks = self.new = 0
        self.seconds = self._first = 0.0
        self._is_stopped = False

    def take(self, tick: ReplayedTick) -> None:
        """Take the next tick."""
        now, verdict = tick.now, tick.recorded
        if not self.ticks:
            self._first = now
        self.ticks += 1
        self.seconds = now - self._first
        kept = tick.replayed.level is Level.STOP
        if verdict.level is not Level.STOP:
            self._is_stopped = False
            self.new += kept
        elif not self._is_stopped:
            self._is_stopped = True
            self.stops.append(Stop(now, now, tell_why(verdict) or "no reason", 1, int(kept)))
        else:
            last = self.stops[-1]
            self.stops[-1] = last._replace(end=now, ticks=last.ticks + 1, kept=last.kept + kept)


class Watch:
    """Finds the verdict to explain.

    Args:
        text: Seconds of the monitor's clock, or a time of day; None: explain nothing.

    Attributes:
        found: The first tick at that time or after it.
        since: The tick in which its level began.
        first: Time of the first tick, in words.
        last: Time of the newest tick, in words.
    """

    def __init__(self, text: str | None) -> None:
        self.found: ReplayedTick | None = None
        self.since: ReplayedTick | None = None
        self.first = self.last = "its beginning"
        self._text = text
        self._seconds, self._of_day = (math.inf, None) if text is None else read_time(text)
        self._nanoseconds = math.inf

    def take(self, tick: ReplayedTick) -> None:
        """Take the next tick."""
        if self._text is None:
            return
        if self.since is None:
            self.first = tell_time(tick)
            if self._of_day is not None:
                self._nanoseconds = find_next(tick.nanoseconds, self._of_day)
        self.last = tell_time(tick)
        if self.since is None or self.since.recorded.level is not tick.recorded.level:
            self.since = tick
        if tick.now >= self._seconds or tick.nanoseconds >= self._nanoseconds:
            self.found = tick


def read_time(text: str) -> tuple[float, timedelta | None]:
    """Read seconds of the monitor's clock, or inf and a time of day.

    Raises:
        ArmguardError: It is neither.
    """
    of_day = re.fullmatch(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d+)?)", text)
    if of_day is not None:
        hours, minutes, seconds = of_day.groups()
        return math.inf, timedelta(hours=int(hours), minutes=int(minutes), seconds=float(seconds))
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise ArmguardError(
            "--explain",
            f"is {text!r}",
            expected="seconds of the monitor's clock, or a time of day as 14:03:12.5",
        )
    return number, None


def find_next(nanoseconds: int, of_day: timedelta) -> int:
    """The first moment after `nanoseconds` since 1970 with that local time of day."""
    start = datetime.fromtimestamp(nanoseconds * 1e-9)
    moment = datetime(start.year, start.month, start.day) + of_day
    # What was asked for without fractions means all of that second.
    if moment < start - timedelta(seconds=1):
        moment += timedelta(days=1)
    return round(moment.timestamp() * 1e9)


def tell_time(tick: ReplayedTick) -> str:
    """The time of a tick by both clocks, in words."""
    moment = datetime.fromtimestamp(tick.nanoseconds * 1e-9)
    return f"{tick.now:.3f} s ({moment.time().isoformat('milliseconds')})"


def tell_why(verdict: Verdict) -> str:
    """The cause of the level of a verdict, in words; empty if it is unknown."""
    if verdict.held is not None:
        return verdict.held.describe_cause()
    reason = find_weightiest(verdict.reasons)
    return "" if reason is None else str(reason)


def explain_tick(monitor: Monitor, watch: Watch) -> list[str]:
    """Explain a verdict in lines; the monitor must be at its tick."""
    tick, since = watch.found, watch.since
    if tick is None or since is None:
        return []
    verdict = tick.recorded
    why = tell_why(since.recorded)
    lines = [
        f"{tell_time(tick)}: {verdict.level.name}, {verdict.describe_times()}",
        f"{verdict.level.name} since {tell_time(since)}" + (f": {why}" if why else ""),
        *(f"because: {reason}" for reason in verdict.reasons),
    ]
    if not tick.is_identical:
        lines.append("the replayed verdict differs; the explanation is that of the replayed one")
    explanation = monitor.explain()
    if explanation is not None:
        lines += str(explanation).splitlines()
    for pair in monitor.pairs(PAIRS_SHOWN):
        lines.append(f"pair: {pair.link} and {pair.obstacle} in {pair.contact_time:.3f} s")
    return lines


def summarise(
    report: ReplayReport, stops: StopList, took: float, changes: dict[str, str], configuration: str
) -> dict[str, Any]:
    """The object that `--json` prints."""
    return {
        "configuration": configuration,
        "ticks": report.ticks,
        "compared": report.compared,
        "identical": report.is_identical,
        "difference": None if report.difference is None else str(report.difference),
        "lost": report.lost,
        "cut_off": report.is_cut_off,
        "differs_here": list(report.differences),
        "seconds": stops.seconds,
        "took": took,
        "what_if": changes,
        "stops": [{**stop._asdict(), "would_be": stop.kept > 0} for stop in stops.stops],
        "new_stop_ticks": stops.new,
    }


def describe_replay(
    recording: Recording, report: ReplayReport, stops: StopList, took: float
) -> list[str]:
    """Describe in lines whether the replay gave the same verdicts."""
    faster = stops.seconds / took if took > 0.0 else math.inf
    words = [
        f"{recording.path}: {report.ticks} verdicts, {len(stops.stops)} stops in "
        f"{stops.seconds:.1f} s, replayed {faster:.1f} times as fast",
        f"configuration {recording.provenance.get('configuration', 'unknown')}",
    ]
    if report.is_cut_off:
        words.append(
            "the recording has no end, since its writer was killed; it was read to its last event"
        )
    if report.lost:
        words.append(
            f"{report.lost} events were lost while it was recorded; the {report.compared} verdicts "
            "before the first gap were compared"
        )
    if report.difference is not None:
        return [*words, f"not identical: {report.difference}"]
    told = "nothing could be compared"
    if report.compared:
        told = f"bit-identical: all {report.compared} verdicts that were compared are the same"
    return [*words, told, *(f"what differs here: {line}" for line in report.differences)]


def describe_changes(stops: StopList, changes: dict[str, str]) -> list[str | Table]:
    """Describe in lines which stops the changed settings would have avoided."""
    asked = ", ".join(f"{name} = {value}" for name, value in changes.items())
    table = Table("from [s]", "to [s]", "because", "then", title=f"stops with {asked}")
    for stop in stops.stops:
        if stop.kept == 0:
            then = "no stop"
        elif stop.kept < stop.ticks:
            then = f"a stop for {100.0 * stop.kept / stop.ticks:.0f} % of the time"
        else:
            then = "a stop"
        table.add_row(f"{stop.begin:.3f}", f"{stop.end:.3f}", stop.reason, then)
    gone = sum(stop.kept == 0 for stop in stops.stops)
    return [
        table,
        f"{gone} of {len(stops.stops)} stops would have been avoided; {stops.new} ticks would be a "
        "STOP that were none. The arm moves as it was recorded, whatever the verdicts say.",
    ]


@contextlib.contextmanager
def open_table(path: Path) -> Iterator[Callable[[ReplayedTick], None]]:
    """Open a file for the table of all verdicts; yields the function that writes a row.

    Raises:
        ArmguardError: The file cannot be written.
    """
    if path == STANDARD_OUTPUT:
        yield write_rows(sys.stdout)
        return
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            yield write_rows(file)
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None


def write_rows(file: TextIO) -> Callable[[ReplayedTick], None]:
    """Write the head of a table of all verdicts; returns the function that writes a row."""
    writer = csv.writer(file)
    writer.writerow(COLUMNS)

    def take(tick: ReplayedTick) -> None:
        verdict = tick.replayed
        writer.writerow(
            (
                datetime.fromtimestamp(tick.nanoseconds * 1e-9).isoformat(),
                repr(tick.now),
                verdict.sequence,
                verdict.level.name,
                *(getattr(verdict, name) for name in _AS_THEY_ARE),
                "; ".join(map(str, verdict.reasons)),
                tick.is_identical,
            )
        )

    return take


@contextlib.contextmanager
def show_page(
    monitor: Monitor, urdf: tuple[str, list[str]], wishes: cli.Replay
) -> Iterator[Callable[[ReplayedTick], None]]:
    """Serve a page of the replayed monitor; yields the function that shows a tick.

    The page keeps the whole recording, and its user can play any part. It therefore stays after the
    last tick until Ctrl-C, except if it is only exported.
    """
    with (
        tempfile.TemporaryDirectory(prefix="armguard-") as folder,
        FramePublisher(f"ipc://{folder}/frames", is_patient=True) as publisher,
        launch(publisher.address, wishes.port, export=wishes.export) as process,
    ):
        console = make_console(stderr=True, soft_wrap=True)
        if wishes.view:
            console.print(f"see it in the browser: {process.url}")
        if wishes.open:
            webbrowser.open(process.url)
        path, folders = urdf
        origin = Origin(urdf=path, package_dirs=tuple(folders), is_recorded=True)
        feed = MonitorFeed(monitor, publisher, origin)
        durations = Durations()

        def take(tick: ReplayedTick) -> None:
            feed.observe(tick.replayed, tick.now, durations, 0, wall=1e-9 * tick.nanoseconds)

        yield take
        publisher.publish_status(StatusMessage(text="the recording ends here", is_over=True))
        if wishes.view:
            console.print("the whole recording is read; the page stays until Ctrl-C")
            with contextlib.suppress(KeyboardInterrupt):
                process.wait()
