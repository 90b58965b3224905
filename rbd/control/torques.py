"""`inverse_dynamics` and `inverse_dynamics_many`: motor torques and contact forces that produce a wanted motion."""

from __future__ import annotations

from collections.abc import Sequence

from rbd.answers.many.states import Friction, ManyExternal, ManyStates
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, with_loops
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External
from rbd.model.state import State, checked
from rbd.problem.contact_motion import REST_SPEED
from rbd.statics.actuation import Actuation
from rbd.statics.actuations import Actuations, actuations_of
from rbd.statics.effort import Effort
from rbd.statics.wanted_motion import MARGIN, EffortChoice, WantedMotion, checked_margin
from rbd.statics.why_impossible import actuation_of


def inverse_dynamics(
    state: State,
    a: Array,
    contacts: Sequence[Constraint],
    *,
    external: External = None,
    friction: str = "cone",
    objective: Effort | None = None,
    margin: float = MARGIN,
    rest_speed: float = REST_SPEED,
    loops: bool = True,
) -> Actuation:
    """Motor torques and contact forces with which a robot accelerates as wanted: M a + h = S^T tau + tau_ext + J^T f.

    Torques are within their limits, nothing drives bases and passive joints, and forces are those that the wanted motion
    allows under Coulomb's law, point by point, with y = J a + J_dot v: a point that keeps still (y = 0) any force in its cone;
    one that opens (y_n > 0) none; one that slips (y_n = 0, y_t != 0, or it slides already) friction mu f_n against the slip; a
    bilateral row any. Of all these it takes the ones of least effort, sum (tau / limit)^2 and a small weight on the forces.

    Args:
        state: The robot at (q, v).
        a: The wanted acceleration, shape (nv,) [m/s2, rad/s2]; of a floating base in the base's axes, as `Solution.a`.
        contacts: Contacts, loops and other constraints, each with its own name.
        external: Other forces of the world: generalised (nv,), or `ExternalForce` objects and springs
            (`rbd.constraints.forces`).
        friction: "cone": circular cones. "inscribed": the pyramids inside them, of each contact's facets; for points that keep
            still.
        objective: What is made least, and bounds on normal forces and centres of pressure; see `rbd.statics.Effort`.
        margin: Forces of points that keep still stay within 1 - margin of their cones. With 0 they may reach the limit, where
            `rbd.solve` with these torques may find another motion.
        rest_speed: As of `rbd.solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        Torques, forces, corner forces, margins and residuals. `rbd.solve(state, actuation.tau, contacts)` gives back `a`
        where the motion of these torques is unique.

    Raises:
        InputError: wrong sizes, NaN, unknown frames, an objective that is none.
        DuplicateName: two constraints of one name.
        ContactMoves: a velocity that the contacts do not allow; `rbd.mechanism.project_velocity` puts it onto them.
        CannotMove: a point would sink, a held row would move; or there are no such torques and forces. Then it names an
            irreducible set of limits that prevent it, with a certificate, and what is missing; `error.nearest()` is the nearest
            acceleration that is possible.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> a = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[2], feet).a  # the trunk up, the feet still
        >>> wanted = rbd.inverse_dynamics(state, a, feet)
        >>> print(wanted.tau[:3].round(3), np.abs(rbd.solve(state, wanted.tau, feet).a - a).max() < 1e-9)
        [-0.341 -0.019  0.68 ] True
    """
    robot = checked(state).robot
    a = robot.check_v(a, "a")
    choice = EffortChoice.of(objective, friction, checked_margin(margin), rest_speed, holds=False)
    wanted = WantedMotion.of(state, a, with_loops(robot, contacts, loops), external, choice, stacklevel=3)
    return actuation_of(wanted, stacklevel=3)


def inverse_dynamics_many(
    robot: CheckedModel,
    q: Array,
    v: Array | None,
    a: Array,
    contacts: Sequence[Constraint],
    *,
    external: ManyExternal = None,
    coefficients: Friction = None,
    friction: str = "cone",
    objective: Effort | None = None,
    margin: float = MARGIN,
    rest_speed: float = REST_SPEED,
    t: Array | float = 0.0,
    loops: bool = True,
) -> Actuations:
    """Motor torques and contact forces of n wanted motions: what `inverse_dynamics` answers at each, as arrays.

    A motion that is not possible is a row of NaN with its `rbd.answers.many.StateStatus` and a message; `actuations[i]` then
    raises
    the error of `inverse_dynamics`, with the limits that prevent it and the certificate. Other errors and warnings are those of
    `rbd.solve_many`.

    Args:
        robot: The robot.
        q: Configurations, shape (n, nq), or (nq,).
        v: Velocities, shape (n, nv), or (nv,) [m/s, rad/s]; None: at rest.
        a: The wanted accelerations, shape (n, nv), or (nv,) [m/s2, rad/s2].
        contacts: As of `inverse_dynamics`.
        external: Generalised forces (n, nv) or (nv,), or `ExternalForce`s and springs (`rbd.constraints.forces`) that act at
            every state.
        coefficients: Of friction, in place of the contacts' own: a number or (n,), of all contacts that have one, or
            {contact: a number or (n,)}.
        friction: As of `inverse_dynamics`.
        objective: As of `inverse_dynamics`.
        margin: As of `inverse_dynamics`.
        rest_speed: As of `rbd.solve`.
        t: As of `rbd.solve_many`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: what concerns all states: wrong sizes, numbers of states that differ, an objective that is none.
        UnknownName: unknown frames, or coefficients of a contact that is not there.
        DuplicateName: two constraints of one name.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> up = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[2], feet).a  # the trunk up, the feet still
        >>> wanted = rbd.control.inverse_dynamics_many(solo, state.q, None, np.outer([1.0, 0.0, -20.0], up), feet)
        >>> wanted.forces["front_left"][:, 2].round(3), list(wanted.reasons)  # the last would need feet that pull
        (array([6.698, 6.131,   nan]), [2])
    """
    choice = EffortChoice.of(objective, friction, checked_margin(margin), rest_speed, holds=False)
    states = ManyStates.of(robot, q, v, contacts, external=external, friction=coefficients, t=t, a=a, loops=loops)
    return actuations_of(states, choice, stacklevel=2)
