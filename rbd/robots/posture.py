"""Postures: joint angles by name, and a base placed so that the feet are flat on the ground."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.model.checked_model import CheckedModel
from rbd.model.input_files import FileLimits, read_xml
from rbd.model.state import State
from rbd.model.urdf import BASE_JOINT, Complaints


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
    """Q with its base turned so that the feet are flat, moved so that the lowest is on z = 0, and balanced if on points."""
    q = q.copy()
    _turn(q, _levelling(robot, q, feet))
    if not any(len(foot.corners) > 1 for foot in feet):
        _balance(robot, q, feet)
    q[2] -= corner_points(State(robot, q), feet)[:, 2].min()
    return q


def corner_points(state: State, feet: Sequence[Contact]) -> Array:
    """All corners of the feet, in W, shape (k, 3) [m]."""
    out = []
    for foot in feet:
        patch = foot.rows(state).patch
        assert patch is not None
        out.append(patch.point + patch.corners @ patch.axes.T)
    return np.concatenate(out)


def _levelling(robot: CheckedModel, q: Array, feet: Sequence[Contact]) -> Array:
    """The smallest rotation of the robot, shape (3, 3), after which its feet face up."""
    state = State(robot, q)
    normals = [foot.rows(state).resultant[:3, 2] for foot in feet if len(foot.corners) > 1]  # type: ignore[index]
    if normals:
        up = np.mean(normals, axis=0)
    else:
        points = corner_points(state, feet)
        spread = points - points.mean(axis=0)
        if len(points) < 2:
            return np.eye(3)
        if len(points) == 2:
            along = spread[1] / np.linalg.norm(spread[1])
            up = np.array([0.0, 0.0, 1.0]) - along[2] * along
        else:
            up = np.linalg.svd(spread)[2][2]
            up = up if up[2] >= 0.0 else -up
    return _rotation_between(up / np.linalg.norm(up), np.array([0.0, 0.0, 1.0]))


def _balance(robot: CheckedModel, q: Array, feet: Sequence[Contact]) -> None:
    """Turn the robot about the middle of its point feet until its centre of mass is over their hull; in place.

    The feet stay where they are only for two of them, about the line that joins them; more feet leave the ground, so three
    or more are turned only when the centre of mass is outside, which no posture of the catalogue is.
    """
    points = corner_points(State(robot, q), feet)
    if len(points) != 2:
        return
    axis = points[1] - points[0]
    axis /= np.linalg.norm(axis)
    hull = convex_hull(points[:, :2])
    for _ in range(20):  # Newton in one angle; three steps are enough from a few degrees
        state = State(robot, q)
        points = corner_points(state, feet)
        arm = state.com - points.mean(axis=0)
        across = np.cross(axis, [0.0, 0.0, 1.0])
        lean = float(arm @ across)
        if abs(lean) < 1e-14 and inside_distance(state.com[:2], hull) > -1e-9:
            return
        _turn(q, pin.exp3(-axis * np.arctan2(lean, float(arm[2]))), about=points.mean(axis=0))


def _turn(q: Array, R: Array, about: Array | None = None) -> None:
    """Turn the floating base by R (world axes) about a point, the base's origin if not given; in place."""
    X_WB = pin.XYZQUATToSE3(q[:7])
    X_WB.rotation = R @ X_WB.rotation
    if about is not None:
        X_WB.translation = about + R @ (X_WB.translation - about)
    q[:7] = pin.SE3ToXYZQUAT(X_WB)


def _rotation_between(a: Array, b: Array) -> Array:
    """The smallest rotation that takes unit vector a to unit vector b, shape (3, 3)."""
    cross, cos = np.cross(a, b), float(a @ b)
    if np.linalg.norm(cross) < 1e-15 and cos > 0.0:
        return np.eye(3)
    if cos < -1.0 + 1e-12:
        return pin.exp3(np.pi * np.array([1.0, 0.0, 0.0]))
    return pin.exp3(cross / np.linalg.norm(cross) * np.arctan2(np.linalg.norm(cross), cos))
