import json
import math

import msgspec
import numpy as np
import pytest

from armguard.messages.answers import decode_answer, encode_command
from armguard.messages.command import SAME_PLACE, SAME_VELOCITY
from armguard.messages.incoming import MessageError
from armguard.shield import Command
from support.commands_made import COMMAND, TIMES, A, Q, V

ENCODINGS = pytest.mark.parametrize("as_json", [False, True], ids=["msgpack", "json"])
EMPTY = msgspec.structs.replace(COMMAND, times=b"", q=b"", v=b"", a=b"", stop="brake")


@ENCODINGS
def test_commands_survive_the_wire_in_machine_time(as_json):
    found = decode_answer(encode_command(COMMAND, 1000.0, as_json=as_json))
    assert found.stamp == 1001.0
    assert 1001.002 - 1e-9 <= found.take_up_by <= 1001.002
    assert 1001.05 - 1e-9 <= found.valid_until <= 1001.05
    for rows, expected in zip(found.read(), (TIMES, Q, V, A), strict=True):
        assert rows.tolist() == expected.tolist()
    same = {name: getattr(COMMAND, name) for name in ("times", "q", "v", "a", "stamp")}
    times = {"take_up_by": COMMAND.take_up_by, "valid_until": COMMAND.valid_until}
    assert msgspec.structs.replace(found, **same, **times) == COMMAND
    assert COMMAND.stamp == 1.0


@ENCODINGS
def test_a_speed_without_bound_survives_the_wire(as_json):
    fast = msgspec.structs.replace(COMMAND, contact_speed=math.inf)
    assert decode_answer(encode_command(fast, 0.0, as_json=as_json)).contact_speed == math.inf


def test_json_has_lists():
    told = json.loads(encode_command(COMMAND, 0.0, as_json=True), parse_constant=pytest.fail)
    assert told["q"] == Q.tolist()
    assert told["contact_speed"] is None


@ENCODINGS
def test_a_command_without_samples_joins_nothing(as_json):
    found = decode_answer(encode_command(EMPTY, 0.0, as_json=as_json))
    assert [len(rows) for rows in found.read()] == [0] * 4
    assert not found.joins(Q[0], V[0], 1.0)


@pytest.mark.parametrize("field", ["times", "q", "v", "a"])
def test_samples_that_do_not_fit_each_other_are_refused(field):
    short = msgspec.structs.replace(COMMAND, **{field: getattr(COMMAND, field)[:-8]})
    with pytest.raises(MessageError):
        decode_answer(encode_command(short, 0.0))


def test_an_arm_is_where_the_command_in_the_same_process_has_it():
    rows = np.array(TIMES) + 1.0, Q, V, A
    command = Command(*rows, True, 1.05, 0.5, True, None, None, None, None)
    for time in np.linspace(0.98, 1.07, 50):
        for found, expected in zip(COMMAND.at(time), command.at(time), strict=True):
            assert found == pytest.approx(expected, abs=1e-9)


def test_a_motion_is_taken_up_in_time_and_where_it_joins_alone():
    q, v, _ = COMMAND.at(1.001)
    assert COMMAND.joins(q, v, 1.001)
    assert COMMAND.joins(*COMMAND.at(1.002)[:2], 1.002)
    assert not COMMAND.joins(*COMMAND.at(1.0021)[:2], 1.0021)
    assert not COMMAND.joins([q[0], q[1] + 1.1 * SAME_PLACE], v, 1.001)
    assert not COMMAND.joins(q, [v[0] - 1.1 * SAME_VELOCITY, v[1]], 1.001)
    assert not COMMAND.joins([math.nan, q[1]], v, 1.001)
    assert not COMMAND.joins(q, v, math.nan)
