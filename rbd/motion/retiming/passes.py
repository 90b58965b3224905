"""The fastest way through sets of (u, x) along a path: backward over what can go on to the end, forward as fast as that allows.

On a grid s_0, s_1, ... the acceleration u = s'' is constant from point to point, so that x = s'^2 is linear in s:
x_j+1 = x_j + 2 h u. Each step keeps to the sets at its ends and in its middle. Backward, K_j is the interval of those x from
which a u leads into K_j+1; forward, the largest x_j+1 in K_j+1 is taken: time-optimal path parameterisation by reachability
[PhamPham2018], algorithm 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, lazy
from rbd.motion.retiming.path_sets import TOLERANCE, PathSet

CHECKED = (0.0, 0.5, 1.0)
"""Where a step keeps to the sets, in shares of it."""
_CUTS = 50
"""Half-planes that are added at most where the largest x of a set is looked for: five are common."""
_PARALLEL = 1e-12
_EVEN = 1e-9
"""Bounds that cross by less, over the size of what they bound, are one."""


@dataclass(frozen=True, eq=False)
class Step:
    """The half-planes of a step in (u, x) at its beginning: a u + b x <= c.

    Attributes:
        a: Shape (r,).
        b: Shape (r,).
        c: Shape (r,).
        causes: What each stands for.
        h: Length of the step [s].
    """

    a: Array
    b: Array
    c: Array
    causes: Sequence[str]
    h: float

    @classmethod
    def of(cls, sets: Sequence[PathSet], h: float) -> Step:
        """Of the sets at `CHECKED`."""
        along = np.concatenate([np.full(len(each.sides), 2.0 * h * share) for each, share in zip(sets, CHECKED, strict=True)])
        normals = np.concatenate([each.normals for each in sets])
        sides = np.concatenate([each.sides for each in sets])
        causes = [cause for each in sets for cause in each.causes]
        return cls(normals[:, 0] + along * normals[:, 1], normals[:, 1], sides, causes, h)

    @classmethod
    def standing(cls, own: PathSet) -> Step:
        """Of one set, without a step."""
        return cls(own.normals[:, 0], own.normals[:, 1], own.sides, own.causes, 0.0)

    @lazy
    def unlikely(self) -> Array:
        """What is added where the nearest half-plane is looked for: x >= 0 is none, and `fastest` only if nothing else is."""
        return np.array([{"rest": np.inf, "fastest": 1e-6}.get(cause, 0.0) for cause in self.causes])

    def before(self, least: float, most: float) -> tuple[float, float]:
        """(least, most) x at its beginning from which a u leads to an x at its end from least to most; crossed if none."""
        return self._between(least, most)[:2]

    @property
    def largest(self) -> float:
        """The largest x, NaN where there is none."""
        least, most = self.before(0.0, np.inf)
        return most if least <= most else np.nan

    def against(self, least: float, most: float) -> set[str]:
        """What is in the way where there is none."""
        return set(self._between(least, most)[2])

    def _between(self, least: float, most: float) -> tuple[float, float, list[str]]:
        """(least, most, causes of both): u is eliminated, each upper bound of it being above each lower one."""
        a, b, c = (np.append(each, more) for each, more in ((self.a, [2.0 * self.h, -2.0 * self.h]), (self.b, [1.0, -1.0]),
                   (self.c, [most, -least])))  # fmt: skip
        size, up, down = np.abs(a), np.flatnonzero(a > _PARALLEL), np.flatnonzero(a < -_PARALLEL)
        flat = np.flatnonzero(np.abs(a) <= _PARALLEL)
        slope = np.append(np.add.outer(b[up] / size[up], b[down] / size[down]).ravel(), b[flat])
        side = np.append(np.add.outer(c[up] / size[up], c[down] / size[down]).ravel(), c[flat])
        more, less = slope > _PARALLEL, slope < -_PARALLEL
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = side / slope
        never = ~(more | less) & (side < -_EVEN)
        high, low = np.where(more, ends, np.inf), np.where(less, ends, -np.inf)
        chosen = [int(never.argmax())] if never.any() else [int(low.argmax()), int(high.argmin())]
        names = [*self.causes, "", ""]
        pairs = [(up[k // len(down)], down[k % len(down)]) if k < len(up) * len(down) else (flat[k - len(up) * len(down)],) * 2
                 for k in chosen]  # fmt: skip
        causes = [names[i] for pair in pairs for i in pair if names[i] not in ("", "rest")]
        if never.any():
            return np.inf, -np.inf, causes
        x0, x1 = max(float(low.max()), 0.0) + 0.0, float(high.min())
        if 0.0 < x0 - x1 <= _EVEN * (1.0 + abs(x1)):
            x0 = x1 = max(x1, 0.0)
        return x0, x1, causes

    def fastest(self, x: float, most: float) -> tuple[float, str]:
        """(u, cause): the largest u at x that leads to at most the largest x at the end, and what bounds it."""
        room = self.c - self.b * x
        up, down = self.a > _PARALLEL, self.a < -_PARALLEL
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.where(up, room / self.a, np.inf)
            low = np.where(down, room / self.a, -np.inf)
        leads = (most - x) / (2.0 * self.h) if self.h else np.inf
        u = min(float(ends.min(initial=np.inf)), leads)
        u = max(u, min(float(low.max(initial=-np.inf)), leads))
        u = u if np.isfinite(u) else 0.0
        near = (room - self.a * u) / np.maximum(np.maximum(np.abs(self.c), np.abs(self.a * u)), 1.0)
        return u, self.causes[int((near + self.unlikely).argmin())]


def fastest_alone(own: PathSet) -> float:
    """The largest x of a set, whatever the u; NaN of an empty one."""
    for _ in range(_CUTS):
        step = Step.standing(own)
        x = step.largest
        if own.empty or np.isnan(x):
            return np.nan
        u = step.fastest(x, np.inf)[0]
        if own.separate(np.array([u, x])) <= 2.0 * TOLERANCE:
            break
    return x


def controllable(steps: Sequence[Step], end: tuple[float, float]) -> tuple[Array, int]:
    """(intervals of x, shape (n + 1, 2), first): from which the end can be reached; valid from the point `first` on.

    `first` is 0 where all are; else no x at the point before it leads on.
    """
    out = np.empty((len(steps) + 1, 2))
    out[-1] = end
    for j in range(len(steps) - 1, -1, -1):
        out[j] = steps[j].before(*out[j + 1])
        if out[j, 0] > out[j, 1]:
            return out, j + 1
    return out, 0


def fastest(steps: Sequence[Step], reach: Array, start: float) -> tuple[Array, Array, list[str]]:
    """(x, u, causes) of the fastest timing, shapes (n + 1,) and (n,), from an x at the beginning."""
    x, u, causes = np.empty(len(steps) + 1), np.empty(len(steps)), []
    x[0] = start
    for j, step in enumerate(steps):
        u[j], cause = step.fastest(x[j], reach[j + 1, 1])
        causes.append(cause)
        x[j + 1] = min(max(x[j] + 2.0 * step.h * u[j], reach[j + 1, 0]), reach[j + 1, 1])
        u[j] = (x[j + 1] - x[j]) / (2.0 * step.h)
    return x, u, causes
