"""The options --ground and --terrain: a height, a file of pieces, or words for stairs and slopes; how a robot stands on it."""
# Imports are inside functions: --help takes a third of a second.

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from rbd.errors import InputError, nearest

if TYPE_CHECKING:
    from rbd.constraints.terrain.terrain import Terrain
    from rbd.model.state import State
    from rbd.robots.robot import Robot

AHEAD = 0.5
"""The first riser is so far before the world's origin [m]."""
_MESHES, _WORLDS = (".stl", ".obj", ".dae"), (".urdf", ".xml", ".mjcf")
_MADE = {"stairs": "stairs:RISE,DEPTH,STEPS (or with ,X: where the first riser is)", "slope": "slope:DEGREES"}
_SYNTAX = (
    "a height in metres, stairs:RISE,DEPTH,STEPS[,X], slope:DEGREES, or a file: a world of fixed bodies (.urdf, .xml), or a "
    "mesh of convex parts (.stl, .obj, .dae)"
)

GroundOption = Annotated[
    str | None,
    typer.Option(
        "--ground",
        metavar="Z|FILE|stairs:..|slope:..",
        help="Ground: a height, a file (.urdf, .xml, .stl, .obj, .dae), stairs:0.1,0.3,5 or slope:8. See the manual: Terrain.",
    ),
]
TerrainOption = Annotated[
    str | None,
    typer.Option(
        metavar="Z|FILE|stairs|slope",
        help="Ground to walk on: a height, a file (.urdf, .xml, .stl, .obj, .dae), stairs, stairs:0.1,0.3,5, slope or slope:8.",
    ),
]
SUITED = {"rise": 0.115, "depth": 0.345, "ahead": 0.2}
"""Stairs for a robot, over the height of its centre of mass: 10 and 30 cm of Talos, so far before its toes."""
SUITED_STEPS, SUITED_SLOPE = 3, "8"


def suited_to(word: str, robot: Robot) -> float | Terrain:
    """Stairs that suit a robot's size, three steps up from before its feet where it stands; or a slope of 8 degrees."""
    if word == "slope":
        return ground_of(f"slope:{SUITED_SLOPE}")
    from rbd.robots.posture import corner_points

    state = robot.standing()
    corners = corner_points(state, robot.feet())
    h = float(state.com[2] - corners[:, 2].min())
    rise, depth = (max(0.005, 0.005 * round(SUITED[size] * h / 0.005)) for size in ("rise", "depth"))
    return ground_of(f"stairs:{rise:g},{depth:g},{SUITED_STEPS},{corners[:, 0].max() + SUITED['ahead'] * h:.3f}")


def ground_of(text: str, option: str = "--ground", robot: Robot | None = None) -> float | Terrain:
    """The ground that the option names.

    Stairs go up along x (down for a negative rise), their first riser at x = `AHEAD` or where X says, as
    `rbd.Terrain.stairs`; a slope rises along x through the world's origin; both in metres and degrees.

    Args:
        text: The option's.
        option: Its name.
        robot: Whose size the words "stairs" and "slope" alone suit; without one these have numbers.

    Raises:
        InputError: text that is none of these, with the nearest; numbers that are none; a file that cannot be read.
    """
    from rbd.constraints.terrain.terrain import Terrain
    from rbd.problem.ground import Ground

    try:
        height = float(text)
    except ValueError:
        pass
    else:
        if not abs(height) < 1e5:
            raise InputError(f"{option} is {text!r:.80}; expected a height in metres.")
        return height
    suffix, (word, colon, given) = Path(text).suffix.lower(), text.partition(":")
    if suffix in _WORLDS:
        return Terrain.read(text)
    if suffix in _MESHES:
        return Terrain.mesh(text)
    if robot is not None and word in _MADE and not colon:
        return suited_to(word, robot)
    if word not in _MADE or not colon:
        known = _MADE[word] if word in _MADE else f"{_SYNTAX}; {nearest(word, _MADE)}"
        raise InputError(f"{option} is {text!r:.80}; expected {known}.")
    try:
        numbers = [float(x) for x in given.split(",")]
    except ValueError:
        numbers = []
    if word == "slope":
        if len(numbers) != 1 or not abs(numbers[0]) < 80.0:
            raise InputError(f"{option} is {text!r:.80}; expected {_MADE[word]}, less than 80, e.g. slope:8.")
        angle = np.deg2rad(numbers[0])
        return Terrain({"slope": Ground(point=np.zeros(3), normal=np.array([-np.sin(angle), 0.0, np.cos(angle)]))})
    if len(numbers) not in (3, 4) or not np.isfinite(numbers).all() or numbers[2] != int(numbers[2]):
        raise InputError(f"{option} is {text!r:.80}; expected {_MADE[word]}, in metres, e.g. stairs:0.1,0.3,5.")
    rise, depth, steps, x = (*numbers, AHEAD)[:4]
    return Terrain.stairs(rise, depth, int(steps), start=(x, 0.0, 0.0))


def standing_on(
    robot: Robot, posture: str | None, ground: float | Terrain | None, joints: Mapping[str, float] = MappingProxyType({})
) -> State:
    """The robot on its feet, as `robot.standing`; on ground that is given its centre of mass where it is over level ground.

    Args:
        robot: The robot.
        posture: A posture's name, or None.
        ground: Under its feet.
        joints: {joint: value} that replace those of the posture; the base is then placed by `rbd.robots.place_on_ground`.

    Raises:
        InputError: a foot is over no ground.
        CannotReach: its joints do not take its feet there.
    """
    state = robot.standing(posture)
    if joints:
        from rbd.robots.posture import place_on_ground

        state = state.with_joints(joints)
        state = place_on_ground(state, robot.feet(None)) if robot.floating else state
    if ground is None:
        return state
    from rbd.mechanism.pose_search import find_pose

    return find_pose(robot, ground=ground, posture=state, com=state.com[:2]).state
