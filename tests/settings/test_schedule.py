from armguard.scheduling import SCHEDULES, make_schedule
from armguard.settings.declarations import read_declarations
from armguard.settings.schedule import DEADLINE, Schedule
from armguard.settings.settings import Settings


def test_every_schedule_that_has_a_name_is_one():
    for name in SCHEDULES:
        assert isinstance(make_schedule(name, 0.001), Schedule)
        assert Settings(schedule=name).schedule == name
    assert not isinstance(DEADLINE, Schedule)


def test_the_record_knows_the_names_that_there_are():
    (names, _) = read_declarations(Settings)["schedule"].kinds
    assert set(names.__args__) == {DEADLINE, *SCHEDULES}
