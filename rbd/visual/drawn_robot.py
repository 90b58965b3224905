"""The robot of a scene in the viewer: its pieces, where they are, and further poses of it beside them."""

from __future__ import annotations

import meshcat
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.robots.robot import Robot
from rbd.visual.drawing import send_part
from rbd.visual.other_poses import OtherPoses
from rbd.visual.pages.recorder import Recorder
from rbd.visual.robot_layers import bodies, collision_parts
from rbd.visual.robot_meshes import RobotPart, robot_parts
from rbd.visual.shapes import outermost


class DrawnRobot:
    """A robot in a viewer. Its pieces are sent when it is placed first.

    Args:
        robot: The robot.
        viewer: Where it is drawn: piece i at `robot/i`, collision shape i at `collision/i`, other poses below `beside`.
        recorder: Gets the names of its bodies.
    """

    def __init__(self, robot: Robot, viewer: meshcat.Visualizer, recorder: Recorder) -> None:
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
        """Draw further poses in place of those drawn, each in its colour."""
        assert self._parts is not None
        self._viewer["beside"].delete()
        if self.poses:  # the robot gets its own colours back
            self._send()
            self._move()
        self.poses = poses
        found = poses.send(self._viewer, self._parts, self.data, self._robot.model)
        self.further = np.vstack([np.zeros((0, 3)), *(self._extremes(data) for data in found)])

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
        points = [np.zeros((0, 3))]
        for part in self._parts or ():
            X_WG = data.oMi[part.joint] * part.placement
            points.append(part.mesh.placed(X_WG.rotation, X_WG.translation).vertices)
        return outermost(np.vstack(points)) if self._parts else np.zeros((1, 3))
