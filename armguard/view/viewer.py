"""The loop of a view's process: receives the feed, draws the newest moment, serves the page."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
import time
from pathlib import Path

import zmq
import zmq.asyncio
from zmq.utils.monitor import recv_monitor_message

from armguard.exceptions import ArmguardError
from armguard.streams.addresses import find_reachable
from armguard.streams.keys import present
from armguard.streams.nodes import Publisher
from armguard.view import drawing
from armguard.view.drawing import Command
from armguard.view.export import write_export
from armguard.view.latest_values import LatestValues
from armguard.view.messages import (
    FeedVersionError,
    FrameMessage,
    Latch,
    SceneMessage,
    StatusMessage,
    decode_message,
)
from armguard.view.page_state import PageState
from armguard.view.picture import ROOT, Picture
from armguard.view.process import WatchOptions
from armguard.view.server import ViewServer

PARENT_CHECK_INTERVAL = 0.25
COMPLAINT_INTERVAL = 1.0
NEWS_INTERVAL = 0.5
"""Time between two messages of news while no frames arrive, in [s]."""
REACH_TIMEOUT = 2.0
"""How long a reset waits for the connection to the monitor, in [s]; short, as a user waits."""
ANSWER_TIMEOUT = 5.0
"""How long a reset waits for the monitor's answer, in [s]."""
REACH_INTERVAL = 0.02
"""Time between two checks that the monitor is connected, in [s]."""
REST_TIMEOUT = 2000
"""Timeout for the next message of a recording at its end, in [ms]."""
QUEUE_LIMIT = 64
_logger = logging.getLogger("armguard.view")


class Watch:
    """Draws the messages of a feed.

    Args:
        options: Address of the feed, and how to serve the page. With an export, the whole past is
            kept.

    Raises:
        ArmguardError: The address is malformed, the port in use, or a key file unusable.
    """

    def __init__(self, options: WatchOptions) -> None:
        self._address = address = options.address
        self._keys = options.load_keys()
        self._keeps_all = options.export is not None
        self._context = zmq.asyncio.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.set(zmq.RCVHWM, 4)
        self._socket.set(zmq.MAXMSGSIZE, 64_000_000)
        self._socket.set(zmq.SUBSCRIBE, b"")
        if self._keys is not None:
            present(self._socket, self._keys)
        self._connection = self._socket.get_monitor_socket(
            zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED
        )
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise ArmguardError(
                f"view feed {address!r}",
                f"cannot be used: {error.strerror}",
                expected='an address such as "tcp://127.0.0.1:5555"',
            ) from error
        self._values = LatestValues()
        self._page_state = PageState(address)
        self._page_state.film.clear(is_recording=self._keeps_all)
        try:
            self._server = ViewServer(
                self._values,
                self._page_state,
                self._draw_past,
                self._send_reset,
                options.port,
                options.host,
            )
        except ArmguardError:
            self._context.destroy(linger=0)
            raise
        self._picture = Picture(self._values.set, self._forget, options.floor)
        self._resets: tuple[int, int] | None = None
        """Resets that the monitor obeyed and refused, by its newest frame; None without a frame."""
        self._latches: frozenset[Latch] = frozenset()
        """Latched reasons in that frame."""
        self._runs = 0
        """How often another run may have begun: with a new scene, or while the feed was
        disconnected."""
        self._is_resetting = False
        self._has_told = asyncio.Event()
        """Whether a frame has arrived since this flag was cleared."""
        self._is_recorded: bool | None = None
        """Scene of the feed; None: none has arrived."""
        self._complained = -COMPLAINT_INTERVAL
        self._complaints = 0
        self.url = self._server.url

    async def run(self) -> None:
        """Draw until cancelled."""
        tasks = [asyncio.create_task(task()) for task in (self._follow, self._tell_news)]
        try:
            await self._draw()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def export(self, path: Path) -> None:
        """Write the stored past as one file that plays offline.

        Raises:
            ArmguardError: There is nothing to write, or the file cannot be written.
        """
        self._page_state.film.settle()
        write_export(path, self._values.payloads, self._page_state, self._draw_past)

    def close(self) -> None:
        """Free the port and the feed."""
        self._server.close()
        self._socket.disable_monitor()
        self._context.destroy(linger=0)

    async def read_rest(self) -> None:
        """Read a recording to its end, or until no message arrives for a while."""
        while self._is_recorded is not False and not self._page_state.is_over:
            if not await self._socket.poll(REST_TIMEOUT):
                return
            self._draw_newest(await self._receive())

    async def _draw(self) -> None:
        while True:
            self._draw_newest(await self._receive())

    async def _receive(self) -> list[bytes]:
        """The next message and all that are queued: only the newest moment is drawn."""
        payloads = [await self._socket.recv()]
        while len(payloads) < QUEUE_LIMIT and await self._socket.poll(0):
            payloads.append(await self._socket.recv())
        return payloads

    async def _follow(self) -> None:
        """Note when the monitor connects and disconnects."""
        while True:
            event = await recv_monitor_message(self._connection)
            self._page_state.is_connected = event["event"] != zmq.EVENT_DISCONNECTED
            if not self._page_state.is_connected:
                self._forget_run()

    def _forget_run(self) -> None:
        """Drop the numbers of resets and latches of a run, since another run may have begun."""
        self._runs += 1
        self._resets, self._latches = None, frozenset()
        self._has_told.set()

    async def _tell_news(self) -> None:
        while True:
            await asyncio.sleep(NEWS_INTERVAL)
            self._server.tell()

    def _draw_newest(self, payloads: list[bytes]) -> None:
        frame: FrameMessage | None = None
        for payload in payloads:
            try:
                message = decode_message(payload)
            except ArmguardError as error:
                if isinstance(error, FeedVersionError):
                    self._page_state.problem = str(error)
                self._complain(str(error))
                continue
            if isinstance(message, SceneMessage):
                self._draw_scene(message)
            elif isinstance(message, StatusMessage):
                self._page_state.status, self._page_state.is_over = message.text, message.is_over
                if message.is_over:
                    self._page_state.film.settle()
            else:
                frame = message
                self._page_state.is_over = False
                self._page_state.film.add(message, payload)
        if frame is None:
            return
        self._resets = frame.obeyed_resets, frame.refused_resets
        self._latches = frozenset(frame.latches)
        self._has_told.set()
        self._page_state.note_frame()
        try:
            self._picture.draw_frame(frame, with_volume=self._server.wants_volume)
        except Exception as error:  # one bad picture must not end the view
            self._complain(f"{type(error).__name__}: {error}")
            return
        self._server.flush()

    def _draw_scene(self, scene: SceneMessage) -> None:
        self._is_recorded = scene.is_recorded
        try:
            is_new = self._picture.draw_scene(scene)
        except Exception as error:  # alike
            self._complain(f"{type(error).__name__}: {error}")
            return
        if is_new:
            self._forget_run()
            # What is past was of another scene, and cannot be drawn in this one.
            self._page_state.film.clear(is_recording=scene.is_recorded or self._keeps_all)

    def _draw_past(self, number: int, with_volume: bool) -> list[Command] | None:
        moment = self._page_state.film.find(number)
        if moment is None:
            return None
        frame = decode_message(moment.payload)
        assert isinstance(frame, FrameMessage), "a film has frames"
        try:
            return list(self._picture.compute_frame(frame, with_volume=with_volume))
        except Exception as error:  # alike
            self._complain(f"{type(error).__name__}: {error}")
            return None

    async def _send_reset(self, token: str) -> str:
        scene = self._picture.scene
        if scene is None or self._resets is None:
            return "not sent: there is no monitor to reset"
        if self._is_resetting:
            return "not sent: the reset before this one is still under way"
        if not scene.obeys_reset:
            return "this run refuses resets: start it with --reset-token TOKEN"
        if not scene.reset_address:
            return "this run reads resets only from its standard input"
        address = find_reachable(scene.reset_address, self._address)
        if not address:
            return f"this run takes a reset on its own machine alone, at {scene.reset_address}"
        self._is_resetting = True
        try:
            with Publisher(address, keys=self._keys) as publisher:
                return await self._publish_reset(publisher, address, token, scene.arm)
        except ArmguardError as error:
            return f"not sent: {error}"
        finally:
            self._is_resetting = False

    async def _publish_reset(self, publisher: Publisher, address: str, token: str, arm: str) -> str:
        """Send a reset after the monitor is connected; returns its result in words.

        The page goes on meanwhile. A reset that waited is not sent to another run, and not if more
        is latched than at the click: it might release a STOP that no operator has seen.

        The reset is sent once: a second one might release a STOP that was latched after the first,
        and that no operator has seen. The publisher stays open until the answer, because closing it
        could lose the message.
        """
        run, latches = self._runs, self._latches
        end = time.monotonic() + REACH_TIMEOUT
        while not publisher.wait(0.0):
            if time.monotonic() >= end:
                return f"not sent: no monitor listens at {address}, or this client may not reset"
            await asyncio.sleep(REACH_INTERVAL)
        before = self._resets
        if before is None or self._runs != run:
            return "not sent: another run has begun since; look at it and ask again"
        if not self._latches <= latches:
            return "not sent: something else has latched since; look at it and ask again"
        publisher.reset(token, arm)
        end = time.monotonic() + ANSWER_TIMEOUT
        while (left := end - time.monotonic()) > 0.0:
            if self._runs != run:
                return "sent, and another run has begun since: it may not have arrived"
            obeyed, refused = self._resets or before
            if obeyed > before[0]:
                return "obeyed; a cause that persists has latched again"
            if refused > before[1]:
                return "refused: the token is not that of this run"
            self._has_told.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._has_told.wait(), left)
        return (
            f"sent, and the monitor did not answer in {ANSWER_TIMEOUT:g} s: it may not have "
            "arrived; reset again if the STOP is still latched"
        )

    def _forget(self) -> None:
        self._values.clear(drawing.delete(ROOT))

    def _complain(self, problem: str) -> None:
        """Log why a message could not be used, at most once a second."""
        self._complaints += 1
        now = time.monotonic()
        if now - self._complained >= COMPLAINT_INTERVAL:
            self._complained = now
            _logger.warning("feed: %s (%d so far)", problem, self._complaints)


async def watch(options: WatchOptions) -> None:
    """Run a view until a signal, or until its parent has ended."""
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    view = Watch(options)
    sys.stdout.write(f"armguard view of {options.address}: {view.url}\n")
    sys.stdout.flush()
    drawing_task = asyncio.create_task(view.run())
    drawing_task.add_done_callback(lambda _: ended.set())
    try:
        while not ended.is_set() and options.parent in (None, os.getppid()):
            try:
                await asyncio.wait_for(ended.wait(), PARENT_CHECK_INTERVAL)
            except TimeoutError:
                continue
        if drawing_task.done():
            drawing_task.result()
    finally:
        drawing_task.cancel()
        await asyncio.gather(drawing_task, return_exceptions=True)
        try:
            if options.export is not None:
                await view.read_rest()
                view.export(Path(options.export))
        finally:
            view.close()
