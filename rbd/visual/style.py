"""Colours, and checked arguments of the drawing functions: paths, counts, lengths, axes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from colorsys import hls_to_rgb
from contextlib import suppress
from pathlib import Path

from rbd.arrays import check_whole
from rbd.errors import InputError, PictureError
from rbd.model.output_files import check_place

# Okabe and Ito's palette, distinguishable by colour-blind readers; its yellow and black serve badly on a light ground.
CONTACT_COLORS = ("#0072b2", "#d55e00", "#009e73", "#56b4e9", "#e69f00", "#8c6d31", "#5e4fa2", "#7f7f7f")
PUSH_COLOR = "#c2187a"
COM_COLOR = "#1a1a1a"
GHOST_COLOR = "#7b5ea7"  # of a second motion beside the one shown
SUPPORT_COLOR = "#3f6f3f"
LIMITED_COLOR = "#8a2f4f"  # of a support region within torque limits
ZMP_COLOR = "#5e4fa2"
WRENCH_COLOR = "#e69f00"
IMPACT = "impact"
MODE_COLORS = {
    "open": "#aab4be",
    "sticks": "#2166ac",
    "slips": "#f4b400",
    "creeps": "#c0202e",
    IMPACT: "#16191d",
    "holds": "#7fb6e6",
    "pushes": "#009e73",
}
"""{mode of a contact's point: colour of its disk}: of different lightness too, for colour-blind readers."""
LIMIT_COLORS = {
    "edge": ("#009e73", "the edge of a sole"),
    "friction": ("#0072b2", "friction"),
    "motor": ("#d55e00", "a motor's torque limit"),
    "push": ("#7f7f7f", "all contacts open"),
    "none": ("#c9c9c9", "nothing up to there"),
}
SKELETON_COLOR = "#5b6470"
INERTIA_COLOR = "#b08d57"
COLLISION_COLOR = "#8fa3b5"
GOLDEN = 0.6180339887498949
MOST_PIXELS = 30_000
MOST_SIZE = 4000
"""Pixels along a side of a frame of a video, and of one of several pictures side by side."""


def contact_colors(names: Iterable[str]) -> dict[str, str]:
    """A colour for every name, by its place in the list, as '#rrggbb'.

    After eight names the colours come again. Give plots and scenes the contacts in the same order, and they agree.

    Example:
        >>> rbd.visual.contact_colors(["left_sole", "right_sole"])
        {'left_sole': '#0072b2', 'right_sole': '#d55e00'}
    """
    try:
        unique = list(dict.fromkeys(names))
    except TypeError:
        raise InputError(f"names are {names!r:.80}; expected a list of names.") from None
    return {name: CONTACT_COLORS[i % len(CONTACT_COLORS)] for i, name in enumerate(unique)}


def distinct_colors(n: int) -> list[str]:
    """N different colours as '#rrggbb': those of contacts, then others around the circle of hues."""
    out = list(CONTACT_COLORS[:n])
    for i in range(n - len(out)):
        # Steps of the golden ratio never coincide; lightness cycles in thirds, so that neighbours in hue differ too.
        red, green, blue = hls_to_rgb((0.11 + i * GOLDEN) % 1.0, (0.38, 0.52, 0.66)[i % 3], 0.62)
        out.append(hexadecimal((red, green, blue)))
    return out


def hexadecimal(parts: Iterable[float]) -> str:
    """'#rrggbb' of red, green and blue from 0 to 1."""
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


def rgb(color: str) -> tuple[float, ...]:
    """Red, green and blue of '#rrggbb', from 0 to 1."""
    return tuple(part / 255.0 for part in bytes.fromhex(color.removeprefix("#")))


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
        PictureError: if it is invalid, does not end in .html, or cannot be written.
    """
    target = a_path("the page", value)
    if target.suffix.lower() not in (".html", ".htm"):
        raise PictureError(f"cannot export to {str(target)!r}: expected a name that ends in .html.")
    check_place(target, PictureError)
    return target


def a_picture(value: object) -> Path:
    """The path of a picture to write.

    Raises:
        PictureError: if it is invalid, or cannot be written.
    """
    target = a_path("the picture", value)
    check_place(target, PictureError)
    return target


def check_there(page: Path) -> None:
    """Refuse a page that is no file.

    Raises:
        PictureError: if it is none, or the system refuses the information.
    """
    with suppress(OSError):
        if page.is_file():
            return
    raise PictureError(f"no page {str(page)!r}; write one with scene.export(...) first.")


def check_size(width: int, height: int, most: int, *, least: int = 1) -> tuple[int, int]:
    """Width and height of a picture, in pixels.

    Raises:
        InputError: no whole numbers within bounds.
    """
    return check_whole("width", width, most, least=least), check_whole("height", height, most, least=least)
