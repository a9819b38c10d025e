"""`armguard run`, `shield`, `reset`, `view` and `keys`: cells on streams."""

from __future__ import annotations

import contextlib
import math
import re
import shlex
import socket
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from armguard.app.announcer import Announcer
from armguard.app.cell.cell import AUTO, Cell
from armguard.app.loop import Observer, RateLoop, RunOptions, run
from armguard.app.premises import describe_missing_limits, list_premises, summarise_premises
from armguard.app.processes import COMPLAINT, complain
from armguard.app.service import ServiceNotifier
from armguard.app.summary import VerdictCounts, draw_summary, summarise
from armguard.app.terminal import make_console, print_json
from armguard.exceptions import ArmguardError
from armguard.jit import Progress, Work, telling
from armguard.jit.progress import PATIENCE
from armguard.monitor.monitor import Monitor
from armguard.streams.addresses import (
    JOINTS_ADDRESS,
    VERDICTS_ADDRESS,
    check_address,
    check_free,
    is_unspecified,
)
from armguard.streams.keys import Keys, write_new_pair
from armguard.streams.nodes import Publisher, VerdictReader
from armguard.verdict import ResetVerdict, Verdict

if TYPE_CHECKING:
    from armguard.app import cli
    from armguard.app.driver_process import DriverProcess
    from armguard.app.view_feed import MonitorFeed
    from armguard.view.publisher import FramePublisher

REACH_TIMEOUT = 3.0
"""Timeout of `armguard reset` for the connection, and for the answer, in [s]."""

HOUR, DAY = 3600.0, 86_400.0
"""[s]."""

MEGABYTE = 1e6
"""[bytes]."""

PROGRESS_INTERVAL = 2.0
"""Time between two lines of progress if there is no terminal, in [s]."""


def supervise(wishes: cli.Run, *, moves: bool) -> int:
    """Supervise a cell until the end, and print the summary; returns the exit code.

    Args:
        wishes: What the command line says.
        moves: Whether a shield moves the arm.

    Raises:
        ArmguardError: The cell cannot be made, or an address cannot be used.
    """
    if not wishes.duration > 0.0:
        raise ArmguardError("--duration", f"is {wishes.duration}", expected="seconds above 0")
    cell = Cell.load(wishes.cell, wishes.arm)
    if wishes.record is not None:
        # Loaded where a recording is asked for, by no other run.
        from armguard.recording.recorder import check_new

        check_new(wishes.record)
    if wishes.drive:
        check_driver(cell, wishes)
    elif wishes.attended:
        raise ArmguardError("--attended", "is given without --drive", expected="both or neither")
    recorder_options = read_recorder_options(wishes)
    options = RunOptions(
        wishes.obstacles,
        wishes.joints,
        wishes.verdicts,
        record=wishes.record,
        recorder_options=recorder_options,
        duration=wishes.duration,
        reset_token=wishes.reset_token,
        realtime=not wishes.no_realtime,
        json_verdicts=wishes.json_verdicts,
        moves=moves,
        expect=wishes.expect,
    )
    inputs = (wishes.obstacles, wishes.joints or JOINTS_ADDRESS)
    console = make_console(stderr=True)
    with contextlib.ExitStack() as resources:
        # Mistakes are told before anything is compiled.
        authenticator = cell.make_authenticator()
        if authenticator is not None:
            resources.enter_context(authenticator)
        for address in {*(one for one in inputs if one != "-"), wishes.verdicts}:
            check_address(address, has_keys=authenticator is not None)
            check_free(address)
        publisher: FramePublisher | None = None
        if wishes.view is not None:
            # What feeds a view is loaded where there is an address for one.
            from armguard.view.publisher import FramePublisher

            publisher = resources.enter_context(FramePublisher(wishes.view, authenticator))
        # Its thread starts before real-time scheduling is asked for.
        announcer = resources.enter_context(Announcer(quiet=wishes.quiet))
        observer = _Observer(cell, publisher, announcer, wishes.record)
        driver: DriverProcess | None = None
        if wishes.drive:
            from armguard.app.driver_process import DriverProcess

            driver = resources.enter_context(
                DriverProcess(
                    wishes.cell,
                    cell.arm,
                    announcer.tell,
                    cell.find_driver().stop_within,
                    is_attended=wishes.attended,
                )
            )
        # Its thread as well.
        resources.enter_context(ServiceNotifier.from_environment(lambda: observer.ticks))

        def tell_addresses(addresses: Mapping[str, str]) -> None:
            if driver is not None:
                driver.start(addresses)
            has_keys = authenticator is not None
            announcer.remedy = describe_remedy(
                addresses, wishes.reset_token, has_keys=has_keys, arm=cell.arm
            )
            observer.begin(addresses, obeys_reset=wishes.reset_token is not None)
            if wishes.quiet:
                return
            views = {} if publisher is None else {"view": publisher.address}
            for name, address in {**addresses, **views}.items():
                announcer.tell(f"{name} at {'standard input' if address == '-' else address}")
            told = [summarise_premises()]
            if wishes.premises:
                told = list_premises(observer.monitor, cell.drawn_links)
            for line in told:
                announcer.tell(line)

        def tell_prepared(monitor: Monitor, configuration: str) -> None:
            waiting.stop()
            observer.monitor, observer.configuration = monitor, configuration
            if not wishes.quiet:
                announcer.tell(f"configuration {configuration}")
            if monitor.choice is not None and not wishes.quiet:
                for line in monitor.choice.summary:
                    announcer.tell(f"settings chosen: {line}")
            missing = describe_missing_limits(monitor)
            if missing is not None and not wishes.quiet:
                announcer.tell(missing)

        is_auto = cell.tables.settings == AUTO
        waiting = console.status("choosing settings by a trial" if is_auto else "starting")
        next_line = PATIENCE

        def tell_progress(progress: Progress | Work | None) -> None:
            nonlocal next_line
            if progress is None:
                return
            text = (
                f"{progress} (once; kept for the next start)" if progress.is_kept else f"{progress}"
            )
            if publisher is not None:
                from armguard.view.messages import StatusMessage

                publisher.publish_status(StatusMessage(text=text))
            if console.is_terminal:
                waiting.update(text)
            elif progress.duration >= next_line:
                next_line = progress.duration + PROGRESS_INTERVAL
                announcer.tell(text)

        with waiting, telling(tell_progress):
            report = run(
                cell,
                options,
                authenticator=authenticator,
                observer=observer,
                prepared=tell_prepared,
                listening=tell_addresses,
                tell=announcer.tell,
            )
    summary = summarise(report, observer.counts)
    if wishes.json:
        print_json(lambda: summary)
    else:
        make_console().print(draw_summary(summary))
    return 0


def check_driver(cell: Cell, wishes: cli.Run) -> None:
    """Raise ArmguardError unless a run can start the driver of its cell."""
    cell.find_driver()
    if cell.tables.keys is not None or wishes.joints == "-":
        why = "the cell has keys" if cell.tables.keys is not None else "joint states are read here"
        raise ArmguardError(
            "--drive",
            f"cannot be used: {why}",
            remedy="start `armguard drive` by itself; it takes --key and --server-key",
        )


def read_recorder_options(wishes: cli.Run) -> dict[str, Any]:
    """Options of the recording on the command line, as keywords of `Recorder`.

    Raises:
        ArmguardError: There is an option but no recording, or the key cannot be used.
    """
    amounts = {
        "--part-hours": wishes.part_hours,
        "--part-megabytes": wishes.part_megabytes,
        "--keep-days": wishes.keep_days,
    }
    if wishes.record is None:
        others = {"--sign": wishes.sign, "--proof-interval": wishes.proof_interval}
        for name, told in {**others, **amounts}.items():
            if told is not None:
                raise ArmguardError(name, "is for recordings", expected="--record beside it")
        return {}
    from armguard.recording.parts import Rotation
    from armguard.recording.signing import FileSigner

    for name, value in amounts.items():
        if value is not None and not 0.0 < value < math.inf:
            raise ArmguardError(name, f"is {value}", expected="a number above 0")
    if wishes.sign is not None:
        FileSigner(wishes.sign)
    rotation = Rotation(
        duration=wishes.part_hours and wishes.part_hours * HOUR,
        size=wishes.part_megabytes and wishes.part_megabytes * MEGABYTE,
        keep=wishes.keep_days and wishes.keep_days * DAY,
    )
    options = {"key": wishes.sign, "rotation": rotation}
    if wishes.proof_interval is None:
        return options
    if not wishes.proof_interval >= 0.0:
        expected = "seconds of at least 0, or inf"
        raise ArmguardError("--proof-interval", f"is {wishes.proof_interval}", expected=expected)
    return options | {"proof_interval": wishes.proof_interval}


def find_reset_address(addresses: Mapping[str, str]) -> str:
    """The address to send a reset to; empty if only standard input reads messages.

    Args:
        addresses: Addresses of "joints" and "obstacles"; "-" is standard input.
    """
    sockets = [one for one in (addresses["joints"], addresses["obstacles"]) if one != "-"]
    return sockets[0] if sockets else ""


def describe_remedy(
    addresses: Mapping[str, str],
    reset_token: str | None,
    *,
    has_keys: bool = False,
    arm: str = "",
) -> str:
    """The command that ends a latched STOP, to be copied.

    Args:
        addresses: Addresses of "joints", "obstacles" and "verdicts"; "-" is standard input.
        reset_token: The token that a reset must carry; None: resets are refused.
        has_keys: Whether the monitor requires keys.
        arm: Name of the watched arm; empty in a cell with one arm.
    """
    address = find_reset_address(addresses)
    token = "TOKEN" if reset_token is None else reset_token
    if address:
        address, verdicts = _name_host(address), _name_host(addresses["verdicts"])
        answered = [] if verdicts == find_verdicts_address(address) else ["--verdicts", verdicts]
        key_files = ["--key", "FILE", "--server-key", "FILE"] if has_keys else []
        named = ["--arm", arm] if arm else []
        way = shlex.join(
            ["armguard", "reset", address, "--token", token, *answered, *named, *key_files]
        )
    else:
        fields = {"type": "reset", "token": token} | ({"arm": arm} if arm else {})
        line = msgspec.json.encode(fields)
        way = f"a line {line.decode()}"
    if reset_token is not None:
        return f"to end it: {way}"
    return f"this run refuses resets: restart it; with --reset-token TOKEN this ends it: {way}"


def _name_host(address: str) -> str:
    """The address with this machine's host name, if it is bound to all interfaces."""
    if not is_unspecified(address):
        return address
    return f"tcp://{socket.gethostname()}:{address.rsplit(':', 1)[1]}"


def find_verdicts_address(address: str) -> str:
    """The default address of a monitor's verdicts: the default port of the same host.

    Args:
        address: Address at which the monitor reads obstacles or joint states.
    """
    host, _, port = address.rpartition(":")
    usual = VERDICTS_ADDRESS.rpartition(":")[2]
    return f"{host}:{usual}" if port.isdigit() else VERDICTS_ADDRESS


def read_key_files(own: Path | None, server: Path | None) -> tuple[Path, Path] | None:
    """The two key files on a command line; None if neither is given.

    Raises:
        ArmguardError: One of the two is missing.
    """
    if own is None and server is None:
        return None
    if own is None or server is None:
        missing = "--key" if own is None else "--server-key"
        raise ArmguardError(missing, "is missing: a monitor with keys needs both files")
    return own, server


def make_keys(name: str, folder: Path) -> int:
    """Make a key pair, write it, and print how to use it; returns the exit code.

    Args:
        name: Name of the client, or of the monitor.
        folder: Folder of the two files.

    Raises:
        KeyFileError: A file is there already, or cannot be written.
    """
    secret, public, key = write_new_pair(name, folder)
    table = name if re.fullmatch(r"[\w-]+", name) else f'"{name}"'
    make_console().print(
        f"{secret}: secret key; keep it with {name}, readable by its owner only\n"
        f"{public}: public key; copy it to all processes that connect to {name}\n"
        "For a client, add to the cell file, with its rights (obstacles, joints, verdicts, reset, "
        f"view):\n\n[keys.clients.{table}]\n"
        f'public = "{key}"\nmay = ["obstacles"]\n\n'
        "For the monitor itself, with the path relative to the cell file:\n\n"
        f'[keys]\nsecret = "{secret.name}"',
        soft_wrap=True,
    )
    return 0


def make_signing_keys(name: str, folder: Path) -> int:
    """Make a key pair that signs recordings, and print how to use it; returns the exit code.

    Args:
        name: Name of the machine or person that records.
        folder: Folder of the two files.

    Raises:
        ArmguardError: A file is there already, or cannot be written, or the package for signatures
            is missing.
    """
    from armguard.recording.signing import write_signing_pair

    secret, public, key = write_signing_pair(name, folder)
    make_console().print(
        f"{secret}: secret key; keep it on the machine that records, readable by its owner only\n"
        f"{public}: public key, which verifies the recordings; keep a copy on another machine\n"
        f"public key: {key}\n\n"
        f"armguard run CELL --record FOLDER --sign {shlex.quote(str(secret))}\n"
        f"armguard replay FILE --verify --key {shlex.quote(str(public))}",
        soft_wrap=True,
    )
    return 0


def send_reset(wishes: cli.Reset) -> int:
    """Send a reset and print the monitor's answer; returns the exit code, 1 if it was refused.

    Args:
        wishes: What the command line says.

    Raises:
        StreamError: An address or a key cannot be used.
    """
    address, key_files = wishes.address, read_key_files(wishes.key, wishes.server_key)
    keys = None if key_files is None else Keys.load(*key_files)
    with (
        Publisher(address, keys=keys) as publisher,
        VerdictReader(wishes.verdicts or find_verdicts_address(address), keys) as reader,
    ):
        verdict = _ask_reset(publisher, reader, wishes.token, wishes.arm)
    print_json(lambda: verdict._asdict() | {"address": address})
    if not verdict.obeyed:
        complain(f"{address}: not reset: {verdict.problem}")
        return COMPLAINT
    make_console().print(f"{address}: reset", soft_wrap=True)
    return 0


def _ask_reset(publisher: Publisher, reader: VerdictReader, token: str, arm: str) -> ResetVerdict:
    """Send a reset and wait for the answer; without an answer, `problem` says why."""
    rights = (
        "with [keys] in its cell file, it accepts only clients that may `reset`, which give --key "
        "and --server-key"
    )
    if not publisher.wait(REACH_TIMEOUT):
        return ResetVerdict(
            False,
            f"no monitor listens there (waited {REACH_TIMEOUT:g} s). `armguard run` prints its "
            f"addresses of obstacles and joint states; {rights}",
        )
    # A reader hears what is published once it is connected, as the first verdict shows.
    if reader.latest(REACH_TIMEOUT) is None:
        return ResetVerdict(
            False,
            f"no reset was sent, since its answer could not be read: no verdicts come from "
            f"{reader.address} (waited {REACH_TIMEOUT:g} s). --verdicts takes the address that "
            f"`armguard run` prints; {rights}",
        )
    number = publisher.reset(token, arm)
    verdict = reader.reset_answer(number, REACH_TIMEOUT)
    return verdict or ResetVerdict(
        False,
        f"the monitor at {reader.address} did not answer (waited {REACH_TIMEOUT:g} s): it "
        f"watches another arm, or is too busy; {rights}",
    )


def show(wishes: cli.View) -> int:
    """Serve the page of a running monitor until Ctrl-C; returns the exit code.

    Args:
        wishes: What the command line says.
    """
    # It brings a web server along, which no monitor needs.
    from armguard.view.process import launch

    key_files = read_key_files(wishes.key, wishes.server_key)
    with (
        contextlib.suppress(KeyboardInterrupt),
        launch(
            wishes.address, wishes.port, floor=wishes.floor, host=wishes.host, key_files=key_files
        ) as page,
    ):
        make_console().print(f"see it in the browser: {page.url}", soft_wrap=True)
        if wishes.open:
            webbrowser.open(page.url)
        page.wait()
        complain("the process of the view has ended")
        return COMPLAINT
    return 0


class _Observer(Observer):
    """Counts and announces every verdict, and sends frames to views if they have an address."""

    def __init__(
        self,
        cell: Cell,
        publisher: FramePublisher | None,
        announcer: Announcer,
        record: Path | None,
    ) -> None:
        self.counts = VerdictCounts()
        self.ticks = 0
        self._announcer = announcer
        self._cell = cell
        self._publisher = publisher
        self._recording = "" if record is None else str(record.absolute())
        self._feed: MonitorFeed | None = None
        self.monitor: Monitor | None = None
        """The monitor of the run, after it was made."""
        self.configuration = ""
        """Digest of its configuration."""

    def begin(self, addresses: Mapping[str, str], *, obeys_reset: bool) -> None:
        """Send the scene of the cell to the views, before the first tick.

        Args:
            addresses: Addresses of "joints" and "obstacles".
            obeys_reset: Whether a reset with its token is obeyed.
        """
        if self._publisher is None or self.monitor is None:
            return
        from armguard.app.view_feed import MonitorFeed
        from armguard.view.messages import Origin

        urdf, package_dirs = self._cell.urdf
        origin = Origin(
            urdf=urdf,
            package_dirs=tuple(package_dirs),
            reset_address=find_reset_address(addresses),
            obeys_reset=obeys_reset,
            arm=self._cell.arm,
            recording=self._recording,
            configuration=self.configuration,
        )
        self._feed = MonitorFeed(self.monitor, self._publisher, origin)

    def observe(self, loop: RateLoop, verdict: Verdict) -> None:
        """Called after each verdict was published."""
        self.ticks += 1
        self.counts.count(verdict)
        self._announcer.observe(loop.clock.now(), verdict)
        if self._feed is not None:
            self._feed.note(verdict, loop.clock.now(), loop.stepper.command)
            # A loop that never rests is not to vanish from the page.
            self.rest(loop, 0.0)

    def rest(self, loop: RateLoop, idle: float) -> None:
        """Called between two ticks with the idle time in [s]."""
        if self._feed is not None:
            self._feed.publish(
                loop.clock.now(),
                loop.durations,
                loop.late,
                resets=loop.resets,
                idle=idle,
                shield=loop.stepper.shield,
            )
