"""`sample`: random and quasi-random draws of arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rbd.arrays import Array, as_float, check_seed, check_whole
from rbd.errors import InputError, nearest
from rbd.model.content_hash import digest
from rbd.studies.samples import Column, Samples, check_name, column, is_one

Method = Literal["sobol", "latin_hypercube", "random"]
METHODS = ("sobol", "latin_hypercube", "random")
MOST_DRAWS = 2**30
"""As many points as SciPy's Sobol sequences have."""
LEAST = 2.0**-54
"""Draws of (0, 1) are moved so far into it, where a distribution may be infinite at its ends."""
QUANTILES = np.linspace(0.02, 0.98, 25)


def sample(
    n: int,
    *,
    method: Method = "sobol",
    seed: int = 0,
    ranges: Mapping[str, object] | None = None,
    **more: object,
) -> Samples:
    """Draws of each argument from its range or distribution, independent of each other; for `rbd.study`.

    Sobol points fill the space more evenly than random ones: means converge nearly as 1/n, in place of 1/sqrt(n). Their balance
    (as many in each half, quarter, ... of a range) is exact where n is a power of two. More points of the same seed begin with
    those of fewer; not so for Latin hypercubes, which have one point in each of n slices of every range.

    Args:
        n: How many, at most 2^30; they are in memory, 8 bytes a number.
        method: "sobol" (scrambled), "latin_hypercube" (both by SciPy), or "random".
        seed: Of the draws; the same seed gives the same draws.
        ranges: {argument: range}, for arguments that have the name of one of these parameters, such as "seed".
        more: For each argument of the function one of

            - `(low, high)`: a tuple of two numbers; uniform between them;
            - a frozen distribution of `scipy.stats`: `norm(0.5, 0.1)`, `loguniform(1, 100)`, `truncnorm(...)`, `randint(1, 9)`;
            - a list, array, `range` or mapping {label: value} of at least two values to choose from, all equally likely;
            - one value: the same in all samples.

    Returns:
        The samples, along the dimension `sample`.

    Raises:
        InputError: n, method or seed that cannot be; no range; an empty or infinite range; a list of two numbers, which may be
            a range or a choice; a distribution with parameters that cannot be, or of vectors.

    Example:
        >>> from scipy.stats import norm
        >>> draws = rbd.sample(256, friction=(0.1, 1.0), mass=norm(20.0, 0.5), law=["convex", "coulomb"], seed=7)
        >>> arguments = draws.columns(0, 256)
        >>> print(f"{arguments['friction'].mean():.3f} {arguments['mass'].std():.2f} {arguments['law'].count('convex')}")
        0.550 0.50 128
    """
    count, root = check_whole("n", n, MOST_DRAWS), check_seed(seed)
    if not isinstance(method, str) or method not in METHODS:
        raise InputError(f"method is {method!r:.80}; {nearest(method, METHODS)}.")
    if not isinstance(ranges, Mapping | None):
        raise InputError(
            f"ranges is {ranges!r:.80}; expected a mapping, {{'seed': (0, 1)}}, or ranges by name: friction=(0.1, 1.0)."
        )
    if twice := sorted(set(ranges or ()) & set(more)):
        raise InputError(f"{twice[0]} is given twice, in ranges and by name; give it once.")
    asked = {**(ranges or {}), **more}
    varying = [name for name, given in asked.items() if isinstance(given, tuple) or _quantile(given) or not is_one(given)]
    if not varying:
        raise InputError(
            "sample has no range to draw from; give at least one, such as friction=(0.1, 1.0). For a function that draws "
            "from its rng only, number the calls: rbd.grid(trial=range(1000))."
        )
    for name in varying:
        check_name(name)
        _check(name, asked[name])
    try:
        unit = points(count, len(varying), method, root)
        drawn = {name: _column(name, asked[name], unit[:, i]) for i, name in enumerate(varying)}
    except MemoryError as error:
        raise InputError(
            f"{count:,} draws of {len(varying)} arguments do not fit into memory; draw fewer at a time."
        ) from error
    return Samples({"sample": count}, tuple(drawn.get(name) or column(name, given, "") for name, given in asked.items()))


def points(n: int, d: int, method: Method, seed: int) -> Array:
    """Points of the open unit cube, shape (n, d); the same on every platform."""
    rng = np.random.default_rng(seed)
    if method == "random":
        return np.maximum(rng.random((n, d)), LEAST)
    from scipy.stats import qmc

    engine = (qmc.Sobol if method == "sobol" else qmc.LatinHypercube)(d, seed=rng)
    # SciPy warns of a first draw that is no power of two; the first point alone is one
    found = np.concatenate([engine.random(1), engine.random(n - 1)]) if method == "sobol" else engine.random(n)
    return np.clip(found, LEAST, 1.0 - 2.0**-53)


def _quantile(given: Any) -> Any:
    """The inverse of the cumulative distribution function of a distribution; None of all else."""
    drawn = not isinstance(given, type) and any(hasattr(given, name) for name in ("ppf", "icdf", "rvs"))
    return (getattr(given, "ppf", None) or getattr(given, "icdf", None) or _without_quantiles) if drawn else None


def _without_quantiles(at: Array) -> Array:
    """In place of the quantiles of a distribution that has none.

    Raises:
        ValueError: always.
    """
    raise ValueError("it has no inverse cumulative function, as of vectors; draw rows of a table")


def _is_range(given: Any) -> bool:
    numbers = isinstance(given, tuple) and all(isinstance(x, int | float | np.number) for x in given)
    return numbers and not any(isinstance(x, bool) for x in given)


def _check(name: str, given: Any) -> None:
    """Refuse what cannot be drawn from.

    Raises:
        InputError: says what was expected.
    """
    if _is_range(given):
        if len(given) != 2 or not all(np.isfinite(as_float(x)) for x in given):
            raise InputError(f"{name} is {given!r:.80}; expected (low, high), two finite numbers; a list to choose from.")
        low, high = map(float, given)
        if not low < high or not np.isfinite(high - low):
            raise InputError(
                f"{name} is ({low:g}, {high:g}); expected (low, high) with low below high; one number if it is fixed."
            )
    elif (ppf := _quantile(given)) is not None:
        try:
            at = np.asarray(ppf(QUANTILES), float)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{name} is a distribution that gives no quantiles ({str(error)[:120]}); freeze it with its parameters, as "
                "scipy.stats.norm(0.5, 0.1)."
            ) from None
        if at.shape != QUANTILES.shape or not np.isfinite(at).all():
            raise InputError(f"{name} is a distribution whose quantiles are not finite numbers; check its parameters.")
    elif isinstance(given, list) and len(given) == 2 and _is_range(tuple(given)):
        a, b = given
        raise InputError(
            f"{name} is a list of two numbers: write ({a}, {b}) for a range, numpy.array([{a}, {b}]) for a choice."
        )


def _column(name: str, given: Any, unit: Array) -> Column:
    """Draws of one argument from those of (0, 1)."""
    if _is_range(given):
        low, high = map(float, given)
        return Column(name, "sample", np.minimum(low + (high - low) * unit, high))
    if (ppf := _quantile(given)) is None:
        chosen = column(name, given, "sample")
        at = np.minimum((unit * len(chosen)).astype(np.int64), len(chosen) - 1)
        return replace(chosen, values=chosen.values[at], labels=None if chosen.labels is None else chosen.labels[at])
    values = np.asarray(ppf(unit), float)
    if not np.isfinite(values).all():
        raise InputError(f"{name} has draws that are not finite; check the parameters of its distribution.")
    if hasattr(getattr(given, "dist", None), "pmf"):
        values = values.astype(np.int64)
    # Quantiles may differ in the last bits from platform to platform; the draws of (0, 1) do not.
    shown = [f"{x:.9g}" for x in np.asarray(ppf(QUANTILES), float)]
    return Column(name, "sample", values, mark=digest((unit, type(given).__qualname__, shown), name))
