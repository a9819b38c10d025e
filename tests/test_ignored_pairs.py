import pytest
from scenes import panda

from armguard.exceptions import ArmguardError
from armguard.ignored_pairs import IgnoredPairs

LINKS = panda().links


def ignored(pairs, obstacle):
    watched = IgnoredPairs(pairs, panda()).watched_links(obstacle)
    return {link for link, one in zip(LINKS, watched, strict=True) if not one}


def test_nothing_is_ignored_unless_said():
    assert ignored([], "table") == set()


def test_patterns_fit_whole_ids_and_mind_capitals():
    pairs = [("panda_link1", "table*"), ("panda_hand", "part-?")]
    assert ignored(pairs, "table") == ignored(pairs, "table-2") == {"panda_link1"}
    assert ignored(pairs, "part-1") == {"panda_hand"}
    for other in ("Table", "a table", "part-10", ""):
        assert ignored(pairs, other) == set()


def test_a_star_is_any_link():
    assert ignored([("*", "floor")], "floor") == set(LINKS)


@pytest.mark.parametrize(
    "wrong", ["panda_hand", ("panda_hand",), ("panda_hand", 3), ("panda_link0", "*"), ("", "*"), 5]
)
def test_what_is_no_pair_is_refused(wrong):
    with pytest.raises(ArmguardError, match="ignore"):
        IgnoredPairs([wrong], panda())


def test_what_is_no_list_is_refused():
    with pytest.raises(ArmguardError, match="ignore"):
        IgnoredPairs(5, panda())
