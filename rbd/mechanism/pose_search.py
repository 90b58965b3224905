"""`find_pose`: inverse kinematics of contacts, frames and the centre of mass, within joint limits and near a posture.

Levenberg-Marquardt steps within the limits (`rbd.constraints.descent`) converge from the posture to the targets, down to
rounding; if they end at a minimum above zero, further starts follow. Then steps that minimise |W d|^2, with d the displacement
from the posture, over the motions that the targets and limits allow.

Lengths are divided by the robot's length (`robot.joints.length`), angles are in radians.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, largest_first, max_abs
from rbd.constraints.constraint import Constraint, with_loops
from rbd.constraints.descent import Residual, Space, StationaryPoint, descend, minimise
from rbd.constraints.surface import On
from rbd.displayed import Displayed
from rbd.errors import CannotReach, InputError, ModelError
from rbd.errors.inputs import check_kind
from rbd.mechanism.constraint_error import position_residual
from rbd.mechanism.pose_targets import (
    CentreOfMass,
    Miss,
    OutOfReach,
    Target,
    Where,
    misses,
    out_of_reach,
    read_com,
    read_targets,
)
from rbd.mechanism.poses import draw
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.programs import within
from rbd.records import Axis, Field
from rbd.robots.robot import Robot

Named = TypeVar("Named")

STARTS = 24
"""Further starts, with a separate seed, before targets are reported as not satisfied."""
MET = 1e-12
"""Tolerance of targets [m, rad]; larger by rounding more than 10 m from the origin."""
_NOISE = 1e-6
"""Errors below this fraction of the largest are rounding of the minimum, and are not reported."""
_STEPS, _BACK = 200, 30
"""Largest number of steps onto the targets: from a start, and from a step nearer to the posture."""
_NEARER, _HALVINGS, _GAIN = 40, 6, 2e-3
"""Largest number of steps nearer to the posture, of halvings of a step, and the least relative decrease of |W d|^2.

A symmetric crouch of a humanoid is a saddle of |W d|^2: leaning sideways reduces it by a percent, in steps that begin small.
"""
_HOLD = 1e3
"""Weight of the targets' rows over those of the displacement."""
_STIFF, _ROUNDS = 1e2, 4
"""Weight of loops in the method of multipliers, and its rounds; each divides their errors by the weight's square."""
_BASE = 0.03
"""Weight of a base's translation and heading in |W d|; its tilt and the joints have one."""


@dataclass(frozen=True, eq=False)
class FoundPose(Displayed):
    """A pose that satisfies its targets, as `find_pose` finds it.

    Attributes:
        state: The robot there, at rest.
        misses: {target: its error, a distance [m] and an angle [rad]}, recomputed from the model.
        loops: {loop of the robot: its position error} [m, rad].
        moved: Distance of the joints from the posture: Euclidean norm [rad; translations over the robot's length].
        at_limits: Joints at a limit, except those that are at one in the posture.
        starts: Number of starts: one if the search from the posture succeeded.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> targets = {"FL_FOOT": (0.2, 0.2, 0.05), "front_right": None, "hind_left": None, "hind_right": None}
        >>> found = rbd.find_pose(solo, targets)
        >>> print(found.worst < 1e-12, f"moved {found.moved:.2f} rad", found.at_limits, found.starts)
        True moved 0.12 rad () 1
    """

    state: State
    misses: Mapping[str, Miss]
    loops: Mapping[str, float]
    moved: float
    at_limits: tuple[str, ...]
    starts: int

    fields: ClassVar[tuple[Field, ...]] = (
        Field("worst_error", (), "m or rad", "largest error of targets and loops", lambda found: found.worst, certificate=True),
        Field("q", ("position",), "{}", "configuration"),
        Field("com", ("axis",), "m", "centre of mass in W", lambda found: found.state.com),
        Field("moved", (), "rad", "distance of the joints from the posture"),
        Field("at_limits", (), "1", "number of joints at a limit", lambda found: len(found.at_limits), default=False),
        Field("starts", (), "1", "number of starts of the search", default=False),
    )

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates."""
        return self.state.coordinate_axes

    @property
    def q(self) -> Array:
        """The configuration, shape (nq,), read-only."""
        return self.state.q

    @property
    def worst(self) -> float:
        """Largest error of targets and loops [m, rad]."""
        return max([*self.loops.values(), *(max(miss.distance, miss.angle) for miss in self.misses.values())])

    def __str__(self) -> str:
        head = f"{self.state.robot.name}: {len(self.misses)} targets satisfied to {self.worst:.1e} (m, rad)"
        lines = [f"{head}, {self.moved:.4g} from the posture"]
        lines += [f"  {name}: {miss.distance:.1e} m, {miss.angle:.1e} rad" for name, miss in self.misses.items()]
        lines += [f"  {name}: closed to {apart:.1e} (m, rad)" for name, apart in self.loops.items()]
        lines += [f"  at a limit: {', '.join(self.at_limits)}"] if self.at_limits else []
        return "\n".join(lines)


def find_pose(
    robot: Robot,
    targets: Mapping[Any, Where] | None = None,
    *,
    ground: On = 0.0,
    posture: str | Array | State | None = None,
    com: Sequence[float] | Array | None = None,
    loops: bool = True,
) -> FoundPose:
    """A pose with contacts, frames and the centre of mass at given places, near a posture, within joint limits.

    A place is written so::

        feet and contacts    (x, y, z): position of the centre; a sole (or an edge) is flat on the ground, its heading free
                             ((x, y, z), n): the same, with z along the unit vector n
                             rbd.Ground(point=..., normal=...), or a height [m]: on that plane, a sole flat, anywhere
                             None: the same for its own ground; on terrain over the place that it has in the posture
                             pinocchio.SE3: position and axes of a sole
        frames               (x, y, z): position of the origin. ((x, y, z), n): z along n too. pinocchio.SE3: position and axes.
                             rbd.Ground: the origin on that plane, anywhere

    All in W. Feet have the names of `robot.feet()`; other contacts are keys themselves, `{hand: (0.5, 0.2, 1.0)}`, and their
    friction is not used. The base moves as the targets require; the joints stay near
    the posture: steps along the targets reduce the displacement until a step reduces its square by less than 2e-3, with the
    tilt of the base weighted as a joint. Joints that affect no target do not move.

    Collisions between bodies and torques are not considered.

    Args:
        robot: The robot.
        targets: {foot, contact or frame: place}; None: all its feet, on their ground.
        ground: That under the feet which are given by name: a height [m], `rbd.Ground`, or `rbd.Terrain`.
        posture: Initial configuration, and the one to stay near: a name, q, or a state; by default the standing posture, else
            the neutral one. Joints beyond their limits are first moved onto them.
        com: Position of the centre of mass, (x, y) or (x, y, z) in W [m].
        loops: Whether the robot's own loops hold.

    Returns:
        The pose, with each target satisfied to 1e-12 m and rad (more by rounding, far from the origin).

    Raises:
        CannotReach: no pose was found; with the nearest pose, the error of each target there, whether it is a true minimum of
            the distance, and, where points are farther apart than the links between them, the certificate that no pose exists.
        InputError: invalid targets or places: of a wrong kind or size, or not finite.
        FrameNotFound: no foot and no frame of a given name.
        DuplicateName: two targets with the same name.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> places = {"front_left": (0.2, 0.2, 0.05), "front_right": None, "hind_left": None, "hind_right": None}
        >>> found = rbd.find_pose(solo, places)  # one foot lifted, three on the ground
        >>> print(found.worst < 1e-12, f"{found.moved:.2f} rad")
        True 0.18 rad
    """
    search, q0, apart = _search(robot, targets, ground, posture, com, loops)
    tried = search.tries(q0, 0 if apart else STARTS)
    if isinstance(tried, FoundPose):
        return tried
    end = search.minimum(min(tried, key=lambda reached: reached.size2))
    if search.met(end.at):
        return search.found(q0, end.at, len(tried))
    raise search.failure(end, len(tried) - 1, apart)


def quick_pose(
    robot: Robot, targets: Mapping[Any, Where], *, ground: On, posture: State, com: Array | None, starts: int
) -> FoundPose | dict[str, Miss]:
    """`find_pose` with few further starts; or {target: error} at the nearest pose that was found, perhaps not the nearest."""
    search, q0, apart = _search(robot, targets, ground, posture, com, True)
    tried = search.tries(q0, 0 if apart else starts)
    if isinstance(tried, FoundPose):
        return tried
    misses = search.misses(min(tried, key=lambda reached: reached.size2).state.q)
    return {name: miss for name, miss in misses.items() if not miss.within(search.tolerance)}


def _search(
    robot: Robot, targets: Mapping[Any, Where] | None, ground: On, posture: str | Array | State | None,
    com: Sequence[float] | Array | None, loops: bool,
) -> tuple[_PoseSearch, Array, OutOfReach | None]:  # fmt: skip
    """(search, configuration at which it begins, certificate that there is no pose)."""
    check_kind("the robot", robot, CheckedModel, "a robot: rbd.load_robot(name)")
    q = _posture(robot, posture)
    asked, place = read_targets(robot, targets, ground, State(robot, q)), read_com(com)
    search = _PoseSearch(robot, asked, place, with_loops(robot, (), loops))
    return search, search.inside(q), out_of_reach(robot, asked)


def _posture(robot: CheckedModel, posture: object) -> Array:
    """The initial configuration."""
    if isinstance(posture, State):
        if not robot.is_like(posture.robot):
            raise InputError(f"posture is a state of {posture.robot.name}, another robot; expected one of {robot.name}.")
        return posture.q
    if isinstance(posture, str) and isinstance(robot, Robot):
        return robot.standing(posture).q if robot.source.feet and robot.floating else robot.posture(posture)
    if posture is not None:
        return robot.check_q(posture)  # type: ignore[arg-type]
    standing, neutral = getattr(robot, "standing", None), np.asarray(pin.neutral(robot.model))
    try:
        return neutral if standing is None else np.asarray(standing().q)
    except ModelError:  # no feet are known, or no posture
        return neutral


class _PoseSearch(Space[Residual]):
    """A search for a pose: targets of a robot, and its loops.

    Args:
        robot: The robot.
        targets: Of contacts and frames.
        com: Of the centre of mass.
        loops: Constraints that stay closed.
        stiff: Weight of the loops over the targets.
        shift: Added to the loops' errors, shape (m,): their multipliers over the weight's square; None for zero.

    Attributes:
        tolerance: Of the targets [m, rad].
    """

    def __init__(
        self,
        robot: CheckedModel,
        targets: Sequence[Target],
        com: CentreOfMass | None,
        loops: Sequence[Constraint],
        *,
        stiff: float = 1.0,
        shift: Array | None = None,
    ) -> None:
        super().__init__(robot, limited=True)
        self.targets, self.com, self.loops = tuple(targets), com, tuple(loops)
        self._parts: tuple[Target | CentreOfMass, ...] = self.targets if com is None else (*self.targets, com)
        self._stiff, self._shift, self._length = stiff, shift, robot.joints.length
        far = max([robot.joints.reach, *(max_abs(t.point) for t in self.targets if t.point is not None)])
        self.tolerance = MET * max(1.0, 0.1 * far)
        roots = [joint for joint in robot.joints.values() if robot.model.parents[joint.id] == 0]
        self._bases = [joint for joint in roots if joint.kind in ("FreeFlyer", "Planar")]

    def at(self, q: Array) -> Residual:
        """The errors at a configuration, without units."""
        state, errors, rows = State(self.robot, q), [], []
        for part in self._parts:
            e, J = part.errors(state)
            lengths = len(e) - part.angles
            e[:lengths] /= self._length
            J[:lengths] /= self._length
            errors.append(e)
            rows.append(J)
        if self.loops:
            e, J = self._open(state)
            errors.append(self._stiff * (e if self._shift is None else e + self._shift))
            rows.append(self._stiff * J)
        return Residual(state, np.concatenate(errors), np.concatenate(rows) * self.scale)

    def _open(self, state: State) -> tuple[Array, Array]:
        """Errors of the loops, and their Jacobian [m, rad]."""
        found = [position_residual(loop.rows(state)) for loop in self.loops]
        return np.concatenate([e for e, _ in found]), np.concatenate([J for _, J in found])

    def tries(self, q0: Array, starts: int) -> FoundPose | list[Residual]:
        """The pose, from q0 or from some further starts; or the ends of all."""
        tried, rng = [self.descend(q0)], np.random.default_rng(0)
        for i in range(starts + 1):
            if self.met(tried[-1]):
                return self.found(q0, tried[-1], len(tried))
            if i < starts:
                tried.append(self.descend(self.other_start(q0, rng, i)))
        return tried

    def descend(self, q: Array, most: int = _STEPS) -> Residual:
        """The end of the descent from a configuration, down to rounding."""
        return descend(self, self.at(q), tolerance=0.02 * MET, most=most).at

    def misses(self, q: Array) -> dict[str, Miss]:
        """{target: error}."""
        return misses(self.robot, q, self.targets, self.com)

    def apart(self, q: Array) -> dict[str, float]:
        """{loop: position error} [m, rad]."""
        state = State(self.robot, q)
        return {loop.name: float(np.linalg.norm(position_residual(loop.rows(state))[0])) for loop in self.loops}

    def met(self, reached: Residual) -> bool:
        """Whether all targets are satisfied, and all loops closed."""
        q = reached.state.q
        if reached.residual > 1e3 * self.tolerance:
            return False
        closed = all(apart <= self.tolerance for apart in self.apart(q).values())
        return closed and all(miss.within(self.tolerance) for miss in self.misses(q).values())

    def other_start(self, q0: Array, rng: np.random.Generator, i: int) -> Array:
        """Further initial configurations: around the posture, farther each time, then anywhere within the limits."""
        if 2 * i < STARTS:
            return self.move(q0, rng.normal(size=self.robot.nv) * (0.1 + 1.8 * i / STARTS))
        q = self.inside(draw(self.robot, rng))
        for base in self._bases:  # at the same place, in another orientation
            place = slice(base.q.start, base.q.start + (3 if base.kind == "FreeFlyer" else 2))
            q[place] = q0[place]
        return q

    def found(self, q0: Array, reached: Residual, starts: int) -> FoundPose:
        """The result, after steps along the targets that reduce the displacement from the posture."""
        state = self._nearer(q0, reached).state
        d = self.way(q0, state.q)
        for base in self._bases:
            d[base.v] = 0.0
        limits = np.flatnonzero(self._at_limit(state.q) & ~self._at_limit(q0))
        names = tuple(self.robot.joints.velocities[i].name for i in limits)
        return FoundPose(state, self.misses(state.q), self.apart(state.q), float(np.linalg.norm(d)), names, starts)

    def _at_limit(self, q: Array) -> Array:
        """Which coordinates are at a limit, shape (nv,), bool."""
        lower, upper = self.room(q)
        return np.minimum(-lower, upper) < 1e-9

    def _nearer(self, q0: Array, reached: Residual) -> Residual:
        weight = self._weight(q0)
        at, d = reached, weight @ self.way(q0, reached.state.q)
        for _ in range(_NEARER):
            rows = at.J * (_HOLD / max(1e-300, float(np.linalg.norm(at.J, 2))))
            A, b = np.concatenate([rows, weight]), np.append(np.zeros(len(rows)), -d)
            z = within(A, b, *self.room(at.state.q))
            z *= min(1.0, 0.5 / max(1e-300, max_abs(z)))
            for _ in range(_HALVINGS):
                there = self.descend(self.move(at.state.q, z), _BACK)
                way = weight @ self.way(q0, there.state.q)
                if way @ way < d @ d and self.met(there):
                    break
                z = 0.5 * z
            else:
                break
            enough = way @ way > (1.0 - _GAIN) * (d @ d)
            at, d = there, way
            if enough:
                break
        return at

    def _weight(self, q0: Array) -> Array:
        """W, shape (nv, nv): one for joints and for the base's tilt, `_BASE` for its translation and its heading."""
        weight = np.eye(self.robot.nv)
        for base in self._bases:
            weight[base.v, base.v] *= _BASE
            if base.kind == "FreeFlyer":
                turn = slice(base.v.start + 3, base.v.stop)
                weight[turn, turn] = np.diag([1.0, 1.0, _BASE]) @ State(self.robot, q0).base_pose(base.id).rotation
        return weight

    def minimum(self, nearest: Residual) -> StationaryPoint[Residual]:
        """The minimum of the targets' distance; with loops, by the method of multipliers."""
        if not self.loops:
            return minimise(self, nearest)
        q, shift = nearest.state.q, 0.0 * self._open(nearest.state)[0]
        for _ in range(_ROUNDS):
            stiff = _PoseSearch(self.robot, self.targets, self.com, self.loops, stiff=_STIFF, shift=shift)
            end = minimise(stiff, stiff.descend(q))
            q, shift = end.at.state.q, shift + stiff._open(end.at.state)[0]
        # The slope over |J| |e| of the targets alone: the weight of the loops increases that of all.
        alone = _PoseSearch(self.robot, self.targets, self.com, ()).at(q)
        return replace(end, slope=end.slope * end.at.scale / max(1e-300, alone.scale))

    def failure(self, end: StationaryPoint[Residual], others: int, apart: OutOfReach | None) -> CannotReach:
        """The error for targets that are not satisfied."""
        q, name = end.at.state.q, self.robot.name
        missed = [(k, m) for k, m in self.misses(q).items() if not m.within(self.tolerance)]
        size = np.array([max(m.distance / self._length, m.angle) for _, m in missed])
        left = dict(missed[i] for i in largest_first(size) if size[i] > _NOISE * size.max())
        pressed = {c.name: float(x) for c, x in zip(self.robot.joints.velocities, end.held, strict=True) if abs(x) > 0.0}
        off = "; ".join(f"{k!r:.60} is {m} off" for k, m in _first(left))
        say = [f"{name} does not reach its targets; at the nearest pose {off}."]
        open_ = {k: x for k, x in self.apart(q).items() if x > 1e-9}
        say += [f"Its loops do not close there: {', '.join(f'{k!r:.60} by {x:.3g}' for k, x in _first(open_))}."] * bool(open_)
        say += [f"There is no pose: {apart}."] * bool(apart)
        if end.minimum:
            at = f"; at a limit: {', '.join(k[:60] for k, _ in _first(pressed))}" if pressed else ""
            say.append(f"No small motion reduces the distance: a true minimum (slope {end.slope:.0e}{at}).")
        else:
            say.append("The number of steps ran out, so that this may not be a minimum of the distance.")
        say += [f"None of {others} further starts ended nearer."] * (others > 0)
        without = self._without_each(q, left)
        say += [f"Without {' or '.join(f'{k!r:.60}' for k in without)} the others are satisfied."] * bool(without)
        return CannotReach(
            " ".join(say), q=q, misses=left, minimum=end.minimum, slope=end.slope, limits=pressed, certificate=apart,
            without=without,
        )  # fmt: skip

    def _without_each(self, q: Array, left: Mapping[str, Miss]) -> tuple[str, ...]:
        """Targets without which, one at a time, the others are satisfied."""
        out = []
        for name, _ in _first(left):
            targets = [t for t in self.targets if t.name != name]
            com = None if self.com is None or self.com.name == name else self.com
            if targets or com:
                less = _PoseSearch(self.robot, targets, com, self.loops)
                if less.met(less.descend(q)):
                    out.append(name)
        return tuple(out)


def _first(of: Mapping[str, Named]) -> list[tuple[str, Named]]:
    """The first items, for a message."""
    return list(of.items())[:5]
