"""Plans of a Panda for a fifth of a second, and how they are checked."""

import numpy as np

from armguard.bounds import Plan, append_stop, check_plan

NOW = 5.0
HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
STILL = np.zeros(7)
TIMES = np.linspace(0.0, 0.2, 21)
ERRORS = np.full(7, 2e-3)


def resting(**changes):
    plan = Plan(NOW, TIMES, np.tile(HOME, (21, 1)), np.zeros((21, 7)), ERRORS)
    return plan._replace(**changes)


def moved(joint, place, pace):
    """A plan whose one joint goes along given positions with given velocities."""
    q, v = np.tile(HOME, (21, 1)), np.zeros((21, 7))
    q[:, joint], v[:, joint] = place, pace
    return resting(q=q, v=v)


def check(robot, plan, *, now=NOW, q=None, v=None, stamp=NOW, stops=True, **settings):
    """A plan as checked, with each joint's stop at its end unless it is to be without."""
    stopped = append_stop(plan, robot.braking_deceleration)
    plan = stopped if stops and isinstance(stopped, Plan) else plan
    q = np.asarray(plan.q)[0] if q is None else q
    v = np.asarray(plan.v)[0] if v is None else v
    return check_plan(plan, robot, now, q, v, stamp, **settings)
