"""Bushings: six springs and dampers between two frames, or between a frame and the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.forces.coordinates import Coordinates, Pose
from rbd.constraints.forces.element import BetweenPlaces, ElementPicture
from rbd.constraints.forces.numbers import damping_matrix, six, stiffness_matrix
from rbd.constraints.forces.places import Anchor, Offset, Pair, Place, other_place, place_on
from rbd.constraints.forces.plain_data import kept_as_data
from rbd.errors import InputError
from rbd.model.state import State, checked


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
        what = f"a bushing at {self.frame!r:.80}"
        at, to = place_on(what, self.frame, self.offset), other_place(what, self.to, self.to_offset)
        name = f"bushing from {at} to {to}" if self.name is None else self.name
        if not isinstance(name, str) or not name:
            raise InputError(f"name of {what} is {name!r:.80}; expected text.")
        what = repr(name)[:82]
        for key, value in (
            ("_at_frame", at), ("_at_to", to), ("name", name), ("damping", damping_matrix(what, self.damping)),
            ("preload", six(f"preload of {what}", self.preload)), ("stiffness", stiffness_matrix(what, self.stiffness)),
        ):  # fmt: skip
            object.__setattr__(self, key, value)

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

    def _places(self) -> tuple[Place, Place]:
        return self.__dict__["_at_to"], self.__dict__["_at_frame"]

    def _coordinates(self, pair: Pair) -> Coordinates:
        return Pose(pair, repr(self.name)[:82], turns=self._turns())

    def _turns(self) -> bool:
        """Whether its force depends on the rotation; K and C are symmetric."""
        return any(np.any(np.asarray(x)[3:]) for x in (self.stiffness, self.damping, self.preload))

    def _stiffness(self, m: int) -> Array:
        return np.asarray(self.stiffness)

    def _damping(self, m: int) -> Array:
        return np.asarray(self.damping)

    def _preload(self, m: int) -> Array:
        return np.asarray(self.preload)

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
