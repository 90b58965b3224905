"""Dynamics of a planar chain: Lagrange's M(q), C(q, qd) and g(q), as sums over pairs of links; small motion about a posture.

In the absolute angles psi_i of the links the kinetic energy is a sum over pairs of links, and the potential energy one over
links, with the constants mu_ij and nu_i of `rbd.planar.bodies`:

    T = 1/2 sum_ij mu_ij cos(psi_i - psi_j) w_i w_j,        V = g sum_i nu_i sin psi_i,        w_i = d psi_i / dt

so the moment that moves link i is E_i = sum_j mu_ij (cos(psi_i - psi_j) dw_j/dt + sin(psi_i - psi_j) w_j^2) + g nu_i cos psi_i.
Other angles are psi = S q + s with constant S: M, the Christoffel symbols and the forces transform with S as tensors, and
without differentiation or simplification. Two links share one cosine whose angle is the sum of the joint angles between them.
A test derives the same by differentiation.

Sources: [Duarte2021], problem 4; docs/courses/least_constraint/free_motion.md for the form M a + C v + g = tau.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import sympy as sp

from rbd.arrays import Array, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, SingularInertia
from rbd.planar.angles import Symbols, samples
from rbd.planar.bodies import LinkBodies, Shapes, bodies_of, constant, refuse_symbols, replacements, symbols_of
from rbd.planar.chain import Chain

GRAVITY = sp.Symbol("g", positive=True)
"""The symbol of gravity [m/s2]."""
SINGULAR = 1e-12
"""A chain is singular if a joint's articulated inertia, with the joints beyond it free, is below this fraction of M_ii."""


@dataclass(frozen=True, eq=False)
class Dynamics(Displayed):
    """The equations of motion of a planar chain, M(q) qdd + C(q, qd) qd + g(q) = tau, in symbols.

    tau are the forces of the chain's own coordinates [N m]: motor torques for joint angles; for angles from x or from the
    vertical the moment on each link, its motor's torque less that of the next one.

    Attributes:
        chain: Whose angles q they are in.
        bodies: Masses, centres of mass, inertias.
        gravity: Along -y [m/s2].

    Example:
        >>> pendulum = rbd.planar.dynamics(rbd.planar.Chain(1, lengths=[1], angles="vertical"), bodies="points", masses=[2])
        >>> pendulum.M, pendulum.g
        (Matrix([[2]]), Matrix([[2*g*sin(theta_1(t))]]))
        >>> pendulum.subs({"g": 9.81}).forward([0.1], [0.0]).round(4)
        array([-0.9794])
    """

    chain: Chain
    bodies: LinkBodies
    gravity: sp.Expr

    @lazy
    def _S(self) -> Symbols:  # noqa: N802  the letter of the equation
        """S of psi = S q + s, shape (n, n): whole numbers."""
        return self.chain.segment_angles.jacobian(self.chain.q)

    @lazy
    def _rates(self) -> Symbols:
        """Rates of the links, w = S qd, shape (n, 1) [rad/s]."""
        return self._S * self.chain.qd

    @lazy
    def M(self) -> Symbols:  # noqa: N802
        """Inertia, symmetric and positive definite, shape (n, n) [kg m2]: M_ab = sum_ij S_ia S_jb mu_ij cos(psi_i - psi_j)."""
        n, S, mu = self.chain.n, self._S, self.bodies.coupling

        def entry(a: int, b: int) -> sp.Expr:
            own = (S[i, a] * S[i, b] * mu(i, i) for i in range(n))
            return sp.Add(*own, *((S[i, a] * S[j, b] + S[j, a] * S[i, b]) * c for (i, j), c in self._cosines.items()))

        return sp.ImmutableMatrix(n, n, entry)

    @lazy
    def christoffel(self) -> sp.ImmutableDenseNDimArray:
        """Christoffel symbols of the first kind, symmetric in the last two, shape (n, n, n) [kg m2].

        G_abc = sum_ij S_ia S_jb S_jc mu_ij sin(psi_i - psi_j): links feel only G_ijj.
        """
        n, S = self.chain.n, self._S

        def entry(a: int, b: int, c: int) -> sp.Expr:
            turns = self._sines.items()
            return sp.Add(*((S[i, a] * S[j, b] * S[j, c] - S[j, a] * S[i, b] * S[i, c]) * s for (i, j), s in turns))

        entries = [entry(a, b, c) for a in range(n) for b in range(n) for c in range(n)]
        return sp.ImmutableDenseNDimArray(entries, (n, n, n))

    @lazy
    def C(self) -> Symbols:  # noqa: N802
        """C_ab = sum_c G_abc qd_c, grouped by pairs of rates, shape (n, n) [kg m2/s]; Mdot - 2 C is skew."""
        n, S, w = self.chain.n, self._S, self._rates

        def entry(a: int, b: int) -> sp.Expr:
            return sp.Add(*(s * (S[i, a] * S[j, b] * w[j] - S[j, a] * S[i, b] * w[i]) for (i, j), s in self._sines.items()))

        return sp.ImmutableMatrix(n, n, entry)

    @lazy
    def g(self) -> Symbols:
        """Moments against gravity, g_a = dV/dq_a = g sum_i S_ia nu_i cos psi_i, shape (n, 1) [N m]."""
        return sp.ImmutableMatrix([sp.Add(*self._weights(a)) for a in range(self.chain.n)])

    @property
    def coriolis(self) -> Symbols:
        """C qd, shape (n, 1) [N m], a sum over pairs of links in the squares of their rates."""
        return sp.ImmutableMatrix([sp.Add(*self._turning(a)) for a in range(self.chain.n)])

    @lazy
    def bias(self) -> Symbols:
        """C qd + g, grouped in the same way, shape (n, 1) [N m]: tau where qdd = 0, as `rbd.dynamics.bias_force` of a robot."""
        return sp.ImmutableMatrix([sp.Add(*self._turning(a), *self._weights(a)) for a in range(self.chain.n)])

    @lazy
    def equations(self) -> Symbols:
        """Forces tau = M qdd + C qd + g [N m], shape (n, 1), grouped by links and pairs: S^T E."""
        n, S, speeding = self.chain.n, self._S, self._S * self.chain.qdd

        def force(a: int) -> sp.Expr:
            own = (S[i, a] * self.bodies.coupling(i, i) * speeding[i] for i in range(n))
            pushed = (c * (S[i, a] * speeding[j] + S[j, a] * speeding[i]) for (i, j), c in self._cosines.items())
            return sp.Add(*own, *pushed, *self._turning(a), *self._weights(a))

        return sp.ImmutableMatrix([force(a) for a in range(n)])

    @lazy
    def T(self) -> sp.Expr:  # noqa: N802
        """Kinetic energy T = 1/2 sum_i mu_ii w_i^2 + sum_{i<j} mu_ij cos(psi_i - psi_j) w_i w_j [J]."""
        w = self._rates
        own = (self.bodies.coupling(i, i) * w[i] ** 2 / 2 for i in range(self.chain.n))
        return sp.Add(*own, *(c * w[i] * w[j] for (i, j), c in self._cosines.items()))

    @lazy
    def V(self) -> sp.Expr:  # noqa: N802
        """Potential energy V = g sum_i nu_i sin psi_i [J], zero at the height of the base."""
        heights = zip(self.bodies.first_moments, self.chain.segment_angles, strict=True)
        total = sp.Add(*(nu * sp.sin(psi) for nu, psi in heights))
        return -self.gravity * -total if total.could_extract_minus_sign() else self.gravity * total

    @property
    def energy(self) -> sp.Expr:
        """T + V [J]; its rate along a motion is tau . qd, and zero without motors."""
        return self.T + self.V

    @property
    def skew(self) -> Symbols:
        """N = Mdot - 2 C, shape (n, n): N = -N^T, and so x^T N x = 0: Coriolis forces do no work but Mdot's."""
        return self.M.diff(self.chain.t) - 2 * self.C

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """Symbols that are no numbers yet: lengths, masses, centres, inertias, gravity."""
        return tuple(dict.fromkeys((*self.bodies.unknowns, *symbols_of([self.gravity]))))

    def subs(self, values: Mapping[Any, Any]) -> Dynamics:
        """The same with numbers (or other expressions) for symbols.

        Args:
            values: {symbol or its name: number}, as {"m_1": 2.0}; lengths, masses, centres, inertias and "g".

        Raises:
            InputError: unknown symbols, invalid numbers.
        """
        known = replacements(values, self.unknowns, "these dynamics")
        own = {symbol: value for symbol, value in known.items() if symbol in self.bodies.unknowns}
        bodies = self.bodies.subs(own)
        return Dynamics(self.chain.with_lengths(bodies.lengths), bodies, _gravity(self.gravity.subs(known), self.chain.t))

    def linearised(self, at: Iterable[Any] | None = None) -> LinearisedChain:
        """Small motion about a posture at rest: `M x'' + K x = 0`; see `rbd.planar.equations_of_motion`.

        Args:
            at: q, n angles [rad], numbers or expressions; by default the chain hanging down.

        Raises:
            InputError: not n angles.

        >>> dyn = dynamics(Chain(1, angles="vertical"), bodies="points", masses=[1])
        >>> dyn.linearised().modes().squared
        (g/ell_1,)
        """
        return linearise(self.chain, self.M, self.g, at)

    def function(self, expression: Any, *, parameters: Mapping[Any, float] | None = None) -> Callable[..., Array]:
        """A fast NumPy function f(q, qd, qdd) of an expression of these dynamics, vectorised over samples.

        Args:
            expression: As `dyn.M` or `dyn.energy`.
            parameters: {symbol or its name: number} for symbols that are left.

        Raises:
            InputError: naming the symbols that are left.
        """
        return self.chain.function(expression, parameters=parameters)

    def inverse(self, q: Any, qd: Any, qdd: Any) -> Array:
        """Inverse dynamics: tau that a motion needs [N m], M qdd + C qd + g.

        Args:
            q: Angles [rad], shape (n,) or (samples, n); rates and accelerations of the same shape [rad/s], [rad/s2].
            qd: Rates.
            qdd: Accelerations.

        Raises:
            InputError: symbols left, wrong shapes, numbers that are not finite.
        """
        refuse_symbols(self.unknowns, "inverse dynamics")
        return self._inverse(q, qd, qdd)

    def forward(self, q: Any, qd: Any, tau: Any = None) -> Array:
        """Forward dynamics: qdd = M^-1 (tau - C qd - g) [rad/s2].

        Args:
            q: Angles [rad], shape (n,) or (samples, n); rates of the same shape [rad/s].
            qd: Rates.
            tau: Forces of the coordinates [N m]; None for none.

        Raises:
            InputError: symbols left, wrong shapes, numbers that are not finite.
            SingularInertia: a link without inertia about its joint.
        """
        refuse_symbols(self.unknowns, "forward dynamics")
        n = self.chain.n
        q, qd = samples("q", q, n), samples("qd", qd, n)
        if qd.shape != q.shape:
            raise InputError(f"qd has shape {qd.shape}, q has {q.shape}; expected the same.")
        right = -self._bias(q, qd)
        if tau is not None:
            forces = samples("tau", tau, n)
            if forces.shape not in (q.shape, (n,)):
                raise InputError(
                    f"tau has shape {forces.shape}, q has {q.shape}; expected the same, or ({n},) for all samples."
                )
            right = right + forces
        M = self._mass(q).reshape(*q.shape[:-1], n, n)
        _refuse_singular(M)
        return np.linalg.solve(M, right[..., None])[..., 0]

    def latex(self) -> str:
        r"""The equations in LaTeX: M, C, g and their sum, as the lines of an `aligned`."""
        lines = {
            r"\mathbf{M}(\mathbf{q})": self.M,
            r"\mathbf{C}(\mathbf{q}, \dot{\mathbf{q}})": self.C,
            r"\mathbf{g}(\mathbf{q})": self.g,
        }
        rows = [rf"{name} &= {self.chain.latex(value)} \\" for name, value in lines.items()]
        law = r"\boldsymbol{\tau} &= \mathbf{M}\,\ddot{\mathbf{q}} + \mathbf{C}\,\dot{\mathbf{q}} + \mathbf{g}"
        return "\n".join([r"\begin{aligned}", *rows, law, r"\end{aligned}"])

    def _repr_latex_(self) -> str:
        """For notebooks."""
        return f"$\\displaystyle {self.latex()}$"

    @lazy
    def _mass(self) -> Callable[..., Array]:
        return self.function(self.M)

    @lazy
    def _bias(self) -> Callable[..., Array]:
        return self.function(self.bias)

    @lazy
    def _inverse(self) -> Callable[..., Array]:
        return self.function(self.equations)

    @lazy
    def _cosines(self) -> dict[tuple[int, int], sp.Expr]:
        return self._by_pair(sp.cos)

    @lazy
    def _sines(self) -> dict[tuple[int, int], sp.Expr]:
        return self._by_pair(sp.sin)

    def _by_pair(self, function: type[sp.Function]) -> dict[tuple[int, int], sp.Expr]:
        """{(i, j) with i < j: mu_ij times a function of psi_i - psi_j}."""
        n, psi, mu = self.chain.n, self.chain.segment_angles, self.bodies.coupling
        return {(i, j): mu(i, j) * function(psi[i] - psi[j]) for i in range(n) for j in range(i + 1, n)}

    def _turning(self, a: int) -> list[sp.Expr]:
        """Centripetal and Coriolis term of coordinate a: mu_ij sin(psi_i - psi_j) (S_ia w_j^2 - S_ja w_i^2) of a pair."""
        S, w, out = self._S, self._rates, []
        for (i, j), s in self._sines.items():
            if S[i, a] == S[j, a]:  # both links are moved: only their relative turning is felt
                out.append(s * S[i, a] * (w[j] - w[i]) * (w[j] + w[i]))
            else:
                out.append(s * (S[i, a] * w[j] ** 2 - S[j, a] * w[i] ** 2))
        return out

    def _weights(self, a: int) -> list[sp.Expr]:
        psi, nu = self.chain.segment_angles, self.bodies.first_moments
        return [self._S[i, a] * self.gravity * nu[i] * sp.cos(psi[i]) for i in range(self.chain.n)]


def dynamics(
    chain: Chain,
    *,
    bodies: Shapes | None = None,
    masses: Iterable[Any] | None = None,
    centres: Iterable[Any] | None = None,
    inertias: Iterable[Any] | None = None,
    gravity: Any = None,
) -> Dynamics:
    """Lagrange's equations of a planar chain, in symbols: M(q) qdd + C(q, qd) qd + g(q) = tau.

    Values not given are positive symbols: m_i, d_i, I_i, g.

    Args:
        chain: The chain; the equations are in its angles.
        bodies: "points" (all mass at each link's end), "rods" (thin and uniform), or None: from centres and inertias.
        masses: m_i [kg], n numbers or expressions above zero.
        centres: d_i, from each joint along its link to the link's centre of mass [m]; may lie beyond the ends.
        inertias: I_i about the centres of mass [kg m2], zero or more.
        gravity: g, along -y [m/s2]; 0 for a horizontal chain.

    Raises:
        InputError: wrong counts, numbers that no body has, gravity below zero.

    Example:
        >>> dyn = rbd.planar.dynamics(rbd.planar.Chain(2), gravity=0)
        >>> dyn.christoffel[1, 0, 0]
        d_2*ell_1*m_2*sin(theta_2(t))
    """
    known = bodies_of(chain, bodies=bodies, masses=masses, centres=centres, inertias=inertias)
    return Dynamics(chain, known, GRAVITY if gravity is None else _gravity(gravity, chain.t))


def _gravity(given: Any, t: sp.Symbol) -> sp.Expr:
    out = constant("gravity", given, t)
    if out.is_negative:
        raise InputError(f"gravity is {out!s:.80}; expected zero or more: it pulls along -y.")
    return out


def _refuse_singular(M: Array) -> None:
    """M = L L^T, eliminated from the base outward; the last pivots are the tips' inertias.

    Raises:
        SingularInertia: naming the joint.
    """
    diagonal = np.diagonal(M, axis1=-2, axis2=-1)
    try:
        pivots = np.diagonal(np.linalg.cholesky(M), axis1=-2, axis2=-1) ** 2
    except np.linalg.LinAlgError:
        pivots = np.zeros_like(diagonal)
    if not (pivots > SINGULAR * diagonal).all():
        raise SingularInertia(
            "M(q) is singular: a link turns without moving any mass. Expected inertias above zero, or centres of mass away "
            "from the joints, such as bodies='rods'."
        )


_SINGULAR = "M is singular at this posture: a link turns without moving any mass. Give it inertia, or bodies='rods'."


@dataclass(frozen=True, eq=False)
class PlanarModes(Displayed):
    """Modes of small motion: x(t) = shape cos(w t + phase), all angles together.

    Attributes:
        squared: w^2 of each mode [rad2/s2], ascending where they are numbers. Below zero the posture is unstable: the mode
            grows as exp(sqrt(-w^2) t).
        shapes: One a column, shape (n, n) [rad], its largest entry 1 (in symbols the first); x^T M y = 0 between two of them.

    Example:
        >>> double = rbd.planar.dynamics(rbd.planar.Chain(2, lengths=[1, 1], angles="vertical"), bodies="points", masses=[1, 1])
        >>> modes = double.subs({"g": 9.81}).linearised().modes()
        >>> modes.frequencies.round(4), modes.shapes.round(4)
        (array([0.3815, 0.9211]), array([[ 0.7071, -0.7071],
               [ 1.    ,  1.    ]]))
    """

    squared: tuple[sp.Expr, ...] | Array
    shapes: sp.MatrixBase | Array

    @property
    def frequencies(self) -> Array:
        """Oscillations per second, w / (2 pi) [Hz], shape (n,); NaN for modes that grow.

        Raises:
            InputError: naming the symbols that are left.
        """
        refuse_symbols(symbols_of(sp.sympify(tuple(self.squared))), "a frequency in hertz")
        squared = np.array([float(x) for x in self.squared])
        return np.where(squared >= 0.0, np.sqrt(np.abs(squared)), np.nan) / (2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class LinearisedChain(Displayed):
    """Small motion about a posture, `M x'' + K x = 0` for x = q - at, with constant forces that keep the posture.

    Attributes:
        at: The posture q, shape (n, 1) [rad].
        M: Inertia there, shape (n, n) [kg m2].
        K: Stiffness d2V/dq2 there, shape (n, n) [N m/rad].
        holding: g(at), the static forces, shape (n, 1) [N m]; zero at an equilibrium.

    Example:
        >>> double = rbd.planar.dynamics(rbd.planar.Chain(2, lengths=[1, 1], angles="vertical"), bodies="points", masses=[1, 1])
        >>> small = double.linearised()
        >>> small.M, small.K
        (Matrix([
        [2, 1],
        [1, 1]]), Matrix([
        [2*g, 0],
        [  0, g]]))
    """

    at: sp.MatrixBase
    M: sp.MatrixBase
    K: sp.MatrixBase
    holding: sp.MatrixBase

    def modes(self) -> PlanarModes:
        """Its modes: det(K - w^2 M) = 0. In symbols for one and two links, else in numbers.

        Raises:
            InputError: symbols left in a chain of more than two links; it names them.
            SingularInertia: M is not positive definite there.
        """
        left = symbols_of([*self.M, *self.K])
        n = self.M.rows
        if not left:
            M, K = (np.array(x.evalf(17), dtype=float) for x in (self.M, self.K))
            try:
                squared, shapes = scipy.linalg.eigh(K, M)
            except np.linalg.LinAlgError:
                raise SingularInertia(_SINGULAR) from None
            return PlanarModes(squared, shapes / shapes[np.abs(shapes).argmax(axis=0), np.arange(n)])
        if n > 2:
            refuse_symbols(left, f"a chain of {n} links, whose modes are roots of a polynomial of degree {n},")
        if self.M.det() == 0:
            raise SingularInertia(_SINGULAR)
        if n == 1:
            return PlanarModes((sp.simplify(self.K[0] / self.M[0]),), sp.ones(1, 1))
        return self._two()

    def _two(self) -> PlanarModes:
        """The two roots of a quadratic, the smaller first."""
        M, K = self.M, self.K
        if M[0, 1] == 0 == K[0, 1]:
            return PlanarModes((sp.simplify(K[0, 0] / M[0, 0]), sp.simplify(K[1, 1] / M[1, 1])), sp.eye(2))
        a, c = M.det(), K.det()
        b = K[0, 0] * M[1, 1] + K[1, 1] * M[0, 0] - 2 * K[0, 1] * M[0, 1]
        # factor, not simplify: a hundred times as fast, and roots of squares are taken.
        half, inside = sp.factor(b / (2 * a)), sp.factor((b**2 - 4 * a * c) / (4 * a**2))
        if inside == 0:  # K = w^2 M: every shape is one
            return PlanarModes((sp.factor_terms(half),) * 2, sp.eye(2))
        root = sp.sqrt(inside)
        squared = tuple(sp.factor_terms(half + sign * root) for sign in (-1, 1))
        shapes = [sp.Matrix(self._shape(half, inside, sign * root)) for sign in (-1, 1)]
        return PlanarModes(squared, sp.ImmutableMatrix(sp.Matrix.hstack(*shapes)))

    def _shape(self, half: sp.Expr, inside: sp.Expr, root: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        """The null vector of K - w^2 M, where w^2 = half + root and root^2 = inside; its first entry that is not zero is 1."""
        for k in (0, 1):
            # x + y ratio = 0, both of them (u + v root): no root is left below the line.
            (u, v), (c, d) = ((self.K[k, j] - half * self.M[k, j], -self.M[k, j]) for j in (0, 1))
            below = sp.factor(c**2 - d**2 * inside)
            if below != 0:
                rational, irrational = (sp.factor(e / below) for e in (d * v * inside - u * c, u * d - v * c))
                return sp.Integer(1), sp.factor_terms(rational + irrational * root)
            x, y = sp.simplify(u + v * root), sp.simplify(c + d * root)
            if y != 0:
                return sp.Integer(1), sp.simplify(-x / y)
            if x != 0:
                break
        return sp.Integer(0), sp.Integer(1)


def linearise(chain: Chain, M: sp.MatrixBase, g: sp.MatrixBase, at: Iterable[Any] | None) -> LinearisedChain:
    """The linear equations of small motion about a posture at rest.

    Args:
        chain: The chain.
        M: Its inertia, shape (n, n) [kg m2].
        g: Moments that balance gravity, shape (n, 1) [N m].
        at: q, n angles [rad], numbers or expressions; None for the chain hanging down.

    Raises:
        InputError: not n angles.
    """
    if at is None:
        down = sp.Matrix([-sp.pi / 2 - psi.subs(dict.fromkeys(chain.q, 0)) for psi in chain.segment_angles])
        posture = chain.segment_angles.jacobian(chain.q).LUsolve(down)
    else:
        if isinstance(at, str) or not np.iterable(at) or len(given := list(at)) != chain.n:
            raise InputError(f"the posture is {at!r:.80}; expected {chain.n} angles [rad], one a link.")
        posture = sp.Matrix([constant(f"angle {i + 1} of the posture", x, chain.t) for i, x in enumerate(given)])
    there = dict(zip(chain.q, posture, strict=True))
    stiffness = g.jacobian(chain.q)
    return LinearisedChain(*(sp.ImmutableMatrix(x) for x in (posture, M.subs(there), stiffness.subs(there), g.subs(there))))
