"""The processes that stand for a camera and a robot, each alone with a monitor of the test's."""

import time

import msgspec
import numpy as np
import pytest

from armguard.lab.faults import nodes
from armguard.lab.faults.disturbance import Disturbance
from armguard.lab.faults.scene import make_trajectory, sample_people, visit_period
from armguard.lab.simulation.processes import start_device
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage, decode
from armguard.streams import SocketInput, VerdictPublisher
from armguard.verdict import Level
from support.verdict_samples import verdict
from support.waiting import wait_until

PATIENCE = 60.0
JOINTS = 7


@pytest.fixture
def start(tmp_path):
    """Starts nodes that end with the test."""
    running = []

    def start_node(node):
        running.append(start_device(node, log, takes_orders=True))
        return running[-1]

    with (tmp_path / "log").open("wb") as log:
        yield start_node
        for process in running:
            process.kill()
            process.communicate()
    assert (tmp_path / "log").read_text() == ""


def read(path):
    return nodes.read_rows(path, JOINTS) if path.exists() else np.zeros((0, 3 + 2 * JOINTS))


def test_rows_are_read_whole_or_not_at_all(tmp_path):
    path = tmp_path / "truth"
    rows = np.arange(3.0 * nodes.row_width(2)).reshape(3, -1)
    path.write_bytes(rows.tobytes()[:-8])
    assert nodes.read_rows(path, 2).tolist() == rows[:2].tolist()
    assert nodes.read_rows(path, 2, first=1).tolist() == rows[1:2].tolist()


def test_drives_go_by_verdicts_and_by_their_deadlines(tmp_path, start):
    path = tmp_path / "truth"
    publisher = VerdictPublisher(f"ipc://{tmp_path}/verdicts", 0.0)
    start(nodes.Drives(verdicts=publisher.address, truth=str(path)))
    wait_until(lambda: len(read(path)))
    assert not read(path)[:, -JOINTS:].any(), "nothing was heard yet"
    valid_until = 0.0

    def is_moving():
        nonlocal valid_until
        valid_until = time.monotonic() + 0.2
        publisher.publish(verdict(Level.AWARE, speed_scale=1.0, valid_until=valid_until))
        return np.abs(read(path)[-1, -JOINTS:]).max() > 0.3

    wait_until(is_moving)
    wait_until(lambda: len(read(path)) and read(path)[-1, 0] > valid_until + 1.0)
    publisher.close()
    rows = read(path)
    late = rows[rows[:, 0] > valid_until]
    assert not late[:, 1].any(), "a verdict that has expired lets nothing move on"
    assert late[:, 2].all()
    assert not late[-1, -JOINTS:].any()
    speed = np.abs(late[:, -JOINTS:])
    assert (np.diff(speed, axis=0) <= 1e-12).all(), "brakes stay on until the arm rests"
    assert np.diff(rows[:, 0]) == pytest.approx(nodes.STEP)
    ways = np.diff(rows[:, 3 : 3 + JOINTS], axis=0)
    assert ways == pytest.approx(rows[1:, -JOINTS:] * nodes.STEP, abs=1e-4)


def receive(source, condition):
    """The first message that fits."""
    deadline = time.monotonic() + PATIENCE
    while True:
        assert time.monotonic() < deadline
        data = source.receive()
        if data is None:
            time.sleep(0.001)
        elif condition(message := decode(data)):
            return message


def order(process, **options):
    now = time.monotonic()
    disturbance = Disturbance(begin=now, **({"end": now + PATIENCE} | options))
    process.stdin.write(msgspec.json.encode(disturbance) + b"\n")
    process.stdin.flush()


def test_a_driver_tells_what_the_drives_do_until_it_is_disturbed(tmp_path, start):
    path = tmp_path / "truth"
    source = SocketInput(f"ipc://{tmp_path}/joints")
    driver = start(nodes.Driver(joints=source.address, truth=str(path)))
    row = [5.0, 1.0, 0.0, *range(14)]
    path.write_bytes(np.array([[0.0] * 17, row]).tobytes())
    message = receive(source, lambda message: True)
    assert message.stamp == 5.0
    assert np.frombuffer(message.q).tolist() == row[3:10]
    assert np.frombuffer(message.v).tolist() == row[10:]
    order(driver, kind="clock", value="3")
    assert receive(source, lambda message: message.stamp != 5.0).stamp == 8.0
    source.close()


def test_a_camera_tells_where_the_people_are_and_what_a_disturbance_adds(tmp_path, start):
    source = SocketInput(f"ipc://{tmp_path}/obstacles")
    begin = time.monotonic()
    camera = start(nodes.Camera(obstacles=source.address, start=begin))
    message = receive(source, lambda message: True)
    period = visit_period(make_trajectory(nodes.Robot.load("panda")))
    expected = sample_people(message.stamp - begin, period)
    for field, values in zip(("position", "velocity"), expected, strict=True):
        assert np.frombuffer(getattr(message, field)) == pytest.approx(values.ravel())
    order(camera, kind="static", end=time.monotonic() + 1.0)
    receive(source, lambda message: message.ids == ["pillar"])
    removal = receive(source, lambda message: isinstance(message, RemoveMessage))
    assert removal.ids == ["pillar"], "afterwards it is gone"
    order(camera, kind="crowd", value="30", field="20", end=time.monotonic() + 1.0)
    sizes = [
        len(receive(source, lambda message: "crowd" in str(message.ids)).ids) for _ in range(2)
    ]
    assert sizes == [20, 10]
    assert len(receive(source, lambda message: isinstance(message, RemoveMessage)).ids) == 30
    order(camera, kind="flood", value="5000")
    heartbeat = receive(source, lambda message: not message.ids)
    assert isinstance(heartbeat, ObstaclesMessage)
    assert heartbeat.seq is None
    source.close()
