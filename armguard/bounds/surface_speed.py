"""How fast the surface of the arm can be, and how far it can still go.

With c the centre of a sphere of the cover, r its radius, q_f the configuration that displacements
D_i count from, J_j the columns of the centre's Jacobian there, and velocities of joint j between
lo_j and hi_j (in the middle m_j, half their width h_j, at most u_j = max(|lo_j|, |hi_j|)), each
point of the arm inside the sphere is no faster than

    |sum_j J_j m_j| + sum_j |J_j| h_j + sum_ij R_max(i, j) (|D_i| + dq_i) u_j + r sum_j u_j.

The third sum runs over ordered pairs, whose joint nearer to the base is revolute: by a radian of
joint i the column of joint j changes by R_max(i, j) at most. The position errors dq_i are those of
q_f. The last sum, over the revolute joints that move the sphere, is how fast the link turns at
most. In place of the first two sums stands the root of

    sum_ij max (J_i . J_j) w_i w_j    over w_i in [lo_i, hi_i] and w_j in [lo_j, hi_j]

where that is less, as it is while joints brake: each velocity lies between 0 and what it was then.
The first three sums together are no more than sum_j R_j u_j.

The same sums bound how far the point can go between any two moments of a time, with the way that
each joint can go in that time, to either side, in place of its velocity.
"""

from __future__ import annotations

import math

from armguard.bounds.joint_box import JointBox, set_columns
from armguard.bounds.joint_table import JointTable, set_span
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING


@kernel
def _largest_product(low1: float, high1: float, low2: float, high2: float, weight: float) -> float:
    """Greatest of weight * a * b over a in [low1, high1] and b in [low2, high2]."""
    first, second = weight * low1, weight * high1
    return max(max(first * low2, first * high2), max(second * low2, second * high2))


@kernel
def speed_in_box(
    radius: float,
    lever: FloatArray,
    moves: BoolArray,
    slowest: FloatArray,
    fastest: FloatArray,
    box: JointBox,
) -> float:
    """Bound on the speed of each point within a distance of another, in [m]/[s].

    Args:
        radius: That distance, in [m].
        lever: R_j of the point at its centre, whose columns are in `box`. Shape (nv,).
        moves: Which joints move it. Shape (nv,).
        slowest: Least velocities of the joints, in [rad]/[s] or [m]/[s]. Shape (nv,).
        fastest: Greatest velocities, alike.
        box: Where joints are.
    """
    x = y = z = spread = bend = most = spin = square = 0.0
    # From the base to the tip: angles and rates of the revolute joints before joint j.
    angle = rate = 0.0
    for j in range(lever.shape[0]):
        pace = max(fastest[j], -slowest[j])
        if moves[j] and box.turning[j]:
            spin += pace
        if not lever[j] > 0.0:
            continue
        a, b, c = box.columns[0, j], box.columns[1, j], box.columns[2, j]
        middle, half = 0.5 * (fastest[j] + slowest[j]), 0.5 * (fastest[j] - slowest[j])
        x, y, z = x + a * middle, y + b * middle, z + c * middle
        length2 = a * a + b * b + c * c
        spread += math.sqrt(length2) * half
        square += length2 * pace * pace
        for i in range(j):
            if lever[i] > 0.0:
                product = a * box.columns[0, i] + b * box.columns[1, i] + c * box.columns[2, i]
                square += 2.0 * _largest_product(
                    slowest[i], fastest[i], slowest[j], fastest[j], product
                )
        size = box.span[2, j] + box.position_error[j]
        bend += lever[j] * (angle * pace + size * rate)
        if box.turning[j]:
            bend += lever[j] * size * pace
            angle += size
            rate += pace
        most += lever[j] * pace
    # The rounding of a sum of squares of at most `most` each; the root of it is below 1e-7 of that.
    center = math.sqrt(max(square, 0.0) + SUM_ROUNDING * most * most)
    center = min(center, math.sqrt(x * x + y * y + z * z) + spread)
    speed = min(center + bend, most) + radius * spin
    # The columns of a point far from the origin were rounded as its place was.
    return speed + SUM_ROUNDING * (most + spin * (1.0 + radius))


@kernel
def _speed_from(
    sphere: ArmSphere, radius: float, moves: BoolArray, table: JointTable, node: int
) -> float:
    """Bound on the speed of a sphere's points from a node of a braking table on until it rests."""
    last = table.time.shape[0] - 1
    if node >= last:
        return 0.0
    set_span(table, node, last, 1.0)
    speed: float = speed_in_box(
        radius, sphere.lever, moves, table.slowest[node], table.fastest[node], table.box
    )
    return speed


@kernel
def way_from(
    sphere: ArmSphere, radius: float, moves: BoolArray, table: JointTable, node: int
) -> float:
    """Bound on how far they can still go from then on, in [m]."""
    last = table.time.shape[0] - 1
    if node >= last:
        return 0.0
    forth, back = table.box.forth, table.box.back
    for j in range(forth.shape[0]):
        forth[j] = back[j] = whole = 0.0
        for k in range(node, last):
            duration = (table.time[k + 1] - table.time[k]) * (1.0 + SUM_ROUNDING)
            up, down = max(table.fastest[k, j], 0.0), min(table.slowest[k, j], 0.0)
            forth[j] += up * duration
            back[j] += down * duration
            whole += max(up, -down) * duration
        # One that goes forth and back goes farther in all than to either side.
        if forth[j] >= -back[j]:
            forth[j] = whole
        else:
            back[j] = -whole
    set_span(table, node, last, 1.0)
    way: float = speed_in_box(radius, sphere.lever, moves, back, forth, table.box)
    return way


@kernel
def _is_harmless_from(
    sphere: ArmSphere,
    radius: float,
    moves: BoolArray,
    table: JointTable,
    node: int,
    max_speed: float,
    max_way: float,
) -> bool:
    speed = _speed_from(sphere, radius, moves, table, node)
    if not speed <= max_speed:
        return False
    return max_way == math.inf or way_from(sphere, radius, moves, table, node) <= max_way


@kernel
def find_harmless_node(
    sphere: ArmSphere,
    radius: float,
    moves: BoolArray,
    table: JointTable,
    max_speed: float,
    max_way: float,
) -> tuple[int, float]:
    """From when on a sphere of a braking arm is harmless until the arm rests.

    From the node's time on no point of the arm inside the sphere is faster than a limit, and none
    can go farther than a way. At rest both are 0, so that there always is such a node.

    Args:
        sphere: Of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        table: Of an arm that brakes until it rests, with velocities.
        max_speed: The limit, in [m]/[s], >= 0; at 0, when the arm rests.
        max_way: The way, in [m]; inf: any.

    Returns:
        The node, and the bound on the speed from then on, in [m]/[s].
    """
    last = table.time.shape[0] - 1
    if not (max_speed > 0.0 and max_way > 0.0):
        return last, 0.0
    if not set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box):
        return last, 0.0
    if _is_harmless_from(sphere, radius, moves, table, 0, max_speed, max_way):
        return 0, _speed_from(sphere, radius, moves, table, 0)
    # Invariant: it is harmless from `later` on, and not known to be from `sooner` on.
    sooner, later = 0, last
    while later - sooner > 1:
        middle = (sooner + later) // 2
        if _is_harmless_from(sphere, radius, moves, table, middle, max_speed, max_way):
            later = middle
        else:
            sooner = middle
    return later, _speed_from(sphere, radius, moves, table, later)


@kernel
def harmless_time(
    sphere: ArmSphere, radius: float, moves: BoolArray, table: JointTable, max_speed: float
) -> float:
    """Up to when no point of a sphere of an arm that is free can be faster than a limit, in [s].

    Args:
        sphere: Of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        table: Of an arm that is free to move, with velocities.
        max_speed: The limit, in [m]/[s].

    Returns:
        From now; at most the end of the table.
    """
    if not max_speed > 0.0:
        return 0.0
    if not set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box):
        return 0.0
    # Invariant: it is slow enough up to the time of `slow`, if that is a node, and not known to be
    # up to that of `fast`.
    slow, fast = -1, table.time.shape[0]
    while fast - slow > 1:
        middle = (slow + fast) // 2
        set_span(table, 0, middle, 1.0)
        speed = speed_in_box(
            radius, sphere.lever, moves, table.slowest[middle], table.fastest[middle], table.box
        )
        if speed <= max_speed:
            slow = middle
        else:
            fast = middle
    return 0.0 if slow < 0 else float(table.time[slow]) * (1.0 - SUM_ROUNDING)
