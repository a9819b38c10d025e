"""Serves the page and hands each browser what has changed, on the loopback interface or by token.

Meshcat's own server listens on every interface, keeps every change for ever and takes commands
from any page that the browser happens to show. Here pages of other origins are refused, and all
that may not see the page (`access`), browsers may say nothing but "done", and each gets its
next bundle only after it has drawn the last: a slow one misses moments, a hung one costs nothing.
"""

from __future__ import annotations

import importlib.metadata
import time
from pathlib import Path
from urllib.parse import urlsplit

import tornado.httpserver
import tornado.web
import tornado.websocket

from armguard.view.access import Access
from armguard.view.drawing import show
from armguard.view.latest import LatestValues, Reader
from armguard.view.listening import LOOPBACK, listen

BROWSER_LIMIT = 16
DONE = "done"
_PAGE = Path(__file__).resolve().parent / "page"
# Importing Meshcat would start its own machinery; only its viewer is wanted.
_VIEWER = Path(
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
        address: Where the feed comes from, for the page to say.
        port: TCP port; 0: any that is free.
        host: Address of the interface to listen on. Beyond the loopback interface the page is
            shown only to those that bring the token that is in `url`.

    Attributes:
        url: Address of the page.

    Raises:
        ArmguardError: The port is in use.
    """

    def __init__(
        self, values: LatestValues, address: str, port: int = 0, host: str = LOOPBACK
    ) -> None:
        self._browsers: set[BrowserSocket] = set()
        self._values = values
        self._address = address
        self._last_frame: float | None = None
        access = Access(host)
        application = tornado.web.Application(
            [
                (r"/feed", BrowserSocket, {"server": self}),
                (r"/meshcat/(main\.min\.js)", LocalFile, {"path": str(_VIEWER)}),
                (r"/(.*)", LocalFile, {"path": str(_PAGE), "default_filename": "index.html"}),
            ],
            websocket_ping_interval=5.0,
            websocket_max_message_size=64,
            log_function=_log_nothing,
            access=access,
        )
        listener = listen(port, host)
        self._server = tornado.httpserver.HTTPServer(application)
        self._server.add_socket(listener)
        self.url = access.describe(listener.getsockname()[1])

    def flush(self) -> None:
        """Hand every browser that waits for it what has changed; called after each frame."""
        self._last_frame = time.monotonic()
        for browser in list(self._browsers):
            browser.pump()

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
        browser.send(self.tell_news())
        return True

    def tell_news(self) -> bytes:
        """How old the latest moment is: what is handed to a late browser may long be past."""
        silence = None if self._last_frame is None else time.monotonic() - self._last_frame
        return show("news", {"address": self._address, "silence": silence}).payload

    def detach(self, browser: BrowserSocket) -> None:
        """Forget a browser that has gone."""
        self._browsers.discard(browser)
        if browser.reader is not None:
            self._values.detach(browser.reader)


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

    def check_origin(self, origin: str) -> bool:
        """Refuse pages of other origins; Host itself was checked before."""
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc == self.request.host

    def open(self) -> None:
        """Take the browser in."""
        if not self._view.attach(self):
            self.close(1013, "too many browsers are watching")

    def on_message(self, message: str | bytes) -> None:
        """Go on when the browser has drawn; it has nothing else to say."""
        if message != DONE or self._waits:
            self.close(1008, "not understood")
            return
        self._waits = True
        self.pump()

    def on_close(self) -> None:
        """Let the browser go."""
        self._view.detach(self)

    def pump(self) -> None:
        """Send the next bundle, if the browser waits for one and there is one."""
        if not self._waits or self.reader is None:
            return
        bundle = self.reader.take(self._view.tell_news())
        if bundle is not None:
            self.send(bundle)

    def send(self, payload: bytes) -> None:
        """Send one message; the browser answers `DONE` once it is drawn."""
        self._waits = False
        try:
            sending = self.write_message(payload, binary=True)
        except tornado.websocket.WebSocketClosedError:
            return
        # A browser that goes away while it is being written to is no error.
        sending.add_done_callback(lambda future: future.cancelled() or future.exception())


def _log_nothing(handler: tornado.web.RequestHandler) -> None:
    """Requests are not worth a line each."""
