"""Joint angles along a path of the end point.

One branch of the inverse kinematics is followed continuously, with angles without jumps by a turn. One and two links are
computed for all samples at once. Two links stay on their branch, except where the path runs through a singular pose: there both
branches meet, and the chain continues in the one without a kink in its motion, as a path through the base or along
a tangent of the outer circle demands. More links follow the path of least motion: each step is perpendicular to the null
space of J half-way, so that q' = J^+ r' as samples become dense.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar.angles import nearest_turn, plain, wrapped
from rbd.planar.chain import Chain, check_chain
from rbd.planar.inverse_kinematics import SINGULAR, TOLERANCE, check_start, check_tolerance, triangle
from rbd.planar.nearest_poses import nearest_pose
from rbd.planar.numeric import ROUND_OFF, ChainNumbers

KINK = 0.1
"""A branch is changed at a singular pose only if that reduces the kink below this fraction of the one without change."""
WIDE = 0.5 * np.pi
"""A step of an angle between samples beyond which the path counts as sampled too coarsely [rad]."""


@dataclass(frozen=True, eq=False)
class InversePath(Displayed):
    """Angles of a chain along a path of its end point, as `inverse_path` finds them.

    Attributes:
        points: The given path, shape (samples, 2) [m].
        q: Angles, as the chain measures them, shape (samples, n) [rad]; where a point is out of reach (`check=False`), those
            of the nearest point within it.
        reachable: Whether each point is within reach, shape (samples,).
        distance: How far it is out of reach, shape (samples,) [m].
        singular: Whether the chain is in line there, shape (samples,): joint rates are then undetermined or without bound.
        switches: Samples at which two links go over to the other branch, through a singular pose.
        note: Remark on special cases; else empty.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.planar.inverse_path(arm, np.linspace([1.0, 0.5], [0.5, 1.0], 5))
        >>> path.q.round(3), path.switches
        (array([[-0.514,  1.955],
               [-0.383,  2.006],
               [-0.226,  2.024],
               [-0.053,  2.006],
               [ 0.13 ,  1.955]]), ())
    """

    points: Array
    q: Array
    reachable: Array
    distance: Array
    singular: Array
    switches: tuple[int, ...]
    note: str

    def __len__(self) -> int:
        return len(self.points)


def inverse_path(
    chain: Chain,
    points: Sequence[Sequence[float]] | Array,
    *,
    start: Sequence[float] | Array | None = None,
    branch: int = 0,
    tolerance: float = TOLERANCE,
    check: bool = True,
) -> InversePath:
    """Angles of a chain whose end point follows a path.

    Args:
        chain: The chain, its lengths numbers.
        points: Where the end point shall be, shape (samples, 2) [m].
        start: Angles to begin near to, shape (n,) [rad]; two links then begin in the nearer branch.
        branch: Without a start, the branch of two links to begin in: 0 bends counterclockwise (theta_2 in (0, pi)), 1
            clockwise. It decides too which way a chain leaves a singular pose that it begins in.
        tolerance: As in `inverse`.
        check: Whether to refuse paths that leave the reach; False gives the nearest points instead.

    Raises:
        InputError: on a path that leaves the reach, with the first such sample and its distance; on wrong shapes, numbers
            that are not finite, or another branch.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> square = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        >>> rbd.planar.inverse_path(arm, square).q.round(3)
        array([[-1.047,  2.094],
               [ 0.   ,  1.571],
               [ 0.524,  2.094]])
    """
    arm = check_chain(chain).numeric
    path = plain("points", points)
    if path.ndim != 2 or path.shape[1] != 2 or not len(path):
        raise InputError(f"points have shape {path.shape}; expected x and y of at least one sample, (samples, 2) [m].")
    near = check_start(start, arm.n)
    check_branch(branch)
    distance = arm.distance(path)
    within = arm.reachable(distance, check_tolerance(tolerance))
    notes = []
    if not within.all():
        first, worst = int(np.argmin(within)), int(np.argmax(distance))
        x, y = path[first]
        message = (
            f"sample {first} of {len(path)}, ({x:g}, {y:g}) m, is out of reach by {distance[first]:g} m: "
            f"{arm.beyond(path[first])}; {np.sum(~within)} samples are out of reach, the farthest is sample {worst}, "
            f"by {distance[worst]:g} m"
        )
        if check:
            raise InputError(f"{message}. Move the path, or take the nearest points that can be reached: check=False.")
        notes.append(message)
    direction = np.array(0.0 if near is None else np.arctan2(*arm.position(near)[::-1]))
    reached = arm.nearest(path, direction)
    switches: tuple[int, ...] = ()
    if arm.n == 1:
        q = arm.from_segment(np.unwrap(np.arctan2(reached[:, 1], reached[:, 0]))[:, None])
        singular = np.zeros(len(path), dtype=bool)
    elif arm.n == 2:
        q, singular, switches = _one_branch(arm, reached, near, branch)
    else:
        q, stuck = _least_motion(arm, reached, near)
        s = np.linalg.svd(arm.jacobian(q), compute_uv=False)
        singular = s[:, 1] <= SINGULAR * s[:, 0]
        if stuck:
            notes.append(f"the chain had to jump to another pose at sample {stuck[0]}: sample the path more finely")
    q = q + ((wrapped(q[0]) if near is None else nearest_turn(q[0], near)) - q[0])
    notes += _notes(q, singular, switches)
    return InversePath(path, q, within, distance, singular, switches, "; ".join(notes))


def _notes(q: Array, singular: Array, switches: tuple[int, ...]) -> list[str]:
    notes = []
    if singular.any():
        many = int(singular.sum())
        others = f" and {many - 1} more" if many > 1 else ""
        notes.append(f"singular at sample {int(np.argmax(singular))}{others}: the chain is in line, stretched or folded")
    if switches:
        notes.append(f"goes over to the other branch at sample {', '.join(map(str, switches[:5]))}")
    steps = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
    if len(steps) and steps.max() > WIDE:
        k = int(np.argmax(steps))
        notes.append(
            f"an angle changes by {steps[k]:.3g} rad between samples {k} and {k + 1}: sample the path more finely to be sure "
            "that it is followed"
        )
    return notes


def _one_branch(arm: ChainNumbers, points: Array, near: Array | None, branch: int) -> tuple[Array, Array, tuple[int, ...]]:
    bend, lean, toward = triangle(arm, points)
    r = np.hypot(points[:, 0], points[:, 1])
    somewhere = r > ROUND_OFF * arm.outer
    if not somewhere.all():  # at the base the line to the target has no direction: the last one's is used, or the next one's
        last = np.maximum.accumulate(np.where(somewhere, np.arange(len(r)), -1))
        following = int(np.argmax(somewhere)) if somewhere.any() else 0
        toward = toward[np.where(last < 0, following, last)]
    toward = np.unwrap(toward)

    def pose(k: int, sign: float) -> Array:
        """The links' angles at a sample in one of the branches."""
        first = toward[k] - sign * lean[k]
        return np.array([first, first + sign * bend[k]])

    sign = 1.0 - 2.0 * branch
    if near is not None:
        gaps = [float(np.linalg.norm(nearest_turn(arm.from_segment(pose(0, s)), near) - near)) for s in (1.0, -1.0)]
        sign = 1.0 if gaps[0] <= gaps[1] else -1.0
    singular = np.sin(bend) < SINGULAR
    signs, switches = np.full(len(r), sign), []
    for before, after in _meetings(arm, points, singular):
        if before >= 1 and after + 1 < len(r) and _kink_less(pose, signs[before], before, after):
            signs[after:] *= -1.0
            switches.append(after)
    first = toward - signs * lean
    psi = np.unwrap(np.stack([first, first + signs * bend], axis=-1), axis=0)
    return arm.from_segment(psi), singular, tuple(switches)


def _meetings(arm: ChainNumbers, points: Array, singular: Array) -> list[tuple[int, int]]:
    """Last sample before each singular stretch of the path, and first one after it."""
    edges = np.diff(np.concatenate([[False], singular, [False]]).astype(int))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    found = [(int(i) - 1, int(j)) for i, j in zip(begins, ends, strict=True)]
    if arm.inner == 0.0 and len(points) > 1:  # the path between two samples may lead through the base
        step = np.diff(points, axis=0)
        length = np.hypot(step[:, 0], step[:, 1])
        across = np.abs(points[:-1, 0] * step[:, 1] - points[:-1, 1] * step[:, 0])
        through = (np.sum(points[:-1] * points[1:], axis=1) < 0.0) & (across <= 1e-9 * arm.outer * length)
        found += [(int(k), int(k) + 1) for k in np.flatnonzero(through & ~singular[:-1] & ~singular[1:])]
    return sorted(found)


def _kink_less(pose, sign: float, before: int, after: int) -> bool:  # type: ignore[no-untyped-def]  # a local function
    """Whether the other branch continues the motion before a singular pose, and this one does not."""
    kinks = []
    into = nearest_turn(pose(before, sign), pose(before - 1, sign)) - pose(before - 1, sign)
    for other in (sign, -sign):
        here = pose(after, other)
        out = nearest_turn(pose(after + 1, other), here) - here
        jump = nearest_turn(here, pose(before, sign)) - pose(before, sign)
        kinks.append(float(np.linalg.norm(out - into) + np.linalg.norm(jump / (after - before) - 0.5 * (into + out))))
    return kinks[1] < KINK * kinks[0]


def _least_motion(arm: ChainNumbers, points: Array, near: Array | None) -> tuple[Array, list[int]]:
    """Least motion from sample to sample; and the samples at which it lost the path and restarted."""
    q = np.empty((len(points), arm.n))
    q[0] = nearest_pose(arm, points[0], near)[0]
    stuck = []
    for k in range(1, len(points)):
        moved = _step(arm, points[k], q[k - 1])
        if moved is None:
            moved = nearest_pose(arm, points[k], q[k - 1])[0]
            if np.abs(moved - q[k - 1]).max() > WIDE:
                stuck.append(k)
        q[k] = moved
    return q, stuck


def _step(arm: ChainNumbers, target: Array, q0: Array) -> Array | None:
    """The pose at a target whose displacement from q0 is perpendicular to the null space half-way; None if not found."""
    q = q0
    for _ in range(20):
        error = arm.position(q) - target
        _, s, Vt = np.linalg.svd(arm.jacobian(0.5 * (q + q0)))
        J = arm.jacobian(q)
        rows = np.vstack([J / arm.outer, Vt[2:]])
        if s[1] <= 1e-6 * s[0] or np.linalg.cond(rows) > 1e8:
            return None
        step = -np.linalg.solve(rows, np.concatenate([error / arm.outer, Vt[2:] @ (q - q0)]))
        size = float(np.abs(step).max())
        if size > 1.0:
            return None
        q = q + step
        # The null space half-way is recomputed in every round: it converges linearly, at a rate of the step's size.
        if size <= 1e-12 and np.hypot(*(arm.position(q) - target)) <= ROUND_OFF * arm.outer:
            return q
    return None


def check_branch(branch: object) -> None:
    """Refuse a value that is neither 0 nor 1.

    Raises:
        InputError: saying which is which.
    """
    if isinstance(branch, bool) or not isinstance(branch, int | np.integer) or branch not in (0, 1):
        raise InputError(f"branch is {branch!r:.80}; expected 0 (bends counterclockwise) or 1 (clockwise).")
