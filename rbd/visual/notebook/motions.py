"""Cards of motions: simulated, given, and checked ones, with small curves."""

from __future__ import annotations

import numpy as np

from rbd.motion.causes import CAUSES
from rbd.motion.motion import Motion
from rbd.motion.report import MotionReport
from rbd.simulation.motion import Event, Sample
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_fields import RESIDUALS, worst_of
from rbd.visual.name_lists import joined
from rbd.visual.notebook.card import Card, Fold, Table
from rbd.visual.notebook.registry import card_of
from rbd.visual.notebook.small_curves import curves, lanes
from rbd.visual.notebook.values import fixed, number, share, vector

_EVENTS = 12
_LEVEL_M = 5e-4
"""Heights that differ by less are the same."""


@card_of.register
def _trajectory(record: Trajectory) -> Card:
    moved, energy = record.com[-1] - record.com[0], record.energy
    ends = joined((f"{name} {record.modes[name][-1]}" for name in record.names if len(record.modes[name])), 4)
    height = f"{fixed(abs(moved[2]), 3)} m {'lower' if moved[2] < 0.0 else 'higher'}"
    height = height if abs(moved[2]) >= _LEVEL_M else "at the same height"
    lasts = f"{record.robot.name} moves for {number(record.duration, 4)} s"
    said = f"{lasts}; its centre of mass ends {height}"
    said += f"; at the end: {ends}" if ends else ""
    said = f"stopped early: {record.interrupted}; {said}" if record.interrupted else said
    rows = [
        ("samples", f"{len(record)}, steps of {number(1e3 * record.step)} ms" if record.step else str(len(record)), ""),
        ("centre of mass moved by", vector(moved), "m"),
        ("energy, first and last", f"{number(energy[0])}, {number(energy[-1])}", "J"),
        ("energy, range", fixed(np.ptp(energy), 5), "J"),
        ("work of the motors", number(record.motor_work[-1] - record.motor_work[0], 4), "J"),
        *(
            [("work taken by dampers", number(record.dissipated[-1] - record.dissipated[0], 4), "J")]
            * bool(record.dissipated.any())
        ),
        ("contact law", record.law or "-", ""),
        ("events", str(len(record.events)), ""),
    ]
    forces, sizes = [], {}
    for name, force in record.forces.items():
        contact = name in record.points
        size = np.linalg.norm(force[:, :3], axis=1) if contact else np.abs(force).max(axis=1, initial=0.0)
        if contact:
            sizes[name] = size
        at = int(size.argmax())
        forces.append(
            (name, number(size[at], 4), "N" if contact else "N or N m", number(record.t[at], 4), str(record.modes[name][-1]))
        )
    tables = [
        Table(rows, ("of the motion", "value", "unit")),
        Table(forces, ("constraint", "largest force |f|", "unit", "at [s]", "at the end it")),
    ]
    drawing = curves("force |f| [N]", record.t, sizes) if sizes else ""
    limit = record.robot.effort_limit
    if record.tau.any() and np.isfinite(limit).any():
        used = 100.0 * record.robot.torque_use(record.tau, record.v).max(axis=1)
        drawing += curves(
            "most used motor [% of its limit]",
            record.t,
            {"": used},
        )
    events = [(number(e.t, 6), e.name, str(e.point) if e.point >= 0 else "", e.kind) for e in record.events[:_EVENTS]]
    named = Table(events, ("at [s]", "contact", "point", "event"), whole=len(record.events), rest="trajectory.events")
    how = [("integrator", record.integrator), ("kept by", record.stabilisation)]
    proof = [_residuals(record), Table([(what, text) for what, text in how if text])]
    folds = [Fold("Proof: worst residuals", proof), *([Fold("Events", [named])] if events else [])]
    return Card(said, False if record.interrupted else None, tables, (), folds, drawing)


def _residuals(record: Trajectory) -> Table:
    rows = []
    for residual in RESIDUALS:
        values, worst = np.abs(record.residuals[residual.name]), worst_of(record.residuals[residual.name])
        if worst is None:
            rows.append((residual.name, "not known", residual.unit, "-", residual.meaning))
            continue
        unit = "scaled" if residual.unit == "1" else residual.unit
        at = number(record.t[worst], 4) if values[worst] else "-"
        rows.append((residual.name.replace("_", " "), f"{values[worst]:.1e}", unit, at, residual.meaning))
    return Table(rows, ("residual", "largest", "unit", "at [s]", "what it is"))


@card_of.register
def _sample(record: Sample) -> Card:
    rows = [
        ("torque, largest entry", number(np.abs(record.tau).max(initial=0.0), 4), "N, N m"),
        ("acceleration, largest entry", number(np.abs(record.a).max(initial=0.0), 4), "m/s2, rad/s2"),
        ("law residual", f"{record.law:.1e}", "scaled"),
        ("drift", f"{record.drift:.1e}", "m, rad"),
        ("penetration", f"{record.penetration:.1e}", "m, rad"),
    ]
    forces = [(name, record.modes[name], vector(f[:3], 2), "N, N m") for name, f in record.forces.items()]
    heads = ("constraint", "it", "force (first three entries)", "unit")
    said = f"{record.robot.name} at t = {number(record.t)} s"
    return Card(said, None, [Table(forces, heads), Table(rows, ("of the sample", "value", "unit"))])


@card_of.register
def _event(record: Event) -> Card:
    rows = [
        ("time", number(record.t), "s"),
        ("speed", number(record.speed, 4), "m/s"),
        ("impulse", number(record.impulse, 4), "N s"),
    ]
    return Card(str(record), None, [Table(rows)])


@card_of.register
def _motion(record: Motion) -> Card:
    rate = f" at {number(record.rate, 4)} Hz" if record.n > 1 else ""
    said = f"a motion of {record.robot.name}: {record.n} frames, {number(record.duration, 4)} s{rate}, from {record.source}"
    rows = [
        ("times", f"{number(record.t[0])} to {number(record.t[-1])}", "s"),
        ("largest speed of a joint", number(np.abs(record.v[:, record.robot.actuated]).max(initial=0.0), 4), "rad/s, m/s"),
        (
            "largest acceleration of a joint",
            number(np.abs(record.a[:, record.robot.actuated]).max(initial=0.0), 4),
            "rad/s2, m/s2",
        ),
        ("floor at", number(record.ground), "m"),
        ("v and a", "given" if record.derivation is None else str(record.derivation), ""),
    ]
    drawing = ""
    if record.robot.floating:
        travelled = record.q[-1, :3] - record.q[0, :3]
        rows.insert(1, ("base moved by", vector(travelled), "m"))
        drawing = curves("height of the base [m]", record.t, {"": record.q[:, 2]})
    notes = [Fold(f"Notes, {len(record.notes)}", [Table([(note,) for note in record.notes])])] if record.notes else []
    return Card(said, None, [Table(rows, ("of the motion", "value", "unit"))], (), notes, drawing)


@card_of.register
def _motion_report(record: MotionReport) -> Card:
    m, possible = record.motion, record.possible
    whole = bool(possible.all())
    part = f"{int(possible.sum())} of {record.n} frames ({share(record.share_possible)})"
    said = f"{m.robot.name} can do {f'all {record.n} frames' if whole else part} of the motion ({m.source})"
    rows, bars = [], {}
    for i, cause in enumerate(CAUSES):
        mask = record.causes[:, i]
        if mask.any():
            frames = record.worst(cause, 1)
            worst = int(frames[0])
            rows.append((cause, str(int(mask.sum())), share(float(mask.mean())), str(worst), fixed(m.t[worst], 2)))
            bars[cause] = mask
    heads = ("why not", "frames", "of all", "worst frame", "at [s]")
    numbers = [
        ("score", fixed(record.score, 1), "of 100"),
        ("missing wrench, median", share(float(np.median(record.missing_scaled)), 2), "of the weight"),
        ("missing wrench, largest", share(float(record.missing_scaled.max()), 2), "of the weight"),
        ("explained by noise, median", share(float(np.median(record.open)), 2), "of the weight"),
        ("friction", number(record.friction), ""),
        ("floor at", number(record.lanes.ground, 4), "m"),
    ]
    if record.before is not None:
        numbers.insert(0, ("possible before", share(record.before.share_possible), "of the frames"))
    groups, touches = record.lanes.points.group, record.lanes.touches
    feet = {str(c.name): np.asarray(touches[:, groups == g].any(axis=1)) for g, c in enumerate(record.lanes.contacts)}
    drawing = curves("missing wrench [% of the weight]", m.t, {"": 100.0 * record.missing_scaled}, least=1.0)
    drawing += lanes("touching the floor", m.t, feet) + (lanes("not possible because", m.t, bars) if bars else "")
    tables = [Table(rows, heads), Table(numbers, ("of the motion", "value", "unit"))]
    notes = (*m.notes, *record.lanes.notes)
    folds = [Fold("As printed", [str(record)])] + ([Fold("Notes", [Table([(note,) for note in notes])])] if notes else [])
    return Card(said, whole, tables, (), folds, drawing)
