"""Warnings of a state: contacts that separate, are off their planes or have none; what moves; joints beyond limits."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.joint import JointLimit
from rbd.constraints.round_feet import warn_of_balls
from rbd.errors import (
    DistantContactWarning,
    InputError,
    JointLimitWarning,
    MovingConstraintWarning,
    OpeningContactWarning,
)
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import ANGLE, AT_LIMIT, Joint
from rbd.model.state import State
from rbd.problem.contact_motion import Opening, opening_words
from rbd.problem.force_set import at_rest
from rbd.problem.ground import TOUCHES
from rbd.problem.rows import Rows
from rbd.records import joined

DEEPEST_M = 0.01
"""Two bodies may be this deep inside each other at the start of a motion [m]."""


def warn_of_opening(robot: CheckedModel, openings: Sequence[Opening], rest_speed: float, *, stacklevel: int) -> None:
    """Name the contacts that move away from what they touch; nothing where none does."""
    if openings:
        warnings.warn(
            f"contacts of {robot.name} separate, and carry no force: {opening_words(openings)} "
            f"(at rest is up to rest_speed = {rest_speed:g} m/s). Of contacts that stay, put the velocity onto them, "
            "state = rbd.mechanism.project_velocity(state, contacts), or give a larger rest_speed=.",
            OpeningContactWarning,
            stacklevel=stacklevel + 1,
        )


def moves(r: Rows, rest_speed: float) -> bool:
    """Whether bilateral rows have a velocity that no feedback takes away."""
    return r.speed > rest_speed and not r.stabilised and at_rest(r.cone).bilateral


def warn_of_moving(robot: CheckedModel, moving: Sequence[tuple[str, float]], *, stacklevel: int) -> None:
    """Say which bilateral constraints have which velocity [m/s, rad/s]; nothing where none has."""
    if moving:
        told = [f"{name!r:.80} at {speed:.3g} m/s or rad/s" for name, speed in moving]
        warnings.warn(
            f"bilateral constraints of {robot.name} move: {joined(told)}. Only their accelerations are prescribed, so they "
            "move on. Put the velocity onto them, state = rbd.mechanism.project_velocity(state, constraints); or give what "
            "they move with, on=rbd.Ground(velocity=...); or a larger rest_speed=.",
            MovingConstraintWarning,
            stacklevel=stacklevel + 1,
        )


def warn_of_distant(
    state: State, constraints: Sequence[Constraint], rows: Sequence[Rows], *, below_only: bool = False, stacklevel: int
) -> None:
    """Warn of contacts that are off their planes, by name; of round feet, of points that are not the lowest.

    Args:
        state: The robot.
        constraints: Its constraints.
        rows: Those of them; those whose feedback pulls them back are left out.
        below_only: Of unilateral contacts, name only those below their planes: others fall onto them.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    balls = warn_of_balls(state, constraints, stacklevel=stacklevel + 1)
    off = [r for r in rows if not r.touches and r.name not in balls]
    overlapping = [r for r in off if r.overlaps]
    if overlapping:
        warnings.warn(
            f"bodies of {state.robot.name} are inside each other: {joined([_deepest(r) for r in overlapping])}. They are "
            "computed as if they touched. Move one of them, or leave the pair out, pairs=[...].",
            DistantContactWarning,
            stacklevel=stacklevel,
        )
    told = distant([r for r in off if not r.overlaps], below_only=below_only)
    if told:
        warnings.warn(
            f"contacts of {state.robot.name} are off the ground that they stand on: {joined(told)}. Move the robot "
            "(robot.standing() puts its feet on z = 0, rbd.find_pose onto terrain), leave out what does not touch, or give the "
            "plane: robot.feet(on=0.75), robot.feet(on={'left_sole': 0.17}), on=rbd.Ground(point=..., normal=...); on=None "
            "where it is not known.",
            DistantContactWarning,
            stacklevel=stacklevel,
        )


def check_start(robot: CheckedModel, rows: Sequence[Rows], *, stacklevel: int) -> None:
    """Refuse a motion that begins with bodies deep inside each other; warn of contacts that can break and have no ground.

    Such a contact stands on the plane through its pose at the start. No warning where that is z = 0 to a millimetre.

    Raises:
        InputError: bodies inside each other by more than `DEEPEST_M`.
    """
    deep = [_deepest(r) for r in rows if max((depth for _, depth in r.overlaps), default=0.0) > DEEPEST_M]
    if deep:
        raise InputError(
            f"bodies of {robot.name} are inside each other at the start: {joined(deep)}; a simulation accepts up to "
            f"{1e3 * DEEPEST_M:g} mm, as pushing them apart makes energy. Move one of them, or leave the pair out."
        )
    told = [f"{r.name!r:.80} on {words}" for r in rows if (words := _own_plane(r))]
    if told:
        warnings.warn(
            f"contacts of {robot.name} have no ground, so each stands where it is at the start: {joined(told)}. Give the "
            "ground, on=0.0, on=rbd.Ground(point=..., normal=...), or robot.feet(on=...).",
            DistantContactWarning,
            stacklevel=stacklevel,
        )


def _own_plane(r: Rows) -> str:
    """The plane through a contact's own pose, of one that can break and has no other; empty where it is z = 0."""
    patch = r.patch
    if patch is None or patch.on is not None or patch.against is not None or patch.friction is None or not len(patch.corners):
        return ""
    if r.error is not None or patch.turned is not None:  # its anchor is on the plane; it is on several planes
        return ""
    n, p = patch.axes[:, 2], patch.point
    if np.abs(patch.corners_W[:, 2]).max() <= TOUCHES and n[2] > 0.0:
        return ""
    level = f"z = {p[2]:.4g} m" if n[2] > 1.0 - 1e-9 else f"the plane through ({p[0]:.3g}, {p[1]:.3g}, {p[2]:.3g}) m"
    return level + ("" if n[2] > 1.0 - 1e-9 else f" with the normal ({n[0]:.3g}, {n[1]:.3g}, {n[2]:.3g})")


def _deepest(r: Rows) -> str:
    """How deep two bodies are inside each other, in words."""
    point, depth = max(r.overlaps, key=lambda each: each[1])
    which = f" and {len(r.overlaps) - 1} more points" if len(r.overlaps) > 1 else ""
    return f"{r.name!r:.80} {1e3 * depth:.4g} mm at {point!r:.120}{which}"


def distant(rows: Sequence[Rows], *, below_only: bool = False) -> list[str]:
    """Contacts that are off their planes, by how much, in words; see `warn_of_distant`."""
    told = []
    for r in rows:
        if r.overlaps:
            told.append(_deepest(r))
        gaps = r.gaps_off_plane
        if gaps is None:
            continue
        assert r.patch is not None
        within = r.patch.within
        far = np.abs(gaps) > within
        if below_only and not at_rest(r.cone).bilateral:
            far = gaps < -within
        if far.any():
            worst = float(gaps[np.argmax(np.abs(gaps) * far)])
            which = "" if len(gaps) == 1 or far.all() else f" ({int(far.sum())} of {len(gaps)} points)"
            told.append(f"{r.name!r:.80}{which} {1e3 * abs(worst):.4g} mm {'above' if worst > 0.0 else 'below'}")
    return told


def warn_of_limits(state: State, constraints: Sequence[Constraint] = (), *, stacklevel: int) -> None:
    """Name the joints that are beyond their limits, once a state; nothing where none is.

    Args:
        state: Whose.
        constraints: A `JointLimit` among them has its own bounds, and its joint may be beyond by a millimetre or milliradian.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    robot = state.robot
    if state.limits_checked or robot.joints.within_limits(state.q):
        state.limits_checked = True
        return
    low, high = joint_bounds(robot, constraints)
    beyond = (state.q < low) | (state.q > high)
    if beyond.any():
        state.limits_checked = True
        warnings.warn(
            f"joints of {robot.name} are beyond their limits: {_beyond_words(state, beyond)}. The pose is taken as it is. "
            "Angles are in radians; robot.joints lists the limits.",
            JointLimitWarning,
            stacklevel=stacklevel,
        )


def beyond_limits_words(state: State) -> str:
    """The joints that are beyond their limits, with these; empty where none is."""
    low, high = joint_bounds(state.robot, ())
    beyond = (state.q < low) | (state.q > high)
    return _beyond_words(state, beyond) if beyond.any() else ""


def _beyond_words(state: State, beyond: Array) -> str:
    joints = state.robot.joints
    names = list(dict.fromkeys(joints.positions[i].joint for i in beyond.nonzero()[0].tolist()))
    told = [_beyond(joint, float(state.q[joint.q.start])) for joint in map(joints.__getitem__, names[:6])]
    return "; ".join(told) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def joint_bounds(robot: CheckedModel, constraints: Sequence[Constraint]) -> tuple[Array, Array]:
    """(lower, upper) beyond which an entry of q is told of, shapes (nq,): see `warn_of_limits`."""
    low, high = robot.joints.limits[0] - AT_LIMIT, robot.joints.limits[1] + AT_LIMIT
    for one in constraints:
        if isinstance(one, JointLimit):
            at, (lower, upper) = robot.joints[one.joint].q, one.bounds(robot)
            low[at], high[at] = lower - TOUCHES, upper + TOUCHES
    return low, high


def _beyond(joint: Joint, value: float) -> str:
    turned = math.radians(value)
    degrees = joint.unit == ANGLE and abs(value) > 2.0 * math.pi and joint.lower <= turned <= joint.upper
    hint = f": {value:.4g} looks like degrees, {turned:.4g} rad" if degrees else ""
    return f"{joint.name!r:.80} is at {value:.4g} {joint.unit}, of {joint.lower:.4g} to {joint.upper:.4g} {joint.unit}{hint}"
