"""What legs must be able to do to walk, and where the ankles of a foot can carry the weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, inertia_factor
from rbd.centroid.program import inner_corners
from rbd.constraints.convex.polygons import clipped
from rbd.errors import CannotReach, ModelError, SingularInertia
from rbd.mechanism.pose_search import find_pose
from rbd.model.state import State
from rbd.robots.robot import Robot

ANKLES = 0.8
"""Forces of the plan act where the whole weight takes at most this share of the torque limits of the ankles."""
ANKLE = 0.1
"""Joints of a foot are nearer to the last one than this, over h: the others are of the leg."""
WIDEST = 1.25
"""Angle between two feet that is tried at most [rad]."""
BENT, RANK = 0.1, 1e-6
"""Legs are bent by so much [rad] before their directions are counted: straight ones move in fewer. The smallest singular value
of a direction, over the largest."""


def check_legs(state: State, feet: Sequence[Any], h: float) -> None:
    """Refuse a robot that cannot walk, whatever the plan.

    Args:
        state: Where it starts.
        feet: Its contacts.
        h: Height of its centre of mass over them [m].

    Raises:
        ModelError: two feet that are points; feet that the motors move in fewer directions than they must.
        SingularInertia: M is singular where it starts.
    """
    robot = state.robot
    try:
        inertia_factor(state.M, strict=True)
    except SingularInertia as error:
        raise SingularInertia(
            f"{robot.name} has no motion where it stands: {error} rbd.doctor(robot) names the joint and its links."
        ) from error
    points = [foot.name for foot in feet if len(foot.corners) == 1]
    if len(feet) == 2 and points:
        raise ModelError(
            f"{robot.name} has two feet, and {' and '.join(points)} {'are points' if len(points) > 1 else 'is a point'}: it "
            "falls about the line through them, and no torque keeps it at rest before its first step or after its last. Walk "
            "expects two soles, or four feet."
        )
    step = np.zeros(robot.nv)
    step[robot.motors] = BENT
    bent = State(robot, pin.integrate(robot.model, state.q, step))
    for foot in feet:
        J = bent.frame(foot.frame, foot.placement.act(foot.corners.mean(axis=0))).J[:, robot.motors]
        J = J[:3] / h if len(foot.corners) == 1 else np.vstack([J[:3] / h, J[3:]])
        U, sizes, _ = np.linalg.svd(J, full_matrices=False)
        n = int((sizes > RANK * sizes[0]).sum())
        if n < len(J):
            raise ModelError(
                f"joints of {robot.name} move {foot.name!r:.80} in {n} directions, and not along "
                f"{np.round(U[:3, -1], 2).tolist()}: it cannot be put down where balance needs it. Walk expects "
                f"{len(J)} directions of {'a point' if len(J) == 3 else 'a sole'}."
            )


def turning_range(robot: Robot, state: State, poses: Mapping[str, pin.SE3], left: str) -> float:
    """The largest angle between two feet, toes out, at which legs take them within their joint limits where they stand [rad].

    By `rbd.find_pose` with the base where it stands, upright, halved until it is known to 0.05 rad; at most 1.25.

    Args:
        robot: The robot.
        state: Where it starts.
        poses: {foot: pose of its contact's centre} of its two soles.
        left: Name of the left foot.
    """
    low, high, angle = 0.0, WIDEST, WIDEST
    base = robot.model.names[robot.bases[0]]
    still = {base: state.frame(base).X_WF}
    while high - low > 0.05:
        turned = {
            name: pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, (0.5 if name == left else -0.5) * angle) @ X.rotation, X.translation)
            for name, X in poses.items()
        }
        try:
            find_pose(robot, turned | still, posture=state)
        except CannotReach:
            high = angle
        else:
            low = angle
        angle = 0.5 * (low + high)
    return low


def carrying(state: State, feet: Sequence[Any], h: float) -> dict[str, Array]:
    """{foot: points at which forces of the plan act, shape (k, 3), as `corners` [m]}.

    The corners, nearer to their middle by a quarter; of a sole, the part of their polygon where the weight m g takes at most
    80 % of the torque limits of its ankles, the joints within 0.1 h of the last: tau = -J^T f with the foot as it stands. What
    the foot itself weighs is neglected, and forces along the ground.

    Raises:
        ModelError: there is no such part.
    """
    robot, out = state.robot, dict[str, Array]()
    weight = -robot.mass * np.asarray(robot.gravity, float)
    column = {int(v): i for i, v in enumerate(np.arange(robot.nv)[robot.motors])}
    for foot in feet:
        corners = np.asarray(foot.corners)
        inner = inner_corners(corners)
        out[foot.name] = inner
        if len(corners) < 3:
            continue
        columns = [column[v] for v in _ankles(state, foot, ANKLE * h) if v in column]
        limits = ANKLES * np.asarray(robot.effort_limit)[columns]
        probes = inner[0] * [0.0, 0.0, 1.0] + [[0.0, 0.0, 0.0], [h, 0.0, 0.0], [0.0, h, 0.0]]
        J = [state.frame(foot.frame, foot.placement.act(p)).J[:3, robot.motors][:, columns] for p in probes]
        at, x, y = (-weight @ each for each in J)
        hull = _around(inner)
        for c, g, most in zip(at, np.column_stack([x - at, y - at]) / h, limits, strict=True):
            size = float(np.linalg.norm(g))
            if np.isfinite(most) and size > 0.0:
                for sign in (1.0, -1.0):
                    hull = clipped(hull, -sign * g[0] / size, -sign * g[1] / size, (sign * c - most) / size)
        if not hull:
            raise ModelError(
                f"ankles of {foot.name!r:.80} of {robot.name} carry its weight nowhere on the sole: their torque limits are "
                f"{np.round(limits / ANKLES, 3).tolist()} N m, and the plan takes {100 * ANKLES:.0f} % of them."
            )
        out[foot.name] = np.column_stack([np.asarray(hull), np.full(len(hull), inner[0, 2])])
    return out


def inertia_on_feet(state: State, feet: Sequence[Any]) -> Array:
    """Angular momentum over the mass by the base's angular velocity, while feet and centre of mass stay, shape (3, 3) [m2].

    In world axes, with joints as slow as may be. Less than the composite inertia: the legs do not turn with the base.
    """
    A_g, _, mass = state.centroidal()
    robot = state.robot
    base = state.frame(robot.model.names[robot.bases[0]]).J[3:]
    Js = [state.frame(f.frame, f.placement.act(f.corners.mean(axis=0))).J for f in feet]
    rows = [J[:3] if len(f.corners) == 1 else J for J, f in zip(Js, feet, strict=True)]
    still = np.vstack([A_g[:3], *rows])
    wanted = np.vstack([np.zeros((len(still), 3)), np.eye(3)])
    v = np.linalg.lstsq(np.vstack([still, base]), wanted, rcond=None)[0]
    return np.asarray(A_g[3:] @ v) / mass


def _around(corners: Array) -> list[tuple[float, float]]:
    """The corners of a sole in order around their middle."""
    off = (corners - corners.mean(axis=0))[:, :2]
    order = np.argsort(np.arctan2(off[:, 1], off[:, 0]))
    return [(float(x), float(y)) for x, y in corners[order, :2]]


def _ankles(state: State, foot: Any, near: float) -> list[int]:
    """Columns of J of the joints that carry a foot and are near to the last of them."""
    model, joint = state.robot.model, state.robot.model.frames[state.robot.model.getFrameId(foot.frame)].parentJoint
    chain = [joint]
    while model.parents[chain[-1]] > 0:
        chain.append(model.parents[chain[-1]])
    places = state.joint_places(chain)[1]
    return [
        int(model.joints[j].idx_v)
        for j, p in zip(chain, places, strict=True)
        if model.joints[j].nv == 1 and np.linalg.norm(p - places[0]) < near
    ]
