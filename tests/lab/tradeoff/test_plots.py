import pytest

from armguard.lab.tradeoff.plots import draw_pictures
from support.tradeoff_cases import make_study


def test_pictures_are_drawn_of_whatever_was_found():
    pytest.importorskip("matplotlib")
    pictures = draw_pictures(make_study())
    assert sorted(pictures) == sorted(
        f"{name}.{kind}" for name in ("price", "growth", "time") for kind in ("png", "svg")
    )
    for name, content in pictures.items():
        assert content.startswith(b"\x89PNG" if name.endswith("png") else b"<?xml")
        assert len(content) < 200_000
    assert draw_pictures(make_study()) == pictures
    assert "growth.png" not in draw_pictures(make_study(grown=[]))
