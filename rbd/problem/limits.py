"""How much work one question may cost: every limit of the package's programs and searches, with its reason.

Limits count work (pivots, steps, multiplications), not seconds, so that an answer repeats bit by bit on any machine. Where a
library cannot count, or may stand still within one step, a clock stands behind the count: far above what the count allows on an
idle machine, so that it acts only when something is wrong. What was not found within a limit is reported as not found.

No call into a compiled library lasts much longer than `PROGRAM_SECONDS`, so Ctrl-C is answered within that time.
"""

from __future__ import annotations

PROGRAM_SECONDS = 2.0
"""Clock limit of one linear program [s]. Robots need milliseconds; HiGHS has been seen not to end at all."""
PROGRAM_PIVOTS = 20_000
"""Simplex pivots of one linear program. A hundred contacts need a few hundred."""
LEAST_SQUARES_PIVOTS = 10
"""Pivots of a nonnegative least-squares problem for each unknown. SciPy's own limit is 3; degenerate problems need 5."""
BOUNDED_STEPS = 200
"""Iterations of a least-squares problem between bounds. They need 10 to 30."""

QP_STEPS = 300
"""Outer iterations of a quadratic program. Robots need 8 to 22, and a setting that needs 100 seldom ends at all."""
QP_STEPS_LAST = 1000
"""The same for the last settings that are tried."""
QP_INNER_STEPS = 100
"""Inner iterations. Robots need a few; with ProxSuite's own limit of 1500, hopeless programs take minutes."""
QP_WORK = 2e8
"""Iterations times (unknowns and rows) squared, of all settings of one quadratic program: 1 to 3 s. Robots need 1e6."""
QP_SETTING_WORK = 1e8
"""The same of one setting, were every inner iteration used."""
QP_FEWEST_STEPS = 30
"""Outer iterations that a setting has at least, however large the program."""

SEARCH_WORK = 3e9
"""Multiplications of all starts of one `rbd.ConeSolver`, about 3 s: steps times unknowns cubed. A hundred contacts need 1e8."""

ENDS_WORK = 1.2e10
"""Multiplications for all ranges of one `Solution.uniqueness()`, about 4 s on one core."""
FORCE_CHOICE_WORK = 4e9
"""Multiplications for the forces of minimum norm, about 1.5 s on one core. A hundred contacts need a hundredth of it."""

FRICTION_PROGRAMS = 400
"""Linear programs in the search for the least coefficient of friction that holds a pose. Two soles need some fifty."""

CERTIFICATE_SETS = 1000
"""Sets of constraints, or of rows, that are tried in the search for a contradiction smaller than what was found."""
CERTIFICATE_PROGRAMS = 100
"""Linear programs that are solved in that search."""
CERTIFICATE_LEFT_OUT = 300
"""Linear programs that may be solved in all to see which members of a contradiction can be left out."""
CERTIFICATE_CUTS = 30
"""Rounds of refinement of circular cones in a contradiction."""
VIOLATION_CUTS = 40
"""Rounds of refinement of circular cones in the least violation."""
MODE_NODES = 5000
"""Nodes of the tree of contact modes of points that already slide."""
MODE_WORK = 5e9
"""Multiplications of that tree, about 2 s: a hundred points reach it long before the nodes."""


class Work:
    """What is left of a number of multiplications.

    Attributes:
        left: Negative once more was spent than there was.
    """

    def __init__(self, limit: float) -> None:
        self.left = float(limit)

    def spend(self, amount: float) -> bool:
        """Whether the amount was there."""
        self.left -= amount
        return self.left >= 0.0
