"""Whether a motion under Coulomb's law stands alone."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

import rbd
from rbd.answers.analysis.contact_modes import modes_of
from rbd.answers.analysis.uniqueness import motion_freedom
from rbd.problem.residuals import SOLVED, residuals_of
from rbd.testing import box


def _pushed(corners, push, at=(0.0, 0.0, 0.0), friction=0.6, law="coulomb") -> rbd.Solution:
    """A box of 10 kg on some of its corners, pushed at a point."""
    robot = box()
    q = pin.neutral(robot.model)
    q[2] = 0.1
    points = [
        rbd.PointContact(f"c{i}", "box", offset=(0.2 * x, 0.2 * y, -0.1), friction=friction) for i, (x, y) in enumerate(corners)
    ]
    force = rbd.ExternalForce("box", push, offset=at)
    return rbd.solve(rbd.State(robot, q), np.zeros(0), points, external=force, solver=rbd.ConeSolver(law=law))


FOUR = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
ASIDE = ((0.0, 100.0, 0.0), (0.15, 0.0, 0.0))
"""A push that makes the box slip and turn."""


@pytest.mark.parametrize(
    ("corners", "push", "at", "friction", "law", "expected"),
    [
        (FOUR, *ASIDE, 0.6, "coulomb", 1),  # four loads, three equations, four directions of friction
        (FOUR[:3], *ASIDE, 0.6, "coulomb", 0),  # three loads, three equations
        (FOUR, (80.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.6, "coulomb", 0),  # slips without turning: one direction for all
        (FOUR, *ASIDE, 0.0, "coulomb", 0),  # no friction to follow the load
        (FOUR, *ASIDE, 0.6, "convex", 0),  # a strictly convex minimum
        (FOUR, (10.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.6, "coulomb", 0),  # sticks
    ],
)
def test_only_what_slips_and_turns_on_more_than_three_points_has_a_family(corners, push, at, friction, law, expected):
    """Counted by hand: loads that statics leaves open, whose friction differs."""
    if len(corners) == 3:
        push = (0.0, 70.0, 0.0)  # it would tip over the missing corner
    s = _pushed(corners, push, at, friction, law)
    assert motion_freedom(s) == expected == s.uniqueness().motion_freedom
    assert ("one of a family" in str(s.uniqueness())) == (expected > 0)


def test_a_neighbour_in_the_family_satisfies_the_law_too():
    """Shift the loads along the one direction that neither lifts nor tips, and solve the equations of slip again."""
    s = _pushed(FOUR, *ASIDE)
    P, T = s.problem, s.problem.force_set
    loads, aside = s.weights[T.cone_at + 2], np.array([1.0, -1.0, 1.0, -1.0])

    def weights(a, N):
        Y = T.accelerations(P.J @ a + P.offset, coulomb=False)[T.cone_columns]
        w = np.zeros(T.size)
        w[T.cone_columns] = np.column_stack([-0.6 * N[:, None] * Y[:, :2] / np.hypot(Y[:, 0], Y[:, 1])[:, None], N])
        return w, Y[:, 2]

    def equations(x):
        a, N = x[:6], x[6:]
        w, rise = weights(a, N)
        return np.concatenate([P.M @ a - P.rhs - P.J.T @ (T.G @ w), rise, [aside @ (N - loads) - 0.5]])

    found = least_squares(equations, np.concatenate([s.a, loads]), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    a, N = found[:6], found[6:]
    w, _ = weights(a, N)
    assert N.min() > 1.0 and residuals_of(P, a, T.G @ w, w, "coulomb").within(SOLVED)
    assert np.abs(a - s.a).max() > 1e-4  # and it is another motion


def test_modes_are_counted_in_words():
    """Four points slip."""
    assert list(modes_of(_pushed(FOUR, *ASIDE)).words.values()) == ["slips"] * 4
