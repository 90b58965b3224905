"""`hold` and `hold_many`: the motor torques and contact forces that keep a robot at rest, at one pose or at many."""

from __future__ import annotations

from collections.abc import Sequence

from rbd.answers.many.states import Friction, ManyExternal, ManyStates
from rbd.arrays import Array, zeros
from rbd.constraints.constraint import Constraint, with_loops
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External
from rbd.model.state import State, checked
from rbd.problem.contact_motion import REST_SPEED
from rbd.statics.actuation import Actuation
from rbd.statics.actuations import Actuations, actuations_of
from rbd.statics.effort import Effort
from rbd.statics.wanted_motion import EffortChoice, WantedMotion
from rbd.statics.why_impossible import actuation_of


def hold(
    state: State,
    contacts: Sequence[Constraint],
    *,
    external: External = None,
    friction: str = "cone",
    objective: Effort | None = None,
    margin: float | None = None,
    loops: bool = True,
) -> Actuation:
    """Motor torques that keep a robot at rest, and the contact forces that go with them: inverse dynamics with a = 0, v = 0.

    Minimises sum (tau / limit)^2, plus a small weight on the forces, subject to S^T tau + tau_ext + J^T f = h(q, 0),
    `|tau| <= limit`, and corner forces in their friction cones. A motor without a stated limit is weighed against body weight
    times one metre.

    Args:
        state: The pose; v must be zero.
        contacts: What it stands on; bilateral contacts (friction=None) may pull.
        external: Other forces to hold against: generalised (nv,), or `ExternalForce` objects and springs
            (`rbd.constraints.forces`).
        friction: "cone": circular cones. "inscribed": the pyramids inside them, of each contact's facets.
        objective: What is made least, and bounds on normal forces and centres of pressure; see `rbd.statics.Effort`.
        margin: Corner forces stay within 1 - margin of their cones. None: 5 % from the limit where that is possible, else up to
            the limit itself; `Actuation.margin` says which. At the limit the robot is held, but these torques may allow
            other motions too.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The torques, with a = 0. What cannot be held within 1e-6 of a limit is refused, with a certificate; what can, is found.
        A `JointLimitWarning` names joints beyond their limits, and a `DistantContactWarning` contacts off their planes.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
        CannotHold: naming the limits that prevent it, with the certificate and what is missing.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> wind = rbd.ExternalForce("base_link", (5.0, 0.0, 0.0))
        >>> held = rbd.hold(solo.standing(), solo.feet(friction=0.7), external=[wind])
        >>> held.tau[:3].round(3), held.forces["front_left"].round(3)
        (array([-0.401, -0.311,  0.632]), array([-1.707, -0.516,  7.621]))
    """
    robot = checked(state).robot
    choice = EffortChoice.of(objective, friction, margin, REST_SPEED, holds=True)
    given = with_loops(robot, contacts, loops)
    return actuation_of(WantedMotion.of(state, zeros(robot.nv), given, external, choice, stacklevel=3), stacklevel=3)


def hold_many(
    robot: CheckedModel,
    q: Array,
    contacts: Sequence[Constraint],
    *,
    external: ManyExternal = None,
    coefficients: Friction = None,
    friction: str = "cone",
    objective: Effort | None = None,
    margin: float | None = None,
    loops: bool = True,
) -> Actuations:
    """Motor torques and contact forces that hold a robot still at n poses: what `hold` answers at each, as arrays.

    A pose that cannot be held is a row of NaN with its `rbd.answers.many.StateStatus` and a message; `actuations[i]` then
    raises `hold`'s error, with the limits that prevent it and the certificate. Other errors and warnings: `rbd.solve_many`.

    Args:
        robot: The robot.
        q: Configurations, shape (n, nq), or (nq,).
        contacts: As of `hold`.
        external: Generalised forces (n, nv) or (nv,), or `ExternalForce`s and springs (`rbd.constraints.forces`) that act at
            every pose.
        coefficients: Of friction, in place of the contacts' own: a number or (n,), of all contacts that have one, or
            {contact: a number or (n,)}.
        friction: As of `hold`.
        objective: As of `hold`.
        margin: As of `hold`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: what concerns all poses: wrong sizes, numbers of states that differ, an objective that is none.
        UnknownName: unknown frames, or coefficients of a contact that is not there.
        DuplicateName: two contacts of one name.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> q = np.array([solo.standing().q, solo.standing("straight_standing").q])
        >>> held = rbd.statics.hold_many(solo, q, solo.feet(friction=0.7))
        >>> held.tau[:, :3].round(3)
        array([[-0.31 , -0.012,  0.619],
               [-0.201, -0.012,  0.618]])
    """
    choice = EffortChoice.of(objective, friction, margin, REST_SPEED, holds=True)
    states = ManyStates.of(robot, q, None, contacts, external=external, friction=coefficients, loops=loops)
    return actuations_of(states, choice, stacklevel=2)
