"""The digest of a configuration changes with all that verdicts depend on, and with nothing else."""

import copy
import inspect
import itertools
import math
import random
import string

import msgspec
import numpy as np
import pinocchio
import pytest

import armguard
from armguard.exceptions import ArmguardError
from armguard.monitor.configuration import (
    LENGTH,
    describe_configuration,
    digest_configuration,
    digest_data,
    normalise,
)
from armguard.monitor.portable import FORMS
from armguard.obstacles import Obstacles, Source
from armguard.obstacles.obstacles import ObstacleSettings
from armguard.robot.portable import LIMITS, describe_robot
from armguard.scheduling import FullSchedule
from armguard.settings import Settings
from armguard.settings.contact_limits import ContactLimit
from armguard.settings.declarations import read_declarations
from support.eventful_runs import make_monitor as make_eventful
from support.panda_monitor import make_monitor


def digest_of(obstacles=None, **settings):
    """The digest of a monitor of a Panda."""
    obstacles = Obstacles() if obstacles is None else obstacles
    return digest_configuration(make_monitor(obstacles=obstacles, **settings)[1])


def list_leaves(data, path=()):
    """Places of all that is no list and no dictionary."""
    if isinstance(data, dict | list):
        pairs = data.items() if isinstance(data, dict) else enumerate(data)
        return [leaf for key, one in pairs for leaf in list_leaves(one, (*path, key))]
    return [path]


def find_place(data, path):
    for key in path[:-1]:
        data = data[key]
    return data, path[-1]


def shuffle(data, rng):
    """The same data, its keys in another order."""
    if isinstance(data, dict):
        items = [(key, shuffle(one, rng)) for key, one in data.items()]
        rng.shuffle(items)
        return dict(items)
    return [shuffle(one, rng) for one in data] if isinstance(data, list) else data


def change_value(value):
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return np.nextafter(value, math.inf).item() if math.isfinite(value) else 1.0
        case str():
            return value + "x"
        case None:
            return 0.5
    raise AssertionError(value)


def shorten(described):
    """The same with one link, as there are thousands of numbers in each."""
    del described["robot"]["links"][1:]
    link = described["robot"]["links"][0]
    del link["hull"][2:], link["cover"]["spheres"][2:]
    return described


@pytest.mark.hazard("H-10")
@pytest.mark.parametrize("motion", ["joint", "daa", "committed"])
def test_whatever_is_changed_changes_the_digest(motion):
    """Every number by its last bit, every word by a letter, every switch."""
    _, _, monitor = make_eventful(motion)
    data = shorten(describe_configuration(monitor, {"arm": "left", "rate": 2}))
    digest = digest_data(data)
    assert len(digest) == LENGTH
    assert set(digest) <= set(string.hexdigits)
    leaves = list_leaves(data)
    assert set(data) == {path[0] for path in leaves} | {"tethers", "exemptions"}
    seen = {digest}
    for path in leaves:
        place, key = find_place(data, path)
        before = place[key]
        place[key] = change_value(before)
        seen.add(digest_data(data))
        place[key] = before
    assert len(seen) == len(leaves) + 1 > 200


def test_order_of_keys_and_form_of_numbers_change_nothing():
    _, _, monitor = make_eventful("joint")
    digests = {digest_configuration(monitor, {"a": 1, "b": [2.0, 3]})}
    rng = random.Random(0)
    for cell in ({"b": [2, 3.0], "a": 1.0}, {"a": 1e0, "b": [2, 3]}):
        digests.add(digest_configuration(monitor, cell))
        digests.add(digest_data(shuffle(describe_configuration(monitor, cell), rng)))
    assert len(digests) == 1


def test_what_a_monitor_is_made_with_and_told_before_it_starts_counts():
    tethered = Obstacles()
    tethered.tether("elbow", "hand", 0.3, "measured")
    longer = Obstacles()
    longer.tether("elbow", "hand", 0.31, "measured")
    post, other = Obstacles(), Obstacles()
    post.add_static("post", [1.0, 0.0, 0.0], 0.1)
    other.add_static("post", [1.0, 0.0, 0.0], 0.11)
    door = Obstacles()
    door.add_entrance("post", [1.0, 0.0, 0.0], 0.1, 0.0, 1.0)
    digests = [
        digest_of(),
        digest_of(latency=0.003),
        digest_of(schedule="full"),
        digest_of(schedule="daa"),
        digest_of(payload=1.0),
        digest_of(operating=armguard.OperatingLimits(velocity=0.5)),
        digest_of(ignore=[("panda_hand", "post")]),
        *map(digest_of, (tethered, longer, post, other, door)),
        digest_of(Obstacles(speed=1.0)),
        digest_of(Obstacles(sources=["camera"])),
        digest_of(Obstacles(sources=[Source("camera", latency=0.01)])),
    ]
    _, monitor = make_monitor(obstacles=Obstacles())
    monitor.ignore("panda_hand", "post", until=5.0)
    digests.append(digest_configuration(monitor))
    assert len(set(digests)) == len(digests)
    assert digest_of() == digests[0]


OTHERS = {
    "operating": armguard.OperatingLimits(velocity=0.5),
    "base_placement": pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])),
    "contact_limits": armguard.ContactLimits({"hand": ContactLimit(speed=0.1, source="assumed")}),
    "separation": armguard.SeparationRule(),
    "ignore": (("panda_hand", "post"),),
    "schedule": "full",
    "motion": "isotropic",
    "leave": "any",
}
"""Another value of each setting that is no plain number or switch."""


@pytest.mark.parametrize("name", list(read_declarations(Settings)))
def test_every_setting_of_a_monitor_counts(name):
    """One that is added to the record is among these by itself."""
    _, monitor = make_monitor(obstacles=Obstacles())
    before = digest_configuration(monitor)
    settings = copy.copy(monitor.settings)
    value = OTHERS[name] if name in OTHERS else change_value(getattr(settings, name))
    assert value != getattr(settings, name)
    msgspec.structs.force_setattr(settings, name, value)
    monitor.settings = settings
    assert digest_configuration(monitor) != before


def test_every_attribute_of_what_settings_hold_and_of_a_robot_is_known():
    """One that is added must be described, or named here as one that verdicts do not rest on."""
    for kind, names in FORMS.items():
        if kind is not pinocchio.SE3:
            assert set(names) == set(inspect.signature(kind).parameters), kind
    table = inspect.signature(Obstacles).parameters
    assert set(ObstacleSettings._fields) == set(table)
    robot = armguard.Robot.load("panda")
    described = {"joints", "cover", "brakes", "published_operating_limits", *LIMITS}
    as_joints_and_links = {"model", "collision_model", "_bodies"}
    as_statics_of_another_arm, words = {"_fixed_points"}, {"name", "drawn_links", "_sources"}
    # The sensor's own share of `velocity_error`; shields read it, monitors do not.
    of_shields = {"rest_velocity_error"}
    known = described | as_joints_and_links | as_statics_of_another_arm | words | of_shields
    assert set(vars(robot)) == known
    assert described - {"cover"} <= set(describe_robot(robot))


def test_orders_that_mean_nothing_count_for_nothing():
    pairs = ("panda_hand", "x"), ("panda_link7", "y"), ("panda_hand", "y")
    found = set()
    for order in itertools.permutations(pairs):
        found.add(digest_of(ignore=order))
        _, monitor = make_monitor(obstacles=Obstacles())
        for pair in order:
            monitor.ignore(*pair, until=5.0)
        found.add(digest_configuration(monitor))
    assert len(found) == 2
    first, second = Obstacles(sources=["a", "b"]), Obstacles(sources=["b", "a"])
    first.add_static("x", [1.0, 0.0, 0.0], 0.1)
    for obstacles in (first, second):
        obstacles.add_static("y", [2.0, 0.0, 0.0], 0.1)
    second.add_static("x", [1.0, 0.0, 0.0], 0.1)
    first.tether("a", "b", 0.3, "one")
    first.tether("b", "c", 0.3, "one")
    second.tether("c", "b", 0.3, "another")
    second.tether("b", "a", 0.3, "another")
    assert digest_of(first) == digest_of(second)


def test_a_robot_counts_as_it_is():
    import coal

    robot = armguard.Robot.load("panda")
    digests = [digest_configuration(make_monitor(robot=robot, obstacles=Obstacles())[1])]
    robot.attach("gripper", "panda_hand", coal.Box(0.1, 0.1, 0.1))
    digests.append(digest_configuration(make_monitor(robot=robot, obstacles=Obstacles())[1]))
    robot = armguard.Robot.load("panda")
    robot.velocity_error = np.nextafter(robot.velocity_error, 1.0)
    digests.append(digest_configuration(make_monitor(robot=robot, obstacles=Obstacles())[1]))
    robot = armguard.Robot.load("panda", level=1)
    digests.append(digest_configuration(make_monitor(robot=robot, obstacles=Obstacles())[1]))
    assert len(set(digests)) == 4


def test_words_and_numbers_are_not_taken_for_each_other():
    values = [1, "1", "n0x1p+0", True, None, [1], {"1": 1}, "s1", -1, 2**60, 2**60 + 1]
    values += [math.inf, -math.inf, math.nan, 0.1, np.nextafter(0.1, 1.0).item()]
    assert len({repr(normalise(value)) for value in values}) == len(values)
    assert normalise({"a": (1, 2)}) == normalise({"a": [1.0, 2.0]})
    with pytest.raises(TypeError, match="no plain data"):
        normalise(object())


def test_a_schedule_of_the_applications_own_has_no_digest():
    class Own(FullSchedule):
        pass

    with pytest.raises(ArmguardError, match="Own of the application's own"):
        digest_of(schedule=Own())
