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
from rbd.constraints.constraint import Constraint, rows_of
from rbd.model.external import ForceElement, elements_of
from rbd.model.state import State
from rbd.simulation.implicit_forces import ElementTerms
from rbd.simulation.motion import Motion

RESOLVED = 0.8
"""Longest step times the fastest rate of force elements that an explicit method of order 4 resolves to half a percent."""
STABLE = 6.0
"""Longest step times the fastest rate for which Dormand and Prince's method of order 8 is stable, about."""
MANY = 6_000.0
"""Time between samples, times the fastest rate, for which it needs a thousand steps."""
_SHOWN = 4
_DEPENDENT = 1e-9
"""Rows whose singular value is below this, over the largest one, are dependent."""


def too_stiff(motion: Motion, state: State, h: float, t: float | None = None, *, adaptive: bool = False) -> str:
    """Which elements are too stiff at a state for explicit steps of length h, and the cure, in words; empty if none is.

    Elements without derivatives are not looked at, and those of a function of time only if t is given.

    Args:
        motion: The motion.
        state: The state.
        h: Length of a step; of an integrator that chooses its steps, time between samples [s].
        t: Time of the state [s]; None at the start.
        adaptive: Whether the integrator chooses its steps.
    """
    limit = MANY if adaptive else RESOLVED
    given = motion.external
    if callable(given) and t is None:
        return ""
    now = 0.0 if t is None else t
    try:
        elements = elements_of(given(state, now) if callable(given) else given)
        if not elements:
            return ""
        free = _free(motion.constraints, state)
        rate = _rate(state, elements, free)
        if not h * rate > limit:
            return ""
        stiff = [e.name for e in elements if h * _rate(state, [e], free) > limit] or [e.name for e in elements]
    except Exception:  # an explicit method needs no derivatives: what is wrong with those of a user does not stop it
        return ""
    more = f" and {len(stiff) - _SHOWN} more" if len(stiff) > _SHOWN else ""
    cure = f"or steps below {RESOLVED / rate:.2g} s."
    if adaptive:
        cure = f"or wait for some {h * rate / STABLE:.2g} steps between samples."
    return (
        f"stiff force elements ({', '.join(map(repr, stiff[:_SHOWN])):.300}{more}): their fastest rate is {rate:.3g} per "
        f"second, {h * rate:.3g} times 1 / step. Use integrator=rbd.TimeStepping(), which takes them implicitly, {cure}"
    )


def element_rate(state: State, elements: Sequence[ForceElement], *, damped: bool) -> float:
    """Bound of the fastest rate of springs, and of dampers if `damped`, without constraints [1/s]; zero if not known."""
    try:
        return _rate(state, elements, _free((), state), damped=damped)
    except Exception:  # as above
        return 0.0


def _free(constraints: Sequence[Constraint], state: State) -> Array:
    """Directions L^T v that the constraints leave, shape (nv, k)."""
    L = inertia_factor(state.M)
    stacked = [r.J for r in rows_of(state, constraints) if len(r)]
    basis = np.eye(len(L))
    if stacked:
        _, size, rows = np.linalg.svd(solve_triangular(L, np.concatenate(stacked).T, lower=True).T)
        basis = rows[np.count_nonzero(size > _DEPENDENT * size.max(initial=0.0)) :].T
    return np.asarray(solve_triangular(L, basis, lower=True, trans=1))


def _rate(state: State, elements: Sequence[ForceElement], free: Array, *, damped: bool = True) -> float:
    """Bound of the fastest rate [1/s]; without dampers, if not `damped`."""
    terms = ElementTerms.of(state, elements)
    if terms is None or not free.size:
        return 0.0
    d, k = (max(0.0, float(np.linalg.eigvalsh(free.T @ A @ free)[-1])) for A in (terms.D, terms.K))
    d = d if damped else 0.0
    return 0.5 * (d + math.sqrt(d * d + 4.0 * k))
