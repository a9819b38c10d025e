import pytest

from support.stream_messages import (
    MONOTONIC,
    Messages,
    World,
    joints,
    obstacles,
    pack,
)


@pytest.mark.hazard("H-09")
def test_work_in_one_drain_is_bounded_and_nothing_is_lost():
    world = World()
    world.input.waiting += [pack(obstacles(seq=n)) for n in range(1000)]
    world.edge.drain([world.input])
    assert 0 < world.edge.received < 200
    for _ in range(100):
        world.edge.drain([world.input])
    assert world.edge.received == 1000
    assert world.faults.total == 0


class SlowMessages(Messages):
    """Messages each of which takes 1 ms."""

    def __init__(self, clock, *messages):
        super().__init__(*messages)
        self._clock = clock

    def receive(self):
        self._clock.sleep_until(self._clock.now() + 0.001)
        return super().receive()


def test_a_drain_ends_when_its_time_is_over_and_each_input_has_its_part():
    world = World(drain_time=0.006)
    balls = SlowMessages(world.clock, *(obstacles(seq=n) for n in range(20)))
    states = SlowMessages(
        world.clock, *(joints(stamp=MONOTONIC + 5.0 + n, seq=n) for n in range(20))
    )
    for drains in range(1, 5):
        before = world.clock.now()
        assert world.edge.drain([balls, states]) - before <= 0.006 + 2 * 0.001
        assert world.edge.cut_short == 2 * drains
        # Half of the time is for each, and the first does not take that of the second.
        for source in (balls, states):
            assert 20 - 4 * drains <= len(source.waiting) <= 20 - 3 * drains
    while balls.waiting or states.waiting:
        world.edge.drain([balls, states])
    assert world.edge.received == 40
    assert world.faults.total == 0


def test_without_any_time_one_message_of_each_input_is_taken():
    world = World(drain_time=0.0)
    sources = [Messages(obstacles(seq=1), obstacles(seq=2)), Messages(joints(), joints())]
    world.edge.drain(sources)
    assert [len(source.waiting) for source in sources] == [1, 1]


def test_the_end_of_a_drain_is_when_it_ended_even_if_nothing_came():
    world = World()

    class SlowInput(Messages):
        def receive(self):
            world.clock.sleep_until(world.clock.now() + 0.003)
            return super().receive()

    began = world.clock.now()
    assert world.edge.drain([SlowInput()]) == pytest.approx(began + 0.003)
    assert world.edge.drain([]) == world.clock.now()
