"""The limits that prevent a motion: an irreducible set that no torques and forces satisfy together.

Limits are relaxed by columns, forces that the limit forbids, and by rows left out:

    motor           its torque may be any
    friction        the contact's points may feel any tangential force
    edge            its points may feel normal forces that cancel: its centre of pressure may be anywhere
    normal force    its bounds, and those of the centre of pressure that were asked for, are left out
    push            its points may feel any force
    opens, slips    the same of points whose force the wanted motion decides
    base, passive   a wrench on the base; a torque at the joint
    flight, keyframe, rest      of plans: a wrench while nothing stands, any place of a keyframe, any motion at the end
    reach                       of plans: limbs of any length between the contact and the centre of mass, or another contact

A set is irreducible where each of them, relaxed alone, lets the rest be kept [Chinneck1991]: the deletion filter. Relaxing
"push" relaxes friction, slip and edge of that contact too, so that it is named only where none of them is in the way.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, lazy
from rbd.displayed import Displayed
from rbd.problem import programs
from rbd.problem.conic import Certificate, Conic, Unknowns
from rbd.problem.force_set import Element, ForceSet, at_rest
from rbd.problem.programs import Outcome
from rbd.solvers.conic_newton import solve_conic
from rbd.statics.effort import Effort
from rbd.statics.force_balance import ForceBalance

_ZERO = 1e-9  # of multipliers, the largest being one


@dataclass(frozen=True)
class Limit(Displayed):
    """One limit in the way of a motion, of a motor, of friction, of an edge: as `CannotMove.limits` names them.

    Attributes:
        kind: "motor", "friction", "edge", "normal force", "push", "opens", "slips", "base" or "passive"; of plans also
            "flight", "keyframe", "rest", "reach" or "ground".
        name: Of the joint, of the contact, or of the link; or a time.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.5, on=rbd.Ground(normal=(0.6, 0.0, 0.8)))
        >>> try:
        ...     rbd.hold(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [corner])
        ... except rbd.CannotHold as error:
        ...     print([(limit.kind, limit.name) for limit in error.limits])
        [('friction', 'corner'), ('base', 'root_joint')]
    """

    kind: str
    name: str

    def __str__(self) -> str:
        return {
            "motor": f"the torque limit of {self.name!r:.80}",
            "friction": f"friction of {self.name!r:.80}",
            "edge": f"the edge of {self.name!r:.80}",
            "normal force": f"the normal force asked of {self.name!r:.80}",
            "push": f"{self.name!r:.80}, which only pushes",
            "opens": f"{self.name!r:.80}, which opens and so carries nothing",
            "slips": f"{self.name!r:.80}, whose slip decides its friction",
            "base": "the base, which no motor drives",
            "passive": f"{self.name!r:.80}, which is passive",
            "flight": f"the time {self.name}, in which nothing stands",
            "keyframe": f"the centre of mass at the keyframe of {self.name}",
            "rest": f"being at rest at {self.name}",
            "reach": f"the length of the limbs from {self.name!r:.80}",
            "ground": f"the clearance of {self.name!r:.80} over the ground",
        }[self.kind]


@dataclass(frozen=True, eq=False)
class Relaxable:
    """The program of a wanted motion whose limits can be relaxed one by one.

    Attributes:
        loads: The equations of motion, and the sets of the forces.
        effort: What else the forces must keep to.
    """

    loads: ForceBalance
    effort: Effort

    @lazy
    def columns(self) -> dict[Limit, Array]:
        """{limit: generalised forces that it forbids, shape (nv, k)}, motors and bounds of normal forces apart."""
        loads, out = self.loads, dict[Limit, Array]()
        full = at_rest(*[r.cone for r in loads.rows])
        G = loads.J.T @ full.G * loads.unit
        for i, r in enumerate(loads.rows):
            free = [e for e in full.elements if e.rows == i]
            now = [e for e in loads.sets.elements if e.rows == i]
            fixed = [loads.sets.lower[e.columns.start] == loads.sets.upper[e.columns.start] for e in now]
            points = [(e, n, gone) for e, n, gone in zip(free, now, fixed, strict=True) if e.size == 3 or _pushes(full, e)]
            boxes = [G[:, e.columns] for e in free if np.isfinite(full.upper[e.columns]).any()]
            if boxes:
                out[Limit("friction", r.name)] = np.hstack(boxes)
            if not points:
                continue
            tangents = [G[:, e.columns][:, :2] for e, n, gone in points if e.size == 3 and n.size == 3]
            slips = [G[:, e.columns][:, :2] for e, n, gone in points if e.size == 3 and n.size == 1 and not gone]
            normals = [G[:, e.columns.stop - 1 : e.columns.stop] for e, _, gone in points if not gone]
            if tangents:
                out[Limit("friction", r.name)] = np.hstack(tangents)
            if slips:
                out[Limit("slips", r.name)] = np.hstack(slips)
            if len(normals) > 1:
                out[Limit("edge", r.name)] = np.hstack(normals[1:]) - normals[0]
            if normals:
                out[Limit("push", r.name)] = np.hstack([G[:, e.columns] for e, _, gone in points if not gone])
            if any(gone for _, _, gone in points):
                out[Limit("opens", r.name)] = np.hstack([G[:, e.columns] for e, _, gone in points if gone])
        return out | self._idle()

    def _idle(self) -> dict[Limit, Array]:
        """Of bases and passive joints."""
        robot, out = self.loads.state.robot, dict[Limit, Array]()
        I = np.eye(robot.nv) * self.loads.unit
        for joint, where in self.loads.idle_joints:
            kind = "passive" if joint.name in robot.passive else "base"
            out[Limit(kind, joint.name)] = I[:, where]
        return out

    @lazy
    def limits(self) -> tuple[Limit, ...]:
        """All, in the order in which they are tried: what is left out first is what one would rather not blame."""
        robot, loads = self.loads.state.robot, self.loads
        asked = [Limit("normal force", r.name) for r in loads.rows if self._asks(r.name)]
        motors = [Limit("motor", name) for name, has in zip(robot.actuated_names, loads.limited, strict=True) if has]
        kinds = "opens slips friction edge push passive base".split()
        rest = [limit for kind in kinds for limit in self.columns if limit.kind == kind]
        return (*asked, *motors, *rest)

    def _asks(self, name: str) -> bool:
        patch = {r.name: r.patch for r in self.loads.rows}[name]
        return name in self.effort.normal_force or bool(
            self.effort.edge_margin and patch is not None and len(patch.corners) > 1
        )

    def program(self, relaxed: Collection[Limit] = ()) -> Conic:
        """Find any torques and forces, some limits relaxed."""
        loads, robot = self.loads, self.loads.state.robot
        more = [self.columns[limit] for limit in relaxed if limit in self.columns]
        X, at_motors = loads.columns(np.hstack([np.zeros((robot.nv, 0)), *more]))
        gone = {limit.name for limit in relaxed if limit.kind == "motor"}
        kept = loads.limited & np.array([name not in gone for name in robot.actuated_names], bool)
        low, high = loads.within
        between = [({"forces": loads.T[kept], "relaxed": at_motors[kept]}, low[kept], high[kept])]
        if not any(limit.kind == "normal force" for limit in relaxed):
            between.insert(0, self.effort.rows(loads))
        blocks = {"forces": loads.block(), "relaxed": Unknowns(X.shape[1])}
        return Conic.of(blocks, [({"forces": loads.A, "relaxed": X}, loads.b)], between)

    def refuted(self, relaxed: Collection[Limit] = ()) -> Certificate | None:
        """The certificate that there are none, or None where there are, or where it was not found."""
        found = solve_conic(self.program(relaxed), newton=False, tolerance=1e-8)
        return found.certificate if found.outcome is Outcome.INFEASIBLE else None

    def irreducible(self, certificate: Certificate) -> tuple[tuple[Limit, ...], bool]:
        """A set of limits that contradict each other, and whether none of them could be left out: not all may have been tried.

        Args:
            certificate: That all of them do.
        """
        left = programs.LIMIT_PROGRAMS
        kept = list(self.limits)
        motors = [limit for limit in kept if limit.kind == "motor"]
        speaks = np.abs(certificate.z[len(certificate.z) - len(motors) :]) > _ZERO
        gone = [limit for limit, counts in zip(motors, speaks, strict=True) if not counts]
        if gone and self.refuted(gone) is None:
            gone = []
        for limit in self.limits:
            if limit in gone or (limit.kind == "push" and self._finer(limit, gone)):
                continue
            left -= 1
            if left >= 0 and self.refuted([*gone, limit]) is not None:
                gone.append(limit)
        out = [limit for limit in kept if limit not in gone]
        return tuple(limit for limit in out if not (limit.kind == "push" and self._finer(limit, gone))), left >= 0

    def _finer(self, limit: Limit, gone: Sequence[Limit]) -> bool:
        """Whether friction, slip or edge of the same contact is in the way already."""
        return any(
            Limit(kind, limit.name) in self.columns and Limit(kind, limit.name) not in gone
            for kind in ("friction", "edge", "slips")
        )


def _pushes(full: ForceSet, element: Element) -> bool:
    """Whether an element of one column is a point that only pushes."""
    lower, upper = full.lower[element.columns], full.upper[element.columns]
    return bool(lower[0] == 0.0 and upper[0] == math.inf)
