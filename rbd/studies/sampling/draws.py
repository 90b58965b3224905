"""`grid`, all combinations of given values; `sample`, random and quasi-random draws of arguments."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from rbd.arrays import Array, as_float, check_seed, check_whole
from rbd.errors import InputError, nearest
from rbd.studies.provenance.identity import add
from rbd.studies.sampling.columns import Column, check_name, column, is_one
from rbd.studies.sampling.samples import Samples

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
    asked = _all_ranges(ranges, more)
    varying = [name for name, given in asked.items() if isinstance(given, tuple) or _draws(given) or not is_one(given)]
    if not varying:
        raise InputError(
            "sample has no range to draw from; give at least one, such as friction=(0.1, 1.0). For a function that draws "
            "from its rng only, number the calls: rbd.grid(trial=range(1000))."
        )
    choices = {name: _check(name, asked[name]) for name in varying}
    try:
        unit = points(count, len(varying), method, root)
        drawn = {name: _column(name, asked[name], choices[name], unit[:, i]) for i, name in enumerate(varying)}
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


def _all_ranges(ranges: Mapping[str, object] | None, more: Mapping[str, object]) -> dict[str, object]:
    if ranges is not None and not isinstance(ranges, Mapping):
        hint = "expected a mapping, {'seed': (0, 1)}, or ranges by name: friction=(0.1, 1.0)"
        raise InputError(f"ranges is {ranges!r:.80}; {hint}.")
    asked = {**(ranges or {}), **more}
    for name in asked:
        check_name(name)
    if ranges and (twice := sorted(set(ranges) & set(more))):
        raise InputError(f"{twice[0]} is given twice, in ranges and by name; give it once.")
    return asked


def _draws(given: object) -> bool:
    """Whether this is a distribution."""
    return not isinstance(given, type) and any(hasattr(given, name) for name in ("ppf", "icdf", "rvs"))


def _quantile(given: Any) -> Any:
    """The inverse of the cumulative distribution function of a distribution; None of all else."""
    return (getattr(given, "ppf", None) or getattr(given, "icdf", None)) if _draws(given) else None


def _check(name: str, given: Any) -> Column | None:
    """The column of what is chosen from; None of a range or a distribution, which is checked.

    Raises:
        InputError: what cannot be drawn from.
    """
    if isinstance(given, tuple) and all(isinstance(x, int | float | np.number) and not isinstance(x, bool) for x in given):
        if len(given) != 2 or not all(np.isfinite(as_float(x)) for x in given):
            raise InputError(f"{name} is {given!r:.80}; expected (low, high), two finite numbers; a list to choose from.")
        low, high = map(float, given)
        if not low < high or not np.isfinite(high - low):
            raise InputError(
                f"{name} is ({low:g}, {high:g}); expected (low, high) with low below high; one number if it is fixed."
            )
        return None
    if (ppf := _quantile(given)) is not None:
        _check_distribution(name, ppf)
        return None
    if _draws(given):
        raise InputError(
            f"{name} is a distribution without an inverse cumulative function (of vectors?); draw rows of a table."
        )
    found = column(name, given, "sample")
    if isinstance(given, list) and found.choices is None and found.labels is None and found.values.shape == (2,):
        a, b = given
        raise InputError(
            f"{name} is a list of two numbers: write ({a}, {b}) for a range, numpy.array([{a}, {b}]) for a choice."
        )
    return found


def _check_distribution(name: str, ppf: Any) -> None:
    try:
        at = np.asarray(ppf(QUANTILES), float)
    except (TypeError, ValueError) as error:
        told = "freeze it with its parameters, as scipy.stats.norm(0.5, 0.1)"
        raise InputError(f"{name} is a distribution that gives no quantiles ({str(error)[:120]}); {told}.") from None
    if at.shape != QUANTILES.shape or not np.isfinite(at).all():
        raise InputError(f"{name} is a distribution whose quantiles are not finite numbers; check its parameters.")


def _column(name: str, given: Any, chosen: Column | None, unit: Array) -> Column:
    """Draws of one argument from those of (0, 1)."""
    if chosen is not None:
        at = np.minimum((unit * len(chosen)).astype(np.int64), len(chosen) - 1)
        labels = chosen.labels if chosen.choices is not None or chosen.labels is None else chosen.labels[at]
        return Column(name, "sample", chosen.values[at], chosen.choices, labels, chosen.units)
    if isinstance(given, tuple):
        low, high = map(float, given)
        return Column(name, "sample", np.minimum(low + (high - low) * unit, high))
    ppf = _quantile(given)
    values = np.asarray(ppf(unit), float)
    if not np.isfinite(values).all():
        raise InputError(f"{name} has draws that are not finite; check the parameters of its distribution.")
    if hasattr(getattr(given, "dist", None), "pmf"):
        values = values.astype(np.int64)
    # Quantiles may differ in the last bits from platform to platform; the draws of (0, 1) do not.
    mark = hashlib.sha256()
    shown = [f"{x:.9g}" for x in np.asarray(ppf(QUANTILES), float)]
    add(mark, (unit, type(given).__qualname__, shown), type(given).__qualname__)
    return Column(name, "sample", values, mark=mark.hexdigest())


def grid(arguments: Mapping[str, object] | None = None, /, **values: object) -> Samples:
    """All combinations of the values of each argument, the last varying fastest; for `rbd.study`.

    Only the values are in memory, never the combinations: a grid of 10^9 samples costs as much as its axes. Each argument with
    values is a dimension of the dataset, and they are its coordinate; their order is kept. NaN is a number like others.

    Args:
        arguments: {argument: values}, in place of or beside those by name: `rbd.grid({"friction": [0.3, 0.6]})`.
        values: For each argument of the function one of

            - numbers, truth values or texts in a list, array, range or series, each once;
            - objects, such as robots, contacts, laws, or lists of contacts: coordinates show their names. Names that repeat
              are refused; `{label: object}` names objects, and numbers too: `friction={"ice": 0.05, "rubber": 0.9}`;
            - vectors or matrices, shape (n, ...), along the first axis: the coordinate numbers them, or has the labels of a
              mapping, and `<name>_value` contains them;
            - one value, such as `robot=talos`: it is the same in all samples, and a coordinate without a dimension.

    Returns:
        The samples. `grid(...) * rbd.sample(...)` are draws at every point, `grid(...) * table` every row of a table at every
        point: for arguments that vary together.

    Raises:
        InputError: no argument, one that is given twice, an argument without values, values or labels that repeat, vectors of
            different lengths.

    Example:
        >>> print(rbd.grid(law=["convex", "coulomb"], push=[(0, 9, 0), (9, 0, 0), (9, 9, 0)], friction=0.7))
        6 samples: law (2) x push (3)
          law       2 values: convex, coulomb
          push      3 arrays of shape (3,)
          friction  0.7 in all
    """
    named = _named(arguments) if arguments is not None else {}
    if twice := sorted(set(named) & set(values)):
        raise InputError(f"{twice[0]} is given twice, in the mapping and by name; give it once.")
    given = [column(name, each, name, distinct=True) for name, each in {**named, **values}.items()]
    return Samples({each.name: len(each) for each in given if each.dim}, tuple(given))


def _named(arguments: object) -> Mapping[str, object]:
    """The mapping that a user gave.

    Raises:
        InputError: something else, or a dataset, whose variables are no axes of a grid.
    """
    table = hasattr(arguments, "columns") or hasattr(arguments, "dims")
    if not isinstance(arguments, Mapping) or table:
        told = "rbd.study takes the rows of tables as they are" if table else "name them"
        raise InputError(
            f"grid has a {type(arguments).__name__}; expected arguments by name, rbd.grid(friction=[0.3, 0.6]), or a mapping "
            f"of them, rbd.grid({{'friction': [0.3, 0.6]}}). Please: {told}."
        )
    return arguments
