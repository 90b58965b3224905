"""`compare`: two records of one robot side by side: the first step at which they part, by which contact, and why."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_number, lazy
from rbd.audits.auditing import audit
from rbd.audits.body_pairs import BodyPairs
from rbd.audits.causes import Thresholds
from rbd.audits.record import Record
from rbd.audits.report import AuditReport
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import interpolated_q
from rbd.motion.frame_terms import LENGTH
from rbd.records import Field, joined

if TYPE_CHECKING:
    from pathlib import Path

PARTINGS = {
    "start": "the states differ at the first common time",
    "known forces": "torques of motors, or other known forces, differ",
    "friction": "the coefficients of friction differ",
    "contact": "one has a force at this contact, the other has none",
    "slip": "the contact slips in one and sticks in the other",
    "law": "one misses the laws there in a way that the other does not",
    "force": "contact forces differ in size, direction or place",
    "motion": "motions part while all forces agree",
}
"""{cause of a parting: what it is}, in the order in which they are sought."""
SAME_TIME = 1e-9
"""Times that differ by less are the same [s]."""


@dataclass(frozen=True, kw_only=True)
class Parting(Displayed):
    """Where two records part first.

    Attributes:
        t: Time [s].
        step: Number of the common time, from 0.
        frames: The frames of both records.
        cause: One of `rbd.audits.engines_compared.PARTINGS`.
        contact: The bodies that touch; empty where it is no contact.
        point: Centre of pressure of the contact, in W, shape (3,) [m], of the first record that has one; NaN without.
        text: In words, with sizes.

    Example:
        >>> stand = rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1])
        >>> floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> rests, turns = (rbd.solve(stand, None, [floor], external=[0, 0, 0, 0, 0, moment]) for moment in (0.0, 3.0))
        >>> one, other = (rbd.audits.from_solutions([each]) for each in (rests, turns))
        >>> rbd.audits.compare(one, other).parting.text
        'the known force along root_joint.wz differs by 3 N m'
    """

    t: float
    step: int
    frames: tuple[int, int]
    cause: str
    contact: str
    point: Array
    text: str


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class EnginesCompared(Displayed):
    """Two records of one robot at their m common times.

    Attributes:
        reports: The audits of both.
        names: Of both engines.
        t: Common times, shape (m,) [s]: those of the record with fewer frames in the time that both have.
        frames: Frames of both there, the nearest, shape (m, 2).
        apart: Largest difference of times of two frames that are compared [s].
        contacts: The pairs of bodies that touch in either.
        distance: Largest difference of a coordinate, angles times 0.3 m, shape (m,) [m].
        speed: The same of velocities, shape (m,) [m/s].
        known: Largest difference of a known generalised force, moments over 0.3 m, shape (m,) [N].
        forces: Resultants of the contacts of the first less those of the second, in W, shape (m, contacts, 3) [N].
        limits: {"distance", "speed", "force": from which difference on they part} [m, m/s, N].
        parting: Where they part first; None where they do not.

    Example:
        >>> box, once = rbd.testing.box(mass=1.0), {"t": [0.0], "q": [[0, 0, 0, 0, 0, 0, 1]], "v": np.zeros((1, 6))}
        >>> touch = {"contact_at": [0], "contact_bodies": ["box"], "points": np.zeros((1, 3)), "normals": [[0, 0, 1]]}
        >>> rests = rbd.audits.Record.of_arrays(box, **once, a=np.zeros((1, 6)), **touch, forces=[[0, 0, 9.81]])
        >>> falls = rbd.audits.Record.of_arrays(box, **once, a=[[0, 0, -9.81, 0, 0, 0]])
        >>> print(rbd.audits.compare(rests, falls).parting.text)
        at box the first has (0, 0, 9.81) N and the second has (0, 0, 0) N; in the second nothing touches there
    """

    reports: tuple[AuditReport, AuditReport]
    names: tuple[str, str]
    t: Array
    frames: Array
    apart: float
    contacts: tuple[str, ...]
    distance: Array
    speed: Array
    known: Array
    forces: Array
    limits: dict[str, float]
    parting: Parting | None

    fields: ClassVar[tuple[Field, ...]] = (
        Field("agree", (), "", "whether they part nowhere"),
        Field("parting_time", (), "s", "first common time at which they part", lambda c: c.parting and c.parting.t),
        Field("parting_step", (), "", "its number", lambda c: c.parting and c.parting.step),
        Field("cause", (), "", "why they part", lambda c: c.parting.cause if c.parting else ""),
        Field("contact", (), "", "the bodies at whose contact they part", lambda c: c.parting.contact if c.parting else ""),
        Field("text", (), "", "where they part, in words", lambda c: c.parting.text if c.parting else ""),
        Field("largest_distance", (), "m", "largest difference of a coordinate", lambda c: c.distance.max()),
        Field("largest_force", (), "N", "largest difference of a contact's force", lambda c: c.force.max()),
        Field("engines", (), "", "names of both", lambda c: c.names),
    )

    @property
    def agree(self) -> bool:
        """Whether they part nowhere."""
        return self.parting is None

    @property
    def force(self) -> Array:
        """Largest difference of the resultant of a contact, shape (m,) [N]."""
        return np.linalg.norm(self.forces, axis=2).max(axis=1, initial=0.0)

    def export(self, path: str | os.PathLike[str], **settings: Any) -> Path:
        """Write both motions and both sets of forces as one page; returns its path.

        Settings are those of `rbd.visual.export_motion`: `beside=None` and `ghost=compared.reports[1].record` lay one over the
        other.
        """
        return drawing("export_motion")(self, path, **settings)

    def __str__(self) -> str:
        m, (one, other) = len(self.t), self.names
        parting = self.parting
        told = [f"{one} and {other} agree in {m} steps from {self.t[0]:g} to {self.t[-1]:g} s."]
        if parting is not None:
            told = [f"{one} and {other} part at {parting.t:g} s, step {parting.step} of {m}: {parting.text}."]
        for what, unit, values in (("distance", "m", self.distance), ("speed", "m/s", self.speed), ("force", "N", self.force)):
            beyond = np.flatnonzero(values > self.limits[what])
            when = f"beyond {self.limits[what]:.3g} from {self.t[beyond[0]]:g} s on" if len(beyond) else "nowhere beyond"
            told.append(f"{what}: {when}, in {len(beyond)} steps; at most {values.max():.3g} {unit}")
        if self.apart > SAME_TIME:
            told.append(f"times differ by up to {self.apart:.3g} s: motions interpolated, forces those of the nearest frame")
        heads = [str(report).partition("\n")[0] for report in self.reports]
        return "\n".join([*told, *(f"{name}: {head}" for name, head in zip(self.names, heads, strict=True))])


def compare(
    first: Record,
    second: Record,
    *,
    distance: float = 1e-3,
    speed: float = 1e-2,
    force: float = 1e-2,
    law: str = "coulomb",
    thresholds: Thresholds | None = None,
) -> EnginesCompared:
    """Two records of one robot, as of two engines with the same start and torques: where they part first, and why.

    They are compared at the times of the record with fewer frames, as far as both reach; the other is taken at its nearest
    frame, at most half a step away, its motion interpolated. Contacts are compared by pairs of bodies, by resultant and centre
    of pressure: engines list other points.

    Args:
        first: A record.
        second: One of the same robot; its model may have other inertias.
        distance: Motions part from this difference of a coordinate on; angles count times 0.3 m [m].
        speed: The same of velocities [m/s].
        force: Forces part from this difference on, a share of the weight (`AuditReport.force_scale`).
        law: By which both are judged.
        thresholds: Of both audits.

    Raises:
        InputError: no records, other joints, no common times, thresholds that are not above zero.

    Example:
        >>> box = rbd.testing.box(mass=1.0)
        >>> start, slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0]), []
        >>> for friction in (0.5, 0.4):
        ...     floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=friction, on=0.0)
        ...     slide = rbd.simulate(start, [floor], duration=0.1, step=0.01)
        ...     slides.append(rbd.audits.from_trajectory(slide, [floor]))
        >>> compared = rbd.audits.compare(*slides)
        >>> compared.parting.cause, compared.parting.contact, compared.parting.step
        ('friction', 'box', 0)
    """
    check_pair(first, second)
    for what, value in (("distance", distance), ("speed", speed), ("force", force)):
        check_number(what, value, 1e-15, 1e6, expected="a number above zero")
    t, at = _common(first, second)
    records, robot = (first, second), first.robot
    reports = audit(first, law=law, thresholds=thresholds), audit(second, law=law, thresholds=thresholds)
    (q, v), (Q, V) = (_motion(r, t, at[:, i]) for i, r in enumerate(records))
    units = np.where(robot.joints.angular, LENGTH, 1.0)
    moved = units * np.array([pin.difference(robot.model, *pair) for pair in zip(Q, q, strict=True)])
    rates = units * (v - V)
    taus = (first.tau[at[:, 0]] - second.tau[at[:, 1]]) / units
    pushes = _pushes(first)[at[:, 0]] - _pushes(second)[at[:, 1]]
    pairs = BodyPairs.of_records(records)
    engines = first.engine or "the first", second.engine or "the second"
    if engines[0] == engines[1]:
        engines = f"{engines[0]} (1)", f"{engines[1]} (2)"
    known = np.maximum(np.abs(taus).max(axis=1), np.linalg.norm(pushes, axis=2).max(axis=1))
    one, other = (_Side(*each) for each in zip(reports, engines, pairs, at.T, strict=True))
    found = EnginesCompared(
        reports=reports, names=engines, t=t, frames=at, apart=float(np.abs(first.t[at[:, 0]] - second.t[at[:, 1]]).max()),
        contacts=pairs[0].names, distance=np.abs(moved).max(axis=1), speed=np.abs(rates).max(axis=1),
        known=known, forces=one.forces - other.forces,
        limits={"distance": distance, "speed": speed, "force": force * reports[0].force_scale}, parting=None,
    )  # fmt: skip
    return replace(found, parting=_parting(found, (one, other), moved, rates, taus))


def check_pair(first: object, second: object) -> None:
    """Refuse what are no two records of one robot.

    Raises:
        InputError: no records, or other joints.
    """
    for what, record in (("first", first), ("second", second)):
        check_kind(what, record, Record, "an rbd.audits.Record")
    assert isinstance(first, Record) and isinstance(second, Record)
    one, other = first.robot, second.robot
    if _joints(one) != _joints(other):
        raise InputError(f"the records are of {one.name} and {other.name}, with other joints; expected one robot.")


def _joints(robot: CheckedModel) -> list[tuple[str, ...]]:
    """Name and kinds of each joint; free ones have the name that an engine gives them."""
    joints = [(name, *(piece.kind for piece in joint.pieces)) for name, joint in robot.joints.items()]
    return [("", *kinds) if "space" in kinds else (name, *kinds) for name, *kinds in joints]


def _common(first: Record, second: Record) -> tuple[Array, Array]:
    """(common times, shape (m,), the nearest frames of both, shape (m, 2)).

    Raises:
        InputError: there is none.
    """
    begin, end = max(first.t[0], second.t[0]) - SAME_TIME, min(first.t[-1], second.t[-1]) + SAME_TIME
    inside = [np.flatnonzero((r.t >= begin) & (r.t <= end)) for r in (first, second)]
    coarse = int(len(inside[1]) < len(inside[0]))
    record, other = (first, second)[:: -1 if coarse else 1]
    t = record.t[inside[coarse]]
    right = np.clip(np.searchsorted(other.t, t), 1, max(other.n - 1, 1))
    right = np.minimum(right, other.n - 1)
    near = np.where(np.abs(t - other.t[right - 1]) <= np.abs(t - other.t[right]), right - 1, right) % other.n
    step = np.diff(other.t).max(initial=0.0)
    there = np.abs(other.t[near] - t) <= 0.5 * step + SAME_TIME
    if not there.any():
        times = " and ".join(f"{r.t[0]:g} to {r.t[-1]:g} s" for r in (first, second))
        raise InputError(f"the records have no common time: they are from {times}; shift the times of one of them.")
    at = np.column_stack([inside[coarse], near])[there]
    return t[there], at[:, :: -1 if coarse else 1]


def _motion(record: Record, t: Array, frames: Array) -> tuple[Array, Array]:
    """(q, v) at some times: those of the frames where they are the same, else interpolated."""
    if np.abs(record.t[frames] - t).max() <= SAME_TIME:
        return record.q[frames], record.v[frames]
    at = np.clip(t, record.t[0], record.t[-1])
    v = np.column_stack([np.interp(at, record.t, column) for column in record.v.T])
    return interpolated_q(record.robot, record.t, record.q, record.v, at), v


def _pushes(record: Record) -> Array:
    """Sum of the pushes on the body of each joint, in W, shape (n, joints, 3) [N]."""
    out = np.zeros((record.n, record.robot.model.njoints, 3))
    np.add.at(out, (record.push_at, record.joints[record.push_bodies]), record.push_forces)
    return out


@dataclass(frozen=True, eq=False)
class _Side:
    """One of both records, as a contact is looked up in it: by common time i and pair of bodies k."""

    report: AuditReport
    engine: str
    pairs: BodyPairs
    frames: Array

    @lazy
    def forces(self) -> Array:
        """Resultants, shape (m, contacts, 3) [N]."""
        return self.pairs.forces(self.report.record)[self.frames]

    def points(self, i: int, k: int) -> Array:
        """Numbers of its points."""
        return self.pairs.on(self.report.record, int(self.frames[i]), k)

    def loaded(self, i: int, k: int) -> Array:
        """Those that have a force."""
        at = self.points(i, k)
        return at[~self.report.laws.free[at]]

    def centre(self, i: int, k: int) -> Array:
        """Centre of pressure."""
        return self.pairs.centre(self.report.record, int(self.frames[i]), k)

    def slip(self, i: int, k: int) -> float:
        """Largest speed of sliding of a point that has a force [m/s]."""
        return float(np.linalg.norm(self.report.laws.slip[self.loaded(i, k)], axis=1).max(initial=0.0))

    def causes(self, i: int, k: int) -> list[str]:
        """What the audit finds at its points."""
        at = self.points(i, k)
        return [cause for cause, size in self.report.points.items() if size[at].any()]

    def without(self, i: int, k: int) -> str:
        """Why there is no force, in words."""
        if not len(at := self.points(i, k)):
            return f"in {self.engine} nothing touches there"
        gaps = self.report.record.gaps[at]
        if np.isnan(gaps).all():
            return f"in {self.engine} it touches without force"
        low = 1e3 * float(np.nanmin(gaps))
        return f"in {self.engine} the surfaces are {abs(low):.3g} mm {'apart' if low > 0.0 else 'inside each other'}"


def _parting(found: EnginesCompared, sides: tuple[_Side, _Side], moved: Array, rates: Array, taus: Array) -> Parting | None:
    """Where they part first; None where they do not."""
    limits = found.limits
    far = (found.distance > limits["distance"]) | (found.speed > limits["speed"])
    torn, driven = found.force > limits["force"], found.known > limits["force"]
    parted = np.flatnonzero(far | torn | driven)
    if not len(parted):
        return None
    i = int(parted[0])
    contact, point = "", np.full(3, np.nan)
    if far[i] and (i == 0 or not (driven[i] or torn[i])):
        cause, text = "motion" if i else "start", _coordinates(found, moved[i], rates[i])
    elif driven[i]:
        cause, text = "known forces", _driven(found, taus[i], float(found.known[i]))
    else:
        k = int(np.linalg.norm(found.forces[i], axis=1).argmax())
        cause, text = _at_contact(found, sides, i, k)
        contact, centres = found.contacts[k], [side.centre(i, k) for side in sides]
        point = next((c for c in centres if np.isfinite(c).all()), point)
    first, second = found.frames[i].tolist()
    return Parting(t=float(found.t[i]), step=i, frames=(first, second), cause=cause, contact=contact, point=point, text=text)


def _coordinates(found: EnginesCompared, moved: Array, rates: Array) -> str:
    """Which coordinates and velocities differ most, in words."""
    names, told = found.reports[0].record.robot.joints.velocities, []
    for x, what, per in ((moved, "distance", ""), (rates, "speed", "/s")):
        c, size = names[int(np.abs(x).argmax())], float(np.abs(x).max())
        if size > found.limits[what]:
            told.append(f"{c.name} differs by {size / (LENGTH if c.unit == 'rad' else 1.0):.3g} {c.unit}{per}")
    return f"{PARTINGS['motion' if found.distance[0] <= found.limits['distance'] else 'start']}: {', '.join(told)}"


def _driven(found: EnginesCompared, taus: Array, known: float) -> str:
    """Which known force differs most, in words."""
    if np.abs(taus).max() < known:
        return f"pushes on a body differ by {known:.3g} N"
    c = found.reports[0].record.robot.joints.velocities[int(np.abs(taus).argmax())]
    size, unit = (LENGTH * known, "N m") if c.unit == "rad" else (known, "N")
    return f"the known force along {c.name} differs by {size:.3g} {unit}"


def _at_contact(found: EnginesCompared, sides: tuple[_Side, _Side], i: int, k: int) -> tuple[str, str]:
    """(cause, in words) of a contact whose forces part."""
    where, f = found.contacts[k], [side.forces[i, k] for side in sides]
    (less, more), limit = sorted(float(np.linalg.norm(x)) for x in f), found.limits["force"]
    told = [f"{s.engine} has ({', '.join(f'{y:.4g}' for y in x.round(6) + 0.0)}) N" for s, x in zip(sides, f, strict=True)]
    both = f"at {where} {' and '.join(told)}"
    if less <= min(limit, 0.1 * more):
        return "contact", f"{both}; {min(sides, key=lambda s: float(np.linalg.norm(s.forces[i, k]))).without(i, k)}"
    mu = [np.unique(side.report.friction[side.loaded(i, k)]) for side in sides]
    if not any(np.isnan(x).any() for x in mu) and not set(mu[0].tolist()) & set(mu[1].tolist()):
        return "friction", f"{both}; the coefficients of friction are {mu[0].max():g} and {mu[1].max():g}"
    fast, slow = sorted(sides, key=lambda side: -side.slip(i, k))
    if fast.slip(i, k) > fast.report.thresholds.speed >= slow.slip(i, k):
        speed = f"{fast.slip(i, k):.3g} m/s"
        return "slip", f"{where} slips in {fast.engine}, by {speed}, and sticks in {slow.engine}; {both}"
    causes = [side.causes(i, k) for side in sides]
    if causes[0] != causes[1]:
        finds = "; ".join(f"{side.engine}: {joined(x) or 'nothing'}" for side, x in zip(sides, causes, strict=True))
        return "law", f"{both}; the audits find there: {finds}"
    far = round(1e3 * float(np.linalg.norm(sides[0].centre(i, k) - sides[1].centre(i, k))), 6)
    off = float(np.linalg.norm(f[0] - f[1]))
    return "force", f"{both}, {off:.3g} N apart; centres of pressure are {far:.3g} mm apart"
