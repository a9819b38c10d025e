"""Right beside people: few evaluations, the same stops, and no pair unaccounted for in a tick."""

import numpy as np
import pytest

from armguard.pairs.evaluate import evaluate, find_unsafe_pair
from armguard.scheduling.certificates import (
    ASKABLE,
    ENDING,
    IN_VAIN,
    MOVED,
    PREPARED,
    PROVED,
    stop_place,
)
from armguard.scheduling.deadline_kernels import CROWD
from armguard.scheduling.tournament import entries_of
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, kinds, make_monitor, panda, see, steps
from support.tick_states import begin_tick

LATENCY, STALENESS = 0.002, 0.25
LINKS = len(panda().links)


class Company:
    """Bodies that sway close to an arm that swings, each in a motion of its own.

    Args:
        seed: Of all that is random.
        count: Bodies.
        nearest: Least distance of their places from the base's axis, in [m].
        farthest: Greatest.
    """

    def __init__(self, seed, count, nearest=0.9, farthest=1.5):
        random = np.random.default_rng(seed)
        turn = random.uniform(0.0, 2.0 * np.pi, count)
        distance = random.uniform(nearest, farthest, count)
        height = random.uniform(0.0, 1.2, count)
        self.places = np.column_stack([distance * np.cos(turn), distance * np.sin(turn), height])
        self.size = random.uniform(0.0, 0.15, (count, 3))
        self.rate = random.uniform(0.5, 3.0, (count, 3))
        self.phase = random.uniform(0.0, 2.0 * np.pi, (count, 3))
        self.names = [f"body {k}" for k in range(count)]
        self.swing = random.uniform(-0.5, 0.5, 7)

    def tell(self, obstacles, now, **fields):
        turn = self.rate * now + self.phase
        place = self.places + self.size * np.sin(turn)
        pace = self.size * self.rate * np.cos(turn)
        see(obstacles, now, place, self.names, velocity=pace, **fields)

    def arm(self, now):
        turn = 1.3 * now
        return HOME + 0.3 * self.swing * np.sin(turn), 0.39 * self.swing * np.cos(turn)

    def supervise(self, obstacles, monitor, ticks):
        """Lead an arm that swings slowly through so many ticks; number and verdict of each."""
        for number in range(ticks):
            now = number * PERIOD
            if number % 10 == 0:
                self.tell(obstacles, now)
            swing = 0.1 * self.swing
            yield number, monitor.step(now, HOME + swing * np.sin(now), swing * np.cos(now))


def is_proved(verdict):
    """Contact is possible before the arm rests, and yet it may move: every stop was proved."""
    return verdict.level is not Level.STOP and not verdict.contact_time > verdict.stop_time


def is_near(verdict, margin=0.1):
    """The arm may move, though contact is possible less than `slow_margin` after it could rest."""
    return verdict.level is not Level.STOP and verdict.contact_time <= verdict.stop_time + margin


def compute_all(scheduler, tick, pairs):
    """Contact times of pairs, in [s] from now, evaluated afresh one by one."""
    state = scheduler.arm.state
    times, nodes = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=np.int64)
    begin_tick(state, tick.now, tick.arm_age, tick.stop_time + 10.0)
    state.prepare_arm(tick.q, tick.v)
    evaluate(state, pairs, times, nodes, np.zeros(len(pairs), dtype=np.int8))
    return times


@pytest.mark.parametrize("seed", range(6))
def test_stops_are_those_of_a_monitor_that_evaluates_everything(seed):
    """And contact times are never later than its, nor staler than they may be."""
    company = Company(seed, 9, 0.85 + 0.05 * seed, 1.4)
    worlds = [
        make_monitor(schedule, rise_delay=0.0, source_timeout=10.0)
        for schedule in ("deadline", "full")
    ]
    near, spent = 0, [0, 0]
    for k in range(150):
        now = k * PERIOD
        answers = []
        for which, (obstacles, monitor) in enumerate(worlds):
            if k % 10 == 0:
                company.tell(obstacles, now)
            answers.append(monitor.step(now, *company.arm(now)))
            spent[which] += answers[-1].evaluated
        lazy, full = answers
        assert (lazy.level is Level.STOP) == (full.level is Level.STOP), (k, lazy, full)
        assert lazy.level <= full.level
        # One that shares evaluations among links finds some times a little later, none too late.
        assert lazy.contact_time <= 1.05 * full.contact_time + 2.0 * PERIOD
        assert lazy.contact_time >= (1.0 - STALENESS) * full.contact_time - 0.1
        assert worlds[0][1]._scheduler.waiting == 0
        near += is_near(full)
    assert near > 0
    assert spent[0] < 0.2 * spent[1]


@pytest.mark.parametrize("seed", range(4))
def test_every_pair_is_accounted_for_in_each_tick_that_is_no_stop(seed):
    """By a certificate that outlasts the stop, or a proof that the arm rests, asked once more."""
    company, asked, proved = Company(10 + seed, 14), 0, 0
    budget = [None, 60][seed % 2]
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0, budget=budget)
    scheduler = monitor._scheduler
    for k in range(120):
        now = k * PERIOD
        if k % 10 == 0:
            company.tell(obstacles, now)
        verdict = monitor.step(now, *company.arm(now))
        if verdict.level is Level.STOP:
            continue
        assert verdict.complete
        tick = monitor._last[0]
        certificates = scheduler.certificates
        rows = np.array([obstacles.row(name) for name in company.names])
        pairs = (rows[:, None] * LINKS + np.arange(LINKS)).ravel()
        expiry = certificates.pair_expiry[rows].ravel()
        near = pairs[~(expiry > tick.time + tick.stop_time)]
        asked += len(near)
        places = stop_place.py_func(rows, False)
        proved += int((certificates.proofs.until[places] >= tick.time).sum())
        # What stands is no later than what is proved of the same tick anew, but for looser bounds.
        table = scheduler.arm.motion.braking.tabulate(tick.q, tick.v, 0.0, PERIOD + LATENCY)
        times = compute_all(scheduler, tick, near)
        doubtful = near[~(times > tick.stop_time)]
        assert find_unsafe_pair(scheduler.arm.state, doubtful)[0] == -1
        assert table.time[-1] <= tick.stop_time + 1e-9
    assert asked > 100
    assert proved > 100


def test_what_is_proved_of_stops_holds_for_a_state_that_agrees_and_ends_with_other_news():
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    scheduler = monitor._scheduler
    places = np.array([[0.685, 0.2, 0.5], [0.685, -0.2, 0.5]])

    def tell(now, moved=0.0, **fields):
        velocity = np.zeros((2, 3))
        see(obstacles, now, places + moved, ["near", "other"], velocity=velocity, **fields)

    def step(tick):
        assert steps(monitor, tick, 1)[0].level is Level.SLOW
        return monitor._last[0]

    def holds(tick):
        return scheduler.recall_stops(tick, tick.stop_time) == PROVED

    tell(0.0)
    tick = [step(k) for k in range(3)][-1]
    until = scheduler.certificates.proofs.until
    near, other = (stop_place(obstacles.row(name), False) for name in ("near", "other"))
    assert until[near] > tick.time
    assert holds(tick)
    assert not holds(tick._replace(time=float(until[near]) + 1e-6))
    # A state that agrees with the one that it was proved of.
    tell(2.5 * PERIOD, 1e-5)
    assert holds(tick)
    tick = step(3)
    # Two of them between two questions: the first was compared with nothing.
    tell(3.2 * PERIOD, 1e-5)
    tell(3.5 * PERIOD, 1e-5)
    assert not holds(tick)
    tick = step(4)
    assert holds(tick)
    # What agrees, but is larger, or may be faster.
    for number, grown in ((5, {"radius": 0.101}), (6, {"radius": 0.101, "speed": 2.5})):
        tell((number - 0.5) * PERIOD, 1e-5, **grown)
        assert not holds(tick)
        tick = step(number)
        assert holds(tick)
    # A refused sample: two states may be true.
    see(obstacles, 6.5 * PERIOD, [9.0, 0.0, 0.0], ["near"])
    assert not holds(monitor._last[0])
    steps(monitor, 7, 1)
    assert not until[near] > 7 * PERIOD
    # Other limits or brakes, or another tool.
    assert until[other] > 7 * PERIOD
    scheduler.invalidate_all()
    scheduler.evaluate_due(monitor._last[0])
    assert until[other] == -np.inf


def test_what_is_proved_of_a_speed_scale_holds_while_joints_keep_to_it():
    """Then most ticks ask nothing; of an arm that may soon be faster nothing is proved ahead."""
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    proofs = monitor._scheduler.certificates.proofs

    def step(tick, v=STILL):
        if tick % 5 == 0:
            now = tick * PERIOD
            see(obstacles, now, [0.85, 0.0, 0.6], velocity=np.zeros((1, 3)), speed=2.0, accel=10.0)
        return steps(monitor, tick, 1, HOME, v)[0]

    settled = [step(k) for k in range(60)][-1]
    assert settled.level is Level.SLOW
    assert 0.1 < settled.speed_scale < 0.9
    place, renewed, spent = stop_place(obstacles.row("ball"), True), 0, []
    for k in range(60, 90):
        before = proofs.made_at[place]
        verdict = step(k)
        assert verdict.speed_scale == settled.speed_scale
        assert proofs.until[place] >= k * PERIOD
        renewed += proofs.made_at[place] > before
        spent.append(verdict.evaluated)
    assert 0 < renewed < 10
    assert spent.count(0) > 15
    made_at = proofs.made_at[place]
    # Just below the scale when it is measured, above it perhaps before the next tick.
    fast = settled.speed_scale * panda().velocity_limit - panda().velocity_error - 1e-3
    for k in range(90, 110):
        step(k, np.eye(7)[6] * fast)
    assert proofs.made_at[place] == made_at


def test_a_tick_that_has_nothing_to_do_renews_what_ends_soon(monkeypatch):
    """So questions hardly ever come along with evaluations of what is due."""
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    scheduler, known, asked_in = monitor._scheduler, [], set()
    recall, ask = scheduler.recall_stops, scheduler.find_unsafe

    def note_answer(tick, *arguments, **options):
        answer = recall(tick, *arguments, **options)
        known.append(answer)
        if answer == ENDING:
            # All is proved, and only a tick without work is told that it ends.
            assert recall(tick, *arguments) == PROVED
            assert scheduler.certificates.numbers[MOVED] != tick.number
        return answer

    def note_question(tick, stop_time, **options):
        asked_in.add(tick.number)
        return ask(tick, stop_time, **options)

    monkeypatch.setattr(scheduler, "recall_stops", note_answer)
    monkeypatch.setattr(scheduler, "find_unsafe", note_question)
    busy = both = 0
    for k in range(400):
        now = k * PERIOD
        if k % 5 == 0:
            see(obstacles, now, [0.85, 0.0, 0.6], velocity=np.zeros((1, 3)), speed=2.0, accel=10.0)
        (verdict,) = steps(monitor, k, 1)
        assert verdict.level is Level.SLOW
        if k == 100:
            known.clear()
            asked_in.clear()
        if k >= 100:
            is_busy = bool((scheduler.certificates.evaluated_at == monitor._last[0].time).any())
            busy += is_busy
            both += is_busy and monitor._last[0].number in asked_in
    assert known.count(ENDING) > 15
    assert known.count(ASKABLE) < known.count(ENDING)
    assert busy > 5
    assert both <= 0.2 * busy


@pytest.mark.parametrize("ending", ["one", "other"])
def test_proofs_are_renewed_at_leisure_only_where_nothing_lacks_one(ending):
    """Whichever is looked at first: what was asked about in vain is not proved."""
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    places, still = [[0.685, 0.2, 0.5], [0.685, -0.2, 0.5]], np.zeros((2, 3))
    see(obstacles, 0.0, places, ["one", "other"], velocity=still)
    assert steps(monitor, 0, 2)[-1].level is Level.SLOW
    scheduler, tick = monitor._scheduler, monitor._last[0]
    tick = tick._replace(number=tick.number + 1)
    proofs = scheduler.certificates.proofs
    ends, lacks = (
        stop_place(obstacles.row(name), False)
        for name in (("one", "other") if ending == "one" else ("other", "one"))
    )

    def recall(soon):
        return scheduler.recall_stops(tick, 1.0, soon=soon)

    proofs.retry_at[[ends, lacks]] = 0.0
    proofs.until[[ends, lacks]] = tick.time + 1e-3, tick.time + 1.0
    assert recall(0.5e-3) == PROVED
    assert recall(2e-3) == ENDING
    proofs.until[lacks] = tick.time - 1e-9
    assert recall(2e-3) == ASKABLE
    proofs.retry_revision[lacks] = proofs.known.revision[lacks]
    proofs.retry_at[lacks] = tick.time + 1.0
    assert recall(2e-3) == IN_VAIN


def test_where_an_arm_may_go_at_full_speed_questions_and_evaluations_are_spread_too(monkeypatch):
    company, asked_in, busy, both = Company(6, 9, 1.1, 1.5), set(), 0, 0
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    scheduler = monitor._scheduler
    ask = scheduler.find_unsafe

    def note(tick, stop_time, **options):
        asked_in.add(tick.number)
        return ask(tick, stop_time, **options)

    monkeypatch.setattr(scheduler, "find_unsafe", note)
    for _, verdict in company.supervise(obstacles, monitor, 300):
        assert is_near(verdict)
        assert verdict.speed_scale == 1.0
        is_busy = bool((scheduler.certificates.evaluated_at == monitor._last[0].time).any())
        busy += is_busy
        both += is_busy and monitor._last[0].number in asked_in
    assert 10 < len(asked_in) < 60
    assert busy > 20
    assert both <= 0.1 * busy


def test_questions_alone_leave_bounds_to_whoever_needs_them():
    """Of the arm they need where its spheres are; evaluations and reports need all of it."""
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    scheduler, numbers = monitor._scheduler, monitor._scheduler.certificates.numbers
    see(obstacles, 0.0, [0.85, 0.0, 0.6], velocity=np.zeros((1, 3)), speed=2.0, accel=10.0)
    state, only_moved = scheduler.arm.state, 0
    for k in range(60):
        pace = 0.05 * np.sin(0.3 * k) * np.eye(7)[0]
        steps(monitor, k, 1, HOME, pace)
        tick = monitor._last[0]
        if numbers[MOVED] != tick.number or numbers[PREPARED] == tick.number:
            continue
        only_moved += 1
        centers = state.arm.centers.copy()
        scheduler.prepare(tick)
        assert (centers == state.arm.centers).all()
        filled = [np.array(one) for one in (state.scene.table.high, state.arm.velocity_error)]
        state.prepare_arm(tick.q, tick.v)
        assert (filled[0] == state.scene.table.high).all()
        assert (filled[1] == state.arm.velocity_error).all()
    assert only_moved > 3


@pytest.mark.parametrize(("seed", "count", "nearest"), [(1, 3, 0.85), (10, 9, 0.8)])
def test_no_tick_reads_what_an_earlier_one_filled_in_of_the_arm(seed, count, nearest):
    """Each fills in what it reads: spheres for questions, all bounds where it evaluates as well.

    Questions evaluate afresh what they find in the way, and whose certificate has grown stale.
    """
    company, afresh = Company(seed, count, nearest, 1.4), 0
    worlds = [
        make_monitor(rise_delay=0.0, source_timeout=10.0, max_staleness=0.5) for _ in range(2)
    ]
    for k in range(200):
        verdicts = []
        for obstacles, monitor in worlds:
            if k % 40 == 0:
                company.tell(obstacles, k * PERIOD)
            if verdicts:
                scene = monitor._scheduler.arm.state.scene
                places, table = scene.placement, scene.table
                for array in (places.centers, places.velocities, table.high, table.low):
                    array.fill(np.nan)
                scene.velocity_errors.error.fill(np.nan)
            verdicts.append(monitor.step(k * PERIOD, *company.arm(k * PERIOD)))
        assert verdicts[0] == verdicts[1]
        assert is_near(verdicts[0])
        certificates, tick = worlds[0][1]._scheduler.certificates, worlds[0][1]._last[0]
        is_busy = (certificates.evaluated_at == tick.time).any()
        afresh += certificates.numbers[PREPARED] == tick.number and not is_busy
    assert afresh > 0


def test_a_stop_is_proved_by_far_fewer_questions_than_ticks(monkeypatch):
    company, questions = Company(3, 9, 1.0, 1.3), []
    obstacles, monitor = make_monitor(source_timeout=10.0)
    scheduler = monitor._scheduler
    ask = scheduler.find_unsafe

    def count(tick, stop_time, **options):
        # Those of the speed scale are others: of an arm that is told to stop later.
        questions.append(options["lasting"] >= 0.0 and options["until"] == 0.0)
        return ask(tick, stop_time, **options)

    monkeypatch.setattr(scheduler, "find_unsafe", count)
    proved = 0
    for k in range(200):
        if k % 10 == 0:
            company.tell(obstacles, k * PERIOD)
        verdict = monitor.step(k * PERIOD, *company.arm(k * PERIOD))
        proved += is_proved(verdict)
    assert proved > 100
    assert 0 < sum(questions) < 0.5 * proved


@pytest.mark.hazard("H-09")
def test_five_thousand_within_the_stopping_distance_are_a_stop_at_a_bounded_price():
    random = np.random.default_rng(4)
    way = random.normal(size=(5000, 3))
    places = 0.64 * way / np.linalg.norm(way, axis=1)[:, None] + (0.0, 0.0, 0.4)
    obstacles, monitor = make_monitor(source_timeout=10.0)
    names = [f"body {k}" for k in range(5000)]
    see(obstacles, 0.0, places, names, radius=0.02, velocity=np.zeros((5000, 3)))
    steps(monitor, 0, 1)
    price = 4 * (2 * len(monitor._scheduler.arm.state.tree.radius) + 2 * LINKS + 2)
    for verdict in steps(monitor, 1, 60):
        assert (verdict.level, verdict.complete) == (Level.STOP, True)
        assert verdict.evaluated <= CROWD + price
    assert ReasonKind.CROWD in kinds(verdict)
    # They leave: all is evaluated before the level rises again.
    obstacles.remove(names)
    see(obstacles, 61 * PERIOD, [9.0, 0.0, 0.0], ["far"])
    last = steps(monitor, 61, 400)[-1]
    assert last.level is Level.CLEAR
    assert ReasonKind.CROWD not in kinds(last)


def test_without_a_stop_decision_what_could_matter_to_a_stop_is_due():
    """By free bodies alone a contact time within the stop is a STOP, and may not be stale then."""
    obstacles, monitor = make_monitor(motion="isotropic", rise_delay=0.0, source_timeout=10.0)
    see(obstacles, 0.0, [3.2, 0.0, 0.5], velocity=np.zeros((1, 3)), speed=1.0, accel=2.0)
    certificates = monitor._scheduler.certificates
    verdicts = []
    for k in range(200):
        verdicts += steps(monitor, k, 1, HOME, STILL)
        row = obstacles.row("ball")
        end = entries_of(certificates.expiry_tree)[row]
        assert certificates.wheel.deadline[row] < end < np.inf
    assert not any(ReasonKind.OVERDUE in kinds(one) for one in verdicts)


def test_what_can_hardly_be_proved_of_a_speed_scale_is_not_asked_in_every_tick(monkeypatch):
    """A scale is as high as can be, so something is in its way; that too is proved ahead."""
    company, single = Company(3, 24, 0.9, 1.3), []
    obstacles, monitor = make_monitor(rise_delay=0.0, source_timeout=10.0)
    scheduler = monitor._scheduler
    ask = scheduler.find_unsafe

    def count(tick, stop_time, **options):
        if options["kept_since"] is not None and not options["lasting"] > options["until"]:
            single.append(tick.number)
        return ask(tick, stop_time, **options)

    monkeypatch.setattr(scheduler, "find_unsafe", count)
    for number, verdict in company.supervise(obstacles, monitor, 200):
        if number < 100:
            # It begins with nothing proved.
            single.clear()
        else:
            assert 0.1 < verdict.speed_scale < 0.5
    assert len(single) < 70
