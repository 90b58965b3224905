"""`inverse_dynamics`: the motor torques and contact forces with which a robot moves as wanted."""

from __future__ import annotations

from collections.abc import Sequence

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.model.dynamics import External, checked
from rbd.model.state import State
from rbd.problem.contact_motion import REST_SPEED
from rbd.statics.actuation import Actuation
from rbd.statics.effort import Effort
from rbd.statics.wanted_motion import MARGIN, WantedMotion, checked_margin


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
) -> Actuation:
    """Motor torques and contact forces with which a robot accelerates as wanted: M a + h = S^T tau + tau_ext + J^T f.

    Torques are within their limits, nothing drives bases and passive joints, and forces are those that the wanted motion
    allows under Coulomb's law, point by point, with c = J a + J_dot v: a point that keeps still (c = 0) any force in its cone;
    one that opens (c_n > 0) none; one that slips (c_n = 0, c_t != 0, or it slides already) friction mu f_n against the slip; a
    bilateral row any. Of all these it takes the ones of least effort, sum (tau / limit)^2 and a small weight on the forces.

    Args:
        state: The robot at (q, v).
        a: The wanted acceleration, shape (nv,) [m/s2, rad/s2]; of a floating base in the base's axes, as `Solution.a`.
        contacts: Contacts, loops and other constraints, each with its own name.
        external: Other forces of the world: generalised (nv,), or `ExternalForce`s.
        friction: "cone": circular cones. "inscribed": the pyramids inside them, of each contact's facets; for points that keep
            still.
        objective: What is made least, and bounds on normal forces and centres of pressure; see `rbd.statics.Effort`.
        margin: Forces of points that keep still stay within 1 - margin of their cones. With 0 they may reach the limit, where
            `rbd.solve` with these torques may find another motion.
        rest_speed: As of `rbd.solve`.

    Returns:
        Torques, forces, corner forces, margins and residuals. `rbd.solve(state, actuation.tau, contacts)` gives back `a`
        where the motion of these torques is unique.

    Raises:
        InputError: wrong sizes, NaN, unknown frames, an objective that is none.
        DuplicateName: two constraints of one name.
        ContactMoves: a velocity that the contacts do not allow; `rbd.mechanism.project_velocity` puts it onto them.
        CannotMove: a point would sink, a held row would move; or there are no such torques and forces. Then it names an
            irreducible set of limits in the way, with a proof, and what is missing; `error.nearest()` is the nearest
            acceleration that is possible.
    """
    robot = checked(state).robot
    a = robot.check_v(a, "a")
    wanted = WantedMotion.of(state, a, contacts, external, objective, friction, rest_speed, holds=False, stacklevel=3)
    return wanted.actuation(checked_margin(margin), stacklevel=3)
