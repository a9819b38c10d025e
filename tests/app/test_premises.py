import re

from armguard import ContactLimit, ContactLimits
from armguard.app.cell import Cell
from armguard.app.premises import Premise, describe_missing_limits, list_premises
from armguard.obstacles import Obstacles
from support.panda_monitor import make_monitor


def test_each_premise_is_a_line():
    assert list_premises() == [f"premise: {premise.value}" for premise in Premise]


def test_what_a_monitor_was_told_stands_beside_them():
    obstacles = Obstacles(accel=7.0, speed=1.5, sources=[])
    obstacles.add_entrance("door", [5.0, 0.0, 0.5], radius=0.3, detection_time=0.1)
    obstacles.tether("elbow", "hand", 0.45, "measured")
    _, monitor = make_monitor(obstacles=obstacles, payload=0.5, reaction_time=0.03, latency=0.004)
    told = dict(zip(Premise, list_premises(monitor), strict=True))
    assert told[Premise.LIMITS] == list_premises()[0]
    assert told[Premise.PAYLOAD].endswith("(0.5 kg)")
    assert told[Premise.OPERATING].endswith("(none are stated)")
    assert "within 30 ms; a verdict is valid for 5 ms" in told[Premise.OBEDIENCE]
    assert "7 m/s² and 1.5 m/s" in told[Premise.OBSTACLES]
    assert told[Premise.TETHERS].endswith("(elbow and hand: 0.45 m (measured))")
    assert told[Premise.FIRST_SIGHT].endswith("(entrances: door)")
    assert told[Premise.CLOCKS].endswith("(latency of verdicts: 4 ms)")


def test_the_limits_in_force_stand_beside_the_premise_of_contact():
    limits = ContactLimits(
        {
            "hand": ContactLimit(speed=0.9, source="assumed", person_speed=0.5),
            "chest": ContactLimit(speed=0.2, source="assumed"),
        }
    )
    for has_table in (False, True):
        obstacles = Obstacles(sources=[])
        obstacles.add_entrance("door", [5.0, 0.0, 0.5], radius=0.3, detection_time=0.1)
        if has_table:
            obstacles.add_static("table", [0.5, 0.0, -0.5], 0.4)
        _, monitor = make_monitor(obstacles=obstacles, contact_limits=limits)
        told = dict(zip(Premise, list_premises(monitor), strict=True))[Premise.CONTACT]
        assert "hand: 0.53 m/s, person's speed 0.5 m/s; chest: 0.2 m/s, person's speed own" in told
        assert ("no statics are stated" in told) != has_table


def test_links_of_other_arms_that_are_only_drawn_are_named():
    _, monitor = make_monitor(obstacles=Obstacles(sources=[]))
    index = list(Premise).index(Premise.DRAWN_LINKS)
    some = {"left": (), "right": ("screen", "lamp")}
    assert list_premises(monitor, some)[index].endswith(
        "(not watched against: right screen, right lamp)"
    )
    assert list_premises(monitor, {"left": ()})[index].endswith("(not watched against: none)")
    assert list_premises(monitor, {})[index] == list_premises()[index]


CELL = """[robot]
name = "panda"
operating = "published"
"""


def test_a_start_without_operating_limits_says_what_that_costs():
    text = CELL + "[sources]\n"
    assert describe_missing_limits(Cell.from_text(text).build()[2]) is None
    text = text.replace('operating = "published"\n', "")
    told = describe_missing_limits(Cell.from_text(text).build()[2])
    without, published = map(int, re.findall(r"(\d+) ms", told))
    assert without > 1.5 * published
    assert 'operating = "published"' in told
    # As this cell has it: lighter loads stop sooner.
    light = text.replace("[sources]", "payload = 0.0\n[sources]")
    empty = describe_missing_limits(Cell.from_text(light).build()[2])
    assert int(re.search(r"(\d+) ms", empty)[1]) < without
