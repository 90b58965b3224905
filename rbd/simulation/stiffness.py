"""Whether force elements are too stiff for an explicit step, in words.

With M x'' + D x' + K x = 0 of the elements, every rate s satisfies |s|^2 <= |D| |s| + |K|, with the largest eigenvalues of
L^-1 D L^-T and L^-1 K L^-T on the directions that the constraints leave, where M = L L^T. So s is at most

    (|D| + sqrt(|D|^2 + 4 |K|)) / 2.

Kutta's method errs by 0.3 % of the speed in a step of h s = 0.8, by 0.7 % at 1, and is unstable beyond 2.8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from rbd.arrays import Array, inertia_factor
from rbd.constraints.constraint import rows_of
from rbd.model.external import ForceElement, elements_of
from rbd.model.state import State
from rbd.simulation.implicit_forces import ElementTerms
from rbd.simulation.motion import Motion

RESOLVED = 0.8
"""Longest step times the fastest rate of force elements that an explicit method of order 4 resolves to half a percent."""
_SHOWN = 4
_DEPENDENT = 1e-9
"""Rows whose singular value is below this, over the largest one, are dependent."""


def too_stiff(motion: Motion, state: State, h: float, t: float | None = None) -> str:
    """Which elements are too stiff at a state for explicit steps of length h, and the cure, in words; empty if none is.

    Elements without derivatives are not looked at, and those of a function of time only if t is given.
    """
    given = motion.external
    if callable(given) and t is None:
        return ""
    now = 0.0 if t is None else t
    try:
        elements = elements_of(given(state, now) if callable(given) else given)
        if not elements:
            return ""
        free = _free(motion, state)
        rate = _rate(state, elements, free)
        if not h * rate > RESOLVED:
            return ""
        stiff = [e.name for e in elements if h * _rate(state, [e], free) > RESOLVED] or [e.name for e in elements]
    except Exception:  # an explicit method needs no derivatives: what is wrong with those of a user does not stop it
        return ""
    more = f" and {len(stiff) - _SHOWN} more" if len(stiff) > _SHOWN else ""
    return (
        f"stiff force elements ({', '.join(map(repr, stiff[:_SHOWN])):.300}{more}): their fastest rate is {rate:.3g} per "
        f"second, {h * rate:.3g} times 1 / step. Use integrator=rbd.TimeStepping(), which takes them implicitly, or steps "
        f"below {RESOLVED / rate:.2g} s."
    )


def _free(motion: Motion, state: State) -> Array:
    """Directions L^T v that the constraints leave, shape (nv, k)."""
    L = inertia_factor(state.M)
    stacked = [r.J for r in rows_of(state, motion.constraints) if len(r)]
    basis = np.eye(len(L))
    if stacked:
        _, size, rows = np.linalg.svd(solve_triangular(L, np.concatenate(stacked).T, lower=True).T)
        basis = rows[np.count_nonzero(size > _DEPENDENT * size.max(initial=0.0)) :].T
    return np.asarray(solve_triangular(L, basis, lower=True, trans=1))


def _rate(state: State, elements: Sequence[ForceElement], free: Array) -> float:
    """Bound of the fastest rate [1/s]."""
    terms = ElementTerms.of(state, elements)
    if terms is None or not free.size:
        return 0.0
    d, k = (max(0.0, float(np.linalg.eigvalsh(free.T @ A @ free)[-1])) for A in (terms.D, terms.K))
    return 0.5 * (d + math.sqrt(d * d + 4.0 * k))
