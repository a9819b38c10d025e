import asyncio
import contextlib

import msgspec
import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from armguard.view.drawing import Command, show
from armguard.view.latest_values import LatestValues
from armguard.view.page_state import PageState
from armguard.view.server import BROWSER_LIMIT, ViewServer

TIMEOUT = 5.0
DONE = '{"type": "done"}'


class Stage:
    """A server, and browsers to look at it."""

    def __init__(self) -> None:
        self.values = LatestValues()
        self.page_state = PageState("tcp://127.0.0.1:1")
        self.asked: list[tuple[int, bool]] = []
        self.tokens: list[str] = []
        self.server = ViewServer(self.values, self.page_state, self.draw_past, self.send_reset)
        self._browsers: list[WebSocketClientConnection] = []

    def draw_past(self, number: int, with_volume: bool):
        self.asked.append((number, with_volume))
        return [show("banner", {"sequence": -number})]

    async def send_reset(self, token: str) -> str:
        self.tokens.append(token)
        return "sent"

    def show(self, sequence: int) -> None:
        self.values.set(show("banner", {"sequence": sequence}))
        self.page_state.note_frame()
        self.server.flush()

    async def get(self, path: str = "", **headers: str):
        request = HTTPRequest(self.server.url + path, headers=headers)
        return await AsyncHTTPClient().fetch(request, raise_error=False)

    async def browse(self, **headers: str) -> WebSocketClientConnection:
        url = self.server.url.replace("http", "ws") + "feed"
        browser = await websocket_connect(HTTPRequest(url, headers=headers))
        self._browsers.append(browser)
        return browser

    async def close(self) -> None:
        for browser in self._browsers:
            browser.close()
        self.server.close()
        await asyncio.sleep(0.05)


async def hear(browser: WebSocketClientConnection):
    message = await asyncio.wait_for(browser.read_message(), TIMEOUT)
    return None if message is None else msgspec.msgpack.decode(message)


async def hears_nothing(browser: WebSocketClientConnection) -> bool:
    # The next message is asked for once only: tornado allows one reader at a time.
    waiting = asyncio.ensure_future(browser.read_message())
    done, _ = await asyncio.wait([waiting], timeout=0.2)
    with contextlib.suppress(asyncio.CancelledError):
        waiting.cancel()
    return not done


def on_stage(play):
    async def run():
        stage = Stage()
        try:
            await play(stage)
        finally:
            await stage.close()

    asyncio.run(run())


def test_the_page_and_meshcat_are_served_with_strict_headers():
    async def play(stage):
        for path, content in (
            ("", b"meshcat/main.min.js"),
            ("stage.js", b"MeshCat.Viewer"),
            ("view.css", b"#banner"),
            ("meshcat/main.min.js", b"MeshCat"),
        ):
            answer = await stage.get(path)
            assert answer.code == 200
            assert content in answer.body
            assert "default-src 'none'" in answer.headers["Content-Security-Policy"]

    on_stage(play)


def test_no_other_file_is_served():
    async def play(stage):
        for path in ("../server.py", "%2e%2e/server.py", "meshcat/index.html", "/etc/passwd"):
            assert (await stage.get(path)).code in (403, 404)

    on_stage(play)


def test_names_that_only_resolve_to_this_machine_are_refused():
    async def play(stage):
        for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", "[::1", "a:b:c"):
            assert (await stage.get(Host=host)).code in (400, 403)
            with pytest.raises(HTTPClientError):
                await stage.browse(Host=host)
        for host in ("localhost:1234", "127.0.0.1"):
            assert (await stage.get(Host=host)).code == 200

    on_stage(play)


def test_pages_of_other_origins_are_refused():
    async def play(stage):
        own = stage.server.url.rstrip("/")
        for origin in ("http://evil.example", "http://127.0.0.1:1", "null", own + "0"):
            with pytest.raises(HTTPClientError):
                await stage.browse(Origin=origin)
        browser = await stage.browse(Origin=own)
        assert (await hear(browser))[0]["type"] == "news"

    on_stage(play)


def test_who_comes_late_is_told_the_present():
    async def play(stage):
        for sequence in range(100):
            stage.show(sequence)
        browser = await stage.browse()
        (news,) = await hear(browser)
        assert news["address"] == "tcp://127.0.0.1:1"
        assert 0.0 <= news["silence"] < TIMEOUT
        await browser.write_message(DONE)
        (_, banner) = await hear(browser)
        assert banner["sequence"] == 99

    on_stage(play)


def test_slow_and_quick_browsers_each_get_the_latest():
    async def play(stage):
        slow, quick = await stage.browse(), await stage.browse()
        for browser in (slow, quick):
            await hear(browser)
            await browser.write_message(DONE)
        await asyncio.sleep(0.05)
        for sequence in range(5):
            stage.show(sequence)
            (_, banner) = await hear(quick)
            assert banner["sequence"] == sequence
            await quick.write_message(DONE)
            await asyncio.sleep(0.02)
        (_, first) = await hear(slow)
        await slow.write_message(DONE)
        (_, last) = await hear(slow)
        assert (first["sequence"], last["sequence"]) == (0, 4)

    on_stage(play)


@pytest.mark.parametrize(
    "message",
    ["draw!", "done", DONE.encode(), DONE + DONE, "x" * 1000, '{"type": "reset", "token": 1}'],
)
def test_browsers_may_say_nothing_else(message):
    async def play(stage):
        browser = await stage.browse()
        await hear(browser)
        await browser.write_message(message, binary=isinstance(message, bytes))
        assert await hear(browser) is None

    on_stage(play)


def test_too_many_browsers_are_sent_away():
    async def play(stage):
        watching = [await stage.browse() for _ in range(BROWSER_LIMIT)]
        for browser in watching:
            assert (await hear(browser))[0]["type"] == "news"
        assert await hear(await stage.browse()) is None
        watching[0].close()
        await asyncio.sleep(0.1)
        assert (await hear(await stage.browse()))[0]["type"] == "news"

    on_stage(play)


def test_a_browser_looks_at_the_past_and_comes_back_to_all_that_changed():
    async def play(stage):
        browser, other = await stage.browse(), await stage.browse()
        for one in (browser, other):
            await hear(one)
            await one.write_message(DONE)
        await browser.write_message('{"type": "seek", "number": 5}')
        (_, banner, seen) = await hear(browser)
        assert banner["sequence"] == -5
        assert (seen["type"], seen["number"], seen["drawn"]) == ("seen", 5, True)
        await browser.write_message(DONE)
        stage.show(1)
        assert (await hear(other))[1]["sequence"] == 1
        assert await hears_nothing(browser)
        assert stage.asked == [(5, False)]

    on_stage(play)


@pytest.mark.parametrize("nothing", [None, []])
def test_a_moment_that_cannot_be_drawn_is_answered_all_the_same(nothing):
    async def play(stage):
        stage.server.draw_past = lambda number, with_volume: nothing
        browser = await stage.browse()
        await hear(browser)
        await browser.write_message(DONE)
        await browser.write_message('{"type": "seek", "number": 5}')
        (_, seen) = await hear(browser)
        assert (seen["type"], seen["number"], seen["drawn"]) == ("seen", 5, False)
        await browser.write_message(DONE)
        await browser.write_message('{"type": "seek", "number": null}')
        stage.show(1)
        assert (await hear(browser))[1]["sequence"] == 1

    on_stage(play)


def test_meshes_that_are_under_way_come_in_the_past_as_well():
    async def play(stage):
        browser = await stage.browse()
        await hear(browser)
        stage.show(1)
        for number in range(3):
            stage.values.set(Command(f"set_object /{number}", msgspec.msgpack.encode(number)))
        await browser.write_message('{"type": "seek", "number": 5}')
        await browser.write_message(DONE)
        assert (await hear(browser))[2]["type"] == "seen"
        await browser.write_message(DONE)
        assert len((await hear(browser))[1:]) == 3
        await browser.write_message(DONE)
        assert await hears_nothing(browser)

    on_stage(play)


def test_what_the_past_has_drawn_is_drawn_anew_by_the_present():
    async def play(stage):
        stage.show(1)
        browser = await stage.browse()
        for expected in (None, 1):
            bundle = await hear(browser)
            assert expected is None or bundle[1]["sequence"] == expected
            await browser.write_message(DONE)
        await browser.write_message('{"type": "seek", "number": 5}')
        assert (await hear(browser))[1]["sequence"] == -5
        await browser.write_message(DONE)
        await browser.write_message('{"type": "seek", "number": null}')
        assert (await hear(browser))[1]["sequence"] == 1

    on_stage(play)


def test_a_reset_is_handed_on_at_most_once_a_second_and_its_outcome_told():
    async def play(stage):
        browser = await stage.browse()
        await hear(browser)
        for token, outcome in (("sesame", "sent"), ("again", "too soon")):
            await browser.write_message(f'{{"type": "reset", "token": "{token}"}}')
            (answer,) = await hear(browser)
            assert answer["type"] == "outcome"
            assert outcome in answer["text"]
        assert stage.tokens == ["sesame"]

    on_stage(play)


def test_the_stopping_volume_is_found_only_while_a_browser_shows_it():
    async def play(stage):
        browser = await stage.browse()
        await hear(browser)
        assert not stage.server.wants_volume
        await browser.write_message('{"type": "layers", "volume": true}')
        await asyncio.sleep(0.05)
        assert stage.server.wants_volume
        browser.close()
        await asyncio.sleep(0.1)
        assert not stage.server.wants_volume

    on_stage(play)
