"""What would explain a missing force: one contact whose force is wrong, or a convention in which the whole record is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.audits.kinematics import balance_of, jacobians
from rbd.audits.record import Record, to_body_axes, unit_of
from rbd.displayed import Displayed

LEFT = 0.01
"""Share of a missing force that may be left where something explains it."""
TRIED = 8
"""Conventions are tried on the eight frames that miss most, and on eight others spread evenly over the motion."""
_ALIKE, _PARALLEL = 0.02, 0.99999


@dataclass(frozen=True)
class Explanation(Displayed):
    """What explains the missing forces of some frames.

    Attributes:
        text: In words.
        frames: Their numbers; empty of the whole record.
        point: Number of the contact point; -1 of a convention.
        force: The force at that point with which the equation of motion holds, in W [N]; empty of a convention.

    Example:
        >>> import dataclasses
        >>> solo = rbd.load_robot("solo12")
        >>> record = rbd.audits.from_solutions([rbd.solve(solo.standing(), None, solo.feet())])
        >>> twice = dataclasses.replace(record, forces=2.0 * record.forces)
        >>> print(rbd.audit(twice).explanations[0].text)
        all contact forces are 2 times what balances
    """

    text: str
    frames: tuple[int, ...] = ()
    point: int = -1
    force: tuple[float, ...] = ()


def wrong_point(record: Record, frame: int, missing: Array, scale: Array) -> Explanation | None:
    """The one contact point whose force explains what is missing in a frame; None where none does.

    With J of the point, the change of its force is the least-squares solution of J^T df = missing.

    Args:
        record: The record.
        frame: Number of the frame.
        missing: Shape (nv,).
        scale: What it is measured in, shape (nv,).
    """
    points, best = record.of_frame(frame), None
    size, b = LEFT * float(np.linalg.norm(missing / scale)), missing / scale
    for j, J in enumerate(jacobians(record, frame)):
        A = J.T / scale[:, None]
        change = np.linalg.lstsq(A, b, rcond=1e-9)[0]
        left = float(np.linalg.norm(A @ change - b))
        if left < size:
            best, size = (j, change), left
    if best is None:
        return None
    j, change = best
    i = points[j]
    f, right = record.forces[i], record.forces[i] + change
    text = f"the force at {record.pair(i)}, point {j}, {_fault(f, right, record.normals[i])}"
    return Explanation(text, (frame,), i, tuple(right.tolist()))


def _fault(f: Array, right: Array, n: Array) -> str:
    """What is wrong with a force, where `right` balances."""
    size, other = float(np.linalg.norm(f)), float(np.linalg.norm(right))
    if other < _ALIKE * size:
        return "is one that does not act: the equation of motion holds without it"
    if size < _ALIKE * other:
        return f"is missing: {_newtons(right)} would balance"
    if abs(float(f @ right)) > _PARALLEL * size * other:
        return f"is {float(f @ right) / other**2:.3g} times what balances, {_newtons(right)}"
    drag, right_drag = f - (f @ n) * n, right - (right @ n) * n
    if np.linalg.norm(drag + right_drag) < _ALIKE * np.linalg.norm(drag) and abs(float((f - right) @ n)) < _ALIKE * size:
        return f"has its friction the wrong way round: {_newtons(right)} would balance"
    if abs(size - other) < _ALIKE * size:
        angle = np.degrees(np.arccos(np.clip(f @ right / (size * other), -1.0, 1.0)))
        return f"is turned by {angle:.3g} degrees from what balances"
    return f"is {_newtons(f)}; {_newtons(right)} would balance"


def _newtons(f: Array) -> str:
    return f"({', '.join(f'{x:.4g}' for x in f)}) N"


def wrong_convention(record: Record, sizes: Array, scale: Array, limit: float) -> Explanation | None:
    """A convention that explains what is missing, tried on the frames that miss most and on others; None where none does.

    Args:
        record: The record.
        sizes: Scaled size of what is missing in each frame, shape (n,).
        scale: What generalised forces are measured in, shape (nv,).
        limit: Size from which on it counts.
    """
    bad = np.flatnonzero(sizes > limit)
    evenly = bad[np.unique(np.linspace(0, len(bad) - 1, TRIED).astype(int))]
    some = record.some(np.union1d(np.argsort(-sizes)[:TRIED], evenly))
    before = float(np.median(_sizes(some, scale)))
    found = [(_most(_sizes(other, scale)), text) for text, other in _others(some)]
    found += [(_most(left), text) for left, text in _scaled(some, scale)]
    least = min((size for size, _ in found), default=np.inf)
    if least >= LEFT * before:
        return None
    return Explanation(next(text for size, text in found if size <= max(10.0 * least, 1e-9 * before)))  # the simplest first


def _most(sizes: Array) -> float:
    """What three of four frames are left with: a convention explains nearly all."""
    return float(np.quantile(sizes, 0.75))


def _sizes(record: Record, scale: Array) -> Array:
    return np.abs(balance_of(record).missing / scale).max(axis=1)


def _others(record: Record) -> Iterator[tuple[str, Record]]:
    """(what is then said, the record in another convention)."""
    robot = record.robot
    quaternions = [unit_of(piece) for piece in robot.joints.pieces if piece.kind in ("space", "sphere")]
    if quaternions:
        q = record.q.copy()
        for unit in quaternions:
            q[:, unit] = np.roll(q[:, unit], -1, axis=1)
        yield "quaternions are w, x, y, z; expected x, y, z, w: say quaternion='wxyz'", replace(record, q=q)
        q = record.q.copy()
        for unit in quaternions:
            q[:, unit] *= np.array([-1.0, -1.0, -1.0, 1.0])
        yield "quaternions turn the other way: from world to body axes", replace(record, q=q)
    if any(piece.kind == "space" for piece in robot.joints.pieces):
        for axes in ("mixed", "world"):
            v, a, tau = to_body_axes(robot, record.q, record.v, record.a, record.tau, axes)
            other = replace(record, v=v, a=a, tau=tau)
            yield f"velocities of free bodies are in other axes: say base_velocity={axes!r}", other
    if len(record.forces):
        yield "contact forces are those on the other body: change their signs", replace(record, forces=-record.forces)
        normal_first = _axes(record.normals)
        for R, where in ((normal_first, "first"), (np.roll(normal_first, -1, axis=1), "last")):
            turned = np.einsum("kij,ki->kj", R, record.forces)
            yield f"contact forces are in the contacts' axes, normal {where}: give contact_axes", replace(record, forces=turned)
        if (record.step > 0.0).all():
            h = record.step[record.contact_at][:, None]
            yield "contact forces are impulses [N s]: divide them by the step", replace(record, forces=record.forces / h)
    yield "motor torques have the other sign", replace(record, tau=-record.tau)
    if len(robot.actuated) < robot.nv:
        yield "motor torques are missing, or are not those that acted", replace(record, tau=_balancing(record))


def _balancing(record: Record) -> Array:
    """Torques of the motors that balance their own rows."""
    missing, on = balance_of(record).missing, record.robot.actuated
    tau = record.tau.copy()
    tau[:, on] += missing[:, on]
    return tau


def _axes(normals: Array) -> Array:
    """Axes as MuJoCo makes them of normals: rows normal, tangent, tangent; shape (k, 3, 3)."""
    level = (np.abs(normals[:, 1]) < 0.5)[:, None]
    tangent = np.where(level, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    tangent = tangent - np.einsum("ki,ki->k", tangent, normals)[:, None] * normals
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    return np.stack([normals, tangent, np.cross(normals, tangent)], axis=1)


def _scaled(record: Record, scale: Array) -> Iterator[tuple[Array, str]]:
    """(what is left, what is then said) where one factor of all contact forces, or of gravity, explains the rest."""
    missing = balance_of(record).missing
    if len(record.forces):
        without = balance_of(replace(record, forces=np.zeros_like(record.forces))).missing
        pushes = (without - missing) / scale  # J^T f
        factor = float(np.vdot(pushes, without / scale)) / max(float(np.vdot(pushes, pushes)), 1e-300)
        left = np.abs(without / scale - factor * pushes).max(axis=1)
        if abs(factor) > 1e-6:
            yield left, f"all contact forces are {1.0 / factor:.4g} times what balances"
    data, model = record.robot.model.createData(), record.robot.model
    weight = np.array([pin.computeGeneralizedGravity(model, data, q) for q in record.q])
    yield np.abs((missing - weight) / scale).max(axis=1), "the engine's motion has no gravity; the robot here has"
