"""`Carried`: an object that a robot holds in one hand or two, and its inertia as its shares move with these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, replace
from typing import Any, Self

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_different
from rbd.model.checked_model import CheckedModel
from rbd.model.placement import rigid_placement
from rbd.model.state import State
from rbd.model.urdf import LIGHTEST
from rbd.robots.building.parts import EQUAL, check_moments, inertia_matrix
from rbd.robots.building.solids import Box
from rbd.robots.number_checks import checked_name, checked_names, checked_number, checked_numbers

DENSITY = 500.0
"""Of a cube whose size is not given [kg/m3]."""


@dataclass(frozen=True)
class Carried(Displayed):
    """An object that a robot holds in one hand or in two, for `robot.carrying` and `motion.carrying`: a box H by default.

    Places that are left open are those of the pose in which it is taken: its centre in the middle of its grasps, its axes those
    of the robot's base, and the second hand where it is.

    Attributes:
        mass: [kg].
        grasps: Names of the frames that hold it, one or two of different bodies: `robot.frames()`.
        size: Sides of the box, along its axes, shape (3,) [m]; by default a cube of 500 kg/m3. It is drawn so.
        inertia: About its centre of mass, in its axes: (Ixx, Iyy, Izz), six entries xx, xy, xz, yy, yz, zz, or the matrix
            [kg m2]; by default that of the box.
        placement: X_GH, the pose of its centre in the first grasp's frame, as `pin.SE3`.
        second: Pose of the second grasp's frame in the first's: the grasp that both hands are to keep.
        shares: Shares of its inertia that each hand bears, with a sum of 1; by default equal ones.
        name: Its name, for messages.

    Raises:
        InputError: no mass, no grasps or three of them, an inertia that no body can have, shares with another sum.

    Example:
        >>> g1 = rbd.load_robot("g1")
        >>> box = rbd.Carried(3.0, ["left_wrist_yaw_link", "right_wrist_yaw_link"], size=(0.3, 0.4, 0.2), name="box")
        >>> print(box)
        box, 3 kg in left_wrist_yaw_link and right_wrist_yaw_link
        >>> loaded = g1.carrying(box)
        >>> print(f"{g1.mass:.2f} + 3 = {loaded.mass:.2f} kg")
        33.34 + 3 = 36.34 kg
    """

    mass: float
    grasps: Sequence[str]
    _: KW_ONLY
    size: Sequence[float] | Array | None = None
    inertia: Sequence[float] | Array | None = None
    placement: pin.SE3 | Array | None = None
    second: pin.SE3 | Array | None = None
    shares: Sequence[float] | None = None
    name: str = "object"

    def __post_init__(self) -> None:
        what, put = f"carried object {checked_name('the name of a carried object', self.name)!r:.80}", object.__setattr__
        put(self, "mass", checked_number(f"mass of {what}", self.mass, least=LIGHTEST))
        put(self, "grasps", checked_names(f"grasps of {what}", self.grasps))
        hands = len(self.grasps)
        if hands not in (1, 2):
            raise InputError(f"{what} has {hands} grasps; expected the frames of one hand or of two: ['left_hand'].")
        check_different(self.grasps, f"grasps of {what}")
        box = Box((self.mass / DENSITY) ** (1.0 / 3.0) * np.ones(3) if self.size is None else self.size, mass=self.mass)
        given = box.mass_properties().inertia if self.inertia is None else self.inertia
        inertia = inertia_matrix(f"inertia of {what}", given)
        check_moments(what, inertia)
        put(self, "size", box.size)
        put(self, "inertia", tuple(map(tuple, inertia.tolist())))
        for key in ("placement", "second"):
            if (pose := getattr(self, key)) is not None:
                put(self, key, rigid_placement(f"{key} of {what}", pose))
        if self.second is not None and hands == 1:
            raise InputError(f"{what} has a pose of its second grasp, and one grasp; expected two.")
        shares = (1.0 / hands,) * hands if self.shares is None else self.shares
        put(self, "shares", checked_numbers(f"shares of {what}", shares, (hands,), least=0.0, most=1.0))
        if abs(sum(self.shares or ()) - 1.0) > 1e-9:
            raise InputError(f"shares of {what} are {self.shares}; expected numbers with a sum of 1, e.g. (0.7, 0.3).")

    def held(self, state: State) -> Self:
        """The same object with places that are left open as in a state.

        Raises:
            FrameNotFound: a grasp that is no frame of the robot, with the nearest names.
            InputError: a grasp that is fixed to the world; two on one body.
        """
        joints = [state.robot.site(name)[0] for name in self.grasps]
        if 0 in joints or len(set(joints)) < len(joints):
            raise InputError(
                f"grasps of {self.name!r:.80} are {' and '.join(self.grasps)}, on "
                + ("the world; expected frames of bodies that move." if 0 in joints else "one body; expected one of them.")
            )
        hands = [state.frame(name).X_WF for name in self.grasps]
        axes = state.base_pose().rotation if state.robot.floating else np.eye(3)
        centre = pin.SE3(axes, np.mean([hand.translation for hand in hands], axis=0))
        back = hands[0].inverse()
        placement = back * centre if self.placement is None else self.placement
        return replace(self, placement=placement, second=self.second or (back * hands[1] if len(hands) == 2 else None))

    def parts(self, robot: CheckedModel) -> Iterator[tuple[int, pin.SE3, pin.Inertia]]:
        """(joint, X_JH, inertia in its body's axes) of each hand, of an object whose places are all given.

        Shares s_1, s_2 of the mass m are as near to their hands as they can be: at a s_2 and -a s_1 from the object's centre,
        along the line u from the second hand to the first. Together they have its second moments S, and each has the share
        s_i (S - m s_1 s_2 a^2 u u^T), which masses can have up to a^2 = 1 / (m s_1 s_2 u^T S^-1 u).
        """
        shares, I = np.array(self.shares), np.array(self.inertia)
        grasps: tuple[Any, ...] = (pin.SE3.Identity(), self.second)[: len(shares)]
        S = 0.5 * np.trace(I) * np.eye(3) - I
        hands = [X_1G.inverse() * self.placement for X_1G in grasps]
        way = hands[0].inverse().translation - hands[-1].inverse().translation
        reach = 0.0
        if shares.all() and way.any() and np.linalg.eigvalsh(S)[0] > EQUAL * np.trace(S):
            reach = min(1.0, (self.mass * shares.prod() * (way @ np.linalg.solve(S, way))) ** -0.5)
        S = S - self.mass * shares.prod() * reach**2 * np.outer(way, way)
        for i, (share, name, X_GH) in enumerate(zip(shares, self.grasps, hands, strict=True)):
            joint, X_JG = robot.site(name)
            X_JH, at = X_JG * X_GH, (1.0 - share) * reach * (-1.0) ** i * way
            yield joint, X_JH, X_JH.act(pin.Inertia(share * self.mass, at, share * (np.trace(S) * np.eye(3) - S)))

    @property
    def plain(self) -> dict[str, Any]:
        """Its arguments as plain data, for JSON."""
        poses = {key: None if (X := getattr(self, key)) is None else X.homogeneous.tolist() for key in ("placement", "second")}
        return {**asdict(replace(self, placement=None, second=None)), **poses}

    def __str__(self) -> str:
        return f"{self.name}, {self.mass:g} kg in {' and '.join(self.grasps)}"


def carried_by(robot: CheckedModel) -> tuple[Carried, ...]:
    """What a robot carries; a bare model carries nothing."""
    return getattr(robot, "carried", ())
