"""`armguard run`, `reset` and `view`: a cell supervised from streams, its reset and its view."""

from __future__ import annotations

import contextlib
import shlex
import sys
import time
import webbrowser
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console

from armguard.app.announcer import Announcer
from armguard.app.cell.cell import Cell
from armguard.app.loop import RateLoop, run
from armguard.app.processes import COMPLAINT, complain
from armguard.app.service import ServiceNotifier
from armguard.app.summary import VerdictCounts, draw_summary, summarise
from armguard.app.view_feed import MonitorFeed
from armguard.bounds.braking import BrakingMotion
from armguard.exceptions import ArmguardError, StreamError
from armguard.jit import Progress, telling
from armguard.monitor.monitor import Monitor
from armguard.recording.recorder import check_new
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.streams.addresses import (
    JOINTS_ADDRESS,
    OBSTACLES_ADDRESS,
    VERDICTS_ADDRESS,
    check_address,
    check_free,
)
from armguard.streams.nodes import Publisher
from armguard.verdict import Verdict
from armguard.view.process import launch
from armguard.view.publisher import FramePublisher

REACH_TIMEOUT = 3.0
"""How long `armguard reset` waits for the monitor to answer, in [s]."""

PROGRESS_INTERVAL = 2.0
"""Between two lines about the compilation of kernels where there is no terminal, in [s]."""

PAGE_CHECK_INTERVAL = 0.25
"""Between two checks that the page is still served, in [s]."""


def supervise(
    cell_file: Path,
    *,
    obstacles_address: str | None,
    joints_address: str | None,
    verdicts_address: str | None,
    view_address: str | None,
    reset_token: str | None,
    record: Path | None,
    realtime: bool,
    duration: float,
    as_json: bool,
    quiet: bool = False,
) -> int:
    """Supervise a cell until the end, and print the summary.

    Args:
        cell_file: The cell.
        obstacles_address: Bound for obstacles; None: the default; "-": standard input.
        joints_address: Bound for joint states; None: the default, or standard input.
        verdicts_address: Bound for verdicts; None: the default.
        view_address: Bound for views; None: no feed.
        reset_token: What a reset message must carry; None: none is obeyed.
        record: Where to write a recording; None: nowhere.
        realtime: Whether to ask the system for real-time scheduling and locked memory.
        duration: How long, in [s].
        as_json: Print one JSON object instead of a table.
        quiet: Tell neither addresses nor changes of level on standard error.

    Returns:
        The exit code.

    Raises:
        ArmguardError: The cell cannot be made, or an address cannot be used.
    """
    if not duration > 0.0:
        raise ArmguardError("--duration", f"is {duration}", expected="seconds above 0")
    cell = Cell.load(cell_file)
    if record is not None:
        check_new(record)
    obstacles_address = obstacles_address or OBSTACLES_ADDRESS
    verdicts_address = verdicts_address or VERDICTS_ADDRESS
    inputs = (obstacles_address, joints_address or JOINTS_ADDRESS)
    # Mistakes are told before anything is compiled.
    for address in {*(one for one in inputs if one != "-"), verdicts_address}:
        check_address(address)
        check_free(address)
    console = Console(stderr=True)
    with contextlib.ExitStack() as resources:
        publisher = None
        if view_address is not None:
            publisher = resources.enter_context(FramePublisher(view_address))
        # Its thread starts before real-time scheduling is asked for.
        announcer = resources.enter_context(Announcer(quiet=quiet))
        observer = _Observer(cell, publisher, announcer)
        # Its thread as well.
        resources.enter_context(ServiceNotifier.from_environment(lambda: observer.ticks))

        def tell_addresses(addresses: Mapping[str, str]) -> None:
            announcer.remedy = describe_remedy(addresses, reset_token)
            if quiet:
                return
            views = {} if publisher is None else {"view": publisher.address}
            for name, address in {**addresses, **views}.items():
                announcer.tell(f"{name} at {'standard input' if address == '-' else address}")

        def tell_prepared(monitor: Monitor) -> None:
            waiting.stop()
            missing = describe_missing_limits(monitor)
            if missing is not None and not quiet:
                announcer.tell(missing)

        waiting = console.status("starting")
        next_line = 0.0

        def tell_progress(progress: Progress | None) -> None:
            nonlocal next_line
            if progress is None:
                return
            text = f"{progress} (once; kept for the next start)"
            if console.is_terminal:
                waiting.update(text)
            elif progress.duration >= next_line:
                next_line = progress.duration + PROGRESS_INTERVAL
                announcer.tell(text)

        with waiting, telling(tell_progress):
            report = run(
                cell,
                obstacles_address,
                joints_address,
                verdicts_address,
                duration=duration,
                record=record,
                reset_token=reset_token,
                realtime=realtime,
                observe=observer.observe,
                prepared=tell_prepared,
                listening=tell_addresses,
                tell=announcer.tell,
            )
    summary = summarise(report, observer.counts)
    if as_json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
    else:
        Console().print(draw_summary(summary))
    return 0


def describe_missing_limits(monitor: Monitor) -> str | None:
    """What it costs to state no operating limits; None where some are stated, or none published.

    Args:
        monitor: Of the run.
    """
    robot, settings = monitor.robot, monitor.settings
    if settings.operating is not None or robot.published_operating_limits is None:
        return None
    still = np.zeros(len(robot.joints))
    q = np.clip(still, robot.lower_position_limit, robot.upper_position_limit)
    without, published = (
        BrakingMotion(
            robot,
            settings.reaction_time,
            operating=LimitsInForce(robot, operating, settings.payload),
        ).stop_time(q, still, 0.0, settings.response_time)
        for operating in (None, OperatingLimits.published(robot))
    )
    return (
        f"no operating limits are stated, so {robot.name} may do all that its hardware can until "
        f"its brakes bite: at rest it counts on {1e3 * without:.0f} ms to stand, with the "
        f'published ones on {1e3 * published:.0f} ms (operating = "published" in [robot], if its '
        "controller keeps to them)"
    )


def describe_remedy(addresses: Mapping[str, str], reset_token: str | None) -> str:
    """What ends a latched STOP, as a command that can be copied.

    Args:
        addresses: Of "joints" and "obstacles"; "-" is standard input.
        reset_token: What a reset must carry; None: none is obeyed.
    """
    sockets = [one for one in (addresses["joints"], addresses["obstacles"]) if one != "-"]
    token = "TOKEN" if reset_token is None else reset_token
    if sockets:
        way = shlex.join(["armguard", "reset", sockets[0], "--token", token])
    else:
        way = f"a line {msgspec.json.encode({'type': 'reset', 'token': token}).decode()}"
    if reset_token is not None:
        return f"to end it: {way}"
    return f"this run obeys no reset: start it anew; with --reset-token TOKEN this ends it: {way}"


def send_reset(address: str, token: str) -> int:
    """Send a reset to a running monitor; the exit code.

    Args:
        address: Where it takes obstacles or joint states.
        token: What its run was started with.

    Raises:
        StreamError: The address cannot be used, or no monitor listens there.
    """
    with Publisher(address) as publisher:
        if not publisher.wait(REACH_TIMEOUT):
            raise StreamError(
                address,
                f"no monitor listens there (waited {REACH_TIMEOUT:g} s)",
                expected="an address of obstacles or joint states",
                remedy="`armguard run` prints both",
            )
        publisher.reset(token)
    Console().print(
        f"reset sent to {address}; the monitor tells whether it obeys", soft_wrap=True, markup=False
    )
    return 0


def show(address: str, port: int, *, open_browser: bool) -> int:
    """Serve the page of a running monitor until Ctrl-C; the exit code.

    Args:
        address: Of the monitor's feed.
        port: TCP port of the page; 0: any that is free.
        open_browser: Open the page.
    """
    with contextlib.suppress(KeyboardInterrupt), launch(address, port) as page:
        Console().print(f"see it in the browser: {page.url}", soft_wrap=True)
        if open_browser:
            webbrowser.open(page.url)
        while page.running:
            time.sleep(PAGE_CHECK_INTERVAL)
        complain("the view has ended by itself")
        return COMPLAINT
    return 0


class _Observer:
    """Counts and announces every verdict, and feeds the views if there is an address for them."""

    def __init__(self, cell: Cell, publisher: FramePublisher | None, announcer: Announcer) -> None:
        self.counts = VerdictCounts()
        self.ticks = 0
        self._announcer = announcer
        self._cell = cell
        self._publisher = publisher
        self._feed: MonitorFeed | None = None

    def observe(self, loop: RateLoop, verdict: Verdict) -> None:
        """Called after each verdict was published."""
        self.ticks += 1
        self.counts.count(verdict)
        self._announcer.observe(loop.clock.now(), verdict)
        if self._publisher is None:
            return
        if self._feed is None:
            urdf, package_dirs = self._cell.urdf
            self._feed = MonitorFeed(
                loop.monitor, self._publisher, urdf=urdf, package_dirs=package_dirs
            )
        self._feed.observe(verdict, loop.clock.now(), loop.durations, loop.late)
