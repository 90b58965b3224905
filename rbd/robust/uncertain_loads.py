"""`UncertainLoads`: all loads that the members of a set put on a robot at rest, as corners and columns, with rounding bounds.

With masses m_i, centres of mass c_i and pushes w at points P of the robot, contact forces and torques must come to

    g(m, m c) - J_P^T w,      g = - sum_i J_ci^T m_i gravity,

which is linear in (m_i, m_i c_i) and in w. Over the intervals of m_i and the boxes of c_i it stays within

    corner of the pushes + sum of t_i D_i,      t_i in [-1, 1],

one column D for each uncertain mass, at the link's middle centre of mass, and three for each uncertain centre of mass, of the
moments m_i (c_i - middle): within the largest mass times the half-widths of the box. Of a link with both, that holds a little
more than the members. Masses and moments move the load; friction "at least mu" takes part by the smallest, as its cones grow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_vector3, check_number, check_whole, is_finite, lazy
from rbd.constraints.constraint import Constraint, has_friction, listed
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_different, check_kind, check_known
from rbd.model.state import State, checked
from rbd.problem.cones import check_friction
from rbd.records import joined, vector
from rbd.statics.force_balance import ForceBalance, place, standing_loads

MOST_CORNERS = 4096
"""Of all pushes together."""
_OPERATIONS = 100
"""Of rounding, a joint: placements, sines and products between a robot's file and an entry of a Jacobian."""
_ROUNDING = 2.0**-53
_LARGEST = 1e9
"""Of a push [N, N m] or a mass [kg]."""

Pushes = "PushSet | Sequence[PushSet] | Mapping[str, Sequence[Sequence[float]] | Array] | None"
Masses = float | Mapping[str, float | Sequence[float]] | None
Boxes = Mapping[str, float | Sequence[float]] | None


@dataclass(frozen=True, eq=False)
class PushSet(Displayed):
    """All pushes at a point of the robot within the convex hull of some.

    Attributes:
        frame: Frame of the robot that is pushed.
        corners: Forces (k, 3), or forces and moments about the point (k, 6), in W [N, N m].
        offset: The point, from the frame's origin in the frame's axes, shape (3,) [m].

    Raises:
        InputError: no corners, or numbers that are not finite.

    Example:
        >>> any_way = rbd.robust.PushSet.box("base_link", (-5, -5, 0), (5, 5, 0))
        >>> any_way.corners
        array([[-5., -5.,  0.],
               [-5.,  5.,  0.],
               [ 5., -5.,  0.],
               [ 5.,  5.,  0.]])
    """

    frame: str
    corners: Sequence[Sequence[float]] | Array
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        corners = np.atleast_2d(as_array(f"pushes at {self.frame!r:.80}", self.corners))
        if corners.ndim != 2 or corners.shape[1] not in (3, 6) or not len(corners):
            raise InputError(
                f"pushes at {self.frame!r:.80} have shape {corners.shape}; expected corners (k, 3) of forces, or (k, 6) of forces "
                "and moments, at least one."
            )
        if not is_finite(corners) or np.abs(corners).max() > _LARGEST:
            raise InputError(f"pushes at {self.frame!r:.80} reach {np.abs(corners).max():.3g}; expected up to {_LARGEST:g} N, N m.")
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "offset", place("offset", self.offset))

    @classmethod
    def box(
        cls, frame: str, low: Sequence[float] | Array, high: Sequence[float] | Array, offset: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> PushSet:
        """Forces, or forces and moments, each component of which is in an interval.

        Args:
            frame: Frame of the robot.
            low: Least components in W, shape (3,) or (6,) [N, N m].
            high: Largest components, likewise.
            offset: The point, as of the attribute.

        Raises:
            InputError: an interval that is reversed.
        """
        least, most = as_array("low", low), as_array("high", high)
        if least.shape != most.shape or least.shape not in ((3,), (6,)) or not (least <= most).all():
            raise InputError(
                f"a box of pushes from {low!r:.80} to {high!r:.80}; expected three or six numbers each, none of the first above "
                "that of the second."
            )
        return cls(frame, np.array(list(product(*[sorted({a, b}) for a, b in zip(least.tolist(), most.tolist(), strict=True)]))), offset)

    @classmethod
    def cone(
        cls,
        frame: str,
        direction: Sequence[float] | Array,
        size: float,
        angle_deg: float,
        *,
        sides: int = 8,
        offset: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> PushSet:
        """Forces within an angle of a direction whose part along it is up to a size: no push, to a pyramid around the cone.

        Args:
            frame: Frame of the robot.
            direction: In W; its length does not count.
            size: Largest part along the direction [N].
            angle_deg: Largest angle to it [deg], from 0 to 80.
            sides: Of the pyramid.
            offset: The point, as of the attribute.
        """
        along = as_vector3("direction", direction)
        if not (length := float(np.linalg.norm(along))) > 0.0:
            raise InputError("direction has no length; expected a vector in W, e.g. (0, 1, 0).")
        most = check_number("size", size, 0.0, _LARGEST, expected="a force [N]")
        angle = np.radians(check_number("angle_deg", angle_deg, 0.0, 80.0, expected="an angle from 0 to 80 degrees"))
        count = check_whole("sides", sides, 64, least=3)
        axis = along / length
        across = np.linalg.svd(axis[None])[2][1:]
        turn = np.arange(count) * (2.0 * np.pi / count)
        rim = np.tan(angle) / np.cos(np.pi / count) * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
        ends = axis + rim if angle > 0.0 else axis[None]
        return cls(frame, np.vstack([np.zeros(3), most * ends]), offset)


@dataclass(frozen=True, eq=False)
class Member(Displayed):
    """A member of a set: the push, the masses and the places of centres of mass, of what is uncertain.

    Attributes:
        push: {frame: force (3,), or force and moment (6,), in W [N, N m]}.
        mass: {link: [kg]}.
        com: {link: how far from the file's place, in the axes of the link's frame, shape (3,) [m]}.
    """

    push: Mapping[str, Array]
    mass: Mapping[str, float]
    com: Mapping[str, Array]

    def __str__(self) -> str:
        words = [f"a push of {vector(f, 4)} at {frame}" for frame, f in self.push.items()]
        words += [f"{link} of {m:.6g} kg" for link, m in self.mass.items()]
        words += [f"the centre of mass of {link} moved by {vector(c, 4)} m" for link, c in self.com.items()]
        return joined(words, 3) or "the robot as it is"


@dataclass(frozen=True, eq=False)
class UncertainLoads:
    """The set of loads, and the forces and torques that may carry them.

    Attributes:
        balance: The pose, its contacts with their least friction, and the load of the middle of all masses.
        pushes: The sets of pushes.
        corners: Loads at the corners of the pushes, shape (k, nv) [N, N m].
        components: The pushes there, shape (k, d) [N, N m].
        columns: D of each uncertain number, shape (n, nv) [N, N m].
        names: What each is: "mass of trunk", "x of the centre of mass of trunk".
        mass: What each adds to the robot's mass at t = 1, shape (n,) [kg]: zero of centres of mass.
        links: (link, number of its column of mass or -1, middle mass [kg], half-width [kg or m]) of each.
        load_radius: Bound of the rounding of a load, shape (nv,).
        forces_radius: Bound of the rounding of the generalised force of a unit contact force, shape (nv,).
    """

    balance: ForceBalance
    pushes: tuple[PushSet, ...]
    corners: Array
    components: Array
    columns: Array
    names: tuple[str, ...]
    mass: Array
    links: tuple[tuple[str, int, float, float], ...]
    load_radius: Array
    forces_radius: Array

    @classmethod
    def of(
        cls,
        state: State,
        contacts: Sequence[Constraint],
        pushes: object = None,
        friction: float | Mapping[str, float] | None = None,
        mass: Masses = None,
        com: Boxes = None,
        loops: bool = True,
    ) -> UncertainLoads:
        """The set, checked; arguments as of `rbd.robust.hold`.

        Raises:
            InputError: sets that are empty, reversed or none; as `rbd.hold`.
            FrameNotFound, UnknownName: links, frames or contacts that are not there.
        """
        balance = standing_loads(state, with_least_friction(contacts, friction), "cone", 0.0, loops)
        robot, sets = state.robot, push_sets(pushes)
        if (count := prod(len(s.corners) for s in sets)) > MOST_CORNERS:
            raise InputError(f"the sets of pushes have {count:,} corners together; expected up to {MOST_CORNERS:,}. Give fewer.")
        heavy, boxes = masses_of(robot, mass), boxes_of(robot, com)
        load, columns, names, moved, size = state.h.copy(), list[Array](), list[str](), list[float](), robot.mass
        links, masses = list[tuple[str, int, float, float]](), dict[int, int]()
        g = robot.gravity
        for joint, (link, least, most) in heavy.items():
            J = state.frame(link, _middle_of(robot, link)).J
            load -= J[:3].T @ g * (0.5 * (least + most) - robot.model.inertias[joint].mass)
            size += 2.0 * most
            if most > least:
                columns.append(-J[:3].T @ g * (0.5 * (most - least)))
                names.append(f"mass of {link}")
                moved.append(0.5 * (most - least))
                masses[joint] = len(links)
                links.append((link, len(links), 0.5 * (least + most), 0.5 * (most - least)))
        for joint, (link, widths) in boxes.items():
            own = float(robot.model.inertias[joint].mass)
            _, least, most = heavy.get(joint, ("", own, own))
            found = state.frame(link)
            for axis in np.flatnonzero(widths):
                moment = found.X_WF.rotation[:, axis] * most * widths[axis]
                columns.append(-found.J[3:].T @ np.cross(moment, g))
                names.append(f"{'xyz'[axis]} of the centre of mass of {link}")
                moved.append(0.0)
                links.append((link, masses.get(joint, -1), 0.5 * (least + most), float(widths[axis])))
                size += most * widths[axis]
        jacobians = [state.frame(s.frame, s.offset).J for s in sets]
        pushed = [J[: np.asarray(s.corners).shape[1]].T @ np.asarray(s.corners).T for J, s in zip(jacobians, sets, strict=True)]
        corners = [load - sum((part[:, i] for part, i in zip(pushed, at, strict=True)), np.zeros(robot.nv)) for at in _each(sets)]
        components = [np.concatenate([np.zeros(0), *[np.asarray(s.corners)[i] for s, i in zip(sets, at, strict=True)]]) for at in _each(sets)]
        rounding = _rounding(state, balance)
        largest = size * float(np.linalg.norm(g)) + sum(float(np.abs(s.corners).sum(axis=1).max()) for s in sets)
        return cls(
            balance, sets, np.array(corners), np.array(components), np.array(columns).reshape(-1, robot.nv), tuple(names),
            np.array(moved), tuple(links), np.full(robot.nv, rounding * largest), np.full(robot.nv, rounding),
        )  # fmt: skip

    @property
    def state(self) -> State:
        """The pose."""
        return self.balance.state

    @lazy
    def limits(self) -> tuple[Array, Array]:
        """(least, most) torques at rest, shapes (nu,); infinite of motors without a stated limit."""
        return self.state.robot.limits_at(self.state.v)

    def load(self, corner: int, t: Array) -> Array:
        """The load of a member, shape (nv,) [N, N m]."""
        return np.asarray(self.corners[corner] + t @ self.columns)

    def inside(self, t: Array) -> Array:
        """The same for a true member: of a link that is lighter than at most, moments of its centre of mass are less."""
        out = t.copy()
        for i, (_, column, middle, _) in enumerate(self.links):
            if column not in (-1, i):
                half = self.links[column][3]
                out[i] *= (middle + t[column] * half) / (middle + half) * (1.0 - 2.0**-50)
        return out

    def member(self, corner: int, t: Array) -> Member:
        """What a member is in words of the user."""
        split = np.cumsum([0, *[np.asarray(s.corners).shape[1] for s in self.pushes]])
        pushed = {s.frame: self.components[corner][a:b] for s, a, b in zip(self.pushes, split[:-1], split[1:], strict=True)}
        mass, com = dict[str, float](), dict[str, Array]()
        for i, (link, column, middle, half) in enumerate(self.links):
            if column == i:
                mass[link] = middle + float(t[i]) * half
        for i, (link, column, middle, width) in enumerate(self.links):
            if column != i:
                full = middle + (self.links[column][3] if column >= 0 else 0.0)
                now = middle + (float(t[column]) * self.links[column][3] if column >= 0 else 0.0)
                com.setdefault(link, np.zeros(3))["xyz".index(self.names[i][0])] = float(t[i]) * width * full / now
        return Member(pushed, mass, com)

    def with_corners(self, corners: Array, components: Array, columns: Array | None = None) -> UncertainLoads:
        """The same with other loads."""
        return replace(self, corners=corners, components=components, columns=self.columns if columns is None else columns)


def _each(sets: Sequence[PushSet]) -> product[tuple[int, ...]]:
    return product(*[range(len(s.corners)) for s in sets])


def _rounding(state: State, balance: ForceBalance) -> float:
    """Bound of the rounding of an entry of J^T G, over the size of a unit force: operations of all joints times their arms."""
    model = state.robot.model
    arms = sum(float(np.linalg.norm(X.translation)) for X in model.jointPlacements)
    reach = 2.0 + arms + float(np.abs(state.q).max(initial=0.0)) + max(float(np.linalg.norm(f.placement.translation)) for f in model.frames)
    return _OPERATIONS * model.njoints * _ROUNDING * reach * max(1.0, float(np.abs(balance.sets.G).max(initial=0.0)))


def push_sets(pushes: object) -> tuple[PushSet, ...]:
    """The sets of pushes, of what a user gives.

    Raises:
        InputError: what is none.
    """
    if pushes is None:
        return ()
    if isinstance(pushes, PushSet):
        return (pushes,)
    if isinstance(pushes, Mapping):
        return tuple(PushSet(frame, corners) for frame, corners in pushes.items())
    check_kind("pushes", pushes, Sequence, "a rbd.robust.PushSet, some of them, or {frame: corners (k, 3) or (k, 6)}")
    for each in pushes:  # type: ignore[attr-defined]
        check_kind("pushes", each, PushSet, "rbd.robust.PushSet objects")
    return tuple(pushes)  # type: ignore[arg-type]


def with_least_friction(contacts: Sequence[Constraint], friction: float | Mapping[str, float] | None) -> list[Constraint]:
    """The contacts with the least coefficients of a set.

    Raises:
        InputError: a coefficient that is none.
        UnknownName: of a contact that is not there, or has no friction.
    """
    given = listed(contacts)
    if friction is None:
        return given
    able = [c.name for c in given if has_friction(c)]
    by_name = dict(friction) if isinstance(friction, Mapping) else dict.fromkeys(able, friction)
    for name, mu in by_name.items():
        check_known("friction", name, able)
        check_friction(mu, 4)
    return [c.with_friction(by_name[c.name]) if c.name in by_name else c for c in given]  # type: ignore[attr-defined]


def _joint_of(robot: object, link: str, what: str) -> int:
    joint = int(robot.site(link)[0])  # type: ignore[attr-defined]
    if joint == 0:
        raise InputError(f"{what} of {link!r:.80}: it is fixed to the world and loads nothing. Name a link that moves.")
    return joint


def _middle_of(robot: object, link: str) -> Array:
    """The centre of mass of a link and all fixed to it, in the axes of its frame from its origin, shape (3,) [m]."""
    joint, X_JF = robot.site(link)  # type: ignore[attr-defined]
    return np.asarray(X_JF.inverse().act(robot.model.inertias[joint].lever))  # type: ignore[attr-defined]


def masses_of(robot: object, mass: Masses) -> dict[int, tuple[str, float, float]]:
    """{joint: (link, least, most) [kg]}, of what a user gives.

    Raises:
        InputError: an interval that is reversed, a share that is none, a link that is named twice.
    """
    if mass is None:
        return {}
    model = robot.model  # type: ignore[attr-defined]
    if not isinstance(mass, Mapping):
        links = {f.parentJoint: f.name for f in reversed(model.frames) if f.type == pin.BODY and f.parentJoint}
        mass = {links.get(j, model.names[j]): mass for j in range(1, model.njoints) if model.inertias[j].mass > 0.0}
    found = dict[int, tuple[str, float, float]]()
    for link, value in mass.items():
        joint = _joint_of(robot, link, "mass")
        own = float(model.inertias[joint].mass)
        if np.ndim(value) == 0:
            share = check_number(f"mass of {link}", value, 0.0, 1.0, expected="a share from 0 to 1, as 0.05 for +-5 %, or (low, high) [kg]")
            low, high = own * (1.0 - share), own * (1.0 + share)
        else:
            given = as_array(f"mass of {link}", value)
            if given.shape != (2,) or not is_finite(given) or not 0.0 <= given[0] <= given[1] <= _LARGEST:
                raise InputError(
                    f"mass of {link!r:.80} is {value!r:.80}; expected (low, high) [kg], 0 <= low <= high, or a share of {own:.4g} kg "
                    "as 0.05 for +-5 %."
                )
            low, high = given.tolist()
        if joint in found:
            raise InputError(f"mass of {link!r:.80} and of {found[joint][0]!r:.80}: they are fixed to each other; give one of them.")
        found[joint] = link, low, high
    return found


def boxes_of(robot: object, com: Boxes) -> dict[int, tuple[str, Array]]:
    """{joint: (link, half-widths (3,) [m])}, of what a user gives.

    Raises:
        InputError: half-widths that are none, a link that is named twice.
    """
    found = dict[int, tuple[str, Array]]()
    check_kind("com", com, Mapping | None, "{link: half-width [m], or three of them in the link's axes}")
    for link, value in (com or {}).items():
        widths = np.full(3, float(as_array("com", value))) if np.ndim(value) == 0 else as_vector3(f"com of {link}", value)  # type: ignore[arg-type]
        if not is_finite(widths) or widths.min() < 0.0 or widths.max() > 100.0:
            raise InputError(f"com of {link!r:.80} is {value!r:.80}; expected half-widths of its box, from 0 to 100 m.")
        joint = _joint_of(robot, link, "com")
        if joint in found:
            raise InputError(f"com of {link!r:.80} and of {found[joint][0]!r:.80}: they are fixed to each other; give one of them.")
        found[joint] = link, widths
    return found
