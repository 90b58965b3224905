"""Slider-cranks of any lengths, as robots."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from rbd.arrays import as_float
from rbd.errors import InputError
from rbd.robots.linkage import Link, Linkage, bar_masses, lengths, radius, wrapped
from rbd.robots.robot import Robot


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

    In the vertical x-z plane with the signs of `four_bar`; the crank turns about the origin and is driven:

        crank     angle th = q of `crank_joint`
        rod       from the crank's tip; angle = q of `crank_joint` + q of `rod_joint`
        slider    at x = q of `slider_joint`, z = offset

    closed by `wrist_pin`, two rows: crank e^(i th) + rod e^(i phi) = x + i offset. The slider's friction is left out. The
    crank turns round where crank + |offset| <= rod.

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

    >>> robot = slider_crank(1.0, 2.0, crank_angle=math.pi / 2)
    >>> round(float(robot.posture("assembled")[-1]), 6)  # sqrt(3)
    1.732051
    """
    crank, rod = lengths("the slider-crank", crank=crank, rod=rod)
    height = as_float(offset)
    if not abs(height) <= 1e4:
        raise InputError(f"offset of the slider-crank is {offset!r:.80}; expected a length [m], at most 1e4.")
    if abs(height) > crank + rod:
        raise InputError(
            f"a crank of {crank:g} and a rod of {rod:g} m cannot close: the slider's line is {abs(height):g} m away, "
            f"{abs(height) - crank - rod:.6g} m more than both together."
        )
    sizes = {"crank": crank, "rod": rod, "slider": crank}
    kg = bar_masses("the slider-crank", sizes, masses, mass_per_length)
    th = _crank_angle(crank, rod, height) if crank_angle is None else as_float(crank_angle)
    if not abs(th) < 1e6:
        raise InputError(f"crank_angle is {crank_angle!r:.80}; expected an angle [rad].")
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


def _crank_angle(crank: float, rod: float, offset: float) -> float:
    """45 deg where the rod then reaches the slider's line with something to spare, else where the tip is nearest to it."""
    if abs(offset - crank * math.sin(math.pi / 4)) < 0.95 * rod:
        return math.pi / 4
    return math.asin(min(1.0, max(-1.0, offset / crank)))
