from armguard.lab.extremes.evaluations import measure_evaluation
from armguard.lab.extremes.rows import Extent, measure_line, measure_rows
from armguard.lab.rows import Here, Rows


def test_a_line_is_the_same_as_a_row():
    row = measure_line(Extent(0, 2), "evaluation", 3)
    alone = measure_evaluation(3, 2, 0)._asdict() | {"price": row["line"]["price"]}
    assert repr(row["line"]) == repr(alone)


def test_lines_come_in_their_order_and_some_may_be_missing():
    class Some:
        def run(self, function, shared, tasks):
            few = dict(list(tasks.items())[:2])
            yield from reversed(list(Here().run(function, shared, few)))

    rows = Rows(Some(), None, {}, resume=False)
    lines, is_whole = measure_rows(Extent(0, 2), rows, lambda *told: None)
    assert [line.case for line in lines] == ["1e-6 m/s²", "1e-3 m/s²"]
    assert not is_whole
