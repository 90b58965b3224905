"""The report of a study on the command line: how many samples have a result, why the others have none, and the boundary."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.arrays import Array, lazy
from rbd.cli.study_plan import StudyPlan
from rbd.cli.sweeps import QUANTITIES
from rbd.cli.terminal import Table, counted, facts, in_options
from rbd.errors import Reason
from rbd.installation import VERSION

if TYPE_CHECKING:
    import xarray

MOST_LINES = 12
"""Lines of the boundary that are printed."""
MOST_TOLD = 100_000
"""The boundary of a study of more lines is not told."""
_UNITS = {each.argument: each.unit for each in QUANTITIES.values()}
_NAMES = {each.argument: each.name for each in QUANTITIES.values()}
_BOUNDARY = ("push", "push_x", "push_y", "push_z")
"""Along these the boundary is told, where one of them is swept."""


@dataclass(frozen=True)
class Line:
    """The samples along one axis of a grid, all else the same.

    Attributes:
        fixed: {other dimension: its value}.
        changes: ((value before, value after), ...) between which samples with and without a result are neighbours.
        first: Whether the first one has a result.
        run: Whether all of them were run.
    """

    fixed: dict[str, Any]
    changes: tuple[tuple[float, float], ...]
    first: bool
    run: bool

    def data(self) -> dict[str, object]:
        """As plain data."""
        between = [list(change) for change in self.changes]
        return {"at": self.fixed, "first_has_result": self.first, "changes_between": between, "run": self.run}


@dataclass(frozen=True, eq=False)
class StudyReport:
    """A study that was evaluated.

    Attributes:
        plan: What was asked.
        dataset: Its results.
        seconds: How long it took.
        resumed: Whether some of it was stored before.
    """

    plan: StudyPlan
    dataset: xarray.Dataset
    seconds: float
    resumed: bool = False

    @lazy
    def ok(self) -> Array:
        """Which samples have a result, of the shape of the samples."""
        return np.asarray(self.dataset["ok"].values, bool)

    @lazy
    def codes(self) -> Array:
        """`Reason.code` of each sample."""
        return np.asarray(self.dataset["reason"].values)

    @property
    def run(self) -> Array:
        """Which samples were evaluated."""
        return self.codes != Reason.NOT_RUN.code

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended it early."""
        return bool(self.dataset.attrs.get("interrupted"))

    @lazy
    def reasons(self) -> dict[str, int]:
        """{reason: how many samples}, most frequent first."""
        words = {reason.code: str(reason) for reason in Reason}
        found, counts = np.unique(self.codes[~self.ok & self.run], return_counts=True)
        most = sorted(zip(counts.tolist(), found.tolist(), strict=True), key=lambda each: (-each[0], each[1]))
        return {words.get(code, f"code {code}"): n for n, code in most}

    @property
    def verdict(self) -> str:
        """How many samples have a result."""
        n, done = self.ok.size, int(self.run.sum())
        left = "" if done == n else f"; {n - done:,} of the {n:,} were not run"
        return self.plan.words.verdict(int(self.ok.sum()), n) + left + "."

    @lazy
    def axis(self) -> str | None:
        """The dimension along which the boundary is told: a push, else the last one with numbers; None where there is none."""
        numbers = [
            str(d) for d in self.dataset["ok"].dims
            if d in self.dataset.coords and d != "sample" and self.dataset[d].dtype.kind in "fiu" and self.dataset.sizes[d] > 1
        ]  # fmt: skip
        pushes = [d for d in numbers if d in _BOUNDARY]
        if not numbers:
            return None
        chosen = (pushes or numbers)[-1]
        return None if self.ok.size / self.dataset.sizes[chosen] > MOST_TOLD else chosen

    @lazy
    def lines(self) -> list[Line]:
        """The samples along `axis`, a line for each combination of the others."""
        return [] if self.axis is None else list(self._lines(self.axis))

    def _lines(self, axis: str) -> Iterator[Line]:
        dims = [str(d) for d in self.dataset["ok"].dims]
        others = [d for d in dims if d != axis]
        ok, run = (np.moveaxis(x, dims.index(axis), -1) for x in (self.ok, self.run))
        values = np.asarray(self.dataset[axis].values, float)
        order = np.argsort(values, kind="stable")
        at = values[order].tolist()
        for where in itertools.product(*(range(self.dataset.sizes[d]) for d in others)):
            good = ok[where][order]
            changed = np.flatnonzero(good[1:] != good[:-1])
            fixed = {
                d: self.dataset[d].values[i] if d in self.dataset.coords else i for d, i in zip(others, where, strict=True)
            }
            ends = tuple((at[i], at[i + 1]) for i in changed)
            yield Line(
                {d: x.item() if isinstance(x, np.generic) else x for d, x in fixed.items()},
                ends,
                bool(good[0]),
                bool(run[where].all()),
            )

    def data(self) -> dict[str, object]:
        """The numbers of the report, for JSON; those of all samples are in the store of --out."""
        return {
            "rbd": VERSION,
            "asked": self.plan.words.asked,
            "samples": self.ok.size,
            "ok": int(self.ok.sum()),
            "run": int(self.run.sum()),
            "reasons": self.reasons,
            "dimensions": {str(d): self._values(str(d)) for d in self.dataset["ok"].dims},
            "along": self.axis,
            "boundary": [line.data() for line in self.lines],
            "worst_residual": self._worst(),
            "interrupted": self.interrupted,
            "seconds": self.seconds,
        }  # fmt: skip

    def _values(self, dim: str) -> object:
        if dim not in self.dataset.coords or dim == "sample":
            return self.dataset.sizes[dim]
        return self.dataset[dim].values.tolist()

    def __rich__(self) -> Group:
        """The verdict, why samples have no result, the boundary, then what was studied and how long it took."""
        parts: list[Any] = [Text(self.verdict)]
        if (sentence := self._sentence()) is not None:
            parts.append(Text(sentence))
        if self.reasons:
            parts.append(self._reasons_table())
        if self.axis is not None and len(self.lines) > 1 and any(line.run and line.changes for line in self.lines):
            parts.append(self._boundary_table(self.axis))
        return Group(*parts, self._facts())

    def _sentence(self) -> str | None:
        """The boundary, where all samples are in one line."""
        if self.axis is None or len(self.lines) != 1 or not self.lines[0].run or not self.lines[0].changes:
            return None
        return f"Along {_NAMES.get(self.axis, self.axis)}: {self._where(self.lines[0], self.axis)}."

    def _where(self, line: Line, axis: str) -> str:
        """Between which values results begin or end."""
        unit = _UNITS.get(axis, self.dataset[axis].attrs.get("units", ""))
        unit = f" {unit}" if unit not in ("", "1") else ""
        good, bad = self.plan.words.good, self.plan.words.bad
        if not line.changes:
            return f"all {good}" if line.first else f"none {good}"
        told, now = [], line.first
        for low, high in line.changes[:2]:
            before, after = (good, bad) if now else (bad, good)
            told.append(f"{before} up to {low:g}{unit}, {after} from {high:g}{unit}")
            now = not now
        more = f"; {counted(len(line.changes), 'change')} in all" if len(line.changes) > 2 else ""
        return "; ".join(told) + more

    def _boundary_table(self, axis: str) -> Table:
        others, lines = list(self.lines[0].fixed), [line for line in self.lines if line.run]
        chosen = sorted({round(i) for i in np.linspace(0, len(lines) - 1, min(len(lines), MOST_LINES))})
        shown = f", {len(chosen)} of {len(self.lines):,} lines" if len(chosen) < len(self.lines) else ""
        table = Table(f"boundary along {_NAMES.get(axis, axis)}{shown}", [*(_NAMES.get(d, d) for d in others), ""])
        for i in chosen:
            table.add_row(*(_shown(lines[i].fixed[d]) for d in others), self._where(lines[i], axis))
        return table

    def _reasons_table(self) -> Table:
        table = Table("reasons", ("reason",), ("samples", "of all"))
        table.add_column("for example")
        codes = {str(reason): reason.code for reason in Reason}
        flat, messages = self.codes.ravel(), self.dataset["message"].values.ravel()
        for reason, n in self.reasons.items():
            first = int(np.flatnonzero(flat == codes.get(reason, -1))[0]) if reason in codes else 0
            table.add_row(reason, f"{n:,}", f"{100.0 * n / self.ok.size:.1f} %", _short(in_options(str(messages[first]))))
        return table

    def _facts(self) -> Table:
        dims = [f"{_NAMES.get(str(d), d)} ({self.dataset.sizes[d]:,})" for d in self.dataset["ok"].dims]
        rate = "" if self.resumed else f", {self.run.sum() / self.seconds:,.3g} samples a second"
        rows = [("asked", self.plan.words.asked), ("samples", " x ".join(dims)), ("time", f"{self.seconds:.2f} s{rate}")]
        if math.isfinite(worst := self._worst()):
            rows.append(("worst residual", f"{worst:.1e}, scaled, of all results"))
        return facts("the study", rows)

    def _worst(self) -> float:
        """The largest residual of all results; NaN where none is kept."""
        values = self.dataset.get("worst_residual")
        if values is None or not self.ok.any():
            return math.nan
        return float(np.nanmax(values.values))


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _short(text: str) -> str:
    """The first sentence of a message, so that a table has one line for it where it can."""
    first = text.split(". ")[0].split("\n")[0]
    return first if len(first) <= 300 else first[:297] + "..."
