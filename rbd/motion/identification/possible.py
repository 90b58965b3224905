"""Inertias that a body can have: pseudo-inertia matrices, least squares over them, and how far a mass is open.

    P = [ Sigma   m c ]        Sigma = integral of x x^T dm = 1/2 tr(I) 1 - I,    I about the origin
        [ m c^T   m   ]

is linear in the ten parameters, and positive semidefinite exactly for parameters of some distribution of positive mass
[Wensing2018]. The distance of two bodies that no choice of axes or units changes is the entropic divergence [Lee2020]

    D(P, P_0) = tr(P_0^-1 P) - log det(P_0^-1 P) - 4.

    minimise over theta     1/2 |A theta - z|^2 + w sum_b D(P_b, P_b0) + 1/2 sum_k ((theta_k - theta_k0) / s_k)^2

A has the weighted base equations, P_b is the pseudo-inertia of body b and D the entropic divergence from the model's
(`rbd.motion.identification.possible`), infinite at the border of what is possible; the last sum is over rotor inertia, damping
and dry friction. It is convex and, over w, self-concordant: damped Newton steps converge from any start, and the decrement
lambda = |gradient| in the metric of the Hessian certifies the answer, as F(theta) - min F <= lambda^2 for lambda < 0.68 sqrt(w)
[Nesterov2018]. The weight of the data grows from little to all, as in interior-point methods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular

from rbd.arrays import Array, null_space
from rbd.errors import NoSolution

THIN = 1e-3
"""Where a model's body is impossible, its second moments are raised to this share of the largest."""


BASIS = np.array([pin.PseudoInertia.FromDynamicParameters(each).toMatrix() for each in np.eye(10)])
"""P = sum of theta_k BASIS[k], shape (10, 4, 4)."""


def pseudo_inertia(theta: Array) -> Array:
    """P of ten parameters, shape (..., 4, 4)."""
    return np.asarray(np.tensordot(theta, BASIS, axes=1))


def is_possible(theta: Array) -> bool:
    """Whether some body has these parameters: P is positive definite, well above rounding."""
    m = float(theta[0])
    if not m > 0.0:
        return False
    moments = np.linalg.eigvalsh(_second_moments(theta))
    return bool(moments[0] > 1e-9 * max(moments[2], 1e-12 * m))


def made_possible(theta: Array) -> Array:
    """The parameters with the same mass and centre of mass, and second moments about it raised to be positive."""
    m, c = float(theta[0]), theta[1:4] / theta[0]
    moments, axes = np.linalg.eigh(_second_moments(theta))
    least = max(THIN * float(moments[2]), 1e-6 * m)
    P = np.empty((4, 4))
    P[:3, :3] = (axes * np.maximum(moments, least)) @ axes.T + m * np.outer(c, c)
    P[3, :3] = P[:3, 3] = m * c
    P[3, 3] = m
    return np.asarray(pin.PseudoInertia.FromMatrix(P).toDynamicParameters())


def size_of(theta: Array) -> Array:
    """Typical sizes of a body's parameters, shape (10,): m, m r and m r^2, r its radius of gyration about the origin."""
    m = float(theta[0])
    r2 = 0.5 * float(theta[4] + theta[6] + theta[9]) / m
    return np.array([m, *[m * r2**0.5] * 3, *[m * r2] * 6])


def whitened_basis(P: Array) -> Array:
    """L^-1 BASIS_k L^-T with P = L L^T, shape (10, 4, 4): changes of a body's parameters relative to the body itself."""
    inverse = np.linalg.inv(np.linalg.cholesky(P))
    return np.asarray(inverse @ BASIS @ inverse.T)


def _second_moments(theta: Array) -> Array:
    """About the centre of mass, shape (3, 3)."""
    P, m = pseudo_inertia(theta), float(theta[0])
    c = theta[1:4] / m
    return np.asarray(P[:3, :3] - m * np.outer(c, c))


_INSIDE, _GAP = 1e-5, 1e-4
"""Of an accepted answer: how negative an eigenvalue may be, over the body's own; and the gap to what multipliers exclude."""
_ROWS, _COLUMNS = np.array([(i, j) for j in range(4) for i in range(j + 1)]).T
"""Entries of a symmetric matrix in Clarabel's order: columns of the upper triangle."""
_WEIGHTS = np.where(_ROWS == _COLUMNS, 1.0, 2.0**0.5)
"""What Clarabel multiplies them with."""


def mass_interval(theta: Array, kept: Array, body: int, bodies: int) -> tuple[float, float]:
    """(least, largest) mass of a body, with all pseudo-inertias positive semidefinite.

    Args:
        theta: Parameters that are possible, shape (p,), bodies first.
        kept: Combinations of the parameters that stay, shape (k, p).
        body: Its number.
        bodies: How many bodies there are.

    Raises:
        NoSolution: a program was not solved.
    """
    with_mass = [slice(10 * b, 10 * b + 10) for b in range(bodies) if theta[10 * b] > 0.0]
    bases = [whitened_basis(pseudo_inertia(theta[own])) for own in with_mass]
    unit = np.zeros(len(theta))
    for own, basis in zip(with_mass, bases, strict=True):
        unit[own] = 1.0 / np.linalg.norm(basis.reshape(10, 16), axis=1)
    unit[10 * bodies :] = 1.0
    free = np.flatnonzero(unit)
    scaled = kept[:, free] * unit[free]
    open_ = null_space(scaled / np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)[:, None])
    Z = np.zeros((len(theta), open_.shape[1]))
    Z[free] = unit[free, None] * open_
    changes = [np.tensordot(Z[own].T, basis, axes=1) for own, basis in zip(with_mass, bases, strict=True)]  # (d, 4, 4)
    blocks = [(x[:, _ROWS, _COLUMNS] * _WEIGHTS).T for x in changes if np.abs(x).max(initial=0.0) > 1e-12]
    goal = Z[10 * body]
    m, G, h = float(theta[10 * body]), np.concatenate(blocks), np.tile(np.eye(4)[_ROWS, _COLUMNS], len(blocks))
    low, high = (_extreme(sign * goal, G, h, m) for sign in (1.0, -1.0))
    return max(0.0, m + low), m - high


def _extreme(goal: Array, G: Array, h: Array, mass: float) -> float:
    """Least goal . y with h + G y in a product of semidefinite cones, to 1e-4 of a mass or of itself; -inf: no least one."""
    import clarabel
    from scipy.sparse import csc_matrix

    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.max_iter, settings.time_limit = 200, 20.0
    n, size = len(goal), float(np.abs(goal).max())
    found = clarabel.DefaultSolver(
        csc_matrix((n, n)), goal / size, csc_matrix(-G), h, [clarabel.PSDTriangleConeT(4)] * (len(h) // 10), settings
    ).solve()
    status = str(found.status)
    if "DualInfeasible" in status:
        return -float("inf")
    y, least = np.asarray(found.x), size * float(found.obj_val_dual)
    if "Solved" in status and np.isfinite(y).all():
        value = float(goal @ y)
        inside = np.linalg.eigvalsh(_matrices(h + G @ y)).min()
        if inside > -_INSIDE and value - least < _GAP * max(mass, abs(value)):  # attained, and nothing beyond it is
            return value
    raise NoSolution(f"how far the mass is open was not found: Clarabel says {status}.")


def _matrices(packed: Array) -> Array:
    """Symmetric matrices of their packed entries, shape (k, 4, 4)."""
    out = np.zeros((len(packed) // 10, 4, 4))
    out[:, _ROWS, _COLUMNS] = out[:, _COLUMNS, _ROWS] = packed.reshape(-1, 10) / _WEIGHTS
    return out


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
    theta, free, count, w = prior.theta, prior.free, len(prior.bodies), prior.weight
    bodies = theta[(10 * prior.bodies[:, None] + np.arange(10)).ravel()].reshape(count, 10)
    whitened = np.array([whitened_basis(pseudo_inertia(each)) for each in bodies]).reshape(count, 10, 16)
    unit = np.concatenate([(1.0 / np.maximum(np.linalg.norm(whitened, axis=2), 1e-300)).ravel(), prior.others])
    steps = (whitened.reshape(-1, 16) * unit[: 10 * count, None]).reshape(count, 10, 4, 4)  # of bodies, in units of the model's
    data, rest = A[:, free] * unit, z - A @ theta

    def step(x: Array, share: float) -> tuple[Array, float, Array]:
        """(Newton step, its decrement over sqrt(w), factor of the Hessian), the data weighted by `share`."""
        n, root = len(x), share**0.5
        C, gradient = np.zeros((16 * count, n)), np.zeros(16 * count)
        for b in range(count):
            own = slice(10 * b, 10 * b + 10)
            L = np.linalg.cholesky(np.eye(4) + np.tensordot(x[own], steps[b], axes=1))
            inverse = np.linalg.inv(L)
            C[16 * b : 16 * b + 16, own] = (w**0.5 * inverse @ steps[b] @ inverse.T).reshape(10, 16).T
            # tr(dP) - tr(P^-1 dP) = <L^T L - 1, L^-1 dP L^-T>
            gradient[16 * b : 16 * b + 16] = w**0.5 * (L.T @ L - np.eye(4)).ravel()
        others = np.eye(n)[10 * count :]
        stack = np.concatenate([root * data, C, others])
        right = np.concatenate([root * (data @ x - rest), gradient, x[10 * count :]])
        R = np.asarray(np.linalg.qr(np.column_stack([stack, right]), mode="r"))
        return -solve_triangular(R[:n, :n], R[:n, n]), float(np.linalg.norm(R[:n, n])) / w**0.5, R[:n, :n]

    x, size = np.zeros(len(free)), float(np.linalg.norm(data, 2)) if data.size else 1.0
    share, decrement = min(1.0, w / max(size, 1e-300) ** 2), np.inf
    exact = max(_DONE, _ROUNDING * (size + float(np.linalg.norm(rest))) / w**0.5)
    for k in range(_STEPS):
        dx, decrement, factor = step(x, share)
        if decrement < (exact if share == 1.0 else _NEAR):
            if share == 1.0:
                found = theta.copy()
                found[free] += unit * x
                return Minimum(found, decrement, factor, unit, k)
            share = min(1.0, share * _GROWTH)
            continue
        x = x + dx * (1.0 if decrement < _NEAR else 1.0 / (1.0 + decrement))
    raise NoSolution(
        f"the inertias were not found: {_STEPS} Newton steps left a decrement of {decrement:.1e}. Are all contacts, their "
        "forces and pushes given? Else give the noise of the measurements (noise=), or a larger prior=."
    )
