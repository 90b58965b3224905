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

from rbd.arrays import Array, check_whole
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.output_files import new_folder
from rbd.model.state import State
from rbd.model.urdf import FARTHEST, LIGHTEST
from rbd.robots.building.builder import GROUND, RobotBuilder
from rbd.robots.building.solids import Box, Cylinder, Rod, Solid
from rbd.robots.loading import load_robot
from rbd.robots.number_checks import COLORS, checked_mapping, checked_name, checked_number, checked_numbers
from rbd.robots.robot import Robot

Point = tuple[float, float]
GRAVITY = 9.81
"""Gravity of robots of `rbd` [m/s2], along -z of W."""
NORMAL = (0.0, -1.0, 0.0)  # of the plane: loops turn about what joints turn about


@dataclass(frozen=True)
class Link(Displayed):
    """A body of a flat linkage, its frame at its parent's pin or slide: thin uniform bars that connect its corners.

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
        shapes: Solids to draw or to touch with.
        width: Of a bar as drawn, over the linkage's.

    Raises:
        InputError: a number, name or colour that is wrong.

    Example:
        >>> rocker = rbd.mechanism.Link("rocker", "ground", at=(0.3, 0.0), points=((0.2, 0.0),), mass=0.5, tip=1)
        >>> rocker.name, rocker.points
        ('rocker', ((0.2, 0.0),))
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
    shapes: tuple[Solid, ...] = ()
    width: float = 1.0

    def __post_init__(self) -> None:
        what = f"link {checked_name('the name of a link', self.name)!r:.80}"
        checked_name(f"the parent of {what}", self.parent)
        put = object.__setattr__
        put(self, "at", checked_numbers(f"at of {what}", self.at, (2,), most=FARTHEST))
        if not isinstance(self.points, Sequence) or isinstance(self.points, str) or not len(self.points):
            raise InputError(f"points of {what} are {self.points!r:.80}; expected corners (x, z), ((0.2, 0.0),).")
        put(self, "points", tuple(checked_numbers(f"a point of {what}", p, (2,), most=FARTHEST) for p in self.points))
        checked_number(f"mass of {what}", self.mass, least=LIGHTEST)
        check_choice(f"color of {what}", self.color, COLORS)
        if self.tip is not None:
            check_whole(f"tip of {what}", self.tip, len(self.points), least=0)

    @property
    def bars(self) -> list[tuple[Array, Array]]:
        """(from, to) of each bar, in its axes, shape (3,)."""
        return list(itertools.pairwise(np.array([x, 0.0, z]) for x, z in ((0.0, 0.0), *self.points)))


@dataclass(frozen=True)
class Linkage(Displayed):
    """A flat linkage in the vertical x-z plane: links, loop closures and postures. `robot()` gives its robot, in memory.

    The limit of a motor is 10 g m l, to four digits [N m; of a slider N], with the mass m of all links and the longest distance
    l of a corner from the pin of its link.

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

    Raises:
        InputError: parts of the wrong kind, a radius that is not above zero.

    Example:
        >>> crank = rbd.mechanism.Link("crank", "ground", (0.0, 0.0), ((0.1, 0.0),), mass=0.1, motor=True)
        >>> arm = rbd.mechanism.Link("arm", "crank", (0.1, 0.0), ((0.2, 0.0),), mass=0.2, tip=1)
        >>> lever = rbd.mechanism.Link("lever", "ground", (0.25, 0.0), ((0.2, 0.0),), mass=0.2, tip=1)
        >>> ground, pin = ((0.0, 0.0), (0.25, 0.0)), {"pin": ("arm", "lever")}
        >>> linkage = rbd.mechanism.Linkage("my_four_bar", "A four-bar.", ground, (crank, arm, lever), pin, {}, radius=0.005)
        >>> print(linkage.robot(), linkage.robot().loops()[0].name)
        Robot('my_four_bar', nq=6, nv=3, nu=1, mass=0.500 kg) pin
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

    def __post_init__(self) -> None:
        what = f"linkage {checked_name('the name of a linkage', self.name)!r:.80}"
        put = object.__setattr__
        if not isinstance(self.links, Sequence) or not self.links or not all(isinstance(link, Link) for link in self.links):
            raise InputError(f"links of {what} are {self.links!r:.80}; expected some rbd.mechanism.Link(...).")
        if not isinstance(self.ground, Sequence) or not len(self.ground):
            raise InputError(f"ground of {what} is {self.ground!r:.80}; expected its pins (x, z), ((0.0, 0.0),).")
        put(self, "ground", tuple(checked_numbers(f"a pin of {what}", p, (2,), most=FARTHEST) for p in self.ground))
        checked_number(f"radius of {what}", self.radius, least=1e-9)
        tips = [link.name for link in self.links if link.tip is not None]
        for name, ends in checked_mapping(f"closures of {what}", self.closures).items():
            if not isinstance(ends, tuple | list) or len(ends) != 2:
                raise InputError(f"closure {name!r:.80} of {what} is {ends!r:.80}; expected two links.")
            for end in ends:
                check_choice(f"an end of closure {name!r:.80} of {what}, a link with a tip,", end, tips)
        for name, angles in checked_mapping(f"postures of {what}", self.postures).items():
            checked_mapping(f"posture {name!r:.80} of {what}", angles)
        if self.rail is not None:
            checked_numbers(f"rail of {what}", self.rail, (3,), most=FARTHEST)

    def builder(self) -> RobotBuilder:
        """Its parts as a builder, to which more can be added."""
        reach = max(math.hypot(*p) for link in self.links for p in link.points)
        effort = float(f"{10.0 * GRAVITY * sum(link.mass for link in self.links) * reach:.4g}")
        out = RobotBuilder(self.name, root="fixed", about=f"{self.about}\n     {self.origin}")
        out.body(GROUND, *self._ground())
        for link in self.links:
            lengths = [float(np.linalg.norm(b - a)) for a, b in link.bars]
            masses = [link.mass * (length / sum(lengths)) for length in lengths]
            along = zip(link.bars, masses, strict=True)
            bars = [Rod(a, b, mass=m, radius=self.radius, draws=False, collides=False) for (a, b), m in along]
            out.body(link.name, *bars, *self._drawn(link), *link.shapes)
            kind = "prismatic" if link.slides else "continuous" if link.limits is None else "revolute"
            out.joint(
                f"{link.name}_joint", link.parent, link.name, kind, at=(link.at[0], 0.0, link.at[1]), motor=link.motor,
                axis=(1.0, 0.0, 0.0) if link.slides else (0.0, -1.0, 0.0), limits=link.limits, effort=effort, speed=100.0,
            )  # fmt: skip
            if link.tip is not None:
                x, z = ((0.0, 0.0), *link.points)[link.tip]
                out.frame(_tip(link.name), link.name, (x, 0.0, z))
        for name, (one, other) in self.closures.items():
            out.loop(name, _tip(one), _tip(other), kind="planar", axis=NORMAL)
        for name, angles in self.postures.items():
            out.posture(name, {f"{link}_joint": x for link, x in angles.items()})
        return out

    def urdf(self) -> str:
        """The URDF file."""
        return self.builder().urdf()

    def robot(self) -> Robot:
        """The robot, in memory: no file is written.

        Raises:
            ModelError: as `RobotBuilder.robot`.
        """
        return self.builder().robot()

    def load(self, path: str | os.PathLike[str] | None) -> Robot:
        """The robot, from files written to the path, or to a folder of this process.

        Raises:
            InputError: a path that does not end in .urdf.
            ModelError: files that cannot be written.
        """
        return load_robot(self.builder().save(new_folder() / f"{self.name}.urdf" if path is None else path))

    def _ground(self) -> Iterator[Solid]:
        """The ground, as heavy as all links."""
        r = self.radius
        left, right = min(x for x, _ in self.ground), max(x for x, _ in self.ground)
        up = 1.0 if self.hangs else -1.0
        base = max(up * z for _, z in self.ground) * up + up * 4.0 * r
        middle = ((left + right) / 2.0, 0.0, base + up * 0.6 * r)
        mass = sum(link.mass for link in self.links)
        yield Box((right - left + 8 * r, 6 * r, 1.2 * r), mass=mass, at=middle, color="grey", collides=False)
        for x, z in self.ground:
            post = (1.6 * r, 1.2 * r, abs(z - base))
            yield Box(post, at=(x, 0.0, (z + base) / 2.0), color="grey", collides=False)
            yield _pin((x, 0.0, z), 0.8 * r, 2.0 * r, "steel")
        if self.rail is not None:
            start, end, z = self.rail
            yield Box((end - start, 0.8 * r, 0.8 * r), at=((start + end) / 2.0, 0.0, z), color="steel", collides=False)

    def _drawn(self, link: Link) -> Iterator[Solid]:
        """Its bars and pins as drawn."""
        before = np.array([0.0, -1.4 * self.radius * (link.layer + 1), 0.0])
        for a, b in link.bars:
            size = float(np.linalg.norm(b - a)), 1.2 * self.radius, 1.6 * link.width * self.radius
            rpy = (0.0, -math.atan2(b[2] - a[2], b[0] - a[0]), 0.0)
            yield Box(size, at=(a + b) / 2.0 + before, rpy=rpy, color=link.color, collides=False)
        for p in (np.zeros(3), *(b for _, b in link.bars)) if not link.slides else ():
            yield _pin(p + before, 1.1 * self.radius, 1.3 * self.radius, link.color)
            yield _pin(p + before, 0.5 * self.radius, 1.7 * self.radius, "steel")


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
    check_kind("the state of link_angles", state, State, "a State: robot.at(q)")
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


def with_link_angles(state: State, angles: Mapping[str, float]) -> State:
    """The same state with links of a mechanism in the x-z plane at other angles from the ground, as `link_angles` measures.

    Joints of other links keep their values, so that what hangs on a link turns with it. Loops are left as they are: see
    `rbd.mechanism.assemble`.

    Args:
        state: The mechanism; its velocity is unchanged.
        angles: {link: angle [rad]}, of links whose joints turn.

    Raises:
        InputError: an unknown link, one that its joint does not turn, two on one body at different angles, another plane.

    Example:
        >>> robot = rbd.mechanism.four_bar(40, 120, 80, 100)
        >>> posed = rbd.mechanism.with_link_angles(robot.at(), {"crank": 0.7, "coupler": 0.35})
        >>> {name: round(posed.joint(name).position, 4) for name in ("crank_joint", "coupler_joint")}
        {'crank_joint': 0.7, 'coupler_joint': -0.35}
    """
    wanted, at = checked_mapping("angles", angles), link_angles(state)
    for link in wanted:
        checked_number(f"angle of {check_choice('link', link, at)!r:.80}", wanted[link])
    for joint in state.robot.joints.values():
        for link in [link for link in wanted if state.robot.site(link)[0] == joint.id]:
            now = joint.coordinate(state.q) if joint.nv == 1 else 0.0
            turn = wrapped(wanted[link] - link_angles(state)[link])
            trial = link_angles(state.with_joints({joint.name: now + 0.5}))[link] if joint.nv == 1 else at[link]
            sign = round(2.0 * wrapped(trial - link_angles(state)[link]))
            if not sign:
                raise InputError(f"{link!r:.80} is not turned by its joint, {joint.name!r:.80}; expected a link on a hinge.")
            state = state.with_joints({joint.name: now + sign * turn})
    found = link_angles(state)
    if far := [link for link, angle in wanted.items() if abs(wrapped(found[link] - angle)) > 1e-9]:
        raise InputError(f"{far[0]!r:.80} stays at {found[far[0]]:.6g} rad: it is fixed to the ground or to another one named.")
    return state


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
    return [
        checked_number(f"{name} of {what}, in metres or kilograms,", value, least=1e-6, most=1e4)
        for name, value in given.items()
    ]


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


def _pin(at: Sequence[float] | Array, radius: float, length: float, color: str) -> Solid:
    return Cylinder(radius, length, at=at, rpy=(math.pi / 2.0, 0.0, 0.0), color=color, collides=False)
