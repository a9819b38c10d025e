import msgspec

from armguard.view.film import INTERVAL
from armguard.view.page_state import FilmPosition, PageState
from support.view_samples import make_frame


def tell(page_state, told):
    return msgspec.msgpack.decode(page_state.tell(told))


def shoot(page_state, *times):
    for now in times:
        page_state.film.add(make_frame(now=now), b"")


def test_silence_is_counted_from_the_last_frame():
    time = 5.0
    page_state = PageState("tcp://127.0.0.1:1", clock=lambda: time)
    assert tell(page_state, FilmPosition())["silence"] is None
    page_state.status = "compiling"
    page_state.note_frame()
    time = 7.5
    news = tell(page_state, FilmPosition())
    assert news["silence"] == 2.5
    assert news["status"] == ""


def test_each_browser_is_told_every_moment_once_and_those_who_come_late_all():
    page_state, early, late = PageState("tcp://127.0.0.1:1"), FilmPosition(), FilmPosition()
    shoot(page_state, 0.0, 1.0)
    assert [row[1] for row in tell(page_state, early)["moments"]] == [0.0, 1.0]
    shoot(page_state, 2.0)
    news = tell(page_state, early)
    assert [row[1] for row in news["moments"]] == [2.0]
    assert not news["anew"]
    news = tell(page_state, late)
    assert [row[1] for row in news["moments"]] == [0.0, 1.0, 2.0]
    assert news["anew"]
    assert tell(page_state, early)["moments"] == []


def test_a_film_that_begins_anew_is_told_anew():
    page_state, told = PageState("tcp://127.0.0.1:1"), FilmPosition()
    shoot(page_state, 0.0, INTERVAL)
    tell(page_state, told)
    page_state.film.clear()
    shoot(page_state, 0.5)
    news = tell(page_state, told)
    assert news["anew"]
    assert [row[1] for row in news["moments"]] == [0.5]
