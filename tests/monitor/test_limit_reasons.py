"""A STOP or SLOW that rests on a contact limit says which, whose, and by how much."""

import re

import numpy as np
import pytest

from armguard.monitor.limit_reasons import TOLD_FOR, _round_up
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import PERIOD, kinds, panda, subjects
from support.permitted_contact import Encounter

FORBIDDEN = ReasonKind.CONTACT_FORBIDDEN
FAST = 0.05  # of the velocity limits


def limit(**stated):
    return ContactLimit(**({"source": "test", "gap": 0.02, "thickness": 9.0} | stated))


def limits_of(**stated):
    return ContactLimits({"hand": limit(**stated)})


SLOW_ONLY = limits_of(force=1.0, stiffness=1.0, body_mass=1e4)  # 0.01 m/s, and any way
NO_CLAMPING = limits_of(speed=3.0, gap=0.2)
HARDLY = limits_of(force=1e-4, stiffness=1.0, body_mass=1e-9, gap=0.2)  # 3 m/s, and 0.1 mm


def meet(limits, *, away=0.01, region="hand", fast=FAST, static=None, **settings):
    """The verdict of an arm that moves beside a hand."""
    encounter = Encounter(away, limits=limits, **settings)
    encounter.v[:] = fast * panda().velocity_limit
    if static is not None:
        encounter.obstacles.add_static("table", encounter.place(static), 0.03)
    verdict = encounter.go(3, region=region)
    return encounter, verdict


def told(verdict):
    (reason,) = [one for one in verdict.reasons if one.kind is FORBIDDEN]
    return reason


def test_a_link_that_could_be_too_fast_is_told_with_bound_limit_region_and_source():
    _, verdict = meet(SLOW_ONLY)
    assert verdict.level is Level.STOP
    reason = told(verdict)
    link, _, obstacle = reason.subject.partition(" and ")
    assert link in panda().links
    assert obstacle == "p/hand"
    found = re.fullmatch(
        r"at up to (\S+) m/s, above the limit of 0.01 m/s \(hand: test\)", reason.detail
    )
    assert found, reason.detail
    # The fastest point of that arm is no faster than all joints together could make it.
    assert 0.01 < float(found[1]) < 5.0
    assert str(reason).startswith("contact not permitted: panda_")
    # It stands before the contact itself, which is that of the same pair.
    assert verdict.reasons[0] is reason
    assert subjects(verdict, ReasonKind.CONTACT) == {reason.subject}


@pytest.mark.parametrize(
    ("limits", "region", "detail"),
    [
        (SLOW_ONLY, "head", "may never be touched (head: no limit is stated for it)"),
        (SLOW_ONLY, "chest", "may never be touched (chest: no limit is stated for it)"),
        (SLOW_ONLY, None, "may never be touched: its region is not stated"),
        (limits_of(speed=0.0), "hand", "may never be touched (hand: test)"),
    ],
)
def test_what_may_never_be_touched_is_told(limits, region, detail):
    _, verdict = meet(limits, region=region)
    assert verdict.level is Level.STOP
    assert told(verdict).detail == detail


def test_a_part_that_can_be_clamped_is_told_with_what_and_how_far():
    _, verdict = meet(HARDLY, fast=0.1, static=0.05)
    assert verdict.level is Level.STOP
    found = re.fullmatch(
        r"can be clamped against table: the link could go on by (up to|more than) (\S+) mm, "
        r"above the limit of 0.1 mm \(hand: test\)",
        told(verdict).detail,
    )
    assert found, told(verdict).detail
    assert float(found[2]) > 0.1


def test_a_limit_without_force_says_that_it_permits_no_clamping():
    _, verdict = meet(NO_CLAMPING, static=0.05)
    assert verdict.level is Level.STOP
    assert told(verdict).detail == (
        "can be clamped against table, where nothing is permitted without force and stiffness "
        "(hand: test)"
    )


def test_the_scale_of_a_slow_is_told_at_full_speed():
    limits = limits_of(force=10.0, stiffness=1.0, body_mass=1e4)  # 0.1 m/s, and any way
    encounter, verdict = meet(limits, away=0.05, fast=0.0)
    for _ in range(20):
        encounter.see()
        verdict = encounter.step()
    assert verdict.level is Level.SLOW
    assert re.fullmatch(
        r"at full speed: at up to \S+ m/s, above the limit of 0.1 m/s \(hand: test\)",
        told(verdict).detail,
    )


def test_nothing_is_told_where_no_limits_are_stated_or_nothing_is_near():
    _, verdict = meet(None)
    assert verdict.level is Level.STOP
    assert FORBIDDEN not in kinds(verdict)
    _, verdict = meet(SLOW_ONLY, away=3.0)
    assert FORBIDDEN not in kinds(verdict)
    assert verdict.level > Level.SLOW


def test_what_is_told_is_found_anew_after_a_while_and_when_the_obstacle_is_another():
    encounter, verdict = meet(SLOW_ONLY)
    asked = []
    scheduler = encounter.scheduler
    find = scheduler.find_forbidden

    def find_forbidden(pair, tick):
        asked.append(pair)
        return find(pair, tick)

    scheduler.find_forbidden = find_forbidden
    before = told(verdict)
    for _ in range(round(TOLD_FOR / PERIOD) - 5):
        encounter.see()
        assert told(encounter.step()) is before
    assert not asked
    encounter.go(10)
    assert len(asked) == 1
    encounter.obstacles.remove(["p/hand"])
    encounter.see("q/hand")
    assert told(encounter.step()).subject.endswith("q/hand")
    encounter.obstacles.remove(["q/hand"])
    assert FORBIDDEN not in kinds(encounter.step())


@pytest.mark.parametrize("figure", [1e-9, 0.25, 0.2501, 0.9, 1.0, 99.95, 123.4, 1e5 / 3.0])
def test_figures_are_rounded_up(figure):
    rounded = _round_up(figure)
    assert figure * (1 - 1e-12) <= rounded <= 1.011 * figure
    assert float(f"{rounded:.3g}") == pytest.approx(rounded, rel=1e-9)
    assert np.isnan(_round_up(np.nan))
