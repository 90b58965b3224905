"""Least squares over inertias that a body can have: a convex program with one answer, and its certificate.

    minimise over theta     1/2 |A theta - z|^2 + w sum_b D(P_b, P_b0) + 1/2 sum_k ((theta_k - theta_k0) / s_k)^2

A has the weighted base equations, P_b is the pseudo-inertia of body b and D the entropic divergence from the model's
(`rbd.motion.identification.possible`), infinite at the border of what is possible; the last sum is over rotor inertia, damping
and dry friction. It is convex and, over w, self-concordant: damped Newton steps converge from any start, and the decrement
lambda = |gradient| in the metric of the Hessian proves the answer, as F(theta) - min F <= lambda^2 for lambda < 0.68 sqrt(w)
[Nesterov2018]. The weight of the data grows from little to all, as in interior-point methods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from rbd.arrays import Array
from rbd.errors import NoSolution
from rbd.motion.identification.possible import pseudo_inertia, whitened_basis

_STEPS = 400
_GROWTH = 30.0
_NEAR = 0.25
_DONE = 1e-9
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed before the data.

    Attributes:
        theta: The model's parameters, shape (p,); bodies first, ten each.
        bodies: Which bodies have a mass, indices; the parameters of the others stay.
        others: Standard deviations of the parameters that are no body's, shape (p - 10 bodies,).
        weight: w.
    """

    theta: Array
    bodies: Array
    others: Array
    weight: float

    @property
    def free(self) -> Array:
        """Indices of the parameters that are sought: bodies' first."""
        first = len(self.theta) - len(self.others)
        return np.concatenate([(10 * self.bodies[:, None] + np.arange(10)).ravel(), np.arange(first, len(self.theta))])


@dataclass(frozen=True, eq=False)
class Minimum:
    """The answer.

    Attributes:
        theta: Shape (p,).
        decrement: lambda over sqrt(w).
        factor: Upper triangular R_H with R_H^T R_H the Hessian of the free parameters in units of `unit`.
        unit: Of the free parameters.
        steps: Newton steps.
    """

    theta: Array
    decrement: float
    factor: Array
    unit: Array
    steps: int


def minimise(A: Array, z: Array, prior: Prior) -> Minimum:
    """The minimiser of the program above.

    Args:
        A: Weighted equations in all parameters, shape (r, p).
        z: Their right-hand side, shape (r,).
        prior: The model.

    Raises:
        NoSolution: Newton's method did not converge.
    """
    program = _Program(A, z, prior)
    x = np.zeros(len(program.free))
    size = float(np.linalg.norm(program.A, 2)) if program.A.size else 1.0
    share, decrement = min(1.0, prior.weight / max(size, 1e-300) ** 2), np.inf
    exact = max(_DONE, _ROUNDING * (size + float(np.linalg.norm(program.rest))) / prior.weight**0.5)
    for k in range(_STEPS):
        dx, decrement, factor = program.step(x, share)
        if decrement < (exact if share == 1.0 else _NEAR):
            if share == 1.0:
                return Minimum(program.theta(x), decrement, factor, program.unit, k)
            share = min(1.0, share * _GROWTH)
            continue
        x = x + dx * (1.0 if decrement < _NEAR else 1.0 / (1.0 + decrement))
    raise NoSolution(
        f"the inertias were not found: {_STEPS} Newton steps left a decrement of {decrement:.1e}. Are all contacts, their "
        "forces and pushes given? Else give the noise of the measurements (noise=), or a larger prior=."
    )


class _Program:
    """The program in steps from the model, in units of it."""

    def __init__(self, A: Array, z: Array, prior: Prior) -> None:
        self.prior, self.free = prior, prior.free
        theta = prior.theta
        count = len(prior.bodies)
        self.bodies = theta[(10 * prior.bodies[:, None] + np.arange(10)).ravel()].reshape(count, 10)
        self.whitened = np.array([whitened_basis(pseudo_inertia(each)) for each in self.bodies]).reshape(count, 10, 16)
        size = np.linalg.norm(self.whitened, axis=2)
        self.unit = np.concatenate([(1.0 / np.maximum(size, 1e-300)).ravel(), prior.others])
        self.A = A[:, self.free] * self.unit
        self.rest = z - A @ theta
        self.steps_of = (self.whitened.reshape(-1, 16) * self.unit[: 10 * count, None]).reshape(count, 10, 4, 4)

    def theta(self, x: Array) -> Array:
        """All parameters."""
        out = self.prior.theta.copy()
        out[self.free] += self.unit * x
        return out

    def step(self, x: Array, share: float) -> tuple[Array, float, Array]:
        """(Newton step, its decrement over sqrt(w), factor of the Hessian), the data weighted by `share`."""
        w, count = self.prior.weight, len(self.bodies)
        n, root = len(x), share**0.5
        C = np.zeros((16 * count, n))
        gradient_rest = np.zeros(16 * count)
        for b in range(count):
            own = slice(10 * b, 10 * b + 10)
            P = np.eye(4) + np.tensordot(x[own], self.steps_of[b], axes=1)  # in units of the model's
            L = np.linalg.cholesky(P)
            inverse = np.linalg.inv(L)
            C[16 * b : 16 * b + 16, own] = (w**0.5 * inverse @ self.steps_of[b] @ inverse.T).reshape(10, 16).T
            # tr(dP) - tr(P^-1 dP) = <L^T L - 1, L^-1 dP L^-T>
            gradient_rest[16 * b : 16 * b + 16] = w**0.5 * (L.T @ L - np.eye(4)).ravel()
        others = np.zeros((n - 10 * count, n))
        others[:, 10 * count :] = np.eye(n - 10 * count)
        stack = np.concatenate([root * self.A, C, others])
        right = np.concatenate([root * (self.A @ x - self.rest), gradient_rest, x[10 * count :]])
        R = np.asarray(np.linalg.qr(np.column_stack([stack, right]), mode="r"))
        factor, g = R[:n, :n], R[:n, n]
        return -solve_triangular(factor, g), float(np.linalg.norm(g)) / w**0.5, factor
