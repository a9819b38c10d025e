import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from armguard import ContactLimit, ContactLimits
from armguard.body_regions import NEVER_TOUCHED, NUMBERS, REGIONS
from armguard.exceptions import ArmguardError
from armguard.settings.contact_limits import GAPS, THICKNESSES

WAYS = [
    {"speed": 0.9},
    {"energy": 0.52, "body_mass": 0.6},
    {"force": 140.0, "stiffness": 75000.0, "body_mass": 0.6},
]
OWN_SPEEDS = ["own", 0.0, 1e-6, 0.5, 1.6, 1e6]


def make_limit(**changes):
    return ContactLimit(**({"source": "assumed"} | changes))


def find_allowed_square(way):
    """v² that is allowed to a part at rest, exactly: 2 E / m, in [m²/s²]."""
    stated = {name: Fraction(value) for name, value in way.items()}
    if "speed" in stated:
        return stated["speed"] ** 2
    energy = stated.get("energy")
    if energy is None:
        energy = stated["force"] ** 2 / (2 * stated["stiffness"])
    return 2 * energy / stated["body_mass"]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("own", OWN_SPEEDS)
def test_what_the_arm_adds_is_the_energy_stated_and_never_more(way, own):
    fastest = Fraction(make_limit(**way, person_speed=own).max_speed)
    person = Fraction(0 if own == "own" else own)
    added = (fastest + person) ** 2 - person**2
    allowed = find_allowed_square(way)
    assert fastest > 0
    assert added <= allowed
    assert float(added) == pytest.approx(float(allowed), rel=1e-9)


def test_the_page_computes_its_figures_as_armguard_does():
    page = (Path(__file__).parents[2] / "docs" / "contact_limits.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([a-z ]+) \|((?: [\d.]+ \|){4})$", page, flags=re.MULTILINE)
    assert len(rows) == 4
    for region, cells in rows:
        mass, stiffness, force, speed = (float(one) for one in cells.split("|")[:-1])
        assert region.replace(" ", "_") in REGIONS
        limit = make_limit(force=2.0 * force, stiffness=1e3 * stiffness, body_mass=mass)
        assert speed == pytest.approx(limit.max_speed, abs=0.006)


def test_a_speed_is_the_limit_itself_where_the_part_is_at_rest():
    assert make_limit(speed=0.9).max_speed == 0.9
    assert make_limit(speed=0.9, person_speed=0).max_speed == pytest.approx(0.9, rel=1e-11)


def test_a_faster_person_leaves_less_to_the_arm():
    speeds = [make_limit(speed=0.9, person_speed=own).max_speed for own in (0.0, 0.5, 1.0, 2.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(math.sqrt(4.0 + 0.81) - 2.0)


@pytest.mark.parametrize("way", WAYS)
def test_only_a_force_and_a_stiffness_permit_clamping(way):
    way_left = Fraction(make_limit(**way).max_way)
    stiffness = Fraction(way.get("stiffness", 0))
    assert (way_left > 0) == ("force" in way)
    assert stiffness * way_left <= Fraction(way.get("force", 0))
    assert float(way_left) == pytest.approx(140.0 / 75000.0 if "force" in way else 0.0, rel=1e-9)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("own", OWN_SPEEDS)
def test_0_is_never(way, own):
    (first, *_) = way
    limit = make_limit(**(way | {first: 0.0}), person_speed=own)
    assert (limit.max_speed, limit.max_way) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *(
            ({name: bad, **more}, f"^{name}: is {bad}; expected a finite number")
            for bad in (-0.1, math.inf, -math.inf, math.nan)
            for name, more in (
                ("speed", {}),
                ("energy", {"body_mass": 0.6}),
                ("force", {"body_mass": 0.6, "stiffness": 75e3}),
                ("body_mass", {"energy": 0.5}),
                ("stiffness", {"body_mass": 0.6, "force": 140.0}),
                ("person_speed", {"speed": 0.9}),
                ("gap", {"speed": 0.9}),
                ("thickness", {"speed": 0.9}),
            )
        ),
        ({"speed": "slow"}, "^speed: is 'slow'; expected a finite number"),
        ({"energy": 0.5, "body_mass": 0.0}, "^body_mass: is 0.0; expected a finite number above 0"),
        ({"speed": 0.9, "person_speed": "walking"}, "^person_speed: is 'walking'; expected .*own"),
        ({"speed": 0.9, "source": ""}, "^source: is ''; expected where the numbers come from"),
        ({"speed": 0.9, "source": " \n"}, "^source: is .*; expected where the numbers come from"),
        ({"speed": 0.9, "source": None}, "^source: is None; expected text"),
        ({}, "^speed: is missing, like energy and force; expected exactly one of speed, energy"),
        ({"body_mass": 0.6}, "^speed: is missing, like energy and force"),
        (
            {"speed": 0.9, "energy": 0.5, "body_mass": 1.0},
            "^energy: is given beside speed; expected exactly one of speed, energy, force",
        ),
        ({"energy": 0.5}, "^body_mass: is missing beside energy"),
        ({"force": 140.0, "body_mass": 0.6}, "^stiffness: is missing beside force"),
        ({"force": 140.0, "stiffness": 75e3}, "^body_mass: is missing beside force"),
        ({"speed": 0.9, "body_mass": 0.6}, "^body_mass: is given beside speed"),
        (
            {"energy": 0.5, "body_mass": 0.6, "stiffness": 75e3},
            "^stiffness: is given beside energy; expected energy and body_mass alone",
        ),
        ({"energy": 1e300, "body_mass": 1e-300}, "^energy: comes to inf m/s"),
    ],
)
def test_what_makes_no_limit_is_refused_in_one_line(changes, message):
    with pytest.raises(ArmguardError, match=message) as found:
        make_limit(**changes)
    assert "\n" not in str(found.value)
    # A cell file's error names this key.
    assert found.value.offender in ContactLimit.__struct_fields__


def test_a_limit_without_a_source_is_refused():
    with pytest.raises(ArmguardError, match=r"^source: is ''"):
        ContactLimit(speed=0.9)


@pytest.mark.parametrize("region", sorted(NEVER_TOUCHED))
def test_head_face_and_neck_are_never_touched(region):
    with pytest.raises(ArmguardError, match=f"^contact_limits.{region}: permits contact at 0.1"):
        ContactLimits({region: make_limit(speed=0.1)})
    assert ContactLimits({region: make_limit(speed=0)}).tabulate()[0].max() == 0.0


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (
            {"paw": make_limit(speed=0.1)},
            "^contact_limits: names the region 'paw'; expected one of",
        ),
        ({3: make_limit(speed=0.1)}, "^contact_limits: names the region 3"),
        ({"hand": 0.9}, "^contact_limits.hand: is 0.9; expected a ContactLimit"),
        (None, "^contact_limits: is None; expected limits by region"),
        ([("hand", 0.9)], "^contact_limits: is .*; expected limits by region"),
    ],
)
def test_limits_are_by_known_regions(stated, message):
    with pytest.raises(ArmguardError, match=message):
        ContactLimits(stated)


def test_a_table_has_each_region_at_its_number_and_permits_nothing_else():
    hand = make_limit(force=140.0, stiffness=75e3, body_mass=0.6)
    chest = make_limit(speed=0.2, gap=0.4, thickness=0.2)
    stated = {"hand": hand, "chest": chest}
    limits = ContactLimits(stated)
    stated["head"] = hand  # too late: the limits are as they were given
    max_speed, max_way, gap, thickness = limits.tabulate()
    assert {len(one) for one in limits.tabulate()} == {len(REGIONS) + 1}
    assert np.flatnonzero(max_speed).tolist() == sorted(NUMBERS[one] for one in ("hand", "chest"))
    assert max_speed[NUMBERS["hand"]] == hand.max_speed
    assert np.flatnonzero(max_way).tolist() == [NUMBERS["hand"]]
    assert (gap[NUMBERS["hand"]], thickness[NUMBERS["hand"]]) == (0.1, THICKNESSES["hand"])
    assert (gap[NUMBERS["chest"]], thickness[NUMBERS["chest"]]) == (0.4, 0.2)
    # What has no limit can be clamped by anything, however far away it is.
    assert gap[0] == gap[NUMBERS["head"]] == math.inf


def test_every_region_has_a_gap_and_a_thickness():
    assert set(GAPS) == set(THICKNESSES) == set(REGIONS)
    assert GAPS["forearm"] == 0.12
    assert all(0.0 < THICKNESSES[one] <= gap for one, gap in GAPS.items())


def test_an_impact_may_press_harder_than_a_clamp():
    stated = {"force": 140.0, "stiffness": 75e3, "body_mass": 0.6, "source": "a study"}
    quasi_static = ContactLimit(**stated)
    limit = ContactLimit(**stated, transient_force=280.0)
    assert limit.max_way == quasi_static.max_way
    assert limit.max_speed == pytest.approx(2.0 * quasi_static.max_speed)
    energy = 280.0**2 / (2.0 * 75e3)
    assert 0.5 * 0.6 * limit.max_speed**2 == pytest.approx(energy)


@pytest.mark.parametrize(
    "stated",
    [
        {"force": 140.0, "stiffness": 75e3, "body_mass": 0.6, "transient_force": 100.0},
        {"force": 140.0, "stiffness": 75e3, "body_mass": 0.6, "transient_force": np.nan},
        {"speed": 0.5, "transient_force": 100.0},
    ],
)
def test_an_impact_that_may_press_less_is_refused(stated):
    with pytest.raises(ArmguardError, match="transient_force"):
        ContactLimit(**stated, source="a study")


def test_what_is_permitted_and_what_never_is_told_by_region_and_source():
    hand = make_limit(force=150.0, stiffness=75e3, body_mass=0.75, source="A")
    limits = ContactLimits({"hand": hand, "chest": make_limit(speed=0.2, source="B"),
                            "neck": make_limit(speed=0.0, source="C")})  # fmt: skip
    number = {region: 1 << NUMBERS[region] for region in REGIONS}
    told = limits.describe_permitted
    assert told(number["hand"]) == (
        "at most 0.632 m/s and, where it can be clamped, 2 mm of way are permitted (hand: A)"
    )
    assert told(number["hand"] | number["chest"]) == (
        "at most 0.2 m/s and, where it can be clamped, 0 mm of way are permitted (chest: B)"
    )
    assert limits.describe(number["hand"] | number["chest"], by="max_way") == "chest: B"
    never = "may never be touched"
    assert told(number["hand"] | number["neck"]) == f"{never} (neck: C)"
    assert told(number["head"]) == f"{never} (head: no limit is stated for it)"
    assert told(number["hand"] | 1) == told(0) == f"{never}: its region is not stated"
