"""`rbd stand --sweep`: whether torques withstand a push at every combination of some values; run, stored, reported, drawn."""
# Imports are inside functions: --help takes a third of a second.

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
import typer
from rich.console import Console, Group
from rich.text import Text

from rbd.arrays import Array, lazy
from rbd.cli.terminal import (
    FIGURES,
    INTERRUPTED,
    NO_SOLUTION,
    TerminalTable,
    check_outputs,
    facts,
    in_options,
    open_console,
    print_path,
    print_report,
    save_figure,
)
from rbd.errors import InputError, ModelWarning, Reason, StudyStopped, nearest
from rbd.installation import VERSION
from rbd.records import Field, counted, share

if TYPE_CHECKING:
    import xarray

    from rbd.robots.robot import Robot

QUANTITIES: dict[str, tuple[str, type]] = {
    "posture": ("", str),
    "friction": ("1", float),
    "at": ("", str),
    "push": ("N", float),
    "push.angle": ("deg", float),
    "push.x": ("N", float),
    "push.y": ("N", float),
    "push.z": ("N", float),
    "margin": ("1", float),
    "facets": ("1", int),
}
"""{what can be swept: (its unit, its kind)}; with _ in place of the dot the arguments of `rbd.studies.withstand_push`."""
FORM = "FROM:TO:N (N values, both ends included) or A,B,C"
MOST_LINES = 12
"""Lines of the boundary that are printed."""


def sweeps_of(options: Iterable[str]) -> dict[str, Array]:
    """{quantity: its values} of the options `--sweep NAME=VALUES`.

    Raises:
        InputError: no equals sign, unknown names, a name twice, values that cannot be read, or that occur twice.
    """
    found: dict[str, Array] = {}
    for option in options:
        name, equals, text = (part.strip() for part in option.partition("="))
        if not equals or not name:
            raise InputError(f"--sweep is {option!r:.80}; expected NAME=VALUES, e.g. friction=0.1:1:19 or at=base_link,torso.")
        if name not in QUANTITIES:
            raise InputError(f"--sweep: {name!r:.80} cannot be swept; {nearest(name, QUANTITIES)}.")
        if name in found:
            raise InputError(f"--sweep {name} came twice; give all of its values at once, {name}={FORM}.")
        found[name] = values_of(name, text)
    return found


def values_of(name: str, text: str) -> Array:
    """The values of a quantity, each once: "0.1:1:19" are those of `numpy.linspace`, "A,B" these; words as objects.

    Raises:
        InputError: what cannot be read, numbers that are not finite or not whole, values that occur twice.
    """
    unit, kind = QUANTITIES[name]
    wanted = {str: "words", int: "whole numbers", float: "numbers"}[kind] + (f" in {unit}" if len(unit) > 1 else "")
    wrong = InputError(f"--sweep {name} is {text!r:.80}; expected {wanted}: {FORM}.")
    words = [word.strip() for word in text.split(",")]
    if kind is str and all(words):
        values = np.array(words, object)
    else:
        try:
            if ":" in text:
                low, high, n = (float(part) for part in text.split(":"))
                values = np.linspace(low, high, int(n) if n == int(n) and 2 <= n <= 10_000_000 else 0)
            else:
                values = np.array([float(word) for word in words])
        except (ValueError, OverflowError):
            raise wrong from None
        if not len(values) or not (np.abs(values) < 1e150).all() or (values.astype(kind) != values).any():
            raise wrong
    if len(set(values.tolist())) < len(values):
        raise InputError(f"--sweep {name} is {text!r:.80}, with a value twice; give each once.")
    return np.asarray(values if kind is str else values.astype(kind))


def push_arguments(swept: Mapping[str, Array], push: Array | None, at: str | None) -> dict[str, Any]:
    """What of the push is the same in all cases: its direction where its size or its angle is swept, else components.

    Raises:
        InputError: a size and components, a size without direction, an angle without size, a frame without a push.
    """
    size, parts = "push" in swept, [name for name in ("push.x", "push.y", "push.z") if name in swept]
    if size and parts:
        raise InputError(
            f"--sweep push is the size of the push and --sweep {parts[0]} a component of it; give one of them: components, or "
            "a size with its direction, by --push X,Y,Z or push.angle."
        )
    if size and push is None and "push.angle" not in swept:
        raise InputError(
            "--sweep push has a size and no direction; give it by --push X,Y,Z (whose length does not matter), or sweep "
            "push.angle, or push.x, push.y or push.z."
        )
    if "push.angle" in swept and not size and push is None:
        raise InputError("--sweep push.angle turns a push that has no size; give --push X,Y,Z, or sweep push (in newtons).")
    if (at is not None or "at" in swept) and push is None and not size and not parts:
        raise InputError("--at came without a push; give --push X,Y,Z, or sweep push.x, push.y or push.z.")
    if push is None:
        return {}
    if not size and "push.angle" not in swept:
        return {f"push_{axis}": float(f) for axis, f in zip("xyz", push, strict=True) if f"push.{axis}" not in swept}
    if not push.any():
        raise InputError("--push is zero; expected the direction of the push, e.g. 0,1,0.")
    return {"direction": tuple(push.tolist())} | ({} if size else {"push": float(np.linalg.norm(push))})


def check_values(robot: Robot, swept: Mapping[str, Array], same: Mapping[str, Any]) -> None:
    """Refuse values that no case could take, before anything is computed.

    Raises:
        InputError: a negative friction, an unknown posture or frame, ...; the message names the option.
    """
    from rbd.problem.cones import check_friction
    from rbd.statics.wanted_motion import checked_margin

    checks: dict[str, Callable[[Any], object]] = {
        "friction": lambda x: check_friction(x, 4),
        "facets": lambda x: check_friction(0.5, x),
        "margin": checked_margin,
        "posture": robot.posture,
        "at": robot.frame,
    }
    for option, check, value in [
        *((f"--sweep {name}", checks.get(name, bool), x) for name, values in swept.items() for x in values.tolist()),
        *((f"--{name}", checks.get(name, bool), x) for name, x in same.items()),
    ]:
        try:
            check(value)
        except InputError as error:
            raise type(error)(f"{option}: {error}") from None


def check_running(
    out: Path | None, resume: bool, workers: int | None, png: Path | None, json_: Path | None, reads: str
) -> None:
    """Refuse what cannot be, before anything is computed.

    Raises:
        InputError: paths that cannot be written, a store that is there without --resume, a negative number of processes.
    """
    from rbd.studies.stores import is_stored

    if workers is not None and workers < 0:
        raise InputError(f"--workers is {workers}; expected how many processes, 0 for none but this one.")
    if resume and out is None:
        raise InputError("--resume came without --out FILE.zarr, the store to go on with.")
    check_outputs({"--png": (png, FIGURES), "--json": (json_, ())}, reads=reads)
    if out is not None and (there := is_stored(out)) and not resume:
        raise InputError(f"--out is {str(out)!r:.300}, which is there. Go on with it by --resume, or give another name.")
    if out is not None and not there:
        check_outputs({"--out": (out, (".zarr",))})


def run_sweep(
    console: Console,
    robot: Robot,
    swept: Mapping[str, Array],
    same: Mapping[str, Any],
    *,
    out: Path | None,
    workers: int | None,
    png: Path | None,
    json_: Path | None,
) -> None:
    """Run the study, print its report, write what is asked for.

    Args:
        console: Where the report is printed.
        robot: It stands on its feet.
        swept: {quantity: its values}: every combination is a case.
        same: {argument of `rbd.studies.withstand_push`: its value in all cases}.
        out: The store, or None.
        workers: How many processes; None: as many as cores, 0: none but this one.
        png: The picture, or None.
        json_: The numbers of the report, or None.

    Raises:
        typer.Exit: with the code 1 where no case can be held, 130 after Ctrl-C with cases left out.
        StudyStopped: it ended early; the report of what is done was printed.
        InputError: as `rbd.study`.
    """
    from rbd.statics.push_functions import withstand_push
    from rbd.studies import grid, running

    samples = grid(**{name.replace(".", "_"): values.tolist() for name, values in swept.items()}).with_units(
        **{name.replace(".", "_"): QUANTITIES[name][0] for name in swept if QUANTITIES[name][0]}
    )
    began, stopped = time.perf_counter(), None
    kept = (
        "Nothing is stored; --out FILE.zarr would keep it."
        if out is None
        else f"What was finished is in {out}; the same command with --resume goes on."
    )
    # The robot was loaded, and what is wrong with its file told.
    with warnings.catch_warnings(action="ignore", category=ModelWarning):
        try:
            dataset = running.study(partial(withstand_push, robot, **same), samples, executor=workers, out=out)
        except StudyStopped as error:
            if error.dataset is None:
                raise
            dataset, stopped = error.dataset, error
        except KeyboardInterrupt:  # a second one, or before the first case
            open_console(errors=True).print(f"Ended at once. {kept}", highlight=False, soft_wrap=True)
            raise typer.Exit(INTERRUPTED) from None
    report = SweepReport(robot.name, dataset, time.perf_counter() - began)
    print_report(console, report, json_)
    if out is not None:
        print_path(console, "store", out)
    if png is not None and report.run.any():
        from rbd.visual import plot_study

        print_path(console, "picture", save_figure(cast(Any, plot_study(dataset)[0].figure), png, dpi=130))
    if stopped is not None:
        raise stopped
    if dataset.attrs.get("interrupted"):
        console.print(f"Ended by Ctrl-C. {kept}", highlight=False, soft_wrap=True)
        raise typer.Exit(INTERRUPTED)
    if not report.ok.any():
        raise typer.Exit(NO_SOLUTION)


@dataclass(frozen=True, eq=False)
class SweepReport:
    """How many cases can be held, why the others cannot, and where along the push that ends.

    Attributes:
        robot: Its name.
        dataset: What `rbd.study` returns.
        seconds: How long it took.
    """

    robot: str
    dataset: xarray.Dataset
    seconds: float

    fields: ClassVar[tuple[Field, ...]] = (
        Field("rbd", (), "", "version", lambda found: VERSION),
        Field("robot", (), "", "its name"),
        Field("samples", (), "1", "number of cases", lambda found: found.ok.size),
        Field("ok", (), "1", "how many can be held", lambda found: found.ok.sum()),
        Field("run", (), "1", "how many were computed", lambda found: found.run.sum()),
        Field("reasons", (), "", "how many have which", lambda found: {str(reason): n for reason, n, _ in found.reasons}),
        Field(
            "dimensions", (), "", "values along each",
            lambda found: {d: found.dataset[d].values for d in found.dataset["ok"].dims},
        ),
        Field("along", (), "", "dimension of the boundary", lambda found: found.axis),
        Field("boundary", (), "", "where cases begin or cease to be held along it", lambda found: [
            {"at": at, "first_is_held": first, "changes_between": ends} for at, first, ends in found.lines
        ]),
        Field("worst_residual", (), "1", "largest residual of all results, scaled", lambda found: found.worst),
        Field("interrupted", (), "", "whether it ended early", lambda found: bool(found.dataset.attrs.get("interrupted"))),
        Field("seconds", (), "s", "how long it took"),
    )  # fmt: skip

    @lazy
    def ok(self) -> Array:
        """Which cases can be held, of the shape of the sweep."""
        return np.asarray(self.dataset["ok"].values, bool)

    @lazy
    def run(self) -> Array:
        """Which cases were computed."""
        return np.asarray(self.dataset["reason"].values) != Reason.NOT_RUN.code

    @lazy
    def reasons(self) -> list[tuple[Reason, int, str]]:
        """(reason, how many cases, the message of the first), most frequent first."""
        codes, messages = self.dataset["reason"].values, self.dataset["message"].values
        found = [
            (reason, int(where.sum()), str(messages[where][0]))
            for reason in Reason
            if (where := (codes == reason.code) & ~self.ok & self.run).any()
        ]
        return sorted(found, key=lambda each: -each[1])

    @lazy
    def axis(self) -> str | None:
        """The dimension along which the boundary is told: the last of a push's size or components, else of numbers."""
        numbers = [str(d) for d in self.dataset["ok"].dims if self.dataset[d].dtype.kind in "fi" and self.dataset.sizes[d] > 1]
        return next(reversed([d for d in numbers if d.startswith("push") and d != "push_angle"] or numbers), None)

    @lazy
    def lines(self) -> list[tuple[dict[str, Any], bool, list[tuple[float, float]]]]:
        """(other values, whether the first case is held, neighbours between which that changes) of each line along the axis."""
        found = list[tuple[dict[str, Any], bool, list[tuple[float, float]]]]()
        if self.axis is not None:
            held = self.dataset["ok"].where(self.run).sortby(self.axis)  # NaN where it was not run
            held = held.transpose(..., self.axis)
            at, others = held[self.axis].values.tolist(), [str(d) for d in held.dims[:-1]]
            for where in np.ndindex(held.shape[:-1]):
                if not np.isnan(row := held.values[where].astype(float)).any():
                    ends = [(at[i], at[i + 1]) for i in np.flatnonzero(row[1:] != row[:-1])]
                    found.append(({d: held[d].values[i] for d, i in zip(others, where, strict=True)}, bool(row[0]), ends))
        return found

    @property
    def worst(self) -> float:
        """The largest residual of all results, scaled; NaN where there is none."""
        return float(np.nanmax(self.dataset["worst_residual"].values)) if self.ok.any() else float("nan")

    def __rich__(self) -> Group:
        """The verdict, the boundary, why cases cannot be held, what was studied and how long it took."""
        n, good, left = self.ok.size, int(self.ok.sum()), int((~self.run).sum())
        held = f"all {n:,}" if good == n > 1 else f"none of {n:,}" if not good else f"{good:,} of {n:,}"
        more = f"; {left:,} of the {n:,} were not run" if left else ""
        parts: list[Any] = [Text(f"{self.robot} can be held in {held} cases{more}.")]
        chosen = sorted({round(i) for i in np.linspace(0, len(self.lines) - 1, min(len(self.lines), MOST_LINES))})
        if any(ends for _, _, ends in self.lines):
            parts += [Text(self._along(*self.lines[i])) for i in chosen]
        if self.reasons:
            parts.append(TerminalTable("reasons", ("reason",), ("samples", "of all")))
            parts[-1].add_column("for example")
            for reason, count, message in self.reasons:
                first = in_options(message.split(". ")[0].split("\n")[0])
                parts[-1].add_row(str(reason), f"{count:,}", share(count / n), first[:300])
        dims = [f"{_named(str(d))} ({self.dataset.sizes[d]:,})" for d in self.dataset["ok"].dims]
        rows = [
            ("samples", " x ".join(dims)),
            ("time", f"{self.seconds:.2f} s"),
            ("worst residual", f"{self.worst:.1e}, scaled"),
        ]
        return Group(*parts, facts("the study", rows if good else rows[:2]))

    def _along(self, at: dict[str, Any], held: bool, ends: list[tuple[float, float]]) -> str:
        """Between which values cases begin or cease to be held."""
        name = _named(self.axis or "")
        words, unit = ("held", "not held")[:: 1 if held else -1], QUANTITIES[name][0].strip("1")
        told = [
            f"{words[k % 2]} up to {f'{low:g} {unit}'.strip()}, {words[(k + 1) % 2]} from {f'{high:g} {unit}'.strip()}"
            for k, (low, high) in enumerate(ends[:2])
        ] or [f"all {words[0]}"]
        where = "".join(f", {_named(d)} {x:g}" if isinstance(x, float) else f", {_named(d)} {x}" for d, x in at.items())
        more = f"; {counted(len(ends), 'change')} in all" if len(ends) > 2 else ""
        return f"Along {name}{where}: {'; '.join(told)}{more}."


def _named(dimension: str) -> str:
    """A quantity of a dimension: push_y is push.y."""
    return dimension.replace("push_", "push.")
