"""What forbids a contact is what the stop decision is denied for, by figures above the limit."""

import numpy as np
import pytest

from armguard.jit.kernels import kernel
from armguard.pairs.contact_time import RESTS, rests_in_time
from armguard.pairs.forbidden import CLAMPED, NEVER, NOBODY, PERMITTED, TOO_FAST
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from support.panda_monitor import HOME, STILL, panda
from support.permitted_contact import Encounter

HORIZON = 0.01
LIMITS = ContactLimits(
    {
        "hand": ContactLimit(force=2.0, stiffness=400.0, body_mass=0.04, source="test", gap=0.1),
        "forearm": ContactLimit(speed=0.3, source="test", gap=0.02, thickness=9.0),
    }
)
"""0.5 m/s, and 5 mm where it is clamped; 0.3 m/s."""
MAX_SPEED = {"hand": 0.5, "forearm": 0.3}


@kernel
def ask(handle, link, row):
    return rests_in_time(handle, link, row, handle.content.bodies.stamp[row], 10**6)[0]


@pytest.mark.parametrize("region", ["hand", "forearm", "head"])
def test_it_answers_as_the_stop_decision_does(region):
    random = np.random.default_rng(4)
    encounter = Encounter(0.3, limits=LIMITS)
    scheduler, seen = encounter.scheduler, {}
    braking = scheduler.arm.motion.braking
    encounter.obstacles.add_static("table", encounter.place(0.12), 0.1)
    for k in range(120):
        # Another one each time: none could be there so soon.
        name = f"{k}/part"
        away = encounter.place(random.uniform(-0.02, 0.4)) + random.normal(size=3) * 0.1
        v = random.uniform(-0.25, 0.25) * random.random(7) * panda().velocity_limit
        encounter.see(name, position=away, region=region)
        encounter.step(HOME)
        tick, row = encounter.monitor._last[0], encounter.row(name)
        scheduler.prepare(tick)
        braking.tabulate(tick.q, v, tick.arm_age, HORIZON)
        links = len(panda().links)
        answers = [ask(scheduler.arm.state.handle, link, row) for link in range(links)]
        first = int(random.integers(links))
        found = scheduler.find_forbidden(row * links + first, tick)
        seen.setdefault(found.why, []).append(found)
        assert (found.why == PERMITTED) == all(answer == RESTS for answer in answers)
        if found.why != PERMITTED:
            assert answers[found.link] != RESTS
            # The first one in turn from the link that was asked for.
            turn = [(first + k) % links for k in range(links)]
            assert found.link == next(link for link in turn if answers[link] != RESTS)
        if found.why == TOO_FAST:
            assert found.figure > MAX_SPEED[region]
        if found.why == CLAMPED and region == "hand":
            assert found.figure > 0.005
        encounter.obstacles.remove([name])
    assert len(seen[PERMITTED]) > 5
    if region == "head":
        assert set(seen) == {PERMITTED, NEVER}
    else:
        assert set(seen) >= {PERMITTED, TOO_FAST}
    if region == "hand":
        assert {one.against for one in seen[CLAMPED]} == {encounter.row("table"), NOBODY}


def test_of_what_is_nowhere_there_is_nothing_to_say():
    encounter = Encounter(0.3, limits=LIMITS)
    encounter.go(2)
    tick, row, links = encounter.monitor._last[0], encounter.row(), len(panda().links)
    encounter.obstacles.table.marks.has_state[row] = False
    encounter.scheduler.prepare(tick)
    encounter.scheduler.arm.motion.braking.tabulate(HOME, STILL, 0.0, HORIZON)
    assert encounter.scheduler.find_forbidden(row * links, tick).why == PERMITTED
