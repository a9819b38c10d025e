"""Pairs that are never watched: by link, pattern of ids and source."""

import pytest

from armguard.exceptions import ArmguardError
from armguard.pairs.ignored import IgnoredPairs
from support.panda_monitor import panda

LINKS = panda().links


def ignored(pairs, obstacle):
    watched = IgnoredPairs(pairs, panda()).watched_links(obstacle)
    return {link for link, one in zip(LINKS, watched, strict=True) if not one}


def test_patterns_fit_whole_ids_and_mind_capitals():
    pairs = [("panda_link1", "table*"), ("panda_hand", "part-?")]
    assert ignored(pairs, "table") == ignored(pairs, "table-2") == {"panda_link1"}
    assert ignored(pairs, "part-1") == {"panda_hand"}
    for other in ("Table", "a table", "part-10", ""):
        assert ignored(pairs, other) == set()


@pytest.mark.parametrize(
    "wrong",
    [
        "panda_hand",
        ("panda_hand",),
        ("panda_hand", 3),
        ("panda_link0", "*"),
        ("", "*"),
        5,
        ("panda_hand", "part", 3),
        ("panda_hand", "part", None),
        ("panda_hand", "part", "camera", "more"),
    ],
)
def test_what_is_no_pair_is_refused(wrong):
    with pytest.raises(ArmguardError, match="ignore"):
        IgnoredPairs([wrong], panda())


def test_what_is_no_list_is_refused():
    with pytest.raises(ArmguardError, match="ignore"):
        IgnoredPairs(5, panda())


@pytest.mark.parametrize("every", ["*", "**", "?*", "*?*"])
def test_entries_that_leave_nothing_to_watch_are_refused(every):
    """In one entry or in many; those that leave something are not."""
    each = [(link, every) for link in LINKS]
    for entries in ([("*", every)], [("panda_hand", "part"), *each]):
        with pytest.raises(ArmguardError, match="leaves nothing to watch") as caught:
            IgnoredPairs(entries, panda())
        assert repr(list(entries[-1])) in caught.value.offender
        assert caught.value.remedy
    some = IgnoredPairs(each[1:], panda())
    assert some.watched_links("ball").tolist() == [True] + [False] * (len(LINKS) - 1)
    # Nothing is waited for: this one fits whatever comes.
    assert some.unmatched == []
    IgnoredPairs([("*", "??*"), ("*", "[ab]*")], panda())
    IgnoredPairs([("*", "*", "camera")], panda(), ["camera"])


def test_a_source_says_whose_obstacles_are_meant():
    pairs = IgnoredPairs([("*", "part*", "camera")], panda(), ["scanner", "camera"])
    assert not pairs.watched_links("part1", "camera").any()
    for source in ("scanner", ""):
        assert pairs.watched_links("part1", source).all()
    assert pairs.watched_links("ball", "camera").all()
    assert pairs.unmatched == []


@pytest.mark.parametrize("sources", [[], ["scanner", "lidar"]])
def test_a_source_must_be_there_and_the_others_are_listed(sources):
    with pytest.raises(ArmguardError, match="'camera'") as caught:
        IgnoredPairs([("*", "part*", "camera")], panda(), sources)
    assert all(name in caught.value.expected for name in sources)


def test_patterns_wait_for_one_match_each():
    pairs = IgnoredPairs([(link, "table") for link in LINKS] + [("*", "cart?")], panda())
    assert pairs.unmatched == ["table", "cart?"]
    pairs.watched_links("ball")
    assert pairs.unmatched == ["table", "cart?"]
    pairs.watched_links("cart7")
    assert pairs.unmatched == ["table"]
    pairs.watched_links("table")
    assert pairs.unmatched == []
    assert "no obstacles" in pairs.describe_unmatched(["", ""])
    told = pairs.describe_unmatched(["", *"abcdefg"])
    assert "a, b, c, d, e, …" in told
    assert "f" not in told.split(";")[0].split()
