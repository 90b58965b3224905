"""Impacts: the velocity after one, at rigid contacts and bilateral constraints, with Newton's restitution.

    M (v+ - v-) = J^T p,        u+ = J v+ + e u_n-  along normals that approach

p and u+ obey the contact law, as forces and accelerations do in `rbd.solve`; rows of bilateral constraints come to rest. All
impulses act at once. Forces that are finite (gravity, torques, springs, dry friction in joints) have no impulse. Source:
[Moreau1988]. Newton's e is a ratio of speeds: with friction it can add energy [Kane1984].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.answers.analysis.uniqueness import Uniqueness
from rbd.answers.solution import Solution
from rbd.arrays import Array, check_number, lazy, max_abs
from rbd.constraints.constraint import Constraint, member, rows_of, with_loops
from rbd.constraints.contact_points import SLIDES, sources_of
from rbd.constraints.distance_warnings import warn_of_distant
from rbd.displayed import Displayed
from rbd.errors import NoSolution, UnknownName, nearest
from rbd.errors.inputs import check_different
from rbd.model.dynamics import kinetic_energy
from rbd.model.state import State, checked
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import USABLE
from rbd.problem.rows import Rows
from rbd.simulation.recording import StepForces, least_forces
from rbd.simulation.simulated_motion import ConstraintForce
from rbd.simulation.stacked_points import Points, Snapshot
from rbd.simulation.velocity_problem import VelocityAnswer, active_rows, solve_velocity
from rbd.solvers.default import slip_law

AT_REST = 1e-7
"""A point that arrives more slowly than this [m/s, rad/s] needs no impulse."""
_SLOW = 1e-3
"""Speed of an impact below which rounding, an absolute one in the solvers, could be seen [m/s, rad/s]."""


def impact_answer(
    at: Snapshot,
    touches: Array,
    arrives: Array,
    restitution: Mapping[str, float],
    *,
    plastic: float,
    law: str,
    norms: Array | None = None,
) -> VelocityAnswer:
    """Velocity and impulses of an impact; `velocity` of the answer is u+.

    Args:
        at: The points.
        touches: Those that take part, shape (k,).
        arrives: Those of them that approach, shape (k,).
        restitution: Newton's coefficient of each named constraint; 0 for the others.
        plastic: Points that approach more slowly [m/s, rad/s] do not bounce.
        law: "coulomb" or "convex".
        norms: `norms` of the last answer for this layout.

    Raises:
        NoSolution: there is none, or none was found.
    """
    layout, approach = at.layout, at.approach
    offset = at.velocity - at.J @ at.state.v
    n = layout.normals[arrives]
    e = np.array([restitution.get(layout.owners[i], 0.0) for i in np.flatnonzero(arrives)])
    offset[n] += np.where(approach[arrives] < -plastic, e * approach[arrives], 0.0)
    unit = _unit(at, touches)
    momentum, nothing = at.state.M @ at.state.v / unit, np.zeros(len(offset))
    return _times(unit, solve_velocity(at, touches, momentum, offset / unit, 0.0, nothing, law=law, norms=norms))


def _times(unit: float, answer: VelocityAnswer) -> VelocityAnswer:
    if unit == 1.0:
        return answer
    return answer._replace(v=unit * answer.v, impulse=unit * answer.impulse, velocity=unit * answer.velocity)


def _unit(at: Snapshot, touches: Array) -> float:
    """A power of two near the speed of the points [m/s, rad/s], the unit in which slow impacts are solved, as exactly."""
    speed = max_abs(at.velocity[np.repeat(touches, at.layout.widths)])
    return float(2.0 ** np.ceil(np.log2(speed))) if 1e-100 < speed < _SLOW else 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Impact(Displayed):
    """The result of an impact, as `rbd.impact` computes it; printed, its energy, impulses and residuals.

    Attributes:
        before: The state before it.
        state: The state after it: the same configuration with the velocity v+.
        impulses: {constraint: impulse on the robot}: of a point (3,), or with the moment about a surface's centre (6,), in W;
            of a constraint without a resultant those of its rows [N s, N m s].
        points: {contact: its points in W, shape (k, 3)} [m].
        point_impulses: {contact: impulse at each of them, on the robot, in W, shape (k, 3)} [N s].
        modes: {constraint: "sticks", "slips", "holds", "pushes", or "open" where it has no impulse}, after the impact.
        normal_impulses: {constraint: sum of the normal impulses of its points} [N s]; of a bilateral one that is no contact the
            largest of its rows.
        approach: {constraint: largest speed along the normal at which one of its points approached} [m/s, rad/s], zero where
            none did; of a bilateral one that is no contact the largest speed of a row.
        opens: Constraints all of whose points separate after it, in order.
        restitution: Newton's coefficient of each constraint that has one.
        solution: The same as a problem of Gauss with v+ in place of the acceleration, in units of `speed`; its residuals are
            recomputed from the problem.
        speed: Unit of the velocities of `solution` [m/s].

    Example:
        >>> box = rbd.testing.box(mass=2.0)
        >>> tip = rbd.PointContact("tip", "box", friction=0.5, on=0.0)
        >>> found = rbd.impact(rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [0.1, 0, -1.0, 0, 0, 0]), [tip], restitution=0.5)
        >>> found.v[:3].round(9), found.impulses["tip"].round(9), round(found.energy_lost, 9)
        (array([0. , 0. , 0.5]), array([-0.2,  0. ,  3. ]), 0.76)
    """

    before: State
    state: State
    impulses: Mapping[str, Array]
    points: Mapping[str, Array]
    point_impulses: Mapping[str, Array]
    modes: Mapping[str, str]
    normal_impulses: Mapping[str, float]
    approach: Mapping[str, float]
    opens: tuple[str, ...]
    restitution: Mapping[str, float]
    solution: Solution
    speed: float

    @property
    def v_before(self) -> Array:
        """Velocity before it, shape (nv,) [m/s, rad/s]."""
        return self.before.v

    @property
    def v(self) -> Array:
        """Velocity after it, shape (nv,) [m/s, rad/s]."""
        return self.state.v

    @property
    def sizes(self) -> dict[str, float]:
        """{constraint: size of its impulse}: |p| of a contact [N s], else that of the largest row [N s, N m s]."""
        known = self.points
        return {n: float(np.linalg.norm(p[:3])) if n in known else max_abs(p) for n, p in self.impulses.items()}

    @property
    def law(self) -> Law:
        """The contact law."""
        return self.solution.law

    @lazy
    def energy_lost(self) -> float:
        """Kinetic energy before less that after it [J]; negative where Newton's restitution adds energy."""
        return kinetic_energy(self.before) - kinetic_energy(self.state)

    @property
    def residuals(self) -> dict[str, float]:
        """Scaled residuals, recomputed from M, J, v+ and p: zero for an exact answer, up to 1e-9 solved.

        "stationarity": M (v+ - v-) = J^T p. "feasibility": no point approaches more than -e u_n-, bilateral rows are at rest.
        "cone": the impulses are in their friction cones. "complementarity": points that separate have no impulse, friction
        opposes the slip. "centroidal": the impulses' sum is the change of momentum, without contact Jacobians.
        """
        return self.solution.residuals.scaled

    def uniqueness(self) -> Uniqueness:
        """Which impulses are unique, and the ranges of those that are not [N s, N m s]; and whether v+ is unique.

        `others` has the ranges of all constraints, one for each row: of each point of a contact tangent, tangent, normal (the
        normal alone without friction), as in `solution`. An end's `at_highest`, `at_lowest` are impulses, too.
        """
        return self.solution.uniqueness().as_impulses(self.speed, "unique" if self.unique else "those of least norm")

    @property
    def unique(self) -> bool:
        """Whether the impulses of all rows are unique for this velocity: rows are independent."""
        return self._rank == len(self.solution.problem.J)

    @lazy
    def _rank(self) -> int:
        W = self.solution.problem.whitened
        return int(np.linalg.matrix_rank(W, tol=1e-9 * max(1e-300, float(np.linalg.norm(W, 2))))) if W.size else 0

    def __str__(self) -> str:
        robot, lost = self.before.robot.name, self.energy_lost
        had = kinetic_energy(self.before)
        share = f" of {had:.6g} J" if had else ""
        lines = [f"impact of {robot}: {'loses' if lost >= 0.0 else 'GAINS'} {abs(lost):.6g} J{share}; law: {self.law}"]
        for name, size in self.sizes.items():
            speed, impulse = ("m/s", "N s") if name in self.points else ("m/s or rad/s", "N s or N m s")
            e = f", e = {self.restitution[name]:g}" if self.restitution.get(name) else ""
            came = f"came at {self.approach[name]:.4g} {speed}{e}, " if self.approach.get(name, 0.0) > AT_REST else ""
            ends = "leaves" if name in self.opens else self.modes[name]
            lines.append(f"  {name:<16}{came}impulse {size:.6g} {impulse}, {ends}" if size else f"  {name:<16}{came}no impulse")
        m, rank = len(self.solution.problem.J), self._rank
        unique = "unique" if rank == m else f"{m} rows of rank {rank}: not unique, those of least norm"
        lines.append(f"  {'impulses':<16}{unique}")
        worst = max(self.residuals, key=lambda name: self.residuals[name])
        lines.append(f"  {'worst residual':<16}{worst} {self.residuals[worst]:.1e} (scaled)")
        return "\n".join(lines)


def impact(
    state: State,
    contacts: Sequence[Constraint],
    *,
    restitution: float | Mapping[str, float] = 0.0,
    law: Law | str = "coulomb",
    plastic_below: float = 0.0,
    loops: bool = True,
) -> Impact:
    """The velocity after an impact of a robot with contacts and other constraints, and the impulses.

    The equations are::

        M (v+ - v-) = J^T p,        u+ = J v+ + e u_n-  along normals that approach

    p and u+ obey Coulomb's law (or the convex one), bilateral constraints are at rest afterwards (or move as their ground). It
    is what `rbd.simulate` computes at an impact. As in `rbd.solve`, all constraints given take part, as if they touched; of
    `rbd.CollisionContacts` the points within its margin. A contact that ends at that instant, such as the foot from which a
    walker steps, is left out. Joint limits take part where they are reached.

    Newton's e with friction can add energy, where the impact reverses the sliding [Kane1984]: `energy_lost` is then negative.
    e = 0 never does.

    Args:
        state: The state before the impact.
        contacts: Constraints as of `rbd.solve`, each with a different name.
        restitution: Newton's coefficient e, from 0 to 1; one for all, or {constraint: e}, 0 for the others.
        law: "coulomb" or "convex" (circular cones).
        plastic_below: Points that approach more slowly than this do not bounce [m/s, rad/s].
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The velocity after it, impulses, energy lost, residuals.

    Raises:
        InputError: arguments that do not fit.
        DuplicateName: two constraints have one name.
        UnknownName: `restitution` names no constraint.
        NoSolution: no velocity satisfies the constraints and the law, or none was found.

    Example:
        >>> stick = rbd.testing.box(mass=1.0, size=(1.0, 0.02, 0.02))
        >>> end = rbd.PointContact("end", "box", offset=(-0.5, 0.0, 0.0), friction=0.0, on=0.0)
        >>> found = rbd.impact(rbd.State(stick, [0, 0, 0, 0, 0, 0, 1], [0, 0, -1.0, 0, 0, 0]), [end])
        >>> found.impulses["end"].round(3), found.v[[2, 4]].round(3)  # a quarter of m v, and it turns
        (array([0.  , 0.  , 0.25]), array([-0.75,  1.5 ]))
    """
    checked(state)
    given = with_loops(state.robot, contacts, loops)
    rows = rows_of(state, given)
    names = [c.name for c in given]
    check_different(names, "constraints")
    e = restitution_of(restitution, names)
    kind = slip_law(law).kind
    check_number("plastic_below", plastic_below, 0.0, expected="a speed from 0 [m/s]")
    warn_of_distant(state, given, rows, stacklevel=3)
    return impact_of(state, given, e, law=kind, plastic=float(plastic_below))


def restitution_of(given: float | Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """{constraint: Newton's coefficient}.

    Args:
        given: One for all, or of some constraints.
        names: All constraints.

    Raises:
        UnknownName: it names no constraint.
        InputError: a coefficient outside 0 to 1.
    """
    expected = "a number from 0 (plastic) to 1 (elastic)"
    if not isinstance(given, Mapping):
        return dict.fromkeys(names, check_number("restitution", given, 0.0, 1.0, expected=expected))
    for name, e in given.items():
        if name not in names:
            raise UnknownName(f"restitution names {name!r:.80}, which is no constraint; {nearest(name, names)}.")
        check_number(f"restitution of {name!r}", e, 0.0, 1.0, expected=expected)
    return dict(given)


def impact_of(
    state: State,
    constraints: Sequence[Constraint],
    restitution: Mapping[str, float],
    *,
    law: str,
    plastic: float,
    t: float = 0.0,
) -> Impact:
    """The impact of checked arguments, see `impact`, at a time t [s] since moving ground was given.

    Raises:
        NoSolution: no velocity satisfies the constraints and the law, or none was found.
    """
    at = Points(sources_of(constraints, state)).at(state, t)
    layout = at.layout
    margins = {c.name: margin for c in constraints if (margin := _margin(c)) is not None}
    reach = np.array([margins.get(owner, np.inf) for owner in layout.owners])
    touches = at.gap <= reach
    arrives = touches & layout.pushes & (at.approach < 0.0)
    answer = impact_answer(at, touches, arrives, restitution, plastic=plastic, law=law)
    solution, speed, impulse = _solution(at, touches, answer, law)
    if not solution.residuals.within(USABLE):
        raise NoSolution(
            f"no velocity of {state.robot.name} after the impact was found: {solution.worst}. Active: "
            f"{', '.join(dict.fromkeys(layout.owners)) or 'nothing'}.",
            problem=solution.problem, result=solution,
        )  # fmt: skip
    names = tuple(c.name for c in constraints)
    after = state.with_velocity(answer.v)
    u = at.velocity + at.J @ (answer.v - state.v)
    acting = StepForces(at, u, names, lambda: impulse)()
    approach, normal = _normals(at, touches, impulse)
    return Impact(
        before=state,
        state=after,
        impulses={name: x.force for name, x in acting.items()},
        points={name: x.points for name, x in acting.items() if x.points is not None},
        point_impulses={name: x.point_forces for name, x in acting.items() if x.point_forces is not None},
        modes={name: x.mode for name, x in acting.items()},
        normal_impulses=normal,
        approach=approach,
        opens=_open(at, touches, u, acting),
        restitution={name: e for name, e in restitution.items() if e},
        solution=solution,
        speed=speed,
    )


def _margin(constraint: Constraint) -> float | None:
    """The largest gap of its points that touch [m, rad]: of shapes and joint limits, which have some that do not."""
    margin = member(constraint, "margin")
    return float(margin) if isinstance(margin, int | float) and not isinstance(margin, bool) else None


def _solution(at: Snapshot, touches: Array, answer: VelocityAnswer, law: str) -> tuple[Solution, float, Array]:
    """(the answer as one of Gauss's problem in units of a speed, that speed, impulses of least norm)."""
    rows = active_rows(at.layout, touches, 0.0)
    index, M, unit = rows.index, at.state.M, _unit(at, touches)
    impulse = unit * least_forces(at, touches, _times(1.0 / unit, answer), 1.0, law)
    speed = max(max_abs(at.velocity[index]), AT_REST)  # points that are slower are at rest: their velocities may be rounding
    J, offset = at.J[index], (answer.velocity - at.J @ answer.v)[index] / speed
    P = GaussProblem(
        M,
        M @ at.state.v / speed,
        [Rows(name, J[s], offset[s], cone) for name, s, cone in rows.groups],
        from_state=True,
    )
    f = impulse[index] / speed
    found = Solution(P, answer.v / speed, f, rows.sets.project(rows.sets.H.T @ f), Law(law), "impact", 1, 0.0)
    return found, speed, impulse


def _normals(at: Snapshot, touches: Array, impulse: Array) -> tuple[dict[str, float], dict[str, float]]:
    """({constraint: speed of approach}, {constraint: normal impulse}), see `Impact`."""
    speeds: dict[str, float] = {}
    pushes: dict[str, float] = {}
    contacts = {owner for m in at.places if m.points is not None for owner in m.structure.owners}
    ends = np.cumsum(at.layout.widths)
    for i, owner in enumerate(at.layout.owners):
        rows = np.arange(ends[i] - at.layout.widths[i], ends[i])
        if not at.layout.held[rows].any():
            speed, push = max(0.0, -float(at.approach[i])) if touches[i] else 0.0, float(impulse[rows[-1]])
        elif owner in contacts and len(rows) > 2:  # tangent, tangent, normal, and moments
            speed, push = abs(float(at.velocity[rows[2]])), float(impulse[rows[2]])
        else:
            speed, push = max_abs(at.velocity[rows]), max_abs(impulse[rows])
        speeds[owner] = max(speeds.get(owner, 0.0), speed)
        pushes[owner] = pushes.get(owner, 0.0) + push
    return speeds, pushes


def _open(at: Snapshot, touches: Array, u: Array, acting: Mapping[str, ConstraintForce]) -> tuple[str, ...]:
    """The constraints all of whose points separate, or none of whose points touches."""
    layout = at.layout
    closed = touches & ~(layout.pushes & (u[layout.normals] > SLIDES))
    stay = {layout.owners[i] for i in np.flatnonzero(closed)}
    return tuple(name for name in acting if name not in stay)
