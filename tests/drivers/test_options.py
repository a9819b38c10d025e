import msgspec

from armguard.drivers.options import DriveOptions
from armguard.streams.keys import write_new_pair
from support.driven_cell import OPTIONS


def test_options_cross_a_command_line_as_they_are():
    assert msgspec.json.decode(msgspec.json.encode(OPTIONS), type=DriveOptions) == OPTIONS


def test_keys_are_read_where_there_are_some(tmp_path):
    assert OPTIONS.load_keys() is None
    secret, public, _ = write_new_pair("arm", tmp_path)
    with_keys = msgspec.structs.replace(OPTIONS, key_files=(str(secret), str(public)))
    assert with_keys.load_keys() is not None
