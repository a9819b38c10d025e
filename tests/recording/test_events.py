import json
import math

import msgspec
import numpy as np
import pytest

from armguard.contact.earliest import Certificate
from armguard.recording.events import (
    KINDS,
    TOPICS,
    Log,
    VerdictTold,
    encode,
    make_schema,
    read_field,
    read_verdict,
    schema_name,
    tell_answer,
    tell_verdict,
    write_field,
)
from armguard.recording.scene import SceneUpdate
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, Verdict

PLAIN = {"object", "array", "string", "number", "integer", "boolean"}
VERDICT = Verdict(
    stamp=0.1 + 0.2,
    sequence=3,
    level=Level.SLOW,
    contact_time=math.inf,
    stop_time=-0.0,
    speed_scale=math.nan,
    link="panda_hand",
    obstacle="naïve “id”\n",
    complete=False,
    evaluated=12,
    reasons=(Reason(ReasonKind.HOLD), Reason(ReasonKind.CONTACT, "a and b", "in 1 s")),
    valid_until=1e-300,
)
PROOF = Certificate(0.25, np.array([0.1, math.inf]), np.array([[1.0, 0.0, -0.0], [0.0, 0.6, 0.8]]))


def same(one, other):
    """Whether they are equal to the bit, NaN included."""
    return repr(one) == repr(other)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"link": None, "obstacle": None, "level": Level.STOP, "stop": "brake"},
        {"separation": -0.125, "stop": "finish", "certificate": PROOF},
        {"reasons": (), "contact_time": np.float64(0.3), "complete": np.True_},
        {"held": Held(None, math.inf, 0.25, 1.5, 2.0)},
        {"held": Held(Reason(ReasonKind.CONTACT, "a and b", "in 1 s"), 0.1, 0.25, 1.5, 2.0)},
    ],
)
def test_a_verdict_is_read_back_to_the_bit(changes):
    verdict = VERDICT._replace(**changes)
    told = msgspec.json.decode(encode(tell_verdict(verdict)), type=VerdictTold)
    again = read_verdict(told)
    for name, value in verdict._asdict().items():
        found = getattr(again, name)
        if isinstance(value, np.generic):
            value = value.item()
        assert same(found, value), name
    assert encode(tell_verdict(again)) == encode(tell_verdict(verdict))


def test_verdicts_that_differ_in_one_bit_are_told_apart():
    other = VERDICT._replace(stamp=math.nextafter(VERDICT.stamp, 1.0))
    assert encode(tell_verdict(other)) != encode(tell_verdict(VERDICT))
    other = VERDICT._replace(stop_time=0.0)
    assert encode(tell_verdict(other)) != encode(tell_verdict(VERDICT))


@pytest.mark.parametrize("changes", [{"level": "FAST"}, {"reasons": [{"kind": "whim"}]}])
def test_a_verdict_of_another_version_is_refused(changes):
    data = json.loads(encode(tell_verdict(VERDICT))) | changes
    for reason in data["reasons"]:
        reason |= {"subject": "", "detail": ""}
    with pytest.raises(ValueError, match=r"FAST|whim"):
        read_verdict(msgspec.convert(data, VerdictTold))


def test_the_answer_to_a_plan_is_told():
    reason = Reason(ReasonKind.PLAN_REFUSED, "q", "is odd")
    data = json.loads(encode(tell_answer(PlanVerdict(False, 0.0, None, None, (reason,)))))
    assert data["reasons"] == [{"kind": "plan_refused", "subject": "q", "detail": "is odd"}]
    assert "link" not in data


def walk(schema):
    assert schema["type"] in PLAIN
    if schema["type"] == "array":
        assert schema["items"]["type"] != "array", "no lists of lists"
        walk(schema["items"])
    for field in schema.get("properties", {}).values():
        walk(field)


@pytest.mark.parametrize("kind", [*KINDS, SceneUpdate])
def test_schemas_keep_to_what_viewers_understand(kind):
    schema = make_schema(kind)
    assert schema["type"] == "object"
    assert set(schema["required"]) <= set(schema["properties"])
    walk(schema)


def test_each_kind_has_a_topic_and_a_schema_of_its_own():
    assert len(set(TOPICS.values())) == len(KINDS) == len({schema_name(kind) for kind in KINDS})
    assert schema_name(Log) == "foxglove.Log"


def test_a_field_that_is_the_same_for_all_is_written_once():
    for values in ([1.0, 1.0, 1.0], [0.0, -0.0], [math.nan, math.nan], [], [2.0], [1.0, 2.0]):
        array = np.array(values, dtype=float)
        listed = write_field(array)
        assert len(listed) == (1 if values in ([1.0] * 3, [math.nan] * 2) else len(values))
        assert read_field(listed, len(values)).tobytes() == array.tobytes()
