"""Targets of a pose: contacts, frames and the centre of mass; their errors, and a certificate that targets are out of reach."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, as_float, as_vector3, check_finite
from rbd.constraints.constraint import made, member
from rbd.constraints.contact import Contact
from rbd.constraints.surface import On, shortest_turn, standing_plane
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import FrameNotFound, InputError, nearest
from rbd.errors.inputs import check_different
from rbd.mechanism.reach import links_between, stroke_of
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.state import State
from rbd.problem.ground import FLOOR, Ground, unit_normal
from rbd.robots.robot import Robot

CENTRE_OF_MASS = "centre of mass"
"""Name of the centre of mass among the targets."""

Three: TypeAlias = Sequence[float] | Array
Where: TypeAlias = Three | tuple[Three, Three] | pin.SE3 | Ground | float | None
"""Place of a target; see `find_pose`."""


@dataclass(frozen=True)
class Miss:
    """Error of a target, recomputed from the model.

    Attributes:
        distance: From its point or its plane [m].
        angle: Between axes, or between z and the normal [rad]; zero where no direction is given.
    """

    distance: float
    angle: float

    def __str__(self) -> str:
        turned = f", {self.angle:.3g} rad" if self.angle > 0.0 else ""
        return f"{self.distance:.6g} m{turned}"

    def within(self, tolerance: float) -> bool:
        """Whether both are within a tolerance [m, rad]."""
        return self.distance <= tolerance and self.angle <= tolerance


@dataclass(frozen=True, eq=False)
class Target:
    """Target of a frame P of the robot: a point or a plane, and optionally axes or the direction of its z.

    Attributes:
        name: Name of the contact or the frame.
        frame: The robot's frame F.
        X_FP: Pose of P in F.
        point: Target of P's origin, in W, shape (3,) [m]; None if free.
        plane: Plane of P's origin; None if free.
        normal: Target direction of P's z, in W, shape (3,); None if free.
        axes: Target R_WP, shape (3, 3); None if free.
    """

    name: str
    frame: str
    X_FP: pin.SE3
    point: Array | None = None
    plane: Ground | None = None
    normal: Array | None = None
    axes: Array | None = None

    @property
    def angles(self) -> int:
        """Number of its errors that are angles, the last ones."""
        return 3 if self.axes is not None else 2 if self.normal is not None else 0

    def errors(self, state: State) -> tuple[Array, Array]:
        """(e, J): position error [m], then angle [rad]; J^T e is the exact gradient of 1/2 |e|^2."""
        X_WP, J, _, _ = state.moving(self.frame, self.X_FP, pin.LOCAL_WORLD_ALIGNED)
        e, rows = [], []
        if self.point is not None:
            e.append(X_WP.translation - self.point)
            rows.append(J[:3])
        if self.plane is not None:
            e.append(self.plane.distances(X_WP.translation[None]))
            rows.append(np.asarray(self.plane.normal)[None] @ J[:3])
        if self.axes is not None:
            e.append(pin.log3(X_WP.rotation @ self.axes.T))
            rows.append(J[3:])
        elif self.normal is not None:
            T = np.linalg.svd(self.normal[None])[2][1:]  # two directions across the normal
            e.append(-T @ shortest_turn(X_WP.rotation[:, 2], self.normal, T[0]))
            rows.append(T @ J[3:])
        return np.concatenate(e), np.concatenate(rows)

    def miss(self, X_WP: pin.SE3) -> Miss:
        """Error at a pose of P."""
        distance = angle = 0.0
        if self.point is not None:
            distance = float(np.linalg.norm(X_WP.translation - self.point))
        elif self.plane is not None:
            distance = abs(float(self.plane.distances(X_WP.translation[None])[0]))
        if self.axes is not None:
            angle = float(np.linalg.norm(pin.log3(self.axes.T @ X_WP.rotation)))
        elif self.normal is not None:
            angle = float(np.linalg.norm(shortest_turn(X_WP.rotation[:, 2], self.normal)))
        return Miss(distance, angle)


@dataclass(frozen=True, eq=False)
class CentreOfMass:
    """Target of the centre of mass.

    Attributes:
        place: (x, y) or (x, y, z) in W [m].
    """

    place: Array
    name: str = CENTRE_OF_MASS
    angles: int = 0

    def errors(self, state: State) -> tuple[Array, Array]:
        """(e, J), lengths [m]."""
        n = len(self.place)
        A_g, _, mass = state.centroidal()
        return state.com[:n] - self.place, A_g[:n] / mass


def misses(robot: CheckedModel, q: Array, targets: Sequence[Target], com: CentreOfMass | None) -> dict[str, Miss]:
    """{target: error} at a configuration, by kinematics that are independent of the search."""
    model = robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    out = {}
    for target in targets:
        joint, X_JF = robot.site(target.frame)
        out[target.name] = target.miss(data.oMi[joint] * X_JF * target.X_FP)
    if com is not None:
        at = np.asarray(pin.centerOfMass(model, model.createData(), q))[: len(com.place)]
        out[com.name] = Miss(float(np.linalg.norm(at - com.place)), 0.0)
    return out


def read_targets(robot: CheckedModel, targets: object, ground: On, posture: State) -> list[Target]:
    """The targets of `find_pose`, checked.

    Args:
        robot: The robot.
        targets: As of `find_pose`.
        ground: Under the feet.
        posture: Where feet on terrain are that have no place of their own.

    Raises:
        InputError: not a mapping, an empty one, or invalid places.
        FrameNotFound: no foot and no frame of this name; with the nearest of both.
        DuplicateName: two targets with the same name.
    """
    known: Iterable[Contact] = robot.feet(None, on=ground) if isinstance(robot, Robot) and robot.source.feet else ()
    feet = {foot.name: foot for foot in known}
    if targets is None and feet:
        targets = dict.fromkeys(feet)
    if not isinstance(targets, Mapping) or not targets:
        raise InputError(
            f"targets is {targets!r:.80}; expected {{foot, contact or frame: place}}, "
            "e.g. {'left_sole': (0, 0.1, 0), 'right_sole': (0, -0.1, 0)}."
        )
    out: list[Target] = []
    for what, where in targets.items():
        if isinstance(what, str):
            found = _of_contact(feet[what], where, posture) if what in feet else _of_frame(robot, feet, what, where)
        elif member(what, "corners") is None or member(what, "placement") is None:  # of a contact
            raise InputError(f"{what!r:.80} is not a target; expected the name of a foot or a frame, or a contact.")
        else:
            found = _of_contact(made(what), where, posture)  # type: ignore[arg-type]
        robot.site(found.frame)
        out.append(found)
    check_different([target.name for target in out], "targets")
    return out


def read_com(com: object) -> CentreOfMass | None:
    """The target of the centre of mass, checked.

    Raises:
        InputError: not two or three finite numbers.
    """
    if com is None:
        return None
    return CentreOfMass(_near("com", as_finite("com", com, (2,), (3,), meaning=": (x, y) or (x, y, z) in W [m]")))


def _of_contact(contact: Contact, where: object, posture: State) -> Target:
    """A contact on a plane, or its centre at a point with a direction, or at a pose; on terrain where it is in a posture."""
    X_FP, name, flat = _patch(contact), contact.name, len(contact.corners) > 1
    if where is None and isinstance(contact.on, Terrain):
        x, y, _ = (posture.frame(contact.frame).X_WF * X_FP).translation.tolist()
        where = np.array(contact.on.ground_at(x, y).point)
    height = as_float(where)
    place: Any = where.translation if isinstance(where, pin.SE3) else where
    plane = FLOOR if isinstance(where, Ground) else standing_plane(name, contact.on, place)
    if where is None or isinstance(where, Ground) or not math.isnan(height):
        if isinstance(where, Ground):
            plane = _known(name, where)
        elif where is not None:
            plane = Ground(point=_near(f"height of {name!r:.80}", np.array([0.0, 0.0, height])))
        if contact.ball is not None:  # its centre is above the plane
            above = np.asarray(plane.point) + contact.ball.radius * np.asarray(plane.normal)
            plane = replace(plane, point=above)
        return Target(name, contact.frame, X_FP, plane=plane, normal=np.asarray(plane.normal) if flat else None)
    if isinstance(where, pin.SE3) and not flat:
        raise InputError(f"{name!r:.80} is a point contact, which has no axes; give its place as (x, y, z).")
    point, given, axes = _place(name, where)
    if given is not None and not flat:
        raise InputError(f"{name!r:.80} is a point contact, which has no direction; give its place as (x, y, z).")
    if contact.ball is not None:
        point = point + contact.ball.radius * np.asarray(plane.normal)
    z = None if axes is not None or not flat else np.asarray(plane.normal) if given is None else given
    return Target(name, contact.frame, X_FP, point, normal=z, axes=axes)


def _patch(contact: Contact) -> pin.SE3:
    """X_FP; for a point contact its origin is the point, of a round foot the centre of the ball."""
    if contact.ball is not None:
        return pin.SE3(np.eye(3), np.array(contact.ball.centre))
    if len(contact.corners) > 1:
        return contact.placement
    return contact.placement * pin.SE3(np.eye(3), np.array(contact.corners[0]))


def _of_frame(robot: CheckedModel, feet: Mapping[str, Contact], frame: str, where: object) -> Target:
    if frame not in robot.frames():
        names = [*feet, *robot.frames()]
        raise FrameNotFound(f"no foot and no frame {frame!r:.80} in {robot.name}; {nearest(frame, names)}. See robot.frames().")
    if isinstance(where, Ground):
        return Target(frame, frame, pin.SE3.Identity(), plane=_known(frame, where))
    point, normal, axes = _place(frame, where)
    return Target(frame, frame, pin.SE3.Identity(), point, normal=normal, axes=axes)


def _known(name: str, ground: Ground) -> Ground:
    if ground.point is None:
        raise InputError(f"the ground for {name!r:.80} has no point, so its plane is not known; give rbd.Ground(point=...).")
    _near(f"point of the ground for {name!r:.80}", np.asarray(ground.point))
    return ground


def _place(name: str, where: object) -> tuple[Array, Array | None, Array | None]:
    """(point, direction of z or None, axes or None)."""
    if isinstance(where, pin.SE3):
        R = np.array(where.rotation)
        check_finite(f"target of {name!r:.80}", where.homogeneous)
        if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
            raise InputError(f"target of {name!r:.80}: its rotation is invalid: R^T R is not 1 to 1e-6, or R reflects.")
        return _near(f"target of {name!r:.80}", np.array(where.translation)), None, _orthonormal(R)
    if isinstance(where, tuple | list) and len(where) == 2 and all(np.iterable(each) for each in where):
        normal = unit_normal(f"direction for {name!r:.80}", where[1])
        return _near(f"target of {name!r:.80}", as_vector3(f"target of {name!r:.80}", where[0])), normal, None
    try:
        point = as_vector3(f"target of {name!r:.80}", where)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(
            f"{error} A place is (x, y, z), ((x, y, z), direction of its z), pinocchio.SE3 or rbd.Ground(point=...)."
        ) from None
    return _near(f"target of {name!r:.80}", point), None, None


def _near(what: str, point: Array) -> Array:
    if not (np.abs(point) <= FARTHEST).all():
        raise InputError(f"{what} is {point.tolist()!r:.80}; expected at most {FARTHEST:g} m from the origin.")
    return point


def _orthonormal(R: Array) -> Array:
    """The nearest rotation to a matrix that is one to 1e-6."""
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


@dataclass(frozen=True)
class OutOfReach:
    """Two points farther apart than the links between them are long: no pose reaches both.

    Attributes:
        names: The targets; a single one for a robot with a fixed base.
        apart: Their distance [m].
        longest: Length of the stretched links between them [m].
    """

    names: tuple[str, ...]
    apart: float
    longest: float

    @property
    def short(self) -> float:
        """How much longer the links would have to be [m]."""
        return self.apart - self.longest

    def __str__(self) -> str:
        who = " and ".join(f"{name!r:.60}" for name in self.names)
        where = "apart" if len(self.names) > 1 else "from the fixed base"
        return (
            f"{who} must be {self.apart:.6g} m {where}, and the links between have a length of {self.longest:.6g} m, "
            f"{self.short:.6g} m less"
        )


def out_of_reach(robot: CheckedModel, targets: Sequence[Target]) -> OutOfReach | None:
    """A certificate that no pose satisfies the targets: the pair with the largest gap; None if there is no such pair."""
    gaps = (gap for gap in _gaps(robot, targets) if gap.short > 1e-9 * max(1.0, gap.apart))
    return max(gaps, key=lambda gap: gap.short, default=None)


def _gaps(robot: CheckedModel, targets: Sequence[Target]) -> Iterator[OutOfReach]:
    """Each target with the fixed base, and with each other one of its robot: their distance, and how far the links reach."""
    ends = [(t.name, *_end(robot, t), t.point) for t in targets if t.point is not None]
    for i, (name, joint, offset, point) in enumerate(ends):
        chain = _chain(robot, joint)
        if joint and robot.model.joints[chain[0]].shortname() != "JointModelFreeFlyer":
            origin = np.array(robot.model.jointPlacements[chain[0]].translation)
            longest = _length(robot, chain[1:]) + stroke_of(robot, chain[0]) + float(np.linalg.norm(offset))
            yield OutOfReach((name,), float(np.linalg.norm(point - origin)), longest)
        for other, joint2, offset2, point2 in ends[:i]:
            chain2 = _chain(robot, joint2)
            if joint != joint2 and not set(chain) & set(chain2):
                continue  # two robots
            links, stroke = links_between(robot, joint, offset, joint2, offset2)
            longest = stroke + sum(float(np.linalg.norm(w)) for w in links)
            yield OutOfReach((other, name), float(np.linalg.norm(point - point2)), longest)


def _end(robot: CheckedModel, target: Target) -> tuple[int, Array]:
    joint, X_JF = robot.site(target.frame)
    return joint, np.asarray((X_JF * target.X_FP).translation)


def _chain(robot: CheckedModel, joint: int) -> list[int]:
    """The joints from the root of a joint's tree to itself."""
    return list(robot.model.supports[joint])[1:]


def _length(robot: CheckedModel, joints: Iterable[int]) -> float:
    """Length of joints, each with the link before it [m]."""
    return sum(float(np.linalg.norm(robot.model.jointPlacements[j].translation)) + stroke_of(robot, j) for j in joints)
