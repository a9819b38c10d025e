import io

from mcap.reader import make_reader

from armguard.recording.chain import FIRST
from armguard.recording.events import KINDS, NUMBERS, Log
from armguard.recording.part_writer import CHUNK_SIZE, SCENE, PartWriter


def write(times, *, size=2, chunk_every=None):
    """A file with a line at each time."""
    data = io.BytesIO()
    writer = PartWriter(data, 1, FIRST, None)
    writer.note("armguard", {"format": "4"})
    writer.attach(1, "settings.json", "application/json", b"{}")
    for number, time in enumerate(times, 1):
        writer.write(NUMBERS[Log], time, b"x" * size)
        if chunk_every and number % chunk_every == 0:
            writer.end_chunk()
            writer.end_chunk()
    writer.close()
    return make_reader(io.BytesIO(data.getvalue()), validate_crcs=True)


def list_links(reader):
    return [one.metadata for one in reader.iter_metadata() if one.name == "armguard.link"]


def test_each_chunk_has_one_link_with_its_times():
    reader = write(range(10, 20), chunk_every=4)
    assert len(reader.get_summary().chunk_indexes) == 3
    times = [(int(one["begin"]), int(one["end"])) for one in list_links(reader)]
    assert times == [(10, 10), (10, 13), (14, 17), (18, 19), (19, 19)]


def test_a_large_chunk_is_ended_sooner():
    reader = write(range(10, 14), size=CHUNK_SIZE // 2 + 1)
    assert len(reader.get_summary().chunk_indexes) == 2
    assert len(list_links(reader)) == 4


def test_a_file_without_messages_has_its_end():
    (link,) = list_links(write([]))
    assert link["chunk"] == "0"
    assert link["tail"]


def test_there_is_a_channel_for_each_kind_and_the_scene():
    topics = {one.topic for one in write([1]).get_summary().channels.values()}
    assert len(topics) == len(KINDS) + 1
    assert len(KINDS) == SCENE
    assert "/armguard/scene" in topics
