"""The force distribution of minimum norm among all admissible forces.

    minimise |T s(x)|^2 over the admissible set        s: corner forces of contacts [N], row forces of all else

with T the identity or the user's weights. The minimiser is unique in s, as the norm is strictly convex there. Over bounds and
facets it is a least-distance program, exact by nonnegative least squares [LawsonHanson1974], chapter 23; over circular cones
Newton's method on its dual (`rbd.solvers.conic_newton`), exact too; where that does not converge (sets without an interior
or weights that mix the corners), Clarabel's interior-point method, then Newton's method from its point.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rbd.answers.analysis.admissible_forces import Admissible
from rbd.answers.analysis.extent import Reach
from rbd.arrays import Array, as_array, block_diagonal, is_finite
from rbd.errors import InputError, UnknownName, nearest
from rbd.errors.inputs import check_kind
from rbd.problem.programs import FORCE_CHOICE_WORK, Work, least_distance
from rbd.solvers.conic_newton import by_dual

MINIMUM_NORM = "minimum norm of the corner forces [N]"
UNIQUE = "unique"
GIVEN_WEIGHT = "minimum of the given weight"

_EVEN = 1e-5
"""Smallest accepted ratio of two square roots of weights."""
_EXACT = 1e-12


def metric(adm: Admissible, weight: Mapping[str, object] | None) -> Array | None:
    """T with |T s|^2 the weighted sum of squares, shape (s, s); None for the plain sum.

    Raises:
        InputError: on weights that are not positive, do not fit, or name no constraint.
    """
    if weight is None:
        return None
    check_kind("weight", weight, Mapping, "{contact name: positive number}")
    for name in weight:
        if name not in adm.spans:
            raise UnknownName(f"weight names {name!r:.80}, which is no constraint here; {nearest(name, adm.spans)}.")
    roots, sizes = [], []
    for name, span in adm.spans.items():
        size = span.stop - span.start
        each = 3 if name in adm.has_corners else 1
        roots.append(_root(name, weight[name], size, each) if name in weight else np.eye(size))
        sizes += np.linalg.svd(roots[-1], compute_uv=False).tolist()
    if sizes and min(sizes) < _EVEN * max(sizes):
        raise InputError(
            f"weights reach from {min(sizes) ** 2:.3g} to {max(sizes) ** 2:.3g} (1 where not named); expected "
            f"the least to be at least {_EVEN**2:.0e} of the largest, or rounding would determine the forces."
        )
    return block_diagonal(roots) if roots else np.zeros((0, 0))


def _root(name: str, given: object, size: int, each: int) -> Array:
    """A square root of one constraint's weight, shape (size, size)."""
    k = size // each
    w = as_array(f"weight of {name!r}", given)
    fits = w.shape in ((), (k,), (size, size)) and is_finite(w)
    if fits and w.ndim < 2 and (w > 0.0).all():
        return np.diag(np.repeat(np.sqrt(np.broadcast_to(w, (k,))), each))
    if fits and w.ndim == 2 and np.abs(w - w.T).max(initial=0.0) <= 1e-9 * np.abs(w).max(initial=0.0):
        values, vectors = np.linalg.eigh(w)
        if (values > 0.0).all():
            return np.asarray(np.sqrt(values)[:, None] * vectors.T)
    raise InputError(
        f"weight of {name!r} is {given!r:.80}; expected a positive number, {k} of them (one a corner), or a positive definite "
        f"matrix of shape ({size}, {size})."
    )


def shortest(adm: Admissible, T: Array | None = None) -> Array | None:
    """Where |T s(x)| is least, shape (n,); None where it was not found within `rbd.problem.programs.FORCE_CHOICE_WORK`."""
    if not adm.null.shape[1]:
        return adm.start.copy()
    E, e = adm.corners, (adm.corners @ adm.start + adm.corners_at) / adm.size
    if T is not None:
        E, e = T @ E, T @ e
        scale = np.abs(T).max()
        E, e = E / scale, e / scale
    H = E @ adm.null
    z = -np.linalg.lstsq(H, e, rcond=1e-12)[0]
    x = adm.start + adm.size * (adm.null @ z)
    if adm.outside(x) <= _EXACT * adm.size:
        return adm.kept(x)
    if not len(adm.mu):
        z = _least_distance(H, e, adm.D @ adm.null, (adm.d - adm.D @ adm.start) / adm.size)
        if z is not None:
            return adm.kept(adm.start + adm.size * (adm.null @ z))
    x = _by_dual(adm, E, e)
    return _within_cones(adm, E, e) if x is None else x


def _by_dual(adm: Admissible, E: Array, e: Array) -> Array | None:
    """The same where |E (x - start) / size + e|^2 has no products of different columns.

    None where it has, or Newton's method on the dual does not converge.
    """
    P = adm.separable(E.T @ E, E.T @ (e - E @ (adm.start / adm.size)))  # e is the value at the start, not at zero
    found = None if P is None else by_dual(P)
    return None if found is None else adm.kept(adm.size * found[0])


def _least_distance(H: Array, c: Array, A: Array, b: Array) -> Array | None:
    """Where |H z + c| is least with A z >= b; None where the active set is not found."""
    Q, R = np.linalg.qr(H)
    if len(R) < H.shape[1] or np.abs(np.diag(R)).min(initial=1.0) <= 1e-9 * np.abs(np.diag(R)).max(initial=0.0):
        # Some directions do not change the norm (corners of a cone without a patch): minimal in those too, to 1e-12.
        H, c = np.vstack([H, 1e-6 * np.eye(H.shape[1])]), np.concatenate([c, np.zeros(H.shape[1])])
        Q, R = np.linalg.qr(H)
    G = np.linalg.solve(R.T, A.T).T
    h = b + G @ (Q.T @ c)
    norms = np.maximum(np.linalg.norm(G, axis=1), 1e-300)
    felt = norms > 1e-12  # the others are constants: 0 >= their part of h
    G, h = G[felt] / norms[felt, None], h[felt] / norms[felt]
    if (found := least_distance(G, h, 1e-14)) is None:
        return None
    u, y = found
    active = y > 0.0
    if active.any():  # refined on the planes found: the last digits
        again = np.linalg.lstsq(G[active], h[active], rcond=1e-12)[0]
        if (h - G @ again).max() <= max(_EXACT, (h - G @ u).max()):
            u = again
    if (h - G @ u).max() > 1e-9:
        return None
    return np.asarray(np.linalg.solve(R, u - Q.T @ c))


def _within_cones(adm: Admissible, E: Array, e: Array) -> Array | None:
    reach = Reach(adm, Work(FORCE_CHOICE_WORK))
    if not reach.known:
        return None
    if not reach.dimension:  # bounds and cones leave one point, as at the limit of friction: the point found
        return adm.kept(adm.start)
    F = E @ reach.rays[0]
    return reach.least(F.T @ F, F.T @ (e - E @ (adm.start / adm.size)))[1]
