"""The report of `rbd mechanism`: topology, mobility, assembly modes, singular poses, integrability, and what drives do."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
import pinocchio as pin
from rich.text import Text

from rbd.arrays import Array, check_seed, check_whole
from rbd.cli.terminal import in_options
from rbd.constraints.constraint import Constraint
from rbd.errors import RbdError
from rbd.mechanism import (
    Branches,
    Integrability,
    MechanismClass,
    Mobility,
    Singularities,
    SingularitiesAlong,
    Trace,
    assemble,
    branches,
    classify,
    independent_velocities,
    integrability,
    mobility,
    project_velocity,
    singularities,
    singularities_along,
    trace,
)
from rbd.mechanism.assembly import MOST_TRIES, SAME
from rbd.mechanism.poses import measured
from rbd.mechanism.singular_configurations import KINDS
from rbd.model.joints import FORCE_OF
from rbd.model.state import State
from rbd.problem.motions import Speed
from rbd.records import Field, counted
from rbd.robots.robot import Robot
from rbd.simulation.run import simulate
from rbd.simulation.trajectory import Trajectory

Answer = TypeVar("Answer")

STEPS = 360
"""Steps of the driven motion."""

MOST_FIXED = 6
"""Branches are searched by fixing the independent joints, up to this number of them."""


@dataclass(frozen=True, eq=False)
class MechanismReport:
    """Results of a mechanism, in the order of printing; those that do not apply are None, with the reason in `left_out`.

    Attributes:
        robot: The mechanism.
        state: The pose that is looked at, assembled.
        topology: Serial, branched, closed, parallel; bodies, joints, loops.
        mobility: Three ways.
        fixed: {joint: value} of the independent joints, fixed in the search for branches.
        branches: All that were found.
        here: The singularities of the pose.
        motion: One turn of the input, of a mechanism with one degree of freedom.
        along: The singularities of that motion.
        integrable: Whether the constraints of velocity are holonomic.
        driven: The mobility that the drives of its file leave.
        turn: Its motion while these make a turn, or follow their splines to the end.
        left_out: {what: why}.
    """

    robot: Robot
    state: State
    topology: MechanismClass
    mobility: Mobility
    fixed: dict[str, float]
    branches: Branches | None
    here: Singularities
    motion: Trace | None
    along: SingularitiesAlong | None
    integrable: Integrability | None
    driven: Mobility | None
    turn: Trajectory | None
    left_out: dict[str, str]

    fields: ClassVar[tuple[Field, ...]] = (
        Field("robot", (), "", "its name", lambda found: found.robot.name),
        Field("q", (), "", "the pose that is looked at", lambda found: found.state.q),
        Field("mobility", (), "", "three ways"),
        Field("redundant", (), "", "rows of J that follow from others", lambda found: list(map(str, found.mobility.redundant))),
        Field("fixed", (), "", "values of the joints that were fixed in the search for branches"),
        Field("branches", (), "", "a pose of each", lambda found: found.branches and found.branches.q),
        Field("limits", (), "", "ends of the motion", lambda found: found.motion and [x.value for x in found.motion.limits]),
        Field("singular_at", (), "", "places along it", lambda found: found.along and [s.at for s in found.along.found]),
        Field("growth", (), "", "of velocities and brackets", lambda found: found.integrable and found.integrable.growth),
        Field("driven", (), "", "the mobility that is left where the drives of its file act"),
        Field("rates", (), "", "of a driven turn: least and largest velocity of each joint", lambda found: found.rates()),
        Field("efforts", (), "", "of a driven turn: force of each drive, least, largest, mean", lambda found: found.efforts()),
        Field("left_out", (), "", "what was not computed, and why"),
    )  # fmt: skip

    def __str__(self) -> str:
        robot, found, along = self.robot, self.branches, self.along
        every = (*robot.loops(), *robot.wheels(), *robot.drives())
        kinds = [f"{c.name} ({getattr(c, 'kind', type(c).__name__)})" for c in every]
        joints = ", ".join(list(robot.model.names)[1:])
        angles = zip(self.angles().items(), self._marks(), strict=True)
        parts = {
            f"branches{self._where()}": found and "\n".join(f"{name}: {', '.join(q)}{marks}" for (name, q), marks in angles),
            "mobility": self.mobility,
            "motion": self.motion,
            "singular poses along it": along and self._passed(along),
            "integrability": self.integrable,
            f"driven by {', '.join(d.name for d in robot.drives())}": self.turn and self._driven(self.turn),
            "parts": f"{self.topology}\njoints: {joints}\nloops, wheels and drives: {', '.join(kinds) or 'none'}",
            "left out": "\n".join(f"{what}: {why}" for what, why in self.left_out.items()) or None,
            "how the branches were found": found and _first_line(found),
            "distance from singular poses (least singular value over the largest, 0 is singular)": self.here,
        }
        told = [f"{title}:\n{textwrap.indent(str(text), '  ')}" for title, text in parts.items() if text is not None]
        return "\n\n".join(["\n".join(self.verdict), *told])

    def __rich__(self) -> Text:
        """What it prints."""
        return Text(str(self))

    @property
    def verdict(self) -> list[str]:
        """In how many degrees of freedom it moves, how many branches it has, and whether this pose is singular; a line each."""
        m, name = self.mobility, self.robot.name
        if m.velocity_only:
            lines = [f"{name} has {counted(m.instantaneous, 'degree')} of freedom of velocity."]
            if (known := self.integrable) is not None:
                kind = "holonomic" if known.holonomic else "nonholonomic"
                lines[0] = f"{lines[0][:-1]} and {known.configuration_dof} of configuration: its constraints are {kind}."
        else:
            lines = [f"{name} moves with {counted(m.finite, 'degree')} of freedom." if m.moves else f"{name} does not move."]
        if self.driven is not None:
            drives = ", ".join(self.driven.driven)
            lines.append(f"Driven by {drives}, it has {counted(self.driven.instantaneous, 'degree')} of freedom left.")
        if self.branches is not None:
            count = len(self.branches)
            shown = f"; this pose is {self.shown}" if self.shown else ""
            lines.append(f"{count} branch{'es' * (count != 1)} found{self._where()}{shown}.")
        if self.here.singular:
            lines.append(f"This pose is singular: {'; '.join(KINDS[kind] for kind in self.here.singular)}.")
        else:
            lines.append("This pose is not singular.")
        return lines

    def angles(self) -> dict[str, tuple[str, ...]]:
        """{branch: its joints in words, angles in degrees}, without those that were fixed."""
        found = () if self.branches is None else self.branches.found
        return {f"branch {i}": b.joints for i, b in enumerate(found)}

    def legend(self) -> tuple[dict[str, list[str]], str]:
        """({branch: its line in the legend}, note): joint angles; of more than two joints the note names them, once."""
        told = self.angles()
        names = [words.rpartition(" ")[0].rpartition(" ")[0] for words in next(iter(told.values()), ())]
        where = f"Branches{self._where()}." if told else ""
        if len(names) < 3 or any(" at (" in words for words in next(iter(told.values()))):
            return {name: [", ".join(words)] for name, words in told.items()}, where
        values = {name: [w[len(joint) + 1 :] for joint, w in zip(names, words, strict=True)] for name, words in told.items()}
        if all(v.endswith(" deg") for each in values.values() for v in each):
            values = {name: [v.removesuffix(" deg") for v in each[:-1]] + each[-1:] for name, each in values.items()}
        return {name: [", ".join(each)] for name, each in values.items()}, f"{where} In order: {', '.join(names)}."

    def _where(self) -> str:
        """The joint values that were fixed in the search for branches, in words."""
        joints = self.robot.joints
        held = ", ".join(f"{name} at {measured(value, joints[name].unit)}" for name, value in self.fixed.items())
        return f" with {held}" if held else ""

    def _marks(self) -> list[str]:
        """What is special about each branch."""
        found = () if self.branches is None else self.branches.found
        shown = self.shown
        return [
            "".join(["; singular" * b.singular, *(f"; beyond its limits: {joint}" for joint in b.beyond_limits)])
            + "; this pose" * (f"branch {i}" == shown)
            for i, b in enumerate(found)
        ]

    def rates(self) -> dict[str, list[float]] | None:
        """{velocity: (least, largest)} of the driven turn [rad/s, m/s]."""
        if self.turn is None:
            return None
        names = [c.name for c in self.robot.joints.velocities]
        return {name: [float(v.min()), float(v.max())] for name, v in zip(names, self.turn.v.T, strict=True)}

    def efforts(self) -> dict[str, list[float]] | None:
        """{drive: (least, largest, mean over time)} of its torque or force in the driven turn [N m, N]."""
        if self.turn is None:
            return None
        forces, T = self.turn.forces, self.turn.t
        each = {drive.name: np.asarray(forces[drive.name]).reshape(len(T)) for drive in self.robot.drives()}
        return {name: [float(f.min()), float(f.max()), float(np.trapezoid(f, T) / (T[-1] - T[0]))] for name, f in each.items()}

    def _driven(self, turn: Trajectory) -> str:
        """Torques and rates while the drives make their turn."""
        joints, lines = self.robot.joints, [f"{turn.t[-1]:.4g} s, from t = 0, with no other motor:"]
        for drive, (least, most, mean) in zip(self.robot.drives(), (self.efforts() or {}).values(), strict=True):
            unit = FORCE_OF[joints[drive.joint].unit]
            mean = mean if abs(mean) > 1e-9 * max(abs(least), abs(most)) else 0.0  # rounding
            lines.append(f"{drive.name} on {drive.joint}: {least:.4g} to {most:.4g} {unit}, mean {mean:.4g}")
        rates = zip(joints.velocities, (self.rates() or {}).values(), strict=True)
        return "\n".join([*lines, *(f"{c.name}: {least:.4g} to {most:.4g} {c.unit}/s" for c, (least, most) in rates)])

    def _passed(self, along: SingularitiesAlong) -> str:
        """The singular poses on the way, at the values of the driven joint."""
        assert self.motion is not None
        at = [float(np.interp(s.at, np.arange(len(self.motion)), self.motion.input)) for s in along.found]
        name, unit = self.motion.joint, self.motion.unit
        lines = [f"{name} at {measured(value, unit)}: {s}" for value, s in zip(at, along.found, strict=True)]
        nearest = ", ".join(f"{kind} {float(d.min()):.3g}" for kind, d in along.distances.items())
        return "\n".join([*(lines or ["none found"]), f"smallest distances at the poses computed: {nearest}"])

    @property
    def shown(self) -> str:
        """Name of the branch of the examined pose; empty if it is none of those found."""
        found = () if self.branches is None else self.branches.found
        away = [self._away(b.q) for b in found]
        here = int(np.argmin(away)) if away else 0
        return f"branch {here}" if away and away[here] < SAME else ""

    def poses(self) -> dict[str, State]:
        """{name: every branch}, for the picture."""
        found = () if self.branches is None else self.branches.found
        return {f"branch {i}": State(self.robot, b.q) for i, b in enumerate(found)}

    def _away(self, q: Array) -> float:
        """Largest difference from the examined pose, modulo whole turns [m, rad]."""
        change = pin.difference(self.robot.model, self.state.q, q)
        angles = self.robot.joints.angular
        change[angles] = np.remainder(change[angles] + np.pi, 2.0 * np.pi) - np.pi
        return float(np.abs(change).max(initial=0.0))


def _first_line(found: Branches) -> str:
    """How many tries there were, and what was not asked; without the branches."""
    return "\n".join(line for line in str(found).splitlines() if not line.startswith("  branch "))


def check_tries(seed: int, tries: int) -> None:
    """Refuse invalid arguments of `report_mechanism` before computing.

    Raises:
        InputError: a seed that is no whole number from 0, tries that are none from 1 to 1,000,000.
    """
    check_seed(seed)
    check_whole("tries", tries, MOST_TRIES)


def report_mechanism(robot: Robot, q: Array, *, seed: int = 0, tries: int = 200) -> MechanismReport:
    """All results for a mechanism near a configuration.

    Args:
        robot: With its `loops`.
        q: Where to start, shape (nq,): assembled first.
        seed: Of random starts.
        tries: How many.

    Raises:
        CannotAssemble: the loops do not close; with the remaining distance.
        InputError: an invalid seed or number of tries.
    """
    check_tries(seed, tries)
    held = (*robot.loops(), *robot.wheels())
    state = assembled(robot, held, State(robot, q))
    left_out: dict[str, str] = {}
    topology, found = classify(state, held), mobility(state, held, seed=seed)
    inputs_first = dict.fromkeys([*(drive.joint for drive in robot.drives()), *robot.actuated_names])
    free = independent_velocities(state, held, prefer=tuple(inputs_first))
    fixed = _values(robot, state, free, left_out)
    every = None
    if fixed is not None and held and not found.velocity_only:
        every = _unless(left_out, "branches", lambda: branches(state, held, fixed=fixed, seed=seed, tries=tries))
    inputs = [] if fixed is None else list(fixed)
    driven = inputs if len(inputs) < robot.nv else []  # an open chain has no others
    here = singularities(state, held, inputs=driven)
    motion = along = None
    if fixed is not None and len(inputs) == 1 and driven and not found.velocity_only:
        start = fixed[inputs[0]]
        turn = (start, start + 2.0 * np.pi)
        motion = _unless(left_out, "motion", lambda: trace(state, held, joint=inputs[0], values=turn, steps=180))
        if motion is not None and len(motion) > 2:
            along = singularities_along(robot.at(motion.q[0]), held, path=motion.q, inputs=inputs)
    integrable = None
    if found.velocity_only:
        integrable = _unless(left_out, "integrability", lambda: integrability(robot.at(), held, seed=seed))
    left = driven_turn = None
    if robot.drives():
        driven_turn = _unless(left_out, "driven motion", lambda: _turn(state, held))
        left = _unless(left_out, "driven mobility", lambda: mobility(_driven_from(state, held), [*held, *robot.drives()]))
    return MechanismReport(
        robot, state, topology, found, fixed or {}, every, here, motion, along, integrable, left, driven_turn, left_out
    )  # fmt: skip


def _driven_from(state: State, held: Sequence[Constraint]) -> State:
    """The state near another one with its drives where they begin."""
    robot: Robot = state.robot  # type: ignore[assignment]
    return assembled(robot, [*held, *robot.drives()], state)


def _turn(state: State, held: Sequence[Constraint]) -> Trajectory:
    """The motion while the drives of the robot's file make a turn, a second of what slides, or their splines once."""
    robot: Robot = state.robot  # type: ignore[assignment]
    longest, constraints = 0.0, [*held, *robot.drives()]
    for drive in robot.drives():
        motion: Any = drive.motion
        if isinstance(motion, Speed):
            speed = abs(float(np.asarray(motion.rate)))
            lasts = 2.0 * np.pi / speed if speed and robot.joints[drive.joint].is_angle else 1.0
        else:
            lasts = float(motion.x[-1])
        longest = max(longest, lasts)
    start = project_velocity(_driven_from(state, held), constraints)
    return simulate(start, constraints, duration=longest, step=longest / STEPS)


def assembled(robot: Robot, constraints: Sequence[Constraint], near: State) -> State:
    """The state near another one with its loops closed and its wheels on the ground.

    Raises:
        CannotAssemble: the loops do not close.
    """
    rows = [(c, c.rows(near)) for c in constraints]
    placed = [c for c, r in rows if r.error is not None and (r.holonomic is None or r.holonomic.any())]
    return State(robot, assemble(near, placed).q) if placed else near


def _values(robot: Robot, state: State, free: Sequence[str], left_out: dict[str, str]) -> dict[str, float] | None:
    """{joint: its value} of the independent velocities; None, with the reason, if a joint has several of them."""
    if len(free) > MOST_FIXED:
        left_out["branches"] = f"{len(free)} degrees of freedom; they are fixed to find branches, at most {MOST_FIXED}"
        return None
    out = {}
    for name in free:
        if name not in robot.model.names:
            left_out["branches"] = f"{name} belongs to a joint with several degrees of freedom"
            return None
        joint = robot.model.joints[robot.joint_id(name)]
        q = state.q[joint.idx_q : joint.idx_q + joint.nq]
        out[name] = float(np.arctan2(q[1], q[0])) if joint.nq == 2 else float(q[0])
    return out


def _unless(left_out: dict[str, str], what: str, ask: Callable[[], Answer]) -> Answer | None:
    """The result; if there is none, the reason goes to `left_out`."""
    try:
        return ask()
    except RbdError as why:
        left_out[what] = in_options(str(why))
        return None
