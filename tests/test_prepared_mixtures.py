"""The prepared way of `rbd.solve` against its general way, on random mixtures of constraints (`tests/fuzz_prepared.py`).

`make exhaustive` takes 10,000 of them.
"""

from __future__ import annotations

from collections import Counter

import fuzz_prepared
import numpy as np
import pytest

import rbd

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
FEW, ALL = 40, 10_000
OTHER = 0.02
"""At most this share has another isolated motion under Coulomb's law, or forces whose rank is in doubt."""


def test_both_ways_agree_on_mixtures(exhaustive, record_property):
    """What the prepared way answers is certified by the arrays; the same motion where it is unique, forces of least norm."""
    count = ALL if exhaustive else FEW
    found = Counter(fuzz_prepared.compared(0, i)[0].split(" ")[0] for i in range(count))
    record_property("outcomes", dict(found))
    assert not found["BAD"] and found["same"] + found["same,"] > 0.25 * count
    assert found["APART"] + found["FORCES"] <= max(1, OTHER * count)


@pytest.mark.parametrize("mu", [0.1, 2.0])
@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_a_point_that_slides_is_prepared_where_its_motion_is_the_only_one(mu, speed):
    """Painleve's rod: where a load lets its tip sink, n . J M^-1 J^T (n - mu t) < 0, all motions are looked for."""
    rod, turn = rbd.testing.box(size=(2.0, 0.02, 0.02), mass=1.0), [0.0, -np.sin(0.5), 0.0, np.cos(0.5)]  # 57 degrees
    tip = rbd.PointContact("tip", "box", offset=(1.0, 0.0, 0.0), friction=mu, on=None)
    still = rbd.State(rod, [0, 0, 0, *turn])
    rows = tip.rows(still)
    v = np.linalg.lstsq(rows.J, [speed, 0.0, 0.0], rcond=None)[0]
    found = rbd.solve(rbd.State(rod, still.q, v), [], [tip], check=False)
    felt = (rows.J @ np.linalg.solve(still.M, rows.J.T))[2] @ [-mu * np.sign(speed), 0.0, 1.0]
    assert (found.solver == fuzz_prepared.PREPARED) == (felt > 0.0)
    assert felt > 0.0 or bool(found.others) or not found.residuals.within(1e-7)


@pytest.mark.parametrize("draw", [5132, 5247])
def test_rows_that_nothing_moves_carry_nothing(draw):
    """Hinges that close planar chains: moments across the plane were 1e15 N m, by mobilities that were rounding."""
    assert fuzz_prepared.compared(0, draw)[0].startswith("same")
