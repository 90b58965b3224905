"""`Layout`: the variables that were kept so far, and whether new ones agree with them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.records import Variable
from rbd.studies.outputs.fields import MESSAGE, OK, REASON, Block

RESERVED = (OK, REASON, MESSAGE, "sample")
"""Names of what every study has."""
_KINDS = {"f": "numbers", "b": "truth values", "i": "codes", "U": "text"}


class Layout:
    """Shapes, kinds, labels and dimensions of what is kept, by the first sample that had it.

    Args:
        arguments: Names of the samples' arguments, which are coordinates of the dataset.

    Attributes:
        first: {variable with entries: the first sample of the first block that has it, and its place there}.
    """

    def __init__(self, arguments: Collection[str] = ()) -> None:
        self._arguments = arguments
        self._first: dict[str, tuple[Variable, tuple[int, ...], str, str]] = {}
        self.first: dict[str, tuple[int, int]] = {}
        self._dims: dict[str, tuple[int, tuple[Any, ...] | None, str]] = {}

    def check(self, block: Block) -> None:
        """Refuse a block whose variables do not agree with those of earlier ones.

        Raises:
            InputError: another shape, kind or other labels; which variable, in which samples.
        """
        start, own = int(block.numbers[0]), (OK, REASON, MESSAGE)
        where = words_of(start, int(block.numbers[-1]) + 1)
        for place, (name, variable) in enumerate(block.variables.items()):
            if name not in own:
                self.agree(name, variable, variable.values.shape[1:], where)
                if variable.values.size:
                    self.first[name] = min(self.first.get(name, (start, place)), (start, place))

    def begin(self, block: Block, first: Mapping[str, Sequence[int]]) -> None:
        """Take over the variables of a stored part, and where each first came."""
        for name, variable in block.variables.items():
            if name not in (OK, REASON, MESSAGE):
                self.agree(name, variable, variable.values.shape[1:], "the store")
        for name, (start, place) in first.items():
            self.first[name] = min(self.first.get(name, (start, place)), (start, place))

    @property
    def forms(self) -> dict[str, Variable]:
        """Variables, each of some samples, by the first sample that has them, in whatever order blocks were finished."""
        return {name: self._first[name][0] for name in sorted(self.first, key=self.first.__getitem__)}

    def agree(self, name: str, variable: Variable, shape: Sequence[int], where: str) -> None:
        """Refuse a variable that does not agree with the first of its name, or whose dimensions disagree with another's.

        Args:
            name: Its name.
            variable: It, of one sample or of many.
            shape: Of one sample's value.
            where: Which samples have it, for the message.

        Raises:
            InputError: see above.
        """
        shape, kind = tuple(shape), kind_of(variable.values.dtype, name, where)
        found = self._first.get(name)
        if found is None:
            self._begin(name, variable, shape, kind, where)
            return
        first, old, old_kind, since = found
        if kind != old_kind:
            raise InputError(
                f"{name!r:.80} holds {_KINDS[kind]} in {where}, and {_KINDS[old_kind]} in {since}. Return one kind always."
            )
        if shape != old:
            raise InputError(
                f"{name!r:.80} has shape {shape} in {where}, and {old} in {since}. Return arrays of one shape, leave it out by "
                "keep=(...), or keep numbers of it: keep={'name': function}. Robots of other sizes are studies of their own."
            )
        if variable.dims != first.dims:
            raise InputError(f"{name!r:.80} has dimensions {variable.dims} in {where}, and {first.dims} in {since}.")
        if variable.units != first.units:
            raise InputError(
                f"{name!r:.80} has the unit {variable.units!r:.40} in {where}, and {first.units!r:.40} in {since}. Return "
                "it in one unit always."
            )
        if variable.labels is not first.labels:
            for dim, labels in variable.labels.items():
                self._same_labels(name, dim, labels, first.labels.get(dim, ()), where, since)

    def _begin(self, name: str, variable: Variable, shape: tuple[int, ...], kind: str, where: str) -> None:
        check_name(name, self._arguments, where)
        if len(variable.dims) != len(shape):
            raise InputError(f"{name!r:.80} has {len(shape)} axes in {where} and dimensions {variable.dims}.")
        for dim, size in zip(variable.dims, shape, strict=True):
            check_name(dim, self._arguments, where, f"a dimension of {name!r:.80}")
            labels = variable.labels.get(dim)
            old = self._dims.setdefault(dim, (size, labels, name))
            if old[0] != size:
                raise InputError(
                    f"{name!r:.80} is {size} long along {dim!r:.80} in {where}, and {old[2]!r:.80} is {old[0]}. Give one of "
                    "their dimensions another name."
                )
            if labels is not None and old[1] is not None and labels is not old[1]:
                self._same_labels(name, dim, labels, old[1], where, f"{old[2]!r:.80}")
        self._first[name] = variable, shape, kind, where

    def _same_labels(self, name: str, dim: str, new: Sequence[Any], old: Sequence[Any], where: str, since: str) -> None:
        if tuple(new) == tuple(old):
            return
        at = next((f"{a!r:.80}, and {b!r:.80}" for a, b in zip(new, old, strict=False) if a != b), "")
        raise InputError(f"{name!r:.80} has other labels along {dim!r:.80} in {where} than in {since}: {at}.")


def words_of(start: int, stop: int) -> str:
    """Consecutive samples in words, for a message; those of a store before anything was computed have none."""
    if stop <= start:
        return "earlier samples"
    return f"sample {start}" if stop == start + 1 else f"samples {start} to {stop - 1}"


def kind_of(dtype: np.dtype, name: str, where: str) -> str:
    """ResultType of the entries of an array: "f" of numbers, "b" of truth values, "i" of codes, "U" of text.

    Raises:
        InputError: neither.
    """
    kind = "U" if dtype.kind in "OT" else dtype.kind  # text of any length, while a block is filled
    if kind not in _KINDS:
        raise InputError(f"{name!r:.80} is an array of {dtype} in {where}; expected real numbers, truth values or text.")
    return kind


def check_name(name: object, arguments: Collection[str], where: str, what: str = "what the function returns") -> None:
    """Refuse a name that no variable, or dimension, of the dataset can have.

    Raises:
        InputError: no text of letters, digits and _, a reserved name, or that of an argument.
    """
    if not isinstance(name, str) or not name.isidentifier() or name.startswith("__"):
        told = f", e.g. {suggested!r}" if isinstance(name, str) and (suggested := _identifier(name)) else ""
        raise InputError(f"{what} in {where} has the name {name!r:.80}; expected letters, digits and _{told}.")
    if name in RESERVED:
        raise InputError(f"{what} in {where} has the name {name!r}, which every study has itself. Choose another name.")
    if name in arguments:
        raise InputError(
            f"{what} in {where} has the name {name!r:.80}, which is an argument of the samples and stands in the dataset "
            "as such. Leave it out, or choose another name."
        )


def _identifier(name: str) -> str:
    plain = "".join(c if c.isalnum() else "_" for c in name)[:60]
    return plain if plain.isidentifier() else ""


def described(values: Mapping[str, Any]) -> str:
    """Names, quoted, for a message."""
    return ", ".join(repr(name)[:80] for name in list(values)[:12]) + (", ..." if len(values) > 12 else "")
