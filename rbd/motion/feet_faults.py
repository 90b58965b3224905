"""How far feet are from the floor as they touch: tilt, hover, slip and depth in each frame; and the grade of a frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.motion.contact_timeline import ContactTimeline

TILT, HOVER, SLIP, SINK = np.deg2rad(5.0), 0.018, 0.02, 0.01
"""Tilt [rad], hover [m], slip [m/s] and depth [m] of usual retargeted feet: each alone halves the grade of a frame."""
MISSING, EXCESS, ANGLE, SPEED = 0.1, 0.1, 0.1, 1.0
"""Missing share of the weight, torque beyond its limit over the limit, joint [rad] and speed [rad/s] beyond, that halve it."""


@dataclass(frozen=True, eq=False, repr=False)
class FeetFaults(Displayed):
    """How feet touch, in n frames and c contacts; zero where a contact does not touch as meant.

    Attributes:
        tilt: Angle between the sole and the floor, shape (n, c) [rad].
        edge: Height of its highest corner over its lowest, shape (n, c) [m].
        hover: Height of its lowest point over the floor where none is on it, shape (n, c) [m].
        slip: Largest speed of its points that slide, shape (n, c) [m/s].
        sink: Depth of its lowest point, touching or not, shape (n, c) [m].

    Example:
        >>> g1 = rbd.load_robot("g1")
        >>> q = g1.standing().q.copy()
        >>> for side in ("left", "right"):
        ...     q[g1.joints[f"{side}_ankle_pitch_joint"].q] += np.deg2rad(5.0)
        >>> report = rbd.check_motion(rbd.motion.minimum_jerk(g1, [q, q], [0.0, 0.5]))
        >>> print(report.feet_faults)
        tilt 5.0 degrees, 15 mm; hover 0 mm; slip 0 mm/s; sink 0 mm
    """

    tilt: Array
    edge: Array
    hover: Array
    slip: Array
    sink: Array

    @classmethod
    def of(cls, lanes: ContactTimeline) -> FeetFaults:
        """Those of a timeline."""
        touches, low = (
            lanes.points.group_reduced(np.logical_or, lanes.touches),
            lanes.points.group_reduced(np.minimum, lanes.heights),
        )
        down = lanes.points.group_reduced(np.logical_or, lanes.on_floor)
        high = lanes.points.group_reduced(np.maximum, np.where(lanes.touches, lanes.heights, -np.inf))
        slip = lanes.points.group_reduced(np.maximum, np.where(lanes.slides, lanes.speeds, 0.0))
        edge = np.where(touches, np.maximum(high - low, 0.0), 0.0)
        tilt = np.where(touches, lanes.points.tilts(lanes.heights), 0.0)
        return cls(tilt, edge, np.where(touches & ~down, np.maximum(low, 0.0), 0.0), slip, np.maximum(-low, 0.0))

    def sizes(self, *, on_floor: bool = False) -> Array:
        """The largest tilt, hover, slip and depth of each frame, each over what is usual, shape (n, 4).

        Args:
            on_floor: Leave out contacts that hover.
        """
        tilt, hover = (np.where(self.hover > 0.0, 0.0, self.tilt), 0.0 * self.hover) if on_floor else (self.tilt, self.hover)
        scaled = zip((tilt, hover, self.slip, self.sink), (TILT, HOVER, SLIP, SINK), strict=True)
        return np.stack([x.max(axis=1, initial=0.0) / usual for x, usual in scaled], axis=1)

    def medians(self) -> tuple[float, float, float, float]:
        """Medians over the frames of the largest tilt [rad], hover [m], slip [m/s] and depth [m]."""
        tilt, hover, slip, sink = np.median(self.sizes(), axis=0) * (TILT, HOVER, SLIP, SINK)
        return float(tilt), float(hover), float(slip), float(sink)

    def __str__(self) -> str:
        tilt, hover, slip, sink = self.medians()
        edge = 1e3 * float(np.median(self.edge.max(axis=1, initial=0.0)))
        return (
            f"tilt {np.rad2deg(tilt):.1f} degrees, {edge:.0f} mm; hover {1e3 * hover:.0f} mm; slip {1e3 * slip:.0f} mm/s; "
            f"sink {1e3 * sink:.0f} mm"
        )

    def __repr__(self) -> str:
        return f"FeetFaults({self})"


def grade(sizes: Iterable[Array]) -> Array:
    """1 / (1 + x), x the sum of faults over what halves a grade, shape (n,): 1 without faults, and less with each."""
    return np.asarray(1.0 / (1.0 + sum(sizes, np.zeros(()))))
