import asyncio
from urllib.parse import urlsplit

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from armguard.exceptions import ArmguardError
from armguard.view.access import Access
from armguard.view.latest_values import LatestValues
from armguard.view.page_state import PageState
from armguard.view.server import ViewServer


def make_server(host):
    """A page without past, to which nobody sends a reset."""

    async def send_reset(token):
        return ""

    page_state = PageState("tcp://127.0.0.1:1")
    return ViewServer(LatestValues(), page_state, lambda number, volume: None, send_reset, 0, host)


def test_on_this_machine_there_is_no_token():
    for host in ("127.0.0.1", "127.0.0.7", "::1"):
        assert Access(host).token == ""
    assert Access("::1").describe(7) == "http://[::1]:7/"


def test_elsewhere_there_is_a_token_that_no_other_start_has():
    tokens = {Access(host).token for host in ("0.0.0.0", "192.0.2.1", "::", "192.0.2.1")}
    assert len(tokens) == 4
    assert min(map(len, tokens)) >= 32
    access = Access("192.0.2.1")
    assert access.describe(7) == f"http://192.0.2.1:7/?token={access.token}"


@pytest.mark.parametrize("host", ["", "localhost", "example.com", "127.0.0.1:80", "*"])
def test_a_host_that_is_no_address_is_refused_by_name(host):
    with pytest.raises(ArmguardError, match="expected the address of an interface"):
        Access(host)


def test_beyond_this_machine_page_and_feed_need_the_token():
    async def play():
        server = make_server("0.0.0.0")
        port = urlsplit(server.url).port
        token = server.url.partition("?token=")[2]
        url = f"http://127.0.0.1:{port}/"

        async def get(path, **headers):
            request = HTTPRequest(url + path, headers=headers)
            return await AsyncHTTPClient().fetch(request, raise_error=False)

        async def attach(query="", **headers):
            feed = url.replace("http", "ws") + "feed" + query
            return await websocket_connect(HTTPRequest(feed, headers=headers))

        try:
            cookie = None
            for bad in ("", "x", token[:-1], token + "x", "%ff", token.upper()):
                for path in (f"?token={bad}", f"meshcat/main.min.js?token={bad}"):
                    assert (await get(path)).code in (400, 403)
                with pytest.raises(HTTPClientError):
                    await attach(f"?token={bad}")
                with pytest.raises(HTTPClientError):
                    await attach(Cookie=f"armguard-view-{port}={bad}")
            answer = await get(f"?token={token}", Host="cell.example")
            assert answer.code == 200
            cookie = answer.headers["Set-Cookie"]
            assert "HttpOnly" in cookie
            assert "SameSite=Strict" in cookie
            cookie = cookie.partition(";")[0]
            # What the page asks for next brings the cookie alone.
            assert (await get("meshcat/main.min.js", Cookie=cookie)).code == 200
            browser = await attach(Cookie=cookie)
            assert await browser.read_message() is not None
            browser.close()
            with pytest.raises(HTTPClientError):
                await attach(Cookie=cookie, Origin="http://evil.example")
        finally:
            server.close()
            await asyncio.sleep(0.05)

    asyncio.run(play())


def test_on_another_loopback_address_requests_may_name_it_and_no_stranger():
    async def play():
        server = make_server("127.0.0.2")
        try:
            for host, code in ((None, 200), ("localhost", 200), ("cell.example", 403)):
                headers = {} if host is None else {"Host": host}
                request = HTTPRequest(server.url, headers=headers)
                answer = await AsyncHTTPClient().fetch(request, raise_error=False)
                assert answer.code == code
        finally:
            server.close()
            await asyncio.sleep(0.05)

    asyncio.run(play())
