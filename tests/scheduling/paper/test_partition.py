"""The slot arithmetic, against tables written by hand and the laws that they follow."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.scheduling.paper.partition import (
    compute_places_in_turn,
    compute_ticks_until_turn,
    make_partition,
)

# Places in turn at ticks 0, 1, 2 … by number of places, worked out on paper.
POWERS = {
    1: "1 | 1 | 1",
    2: "1 2 | 1 | 1 2 | 1",
    3: "1 2 | 1 3 | 1 2 | 1 3",
    7: "1 2 4 | 1 3 5 | 1 2 6 | 1 3 7 | 1 2 4",
    8: "1 2 4 8 | 1 3 5 | 1 2 6 | 1 3 7 | 1 2 4 | 1 3 5 | 1 2 6 | 1 3 7 | 1 2 4 8",
    10: "1 2 4 8 | 1 3 5 9 | 1 2 6 10 | 1 3 7 | 1 2 4 | 1 3 5 | 1 2 6 | 1 3 7 | 1 2 4 8",
    13: "1 2 4 8 | 1 3 5 9 | 1 2 6 10 | 1 3 7 11 | 1 2 4 12 | 1 3 5 13 | 1 2 6 | 1 3 7 | 1 2 4 8",
}
FIBONACCI = {  # buckets {1}, {2, 3}, {4, 5, 6}, {7 … 11}, {12 … 19}
    1: "1 | 1 | 1",
    2: "1 2 | 1 | 1 2 | 1",
    3: "1 2 | 1 3 | 1 2 | 1 3",
    7: "1 2 4 7 | 1 3 5 | 1 2 6 | 1 3 4 | 1 2 5 | 1 3 6 7",
    8: "1 2 4 7 | 1 3 5 8 | 1 2 6 | 1 3 4 | 1 2 5 | 1 3 6 7 | 1 2 4 8",
    10: "1 2 4 7 | 1 3 5 8 | 1 2 6 9 | 1 3 4 10 | 1 2 5 | 1 3 6 7 | 1 2 4 8 | 1 3 5 9",
    13: "1 2 4 7 12 | 1 3 5 8 13 | 1 2 6 9 | 1 3 4 10 | 1 2 5 11 | 1 3 6 7 | 1 2 4 8 | 1 3 5 9"
    " | 1 2 6 10 12",
}
CASES = [
    (law, count, [[int(place) for place in tick.split()] for tick in ticks.split("|")])
    for law, table in (("powers", POWERS), ("fibonacci", FIBONACCI))
    for count, ticks in table.items()
]


def places_in_turn(law, count, tick):
    places = np.zeros(max(count, 1), dtype=np.int64)
    return places[: compute_places_in_turn(make_partition(law), count, tick, places)].tolist()


@pytest.mark.parametrize(("law", "count", "ticks"), CASES)
def test_places_in_turn_are_those_worked_out_by_hand(law, count, ticks):
    for tick, expected in enumerate(ticks):
        assert places_in_turn(law, count, tick) == expected


def test_no_place_is_in_turn_when_there_is_none():
    assert places_in_turn("powers", 0, 5) == []


def test_buckets_of_powers_start_at_powers_and_those_of_fibonacci_follow_each_other():
    powers, fibonacci = make_partition("powers"), make_partition("fibonacci")
    assert powers.bases[:6].tolist() == powers.sizes[:6].tolist() == [1, 2, 4, 8, 16, 32]
    assert fibonacci.sizes[:7].tolist() == [1, 2, 3, 5, 8, 13, 21]
    assert fibonacci.bases[:7].tolist() == [1, 2, 4, 7, 12, 20, 33]
    for partition in (powers, fibonacci):
        assert (partition.bases[1:] == partition.bases[:-1] + partition.sizes[:-1]).all()


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 10, 13, 1000])
def test_the_last_bucket_of_powers_holds_what_the_erratum_says(count):
    k = int(np.floor(np.log2(count)))
    bases = make_partition("powers").bases
    assert np.count_nonzero(bases <= count) == k + 1
    assert count - bases[k] + 1 == count - 2**k + 1


@pytest.mark.parametrize("law", ["powers", "fibonacci"])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 10, 13, 100])
def test_each_place_is_visited_once_in_any_window_of_its_bucket_size(law, count):
    partition = make_partition(law)
    for start in (0, 1, 5, 17, 10**12 + 3):
        for base, size in zip(*partition, strict=True):
            if base > count:
                break
            bucket = set(range(base, min(base + size, count + 1)))
            visits = [p for n in range(start, start + size) for p in places_in_turn(law, count, n)]
            assert sorted(p for p in visits if p in bucket) == sorted(bucket)


@pytest.mark.parametrize("law", ["powers", "fibonacci"])
def test_ticks_until_turn_agree_with_waiting(law):
    partition, count = make_partition(law), 40
    for tick in (0, 1, 6, 33, 1_000_003):
        for base, size in zip(*partition, strict=True):
            for place in range(base, min(base + size, count + 1)):
                waited = 1
                while place not in places_in_turn(law, count, tick + waited):
                    waited += 1
                assert compute_ticks_until_turn(base, size, place, tick) == waited


def test_no_sum_leaves_int64():
    for law in ("powers", "fibonacci"):
        partition = make_partition(law)
        assert (partition.bases > 0).all()
        assert (partition.sizes > 0).all()
        assert int(partition.bases[-1]) + int(partition.sizes[-1]) < 2**62


def test_an_unknown_law_is_named():
    with pytest.raises(ArmguardError, match=r"golden.*powers, fibonacci"):
        make_partition("golden")
