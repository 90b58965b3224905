"""`rbd verify`: a certificate of `rbd.robust`, checked in exact arithmetic."""
# Imports are inside the command: --help takes a third of a second.

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from rbd.cli.terminal import NO_SOLUTION, answering, open_console
from rbd.errors import InputError

MOST_BYTES = 2**30
"""A larger file is no certificate."""


def verify(
    file: Annotated[str, typer.Argument(metavar="FILE.json", help="Certificate, as RobustHold.save writes it.")],
) -> None:
    """Check a certificate in exact arithmetic: that every member of a set can be held, or that some cannot.

    Computes in fractions, with Python's standard library alone, from the data that the file holds. Changed files are noticed.

    Exit codes: 0 proved, 1 not proved, 2 no certificate. For example:

    rbd verify held.json
    """
    from rbd.model.input_files import file_bytes
    from rbd.robust import verifier

    console = open_console()
    with answering(verify):
        data = file_bytes(Path(file), MOST_BYTES, "a certificate of rbd.robust")
        try:
            proved, words = verifier.verify(json.loads(data))
        except verifier.NO_CERTIFICATE as error:
            raise InputError(
                f"{file:.300} is no certificate of rbd.robust: {error!r:.200}. Write one with RobustHold.save."
            ) from None
    console.print(f"{'proved' if proved else 'NOT PROVED'}: {words}", highlight=False, soft_wrap=True)
    if not proved:
        raise typer.Exit(NO_SOLUTION)
