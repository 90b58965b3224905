"""Inverse kinematics of a planar chain: angles that bring the end point to a target, or the nearest pose that does.

One link: theta = atan2(y, x), if the target is on its circle. Two links, with r = |target|: by the half-angle formulas of the
triangle with sides ell_1, ell_2, r, which lose no digits near the stretched and the folded pose, as arccos does there:

    theta_2 = +- 2 atan2(sqrt((s - r)(s + r)), sqrt((r - d)(r + d))),   s = ell_1 + ell_2,   d = ell_1 - ell_2,
    theta_1 = atan2(y, x) -+ 2 atan2(sqrt((s - r)(r - d)), sqrt((s + r)(r + d))).

More links: of all poses with the end point at the target the one nearest to a start,

    minimise |q - q_start|^2 / 2   subject to   r(q) = target.

`rbd.planar.inverse_kinematics` seeks it.

Source of one and two links: [Duarte2021], "Inverse kinematics".

    minimise |q - q_start|^2 / 2   subject to   r(q) = target.

A pose on the target is found first (Levenberg's damped least squares from the start; and, since that does not move if the
start is in line with the target, from two poses in which the links form three straight lines; these exist for every target
within reach). Then Newton's method on the family of poses: in the null space N of J, with the curvature of the constraint,

    N^T (I + sum_a lambda_a d2 r_a / dq^2) N z = -N^T (q - q_start),   lambda = -(J J^T)^-1 J (q - q_start),

and back onto the target after each step. The nearest pose found is returned: a minimum, stated in the note if its
curvature shows it, without proof that no other pose is nearer. Lines: the polygon of the links closes as long as no side is
longer than all others together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array, check_number
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar.angles import nearest_turn, plain, units, wrapped
from rbd.planar.chain import Chain, check_chain
from rbd.planar.expressions import coordinate
from rbd.planar.numeric import ROUND_OFF, ChainNumbers
from rbd.records import number

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
        now, tries = float(off @ off), (_reach(arm, target, q + 0.5**halving * step, 30) for halving in range(30))
        lower = next((p for p in tries if p is not None and float((p - q0) @ (p - q0)) < now), None)
        if lower is None:
            return q, bool(np.abs(gradient).max() <= 1e-6 and w[0] > 0.0)
        q = lower
    return q, False


TOLERANCE = 1e-12
"""Beyond reach by less than this part of the chain's length counts as reachable: round-off of whoever computed the target."""
SINGULAR = 1e-7
"""Smallest over largest singular value of J (two links: sin theta_2) below which a pose is called singular."""


@dataclass(frozen=True, eq=False)
class Inverse(Displayed):
    """Angles that bring the end point to a target, or how far the target is out of reach.

    Attributes:
        target: The target point [m], shape (2,).
        branches: Angles, as the chain measures them [rad], shape (k, n): none if unreachable; two links have two, the one
            that bends counterclockwise first (theta_2 in (0, pi): the elbow is to the right of the line from the base to the
            target), or one where they meet; more than two links have families, of which one member is given. With a start,
            the nearest is first, and angles are within half a turn of it; else they are in (-pi, pi].
        reachable: Whether the chain reaches it.
        distance: From the target to the nearest point within reach [m]; zero within it.
        nearest: That point [m], shape (2,): the target itself if it is within reach.
        singular: Whether the chain is in line at `nearest`: stretched or folded, where the end point cannot move outwards or
            inwards. Always False for a single link.
        note: Remark on special cases; else empty.

    Example:
        >>> found = rbd.planar.inverse(rbd.planar.Chain(2, lengths=[1.0, 1.0]), [3.0, 0.0])
        >>> found.reachable, found.distance, found.nearest
        (False, 1.0, array([2., 0.]))
    """

    target: Array
    branches: Array
    reachable: bool
    distance: float
    nearest: Array
    singular: bool
    note: str

    @property
    def q(self) -> Array:
        """The first branch [rad], shape (n,).

        Raises:
            InputError: if the target is out of reach.
        """
        if not self.reachable:
            raise InputError(self.note)
        return self.branches[0].copy()

    def __str__(self) -> str:
        if not self.reachable:
            return self.note
        rows = [", ".join(number(angle) for angle in row) for row in np.round(np.degrees(self.branches), 9)]
        note = f" ({self.note})" if self.note else ""
        return f"({self.target[0]:g}, {self.target[1]:g}) m: " + " or ".join(f"({row}) deg" for row in rows) + note


def inverse(
    chain: Chain, target: Sequence[float] | Array, *, start: Sequence[float] | Array | None = None, tolerance: float = TOLERANCE
) -> Inverse:
    """Angles that bring the end point of a chain to a target, all branches of one and two links.

    Args:
        chain: The chain, its lengths numbers.
        target: Where the end point shall be [m], shape (2,).
        start: Angles to be near to, shape (n,) [rad], as the chain measures them. With more than two links, the pose nearest
            to them (least sum of squared differences of the chain's own angles); by default, nearest to an evenly bent chain.
        tolerance: How far beyond reach, relative to the sum of the lengths, still counts as reachable; the branches then
            bring the end point to `nearest`.

    Raises:
        InputError: on lengths that are symbols, a target or start of another shape, or numbers that are not finite.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> found = rbd.planar.inverse(arm, [1.0, 1.0])
        >>> found.branches.round(4)
        array([[ 0.    ,  1.5708],
               [ 1.5708, -1.5708]])
    """
    arm = check_chain(chain).numeric
    point = plain("target", target, (2,), ": x and y of the end point [m]")
    near = check_start(start, arm.n)
    relative = check_tolerance(tolerance)
    distance = float(arm.distance(point))
    direction = 0.0 if near is None else float(np.arctan2(*arm.position(near)[::-1]))
    nearest = arm.nearest(point, np.array(direction))
    if not arm.reachable(np.array(distance), relative):
        singular = arm.n > 1
        return Inverse(point, np.empty((0, arm.n)), False, distance, nearest, singular, _unreachable(arm, point, distance))
    branches, singular, note = _solve(arm, nearest, near, direction)
    return Inverse(point, branches, True, distance, nearest, singular, note)


def _unreachable(arm: ChainNumbers, point: Array, distance: float) -> str:
    where = f"the target ({point[0]:g}, {point[1]:g}) m is out of reach by {distance:g} m: {arm.beyond(point)}"
    around = " All points at that radius are equally near." if not point.any() else ""
    return f"{where}. The nearest point that can be reached is `nearest`.{around}"


def _solve(arm: ChainNumbers, point: Array, near: Array | None, direction: float) -> tuple[Array, bool, str]:
    """Branches, whether they are singular, and a remark, for a point within reach."""
    if arm.n == 1:
        q = arm.from_segment(np.arctan2(point[1:], point[:1]))[None]
        return wrapped(q) if near is None else nearest_turn(q, near), False, ""
    if arm.n > 2:
        q, note = nearest_pose(arm, point, near)
        s = np.linalg.svd(arm.jacobian(q), compute_uv=False)
        singular = bool(s[1] <= SINGULAR * s[0])
        kind = "the chain is in line: a singular pose" if singular else ""
        return (q if near is not None else wrapped(q))[None], singular, "; ".join(filter(None, [kind, note]))
    bend, lean, toward = triangle(arm, point)
    at_base = not point.any()
    if at_base:
        toward = lean  # the first link along x
    signs = np.array([1.0]) if at_base or bend in (0.0, np.pi) else np.array([1.0, -1.0])
    first = toward - signs * lean
    q = arm.from_segment(np.stack([first, first + signs * bend], axis=-1))
    if at_base:
        if near is not None:  # the first link may point anywhere: where it does at the start
            q = q + (near[0] - q[0, 0]) * arm.from_segment.rates(np.ones(arm.n))
        note = "the end point is at the base: folded, and the first link may point anywhere, a family of one parameter"
        return (wrapped(q) if near is None else nearest_turn(q, near)), True, note
    if near is None:
        q = wrapped(q)
    else:
        q = nearest_turn(q, near)
        q = q[np.argsort(np.sum((q - near) ** 2, axis=1), kind="stable")]
    if not np.sin(bend) < SINGULAR:
        return q, False, ""
    return q, True, f"{'stretched out' if bend < 1.0 else 'folded'}: a singular pose, where both branches meet"


def triangle(arm: ChainNumbers, points: Array) -> tuple[Array, Array, Array]:
    """Of two links: the elbow's angle, the first link's angle from the line to the target, and that line's direction [rad].

    Args:
        arm: Two links.
        points: Within reach, shape (..., 2) [m].

    Returns:
        Bend in [0, pi], angle of the first link in [0, pi], direction (0 at the base itself); shape (...) each.
    """
    r = np.hypot(points[..., 0], points[..., 1]) / arm.outer
    hole = arm.inner / arm.outer
    r = np.where(r > 1.0 - ROUND_OFF, 1.0, np.where(r < hole + ROUND_OFF, hole, r))
    if hole == 0.0:  # equal lengths: r falls out of the second quotient
        bend = 2.0 * np.arctan2(np.sqrt((1.0 - r) * (1.0 + r)), r)
        lean = 2.0 * np.arctan2(np.sqrt(1.0 - r), np.sqrt(1.0 + r))
    else:
        d = float(np.copysign(hole, arm.ell[0] - arm.ell[1]))
        bend = 2.0 * np.arctan2(np.sqrt((1.0 - r) * (1.0 + r)), np.sqrt((r - hole) * (r + hole)))
        lean = 2.0 * np.arctan2(np.sqrt((1.0 - r) * (r - d)), np.sqrt((r + d) * (1.0 + r)))
    return bend, lean, np.arctan2(points[..., 1], points[..., 0])


def inverse_formulas(chain: Chain, x: Any = None, y: Any = None) -> tuple[sympy.MatrixBase, ...]:
    """Inverse kinematics of one and two links in symbols, with atan2: one branch, or two.

    theta_2 = atan2(+-s, c) with c = (r^2 - ell_1^2 - ell_2^2) / (2 ell_1 ell_2) and s = sqrt(1 - c^2);
    theta_1 = atan2(y, x) - atan2(ell_2 sin theta_2, ell_1 + ell_2 cos theta_2), without any arctan of a quotient, which
    would lose the quadrant. Outside the reach s is imaginary. Formulas to read; `inverse` computes with better ones.

    Args:
        chain: One link or two; lengths may be symbols.
        x: Horizontal position of the end point, a real expression [m]; by default a symbol x.
        y: Vertical position, number or symbol.

    Returns:
        Angles as the chain measures them, shape (n, 1) each; of two links the branch with theta_2 > 0 first.

    Raises:
        InputError: on more than two links, or coordinates that are no real expressions.

    Example:
        >>> (angles,) = rbd.planar.inverse_formulas(rbd.planar.Chain(1))
        >>> angles
        Matrix([[atan2(y, x)]])
        >>> len(rbd.planar.inverse_formulas(rbd.planar.Chain(2)))  # elbow on one side, or on the other
        2
    """
    if check_chain(chain).n > 2:
        raise InputError(f"chain came with {chain.n} links; expected one link or two: more have families, see inverse.")
    x, y = (coordinate(name, value) for name, value in (("x", x), ("y", y)))
    way = sympy.atan2(y, x)
    back = chain.with_angles("segment").angle_map(chain.angles)
    if chain.n == 1:
        return (back(sympy.ImmutableMatrix([way])).as_immutable(),)
    l1, l2 = chain.lengths
    c = sympy.together((x**2 + y**2 - l1**2 - l2**2) / (2 * l1 * l2))
    out = []
    for sign in (1, -1):
        s = sign * sympy.sqrt(1 - c**2)
        first = way - sympy.atan2(l2 * s, l1 + l2 * c)
        out.append(back(sympy.ImmutableMatrix([first, first + sympy.atan2(s, c)])).as_immutable())
    return tuple(out)


def check_tolerance(tolerance: object) -> float:
    """A relative distance, zero to 0.1.

    Raises:
        InputError: if it is none.
    """
    expected = "a part of the chain's length, 0 to 0.1, as 1e-12"
    return check_number("tolerance", tolerance, 0.0, 0.1, expected=expected)  # type: ignore[arg-type]


def check_start(start: Sequence[float] | Array | None, n: int) -> Array | None:
    """A configuration to be near to, shape (n,) [rad], or None.

    Raises:
        InputError: if it is neither.
    """
    return None if start is None else plain("start", start, (n,), ": one angle per link [rad]")
