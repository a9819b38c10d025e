"""Rows of studies on real worker processes, of which one is killed while it measures.

ARMGUARD_CLUSTER=1 has a whole study run by workers too, and more of them killed: on two busy cores
that may take minutes.
"""

import logging
import multiprocessing
import os
import re
import signal
import threading

import pytest

from armguard.exceptions import ArmguardError
from armguard.lab import cluster
from armguard.lab.cluster import LOCAL, Cluster
from armguard.lab.extremes.rows import Extent, measure_line, measure_rows
from armguard.lab.rows import Here, Rows
from armguard.lab.tradeoff import study
from armguard.lab.tradeoff.covers import Covers
from armguard.lab.tradeoff.ladder import DEFAULT, FINEST
from armguard.lab.tradeoff.study import run_study
from support.slow_rows import (
    die,
    refuse,
    square,
    wait_then_measure,
    wait_then_square,
    within,
)
from support.tradeoff_cases import make_site, small_scene
from support.waiting import wait_until

pytest.importorskip("distributed", reason="Dask is not installed: the extra `cluster`")

PRICES = {"tick_p50", "tick_p99", "tick_max", "intake_p50", "core", "memory"}
"""Figures that are the machine's; all others are the same wherever they come from."""


DEADLINE = 240.0
"""For anything that workers do, in [s]: more than a slow machine needs, and than a row waits."""

at_length = pytest.mark.skipif(
    not os.environ.get("ARMGUARD_CLUSTER"), reason="takes long: for ARMGUARD_CLUSTER=1"
)


@pytest.fixture(scope="module")
def workers():
    before = set(multiprocessing.active_children())
    try:
        made = within(DEADLINE, Cluster, LOCAL, 2)
        yield made
        within(DEADLINE, made.close)
    finally:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()


def rows_of(place, folder=None, *, resume=False):
    return Rows(place, folder, {"study": "a test"}, resume=resume)


def measure(place, function, shared, numbers, folder=None):
    tasks = {f"row {number}": (number,) for number in numbers}
    rows = rows_of(place, folder)
    return within(DEADLINE, rows.measure, function, shared, tasks, "rows", lambda *told: None)


class Watched:
    """The workers, and a hand that kills the first that is in the midst of a row.

    Args:
        place: The workers.
        folder: In which rows say that they have begun.
    """

    def __init__(self, place, folder):
        self.place, self.folder, self.killed, self.is_over = place, folder, None, False

    def run(self, function, shared, tasks):
        hand = threading.Thread(target=wait_until, args=(self.watch,))
        hand.start()
        try:
            yield from self.place.run(function, shared, tasks)
        finally:
            self.is_over = True
            hand.join()

    def watch(self):
        begun = [path.name.split("-")[2] for path in self.folder.glob("begun-*")]
        if begun:
            self.killed = int(begun[0])
            os.kill(self.killed, signal.SIGKILL)
            (self.folder / "go").touch()
        return self.is_over or self.killed is not None


def test_a_killed_workers_rows_are_measured_by_another_and_are_the_same(workers, tmp_path):
    extent, place = Extent(0, 2), Watched(workers, tmp_path)
    alone = [measure_line(extent, "evaluation", number)["line"] for number in range(4)]
    found, is_whole = measure(place, wait_then_measure, (str(tmp_path), extent), range(4))
    assert is_whole
    lines = [row["line"] for row in found.values()]
    # A price is the machine's.
    plain = [[repr(line | {"price": None}) for line in some] for some in (lines, alone)]
    assert plain[0] == plain[1]
    assert place.killed is not None
    assert place.killed not in {row["process"] for row in found.values()}
    assert all(row["machine"] for row in found.values())
    # What the killed one had begun was begun once more, by another process.
    begun = [path.name.split("-")[1:] for path in tmp_path.glob("begun-*")]
    (again,) = {number for number, process in begun if int(process) == place.killed}
    assert len([number for number, _ in begun if number == again]) >= 2


def test_ctrl_c_in_a_terminal_is_not_for_the_workers(workers):
    handlers = within(DEADLINE, workers.client.run, signal.getsignal, signal.SIGINT)
    assert set(handlers.values()) == {signal.SIG_IGN}


def compare(outcomes):
    return {
        one.setting.name: one.figures
        and {
            name: repr(value) for name, value in one.figures._asdict().items() if name not in PRICES
        }
        for one in outcomes
    }


@at_length
def test_a_study_is_the_same_with_workers_of_which_one_is_killed(workers, tmp_path, monkeypatch):
    monkeypatch.setattr(study, "MOMENTS", 1)
    site, scene = make_site(rate=100.0), small_scene(0.2)
    before = set(workers.client.run(os.getpid).values())
    told, killed = [], []

    def tell(text, share):
        told.append(text)
        if text.startswith("axes: ") and not killed:
            # The first row is there, and others are being measured.
            busy = wait_for_busy(workers)
            killed.append(workers.client.run(os.getpid, workers=[busy])[busy])
            os.kill(killed[0], signal.SIGKILL)

    rows = rows_of(workers, tmp_path)
    given = site, scene, ("budget",), 0, Covers(site.robot), tell
    spread = within(3.0 * DEADLINE, run_study, *given, rows)
    alone = run_study(
        site, scene, ("budget",), 0, Covers(site.robot), lambda *told: None, rows_of(Here()),
        in_turns=True,
    )  # fmt: skip
    assert killed
    assert killed[0] in before
    one, other = compare(spread.outcomes), compare(alone.outcomes)
    # Combinations are chosen by their prices, which are the machine's.
    names = [name for name in other if " + " not in name]
    assert names[:2] == [DEFAULT, FINEST]
    assert [name for name in one if " + " not in name] == names
    assert [one[name] for name in names] == [other[name] for name in names]
    assert (spread.contacts, spread.hunted) == (alone.contacts, alone.hunted)
    assert spread.interrupted == alone.interrupted == ""
    assert spread.seconds == alone.seconds
    for name in (DEFAULT, FINEST):
        for mine, yours in zip(spread.tracks[name], alone.tracks[name], strict=True):
            assert mine.dtype == yours.dtype
        for field in ("time", "evaluated", "level", "contact_time", "stop_time", "pace"):
            mine, yours = (getattr(found.tracks[name], field) for found in (spread, alone))
            assert mine.tobytes() == yours.tobytes(), field
    assert all(re.fullmatch(r".+ \(.+\)", one.machine) for one in spread.outcomes)

    # An ended study goes on with what there is: nothing is measured again.
    class Nowhere:
        def run(self, function, shared, tasks):
            assert not tasks
            return iter(())

    rows = rows_of(Nowhere(), tmp_path, resume=True)
    again = run_study(site, scene, ("budget",), 0, Covers(site.robot), lambda *told: None, rows)
    assert repr(again.outcomes) == repr(spread.outcomes)
    assert rows.resumed == len(spread.outcomes)


def wait_for_busy(workers):
    """The address of a worker that is measuring."""
    found = []

    def is_busy():
        found[:] = [address for address, keys in workers.client.processing().items() if keys]
        return bool(found)

    wait_until(is_busy)
    return found[0]


@at_length
def test_lines_of_extremes_are_the_same(workers):
    extent, tell = Extent(0, 2), lambda *told: None

    def only_few(rows):
        """Of all, as ticks take most of the time."""
        measure = rows.measure
        rows.measure = lambda function, shared, tasks, *rest: measure(
            function, shared, dict(list(tasks.items())[:4]), *rest
        )
        return rows

    spread, _ = within(DEADLINE, measure_rows, extent, only_few(rows_of(workers)), tell)
    alone, _ = measure_rows(extent, only_few(rows_of(Here())), tell)
    plain = [[repr(line._replace(price=0.0)) for line in lines] for lines in (spread, alone)]
    assert plain[0] == plain[1]
    assert all(line.machine for line in spread)


@at_length
def test_a_row_that_takes_workers_down_is_named(workers):
    with pytest.raises(ArmguardError, match="row 'row 7': took several workers down"):
        measure(workers, die, 0, [7])
    # The others go on.
    assert measure(workers, square, 1, [3])[0]["row 3"]["square"] == 9


def test_a_mistake_of_a_row_is_told_with_its_machine(workers):
    with pytest.raises(ArmguardError, match=r"worker on .+: the row: cannot be measured"):
        measure(workers, refuse, 0, [1])


def test_a_worker_with_other_software_measures_nothing(workers, monkeypatch):
    known = cluster.describe_software()
    monkeypatch.setattr(cluster, "describe_software", lambda: known | {"sources": "others"})
    with pytest.raises(ArmguardError, match=r"has another sources: .+ was started with others"):
        measure(workers, square, 0, [1])


@at_length
def test_a_scheduler_that_is_gone_is_told(tmp_path):
    from distributed import LocalCluster

    lost = LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )  # fmt: skip

    def lose():
        wait_until(lambda: list(tmp_path.glob("begun-*")))
        lost.close()

    with Cluster(lost.scheduler_address) as place:
        hand = threading.Thread(target=lose)
        hand.start()
        with pytest.raises(ArmguardError, match="--dask: the scheduler is gone; what was measured"):
            measure(place, wait_then_square, str(tmp_path), range(2))
        hand.join()


def test_where_nothing_answers_is_told(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.2)
    with pytest.raises(ArmguardError, match=r"--dask: no scheduler answers at 'tcp://127.0.0.1:9'"):
        Cluster("tcp://127.0.0.1:9")


@pytest.mark.parametrize("address", ["bogus://x", "tcp://", "tcp://x:abc", "no where", ""])
def test_an_address_that_is_none_is_told_without_asking_anyone(address, monkeypatch):
    monkeypatch.setattr("distributed.Client", None)
    with pytest.raises(ArmguardError, match=f"no scheduler answers at '{address}' .*; expected an"):
        Cluster(address)


@pytest.mark.parametrize(
    ("address", "count", "words"),
    [
        (LOCAL, 0, "--workers: is 0; expected 1 or more"),
        ("tcp://127.0.0.1:9", 2, "--workers: goes with a cluster on this machine"),
    ],
)
def test_mistakes_are_told_before_anything_starts(address, count, words):
    with pytest.raises(ArmguardError, match=words):
        Cluster(address, count)


def test_without_dask_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ArmguardError, match=r"needs Dask.*armguard\[cluster\]"):
        Cluster(LOCAL)
