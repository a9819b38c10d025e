import sys

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.pictures import check_plots, draw_figures


def test_what_is_drawn_alike_gives_equal_files():
    pytest.importorskip("matplotlib")

    def draw(figure):
        figure.subplots().plot([1.0, 2.0], [3.0, 4.0], label="line")

    pictures = draw_figures({"one": draw, "other": draw}, (3.0, 2.0))
    assert list(pictures) == ["one.png", "other.png"]
    assert pictures["one.png"].startswith(b"\x89PNG")
    assert pictures["one.png"] == pictures["other.png"]


def test_a_missing_library_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ArmguardError, match=r"need matplotlib.*armguard\[plot\].*--no-plots"):
        check_plots()
