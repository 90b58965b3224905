"""The charts of a trajectory, or of a motion without forces; the plane of a contact over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.convex.polygons import across, convex_hull, half_planes
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import FORCE_OF
from rbd.problem.ground import Ground
from rbd.problem.residuals import USABLE
from rbd.simulation.trajectory_fields import RESIDUALS
from rbd.visual.marks.contacts import UPRIGHT
from rbd.visual.playback.curves import FINE, GREY, Choice, CurveChart, CurveLine, chart, most_used
from rbd.visual.style import COM_COLOR, CONTACT_COLORS, contact_colors

CHARTS: Mapping[str, str] = {
    "forces": "contact forces: normal (bold) and |f| (fine)",
    "torques": "motor torques in % of their limits",
    "centre of pressure": "distance of the centre of pressure from the edge of its sole",
    "energy": "kinetic, potential, total, in springs, and the work of motors and dampers",
    "residuals": "residuals of the contact law and of the constraints, on a logarithmic axis",
    "angles": "joint positions, in % of the way from the middle to a limit",
    "speeds": "joint speeds in % of their limits",
    "height": "height of the centre of mass",
}
"""{name: what the chart shows}: those of a trajectory. The first five are drawn where forces are known, else the last three."""
OF_FORCES, OF_POSES = tuple(CHARTS)[:5], tuple(CHARTS)[5:]
NAMED_CONTACTS = 6
_SMALLEST = 1e-16
"""Residuals below it are drawn at the foot of their axis."""


Maker: TypeAlias = Callable[[], CurveChart | None]


def charts_of(shown: Any, choice: Choice) -> list[CurveChart]:
    """The charts of a motion, in the order of `CHARTS`, or as they are chosen.

    Args:
        shown: With robot, t, q and v, and as much of a `Trajectory` as there is.
        choice: True: those that there are numbers for; False: none; or names of `CHARTS`.

    Raises:
        InputError: an unknown name, or one of which the motion knows nothing.
    """
    makers = makers_of(shown)
    if not isinstance(choice, bool | np.bool_) or not choice:
        return chosen_charts(shown.robot.name, makers, choice, ())
    found = chosen_charts(shown.robot.name, makers, True, OF_FORCES)
    found = [made for made in found if made.name != "torques" or any(line.values.any() for line in made.lines)]
    return found or chosen_charts(shown.robot.name, makers, True, OF_POSES)


def makers_of(shown: Any) -> dict[str, Maker]:
    """{name of a chart: what makes it}: None where there are no numbers."""
    return {name: partial(make, shown) for name, make in _MAKERS.items()}


def chosen_charts(what: str, makers: Mapping[str, Maker], choice: Choice, usual: Sequence[str]) -> list[CurveChart]:
    """The charts with these names; of `usual`, if all are wanted, those that there are numbers for.

    Args:
        what: The robot's name.
        makers: Of each chart.
        choice: True: the usual ones; False: none; or names.
        usual: Names.

    Raises:
        InputError: an unknown name, or one that there are no numbers for.
    """
    if isinstance(choice, bool | np.bool_):
        return [made for name in usual if choice and (made := makers[name]()) is not None]
    if isinstance(choice, str) or not np.iterable(choice):
        raise InputError(f"charts are {choice!r:.80}; expected True, False, or a list of names.")
    charts = []
    for name in dict.fromkeys(choice):
        if not isinstance(name, str) or name not in makers:
            raise InputError(f"there is no chart {name!r:.80}; {nearest(name, makers)}. Charts: {', '.join(makers)}.")
        if (chart := makers[name]()) is None:
            raise InputError(
                f"this motion of {what} has no numbers for the chart {name!r} ({CHARTS.get(name, name)}); leave it out, or "
                "charts=True for those that there are."
            )
        charts.append(chart)
    return charts


def _forces(shown: Any) -> CurveChart | None:
    contacts = {name: forces.sum(axis=1) for name, forces in getattr(shown, "point_forces", {}).items()}
    if not contacts:
        return _constraint_forces(shown)
    colors = contact_colors(contacts)
    size = {name: np.linalg.norm(force, axis=1) for name, force in contacts.items()}
    order = sorted(contacts, key=lambda name: -float(size[name].max()))
    lines = []
    for name in [name for name in contacts if name in order[:NAMED_CONTACTS]]:
        normal = plane_normals(getattr(shown, "planes", {}).get(name), shown.points[name], shown.point_forces[name])
        along = contacts[name][:, 2] if normal is None else np.einsum("ij,ij->i", contacts[name], normal)
        lines += [
            CurveLine(f"{name} {'vertical' if normal is None else 'normal'}", colors[name], along),
            CurveLine("|f|", colors[name], size[name], FINE),
        ]
    if rest := order[NAMED_CONTACTS:]:
        lines.insert(0, CurveLine("largest |f| of the others", GREY, np.max([size[name] for name in rest], axis=0), FINE))
    robot = shown.robot
    weight = float(robot.mass * np.linalg.norm(robot.gravity))
    carried = max(float(np.nan_to_num(s).max()) for s in size.values())
    limits = {"weight": weight} if robot.floating and 0.4 * weight < carried < 20.0 * weight else {}
    words = {line.name.rpartition(" ")[2] for line in lines} & {"normal", "vertical"}
    title = f"contact forces, N: {' or '.join(sorted(words))} (bold), |f| (fine)"
    return chart("forces", title, lines, limits=limits, least_top=1.05 * max(limits.values(), default=0.0), percentile=98.0)


def _constraint_forces(shown: Any) -> CurveChart | None:
    """Of constraints that are no contacts, such as loops: |f| of those with a resultant, else each row."""
    lines, words = [], set()
    for name, force in (getattr(shown, "forces", None) or {}).items():
        if force.shape[1] in (3, 6):
            lines.append((f"|f| {name}", np.linalg.norm(force[:, :3], axis=1)))
            words.add("N")
        else:
            lines += [(name if force.shape[1] == 1 else f"{name} row {k + 1}", row) for k, row in enumerate(force.T)]
            words |= {"N", "N m"}
    if not lines:
        return None
    lines.sort(key=lambda line: -float(np.abs(line[1]).max()))
    drawn = [CurveLine(name, color, row) for (name, row), color in zip(lines, CONTACT_COLORS, strict=False)]
    signed = bool(min(line.values.min() for line in drawn) < 0.0)
    return chart("forces", f"forces of constraints, {' or '.join(sorted(words))}", drawn, percentile=98.0, signed=signed)


def _torques(shown: Any) -> CurveChart | None:
    robot: CheckedModel = shown.robot
    tau = np.abs(getattr(shown, "tau", np.zeros((len(shown.t), 0))))
    if not tau.shape[1]:
        return None
    if np.isfinite(robot.effort_limit).any():
        share = 100.0 * (robot.torque_use(shown.tau, shown.v) if robot.torque_lines else tau / robot.effort_limit)
        return most_used("torques", "motor torques, % of their limits", robot.actuated_names, share, limit=100.0)
    if not tau.any():
        return None
    units = sorted({FORCE_OF[c.unit] for c in robot.motor_coordinates})
    return most_used(
        "torques", f"motor torques, {' or '.join(units)} (no limits are known)", robot.actuated_names, tau, limit=None
    )


def _pressure(shown: Any) -> CurveChart | None:
    points = getattr(shown, "points", {})
    colors = contact_colors(points)
    found = {name: edge_distances(places, shown.point_forces[name]) for name, places in points.items()}
    lines = [CurveLine(name, colors[name], 1e3 * far) for name, far in found.items() if far is not None]
    if not lines:
        return None
    return chart("centre of pressure", "centre of pressure: distance from the sole's edge, mm", lines[:NAMED_CONTACTS])


TOTAL_COLOR = "#1a1a1a"


def energy_curves(shown: Any) -> list[CurveLine]:
    """Kinetic, potential (from its start) and total energy; then, where there are any, of springs, and work of dampers.

    Args:
        shown: A `Trajectory`, or a part of it with `kinetic`, `potential`, and if known `elastic` and `dissipated`.
    """
    n = len(shown.kinetic)
    elastic, taken = (getattr(shown, name, np.zeros(n)) for name in ("elastic", "dissipated"))
    potential, taken = shown.potential - shown.potential[0], taken - taken[:1]
    always = [
        CurveLine("kinetic", CONTACT_COLORS[0], shown.kinetic),
        CurveLine("potential, from its start", CONTACT_COLORS[2], potential),
        CurveLine("total", TOTAL_COLOR, shown.kinetic + potential + elastic),
    ]
    further = [
        CurveLine("in springs", CONTACT_COLORS[3], elastic),
        CurveLine("work taken by dampers", CONTACT_COLORS[4], taken),
    ]
    return always + [line for line in further if line.values.any()]


def _energy(shown: Any) -> CurveChart | None:
    if not all(hasattr(shown, name) for name in ("kinetic", "potential", "motor_work")):
        return None
    lines = [replace(line, name=line.name.split(",")[0]) for line in energy_curves(shown)]
    if np.any(shown.motor_work):
        lines.append(CurveLine("work of the motors", CONTACT_COLORS[1], shown.motor_work - shown.motor_work[0]))
    return chart("energy", "energy, J (potential from its start)", lines, signed=True)


def _residuals(shown: Any) -> CurveChart | None:
    if not hasattr(shown, "residuals"):
        return None
    lines = []
    for known, color in zip(RESIDUALS, CONTACT_COLORS, strict=False):
        values = np.abs(shown.residuals[known.name])
        if known.name == "law" or (values.any() and np.isfinite(values).all()):
            unit = "scaled" if known.unit == "1" else known.unit
            lines.append(CurveLine(f"{known.name.replace('_', ' ')}, {unit}", color, values))
    values = np.concatenate([np.maximum(line.values, _SMALLEST) for line in lines])
    low, top = 10.0 ** np.floor(np.log10(values.min())), 10.0 ** np.ceil(np.log10(max(values.max(), 2.0 * USABLE)))
    return CurveChart(
        "residuals", "residuals, logarithmic", tuple(lines), {f"law: a warning above {USABLE:g}": USABLE}, low, top, True
    )


def _angles(shown: Any) -> CurveChart | None:
    robot = shown.robot
    joints = [j for j in robot.joints.values() if j.nv == 1 and not j.is_continuous and -np.inf < j.lower < j.upper < np.inf]
    if not joints:
        return None
    q = shown.q[:, [j.q.start for j in joints]]
    low, high = np.array([(j.lower, j.upper) for j in joints]).T
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    title = "joint positions, % of the way from the middle to a limit"
    return most_used("angles", title, [j.name for j in joints], 100.0 * np.abs(q - middle) / half, limit=100.0)


def _speeds(shown: Any) -> CurveChart | None:
    if not (joints := [j for j in shown.robot.joints.values() if np.isfinite(j.speed)]):
        return None
    share = 100.0 * np.abs(shown.v[:, [j.v.start for j in joints]]) / np.array([j.speed for j in joints])
    return most_used("speeds", "joint speeds, % of their limits", [j.name for j in joints], share, limit=100.0)


def _height(shown: Any) -> CurveChart | None:
    robot: CheckedModel = shown.robot
    if robot.mass <= 0.0:
        return None
    if hasattr(shown, "com"):
        height = np.asarray(shown.com)[:, 2]
    else:
        model, data = robot.model, robot.model.createData()
        height = np.array([pin.centerOfMass(model, data, np.array(q, float))[2] for q in shown.q])
    return chart("height", "height of the centre of mass, m", [CurveLine("height", COM_COLOR, height)], signed=True)


_MAKERS: Mapping[str, Callable[[Any], CurveChart | None]] = {
    "forces": _forces,
    "torques": _torques,
    "centre of pressure": _pressure,
    "energy": _energy,
    "residuals": _residuals,
    "angles": _angles,
    "speeds": _speeds,
    "height": _height,
}


def plane_normals(plane: Ground | None, points: Array, forces: Array) -> Array | None:
    """Unit normal of a contact at each time, shape (n, 3): of its slope or wall, where that stays; else as of `normals_of`.

    Single points on level ground have none: charts and legends say "vertical" of them.

    Args:
        plane: Of the contact, where it is known and stays.
        points: Its points in W, shape (n, k, 3) [m].
        forces: At these, shape (n, k, 3) [N].
    """
    if plane is None or plane.level:
        return normals_of(points, forces)
    return np.tile(np.asarray(plane.normal, float), (len(points), 1))


_IN_PLANE_M = 1e-3
"""Points of a contact this near to the plane of the loaded ones are in it [m]."""
_FLAT = 1e-6
"""Points whose spread along one axis is less than this share of their largest, both squared, are in a plane or on a line."""


def normals_of(points: Array, forces: Array) -> Array | None:
    """Unit normal of a contact at each time, shape (n, 3), on the side to which it mostly pushes the robot; None if unknown.

    It is that of the plane through the loaded points. Where fewer than three are loaded, or they lie on a line, it is the one
    of the nearest time before that had one, else of the first such time: a foot that tips does not turn the ground. Unknown
    are those of single points, of edges, and of contacts whose loaded points are not in one plane.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m]; NaN where there is none.
        forces: At the points, shape (n, k, 3) [N].
    """
    n, k = points.shape[:2]
    if k < 3:
        return None
    there = np.isfinite(points).all(axis=2) & (np.linalg.norm(forces, axis=2) > 0.0)
    count = there.sum(axis=1)
    clean = np.where(there[:, :, None], points, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = clean.sum(axis=1) / count[:, None]
    arms = np.where(there[:, :, None], points - centre[:, None], 0.0)
    spread = np.einsum("nki,nkj->nij", arms, arms)
    known = count >= 3
    if not known.any():
        return None
    sizes, axes = np.linalg.eigh(np.where(known[:, None, None], spread, np.eye(3)))
    known &= sizes[:, 1] > _FLAT * sizes[:, 2]
    if not known.any() or (sizes[known, 0] > _FLAT * sizes[known, 2]).any():
        return None
    normal = axes[:, :, 0]
    normal = normal * np.where(normal @ normal[int(known.argmax())] < 0.0, -1.0, 1.0)[:, None]
    if np.einsum("ni,ni->", normal[known], forces.sum(axis=1)[known]) < 0.0:
        normal = -normal
    last = np.maximum.accumulate(np.where(known, np.arange(n), -1))
    return normal[np.where(last < 0, int(known.argmax()), last)]


def edge_distances(points: Array, forces: Array) -> Array | None:
    """Distance of the centre of pressure from the edge of its sole at each time, shape (n,) [m]; None if it is no flat sole.

    NaN while it carries no load. The edge is the convex hull of its points, the centre of pressure the mean of the points
    weighted by their normal forces; a pull counts as none. Where points come and go, as on terrain, the edge is that of the
    part that rests: of the points in the plane of the loaded ones.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m].
        forces: At the points, shape (n, k, 3) [N].
    """
    if (normal := normals_of(points, forces)) is None:
        return None
    complete = np.isfinite(points).all(axis=(1, 2))
    if not np.ptp(np.linalg.norm(points - points[:, :1], axis=2), axis=0).max() < _IN_PLANE_M:  # NaN where one is not there
        load = np.maximum(np.einsum("nki,ni->nk", forces, normal), 0.0)
        far = [_edge_distance(*each) if each[1].any() else np.nan for each in zip(points, load, normal, strict=True)]
        return np.array(far)
    i = int(complete.argmax())
    arms = points[i] - points[i].mean(axis=0)
    _, sizes, axes = np.linalg.svd(arms)
    flat = arms @ axes[:2].T
    hull = convex_hull(flat)
    if len(hull) < 3 or sizes[2] ** 2 > _FLAT * sizes[0] ** 2:
        return None
    inward, offsets = half_planes(hull)
    load = np.maximum(np.einsum("nki,ni->nk", forces, normal), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = load @ flat / load.sum(axis=1)[:, None]
    return np.where(complete, (centre @ inward.T - offsets).min(axis=1), np.nan)


def _edge_distance(points: Array, load: Array, normal: Array) -> float:
    """Of the centre of pressure from the edge of the part of a sole that rests, at one time [m]; NaN where that is no area."""
    centre = (load[:, None] * np.nan_to_num(points)).sum(axis=0) / load.sum()
    arms = points[np.isfinite(points).all(axis=1)] - centre
    arms = arms[np.abs(arms @ normal) < _IN_PLANE_M]
    hull = convex_hull(arms @ across(normal).T)
    if len(hull) < 3:
        return np.nan
    return float((-half_planes(hull)[1]).min())


def carries_weight(points: Array, forces: Array) -> bool:
    """Whether a contact can support the robot from below: its normal, or its force where none is known, points up.

    Args:
        points: Of the contact in W, shape (n, k, 3) [m].
        forces: At the points, shape (n, k, 3) [N].
    """
    normal = normals_of(points, forces)
    mean = np.nan_to_num(forces).sum(axis=(0, 1)) if normal is None else normal.mean(axis=0)
    return bool(mean[2] > UPRIGHT * float(np.linalg.norm(mean)))
