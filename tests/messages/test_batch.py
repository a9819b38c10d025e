import math

import numpy as np
import pytest

from armguard.messages.batch import ObstacleBatch, pack_batch, read_batch
from armguard.messages.incoming import MessageError, ObstaclesMessage, decode, encode
from armguard.obstacles import Obstacles
from support.told_journal import Journal


def make_batch(**changes):
    position = np.arange(12.0).reshape(2, 2, 3)
    position[0, 0, 0] = math.nan
    batch = ObstacleBatch(
        *(["a", "b"], 1.5, position, -position, np.array([0.1, 0.2]), np.array([3.0, 4.0])),
        *(2.0, np.array([0.5, 0.5]), math.inf, "camera", "world", True),
    )
    return batch._replace(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"velocity": None, "accel": None, "speed": None},
        {"ids": [], "position": np.zeros((0, 3)), "velocity": None, "radius": 0.0, "accel": None},
    ],
)
def test_a_batch_is_read_from_its_message_to_the_bit(changes):
    batch = make_batch(**changes)
    if not batch.ids:
        batch = batch._replace(position_error=0.0)
    again = read_batch(decode(encode(pack_batch(batch))))
    assert repr(again) == repr(batch)


def test_a_message_with_lists_is_the_same_batch():
    batch = make_batch()
    lists = {
        name: value.tolist()
        for name, value in batch._asdict().items()
        if isinstance(value, np.ndarray)
    }
    message = ObstaclesMessage(**(batch._asdict() | lists))
    assert repr(read_batch(message)) == repr(batch)


@pytest.mark.parametrize("field", ["position", "velocity", "radius", "accel", "position_error"])
def test_numbers_that_do_not_fit_the_ids_are_refused(field):
    message = pack_batch(make_batch())
    setattr(message, field, getattr(message, field)[:-8])
    with pytest.raises(MessageError, match=field):
        read_batch(message)


def test_what_a_table_makes_of_a_call_it_takes_again():
    obstacles, other = Obstacles(), Obstacles()
    obstacles.journal = Journal()
    position = np.arange(6.0).reshape(2, 3)
    obstacles.update(["a", "b"], 1, position, radius=[0.1, 0.2], speed=1.0, source="camera")
    ((_, (batch,), _),) = obstacles.journal.told
    other.update(*read_batch(pack_batch(batch)))
    for name in ("points", "radius", "speed", "accel", "stamp"):
        one, again = getattr(obstacles.table, name), getattr(other.table, name)
        assert one.tobytes() == again.tobytes()
