"""A motion of a planar chain, as it is shown: a robot that looks like the chain, with the path of its end point behind it."""

from __future__ import annotations

import re
import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rbd.errors import InputError, ModelWarning
from rbd.records import counted
from rbd.robots.loading import load_robot
from rbd.visual.playback.shown_motion import ShownMotion
from rbd.visual.robot_layers import collision_parts
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.style import CONTACT_COLORS, rgb

if TYPE_CHECKING:
    from rbd.planar.planned_motion import PlanarMotion

PATH_COLOR = CONTACT_COLORS[1]
SEEN_FROM = (0.12, -1.0, 0.18)
"""From before the plane, so that x runs to the right, a little aside and above."""
BEADS = 60
"""Pieces of the path at most."""


def is_planar(motion: object) -> bool:
    """Whether it is a motion of a planar chain."""
    names = ("chain", "t", "x", "q", "qddd", "split")
    return not isinstance(motion, type) and all(hasattr(motion, name) for name in names)


def shown_planar(motion: PlanarMotion) -> ShownMotion:
    """A motion of a planar chain as a motion that can be shown, upright in W, its x to the right and its y up.

    Raises:
        InputError: one of a single sample.
    """
    from rbd.planar.robot_file import robot_coordinates, to_urdf

    chain = motion.chain
    if len(motion) < 2:
        raise InputError("the motion has one sample only; expected two at least.")
    text = _drawn(to_urdf(chain, masses=[1.0] * chain.n, plane="xz"), motion)
    coordinates = robot_coordinates(chain)
    quietly = warnings.catch_warnings(action="ignore", category=ModelWarning)
    with tempfile.TemporaryDirectory(prefix="rbd-planar-") as folder, quietly:
        # It has no mass on purpose: then no centre of mass is drawn, of masses that were not given.
        file = Path(folder) / "chain.urdf"
        file.write_text(text, encoding="utf-8")
        robot = load_robot(file, root="fixed")
        _ = robot_parts(robot), collision_parts(robot)  # read as long as there is the file
    title = f"{counted(chain.n, 'link')}, minimum jerk"
    q, v = coordinates(motion.q), coordinates.rates(motion.qd)
    defaults = {"speed": 0.5, "follow": False, "ground": False, "seen_from": SEEN_FROM}
    return ShownMotion(motion, robot, motion.t, q, v, title, charts=lambda _: [], defaults=defaults)


def _drawn(text: str, motion: PlanarMotion) -> str:
    """The chain's URDF without masses and their balls, with a ball at the end point and the path behind."""
    size = sum(float(length) for length in motion.chain.lengths)
    text = re.sub(r".*<sphere .*\n", "", text)
    text = re.sub(r'<mass value="[^"]*"', '<mass value="0"', text)
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(motion.x, axis=0).T))])
    beads = np.linspace(0.0, far[-1], BEADS + 1)
    points = np.column_stack([np.interp(beads, far, column) for column in motion.x.T]) if far[-1] > 0.0 else motion.x[:1]
    path = []
    for (x, z), along in zip(0.5 * (points[:-1] + points[1:]), np.diff(points, axis=0), strict=True):
        # A cylinder is along z: turned about y it is in the plane. Longer by its width, so that bends have no gaps.
        length = float(np.hypot(*along)) + 0.002 * size
        shape = f'<cylinder radius="{0.004 * size:.9g}" length="{length:.9g}"/>'
        path.append(_visual(f'xyz="{x:.9g} 0 {z:.9g}" rpy="0 {np.arctan2(*along):.9g} 0"', shape))
    color = " ".join(f"{x:.3f}" for x in rgb(PATH_COLOR))
    material = f'<material name="path"><color rgba="{color} 1"/></material>'
    end = _visual("", f'<sphere radius="{0.022 * size:.9g}"/>')
    text = text.replace('<link name="base">', f'{material}<link name="base">{"".join(path)}')
    return text.replace('<link name="end"/>', f'<link name="end">{end}</link>')


def _visual(place: str, shape: str) -> str:
    return f'<visual><origin {place}/><geometry>{shape}</geometry><material name="path"/></visual>'
