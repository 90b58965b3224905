"""Four-bars and slider-cranks of any lengths, and rows of four-bars, as robots."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from rbd.arrays import check_whole
from rbd.errors import InputError
from rbd.robots.linkage import Link, Linkage, bar_masses, lengths, meeting, radius, wrapped
from rbd.robots.number_checks import checked_number
from rbd.robots.robot import Robot

MOST = 99
"""Largest N of an N-four-bar: it has 2 N + 1 degrees of freedom before its loops are closed, and 200 are accepted."""


def four_bar(
    a: float,
    b: float,
    c: float,
    d: float,
    *,
    crank_angle: float | None = None,
    masses: Sequence[float] | None = None,
    mass_per_length: float = 1.0,
    path: str | os.PathLike[str] | None = None,
) -> Robot:
    """A planar four-bar linkage of these lengths: crank a, coupler b, rocker c, ground d [m], in Norton's order.

    In the vertical x-z plane, seen from -y, angles counter-clockwise from the ground link, which is along x::

        crank     from O2 = (0, 0), driven        angle th2 = q of `crank_joint`
        coupler   from the crank's tip            angle th3 = q of `crank_joint` + q of `coupler_joint`
        rocker    from O4 = (d, 0)                angle th4 = q of `rocker_joint`

    closed by `coupler_pin`, the two rows (x, z) of a planar `rbd.LoopClosure` between the coupler's tip and the rocker's:
    a e^(i th2) + b e^(i th3) = d + c e^(i th4). Joints are continuous: each is (cos, sin) in q. `link_angles` gives th2, th3,
    th4. Bars are thin uniform rods. The limits of the crank's motor are 10 g m l [N m], to four digits, with the mass m of
    all bars and the longest l of a, b, c, and 100 rad/s; the coupler's and the rocker's joints have no motor.

    Postures are `assembled`, the open branch, and `crossed`, the other one (coupler and rocker on the other side of the line
    from the crank's tip to O4).

    Args:
        a: Length of the crank.
        b: Of the coupler.
        c: Of the rocker.
        d: Of the ground, between the fixed pivots.
        crank_angle: th2 of the postures [rad]; by default where the loop is far from stretched and from folded.
        masses: Of crank, coupler and rocker [kg].
        mass_per_length: Where no masses are given [kg/m].
        path: Where to write the URDF, its loop file next to it; by default to temporary files of the process.

    Raises:
        InputError: a length that is no number above zero, lengths that cannot close, or not at this crank angle; the
            message states what is missing.
        ModelError: files that cannot be written.

    Example:
        >>> robot = rbd.mechanism.four_bar(40, 120, 80, 100, crank_angle=np.radians(40))
        >>> angles = rbd.mechanism.link_angles(robot.at("assembled"))
        >>> [round(float(np.degrees(angles[link])), 3) for link in ("coupler", "rocker")]
        [20.298, 57.325]
        >>> rbd.mechanism.four_bar(0.1, 0.3, 0.2, 0.25).joints["crank_joint"].effort  # 10 x 9.81 m/s2 x 0.6 kg x 0.3 m
        17.66
    """
    a, b, c, d = lengths("the four-bar", a=a, b=b, c=c, d=d)
    if missing := too_long(a=a, b=b, c=c, d=d):
        raise InputError(missing)
    kg = bar_masses("the four-bar", {"crank": a, "coupler": b, "rocker": c}, masses, mass_per_length)
    th2 = _four_bar_angle(a, b, c, d) if crank_angle is None else checked_number("crank_angle [rad]", crank_angle, most=1e6)
    postures = {}
    for name, side in (("assembled", 1.0), ("crossed", -1.0)):
        th3, th4 = meeting((a * math.cos(th2), a * math.sin(th2)), b, (d, 0.0), c, side)
        postures[name] = {"crank": th2, "coupler": wrapped(th3 - th2), "rocker": th4}
    links = (
        Link("crank", "ground", (0.0, 0.0), ((a, 0.0),), kg[0], "orange", 0, motor=True),
        Link("coupler", "crank", (a, 0.0), ((b, 0.0),), kg[1], "blue", 1, tip=1),
        Link("rocker", "ground", (d, 0.0), ((c, 0.0),), kg[2], "green", 0, tip=1),
    )
    about = f"A four-bar: crank {a:g}, coupler {b:g}, rocker {c:g}, ground {d:g} m. Thin uniform bars in the x-z plane."
    closures = {"coupler_pin": ("coupler", "rocker")}
    return Linkage("four_bar", about, ((0.0, 0.0), (d, 0.0)), links, closures, postures, radius(a, b, c, d)).load(path)


def n_four_bar(n: int, *, length: float = 1.0, mass: float = 1.0, path: str | os.PathLike[str] | None = None) -> Robot:
    """N square four-bars in a row: N + 1 cranks on the ground, their tips joined by N couplers, all bars uniform and equal.

    The benchmark A02 of IFToMM's library [Gonzalez2006] for length 1 m and mass 1 kg. All cranks are at the angle phi of
    `crank_0`, in the plane and with the signs of `four_bar`, and with one degree of freedom::

        m L^2 [(N + 1) / 3 + N] phi'' = -m g L [(N + 1) / 2 + N] cos phi

    Lying flat, phi = 0 or pi, it could leave this motion: J loses N ranks there. `coupler_i` hangs on `crank_(i-1)` and is
    closed with `crank_i`. Posture: `assembled`, cranks upright.

    Args:
        n: How many, from 1.
        length: Of every bar [m].
        mass: Of every bar [kg].
        path: As in `four_bar`.

    Raises:
        InputError: n that is no whole number from 1 to 99, a length or mass that is not above zero.

    Example:
        >>> robot = rbd.mechanism.n_four_bar(3)
        >>> print(robot, [loop.name for loop in robot.loops()])
        Robot('n_four_bar_3', nq=14, nv=7, nu=1, mass=7.000 kg) ['pin_1', 'pin_2', 'pin_3']
        >>> rbd.mechanism.mobility(robot.at("assembled")).finite
        1
    """
    check_whole("n", n, MOST)
    L, m = lengths("the N-four-bar", length=length, mass=mass)
    ground = tuple((i * L, 0.0) for i in range(n + 1))
    cranks = [
        Link(f"crank_{i}", "ground", at, ((L, 0.0),), m, "orange" if i == 0 else "green", 0, motor=i == 0, tip=1 if i else None)
        for i, at in enumerate(ground)
    ]
    couplers = [
        Link(f"coupler_{i}", f"crank_{i - 1}", (L, 0.0), ((L, 0.0),), m, "blue", 1 + i % 2, tip=1) for i in range(1, n + 1)
    ]
    closures = {f"pin_{i}": (f"coupler_{i}", f"crank_{i}") for i in range(1, n + 1)}
    upright = {link.name: math.pi / 2 for link in cranks} | {link.name: -math.pi / 2 for link in couplers}
    about = f"{n} four-bars in a row, {2 * n + 1} thin uniform bars of {L:g} m and {m:g} kg in the x-z plane."
    links = (*cranks, *couplers)
    return Linkage(f"n_four_bar_{n}", about, ground, links, closures, {"assembled": upright}, radius(L)).load(path)


def too_long(**sides: float) -> str:
    """Why bars of these lengths make no polygon: the longest is longer than all others together; empty if it is not."""
    longest = max(sides, key=sides.__getitem__)
    missing = 2.0 * sides[longest] - sum(sides.values())
    if missing <= 0.0:
        return ""
    bars = ", ".join(f"{name} {length:g}" for name, length in sides.items())
    return f"bars of {bars} m cannot close: {longest} is {missing:.6g} m longer than the others together."


def _four_bar_angle(a: float, b: float, c: float, d: float) -> float:
    """Where the crank's tip is halfway between the nearest and the farthest from O4 that coupler and rocker reach."""
    near, far = max(abs(b - c), abs(a - d)), min(b + c, a + d)
    return math.acos(min(1.0, max(-1.0, (a * a + d * d - (near + far) ** 2 / 4.0) / (2.0 * a * d))))


def slider_crank(
    crank: float,
    rod: float,
    *,
    offset: float = 0.0,
    crank_angle: float | None = None,
    masses: Sequence[float] | None = None,
    mass_per_length: float = 1.0,
    path: str | os.PathLike[str] | None = None,
) -> Robot:
    """A planar slider-crank: a crank, a connecting rod, and a slider that the rod pushes along x.

    In the vertical x-z plane with the signs of `four_bar`; the crank turns about the origin and is driven::

        crank     angle th = q of `crank_joint`
        rod       from the crank's tip; angle = q of `crank_joint` + q of `rod_joint`
        slider    at x = q of `slider_joint`, z = offset

    closed by `wrist_pin`, two rows: crank e^(i th) + rod e^(i phi) = x + i offset. The slider's friction is left out. The
    crank turns round where `crank + |offset| <= rod`.

    Postures are `assembled`, the slider to the right of the crank's tip, and `crossed`, to its left.

    Args:
        crank: Length of the crank [m].
        rod: Of the connecting rod [m].
        offset: Height of the slider's line above the crank's pivot [m].
        crank_angle: th of the postures [rad]; by default 45 deg, where the loop closes there.
        masses: Of crank, rod and slider [kg]; by default bars by their lengths, and a slider as heavy as the crank.
        mass_per_length: Where no masses are given [kg/m].
        path: As in `four_bar`.

    Raises:
        InputError: lengths that are no numbers above zero, or cannot close, or not at this crank angle.
        ModelError: files that cannot be written.

    Example:
        >>> robot = rbd.mechanism.slider_crank(1.0, 2.0, crank_angle=np.pi / 2)
        >>> round(float(robot.posture("assembled")[-1]), 6)  # sqrt(3)
        1.732051
    """
    crank, rod = lengths("the slider-crank", crank=crank, rod=rod)
    height = checked_number("offset of the slider-crank", offset, most=1e4)
    if abs(height) > crank + rod:
        raise InputError(
            f"a crank of {crank:g} and a rod of {rod:g} m cannot close: the slider's line is {abs(height):g} m away, "
            f"{abs(height) - crank - rod:.6g} m more than both together."
        )
    kg = bar_masses("the slider-crank", {"crank": crank, "rod": rod, "slider": crank}, masses, mass_per_length)
    default = _slider_crank_angle(crank, rod, height)
    th = default if crank_angle is None else checked_number("crank_angle [rad]", crank_angle, most=1e6)
    x, z = crank * math.cos(th), crank * math.sin(th)
    if abs(height - z) > rod * (1.0 + 1e-12):
        raise InputError(
            f"at crank_angle {th:g} the crank's tip is {abs(height - z):g} m from the slider's line, and the rod is {rod:g} m "
            f"long: {abs(height - z) - rod:.6g} m are missing."
        )
    along = math.sqrt(max(0.0, rod**2 - (height - z) ** 2))
    postures = {
        name: {"crank": th, "rod": wrapped(math.atan2(height - z, side * along) - th), "slider": x + side * along}
        for name, side in (("assembled", 1.0), ("crossed", -1.0))
    }
    r = radius(crank, rod)
    block = ((3.0 * r, 0.0), (-3.0 * r, 0.0), (0.0, 0.0))
    links = (
        Link("crank", "ground", (0.0, 0.0), ((crank, 0.0),), kg[0], "orange", 0, motor=True),
        Link("rod", "crank", (crank, 0.0), ((rod, 0.0),), kg[1], "blue", 1, tip=1),
        Link("slider", "ground", (0.0, height), block, kg[2], "green", 0, slides=True, tip=0, width=2.5),
    )
    about = f"A slider-crank: crank {crank:g}, rod {rod:g}, offset {height:g} m. Thin uniform bars in the x-z plane."
    reach = crank + rod + 6.0 * r
    rail = (rod - crank - 6.0 * r if rod > crank else -reach, reach, height)
    return Linkage("slider_crank", about, ((0.0, 0.0),), links, {"wrist_pin": ("rod", "slider")}, postures, r, rail=rail).load(
        path
    )


def _slider_crank_angle(crank: float, rod: float, offset: float) -> float:
    """45 deg if the rod then reaches the slider's line with a margin, else the angle with the tip nearest to it."""
    if abs(offset - crank * math.sin(math.pi / 4)) < 0.95 * rod:
        return math.pi / 4
    return math.asin(min(1.0, max(-1.0, offset / crank)))
