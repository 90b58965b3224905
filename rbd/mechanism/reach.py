"""How far the links of a robot reach in whatever pose: from one point to another, and from a point to the centre of mass.

Seen from a point the robot is a tree of bodies, each turned as it likes about the joint by which it hangs on the one before. So
another point is at p + sum R_b w_b, with w_b fixed to the bodies on the way, and the centre of mass likewise, with the mass
beyond each joint gathered at the joint,

    w_b = (m_b (c_b - e_b) + sum_k M_k (o_k - e_b)) / m,        |c - p| <= sum |w_b|

with e_b where body b hangs, o_k where the next ones hang on it and M_k the mass of all beyond. A slide adds its stroke. Limits
of hinges are not used: poses in reach may be farther inside.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel


def links_between(robot: CheckedModel, start: int, p: Array, end: int, r: Array) -> tuple[list[Array], float]:
    """(vectors fixed to the bodies from one to another, in their joints' axes; strokes on the way) [m].

    Args:
        robot: The robot.
        start: Joint of the first body.
        p: A point of it, in the joint's axes, shape (3,) [m].
        end: Joint of the last body, on the same tree.
        r: A point of that.
    """
    model, up, down = robot.model, [start], [end]
    while up[-1] != down[-1]:
        longer = up if up[-1] > down[-1] else down  # parents have smaller numbers
        longer.append(int(model.parents[longer[-1]]))
    way = [*up, *down[-2::-1]]
    hangs, leaves = [p], list[Array]()
    for x, y in zip(way[:-1], way[1:], strict=True):
        leaves.append(_hinge(model, x, y))
        hangs.append(_hinge(model, y, x))
    stroke = sum(stroke_of(robot, max(x, y)) for x, y in zip(way[:-1], way[1:], strict=True))
    return [y - x for x, y in zip(hangs, [*leaves, r], strict=True)], stroke


def links_to_com(robot: CheckedModel, joint: int, p: Array) -> tuple[Array, float]:
    """(w of the body at which it begins, in its joint's axes, shape (3,); sum of the lengths of all others and strokes) [m].

    Args:
        robot: The robot, one tree.
        joint: Of the first body.
        p: A point of it, in the joint's axes, shape (3,) [m].
    """
    model = robot.model
    mass = [body.mass for body in model.inertias]

    def beyond(k: int, came: int) -> float:
        return float(mass[k] + sum(beyond(x, k) for x in _next(model, k, came)))

    total, first, length = beyond(joint, joint), np.zeros(3), 0.0
    todo = [(joint, joint, p)]
    while todo:
        k, came, hangs = todo.pop()
        w = mass[k] / total * (model.inertias[k].lever - hangs)
        for x in _next(model, k, came):
            share = beyond(x, k) / total
            w = w + share * (_hinge(model, k, x) - hangs)
            length += share * stroke_of(robot, max(k, x))
            todo.append((x, k, _hinge(model, x, k)))
        if k == joint:
            first = w
        else:
            length += float(np.linalg.norm(w))
    return first, length


def stroke_of(robot: CheckedModel, joint: int) -> float:
    """Largest displacement of a joint [m]; zero for a revolute joint."""
    found = robot.joints[robot.model.names[joint]]
    if found.kind == "Composite" or found.kind.startswith("H"):  # unbounded, or with links inside
        return math.inf
    if all(c.unit != "m" for c in found.velocities):
        return 0.0
    if found.nv > 1 or not (math.isfinite(found.lower) and math.isfinite(found.upper)):
        return math.inf
    return max(abs(found.lower), abs(found.upper))


def _next(model: pin.Model, joint: int, came: int) -> list[int]:
    """Bodies that hang on one, but for that from which one came."""
    parent = [int(model.parents[joint])] if model.parents[joint] else []
    return [k for k in [*parent, *map(int, model.children[joint])] if k != came]


def _hinge(model: pin.Model, joint: int, other: int) -> Array:
    """Where another body hangs on one, in its joint's axes: a body has its own joint at its origin."""
    return np.array(model.jointPlacements[other].translation) if other > joint else np.zeros(3)
