"""Loops whose rows are linearly dependent: order, residuals, forces and cost are those of loops whose rows are not."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipj, ellipk
from smooth_models import bricard, chain, off, swinging

import rbd
from rbd.constraints.manifold import ConstraintManifold
from rbd.mechanism.redundant_accelerations import StageSolver
from rbd.simulation.velocity_problem import independent_rows

RING = [rbd.LoopClosure("ring", "pivot", "tip", kind="revolute", axis=(1.0, 0.0, 0.0))]
"""Closes Bricard's mechanism: five rows of rank four."""


def _hinged(robot):
    """The planar closures of a robot as hinges: five rows each, two of them independent."""
    return [rbd.LoopClosure(c.name, c.frame_a, c.frame_b, kind="revolute", axis=c.axis) for c in robot.loops()]


def _last(start, constraints, step, duration, integrator, **more):
    return rbd.simulate(start, constraints, duration=duration, step=step, integrator=integrator, progress=False, **more)


def _differs_from_solve(found, constraints):
    """How far recorded accelerations and forces are from those of `rbd.solve` with `KKT()`, at most."""
    off_by = 0.0
    for i in range(0, len(found), max(1, len(found) // 10)):
        proved = rbd.solve(found.state(i), found.tau[i], constraints, solver=rbd.KKT())
        off_by = max(off_by, float(np.abs(proved.a - found.a[i]).max()))
        off_by = max(off_by, *(float(np.abs(proved.forces[k] - found.forces[k][i]).max()) for k in proved.forces))
    return off_by


def _parallelogram(swing):
    """(robot, state): the benchmark's four-bar with equal lengths (A02, N = 1), its cranks `swing` from hanging, at rest."""
    robot, phi = rbd.mechanism.n_four_bar(1), swing - 0.5 * np.pi
    q = robot.at("assembled").q.copy()
    for name in robot.joints:
        joint, sign = robot.model.joints[robot.joint_id(name)], 1.0 if name.startswith("crank") else -1.0
        q[joint.idx_q : joint.idx_q + 2] = np.cos(phi), sign * np.sin(phi)
    return robot, rbd.State(robot, q)


def _swings(swing, t):
    """(angle from hanging, its rate) of the parallelogram: a pendulum with phi'' = -(6/5) g sin phi, by elliptic functions."""
    w, k = np.sqrt(1.2 * 9.81), np.sin(0.5 * swing)
    sn, cn, dn, _ = ellipj(ellipk(k * k) - w * t, k * k)
    return 2.0 * np.arcsin(k * sn), -2.0 * k * w * cn * dn / np.sqrt(1.0 - (k * sn) ** 2)


@pytest.mark.parametrize(
    ("integrator", "stabilisation", "order", "steps"),
    [
        (rbd.RungeKutta4(), rbd.simulation.Projection(), 4, (0.02, 0.01)),
        (rbd.RungeKutta4(), rbd.constraints.Baumgarte(10.0), 4, (0.02, 0.01)),
        (rbd.TimeStepping(), rbd.simulation.Projection(), 2, (0.01, 0.005)),
        (rbd.TimeStepping(extrapolate=True), rbd.simulation.Projection(), 2, (0.01, 0.005)),
        (rbd.TimeStepping(), rbd.constraints.Baumgarte(10.0), 2, (0.01, 0.005)),
        (rbd.TimeStepping(extrapolate=True), rbd.constraints.Baumgarte(10.0), 2, (0.01, 0.005)),
    ],
    ids=["RK4", "RK4 Baumgarte", "TimeStepping", "extrapolated", "TimeStepping Baumgarte", "extrapolated Baumgarte"],
)
def test_a_hinged_parallelogram_swings_as_the_elliptic_functions_at_two_steps(integrator, stabilisation, order, steps):
    """IFToMM A02 with N = 1, hanging, its pin a hinge (rank 2 of 5): (6/5) g in place of g; the error falls by 2^order."""
    robot, start = _parallelogram(1.0)
    loops = _hinged(robot)
    assert rbd.solve(start, np.zeros(robot.nu), loops, solver=rbd.KKT()).rank == 2
    true, errors = np.array(_swings(1.0, 1.0)), []
    for step in steps:
        found = _last(start, loops, step, 1.0, integrator, stabilisation=stabilisation)
        q, crank = found.q[-1], robot.model.joints[robot.joint_id("crank_0_joint")]
        angle = np.arctan2(q[crank.idx_q + 1], q[crank.idx_q]) + 0.5 * np.pi
        errors.append(np.abs(np.array([angle, found.v[-1, crank.idx_v]]) - true).max())
        assert found.residuals["law"].max() < 1e-12
        if isinstance(stabilisation, rbd.simulation.Projection):
            assert _differs_from_solve(found, loops) < 1e-9
    assert errors[1] < 10.0 * steps[1] ** order * (1.0 if order == 2 else 100.0)
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3


def test_a_hinged_four_bar_moves_as_with_planar_rows():
    """Crank, coupler and rocker of different lengths, turning: the same motion with five rows as with two."""
    robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)
    start = swinging(robot, "assembled", 3.0)
    exact = _last(start, list(robot.loops()), 0.1, 0.4, rbd.DormandPrince8(1e-12, 1e-13)).state(-1)
    errors = []
    for step in (0.005, 0.0025):
        found = _last(start, _hinged(robot), step, 0.4, rbd.RungeKutta4())
        errors.append(off(found.state(-1), exact))
        assert found.residuals["law"].max() < 2e-13
        assert _differs_from_solve(found, _hinged(robot)) < 1e-9
    assert 3.7 < np.log2(errors[0] / errors[1]) < 4.3


def test_bricards_mechanism_keeps_its_energy_at_order_four_and_costs_little():
    """A04: it falls under gravity for a second (rank 4 of 5): energy, forces, order, and how often torques are asked for."""
    robot, asked = bricard(), [0]
    start = rbd.State(robot, np.zeros(5))
    assert rbd.solve(start, np.zeros(5), RING, solver=rbd.KKT()).rank == 4

    def counted(state, t):
        asked[0] += 1
        return np.zeros(5)

    exact = _last(start, RING, 0.1, 1.0, rbd.DormandPrince8(1e-12, 1e-13), controller=counted)
    assert asked[0] < 1000
    assert exact.residuals["law"].max() < 1e-11
    assert np.ptp(exact.energy) < 1e-9 * exact.kinetic.max()
    errors = []
    for step in (0.01, 0.005):
        found = _last(start, RING, step, 1.0, rbd.RungeKutta4())
        errors.append(off(found.state(-1), exact.state(-1)))
        assert found.residuals["law"].max() < 1e-11
        assert _differs_from_solve(found, RING) < 1e-8
    assert 3.7 < np.log2(errors[0] / errors[1]) < 4.3


@pytest.mark.filterwarnings("ignore:the steps of bricard")  # the longest of them
@pytest.mark.parametrize("extrapolate", [False, True])
def test_bricards_mechanism_is_of_order_two_in_time_stepping(extrapolate):
    """In the middle of a step the ring is off by h^2, and its fifth row no longer repeats the others: it must not act."""
    start = rbd.State(bricard(), np.zeros(5))
    exact = _last(start, RING, 0.1, 1.0, rbd.DormandPrince8(1e-12, 1e-13)).state(-1)
    errors = []
    for step in (0.01, 0.005):
        found = _last(start, RING, step, 1.0, rbd.TimeStepping(extrapolate=extrapolate))
        errors.append(off(found.state(-1), exact))
        assert max(found.residuals["law"].max(), found.residuals["drift"].max()) < 1e-11
        assert found.residuals["drift_rate"].max() < 1e-11
        assert _differs_from_solve(found, RING) < 1e-7
    assert errors[1] < 2e-3
    assert 1.7 < np.log2(errors[0] / errors[1]) < 2.3


@pytest.mark.parametrize("frequency", [5.0, 20.0, 50.0])
def test_baumgartes_feedback_keeps_time_stepping_stable_and_of_order_two(frequency):
    """A four-bar's pin under feedback: its drift stays of the size of h^2, and falls with it."""
    robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)
    start = swinging(robot, "assembled", 3.0)
    exact = _last(start, robot.loops(), 0.1, 1.0, rbd.DormandPrince8(1e-12, 1e-13)).state(-1)
    by, drifts, errors = rbd.constraints.Baumgarte(frequency), [], []
    for step in (0.005, 0.0025):
        found = _last(start, robot.loops(), step, 1.0, rbd.TimeStepping(), stabilisation=by)
        drifts.append(found.residuals["drift"].max())
        errors.append(off(found.state(-1), exact))
        assert found.residuals["law"].max() < 1e-9
    assert drifts[0] < 1e-4
    assert 1.8 < np.log2(drifts[0] / drifts[1]) < 2.2
    assert 1.5 < np.log2(errors[0] / errors[1]) < 2.5


def test_a_loop_that_is_open_is_pulled_together_in_time_stepping():
    """From rest an error with error'' + 2 w error' + w^2 error = 0 is (1 + w t) exp(-w t) of what it began with."""
    robot, start = _parallelogram(0.3)
    w, gap = 10.0, pin.integrate(robot.model, start.q, np.array([0.0, 0.0, 1e-3]))
    found = _last(
        rbd.State(robot, gap), robot.loops(), 1e-3, 0.5, rbd.TimeStepping(), stabilisation=rbd.constraints.Baumgarte(w)
    )
    true = found.residuals["drift"][0] * (1.0 + w * found.t) * np.exp(-w * found.t)
    assert found.residuals["drift"][0] > 5e-4
    assert np.abs(found.residuals["drift"] - true).max() < 0.02 * found.residuals["drift"][0]


def test_what_is_known_of_rows_follows_their_norms():
    """Norms that are learned after rows were taken apart: the same answers as of a solver that never knew the old ones."""
    robot, start = _parallelogram(1.0)
    loops = _hinged(robot)
    held, rhs = ConstraintManifold.unchecked(start, loops).rows(start), -start.h
    taught = StageSolver()
    taught.learn(held)
    before = taught.spread(held), taught.acceleration(held, rhs, 0.0).a
    far = held.elsewhere(_parallelogram(-1.4)[1].q, np.zeros(robot.nv))
    taught.learn(far)
    fresh = StageSolver()
    for rows in (held, far):
        fresh.learn(rows)
    again = ConstraintManifold.unchecked(start, loops).rows(start)
    assert taught.spread(held) == fresh.spread(again)
    assert np.abs(taught.acceleration(held, rhs, 0.0).a - before[1]).max() < 1e-12
    assert np.abs(taught.forces(held, before[1], rhs)[0] - fresh.forces(again, before[1], rhs)[0]).max() < 1e-12
    assert taught.law(held, before[1], rhs, None) < 1e-13


class _Disagreeing:
    """Two rows that hold one joint still, and ask for accelerations that differ."""

    name = "disagreeing"

    def __init__(self, by):
        self.by = by

    def rows(self, state):
        return rbd.Rows(self.name, np.eye(2)[[0, 0]], np.array([0.0, self.by]), rbd.problem.Free(2))


EVERY = pytest.mark.parametrize(
    "integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)]
)


@EVERY
def test_a_residual_above_a_ten_millionth_is_said_once(integrator):
    """Rows that differ by 1e-4 m/s2: one warning a run, with size and time; 1e-8 passes in silence."""
    start = rbd.State(chain(2), np.array([0.1, 0.2]))
    with pytest.warns(
        rbd.errors.InaccurateWarning, match=r"residual 'law' is .*e-0. \(scaled\) at t = .* 6 of 6 recorded"
    ) as told:
        found = _last(start, [_Disagreeing(1e-4)], 0.01, 0.05, integrator)
    assert len(told) == 1
    assert found.residuals["law"].max() > 1e-7
    assert f"is {found.residuals['law'].max():.2g} (scaled)" in str(told[0].message)
    assert told[0].filename == __file__
    assert _last(start, [_Disagreeing(1e-8)], 0.01, 0.05, integrator).residuals["law"].max() < 1e-7


@EVERY
def test_rows_that_contradict_each_other_have_no_motion(integrator):
    """Rows that differ by 1 m/s2: refused by name, as by `rbd.solve`."""
    start = rbd.State(chain(2), np.array([0.1, 0.2]))
    with pytest.raises(rbd.errors.SimulationStopped, match="disagreeing"):
        _last(start, [_Disagreeing(1.0)], 0.01, 0.05, integrator)


def test_gravity_that_is_changed_counts_in_the_energy_too():
    """A pendulum on the moon: gravity is read from the model as it is, by the equations and by the energy."""
    robot = chain(1)
    robot.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    found = _last(rbd.State(robot, np.array([0.3])), [], 1e-3, 1.0, rbd.RungeKutta4())
    assert np.ptp(found.potential) > 0.05
    assert np.ptp(found.energy) < 1e-9
    assert abs(robot.weight[2] + 1.62 * robot.mass) < 1e-12


class _Lookout:
    """A push, far away, that is in sight only where the four-bar's loop is off: in the middle of a step, not after it."""

    name = "lookout"

    def __init__(self, robot):
        self.robot, self.seen = robot, [0, 0]

    def rows(self, state):
        (loop,) = [c.rows(state) for c in self.robot.loops()]
        off_by = bool(np.abs(loop.error).max() > 1e-10)
        self.seen[off_by] += 1
        J = np.eye(self.robot.nv)[:1][: int(off_by)]
        return rbd.Rows(self.name, J, np.zeros(len(J)), rbd.problem.NonNegative(len(J)), error=np.full(len(J), 10.0))


@pytest.mark.parametrize("hinged", [True, False])
def test_points_that_come_into_sight_while_a_loop_is_put_right_change_nothing(hinged):
    """The same motion, residuals and forces as without them, of loops with rows that repeat each other and that do not."""
    robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)
    start, lookout = swinging(robot, "assembled", 3.0), _Lookout(robot)
    loops = _hinged(robot) if hinged else list(robot.loops())
    alone = _last(start, loops, 0.01, 0.2, rbd.TimeStepping())
    found = _last(start, [*loops, lookout], 0.01, 0.2, rbd.TimeStepping())
    assert min(lookout.seen) > 20
    close = 1e-11 if hinged else 1e-8  # what enters the contact set ends the way back to the loop after one step of Newton's
    assert np.abs(found.q - alone.q).max() < close
    assert np.abs(found.v - alone.v).max() < 10.0 * close
    assert found.residuals["drift"].max() < close
    assert set(found.modes["lookout"]) == {"open"}
    name = loops[0].name
    assert np.abs(found.forces[name] - alone.forces[name]).max() < 100.0 * close * np.abs(alone.forces[name]).max()


@pytest.mark.parametrize("apart", [1e-3, 1e-7])
def test_rows_that_differ_little_but_truly_are_kept(apart):
    """At an angle of 1e-7 they are two rows, though no Cholesky factor tells; at 1e-10 they are one."""
    W, c, held = np.array([[1.0, 1.0], [0.0, apart], [0.0, 0.0]]), np.array([1.0, 2.0]), np.array([0, 1])
    kept_W, kept_c, left_out, norms, redundant = independent_rows(W, c, held, 0.0)
    assert kept_W is W and kept_c is c and left_out == 0.0 and not redundant
    W = W.copy()
    W[1, 1] = 1e-10
    kept_W, kept_c, left_out, _, redundant = independent_rows(W, c, held, 0.0, norms)
    assert redundant
    assert np.linalg.matrix_rank(kept_W) == 1
    assert kept_c == pytest.approx([1.5, 1.5])  # what both say together
    assert left_out == pytest.approx(0.5)
