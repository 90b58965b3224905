"""Tables of `rbd robots`, `rbd info`, `rbd stand` and `rbd region`, and the numbers of the last two for a file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.answers.comparison import Confirmation, confirmed_by_qp, obeys_gauss
from rbd.answers.solution import Solution
from rbd.arrays import Array, largest_first
from rbd.cli.ground_option import standing_on
from rbd.cli.terminal import TerminalTable, facts, in_commands, in_gravity, in_options, joints_of, save_figure, timed
from rbd.constraints.constraint import Constraint
from rbd.constraints.distance_warnings import beyond_limits_words
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import CannotHold, InputError, ModelWarning, RbdError
from rbd.installation import in_use
from rbd.model.external import ExternalForce
from rbd.model.state import State
from rbd.problem.cones import check_friction
from rbd.records import Field, joined, plain_of, share, vector
from rbd.robots.building.parts import FARTHEST_SLIDE, FARTHEST_TURN
from rbd.robots.catalogue import licence
from rbd.robots.diagnosis import REMEDY
from rbd.robots.loading import doctor, load_robot
from rbd.robots.robot import Robot
from rbd.statics.actuation import Actuation
from rbd.statics.equilibrium import hold
from rbd.statics.limits import Limit
from rbd.statics.regions import SupportRegion, support_region

_BASES = {"free_flyer": "floating", "planar": "planar", "fixed": "fixed"}
UNLIMITED = 1e100
"""A bound beyond this counts as none: files write it as the largest number."""
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
        with warnings.catch_warnings(action="ignore", category=ModelWarning):
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
    table = TerminalTable(None, ("name",), ("nv", "mass [kg]"))
    for heading in ("postures", "feet", "stands"):
        table.add_column(heading)
    for line in lines:
        numbers = ("-", "-") if line.nv is None or line.mass is None else (str(line.nv), f"{line.mass:.3f}")
        table.add_row(line.name, *numbers, joined(line.postures, 4), line.feet, line.stands)
    return table


def robot_info(robot: Robot, beside: Robot | None = None) -> Group:
    """The tables of `rbd info`: joints with limits, frames, feet, postures, mass, and the doctor's report."""
    head = Text(
        f"{robot.name}: {robot.mass:.3f} kg, nq {robot.nq}, nv {robot.nv}, {robot.nu} motors, "
        f"{_BASES[robot.root]} base, file {robot.urdf.name}"
    )
    head.append(f"\nlicence of its files: {licence(robot.source) or 'none is stated beside them'}")
    if (found := doctor(robot, beside=beside)).errors or found.warnings:
        remarks = found.summary().removeprefix(f"{found.robot}: ").removesuffix(REMEDY)
        head.append(f"\nremarks on its file: {in_commands(remarks)}All are below.")
    feet = ", ".join(f"{foot.name} ({foot.kind} on {foot.frame})" for foot in robot.source.feet) or "none known"
    postures = ", ".join(robot.postures) or "none known"
    frames = ", ".join(robot.frames())
    lines = Text(f"\nfeet: {feet}\npostures: {postures}\n\nframes ({len(robot.frames())}): {frames}\n\n")
    return Group(head, _joints_table(robot), lines, Text(in_commands(str(found))), *([] if in_use() else [_SLOW]))


def _joints_table(robot: Robot) -> TerminalTable:
    table = TerminalTable("joints", ("name", "kind"), ("at v", "lower", "upper", "speed limit", "effort limit"))
    effort = dict(zip(robot.actuated.tolist(), robot.effort_limit.tolist(), strict=True))
    for name, joint in robot.joints.items():
        at = f"{joint.v.start}" if joint.nv == 1 else f"{joint.v.start}..{joint.v.stop - 1}"
        far = FARTHEST_TURN if joint.is_angle else FARTHEST_SLIDE  # which files of the builder state in place of no limit
        ends = [math.inf if abs(x) == far else x for x in (joint.lower, joint.upper)]
        bounds = [*map(_bound, ends), _bound(joint.speed)] if joint.nq == 1 else [""] * 3
        motor = _bound(effort[joint.v.start]) if joint.v.start in effort else "no motor"
        table.add_row(name, joint.kind, at, *bounds, motor)
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
        confirmed: The answer beside that of Gauss's QP in ProxSuite, or why there is none; None: not compared.
    """

    held: Actuation
    solution: Solution
    push: Array | None
    at: str | None
    seconds: Mapping[str, float]
    against: Actuation | CannotHold | None = None
    braced: bool = False
    confirmed: Confirmation | RbdError | None = None

    fields: ClassVar[tuple[Field, ...]] = (
        Field("robot", (), "", "its name", lambda found: found.held.state.robot.name),
        Field("mass", (), "kg", "of the robot", lambda found: found.held.state.robot.mass),
        Field("push", ("axis",), "N", "world force"),
        Field("at", (), "", "frame that is pushed"),
        Field("withstood", (), "", "the torques that withstand the push, or what prevents it"),
        Field("braced", (), "", "whether these act"),
        Field("held", (), "", "the torques that act"),
        Field("solution", (), "", "motion and forces under them and the push"),
        Field("solver", (), "", "what found it", lambda found: found.solution.solver),
        Field("confirmed", (), "", "largest differences from Gauss's QP in ProxSuite: law, a, f", lambda found: (
            vars(found.confirmed) | {"law": str(found.confirmed.law)} if isinstance(found.confirmed, Confirmation) else None)),
        Field("rows", (), "1", "rows of the constraints", lambda found: found.solution.problem.m),
        Field("rank", (), "1", "how many of them are independent", lambda found: found.solution.rank),
        Field("effort_limit", ("motor",), "{}", "limits of the motors", lambda found: dict(
            zip(found.held.state.robot.actuated_names, found.held.state.robot.effort_limit.tolist(), strict=True))),
        Field("contacts", (), "", "each contact's force", lambda found: found.solution.contacts),
        Field("com", ("axis",), "m", "centre of mass in W", lambda found: found.held.state.com),
        Field("com_acceleration", ("axis",), "m/s2", "its acceleration", lambda found: found.com_acceleration[0]),
        Field("com_acceleration_free", ("axis",), "m/s2", "that without contacts", lambda found: found.com_acceleration[1]),
        Field("a_free", ("velocity",), "{}/s2", "accelerations without constraints", lambda found: found.solution.a_free),
        Field("gauss_shares", (), "N m/s2", "share of each constraint", lambda found: found.solution.gauss.shares),
        Field("seconds", (), "s", "how long each part took"),
    )  # fmt: skip

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
    def withstood(self) -> dict[str, Any] | None:
        """Whether motors could withstand the push: their torques, or the limits that prevent it and what is missing."""
        if self.against is None:
            return None
        if isinstance(self.against, Actuation):
            return {"possible": True, **plain_of(self.against)}
        return {
            "possible": False if self.against.limits else None,
            "limits": self.against.limits,
            "missing": self.against.missing,
            "reason": self.against.reason,
            "reason_code": self.against.reason.code,
            "why": in_options(str(self.against)),
        }

    def __rich__(self) -> Group:
        """Whether it stands and what is nearest to a limit, what it does, forces and certificate, the largest torques."""
        lines = (*self.verdict, self._headline(), *self._what_follows(), "", str(self.solution), *self._confirmation(), "")
        return Group(*map(Text, lines), self._torques_table())

    @property
    def verdict(self) -> list[str]:
        """Whether it stands, or motors could withstand the push, and what is nearest to a limit."""
        if isinstance(self.against, CannotHold):
            gives = ", or ".join(gives_way(self.against.limits))
            said = f"No motor torques withstand the push{gives and ': '}{gives}."
            unknown = "Whether motors can withstand the push was not found."
            return [said if self.against.limits else unknown, in_options(str(self.against))]
        said = f"{self.held.state.robot.name} stands" if self.against is None else "Motors can withstand the push"
        beyond = beyond_limits_words(self.held.state)
        limits = [f"Not within its joint limits: {beyond}. Give angles within them, --joint NAME=VALUE."] if beyond else []
        return [f"{said}: {', '.join(strain(self.against or self.held)) or 'no limits are stated'}.", *limits]

    def _headline(self) -> str:
        robot = self.held.state.robot
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        pushed = "" if self.push is None else f", pushed with {vector(self.push, 1)} N at {self.at}"
        free = f"without contacts it would accelerate at {vector(self.com_acceleration[1])} m/s2"
        where = f"centre of mass {vector(self.held.state.com)} m; {free}"
        return f"{robot.name}: {robot.mass:.3f} kg, weight {weight:.2f} N{pushed}; {where}"

    def _what_follows(self) -> list[str]:
        """What the torques that act do under the push."""
        if self.against is None:
            return []
        which = "those torques" if self.braced else "the torques of the unpushed pose"
        acceleration = f"the centre of mass accelerates at {vector(self.com_acceleration[0])} m/s2."
        return [f"Below, under {which} and the push: {acceleration}"]

    def _confirmation(self) -> list[str]:
        """The answer beside that of Gauss's QP."""
        found, qp = self.confirmed, "Gauss's QP in ProxSuite"
        if found is None:
            return []
        if not isinstance(found, Confirmation):
            return [f"  {qp} has no answer to compare: {in_options(str(found))}"]
        slips = found.law.kind != self.solution.law.kind
        which = f"a point slips; under --law {found.law} {qp}" if slips else qp
        verdict = "gives the same" if found.same else "gives ANOTHER ANSWER"
        return [f"  {which} {verdict}: a differs by {found.a:.1e} m/s2 at most, f where it is unique by {found.f:.1e} N"]

    def _torques_table(self) -> TerminalTable:
        robot, tau = self.held.state.robot, self.held.tau
        title = f"largest {'bracing' if self.braced else 'holding'} torques"
        table = TerminalTable(title, ("joint",), ("torque [N m]", "limit [N m]", "of limit"))
        used, limited = np.abs(tau) / robot.effort_limit, np.isfinite(robot.effort_limit)
        for i in largest_first(used if limited.any() else np.abs(tau))[:LARGEST_TORQUES]:
            of_limit = share(used[i] if limited[i] else None)
            table.add_row(robot.actuated_names[i], f"{tau[i]:.3f}", _bound(robot.effort_limit[i]), of_limit)
        return table


def holding(state: State, feet: Sequence[Constraint], external: Sequence[ExternalForce]) -> Actuation | CannotHold:
    """The torques that withstand external forces, or why there are none."""
    try:
        return hold(state, feet, external=external)
    except CannotHold as error:
        return error


def confirming(solution: Solution, convex: Callable[[], Solution]) -> Confirmation | RbdError:
    """The answer, or that of the convex law where a point slips, beside that of Gauss's QP; or why there is none."""
    try:
        return confirmed_by_qp(solution if obeys_gauss(solution) else convex())
    except RbdError as error:
        return error


def strain(held: Actuation) -> list[str]:
    """How near torques and friction come to their limits."""
    robot, used, friction = held.state.robot, 1.0 - held.margins.torque, held.margins.friction
    told = []
    if np.isfinite(robot.effort_limit).any():
        worst = int(np.argmax(used))
        told.append(f"the largest torque is {share(used[worst])} of its limit ({robot.actuated_names[worst]})")
    if friction:
        most = min(friction, key=lambda name: friction[name])
        told.append(f"{most} uses {share(1.0 - friction[most])} of its friction")
    return told if held.margin else [*told, "only with friction up to its limit"]


def gives_way(limits: Iterable[Limit]) -> list[str]:
    """What would give way, in a few words."""
    pulled = " and ".join(limit.name for limit in limits if limit.kind == "push")
    kinds = {limit.kind for limit in limits}
    words = {"edge": "it tips", "friction": "its feet slip", "motor": "motors are too weak"}
    words["push"] = f"{pulled} would have to pull"
    return [told for kind, told in words.items() if kind in kinds]


MOTORS_LISTED = 3


@dataclass(frozen=True)
class RegionReport:
    """Support regions of one pose.

    Attributes:
        regions: {what it is: the region}; the first is the one asked for.
        seconds: What took how long.
    """

    regions: Mapping[str, SupportRegion]
    seconds: Mapping[str, float]

    fields: ClassVar[tuple[Field, ...]] = (
        Field("robot", (), "", "its name", lambda found: found.asked.state.robot.name),
        Field("com", ("axis",), "m", "centre of mass in W", lambda found: found.asked.state.com),
        Field("contacts", (), "", "their names", lambda found: [r.name for r in found.asked.loads.rows]),
        Field("regions", (), "", "numbers and corners of each", lambda found: {
            name: {**plain_of(r), "torque_limits": r.torque_limits, "friction": r.friction, "vertices": r.vertices,
                   "outer": r.outer, "directions": r.directions}
            for name, r in found.regions.items()
        }),
        Field("seconds", (), "s", "how long each part took"),
    )  # fmt: skip

    @property
    def asked(self) -> SupportRegion:
        """The region that was asked for."""
        return next(iter(self.regions.values()))

    def __rich__(self) -> Group:
        """How far the centre of mass is from the edge, then each region with its certificate, then its corners."""
        region, state = self.asked, self.asked.state
        rows = [("centre of mass", f"{vector(state.com)} m")]
        rows += [(name, f"{r} Largest residual: {r.residual:.1e} N") for name, r in self.regions.items()]
        if region.torque_limits:
            rows.append(("left out", "how a moving centre of mass would change gravity torques and Jacobians of this pose"))
        weight = state.robot.mass * float(np.linalg.norm(state.robot.gravity))
        numbers = facts(f"{state.robot.name}: {state.robot.mass:.3f} kg, weight {weight:.2f} N", rows)
        return Group(Text(self.verdict), numbers, *([self._corners()] if len(region.vertices) else []))

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

    def _corners(self) -> TerminalTable:
        """At each corner, what its contacts carry, and the hardest working motors."""
        region, robot = self.asked, self.asked.state.robot
        limited = bool(np.isfinite(robot.effort_limit).any())
        headings = ("x, y [m]", *(f"{r.name} [N]" for r in region.loads.rows), "hardest working motors there")
        table = TerminalTable("corners of the region", (), headings if limited else headings[:-1])
        for i, corner in enumerate(region.vertices):
            carried = [f"{np.linalg.norm(force[:3]):.1f}" for force in region.forces(i).values()]
            used = np.abs(region.tau(i)) / robot.effort_limit
            worst = largest_first(used)[:MOTORS_LISTED].tolist() if limited else []
            told = ", ".join(f"{robot.actuated_names[j]} {share(used[j], 0)}" for j in worst)
            table.add_row(vector(corner), *carried, *([told] if limited else []))
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
    ground: float | Terrain | None = None,
    joints: Sequence[str] | None = None,
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
        state = standing_on(robot, posture, ground, joints_of(joints, robot))
        feet = robot.feet(friction, on=0.0 if ground is None else ground, at=state)
        out = {"torques within limits": support_region(state, feet, torque_limits=True, margin=margin)} if torque_limits else {}
        out["torques of any size"] = support_region(state, feet, margin=margin)
    return RegionReport(out, seconds)


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
