"""The report of `rbd region`: where the centre of mass may be, its distance to the edge, and what limits it there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.arrays import largest_first
from rbd.cli.terminal import Table, counted, facts, in_gravity, rounded, save_figure, timed
from rbd.errors import InputError
from rbd.problem.cones import check_friction
from rbd.robots.loading import load_robot
from rbd.statics.regions import SupportRegion, support_region

LARGEST_TORQUES = 3


@dataclass(frozen=True)
class RegionReport:
    """Support regions of one pose.

    Attributes:
        regions: {what it is: the region}; the first is the one asked for.
        seconds: What took how long.
        verbose: Whether that is printed.
    """

    regions: Mapping[str, SupportRegion]
    seconds: Mapping[str, float]
    verbose: bool = False

    @property
    def asked(self) -> SupportRegion:
        """The region that was asked for."""
        return next(iter(self.regions.values()))

    def data(self) -> dict[str, object]:
        """All numbers, as plain data."""
        return {
            "robot": self.asked.state.robot.name,
            "centre_of_mass": self.asked.state.com.tolist(),
            "contacts": [r.name for r in self.asked.loads.rows],
            "regions": {
                name: {
                    "vertices": region.vertices.tolist(),
                    "outer": region.outer.tolist(),
                    "directions": region.directions.tolist(),
                    "area": region.area,
                    "distance": region.com_to_edge[0],
                    "cut": region.cut,
                    "residual": region.residual,
                    "torque_limits": region.torque_limits,
                    "friction": region.friction,
                }
                for name, region in self.regions.items()
            },
            "seconds": dict(self.seconds),
        }

    def __rich__(self) -> Group:
        """How far the centre of mass is from the edge, then the tables, then the proof."""
        corners = [self._corners()] if len(self.asked.vertices) else []
        return Group(Text(self.verdict), self._summary(), *corners, self._proof())

    @property
    def verdict(self) -> str:
        """How far the centre of mass is from the edge of the region that was asked for."""
        region, name = self.asked, self.asked.state.robot.name
        limits = " with torques within their limits" if region.torque_limits else ""
        if region.empty:
            return f"{name} can stand nowhere{limits}: no forces within friction balance it."
        distance = region.com_to_edge[0]
        if abs(distance) < 1e-6:
            return f"The centre of mass of {name} is on the edge of its support region{limits}."
        can = "can" if distance > 0.0 else "cannot"
        return f"The centre of mass of {name} is {region.com_in_words} its support region{limits}: it {can} stand."

    def _summary(self) -> Table:
        state = self.asked.state
        rows = [
            ("contacts", ", ".join(r.name for r in self.asked.loads.rows)),
            ("centre of mass", f"({rounded(state.com, 3)}) m"),
        ]
        rows += [(name, _words(region)) for name, region in self.regions.items()]
        if motors := self.asked.motors_in_the_way:
            rows.append(("in the way", f"torque limits of {', '.join(motors)}"))
        if self.asked.torque_limits:
            rows.append(("left out", "how a moving centre of mass would change gravity torques and Jacobians of this pose"))
        weight = state.robot.mass * float(np.linalg.norm(state.robot.gravity))
        return facts(f"{state.robot.name}: {state.robot.mass:.3f} kg, weight {weight:.2f} N", rows)

    def _proof(self) -> Table:
        rows = [(f"residual: {name}", f"{region.residual:.1e} N") for name, region in self.regions.items() if not region.empty]
        if self.verbose:
            rows.append(("times", ", ".join(f"{what} {1e3 * t:.2f} ms" for what, t in self.seconds.items())))
        return facts("proof: balance at the corners", rows)

    def _corners(self) -> Table:
        """At each corner, what its contacts carry, and the hardest working motors."""
        region, robot = self.asked, self.asked.state.robot
        limit = robot.effort_limit
        limited = bool(np.isfinite(limit).any())
        motors = ("hardest working motors there",) if limited else ()
        table = Table("corners of the region", (), ("x, y [m]", *(f"{r.name} [N]" for r in region.loads.rows), *motors))
        for i, corner in enumerate(region.vertices):
            forces = region.forces(i)
            carried = [f"{np.linalg.norm(forces[r.name][:3]):.1f}" for r in region.loads.rows]
            used = np.abs(region.tau(i)) / limit
            worst = largest_first(used)[:LARGEST_TORQUES].tolist()
            told = [", ".join(f"{robot.actuated_names[j]} {100 * used[j]:.0f} %" for j in worst)] if limited else []
            table.add_row(rounded(corner, 3), *carried, *told)
        return table


def report_region(
    name: str,
    package_dirs: Sequence[Path],
    posture: str | None,
    *,
    friction: float,
    margin: float,
    torque_limits: bool,
    gravity: str | None = None,
    verbose: bool = False,
) -> RegionReport:
    """The report of a robot on its feet; with torque limits asked for, that region first.

    Raises:
        InputError: no feet are known, or the numbers are none.
    """
    check_friction(friction, 4)
    seconds: dict[str, float] = {}
    with timed(seconds, "load"):
        robot = in_gravity(load_robot(name, package_dirs=package_dirs), gravity)
    if not robot.source.feet:
        raise InputError(f"no feet are known for {robot.name}, so that it cannot stand; `rbd robots` lists those that do.")
    with timed(seconds, "regions"):
        state, feet = robot.standing(posture), robot.feet(friction)
        out = {"torques within limits": support_region(state, feet, torque_limits=True, margin=margin)} if torque_limits else {}
        out["torques of any size"] = support_region(state, feet, margin=margin)
    return RegionReport(out, seconds, verbose)


def draw(regions: Mapping[str, SupportRegion], path: Path) -> Path:
    """The regions from above; returns where the picture is.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    from rbd.visual.figures.statics_plots import plot_region

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    names: Sequence[str] = list(regions)
    plot_region(figure.subplots(), *regions.values(), labels=names)
    return save_figure(figure, path, dpi=120)


def _words(region: SupportRegion) -> str:
    if region.empty:
        return "empty: nowhere do forces within friction balance the robot"
    where = "centre of mass on its edge" if abs(region.com_to_edge[0]) < 1e-6 else f"centre of mass {region.com_in_words}"
    if not region.bounded:
        return f"without end; {where}"
    return f"{1e4 * region.area:.2f} cm2{region.cut_words}, {counted(len(region.vertices), 'corner')}; {where}"
