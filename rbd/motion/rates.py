"""Whether given velocities and accelerations are the rates of q; those of a base in world axes are converted to its own.

Steps of q are compared with integrals of v, and steps of v with integrals of a, by the trapezoidal rule, over one interval and
over 2, 4, 8, ... up to a quarter of a second, in which noise averages out. Positions of a base are compared in world axes. What
sampling and noise leave open is read from the samples themselves: a velocity may be that of half a frame earlier or later, and
second differences show noise. Spans that stand out from those around them, as those with impacts do, are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import (
    conjugate,
    flat_coordinates,
    logarithm,
    product,
    quaternions,
    rotated,
    spin_terms,
    to_world,
)

SHARE = 0.1
"""Share of a velocity by which it may be off: 50 Hz taken for 60 are off by 0.17, a lag of 8 ms at 2 Hz by 0.1."""
RISE_SHARE = 0.3
"""The same of accelerations, which hold at an instant: forces that change from step to step leave 0.13."""
REST_RATE, REST_RISE = 5e-3, 0.05
"""Errors below these [m/s, rad/s; m/s2, rad/s2] are not looked at: a bias of sensors at rest; 0.5 % of the weight."""
SURE = 3.0
"""Errors above this many times what sampling and noise leave open are seen."""
NOISE_SHARE = 0.3
"""Error that noise leaves in an interval, over its second differences: sqrt(1/2) / sqrt(6) of a rate, sqrt(2 / 20) of q."""
LONGEST = 0.25
"""Longest time over which rates are integrated [s]."""
JUMP, AROUND = 4.0, 9
"""A span is left out whose error is this many times the median of so many spans around it."""
FEW, FEW_SHARE = 10, 0.3
"""Of so few intervals all columns together must be off by more than this share."""
CLEARER, FEWER, MATTERS = 1.5, 60.0, 0.01
"""Other axes are taken where the mean square error falls to less than its part in 1.5 + 60 / n, and that of the base's own is
more than this share of the rate."""
HALF_TURN, TUMBLE = 0.8 * np.pi, 1.0
"""Turns further than this between two frames [rad], of a wheel and of a body, are ambiguous and not compared."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """How far rates are from the steps that they should explain, for each column.

    Attributes:
        error: Root mean square error of the rate, of the time span at which it is clearest, shape (k,); 0 where it may be none.
        size: Root mean square of the rate there, shape (k,).
        factor: The given rate over that of the steps, in the least-squares sense, shape (k,).
        square: Mean square of the error over all spans, shape (k,), also of what may be none.
        scale: The same of the rates, shape (k,).
    """

    error: Array
    size: Array
    factor: Array
    square: Array
    scale: Array


def misfit(t: Array, steps: Array, x: Array, share: float, least: float | Array) -> Misfit:
    """That of rates x, shape (n, k), with steps between frames, shape (n - 1, k).

    Errors below a share of the rates, or below `least`, count as none.
    """
    h = np.diff(t)[:, None]
    given = 0.5 * h * (x[1:] + x[:-1])
    grain = NOISE_SHARE * float(h.mean()) * _rms(np.diff(x, 2, axis=0))
    fast = 0.5 * _rms(np.diff(steps, axis=0))
    ways = np.concatenate([np.zeros((1, 2 * x.shape[1])), np.cumsum(np.hstack([steps, given]), axis=0)])
    k = x.shape[1]
    out = Misfit(np.zeros(k), np.zeros(k), np.ones(k), np.zeros(k), np.zeros(k))
    m, spans = 1, 0
    while m == 1 or (2 * m <= len(h) and m * float(h.mean()) <= LONGEST):
        ends = np.arange(0, len(h) + 1, m)
        d, g = np.hsplit(np.diff(ways[ends], axis=0), 2)
        span = float(np.diff(t[ends]).mean())
        off = np.abs(d - g)
        off[off > JUMP * median_filter(off, size=(min(AROUND, len(off)), 1), mode="nearest")] = 0.0
        error, told = _rms(off), np.maximum(_rms(d), _rms(g))
        shift = 0.5 * span / m * _rms(x[ends[1:]] - x[ends[:-1]])
        open_ = SURE * np.sqrt(shift**2 + m * grain**2 + fast**2)
        seen = (error > open_) & (error > share * told) & (error > least * span)
        if len(h) < FEW:  # too few to know what they leave open: all columns must show it together
            seen &= float((error**2).sum()) > FEW_SHARE**2 * float((told**2).sum())
        clearest = seen & (error / span > out.error)
        square = (d * d).sum(axis=0)
        factor = (g * d).sum(axis=0) / np.where(square > 0.0, square, 1.0)
        for into, value in ((out.error, error / span), (out.size, _rms(d) / span), (out.factor, factor)):
            into[clearest] = value[clearest]
        out.square[:] += (error / span) ** 2
        out.scale[:] += (told / span) ** 2
        m, spans = 2 * m, spans + 1
    out.square[:] /= spans
    out.scale[:] /= spans
    return out


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt((x**2).sum(axis=0) / max(1, len(x))))


def checked_rates(
    robot: CheckedModel, t: Array, q: Array, v: Array, a: Array | None, source: str
) -> tuple[Array, Array | None, list[str]]:
    """(v, a, notes): given velocities and accelerations, if they are the rates of q; those in world axes are converted.

    Accelerations are None where none were given; the notes tell what was converted.

    Raises:
        InputError: they are not; names the coordinate with the largest error and the factor.
    """
    if len(t) < 2:
        return v, a, []
    joints = _Joints(robot, q)
    # All are compared in the axes of `steps`: positions in the world's, rotations in the body's own.
    steps = joints.steps()
    x, axes = joints.fitting({"own": to_world(robot, q, v), "world": joints.into(v)}, lambda y: joints.misfit(t, steps, y))
    _refuse(robot, joints.misfit(t, steps, x), "v", "q", source)
    notes: list[str] = []
    if axes != ("own", "own"):
        v = to_world(robot, q, x, inverse=True)
        notes.append(_note("velocities", *axes))
    if a is None:
        return v, None, notes
    rises, spins = np.diff(x, axis=0), spin_terms(robot, v)
    forms = {"own": to_world(robot, q, a + spins), "world": joints.into(a), "classical": to_world(robot, q, a)}
    # Those of light links are off by what is small beside the others.
    angular, sizes = robot.joints.angular, _rms(a)
    largest = np.where(angular, sizes[angular].max(initial=0.0), sizes[~angular].max(initial=0.0))
    least = np.maximum(REST_RISE, SHARE * largest)
    y, axes = joints.fitting(forms, lambda y: misfit(t, rises, y, RISE_SHARE, least), axes)
    _refuse(robot, misfit(t, rises, y, RISE_SHARE, least), "a", "v", source)
    if axes != ("own", "own"):
        a = to_world(robot, q, y, inverse=True) - spins
        notes.append(_note("accelerations", *axes))
    return v, a, notes


def turning_error(robot: CheckedModel, t: Array, q: Array, v: Array) -> float:
    """Root mean square error of the angular velocities of bases, about their own axes or the world's, the lesser [rad/s]."""
    joints = _Joints(robot, q)
    steps = joints.steps()
    fits = [joints.misfit(t, steps, x) for x in (to_world(robot, q, v), joints.into(v))]
    return float(min(fit.square[joints.turning].sum() for fit in fits) ** 0.5)


class _Joints:
    """A robot's coordinates along configurations, positions of bodies turned into world axes and back."""

    def __init__(self, robot: CheckedModel, q: Array) -> None:
        self.robot, self.q = robot, q
        pieces = robot.joints.pieces
        self.linear = [i for p in pieces if p.kind in ("plane", "space") for i in range(p.v, p.v + p.unit.start)]
        self.bodies = [p for p in pieces if p.kind == "space"]
        self.turning = [i for p in self.bodies for i in range(p.v + 3, p.v + 6)]

    def steps(self) -> Array:
        """Steps of q from frame to frame, positions in world axes, rotations about the body's own, shape (n - 1, nv)."""
        out = np.diff(flat_coordinates(self.robot, self.q), axis=0)
        for at, spin in quaternions(self.robot):
            out[:, spin] = logarithm(product(conjugate(self.q[:-1, at]), self.q[1:, at]))
        return out

    def misfit(self, t: Array, steps: Array, x: Array) -> Misfit:
        """That of velocities; turns that are ambiguous are not compared."""
        steps, given = steps.copy(), 0.5 * np.diff(t)[:, None] * (x[1:] + x[:-1])
        for p in self.robot.joints.pieces:
            if p.kind == "number":
                continue
            at = slice(p.v + p.unit.start, p.v + p.nv)
            far = np.maximum(np.linalg.norm(given[:, at], axis=1), np.linalg.norm(steps[:, at], axis=1))
            far = far > (TUMBLE if p.kind in ("sphere", "space") else HALF_TURN)
            steps[far, at] = given[far, at]
        return misfit(t, steps, x, SHARE, REST_RATE)

    def fitting(
        self, forms: Mapping[str, Array], fit: Callable[[Array], Misfit], axes: tuple[str, str] = ("own", "own")
    ) -> tuple[Array, tuple[str, str]]:
        """(rates, axes of positions and of rotations): of bodies in the form that fits clearly best, else in the axes given."""
        found = {name: fit(x) for name, x in forms.items()}
        clearer = CLEARER + FEWER / len(self.q)
        places, turns = (
            _clearest(found, at, clearer, start) for at, start in zip((self.linear, self.turning), axes, strict=True)
        )
        out = forms["own"].copy()
        out[:, self.linear], out[:, self.turning] = forms[places][:, self.linear], forms[turns][:, self.turning]
        return out, (places, turns)

    def into(self, x: Array) -> Array:
        """Rates in world axes, rotations turned into the body's own; positions as they are."""
        out = x.copy()
        for p in self.bodies:
            out[:, p.v + 3 : p.v + 6] = rotated(conjugate(self.q[:, p.q + 3 : p.q + 7]), x[:, p.v + 3 : p.v + 6])
        return out


def _clearest(found: Mapping[str, Misfit], at: list[int], clearer: float, start: str) -> str:
    """The form that fits best; `start` unless another fits clearly better where that is off."""
    squares = {name: float(fit.square[at].sum()) for name, fit in found.items()}
    best = min(squares, key=lambda name: squares[name])
    size = float(max(fit.scale[at].sum() for fit in found.values()))
    return best if squares[start] > max(clearer * squares[best], MATTERS**2 * size) else start


def _note(what: str, places: str, turns: str) -> str:
    """What was converted."""
    if places == "classical":
        told = "linear accelerations of the base are classical, in its own axes; its velocity's rate has w x v less"
        return f"{told}, and they were converted." if turns == "own" else f"{told}; the angular are in world axes. Converted."
    parts = [f"{name} {what}" for name, axes in (("linear", places), ("angular", turns)) if axes == "world"]
    like = {("world", "own"): ", as MuJoCo's", ("world", "world"): ", as Isaac's and Drake's"}.get((places, turns), "")
    return f"the base's {' and '.join(parts)} are in world axes{like}, and were converted to its own."


def _refuse(robot: CheckedModel, fit: Misfit, what: str, of: str, source: str) -> None:
    """Refuse rates that are not those of what they should be the rates of."""
    bad = np.flatnonzero(fit.error > 0.0)
    if not len(bad):
        return
    worst = int(bad[np.argmax(fit.error[bad])])
    label = robot.joints.velocities[worst]
    factor = float(fit.factor[worst])
    unit = f"{label.unit}/s{'2' if what == 'a' else ''}"
    hint = "Are its rate and times, units, axes and the order of its columns right?"
    if np.abs(fit.factor[bad]).max() < 1e-3:
        hint = "Were zeros given for what was not known?"
    elif abs(factor * np.pi / 180.0 - 1.0) < 0.02 and label.unit == "rad":
        hint = "Is it in degrees?"
    raise InputError(
        f"{source}: {what} is not the rate of {of}. The worst of {len(bad)} columns is {what}[:, {worst}], {label.name}: it is "
        f"{factor:.2f} times that rate, off by {fit.error[worst]:.3g} of {fit.size[worst]:.3g} {unit} (root mean square). "
        f"{hint} Leave out {'v and a' if what == 'v' else 'a'}, to have {'them' if what == 'v' else 'it'} derived, or take "
        "them as they are: trust=True."
    )
