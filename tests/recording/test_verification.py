"""Whoever changes a recording is found: one byte, one chunk, the order, the end, a file."""

import hashlib
import itertools
import os
import random
import re
import shutil

import pytest

from armguard.exceptions import ArmguardError
from armguard.recording.chain import Link
from armguard.recording.events import FORMAT, NUMBERS, Log, Time
from armguard.recording.packing import ATTACHED, NOTED, WriterOptions, pack_record
from armguard.recording.parts import Rotation, open_file
from armguard.recording.signing import FileSigner, read_signing_key, write_signing_pair
from armguard.recording.verification import verify
from armguard.recording.writer import PatientFile, RecordingWriter
from support.chain_links import frame, make_record, read_links

CHUNKS = 6


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Secret and public file of who records."""
    return write_signing_pair("recorder", tmp_path_factory.mktemp("keys"))[:2]


def write_run(path, *, is_ended=True, **options):
    """A recording of one line a second in six chunks."""
    file = PatientFile(open_file(path))
    writer = RecordingWriter(file, WriterOptions(str(path), **options))
    writer.take(pack_record(NOTED, 1, ("armguard", {"format": str(FORMAT)})))
    writer.take(pack_record(ATTACHED, 1, ("notes.json", "", b"{}")))
    for second in range(CHUNKS):
        for number in range(3):
            time = 1_000_000_000 * (second + 1) + number
            log = Log(timestamp=Time(second, number), level=3, message="a line")
            writer.take(pack_record(NUMBERS[Log], time, log))
        writer.flush(float(second))
    if is_ended:
        writer.finish()
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory, keys):
    return write_run(tmp_path_factory.mktemp("whole") / "run.mcap", key=str(keys[0])).read_bytes()


def split(data):
    """What stands in front of each link, with the link: the start, each chunk, the end."""
    ends = [0, *(end for *_, end in read_links(data)[:-1]), len(data)]
    return [data[begin:end] for begin, end in itertools.pairwise(ends)]


def find(data, path, **options):
    """What is found in a file of these bytes."""
    path.write_bytes(data)
    result, *_ = verify(path, **options)
    return result


def test_a_recording_as_it_was_written_is_intact(whole, tmp_path, keys):
    for options in ({}, {"key": read_signing_key(keys[1])}):
        result = find(whole, tmp_path / "a.mcap", **options)
        assert result.is_intact
        assert result.problems == ()
        assert result.chunks == CHUNKS
        assert result.keys == (read_signing_key(keys[1]),)


@pytest.mark.hazard("H-11")
def test_any_byte_that_is_changed_is_found(whole, tmp_path):
    """In chunks, links, index, and the lengths of records: wherever it is."""
    rng = random.Random(0)
    places = [*rng.sample(range(len(whole)), 150), 8, len(whole) - 1]
    for _, begin, end in read_links(whole):
        places += [*range(begin, begin + 14), rng.randrange(begin, end), end - 1]
    changes = [(place, 1 << rng.randrange(8)) for place in places]
    # Letters of the last link in the other case: the same digits, and another file.
    _, begin, end = read_links(whole)[-1]
    changes += [(place, 0x20) for place in range(begin, end) if chr(whole[place]) in "abcdef"]
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    with path.open("r+b", buffering=0) as file:
        for place, bits in changes:
            os.pwrite(file.fileno(), bytes([whole[place] ^ bits]), place)
            if place < 8:
                with pytest.raises(ArmguardError, match="is no MCAP file"):
                    verify(path)
            else:
                assert not verify(path)[0].is_intact, place
            os.pwrite(file.fileno(), whole[place : place + 1], place)
    assert all(one.is_intact for one in verify(path))


def test_a_changed_byte_is_named_by_its_chunk_and_time(whole, tmp_path):
    parts = split(whole)
    for number in range(CHUNKS + 2):
        changed = bytearray(parts[number])
        changed[40] ^= 1
        result = find(b"".join([*parts[:number], changed, *parts[number + 1 :]]), tmp_path / "a")
        (told, *_) = result.problems
        if number == 0:
            assert "the part before all chunks" in told
        elif number <= CHUNKS:
            assert re.match(rf"chunk {number}, recorded from 1970-.*:0{number}\.000 to ", told)
            assert len(result.problems) == 1
        assert result.chunks == CHUNKS - (1 <= number <= CHUNKS)


@pytest.mark.hazard("H-11")
def test_a_removed_chunk_is_named(whole, tmp_path):
    parts = split(whole)
    for number in range(1, CHUNKS + 1):
        result = find(b"".join(parts[:number] + parts[number + 1 :]), tmp_path / "a.mcap")
        assert [one for one in result.problems if re.match(rf"chunk {number}, .*missing", one)]
        assert not any("bytes were changed" in one for one in result.problems[1:])
    result = find(b"".join([*parts[:2], *parts[5:]]), tmp_path / "a.mcap")
    assert re.match(r"chunks 2 to 4, recorded from .*:01\.000 to .*:05\.000", result.problems[0])


@pytest.mark.hazard("H-11")
def test_chunks_that_were_exchanged_are_named(whole, tmp_path):
    parts = split(whole)
    parts[2], parts[5] = parts[5], parts[2]
    told = find(b"".join(parts), tmp_path / "a.mcap").problems
    assert re.match(r"chunk 5, .*is at the place of chunk 2", told[0])
    assert re.match(r"chunk 2, .*is at the place of chunk 5", told[1])
    parts = split(whole)
    told = find(b"".join([*parts[:4], parts[3], *parts[4:]]), tmp_path / "a.mcap").problems
    assert any("chunk 3: it occurs 2 times" in one for one in told)


@pytest.mark.hazard("H-11")
def test_an_end_that_is_cut_off_is_found_and_what_is_left_verifies(whole, tmp_path):
    links = read_links(whole)
    for length in [*range(200, len(whole), len(whole) // 60), len(whole) - 1]:
        try:
            result = find(whole[:length], tmp_path / "a.mcap")
        except ArmguardError:
            assert length < links[0][2]
            continue
        there = [link for link, _, end in links if end <= length]
        assert result.chunks == sum(0 < link.chunk <= CHUNKS for link in there)
        assert not result.is_intact
        (told,) = result.problems
        if there[-1].tail:
            assert "the index at the end of the file was cut off" in told
        else:
            assert "the end is missing; the last whole part is" in told
            assert result.last == there[-1].end


def forge(whole, change, *, before="", **fields):
    """Change a line, and make the chain anew as anybody can who has the file and no key."""
    data, place, head = b"", 0, before
    for link, begin, end in read_links(whole):
        content = change(whole[place:begin])
        place = end
        digest = hashlib.sha256(content).hexdigest()
        link = link._replace(content=digest, before=head, key="", signature="")
        link = link._replace(**fields)
        record = make_record(link.to_fields())
        data += content + frame(record)
        head = link.head
    return data + whole[place:]


@pytest.mark.hazard("H-11")
def test_a_chain_that_was_made_anew_is_found_by_the_key_alone(whole, tmp_path, keys):
    data = forge(whole, lambda content: content.replace(b"notes.json", b"other.json"))
    # The lengths are others, and so the index does not fit: a careful forger mends that, too.
    told = find(data, tmp_path / "a.mcap").problems
    assert not any("bytes" in one for one in told if "index" not in one)
    told = find(data, tmp_path / "a.mcap", key=read_signing_key(keys[1])).problems
    assert sum("it is not signed" in one for one in told) == CHUNKS + 2


def test_another_key_is_named(whole, tmp_path):
    other = read_signing_key(write_signing_pair("other", tmp_path)[1])
    told = find(whole, tmp_path / "a.mcap", key=other).problems
    assert len(told) == CHUNKS + 2
    assert all("it is signed by" in one for one in told)


def test_a_signature_that_is_missing_among_others_is_found(whole, tmp_path):
    link, begin, end = read_links(whole)[3]
    record = make_record(link._replace(key="", signature="").to_fields())
    data = whole[:begin] + frame(record) + whole[end:]
    told = find(data, tmp_path / "a.mcap").problems
    told = [one for one in told if "what stands before" in one]
    assert re.match(r"chunk 3, .* it is not signed, and what stands before is signed by", told[0])
    assert re.match(r"chunk 4, .* it is signed by .*, and what stands before is not", told[1])


def test_a_recording_goes_on_in_files_of_which_none_can_be_missed(tmp_path, keys):
    first = write_run(tmp_path / "run.mcap", key=str(keys[0]), rotation=Rotation(duration=2.0))
    names = ["run.mcap", "run.2.mcap", "run.3.mcap"]
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == sorted(names)
    results = verify(first, read_signing_key(keys[1]))
    assert [one.path.name for one in results] == names
    assert [one.problems for one in results] == [(), (), ()]
    assert sum(one.chunks for one in results) == CHUNKS
    # From any part on, so that old ones may be removed.
    assert all(one.is_intact for one in verify(tmp_path / "run.2.mcap"))

    (tmp_path / "run.3.mcap").rename(tmp_path / "x")
    *before, last = verify(first)
    assert all(one.is_intact for one in before)
    assert last.problems == ("run.3.mcap, in which the recording goes on, is missing",)
    shutil.copy(tmp_path / "run.2.mcap", tmp_path / "run.3.mcap")
    assert any("does not go on from the file before" in str(one.problems) for one in verify(first))


def copy_run(tmp_path, keys):
    """The first file of a run of three, alone in a folder, and the folder of all."""
    for name in ("run", "copy"):
        (tmp_path / name).mkdir()
    options = {"key": str(keys[0]), "rotation": Rotation(duration=2.0)}
    first = write_run(tmp_path / "run" / "run.mcap", **options)
    return shutil.copy(first, tmp_path / "copy" / "run.mcap"), tmp_path / "run"


@pytest.mark.hazard("H-11")
def test_a_beginning_that_was_dropped_and_files_that_were_renamed_begin_with_a_later_part(
    tmp_path, keys
):
    """What is left is right; which parts nobody saw is told by the number of the first."""
    first = write_run(tmp_path / "run.mcap", key=str(keys[0]), rotation=Rotation(duration=2.0))
    (tmp_path / "run.2.mcap").replace(first)
    begun, last = verify(first, read_signing_key(keys[1]))
    assert (begun.part, last.part) == (2, 3)
    assert begun.is_intact
    assert last.is_intact
    first.replace(tmp_path / "other.mcap")
    (tmp_path / "run.3.mcap").replace(first)
    assert [(one.part, one.is_intact) for one in verify(first)] == [(3, True)]
    # Nobody can say of a later part that it is the first one, or of none.
    for part in (1, 0, -3):
        data = forge(first.read_bytes(), bytes, part=part, before="ab")
        assert any("goes on from another file" in one for one in find(data, first).problems)
    told = find(forge(data, bytes, part=2), first).problems
    assert any("says that it is part 2, and goes on from none" in one for one in told)


@pytest.mark.hazard("H-11")
def test_another_signer_is_named_where_it_begins_without_any_key(whole, tmp_path, keys):
    """In a chunk, in a further file, and where what was signed goes on unsigned."""
    other = write_signing_pair("other", tmp_path)[0]
    link, begin, end = read_links(whole)[3]
    signer = FileSigner(other)
    link = link._replace(key=signer.public)
    record = make_record(link._replace(signature=signer.sign(link.head)).to_fields())
    told = find(whole[:begin] + frame(record) + whole[end:], tmp_path / "a.mcap").problems
    told = [one for one in told if "what stands before" in one]
    assert re.match(rf"chunk 3, .* it is signed by {signer.public}, and what", told[0])

    options = {"rotation": Rotation(duration=2.0)}
    first = write_run(tmp_path / "run.mcap", key=str(keys[0]), **options)
    second = first.with_name("run.2.mcap")
    original = second.read_bytes()
    for secret, words in ((str(other), f"signed by {signer.public}"), ("", "not signed")):
        copy = write_run(tmp_path / f"{words[:3]}.mcap", key=secret, **options)
        data = copy.with_name(f"{words[:3]}.2.mcap").read_bytes()
        second.write_bytes(data)
        begun, changed, *_ = verify(first)
        assert begun.is_intact
        told = [one for one in changed.problems if "what stands before is signed by" in one]
        assert len(told) == 1
        assert f"the part before all chunks: it is {words}" in told[0]
    second.write_bytes(original)
    assert all(one.is_intact for one in verify(first))


@pytest.mark.hazard("H-11")
def test_a_power_cut_after_a_rotation_leaves_all_that_was_written_before_it(tmp_path, keys):
    """The last file has nothing in it, a part of its beginning, or a chunk that is cut."""
    first = write_run(tmp_path / "run.mcap", key=str(keys[0]), rotation=Rotation(duration=3.0))
    last = first.with_name("run.2.mcap")
    whole = last.read_bytes()
    ends = [end for *_, end in read_links(whole)]
    for length in [
        *range(12),
        ends[0] - 1,
        ends[0],
        ends[0] + 1,
        ends[1] - 1,
        ends[1],
        ends[1] + 9,
    ]:
        last.write_bytes(whole[:length])
        begun, cut = verify(first, read_signing_key(keys[1]))
        assert begun.is_intact
        assert begun.chunks == 4
        assert cut.chunks == (length >= ends[1])
        (told,) = cut.problems
        assert "if a power cut or a kill ended it, at most its last second is lost" in told
        assert "run.2.mcap" in told or "the end is missing" in told
    last.write_bytes(b"something else")
    assert "is no MCAP file" in verify(first)[1].problems[0]
    # A file behind one without an end is told: no power cut leaves that.
    first.with_name("run.3.mcap").write_bytes(whole)
    for content in (b"", whole[: ends[0]], whole[: ends[1]]):
        last.write_bytes(content)
        assert "run.3.mcap is there, and was not verified" in verify(first)[-1].problems
    last.write_bytes(whole)
    assert all(one.is_intact for one in verify(first))


@pytest.mark.hazard("H-11")
def test_another_recording_of_the_signer_in_place_of_a_part_is_found(tmp_path, keys):
    first, run = copy_run(tmp_path, keys)
    second = first.with_name("run.2.mcap")
    write_run(second, key=str(keys[0]))
    begun, other = verify(first, read_signing_key(keys[1]))
    assert begun.is_intact
    assert other.path == second
    assert any("it is of part 1, and run.mcap is part 1" in one for one in other.problems)
    assert any("go on from the file before, run.mcap" in one for one in other.problems)
    # A later part of the same run, too.
    shutil.copy(run / "run.3.mcap", second)
    assert any("it is of part 3" in one for one in verify(first)[1].problems)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "is empty"), (b"q,v", "is no MCAP file"), (b"\x89MCAP0\r\n", "no chain")],
)
def test_what_has_no_chain_is_refused(content, words, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(ArmguardError, match=words):
        verify(path)
    with pytest.raises(ArmguardError, match="cannot be read"):
        verify(tmp_path / "nowhere.mcap")


def test_what_anybody_writes_into_a_file_makes_no_error(whole, tmp_path):
    """Links with any numbers and words, and any bytes between them."""
    rng = random.Random(1)
    for _ in range(30):
        link = Link(
            rng.choice([1, -3, 2**70]),
            rng.choice([0, 1, 2**70, -5]),
            rng.choice([0, -(2**80), 2**80]),
            1,
            *["x"] * rng.choice([2, 3, 4, 6]),
        )
        record = make_record(link.to_fields())
        extra = frame(record)
        place = rng.choice([end for *_, end in read_links(whole)])
        result = find(whole[:place] + extra + whole[place:], tmp_path / "a.mcap")
        assert not result.is_intact
