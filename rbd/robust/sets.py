"""What is uncertain, as users give it: polytopes of pushes, least friction, intervals of masses, boxes of centres of mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_vector3, check_number, check_whole, is_finite
from rbd.constraints.constraint import Constraint, has_friction, listed
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, check_known
from rbd.model.checked_model import CheckedModel
from rbd.problem.cones import check_friction
from rbd.records import joined, vector
from rbd.statics.force_balance import place

Masses = float | Mapping[str, float | Sequence[float]] | None
Boxes = Mapping[str, float | Sequence[float]] | None
_LEAST_FRICTION = 1e-6
"""Of sets with friction; and one over the largest."""
_LARGEST = 1e9
"""Of a push [N, N m] or a mass [kg]."""


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
                f"pushes at {self.frame!r:.80} have shape {corners.shape}; expected corners (k, 3) of forces, or (k, 6) "
                "of forces and moments, at least one."
            )
        if not is_finite(corners) or np.abs(corners).max() > _LARGEST:
            largest = np.abs(corners).max()
            raise InputError(f"pushes at {self.frame!r:.80} reach {largest:.3g}; expected up to {_LARGEST:g} N, N m.")
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
                f"a box of pushes from {low!r:.80} to {high!r:.80}; expected three or six numbers each, none of the "
                "first above that of the second."
            )
        ends = [sorted({a, b}) for a, b in zip(least.tolist(), most.tolist(), strict=True)]
        return cls(frame, np.array(list(product(*ends))), offset)

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
        joints: {joint: its coordinate [rad, m]}, of a box of poses.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), friction=0.5)
        >>> state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        >>> print(rbd.robust.hold(state, [sole], pushes={"box": [(60, 0, 0)]}, mass={"box": 0.1}).members[0].mass)
        {'box': 9.0}
    """

    push: Mapping[str, Array]
    mass: Mapping[str, float]
    com: Mapping[str, Array]
    joints: Mapping[str, float]

    def __str__(self) -> str:
        moments = {frame: f" and {vector(f[3:], 4)} N m" if len(f) > 3 else "" for frame, f in self.push.items()}
        words = [f"a push of {vector(f[:3], 4)} N{moments[frame]} at {frame}" for frame, f in self.push.items()]
        words += [f"{link} of {m:.6g} kg" for link, m in self.mass.items()]
        words += [f"the centre of mass of {link} moved by {vector(c, 4)} m" for link, c in self.com.items()]
        words += [f"{joint} at {q:.6g}" for joint, q in self.joints.items()]
        return joined(words, 3) or "the robot as it is"


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


def with_least_friction(contacts: Sequence[Constraint], friction: float | Mapping[str, float] | None) -> Sequence[Constraint]:
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
        if not (mu == 0.0 or _LEAST_FRICTION <= mu <= 1.0 / _LEAST_FRICTION):
            raise InputError(f"friction of {name!r:.80} is {mu!r:.40}; expected 0, or from {_LEAST_FRICTION:g} on.")
    rough = [has_friction(c) and c.name in by_name for c in given]
    return [c.with_friction(by_name[c.name]) if one else c for c, one in zip(given, rough, strict=True)]  # type: ignore[attr-defined]


def _joint_of(robot: CheckedModel, link: str, what: str) -> int:
    joint = int(robot.site(link)[0])
    if joint == 0:
        raise InputError(f"{what} of {link!r:.80}: it is fixed to the world and loads nothing. Name a link that moves.")
    return joint


def _twice(what: str, link: str, other: str) -> str:
    return f"{what} of {link!r:.80} and of {other!r:.80}: they are fixed to each other; give one of them."


def middle_of(robot: CheckedModel, link: str) -> Array:
    """The centre of mass of a link and all fixed to it, in the axes of its frame from its origin, shape (3,) [m]."""
    joint, X_JF = robot.site(link)
    return np.asarray(X_JF.inverse().act(robot.model.inertias[joint].lever))


def masses_of(robot: CheckedModel, mass: Masses) -> dict[int, tuple[str, float, float]]:
    """{joint: (link, least, most) [kg]}, of what a user gives.

    Raises:
        InputError: an interval that is reversed, a share that is none, a link that is named twice.
    """
    if mass is None:
        return {}
    model = robot.model
    if not isinstance(mass, Mapping):
        links = {f.parentJoint: f.name for f in reversed(model.frames) if f.type == pin.BODY and f.parentJoint}
        mass = {links.get(j, model.names[j]): mass for j in range(1, model.njoints) if model.inertias[j].mass > 0.0}
    found = dict[int, tuple[str, float, float]]()
    for link, value in mass.items():
        joint = _joint_of(robot, link, "mass")
        own = float(model.inertias[joint].mass)
        if isinstance(value, float | int | np.number):
            expected = "a share from 0 to 1, as 0.05 for +-5 %, or (low, high) [kg]"
            share = check_number(f"mass of {link}", value, 0.0, 1.0, expected=expected)
            low, high = own * (1.0 - share), own * (1.0 + share)
        else:
            given = as_array(f"mass of {link}", value)
            if given.shape != (2,) or not is_finite(given) or not 0.0 <= given[0] <= given[1] <= _LARGEST:
                raise InputError(
                    f"mass of {link!r:.80} is {value!r:.80}; expected (low, high) [kg], 0 <= low <= high, or a share of "
                    f"{own:.4g} kg, as 0.05 for +-5 %."
                )
            low, high = given.tolist()
        if joint in found:
            raise InputError(_twice("mass", link, found[joint][0]))
        found[joint] = link, low, high
    return found


def boxes_of(robot: CheckedModel, com: Boxes) -> dict[int, tuple[str, Array]]:
    """{joint: (link, half-widths (3,) [m])}, of what a user gives.

    Raises:
        InputError: half-widths that are none, a link that is named twice.
    """
    found = dict[int, tuple[str, Array]]()
    check_kind("com", com, Mapping | None, "{link: half-width [m], or three of them in the link's axes}")
    for link, value in (com or {}).items():
        widths = (
            np.full(3, float(as_array("com", value)))
            if isinstance(value, float | int | np.number)
            else as_vector3(f"com of {link}", value)
        )
        if not is_finite(widths) or widths.min() < 0.0 or widths.max() > 100.0:
            raise InputError(f"com of {link!r:.80} is {value!r:.80}; expected half-widths of its box, from 0 to 100 m.")
        joint = _joint_of(robot, link, "com")
        if joint in found:
            raise InputError(_twice("com", link, found[joint][0]))
        found[joint] = link, widths
    return found
