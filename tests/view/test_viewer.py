import signal
import subprocess
import sys
import time

import pytest
import zmq
from tornado.httpclient import HTTPClient

from armguard.view import FramePublisher, launch
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


def test_it_attaches_to_a_feed_that_comes_and_goes():
    with FramePublisher("tcp://127.0.0.1:*") as publisher:
        address = publisher.address
    with launch(address) as process:
        for _ in range(2):
            with FramePublisher(address) as publisher:
                publisher.publish_scene(make_scene())
                publisher.publish_frame(make_frame())
                time.sleep(0.1)
        assert process.running
