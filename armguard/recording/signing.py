"""Signatures of recordings: Ed25519 [Ed25519]_ by the package cryptography, keys in PEM files.

A signature shows that a holder of the secret key wrote the file up to there. The files are those
of OpenSSL and others, PKCS #8 for the secret key and SubjectPublicKeyInfo for the public one.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from armguard.exceptions import ArmguardError, KeyFileError
from armguard.key_files import (
    PUBLIC_SUFFIX,
    SECRET_SUFFIX,
    check_secrecy,
    read_key_file,
    write_key_files,
)

_CONTEXT = b"armguard recording\n"
"""Prefix of signed data, so that no signature is valid for other data."""

_EXPECTED = "a file that `armguard keys new --recordings` wrote, NAME"


class FileSigner:
    """Signs with the secret key in a file.

    Args:
        path: The secret file.

    Attributes:
        public: The public key, in hexadecimal digits.

    Raises:
        ArmguardError: It cannot be read, others can read it, it holds no such key, or the package
            for signatures is missing.
    """

    def __init__(self, path: str | Path) -> None:
        check_installed()
        from cryptography.exceptions import UnsupportedAlgorithm
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        text, mode = read_key_file(Path(path), _EXPECTED + SECRET_SUFFIX)
        try:
            key = load_pem_private_key(text.encode(), None)
        except (ValueError, TypeError, UnsupportedAlgorithm):
            key = None
        if not isinstance(key, Ed25519PrivateKey):
            raise KeyFileError(
                str(path), "holds no secret key of recordings", expected=_EXPECTED + SECRET_SUFFIX
            )
        check_secrecy(Path(path), mode)
        self._key = key
        self.public = key.public_key().public_bytes_raw().hex()

    def sign(self, head: str) -> str:
        """The signature of a head, in hexadecimal digits."""
        return self._key.sign(_CONTEXT + head.encode()).hex()


def write_signing_pair(name: str, folder: str | Path) -> tuple[Path, Path, str]:
    """Make a key pair for recordings, and write it to NAME.secret and NAME.public.

    Args:
        name: Of who records.
        folder: Where to; made if it is not there.

    Returns:
        Both paths, and the public key in hexadecimal digits.

    Raises:
        ArmguardError: The name makes no file name, a file is there already or cannot be written,
            or the package for signatures is missing.
    """
    check_installed()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
        PublicFormat,
    )

    key = Ed25519PrivateKey.generate()
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode()
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo).decode()
    paths = write_key_files(name, folder, secret, public)
    return *paths, key.public_key().public_bytes_raw().hex()


def read_signing_key(path: str | Path) -> str:
    """The public key in a public file, in hexadecimal digits.

    Raises:
        ArmguardError: It cannot be read, holds no such key, or the package for signatures is
            missing.
    """
    check_installed()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    text, _ = read_key_file(Path(path), _EXPECTED + PUBLIC_SUFFIX)
    try:
        key = load_pem_public_key(text.encode())
    except (ValueError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PublicKey):
        raise KeyFileError(
            str(path), "holds no public key of recordings", expected=_EXPECTED + PUBLIC_SUFFIX
        )
    return key.public_bytes_raw().hex()


def is_signed(key: str, signature: str, head: str) -> bool:
    """Whether a signature is that of a head by a key.

    Args:
        key: The public key, in hexadecimal digits.
        signature: In hexadecimal digits.
        head: What was signed.

    Raises:
        ArmguardError: The package for signatures is missing.
    """
    check_installed()
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        signed = bytes.fromhex(signature)
        public = Ed25519PublicKey.from_public_bytes(bytes.fromhex(key))
        public.verify(signed, _CONTEXT + head.encode())
    except (ValueError, InvalidSignature):
        return False
    # No other spelling of the same digits counts, so that a changed byte is one.
    return signed.hex() == signature


def check_installed() -> None:
    """Refuse if the package for signatures is missing.

    Raises:
        ArmguardError: It is missing.
    """
    if importlib.util.find_spec("cryptography") is None:
        raise ArmguardError(
            "signatures of recordings",
            "need the package cryptography, which is not installed",
            remedy="pip install 'armguard[record]'",
        )
