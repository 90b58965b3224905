"""Cards of motions and of what statics finds, with small curves as SVG.

Axes and words have the colour of the text around them; nothing has a ground of its own. So they suit light and dark pages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rbd.arrays import Array, largest_first
from rbd.model.world import along_gravity, is_along_z
from rbd.motion.causes import CAUSES
from rbd.motion.reference_motion import Motion
from rbd.motion.report import MotionReport
from rbd.simulation.simulated_motion import Event, Sample
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_fields import RESIDUALS, worst_of
from rbd.statics.actuation import ActuationUniqueness, Margins
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.wrench_cones import ContactWrenchCone
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.visual.notebook.card import Card, CardTable, Fold, card_of, escaped, fixed, joined, number, share, vector, words
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


_EVENTS = 12
_LEVEL_M = 5e-4
"""Heights that differ by less are the same."""


@card_of.register
def _trajectory(record: Trajectory) -> Card:
    moved, energy = record.com[-1] - record.com[0], record.energy
    ends = joined((f"{name} {record.modes[name][-1]}" for name in record.names if len(record.modes[name])), 4)
    height = f"{fixed(abs(moved[2]), 3)} m {'lower' if moved[2] < 0.0 else 'higher'}"
    height = height if abs(moved[2]) >= _LEVEL_M else "at the same height"
    lasts = f"{record.robot.name} moves for {number(record.duration, 4)} s"
    said = f"{lasts}; its centre of mass ends {height}"
    said += f"; at the end: {ends}" if ends else ""
    said = f"stopped early: {record.interrupted}; {said}" if record.interrupted else said
    rows = [
        ("samples", f"{len(record)}, steps of {number(1e3 * record.step)} ms" if record.step else str(len(record)), ""),
        ("centre of mass moved by", vector(moved), "m"),
        ("energy, first and last", f"{number(energy[0])}, {number(energy[-1])}", "J"),
        ("energy, range", fixed(np.ptp(energy), 5), "J"),
        ("work of the motors", number(record.motor_work[-1] - record.motor_work[0], 4), "J"),
        *(
            [("work taken by dampers", number(record.dissipated[-1] - record.dissipated[0], 4), "J")]
            * bool(record.dissipated.any())
        ),
        ("contact law", record.law or "-", ""),
        ("events", str(len(record.events)), ""),
    ]
    forces, sizes = [], {}
    for name, force in record.forces.items():
        contact = name in record.points
        size = np.linalg.norm(force[:, :3], axis=1) if contact else np.abs(force).max(axis=1, initial=0.0)
        if contact:
            sizes[name] = size
        at = int(size.argmax())
        forces.append(
            (name, number(size[at], 4), "N" if contact else "N or N m", number(record.t[at], 4), str(record.modes[name][-1]))
        )
    tables = [
        CardTable(rows, ("of the motion", "value", "unit")),
        CardTable(forces, ("constraint", "largest force |f|", "unit", "at [s]", "at the end it")),
    ]
    drawing = curves("force |f| [N]", record.t, sizes) if sizes else ""
    limit = record.robot.effort_limit
    if record.tau.any() and np.isfinite(limit).any():
        used = 100.0 * record.robot.torque_use(record.tau, record.v).max(axis=1)
        drawing += curves(
            "most used motor [% of its limit]",
            record.t,
            {"": used},
        )
    events = [(number(e.t, 6), e.name, str(e.point) if e.point >= 0 else "", e.kind) for e in record.events[:_EVENTS]]
    named = CardTable(events, ("at [s]", "contact", "point", "event"), whole=len(record.events), rest="trajectory.events")
    how = [("integrator", record.integrator), ("kept by", record.stabilisation)]
    proof = [_residuals(record), CardTable([(what, text) for what, text in how if text])]
    folds = [Fold("Proof: worst residuals", proof), *([Fold("Events", [named])] if events else [])]
    return Card(said, False if record.interrupted else None, tables, (), folds, drawing)


def _residuals(record: Trajectory) -> CardTable:
    rows = []
    for residual in RESIDUALS:
        values, worst = np.abs(record.residuals[residual.name]), worst_of(record.residuals[residual.name])
        if worst is None:
            rows.append((residual.name, "not known", residual.unit, "-", residual.meaning))
            continue
        unit = "scaled" if residual.unit == "1" else residual.unit
        at = number(record.t[worst], 4) if values[worst] else "-"
        rows.append((residual.name.replace("_", " "), f"{values[worst]:.1e}", unit, at, residual.meaning))
    return CardTable(rows, ("residual", "largest", "unit", "at [s]", "what it is"))


@card_of.register
def _sample(record: Sample) -> Card:
    rows = [
        ("torque, largest entry", number(np.abs(record.tau).max(initial=0.0), 4), "N, N m"),
        ("acceleration, largest entry", number(np.abs(record.a).max(initial=0.0), 4), "m/s2, rad/s2"),
        ("law residual", f"{record.law:.1e}", "scaled"),
        ("drift", f"{record.drift:.1e}", "m, rad"),
        ("penetration", f"{record.penetration:.1e}", "m, rad"),
    ]
    forces = [(name, record.modes[name], vector(f[:3], 2), "N, N m") for name, f in record.forces.items()]
    heads = ("constraint", "it", "force (first three entries)", "unit")
    said = f"{record.robot.name} at t = {number(record.t)} s"
    return Card(said, None, [CardTable(forces, heads), CardTable(rows, ("of the sample", "value", "unit"))])


@card_of.register
def _event(record: Event) -> Card:
    rows = [
        ("time", number(record.t), "s"),
        ("speed", number(record.speed, 4), "m/s"),
        ("impulse", number(record.impulse, 4), "N s"),
    ]
    return Card(str(record), None, [CardTable(rows)])


@card_of.register
def _motion(record: Motion) -> Card:
    rate = f" at {number(record.rate, 4)} Hz" if record.n > 1 else ""
    said = f"a motion of {record.robot.name}: {record.n} frames, {number(record.duration, 4)} s{rate}, from {record.source}"
    rows = [
        ("times", f"{number(record.t[0])} to {number(record.t[-1])}", "s"),
        ("largest speed of a joint", number(np.abs(record.v[:, record.robot.actuated]).max(initial=0.0), 4), "rad/s, m/s"),
        (
            "largest acceleration of a joint",
            number(np.abs(record.a[:, record.robot.actuated]).max(initial=0.0), 4),
            "rad/s2, m/s2",
        ),
        ("floor at", number(record.ground), "m"),
        ("v and a", "given" if record.derivation is None else str(record.derivation), ""),
    ]
    drawing = ""
    if record.robot.floating:
        travelled = record.q[-1, :3] - record.q[0, :3]
        rows.insert(1, ("base moved by", vector(travelled), "m"))
        drawing = curves("height of the base [m]", record.t, {"": record.q[:, 2]})
    notes = [Fold(f"Notes, {len(record.notes)}", [CardTable([(note,) for note in record.notes])])] if record.notes else []
    return Card(said, None, [CardTable(rows, ("of the motion", "value", "unit"))], (), notes, drawing)


@card_of.register
def _motion_report(record: MotionReport) -> Card:
    m, possible = record.motion, record.possible
    whole = bool(possible.all())
    part = f"{int(possible.sum())} of {record.n} frames ({share(record.share_possible)})"
    said = f"{m.robot.name} can do {f'all {record.n} frames' if whole else part} of the motion ({m.source})"
    rows, bars = [], {}
    for i, cause in enumerate(CAUSES):
        mask = record.causes[:, i]
        if mask.any():
            frames = record.worst(cause, 1)
            worst = int(frames[0])
            rows.append((cause, str(int(mask.sum())), share(float(mask.mean())), str(worst), fixed(m.t[worst], 2)))
            bars[cause] = mask
    heads = ("why not", "frames", "of all", "worst frame", "at [s]")
    numbers = [
        ("score", fixed(record.score, 1), "of 100"),
        ("missing wrench, median", share(float(np.median(record.missing_scaled)), 2), "of the weight"),
        ("missing wrench, largest", share(float(record.missing_scaled.max()), 2), "of the weight"),
        ("explained by noise, median", share(float(np.median(record.open)), 2), "of the weight"),
        ("friction", number(record.friction), ""),
        ("floor at", number(record.lanes.ground, 4), "m"),
    ]
    if record.before is not None:
        numbers.insert(0, ("possible before", share(record.before.share_possible), "of the frames"))
    groups, touches = record.lanes.points.group, record.lanes.touches
    feet = {str(c.name): np.asarray(touches[:, groups == g].any(axis=1)) for g, c in enumerate(record.lanes.contacts)}
    drawing = curves("missing wrench [% of the weight]", m.t, {"": 100.0 * record.missing_scaled}, least=1.0)
    drawing += lanes("touching the floor", m.t, feet) + (lanes("not possible because", m.t, bars) if bars else "")
    tables = [CardTable(rows, heads), CardTable(numbers, ("of the motion", "value", "unit"))]
    notes = (*m.notes, *record.lanes.notes)
    folds = [Fold("As printed", [str(record)])] + ([Fold("Notes", [CardTable([(note,) for note in notes])])] if notes else [])
    return Card(said, whole, tables, (), folds, drawing)


def _area(record: SupportRegion | ZmpRegion) -> str:
    return f"{1e4 * record.area:.1f} cm2{record.cut_words}" if np.isfinite(record.area) else "without end"


@card_of.register
def _support_region(record: SupportRegion) -> Card:
    if record.empty:
        said, inside = "it cannot be at rest anywhere on these contacts: the support region is empty", False
    else:
        inside = bool(record.com_to_edge[0] >= 0.0)
        can = "it can stand" if inside else "it cannot stand"
        said = f"the centre of mass is {record.com_in_words} the support region: {can}"
    gravity = record.state.robot.gravity
    com, seen = along_gravity(gravity, record.state.com), "from above" if is_along_z(gravity) else "along gravity, on z = 0"
    rows = [
        ("area", _area(record), ""),
        (f"centre of mass, seen {seen}", vector(com), "m"),
        ("on", joined(r.name for r in record.loads.rows), ""),
        ("torque limits", "within" if record.torque_limits else "torques of any size", ""),
        ("friction", f"{record.friction}, {share(record.margin, 0)} of it unused", ""),
    ]
    proof = [
        ("largest residual of the proving forces", f"{record.residual:.1e}", "N"),
        ("outer polygon larger by", number(1e4 * record.area_gap, 3) if np.isfinite(record.area_gap) else "-", "cm2"),
        ("linear or conic programs", str(record.programs), ""),
    ]
    folds = [Fold("Corners, each proved by forces", [_corners(record.vertices), CardTable(proof)])]
    drawing = "" if record.empty else polygon(f"the region, seen {seen} [m]", record.vertices, {"centre of mass": com})
    motors = record.motors_in_the_way
    notes = [f"Torque limits in the way: {joined(motors)}."] if motors else []
    return Card(said, inside, [CardTable(rows, ("of the region", "value", "unit"))], notes, folds, drawing)


def _corners(vertices: Array) -> CardTable:
    axes = ("x [m]", "y [m]", "z [m]")[: vertices.shape[1]]
    return CardTable([tuple(fixed(v, 4) for v in row) for row in vertices], axes, whole=len(vertices), rest="region.vertices")


@card_of.register
def _zmp_region(record: ZmpRegion) -> Card:
    kind = "of the linear pendulum" if record.pendular else "of any motion"
    said = f"zero-moment points {kind}: " + ("none" if record.empty else _area(record))
    rows = [
        ("area", _area(record), ""),
        ("on", joined(r.name for r in record.loads.rows), ""),
        ("friction", record.friction, ""),
    ]
    folds = [Fold("Corners, each proved by forces", [_corners(record.vertices)])]
    return Card(said, not record.empty, [CardTable(rows, ("of the region", "value", "unit"))], (), folds)


@card_of.register
def _pushes(record: PushLimits) -> Card:
    weakest = int(np.nanargmin(record.forces if record.held else record.least))
    limits = record.gives_way
    why = joined(map(str, limits[weakest])) or f"no limit met up to {number(record.at_most)} N"
    way = vector(record.directions[weakest], 2)
    most = f"withstands {number(record.forces[weakest], 4)} N at {record.frame} along {way}"
    weak = ", its weakest direction" if len(record.forces) > 1 else ""
    said = f"{most}{weak}; what gives way there: {why}"
    if not record.held:
        least = number(record.least[weakest], 4)
        said = f"cannot be held without a push; one of {least} N at {record.frame} along {way} holds it"
    order = largest_first(-record.forces)
    rows = [
        (
            vector(record.directions[i], 2),
            *([] if record.held else [fixed(record.least[i], 2)]),
            fixed(record.forces[i], 2),
            fixed(record.bounds[i], 2),
            joined(map(str, limits[i])) or "-",
        )
        for i in order
    ]
    smallest = () if record.held else ("smallest push [N]",)
    heads = ("direction", *smallest, "largest push [N]", "no more than [N]", "gives way first")
    residual = CardTable([("largest residual of the proving forces", f"{record.residual:.1e}", "N")])
    folds = [Fold("Proof: residuals", [residual])]
    return Card(said, None, [CardTable(rows, heads, rest="forces")], (), folds)


@card_of.register
def _wrench_cone(record: ContactWrenchCone) -> Card:
    said = f"wrenches of {joined(record.names)}: {len(record.rays)} rays, {len(record.faces)} faces"
    rows = [
        ("about", vector(record.about), "m"),
        ("rays (force, moment)", str(len(record.rays)), "N, N m"),
        ("lines", str(len(record.lines)), ""),
        ("faces", str(len(record.faces)), ""),
        ("friction", words(record.pyramids), ""),
    ]
    return Card(said, None, [CardTable(rows, ("of the cone", "value", "unit"))])


@card_of.register
def _margins(record: Margins) -> Card:
    left = [float(np.nanmin(record.torque, initial=np.inf)), *record.friction.values()]
    least = min((x for x in left if np.isfinite(x)), default=np.nan)
    rows = [("torque, of the motor nearest to its limit", share(left[0]) if np.isfinite(left[0]) else "-", "of the limit")]
    rows += [(f"friction of {name}", share(x), "of the cone") for name, x in record.friction.items()]
    rows += [(f"edge of {name}", fixed(1e3 * d, 1), "mm") for name, d in record.centre_of_pressure.items()]
    good = None if least != least else bool(least >= 0.0)
    return Card(f"{share(least)} is left of the nearest limit", good, [CardTable(rows, ("limit", "left", "unit"))])


@card_of.register
def _actuation_uniqueness(record: ActuationUniqueness) -> Card:
    one = not (record.torques or record.forces or record.corner_forces)
    said = "torques and forces are unique" if one else str(record)
    rows = [
        ("torques", str(record.torques)),
        ("contact forces", str(record.forces)),
        ("corner forces", str(record.corner_forces)),
    ]
    return Card(said, None, [CardTable(rows, ("of the", "directions in which they can change"))])
