"""Cards of what statics finds: regions of support, largest pushes, wrench cones, margins."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array, largest_first
from rbd.model.gravity import along_gravity, is_along_z
from rbd.statics.actuation import ActuationUniqueness, Margins
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.wrench_cones import ContactWrenchCone
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.visual.name_lists import joined
from rbd.visual.notebook.card import Card, Fold, Table
from rbd.visual.notebook.registry import card_of
from rbd.visual.notebook.small_curves import polygon
from rbd.visual.notebook.values import fixed, number, share, vector, words


def _area(record: SupportRegion | ZmpRegion) -> str:
    return f"{1e4 * record.area:.1f} cm2{record.cut_words}" if np.isfinite(record.area) else "without end"


@card_of.register
def _support_region(record: SupportRegion) -> Card:
    if record.empty:
        said, inside = "it cannot be at rest anywhere on these contacts: the support region is empty", False
    else:
        inside = bool(record.com_to_edge[0] >= 0.0)
        can = "it can stand" if inside else "it cannot stand"
        said = f"the centre of mass is {record.com_in_words} the support region: {can}"
    gravity = record.state.robot.gravity
    com, seen = along_gravity(gravity, record.state.com), "from above" if is_along_z(gravity) else "along gravity, on z = 0"
    rows = [
        ("area", _area(record), ""),
        (f"centre of mass, seen {seen}", vector(com), "m"),
        ("on", joined(r.name for r in record.loads.rows), ""),
        ("torque limits", "within" if record.torque_limits else "torques of any size", ""),
        ("friction", f"{record.friction}, {share(record.margin, 0)} of it unused", ""),
    ]
    proof = [
        ("largest residual of the proving forces", f"{record.residual:.1e}", "N"),
        ("outer polygon larger by", number(1e4 * record.area_gap, 3) if np.isfinite(record.area_gap) else "-", "cm2"),
        ("linear or conic programs", str(record.programs), ""),
    ]
    folds = [Fold("Corners, each proved by forces", [_corners(record.vertices), Table(proof)])]
    drawing = "" if record.empty else polygon(f"the region, seen {seen} [m]", record.vertices, {"centre of mass": com})
    motors = record.motors_in_the_way
    notes = [f"Torque limits in the way: {joined(motors)}."] if motors else []
    return Card(said, inside, [Table(rows, ("of the region", "value", "unit"))], notes, folds, drawing)


def _corners(vertices: Array) -> Table:
    axes = ("x [m]", "y [m]", "z [m]")[: vertices.shape[1]]
    return Table([tuple(fixed(v, 4) for v in row) for row in vertices], axes, whole=len(vertices), rest="region.vertices")


@card_of.register
def _zmp_region(record: ZmpRegion) -> Card:
    kind = "of the linear pendulum" if record.pendular else "of any motion"
    said = f"zero-moment points {kind}: " + ("none" if record.empty else _area(record))
    rows = [
        ("area", _area(record), ""),
        ("on", joined(r.name for r in record.loads.rows), ""),
        ("friction", record.friction, ""),
    ]
    folds = [Fold("Corners, each proved by forces", [_corners(record.vertices)])]
    return Card(said, not record.empty, [Table(rows, ("of the region", "value", "unit"))], (), folds)


@card_of.register
def _pushes(record: PushLimits) -> Card:
    weakest = int(np.nanargmin(record.forces if record.held else record.least))
    limits = record.gives_way
    why = joined(map(str, limits[weakest])) or f"no limit met up to {number(record.at_most)} N"
    way = vector(record.directions[weakest], 2)
    most = f"withstands {number(record.forces[weakest], 4)} N at {record.frame} along {way}"
    weak = ", its weakest direction" if len(record.forces) > 1 else ""
    said = f"{most}{weak}; what gives way there: {why}"
    if not record.held:
        least = number(record.least[weakest], 4)
        said = f"cannot be held without a push; one of {least} N at {record.frame} along {way} holds it"
    order = largest_first(-record.forces)
    rows = [
        (
            vector(record.directions[i], 2),
            *([] if record.held else [fixed(record.least[i], 2)]),
            fixed(record.forces[i], 2),
            fixed(record.bounds[i], 2),
            joined(map(str, limits[i])) or "-",
        )
        for i in order
    ]
    smallest = () if record.held else ("smallest push [N]",)
    heads = ("direction", *smallest, "largest push [N]", "no more than [N]", "gives way first")
    residual = Table([("largest residual of the proving forces", f"{record.residual:.1e}", "N")])
    folds = [Fold("Proof: residuals", [residual])]
    return Card(said, None, [Table(rows, heads, rest="forces")], (), folds)


@card_of.register
def _wrench_cone(record: ContactWrenchCone) -> Card:
    said = f"wrenches of {joined(record.names)}: {len(record.rays)} rays, {len(record.faces)} faces"
    rows = [
        ("about", vector(record.about), "m"),
        ("rays (force, moment)", str(len(record.rays)), "N, N m"),
        ("lines", str(len(record.lines)), ""),
        ("faces", str(len(record.faces)), ""),
        ("friction", words(record.pyramids), ""),
    ]
    return Card(said, None, [Table(rows, ("of the cone", "value", "unit"))])


@card_of.register
def _margins(record: Margins) -> Card:
    left = [float(np.nanmin(record.torque, initial=np.inf)), *record.friction.values()]
    least = min((x for x in left if np.isfinite(x)), default=np.nan)
    rows = [("torque, of the motor nearest to its limit", share(left[0]) if np.isfinite(left[0]) else "-", "of the limit")]
    rows += [(f"friction of {name}", share(x), "of the cone") for name, x in record.friction.items()]
    rows += [(f"edge of {name}", fixed(1e3 * d, 1), "mm") for name, d in record.centre_of_pressure.items()]
    good = None if least != least else bool(least >= 0.0)
    return Card(f"{share(least)} is left of the nearest limit", good, [Table(rows, ("limit", "left", "unit"))])


@card_of.register
def _actuation_uniqueness(record: ActuationUniqueness) -> Card:
    one = not (record.torques or record.forces or record.corner_forces)
    said = "torques and forces are unique" if one else str(record)
    rows = [
        ("torques", str(record.torques)),
        ("contact forces", str(record.forces)),
        ("corner forces", str(record.corner_forces)),
    ]
    return Card(said, None, [Table(rows, ("of the", "directions in which they can change"))])
