"""One colour per contact, the same in the viewer and in plots."""

from __future__ import annotations

from collections.abc import Iterable
from colorsys import hls_to_rgb

from rbd.errors import InputError

# Okabe and Ito's palette, told apart by colour-blind readers; its yellow and black serve badly on a light ground.
CONTACT_COLORS = ("#0072b2", "#d55e00", "#009e73", "#56b4e9", "#e69f00", "#8c6d31", "#5e4fa2", "#7f7f7f")
PUSH_COLOR = "#c2187a"
COM_COLOR = "#1a1a1a"
SUPPORT_COLOR = "#3f6f3f"
SKELETON_COLOR = "#5b6470"
INERTIA_COLOR = "#b08d57"
COLLISION_COLOR = "#8fa3b5"
GOLDEN = 0.6180339887498949


def contact_colors(names: Iterable[str]) -> dict[str, str]:
    """A colour for every name, by its place in the list, as '#rrggbb'.

    After eight names the colours come again. Give plots and scenes the contacts in the same order, and they agree.

    >>> contact_colors(["left_sole", "right_sole"])
    {'left_sole': '#0072b2', 'right_sole': '#d55e00'}
    """
    try:
        unique = list(dict.fromkeys(names))
    except TypeError:
        raise InputError(f"names are {names!r:.80}; expected a list of words.") from None
    return {name: CONTACT_COLORS[i % len(CONTACT_COLORS)] for i, name in enumerate(unique)}


def distinct_colors(n: int) -> list[str]:
    """N different colours as '#rrggbb': those of contacts, then others around the circle of hues."""
    out = list(CONTACT_COLORS[:n])
    for i in range(n - len(out)):
        # The golden ratio's steps never meet; lightness goes round in thirds, so that neighbours in hue differ too.
        red, green, blue = hls_to_rgb((0.11 + i * GOLDEN) % 1.0, (0.38, 0.52, 0.66)[i % 3], 0.62)
        out.append(f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}")
    return out


def rgb_number(color: str, *, share: float = 1.0) -> int:
    """'#rrggbb', darkened to a share of its light, as the number 0xrrggbb that Meshcat's materials want."""
    parts = bytes.fromhex(color.removeprefix("#"))
    return int.from_bytes(bytes(int(share * part) for part in parts), "big")
