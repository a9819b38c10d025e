import pytest

from armguard.lab.tradeoff.plots import draw_pictures
from support.tradeoff_cases import make_study


def test_pictures_are_drawn_of_whatever_was_found():
    pytest.importorskip("matplotlib")
    pictures = draw_pictures(make_study())
    assert sorted(pictures) == ["growth.png", "price.png", "time.png"]
    for content in pictures.values():
        assert content.startswith(b"\x89PNG")
        assert len(content) < 200_000
    assert draw_pictures(make_study()) == pictures
    assert "growth.png" not in draw_pictures(make_study(grown=[]))
