"""The tables of docs/reference/contact_bench.md: solvers on drawn, public and large friction problems, by recomputed residual.

python tests/bench_contact.py [--files FOLDER] [--count 1000] [--write]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from bench_pages import measured_with, put

from rbd.audits.bench import (
    SCENES,
    FrictionAnswer,
    FrictionProblem,
    compare,
    humanoid_problems,
    read,
    solve,
    spheres_in_a_box,
)

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "contact_bench.md"
OURS = "rbd, sparse Newton"
DENSE = 100
"""Contacts of public problems that dense solvers are given, at most."""


def humanoids(count: int) -> str:
    """All solvers, then ours scene by scene."""
    found = compare(humanoid_problems(count))
    lines = ["| scene | problems | solved | worst natural map | open | sticking | sliding |", "| --- |" + " ---: |" * 6]
    for scene in SCENES:
        own = [answer for answer in found.taken(OURS) if answer.problem.name[5:].startswith(f"{scene},")]
        modes = np.sum([modes_of(answer) for answer in own], axis=0)
        worst = max(answer.natural_map for answer in own)
        cells = [scene, len(own), sum(answer.solved for answer in own), f"{worst:.0e}", *modes]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return f"{found.table()}\nContacts of the answers by `{OURS}`:\n\n" + "\n".join(lines) + f"\n\n{measured_with()}"


def modes_of(answer: FrictionAnswer) -> tuple[int, int, int]:
    """How many contacts are open, stick and slide."""
    r, u = answer.r.reshape(-1, 3), answer.u.reshape(-1, 3)
    opens = r[:, 0] <= 1e-12 * answer.size
    slides = ~opens & (np.linalg.norm(u[:, 1:], axis=1) > 1e-9 * np.abs(answer.problem.free).max())
    return int(opens.sum()), int((~opens & ~slides).sum()), int(slides.sum())


def files(folder: Path) -> str:
    """Ours on each file, then all solvers on those of few contacts."""
    problems = [read(path) for path in sorted(folder.iterdir()) if path.suffix in (".dat", ".hdf5")]
    solve(problems[0])  # compiled, and loaded
    lines = [
        "| file | rows of a contact | contacts | solved | natural map | FCLIB's error | time [s] | of the stored solution |",
        "| --- | ---: | ---: | :---: |" + " ---: |" * 4,
    ]
    for problem in problems:
        answer = solve(problem)
        stored = problem.known.get("solution")
        told = "" if stored is None else f"{problem.answer(stored).natural_map:.0e}"
        cells = [
            f"`{problem.name}`",
            problem.dim,
            len(problem.mu),
            "✓" if answer.solved else "no",
            f"{answer.natural_map:.0e}",
            f"{answer.fclib_error:.0e}",
        ]
        lines.append("| " + " | ".join(map(str, [*cells, f"{answer.seconds:.2g}", told])) + " |")
    few = compare([problem for problem in problems if len(problem.mu) < DENSE])
    return "\n".join(lines) + f"\n\nAll solvers on those of fewer than {DENSE} contacts:\n\n{few.table()}"


def spheres() -> str:
    """Spheres at rest, by number and friction."""
    solve(spheres_in_a_box(2, 2))
    lines = [
        "| spheres | contacts | mean friction | solved | natural map | largest speed [m/s] | time [s] |",
        "| ---: | ---: | ---: | :---: |" + " ---: |" * 3,
    ]
    for side, layers, friction in ((5, 5, 0.5), (10, 11, 0.5), (10, 11, 0.1)):
        problem: FrictionProblem = spheres_in_a_box(side, layers, friction=friction)
        answer = solve(problem)
        solved = "✓" if answer.solved else "no"
        cells = [problem.name.split()[0], len(problem.mu), friction, solved, f"{answer.natural_map:.0e}"]
        lines.append("| " + " | ".join(map(str, [*cells, f"{np.abs(answer.u).max():.0e}", f"{answer.seconds:.2g}"])) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables, and put them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=Path, help="folder of .dat and .hdf5 files; without it their table stays")
    parser.add_argument("--count", type=int, default=1000, help="problems of humanoids")
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    asked = parser.parse_args()
    tables = {"humanoids": humanoids(asked.count), "spheres": spheres()}
    if asked.files:
        tables["files"] = files(asked.files)
    for place, text in tables.items():
        print(f"{text}\n")
        if asked.write:
            put(PAGE, place, text, "bench_contact")


if __name__ == "__main__":
    main()
