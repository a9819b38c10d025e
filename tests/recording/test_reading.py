import random
import struct

import pytest

from armguard.exceptions import ArmguardError
from armguard.recording import Recording
from armguard.recording.events import FORMAT
from armguard.recording.parts import Rotation
from support.recordings_made import record


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "run.mcap"
    record(path, ticks=300)
    return path


def count(path):
    """Events that can be read, and whether the file has no end."""
    recording = Recording(path)
    number = sum(1 for _ in recording.events())
    return number, recording.is_cut_off


def test_a_part_that_is_missing_between_others_is_no_killed_writer(path, tmp_path):
    first = tmp_path / "run.mcap"
    record(first, ticks=900, recorder_options={"rotation": Rotation(size=4_000)})
    parts = [first, *(tmp_path / f"run.{part}.mcap" for part in range(2, 4))]
    assert all(part.is_file() for part in parts)
    whole, _ = count(first)
    parts[1].unlink()
    with pytest.raises(ArmguardError, match=r"run.2.mcap: is missing, but part 3 is there"):
        count(first)
    for file in tmp_path.glob("run.*.mcap"):
        file.unlink()
    left, is_cut_off = count(first)
    assert is_cut_off
    assert left < whole


def try_to_count(path):
    """What `count` says, or the line that tells why it cannot."""
    try:
        return count(path)
    except ArmguardError as error:
        return str(error)


def write(path, *, metadata=None, attachments=(), messages=()):
    """An MCAP file of this content."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        if metadata is not None:
            writer.add_metadata("armguard", metadata)
        for name, data in attachments:
            writer.add_attachment(0, 0, name, "application/json", data)
        for topic, data in messages:
            channel = writer.register_channel(topic, "json", 0)
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    return path


SETTINGS = (("settings.json", b"{}"), ("robot.json", b"{}"))


def test_a_file_that_was_cut_off_anywhere_is_read_as_far_as_it_goes(path, tmp_path):
    whole, cut = path.read_bytes(), tmp_path / "cut.mcap"
    everything, is_cut_off = count(path)
    assert not is_cut_off
    found = []
    for length in [*range(0, len(whole), len(whole) // 40), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        answer = try_to_count(cut)
        if isinstance(answer, str):
            assert "\n" not in answer
            assert not found, "only what ends before its settings cannot be read"
        else:
            found.append(answer)
    numbers = [number for number, _ in found]
    assert numbers == sorted(numbers)
    assert numbers[-1] == everything
    assert (0, True) in found


def test_a_damaged_file_is_one_line_or_what_stands_before_the_damage(path, tmp_path):
    whole, damaged = path.read_bytes(), tmp_path / "damaged.mcap"
    everything, _ = count(path)
    rng = random.Random(0)
    for _ in range(60):
        data = bytearray(whole)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        damaged.write_bytes(data)
        answer = try_to_count(damaged)
        if isinstance(answer, str):
            assert answer.startswith(f"{damaged}: ")
            assert "\n" not in answer
        else:
            assert answer[0] <= everything


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"q,v\n1,2\n" * 9, "is no MCAP file"),
        (b"\x89MCAP0\r\n", "is no recording of armguard"),
    ],
)
def test_a_foreign_file_is_told_by_name(content, words, tmp_path):
    path = tmp_path / "foreign.mcap"
    path.write_bytes(content)
    with pytest.raises(ArmguardError, match=words):
        Recording(path)


def test_a_file_that_is_not_there_and_a_folder_are_told(tmp_path):
    for path in (tmp_path / "nothing.mcap", tmp_path):
        with pytest.raises(ArmguardError, match="cannot be read"):
            Recording(path)


def test_a_recording_of_others_is_no_recording_of_armguard(tmp_path):
    path = write(tmp_path / "a.mcap", messages=[("/joint_states", b"{}")])
    with pytest.raises(ArmguardError, match="no recording of armguard"):
        Recording(path)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (str(FORMAT + 1), "a newer version.*armguard 0.9"),
        (str(FORMAT - 1), "an older version.*replay it with.* armguard 0.9"),
        ("one", "has format 'one'"),
        ("-1", "has format '-1'"),
    ],
)
def test_a_recording_of_another_version_is_refused(found, words, tmp_path):
    path = write(
        tmp_path / "a.mcap", metadata={"format": found, "armguard": "0.9"}, attachments=SETTINGS
    )
    with pytest.raises(ArmguardError, match=words):
        Recording(path)


def test_a_message_that_this_version_cannot_read_is_told(tmp_path):
    messages = [("/armguard/verdict", b'{"level": 3}')]
    path = write(
        tmp_path / "a.mcap",
        metadata={"format": str(FORMAT)},
        attachments=SETTINGS,
        messages=messages,
    )
    with pytest.raises(ArmguardError, match="message that cannot be read"):
        count(path)


def test_topics_of_others_in_a_recording_are_passed_over(tmp_path):
    messages = [("/camera/image", b"\x00"), ("/armguard/resets", b'{"token":""}')]
    path = write(
        tmp_path / "a.mcap",
        metadata={"format": str(FORMAT)},
        attachments=SETTINGS,
        messages=messages,
    )
    assert count(path) == (1, False)


def write_chunk(path, records, checksum=0):
    """A file with one chunk, not compressed."""
    chunk = struct.pack("<QQQIIQ", 0, 0, len(records), checksum, 0, len(records)) + records
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(chunk)) + chunk)
    return path


@pytest.mark.parametrize("opcode", [4, 5, 127])
@pytest.mark.parametrize("length", [0, 21, 2**31, 2**63, 2**64 - 1])
def test_a_record_in_a_chunk_may_say_any_length(opcode, length, tmp_path):
    path = write_chunk(tmp_path / "a.mcap", struct.pack("<BQ", opcode, length) + bytes(40))
    with pytest.raises(ArmguardError, match=r"is damaged|is no recording"):
        Recording(path)


def test_a_chunk_with_another_check_sum_is_damage(tmp_path):
    with pytest.raises(ArmguardError, match=r"is damaged .*crc"):
        Recording(write_chunk(tmp_path / "a.mcap", bytes(40), checksum=1))
