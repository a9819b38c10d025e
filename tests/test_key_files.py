import stat
from pathlib import Path

import pytest

from armguard.exceptions import KeyFileError
from armguard.key_files import check_secrecy, read_key_file, write_key_files


def test_a_pair_of_files_is_read_again_and_its_secret_is_its_owners(tmp_path):
    secret, public = write_key_files("cell-1.left", tmp_path / "keys", "hidden", "shown")
    assert (secret.name, public.name) == ("cell-1.left.secret", "cell-1.left.public")
    text, mode = read_key_file(secret, "a file")
    assert (text, stat.S_IMODE(mode)) == ("hidden", 0o600)
    check_secrecy(secret, mode)
    text, mode = read_key_file(public, "a file")
    assert text == "shown"
    with pytest.raises(KeyFileError, match=r"can be read by others .*0644"):
        check_secrecy(public, mode)


@pytest.mark.parametrize("left", ["cell.secret", "cell.public"])
def test_no_key_is_written_over(tmp_path, left):
    (tmp_path / left).write_text("precious")
    with pytest.raises(KeyFileError, match="has keys already"):
        write_key_files("cell", tmp_path, "hidden", "shown")
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [(left, "precious")]


@pytest.mark.parametrize("name", ["", "../x", "a/b", ".hidden", "a b", "a\n"])
def test_a_name_that_makes_no_file_is_refused(tmp_path, name):
    with pytest.raises(KeyFileError, match="makes no name"):
        write_key_files(name, tmp_path, "hidden", "shown")
    assert not list(tmp_path.iterdir())


def test_what_is_no_key_file_is_told(tmp_path):
    long, binary = tmp_path / "long", tmp_path / "binary"
    long.write_text("x" * 5000)
    binary.write_bytes(b"\xff\xfe")
    for path, words in (
        (long, "is no key file"),
        (binary, "not UTF-8"),
        (tmp_path / "nowhere", "No such file"),
        (Path("/"), "Is a directory"),
    ):
        with pytest.raises(KeyFileError, match=words):
            read_key_file(path, "a file")


def test_a_file_in_place_of_the_folder_is_told_of(tmp_path):
    (tmp_path / "keys").write_text("a file")
    with pytest.raises(KeyFileError, match=r"keys: cannot be made \(File exists\)"):
        write_key_files("cell", tmp_path / "keys", "hidden", "shown")
