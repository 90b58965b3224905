"""Checked arguments of the drawing functions: paths, counts and lengths."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from rbd.arrays import as_float
from rbd.errors import InputError, PictureError
from rbd.model.output_files import check_place

MOST_PIXELS = 30_000


def a_path(what: str, value: object) -> Path:
    """A path.

    Raises:
        PictureError: if it can be none.
    """
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text or len(text) > 4000:
        raise PictureError(f"{what} is {value!r:.80}; expected the path of a file.")
    return Path(text)


def a_page(value: object) -> Path:
    """The path of a page to write.

    Raises:
        PictureError: if it is none, does not end in .html, or nothing can be written there.
    """
    target = a_path("the page", value)
    if target.suffix.lower() not in (".html", ".htm"):
        raise PictureError(f"cannot export to {str(target)!r}: expected a name that ends in .html.")
    check_place(target, PictureError)
    return target


def a_picture(value: object) -> Path:
    """The path of a picture to write.

    Raises:
        PictureError: if it is none, or nothing can be written there.
    """
    target = a_path("the picture", value)
    check_place(target, PictureError)
    return target


def is_there(path: Path) -> bool:
    """Whether it is a file; False where the system will not say."""
    try:
        return path.is_file()
    except OSError:
        return False


def a_count(what: str, value: object, most: int = MOST_PIXELS) -> int:
    """A whole number from 1 to `most`.

    Raises:
        InputError: if it is not.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a whole number from 1 to {most}.")
    return int(value)


def a_length(what: str, value: object) -> float:
    """A finite length above zero [m].

    Raises:
        InputError: if it is not.
    """
    length = as_float(value)
    if not 0.0 < length < 1e100:
        raise InputError(f"{what} is {value!r:.80}; expected a length above zero, in metres.")
    return length
