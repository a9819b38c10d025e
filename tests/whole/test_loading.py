"""A process loads only what its scene requires, and a running cell loads nothing more."""

import json
import subprocess
import sys
import time
from pathlib import Path

from armguard.streams import VerdictReader

ROOT = Path(__file__).parents[2]
PATIENCE = 300.0  # a cold start compiles

NOT_LOADED = (
    # whole wings
    "armguard.bridges",
    "armguard.drivers",
    "armguard.gymnasium",
    "armguard.lab",
    "armguard.recording",
    # what makes and proves a cover, and other formats of it
    "armguard.cover.containment",
    "armguard.cover.fitting",
    "armguard.cover.inflation",
    "armguard.cover.interchange",
    "armguard.cover.report",
    "armguard.cover.signed_distance",
    "armguard.robot.mjcf",
    # tools and held parts
    "armguard.robot.attachments",
    # motion="planned", and other arms
    "armguard.bounds.planned",
    "armguard.monitor.committed_pieces",
    "armguard.pairs.arm_obstacles",
    "armguard.pairs.shared_plan",
    # schedules of pairs
    "armguard.scheduling.pair_scheduler",
    "armguard.scheduling.paper.daa",
    "armguard.scheduling.paper.full",
    # what verdicts can carry beside their own answer
    "armguard.contact.arguments",
    "armguard.contact.certificate",
    "armguard.contact.earliest",
    "armguard.messages.proof",
    "armguard.monitor.proof",
    "armguard.pairs.proof",
    "armguard.pairs.separation",
    "armguard.pairs.separation_margin",
    "armguard.pairs.separations",
    # people's joints
    "armguard.people.proportions",
    "armguard.people.skeleton",
    # clouds
    "armguard.pairs.cloud_filter",
    # questions between ticks
    "armguard.monitor.avoidable",
    "armguard.monitor.explain",
    "armguard.monitor.headroom",
    "armguard.monitor.what_if",
    "armguard.pairs.hull_distance",
)

HEAVY = ("gymnasium", "mcap", "meshcat", "mujoco", "tornado")
"""Libraries of others: the page's server, recordings, studies, bridges."""

VIEW = ("armguard.app.view_feed", "armguard.robot.portable", "armguard.view.messages")
"""What feeds a view, where there is one."""

PLAIN_MONITOR = """
import sys
import armguard
robot = armguard.Robot.load("panda")
obstacles = armguard.Obstacles()
monitor = armguard.Monitor(robot, obstacles)
obstacles.update(["hand"], 10.0, [[2.0, 0.0, 0.6]], radius=0.1)
assert monitor.step(10.0, [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.0] * 7).complete
print(*sorted(sys.modules))
"""

RUN = """
import sys
from armguard.app.cli import main
from armguard.monitor.monitor import Monitor
step, loaded = Monitor.step, []
def first_step(self, *arguments):
    if not loaded:
        loaded.extend(sorted(sys.modules))
    return step(self, *arguments)
Monitor.step = first_step
code = main(sys.argv[1:])
print(*loaded)
print(*sorted(set(sys.modules) - set(loaded)))
sys.exit(code)
"""

NAMES = [f"panda_joint{number}" for number in range(1, 8)]
TICKS = 300
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


def find_unneeded(loaded):
    wings = tuple(f"{name}." for name in NOT_LOADED)
    return [name for name in loaded if name in NOT_LOADED or name.startswith(wings)]


def test_the_list_names_modules_that_are_there():
    for name in NOT_LOADED:
        path = ROOT.joinpath(*name.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file(), name


def test_a_plain_monitor_loads_only_what_it_needs():
    told = subprocess.run([sys.executable, "-c", PLAIN_MONITOR], capture_output=True, text=True)
    loaded = told.stdout.split()
    assert "armguard.monitor.monitor" in loaded, told.stderr
    assert find_unneeded(loaded) == []
    beside = ("armguard.app", "armguard.streams", "armguard.view", "armguard.people")
    assert [name for name in loaded if name.startswith(beside)] == []


def test_a_cell_without_a_view_loads_no_feed():
    told = subprocess.run(
        [sys.executable, "-c", "import armguard.app.run, sys; print(*sorted(sys.modules))"],
        capture_output=True,
        text=True,
    )
    loaded = told.stdout.split()
    assert "armguard.app.run" in loaded, told.stderr
    assert not set(VIEW) & {*loaded}


def test_a_running_cell_loads_nothing_after_its_first_tick(tmp_path):
    verdicts = f"ipc://{tmp_path}/verdicts"
    command = [sys.executable, "-c", RUN, "run", str(ROOT / "demos" / "cell.toml")]
    options = ["--obstacles", "-", "--verdicts", verdicts, "--view", f"ipc://{tmp_path}/view"]
    options += ["--reset-token", "x", "--no-realtime", "--quiet", "--json"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with (
        subprocess.Popen([*command, *options], text=True, **pipes) as run,
        VerdictReader(verdicts) as reader,
    ):
        deadline, ticks = time.monotonic() + PATIENCE, 0
        while ticks < TICKS:
            assert run.poll() is None, run.communicate()
            assert time.monotonic() < deadline
            run.stdin.write("".join(f"{line}\n" for line in list_lines(ticks)))
            run.stdin.flush()
            time.sleep(0.01)
            # The day begins once the monitor is there.
            ticks += ticks > 0 or reader.latest() is not None
        out, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, err
    *summary, loaded, later = out.splitlines()
    assert {"STOP", "SLOW", "CLEAR"} <= json.loads("".join(summary))["levels"].keys()
    assert find_unneeded(loaded.split()) == []
    assert not set(HEAVY) & {*loaded.split(), *later.split()}
    assert [name for name in later.split() if name.startswith("armguard")] == []


def list_lines(tick):
    """What is told in one tick: an arm at rest, a hand that comes near, and much that is wrong."""
    now = time.monotonic()
    q = [*READY]
    if 200 <= tick < 210:
        q[0] = 1.0  # no arm gets there so fast: a STOP until a reset
    hand = {"ids": ["left_hand"], "position": [[2.0 - 0.005 * tick, 0.0, 0.6]], "radius": 0.1}
    lines = [
        {"type": "joints", "stamp": now, "names": NAMES, "q": q, "v": [0.0] * 7},
        {"type": "obstacles", "source": "camera", "stamp": now, **hand},
    ]
    if tick == 220:
        lines.append({"type": "reset", "token": "x"})
    if tick == 230:
        lines.append({"type": "plan", "number": 1, "stamp": now})
    if tick == 240:
        lines.append({"type": "cloud", "stamp": now, "origin": [0.0] * 3})
    return [*map(json.dumps, lines), *(["nonsense"] if tick % 50 == 0 else [])]
