"""Output files: written whole or not at all, their paths checked before the work starts; and temporary folders."""

from __future__ import annotations

import atexit
import errno
import itertools
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from rbd.errors import InputError, RbdError

_folders = itertools.count(1)


def new_folder() -> Path:
    """A new empty folder."""
    folder = _temporary(os.getpid()) / f"{next(_folders)}"
    folder.mkdir()
    return folder


@cache
def _temporary(process: int) -> Path:
    """The folder of a process. A forked child gets a separate one, and does not remove its parent's."""
    folder = tempfile.mkdtemp(prefix="rbd-robots-")
    atexit.register(_remove, folder, process)
    return Path(folder)


def _remove(folder: str, process: int) -> None:
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


def check_place(path: Path, error: type[RbdError] = InputError, *, what: str = "") -> None:
    """Refuse a path where no file could be written, before its contents are computed.

    Args:
        path: Where the file is to go.
        error: Exception to raise.
        what: Prefix of the path in messages, e.g. its option.

    Raises:
        RbdError: `error`, if the folder is missing or no folder, if the place is a folder, or if writing is not permitted.
    """
    try:
        _place(path)
    except OSError as reason:
        raise error(_complaint(path, reason, what)) from None


def write_file(path: Path, write: Callable[[BinaryIO], object], error: type[RbdError] = InputError) -> None:
    """Write a file atomically: to a temporary one in its folder, which then replaces the old one.

    The new file has the permissions of the old one, else those that new files have here. Where the path is a symbolic link,
    the file that it leads to is replaced. A device or a pipe (/dev/stdout) is written directly.

    Args:
        path: Where the file is to go.
        write: Is given the open file.
        error: Exception to raise.

    Raises:
        RbdError: `error`, if it cannot be written; the old file is still there then.
    """
    try:
        place, old = _place(path)
        if old is not None and not stat.S_ISREG(old.st_mode):
            with open(path, "wb") as file:
                write(file)
            return
        part = place.with_name(f".{secrets.token_hex(8)}.part")
        try:
            with os.fdopen(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666), "wb") as file:
                if old is not None:
                    os.chmod(part, stat.S_IMODE(old.st_mode))
                write(file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, place)
        finally:
            with suppress(OSError):  # so that the reason of the failure is reported, and not this
                part.unlink(missing_ok=True)
    except OSError as reason:
        raise error(_complaint(path, reason)) from reason


def write_text(path: Path, text: str, error: type[RbdError] = InputError) -> None:
    """Write text in UTF-8, as `write_file` does; invalid characters are written as question marks."""
    write_file(path, lambda file: file.write(text.encode("utf-8", errors="replace")), error)


def _place(path: Path) -> tuple[Path, os.stat_result | None]:
    """The real path behind links, and what exists there now.

    Raises:
        OSError: what opening it for writing would raise.
    """
    try:
        old = os.stat(path)
    except FileNotFoundError:
        old = None
    except ValueError:  # a lone surrogate, a null character
        raise OSError(errno.EINVAL, "no file can have this name") from None
    if old is not None and stat.S_ISDIR(old.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if old is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, "it may not be overwritten: permission denied")
    if old is not None and not stat.S_ISREG(old.st_mode):
        return path, old
    place = Path(os.path.realpath(path))
    folder = place.parent
    if not folder.exists():
        raise FileNotFoundError(errno.ENOENT, f"there is no folder {str(folder)!r:.200}: {os.strerror(errno.ENOENT)}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, f"no file may be made in the folder {str(folder)!r:.200}: permission denied")
    return place, old


def _complaint(path: Path, reason: OSError, what: str = "") -> str:
    why = reason.strerror or str(reason) or type(reason).__name__
    name = f"{what} {str(path)!r:.300}".lstrip()
    return f"{name} cannot be written: {why}. Give a file in a folder that is there and is yours."
