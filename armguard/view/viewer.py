"""The life of a view process: takes the feed, draws the newest moment, serves it, ends in time."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import time

import zmq
import zmq.asyncio

from armguard.exceptions import ArmguardError
from armguard.streams.keys import Keys, present
from armguard.view import drawing
from armguard.view.latest import LatestValues
from armguard.view.listening import LOOPBACK
from armguard.view.messages import FrameMessage, SceneMessage, decode_message
from armguard.view.picture import ROOT, Picture
from armguard.view.server import ViewServer

PARENT_CHECK_INTERVAL = 0.25
COMPLAINT_INTERVAL = 1.0
QUEUE_LIMIT = 64
_logger = logging.getLogger("armguard.view")


class Watch:
    """Draws what a feed says.

    Args:
        address: Of the feed.
        port: TCP port of the page; 0: any that is free.
        host: Address of the interface on which the page is served.
        keys: Of a client that may view; None: the monitor asks for none.

    Raises:
        ArmguardError: The address is malformed, or the port in use.
    """

    def __init__(
        self, address: str, port: int = 0, host: str = LOOPBACK, keys: Keys | None = None
    ) -> None:
        self._context = zmq.asyncio.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.set(zmq.RCVHWM, 4)
        self._socket.set(zmq.MAXMSGSIZE, 64_000_000)
        self._socket.set(zmq.SUBSCRIBE, b"")
        if keys is not None:
            present(self._socket, keys)
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
        try:
            self._server = ViewServer(self._values, address, port, host)
        except ArmguardError:
            self._context.destroy(linger=0)
            raise
        self._picture = Picture(self._values.set, self._forget)
        self._complained = -COMPLAINT_INTERVAL
        self._complaints = 0
        self.url = self._server.url

    async def run(self) -> None:
        """Draw until cancelled."""
        while True:
            payloads = [await self._socket.recv()]
            # Only the newest moment counts; what waited behind it is past.
            while len(payloads) < QUEUE_LIMIT and await self._socket.poll(0):
                payloads.append(await self._socket.recv())
            self._draw_newest(payloads)

    def close(self) -> None:
        """Free the port and the feed."""
        self._server.close()
        self._context.destroy(linger=0)

    def _draw_newest(self, payloads: list[bytes]) -> None:
        scene: SceneMessage | None = None
        frame: FrameMessage | None = None
        for payload in payloads:
            try:
                message = decode_message(payload)
            except ArmguardError as error:
                self._complain(str(error))
                continue
            if isinstance(message, SceneMessage):
                scene = message
            else:
                frame = message
        try:
            if scene is not None:
                self._picture.draw_scene(scene)
            if frame is not None:
                self._picture.draw_frame(frame)
        except Exception as error:  # one bad picture must not end the view
            self._complain(f"{type(error).__name__}: {error}")
            return
        if frame is not None:
            self._server.flush()

    def _forget(self) -> None:
        self._values.clear(drawing.delete(ROOT))

    def _complain(self, problem: str) -> None:
        """Say what was wrong with a message, at most once a second."""
        self._complaints += 1
        now = time.monotonic()
        if now - self._complained >= COMPLAINT_INTERVAL:
            self._complained = now
            _logger.warning("feed: %s (%d so far)", problem, self._complaints)


async def watch(
    address: str,
    port: int = 0,
    parent: int | None = None,
    host: str = LOOPBACK,
    keys: Keys | None = None,
) -> None:
    """Run a view until a signal, or until the process `parent` is no longer this one's parent."""
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    view = Watch(address, port, host, keys)
    sys.stdout.write(f"armguard view of {address}: {view.url}\n")
    sys.stdout.flush()
    drawing_task = asyncio.create_task(view.run())
    drawing_task.add_done_callback(lambda _: ended.set())
    try:
        while not ended.is_set() and parent in (None, os.getppid()):
            try:
                await asyncio.wait_for(ended.wait(), PARENT_CHECK_INTERVAL)
            except TimeoutError:
                continue
        if drawing_task.done():
            drawing_task.result()
    finally:
        drawing_task.cancel()
        await asyncio.gather(drawing_task, return_exceptions=True)
        view.close()
