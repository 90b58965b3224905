"""Writes the mechanisms of this folder, so that it is seen where their numbers come from: `python urdf/make.py`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rbd.mechanism import four_bar, slider_crank
from rbd.robots import Box
from rbd.robots.linkage import COLORS, Link, Linkage, meeting, wrapped

HERE = Path(__file__).parent
ORIGIN = "Origin: drawn for rbd, written by urdf/make.py. Licence: BSD-2-Clause, as the project."
Vector = Sequence[float]


def main(folder: Path) -> None:
    """All files, with their loop files, into the folder."""
    four_bar(0.04, 0.12, 0.08, 0.1, crank_angle=math.radians(40.0), path=folder / "four_bar.urdf")
    slider_crank(0.05, 0.16, offset=0.02, crank_angle=math.radians(50.0), path=folder / "slider_crank.urdf")
    for linkage in (five_bar(), six_bar(), parallel_leg()):
        linkage.load(folder / f"{linkage.name}.urdf")
    for name, (links, closing) in wheeled().items():
        _write(folder, name, links)
        (folder / f"{name}.loops.yaml").write_text(f"# What rolls in {name}.urdf. {ORIGIN}\n{closing}", encoding="utf-8")
    _write(folder, "rimless_wheel", rimless_wheel())


def _write(folder: Path, name: str, links: list[str]) -> None:
    """A model: what it is, and its elements."""
    head = f'<?xml version="1.0"?>\n<!-- {links[0]}\n     {ORIGIN} -->\n<robot name="{name}">\n'
    head += "".join(f'  <material name="{c}"><color rgba="{rgba}"/></material>\n' for c, rgba in COLORS.items())
    (folder / f"{name}.urdf").write_text(head + "".join(links[1:]) + "</robot>\n", encoding="utf-8")


# ------------------------------------------------------------------------------------------------------- flat linkages


def bar_end(start: tuple[float, float], angle: float, x: float, z: float = 0.0) -> tuple[float, float]:
    """Where a point (x, z) of a link is that starts here and is turned by the angle."""
    c, s = math.cos(angle), math.sin(angle)
    return start[0] + c * x - s * z, start[1] + s * x + c * z


def five_bar() -> Linkage:
    """Two driven cranks whose long bars meet in one point: a planar robot with two freedoms."""
    crank, arm, base = 0.1, 0.17, 0.12
    left, right = math.radians(125.0), math.radians(55.0)
    ends = bar_end((0.0, 0.0), left, crank), bar_end((base, 0.0), right, crank)
    postures = {}
    for name, side in (("assembled", 1.0), ("crossed", -1.0)):
        at_left, at_right = meeting(ends[0], arm, ends[1], arm, side)
        postures[name] = {"left_crank": left, "left_arm": wrapped(at_left - left)}
        postures[name] |= {"right_crank": right, "right_arm": wrapped(at_right - right)}
    links = (
        Link("left_crank", "ground", (0.0, 0.0), ((crank, 0.0),), 0.15, "orange", 0, motor=True),
        Link("left_arm", "left_crank", (crank, 0.0), ((arm, 0.0),), 0.2, "blue", 1, tip=1),
        Link("right_crank", "ground", (base, 0.0), ((crank, 0.0),), 0.15, "red", 0, motor=True),
        Link("right_arm", "right_crank", (crank, 0.0), ((arm, 0.0),), 0.2, "green", 2, tip=1),
    )
    about = "A five-bar: two driven cranks of 0.1 m, two arms of 0.17 m, ground 0.12 m; the arms meet in the robot's hand."
    ground = ((0.0, 0.0), (base, 0.0))
    return Linkage("five_bar", about, ground, links, {"hand": ("left_arm", "right_arm")}, postures, 0.006, ORIGIN)


def six_bar() -> Linkage:
    """Stephenson's third six-bar: a four-bar whose coupler's third corner drives two more bars."""
    a, b, c, corner = 0.06, 0.18, 0.14, (0.1, 0.08)
    o4, o6, rod, lever = (0.17, 0.0), (0.3, 0.06), 0.22, 0.16
    th = math.radians(70.0)
    tip = bar_end((0.0, 0.0), th, a)
    coupler, rocker = meeting(tip, b, o4, c, 1.0)
    at_rod, at_lever = meeting(bar_end(tip, coupler, *corner), rod, o6, lever, 1.0)
    posture = {"crank": th, "coupler": wrapped(coupler - th), "rocker": rocker}
    posture |= {"rod": wrapped(at_rod - coupler), "lever": at_lever}
    links = (
        Link("crank", "ground", (0.0, 0.0), ((a, 0.0),), 0.06, "orange", 0, motor=True),
        Link("coupler", "crank", (a, 0.0), ((b, 0.0), corner, (0.0, 0.0)), 0.35, "blue", 1, tip=1),
        Link("rocker", "ground", o4, ((c, 0.0),), 0.14, "green", 0, tip=1),
        Link("rod", "coupler", corner, ((rod, 0.0),), 0.22, "violet", 2, tip=1),
        Link("lever", "ground", o6, ((lever, 0.0),), 0.16, "red", 1, tip=1),
    )
    about = "Stephenson's third six-bar: a crank-rocker, and a rod from its coupler's third corner to a lever."
    closures = {"rocker_pin": ("coupler", "rocker"), "lever_pin": ("rod", "lever")}
    return Linkage("six_bar", about, ((0.0, 0.0), o4, o6), links, closures, {"assembled": posture}, 0.006, ORIGIN)


def parallel_leg() -> Linkage:
    """A leg with both motors at the hip, and a foot that three parallelograms keep level."""
    thigh, shank, lever, side = 0.22, 0.22, 0.05, 0.05
    at_thigh, at_shank = math.radians(-60.0), math.radians(-115.0)
    sole = (Box((0.19, 0.07, 0.014), at=(0.01, 0.0, -0.062), color="grey"),)
    links = (
        Link("thigh", "ground", (0.0, 0.0), ((thigh, 0.0),), 1.2, "blue", 0, motor=True, limits=(-3.0, 0.0), width=1.8),
        Link("crank", "ground", (0.0, 0.0), ((-lever, 0.0),), 0.15, "orange", 2, motor=True, limits=(-3.0, 0.0)),
        Link("push_rod", "crank", (-lever, 0.0), ((thigh, 0.0),), 0.12, "orange", 3, tip=1),
        Link("shank", "thigh", (thigh, 0.0), ((shank, 0.0), (-lever, 0.0)), 0.8, "green", 1, tip=2, width=1.8),
        Link("knee_plate", "thigh", (thigh, 0.0), ((side, 0.0),), 0.1, "steel", -2, tip=1),
        Link("thigh_rod", "ground", (side, 0.0), ((thigh, 0.0),), 0.12, "violet", -3, tip=1),
        Link("shank_rod", "knee_plate", (side, 0.0), ((shank, 0.0),), 0.12, "violet", -2, tip=1),
        Link("foot", "shank", (shank, 0.0), ((side, 0.0), (0.0, -0.055), (0.0, 0.0)), 0.5, "red", 0, tip=1, shapes=sole),
    )
    closures = {"lever_pin": ("push_rod", "shank"), "plate_pin": ("thigh_rod", "knee_plate"), "foot_pin": ("shank_rod", "foot")}
    posture = {"thigh": at_thigh, "crank": at_shank, "push_rod": at_thigh - at_shank, "shank": at_shank - at_thigh}
    posture |= {"knee_plate": -at_thigh, "thigh_rod": at_thigh, "shank_rod": at_shank, "foot": -at_shank}
    about = "A leg whose motors, of thigh and shank, both sit at the hip; rods beside thigh and shank keep the foot level."
    ground = ((0.0, 0.0), (side, 0.0))
    return Linkage("parallel_leg", about, ground, links, closures, {"assembled": posture}, 0.008, ORIGIN, hangs=True)


# --------------------------------------------------------------------------------------------------- what rolls or slides


def wheeled() -> dict[str, tuple[list[str], str]]:
    """{name: (what it is and its elements, its loop file)}."""
    return {f.__name__: f() for f in (unicycle, chaplygin_sleigh, rolling_disk, two_wheeled, bicycle)}


def unicycle() -> tuple[list[str], str]:
    """One driven wheel under a saddle, kept upright by its planar joint."""
    r = 0.25
    crown, saddle = 0.56, 0.78
    frame = "".join(_tube((0.0, y, r), (0.0, y, crown), 0.012, "blue") for y in (-0.06, 0.06))
    frame += _tube((0.0, -0.07, crown), (0.0, 0.07, crown), 0.014, "blue")
    frame += _tube((0.0, 0.0, crown), (0.0, 0.0, saddle), 0.014, "blue") + _box((0.0, 0.0, saddle), (0.26, 0.12, 0.04), "grey")
    parts = [
        "A unicycle of 5 kg on a planar joint: heading and position on the ground, and the angle of its wheel.",
        _link("frame", 3.5, (0.0, 0.0, 0.6), _box_inertia(3.5, 0.2, 0.14, 0.4), frame),
        _wheel("wheel", 1.5, r, "red"),
        _joint("wheel_joint", "continuous", "frame", "wheel", (0.0, 0.0, r), effort=20.0),
    ]
    entry = f"  - {{name: wheel, kind: rolling_wheel, frame: wheel, radius: {r}, axis: [0, 1, 0]}}\n"
    return parts, f"root: planar\nwheels:\n{entry}"


def chaplygin_sleigh() -> tuple[list[str], str]:
    """A plate on a blade and two smooth knobs, its mass ahead of the blade."""
    a, m, inertia = 0.3, 5.0, 0.4
    plate = _box((a, 0.0, 0.1), (0.8, 0.3, 0.03), "blue") + _box((0.0, 0.0, 0.05), (0.16, 0.006, 0.1), "steel")
    for y in (-0.11, 0.11):
        plate += _tube((0.62, y, 0.02), (0.62, y, 0.1), 0.012, "grey") + _ball((0.62, y, 0.02), 0.02, "steel")
    plate += _disc((a, 0.0, 0.117), 0.035, 0.006, "orange", "0 0 0")
    parts = [
        "Chaplygin's sleigh: 5 kg, 0.4 kg m2 about its centre of mass, which is 0.3 m ahead of the blade (the orange mark).",
        _link("sleigh", m, (a, 0.0, 0.1), (0.05, 0.36, inertia), plate),
    ]
    return parts, "root: planar\nwheels:\n  - {name: blade, kind: knife_edge, frame: sleigh, direction: [1, 0, 0]}\n"


def rolling_disk() -> tuple[list[str], str]:
    """A coin that rolls, leans and turns."""
    r, m = 0.25, 2.0
    disk = _disc((0.0, 0.0, 0.0), r, 0.02, "orange") + _disc((0.0, 0.0, 0.0), 0.85 * r, 0.022, "steel")
    disk += _box((0.0, 0.0, 0.4 * r), (0.03, 0.024, 0.7 * r), "red")
    parts = [
        "A uniform disk of 2 kg and 0.25 m, thin where it touches: m r^2 / 2 about its axis y, m r^2 / 4 across.",
        _link("disk", m, (0.0, 0.0, 0.0), (m * r**2 / 4, m * r**2 / 2, m * r**2 / 4), disk),
    ]
    closing = f"root: free_flyer\nwheels:\n  - {{name: rim, kind: rolling_disk, frame: disk, radius: {r}, axis: [0, 1, 0]}}\n"
    return parts, closing + f"postures:\n  upright: {{root_joint: [0, 0, {r}, 0, 0, 0, 1]}}\n"


def two_wheeled() -> tuple[list[str], str]:
    """Two driven wheels on one axle, and no caster: the planar joint keeps it upright."""
    r, half = 0.1, 0.17
    body = _box((0.0, 0.0, 0.17), (0.2, 0.26, 0.1), "blue") + _box((0.0, 0.0, 0.3), (0.03, 0.03, 0.18), "grey")
    body += _box((0.02, 0.0, 0.4), (0.06, 0.14, 0.05), "steel") + _tube((0.0, -half, r), (0.0, half, r), 0.012, "grey")
    parts = [
        "A robot of 7 kg on two driven wheels of 0.1 m, 0.34 m apart, on a planar joint.",
        _link("chassis", 6.0, (0.02, 0.0, 0.18), _box_inertia(6.0, 0.2, 0.26, 0.2), body),
    ]
    for name, y in (("left", half), ("right", -half)):
        parts.append(_wheel(f"{name}_wheel", 0.5, r, "red"))
        parts.append(_joint(f"{name}_wheel_joint", "continuous", "chassis", f"{name}_wheel", (0.0, y, r), effort=5.0))
    entry = "  - {{name: {0}, kind: rolling_wheel, frame: {0}, radius: {1}, axis: [0, 1, 0]}}\n"
    return parts, "root: planar\nwheels:\n" + "".join(entry.format(f"{side}_wheel", r) for side in ("left", "right"))


def bicycle() -> tuple[list[str], str]:
    """Four bodies as in Whipple's model: frame with rider, fork, two wheels with thin rims; all free to lean."""
    r, base, trail, tilt, top = 0.34, 1.02, 0.07, math.radians(18.0), 0.95
    # On the steering axis, which meets the ground at base + trail.
    head = np.array([base + trail - top * math.tan(tilt), 0.0, top])
    back = np.array([[math.cos(tilt), 0.0, math.sin(tilt)], [0.0, 1.0, 0.0], [-math.sin(tilt), 0.0, math.cos(tilt)]])
    hub = back @ (np.array([base, 0.0, r]) - head)  # of the front wheel, in the fork's axes
    pedals, saddle, rear = (0.42, 0.0, 0.28), (0.25, 0.0, 0.85), (0.0, 0.0, r)
    steerer = tuple(head - 0.12 * np.array([-math.sin(tilt), 0.0, math.cos(tilt)]))
    tubes = (rear, pedals), (rear, saddle), (pedals, saddle), (pedals, steerer), (saddle, steerer)
    frame = "".join(_tube(p, q, 0.016, "blue") for p, q in tubes)
    frame += _box((0.23, 0.0, 0.88), (0.26, 0.13, 0.05), "grey") + _disc((0.42, 0.0, 0.28), 0.09, 0.012, "grey")
    frame += _tube((0.25, 0.0, 0.95), (0.45, 0.0, 1.4), 0.11, "green") + _ball((0.52, 0.0, 1.54), 0.1, "orange")
    for y in (-0.13, 0.13):  # the rider's arms and legs
        frame += _tube((0.43, y, 1.36), (0.76, y, 1.04), 0.03, "green")
        frame += _tube((0.28, y, 0.98), (0.58, y, 0.72), 0.05, "grey") + _tube((0.58, y, 0.72), (0.44, y, 0.3), 0.04, "grey")
    fork = _tube((0.0, 0.0, 0.08), (0.0, 0.0, -0.2), 0.018, "red") + _tube((0.03, -0.26, 0.1), (0.03, 0.26, 0.1), 0.014, "grey")
    for y in (-0.045, 0.045):
        fork += _tube((0.0, y, -0.2), (hub[0], y, hub[2]), 0.012, "red")
    fork += _tube((0.0, -0.045, -0.2), (0.0, 0.045, -0.2), 0.014, "red")
    parts = [
        "A bicycle after Whipple: frame with rider 80 kg, fork 3 kg, wheels of 0.34 m with 1.5 kg; wheelbase 1.02 m, trail\n"
        "     0.07 m, steering axis tilted back by 18 deg. The frame's origin is where the rear wheel touches when upright.",
        _link("frame", 80.0, (0.33, 0.0, 1.0), _box_inertia(80.0, 0.6, 0.4, 1.0), frame),
        _link("fork", 3.0, (0.02, 0.0, -0.1), _box_inertia(3.0, 0.1, 0.4, 0.6), fork),
        _wheel("rear_wheel", 1.5, r, "steel"),
        _wheel("front_wheel", 1.5, r, "steel"),
        _joint("steering_joint", "continuous", "frame", "fork", tuple(head), axis="0 0 1", pitch=-tilt, effort=30.0),
        _joint("rear_wheel_joint", "continuous", "frame", "rear_wheel", rear, effort=100.0),
        _joint("front_wheel_joint", "continuous", "fork", "front_wheel", tuple(hub), effort=100.0),
    ]
    entry = "  - {{name: {0}, kind: rolling_disk, frame: {0}, radius: {1}, axis: [0, 1, 0]}}\n"
    wheels = "".join(entry.format(f"{side}_wheel", r) for side in ("rear", "front"))
    passive = "passive: [steering_joint, front_wheel_joint]\n"
    return parts, f"root: free_flyer\n{passive}wheels:\n{wheels}postures:\n  upright: {{root_joint: [0, 0, 0, 0, 0, 0, 1]}}\n"


def rimless_wheel() -> list[str]:
    """McGeer's wheel without a rim, on two rows of eight feet, so that it does not fall over sideways."""
    leg, half = 1.0, 0.2
    shapes = _tube((0.0, -half, 0.0), (0.0, half, 0.0), 0.03, "grey") + _disc((0.0, 0.0, 0.0), 0.13, 0.16, "steel")
    for k in range(8):
        angle = math.pi / 8.0 + k * math.pi / 4.0
        end = leg * math.sin(angle), -leg * math.cos(angle)
        for y in (-half, half):
            shapes += _tube((0.0, y, 0.0), (end[0], y, end[1]), 0.018, "red" if k == 0 else "blue")
    return [
        "McGeer's rimless wheel: 1 kg in its hub, 0.01 kg m2 about its axis y, eight legs of 1 m without mass on either side,\n"
        "     0.4 m apart. Their feet are at angles of 22.5 deg + k 45 deg from -z, the first of them, red, ahead.",
        _link("wheel", 1.0, (0.0, 0.0, 0.0), (0.05, 0.01, 0.05), shapes),
    ]


def _box_inertia(m: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    return m / 12.0 * (y * y + z * z), m / 12.0 * (x * x + z * z), m / 12.0 * (x * x + y * y)


def _link(name: str, mass: float, com: Vector, moments: Vector, shapes: str) -> str:
    xx, yy, zz = (repr(float(x)) for x in moments)
    return (
        f'  <link name="{name}">\n    <inertial>\n      <origin xyz="{_numbers(com)}"/>\n      <mass value="{mass!r}"/>\n'
        f'      <inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>\n    </inertial>\n{shapes}  </link>\n'
    )


def _wheel(name: str, m: float, r: float, color: str) -> str:
    """A wheel about y whose mass is in its rim: m r^2 about the axis, half of it across."""
    shapes = _disc((0.0, 0.0, 0.0), r, 0.12 * r, "grey") + _disc((0.0, 0.0, 0.0), 0.86 * r, 0.13 * r, "steel")
    shapes += _disc((0.0, 0.0, 0.0), 0.2 * r, 0.3 * r, color)
    for z, of in ((0.5 * r, "orange"), (-0.5 * r, "grey")):
        shapes += _box((0.0, 0.0, z), (0.06 * r, 0.15 * r, 0.7 * r), of)
    shapes += _box((0.0, 0.0, 0.0), (1.7 * r, 0.15 * r, 0.06 * r), "grey")
    return _link(name, m, (0.0, 0.0, 0.0), (m * r * r / 2, m * r * r, m * r * r / 2), shapes)


def _joint(
    name: str, kind: str, parent: str, child: str, at: Vector, *, effort: float, axis: str = "0 1 0", pitch: float = 0.0
) -> str:
    return (
        f'  <joint name="{name}" type="{kind}">\n    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f'    <origin xyz="{_numbers(at)}" rpy="0 {pitch!r} 0"/>\n    <axis xyz="{axis}"/>\n'
        f'    <limit effort="{effort:g}" velocity="100"/>\n  </joint>\n'
    )


def _box(at: Vector, size: Vector, color: str | None) -> str:
    return _shape(at, "0 0 0", f'<box size="{_short(size)}"/>', color)


def _ball(at: Vector, r: float, color: str) -> str:
    return _shape(at, "0 0 0", f'<sphere radius="{r:g}"/>', color)


def _disc(at: Vector, r: float, width: float, color: str, rpy: str = "1.5707963268 0 0") -> str:
    return _shape(at, rpy, f'<cylinder radius="{r:.5g}" length="{width:.5g}"/>', color)


def _tube(start: Vector, end: Vector, r: float, color: str) -> str:
    """A round bar, in the x-z plane or across it."""
    p, q = np.array(start), np.array(end)
    along = q - p
    rpy = "1.5707963268 0 0" if abs(along[1]) > 1e-9 else f"0 {math.atan2(along[0], along[2]):.6f} 0"
    return _shape((p + q) / 2.0, rpy, f'<cylinder radius="{r:g}" length="{np.linalg.norm(along):.5g}"/>', color)


def _shape(at: Vector, rpy: str, geometry: str, color: str | None) -> str:
    tag, material = ("collision", "") if color is None else ("visual", f'<material name="{color}"/>')
    return f'    <{tag}><origin xyz="{_short(at)}" rpy="{rpy}"/><geometry>{geometry}</geometry>{material}</{tag}>\n'


def _numbers(values: Vector) -> str:
    return " ".join(repr(float(x) + 0.0) for x in values)


def _short(values: Vector) -> str:
    return " ".join(f"{float(x) + 0.0:.5g}" for x in values)


if __name__ == "__main__":
    main(HERE)
