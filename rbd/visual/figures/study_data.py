"""What is drawn of a study: its dimensions as axes, one of its quantities as numbers or as categories."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    """A dimension or a coordinate of the samples, as positions along an axis.

    Attributes:
        name: Its name in the dataset.
        label: Name and unit.
        at: Positions, shape (n,); of categories 0, 1, ... in the order in which they are drawn.
        words: Text of every position, of categories; else empty.
        scale: "linear" or "log".
    """

    name: str
    label: str
    at: Array
    words: tuple[str, ...] = ()
    scale: str = "linear"

    @property
    def edges(self) -> Array:
        """Midway between positions, and as far beyond the first and the last, shape (n + 1,); they have to be increasing."""
        at = np.log(self.at) if self.scale == "log" else self.at
        if len(at) == 1:
            half = 0.5 * abs(at[0]) if at[0] and not self.words else 0.5
            return np.array([at[0] - half, at[0] + half])
        mid = (at[1:] + at[:-1]) / 2.0
        edges = np.concatenate([[2.0 * at[0] - mid[0]], mid, [2.0 * at[-1] - mid[-1]]])
        return np.exp(edges) if self.scale == "log" else edges


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
        asked = [name for name in named if isinstance(name, str)]
        single = {d: 0 for d in whole["ok"].dims if whole.sizes[d] == 1 and d not in asked}
        self.dataset = whole.isel(single)
        self.dims: tuple[str, ...] = tuple(map(str, self.dataset["ok"].dims))
        self.share: xarray.DataArray | None = None
        if not self.dims:
            first = str(next(iter(whole["ok"].dims), "sample"))
            self.dataset, self.dims = self.dataset.expand_dims(first), (first,)

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
        """The axis of a dimension or coordinate; `what` is the argument that names it.

        Raises:
            InputError: there is none, or it has more dimensions than one.
        """
        return axis_of(name, self.variable(what, name), in_order=not self.drawn_at_random)

    def variable(self, what: str, name: object) -> xarray.DataArray:
        """A dimension, coordinate or, of draws, any quantity with one value for each sample.

        Raises:
            InputError: there is none.
        """
        table = self.dataset
        fits = [str(n) for n, v in table.coords.items() if len(v.dims) == 1 and v.dims[0] in self.dims]
        names = list(dict.fromkeys([*self.dims, *fits]))
        if self.drawn_at_random:
            names += [
                str(n) for n, v in table.data_vars.items() if v.dims == self.dims and n not in ("ok", "reason", "message")
            ]
        if not isinstance(name, str) or name not in names:
            raise InputError(
                f"{what} is {name!r:.80}, and the samples have no such dimension or coordinate; {nearest(name, names)}."
            )
        return table[name]

    def dim(self, what: str, name: object) -> str:
        """The dimension along which this one runs."""
        return str(self.variable(what, name).dims[0])

    def quantity(self, name: object, dims: Sequence[str]) -> Quantity:
        """A quantity over dimensions in this order.

        Args:
            name: Its name; with labels of its further dimensions: "force_left_sole[fz]". None: the first number that is no
                residual, or the reasons where there is no number.
            dims: Dimensions of the samples.

        Raises:
            InputError: no such quantity, or one with further dimensions of which no labels are given.
        """
        if name is None:
            name = self._default()
        shown = self._selected(name) if self.share is None else self.share
        values = np.asarray(shown.transpose(*dims).values)
        attributes: Mapping[str, Any] = shown.attrs
        if name == "reason":
            return _of_codes("reason", values, {int(c): _reason_text(int(c), attributes) for c in np.unique(values)})
        if "flag_values" in attributes:
            meanings = str(attributes.get("flag_meanings", "")).split()
            texts = dict(zip(map(int, np.atleast_1d(attributes["flag_values"])), meanings, strict=False))
            return _of_codes(str(name), values, {int(c): texts.get(int(c), str(int(c))) for c in np.unique(values) if c != -1})
        if values.dtype.kind == "b":
            known = np.ones(values.shape, bool) if name == "ok" else np.asarray(self.dataset["ok"].transpose(*dims).values)
            return _of_codes(str(name), np.where(known, values.astype(int), -1), {0: "no", 1: "yes"})
        if values.dtype.kind in "fiu":
            numbers = values.astype(float)
            return Quantity(_label(str(name), attributes), np.where(np.isfinite(numbers), numbers, np.nan))
        words, codes = np.unique(values.astype(str), return_inverse=True)
        return _of_codes(str(name), codes.reshape(values.shape), {i: word for i, word in enumerate(words.tolist()) if word})

    def states(self, dims: Sequence[str]) -> tuple[Array, Array]:
        """Which samples are ok, and which were not run, over dimensions in this order."""
        ok = np.asarray(self.dataset["ok"].transpose(*dims).values)
        if ok.dtype.kind != "b":
            raise InputError(f"ok has values of type {ok.dtype}; expected truth values, as rbd.study returns them.")
        return ok, np.asarray(self.dataset["reason"].transpose(*dims).values) == Reason.NOT_RUN.code

    def averaged(self, used: Sequence[object]) -> StudyData:
        """The share of draws that are ok, at each point of a grid, as the quantity "ok"; the study as it is without draws.

        Args:
            used: Names that the user gave.
        """
        named = [name for name in used if isinstance(name, str)]
        left = [d for d in self.dims if self.numbered(d) and d not in named]
        if not left or len(left) == len(self.dims):
            return self
        ok, ran = self.dataset["ok"], self.dataset["reason"] != Reason.NOT_RUN.code
        share = (100.0 * ok.where(ran).mean(left)).assign_attrs(units="%", long_name="samples that are ok")
        some = ran.any(left)
        out = StudyData(self.dataset[["ok", "reason"]].isel(dict.fromkeys(left, 0)), used)
        reasons = some.astype("int16") * 0 + (~some).astype("int16") * Reason.NOT_RUN.code
        out.dataset, out.share = out.dataset.assign(ok=some, reason=reasons), share
        return out

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
        names = [str(n) for n, v in table.data_vars.items() if set(self.dims) <= set(v.dims) and n != "message"]
        if isinstance(plain, str) and plain == "message":
            raise InputError("value='message' is text of its own for each sample; value='reason' draws what stopped them.")
        if not isinstance(plain, str) or plain not in names:
            raise InputError(f"value is {name!r:.80}, and the study has no such quantity; {nearest(plain, names)}.")
        shown = table[plain]
        further = [d for d in shown.dims if d not in self.dims]
        labels = {d: [str(x) for x in np.asarray(table[d].values)] for d in further}
        if len(given) != len(further):
            if not further:
                raise InputError(f"{plain} has one value for each sample and no labels; leave out [{','.join(given)}].")
            told = "; ".join(f"{d}: {', '.join(list(x)[:8])}{', ...' if len(x) > 8 else ''}" for d, x in labels.items())
            raise InputError(
                f"{plain} has a value for each of {' and '.join(map(str, further))}; select one by its label: "
                f"value={plain + '[' + ', '.join(x[0] for x in labels.values() if x) + ']'!r}. There are {told}."
            )
        for dim, label in zip(further, given, strict=True):
            if label not in labels[dim]:
                raise InputError(f"{plain} has no {label!r:.80} along {dim}; {nearest(label, labels[dim])}.")
            shown = shown.isel({dim: labels[dim].index(label)})
        return shown


def axis_of(name: object, variable: xarray.DataArray, *, in_order: bool = True) -> Axis:
    """Numbers as they are; else categories, in their order or in that of the alphabet."""
    values = np.asarray(variable.values)
    label = _label(str(name), variable.attrs)
    if values.dtype.kind in "fiu" and np.isfinite(values).all():
        return Axis(str(name), label, values.astype(float), scale=_scale(values.astype(float)))
    words = [_short(x) for x in values.tolist()]
    order = list(dict.fromkeys(words if in_order else sorted(words)))
    return Axis(str(name), label, np.array([order.index(word) for word in words], float), tuple(order))


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


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)[:40]


def _reason_text(code: int, attributes: Mapping[str, Any]) -> str:
    """The text of a code; of one that this version does not know, what the dataset says of it."""
    for reason in Reason:
        if reason.code == code:
            return reason.value
    values = [int(x) for x in np.atleast_1d(attributes.get("flag_values", []))]
    meanings = str(attributes.get("flag_meanings", "")).split()
    return meanings[values.index(code)] if code in values and len(meanings) == len(values) else f"reason {code}"


def _of_codes(label: str, codes: Array, texts: Mapping[int, str]) -> Quantity:
    """Codes as categories, each with a colour of its own."""
    if len(texts) > MOST_CATEGORIES:
        raise InputError(f"{label} has {len(texts)} different texts, more than colours can tell apart ({MOST_CATEGORIES}).")
    taken = {REASON_COLORS[text] for text in texts.values() if text in REASON_COLORS} if label == "reason" else set()
    free = iter([color for color in distinct_colors(len(CONTACT_COLORS) + len(texts)) if color not in taken])
    places, categories = np.full(codes.shape, -1), []
    for i, (code, text) in enumerate(sorted(texts.items())):
        places[codes == code] = i
        color = REASON_COLORS.get(text) if label == "reason" else None
        categories.append((text or "ok", color or next(free)))  # the text of `Reason.NONE` is empty
    return Quantity(label, places, tuple(categories))
