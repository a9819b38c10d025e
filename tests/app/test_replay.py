import base64
import csv
import gzip
import json
import re
import subprocess
import sys
from datetime import datetime, timedelta

import msgspec
import pytest

from armguard.app.cli import MISTAKE, main
from armguard.app.processes import COMPLAINT
from armguard.app.replay import (
    COLUMNS,
    StopList,
    Watch,
    explain_tick,
    find_next,
    read_changes,
    read_time,
)
from armguard.app.summary import VerdictCounts
from armguard.exceptions import ArmguardError
from armguard.recording import Recording, Replay, ReplayedTick, Rotation, writer
from armguard.recording.events import Gap
from armguard.recording.signing import write_signing_pair
from armguard.robot import Robot
from armguard.verdict import Level, Reason, ReasonKind, Verdict
from armguard.view import ViewProcess
from support import eventful_runs
from support.bags_made import usual, write_bag
from support.recordings_made import record, record_pause

VERDICT = Verdict(0.0, 1, Level.CLEAR, 1.0, 0.1, 1.0, None, None, True, 0, (), 0.1)
CONTACT = Reason(ReasonKind.CONTACT, "panda_hand and ball", "in 1 s")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "run.mcap"
    record(path, ticks=500)
    return path


def run(capsys, *arguments):
    """Exit code, and what is printed on both streams."""
    code = main(["replay", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_a_replay_says_whether_it_is_identical(path, capsys):
    code, out, _ = run(capsys, path)
    assert code == 0
    assert "bit-identical: all 500 verdicts that were compared are the same" in out
    code, out, _ = run(capsys, path, "--json")
    told = json.loads(out)
    assert code == 0
    assert told["identical"]
    assert (told["ticks"], told["compared"], told["lost"]) == (500, 500, 0)
    assert told["difference"] is None
    assert not told["cut_off"]


def test_what_is_not_identical_is_told_with_its_cause_and_another_exit_code(
    path, capsys, monkeypatch
):
    step = Replay.ticks

    def alter(self):
        for number, tick in enumerate(step(self)):
            if number == 20:
                later = tick.recorded._replace(evaluated=77)
                self._note_difference(later._asdict(), tick.replayed._asdict())
            yield tick

    monkeypatch.setattr(Replay, "ticks", alter)
    code, out, _ = run(capsys, path)
    assert code == COMPLAINT
    assert "not identical: tick 21 at" in out
    assert "evaluated: 77 recorded" in out
    assert "cause: unknown: version" in out


def test_a_gap_is_told_and_is_no_success(path, capsys, monkeypatch):
    events = Recording.events

    def lose(self):
        for number, event in enumerate(events(self)):
            yield event._replace(event=Gap(events=3, seconds=0.1)) if number == 300 else event

    monkeypatch.setattr(Recording, "events", lose)
    code, out, _ = run(capsys, path)
    assert code == COMPLAINT
    assert "3 events were lost" in out


def test_a_recording_without_an_end_is_told_and_is_a_success(path, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    content = path.read_bytes()
    end = bytes([15, 4, 0, 0, 0, 0, 0, 0, 0])  # of the data; behind it stands the index
    cut.write_bytes(content[: content.rindex(end)])
    code, out, _ = run(capsys, cut)
    assert code == 0
    assert "has no end" in out


def test_a_table_has_all_verdicts(path, tmp_path, capsys):
    table = tmp_path / "verdicts.csv"
    code, _, _ = run(capsys, path, "--csv", table)
    assert code == 0
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    ticks = list(Replay(Recording(path)).ticks())
    assert [float(row["now"]) for row in rows] == [tick.now for tick in ticks]
    assert [row["level"] for row in rows] == [tick.replayed.level.name for tick in ticks]
    assert {row["identical"] for row in rows} == {"True"}
    code, out, err = run(capsys, path, "--csv", "-")
    assert code == 0
    assert len(list(csv.reader(out.splitlines()))) == 501
    assert "bit-identical" in err


def test_no_table_is_written_over_what_is_replayed(path, cell, tmp_path, capsys):
    content = path.read_bytes()
    link = tmp_path / "link.csv"
    link.hardlink_to(path)
    for table in (path, link):
        code, out, err = run(capsys, path, "--csv", table)
        assert (code, out) == (MISTAKE, "")
        assert "the recording itself" in err
    assert path.read_bytes() == content
    bag = write_bag(tmp_path / "bag", usual(3))
    code, _, err = run(capsys, bag, "--cell", cell, *BAG, "--csv", bag / "metadata.yaml")
    assert code == MISTAKE
    assert "the recording itself" in err


def test_a_table_that_nobody_reads_to_its_end_is_no_mistake(path):
    command = f"{sys.executable} -m armguard replay {path} --csv - | head -n 1"
    shown = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert shown.stdout == ",".join(COLUMNS) + "\n"
    assert not shown.stderr


def test_a_verdict_is_explained_by_either_clock(path, capsys):
    ticks = list(Replay(Recording(path)).ticks())
    tick = ticks[400]
    code, by_monitor, _ = run(capsys, path, "--explain", f"{tick.now - 1e-6}")
    assert code == 0
    moment = datetime.fromtimestamp(ticks[399].nanoseconds * 1e-9)
    _, by_day, _ = run(capsys, path, "--explain", f"{moment:%H:%M:%S.%f}")
    assert abs(float(re.match(r"(\S+) s", by_day)[1]) - tick.now) < 0.01
    verdict = tick.recorded
    assert by_monitor.startswith(f"{tick.now:.3f} s (")
    times = f"contact time {verdict.contact_time:.3f} s, stop time {verdict.stop_time:.3f} s"
    assert f"): {verdict.level.name}, {times}" in by_monitor
    for reason in verdict.reasons:
        assert f"because: {reason}" in by_monitor
    assert "pair: panda_" in by_monitor
    assert f"{verdict.level.name} since " in by_monitor
    _, out, _ = run(capsys, path, "--explain", f"{tick.now}", "--json")
    assert "because: " in json.loads(out)["explained"]


def test_an_explanation_tells_what_a_contact_limit_permitted():
    class Nothing:
        explain = staticmethod(lambda: None)
        pairs = staticmethod(lambda count: [])

    allowed = Reason(
        ReasonKind.CONTACT_ALLOWED, "hand and arm", "at most 0.21 of 0.9 m/s (arm: a test)"
    )
    verdict = VERDICT._replace(
        level=Level.AWARE, contact_time=0.05, harm_time=0.5, contact_speed=0.21, reasons=(allowed,)
    )
    watch = Watch("1.0")
    watch.take(ReplayedTick(0, 1.0, verdict, verdict, True, True))
    first, since, because = explain_tick(Nothing(), watch)
    assert first.endswith("AWARE, contact time 0.050 s, harm time 0.500 s, stop time 0.100 s")
    assert since.endswith(str(allowed))
    assert because == f"because: {allowed}"


def test_a_stop_by_late_data_is_explained_as_one(tmp_path, capsys):
    path = tmp_path / "late.mcap"
    verdicts = record_pause(path)
    counts = VerdictCounts()
    for verdict in verdicts:
        counts.count(verdict)
    assert counts.reasons == {"late data: camera": 1}
    begin = next(one.stamp for one in verdicts if one.level is Level.STOP)
    code, out, _ = run(capsys, path, "--explain", f"{begin + 0.2}")
    assert code == 0
    assert re.search(
        r"STOP since .*: late data: camera \(\d+ ms old, usually 10 ms; with fresh", out
    )
    assert "because: waiting for evidence before the level rises (STOP for 0.2 s: late data" in out
    _, out, _ = run(capsys, path, "--json")
    (stop,) = json.loads(out)["stops"]
    assert stop["reason"].startswith("late data: camera")


def test_stops_that_would_not_have_been_are_shown(path, capsys):
    code, out, _ = run(capsys, path, "--what-if", "rise_delay=0,operating.velocity=0.3")
    assert code == 0
    assert "stops with rise_delay = 0, operating.velocity = 0.3" in out
    assert re.search(r"\d+ of \d+ stops would have been avoided", out)
    assert "as it was recorded" in out
    _, out, _ = run(capsys, path, "--what-if", "latency=0.5", "--json")
    told = json.loads(out)
    assert told["what_if"] == {"latency": "0.5"}
    assert all(stop["would_be"] for stop in told["stops"])
    assert told["new_stop_ticks"] > 0


def test_stops_are_counted_from_their_first_verdict_to_their_last():
    stops = StopList()
    for now, recorded, replayed in [
        (1.0, "CLEAR", "STOP"),
        (2.0, "STOP", "CLEAR"),
        (3.0, "STOP", "STOP"),
        (4.0, "SLOW", "SLOW"),
        (5.0, "STOP", "SLOW"),
    ]:
        verdicts = [
            VERDICT._replace(level=Level[one], reasons=(CONTACT,)) for one in (recorded, replayed)
        ]
        stops.take(ReplayedTick(0, now, *verdicts, is_compared=False, is_identical=False))
    first, second = stops.stops
    assert (first.begin, first.end, first.ticks, first.kept) == (2.0, 3.0, 2, 1)
    assert (second.begin, second.end, second.kept) == (5.0, 5.0, 0)
    assert first.reason == str(CONTACT)
    assert (stops.new, stops.seconds) == (1, 4.0)


def test_a_time_of_day_is_the_next_one_from_the_start_on():
    start = datetime(2026, 11, 22, 23, 59, 0)
    nanoseconds = round(start.timestamp() * 1e9)
    for text, expected in (("23:59:30.5", 30.5), ("0:00:10", 70.0), ("23:59:00", 0.0)):
        _, of_day = read_time(text)
        assert find_next(nanoseconds, of_day) - nanoseconds == pytest.approx(1e9 * expected)
    assert read_time("12.5") == (12.5, None)
    assert read_time("1:02:03")[1] == timedelta(hours=1, minutes=2, seconds=3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--explain", "yesterday"], "--explain: is 'yesterday'"),
        (["--explain", "1e9"], "--explain: is 1e9; expected a time from 0.000 s ("),
        (["--what-if", "latency"], "--what-if: holds 'latency'"),
        (["--what-if", "colour=red"], "setting 'colour': is not known"),
        (["--what-if", "latency=-1"], "latency: is -1.0"),
        (["--csv", "/dev/full"], "/dev/full: cannot be written (No space left on device)"),
        (["--csv", "/nowhere/table.csv"], "/nowhere/table.csv: cannot be written"),
    ],
)
def test_a_mistake_is_one_line(arguments, words, path, capsys):
    code, out, err = run(capsys, path, *arguments)
    assert code == MISTAKE
    assert not out
    assert words in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("content", [None, b"", b"nonsense", b"\x89MCAP0\r\n"])
def test_a_file_that_is_none_is_one_line(content, tmp_path, capsys):
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    code, out, err = run(capsys, path)
    assert (code, out) == (MISTAKE, "")
    assert err.startswith(f"armguard: {path}: ")
    assert err.count("\n") == 1


def test_an_arm_that_armguard_does_not_know_cannot_be_drawn(tmp_path, capsys):
    path, robot = tmp_path / "run.mcap", Robot.load("panda")
    robot.name = "unknown arm"
    record(path, robot=robot, ticks=5)
    code, _, err = run(capsys, path, "--view")
    assert code == MISTAKE
    assert "cannot draw 'unknown arm'" in err
    code, _, _ = run(capsys, path)
    assert code == 0


def test_the_page_shows_the_replay_and_stays(path, capsys, monkeypatch):
    frames, stays = [], []
    monkeypatch.setattr(
        "armguard.app.replay.MonitorFeed.observe",
        lambda self, *arguments, wall: frames.append(arguments),
    )
    monkeypatch.setattr(ViewProcess, "wait", lambda page: stays.append(page.running))
    code, _, err = run(capsys, path, "--view")
    assert code == 0
    assert "see it in the browser: http://127.0.0.1:" in err
    assert len(frames) == 500
    assert stays == [True]


def test_the_export_of_a_replay_has_all_its_moments(path, tmp_path, capsys):
    export = tmp_path / "scene.html"
    code, _, err = run(capsys, path, "--export", export)
    assert code == 0
    assert "browser" not in err
    packed = re.search(r'id="film" type="text/plain">([^<]*)<', export.read_text())[1]
    film = msgspec.msgpack.decode(gzip.decompress(base64.b64decode(packed)))
    times = [row[1] for row in film["news"]["moments"]]
    assert times[-1] - times[0] == pytest.approx(1.0, abs=0.05)
    assert len(times) >= 8
    assert {"banner", "camera"} <= {one["type"] for one in film["moments"][-1][1]}


def test_an_export_to_nowhere_is_refused_before_anything_is_replayed(path, tmp_path, capsys):
    code, out, err = run(capsys, path, "--export", tmp_path / "nowhere" / "scene.html")
    assert (code, out) == (MISTAKE, "")
    assert "cannot be written" in err


@pytest.fixture
def cell(tmp_path):
    """A cell whose camera publishes people."""
    path = tmp_path / "cell.toml"
    path.write_text('[robot]\nname = "panda"\n[sources.camera]\nrate = 50.0\n')
    return path


BAG = ["--topics", "/joint_states", "camera=/people", "--radius", "0.1"]


def test_a_recording_of_others_is_led_through_a_cell_and_recorded(cell, tmp_path, capsys):
    bag, path = write_bag(tmp_path / "bag", usual(50)), tmp_path / "run.mcap"
    table = tmp_path / "verdicts.csv"
    arguments = [bag, "--cell", cell, *BAG]
    code, out, _ = run(capsys, *arguments, "--record", path, "--csv", table)
    assert code == 0
    assert "50 verdicts" in out
    assert len(table.read_text().splitlines()) == 51
    code, out, _ = run(capsys, path)
    assert code == 0
    assert "bit-identical: all 50 verdicts" in out
    code, out, _ = run(capsys, *arguments, "--json")
    told = json.loads(out)
    assert (told["ticks"], told["passed_over"]) == (50, {})
    code, out, _ = run(capsys, *arguments, "--explain", "0.3")
    assert out.startswith("0.300 s (")
    assert "pair: panda_" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (BAG, "--cell: is missing"),
        (["--cell", "demos/cell.toml"], "--topics: is missing"),
        ([*BAG, "--cell", "nowhere.toml"], "nowhere.toml: cannot be read"),
        ([*BAG[:3], "--cell", "CELL"], "poses without sizes"),
        (["--topics", "/people", "/nothing", "--cell", "CELL"], "topic '/nothing': is not there"),
        ([*BAG, "--cell", "CELL", "--what-if", "latency=1"], "for armguard's own recordings"),
        ([*BAG, "--cell", "CELL", "--record", "/nowhere/a.mcap"], "no folder /nowhere"),
        ([*BAG, "--cell", "CELL", "--explain", "99"], "expected a time from 0.000 s"),
        (["--record", "a.mcap"], "--record: is for recordings of other software"),
        (["--radius", "0.1"], "--radius: is for recordings of other software"),
        (["--snapshot"], "--snapshot: is for recordings of other software"),
        (["--stamps", "recorded"], "--stamps: is for recordings of other software"),
    ],
)
def test_a_mistake_about_a_recording_of_others_is_one_line(
    arguments, words, cell, tmp_path, capsys
):
    bag = write_bag(tmp_path / "bag", usual(3))
    arguments = [str(cell) if one == "CELL" else one for one in arguments]
    code, out, err = run(capsys, bag, *arguments)
    assert (code, out) == (MISTAKE, "")
    assert words in err
    assert err.count("\n") == 1


def test_a_recording_of_others_without_its_options_says_what_it_needs(tmp_path, capsys):
    (file,) = write_bag(tmp_path / "bag", usual(3)).glob("*.mcap")
    code, _, err = run(capsys, file)
    assert code == MISTAKE
    assert "recordings of other programs need --cell and --topics" in err


def test_changes_are_read_by_commas():
    assert read_changes("a=1, b.c = x") == {"a": "1", "b.c": "x"}
    for text in ("", "a", "=1", "a=", "a=1,,b=2"):
        with pytest.raises(ArmguardError, match="name=value"):
            read_changes(text)
    assert eventful_runs.MOTIONS


def test_verify_tells_what_was_changed_and_who_signed(tmp_path, capsys):
    secret, public, key = write_signing_pair("recorder", tmp_path)
    path = tmp_path / "run.mcap"
    record(path, ticks=50, recorder_options={"key": secret})
    assert main(["replay", str(path), "--verify", "--key", str(public)]) == 0
    told = capsys.readouterr().out
    assert re.search(rf"part 1, intact; \d+ chunks are as they were, signed by {key}", told)
    assert "verified from part 1 on" in told
    assert main(["replay", str(path), "--verify"]) == 0
    assert "without --key the author is unknown" in capsys.readouterr().out
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert main(["replay", str(path), "--verify", "--json"]) == 1
    out, err = capsys.readouterr()
    (told,) = json.loads(out)["files"]
    assert not told["intact"]
    assert told["problems"][0] in err


def test_verify_tells_from_which_part_on_and_that_those_before_were_not_verified(
    tmp_path, capsys, monkeypatch
):
    """What is left is right, so that is no error: retention removes beginnings as well."""
    monkeypatch.setattr(writer, "FLUSH_INTERVAL", 0.0)
    path = tmp_path / "run.mcap"
    record(path, ticks=100, recorder_options={"rotation": Rotation(size=100_000)})
    for part, words in ((2, "part 1 was not verified"), (3, "parts 1 to 2 were not verified")):
        (tmp_path / f"run.{part}.mcap").replace(path)
        assert main(["replay", str(path), "--verify", "--json"]) == 0
        out, err = capsys.readouterr()
        told = json.loads(out)
        assert (told["intact"], told["first_part"], told["unverified_parts"]) == (
            True,
            part,
            part - 1,
        )
        assert f"{path}: part {part}, intact" in err
        assert f"verified from part {part} on" in err
        assert words in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--verify", "--view"], "--verify: replays nothing"),
        (["--verify", "--key", "nowhere.public"], "cannot be read"),
        (["--key", "nowhere.public"], "--key: is for signatures"),
    ],
)
def test_options_that_do_not_go_with_a_verification_are_refused(arguments, words, tmp_path, capsys):
    path = tmp_path / "run.mcap"
    record(path, ticks=5)
    assert main(["replay", str(path), *arguments]) == 2
    assert words in capsys.readouterr().err
