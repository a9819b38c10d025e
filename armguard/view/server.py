"""Serves the page and sends each browser the changes, on the loopback interface or with a token.

Meshcat's own server listens on every interface, keeps every change for ever, and accepts commands
from any page in the browser. This server refuses pages of other origins, and requests without
access (`access`). Browsers can send only the requests of `requests`. Each browser gets its next
bundle only after it has drawn the last: a slow browser misses moments, and a browser that hangs
costs nothing.
"""

from __future__ import annotations

import importlib.metadata
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

import tornado.httpserver
import tornado.web
import tornado.websocket

from armguard.exceptions import ArmguardError
from armguard.view.access import Access
from armguard.view.drawing import Command, show
from armguard.view.latest_values import LatestValues, Reader, join
from armguard.view.listening import LOOPBACK, listen
from armguard.view.page_state import FilmPosition, PageState
from armguard.view.requests import LONGEST, Done, Layers, ResetRequest, Seek, read_request

BROWSER_LIMIT = 16

RESET_INTERVAL = 1.0
"""Least time between two resets of all browsers, in [s], so that no token is found by guessing."""

LASTING = "set_object "
"""Prefix of the keys of commands that hold in every moment: the arm's meshes."""

PAGE = Path(__file__).resolve().parent / "page"
# Importing Meshcat would start its own machinery; only its viewer is wanted.
VIEWER = Path(
    str(importlib.metadata.distribution("meshcat").locate_file("meshcat/viewer/dist"))
).resolve()
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        "connect-src 'self' data: blob:; img-src 'self' data: blob:; frame-ancestors 'none'; "
        "base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class ViewServer:
    """The web server of one view.

    Args:
        values: The drawing commands to send to browsers.
        page_state: The state of the page apart from the drawing.
        draw_past: Draws the moment with this number, with or without the stopping volume; None: the
            moment was dropped.
        send_reset: Sends the monitor a reset with this token; returns its result in words.
        port: TCP port; 0: any free port.
        host: Address of the interface to listen on. Beyond the loopback interface, requests must
            carry the token in `url`.

    Attributes:
        url: Address of the page.

    Raises:
        ArmguardError: The port is in use.
    """

    def __init__(
        self,
        values: LatestValues,
        page_state: PageState,
        draw_past: Callable[[int, bool], list[Command] | None],
        send_reset: Callable[[str], Awaitable[str]],
        port: int = 0,
        host: str = LOOPBACK,
    ) -> None:
        self._browsers: set[BrowserSocket] = set()
        self._values = values
        self._page_state = page_state
        self.draw_past = draw_past
        self._send_reset = send_reset
        self._next_reset = -RESET_INTERVAL
        access = Access(host)
        application = tornado.web.Application(
            [
                (r"/feed", BrowserSocket, {"server": self}),
                (r"/meshcat/(main\.min\.js)", LocalFile, {"path": str(VIEWER)}),
                (r"/(.*)", LocalFile, {"path": str(PAGE), "default_filename": "index.html"}),
            ],
            websocket_ping_interval=5.0,
            websocket_max_message_size=LONGEST,
            log_function=_log_nothing,
            access=access,
        )
        listener = listen(port, host)
        self._server = tornado.httpserver.HTTPServer(application)
        self._server.add_socket(listener)
        self.url = access.describe(listener.getsockname()[1])

    @property
    def wants_volume(self) -> bool:
        """Whether a browser shows the stopping volume of the present."""
        return any(browser.wants_volume for browser in self._browsers)

    def flush(self) -> None:
        """Send the changes to every browser that waits for them; called after each frame."""
        for browser in list(self._browsers):
            browser.pump()

    def tell(self) -> None:
        """Send the news to every browser that waits, even if no drawing has changed."""
        for browser in list(self._browsers):
            browser.pump(always=True)

    def close(self) -> None:
        """Stop listening, and disconnect all browsers."""
        self._server.stop()
        for browser in list(self._browsers):
            browser.close(1001, "the view has ended")

    def attach(self, browser: BrowserSocket) -> bool:
        """Accept a browser, unless there are too many."""
        if len(self._browsers) >= BROWSER_LIMIT:
            return False
        self._browsers.add(browser)
        browser.reader = self._values.attach()
        browser.send(join([self.tell_news(browser.told)]))
        return True

    def tell_news(self, told: FilmPosition) -> bytes:
        """The age of the latest moment, and further news that the browser has not received."""
        return self._page_state.tell(told)

    def detach(self, browser: BrowserSocket) -> None:
        """Remove a browser that has disconnected."""
        self._browsers.discard(browser)
        if browser.reader is not None:
            self._values.detach(browser.reader)

    async def reset(self, token: str) -> str:
        """Send the monitor a reset; returns its result in words."""
        now = time.monotonic()
        if now < self._next_reset:
            return "too soon after the last attempt: wait a second"
        self._next_reset = now + RESET_INTERVAL
        return await self._send_reset(token)


class _Guarded(tornado.web.RequestHandler):
    """Answers only requests that have access to the page."""

    def prepare(self) -> None:
        self.settings["access"].check(self)


class LocalFile(_Guarded, tornado.web.StaticFileHandler):
    """A file of the page."""

    def set_extra_headers(self, path: str) -> None:
        """Set headers that forbid everything the page does not need."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)


class BrowserSocket(_Guarded, tornado.websocket.WebSocketHandler):
    """The connection of one browser. At most one bundle is in transit at any time."""

    def initialize(self, server: ViewServer) -> None:
        """Remember the server of this browser."""
        self._view = server
        self._waits = False
        self.reader: Reader | None = None
        self.told = FilmPosition()
        self._seen: int | None = None
        """Number of the moment of the past that it shows; None: the present."""
        self._is_due = False
        """Whether that moment is still to be drawn."""
        self._with_volume = False
        self._touched: set[str] = set()
        """Keys drawn for the past, which must be drawn again for the present."""

    @property
    def wants_volume(self) -> bool:
        """Whether it shows the stopping volume of the present."""
        return self._with_volume and self._seen is None

    def check_origin(self, origin: str) -> bool:
        """Refuse pages of other origins; Host itself was checked before."""
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc == self.request.host

    def open(self) -> None:
        """Accept the browser."""
        if not self._view.attach(self):
            self.close(1013, "too many browsers are watching")

    async def on_message(self, message: str | bytes) -> None:
        """Obey a request of the page, if it is permitted."""
        try:
            request = read_request(message)
        except ArmguardError:
            self.close(1008, "not understood")
            return
        if isinstance(request, Done):
            if self._waits:
                self.close(1008, "not understood")
                return
            self._waits = True
        elif isinstance(request, Seek):
            self._seek(request.number)
        elif isinstance(request, Layers):
            self._with_volume = request.volume
            self._is_due = self._seen is not None
        elif isinstance(request, ResetRequest):
            outcome = await self._view.reset(request.token)
            answer = show("outcome", {"text": outcome}).payload
            # Beside the usual turn: it waits for no drawing, and is small.
            self._write(join([answer]))
            return
        self.pump()

    def on_close(self) -> None:
        """Remove the browser."""
        self._view.detach(self)

    def pump(self, *, always: bool = False) -> None:
        """Send the next bundle, if the browser waits for one and there is one.

        Args:
            always: Whether to send a bundle that has only news.
        """
        if not self._waits or self.reader is None:
            return
        if self._seen is not None:
            self._pump_past(always)
            return
        news = self._view.tell_news
        bundle = self.reader.take(news(self.told)) if self.reader.owes() else None
        if bundle is None and always:
            bundle = join([news(self.told)])
        if bundle is not None:
            self.send(bundle)

    def send(self, payload: bytes) -> None:
        """Send one bundle; the browser answers `Done` after it is drawn."""
        self._waits = False
        self._write(payload)

    def _seek(self, number: int | None) -> None:
        self._seen, self._is_due = number, number is not None
        if number is None and self.reader is not None:
            self.reader.owe_again(self._touched)
            self._touched.clear()

    def _pump_past(self, always: bool) -> None:
        assert self._seen is not None, "looks at the past"
        assert self.reader is not None, "is attached"
        if not self._is_due:
            # Meshes that are still under way are of the past as well.
            if always or self.reader.owes(LASTING):
                news = self._view.tell_news(self.told)
                self.send(self.reader.take(news, LASTING) or join([news]))
            return
        self._is_due = False
        drawn = self._view.draw_past(self._seen, self._with_volume) or []
        self._touched.update(command.key for command in drawn)
        # The page waits for this, and asks for nothing else until it comes.
        seen = show("seen", {"number": self._seen, "drawn": bool(drawn)})
        parts = [*(command.payload for command in drawn), seen.payload]
        self.send(join([self._view.tell_news(self.told), *parts]))

    def _write(self, payload: bytes) -> None:
        try:
            sending = self.write_message(payload, binary=True)
        except tornado.websocket.WebSocketClosedError:
            return
        # A browser that goes away while it is being written to is no error.
        sending.add_done_callback(lambda future: future.cancelled() or future.exception())


def _log_nothing(handler: tornado.web.RequestHandler) -> None:
    """Log nothing: one line for each request would be too many."""
