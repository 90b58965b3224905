"""Springs, dampers and bushings between two frames, or between a frame and the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.forces.coordinates import (
    Anchor,
    Angle,
    Coordinates,
    Distance,
    Offset,
    Pair,
    Pose,
    Spin,
    Vector,
    place_on,
)
from rbd.constraints.forces.element import BetweenPlaces, ElementPicture
from rbd.constraints.forces.element_numbers import (
    damping_matrix,
    damping_of,
    kept_as_data,
    number,
    six,
    stiffness_matrix,
    stiffness_of,
)
from rbd.constraints.surface import unit_direction
from rbd.errors import InputError
from rbd.model.checked_model import FARTHEST
from rbd.model.state import State, checked


class _Line(BetweenPlaces):
    """An element along a line, or about an axis."""

    frame: str
    to: Anchor
    axis: Array | None
    offset: Offset
    to_offset: Offset
    _kind = ""

    def _settled(self) -> str:
        """Check where it acts, and give it a name; what it is called in messages."""
        kind = self._kind if self.axis is None else f"torsion {self._kind}"
        what = self._settle(kind, self.to, self.offset, self.to_offset)
        if self.axis is not None:
            object.__setattr__(self, "axis", unit_direction(f"axis of {what}", self.axis))
        return what

    def picture(self, state: State) -> ElementPicture:
        """Its ends, axis and force at a state, for drawings."""
        pair, _, F = self._at(state)
        if self.axis is not None:
            return ElementPicture(f"torsion {self._kind}", pair.points, pair.R @ self.axis, float(F[0]))
        if len(F) == 3:  # a spring of rest length zero always pulls
            return ElementPicture(self._kind, pair.points, None, -float(np.linalg.norm(F)))
        return ElementPicture(self._kind, pair.points, None, float(F[0]))


@kept_as_data
@dataclass(frozen=True, eq=False)
class Spring(_Line):
    """A spring: along the line between two points, or about an axis. It goes where `external` goes.

    Along a line, with L the distance of the points, it pushes them apart with F = preload - stiffness (L - rest), so it pulls
    where F < 0. About an axis, `frame` gets the moment F = preload - stiffness (angle - rest) and `to` the opposite one; the
    angle is that of the axes of `frame` about the axis, from those of `to` (of W for the ground), and within 170 degrees of
    `rest`: frames do not count turns, `rbd.JointSpring` in a revolute joint does. Masses and inner damping are neglected.

    Args:
        frame: Frame of the robot.
        to: Another frame, or a point of the ground (3,) [m].
        stiffness: [N/m, N m/rad]; a negative one is taken with a warning.
        rest: Length or angle at which the force is the preload [m, rad]; to be given along a line, 0 about an axis.
        preload: The force there [N, N m].
        offset: Of the point from the frame's origin, in the frame's axes, (3,) [m]; or a pose, `pin.SE3`.
        to_offset: Likewise at `to`, if that is a frame.
        axis: Of a torsional spring, in the axes of `to`, shape (3,); None: along the line.
        name: By default made of where it acts.

    Raises:
        InputError: numbers that are not finite, no frame's name, an axis of zero, no rest length. At a state: a zero length,
            unless rest and preload are zero; an angle beyond 170 degrees.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> spring = rbd.Spring("box", to=(0, 0, 2), stiffness=1000.0, rest=1.0)
        >>> state = rbd.State(box, [0, 0, 0.9019, 0, 0, 0, 1])  # it hangs 98.1 N / 1000 N/m lower
        >>> spring.force(state), float(abs(rbd.solve(state, [], external=spring).a).max()) < 1e-12
        (array([-98.1]), True)
    """

    frame: str
    to: Anchor
    stiffness: float = field(kw_only=True)
    rest: float | None = field(default=None, kw_only=True)
    preload: float = field(default=0.0, kw_only=True)
    offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    to_offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    axis: Array | None = field(default=None, kw_only=True)
    name: str = field(default=None, kw_only=True)  # type: ignore[assignment]  # made in __post_init__

    parameters = ("stiffness", "rest", "preload")
    _kind = "spring"

    def __post_init__(self) -> None:
        what = self._settled()
        if self.rest is None and self.axis is None:
            raise InputError(f"{what} has no rest length; give rest=..., or rest=0 if it is relaxed at zero length.")
        rest = number(f"rest of {what}", 0.0 if self.rest is None else self.rest)
        if self.axis is None and rest < 0.0:
            raise InputError(
                f"rest of {what} is {rest:g}; expected a length from 0. A pull at zero length is a negative preload."
            )
        if not abs(rest) <= FARTHEST:
            raise InputError(f"rest of {what} is {rest:g}; expected at most {FARTHEST:g}.")
        preload, stiffness = number(f"preload of {what}", self.preload), stiffness_of(what, self.stiffness)
        self.__dict__.update(rest=rest, preload=preload, stiffness=stiffness)

    def _coordinates(self, pair: Pair) -> Coordinates:
        what = repr(self.name)[:82]
        assert self.rest is not None
        if self.axis is not None:
            return Angle(pair, self.axis, self.rest, what)
        if self.rest == 0.0 and self.preload == 0.0:
            return Vector(pair)
        return Distance(pair, what)

    def _law(self, m: int) -> tuple[Array, Array, Array]:
        return self.stiffness * np.eye(m), np.zeros((m, m)), np.full(m, self.preload)

    def _stretch(self, x: Array) -> Array:
        return x - self.rest

    def _by_parameter(self, parameter: str, x: Array, rate: Array) -> Array:
        if parameter == "stiffness":
            return -self._stretch(x)
        if len(x) == 3:
            length = float(np.linalg.norm(x))
            if not length > 0.0:
                raise InputError(f"{self.name!r:.80} has zero length, where its force has no derivative by its {parameter}.")
            x = x / length
        else:
            x = np.ones(1)
        return self.stiffness * x if parameter == "rest" else x

    def length(self, state: State) -> float:
        """The distance of its ends [m], or the angle about its axis [rad]."""
        pair, found, _ = self._at(state)
        return float(found.x[0]) if len(found.x) == 1 else float(np.linalg.norm(pair.points[1] - pair.points[0]))


@kept_as_data
@dataclass(frozen=True, eq=False)
class Damper(_Line):
    """A viscous damper: along the line between two points, or about an axis. It goes where `external` goes.

    Along a line of length L it pushes the points apart with F = -damping dL/dt. About an axis, fixed in `to` (in W for the
    ground), `frame` gets the moment F = -damping times its angular velocity about the axis, relative to `to`.

    Args:
        frame: Frame of the robot.
        to: Another frame, or a point of the ground (3,) [m].
        damping: [N s/m, N m s/rad], from 0.
        offset: Of the point from the frame's origin, in the frame's axes, (3,) [m]; or a pose, `pin.SE3`.
        to_offset: Likewise at `to`, if that is a frame.
        axis: Of a torsional damper, in the axes of `to`, shape (3,); None: along the line.
        name: By default made of where it acts.

    Raises:
        InputError: negative damping, numbers that are not finite, no frame's name, an axis of zero. At a state: a zero
            length, where the line has no direction.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> damper = rbd.Damper("box", to=(0, 0, 2), damping=50.0)
        >>> falling = rbd.State(box, [0, 0, 1, 0, 0, 0, 1], [0, 0, -0.2, 0, 0, 0])  # away from the point
        >>> damper.force(falling), round(damper.dissipation(falling), 12)
        (array([-10.]), 2.0)
    """

    frame: str
    to: Anchor
    damping: float = field(kw_only=True)
    offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    to_offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    axis: Array | None = field(default=None, kw_only=True)
    name: str = field(default=None, kw_only=True)  # type: ignore[assignment]  # made in __post_init__

    parameters = ("damping",)
    _kind = "damper"

    def __post_init__(self) -> None:
        object.__setattr__(self, "damping", damping_of(self._settled(), self.damping))

    def _coordinates(self, pair: Pair) -> Coordinates:
        return Distance(pair, repr(self.name)[:82]) if self.axis is None else Spin(pair, self.axis)

    def _law(self, m: int) -> tuple[Array, Array, Array]:
        return np.zeros((m, m)), self.damping * np.eye(m), np.zeros(m)

    def _by_parameter(self, parameter: str, x: Array, rate: Array) -> Array:
        return -rate


@kept_as_data
@dataclass(frozen=True, eq=False)
class Bushing(BetweenPlaces):
    """Six springs and dampers between two frames, or a frame and the ground, relaxed where these coincide.

    With R the axes at `to` and d from there to the frame's point, its coordinates are x = (R^T d, log(R^T R_frame)): three
    displacements in the axes of `to`, and the rotation vector. The force conjugate to x is F = preload - K x - C x_dot. It is
    exactly minus the gradient of the energy 1/2 x^T K x - preload^T x; in translation it acts at the frame's point. For one
    rotation about a principal axis of K its moment is -k times the angle, at any angle up to 170 degrees. One whose stiffness,
    damping and preload against rotation are all zero is a ball mount: it takes any rotation.

    Args:
        frame: Frame of the robot.
        to: Another frame; a point of the ground (3,) [m], then with W's axes; or a pose on the ground, `pin.SE3`.
        stiffness: K: six numbers (x, y, z, about x, y, z) [N/m, N m/rad], or a symmetric matrix (6, 6). Negative
            eigenvalues are taken with a warning.
        damping: C: six numbers [N s/m, N m s/rad], or a symmetric positive semidefinite matrix (6, 6); 0 for none.
        preload: F at x = 0, six numbers [N, N m].
        offset: Of the point from the frame's origin, in the frame's axes, (3,) [m]; or a pose, `pin.SE3`.
        to_offset: Likewise at `to`, if that is a frame.
        name: By default made of where it acts.

    Raises:
        InputError: numbers that are not finite, matrices that are not symmetric, damping that would drive, no frame's name. At
            a state: a rotation beyond 170 degrees, but of a ball mount.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> mount = rbd.Bushing("box", to=(0, 0, 1), stiffness=(1e4, 1e4, 981.0, 50.0, 50.0, 50.0))
        >>> sagged = rbd.State(box, [0, 0, 0.9, 0, 0, 0, 1])  # 98.1 N / 981 N/m lower
        >>> float(abs(rbd.solve(sagged, [], external=mount).a).max()) < 1e-12
        True
    """

    frame: str
    to: Anchor
    stiffness: float | Sequence[float] | Array = field(kw_only=True)
    damping: float | Sequence[float] | Array = field(default=0.0, kw_only=True)
    preload: float | Sequence[float] | Array = field(default=0.0, kw_only=True)
    offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    to_offset: Offset = field(default=(0.0, 0.0, 0.0), kw_only=True)
    name: str = field(default=None, kw_only=True)  # type: ignore[assignment]  # made in __post_init__

    parameters = ("stiffness", "damping")
    """`parameter_force` has the derivatives by the six numbers on the diagonal: "x", "y", "z", "about x", ..."""

    def __post_init__(self) -> None:
        what = self._settle("bushing", self.to, self.offset, self.to_offset)
        self.__dict__.update(
            damping=damping_matrix(what, self.damping),
            preload=six(f"preload of {what}", self.preload),
            stiffness=stiffness_matrix(what, self.stiffness),
        )

    @classmethod
    def relaxed_at(
        cls,
        state: State,
        frame: str,
        to: str | None,
        *,
        stiffness: float | Sequence[float] | Array,
        damping: float | Sequence[float] | Array = 0.0,
        offset: Offset = (0.0, 0.0, 0.0),
        name: str | None = None,
    ) -> Bushing:
        """A bushing that is relaxed at a state, with the axes that its point has there.

        Args:
            state: Where it is relaxed.
            frame: Frame of the robot.
            to: Another frame; None: the ground.
            stiffness: As of the class.
            damping: As of the class.
            offset: Of its point from the frame's origin, in the frame's axes, (3,) [m]; or a pose.
            name: As of the class.

        Raises:
            FrameNotFound: with the nearest names.
        """
        at = place_on(f"a bushing at {frame!r:.80}", frame, offset)
        here = checked(state).frame(frame).X_WF * pin.SE3(at.R, at.p)
        given = {"stiffness": stiffness, "damping": damping, "offset": offset, "name": name}
        if to is None:
            return cls(frame, here, **given)  # type: ignore[arg-type]
        return cls(frame, to, to_offset=state.frame(to).X_WF.actInv(here), **given)  # type: ignore[arg-type]

    def _coordinates(self, pair: Pair) -> Coordinates:
        return Pose(pair, repr(self.name)[:82], turns=self._turns())

    def _turns(self) -> bool:
        """Whether its force depends on the rotation; K and C are symmetric."""
        return any(np.any(np.asarray(x)[3:]) for x in (self.stiffness, self.damping, self.preload))

    def _law(self, m: int) -> tuple[Array, Array, Array]:
        return np.asarray(self.stiffness), np.asarray(self.damping), np.asarray(self.preload)

    def _by_parameter(self, parameter: str, x: Array, rate: Array) -> dict[str, Array]:
        size = x if parameter == "stiffness" else rate
        return dict(zip(("x", "y", "z", "about x", "about y", "about z"), np.diag(-size), strict=True))

    def parameter_force(self, state: State, parameter: str) -> Array | dict[str, Array]:
        """Derivatives of tau by the six numbers on the diagonal of K or C, {"x", ..., "about z": (nv,)}.

        Raises:
            InputError: it has no such parameter; or the rotation is beyond 170 degrees, of a ball mount too.
        """
        self.displacement(state)
        return super().parameter_force(state, parameter)

    def displacement(self, state: State) -> Array:
        """The coordinates x: position [m], then rotation vector [rad], of the frame in the axes of `to`, shape (6,).

        Raises:
            InputError: the rotation is beyond 170 degrees.
        """
        return Pose(Pair(state, *self._places()), repr(self.name)[:82]).x

    def picture(self, state: State) -> ElementPicture:
        """Its ends at a state, for drawings."""
        return ElementPicture("bushing", self._at(state)[0].points, None, None)
