import math

import numpy as np
import pytest
from msgspec import UNSET

from armguard.contact.earliest import Certificate
from armguard.obstacles.message import ToldSamples
from armguard.recording.events import encode
from armguard.recording.inputs import tell_state
from armguard.recording.packing import (
    FRAME,
    STATE,
    UPDATE,
    Heading,
    ToldState,
    ToldUpdate,
    ToldVerdict,
    pack_body,
    pack_state,
    pack_update,
    pack_verdict,
    read_state,
    read_update,
    unpack_verdict,
)
from armguard.verdict import Level, Reason, ReasonKind, Verdict

HEADINGS = {3: Heading(["a", "b"], "camera", "tilted"), 4: Heading([], "camera", "world")}
ODD = [-0.0, 5e-324, 1.7976931348623157e308, math.inf, -math.inf, math.nan, 0.1]
TOLD_ODD = [-0.0, 5e-324, 1.7976931348623157e308, "Infinity", "-Infinity", "NaN", 0.1]


@pytest.mark.parametrize("q", [np.array(ODD), np.full(7, 1.7e308), np.arange(14.0)[::2]])
def test_a_state_is_written_as_its_arguments_are(q):
    arguments = 1.5, q, q[::-1], math.inf
    data = pack_state(ToldState(7, *arguments), (7,))
    assert FRAME.unpack_from(data) == (STATE, 7)
    assert encode(read_state(data)) == encode(tell_state(*arguments, 7))


@pytest.mark.parametrize(
    "arguments",
    [
        (1, np.zeros(2), np.zeros(2), 0.0),
        (0.0, np.zeros(3), np.zeros(2), 0.0),
        (0.0, np.zeros(2), np.zeros(2, np.float32), 0.0),
        (0.0, np.zeros(2, ">f8"), np.zeros(2), 0.0),
        (0.0, [0.0, 0.0], np.zeros(2), 0.0),
        (0.0, np.ma.zeros(2), np.zeros(2), 0.0),
        (0.0, np.zeros(2), np.zeros(2), np.float64(0.0)),
    ],
)
def test_whatever_is_not_as_usual_is_left_to_what_looks_closer(arguments):
    assert pack_state(ToldState(7, *arguments), (2,)) is None


def pack(heading, samples, *, has_velocity=False, has_accel=False, has_speed=False, snapshot=False):
    body = pack_body(
        1.5,
        samples,
        has_velocity=has_velocity,
        has_accel=has_accel,
        has_speed=has_speed,
        snapshot=snapshot,
    )
    return pack_update(ToldUpdate(7, HEADINGS[heading], body), heading)


def test_an_update_is_written_as_lists_and_numbers_that_hold_for_all():
    room = np.zeros((64, 8, 3))
    room[:2, :2] = np.arange(12.0).reshape(2, 2, 3)
    room[0, 0, 0] = math.nan
    samples = ToldSamples(
        2, room[:2, :2], -room[:2, :2], np.array([0.1, 0.2]), np.array([3.0, 4.0]), 2.0,
        np.array([0.5, 0.5]), math.inf,
    )  # fmt: skip
    data = pack(3, samples, snapshot=True)
    assert FRAME.unpack_from(data) == (UPDATE, 7)
    event = read_update(data, HEADINGS)
    assert (event.ids, event.stamp, event.source, event.frame) == (
        ["a", "b"],
        1.5,
        "camera",
        "tilted",
    )
    assert (event.points, event.snapshot) == (2, True)
    assert event.position == ["NaN", *map(float, range(1, 12))]
    assert (event.radius, event.position_error) == ([0.1, 0.2], [0.5])
    assert event.velocity is event.accel is event.speed is UNSET, "they were not given"
    assert event.velocity_error == [], "made up by the table"
    event = read_update(
        pack(3, samples, has_velocity=True, has_accel=True, has_speed=True), HEADINGS
    )
    assert event.velocity == ["NaN", *map(float, range(-1, -12, -1))]
    assert (event.accel, event.speed) == ([3.0, 4.0], [2.0])
    assert (event.velocity_error, event.snapshot) == (["Infinity"], False)


def test_an_update_without_ids_has_no_numbers():
    samples = ToldSamples(1, np.zeros((0, 1, 3)), np.zeros((0, 1, 3)), 0.1, 1.0, 1.0, 0.0, 0.0)
    event = read_update(pack(4, samples, has_velocity=True), HEADINGS)
    assert event.ids == event.position == event.velocity == event.radius == []
    assert event.position_error == event.velocity_error == []


def test_a_verdict_is_read_as_it_was():
    proof = Certificate(0.5, np.array([0.0, 0.2]), np.arange(6.0).reshape(2, 3))
    verdict = Verdict(
        1.0, 3, Level.SLOW, math.inf, 0.1, np.float64(0.5), "hand", "ball", True, 12,
        (Reason(ReasonKind.CONTACT, "hand and ball", "in 0.5 s"),), math.nan, 0.25, proof, "brake",
    )  # fmt: skip
    data = pack_verdict(ToldVerdict(7, verdict))
    assert FRAME.unpack_from(data)[1] == 7
    assert repr(unpack_verdict(data)) == repr(verdict._replace(speed_scale=0.5))
    verdict = verdict._replace(certificate=None)
    assert unpack_verdict(pack_verdict(ToldVerdict(7, verdict))).certificate is None
