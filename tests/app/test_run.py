"""`armguard run` and `armguard view` as their users meet them: processes, addresses, mistakes."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import zmq

from armguard.app import view_feed
from armguard.app.cell import Cell
from armguard.app.cli import main
from armguard.app.loop import run
from armguard.app.premises import Premise
from armguard.app.run import describe_remedy, find_verdicts_address
from armguard.jit.progress import Progress, compilation
from armguard.messages.answers import decode_answer, encode_verdict
from armguard.recording import Recording
from armguard.streams import (
    VERDICTS_ADDRESS,
    Keys,
    Publisher,
    SocketInput,
    VerdictPublisher,
    VerdictReader,
)
from armguard.streams.keys import write_new_pair
from armguard.verdict import Level, Verdict
from armguard.view import FrameMessage
from armguard.view.messages import decode_message
from support.recordings_made import read_verdicts

ARMGUARD = Path(sys.executable).with_name("armguard")
CELL = '[robot]\nname = "panda"\noperating = "published"\n'
NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
PATIENCE = 300.0  # a cold start compiles


@pytest.fixture
def cell(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(CELL)
    return path


@pytest.fixture
def addresses(tmp_path):
    """Options that keep a run off the default ports."""
    names = ("obstacles", "joints", "verdicts")
    return [word for name in names for word in (f"--{name}", f"ipc://{tmp_path}/{name}")]


def check_mistake(capsys, arguments, words):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[robot", "cell.toml"),
        ("", "robot"),
        ('[robot]\nname = "nobody"\n', "nobody"),
        ('[robot]\nname = "panda"\n[bounds]\nspeed = "fast"\n', "speed"),
        ('[robot]\nname = "panda"\n[surprise]\nx = 1\n', "surprise"),
        ('settings = "best"\n[robot]\nname = "panda"\n', "settings: is 'best'"),
        ('settings = "auto"\nsettings_from = "no"\n[robot]\nname = "panda"\n', "settings_from"),
        ('[robot]\nname = "panda"\n[monitor]\nrate = -1.0\n', "rate"),
    ],
)
def test_a_wrong_cell_is_a_mistake(cell, addresses, text, words, capsys):
    cell.write_text(text)
    check_mistake(capsys, ["run", str(cell), "--duration", "0.1", *addresses], words)


@pytest.mark.parametrize(
    ("option", "address"),
    [
        ("--obstacles", "tcp://0.0.0.0:5701"),
        ("--joints", "tcp://192.168.0.1:5701"),
        ("--verdicts", "rubbish"),
        ("--view", "tcp://0.0.0.0:5701"),
    ],
)
def test_an_address_beyond_this_machine_is_a_mistake(cell, addresses, option, address, capsys):
    check_mistake(capsys, ["run", str(cell), *addresses, option, address], address)


@pytest.mark.parametrize("host", ["rubbish", "localhost", "192.0.2.77"])
def test_a_page_on_an_interface_that_is_none_is_a_mistake(host, capsys):
    check_mistake(capsys, ["view", "tcp://127.0.0.1:1", "--host", host], host)


def test_a_reset_beyond_this_machine_needs_keys(tmp_path, capsys):
    reset = ["reset", "tcp://192.0.2.1:5702", "--token", "x"]
    check_mistake(capsys, reset, "armguard keys new")
    secret, public, _ = write_new_pair("desk", tmp_path)
    check_mistake(capsys, [*reset, "--key", str(secret)], "--server-key: is missing")
    secret.chmod(0o644)
    both = ["--key", str(secret), "--server-key", str(public)]
    for command in (reset, ["view", "tcp://192.0.2.1:5704"]):
        check_mistake(capsys, [*command, *both], "desk.secret: can be read by others")


def test_new_keys_are_written_once_and_tell_what_goes_into_the_cell_file(tmp_path, capsys):
    arguments = ["keys", "new", "camera", "--dir", str(tmp_path)]
    assert main(arguments) == 0
    told = capsys.readouterr().out
    tables = re.findall(r"^\[keys.*?(?=\n\n|\Z)", told, re.MULTILINE | re.DOTALL)
    text = "\n".join([CELL, *tables])
    with Cell.from_text(text, tmp_path).make_authenticator() as authenticator:
        assert authenticator.may("camera", "obstacles")
    check_mistake(capsys, arguments, "has keys already")


def test_keys_that_sign_recordings_tell_how_they_are_used(cell, tmp_path, capsys):
    arguments = ["keys", "new", "recorder", "--recordings", "--dir", str(tmp_path)]
    assert main(arguments) == 0
    told = capsys.readouterr().out
    secret = str(tmp_path / "recorder.secret")
    assert f"--sign {secret}" in told
    assert f"--verify --key {tmp_path / 'recorder.public'}" in told
    check_mistake(capsys, arguments, "has keys already")
    run = ["run", str(cell), "--sign"]
    check_mistake(capsys, [*run, secret], "--sign: is for recordings")
    recorded = ["--record", str(tmp_path)]
    check_mistake(capsys, [*run, "nowhere", *recorded], "nowhere: cannot be read")
    check_mistake(capsys, ["run", str(cell), "--proof-interval", "1"], "is for recordings")
    for value in ("-1", "nan"):
        told = "--proof-interval: is"
        check_mistake(capsys, ["run", str(cell), "--proof-interval", value, *recorded], told)
    for option in ("--part-hours", "--part-megabytes", "--keep-days"):
        for value in ("0", "-1", "nan", "inf"):
            check_mistake(capsys, ["run", str(cell), option, value, *recorded], f"{option}: is")


def add_keys(cell, folder, **rights):
    """Give a cell file keys; those of its clients by name."""
    secret, public, _ = write_new_pair("monitor", folder)
    lines = [f'\n[keys]\nsecret = "{secret.name}"\n']
    keys = {}
    for name, may in rights.items():
        own, _, key = write_new_pair(name, folder)
        lines.append(f'[keys.clients.{name}]\npublic = "{key}"\nmay = {may}\n')
        keys[name] = Keys.load(own, public)
    with cell.open("a") as file:
        file.writelines(lines)
    return keys


def test_a_run_with_keys_hears_and_answers_its_clients_on_every_interface(cell, tmp_path):
    keys = add_keys(
        cell, tmp_path, camera=["obstacles"], controller=["joints", "verdicts"], desk=["verdicts"]
    )
    names = ("obstacles", "joints", "verdicts", "view")
    options = [word for name in names for word in (f"--{name}", "tcp://0.0.0.0:*")]
    with start("run", str(cell), "--no-realtime", *options) as run:
        try:
            where = {}
            while len(where) < 4:
                line = run.stderr.readline()
                assert line, "ended by itself"
                found = re.search(r"(\w+) at tcp://0\.0\.0\.0:(\d+)", line)
                if found:
                    where[found[1]] = f"tcp://127.0.0.1:{found[2]}"
            with (
                Publisher(where["joints"], keys=keys["controller"]) as arm,
                Publisher(where["obstacles"], "camera", keys["camera"]) as camera,
                VerdictReader(where["verdicts"], keys["controller"]) as reader,
                VerdictReader(where["verdicts"]) as stranger,
            ):
                end = time.monotonic() + PATIENCE
                verdict = None
                while time.monotonic() < end:
                    now = time.monotonic()
                    arm.joints(now, NAMES, READY, [0.0] * 7)
                    camera.update(["ball"], now, [[4.0, 0.0, 0.5]], [[0.0] * 3], radius=0.1)
                    verdict = reader.latest(0.002)
                    if verdict is not None and verdict.level is not Level.STOP:
                        break
                assert verdict.level is not Level.STOP
                assert stranger.latest() is None
        finally:
            run.send_signal(signal.SIGINT)
            run.communicate(timeout=PATIENCE)


@pytest.mark.parametrize("option", ["--obstacles", "--joints", "--verdicts", "--view"])
def test_an_address_in_use_is_a_mistake(cell, addresses, option, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        check_mistake(capsys, ["run", str(cell), *addresses, option, address], "in use")


@pytest.mark.parametrize("command", [["view", "tcp://127.0.0.1:1"], ["demo"], ["show", "ur5"]])
def test_a_port_of_the_page_in_use_is_a_mistake(command, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        check_mistake(capsys, [*command, "--port", port], port)


def test_views_are_told_what_is_waited_for(cell, addresses, tmp_path, monkeypatch):
    """How far the kernels are, and then that there are no joint states yet."""
    address, told = f"ipc://{tmp_path}/view", []
    with zmq.Context() as context, context.socket(zmq.SUB) as view:
        view.subscribe(b"")
        view.connect(address)

        def hear():
            while view.poll(0):
                told.append(decode_message(view.recv()))

        def run_after_kernels(*arguments, **options):
            while not told:  # a view takes a moment to attach
                compilation.tell(Progress(12, "a_kernel", 3.0))
                time.sleep(0.02)
                hear()
            return run(*arguments, **options)

        monkeypatch.setattr("armguard.app.run.run", run_after_kernels)
        options = ["--view", address, "--duration", "0.3", "--no-realtime", "--json"]
        assert main(["run", str(cell), *addresses, *options]) == 0
        hear()
    assert told[0].text.startswith("compiling kernel 12 of about ")
    frames = [message for message in told if isinstance(message, FrameMessage)]
    assert {frame.sequence for frame in frames} == {0}
    assert frames[-1].verdict.level == "STOP"


@pytest.mark.hazard("H-10")
def test_a_configuration_has_one_digest_everywhere_and_another_one_does_not_start(
    cell, addresses, tmp_path, monkeypatch, capfd
):
    published, record = [], tmp_path / "run.mcap"
    send = VerdictPublisher.publish

    def publish(publisher, verdict):
        published.append(encode_verdict(verdict, 0.0, configuration=publisher._configuration))
        send(publisher, verdict)

    monkeypatch.setattr(VerdictPublisher, "publish", publish)
    origins = []
    monkeypatch.setattr(
        view_feed.MonitorFeed, "__init__", lambda *arguments: origins.append(arguments[3])
    )
    for name in ("note", "publish"):
        monkeypatch.setattr(view_feed.MonitorFeed, name, lambda *_, **__: None)
    options = [*addresses, "--duration", "0.05", "--no-realtime", "--json"]
    observers = ["--record", str(record), "--view", f"ipc://{tmp_path}/view"]
    assert main(["run", str(cell), *options, *observers]) == 0
    (digest,) = re.findall(r"configuration ([0-9a-f]{16})\n", capfd.readouterr().err)
    assert {decode_answer(data).configuration for data in published} == {digest}
    assert [origin.configuration for origin in origins] == [digest]
    assert Recording(record).provenance["configuration"] == digest
    assert {verdict.configuration for verdict in read_verdicts(record)} == {None}

    assert main(["run", str(cell), *options, "--expect", digest]) == 0
    capfd.readouterr()
    published.clear()
    cell.write_text(CELL + "[thresholds]\nlatency = 0.0021\n")
    code = main(["run", str(cell), *options, "--expect", digest])
    out, err = capfd.readouterr()
    assert (code, out, published) == (2, "", [])
    (line,) = err.splitlines()
    assert re.fullmatch(
        rf"armguard: --expect: is {digest}, and the digest of this configuration is [0-9a-f]{{16}};"
        r" .*",
        line,
    )


def start(*arguments, **options):
    return subprocess.Popen(
        [ARMGUARD, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def test_a_view_waits_for_a_monitor_until_control_c():
    with start("view", "tcp://127.0.0.1:1", start_new_session=True) as view:
        assert "http://127.0.0.1:" in view.stdout.readline()
        os.killpg(view.pid, signal.SIGINT)
        assert view.wait(PATIENCE) == 0
        assert view.stderr.read() == ""


def test_a_controller_that_commits_a_piece_is_answered(cell, tmp_path, addresses):
    cell.write_text(CELL + '[sources.camera]\n[monitor]\nmotion = "planned"\n')
    rest = NAMES, [0.0, 0.5], [READY] * 2, [[0.0] * 7] * 2
    with (
        start("run", str(cell), *addresses) as run,
        Publisher(f"ipc://{tmp_path}/joints") as arm,
        Publisher(f"ipc://{tmp_path}/obstacles", "camera") as camera,
        VerdictReader(f"ipc://{tmp_path}/verdicts") as reader,
    ):
        deadline = time.monotonic() + PATIENCE
        answer = None
        # What was asked before the monitor saw arm and camera is refused, so it asks again.
        while answer is None or not answer.safe:
            assert time.monotonic() < deadline, (answer, reader.latest())
            now = time.monotonic()
            arm.joints(now, NAMES, READY, [0.0] * 7)
            camera.update(["ball"], now, [[9.0, 0.0, 0.5]], radius=0.1)
            answer = reader.answer(arm.plan("commit", now, *rest, 0.01), timeout=0.005) or answer
        assert answer.reasons == ()
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE) == 0


def test_lines_on_standard_input_are_judged(cell, tmp_path):
    state = {"type": "joints", "names": NAMES, "q": READY, "v": [0.0] * 7}
    verdicts = f"ipc://{tmp_path}/verdicts"
    arguments = ("run", str(cell), "--obstacles", "-", "--verdicts", verdicts, "--json")
    with start(*arguments, stdin=subprocess.PIPE) as run, VerdictReader(verdicts) as reader:
        deadline = time.monotonic() + PATIENCE
        while (verdict := reader.latest()) is None or verdict.sequence == 0:
            assert time.monotonic() < deadline
            line = json.dumps(state | {"stamp": time.monotonic()})
            run.stdin.write(line + "\nnonsense\n")
            run.stdin.flush()
            time.sleep(0.01)
        out, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0
    summary = json.loads(out)
    assert summary["ticks"] > 0
    assert summary["faults"] > 0
    assert set(summary["realtime"]) == {"priority", "memory_locked"}
    assert "malformed" in err


def test_a_run_tells_which_settings_a_trial_chose_and_why(cell, addresses, tmp_path, capfd):
    cell.write_text(f'settings = "auto"\n{CELL}[monitor]\nrate = 50.0\n')
    record = tmp_path / "day.mcap"
    options = ["--duration", "0.1", "--no-realtime", "--json", "--premises"]
    options += ["--record", str(record)]
    assert main(["run", str(cell), *addresses, *options]) == 0
    told = capfd.readouterr().err
    kept = Recording(record).settings["choice"]
    assert kept["is_same"]
    for line in kept["reasons"][:3]:
        assert f"settings chosen: {line}\n" in told
    assert "cannot be told from the finest: its level in" in told
    for premise in Premise:
        assert f"premise: {premise.value}" in told
        assert told.index("verdicts at ") < told.index(premise.value)


def test_it_ends_with_the_parent_it_was_told_of(cell, addresses, tmp_path):
    script = """
import os, subprocess, sys
run = subprocess.Popen([*sys.argv[1:], "--parent", str(os.getpid())])
print(run.pid, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", script, ARMGUARD, "run", str(cell), *addresses]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as parent:
        pid = int(parent.stdout.readline())
        deadline = time.monotonic() + PATIENCE
        while not (tmp_path / "verdicts").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        parent.kill()
        while is_alive(pid):
            assert time.monotonic() < deadline
            time.sleep(0.05)
    assert not (tmp_path / "verdicts").exists()


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def check_no_reset(capsys, arguments, words):
    """A reset that was not obeyed is one line and exit code 1, and an object where one is asked."""
    assert main(arguments) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+: not reset: [^\n]+\n", err)
    assert words in err
    assert main([*arguments, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["obeyed"]
    assert words in told["problem"]


def test_a_reset_that_nobody_takes_or_answers_is_told_within_a_stated_time(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("armguard.app.run.REACH_TIMEOUT", 0.1)
    nobody = ["reset", f"ipc://{tmp_path}/nobody", "--token", "x"]
    check_no_reset(capsys, nobody, "no monitor listens there (waited 0.1 s)")
    check_mistake(capsys, ["reset", "tcp://10.0.0.1:5702", "--token", "x"], "tcp://10.0.0.1:5702")
    monkeypatch.setattr("armguard.app.run.REACH_TIMEOUT", 1.0)
    source = SocketInput(f"ipc://{tmp_path}/input")
    verdicts = f"ipc://{tmp_path}/verdicts"
    asked = ["reset", source.address, "--token", "x", "--verdicts", verdicts]
    with repeating(source.receive):
        check_no_reset(capsys, asked, f"no verdicts come from {verdicts} (waited 1 s)")
    publisher = VerdictPublisher(verdicts, 0.0)
    with repeating(source.receive, lambda: publisher.publish(NOTHING_KNOWN)):
        check_no_reset(capsys, asked, "did not answer (waited 1 s)")
    publisher.close()
    source.close()


NOTHING_KNOWN = Verdict(0.0, 1, Level.STOP, 0.0, 0.0, 0.0, None, None, False, 0, (), 0.0)


@contextlib.contextmanager
def repeating(*calls):
    """Inside, a thread makes these calls again and again, as the loop of a run does."""
    is_over = threading.Event()

    def repeat():
        while not is_over.wait(0.002):
            for call in calls:
                call()

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def test_a_reset_says_whether_it_was_obeyed(cell, addresses, tmp_path, capsys):
    verdicts = f"ipc://{tmp_path}/verdicts"
    options = ["--reset-token", "sesame", "--no-realtime", "--quiet", "--json", *addresses]
    with start("run", str(cell), *options) as run, VerdictReader(verdicts) as reader:
        try:
            assert reader.latest(PATIENCE) is not None
            for name in ("joints", "obstacles"):
                asked = ["reset", f"ipc://{tmp_path}/{name}", "--verdicts", verdicts, "--token"]
                check_no_reset(capsys, [*asked, "guess"], "token is not that of this run")
                assert main([*asked, "sesame"]) == 0
                assert capsys.readouterr() == (f"ipc://{tmp_path}/{name}: reset\n", "")
                assert main([*asked, "sesame", "--json"]) == 0
                assert json.loads(capsys.readouterr().out)["obeyed"] is True
            wrong_arm = [*asked, "sesame", "--arm", "left"]
            check_no_reset(capsys, wrong_arm, "arm is 'left'")
        finally:
            run.send_signal(signal.SIGINT)
            out, _ = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0
    assert json.loads(out)["faults"] == 6


def test_verdicts_are_expected_at_the_usual_port_of_the_same_host():
    assert find_verdicts_address("tcp://192.0.2.10:5702") == "tcp://192.0.2.10:5703"
    assert find_verdicts_address("ipc:///tmp/joints") == VERDICTS_ADDRESS


@pytest.mark.parametrize(
    ("joints", "obstacles", "token", "arm", "words"),
    [
        ("ipc:///a b", "ipc:///o", "x y", "", "it: armguard reset 'ipc:///a b' --token 'x y'"),
        ("-", "ipc:///o", "x", "left", "it: armguard reset ipc:///o --token x --arm left"),
        ("-", "-", "x", "", 'to end it: a line {"type":"reset","token":"x"}'),
        ("-", "-", "x", "left", 'a line {"type":"reset","token":"x","arm":"left"}'),
        ("ipc:///j", "-", None, "", "refuses resets: restart it; with --reset-token TOKEN "),
    ],
)
def test_the_remedy_is_a_command_that_can_be_copied(joints, obstacles, token, arm, words):
    addresses = {"joints": joints, "obstacles": obstacles, "verdicts": VERDICTS_ADDRESS}
    assert words in describe_remedy(addresses, token, arm=arm)


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]"])
def test_with_keys_the_remedy_names_them_and_a_host_that_is_one_elsewhere(host, monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "cell7")
    addresses = {
        "joints": f"tcp://{host}:5702",
        "obstacles": "tcp://0.0.0.0:5701",
        "verdicts": "tcp://0.0.0.0:5703",
    }
    assert describe_remedy(addresses, "x", has_keys=True) == (
        "to end it: armguard reset tcp://cell7:5702 --token x --key FILE --server-key FILE"
    )


class Node:
    """A controller that rests, and perception that sees a ball far away, in another process."""

    CODE = """
import sys, time
from armguard.streams import Publisher
kind, address = sys.argv[1:3]
q, v = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.0] * 7
names = [f"panda_joint{n}" for n in range(1, 8)]
with Publisher(address, "camera") as publisher:
    while True:
        now = time.monotonic()
        if kind == "joints":
            publisher.joints(now, names, q, v)
        else:
            publisher.update(["ball"], now, [[9.0, 0.0, 0.5]], [[0.0] * 3], radius=0.1)
        time.sleep(0.004)
"""

    def __init__(self, kind, address):
        self._command = [sys.executable, "-c", self.CODE, kind, address]
        self.process = subprocess.Popen(self._command)

    def restart(self):
        self.kill()
        self.process = subprocess.Popen(self._command)

    def kill(self):
        self.process.kill()
        self.process.wait()


def test_any_process_may_be_killed_and_started_again(tmp_path):
    """Only a controller that was away latches, and a reset ends it."""
    where = {name: f"ipc://{tmp_path}/{name}" for name in ("obstacles", "joints", "verdicts")}
    (tmp_path / "cell.toml").write_text(
        CELL
        + "[sources.camera]\ntimeout = 1.0\n[monitor]\nrate = 200.0\n"
        # A busy machine must not look like a process that has gone.
        + "[thresholds]\nlatency = 0.05\njoint_timeout = 1.0\n"
    )
    errors = tmp_path / "errors"
    command = [ARMGUARD, "run", str(tmp_path / "cell.toml"), "--reset-token", "sesame"]
    command += [word for name, address in where.items() for word in (f"--{name}", address)]

    def start_monitor():
        with errors.open("ab") as file:
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=file)

    def wait_for(text, before=0):
        deadline = time.monotonic() + PATIENCE
        while text not in errors.read_text()[before:]:
            assert time.monotonic() < deadline, errors.read_text()
            time.sleep(0.02)
        return len(errors.read_text())

    reader = VerdictReader(where["verdicts"])

    def wait_until_clear(after):
        deadline = time.monotonic() + PATIENCE
        while True:
            verdict = reader.latest(0.1)
            if verdict is not None and verdict.stamp > after and verdict.level is Level.CLEAR:
                return
            assert time.monotonic() < deadline, errors.read_text()

    monitor = start_monitor()
    controller, camera = Node("joints", where["joints"]), Node("obstacles", where["obstacles"])
    try:
        wait_until_clear(time.monotonic())
        place = len(errors.read_text())
        for address in where.values():
            assert f" at {address}\n" in errors.read_text()
        # Perception: silence is a STOP that ends by itself.
        camera.kill()
        wait_for("STOP  source silent: camera")
        camera.restart()
        wait_until_clear(time.monotonic())
        assert "latched" not in errors.read_text()[place:]
        # The controller: a gap, which is told with what ends it.
        controller.kill()
        place = wait_for("latched: gap in joint states")
        remedy = errors.read_text().split("to end it: armguard ")[1].split("\n")[0].split()
        # Reset before the controller is back: there is no joint state, and nothing latches anew.
        assert subprocess.run([ARMGUARD, *remedy], capture_output=True, check=False).returncode == 0
        place = wait_for("reset: nothing is latched", place - 1)
        controller.restart()
        wait_until_clear(time.monotonic())
        # The monitor under a live controller, and with it whoever reads verdicts, and perception:
        # what is sent meanwhile is not handed over, or it is dropped.
        monitor.kill()
        monitor.wait()
        reader.close()
        reader = VerdictReader(where["verdicts"])
        camera.restart()
        time.sleep(1.5)
        place = len(errors.read_text())
        monitor = start_monitor()
        wait_until_clear(time.monotonic())
        assert "latched:" not in errors.read_text()[place:]
        monitor.send_signal(signal.SIGINT)
        assert monitor.wait(PATIENCE) == 0
    finally:
        reader.close()
        for process in (monitor, controller.process, camera.process):
            process.kill()
            process.wait()
