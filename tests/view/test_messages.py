import math

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.view import LinkCover, ObstacleShapes, Pairs, VerdictSummary
from armguard.view.messages import decode_message, encode_message
from support.view_samples import make_frame, make_scene


def test_a_scene_comes_back_as_it_was():
    scene = make_scene(locked={"panda_finger_joint1": 0.02}, urdf="/robot.urdf")
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
    assert back.pairs.segments.shape == (1, 2, 3)


def test_balls_need_no_counts_and_nothing_is_a_frame_too():
    balls = ObstacleShapes.pack(
        ["a", "b"], [[0, 0, 1], [0, 0, 2]], [0.1, 0.2], refused=[False, True]
    )
    assert balls.counts.tolist() == [1, 1]
    assert balls.refused.tolist() == [False, True]
    assert balls.buckets.tolist() == [255, 255]
    nothing = make_frame(
        obstacles=ObstacleShapes.pack([], np.zeros((0, 3)), []), pairs=Pairs.pack([], [])
    )
    assert decode_message(encode_message(nothing)) == nothing


def test_numbers_of_numpy_are_numbers():
    q = tuple(np.linspace(0, 1, 7))
    frame = make_frame(
        q=q, verdict=VerdictSummary(level="CLEAR", contact_time=q[1], stop_time=q[2])
    )
    assert decode_message(encode_message(frame)).q == q


@pytest.mark.parametrize(
    "broken",
    [
        make_scene(period=math.nan),
        make_scene(period=0.0),
        make_scene(base=(1.0, 0.0)),
        make_scene(cover=(LinkCover("a", "b", b"123"),)),
        make_frame(obstacles=ObstacleShapes(("a",))),
        make_frame(obstacles=ObstacleShapes(("a",), b"\x02", bytes(12), bytes(4), b"\0", b"\0")),
        make_frame(obstacles=ObstacleShapes(("a",), b"\x00", b"", bytes(4), b"\0", b"\0")),
        make_frame(pairs=Pairs(bytes(24), b"\0\0")),
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
