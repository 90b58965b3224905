"""What a page needs to play a motion: bodies, colours, sizes, frames and events, as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.visual.animation_frames import OPEN, Frames, Track
from rbd.visual.colors import COM_COLOR, PUSH_COLOR, contact_colors
from rbd.visual.marks import Sizes
from rbd.visual.robot_meshes import RobotPart
from rbd.visual.shapes import outermost

if TYPE_CHECKING:
    from rbd.simulation.events import Event

LONGEST_ARROW = 0.8
"""In sizes of the robot: the arrow of an impact of a millisecond would leave the picture."""
LONGEST_WEIGHT = 1.5
"""Arrows of so many weights are never cut."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)
BINS = 100
"""Marks along the bar: events of one contact in the same hundredth of it share one."""
MOST_WORDS = 8
"""Events told by one mark; of more, the first ones and how many there are."""
EVENT_KINDS = ("touches", "slips", "sticks", "leaves")
"""The most telling first: what a mark of several events looks like."""
MOST_POSES_FRAMED = 100


@dataclass(frozen=True, eq=False)
class Score:
    """A motion, ready to be written for the page.

    Attributes:
        frames: Its pictures.
        parts: Pieces of the robot, in the order in which the scene sent them.
        sizes: Of the scene's marks.
        ground: Whether there is a ground for the centre of mass to drop a line to.
        weight_N: The robot's weight [N].
    """

    frames: Frames
    parts: Sequence[RobotPart]
    sizes: Sizes
    ground: bool
    weight_N: float

    @lazy
    def rows(self) -> Array:
        """What moves, one row a frame: see `Frames.rows`."""
        return self.frames.rows()

    @lazy
    def words(self) -> list[str]:
        """The modes that occur, "open" first."""
        shown = {mode for modes in self.frames.modes.values() for mode in modes}
        between = {mode for some in self.frames.stretches.values() for _, _, mode in some}
        return [OPEN, *sorted((shown | between) - {OPEN})]

    @lazy
    def codes(self) -> Array:
        """Mode of each constraint at each frame, as its place in `words`, shape (n, number of constraints)."""
        place = {word: i for i, word in enumerate(self.words)}
        columns = [[place[mode] for mode in modes] for modes in self.frames.modes.values()]
        return np.array(columns, int).reshape(len(columns), len(self.frames.times)).T

    @property
    def longest(self) -> float:
        """Length at which an arrow is cut [m]."""
        return max(LONGEST_ARROW * self.sizes.body, LONGEST_WEIGHT * self.weight_N * self.sizes.metres_per_newton)

    def goes_far(self, times: float) -> bool:
        """Whether the centre of mass goes farther along the ground than so many sizes of the robot."""
        com = self.frames.com[:, :2]
        return len(com) > 0 and float(np.ptp(com, axis=0).max()) > times * self.sizes.body

    def around(self, follow: bool) -> Array:
        """Points in W that the camera is to see, shape (n, 3) [m].

        With a camera that follows, as if the centre of mass stayed over where it starts.
        """
        frames = self.frames
        shift = np.zeros((len(frames.times), 3))
        if follow and len(frames.com):
            shift[:, :2] = frames.com[:, :2] - frames.com[0, :2]
        picked = np.unique(np.linspace(0, len(frames.times) - 1, MOST_POSES_FRAMED).astype(int))
        hulls = [_hull_of(joint, self.parts) for joint in frames.joints]
        clouds = [np.zeros((0, 3))]
        for i in picked if hulls else ():
            placed = [pin.XYZQUATToSE3(pose) for pose in frames.poses[i]]
            pose = [hull @ X.rotation.T + X.translation for hull, X in zip(hulls, placed, strict=True)]
            clouds.append(outermost(np.vstack(pose)) - shift[i])  # pose by pose: all together would fill the memory
        for track in (*frames.contacts, *frames.pushes):
            clouds += [ends - shift for ends in self._arrow_ends(track)]
        points = np.vstack(clouds)
        points = points[np.isfinite(points).all(axis=1)]
        return outermost(points) if len(points) else points

    def _arrow_ends(self, track: Track) -> list[Array]:
        """Starts and tips of a track's resultant arrows, each of shape (n, 3) [m]; NaN where there is none."""
        size = np.linalg.norm(track.forces, axis=2, keepdims=True)
        total = size.sum(axis=1)
        weight = np.where(total > 0.0, total, np.nan)
        starts = np.sum(np.nan_to_num(track.points) * size, axis=1) / weight
        vectors = self.sizes.metres_per_newton * track.forces.sum(axis=1)
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return [starts, starts + vectors * np.minimum(1.0, self.longest / np.maximum(lengths, 1e-12))]

    def whole(self, events: Sequence[Event], settings: Mapping[str, object]) -> str:
        """The motion with all its frames, as JSON."""
        frames = self.frames
        played = {
            "times": [round(float(t), 9) for t in frames.times],
            "rows": _packed(self.rows.astype("<f4")),
            "codes": _packed(self.codes.astype("u1")),
            "events": self.marks(events),
            "speeds": sorted({*SPEEDS, float(settings["speed"])}),  # type: ignore[arg-type]
        }
        return json.dumps({"motion": {**self._cast(), **settings, **played}})

    def opening(self, settings: Mapping[str, object]) -> str:
        """The motion without its frames, as JSON: they come one by one, see `moment`."""
        return json.dumps({"motion": {**self._cast(), **settings}})

    def moment(self, i: int) -> str:
        """One frame, as JSON."""
        row = _packed(self.rows[i].astype("<f4"))
        codes = [int(c) for c in self.codes[i]]
        return json.dumps({"moment": {"t": round(float(self.frames.times[i]), 9), "row": row, "codes": codes}})

    def marks(self, events: Sequence[Event]) -> list[dict[str, object]]:
        """Marks on the bar, in order of time: {t, name, kind, point, words}; events close together share one."""
        first, last = float(self.frames.times[0]), float(self.frames.times[-1])
        bins: dict[tuple[str, int], list[Event]] = {}
        for event in sorted(events, key=lambda e: e.t):
            if first - 1e-9 <= event.t <= last + 1e-9:
                bins.setdefault((event.name, int(BINS * (event.t - first) / (last - first))), []).append(event)
        marks: list[dict[str, object]] = []
        for (name, _), some in bins.items():
            kinds = {e.kind for e in some}
            kind = next((k for k in EVENT_KINDS if k in kinds), some[0].kind)
            words = [str(e) for e in some[:MOST_WORDS]]
            if len(some) > MOST_WORDS:
                words.append(f"and {len(some) - MOST_WORDS} more till {some[-1].t:.6f} s")
            point = next(e.point for e in some if e.kind == kind)
            marks.append({"t": round(float(some[0].t), 9), "name": name, "kind": kind, "point": point, "words": words})
        return sorted(marks, key=lambda mark: float(mark["t"]))  # type: ignore[arg-type]

    def _stretches(self, name: str) -> list[tuple[float, float, int]]:
        """(from, to, code) of each time in one mode other than "open", for its lane above the bar."""
        code = {word: i for i, word in enumerate(self.words)}
        return [(round(a, 9), round(b, 9), code[mode]) for a, b, mode in self.frames.stretches[name] if mode != OPEN]

    @property
    def note(self) -> str:
        """What the legend says of the arrows' scale."""
        per_metre = 1.0 / self.sizes.metres_per_newton
        times = per_metre / self.weight_N if self.weight_N else 0.0
        share = ", the weight" if abs(times - 1.0) < 1e-9 else f", {times:.3g} times the weight"
        return f"1 m of arrow is {per_metre:.4g} N{share if times else ''}. Two heads: longer than drawn."

    def _cast(self) -> dict[str, object]:
        """Who plays: the same for a page and for a live scene."""
        frames, sizes = self.frames, self.sizes
        body = {joint: j for j, joint in enumerate(frames.joints)}
        parts = [
            {"node": i, "body": body[part.joint], "at": [round(float(x), 9) for x in pin.SE3ToXYZQUAT(part.placement)]}
            for i, part in enumerate(self.parts)
            if part.joint
        ]
        colors = contact_colors(t.name for t in frames.contacts)
        contacts = [
            {"name": t.name, "color": colors[t.name], "points": t.points.shape[1], "stretches": self._stretches(t.name)}
            for t in frames.contacts
        ]
        pushes = [{"name": f"push on {t.name}", "color": PUSH_COLOR, "points": 1} for t in frames.pushes]
        return {
            "parts": parts,
            "bodies": len(frames.joints),
            "contacts": contacts,
            "pushes": pushes,
            "others": list(frames.modes)[len(contacts) :],
            "words": self.words,
            "com": COM_COLOR if len(frames.com) else "",
            "ground": self.ground,
            "sizes": {
                "body": sizes.body,
                "shaft": sizes.shaft,
                "line": sizes.line,
                "lift": sizes.lift,
                "longest": self.longest,
                "metresPerNewton": sizes.metres_per_newton,
            },
            "note": self.note if contacts or pushes else "",
        }


def _hull_of(joint: int, parts: Sequence[RobotPart]) -> Array:
    """The outermost points of all that a joint carries, in its frame, shape (n, 3) [m]."""
    placed = [p.mesh.placed(p.placement.rotation, p.placement.translation).vertices for p in parts if p.joint == joint]
    return outermost(np.vstack(placed))


def _packed(numbers: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers).tobytes()).decode("ascii")
