"""The pose of a planar chain nearest to a start, among all poses with its end point at a target.

    minimise |q - q_start|^2 / 2   subject to   r(q) = target.

A pose on the target is found first (Levenberg's damped least squares from the start; and, since that does not move if the
start is in line with the target, two poses of three straight pieces, which exist for every target within reach). Then
Newton's method on the family of poses: in the null space N of J, with the curvature of the constraint,

    N^T (I + sum_a lambda_a d2 r_a / dq^2) N z = -N^T (q - q_start),   lambda = -(J J^T)^-1 J (q - q_start),

and back onto the target after each step. The nearest pose found is returned: a minimum, stated in the note if its
curvature shows it, without proof that no other pose is nearer. Pieces: the polygon of the links closes as
long as no side is longer than all others together.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.planar.angles import nearest_turn, units
from rbd.planar.numeric import ROUND_OFF, ChainNumbers

FLAT = 1e-9
"""Gradient [rad] below which a pose counts as nearest."""


def nearest_pose(arm: ChainNumbers, target: Array, start: Array | None) -> tuple[Array, str]:
    """The pose with the end point at a target that is nearest to a start, of three links or more; and a remark.

    Args:
        arm: The chain.
        target: A point within reach, shape (2,) [m].
        start: Angles to be near to, shape (n,) [rad]; None for an evenly bent chain.
    """
    line = _in_line(arm, target, start)
    if line is not None:
        return line
    q0 = evenly_bent(arm, target) if start is None else start
    tried = [
        _reach(arm, target, q0),
        *(_reach(arm, target, nearest_turn(_pieces(arm, target, side), q0)) for side in (1.0, -1.0)),
    ]
    found = [_settle(arm, target, q0, q) for q in tried if q is not None]
    gaps = [float(np.linalg.norm(q - q0)) for q, _ in found]
    best = int(np.argmin(gaps))
    q, minimum = found[best]
    if start is None:
        return q, f"one pose of a family of {arm.n - 2} parameters, near an evenly bent chain"
    which = "the nearest to the start that was found" if minimum else "near the start, though a nearer one may exist"
    twin = any(abs(gap - gaps[best]) < 1e-6 and np.abs(p - q).max() > 1e-3 for (p, _), gap in zip(found, gaps, strict=True))
    also = "; another is just as near" if twin else ""
    return q, f"one pose of a family of {arm.n - 2} parameters, {which}{also}"


def evenly_bent(arm: ChainNumbers, target: Array) -> Array:
    """The chain with equal angles between neighbours, turned to the target, that ends as far from the base as it can match."""
    r = float(np.hypot(*target))
    bends = np.linspace(0.0, np.pi, 181)
    reach = np.hypot(*(arm.ell @ units(bends[:, None] * np.arange(arm.n))).T)
    below = np.flatnonzero(reach <= r)
    if len(below) and below[0] > 0:  # the least bend that matches, between two samples
        low, high = bends[below[0] - 1], bends[below[0]]
        for _ in range(60):
            middle = 0.5 * (low + high)
            outside = np.hypot(*(arm.ell @ units(middle * np.arange(arm.n)))) > r
            low, high = (middle, high) if outside else (low, middle)
        bend = 0.5 * (low + high)
    else:
        bend = bends[np.argmin(np.abs(reach - r))]
    psi = bend * np.arange(arm.n)
    end = arm.ell @ units(psi)
    return arm.from_segment(psi + np.arctan2(target[1], target[0]) - np.arctan2(end[1], end[0]))


def _in_line(arm: ChainNumbers, target: Array, start: Array | None) -> tuple[Array, str] | None:
    """The only pose at the edges of the reach: all links on one line. Its direction is free if it ends at the base."""
    r, slack = float(np.hypot(*target)), ROUND_OFF * arm.outer
    longest = int(np.argmax(arm.ell))
    collinear = 2.0 * arm.ell[longest] >= arm.outer - slack  # the links form no triangle
    if r >= arm.outer - slack:
        turned, note = np.zeros(arm.n), "stretched out, the only pose"
    elif r <= arm.inner + slack and collinear:
        turned, note = np.where(np.arange(arm.n) == longest, 0.0, np.pi), "folded onto one line, the only pose"
    else:
        return None
    psi = np.arctan2(target[1], target[0]) + turned
    q = arm.from_segment(psi)
    if r <= slack:
        note = "folded onto one line through the base, which may point anywhere"
        if start is not None:
            turn = arm.from_segment.rates(np.ones(arm.n))  # of q, as all links turn together
            k = int(turn @ turn)
            # The mean difference to the start; a full turn of one of the k angles that take part moves it by 2 pi / k.
            shifts = turn @ (start - q) / k + 2.0 * np.pi / k * np.arange(k)
            q = min(nearest_turn(q + shifts[:, None] * turn, start), key=lambda way: float(np.linalg.norm(way - start)))
    return (q if start is None else nearest_turn(q, start)), note


def _pieces(arm: ChainNumbers, target: Array, side: float) -> Array:
    """The links before the middle one in a straight piece, the middle one, and those after it: a polygon with the target."""
    l, r = arm.ell, float(np.hypot(*target))
    middle = int(np.searchsorted(np.cumsum(l), 0.5 * arm.outer))
    first, last = float(l[:middle].sum()), float(l[middle + 1 :].sum())
    # How far the end of the first piece may be from the target: both triangles must close.
    low, high = max(abs(r - first), abs(l[middle] - last)), min(r + first, l[middle] + last)
    gap = 0.5 * (low + high)
    toward = np.arctan2(target[1], target[0])
    psi_first = toward - side * _corner(first, r, gap)
    knee = first * units(np.array(psi_first))
    psi_middle = np.arctan2(*(target - knee)[::-1]) - side * _corner(l[middle], gap, last)
    elbow = knee + l[middle] * units(np.array(psi_middle))
    psi_last = np.arctan2(*(target - elbow)[::-1])
    order = np.arange(arm.n)
    return arm.from_segment(np.where(order < middle, psi_first, np.where(order == middle, psi_middle, psi_last)))


def _corner(a: float, b: float, opposite: float) -> float:
    """Angle of a triangle between sides a and b [rad]; 0 if one of them is zero."""
    if a * b == 0.0:
        return 0.0
    return float(np.arccos(np.clip((a * a + b * b - opposite * opposite) / (2.0 * a * b), -1.0, 1.0)))


def _reach(arm: ChainNumbers, target: Array, q: Array, most: int = 100) -> Array | None:
    """Levenberg's method from q onto the target; None if it does not converge."""
    damping, error = 1e-3, arm.position(q) - target
    for _ in range(most):
        size = float(np.hypot(*error))
        if size <= 0.25 * ROUND_OFF * arm.outer:
            return q
        J = arm.jacobian(q)
        # Damping fades with the error, so that the last steps are Newton's.
        shift = damping * min(size * arm.outer, arm.outer**2)
        step = -J.T @ np.linalg.solve(J @ J.T + (shift + 1e-15 * arm.outer**2) * np.eye(2), error)
        step *= min(1.0, 1.0 / float(np.abs(step).max(initial=1e-300)))  # a radian at most
        trial = arm.position(q + step) - target
        if np.hypot(*trial) < size:
            q, error, damping = q + step, trial, 0.1 * damping
        elif damping > 1e6:
            break
        else:
            damping = max(10.0 * damping, 1e-8)
    return q if float(np.hypot(*error)) <= 10.0 * ROUND_OFF * arm.outer else None


def _settle(arm: ChainNumbers, target: Array, q0: Array, q: Array, most: int = 60) -> tuple[Array, bool]:
    """Newton's method on the family, from a pose on the target; and whether it ended in a minimum."""
    for _ in range(most):
        J = arm.jacobian(q)
        _, s, Vt = np.linalg.svd(J)
        if s[1] <= 1e-9 * s[0]:
            return q, False  # in line: the family has no tangent here
        N, off = Vt[2:].T, q - q0
        gradient = N.T @ off
        multiplier = -np.linalg.solve(J @ J.T, J @ off)
        A = arm.to_segment.floats[0]
        pull = -arm.ell * (units(arm.to_segment(q)) @ multiplier)  # d2 r / dpsi_k^2 = -ell_k (cos, sin)
        H = N.T @ (np.eye(arm.n) + A.T @ (pull[:, None] * A)) @ N
        w, U = np.linalg.eigh(H)
        if np.abs(gradient).max() <= FLAT and w[0] > -1e-6:
            return q, bool(w[0] > 0.0)
        # Along directions of negative curvature Newton would climb: their sign is turned, and a saddle is left at a slant.
        climb = U.T @ gradient
        climb = np.where((w < -1e-6) & (np.abs(climb) < 1e-6), 1e-3, climb)
        step = N @ (U @ (-climb / np.maximum(np.abs(w), 1e-3)))
        step *= min(1.0, 1.0 / float(np.abs(step).max()))
        lower, now = None, float(off @ off)
        for halving in range(30):
            moved = _reach(arm, target, q + 0.5**halving * step, 30)
            if moved is not None and float((moved - q0) @ (moved - q0)) < now:
                lower = moved
                break
        if lower is None:
            return q, bool(np.abs(gradient).max() <= 1e-6 and w[0] > 0.0)
        q = lower
    return q, False
