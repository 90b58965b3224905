"""Torques at joints: of the motors, as shares of their limits, and of stops, brakes, gears and dry friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.external import generalised
from rbd.model.state import State
from rbd.visual import shapes
from rbd.visual.marks.arrows import SMALLEST_ARC, force_arrow, moment_marks, share_color, tip_of
from rbd.visual.marks.mark import FULL_TURN, Label, Mark, Sizes, node, number
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
