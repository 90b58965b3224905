"""Constraints without a patch among the marks: loops, stops and gears, points between bodies; and those left out, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, closes_loop, frames_of, member
from rbd.constraints.contact_points import ContactPoints
from rbd.model.state import State
from rbd.visual import shapes
from rbd.visual.marks.arrows import force_arrow, moment_marks, tip_of
from rbd.visual.marks.joints import ShownTorque, constraint_torques
from rbd.visual.marks.mark import Label, Mark, Sizes, node, number, numbers

if TYPE_CHECKING:
    from rbd.problem.rows import Rows

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
