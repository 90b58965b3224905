"""The shapes of a robot's file as a Pinocchio geometry, with boxes in place of meshes that cannot be read.

Every mesh is found and looked at here; what Pinocchio is given names only files that passed, by their resolved paths.
So no file outside the package folders is opened, regardless of `..`, links or the environment.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import ModelError
from rbd.model.input_files import LARGEST, MISSING, OUTSIDE, FileLimits, check_mesh, check_scale, find_mesh
from rbd.model.mjcf import LEAVABLE, Mjcf, carry_out_includes, pose, read_mjcf

Element = ElementTree.Element
STAND_IN_M = 0.05
"""Side of the box that replaces a mesh if the link's inertia does not determine it."""
MOST_NAMES = 12
WHOLE = (".stl", ".dae", ".obj")
"""Kinds of meshes whose triangles are in one file."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Shapes of one kind.

    Attributes:
        model: Pinocchio's geometry.
        stand_ins: Names in `model` of the boxes that replace meshes.
        complaint: What could not be had, and what to do; empty when all is well.
    """

    model: pin.GeometryModel
    stand_ins: frozenset[str] = frozenset()
    complaint: str = ""


def load_geometry(
    model: pin.Model,
    element: Element,
    path: Path,
    package_dirs: Iterable[Path],
    kind: pin.GeometryType,
    limits: FileLimits = FileLimits(),  # noqa: B008  frozen
) -> Geometry:
    """The visual or collision shapes of a robot's file.

    Args:
        model: Built from the same file.
        element: The file's first element, <robot> or <mujoco>; it is not changed.
        path: The file.
        package_dirs: Where `package://` starts from; meshes are opened only inside these folders, links resolved.
        kind: pin.GeometryType.VISUAL or COLLISION.
        limits: For the files that an MJCF includes.
    """
    if element.tag == "mujoco":
        return _mjcf(model, copy.deepcopy(element), path, kind, tuple(package_dirs), limits)
    meshes = _Meshes(path.parent, tuple(package_dirs))
    reason = ""
    for attempt in (meshes.read_each, meshes.read_each, None):
        # A first pass reads every mesh once. Only if that fails are they read one by one, to find which cannot be.
        try:
            found, stand_ins = _built(model, copy.deepcopy(element), kind, meshes)
        except (ValueError, RuntimeError, IndexError) as error:
            reason = str(error).strip().split("\n")[0].rstrip(".")
            if attempt is None or not attempt():
                break
            continue
        if meshes.all_finite(found):
            return Geometry(found, stand_ins, _complaint(meshes.refused))
    return Geometry(pin.GeometryModel(), complaint=f"is left out, as it cannot be built: {reason}.")


def mesh_files(element: Element, path: Path, package_dirs: Iterable[Path]) -> tuple[Path, ...] | None:
    """The meshes that a URDF names, resolved, in its order; None of another file, or where one cannot be had.

    Args:
        element: The file's first element.
        path: The file.
        package_dirs: Where `package://` starts from.
    """
    folders = tuple(package_dirs)
    try:
        found = tuple(find_mesh(mesh.get("filename", ""), path.parent, folders) for mesh in element.iter("mesh"))
    except ModelError:
        return None
    return found if element.tag == "robot" and all(file.suffix.lower() in WHOLE for file in found) else None


def _built(
    model: pin.Model, element: Element, kind: pin.GeometryType, meshes: _Meshes
) -> tuple[pin.GeometryModel, frozenset[str]]:
    tag = "visual" if kind == pin.GeometryType.VISUAL else "collision"
    stand_ins = frozenset(_replaced(element, tag, meshes))
    capsules = {kind: dict(_capsules(element, kind)) for kind in ("visual", "collision")}[tag]
    for joint in element.iterfind("joint[@type='spherical']"):  # see rbd.model.files
        joint.set("type", "floating")
    text = ElementTree.tostring(element, encoding="unicode")
    found = pin.buildGeomFromUrdfString(model, text, kind, package_dirs=[], mesh_loader=meshes.loader)
    for shape in found.geometryObjects:
        if shape.name in capsules:
            shape.geometry = coal.Capsule(*capsules[shape.name])
    return found, stand_ins


def _capsules(robot: Element, tag: str) -> Iterator[tuple[str, tuple[float, float]]]:
    """Writes capsules, at which Pinocchio's reader drops all shapes, as cylinders; yields their names, radii and lengths."""
    for link in robot.findall("link"):
        for i, shape in enumerate(link.findall(tag)):
            for capsule in shape.iterfind("geometry/capsule"):
                capsule.tag = "cylinder"
                size = float(capsule.get("radius", "")), float(capsule.get("length", ""))
                yield f"{link.get('name', '')}_{i}", size  # as Pinocchio calls it


class _Meshes:
    """The meshes of one file: each is looked at once, and those that cannot be had are remembered with the reason."""

    def __init__(self, base: Path, folders: tuple[Path, ...]) -> None:
        self.loader = coal.CachedMeshLoader()  # caches for Pinocchio; called from Python it does not
        self.refused: dict[str, str] = {}
        self._base = base
        self._folders = folders
        self._known: dict[str, Path] = {}

    def usable(self, name: str, scale: str | None) -> Path | None:
        """The resolved path of a mesh that may be opened, or None."""
        if name in self.refused and name not in self._known:  # a known one had a bad scale elsewhere
            return None
        try:
            if name not in self._known:
                path = find_mesh(name, self._base, self._folders)
                check_mesh(path, self._folders)
                self._known[name] = path
            check_scale(scale)
            return self._known[name]
        except ModelError as error:
            self.refused[name] = str(error)
        return None

    def read_each(self) -> bool:
        """Read every usable mesh, and refuse those that cannot be; whether there were any."""
        before = len(self._known)
        for name, path in list(self._known.items()):
            try:
                coal.MeshLoader().load(str(path), np.ones(3))
            except (ValueError, RuntimeError, MemoryError):
                self._refuse(name, "cannot be read as a mesh")
        return len(self._known) < before

    def _refuse(self, name: str, reason: str) -> None:
        self.refused[name] = reason
        del self._known[name]

    def all_finite(self, found: pin.GeometryModel) -> bool:
        """Whether all vertices are numbers of a sensible size; meshes of others are refused."""
        meshes = [obj for obj in found.geometryObjects if isinstance(obj.geometry, coal.BVHModelBase)]
        wrong = {obj.meshPath for obj in meshes if not (np.abs(obj.geometry.vertices()) <= LARGEST).all()}
        for name, path in list(self._known.items()):
            if str(path) in wrong:
                self._refuse(name, f"has coordinates that are not finite, or above {LARGEST:g} m")
        return not wrong


def _complaint(refused: Mapping[str, str]) -> str:
    """Message: which meshes are drawn as boxes, and what to do about it; empty if none."""
    if not refused:
        return ""
    names = [f"{name!r:.200} {reason}" for name, reason in list(refused.items())[:MOST_NAMES]]
    more = len(refused) - len(names)
    listed = "; ".join(names) + (f"; and {more} more" if more > 0 else "")
    advice = "Give the folder above its packages: load_robot(..., package_dirs=[folder])."
    if not {MISSING, OUTSIDE} & set(refused.values()):
        advice = "Repair these files, or export them again."
    count = f"{len(refused)} mesh{'es' if len(refused) > 1 else ''}"
    return f"has boxes in place of {count}: {listed}. {advice}"


def _replaced(robot: Element, tag: str, meshes: _Meshes) -> Iterator[str]:
    """Replaces the links' meshes by their resolved paths, or by boxes; yields the names of those boxes."""
    for link in robot.findall("link"):
        shapes = link.findall(tag)
        lost = []
        for i, shape in enumerate(shapes):
            for mesh in shape.iter("mesh"):
                path = meshes.usable(mesh.get("filename", ""), mesh.get("scale"))
                if path is None:
                    lost.append((shape, mesh))
                    yield f"{link.get('name', '')}_{i}"  # as Pinocchio calls it
                else:
                    mesh.set("filename", str(path))
        alone = len(lost) == len(shapes)
        for shape, mesh in lost:
            _put_box(link, shape, mesh, alone)


def _put_box(link: Element, shape: Element, mesh: Element, alone: bool) -> None:
    """A box with the link's mass and inertia if the link has no other shape; else a small one."""
    sides = _equivalent_box(link.find("inertial")) if alone else None
    mesh.tag = "box"
    mesh.attrib.clear()
    mesh.set("size", " ".join(f"{side:.6g}" for side in (sides if sides is not None else [STAND_IN_M] * 3)))
    if sides is None:
        return
    for old in shape.findall("origin"):
        shape.remove(old)
    if (origin := link.find("inertial/origin")) is not None:
        shape.insert(0, copy.deepcopy(origin))


def _equivalent_box(inertial: Element | None) -> Array | None:
    """Sides [m] of the box with this mass and these moments about its axes, from 1 cm to 1 m; None if there is none."""
    mass = None if inertial is None else inertial.find("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    if mass is None or inertia is None:
        return None
    try:
        m = float(mass.get("value", "0"))
        xx, yy, zz = (float(inertia.get(name, "0")) for name in ("ixx", "iyy", "izz"))
    except ValueError:
        return None
    squares = np.array([yy + zz - xx, xx + zz - yy, xx + yy - zz])
    if not (np.isfinite(squares).all() and 0.0 < m < np.inf and (squares > 0.0).all()):
        return None
    return np.clip(np.sqrt(6.0 * squares / m), 0.01, 1.0)


def _mjcf(
    model: pin.Model, element: Element, path: Path, kind: pin.GeometryType, folders: tuple[Path, ...], limits: FileLimits
) -> Geometry:
    """As for URDF; missing meshes are drawn as small boxes."""
    try:
        carry_out_includes(path, element, limits, folders)
        file = read_mjcf(path, element, limits, folders, LEAVABLE, stand_in_m=STAND_IN_M)
        found, stand_ins = mjcf_geometry(model, file, kind)
    except ModelError as error:
        return Geometry(pin.GeometryModel(), complaint=f"is left out, as it cannot be built: {error}")
    return Geometry(found, stand_ins, _complaint(file.refused))


HIDDEN = 2
"""Shapes of groups above this are not drawn, as in MuJoCo's viewer."""
_GREY = (0.5, 0.5, 0.5, 1.0)
_SHAPES: dict[int, Callable[..., coal.CollisionGeometry]] = {
    0: lambda *_: coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    2: lambda r, *_: coal.Sphere(r),
    3: lambda r, half, _: coal.Capsule(r, 2.0 * half),
    4: lambda x, y, z: coal.Ellipsoid(x, y, z),
    5: lambda r, half, _: coal.Cylinder(r, 2.0 * half),
    6: lambda x, y, z: coal.Box(2.0 * x, 2.0 * y, 2.0 * z),
}
"""By MuJoCo's numbers: plane, sphere, capsule, ellipsoid, cylinder, box."""


def mjcf_geometry(model: pin.Model, mjcf: Mjcf, kind: pin.GeometryType) -> tuple[pin.GeometryModel, frozenset[str]]:
    """(geometry, names in it of boxes that replace meshes).

    Visual shapes are those that MuJoCo's viewer shows at first or that cannot collide; collision shapes those that can.

    Args:
        model: With the bodies of the file as frames.
        mjcf: The file, its shapes read.
        kind: pin.GeometryType.VISUAL or COLLISION.
    """
    m, found = mjcf.model, pin.GeometryModel()
    stand_ins: set[str] = set()
    made: dict[int, coal.CollisionGeometry] = {}
    for i in range(m.ngeom):
        body, shape, mesh = int(m.geom_bodyid[i]), int(m.geom_type[i]), int(m.geom_dataid[i])
        touches = bool(m.geom_contype[i] or m.geom_conaffinity[i])
        if not (touches if kind == pin.GeometryType.COLLISION else m.geom_group[i] <= HIDDEN or not touches):
            continue
        number = i - int(m.body_geomadr[body])
        name = m.geom(i).name or f"{mjcf.bodies[body]}Geom_{number}"
        while found.existGeometryName(name):
            name = f"{mjcf.bodies[body]}_{name}_{number}"
        if i in mjcf.stand_ins:
            stand_ins.add(name)
        if shape in _SHAPES:
            geometry = _SHAPES[shape](*m.geom_size[i].tolist())
        else:
            geometry = made[mesh] = made.get(mesh) or _triangles(m, mesh)
        frame = model.getFrameId(mjcf.bodies[body], pin.FrameType.BODY) if body else 0
        carrier, own, material = model.frames[frame], tuple(m.geom_rgba[i].tolist()), int(m.geom_matid[i])
        placement = carrier.placement * pose(m.geom_pos[i], m.geom_quat[i])
        colour = np.array(own if material < 0 or own != _GREY else m.mat_rgba[material], dtype=float)
        found.addGeometryObject(
            pin.GeometryObject(name, carrier.parentJoint, frame, placement, geometry, "", np.ones(3), False, colour)
        )
    return found, frozenset(stand_ins)


def _triangles(m: Any, i: int) -> coal.CollisionGeometry:
    vertices = m.mesh_vert[m.mesh_vertadr[i] : m.mesh_vertadr[i] + m.mesh_vertnum[i]].astype(float)
    faces = m.mesh_face[m.mesh_faceadr[i] : m.mesh_faceadr[i] + m.mesh_facenum[i]].astype(int)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(vertices))
    mesh.addVertices(np.ascontiguousarray(vertices))
    mesh.addTriangles(np.ascontiguousarray(faces))
    mesh.endModel()
    return mesh


def flat_faces(hull: Any) -> Array:
    """(N, d) of the different faces of `solid_hull`'s, N x <= d inside, shape (f, 4) [1, m]."""
    first = np.unique(np.round(hull.equations, 9), axis=0, return_index=True)[1]
    equations = hull.equations[np.sort(first)]
    return np.column_stack([equations[:, :3], -equations[:, 3]])


def solid_hull(vertices: Array) -> Any:
    """SciPy's hull of points; its triangles, `simplices`, are counter-clockwise as seen from outside.

    Raises:
        ValueError: points in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # 0.2 s to import, and few files need it

    if len(vertices) < 4:
        raise ValueError("has fewer than four corners")
    try:
        found = ConvexHull(vertices)
    except QhullError:
        raise ValueError("has all its corners in one plane") from None
    a, b, c = (vertices[found.simplices[:, i]] for i in range(3))
    inward = (np.cross(b - a, c - a) * found.equations[:, :3]).sum(axis=1) < 0.0
    found.simplices[inward] = found.simplices[inward][:, ::-1]  # Qhull gives them in any order
    return found
