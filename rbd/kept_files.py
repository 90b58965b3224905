"""Folders for files that robots are made of: kept as long as the process runs, and taken away with it."""

from __future__ import annotations

import itertools
import tempfile
from functools import cache
from pathlib import Path

_folders = itertools.count(1)


def new_folder() -> Path:
    """A new empty folder."""
    folder = Path(_temporary().name) / f"{next(_folders)}"
    folder.mkdir()
    return folder


@cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="rbd-robots-")
