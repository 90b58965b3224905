"""Conic programs by another solver, SCS, an operator splitting; and the equations of motion with all forces as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scs
from scipy.sparse import csc_matrix

import rbd
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.problem.conic import Certificate, Conic, Unknowns


@dataclass(frozen=True, eq=False)
class Second:
    """What SCS says.

    Attributes:
        status: "solved", "infeasible", "unbounded", or anything else where it does not know.
        x: Shape (n,).
        value: 1/2 x . H x + g . x.
    """

    status: str
    x: Array
    value: float


def by_scs(program: Conic, *, eps: float = 1e-9, steps: int = 100_000) -> Second:
    """Minimise 1/2 x P x + c x with M x + s = h, s in a product of cones: (s_0, s_1, s_2) with |(s_1, s_2)| <= s_0."""
    n, I = len(program.g), np.eye(len(program.g))
    rows, side = [program.A], [program.b]
    for matrix, bound, sign in (
        (program.C, program.high, 1.0),
        (program.C, program.low, -1.0),
        (I, program.upper, 1.0),
        (I, program.lower, -1.0),
    ):
        there = np.isfinite(bound)
        rows.append(sign * matrix[there])
        side.append(sign * bound[there])
    for (t, s, normal), mu in zip(program.cones, program.mu, strict=True):
        rows.append(-np.array([mu * I[normal], I[t], I[s]]))
        side.append(np.zeros(3))
    M, h = np.vstack(rows), np.concatenate(side)
    cones = {"z": len(program.b), "l": len(h) - len(program.b) - 3 * len(program.mu), "q": [3] * len(program.mu)}
    data = {"P": csc_matrix(np.triu(program.H)), "A": csc_matrix(M), "b": h, "c": program.g}
    settings = {"verbose": False, "eps_abs": eps, "eps_rel": eps, "eps_infeas": 1e-9, "max_iters": steps}
    found = scs.SCS(data, cones, **settings).solve()
    x = np.asarray(found["x"])
    return Second(found["info"]["status"], x, program.value(x) if len(x) == n else np.nan)


def proof(program: Conic, certificate: Certificate) -> tuple[Array, float, float]:
    """(r, gap, left) of a certificate, from its definition: r = -A^T y - C^T z; the least of all terms; what r is outside by.

    y . b + least of z . s over low <= s <= high + least of r . x over X, and the largest part of r for which that is -inf.
    """
    y, z = certificate.y, certificate.z
    r = -(program.A.T @ y) - program.C.T @ z
    gap, left = float(y @ program.b), 0.0
    for k in range(len(z)):
        bound = program.low[k] if z[k] > 0.0 else program.high[k]
        gap += z[k] * bound if z[k] else 0.0
    in_cones = {int(c) for c in program.cones.ravel()}
    for j in set(range(len(r))) - in_cones:
        bound = program.lower[j] if r[j] > 0.0 else program.upper[j]
        if np.isfinite(bound):
            gap += r[j] * bound
        else:
            left = max(left, abs(r[j]))
    for (t, s, n), mu in zip(program.cones, program.mu, strict=True):
        # The dual of |x_t| <= mu x_n is mu |r_t| <= r_n: how far r is from it, by the nearest point of a half-plane.
        tangent = float(np.hypot(r[t], r[s]))
        if mu * tangent > r[n]:
            along = max(0.0, (tangent + mu * r[n]) / (1.0 + mu**2))  # of the nearest point of the edge: (along, mu along)
            sideways = (tangent - along) / tangent * max(abs(r[t]), abs(r[s])) if tangent else 0.0
            left = max(left, sideways, abs(float(r[n] - mu * along)))
    return r, gap, left


@dataclass(frozen=True, eq=False)
class Whole:
    """Torques, forces and more, as columns of M a + h - tau_ext = S^T tau + sum of J^T f + more, written down once more.

    Attributes:
        columns: Generalised forces of units of the columns, shape (nv, n): torques over their limits, forces over the weight.
        cones: Columns (tangent, tangent, normal) of the points with friction.
        mu: Their coefficients.
        lower: Of the columns.
        upper: Of the columns.
        nu: How many of them are torques, the first ones.
    """

    columns: Array
    cones: Array
    mu: Array
    lower: Array
    upper: Array
    nu: int

    @classmethod
    def of(cls, state: rbd.State, contacts: Sequence[Constraint], margin: float, more: Array | None = None) -> Whole:
        """Of contacts with friction by the Jacobians of their corners, of others by their rows; `more` is free."""
        robot, weight = state.robot, state.robot.mass * 9.81
        limit = np.where(np.isfinite(robot.effort_limit), robot.effort_limit, weight)
        blocks = [robot.actuation.T * limit]
        lower, upper = (
            [np.where(np.isfinite(robot.effort_limit), -1.0, -np.inf)],
            [np.where(np.isfinite(robot.effort_limit), 1.0, np.inf)],
        )
        cones, mu = list[list[int]](), list[float]()
        at = robot.nu
        for contact in contacts:
            rows = contact.rows(state)
            if getattr(contact, "friction", None):
                assert rows.patch is not None
                frame = state.frame(contact.frame)  # type: ignore[attr-defined]
                for corner in rows.patch.corners @ rows.patch.axes.T:
                    arm = rows.patch.point + corner - frame.X_WF.translation
                    J = frame.J[:3] - pin.skew(arm) @ frame.J[3:]
                    blocks.append(weight * J.T @ rows.patch.axes)
                    cones.append([at, at + 1, at + 2])
                    mu.append((1.0 - margin) * contact.friction)  # type: ignore[attr-defined]
                    at += 3
            else:
                blocks.append(weight * rows.J.T)
                at += len(rows.J)
        if more is not None:
            blocks.append(more)
        columns = np.hstack(blocks)
        free = np.full(columns.shape[1] - robot.nu, np.inf)
        return cls(
            columns, np.array(cones, int).reshape(-1, 3), np.array(mu), np.concatenate([*lower, -free]),
            np.concatenate([*upper, free]), robot.nu,
        )  # fmt: skip

    def program(self, need: Array, squares: Array, g: Array) -> Conic:
        """Least sum of squares x^2 / 2 + g . x; the equations over the largest entries of their rows."""
        top = np.maximum(np.abs(self.columns).max(axis=1), 1e-12)
        A = self.columns / top[:, None]
        x = Unknowns(len(g), squares, g, self.lower, self.upper, self.cones, self.mu)
        return Conic.of({"x": x}, [({"x": A}, need / top)])
