import hashlib
import io

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from armguard.recording.chain import FIRST, ChainedFile, Link, read_link
from armguard.recording.signing import FileSigner, is_signed, write_signing_pair
from support.chain_links import make_record, read_links

SAMPLE = Link(1, 2, 10, 20, "c" * 64, "b" * 64, "t" * 64, "run.2.mcap", "k", "s")


def write_file(signer=None, next_file=""):
    """A file of two chunks; its bytes, and the head of its chain."""
    data = io.BytesIO()
    file = ChainedFile(data, 1, FIRST, signer)
    writer = Writer(file, chunk_size=2**63)
    writer.start()
    channel = writer.register_channel("/a", "json", 0)
    file.add_link(writer, 1, 1)
    for time in (1, 2):
        writer.add_message(channel, time, b"{}", time)
        writer.flush()
        file.add_link(writer, time, time)
    file.close(writer, 2, next_file)
    return data.getvalue(), file.head


def test_a_link_is_read_as_it_was_written():
    assert read_link(make_record(SAMPLE.to_fields())) == SAMPLE
    assert read_link(make_record(SAMPLE.to_fields(), "armguard")) is None
    assert read_link(b"") is None


@pytest.mark.parametrize(
    "change",
    [
        {"chunk": "02"},
        {"chunk": "two"},
        {"further": "x"},
    ],
)
def test_a_link_in_another_form_is_none_of_ours(change):
    with pytest.raises((ValueError, TypeError)):
        read_link(make_record(SAMPLE.to_fields() | change))
    with pytest.raises(ValueError, match="another form"):
        read_link(make_record(dict(reversed(SAMPLE.to_fields().items()))))


def test_a_head_stands_for_all_that_a_link_says_but_its_signature():
    heads = {SAMPLE.head}
    for name, value in SAMPLE._asdict().items():
        other = value + 1 if isinstance(value, int) else value + "x"
        head = SAMPLE._replace(**{name: other}).head
        assert (head in heads) == (name == "signature"), name
        heads.add(head)


@pytest.mark.parametrize("next_file", ["", "run.2.mcap"])
def test_each_link_holds_the_digest_of_what_stands_between_it_and_the_one_before(next_file):
    data, head = write_file(next_file=next_file)
    place, before = 0, FIRST
    found = read_links(data)
    for number, (link, begin, end) in enumerate(found):
        assert link.chunk == number
        assert link.content == hashlib.sha256(data[place:begin]).hexdigest()
        assert link.before == before
        place, before = end, link.head
    assert [bool(link.tail) for link, *_ in found] == [False, False, False, True]
    last = found[-1][0]
    assert last.tail == hashlib.sha256(data[place:]).hexdigest()
    assert (last.next, last.head) == (next_file, head)


def test_each_head_is_signed(tmp_path):
    signer = FileSigner(write_signing_pair("recorder", tmp_path)[0])
    data, _ = write_file(signer)
    for link, *_ in read_links(data):
        assert link.key == signer.public
        assert is_signed(link.key, link.signature, link.head)


def test_the_standard_reader_finds_everything_by_the_index(tmp_path):
    signer = FileSigner(write_signing_pair("recorder", tmp_path)[0])
    for data, _ in (write_file(), write_file(signer)):
        reader = make_reader(io.BytesIO(data), validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 2
        assert summary.statistics.metadata_count == len(summary.metadata_indexes) == 4
        assert [one.log_time for *_, one in reader.iter_messages()] == [1, 2]
        told = [read_link(make_record(one.metadata)) for one in reader.iter_metadata()]
        assert told == [link for link, *_ in read_links(data)]
