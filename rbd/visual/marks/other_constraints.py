"""Torques at joints, loops, stops and gears, and points between bodies, among the marks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, closes_loop, frames_of, is_timed, member
from rbd.constraints.contact_points import ContactPoints
from rbd.errors import InputError
from rbd.mechanism.pins import pin_forces
from rbd.model.external import generalised
from rbd.model.inertial import body_names
from rbd.model.joints import Joint
from rbd.model.state import State
from rbd.visual.marks.mark import FULL_TURN, SMALLEST_ARC, Label, Mark, Sizes, node, number, share_color
from rbd.visual.marks.primitives import Primitive, arc, arrow, line, ring
from rbd.visual.marks.shown_force import ShownForce
from rbd.visual.shapes import Mesh, axes_along, tube
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
    """A motor's torque about a joint's axis, or its force along it, on the body that the joint moves.

    Attributes:
        name: Of the coordinate: the joint's name where it has one degree of freedom.
        point: The joint's origin in W, shape (3,) [m].
        axis: The joint's axis in W, a unit vector, shape (3,).
        value: [N m], or [N] of a sliding joint.
        slides: Whether it is a force along the axis.
        limit: Largest value in its direction, at the joint's speed; inf where none is stated.
    """

    name: str
    point: Array
    axis: Array
    value: float
    slides: bool
    limit: float = np.inf

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
    names, axes = [c.name for c in robot.motor_coordinates], joint_axes(state, robot.actuated)
    least, most = robot.limits_at(state.v)
    limits = np.where(tau < 0.0, -least, most)
    return [
        ShownTorque(name, point, axis, float(value), slides, float(limit))
        for name, (point, axis, slides), value, limit in zip(names, axes, tau, limits, strict=True)
    ]


def _tau(solution: Any) -> Array | None:
    origin = origin_of(solution)
    if origin is solution:
        return None if solution is None else np.asarray(solution.tau, float)
    if not isinstance(getattr(origin, "state", None), State):
        return None  # a problem built by hand, or one that came from another process
    state = origin.state
    parts = [np.asarray(solution.problem.rhs), state.h, generalised(state, origin.external)[0]]
    tau = (parts[0] + parts[1] - parts[2])[state.robot.actuated]
    rounding = NOTHING * max(float(np.abs(part).max(initial=0.0)) for part in parts)
    return np.where(np.abs(tau) > rounding, tau, 0.0)


def joint_axes(state: State, coordinates: Iterable[int]) -> list[tuple[Array, Array, bool]]:
    """(origin [m], unit axis, whether it slides) in W of some coordinates of v."""
    model, data = state.robot.model, state.robot.model.createData()
    pin.computeJointJacobians(model, data, np.asarray(state.q, float))
    owner = {i: j for j in range(1, model.njoints) for i in range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])}
    out = []
    for i in map(int, coordinates):
        j = owner[i]
        column = pin.getJointJacobian(model, data, j, pin.LOCAL_WORLD_ALIGNED).reshape(6, model.nv)[:, i]
        slides = float(np.linalg.norm(column[3:])) < 1e-9
        axis = column[:3] if slides else column[3:]
        out.append((np.array(data.oMi[j].translation), axis / np.linalg.norm(axis), slides))
    return out


def constraint_torques(state: State, rows: Rows, forces: Array) -> list[ShownForce] | None:
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
    torques, out = rows.J.T @ forces, []
    for i, (point, axis, slides) in zip(touched, joint_axes(state, touched), strict=True):
        vector, name = torques[i] * axis, single[int(i)]
        force, moment = (vector, np.zeros(3)) if slides else (np.zeros(3), vector)
        detail = f"{number(float(torques[i]))} {'N' if slides else 'N m'} on joint {name}"
        path, layer = f"joints/{node(rows.name)}/{node(name)}", "forces" if slides else "moments"
        out.append(ShownForce(path, rows.name, force, point, moment, detail, layer, LIMITED_COLOR, many="at joints"))
    return out


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
        used, track = _bar(t, size, sizes) if t.slides else _arc(t, size, 2 if share > 1.0 else 1, sizes)
        label = Label(t.name, t.lines, t.point + sizes.arc * t.axis)
        marks.append(Mark(f"{at}/limit", (track,), color, 0.6, True, "joint torques", replace(label, tag=False)))
        if not used.empty:
            marks.append(Mark(f"{at}/torque", (used,), color, seen_through=True, layer="joint torques", label=label))
    return marks


def _arc(t: ShownTorque, share: float, heads: int, sizes: Sizes) -> tuple[Primitive, Primitive]:
    """The arc of a share of the limit in [-1, 1], and the ring of the whole limit."""
    axes, thickness = axes_along(t.axis), 0.75 * sizes.shaft
    angle = share * FULL_TURN if abs(share) * FULL_TURN > SMALLEST_ARC else 0.0
    whole = ring(t.point, axes, sizes.arc, thickness=0.5 * sizes.line)
    return arc(t.point, axes, sizes.arc, angle, thickness=thickness, heads=heads), whole


def _bar(t: ShownTorque, share: float, sizes: Sizes) -> tuple[Primitive, Primitive]:
    """The bar of a share of the limit in [-1, 1] along the axis, and the line of the whole limit."""
    full = BAR * sizes.body * t.axis
    whole = line([t.point - full, t.point + full], radius=0.5 * sizes.line)
    return arrow(t.point, share * full, radius=0.8 * sizes.shaft), whole


LOOP_COLOR = "#5e4fa2"


def origin_of(answer: Any) -> Any:
    """What has the state, constraints and external forces of an answer: an actuation itself, else its problem's origin."""
    return getattr(answer.problem, "origin", None) if hasattr(answer, "problem") else answer


def other_forces(
    state: State, all_rows: Sequence[Rows], forces: Mapping[str, Array], given: Mapping[str, Constraint]
) -> tuple[list[ShownForce], list[str]]:
    """(forces of all constraints without a patch, each by the view that it offers; what has no picture, in words).

    Args:
        state: The robot.
        all_rows: Of all constraints.
        forces: {constraint: force, wrench, or row forces}.
        given: {name: constraint}, where known.
    """
    found, left_out = list[ShownForce](), list[str]()
    for rows in all_rows:
        if rows.patch is not None or not len(rows) or rows.name not in forces:
            continue
        f, constraint = np.asarray(forces[rows.name], float), given.get(rows.name)
        if rows.resultant is not None and constraint is not None and closes_loop(constraint):
            found.append(_loop(state, constraint, f))
        elif rows.resultant is not None:
            left_out.append(f"The force of {rows.name} is not drawn: the point where it acts is not known.")
        elif (at := _points(state, constraint, rows, f)) is not None:
            found.append(at)
        elif (torques := constraint_torques(state, rows, f)) is not None:
            found += torques
        else:
            count = int((np.abs(rows.J).max(axis=0) > 0.0).sum())
            left_out.append(
                f"The force of {rows.name} is not drawn: {len(rows)} row{'s' * (len(rows) != 1)} on {count} coordinates, "
                f"largest row force {number(float(np.abs(f).max()))}."
            )
    return found, left_out


def link_of(state: State, constraint: Constraint) -> Array | None:
    """The ends of what stands between the frames of a constraint in W, shape (2, 3) [m]; None where it has nothing there."""
    ends = member(constraint, "link")
    return ends(state) if callable(ends) else None


def link_mark(name: str, ends: Array, sizes: Sizes) -> Mark:
    """A rod or rope as a line between its ends."""
    label = Label(name, (f"{float(np.linalg.norm(ends[1] - ends[0])):.4g} m long",), ends.mean(axis=0), tag=False)
    return Mark(f"links/{node(name)}", (line(ends, radius=0.5 * sizes.shaft),), LOOP_COLOR, layer="loop forces", label=label)


DRIVE_COLOR = "#1b9e77"
DRIVEN_TURN = np.radians(240.0)
"""Angle of the arc of a driven joint that turns [rad]; its radius is larger than that of torques by so much."""
AROUND_TORQUES = 1.7


@dataclass(frozen=True, eq=False, slots=True)
class ShownDrive:
    """A joint whose motion a constraint gives as a function of time.

    Attributes:
        name: Of the constraint.
        joint: Of the joint.
        point: The joint's origin in W, shape (3,) [m].
        axis: The joint's axis in W, a unit vector, shape (3,).
        slides: Whether it slides along the axis.
        motion: s, s' and s'' that it is to have, shape (3,) [rad or m, s].
    """

    name: str
    joint: str
    point: Array
    axis: Array
    slides: bool
    motion: Array

    @property
    def rate(self) -> str:
        """Its rate, in words."""
        return f"{number(float(self.motion[1]))} {'m' if self.slides else 'rad'}/s"

    @property
    def lines(self) -> tuple[str, ...]:
        """What page and legend say of it."""
        unit, (s, _, acceleration) = "m" if self.slides else "rad", self.motion.tolist()
        return f"drives joint {self.joint}", f"s = {number(s)} {unit}, s' = {self.rate}, s'' = {number(acceleration)} {unit}/s2"


def shown_drives(state: State, constraints: Iterable[Constraint]) -> list[ShownDrive]:
    """The driven joints among some constraints, with the motion that their rows ask for at the time of a state."""
    out = []
    for constraint in constraints:
        if not is_timed(constraint) or not (joint := member(constraint, "prescribes")):
            continue
        rows = constraint.rows(state)
        at = state.robot.joints.with_one_freedom(joint, rows.name)
        ((point, axis, slides),) = joint_axes(state, [at.v.start])
        s = at.coordinate(state.q) - (0.0 if rows.error is None else float(rows.error[0]))
        rate, acceleration = float(rows.J[0] @ state.v - rows.velocity[0]), float(-rows.bias[0])
        out.append(ShownDrive(rows.name, joint, point, axis, slides, np.array([s, rate, acceleration])))
    return out


def drive_marks(drive: ShownDrive, sizes: Sizes) -> list[Mark]:
    """A ring about the axis of a driven joint, or a line along it, with an arrow the way it moves; no arrow where it rests."""
    radius, rate = AROUND_TORQUES * sizes.arc, float(np.sign(drive.motion[1]))
    label = Label(drive.name, (drive.rate, *drive.lines), drive.point + radius * drive.axis)
    if drive.slides:
        half = 0.5 * BAR * sizes.body * drive.axis
        track: Primitive = line([drive.point - half, drive.point + half], radius=0.5 * sizes.line)
        way = arrow(drive.point, rate * half, radius=0.8 * sizes.shaft)
    else:
        axes = axes_along(drive.axis)
        track = ring(drive.point, axes, radius, thickness=0.5 * sizes.line)
        way = arc(drive.point, axes, radius, rate * DRIVEN_TURN, thickness=0.75 * sizes.shaft)
    at = f"drives/{node(drive.name)}"
    marks = [Mark(f"{at}/track", (track,), DRIVE_COLOR, 0.6, True, "moments", replace(label, tag=False))]
    if not way.empty:
        marks.append(Mark(f"{at}/way", (way,), DRIVE_COLOR, seen_through=True, layer="moments", label=label))
    return marks


def drive_mesh(state: State, joint: Joint, sizes: Sizes) -> Mesh:
    """The mark of a driven joint in the frame of the body that it moves: a bent bar about its axis, or a bar along it.

    Args:
        state: Any of the robot.
        joint: One of one degree of freedom.
        sizes: Of the marks.
    """
    ((point, axis, slides),) = joint_axes(state, [joint.v.start])
    if slides:
        points = point + 0.5 * BAR * sizes.body * np.outer([-1.0, 1.0], axis)
    else:
        turns, axes = np.linspace(0.0, DRIVEN_TURN, 49)[:, None], axes_along(axis)
        points = point + AROUND_TORQUES * sizes.arc * (np.cos(turns) * axes[:, 0] + np.sin(turns) * axes[:, 1])
    R, p = (x[0] for x in state.joint_places([joint.id]))
    return tube((points - p) @ R, 0.75 * sizes.shaft)


def _loop(state: State, constraint: Constraint, f: Array) -> ShownForce:
    """The force on the body of the second frame at its origin; where that is the ground, on the body of the first."""
    robot, (first, second) = state.robot, frames_of(constraint)
    point = np.array(state.frame(second).X_WF.translation)
    on, against = (second, first) if robot.site(second)[0] else (first, second)
    against = against if robot.site(against)[0] else ""
    detail = f"on {on}" + (f", {against} gets the opposite" if against else "")
    moment, name = f[3:] if len(f) == 6 else np.zeros(3), constraint.name
    loop = ShownForce(f"loops/{node(name)}", name, f[:3], point, moment, detail, "loop forces", LOOP_COLOR, on, against, 0.8)
    return replace(loop, many="loops", pin=True)


def shown_pins(state: State, solution: Any, given: Mapping[str, Constraint]) -> list[ShownForce]:
    """The forces in the hinges of a mechanism with loops, on the bodies that they move; none where they are not known."""
    if not any(closes_loop(constraint) for constraint in given.values()):
        return []
    try:
        forces = pin_forces(solution)
    except InputError:  # of contacts and other forces the bodies are not known
        return []
    links, joints, out = ("", *body_names(state.robot)), state.robot.joints, list[ShownForce]()
    for joint in (joint for joint in joints.values() if joint.nv == 1 and joint.is_angle):
        point = state.joint_places([joint.id])[1][0]
        on, against = links[joint.id], links[int(state.robot.model.parents[joint.id])]
        detail = f"on {on}" + (f", {against} gets the opposite" if against else "")
        at, name, f = f"pins/{node(joint.name)}", f"pin of {joint.name}", forces[joint.name][:3]
        shown = ShownForce(at, name, f, point, np.zeros(3), detail, "pin forces", LOOP_COLOR, on, against, 0.8)
        out.append(replace(shown, many="pins", pin=True))
    return out


def _points(state: State, constraint: Constraint | None, rows: Rows, f: Array) -> ShownForce | None:
    """The forces at the points of a constraint that offers them in the order of its rows."""
    view = member(constraint, "points")
    seen = view(state, 0.0) if callable(view) else None
    if not isinstance(seen, ContactPoints) or len(seen.J) != len(rows):
        return None
    axes, parts = np.broadcast_to(seen.axes, (len(seen.positions), 3, 3)), np.split(f, np.cumsum([c.dim for c in seen.cones]))
    points, each = np.asarray(seen.positions), np.array([R[:, 3 - len(p) :] @ p for R, p in zip(axes, parts, strict=False)])
    shown = ShownForce(f"points/{node(rows.name)}", rows.name, each.sum(axis=0), points.mean(axis=0))
    return replace(shown, corners=points, corner_forces=each, detail=f"sum of {len(points)} points")
