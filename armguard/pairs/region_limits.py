"""Contact limits as they are stated, by number of region, for compiled code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armguard.obstacles.regions import RegionLimits, make_no_limits

if TYPE_CHECKING:
    from armguard.settings.contact_limits import ContactLimits


def read_region_limits(stated: ContactLimits | None) -> RegionLimits:
    """What contact is permitted; without limits, none."""
    return make_no_limits() if stated is None else RegionLimits(*stated.tabulate())
