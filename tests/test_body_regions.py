from armguard.body_regions import NEVER_TOUCHED, NUMBERS, REGIONS


def test_numbers_are_places_and_leave_0_for_no_region():
    assert [NUMBERS[region] for region in REGIONS] == list(range(1, len(REGIONS) + 1))
    # A set of regions has to fit into an integer of compiled code.
    assert len(REGIONS) < 63


def test_the_head_and_what_carries_it_may_never_be_touched():
    assert {"head", "face", "neck"} == NEVER_TOUCHED
    assert set(REGIONS) > NEVER_TOUCHED
