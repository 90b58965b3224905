"""What an exported page holds: Meshcat's commands, and objects with their triangles."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import umsgpack

from rbd.visual.packed_meshes import CORNER_BYTES, STEPS
from rbd.visual.shapes import Mesh

COMMAND = re.compile(r"^stage\.command\((\d+)\);$|^stage\.place\((\{.*\}), (\d+)\);$", re.MULTILINE)


def block(text: str, name: str) -> bytes:
    """What is deflated in the page under this id: "library" is the viewer with the charts, "pieces" the scene's bytes."""
    found = re.search(rf'<script type="text/plain" id="{name}">([^<]*)</script>', text)
    assert found is not None
    return zlib.decompress(base64.b64decode(found[1]))


def unpacked(header: Mapping[str, Any], data: bytes) -> Mesh:
    """The triangles, as the page reads them."""
    n, m = header["vertices"], header["faces"]
    body = np.frombuffer(data, np.uint8).astype(np.int64)
    planes = body[: 6 * n].reshape(3, 2, n)
    zigzag = planes[:, 0] + 256 * planes[:, 1]
    places = np.cumsum((zigzag >> 1) ^ -(zigzag & 1), axis=1) % (STEPS + 1)
    vertices = np.array(header["low"]) + places.T * (np.array(header["side"]) / STEPS)
    below = (body[6 * n :].reshape(CORNER_BYTES, 3 * m) << (8 * np.arange(CORNER_BYTES))[:, None]).sum(axis=0)
    new = below == 0
    return Mesh(vertices, (np.cumsum(new) - new - below).reshape(-1, 3))


def contents(page: Path) -> list[dict[str, Any]]:
    """Commands of Meshcat's, decoded, and headers of objects with their "mesh", in the order in which the page runs them."""
    text = page.read_text(encoding="utf-8")
    found = re.search(r"^unpackPage\((\[.*\]), ", text, re.MULTILINE)
    assert found is not None
    library, *sizes = json.loads(found[1])
    assert len(block(text, "library")) == library
    data, pieces = block(text, "pieces"), []
    for size in sizes:
        pieces.append(data[:size])
        data = data[size:]
    assert data == b""
    run = []
    for command, header, number in COMMAND.findall(text):
        told = json.loads(header) if header else umsgpack.unpackb(pieces[int(command)])
        run.append(told | {"mesh": unpacked(told, pieces[int(number)])} if header else told)
    return run


def meshes(page: Path) -> dict[str, Mesh]:
    """{path of an object: its triangles}."""
    return {told["path"]: told["mesh"] for told in contents(page) if "mesh" in told}
