"""The report of `rbd plane`: whether a planar chain reaches two points, and its minimum-jerk motion between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from rbd.arrays import Array, as_float
from rbd.cli.terminal import TerminalTable, counted, facts, numbers_of, save_figure
from rbd.errors import InputError, NoSolution
from rbd.planar.angles import nearest_turn
from rbd.planar.chain import MOST_LINKS, Chain
from rbd.planar.inverse_kinematics import Inverse, inverse
from rbd.planar.path_following import minimum_jerk
from rbd.planar.planned_motion import PlanarMotion, endpoint_motion, joint_motion

SAMPLES = 1001
SPACES = ("endpoint", "joint")
PARTS = ("tangential", "centripetal", "coriolis")
MOST_ROWS = 12
"""Largest number of angles printed; all are in the JSON file."""


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

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        lengths = ", ".join(f"{float(length):.4g}" for length in self.chain.lengths)
        angles = {"joint": "joint", "segment": "segment", "vertical": "from the vertical"}[self.chain.angles]
        missed = [f"{_tuple(end.target)} m by {end.distance:.6g} m" for end in (self.start, self.stop) if not end.reachable]
        yield Text(f"Not reached: {' and '.join(missed)}." if missed else "Both points are reached.")
        yield Text(f"planar chain, {counted(self.chain.n, 'link')} of {lengths} m, angles: {angles}")
        yield ""
        table = TerminalTable(None, ("", "target in m", "reachable", "singular", "branches in deg"))
        for name, end in (("from", self.start), ("to", self.stop)):
            reached = "yes" if end.reachable else f"no, out of reach by {end.distance:.6g} m"
            branches = " or ".join(_tuple(np.degrees(row)) for row in end.branches) or "none"
            if end.reachable and self.chain.n > 2:
                branches = f"{branches}, one of a family"
            singular = "yes" if end.singular else "no"
            table.add_row(name, _tuple(end.target), reached, singular if end.reachable else "", branches)
        yield table

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


@dataclass(frozen=True, eq=False)
class PlaneReport:
    """The numbers of a motion.

    Attributes:
        task: The task.
        motion: The motion.
    """

    task: PlaneTask
    motion: PlanarMotion

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        m = self.motion
        where = "the end point goes straight" if m.space == "endpoint" else "the angles go straight"
        top, push = _largest(m.speed, m.t)["value"], _largest(np.hypot(*m.a.T), m.t)["value"]
        yield Text(f"The end point moves at up to {top:.5g} m/s and accelerates at up to {push:.5g} m/s2.")
        yield Text(f"minimum-jerk motion in {m.path.duration:g} s, planned in {m.space} space: {where}")
        far = float(np.hypot(*np.diff(m.x, axis=0).T).sum())
        rows = [("length of the end point's path", f"{far:.6g} m")]
        rows.append(("peak speed", _peak(m.speed, m.t, "m/s")))
        rows.append(("peak acceleration", _peak(np.hypot(*m.a.T), m.t, "m/s2")))
        for part in PARTS:
            name = "Coriolis" if part == "coriolis" else part
            rows.append((f"  {name} part", _peak(np.hypot(*getattr(m.split, part).T), m.t, "m/s2")))
        for k in range(min(m.chain.n, MOST_ROWS)):
            rows.append((f"peak rate of theta_{k + 1}", _peak(np.degrees(m.qd[:, k]), m.t, "deg/s")))
        if m.chain.n > MOST_ROWS:
            rows.append(("", f"and {m.chain.n - MOST_ROWS} more angles"))
        for k in range(0 if m.unbounded else min(m.chain.n, MOST_ROWS)):
            rows.append((f"peak acceleration of theta_{k + 1}", _peak(np.degrees(m.qdd[:, k]), m.t, "deg/s2")))
        if m.unbounded:
            ends = " and ".join(f"{t:g} s" for t in m.unbounded)
            rows.append(("angular accelerations", f"without bound towards {ends}"))
        if m.chain.n > 1:
            least, most = self._manipulability()
            rows.append(("least manipulability", f"{least['value']:.4g} m2 at {least['at']:.4g} s"))
            rows.append(("largest manipulability", f"{most['value']:.4g} m2 at {most['at']:.4g} s"))
        yield facts(None, rows)
        if m.note:
            yield Text(f"note: {m.note}")

    def data(self) -> dict[str, object]:
        """The numbers, for JSON: SI and radians."""
        m, task = self.motion, self.task
        return {
            "links": m.chain.n,
            "lengths": [float(length) for length in m.chain.lengths],
            "angles": m.chain.angles,
            "space": m.space,
            "duration": m.path.duration,
            "from": _end_data(task.start),
            "to": _end_data(task.stop),
            "peaks": {
                "speed": _largest(m.speed, m.t),
                "acceleration": _largest(np.hypot(*m.a.T), m.t),
                "rates": [_largest(column, m.t) for column in m.qd.T],
                **{part: _largest(np.hypot(*getattr(m.split, part).T), m.t) for part in PARTS},
            },
            "least_manipulability": self._manipulability()[0],
            "unbounded": list(m.unbounded),
            "note": m.note,
            "t": m.t.tolist(),
            "x": m.x.tolist(),
            "q": m.q.tolist(),
            "qd": m.qd.tolist(),
        }

    def _manipulability(self) -> tuple[dict[str, float], dict[str, float]]:
        """Its least and its largest value, and when; zero at the samples that were left out, where the chain is in line."""
        m = self.motion
        left_out = np.setdiff1d(m.path.times(SAMPLES), m.t)
        i = int(np.argmin(m.manipulability))
        least = {"value": float(m.manipulability[i]), "at": float(m.t[i])}
        if len(left_out):
            least = {"value": 0.0, "at": float(left_out[0])}
        return least, _largest(m.manipulability, m.t)


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


def _largest(values: Array, times: Array) -> dict[str, float]:
    size = np.abs(values)
    i = int(np.argmax(size >= size.max() * (1.0 - 1e-9)))  # of equal peaks the first
    return {"value": float(values[i]), "at": float(times[i])}


def _peak(values: Array, times: Array, unit: str) -> str:
    found = _largest(values, times)
    if found["value"] == 0.0:
        return f"0 {unit}"
    return f"{found['value']:.5g} {unit} at {found['at']:.4g} s"


def _tuple(values: Sequence[float] | Array) -> str:
    # Rounding before adding zero turns -0 into 0
    return "(" + ", ".join(f"{x:.5g}" for x in np.round(np.asarray(values, float), 6) + 0.0) + ")"


def _end_data(end: Inverse) -> dict[str, object]:
    return {
        "target": end.target.tolist(),
        "reachable": bool(end.reachable),
        "distance": end.distance,
        "singular": bool(end.singular),
        "branches": end.branches.tolist(),
    }
