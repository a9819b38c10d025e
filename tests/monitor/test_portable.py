"""That it can be made anew is held by tests/recording/test_settings.py."""

import msgspec
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor.portable import describe_settings, write_value
from armguard.scheduling import DaaSchedule, FullSchedule
from armguard.settings.declarations import read_declarations
from armguard.settings.settings import Settings
from support.eventful_runs import MOTIONS, make_monitor


@pytest.mark.parametrize("motion", MOTIONS)
def test_all_settings_are_told_as_json_holds_them(motion):
    _, _, monitor = make_monitor(motion)
    data = describe_settings(monitor)
    assert set(data["monitor"]) == set(read_declarations(Settings))
    assert msgspec.json.decode(msgspec.json.encode(data)) == data
    assert data["monitor"]["rate"] == monitor.settings.rate


def test_schedules_are_told_unless_they_are_the_applications_own():
    assert write_value(FullSchedule()) == "full"
    daa = DaaSchedule(0.01, "fibonacci", "total")
    assert write_value(daa) == {"period": 0.01, "law": "fibonacci", "sort": "total"}
    for kind in (FullSchedule, DaaSchedule):
        own = type("Own", (kind,), {})
        with pytest.raises(ArmguardError, match="a Own of the application's own"):
            write_value(own(*([0.01] if kind is DaaSchedule else [])))
