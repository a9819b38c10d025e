"""Reports permitted and forbidden contact as reasons of a verdict.

To compute how much a limit is exceeded takes as long as a stop decision. So it is computed only in
STOP and SLOW, for one obstacle, and the result is reported for `TOLD_FOR`.
"""

from __future__ import annotations

import math

from armguard.pairs.forbidden import CLAMPED, MOST_WAY, NEVER, PERMITTED, Forbidden
from armguard.scheduling.scheduler import PermittedContact, Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY
from armguard.settings.contact_limits import ContactLimits
from armguard.verdict import Reason, ReasonKind

TOLD_FOR = 0.2
"""How long a reason of a pair is reported before its figures are computed again, in [s]."""


class LimitReasons:
    """Reports permitted and forbidden contact, its limit, and the figures.

    Args:
        scheduler: Knows the pairs.
        limits: The contact limits.
    """

    def __init__(self, scheduler: Scheduler, limits: ContactLimits) -> None:
        self._scheduler = scheduler
        self._limits = limits
        self._permitted: tuple[PermittedContact, str, int] | None = None
        self._told_permitted = Reason(ReasonKind.CONTACT_ALLOWED)
        self.reset()

    def reset(self) -> None:
        """Drop the reasons; the clock may start anew."""
        self._asked: tuple[int, str, int, float] | None = None
        self._asked_at = -math.inf
        self._told_forbidden: Reason | None = None

    def tell_permitted(self, permitted: PermittedContact) -> Reason:
        """The permitted contact that the level rests on, with its greatest speed and its limit."""
        link, obstacle = self._scheduler.arm.names(permitted.pair)
        regions = self._find_regions(permitted.pair)
        # A row can be another obstacle's by now, or of another region, and be touched as fast.
        if (permitted, obstacle, regions) == self._permitted:
            return self._told_permitted
        stated = self._limits.describe(regions)
        detail = f"at most {permitted.speed:.2f} of {permitted.limit:.2f} m/s ({stated})"
        self._permitted = permitted, obstacle, regions
        self._told_permitted = Reason(ReasonKind.CONTACT_ALLOWED, f"{link} and {obstacle}", detail)
        return self._told_permitted

    def tell_forbidden(self, tick: Tick, pair: int, horizon: float, begin: str) -> Reason | None:
        """Why limits forbid a contact with an arm after a STOP; None if none does.

        This overwrites the table of braking, so it must run after all stop decisions of the tick.

        Args:
            tick: The tick.
            pair: The pair that made the last stop decision a STOP; NOBODY if it is unknown.
            horizon: Time of the STOP, in [s] from the tick.
            begin: Beginning of a detail with figures.
        """
        ids, row = self._scheduler.arm.obstacles.ids, pair // len(self._scheduler.arm.links)
        # It may have been removed since.
        if pair == NOBODY or not (row < len(ids) and ids[row]):
            return None
        asked = pair, ids[row], self._find_regions(pair), horizon
        if asked != self._asked or not tick.now - self._asked_at < TOLD_FOR:
            self._asked, self._asked_at = asked, tick.now
            self._told_forbidden = self._explain(tick, pair, horizon, begin)
        return self._told_forbidden

    def _explain(self, tick: Tick, pair: int, horizon: float, begin: str) -> Reason | None:
        """Compute why a contact of a pair is forbidden."""
        braking = self._scheduler.arm.motion.braking
        if not braking.covers(tick.q, tick.v, tick.arm_age, horizon):
            return None
        braking.tabulate(tick.q, tick.v, tick.arm_age, horizon)
        found = self._scheduler.find_forbidden(pair, tick)
        if found.why == PERMITTED:
            return None
        links = len(self._scheduler.arm.links)
        link, obstacle = self._scheduler.arm.names(pair // links * links + found.link)
        detail = self._describe(found, self._find_regions(pair), begin)
        return Reason(ReasonKind.CONTACT_FORBIDDEN, f"{link} and {obstacle}", detail)

    def _find_regions(self, pair: int) -> int:
        """The set of regions of a pair's obstacle."""
        row = pair // len(self._scheduler.arm.links)
        return int(self._scheduler.arm.obstacles.table.regions[row])

    def _describe(self, found: Forbidden, regions: int, begin: str) -> str:
        """How much a limit is exceeded, in words."""
        if found.why == NEVER:
            return self._limits.describe_never(regions)
        if found.why == CLAMPED:
            return begin + self._describe_clamp(found, regions)
        stated = self._limits.describe(regions)
        limit = f"{self._scheduler.find_limit(regions).max_speed:.3g} m/s"
        if not math.isfinite(found.figure):
            return f"{begin}at any speed; at most {limit} is permitted ({stated})"
        speed = f"{_round_up(found.figure):.3g} m/s"
        return f"{begin}at up to {speed}, above the limit of {limit} ({stated})"

    def _describe_clamp(self, found: Forbidden, regions: int) -> str:
        """How far a clamped body part could be pressed, in words."""
        against = "the arm itself or what is near it"
        if found.against != NOBODY:
            against = self._scheduler.arm.obstacles.ids[found.against]
        begin = f"can be clamped against {against}"
        stated = self._limits.describe(regions, by="max_way")
        most = 1e3 * self._scheduler.find_limit(regions).max_way
        if not most > 0.0:
            return f"{begin}, where nothing is permitted without force and stiffness ({stated})"
        far = f"by more than {MOST_WAY * most:.3g} mm"
        if math.isfinite(found.figure):
            far = f"by up to {_round_up(1e3 * found.figure):.3g} mm"
        return f"{begin}: the link could go on {far}, above the limit of {most:.3g} mm ({stated})"


def _round_up(figure: float) -> float:
    """A figure rounded up to three digits, so that it stays visibly above its limit."""
    if not figure > 0.0:
        return figure
    unit = 10.0 ** (math.floor(math.log10(figure)) - 2)
    return unit * math.ceil(figure / unit)
