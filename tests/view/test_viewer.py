import asyncio
import contextlib
import math
import signal
import subprocess
import sys
import time

import msgspec
import pytest
import zmq
from tornado.httpclient import HTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from armguard.streams.inputs import SocketInput
from armguard.view import FramePublisher, launch, viewer
from armguard.view.messages import Latch, encode_message
from armguard.view.process import WatchOptions
from support.view_samples import make_frame, make_scene

TIMEOUT = 10.0


@pytest.fixture(scope="module")
def view():
    with launch("tcp://127.0.0.1:1") as process:
        yield process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_quietly(number, capfd):
    command = [sys.executable, "-m", "armguard.view", '{"address": "tcp://127.0.0.1:1"}']
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


SEEN = Latch(reason="a person was near", since=1.0)


@pytest.fixture
def watch(tmp_path, monkeypatch):
    """A view that was told of a monitor that does not listen yet, and has time to wait for it."""
    monkeypatch.setattr(viewer, "REACH_TIMEOUT", TIMEOUT)
    monkeypatch.setattr(viewer, "ANSWER_TIMEOUT", TIMEOUT)
    address = f"ipc://{tmp_path}/in"
    with contextlib.closing(viewer.Watch(WatchOptions(address="tcp://127.0.0.1:1"))) as watch:
        tell(watch, make_scene(reset_address=address, obeys_reset=True), make_frame())
        watch.monitor_address = address
        yield watch


def tell(watch, *messages):
    watch._draw_newest([encode_message(message) for message in messages])


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [({"obeyed_resets": 4}, "obeyed"), ({"obeyed_resets": 3, "refused_resets": 6}, "refused")],
)
def test_a_reset_waits_for_the_monitor_to_listen_and_for_its_answer(watch, answer, outcome):
    async def play():
        tell(watch, make_frame(obeyed_resets=3, refused_resets=5))
        asking = asyncio.create_task(watch._send_reset("sesame"))
        await asyncio.sleep(0)
        assert "under way" in await watch._send_reset("sesame")
        with contextlib.closing(SocketInput(watch.monitor_address)) as monitor:
            heard = []
            async with asyncio.timeout(TIMEOUT):
                while not heard:
                    # A monitor that says the same as before has not answered.
                    tell(watch, make_frame(obeyed_resets=3, refused_resets=5))
                    message = monitor.receive()
                    heard += [] if message is None else [message]
                    await asyncio.sleep(0.005)
            assert b"sesame" in heard[0]
            assert not asking.done()
            tell(watch, make_frame(**answer))
            told = await asyncio.wait_for(asking, TIMEOUT)
            # Once: another one could release what was latched since.
            assert monitor.receive() is None
            return told

    assert asyncio.run(play()).startswith(outcome)


def test_a_reset_that_no_monitor_takes_or_answers_is_told(watch, monkeypatch):
    async def play():
        monkeypatch.setattr(viewer, "REACH_TIMEOUT", 0.0)
        told = [await watch._send_reset("sesame")]
        monkeypatch.setattr(viewer, "REACH_TIMEOUT", TIMEOUT)
        monkeypatch.setattr(viewer, "ANSWER_TIMEOUT", 0.01)
        with contextlib.closing(SocketInput(watch.monitor_address)) as monitor:
            asking = asyncio.create_task(watch._send_reset("sesame"))
            async with asyncio.timeout(TIMEOUT):
                while not asking.done():
                    monitor.receive()
                    await asyncio.sleep(0.005)
            return [*told, asking.result()]

    unheard, unanswered = asyncio.run(play())
    assert unheard.startswith("not sent: no monitor listens")
    assert "may not have arrived" in unanswered


def begin_anew(watch):
    scene = make_scene(reset_address=watch.monitor_address, obeys_reset=True, period=0.004)
    tell(watch, scene, make_frame())


def latch_more(watch):
    tell(watch, make_frame(latches=(SEEN, Latch(reason="arm: no joint state", since=2.0))))


@pytest.mark.parametrize(
    ("change", "outcome"),
    [
        (begin_anew, "another run has begun"),
        (viewer.Watch._forget_run, "another run has begun"),
        (latch_more, "something else has latched"),
    ],
)
def test_a_reset_that_waited_is_not_sent_for_what_no_operator_saw(watch, change, outcome):
    async def play():
        tell(watch, make_frame(latches=(SEEN,)))
        asking = asyncio.create_task(watch._send_reset("sesame"))
        await asyncio.sleep(0)
        change(watch)
        with contextlib.closing(SocketInput(watch.monitor_address)) as monitor:
            heard = []
            async with asyncio.timeout(TIMEOUT):
                while not asking.done():
                    heard.append(monitor.receive())
                    await asyncio.sleep(0.005)
            heard += [monitor.receive() for _ in range(20)]
            assert set(heard) == {None}
            return asking.result()

    told = asyncio.run(play())
    assert told.startswith("not sent")
    assert outcome in told


def test_a_reset_is_not_answered_by_the_counts_of_another_run(watch):
    async def play():
        tell(watch, make_frame(obeyed_resets=3))
        asking = asyncio.create_task(watch._send_reset("sesame"))
        with contextlib.closing(SocketInput(watch.monitor_address)) as monitor:
            async with asyncio.timeout(TIMEOUT):
                while monitor.receive() is None:
                    await asyncio.sleep(0.005)
            begin_anew(watch)
            tell(watch, make_frame(obeyed_resets=4))
            return await asyncio.wait_for(asking, TIMEOUT)

    assert "another run has begun" in asyncio.run(play())


def test_nothing_is_sent_before_the_first_frame_of_another_run(watch):
    scene = make_scene(reset_address=watch.monitor_address, obeys_reset=True, period=0.004)
    tell(watch, scene)
    assert asyncio.run(watch._send_reset("sesame")).startswith("not sent: there is no monitor")


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

    async def publish(_, address, token, arm):
        sent.append((address, arm))
        return "ok"

    monkeypatch.setattr(viewer, "Publisher", lambda *_, **keys: contextlib.nullcontext())
    monkeypatch.setattr(viewer.Watch, "_publish_reset", lambda _, *given: publish(*given))

    async def ask():
        with contextlib.closing(
            viewer.Watch(WatchOptions(address="tcp://192.0.2.10:5704"))
        ) as view:
            tell(view, make_scene(reset_address=told, obeys_reset=True, arm="left"), make_frame())
            return await view._send_reset("sesame")

    outcome = asyncio.run(ask())
    assert sent == ([] if sent_to is None else [(sent_to, "left")])
    assert ("its own machine" if sent_to is None else "ok") in outcome
