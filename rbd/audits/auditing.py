"""`audit`: whether the contact forces of a record obey the equation of motion and a law of contact, and where they do not."""

from __future__ import annotations

import os

import numpy as np

from rbd.arrays import Array, check_number
from rbd.audits.causes import CAUSES, Thresholds
from rbd.audits.explanations import Explanation, wrong_convention, wrong_point
from rbd.audits.kinematics import balance_of
from rbd.audits.point_laws import PointLaws
from rbd.audits.record import Record
from rbd.audits.report import AuditReport
from rbd.errors.inputs import check_choice, check_kind
from rbd.motion.frame_terms import LENGTH
from rbd.workers import one_blas_thread

EXPLAINED = 200
"""Frames with a missing force for which a single contact is sought: those with the most missing."""


def audit(
    record: Record | str | os.PathLike[str],
    *,
    law: str = "coulomb",
    friction: float | None = None,
    thresholds: Thresholds | None = None,
) -> AuditReport:
    """Judge the contact forces of any engine, frame by frame, by the equation of motion and a law of contact.

    Nothing is solved: M a + h - tau - J^T f is recomputed with Pinocchio from the record's own numbers, forces are compared
    with their cones, and velocities with those that the law allows with such forces. Without a step of the engine the velocity
    is that of the frame; with one, that which the step led to.

    Args:
        record: The record, or its file.
        law: "coulomb" or "convex": the law by which points are judged. The report says which of both the forces obey.
        friction: Coefficient of all points, in place of the record's.
        thresholds: From which size on a cause is reported.

    Raises:
        InputError: no record, a friction that is no number of 0 or more, an unknown law.

    Example:
        >>> box = rbd.testing.box(mass=1.0)
        >>> at = dict(t=[0.0], q=[[0, 0, 0, 0, 0, 0, 1]], v=[[1, 0, 0, 0, 0, 0]], a=[[-4.905, 0, 0, 0, 0, 0]])
        >>> touch = dict(contact_at=[0], contact_bodies=["box"], points=np.zeros((1, 3)), normals=[[0, 0, 1]], friction=0.5)
        >>> right = rbd.audits.Record.of_arrays(box, **at, **touch, forces=[[-4.905, 0, 9.81]])
        >>> rbd.audit(right).ok
        True
        >>> wrong = rbd.audits.Record.of_arrays(box, **at, **touch, forces=[[-4.905, 0, 9.0]])
        >>> print(rbd.audit(wrong).explanations[0].text)
        the force at box, point 0, is (-4.905, 0, 9) N; (-4.905, 0, 9.81) N would balance
    """
    if isinstance(record, str | os.PathLike):
        record = Record.read(record)
    check_kind("record", record, Record, "an rbd.audits.Record, or the path of its file")
    check_choice("law", law, ("coulomb", "convex"))
    check_kind("thresholds", thresholds, Thresholds | None, "rbd.audits.Thresholds(speed=0.01)")
    limits = Thresholds() if thresholds is None else thresholds
    mu = record.friction
    if friction is not None:
        mu = np.full(len(mu), check_number("friction", friction, 0.0, 1e6, expected="a number of 0 or more"))
    with one_blas_thread():
        balance = balance_of(record)
        force = force_scale(record, balance.missing)
        scale = force * np.where(record.robot.joints.angular, LENGTH, 1.0)
        laws = PointLaws.of(
            record, balance, mu, least=limits.force * force, on_cone=1.0 - limits.cone, still=limits.speed, after=limits.after,
            angle=limits.angle,
        )  # fmt: skip
        missing = np.abs(balance.missing / scale).max(axis=1)
        points = _sizes(record, laws, mu, law, limits, force)
        explained = _explained(record, balance.missing, missing, scale, limits)
    return AuditReport(
        record=record, law=law, friction=mu, thresholds=limits, force_scale=force, missing=balance.missing,
        missing_scaled=missing, laws=laws, points=points, explanations=explained,
    )  # fmt: skip


def force_scale(record: Record, missing: Array) -> float:
    """The robot's weight; without gravity the largest sum of contact forces, else the largest other force [N]."""
    weight = record.robot.mass * float(np.linalg.norm(record.robot.gravity))
    sums = np.bincount(record.contact_at, np.linalg.norm(record.forces, axis=1)) if len(record.forces) else np.zeros(1)
    return next(
        (x for x in (weight, float(sums.max()), float(np.abs(record.tau).max()), float(np.abs(missing).max())) if x > 0.0), 1.0
    )


def _sizes(record: Record, laws: PointLaws, mu: Array, law: str, limits: Thresholds, force: float) -> dict[str, Array]:
    """{cause: its size at each point, shape (k,); zero where it is below its threshold}."""
    loaded, pushed = ~laws.free, ~laws.free & (laws.push > 0.0)
    speed, rough = np.linalg.norm(laws.slip, axis=1), ~(mu == 0.0)
    as_convex = law == "convex"
    out = {
        "outside the cone": np.where(pushed & (laws.outside > limits.cone * force), laws.outside, 0.0),
        "pulls": np.where(laws.push < -limits.force * force, -laws.push, 0.0),
        "pushes at a distance": np.where(loaded & (record.gaps > limits.gap), record.gaps, 0.0),
        "lifts": np.where(
            pushed & (laws.leave > limits.speed) & ~(as_convex & (laws.convex <= laws.allowed(limits.speed, limits.angle))),
            laws.leave,
            0.0,
        ),
        "creeps": np.where(pushed & rough & ~laws.edge & ~np.isnan(mu) & (speed > limits.speed), speed, 0.0),
        "friction not opposed": _angles(laws, speed, limits, force),
        "sinks": np.where(record.gaps < -limits.depth, -record.gaps, 0.0),
        "makes energy": np.where(laws.power > limits.speed * force, laws.power, 0.0),
    }
    assert [*out] == [*CAUSES][1:]
    return out


def _angles(laws: PointLaws, speed: Array, limits: Thresholds, force: float) -> Array:
    """Angle between friction and what opposes the sliding [degrees]; zero below the threshold."""
    pull = np.linalg.norm(laws.drag, axis=1)
    judged = (pull > limits.force * force) & (speed > limits.speed)
    cosine = -np.einsum("ki,ki->k", laws.drag, laws.slip) / np.where(judged, pull * speed, 1.0)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return np.where(judged & (angle > limits.angle), angle, 0.0)


def _explained(record: Record, missing: Array, sizes: Array, scale: Array, limits: Thresholds) -> tuple[Explanation, ...]:
    """What explains the missing forces: a convention of the whole record, else single contacts, by their bodies and kind."""
    bad = np.flatnonzero(sizes > limits.balance)
    if not len(bad):
        return ()
    whole = wrong_convention(record, sizes, scale, limits.balance) if 2 * len(bad) > record.n else None
    if whole is not None:
        return (whole,)
    worst = bad[np.argsort(-sizes[bad], kind="stable")][:EXPLAINED]
    found: dict[tuple[int, ...], Explanation] = {}
    for frame in worst.tolist():
        one = wrong_point(record, frame, missing[frame], scale)
        if one is None:
            continue
        key = (*record.contact_bodies[one.point].tolist(), record.of_frame(frame).index(one.point))
        first = found.setdefault(key, one)
        if first is not one:
            found[key] = Explanation(first.text, (*first.frames, frame), first.point, first.force)
    return tuple(sorted(found.values(), key=lambda each: -len(each.frames)))
