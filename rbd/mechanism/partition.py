"""Known and unknown velocities of a mechanism, and accelerations: J1 known + J2 unknown = 0; in absolute angles too.

With the columns of J parted into those of the known velocities and the others,

    J1 v1 + J2 v2 = u                       u: prescribed velocity of surfaces and guides, zero for loops
    J1 a1 + J2 a2 + J_dot v = 0             (J_dot v less their acceleration)

v2 = J2^+ (u - J1 v1) is unique where J2 has full column rank. For a planar four-bar driven by its crank, with Norton's letters
(coupler b at th3, rocker c at th4), det J2 = b c sin(th3 - th4), zero where coupler and rocker are collinear. Rows may be
redundant: J2 is then not square.

A robot file measures the angle of a joint from the body before it. With theta the angles of the links from the ground,

    theta' = T q',     J_theta = J_q T^-1,     (p_a - p_b)' = J_theta theta' = J_1 theta'_known + J_2 theta'_unknown

T is triangular, of zeros and signs. A joint that slides keeps its displacement as coordinate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, lazy, max_abs
from rbd.constraints.constraint import Constraint, frames_of, loop_dof, rows_of
from rbd.constraints.manifold import own_or
from rbd.displayed import Displayed
from rbd.errors import InputError, SingularPose, nearest
from rbd.errors.inputs import listed_items
from rbd.mechanism.constraint_error import BilateralVelocities, Closure, Rates, branches_meet, independent_columns, rank_of
from rbd.mechanism.idle import IdleFreedom, idle_directions, idle_freedoms, told
from rbd.model.inertial import body_names
from rbd.model.state import State, checked
from rbd.robots.linkage import link_angles


@dataclass(frozen=True, eq=False)
class VelocityColumns:
    """Columns of the constraints' Jacobian, parted into those of known and of unknown velocities.

    Attributes:
        known: Names of the known velocities: those of `robot.joints.velocities` ("crank", "base.wz").
        unknown: Names of the others.
        J_known: J1, shape (m, known).
        J_unknown: J2, shape (m, unknown).
        singular_values: Of J2, with velocities that slide in units of the robot's length, shape (min(m, unknown),); of idle
            freedoms one.
    """

    known: tuple[str, ...]
    unknown: tuple[str, ...]
    J_known: Array
    J_unknown: Array
    singular_values: Array

    @property
    def rank(self) -> int:
        """Rank of J2."""
        return rank_of(self.singular_values)

    @property
    def sigma_min(self) -> float:
        """Least singular value of J2 [m]; zero where it has fewer rows than columns."""
        s = self.singular_values
        return float(s[-1]) if len(s) and len(s) == len(self.unknown) else 0.0

    @property
    def condition(self) -> float:
        """Largest singular value of J2 over its least; one if nothing is unknown."""
        if not self.unknown:
            return 1.0
        return float(self.singular_values[0] / self.sigma_min) if self.sigma_min > 0.0 else np.inf

    @lazy
    def determinant(self) -> float:
        """Det J2 with its sign, for a square J2; the sign changes with the order of rows and columns.

        Of a four-bar driven by its crank it is b c sin(th3 - th4) [m2] (coupler b at th3, rocker c at th4 from the ground):
        negative on the branch `assembled`, positive on `crossed`, zero where they meet.

        Raises:
            InputError: J2 is not square; `volume` has no sign and exists for all.
        """
        m, n = self.J_unknown.shape
        if m != n:
            names = ", ".join(self.unknown[:8]) or "none"
            raise InputError(f"J2 has {m} rows and {n} columns ({names}), and so no determinant; see `volume`.")
        return float(np.linalg.det(self.J_unknown))

    @lazy
    def volume(self) -> float:
        """sqrt(det(J2^T J2)): |det J2| if it is square, apart from zero rows."""
        gram = self.J_unknown.T @ self.J_unknown
        return float(np.sqrt(max(0.0, np.linalg.det(gram)))) if self.unknown else 1.0

    @lazy
    def influence(self) -> Array:
        """-J2^+ J1, shape (unknown, known): derivative of each unknown velocity by each known one."""
        return -np.linalg.lstsq(self.J_unknown, self.J_known, rcond=None)[0]


_CONSISTENT = 1e-9
"""Tolerance of the rows, over the largest sum of terms in a row."""


@dataclass(frozen=True, eq=False)
class _Partition(Displayed):
    """What velocities and accelerations from some of them have in common."""

    columns: VelocityColumns
    residual: float
    idle: tuple[str, ...]

    @property
    def condition(self) -> float:
        """Condition number of J2: amplification of small errors of lengths and angles in the rates."""
        return self.columns.condition

    @property
    def rank(self) -> int:
        """Rank of J2."""
        return self.columns.rank

    def _table(self, what: str, unknown: Mapping[str, float]) -> str:
        known, lines = len(self.columns.known), [f"  {name:24s} {value:.6g}" for name, value in unknown.items()]
        head = f"{what}: {known} known, {len(self.columns.unknown)} unknown, condition {self.condition:.4g}"
        return "\n".join([head, *lines, *(f"  idle, left at rest: {body} turns by itself" for body in self.idle)])


@dataclass(frozen=True, eq=False)
class VelocityPartition(_Partition):
    """All velocities of a mechanism from some of them, as `velocity_partition` finds them.

    Attributes:
        v: Velocity, shape (nv,): for `state.with_velocity(v)`.
        rates: {unknown velocity: its value} [rad/s, m/s].
        columns: J1 and J2, their rank and condition.
        residual: Largest `|J v - u|` [m/s, rad/s].
        idle: Links that turn by themselves, as between two balls: of them v is that without such a turn.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100).at("assembled")
        >>> found = rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0})
        >>> print(found.v.round(3), f"condition {found.condition:.3f}")
        [ 25.    -24.234  13.11 ] condition 2.157
    """

    v: Array
    rates: dict[str, float]

    def __str__(self) -> str:
        return self._table("velocity", self.rates)


@dataclass(frozen=True, eq=False)
class AccelerationPartition(_Partition):
    """All accelerations of a mechanism from some of them, as `acceleration_partition` finds them.

    Attributes:
        a: Acceleration, shape (nv,).
        accelerations: {unknown acceleration: its value} [rad/s2, m/s2].
        columns: J1 and J2, their rank and condition.
        residual: Largest `|J a + J_dot v|` [m/s2, rad/s2].
        idle: Links that turn by themselves, as between two balls: of them a is that without such a turn.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100).at("assembled")
        >>> moving = state.with_velocity(rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0}).v)
        >>> found = rbd.mechanism.acceleration_partition(moving, known={"crank_joint": 15.0})
        >>> print(found.a.round(3), found.residual < 1e-9)
        [15.    98.525 80.256] True
    """

    a: Array
    accelerations: dict[str, float]

    def __str__(self) -> str:
        return self._table("acceleration", self.accelerations)


def velocity_partition(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    known: Rates | None = None,
    *,
    loops: bool = True,
) -> VelocityPartition:
    """All velocities of a mechanism from those that are known: J2 v2 = u - J1 v1.

    Rates are those of the model's joints, each against the body before it: in a chain crank - coupler the coupler's is that
    from the crank, not from the ground.

    Args:
        state: The robot, assembled; its velocity is not used.
        constraints: Bilateral constraints, also on velocity only (rolling); None for the loops and wheels of the robot's
            file. Joint limits and dry friction determine no velocity and are ignored.
        known: {joint: rate} [rad/s, m/s]: a number, or the joint's nv numbers as in v; "base.wz" is one of them alone;
            None for none.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        v, the unknown rates by name, J1 and J2 with rank and condition number.

    Raises:
        SingularPose: J2 is singular: names the velocities that the known ones do not determine here.
        InputError: too few rates (names a sufficient set), rates that contradict each other, a state that is not assembled, a
            contact that can slip.
        JointNotFound: with the nearest names.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100).at("assembled")
        >>> found = rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0})
        >>> {name: round(rate, 3) for name, rate in found.rates.items()}
        {'coupler_joint': -24.234, 'rocker_joint': 13.11}
    """
    held = BilateralVelocities(state, constraints, loops)
    return VelocityPartition(*_solved(held, {} if known is None else known, held.u, "rate"))


def acceleration_partition(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    known: Rates | None = None,
    *,
    loops: bool = True,
) -> AccelerationPartition:
    """All accelerations of a mechanism from those that are known: J2 a2 = -J_dot v - J1 a1.

    Args:
        state: The robot, assembled, with a velocity that the constraints allow: `velocity_partition(...).v`.
        constraints: As for `velocity_partition`.
        known: {joint: acceleration} [rad/s2, m/s2], in the format of rates there.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        SingularPose: As `velocity_partition`.
        InputError: As `velocity_partition`, and if the state's velocity violates a constraint.
        JointNotFound: with the nearest names.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100).at("assembled")
        >>> moving = state.with_velocity(rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0}).v)
        >>> found = rbd.mechanism.acceleration_partition(moving, known={"crank_joint": 15.0})
        >>> {name: round(value, 3) for name, value in found.accelerations.items()}
        {'coupler_joint': 98.525, 'rocker_joint': 80.256}
    """
    held = BilateralVelocities(state, constraints, loops)
    off = held.J @ state.v - held.u
    if max_abs(off) > _CONSISTENT * max(1.0, _terms(held.J, state.v, held.u)):
        worst = held.row_names[int(np.argmax(np.abs(off)))]
        raise InputError(
            f"the velocity of {state.robot.name} breaks {worst!r:.80} by {max_abs(off):.3g} m/s (or rad/s); accelerations want "
            "one that the constraints allow: state.with_velocity(velocity_partition(state, constraints, known).v)."
        )
    return AccelerationPartition(*_solved(held, {} if known is None else known, -held.rows(state).bias, "acceleration"))


def _solved(
    held: BilateralVelocities, known: Rates, rhs: Array, what: str
) -> tuple[VelocityColumns, float, tuple[str, ...], Array, dict[str, float]]:
    """(columns, residual, idle links, all values, {unknown: its value}) of J x = rhs with some of x known.

    Raises:
        SingularPose: the known values do not determine the others.
        InputError: the known values contradict each other, or are too few.
    """
    mask, x = held.values(known, what)
    names = np.array([c.name for c in held.joints.velocities], dtype=object)
    s, Vt = _filled(held, mask, x, rhs)
    idle = list[IdleFreedom]()
    if rank_of(s) < (~mask).sum():
        free, metric = np.flatnonzero(~mask), held.joints.scale[~mask]
        J2 = held.J[:, ~mask] * metric
        idle = idle_freedoms(held.state, J2, free, metric, lambda z: held.off(free, metric * z))
        s, Vt = _filled(held, mask, x, rhs, idle_directions(held.state, J2, free, metric, idle))
    columns = VelocityColumns(tuple(names[mask]), tuple(names[~mask]), held.J[:, mask], held.J[:, ~mask], s)
    if columns.rank < len(columns.unknown):
        raise _undecided(held, columns, Vt[columns.rank :], what)
    residual = max_abs(held.J @ x - rhs)
    if residual > _CONSISTENT * max(1e-3, _terms(held.J, x, rhs)):
        raise _contradicted(held, known, rhs, residual, what)
    return columns, residual, told(idle), x, dict(zip(columns.unknown, x[~mask].tolist(), strict=True))


def _filled(held: BilateralVelocities, mask: Array, x: Array, rhs: Array, idle: Array | None = None) -> tuple[Array, Array]:
    """Singular values and right vectors of J2, with the rows of idle directions that are at rest.

    x, in place, solves J x = rhs by least squares where these determine it.
    """
    metric = held.joints.scale[~mask]
    more = np.zeros((0, len(metric))) if idle is None else idle
    U, s, Vt = np.linalg.svd(np.concatenate([held.J[:, ~mask] * metric, more]))
    if rank_of(s) == len(metric):
        left = np.concatenate([rhs - held.J[:, mask] @ x[mask], np.zeros(len(more))])
        x[~mask] = metric * (Vt.T @ ((left @ U[:, : len(s)]) / s))
    return s, Vt


def _undecided(held: BilateralVelocities, columns: VelocityColumns, null: Array, what: str) -> InputError | SingularPose:
    robot, J, names = held.state.robot, held.J * held.joints.scale, [c.name for c in held.joints.velocities]
    freedoms, k = robot.nv - rank_of(np.linalg.svd(J, compute_uv=False)), len(columns.known)
    moving = np.abs(null).max(axis=0)
    loose = _listed([name for name, size in zip(columns.unknown, moving, strict=True) if size > 1e-3 * moving.max()])
    few = f"{freedoms} degree{'s' * (freedoms != 1)} of freedom and {k} known {what}{'s' * (k != 1)}"
    if k < freedoms and not _singular_here(held):
        also = [names[i] for i in independent_columns(J, np.isin(names, columns.known))]
        return InputError(
            f"{robot.name} has {few}; {loose} can move while the known ones are at rest. Give as many as there are degrees of "
            f"freedom, e.g. {_listed(also)}."
        )
    here = f" The pose itself is singular: {few}." if k < freedoms else ""
    most = columns.singular_values[0] if len(columns.singular_values) else 0.0
    choice = [names[i] for i in independent_columns(J)]
    return SingularPose(
        f"the known {what}s ({_listed(columns.known)}) do not decide those of {loose}: J2 is singular here (rank "
        f"{columns.rank} of {len(columns.unknown)}; its singular values are from {columns.sigma_min:.1e} to {most:.3g}), as "
        f"where two links are in line.{here} {_listed(choice)} would decide all; or take another pose."
    )


def _singular_here(held: BilateralVelocities) -> bool:
    """Whether branches meet at the state, by its position constraints."""
    try:
        closure = Closure(held.state.robot, held.given, t=held.state.t)
        return branches_meet(closure, closure.start(held.state.q))
    except InputError:  # only velocity constraints: no poses to test
        return False


def _contradicted(held: BilateralVelocities, known: Rates, rhs: Array, residual: float, what: str) -> InputError:
    helps = []
    for name in known:
        mask, x = held.values({key: value for key, value in known.items() if key != name}, what)
        s, _ = _filled(held, mask, x, rhs)
        if rank_of(s) == (~mask).sum() and max_abs(held.J @ x - rhs) <= _CONSISTENT * max(1e-3, _terms(held.J, x, rhs)):
            found = np.array2string(x[held.joints.velocity(name)], precision=6)[1:-1].strip()
            helps.append(f"{name!r:.80} at {found} (not {known[name]!r:.40})")
    say = f" They agree with {' or '.join(helps[:6])}." if helps else ""
    free = [held.joints.velocities[i].name for i in independent_columns(held.J * held.joints.scale)]
    return InputError(
        f"the known {what}s of {held.state.robot.name} contradict each other, or the motion of what it touches: "
        f"{residual:.3g} is left at best.{say} {_listed(free) or 'Nothing'} would decide all."
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names[:8]) + ", ..." * (len(names) > 8)


def _terms(J: Array, x: Array, rhs: Array) -> float:
    """Largest sum of the sizes of the terms in a row of J x - rhs."""
    return max_abs(np.abs(J) @ np.abs(x) + np.abs(rhs))


def independent_velocities(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    prefer: Sequence[str] = (),
    loops: bool = True,
) -> tuple[str, ...]:
    """Names of velocities that, once known, decide all others: as many as there are degrees of freedom here.

    The others are chosen one after the other, each the column of J farthest from those chosen before (pivoted QR
    [GolubVanLoan2013]); the independent ones are left over. At a singular pose there are more than elsewhere.

    Args:
        state: The robot, assembled.
        constraints: As for `velocity_partition`.
        prefer: Joints to be independent if possible, e.g. those with motors.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: As `velocity_partition`.
        JointNotFound: with the nearest names.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> rbd.mechanism.independent_velocities(robot.at("assembled"), prefer=["crank_joint"])
        ('crank_joint',)
    """
    held = BilateralVelocities(state, constraints, loops)
    last = np.zeros(state.robot.nv, bool)
    for joint in listed_items("prefer", prefer, "a list of joints' names"):
        last[state.robot.joints.velocity(joint)] = True
    free = independent_columns(held.J * state.robot.joints.scale, last)
    return tuple(state.robot.joints.velocities[i].name for i in free)


_NORMAL = np.array([0.0, 1.0, 0.0])


def link_rates(state: State, rates: Sequence[float] | Array | None = None) -> dict[str, float]:
    """{link: its angular velocity from the ground [rad/s]}, of a mechanism in the x-z plane.

    Counter-clockwise as seen from -y, as `link_angles`. Of a coupler it is the crank's rate plus that of the joint between
    them. Angular accelerations add up in the same way: `link_rates(state, a)` in rad/s2.

    Args:
        state: The mechanism, moving.
        rates: Other joint rates or joint accelerations, shape (nv,); None for the state's velocity.

    Raises:
        InputError: a link that is turned out of the plane, another shape, numbers that are not finite.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40)).at("assembled")
        >>> v = rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0}).v
        >>> round(rbd.mechanism.link_rates(state, v)["coupler"], 4)
        -4.1209
    """
    angles = link_angles(state)
    one_each = ": one for each velocity of the robot"
    given = state.v if rates is None else as_finite("rates", rates, (state.robot.nv,), meaning=one_each)
    turning = _turning(state)
    bodies = {name: state.robot.site(name)[0] for name in angles}
    return {name: float((state.robot.joints.carrying(joint) * turning) @ given) for name, joint in bodies.items()}


def link_jacobians(
    state: State, constraints: Sequence[Constraint] | None = None, *, known: Sequence[str], loops: bool = True
) -> VelocityColumns:
    """J1 and J2 of the loops of a flat mechanism in absolute angles, with the signed det J2.

    Two rows a loop, the world's x and z of e = p_a - p_b, frame_a's point less frame_b's: J1 theta1' + J2 theta2' = e', zero
    while the loop is closed. A bar of length L from its own hinge to the next has the column L (-sin theta, cos theta),
    with a minus on the way of frame_b. For `four_bar` with the crank known::

        J1 = a (-sin th2, cos th2),  J2 = [b (-sin th3, cos th3), -c (-sin th4, cos th4)],  det J2 = b c sin(th3 - th4) [m2]

    It is a function of the state, also where the loop is open. `velocity_partition` takes joint rates instead.

    Args:
        state: The mechanism, in the x-z plane; its velocity is not used.
        constraints: Loop closures, not "rigid" ones; None for those of the robot's file.
        known: Names of links whose angles are known, or of joints that slide.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        `J_known` (J1) and `J_unknown` (J2) [m, or 1 for sliding joints], `determinant`, rank and condition of J2.

    Raises:
        InputError: joints other than hinges across the plane and slides in it, constraints that are no loops, an unknown or
            repeated name.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40)).at("assembled")
        >>> found = rbd.mechanism.link_jacobians(state, known=["crank"])
        >>> rates = -np.linalg.solve(found.J_unknown, found.J_known) @ [25.0]  # from the ground [rad/s]
        >>> found.unknown, rates.round(3), round(found.determinant)
        (('coupler', 'rocker'), array([-4.121,  6.998]), -5781)
    """
    robot, turning = checked(state).robot, _turning(state)
    joints = list(robot.joints.values())
    links = body_names(robot)
    names = [links[joint.id - 1] if turning[joint.v.start] else joint.name for joint in joints]
    T = np.array(
        [robot.joints.carrying(j.id) * turning if turning[j.v.start] else np.eye(robot.nv)[j.v.start] for j in joints]
    ).reshape(robot.nv, robot.nv)
    held = own_or(robot, constraints, loops)
    rows_of(state, held)  # refuses what is no constraint, and frames that the robot does not have
    rows = [_moving(state, a) - _moving(state, b) for a, b in (_ends(state, loop) for loop in held)]
    J = np.vstack([np.zeros((0, robot.nv)), *rows]) @ np.linalg.inv(T)
    mask = _mask(names, known)
    scale = np.array([1.0 if turning[joint.v.start] else robot.joints.reach for joint in joints])
    s = np.linalg.svd(J[:, ~mask] * scale[~mask], compute_uv=False)
    listed = np.array(names, dtype=object)
    return VelocityColumns(tuple(listed[mask]), tuple(listed[~mask]), J[:, mask], J[:, ~mask], s)


def _ends(state: State, loop: Constraint) -> tuple[str, str]:
    """The frames that a loop pins to each other.

    Raises:
        InputError: it does something else in the plane.
    """
    frames = frames_of(loop)
    carried = loop.rows(state).resultant
    pins = carried is None or np.linalg.matrix_rank(carried[[0, 2]]) == 2  # a slide leaves one velocity free, too
    if len(frames) != 2 or loop_dof(loop, state, _NORMAL) != 1 or not pins:
        raise InputError(
            f"{loop.name!r:.80} is no pin of a loop; link_jacobians wants loop closures of kind planar, point or revolute "
            "about y. For all others: velocity_partition."
        )
    return frames[0], frames[1]


def _turning(state: State) -> Array:
    """+1 for joints that turn counter-clockwise as seen from -y, -1 for clockwise, 0 for those that slide in the plane, (nv,).

    Raises:
        InputError: a joint that does neither.
    """
    robot = state.robot
    if not robot.joints:
        return np.zeros(0)
    _, _, J = state.joint_motion([joint.id for joint in robot.joints.values()])
    for joint in robot.joints.values():
        one = J[:6, joint.v]
        hinge = joint.nv == 1 and np.abs(np.abs(one[3:, 0]) - [0.0, 1.0, 0.0]).max() < 1e-9
        slide = joint.nv == 1 and np.abs(one[[1, 3, 4, 5], 0]).max() < 1e-9
        if not (hinge or slide):
            raise InputError(
                f"joint {joint.name!r:.80} of {robot.name} neither turns about y nor slides in the x-z plane; absolute angles "
                "are for flat mechanisms."
            )
    return np.array(-np.round(J[4]) + 0.0)


def _moving(state: State, frame: str) -> Array:
    """Jacobian of a frame's origin in the world's x and z, shape (2, nv)."""
    _, J, *_ = state.moving(frame, pin.SE3.Identity(), pin.LOCAL_WORLD_ALIGNED)
    return np.array(J[[0, 2]])


def _mask(names: list[str], known: Sequence[str]) -> Array:
    """Which coordinates are known.

    Raises:
        InputError: known is no list of these names, each once.
    """
    known = listed_items("known", known, f"a list of links, e.g. {names[:1]}")
    for i, name in enumerate(known):
        if not isinstance(name, str) or name not in names:
            raise InputError(f"no link of this mechanism that turns is called {name!r:.80}; {nearest(name, names)}.")
        if name in known[:i]:
            raise InputError(f"known names {name!r:.80} twice.")
    return np.array([name in known for name in names], dtype=bool)
