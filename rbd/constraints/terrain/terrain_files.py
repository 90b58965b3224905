"""Pieces of terrain from files: meshes of convex bodies, and worlds of fixed bodies in URDF or MJCF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Heights, Piece, polytope, pose_of
from rbd.errors import InputError, ModelError
from rbd.model.files import build_model, read
from rbd.model.input_files import check_mesh, is_file
from rbd.model.meshes import load_geometry
from rbd.model.mjcf.reading import WORLD, Grid, Mjcf

CONVEX = 1e-4
"""A mesh whose surface is this much below that of its hull, relative to its size, is not convex."""
_BLOCK = 1024
"""Points whose depths are computed at once."""


def file_path(given: object) -> Path:
    """A path as users give it.

    Raises:
        InputError: another object.
    """
    if not isinstance(given, str | Path):
        raise InputError(f"path is {given!r:.80}; expected the name of a file.")
    return Path(given)


def mesh_pieces(path: Path, pose: pin.SE3 | None, scale: float) -> dict[str, object]:
    """{name: piece} of the connected parts of a mesh, each of which is convex.

    Raises:
        InputError: a file that cannot be read, or a part that is not convex.
    """
    if not is_file(path):
        raise InputError(f"there is no file {str(path)!r:.200}; expected a mesh, e.g. .stl or .obj.")
    try:
        check_mesh(path, [path.parent])
        mesh = coal.MeshLoader().load(str(path), np.full(3, scale))
    except (ModelError, ValueError, RuntimeError) as error:
        raise InputError(f"mesh {path.name} {str(error).strip():.200}") from None
    corners = np.array(mesh.vertices(), float).reshape(-1, 3)
    if not np.isfinite(corners).all() or not len(corners):
        raise InputError(f"{path.name} has corners that are not finite, or none.")
    triangles = np.array([[t[0], t[1], t[2]] for t in (mesh.tri_indices(i) for i in range(mesh.num_tris))], int)
    corners, same = np.unique(np.round(corners, 9), axis=0, return_inverse=True)
    triangles = same.ravel()[triangles]
    out: dict[str, object] = {}
    for k, part in enumerate(_connected(triangles, len(corners))):
        name = f"{path.stem} {k}"
        X = pose_of(name, pose)
        out[name] = _convex(name, corners @ X.rotation.T + X.translation, triangles[part])
    return out


def _connected(triangles: Array, n: int) -> Iterator[Array]:
    """The triangles of each connected part."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    i, j = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    _, of = connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    for part in dict.fromkeys(of[triangles[:, 0]].tolist()):
        yield np.flatnonzero(of[triangles[:, 0]] == part)


def _convex(name: str, corners: Array, triangles: Array) -> Piece:
    """The hull of a part, refused if some of its corners are inside, or its triangles cut through it."""
    own = corners[np.unique(triangles)]
    piece = polytope(name, own)
    middles = np.concatenate([own, corners[triangles].mean(axis=1)])
    blocks = np.split(middles, range(_BLOCK, len(middles), _BLOCK))
    depth = max(float(-piece.depths(block).min(initial=0.0)) for block in blocks)
    if depth > CONVEX * float(np.ptp(own, axis=0).max()):
        raise InputError(
            f"part {name!r:.80} of a mesh is not convex: its surface goes {depth:.4g} m below that of its hull. Give it in "
            "convex parts, e.g. of a convex decomposition."
        )
    return piece


def world_pieces(path: Path, folders: Sequence[Path]) -> dict[str, object]:
    """{name: piece} of the collision shapes of a world in URDF or MJCF, in which nothing moves.

    Raises:
        ModelError: a file that cannot be read.
        InputError: bodies that move, or no shapes.
    """
    file = read(path, base=0, folders=tuple(folders))
    model = build_model(file, "fixed")
    if model.nv:
        raise InputError(f"{path.name} has joints, {list(model.names)[1]!r:.80} ...; expected a world in which nothing moves.")
    found = load_geometry(model, file.element, path, (path.parent, *folders), pin.GeometryType.COLLISION)
    if found.complaint and not found.model.ngeoms:
        raise ModelError(f"the collision geometry of {path.name} {found.complaint}")
    out: dict[str, object] = {g.name: (g.geometry, pin.SE3(g.placement)) for g in found.model.geometryObjects}
    if isinstance(file.content, Mjcf):
        out |= _fields(file.content.grids)
    if not out:
        raise InputError(f"{path.name} has no collision shapes; expected boxes, planes, meshes or grids of heights.")
    return out


def _fields(grids: Sequence[Grid]) -> dict[str, object]:
    """The grids of heights of an MJCF file."""
    out: dict[str, object] = {}
    for name, body, place, turn, size, z in grids:
        if body != WORLD or np.abs(turn - [1.0, 0.0, 0.0, 0.0]).max() > 1e-9:
            raise InputError(f"the grid of heights {name!r:.80} is turned or on a body; expected one in W's axes.")
        if not z.size:
            raise InputError(f"the heights of {name!r:.80} are in a file of their own; give them to rbd.Terrain.heights.")
        spacing = 2.0 * size[:2] / (np.array(z.shape) - 1.0)
        out[name] = Heights.of(name, z * size[2] + place[2], spacing, place[:2] - size[:2])
    return out
