import gc
import importlib.util
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.app.loop import (
    LONGEST_SPELL,
    REST,
    Durations,
    Observer,
    RunOptions,
    run,
)
from armguard.exceptions import StreamError
from armguard.messages.answers import VerdictMessage
from armguard.recording import replay
from armguard.recording.events import Log
from armguard.streams import SocketInput, VerdictReader
from armguard.verdict import Level, ReasonKind
from support.manual_clock import ManualClock
from support.recordings_made import read_events
from support.scripted_loop import CELL, Script, ball, joints, make_loop

EXAMPLE = Path(__file__).parents[2] / "demos" / "cell.toml"
PATIENCE = 20.0


# The loop


def test_each_tick_drains_steps_and_publishes():
    verdicts = []
    ticks = [[], [joints(0.001)], [joints(0.002), ball(0.002)], [joints(0.003), ball(0.003)]]
    loop = make_loop(Script(*ticks), ManualClock(), verdicts.append)
    report = loop.run(duration=0.004)
    assert [verdict.sequence for verdict in verdicts] == [0, 1, 2, 3]
    levels = [verdict.level for verdict in verdicts]
    assert levels == [Level.STOP, Level.STOP, Level.STOP, Level.STOP]
    assert [verdict.reasons[0].kind for verdict in verdicts[:2]] == [
        ReasonKind.NOT_YET_COMPLETE,
        ReasonKind.SOURCE_SILENT,
    ]
    assert verdicts[3].obstacle == "ball"
    assert report.ticks == 4
    assert report.late == report.missed == 0
    assert report.received == 5
    assert report.faults == {}


def test_what_can_wait_is_done_between_ticks_and_only_where_there_is_time():
    clock, told = ManualClock(), []

    def publish(verdict):
        told.append(verdict.sequence)
        if verdict.sequence == 2:
            clock.sleep_until(clock.now() + 0.0015)

    ticks = [[joints(0.001 * k)] for k in range(5)]
    idle = []

    def rest(loop, time):
        told.append("rest")
        idle.append(time)

    loop = make_loop(Script(*ticks), clock, publish, rest=rest)
    loop.run(duration=0.005)
    assert idle == pytest.approx([0.001, 0.0005, 0.001])
    # The second tick takes longer than its period, so the third one follows at once.
    assert loop.late == 1
    assert told == [1, "rest", 2, 3, "rest", 4, "rest", 5]


def test_the_loop_ends_with_its_input_and_on_control_c():
    assert make_loop(Script([], [], []), ManualClock(), len).run().ticks == 5

    def interrupt(verdict):
        raise KeyboardInterrupt

    loop = make_loop(Script(*[[]] * 1000), ManualClock(), interrupt)
    assert loop.run().ticks == 0


class Interrupter:
    """Control-C, at a moment at which Python ignores what is raised."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_the_loop_ends_on_a_control_c_that_is_lost_in_a_destructor():
    loop = make_loop(Script(*[[]] * 1000), ManualClock(), lambda verdict: Interrupter())
    assert loop.run().ticks == 1
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.hazard("H-09")
def test_late_ticks_are_counted_and_the_grid_stays():
    clock = ManualClock(10.0)
    begins = []

    def publish(verdict):
        begins.append(clock.now())
        if len(begins) == 3:
            clock.sleep_until(clock.now() + 0.0047)

    report = make_loop(Script(*[[]] * 100), clock, publish).run(duration=0.010)
    expected = [10.0, 10.001, 10.002, 10.0067, 10.007, 10.008, 10.009]
    assert begins == pytest.approx(expected, abs=1e-9)
    assert report.ticks == 7
    assert report.late == 1
    assert report.missed == 3
    assert report.tick.longest == pytest.approx(0.0047)
    assert report.tick.p50 < 1e-6
    assert report.publish.longest == pytest.approx(0.0047)
    assert report.drain.longest == report.step.longest == 0.0


def test_a_loop_that_is_always_late_leaves_time_to_others():
    """Its deadlines are gone, and yet it sleeps: with real-time scheduling nobody else runs."""
    clock = ManualClock(10.0)
    begins = []

    def publish(verdict):
        begins.append(clock.now())
        clock.sleep_until(clock.now() + 0.0013)

    report = make_loop(Script(*[[]] * 10_000), clock, publish).run(duration=2.0)
    assert report.late == report.ticks
    gaps = np.diff(begins) - 0.0013
    rests = np.flatnonzero(gaps > 1e-6)
    assert gaps[rests] == pytest.approx(REST)
    assert np.diff(begins)[: rests[0]].sum() <= LONGEST_SPELL + 0.0014
    assert np.diff(rests).max() * 0.0013 <= LONGEST_SPELL + 0.0014
    assert gaps.sum() >= 0.04 * (begins[-1] - begins[0])


def test_garbage_is_collected_between_ticks_and_never_in_one():
    clock, within, collected = ManualClock(), [False], []

    def publish(verdict):
        for _ in range(1000):
            knot = []
            knot.append(knot)
        within[0] = False

    script = Script(*[[]] * 100)
    receive = script.receive
    script.receive = lambda: (within.__setitem__(0, True), receive())[1]
    watch = lambda phase, info: collected.append(within[0])  # noqa: E731  # removed by identity
    loop = make_loop(script, clock, publish)
    gc.callbacks.append(watch)
    try:
        loop.run()
    finally:
        gc.callbacks.remove(watch)
    assert len(collected) > 100
    assert not any(collected)


def test_a_restart_under_a_live_controller_goes_by_what_is_fresh():
    """Four seconds of joint states have waited; the first would be too old, the next a gap."""
    clock, verdicts = ManualClock(10.0), []
    waiting = [joints(6.0 + 0.001 * n) for n in range(63 * 62)]
    ticks = [waiting[63 * tick : 63 * tick + 63] for tick in range(62)]
    ticks += [[joints(10.06 + 0.001 * n), ball(10.062 + 0.001 * n)] for n in range(400)]
    report = make_loop(Script(*ticks), clock, verdicts.append, joint_timeout=0.05).run()
    held = [verdict for verdict in verdicts if verdict.sequence == 0]
    assert {verdict.level for verdict in held} == {Level.STOP}
    assert re.search(r"no fresh joint state .* was \S+ s old", str(held[-1].reasons[0]))
    kinds = {reason.kind for verdict in verdicts for reason in verdict.reasons}
    assert ReasonKind.JOINT_STATE_GAP not in kinds
    assert len(held) < 100
    assert verdicts[-1].level is Level.CLEAR
    assert report.faults["backlog: joints"] == 63 * 62


def test_a_latched_stop_is_reset_by_the_token():
    verdicts = []
    bad = joints(0.001, q=[9.0] * 7)
    reset = {"type": "reset", "token": "sesame"}
    good = [[joints(0.001 * n), ball(0.001 * n)] for n in range(2, 420)]
    good[0].insert(0, {"type": "reset", "token": "guess"})
    good[100].insert(0, reset)
    loop = make_loop(
        Script([joints(0.0), ball(0.0)], [bad], *good),
        ManualClock(),
        verdicts.append,
        reset_token="sesame",
    )
    report = loop.run()
    levels = [verdict.level for verdict in verdicts]
    assert levels[0] is Level.CLEAR
    assert set(levels[1:101]) == {Level.STOP}
    # What latched was no passing thing: levels rise with evidence only.
    assert set(levels[101:395]) == {Level.STOP}
    assert levels[-1] is Level.CLEAR
    assert report.faults == {"reset refused: unknown": 1}


# The whole of it, on real sockets


@pytest.mark.parametrize("realtime", [True, False])
def test_what_the_system_refuses_is_told_once(tmp_path, capsys, realtime):
    addresses = [f"ipc://{tmp_path}/{name}" for name in ("obstacles", "joints", "verdicts")]
    policies = set()
    observer = Observer()
    observer.observe = lambda loop, verdict: policies.add(os.sched_getscheduler(0))
    report = run(
        Cell.from_text(CELL),
        RunOptions(*addresses, duration=0.05, realtime=realtime),
        observer=observer,
    )
    lines = capsys.readouterr().err.splitlines()
    if realtime:
        assert lines == [f"armguard: {line}" for line in report.realtime.refusals]
        assert (policies == {os.SCHED_OTHER}) == (report.realtime.priority == 0)
    else:
        assert report.realtime is None
        assert not lines
        assert policies == {os.SCHED_OTHER}
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_an_address_in_use_gives_back_what_was_opened(tmp_path):
    taken = SocketInput(f"ipc://{tmp_path}/taken")
    try:
        for addresses in (
            ("ipc://{}/taken", "ipc://{}/b", "ipc://{}/c"),
            ("ipc://{}/a", "ipc://{}/taken", "ipc://{}/c"),
            ("ipc://{}/a", "ipc://{}/b", "ipc://{}/taken"),
            ("ipc://{}/a", "ipc://{}/b", "tcp://0.0.0.0:9"),
        ):
            options = RunOptions(*(address.format(tmp_path) for address in addresses))
            with pytest.raises(StreamError):
                run(Cell.from_text(CELL), options)
            assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    finally:
        taken.close()


RUN = """
import sys
from pathlib import Path
from armguard.app.cell.cell import Cell
from armguard.app.loop import Observer, RunOptions, run
from armguard.verdict import Level
levels, observer = [], Observer()
observer.observe = lambda loop, verdict: levels.append(verdict.level.name)
print("ready", flush=True)
report = run(
    Cell.load(sys.argv[1]),
    RunOptions(
        sys.argv[2],
        verdicts_address=sys.argv[3],
        record=Path(sys.argv[4]) if len(sys.argv) > 4 else None,
    ),
    observer=observer,
)
print(report.received, report.faults, sorted(set(levels)), len(levels), sep=";")
"""


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, "-c", RUN, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def write_cell(folder):
    (folder / "cell.toml").write_text(CELL)
    return folder / "cell.toml"


def test_a_run_is_recorded_with_what_was_wrong_with_messages(tmp_path):
    path = tmp_path / "run.mcap"
    process = start(write_cell(tmp_path), "-", f"ipc://{tmp_path}/out", path)
    for _ in range(2):  # the second line comes when everything is compiled
        process.stdin.write("nonsense\n")
        process.stdin.flush()
        with VerdictReader(f"ipc://{tmp_path}/out") as reader:
            while reader.latest(0.1) is None:
                assert process.poll() is None, process.stderr.read()
    # As they become true: what is older than a joint state may be when it is read is not judged.
    with VerdictReader(f"ipc://{tmp_path}/out") as reader:
        judged = 0
        deadline = time.monotonic() + PATIENCE
        while judged < 100 and time.monotonic() < deadline:
            now = time.monotonic()
            process.stdin.write(f"{json.dumps(joints(now))}\n{json.dumps(ball(now))}\n")
            process.stdin.flush()
            verdict = reader.latest(0.002)
            judged += verdict is not None and verdict.sequence > 0
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    ticks = int(output.splitlines()[-1].split(";")[-1])
    events = read_events(path)
    told = [event for event in events if isinstance(event, VerdictMessage)]
    assert len(told) == ticks, "those without a joint state are there as well"
    assert any(event.sequence == 0 for event in told)
    lines = [event.message for event in events if isinstance(event, Log)]
    assert any("malformed: unknown" in line for line in lines)
    assert "monitor has ended" in lines[-1]
    judged = sum(event.sequence > 0 for event in told)
    assert judged
    report = replay(path)
    assert report.is_identical
    assert report.compared == judged


class StuckRecorder:
    """What writes it has ended."""

    lost = 0

    def defer(self):
        pass

    def note(self, line):
        pass

    def find_trouble(self):
        return "its writer process has ended"


def test_a_recording_that_is_not_written_any_more_is_told_at_once(tmp_path):
    process = start(
        write_cell(tmp_path), f"ipc://{tmp_path}/in", f"ipc://{tmp_path}/out", tmp_path / "a.mcap"
    )
    with process, VerdictReader(f"ipc://{tmp_path}/out") as reader:
        while reader.latest(0.1) is None:
            assert process.poll() is None, process.stderr.read()
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        (writer,) = (
            int(child)
            for child in children
            if b"armguard.recording" in Path(f"/proc/{child}/cmdline").read_bytes()
        )
        os.kill(writer, signal.SIGKILL)
        line = process.stderr.readline()  # while the run goes on
        assert line == "the recording is not written: its writer process has ended\n"
        assert reader.latest(1.0) is not None
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert "is not complete" in process.communicate(timeout=60)[1]


def test_stamps_of_long_ago_on_standard_input_are_no_news(tmp_path):
    lines = [json.dumps(m) for n in range(300) for m in (joints(n / 500), ball(n / 500))]
    process = start(write_cell(tmp_path), "-", f"ipc://{tmp_path}/out")
    output, errors = process.communicate("\n".join(lines), timeout=60)
    assert process.returncode == 0, errors
    received, _, levels, _ = output.splitlines()[-1].split(";")
    assert int(received) == 600
    assert levels == "['STOP']"


def test_control_c_ends_with_the_summary_and_leaves_nothing(tmp_path):
    process = start(write_cell(tmp_path), f"ipc://{tmp_path}/in", f"ipc://{tmp_path}/out")
    with VerdictReader(f"ipc://{tmp_path}/out") as reader:
        end = time.monotonic() + PATIENCE
        while reader.latest(0.1) is None:
            assert time.monotonic() < end
            assert process.poll() is None, process.stderr.read()
        verdicts = iter(reader)
        for _ in range(20):
            next(verdicts)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 0
        assert errors == ""
        assert output.splitlines()[-1].startswith("0;{};['STOP'];"), output
        while not reader.silent():
            time.sleep(0.01)
    assert [path.name for path in tmp_path.iterdir()] == ["cell.toml"]


# The demos that talk to it


def load_demo(name):
    specification = importlib.util.spec_from_file_location(name, EXAMPLE.parent / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_the_demos_of_perception_and_controller_make_a_cell_with_the_loop(tmp_path, capsys):
    inputs, verdicts = f"ipc://{tmp_path}/in", f"ipc://{tmp_path}/out"
    controller, perception = load_demo("04_controller"), load_demo("03_perception")
    assert controller.main(0.1, joints=inputs, verdicts=verdicts) == 0.0  # silence: it stands
    seeing = threading.Thread(target=perception.main, args=(4.0, inputs))
    # A machine that is busy with other things must not look like a robot that has stopped talking.
    text = EXAMPLE.read_text().replace("joint_timeout = 0.25", "joint_timeout = 5.0")
    text = text.replace("timeout = 0.2 ", "timeout = 5.0 ").replace("= 0.002 ", "= 0.02 ")
    (tmp_path / "cell.toml").write_text(text)
    process = start(tmp_path / "cell.toml", inputs, verdicts)
    try:
        with VerdictReader(verdicts) as reader:
            end = time.monotonic() + PATIENCE
            while reader.latest(0.1) is None:
                assert time.monotonic() < end
                assert process.poll() is None, process.stderr.read()
        seeing.start()
        way = controller.main(2.0, joints=inputs, verdicts=verdicts)
        seeing.join()
    finally:
        process.kill()
        process.communicate()
    assert way > 0.0
    assert "silence" in capsys.readouterr().out


def test_durations_are_kept_to_a_percent_and_the_longest_exactly():
    random = np.random.default_rng(0)
    values = 10.0 ** random.uniform(-6.0, 0.5, 20_000)
    durations = Durations()
    assert math.isnan(durations.percentile(50.0))
    for value in values:
        durations.add(float(value))
    assert durations.longest == values.max()
    for percent in (1.0, 50.0, 99.0, 99.9, 100.0):
        exact = np.percentile(values, percent, method="inverted_cdf")
        assert exact * (1 - 1e-9) <= durations.percentile(percent) <= exact * 1.012
    durations.add(0.0)
    durations.add(1e6)
    assert durations.percentile(100.0) == 1e6


def test_contact_that_is_wanted_is_asked_for_and_ended_over_the_wire():
    verdicts = []
    near = [[joints(0.001 * n), ball(0.001 * n, x=1.0)] for n in range(40)]
    asked = {"type": "ignore", "token": "sesame", "link": "*", "ids": "ball", "until": 9.0}
    near[10] = [{**asked, "number": 5}, {**asked, "number": 5}, *near[10]]
    near[12].insert(0, {**asked, "number": 6, "link": "thumb"})
    near[14].insert(0, {**asked, "number": 7, "until": 0.001})
    near[20] = [{"type": "watch", "number": 5}, {"type": "watch", "number": 5}, *near[20]]
    text = '[robot]\nname = "panda"\n[sources.camera]\n[thresholds]\nrise_delay = 0.0\n'
    loop = make_loop(Script(*near), ManualClock(), verdicts.append, text, reset_token="sesame")
    report = loop.run()
    ignored = [
        any(one.kind is ReasonKind.PAIR_IGNORED for one in verdict.reasons) for verdict in verdicts
    ]
    assert ignored[:40] == [False] * 10 + [True] * 10 + [False] * 20
    for verdict, one in zip(verdicts[:40], ignored, strict=False):
        assert verdict.obstacle == (None if one else "ball")
    assert report.faults == {"ignore refused: exemptions": 3}
