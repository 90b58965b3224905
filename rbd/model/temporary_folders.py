"""Folders for files that robots are made of: kept as long as the process runs, and taken away with it."""

from __future__ import annotations

import atexit
import itertools
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

_folders = itertools.count(1)


def new_folder() -> Path:
    """A new empty folder."""
    folder = _temporary(os.getpid()) / f"{next(_folders)}"
    folder.mkdir()
    return folder


@cache
def _temporary(process: int) -> Path:
    """The folder of a process. A forked child gets its own, and leaves its parent's where it is when it ends."""
    folder = tempfile.mkdtemp(prefix="rbd-robots-")
    atexit.register(_remove, folder, process)
    return Path(folder)


def _remove(folder: str, process: int) -> None:
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
