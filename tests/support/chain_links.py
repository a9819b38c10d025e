"""Links of a recording, made and found by the standard's own rules for records."""

from mcap.data_stream import RecordBuilder
from mcap.records import Metadata

from armguard.recording.chain import LINK, read_link

METADATA = 12


def make_record(fields, name=LINK):
    """The content of a metadata record."""
    builder = RecordBuilder()
    Metadata(name, fields).write(builder)
    return builder.end()[9:]


def frame(record):
    """The content of a metadata record, with opcode and length."""
    return bytes([METADATA]) + len(record).to_bytes(8, "little") + record


def read_links(data):
    """Links of a file with where they begin and end, as the standard says where records are."""
    found, place = [], 8
    while place + 9 <= len(data):
        end = place + 9 + int.from_bytes(data[place + 1 : place + 9], "little")
        link = read_link(data[place + 9 : end]) if data[place] == METADATA else None
        if link is not None:
            found.append((link, place, end))
        place = end
    return found
