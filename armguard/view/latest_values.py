"""Keeps the latest value of each drawing command, and which values each browser still needs.

A new browser needs every value. A slow browser gets, for each key, only the latest value when it
asks next. Memory is therefore bounded by the number of keys, whatever the browsers do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from armguard.view.drawing import Command

BUNDLE_BYTES = 500_000
"""Approximate size of a bundle of commands, so that no browser waits for all meshes at once."""

LARGE = 50_000
"""Larger commands, such as meshes, are sent last, so that figures and balls appear at once."""


class Reader:
    """The values that one browser still needs; made by `LatestValues.attach`."""

    def __init__(self, values: dict[str, bytes]) -> None:
        self._values = values
        self._owed = dict.fromkeys(values)

    def owes(self, prefix: str = "") -> bool:
        """Whether the browser still needs values of keys with this prefix."""
        return any(key.startswith(prefix) for key in self._owed)

    def owe(self, key: str) -> None:
        """Note that a value has changed."""
        self._owed[key] = None

    def owe_again(self, keys: Iterable[str]) -> None:
        """Note that the browser does not show the latest values of these keys."""
        self._owed.update(dict.fromkeys(key for key in keys if key in self._values))

    def restart(self) -> None:
        """Drop all owed values: none is valid any more."""
        self._owed.clear()

    def take(self, preface: bytes, prefix: str = "") -> bytes | None:
        """The next bundle, a msgpack array of commands; None if the browser needs nothing.

        Args:
            preface: A packed command to put before the others.
            prefix: Prefix of the other commands' keys.
        """
        parts = self._take_some(prefix)
        return join([preface, *parts]) if parts else None

    def _take_some(self, prefix: str) -> list[bytes]:
        parts: list[bytes] = []
        size = 0
        wanted = [key for key in self._owed if key.startswith(prefix)]
        for key in sorted(wanted, key=lambda key: len(self._values[key]) > LARGE):
            if size >= BUNDLE_BYTES or len(parts) >= 0xFFFE:
                break
            del self._owed[key]
            parts.append(self._values[key])
            size += len(parts[-1])
        return parts


def join(payloads: Sequence[bytes]) -> bytes:
    """Packed commands, fewer than 2^16 of them, as one bundle: a msgpack array."""
    return b"\xdc" + len(payloads).to_bytes(2, "big") + b"".join(payloads)


class LatestValues:
    """The latest value of each key, in the order in which the keys were first set."""

    def __init__(self) -> None:
        self._values: dict[str, bytes] = {}
        self._readers: set[Reader] = set()

    @property
    def payloads(self) -> list[bytes]:
        """All values, in the order in which their keys were first set."""
        return list(self._values.values())

    def set(self, command: Command) -> None:
        """Keep a value; one that is unchanged is not sent again."""
        if self._values.get(command.key) == command.payload:
            return
        self._values[command.key] = command.payload
        for reader in self._readers:
            reader.owe(command.key)

    def clear(self, command: Command) -> None:
        """Drop all values; `command` makes browsers delete all that they have drawn."""
        self._values.clear()
        for reader in self._readers:
            reader.restart()
        self.set(command)

    def attach(self) -> Reader:
        """A new reader, which needs all values."""
        reader = Reader(self._values)
        self._readers.add(reader)
        return reader

    def detach(self, reader: Reader) -> None:
        """Remove a reader."""
        self._readers.discard(reader)
