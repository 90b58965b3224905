"""An audit, or two engines compared, as they are shown: forces of engine and law, modes of points, lanes of the causes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, cast

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, largest_first, lazy
from rbd.audits import CAUSES, AuditReport, EnginesCompared, Record
from rbd.audits.body_pairs import BodyPairs
from rbd.errors import RbdError
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import conjugate, rotated
from rbd.problem.ground import Ground
from rbd.records import counted
from rbd.robots.robot import Robot
from rbd.simulation.simulated_motion import OPEN, SLIPS, STICKS, Event
from rbd.visual.marks.surfaces import ShownSurface, each_once
from rbd.visual.playback.curves import FINE, Choice, CurveChart, CurveLine, chart, top_of
from rbd.visual.playback.mode_disks import OFF_GROUND, Disks
from rbd.visual.playback.motion_frames import MOST_NUMBERS, body_poses
from rbd.visual.playback.report_motion import YES, WorstFrame
from rbd.visual.playback.shown_motion import Card, CardRow, ShownMotion, Track
from rbd.visual.playback.trajectory_charts import Maker, chosen_charts, makers_of
from rbd.visual.style import CONTACT_COLORS, GHOST_COLOR, MODE_COLORS, PUSH_COLOR, WRENCH_COLOR, distinct_colors

MOST_SOLVED = 300
"""Frames in which the law's forces are computed, chosen likewise."""
MOST_POINTS = 1500
"""Points in these frames together: sliding at many points takes a tenth of a second."""
MOST_FRAMES = 1000
"""Pictures of a page: of longer records the worst frames, and others, see `_thinned`."""
WORST = 5
"""Frames of each cause that are kept."""
CREEPS = "creeps"
POINT_COLORS: Mapping[str, str] = {mode: MODE_COLORS[mode] for mode in (OPEN, STICKS, SLIPS, CREEPS)}
"""{mode of a point of an audit: colour of its disk}."""
LAW_COLOR = PUSH_COLOR
SEEN_FROM = (1.0, 0.28, 0.34)
"""Of two motions beside each other: neither hides the other."""
NO_ANSWER, NO_ANSWER_COLOR = "no answer of the law", "#7f7f7f"
MOST_PLANES, LEVEL = 12, 1e-4
"""Planes off the floor that are drawn of an audit at most; less than this from 1 is the cosine between normals of one plane."""
MOST_PLACES, SHARE, LEAST = 16, 0.2, 0.01
"""A point farther than this share of a contact's extent, and this length [m], from others is a new one; of so many at most."""


def shown_audit(report: AuditReport, solved: int = MOST_SOLVED) -> ShownMotion:
    """An audit as a motion that can be shown.

    Args:
        report: Of one frame or more; one is shown as two.
        solved: Frames in which the law's forces are computed at most; 0: only the engine's are shown.
    """
    record, pairs = report.record, BodyPairs.of_records([report.record])[0]
    every = np.arange(record.n) if record.n > 1 else np.zeros(2, int)
    t = record.t if record.n > 1 else record.t[0] + np.array([0.0, record.step[0] or 1e-3])
    solved = min(solved, record.n * MOST_POINTS // max(len(record.contact_at), 1))
    law = _Law.of(report, pairs, _thinned(report, solved) if solved else np.zeros(0, int))
    points, forces, disks, by_law = _contacts(report, pairs, law, every)
    words, events, rows = [*POINT_COLORS], list[Event](), [_row(report, cause) for cause in report.ranked]
    most = {name: disk.codes.max(axis=1) for name, disk in disks.items()}
    modes = {name: [words[code] for code in codes] for name, codes in most.items()}
    for name, codes in most.items():
        for i in np.flatnonzero(np.diff(np.minimum(codes, 1))).tolist():
            on = bool(codes[i + 1])
            first = int(disks[name].codes[i + on].argmax())
            events.append(Event(float(t[i + 1]), name, "touches" if on else "leaves", first))
    for row in rows:
        modes[row.name] = np.where(report.of_cause(row.name)[every], YES, OPEN).tolist()
        events.append(WorstFrame(row.t, row.name, row.name, words=f"{row.t:.4g} s: {row.name}, {row.size} at most"))
    lanes = {row.name: row.color for row in rows}
    if law.reasons:
        modes[NO_ANSWER], lanes[NO_ANSWER] = np.where(law.failed[every], YES, OPEN).tolist(), NO_ANSWER_COLOR
        firsts = {why.partition(":")[0]: i for i, why in sorted(law.reasons.items(), reverse=True)}
        events += [WorstFrame(t[i], NO_ANSWER, NO_ANSWER, words=f"{t[i]:.4g} s: {law.reasons[i]}") for i in firsts.values()]
    robot, (head, *lines) = solid_robot(record.robot), str(report).splitlines()
    lines = lines[(1 + len(rows)) * bool(rows) :]  # without the table
    good = int((~report.sizes.any(axis=1)).sum())
    width = 7 * robot.model.njoints + 12 * sum(p.shape[1] for p in points.values())
    shown = ShownMotion(
        report, robot, t, record.q[every], record.v[every],
        f"{record.engine or robot.name}: {good} of {record.n} frames without a cause", points, forces, modes, tuple(events),
        lanes=lanes, pushes=(*by_law, *_others(report, every)), name=record.engine, disks=disks,
        surfaces=_surfaces(report, pairs), notes=law.notes,
        at=t[_thinned(report, min(MOST_FRAMES, MOST_NUMBERS // width))] if record.n > 1 else t,
        card=Card("".join([x.text for x in report.explanations[:1]]), tuple(rows), (head, *lines)),
        defaults={"trace": False, "footprints": False, "start": rows[0].t if rows else float(t[0])},
    )  # fmt: skip
    sums = {name: total[every] for name, total in _sums(report, pairs, law).items()}
    return replace(shown, charts=partial(audit_charts, shown, report, sums, every))


_Columns: TypeAlias = dict[str, Array]


def _contacts(
    report: AuditReport, pairs: BodyPairs, law: _Law, every: Array
) -> tuple[_Columns, _Columns, dict[str, Disks], list[Track]]:
    """(points, the engine's forces, disks) of each pair of bodies that touch, that of most load first; the law's forces."""
    record, points, forces, disks, by_law = report.record, _Columns(), _Columns(), dict[str, Disks](), list[Track]()
    places, codes, shares = _Places.of(record, pairs), _codes(report), report.laws.share
    loads = np.bincount(pairs.of, np.linalg.norm(record.forces, axis=1), len(pairs.names))
    for p in largest_first(loads).tolist():
        name = pairs.names[p]
        points[name] = places.spread(p, record.points, np.nan)[every]
        forces[name] = places.spread(p, pairs.signs[:, None] * record.forces, 0.0)[every]
        modes = places.spread(p, codes[:, None], 0)[every, :, 0].astype(int)
        used = np.where(modes > 0, np.minimum(places.spread(p, shares[:, None], np.nan)[every, :, 0], 1.0), np.nan)
        disks[name] = Disks(POINT_COLORS, modes, places.spread(p, record.normals, 0.0)[every], used)
        if len(law.frames):
            f = np.where(np.isnan(points[name]), 0.0, law.between(places.spread(p, law.forces, 0.0), 0.0)[every])
            by_law.append(Track(f"{name}, by the law", points[name], f, LAW_COLOR, aside=True))
    return points, forces, disks, by_law


def _surfaces(report: AuditReport, pairs: BodyPairs) -> tuple[ShownSurface, ...]:
    """The planes of the world that carry load off the floor z = 0, those of most load first, up to `MOST_PLANES`."""
    record, of_world = report.record, pairs.joints[pairs.of, 1] == 0
    points, normals, load = record.points, pairs.signs[:, None] * record.normals, np.linalg.norm(record.forces, axis=1)
    floor = (np.abs(points[:, 2]) <= OFF_GROUND) & (normals[:, 2] > 1.0 - LEVEL)
    left, found = of_world & (load > 0.0) & ~floor, list[ShownSurface]()
    while left.any() and len(found) < MOST_PLANES:
        i = int(np.where(left, load, 0.0).argmax())
        near = np.abs((points - points[i]) @ normals[i]) <= OFF_GROUND
        own = left & near & (normals @ normals[i] > 1.0 - LEVEL)
        left &= ~own
        plane = Ground(point=points[i], normal=normals[i] / np.linalg.norm(normals[i]))
        found += [ShownSurface.of(pairs.names[p], plane, points[own & (pairs.of == p)]) for p in np.unique(pairs.of[own])]
    return tuple(each_once(found))


def shown_comparison(compared: EnginesCompared) -> ShownMotion:
    """Two records as motions beside each other, with lanes of where they part."""
    one, other = (_contacts_only(shown_audit(report, 0)) for report in compared.reports)
    limits, near = compared.limits, np.searchsorted(compared.frames[:, 0], np.arange(compared.reports[0].record.n), "right") - 1
    near = np.resize(np.maximum(near, 0), len(one.t))
    parts = {
        "motions apart": (GHOST_COLOR, compared.distance, limits["distance"], 1e3, "mm"),
        "forces apart": (WRENCH_COLOR, compared.force, limits["force"], 1.0, "N"),
    }
    modes, events, rows = dict(one.modes), [*one.events], list[CardRow]()
    for name, (color, values, limit, factor, unit) in parts.items():
        apart = values > limit
        modes[name] = np.where(apart[near], YES, OPEN).tolist()
        t, size = float(compared.t[apart.argmax()]), f"{factor * values.max():.3g} {unit}"
        if apart.any():
            rows.append(CardRow(name, color, str(int(apart.sum())), size, t, f"by more than {factor * limit:.3g} {unit}"))
            events.append(WorstFrame(t, name, name, words=f"{t:.4g} s: {name} by more than {factor * limit:.3g} {unit}"))
    own = {"start": one.t[0], "seen_from": SEEN_FROM, "beside": replace(other, name=compared.names[1])}
    title, text = f"{' and '.join(compared.names)} agree", ""
    if compared.parting is not None:
        own["start"], text = compared.parting.t, compared.parting.text
        title = f"{' and '.join(compared.names)} part at {compared.parting.t:g} s"
    return replace(
        one, title=title, modes=modes, events=tuple(events), name=compared.names[0],
        lanes={name: part[0] for name, part in parts.items() if name in [row.name for row in rows]},
        card=Card(text, tuple(rows), tuple(str(compared).splitlines())), charts=partial(comparison_charts, one, compared, near),
        defaults={**one.defaults, **own},
    )  # fmt: skip


def _contacts_only(shown: ShownMotion) -> ShownMotion:
    """An audit without its causes."""
    events = tuple([event for event in shown.events if event.name in shown.points])
    return replace(shown, modes={name: shown.modes[name] for name in shown.points}, events=events, lanes={})


def audit_charts(
    shown: ShownMotion, report: AuditReport, sums: Mapping[str, Array], every: Array, choice: Choice = True
) -> list[CurveChart]:
    """The charts of an audit: forces, those of engine and law, what is missing, sliding, depth; or those that are named.

    Args:
        shown: The motion.
        report: The audit.
        sums: {"engine" or "law": sum of the normal forces}, shape (n,) [N].
        every: Frame of the record at each sample, shape (n,).
        choice: True, False, or names: "forces", "engine and law", "sliding", "depth", "missing force".

    Raises:
        InputError: an unknown name, or one that there are no numbers for.
    """
    own: dict[str, Maker] = {
        "forces": makers_of(shown)["forces"],
        "engine and law": partial(_both, sums),
        "sliding": partial(_sliding, report, every),
        "depth": partial(_depth, report, every),
        "missing force": partial(_missing, report, every),
    }
    return chosen_charts(shown.robot.name, own, choice, tuple(own))


def comparison_charts(shown: ShownMotion, compared: EnginesCompared, near: Array, choice: Choice = True) -> list[CurveChart]:
    """The charts of two engines compared: how far motions and forces are apart, and the charts of the first.

    Args:
        shown: The first motion.
        compared: The comparison.
        near: Common time of each of its samples, shape (n,).
        choice: True, False, or names.

    Raises:
        InputError: an unknown name, or one that there are no numbers for.
    """
    limits = compared.limits
    made = [
        _apart("motions apart", "motions apart, mm", 1e3 * compared.distance[near], 1e3 * limits["distance"]),
        _apart("forces apart", "forces apart, N", compared.force[near], limits["force"]),
        *shown.charts(True),
    ]
    known = {each.name: each for each in made}
    return chosen_charts(shown.robot.name, {name: partial(known.get, name) for name in known}, choice, tuple(known))


def _apart(name: str, title: str, values: Array, limit: float) -> CurveChart:
    return chart(
        name, title, [CurveLine("largest difference", GHOST_COLOR, values)], limits={"limit": limit}, least_top=2 * limit
    )


def _both(sums: Mapping[str, Array]) -> CurveChart | None:
    if "law" not in sums:
        return None
    lines = [CurveLine("engine", CONTACT_COLORS[0], sums["engine"]), CurveLine("law", LAW_COLOR, sums["law"], FINE)]
    made = chart("engine and law", "sum of the normal forces, N", lines, percentile=98.0)
    return replace(made, top=min(made.top, 3.0 * top_of(sums["engine"], 0.0, 98.0)))  # the law's may be as large as they like


def _missing(report: AuditReport, every: Array) -> CurveChart:
    threshold = 100.0 * report.thresholds.balance
    lines = [CurveLine("missing", WRENCH_COLOR, 100.0 * report.missing_scaled[every])]
    return chart(
        "missing force",
        "missing force, % of the weight",
        lines,
        limits={"threshold": threshold},
        least_top=2.0 * threshold,
        percentile=98.0,
    )


def _sliding(report: AuditReport, every: Array) -> CurveChart | None:
    loaded, speed = ~report.laws.free, np.linalg.norm(report.laws.slip, axis=1)
    creeps = report.points["creeps"] > 0.0
    lines = [
        CurveLine(name, MODE_COLORS[mode], 1e3 * _largest(report.record, np.where(on, speed, 0.0))[every])
        for name, mode, on in (("on the cone", SLIPS, loaded & ~creeps), ("creeps", CREEPS, loaded & creeps))
    ]
    least = 2e3 * report.thresholds.speed
    return (
        chart("sliding", "speed of points that push, mm/s", lines, least_top=least, percentile=98.0) if loaded.any() else None
    )


def _depth(report: AuditReport, every: Array) -> CurveChart | None:
    gaps = report.record.gaps
    if not np.isfinite(gaps).any():
        return None
    depth = 1e3 * _largest(report.record, np.nan_to_num(np.maximum(-gaps, 0.0)))[every]
    limits = {"threshold": 1e3 * report.thresholds.depth}
    least, lines = 2e3 * report.thresholds.depth, [CurveLine("deepest", GHOST_COLOR, depth)]
    return chart("depth", "depth of the surfaces in each other, mm", lines, limits=limits, least_top=least)


def _largest(record: Record, values: Array) -> Array:
    """Largest of each frame's points, shape (n,); zero without."""
    out = np.zeros(record.n)
    np.maximum.at(out, record.contact_at, values)
    return out


def _sums(report: AuditReport, pairs: BodyPairs, law: _Law) -> dict[str, Array]:
    """Sums of normal forces by engine and law, shape (n,) [N]; NaN where the law has no answer."""
    record = report.record
    sums = {"engine": np.bincount(record.contact_at, report.laws.push, record.n)}
    if len(law.frames):
        push = pairs.signs * np.einsum("ki,ki->k", law.forces, record.normals)
        sums["law"] = law.between(np.bincount(record.contact_at, push, record.n), np.nan)
    return sums


def _codes(report: AuditReport) -> Array:
    """Mode of each point, as its place in `POINT_COLORS`, shape (k,)."""
    moves = np.linalg.norm(report.laws.slip, axis=1) > report.thresholds.speed
    return np.where(report.laws.free, 0, np.where(report.points["creeps"] > 0.0, 3, np.where(moves, 2, 1)))


def _row(report: AuditReport, cause: str) -> CardRow:
    color = distinct_colors(len(CONTACT_COLORS) + len(CAUSES))[len(CONTACT_COLORS) + [*CAUSES].index(cause)]
    i, (unit, meaning) = int(report.worst(cause, 1)[0]), CAUSES[cause]
    size = float(report.sizes_of(cause)[i])
    told = f"{1e3 * size:.4g} m{unit}" if unit in ("m", "m/s") else f"{size:.4g} {unit}"
    return CardRow(cause, color, str(int(report.of_cause(cause).sum())), told, float(report.record.t[i]), meaning)


class SolidRobot(CheckedModel):
    """A bare model with the boxes that have its bodies' inertias, to be drawn.

    Args:
        robot: The model.
    """

    def __init__(self, robot: CheckedModel) -> None:
        super().__init__(robot.model, name=robot.name)
        self.visual_model, self.collision_model = pin.GeometryModel(), pin.GeometryModel()
        for joint, inertia in enumerate(robot.model.inertias):
            if joint == 0 or inertia.mass <= 0.0:
                continue
            moments, R = np.linalg.eigh(inertia.inertia)
            sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / inertia.mass, 1e-12))
            X = pin.SE3(R * np.sign(np.linalg.det(R)), inertia.lever)
            shape = pin.GeometryObject(robot.model.names[joint], joint, X, coal.Box(*sides))
            shape.meshColor = np.array([0.55, 0.6, 0.66, 1.0])
            self.visual_model.addGeometryObject(shape)


def solid_robot(robot: CheckedModel) -> Robot:
    """A robot that can be drawn: itself if it has shapes, else with boxes of its inertias."""
    return cast("Robot", robot if hasattr(robot, "visual_model") else SolidRobot(robot))


def _thinned(report: AuditReport, most: int) -> Array:
    """Numbers of frames: all of up to `most`; else the worst of each cause, some others with causes, the rest evenly."""
    n, with_cause = report.record.n, np.flatnonzero(report.sizes.any(axis=1))
    if n <= most:
        return np.arange(n)
    worst = np.unique([i for cause in report.ranked for i in report.worst(cause, WORST)]).astype(int)
    half = min((most - len(worst)) // 2, len(with_cause))
    picked = with_cause[np.linspace(0, len(with_cause) - 1, half).round().astype(int)]
    even = np.linspace(0, n - 1, max(most - len(worst) - half, 2)).round().astype(int)
    return np.unique(np.concatenate([worst, picked, even]))


def _others(report: AuditReport, every: Array) -> list[Track]:
    """The record's pushes, one track a body, and the force that is missing on the first free body."""
    record, tracks = report.record, []
    for body in np.unique(record.push_bodies):
        on = record.push_bodies == body
        p, f = np.full((record.n, 1, 3), np.nan), np.zeros((record.n, 1, 3))
        p[record.push_at[on], 0] = record.push_points[on]
        np.add.at(f[:, 0], record.push_at[on], record.push_forces[on])
        tracks.append(Track(f"push on {record.bodies[body]}", p[every], f[every], CONTACT_COLORS[6]))
    if report.of_cause("balance").any() and report.force_missing.any():
        com = body_poses(record.robot, record.q, ())[1][:, None]
        tracks.append(Track("missing force", com[every], report.force_missing[every, None], WRENCH_COLOR))
    return tracks


@dataclass(frozen=True, eq=False)
class _Places:
    """The points of each pair of bodies as columns that stay the same point of the body, however an engine lists them."""

    record: Record
    pairs: BodyPairs
    columns: Array
    widths: tuple[int, ...]

    @classmethod
    def of(cls, record: Record, pairs: BodyPairs) -> _Places:
        joints = sorted(set(pairs.joints[:, 0].tolist()))
        poses = body_poses(record.robot, record.q, joints)[0]
        columns, widths = np.zeros(len(record.contact_at), int), []
        for p, joint in enumerate(pairs.joints[:, 0].tolist()):
            own = np.flatnonzero(pairs.of == p)
            X = poses[record.contact_at[own], joints.index(joint)]
            local = rotated(conjugate(X[:, 3:]), record.points[own] - X[:, :3])
            columns[own] = _followed(local, record.contact_at[own])
            widths.append(int(columns[own].max()) + 1)
        return cls(record, pairs, columns, tuple(widths))

    def spread(self, p: int, values: Array, none: float) -> Array:
        """Values of the points of a pair, shape (k, d), as shape (n, columns, d), with a number where there is no point."""
        own = np.flatnonzero(self.pairs.of == p)
        out = np.full((self.record.n, self.widths[p], values.shape[1]), none, float)
        out[self.record.contact_at[own], self.columns[own]] = values[own]
        return out


def _followed(local: Array, frame: Array) -> Array:
    """A number for each point, the same from frame to frame where it stays near, shape (k,)."""
    near = max(SHARE * float(np.ptp(local, axis=0).max()), LEAST)
    column, places = np.full(len(local), -1), np.zeros((0, 3))
    for own in np.split(np.arange(len(local)), np.flatnonzero(np.diff(frame)) + 1):
        far = np.linalg.norm(local[own, None] - places[None], axis=2)
        far[far > (near if len(places) < MOST_PLACES else np.inf)] = np.inf
        for _ in range(min(far.shape)):  # the nearest pair first
            point, place = np.unravel_index(int(far.argmin()), far.shape)
            if far[point, place] == np.inf:
                break
            column[own[point]] = place
            far[point], far[:, place] = np.inf, np.inf
        fresh = own[column[own] < 0]
        column[fresh] = len(places) + np.arange(len(fresh))
        places = np.vstack([places, np.zeros((len(fresh), 3))])
        places[column[own]] = local[own]
    return column


@dataclass(frozen=True, eq=False)
class _Law:
    """What `rbd.solve` gives in some frames of a record of n frames.

    Attributes:
        frames: Those frames, increasing, shape (s,); none: nothing was solved.
        forces: Of each point in these frames, on the first body of its pair, zero in others, shape (k, 3) [N].
        reasons: {frame: why there is no answer}.
        n: Number of frames.
    """

    frames: Array
    forces: Array
    reasons: Mapping[int, str]
    n: int

    @classmethod
    def of(cls, report: AuditReport, pairs: BodyPairs, frames: Array) -> _Law:
        """Solved, frame by frame."""
        record, reasons = report.record, dict[int, str]()
        forces = np.zeros((len(record.contact_at), 3))
        for i in frames.tolist():
            points = record.of_frame(i)
            try:
                with warnings.catch_warnings(action="ignore"):
                    found = report.answer(i).corner_forces
            except RbdError as error:
                reasons[i] = f"{type(error).__name__}: {str(error).splitlines()[0]:.160}"
            else:
                for j, point in enumerate(points):
                    forces[point] = np.nan_to_num(found[f"point {j}"][0])
        return cls(frames, pairs.signs[:, None] * forces, reasons, record.n)

    @lazy
    def _around(self) -> tuple[Array, Array]:
        """(solved frame before, solved frame after) of each frame, itself where it is solved, shape (n,)."""
        every, last = np.arange(self.n), len(self.frames) - 1
        place = np.searchsorted(self.frames, every)
        after = self.frames[np.minimum(place, last)]
        return np.where(after == every, after, self.frames[np.clip(place - 1, 0, last)]), after

    @lazy
    def failed(self) -> Array:
        """In which frames there is no answer, shape (n,): neither solved nor between two that are."""
        bad = np.isin(np.arange(self.n), [*self.reasons])
        before, after = self._around
        return bad[before] | bad[after]

    def between(self, values: Array, none: float) -> Array:
        """Values of solved frames, shape (n, ...), at all: straight between two, with a number where there is no answer."""
        before, after = self._around
        share = (np.arange(self.n) - before) / np.maximum(after - before, 1)
        w = share.reshape(-1, *[1] * (values.ndim - 1))
        out = (1.0 - w) * values[before] + w * values[after]
        out[self.failed] = none
        return np.asarray(out)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the legend says."""
        if not len(self.frames):
            return ()
        few = len(self.frames) < self.n
        part = f"{len(self.frames)} of {self.n} frames, interpolated in between" if few else "all frames"
        told = f"The law's forces, drawn aside of the engine's: rbd.solve in {part}"
        none = f"; {counted(len(self.reasons), 'has', 'have')} no answer, see the lane" if self.reasons else ""
        return (f"{told}{none}.",)
