import numpy as np

from armguard.lab.commission.findings import commission
from armguard.lab.commission.lines import write_cell_lines
from armguard.lab.commission.observations import SourceObservations, StopCommand
from support.commissioned_arms import Arm, sample


def test_brakes_are_listed_by_speed_and_the_worst_of_all_stops_counts():
    fast = sample(Arm([1.0], [3.0], [4.0], 0.03), [0.7, 2.3], 4.0)
    slow = sample(Arm([0.4], [3.0], [4.0], 0.05), [0.5], 2.0)
    shift = fast.stamps[-1] + 1.0
    moved = [stop._replace(told=stop.told + shift, ended=stop.ended + shift) for stop in slow.stops]
    both = fast._replace(
        stamps=np.r_[fast.stamps, slow.stamps + shift],
        q=np.r_[fast.q, slow.q],
        v=np.r_[fast.v, slow.v],
        stops=fast.stops + moved,
    )
    found = commission(both)
    assert 0.05 <= found.response <= 0.055
    low, high = found.brakes["joint0"]
    assert 0.38 <= low.speed <= 0.4004
    assert 0.95 <= high.speed <= 1.001
    assert low.stopping_time < high.stopping_time
    assert low.deceleration >= high.deceleration
    assert low.load == high.load == 1.0


def test_what_is_not_in_a_recording_is_told_by_name_and_not_made_up():
    still = SourceObservations(np.zeros(3), np.zeros(3), {})
    arm = Arm([0.01, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03)
    found = commission(sample(arm, [], 3.0, sources={"camera": still}, has_gaps=True))
    assert np.isnan(found.response)
    assert found.brakes == {}
    assert found.tracking is None
    assert set(found.limits) == {"joint1"}
    told = "\n".join(found.missing)
    for words in (
        "latency, reaction time and stopping times: the recording has no STOP",
        "joint0, brakes",
        "joint0, operating limits: the joint hardly moved",
        "joint1, brakes",
        "tracking errors",
        "source camera: 3 messages are too few",
        "the recording has gaps",
    ):
        assert words in told
    assert "sources: the recording has no message" in "\n".join(
        commission(sample(arm, [], 3.0)).missing
    )


def test_an_arm_that_ignores_a_stop_has_no_reaction_time():
    """Three STOPs are obeyed after 40 ms, and one is not for its whole 0.3 s."""
    told = [0.7, 2.3, 4.0]
    arm = Arm([1.0], [3.0], [4.0], 0.04)
    seen = sample(arm, told, 8.0)
    assert "reaction_time = " in write_cell_lines(commission(seen))
    found = commission(seen._replace(stops=[*seen.stops, StopCommand(5.6, 5.9)]))
    assert np.isnan(found.response)
    assert any("reaction time" in line and "5.600 s" in line for line in found.missing)
    lines = write_cell_lines(found)
    assert "reaction_time = " not in lines
    assert (
        "# not measured: joint0, STOP at 5.600 s: the STOP ends before the joint is slow" in lines
    )
    assert "1 more could not be measured" in found.brakes["joint0"][-1].source
