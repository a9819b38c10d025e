"""How fast the surface of the arm can be, and how far it can still go.

With c the centre of a sphere of the cover, r its radius, q_f the configuration that displacements
count from, J_j the columns of the centre's Jacobian there, a_j those of its angular part (the axis
of a revolute joint, else 0), and H_ij = a_i x J_j with joint i nearer to the base, or the same, the
derivatives of the columns. Joint j is displaced by something in M_j +- W_j, at most S_j to either
side, errors of q_f included. Its velocity is in m_j +- h_j, at most u_j = |m_j| + h_j. In the
middle of the box of displacements the columns are about C_j = J_j + sum_i H_ij M_i, and x =
sum_j C_j m_j. Then no point of the arm inside the sphere is faster than

    sqrt(|x|^2 + 2 sum_j |x . C_j| h_j + sum_ij |C_i . C_j| h_i h_j)
        + sum_ij |J_max(i, j)| W_i u_j + sum_ijk R_max(i, j, k) S_i S_k u_j / 2
        + r (|sum_j a_j m_j| + sum_j h_j + sum_ij S_i u_j).

The root is the greatest |sum_j C_j w_j| over w_j in m_j +- h_j, or more: its square is |x|^2 +
2 sum_j (x . C_j) d_j + sum_ij C_i . C_j d_i d_j with d_j = w_j - m_j. The second line bounds what
columns differ from C_j by: no H_ij is longer than the column of the more distal of both joints, and
no second derivative of a column is longer than R_max(i, j, k). A derivative vanishes where a joint
that is not the most distal slides. Where a box is so wide that sum_ij R_max(i, j) S_i u_j is less
than that line, it takes its place, with J_j in place of C_j. The last line is how fast the link
turns: its sums run over revolute joints that move it, and over pairs whose joint i comes before
joint j. The first two lines are together no more than sum_j R_j u_j, and the last no more than
r sum_j u_j.

How far a point can go between any two moments of a time is bounded alike, with the way that each
joint can go in that time, to either side, in place of its velocity. The link turns by no more than
the sum of its joints' ways then: turns about different axes do not add up like vectors.
"""

from __future__ import annotations

import math

from armguard.bounds.joint_box import JointBox
from armguard.bounds.joint_table import JointTable, set_span
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING

# A row of `JointBox.joints`: the column J, the axis a, the length of J, R, whether it is revolute,
# and then what belongs to the box at hand: C, later times h, and m, h and M.


@merged_kernel
def set_joints(sphere: ArmSphere, moves: BoolArray, box: JointBox) -> int:
    """Fill the first half of each row of `box.joints` for a sphere.

    One row in one place is read several times faster than arrays of what it holds.

    Args:
        sphere: Of the arm.
        moves: Which joints move it. Shape (nv,).
        box: Where joints are.

    Returns:
        How many joints there are up to the last that moves it; -1 where a column is no number, or
        not finite.
    """
    count, total = 0, 0.0
    jacobian = sphere.jacobian
    for j in range(moves.shape[0]):
        row = box.joints[j]
        if not moves[j]:
            row[:] = 0.0
            continue
        count = j + 1
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        x = jacobian[0, j] + ay * sphere.z - az * sphere.y
        y = jacobian[1, j] + az * sphere.x - ax * sphere.z
        z = jacobian[2, j] + ax * sphere.y - ay * sphere.x
        row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, ax, ay, az
        row[6], row[7] = math.sqrt(x * x + y * y + z * z), sphere.lever[j]
        row[8] = 1.0 if box.turning[j] else 0.0
        total += row[6]
    return count if total < math.inf else -1


@merged_kernel
def speed_in_box(
    radius: float,
    count: int,
    slowest: FloatArray,
    fastest: FloatArray,
    box: JointBox,
    enough: float,
) -> float:
    """Bound on the speed of each point of a sphere, in [m]/[s]; `set_joints` knows which.

    Args:
        radius: Of the sphere, in [m].
        count: Of joints, from `set_joints`.
        slowest: Least velocities of the joints, in [rad]/[s] or [m]/[s]. Shape (nv,).
        fastest: Greatest velocities, alike.
        box: Where joints are.
        enough: A bound above it may be returned as inf.
    """
    span, error = box.span, box.position_error
    bend = wide_bend = most = twist = 0.0
    # From the base to the tip. Of revolute joints so far: the turn to the middle of the box, as a
    # vector; sums of half ranges, of greatest angles, and of rates.
    ox = oy = oz = spread = angle = rate = 0.0
    for j in range(count):
        row = box.joints[j]
        mean, half = 0.5 * (fastest[j] + slowest[j]), 0.5 * (fastest[j] - slowest[j])
        pace = abs(mean) + half  # no number where either velocity is none
        shift = 0.5 * (span[0, j] + span[1, j])
        width = 0.5 * (span[0, j] - span[1, j]) + error[j]
        size = span[2, j] + error[j]
        x, y, z, ax, ay, az = row[0], row[1], row[2], row[3], row[4], row[5]
        length, lever, turns = row[6], row[7], row[8]
        ox, oy, oz = ox + ax * shift, oy + ay * shift, oz + az * shift
        row[9], row[10], row[11] = x + oy * z - oz * y, y + oz * x - ox * z, z + ox * y - oy * x
        row[12], row[13], row[14] = mean, half, shift
        # Pairs and triples of which joint j is the most distal. One that slides is there once.
        second = spread * pace + width * (rate + turns * pace)
        third = angle * (angle * pace + 2.0 * size * rate)
        third += turns * size * (size * rate + 2.0 * angle * pace + size * pace)
        bend += length * second + 0.5 * lever * third
        wide_bend += lever * (angle * pace + size * (rate + turns * pace))
        twist += turns * angle * pace
        most += lever * pace
        spread, angle, rate = spread + turns * width, angle + turns * size, rate + turns * pace
    # In a wide box the columns at q_f itself are the better ones.
    is_wide = wide_bend < bend
    bend = min(bend, wide_bend)
    # From the tip to the base: the way of the centre to the middle of the box, by the joints beyond
    # joint j; its velocity there, and that of the link's turning, with the middle velocities.
    px = py = pz = vx = vy = vz = wx = wy = wz = swing = 0.0
    for j in range(count - 1, -1, -1):
        row = box.joints[j]
        ax, ay, az = row[3], row[4], row[5]
        mean, half, shift = row[12], row[13], row[14]
        x, y, z = (
            row[9] + ay * pz - az * py,
            row[10] + az * px - ax * pz,
            row[11] + ax * py - ay * px,
        )
        if is_wide:
            x, y, z = row[0], row[1], row[2]
        px, py, pz = px + row[0] * shift, py + row[1] * shift, pz + row[2] * shift
        vx, vy, vz = vx + x * mean, vy + y * mean, vz + z * mean
        wx, wy, wz = wx + ax * mean, wy + ay * mean, wz + az * mean
        swing += row[8] * half
        row[9], row[10], row[11] = x * half, y * half, z * half
    # What was not finite counts as the sums that need no columns; NaN stays NaN.
    turn = math.sqrt(wx * wx + wy * wy + wz * wz) + swing + twist
    if not turn <= rate:
        turn = rate
    around = radius * turn
    square = vx * vx + vy * vy + vz * vz
    if most + around > enough and math.sqrt(square) + bend + around > enough:
        return math.inf
    for j in range(count):
        row = box.joints[j]
        x, y, z = row[9], row[10], row[11]
        along = abs(vx * x + vy * y + vz * z)
        for i in range(j):
            other = box.joints[i]
            along += abs(x * other[9] + y * other[10] + z * other[11])
        square += x * x + y * y + z * z + 2.0 * along
    center = math.sqrt(square) + bend
    if not center <= most:
        center = most
    # The columns of a point far from the origin were rounded as its place was.
    return center + around + SUM_ROUNDING * (most + rate * (1.0 + radius))


@merged_kernel
def speed_from(radius: float, count: int, table: JointTable, node: int, enough: float) -> float:
    """Bound on the speed of a sphere's points from a node of a braking table on until it rests.

    Arguments as for `speed_in_box`; the node is not the last.
    """
    set_span(table, node, table.time.shape[0] - 1, 1.0)
    return speed_in_box(radius, count, table.slowest[node], table.fastest[node], table.box, enough)


@merged_kernel
def speed_until(radius: float, count: int, table: JointTable, node: int, enough: float) -> float:
    """Bound on their speed up to a node of a table of an arm that is free to move."""
    set_span(table, 0, node, 1.0)
    return speed_in_box(radius, count, table.slowest[node], table.fastest[node], table.box, enough)


@kernel
def way_from(radius: float, count: int, table: JointTable, node: int) -> float:
    """Bound on how far they can still go from then on, in [m]."""
    last = table.time.shape[0] - 1
    forth, back = table.box.forth, table.box.back
    turn = 0.0
    for j in range(count):
        up = down = whole = 0.0
        for k in range(node, last):
            duration = (table.time[k + 1] - table.time[k]) * (1.0 + SUM_ROUNDING)
            rise, fall = max(table.fastest[k, j], 0.0), max(-table.slowest[k, j], 0.0)
            up += rise * duration
            down += fall * duration
            # The greater of both; no number where either is none.
            whole += 0.5 * (rise + fall + abs(rise - fall)) * duration
        # One that goes forth and back goes farther in all than to either side.
        if up >= down:
            up = whole
        else:
            down = whole
        forth[j], back[j] = up, -down
        turn += table.box.joints[j, 8] * whole
    set_span(table, node, last, 1.0)
    way = speed_in_box(0.0, count, back, forth, table.box, math.inf)
    return way + radius * turn * (1.0 + SUM_ROUNDING)


@kernel
def find_harmless_node(
    sphere: ArmSphere,
    radius: float,
    moves: BoolArray,
    table: JointTable,
    max_speed: float,
) -> tuple[int, float]:
    """From when on a sphere of a braking arm is slow enough until the arm rests.

    From the node's time on no point of the arm inside the sphere is faster than a limit. At rest
    the speed is 0, so that there always is such a node.

    Args:
        sphere: Of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        table: Of an arm that brakes until it rests, with velocities.
        max_speed: The limit, in [m]/[s], >= 0; at 0, when the arm rests.

    Returns:
        The node, and the bound on the speed from then on, in [m]/[s].
    """
    last = table.time.shape[0] - 1
    if not max_speed > 0.0:
        return last, 0.0
    count = set_joints(sphere, moves, table.box)
    if count < 0:
        return last, 0.0
    # Invariant: it is harmless from `later` on, and not known to be from `sooner` on. Most are
    # harmless from the first node on, so that is asked first.
    sooner, later, fastest = -1, last, 0.0
    node = 0
    while later - sooner > 1:
        speed = speed_from(radius, count, table, node, max_speed)
        if speed <= max_speed:
            later, fastest = node, speed
        else:
            sooner = node
        node = (sooner + later) // 2
    return later, fastest


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
    count = set_joints(sphere, moves, table.box)
    if count < 0:
        return 0.0
    # Invariant: it is slow enough up to the time of `slow`, if that is a node, and not known to be
    # up to that of `fast`.
    slow, fast = -1, table.time.shape[0]
    while fast - slow > 1:
        node = (slow + fast) // 2
        if speed_until(radius, count, table, node, max_speed) <= max_speed:
            slow = node
        else:
            fast = node
    return 0.0 if slow < 0 else float(table.time[slow]) * (1.0 - SUM_ROUNDING)
