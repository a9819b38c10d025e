import asyncio
import contextlib
import math
import signal
import subprocess
import sys
import threading
import time

import msgspec
import pytest
import zmq
from tornado.httpclient import HTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from armguard.streams.inputs import SocketInput
from armguard.view import FramePublisher, launch, viewer
from armguard.view.messages import encode_message
from support.view_samples import make_frame, make_scene

TIMEOUT = 10.0


@pytest.fixture(scope="module")
def view():
    with launch("tcp://127.0.0.1:1") as process:
        yield process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_quietly(number, capfd):
    command = [sys.executable, "-m", "armguard.view", "tcp://127.0.0.1:1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert "http://127.0.0.1:" in process.stdout.readline()
        process.send_signal(number)
        assert process.wait(TIMEOUT) == 0
    assert capfd.readouterr().err == ""


def test_rubbish_on_the_feed_is_counted_and_survived(capfd):
    context = zmq.Context()
    try:
        socket_ = context.socket(zmq.PUB)
        port = socket_.bind_to_random_port("tcp://127.0.0.1")
        with launch(f"tcp://127.0.0.1:{port}") as view:
            time.sleep(0.5)
            for rubbish in (b"", b"\xff" * 100, b"\x00", encode_message(make_scene(period=-1.0))):
                socket_.send(rubbish)
            socket_.send(encode_message(make_scene(robot="nobody")))
            socket_.send(encode_message(make_frame()))
            time.sleep(0.5)
            assert view.running
            client = HTTPClient()
            assert client.fetch(view.url).code == 200
            client.close()
        lines = capfd.readouterr().err.splitlines()
        assert 1 <= len(lines) <= 3
        assert all("feed" in line for line in lines)
    finally:
        context.destroy(linger=0)


def silence(url):
    """For how long a page has heard nothing of a monitor, in [s], as it says; inf if never."""

    async def ask():
        browser = await websocket_connect(HTTPRequest(url.replace("http", "ws") + "feed"))
        try:
            (news,) = msgspec.msgpack.decode(
                await asyncio.wait_for(browser.read_message(), TIMEOUT)
            )
        finally:
            browser.close()
            await asyncio.sleep(0.05)
        assert news["type"] == "news"
        return math.inf if news["silence"] is None else news["silence"]

    return asyncio.run(ask())


def wait_for(happens):
    until = time.monotonic() + TIMEOUT
    while not happens():
        assert time.monotonic() < until
        time.sleep(0.03)


def test_it_attaches_to_a_feed_that_comes_and_goes():
    with FramePublisher("tcp://127.0.0.1:*") as publisher:
        address = publisher.address
    with launch(address) as process:
        for _ in range(2):
            wait_for(lambda: silence(process.url) > 0.5)
            with FramePublisher(address) as publisher:

                def is_heard(publisher=publisher):
                    publisher.publish_scene(make_scene())
                    publisher.publish_frame(make_frame())
                    return silence(process.url) < 0.2

                wait_for(is_heard)
        assert process.running


def ask_for_reset(url, token):
    """What becomes of a reset that a page asks for."""

    async def ask():
        browser = await websocket_connect(HTTPRequest(url.replace("http", "ws") + "feed"))
        try:
            await browser.write_message(msgspec.json.encode({"type": "reset", "token": token}))
            while True:
                message = await asyncio.wait_for(browser.read_message(), TIMEOUT)
                first = msgspec.msgpack.decode(message)[0]
                if first["type"] == "outcome":
                    return first["text"]
        finally:
            browser.close()
            await asyncio.sleep(0.05)

    return asyncio.run(ask())


def show_scene(publisher, url, **scene):
    """Publish until the page has what is told."""
    publisher.publish_scene(make_scene(**scene))
    for sequence in range(100):
        publisher.publish_frame(make_frame(sequence=sequence))
        time.sleep(0.02)
        if sequence > 20 and not math.isnan(silence(url)):
            return


def test_a_reset_from_the_page_reaches_the_monitor_with_its_token():
    with (
        FramePublisher("tcp://127.0.0.1:*") as publisher,
        launch(publisher.address) as process,
        contextlib.closing(SocketInput("tcp://127.0.0.1:*")) as monitor,
    ):
        assert "no monitor" in ask_for_reset(process.url, "sesame")
        time.sleep(1.1)
        show_scene(publisher, process.url)
        assert "obeys no reset" in ask_for_reset(process.url, "sesame")
        time.sleep(1.1)
        show_scene(publisher, process.url, reset_address=monitor.address, obeys_reset=True)
        # A monitor hears of a publisher only while it reads, as it does in every tick.
        heard, ended = [], threading.Event()

        def listen():
            while not ended.wait(0.005):
                heard.append(monitor.receive() or b"")

        listener = threading.Thread(target=listen)
        listener.start()
        try:
            assert ask_for_reset(process.url, "sesame").startswith("sent")
            wait_for(lambda: any(b"sesame" in message for message in heard))
        finally:
            ended.set()
            listener.join()


@pytest.mark.parametrize(
    ("told", "sent_to"),
    [
        ("tcp://0.0.0.0:5702", "tcp://192.0.2.10:5702"),
        ("tcp://127.0.0.1:5702", "tcp://192.0.2.10:5702"),
        ("ipc:///tmp/joints", None),
    ],
)
def test_a_reset_goes_to_the_machine_of_the_feed(monkeypatch, told, sent_to):
    """The same address on this machine may be that of another monitor."""
    sent = []
    monkeypatch.setattr(viewer, "_publish_reset", lambda address, *_: sent.append(address) or "ok")

    async def ask():
        with contextlib.closing(viewer.Watch("tcp://192.0.2.10:5704")) as view:
            view._draw_scene(make_scene(reset_address=told, obeys_reset=True))
            return await view._send_reset("sesame")

    outcome = asyncio.run(ask())
    assert sent == ([] if sent_to is None else [sent_to])
    assert ("its own machine" if sent_to is None else "ok") in outcome
