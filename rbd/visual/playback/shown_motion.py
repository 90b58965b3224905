"""A motion as it is shown, whatever gave it: a simulation, a reference motion, a report on one, a planar chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from rbd.arrays import Array, as_float
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.robots.robot import Robot
from rbd.simulation.simulated_motion import Event
from rbd.visual.marks.surfaces import ShownSurface, surfaces_of_planes
from rbd.visual.playback.curves import Choice, CurveChart
from rbd.visual.playback.mode_disks import Disks, contact_disks
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.robot_meshes import drawable
from rbd.visual.style import PUSH_COLOR

FORCES = ("points", "point_forces", "modes", "events")
WANTED = ("robot", "t", "q", "v", *FORCES)


@dataclass(frozen=True, eq=False)
class Track:
    """Forces at some points over time.

    Attributes:
        name: Of the contact, or of what pushes.
        points: In W, shape (n, k, 3) [m]; NaN where there is no such point at that time.
        forces: On the robot, in W, shape (n, k, 3) [N]; zero without contact.
        color: Of what is no contact, as '#rrggbb'.
        aside: Whether it is drawn a little aside of where it acts, beside another force there.
    """

    name: str
    points: Array
    forces: Array
    color: str = PUSH_COLOR
    aside: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "forces", np.nan_to_num(self.forces, nan=0.0, posinf=0.0, neginf=0.0))


@dataclass(frozen=True)
class CardRow:
    """A row of a card.

    Attributes:
        name: What it is of.
        color: As '#rrggbb'.
        count: Its number of frames, in words.
        size: Its largest size, in words.
        t: The time that a click on it goes to [s].
        words: What it means.
    """

    name: str
    color: str
    count: str
    size: str
    t: float
    words: str


@dataclass(frozen=True)
class Card:
    """What was found, as a table with lines below it.

    Attributes:
        words: What is said above it; empty: nothing.
        rows: Of the table.
        lines: Folded at first.
    """

    words: str
    rows: tuple[CardRow, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """A motion as it is shown: its samples, its contacts, and what is special about its kind.

    Attributes:
        source: What gave it: its further numbers are drawn as curves, its force elements in the picture.
        robot: The robot, with its meshes.
        t: Times, shape (n,) [s], increasing; n is 2 or more.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        title: Headline.
        points: {contact: its points in W, shape (n, k, 3) [m]}.
        point_forces: {contact: the forces there, shape (n, k, 3) [N]}.
        modes: {constraint, or another thing that is the case at times: its mode at each sample}.
        events: Marks on the bar.
        lanes: {mode that is no contact's: its colour}, of those with a lane above the bar.
        pushes: Forces that are no contacts', at each sample.
        terrains: Those that it takes place on.
        driven: {constraint: the joint that it drives}.
        down: By how much the motion was lowered [m]: so is a second one.
        charts: The charts that are chosen.
        defaults: {setting of `Playback`: its value for this kind of motion where none is given}.
        name: What it is called beside another motion; empty: as its robot.
        at: Times of the pictures where no rate is asked for [s]; none: evenly.
        disks: {contact: the disks at its points}.
        surfaces: Planes that contacts are on, other than the floor.
        card: What was found.
        notes: What the legend says of the picture.

    Raises:
        InputError: fewer than two samples, times that do not increase, numbers that are not finite.
    """

    source: Any
    robot: Robot
    t: Array
    q: Array
    v: Array
    title: str
    points: Mapping[str, Array] = field(default_factory=dict)
    point_forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    events: Sequence[Event] = ()
    lanes: Mapping[str, str] = field(default_factory=dict)
    pushes: tuple[Track, ...] = ()
    terrains: tuple[Terrain, ...] = ()
    driven: Mapping[str, str] = field(default_factory=dict)
    down: float = 0.0
    charts: Callable[[Choice], list[CurveChart]] = lambda _: []  # noqa: E731
    defaults: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    at: Array = field(default_factory=lambda: np.zeros(0))
    disks: Mapping[str, Disks] = field(default_factory=dict)
    surfaces: tuple[ShownSurface, ...] = ()
    card: Card | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check."""
        if len(self.t) < 2:
            some = "one sample only" if len(self.t) else "no sample"
            raise InputError(f"the trajectory has {some}; a motion wants two. Show a single state with rbd.visual.Scene.")
        if not np.all(np.isfinite(self.t)) or np.min(np.diff(self.t)) <= 0.0:
            raise InputError("the times of the trajectory do not increase; expected those that rbd.simulate gave.")
        finite = np.isfinite(self.q).all(axis=1)
        if not finite.all():
            i = int(np.argmin(finite))
            raise InputError(f"q is not finite at {self.t[i]:.6g} s; show what is before it: trajectory[:{i}].")

    @classmethod
    def of_trajectory(cls, trajectory: Any) -> ShownMotion:
        """That of a trajectory, or of an `rbd.Motion`, of which no forces are known.

        Raises:
            InputError: what is neither.
        """
        missing = {name for name in WANTED if not hasattr(trajectory, name)}
        if missing - set(FORCES) or not isinstance(getattr(trajectory, "robot", None), CheckedModel):
            raise InputError(f"{trajectory!r:.80} is no trajectory; expected what rbd.simulate returned, or an rbd.Motion.")
        forces = {} if missing else {name: getattr(trajectory, name) for name in FORCES}
        robot, t, charts = drawable(trajectory.robot), np.asarray(trajectory.t, float), partial(charts_of, trajectory)
        ground = getattr(trajectory, "ground", None)  # of an `rbd.Motion`
        terrains = getattr(trajectory, "terrains", (ground,) if isinstance(ground, Terrain) else ())
        q, v, driven = trajectory.q, trajectory.v, getattr(trajectory, "driven", {})
        if forces:
            friction = getattr(trajectory, "friction", {})
            args = (trajectory.points, trajectory.point_forces, trajectory.modes, friction, trajectory.events)
            planes = getattr(trajectory, "planes", {})
            forces["disks"] = contact_disks(t, *args, planes, terrains)
            forces["surfaces"] = tuple(surfaces_of_planes(planes, trajectory.points, trajectory.point_forces))
        return cls(trajectory, robot, t, q, v, robot.name, charts=charts, terrains=terrains, driven=driven, **forces)


def a_time(what: str, value: object, first: float, last: float) -> float:
    """A time from the first to the last of a motion [s].

    Raises:
        InputError: if it is outside, or none.
    """
    t = as_float(value)
    # A time that was computed as the end may lie a rounding beyond it.
    if not first - 1e-9 <= t <= last + 1e-9:
        raise InputError(f"{what} is {value!r:.80}; the motion runs from {first:g} s to {last:g} s.")
    return min(max(t, first), last)
