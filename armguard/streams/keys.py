"""Makes and reads files of CURVE key pairs (Curve25519).

A process with a secret key can act as the client of its public key. So a secret file is readable by
its owner only, and one that others can read is refused. The format is that of ZeroMQ's
certificates, which `zmq.auth` and CZMQ read as well.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from zmq.utils import z85

from armguard.exceptions import KeyFileError
from armguard.key_files import (
    PUBLIC_SUFFIX,
    SECRET_SUFFIX,
    check_secrecy,
    read_key_file,
    write_key_files,
)

KEY_LENGTH = 40
"""Characters of a key: 32 bytes in Z85."""


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A key pair in Z85; the secret half is never shown."""

    public: str
    secret: str = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> KeyPair:
        """Read a secret file.

        Raises:
            KeyFileError: If it cannot be read, others can read it, or it holds no pair of keys.
        """
        public, secret = _read(Path(path), is_secret=True)
        if secret is None:
            raise KeyFileError(
                str(path), "has no secret key", expected=f"a file NAME{SECRET_SUFFIX}"
            )
        if zmq.curve_public(secret.encode()).decode() != public:
            raise KeyFileError(str(path), "holds two keys that are no pair")
        return cls(public, secret)


@dataclass(frozen=True, slots=True)
class Keys:
    """Keys of a node, for a monitor that requires keys.

    Attributes:
        own: The node's pair.
        server: The monitor's public key, in Z85; the node connects to no other process.
    """

    own: KeyPair
    server: str

    @classmethod
    def load(cls, own: str | Path, server: str | Path) -> Keys:
        """Read the node's secret file and the monitor's public file.

        Raises:
            KeyFileError: If one of them cannot be used.
        """
        return cls(KeyPair.load(own), read_public(server))


def read_public(path: str | Path) -> str:
    """The public key in a public file, or in a secret file, which others must not read; in Z85.

    Raises:
        KeyFileError: If the file cannot be read or holds none.
    """
    return _read(Path(path), is_secret=False)[0]


def write_new_pair(name: str, folder: str | Path) -> tuple[Path, Path, str]:
    """Make a key pair and write it to NAME.secret, for its owner alone, and NAME.public.

    Args:
        name: Of the client, or of the monitor.
        folder: Where to; made if it is not there.

    Returns:
        Both paths, and the public key in Z85.

    Raises:
        KeyFileError: If the name makes no file name, a file is there already, or cannot be written.
    """
    public, secret = (key.decode() for key in zmq.curve_keypair())
    public_line = f'    public-key = "{public}"\n'
    secret_text = (
        f"# Secret key of {name}: it stays on the machine that uses it.\n"
        f'curve\n{public_line}    secret-key = "{secret}"\n'
    )
    public_text = f"# Public key of {name}, for those that speak with it.\ncurve\n{public_line}"
    return *write_key_files(name, folder, secret_text, public_text), public


def present(socket: zmq.Socket[Any], keys: Keys) -> None:
    """Make a socket authenticate with these keys, and connect only to the monitor of these keys.

    Must be called before it connects.
    """
    socket.set(zmq.CURVE_PUBLICKEY, keys.own.public.encode())
    socket.set(zmq.CURVE_SECRETKEY, keys.own.secret.encode())
    socket.set(zmq.CURVE_SERVERKEY, keys.server.encode())


def check_key(key: str) -> bool:
    """Whether a text can be a key."""
    if len(key) != KEY_LENGTH:
        return False
    try:
        z85.decode(key.encode("ascii"))
    except (ValueError, KeyError, struct.error):  # of a letter, or of five that are over 32 bits
        return False
    return True


def _read(path: Path, *, is_secret: bool) -> tuple[str, str | None]:
    """The public key in a file, and the secret one if it has one, both checked."""
    suffix = SECRET_SUFFIX if is_secret else PUBLIC_SUFFIX
    expected = f"a file that `armguard keys new` wrote, NAME{suffix}"
    text, mode = read_key_file(path, expected)
    found = dict(re.findall(r'^\s*(public|secret)-key\s*=\s*"([^"\n]*)"\s*$', text, re.MULTILINE))
    if "public" not in found:
        raise KeyFileError(str(path), "is no key file", expected=expected)
    if "secret" in found:
        check_secrecy(path, mode)
    for half, key in found.items():
        if not check_key(key):
            raise KeyFileError(str(path), f"has a {half} key that is none", expected=expected)
    return found["public"], found.get("secret")
