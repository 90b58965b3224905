"""Force elements in a time step: implicit in velocity and position, so that a stiff one does not shorten the step.

With K = -dtau/dq and D = -dtau/dv of the elements, symmetric parts without negative eigenvalues, at each half of the step:

    (M(q) + E) v_h = M v + h/2 (F(q, v) + D v) + J^T p                                       E = h/2 D' + h^2/4 K
    (M(q_m) + E) v+ = M v + h (F(q_m, v_h) + D v_h - 1/2 D' v + h/4 K v) + J^T p

The second line is M (v+ - v) = h F with the elements' force at (q + q+)/2, by K about q_m, and at (v + v+)/2, by D' about v_h.
Of a mass on a linear spring it is the implicit midpoint rule: its energy is kept at any step, a soft spring's frequency to
w (1 - (h w)^2 / 12). The step is of order 2 whatever K and D are, and it is its own inverse without dampers.

D' agrees with D to h^2 and ends ringing: for a damper alone v+ = R(z) v, where z are the eigenvalues of h M^-1 D and

    R(z) = (1 - z/3) / (1 + 2 z/3 + z^2/6) = e^-z + O(z^4),  zero for z without bound, at least -0.14
    D' = D (M + h/6 D + h^2/12 D M^-1 D)^-1 (M + h/6 D)                                      positive semidefinite as D is

With constant M, K, D and without contacts the energy changes by -h ((v + v+)/2)^T D' (v + v+)/2 exactly: it never grows.
An element without `derivatives` is taken as a push is: steps must be short against it.
Source: [Hairer2006], of the midpoint rule; [Butcher2016], of Pade's approximations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from rbd.analysis.external_derivatives import derivatives_of
from rbd.arrays import Array, inertia_factor
from rbd.model.external import ForceElement
from rbd.model.state import State
from rbd.simulation.motion import dissipation

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
        """The terms of elements at a state; None without elements that have derivatives of their own.

        Raises:
            InputError: derivatives of a wrong size or not finite, with the element's name.
        """
        known = [element for element in elements if callable(getattr(element, "derivatives", None))]
        if not known:
            return None
        by_q, by_v = derivatives_of(known, state)
        K, D, power = -by_q, -by_v, dissipation(known, state)
        diagonal = _is_diagonal(K) and _is_diagonal(D)
        return cls(_definite(D), _definite(K), diagonal, power)

    def rate(self, M: Array) -> float:
        """Bound of the fastest rate of the elements, sqrt(tr M^-1 K) + tr M^-1 D [1/s]."""
        L = inertia_factor(M)
        return float(np.sqrt(np.trace(_whitened(L, self.K))) + np.trace(_whitened(L, self.D)))


class ImplicitForce(NamedTuple):
    """What elements add to the equations of a half step or a step.

    Attributes:
        terms: The elements.
        E: Added to M, shape (nv, nv).
        damping: D', shape (nv, nv).
        applied: S^T tau + tau_ext of the equation for v+ - `start`, shape (nv,).
    """

    terms: ElementTerms
    E: Array
    damping: Array
    applied: Array

    def dissipated(self, v: Array, v_h: Array, v_end: Array, h: float) -> float:
        """Work that the elements take out of the motion in a step [J]: of their force, along the mean velocity.

        Args:
            v: Velocity at its beginning, shape (nv,).
            v_h: Velocity at which forces were evaluated, shape (nv,).
            v_end: Velocity at its end, shape (nv,).
            h: Its length [s].
        """
        mean = 0.5 * (v + v_end)
        beyond = self.terms.dissipation - float(v_h @ self.terms.D @ v_h)  # of a force that is not linear in v
        return h * (float(mean @ self.damping @ mean) + beyond)


def first_half(terms: ElementTerms, M: Array | None, v: Array, start: Array, applied: Array, h: float) -> ImplicitForce:
    """The elements in the first half of a step of length h: the equation is (M + E) (v_h - start) = h/2 (applied - h(q, v)).

    Args:
        terms: The elements at its beginning.
        M: Joint-space inertia there; None: D' is D.
        v: Velocity there, shape (nv,).
        start: Velocity to which h/2 a is added, shape (nv,).
        applied: S^T tau + tau_ext with all forces as they are there, shape (nv,).
        h: Length of the whole step [s].
    """
    damping = terms.D if M is None else without_ringing(M, terms.D, h)
    E = 0.5 * h * damping + 0.25 * h * h * terms.K
    return ImplicitForce(terms, E, damping, applied + terms.D @ v - (E @ start) / (0.5 * h))


def whole_step(
    terms: ElementTerms, M: Array | None, v: Array, v_h: Array, start: Array, applied: Array, h: float
) -> ImplicitForce:
    """The elements in a step of length h: the equation is (M + E) (v+ - start) = h (applied - h(q_m, v_h)).

    Args:
        terms: The elements in its middle.
        M: Joint-space inertia there; None: D' is D.
        v: Velocity at its beginning, shape (nv,).
        v_h: Velocity in its middle, shape (nv,).
        start: Velocity to which h a is added, shape (nv,).
        applied: S^T tau + tau_ext with all forces as they are in the middle, shape (nv,).
        h: Its length [s].
    """
    damping = terms.D if M is None else without_ringing(M, terms.D, h)
    E = 0.5 * h * damping + 0.25 * h * h * terms.K
    force = applied + terms.D @ v_h - 0.5 * (damping @ (v + start)) + 0.25 * h * (terms.K @ (v - start))
    return ImplicitForce(terms, E, damping, force)


def without_ringing(M: Array, D: Array, h: float) -> Array:
    """D' = D (M + h/6 D + h^2/12 D M^-1 D)^-1 (M + h/6 D), shape (nv, nv)."""
    if not D.any():
        return D
    L = inertia_factor(M)
    Z = h * _whitened(L, D)
    part = np.eye(len(D)) + Z / 6.0
    W = np.linalg.solve(part + Z @ Z / 12.0, part @ Z) / h
    half = np.tril(L) @ (0.5 * (W + W.T))
    out: Array = half @ np.tril(L).T
    return out


def _whitened(L: Array, A: Array) -> Array:
    """L^-1 A L^-T."""
    half = blas.dtrsm(1.0, L, A, lower=1)
    out: Array = blas.dtrsm(1.0, L, half.T, lower=1)
    return out


def _is_diagonal(A: Array) -> bool:
    return int(np.count_nonzero(A)) == int(np.count_nonzero(A.diagonal()))


def _definite(A: Array) -> Array:
    """The symmetric part of a matrix, without its negative eigenvalues."""
    if _is_diagonal(A):
        return np.maximum(A, 0.0)
    S = 0.5 * (A + A.T)
    rows = np.flatnonzero(S.any(axis=1))
    size, Q = np.linalg.eigh(S[np.ix_(rows, rows)])
    if size[0] < -_ROUNDING * abs(size).max():
        S[np.ix_(rows, rows)] = (Q * np.maximum(size, 0.0)) @ Q.T
    return S
