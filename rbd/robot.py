"""Robot and load_robot: a checked model with its postures, its feet and a way to stand."""

from __future__ import annotations

import os
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
import pinocchio as pin

from rbd import catalogue
from rbd.arrays import Array
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.errors import InputError, ModelError, ModelWarning, nearest
from rbd.model import CheckedModel
from rbd.posture import configuration, semantic_postures, stand
from rbd.state import State

Root = Literal["free_flyer", "fixed"]


class Robot(CheckedModel):
    """A robot: its checked Pinocchio model, its postures and its feet.

    Made by `load_robot`. Beside what `CheckedModel` has:

    Attributes:
        urdf: The model file.
        root: "free_flyer" or "fixed".
        postures: {name: q, shape (nq,)}, from the SRDF and the catalogue.
    """

    def __init__(self, model: pin.Model, source: catalogue.Source, root: Root, passive: Iterable[str] = ()) -> None:
        super().__init__(model, passive=passive, name=source.name)
        self.source = source
        self.urdf = source.urdf
        self.root: Root = root
        found = {} if source.srdf is None else semantic_postures(self, source.srdf)
        for name, angles in source.postures.items():
            found[name] = configuration(self, angles)
        for q in found.values():
            q.flags.writeable = False
        self.postures = MappingProxyType(found)

    def neutral(self) -> Array:
        """The configuration with every joint at zero, shape (nq,)."""
        return pin.neutral(self.model)

    def posture(self, name: str) -> Array:
        """A named configuration, copied, shape (nq,).

        Raises:
            InputError: with the nearest names.
        """
        if name not in self.postures:
            raise InputError(f"no posture {name!r} of {self.name}; {nearest(name, self.postures)}.")
        return self.postures[name].copy()

    def at(self, q: Array | str | None = None, v: Array | None = None) -> State:
        """The state at a configuration, a named posture, or the neutral one.

        Args:
            q: Configuration (nq,), the name of a posture, or None.
            v: Velocity (nv,); zero if not given.
        """
        return State(self, self.neutral() if q is None else self.posture(q) if isinstance(q, str) else q, v)

    def standing(self, posture: str | None = None) -> State:
        """At rest on its feet: soles (or points) on z = 0, the base turned so that they lie flat.

        A robot on point feet is then turned about them until its centre of mass is over its support. A fixed-base robot
        keeps its base.

        Args:
            posture: A name in `postures`; by default the one the catalogue names.

        Raises:
            InputError: an unknown posture.
            ModelError: neither a posture nor feet are known for this robot.
        """
        name = posture or self.source.posture
        if name is None and len(self.postures) == 1:
            name = next(iter(self.postures))
        if self.root == "fixed":
            return self.at(name)
        feet = self.feet(friction=None)
        if name is None:
            raise ModelError(
                f"no standing posture is known for {self.name}; {nearest('standing', self.postures)}. "
                "Name one, standing(posture), or build a State with your own q."
            )
        return State(self, stand(self, self.posture(name), feet))

    def soles(self, friction: float | None = 0.7, *, facets: int = 4) -> list[SurfaceContact]:
        """The soles of its feet as surface contacts, from the catalogue.

        Args:
            friction: Coulomb's coefficient; None for contacts that hold.
            facets: Facets of the corner pyramids in a QP.

        Raises:
            ModelError: no soles are known; a robot on point feet has `feet`.
        """
        feet = self.feet(friction, facets=facets)
        soles = [foot for foot in feet if isinstance(foot, SurfaceContact)]
        if len(soles) != len(feet):
            raise ModelError(f"{self.name} stands on points; use robot.feet() in place of soles().")
        return soles

    def feet(self, friction: float | None = 0.7, *, facets: int = 4) -> list[SurfaceContact | PointContact]:
        """Its feet as contacts: soles or points, from the catalogue. Arguments as `soles`.

        Raises:
            ModelError: no feet are known for this robot.
        """
        if not self.source.feet:
            raise ModelError(
                f"no feet are known for {self.name}: its file names none. Give your own: "
                "rbd.SurfaceContact(name, frame, half_lengths=(X, Y)) or rbd.PointContact(name, frame)."
            )
        out: list[SurfaceContact | PointContact] = []
        for foot in self.source.feet:
            if foot.kind == "point":
                point = PointContact(foot.name, foot.frame, offset=foot.translation, friction=friction, facets=facets)
                out.append(point)
                continue
            X_FP = pin.SE3(foot.rotation, np.array(foot.translation))
            out.append(
                SurfaceContact(
                    foot.name, foot.frame, corners=foot.corners, placement=X_FP, friction=friction, facets=facets
                )
            )
        return out

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Meshes and shapes to draw; empty, with a warning, where they cannot be read."""
        return self._geometry(pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes; empty, with a warning, where they cannot be read."""
        return self._geometry(pin.GeometryType.COLLISION)

    def _geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        folders = [str(folder) for folder in self.source.package_dirs]
        try:
            if _is_mjcf(self.urdf):
                return pin.buildGeomFromMJCF(self.model, str(self.urdf), kind)
            return pin.buildGeomFromUrdf(self.model, str(self.urdf), kind, package_dirs=folders)
        except (ValueError, RuntimeError) as error:
            warnings.warn(
                f"the {kind.name.lower()} geometry of {self.name} is left out: {_first_line(error)} Give the folder "
                "above its packages: load_robot(..., package_dirs=[folder]).",
                ModelWarning,
                stacklevel=3,
            )
            return pin.GeometryModel()


def load_robot(
    name_or_path: str | os.PathLike[str],
    *,
    root: Root = "free_flyer",
    passive: Sequence[str] = (),
    package_dirs: Iterable[str | os.PathLike[str]] = (),
) -> Robot:
    """A robot by its short name, by the name of a file of example-robot-data, or by the path of a URDF or MJCF file.

    Args:
        name_or_path: "talos", "g1", "panda", "tiago_dual", "my/robot.urdf", ...
        root: "free_flyer" gives it six unactuated coordinates, position and quaternion; "fixed" welds its root link to the
            world (and so drops that link's mass).
        passive: Joints that carry no motor.
        package_dirs: Folders that hold the packages of `package://` meshes.

    Raises:
        UnknownRobot: no such robot; the nearest names are in the message.
        JointNotFound: an unknown passive joint.
        ModelError: a missing or broken file.
    """
    if root not in ("free_flyer", "fixed"):
        raise InputError(f"root is {root!r}; expected 'free_flyer' or 'fixed'.")
    source = catalogue.find(name_or_path, package_dirs)
    return Robot(_build(source, root), source, root, passive)


def _build(source: catalogue.Source, root: Root) -> pin.Model:
    path = str(source.urdf)
    try:
        tag = ElementTree.parse(path).getroot().tag
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError, OSError) as error:
        raise ModelError(f"{source.urdf.name} cannot be read as XML: {error}.") from None
    if tag not in ("robot", "mujoco"):
        raise ModelError(f"{source.urdf.name} is no robot: its first element is <{tag}>; expected <robot> or <mujoco>.")
    try:
        if tag == "mujoco":
            model = pin.buildModelFromMJCF(path)
        elif root == "free_flyer":
            model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
        else:
            model = pin.buildModelFromUrdf(path)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"Pinocchio cannot build {source.urdf.name}: {_first_line(error)}") from None
    if model.nv == 0:
        raise ModelError(f"nothing moves in {source.urdf.name}: it has no joints, and its root is fixed.")
    for i, inertia in enumerate(model.inertias):
        if not np.isfinite(inertia.toDynamicParameters()).all():
            raise ModelError(f"the body behind joint {model.names[i]!r} of {source.urdf.name} has an inertia of NaN or inf.")
    return model


def _is_mjcf(path: Path) -> bool:
    return path.suffix == ".xml"


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
