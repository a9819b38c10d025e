import msgspec

from armguard.view.drawing import Command
from armguard.view.latest_values import BUNDLE_BYTES, LatestValues

PREFACE = msgspec.msgpack.encode("preface")


def command(key, value):
    return Command(key, msgspec.msgpack.encode(value))


def read_all(reader):
    values = []
    while (bundle := reader.take(PREFACE)) is not None:
        preface, *commands = msgspec.msgpack.decode(bundle)
        assert preface == "preface"
        values += commands
    return values


def test_what_did_not_change_is_not_told_again():
    latest = LatestValues()
    reader = latest.attach()
    latest.set(command("a", 1))
    assert read_all(reader) == [1]
    latest.set(command("a", 1))
    assert reader.take(PREFACE) is None


def test_large_values_come_in_several_bundles():
    latest = LatestValues()
    for value in range(5):
        latest.set(command(str(value), b"x" * BUNDLE_BYTES))
    reader = latest.attach()
    bundles = [reader.take(PREFACE) for _ in range(5)]
    assert all(len(msgspec.msgpack.decode(bundle)) == 2 for bundle in bundles)
    assert reader.take(PREFACE) is None


def test_nothing_of_a_cleared_picture_is_told():
    latest = LatestValues()
    old, new = latest.attach(), latest.attach()
    latest.set(command("a", 1))
    read_all(old)
    latest.clear(command("clear", "all"))
    latest.set(command("b", 2))
    for reader in (old, new, latest.attach()):
        assert read_all(reader) == ["all", 2]


def test_who_has_left_is_forgotten():
    latest = LatestValues()
    reader = latest.attach()
    latest.detach(reader)
    latest.detach(reader)
    latest.set(command("a", 1))
    assert reader.take(PREFACE) is None
