"""Torques at joints, loops, stops and gears, and points between bodies, among the marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, closes_loop, frames_of, member
from rbd.constraints.contact_points import ContactPoints
from rbd.model.external import generalised
from rbd.model.state import State
from rbd.visual import shapes
from rbd.visual.marks.mark import (
    FULL_TURN,
    SMALLEST_ARC,
    Label,
    Mark,
    Sizes,
    force_arrow,
    moment_marks,
    node,
    number,
    numbers,
    share_color,
    tip_of,
)
from rbd.visual.shapes import Mesh
from rbd.visual.style import LIMITED_COLOR

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.problem.rows import Rows
    from rbd.statics.actuation import Actuation

NO_LIMIT_COLOR = "#7f7f7f"
"""Of a motor whose limit the robot's file does not state."""
BAR = 0.2
"""Length of the bar of a sliding joint at its limit, in sizes of the robot."""
NOTHING = 1e-9
"""Torques below this share of the largest are rounding."""
MOST_JOINTS = 2
"""A constraint on more joints than this is told in words, not drawn."""


@dataclass(frozen=True, eq=False, slots=True)
class ShownTorque:
    """A torque about a joint's axis, or a force along it, on the body that the joint moves; its parent gets the opposite.

    Attributes:
        name: Of the coordinate: the joint's name where it has one degree of freedom.
        point: The joint's origin in W, shape (3,) [m].
        axis: The joint's axis in W, a unit vector, shape (3,).
        value: [N m], or [N] of a sliding joint.
        slides: Whether it is a force along the axis.
        limit: Largest value in its direction, at the joint's speed; inf where none is stated.
        by: Name of the constraint that makes it; empty of a motor.
    """

    name: str
    point: Array
    axis: Array
    value: float
    slides: bool
    limit: float = np.inf
    by: str = ""

    @property
    def share(self) -> float | None:
        """Of the limit that is used, >= 0; None where no limit is stated."""
        if not np.isfinite(self.limit):
            return None
        return abs(self.value) / self.limit if self.limit else float(np.inf if self.value else 0.0)

    @property
    def unit(self) -> str:
        """Of `value` and `limit`."""
        return "N" if self.slides else "N m"

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        share, what = self.share, "force" if self.slides else "torque"
        if self.by:
            return f"{number(self.value)} {self.unit}", f"{what} of {self.by} on joint {self.name}"
        if share is None:
            return f"{number(self.value)} {self.unit}", f"{what} of the motor; the robot's file states no limit"
        used = f"{100.0 * share:.1f} % of {number(self.limit)} {self.unit}"
        return f"{number(self.value)} {self.unit}, {100.0 * share:.0f} %", f"{what} of the motor: {used}"


def motor_torques(state: State, solution: Solution | Actuation | None) -> list[ShownTorque]:
    """The motors' torques of a solution, in the order of tau; none where they are not known.

    An actuation has them; of a solution they are what its equations of motion hold besides bias and external forces.
    """
    robot = state.robot
    tau = _tau(solution)
    if tau is None or len(tau) != robot.nu:
        return []
    where = [int(i) for i in robot.actuated]
    names = [c.name for c in robot.motor_coordinates]
    axes = joint_axes(state, where)
    least, most = robot.limits_at(state.v)
    limits = np.where(tau < 0.0, -least, most)
    return [
        ShownTorque(name, point, axis, float(value), slides, float(limit))
        for name, (point, axis, slides), value, limit in zip(names, axes, tau, limits, strict=True)
    ]


def _tau(solution: Any) -> Array | None:
    given = getattr(solution, "tau", None)
    if given is not None:
        return np.asarray(given, float)
    problem: Any = getattr(solution, "problem", None)
    origin: Any = getattr(problem, "origin", None)
    if not isinstance(getattr(origin, "state", None), State):
        return None  # a problem built by hand, or one that came from another process
    state, rhs = origin.state, np.asarray(problem.rhs)
    parts = [rhs, state.h, generalised(state, origin.external)[0]]
    tau = (parts[0] + parts[1] - parts[2])[state.robot.actuated]
    rounding = NOTHING * max(float(np.abs(part).max(initial=0.0)) for part in parts)
    return np.where(np.abs(tau) > rounding, tau, 0.0)


def joint_axes(state: State, coordinates: Sequence[int]) -> list[tuple[Array, Array, bool]]:
    """(origin [m], unit axis, whether it slides) in W of some coordinates of v."""
    model, data = state.robot.model, state.robot.model.createData()
    pin.computeJointJacobians(model, data, np.asarray(state.q, float))
    owner = {i: j for j in range(1, model.njoints) for i in range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])}
    out = []
    for i in coordinates:
        j = owner[i]
        column = pin.getJointJacobian(model, data, j, pin.LOCAL_WORLD_ALIGNED).reshape(6, model.nv)[:, i]
        slides = float(np.linalg.norm(column[3:])) < 1e-9
        axis = column[:3] if slides else column[3:]
        out.append((np.array(data.oMi[j].translation), axis / np.linalg.norm(axis), slides))
    return out


def constraint_torques(state: State, rows: Rows, forces: Array) -> list[ShownTorque] | None:
    """The torques J^T f of a constraint on single joints (a stop, a brake, a gear); None if it is not of that kind.

    Args:
        state: The robot.
        rows: The constraint's, without a resultant.
        forces: f, shape (m,).
    """
    joints = state.robot.joints
    touched = np.flatnonzero(np.abs(rows.J).max(axis=0, initial=0.0) > 0.0)
    single = {joint.v.start: joint.name for joint in joints.values() if joint.nv == 1}
    if not len(touched) or len(touched) > MOST_JOINTS or any(int(i) not in single for i in touched):
        return None
    torques = rows.J.T @ forces
    axes = joint_axes(state, [int(i) for i in touched])
    return [
        ShownTorque(single[int(i)], point, axis, float(torques[i]), slides, by=rows.name)
        for i, (point, axis, slides) in zip(touched, axes, strict=True)
    ]


def torque_marks(torques: Sequence[ShownTorque], sizes: Sizes) -> list[Mark]:
    """Of every motor an arc about its axis, or a bar along it, whose length and colour are the share of the limit used.

    A thin pale ring, or line, is the whole limit. Motors without a stated limit are grey, relative to the largest of them.
    """
    unknown = {slides: max([abs(t.value) for t in torques if t.share is None and t.slides is slides], default=0.0) for slides in
               (False, True)}  # fmt: skip
    marks = []
    for t in torques:
        share, color = t.share, NO_LIMIT_COLOR
        if share is None:
            share = abs(t.value) / unknown[t.slides] if unknown[t.slides] else 0.0
        else:
            color = share_color(share)
        at, size = f"torques/{node(t.name)}", float(np.copysign(min(share, 1.0), t.value))
        heads = 2 if share > 1.0 else 1
        mesh, track = _bar(t, size, sizes) if t.slides else _arc(t, size, heads, sizes)
        label = Label(t.name, t.lines, t.point + sizes.arc * t.axis)
        marks.append(Mark(f"{at}/limit", track, color, 0.6, True, "joint torques", _hover(label)))
        if len(mesh.faces):
            marks.append(Mark(f"{at}/torque", mesh, color, seen_through=True, layer="joint torques", label=label))
    return marks


def _hover(label: Label) -> Label:
    return Label(label.title, label.lines, label.at, tag=False)


def _arc(t: ShownTorque, share: float, heads: int, sizes: Sizes) -> tuple[Mesh, Mesh]:
    """The arc of a share of the limit in [-1, 1], and the ring of the whole limit."""
    axes, thickness = shapes.axes_along(t.axis), 0.75 * sizes.shaft
    angle = share * FULL_TURN if abs(share) * FULL_TURN > SMALLEST_ARC else 0.0
    ring = shapes.ring(t.point, axes, sizes.arc, thickness=0.5 * sizes.line, facets=5)
    return shapes.arc_arrow(t.point, axes, sizes.arc, angle, thickness=thickness, heads=heads), ring


def _bar(t: ShownTorque, share: float, sizes: Sizes) -> tuple[Mesh, Mesh]:
    """The bar of a share of the limit in [-1, 1] along the axis, and the line of the whole limit."""
    full = BAR * sizes.body * t.axis
    line = shapes.tube(np.array([t.point - full, t.point + full]), radius=0.5 * sizes.line)
    return shapes.arrow(t.point, share * full, radius=0.8 * sizes.shaft), line


def constraint_torque_marks(torques: Sequence[ShownTorque], sizes: Sizes) -> list[Mark]:
    """Of every torque of a stop, brake or gear an arc at the scale of moments; of a force an arrow at that of forces."""
    marks = []
    for i, t in enumerate(torques):
        at, title, vector = f"joints/{i}", f"{t.by} on {t.name}", t.value * t.axis
        if t.slides:
            label = Label(title, t.lines, tip_of(t.point, vector, sizes))
            arrow = force_arrow(t.point, vector, sizes)
            marks.append(Mark(at, arrow, LIMITED_COLOR, seen_through=True, layer="forces", label=label))
            continue
        for mark in moment_marks(at, title, t.point, vector, LIMITED_COLOR, sizes):
            label = Label(title, t.lines, t.point + 1.3 * sizes.arc * t.axis)
            marks.append(Mark(at, mark.mesh, LIMITED_COLOR, seen_through=True, layer="moments", label=label))
    return [mark for mark in marks if len(mark.mesh.faces)]


LOOP_COLOR = "#5e4fa2"


@dataclass(frozen=True, eq=False, slots=True)
class ShownLoop:
    """The force of a loop closure.

    Attributes:
        name: The closure's.
        point: Where it acts, in W, shape (3,) [m].
        force: On the body `on`, in W, shape (3,) [N].
        moment: On that body about the point, in W, shape (3,) [N m].
        on: Frame of the body that it acts on.
        against: Frame of the body that gets the opposite; empty for the ground.
    """

    name: str
    point: Array
    force: Array
    moment: Array
    on: str
    against: str

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        lines = [f"|f| {number(float(np.linalg.norm(self.force)))} N", f"force on {self.on} {numbers(self.force)} N"]
        if self.moment.any():
            lines.append(f"moment on {self.on} {numbers(self.moment)} N m")
        if self.against:
            lines.append(f"{self.against} gets the opposite")
        return (*lines, f"acts at {numbers(self.point)} m")


@dataclass(frozen=True, eq=False, slots=True)
class ShownPoints:
    """Forces of a constraint at single points, as of shapes that touch each other.

    Attributes:
        name: The constraint's.
        points: In W, shape (k, 3) [m].
        forces: On the first body, in W, shape (k, 3) [N].
    """

    name: str
    points: Array
    forces: Array

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        total = self.forces.sum(axis=0)
        each = [f"{numbers(f)} N at {numbers(p)} m" for p, f in zip(self.points[:8], self.forces[:8], strict=True)]
        return f"{len(self.points)} points", f"sum of the forces {numbers(total)} N", *each


@dataclass(frozen=True, eq=False, slots=True)
class Others:
    """What is drawn of the constraints without a patch, and what is not.

    Attributes:
        loops: Loop closures.
        points: Forces at single points.
        torques: Of stops, brakes, gears and dry friction, on single joints.
        left_out: What has no picture, in words.
    """

    loops: tuple[ShownLoop, ...] = ()
    points: tuple[ShownPoints, ...] = ()
    torques: tuple[ShownTorque, ...] = ()
    left_out: tuple[str, ...] = ()


def constraints_of(solution: object) -> dict[str, Constraint]:
    """{name: constraint} that a solution or an actuation was made with; empty where they are not known."""
    given: Any = getattr(solution, "constraints", None)
    if given is None:
        given = getattr(getattr(getattr(solution, "problem", None), "origin", None), "constraints", ())
    return {constraint.name: constraint for constraint in given}


def others_of(state: State, all_rows: Sequence[Rows], forces: Mapping[str, Array], given: Mapping[str, Constraint]) -> Others:
    """The forces of all constraints without a patch, each by the view that it offers.

    Args:
        state: The robot.
        all_rows: Of all constraints.
        forces: {constraint: force, wrench, or row forces}.
        given: {name: constraint}, where known.
    """
    loops, points, torques, left_out = list[ShownLoop](), list[ShownPoints](), list[ShownTorque](), list[str]()
    for rows in all_rows:
        if rows.patch is not None or not len(rows) or rows.name not in forces:
            continue
        f, constraint = np.asarray(forces[rows.name], float), given.get(rows.name)
        if rows.resultant is not None and constraint is not None and closes_loop(constraint):
            loops.append(_loop(state, constraint, f))
        elif rows.resultant is not None:
            left_out.append(f"The force of {rows.name} is not drawn: the point where it acts is not known.")
        elif (at := _points(state, constraint, rows, f)) is not None:
            points.append(at)
        elif (found := constraint_torques(state, rows, f)) is not None:
            torques += found
        else:
            count = int((np.abs(rows.J).max(axis=0) > 0.0).sum())
            left_out.append(
                f"The force of {rows.name} is not drawn: {len(rows)} row{'s' * (len(rows) != 1)} on {count} coordinates, "
                f"largest row force {number(float(np.abs(f).max()))}."
            )
    return Others(tuple(loops), tuple(points), tuple(torques), tuple(left_out))


def _loop(state: State, constraint: Constraint, f: Array) -> ShownLoop:
    """The force on the body of the second frame at its origin; where that is the ground, on the body of the first."""
    first, second = frames_of(constraint)
    point = np.array(state.frame(second).X_WF.translation)
    moment = f[3:] if len(f) == 6 else np.zeros(3)
    robot = state.robot
    on, against = (second, first) if robot.site(second)[0] else (first, second)
    return ShownLoop(constraint.name, point, f[:3], moment, on, against if robot.site(against)[0] else "")


def _points(state: State, constraint: Constraint | None, rows: Rows, f: Array) -> ShownPoints | None:
    """The forces at the points of a constraint that offers them in the order of its rows."""
    view = member(constraint, "points")
    if not callable(view):
        return None
    seen = view(state, 0.0)
    if not isinstance(seen, ContactPoints) or len(seen.J) != len(rows):
        return None
    axes, forces, at = np.broadcast_to(seen.axes, (len(seen.positions), 3, 3)), [], 0
    for R, cone in zip(axes, seen.cones, strict=True):
        forces.append(R[:, 3 - cone.dim :] @ f[at : at + cone.dim])
        at += cone.dim
    return ShownPoints(rows.name, np.asarray(seen.positions), np.array(forces))


def loop_marks(loop: ShownLoop, color: str, sizes: Sizes) -> list[Mark]:
    """The force of a loop on one body, thin and pale its opposite on the other, a dot where they act, the arc of the moment."""
    at, layer = f"loops/{node(loop.name)}", "loop forces"
    label = Label(loop.name, loop.lines, tip_of(loop.point, loop.force, sizes))
    dot = shapes.ball(1.6 * sizes.shaft, centre=loop.point)
    place = Label(loop.name, loop.lines, loop.point, tag=False)
    marks = [
        Mark(f"{at}/point", dot, color, 1.0, True, layer, place),
        Mark(f"{at}/force", force_arrow(loop.point, loop.force, sizes, thick=0.8), color, 1.0, True, layer, label),
    ]
    if loop.against:
        back = force_arrow(loop.point, -loop.force, sizes, thick=0.5)
        lines = (f"force on {loop.against} {numbers(-loop.force)} N", f"the opposite of that on {loop.on}")
        other = Label(f"{loop.name}, on {loop.against}", lines, tip_of(loop.point, -loop.force, sizes), tag=False)
        marks.append(Mark(f"{at}/reaction", back, color, 0.6, True, layer, other))
    return marks + moment_marks(f"{at}/moment", loop.name, loop.point, loop.moment, color, sizes)


def points_mark(shown: ShownPoints, color: str, sizes: Sizes) -> Mark:
    """The forces at single points, as one mark."""
    pieces = [shapes.ball(1.4 * sizes.shaft, centre=point) for point in shown.points]
    pieces += [force_arrow(p, f, sizes, thick=0.6) for p, f in zip(shown.points, shown.forces, strict=True)]
    label = Label(shown.name, shown.lines, shown.points.mean(axis=0))
    return Mark(f"points/{node(shown.name)}", shapes.joined(pieces), color, seen_through=True, layer="forces", label=label)
