import numpy as np

from armguard.bounds import Plan
from support.panda_monitor import HOME, STILL, make_monitor

PERIOD = 0.01
TIMES = np.linspace(0.0, 1.5, 151)


def make_plan(turn=0.1):
    """From rest to rest, by the first joint."""
    angle = np.pi * TIMES / TIMES[-1]
    q, v = np.tile(HOME, (151, 1)), np.zeros((151, 7))
    q[:, 0] += 0.5 * turn * (1.0 - np.cos(angle))
    v[:, 0] = 0.5 * turn * np.pi / TIMES[-1] * np.sin(angle)
    return Plan(0.0, TIMES.copy(), q, v, np.full(7, 1e-3), np.full(7, 0.01))


def start(**settings):
    _, monitor = make_monitor(motion="planned", rate=1.0 / PERIOD, **settings)
    monitor.step(0.0, HOME, STILL)
    return _, monitor


def run(monitor, plan, until):
    for k in range(1, until):
        monitor.step(PERIOD * k, plan.q[k], plan.v[k])


def test_pieces_and_trajectories_are_told_one_at_a_time():
    _, monitor = start()
    plan = make_plan()
    assert monitor.follow(plan).safe
    run(monitor, plan, 10)
    assert "follows a trajectory" in monitor.commit(plan).reasons[0].detail
    monitor.reset()
    monitor.step(0.2, plan.q[9], plan.v[9])
    rest = plan._replace(stamp=0.2 - float(TIMES[9]))
    assert monitor.commit(rest).safe
    monitor.step(0.21, plan.q[10], plan.v[10])
    assert "on a piece" in monitor.follow(rest).reasons[0].detail


def test_once_the_arm_rests_at_the_end_the_other_kind_may_be_told():
    for first, second in (("follow", "commit"), ("commit", "follow")):
        _, monitor = start()
        plan = make_plan()
        assert getattr(monitor, first)(plan).safe
        run(monitor, plan, 151)
        end = plan.q[-1]
        monitor.step(1.51, end, STILL)
        rest = Plan(1.51, [0.0, 0.2], [end, end], [STILL, STILL], np.full(7, 1e-3))
        assert getattr(monitor, second)(rest).safe


def test_everything_is_compiled_before_the_first_plan():
    from armguard.bounds.planned import contact, curve, following, slabs, stop
    from armguard.monitor import committed_pieces

    modules = (contact, curve, following, slabs, stop, committed_pieces)
    kernels = [
        one for module in modules for one in vars(module).values() if hasattr(one, "signatures")
    ]
    for stop_kind in ("joints", "path"):
        obstacles, monitor = make_monitor(motion="planned", rate=1.0 / PERIOD, stop=stop_kind)
        before = [len(one.signatures) for one in kernels]
        plan = make_plan()
        obstacles.add_static("post", [0.9, 0.0, 0.5], 0.05)
        for ask in (monitor.commit, monitor.follow):
            monitor.reset()
            monitor.step(0.0, HOME, STILL)
            assert ask(monitor.with_stop(plan)).safe
            run(monitor, plan, 5)
        assert [len(one.signatures) for one in kernels] == before


def test_what_the_arm_was_told_is_there_to_be_looked_at_until_a_reset():
    _, monitor = start()
    assert monitor.plans == []
    plan = make_plan()
    assert monitor.follow(plan).safe
    (followed,) = monitor.plans
    assert np.array_equal(followed.q, plan.q)
    monitor.reset()
    assert monitor.plans == []
    monitor.step(0.0, HOME, STILL)
    assert monitor.commit(plan).safe
    assert len(monitor.plans) == 1
