import time

import pytest
import zmq

from armguard.exceptions import ArmguardError
from armguard.streams.keys import present
from armguard.view import FramePublisher, SceneMessage
from armguard.view.messages import StatusMessage, decode_message
from armguard.view.publisher import SCENE_INTERVAL
from support.key_rings import KeyRing
from support.view_samples import make_frame, make_scene


@pytest.fixture
def subscriber():
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.set(zmq.RCVTIMEO, 5000)
    socket.set(zmq.RCVHWM, 2)
    socket.subscribe(b"")
    yield socket
    context.destroy(linger=0)


def test_who_comes_late_is_told_the_scene(subscriber):
    with FramePublisher("tcp://127.0.0.1:*") as publisher:
        publisher.publish_scene(make_scene())
        subscriber.connect(publisher.address)
        heard = []
        for sequence in range(200):
            publisher.publish_frame(make_frame(sequence=sequence))
            time.sleep(0.005)
            while subscriber.poll(0):
                heard.append(decode_message(subscriber.recv()))
            if len(heard) > 2 * SCENE_INTERVAL:
                break
        scenes = [message for message in heard if isinstance(message, SceneMessage)]
        assert scenes
        assert all(scene == make_scene() for scene in scenes)


def test_who_never_reads_finds_few_old_frames_and_delays_nobody(subscriber, tmp_path):
    with FramePublisher(f"ipc://{tmp_path}/feed") as publisher:
        subscriber.connect(publisher.address)
        time.sleep(0.2)
        frames = 20_000
        frame = make_frame()
        for _ in range(frames):
            publisher.publish_frame(frame)
        waiting = 0
        while subscriber.poll(100):
            subscriber.recv()
            waiting += 1
        # What the two queues and the kernel's buffer hold, not what was said.
        assert waiting < frames / 4


def test_what_cannot_be_sent_is_counted_and_never_raised():
    publisher = FramePublisher("tcp://127.0.0.1:*")
    publisher.publish_frame(make_frame(now="soon", q=object()))
    assert publisher.dropped == 1
    assert "object" in publisher.problem
    publisher.close()
    publisher.publish_frame(make_frame())
    publisher.close()
    assert publisher.dropped == 2


@pytest.mark.parametrize(
    "address", ["nonsense", "tcp://127.0.0.1:notaport", "carrier://pigeon", "tcp://0.0.0.0:5704"]
)
def test_an_address_that_cannot_be_bound_is_named(address):
    with pytest.raises(ArmguardError, match=address.split(":")[0]):
        FramePublisher(address)


def test_a_closed_feed_leaves_no_file_behind(tmp_path):
    with FramePublisher(f"ipc://{tmp_path}/feed"):
        assert list(tmp_path.iterdir())
    assert not list(tmp_path.iterdir())


def test_with_keys_only_those_that_may_view_are_told(subscriber):
    ring = KeyRing(desk=["view"], camera=["obstacles"])
    context = subscriber.context
    stranger, camera = context.socket(zmq.SUB), context.socket(zmq.SUB)
    present(subscriber, ring.keys("desk"))
    present(camera, ring.keys("camera"))
    with (
        ring.authenticator() as authenticator,
        FramePublisher("tcp://0.0.0.0:*", authenticator) as publisher,
    ):
        for one in (subscriber, stranger, camera):
            one.subscribe(b"")
            one.connect(publisher.address.replace("0.0.0.0", "127.0.0.1"))
        heard = None
        for sequence in range(1000):
            publisher.publish_frame(make_frame(sequence=sequence))
            time.sleep(0.005)
            if heard is None and subscriber.poll(0):
                heard = sequence
            if heard is not None and sequence > heard + 40:
                break
        assert heard is not None
        assert not stranger.poll(0)
        assert not camera.poll(0)
    stranger.close()
    camera.close()


def test_with_keys_a_view_is_told_what_goes_on_before_the_first_frame(subscriber):
    ring = KeyRing(desk=["view"])
    present(subscriber, ring.keys("desk"))
    with (
        ring.authenticator() as authenticator,
        FramePublisher("tcp://127.0.0.1:*", authenticator) as publisher,
    ):
        subscriber.connect(publisher.address)
        for _ in range(1000):
            publisher.publish_status(StatusMessage(text="Compiling"))
            if subscriber.poll(5):
                break
        assert decode_message(subscriber.recv()).text == "Compiling"
