"""Where a study may be stored: paths are checked before work starts, and a store is locked while a study fills it."""

from __future__ import annotations

import fcntl
import os
import re
from contextlib import suppress
from pathlib import Path

from rbd.errors import InputError
from rbd.model.output_files import check_place

ZARR, NETCDF = ".zarr", ".nc"


def a_store_path(path: object) -> Path:
    """A path that ends in .zarr or .nc, "~" resolved.

    Raises:
        InputError: if it does not.
    """
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"out is {path!r:.80}; expected the path of a store, e.g. 'push.zarr'.")
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", text) and not Path(Path(text).parts[0]).is_dir():
        raise InputError(
            f"out is {text!r:.200}, a URL; expected a path in a file system. Give one of this machine, or a mounted one, and "
            "copy the store when the study is done."
        )
    try:
        found = Path(text).expanduser()
    except RuntimeError:  # "~nobody"
        found = Path(text)
    if found.suffix not in (ZARR, NETCDF):
        raise InputError(f"out is {text!r:.200}; expected a path that ends in .zarr, or in .nc for a small study as netCDF.")
    return found


def check_store_place(path: Path) -> None:
    """Refuse a path where no store can be, before anything is computed.

    Raises:
        InputError: no folder to hold it, no right to write there, a file where a folder must be, or the reverse.
    """
    if path.suffix == NETCDF:
        check_place(path, what="out")
        return
    place = Path(os.path.realpath(path))
    if place.exists() and not place.is_dir():
        raise InputError(f"out {str(path)!r:.300} is a file; a .zarr is a folder. Give another path, or move it away.")
    if place.is_dir():
        if not os.access(place, os.W_OK | os.X_OK):
            raise InputError(f"out {str(path)!r:.300} cannot be written: permission denied. Give a folder that is yours.")
        return
    check_place(place, what="out")


class Lock:
    """A store that this process fills; given free by `close`, and by the end of the process, however it ends.

    Args:
        path: The store, as the user wrote it.
        place: A folder to lock, or a file beside the store, which is made and removed.

    Raises:
        InputError: another study fills it now.
    """

    def __init__(self, path: Path, place: Path) -> None:
        self._file = None if place.is_dir() else place
        while True:
            flags = os.O_RDONLY if self._file is None else os.O_RDWR | os.O_CREAT
            self._held = os.open(place, flags, 0o666)
            try:
                fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(self._held)
                raise InputError(
                    f"{str(path)!r:.300} is being filled by another study now. Wait for its end, or give another path as out=."
                ) from None
            except OSError:  # a file system without locks
                return
            if self._file is None or self._is_that(place):
                return
            os.close(self._held)  # its owner removed the file meanwhile

    def _is_that(self, place: Path) -> bool:
        try:
            return os.stat(place).st_ino == os.fstat(self._held).st_ino
        except FileNotFoundError:
            return False

    def close(self) -> None:
        """Give it free."""
        if self._held < 0:
            return
        if self._file is not None:
            with suppress(OSError):
                self._file.unlink()
        os.close(self._held)
        self._held = -1
