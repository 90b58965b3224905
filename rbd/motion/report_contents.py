"""The contents of a `MotionReport`: its table, its arrays by name, its dataset and its files."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.installation import VERSION
from rbd.model.joints import FORCE_OF
from rbd.model.output_files import write_file
from rbd.modules import xarray_or_error
from rbd.motion.causes import CAUSES
from rbd.simulation.trajectory_file import a_trajectory_path

if TYPE_CHECKING:
    import xarray

_SPATIAL = ["x", "y", "z", "about_x", "about_y", "about_z"]


def _variables(report: Any) -> list[tuple[str, Array, list[str], str, str]]:
    """Name, array, dimensions after time, unit and meaning."""
    m, lanes = report.motion, report.lanes
    return [
        ("q", m.q, ["position"], "", "configuration"),
        ("v", m.v, ["velocity"], "", "velocity"),
        ("a", m.a, ["velocity"], "", "acceleration"),
        ("possible", report.possible, [], "", "whether a frame has no cause"),
        ("causes", report.causes, ["cause"], "", "why a frame is not possible"),
        ("missing", report.missing, ["spatial"], "N, then N m", "least wrench missing on the base, about its centre of mass"),
        ("missing_scaled", report.missing_scaled, [], "1", "the same over the weight, moments over 0.3 m"),
        ("open", report.open, [], "1", "its standard deviation by noise of the accelerations"),
        ("touches", lanes.touches, ["point"], "", "whether a point touches the floor"),
        ("slides", lanes.slides, ["point"], "", "whether it slides there"),
        ("heights", lanes.heights, ["point"], "m", "height of a point above the floor"),
        ("speeds", lanes.speeds, ["point"], "m/s", "speed of a point along the floor; NaN where it does not touch"),
        ("points", lanes.places, ["point", "axis"], "m", "points in W"),
        ("forces", report.forces, ["point", "axis"], "N", "force on the robot at each point, in W"),
        ("tau", report.tau, ["motor"], "", "motor torques"),
        ("excess", report.excess, ["motor"], "1", "torque beyond its limit, over the limit"),
        ("used_torque", report.used_torque, ["motor"], "1", "torque over its limit"),
        ("used_friction", report.used_friction, ["contact"], "1", "tangential over largest tangential force; NaN without load"),
        ("edge_margin", report.edge_margin, ["contact"], "m", "centre of pressure to the sole's edge; NaN without load"),
        ("nearest_a", report.nearest_a, ["velocity"], "", "nearest possible acceleration"),
    ]  # fmt: skip


def arrays_of(report: Any) -> dict[str, Array]:
    """All arrays by name."""
    return {"t": report.motion.t} | {name: x for name, x, *_ in _variables(report)}


def dataset_of(report: Any) -> xarray.Dataset:
    """The report with named dimensions, labels and units."""
    xr, robot = xarray_or_error(), report.motion.robot
    variables: dict[str, Any] = {}
    for name, x, dims, unit, meaning in _variables(report):
        variables[name] = (["time", *dims], x, {"long_name": meaning} | ({"units": unit} if unit else {}))
    coords: dict[str, Any] = {
        "time": ("time", report.motion.t, {"units": "s"}),
        "cause": np.array(CAUSES),
        "position": [c.name for c in robot.joints.positions],
        "velocity": [c.name for c in robot.joints.velocities],
        "motor": np.array([c.name for c in robot.motor_coordinates], str),
        "motor_unit": ("motor", np.array([FORCE_OF[c.unit] for c in robot.motor_coordinates], str)),
        "point": np.array(report.lanes.names, str),
        "contact": np.array([c.name for c in report.lanes.contacts], str),
        "axis": _SPATIAL[:3],
        "spatial": _SPATIAL,
    }
    return xr.Dataset(
        variables, coords, {"title": f"check of a motion of {robot.name}", "rbd": VERSION, "report": _json(report)}
    )


def save(report: Any, path: str | os.PathLike[str]) -> None:
    """Write .npz or .nc; see `MotionReport.save`."""
    place = a_trajectory_path(path)
    if place.suffix == ".npz":
        words = {"cause": np.array(CAUSES), "point": np.array(report.lanes.names, str), "report": np.array(_json(report))}
        write_file(place, lambda file: np.savez(file, allow_pickle=False, **arrays_of(report), **words))
        return
    dataset = dataset_of(report)
    for name in [name for name, x in dataset.variables.items() if not x.size]:  # netCDF 3 has no empty arrays
        dataset = dataset.drop_vars([name])
    for name in [name for name, x in dataset.data_vars.items() if x.dtype == bool]:
        dataset[name] = dataset[name].astype(np.int8)
    content = dataset.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    write_file(place, lambda file: file.write(content))


def _json(report: Any) -> str:
    return json.dumps(report.summary(), allow_nan=False)


def table(report: Any) -> str:
    """The printed report: what is possible, causes with their worst frames, the curve, the noise."""
    m, before = report.motion, report.before
    share = _beside(100 * report.share_possible, None if before is None else 100 * before.share_possible)
    lines = [
        f"{m.source}: {m.n} frames of {m.robot.name}, {m.duration:.2f} s at {m.rate:.4g} Hz",
        f"  possible   {share} % of the frames, score {_beside(report.score, None if before is None else before.score)} of 100",
    ]
    for i, cause in enumerate(CAUSES):
        count, was = int(report.causes[:, i].sum()), None if before is None else int(before.causes[:, i].sum())
        if count or was:
            lines.append(f"  {cause:<15}{_beside(count, was, 0)} frames{_worst(report, cause)}")
    levels = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
    over = ", ".join(f"{100 * level:g} %: {100 * x:.1f}" for level, x in zip(levels, report.share_over(levels), strict=True))
    lines.append(f"  missing wrench over a share of the weight, % of the frames:  {over}")
    lines.append(
        f"  median missing {100 * float(np.median(report.missing_scaled)):.2g} % of the weight; noise of the accelerations "
        f"explains {100 * float(np.median(report.open)):.2g} %"
    )
    if m.derivation is not None:
        lines.append(f"  accelerations: {m.derivation}")
    s = report.settings
    floor = f"floor at z = {report.lanes.ground:.4g} m"
    lines.append(f"  friction {s.friction:g}, {floor}, threshold {100 * s.threshold:g} % of the weight")
    return "\n".join(lines + [f"  note: {note}" for note in (*m.notes, *report.lanes.notes)])


def _beside(now: float, was: float | None, digits: int = 1) -> str:
    text = f"{now:.{digits}f}"
    return text if was is None else f"{was:.{digits}f} -> {text}"


def _worst(report: Any, cause: str) -> str:
    frames = report.worst(cause, 3)
    if not len(frames):
        return ""
    f, t = int(frames[0]), report.motion.t
    at = ", ".join(f"{int(i)} ({t[i]:.2f} s)" for i in frames)
    told = f", worst {at}"
    if cause == "sinks":
        told += f": {1000 * -report.lanes.heights[f].min():.0f} mm below the floor"
    elif cause == "slides":
        told += f": {1000 * np.where(report.lanes.slides[f], report.lanes.speeds[f], 0.0).max():.0f} mm/s"
    elif cause == "motor":
        j = int(report.excess[f].argmax())
        told += f": {report.motion.robot.actuated_names[j]} {100 * report.excess[f, j]:.0f} % beyond its limit"
    elif cause == "torque-speed":
        told += f": {report.on_line(f)}"
    elif cause in ("floats", "friction", "tips"):
        told += f": {100 * report.missing_scaled[f]:.0f} % of the weight missing"
    elif cause == "self-collision" and report.collisions is not None:
        told += ": " + ", ".join(" and ".join(pair) for pair, at_ in report.collisions.pairs.items() if f in at_)
    return told
