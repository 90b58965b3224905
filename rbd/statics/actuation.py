"""`Actuation`: motor torques and contact forces for a wanted motion, with margins, residuals and uniqueness."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rbd.answers.least_constraint import momentum_balance
from rbd.answers.solution import Solution
from rbd.arrays import Array, lazy, null_space, rank_of
from rbd.constraints.constraint import Constraint
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.displayed import Displayed
from rbd.errors import Reason
from rbd.model.dynamics import free_force
from rbd.model.external import External
from rbd.model.state import State
from rbd.problem.answer import (
    ACCELERATION,
    CARRIES_NOTHING_N,
    CERTIFICATE,
    FORCES,
    Answer,
    ContactForce,
    Status,
    at_corners,
    corners_of,
)
from rbd.problem.cones import friction_used
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import ForceSet
from rbd.problem.gauss_problem import COULOMB, GaussProblem
from rbd.problem.motion_forces import given_weights
from rbd.problem.residuals import SOLVED, Residuals
from rbd.problem.rows import Rows, by_rows
from rbd.records import Axis, Field, Variable
from rbd.solvers.conic_newton import solve_conic
from rbd.statics.effort import Effort
from rbd.statics.force_balance import ForceBalance

CHOICE = "least effort"
"""`force_choice` of an actuation's forces."""
TORQUES = (
    Field("tau", ("motor",), "{}", "motor torques, by motor"),
    Field(
        "used_torque", ("motor",), "1", "share of each motor's limit that is used",
        lambda found: found.torque_use, default=False,
    ),
    Field(
        "worst_torque", (), "1", "largest share of a motor limit that is used",
        lambda found: found.torque_use.max(axis=-1, initial=0.0),
    ),
)  # fmt: skip
"""Fields of torques, of one state and of many."""
CHOSEN = (
    Field("least", (), "", "whether the effort is the least, to nine digits", default=False),
    Field("margin", (), "1", "share of friction that was kept unused", default=False),
)
"""Fields of how they were chosen, of one state and of many."""
_INSIDE = 1e-6  # of a force that is inside its cone, or a torque within its limit, over the body weight, or the limit


@dataclass(frozen=True, eq=False)
class Margins(Displayed):
    """How far torques and forces of an actuation are from each limit; zero is at the limit.

    Attributes:
        torque: `1 - |tau| / limit` of each motor at its speed, shape (nu,); 1 where no limit is stated.
        friction: `{contact: 1 - |f_t| / (mu f_n)}` of its net force; contacts without a coefficient are left out, and those
            that carry nothing.
        corner_friction: {contact: the same of each corner, shape (k,)}; NaN of a corner that carries nothing.
        centre_of_pressure: {surface: distance of the centre of pressure from the patch's edge [m], positive inside}.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> margins = rbd.hold(solo.standing(), solo.feet(friction=0.7)).margins
        >>> print(f"{margins.torque.min():.3f} of a torque limit, {margins.friction['front_left']:.3f} of the friction")
        0.999 of a torque limit, 0.860 of the friction
    """

    torque: Array
    friction: dict[str, float]
    corner_friction: dict[str, Array]
    centre_of_pressure: dict[str, float]

    def variables(self, contacts: Iterable[str]) -> dict[str, Variable]:
        """{"friction_<contact>", "pressure_<surface>": margin}; of friction NaN where a contact has none."""
        friction = {
            f"friction_{name}": Variable(
                np.asarray(self.friction.get(name, math.nan)), (), "1", f"share of the friction of {name} that is left"
            )
            for name in contacts
        }
        pressure = {
            f"pressure_{name}": Variable(np.asarray(x), (), "m", f"distance of the centre of pressure of {name} from the edge")
            for name, x in self.centre_of_pressure.items()
        }
        return friction | pressure


@dataclass(frozen=True)
class ActuationUniqueness(Displayed):
    """In how many directions torques and forces can change without another motion, everything inside its limits.

    Attributes:
        torques: Dimension of the set of torques that bring the motion; 0: they are unique.
        forces: Of the row forces of the constraints.
        corner_forces: Of the forces at the corners of the contacts.
        inside: Whether some torques and forces are strictly within all limits, so that these are the dimensions; else they
            are upper bounds: at a limit there may be fewer.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> unique = rbd.hold(solo.standing(), solo.feet(friction=0.7)).uniqueness()
        >>> unique.torques, unique.forces, unique.inside  # twelve forces, six equations of the base
        (6, 6, True)
    """

    torques: int
    forces: int
    corner_forces: int
    inside: bool

    def __str__(self) -> str:
        most = "" if self.inside else "at most "
        words = [
            f"{name} {'unique' if not n else f'{most}{n}-dimensional'}"
            for name, n in (("torques", self.torques), ("forces", self.forces), ("corner forces", self.corner_forces))
        ]
        return ", ".join(words)


@dataclass(frozen=True, eq=False, repr=False)
class Actuation(Displayed):
    """Motor torques and contact forces of a wanted motion, as `hold` and `inverse_dynamics` give them, with their margins.

    They satisfy M a + h = S^T tau + tau_ext + J^T f.

    Attributes:
        a: The robot's acceleration, shape (nv,) [m/s2, rad/s2].
        tau: Motor torques, shape (nu,) [N, N m]; nothing on the base or on passive joints.
        weights: Weights of the forces that the motion allows, shape (p,) [N].
        loads: The equations of motion, and the sets of these weights.
        constraints: The contacts and other constraints that were given.
        external: Other forces, as given.
        effort: What was made least.
        margin: Friction of points that keep still stays within 1 - margin of its cone.
        rest_speed: As of `rbd.solve`.
        iterations: How many steps it took.
        method: "Newton" or "Clarabel".
        least: Whether the effort is the least, to nine digits; else torques and forces are only possible ones.
        bound: Upper bound of the largest scaled residual, where it was found with them.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> held = rbd.hold(solo.standing(), solo.feet(friction=0.7))
        >>> print(held.status, {foot: f"{force[2]:.2f} N" for foot, force in held.forces.items()})
        solved {'front_left': '6.13 N', 'front_right': '6.13 N', 'hind_left': '6.13 N', 'hind_right': '6.13 N'}
        >>> margins = held.margins
        >>> print(f"{margins.torque.min():.3f} of a limit, {margins.friction['front_left']:.3f} of a cone is left")
        0.999 of a limit, 0.860 of a cone is left
    """

    a: Array
    tau: Array
    weights: Array
    loads: ForceBalance
    constraints: Sequence[Constraint]
    external: External
    effort: Effort
    margin: float
    rest_speed: float
    iterations: int
    method: str
    least: bool = True
    bound: float = math.inf

    fields: ClassVar[tuple[Field, ...]] = (
        *CERTIFICATE,
        *TORQUES,
        Field("worst_motor", (), "", "the motor with the largest share", lambda held: held.worst_motor, default=False),
        *FORCES,
        Field(
            "margins", (), "1, m",
            "margin of each contact: share of its friction, and distance of its centre of pressure from the edge",
            lambda held: held.margins.variables(held.contacts), "margin_{}", default=False,
        ),
        replace(ACCELERATION, default=False),
        *CHOSEN,
        Field("method", (), "", "method that found it", default=False),
    )  # fmt: skip

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates."""
        return self.state.coordinate_axes

    @property
    def no_answer(self) -> tuple[Reason, str] | None:
        """Why this is no answer, and a message; None where it is one."""
        answer = self.answer
        if self.status in (Status.SOLVED, Status.INACCURATE):
            return None
        return self.status.reason, answer.reason or answer.impact or answer.worst

    @property
    def worst_motor(self) -> str:
        """The motor that comes nearest to its limit; empty without motors."""
        return self.state.robot.actuated_names[int(np.argmax(self.torque_use))] if self.state.robot.nu else ""

    @property
    def state(self) -> State:
        """The robot at (q, v)."""
        return self.loads.state

    @property
    def rows(self) -> Sequence[Rows]:
        """The constraints' rows, for pictures and tables."""
        return self.loads.rows

    @lazy
    def program(self) -> Conic:
        """The conic program of least effort."""
        return self.effort.program(self.loads)

    @lazy
    def answer(self) -> Answer:
        """The same motion and forces as an answer of Coulomb's law under these torques."""
        rhs, wrench = free_force(self.state, self.tau, self.external)
        rows, sets = self.rows, self.loads.sets
        loose = any([r.resultant is None or r.patch is None for r in rows])
        balance = momentum_balance(self.state, wrench, with_base=loose)
        M = self.state.M
        if not self.state.robot.sound:  # no acceleration is solved for, so M may be singular; rows of zeros are met
            M = M + np.diag(np.where(M.diagonal() == 0.0, np.finfo(float).tiny, 0.0))
        problem = GaussProblem(M, rhs, rows, balance, None, self.rest_speed, from_state=True, stacked=self.loads.stacked)
        weights = None if problem.bilateral else given_weights(problem.force_set, sets, self.weights)
        return Answer(problem, self.a, sets.G @ self.weights, weights, COULOMB, CHOICE, self.iterations, 0.0)

    @lazy
    def solution(self) -> Solution:
        """`answer`, with all that can be said of it: `Solution.uniqueness()` is of the forces under these torques."""
        parts, sets = enumerate(by_rows(self.rows, self.answer.multipliers)), self.loads.sets
        corners = {r.name: corners_of(r, f, sets, self.weights, i) for i, (r, f) in parts if r.patch is not None}
        return replace(Solution.of(self.answer), chosen_corners=corners, choice=CHOICE)

    @property
    def residuals(self) -> Residuals:
        """How far torques, forces and motion are from the equations of Coulomb's law; as of every answer."""
        return self.answer.residuals

    @property
    def status(self) -> Status:
        """What the residuals amount to."""
        return Status.SOLVED if self.bound <= SOLVED else self.answer.status

    @property
    def forces(self) -> dict[str, Array]:
        """{contact: force (3,) or wrench (6,) at the patch's centre}, on the robot, world axes [N, N m]."""
        return self.answer.forces

    @property
    def corner_forces(self) -> dict[str, Array]:
        """{contact: (k, 3)}: each in its friction cone, less the margin, world axes [N]; they add up to the wrench."""
        return self.solution.corner_forces

    @property
    def contacts(self) -> dict[str, ContactForce]:
        """Normal and tangential parts, friction used and centre of pressure of each contact."""
        return self.answer.contacts

    @lazy
    def margins(self) -> Margins:
        """How far torques, friction and centres of pressure are from their limits."""
        friction, each, pressure = dict[str, float](), dict[str, Array](), dict[str, float]()
        for r in self.rows:
            if r.patch is None:
                continue
            c = self.contacts[r.name]
            if c.friction_used is not None:
                friction[r.name] = 1.0 - c.friction_used
            if r.patch.friction:
                local = at_corners(r.patch, self.corner_forces[r.name])
                used = [friction_used(r.patch.friction, f) if f[2] >= CARRIES_NOTHING_N else None for f in local]
                each[r.name] = np.array([math.nan if x is None else 1.0 - x for x in used])
            if len(r.patch.corners) > 2 and c.centre_of_pressure is not None:
                at = (c.centre_of_pressure - r.patch.point) @ r.patch.axes
                pressure[r.name] = inside_distance(at[:2], convex_hull(r.patch.corners[:, :2]))
        return Margins(1.0 - self.torque_use, friction, each, pressure)

    @property
    def torque_use(self) -> Array:
        """Torques over their limits at this velocity, shape (nu,): 1 is at the limit, 0 where there is none."""
        return self.state.robot.torque_use(self.tau, self.state.v)

    def uniqueness(self) -> ActuationUniqueness:
        """Whether other torques, or other forces, bring the same motion within the same limits."""
        loads, sets = self.loads, self.loads.sets
        free = np.flatnonzero(sets.lower < sets.upper)
        N = null_space(loads.A[:, free])
        return ActuationUniqueness(
            _rank_along(loads.T[:, free], N),
            _rank_along(sets.G[:, free], N),
            _rank_along(_corner_map(sets)[:, free], N),
            _has_inside(self.program),
        )

    @property
    def still(self) -> bool:
        """Whether the robot is held at rest."""
        return not (self.a.any() or self.state.v.any())

    def _outcome(self) -> str:
        """What the torques do, in words."""
        return "held" if self.still else "moves as wanted"

    def __str__(self) -> str:
        robot = self.state.robot
        used = self.torque_use
        largest = "without motors"
        if robot.nu and np.isfinite(robot.effort_limit).any():
            worst = int(np.argmax(used))
            largest = f"largest torque {100 * used[worst]:.1f} % of its limit ({robot.actuated_names[worst]})"
        elif robot.nu:
            worst = int(np.argmax(np.abs(self.tau)))
            largest = f"largest torque {abs(self.tau[worst]):.4g} N m ({robot.actuated_names[worst]}; no limits are stated)"
        head = f"{self._outcome()}: {largest}, residual {self.residuals.stationarity:.1e} N"
        edge = [f for f in self.margins.corner_friction.values() if (f < 1e-6).any()]
        if edge and not self.margin:
            head += "\n  friction is at its limit: with these torques other motions may be possible, too"
        if not self.least:
            head += "\n  other torques may need less effort: the least was not found to nine digits"
        return "\n".join([head] + [f"  {name:<16}{c}" for name, c in self.contacts.items()])


def _rank_along(A: Array, N: Array) -> int:
    """Rank of A N beside A itself: what is zero but for rounding has none."""
    size = float(np.linalg.norm(A)) if N.size else 0.0
    return rank_of(A @ N / size, unit=True) if size else 0


def _corner_map(sets: ForceSet) -> Array:
    """Forces at points, and of single rows, of unit weights, shape (s, p)."""
    blocks = [np.zeros((0, sets.size))]
    for e in sets.elements:
        part = np.zeros((3, sets.size))
        part[:, e.columns] = sets.push[e.columns].T
        blocks.append(part)
    return np.concatenate(blocks)


def _has_inside(program: Conic) -> bool:
    """Whether some x is strictly inside of everything: cones, bounds and rows, by a margin over one."""
    n = len(program.g)
    if not n:
        return True
    # Largest s <= 1 with cones, bounds and rows held with a margin of s: their normal, or value, less s.
    fixed, one = program.lower == program.upper, np.ones((n, 1))
    shift = np.zeros((n, 1))
    shift[program.cones[:, 2]] = 1.0  # x = x' + s n: x' in the cone, x inside it
    free, own = np.flatnonzero(~fixed), program.C @ shift
    lower, upper = np.where(fixed, program.lower, -math.inf), np.where(fixed, program.upper, math.inf)
    found = solve_conic(
        Conic.of(
            {
                "x": Unknowns(n, 0.0, 0.0, lower, upper, program.cones, program.mu),
                "margin": Unknowns(1, 0.0, -1.0, -1.0, 1.0),
            },
            [({"x": program.A, "margin": program.A @ shift}, program.b)],
            [
                ({"x": np.eye(n)[free], "margin": -one[free]}, program.lower[free], math.inf),
                ({"x": np.eye(n)[free], "margin": one[free]}, -math.inf, program.upper[free]),
                ({"x": program.C, "margin": own - 1.0}, program.low, math.inf),
                ({"x": program.C, "margin": own + 1.0}, -math.inf, program.high),
            ],
        ),
        newton=False, tolerance=1e-8,
    )  # fmt: skip
    return found.solved and float(found["margin"][0]) > _INSIDE
