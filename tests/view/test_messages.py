import math

import msgspec
import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.view import LinkCover, ObstacleShapes, Pairs, VerdictSummary
from armguard.view.messages import (
    FEED_VERSION,
    Balls,
    FeedVersionError,
    StatusMessage,
    decode_message,
    encode_message,
)
from support.view_samples import make_frame, make_scene


def test_a_scene_comes_back_as_it_was():
    scene = make_scene(urdf="/robot.urdf")
    back = decode_message(encode_message(scene))
    assert back == scene
    assert back.cover[0].spheres.shape == (2, 4)


def test_a_frame_comes_back_as_it_was():
    frame = make_frame(math.inf)
    back = decode_message(encode_message(frame))
    assert back == frame
    assert back.verdict.contact_time == math.inf
    assert back.obstacles.counts.tolist() == [1, 2, 8]
    assert back.obstacles.points.shape == (11, 3)
    assert np.allclose(back.obstacles.points[2], (0.2, 0.7, 0.9))
    assert not back.obstacles.refused.any()
    assert back.obstacles.times.tolist() == [math.inf] * 3
    assert back.pairs.links.tolist() == [5]
    assert back.pairs.times.tolist() == [math.inf]


def test_balls_need_no_counts_and_nothing_is_a_frame_too():
    balls = ObstacleShapes.pack(
        ["a", "b"], [[0, 0, 1], [0, 0, 2]], [0.1, 0.2], refused=[False, True]
    )
    assert balls.counts.tolist() == [1, 1]
    assert balls.refused.tolist() == [False, True]
    assert balls.times.tolist() == [math.inf, math.inf]
    assert balls.statics.tolist() == [False, False]
    nothing = make_frame(
        obstacles=ObstacleShapes.pack([], np.zeros((0, 3)), []), pairs=Pairs.pack([], [], [])
    )
    assert decode_message(encode_message(nothing)) == nothing


def test_numbers_of_numpy_are_numbers():
    q = tuple(np.linspace(0, 1, 7))
    frame = make_frame(
        q=q, verdict=VerdictSummary(level="CLEAR", contact_time=q[1], stop_time=q[2])
    )
    assert decode_message(encode_message(frame)).q == q


def make_shapes(counts, points):
    """One obstacle; sound but for these."""
    return ObstacleShapes(("a",), counts, points, bytes(4), b"\0", bytes(4), b"\0")


@pytest.mark.parametrize(
    "broken",
    [
        make_scene(period=math.nan),
        make_scene(period=0.0),
        make_scene(base=(1.0, 0.0)),
        make_scene(cover=(LinkCover("a", "b", b"123"),)),
        make_frame(obstacles=ObstacleShapes(("a",))),
        make_scene(levels=((LinkCover("a", "b", b"123"),),)),
        make_scene(sensors=(("camera", (1.0, 0.0)),)),
        make_frame(obstacles=make_shapes(b"\x02", bytes(12))),
        make_frame(obstacles=make_shapes(b"\x00", b"")),
        make_frame(obstacles=ObstacleShapes(("a",), b"\x01", bytes(12), bytes(4), b"\0", b"\0")),
        make_frame(pairs=Pairs(bytes(2), bytes(4), bytes(4))),
        make_frame(pairs=Pairs(bytes(2), b"\x03\0", bytes(4))),
        make_frame(pairs=Pairs(bytes(2), bytes(2), bytes(4), bytes(60))),
        make_frame(v=(0.0,)),
        make_frame(plan=bytes(4)),
        make_frame(path=bytes(4)),
        make_frame(reach=Balls(bytes(12))),
    ],
)
def test_messages_that_contradict_themselves_are_refused(broken):
    with pytest.raises(ArmguardError, match="feed message"):
        decode_message(encode_message(broken))


def test_no_prefix_and_no_rubbish_is_taken_for_a_message():
    payload = encode_message(make_frame())
    for length in range(len(payload)):
        with pytest.raises(ArmguardError, match="feed message"):
            decode_message(payload[:length])
    for rubbish in (b"\xff" * 50, b"hello", b'{"type": "frame"}', b"\x81\xa4type\xa7unknown"):
        with pytest.raises(ArmguardError, match="feed message"):
            decode_message(rubbish)


def test_a_status_comes_back_as_it_was():
    status = StatusMessage(text="compiling kernel 12 of about 40", is_over=True)
    assert decode_message(encode_message(status)) == status


@pytest.mark.parametrize(
    "payload",
    [
        encode_message(make_scene(version=FEED_VERSION + 1)),
        encode_message(StatusMessage(text="", version=FEED_VERSION + 1)),
        msgspec.msgpack.encode({"type": "cell", "version": FEED_VERSION + 1}),
    ],
)
def test_a_feed_of_a_later_version_is_called_that(payload):
    with pytest.raises(FeedVersionError, match=f"version {FEED_VERSION + 1}"):
        decode_message(payload)
