"""The benchmark of a long run, made short."""

import importlib
import re


def test_a_soak_tells_of_memory_late_ticks_and_the_recording(capsys, monkeypatch):
    bench = importlib.import_module("bench_soak")
    monkeypatch.setattr(bench, "LINE_PERIOD", 2.0)
    bench.main(["--minutes", "0.05", "--balls", "2", "--record"])
    out = capsys.readouterr().out
    ticks = int(re.search(r"(\d+) ticks", out)[1])
    assert ticks > 100
    assert re.search(r"min: memory \d+\.\d \+ \d+\.\d MB, \d+ ticks, \d+ late .* recorded \d", out)
    assert re.search(r"late ticks \d+ \(\d", out)
    assert re.search(r"memory \d+\.\d MB at the start", out)
    assert re.search(r"trend after the first fifth [+-]", out)
    assert "0 events lost" in out
