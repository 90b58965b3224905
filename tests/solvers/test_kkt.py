"""KKT: the closed form for constraints that hold, against other implementations and its own definition."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.problem.rows import Rows

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors


def _held_velocity(state: rbd.State, contacts, rng) -> np.ndarray:
    """A velocity that keeps the contacts where they are."""
    J = np.vstack([c.rows(state).J for c in contacts])
    v = rng.normal(size=state.robot.nv)
    return v - np.linalg.pinv(J) @ (J @ v)


class Pinocchio:
    """Held accelerations and contact wrenches by `pin.constraintDynamics`, its legacy 6D contacts in local axes."""

    def __init__(self, robot: rbd.Robot, contacts) -> None:
        self.robot, self.data = robot, robot.model.createData()
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for c in contacts:
            f = robot.frame(c.frame)
            at = f.placement * c.placement
            model = pin.RigidConstraintModel(
                pin.ContactType.CONTACT_6D, robot.model, f.parentJoint, at, pin.ReferenceFrame.LOCAL
            )
            self.models.append(model)
            self.datas.append(model.createData())
        pin.initConstraintDynamics(robot.model, self.data, self.models, self.datas)

    def solve(self, state: rbd.State, tau) -> tuple[np.ndarray, np.ndarray]:
        """(a, forces in contact axes)."""
        settings = pin.ProximalSettings(1e-14, 0.0, 1)
        load = self.robot.actuation.T @ tau
        a = pin.constraintDynamics(self.robot.model, self.data, state.q, state.v, load, self.models, self.datas, settings)
        return a.copy(), self.data.lambda_c.copy()


@pytest.mark.parametrize("name", ["talos", "g1"])
@pytest.mark.parametrize("moving", [False, True])
def test_held_soles_agree_with_pinocchios_constraint_dynamics(name, moving, rng):
    """Accelerations and wrenches of two held soles, at rest and moving, where J has full rank and the soles are still."""
    robot = rbd.load_robot(name)
    contacts = robot.soles(None)
    pinocchio = Pinocchio(robot, contacts)
    for _ in range(5):
        state = robot.standing()
        if moving:
            state = state.with_velocity(_held_velocity(state, contacts, rng))
        tau = 10.0 * rng.normal(size=robot.nu)
        a, f = pinocchio.solve(state, tau)
        for solver in (rbd.KKT(), rbd.ProxQP()):
            s = rbd.solve(state, tau, contacts, solver=solver)
            assert np.abs(s.a - a).max() < 1e-9 * max(1.0, np.abs(a).max())
            assert np.abs(s.multipliers - f).max() < 1e-9 * max(1.0, np.abs(f).max())


def test_held_soles_are_still_in_any_motion(talos, rng):
    """Even where the feet turn and slide, held soles have zero classical acceleration, and the certificate holds."""
    for _ in range(5):
        state = talos.standing().with_velocity(rng.normal(size=talos.nv))
        s = rbd.solve(state, 10.0 * rng.normal(size=talos.nu), talos.soles(None), solver=rbd.KKT())
        assert s.status == "solved" and max(np.abs(c).max() for c in s.accelerations.values()) < 1e-9
        for sole in talos.soles(None):
            at = state.frame(sole.frame, sole.placement.translation)
            assert np.abs(at.J @ s.a + at.bias).max() < 1e-9


def test_the_closed_form_is_lagranges(talos, rng):
    """One linear system [M -J^T; J 0] [a; f] = [rhs; -J_dot v], by NumPy."""
    state = talos.standing().with_velocity(rng.normal(size=talos.nv))
    s = rbd.solve(state, rng.normal(size=talos.nu), talos.soles(None), solver=rbd.KKT())
    P = s.problem
    system = np.block([[P.M, -P.J.T], [P.J, np.zeros((P.m, P.m))]])
    expected = np.linalg.solve(system, np.r_[P.rhs, -P.offset])
    assert np.abs(s.a - expected[: P.nv]).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(s.multipliers - expected[P.nv :]).max() < 1e-9 * np.abs(expected).max()
    assert s.weights is None and s.law.kind == "bilateral" and s.solver == "KKT"


def _corner_points(robot: rbd.Robot, friction=None) -> list[rbd.PointContact]:
    """The corners of both soles, as eight points."""
    return [
        rbd.PointContact(f"{sole.name}_{i}", sole.frame, offset=sole.placement.act(c), friction=friction)
        for sole in robot.soles()
        for i, c in enumerate(sole.corners)
    ]


@pytest.mark.parametrize("name", ["talos", "g1"])
@pytest.mark.parametrize("moving", [False, True])
def test_two_feet_held_at_four_corners_each_solve_and_state_their_rank(name, moving, rng):
    """24 rows of rank 12: a and J^T f as with held soles, and the same by KKT and ProxQP to 1e-9."""
    robot = rbd.load_robot(name)
    points, state = _corner_points(robot), robot.standing()
    if moving:
        state = state.with_velocity(_held_velocity(state, robot.soles(None), rng))
    tau = 5.0 * rng.normal(size=robot.nu)
    kkt, prox = (rbd.solve(state, tau, points, solver=s) for s in (rbd.KKT(), rbd.ProxQP()))
    soles = rbd.solve(state, tau, robot.soles(None), solver=rbd.KKT())
    scale = max(1.0, np.abs(soles.a).max(), np.abs(soles.problem.J.T @ soles.multipliers).max())
    for s in (kkt, prox):
        assert s.problem.m == 24 and s.rank == 12 and s.status == "solved"
        assert np.abs(s.a - soles.a).max() < 1e-9 * scale
        pull = s.problem.J.T @ s.multipliers
        assert np.abs(pull - soles.problem.J.T @ soles.multipliers).max() < 1e-9 * scale
    assert np.abs(kkt.a - prox.a).max() < 1e-9 * scale


def test_redundant_forces_are_those_of_minimum_norm(talos, rng):
    """Of all f with the same J^T f, KKT gives the one in the row space of J^T: no part of it works against nothing."""
    s = rbd.solve(talos.standing(), rng.normal(size=talos.nu), _corner_points(talos), solver=rbd.KKT())
    J, f = s.problem.J, s.multipliers
    shortest = np.linalg.lstsq(J.T, J.T @ f, rcond=1e-10)[0]
    assert np.abs(f - shortest).max() < 1e-7
    prox = rbd.solve(talos.standing(), np.zeros(talos.nu), _corner_points(talos))
    kkt = rbd.solve(talos.standing(), np.zeros(talos.nu), _corner_points(talos), solver=rbd.KKT())
    assert np.linalg.norm(kkt.multipliers) <= np.linalg.norm(prox.multipliers) * (1 + 1e-9)


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_multipliers_agree_where_rows_are_independent(name, rng):
    """Two held soles, 12 rows of rank 12: one force, by KKT and by ProxQP."""
    robot = rbd.load_robot(name)
    for _ in range(10):
        state = robot.standing().with_velocity(rng.normal(size=robot.nv))
        tau = 10.0 * rng.normal(size=robot.nu)
        kkt, prox = (rbd.solve(state, tau, robot.soles(None), solver=s) for s in (rbd.KKT(), rbd.ProxQP()))
        assert kkt.rank == 12
        assert np.abs(kkt.multipliers - prox.multipliers).max() < 1e-9 * max(1.0, np.abs(kkt.multipliers).max())
        assert np.abs(kkt.a - prox.a).max() < 1e-9 * max(1.0, np.abs(kkt.a).max())


@pytest.mark.parametrize("twist", [1e-2, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12, 0.0])
def test_rows_that_nearly_repeat_each_other_are_solved_or_said_to_fail(twist, rng):
    """Two rows a small angle apart, consistent: solved, or inaccurate where they are between the same and different."""
    A = rng.normal(size=(6, 6))
    J = rng.normal(size=(1, 6))
    other = J + twist * rng.normal(size=(1, 6))
    a = rng.normal(size=6)
    rows = [Rows("one", J, -J @ a, rbd.problem.Free(1)), Rows("two", other, -other @ a, rbd.problem.Free(1))]
    P = rbd.GaussProblem(A @ A.T + np.eye(6), rng.normal(size=6), rows)
    for solver in (rbd.KKT(), rbd.ProxQP()):
        s = solver.solve(P)
        gap = np.abs(P.J @ s.a + P.offset).max()
        assert s.status == "solved" or (s.status == "inaccurate" and 1e-10 < twist < 1e-6), s
        assert gap < (1e-8 if s.status == "solved" else 1e-6)


def test_what_can_break_or_slip_is_refused_by_name():
    """The first such constraint is named, with the set that its forces live in."""
    rows = [
        Rows("bar", np.eye(1, 3), np.zeros(1), rbd.problem.Free(1)),
        Rows("stop", np.eye(1, 3), np.zeros(1), rbd.problem.NonNegative(1)),
    ]
    P = rbd.GaussProblem(np.eye(3), np.ones(3), rows)
    assert rbd.KKT().reason_unsupported(rbd.GaussProblem(np.eye(3), np.ones(3), rows[:1])) is None
    reason = rbd.KKT().reason_unsupported(P)
    assert "'stop'" in reason and "NonNegative" in reason and "'bar'" not in reason
