"""A planar chain as a URDF file and as a robot for `rbd.solve` and `rbd.simulate`.

The chain's plane is put into the world W in one of two ways. Either way a joint's axis points at who looks at the plane, so
that angles are counter-clockwise as on paper:

    plane="xz"   upright: x to the right, y of the chain is z of W, up; seen from -y, joints turn about -y, as the linkages of
                 `rbd.mechanism` do. Gravity acts along -y of the chain.
    plane="xy"   flat on the ground: x and y are those of W, joints turn about z, and gravity is not felt.

The robot has links `base`, `link_1` .. `link_n`, joints `joint_1` .. `joint_n` with a motor each, and the frame `end` at the
end point. Its joints are revolute with limits far away, not continuous, so that its q are plain angles, measured from the
previous link in any convention of the chain: `robot_coordinates` converts between them.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from rbd.arrays import Array
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.errors.inputs import check_choice
from rbd.model.output_files import new_folder, write_text
from rbd.planar.angles import JOINT, AngleMap
from rbd.planar.bodies import Shapes, bodies_of, refuse_symbols
from rbd.planar.chain import Chain, check_chain
from rbd.planar.equations_of_motion import Dynamics
from rbd.robots import catalogue
from rbd.robots.building.builder import RobotBuilder
from rbd.robots.building.solids import Cylinder, Rod, Solid, Sphere
from rbd.robots.linkage import GRAVITY
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot

Plane = Literal["xz", "xy"]
END = "end"
"""The frame at the end point."""
FARTHEST_TURN = 1e4
"""Limits of the joints [rad]: 1,591 turns."""
_AXES = {"xz": (0.0, -1.0, 0.0), "xy": (0.0, 0.0, 1.0)}
_DISCS = {"xz": (math.pi / 2.0, 0.0, 0.0), "xy": (0.0, 0.0, 0.0)}  # turns a cylinder's axis z into the joint's
_LINKS = ("orange", "blue", "green", "red", "violet")


def robot_coordinates(chain: Chain) -> AngleMap:
    """The map from a chain's angles to those of its robot, which are measured from the previous link; its `inverse` leads back.

    It maps angles when called, rates and accelerations by `rates`, motor torques by `forces`.

    Raises:
        InputError: not a chain.

    Example:
        >>> to_robot = rbd.planar.robot_coordinates(rbd.planar.Chain(2, lengths=[1.0, 1.0], angles="vertical"))
        >>> to_robot([0.3, 0.5]).round(4), to_robot.rates([1.0, 1.0]), to_robot.forces([1.0, 1.0])
        (array([-1.2708,  0.2   ]), array([1., 0.]), array([2., 1.]))
        >>> to_robot.inverse([-np.pi / 2, 0.0])  # it hangs down
        array([0., 0.])
    """
    return check_chain(chain).angle_map(JOINT)


def to_urdf(
    chain: Chain,
    path: str | os.PathLike[str] | None = None,
    *,
    masses: Iterable[Any] | None = None,
    lengths: Iterable[Any] | None = None,
    centres: Iterable[Any] | None = None,
    inertias: Iterable[Any] | None = None,
    bodies: Shapes | None = None,
    plane: Plane = "xz",
    values: Mapping[Any, Any] | None = None,
    name: str = "chain",
) -> str:
    """The text of a URDF file of a chain, all its numbers with all digits.

    Links weigh m_i, at d_i along the link, with I_i across the plane; about their length they have the inertia of a thin
    cylinder, which no motion in the plane feels. They are drawn as rods, with a ball at the centre of mass.

    Args:
        chain: The chain.
        path: Where to write it too, a name that ends in .urdf; None for nowhere.
        masses: m_i [kg].
        lengths: ell_i [m], in place of the chain's own.
        centres: d_i [m].
        inertias: I_i about the centres of mass [kg m2].
        bodies: "points" or "rods", see `rbd.planar.dynamics`; rods where neither centres nor inertias are given.
        plane: "xz" (upright) or "xy" (flat on the ground).
        values: {symbol or its name: number} for symbols in the arguments.
        name: Of the robot: letters, digits, _ and -.

    Raises:
        InputError: symbols left, by their names; numbers that no body has; an unknown plane.
        ModelError: a file that cannot be written.

    Example:
        >>> text = rbd.planar.to_urdf(rbd.planar.Chain(2, lengths=[1.0, 1.0]), "arm.urdf", masses=[1.0, 1.0])
        >>> text.count("<joint"), rbd.load_robot("arm.urdf", root="fixed").nv
        (3, 2)
    """
    check_choice("plane", plane, _AXES)
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][\w-]{0,79}", name, re.ASCII):
        raise InputError(f"name is {name!r:.80}; expected letters, digits, _ and -, at most 80 of them.")
    if bodies is None and centres is None and inertias is None:
        bodies = "rods"
    known = bodies_of(chain, bodies=bodies, lengths=lengths, masses=masses, centres=centres, inertias=inertias).subs(values)
    refuse_symbols(known.unknowns, "a URDF file", how="values=")
    text = _urdf(name, plane, *known.numbers())
    if path is not None:
        _write(catalogue.file_path(path, "the path"), text)
    return text


def to_robot(
    chain: Chain | Dynamics,
    *,
    masses: Iterable[Any] | None = None,
    lengths: Iterable[Any] | None = None,
    centres: Iterable[Any] | None = None,
    inertias: Iterable[Any] | None = None,
    bodies: Shapes | None = None,
    plane: Plane | None = None,
    values: Mapping[Any, Any] | None = None,
    name: str = "chain",
) -> Robot:
    """A chain as a robot on a fixed base, for `rbd.solve` and `rbd.simulate`; arguments as `to_urdf`.

    Its file exists as long as the process runs: `robot.urdf`. Gravity acts along -z of W: that of the dynamics, else 9.81 m/s2.

    Args:
        chain: The chain; or its dynamics, which know the masses already, and the plane: flat where their gravity is zero.
        masses: As the others, for a chain alone.
        lengths: See `to_urdf`.
        centres: See `to_urdf`.
        inertias: See `to_urdf`.
        bodies: See `to_urdf`.
        plane: See `to_urdf`; None is "xz".
        values: {symbol or its name: number} for symbols that are left.
        name: Of the robot.

    Raises:
        InputError: as `to_urdf`; or masses given with dynamics.
        ModelError: a chain without inertia, whose M is singular.

    Example:
        >>> robot = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> print(robot, rbd.solve(robot.at([0.0, 0.0]), [0.0, 0.0]).a.round(3))
        Robot('chain', nq=2, nv=2, nu=2, mass=2.000 kg) [-12.613  16.817]
    """
    fall = None
    if isinstance(chain, Dynamics):
        given = (("masses", masses), ("lengths", lengths), ("centres", centres), ("inertias", inertias), ("bodies", bodies))
        own = ", ".join(what for what, value in (*given, ("plane", plane)) if value is not None)
        if own:
            raise InputError(f"{own} came with dynamics, which have their own; expected dynamics alone, or a chain.")
        dyn = chain if values is None else chain.subs(values)
        refuse_symbols(dyn.unknowns, "a robot", how="values=")
        chain, values, plane = dyn.chain, None, "xy" if dyn.gravity == 0 else "xz"
        fall = None if dyn.gravity == 0 else (0.0, 0.0, -float(dyn.gravity))
        masses, centres, inertias = dyn.bodies.masses, dyn.bodies.centres, dyn.bodies.inertias
    text = to_urdf(
        chain, masses=masses, lengths=lengths, centres=centres, inertias=inertias, bodies=bodies,
        plane="xz" if plane is None else plane, values=values, name=name,
    )  # fmt: skip
    file = new_folder() / f"{name}.urdf"
    _write(file, text)
    with warnings.catch_warnings():
        # Point masses were requested: no warning that they are unphysical.
        warnings.filterwarnings("ignore", ".*inertias? that no body has", ModelWarning)
        return load_robot(file, root="fixed", gravity=fall)


def _urdf(name: str, plane: str, lengths: Array, masses: Array, centres: Array, inertias: Array) -> str:
    r = 0.03 * float(lengths.mean())  # of the rods as drawn
    effort = 100.0 * GRAVITY * float(masses.sum()) * float(lengths.sum())  # far beyond the torques that hold it stretched out
    head = f"A planar chain of {len(lengths)} links in the {plane} plane of W, its base at the origin. Written by rbd.planar."
    out = RobotBuilder(name, root="fixed", about=head)
    out.body("base", Cylinder(2.0 * r, 1.6 * r, rpy=_DISCS[plane], color="grey", collides=False))
    parent, at = "base", (0.0, 0.0, 0.0)
    for i, (ell, m, d, inertia) in enumerate(zip(lengths, masses, centres, inertias, strict=True), start=1):
        # Not above I_i, so that the largest principal moment is never more than the sum of the others.
        along = min(m * r**2 / 2.0, inertia)
        drawn = _drawn(_LINKS[(i - 1) % len(_LINKS)], plane, ell, d, r)
        out.body(f"link_{i}", *drawn, mass=m, com=(d, 0.0, 0.0), inertia=(along, inertia, inertia))
        out.joint(
            f"joint_{i}", parent, f"link_{i}", at=at, axis=_AXES[plane], limits=(-FARTHEST_TURN, FARTHEST_TURN), motor=True,
            effort=float(f"{effort:.4g}") or None, speed=1000.0,
        )  # fmt: skip
        parent, at = f"link_{i}", (float(ell), 0.0, 0.0)
    out.frame(END, parent, at)
    return out.urdf()


def _drawn(color: str, plane: str, ell: float, d: float, r: float) -> Iterator[Solid]:
    """A link of a length, its centre of mass at d: a rod, its joint and a ball; a counterweight has a support."""
    yield _rod(0.0, ell, r, color)
    yield Cylinder(1.6 * r, 2.4 * r, rpy=_DISCS[plane], color="steel", collides=False)
    yield Sphere(1.8 * r, at=(d, 0.0, 0.0), color=color, collides=False)
    if not 0.0 <= d <= ell:
        yield _rod(min(0.0, d), max(0.0, d), r / 2.0, "grey")


def _rod(start: float, end: float, r: float, color: str) -> Solid:
    return Rod((start, 0.0, 0.0), (end, 0.0, 0.0), radius=r, color=color, collides=False)


def _write(path: Path, text: str) -> None:
    if path.suffix != ".urdf":
        raise InputError(f"the path is {str(path)!r:.200}; expected one that ends in .urdf.")
    write_text(path, text, ModelError)
