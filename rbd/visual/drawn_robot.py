"""The robot of a scene in the viewer: its pieces, where they are, and further poses at the same place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.state import State
from rbd.robots.robot import Robot
from rbd.visual.marks.picture import Entry, entry
from rbd.visual.packed_meshes import send_part
from rbd.visual.pages.recorder import Recorder, ViewerNode
from rbd.visual.robot_layers import bodies, collision_parts
from rbd.visual.robot_meshes import RobotPart, robot_parts
from rbd.visual.shapes import Mesh, joined, outermost
from rbd.visual.style import distinct_colors, rgb

POSE_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc5fa0", "#e0a800", "#5e4fa2", "#56b4e9", "#8a3a12")
"""Colours that differ from each other, also on a dark side, and from the grey of fixed parts."""
Details: TypeAlias = Mapping[str, Sequence[str]] | None
"""{pose: lines below its name in the legend}."""
SAME = 1e-4
"""Parts coincide if centre and extent differ by less than this share of the robot's size."""
OPACITY = 0.55
"""Of poses beside a robot that keeps its own colours."""
MOST_CUT = 3000
"""Triangles of larger meshes are small: they go to the stripe of their middle, uncut."""
STRIPES = 2
"""How often each pose's colour comes on a bar that several poses share."""
APART = 0.2
"""Least distance of two colours, of red, green and blue from 0 to 1: grey (0.35) and a dark blue are 0.3 apart."""


@dataclass(eq=False)
class PlacedPart:
    """A part of the robot in one of the poses.

    Attributes:
        number: Its place among the robot's parts.
        part: The part, in the colour of the pose; only its stripes, where another pose has a part at the same place.
        X_WG: Its pose in W.
    """

    number: int
    part: RobotPart
    X_WG: pin.SE3


def check_poses(robot: Robot, states: Mapping[str, State], shown: str) -> None:
    """Refuse what are no poses of a robot.

    Raises:
        InputError: no mapping of names to states, or states of another size.
    """
    if not isinstance(states, Mapping) or not all(isinstance(name, str) for name in (*states, shown)):
        raise InputError(f"states are {states!r:.80}, shown is {shown!r:.80}; expected {{name: rbd.State}} and a name.")
    for name, state in states.items():
        if not isinstance(state, State) or len(state.q) != robot.model.nq:
            raise InputError(f"{name!r} is no state of {robot.name!r}; expected rbd.State(robot, q).")


@dataclass(eq=False)
class OtherPoses:
    """The robot in further poses beside the one shown, with what the legend says of them.

    Attributes:
        states: {name: where the robot is}.
        shown: Name of the pose shown, if it gets one colour too.
        details: {name: lines below the name in the legend}.
        note: A line below the legend.
        colors: {name: '#rrggbb'}, once they are sent.
    """

    states: Mapping[str, State]
    shown: str = ""
    details: Mapping[str, Sequence[str]] = field(default_factory=dict)
    note: str = ""
    colors: dict[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.states or self.shown)

    def entries(self) -> list[Entry]:
        """Their entries in the legend."""
        return [entry(color, name, detail=", ".join(self.details.get(name, ())), layer="other poses")
                for name, color in self.colors.items()]  # fmt: skip


def placed_parts(parts: Sequence[RobotPart], poses: Sequence[pin.Data], colors: Sequence[str | None]) -> list[list[PlacedPart]]:
    """The robot's moving parts in each pose. Where the parts of k poses coincide, each pose has every k-th stripe.

    Of a body with solid parts its translucent ones (ellipsoids of inertia, collision shapes of a skeleton) are left out.

    Args:
        parts: Of the robot.
        poses: Pinocchio's data of each pose, after forward kinematics.
        colors: '#rrggbb' of each pose; None: the parts keep theirs.
    """
    solid = {part.joint for part in parts if part.opacity == 1.0}
    drawn = [(i, p) for i, p in enumerate(parts) if p.joint and (p.opacity == 1.0 or p.joint not in solid)]
    out: list[list[PlacedPart]] = []
    for data, color in zip(poses, colors, strict=True):
        colored = [(i, part if color is None else replace(part, color=color)) for i, part in drawn]
        out.append([PlacedPart(i, part, data.oMi[part.joint] * part.placement) for i, part in colored])
    for it, rank, count in _shared(out):
        it.part = replace(it.part, mesh=striped(it.part.mesh, rank, count))
    return out


def _shared(poses: Sequence[Sequence[PlacedPart]]) -> list[tuple[PlacedPart, int, int]]:
    """Each part that coincides with one of another pose, with the rank of its pose among these, and how many these are."""
    every = [(k, it) for k, pose in enumerate(poses) for it in pose]
    if not every:
        return []
    kinds = np.array([_signature(it.part.mesh, it.X_WG) for _, it in every])
    size = float(np.ptp(kinds[:, :3], axis=0).max()) + float(np.abs(kinds[:, 3:]).max()) or 1.0
    near = [np.flatnonzero(np.abs(kinds - kind).max(axis=1) < SAME * size) for kind in kinds]
    sharing = [sorted({every[j][0] for j in there}) for there in near]
    return [(it, poses.index(k), len(poses)) for (k, it), poses in zip(every, sharing, strict=True) if len(poses) > 1]


def _signature(mesh: Mesh, X_WG: pin.SE3) -> Array:
    """What two parts at one place have in common, also if one is turned by half a turn: centre and extent, shape (9,) [m]."""
    points = mesh.placed(X_WG.rotation, X_WG.translation).vertices
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    spread = np.cov((points - points.mean(axis=0)).T, bias=True)
    values, vectors = np.linalg.eigh(spread)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.concatenate([centre, root[np.triu_indices(3)]])


def striped(mesh: Mesh, rank: int, count: int) -> Mesh:
    """Every `count`-th stripe of a mesh across its longest side, from stripe `rank` on: all of them together are the mesh."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    axis = int(np.argmax(high - low))
    edges = np.linspace(low[axis], high[axis], STRIPES * count + 1)
    return joined([_between(mesh, axis, edges[i], edges[i + 1]) for i in range(rank, STRIPES * count, count)])


def _between(mesh: Mesh, axis: int, low: float, high: float) -> Mesh:
    """The part of a mesh with low <= x[axis] <= high; triangles are cut there."""
    corners = mesh.vertices[mesh.faces]
    along = corners[:, :, axis]
    if len(mesh.faces) > MOST_CUT:
        middle = along.mean(axis=1)
        return _kept(mesh, (middle >= low) & (middle < high))
    whole = (along >= low).all(axis=1) & (along <= high).all(axis=1)
    cut = ~whole & (along.max(axis=1) > low) & (along.min(axis=1) < high)
    out = [_kept(mesh, whole)]
    for triangle in corners[cut]:
        polygon = _clipped(_clipped(list(triangle), axis, low, 1.0), axis, high, -1.0)
        if len(polygon) > 2:
            fan = np.array([(0, i, i + 1) for i in range(1, len(polygon) - 1)])
            out.append(Mesh(np.array(polygon), fan))
    return joined(out)


def _kept(mesh: Mesh, which: Array) -> Mesh:
    used, faces = np.unique(mesh.faces[which], return_inverse=True)
    return Mesh(mesh.vertices[used], np.reshape(faces, (-1, 3)).astype(int))


def _clipped(polygon: list[Array], axis: int, at: float, side: float) -> list[Array]:
    """A polygon's part with side (x[axis] - at) >= 0."""
    out: list[Array] = []
    for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
        over = [side * (float(p[axis]) - at) for p in (a, b)]
        if over[0] >= 0.0:
            out.append(a)
        if over[0] * over[1] < 0.0:
            out.append(a + (b - a) * over[0] / (over[0] - over[1]))
    return out


def pose_colors(n: int, taken: Iterable[str]) -> list[str]:
    """N colours that differ from each other, from grey, and as far as there are enough from those that are taken.

    Args:
        n: How many.
        taken: '#rrggbb' of what else is in the picture.
    """
    seen = [np.array(rgb(color)) for color in set(taken)]
    every, out = [*POSE_COLORS, *distinct_colors(n + 40)], list[str]()
    for color in every:
        parts = np.array(rgb(color))
        near = min((float(np.linalg.norm(parts - other)) for other in seen), default=1.0) < APART
        if not near and np.ptp(parts) >= APART:
            out.append(color)
            seen.append(parts)
    return list(dict.fromkeys(out + every))[:n]


class DrawnRobot:
    """A robot in a viewer. Its pieces are sent when it is placed first.

    Args:
        robot: The robot.
        viewer: Where it is drawn: piece i at `robot/i`, collision shape i at `collision/i`, other poses below `beside`.
        recorder: Gets the names of its bodies.
    """

    def __init__(self, robot: Robot, viewer: ViewerNode, recorder: Recorder) -> None:
        self._robot, self._viewer, self._recorder = robot, viewer, recorder
        self._parts: tuple[RobotPart, ...] | None = None
        self._cloud: Array | None = None
        self._q = np.zeros(0)
        self.data: pin.Data = robot.model.createData()
        """Pinocchio's data of the pose drawn."""
        self.poses = OtherPoses({})
        """Further poses."""
        self.further = np.zeros((0, 3))
        """The outermost points of the further poses in W, shape (n, 3) [m]."""

    @property
    def cloud(self) -> Array:
        """The outermost points of the robot in W, shape (n, 3) [m]: all that is needed to measure and frame it."""
        if self._cloud is None:  # costly, and the same until the next pose
            self._cloud = self._extremes(self.data)
        return self._cloud

    def place(self, q: Array, *, again: bool = False) -> None:
        """Put the robot into a configuration, shape (nq,); `again` also where it is there, as after a motion of the page."""
        if self._parts is None:
            self._parts = robot_parts(self._robot)
            self._send()
        elif np.array_equal(q, self._q) and not again:
            return
        self._q, self._cloud = np.array(q, float), None
        pin.forwardKinematics(self._robot.model, self.data, self._q)
        self._move()
        if self.poses:
            self.draw_poses(self.poses)

    def draw_poses(self, poses: OtherPoses) -> None:
        """Draw further poses in place of those drawn, each in its colour.

        Without `poses.shown` the robot keeps its colours, and the others are translucent.
        """
        assert self._parts is not None
        self._viewer["beside"].delete()
        if self.poses:  # the robot gets its own colours back
            self._send()
            self._move()
        self.poses, shown, model = poses, poses.shown, self._robot.model
        found = {name: model.createData() for name in poses.states}
        for name, data in found.items():
            pin.forwardKinematics(model, data, np.asarray(poses.states[name].q, float))
        self.further = np.vstack([np.zeros((0, 3)), *(self._extremes(data) for data in found.values())])
        if not poses:
            return
        fixed = [part.color for part in self._parts if shown == "" or not part.joint]
        names = list(dict.fromkeys([*([shown] if shown and shown not in found else []), *found]))
        poses.colors = colors = dict(zip(names, pose_colors(len(names), fixed), strict=True))
        others = {name: data for name, data in found.items() if not shown or name != shown}
        every, colored = [self.data, *others.values()], [colors.get(shown), *(colors[name] for name in others)]
        own, *rest = placed_parts(self._parts, every, colored)
        for it in own:
            if shown or it.part.mesh is not self._parts[it.number].mesh:
                send_part(self._viewer, f"robot/{it.number}", it.part, nearer=len(every))
        for k, each in enumerate(rest):
            for it in each:
                part = it.part if shown else replace(it.part, opacity=OPACITY)
                # Nearer than the next pose by a step of depth: surfaces in one plane do not flicker.
                send_part(self._viewer, f"beside/{k}/{it.number}", part, nearer=len(rest) - k)
                self._viewer[f"beside/{k}/{it.number}"].set_transform(it.X_WG.homogeneous)
        for i, part in enumerate(self._parts):
            if shown and part.joint and i not in {it.number for it in own}:
                self._viewer[f"robot/{i}"].delete()

    def _send(self) -> None:
        for path, part in self._pieces():
            send_part(self._viewer, path, part)
        self._recorder.post("bodies", bodies(self._robot, self._parts or ()))

    def _move(self) -> None:
        for path, part in self._pieces():
            self._viewer[path].set_transform((self.data.oMi[part.joint] * part.placement).homogeneous)

    def _pieces(self) -> list[tuple[str, RobotPart]]:
        pieces = [(f"robot/{i}", part) for i, part in enumerate(self._parts or ())]
        return pieces + [(f"collision/{i}", shape.part) for i, shape in enumerate(collision_parts(self._robot))]

    def _extremes(self, data: pin.Data) -> Array:
        placed = [(part.mesh, data.oMi[part.joint] * part.placement) for part in self._parts or ()]
        points = [mesh.placed(X_WG.rotation, X_WG.translation).vertices for mesh, X_WG in placed]
        return outermost(np.vstack(points)) if points else np.zeros((1, 3))
