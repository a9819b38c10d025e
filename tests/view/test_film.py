import msgspec
import pytest

from armguard.view import film as film_module
from armguard.view.film import INTERVAL, SPAN, Film
from armguard.view.messages import CommandSummary, Latch, VerdictSummary, encode_message
from support.view_samples import make_frame


def frame_at(now, level="CLEAR", reasons=(), effects=(), **changes):
    contact_time = changes.pop("contact_time", 1.0)
    verdict = VerdictSummary(
        level=level,
        contact_time=contact_time,
        stop_time=0.2,
        speed_scale=1.0,
        reasons=reasons,
        effects=effects,
    )
    return make_frame(sequence=round(1000 * now) + 1, now=now, verdict=verdict, **changes)


def shoot(film, *frames):
    for frame in frames:
        film.add(frame, encode_message(frame))


def kinds(film):
    return [event.kind for event in film.events]


def test_ten_moments_a_second_are_kept_each_with_the_worst_since_the_last():
    film = Film()
    shoot(film, *(frame_at(0.01 * k, contact_time=0.3 if k == 95 else 1.0) for k in range(101)))
    assert len(film.moments) == pytest.approx(1.0 / INTERVAL + 1, abs=1)
    assert [moment.contact_time for moment in film.moments].count(0.3) == 1
    numbers = [moment.number for moment in film.moments]
    assert numbers == sorted(set(numbers))


def test_a_moment_has_the_soonest_harm_since_the_last_where_limits_are_stated():
    film, times = Film(), [None] * 20 + [0.7] * 20
    times[5], times[30] = 0.4, 0.2
    frames = [frame_at(0.01 * place) for place in range(len(times))]
    for frame, harm_time in zip(frames, times, strict=True):
        verdict = msgspec.structs.replace(frame.verdict, harm_time=harm_time)
        shoot(film, msgspec.structs.replace(frame, verdict=verdict))
    told = [moment.harm_time for moment in film.moments]
    assert told[0] is None
    assert {one for one in told if one is not None} == {0.4, 0.7, 0.2}


def test_a_moment_has_the_slowest_pace_since_the_last_where_a_shield_moves_the_arm():
    film, paces = Film(), [None] * 20 + [1.0] * 20
    paces[30] = 0.2
    for place, pace in enumerate(paces):
        told = {"reason": "", "progress": 0.5, "is_proved": True}
        command = None if pace is None else CommandSummary(scale=pace, **told)
        shoot(film, frame_at(0.01 * place, command=command))
    found = [moment.pace for moment in film.moments]
    assert found[0] is None
    assert {one for one in found if one is not None} == {1.0, 0.2}


def test_a_stop_is_a_moment_of_its_own_and_an_event_with_its_reason():
    film = Film()
    shoot(
        film,
        frame_at(0.0),
        frame_at(0.01, "STOP", ("contact possible: hand and head (in 0.1 s)",), ("note",)),
        frame_at(0.02, "STOP"),
        frame_at(0.03),
    )
    assert kinds(film) == ["stop", "go"]
    stop = film.events[0]
    assert "hand and head" in stop.text
    assert film.find(stop.number).level == "STOP"
    assert film.find(stop.number).now == 0.01


def test_faults_latches_resets_and_refused_resets_are_events_once():
    film, latch = Film(), Latch(reason="joint state jumped: joint3 (by 1)", since=0.2)
    silent = {"reasons": ("source silent: cam0 (0.3 s)",), "effects": ("standing",)}
    shoot(
        film,
        frame_at(0.0),
        frame_at(0.1, "STOP", **silent),
        frame_at(0.2, "STOP", latches=(latch,)),
        frame_at(0.3, "STOP", latches=(msgspec.structs.replace(latch, since=0.3),)),
        frame_at(0.4, "STOP", latches=(latch,), refused_resets=1),
        frame_at(0.5, "STOP", refused_resets=1, **silent),
        frame_at(0.6, refused_resets=1),
    )
    assert kinds(film) == ["stop", "fault", "latch", "refused", "reset", "go"]


def test_of_a_live_monitor_the_last_minutes_are_kept():
    film = Film()
    shoot(film, *(frame_at(0.1 * k) for k in range(round(20 * SPAN))))
    assert film.moments[-1].now - film.moments[0].now <= SPAN
    assert len(film.moments) <= SPAN / INTERVAL + 2


def test_of_a_recording_all_is_kept_with_fewer_moments_and_every_event(monkeypatch):
    monkeypatch.setattr(film_module, "MOST_MOMENTS", 100)
    film = Film()
    film.clear(is_recording=True)
    stops = {37.0, 61.0}
    frames = [frame_at(0.1 * k, "STOP" if 0.1 * k in stops else "CLEAR") for k in range(1000)]
    edition = film.edition
    shoot(film, *frames)
    assert len(film.moments) <= 100
    assert film.moments[0].now == 0.0
    assert film.moments[-1].now == pytest.approx(99.9, abs=film.interval)
    assert film.edition > edition
    told = {event.now for event in film.events if event.kind == "stop"}
    assert told == {0.1 * k for k in range(1000)} & stops
    assert all(film.find(event.number).number == event.number for event in film.events)


def test_the_last_frame_is_a_moment_once_the_film_is_settled():
    film = Film()
    shoot(film, frame_at(0.0), frame_at(0.01))
    assert film.moments[-1].now == 0.0
    film.settle()
    film.settle()
    assert [moment.now for moment in film.moments] == [0.0, 0.01]


def test_memory_is_bounded(monkeypatch):
    payload = len(encode_message(frame_at(0.0)))
    monkeypatch.setattr(film_module, "MOST_BYTES", 20 * payload)
    for is_recording in (False, True):
        film = Film()
        film.clear(is_recording=is_recording)
        shoot(film, *(frame_at(0.1 * k, "STOP" if k % 3 else "CLEAR") for k in range(500)))
        assert sum(len(moment.payload) for moment in film.moments) <= 21 * payload


def test_a_monitor_whose_clock_began_anew_begins_a_new_film():
    film = Film()
    shoot(film, frame_at(5.0), frame_at(6.0))
    last = film.moments[-1].number
    shoot(film, frame_at(1.0))
    assert [moment.now for moment in film.moments] == [1.0]
    assert film.moments[0].number > last


def test_any_number_finds_the_moment_at_or_before_it():
    film = Film()
    assert film.find(3) is None
    shoot(film, *(frame_at(float(k)) for k in range(5)))
    numbers = [moment.number for moment in film.moments]
    for number in range(numbers[0] - 2, numbers[-1] + 3):
        expected = max([one for one in numbers if one <= number], default=numbers[0])
        assert film.find(number).number == expected
