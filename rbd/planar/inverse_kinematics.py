"""Inverse kinematics of a planar chain: angles that bring the end point to a target.

One link: theta = atan2(y, x), if the target is on its circle. Two links, with r = |target|: by the half-angle formulas of the
triangle with sides ell_1, ell_2, r, which lose no digits near the stretched and the folded pose, as arccos does there:

    theta_2 = +- 2 atan2(sqrt((s - r)(s + r)), sqrt((r - d)(r + d))),   s = ell_1 + ell_2,   d = ell_1 - ell_2,
    theta_1 = atan2(y, x) -+ 2 atan2(sqrt((s - r)(r - d)), sqrt((s + r)(r + d))).

More links: of all poses with the end point at the target the one nearest to a start,

    minimise |q - q_start|^2 / 2   subject to   r(q) = target.

`rbd.planar.nearest_poses` seeks it.

Source of one and two links: [Duarte2021], "Inverse kinematics".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array, as_float
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar.angles import nearest_turn, plain, wrapped
from rbd.planar.chain import Chain, check_chain
from rbd.planar.expressions import coordinate
from rbd.planar.nearest_poses import nearest_pose
from rbd.planar.numeric import ROUND_OFF, ChainNumbers

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
        rows = [", ".join(f"{angle:.6g}" for angle in row) for row in np.degrees(self.branches)]
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
    point = plain("target", target)
    if point.shape != (2,):
        raise InputError(f"target has shape {point.shape}; expected x and y of the end point, (2,) [m].")
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
    singular = bool(np.sin(bend) < SINGULAR)
    if not singular:
        return q, False, ""
    shape = "stretched out" if bend < 1.0 else "folded"
    return q, True, f"{shape}: a singular pose, where both branches meet"


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
    value = as_float(tolerance)
    if not 0.0 <= value <= 0.1:
        raise InputError(f"tolerance is {tolerance!r:.80}; expected a part of the chain's length, 0 to 0.1, as 1e-12.")
    return value


def check_start(start: Sequence[float] | Array | None, n: int) -> Array | None:
    """A configuration to be near to, shape (n,) [rad], or None.

    Raises:
        InputError: if it is neither.
    """
    if start is None:
        return None
    q = plain("start", start)
    if q.shape != (n,):
        raise InputError(f"start has shape {q.shape}; expected one angle per link, ({n},) [rad].")
    return q
