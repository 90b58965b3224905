"""`export_members`: a page on which sliders move one member within a set that is proved to be held, with its forces."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.installation import VERSION
from rbd.motion.frame_terms import placements
from rbd.robust import verifier
from rbd.robust.holding import RobustHold
from rbd.visual.pages.page import page_template, script_safe, system_colors, write_page
from rbd.visual.stills import surface_points

POINTS = 16000
"""Of the robot's surfaces, about."""
_PAGE = page_template(
    system_colors()
    + """body { margin: 0; padding: 16px 20px; color: var(--ink); background: var(--halo);
font: 14px/20px system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 20px; margin: 0 0 4px; } .quiet { color: var(--soft); margin: 0 0 10px; }
main { display: flex; flex-wrap: wrap; gap: 20px; } canvas { border: 1px solid var(--edge); border-radius: 6px; cursor: grab; }
aside { flex: 1 1 300px; max-width: 460px; } label { display: grid; grid-template-columns: 150px 1fr 92px; gap: 8px; }
input { width: 100%; } output { text-align: right; } td { padding: 1px 10px 1px 0; }
#says { border-radius: 6px; padding: 8px 12px; margin-bottom: 10px; background: #e3f3e6; color: #1f2933; }
.beyond #says { background: #fbdcdc; }
.beyond canvas { border-color: var(--wrong); } .bar { display: inline-block; height: 10px; background: var(--link); }""",
    """<h1>$title</h1>
<p class="quiet">$about</p>
<main><canvas id="robot" width="620" height="620"></canvas>
<aside><div id="says"></div><div id="sliders"></div><table id="used"></table></aside></main>
<script>
"use strict";
const D = $data, canvas = document.getElementById("robot"), pen = canvas.getContext("2d"), value = {};
let yaw = -0.7;
const dot = (x, y) => x.reduce((s, a, i) => s + a * y[i], 0), fixed = (x, n) => Math.abs(x) < 5e-7 ? "0" : x.toFixed(n);
function sharesOf(push) {  // of the corners; null beyond their hull
  const by = [...push, 1];
  for (const s of D.simplices) {
    const shares = s.map.map((row) => dot(row, by)), found = push.map((_, i) => dot(shares, s.at.map((v) => D.pushes[v][i])));
    if (shares.every((x) => x > -1e-9) && found.every((x, i) => Math.abs(x - push[i]) < 1e-6 * D.size)) {
      const out = D.pushes.map(() => 0); s.at.forEach((v, i) => { out[v] = shares[i]; }); return out;
    }
  }
  return null;
}
function member() {
  const push = [0, 1, 2].slice(0, D.pushes[0].length).map((i) => value["push" + i]);
  const t = D.kinds.map((kind) => value[kind]), shares = sharesOf(push), beyond = [];
  if (!shares) beyond.push("the push");
  if (value.friction < 1 - 1e-9) beyond.push("the friction");
  for (const s of D.sliders) if (s.unit && Math.abs(value[s.name]) > 1 + 1e-9) beyond.push(s.label);
  if (beyond.length) return { push, beyond };
  const number = D.parts.findIndex((p) => t.every((x, i) => p.low[i] - 1e-12 <= x && x <= p.high[i] + 1e-12));
  const { low, high, forces, corrections } = D.parts[number];
  const u = t.map((x, i) => high[i] > low[i] ? (2 * x - low[i] - high[i]) / (high[i] - low[i]) : 0);
  const f = forces[0].map((_, j) => shares.reduce((sum, share, v) => share ?
    sum + share * (forces[v][j] + corrections[v].reduce((more, F, i) => more + u[i] * F[j], 0)) : sum, 0));
  const load = D.motors.map((_, k) => dot(shares, D.loads.map((L) => L[k])) + dot(t, D.columns.map((c) => c[k])));
  const torque = D.motors.map((row, k) => D.torque.length ? D.torque[k] + dot(D.gain[k], push) : load[k] - dot(row, f));
  const cones = D.cones.map((c, i) => {
    const side = Math.hypot(f[c[0]], f[c[1]]), most = value.friction * D.friction[i] * f[c[2]];
    return { share: side / most, slack: most - side };
  });
  const ends = torque.flatMap((x, k) => [[x, D.low[k], 1], [x, D.high[k], -1]]).filter((e) => e[1] !== null);
  const slack = Math.min(...cones.map((c) => c.slack), ...ends.map(([x, end, sign]) => sign * (x - end)));
  return { push, beyond, f, torque, slack, number, cone: Math.max(...cones.map((c) => c.share)),
    motor: Math.max(0, ...torque.map((x, k) => x > 0 ? x / (D.high[k] ?? Infinity) : x / (D.low[k] ?? -Infinity))),
    names: D.points.map((p) => ({ name: p.name, force: p.map.map((row) => dot(row, f)), at: p.at })) };
}
function place([x, y, z]) {
  const c = Math.cos(yaw), s = Math.sin(yaw), [a, b, h] = [x - D.middle[0], y - D.middle[1], z - D.middle[2]];
  const right = -s * a + c * b, back = c * a + s * b;
  return [310 + D.scale * right, 310 - D.scale * (0.96 * h - 0.28 * back), back];
}
function arrow(from, to, color) {
  const [[x, y], [u, v]] = [place(from), place(to)], far = Math.hypot(u - x, v - y);
  if (far < 1) return;
  const [a, b] = [(u - x) / far, (v - y) / far], head = Math.min(9, far);
  pen.strokeStyle = pen.fillStyle = color; pen.lineWidth = 3;
  pen.beginPath(); pen.moveTo(x, y); pen.lineTo(u - head * a, v - head * b); pen.stroke();
  pen.beginPath(); pen.moveTo(u, v); pen.lineTo(u - head * a - 5 * b, v - head * b + 5 * a);
  pen.lineTo(u - head * a + 5 * b, v - head * b - 5 * a); pen.fill();
}
function draw() {
  const m = member(), out = m.beyond.length > 0, add = (p, f, scale = D.metres) => p.map((x, i) => x + scale * f[i]);
  document.body.className = out ? "beyond" : "";
  document.getElementById("says").textContent = out ? "Beyond the set by " + m.beyond.join(", ") + ": nothing is proved here." :
    "Held: " + fixed(m.slack, 3) + D.unit + " to the nearest limit; proved for all members: " + fixed(D.margin, 3) +
    (D.parts.length > 1 ? "; part " + (m.number + 1) + " of " + D.parts.length + " of the set." : ".");
  pen.clearRect(0, 0, 620, 620);
  const seen = D.surface.map((p) => [place(p), p[3]]).sort((a, b) => a[0][2] - b[0][2]);
  for (const [[x, y], shade] of seen) {
    pen.fillStyle = "rgb(" + [shade, shade, shade] + ")"; pen.fillRect(x - 2.5, y - 2.5, 5, 5);
  }
  if (!out) for (const p of m.names) arrow(p.at, add(p.at, p.force), "#2c7a3f");
  if (D.at) arrow(D.at, add(D.at, m.push, D.push_metres), out ? "#c4161c" : "#b8560f");
  if (D.at) for (const push of D.pushes) {
    const [x, y] = place(add(D.at, push, D.push_metres)); pen.fillStyle = "#b8560f"; pen.fillRect(x - 3, y - 3, 6, 6);
  }
  const used = out ? [] : [["cones of friction, at most", m.cone], ...(D.limited ? [["torque limits, at most", m.motor]] : [])];
  document.getElementById("used").innerHTML = used.map(([name, x]) => "<tr><td>" + name + "<td><span class=bar style='width:" +
    Math.round(120 * Math.min(1, x)) + "px'></span><td>" + (100 * x).toFixed(1) + " %").join("");
  return m;
}
for (const s of D.sliders) {
  const [row, input, shown] = ["label", "input", "output"].map((kind) => document.createElement(kind));
  Object.assign(input, { type: "range", min: s.low, max: s.high, step: (s.high - s.low) / 600, id: s.name });
  input.value = value[s.name] = s.start;
  const tell = () => { shown.textContent = fixed(value[s.name] * s.factor, 2) + " " + s.suffix; };
  input.addEventListener("input", () => { value[s.name] = Number(input.value); tell(); draw(); });
  tell(); row.append(s.label, input, shown); document.getElementById("sliders").append(row);
}
canvas.addEventListener("pointermove", (e) => { if (e.buttons) { yaw -= 0.01 * e.movementX; draw(); } });
draw();
</script>""",
)


def export_members(held: RobustHold, path: str | os.PathLike[str]) -> Path:
    """Write a page that moves one member within a set that is proved to be held; returns its path.

    Sliders set the push, the masses, the centres of mass and the friction, beyond the set too, where the page says that nothing
    is proved. The contact forces of the member are those of the proof: its shares of the corners' forces, and a correction for
    each uncertain number; so the page needs no solver and no network. It computes in floating point:
    `held.verify` is the proof.

    Args:
        held: Of `rbd.robust.hold`, at one pose, with forces at one point at most; torques of each member, or shared.
        path: Of the page.

    Raises:
        InputError: another proof.
        PictureError: the page cannot be written.
    """
    check_kind("held", held, RobustHold, "a RobustHold of rbd.robust.hold")
    loads = held.loads
    if loads.turns or loads.components.shape[1] not in (0, 3):
        raise InputError(f"{held}: the page knows proofs at one pose, without joints=, with forces at one point at most.")
    state, robot, sets = loads.state, loads.state.robot, loads.balance.sets
    (R,), (p,) = placements(robot, state.q[None])
    places, light, _ = (x[:: max(len(x) // POINTS, 1)] for x in surface_points(robot, R, p))
    shade = (110.0 + 120.0 * light).round()
    low, high = places.min(axis=0), places.max(axis=0)
    sliders, kinds = _sliders(held)
    motors, limits = robot.actuated, loads.limits
    limited = bool(np.isfinite(limits).any())
    data = {
        "surface": np.column_stack([places.round(3), shade]).tolist(), "middle": (0.5 * (low + high)).tolist(),
        "scale": 470.0 / float((high - low).max()), "metres": 0.5 * float((high - low).max()) / loads.balance.unit,
        "sliders": sliders, "kinds": kinds, "margin": held.margin, "points": _points(held),
        "push_metres": 0.3 * float((high - low).max()) / max(float(np.linalg.norm(loads.components, axis=1).max()), 1e-9),
        "pushes": loads.components.tolist(), "simplices": _simplices(loads.components),
        "size": 1.0 + float(np.abs(loads.components).max(initial=0.0)),
        "limited": limited, "unit": " N (N m)" if limited else " N",
        "parts": list(_parts(held)), "torque": held.torque.tolist(), "gain": held.gain.tolist(),
        "loads": loads.corners[:, motors].tolist(), "columns": loads.columns[:, motors].tolist(),
        "motors": loads.balance.per_weight[motors].tolist(), "cones": sets.cone_columns.tolist(), "friction": sets.mu.tolist(),
        "low": [x if np.isfinite(x) else None for x in np.asarray(limits[0]).tolist()],
        "high": [x if np.isfinite(x) else None for x in np.asarray(limits[1]).tolist()],
        "at": state.frame(loads.pushes[0].frame, loads.pushes[0].offset).X_WF.translation.tolist() if loads.pushes else None,
    }  # fmt: skip
    title, about = (
        html.escape(f"{robot.name}: every member is held"),
        html.escape(f"{held} Squares are the corners of the push, at a scale of their own. rbd {VERSION}."),
    )
    target = Path(os.path.expanduser(path))
    write_page(target, _PAGE.substitute(title=title, about=about, data=script_safe(json.dumps(data))))
    return target


def _parts(held: RobustHold) -> Iterator[dict[str, Any]]:
    """Of each part of the set its numbers' ends, its forces, and its corrections at the upper ends."""
    n = len(held.loads.columns)
    left: list[tuple[Any, list[float], list[float]]] = [(held.document["proof"], [-1.0] * n, [1.0] * n)]
    while left:
        part, low, high = left.pop()
        if "split" in part:
            i, at = part["split"], float(verifier.exact(part["at"]))
            left += [
                (part["above"], [*low[:i], at, *low[i + 1 :]], high),
                (part["below"], low, [*high[:i], at, *high[i + 1 :]]),
            ]
        else:
            floats = {name: np.array(verifier.exact(part[name]), float).tolist() for name in ("forces", "corrections")}
            yield {"low": low, "high": high} | floats


def _points(held: RobustHold) -> list[dict[str, Any]]:
    """Of each contact point its contact, its place, and its force in W by the weights of the proof."""
    out = []
    for i, row in enumerate(held.loads.balance.rows):
        maps = held.loads.balance.sets.point_map(i)
        if row.patch is not None and maps is not None:
            for k, at in enumerate(np.atleast_2d(row.patch.corners_W)[: len(maps) // 3]):
                force = row.patch.axes @ maps[3 * k : 3 * k + 3]
                out.append({"name": row.name, "at": at.tolist(), "map": force.tolist()})
    return out


def _simplices(corners: Array) -> list[dict[str, Any]]:
    """Simplices that fill the hull of corners, each with its numbers and the map of (push, 1) to shares of them."""
    middle = corners.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners - middle, full_matrices=False)
    flat = (corners - middle) @ axes[sizes > 1e-9 * (1.0 + sizes.max(initial=0.0))].T
    if flat.shape[1] == 0:
        found = [[0]]
    elif flat.shape[1] == 1:
        found = [[int(flat[:, 0].argmin()), int(flat[:, 0].argmax())]]
    else:
        found = Delaunay(flat).simplices.tolist()
    return [{"at": s, "map": np.linalg.pinv(np.column_stack([corners[s], np.ones(len(s))]).T).tolist()} for s in found]


def _sliders(held: RobustHold) -> tuple[list[dict[str, Any]], list[str]]:
    """(sliders, the one that sets each uncertain number)."""
    loads = held.loads
    ends = np.column_stack([loads.components.min(axis=0), loads.components.max(axis=0)])
    out, kinds = list[dict[str, Any]](), ["mass" if n.startswith("mass") else f"com_{n[0]}" for n in loads.names]
    more = 0.25 * max(float(np.ptp(ends, axis=1).max(initial=0.0)), 1.0)
    for i, (low, high) in enumerate(ends.tolist()):
        out.append(_slider(f"push{i}", f"push along {'xyz'[i]}", low - more, high + more, 0.5 * (low + high), "N"))
    heavy = [(half, middle) for _, at, middle, half in [x for x, k in zip(loads.links, kinds, strict=True) if k == "mass"]]
    if heavy:
        share = 100.0 * max(half / middle for half, middle in heavy)
        out.append(_slider("mass", "masses", -1.5, 1.5, 0.0, "%", share) | {"unit": True})
    for axis in "xyz":
        widths = [x[3] for x, kind in zip(loads.links, kinds, strict=True) if kind == f"com_{axis}"]
        if widths:
            words = f"centre of mass, {axis}"
            out.append(_slider(f"com_{axis}", words, -1.5, 1.5, 0.0, "cm", 100.0 * max(widths)) | {"unit": True})
    out.append(_slider("friction", "friction", 0.8, 2.0, 1.0, "x least"))
    return out, kinds


def _slider(name: str, label: str, low: float, high: float, start: float, suffix: str, factor: float = 1.0) -> dict[str, Any]:
    return {
        "name": name, "label": label, "low": low, "high": high, "start": start, "suffix": suffix, "factor": factor,
        "unit": False,
    }  # fmt: skip
