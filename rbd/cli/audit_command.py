"""`rbd audit`: contact forces that an engine wrote, judged by the equation of motion and the laws of contact."""
# Imports are inside the command: --help takes a third of a second.

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rbd.cli.terminal import (
    NO_SOLUTION,
    PAGES,
    Json,
    Law,
    PackageDirs,
    answering,
    check_outputs,
    open_console,
    write_json,
    write_outputs,
)
from rbd.errors import InputError


def audit(
    file: Annotated[str, typer.Argument(metavar="RUN.npz", help="Record that the engine wrote; its layout is in the docs.")],
    other: Annotated[
        str | None, typer.Argument(metavar="OTHER.npz", help="Motion of another engine to compare with: where do they part?")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Name (g1) or path of its robot; not needed where the file names it.")
    ] = None,
    law: Law = "coulomb",
    friction: Annotated[float | None, typer.Option(help="Coefficient of all points, in place of the file's.")] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Size from which a cause is reported: speed=0.01; may repeat."),
    ] = None,
    package_dir: PackageDirs = None,
    html: Annotated[Path | None, typer.Option(help="Write the page that plays it, a lane for each cause.")] = None,
    json_: Json = None,
) -> None:
    """Audit an engine's contact forces: does the equation of motion hold, and which law of contact do they obey?

    Names what is wrong, frame by frame: forces that are missing, outside their cone, at a distance; points that lift, creep or
    sink; energy that contacts make. Soft contact is described by its stiffness and creep. Of two files: where the engines part
    first, and why.

    Exit codes: 0 nothing found, 1 causes found or engines part, 2 bad input. For example:

    rbd audit run.npz --robot g1 --html audit.html
    """
    from rbd.audits.auditing import audit as judge
    from rbd.audits.causes import Thresholds
    from rbd.audits.engines_compared import EnginesCompared, compare
    from rbd.audits.record import Record
    from rbd.audits.report import AuditReport
    from rbd.robots.loading import load_robot

    console = open_console()
    with answering(audit):
        check_outputs({"--html": (html, PAGES), "--json": (json_, ())}, reads=file)
        owner = None if robot is None else load_robot(robot, package_dirs=package_dir or ())
        limits, record = Thresholds(**_thresholds(threshold or ())), Record.read(file, owner)
        found: AuditReport | EnginesCompared
        if other is None:
            found = judge(record, law=law, friction=friction, thresholds=limits)
            good = found.ok
        else:
            found = compare(record, Record.read(other, owner).on(record.robot), law=law, thresholds=limits)
            good = found.agree
        write_json(json_, found)
        console.print(str(found), highlight=False, soft_wrap=True)
        write_outputs(console, ("page", html, found.export))
    if not good:
        raise typer.Exit(NO_SOLUTION)


def _thresholds(given: list[str] | tuple[str, ...]) -> dict[str, float]:
    from rbd.audits.causes import Thresholds
    from rbd.errors.inputs import check_known

    found = {}
    for each in given:
        name, _, value = each.partition("=")
        check_known("--threshold has no size", name, [*Thresholds.__dataclass_fields__])
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError(f"--threshold is {each!r:.80}; expected NAME=VALUE, e.g. speed=0.01.") from None
    return found
