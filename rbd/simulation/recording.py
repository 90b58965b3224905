"""What is kept of a simulation, moment by moment: plain numbers, so that states and problems can go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rbd.arrays import Array, is_finite
from rbd.errors import NoSolution
from rbd.model.dynamics import kinetic_energy, momentum, potential_energy
from rbd.simulation.events import OPEN, Moment, Touch
from rbd.simulation.motion import Motion
from rbd.simulation.trajectory_fields import COLUMNS, RESIDUALS

_VECTORS = tuple(c for c in COLUMNS if c.axis)
_NUMBERS = ("times", "kinetic", "potential", *(c.name for c in RESIDUALS))
_NO_POINTS = -1

Layout = tuple[tuple[str, int, int, int], ...]
"""Of each constraint that says something: name, rows of its force, points and point forces, or -1 where it has none."""


class Recording:
    """Collects moments; each is read once, its `touches` called once, and let go.

    A `State` of a humanoid holds 20 kB and the closure behind `touches` more: ten seconds at 1 ms would be half a gigabyte. A
    moment is one row of numbers here, in which NaN is found in one pass.

    Args:
        motion: What is simulated. Its constraints have an entry even if they never act.

    Attributes:
        motion: What is simulated.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self._sizes = tuple(c.row(motion.robot)[0] for c in _VECTORS)
        self._width = sum(self._sizes) + len(_NUMBERS)
        #: Of each moment: its numbers, the modes of its constraints, and how the numbers are to be read.
        self._moments: list[tuple[Array, tuple[str, ...], Layout]] = []
        self._layouts: dict[Layout, Layout] = {}

    def __len__(self) -> int:
        return len(self._moments)

    def add(self, moment: Moment) -> None:
        """Keep a moment.

        Raises:
            NoSolution: a number of it is not finite; nothing of it is kept then.
        """
        state, touches = moment.state, moment.touches()
        numbers = [moment.t, kinetic_energy(state), potential_energy(state)]
        numbers += [moment.law, moment.drift, moment.drift_rate, moment.penetration]
        parts: list[Any] = [state.q, state.v, moment.a, moment.tau, momentum(state), state.com, numbers]
        layout = []
        for name, touch in touches.items():
            points, forces = touch.points, touch.point_forces
            parts.append(np.ravel(touch.force))
            k, f = _NO_POINTS if points is None else len(points), _NO_POINTS if forces is None else len(forces)
            layout.append((name, len(touch.force), k, f))
            parts += [np.ravel(x) for x in (points, forces) if x is not None]
        row = np.concatenate(parts)
        if not is_finite(row):
            raise NoSolution(
                f"at t = {moment.t:.6g} s {_culprit(parts, touches)} is not finite. Try a shorter step, or softer gains."
            )
        known = self._layouts.setdefault(tuple(layout), tuple(layout))  # one object for all moments that are read alike
        # One append, so that Ctrl-C finds a moment kept whole or not at all.
        self._moments.append((row, tuple([touch.mode for touch in touches.values()]), known))

    def arrays(self) -> dict[str, Array]:
        """All that is one row a moment: times, q, v, a, tau, momentum, com, kinetic, potential and the residuals."""
        whole = np.array([row[: self._width] for row, _, _ in self._moments])
        ends = np.cumsum(self._sizes)
        out = {c.name: whole[:, end - size : end] for c, size, end in zip(_VECTORS, self._sizes, ends, strict=True)}
        return out | {name: whole[:, ends[-1] + k] for k, name in enumerate(_NUMBERS)}

    def touches(self) -> dict[str, dict[str, Array]]:
        """What the constraints did: `forces`, `points`, `point_forces` and `modes` of a `Trajectory`.

        Forces are zero where there were fewer rows than the most there ever were, points NaN and their forces zero where there
        were fewer; a constraint that said nothing is open.
        """
        n, names = len(self), [c.name for c in self.motion.constraints]
        rows, points, forces = dict.fromkeys(names, 0), dict.fromkeys(names, _NO_POINTS), dict.fromkeys(names, _NO_POINTS)
        indices_of: dict[Layout, list[int]] = {}
        for i, (_, _, layout) in enumerate(self._moments):
            indices_of.setdefault(layout, []).append(i)
        for layout in indices_of:
            for name, m, k, f in layout:
                rows[name] = max(rows.get(name, 0), m)
                points[name] = max(points.get(name, _NO_POINTS), k)
                forces[name] = max(forces.get(name, _NO_POINTS), f)
        contacts = [name for name in rows if points[name] != _NO_POINTS]
        out: dict[str, dict[str, Array]] = {
            "forces": {name: np.zeros((n, m)) for name, m in rows.items()},
            "points": {name: np.full((n, points[name], 3), np.nan) for name in contacts},
            "point_forces": {name: np.zeros((n, max(points[name], forces[name]), 3)) for name in contacts},
        }
        words = {name: [OPEN] * n for name in rows}
        for layout, indices in indices_of.items():
            self._unpack(layout, indices, out)
            for c, (name, *_) in enumerate(layout):
                for i in indices:
                    words[name][i] = self._moments[i][1][c]
        return out | {"modes": {name: np.array(each) for name, each in words.items()}}

    def _unpack(self, layout: Layout, indices: list[int], out: dict[str, dict[str, Array]]) -> None:
        """Put the numbers of moments with one layout where they belong."""
        block, at = np.array([self._moments[i][0][self._width :] for i in indices]), 0
        for name, m, k, f in layout:
            out["forces"][name][indices, :m] = block[:, at : at + m]
            at += m
            for what, count in (("points", k), ("point_forces", f)):
                if count != _NO_POINTS:
                    if name in out[what]:
                        out[what][name][indices, :count] = block[:, at : at + 3 * count].reshape(len(indices), count, 3)
                    at += 3 * count


def _culprit(parts: list[Any], touches: Mapping[str, Touch]) -> str:
    """Which of the parts of a moment is not finite."""
    for name, x in zip((*(c.name for c in _VECTORS), "a residual, or the energy,"), parts[: len(_VECTORS) + 1], strict=True):
        if not is_finite(np.asarray(x)):
            return name
    for name, touch in touches.items():
        if not all(x is None or is_finite(np.asarray(x)) for x in (touch.force, touch.points, touch.point_forces)):
            return f"the force of {name!r:.80}"
    return "a number"
