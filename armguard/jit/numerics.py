"""All rounding allowances of the project, and the codes of tests of measured states.

A *rounding* widens what was computed by more than its arithmetic can have lost, on the side that
makes a bound harder to keep: it costs tightness, never safety. A *slack* lets something pass a test
that fails it by no more than rounding; each says why what then passes does no harm. Below,
e = 2**-53 is the unit of rounding. Tolerances at which an iteration ends stand beside it, for they
cost tightness only; so do grids and errors of what is measured or stored, which are no rounding.
"""

from __future__ import annotations

GAP_ROUNDING = 2.0**-49
"""16 e of the magnitudes in a gap, a speed or a step, which lose 13 e at most. It is subtracted
from gaps and steps and added to speeds, so that contact times come early; `contact.gap` has the
sums."""

TIME_ROUNDING = 2.0**-50
"""8 e of the times that a deadline is the sum of, above what adding them and taking the clock from
the sum lose. It is subtracted, so that a certificate ends before its proof does."""

TERM_ROUNDING = 1e-14
"""90 e of a few added lengths, of a distance, or of the terms of a cubic: several times what these
lose. Contact distances and ranges grow by it, and balls that must hold a surface shrink. The check
of a plan's accelerations, which are differences of samples, forgives eight times as much."""

SUM_ROUNDING = 1e-12
"""9,000 e of a sum over joints, or of the lengths met on a walk along the arm: some hundred times
what a few dozen terms lose. Levers, motion bounds, speeds and hulls grow by it, and rooms and times
shrink."""

HULL_ROUNDING = 1e-13
"""900 e of the coordinates that a hull's gap is the difference of, above what rotating and
projecting them loses. It is subtracted, so that a hull counts as too near."""

ACCEPTANCE_SLACK = 2.0**-49
"""16 e of the stamps, lengths and speeds that enter a test of a measured state, above what such a
test loses. No motion within its bounds is refused, and what else passes differs from one by no more
than rounding may have done to a true state."""

LIMIT_SLACK = 1e-9
"""What a joint or a plan may be beyond a limit and its error, in [rad], [m] or per second, above
the rounding of both and of decimal figures. What passes is less than a sensor or a controller can
tell from the limit itself. A plan's limit on acceleration is widened by it relatively, and so are
the bounds on how fast a deviation from the plan changes."""

TABLE_END_SLACK = 1e-11
"""Relative to the last time in a table of steps: ten times the `SUM_ROUNDING` by which a proof up
to that end is shortened, and far below a step, so that only a proof up to the end passes for one.
"""

SUPPORT_SLACK = 1e-12
"""Relative to a radius: a point this little outside a ball counts as on it while its support is
looked for. The radius that is returned reaches every point all the same."""

PRUNING_SLACK = 1e-9
"""Relative to a distance: blocks that are this little too far are examined all the same, so that
rounding never excludes the nearest one. It costs time only."""

LENS_ROUNDING = 1e-9
"""Relative to the square of the smaller radius, where a ball is laid around what two balls have in
common: far more than these squares lose. Centres that are this near, in [m], count as one."""

VARIATION_SLACK = 1e-6
"""By how much distances can vary more than is computed, in [m]: far more than rounding costs."""

REPEAT_SLACK = 1e-9
"""Relative to a lever, and to a ball in [m]: what another machine may compute differently of the
same arm. A proof whose cover passes by it differs by less than the drawings of any arm."""

STOP_TIME_SLACK = 1e-6
"""Relative to the stop time of a verdict: how much later a proof may end. It excludes the proof of
another stop; by how much a stop is in time, the proof itself says."""

ALLOWED = 0
POSITION_BY_ACCEL = 1
POSITION_BY_SPEED = 2
VELOCITY_BY_ACCEL = 3
VELOCITY_BY_SPEED = 4
SHAPE = 5
