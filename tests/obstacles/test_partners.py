"""By whose state a tethered obstacle is judged."""

import numpy as np
import pytest

from armguard import Obstacles
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel
from armguard.obstacles.partners import NO_PARTNER, find_partner
from armguard.obstacles.regions import RegionLimits, make_no_limits
from armguard.settings.contact_limits import ContactLimit, ContactLimits

CENTER = np.zeros(4)


@kernel
def _find(handle, tethers, limits, row, now, horizon, center):
    table = handle.content
    return find_partner(
        tethers.content, table.accepted, table.refused, table.marks, limits.content,
        row, now, horizon, center,
    )  # fmt: skip


def find(obstacles, name, now=0.3, horizon=0.3, limits=None):
    """Id of the partner, its radius and the tether's length; the id is None without one."""
    obstacles.tie_rows()
    table = obstacles.table
    row = obstacles.row(name)
    limits = pack(make_no_limits() if limits is None else RegionLimits(*limits.tabulate()))
    found = _find(table.handle, pack(table.tethers), limits, row, now, horizon, CENTER)
    return (None if found[0] == NO_PARTNER else obstacles.ids[found[0]]), found[1], found[2]


def make_table(**options):
    """A hidden elbow, 0.8 m from the middle, and a shoulder and a hand that are seen."""
    obstacles = Obstacles(accel=10.0, speed=2.0, **options)
    obstacles.tether("elbow", "shoulder", 0.4, "measured")
    obstacles.tether("elbow", "hand", 0.3, "measured")
    see(obstacles, 0.0, elbow=0.8, hand=0.7, shoulder=1.1)
    see(obstacles, 0.29, hand=0.7, shoulder=1.1)
    return obstacles


def see(obstacles, stamp, radius=0.05, **places):
    points = [[x, 0.0, 0.0] for x in places.values()]
    still = np.zeros((len(places), 3))
    obstacles.update(
        list(places), stamp, points, still, radius=radius, position_error=0.01, velocity_error=0.1
    )


def test_the_partner_that_says_most_is_taken():
    obstacles = make_table()
    name, radius, length = find(obstacles, "elbow")
    assert (name, length) == ("shoulder", 0.4)
    assert 0.45 <= radius < 0.45 + 1e-9
    # The hand, without the shoulder, says more than an elbow of so long ago.
    obstacles.untether("elbow", "shoulder")
    assert find(obstacles, "elbow", 0.3)[0] == "hand"


def test_a_partner_that_may_be_touched_says_nothing():
    """It may be pushed, and then it need not keep to its bounds."""
    limits = ContactLimits({"shoulder": ContactLimit(speed=0.5, source="test")})
    obstacles = make_table()
    assert find(obstacles, "elbow", limits=limits)[0] == "shoulder", "of no region"
    obstacles = make_table(regions={"shoulder": "shoulder"})
    assert find(obstacles, "elbow")[0] == "shoulder"
    assert find(obstacles, "elbow", limits=limits)[0] == "hand"


def test_an_obstacle_that_was_just_seen_needs_no_partner():
    obstacles = make_table()
    assert find(obstacles, "shoulder")[0] is None
    see(obstacles, 0.295, elbow=0.8)
    assert find(obstacles, "elbow")[0] is None
    assert find(obstacles, "elbow", 0.6, np.inf)[0] is None, "all of them are as old by then"


def test_an_untethered_obstacle_has_no_partner():
    obstacles = Obstacles()
    see(obstacles, 0.0, elbow=0.8)
    assert find(obstacles, "elbow")[0] is None


def shoulder_is_refused(obstacles):
    see(obstacles, 0.295, shoulder=3.0)


def shoulder_is_ahead(obstacles):
    obstacles.distrust(obstacles.row("shoulder"))


def shoulder_is_gone(obstacles):
    obstacles.remove(["shoulder"])


def shoulder_is_no_number(obstacles):
    see(obstacles, 0.295, shoulder=np.nan)


def tether_is_broken(obstacles):
    obstacles.tie_rows()
    obstacles.table.tethers.is_broken[0] = True


def elbow_is_anywhere(obstacles):
    see(obstacles, 0.295, elbow=np.nan)


@pytest.mark.parametrize(
    "change",
    [
        shoulder_is_refused,
        shoulder_is_ahead,
        shoulder_is_gone,
        shoulder_is_no_number,
        tether_is_broken,
        elbow_is_anywhere,
    ],
)
def test_nothing_is_proved_through_what_is_not_clear(change):
    obstacles = make_table()
    obstacles.untether("elbow", "hand")
    assert find(obstacles, "elbow")[0] == "shoulder"
    change(obstacles)
    assert find(obstacles, "elbow")[0] is None


def test_the_radius_is_that_of_the_largest_state_that_may_be_true():
    obstacles = make_table()
    see(obstacles, 0.295, radius=0.2, elbow=-3.0)
    name, radius, _ = find(obstacles, "elbow")
    assert name == "shoulder"
    assert 0.6 <= radius < 0.6 + 1e-9


def test_a_partner_that_is_hidden_says_less_as_it_ages():
    obstacles = Obstacles(accel=10.0, speed=2.0)
    obstacles.tether("elbow", "shoulder", 0.4, "measured")
    see(obstacles, 0.0, elbow=0.8, shoulder=1.1)
    see(obstacles, 0.3, shoulder=1.1)
    assert find(obstacles, "elbow", 0.4)[0] == "shoulder"
    # Now the shoulder is the one that is hidden.
    see(obstacles, 0.6, elbow=0.8)
    assert find(obstacles, "elbow", 0.7)[0] is None
