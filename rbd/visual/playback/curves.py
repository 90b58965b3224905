"""Curves of a motion beside the robot: charts, their axes, and their form for a page.

`trajectory_charts` and `report_curves` say which there are. Numbers are those of the samples, in single precision, at 6000
times at most: evenly, and at the peaks in between.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.visual.style import CONTACT_COLORS

MOST_POINTS = 6000
"""Points of a curve."""
NAMED = 4
"""Motors or joints with a curve of their own: those that are used most. Of all others the largest is drawn."""
GREY = "#9aa5b1"
BOLD, FINE = 1.6, 0.9
Choice: TypeAlias = bool | Sequence[str]


@dataclass(frozen=True, eq=False)
class CurveLine:
    """One curve.

    Attributes:
        name: What it is.
        color: As '#rrggbb'.
        values: Shape (n,), in the chart's unit; NaN where there is none.
        width: Of the line, in the chart's pixels.
        motion: 0, or 1 for a second motion beside the first, whose curves are dashed.
    """

    name: str
    color: str
    values: Array
    width: float = BOLD
    motion: int = 0


@dataclass(frozen=True, eq=False)
class CurveChart:
    """Curves on the same axes.

    Attributes:
        name: A key of `CHARTS`, or another short one.
        title: With its unit, such as "energy, J".
        lines: The curves.
        limits: {what a dashed line means: its value}.
        low: Foot of the axis.
        top: Its end; what is higher is cut off.
        log: Whether the axis is logarithmic.
    """

    name: str
    title: str
    lines: tuple[CurveLine, ...]
    limits: Mapping[str, float]
    low: float
    top: float
    log: bool = False


def chart(
    name: str,
    title: str,
    lines: Sequence[CurveLine],
    *,
    limits: Mapping[str, float] | None = None,
    least_top: float = 0.0,
    percentile: float = 100.0,
    signed: bool = False,
) -> CurveChart:
    """A chart with axes for its values.

    Args:
        name: A short one.
        title: With the unit.
        lines: The curves.
        limits: Dashed lines.
        least_top: The axis ends there or higher.
        percentile: A peak beyond four times this percentile is cut off, since it would hide all else.
        signed: Whether the axis begins below the least value, else at 0.
    """
    values = np.concatenate([line.values for line in lines])
    low, top = _signed(values) if signed else (0.0, top_of(values, least_top, percentile))
    return CurveChart(name, title, tuple(lines), dict(limits or {}), low, top)


def most_used(
    name: str, title: str, names: Sequence[str], values: Array, *, limit: float | None, short: bool = True
) -> CurveChart:
    """The curves of the joints with the largest values, each by its name, and the largest of all others.

    Args:
        name: Of the chart.
        title: With the unit.
        names: Of the joints.
        values: Shape (n, number of joints), zero or more.
        limit: Value of a dashed line, None for none.
        short: Whether "_joint" at the end of names is left out.
    """
    order = np.lexsort((-np.nan_to_num(values).mean(axis=0), -np.nan_to_num(values).max(axis=0)))
    most, others = order[:NAMED], order[NAMED:]
    rest = [CurveLine("largest of the others", GREY, values[:, others].max(axis=1), FINE)] if len(others) else []
    named = [
        CurveLine(names[j].removesuffix("_joint") if short else names[j], color, values[:, j])
        for j, color in zip(most, CONTACT_COLORS, strict=False)
    ]
    return chart(
        name,
        title,
        rest + named,
        limits={} if limit is None else {"limit": limit},
        least_top=1.2 * (limit or 0.0),
        percentile=99.5,
    )


def top_of(values: Array, least: float, percentile: float) -> float:
    """Where an axis ends: a peak that would hide all else, four times the percentile, is cut off."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return least or 1.0
    most = float(finite.max())
    usual = max(float(np.percentile(finite, percentile)), least)
    return max(least, 1.08 * (min(most, 4.0 * usual) if usual > 0.0 else most)) or 1.0


def together(first: Sequence[CurveChart], second: Sequence[CurveChart]) -> list[CurveChart]:
    """The charts of two motions on the same axes: the curves of the second are dashed."""
    dashed = {c.name: replace(c, lines=tuple(replace(line, motion=1) for line in c.lines)) for c in second}
    for one in first:
        if one.name in dashed and all(line.color in (*CONTACT_COLORS, GREY) for line in one.lines):
            dashed[one.name] = _in_colors_of(one, dashed[one.name])
    joined = []
    for one in first:
        other = dashed.pop(one.name, None)
        if other is not None and other.title == one.title:
            one = replace(one, lines=one.lines + other.lines, low=min(one.low, other.low), top=max(one.top, other.top))
        elif other is not None:
            dashed[one.name] = other
        joined.append(one)
    return joined + list(dashed.values())


def _in_colors_of(first: CurveChart, second: CurveChart) -> CurveChart:
    """The second chart with the colours of the first for curves of the same name, and others for the rest."""
    names = [line.name for line in first.lines]
    if len(set(names)) < len(names):  # of contacts, whose colours are known from the picture
        return second
    known = {line.name: line.color for line in first.lines}
    free = iter([color for color in CONTACT_COLORS if color not in known.values()] + [GREY] * len(second.lines))
    return replace(
        second, lines=tuple(replace(x, color=known[x.name] if x.name in known else next(free)) for x in second.lines)
    )


def described(times: Sequence[Array], charts: Sequence[CurveChart]) -> dict[str, object]:
    """The charts as a page reads them: times and values packed as numbers of single precision, in base64.

    Args:
        times: Of the samples of each motion, shape (n,) [s].
        charts: Whose lines have a value for each sample of their motion.
    """
    kept = [kept_samples(len(t), [x.values for c in charts for x in c.lines if x.motion == m]) for m, t in enumerate(times)]
    return {
        "times": [packed(t[at]) for t, at in zip(times, kept, strict=True)],
        "charts": [
            {
                "name": c.name,
                "title": c.title,
                "limits": [{"name": name, "value": value} for name, value in c.limits.items()],
                "low": c.low,
                "top": c.top,
                "log": c.log,
                "lines": [
                    {name: getattr(x, name) for name in ("name", "color", "width", "motion")}
                    | {"values": packed(x.values[kept[x.motion]])}
                    for x in c.lines
                ],
            }
            for c in charts
        ],
    }  # fmt: skip


def kept_samples(n: int, curves: Sequence[Array], most: int = MOST_POINTS) -> Array:
    """Indices of the samples that a page holds, increasing: all of up to `most`; else every so many, and peaks in between.

    Half of them are evenly apart; the others are those that are farthest from the straight line between these, in any curve,
    measured by its range.
    """
    if n <= most:
        return np.arange(n)
    even = np.unique(np.linspace(0, n - 1, most // 2).round().astype(int))
    missed = np.zeros(n)
    for values in curves:
        there = np.isfinite(values)
        straight = np.interp(np.arange(n), even, np.where(there, values, np.nan)[even])
        span = float(np.ptp(values[there])) if there.any() else 0.0
        with np.errstate(invalid="ignore"):
            far = np.abs(values - straight) / span if span > 0.0 else np.zeros(n)
        # A number where there was none on one side, or none between two numbers, is a gap that begins or ends.
        missed = np.maximum(missed, np.where(np.isfinite(far), far, np.where(there != np.isfinite(straight), 1.0, 0.0)))
    missed[even] = -1.0
    room = most - len(even)
    return np.union1d(even, np.argpartition(-missed, room)[:room])


def _signed(values: Array) -> tuple[float, float]:
    """Ends of an axis with all values, a little apart."""
    finite = values[np.isfinite(values)]
    low, top = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    room = 0.06 * (top - low) or 0.05 * max(abs(top), 1e-3)
    return low - room, top + room


def packed(values: Array, kind: str = "<f4") -> str:
    """Numbers of a kind, in base64, as a page reads them."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
