from types import SimpleNamespace

from armguard.lab.trial import SECONDS, list_ticks, make_visit
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import OperatingLimits
from armguard.verdict import Level
from support.panda_monitor import ranged_panda
from support.tradeoff_cases import make_site, small_scene
from support.trials import lead

RATE = 100.0


def site_with_limits(make_obstacles=Obstacles):
    operating = OperatingLimits.published(ranged_panda())
    return make_site(operating=operating, rate=RATE)._replace(make_obstacles=make_obstacles)


def test_a_visit_shows_all_levels_but_a_long_stop():
    site = site_with_limits()
    ticks = list_ticks(make_visit(site), RATE)
    assert len(ticks) == round(SECONDS * RATE)
    monitor = Monitor(site.robot, site.make_obstacles(), **site.settings)
    verdicts = lead(monitor, ticks)
    levels = [one.level for one in verdicts]
    assert set(levels) >= {Level.CLEAR, Level.AWARE, Level.SLOW}
    assert levels[0] is Level.CLEAR
    # An arm that broke its operating limits would stand for that alone.
    assert all(one.complete for one in verdicts)
    assert not any("operating" in str(reason) for one in verdicts for reason in one.reasons)


def test_nobody_comes_where_nothing_is_heard():
    site = site_with_limits(lambda: Obstacles(sources=[]))
    assert make_visit(site).messages == []
    assert make_visit(site_with_limits(lambda: Obstacles(sources=["eye"]))).messages


def test_each_message_is_told_before_the_first_tick_that_it_is_in_time_for():
    scene = small_scene()
    ticks, told = list_ticks(scene, RATE), []
    for tick in ticks:
        table = SimpleNamespace(update=lambda *batch, now=tick.stamp: told.append((now, batch[1])))
        if tick.tell is not None:
            tick.tell(SimpleNamespace(obstacles=table))
    stamps = [message.stamp for message in scene.messages if message.stamp <= ticks[-1].stamp]
    assert [stamp for _, stamp in told] == stamps
    assert all(0.0 <= now - stamp < 1.0 / RATE for now, stamp in told)
