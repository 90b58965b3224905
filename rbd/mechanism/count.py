"""Gruebler's and Kutzbach's count: bodies, joints and their freedoms, nothing else of the mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.loop import LoopClosure
from rbd.mechanism.held import Held, kernel
from rbd.model.state import State

_PARALLEL = 1e-9


@dataclass(frozen=True)
class Count:
    """What counting gives: M = k (N - 1 - j) + sum of f - others.

    It knows no lengths and no directions, but for one: whether all moves in parallel planes.

    Attributes:
        value: M.
        planar: Whether all motion is parallel to one plane; then k = 3, else k = 6.
        bodies: N, the ground among them; links that fixed joints hold together count as one.
        joints: j, those of the file and the closures of loops.
        freedoms: f, one entry a joint.
        others: Rows of constraints that are no joints (couplings, functions, contacts, velocities); of a planar mechanism,
            those that say something within it.
    """

    value: int
    planar: bool
    bodies: int
    joints: int
    freedoms: tuple[int, ...]
    others: int

    @property
    def formula(self) -> str:
        """The count with its numbers, e.g. "planar: 3 (4 - 1 - 4) + 4 = 1"."""
        k, kind = (3, "planar") if self.planar else (6, "spatial")
        others = f" - {self.others}" if self.others else ""
        return f"{kind}: {k} ({self.bodies} - 1 - {self.joints}) + {sum(self.freedoms)}{others} = {self.value}"


def count(held: Held, state: State, seed: int) -> Count:
    """Gruebler's count of a robot's joints and the constraints on it.

    Args:
        held: The constraints.
        state: Where axes are compared; what is parallel to a plane once is so always.
        seed: Of the configurations where rows of other constraints are compared.
    """
    model = held.robot.model
    normal = plane_normal(state)
    k = 6 if normal is None else 3
    tree = [model.nvs[j] for j in range(1, model.njoints) if model.nvs[j]]
    closures, others = [], 0
    first = 0
    for constraint in held.constraints:
        m = sum(name == constraint.name for name, _ in held.names)
        if isinstance(constraint, LoopClosure):
            closures.append(k - (m if normal is None else _rows_in_plane(constraint, state, normal)))
        else:
            others += m if normal is None else _generic_rank(held, slice(first, first + m), seed)
        first += m
    freedoms = (*tree, *closures)
    bodies, joints = len(tree) + 1, len(freedoms)
    return Count(k * (bodies - 1 - joints) + sum(freedoms) - others, normal is not None, bodies, joints, freedoms, others)


def plane_normal(state: State) -> Array | None:
    """Unit normal, in W, of the plane that every joint's motion is parallel to; None where there is none.

    Axes parallel to n stay so when all that turns turns about n.
    """
    model = state.robot.model
    data = model.createData()
    columns = pin.computeJointJacobians(model, data, state.q).reshape(6, -1).T  # twists at the origin of W: linear, angular
    turns = [c[3:] / np.linalg.norm(c[3:]) for c in columns if np.linalg.norm(c[3:]) > _PARALLEL]
    if turns:
        n = turns[0]
    else:
        _, s, Vt = np.linalg.svd(np.vstack([columns[:, :3], np.zeros((3, 3))]))
        if s[2] > _PARALLEL:
            return None
        n = Vt[2]
    if any(np.linalg.norm(np.cross(n, w)) > _PARALLEL for w in turns):
        return None
    if any(abs(float(c[:3] @ n)) > _PARALLEL * max(1.0, float(np.linalg.norm(c[:3]))) for c in columns):
        return None
    return n


def _rows_in_plane(closure: LoopClosure, state: State, normal: Array) -> int:
    """How many rows of a closure say something of motion in a plane."""
    kind = closure.kind
    if kind == "point":
        return 2
    if kind == "rigid":
        return 3
    axis = state.frame(closure.frame_a).X_WF.rotation @ closure.axis
    along = np.linalg.norm(np.cross(axis, normal)) < 1e-6
    if kind == "revolute":
        return 2 if along else 3
    return 2 if along else 1  # "planar" holds a point in the two directions across its axis


def _generic_rank(held: Held, rows: slice, seed: int) -> int:
    rng, most = np.random.default_rng(seed), 0
    for _ in range(3):
        J = held.at(held.move(held.q, rng.normal(size=held.n))).J[rows]
        most = max(most, held.n - kernel(J)[0].shape[1])
    return most
