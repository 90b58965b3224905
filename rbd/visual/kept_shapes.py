"""Drawn shapes of robots, kept on disk: the second page of a robot reads and prepares no mesh.

They are where compiled kernels are kept: in the folder that NUMBA_CACHE_DIR names, else beside this module, else in the
user's cache. Their name is a hash of all that they follow from: the robot's file, the bytes of its meshes, the placements of
its model, and the code. A file that cannot be read, or is not what was written, is made anew.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rbd.errors import PictureError
from rbd.model import meshes as model_meshes
from rbd.model.output_files import write_file
from rbd.robots.body_shapes import ShapedRobot
from rbd.visual.shapes import Mesh

Piece = tuple[dict[str, Any], Mesh, pin.SE3]
"""What is plain data, triangles, and where they are."""
CODE = (
    *(Path(__file__).with_name(f"{name}.py") for name in ("kept_shapes", "robot_meshes", "robot_layers", "shapes")),
    Path(model_meshes.__file__),
)
"""What makes shapes, and what their form is."""
ENDING, DIGEST_BYTES = ".shapes", 32
MOST_BYTES = 300_000_000
"""Of all files together; the oldest go."""


def kept_pieces(robot: object, what: str, make: Callable[[], Sequence[Piece]]) -> list[Piece]:
    """Pieces as they were kept, else as they are made, which are then kept.

    Not kept are shapes of robots without a URDF file of their own, shapes that are in memory already, as they may have been
    changed there, and those with boxes in place of meshes, of which each first use warns.

    Args:
        robot: The robot.
        what: "visual" or "collision".
        make: Makes them.
    """
    name = _name(robot, what)
    if name is None:
        return list(make())
    file = _folder() / name
    if (found := _read(file)) is not None:
        with suppress(OSError):
            os.utime(file)
        return found
    made = list(make())
    if not robot.stand_ins:  # type: ignore[attr-defined]
        _write(file, made)
    return made


def _name(robot: object, what: str) -> str | None:
    if not isinstance(robot, ShapedRobot) or type(robot).visual_model is not ShapedRobot.visual_model:
        return None
    drawn_as_collision = robot.has_read("collision") and robot.element.find("link/visual") is None
    if robot.has_read(what) or drawn_as_collision:
        return None
    files = robot.mesh_files()
    if files is None:
        return None
    model, parts = robot.model, [what, robot.text, pin.__version__, coal.__version__, np.__version__]
    placed = [*zip(model.names, model.parents, model.jointPlacements, model.inertias, strict=True)]
    parts += [f"{name} {parent} {X.homogeneous.tolist()} {I.toDynamicParameters().tolist()}" for name, parent, X, I in placed]
    parts += [f"{f.name} {f.parentJoint} {f.placement.homogeneous.tolist()}" for f in model.frames]
    try:
        parts += [_hash_of(file) for file in CODE]
        parts += [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    except OSError:
        return None
    return hashlib.sha256("\n".join(parts).encode()).hexdigest() + ENDING


@cache
def _hash_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _folder() -> Path:
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given)
    here = Path(__file__).parent
    if os.access(here, os.W_OK):
        return here / "__pycache__"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rbd"


def _read(file: Path) -> list[Piece] | None:
    """What a file holds; None if there is none, or if it is not what was written."""
    try:
        data = file.read_bytes()
        body = data[DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != data[:DIGEST_BYTES]:
            return None
        with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
            told = json.loads(str(arrays["told"]))
            starts = [np.cumsum([0, *arrays[name]]) for name in ("vertex_counts", "face_counts")]
            vertices, faces, poses = arrays["vertices"], arrays["faces"].astype(int), arrays["poses"]
        cut = [[slice(a, b) for a, b in zip(s, s[1:], strict=False)] for s in starts]
        meshes = [Mesh(vertices[v], faces[f]) for v, f in zip(*cut, strict=True)]
        return [(t, mesh, pin.SE3(X[:3, :3], X[:3, 3])) for t, mesh, X in zip(told, meshes, poses, strict=True)]
    except (OSError, ValueError, KeyError):
        return None


def _write(file: Path, pieces: Sequence[Piece]) -> None:
    """Keep pieces; where that cannot be, they are made anew each time."""
    told, meshes, poses = [t for t, _, _ in pieces], [m for _, m, _ in pieces], [X.homogeneous for _, _, X in pieces]
    body = io.BytesIO()
    np.savez(
        body,
        told=np.array(json.dumps(told)),
        vertex_counts=np.array([len(m.vertices) for m in meshes], int),
        face_counts=np.array([len(m.faces) for m in meshes], int),
        vertices=np.vstack([np.zeros((0, 3)), *(m.vertices for m in meshes)]),
        faces=np.vstack([np.zeros((0, 3), np.int32), *(m.faces.astype(np.int32) for m in meshes)]),
        poses=np.array(poses, float).reshape(-1, 4, 4),
    )
    data = body.getvalue()
    with suppress(OSError, PictureError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_file(file, lambda out: out.write(hashlib.sha256(data).digest() + data), PictureError)
        others = sorted(file.parent.glob(f"*{ENDING}"), key=lambda each: -each.stat().st_mtime)
        sizes = np.cumsum([each.stat().st_size for each in others])
        for old in [each for each, total in zip(others, sizes.tolist(), strict=True) if total > MOST_BYTES and each != file]:
            old.unlink()
