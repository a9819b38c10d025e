import json
import math
import sys

import msgspec
import numpy as np
import pytest

from armguard.contact import Certificate
from armguard.messages.answers import decode_answer, encode_plan_verdict, encode_verdict
from armguard.messages.incoming import MessageError, ObstaclesMessage, encode
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, Verdict

VERDICT = Verdict(
    stamp=1.0,
    sequence=7,
    level=Level.SLOW,
    contact_time=math.inf,
    stop_time=0.1,
    speed_scale=0.5,
    link="hand",
    obstacle=None,
    complete=True,
    evaluated=12,
    reasons=(Reason(ReasonKind.CONTACT, "hand and person", "in 0.2 s"),),
    valid_until=1.003,
    harm_time=math.inf,
)


ENCODINGS = pytest.mark.parametrize("as_json", [False, True], ids=["msgpack", "json"])


@ENCODINGS
@pytest.mark.parametrize("reason", [None, Reason(ReasonKind.LATE_DATA, "camera", "182 ms old")])
def test_what_holds_a_level_arrives_on_the_clock_of_the_wire(reason, as_json):
    held = Held(reason, math.inf, 0.25, 10.0, 10.5)
    data = encode_verdict(VERDICT._replace(held=held), 4.0, as_json=as_json)
    assert decode_answer(data).held == held._replace(since=14.0, rises_at=14.5)


@ENCODINGS
def test_verdicts_survive_the_wire_in_machine_time(as_json):
    verdict = decode_answer(encode_verdict(VERDICT, 1000.0, as_json=as_json))
    assert verdict._replace(stamp=1.0, valid_until=1.003) == VERDICT
    assert verdict.stamp == 1001.0
    assert 1001.003 - 1e-9 <= verdict.valid_until < 1001.003 + 1e-15


def test_json_has_the_same_fields_and_no_number_that_json_lacks():
    endless = VERDICT._replace(contact_time=math.inf, stop_time=math.inf, separation=-math.inf)
    data = encode_verdict(endless, 0.0, as_json=True)
    told = json.loads(data, parse_constant=pytest.fail)
    packed = msgspec.msgpack.decode(encode_verdict(VERDICT, 0.0))
    assert told.keys() == packed.keys()
    assert told["contact_time"] == told["stop_time"] == -told["separation"] == sys.float_info.max
    found = decode_answer(data)
    assert (found.contact_time, found.stop_time) == (math.inf, math.inf)
    assert found.separation == -math.inf


@ENCODINGS
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e308, -1e308])
def test_a_stop_is_read_whatever_its_numbers_are(number, as_json):
    names = "stamp", "contact_time", "stop_time", "speed_scale", "harm_time"
    proof = Certificate(number, np.array([number, 1.0]), np.array([[number, 0.0, 1.0]] * 2))
    changes = dict.fromkeys([*names, "valid_until", "separation"], number)
    stop = VERDICT._replace(level=Level.STOP, certificate=proof, **changes)
    data = encode_verdict(stop, 1000.0, as_json=as_json)
    if as_json:
        told = json.loads(data, parse_constant=pytest.fail)
        assert (told["stamp"] is None) == math.isnan(number)
    found = decode_answer(data)
    assert found.level is Level.STOP
    assert found.reasons == stop.reasons
    for name in names:
        assert getattr(found, name) == pytest.approx(number, rel=1e-9, nan_ok=True)
    assert math.isnan(found.valid_until) == math.isnan(number)  # others are rounded down
    assert found.separation in (number, None) or math.isnan(found.separation)
    assert (found.separation is None) == (as_json and math.isnan(number))
    assert found.certificate.times == pytest.approx([number, 1.0], nan_ok=True)
    number, answer = decode_answer(
        encode_plan_verdict(7, PlanVerdict(False, number, None, None, ()), as_json=as_json)
    )
    assert (number, answer.safe) == (7, False)


@pytest.mark.parametrize("field", ["stamp", "valid_until", "speed_scale", "harm_time"])
def test_a_number_of_a_verdict_may_be_null_but_not_missing(field):
    told = json.loads(encode_verdict(VERDICT, 0.0, as_json=True))
    assert math.isnan(getattr(decode_answer(json.dumps(told | {field: None}).encode()), field))
    del told[field]
    with pytest.raises(MessageError):
        decode_answer(json.dumps(told).encode())


@ENCODINGS
def test_answers_to_plans_survive_the_wire(as_json):
    yes = PlanVerdict(True, math.inf, None, None, ())
    no = PlanVerdict(False, 0.25, "hand", "ball", (Reason(ReasonKind.CONTACT, "ball", "near"),))
    for answer in (yes, no):
        assert decode_answer(encode_plan_verdict(7, answer, as_json=as_json)) == (7, answer)


@pytest.mark.parametrize("margin", [0.25, -0.5, math.inf, -math.inf, None])
def test_the_margin_of_the_separation_distance_survives_the_wire(margin):
    data = encode_verdict(VERDICT._replace(separation=margin), 0.0)
    assert decode_answer(data).separation == margin
    assert msgspec.msgpack.decode(data)["separation"] == margin


@ENCODINGS
def test_until_when_a_piece_is_proved_is_told_on_the_machines_clock(as_json):
    on_it = VERDICT._replace(level=Level.AWARE, proved_until=12.5)
    found = decode_answer(encode_verdict(on_it, 0.25, as_json=as_json))
    assert (found.proved_until, found.stamp) == (12.75, VERDICT.stamp + 0.25)
    assert decode_answer(encode_verdict(VERDICT, 0.25, as_json=as_json)).proved_until is None


@ENCODINGS
@pytest.mark.parametrize("harm_time", [0.0, 0.125, math.inf])
@pytest.mark.parametrize("contact_speed", [0.0, 0.21, math.inf, None])
def test_what_contact_limits_permit_survives_the_wire(contact_speed, harm_time, as_json):
    reasons = (
        Reason(ReasonKind.IN_CONTACT, "panda_hand and left_hand", "since 12.5"),
        Reason(ReasonKind.MOVED_BY_CONTACT, "panda_joint4", "by 0.02 rad"),
        Reason(ReasonKind.CONTACT_ALLOWED, "hand and arm", "at most 0.21 of 0.9 m/s (arm: a test)"),
    )
    permitted = VERDICT._replace(
        contact_time=0.0, harm_time=harm_time, contact_speed=contact_speed, reasons=reasons
    )
    data = encode_verdict(permitted, 0.0, as_json=as_json)
    found = decode_answer(data)
    assert found._replace(valid_until=VERDICT.valid_until) == permitted
    if as_json:
        json.loads(data, parse_constant=pytest.fail)


@pytest.mark.parametrize("field", ["harm_time", "contact_speed"])
@ENCODINGS
def test_a_verdict_of_an_older_monitor_is_refused_by_what_it_lacks(field, as_json):
    code = msgspec.json if as_json else msgspec.msgpack
    told = code.decode(encode_verdict(VERDICT, 0.0, as_json=as_json))
    del told[field]
    with pytest.raises(MessageError, match=rf"{field}.*a verdict of this version"):
        decode_answer(code.encode(told))


@ENCODINGS
def test_certificates_survive_the_wire(as_json):
    proof = Certificate(0.3, np.array([0.0, 0.1]), np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]]))
    data = encode_verdict(VERDICT._replace(certificate=proof), 0.0, as_json=as_json)
    found = decode_answer(data).certificate
    assert found.contact_time == proof.contact_time
    assert (found.times == proof.times).all()
    assert (found.witnesses == proof.witnesses).all()


@pytest.mark.parametrize("data", [b"", b"\xc0", b"{}", encode(ObstaclesMessage([], 0.0))])
def test_what_is_no_verdict_is_refused(data):
    with pytest.raises(MessageError):
        decode_answer(data)


def test_a_verdict_of_an_unknown_level_is_refused():
    fields = msgspec.msgpack.decode(encode_verdict(VERDICT, 0.0))
    with pytest.raises(MessageError):
        decode_answer(msgspec.msgpack.encode({**fields, "level": "GO"}))


@pytest.mark.parametrize("as_json", [True, False])
def test_the_configuration_is_told_by_who_publishes(as_json):
    for told in (None, "0123456789abcdef"):
        data = encode_verdict(VERDICT, 0.0, configuration=told, as_json=as_json)
        assert decode_answer(data).configuration == told
