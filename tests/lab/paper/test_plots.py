from armguard.lab.paper.measure import Row
from armguard.lab.paper.plots import draw_pictures


def make_rows():
    return [
        Row(period, balls, balls * (balls - 1) // 2, 9, 2.0, name, 3.0, 4.0, 5.0, 0.1, 0.9,
            1.0, 2.0, 1, 0.0, 1.0, 0, 0)
        for period in (0.05, 0.001)
        for balls in (3, 15)
        for name in ("daa, powers", "full-DAA", "full-DF")
    ]  # fmt: skip


def test_equal_rows_give_equal_pictures():
    pictures = draw_pictures(make_rows())
    assert set(pictures) == {"cost.png", "awareness.png"}
    assert pictures["cost.png"].startswith(b"\x89PNG")
    assert pictures == draw_pictures(make_rows())
