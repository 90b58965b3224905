"""The samples of a study that is drawn, one after another: where they are along each axis, and what is drawn of each."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.errors.reasons import Reason
from rbd.visual.style import CONTACT_COLORS, LIMIT_COLORS, distinct_colors

if TYPE_CHECKING:
    import xarray

OK_COLOR, NOT_RUN_COLOR = "#dfe6ec", "#ffffff"
REASON_COLORS = {
    **{f"cannot_{verb}: friction": LIMIT_COLORS["friction"][0] for verb in ("hold", "move")},
    **{f"cannot_{verb}: motor": LIMIT_COLORS["motor"][0] for verb in ("hold", "move")},
    **{f"cannot_{verb}: support": LIMIT_COLORS["edge"][0] for verb in ("hold", "move")},
    Reason.NONE.value: OK_COLOR,
    Reason.NOT_RUN.value: NOT_RUN_COLOR,
}
"""{text of a reason: its colour}, as far as it is the same in all pictures; the limits have the colours of `plot_pushes`."""
MOST_CATEGORIES = 24
MOST_SAMPLES = 4_000_000
_EXACT = 1e-6
"""Relative difference of steps, or of ratios, that count as the same."""
_SELECTED = re.compile(r"(?P<name>[^\[\]]+)\[(?P<labels>[^\[\]]*)\]")
_CERTIFICATES = ("residual", "worst_residual", "seconds", "iterations")
"""Beginnings of names that are no default to draw."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Where samples are along a dimension or a coordinate.

    Attributes:
        name: Its name in the dataset.
        label: Name and unit.
        at: Of each sample, shape (n,); of categories 0, 1, ... in the order in which they are drawn.
        words: Text of every category; empty of numbers.
        scale: "linear" or "log".
    """

    name: str
    label: str
    at: Array
    words: tuple[str, ...] = ()
    scale: str = "linear"

    def cells(self) -> tuple[Array, Array]:
        """(edges of the cells of all values, shape (k + 1,), increasing; the cell of each sample, shape (n,)).

        Edges are midway between values, and as far beyond the first and the last.
        """
        values, cell = np.unique(self.at, return_inverse=True)
        at = np.log(values) if self.scale == "log" else values
        if len(at) == 1:
            half = 0.5 * abs(at[0]) if at[0] and not self.words else 0.5
            return np.array([at[0] - half, at[0] + half]), cell
        mid = (at[1:] + at[:-1]) / 2.0
        edges = np.concatenate([[2.0 * at[0] - mid[0]], mid, [2.0 * at[-1] - mid[-1]]])
        return np.exp(edges) if self.scale == "log" else edges, cell

    def groups(self) -> list[tuple[str, Array]]:
        """(text, which samples have it) of every value; numbers have as many digits as tell them apart."""
        values = np.unique(self.at)
        names = [self.words[int(value)] for value in values] if self.words else []
        for digits in () if self.words else (6, 9, 17):
            names = [f"{value:.{digits}g}" for value in values]
            if len(set(names)) == len(names):
                break
        return [(name, self.at == value) for name, value in zip(names, values, strict=True)]


@dataclass(frozen=True, eq=False)
class Quantity:
    """What is drawn of each sample.

    Attributes:
        label: Name and unit.
        values: One for each sample: numbers, NaN where there is none; of categories their numbers, -1 where there is none.
        categories: (text, '#rrggbb') of every category; empty of numbers.
    """

    label: str
    values: Array
    categories: tuple[tuple[str, str], ...] = ()

    @property
    def there(self) -> Array:
        """Which samples have a value."""
        return self.values >= 0 if self.categories else np.isfinite(self.values)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples as they are drawn.

    Attributes:
        x: Across.
        y: Up.
        shown: What colours them; None: nothing.
        ok: Which are ok, shape (n,).
        not_run: Which were not run.
    """

    x: Axis
    y: Axis
    shown: Quantity | None
    ok: Array
    not_run: Array

    @property
    def bad(self) -> Array:
        """Which were run and are not ok."""
        return ~self.ok & ~self.not_run

    def some(self, which: Array) -> Samples:
        """Those with `which`, shape (n,)."""
        x, y = (replace(axis, at=axis.at[which]) for axis in (self.x, self.y))
        shown = None if self.shown is None else replace(self.shown, values=self.shown.values[which])
        return Samples(x, y, shown, self.ok[which], self.not_run[which])


class StudyData:
    """A study that is drawn: a dataset that is checked, without dimensions of one entry.

    Args:
        dataset: What `rbd.study` returned, or a selection of it.
        named: Names that the user gave: of dimensions that stay, also where they have one entry.

    Raises:
        InputError: it is none, or has no samples.
    """

    def __init__(self, dataset: object, named: Sequence[object]) -> None:
        known = getattr(dataset, "data_vars", None)
        if not isinstance(known, Mapping) or "ok" not in known or "reason" not in known:
            raise InputError(
                f"the dataset is {type(dataset).__name__}; expected what rbd.study returns, with `ok` and `reason`."
            )
        whole: xarray.Dataset = dataset  # type: ignore[assignment]  # checked by what it has: xarray is an extra
        if whole["ok"].size == 0:
            raise InputError("the study has no samples; there is nothing to draw.")
        if whole["ok"].size > MOST_SAMPLES:
            raise InputError(
                f"the study has {whole['ok'].size} samples, more than a picture shows ({MOST_SAMPLES}); select some: "
                "dataset.isel({'friction': slice(None, None, 10)}), or average them first."
            )
        if whole["ok"].dtype.kind != "b":
            raise InputError(f"ok has values of type {whole['ok'].dtype}; expected truth values, as rbd.study returns them.")
        asked = [name for name in named if isinstance(name, str)]
        single = {d: 0 for d in whole["ok"].dims if whole.sizes[d] == 1 and d not in asked}
        self.dataset = whole.isel(single)
        if not self.dataset["ok"].dims:
            self.dataset = self.dataset.expand_dims(str(next(iter(whole["ok"].dims), "sample")))
        self.dims: tuple[str, ...] = tuple(map(str, self.dataset["ok"].dims))

    @property
    def drawn_at_random(self) -> bool:
        """Whether the samples are draws or rows of a table, and no grid."""
        return len(self.dims) == 1 and self.numbered(self.dims[0])

    def numbered(self, dim: str) -> bool:
        """Whether a dimension only numbers draws or rows, whose arguments are coordinates along it."""
        coords = self.dataset.coords
        if dim == "sample" or dim not in coords:
            return True
        return coords[dim].dtype.kind in "iu" and any(x.dims == (dim,) for name, x in coords.items() if name != dim)

    def axis(self, what: str, name: object) -> Axis:
        """Where the samples are along a dimension or coordinate; `what` is the argument that names it.

        Numbers as they are; else categories, in their order, of draws in that of the alphabet.

        Raises:
            InputError: there is none, or it has more dimensions than one.
        """
        variable = self.variable(what, name)
        values, label, words = np.asarray(variable.values), _label(str(name), variable.attrs), list[str]()
        if values.dtype.kind in "fiu" and np.isfinite(values).all():
            at = values.astype(float)
        else:
            texts = [f"{x:g}" if isinstance(x, float) else str(x) for x in values.tolist()]
            words = list(dict.fromkeys(sorted(texts) if self.drawn_at_random else texts))
            at = np.array([words.index(text) for text in texts], float)
        along = [len(at) if dim in variable.dims else 1 for dim in self.dims]
        each = np.broadcast_to(at.reshape(along), self.dataset["ok"].shape).ravel()
        return Axis(str(name), label, each, tuple(word[:40] for word in words), "linear" if words else _scale(at))

    def variable(self, what: str, name: object) -> xarray.DataArray:
        """A dimension, coordinate or, of draws, any quantity with one value for each sample.

        Raises:
            InputError: there is none.
        """
        table = self.dataset
        fits = [str(n) for n, v in table.coords.items() if len(v.dims) == 1 and v.dims[0] in self.dims]
        names = list(dict.fromkeys([*self.dims, *fits]))
        if self.drawn_at_random:
            names += [str(n) for n, v in table.data_vars.items() if v.dims == self.dims and n not in _OF_ALL]
        if not isinstance(name, str) or name not in names:
            raise InputError(
                f"{what} is {name!r:.80}, and the samples have no such dimension or coordinate; {nearest(name, names)}."
            )
        return table[name]

    def dim(self, what: str, name: object) -> str:
        """The dimension along which this one runs."""
        return str(self.variable(what, name).dims[0])

    def flat(self, variable: xarray.DataArray) -> Array:
        """The values of a variable with the dimensions of the samples, sample by sample, shape (n,)."""
        return np.asarray(variable.transpose(*self.dims).values).ravel()

    def quantity(self, name: object) -> Quantity:
        """A quantity of each sample.

        Args:
            name: Its name; with labels of its further dimensions: "force_left_sole[fz]". None: the first number that is no
                residual, or the reasons where there is no number.

        Raises:
            InputError: no such quantity, or one with further dimensions of which no labels are given.
        """
        if name is None:
            name = self._default()
        shown = self._selected(name)
        values, label, attributes = self.flat(shown), str(name), shown.attrs
        texts = _meanings(attributes)
        if name == "reason":  # of a code that this version does not know, what the dataset says of it
            texts |= {reason.code: reason.value for reason in Reason}
            return _of_codes(label, values, {int(c): texts.get(int(c), f"reason {c}") for c in np.unique(values)})
        if "flag_values" in attributes:
            return _of_codes(label, values, {int(c): texts.get(int(c), str(int(c))) for c in np.unique(values) if c != -1})
        if values.dtype.kind == "b":
            known = True if name == "ok" else self.flat(self.dataset["ok"])
            return _of_codes(label, np.where(known, values.astype(int), -1), {0: "no", 1: "yes"})
        if values.dtype.kind in "fiu":
            numbers = values.astype(float)
            return Quantity(_label(label, attributes), np.where(np.isfinite(numbers), numbers, np.nan))
        words, codes = np.unique(values.astype(str), return_inverse=True)
        return _of_codes(label, codes, {i: word for i, word in enumerate(words.tolist()) if word})

    def states(self) -> tuple[Array, Array]:
        """(which samples are ok, which were not run), each of shape (n,)."""
        return self.flat(self.dataset["ok"]), self.flat(self.dataset["reason"]) == Reason.NOT_RUN.code

    def averaged(self, used: Sequence[object]) -> tuple[StudyData, str]:
        """(the study with the share of draws that are ok at each point of a grid, its name); without draws as it is, "ok".

        Args:
            used: Names that the user gave.
        """
        left = [d for d in self.dims if self.numbered(d) and d not in used]
        if not left or len(left) == len(self.dims):
            return self, "ok"
        ok, ran = self.dataset["ok"], self.dataset["reason"] != Reason.NOT_RUN.code
        some, name = ran.any(left), "share"
        share = (100.0 * ok.where(ran).mean(left)).assign_attrs(units="%", long_name="samples that are ok")
        table = self.dataset[["ok", "reason"]].isel(dict.fromkeys(left, 0))
        reasons = (~some).astype("int16") * Reason.NOT_RUN.code
        return StudyData(table.assign({"ok": some, "reason": reasons, name: share}), used), name

    def check_left(self, used: Sequence[str], *, by_given: bool) -> None:
        """Refuse dimensions that are neither drawn nor selected.

        Args:
            used: Dimensions that are drawn.
            by_given: Whether there is a picture for each value of one already.

        Raises:
            InputError: names them.
        """
        if left := [d for d in self.dims if d not in used]:
            first = np.asarray(self.dataset[left[0]].values)[0]
            shown = repr(first.item() if isinstance(first, np.generic) else first)
            told = ", ".join(f"{d} ({self.dataset.sizes[d]} values)" for d in left)
            raise InputError(
                f"the study also has {told}, which nothing here shows; select a value: dataset.sel({left[0]}={shown:.40})"
                f"{'' if by_given else f', or draw a picture for each: by={left[0]!r}'}."
            )

    def _default(self) -> str:
        for name, v in self.dataset.data_vars.items():
            plain = v.dtype.kind in "fiu" and "flag_values" not in v.attrs and set(v.dims) == set(self.dims)
            if plain and name != "reason" and not str(name).startswith(_CERTIFICATES):
                return str(name)
        return "reason"

    def _selected(self, name: object) -> xarray.DataArray:
        """The quantity with one value for each sample."""
        table = self.dataset
        found = _SELECTED.fullmatch(name) if isinstance(name, str) and name not in table.data_vars else None
        plain, given = (found["name"], [x.strip() for x in found["labels"].split(",")]) if found else (name, [])
        names = [str(n) for n, v in table.data_vars.items() if set(self.dims) <= set(v.dims) and n not in _WORDS]
        if isinstance(plain, str) and plain in _WORDS:
            raise InputError(f"value={plain!r} is text of its own for each sample; value='reason' draws what stopped them.")
        if not isinstance(plain, str) or plain not in names:
            raise InputError(f"value is {name!r:.80}, and the study has no such quantity; {nearest(plain, names)}.")
        shown = table[plain]
        labels = {d: [str(x) for x in np.asarray(table[d].values)] for d in shown.dims if d not in self.dims}
        if given and not labels:
            raise InputError(f"{plain} has one value for each sample and no labels; leave out [{','.join(given)}].")
        if len(given) != len(labels):
            told = "; ".join(f"{d}: {', '.join(list(x)[:8])}{', ...' if len(x) > 8 else ''}" for d, x in labels.items())
            raise InputError(
                f"{plain} has a value for each of {' and '.join(map(str, labels))}; select one by its label: "
                f"value={plain + '[' + ', '.join(x[0] for x in labels.values() if x) + ']'!r}. There are {told}."
            )
        for (dim, known), label in zip(labels.items(), given, strict=True):
            if label not in known:
                raise InputError(f"{plain} has no {label!r:.80} along {dim}; {nearest(label, known)}.")
            shown = shown.isel({dim: known.index(label)})
        return shown


_WORDS = ("reason_text", "message")
_OF_ALL = ("ok", "reason", *_WORDS)
"""Quantities that every study has, none of them an axis."""


def _scale(at: Array) -> str:
    """Logarithmic for four numbers or more in geometric progression."""
    if len(at) < 4 or at.min() <= 0.0:
        return "linear"
    ratios = at[1:] / at[:-1]
    return "log" if abs(ratios[0] - 1.0) > 1e-3 and np.abs(ratios / ratios[0] - 1.0).max() < _EXACT else "linear"


def _label(name: str, attributes: Mapping[str, Any]) -> str:
    """Its long name if it has one, else its name; and its unit, without that of plain numbers."""
    unit, long = str(attributes.get("units", "")), str(attributes.get("long_name", ""))
    told = long if 0 < len(long) <= 48 and "[" not in name else name
    return f"{told} [{unit}]" if unit not in ("", "1") else told


def _meanings(attributes: Mapping[str, Any]) -> dict[int, str]:
    """{code: its meaning}, as a dataset says of its flags."""
    codes = [int(code) for code in np.atleast_1d(attributes.get("flag_values", []))]
    return dict(zip(codes, str(attributes.get("flag_meanings", "")).split(), strict=False))


def _of_codes(label: str, codes: Array, texts: Mapping[int, str]) -> Quantity:
    """Codes as categories, each with a colour of its own."""
    if len(texts) > MOST_CATEGORIES:
        raise InputError(f"{label} has {len(texts)} different texts, more than colours can tell apart ({MOST_CATEGORIES}).")
    known = REASON_COLORS if label == "reason" else {}
    taken = {known[text] for text in texts.values() if text in known}
    free = iter([color for color in distinct_colors(len(CONTACT_COLORS) + len(texts)) if color not in taken])
    places, categories = np.full(codes.shape, -1), []
    for i, (code, text) in enumerate(sorted(texts.items())):
        places[codes == code] = i
        categories.append((text or "ok", known.get(text) or next(free)))  # the text of `Reason.NONE` is empty
    return Quantity(label, places, tuple(categories))
