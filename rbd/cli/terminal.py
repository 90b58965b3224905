"""Output of the command line: text is printed literally, never as markup; bad options are refused."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import rich.table
import typer
from rich import box
from rich.console import Console
from rich.text import Text

from rbd.errors import InputError, NoSolution, RbdError
from rbd.model.output_files import check_place

NO_SOLUTION, BAD_INPUT = 1, 2
WIDTH = 140
"""A file or a pipe has no width; tables cut at 80 columns would lose numbers."""
PAGES, FIGURES, TRAJECTORIES = (".html", ".htm"), (".png", ".svg", ".pdf"), (".npz", ".nc")
_SILENT = (DeprecationWarning, PendingDeprecationWarning, ResourceWarning)


class Table(rich.table.Table):
    """A table whose text is told as it is: "[/foo]" and ":smile:" are names of joints, also where a console reads markup.

    Args:
        title: Above the table, on the left.
        headings: Whether the columns have any.
    """

    def __init__(self, title: str | None = None, *, headings: bool = True) -> None:
        told = None if title is None else Text(title)
        super().__init__(title=told, title_justify="left", box=box.SIMPLE_HEAD, show_header=headings)

    def add_column(self, header: Any = "", **options: Any) -> None:  # type: ignore[override]
        """A column; see rich."""
        super().add_column(_as_it_is(header), **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        """A row; see rich."""
        super().add_row(*map(_as_it_is, cells), **options)


def open_console(*, errors: bool = False) -> Console:
    """The console of standard output, or of the errors' stream.

    What the stream's encoding cannot say (a name that is not UTF-8, a ² on an ASCII terminal) is written with backslashes.
    """
    stream = sys.stderr if errors else sys.stdout
    if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
        stream.reconfigure(errors="backslashreplace")
    console = Console(stderr=errors, markup=False, emoji=False)
    return console if console.is_terminal else Console(stderr=errors, markup=False, emoji=False, width=WIDTH)


@contextmanager
def answering() -> Iterator[None]:
    """Turn this package's errors into messages and exit codes, and its warnings into lines, each told once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except NoSolution as error:
            _fail("no solution", error, NO_SOLUTION)
        except RbdError as error:
            _fail("bad input", error, BAD_INPUT)
        finally:
            for words in dict.fromkeys(str(w.message) for w in caught if not issubclass(w.category, _SILENT)):
                _complain("warning", "yellow", words)


def check_outputs(outputs: Mapping[str, tuple[Path | None, tuple[str, ...]]], *, beside: str | None = None) -> None:
    """Refuse files that could not be written, before anything is computed.

    Args:
        outputs: {option: (where it goes, or None; the endings that it may have, () for any)}.
        beside: The file that the command reads: it is not overwritten.

    Raises:
        InputError: an ending that says nothing, a folder that is not there, no permission, one file for two options.
    """
    taken: dict[str, str] = {}
    if beside is not None and os.path.isfile(beside):
        taken[os.path.realpath(beside)] = "the file that is read"
    for option, (path, endings) in outputs.items():
        if path is None:
            continue
        suffix = path.suffix if endings is TRAJECTORIES else path.suffix.lower()
        if endings and suffix not in endings:
            raise InputError(f"{option} is {str(path)!r:.300}; expected a file that ends in {' or '.join(endings)}.")
        check_place(path, what=option)
        if other := taken.get(place := os.path.realpath(path)):
            raise InputError(f"{option} and {other} are one file, {str(path)!r:.300}. Give each its own.")
        if path.is_file() or not path.exists():  # two answers may go to one device
            taken[place] = option


def _fail(what: str, error: RbdError, code: int) -> NoReturn:
    _complain(what, "red", str(error))
    raise typer.Exit(code)


def _complain(what: str, color: str, words: str) -> None:
    open_console(errors=True).print(Text.assemble((what, color), f": {words}"), soft_wrap=True)


def _as_it_is(cell: Any) -> Any:
    return Text(cell) if isinstance(cell, str) else cell
