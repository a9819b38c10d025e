import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import Obstacles, Source
from armguard.obstacles.sources import MAXIMUM_SOURCES, MAXIMUM_TOMBSTONES, Sources, Tombstones


@pytest.mark.parametrize("timeout", [0.0, -1.0, math.nan, math.inf])
def test_timeouts_are_checked(timeout):
    with pytest.raises(ObstacleError, match="timeout"):
        Source("a", timeout)


@pytest.mark.parametrize("field", ["latency", "rate"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_what_is_stated_of_its_data_is_checked(field, value):
    with pytest.raises(ObstacleError, match=field):
        Source("a", **{field: value})


def test_who_was_named_is_required_and_who_speaks_is_from_then_on():
    sources = Sources(["camera", Source("lidar", timeout=1.0), Source("guest", required=False)])
    assert [name for name, _ in sources.silent(0.0, 0.2)] == ["camera", "lidar"]
    for name in ("camera", "lidar", "guest", "stranger"):
        sources.hear(name, 1.0)
    assert sources.silent(1.2, 0.2) == []
    assert [name for name, _ in sources.silent(1.3, 0.2)] == ["camera", "guest", "stranger"]
    late = [name for name, _ in sources.silent(2.1, 0.2)]
    assert late == ["camera", "lidar", "guest", "stranger"]
    assert [name for name, _ in sources.silent(math.nan, 0.2)] == late


@pytest.mark.hazard("H-04")
def test_a_silent_source_says_since_when_what_was_expected_and_who_speaks_instead():
    sources = Sources([Source("camera", timeout=0.3), "lidar"])
    assert sources.silent(5.0, 0.2) == [
        ("camera", "nothing received, expected a message every 0.3 s or sooner"),
        ("lidar", "nothing received, expected a message every 0.2 s or sooner"),
    ]
    sources.hear("lidar", 5.0)
    sources.hear("camrea", 5.0)
    assert sources.silent(5.1, 0.2) == [
        (
            "camera",
            "nothing received, expected a message every 0.3 s or sooner; 'camrea' sends data, but "
            "was not named: a misspelling?",
        )
    ]
    sources.hear("camera", 5.1)
    assert sources.silent(5.41, 1.0) == [
        ("camera", "newest stamp 0.31 s old, expected at most 0.3 s")
    ]


def test_stamps_ahead_are_of_the_last_message():
    sources = Sources([])
    sources.hear("camera", 5.0)
    assert sources.ahead(4.75, 0.25) == []
    assert [name for name, _ in sources.ahead(4.5, 0.25)] == ["camera"]
    sources.hear("camera", 4.5)
    assert sources.ahead(4.5, 0.25) == []


def test_number_of_sources_is_bounded():
    sources = Sources([])
    for k in range(MAXIMUM_SOURCES):
        sources.check_room(f"{k}")
        sources.hear(f"{k}", 0.0)
    sources.check_room("0")
    with pytest.raises(ObstacleError, match="one too many"):
        sources.check_room("another")


def test_a_tombstone_covers_what_is_older():
    stones = Tombstones()
    stones.add("ball", 2.0, 0)
    stones.add("ball", 1.0, 0)
    assert stones.covers("ball", 0, math.nextafter(2.0, -math.inf))
    assert not stones.covers("ball", 0, 2.0)
    assert not stones.covers("ball", 1, 0.0)
    assert not stones.covers("box", 0, 0.0)
    stones.lift("ball", 0)
    assert not stones.covers("ball", 0, 0.0)


def test_tombstones_given_up_leave_a_floor_for_their_source():
    stones = Tombstones()
    for k in range(MAXIMUM_TOMBSTONES + 1):
        stones.add(f"{k}", 5.0, source=k % 2)
    assert not stones.covers("0", 0, 4.9)
    assert stones.below_floor(0, 4.9)
    assert not stones.below_floor(0, 5.0)
    assert not stones.below_floor(1, 0.0)


def test_no_tombstone_stays_ahead_of_the_clock():
    stones = Tombstones()
    for k in range(MAXIMUM_TOMBSTONES + 1):
        stones.add(f"{k}", 1e9, 0)
    stones.limit(3.0)
    assert stones.newest == 3.0
    assert stones.covers("7", 0, 2.9)
    assert not stones.covers("7", 0, 3.0)
    assert not stones.below_floor(0, 3.0)


def test_a_late_message_does_not_make_its_source_look_silent():
    sources = Sources([])
    sources.hear("cam", 1.0)
    assert sources.quiet_until(0.2) == 1.2
    sources.hear("cam", 0.5)
    assert not sources.unsettled
    assert sources.silent(1.1, 0.2) == []
    assert [name for name, _ in sources.silent(1.3, 0.2)] == ["cam"]


def test_a_stamp_far_ahead_hides_no_silence():
    sources = Sources([])
    sources.hear("cam", 1000.0)
    assert [name for name, _ in sources.ahead(1.0, 0.2)] == ["cam"]
    sources.hear("cam", 1.01)
    assert sources.ahead(1.02, 0.2) == []
    assert sources.silent(1.1, 0.2) == []
    assert [name for name, _ in sources.silent(1.3, 0.2)] == ["cam"]
    # Also where it was put right before anything asked.
    sources.hear("cam", 1000.0)
    sources.hear("cam", 1.5)
    assert sources.ahead(1.5, 0.2) == []
    assert [name for name, _ in sources.silent(1.8, 0.2)] == ["cam"]


@pytest.mark.parametrize("stamp", [1e308, -1e308, math.nextafter(math.inf, 0.0)])
def test_stamps_beyond_what_can_be_counted_are_taken_all_the_same(stamp):
    obstacles = Obstacles()
    for _ in range(2):
        obstacles.update(["a"], stamp, np.zeros((1, 3)), radius=0.1)
    assert obstacles.row("a") >= 0
    assert not obstacles.disbelieved_sources()


def test_a_table_tells_how_its_sources_were_heard():
    obstacles = Obstacles(sources=["camera", Source("lidar", timeout=1.0)])
    for stamp in (0.5, 0.7, 0.6):
        obstacles.update([], stamp, source="camera")
    assert obstacles.heard_sources == [("camera", 3, 0.7, None), ("lidar", 0, -math.inf, 1.0)]
