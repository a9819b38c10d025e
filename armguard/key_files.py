"""Files of key pairs: made so that nobody else can read a secret, and refused where others can."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from armguard.exceptions import KeyFileError

SECRET_SUFFIX = ".secret"
PUBLIC_SUFFIX = ".public"

_LARGEST_FILE = 4096
"""Bytes of a key file at most: a longer one is something else."""


def write_key_files(name: str, folder: str | Path, secret: str, public: str) -> tuple[Path, Path]:
    """Write a pair to NAME.secret, for its owner alone, and NAME.public; both paths.

    Args:
        name: Of who holds the secret key.
        folder: Where to; made if it is not there.
        secret: Text of the secret file.
        public: Text of the public one.

    Raises:
        KeyFileError: If the name makes no file name, a file is there already, or cannot be written.
    """
    if re.fullmatch(r"[\w-][\w.-]*", name) is None:
        raise KeyFileError(repr(name), "makes no name of a file", expected="letters, digits, -_.")
    folder = Path(folder)
    secret_path, public_path = folder / f"{name}{SECRET_SUFFIX}", folder / f"{name}{PUBLIC_SUFFIX}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise KeyFileError(str(folder), f"cannot be made ({error.strerror})") from None
    try:
        if public_path.exists():
            raise FileExistsError
        # Others are kept out from the first moment on, and a file that is there is left alone.
        for path, text, mode in (
            (secret_path, secret, 0o600),
            (public_path, public, 0o644),
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
    return secret_path, public_path


def read_key_file(path: Path, expected: str) -> tuple[str, int]:
    """The text of a key file, and the file's mode.

    Args:
        path: The file.
        expected: What it should be, in words for errors.

    Raises:
        KeyFileError: It cannot be read, or is too long.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            text = file.read(_LARGEST_FILE + 1).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise KeyFileError(str(path), f"cannot be read ({reason})", expected=expected) from None
    if len(text) > _LARGEST_FILE:
        raise KeyFileError(str(path), "is no key file", expected=expected)
    return text, mode


def check_secrecy(path: Path, mode: int) -> None:
    """Refuse a secret file that others can use.

    Args:
        path: The file.
        mode: Its mode.

    Raises:
        KeyFileError: Others can.
    """
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(
            str(path),
            f"can be read by others (mode {stat.S_IMODE(mode):04o})",
            expected="a secret file that its owner alone can read",
            remedy=f"make new keys; or `chmod 600 {path}`, if it was not read",
        )
