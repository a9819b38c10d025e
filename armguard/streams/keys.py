"""Key pairs of CURVE (Curve25519), in files: made, kept from others, and read again.

A process that holds a secret key is the client that its public key names. So a secret file is made
for its owner alone, and one that others can read is no longer secret, and refused. The format is
that of ZeroMQ's own certificates, which `zmq.auth` and CZMQ read as well.
"""

from __future__ import annotations

import os
import re
import stat
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from zmq.utils import z85

from armguard.exceptions import KeyFileError

SECRET_SUFFIX = ".secret"
PUBLIC_SUFFIX = ".public"

KEY_LENGTH = 40
"""Characters of a key: 32 bytes in Z85."""

_LARGEST_FILE = 4096
"""Bytes of a key file at most: a longer one is something else."""


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
    """What a node needs to speak with a monitor that asks for keys.

    Attributes:
        own: The node's pair.
        server: The monitor's public key, in Z85: nothing else is spoken to.
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
    """The public key in a public file (or in a secret one, which is then to be secret), in Z85.

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
    if re.fullmatch(r"[\w-][\w.-]*", name) is None:
        raise KeyFileError(repr(name), "makes no name of a file", expected="letters, digits, -_.")
    public, secret = (key.decode() for key in zmq.curve_keypair())
    folder = Path(folder)
    secret_path, public_path = folder / f"{name}{SECRET_SUFFIX}", folder / f"{name}{PUBLIC_SUFFIX}"
    public_line = f'    public-key = "{public}"\n'
    secret_text = (
        f"# Secret key of {name}: it stays on the machine that uses it.\n"
        f'curve\n{public_line}    secret-key = "{secret}"\n'
    )
    public_text = f"# Public key of {name}, for those that speak with it.\ncurve\n{public_line}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if public_path.exists():
            raise FileExistsError
        # Others are kept out from the first moment on, and a file that is there is left alone.
        for path, text, mode in (
            (secret_path, secret_text, 0o600),
            (public_path, public_text, 0o644),
        ):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with open(descriptor, "w", encoding="ascii") as file:
                file.write(text)
    except FileExistsError:
        raise KeyFileError(
            str(folder / name),
            "has keys already",
            remedy="name another folder or name, or remove both files",
        ) from None
    except OSError as error:
        raise KeyFileError(str(folder / name), f"cannot be written ({error.strerror})") from None
    return secret_path, public_path, public


def present(socket: zmq.Socket[Any], keys: Keys) -> None:
    """Have a socket prove who it is, and speak with the monitor of these keys only.

    To be called before it connects.
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
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            text = file.read(_LARGEST_FILE + 1).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise KeyFileError(str(path), f"cannot be read ({reason})", expected=expected) from None
    found = dict(re.findall(r'^\s*(public|secret)-key\s*=\s*"([^"\n]*)"\s*$', text, re.MULTILINE))
    if len(text) > _LARGEST_FILE or "public" not in found:
        raise KeyFileError(str(path), "is no key file", expected=expected)
    if "secret" in found and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(
            str(path),
            f"can be read by others (mode {stat.S_IMODE(mode):04o})",
            expected="a secret file that its owner alone can read",
            remedy=f"make new keys; or `chmod 600 {path}`, if it was not read",
        )
    for half, key in found.items():
        if not check_key(key):
            raise KeyFileError(str(path), f"has a {half} key that is none", expected=expected)
    return found["public"], found.get("secret")
