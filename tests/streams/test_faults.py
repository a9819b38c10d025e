from armguard.streams import FaultLog
from support.stream_messages import World


def test_one_line_a_second_and_every_fault_counted():
    world = World()
    for tick in range(2500):
        world.clock.sleep_until(5.0 + 0.001 * tick)
        world.send(b"nonsense", b"more of it")
    assert world.faults.total == 5000
    assert len(world.lines) == 3
    assert "(1999 more since the last such line)" in world.lines[1]


def test_made_up_names_fill_neither_log_nor_memory():
    lines = []
    log = FaultLog(lambda: 0.0, lines.append)
    for number in range(5000):
        log.add("lost", f"source {number}\n\x1b[2J" + "x" * 10_000, number, "y" * 10_000)
    assert log.total == 5000
    assert len(log.counts) <= 513
    assert len(lines) <= 513
    assert all(line.isprintable() and len(line) < 700 for line in lines)


def test_a_line_can_be_told_to_several():
    told, also_told = [], []
    faults = FaultLog(lambda: 0.0, told.append)
    faults.also_emit(also_told.append)
    faults.add("malformed", "camera", 3, "radius is −1")
    assert told == also_told
    assert len(told) == 1
