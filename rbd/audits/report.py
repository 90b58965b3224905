"""`AuditReport`: what `audit` found, frame by frame and in sum."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from rbd.answers.least_constraint import solve
from rbd.answers.solution import Solution
from rbd.arrays import Array, check_whole, largest_first, lazy, null_space, range_of
from rbd.audits.causes import CAUSES, Thresholds
from rbd.audits.explanations import Explanation
from rbd.audits.kinematics import jacobians
from rbd.audits.point_laws import PointLaws
from rbd.audits.record import WORLD, Record, unit_of
from rbd.audits.softness import Softness, softness_of
from rbd.constraints.contact import PointContact
from rbd.constraints.surface import contact_axes
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, RbdError
from rbd.errors.inputs import check_known
from rbd.model.external import ExternalForce, generalised
from rbd.model.state import State
from rbd.problem.cones import project_cones
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.ground import Body, Ground
from rbd.records import Field
from rbd.solvers.conic_newton import interior_point

if TYPE_CHECKING:
    from pathlib import Path

_LISTED = 4
_NEAR = 1e-6
"""By how much the extreme forces may miss their program, in weights."""
_TRIED = 20
"""Frames in which it is found out whether forces are unique, evenly spread."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AuditReport(Displayed):
    """The report of `audit` on a record of n frames and k contact points.

    Attributes:
        record: The record.
        law: The law by which points were judged.
        friction: Coefficient of each point, shape (k,).
        thresholds: From which size on a cause is reported.
        force_scale: The robot's weight, see `Thresholds` [N].
        missing: M a + h - tau - J^T f, shape (n, nv) [N, N m].
        missing_scaled: Its largest entry over `force_scale`, moments over 0.3 m times it, shape (n,).
        laws: Forces and motions of the points, and by how much they miss each law.
        points: {cause: its size at each point, shape (k,)}, in the units of `rbd.audits.CAUSES`; zero below its threshold.
        explanations: What explains missing forces, that of most frames first.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> record = rbd.audits.from_solutions([rbd.solve(solo.standing(), None, solo.feet(friction=0.7))])
        >>> report = rbd.audit(record, friction=0.5)  # by a friction that is less than the answer's
        >>> report.ranked, report.worst("outside the cone"), report.obeys
        (('outside the cone',), array([0]), 'neither')
    """

    record: Record
    law: str
    friction: Array
    thresholds: Thresholds
    force_scale: float
    missing: Array
    missing_scaled: Array
    laws: PointLaws
    points: Mapping[str, Array]
    explanations: tuple[Explanation, ...]

    fields: ClassVar[tuple[Field, ...]] = (
        Field(
            "worst_balance", (), "1", "largest missing force over the weight",
            lambda report: report.missing_scaled.max(), certificate=True,
        ),
        Field("obeys", (), "", "law that all forces obey: coulomb, convex, both or neither"),
        Field(
            "frames", (), "1", "number of frames with each cause",
            lambda report: {cause: int(report.of_cause(cause).sum()) for cause in CAUSES}, "frames_{}", "frames of {}",
        ),
        Field("energy_made", (), "J", "work that contacts did on the robot"),
        Field("energy_taken", (), "J", "work that contacts took from it"),
        Field("impulse_missing", ("axis",), "N s", "momentum that no named force accounts for, of the first free body"),
    )  # fmt: skip

    @lazy
    def sizes(self) -> Array:
        """Size of each cause in each frame, its largest over the points, shape (n, len(CAUSES)); zero where there is none."""
        record, limits = self.record, self.thresholds
        out = np.zeros((record.n, len(CAUSES)))
        out[:, 0] = np.where(self.missing_scaled > limits.balance, self.missing_scaled * self.force_scale, 0.0)
        for j, cause in enumerate([*CAUSES][1:], 1):
            np.maximum.at(out[:, j], record.contact_at, self.points[cause])
        return out

    @property
    def ok(self) -> bool:
        """Whether there is no cause in any frame."""
        return not self.sizes.any()

    def sizes_of(self, cause: str) -> Array:
        """Size of a cause in each frame, shape (n,), in its unit of `CAUSES`; zero where there is none.

        Raises:
            InputError: no such cause; the nearest are named.
        """
        check_known("no cause", cause, CAUSES)
        return np.asarray(self.sizes[:, [*CAUSES].index(cause)])

    def of_cause(self, cause: str) -> Array:
        """In which frames a cause is, shape (n,), bool; errors as `sizes_of`."""
        return np.asarray(self.sizes_of(cause) > 0.0)

    def worst(self, cause: str, count: int = 5) -> Array:
        """Frames in which a cause is largest, the worst first; errors as `sizes_of`."""
        sizes = self.sizes_of(cause)
        order = largest_first(sizes)[: check_whole("count", count)]
        return np.asarray(order[sizes[order] > 0.0])

    @property
    def ranked(self) -> tuple[str, ...]:
        """The causes that there are, that of most frames first; those of the equation of motion before others."""
        counts = {cause: int(self.of_cause(cause).sum()) for cause in CAUSES}
        return tuple(sorted((c for c, n in counts.items() if n), key=lambda c: (c != "balance", -counts[c])))

    @lazy
    def obeying(self) -> dict[str, float]:
        """{law: share of the points that obey it}: force in its cone and none at a distance, velocity that goes with it.

        A velocity may miss the law by `thresholds.speed`, or by `thresholds.angle` in its direction.
        """
        limits, laws = self.thresholds, self.laws
        if not len(laws.push):
            return {"coulomb": 1.0, "convex": 1.0}
        good = (laws.outside <= limits.cone * self.force_scale) & ~(self.points["pushes at a distance"] > 0.0)
        most = laws.allowed(limits.speed, limits.angle)
        missed = {"coulomb": laws.coulomb, "convex": laws.convex}
        return {name: float((good & (x <= most)).mean()) for name, x in missed.items()}

    @property
    def obeys(self) -> str:
        """The law that all points obey: "coulomb", "convex", "both" (nothing slides) or "neither"."""
        coulomb, convex = (share == 1.0 for share in self.obeying.values())
        return "both" if coulomb and convex else "coulomb" if coulomb else "convex" if convex else "neither"

    @lazy
    def _durations(self) -> Array:
        """For how long each frame lasts, shape (n,) [s]: its step, else the time to the next one."""
        record = self.record
        between = np.append(np.diff(record.t), 0.0)
        return np.where(record.step > 0.0, np.minimum(record.step, np.where(between > 0.0, between, np.inf)), between)

    def _work(self, sign: float) -> float:
        power = np.maximum(sign * self.laws.power, 0.0)
        return float((power * self._durations[self.record.contact_at]).sum())

    @property
    def energy_made(self) -> float:
        """Work that contacts did on the robot, over the motion [J]: none where they neither push apart nor move."""
        return self._work(1.0)

    @property
    def energy_taken(self) -> float:
        """Work that contacts took from the robot, over the motion [J]."""
        return self._work(-1.0)

    @lazy
    def force_missing(self) -> Array:
        """The force that is missing on the first free body, in W, shape (n, 3) [N]; zero without one."""
        piece = next((piece for piece in self.record.robot.joints.pieces if piece.kind == "space"), None)
        if piece is None:
            return np.zeros((self.record.n, 3))
        turned = Rotation.from_quat(self.record.q[:, unit_of(piece)])
        return np.asarray(turned.apply(self.missing[:, piece.v : piece.v + 3]))

    @property
    def impulse_missing(self) -> Array:
        """Its sum over time, shape (3,) [N s]: momentum that no force accounts for."""
        return np.asarray((self.force_missing * self._durations[:, None]).sum(axis=0))

    @lazy
    def softness(self) -> tuple[Softness, ...]:
        """Of each pair of bodies that touch: how soft their contact is, and how it creeps."""
        return softness_of(self.record, self.laws)

    def loose(self, frame: int) -> int:
        """How many numbers of a frame's contact forces its motion leaves open: 3 k less the rank of their Jacobians."""
        points = self._points(frame)
        return null_space(np.vstack(list(jacobians(self.record, frame))).T).shape[1] if points else 0

    def ranges(self, frame: int) -> Array:
        """Smallest and largest normal force at each point of a frame, shape (k, 2) [N], of all forces with the same motion.

        These are within their cones and have the same J^T f as those of the record; alike where a force is unique. To about
        1e-6 of the weight, by an interior-point method; NaN where none was found, or a force of the record is outside its cone.

        Raises:
            InputError: no such frame; a friction that is not known.
        """
        points = list(self._points(frame))
        out, k = np.full((len(points), 2), np.nan), len(points)
        if not points or (self.laws.outside[points] > self.thresholds.cone * self.force_scale).any():
            return out
        mu, n = self._known_friction(frame), self.record.normals[points]
        axes = np.array([contact_axes(each).T for each in n])  # rows: tangent, tangent, normal
        A = (axes @ jacobians(self.record, frame)).reshape(3 * k, -1).T
        A = range_of(A).T @ A
        x = project_cones(np.einsum("kij,kj->ki", axes, self.record.forces[points]) / self.force_scale, mu)
        rough, normal = np.repeat(mu > 0.0, 3), np.arange(3 * k) % 3 == 2
        lower, upper = np.where(rough, -np.inf, 0.0), np.where(rough | normal, np.inf, 0.0)
        cones = np.arange(3 * k).reshape(k, 3)[mu > 0.0]
        for j in range(k):
            for side, sign in ((0, 1.0), (1, -1.0)):
                block = Unknowns(3 * k, 0.0, sign * (np.arange(3 * k) == 3 * j + 2), lower, upper, cones, mu[mu > 0.0])
                found = interior_point(Conic.of({"forces": block}, [({"forces": A}, A @ x.ravel())]))
                if found.miss <= _NEAR:
                    out[j, side] = self.force_scale * found.x[3 * j + 2]
        return out

    def _known_friction(self, frame: int) -> Array:
        points = self._points(frame)
        mu = self.friction[points.start : points.stop]
        for j in np.flatnonzero(np.isnan(mu)).tolist():
            raise InputError(f"friction of point {j} in frame {frame} is not known; give it: rbd.audit(record, friction=0.5).")
        return np.asarray(mu)

    def _points(self, frame: int) -> range:
        number = check_whole("frame", frame, self.record.n - 1, least=0)
        return self.record.of_frame(number)

    def answer(self, frame: int) -> Solution:
        """What `rbd.solve` gives in the state of a frame, with the record's known forces and contact points.

        Its contacts are called "point 0", "point 1", ... Where forces of one motion are not unique, `answer.uniqueness()` has
        their ranges.

        A point that moves into the world touches ground that gives way as fast.

        Raises:
            InputError: no such frame; a friction that is not known.
            rbd.errors.ContactMoves: two bodies approach each other.
            rbd.NoSolution: as `rbd.solve`.
        """
        record, points = self.record, self._points(frame)
        self._known_friction(frame)
        state = State(record.robot, record.q[frame], record.v[frame])
        speeds = np.einsum("ki,kiv,v->k", record.normals[points], jacobians(record, frame), state.v)
        contacts = [
            self._contact(state, f"point {j}", i, min(float(speed), 0.0))
            for j, (i, speed) in enumerate(zip(points, speeds, strict=True))
        ]
        external = record.tau[frame] + generalised(state, self._pushes(state, frame))[0]
        return solve(state, None, contacts, law=self.law, external=external)

    def _contact(self, state: State, name: str, i: int, sinking: float) -> PointContact:
        """A point of the record; what it sinks into moves with it at that speed."""
        record = self.record
        first, second = (record.bodies[b] for b in record.contact_bodies[i])
        n, p = record.normals[i], record.points[i]
        on: Ground | Body = Ground(normal=n, point=p, velocity=sinking * n)
        if second != WORLD:
            on = Body(second, normal=state.frame(second).X_WF.rotation.T @ n)
        offset = state.frame(first).X_WF.actInv(p)
        return PointContact(name, first, offset=offset, friction=float(self.friction[i]), on=on)

    @lazy
    def largest_push(self) -> tuple[int, float, float]:
        """(frame, sum of the normal forces there, that of `answer`) where the sum is largest [N]; NaN without an answer."""
        record = self.record
        sums = np.bincount(record.contact_at, np.maximum(self.laws.push, 0.0), record.n)
        frame = int(largest_first(sums)[0])
        try:
            with warnings.catch_warnings(action="ignore"):
                forces = self.answer(frame).forces
        except RbdError:
            return frame, float(sums[frame]), np.nan
        pushes = [record.normals[i] @ forces[f"point {j}"] for j, i in enumerate(self._points(frame))]
        return frame, float(sums[frame]), float(sum(pushes))

    def _pushes(self, state: State, frame: int) -> list[ExternalForce]:
        record = self.record
        bodies = [record.bodies[b] for b in record.push_bodies]
        return [
            ExternalForce(bodies[i], record.push_forces[i], record.push_moments[i], offset=X.actInv(record.push_points[i]))
            for i in np.flatnonzero(record.push_at == frame).tolist()
            if bodies[i] != WORLD
            for X in [state.frame(bodies[i]).X_WF]
        ]

    def export(self, path: str | os.PathLike[str], **options: Any) -> Path:
        """Write a page: the motion with both sets of forces, and a lane for each cause; see `rbd.visual.export_motion`."""
        return drawing("export_motion")(self, path, **options)

    def __str__(self) -> str:
        record, n, limits = self.record, self.record.n, self.thresholds
        good = int((~self.sizes.any(axis=1)).sum())
        told = [f"{good} of {n} frames without a cause; judged by {_LAWS[self.law]}; {_obeyed(self)}."]
        if self.ranked:
            told.append(f"{'cause':<22}{'frames':>8}{'worst':>14}  {'at':<14}what it is")
        for cause in self.ranked:
            unit, meaning = CAUSES[cause]
            i = int(self.worst(cause, 1)[0])
            size = self.sizes_of(cause)[i]
            size, unit = (1e3 * size, f"m{unit}") if unit in ("m", "m/s") else (size, unit)
            frames = int(self.of_cause(cause).sum())
            told.append(f"{cause:<22}{frames:>8}{f'{size:.4g} {unit}':>14}  {f't = {record.t[i]:.4g} s':<14}{meaning}")
        most, scale = float(self.missing_scaled.max()), self.force_scale
        told.append(f"equation of motion: {most * scale:.3g} N missing at most, {most:.2g} of {scale:.4g} N")
        if self.of_cause("balance").any() and self.impulse_missing.any():
            told.append(f"momentum that no force accounts for: {np.array2string(self.impulse_missing, precision=4)} N s")
        told += [f"explained: {each.text}{_frames(each.frames, n)}" for each in self.explanations[:_LISTED]]
        if len(record.forces):
            frame, push, right = self.largest_push
            by_law = "" if np.isnan(right) else f"; by the law {right:.4g} N"
            told.append(
                f"largest push: {push:.4g} N, {push / scale:.3g} times the weight, at t = {record.t[frame]:.4g} s{by_law}"
            )
        told.append(f"contacts made {self.energy_made:.4g} J and took {self.energy_taken:.4g} J")
        told += [f"surface: {each}" for each in self.softness[:_LISTED]]
        loose = max(self.loose(i) for i in np.unique(np.linspace(0, n - 1, _TRIED).astype(int)).tolist())
        if loose:
            told.append(f"forces are not unique: up to {loose} of their numbers leave the motion as it is; report.ranges(i)")
        told.append(f"thresholds: {', '.join(f'{name} {value:g}' for name, value in vars(limits).items())}")
        return "\n".join([*told, *(f"note: {note}" for note in record.notes)])


_LAWS = {"coulomb": "Coulomb's law", "convex": "the convex law"}


def _obeyed(report: AuditReport) -> str:
    if report.obeys == "both":
        return "both laws hold" if len(report.laws.push) else "no contacts"
    if report.obeys != "neither":
        return f"{_LAWS[report.obeys]} holds at all points"
    coulomb, convex = report.obeying.values()
    return f"Coulomb's law holds at {coulomb:.1%} of the points, the convex law at {convex:.1%}"


def _frames(frames: tuple[int, ...], n: int) -> str:
    if not frames:
        return f" (all {n} frames)" if n > 1 else ""
    shown = ", ".join(map(str, sorted(frames)[:_LISTED]))
    return f" (frame{'s' * (len(frames) > 1)} {shown}{', ...' if len(frames) > _LISTED else ''})" if n > 1 else ""
