"""What a page may say to its view: little, each a short line of JSON, checked before it is obeyed.

{"type": "done"}                     the last bundle is drawn
{"type": "seek", "number": 12}       show this moment of the past; null: the present again
{"type": "layers", "volume": true}   draw the stopping volume, too
{"type": "reset", "token": "…"}      hand the monitor a reset
"""

from __future__ import annotations

import msgspec

from armguard.exceptions import ArmguardError

LONGEST = 512
"""Of a line, in bytes."""


class Done(msgspec.Struct, frozen=True, tag="done", forbid_unknown_fields=True):
    """The last bundle is drawn."""


class Seek(msgspec.Struct, frozen=True, tag="seek", forbid_unknown_fields=True):
    """Show a moment of the past."""

    number: int | None
    """Of the moment; None: the present."""


class Layers(msgspec.Struct, frozen=True, tag="layers", forbid_unknown_fields=True):
    """Draw what takes time to find."""

    volume: bool
    """Where the arm can be until it rests."""


class ResetRequest(msgspec.Struct, frozen=True, tag="reset", forbid_unknown_fields=True):
    """End a latched STOP."""

    token: str


Request = Done | Seek | Layers | ResetRequest

_decoder = msgspec.json.Decoder(Request)


def read_request(line: str | bytes) -> Request:
    """Read what a page said.

    Raises:
        ArmguardError: It is nothing that a page may say.
    """
    if not isinstance(line, str) or len(line) > LONGEST:
        raise ArmguardError("page", "said something that is no short line of text")
    try:
        request: Request = _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeEncodeError) as error:
        raise ArmguardError("page", str(error)) from error
    return request
