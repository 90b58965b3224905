"""What an exported page holds: Meshcat's commands, and objects with their triangles."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import umsgpack

from rbd.visual.packed_meshes import unpacked
from rbd.visual.shapes import Mesh

COMMAND = re.compile(r"^stage\.command\((\d+)\);$|^stage\.place\((\{.*\}), (\d+)\);$", re.MULTILINE)


def block(text: str, name: str) -> bytes:
    """What is deflated in the page under this id: "library" is Meshcat's viewer, "pieces" the scene's bytes."""
    found = re.search(rf'<script type="text/plain" id="{name}">([^<]*)</script>', text)
    assert found is not None
    return zlib.decompress(base64.b64decode(found[1]))


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
