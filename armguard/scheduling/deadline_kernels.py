"""The compiled tick of the deadline scheduler: accept a joint state, evaluate what is due.

An obstacle is the unit that falls due: all watched links are evaluated together, since the soonest
of them decides when it must be evaluated again, and one record of the obstacle is what all of its
certificates rest on. A tick takes out of the wheel what is due, the most urgent first, and puts
each back for the time by which it could matter to a stop, or look stale.

An evaluation starts with what the whole arm cannot leave; most obstacles are done with then.
Otherwise links follow in the order of their imminence, so that most of them need no refinement.

Questions about what could be touched soon stand here as well: which obstacles those are, and
whether the arm rests before. They are asked where a contact time alone would stop the arm, and what
is due depends on whether they are:

- With a stop decision an obstacle is due when its answer would look stale, and its certificate's
  end orders what waits. Nothing else is needed, for this holds in each tick that is no STOP: *each
  watched pair has a certificate that outlasts the stop, or was proved to be out of the way of an
  arm that is told to stop in this tick.* `find_unsafe` asks every pair without such a certificate,
  whether it was ever evaluated or not, so neither a schedule nor a budget can open a gap; one whose
  certificate has ended makes the contact time 0, and is overdue where that question is not asked,
  or its answer is no.
- Without one, a contact time within the stop is a STOP. So an obstacle is due by the time at which
  it could matter to a stop as well, and overdue from then on.
"""

from __future__ import annotations

import math
import sys
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.operating_history import (
    UNKEPT,
    OperatingRecord,
    keeps_operating_limits,
)
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, separate_kernel
from armguard.obstacles.partners import ALONE, NO_PARTNER, Partner
from armguard.obstacles.possible_states import is_known
from armguard.obstacles.reference_states import allows_reference_state, expire, keep_reference_state
from armguard.obstacles.regions import ContactLimit
from armguard.obstacles.table import clear_changed_rows, copy_state
from armguard.obstacles.tethers import TIED
from armguard.pairs.contact_time import (
    RESTS,
    TOUCHES,
    UNDECIDED,
    arm_reach_time,
    find_harm_time,
    limit_of,
    link_reach_time,
    link_time,
    own_place,
    pair_time,
    partner_of,
    partner_place,
    partner_reach_time,
    rests_in_time,
    root_time,
)
from armguard.pairs.scene import REACH, UNKNOWN, Scene, prepare_arm
from armguard.pairs.touching import NO_LINK, find_touching_link
from armguard.robot.brakes import BrakeCurves
from armguard.robot.joint_acceptance import BELIEVED, Guard, accept
from armguard.robot.kinematics import move_spheres
from armguard.scheduling.certificates import (
    ACTIVE,
    ASKABLE,
    BROKEN,
    ENDING,
    EVALUATED_ROWS,
    IN_VAIN,
    MOVED,
    PREPARED,
    PROVED,
    READ_AHEAD,
    SPENT,
    UNPLACED,
    UNSAFE,
    UNSEEN,
    Certificates,
    agrees,
    first_link,
    invalidate,
    keep_known_state,
    set_ends,
    stop_place,
    withdraw_permissions,
)
from armguard.scheduling.tether_uses import (
    ASKED,
    CERTIFICATE,
    NOT_ASKED,
    USES,
    copy_use,
    drop_uses,
    find_excess,
    follow_tether,
    keep_use,
)
from armguard.scheduling.timing_wheel import (
    NOBODY,
    TURNING,
    WAITING,
    most_urgent,
    put_off,
    turn,
)
from armguard.scheduling.tournament import ROOT, find_below, find_least, parent_of

RECENT = 4096
"""Evaluated rows over which their price is averaged."""

LATEST = sys.float_info.max
"""Latest time that is asked for: what is not watched has no end, nor has what never comes near."""

CROWD = 48
"""Evaluations in a tick beyond which, once a STOP is certain, other obstacles wait, unless all are
to be evaluated."""

MOST_AHEAD = 64
"""Evaluations of a question beyond which no proof is renewed ahead of its end."""

AHEAD = 0.4
"""Part of the time that proofs last, in which they are renewed ahead of their end along with
others: each question needs a table, which takes as long as asking it of some rows. Without that
`bench_near` asks 1.8 instead of 1.0 questions a tick beside 1,000 near balls, and its median rises
by 14 %."""

MOST_DOUBTFUL = 2
"""Rows whose rest cannot be proved for longer than a tick, until no more of them are asked."""


MOST_READ_AHEAD = 256
"""Rows whose records are read before the first of them is evaluated, at most: more are seldom due,
and the cache that is at hand soonest has no room for many more."""


class Moment(NamedTuple):
    """One tick, as compiled code is told of it."""

    now: float
    """On the obstacles' clock, in [s]."""
    time: float
    """The same since the monitor's epoch."""
    number: int
    """Of the tick."""
    arm_age: float
    """Age of the joint state, in [s]."""
    refinement_threshold: float
    """What could be touched before this, in [s], is refined."""


class StopQuestion(NamedTuple):
    """Whether the arm surely rests before it touches anything, by the scene's table of braking."""

    stop_time: float
    """When the table of braking ends, in [s]."""
    within: float
    """What could be touched within this is asked about, in [s], at most `stop_time`: the rest is
    surely out of the way until the arm rests that is told to stop by `until`, or a little later."""
    lasting: float
    """By how much later than in this tick the arm may be told to stop, as far as the table is
    concerned, in [s]; -1 if the table is of something else, and no proof of a STOP answers it."""
    until: float
    """By how much later it is to be told, in [s], at most `lasting` where that is above 0: what was
    proved earlier of a STOP that comes so late is not asked again."""
    pause: float
    """For how long a row is not asked again that might be touched, in [s]; 0: it is."""
    is_paced: bool
    """Whether the table is that of joints that keep to a speed scale."""
    since: float
    """Since when they have surely kept to it, in [s] since the epoch; earlier proofs of such a
    table count for nothing. Of other tables -inf."""
    last_offender: int
    """Pair to decide about first if it is as near, row × links + link: what was unsafe lately
    likely is again."""
    budget: int
    """Evaluations that may be spent."""


@kernel
def _prepare_for(
    scene: Scene, certificates: Certificates, q: FloatArray, v: FloatArray, moment: Moment
) -> None:
    """Fill all that evaluations need of the arm in a tick, once."""
    if certificates.numbers[PREPARED] != moment.number:
        prepare_arm(scene, q, v, moment.arm_age)
        certificates.numbers[MOVED] = certificates.numbers[PREPARED] = moment.number


@kernel
def _read_changes(scene: Scene, certificates: Certificates) -> int:
    """Invalidate the certificates that changes of their rows have overtaken; how many rows."""
    overtaken = broken = 0
    for i in range(certificates.news.changed_count[0]):
        row = certificates.news.changed[i]
        if not certificates.watched[row].any():
            continue
        overtaken += 1
        if scene.marks.static[row] and not scene.marks.refused[row]:
            # One that never moves is news when it comes, and then it is due already.
            continue
        allowed, _ = allows_reference_state(scene.bodies, certificates.reference_states, row, row)
        if not allowed and scene.marks.has_state[row]:
            certificates.broken[broken] = row
            broken += 1
        invalidate(certificates, row)
        if certificates.permits_contact:
            # It says where the obstacle can be, until it is evaluated, no more than it says when.
            certificates.reference_states.point_count[row] = 0
    certificates.numbers[BROKEN] = broken
    if overtaken > 0:
        withdraw_permissions(certificates)
    clear_changed_rows(certificates.news)
    return overtaken


@kernel
def _read_tethers(scene: Scene, certificates: Certificates, moment: Moment, mending: float) -> int:
    """End what was proved by tethers that newer states contradict; how many rows that concerns.

    Invariant: the revisions of each tether are those of its rows in the last tick that evaluated,
    before which each proof was made that uses it.
    """
    tethers, marks, uses = scene.tethers, scene.marks, certificates.uses
    now, time = moment.now, moment.time
    overtaken = 0
    for number in range(tethers.numbers[TIED]):
        first, second = tethers.rows[number, 0], tethers.rows[number, 1]
        news = (
            marks.revision[first] - tethers.revision[number, 0],
            marks.revision[second] - tethers.revision[number, 1],
        )
        if news[0] == 0 and news[1] == 0:
            continue
        tethers.revision[number, 0] = marks.revision[first]
        tethers.revision[number, 1] = marks.revision[second]
        breaks = follow_tether(tethers, number, scene.bodies, marks, now, mending)
        for side in range(2):
            row, partner = (first, second) if side == 0 else (second, first)
            stands = not breaks
            for use in range(USES):
                place = row * USES + use
                if stands and uses.partner[place] == partner:
                    if _is_over(certificates, row, use, time):
                        uses.partner[place] = NO_PARTNER
                        continue
                    stands = _stands(scene, certificates, place, row, news[1 - side], news[side])
            if not stands:
                drop_uses(uses, row)
                # What committed pieces rest on may be lost, though no certificate is.
                overtaken += 1
                if certificates.watched[row].any():
                    invalidate(certificates, row)
    if overtaken > 0:
        withdraw_permissions(certificates)
    return overtaken


@kernel
def _is_over(certificates: Certificates, row: int, use: int, time: float) -> bool:
    """Whether it is a proof of a stop that has ended, so that it rests on nothing."""
    if use == CERTIFICATE:
        return False
    is_paced = use in (ASKED + 1, NOT_ASKED + 1)
    return not certificates.proofs.until[stop_place(row, is_paced)] >= time


@kernel
def _stands(
    scene: Scene, certificates: Certificates, place: int, row: int, news: int, own_news: int
) -> bool:
    """Whether a proof by a partner's state still holds; see `tether_uses`.

    Args:
        scene: The tick.
        certificates: Among which the proof is.
        place: Of the use.
        row: That it is about.
        news: By how much the partner's revision has gone up since it was compared last.
        own_news: By how much the row's own has.
    """
    uses, marks = certificates.uses, scene.marks
    partner = uses.partner[place]
    if news > 0:
        is_same = news == 1 and not marks.refused[partner]
        if not (is_same and agrees(scene.bodies, marks, uses.states, partner, place)):
            return False
    if own_news > 0 and marks.has_state[row]:
        excess = find_excess(uses.states, place, scene.bodies, row, uses.length[place])
        return own_news == 1 and not excess > 0.0
    return True


@kernel
def _enter_pair(
    scene: Scene,
    certificates: Certificates,
    row: int,
    link: int,
    contact_time: float,
    limit: ContactLimit,
    moment: Moment,
) -> float:
    """Enter until when a pair's certificates hold; before when it can do no harm, in [s]."""
    harm_time = contact_time
    if limit.max_speed > 0.0 and contact_time < moment.refinement_threshold:
        harm_time = find_harm_time(scene, link, row, moment.now, limit, contact_time)
    certificates.pair_expiry[row, link] = expire(moment.time, contact_time)
    certificates.pair_harm[row, link] = expire(moment.time, harm_time)
    return harm_time


@kernel
def _evaluate_links(
    scene: Scene,
    certificates: Certificates,
    row: int,
    moment: Moment,
    lower_bound: float,
    partner: Partner,
) -> tuple[float, float, int]:
    """Evaluate all watched links of one obstacle: soonest contact and harm in [s], evaluations.

    `partner` is that of `partner_of`.
    """
    now, _, _, arm_age, refinement_threshold = moment
    links = certificates.watched.shape[1]
    is_tethered = partner.row != NO_PARTNER
    evaluations = 0
    best = harm = np.inf
    limit = limit_of(scene, row)
    # `best` is the soonest contact time so far: a link that cannot beat it is not refined.
    if scene.marks.refused[row]:
        # More than one state may be true; each link is evaluated by all of them.
        for each in range(links):
            if not certificates.watched[row, each]:
                continue
            found, node, bound, spent = pair_time(
                scene, each, row, now, arm_age, lower_bound, refinement_threshold, best
            )
            evaluations += spent
            best = min(best, found)
            harm = min(harm, _enter_pair(scene, certificates, row, each, found, limit, moment))
            certificates.pair_sphere[row, each] = node
            certificates.pair_bound[row, each] = bound
        return best, harm, evaluations
    state, partners_state = own_place(scene, row, 0, now), partner_place(scene, partner, now)
    # What links cannot leave comes first; UNKNOWN marks those of whose spheres nothing is known.
    for each in range(links):
        if certificates.watched[row, each]:
            time = link_reach_time(scene, each, state, lower_bound)
            evaluations += 1
            if is_tethered and time < refinement_threshold:
                time = link_reach_time(scene, each, partners_state, time)
                evaluations += 1
            scene.link_time[each] = time
            scene.link_bound[each] = UNKNOWN
    # Each round takes the most imminent link that is left: once to know the sphere around it, once
    # to be refined, in an order by which later ones seldom need either. -1 marks those done.
    for _ in range(2 * links):
        link: Any = np.int64(-1)
        for other in range(links):
            left = scene.link_time[other] >= 0.0 and certificates.watched[row, other]
            if left and (link < 0 or scene.link_time[other] < scene.link_time[link]):
                link = other
        if link < 0:
            break
        found, bound = scene.link_time[link], scene.link_bound[link]
        node = scene.tree.root[link]
        if found < best and found < refinement_threshold:
            if bound == UNKNOWN:
                found, bound = root_time(scene, link, state, arm_age, found)
                evaluations += 1
                if is_tethered and found < best and found < refinement_threshold:
                    later, kind = root_time(scene, link, partners_state, arm_age, found)
                    evaluations += 1
                    if later > found:
                        found, bound = later, kind
                scene.link_time[link] = found
                scene.link_bound[link] = bound
                continue
            if is_tethered:
                found, node, bound, spent = link_time(
                    scene, link, partners_state, arm_age, found, bound, refinement_threshold, best
                )
                evaluations += spent
            # What the partner's state says of the link is a bound for each of its spheres.
            if found < best and found < refinement_threshold:
                found, node, bound, spent = link_time(
                    scene, link, state, arm_age, found, bound, refinement_threshold, best
                )
                evaluations += spent
        scene.link_time[link] = -1.0
        best = min(best, found)
        harm = min(harm, _enter_pair(scene, certificates, row, link, found, limit, moment))
        certificates.pair_sphere[row, link] = node
        certificates.pair_bound[row, link] = REACH if bound == UNKNOWN else bound
    return best, harm, evaluations


@kernel
def _evaluate_obstacle(
    scene: Scene,
    certificates: Certificates,
    row: int,
    q: FloatArray,
    v: FloatArray,
    placed: bool,
    moment: Moment,
) -> tuple[float, float, int]:
    """Evaluate one obstacle: its soonest contact and harm in [s], and evaluations.

    Both times are NaN, and nothing is entered, where the arm must be placed first.
    """
    now, time, refinement_threshold = moment.now, moment.time, moment.refinement_threshold
    best, evaluations = 0.0, 0
    bound = UNKNOWN
    partner = ALONE
    if is_known(scene.marks, row):
        best, evaluations = arm_reach_time(scene, row, now)
        bound = REACH
        if best < refinement_threshold:
            partner = partner_of(scene, row, now, refinement_threshold)
            if partner.row != NO_PARTNER:
                best = max(best, partner_reach_time(scene, partner, now))
                evaluations += 1
        if best < refinement_threshold and not placed:
            return np.nan, np.nan, evaluations
    if scene.tethers.numbers[TIED] > 0:
        keep_use(certificates.uses, scene.bodies, row, CERTIFICATE, partner)
    if bound == REACH and best < refinement_threshold:
        _prepare_for(scene, certificates, q, v, moment)
        best, harm, spent = _evaluate_links(scene, certificates, row, moment, best, partner)
        set_ends(certificates, row, expire(time, best), expire(time, harm))
        return best, harm, evaluations + spent
    expiry = expire(time, best)
    for link in range(certificates.watched.shape[1]):
        certificates.pair_expiry[row, link] = certificates.pair_harm[row, link] = expiry
        certificates.pair_sphere[row, link] = scene.tree.root[link]
        certificates.pair_bound[row, link] = bound
    set_ends(certificates, row, expiry, expiry)
    return best, best, evaluations


@kernel
def time_to_spare(
    scene: Scene, v: FloatArray, contact_time: float, arm_age: float, braking_delay: float
) -> float:
    """Time in [s] in which a contact time cannot matter to a stop, the arm's speeding up included.

    Too long a time would cost false stops, never safety: what counts is the end of certificates.
    """
    limits = scene.limits
    spare = np.inf
    for j in range(v.shape[0]):
        top, accel = limits.operating_velocity[j], limits.operating_acceleration[j]
        speed = abs(v[j]) + 3.0 * limits.velocity_error[j]
        speed += accel * (max(arm_age, 0.0) + braking_delay)
        left = contact_time - braking_delay
        spare = min(
            spare, _joint_time_to_spare(limits.brakes, j, min(top, speed), top, accel, left)
        )
    return spare


@kernel
def _joint_time_to_spare(
    brakes: BrakeCurves, joint: int, speed: float, top: float, accel: float, left: float
) -> float:
    """Longest time in [s] after which a joint that speeds up meanwhile still rests in `left` [s].

    Entry by entry: within the speeds of one, a joint that is at u + a w after w rests within the
    lesser of T and (u + a w) / b. Once it is past the last, or at its top speed, it gets no slower
    to rest.
    """
    if left == np.inf:
        # Where no contact can ever come.
        return np.inf
    spare = -np.inf
    last = brakes.speed.shape[1] - 1
    for step in range(last + 1):
        bound = brakes.speed[joint, step]
        if not (speed <= bound or step == last):
            continue
        time, slows = brakes.time[joint, step], brakes.deceleration[joint, step]
        within = max(left - time, (left * slows - speed) / (slows + accel))
        if step == last or top <= bound:
            # No faster than this, it rests no later than from its top speed.
            return max(spare, max(within, left - min(time, top / slows)))
        reached = (bound - speed) / accel
        spare = max(spare, min(within, reached))
        if not within >= reached:
            break
    return spare


class TickData(NamedTuple):
    """All that the compiled tick reads and writes."""

    scene: Scene
    certificates: Certificates
    guard: Guard
    """What joint states are compared with; holds the positions and velocities believed last."""
    operating: OperatingRecord
    """What joint states are tested against that are to keep operating limits."""
    braking_delay: float
    """Period plus latency plus reaction time, in [s]."""
    max_staleness: float
    """How stale an answer may look, as a fraction of itself."""
    aware_margin: float
    """Beyond the stopping time, in [s]: what could be touched within is refined."""
    period: float
    """Of ticks, in [s]."""
    budget: int
    """Evaluations in a tick after which nothing further is begun."""
    crowd: int
    """The same once a STOP is certain."""
    rise_delay: float
    """For how long states must agree with a tether that they have broken, in [s]."""
    decides: bool
    """Whether a stop decision is asked where a contact time alone would stop the arm."""


@kernel
def tick_of(time: float, period: float) -> int:
    """Number of the tick at a time, to the nearest: those of a loop are never quite on time."""
    return int(time / period + 0.5)


@kernel
def _find_first(certificates: Certificates) -> tuple[int, int, float]:
    """Row and link whose certificate ends first, and that end; NOBODY where nothing is watched."""
    watched, tournament = certificates.watched, certificates.expiry_tree
    if certificates.numbers[ACTIVE] == 0:
        return NOBODY, 0, np.inf
    row = find_least(tournament)
    while not watched[row].any():
        # The certificates of unwatched rows never end either.
        row += 1
    return row, first_link(watched, certificates.pair_expiry, row), tournament[ROOT]


@kernel
def find_first_harm(handle: Any) -> tuple[int, int, float]:
    """Row and link that could touch first where that is not permitted, and when, since the epoch.

    Args:
        handle: On `Certificates` of which some are active.
    """
    certificates = handle.content
    row = find_least(certificates.harm_tree)
    while not certificates.watched[row].any():
        row += 1
    link = first_link(certificates.watched, certificates.pair_harm, row)
    return row, link, certificates.harm_tree[ROOT]


@kernel
def evaluate_due(
    handle: Any, placed: bool, spent_before: int, moment: Moment
) -> tuple[int, int, float, int, int, int, int]:
    """Evaluate what is due in a tick, as far as the budget goes.

    Where a STOP is certain already, what still waits is not overdue: the arm stops in any case,
    and goes on only when all of it has been evaluated, or the stop decision was made about it.

    Args:
        handle: On a `TickData`.
        placed: Whether Pinocchio has placed the arm for this tick.
        spent_before: Evaluations of this tick before the arm was placed.
        moment: The tick.

    Returns:
        Row whose certificate ends first (NOBODY without any, UNPLACED where the arm must be placed
        before the evaluations can go on), its link, the end in [s] since the epoch, obstacles
        overdue, evaluations, rows that changes have overtaken, and obstacles whose certificates
        have ended, which are overdue unless the stop decision is made about them.
    """
    found: tuple[int, int, float, int, int, int, int] = _evaluate_due(
        handle, placed, spent_before, moment
    )
    return found


@kernel
def _read_ahead(scene: Scene, certificates: Certificates) -> int:
    """Read a word of each cache line that the evaluations of what waits begin with.

    Of very many obstacles each one's records lie in memory that is not at hand. Evaluations, which
    follow one upon the other, would wait for line after line. Of these readings none depends on
    another, so that the processor has many of them under way at the same time. With 10,000 far
    obstacles the median tick of `bench_schedules` takes a third less for it.

    Returns:
        Some number that depends on all of them, to be kept: else the compiler would leave them out.
    """
    wheel, bodies, marks = certificates.wheel, scene.bodies, scene.marks
    references, tree = certificates.reference_states, certificates.expiry_tree
    first = parent_of(tree.shape[0])
    last = certificates.watched.shape[1] - 1
    some = 0
    for place in range(min(wheel.numbers[WAITING], MOST_READ_AHEAD)):
        row = wheel.heap[place]
        some += bodies.point_count[row] + references.point_count[row]
        some += bodies.stamp[row] + references.stamp[row] > 0.0
        some += certificates.evaluated_at[row] + certificates.pair_expiry[row, last] > 0.0
        some += tree[first + row] + tree[parent_of(first + row)] > 0.0
        some += marks.refused_count[row] + marks.has_state[row] + marks.unknown[row]
        some += marks.static[row] + marks.refused[row] + certificates.watched[row, last]
    return some


@separate_kernel
def _evaluate_due(
    handle: Any, placed: bool, spent_before: int, moment: Moment
) -> tuple[int, int, float, int, int, int, int]:
    """`evaluate_due`, made once for all that call it.

    Invariant: a watched row either waits, with a deadline, or stands in a slot of the wheel.
    """
    watching = handle.content
    time, tick = moment.time, moment.number
    scene, certificates = watching.scene, watching.certificates
    q, v = watching.guard.q, watching.guard.v
    braking_delay, max_staleness = watching.braking_delay, watching.max_staleness
    period, budget, decides = watching.period, watching.budget, watching.decides
    crowd = watching.crowd
    # With what could be touched sooner, a STOP is certain: before brakes bite, or another tick.
    soonest = braking_delay if decides else period
    # After a STOP by its decision another one is to be expected. What waits for that is not
    # overlooked: the decision asks for every pair that has no certificate for long enough.
    expects_stop = decides and tick - 1 <= certificates.numbers[UNSAFE] <= tick
    wheel = certificates.wheel
    # What has changed falls due now.
    overtaken = _read_changes(scene, certificates)
    if scene.tethers.numbers[TIED] > 0:
        overtaken += _read_tethers(scene, certificates, moment, watching.rise_delay)
    clock = tick_of(time, period)
    turn(wheel, clock)
    if not expects_stop:
        certificates.numbers[READ_AHEAD] = _read_ahead(scene, certificates)
    # The most urgent row first, until nothing waits or the budget is spent.
    evaluated = spent_before
    certain = expects_stop
    while evaluated < budget and not (certain and evaluated > crowd):
        row = most_urgent(wheel)
        if row == NOBODY:
            break
        contact_time, harm_time, spent = _evaluate_obstacle(
            scene, certificates, row, q, v, placed, moment
        )
        evaluated += spent
        if math.isnan(contact_time):
            # The row still waits: the next call begins with it.
            return UNPLACED, 0, 0.0, 0, evaluated, overtaken, 0
        # Enter the evaluation and what it rests on.
        certificates.evaluated_at[row] = time
        certificates.numbers[EVALUATED_ROWS] += 1
        certificates.numbers[SPENT] += spent
        keep_reference_state(scene.bodies, certificates.reference_states, scene.marks, row, row)
        # Back into the wheel, for when its answer would look stale, or the row matter to a stop.
        wait, deadline = max_staleness * contact_time, expire(time, contact_time)
        if not decides:
            spare = time_to_spare(scene, v, contact_time, moment.arm_age, braking_delay)
            if not is_known(scene.marks, row):
                spare = 0.0
            wait, deadline = min(spare, wait), time + spare
        certain = certain or harm_time <= soonest
        due = clock + (int(min(wait / period, 1e9)) if wait > 0.0 else 0)
        put_off(wheel, row, due, deadline)
    if certificates.numbers[EVALUATED_ROWS] > RECENT:
        certificates.numbers[EVALUATED_ROWS] //= 2
        certificates.numbers[SPENT] //= 2
    # What still waits is late: overdue where its deadline has passed, else merely stale.
    late = 0
    for place in range(wheel.numbers[WAITING]):
        deadline = wheel.deadline[wheel.heap[place]]
        passed = not deadline > time if decides else deadline < time
        if passed and not certain:
            late += 1
    # Watched rows that are neither in the wheel nor waiting would never fall due.
    lost = abs(certificates.numbers[ACTIVE] - wheel.numbers[WAITING] - wheel.numbers[TURNING])
    overdue = lost + (0 if decides else late)
    row, link, expiry = _find_first(certificates)
    return row, link, expiry, overdue, evaluated, overtaken, late if decides else 0


@kernel
def advance(
    handle: Any,
    stamp: float,
    q: FloatArray,
    v: FloatArray,
    now: float,
    epoch: float,
    number: int,
    may_evaluate: bool,
) -> tuple[int, int, float, float, float, int, int, float, int, int, int, int]:
    """Accept a joint state if there is nothing to be said against it, and evaluate what is due.

    Args:
        handle: On a `TickData`.
        stamp: When the state was measured, in [s].
        q: Joint positions, [rad] or [m]; any strides. Shape (nv,).
        v: Joint velocities, [rad/s] or [m/s]; any strides. Shape (nv,).
        now: Time of the tick, in [s].
        epoch: Since when the monitor counts time, in [s].
        number: Of the tick.
        may_evaluate: Whether nothing needs to be done between state and evaluations.

    Returns:
        See `scheduler.AdvanceResult`.
    """
    found, joint, stop_time, late_stop_time = accept(handle.content.guard, stamp, q, v, now)
    if found >= BELIEVED:
        # The state as the guard now has it: continuous joints whole turns nearest to the last.
        guard = handle.content.guard
        if not keeps_operating_limits(handle.content.operating, stamp, guard.q, guard.v):
            found |= UNKEPT
    if found != BELIEVED or not may_evaluate:
        return found, joint, stop_time, late_stop_time, 0.0, UNSEEN, 0, 0.0, 0, 0, 0, 0
    refinement_threshold = (stop_time + handle.content.aware_margin) / (
        1.0 - handle.content.max_staleness
    )
    moment = Moment(now, now - epoch, number, now - stamp, refinement_threshold)
    row, link, expiry, overdue, evaluated, overtaken, ended = _evaluate_due(
        handle, bool(0), np.int64(0), moment
    )
    return (
        found,
        joint,
        stop_time,
        late_stop_time,
        refinement_threshold,
        row,
        link,
        expiry,
        overdue,
        evaluated,
        overtaken,
        ended,
    )


@kernel
def _is_proved(
    scene: Scene, certificates: Certificates, is_paced: bool, row: int, told: float, since: float
) -> bool:
    """Whether it is proved that an arm told to stop by `told` rests before it touches a row."""
    proofs, place = certificates.proofs, stop_place(row, is_paced)
    if not (told <= proofs.until[place] and since <= proofs.made_at[place]):
        return False
    if scene.marks.refused[row]:
        return False
    revision = scene.marks.revision[row]
    if proofs.known.revision[place] == revision:
        return True
    # Each sample is compared: after two of them nothing holds. It must agree with the reference
    # state as well, by which some links were not asked.
    if (
        proofs.known.revision[place] + 1 == revision
        and agrees(scene.bodies, scene.marks, proofs.known.states, row, place)
        and agrees(scene.bodies, scene.marks, proofs.reference_states, row, place)
    ):
        proofs.known.revision[place] = revision
        return True
    proofs.until[place] = -np.inf
    return False


@kernel
def _is_paused(scene: Scene, certificates: Certificates, row: int, place: int, time: float) -> bool:
    """Whether a row was asked about in vain a moment ago, and nothing newer is known of it.

    Most can be proved when it has just been measured: then it can be least elsewhere. Without that
    `bench_near` asks twice as many questions beside 1,000 near balls, and its median rises by 18 %.
    """
    proofs = certificates.proofs
    is_same: bool = proofs.retry_revision[place] == scene.marks.revision[row]
    return is_same and proofs.retry_at[place] > time


@kernel
def _outlasts(
    scene: Scene, link: int, row: int, moment: Moment, stop_time: float
) -> tuple[bool, int]:
    """Whether a pair cannot touch within the stop, by a fresh evaluation; and what that took."""
    now, arm_age = moment.now, moment.arm_age
    lower_bound, evaluations = arm_reach_time(scene, row, now)
    found, _, _, spent = pair_time(scene, link, row, now, arm_age, lower_bound, stop_time, np.inf)
    return found > stop_time, evaluations + spent


@kernel
def find_unsafe(
    handle: Any, moment: Moment, question: StopQuestion, rows: IntArray
) -> tuple[int, int, int, int]:
    """The first pair that might touch before the arm rests, by the scene's table of braking.

    Only what could be touched within some time is evaluated. Where the budget is spent, the
    obstacle at hand counts as unsafe. A pair of which the table does not prove that the arm rests
    is evaluated afresh, unless it was in this tick: its certificate may only have grown stale.

    A table whose brakes may bite at any time up to so much later proves as much of an arm that is
    told to stop that much later: it does then what that table allows for. The proof is kept by
    row. It covers the links that were not asked as well: their certificates outlast the table. The
    table of an arm whose joints keep to a speed scale proves it for as long as they do.

    Args:
        handle: On a `TickData`.
        moment: The tick.
        question: What is asked of it.
        rows: Room to work in, for all rows of the obstacle table.

    Returns:
        Row and link, NOBODY if the arm surely rests before it touches anything; evaluations, and
        how many obstacles were not decided about when the budget was spent, 0 if it was not.
    """
    scene, certificates = handle.content.scene, handle.content.certificates
    now, time, tick = moment.now, moment.time, moment.number
    stop_time, within, lasting, until, pause, is_paced, since, last_offender, budget = question
    proofs = certificates.proofs
    guard = handle.content.guard
    if certificates.numbers[MOVED] != tick:
        # Where its spheres are is all that is asked of the arm beside the table.
        move_spheres(scene.placement, guard.v)
        certificates.numbers[MOVED] = tick
    latest = time + stop_time
    count = find_below(certificates.harm_tree, min(time + within, LATEST), rows)
    # The last offender first: one unsafe pair is answer enough. Without that 1 % of ticks beside 3
    # people and 20 parts, in `bench_near`, would take more than 339 evaluations instead of 259.
    links = certificates.watched.shape[1]
    offending_row, offending_link = last_offender // links, last_offender % links
    for i in range(count):
        if rows[i] == offending_row:
            rows[0], rows[i] = rows[i], rows[0]
    evaluations = doubtful = 0
    first_row, first_link_of_row = NOBODY, NOBODY
    # Invariant: rows before the present one are out of the way of a stop, but for doubtful ones.
    # What is proved, but not for much longer, follows in a second round: one table serves both.
    told = time + until
    for i in range(2 * count if lasting > 0.0 else count):
        row, renews = rows[i % count], i >= count
        place = stop_place(row, is_paced)
        is_paused = _is_paused(scene, certificates, row, place, time)
        is_proved = lasting >= 0.0 and _is_proved(scene, certificates, is_paced, row, told, since)
        if renews:
            ends_soon = proofs.until[place] - told < AHEAD * (lasting - until)
            # By the question that proves as much of it as can be.
            fits = is_paused != (pause > 0.0) and evaluations < MOST_AHEAD
            if not (is_proved and ends_soon and fits):
                continue
        elif is_proved:
            continue
        elif pause > 0.0 and is_paused:
            # It was asked in vain a moment ago.
            if first_row == NOBODY:
                first_row = row
                first_link_of_row = first_link(certificates.watched, certificates.pair_expiry, row)
            continue
        rests = True
        permitted, permitted_link = 0.0, -1
        for number in range(links):
            link = number
            if row == offending_row:
                # The others after it, in their order.
                link = (offending_link + number) % links
            if not certificates.watched[row, link]:
                continue
            if certificates.pair_harm[row, link] > latest:
                # Where it may touch before, that rests on a permission, and may be at the limit.
                if not certificates.pair_expiry[row, link] > latest:
                    limit = limit_of(scene, row).max_speed
                    if limit > permitted:
                        permitted, permitted_link = limit, link
                continue
            answer, spent, speed, _ = rests_in_time(scene, link, row, now, budget - evaluations)
            evaluations += spent
            if answer == RESTS:
                if speed > permitted:
                    permitted, permitted_link = speed, link
                continue
            is_stale = certificates.evaluated_at[row] != time and is_known(scene.marks, row)
            if answer == TOUCHES and is_stale and not lasting > 0.0:
                _prepare_for(scene, certificates, guard.q, guard.v, moment)
                outlasts, spent = _outlasts(scene, link, row, moment, stop_time)
                evaluations += spent
                if outlasts:
                    continue
            rests = False
            if answer == TOUCHES and pause > 0.0:
                proofs.retry_at[place] = time + pause
                proofs.retry_revision[place] = scene.marks.revision[row]
            if renews:
                # What was proved of it stands.
                break
            doubtful += 1
            if first_row == NOBODY:
                first_row, first_link_of_row = row, link
            if answer == UNDECIDED or not lasting > 0.0 or doubtful > MOST_DOUBTFUL:
                left = count - i if answer == UNDECIDED else 0
                if lasting == 0.0 and answer == TOUCHES and not is_paced:
                    certificates.numbers[UNSAFE] = tick
                return first_row, first_link_of_row, evaluations, left
            # It is asked again by itself, by a table of this tick alone: on to the others.
            break
        # The table of something else says nothing of an arm that is told to stop.
        if rests and lasting >= 0.0:
            proofs.speed[place], proofs.link[place] = permitted, permitted_link
            proofs.asked_at[place] = time
        if rests and lasting > 0.0 and not scene.marks.refused[row]:
            proofs.until[place] = expire(time, lasting)
            proofs.made_at[place] = time
            keep_known_state(scene.bodies, scene.marks, proofs.known, row, place)
            copy_state(certificates.reference_states, row, proofs.reference_states, place)
            if scene.tethers.numbers[TIED] > 0:
                partner = partner_of(scene, row, now, scene.braking.time[-1])
                keep_use(certificates.uses, scene.bodies, row, ASKED + is_paced, partner)
                copy_use(certificates.uses, row, CERTIFICATE, NOT_ASKED + is_paced)
    return first_row, first_link_of_row, evaluations, 0


@kernel
def recall_stops(
    handle: Any,
    tick: int,
    time: float,
    told: float,
    latest: float,
    soon: float,
    is_paced: bool,
    since: float,
    rows: IntArray,
) -> int:
    """Whether earlier proofs say that an arm which is told to stop by then rests in time.

    Args:
        handle: On a `TickData`.
        tick: Its number.
        time: Of the tick, in [s] since the epoch.
        told: When it is told at the latest, in [s] since the epoch.
        latest: When it surely rests then, in [s] since the epoch.
        soon: Proofs of what is told less than so much later than that, in [s], end soon.
        is_paced: As in a `StopQuestion`.
        since: As in a `StopQuestion`.
        rows: Room to work in, for all rows of the obstacle table.

    Returns:
        PROVED, if all that could be touched by `latest` is out of its way; ENDING if so it is, some
        proof of that ends soon, and nothing was evaluated or asked in this tick; IN_VAIN if all
        that is not proved was asked a moment ago already; else ASKABLE.
    """
    scene, certificates = handle.content.scene, handle.content.certificates
    # A tick that has had to lay out the arm has work to do already.
    has_slack = certificates.numbers[MOVED] != tick
    answer = PROVED
    for row in rows[: find_below(certificates.harm_tree, min(latest, LATEST), rows)]:
        place = stop_place(row, is_paced)
        if _is_proved(scene, certificates, is_paced, row, told, since):
            ends_soon = has_slack and not certificates.proofs.until[place] >= told + soon
            if (
                answer == PROVED
                and ends_soon
                and not _is_paused(scene, certificates, row, place, time)
            ):
                answer = ENDING
        elif _is_paused(scene, certificates, row, place, time):
            answer = IN_VAIN
        else:
            return ASKABLE
    return answer


@kernel
def find_touch(handle: Any, moment: Moment, rows: IntArray) -> tuple[int, int]:
    """Row and link of an obstacle that is touched as is permitted.

    NOBODY if there is none. A pair whose certificate holds does not touch. Each row's mark says
    from now on whether it is touched.

    Args:
        handle: On a `TickData` of which the arm was placed.
        moment: The tick, after its evaluations.
        rows: Room to work in, for all rows of the obstacle table.
    """
    scene, certificates = handle.content.scene, handle.content.certificates
    touched = scene.marks.touched
    touched[:] = False
    found_row, found_link = NOBODY, 0
    for row in rows[: find_below(certificates.expiry_tree, moment.time, rows)]:
        if not limit_of(scene, row).max_speed > 0.0:
            continue
        guard = handle.content.guard
        _prepare_for(scene, certificates, guard.q, guard.v, moment)
        link = find_touching_link(scene, row, certificates.watched[row], moment.now)
        if link == NO_LINK:
            continue
        touched[row] = True
        if found_row == NOBODY:
            found_row, found_link = row, link
    return found_row, found_link


@kernel
def find_permitted_contact(
    handle: Any, time: float, latest: float, rows: IntArray
) -> tuple[int, int, float, float, float]:
    """The contact that is permitted and possible by some time, of those the one nearest its limit.

    Args:
        handle: On a `TickData`, of a tick whose stop decision was made, and was that the arm rests.
        time: Of the tick, in [s] since the epoch.
        latest: By when contact is meant, in [s] since the epoch.
        rows: Room to work in, for all rows of the obstacle table.

    Returns:
        Row and link, NOBODY if there is none; how fast the link's surface is then at most, in
        [m/s], were the arm told to stop by the next verdict; its limit; and how fast at most any
        link is then that may touch.
    """
    scene, certificates = handle.content.scene, handle.content.certificates
    proofs = certificates.proofs
    found_row, found_link, found_speed, found_limit = NOBODY, NOBODY, 0.0, np.inf
    greatest = 0.0
    for row in rows[: find_below(certificates.expiry_tree, min(latest, LATEST), rows)]:
        limit = limit_of(scene, row).max_speed
        # Where nothing had to be asked, no link gets faster than its limit before the arm rests.
        speed, link = limit, first_link(certificates.watched, certificates.pair_expiry, row)
        own, paced = stop_place(row, bool(0)), stop_place(row, bool(1))
        is_proved = _is_proved(scene, certificates, bool(0), row, time, -np.inf)
        if is_proved or proofs.asked_at[own] == time:
            speed, link = proofs.speed[own], proofs.link[own]
        elif proofs.asked_at[paced] == time:
            speed, link = proofs.speed[paced], proofs.link[paced]
        greatest = max(greatest, speed)
        if speed > 0.0 and speed * found_limit >= found_speed * limit:
            found_row, found_link, found_speed, found_limit = row, link, speed, limit
    return found_row, found_link, found_speed, found_limit, greatest
