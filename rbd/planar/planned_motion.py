"""Minimum-jerk motions through a chain: planned for the end point or for the angles, and computed in both.

End point: x(t) is given, angles follow by inverse kinematics, their rates by `J q' = v`, `J q'' = a - J' q'` and
`J q''' = j - 2 J' q'' - J'' q'`.
Angles: q(t) is given, the end point follows by forward kinematics. Source: [Duarte2021], both plots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.integrate import solve_ivp

from rbd.arrays import Array, as_finite, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution, SingularPose
from rbd.errors.inputs import check_kind
from rbd.planar.chain import Chain, check_chain
from rbd.planar.inverse_kinematics import TOLERANCE, inverse
from rbd.planar.joint_derivatives import joint_rates
from rbd.planar.kinematics import Split
from rbd.planar.numeric import ChainNumbers
from rbd.planar.path_following import MinimumJerk, check_branch, inverse_path

ENDPOINT, JOINT = "endpoint", "joint"
IN_LINE = 1e-4
"""Sine of the bend (or its like of more links) below which a sample is left out: round-off of the end point, 1e-16, is 1e-8 of
the distance to the edge of reach there, and the angles' derivatives keep six digits."""
FINE = 400
"""Steps along a path at which angles are computed between the requested samples."""
RELATIVE, ABSOLUTE = 1e-11, 1e-12
"""Tolerances of the integration of more than two links [rad]."""
MOST_RATES = 10_000
"""Largest number of evaluations, some seconds: 4,000 suffice; 1e-6 rad off a line 30,000 cover only a millisecond."""


@dataclass(frozen=True, eq=False)
class PlanarMotion(Displayed):
    """A motion of a planar chain over time, of its end point and of its angles.

    Attributes:
        chain: The chain; angles are measured as it does.
        path: The minimum-jerk motion that was planned.
        space: Where: "endpoint" or "joint".
        t: Times, shape (samples,) [s], increasing; singular samples are left out, see `note`.
        x: The end point, shape (samples, 2) [m]; then its velocity v, acceleration a, jerk j.
        v: [m/s].
        a: [m/s^2].
        j: [m/s^3].
        q: The angles, shape (samples, n) [rad], without jumps by full turns; then their derivatives.
        qd: [rad/s].
        qdd: [rad/s^2].
        qddd: [rad/s^3].
        split: The tangential, centripetal and Coriolis parts of a, shape (samples, 2) each [m/s^2].
        unbounded: Times towards which joint accelerations grow without bound [s]: a singular beginning or end; else empty.
        note: Remark on special cases; else empty.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0)
        >>> reach = rbd.planar.endpoint_motion(arm, path, times=[0.0, 0.5, 1.0])
        >>> reach.x, reach.qd.round(3)
        (array([[1.  , 0.5 ],
               [0.75, 0.75],
               [0.5 , 1.  ]]), array([[ 0.  , 0.  ],
               [ 1.25, 0.  ],
               [ 0.  , 0.  ]]))
    """

    chain: Chain
    path: MinimumJerk
    space: str
    t: Array
    x: Array
    v: Array
    a: Array
    j: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array
    split: Split[Array]
    unbounded: tuple[float, ...]
    note: str

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        note = f", {self.note}" if self.note else ""
        return f"PlanarMotion({self.chain.n} links, planned in {self.space} space, {len(self)} samples{note})"

    @lazy
    def speed(self) -> Array:
        """Of the end point, `|v|`, shape (samples,) [m/s]."""
        return np.hypot(self.v[:, 0], self.v[:, 1])

    @lazy
    def manipulability(self) -> Array:
        """sqrt(det(J J^T)) of every sample [Yoshikawa1985], shape (samples,) [m^2].

        The area of the end point's velocity ellipse over pi; zero where the chain is in line. Of one link sqrt(det(J^T J)), its
        length [m].
        """
        return np.linalg.svd(self.chain.numeric.jacobian(self.q), compute_uv=False).prod(axis=1)


def endpoint_motion(
    chain: Chain,
    path: MinimumJerk,
    *,
    times: Sequence[float] | Array | None = None,
    branch: int = 0,
    start: Sequence[float] | Array | None = None,
) -> PlanarMotion:
    """The motion of a chain whose end point follows a minimum-jerk path: straight in the plane, bent in joint space.

    Of two links one branch is followed. Of more the joint rates are the least ones, q' = J^+ v, integrated to 1e-11, so that q
    and its derivatives belong to one smooth motion. At a pose in line J loses rank: joint rates are undetermined, or
    unbounded as the pose is approached. Such samples are omitted, with a remark in `note`: the literature's motion, (1, 0) m to
    (0.5, 0.5) m with links of 0.5 m, starts stretched out, its joint accelerations grow like 1/sqrt(t) as t goes to 0, and
    with the usual 101 times it begins at 0.01 s.

    Args:
        chain: The chain, its lengths numbers.
        path: `minimum_jerk(from, to, duration)` of two points [m].
        times: When [s], increasing; 101 even times by default.
        branch: Of two links: 0 bends counterclockwise, 1 clockwise.
        start: Angles to begin near to, shape (n,) [rad]; instead of `branch`.

    Raises:
        NoSolution: the straight path leaves the reach of the chain, with place and distance.
        SingularPose: all samples are singular, or a chain of more than two links comes into line along the path.
        InputError: no such path, times that do not increase, lengths that are symbols.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.planar.minimum_jerk([1.0, 0.5], [0.5, 1.0], 1.0)
        >>> reach = rbd.planar.endpoint_motion(arm, path, times=[0.0, 0.5, 1.0])
        >>> reach.q.round(3), reach.split.coriolis[1].round(3)
        (array([[-0.514,  1.955],
               [-0.226,  2.024],
               [ 0.13 ,  1.955]]), array([0., 0.]))
    """
    arm = check_chain(chain).numeric
    _check_path(path, (2,), "two coordinates of the end point, e.g. minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0)")
    check_branch(branch)
    wanted = _check_times(times, path)
    _check_reach(arm, path)
    if arm.n <= 2:
        q = _followed(chain, path, wanted, branch, start)
        regular = np.ones(len(wanted), bool) if arm.n == 1 else _bent(arm, q)
    else:
        regular = _inside(arm, path.displacement(wanted))
        q = _integrated(chain, arm, path, wanted, regular, start)
    if not regular.any():
        raise SingularPose("the chain is in line at every sample; expected a motion that leaves the singular pose.")
    times_, q = wanted[regular], q[regular]
    x, v, a, j = (f(times_) for f in (path.displacement, path.velocity, path.acceleration, path.jerk))
    rates = joint_rates(chain, q, v, a, j)
    split = arm.split(q, rates.qd, rates.qdd)
    unbounded, note = _singular_notes(arm, path, wanted, regular)
    return PlanarMotion(chain, path, ENDPOINT, times_, x, v, a, j, q, rates.qd, rates.qdd, rates.qddd, split, unbounded, note)


def joint_motion(chain: Chain, path: MinimumJerk, *, times: Sequence[float] | Array | None = None) -> PlanarMotion:
    """The motion of a chain whose angles follow a minimum-jerk path: straight in joint space, bent in the plane.

    Singular poses are allowed, as no matrix is inverted.

    Args:
        chain: The chain, its lengths numbers.
        path: `minimum_jerk(from, to, duration)` of n angles [rad], as the chain measures them; of one link numbers will do.
        times: When [s], increasing; 101 even times by default.

    Raises:
        InputError: no such path, times that do not increase, lengths that are symbols.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> path = rbd.planar.minimum_jerk([0.0, 0.5], [1.0, 1.5], 1.0)
        >>> swing = rbd.planar.joint_motion(arm, path, times=[0.0, 0.5, 1.0])
        >>> swing.x.round(3), swing.v[1].round(3)
        (array([[ 1.878,  0.479],
               [ 0.948,  1.477],
               [-0.261,  1.44 ]]), array([-4.64 ,  1.911]))
    """
    arm = check_chain(chain).numeric
    if arm.n == 1 and isinstance(path, MinimumJerk) and path.start.shape == ():
        path = MinimumJerk(path.start[None], path.stop[None], path.duration)
    _check_path(path, (arm.n,), f"{arm.n} angles, e.g. minimum_jerk({[0.0] * arm.n}, {[1.0] * arm.n}, 1.0)")
    t = _check_times(times, path)
    q, qd, qdd, qddd = (f(t) for f in (path.displacement, path.velocity, path.acceleration, path.jerk))
    x, v, a, j = arm.position(q), arm.velocity(q, qd), arm.acceleration(q, qd, qdd), arm.jerk(q, qd, qdd, qddd)
    note = "" if arm.n == 1 or _bent(arm, q).all() else f"in line at {_times(t, ~_bent(arm, q))}, which the angles do not mind"
    return PlanarMotion(chain, path, JOINT, t, x, v, a, j, q, qd, qdd, qddd, arm.split(q, qd, qdd), (), note)


def _check_path(path: MinimumJerk, shape: tuple[int, ...], expected: str) -> None:
    check_kind("path", path, MinimumJerk, "what minimum_jerk returns")
    if path.start.shape != shape:
        raise InputError(f"path is of shape {path.start.shape}; expected {shape}: {expected}.")


def _check_times(times: object, path: MinimumJerk) -> Array:
    if times is None:
        return path.times()
    given = as_finite("times", times, ("samples",), meaning=": a list of times [s]")
    if not len(given) or np.diff(given).min(initial=1.0) <= 0.0:
        raise InputError("times are empty or do not increase; expected one at least, each later than the one before.")
    return given


def _check_reach(arm: ChainNumbers, path: MinimumJerk) -> None:
    """Refuse a straight path that leaves the ring of reach: farthest from the base at an end, nearest perhaps between."""
    step = path.stop - path.start
    length2 = float(step @ step)
    # Where along the path the base is nearest; shares near 0 and 1 are the ends.
    share = 0.0 if length2 == 0.0 else float(np.clip(-(path.start @ step) / length2, 0.0, 1.0))
    points = np.array([path.start, path.stop, path.start + share * step])
    distance = arm.distance(points)
    worst = int(np.argmax(distance))
    if not arm.reachable(distance[worst], TOLERANCE):
        where, (x, y) = ("the beginning, ", "the end, ", "a point of the path, ")[worst], points[worst]
        hint = "Plan in joint space (joint_motion), or choose other ends." if worst == 2 else "Choose an end within reach."
        raise NoSolution(
            f"the end point cannot follow the path: {where}({x:.6g}, {y:.6g}) m, is out of reach by {distance[worst]:.6g} m: "
            f"{arm.beyond(points[worst])}. {hint}"
        )


def _followed(chain: Chain, path: MinimumJerk, times: Array, branch: int, start: Sequence[float] | Array | None) -> Array:
    """Angles of one or two links, followed in steps fine enough that no turn is missed, shape (samples, n)."""
    grid = np.union1d(times, path.times(FINE + 1))
    return inverse_path(chain, path.displacement(grid), branch=branch, start=start).q[np.searchsorted(grid, times)]


def _integrated(
    chain: Chain, arm: ChainNumbers, path: MinimumJerk, times: Array, regular: Array, start: Sequence[float] | Array | None
) -> Array:
    """Angles of more links: q' = J^+ v from the first pose that is not in line, shape (samples, n)."""
    q = np.zeros((len(times), arm.n))
    inside = np.clip(times, 0.0, path.duration)
    grid = np.union1d(inside, path.times(FINE + 1))
    grid = grid[_inside(arm, path.displacement(grid))]
    if not regular.any() or not len(grid):
        return q
    first = inverse(chain, path.displacement(grid[0]), start=start).q
    lost = "a chain of more than two links came into line, or nearly, along the path, where its joint rates have no bound"
    calls = count(1)

    def rate(t: float, q: Array) -> Array:
        if next(calls) > MOST_RATES:
            raise SingularPose(f"{lost}, at about {t:.4g} s. Begin near other angles: start.")
        J = arm.jacobian(q)
        return J.T @ np.linalg.solve(J @ J.T, path.velocity(t))

    wanted = np.unique(inside[regular])
    if grid[-1] == grid[0]:
        found = np.repeat(first[None], len(wanted), axis=0)
    else:
        try:
            run = solve_ivp(rate, (grid[0], grid[-1]), first, method="DOP853", t_eval=wanted, rtol=RELATIVE, atol=ABSOLUTE)
        except np.linalg.LinAlgError:
            raise SingularPose(f"{lost}. Begin near other angles: start.") from None
        if not run.success:
            raise SingularPose(
                f"{lost}, at about {run.t[-1] if len(run.t) else grid[0]:.4g} s. Begin near other angles: start."
            )
        found = run.y.T
    target = path.displacement(wanted)
    for _ in range(3):  # Newton: what the integration lost, 1e-10, is brought back onto the path
        J = arm.jacobian(found)
        JT = np.swapaxes(J, 1, 2)
        found = found + (JT @ np.linalg.solve(J @ JT, (target - arm.position(found))[..., None]))[..., 0]
    q[regular] = found[np.searchsorted(wanted, inside[regular])]
    return q


def _bent(arm: ChainNumbers, q: Array) -> Array:
    """Whether the chain is out of line at each sample, shape (samples,)."""
    return np.abs(np.sin(np.diff(arm.to_segment(q), axis=1))).max(axis=1) > IN_LINE


def _inside(arm: ChainNumbers, points: Array) -> Array:
    """Whether points are so far within the ring of reach that the chain can be out of line there, shape (samples,)."""
    r = np.hypot(points[:, 0], points[:, 1])
    slack = arm.outer - r if arm.inner == 0.0 else np.minimum(arm.outer - r, r - arm.inner)
    return slack > 0.1 * IN_LINE**2 * arm.outer


def _singular_notes(arm: ChainNumbers, path: MinimumJerk, times: Array, regular: Array) -> tuple[tuple[float, ...], str]:
    """Times towards which joint accelerations have no bound, and a remark on omitted samples."""
    if arm.n == 1:
        return (), ""
    step, notes, unbounded = path.stop - path.start, [], []
    for begins, point in ((True, path.start), (False, path.stop)):
        if _inside(arm, point[None])[0]:
            continue
        r = float(np.hypot(*point))
        pose = "stretched out" if 2.0 * r > arm.outer + arm.inner else "folded"
        text = f"{'begins' if begins else 'ends'} {pose}, a singular pose"
        # Away from the edge by s, the bend grows like sqrt(s), and s like t^3: its second derivative like 1/sqrt(t).
        if r > 0.0 and abs(float(step @ point)) > 1e-9 * np.linalg.norm(step) * r:
            unbounded.append(0.0 if begins else path.duration)
            text += f": joint accelerations grow without bound towards it, like 1/sqrt({'t' if begins else 'd - t'})"
        notes.append(text)
    if not regular.all():
        notes.append(f"left out as singular: {_times(times, ~regular)}")
    return tuple(unbounded), "; ".join(notes)


def _times(times: Array, there: Array) -> str:
    """The first few times, for a message."""
    found = times[there]
    first = ", ".join(f"{t:.4g}" for t in found[:3])
    return f"t = {first} s" + (f" and {len(found) - 3} more" if len(found) > 3 else "")
