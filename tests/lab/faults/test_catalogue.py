import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.faults.catalogue import SILENCE, choose_faults, list_faults
from armguard.verdict import ReasonKind


def test_each_fault_has_a_name_of_its_own_and_signs_that_can_be_given():
    faults = list_faults()
    assert len({fault.name for fault in faults}) == len(faults)
    for fault in faults:
        assert fault.duration > 0.0
        for sign in fault.signs:
            is_reason = sign in ReasonKind.__members__
            assert is_reason or sign == SILENCE or sign != sign.upper(), f"{fault.name}: misspelt"


def test_all_kinds_of_trouble_are_there():
    """What the campaign promises: each field, each length of silence, each process."""
    names = {fault.name for fault in list_faults()}
    for value in ("nan", "inf"):
        assert {f"camera-{value}-{field}" for field in ("stamp", "position", "radius")} < names
        assert {f"driver-{value}-{field}" for field in ("stamp", "q", "v")} < names
    for part in ("camera", "driver"):
        assert {f"{part}-dropout-{time}" for time in ("10ms", "100ms", "1s", "10s")} < names
    for part in ("camera", "driver", "monitor", "recorder", "view"):
        assert {f"{part}-killed", f"{part}-stopped"} < names


def test_faults_are_chosen_by_name_or_pattern_in_the_order_of_the_list():
    assert choose_faults([]) == list_faults()
    chosen = [fault.name for fault in choose_faults(["monitor-*", "disk-full"])]
    assert chosen == ["disk-full", "monitor-stopped", "monitor-killed"]
    with pytest.raises(ArmguardError, match="'earthquake' is no fault"):
        choose_faults(["disk-full", "earthquake"])
