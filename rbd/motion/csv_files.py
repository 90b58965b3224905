"""Tables of numbers in text, read line by line: their names, their numbers, what their last decimals are worth."""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.simulation.progress_bar import progress_of

LARGE = 4_000_000
"""Bytes of a file from which a bar is shown."""
TOLD = 1000
"""Lines between two of its steps."""
LONGEST = 100_000
"""Characters of a line."""
SAMPLE = 200
"""Lines whose decimals are counted."""
MOST = 4_000_000_000
"""Bytes of a file."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?(\d*)|\.(\d+))(?:[eE]([+-]?\d+))?$")
_NUMBER_OR_NONE = re.compile(_NUMBER.pattern + r"|[+-]?(?:nan|inf|infinity)$", re.IGNORECASE)
_TRY = "Expected numbers in text, a line a frame, separated by commas."


@dataclass(frozen=True, eq=False)
class Table:
    """A table of a file.

    Attributes:
        names: The words of its header; None without one.
        numbers: Shape (n, k).
        steps: What one of the last decimals is worth in each column, shape (k,); 0 where nothing can be told.
        first_line: Where its numbers begin in the file, from 1.
    """

    names: tuple[str, ...] | None
    numbers: Array
    steps: Array
    first_line: int


def read_table(path: Path, *, progress: bool = True) -> Table:
    """The numbers of a text file, a row a line, separated by commas, semicolons, tabs or blanks.

    Raises:
        InputError: no such file, an empty or a binary one, lines of different length, words, NaN, infinity.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            size = os.fstat(file.fileno()).st_size
            if size > MOST:
                raise InputError(f"{path.name} has {size:,} bytes; at most {MOST:,} are read. Cut it into pieces.")
            with progress_of((0.0, float(max(1, size))), shown=progress and size > LARGE, doing=f"reading {path.name}") as done:
                return _table(path.name, file, done)
    except OSError as error:
        raise InputError(f"{str(path)!r:.200} cannot be read: {error.strerror or error}.") from error
    except MemoryError:
        raise InputError(f"{path.name} is larger than the memory.") from None


def _table(name: str, file: TextIO, done: Callable[[float], None]) -> Table:
    lines = _lines(name, file, done)
    names, commented = None, None
    for number, row in lines:  # comments, and a header, which may be one
        cells, first_line = _cells(row.strip().lstrip("#").strip()), number
        if row.lstrip().startswith("#"):
            commented = cells
        elif names is None and _looks_like_header(cells):
            names = cells
        else:
            break
    else:
        what = "only a header" if names or commented else "nothing"
        raise InputError(f"{name} holds {what}; expected a line of numbers a frame.")
    width = len(_cells(row))
    if names is None and commented is not None and len(commented) == width and _looks_like_header(commented):
        names = commented
    if names is not None and len(names) != width:
        raise InputError(f"{name}: its header names {len(names)} columns, line {first_line} has {width}. Each needs a name.")
    sample = [row, *(line for _, line in itertools.islice(lines, SAMPLE - 1))]
    rows = itertools.chain(sample, (line for _, line in lines))
    try:
        numbers = np.loadtxt(rows, delimiter=_separator(row), comments=None, ndmin=2, dtype=float)
    except InputError:
        raise
    except (ValueError, OverflowError, IndexError):
        numbers = np.full((1, 1), np.nan)
    if numbers.shape[1] != width or not np.isfinite(numbers).all():
        file.seek(0)
        _refuse(name, itertools.dropwhile(lambda each: each[0] < first_line, _lines(name, file, done)), width)
    told = None if names is None else tuple(cell.strip().strip("\"'") for cell in names)
    return Table(told, numbers, _steps([_cells(line) for line in sample], width), first_line)


def _lines(name: str, file: TextIO, done: Callable[[float], None]) -> Iterator[tuple[int, str]]:
    """(number, text) of each line that is not blank; `done` is called with the bytes that were read."""
    binary = f"{name} is no text, but binary; expected a table of numbers (.csv), or an .npz."
    buffer = file.buffer
    try:
        for number in itertools.count(1):
            line = file.readline(LONGEST + 1)
            if len(line) > LONGEST:
                raise InputError(f"{name}: line {number} has more than {LONGEST:,} characters; expected a table.")
            if "\0" in line:
                raise InputError(binary)
            if number % TOLD == 0 or not line:
                done(float(buffer.tell()))
            if not line:
                return
            if line.strip():
                yield number, line
    except UnicodeDecodeError as error:
        if b"\0" in error.object:
            raise InputError(binary) from None
        raise InputError(f"{name} is no text in UTF-8: byte 0x{error.object[error.start]:02x}. {_TRY}") from None


def _refuse(name: str, lines: Iterable[tuple[int, str]], width: int) -> None:
    """Name the first line and column that is wrong.

    Raises:
        InputError: always.
    """
    for number, line in lines:
        cells, where = _cells(line), f"{name}, line {number}"
        if len(cells) != width:
            raise InputError(
                f"{where} has {len(cells)} columns, those before it {width}. Every frame needs as many; is the file cut short?"
            )
        for k, cell in enumerate(cells):
            try:
                value = float(cell)
            except ValueError:
                what = repr(cell.strip()[:40]) if cell.strip() else "empty"
                raise InputError(f"{where}, column {k + 1} is {what}; expected a number.") from None
            if not math.isfinite(value):
                raise InputError(f"{where}, column {k + 1} is {cell.strip()!r:.40}; expected a finite number.")
    raise InputError(f"{name} holds no table of numbers. {_TRY}")


def _separator(line: str) -> str | None:
    return next((mark for mark in ",;\t" if mark in line), None)


def _cells(line: str) -> list[str]:
    mark = _separator(line)
    return line.strip().split() if mark is None else line.strip("\n").split(mark)


def _looks_like_header(cells: Sequence[str]) -> bool:
    """Names in most cells: one bad number in the first line is no header."""
    words = [cell for cell in cells if re.search(r"[A-Za-z]", cell) and not _NUMBER_OR_NONE.match(cell.strip())]
    return len(words) > 0.5 * len(cells)


def _steps(lines: list[list[str]], width: int) -> Array:
    """What the last decimal is worth in each column: the finest of plain numbers, the coarsest of those with exponents."""
    out = np.zeros(width)
    for k in range(width):
        plain, powers = [], [0.0]
        column = {cells[k].strip() for cells in lines if len(cells) == width}
        for cell, found in ((cell, _NUMBER.match(cell)) for cell in column):
            digits = len(found[1] or found[2] or "") if found else 0
            if found and found[3] is None:
                plain.append(10.0**-digits)
            elif found and float(cell):
                powers.append(10.0 ** min(300, int(found[3]) - digits))
        if len(column) > 1:
            out[k] = max(*powers, min(plain, default=0.0))
    return out
