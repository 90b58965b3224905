"""The certificate of a motion, printed: how it was made, what it kept, how far it is from its laws."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array
from rbd.simulation.recording import RESIDUALS

if TYPE_CHECKING:
    from rbd.simulation.trajectory import Trajectory

_EVENTS, _CONSTRAINTS = 8, 16
"""So many are listed."""


def table(trajectory: Trajectory) -> str:
    """Duration, steps, method; energy and momentum; worst residuals; constraints; first events."""
    lines = [_headline(trajectory), *_method(trajectory), *_kept(trajectory), *_residuals(trajectory)]
    return "\n".join([*lines, *_constraints(trajectory), *_events(trajectory)])


def _headline(x: Trajectory) -> str:
    steps = f" by steps of {_number(1e3 * x.step)} ms" if x.step else ""
    ended = f"; {x.interrupted}" if x.interrupted else ""
    return f"{x.robot.name}: {x.times[0]:g} to {x.times[-1]:g} s{steps}, {len(x)} samples{ended}"


def _method(x: Trajectory) -> list[str]:
    said = [("integrator", x.integrator), ("contact law", x.law), ("kept by", x.stabilisation)]
    return [_line(what, text) for what, text in said if text]


def _kept(x: Trajectory) -> list[str]:
    change, swing = x.energy - x.energy[0], float(np.ptp(x.energy))
    moved = x.com[-1] - x.com[0]
    return [
        _line("energy", f"{x.energy[0]:.6g} J -> {x.energy[-1]:.6g} J, change {change[-1]:.3g} J, range {swing:.3g} J"),
        _line("", f"kinetic {x.kinetic[0]:.4g} -> {x.kinetic[-1]:.4g} J, at most {x.kinetic.max():.4g} J"),
        _line("centre of mass", f"moved ({_vector(moved)}) m"),
        _line("momentum", f"({_vector(x.momentum[-1, :3])}) N s, ({_vector(x.momentum[-1, 3:])}) N m s at the end"),
    ]


def _residuals(x: Trajectory) -> list[str]:
    out = []
    for i, (name, unit) in enumerate(RESIDUALS.items()):
        values = x.residuals[name]
        worst = int(np.argmax(np.abs(values)))
        said = f"{name.replace('_', ' ')} {abs(values[worst]):.1e}"
        said += " (scaled)" if unit == "1" else f" {unit}"
        out.append(_line("" if i else "worst residuals", said + (f" at {x.times[worst]:.4g} s" if values[worst] else "")))
    return out


def _constraints(x: Trajectory) -> list[str]:
    names = x.names[:_CONSTRAINTS]
    width = max([0, *(len(name) for name in names)])
    out = []
    for i, name in enumerate(names):
        force, contact = x.forces[name], name in x.points
        size = np.linalg.norm(force[:, :3], axis=1) if contact else np.abs(force).max(axis=1, initial=0.0)
        most = int(np.argmax(size))
        unit = "N" if contact else "N or N m"
        largest = f"at most {size[most]:.4g} {unit} at {x.times[most]:.4g} s" if size[most] else "no force"
        out.append(_line("" if i else "constraints", f"{name:<{width}}  {x.modes[name][-1]} at the end, {largest}"))
    return out + [_line("", f"and {len(x.names) - len(names)} more")] * (len(x.names) > len(names))


def _events(x: Trajectory) -> list[str]:
    shown = x.events[:_EVENTS]
    out = [_line("" if i else f"{len(x.events)} events", str(event)) for i, event in enumerate(shown)]
    return out + [_line("", f"and {len(x.events) - len(shown)} more")] * (len(x.events) > len(shown))


def _line(what: str, text: str) -> str:
    return f"  {what:<16}{text}"


def _number(x: float) -> str:
    return f"{x:.6g}"


def _vector(x: Array) -> str:
    return ", ".join(f"{value + 0.0:.4g}" for value in np.where(np.abs(x) < 1e-12, 0.0, x))
