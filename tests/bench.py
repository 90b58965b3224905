"""What an answer and a step of motion cost: medians of one run, side by side, as multiples of one `constraintDynamics` call.

    python tests/bench.py                      all tables, with marks and versions (`make bench`)
    python tests/bench.py --rows answers many  some groups of rows
    python tests/bench.py --profile            where a call of `rbd.solve` and a step of `rbd.simulate` spend their time
    python tests/bench.py --write              all tables, also into docs/reference/speed.md, docs/studies.md, README.md; with
                                               --profile, the parts of a call into docs/design/speed.md

Every call has its own q, v and tau. The columns of a table take turns of a few calls, so that a noisy machine troubles them
alike. Timing is never part of the tests.
"""

from __future__ import annotations

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads cost more than they give on 38 x 38 matrices
os.environ.setdefault("RBD_COMPILED", "1")  # from the first call on

import argparse
import json
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path

import bench_answers
import bench_pages
from bench_analysis import derivative_rows, fall_rows, hessian_rows, linkage_rows, millisecond_rows
from bench_control import control_rows
from bench_draws import Draws
from bench_first_use import first_rows
from bench_motion import motion_rows
from bench_own_rows import own_rows
from bench_planar import planar_rows
from bench_scenes import page_rows
from bench_simulation import accuracy, accuracy_table, peer_step_rows, step_rows
from bench_studies import CHUNKS, all_chunk_rows, study_rows
from bench_terrain import terrain_rows
from bench_timing import Row, table_of, versions
from bench_work import draw, work_rows, work_table
from bench_worlds import world_rows
from rich.console import Console

import rbd

TOP = Path(__file__).parents[1]


@cache
def draws_of(name: str) -> Draws:
    """The draws of one robot, shared by all groups."""
    return Draws(rbd.load_robot(name))


def everyone() -> list[Draws]:
    """Both robots on two soles."""
    return [draws_of("talos"), draws_of("g1")]


def _many() -> list[Row]:
    return bench_answers.many_rows(everyone()) if hasattr(rbd, "solve_many") else []


ASKED: dict[str, Callable[[], list[Row]]] = {
    "answers": lambda: bench_answers.answer_rows(everyone()),
    "many": _many,
    "points": lambda: bench_answers.point_rows(everyone()),
    "control": lambda: control_rows(everyone()),
    "steps": step_rows,
    "fall": lambda: fall_rows(draws_of("talos").robot),
    "terrain": terrain_rows,
    "worlds": world_rows,
    "derivatives": lambda: derivative_rows(everyone()),
    "hessian": lambda: hessian_rows(draws_of("talos").robot),
    "linkage": linkage_rows,
    "own": own_rows,
    "motion": lambda: motion_rows(draws_of("g1").robot),
    "first": first_rows,
}
"""Groups of rows that make the first table."""
OTHERS: dict[str, tuple[str, Callable[[], list[Row]]]] = {
    "peers": ("peers of the same run, two soles", lambda: bench_answers.peer_rows(everyone())),
    "engines": ("a step of 1 ms, and one evaluation, beside MuJoCo", peer_step_rows),
    "work": ("processor time of rbd.simulate at an error, over MuJoCo's best setting", work_rows),
    "solvers": ("solvers asked for by name, and inverse dynamics", lambda: bench_answers.solver_rows(everyone())),
    "milliseconds": ("mechanisms; robots loaded; where Talos can stand", lambda: millisecond_rows(draws_of("talos").robot)),
    "planar": ("planar chains", planar_rows),
    "studies": ("studies of many samples, on the clock", study_rows),
    "chunks": (CHUNKS, all_chunk_rows),
    "pages": ("pages of robots: size, and time on the clock from opening to drawn", page_rows),
}
"""Groups with a table of their own: {group: (title, rows)}."""


def measured(groups: Sequence[str]) -> tuple[dict[str, list[Row]], list[str]]:
    """({group: its rows} in the order of the tables, what failed); a group that fails does not end the others."""
    makers = ASKED | {name: rows for name, (_, rows) in OTHERS.items()}
    found, failed = {}, []
    for name in [name for name in makers if name in groups]:
        try:
            found[name] = makers[name]()
        except Exception:
            failed.append(f"{name}: {traceback.format_exc(limit=-2)}")
    return found, failed


def show(console: Console, found: dict[str, list[Row]]) -> None:
    """Print the tables of what was measured."""
    asked = [row for name in ASKED for row in found.get(name, ())]
    if asked:
        console.print(table_of("certified answers, motion and derivatives, with their marks", asked))
    for name, (title, _) in OTHERS.items():
        if found.get(name):
            console.print(table_of(title, found[name]))


def main() -> None:
    """Measure and print."""
    groups = [*ASKED, *OTHERS, "accuracy"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", choices=groups, default=groups, metavar="GROUP", help=", ".join(groups))
    parser.add_argument("--profile", action="store_true", help="where the time of a call and of a step goes")
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    parser.add_argument(
        "--write",
        action="store_true",
        help="put the tables into docs/reference/speed.md and README.md, the profile into docs/design/speed.md",
    )
    given = parser.parse_args()
    console, start = Console(width=140), time.perf_counter()
    if given.profile:
        from bench_profile import profile_table, profiles

        parts = profiles(draws_of("talos"))
        for title, columns in parts.items():
            console.print(profile_table(title, columns))
        if given.write:
            bench_pages.design(TOP / "docs" / "design" / "speed.md", parts)
        return
    found, failed = measured(given.rows)
    if failed:
        print(*failed, sep="\n", file=sys.stderr)
    if given.json:
        print(json.dumps({name: [asdict(row) for row in rows] for name, rows in found.items()}))
        sys.exit(len(failed))
    console.print(", ".join(f"{name} {version}" for name, version in versions().items()))
    show(console, found)
    if "peers" in given.rows:
        for d in everyone():
            console.print(bench_answers.agreement(d))
    errors = accuracy() if "accuracy" in given.rows else {}
    if errors:
        console.print(accuracy_table(errors))
    console.print("measured in {:.0f} min {:.0f} s; median processor times".format(*divmod(time.perf_counter() - start, 60.0)))
    if given.write:
        if "studies" in found and "chunks" in found:
            bench_pages.studies(TOP / "docs" / "studies.md", found)
        if "work" in found:
            draw(TOP / "docs" / "pictures" / "work_precision.png")
            bench_pages.work(TOP / "docs" / "reference" / "speed.md", work_table())
        if set(found) - {"studies", "chunks", "work"}:
            bench_pages.reference(TOP / "docs" / "reference" / "speed.md", found, errors)
            bench_pages.readme(TOP / "README.md", found)
    sys.exit(len(failed))


if __name__ == "__main__":
    main()
