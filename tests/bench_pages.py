"""Tables of one run in the pages.

All rows stand in docs/reference/speed.md, of studies in docs/studies.md; a few of them in README.md, the parts of a call in
docs/design/speed.md.
"""

from __future__ import annotations

from pathlib import Path

from bench_answers import GENERAL
from bench_profile import Columns, lines
from bench_studies import BUSY
from bench_timing import Row, marks_of, robots_of, shown, versions

ASKED = (
    "answers", "many", "points", "control", "steps", "fall", "terrain", "derivatives", "hessian", "linkage", "own", "motion",
    "first",
)  # fmt: skip
"""Groups of the first table of the page."""
OTHERS = ("peers", "engines", "solvers")
"""Groups of the second, without marks; of the solvers, what begins with these."""
SOME = (GENERAL, "inverse dynamics")
FEW = (
    "rbd.solve, frictional, sticking",
    "rbd.solve, slipping, Coulomb's law",
    "rbd.control.step, a walking robot's tasks, both soles",
    "rbd.simulate by default at rest, torques from Python, a step of 1 ms",
)
"""Rows of the README, by what they measure."""
Accuracy = dict[str, dict[str, tuple[float, float | None]]]


def _table(cells: list[list[str]]) -> list[str]:
    """A table in Markdown, its headings first."""
    made = ["| " + " | ".join(row) + " |" for row in cells]
    return [" ".join(line.split()) for line in [made[0], "|" + " --- |" * len(cells[0]), *made[1:]]]


def _rows(rows: list[Row], *, marks: bool) -> list[str]:
    robots = robots_of(rows)
    cells = [["", *(name.capitalize() for name in robots), "unit", *(("mark", "aim") if marks else ())]]
    for row in rows:
        numbers = [shown(row.values[name]) if name in row.values else "" for name in robots]
        cells.append([row.what, *numbers, row.unit, *(marks_of(row) if marks else ())])
    return _table(cells)


def _accuracy(found: Accuracy) -> list[str]:
    cells = [["", *(f"{name.capitalize()}, {what}" for name in found for what in ("energy", "depth"))]]
    for engine in next(iter(found.values())):
        numbers = [engines[engine] for engines in found.values()]
        cells.append([engine, *(c for moved, d in numbers for c in (f"{moved:.0e} J", "" if d is None else f"{d:.0e} m"))])
    return _table(cells)


def measured_with() -> str:
    of = versions()
    told = ", ".join(f"{name} {of[name]}" for name in ("python", "pin", "numpy", "proxsuite", "numba", "mujoco"))
    return f"Processor times of one run: {told}; {of['processor']}."


def readme(page: Path, found: dict[str, list[Row]]) -> str:
    """Put a few rows of a run into the README."""
    few = [row for name in ASKED for row in found.get(name, ()) if row.what in FEW and row.unit != "us"]
    return put(page, "speed", "\n".join(_rows(few, marks=False)))


def reference(page: Path, found: dict[str, list[Row]], accuracy: Accuracy) -> str:
    """Put the tables of a whole run into the page on speed."""
    asked = [row for name in ASKED for row in found.get(name, ())]
    others = [row for name in OTHERS for row in found.get(name, ()) if name != "solvers" or row.what.startswith(SOME)]
    parts = [_rows(asked, marks=True)]
    if others:
        parts += [["What they are compared with, and other ways to the same answers:"], _rows(others, marks=False)]
    if pages := found.get("pages"):
        parts += [
            ["Pages and videos, on the clock, drawn by headless Chromium without a graphics card:"],
            _rows(pages, marks=True),
        ]
    if accuracy:
        told = "What a second of free fall does to the energy, and how deep the feet sink in a second of standing:"
        parts += [[told], _accuracy(accuracy)]
    parts.append([measured_with()])
    return put(page, "speed", "\n\n".join("\n".join(part) for part in parts))


def work(page: Path, cells: list[list[str]]) -> str:
    """Put the table of errors over time into the page on speed."""
    return put(page, "work", "\n".join([*_table(cells), "", measured_with()]))


def studies(page: Path, found: dict[str, list[Row]]) -> str:
    """Put the tables of a run into the page on studies of many samples."""
    told = "Functions without work: samples a second, by samples in a chunk and executor (two processes each)."
    of = versions()
    end = (
        f"Times on the clock of one run, when {BUSY:.1f} other processes wanted the cores: {of['processor']}; "
        f"python {of['python']}, pin {of['pin']}."
    )
    parts = [_rows(found["studies"], marks=True), [told], _rows(found["chunks"], marks=False), [end]]
    return put(page, "studies", "\n\n".join("\n".join(part) for part in parts))


def design(page: Path, profiles: dict[str, Columns]) -> str:
    """Put the parts of a call and of a step into the page on speed."""
    parts = [f"{title}:\n\n" + "\n".join(_table(lines(columns))) for title, columns in profiles.items()]
    return put(page, "profile", "\n\n".join([*parts, measured_with()]))


def put(page: Path, place: str, text: str, by: str = "bench") -> str:
    """Replace what stands between the two marks of a place, and return the new text.

    Raises:
        ValueError: if the page has not both marks, once each.
    """
    begin, end = f"<!-- {place}: made by tests/{by}.py -->", f"<!-- end of {place} -->"
    old = page.read_text(encoding="utf-8")
    if old.count(begin) != 1 or old.count(end) != 1:
        raise ValueError(f"{page.name} has no place for these tables: {begin} ... {end}")
    page.write_text(old.split(begin)[0] + f"{begin}\n{text}\n{end}" + old.split(end)[1], encoding="utf-8")
    return text
