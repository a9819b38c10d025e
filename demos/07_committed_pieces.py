"""A controller that moves only on committed pieces, each with its own stop.

Every 20 ms it offers its next piece. While pieces are safe, the arm moves on. When a ball could
come too near, the arm follows its present piece to rest, and waits there until the next piece is
safe. No verdict has to arrive for that.
"""

import numpy as np

import armguard

PERIOD, PIECE = 0.01, 0.03  # [s]: of ticks, and of what a piece shows before its own stop
ACCEL, TOP, WAY = 1.0, 0.5, 0.4  # of joint 1: [rad/s²], [rad/s], and [rad] to either side
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def make_piece(now: float, q: np.ndarray, v: np.ndarray, direction: float) -> armguard.Plan:
    """What comes next: joint 1 speeds up in a direction, to its top speed."""
    times = np.linspace(0.0, PIECE, 4)
    place, pace = np.tile(q, (4, 1)), np.tile(v, (4, 1))
    for k in range(3):
        pace[k + 1, 0] = np.clip(pace[k, 0] + direction * ACCEL * times[1], -TOP, TOP)
        place[k + 1, 0] = place[k, 0] + 0.5 * times[1] * (pace[k, 0] + pace[k + 1, 0])
    return armguard.Plan(now, times, place, pace, np.full(7, 0.002), np.full(7, 0.02))


def place_at(plan: armguard.Plan, now: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a plan has the arm: here, its velocities are linear between samples."""
    times, q, v = (np.asarray(part) for part in (plan.times, plan.q, plan.v))
    at = min(now - plan.stamp, times[-1])
    k = min(int(np.searchsorted(times, at, side="right")) - 1, len(times) - 2)
    gone = at - times[k]
    pace = v[k] + (v[k + 1] - v[k]) * gone / (times[k + 1] - times[k])
    return q[k] + 0.5 * gone * (v[k] + pace), pace


def main(duration: float = 8.0) -> int:
    """Swing joint 1 beside a ball that comes and goes; how many pieces were committed."""
    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles(sources=["camera"])
    monitor = armguard.Monitor(robot, obstacles, rate=1.0 / PERIOD, motion="planned")
    rest = armguard.Plan(0.0, [0.0, PIECE], [HOME] * 2, np.zeros((2, 7)), np.full(7, 0.002))
    piece, committed, direction, goes_on = rest, 0, 1.0, None
    for tick in range(round(duration / PERIOD)):
        now = tick * PERIOD
        ball = [[1.4 + 0.8 * np.cos(1.5 * now), 0.1, 0.6]]
        obstacles.update(
            ["ball"], now, ball, [[-1.2 * np.sin(1.5 * now), 0.0, 0.0]], radius=0.1, source="camera"
        )
        q, v = place_at(piece, now)
        verdict = monitor.step(now, q, v)
        if verdict.stop == "brake" and committed:
            print(f"{now:5.2f} s: brake, {verdict.reasons[0]}")  # where the ball broke its bounds
            break
        if tick % 2:
            continue
        direction = -direction if abs(q[0]) > WAY and q[0] * direction > 0.0 else direction
        following = monitor.with_stop(make_piece(now, q, v, direction))
        answer = monitor.commit(following)
        if answer.safe:
            piece, committed = following, committed + 1
        if answer.safe is not goes_on:
            goes_on = answer.safe
            print(f"{now:5.2f} s: {'goes on' if goes_on else f'to rest, {answer.reasons[0]}'}")
    return committed


if __name__ == "__main__":
    main()
