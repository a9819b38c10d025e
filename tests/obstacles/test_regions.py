"""Regions of rows: what is stated of a row, and which limit it has then."""

import math

import numpy as np
import pytest

from armguard.body_regions import NUMBERS, REGIONS
from armguard.exceptions import ObstacleError
from armguard.messages.batch import pack_batch, read_batch
from armguard.messages.incoming import decode, encode
from armguard.obstacles import Obstacles
from armguard.obstacles.faults import FaultKind
from armguard.obstacles.regions import NO_REGION, RegionLimits, make_no_limits, strictest_limit
from armguard.obstacles.table import clear_changed_rows
from armguard.settings.contact_limits import ContactLimits
from support.told_journal import Journal

HAND, FOREARM = 1 << NUMBERS["hand"], 1 << NUMBERS["forearm"]
STILL = [[0.0, 0.0, 0.0]]


def tell(obstacles, stamp=0.0, region=None, ids=("a",), place=2.0, **more):
    points = [[place, float(i), 0.5] for i in range(len(ids))]
    obstacles.update(list(ids), stamp, points, STILL * len(ids), 0.1, region=region, **more)


def regions_of(obstacles, id="a"):
    return int(obstacles.table.regions[obstacles.row(id)])


def make_limits(rng):
    count = len(REGIONS) + 1
    return RegionLimits(*rng.choice([0.0, 0.1, 0.5, 0.9], (4, count)))


def test_the_strictest_of_several_regions_counts():
    rng = np.random.default_rng(5)
    for _ in range(200):
        limits = make_limits(rng)
        numbers = np.flatnonzero(rng.random(len(REGIONS) + 1) < 0.3)
        found = strictest_limit(limits, sum(1 << int(number) for number in numbers))
        if len(numbers):
            each = [strictest_limit(limits, 1 << int(number)) for number in numbers]
            assert found.max_speed == min(one.max_speed for one in each)
            assert found.max_way == min(one.max_way for one in each)
            assert found.thickness == min(one.thickness for one in each)
            assert found.gap == max(one.gap for one in each)
        else:
            assert found == (0.0, 0.0, math.inf, 0.0)


def test_what_is_unknown_may_never_be_touched():
    for limits in (RegionLimits(*ContactLimits({}).tabulate()), make_no_limits()):
        for regions in (0, NO_REGION, HAND, HAND | NO_REGION):
            assert strictest_limit(limits, regions).max_speed == 0.0


def test_a_region_is_of_all_rows_or_of_each():
    obstacles = Obstacles()
    tell(obstacles, region="hand", ids=("a", "b"))
    tell(obstacles, region=["hand", "forearm", ""], ids=("c", "d", "e"))
    tell(obstacles, region=np.array(["forearm"]), ids=("f",))
    tell(obstacles, ids=("g",))
    found = [regions_of(obstacles, id) for id in "abcdefg"]
    assert found == [HAND, HAND, HAND, FOREARM, NO_REGION, FOREARM, NO_REGION]


def test_patterns_and_messages_count_together():
    obstacles = Obstacles(regions={"*_hand": "hand"})
    ids = ("left_hand", "box")
    for _ in range(2):  # the second time ids are remembered
        tell(obstacles, ids=ids)
        assert [regions_of(obstacles, id) for id in ids] == [HAND, NO_REGION]
    tell(obstacles, 0.1, region="forearm", ids=ids)
    assert [regions_of(obstacles, id) for id in ids] == [HAND | FOREARM, NO_REGION | FOREARM]


def test_a_set_only_grows_until_the_row_goes():
    obstacles = Obstacles()
    expected = 0
    for k, region in enumerate(["hand", "forearm", None, "hand", "chest"]):
        tell(obstacles, 0.1 * k, region=region)
        expected |= NO_REGION if region is None else 1 << NUMBERS[region]
        assert regions_of(obstacles) == expected
    obstacles.remove(["a"], 1.0)
    tell(obstacles, 1.1, region="hand")
    assert regions_of(obstacles) == HAND


@pytest.mark.parametrize(
    ("stamp", "place", "is_refused"),
    [
        (0.1, 2.0, False),
        (0.1, 9.0, True),  # a jump
        (0.1, math.nan, True),
        (-0.1, 2.0, False),  # late
        (0.0, 2.0, False),  # again
    ],
)
def test_each_sample_that_states_another_region_ends_what_was_proved(stamp, place, is_refused):
    obstacles = Obstacles()
    table = obstacles.table
    tell(obstacles, region="hand")
    row = obstacles.row("a")
    clear_changed_rows(table.changed_rows)
    revision = int(table.revision[row])
    tell(obstacles, stamp, region="forearm", place=place)
    assert bool(obstacles.take_faults()) == is_refused
    assert table.changed[: table.changed_count[0]].tolist() == [row]
    assert table.revision[row] > revision
    assert regions_of(obstacles) == HAND | FOREARM


def test_a_row_that_keeps_its_region_is_not_changed_by_it():
    obstacles = Obstacles()
    tell(obstacles, region="hand")
    row = obstacles.row("a")
    # As if a scheduler had made it the state that certificates rest on.
    table = obstacles.table
    for before, after in zip(table.accepted, table.reference_states, strict=True):
        after[row] = before[row]
    clear_changed_rows(table.changed_rows)
    for k in range(1, 5):
        tell(obstacles, 0.01 * k, region="hand")
        assert table.changed_count[0] == 0
    tell(obstacles, 0.05, region="forearm")
    assert table.changed[: table.changed_count[0]].tolist() == [row]


def test_what_is_no_person_has_no_region():
    obstacles = Obstacles(regions={"*": "hand"})
    obstacles.add_static("post", [1.0, 0.0, 0.0], 0.1)
    obstacles.add_entrance("door", [3.0, 0.0, 0.0], 0.1, 0.1, speed=1.6)
    obstacles.update_cloud("depth", 0.0, [[1.0, 1.0, 1.0]], [0.0, 0.0, 0.0])
    rng = np.random.default_rng(3)
    limits = make_limits(rng)
    limits.max_speed[:] = 0.9
    limits.max_speed[0] = 0.0
    assert len(obstacles) == 3
    for id in obstacles.ids:
        if id:
            assert strictest_limit(limits, regions_of(obstacles, id)).max_speed == 0.0


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ("paw", "region: is 'paw'; expected one of head, face"),
        ("Hand", "region: is 'Hand'"),
        (["hand", "paw"], "region: is 'paw'"),
        (["hand", None], "region: is None"),
        (["hand", ["hand"]], r"region: is \['hand'\]"),
        (["hand"], "region: has 1 texts for 2 ids; expected one text or 2"),
        ([], "region: has 0 texts for 2 ids"),
        (3, "region: is 3"),
        (b"hand", "region: is 104"),
    ],
)
def test_an_unknown_region_refuses_the_call(region, message):
    obstacles = Obstacles()
    with pytest.raises(ObstacleError, match=message):
        tell(obstacles, region=region, ids=("a", "b"))
    assert len(obstacles) == 0
    (fault,) = obstacles.take_faults()
    assert (fault.kind, fault.field) == (FaultKind.MALFORMED, "region")


@pytest.mark.parametrize("region", [None, "hand", ["hand", ""], ("forearm", "hand")])
def test_a_journal_has_what_makes_the_same_sets_again(region):
    patterns = {"b": "chest"}
    obstacles, other = Obstacles(regions=patterns), Obstacles(regions=patterns)
    obstacles.journal = Journal()
    tell(obstacles, region=region, ids=("a", "b"))
    ((_, (batch,), _),) = obstacles.journal.told
    other.take(read_batch(decode(encode(pack_batch(batch)))))
    assert other.settings == obstacles.settings
    assert other.table.regions.tobytes() == obstacles.table.regions.tobytes()
