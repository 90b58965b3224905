"""Refinement: what it makes exact, and what it leaves alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.solvers.refinement import refined
from rbd.testing import box

ROBOT = box(0.1)


def held() -> rbd.Solution:
    """A box held at its centre: the force is its weight."""
    state = rbd.State(ROBOT, pin.neutral(ROBOT.model))
    return rbd.solve(state, np.zeros(0), [rbd.PointContact("floor", "box")], solver=rbd.KKT())


def test_a_correction_brings_an_answer_that_is_off_back() -> None:
    """The closed form's own correction, -(J M^-1 J^T)^-1 c: from forces of 1 N too much to the weight."""
    s = held()
    off = replace(s, a=s.a + 0.1, multipliers=s.multipliers + 1.0)
    found = refined(off, lambda c, f: -np.linalg.solve(s.problem.delassus, c))
    assert found.multipliers == pytest.approx([0.0, 0.0, 0.981], abs=1e-12) and found.status is rbd.problem.Status.SOLVED


@pytest.mark.parametrize("change", [np.nan, np.inf, 1e154], ids=["nan", "inf", "overflow"])
def test_a_correction_beyond_all_numbers_leaves_the_answer_as_it_was(change: float) -> None:
    """No warning, no error, and not a digit changed."""
    s = held()
    off = replace(s, a=s.a + 0.1, multipliers=s.multipliers + 1.0)
    found = refined(off, lambda c, f: np.array([change, 0.0, 0.0]))
    assert found is off
