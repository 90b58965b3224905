"""`find_timing`, `retimed`: the fastest, or the least slowed, timing along the path of a motion; or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, check_number
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, NoSolution
from rbd.errors.inputs import check_kind
from rbd.motion.causes import without_balance
from rbd.motion.checking import check_motion
from rbd.motion.contact_detection import find_contacts
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.file_frames import check_rate, times_of
from rbd.motion.frame_terms import FrameTerms, check_robot, wrench_scale
from rbd.motion.reference_motion import Motion
from rbd.motion.retiming.passes import CHECKED, Step, controllable, fastest, fastest_alone
from rbd.motion.retiming.path_sets import SLACK, TOLERANCE, PathLimits, PathSets
from rbd.workers import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

NEAR = 3e-3
"""A step is halved that can be outside the sets by more between the points that are kept to, in shares of weight and limits."""
HALVINGS = 12
"""Times that steps are halved."""
AROUND, FINEST = 10, 0.125
"""So many steps before and after one that cannot be done are halved, down to an eighth of a frame."""
ROUNDS = 200
"""Passes over the grid, each of which adds half-planes; ten are common."""
STILL = 1e-6
"""A path whose v are smaller is at rest."""
_NUDGED, _SMALL = 0.01, 0.002
"""Wrenches that are missing, over the weight, of which the cause is sought; and that need none."""


@dataclass(frozen=True, eq=False, repr=False)
class Timing(Displayed):
    """The timing s(t) of a path, s being the times of the motion as it was: s'' is constant between n + 1 points.

    Attributes:
        sets: The path, its contacts, and what (s'', s'^2) it allows.
        places: The points, in frames: 2.5 is halfway from frame 2 to 3, shape (n + 1,).
        s: Their times in the motion as it was, shape (n + 1,) [s].
        t: Their times now, shape (n + 1,) [s].
        pace: S', how much faster than it was, shape (n + 1,).
        rise: S'' from each point to the next, shape (n,) [1/s].
        causes: What bounds each of these steps, "motor of left_knee_joint", "speed limit of ...", "tips", "friction", "floats",
            or "fastest", shape (n,).
        between: How far it can be outside the sets between the points that are kept to, in shares of weight and limits.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> arm = arm.with_motors({"joint_1": rbd.Motor(limit=8.0)})
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([-1.5]), np.array([0.0])], [0.0, 0.6])
        >>> timing = rbd.motion.find_timing(motion)
        >>> print(f"{timing.duration:.2f} s, bound by", list(timing.shares()))
        0.61 s, bound by ['fastest', 'motor of joint_1']
    """

    sets: PathSets
    places: Array
    s: Array
    t: Array
    pace: Array
    rise: Array
    causes: tuple[str, ...]
    between: float

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def changed(self) -> bool:
        """Whether it is another than that of the motion."""
        return bool(np.abs(self.pace - 1.0).max() > 1e-9)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """(s, s', s'') at times, shapes (m,)."""
        j = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.rise) - 1)
        since = t - self.t[j]
        s = self.s[j] + since * (self.pace[j] + 0.5 * since * self.rise[j])
        return np.minimum(s, self.s[-1]), np.maximum(self.pace[j] + since * self.rise[j], 0.0), self.rise[j]

    def shares(self) -> dict[str, float]:
        """{cause: share of the time in which it bounds the timing}, largest first."""
        out: dict[str, float] = {}
        for cause, span in zip(self.causes, np.diff(self.t), strict=True):
            out[cause] = out.get(cause, 0.0) + float(span) / self.duration
        return dict(sorted(out.items(), key=lambda item: -item[1]))

    def most(self) -> Array:
        """The largest s' that each of the points allows by itself, shape (n + 1,): the maximum velocity curve."""
        return np.sqrt([fastest_alone(each) for each in self.sets.at(self.places)])

    def plot(self, ax: Axes | None = None) -> list[Artist]:
        """S' along the path below `most`, and what bounds it; see `rbd.visual.plot_timing`."""
        return drawing("plot_timing")(ax, self)

    def motion(self, rate: float | None = None) -> Motion:
        """The motion with this timing, at a rate [Hz], by default its own; contacts are carried along.

        Where it ends at rest between two frames, and can rest, a frame with the last pose follows.
        """
        old = self.sets.motion
        if not self.changed and rate is None:
            return old.with_contacts(self.sets.lanes)
        rate = old.rate if rate is None else check_rate(rate)
        t = times_of(float(self.t[0]), float(self.t[-1]), rate)
        s, pace, rise = self.at(t)
        rests = self.t[-1] - t[-1] > 1e-9 and self.pace[-1] * np.abs(old.v[-1]).max(initial=0.0) <= STILL
        rests = rests and self.sets.stands(old.n - 1.0) <= NEAR
        if rests:
            t, s = np.append(t, t[-1] + 1.0 / rate), np.append(s, self.s[-1])
            pace, rise = np.append(pace, 0.0), np.append(rise, 0.0)
        q, q1, q2 = self.sets.path(s)
        v, a = q1 * pace[:, None], q1 * rise[:, None] + q2 * np.square(pace)[:, None]
        lanes = self._lanes(t, s, pace, q)
        note = f"retimed from {old.duration:.4g} to {self.duration:.4g} s: {_words(self.shares())}."
        note += " Torque-speed lines were not counted." if old.robot.torque_lines else ""
        return replace(old, t=t, q=q, v=v, a=a, derivation=None, contacts=lanes, forces=None, notes=(*old.notes, note))

    def _lanes(self, t: Array, s: Array, pace: Array, q: Array) -> ContactTimeline | None:
        lanes, old = self.sets.lanes, self.sets.motion.t
        if lanes is None:
            return None
        places = np.interp(s, old, np.arange(len(old)))
        whole = np.round(places)
        places = np.where(np.abs(places - whole) < 1e-6, whole, places)
        touches, at = self.sets.touches(places), self.sets.points_at(q)
        speeds, noise = (
            np.stack([np.interp(s, old, np.nan_to_num(each)) for each in x.T], axis=1) * pace[:, None]
            for x in (lanes.speeds, lanes.noise)
        )
        slides, raised = (self.sets.touches(places, what) & touches for what in ("slides", "raised"))
        return replace(
            lanes, t=t, touches=touches, slides=slides, raised=raised, heights=lanes.heights_over(at), places=at,
            speeds=np.where(touches, speeds, np.nan), noise=noise,
        )  # fmt: skip

    def __str__(self) -> str:
        now, was, low, high = self.duration, self.sets.motion.duration, self.pace.min(), self.pace.max()
        return f"{now:.4g} s instead of {was:.4g} s, paces {low:.3g} to {high:.3g}; {_words(self.shares())}"


def retimed(
    motion: Motion,
    *,
    contacts: ContactTimeline | None = None,
    fastest: float = 1.0,
    start: float = 1.0,
    end: float = 1.0,
    friction: float = 0.7,
    torque_limits: bool | float = True,
    speed_limits: bool | float = True,
    threshold: float = 0.02,
) -> Motion:
    """The same path with the least slowed timing, or the fastest one, for which torques, speeds, friction and balance hold.

    `find_timing(...).motion()`: see there.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([0.0]), np.array([1.0])], [0.0, 1.0])
        >>> rbd.motion.retimed(motion) is motion
        True
    """
    settings = {name: value for name, value in locals().items() if name != "motion"}
    timing = find_timing(motion, **settings)
    return timing.motion() if timing.changed or contacts is not None else motion


def find_timing(
    motion: Motion,
    *,
    contacts: ContactTimeline | None = None,
    fastest: float = 1.0,
    start: float = 1.0,
    end: float = 1.0,
    friction: float = 0.7,
    torque_limits: bool | float = True,
    speed_limits: bool | float = True,
    threshold: float = 0.02,
) -> Timing:
    """The fastest timing s(t) along a motion's path with s' at most `fastest`: with 1, the least slowed one.

    s counts the times of the motion as it was. Along the path the equations of motion are affine in s'' and s'^2; the sets of
    these that contact forces in circular cones and torques within limits allow are convex, and the timing is found by
    reachability on a grid [PhamPham2018], the frames at first. Each step keeps to the sets at both ends and in its middle, to
    1e-4 of weight and limits. It is tested at its quarters, or eighths, and halved where it is outside by more than 0.003, with
    an eighth of the second differences of forces and torques for what lies between; `Timing.between` is what is left. Of
    speed limits 0.1 % is spared.

    A point touches between two frames if it does in one of them, and holds, also where it slides or is raised: feet are a
    matter of the path. Torque-speed lines are left out.

    Args:
        motion: The motion, two frames or more.
        contacts: Which points touch, when; None: `motion.contacts`, or what `find_contacts` finds. A robot without a floating
            base has none.
        fastest: Largest s': 1, never faster than it was; 10, up to ten times as fast.
        start: S' at the beginning, 0 at rest. Of a path that is at rest there, any s' is, and the best is taken.
        end: S' at the end, likewise.
        friction: Coulomb's coefficient of the floor.
        torque_limits: Whether torque limits count, or a share of them, 0.8.
        speed_limits: Whether speed limits of joints count, or a share of them.
        threshold: Share of the weight that may be missing, as of `check_motion`, where the motion as it was, or its pose at
            rest, misses that much.

    Raises:
        InputError: no motion, one frame, contacts of another motion, limits that are none.
        NoSolution: no timing is possible: a pose that none makes possible, with its causes, or ends that cannot be reached.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([0.0]), np.array([1.0])], [0.0, 1.0])
        >>> print(rbd.motion.find_timing(motion, fastest=2.0))
        0.5 s instead of 1 s, paces 2 to 2; fastest in 100 % of the time
    """
    check_kind("motion", motion, Motion, "an rbd.Motion: rbd.Motion.read('dance.csv', robot='g1')")
    if motion.n < 2:
        raise InputError("a motion of one frame has no timing; expected two frames or more.")
    robot = motion.robot
    pace = check_number("fastest", fastest, 1e-3, 1e3, expected="the largest s', 1 for never faster than it was")
    ends = [check_number(what, x, 0.0, pace, expected=f"s' there, 0 to fastest={pace:g}") for what, x in
            (("start", start), ("end", end))]  # fmt: skip
    mu = check_number("friction", friction, 0.0, 1e6, expected="a number of 0 or more")
    share = check_number("threshold", threshold, 0.0, 1.0, expected="a share of the weight, 0 to 1")
    torque, speed = (
        np.full_like(limit, np.inf) if given is False
        else limit * (1.0 if given is True else check_number(what, given, 1e-6, 1e6, expected="True, False, or a share, 0.8"))
        for what, limit, given in (
            ("torque_limits", robot.effort_limit, torque_limits), ("speed_limits", _speeds(motion), speed_limits),
        )
    )  # fmt: skip
    sets = PathSets(motion, _contacts(motion, contacts), PathLimits(mu, share, torque, speed, pace))
    rests = [float(np.abs(motion.v[i]).max(initial=0.0)) <= STILL for i in (0, -1)]
    with one_blas_thread():
        return _found(sets, ends, rests)


def _contacts(motion: Motion, given: ContactTimeline | None) -> ContactTimeline | None:
    robot = motion.robot
    given = motion.contacts if given is None else given
    if not robot.floating:
        if given is not None or len(robot.unactuated) or robot.loops():
            raise InputError(
                f"{robot.name} has not one floating base: expected a tree with a motor at each joint, no contacts."
            )
        return None
    check_robot(robot)
    if given is None:
        return find_contacts(motion)
    check_kind("contacts", given, ContactTimeline, "ContactTimeline: rbd.motion.find_contacts(motion)")
    if not robot.is_like(given.points.robot) or not np.array_equal(given.t, motion.t):
        raise InputError("contacts are of another motion: their robot or their times differ. Find those of this one.")
    if given.axes is not None or given.over_edge(slice(None)):
        raise InputError(
            f"soles are on slopes or over edges of {given.ground}; expected whole soles on level tops to retime on."
        )
    return given


def _speeds(motion: Motion) -> Array:
    limit = np.array(motion.robot.model.velocityLimit)
    limit[(limit <= 0.0) | (limit > 1e100)] = np.inf
    limit[: 6 if motion.robot.floating else 0] = np.inf
    return limit


class _Stuck(NoSolution):
    """A step that cannot be done: perhaps, because it is too long."""

    def __init__(self, why: str, step: int) -> None:
        super().__init__(why)
        self.step = step


def _found(sets: PathSets, ends: list[float], rests: list[bool]) -> Timing:
    places = np.arange(float(sets.motion.n))
    most, n = sets.limits.pace**2, sets.motion.n
    first, last = ((0.0, most) if still else (end**2, end**2) for end, still in zip(ends, rests, strict=True))
    for place, end in ((0.0, ends[0]), (n - 1.0, ends[1])):
        if end == 0.0 and sets.stands(place) > NEAR:
            raise _no_pose(sets, place, "no timing is at rest")
    for halving in range(HALVINGS + 1):
        try:
            x, u, causes = _converged(sets, places, first, last)
        except _Stuck as stuck:
            near = np.arange(max(stuck.step - AROUND, 0), min(stuck.step + AROUND + 1, len(places) - 1))
            if halving == HALVINGS or places[stuck.step + 1] - places[stuck.step] <= FINEST:
                raise NoSolution(str(stuck)) from None
            places = np.sort(np.concatenate([places, 0.5 * (places[near] + places[near + 1])]))
            continue
        beyond = _between(sets, places, x, u)
        worse = np.flatnonzero(beyond > NEAR)
        if not len(worse) or halving == HALVINGS:
            break
        places = np.sort(np.concatenate([places, 0.5 * (places[worse] + places[worse + 1])]))
    pace, h = np.sqrt(x), np.diff(sets.time(places))
    spans = 2.0 * h / np.maximum(pace[:-1] + pace[1:], 1e-300)
    if not spans.max() < 1e6:
        raise NoSolution(f"no timing: at {sets.time(places)[int(spans.argmax())]:.4g} s the path can only be stood still on.")
    t = sets.motion.t[0] + np.concatenate([[0.0], np.cumsum(spans)])
    return Timing(sets, places, sets.time(places), t, pace, u, _named(sets, places, x, u, causes), float(beyond.max()))


def _along(sets: PathSets, places: Array, x: Array, u: Array, shares: tuple[float, ...]) -> tuple[Array, Array]:
    """(places, (u, x) there) at shares of each step, one share after the other, shapes (k n,) and (k n, 2)."""
    h, grid = np.diff(sets.time(places)), np.diff(places)
    p = [np.stack([u, x[:-1] + 2.0 * h * share * u], axis=1) for share in shares]
    return np.concatenate([places[:-1] + share * grid for share in shares]), np.concatenate(p)


def _between(sets: PathSets, places: Array, x: Array, u: Array) -> Array:
    """How far each step can be outside the sets between the points that are kept to, shape (n,).

    Tested at quarters, or eighths. A smooth curve is above the lines through its samples by an eighth of its second difference:
    that is added, of what must be balanced, where s' is not the largest one throughout.
    """
    n, bound = len(u), np.minimum(x[:-1], x[1:]) < sets.limits.pace**2 * (1.0 - 1e-9)
    tested, bend, fine = np.zeros(n), np.zeros(n), np.arange(n)
    for parts in (4, 8):
        at, p = _along(sets, places, x, u, tuple(np.arange(parts + 1) / parts))
        at, p = at.reshape(-1, n)[:, fine], p.reshape(-1, n, 2)[:, fine]
        own = sets.at(at.ravel())
        need = np.array([each.needs(here) for each, here in zip(own, p.reshape(-1, 2), strict=True)])
        second = np.diff(need.reshape(parts + 1, len(fine), -1), 2, axis=0)
        bend[fine] = np.abs(second).max(axis=(0, 2), initial=0.0) / 8.0
        beyond = sets.separate(at[1::2].ravel(), p[1::2].reshape(-1, 2)).reshape(-1, len(fine)).max(axis=0)
        tested[fine] = np.maximum(tested[fine], beyond)
        fine = fine[bend[fine] > 0.5 * NEAR]
        if not len(fine):
            break
    return tested + np.where(bound, bend, 0.0)


def _converged(
    sets: PathSets, places: Array, start: tuple[float, float], end: tuple[float, float]
) -> tuple[Array, Array, list[str]]:
    """(x, u, causes) of the fastest timing that is inside the sets at `CHECKED` of each step."""
    h = np.diff(sets.time(places))
    n, seen = len(h), [-1] * len(h)
    at, _ = _along(sets, places, np.zeros(n + 1), np.zeros(n), CHECKED)
    own = sets.at(at)
    steps: list[Step | None] = [None] * n
    for _ in range(ROUNDS):
        for j in range(n):
            three = own[j::n]
            if (size := sum(len(each.sides) for each in three)) != seen[j]:
                steps[j], seen[j] = Step.of(three, h[j]), size
        known = [step for step in steps if step is not None]
        reach, first = controllable(known, end)
        if first or max(reach[0, 0], start[0]) > min(reach[0, 1], start[1]) + 1e-9:
            raise _no_way(sets, places, known, reach, first, start)
        x, u, causes = fastest(known, reach, float(np.clip(start[1], *reach[0])))
        if not (sets.separate(*_along(sets, places, x, u, CHECKED)) > 1.01 * TOLERANCE).any():
            return x, u, causes
        if any(each.empty for each in own):
            raise _no_pose(sets, float(at[[each.empty for each in own].index(True)]))
    raise NoSolution(f"the timing was not found in {ROUNDS} rounds. Resample the motion to a lower rate: motion.resample(30).")


def _no_way(
    sets: PathSets, places: Array, steps: list[Step], reach: Array, first: int, start: tuple[float, float]
) -> NoSolution:
    """Why the end cannot be reached: poses, the steps before a point, or the start."""
    j = first - 1
    near = () if not first else _along(sets, places[j : j + 2], np.zeros(2), np.zeros(1), CHECKED)[0]
    asked = np.union1d(places, near)
    sets.separate(asked, np.zeros((len(asked), 2)))
    empty = asked[[each.empty or np.isnan(Step.standing(each).largest) for each in sets.at(asked)]]
    if len(empty):
        return _no_pose(sets, float(empty[0]), others=len(empty) - 1)
    if not first:
        low, high = np.sqrt(reach[0])
        return NoSolution(
            f"no timing begins with s' = {np.sqrt(start[0]):.4g}: only from {low:.4g} to {high:.4g} can the rest be done. "
            f"Try start={high:.3g}, or a part that begins elsewhere: motion.cut(...)."
        )
    (here, there), least, most = sets.time(places[j : j + 2]), float(reach[first, 0]), float(reach[first, 1])
    against = steps[j].against(least, most)
    if "balance" in against:
        middle, p = np.array([0.5 * (places[j] + places[j + 1])]), np.array([[0.0, 0.5 * (least + most)]])
        against = (against - {"balance"}) | set(_unbalanced(sets, middle, p))
    low, high = np.sqrt(np.maximum(steps[j].before(0.0, sets.limits.pace**2), 0.0))
    can = f"{low:.4g} to {high:.4g}" if low <= high else "nothing"
    return _Stuck(
        f"no timing goes on from {here:.4g} s (frame {places[j]:g}): s' can be {can} there, must be {np.sqrt(least):.4g} to "
        f"{np.sqrt(most):.4g} at {there:.4g} s, and cannot change so fast: {', '.join(sorted(against))}."
        + (" Try end=0.0, or a part that ends elsewhere: motion.cut(...)." if first == len(steps) else ""),
        j,
    )


def _no_pose(sets: PathSets, place: float, what: str = "", others: int = 0) -> NoSolution:
    """That no timing makes a pose, and others, possible, or `what` is not, with what is in the way of the pose at rest."""
    also = f" The same holds for {others} other points of {len(sets.motion.t)} frames." if others else ""
    s = sets.time(np.array([place]))
    q, rest = sets.path(s)[0], np.zeros((1, sets.motion.robot.nv))
    one = Motion.of_arrays(sets.motion.robot, s, q, rest, rest, trust=True)
    torque, words = sets.limits.torque, list[str]()
    names = one.robot.actuated_names
    if sets.lanes is None:
        tau = sets.rows(q, rest, rest)[0, 0][one.robot.actuated]
        words = [f"motor of {n}, {x:.4g} of {m:.4g} N m" for n, x, m in zip(names, tau, torque, strict=True) if abs(x) > m]
    else:
        if not sets.touches(np.array([place])).any() and not what:
            return NoSolution(
                f"no timing makes the pose at {s[0]:.4g} s (frame {place:g}) possible: nothing touches, and it does not fall "
                f"as this path does (floats).{also} Which points touch is read by rbd.motion.find_contacts; contacts= edits it."
            )
        lanes = replace(sets.lanes.at_frames(np.array([int(place)])), t=s, touches=sets.touches(np.array([place])))
        lanes = replace(lanes, places=sets.points_at(q), slides=lanes.slides & False, raised=lanes.raised & False)
        limits = float(np.nanmin(torque / one.robot.effort_limit, initial=np.inf))
        report = check_motion(
            one, contacts=lanes, friction=sets.limits.friction, threshold=2.0 * SLACK,
            torque_limits=limits if np.isfinite(limits) else False, self_collision=False, progress=False,
        )  # fmt: skip
        words = [cause for cause in ("floats", "friction", "tips") if report.of_cause(cause).any()]
        over = np.argsort(-report.excess[0])
        words += [f"motor of {names[j]}, {100.0 + 100.0 * x:.0f} % of its limit" for j in over if (x := report.excess[0, j])]
    why = "; ".join(words[:4]) or "it is at the edge of friction, soles and torques"
    said = f"{what} at {s[0]:.4g} s (frame {place:g}):" if what else (
        f"no timing makes the pose at {s[0]:.4g} s (frame {place:g}) possible: even at rest,")  # fmt: skip
    return NoSolution(f"{said} {why}.{also}")


def _named(sets: PathSets, places: Array, x: Array, u: Array, causes: list[str]) -> tuple[str, ...]:
    """The causes of steps, with what is in the way of balance where it is balance."""
    out = np.array(causes, dtype=object)
    some = np.flatnonzero(out == "balance")
    if len(some):
        middle = 0.5 * (places[some] + places[some + 1])
        out[some] = _unbalanced(sets, middle, np.stack([u[some], 0.5 * (x[some] + x[some + 1])], axis=1))
    return tuple(out)


def _unbalanced(sets: PathSets, places: Array, p: Array) -> list[str]:
    """Floats, friction or tips: what is in the way of (u, x) beyond the half-plane of balance that is nearest."""
    assert sets.lanes is not None
    beyond, own_sets = np.empty_like(p), sets.at(places)
    for i, each in enumerate(own_sets):
        own = np.flatnonzero([cause == "balance" for cause in each.causes])
        j = own[(each.normals[own] @ p[i] - each.sides[own]).argmax()] if len(own) else 0
        normal = each.normals[j] * each.scale
        beyond[i] = p[i] + each.scale * normal * _NUDGED / max(float(normal @ normal), 1e-12)
    q, q1, q2 = sets.path(sets.time(places))
    root = np.sqrt(np.maximum(beyond[:, 1:], 0.0))
    terms = FrameTerms.of(sets.motion.robot, q, q1 * root, q1 * beyond[:, :1] + q2 * root**2, None)
    b = terms.wrench / wrench_scale(sets.motion.robot) - np.array([each.missed for each in own_sets])
    most, mu = np.full(len(places), _SMALL), sets.limits.friction
    masks = without_balance(terms, sets.points_at(q), sets.touches(places), b, most, mu, sets.lanes.zero)
    names = np.array(["floats", "friction", "tips"])
    return [" and ".join(names[row]) or "balance" for row in np.stack(masks, axis=1)]


def _words(shares: Mapping[str, float]) -> str:
    """The first three causes."""
    return ", ".join(f"{cause} in {share:.0%} of the time".replace("%", " %") for cause, share in list(shares.items())[:3])
