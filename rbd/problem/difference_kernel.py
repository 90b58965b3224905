"""The compiled arithmetic of differences along a curve, of sixth order, judged by those of fourth on the same nodes."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, NUMBER, array, compiled, signature

_FIRST = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
_SECOND = np.array([2.0, -27.0, 270.0, 270.0, -27.0, 2.0]) / 180.0
_WEIGHTS = np.array(
    [
        _FIRST,
        _FIRST - np.array([0.0, 1.0, -8.0, 8.0, -1.0, 0.0]) / 12.0,
        _SECOND,
        _SECOND - np.array([0.0, -1.0, 16.0, 16.0, -1.0, 0.0]) / 12.0,
    ]
)
"""Of the values less that in the middle: the first derivative, its gap from that of fourth order, the second, its gap."""
_AGREED, _LEAST = (3e-8, 1e-7), (1e-6, 1e-4)
"""Of first and of second derivatives: errors of fourth and sixth order are h^4 and h^6, so that if the gap between them is at
most this, over the size of derivative and value, the sixth is exact to 1e-11 and 5e-11; and the least such size."""


def _judged(
    moved: Array, middle: Array, steps: Array, left: Array, slopes: int, size: float, found: Array
) -> tuple[Array, float]:
    """(directions whose orders do not agree at any of the steps, size of the first derivatives that are known).

    Args:
        moved: Values at the nodes, shape (k, steps, 6, m).
        middle: That in the middle, shape (m,).
        steps: Lengths of the steps, from the first on.
        left: The k directions of `moved`, among n.
        slopes: How many of the n directions, the first ones, want the first derivative; the others want the second.
        size: Size of first derivatives.
        found: The best derivatives so far, their gaps between two orders (infinite where there is none), and their scales,
            shape (n, m + 2); changed.
    """
    k, m = len(left), len(middle)
    value, gap, scale, open_ = np.empty((k, m)), np.empty(k), np.empty(k), np.ones(k, np.bool_)
    z, x = np.empty(4), np.empty(4)
    for j in range(len(steps)):
        h = steps[j]
        known = size
        for r in range(k):
            if not open_[r]:
                continue
            second = int(left[r] >= slopes)
            z[:], inside = 0.0, True
            for c in range(m):
                x[:] = 0.0
                for node in range(6):
                    change = moved[r, j, node, c] - middle[c]
                    inside = inside and math.isfinite(change)
                    for i in range(4):
                        x[i] += _WEIGHTS[i, node] * change
                x[:2] /= h
                x[2:] /= h * h
                value[r, c] = x[2 * second]
                for i in range(4):
                    z[i] = max(z[i], abs(x[i]))
            # A kink in the middle does not affect first differences and appears in second ones, as 1/h.
            gap[r] = z[3] if second else max(z[1], h * z[3])
            scale[r] = max(z[0], z[2] if second else 0.0, _LEAST[second], size)
            for c in range(m):
                scale[r] = max(scale[r], abs(middle[c]))
            if not inside:  # the step left the function's domain
                gap[r] = np.inf
            elif not second and gap[r] <= _AGREED[0] * scale[r]:
                known = max(known, z[0])
        size = known
        for r in range(k):
            if open_[r]:
                # Rounding in a derivative of zero is small against the others, and needs no smaller step.
                at, scale[r] = left[r], max(scale[r], size)
                if gap[r] < np.inf and gap[r] * found[at, m + 1] < found[at, m] * scale[r]:
                    found[at, :m], found[at, m], found[at, m + 1] = value[r], gap[r], scale[r]
                open_[r] = not gap[r] <= _AGREED[int(at >= slopes)] * scale[r]
    return left[open_], size


judged = compiled(
    _judged,
    signature(
        (array(1, COUNT, written=True), NUMBER),
        *(array(4), array(1), array(1), array(1, COUNT), COUNT, NUMBER, array(2, written=True)),
    ),
)
