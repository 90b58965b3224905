"""Force elements in a time step: implicit in velocity and position, so that a stiff one does not shorten the step.

With K = -dtau/dq and D = -dtau/dv of the elements, symmetric parts without negative eigenvalues, the halves of a step are

    M (v_h - v) = h/2 (F(q, v) - h/2 K v) - E (v_h - v) + J^T p                              E = h D T + h^2/4 K
    M (v+ - v)  = h (F(q_m, v_h) + D (v_h - v)) - E (v+ - v) + J^T p

The second line has the elements' force at (q + q+)/2, by K about q_m, and at v + T (v+ - v), by D about v_h. The step is of
order 2 where h d/m is small. On a stiff damper, h d/m above 1, what creeps by it (v = F/d) is of order 1 to 1.75, with errors
that fall as 1/d: 1.0 to 1.1 for 4e4 N s/m on 2 kg between 4 and 1 ms. Of a mass on a linear spring it is the implicit midpoint
rule: its energy is kept at any step, and of a soft spring the frequency is w (1 - (h w)^2 / 12). With dampers, where z are the
eigenvalues of h M^-1 D,

    T(z) = 1/2 (1 + z/3) / (1 + z/6)         between 1/2 and 1
    v+ = R(z) v,    R(z) = (1 - z/3) / (1 + 2 z/3 + z^2/6) = e^-z + O(z^4),    zero for z without bound, at least -0.11

of a damper alone: a stiff one does not ring, and under a constant force it ends at the velocity F / d. (For dampers in joints
alone, D T is diagonal, with z = h d times the diagonal of M^-1 at the start of the motion.) With a stiff spring beside it, such
a damper could push; where the elements' damping would put energy into the motion, the step is repeated with T = 1/2, the
midpoint rule again, which cannot. With constant M, K and D, and without contacts, the energy therefore never grows; of springs
that turn this is not proved.

An element without `derivatives` is taken as a push is: steps must be short against it.
Source: [Hairer2006], chapter VI, of the midpoint rule; [Hairer1996], chapter IV, of stiff equations and Pade's approximations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rbd.answers.analysis.state_changes import derivatives_of
from rbd.arrays import Array, blas, inertia_factor, lazy
from rbd.model.external import ForceElement
from rbd.model.state import State
from rbd.simulation.simulated_motion import dissipation
from rbd.simulation.velocity_problem import VelocityAnswer

_ROUNDING = 1e-12
"""Negative eigenvalues up to this, over the largest one, are rounding."""


class ElementTerms(NamedTuple):
    """The force elements at one state.

    Attributes:
        D: -dtau/dv, symmetric, positive semidefinite, shape (nv, nv).
        K: -dtau/dq, symmetric, positive semidefinite, shape (nv, nv).
        diagonal: Whether both are: elements in joints alone.
        dissipation: Power that the elements take out of the motion [W].
    """

    D: Array
    K: Array
    diagonal: bool
    dissipation: float

    @classmethod
    def of(cls, state: State, elements: Sequence[ForceElement]) -> ElementTerms | None:
        """The terms of elements at a state; None without elements.

        Those without derivatives of their own have no D and K.

        Raises:
            InputError: derivatives of a wrong size or not finite, with the element's name.
        """
        known = [element for element in elements if callable(getattr(element, "derivatives", None))]
        if not elements:
            return None
        by_q, by_v = derivatives_of(known, state)
        K, D, power = -by_q, -by_v, dissipation(elements, state)
        if _is_diagonal(K) and _is_diagonal(D):
            return cls(np.maximum(D, 0.0), np.maximum(K, 0.0), True, power)
        for base in state.robot.bases:
            # A step has the base's velocity in axes that do not turn: K without the turn of the force in the base's axes.
            i = state.robot.model.joints[base].idx_v
            K[i : i + 3, i + 3 : i + 6] = K[i + 3 : i + 6, i : i + 3].T
        D, K = _definite(D), _definite(K)
        return cls(D, K, _is_diagonal(D) and _is_diagonal(K), power)

    def rate(self, M: Array) -> float:
        """Bound of the fastest rate of the elements, sqrt(tr M^-1 K) + tr M^-1 D [1/s]."""
        L = inertia_factor(M)
        return float(np.sqrt(np.trace(_whitened(L, self.K))) + np.trace(_whitened(L, self.D)))


class ImplicitElements:
    """The equations (M + E) (v' - start) = h (applied - h(q, v)) + J^T p of steps with force elements.

    Args:
        start: Start of the motion.
    """

    def __init__(self, start: State) -> None:
        model, robot = start.robot.model, start.robot
        self._start = start
        self._bases = [slice(at, at + 6) for at in (model.joints[j].idx_v for j in robot.bases)]

    @lazy
    def _mobility(self) -> Array:
        """Diagonal of M^-1 at the start, shape (nv,)."""
        return np.linalg.inv(self._start.M).diagonal()

    def is_light(self, terms: ElementTerms | None) -> bool:
        """Whether E is diagonal and zero for floating bases, as the ground's dynamics takes it: elements in joints alone."""
        if terms is None:
            return True
        d, k = terms.D.diagonal(), terms.K.diagonal()
        return terms.diagonal and not any(d[part].any() or k[part].any() for part in self._bases)

    def at_end(self, terms: ElementTerms, state: State, h: float) -> Array:
        """D T of a step of length h from, or over, a state: symmetric, shape (nv, nv)."""
        D = terms.D
        if not D.any():
            return D
        if terms.diagonal:
            d = D.diagonal()
            z = h * d * self._mobility
            return np.diag(0.5 * d * (1.0 + z / 3.0) / (1.0 + z / 6.0))
        L = inertia_factor(state.M)
        W = _whitened(L, D)
        part = 0.5 * np.linalg.solve(np.eye(len(W)) + (h / 6.0) * W, W + (h / 3.0) * W @ W)
        L = np.tril(L)
        return L @ (0.5 * (part + part.T)) @ L.T

    def first_half(self, terms: ElementTerms, state: State, start: Array, applied: Array, h: float) -> tuple[Array, Array]:
        """(E, shape (nv, nv), and `applied`, shape (nv,)) of the first half of a step.

        Args:
            terms: The elements at its beginning.
            state: Its beginning.
            start: Velocity to which h/2 a is added, shape (nv,).
            applied: S^T tau + tau_ext with all forces as they are there, shape (nv,).
            h: Length of the whole step [s].
        """
        E = h * self.at_end(terms, state, h) + 0.25 * h * h * terms.K
        return E, applied - 0.5 * h * (terms.K @ state.v) - E @ (start - state.v) / (0.5 * h)

    def whole_step(
        self,
        terms: ElementTerms,
        middle: State,
        v: Array,
        start: Array,
        applied: Array,
        h: float,
        solution: Callable[[Array, Array], VelocityAnswer],
    ) -> tuple[VelocityAnswer, float, Array]:
        """The answer of a step, the work that elements take out of the motion in it [J], and their impulse less h applied.

        Args:
            terms: The elements in its middle.
            middle: The middle, with the velocity at which forces were evaluated.
            v: Velocity at its beginning, shape (nv,).
            start: Velocity to which h a is added, shape (nv,).
            applied: S^T tau + tau_ext with all forces as they are in the middle, shape (nv,).
            h: Its length [s].
            solution: Gives the answer of `applied` and E.
        """
        D, v_h = terms.D, middle.v
        part = self.at_end(terms, middle, h)
        answer, taken = self._with(terms, part, middle, v, start, applied, h, solution)
        if taken < 0.0:  # dampers would put energy into the motion
            part = 0.5 * D
            answer, taken = self._with(terms, part, middle, v, start, applied, h, solution)
        beyond = terms.dissipation - float(v_h @ D @ v_h)  # of dampers that are not linear in the velocity
        change = answer.v - v
        return answer, taken + h * beyond, h * (D @ (v_h - v) - part @ change - (0.25 * h) * (terms.K @ change))

    def _with(
        self,
        terms: ElementTerms,
        part: Array,
        middle: State,
        v: Array,
        start: Array,
        applied: Array,
        h: float,
        solution: Callable[[Array, Array], VelocityAnswer],
    ) -> tuple[VelocityAnswer, float]:
        """The answer with `part` as D T, and the work of the damping force along the mean velocity [J]."""
        E = h * part + 0.25 * h * h * terms.K
        answer = solution(applied + terms.D @ (middle.v - v) - E @ (start - v) / h, E)
        change = answer.v - v
        return answer, h * float((v + 0.5 * change) @ (terms.D @ v + part @ change))


def _whitened(L: Array, A: Array) -> Array:
    """L^-1 A L^-T of a symmetric A."""
    return blas.dtrsm(1.0, L, blas.dtrsm(1.0, L, A, lower=1).T, lower=1)


def _is_diagonal(A: Array) -> bool:
    return int(np.count_nonzero(A)) == int(np.count_nonzero(A.diagonal()))


def _definite(A: Array) -> Array:
    """The symmetric part of a matrix, without its negative eigenvalues."""
    if _is_diagonal(A):
        return np.maximum(A, 0.0)
    S = 0.5 * (A + A.T)
    rows = np.flatnonzero(S.any(axis=1))
    if not len(rows):  # A is skew, as of a torque fixed in space, seen in the axes of a body that turns
        return S
    size, Q = np.linalg.eigh(S[np.ix_(rows, rows)])
    if size[0] < -_ROUNDING * abs(size).max():
        S[np.ix_(rows, rows)] = (Q * np.maximum(size, 0.0)) @ Q.T
    return S
