import msgspec
import numpy as np
import pytest

from armguard.lab.commission.findings import commission
from armguard.lab.commission.lines import (
    quote_key,
    round_down,
    round_up,
    write_cell_lines,
    write_robot_lines,
)
from armguard.robot.brakes import BrakeEntry, Brakes
from armguard.robot.description import read_description
from support.commissioned_arms import Arm, sample


def find(stops, braking=4.0):
    seen = sample(Arm([1.0], [3.0], [braking], 0.03), stops, 4.0)
    seen.robot.lower_position_limit = np.array([-3.0])
    seen.robot.position_error = np.array([1e-3])
    seen.robot.velocity_error = np.array([1e-9])
    seen.robot.upper_position_limit = np.array([np.inf])
    entry = BrakeEntry(2.0, 1.5, np.inf, np.inf, 3.5, 'the "maker"')
    seen.robot.brakes = Brakes(seen.robot.joints, {"joint0": [entry]})
    return commission(seen)


def test_figures_are_rounded_to_the_safe_side():
    random = np.random.default_rng(0)
    for value in 10.0 ** random.uniform(-6, 4, 1000):
        assert value <= round_up(value) <= value * 1.0011
        assert value * 0.9989 <= round_down(value) <= value
    assert round_up(0.0) == round_down(0.0) == 0.0


@pytest.mark.parametrize("name", ["a", "a b", 'say "a"', "back\\slash", "ü"])
def test_any_name_is_a_key(name):
    assert msgspec.toml.decode(f"{quote_key(name)} = 1") == {name: 1}


def test_latency_and_reaction_time_sum_to_what_was_found():
    found = find([0.6, 2.2])
    thresholds = msgspec.toml.decode(write_cell_lines(found))["thresholds"]
    assert thresholds["latency"] == found.seen.latency
    assert sum(thresholds.values()) >= found.response
    assert sum(thresholds.values()) <= 1.01 * found.response


def test_without_a_stop_the_lines_keep_what_was_known_and_say_so():
    found = find([])
    assert "thresholds" not in msgspec.toml.decode(write_cell_lines(found))
    text = write_robot_lines(found)
    (entry,) = read_description(msgspec.toml.decode(text)).brake_entries()["joint0"]
    assert (entry.load, entry.speed, entry.deceleration) == (2.0, 1.5, 3.5)
    assert "not found" in entry.source


def test_an_arm_that_brakes_harder_than_its_limit_is_stated_no_harder():
    found = find([0.6, 2.2], braking=15.0)
    text = write_robot_lines(found)
    (entry,) = read_description(msgspec.toml.decode(text)).brake_entries()["joint0"]
    assert entry.deceleration <= 15.0
    assert "position" not in msgspec.toml.decode(text)["joints"]["joint0"]


def test_no_error_is_stated_to_be_smaller_than_it_was():
    found = find([0.6])
    worse = found.errors["joint0"]._replace(position=1e-4, velocity=0.0123)
    text = write_robot_lines(found._replace(errors={"joint0": worse}))
    joint = read_description(msgspec.toml.decode(text)).joints["joint0"]
    assert (joint.position_error, joint.velocity_error) == (1e-3, 0.0123)


def test_an_acceleration_that_was_not_found_is_told_by_name_beside_its_limit():
    found = find([0.6])
    assert "# within 1 ms; shorter accelerations may be missed" in write_cell_lines(found)
    hidden = found.limits["joint0"]._replace(acceleration=np.nan)
    text = write_cell_lines(found._replace(limits={"joint0": hidden}))
    assert "acceleration = [15.0] # not found, so the joint's limit is used: joint0" in text
