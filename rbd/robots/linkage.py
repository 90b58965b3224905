"""Planar linkages as URDF files: bars in the vertical x-z plane, joined by pins, with loop files that close them.

The plane is that of x (right) and z (up), seen from -y; joints turn about -y, so that angles are counter-clockwise as drawn on
paper, and a link's x axis runs along its first bar. A bar is a thin uniform rod: m L^2 / 12 across it, and m r^2 / 2 about its
length, which does not affect planar motion. Bars are drawn side by side so that they can pass; their mass is at y = 0.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError, ModelError
from rbd.model.output_files import check_place, new_folder, write_text
from rbd.model.state import State
from rbd.robots import catalogue
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import ENDING
from rbd.robots.robot import Robot

Point = tuple[float, float]
GROUND = "ground"
GRAVITY = 9.81
"""Gravity of robots of `rbd` [m/s2], along -z of W."""
COLORS = {"grey": "0.35 0.37 0.40 1", "orange": "0.90 0.45 0.10 1", "blue": "0.16 0.42 0.66 1", "green": "0.24 0.58 0.36 1",
          "red": "0.75 0.22 0.20 1", "violet": "0.48 0.36 0.66 1", "steel": "0.75 0.77 0.80 1"}  # fmt: skip
NORMAL = "[0, -1, 0]"  # of the plane: loops turn about what joints turn about


@dataclass(frozen=True)
class Link:
    """A body of a flat linkage, its frame at its parent's pin or slide.

    Attributes:
        name: Its joint is called `<name>_joint`, a tip `<name>_tip`.
        parent: What it hangs from.
        at: Where, in the parent's axes (x, z) [m].
        points: Its corners in its axes (x, z) [m]; bars connect them in order, the first from its pin.
        mass: Of all its bars [kg]; spread evenly along them.
        color: One of `COLORS`.
        layer: How far before the plane it is drawn, in thicknesses.
        slides: Along the parent's x axis, in place of turning.
        motor: Whether its joint is driven.
        tip: The corner that a loop closes, by its number; None for none.
        limits: Of the joint [rad] or [m]; None for a continuous one.
        shapes: More to draw or to touch with, as elements of the URDF.
        width: Of a bar as drawn, over the linkage's.
    """

    name: str
    parent: str
    at: Point
    points: tuple[Point, ...]
    mass: float
    color: str = "blue"
    layer: int = 0
    slides: bool = False
    motor: bool = False
    tip: int | None = None
    limits: tuple[float, float] | None = None
    shapes: str = ""
    width: float = 1.0

    @property
    def bars(self) -> list[tuple[Array, Array]]:
        """(from, to) of each bar, in its axes, shape (3,)."""
        corners = [np.array([x, 0.0, z]) for x, z in ((0.0, 0.0), *self.points)]
        return list(itertools.pairwise(corners))

    def inertia(self, radius: float) -> tuple[Array, Array]:
        """(centre of mass (3,) [m], inertia about it (3, 3) [kg m2]) of its bars."""
        lengths = [float(np.linalg.norm(b - a)) for a, b in self.bars]
        masses = [self.mass * length / sum(lengths) for length in lengths]
        middles = [(a + b) / 2.0 for a, b in self.bars]
        com = np.sum([m * p for m, p in zip(masses, middles, strict=True)], axis=0) / self.mass
        total = np.zeros((3, 3))
        for (a, b), m, length, p in zip(self.bars, masses, lengths, middles, strict=True):
            along, r = np.outer(b - a, b - a) / length**2, p - com
            total += m * length**2 / 12.0 * (np.eye(3) - along) + m * radius**2 / 2.0 * along
            total += m * (float(r @ r) * np.eye(3) - np.outer(r, r))
        return com, total


@dataclass(frozen=True)
class Linkage:
    """A flat linkage: links, loop closures, and a posture.

    Attributes:
        name: Of the robot.
        about: What it is, a line or two for the head of the file.
        ground: Pins of the ground (x, z) [m], from left to right.
        links: In the order of the tree.
        closures: {name: (link, other link)} whose tips meet.
        postures: {name: {link: angle [rad] or displacement [m]}}.
        radius: Of a bar [m]: half its width as drawn.
        origin: Source of the file, and its licence.
        hangs: Whether the ground is drawn above its pins, or below.
        rail: (from, to, height) of a rail of the ground, along x [m].
    """

    name: str
    about: str
    ground: tuple[Point, ...]
    links: tuple[Link, ...]
    closures: Mapping[str, tuple[str, str]]
    postures: Mapping[str, Mapping[str, float]]
    radius: float
    origin: str = "Origin: written by rbd.mechanism. Licence: BSD-2-Clause, as the project."
    hangs: bool = False
    rail: tuple[float, float, float] | None = None

    def urdf(self) -> str:
        """The URDF file."""
        reach = max(math.hypot(*p) for link in self.links for p in link.points)
        effort = 10.0 * GRAVITY * sum(link.mass for link in self.links) * reach
        head = [f'<?xml version="1.0"?>\n<!-- {self.about}\n     {self.origin} -->\n<robot name="{self.name}">\n']
        head += [f'  <material name="{name}"><color rgba="{rgba}"/></material>\n' for name, rgba in COLORS.items()]
        return "".join([*head, *self._ground(), *(self._link(link, effort) for link in self.links), "</robot>\n"])

    def yaml(self) -> str:
        """Its loop file."""
        lines = [f"# Closes {self.name}.urdf. {self.origin}", "root: fixed"]
        lines += [f"passive: [{', '.join(self._passive())}]", "loops:"]
        for name, (one, other) in self.closures.items():
            frames = f"frame_a: {_tip(one)}, frame_b: {_tip(other)}"
            lines.append(f"  - {{name: {name}, kind: planar, {frames}, axis: {NORMAL}}}")
        lines.append("postures:")
        for name, angles in self.postures.items():
            joints = ", ".join(f"{link}_joint: {float(x)!r}" for link, x in angles.items())
            lines.append(f"  {name}: {{{joints}}}")
        return "\n".join(lines) + "\n"

    def load(self, path: str | os.PathLike[str] | None) -> Robot:
        """The robot, from files written to the path, or to a folder of this process.

        Raises:
            InputError: a path that does not end in .urdf.
            ModelError: files that cannot be written.
        """
        urdf = new_folder() / f"{self.name}.urdf" if path is None else catalogue.file_path(path, "the path")
        if urdf.suffix != ".urdf":
            raise InputError(f"the path is {str(path)!r:.200}; expected one that ends in .urdf, the loop file goes beside it.")
        loops = urdf.with_suffix(ENDING)
        for place in (urdf, loops):
            check_place(place, ModelError)
        write_text(urdf, self.urdf(), ModelError)
        write_text(loops, self.yaml(), ModelError)
        return load_robot(urdf)

    def _passive(self) -> Iterator[str]:
        return (f"{link.name}_joint" for link in self.links if not link.motor)

    def _ground(self) -> Iterator[str]:
        r = self.radius
        left, right = min(x for x, _ in self.ground), max(x for x, _ in self.ground)
        up = 1.0 if self.hangs else -1.0
        base = max(up * z for _, z in self.ground) * up + up * 4.0 * r
        box = (right - left + 8 * r, 6 * r, 1.2 * r)
        mass = sum(link.mass for link in self.links)
        sizes = np.array(box) ** 2
        com = np.array([(left + right) / 2.0, 0.0, base + up * box[2] / 2.0])
        yield f'  <link name="{GROUND}">\n{_inertial(mass, com, mass / 12.0 * np.diag(sizes.sum() - sizes))}'
        yield _shape(com, f'<box size="{_short(box)}"/>', "grey")
        for x, z in self.ground:
            size = _short((1.6 * r, 1.2 * r, abs(z - base)))
            yield _shape(np.array([x, 0.0, (z + base) / 2.0]), f'<box size="{size}"/>', "grey")
            yield _disc(np.array([x, 0.0, z]), 0.8 * r, 2.0 * r, "steel")
        if self.rail is not None:
            start, end, z = self.rail
            at = np.array([(start + end) / 2.0, 0.0, z])
            yield _shape(at, f'<box size="{_short((end - start, 0.8 * r, 0.8 * r))}"/>', "steel")
        yield "  </link>\n"

    def _link(self, link: Link, effort: float) -> str:
        com, inertia = link.inertia(self.radius)
        y = -1.4 * self.radius * (link.layer + 1)
        out = [f'  <link name="{link.name}">\n', _inertial(link.mass, com, inertia)]
        for a, b in link.bars:
            length, pitch = float(np.linalg.norm(b - a)), -math.atan2(b[2] - a[2], b[0] - a[0])
            size = _short((length, 1.2 * self.radius, 1.6 * link.width * self.radius))
            out.append(_shape((a + b) / 2.0 + [0.0, y, 0.0], f'<box size="{size}"/>', link.color, f"0 {pitch + 0.0:.12g} 0"))
        corners = [np.zeros(3), *(b for _, b in link.bars)]
        for p in corners if not link.slides else ():
            out.append(_disc(p + [0.0, y, 0.0], 1.1 * self.radius, 1.3 * self.radius, link.color))
            out.append(_disc(p + [0.0, y, 0.0], 0.5 * self.radius, 1.7 * self.radius, "steel"))
        out += [link.shapes, "  </link>\n"]
        out.append(self._joint(link, effort))
        if link.tip is not None:
            out.append(_frame(f"{link.name}_tip", link.name, ((0.0, 0.0), *link.points)[link.tip]))
        return "".join(out)

    def _joint(self, link: Link, effort: float) -> str:
        kind = "prismatic" if link.slides else "continuous" if link.limits is None else "revolute"
        low, high = (-1e3, 1e3) if link.slides and link.limits is None else link.limits or (0.0, 0.0)
        bounds = "" if kind == "continuous" else f'lower="{low!r}" upper="{high!r}" '
        x, z = link.at
        return (
            f'  <joint name="{link.name}_joint" type="{kind}">\n    <parent link="{link.parent}"/>\n'
            f'    <child link="{link.name}"/>\n    <origin xyz="{x!r} 0 {z!r}"/>\n'
            f'    <axis xyz="{"1 0 0" if link.slides else "0 -1 0"}"/>\n'
            f'    <limit {bounds}effort="{effort:.4g}" velocity="100"/>\n  </joint>\n'
        )


def link_angles(state: State) -> dict[str, float]:
    """{link: angle of its x axis from the world's [rad], in (-pi, pi]}, of a mechanism in the x-z plane.

    Counter-clockwise as seen from -y, with x to the right and z up: the angles of the texts. Joint angles are relative: that of
    a coupler is its link's angle less the crank's.

    Args:
        state: The mechanism, in the x-z plane.

    Raises:
        InputError: a link whose y axis is not the world's: the mechanism moves in another plane.

    Example:
        >>> robot = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40))
        >>> {link: round(angle, 4) for link, angle in rbd.mechanism.link_angles(robot.at("assembled")).items()}
        {'ground': 0.0, 'crank': 0.6981, 'coupler': 0.3543, 'coupler_tip': 0.3543, 'rocker': 1.0005, 'rocker_tip': 1.0005}
    """
    if not isinstance(state, State):
        raise InputError(f"link_angles wants a State, got {type(state).__name__}. Make one: robot.at(q).")
    out, names = {}, state.robot.links()
    sites = [state.robot.site(name) for name in names]  # not by `frame`, whose Jacobians take longer than all the rest
    turned, _ = state.joint_places([joint for joint, _ in sites])
    for name, (_, X_JL), R_WJ in zip(names, sites, turned, strict=True):
        R = R_WJ @ X_JL.rotation
        if abs(R[1, 1] - 1.0) > 1e-9:
            raise InputError(
                f"link {name!r:.80} of {state.robot.name} is turned out of the x-z plane; link_angles is for flat mechanisms."
            )
        out[name] = math.atan2(R[2, 0], R[0, 0])
    return out


def meeting(p: Point, b: float, o: Point, c: float, side: float) -> tuple[float, float]:
    """Angles of a bar b from p and a bar c from o whose ends meet.

    Args:
        p: Where the first starts (x, z) [m].
        b: Its length [m].
        o: Where the other starts.
        c: Its length.
        side: 1.0 for an end on the left as one goes from o to p, -1.0 for one on the right.

    Raises:
        InputError: they do not reach each other, or start at one point; the message states the gap.
    """
    x, z = p[0] - o[0], p[1] - o[1]
    r = math.hypot(x, z)
    gap = max(r - (b + c), abs(b - c) - r)
    if gap > 1e-12 * (b + c):
        raise InputError(f"bars of {b:g} and {c:g} m do not meet from points {r:.6g} m apart: {gap:.6g} m are missing.")
    if r < 1e-12 * (b + c):
        raise InputError(f"bars of {b:g} and {c:g} m start at one point: where they meet is not determined. Turn the crank.")
    at_o = math.acos(min(1.0, max(-1.0, (c * c + r * r - b * b) / (2.0 * c * r))))
    turned = math.atan2(z, x) - side * at_o
    end = o[0] + c * math.cos(turned), o[1] + c * math.sin(turned)
    return math.atan2(end[1] - p[1], end[0] - p[0]), wrapped(turned)


def wrapped(angle: float) -> float:
    """The angle in [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)


def lengths(what: str, **given: object) -> list[float]:
    """Refuse invalid lengths, masses and other numbers.

    Raises:
        InputError: one that is not a finite number above zero.
    """
    out = []
    for name, value in given.items():
        number = as_float(value)
        if not 1e-6 <= number <= 1e4:
            raise InputError(f"{name} of {what} is {value!r:.80}; expected a number from 1e-6 to 1e4, in metres or kilograms.")
        out.append(number)
    return out


def radius(*sizes: float) -> float:
    """Width of the drawn bars: 3 % of their mean length [m]."""
    return 0.03 * sum(sizes) / len(sizes)


def bar_masses(what: str, sizes: Mapping[str, float], masses: Sequence[float] | None, mass_per_length: float) -> list[float]:
    """Masses of the bars: those given, else their lengths times `mass_per_length` [kg/m].

    Raises:
        InputError: masses that are not as many numbers above zero.
    """
    (density,) = lengths(what, mass_per_length=mass_per_length)
    if masses is None:
        return [density * length for length in sizes.values()]
    if isinstance(masses, str) or not np.iterable(masses) or len(given := list(masses)) != len(sizes):
        raise InputError(f"masses of {what} is {masses!r:.80}; expected {len(sizes)} numbers [kg]: {', '.join(sizes)}.")
    return lengths(what, **{f"mass of the {name}": mass for name, mass in zip(sizes, given, strict=True)})


def _tip(end: str) -> str:
    return f"{end}_tip"


def _inertial(mass: float, com: Array, inertia: Array) -> str:
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    entries = " ".join(f'{name}="{float(inertia[at])!r}"' for name, at in names.items())
    return (
        f'    <inertial>\n      <origin xyz="{_spaced(com)}"/>\n      <mass value="{float(mass)!r}"/>\n'
        f"      <inertia {entries}/>\n    </inertial>\n"
    )


def _shape(p: Array, geometry: str, color: str, rpy: str = "0 0 0") -> str:
    origin = f'<origin xyz="{_short(p)}" rpy="{rpy}"/>'
    return f'    <visual>{origin}<geometry>{geometry}</geometry><material name="{color}"/></visual>\n'


def _disc(p: Array, radius: float, length: float, color: str) -> str:
    return _shape(p, f'<cylinder radius="{radius:.6g}" length="{length:.6g}"/>', color, f"{math.pi / 2:.12g} 0 0")


def _frame(name: str, link: str, at: Point) -> str:
    x, z = at
    return (
        f'  <link name="{name}"/>\n  <joint name="{name}_joint" type="fixed"><parent link="{link}"/><child link="{name}"/>'
        f'<origin xyz="{x!r} 0 {z!r}"/></joint>\n'
    )


def _short(values: Sequence[float] | Array) -> str:
    """For shapes, which do not enter the dynamics."""
    return " ".join(f"{float(x) + 0.0:.5g}" for x in values)


def _spaced(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(x) + 0.0) for x in values)
