"""What `rbd simulate` simulates by default, and its report: tables for the terminal, plain data for a file."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.arrays import Array
from rbd.cli.mechanism_report import assembled
from rbd.cli.terminal import TerminalTable, counted, facts, numbers_of, rounded, save_figure
from rbd.constraints import joint_limits
from rbd.constraints.collision import CollisionContacts
from rbd.constraints.constraint import Constraint
from rbd.control.posture_control import HoldPosture
from rbd.control.schedules import Controller, Push
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import Root
from rbd.robots.robot import Robot
from rbd.simulation.simulated_motion import HOLDS, OPEN, SLIPS
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_fields import RESIDUALS

EVENTS = 8
"""Largest number of events printed; all are in the file."""
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
        verbose: Whether that is printed.
    """

    trajectory: Trajectory
    setup: SimulationSetup
    pushes: Sequence[Push]
    seconds: Mapping[str, float]
    verbose: bool = False

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

    def data(self) -> dict[str, Any]:
        """All results as numbers, lists and text: SI units, world axes, forces on the robot."""
        x = self.trajectory
        robot = x.robot
        worst = {c.name: (x.residuals[c.name], c.unit) for c in RESIDUALS}
        sizes = {name: (np.abs(r), unit) for name, (r, unit) in worst.items()}
        residuals = {name: {"value": float(r.max()), "at": self._when(r), "unit": unit} for name, (r, unit) in sizes.items()}
        return {
            "robot": robot.name,
            "mass": robot.mass,
            "setup": self.setup.summary,
            "limits": list(self.setup.limits),
            "pushes": [{"force": np.asarray(p.force).tolist(), "frame": p.frame, "from": float(p.start),
                        "for": float(p.duration)} for p in self.pushes],
            "duration": x.duration,
            "step": x.step,
            "steps": self.steps,
            "integrator": x.integrator,
            "law": x.law,
            "ended": x.interrupted,
            "reason": str(x.end_reason),
            "reason_code": x.end_reason.code,
            "verdict": self.verdict,
            "energy": {"start": float(x.energy[0]), "end": float(x.energy[-1]), "change": float(x.energy[-1] - x.energy[0]),
                       "largest_kinetic": float(x.kinetic.max()), "motor_work": float(x.motor_work[-1]),
                       "elastic": float(x.elastic[-1]), "dissipated": float(x.dissipated[-1])},
            "residuals": residuals,
            "constraints": {name: self._constraint(name) for name in x.forces},
            "events": [{"t": e.t, "name": e.name, "kind": e.kind, "point": e.point, "speed": e.speed, "impulse": e.impulse}
                       for e in x.events],
            "centre_of_mass": {"start": x.com[0].tolist(), "end": x.com[-1].tolist()},
            "base": None if not robot.floating else {"start": x.q[0, :7].tolist(), "end": x.q[-1, :7].tolist()},
            "q": x.q[-1].tolist(),
            "v": x.v[-1].tolist(),
            "seconds": dict(self.seconds),
            "steps_per_second": self.steps / self.seconds["simulate"],
        }  # fmt: skip

    def _constraint(self, name: str) -> dict[str, Any]:
        x = self.trajectory
        size = self._sizes(name)
        most = int(np.argmax(size))
        kinds = [e.kind for e in x.events if e.name == name]
        return {
            "mode": str(x.modes[name][-1]),
            "largest": {"value": float(size[most]), "at": float(x.t[most])},
            "force": x.forces[name][-1].tolist(),
            "touches": kinds.count("touches"),
            "leaves": kinds.count("leaves"),
        }

    def _sizes(self, name: str) -> Array:
        """Of a contact's force, else of the largest row force, at each sample."""
        force = self.trajectory.forces[name]
        if not force.shape[1]:
            return np.zeros(len(force))
        return np.linalg.norm(force[:, :3], axis=1) if name in self.trajectory.points else np.abs(force).max(axis=1)

    def _when(self, values: Array) -> float:
        return float(self.trajectory.t[int(np.argmax(values))])

    def __rich__(self) -> Group:
        """How it ended, then the tables, then the proof."""
        parts = [self._motion_table(), self._proof_table()]
        if self.trajectory.forces:
            parts.insert(0, self._constraints_table())
        if self.trajectory.events:
            parts.insert(1, self._events_table())
        return Group(Text(self.answer, style="bold"), Text(self._headline()), *parts)

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

    def _headline(self) -> str:
        x = self.trajectory
        what = f"{x.robot.name}: {x.robot.mass:.3f} kg, {self.setup.summary}"
        return what + "".join(f"\n  pushed with {push}" for push in self.pushes)

    def _constraints_table(self) -> TerminalTable:
        x = self.trajectory
        numbers = ("at the end", "force at the end [N]", "largest force [N]", "at [s]", "touches", "leaves")
        table = TerminalTable("constraints", ("constraint",), numbers)
        idle = 0
        for name in x.forces:
            known = self._constraint(name)
            if name not in self.setup.feet and not known["largest"]["value"] and known["mode"] == OPEN:
                idle += 1
                continue
            contact = name in x.points and x.forces[name].shape[1]
            force = rounded(x.forces[name][-1, :3], 2) if contact else "-"
            largest = known["largest"]
            table.add_row(
                name, known["mode"], force, f"{largest['value']:.2f}", f"{largest['at']:.3f}",
                str(known["touches"]), str(known["leaves"]),
            )  # fmt: skip
        if idle:
            table.add_row(f"{idle} more that never act", *[""] * 6)
        return table

    def _events_table(self) -> TerminalTable:
        events = self.trajectory.events
        more = f"; {len(events) - EVENTS} more" if len(events) > EVENTS else ""
        table = TerminalTable(f"{counted(len(events), 'event')}{more}", ("at [s]", "what"))
        for event in events[:EVENTS]:
            table.add_row(f"{event.t:.6f}", str(event).split(": ", 1)[1])
        return table

    def _motion_table(self) -> TerminalTable:
        x = self.trajectory
        steps = f"{counted(self.steps, 'step')} of {1e3 * x.step:g} ms"
        rows = [("time", f"{x.t[0]:g} to {x.t[-1]:g} s, {steps}")]
        rows += [("ended early", x.interrupted)] if x.interrupted else []
        rows += self._places()
        motor, e = _busiest_motor(x), x.energy
        rows += [("largest torque", motor)] if motor else []
        change = f"change {e[-1] - e[0]:.3g} J, kinetic at most {x.kinetic.max():.4g} J"
        change += f", work of the motors {x.motor_work[-1]:.3g} J" if motor else ""
        return facts("motion", [*rows, ("energy", f"{e[0]:.6g} J to {e[-1]:.6g} J: {change}")])

    def _places(self) -> list[tuple[str, str]]:
        x = self.trajectory
        robot = x.robot
        out = [("centre of mass", f"({rounded(x.com[-1], 4)}) m, moved by ({rounded(x.com[-1] - x.com[0], 4)}) m")]
        if robot.floating:
            first, last = x.state(0).base_pose(), x.state(-1).base_pose()
            turned = np.degrees(np.arccos(np.clip((np.trace(first.rotation.T @ last.rotation) - 1.0) / 2.0, -1.0, 1.0)))
            moved = rounded(last.translation - first.translation, 4)
            out.append(("base", f"({rounded(last.translation, 4)}) m, moved by ({moved}) m, turned by {turned:.2f} deg"))
        else:
            out += _joints(x.state(0), x.state(-1))
        return out

    def _proof_table(self) -> TerminalTable:
        x = self.trajectory
        rows = [("method", f"{x.integrator}" + (f", law: {x.law}" if "TimeStepping" in x.integrator else ""))]
        bilateral = any((modes == HOLDS).any() for modes in x.modes.values())
        asked = {"drift": bilateral, "drift_rate": bilateral, "penetration": bool(x.points)}
        for name, unit in [(c.name, c.unit) for c in RESIDUALS if asked.get(c.name, True)]:
            size = np.abs(x.residuals[name])
            worst = float(size.max())
            at = f" at {self._when(size):.3f} s" if worst else ""
            rows.append((f"worst {name.replace('_', ' ')}", f"{worst:.1e} {'(scaled)' if unit == '1' else unit}{at}"))
        rows += [("" if i else "left out", limit) for i, limit in enumerate(self.setup.limits)]
        if self.verbose:
            pace = self.steps / self.seconds["simulate"]
            times = ", ".join(f"{what} {t:.2f} s" for what, t in self.seconds.items())
            rows.append(("times", f"{times}; {pace:.0f} steps/s, {pace * x.step:.2g} x real time"))
        return facts("proof", rows)


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


def _joints(first: State, last: State) -> list[tuple[str, str]]:
    """Final position of each joint with one degree of freedom."""
    model = first.robot.model
    single = [i for i in range(1, model.njoints) if model.joints[i].nv == 1]
    out: list[tuple[str, str]] = []
    for i in single[:MOST_JOINTS]:
        joint = model.joints[i]
        straight = joint.shortname().startswith("JointModelP")
        per_second, unit = ("m/s", "m") if straight else ("rad/s", "rad")
        q0, q1 = (_coordinate(s.q[joint.idx_q : joint.idx_q + joint.nq]) for s in (first, last))
        out.append(
            (model.names[i], f"{q0 + 0.0:.4f} to {q1 + 0.0:.4f} {unit}, at {last.v[joint.idx_v] + 0.0:.4f} {per_second}")
        )
    left = len(single) - len(out)
    return [*out, ("", f"and {counted(left, 'more joint')}")] if left else out


def _coordinate(q: Array) -> float:
    """Value of a joint with one degree of freedom; the angle if it is stored as a cosine and a sine."""
    return float(q[0] if len(q) == 1 else math.atan2(q[1], q[0]))


def _busiest_motor(x: Trajectory) -> str:
    """The motor that comes nearest to its limit, or has the largest torque if no limit is stated."""
    robot: CheckedModel = x.robot
    if not robot.nu or not np.abs(x.tau).max(initial=0.0):
        return ""
    used = robot.torque_use(x.tau, x.v)
    if not used.max() > 0.0:
        used = np.abs(x.tau)
    at, i = np.unravel_index(int(np.argmax(used)), used.shape)
    limit = robot.effort_limit[i]
    share = f", {100 * used[at, i]:.1f} % of its limit" if np.isfinite(limit) else ""
    return f"{robot.actuated_names[i]}: {x.tau[at, i]:.3f} N m{share}, at {x.t[at]:.3f} s"


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
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
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

    Raises:
        CannotHold: the posture cannot be held; names the limit that prevents it.
        CannotAssemble: its loops do not close.
        InputError: unknown names, a friction that is none.
    """
    held = (*robot.loops(), *robot.wheels())
    feet: tuple[Constraint, ...] = ()
    if robot.source.feet and robot.floating:
        state, feet = robot.standing(posture), tuple(robot.feet(friction))
    else:
        name = posture or robot.source.posture or next(iter(robot.postures), None)
        state = assembled(robot, held, robot.at(name))
    if bodies is None:
        bodies = bool(feet) and bool(_other_shapes(robot, feet))
    constraints = (*feet, *held)
    holds = bool(feet) or not (held or robot.floating) if hold is None else hold
    controller = HoldPosture(state, constraints) if holds and robot.nu else None
    limits = []
    if feet and not bodies:
        limits.append("only its feet touch the ground: the run stops where it falls through it (--bodies: all shapes touch)")
    elif not feet and not robot.wheels() and not bodies and robot.root != "fixed":
        limits.append("it touches nothing (--bodies lets all shapes touch the ground)")
    if bodies:
        others = _others(robot, feet, friction)
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


def _others(robot: Robot, feet: Sequence[Constraint], friction: float) -> CollisionContacts:
    """Contacts of all moving shapes, except those that the feet's contacts represent."""
    return CollisionContacts(BODIES, robot, friction=friction, ground=_other_shapes(robot, feet))


def _other_shapes(robot: Robot, feet: Sequence[Constraint]) -> tuple[str, ...]:
    """Names of the moving collision shapes, except those of the feet's bodies."""
    soles = {robot.site(contact.frame)[0] for contact in feet}  # type: ignore[attr-defined]
    return tuple(g.name for g in robot.collision_model.geometryObjects if g.parentJoint not in {0, *soles})


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
