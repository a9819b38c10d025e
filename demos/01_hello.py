"""Hello: an arm at rest, a ball that flies towards it, and the monitor's verdicts."""

import armguard


def main() -> None:
    """Print each change of the verdict while the ball comes nearer."""
    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles()  # each: at most 10 m/s² and 2 m/s by default
    monitor = armguard.Monitor(robot, obstacles, rate=1000.0)
    q, v = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.0] * 7  # [rad], [rad/s]
    level = None
    for tick in range(5000):
        now = 0.001 * tick  # [s], on the clock that stamps everything
        if tick % 10 == 0:  # perception is slower than the monitor
            obstacles.update(["ball"], now, [[5.0 - now, 0.0, 0.6]], [[-1.0, 0.0, 0.0]], radius=0.1)
        verdict = monitor.step(now, q, v)
        if verdict.level is not level:
            level = verdict.level
            print(f"{now:5.3f} s: {level.name}, contact time {verdict.contact_time:.3f} s")


if __name__ == "__main__":
    main()
