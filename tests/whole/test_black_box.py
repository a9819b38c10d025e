"""A demo is recorded, whichever of its processes is killed, and replayed to the bit.

The same runs show how a demo ends that loses a process: each takes seconds to start.
"""

import json
import os
import signal

import pytest

from armguard.app.cli import main
from armguard.recording import replay, verify
from support.demo_processes import SOON, RunningDemo, finish, wait_until
from support.recordings_made import read_verdicts


@pytest.mark.hazard("H-25")
def test_a_demo_is_replayed_to_the_bit(tmp_path, capsys):
    path = tmp_path / "demo.mcap"
    arguments = ["--duration", "2", "--no-view", "--json", "--obstacles", "5", "--record", path]
    with RunningDemo(*map(str, arguments), folder=tmp_path) as demo:
        out, err = finish(demo)
    assert demo.process.returncode == 0, err
    summary = json.loads(out)
    assert summary["recording_lost"] == 0
    assert main(["replay", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["identical"]
    assert told["compared"] == summary["ticks"]
    assert not told["cut_off"]
    verdicts = read_verdicts(path)
    assert sum(verdict.sequence == 0 for verdict in verdicts) == summary["waiting"]


@pytest.mark.parametrize("role", ["monitor", "recorder", "launcher"])
def test_whichever_process_is_killed_the_file_reads_up_to_its_last_chunk(role, tmp_path):
    path = tmp_path / "demo.mcap"
    arguments = ["--duration", "60", "--json", "--record", str(path)]
    with RunningDemo(*arguments, folder=tmp_path) as demo:
        demo.wait_for_verdicts()
        assert wait_until(lambda: path.stat().st_size > 150_000)
        os.kill(demo.pid_of(role), signal.SIGKILL)
        if role == "recorder":
            demo.process.send_signal(signal.SIGINT)
        assert demo.wait_until_gone(SOON if role == "launcher" else 30.0)
        out, err = demo.process.communicate()
    if role == "monitor":
        assert (demo.process.returncode, out) == (1, "")
        assert err.endswith("armguard: the monitor ended by SIGKILL\n")
        assert "Traceback" not in err
    elif role == "launcher":
        assert demo.process.returncode == -signal.SIGKILL
    else:
        assert demo.process.returncode == 0, "it was interrupted, with its page open"
        assert json.loads(out)["ticks"] > 0
        assert "Traceback" not in err
    report = replay(path)
    assert report.compared > 50
    assert report.is_identical
    assert report.is_cut_off == (role == "recorder")
    (chain,) = verify(path)
    assert chain.is_intact == (role != "recorder")
    assert all("the end is missing" in problem for problem in chain.problems)


def test_a_file_that_is_there_is_a_mistake_before_anything_starts(tmp_path, capsys):
    path = tmp_path / "demo.mcap"
    path.write_bytes(b"precious")
    for arguments in (["demo", "--no-view"], ["run", "demos/cell.toml"]):
        assert main([*arguments, "--record", str(path)]) == 2
        assert "is there already" in capsys.readouterr().err
    assert path.read_bytes() == b"precious"
