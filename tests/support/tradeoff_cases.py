"""A small study: Panda, a few messages, settings that are quick to run."""

import functools

import numpy as np
import pinocchio

from armguard.lab.tradeoff.contestant import Track
from armguard.lab.tradeoff.figures import Figures
from armguard.lab.tradeoff.ladder import AXES, DEFAULT, FINEST, Setting
from armguard.lab.tradeoff.scene import Notebook, Site, make_scene
from armguard.lab.tradeoff.study import Outcome, Study
from armguard.obstacles import Obstacles
from support.panda_monitor import ranged_panda


def make_site(**settings):
    return Site(ranged_panda(), Obstacles, settings)


@functools.cache
def small_scene(seconds=1.0, balls=3):
    return make_scene(make_site(), None, balls, seconds, 1)[0]


def make_message(stamp, position, *, body="ball", velocity=(0.0, 0.0, 0.0), radius=0.1, **bounds):
    """One obstacle, as a scene takes it down."""
    messages = []
    Notebook(messages, 0.0, pinocchio.SE3.Identity(), "eye").update(
        [body],
        stamp,
        position,
        np.broadcast_to(velocity, np.shape(position)),
        radius=radius,
        **bounds,
    )
    return messages[0]


def make_track(levels, *, rate=100.0, contact_time=1.0, **fields):
    """A track whose ticks are of those levels."""
    count = len(levels)
    track = Track(
        np.arange(1, count + 1) / rate,
        np.full(count, 1e-4),
        np.full(count, 10),
        np.array(levels, dtype=np.int64),
        np.broadcast_to(np.asarray(contact_time, dtype=float), (count,)),
        np.ones(count),
    )
    return track._replace(**fields)


def make_figures(**changes):
    usual = dict.fromkeys(Figures._fields, 1.0) | {"missed": 0.0, "stop": 0.1, "core": 0.5}
    return Figures(**usual | changes)


def make_study(**changes):
    """What a study could have found."""
    rung = AXES["budget"][0]
    outcomes = [
        Outcome(Setting(DEFAULT), make_figures(core=0.1, stop=0.105)),
        Outcome(Setting(FINEST), make_figures()),
        Outcome(Setting(str(rung), (rung,)), make_figures(core=0.05, stop=0.3, late_max=np.nan)),
        Outcome(Setting("odd"), None, "it | cannot be"),
    ]
    study = Study(outcomes, [DEFAULT, "budget 16"], [], 5.0, "")
    return study._replace(**changes)
