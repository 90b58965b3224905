"""Small drawings in the text of a page, as SVG: curves over time, lanes of contact, a polygon seen from above.

Axes and words have the colour of the text around them; nothing has a ground of its own. So they suit light and dark pages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rbd.arrays import Array
from rbd.visual.notebook.card import escaped
from rbd.visual.notebook.values import number
from rbd.visual.style import CONTACT_COLORS

WIDTH, HEIGHT = 620, 132
LEFT, RIGHT, TOP, BOTTOM = 58, 10, 20, 22
MOST_POINTS = 160
"""Columns of a curve; of each, the lowest and the highest value are drawn."""
MOST_CURVES = 6
LANE = 16
_FAINT = 'stroke="currentColor" stroke-opacity="0.35" fill="none"'


def curves(title: str, t: Array, lines: Mapping[str, Array], *, least: float = 0.0) -> str:
    """Curves over time as SVG, the first `MOST_CURVES` of them, with a legend.

    Args:
        title: What is drawn, with its unit.
        t: Times, shape (n,) [s].
        lines: {name: values, shape (n,)}.
        least: The axis reaches at least up to here, so that rounding does not look like a curve.
    """
    shown = dict(list(lines.items())[:MOST_CURVES])
    values = np.concatenate([np.asarray(x, float)[np.isfinite(x)] for x in shown.values()] or [np.zeros(1)])
    if not values.size or len(t) < 2:
        return ""
    low, high = min(0.0, float(values.min())), max(least, float(values.max()))
    high = high if high > low else low + 1.0
    across, down = _scales(t, low, high)
    parts = [_frame(t, low, high, down)]
    for color, x in zip(CONTACT_COLORS, shown.values(), strict=False):
        for piece in _pieces(t, np.asarray(x, float)):
            points = " ".join(f"{across(s):.1f},{down(v):.1f}" for s, v in piece)
            parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.5"/>')
    return _svg(title, list(shown), len(lines) - len(shown), HEIGHT, parts)


def lanes(title: str, t: Array, on: Mapping[str, Array]) -> str:
    """When each of some things is the case, as bars over time, as SVG.

    Args:
        title: What is drawn.
        t: Times, shape (n,) [s].
        on: {name: shape (n,) of bool}.
    """
    shown = dict(list(on.items())[: 2 * MOST_CURVES])
    if len(t) < 2 or not shown:
        return ""
    across, _ = _scales(t, 0.0, 1.0, LEFT + 38)
    height = TOP + LANE * len(shown) + BOTTOM
    parts = []
    for i, (name, mask) in enumerate(shown.items()):
        y = TOP + i * LANE
        parts.append(f'<text x="{LEFT + 32}" y="{y + 11}" text-anchor="end" fill="currentColor">{escaped(name, 15)}</text>')
        color = CONTACT_COLORS[i % len(CONTACT_COLORS)]
        for a, b in _intervals(np.asarray(mask, bool)):
            begin, end = across(t[a]), across(t[b])
            wide = max(1.0, end - begin)
            parts.append(f'<rect x="{begin:.1f}" y="{y + 3}" width="{wide:.1f}" height="{LANE - 6}" fill="{color}"/>')
    base = height - BOTTOM
    parts.append(f'<path d="M{LEFT + 38} {base}H{WIDTH - RIGHT}" {_FAINT}/>')
    parts += _times(t, base, LEFT + 38)
    return _svg(title, [], len(on) - len(shown), height, parts, left=0)


def polygon(title: str, vertices: Array, marks: Mapping[str, Array]) -> str:
    """A polygon seen from above, x to the right and y up, with points in it, as SVG.

    Args:
        title: What is drawn, with its unit.
        vertices: Its corners, shape (k, 2) [m].
        marks: {name: point, shape (2,) [m]}.
    """
    points = np.vstack([vertices, *[np.asarray(p, float)[None] for p in marks.values()]])
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(max(high - low))
    if not len(vertices) or not 0.0 < size < np.inf:
        return ""
    scale = min((WIDTH - 320) / max(high[0] - low[0], 1e-9), 200.0 / max(high[1] - low[1], 1e-9))
    height = int(TOP + BOTTOM + 8 + scale * (high[1] - low[1]))

    def place(p: Array) -> tuple[float, float]:
        return LEFT + scale * (p[0] - low[0]), TOP + 4 + scale * (high[1] - p[1])

    corners = " ".join("{:.1f},{:.1f}".format(*place(p)) for p in vertices)
    color = CONTACT_COLORS[0]
    parts = [f'<polygon points="{corners}" fill="{color}" fill-opacity="0.2" stroke="{color}" stroke-width="1.5"/>']
    for name, point in marks.items():
        x, y = place(point)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{CONTACT_COLORS[1]}"/>')
        parts.append(f'<text x="{x + 8:.1f}" y="{y + 4:.1f}" fill="currentColor">{escaped(name, 30)}</text>')
    bar = 10.0 ** np.floor(np.log10(size))
    y = height - 8
    parts.append(f'<path d="M{LEFT} {y}h{scale * bar:.1f}" stroke="currentColor" stroke-width="2"/>')
    parts.append(f'<text x="{LEFT + scale * bar + 6:.1f}" y="{y + 4}" fill="currentColor">{number(bar)} m</text>')
    return _svg(title, [], 0, height, parts, left=0)


def _scales(t: Array, low: float, high: float, left: int = LEFT) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Pixels of a time, and of a value."""
    first, last = float(t[0]), float(t[-1])

    def across(s: float) -> float:
        return left + (WIDTH - left - RIGHT) * (float(s) - first) / (last - first)

    def down(v: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - float(v)) / (high - low)

    return across, down


def _pieces(t: Array, x: Array) -> list[list[tuple[float, float]]]:
    """Points to draw, in pieces between holes: all of a short curve, lowest and highest of each column of a long one."""
    pieces = []
    for a, b in _intervals(np.isfinite(x)):
        s, v = t[a : b + 1], x[a : b + 1]
        if len(s) > 2 * MOST_POINTS:
            edges = np.linspace(0, len(s), MOST_POINTS + 1).astype(int)
            chosen = {0, len(s) - 1}
            for i, j in zip(edges[:-1], edges[1:], strict=True):
                chosen |= {i + int(v[i:j].argmin()), i + int(v[i:j].argmax())}
            kept = sorted(chosen)
            s, v = s[kept], v[kept]
        pieces.append(list(zip(s.tolist(), v.tolist(), strict=True)))
    return pieces


def _intervals(mask: Array) -> list[tuple[int, int]]:
    """(first, last) of each run of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _frame(t: Array, low: float, high: float, down: Callable[[float], float]) -> str:
    base = HEIGHT - BOTTOM
    parts = [f'<path d="M{LEFT} {TOP}V{base}H{WIDTH - RIGHT}" {_FAINT}/>']
    if low < 0.0 < high:
        parts.append(f'<path d="M{LEFT} {down(0.0):.1f}H{WIDTH - RIGHT}" {_FAINT}/>')
    for v in (low, high):
        parts.append(f'<text x="{LEFT - 6}" y="{down(v) + 4:.1f}" text-anchor="end" fill="currentColor">{number(v, 3)}</text>')
    return "".join([*parts, *_times(t, base)])


def _times(t: Array, base: float, left: int = LEFT) -> list[str]:
    """The first and the last time below an axis."""
    y = base + 15
    return [
        f'<text x="{left}" y="{y}" fill="currentColor">{number(t[0], 4)} s</text>',
        f'<text x="{WIDTH - RIGHT}" y="{y}" text-anchor="end" fill="currentColor">{number(t[-1], 4)} s</text>',
    ]


def _svg(title: str, names: Sequence[str], more: int, height: int, parts: Sequence[str], left: int = LEFT) -> str:
    """A drawing with its title and the names of its curves in one line above."""
    texts = [f'<text x="{left}" y="12" fill="currentColor" font-weight="600">{escaped(title, 60)}</text>']
    x = left + 14 + 6.6 * min(len(title), 60)
    for color, name in zip(CONTACT_COLORS, names, strict=False):
        told = escaped(name, 22)
        texts.append(f'<text x="{x:.0f}" y="12" fill="{color}">{told}</text>')
        x += 12 + 6.2 * min(len(name), 22)
    if more > 0:
        texts.append(f'<text x="{x:.0f}" y="12" fill="currentColor">and {more} more</text>')
    size = f'viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}"'
    style = 'style="max-width:100%;height:auto;display:block" font-family="sans-serif" font-size="11"'
    return f'<svg {size} {style} role="img" aria-label="{escaped(title)}">{"".join([*texts, *parts])}</svg>'
