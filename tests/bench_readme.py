"""The tables of the README's section on speed, from the rows of one run."""

from __future__ import annotations

from pathlib import Path

from bench_timing import Row, marks_of, shown, versions

BEGIN, END = "<!-- speed: made by tests/bench.py --readme -->", "<!-- end of speed -->"
ASKED = ("answers", "many", "points", "steps", "fall", "derivatives", "hessian", "linkage")
"""Groups of the first table of the README."""
OTHERS = ("peers", "engines", "solvers")
"""Groups of the second, without marks."""


def _lines(rows: list[Row], *, marks: bool) -> list[str]:
    """A table in Markdown; a row a line."""
    robots = list(dict.fromkeys(name for row in rows for name in row.values if name))
    headings = ["", *(name.capitalize() for name in robots), "unit", *(("mark", "aim") if marks else ())]
    lines = [f"| {' | '.join(headings)} |".replace("|  |", "| |"), "|" + " --- |" * len(headings)]
    for row in rows:
        numbers = [shown(row.values[name]) if name in row.values else "" for name in robots]
        if "" in row.values:
            numbers[0] = shown(row.values[""])
        cells = [row.what, *numbers, row.unit, *(marks_of(row) if marks else ())]
        lines.append("| " + " | ".join(cells).rstrip() + " |")
    return lines


def section(found: dict[str, list[Row]]) -> str:
    """The section between its two marks."""
    of = versions()
    told = ", ".join(f"{name} {of[name]}" for name in ("pin", "numpy", "proxsuite", "numba", "mujoco"))
    asked = [row for name in ASKED for row in found.get(name, ())]
    others = [row for name in OTHERS for row in found.get(name, ())]
    return "\n".join(
        [
            BEGIN,
            *_lines(asked, marks=True),
            "",
            "What they are compared with, and other ways to the same answers:",
            "",
            *_lines(others, marks=False),
            "",
            f"Processor times of one run: python {of['python']}, {told}; {of['processor']}.",
            END,
        ]
    )


def write(page: Path, found: dict[str, list[Row]]) -> str:
    """Put the section into its page, between its two marks, and return it.

    Raises:
        ValueError: if the page has not both marks, once each.
    """
    text = page.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"{page.name} has no place for the table: {BEGIN} ... {END}")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    new = section(found)
    page.write_text(before + new + after, encoding="utf-8")
    return new
