"""What the answers are compared with: Pinocchio's own calls, and scripts that one writes around them; none is certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from bench_draws import FRICTION, Draw, Draws
from bench_timing import Column

import rbd.solvers.qp  # noqa: F401  before ProxSuite: it decides which build the process takes

import proxsuite  # isort: skip

Array = np.ndarray


def generalised(tau: Array) -> Array:
    """S^T tau of a robot with a floating base."""
    return np.concatenate([np.zeros(6), tau])


def raw_terms(d: Draws, draws: Sequence[Draw]) -> Column:
    """M, h, joint Jacobians and drift: what any method without `constraintDynamics` needs from Pinocchio."""
    model, data, zero = d.robot.model, d.robot.model.createData(), np.zeros(d.robot.nv)

    def run(i: int) -> object:
        q, v, _ = draws[i]
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, zero)
        return data.M

    return run


class ConstraintDynamics:
    """The unit: one raw `constraintDynamics` call on both soles held, without regularisation, one iteration."""

    def __init__(self, d: Draws) -> None:
        self.model, self.data = d.robot.model, d.robot.model.createData()
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for sole in d.held:
            f = d.robot.frame(sole.frame)
            X_JP = f.placement * sole.placement
            m = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, self.model, f.parentJoint, X_JP, pin.LOCAL)
            self.models.append(m)
            self.datas.append(m.createData())
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        self.settings = pin.ProximalSettings(1e-10, 1e-10, 0.0, 1)

    def column(self, draws: Sequence[Draw]) -> Column:
        """One call a draw; the generalised forces are made beforehand."""
        forces = [generalised(tau) for _, _, tau in draws]
        model, data, models, datas, settings = self.model, self.data, self.models, self.datas, self.settings

        def run(i: int) -> Array:
            q, v, _ = draws[i]
            return pin.constraintDynamics(model, data, q, v, forces[i], models, datas, settings)

        return run


class PlainScript:
    """What one writes in twenty lines with Pinocchio and NumPy, unchecked: held soles by a linear system."""

    def __init__(self, d: Draws) -> None:
        self.model, self.data = d.robot.model, d.robot.model.createData()
        frames = [d.robot.frame(sole.frame) for sole in d.held]
        self.sites = [(f.parentJoint, f.placement * sole.placement) for f, sole in zip(frames, d.held, strict=True)]
        self.zero = np.zeros(d.robot.nv)

    def terms(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """M, h, J and J_dot v of both soles, in their patches' axes."""
        model, data = self.model, self.data
        pin.crba(model, data, q)
        pin.nonLinearEffects(model, data, q, v)
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, self.zero)
        J = np.vstack([pin.getFrameJacobian(model, data, j, X, pin.LOCAL) for j, X in self.sites])
        drift = [pin.getFrameClassicalAcceleration(model, data, j, X, pin.LOCAL).vector for j, X in self.sites]
        return data.M, data.nle, J, np.concatenate(drift)

    def column(self, draws: Sequence[Draw]) -> Column:
        """One acceleration a draw."""

        def run(i: int) -> Array:
            q, v, tau = draws[i]
            M, h, J, bias = self.terms(q, v)
            m = len(J)
            K = np.block([[M, J.T], [J, np.zeros((m, m))]])
            return np.linalg.solve(K, np.concatenate([generalised(tau) - h, -bias]))[: len(h)]

        return run


class PlainProxQP(PlainScript):
    """The same for frictional soles: Gauss's quadratic program in `a`, pyramids of four facets at each corner, by ProxQP."""

    def __init__(self, d: Draws) -> None:
        super().__init__(d)
        facets = FRICTION * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
        rays = np.column_stack([facets, np.ones(4)])
        blocks = []
        for sole in d.frictional:
            blocks.append(np.vstack([np.hstack([rays, np.cross(corner, rays)]) for corner in sole.corners]))
        n, k = len(blocks[0]), len(blocks)
        self.rays = np.zeros((n * k, 6 * k))
        for i, block in enumerate(blocks):
            self.rays[n * i : n * i + n, 6 * i : 6 * i + 6] = block
        self.none, self.high = np.zeros((0, d.robot.nv)), np.full(n * k, 1e20)

    def column(self, draws: Sequence[Draw]) -> Column:
        """One acceleration a draw."""
        nv, nothing = self.model.nv, np.zeros(0)

        def run(i: int) -> Array:
            q, v, tau = draws[i]
            M, h, J, bias = self.terms(q, v)
            qp = proxsuite.proxqp.dense.QP(nv, 0, len(self.high))
            qp.settings.eps_abs, qp.settings.eps_rel = 1e-10, 0.0
            low = -self.rays @ bias
            qp.init(M, h - generalised(tau), self.none, nothing, self.rays @ J, low, self.high, False, 1e-9, 1e-8)
            qp.solve()
            return qp.results.x

        return run
