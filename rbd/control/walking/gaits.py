"""Gaits: which feet swing at once, in which order, for how long; and which foot of a robot is which."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.arrays import Array, check_number
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.errors.inputs import listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

TWO, FOUR = ("left", "right"), ("front_left", "front_right", "hind_left", "hind_right")
TOES = 0.2
"""A sole reaches so much farther to one side of its last joint than to the other, over half its length: there are the toes."""


@dataclass(frozen=True)
class Gait(Displayed):
    """An order of swings, all of one length.

    Times are in units of sqrt(h / g), with h the height of the centre of mass over the feet: so robots of all sizes have them
    alike. 1 is 0.3 s of Talos, and 0.15 s of Solo12.

    Attributes:
        order: Feet that swing at once, one group after the other: "left", "right" of two; "front_left", "front_right",
            "hind_left", "hind_right" of four.
        swing: How long a foot is in the air [sqrt(h / g)].
        overlap: From when a group is to land until the next is lifted [sqrt(h / g)]; negative: it is lifted before.
        lift: Height of a foot over what is below it, over h.
        stride: How far the body moves in one swing and overlap, over h.
        tilt: Angle of roll and pitch in a time sqrt(h / g) that costs as much as 6 % of h of the centre of mass [rad]; 0: the
            body is to stay level.

    Raises:
        InputError: feet that are not there or swing twice, times and heights out of range.

    Example:
        >>> rbd.control.Gait((("left",), ("right",)), swing=2.4, overlap=1.0).flies
        False
    """

    order: tuple[tuple[str, ...], ...]
    swing: float
    overlap: float
    lift: float = 0.07
    stride: float = 0.23
    tilt: float = 0.0

    def __post_init__(self) -> None:
        said = "order of a gait"
        groups = listed_items(said, self.order, "groups of feet, e.g. (('left',), ('right',))")
        order = tuple(tuple(listed_items(said, group, "groups of feet", alone=True)) for group in groups)
        object.__setattr__(self, "order", order)
        feet = [foot for group in order for foot in group]
        if sorted(map(str, feet)) not in (sorted(TWO), sorted(FOUR)):
            raise InputError(
                f"order of a gait has the feet {', '.join(map(repr, feet))[:120]}; expected each of {', '.join(TWO)} once, or "
                f"each of {', '.join(FOUR)}."
            )
        check_number("swing of a gait", self.swing, 0.1, 20.0, expected="a time above 0 [sqrt(h / g)]")
        check_number("overlap of a gait", self.overlap, -0.9 * self.swing, 20.0, expected="a time, shorter than a swing")
        check_number("lift of a gait", self.lift, 0.0, 0.5, expected="a height >= 0 [h]")
        check_number("stride of a gait", self.stride, 0.0, 2.0, expected="a length >= 0 [h]")
        check_number("tilt of a gait", self.tilt, 0.0, 1.0, expected="an angle >= 0 [rad]")

    @property
    def flies(self) -> bool:
        """Whether there are times in which no foot is on the ground."""
        feet, after = {foot for group in self.order for foot in group}, (*self.order[1:], self.order[0])
        return self.overlap < 0.0 and any(set(a) | set(b) == feet for a, b in zip(self.order, after, strict=True))


GAITS = {
    "walk": Gait((("right",), ("left",)), 2.35, 1.0),
    "crawl": Gait((("hind_left",), ("front_left",), ("hind_right",), ("front_right",)), 2.0, 0.7, 0.12, 0.1),
    "trot": Gait((("front_left", "hind_right"), ("front_right", "hind_left")), 1.6, 0.3, 0.12, 0.2),
    "pace": Gait((("front_left", "hind_left"), ("front_right", "hind_right")), 1.2, 0.2, 0.12, 0.15, 0.1),
    "bound": Gait((("hind_left", "hind_right"), ("front_left", "front_right")), 1.2, -0.2, 0.12, 0.15, 0.3),
}
"""By name: of two feet the first, of four the others."""


def gait_of(gait: object, feet: int) -> Gait:
    """The gait that is given as a `Gait` or by its name; for None the usual one of this number of feet.

    Raises:
        InputError: others, or one of another number of feet.
    """
    name = ("walk" if feet == 2 else "crawl") if gait is None else gait
    if isinstance(name, str):
        known = [each for each, found in GAITS.items() if sum(map(len, found.order)) == feet]
        if name not in known:
            raise InputError(f"gait is {name!r:.80}, of a robot with {feet} feet; {nearest(name, known)}.")
        return GAITS[name]
    if not isinstance(name, Gait) or sum(map(len, name.order)) != feet:
        raise InputError(f"gait is {name!r:.80}; expected a name or an rbd.control.Gait of {feet} feet.")
    return name


def heading_of(state: State, feet: Sequence[Any]) -> float:
    """Where the robot faces, an angle about the vertical [rad]: along x of its base, or, where its toes say so, along -x.

    That is where soles reach farther behind the last joint than before it, by a tenth of their length in the mean.
    """
    R = state.frame(state.robot.model.names[state.robot.bases[0]]).X_WF.rotation
    x, model = R[:, 0] / np.linalg.norm(R[:2, 0]), state.robot.model
    toes = list[float]()
    for foot in feet:
        if len(foot.corners) > 1:
            joint = model.frames[model.getFrameId(foot.frame)].parentJoint
            X, place = state.frame(foot.frame).X_WF * foot.placement, state.joint_places([joint])[1][0]
            reach = [float((X.act(p) - place)[:2] @ x[:2]) for p in foot.corners]
            toes.append((max(reach) + min(reach)) / (max(reach) - min(reach)))
    back = bool(toes) and float(np.mean(toes)) < -TOES
    return math.atan2(-x[1], -x[0]) if back else math.atan2(x[1], x[0])


def roles_of(robot: CheckedModel, feet: Sequence[Any], centres: Array, yaw: float) -> dict[str, str]:
    """{"left" or "front_left" ...: name of the foot}, by where they stand, shape (feet, 3), seen along a heading [rad].

    Raises:
        InputError: neither two nor four feet, or two of them at one side.
    """
    if len(feet) not in (2, 4):
        raise InputError(
            f"{robot.name} has {len(feet)} feet, and gaits are known of two and of four; give `steps` as a list of "
            "rbd.control.Footstep with times of your own."
        )
    names, (c, s) = [foot.name for foot in feet], (math.cos(yaw), math.sin(yaw))
    forward, left = ((centres - centres.mean(axis=0))[:, :2] @ [[c, -s], [s, c]]).T
    side = np.where(left > 0.0, "left", "right")
    roles = side if len(feet) == 2 else np.char.add(np.where(forward > 0.0, "front_", "hind_"), side)
    found = dict(zip(roles.tolist(), names, strict=True))
    if len(found) < len(feet):
        raise InputError(
            f"feet of {robot.name} are at {', '.join(roles.tolist())}; expected one at each of "
            f"{', '.join(TWO if len(feet) == 2 else FOUR)}: a posture in which they stand apart."
        )
    return found
