"""Serves the page and hands each browser what has changed, on the loopback interface or by token.

Meshcat's own server listens on every interface, keeps every change for ever and takes commands
from any page that the browser happens to show. Here pages of other origins are refused, and all
that may not see the page (`access`), browsers may say only what `requests` has, and each gets its
next bundle only after it has drawn the last: a slow one misses moments, a hung one costs nothing.
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
"""Between two resets of all browsers, in [s]: a token is not to be found by trying."""

LASTING = "set_object "
"""What keys of commands begin with that hold in every moment: the arm's meshes."""

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
        values: What browsers are to be shown.
        page_state: What there is to tell beside that.
        draw_past: Draws the moment of this number, with the stopping volume or without; None: it
            is gone.
        send_reset: Hands the monitor a reset with this token; says in words what became of it.
        port: TCP port; 0: any that is free.
        host: Address of the interface to listen on. Beyond the loopback interface the page is
            shown only to those that bring the token that is in `url`.

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
        """Hand every browser that waits for it what has changed; called after each frame."""
        for browser in list(self._browsers):
            browser.pump()

    def tell(self) -> None:
        """Hand every browser that waits the news, even where nothing is drawn anew."""
        for browser in list(self._browsers):
            browser.pump(always=True)

    def close(self) -> None:
        """Stop listening and part from all browsers."""
        self._server.stop()
        for browser in list(self._browsers):
            browser.close(1001, "the view has ended")

    def attach(self, browser: BrowserSocket) -> bool:
        """Take in a browser, unless there are too many."""
        if len(self._browsers) >= BROWSER_LIMIT:
            return False
        self._browsers.add(browser)
        browser.reader = self._values.attach()
        browser.send(join([self.tell_news(browser.told)]))
        return True

    def tell_news(self, told: FilmPosition) -> bytes:
        """How old the latest moment is, and what else the browser does not know yet."""
        return self._page_state.tell(told)

    def detach(self, browser: BrowserSocket) -> None:
        """Forget a browser that has gone."""
        self._browsers.discard(browser)
        if browser.reader is not None:
            self._values.detach(browser.reader)

    async def reset(self, token: str) -> str:
        """Hand the monitor a reset; what became of it, in words."""
        now = time.monotonic()
        if now < self._next_reset:
            return "too soon after the last attempt: wait a second"
        self._next_reset = now + RESET_INTERVAL
        return await self._send_reset(token)


class _Guarded(tornado.web.RequestHandler):
    """Answers only those that may see the page."""

    def prepare(self) -> None:
        self.settings["access"].check(self)


class LocalFile(_Guarded, tornado.web.StaticFileHandler):
    """A file of the page."""

    def set_extra_headers(self, path: str) -> None:
        """Allow nothing that the page does not need."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)


class BrowserSocket(_Guarded, tornado.websocket.WebSocketHandler):
    """One browser. At most one bundle is under way to it at any time."""

    def initialize(self, server: ViewServer) -> None:
        """Remember whose browser this is."""
        self._view = server
        self._waits = False
        self.reader: Reader | None = None
        self.told = FilmPosition()
        self._seen: int | None = None
        """Number of the moment of the past that it looks at; None: at the present."""
        self._is_due = False
        """Whether that has yet to be drawn."""
        self._with_volume = False
        self._touched: set[str] = set()
        """Keys of what the past has drawn, which the present must draw again."""

    @property
    def wants_volume(self) -> bool:
        """Whether it shows the stopping volume of the present."""
        return self._with_volume and self._seen is None

    def check_origin(self, origin: str) -> bool:
        """Refuse pages of other origins; Host itself was checked before."""
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc == self.request.host

    def open(self) -> None:
        """Take the browser in."""
        if not self._view.attach(self):
            self.close(1013, "too many browsers are watching")

    async def on_message(self, message: str | bytes) -> None:
        """Do what the page asks for, if it may."""
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
        """Let the browser go."""
        self._view.detach(self)

    def pump(self, *, always: bool = False) -> None:
        """Send the next bundle, if the browser waits for one and there is one.

        Args:
            always: Whether news alone are worth one.
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
        """Send one bundle; the browser answers `Done` once it is drawn."""
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
    """Requests are not worth a line each."""
