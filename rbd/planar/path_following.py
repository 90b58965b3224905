"""Joint angles, rates, accelerations and jerks along a path of the end point.

One branch of the inverse kinematics is followed continuously, with angles without jumps by a turn. One and two links are
computed for all samples at once. Two links stay on their branch, except where the path runs through a singular pose: there both
branches meet, and the chain continues in the one without a kink in its motion, as a path through the base or along
a tangent of the outer circle demands. More links follow the path of least motion: each step is perpendicular to the null
space of J half-way, so that q' = J^+ r' as samples become dense.

Joint rates, accelerations and jerks follow from those of the end point:

    J q' = v,   J q'' = a - J' q',   J q''' = j - 2 J' q'' - J'' q'.

Two links solve these. More links have many solutions for q'; taken is the least one, q' = J^T l with J J^T l = v (the
pseudo-inverse), and its time derivatives,

    q'' = J^T l' + J'^T l,   q''' = J^T l'' + 2 J'^T l' + J''^T l,

so that q'' is the derivative of q' along the motion: J^+ (a - J' q') alone is not, it leaves out how the null space turns.
One link has one angle for two components: a velocity that is not along its circle contradicts it.
At a singular pose the rates are undetermined, or without bound as the pose is approached, and are reported as NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_array, check_finite
from rbd.errors import InputError, SingularPose
from rbd.planar.angles import nearest_turn, plain, samples, wrapped
from rbd.planar.chain import Chain, check_chain
from rbd.planar.inverse_kinematics import SINGULAR, TOLERANCE, check_start, check_tolerance, nearest_pose, triangle
from rbd.planar.numeric import ROUND_OFF, ChainNumbers

KINK = 0.1
"""A branch is changed at a singular pose only if that reduces the kink below this fraction of the one without change."""
WIDE = 0.5 * np.pi
"""A step of an angle between samples beyond which the path counts as sampled too coarsely [rad]."""
CONTRADICTS = 1e-6
"""Part of a single link's end-point motion that may be off its circle: round-off of its computation, and no more."""


@dataclass(frozen=True, eq=False)
class InversePath:
    """Angles along a path of the end point.

    Attributes:
        points: The given path, shape (samples, 2) [m].
        q: Angles, as the chain measures them, shape (samples, n) [rad]; where a point is out of reach (`check=False`), those
            of the nearest point within it.
        reachable: Whether each point is within reach, shape (samples,).
        distance: How far it is out of reach, shape (samples,) [m].
        singular: Whether the chain is in line there, shape (samples,): joint rates are then undetermined or without bound.
        switches: Samples at which two links go over to the other branch, through a singular pose.
        note: Remark on special cases; else empty.
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


@dataclass(frozen=True, eq=False)
class JointRates:
    """Motion of the joints; parts not requested are empty, shape (0, n), or (0,) for one sample.

    Attributes:
        qd: Angular velocities, as the chain measures its angles, shape (samples, n) or (n,) [rad/s].
        qdd: Angular accelerations [rad/s^2].
        qddd: Angular jerks [rad/s^3].
        singular: Whether the pose is singular, shape (samples,) or (): rates are NaN there, if requested.
    """

    qd: Array
    qdd: Array
    qddd: Array
    singular: Array


def joint_rates(
    chain: Chain,
    q: Sequence[float] | Array,
    velocity: Sequence[float] | Array,
    acceleration: Sequence[float] | Array | None = None,
    jerk: Sequence[float] | Array | None = None,
    *,
    at_singular: str = "raise",
) -> JointRates:
    """Rates of the joints that give the end point a velocity, an acceleration and a jerk.

    Args:
        chain: The chain, its lengths numbers.
        q: Angles, as the chain measures them, shape (n,) or (samples, n) [rad].
        velocity: Of the end point, shape (2,) or (samples, 2) [m/s].
        acceleration: Acceleration, of the same shape [m/s^2]; None if not known.
        jerk: Jerk, of the same shape [m/s^3]; needs the acceleration.
        at_singular: "raise", or "nan" for NaN in the samples that are singular.

    Returns:
        The rates; more than two links: the least ones, in the sum of squares of the chain's own angles.

    Raises:
        SingularPose: where the chain is in line (smallest over largest singular value of J below 1e-7), naming the sample.
        InputError: on wrong shapes, numbers that are not finite, or motion off the circle of a single link.
    """
    arm = check_chain(chain).numeric
    pose = samples("q", q, arm.n)
    if not isinstance(at_singular, str) or at_singular not in ("raise", "nan"):
        raise InputError(f"at_singular is {at_singular!r:.80}; expected 'raise' or 'nan'.")
    if jerk is not None and acceleration is None:
        raise InputError("a jerk came without an acceleration; expected both: the joints' jerk depends on it.")
    single = pose.ndim == 1
    given = [("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk)]
    motion = [_vectors(what, value, pose).reshape(-1, 2) for what, value in given if value is not None]
    pose = pose.reshape(-1, arm.n)
    J = arm.jacobian(pose)
    s = np.linalg.svd(J, compute_uv=False)
    singular = s[:, 1] <= SINGULAR * s[:, 0] if arm.n > 1 else np.zeros(len(pose), dtype=bool)
    if singular.any() and at_singular == "raise":
        raise SingularPose(_singular_message(arm, pose, singular))
    good = ~singular
    motion = [m[good] for m in motion]
    solve = _along_the_circle if arm.n == 1 else _two_links if arm.n == 2 else _least
    out = []
    for rates in solve(arm, pose[good], J[good], motion):
        full = np.full(pose.shape, np.nan)
        full[good] = rates
        out.append(full[0] if single else full)
    out += [out[0][:0]] * (3 - len(out))
    return JointRates(out[0], out[1], out[2], singular[0] if single else singular)


def _vectors(what: str, value: Sequence[float] | Array, pose: Array) -> Array:
    given = as_array(what, value)
    expected = (*pose.shape[:-1], 2)
    if given.shape != expected:
        raise InputError(f"{what} has shape {given.shape}; expected x and y for every row of q, {expected}.")
    check_finite(what, given.ravel())
    return given


def _singular_message(arm: ChainNumbers, pose: Array, singular: Array) -> str:
    k = int(np.argmax(singular))
    x, y = arm.position(pose[k])
    more = f" ({int(singular.sum())} samples of {len(pose)} are singular)" if singular.sum() > 1 else ""
    where = f"at sample {k} of {len(pose)}" if len(pose) > 1 else "here"
    return (
        f"{where} the chain is in line, with its end point at ({x:g}, {y:g}) m{more}: joint rates are undetermined there, and "
        "may be without bound nearby. Begin near it, or ask for NaN there: at_singular='nan'."
    )


def _along_the_circle(arm: ChainNumbers, q: Array, J: Array, motion: list[Array]) -> list[Array]:
    out: list[Array] = []
    for order, given in enumerate(motion):
        wanted = given - _lower(arm, q, out, out, order)
        rate = np.sum(J[:, :, 0] * wanted, axis=1) / arm.outer**2
        off = np.abs(wanted - J[:, :, 0] * rate[:, None]).max(axis=1, initial=0.0)
        size = np.abs(given).max(axis=1, initial=0.0) + np.abs(wanted).max(axis=1, initial=0.0)
        if (off > CONTRADICTS * size).any():
            k = int(np.argmax(off - CONTRADICTS * size))
            what = ("velocity", "acceleration", "jerk")[order]
            raise InputError(
                f"the {what} at sample {k}, ({given[k, 0]:g}, {given[k, 1]:g}), is off by {off[k]:g} from what a single link "
                "can do on its circle; expected one of a motion along it."
            )
        out.append(rate[:, None])
    return out


def _lower(
    arm: ChainNumbers, q: Array, rates: list[Array], terms: list[Array], order: int, *, transposed: bool = False
) -> Array:
    """Terms of the lower rates: zero, J' x, or 2 J' x' + J'' x of x = q' (transposed: J^T, of x = l)."""
    if order == 0:
        return np.zeros((len(q), arm.n if transposed else 2))
    Js = [arm.jacobian_rate(q, rates[0])] + ([arm.jacobian_second_rate(q, rates[0], rates[1])] if order > 1 else [])
    Js = [np.swapaxes(J, 1, 2) for J in Js] if transposed else Js
    return _times(Js[0], terms[0]) if order == 1 else 2.0 * _times(Js[0], terms[1]) + _times(Js[1], terms[0])


def _two_links(arm: ChainNumbers, q: Array, J: Array, motion: list[Array]) -> list[Array]:
    out: list[Array] = []
    for order, given in enumerate(motion):
        out.append(np.linalg.solve(J, (given - _lower(arm, q, out, out, order))[..., None])[..., 0])
    return out


def _least(arm: ChainNumbers, q: Array, J: Array, motion: list[Array]) -> list[Array]:
    JT = np.swapaxes(J, 1, 2)
    G = J @ JT
    out: list[Array] = []
    multipliers: list[Array] = []
    for order, given in enumerate(motion):
        # The part of the rate that the multipliers known so far give, of q' = J^T l differentiated.
        rest = _lower(arm, q, out, multipliers, order, transposed=True)
        wanted = given - _lower(arm, q, out, out, order) - _times(J, rest)
        multipliers.append(np.linalg.solve(G, wanted[..., None])[..., 0])
        out.append(_times(JT, multipliers[-1]) + rest)
    return out


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
