"""The report of `rbd plane`: whether a planar chain reaches two points, and its minimum-jerk motion between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.arrays import Array, as_float
from rbd.cli.terminal import facts, numbers_of, save_figure
from rbd.errors import InputError, NoSolution
from rbd.planar.angles import nearest_turn
from rbd.planar.chain import MOST_LINKS, Chain
from rbd.planar.inverse_kinematics import Inverse, inverse
from rbd.planar.path_following import minimum_jerk
from rbd.planar.planned_motion import PlanarMotion, endpoint_motion, joint_motion
from rbd.records import Field, counted

SAMPLES = 1001
SPACES = ("endpoint", "joint")
PARTS = {"tangential": "tangential", "centripetal": "centripetal", "Coriolis": "coriolis"}
MOST_ROWS = 18
"""Largest number of peaks printed; all are in the JSON file."""


@dataclass(frozen=True, eq=False)
class PlaneTask:
    """A chain and the two points between which it is to move.

    Attributes:
        chain: The chain, its lengths numbers.
        start: How it reaches the first point.
        stop: Its inverse kinematics at the second point; for two links in the requested branch.
        duration: Seconds.
        space: In which the motion is planned: "endpoint" or "joint".
        branch: Of two links: 0 bends counterclockwise, 1 clockwise.
    """

    chain: Chain
    start: Inverse
    stop: Inverse
    duration: float
    space: str
    branch: int

    def __str__(self) -> str:
        lengths = ", ".join(f"{float(length):.4g}" for length in self.chain.lengths)
        angles = "from the vertical" if self.chain.angles == "vertical" else self.chain.angles
        ends = {"from": self.start, "to": self.stop}
        missed = [f"{_tuple(end.target)} m by {end.distance:.6g} m" for end in ends.values() if not end.reachable]
        verdict = f"Not reached: {' and '.join(missed)}." if missed else "Both points are reached."
        reached = [f"  {name} {end}" for name, end in ends.items() if end.reachable]
        chain = f"planar chain, {counted(self.chain.n, 'link')} of {lengths} m, angles: {angles}"
        return "\n".join([verdict, chain, *reached])

    def motion(self) -> PlanarMotion:
        """The motion, at 1001 times.

        Raises:
            NoSolution: an end, or the straight path between them, is out of reach; with the distance.
            InputError: an invalid duration or branch.
        """
        for end in (self.start, self.stop):
            if not end.reachable:
                raise NoSolution(
                    f"the target {_tuple(end.target)} m is out of reach by {end.distance:.6g} m; the nearest point that the "
                    f"chain reaches is {_tuple(end.nearest)} m."
                )
        if self.space == "joint":
            first, goal = _chosen(self.start, self.branch), _chosen(self.stop, self.branch)
            path = minimum_jerk(first, nearest_turn(goal, first), self.duration)
            return joint_motion(self.chain, path, times=path.times(SAMPLES))
        path = minimum_jerk(self.start.target, self.stop.target, self.duration)
        return endpoint_motion(self.chain, path, times=path.times(SAMPLES), branch=self.branch)


@dataclass(frozen=True)
class Peak:
    """The largest value of a quantity.

    Attributes:
        value: It.
        at: When [s].
        unit: Its unit.
    """

    value: float
    at: float
    unit: str

    @classmethod
    def of(cls, values: Array, times: Array, unit: str) -> Peak:
        """The value of the largest size; of equal ones the first."""
        size = np.abs(values)
        i = int(np.argmax(size >= size.max() * (1.0 - 1e-9)))
        return cls(float(values[i]), float(times[i]), unit)

    def __str__(self) -> str:
        return f"{self.value:.5g} {self.unit} at {self.at:.4g} s"


@dataclass(frozen=True, eq=False)
class PlaneReport:
    """The numbers of a motion.

    Attributes:
        task: The task.
        motion: The motion.
    """

    task: PlaneTask
    motion: PlanarMotion

    fields: ClassVar[tuple[Field, ...]] = (
        Field("links", (), "1", "number of links", lambda found: found.motion.chain.n),
        Field("lengths", (), "m", "of the links", lambda found: list(map(float, found.motion.chain.lengths))),
        Field("angles", (), "", "how angles are measured", lambda found: found.motion.chain.angles),
        Field("space", (), "", "in which the motion is planned", lambda found: found.motion.space),
        Field("duration", (), "s", "from rest to rest", lambda found: found.motion.path.duration),
        Field("start", (), "", "how it reaches the first point", lambda found: found.task.start),
        Field("stop", (), "", "how it reaches the second point", lambda found: found.task.stop),
        Field("peaks", (), "", "largest values and when"),
        Field("least_manipulability", (), "", "its least value and when"),
        Field("unbounded", (), "s", "towards which angular accelerations grow", lambda found: found.motion.unbounded),
        Field("note", (), "", "what was left out", lambda found: found.motion.note),
        Field("t", (), "s", "times", lambda found: found.motion.t),
        Field("x", (), "m", "the end point", lambda found: found.motion.x),
        Field("q", (), "rad", "angles", lambda found: found.motion.q),
        Field("qd", (), "rad/s", "their rates", lambda found: found.motion.qd),
    )

    @property
    def peaks(self) -> dict[str, Peak]:
        """{what: its largest value and when}."""
        m, split = self.motion, self.motion.split
        found = {"speed": Peak.of(m.speed, m.t, "m/s"), "acceleration": Peak.of(np.hypot(*m.a.T), m.t, "m/s2")}
        parts = {part: np.hypot(*getattr(split, name).T) for part, name in PARTS.items()}
        found |= {f"{part} acceleration": Peak.of(size, m.t, "m/s2") for part, size in parts.items()}
        if m.chain.n > 1:
            found["manipulability"] = Peak.of(m.manipulability, m.t, "m2")
        columns = [("rate", "deg/s", m.qd)] + ([] if m.unbounded else [("acceleration", "deg/s2", m.qdd)])
        for what, unit, angles in columns:
            found |= {f"{what} of theta_{k + 1}": Peak.of(np.degrees(x), m.t, unit) for k, x in enumerate(angles.T)}
        return found

    def __rich__(self) -> Group:
        """The largest speed and acceleration, then how it is planned, then all peaks, then what was left out."""
        m, peaks = self.motion, self.peaks
        top, push = peaks["speed"], peaks["acceleration"]
        where = "the end point goes straight" if m.space == "endpoint" else "the angles go straight"
        lines = [
            f"The end point moves at up to {top.value:.5g} m/s and accelerates at up to {push.value:.5g} m/s2.",
            f"minimum-jerk motion in {m.path.duration:g} s, planned in {m.space} space: {where}",
        ]
        rows = [("length of the end point's path", f"{float(np.hypot(*np.diff(m.x, axis=0).T).sum()):.6g} m")]
        rows += [(f"peak {name}", str(peak)) for name, peak in list(peaks.items())[:MOST_ROWS]]
        if len(peaks) > MOST_ROWS:
            rows.append(("", f"and {len(peaks) - MOST_ROWS} more peaks"))
        if m.unbounded:
            rows.append(("angular accelerations", f"without bound towards {' and '.join(f'{t:g} s' for t in m.unbounded)}"))
        if m.chain.n > 1:
            rows.append(("least manipulability", str(self.least_manipulability)))
        return Group(*map(Text, lines), facts(None, rows), *([Text(f"note: {m.note}")] if m.note else []))

    @property
    def least_manipulability(self) -> Peak:
        """Its least value, and when; zero at the samples that were left out, where the chain is in line."""
        m = self.motion
        if len(left_out := np.setdiff1d(m.path.times(SAMPLES), m.t)):
            return Peak(0.0, float(left_out[0]), "m2")
        i = int(np.argmin(m.manipulability))
        return Peak(float(m.manipulability[i]), float(m.t[i]), "m2")


def plane_task(
    start: str,
    stop: str,
    *,
    links: int | None = None,
    lengths: str | None = None,
    angles: str = "joint",
    duration: float = 1.0,
    branch: int = 0,
    space: str | None = None,
) -> PlaneTask:
    """The command line's task, parsed and checked.

    Args:
        start: "x,y" of the first point [m].
        stop: "x,y" of the second one [m].
        links: How many; as many as there are lengths, or two.
        lengths: "l1,l2,.." [m]; equal ones that make one metre by default.
        angles: "joint", "segment" or "vertical".
        duration: Above zero [s].
        branch: 0 or 1.
        space: "endpoint" or "joint"; of one link, which cannot follow a straight path, "joint" by default, else "endpoint".

    Raises:
        InputError: arguments that cannot be parsed, or are invalid.
    """
    given = None if lengths is None else numbers_of("--lengths", lengths, "metres")
    count = links if links is not None else 2 if given is None else len(given)
    if not 1 <= count <= MOST_LINKS:
        raise InputError(f"a chain of {count} links was asked for; expected --links 1 to {MOST_LINKS}.")
    if given is not None and len(given) != count:
        raise InputError(
            f"--lengths has {counted(len(given), 'number')}, and --links is {count}; expected one number per link."
        )
    chain = Chain(count, lengths=[1.0 / count] * count if given is None else given, angles=angles)
    chosen = space if space is not None else SPACES[count == 1]
    if chosen not in SPACES:
        raise InputError(f"--space is {space!r:.80}; expected endpoint or joint.")
    if branch not in (0, 1):
        raise InputError(f"--branch is {branch!r:.80}; expected 0 (bends counterclockwise) or 1 (clockwise).")
    if not 0.0 < as_float(duration) < np.inf:
        raise InputError(f"--duration is {duration!r:.80}; expected seconds above zero.")
    first = inverse(chain, numbers_of("--from", start, "metres", names="X,Y"))
    last = numbers_of("--to", stop, "metres", names="X,Y")
    # From a family of poses, the one nearest to that at the first point; for two links, the branches in order.
    near = first.q if count > 2 and first.reachable else None
    return PlaneTask(chain, first, inverse(chain, last, start=near), float(duration), chosen, branch)


def page(motion: PlanarMotion, path: Path) -> Path:
    """The page of a motion, written; returns its path."""
    from rbd.visual import export_motion

    return export_motion(motion, path)


def draw(motion: PlanarMotion, path: Path) -> Path:
    """Stick figures and ellipses, the 2 x 4 panels, and the parts of the acceleration, in one picture; returns its path.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    from rbd.visual.figures.planar_figures import plot_ellipses, plot_sticks
    from rbd.visual.figures.planar_plots import plot_panels, plot_split

    figure = Figure(figsize=(12.0, 14.0), layout="constrained")
    # As an array: the stubs know of a single subfigure only.
    above, middle, below = np.asarray(figure.subfigures(3, 1, height_ratios=[1.1, 1.25, 0.85], hspace=0.03))
    sticks, ellipses = above.subplots(1, 2)
    plot_sticks(sticks, motion.chain, motion.q)
    sticks.set_title(f"{counted(motion.chain.n, 'link')}: poses evenly in time", loc="left", fontsize="small")
    plot_ellipses(ellipses, motion.chain, motion.q)
    plot_panels(middle.subplots(2, 4, sharex=True), motion)
    plot_split(below.subplots(1, 3, sharey=True), motion)
    ends = [_tuple(point) for point in (motion.x[0], motion.x[-1])]
    figure.suptitle(
        f"Minimum jerk of {counted(motion.chain.n, 'link')}, {ends[0]} to {ends[1]} m in {motion.path.duration:g} s, "
        f"planned in {'end-point' if motion.space == 'endpoint' else 'joint'} space"
    )  # fmt: skip
    return save_figure(figure, path, dpi=130)


def _chosen(end: Inverse, branch: int) -> Array:
    """The angles of a branch; if both coincide, of the only one."""
    return end.branches[min(branch, len(end.branches) - 1)]


def _tuple(values: Sequence[float] | Array) -> str:
    # Rounding before adding zero turns -0 into 0
    return "(" + ", ".join(f"{x:.5g}" for x in np.round(np.asarray(values, float), 6) + 0.0) + ")"
