"""What `rbd simulate` simulates by default, and its report: tables for the terminal, plain data for a file."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
import pinocchio as pin
from rich.console import Group
from rich.text import Text

from rbd.cli.ground_option import standing_on
from rbd.cli.mechanism_report import assembled
from rbd.cli.terminal import facts, joints_of, numbers_of, save_figure
from rbd.constraints import joint_limits
from rbd.constraints.collision import CollisionContacts
from rbd.constraints.constraint import Constraint
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.posture_control import HoldPosture
from rbd.control.schedules import Controller, Push
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.records import Field, counted, fixed, share, vector
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import Root
from rbd.robots.robot import Robot
from rbd.simulation.simulated_motion import OPEN, SLIPS
from rbd.simulation.trajectory import Trajectory

MOST_JOINTS = 8
FALLEN = 0.6
"""A robot whose centre of mass is below this share of its height over its feet at the start has fallen."""
STILL = 1e-2
"""Below this speed of its centre of mass [m/s] a robot counts as at rest."""


@dataclass(frozen=True, eq=False)
class SimulateReport:
    """A motion, what was simulated, and how it ended.

    Attributes:
        trajectory: The motion, from its first sample to its last.
        setup: What was simulated.
        pushes: What pushed it.
        seconds: {what: time taken [s]}.
    """

    trajectory: Trajectory
    setup: SimulationSetup
    pushes: Sequence[Push]
    seconds: Mapping[str, float]

    fields: ClassVar[tuple[Field, ...]] = (
        Field("robot", (), "", "its name", lambda found: found.trajectory.robot.name),
        Field("mass", (), "kg", "of the robot", lambda found: found.trajectory.robot.mass),
        Field("setup", (), "", "what was simulated", lambda found: found.setup.summary),
        Field("limits", (), "", "what the model neglects", lambda found: found.setup.limits),
        Field("pushes", (), "", "what pushed it"),
        Field("verdict", (), "", "whether a robot with feet is standing at the end"),
        Field("step", (), "s", "length of a step", lambda found: found.trajectory.step),
        Field("steps", (), "1", "number of steps"),
        Field("integrator", (), "", "method of integration", lambda found: found.trajectory.integrator),
        Field("law", (), "", "law of the contact forces", lambda found: found.trajectory.law),
        Field("reason", (), "", "why it ended early", lambda found: found.trajectory.end_reason),
        Field("reason_code", (), "", "the same as a code", lambda found: found.trajectory.end_reason.code),
        Field("motion", (), "", "its end, its extremes and its certificate", lambda found: found.trajectory),
        Field("largest_kinetic", (), "J", "largest kinetic energy", lambda found: found.trajectory.kinetic.max()),
        Field("elastic", (), "J", "elastic energy at the end", lambda found: found.trajectory.elastic[-1]),
        Field("dissipated", (), "J", "energy lost", lambda found: found.trajectory.dissipated[-1]),
        Field(
            "residuals", (), "", "the largest of each",
            lambda found: {name: np.abs(r).max() for name, r in found.trajectory.residuals.items()},
        ),
        Field(
            "residuals_at", (), "s", "when it was",
            lambda found: {name: found.trajectory.t[np.abs(r).argmax()] for name, r in found.trajectory.residuals.items()},
        ),
        Field("constraints", (), "", "mode and force of each at the end, and its largest force and when that was"),
        Field("events", (), "", "beginnings and ends of contact", lambda found: found.trajectory.events),
        Field("seconds", (), "s", "how long each part took"),
    )  # fmt: skip

    @property
    def constraints(self) -> dict[str, dict[str, Any]]:
        """{constraint: its mode and its force at the end, the largest size of its force [N or N m] and when that was [s]}."""
        x, out = self.trajectory, {}
        for name, force in x.forces.items():
            size = np.linalg.norm(force[:, :3], axis=1)
            most = int(size.argmax())
            largest = {"largest": size[most], "largest_at": x.t[most]}
            out[name] = {"mode": str(x.modes[name][-1]), "force": force[-1], **largest}
        return out

    @property
    def steps(self) -> int:
        """Number of steps taken."""
        return math.ceil(self.trajectory.duration / self.trajectory.step - 1e-6)

    @property
    def height(self) -> tuple[float, float]:
        """Heights of the centre of mass over the lowest point of the feet at the start: at the start and at the end [m]."""
        x = self.trajectory
        ground = min(float(np.nanmin(x.points[name][0, :, 2])) for name in self.setup.feet)
        return float(x.com[0, 2]) - ground, float(x.com[-1, 2]) - ground

    @property
    def speed(self) -> float:
        """Speed of the centre of mass at the end [m/s]."""
        return float(np.linalg.norm(self.trajectory.momentum[-1, :3])) / self.trajectory.robot.mass

    @property
    def verdict(self) -> str:
        """Whether a robot with feet is standing at the end; empty for one without."""
        feet = [name for name in self.setup.feet if name in self.trajectory.points]
        if not feet:
            return ""
        modes = {name: str(self.trajectory.modes[name][-1]) for name in feet}
        closed = [name for name in feet if modes[name] != OPEN]
        start, end = self.height
        if end < FALLEN * start:
            return f"it has fallen: its centre of mass is {end:.3f} m over where it stood, {start:.3f} m at the start"
        if not closed:
            return "it is in the air"
        rest = f", its centre of mass {end:.3f} m high, {start:.3f} m at the start"
        if len(closed) < len(feet):
            there = f"it is on {', '.join(closed)} alone{rest}"
        else:
            slips = [name for name in feet if modes[name] == SLIPS]
            there = f"it stands on {', '.join(closed)}{' (' + ', '.join(slips) + ' slipping)' if slips else ''}{rest}"
        return there + (f", and moves at {self.speed:.3g} m/s" if self.speed > STILL else ", at rest")

    def __rich__(self) -> Group:
        """How it ended, then the motion with its certificate, then what it has not, and the largest torque."""
        x = self.trajectory
        rows = [*self._places(), ("largest torque", busiest_motor(x))]
        rows += [("" if i else "left out", limit) for i, limit in enumerate(self.setup.limits)]
        head = Text(f"{x.robot.name}: {x.robot.mass:.3f} kg, {self.setup.summary}")
        lines = [Text(f"  pushed with {push}") for push in self.pushes]
        return Group(Text(self.answer, style="bold"), head, *lines, Text(f"\n{x}"), facts(None, rows))

    @property
    def answer(self) -> str:
        """How it ended: whether a robot on feet fell; of others how far and how long it moved."""
        x = self.trajectory
        if self.verdict:
            return f"After {x.duration:g} s {self.verdict}."
        moved = float(np.linalg.norm(x.com[-1] - x.com[0]))
        return (
            f"After {x.duration:g} s {x.robot.name} has moved its centre of mass by {moved:.4g} m; its energy changed by "
            f"{x.energy[-1] - x.energy[0]:.3g} J."
        )

    def _places(self) -> list[tuple[str, str]]:
        """Where its base ends, or each joint with one degree of freedom."""
        first, last = self.trajectory.state(0), self.trajectory.state(-1)
        if first.robot.floating:
            begun, ended = first.base_pose(), last.base_pose()
            turned = math.degrees(np.linalg.norm(pin.log3(begun.rotation.T @ ended.rotation)))
            moved = vector(ended.translation - begun.translation, 4)
            return [("base", f"{vector(ended.translation, 4)} m, moved by {moved} m, turned by {turned:.2f} deg")]
        single = [joint for joint in first.robot.joints.values() if joint.nv == 1]
        rows = [
            (j.name, f"{fixed(j.coordinate(first.q), 4)} to {fixed(j.coordinate(last.q), 4)} {j.unit}, "
                     f"at {fixed(last.v[j.v.start], 4)} {j.unit}/s")
            for j in single[:MOST_JOINTS]
        ]  # fmt: skip
        left = len(single) - len(rows)
        return [*rows, ("", f"and {counted(left, 'more joint')}")] if left else rows


def draw(trajectory: Trajectory, path: Path) -> Path:
    """Forces (where there are any) above energies, over time; returns its path.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    panels = (trajectory.plot_forces, trajectory.plot_energy) if trajectory.forces else (trajectory.plot_energy,)
    figure = Figure(figsize=(9.0, 4.0 * len(panels)), layout="constrained")
    for panel, axes in zip(panels, figure.subplots(len(panels), squeeze=False)[:, 0], strict=True):
        panel(axes)
    return save_figure(figure, path, dpi=120)


def busiest_motor(x: Trajectory) -> str:
    """The motor that comes nearest to its limit, or has the largest torque if no limit is stated."""
    robot: CheckedModel = x.robot
    if not np.abs(x.tau).max(initial=0.0):
        return "none"
    used = robot.torque_use(x.tau, x.v)
    size = used if used.max() > 0.0 else np.abs(x.tau)
    at, i = np.unravel_index(int(np.argmax(size)), size.shape)
    of_limit = f", {share(used[at, i])} of its limit" if np.isfinite(robot.effort_limit[i]) else ""
    return f"{robot.actuated_names[i]}: {x.tau[at, i]:.3f} N m{of_limit}, at {x.t[at]:.3f} s"


Value = TypeVar("Value")

BODIES = "bodies_on_ground"
"""Name of the contacts of all bodies but the feet."""
FAR = 1e5
"""Distance from the ground [m] within which shapes are searched when a body is placed on it."""


@dataclass(frozen=True, eq=False)
class SimulationSetup:
    """Setup of a simulation.

    Attributes:
        state: Where it starts.
        constraints: In force throughout.
        feet: Names of its feet; empty if it does not stand.
        controller: Controller of the motors; None for none.
        summary: What it does, in short.
        limits: What the model neglects, a sentence each.
    """

    state: State
    constraints: tuple[Constraint, ...]
    feet: tuple[str, ...]
    controller: Controller | None
    summary: str
    limits: tuple[str, ...]


def loaded(
    name: str,
    *,
    root: Root | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    feet: Sequence[str] | None = None,
) -> Robot:
    """The robot; one with motors that neither has feet nor loops nor wheels has a fixed base, unless `root` gives another."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        robot = load_robot(name, root=root, package_dirs=package_dirs, feet=feet)
    said = root is not None or robot.mechanism.file.root is not None
    stands = bool(robot.source.feet or robot.loops() or robot.wheels())
    if said or stands or not robot.floating or not robot.nu or robot.urdf.suffix != ".urdf":
        for warning in caught:
            warnings.warn(warning.message, warning.category, stacklevel=2)
        return robot
    return load_robot(name, root="fixed", package_dirs=package_dirs)  # which warns of the robot as it is used


def setup(
    robot: Robot,
    *,
    posture: str | None = None,
    friction: float = 0.7,
    hold: bool | None = None,
    bodies: bool | None = None,
    stops: bool = False,
    ground: float | Terrain | None = None,
    joints: Sequence[str] | None = None,
) -> SimulationSetup:
    """Default setup for a robot.

    On feet, where they are known: frictional soles or points, the posture held. With loops or wheels: these hold, and its
    motors without torque. Else the posture of a fixed arm, held.

    Args:
        robot: The robot.
        posture: Where it starts, by name; the standing one, else the file's first, else neutral.
        friction: Coulomb's coefficient of its feet.
        hold: Whether its motors hold the posture; None: as above.
        bodies: Whether all other collision shapes of its file may touch the ground z = 0 too; what has no feet and floats is
            then laid on it. None: where a robot on feet has such shapes, so that one that falls ends on the ground.
        stops: Whether its joints stop at the limits of its file.
        ground: What it touches; None: z = 0.
        joints: Values that replace those of the posture, NAME=VALUE each, as of `--joint`.

    Raises:
        CannotHold: the posture cannot be held; names the limit that prevents it.
        CannotAssemble: its loops do not close.
        CannotReach: its feet do not come onto the ground.
        InputError: unknown names, a friction that is none, ground for a robot that touches nothing.
    """
    held = (*robot.loops(), *robot.wheels())
    feet: tuple[Constraint, ...] = ()
    on, angles = 0.0 if ground is None else ground, joints_of(joints, robot)
    if robot.source.feet and robot.floating:
        state = standing_on(robot, posture, ground, angles)
        feet = tuple(robot.feet(friction, on=on, at=state))
    else:
        name = posture or robot.source.posture or next(iter(robot.postures), None)
        state = assembled(robot, held, robot.at(name).with_joints(angles))
    soles = {robot.site(contact.frame)[0] for contact in feet}  # type: ignore[attr-defined]
    shapes = tuple(g.name for g in robot.collision_model.geometryObjects if g.parentJoint not in {0, *soles})
    if bodies is None:
        bodies = bool(feet and shapes)
    if ground is not None and not feet and not bodies:
        raise InputError(f"--ground is of no use: {robot.name} has no feet that are known, and touches nothing (--bodies).")
    constraints = (*feet, *held)
    holds = bool(feet) or not (held or robot.floating) if hold is None else hold
    controller = HoldPosture(state, constraints) if holds and robot.nu else None
    limits = []
    if feet and not bodies:
        limits.append("only its feet touch the ground: the run stops where it falls through it (--bodies: all shapes touch)")
    elif not feet and not robot.wheels() and not bodies and robot.root != "fixed":
        limits.append("it touches nothing (--bodies lets all shapes touch the ground)")
    if bodies:
        others = CollisionContacts(BODIES, robot, friction=friction, ground=shapes, on=on)
        constraints = (*constraints, others)
        if robot.floating and not (feet or held):
            state = _laid(state, others)
    if stops:
        constraints = (*constraints, *joint_limits(robot))
    limits.append("bodies do not touch each other" + ("" if stops else ", and joints do not stop at their limits (--stops)"))
    limits.append("rigid bodies; damping and friction of the joints in the robot's file are left out")
    summary = _summary(state, feet, held, controller)
    return SimulationSetup(state, constraints, tuple(c.name for c in feet), controller, summary, tuple(limits))


def pushes(
    forces: Sequence[str], frames: Sequence[str], starts: Sequence[float], durations: Sequence[float]
) -> tuple[Push, ...]:
    """The pushes of the command line: one of each a push, or one for all.

    Raises:
        InputError: numbers of options that do not fit, a force that is not three numbers.
    """
    n = len(forces)
    if not n:
        for option, given in (("--at", frames), ("--from", starts), ("--for", durations)):
            if given:
                raise InputError(f"{option} came without --push X,Y,Z; e.g. --push 0,80,0 --at torso_2_link.")
        return ()
    if not frames:
        raise InputError("--push came without --at FRAME; a push wants both, e.g. --push 0,80,0 --at torso_2_link.")
    at = _one_each("--at", frames, n)
    start = _one_each("--from", starts or (0.0,), n)
    lasting = _one_each("--for", durations or (0.1,), n)
    vectors = [numbers_of("--push", force, "newtons", names="X,Y,Z") for force in forces]
    return tuple(Push(f, v, start=s, duration=d) for f, v, s, d in zip(at, vectors, start, lasting, strict=True))


def _one_each(option: str, given: Sequence[Value], n: int) -> Sequence[Value]:
    if len(given) not in (1, n):
        raise InputError(f"{option} came {len(given)} times with {n} times --push; give it once for all, or once a push.")
    return list(given) * n if len(given) == 1 else given


def _laid(state: State, contacts: CollisionContacts) -> State:
    """Moved up or down until its lowest shape touches the ground."""
    gaps = contacts.with_margin(FAR).points(state).gaps
    if not len(gaps):
        return state
    q = state.q.copy()
    q[2] -= float(gaps.min())
    return State(state.robot, q)


def _summary(state: State, feet: Sequence[Constraint], held: Sequence[Constraint], controller: Controller | None) -> str:
    robot = state.robot
    on = ", ".join(c.name for c in (*feet, *held))
    where = "fixed" if not robot.floating and not held else ""
    where = f"on {on}" if on else where or "free"
    return f"{where}, {'holding its posture' if controller else 'motors without torque' if robot.nu else 'without motors'}"
