import pytest

from armguard.lab.tradeoff.plots import draw_pictures
from support.tradeoff_cases import make_study


def test_pictures_are_drawn_of_whatever_was_found():
    pytest.importorskip("matplotlib")
    pictures = draw_pictures(make_study())
    assert sorted(pictures) == ["price.png", "time.png"]
    assert all(content.startswith(b"\x89PNG") for content in pictures.values())
    assert draw_pictures(make_study()) == pictures
