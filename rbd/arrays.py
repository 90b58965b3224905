"""Checks of arrays, vectors and numbers; null spaces, ranks and other linear algebra of small matrices."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from typing import Any, Generic, TypeAlias, TypeVar, overload

import numpy as np

from rbd.errors import InputError, SingularInertia
from rbd.errors.inputs import shown

Array: TypeAlias = np.ndarray
Owner = TypeVar("Owner")
Value = TypeVar("Value")
RANK = 1e-9
"""Singular values up to this, over the largest, count as zero: for Jacobians, generators and their combinations.

Rounding leaves 1e-15 for dependent rows, and loops closed to 1e-12 a little more; independent rows of a
robot, such as the lever arm of a millimetre, are at 1e-3 or above.
"""
SQUARED = 1e-11
"""The same for matrices such as J M^-1 J^T, whose singular values are squares: 3e-6 before squaring."""


def _compiled_part(name: str) -> Any:
    """A compiled module of `scipy.linalg` without the rest of it, 0.15 s to import, of which most users need nothing."""
    scipy = find_spec("scipy")
    folders = scipy.submodule_search_locations if scipy is not None else None
    found = PathFinder.find_spec(name, [f"{folder}/linalg" for folder in folders or ()])
    if found is None or found.loader is None:  # another layout of SciPy
        return import_module(f"scipy.linalg.{name.removeprefix('_f')}")
    module = module_from_spec(found)
    found.loader.exec_module(module)
    return module


blas, lapack = _compiled_part("_fblas"), _compiled_part("_flapack")
"""Of SciPy; `scipy.linalg.blas` and `scipy.linalg.lapack` have the same functions."""


def is_finite(value: Array) -> bool:
    """Whether every entry is finite, and small enough (1e150) to be squared."""
    # One BLAS pass without a temporary: NaN and infinity survive the sum of squares.
    return math.isfinite(np.vdot(value, value))


def check_finite(what: str, value: Array) -> None:
    """Refuse NaN and infinity.

    Raises:
        InputError: naming the first bad entry.
    """
    if not is_finite(value):
        bad = np.argwhere(~np.isfinite(value))
        where = f" at {tuple(int(i) for i in bad[0])}: {value[tuple(bad[0])]}" if len(bad) else ": too large to be squared"
        raise InputError(f"{what} is not finite{where}. Check what it was computed from.")


def max_abs(x: Array) -> float:
    """Largest absolute entry of a vector of finite numbers; zero of an empty one.

    NaN may be ignored: check the input.
    """
    return abs(float(x[blas.idamax(x)])) if len(x) else 0.0


def largest_first(values: object) -> Array:
    """Indices of some numbers from the largest to the smallest; of equal ones the first comes first.

    Numbers are equal if they agree to a millionth of the largest finite size: the order is not decided by rounding, which
    differs from one processor to another. NaN comes last.
    """
    numbers = np.asarray(values, dtype=float)
    finite = numbers[np.isfinite(numbers)]
    unit = 1e-6 * max_abs(finite) or 1.0
    return np.argsort(np.round((finite.max(initial=-np.inf) - numbers) / unit) if len(finite) else -numbers, kind="stable")


def locked(array: Array) -> Array:
    """The array itself, read-only: it is cached, or shared."""
    array.setflags(write=False)
    return array


@lru_cache(maxsize=64)
def zeros(n: int) -> Array:
    """A read-only vector of zeros, cached."""
    return locked(np.zeros(n))


@lru_cache(maxsize=64)
def identity(n: int) -> Array:
    """A read-only identity matrix, made once."""
    return locked(np.eye(n))


def as_array(what: str, value: object) -> Array:
    """Real numbers as a new float array of any shape.

    Raises:
        InputError: on text, dates, complex numbers, masks, ragged lists, integers too large to be floats.
    """
    if type(value) is np.ndarray and value.dtype == float:
        return value.copy()
    try:
        raw = np.array(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} is not an array of numbers: {error}.") from None
    if raw.dtype.kind not in "iuf" or (isinstance(value, np.ndarray) and hasattr(value, "mask")):  # NumPy's masked arrays
        raise InputError(f"{what} is {value!r:.80}; expected real numbers.")
    return raw.astype(float)


def as_float(value: object) -> float:
    """A real number as a float; NaN if it is not one (a truth value, text, an integer too large)."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        return math.nan
    try:
        return float(value)
    except (OverflowError, TypeError):  # a time difference counts as an integer of NumPy's
        return math.nan


def check_positive(what: str, value: float, most: float, unit: str = "") -> float:
    """A number in (0, most]; its unit is for the message.

    Raises:
        InputError: it is none.
    """
    found = as_float(value)
    if not 0.0 < found <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a number above 0, at most {most:g}{unit and f' [{unit}]'}.")
    return found


def check_number(what: str, value: float, least: float, most: float = sys.float_info.max, *, expected: str) -> float:
    """A number within bounds.

    Args:
        what: What it is, for the message.
        value: The number.
        least: The least that it may be.
        most: The most that it may be.
        expected: What was expected, in words.

    Raises:
        InputError: it is none.
    """
    found = as_float(value)
    if not least <= found <= most:
        raise InputError(f"{what} is {value!r:.80}; expected {expected}.")
    return found


ABOVE_ZERO = math.ulp(0.0)
"""The least number above zero."""
BELOW_ONE = math.nextafter(1.0, 0.0)
"""The largest number below one."""


def check_whole(what: str, value: int, most: int = 1_000_000, *, least: int = 1) -> int:
    """A whole number within bounds.

    Raises:
        InputError: it is none, too small, or too large.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(f"{what} is {shown(value)}; expected a whole number from {least} to {most}.")
    return int(value)


def check_seed(seed: int) -> int:
    """A seed of random draws.

    Raises:
        InputError: no whole number from 0.
    """
    return check_whole("seed", seed, 2**63 - 1, least=0)


def check_flag(what: str, value: bool) -> None:
    """Refuse a value that is neither True nor False.

    Raises:
        InputError: with what was expected.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} is {value!r:.80}; expected True or False.")


def as_finite(what: str, value: object, *shapes: tuple[int | str, ...], meaning: str = "") -> Array:
    """Finite numbers as a new array of one of some shapes.

    Args:
        what: What they are, for the message.
        value: The numbers.
        shapes: Of the array; a letter in a shape stands for any number of rows or columns, as in ("n", 3).
        meaning: What the numbers mean, behind the shapes: ": x and y [m]".

    Raises:
        InputError: another shape, no real numbers, NaN or infinity.
    """
    out = as_array(what, value)
    if out.shape not in shapes and not any(_has_shape(out, shape) for shape in shapes):
        expected = " or ".join(str(shape).replace("'", "") for shape in shapes)
        raise InputError(f"{what} has shape {out.shape}; expected {expected}{meaning}.")
    check_finite(what, out)
    return out


def _has_shape(value: Array, shape: tuple[int | str, ...]) -> bool:
    if value.ndim != len(shape):
        return False
    return all(isinstance(expected, str) or size == expected for size, expected in zip(value.shape, shape, strict=True))


def as_vector3(what: str, value: Sequence[float] | Array) -> Array:
    """Three finite numbers as an array; errors as `as_finite`."""
    return as_finite(what, value, (3,), meaning=": three numbers")


def add_wrench(total: list[float], wrench: Sequence[float], point: Sequence[float], about: Sequence[float]) -> None:
    """Add a force (3) or wrench (6) that acts at `point` to the wrench `total` (6) about another point, in place.

    Plain floats: np.cross alone costs ten times as much.
    """
    x, y, z = point[0] - about[0], point[1] - about[1], point[2] - about[2]
    fx, fy, fz = wrench[:3]
    mx, my, mz = wrench[3:] if len(wrench) == 6 else (0.0, 0.0, 0.0)
    total[0] += fx
    total[1] += fy
    total[2] += fz
    total[3] += mx + y * fz - z * fy
    total[4] += my + z * fx - x * fz
    total[5] += mz + x * fy - y * fx


def cross_matrix(p: Array) -> Array:
    """The matrix of p x, shape (3, 3)."""
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


_CROSS = np.array([cross_matrix(e) for e in np.eye(3)])


def cross_matrices(x: Array) -> Array:
    """The matrices of the products with vectors, shapes (..., 3, 3) and (..., 3)."""
    return np.einsum("...k,kij", x, _CROSS)


def cross_rows(a: Array, b: Array) -> Array:
    """Products a x b of the rows, shape (k, 3): for small arrays NumPy's takes five times as long."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u]).T


def each_times(matrices: Array, vectors: Array) -> Array:
    """The product of each matrix with its vector, shape (..., m), of stacks (..., m, n) and (..., n) of real numbers."""
    return np.asarray(np.vecdot(matrices, vectors[..., None, :]))  # np.matvec came with NumPy 2.2


def block_diagonal(blocks: Sequence[Array]) -> Array:
    """Matrices along the diagonal; zero elsewhere."""
    out = np.zeros((sum(b.shape[0] for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + b.shape[0], j : j + b.shape[1]] = b
        i += b.shape[0]
        j += b.shape[1]
    return out


def rows_from(parts: Sequence[tuple[Array, Array]], size: int) -> Array:
    """A view of blocks of memory at equal distances, one a row, shape (n, size): each has the first part, then the second."""
    if not parts:
        return np.zeros((0, size))
    at = np.array([[x.__array_interface__["data"][0] for x in pair] for pair in parts])
    first, steps = parts[0][0], np.diff(at[:, 0])
    step = int(steps[0]) if len(steps) else 8 * size
    assert (steps == step).all() and (at[:, 1] - at[:, 0] == 8 * first.size).all(), "Pinocchio's data are laid out otherwise"
    return np.lib.stride_tricks.as_strided(first, (len(parts), size), (step, 8))


def inertia_factor(M: Array, *, strict: bool = False) -> Array:
    """Lower Cholesky factor L of M = L L^T, shape (nv, nv).

    Args:
        M: Joint-space inertia, symmetric.
        strict: Refuse M also where it is singular to rounding: tiny positive pivots give answers of 1e10 m/s2.

    Raises:
        SingularInertia: M is not positive definite.
    """
    L, info = lapack.dpotrf(M, lower=1, clean=1)
    if info != 0:
        raise SingularInertia(
            f"M({len(M)} x {len(M)}) is not positive definite (leading minor {abs(info)}); "
            "a joint carries no inertia, or an inertia in the file is not physical."
        )
    if strict:
        own = L.diagonal() ** 2 / M.diagonal()  # robots' are above 1e-8
        if (own < 1e-12).any():
            raise SingularInertia(
                f"M is singular to rounding at coordinate {int(np.argmin(own))}: what moves there carries no inertia."
            )
    return L


class lazy(Generic[Owner, Value]):  # noqa: N801  used as a decorator
    """`functools.cached_property` without its lock, which costs more than most values here.

    That lock, one for all owners, would also stay locked in a child forked while another thread computes. Two threads may
    compute a value at the same time; both get the same. Copies and pickles of the owner leave the value out and compute it
    again: it may contain objects that cannot be pickled, such as a compiled function.
    """

    def __init__(self, compute: Callable[[Owner], Value]) -> None:
        self.compute = compute
        self.name = compute.__name__
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        """Define the state of the class's copies and pickles, unless the class defines it."""
        if owner.__getstate__ is object.__getstate__:
            setattr(owner, "__getstate__", without_lazies)  # noqa: B010  mypy allows no assignment to a method

    @overload
    def __get__(self, owner: None, kind: type) -> lazy[Owner, Value]: ...
    @overload
    def __get__(self, owner: Owner, kind: type) -> Value: ...
    def __get__(self, owner: Owner | None, kind: type) -> Value | lazy[Owner, Value]:
        """Compute once; then the value is in the owner's dictionary and this is not called again."""
        if owner is None:
            return self
        value = owner.__dict__[self.name] = self.compute(owner)
        return value


def filled(kind: type[Value], **attributes: object) -> Value:
    """A frozen record with its attributes, in a third of the time of its constructor; one left out has a plain default."""
    out = object.__new__(kind)
    out.__dict__.update(attributes)
    return out


def without_lazies(owner: object) -> dict[str, object]:
    """The attributes of an object, less the values that `lazy` computed: what its copies and pickles have."""
    kind = type(owner)
    return {name: value for name, value in vars(owner).items() if not isinstance(getattr(kind, name, None), lazy)}


def null_space(A: Array, tolerance: float = RANK, *, unit: bool = False) -> Array:
    """Orthonormal basis of the null space of A, shape (n, n - rank).

    Args:
        A: Shape (m, n).
        tolerance: Singular values up to this, over the largest, are zero.
        unit: Measure them against one in place of the largest: A has columns of unit length, or is part of a unitary matrix.
    """
    if not A.size:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[_count(s, tolerance, unit) :].T)


def range_of(A: Array, tolerance: float = RANK, *, unit: bool = False) -> Array:
    """Orthonormal basis of the range of A, shape (m, rank); arguments as of `null_space`."""
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, : _count(s, tolerance, unit)])


def rank_of(A: Array, tolerance: float = RANK, *, unit: bool = False) -> int:
    """The number of singular values that are not zero; arguments as of `null_space`."""
    return _count(np.linalg.svd(A, compute_uv=False), tolerance, unit) if A.size else 0


def _count(s: Array, tolerance: float, unit: bool) -> int:
    return int((s > tolerance * (1.0 if unit else float(s[0]))).sum()) if len(s) else 0
