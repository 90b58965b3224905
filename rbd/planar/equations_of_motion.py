"""Dynamics of a planar chain: Lagrange's M(q), C(q, qd) and g(q), written down at once for any number of links.

What is written down is in `rbd.planar.pairs`: one cosine and one sine for every pair of links, and nothing to simplify.
A test derives the same by differentiation.

Sources: [Duarte2021], problem 4; docs/theory.md for the form M a + C v + g = tau.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from rbd.arrays import Array, lazy
from rbd.errors import InputError, SingularInertia
from rbd.planar.angles import Symbols, samples
from rbd.planar.bodies import Bodies, Shapes, bodies_of, constant, refuse_symbols, replacements, symbols_of
from rbd.planar.chain import Chain
from rbd.planar.pairs import Pairs
from rbd.planar.small_motion import Linearised, linearise

GRAVITY = sp.Symbol("g", positive=True)
"""The symbol of gravity [m/s2]."""
SINGULAR = 1e-12
"""A chain is singular where a joint feels less of its inertia, the joints beyond it free, than this part of M_ii."""


@dataclass(frozen=True, eq=False)
class Dynamics:
    """The equations of motion of a planar chain, M(q) qdd + C(q, qd) qd + g(q) = tau, in symbols.

    tau are the forces of the chain's own coordinates [N m]: motor torques for joint angles; for angles from x or from the
    vertical the moment on each link, its motor's torque less that of the next one.

    Attributes:
        chain: Whose angles q they are in.
        bodies: Masses, centres of mass, inertias.
        gravity: Along -y [m/s2].
        M: Inertia, symmetric and positive definite, shape (n, n) [kg m2].
        christoffel: G_ijk, of the first kind, symmetric in j and k, shape (n, n, n) [kg m2].
        C: C_ij = sum_k G_ijk qd_k, shape (n, n) [kg m2/s]; Mdot - 2 C is skew.
        g: Moments against gravity, dV/dq, shape (n, 1) [N m].
        T: Kinetic energy [J].
        V: Potential energy, zero at the height of the base [J].
        equations: tau as functions of q, qd, qdd, shape (n, 1), grouped by links and pairs; it is M qdd + C qd + g [N m].
        bias: C qd + g likewise, shape (n, 1) [N m]: tau where qdd = 0, as `rbd.dynamics.bias_force` of a robot.
    """

    chain: Chain
    bodies: Bodies
    gravity: sp.Expr
    M: Symbols
    christoffel: sp.ImmutableDenseNDimArray
    C: Symbols
    g: Symbols
    T: sp.Expr
    V: sp.Expr
    equations: Symbols
    bias: Symbols

    @property
    def energy(self) -> sp.Expr:
        """T + V [J]; its rate along a motion is tau . qd, and zero without motors."""
        return self.T + self.V

    @property
    def mass_rate(self) -> Symbols:
        """Mdot, by differentiating M, shape (n, n) [kg m2/s]."""
        return self.M.diff(self.chain.t)

    @property
    def skew(self) -> Symbols:
        """N = Mdot - 2 C, shape (n, n): N = -N^T, and so x^T N x = 0: Coriolis forces do no work beside Mdot's."""
        return self.mass_rate - 2 * self.C

    @property
    def coriolis(self) -> Symbols:
        """C qd, shape (n, 1) [N m], a sum over pairs of links in the squares of their rates."""
        return Pairs(self.chain, self.bodies, self.gravity).coriolis_forces()

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """Symbols that are no numbers yet: lengths, masses, centres, inertias, gravity."""
        return tuple(dict.fromkeys((*self.bodies.unknowns, *symbols_of([self.gravity]))))

    def subs(self, values: Mapping[Any, Any]) -> Dynamics:
        """The same with numbers (or other expressions) for symbols.

        Args:
            values: {symbol or its name: number}, as {"m_1": 2.0}; lengths, masses, centres, inertias and "g".

        Raises:
            InputError: what is no symbol of it, numbers that no chain has.
        """
        known = replacements(values, self.unknowns, "these dynamics")
        own = {symbol: value for symbol, value in known.items() if symbol in self.bodies.unknowns}
        bodies = self.bodies.subs(own)
        return _dynamics(self.chain.with_lengths(bodies.lengths), bodies, _gravity(self.gravity.subs(known), self.chain.t))

    def linearised(self, at: Iterable[Any] | None = None) -> Linearised:
        """Small motion about a posture held at rest: M x'' + K x = 0; see `rbd.planar.small_motion`.

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
            q: Angles [rad], shape (n,) or (samples, n); rates and accelerations likewise [rad/s], [rad/s2].
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
            q: Angles [rad], shape (n,) or (samples, n); rates likewise [rad/s].
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


def dynamics(
    chain: Chain,
    *,
    bodies: Shapes | None = None,
    masses: Iterable[Any] | None = None,
    centres: Iterable[Any] | None = None,
    inertias: Iterable[Any] | None = None,
    gravity: Any = None,
) -> Dynamics:
    """Lagrange's equations of a chain.

    What is not given is a positive symbol: m_i, d_i, I_i, g.

    Args:
        chain: The chain; the equations are in its angles.
        bodies: "points" (all mass at each link's end), "rods" (thin and uniform), or None: as centres and inertias say.
        masses: m_i [kg], n numbers or expressions above zero.
        centres: d_i, from each joint along its link to the link's centre of mass [m]; may lie beyond the ends.
        inertias: I_i about the centres of mass [kg m2], zero or more.
        gravity: g, along -y [m/s2]; 0 for a chain that lies flat.

    Raises:
        InputError: wrong counts, numbers that no body has, gravity below zero.

    >>> dyn = dynamics(Chain(2), gravity=0)
    >>> dyn.christoffel[1, 0, 0]
    d_2*ell_1*m_2*sin(theta_2(t))
    """
    known = bodies_of(chain, bodies=bodies, masses=masses, centres=centres, inertias=inertias)
    return _dynamics(chain, known, GRAVITY if gravity is None else _gravity(gravity, chain.t))


def _dynamics(chain: Chain, bodies: Bodies, gravity: sp.Expr) -> Dynamics:
    pairs = Pairs(chain, bodies, gravity)
    return Dynamics(
        chain,
        bodies,
        gravity,
        M=pairs.mass_matrix(),
        christoffel=pairs.christoffel(),
        C=pairs.coriolis_matrix(),
        g=pairs.gravity_moments(),
        T=pairs.kinetic_energy(),
        V=pairs.potential_energy(),
        equations=pairs.equations(),
        bias=pairs.bias(),
    )


def _gravity(given: Any, t: sp.Symbol) -> sp.Expr:
    out = constant("gravity", given, t)
    if out.is_negative:
        raise InputError(f"gravity is {out!s:.80}; expected zero or more: it pulls along -y.")
    return out


def _refuse_singular(M: Array) -> None:
    """M = L L^T, eliminated from the base outward; the last pivots are what tips feel.

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
