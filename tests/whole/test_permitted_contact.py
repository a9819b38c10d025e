"""Contact limits permit what they say and no more, whatever attacks, changes or is not stated."""

import numpy as np
import pytest

from armguard.jit.kernels import kernel
from armguard.scheduling.deadline_kernels import _read_changes
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Level, ReasonKind
from support.adversary import Hunt, permit
from support.panda_monitor import PERIOD, kinds, panda
from support.permitted_contact import LIMITS, RADIUS, Encounter

ALLOWED = ReasonKind.CONTACT_ALLOWED
HARDLY_CLAMPED = ContactLimits(
    {"hand": ContactLimit(force=2.0, stiffness=1e3, body_mass=4e-3 / 0.8**2, source="test",
                          gap=0.05, thickness=9.0)}
)  # fmt: skip
"""0.8 m/s, and 2 mm where it is clamped."""
ANY_WAY, GAP = 100.0, 0.15


def permissions(truth=1.0, *, factor=1.0):
    """So that clamping plays no part."""
    limits = ("hand", 0.1 * factor), ("forearm", 0.25 * factor), ("chest", 0.6 * factor)
    return [permit(region, speed, ANY_WAY, truth=truth) for region, speed in limits]


def clamping_permissions(told_way=None):
    limits = ("hand", 0.2, 0.001), ("forearm", 0.5, 0.004), ("chest", 1.0, 0.015)
    true = [permit(*limit, GAP) for limit in limits]
    if told_way is None:
        return true
    return [one._replace(told=permit(one.region, one.limit, told_way).told) for one in true]


def check_unbeaten(score):
    assert (score.hits, score.missed, score.early) == (0, 0, 0), score
    assert (score.too_fast, score.harmful) == (0, 0), score
    # It was a fight, and what limits permit was there to be had.
    assert score.goes > 100
    assert score.understated == 0
    assert score.closest <= 1.0


@pytest.mark.parametrize("settings", [{}, {"schedule": "daa"}, {"budget": 80}])
def test_no_contact_is_faster_than_its_limit(settings):
    hunt = Hunt(panda(), 6, 8, 8, close=True, permissions=permissions(), **settings)
    score = hunt.run(1e5)
    check_unbeaten(score)
    assert score.allowed + score.gentle > 5


def test_no_contact_does_harm_before_the_harm_time():
    hunt = Hunt(panda(), 1, 8, 8, close=True, permissions=permissions(factor=8.0))
    later = 0
    while hunt.score.pair_ticks < 1e5:
        verdict = hunt.advance()
        assert verdict.harm_time >= verdict.contact_time
        later += verdict.harm_time > verdict.contact_time
    check_unbeaten(hunt.score)
    assert later > 50


def hunt_of_clamps(seed, told_way=None):
    told = clamping_permissions(told_way)
    return Hunt(panda(), seed, 8, 8, close=True, static=0.3, permissions=told, gap=GAP)


@pytest.mark.hazard("H-12")
def test_no_clamped_part_is_pressed_farther_than_its_limit():
    score = hunt_of_clamps(7).run(1e5)
    check_unbeaten(score)
    assert score.allowed + score.gentle > 5


def test_ways_that_are_truly_shorter_than_told_are_gone():
    assert hunt_of_clamps(7, ANY_WAY).run(1e5).missed > 2


def test_limits_that_are_truly_lower_than_told_are_broken():
    hunt = Hunt(panda(), 6, 8, 8, close=True, permissions=permissions(0.2))
    assert hunt.run(1e5).missed > 2


def test_limits_of_regions_that_nobody_has_change_nothing():
    limits = ContactLimits({"thigh": ContactLimit(speed=0.5, source="test")})
    plain = Hunt(panda(), 3, 20, 8)
    limited = Hunt(panda(), 3, 20, 8, contact_limits=limits)
    fields = "level", "contact_time", "stop_time", "speed_scale", "link", "complete", "evaluated"
    seen = set()
    for _ in range(1500):
        one, other = plain.advance(), limited.advance()
        for field in (*fields, "valid_until", "stop"):
            assert getattr(one, field) == getattr(other, field), field
        # Only that its region has no limit is told besides.
        told = [r for r in other.reasons if r.kind is not ReasonKind.CONTACT_FORBIDDEN]
        assert [r.kind for r in one.reasons] == [r.kind for r in told]
        assert other.harm_time == other.contact_time == one.harm_time
        assert one.contact_speed is None
        assert other.contact_speed == (np.inf if other.level is Level.STOP else 0.0)
        seen.add(one.level)
    assert len(seen) > 2


def permitted(limits=LIMITS, away=0.005, **settings):
    """A hand that may be touched soon, and the row's place of proofs."""
    encounter = Encounter(away, limits=limits, **settings)
    verdict = encounter.go(4)
    assert verdict.level > Level.STOP
    assert ALLOWED in kinds(verdict)
    assert verdict.contact_time < verdict.stop_time
    assert 0.0 < verdict.contact_speed <= 0.8
    place = 2 * encounter.row()
    proofs = encounter.scheduler.certificates.proofs
    assert proofs.link[place] >= 0
    assert proofs.until[place] > encounter.tick * PERIOD
    return encounter, proofs, place


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
def test_a_hand_that_may_be_a_head_is_never_touched(schedule):
    encounter, proofs, place = permitted(schedule=schedule)
    encounter.see(region="head")
    verdict = encounter.step()
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)
    assert verdict.harm_time == verdict.contact_time
    assert not (proofs.until[place] > encounter.tick * PERIOD and proofs.link[place] >= 0)
    # It stays so, whatever is said later.
    assert encounter.go(3).level is Level.STOP


def test_a_refused_state_of_another_region_counts():
    encounter, _, _ = permitted()
    place = encounter.place(0.4)
    encounter.see(position=place, region="head")
    verdict = encounter.step()
    assert ReasonKind.OBSTACLE_REFUSED in kinds(verdict)
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
def test_a_table_that_appears_beside_a_hand_ends_what_is_permitted(schedule):
    encounter, proofs, place = permitted(HARDLY_CLAMPED, schedule=schedule)
    encounter.obstacles.add_static("table", encounter.place(0.04), RADIUS)
    encounter.see()
    verdict = encounter.step()
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)
    assert not (proofs.until[place] > encounter.tick * PERIOD and proofs.link[place] >= 0)
    encounter.obstacles.remove(["table"])
    assert ALLOWED in kinds(encounter.go(2))


@pytest.mark.parametrize("names", [("a/box", "p/hand"), ("p/hand", "a/box")])
@pytest.mark.parametrize("first", [True, False])
def test_a_neighbour_that_grows_ends_what_is_permitted(names, first):
    """In whatever order both are evaluated: the hand has changed as well."""
    encounter = Encounter(0.005, limits=HARDLY_CLAMPED)

    def see_both(box, **fields):
        for name in names if first else names[::-1]:
            if name == "p/hand":
                encounter.see(**fields)
            else:
                encounter.see(
                    name, position=encounter.place(1.0), radius=box, region="", speed=0.01
                )

    for _ in range(4):
        see_both(0.05)
        verdict = encounter.step()
    assert ALLOWED in kinds(verdict)
    see_both(1.01, radius=RADIUS + 0.001)
    verdict = encounter.step()
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)


def test_a_wall_that_nobody_watches_leaves_what_it_is_far_from_alone():
    encounter = Encounter(0.005, limits=HARDLY_CLAMPED, ignore=[("*", "wall")])
    encounter.obstacles.add_static("wall", encounter.place(2.0), RADIUS)
    assert ALLOWED in kinds(encounter.go(4))
    encounter.obstacles.remove(["wall"])
    encounter.obstacles.add_static("wall", encounter.place(0.04), RADIUS)
    verdict = encounter.go(1)
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)


@kernel
def read_changes(handle):
    return _read_changes(handle.content.scene, handle.content.certificates)


def test_what_a_neighbour_was_counts_no_more_once_it_has_changed():
    """Not even while the neighbour waits to be evaluated."""
    encounter, _, _ = permitted(HARDLY_CLAMPED)
    encounter.see("a/box", position=encounter.place(1.0), radius=0.05, region="")
    encounter.go(1)
    row = encounter.row("a/box")
    certificates = encounter.scheduler.certificates
    assert certificates.reference_states.point_count[row] == 1
    encounter.see("a/box", position=encounter.place(1.0), radius=0.5, region="")
    assert read_changes(encounter.scheduler._tick_data) == 1
    assert certificates.reference_states.point_count[row] == 0


def test_a_question_of_a_slower_arm_says_nothing_of_what_is_permitted():
    encounter, proofs, place = permitted()
    scheduler, monitor = encounter.scheduler, encounter.monitor
    tick, _ = monitor._last
    table = scheduler.arm.motion.braking.tabulate(tick.q, tick.v, tick.arm_age, 0.0, pace=1e-3)
    before = proofs.link[place], proofs.speed[place], proofs.until[place]
    assert scheduler.find_unsafe(tick, float(table.time[-1])).pair < 0
    assert (proofs.link[place], proofs.speed[place], proofs.until[place]) == before
    assert scheduler.find_permitted_contact(tick, tick.stop_time).speed == before[1]


def test_a_planned_arm_without_pieces_may_touch_as_well():
    encounter, _, _ = permitted(motion="planned")
    encounter.obstacles.remove(["p/hand"])
    assert encounter.step().level is Level.CLEAR


def test_an_arm_that_is_too_fast_may_not_touch():
    encounter = Encounter(0.005)
    encounter.v[:] = 0.3 * panda().velocity_limit
    encounter.see()
    verdict = encounter.step()
    assert verdict.level is Level.STOP
    assert ALLOWED not in kinds(verdict)
    assert np.isinf(verdict.contact_speed)


def test_what_is_told_of_a_contact_names_who_is_there_now():
    encounter = Encounter(0.005)
    encounter.go()
    encounter.obstacles.remove(["p/hand"])
    encounter.see("q/hand")
    (told,) = [one for one in encounter.step().reasons if one.kind is ALLOWED]
    assert told.subject.endswith(" and q/hand")
