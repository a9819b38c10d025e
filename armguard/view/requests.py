"""Requests from a page to its view: short lines of JSON, checked before they are obeyed.

{"type": "done"}                     the last bundle is drawn
{"type": "seek", "number": 12}       show this moment of the past; null: the present again
{"type": "layers", "volume": true}   draw the stopping volume, too
{"type": "reset", "token": "…"}      hand the monitor a reset
"""

from __future__ import annotations

import msgspec

from armguard.exceptions import ArmguardError

LONGEST = 512
"""Greatest size of a line, in [bytes]."""


class Done(msgspec.Struct, frozen=True, tag="done", forbid_unknown_fields=True):
    """The last bundle is drawn."""


class Seek(msgspec.Struct, frozen=True, tag="seek", forbid_unknown_fields=True):
    """Show a moment of the past."""

    number: int | None
    """Number of the moment; None: the present."""


class Layers(msgspec.Struct, frozen=True, tag="layers", forbid_unknown_fields=True):
    """Draw layers that take time to compute."""

    volume: bool
    """Whether to draw the volume in which the arm can be until it is at rest."""


class ResetRequest(msgspec.Struct, frozen=True, tag="reset", forbid_unknown_fields=True):
    """End a latched STOP."""

    token: str


Request = Done | Seek | Layers | ResetRequest

_decoder = msgspec.json.Decoder(Request)


def read_request(line: str | bytes) -> Request:
    """Read a request of a page.

    Raises:
        ArmguardError: The page may not send this.
    """
    if not isinstance(line, str) or len(line) > LONGEST:
        raise ArmguardError("page", "sent something other than a short line of text")
    try:
        request: Request = _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeEncodeError) as error:
        raise ArmguardError("page", str(error)) from error
    return request
