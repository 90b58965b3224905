"""Postures: joint angles by name, and a base placed so that feet, or other contacts, touch the ground."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import listed, made, member
from rbd.constraints.contact import Contact
from rbd.constraints.rolling import RollingBall
from rbd.constraints.surface import shortest_turn, standing_plane
from rbd.errors import DistantContactWarning, InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.input_files import FileLimits, read_xml
from rbd.model.state import State, checked
from rbd.model.urdf import BASE_JOINT, Complaints
from rbd.model.world import LEAST_FALL
from rbd.problem.ground import FLOOR, TOUCHES, Ground

Resting = Contact | RollingBall
"""What a robot can be placed on."""
UP = np.array([0.0, 0.0, 1.0])
ROUNDED = 1e-4
"""Joint motions smaller than this are those of rounded angles and axes in a file [rad, m]."""
TOGETHER = 1e-6
"""Feet that are nearer to each other along the plane are one support [m]."""
_ON_GROUND = 1e-13
"""Corners this near to the ground are on it: rounding, of a robot's height [m]."""


def configuration(robot: CheckedModel, angles: Mapping[str, float | Sequence[float]]) -> Array:
    """q, shape (nq,), with named joints at the values given and the others neutral; unknown names are ignored.

    A continuous joint takes its angle [rad]; a floating base takes its seven numbers.
    """
    model = robot.model
    q = pin.neutral(model)
    for name, value in angles.items():
        if not model.existJointName(name):
            continue
        joint = model.joints[model.getJointId(name)]
        given = np.atleast_1d(np.asarray(value, float))
        if joint.nq == 2 and joint.nv == 1 and len(given) == 1:
            given = np.array([np.cos(given[0]), np.sin(given[0])])
        if len(given) == joint.nq:
            q[joint.idx_q : joint.idx_q + joint.nq] = given
    return pin.normalize(model, q)


def semantic_postures(robot: CheckedModel, srdf: Path) -> dict[str, Array]:
    """{name: q} of an SRDF's group states, read by joint name."""
    tree = read_xml(srdf, FileLimits())
    found = {}
    for group in tree.iter("group_state"):
        angles = {}
        for joint in group.iter("joint"):
            name = joint.get("name", "")
            what = f"joint {name!r:.80} of the posture {group.get('name')!r:.80}"
            angles[name] = _values(robot, Complaints(srdf.name), what, name, joint)
        found[group.get("name", "")] = configuration(robot, angles)
    return found


def _values(robot: CheckedModel, wrong: Complaints, what: str, name: str, element: ElementTree.Element) -> list[float]:
    """An SRDF's values for a joint: one finite number a coordinate; an angle for a continuous joint."""
    count = max(len(element.get("value", "").split()), 1)
    model = robot.model
    if model.existJointName(name) and name != BASE_JOINT:  # whose size is a matter of how the robot is loaded
        joint = model.joints[model.getJointId(name)]
        count = 1 if joint.nv == 1 and (joint.nq == 1 or count != joint.nq) else joint.nq
    values = wrong.numbers(what, element, "value", count=count)
    wrong.refuse()
    if count in (4, 7) and not np.linalg.norm(values[-4:]) > 1e-6:
        wrong.stop(f"{what} has a zero quaternion: {element.get('value')!r:.80}.")
    return values


def stand(robot: CheckedModel, q: Array, feet: Sequence[Contact]) -> Array:
    """Q with its base turned so that the feet are flat, moved so that the lowest is on z = 0, and balanced if on points.

    A base that slides in an upright plane turns about the plane's normal alone.
    """
    q, axis = q.copy(), None if robot.floating else robot.model.jointPlacements[1].rotation[:, 2]  # of a planar base
    state = State(robot, q)
    _turn(robot, q, _levelling(state, feet, UP, axis), state.base_pose().translation)
    if not any(len(foot.corners) > 1 for foot in feet):
        _balance(robot, q, feet, axis)
    _lower(robot, q, feet, FLOOR)
    return q


def settled(robot: CheckedModel, q: Array, feet: Sequence[Contact]) -> Array:
    """Q with all corners of its feet on z = 0, where joint motions of less than `ROUNDED` take them there; else q itself.

    Files round the angles of postures and the axes of joints, so that soles lean on each other by 1e-5 rad or so. Joints are
    not moved beyond their limits, nor those of a robot with loops, which they would open.
    """
    if robot.loops():
        return q
    moved = q
    for _ in range(5):  # Newton's method: two steps are enough
        state = State(robot, moved)
        heights, rates = (np.concatenate(each) for each in zip(*(_heights(state, foot) for foot in feet), strict=True))
        if np.abs(heights).max() <= _ON_GROUND:
            break
        moved = pin.integrate(robot.model, moved, -np.linalg.lstsq(rates, heights, rcond=1e-9)[0])
    far = np.abs(pin.difference(robot.model, q, moved)[robot.model.joints[1].nv :]).max(initial=0.0)
    return moved if far <= ROUNDED and robot.joints.within_limits(moved) else q


def _heights(state: State, foot: Contact) -> tuple[Array, Array]:
    """(heights, rates): of a foot's corners above z = 0 [m], and their Jacobian, shapes (k,) and (k, nv)."""
    ball = foot.ball
    X_FP = foot.placement if ball is None else pin.SE3(np.eye(3), np.array(ball.centre))
    X_WP, J, _, _ = state.moving(foot.frame, X_FP, pin.LOCAL_WORLD_ALIGNED)
    x, y, z = X_WP.rotation @ foot.corners.T - (0.0 if ball is None else [[0.0], [0.0], [ball.radius]])
    return X_WP.translation[2] + z, J[2] + np.outer(y, J[3]) - np.outer(x, J[4])


def place_on_ground(state: State, contacts: Sequence[Resting]) -> State:
    """The state with its base placed so that contacts lie on their ground; joints and v are unchanged.

    For one plane, the base rotates about its origin by the smallest rotation that aligns the mean normal of the patches (for
    points, of their mean plane) with the plane's, and moves along it until the lowest corner touches. For several planes, as
    on stairs or between two walls, it moves by the least motion that minimises the squared distances of all corners from their
    planes. So heading and horizontal position change as little as possible.

    If the joint angles do not allow all contacts on their planes at once, some stay off, and a `DistantContactWarning` names
    those that do by more than a millimetre, with their gaps; `rbd.find_pose` moves joints too.
    `robot.standing()` uses the same code for feet, and then balances a robot on two points. The base's velocity is in its own
    axes, so that it rotates with the base.

    Args:
        state: A robot with a floating base.
        contacts: Feet or other contacts; their friction is not used. Each lies on the plane of its `on`, which goes through W's
            origin if only its normal is given; on z = 0 if nothing is. Round feet and `rbd.RollingBall` touch with the lowest
            points of their balls: `robot.feet(at=state)` has these as points of contact.

    Raises:
        InputError: no contacts, one with a body, or a robot without a single floating base.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> feet = solo.feet(on={"front_left": 0.03, "front_right": 0.03})  # the front feet on a step
        >>> tilted = rbd.robots.place_on_ground(solo.standing(), feet)
        >>> [round(float(foot.points(tilted).gaps[0]), 6) for foot in feet]
        [0.0, 0.0, 0.0, 0.0]
    """
    robot, feet = checked(state).robot, listed(contacts)
    if not robot.floating:
        raise InputError(
            f"{robot.name} has no single floating base to place: its base is fixed or planar, or it has several. Load it with "
            'rbd.load_robot(..., root="free_flyer"), or move its joints with rbd.find_pose.'
        )
    if not feet:
        raise InputError("contacts is empty; expected at least one, e.g. robot.feet().")
    for foot in feet:
        if member(foot, "ball") is None and (member(foot, "corners") is None or member(foot, "placement") is None):
            raise InputError(
                f"{made(foot).name!r:.80} is not a contact with the ground; expected e.g. robot.feet(), or an rbd.RollingBall."
            )
    planes, q = [_plane_under(state, foot) for foot in feet], state.q.copy()  # type: ignore[arg-type]
    up = np.sum([np.asarray(plane.normal) for plane in planes], axis=0)
    if np.linalg.norm(up) > 1e-3 * len(planes):  # opposite walls do not determine the tilt
        level = _levelling(state, feet, up / np.linalg.norm(up))  # type: ignore[arg-type]
        _turn(robot, q, level, state.base_pose().translation)
    if all(plane.same(planes[0]) for plane in planes):
        _lower(robot, q, feet, planes[0])  # type: ignore[arg-type]
    else:
        _fit(robot, q, feet, planes)  # type: ignore[arg-type]
    placed = State(robot, q, state.v, t=state.t)
    warn_of_gaps(placed, feet, stacklevel=3)  # type: ignore[arg-type]
    return placed


def warn_of_gaps(state: State, feet: Sequence[Resting], *, stacklevel: int) -> None:
    """Name the feet that the joint angles leave off their ground, by more than a millimetre; `stacklevel` as of `warnings`."""
    told = []
    for foot in feet:
        gaps = _plane_under(state, foot).distances(corner_points(state, [foot]))
        if np.abs(gaps).max() > TOUCHES:
            worst = float(gaps[np.argmax(np.abs(gaps))])
            told.append(f"{foot.name!r:.80} up to {1e3 * abs(worst):.3g} mm {'above' if worst > 0.0 else 'below'} it")
    if told:
        warnings.warn(
            f"the joint angles of {state.robot.name} do not allow all these contacts on the ground at once: {', '.join(told)}. "
            "Leave out what is not to touch, or move the joints: rbd.find_pose.",
            DistantContactWarning,
            stacklevel=stacklevel,
        )


def _plane_under(state: State, foot: Resting) -> Ground:
    return standing_plane(foot.name, foot.on, corner_points(state, [foot]).mean(axis=0))


def _lower(robot: CheckedModel, q: Array, feet: Sequence[Resting], plane: Ground) -> None:
    """Move the base along a plane's normal until the lowest corner touches; in place."""
    depth = plane.distances(corner_points(State(robot, q), feet)).min()
    _move(robot, q, pin.SE3(np.eye(3), -depth * np.asarray(plane.normal)))


def _fit(robot: CheckedModel, q: Array, feet: Sequence[Resting], planes: Sequence[Ground]) -> None:
    """Move the base to the least squares of the corners' distances from their planes, by Gauss-Newton steps; in place."""
    points = corner_points(State(robot, q), feet)
    sizes = [_corners(foot) for foot in feet]
    rolls = any(member(foot, "ball") is not None for foot in feet)
    n = np.repeat([np.asarray(plane.normal) for plane in planes], sizes, axis=0)
    heights = np.repeat([plane.height for plane in planes], sizes)
    for _ in range(100):
        middle = points.mean(axis=0)
        A = np.column_stack([n, np.cross(points - middle, n)])
        step = np.linalg.lstsq(A, heights - (points * n).sum(axis=1), rcond=1e-9)[0]
        R = pin.exp3(step[3:])
        points = middle + step[:3] + (points - middle) @ R.T
        _move(robot, q, pin.SE3(R, middle + step[:3] - R @ middle))
        if rolls:  # others touch
            points = corner_points(State(robot, q), feet)
        if np.abs(step).max() < 1e-15:
            break


def corner_points(state: State, feet: Sequence[Resting]) -> Array:
    """All corners of the feet, of balls the lowest points, in W, shape (k, 3) [m]."""
    return np.concatenate([_corner_points(state, foot) for foot in feet])


def _corner_points(state: State, foot: Resting) -> Array:
    patch, ball = foot.rows(state).patch, member(foot, "ball")
    if patch is None:
        return np.zeros((0, 3))
    return patch.corners_W if ball is None else ball.lowest_W(state, foot.frame, patch.axes[:, 2])[None]


def _corners(foot: Resting) -> int:
    """How many corners it has."""
    corners = member(foot, "corners")
    return 1 if corners is None else len(corners)


def _levelling(state: State, feet: Sequence[Resting], normal: Array, axis: Array | None = None) -> Array:
    """The smallest rotation of the robot, shape (3, 3), that aligns its feet with a normal, about an axis or any."""
    patches = [patch for foot in feet if _corners(foot) > 1 and (patch := foot.rows(state).patch) is not None]
    if patches:
        up = np.mean([patch.axes[:, 2] for patch in patches], axis=0)
    else:
        spread = _spread(corner_points(state, feet), axis)
        along, _, across = np.linalg.svd(spread)[2]
        if np.abs(spread @ along).max() < TOGETHER:
            return np.eye(3)
        on_line = axis is not None or len(spread) == 2
        up = normal - (along @ normal) * along if on_line else across if across @ normal >= 0.0 else -across
    up = _spread(up, axis)
    length = float(np.linalg.norm(up))  # zero for opposite soles, and for points on one vertical
    return pin.exp3(shortest_turn(up / length, normal, axis)) if length > 1e-9 else np.eye(3)


def _spread(points: Array, axis: Array | None) -> Array:
    """Points from their middle, or one direction, seen along an axis if one is given."""
    found = points - points.mean(axis=0) if points.ndim == 2 else points
    return found if axis is None else found - np.multiply.outer(found @ axis, axis)


def _balance(robot: CheckedModel, q: Array, feet: Sequence[Contact], axis: Array | None) -> None:
    """Turn the robot until its centre of mass is over its point feet, along gravity; in place.

    It turns about the line of two feet, or about the axis of a planar base, if its feet are one point seen along that; else its
    feet leave it no turn. Nor does it turn if gravity has no part down.
    """
    points, gravity = corner_points(State(robot, q), feet), robot.gravity
    if axis is None and len(points) == 2:
        axis = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    least = LEAST_FALL * np.linalg.norm(gravity)
    if axis is None or np.abs(_spread(points, axis)).max() > TOGETHER or not -gravity[2] > least:
        return
    up = _spread(-gravity, axis)
    if not np.linalg.norm(up) > least:  # along the line of the feet
        return
    for _ in range(20):  # one turn is exact for a rigid robot; the second is rounding
        state = State(robot, q)
        middle = corner_points(state, feet).mean(axis=0)
        arm = _spread(state.com - middle, axis)
        angle = math.atan2(float(axis @ np.cross(arm, up)), float(arm @ up))
        if abs(angle) < 1e-15 or np.linalg.norm(arm) < TOGETHER:
            return
        _turn(robot, q, pin.exp3(angle * axis), middle)


def _turn(robot: CheckedModel, q: Array, R: Array, about: Array) -> None:
    """Turn the base by R (world axes) about a point; in place."""
    _move(robot, q, pin.SE3(R, about - R @ about))


def _move(robot: CheckedModel, q: Array, X: pin.SE3) -> None:
    """Displace the base, floating or planar, by X in W; in place."""
    if robot.floating:
        q[:7] = pin.SE3ToXYZQUAT(X * pin.XYZQUATToSE3(q[:7]))
        return
    (x, y, c, s), P = q[:4], robot.model.jointPlacements[1]
    moved = P.actInv(X * P * pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0])))
    q[:4] = *moved.translation[:2], *moved.rotation[:2, 0]
