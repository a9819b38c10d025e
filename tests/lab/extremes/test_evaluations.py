from armguard.lab.extremes import evaluations
from armguard.lab.extremes.evaluations import list_evaluations
from armguard.lab.extremes.report import SOUND, UNSOUND


def measure_all(cases, seed):
    return [one.measure(seed, cases) for one in list_evaluations()]


def test_evaluations_are_sound_and_tight_far_from_everyday_numbers():
    """A small form of the study: no contact time is above the exact one, nor far below it."""
    lines = measure_all(6, 3)
    assert len({(line.group, line.case) for line in lines}) == len(lines) == 21
    for line in lines:
        assert line.outcome == SOUND, line
        assert 1.0 - 1e-7 < line.worst <= 1.0 + 1e-12, line
        assert line.price > 0.0


def test_what_says_too_much_is_found_out(monkeypatch):
    def say_more(**arguments):
        return 1.0001 * say(**arguments)

    say = evaluations.earliest_contact_pair
    monkeypatch.setattr(evaluations, "earliest_contact_pair", say_more)
    lines = measure_all(2, 0)
    assert {line.outcome for line in lines} == {UNSOUND}
    assert lines[0].note.startswith("2 of 2 cases")
