"""Tables of `rbd robots` and `rbd info`."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from rich.console import Group
from rich.text import Text

from rbd.cli.terminal import Table
from rbd.errors import ModelWarning, RbdError
from rbd.robots.catalogue import licence
from rbd.robots.checkup import doctor
from rbd.robots.robot import Robot, load_robot
from rbd.statics.equilibrium import hold

_BASES = {"free_flyer": "floating", "planar": "planar", "fixed": "fixed"}
UNLIMITED = 1e100
"""A bound beyond this is none: files say it with the largest number there is."""


@dataclass(frozen=True)
class RobotLine:
    """One robot of the catalogue: what it is, and whether it stands out of the box.

    Attributes:
        name: What `load_robot` takes.
        nv: Degrees of freedom with a floating base; None where it does not load.
        mass: [kg].
        postures: Names.
        feet: What it stands on, e.g. "2 soles".
        stands: "yes", or why not.
    """

    name: str
    nv: int | None
    mass: float | None
    postures: tuple[str, ...]
    feet: str
    stands: str


def robot_lines(names: Iterable[str]) -> Iterator[RobotLine]:
    """Each robot loaded, stood on its feet and held, one after the other."""
    for name in names:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                robot = load_robot(name)
            except RbdError as error:
                yield RobotLine(name, None, None, (), "", str(error))
                continue
            yield RobotLine(name, robot.nv, robot.mass, tuple(robot.postures), _feet(robot), _stands(robot))


def _feet(robot: Robot) -> str:
    kinds = [foot.kind for foot in robot.source.feet]
    return ", ".join(f"{kinds.count(kind)} {kind}s" for kind in dict.fromkeys(kinds))


def _stands(robot: Robot) -> str:
    if not robot.source.feet:
        return "no feet known"
    try:
        hold(robot.standing(), robot.feet())
    except RbdError as error:
        return str(error)
    return "yes"


def robots_table(lines: Iterable[RobotLine]) -> Table:
    """The table of `rbd robots`."""
    table = Table()
    table.add_column("name", no_wrap=True)
    table.add_column("nv", justify="right")
    table.add_column("mass [kg]", justify="right")
    for heading in ("postures", "feet", "stands"):
        table.add_column(heading)
    for line in lines:
        numbers = ("-", "-") if line.nv is None or line.mass is None else (str(line.nv), f"{line.mass:.3f}")
        postures = ", ".join(line.postures[:4]) + (f", and {len(line.postures) - 4} more" if len(line.postures) > 4 else "")
        table.add_row(line.name, *numbers, postures, line.feet, line.stands)
    return table


def robot_info(robot: Robot) -> Group:
    """The tables of `rbd info`: joints with limits, frames, feet, postures, mass, and what the doctor found."""
    head = Text(
        f"{robot.name}: {robot.mass:.3f} kg, nq {robot.nq}, nv {robot.nv}, {robot.nu} motors, "
        f"{_BASES[robot.root]} base, file {robot.urdf.name}"
    )
    told = licence(robot.source)
    head.append(f"\nlicence of its files: {told or 'none is stated beside them'}")
    feet = ", ".join(f"{foot.name} ({foot.kind} on {foot.frame})" for foot in robot.source.feet) or "none known"
    postures = ", ".join(robot.postures) or "none known"
    frames = ", ".join(robot.frames())
    lines = Text(f"\nfeet: {feet}\npostures: {postures}\n\nframes ({len(robot.frames())}): {frames}\n\n")
    return Group(head, _joints_table(robot), lines, Text(str(doctor(robot))))


def _joints_table(robot: Robot) -> Table:
    table = Table("joints")
    table.add_column("name", no_wrap=True)
    table.add_column("kind")
    for heading in ("at v", "lower", "upper", "speed limit", "effort limit"):
        table.add_column(heading, justify="right")
    model = robot.model
    effort = dict(zip(robot.actuated.tolist(), robot.effort_limit.tolist(), strict=True))
    for name in robot.joints:
        joint = model.joints[robot.joint_id(name)]
        at = f"{joint.idx_v}" if joint.nv == 1 else f"{joint.idx_v}..{joint.idx_v + joint.nv - 1}"
        bounds = ("", "", "")
        if joint.nq == 1:
            bounds = (
                _bound(model.lowerPositionLimit[joint.idx_q]),
                _bound(model.upperPositionLimit[joint.idx_q]),
                _bound(_speed_limit(model)[joint.idx_v]),
            )
        motor = _bound(effort[joint.idx_v]) if joint.idx_v in effort else "no motor"
        table.add_row(name, joint.shortname().removeprefix("JointModel"), at, *bounds, motor)
    return table


def _speed_limit(model: pin.Model) -> np.ndarray:
    return np.asarray(model.upperVelocityLimit if hasattr(model, "upperVelocityLimit") else model.velocityLimit)


def _bound(value: float) -> str:
    return f"{value:.4g}" if abs(value) < UNLIMITED else "none"
