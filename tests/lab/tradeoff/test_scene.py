import numpy as np
import pinocchio
import pytest

from armguard.lab.tradeoff.scene import CLEARANCE, find_published, make_scene
from armguard.robot.operating_limits import OperatingLimits
from support.tradeoff_cases import make_site


def test_a_seed_makes_the_same_scene_again():
    scenes = [make_scene(make_site(), None, 2, 1.5, seed)[0] for seed in (3, 3, 4)]
    told = [
        [(message.stamp, message.position.tobytes()) for message in scene.messages]
        for scene in scenes
    ]
    assert told[0] == told[1] != told[2]
    ways = [np.concatenate(scene.sample(1.0)) for scene in scenes]
    assert (ways[0] == ways[1]).all()
    assert (ways[0] != ways[2]).any()


def test_messages_are_in_order_and_within_the_scene():
    scene, what = make_scene(make_site(), None, 0, 2.0, 0)
    stamps = [message.stamp for message in scene.messages]
    assert stamps == sorted(stamps)
    assert -1e-8 <= stamps[0] < 0.02
    assert stamps[-1] <= 2.0
    assert what == "a simulated person"
    # The middle of the visit: the person is at the arm.
    nearest = min(np.linalg.norm(m.position, axis=2).min() for m in scene.messages if m.ids)
    assert nearest < 0.8


def test_balls_keep_their_distance_and_say_so():
    scene, what = make_scene(make_site(), None, 20, 1.0, 0)
    places = np.concatenate([message.position[:, 0] for message in scene.messages])
    assert np.hypot(*places.T[:2]).min() >= CLEARANCE
    assert what == "20 balls from 1 m on"


def test_all_is_placed_as_the_base_is():
    turn = pinocchio.SE3(pinocchio.utils.rotate("z", 0.7), np.array([3.0, -2.0, 0.5]))
    here, there = (
        make_scene(site, None, 0, 1.0, 0)[0]
        for site in (make_site(), make_site(base_placement=turn))
    )
    for one, other in zip(here.messages, there.messages, strict=True):
        moved = one.position @ turn.rotation.T + turn.translation
        np.testing.assert_allclose(other.position, moved, atol=1e-12)
        np.testing.assert_allclose(other.velocity, one.velocity @ turn.rotation.T, atol=1e-12)


def test_sources_that_must_be_heard_are_heard():
    site = make_site()._replace(sources=("eye", "ear"))
    scene, _ = make_scene(site, None, 2, 1.0, 0)
    assert {message.source for message in scene.messages} == {"eye", "ear"}
    beats = [message.stamp for message in scene.messages if message.source == "ear"]
    assert np.diff(beats).max() < 0.2
    assert beats[0] == 0.0


@pytest.mark.parametrize("stated", [None, OperatingLimits(velocity=0.3, acceleration=1.0)])
def test_the_arm_keeps_to_published_limits_and_to_stated_ones(stated):
    site = make_site() if stated is None else make_site(operating=stated)
    scene, _ = make_scene(site, None, 1, 4.0, 0)
    kept = [find_published(site.robot), *([stated] if stated else [])]
    times = np.linspace(0.0, 4.0, 4001)
    v = np.array([scene.sample(time)[1] for time in times])
    for limits in kept:
        velocity, acceleration = limits.resolve(site.robot)
        assert (np.abs(v) <= velocity).all()
        assert (np.abs(np.diff(v, axis=0)) <= acceleration * 1e-3 * (1.0 + 1e-6)).all()
