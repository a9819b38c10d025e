"""The settings of a monitor: one record, and what its declarations say of each of them."""

from armguard.settings.settings import Settings

__all__ = [
    "Settings",
]
