import shutil
import subprocess

import pytest

from armguard.exceptions import ArmguardError, KeyFileError
from armguard.recording import signing
from armguard.recording.signing import (
    FileSigner,
    is_signed,
    read_signing_key,
    write_signing_pair,
)
from armguard.streams.keys import KeyPair, write_new_pair


@pytest.fixture
def pair(tmp_path):
    return write_signing_pair("recorder", tmp_path / "keys")


def test_what_a_pair_signs_is_known_by_its_public_file(pair, tmp_path):
    secret, public, key = pair
    signer = FileSigner(secret)
    assert signer.public == key == read_signing_key(public)
    signature = signer.sign("abc")
    assert is_signed(key, signature, "abc")
    assert not is_signed(key, signature, "abd")
    assert not is_signed(key, signature.upper(), "abc")
    assert not is_signed(key, f"{signature} ", "abc")
    other = FileSigner(write_signing_pair("other", tmp_path)[0])
    assert not is_signed(other.public, signature, "abc")
    assert not is_signed(key, other.sign("abc"), "abc")


@pytest.mark.parametrize("wrong", ["", "zz", "00" * 64, "ab" * 63, "é"])
def test_what_is_no_key_or_signature_signs_nothing(pair, wrong):
    key = pair[2]
    assert not is_signed(key, wrong, "abc")
    assert not is_signed(wrong, FileSigner(pair[0]).sign("abc"), "abc")


def test_openssl_reads_the_files(pair):
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl here")
    for path, options in ((pair[0], []), (pair[1], ["-pubin"])):
        told = subprocess.run(
            [openssl, "pkey", "-in", path, "-noout", "-text", *options],
            capture_output=True,
            text=True,
            check=False,
        )
        assert "ED25519" in told.stdout.upper(), told.stderr


def test_other_files_are_refused_by_name(pair, tmp_path):
    secret, public, _ = pair
    stream_secret, stream_public, _ = write_new_pair("camera", tmp_path)
    for path in (stream_secret, public):
        with pytest.raises(KeyFileError, match="holds no secret key of recordings"):
            FileSigner(path)
    for path in (stream_public, secret):
        with pytest.raises(KeyFileError, match="holds no public key of recordings"):
            read_signing_key(path)
    with pytest.raises(KeyFileError, match="is no key file"):
        KeyPair.load(secret)
    secret.chmod(0o640)
    with pytest.raises(KeyFileError, match="can be read by others"):
        FileSigner(secret)


def test_without_its_package_it_says_what_to_install(pair, monkeypatch):
    monkeypatch.setattr(signing.importlib.util, "find_spec", lambda name: None)
    for use in (
        lambda: FileSigner(pair[0]),
        lambda: read_signing_key(pair[1]),
        lambda: is_signed("", "", ""),
    ):
        with pytest.raises(ArmguardError, match=r"pip install 'armguard\[record\]'"):
            use()
