"""Two robots, or a robot and an object, in one model: contacts between them are contacts between two bodies."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.constraints.constraint import renamed
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.constraints.forces.joint_springs import JointDamping, JointSpring
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.errors.inputs import check_kind, listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.data_pool import DataPool
from rbd.model.pickling import Recipe
from rbd.model.placement import rigid_placement
from rbd.model.state import State
from rbd.robots.rotors import file_damping, file_springs

Kind = TypeVar("Kind")


class RobotPair(CheckedModel):
    """Two robots in one model, side by side: joints, frames and motors of the first, then of the second.

    Made by `merge_robots`. Its vectors are those of the two concatenated: q = (q_1, q_2), v, a and tau likewise; the
    free-flyer of a floating second is in W, not in its `placement`. In addition to `CheckedModel`:

    Attributes:
        members: The two robots, as they were given.
        prefixes: Prefixes of the names of each.
        placement: Pose of the second's world in W, pin.SE3.

    Example:
        >>> pair = rbd.robots.merge_robots(rbd.load_robot("solo12"), rbd.testing.box(mass=2.0), names=("", "crate_"))
        >>> pair.nv, pair.nu, "crate_box" in pair.frames(), [part.shape for part in pair.split(np.zeros(pair.nv))]
        (24, 12, True, [(18,), (6,)])
    """

    def __init__(self, first: CheckedModel, second: CheckedModel, placement: pin.SE3, prefixes: tuple[str, str]) -> None:
        self.members = first, second
        self.prefixes = prefixes
        self.placement = placement
        # A floating base's q is its pose in W, so that there the placement belongs in q.
        self._mounted = pin.SE3.Identity() if second.bases else placement
        self._renamed = tuple(_prefixed(robot.model, prefix) for robot, prefix in zip(self.members, prefixes, strict=True))
        model = pin.appendModel(*self._renamed, 0, self._mounted)
        model.gravity.linear = first.gravity  # Pinocchio gives every joined model that of the Earth
        # It drops these two of both models: rotor inertias would be missing in M.
        model.armature = np.concatenate([robot.model.armature for robot in self.members])
        model.lowerVelocityLimit = np.concatenate([robot.model.lowerVelocityLimit for robot in self.members])
        passive = [p + n for robot, p in zip(self.members, prefixes, strict=True) for n in sorted(robot.passive)]
        super().__init__(model, passive=passive, name=f"{first.name} and {second.name}")
        self.sound = first.sound and second.sound
        both = zip(self.members, prefixes, strict=True)
        self._take_motors({prefix + name: motor for robot, prefix in both for name, motor in robot.motor_data.items()})

    def _recipe(self) -> Recipe:
        """The two robots."""
        return partial(RobotPair, *self.members, self.placement, self.prefixes)

    def _content(self) -> str:
        return repr(([robot.digest for robot in self.members], self.placement.homogeneous.tolist(), self.prefixes))

    def _is_as_made(self) -> bool:
        return super()._is_as_made() and all(robot._is_as_made() for robot in self.members)

    def _with_model(self, model: pin.Model, memo: dict[int, object] | None) -> RobotPair:
        members = self.members if memo is None else copy.deepcopy(self.members, memo)
        out = RobotPair(*members, self.placement, self.prefixes)
        if memo is None:
            out.model, out.pool = model, DataPool(model)
        return out

    def with_gravity(self, gravity: Sequence[float] | Array) -> RobotPair:
        """The pair in a world with another gravity, in which its members are too: see `CheckedModel.with_gravity`."""
        out = super().with_gravity(gravity)
        out.members = self.members[0].with_gravity(gravity), self.members[1].with_gravity(gravity)
        return out

    def neutral(self) -> Array:
        """The configuration with every joint at zero, the second's base at `placement`, shape (nq,)."""
        return self.q(*(pin.neutral(robot.model) for robot in self.members))

    def q(self, first: Array, second: Array) -> Array:
        """The configuration of both from one of each, shape (nq,).

        Args:
            first: Configuration of the first robot.
            second: Of the second, its floating bases as if its world were W: they are moved by `placement`.
        """
        one, other = self.members[0].check_q(first), self.members[1].check_q(second)
        for joint in self.members[1].bases:
            at = self.members[1].model.joints[joint].idx_q
            other[at : at + 7] = pin.SE3ToXYZQUAT(self.placement * pin.XYZQUATToSE3(other[at : at + 7]))
        return np.concatenate([one, other])

    def at(self, q: Array | None = None, v: Array | None = None) -> State:
        """The state at a configuration of both, the neutral one if not given, and a velocity of both."""
        return State(self, self.neutral() if q is None else q, v)

    def together(self, first: State, second: State) -> State:
        """The state of both from a state of each; that of the second is moved by `placement`.

        Raises:
            InputError: if one is not a state of its robot.
        """
        for state, robot in zip((first, second), self.members, strict=True):
            if not isinstance(state, State) or not robot.is_like(state.robot):
                raise InputError(f"together wants a State of {robot.name}, got {state!r:.80}: rbd.State(robot, q, v).")
        return State(self, self.q(first.q, second.q), np.concatenate([first.v, second.v]), t=first.t)

    def standing(self) -> State:
        """Both at rest, each in its standing posture; an object without a standing posture in its neutral one.

        Raises:
            ModelError: no standing posture is known for a robot with feet.
        """
        return self.together(*(_standing(robot) for robot in self.members))

    def split(self, vector: Array) -> tuple[Array, Array]:
        """A vector of both, of the size of q, v or tau, as (the first's part, the second's).

        Raises:
            InputError: if it has none of these sizes.
        """
        one = self.members[0]
        for size, first in ((self.nq, one.nq), (self.nv, one.nv), (self.nu, one.nu)):
            if np.shape(vector) == (size,):
                given = np.asarray(vector)
                return given[:first], given[first:]
        raise InputError(
            f"split wants q ({self.nq},), v or a ({self.nv},), or tau ({self.nu},) of {self.name}; got {vector!r:.80}."
        )

    def contacts(self, first: Iterable[Kind] = (), second: Iterable[Kind] = ()) -> list[Kind]:
        """Contacts of the separate robots, renamed for this model; grounds of the second move with `placement`.

        Raises:
            InputError: if an entry is not a contact of `rbd`, or has an anchor or a motion of its ground that would have to
                be moved.
        """
        moved = None if self.placement.isIdentity(0.0) else self.placement
        both = (first, self.prefixes[0], None), (second, self.prefixes[1], moved)
        return [
            renamed(c, prefix, placement)
            for contacts, prefix, placement in both
            for c in listed_items("contacts", contacts, "a list, e.g. robot.soles()")
        ]

    def feet(self, friction: float | None = 0.7, *, facets: int = 4) -> list[SurfaceContact | PointContact]:
        """Feet of both, as `Robot.feet`; an object has none.

        Raises:
            ModelError: neither has known feet.
        """
        feet: list[list[SurfaceContact | PointContact]] = [_feet(robot, friction, facets) for robot in self.members]
        if not any(feet):
            raise ModelError(f"no feet are known of {self.name}. Give contacts of your own: pair.contacts(first, second).")
        return self.contacts(*feet)

    def joint_damping(self) -> JointDamping:
        """The viscous damping of both files, as `Robot.joint_damping`."""
        return file_damping(self)

    def joint_springs(self) -> list[JointSpring]:
        """The springs of both files, as `Robot.joint_springs`, at the pair's joints."""
        return file_springs(self.springs)

    @property
    def springs(self) -> dict[str, tuple[float, float]]:
        """As `Robot.springs`, of both."""
        both = zip(self.members, self.prefixes, strict=True)
        return {p + name: spring for robot, p in both for name, spring in getattr(robot, "springs", {}).items()}

    @lazy
    def visual_model(self) -> pin.GeometryModel:
        """Shapes of both to draw."""
        return self._geometry("visual_model")

    @lazy
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes of both."""
        return self._geometry("collision_model")

    @property
    def collision_stand_ins(self) -> frozenset[str]:
        """Names in `collision_model` of the boxes that replace meshes that cannot be loaded."""
        both = zip(self.prefixes, self.members, strict=True)
        return frozenset(prefix + name for prefix, robot in both for name in getattr(robot, "collision_stand_ins", ()))

    def _geometry(self, kind: str) -> pin.GeometryModel:
        shapes = [getattr(robot, kind, pin.GeometryModel()).copy() for robot in self.members]
        for prefix, model in zip(self.prefixes, shapes, strict=True):
            for shape in model.geometryObjects:
                shape.name = prefix + shape.name
        return pin.appendModel(*self._renamed, *shapes, 0, self._mounted)[1]


def merge_robots(
    first: CheckedModel,
    second: CheckedModel,
    *,
    placement: pin.SE3 | Array | None = None,
    names: Sequence[str] = ("a_", "b_"),
) -> RobotPair:
    """Two robots, or a robot and an object that it holds, merged into one model.

    Each keeps its joints, motors, passive joints and floating base; M is block-diagonal. They interact by contacts with
    `on=rbd.Body(frame)`, a frame of the other. A pair can be combined with a third. Loops and wheels of their files are left
    out, with a warning: they name frames of one robot.

    Args:
        first: A robot, or an object with a checked model.
        second: Another, or the same once more.
        placement: Pose of the second's world in the first's, pin.SE3 or a 4 x 4 matrix: moves a fixed base for good,
            and a floating one in `RobotPair.q`, `together` and `standing`. By default both worlds are one.
        names: Prefixes of the names of joints and frames of each, to distinguish the two.

    Raises:
        InputError: not a robot, names that remain equal, or two different gravities.

    Example:
        >>> solo, crate = rbd.load_robot("solo12"), rbd.testing.box(mass=1.0)
        >>> pair = rbd.robots.merge_robots(solo, crate, names=("", "crate_"))
        >>> back = rbd.Body("base_link")
        >>> carried = rbd.SurfaceContact("carried", "crate_box", half_lengths=(0.05, 0.05), on=back, friction=0.6)
        >>> state = pair.together(solo.standing(), rbd.State(crate, [0, 0, 0.4, 0, 0, 0, 1]))
        >>> rbd.hold(state, [*pair.feet(), carried]).forces["carried"][:3].round(3)
        array([ 0.  , 0.  ,  9.81])
    """
    for robot in (first, second):
        check_kind("a robot of merge_robots", robot, CheckedModel, "two robots: rbd.load_robot(name)")
    if not np.array_equal(first.gravity, second.gravity):
        raise InputError(
            f"{first.name} has gravity {first.gravity.tolist()}, {second.name} {second.gravity.tolist()}; one world has one."
        )
    prefixes = _checked_names(names)
    for what, one, other in (("joint", first.joints, second.joints), ("frame", first.frames(), second.frames())):
        both = {prefixes[0] + n for n in one if n != "universe"} & {prefixes[1] + n for n in other if n != "universe"}
        if both:
            raise InputError(f"both would have a {what} {min(both)!r:.80}; give names= that distinguish them, as ('a_', 'b_').")
    left = [c.name for robot in (first, second) for c in (*robot.loops(), *robot.wheels(), *robot.drives())]
    if left:
        warnings.warn(
            f"the pair has no loops, wheels or drives of its own: {', '.join(map(repr, left))[:80]} name frames or joints "
            "without prefixes. Make them again with the pair's names.",
            ModelWarning,
            stacklevel=2,
        )
    return RobotPair(first, second, rigid_placement("placement of the second robot", placement), prefixes)


def _checked_names(names: Sequence[str]) -> tuple[str, str]:
    given = tuple(names) if isinstance(names, list | tuple) else ()
    if len(given) != 2 or not all(isinstance(n, str) and len(n) <= 100 for n in given):
        raise InputError(f"names is {names!r:.80}; expected two prefixes of the names, as ('a_', 'b_').")
    return given[0], given[1]


def _prefixed(model: pin.Model, prefix: str) -> pin.Model:
    """The same model with the names of joints and frames changed; "universe" is unchanged."""
    out = model.copy()
    for i in range(1, out.njoints):
        out.names[i] = prefix + out.names[i]
    for i in range(1, out.nframes):
        out.frames[i].name = prefix + out.frames[i].name
    return out


def _standing(robot: Any) -> State:
    if hasattr(robot, "standing") and (not hasattr(robot, "source") or robot.source.feet or robot.postures):
        return robot.standing()
    return State(robot, pin.neutral(robot.model))


def _feet(robot: Any, friction: float | None, facets: int) -> list[SurfaceContact | PointContact]:
    if isinstance(robot, RobotPair):
        return robot.contacts(*(_feet(member, friction, facets) for member in robot.members))
    return robot.feet(friction, facets=facets) if hasattr(robot, "source") and robot.source.feet else []
