"""Panels and completion of options and arguments, by their names in the commands.

After `rbd --install-completion` a shell completes names of robots, their frames and postures, and choices.
"""
# Imports are inside functions: a shell asks at each press of the Tab key.

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand
from typer.models import OptionInfo, ParameterInfo

if TYPE_CHECKING:
    from rbd.robots.robot import Robot

PANELS = {
    "Robot": "feet_ posture joint root gravity package_dir beside motors",
    "Contact and ground": "friction facets law ground terrain bodies margin torque_limits threshold self_collision "
    "touch_height touch_speed",
    "Push": "push at from_ for_ braced",
    "Motion": "duration step stops steps velocity gait hold_ stops rate quaternion units trust joints to filter_ lift carry",
    "Repair": "repair slower keep kind",
    "Many cases": "sweep resume workers store least_possible",
    "Output": "html json_ save plot png video log torques out show verbose",
}
"""Names of parameters in the panels of --help; the others are under "Options". `from_` of a motion is beside its `to`."""


def in_panels(command: Callable[..., None]) -> Callable[..., None]:
    """The same command, its options in panels, and with what a shell completes."""
    panels = {name: panel for panel, names in PANELS.items() for name in names.split()}
    hints = get_type_hints(command, include_extras=True)
    if "push" not in hints:
        panels["from_"] = panels["to"]
    for name, hint in hints.items():
        for stated in (each for each in get_args(hint) if isinstance(each, ParameterInfo)):
            if isinstance(stated, OptionInfo):
                stated.rich_help_panel = panels.get(name)
            stated.autocompletion = _COMPLETED.get(name)
    command.__annotations__ = hints  # else they are made anew from their text each time that they are asked for
    return command


class Completing(TyperCommand):
    """A command whose arguments are known to what completes the value of an option: `rbd stand talos --at` and Tab."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse; where a shell asks, an option at the end gets an empty value, without which nothing would be parsed."""
        unfinished = ctx.resilient_parsing and bool(args) and args[-1].startswith("-")
        return super().parse_args(ctx, [*args, ""] if unfinished else args)


def robot_names(incomplete: str) -> list[str]:
    """Names of robots that begin so; none for what looks like a path, which the shell completes by itself."""
    from rbd.robots import catalogue

    known = dict.fromkeys([*catalogue.robots(), *catalogue.mechanisms()])
    return _that_begin(known, incomplete)


def frame_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """Frames of the robot that the line names, that begin so; of a list, A,B, of its last name."""
    return _of_robot(ctx, incomplete, lambda robot: robot.frames())


def posture_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """Postures of the robot that the line names, that begin so."""
    return _of_robot(ctx, incomplete, lambda robot: list(robot.postures))


def joint_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """Joints of one coordinate of the robot that the line names, that begin so, each before its equals sign."""
    return _of_robot(ctx, incomplete, lambda robot: [f"{name}=" for name, joint in robot.joints.items() if joint.nv == 1])


def choices(*names: str) -> Callable[[str], list[str]]:
    """Completes one of some words."""

    def that_begin(incomplete: str) -> list[str]:
        return _that_begin(names, incomplete)

    return that_begin


def _that_begin(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def _of_robot(ctx: typer.Context, incomplete: str, names: Callable[[Robot], list[str]]) -> list[str]:
    given: dict[str, Any] = ctx.params
    robot = given.get("robot") or given.get("file")
    if not isinstance(robot, str):
        return []
    from rbd.robots.loading import load_robot

    try:
        with warnings.catch_warnings(action="ignore"):
            loaded = load_robot(robot, package_dirs=given.get("package_dir") or ())
    except Exception:  # the command tells what is wrong; a shell that completes has no place for it
        return []
    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in _that_begin(names(loaded), last)]


_COMPLETED: dict[str, Callable[..., list[str]]] = {
    "robot": robot_names,
    "at": frame_names,
    "feet_": frame_names,
    "keep": frame_names,
    "posture": posture_names,
    "joint": joint_names,
    "law": choices("coulomb", "convex"),
    "root": choices("free_flyer", "planar", "fixed"),
    "gait": choices("walk", "crawl", "trot", "pace", "bound"),
    "angles": choices("joint", "segment", "vertical"),
    "space": choices("endpoint", "joint"),
    "units": choices("rad", "deg"),
    "quaternion": choices("xyzw", "wxyz"),
    "kind": choices("motion", "gmr", "beyondmimic", "mujoco"),
}
"""{parameter: what completes it}; the shell completes files by itself."""
