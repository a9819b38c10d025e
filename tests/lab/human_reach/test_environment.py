"""HumanReach is what Gymnasium expects, and beside its person a shielded arm touches nobody."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from armguard.exceptions import ArmguardError
from armguard.gymnasium import ShieldedEnv
from armguard.lab.human_reach.environment import EPISODE, PLACES, HumanReach
from armguard.lab.simulation.bodies import POINTS
from armguard.obstacles import Obstacles
from support.checking_sink import GrowthSink

NAME = "armguard/HumanReach-v0"


@pytest.fixture(scope="module")
def env():
    return gymnasium.make(NAME)


def reach(env, seen):
    """Towards where the gripper is to go, by the true Jacobian of the arm."""
    inner = env.unwrapped
    q = seen[:7].astype(float)
    steps = [inner.find_gripper(q + 1e-4 * unit) for unit in np.eye(7)]
    jacobian = (np.array(steps) - inner.find_gripper(q)).T / 1e-4
    way = 2.0 * (seen[17:20] - seen[14:17])
    asked = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 0.01 * np.eye(3), way)
    return (asked / max(1.0, np.abs(asked).max())).astype(np.float32)


def write_recording(path, seed):
    """A person of markers that jump and vanish, as Vicon's software exports it."""
    random = np.random.default_rng(seed)
    places = np.cumsum(random.normal(0.0, 10.0, (1100, 9, 3)), axis=0)  # [mm]
    places[random.random((1100, 9)) < 0.01] += 2000.0
    lines = [
        "Objects",
        "100",
        ",," + ",,,,,,".join(f"Global Angle {name}:{name}" for name in POINTS) + ",,,,,",
        "Frame,Sub Frame" + ",RX,RY,RZ,TX,TY,TZ" * 9,
        "," + ",rad,rad,rad,mm,mm,mm" * 9,
    ]
    for frame, points in enumerate(places):
        seen = random.random(9) > 0.02
        cells = [
            f",0,0,0,{x},{y},{z}" if one else ",,,,,,"
            for (x, y, z), one in zip(points, seen, strict=True)
        ]
        lines.append(f"{frame},0" + "".join(cells))
    path.write_text("\n".join(lines))


def play(env, seed, steps, policy):
    seen, info = env.reset(seed=seed)
    told = [seen, info]
    for _ in range(steps):
        seen, reward, terminated, truncated, info = env.step(policy(env, seen))
        told += [seen, reward, terminated, truncated, info]
    return told


def test_the_checker_of_environments_finds_nothing():
    check_env(gymnasium.make(NAME, disable_env_checker=True).unwrapped)


def test_an_episode_is_as_long_as_a_visit_and_takes_no_nonsense(env):
    assert env.spec.max_episode_steps * HumanReach.period == pytest.approx(EPISODE)
    env.reset(seed=0)
    with pytest.raises(ArmguardError, match="action"):
        env.step(np.full(7, np.nan, np.float32))


@pytest.mark.parametrize("shielded", [False, True])
def test_the_same_seed_gives_the_same_steps_to_the_bit(env, shielded):
    tried = ShieldedEnv(env) if shielded else env
    first = play(tried, 3, 120, reach)
    play(tried, 4, 30, reach)
    fresh = gymnasium.make(NAME)
    other = ShieldedEnv(fresh) if shielded else fresh
    for again in (play(tried, 3, 120, reach), play(other, 3, 120, reach)):
        for one, two in zip(first, again, strict=True):
            np.testing.assert_equal(one, two)
    assert not np.array_equal(play(tried, 4, 1, reach)[0], first[0])


def test_an_arm_touches_its_person_and_with_a_shield_it_does_not():
    env = HumanReach()
    counts = {}
    for name, tried in (("free", env), ("shielded", ShieldedEnv(env))):
        ends = [play(tried, seed, 400, reach)[-1] for seed in range(2)]
        counts[name] = sum(end["contacts"] for end in ends)
        assert all(end["placed"] > 0 for end in ends)
    assert counts["free"] > 0, "else there is nothing to be kept from"
    assert counts["shielded"] == 0


def test_rewards_are_what_the_page_says(env):
    told = play(env, 0, 200, reach)
    seen, rewards, infos = told[7::5], told[3::5], told[6::5]
    before = told[0]
    carried = 0.0
    for after, reward, info in zip([told[2], *seen], rewards, infos, strict=False):
        way = [np.linalg.norm(PLACES[int(before[20])] - one[14:17]) for one in (before, after)]
        expected = 10.0 * (way[0] - way[1]) + 5.0 * (before[20] != after[20])
        expected -= 5.0 * (info["contacts"] - carried)
        assert reward == pytest.approx(expected, abs=1e-4)
        before, carried = after, info["contacts"]
    assert sum(rewards) > 10.0


def test_the_person_is_told_as_moving_within_the_bounds_of_a_table(env):
    sink, table = GrowthSink(), Obstacles()
    env.reset(seed=7)
    for step in range(500):
        for taker in (sink, table):
            env.unwrapped.publish(taker, 0.02 * step)
        env.step(np.zeros(7, np.float32))
    assert not sink.refused
    assert len(table) == 10
    assert table.take_faults() == []


def test_recorded_people_are_drawn_and_keep_the_bounds(tmp_path):
    write_recording(tmp_path / "one.csv", 0)
    write_recording(tmp_path / "two.csv", 1)
    env = HumanReach(recordings=tmp_path)
    seen = [env.reset(seed=seed)[0][21:48] for seed in range(8)]
    assert len({one.tobytes() for one in seen}) > 1
    sink = GrowthSink()
    for step in range(100):
        env.publish(sink, 0.02 * step)
        env.step(np.zeros(7, np.float32))
    assert not sink.refused
    with pytest.raises(ArmguardError, match="has no CSV files"):
        HumanReach(recordings=tmp_path / "nothing")
