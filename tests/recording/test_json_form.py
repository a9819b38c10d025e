import json
import math

import numpy as np
import pytest

from armguard.messages.answers import VerdictMessage, read_verdict, to_verdict_message
from armguard.messages.incoming import ObstaclesMessage
from armguard.recording.events import KINDS, JointState
from armguard.recording.json_form import make_schema, read_json, write_json
from armguard.recording.scene import SceneUpdate
from support.recorded_messages import MESSAGES, VERDICT, VERDICTS

PLAIN = {"object", "array", "string", "number", "integer", "boolean"}


@pytest.mark.parametrize("message", MESSAGES, ids=lambda one: type(one).__name__)
def test_messages_are_read_back_to_the_bit(message):
    data = write_json(message)
    again = read_json(type(message), data)
    assert repr(again) == repr(message)
    assert write_json(again) == data
    json.loads(data, parse_constant=pytest.fail)


def test_each_kind_is_among_them():
    assert set(map(type, MESSAGES)) == set(KINDS)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_verdict_is_read_back_to_the_bit(verdict):
    told = verdict._replace(contact_time=np.float64(0.3), complete=np.True_)
    again = read_verdict(read_json(VerdictMessage, write_json(to_verdict_message(told))))
    assert repr(again) == repr(verdict._replace(contact_time=0.3, complete=True))


def test_verdicts_that_differ_in_one_bit_are_told_apart():
    data = write_json(to_verdict_message(VERDICT))
    for changes in ({"stamp": math.nextafter(VERDICT.stamp, 1.0)}, {"stop_time": 0.0}):
        assert write_json(to_verdict_message(VERDICT._replace(**changes))) != data


@pytest.mark.parametrize("changes", [{"level": "FAST"}, {"reasons": [{"kind": "whim"}]}])
def test_a_verdict_of_another_version_is_refused(changes):
    data = json.loads(write_json(to_verdict_message(VERDICT))) | changes
    for reason in data["reasons"]:
        reason |= {"subject": "", "detail": ""}
    with pytest.raises(ValueError, match=r"FAST|whim"):
        read_verdict(read_json(VerdictMessage, json.dumps(data).encode()))


def test_numbers_stand_in_flat_lists_and_words():
    odd = np.array([[math.nan, 0.0, math.inf], [1.0, 2.0, -math.inf]])
    radius = np.array([0.1, 0.2])
    message = ObstaclesMessage(
        ["a", "b"], 1.5, position=odd.tobytes(), radius=radius.tobytes(), speed=2.0
    )
    told = json.loads(write_json(message))
    assert told["position"] == ["NaN", 0.0, "Infinity", 1.0, 2.0, "-Infinity"]
    assert (told["radius"], told["speed"]) == ([0.1, 0.2], [2.0]), "one alone holds for all"
    assert not {"velocity", "accel", "seq", "region"} & set(told)


@pytest.mark.parametrize(
    ("region", "written"), [("hand", ["hand"]), (["hand", ""], ["hand", ""]), (None, None)]
)
def test_texts_stand_in_lists(region, written):
    message = ObstaclesMessage(["a", "b"], 1.5, position=bytes(48), region=region)
    told = json.loads(write_json(message))
    assert told.get("region") == written
    assert read_json(ObstaclesMessage, write_json(message)).region == region
    assert make_schema(ObstaclesMessage)["properties"]["region"]["items"] == {"type": "string"}


@pytest.mark.parametrize(
    "change", [{"q": ["soon"]}, {"q": 3}, {"q": [[1.0], []]}, {"names": 1}, {"now": {}}, {"x": 1}]
)
def test_what_is_no_such_message_is_refused(change):
    state = JointState(0.0, ["a"], bytes(8), bytes(8), now=0.0)
    data = json.dumps(json.loads(write_json(state)) | change).encode()
    with pytest.raises(ValueError, match=r"\w"):
        read_json(JointState, data)
    for data in (b"[]", b"3", b'"q"', b"{", b"{}"):
        with pytest.raises(ValueError, match=r"\w"):
            read_json(JointState, data)


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
