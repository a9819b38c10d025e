"""What the view knows beside the picture: is there a monitor, what does it do, what has happened.

Every bundle for a browser begins with this, as news: how old the present is, what the monitor says
of itself while it has no moments, and what has been added to the strip since that browser was told.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

from armguard.view.colours import LEVELS
from armguard.view.drawing import show
from armguard.view.film import Film, Moment


class FilmPosition:
    """How much of the film a browser has received."""

    def __init__(self) -> None:
        self.edition = -1
        self.moment = 0
        self.events = 0
        """Number of the last event that was told, counted from 1."""


class PageState:
    """Gathers what the page shows beside the picture.

    Args:
        address: Of the feed, for the page to say.
        clock: In [s].

    Attributes:
        film: The past.
        status: What the monitor says of itself; empty: nothing.
        is_over: Whether the monitor said that nothing will follow.
        is_connected: Whether a monitor is at the address; None: not known yet.
        problem: Why the feed cannot be read; empty: it can.
    """

    def __init__(self, address: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.film = Film()
        self.status = self.problem = ""
        self.is_over = False
        self.is_connected: bool | None = None
        self._address = address
        self._clock = clock
        self._last_frame: float | None = None

    def note_frame(self) -> None:
        """A frame has come: it is the present."""
        self._last_frame = self._clock()
        self.status = self.problem = ""

    def tell(self, told: FilmPosition) -> bytes:
        """The news for a browser; from now on it has been told them."""
        film = self.film
        is_new = told.edition != film.edition
        if is_new:
            told.edition, told.moment, told.events = film.edition, 0, 0
        fresh = itertools.takewhile(lambda one: one.number > told.moment, reversed(film.moments))
        moments = [describe_moment(moment) for moment in fresh][::-1]
        events = [event._asdict() for event in film.events if event.number > told.events]
        if moments:
            told.moment = told.events = film.moments[-1].number
        silence = None if self._last_frame is None else self._clock() - self._last_frame
        content: dict[str, Any] = {
            "address": self._address,
            "silence": silence,
            "status": self.status,
            "over": self.is_over,
            "connected": self.is_connected,
            "problem": self.problem,
            "anew": is_new,
            "first": film.moments[0].number if film.moments else 0,
            "moments": moments,
            "events": events,
        }
        return show("news", content).payload


def describe_moment(moment: Moment) -> tuple[Any, ...]:
    """A moment as the strip takes it."""
    level = LEVELS.index(moment.level) if moment.level in LEVELS else -1
    return (
        moment.number,
        moment.now,
        moment.wall,
        level,
        moment.contact_time,
        moment.stop_time,
        moment.speed_scale,
        moment.harm_time,
        moment.pace,
    )
