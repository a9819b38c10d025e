import msgspec

from armguard.view.film import INTERVAL
from armguard.view.station import Station, Told
from support.view_samples import make_frame


def tell(station, told):
    return msgspec.msgpack.decode(station.tell(told))


def shoot(station, *times):
    for now in times:
        station.film.add(make_frame(now=now), b"")


def test_silence_is_counted_from_the_last_frame():
    time = 5.0
    station = Station("tcp://127.0.0.1:1", clock=lambda: time)
    assert tell(station, Told())["silence"] is None
    station.status = "compiling"
    station.note_frame()
    time = 7.5
    news = tell(station, Told())
    assert news["silence"] == 2.5
    assert news["status"] == ""


def test_each_browser_is_told_every_moment_once_and_those_who_come_late_all():
    station, early, late = Station("tcp://127.0.0.1:1"), Told(), Told()
    shoot(station, 0.0, 1.0)
    assert [row[1] for row in tell(station, early)["moments"]] == [0.0, 1.0]
    shoot(station, 2.0)
    news = tell(station, early)
    assert [row[1] for row in news["moments"]] == [2.0]
    assert not news["anew"]
    news = tell(station, late)
    assert [row[1] for row in news["moments"]] == [0.0, 1.0, 2.0]
    assert news["anew"]
    assert tell(station, early)["moments"] == []


def test_a_film_that_begins_anew_is_told_anew():
    station, told = Station("tcp://127.0.0.1:1"), Told()
    shoot(station, 0.0, INTERVAL)
    tell(station, told)
    station.film.clear()
    shoot(station, 0.5)
    news = tell(station, told)
    assert news["anew"]
    assert [row[1] for row in news["moments"]] == [0.5]
