"""The shapes of a robot, to draw and to touch with; of a robot of a user's file also the file's text and its meshes."""

from __future__ import annotations

import os.path
import warnings
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pinocchio as pin

from rbd.arrays import lazy
from rbd.constraints.contact import SurfaceContact
from rbd.constraints.surface import On
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.model.checked_model import CheckedModel
from rbd.model.files import RobotFile
from rbd.model.input_files import MOST_BYTES, FileLimits, find_mesh, read_xml
from rbd.model.meshes import Geometry, load_geometry, mesh_files
from rbd.model.output_files import new_folder, write_file
from rbd.model.state import State
from rbd.robots.catalogue import RobotSource
from rbd.robots.feet import contacts_of, soles_at

SMALL_BYTES = 500_000
"""Meshes of collision shapes that are together no larger go with every pickle of the robot."""
_DEEP = "a/a/a/a/a/a/a/a"
"""A mesh can be named by a path that goes up from the robot's file, "../meshes/foot.stl"."""


class ShapedRobot(CheckedModel):
    """A robot with shapes. A robot of the catalogue reads them from its file on first use, others from the text they keep."""

    source: RobotSource
    limits: FileLimits
    _text: bytes | None = None
    _mesh_names: tuple[tuple[str, str], ...] = ()
    _mesh_files: dict[str, bytes] | None = None
    _pairs: tuple[tuple[int, int], ...] = ()

    def _keep_text(self, file: RobotFile) -> None:
        """Keep the text of a user's file, compressed, and the names of the meshes of its collision shapes."""
        self._text = zlib.compress(ElementTree.tostring(file.element), 6)
        self._mesh_names = file.collision_meshes()

    @property
    def element(self) -> ElementTree.Element:
        """The first element of its file, as it was loaded; of a robot of the catalogue as the file is now.

        Raises:
            ModelError: the file cannot be read.
        """
        if self._text is None:
            return read_xml(self.source.urdf, self.limits)
        return ElementTree.fromstring(zlib.decompress(self._text))

    @property
    def text(self) -> str:
        """The text of its file as it was loaded, without comments; of a robot of the catalogue as the file is now.

        Raises:
            ModelError: the file cannot be read.
        """
        if self._text is None:
            return ElementTree.tostring(self.element, encoding="unicode")
        return zlib.decompress(self._text).decode()

    @lazy
    def visual_model(self) -> pin.GeometryModel:
        """Meshes and shapes to draw, boxes in place of meshes that cannot be loaded; the first use warns of those."""
        return self._visual.model

    @lazy
    def _visual(self) -> Geometry:
        return self._geometry(pin.GeometryType.VISUAL)

    @lazy
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes, boxes in place of meshes that cannot be loaded; the first use warns of those."""
        return self._collision.model

    @property
    def visual_stand_ins(self) -> frozenset[str]:
        """Names in `visual_model` of the boxes that replace meshes that cannot be loaded."""
        return self._visual.stand_ins

    @property
    def collision_stand_ins(self) -> frozenset[str]:
        """Names in `collision_model` of the boxes that replace meshes that cannot be loaded."""
        return self._collision.stand_ins

    def has_read(self, kind: str) -> bool:
        """Whether its "visual" or "collision" shapes are in memory."""
        return f"_{kind}" in self.__dict__

    @property
    def stand_ins(self) -> frozenset[str]:
        """Names of the boxes that replace meshes, in the shapes that are in memory."""
        read = [self.__dict__[name] for name in ("_visual", "_collision") if name in self.__dict__]
        return frozenset(name for geometry in read for name in geometry.stand_ins)

    def mesh_files(self) -> tuple[Path, ...] | None:
        """The meshes that its file names; None where they are not all files of its folders, or it is no URDF."""
        return None if self._mesh_files is not None else mesh_files(self.element, self.source.place, self.source.package_dirs)

    @lazy
    def _collision(self) -> Geometry:
        found = self._geometry(pin.GeometryType.COLLISION)
        for one, other in self._pairs:
            found.model.addCollisionPair(pin.CollisionPair(one, other))
        return found

    def _geometry(self, kind: pin.GeometryType) -> Geometry:
        path, folders = self.source.place, self.source.package_dirs
        if self._mesh_files is not None:
            here = self._mesh_folder
            path, folders = here / _DEEP / path.name, (here / _DEEP, here, path.parent, *folders)
        found = load_geometry(self.model, self.element, path, folders, kind, self.limits)
        if found.complaint:
            warnings.warn(f"the {kind.name.lower()} geometry of {self.name} {found.complaint}", ModelWarning, stacklevel=4)
        return found

    @lazy
    def _mesh_folder(self) -> Path:
        """A folder of this process with the meshes that came with the robot."""
        assert self._mesh_files is not None
        here = new_folder()
        (here / _DEEP).mkdir(parents=True)
        for name, data in self._mesh_files.items():
            place = here / name
            place.parent.mkdir(parents=True, exist_ok=True)
            write_file(place, lambda file, data=data: file.write(zlib.decompress(data)), ModelError)  # type: ignore[misc]
        return here

    def soles_from_collision(
        self,
        frames: Sequence[str],
        friction: float | None = 0.7,
        *,
        at: State | None = None,
        facets: int = 4,
        on: On | Mapping[str, On] = 0.0,
    ) -> list[SurfaceContact]:
        """The flat undersides of its feet as surface contacts, from the collision shapes of its file.

        For a robot that the catalogue does not know. A sole is the convex hull of all points of the foot's shapes within
        2 mm of the lowest plane (a ball gives its lowest point), without corners that add little area; it is on
        that plane.

        Args:
            frames: A frame on each foot; the contacts are called like them.
            friction: Coulomb's coefficient; None for bilateral contacts.
            at: Where the feet are flat on level ground; by default in the standing posture, if one is known, else the
                neutral one. Feet may lean up to 20 degrees.
            facets: Facets of the corner pyramids in a QP.
            on: The ground under them, as in `soles`, the feet by the names of their frames.

        Raises:
            FrameNotFound: with the nearest names.
            ModelError: a foot without collision shapes, or one that touches at less than three points.

        >>> rbd.load_robot("g1").soles_from_collision(["left_ankle_roll_link"])[0].corners.shape
        (4, 3)
        """
        at = self._down() if at is None else at
        if not isinstance(at, State) or not self.is_like(at.robot):
            raise InputError(f"at is {at!r:.80}; expected a State of {self.name}: robot.at(q).")
        soles = contacts_of(soles_at(self, self._collision, frames, at), friction, facets, on)
        return [sole for sole in soles if isinstance(sole, SurfaceContact)]

    def _down(self) -> State:
        """The state in which feet are assumed to be down."""
        raise NotImplementedError

    def _extras(self) -> tuple[Any, ...]:
        """The collision pairs, as numbers of shapes, and the motors."""
        return self._touching_pairs(), super()._extras()

    def _take_extras(self, extras: tuple[Any, ...]) -> None:
        self._pairs, motors = extras
        super()._take_extras(motors)

    def _touching_pairs(self) -> tuple[tuple[int, int], ...]:
        found = self.__dict__.get("_collision")
        return self._pairs if found is None else tuple((int(p.first), int(p.second)) for p in found.model.collisionPairs)

    def _files(self) -> dict[str, bytes] | None:
        """The meshes of its collision shapes, if they are small or were used."""
        if self._mesh_files is not None or not self._mesh_names:
            return self._mesh_files
        return self._packed_meshes if "_collision" in self.__dict__ or self._measured <= SMALL_BYTES else None

    def _share_shapes(self, out: ShapedRobot) -> None:
        """Give a copy of this robot its text, its meshes, and copies of the shapes that were read."""
        out._text, out._mesh_names, out._mesh_files = self._text, self._mesh_names, self._mesh_files
        if (found := self.__dict__.get("_collision")) is not None:
            out.__dict__["_collision"] = replace(found, model=found.model.copy())
        if (drawn := self.__dict__.get("_visual")) is not None:
            out.__dict__["_visual"] = replace(drawn, model=drawn.model.copy())

    def _take_files(self, files: dict[str, bytes]) -> None:
        if self._mesh_files is None:
            self._mesh_files = files
            found = self.__dict__.get("_collision")
            if found is not None and found.stand_ins:
                del self.__dict__["_collision"]
                self.__dict__.pop("collision_model", None)

    @lazy
    def _measured(self) -> int:
        """Bytes of the meshes of its collision shapes."""
        return sum(path.stat().st_size for _, path in self._mesh_places())

    def _mesh_places(self) -> list[tuple[str, Path]]:
        """(place in a folder, file) of each mesh that is there and can be carried."""
        folder, out = self.source.urdf.parent, []
        for name, place in self._mesh_names:
            by_package = name.startswith("package://")
            inside = os.path.normpath(place.lstrip("/") if by_package else os.path.join(_DEEP, place))
            if os.path.isabs(inside) or inside.startswith(".."):
                continue  # named by a whole path
            try:
                file = find_mesh(name if by_package else place, folder, (folder, *self.source.package_dirs))
                if file.stat().st_size <= MOST_BYTES:
                    out.append((inside, file))
            except (ModelError, OSError):
                continue  # the first use of the shapes tells
        return out

    @lazy
    def _packed_meshes(self) -> dict[str, bytes] | None:
        """{place: bytes, compressed} of those meshes; None if there are none, or not all of an MJCF, whose masses need them."""
        places = dict(self._mesh_places())
        if not places or (len(places) < len(self._mesh_names) and self.element.tag == "mujoco"):
            return None
        return {place: zlib.compress(file.read_bytes(), 6) for place, file in places.items()}
