import pytest

from armguard.app.cli import main
from armguard.lab.tradeoff.ladder import DEFAULT, FINEST
from armguard.lab.tradeoff.picture import PICTURE, draw_price
from support.tradeoff_cases import make_study

CELL = '[robot]\nname = "panda"\n[sources.eye]\n[monitor]\nrate = 100.0\n'


def test_each_setting_is_a_point_at_its_price_and_caution(monkeypatch):
    from matplotlib.axes import Axes

    drawn = {}

    def plot(axes, prices, cautions, *shape, **style):
        drawn[style["label"]] = list(zip(prices, cautions, strict=True))

    monkeypatch.setattr(Axes, "plot", plot)
    monkeypatch.setattr(Axes, "legend", lambda axes, **style: None)
    picture = draw_price(make_study())
    assert picture.startswith(b"\x89PNG")
    drawn.pop("front")
    assert drawn == {
        DEFAULT: [pytest.approx((10.0, 110.5))],
        FINEST: [pytest.approx((50.0, 110.0))],
        "budget": [pytest.approx((5.0, 130.0))],
    }


def test_without_matplotlib_the_page_says_what_brings_it(tmp_path, monkeypatch):
    monkeypatch.setattr("armguard.lab.tradeoff.picture.importlib.util.find_spec", lambda name: None)
    (tmp_path / "cell.toml").write_text(CELL)
    words = ["--axis", "max_staleness", "--seconds", "1", "--out", str(tmp_path / "out")]
    assert main(["tradeoff", str(tmp_path / "cell.toml"), *words]) == 0
    assert "armguard[plot]" in (tmp_path / "out" / "README.md").read_text()
    assert not (tmp_path / "out" / PICTURE).exists()
