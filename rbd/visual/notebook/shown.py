"""What a notebook shows of a record: its printed text, its fields, and of motions small curves as SVG.

Text and lines take their colours from the notebook, so that light and dark themes both work. Styles are written on the
elements, because many viewers of stored notebooks remove style sheets.
"""

from __future__ import annotations

import html
import inspect
import math
import warnings
from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.answers.solution import Solution
from rbd.arrays import Array, max_abs
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import RbdError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.motion.reference_motion import Motion
from rbd.motion.report import MotionReport
from rbd.problem.answer import Answer, Status
from rbd.problem.force_set import at_rest
from rbd.records import counted, fixed, joined, number, rows_of, vector
from rbd.simulation.trajectory import Trajectory
from rbd.visual.notebook.page_frames import page_frame
from rbd.visual.playback.curves import CurveChart, kept_samples
from rbd.visual.playback.report_motion import headline_of, report_charts
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.scene import Scene
from rbd.visual.terrain_alone import terrain_page

MOST_LINES = 40
"""Rows of a table, and lines of a text, that are shown; a line says how many more there are."""
MOST_LETTERS = 160
"""Letters of a cell, or of a line, that are shown."""
HEADS = ("field", "value", "unit", "meaning")
_LINE = "1px solid rgba(127, 127, 127, 0.3)"
_CELL = "text-align:left;padding:0.1em 1.2em 0.1em 0"
STILL = 1e-6
"""Accelerations up to this are none [m/s2, rad/s2]."""
MOST_CHARTS = 2
WIDTH, HEIGHT = 620, 132
LEFT, RIGHT, TOP, BOTTOM = 58, 10, 20, 22
MOST_POINTS = 320
"""Of a curve; its peaks are among them."""


def html_of(record: Any) -> str:
    """What a notebook shows of a record, as HTML.

    Warnings are not repeated: the function that gave the record has given them.
    """
    with warnings.catch_warnings(action="ignore"):
        return card_html(printed(record), rows_of(record), drawing_of(record))


@singledispatch
def printed(record: Any) -> str:
    """A record in words; the first line is the result."""
    kind: type = type(record)
    if kind.__str__ not in (object.__str__, tuple.__str__):  # a text of its own
        return str(record)
    return f"{kind.__name__}: {(inspect.getdoc(kind) or '').split(chr(10), 1)[0].rstrip('.')}"


@printed.register
def _error(record: RbdError) -> str:
    message = str(record)
    return f"{type(record).__name__}: {message}" + (f"\n{message}" if len(message) > 300 else "")


@printed.register
def _robot(record: CheckedModel) -> str:
    base = "floating base" if record.floating else "fixed base" if not record.bases else "several bases"
    counts = f"{counted(record.nu, 'motor')}, {counted(record.nv, 'degree')} of freedom"
    said = f"{record.name}: {counts}, {fixed(record.mass, 2)} kg, {base}"
    report = getattr(record, "report", None)
    found = "" if report is None else "\n" + str(report).split("\n", 1)[0]
    return f"{said}{found}\n{record.joints}"


@printed.register
def _state(record: State) -> str:
    robot, q = record.robot, record.q
    how = f"moving, largest entry of v {number(max_abs(record.v), 3)} m/s, rad/s" if record.v.any() else "at rest"
    lines = [f"{robot.name} {how}; centre of mass at {vector(record.com)} m"]
    if robot.bases:
        X = record.base_pose(robot.bases[0])
        turns = vector(np.degrees(pin.rpy.matrixToRpy(X.rotation)), 1)
        lines.append(f"  base at {vector(X.translation)} m; roll, pitch, yaw {turns} deg")
    for joint in robot.joints.values():
        if joint.nq == 1:
            at = q[joint.q.start]
            value = f"{fixed(math.degrees(at), 2)} deg" if joint.unit == "rad" else f"{fixed(at, 4)} {joint.unit}"
            beyond = "" if joint.lower - 1e-6 <= at <= joint.upper + 1e-6 else "  beyond its limit"
            lines.append(f"  {joint.name:<28} {value:>12}{beyond}")
    return "\n".join(lines)


@printed.register
def _answer(record: Answer) -> str:
    if record.status in (Status.SOLVED, Status.INACCURATE):
        return f"{_happens(record)}\n{record}"
    said = f"no answer: {record.status}: {record.reason or record.worst}"
    if isinstance(record, Solution) and not record.impact and record.contradiction is not None:
        said += f"; not possible: {record.contradiction.claim}"
    return f"{said}\n{record}"


def _happens(answer: Answer) -> str:
    """What begins to move, in words."""
    if answer.impact:
        return answer.impact
    if max_abs(answer.a) <= STILL:
        return "nothing accelerates: it stays as it is"
    return "it accelerates; " + joined((f"{name} {does}" for name, does in contact_motions(answer).items()), 8)


def contact_motions(answer: Answer) -> dict[str, str]:
    """{contact: "holds", "sticks", "starts to slip, ... m/s2", ...} by the accelerations of its points."""
    P = answer.problem
    T = P.force_set_of(answer.law)
    y = T.accelerations(P.J @ answer.a + P.offset)
    sliding, opening = {point.rows for point in P.force_set.sliding}, set(answer.opening)
    out = {}
    for i, rows in enumerate(P.rows):
        if rows.patch is None:
            continue
        if rows.name in opening:
            out[rows.name] = "separates"
        elif not len(rows) or at_rest(rows.cone).bilateral:
            out[rows.name] = "is held"
        elif rows.name in sliding:
            out[rows.name] = "slides"
        else:
            out[rows.name] = _begins(T.point_accelerations(y, i))
    return out


def _begins(motion: Array) -> str:
    """What points begin to do with these accelerations along two tangents and the normal, shape (k, 3) [m/s2]."""
    slip, lift = np.hypot(motion[:, 0], motion[:, 1]), motion[:, 2]
    slip = slip[lift <= STILL]
    if (lift > STILL).all():
        return f"lifts off, {number(lift.max(), 3)} m/s2"
    if slip.max(initial=0.0) > STILL:
        return f"starts to slip, {number(slip.max(), 3)} m/s2"
    return "sticks" if (lift <= STILL).all() else f"tips, {number(lift.max(), 3)} m/s2"


@printed.register
def _report(record: MotionReport) -> str:
    return f"{headline_of(record)}\n{record}"


@singledispatch
def drawing_of(record: Any) -> str:
    """What is drawn of a record, as HTML; empty of most."""
    return ""


@drawing_of.register
def _frame(record: Scene) -> str:
    return page_frame(record, record.page(), record.robot.name) if record.shown else ""


@drawing_of.register
def _terrain_frame(record: Terrain) -> str:
    return page_frame(record, terrain_page(record), "terrain")


@drawing_of.register(Trajectory | Motion)
def _curves(record: Any) -> str:
    charts = charts_of(record, True) if len(record.t) > 1 else []
    return "".join(chart_svg(record.t, chart) for chart in charts[:MOST_CHARTS])


@drawing_of.register
def _report_curves(record: MotionReport) -> str:
    return "".join(chart_svg(record.motion.t, chart) for chart in report_charts(record)[:MOST_CHARTS])


def escaped(text: object, most: int = MOST_LETTERS) -> str:
    """Text for HTML, cut to a number of letters."""
    words = " ".join(str(text).split())
    return html.escape(words if len(words) <= most else words[: most - 1] + "\N{HORIZONTAL ELLIPSIS}")


def card_html(text: str, rows: Sequence[Sequence[str]] = (), drawing: str = "") -> str:
    """A card as one element of HTML: the first line of the text, which is the result; the drawing; the rest; the fields.

    Args:
        text: What is printed of a record.
        rows: Name, value, unit and meaning of each field; folded where there is more than the first line.
        drawing: Curves as SVG, or a frame, with all names escaped.
    """
    result, _, rest = text.partition("\n")
    parts = [f'<p style="margin:0 0 0.4em"><strong>{escaped(result, 400)}</strong></p>', drawing, _text_html(rest)]
    table = table_html(rows) if rows else ""
    if table and (rest or drawing):
        title = '<summary style="cursor:pointer">Fields</summary>'
        table = f'<details style="margin:0.2em 0">{title}{table}</details>'
    whole = "\n".join(part for part in (*parts, table) if part)
    return f'<div class="rbd-card" style="max-width:64em;line-height:1.45;text-align:left">{whole}</div>'


def table_html(rows: Sequence[Sequence[str]]) -> str:
    """Fields as a table of HTML."""
    head = "".join(f'<th scope="col" style="{_CELL}">{name}</th>' for name in HEADS)
    lines = ["".join(f'<td style="{_CELL}">{escaped(cell)}</td>' for cell in row) for row in rows[:MOST_LINES]]
    body = "".join(f'<tr style="border-bottom:{_LINE}">{line}</tr>' for line in lines)
    more = f"<p>and {len(rows) - MOST_LINES} more</p>" if len(rows) > MOST_LINES else ""
    style = "border-collapse:collapse;margin:0.2em 0 0.5em 0;font-variant-numeric:tabular-nums"
    return f'<table style="{style}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}'


def _text_html(text: str) -> str:
    """Lines as they are printed, the first forty; nothing of no text."""
    if not text:
        return ""
    lines = text.split("\n")
    shown = [html.escape(line[:MOST_LETTERS]) for line in lines[:MOST_LINES]]
    more = [f"and {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    return '<pre style="margin:0.2em 0;white-space:pre;overflow-x:auto;background:none">' + "\n".join(shown + more) + "</pre>"


def chart_svg(t: Array, chart: CurveChart) -> str:
    """A chart over times of shape (n,) [s] as SVG, with the names of its curves in one line above."""
    at = kept_samples(len(t), [line.values for line in chart.lines], MOST_POINTS)
    base = HEIGHT - BOTTOM
    grey = 'stroke="currentColor" stroke-opacity="0.35" fill="none"'
    parts = [f'<path d="M{LEFT} {TOP}V{base}H{WIDTH - RIGHT}" {grey}/>']
    parts += [f'<path d="M{LEFT} {_down(chart, x):.1f}H{WIDTH - RIGHT}" {grey}/>' for x in chart.limits.values()]
    heights = [(_down(chart, x) + 4, x) for x in (chart.low, chart.top)]
    parts += [f'<text x="{LEFT - 6}" y="{y:.1f}" text-anchor="end" fill="currentColor">{x:.3g}</text>' for y, x in heights]
    ends = [(LEFT, "start", t[0]), (WIDTH - RIGHT, "end", t[-1])]
    foot = base + 15
    parts += [f'<text x="{x}" y="{foot}" text-anchor="{way}" fill="currentColor">{s:.4g} s</text>' for x, way, s in ends]
    across = LEFT + (WIDTH - LEFT - RIGHT) * (t[at] - t[0]) / (t[-1] - t[0])
    words = [f'<tspan font-weight="600">{escaped(chart.title, 80)}</tspan>']
    for line in chart.lines:
        down = _down(chart, line.values[at])
        drawn = np.isfinite(down)
        steps = zip("M" + "".join("L" if there else "M" for there in drawn), across, down, strict=False)
        path = "".join(f"{step}{x:.1f} {y:.1f}" for step, x, y in steps if np.isfinite(y))
        parts.append(f'<path d="{path}" fill="none" stroke="{line.color}" stroke-width="{line.width}"/>')
        words.append(f'<tspan dx="10" fill="{line.color}">{escaped(line.name, 22)}</tspan>')
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    style = 'style="max-width:100%;height:auto;display:block" font-family="sans-serif" font-size="11"'
    title = f'<text x="{LEFT}" y="12" fill="currentColor">{"".join(words)}</text>'
    return f'<svg {size} {style} role="img" aria-label="{escaped(chart.title)}">{title}{"".join(parts)}</svg>'


def _down(chart: CurveChart, values: Any) -> Any:
    """Where values are drawn, from the top [pixels]; those beyond the axis at its end."""
    low, top, values = chart.low, chart.top, np.asarray(values, float)
    if chart.log:
        low, top, values = np.log10(low), np.log10(top), np.log10(np.maximum(values, low))
    return TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - (np.clip(values, low, top) - low) / (top - low))
