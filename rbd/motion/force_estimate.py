"""`ForceEstimate`: contact forces estimated from measurements, by constrained least squares, with residuals and covariances.

    minimise |W (E w - b)|^2     subject to     w in X

E w are the generalised forces of the weights w at the coordinates that are measured, b what was measured, W the inverse of a
square root of the covariance of b, and X a product of lines, half-lines, intervals and circular cones. Where w is not unique
the one of least norm is taken: of all w if that is in X, else of those in X that fit as well.

Without an active limit the singular value decomposition of W E gives it. Else proximal steps,

    w <- argmin |W (E w - b)|^2 + eps |w - w_before|^2,     w in X

end at a minimiser [Rockafellar1976]: each is strictly convex, and `rbd.solvers.conic_newton` solves it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import RANK, Array, lazy, null_space
from rbd.displayed import Displayed
from rbd.errors import NoSolution
from rbd.model.state import State
from rbd.motion.sensor_noise import force_scale
from rbd.problem.answer import ContactForce, corners_of
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import Element, ForceSet
from rbd.problem.rows import Rows, by_rows
from rbd.solvers.conic_newton import newton_steps, solve_conic
from rbd.statics.zero_moment_point import wrench_map

DETERMINED = 1e-7
"""A force component with a smaller share in what the data leave open is determined by them."""


@dataclass(frozen=True)
class OpenComponents(Displayed):
    """Force components of some constraints that no measured coordinate feels.

    Attributes:
        names: The constraints. Of several, forces of one are balanced by those of the others.
        count: How many independent components.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> estimate = rbd.estimate_forces(solo.standing(), np.zeros(solo.nv), solo.feet())  # without torques
        >>> [(open.names, open.count) for open in estimate.open]  # twelve forces, six equations
        [(('front_left', 'front_right', 'hind_left', 'hind_right'), 6)]
    """

    names: tuple[str, ...]
    count: int

    def __str__(self) -> str:
        internal = "internal " if len(self.names) > 1 else ""
        return f"{' and '.join(self.names)}: {self.count} {internal}component{'s' if self.count > 1 else ''} unknown"


@dataclass(frozen=True, eq=False, repr=False)
class ForceEstimate(Displayed):
    """Contact forces estimated from measurements, with what they leave unexplained and what is not known of them.

    M a + h - tau_ext - S^T tau = J^T f by least squares, f in the contacts' sets.

    Attributes:
        state: The measured state.
        rows: Rows of the contacts and other constraints.
        measured: Which coordinates have an equation without unknown torques, shape (nv,), of truth values.
        generalised: What the forces have to explain, M a + h - tau_ext - S^T tau (of an observer its low-pass), shape (nv,)
            [N, N m]; of motors without a measured torque with tau = 0.
        sets: The force sets, contacts at rest.
        fit: The weights of the forces, and what the data say of them.
        row_covariance: Covariance of the row forces, shape (m, m), or None without noise. See `covariance`.
        torques: The torques that were measured, shape (nu,), or None.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> estimate = rbd.estimate_forces(solo.standing(), np.zeros(solo.nv), solo.feet())  # without torques
        >>> print(estimate.forces["front_left"].round(3), f"{estimate.open[0].count} components are not known")
        [0.    0.    6.131] 6 components are not known
    """

    state: State
    rows: Sequence[Rows]
    measured: Array
    generalised: Array
    sets: ForceSet
    fit: ForceFit
    row_covariance: Array | None
    torques: Array | None

    @lazy
    def row_forces(self) -> Array:
        """Forces of all rows, stacked, shape (m,) [N, N m]."""
        return np.asarray(self.sets.G @ self.fit.w)

    @lazy
    def slices(self) -> dict[str, slice]:
        """{constraint: its entries of `row_forces`}."""
        ends = np.cumsum([0, *[len(r) for r in self.rows]])
        return {r.name: slice(int(i), int(j)) for r, i, j in zip(self.rows, ends[:-1], ends[1:], strict=True)}

    @lazy
    def forces(self) -> dict[str, Array]:
        """{constraint: force (3,), or wrench (6,) at the patch's centre}, on the robot, world axes [N, N m].

        A constraint without a resultant (a function, a joint) gives its row forces (m,).
        """
        return {r.name: r.force_of(part) for r, part in by_rows(self.rows, self.row_forces)}

    @lazy
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return {r.name: ContactForce.of(r.patch, self.forces[r.name]) for r in self.rows if r.patch is not None}

    @lazy
    def corner_forces(self) -> dict[str, Array]:
        """{contact: (k, 3)} [N], world axes: one split of the wrench among the corners, which no measurement here decides."""
        parts = enumerate(by_rows(self.rows, self.row_forces))
        return {r.name: corners_of(r, f, self.sets, self.fit.w, i) for i, (r, f) in parts if r.patch is not None}

    @lazy
    def _explained(self) -> Array:
        """J^T f, shape (nv,)."""
        return sum([r.J.T @ self.row_forces[self.slices[r.name]] for r in self.rows], np.zeros(len(self.generalised)))

    @lazy
    def residual(self) -> Array:
        """M a + h - tau_ext - S^T tau - J^T f, shape (nv,) [N, N m]: what no allowed contact force explains.

        Zero at motors whose torque was not measured: there `tau` is what it has to be.
        """
        return np.where(self.measured, self.generalised - self._explained, 0.0)

    @lazy
    def tau(self) -> Array:
        """The measured torques; without them, those that go with the motion and these forces, shape (nu,) [N, N m]."""
        if self.torques is not None:
            return self.torques.copy()
        return np.asarray((self.generalised - self._explained)[self.state.robot.actuated])

    @lazy
    def net(self) -> Array:
        """Wrench of all contacts with the surroundings about the centre of mass, world axes, shape (6,) [N, N m]."""
        return np.asarray(self._net_map @ self.row_forces)

    @lazy
    def _net_map(self) -> Array:
        """Map from row forces to `net`, shape (6, m)."""
        return wrench_map(self.rows, np.eye(len(self.row_forces)), self.state.com)

    # ------------------------------------------------------------------------------------------------ what the data leave open

    @lazy
    def _open(self) -> Array:
        """Orthonormal basis of the row forces, in units of the scales of their rows, that no measured coordinate feels."""
        m = len(self.row_forces)
        if not m or not self.measured.any():
            return np.eye(m)
        J = np.concatenate([r.J for r in self.rows]).T[self.measured] / force_scale(self.state)[self.measured, None]
        return null_space(J / self._row_scales)

    @lazy
    def _row_scales(self) -> Array:
        """Length of each row's column over all coordinates, shape (m,)."""
        J = np.concatenate([r.J for r in self.rows]).T / force_scale(self.state)[:, None]
        return np.maximum(np.linalg.norm(J, axis=0), 1e-300)

    @lazy
    def unknown(self) -> Array:
        """Row forces that the data cannot see, as columns, shape (m, d): added to `row_forces` they change nothing measured."""
        return self._open / self._row_scales[:, None] if len(self.row_forces) else np.zeros((0, 0))

    @lazy
    def open(self) -> tuple[OpenComponents, ...]:
        """Which components the data leave open, grouped by the constraints that they couple.

        The forces given are those of least norm: of the corners' forces [N], of other row forces in their units. How the
        corners of a sole share its wrench is always open, and not listed.
        """
        P = self._open @ self._open.T
        groups = list[set[str]]()
        for one, i in self.slices.items():
            coupled = {name for name, j in self.slices.items() if np.abs(P[i, j]).max(initial=0.0) > DETERMINED}
            if coupled:
                joined = [g for g in groups if g & coupled]
                groups = [g for g in groups if not g & coupled] + [set.union({one}, coupled, *joined)]
        out = []
        for group in groups:
            names = tuple(name for name in self.slices if name in group)
            out.append(OpenComponents(names, round(sum(float(np.trace(P[self.slices[n], self.slices[n]])) for n in names))))
        return tuple(out)

    # --------------------------------------------------------------------------------------------------------------- covariance

    @lazy
    def covariance(self) -> dict[str, Array] | None:
        """{constraint: covariance of `forces`, shape (k, k)}; None without noise.

        To first order, on the active set: limits that hold the estimate back (friction, contacts that only push) stay active,
        the curvature of cones and the bias that limits cause are left out, and so are errors of the model. Components that the
        data leave open count as known, zero where the least norm puts them: `deviations` is infinite there.
        """
        if self.row_covariance is None:
            return None
        C = self.row_covariance
        return {r.name: _in_world(r) @ C[s, s] @ _in_world(r).T for r, s in zip(self.rows, self.slices.values(), strict=True)}

    @lazy
    def deviations(self) -> dict[str, Array] | None:
        """{constraint: standard deviations of `forces`}; infinite of what the data leave open. None without noise."""
        if self.covariance is None:
            return None
        out = dict[str, Array]()
        unknown = self.unknown / np.maximum(np.abs(self.unknown).max(axis=0, initial=0.0), 1e-300)
        for r in self.rows:
            seen = np.linalg.norm(_in_world(r) @ unknown[self.slices[r.name]], axis=1) <= DETERMINED
            out[r.name] = np.where(seen, np.sqrt(np.maximum(self.covariance[r.name].diagonal(), 0.0)), math.inf)
        return out

    @lazy
    def net_covariance(self) -> Array | None:
        """Covariance of `net`, shape (6, 6), as `covariance`; None without noise."""
        if self.row_covariance is None:
            return None
        return np.asarray(self._net_map @ self.row_covariance @ self._net_map.T)

    @property
    def chi_square(self) -> float:
        """Sum of the squares of what is left, in standard deviations; expected about `degrees` where the noise is as given.

        Without noise: over effort limits and the weight, with no expectation.
        """
        return float(self.fit.left @ self.fit.left)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi_square`: measured coordinates less what was fitted to them."""
        return int(self.measured.sum()) - self.fit.rank

    def __str__(self) -> str:
        robot = self.state.robot
        base = self.residual[robot.unactuated]
        lines = [
            f"forces of {robot.name} from {int(self.measured.sum())} of {robot.nv} coordinates: largest residual "
            f"{np.abs(base).max(initial=0.0):.3g} N (N m) where no motor is"
            + ("" if self.torques is None else f", {np.abs(self.residual[robot.actuated]).max(initial=0.0):.3g} at the motors")
        ]
        for name, contact in self.contacts.items():
            lines.append(f"  {name:<16}{contact}")
        plain = [r.name for r in self.rows if r.patch is None and len(r)]
        lines += [f"  {name:<15} force {np.array2string(self.forces[name], precision=4)}" for name in plain]
        if self.open:
            choice = "least norm" if self.fit.least_norm else "about least norm"
            lines.append(f"  {'; '.join(map(str, self.open))} (taken: {choice})")
        if self.deviations is not None:
            for name, s in self.deviations.items():
                lines.append(f"  {name:<16}+- {np.array2string(s, precision=3)}")
            lines.append(f"  chi-square {self.chi_square:.3g} of {self.degrees} degrees of freedom")
        return "\n".join(lines)


def _in_world(r: Rows) -> Array:
    """Map from row forces to what `forces` gives."""
    return np.eye(len(r)) if r.resultant is None else r.resultant


_PROXIMAL = 1e-6
"""eps over the largest eigenvalue of the least squares."""
_STEPS = 40
"""Proximal steps. Directions that the data determine to a thousandth of the best one need two or three."""
_SAME = 1e-13
"""A step that moves the fit by less, over its size, was the last."""
_FITS = 1e-10
"""A fit that is worse than the one without limits by less, over its size, is as good."""
_ACTIVE = 1e-9
"""A slope of the squares below this, over their size, is that of a limit that is not active."""
_ROUNDING = 1e-14
"""Weights outside of their sets by less, over the largest, are on the edge."""
_USABLE = 1e-6
"""A miss of the conic solver from which proximal steps go on."""
_EDGE = 1e-9
"""Shares of a force by which it is on the edge of its cone."""


@dataclass(frozen=True, eq=False)
class ForceFit:
    """Weights of contact forces, and what the data say of them.

    Attributes:
        w: Weights, shape (p,) [N].
        tangent: Directions in which the weights may move, with the active limits kept, shape (p, d).
        left: What is left, W (b - E w), shape (k,), in standard deviations where W is of a covariance.
        rank: How many directions of the weights the data determine, active limits kept.
        least_norm: Whether w is the one of least norm among those that fit as well; else it is so to about six digits.
    """

    w: Array
    tangent: Array
    left: Array
    rank: int
    least_norm: bool

    def covariance(self, E: Array, W: Array) -> Array:
        """Covariance of the weights for data with the covariance that W is of, shape (p, p).

        To first order, the active limits kept, the curvature of cones left out. Directions that the data leave open count as
        known: w is the one of least norm.
        """
        P = self.tangent @ np.linalg.pinv(W @ E @ self.tangent, rcond=RANK)
        return np.asarray(P @ P.T)


def fit_forces(E: Array, b: Array, W: Array, sets: ForceSet, unit: float) -> ForceFit:
    """The weights that fit best.

    Args:
        E: Generalised forces of unit weights at the measured coordinates, shape (k, p).
        b: Measured generalised forces, shape (k,).
        W: Inverse of a square root of their covariance, shape (k, k).
        sets: The sets of the weights.
        unit: A size of forces [N].

    Raises:
        NoSolution: the program over the cones was not solved.
    """
    A, c = W @ E, W @ b
    size = float(np.linalg.norm(A, 2)) if A.size else 0.0
    if size == 0.0:  # no weights, or none that the data see
        w = sets.project(np.zeros(sets.size))
        return ForceFit(w, np.eye(sets.size), c - A @ w, 0, True)
    A, target = A / size, c / (size * unit)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = s > RANK * s[0]
    U, s, Vt = U[:, kept], s[kept], Vt[kept]
    known = (U.T @ target) / s
    x, least = Vt.T @ known, True
    weights = Unknowns(sets.size, 1.0, 0.0, sets.lower / unit, sets.upper / unit, sets.cone_columns, sets.mu)
    program = Conic.of({"weights": weights}, [({"weights": Vt}, known)])
    inside = program.project(x)
    if float(np.abs(inside - x).max()) <= _ROUNDING * max(1.0, float(np.abs(x).max())):
        x = inside  # forces of rounding, of a foot in the air, are zero
    else:
        x, least = _limited(program, A, target, U @ (U.T @ target))
    slope = A.T @ (A @ x - target)
    tangent = _tangent(sets, x, slope, _ACTIVE * max(1.0, float(np.linalg.norm(target))))
    free = np.linalg.svd(A @ tangent, compute_uv=False) if tangent.size else np.zeros(0)
    w = x * unit
    return ForceFit(w, tangent, c - W @ (E @ w), int((free > RANK).sum()), least)


def _limited(program: Conic, A: Array, target: Array, best: Array) -> tuple[Array, bool]:
    """(x, whether its norm is the least) with limits that the fit without them breaks.

    Args:
        program: The x of least norm that fit as well as without limits.
        A: Shape (k, p), its largest singular value one.
        target: Shape (k,).
        best: A x of the fit without limits, shape (k,).

    Raises:
        NoSolution: it was not found to six digits.
    """
    n, size, none = len(program.g), max(1.0, float(np.linalg.norm(target))), np.zeros(0)
    near = replace(program, H=A.T @ A + _PROXIMAL * np.eye(n), A=np.zeros((0, n)), b=np.zeros(0), g=-A.T @ target)
    x = np.zeros(n)
    for _ in range(_STEPS):
        posed = replace(near, g=near.g - _PROXIMAL * x)
        found = newton_steps(posed, x, none, none) or solve_conic(posed, newton=False)
        if found.miss > _USABLE:
            how = f"ended {found.outcome.value}, missed by {found.miss:.1e}"
            raise NoSolution(f"the least squares over the friction cones {how}.")
        moved, x = float(np.linalg.norm(A @ (found.x - x))), found.x
        if moved <= _SAME * size:
            break
    if float(np.linalg.norm(A @ x - best)) <= _FITS * size:  # cones allow the fit without limits: with other weights
        exact = solve_conic(program)
        if exact.solved:
            return exact.x, True
    return x, False


def _tangent(sets: ForceSet, x: Array, slope: Array, zero: float) -> Array:
    """Directions that keep the active limits: those with a slope of the squares against them, shape (p, d)."""
    columns = [np.zeros((sets.size, 0))]
    for e in sets.elements:
        part = e.columns
        if np.abs(slope[part]).max(initial=0.0) <= zero:
            own = np.eye(e.size)
        elif e.is_cone:
            own = _along_the_cone(e, x[part])
        else:
            inside = (x[part] > sets.lower[part]) & (x[part] < sets.upper[part])
            own = np.eye(e.size)[:, inside]
        wide = np.zeros((sets.size, own.shape[1]))
        wide[part] = own
        columns.append(wide)
    return np.concatenate(columns, axis=1)


def _along_the_cone(e: Element, force: Array) -> Array:
    """Directions along the surface of a friction cone at a force (tangent, tangent, normal), shape (3, 0, 2 or 3)."""
    tangential = float(np.hypot(force[0], force[1]))
    if tangential <= 0.0 and force[2] <= 0.0:
        return np.zeros((3, 0))
    if tangential < e.mu * force[2] * (1.0 - _EDGE):
        return np.eye(3)
    u, v = force[:2] / tangential
    edge = np.array([e.mu * u, e.mu * v, 1.0]) / np.hypot(e.mu, 1.0)
    return np.column_stack([edge, [-v, u, 0.0]])
