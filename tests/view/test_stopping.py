import msgspec
import numpy as np
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.app.view_feed import make_scene
from armguard.bounds.braking import BrakingMotion
from armguard.exceptions import ArmguardError
from armguard.view.messages import Origin
from armguard.view.stopping import StoppingVolume
from support.view_samples import Q, make_frame
from support.view_samples import make_scene as make_plain_scene

V = (0.3, -0.2, 0.1, 0.4, 0.0, -0.3, 0.2)


@pytest.fixture(scope="module")
def monitor():
    return Monitor(Robot.load("panda"), Obstacles(sources=[]), operating="published")


def test_the_volume_is_that_of_the_monitors_own_arm(monitor):
    scene = make_scene(monitor, Origin())
    found = StoppingVolume(scene).compute(make_frame(q=Q, v=V, arm_age=0.001))
    settings = monitor.settings
    motion = BrakingMotion(monitor.robot, settings.reaction_time, operating=settings.operating)
    expected = motion.stopping_volume(Q, V, 0.001, settings.response_time)
    leaves = np.concatenate(
        [monitor.robot.cover.tree(link).child_count == 0 for link in monitor.robot.links]
    )
    assert np.allclose(found, expected[leaves], atol=1e-9)


def test_what_the_scene_or_the_frame_does_not_tell_is_named(monitor):
    with pytest.raises(ArmguardError, match="does not send"):
        StoppingVolume(make_plain_scene())
    volume = StoppingVolume(make_scene(monitor, Origin()))
    with pytest.raises(ArmguardError, match="velocities"):
        volume.compute(make_frame(q=Q))
    scene = make_scene(monitor, Origin())
    rule = msgspec.structs.replace(scene.stopping, robot=b"{")
    with pytest.raises(ArmguardError, match="robot of the scene"):
        StoppingVolume(msgspec.structs.replace(scene, stopping=rule))
