"""Rates and loop Jacobians of planar mechanisms in absolute angles: the angle of each link from the ground, as in textbooks.

A robot file measures the angle of a joint from the body before it. With theta the angles of the links from the ground,

    theta' = T q',     J_theta = J_q T^-1,     (p_a - p_b)' = J_theta theta' = J_1 theta'_known + J_2 theta'_unknown

T is triangular, of zeros and signs. A joint that slides keeps its displacement as coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, check_finite
from rbd.constraints.constraint import Constraint, frames_of, loop_dof, rows_of
from rbd.constraints.manifold import own_or
from rbd.errors import InputError, nearest
from rbd.mechanism.partition import Columns
from rbd.model.state import State, check_state
from rbd.robots.linkage import link_angles

_NORMAL = np.array([0.0, 1.0, 0.0])


def link_rates(state: State, rates: Sequence[float] | Array | None = None) -> dict[str, float]:
    """{link: its angular velocity from the ground [rad/s]}, of a mechanism in the x-z plane.

    Counter-clockwise as seen from -y, as `link_angles`. Of a coupler it is the crank's rate plus that of the joint between
    them. Angular accelerations add up in the same way: `link_rates(state, a)` in rad/s2.

    Args:
        state: The mechanism, moving.
        rates: Other joint rates or joint accelerations, shape (nv,); None for the state's velocity.

    Raises:
        InputError: a link that is turned out of the plane, another shape, numbers that are not finite.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40)).at("assembled")
        >>> v = rbd.mechanism.velocity_partition(state, known={"crank_joint": 25.0}).v
        >>> round(rbd.mechanism.link_rates(state, v)["coupler"], 4)
        -4.1209
    """
    angles = link_angles(state)
    given = state.v if rates is None else as_array("rates", rates)
    if given.shape != (state.robot.nv,):
        raise InputError(f"rates have shape {given.shape}; expected ({state.robot.nv},): one for each velocity of the robot.")
    check_finite("rates", given)
    turning = _turning(state)
    bodies = {name: state.robot.site(name)[0] for name in angles}
    return {name: float(_along(state, joint, turning) @ given) for name, joint in bodies.items()}


def link_jacobians(
    state: State, constraints: Sequence[Constraint] | None = None, *, known: Sequence[str], loops: bool = True
) -> Columns:
    """J1 and J2 of the loops of a flat mechanism in absolute angles, with the signed det J2.

    Two rows a loop, the world's x and z of e = p_a - p_b, frame_a's point less frame_b's: J1 theta1' + J2 theta2' = e', zero
    while the loop is closed. A bar of length L from its own hinge to the next has the column L (-sin theta, cos theta),
    with a minus on the way of frame_b. For `four_bar` with the crank known::

        J1 = a (-sin th2, cos th2),  J2 = [b (-sin th3, cos th3), -c (-sin th4, cos th4)],  det J2 = b c sin(th3 - th4) [m2]

    It is a function of the state, also where the loop is open. `velocity_partition` takes joint rates instead.

    Args:
        state: The mechanism, in the x-z plane; its velocity is not used.
        constraints: Loop closures, not "rigid" ones; None for those of the robot's file.
        known: Names of links whose angles are known, or of joints that slide.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        `J_known` (J1) and `J_unknown` (J2) [m, or 1 for sliding joints], `determinant`, rank and condition of J2.

    Raises:
        InputError: joints other than hinges across the plane and slides in it, constraints that are no loops, an unknown or
            repeated name.

    Example:
        >>> state = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40)).at("assembled")
        >>> found = rbd.mechanism.link_jacobians(state, known=["crank"])
        >>> rates = -np.linalg.solve(found.J_unknown, found.J_known) @ [25.0]  # from the ground [rad/s]
        >>> found.unknown, rates.round(3), round(found.determinant)
        (('coupler', 'rocker'), array([-4.121,  6.998]), -5781)
    """
    robot, turning = check_state(state).robot, _turning(state)
    joints = list(robot.joints.values())
    names = [_name(state, joint.id) if turning[joint.v.start] else joint.name for joint in joints]
    T = np.array(
        [_along(state, joint.id, turning) if turning[joint.v.start] else np.eye(robot.nv)[joint.v.start] for joint in joints]
    ).reshape(robot.nv, robot.nv)
    held = own_or(robot, constraints, loops)
    rows_of(state, held)  # refuses what is no constraint, and frames that the robot does not have
    rows = [_moving(state, a) - _moving(state, b) for a, b in (_ends(state, loop) for loop in held)]
    J = np.vstack([np.zeros((0, robot.nv)), *rows]) @ np.linalg.inv(T)
    mask = _mask(names, known)
    scale = np.array([1.0 if turning[joint.v.start] else robot.joints.reach for joint in joints])
    s = np.linalg.svd(J[:, ~mask] * scale[~mask], compute_uv=False)
    listed = np.array(names, dtype=object)
    return Columns(tuple(listed[mask]), tuple(listed[~mask]), J[:, mask], J[:, ~mask], s)


def _ends(state: State, loop: Constraint) -> tuple[str, str]:
    """The frames that a loop pins to each other.

    Raises:
        InputError: it does something else in the plane.
    """
    frames = frames_of(loop)
    if len(frames) != 2 or loop_dof(loop, state, _NORMAL) != 1:
        raise InputError(
            f"{loop.name!r:.80} is no pin of a loop; link_jacobians wants loop closures of kind planar, point or revolute "
            "about y. For all others: velocity_partition."
        )
    return frames[0], frames[1]


def _turning(state: State) -> Array:
    """+1 for joints that turn counter-clockwise as seen from -y, -1 for clockwise, 0 for those that slide in the plane, (nv,).

    Raises:
        InputError: a joint that does neither.
    """
    robot = state.robot
    if not robot.joints:
        return np.zeros(0)
    _, _, J = state.joint_motion([joint.id for joint in robot.joints.values()])
    for joint in robot.joints.values():
        one = J[:6, joint.v]
        hinge = joint.nv == 1 and np.abs(np.abs(one[3:, 0]) - [0.0, 1.0, 0.0]).max() < 1e-9
        slide = joint.nv == 1 and np.abs(one[[1, 3, 4, 5], 0]).max() < 1e-9
        if not (hinge or slide):
            raise InputError(
                f"joint {joint.name!r:.80} of {robot.name} neither turns about y nor slides in the x-z plane; absolute angles "
                "are for flat mechanisms."
            )
    return np.array(-np.round(J[4]) + 0.0)


def _along(state: State, joint: int, turning: Array) -> Array:
    """Row of T for the body of a joint: its angular velocity for each joint rate, shape (nv,)."""
    model, out = state.robot.model, np.zeros(state.robot.nv)
    for ancestor in list(model.supports[joint])[1:]:
        i = model.joints[ancestor].idx_v
        out[i] = turning[i]
    return out


def _moving(state: State, frame: str) -> Array:
    """Jacobian of a frame's origin in the world's x and z, shape (2, nv)."""
    _, J, *_ = state.moving(frame, pin.SE3.Identity(), pin.LOCAL_WORLD_ALIGNED)
    return np.array(J[[0, 2]])


def _name(state: State, joint: int) -> str:
    """The first link on the body of a joint; the joint's name if it has none."""
    robot = state.robot
    on_it = [name for name in robot.links() if robot.site(name)[0] == joint]
    return on_it[0] if on_it else str(robot.model.names[joint])


def _mask(names: list[str], known: Sequence[str]) -> Array:
    """Which coordinates are known.

    Raises:
        InputError: known is no list of these names, each once.
    """
    if isinstance(known, str) or not isinstance(known, list | tuple):
        raise InputError(f"known is {known!r:.80}; expected a list of links, e.g. {names[:1]}.")
    for i, name in enumerate(known):
        if name not in names:
            raise InputError(f"no link of this mechanism that turns is called {name!r:.80}; {nearest(name, names)}.")
        if name in known[:i]:
            raise InputError(f"known names {name!r:.80} twice.")
    return np.array([name in known for name in names], dtype=bool)
