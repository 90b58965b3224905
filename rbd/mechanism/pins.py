"""Forces in the pins of a mechanism: of the body before a joint on the body that it moves, and in the pins that close loops.

Newton and Euler's equations of all bodies beyond a joint, at the accelerations of an answer, with the forces of loops and
pushes on them, leave one unknown: the wrench across the joint. Its part along the joint's own motion is the motor's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import closes_loop, frames_of, member
from rbd.errors import InputError
from rbd.model.external import acting
from rbd.model.state import State

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.statics.actuation import Actuation

_WHAT_ACTS = "Pin forces are known where loops, pushes, and motors, springs and stops in joints are all that acts."


def pin_forces(solution: Solution | Actuation) -> dict[str, Array]:
    """{joint: force [N] and moment [N m] of the body before it on the body that it moves, at its origin, in W, shape (6,)}.

    After the joints come the pins that close loops, by the loop's name: force and moment of the body of frame_a on that of
    frame_b, at frame_b's origin; where frame_b is on the ground, of the ground on the body of frame_a. The other body gets the
    opposite at the same point. Rods and ropes are links, and left out: their forces are in `solution.forces`.

    About a joint's axis the moment is that of its motor, spring or stop. In a planar mechanism all forces are in its plane. If
    its links lie in planes beside each other, joints have moments across their axes too; a closure of kind "planar" has none,
    its force acts at frame_b's origin.

    Args:
        solution: What `rbd.solve` or `rbd.hold` returned for a mechanism.

    Raises:
        InputError: it was not assembled from a state; a loop has the name of a joint; or contacts, force elements between
            bodies, generalised forces or other constraints act, whose forces on single bodies are not known here.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> still = rbd.hold(robot.at("assembled"), [])
        >>> pins = rbd.mechanism.pin_forces(still)
        >>> list(pins)
        ['crank_joint', 'coupler_joint', 'rocker_joint', 'coupler_pin']
        >>> round(float(pins["crank_joint"][2] + pins["rocker_joint"][2]), 4)  # both on the ground: 7 kg times 9.81 m/s2
        68.67
    """
    origin: Any = getattr(getattr(solution, "problem", None), "origin", solution)
    state = getattr(origin, "state", None)
    if not isinstance(state, State):
        raise InputError(f"{solution!r:.80} is no answer at a state; expected what rbd.solve returned.")
    robot = state.robot
    wrenches = np.zeros((robot.model.njoints, 6))  # at W's origin
    closing: dict[str, Array] = {}
    for constraint in origin.constraints:
        rows = constraint.rows(state)
        if closes_loop(constraint):
            if rows.name in robot.joints:
                raise InputError(f"loop {rows.name!r:.80} has the name of a joint of {robot.name}; give it another name.")
            if len(rows):
                f = np.asarray(solution.forces[rows.name], float)
                wrench = np.r_[f, np.zeros(6 - len(f))]
                _add_loop(state, constraint, wrench, wrenches)
                if not member(constraint, "is_link"):
                    closing[rows.name] = wrench
        elif rows.resultant is not None or np.count_nonzero(np.abs(rows.J).max(axis=0, initial=0.0)) > 1:
            raise InputError(f"{rows.name!r:.80} acts on {robot.name}. {_WHAT_ACTS}")
    given, pushes, elements = acting(origin.external)
    between = [element.name for element in elements if getattr(element, "joint", None) is None]
    if given is not None or between:
        raise InputError(f"{', '.join(between) or 'a generalised force'} acts on {robot.name}. {_WHAT_ACTS}")
    for push in pushes:
        p = state.frame(push.frame, push.offset).X_WF.translation
        wrenches[robot.site(push.frame)[0]] += _at_origin(np.r_[push.force, push.moment], p)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, state.q)
    forces = pin.StdVec_Force()
    for X_WJ, wrench in zip(data.oMi, wrenches, strict=True):
        forces.append(X_WJ.actInv(pin.Force(wrench)))
    pin.rnea(robot.model, data, state.q, state.v, np.asarray(solution.a, float), forces)
    turned = [np.kron(np.eye(2), X.rotation) for X in data.oMi]
    return {joint.name: turned[joint.id] @ data.f[joint.id].vector for joint in robot.joints.values()} | closing


def _add_loop(state: State, loop: Any, wrench: Array, wrenches: Array) -> None:
    """Add a closure's wrench at frame_b's origin: on the body of frame_b, and the opposite on that of frame_a."""
    first, second = (state.robot.site(frame)[0] for frame in frames_of(loop))
    p = state.frame(frames_of(loop)[1]).X_WF.translation
    wrench = _at_origin(wrench, p)
    sign = 1.0 if second else -1.0  # with frame_b on the ground it is the force on the body of frame_a
    wrenches[second] += sign * wrench
    wrenches[first] -= sign * wrench


def _at_origin(wrench: Array, p: Array) -> Array:
    """A wrench at a point as that at W's origin."""
    return np.r_[wrench[:3], wrench[3:] + np.cross(p, wrench[:3])]
