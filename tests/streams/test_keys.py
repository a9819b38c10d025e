import stat

import pytest
import zmq
import zmq.auth

from armguard.exceptions import KeyFileError, StreamError
from armguard.streams import Authenticator, Client, KeyPair, Keys
from armguard.streams.keys import check_key, read_public, write_new_pair
from support.key_rings import make_pair


def test_a_pair_that_was_written_is_read_again(tmp_path):
    secret, public, key = write_new_pair("cam-0.left", tmp_path / "keys")
    assert (secret.name, public.name) == ("cam-0.left.secret", "cam-0.left.public")
    pair = KeyPair.load(secret)
    assert pair.public == key == read_public(public)
    assert zmq.curve_public(pair.secret.encode()).decode() == key
    # ZeroMQ's own reader takes the same files.
    assert zmq.auth.load_certificate(secret) == (key.encode(), pair.secret.encode())
    assert zmq.auth.load_certificate(public) == (key.encode(), None)
    assert Keys.load(secret, public).server == key


def test_only_the_owner_can_read_a_new_secret(tmp_path):
    secret, public, _ = write_new_pair("camera", tmp_path)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    assert "secret-key" not in public.read_text()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o620, 0o601])
def test_a_secret_that_others_can_use_is_refused_by_name(tmp_path, mode):
    secret, _, _ = write_new_pair("camera", tmp_path)
    secret.chmod(mode)
    with pytest.raises(KeyFileError, match=rf"camera\.secret: can be read by others .*{mode:04o}"):
        KeyPair.load(secret)
    secret.chmod(0o400)
    KeyPair.load(secret)


@pytest.mark.parametrize("left", ["camera.secret", "camera.public"])
def test_keys_are_never_written_over(tmp_path, left):
    (tmp_path / left).write_text("precious")
    with pytest.raises(KeyFileError, match="has keys already"):
        write_new_pair("camera", tmp_path)
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [(left, "precious")]


@pytest.mark.parametrize("name", ["", "../x", "a/b", ".hidden", "a b", "a\n"])
def test_a_name_that_makes_no_file_is_refused(tmp_path, name):
    with pytest.raises(KeyFileError, match="makes no name"):
        write_new_pair(name, tmp_path)
    assert not list(tmp_path.iterdir())


def spoil(text, what):
    pair = make_pair()
    lines = {
        "empty": "",
        "foreign": "ssh-ed25519 AAAA",
        "short": 'public-key = "abc"',
        "no letters": f'public-key = "{"~" * 40}"',
        "beyond 32 bits": f'public-key = "{"#" * 40}"',
        "no pair": f'public-key = "{pair.public}"\nsecret-key = "{make_pair().secret}"',
        "no secret": f'public-key = "{pair.public}"',
        "long": text + "#" * 5000,
    }
    return lines[what]


@pytest.mark.parametrize(
    "what",
    ["empty", "foreign", "short", "no letters", "beyond 32 bits", "no pair", "no secret", "long"],
)
def test_files_that_hold_no_pair_are_refused_by_name(tmp_path, what):
    secret, _, _ = write_new_pair("camera", tmp_path)
    secret.write_text(spoil(secret.read_text(), what))
    with pytest.raises(KeyFileError, match=r"camera\.secret") as caught:
        KeyPair.load(secret)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_no_text_is_refused_by_name(tmp_path):
    (tmp_path / "x.public").write_bytes(b"\xff\xfe")
    for name in ("x.public", "none.public", "."):
        with pytest.raises(KeyFileError, match="cannot be read"):
            read_public(tmp_path / name)


def test_a_secret_is_not_shown():
    pair = make_pair()
    assert pair.secret not in repr(pair) + repr(Keys(pair, pair.public))


def test_no_key_is_for_two_clients_and_none_is_made_up():
    ring = make_pair()
    may = frozenset(["obstacles"])
    one = Client(make_pair().public, may)
    with pytest.raises(StreamError, match="left, too"):
        Authenticator(ring, {"left": one, "right": one})
    assert not check_key("x" * 39)
    with pytest.raises(StreamError, match="public key of left"):
        Authenticator(ring, {"left": Client("~" * 40, may)})
