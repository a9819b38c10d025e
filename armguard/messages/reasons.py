"""Reasons on the wire: their kinds by name."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from armguard.verdict import Reason, ReasonKind

_KINDS = {kind: kind.name.lower() for kind in ReasonKind}
_KINDS_BY_NAME = {name: kind for kind, name in _KINDS.items()}


class ReasonMessage(msgspec.Struct):
    """One reason of a verdict, of a command, or of the answer to a plan."""

    kind: str
    """name of the kind"""
    subject: str
    """joint, obstacle or source that it is about"""
    detail: str
    """what was found and what was expected"""


def write_reasons(reasons: Iterable[Reason]) -> list[ReasonMessage]:
    """Reasons as messages."""
    return [ReasonMessage(_KINDS[kind], subject, detail) for kind, subject, detail in reasons]


def read_reasons(reasons: Iterable[ReasonMessage]) -> tuple[Reason, ...]:
    """Reasons of messages.

    Raises:
        ValueError: A kind is unknown.
    """
    for one in reasons:
        if one.kind not in _KINDS_BY_NAME:
            raise ValueError(f"reason {one.kind!r}")
    return tuple(Reason(_KINDS_BY_NAME[one.kind], one.subject, one.detail) for one in reasons)
