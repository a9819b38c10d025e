"""State of the page apart from the picture: connection, status of the monitor, and past.

Every bundle for a browser begins with it as `news`: the age of the newest moment, the status of a
monitor without moments, and additions to the strip since the last bundle for that browser.
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
    """Position in the film up to which a browser has received it."""

    def __init__(self) -> None:
        self.edition = -1
        self.moment = 0
        self.events = 0
        """Number of the last event that was sent, counted from 1."""


class PageState:
    """Collects what the page shows apart from the picture.

    Args:
        address: Address of the feed, which the page shows.
        clock: Returns the time in [s].

    Attributes:
        film: The past.
        status: Status text of the monitor; empty: none.
        is_over: Whether the monitor announced its end.
        is_connected: Whether a monitor is at the address; None: not known yet.
        problem: Why the feed cannot be read; empty if it can.
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
        """Note a new frame, which is now the newest moment."""
        self._last_frame = self._clock()
        self.status = self.problem = ""

    def tell(self, told: FilmPosition) -> bytes:
        """The news for a browser; marks them as sent."""
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
    """A moment in the form that the strip reads."""
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
