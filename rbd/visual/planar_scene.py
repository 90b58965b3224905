"""A planar motion in Meshcat: one page that plays anywhere, or live in the browser."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, ModelWarning
from rbd.robots.robot import Robot, load_robot
from rbd.visual.animation import export_motion, replay
from rbd.visual.animation_frames import checked
from rbd.visual.planar_plots import PATH_COLOR, check_motion

if TYPE_CHECKING:
    from rbd.planar.motion import PlanarMotion

SEEN_FROM = (0.12, -1.0, 0.18)
"""From before the plane, so that x runs to the right, a little aside and above."""
BEADS = 60
"""Pieces of the path at most."""


@dataclass(frozen=True, eq=False)
class _Played:
    """What the pages of `rbd.visual.animation` want of a motion; nothing touches, so there are no forces."""

    robot: Robot
    t: Array
    q: Array
    v: Array
    points: Mapping[str, Array] = field(default_factory=dict)
    point_forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, Array] = field(default_factory=dict)
    events: tuple[Any, ...] = ()


def export_planar(
    motion: PlanarMotion, path: str | PathLike[str], *, title: str | None = None, speed: float = 0.5, start: float | None = None
) -> Path:
    """Write a planar motion as one HTML page that needs no network; returns its path.

    The chain stands upright in W, its x to the right and its y up, with the path of the end point behind it. It is seen from
    the front, and can be turned.

    Args:
        motion: What `endpoint_motion` or `joint_motion` returned, two samples at least.
        path: Of the page, ends in .html.
        title: Headline; what moves, by default.
        speed: Seconds of motion a second at first; the page can change it.
        start: Time at which the page opens [s]; the first by default.

    Raises:
        InputError: no motion, or settings that mean nothing.
        PictureError: the file cannot be written.
    """
    check_motion(motion)
    told = title if title is not None else f"{motion.chain.n} link{'s' * (motion.chain.n > 1)}, minimum jerk"
    with _played(motion) as played:
        return export_motion(
            played, path, title=told, speed=speed, start=start, follow=False, trace=False, ground=False, seen_from=SEEN_FROM
        )  # fmt: skip


def replay_planar(motion: PlanarMotion, *, speed: float = 0.5) -> None:
    """Show a planar motion live in the browser, paced by the clock; returns when it is over.

    Args:
        motion: What `endpoint_motion` or `joint_motion` returned, two samples at least.
        speed: Seconds of motion a second.

    Raises:
        InputError: no motion, or a speed that means nothing.
    """
    check_motion(motion)
    with _played(motion) as played:
        replay(played, speed=speed)


@contextmanager
def _played(motion: PlanarMotion) -> Iterator[Any]:
    """The motion of a robot that looks like the chain, its file kept as long as it is shown."""
    from rbd.planar.urdf import robot_coordinates, to_urdf

    if len(motion) < 2:
        raise InputError("the motion has one sample only; expected two at least.")
    chain = motion.chain
    text = _drawn(to_urdf(chain, masses=[1.0] * chain.n, plane="xz"), motion)
    coordinates = robot_coordinates(chain)
    with tempfile.TemporaryDirectory(prefix="rbd-planar-") as folder:
        file = Path(folder) / "chain.urdf"
        file.write_text(text, encoding="utf-8")
        with warnings.catch_warnings():
            # It has no mass on purpose: then no centre of mass is drawn, of masses that nobody gave.
            warnings.simplefilter("ignore", ModelWarning)
            robot = load_robot(file, root="fixed")
        played = _Played(robot, motion.t, coordinates.to_robot(motion.q), coordinates.rates_to_robot(motion.qd))
        checked(played)
        yield played


def _drawn(text: str, motion: PlanarMotion) -> str:
    """The chain's URDF without masses and their balls, with a ball at the end point and the path behind."""
    root = ElementTree.fromstring(text)
    size = sum(float(length) for length in motion.chain.lengths)
    red, green, blue = (int(PATH_COLOR[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    material = ElementTree.SubElement(root, "material", name="path")
    ElementTree.SubElement(material, "color", rgba=f"{red:.3f} {green:.3f} {blue:.3f} 1")
    links = {link.get("name"): link for link in root.iter("link")}
    for link in links.values():
        for mass in link.iter("mass"):
            mass.set("value", "0")
        for visual in link.findall("visual"):
            if visual.find("geometry/sphere") is not None:
                link.remove(visual)
    last = float(motion.chain.lengths[-1])
    _visual(links[f"link_{motion.chain.n}"], (last, 0.0, 0.0), (0.0, 0.0, 0.0), "sphere", radius=0.022 * size)
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(motion.x, axis=0).T))])
    beads = np.linspace(0.0, far[-1], BEADS + 1)
    points = np.column_stack([np.interp(beads, far, column) for column in motion.x.T]) if far[-1] > 0.0 else motion.x[:1]
    for a, b in zip(points[:-1], points[1:], strict=True):
        along, middle = b - a, 0.5 * (a + b)
        length = float(np.hypot(*along))
        # A cylinder lies along z: turned about y it lies in the plane. Longer by its width, so that bends have no gaps.
        turn = (0.0, float(np.arctan2(along[0], along[1])), 0.0)
        size_ = {"radius": 0.004 * size, "length": length + 0.002 * size}
        _visual(links["base"], (middle[0], 0.0, middle[1]), turn, "cylinder", **size_)
    return ElementTree.tostring(root, encoding="unicode")


def _visual(link: ElementTree.Element, xyz: tuple[float, ...], rpy: tuple[float, ...], shape: str, **sizes: float) -> None:
    visual = ElementTree.SubElement(link, "visual")
    place = {"xyz": " ".join(f"{x:.9g}" for x in xyz), "rpy": " ".join(f"{x:.9g}" for x in rpy)}
    ElementTree.SubElement(visual, "origin", place)
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, shape, {name: f"{value:.9g}" for name, value in sizes.items()})
    ElementTree.SubElement(visual, "material", name="path")
