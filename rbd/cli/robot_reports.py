"""Tables of `rbd robots`, `rbd info`, `rbd stand` and `rbd region`, and the numbers of the last two for a file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.answers.solution import Solution
from rbd.arrays import Array, largest_first
from rbd.cli.terminal import TerminalTable, counted, facts, in_commands, in_gravity, in_options, rounded, save_figure, timed
from rbd.constraints.constraint import Constraint
from rbd.errors import CannotHold, InputError, ModelWarning, RbdError
from rbd.installation import in_use
from rbd.model.external import ExternalForce
from rbd.model.state import State
from rbd.problem.answer import ContactForce
from rbd.problem.cones import check_friction
from rbd.robots.building.parts import FARTHEST_SLIDE, FARTHEST_TURN
from rbd.robots.catalogue import licence
from rbd.robots.diagnosis import REMEDY
from rbd.robots.loading import doctor, load_robot
from rbd.robots.robot import Robot
from rbd.statics.actuation import Actuation
from rbd.statics.equilibrium import hold
from rbd.statics.regions import SupportRegion, support_region

_BASES = {"free_flyer": "floating", "planar": "planar", "fixed": "fixed"}
UNLIMITED = 1e100
"""A bound beyond this counts as none: files write it as the largest number."""
UNITS = {"stationarity": "N", "feasibility": "m/s2", "cone": "N", "complementarity": "N m/s2", "centroidal": "N"}
LARGEST_TORQUES = 5
_SLOW = Text("\narithmetic in loops is interpreted, which takes some hundred times as long: RBD_COMPILED=0 says so")


@dataclass(frozen=True)
class RobotLine:
    """One robot of the catalogue: size, feet, and whether it stands with the defaults.

    Attributes:
        name: What `load_robot` takes.
        nv: Degrees of freedom with a floating base; None where it does not load.
        mass: [kg].
        postures: Names.
        feet: Its feet, e.g. "2 soles".
        stands: "yes", or the reason why not.
    """

    name: str
    nv: int | None
    mass: float | None
    postures: tuple[str, ...]
    feet: str
    stands: str


def robot_lines(names: Iterable[str]) -> Iterator[RobotLine]:
    """Each robot loaded, stood on its feet and solved for equilibrium, one after the other."""
    for name in names:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                robot = load_robot(name)
            except RbdError as error:
                yield RobotLine(name, None, None, (), "", in_options(str(error)))
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
        return in_options(str(error))
    return "yes"


def robots_table(lines: Iterable[RobotLine]) -> TerminalTable:
    """The table of `rbd robots`."""
    table = TerminalTable()
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
    """The tables of `rbd info`: joints with limits, frames, feet, postures, mass, and what the model validation found."""
    head = Text(
        f"{robot.name}: {robot.mass:.3f} kg, nq {robot.nq}, nv {robot.nv}, {robot.nu} motors, "
        f"{_BASES[robot.root]} base, file {robot.urdf.name}"
    )
    head.append(f"\nlicence of its files: {licence(robot.source) or 'none is stated beside them'}")
    if (found := doctor(robot)).errors or found.warnings:
        remarks = found.summary().removeprefix(f"{found.robot}: ").removesuffix(REMEDY)
        head.append(f"\nremarks on its file: {in_commands(remarks)}All are below.")
    feet = ", ".join(f"{foot.name} ({foot.kind} on {foot.frame})" for foot in robot.source.feet) or "none known"
    postures = ", ".join(robot.postures) or "none known"
    frames = ", ".join(robot.frames())
    lines = Text(f"\nfeet: {feet}\npostures: {postures}\n\nframes ({len(robot.frames())}): {frames}\n\n")
    return Group(head, _joints_table(robot), lines, Text(in_commands(str(found))), *([] if in_use() else [_SLOW]))


def _joints_table(robot: Robot) -> TerminalTable:
    table = TerminalTable("joints")
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
            low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
            if (low, high) in ((-FARTHEST_TURN, FARTHEST_TURN), (-FARTHEST_SLIDE, FARTHEST_SLIDE)):
                low, high = -math.inf, math.inf
            bounds = (_bound(low), _bound(high), _bound(robot.joints[name].speed))
        motor = _bound(effort[joint.idx_v]) if joint.idx_v in effort else "no motor"
        table.add_row(name, joint.shortname().removeprefix("JointModel"), at, *bounds, motor)
    return table


def _bound(value: float) -> str:
    return f"{value:.4g}" if abs(value) < UNLIMITED else "none"


@dataclass(frozen=True, eq=False)
class StandReport:
    """A robot in equilibrium on its feet, optionally pushed.

    Attributes:
        held: The torques that act: found without the push, or against it.
        solution: Motion and forces under those torques and the push.
        push: World force [N], or None.
        at: Frame that is pushed, or None.
        seconds: {what: time taken [s]}.
        against: Torques that withstand the push, or why there are none; None without a push.
        braced: Whether `held` are those.
        verbose: Whether times are printed.
    """

    held: Actuation
    solution: Solution
    push: Array | None
    at: str | None
    seconds: Mapping[str, float]
    against: Actuation | CannotHold | None = None
    braced: bool = False
    verbose: bool = False

    @property
    def com_acceleration(self) -> tuple[Array, Array]:
        """Acceleration of the centre of mass with and without its contacts, each (3,) [m/s2]; NaN on a fixed base."""
        balance = self.solution.problem.balance
        if balance is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        mass = self.held.state.robot.mass
        rates = (balance.A_g @ a + balance.rate_bias for a in (self.solution.a, self.solution.a_free))
        with_contacts, without = (rate[:3] / mass for rate in rates)
        return with_contacts, without

    @property
    def distance(self) -> float:
        """|a - a_free| in the inertia metric, sqrt((a - a_free)^T M (a - a_free)) [N^1/2 m^1/2 / s]."""
        return math.sqrt(2.0 * self.solution.gauss)

    def data(self) -> dict[str, Any]:
        """All results as numbers, lists and text: SI units, world axes, forces on the robot."""
        robot, s = self.held.state.robot, self.solution
        with_contacts, without = self.com_acceleration
        return {
            "robot": robot.name,
            "mass": robot.mass,
            "push": None if self.push is None else {"force": self.push.tolist(), "frame": self.at},
            "withstood": self._withstood(),
            "braced": self.braced,
            "status": str(s.status),
            "law": str(s.law),
            "solver": s.solver,
            "method": s.method,
            "rows": s.problem.m,
            "rank": s.rank,
            "contacts": {name: self._contact(name, c) for name, c in s.contacts.items()},
            "centre_of_mass": self.held.state.com.tolist(),
            "centre_of_mass_acceleration": with_contacts.tolist(),
            "centre_of_mass_acceleration_without_contacts": without.tolist(),
            "tau": dict(zip(robot.actuated_names, self.held.tau.tolist(), strict=True)),
            "effort_limit": dict(zip(robot.actuated_names, robot.effort_limit.tolist(), strict=True)),
            "a": s.a.tolist(),
            "a_free": s.a_free.tolist(),
            "gauss": {"value": float(s.gauss), "shares": s.gauss.shares, "distance": self.distance},
            "residuals": {name: {"value": float(getattr(s.residuals, name)), "scaled": scaled, "unit": UNITS[name]}
                          for name, scaled in s.residuals.scaled.items()},
            "seconds": dict(self.seconds),
        }  # fmt: skip

    def _withstood(self) -> dict[str, Any] | None:
        """Whether motors could withstand the push: their torques, or the limits that prevent it and what is missing."""
        if self.against is None:
            return None
        names = self.held.state.robot.actuated_names
        if isinstance(self.against, Actuation):
            return {
                "possible": True,
                "tau": dict(zip(names, self.against.tau.tolist(), strict=True)),
                "share_of_limit": dict(zip(names, (1.0 - self.against.margins.torque).tolist(), strict=True)),
                "friction_used": {name: 1.0 - left for name, left in self.against.margins.friction.items()},
                "margin": self.against.margin,
                "contacts": {name: {"force": f[:3].tolist()} for name, f in self.against.forces.items()},
            }
        lack = self.against.missing
        return {
            "possible": False if self.against.limits else None,
            "limits": [{"kind": limit.kind, "name": limit.name} for limit in self.against.limits],
            "missing": None if lack is None else {"force": lack.force.tolist(), "moment": lack.moment.tolist()},
            "reason": str(self.against.reason),
            "reason_code": self.against.reason.code,
            "why": in_options(str(self.against)),
        }

    def _contact(self, name: str, c: ContactForce) -> dict[str, Any]:
        force = self.solution.forces[name]
        return {
            "force": force[:3].tolist(),
            "moment": force[3:].tolist() if len(force) == 6 else None,
            "normal": c.normal,
            "tangential": c.tangential,
            "friction_used": c.friction_used,
            "centre_of_pressure": None if c.centre_of_pressure is None else c.centre_of_pressure.tolist(),
            "corner_forces": self.solution.corner_forces[name].tolist(),
        }

    def __rich__(self) -> Group:
        """The lines and tables of the command line: whether it stands and what is nearest to a limit, numbers, proof."""
        lines = [Text(line) for line in (*self.verdict, self._headline(), *self._what_follows())]
        return Group(*lines, self._contacts_table(), self._torques_table(), self._motion_table(), self._proof_table())

    @property
    def verdict(self) -> list[str]:
        """Whether it stands, or motors could withstand the push, and what is nearest to a limit."""
        if self.against is None:
            return [f"{self.held.state.robot.name} stands: {_strain(self.held)}."]
        if isinstance(self.against, Actuation):
            return [f"Motors can withstand the push: {_strain(self.against)}."]
        return [_refusal(self.against), in_options(str(self.against))]

    def _what_follows(self) -> list[str]:
        """What the torques that act do under the push."""
        if self.against is None:
            return []
        acceleration = f"the centre of mass accelerates at ({rounded(self.com_acceleration[0], 3)}) m/s2."
        which = "those torques" if self.braced else "the torques of the unpushed pose"
        return [f"Below, under {which} and the push: {acceleration}"]

    def _contacts_table(self) -> TerminalTable:
        numbers = ("force x, y, z [N]", "normal [N]", "tangential [N]", "friction used", "centre of pressure [m]")
        table = TerminalTable(None, ("contact",), numbers)
        for name, c in self.solution.contacts.items():
            used = "-" if c.friction_used is None else f"{100 * c.friction_used:.1f} %"
            cop = "-" if c.centre_of_pressure is None else rounded(c.centre_of_pressure, 3)
            table.add_row(name, rounded(c.force, 2), f"{c.normal:.2f}", f"{c.tangential:.2f}", used, cop)
        total = sum((c.force for c in self.solution.contacts.values()), np.zeros(3))
        table.add_section()
        table.add_row("sum", rounded(total, 2), "", "", "", "")
        return table

    def _headline(self) -> str:
        robot = self.held.state.robot
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        pushed = "" if self.push is None else f", pushed with ({rounded(self.push, 1)}) N at {self.at}"
        return f"{robot.name}: {robot.mass:.3f} kg, weight {weight:.2f} N{pushed}"

    def _torques_table(self) -> TerminalTable:
        robot, tau = self.held.state.robot, self.held.tau
        table = TerminalTable(
            f"largest {'bracing' if self.braced else 'holding'} torques",
            ("joint",),
            ("torque [N m]", "limit [N m]", "of limit"),
        )
        used = np.abs(tau) / robot.effort_limit
        limited = bool(np.isfinite(robot.effort_limit).any())
        for i in largest_first(used if limited else np.abs(tau))[:LARGEST_TORQUES]:
            limit, share = "none", "-"
            if np.isfinite(robot.effort_limit[i]):
                limit, share = f"{robot.effort_limit[i]:.1f}", f"{100 * used[i]:.1f} %"
            table.add_row(robot.actuated_names[i], f"{tau[i]:.3f}", limit, share)
        return table

    def _motion_table(self) -> TerminalTable:
        with_contacts, without = self.com_acceleration
        rows = [
            ("centre of mass", f"({rounded(self.held.state.com, 3)}) m"),
            ("its acceleration", f"({rounded(with_contacts, 3)}) m/s2"),
            ("without contacts", f"({rounded(without, 3)}) m/s2"),
        ]
        return facts("motion", rows)

    def _proof_table(self) -> TerminalTable:
        s = self.solution
        rows = [("status", f"{s.status} by {s.method}, law: {s.law}; {s.problem.m} rows of rank {s.rank}")]
        for name, scaled in s.residuals.scaled.items():
            rows.append((f"residual: {name}", f"{float(getattr(s.residuals, name)):.1e} {UNITS[name]} (scaled {scaled:.1e})"))
        size = f"{self.distance:.4f} sqrt(N m)/s, as sqrt(kg) m/s2: contacts change the motion by so much"
        rows += [
            ("|a - a_free| in M", size),
            ("1/2 of its square", f"{float(s.gauss):.4f} N m/s2, which Gauss's principle makes least"),
        ]
        if self.verbose:
            rows.append(("times", ", ".join(f"{what} {1e3 * t:.2f} ms" for what, t in self.seconds.items())))
        return facts("proof", rows)


def holding(state: State, feet: Sequence[Constraint], external: Sequence[ExternalForce]) -> Actuation | CannotHold:
    """The torques that withstand external forces, or why there are none."""
    try:
        return hold(state, feet, external=external)
    except CannotHold as error:
        return error


def _strain(held: Actuation) -> str:
    """How near torques and friction come to their limits."""
    robot, used = held.state.robot, 1.0 - held.margins.torque
    told = []
    if np.isfinite(robot.effort_limit).any():
        worst = int(np.argmax(used))
        told.append(f"the largest torque is {100 * used[worst]:.1f} % of its limit ({robot.actuated_names[worst]})")
    friction = held.margins.friction
    if friction:
        most = min(friction, key=lambda name: friction[name])
        told.append(f"{most} uses {100 * (1.0 - friction[most]):.1f} % of its friction")
    if not held.margin:
        told.append("only with friction up to its limit")
    return ", ".join(told) or "no limits are stated"


def _refusal(error: CannotHold) -> str:
    """In a few words, what would give way."""
    if not error.limits:
        return "Whether motors can withstand the push was not found."
    named: dict[str, list[str]] = {}
    for limit in error.limits:
        named.setdefault(limit.kind, []).append(limit.name)
    gives = {"edge": "it tips", "friction": "its feet slip", "motor": "motors are too weak"}
    told = [words for kind, words in gives.items() if kind in named]
    if "push" in named:
        told.append(f"{' and '.join(named['push'])} would have to pull")
    return f"No motor torques withstand the push{': ' + ', or '.join(told) if told else ''}."


MOTORS_LISTED = 3


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

    def _summary(self) -> TerminalTable:
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

    def _proof(self) -> TerminalTable:
        rows = [(f"residual: {name}", f"{region.residual:.1e} N") for name, region in self.regions.items() if not region.empty]
        if self.verbose:
            rows.append(("times", ", ".join(f"{what} {1e3 * t:.2f} ms" for what, t in self.seconds.items())))
        return facts("proof: balance at the corners", rows)

    def _corners(self) -> TerminalTable:
        """At each corner, what its contacts carry, and the hardest working motors."""
        region, robot = self.asked, self.asked.state.robot
        limit = robot.effort_limit
        limited = bool(np.isfinite(limit).any())
        motors = ("hardest working motors there",) if limited else ()
        table = TerminalTable("corners of the region", (), ("x, y [m]", *(f"{r.name} [N]" for r in region.loads.rows), *motors))
        for i, corner in enumerate(region.vertices):
            forces = region.forces(i)
            carried = [f"{np.linalg.norm(forces[r.name][:3]):.1f}" for r in region.loads.rows]
            used = np.abs(region.tau(i)) / limit
            worst = largest_first(used)[:MOTORS_LISTED].tolist()
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
