import os

import msgspec

from armguard.drivers.link import COUNTS, DRIVING, TELL, Counts, Link


def test_lines_are_words_and_text_on_one_line_each():
    reading, writing = os.pipe()
    link = Link(writing)
    link.send(DRIVING)
    link.tell("first\nsecond\tthird " + "x" * 10_000)
    link.count(Counts(states=3))
    lines = os.read(reading, 100_000).decode().splitlines()
    os.close(reading)
    os.close(writing)
    assert lines[0].split() == [DRIVING]
    assert lines[1].startswith(f"{TELL} first second third x")
    assert len(lines[1]) < 4096, "longer ones could be cut in two"
    word, text = lines[2].split(" ", 1)
    assert (word, msgspec.json.decode(text, type=Counts)) == (COUNTS, Counts(states=3))


def test_a_full_pipe_and_one_that_nobody_reads_hold_nothing_up():
    reading, writing = os.pipe()
    link = Link(writing)
    for _ in range(10_000):
        link.tell("x" * 100)
    os.close(reading)
    link.tell("nobody is there")
    os.close(writing)
