"""A motion in the form that the page needs: bodies, contacts, frames and events as JSON, and what the camera is to see."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.state import State
from rbd.simulation.simulated_motion import OPEN, Event
from rbd.visual.marks.applied_forces import RELAXED
from rbd.visual.marks.mark import Sizes
from rbd.visual.marks.other_constraints import DRIVE_COLOR, drive_mesh
from rbd.visual.marks.picture import scale_note
from rbd.visual.marks.shown_force import NOWHERE
from rbd.visual.marks.surfaces import ShownSurface
from rbd.visual.marks.terrain import TERRAIN_COLOR, ShownTerrain
from rbd.visual.playback.curves import packed
from rbd.visual.playback.mode_disks import Disks
from rbd.visual.playback.motion_frames import (
    ELEMENT_COLORS,
    PageFrames,
    checked_ghost,
    element_look,
    ghost_poses,
    pieces_of,
)
from rbd.visual.playback.shown_motion import ShownMotion, Track
from rbd.visual.playback.trajectory_charts import carries_weight, plane_normals
from rbd.visual.robot_layers import collision_parts
from rbd.visual.robot_meshes import RobotPart, hull_of, missing_note
from rbd.visual.shapes import outermost
from rbd.visual.style import COM_COLOR, GHOST_COLOR, SUPPORT_COLOR, contact_colors

LONGEST_ARROW = 0.8
"""Longest arrow in sizes of the robot: the arrow of an impact of a millisecond would leave the picture."""
LONGEST_WEIGHT = 1.5
"""Arrows of up to so many weights are not cut."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)
BINS = 100
"""Marks along the bar: events of one contact in the same hundredth of it share one."""
MOST_WORDS = 8
"""Events named by one mark; of more, the first ones and how many there are."""
EVENT_KINDS = ("touches", "slips", "sticks", "leaves")
"""The most telling first: what a mark of several events looks like."""
MOST_POSES_FRAMED = 100
STILL = 1e-4
"""The normal of a contact that changes by less is sent once."""
APART = 0.12
"""Two motions beside each other are this share of the robot's size apart."""
FULL = 255
"""What is sent for a disk that is full."""
DRIVES = "drives"
"""Path in the viewer of what shows driven joints."""
SECOND = "second"
"""Path of the second robot's pieces in the viewer, if it is another robot."""


@dataclass(frozen=True, eq=False)
class MotionPage:
    """A motion in the form that the page needs.

    Attributes:
        shown: The motion.
        frames: Its pictures.
        parts: Pieces of the robot, in the order in which the scene sent them.
        sizes: Of the scene's marks.
        ground: Whether there is a ground for the centre of mass to drop a line to.
        second: A second motion in the same page, of this robot or another.
        shift: By how much it is drawn beside where it is, in W, shape (3,) [m]: numbers on the page are those of where it is.
        name: What it is called beside another one.
        carried: Paths of marks that move, by the last of the poses in `frames.lifts`.
    """

    shown: ShownMotion
    frames: PageFrames
    parts: Sequence[RobotPart]
    sizes: Sizes
    ground: bool
    second: MotionPage | None = None
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)
    name: str = ""
    carried: tuple[str, ...] = ()

    @lazy
    def words(self) -> list[str]:
        """The modes that occur, "open" first."""
        shown = {mode for modes in self.frames.modes.values() for mode in modes}
        between = {mode for some in self.frames.stretches.values() for _, _, mode in some}
        return [OPEN, *sorted((shown | between) - {OPEN})]

    @lazy
    def codes(self) -> Array:
        """Mode of each constraint at each frame, as its index in `words`, shape (n, number of constraints)."""
        place = {word: i for i, word in enumerate(self.words)}
        columns = [[place[mode] for mode in modes] for modes in self.frames.modes.values()]
        return np.array(columns, int).reshape(len(columns), len(self.frames.times)).T

    @property
    def longest(self) -> float:
        """Largest length of an arrow [m]."""
        return max(LONGEST_ARROW * self.sizes.body, LONGEST_WEIGHT * self.sizes.weight_N * self.sizes.metres_per_newton)

    def with_ghost(self, ghost: Any) -> MotionPage:
        """With a second motion of the same robot, which is drawn in one translucent colour; without one if it is None.

        Args:
            ghost: With robot, t and q; at times that it does not have, as at the nearest that it has.

        Raises:
            InputError: what is no motion, or one of another robot.
        """
        if ghost is None:
            return self
        f = self.frames
        second = checked_ghost(ghost, self.shown.robot)
        poses = np.concatenate([f.poses, ghost_poses(second, f.times, f.joints, self.shown.down)], axis=1)
        name = f"{getattr(ghost, 'source', '') or 'other motion'} (translucent)"
        return replace(self, frames=replace(f, joints=f.joints * 2, poses=poses, ghost=name))

    def with_moving(self, path: str, moved: Array) -> MotionPage:
        """With a mark that moves.

        Args:
            path: Of the mark in the viewer.
            moved: By how much from where it is drawn, at each frame, shape (n, 3) [m].
        """
        poses = np.column_stack([moved, np.tile([0.0, 0.0, 0.0, 1.0], (len(moved), 1))])[:, None]
        frames = replace(self.frames, lifts=np.concatenate([self.frames.lifts, poses], axis=1))
        return replace(self, frames=frames, carried=(*self.carried, path))

    def with_second(self, second: MotionPage, seen_from: Sequence[float] | Array) -> MotionPage:
        """With a second motion beside it: displaced along x or y of W, to the right of the first on the page, clear of it.

        Args:
            second: Its forces are drawn at the scale of the first.
            seen_from: From the robot to the camera, in W.
        """
        right = np.array([-seen_from[1], seen_from[0]])
        axis = int(np.abs(right).argmax())
        side = float(np.sign(right[axis]))
        mine, its = (side * page.around(False)[:, axis] for page in (self, second))
        apart = side * (mine.max() - its.min() + APART * self.sizes.body)
        one, other = (page.shown.name or page.shown.robot.name for page in (self, second))
        names = f"1: {one}", f"2: {other}, dashed curves"
        shift = tuple(round(apart, 3) if i == axis else 0.0 for i in range(3))
        return replace(self, second=replace(second, shift=shift, name=names[1]), name=names[0])

    @property
    def own_meshes(self) -> bool:
        """Whether there is a second robot that is not the first: its meshes are sent too."""
        return self.second is not None and self.second.parts is not self.parts

    @property
    def further_parts(self) -> dict[str, Sequence[RobotPart]]:
        """{path in the viewer: pieces to be sent}: of force elements, and of a second robot that is not the first."""
        found: dict[str, Sequence[RobotPart]] = {
            self._element(i): [
                RobotPart(track.name, 0, pin.SE3.Identity(), piece.mesh, RELAXED, piece.opacity)
                for piece in pieces_of(track, self.sizes)
            ]
            for i, track in enumerate(self.frames.elements)
        }
        if self._drives:
            found[DRIVES] = self._drives
        if self.second is not None:
            found |= self.second.further_parts
        return found | {SECOND: self.second.parts} if self.second is not None and self.own_meshes else found

    @lazy
    def _drives(self) -> list[RobotPart]:
        """What shows the driven joints: it moves with the body that each joint moves. Of a second motion none."""
        robot, out = self.shown.robot, []
        start = State(robot, np.array(self.shown.q[0], float))
        for name, driven in {} if any(self.shift) else self.shown.driven.items():
            joint = robot.joints[driven]
            if joint.id in self.frames.joints:
                mesh = drive_mesh(start, joint, self.sizes)
                out.append(RobotPart(name, joint.id, pin.SE3.Identity(), mesh, DRIVE_COLOR, 1.0))
        return out

    def _element(self, i: int) -> str:
        """Path in the viewer of the pieces of a force element."""
        return f"{'beside' if any(self.shift) else 'moving'} elements/{i}"

    def goes_far(self, times: float) -> bool:
        """Whether the centre of mass travels farther along the ground than so many sizes of the robot."""
        com = self.frames.com[:, :2]
        return len(com) > 0 and float(np.ptp(com, axis=0).max()) > times * self.sizes.body

    def around(self, follow: bool, leader: PageFrames | None = None) -> Array:
        """Points in W that the camera is to see, shape (n, 3) [m].

        With a camera that follows, as if the centre of mass stayed over where it starts: its own, or that of a leader.
        """
        frames, lead = self.frames, self.frames if leader is None else leader
        shift = np.zeros((len(frames.times), 3))
        for axis in (0, 1) if follow and len(lead.com) else ():
            shift[:, axis] = np.interp(frames.times, lead.times, lead.com[:, axis]) - lead.com[0, axis]
        picked = np.unique(np.linspace(0, len(frames.times) - 1, MOST_POSES_FRAMED).astype(int))
        hulls = [hull_of(joint, self.parts) for joint in frames.joints]
        clouds = [np.zeros((0, 3))]
        for i in picked if hulls else ():
            placed = [pin.XYZQUATToSE3(pose) for pose in frames.poses[i]]
            pose = [hull @ X.rotation.T + X.translation for hull, X in zip(hulls, placed, strict=True)]
            clouds.append(outermost(np.vstack(pose)) - shift[i])  # pose by pose: all together would fill the memory
        for track in (*frames.contacts, *frames.pushes):
            clouds += [ends - shift for ends in self._arrow_ends(track)]
        clouds += [element.points[:, end] - shift for element in frames.elements for end in (0, 1)]
        if self.second is not None:
            clouds.append(self.second.around(follow, frames) + self.second.shift)
        points = np.vstack(clouds)
        points = points[np.isfinite(points).all(axis=1)]
        return outermost(points) if len(points) else points

    def _arrow_ends(self, track: Track) -> list[Array]:
        """Starts and tips of a track's resultant arrows, each of shape (n, 3) [m]; NaN where there is none."""
        size = np.linalg.norm(track.forces, axis=2, keepdims=True)
        total = size.sum(axis=1)
        starts = np.sum(np.nan_to_num(track.points) * size, axis=1) / np.where(total > 0.0, total, np.nan)
        vectors = self.sizes.metres_per_newton * track.forces.sum(axis=1)
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return [starts, starts + vectors * np.minimum(1.0, self.longest / np.maximum(lengths, 1e-12))]

    def whole(self, settings: Mapping[str, object], speed: float) -> str:
        """The motion with all its frames, as JSON; `speed` is one of those that can be chosen."""
        told: dict[str, object] = {**self._played(), **settings, "speed": speed, "speeds": sorted({*SPEEDS, speed})}
        if self.second is not None:
            tree = SECOND if self.own_meshes else "robot"
            told["second"] = {**self.second._played(), "title": "", "tree": tree, "shift": self.second.shift}  # noqa: SLF001
        return json.dumps({"motion": told})

    def marks(self) -> list[dict[str, object]]:
        """Marks on the bar, in order of time: {t, name, kind, point, words}; events close together share one."""
        first, last = float(self.frames.times[0]), float(self.frames.times[-1])
        bins: dict[tuple[str, int], list[Event]] = {}
        for event in sorted(self.shown.events, key=lambda e: e.t):
            if first - 1e-9 <= event.t <= last + 1e-9:
                bins.setdefault((event.name, int(BINS * (event.t - first) / (last - first))), []).append(event)
        marks = []
        for (name, _), some in bins.items():
            kinds = {e.kind: e.point for e in reversed(some)}
            kind = next((k for k in EVENT_KINDS if k in kinds), some[0].kind)
            words = [str(e) for e in some[:MOST_WORDS]]
            words += [f"and {len(some) - MOST_WORDS} more till {some[-1].t:.6f} s"] * (len(some) > MOST_WORDS)
            marks.append((some[0].t, {"name": name, "kind": kind, "point": kinds[kind], "words": words}))
        return [{"t": round(float(t), 9), **mark} for t, mark in sorted(marks, key=lambda each: each[0])]

    @lazy
    def terrains(self) -> tuple[ShownTerrain, ...]:
        """What is drawn of the terrains, around all that moves, where it is drawn."""
        places = self.frames.poses[:, :, :3].reshape(-1, 3)
        own = tuple(ShownTerrain.about(part, places, self.shift) for t in self.shown.terrains for part in t.apart())
        return own if self.second is None else own + self.second.terrains

    @property
    def surfaces(self) -> tuple[ShownSurface, ...]:
        """The planes that contacts are on, where they are drawn."""
        own = tuple(surface.moved(self.shift) for surface in self.shown.surfaces)
        return own if self.second is None else own + self.second.surfaces

    def _floors(self) -> str:
        """Height of the terrain under the centre of mass at each frame, packed; empty where there is none."""
        com = self.frames.com
        if not self.shown.terrains or not len(com):
            return ""
        above = np.min([_heights(terrain, com, self.frames.times) for terrain in self.shown.terrains], axis=0)
        return packed(np.where(np.isfinite(above), com[:, 2] - above, 0.0))

    def _stretches(self, name: str) -> list[tuple[float, float, int]]:
        """(from, to, code) of each time in one mode other than "open", for its lane above the bar."""
        code = {word: i for i, word in enumerate(self.words)}
        return [(round(a, 9), round(b, 9), code[mode]) for a, b, mode in self.frames.stretches[name] if mode != OPEN]

    def _carried(self) -> dict[str, object]:
        """What bodies take along: pieces of the robot, frames of joints, collision shapes; and pieces fixed to the world."""
        robot, joints = self.shown.robot, self.frames.joints
        own = len(joints) // 2 if self.frames.ghost else len(joints)
        body = {joint: j for j, joint in enumerate(joints[:own])}
        parts = [{"node": i, "body": body.get(p.joint), "at": _pose(p.placement)} for i, p in enumerate(self.parts)]
        frames = [("frames", i, joint, pin.SE3.Identity()) for i, joint in enumerate(range(1, robot.model.njoints))]
        moving = [(i, s.part) for i, s in enumerate(collision_parts(robot)) if s.part.joint]
        shapes = [("collision", i, part.joint, part.placement) for i, part in moving]
        shapes += [(DRIVES, i, part.joint, part.placement) for i, part in enumerate(self._drives)]
        return {
            "parts": [part for part in parts if part["body"] is not None],
            "fixed": [part for part in parts if part["body"] is None],
            "riders": [{"tree": t, "node": i, "body": body.get(j), "at": _pose(X)} for t, i, j, X in [*frames, *shapes]],
            "lifts": self._lifts(),
            "bodies": len(joints) + self.frames.lifts.shape[1],
            "ghost": {"name": self.frames.ghost, "color": GHOST_COLOR, "bodies": own} if self.frames.ghost else None,
        }

    def _lifts(self) -> list[dict[str, object]]:
        """Of each piece of terrain that has a motion, and of marks that move, the path, and the number of the pose."""
        places = [place for place, shown in enumerate(self.terrains) if shown.terrain.jump is not None]
        known = self.frames.lifts.shape[1] - len(self.carried)
        paths = [f"marks/terrain/{place}" for place in places[:known]] + list(self.carried)
        return [{"path": path, "body": len(self.frames.joints) + i} for i, path in enumerate(paths)]

    def _played(self) -> dict[str, object]:
        """Bodies, contacts, sizes, frames and events."""
        frames, sizes = self.frames, self.sizes
        colors = contact_colors(t.name for t in frames.contacts)
        contacts = [
            {
                "name": t.name,
                "color": colors[t.name],
                "points": t.points.shape[1],
                "supports": carries_weight(t.points, t.forces),
                "normals": _normals(t, self.shown.source),
                "stretches": self._stretches(t.name),
                "disks": _disks(frames.disks.get(t.name)),
            }
            for t in frames.contacts
        ]
        scale = f"{scale_note(sizes.metres_per_newton, sizes.weight_N)} Double arrowhead: not drawn to full length."
        said = [scale] * bool(contacts or frames.pushes) + [ELEMENT_COLORS] * bool(frames.elements)
        said += [missing] if (missing := missing_note(self.parts)) else []
        lanes = {name: color for name, color in self.shown.lanes.items() if name in frames.modes}
        return {
            **self._carried(),
            "name": self.name,
            "times": [round(float(t), 9) for t in frames.times],
            "rows": packed(frames.rows),
            "codes": packed(self.codes, "u1"),
            "events": self.marks(),
            "contacts": contacts,
            "pushes": [
                {"name": t.name, "color": t.color, "points": t.points.shape[1], "aside": t.aside} for t in frames.pushes
            ],
            "elements": [element_look(e, self._element(i), sizes) for i, e in enumerate(frames.elements)],
            "others": list(frames.modes)[len(contacts) :],
            "driven": {name: {"joint": joint, "color": DRIVE_COLOR} for name, joint in self.shown.driven.items()},
            "lanes": [{"name": name, "color": color, "stretches": self._stretches(name)} for name, color in lanes.items()],
            "words": self.words,
            "com": COM_COLOR if len(frames.com) else "",
            "support": SUPPORT_COLOR,
            "ground": self.ground,
            "floors": self._floors(),
            "terrains": [ShownTerrain.about(terrain, NOWHERE).title for terrain in self.shown.terrains],
            "terrainColor": TERRAIN_COLOR,
            "sizes": {
                **{name: getattr(sizes, name) for name in ("body", "shaft", "line", "lift")},
                "longest": self.longest,
                "metresPerNewton": sizes.metres_per_newton,
            },
            "note": " ".join([*said, *frames.left_out]),
        }


def _heights(terrain: Terrain, com: Array, times: Array) -> Array:
    """Heights of the centre of mass above a terrain at each frame; its pieces where they are then."""
    if terrain.jump is None:
        return terrain.heights_of(com)
    return np.array([terrain.at(t).heights_of(point) for t, point in zip(times.tolist(), com, strict=True)])


def _disks(disks: Disks | None) -> dict[str, object] | None:
    if disks is None:
        return None
    codes, normals = packed(disks.codes, "u1"), packed(np.nan_to_num(disks.normals))
    colors, modes = list(disks.colors.values()), list(disks.colors)
    told: dict[str, object] = {"colors": colors, "modes": modes, "codes": codes, "normals": normals}
    if np.isfinite(disks.used).any():
        told["used"] = packed(np.rint(FULL * np.nan_to_num(disks.used, nan=1.0)), "u1")
    return told


def _pose(X: pin.SE3) -> list[float]:
    return [round(float(x), 9) for x in pin.SE3ToXYZQUAT(X)]


def _normals(track: Track, source: Any) -> str:
    """The normals of a contact, packed, shape (n, 3), or (1, 3) where they stay the same; empty where they are not known."""
    found = plane_normals(getattr(source, "planes", {}).get(track.name), track.points, track.forces)
    if found is None or not np.isfinite(found).all():
        return ""
    return packed(found[:1] if np.ptp(found, axis=0).max() < STILL else found)
