"""Newton's steps of `rbd.solvers.contact_newton` without compiled code: floats point by point, LAPACK for the bodies' rows.

A NumPy call on the numbers of eight points takes as long as ten operations on Python's floats. So the projection of a point and
its slope are computed from floats, and arrays are used where all points meet: in the wrench, and in Newton's matrix.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import lapack

from rbd.arrays import Array, identity, is_finite, max_abs

PROXIMAL = 1e-7
"""Added to the scaled mobility in Newton's matrix only, so that redundant corners leave it regular."""
EXACT = 1e-12
"""Newton stops at this size of the gap: the steps are quadratic, and an answer may have a hundred times as much."""
STEPS = 50
_MOBILITY = 10.0
"""Mean mobility of the scaled points, which balances weights and accelerations: fewest steps, of 3 to 50 tried."""
_GROWS, _EARLY = 4.0, 6
"""The first steps, in which points change between open, sticking and slipping, may make the sum of squares grow so much."""
_COMPLIANCES = (1e-2, 1e-4)
"""Of equally compliant points, over their mobility: see `rbd.solvers.newton.YIELDING`."""
_TOUCHES = 1e-9
"""Scaled accelerations and weights below this are zero in an answer."""
_DEPENDENT = 1e-5
"""Pivots of the normals' mobility below this, over the largest: their shares of a load may be open."""
_RANK = 1e-8
"""Columns that add less than this to the span of the others, over the largest, add nothing."""
_OPEN = (0.0,) * 9
_SMALL = 1e-200


class Reached(NamedTuple):
    """Scaled weights, in their cones; the length of the gap |w - P(w - y)|, at least its largest entry; steps taken."""

    w: Array
    merit: float
    steps: int


class ContactSteps:
    """Newton's steps for one set of points. Not for two threads at a time: working arrays belong to the object.

    Args:
        P: The wrench of the points' forces on the bodies' rows (nw, 3 k): columns tangent, tangent, normal of each point.
        mu: Friction of the points, shape (k,).
    """

    def __init__(self, P: Array, mu: Array) -> None:
        nw, n = P.shape
        self._P, self._pull = np.asfortranarray(P), np.ascontiguousarray(P.T)
        self._frictions = list(zip(mu.tolist(), (1.0 / (1.0 + mu * mu)).tolist(), strict=True))
        self._eye = np.asfortranarray(identity(nw))
        self._M = np.zeros((n, n))
        down, right = self._M.strides
        self._blocks = as_strided(self._M, (n // 3, 3, 3), (3 * (down + right), down, right))

    def pose(self, D: Array, c: Array) -> bool:
        """Scale the problem: `D` and `q` of the points, the `unit` of their weights; False where it is none.

        Args:
            D: Inverse inertia of the bodies' rows, symmetric positive definite, shape (nw, nw).
            c: Their acceleration without the points' forces, shape (nw,).
        """
        P, pull = self._P, self._pull
        if not (is_finite(D) and is_finite(c)):
            return False
        felt = D.dot(P)
        size, q = float(np.vdot(pull, felt.T)), pull.dot(c)
        if not size > 0.0:
            return False
        size *= 3.0 / (_MOBILITY * len(q))
        _, inertia, info = lapack.dposv(D, self._eye)
        if info != 0:
            return False
        self.rate = rate = max_abs(q) or 1.0
        self.unit = rate / size
        q /= rate
        self.D, self.q, self._inertia = pull.dot(felt) / size, q, inertia * size
        return True

    def steps_from(self, w: Array, *, coulomb: bool, soft: float = 0.0, exact: float = EXACT) -> Reached:
        """Damped semismooth Newton steps from scaled weights, with y = (D + soft) w + q: the best that were found."""
        P, pull, M, k = self._P, self._pull, self._M, soft or PROXIMAL
        S = identity(len(w)) - self.D
        if soft:
            S -= soft * identity(len(w))
        cut, slopes = self._projected(S.dot(w) - self.q, k, coulomb)
        gap = cut - w
        square = float(gap.dot(gap))
        best, least, step = cut, square, 0
        while step < STEPS and least > exact * exact and square < math.inf:
            self._blocks[:] = np.array(slopes).reshape(-1, 3, 3)
            h = M.dot(gap)
            h *= 1.0 - k
            h += gap
            A = M.dot(pull).T.dot(pull).T  # P M P', in LAPACK's order
            A += self._inertia
            _, _, z, info = lapack.dgesv(A, P.dot(h), 1, 1)
            if info != 0:
                break
            h -= M.dot(pull.dot(z))
            before, t = square, 1.0
            for _ in range(7):
                new = w + h if t == 1.0 else w + t * h
                cut, slopes = self._projected(S.dot(new) - self.q, k, coulomb)
                gap = cut - new
                square = float(gap.dot(gap))
                if square <= before * (_GROWS if step < _EARLY else 1.0 - 1e-4 * t):
                    break
                t *= 0.25
            w, step = new, step + 1
            if square < least:
                best, least = cut, square
            if before < 1e-22 and square > 0.1 * before:  # rounding
                break
        return Reached(best, math.sqrt(least) if least < math.inf else math.inf, step)

    def projected(self, w: Array, *, coulomb: bool) -> Array:
        """Scaled weights, moved into their cones."""
        return self._projected(w, PROXIMAL, coulomb)[0]

    def _projected(self, p: Array, k: float, coulomb: bool) -> tuple[Array, list[float]]:
        """(projections P(p) of the positions, and (I - (1 - k) V)^-1 V of each point, row by row, with V the slope of P)."""
        cut: list[float] = []
        slopes: list[float] = []
        firm, rest = 1.0 / k, 1.0 - k
        sticks = (firm, 0.0, 0.0, 0.0, firm, 0.0, 0.0, 0.0, firm)
        each = iter(p.tolist())
        for x, y, z, (mu, share) in zip(each, each, each, self._frictions, strict=False):
            t = math.sqrt(x * x + y * y)
            if t < mu * z:
                cut += (x, y, z)
                slopes += sticks
                continue
            normal = z if coulomb else (mu * t + z) * share
            if not normal > 0.0:
                cut += (0.0, 0.0, normal - normal)  # NaN stays
                slopes += _OPEN
                continue
            t = t or _SMALL
            factor, ex, ey = mu * normal / t, x / t, y / t
            cut += (factor * x, factor * y, normal)
            turned = factor / (1.0 - rest * factor)
            if coulomb:
                edge, across = mu * firm, -turned * ex * ey
                slopes += (turned * ey * ey, across, edge * ex, across, turned * ex * ex, edge * ey, 0.0, 0.0, firm)
            else:
                last = share * firm
                edge = mu * last
                along = mu * edge
                a, b, across = edge * ex, edge * ey, (along - turned) * ex * ey
                slopes += (
                    along * ex * ex + turned * ey * ey, across, a,
                    across, along * ey * ey + turned * ex * ex, b,
                    a, b, last,
                )  # fmt: skip
        return np.array(cut), slopes

    def settled(self, found: Reached, *, coulomb: bool) -> Reached:
        """The limit of the answers of equally compliant points near an answer; that itself where it is not reached."""
        yielding, taken = found.w, found.steps
        for compliance in _COMPLIANCES:
            soft = _MOBILITY * compliance
            # A merit m leaves the shares uncertain by m / compliance.
            w, merit, steps = self.steps_from(yielding, coulomb=coulomb, soft=soft, exact=1e-8 * compliance)
            taken += steps
            if merit > 1e-5 * compliance:
                break
            yielding = w
        if yielding is found.w:
            return found._replace(steps=taken)
        exact = self.steps_from(yielding, coulomb=coulomb)
        return (exact if exact.merit <= max(found.merit, EXACT) else found)._replace(steps=taken + exact.steps)

    def leaves_motion_open(self, w: Array) -> bool:
        """Whether an answer of Coulomb's law is one of a family of motions: `rbd.solvers.newton.leaves_motion_open`.

        In the bodies' rows. Loads N of slipping points and forces g of sticking ones, as changes, move the bodies by z:
        (L + the turning of friction) z = P_edge N + P g. The points' conditions are y_n = 0 of the ones and y = 0 of the
        others. There is a family where some P_edge N + P g other than zero meets them.
        """
        y = self.D.dot(w)
        y += self.q
        touches, slides = self._touching(y.tolist())
        if not slides:
            return False
        R, info = lapack.dpotrf(self.D[touches[:, None], touches])
        pivots = R.diagonal()
        if info == 0 and pivots.min() > _DEPENDENT * pivots.max():
            return False  # independent normals determine their shares
        forces, conditions, H = self._changes((w - y).tolist(), w.tolist(), touches.tolist())
        if not len(forces):
            return False
        basis = _orthonormal(forces.T)
        _, _, moved, info = lapack.dgesv(H, basis)
        return info == 0 and len(_orthonormal(conditions.dot(moved)).T) < basis.shape[1]

    def _touching(self, y: list[float]) -> tuple[Array, bool]:
        """(indices of the normals of points that do not leave, whether one of these slides)."""
        each, touches, slides = iter(y), [], False
        for i, (a, b, normal) in enumerate(zip(each, each, each, strict=True)):
            if normal < _TOUCHES:
                touches.append(3 * i + 2)
                slides = slides or math.hypot(a, b) > _TOUCHES
        return np.array(touches, dtype=int), slides

    def _changes(self, p: list[float], w: list[float], touches: list[int]) -> tuple[Array, Array, Array]:
        """(wrenches of the possible changes of forces, accelerations that must stay zero, inertia with friction's turning)."""
        pull, H = self._pull, self._inertia.copy()
        forces, conditions = [], []
        for at, (mu, _) in zip(range(0, len(p), 3), self._frictions, strict=True):
            x, y, normal = p[at : at + 3]
            if at + 2 in touches:
                normal += max(_TOUCHES - w[at + 2], 0.0)  # a touching unloaded point may become loaded
            if not normal > 0.0:
                continue
            t = math.hypot(x, y)
            if t <= mu * normal:
                forces.append(pull[at : at + 3])
                conditions.append(pull[at : at + 3])
                continue
            along, side = (x * pull[at] + y * pull[at + 1]) / t, (x * pull[at + 1] - y * pull[at]) / t
            forces.append((pull[at + 2] + mu * along)[None])
            conditions.append(pull[at + 2 : at + 3])
            H += side[:, None] * (mu * normal / (t - mu * normal) * side)
        none = np.zeros((0, len(H)))
        return np.concatenate([none, *forces]), np.concatenate([none, *conditions]), H


def _orthonormal(A: Array) -> Array:
    """An orthonormal basis of the columns of A."""
    QR, _, scale, _, _ = lapack.dgeqp3(A)
    pivots = np.abs(QR.diagonal())
    rank = int((pivots > _RANK * pivots[0]).sum())
    return np.asarray(lapack.dorgqr(QR[:, :rank], scale[:rank])[0])
