"""The campaign in its short form: the worst of its faults, against real processes."""

from armguard.studies.faults.campaign import Trial, place_bodies, run_campaign
from armguard.studies.faults.catalogue import Fault, choose_faults
from armguard.studies.faults.scene import sample_people, sample_pillar

WORST = [
    "driver-nan-q",
    "camera-dropout-1s",
    "camera-clock-ahead",
    "camera-identities-swapped",
    "monitor-stopped",
    "monitor-killed",
]


def test_of_the_worst_faults_none_is_missed_and_nobody_is_touched():
    told = []
    report = run_campaign(choose_faults(WORST), lambda text, done: told.append((text, done)))
    assert [outcome.problem for outcome in report.outcomes] == [""] * len(WORST)
    assert [outcome.fault.name for outcome in report.outcomes] == WORST
    assert report.whole.contacts == 0
    assert report.whole.distance > 0.0
    assert all(outcome.ignoring.contacts for outcome in report.outcomes), "the control is hit"
    first, second = report.replayed  # the monitor was killed once
    assert first.identical
    assert second.identical
    assert min(first.compared, second.compared) > 100
    assert (first.lost, second.lost) == (0, 0)
    assert report.passed
    names = [text for text, _ in told]
    assert names == ["starting", *WORST, "judging", "replaying"]


def test_a_thing_that_drifts_is_there_while_its_fault_lasts():
    fault = Fault("drifting", "camera", "disturb", kind="static", duration=2.0)
    trial = Trial(fault, 10.0, 12.0, None, 0)
    people = sample_people(4.0, 4.0)[0]
    assert place_bodies(trial, 5.0, 4.0, 9.0).tolist() == people.tolist()
    found = place_bodies(trial, 5.0, 4.0, 11.0)
    assert found[2:].tolist() == sample_pillar(1.0)[0].tolist()
    assert len(place_bodies(trial, 5.0, 4.0, 12.1)) == 2
