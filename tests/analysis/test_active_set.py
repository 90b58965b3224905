"""What the derivative of an answer rests on: where rows repeat, lock or share a load, and where a velocity has decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.active_set import ActiveSet
from rbd.errors import NotDifferentiable
from rbd.problem.rows import Rows
from rbd.testing import box

G, MASS, MU = 9.81, 10.0, 0.6
ROBOT = box(MASS)
BEAD = rbd.PointContact("floor", "box", friction=MU)  # at the centre of mass: a point mass


def moved(contacts: Sequence[object], push: Sequence[float], v: Sequence[float] = (0.0,) * 6) -> rbd.Solution:
    """A box under Coulomb's law."""
    state = rbd.State(ROBOT, pin.neutral(ROBOT.model), np.array(v))
    return rbd.solve(state, np.zeros(0), contacts, external=rbd.ExternalForce("box", push), solver=rbd.ConeSolver())


class Spin:
    """Holds the turn about the vertical; the box is as free to move as without."""

    name = "spin"

    def rows(self, state: rbd.State) -> Rows:
        """One row of the angular velocity."""
        return Rows("spin", np.eye(6)[5:], np.zeros(1), rbd.problem.Free(1))


def test_what_is_held_beside_a_point_that_slides_leaves_its_friction_alone() -> None:
    """Sideways velocity turns the friction by -mu g/|v|, whatever else is held; the hold takes up the torque."""
    d = moved([BEAD, Spin()], (80.0, 0.0, 0.0), (0.5, 0, 0, 0, 0, 0)).derivatives()
    assert d.active == {"floor": ("slides",), "spin": ("holds",)}
    assert np.abs(d.da_dv[:3, :2] - np.array([[0.0, 0.0], [0.0, -MU * G / 0.5], [0.0, 0.0]])).max() < 1e-8
    assert np.abs(d.forces["spin"].dexternal - -np.eye(6)[5:]).max() < 1e-9


def test_a_point_that_moves_away_and_a_joint_that_rubs_as_it_moves_have_no_say() -> None:
    """What a velocity has decided does not change: derivatives are those of the box, or the arm, alone."""
    with pytest.warns(rbd.errors.OpeningContactWarning):
        away = moved([BEAD], (80.0, 0.0, 0.0), (0.0, 0.0, 0.3, 0, 0, 0)).derivatives()
    free = moved([], (80.0, 0.0, 0.0), (0.0, 0.0, 0.3, 0, 0, 0)).derivatives()
    assert away.active == {"floor": ("opens",)} and not away.forces["floor"].dexternal.any()
    arm = rbd.load_robot("panda", root="fixed")
    state = rbd.State(arm, arm.neutral(), np.full(arm.nv, 0.3))
    rubs = rbd.solve(state, np.zeros(arm.nu), [rbd.JointFriction("rub", arm.model.names[2], 3.0)], solver=rbd.ConeSolver())
    pushed = -3.0 * np.eye(arm.nv)[1]
    alone = rbd.solve(state, np.zeros(arm.nu), [], external=pushed)
    assert np.abs(rubs.a - alone.a).max() < 1e-9 and rubs.derivatives().active == {"rub": ("yields",)}
    for found, expected in ((away, free), (rubs.derivatives(), alone.derivatives())):
        for kind in ("da_dq", "da_dv", "da_dtau", "da_dexternal"):
            given, exact = getattr(found, kind), getattr(expected, kind)
            assert np.abs(given - exact).max(initial=0.0) < 1e-8 * max(1.0, np.abs(exact).max(initial=0.0))


def test_two_points_in_one_place_slip_as_one() -> None:
    """How they share the load is not unique, and moves nothing: the motion's derivatives are those of one point."""
    two = moved([BEAD, replace(BEAD, name="again")], (80.0, 0.0, 0.0)).derivatives()
    one = moved([BEAD], (80.0, 0.0, 0.0)).derivatives()
    assert two.active == {"floor": ("slips",), "again": ("slips",)} and set(two.not_unique) == {"floor", "again"}
    for kind in ("da_dq", "da_dexternal"):
        assert np.abs(getattr(two, kind) - getattr(one, kind)).max() < 1e-8


def test_a_patch_that_slips_straight_resists_a_turn_by_where_its_load_stands() -> None:
    """Friction turned by alpha x_i / slide at each corner: a turn is resisted by mu / slide sum N_i x_i^2.

    Nothing decides how four corners share the load. On a square the sum is m g x^2 whatever they do; on a kite it is not.
    """
    corners = [[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]]
    square = rbd.SurfaceContact("floor", "box", corners=corners, friction=MU)  # as high as the centre of mass: no tipping
    kite = replace(square, corners=[[0.3, 0.0], [-0.3, 0.0], [0.0, 0.2], [0.0, -0.2]])
    d = moved([square], (80.0, 0.0, 0.0)).derivatives()
    slide, inertia = 80.0 / MASS - MU * G, MASS / 12.0 * (0.4**2 + 0.4**2)
    assert d.active == {"floor": ("slips",) * 4}
    assert d.da_dexternal[5, 5] == pytest.approx(1.0 / (inertia + MU * MASS * G * 0.2**2 / slide), rel=1e-9)
    with pytest.raises(NotDifferentiable, match="slips without turning, and how its corners share the load is not unique"):
        moved([kite], (80.0, 0.0, 0.0)).derivatives()


def test_rows_that_repeat_each_other_and_are_driven_apart_are_refused() -> None:
    """Twice the same row: moved alike it follows, moved apart there is no motion."""
    twice = [Rows(name, np.eye(2)[:1], np.zeros(1), rbd.problem.Free(1)) for name in ("one", "other")]
    held = ActiveSet(rbd.KKT().solve(rbd.GaussProblem(np.eye(2), np.ones(2), twice)))
    none = np.zeros((2, 1))
    da, _ = held.derivative(none, np.array([[1.0], [1.0]]), none)
    assert da == pytest.approx(np.array([[-1.0], [0.0]]))
    with pytest.raises(NotDifferentiable, match="linearly dependent here, and contradict each other"):
        held.derivative(none, np.array([[1.0], [0.0]]), none)


def test_where_friction_and_what_slides_lock_each_other_there_is_no_derivative() -> None:
    """Painleve's limit, n . J M^-1 J^T (n - mu t) = 0: any normal force gives one and the same normal acceleration."""
    J = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    floor = Rows("floor", J, np.zeros(3), rbd.problem.FrictionCone(1.0), velocity=np.array([0.5, 0.0, 0.0]))
    P = rbd.GaussProblem(np.eye(3), np.zeros(3), [floor])
    w = np.array([10.0])
    f = P.force_set.G @ w
    s = rbd.Solution(P, J.T @ f, f, w, "coulomb", "by hand", 1, 0.0)
    assert s.status is rbd.problem.Status.SOLVED and f == pytest.approx([-10.0, 0.0, 10.0])
    with pytest.raises(NotDifferentiable, match="jams the sliding contacts"):
        ActiveSet(s)


def test_a_slipping_point_that_pulls_is_refused() -> None:
    """A normal force of the wrong sign, as of an answer that is none: friction would push along the slip."""
    s = moved([BEAD], (80.0, 0.0, 0.0))
    assert s.weights is not None
    with pytest.raises(NotDifferentiable, match="has negative normal force"):
        ActiveSet(replace(s, weights=-s.weights, multipliers=-s.multipliers))
