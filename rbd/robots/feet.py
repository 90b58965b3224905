"""Feet of a robot as contacts, and feet that a user registers, as frames or contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from rbd.constraints.contact import Contact
from rbd.constraints.contact_kinds import PointContact, SurfaceContact
from rbd.errors import DuplicateName, InputError, ModelError
from rbd.model.checked_model import CheckedModel
from rbd.model.meshes import Geometry
from rbd.model.state import State
from rbd.problem.cones import Cone
from rbd.problem.ground import On, surfaces_of
from rbd.robots.catalogue import Foot
from rbd.robots.underside import Underside, sole_of, underside_of


def contacts_of(
    feet: Sequence[Foot], friction: float | Cone | None, facets: int, on: On | Mapping[str, On]
) -> list[SurfaceContact | PointContact]:
    """Feet as contacts; see `rbd.Robot.feet`."""
    planes = surfaces_of([foot.name for foot in feet], on)
    out: list[SurfaceContact | PointContact] = []
    for foot in feet:
        name, frame, plane = foot.name, foot.frame, planes[foot.name]
        if foot.kind == "point":
            out.append(PointContact(name, frame, offset=foot.translation, friction=friction, facets=facets, on=plane))
            continue
        X_FP = pin.SE3(foot.rotation, np.array(foot.translation))
        out.append(
            SurfaceContact(name, frame, corners=foot.corners, placement=X_FP, friction=friction, facets=facets, on=plane)
        )
    return out


def soles_at(robot: CheckedModel, collision: Geometry, frames: Sequence[str], at: State) -> tuple[Foot, ...]:
    """The flat undersides of some frames' bodies; see `rbd.Robot.soles_from_collision`.

    Raises:
        InputError: not a list of names.
        FrameNotFound: with the nearest names.
        ModelError: a foot without collision shapes, or with fewer than three points of contact.
    """
    if isinstance(frames, str) or not np.iterable(frames):
        raise InputError(f"frames is {frames!r:.80}; expected a list of frames' names, one a foot.")
    return tuple(_of_underside(frame, sole_of(robot, collision, frame, at)) for frame in frames)


def registered(robot: CheckedModel, collision: Geometry, feet: Sequence[str | Contact], at: State) -> tuple[Foot, ...]:
    """Feet as frames or contacts, checked; see `rbd.load_robot`.

    Args:
        robot: The robot.
        collision: Its collision geometry.
        feet: Frames, or contacts at one point or at three or more.
        at: A state in which the feet are down.

    Raises:
        InputError: other objects, an empty list, edges.
        DuplicateName: two feet have one name.
        FrameNotFound: with the nearest names.
        ModelError: a frame's body has no collision shapes, or stands on an edge.
    """
    if isinstance(feet, str | Mapping) or hasattr(feet, "rows") or not np.iterable(feet) or not len(found := list(feet)):
        raise InputError(
            f"feet is {feet!r:.80}; expected a list of frames' names, ['left_ankle', 'right_ankle'], or of contacts, "
            "rbd.SurfaceContact(name, frame, ...)."
        )
    out: list[Foot] = []
    for each in found:
        if isinstance(each, str):
            foot = _of_frame(robot, collision, each, at)
        elif isinstance(each, Contact):
            foot = _of_contact(robot, each)
        else:
            raise InputError(f"feet has {each!r:.80}; expected a frame's name or a contact, rbd.SurfaceContact(...).")
        if any(foot.name == other.name for other in out):
            raise DuplicateName(f"two feet are called {foot.name!r:.80}; give each its own name.")
        out.append(foot)
    return tuple(out)


def _of_frame(robot: CheckedModel, collision: Geometry, frame: str, at: State) -> Foot:
    found = underside_of(robot, collision, frame, at)
    if len(found.corners) == 1:
        x, y, z = found.X_FP.act(np.array([*found.corners[0], 0.0])).tolist()
        return Foot(frame, frame, "point", (x, y, z))
    if len(found.corners) == 2:
        raise ModelError(
            f"the body of frame {frame!r:.80} of {robot.name} stands on an edge. Give its foot as a contact: "
            "rbd.SurfaceContact(name, frame, corners=..., placement=...)."
        )
    return _of_underside(frame, found)


def _of_underside(frame: str, sole: Underside) -> Foot:
    return _sole(frame, frame, sole.X_FP, sole.corners)


def _of_contact(robot: CheckedModel, contact: Contact) -> Foot:
    robot.site(contact.frame)
    if len(contact.corners) == 2:
        raise InputError(f"foot {contact.name!r:.80} is an edge; expected rbd.SurfaceContact or rbd.PointContact.")
    if len(contact.corners) == 1:
        x, y, z = contact.placement.act(np.array(contact.corners[0])).tolist()
        return Foot(contact.name, contact.frame, "point", (x, y, z))
    return _sole(contact.name, contact.frame, contact.placement, contact.corners)


def _sole(name: str, frame: str, X_FP: pin.SE3, corners: np.ndarray) -> Foot:
    x, y, z = X_FP.translation.tolist()
    roll, pitch, yaw = pin.rpy.matrixToRpy(X_FP.rotation).tolist()
    return Foot(name, frame, "sole", (x, y, z), (roll, pitch, yaw), tuple(tuple(corner) for corner in corners.tolist()))
