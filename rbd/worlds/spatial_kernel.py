"""Vectors of three, rotations and symmetric matrices as tuples, of floats or of numbers of eight worlds.

A rotation is nine numbers, row by row; a symmetric matrix six: xx, xy, xz, yy, yz, zz.
"""

from __future__ import annotations

from rbd.arrays import Array
from rbd.kernels import inlined
from rbd.worlds.lanes import Number, load, store

Three = tuple[Number, Number, Number]
Nine = tuple[Number, Number, Number, Number, Number, Number, Number, Number, Number]
Six = tuple[Number, Number, Number, Number, Number, Number]


@inlined
def three(a: Array, i: int) -> Three:
    """Rows i to i + 2."""
    return load(a, i), load(a, i + 1), load(a, i + 2)


@inlined
def put(a: Array, i: int, x: Three) -> None:
    """Write rows i to i + 2."""
    store(a, i, x[0])
    store(a, i + 1, x[1])
    store(a, i + 2, x[2])


@inlined
def six(a: Array, i: int) -> Six:
    """Rows i to i + 5."""
    return load(a, i), load(a, i + 1), load(a, i + 2), load(a, i + 3), load(a, i + 4), load(a, i + 5)


@inlined
def put_six(a: Array, i: int, x: Six) -> None:
    """Write rows i to i + 5."""
    store(a, i, x[0])
    store(a, i + 1, x[1])
    store(a, i + 2, x[2])
    store(a, i + 3, x[3])
    store(a, i + 4, x[4])
    store(a, i + 5, x[5])


@inlined
def nine(a: Array, i: int) -> Nine:
    """Rows i to i + 8."""
    return (
        load(a, i), load(a, i + 1), load(a, i + 2), load(a, i + 3), load(a, i + 4), load(a, i + 5), load(a, i + 6),
        load(a, i + 7), load(a, i + 8),
    )  # fmt: skip


@inlined
def put_nine(a: Array, i: int, x: Nine) -> None:
    """Write rows i to i + 8."""
    put(a, i, (x[0], x[1], x[2]))
    put_six(a, i + 3, (x[3], x[4], x[5], x[6], x[7], x[8]))


@inlined
def plus(a: Three, b: Three) -> Three:
    """A + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def minus(a: Three, b: Three) -> Three:
    """A - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(s: Number, a: Three) -> Three:
    """S a."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def dot(a: Three, b: Three) -> Number:
    """A . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Three, b: Three) -> Three:
    """A x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def turned(R: Nine, a: Three) -> Three:
    """R a."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )


@inlined
def turned_back(R: Nine, a: Three) -> Three:
    """R^T a."""
    return (
        R[0] * a[0] + R[3] * a[1] + R[6] * a[2],
        R[1] * a[0] + R[4] * a[1] + R[7] * a[2],
        R[2] * a[0] + R[5] * a[1] + R[8] * a[2],
    )


@inlined
def times_symmetric(S: Six, a: Three) -> Three:
    """S a."""
    return (
        S[0] * a[0] + S[1] * a[1] + S[2] * a[2],
        S[1] * a[0] + S[3] * a[1] + S[4] * a[2],
        S[2] * a[0] + S[4] * a[1] + S[5] * a[2],
    )


@inlined
def less(S: Six, a: Three, b: Three) -> Six:
    """S - a b^T, which is symmetric."""
    return (
        S[0] - a[0] * b[0], S[1] - a[0] * b[1], S[2] - a[0] * b[2], S[3] - a[1] * b[1], S[4] - a[1] * b[2], S[5] - a[2] * b[2],
    )  # fmt: skip


@inlined
def less_nine(R: Nine, a: Three, b: Three) -> Nine:
    """R - a b^T."""
    return (
        R[0] - a[0] * b[0], R[1] - a[0] * b[1], R[2] - a[0] * b[2], R[3] - a[1] * b[0], R[4] - a[1] * b[1], R[5] - a[1] * b[2],
        R[6] - a[2] * b[0], R[7] - a[2] * b[1], R[8] - a[2] * b[2],
    )  # fmt: skip


@inlined
def turned_symmetric(R: Nine, S: Six) -> Six:
    """R S R^T."""
    a = times_symmetric(S, (R[0], R[1], R[2]))
    b = times_symmetric(S, (R[3], R[4], R[5]))
    c = times_symmetric(S, (R[6], R[7], R[8]))
    x, y, z = (R[0], R[1], R[2]), (R[3], R[4], R[5]), (R[6], R[7], R[8])
    return dot(x, a), dot(x, b), dot(x, c), dot(y, b), dot(y, c), dot(z, c)


@inlined
def rotation(x: Number, y: Number, z: Number, w: Number) -> Nine:
    """Of a unit quaternion."""
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip
