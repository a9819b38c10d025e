"""A shielded environment does what is asked for as far as that is proved, and nothing else."""

import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env

import armguard
from armguard.exceptions import ArmguardError
from armguard.gymnasium import ShieldedEnv
from support.joint_env import POINTS, JointEnv
from support.shielded_arm import HOME

KINDS = "velocity", "position", "chunk"
NEAR = np.array([0.3, 0.1, 0.0, -0.1, 0.0, 0.2, 0.0])


def draw_action(random, env):
    """Far and near, fast and slow."""
    size = random.choice([0.1, 1.0])
    if env.unwrapped.action_kind == "velocity":
        return random.uniform(-size, size, 7)
    if env.unwrapped.action_kind == "position":
        return HOME + random.uniform(-size, size, 7)
    steps = random.uniform(-0.03 * size, 0.03 * size, (1, 7))
    return env.unwrapped.q + np.arange(1, POINTS + 1)[:, None] * steps


def play(env, seed, steps):
    """Everything that is seen and told, of random actions that are kept for a while."""
    random, action = np.random.default_rng(seed), None
    seen, _ = env.reset(seed=seed)
    told = [seen]
    for step in range(steps):
        if step % 10 == 0 or env.unwrapped.action_kind == "chunk":
            action = draw_action(random, env)
        seen, reward, _, _, info = env.step(action)
        told += [seen, reward, info]
    return told


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_is_asked_for_nothing_is_touched_while_the_arm_moves(kind):
    steps = 300 if kind != "chunk" else 60
    moved, slowed, free = 0.0, 0, 0
    for seed in range(2):
        env = ShieldedEnv(JointEnv(kind, balls=2))
        told = play(env, seed, steps)
        assert env.unwrapped.contacts == 0
        moved += np.abs(np.diff(np.array(told[1::3])[:, :7], axis=0)).sum()
        slowed += sum(info["armguard"]["reason"] is not None for info in told[3::3])
        alone = JointEnv(kind, balls=2)
        play(alone, seed, steps)
        free += alone.contacts
    assert moved > 1.0
    assert slowed > 0
    assert free > 0, "else there is nothing to be kept from"


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_steps_to_the_bit(kind):
    env, other = ShieldedEnv(JointEnv(kind)), ShieldedEnv(JointEnv(kind))
    first = play(env, 5, 40)
    play(env, 6, 40)
    for again in (play(env, 5, 40), play(other, 5, 40)):
        for one, two in zip(first, again, strict=True):
            np.testing.assert_equal(one, two)


def test_where_nothing_is_near_the_arm_does_what_it_is_asked_to():
    env = ShieldedEnv(JointEnv("velocity", balls=0), obstacles={"sources": ["default"]})
    env.reset(seed=0)
    for _ in range(60):
        _, _, _, _, info = env.step(NEAR)
    assert env.unwrapped.v == pytest.approx(NEAR, abs=1e-3)
    told = info["armguard"]
    assert told["level"] == "CLEAR"
    assert told["scale"] == pytest.approx(1.0)
    assert told["reason"] is None
    assert told["contact_time"] > 1.0
    assert told["contact_speed"] is None
    assert set(told) == {"level", "scale", "reason", "contact_time", "contact_speed"}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_beyond_limits_is_done_within_them(kind):
    env = ShieldedEnv(JointEnv(kind, balls=0))
    inner, random = env.unwrapped, np.random.default_rng(0)
    robot = inner.robot
    env.reset(seed=0)
    before = inner.v
    for step in range(80):
        if step % 20 == 0:
            far = random.choice([-4.0, 4.0], 7)
        env.step(np.tile(far, (POINTS, 1)) if kind == "chunk" else far)
        assert (np.abs(inner.v) <= 0.4 * robot.velocity_limit).all()
        change = robot.acceleration_limit * inner.period
        assert (np.abs(inner.v - before) <= change).all()
        before = inner.v
        assert (inner.q >= robot.lower_position_limit).all()
        assert (inner.q <= robot.upper_position_limit).all()
    assert env.command.stop is None


def test_an_arm_goes_to_a_position_and_rests_there():
    env = ShieldedEnv(JointEnv("position", balls=0))
    env.reset(seed=0)
    for _ in range(150):
        env.step(HOME + NEAR)
    assert env.unwrapped.q == pytest.approx(HOME + NEAR, abs=1e-3)
    assert env.unwrapped.v == pytest.approx(np.zeros(7), abs=1e-3)


def test_an_arm_goes_along_a_chunk():
    env = ShieldedEnv(JointEnv("chunk", balls=0))
    env.reset(seed=0)
    for step in range(20):
        env.step(HOME + NEAR * 0.02 * (step * POINTS + np.arange(1, POINTS + 1)[:, None]))
    assert env.unwrapped.q == pytest.approx(HOME + 2.0 * NEAR, abs=0.02)
    assert env.command.executed >= POINTS


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "nonsense",
    [np.full(7, np.nan), np.full(7, np.inf), np.zeros(3), "what", None, [[1.0], [2.0, 3.0]]],
)
def test_nonsense_stops_the_arm_and_never_reaches_it(kind, nonsense):
    env = ShieldedEnv(JointEnv(kind, balls=0))
    env.reset(seed=0)
    for step in range(20):
        way = NEAR * env.unwrapped.period * (step + 1)
        asked = {
            "velocity": NEAR,
            "position": HOME + way,
            "chunk": np.tile(HOME + way, (POINTS, 1)),
        }
        env.step(asked[kind])
    assert env.unwrapped.v.any()
    for _ in range(30):
        _, _, _, _, info = env.step(nonsense)
        assert kind != "velocity" or nonsense is None or "velocity" in info["armguard"]["reason"]
    assert np.isfinite(env.unwrapped.actions).all()
    assert env.unwrapped.v == pytest.approx(np.zeros(7), abs=1e-6)


def test_settings_reach_monitor_table_and_shield():
    limits = armguard.ContactLimits({"hand": armguard.ContactLimit(speed=0.2, source="a guess")})
    env = ShieldedEnv(
        JointEnv("velocity"),
        monitor={"contact_limits": limits, "reaction_time": 0.1},
        obstacles={"regions": {"ball*": "hand"}},
        shield={"jerk": 100.0},
    )
    env.reset(seed=0)
    _, _, _, _, info = env.step(NEAR)
    assert info["armguard"]["contact_speed"] >= 0.0
    with pytest.raises(ArmguardError, match="jerk"):
        ShieldedEnv(JointEnv("velocity"), shield={"jerk": -1.0})
    with pytest.raises(ArmguardError, match="reaction_time"):
        ShieldedEnv(JointEnv("velocity"), monitor={"reaction_time": -1.0})
    with pytest.raises(TypeError, match="rate"):
        ShieldedEnv(JointEnv("velocity"), shield={"rate": 500.0})  # the environment's steps decide


def test_a_scene_may_stand_beside_the_environment():
    class Beside:
        action_kind = "position"

        def __init__(self, env):
            self._env = env.unwrapped
            self.robot, self.period = self._env.robot, self._env.period
            self.read_joints, self.publish = self._env.read_joints, self._env.publish

    env = JointEnv("position", balls=0)
    env.action_kind = "something else"
    shielded = ShieldedEnv(env, Beside)
    shielded.reset(seed=0)
    assert shielded.step(HOME)[4]["armguard"]["level"] == "CLEAR"


def test_actions_of_another_kind_are_refused():
    env = JointEnv("velocity")
    env.action_kind = "torque"
    with pytest.raises(ArmguardError, match="action_kind: is 'torque'"):
        ShieldedEnv(env)


def test_an_action_space_of_another_arm_is_refused():
    env = JointEnv("velocity")
    env.action_space = Box(-1.0, 1.0, (6,))
    with pytest.raises(ArmguardError, match=r"action space: has the shape \(6,\)"):
        ShieldedEnv(env)


def test_several_environments_run_beside_each_other():
    env = gymnasium.vector.SyncVectorEnv([lambda: ShieldedEnv(JointEnv("velocity", balls=0))] * 2)
    env.reset(seed=0)
    _, _, _, _, infos = env.step(np.stack([NEAR, np.full(7, np.nan)]))
    told = infos["armguard"]
    assert told["level"].tolist() == ["CLEAR", "CLEAR"]
    assert told["reason"][0] is None
    assert "velocity" in told["reason"][1]
    env.close()


def test_what_the_page_shows_runs(capsys):
    page = (Path(__file__).parents[1] / "docs" / "gymnasium.md").read_text(encoding="utf-8")
    snippets = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    scope = {}
    exec(snippets[0], scope)
    told = capsys.readouterr().out
    mine = JointEnv("velocity", balls=1)
    hand = SimpleNamespace(xpos=np.array([1.0, 0.0, 0.5]))
    mine.data = SimpleNamespace(qpos=HOME, qvel=np.zeros(7), body={"hand": hand}.get)
    scope["my_env"] = mine
    exec(snippets[1], scope)
    assert len(snippets) == 2
    scope["env"].reset(seed=0)
    _, _, _, _, info = scope["env"].step(NEAR)
    for key in info["armguard"]:
        assert f"| `{key}` |" in page
        assert f"'{key}': " in told


def test_the_checker_of_environments_finds_nothing():
    shielded = ShieldedEnv(gymnasium.make("armguard/HumanReach-v0", disable_env_checker=True))
    with pytest.warns(UserWarning, match="different from the unwrapped version"):
        check_env(shielded)
