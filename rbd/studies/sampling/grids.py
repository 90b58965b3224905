"""`grid`: all combinations of given values of some arguments."""

from __future__ import annotations

from collections.abc import Mapping

from rbd.errors import InputError
from rbd.studies.sampling.columns import column
from rbd.studies.sampling.samples import Samples


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
