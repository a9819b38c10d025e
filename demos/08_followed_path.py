"""A controller that follows one trajectory, its clock as fast as it is told, and stops on its path.

The monitor knows the way until the brakes bite. `speed_scale` scales the path's clock; on STOP the
clock is slowed down to rest as fast as all brakes together can, and goes on once it may.
"""

import numpy as np

import armguard

PERIOD = 0.01  # [s]
FASTER, SLOWER = 2.0, 10.0  # of the clock's pace, [1/s]; brakes guarantee 8 on this trajectory
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
LENGTH, TURN = 6.0, 0.8  # [s] and [rad], of joint 1's way there and back


def make_trajectory() -> armguard.Plan:
    """There and back, from rest to rest."""
    times = np.linspace(0.0, LENGTH, 601)
    rate = 2.0 * np.pi / LENGTH
    q, v = np.tile(HOME, (601, 1)), np.zeros((601, 7))
    q[:, 0] += 0.5 * TURN * (1.0 - np.cos(rate * times))
    v[:, 0] = 0.5 * TURN * rate * np.sin(rate * times)
    v[[0, -1]] = 0.0
    return armguard.Plan(0.0, times, q, v, np.full(7, 0.002), np.full(7, 0.02))


def main(duration: float = 12.0) -> float:
    """Go along the trajectory beside a ball that comes and goes; how far, in [s] of its clock."""
    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles(sources=["camera"])
    monitor = armguard.Monitor(robot, obstacles, rate=1.0 / PERIOD, motion="planned", stop="path")
    plan = make_trajectory()
    path_time, pace, level = 0.0, 0.0, None
    for tick in range(round(duration / PERIOD)):
        now = tick * PERIOD
        ball = [[1.45 + 0.8 * np.cos(1.5 * now), 0.2, 0.6]]
        obstacles.update(
            ["ball"], now, ball, [[-1.2 * np.sin(1.5 * now), 0.0, 0.0]], radius=0.1, source="camera"
        )
        q = np.array([np.interp(path_time, plan.times, joint) for joint in np.asarray(plan.q).T])
        v = np.array([np.interp(path_time, plan.times, joint) for joint in np.asarray(plan.v).T])
        verdict = monitor.step(now, q, pace * v, path_time=path_time)
        if tick == 0:
            answer = monitor.follow(plan)
            assert answer.safe, answer.reasons
        if verdict.level is not level:
            level = verdict.level
            print(f"{now:5.2f} s: {level.name}, its clock at {path_time:.2f} s and {pace:.0%}")
        wanted = verdict.speed_scale  # 0 on STOP
        before = pace
        pace += float(np.clip(wanted - pace, -SLOWER * PERIOD, FASTER * PERIOD))
        path_time = min(path_time + 0.5 * PERIOD * (before + pace), LENGTH)
    return path_time


if __name__ == "__main__":
    main()
