"""A clock whose time is set."""


class ManualClock:
    """A clock that moves only when it is told to."""

    def __init__(self, start=0.0):
        self._now = start

    def now(self):
        """The time it was last set to, in [s]."""
        return self._now

    def sleep_until(self, deadline):
        """Jump to `deadline` at once; never backwards."""
        self._now = max(self._now, deadline)
