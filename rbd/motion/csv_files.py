"""Tables of numbers in text, read block by block; the meaning of their columns: times, a base, joints."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.motion.file_conventions import checked_joints, formats, single_joints
from rbd.simulation.progress_bar import progress_of

BLOCK = 4_000_000
"""Bytes read at once; what a file holds beyond its numbers is never in memory as a whole."""
LONGEST = 100_000
"""Characters of a line."""
SAMPLE = 200
"""Lines whose decimals are counted."""
MOST = 4_000_000_000
"""Bytes of a file."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?(\d*)|\.(\d+))(?:[eE]([+-]?\d+))?$")


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
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size > MOST:
                raise InputError(f"{path.name} has {size:,} bytes; at most {MOST:,} are read. Cut it into pieces.")
            with progress_of((0.0, float(max(1, size))), shown=progress and size > BLOCK, doing=f"reading {path.name}") as told:
                return _TableReader(path.name, file, told).table()
    except OSError as error:
        raise InputError(f"{str(path)!r:.200} cannot be read: {error.strerror or error}.") from error
    except MemoryError:
        raise InputError(f"{path.name} is larger than the memory.") from None


class _TableReader:
    """Reads one file."""

    def __init__(self, name: str, file: BinaryIO, told: object) -> None:
        self.name, self.file, self.told = name, file, told
        self.rest, self.read, self.line = b"", 0, 1

    def table(self) -> Table:
        """All of it."""
        block = self._block()
        names, commented, first_line = None, None, 0
        while block is not None and not first_line:  # comments, and a header, which may be one
            line, _, after = block.partition("\n")
            cells = _cells(line.strip().lstrip("#").strip())
            if line.lstrip().startswith("#"):
                commented = cells
            elif line.strip() and names is None and _looks_like_header(cells):
                names = cells
            elif line.strip():
                first_line = self.line
                break
            self.line += 1
            block = after if after else self._block()
        if block is None:
            what = "only a header" if names or commented else "nothing"
            raise InputError(f"{self.name} holds {what}; expected a line of numbers a frame.")
        separator = _separator(block.partition("\n")[0])
        width = len(_cells(block.partition("\n")[0]))
        if names is None and commented is not None and len(commented) == width and _looks_like_header(commented):
            names = commented
        if names is not None and len(names) != width:
            raise InputError(
                f"{self.name}: its header names {len(names)} columns, line {first_line} has {width}. Each needs a name."
            )
        steps = _steps([_cells(line) for line in block.split("\n", SAMPLE)[:SAMPLE] if line.strip()], width)
        out, n = np.empty((0, width)), 0
        while block is not None:
            found = self._numbers(block, separator, width)
            if n + len(found) > len(out):
                out.resize((max(n + len(found), int(1.4 * n)), width), refcheck=False)
            out[n : n + len(found)] = found
            n += len(found)
            self.told(float(self.read))  # type: ignore[operator]
            block = self._block()
        out.resize((n, width), refcheck=False)
        named = None if names is None else tuple(cell.strip().strip("\"'") for cell in names)
        return Table(named, out, steps, first_line)

    def _block(self) -> str | None:
        """The next whole lines, None at the end."""
        while True:
            data = self.file.read(BLOCK)
            self.read += len(data)
            data = self.rest + data
            if not data:
                return None
            ended = self.file.peek(1) == b"" if isinstance(self.file, io.BufferedReader) else False
            cut = len(data) if ended else (data.rfind(b"\n") + 1 or data.rfind(b"\r") + 1)
            if not cut and len(data) > LONGEST:
                raise InputError(f"{self.name}: line {self.line} has more than {LONGEST:,} characters; expected a table.")
            whole, self.rest = data[:cut], data[cut:]
            if not whole and not ended:
                continue
            if b"\0" in whole:
                raise InputError(f"{self.name} is no text, but binary; expected a table of numbers (.csv), or an .npz.")
            try:
                text = whole.decode("utf-8-sig" if self.line == 1 else "utf-8")
            except UnicodeDecodeError as error:
                raise InputError(f"{self.name} is no text in UTF-8: byte 0x{whole[error.start]:02x}. {_TRY}") from None
            return text.replace("\r\n", "\n").replace("\r", "\n")

    def _numbers(self, block: str, separator: str | None, width: int) -> Array:
        if not block.strip():
            self.line += block.count("\n")
            return np.empty((0, width))
        try:
            found = np.loadtxt(io.StringIO(block), delimiter=separator, comments=None, ndmin=2, dtype=float)
        except (ValueError, OverflowError, IndexError):
            found = None
        if found is None or found.shape[1] != width or not np.isfinite(found).all():
            self._refuse(block, width)
        self.line += block.count("\n")
        return np.asarray(found)

    def _refuse(self, block: str, width: int) -> None:
        """Name the first line and column that is wrong."""
        for i, line in enumerate(block.split("\n")):
            if not line.strip():
                continue
            cells, where = _cells(line), f"{self.name}, line {self.line + i}"
            if len(cells) != width:
                raise InputError(
                    f"{where} has {len(cells)} columns, those before it {width}. "
                    "Every frame needs as many; is the file cut short?"
                )
            for k, cell in enumerate(cells):
                try:
                    value = float(cell)
                except ValueError:
                    what = repr(cell.strip()[:40]) if cell.strip() else "empty"
                    raise InputError(f"{where}, column {k + 1} is {what}; expected a number.") from None
                if not math.isfinite(value):
                    raise InputError(f"{where}, column {k + 1} is {cell.strip()!r:.40}; expected a finite number.")
        raise InputError(f"{self.name}: the lines from {self.line} on hold no table of numbers. {_TRY}")


_TRY = "Expected numbers in text, a line a frame, separated by commas."


def _separator(line: str) -> str | None:
    for mark in ",;\t":
        if mark in line:
            return mark
    return None


def _cells(line: str) -> list[str]:
    mark = _separator(line)
    return line.strip().split() if mark is None else line.strip("\n").split(mark)


def _is_word(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False


def _looks_like_header(cells: Sequence[str]) -> bool:
    """Names in most cells: one bad number in the first line is no header."""
    return sum(_is_word(cell) and bool(re.search(r"[A-Za-z]", cell)) for cell in cells) > 0.5 * len(cells)


def _steps(lines: list[list[str]], width: int) -> Array:
    """What the last decimal is worth in each column: the finest of plain numbers, the coarsest of those with exponents."""
    out = np.zeros(width)
    for k in range(width):
        plain, powers = math.inf, 0.0
        column = {cells[k].strip() for cells in lines if len(cells) == width}
        for cell in column:
            found = _NUMBER.match(cell)
            if found is None:
                continue
            digits = len(found[1] or found[2] or "")
            if found[3] is None:
                plain = min(plain, 10.0**-digits)
            else:
                powers = max(powers, 10.0 ** min(300, int(found[3]) - digits) if float(cell) else 0.0)
        if len(column) > 1:
            out[k] = max(powers, plain if math.isfinite(plain) else 0.0)
    return out


BASE = 7
"""Columns of a floating base: x, y, z, and a quaternion."""
TIMES = "the first column increases and was taken for times [s]."
"""The note of a table without a header that has one column more than a format."""
_TIME = re.compile(r"(t|time|times|timestamp|seconds)([ _]?[\[(]?(s|sec)[\])]?)?$")
_COUNTED = re.compile(r"(frame|frames|index|frame_id|frame_index|#|)$")
_BASE = r"(?:(?:root|base|pelvis|floating_base|free_?flyer|root_joint|body)[ _./]?)?"
_PLACE = re.compile(_BASE + r"(?:pos|position|trans|translate|p|t)?[ _./]?([xyz])$")
_TURN = re.compile(_BASE + r"(?:q|quat|quaternion|rot|rotation|orientation)[ _./]?([xyzw])$")


@dataclass(frozen=True, eq=False)
class Columns:
    """What is where in a table.

    Attributes:
        time: The column of times; None without one.
        place: Columns of x, y, z of a floating base; empty of a robot without one.
        turn: Columns of its quaternion, in the order x, y, z, w if `named`, else in the order of the file.
        named: Whether the header names the parts of the quaternion.
        joints: {joint: its column}.
        notes: What was guessed, in words.
    """

    time: int | None
    place: tuple[int, ...]
    turn: tuple[int, ...]
    named: bool
    joints: dict[str, int]
    notes: tuple[str, ...]


def columns_of_header(robot: CheckedModel, names: Sequence[str], path: Path) -> Columns:
    """Columns by the names of a header: time, root x y z, quaternion, joints of the robot.

    Raises:
        InputError: a name that the robot lacks, one twice, a base without all its columns.
    """
    known, found = single_joints(robot), dict[str, int]()
    parts, notes, passed = dict[str, int](), [], []
    for k, name in enumerate(names):
        joint, word = _joint(name, known), name.lower().strip()
        place, turn = _PLACE.match(word), _TURN.match(word)
        if joint is not None:
            key = joint
        elif _TIME.match(word):
            key = "time"
        elif _COUNTED.match(word):
            passed.append(name or f"column {k + 1}")
            continue
        elif turn or place:
            key = f"q{turn[1]}" if turn else place[1] if place else ""
        else:
            wanted = [*known, "t", "root_x", "root_qw"]
            raise InputError(
                f"{path.name}: column {k + 1} is named {name!r:.80}, which {robot.name} has no joint for; "
                f"{nearest(name, wanted)}. Leave the column out, or give another robot."
            )
        where = found if joint is not None else parts
        if key in where:
            raise InputError(f"{path.name}: columns {where[key] + 1} and {k + 1} are both {key!r:.80}. Leave one out.")
        where[key] = k
    if passed:
        notes.append(f"columns that only count frames are not read: {', '.join(passed)}.")
    place_at: tuple[int, ...] = ()
    turn_at: tuple[int, ...] = ()
    if robot.floating:
        missing = [word for word in ("x", "y", "z", "qx", "qy", "qz", "qw") if word not in parts]
        if missing:
            raise InputError(
                f"{path.name}: its header has no column of the base for {', '.join(missing)}; expected root_x, root_y, "
                "root_z [m], root_qx, root_qy, root_qz, root_qw. Angles of Euler are not read."
            )
        place_at = tuple(parts[word] for word in "xyz")
        turn_at = tuple(parts[word] for word in ("qx", "qy", "qz", "qw"))
    elif set(parts) - {"time"}:
        notes.append(f"{robot.name} has no floating base; the columns of one are not read.")
    return Columns(parts.get("time"), place_at, turn_at, True, found, tuple(notes))


def columns_by_number(robot: CheckedModel, numbers: Array, joints: Sequence[str] | None, path: Path) -> Columns:
    """Columns of a table without a header: root x y z, quaternion, joints in the order of a format with as many.

    A column more, that increases, in front is one of times.

    Raises:
        InputError: no format has this number of columns; the message lists the formats.
    """
    width, base = numbers.shape[1], BASE if robot.floating else 0
    if (
        robot.bases
        and not robot.floating
        or any(robot.joints[n].nv > 1 for n in robot.joints if robot.joints[n].id not in robot.bases)
    ):
        raise InputError(
            f"{path.name}: {robot.name} has joints of several degrees of freedom; give arrays to Motion.of_arrays."
        )
    known = formats(robot) if joints is None else {"the joints that were given": checked_joints(robot, joints)}
    notes: list[str] = []
    for shift in (0, 1):
        for what, order in known.items():
            if width != shift + base + len(order):
                continue
            if shift and not (np.diff(numbers[:, 0]) > 0.0).all():
                raise InputError(
                    f"{path.name} has {width} columns, one more than {what} of {robot.name}: "
                    "were the first that of times, it would increase. "
                    f"{_all(known, base)}"
                )
            if shift:
                notes.append(TIMES)
            if joints is None:
                notes.append(f"{width} columns without a header: {'' if not base else 'base, then '}{what}, in that order.")
            at = shift + base
            places = tuple(range(shift, shift + 3)) if base else ()
            turn = tuple(range(shift + 3, shift + BASE)) if base else ()
            return Columns(0 if shift else None, places, turn, False, {n: at + i for i, n in enumerate(order)}, tuple(notes))
    raise InputError(f"{path.name} has {width} columns; {_all(known, base)}")


def _all(known: dict[str, tuple[str, ...]], base: int) -> str:
    told = "; ".join(f"{base + len(order)}: {what}" for what, order in known.items())
    more = "x, y, z and a quaternion of the base, then joints" if base else "joints"
    return (
        f"expected ({more}) {told}; or one more, times, in front. "
        "Name the joints in order, joints=[...], or write their names in a header."
    )


def _joint(name: str, known: Sequence[str]) -> str | None:
    """The joint that a column's name means: with or without `_joint`, with `_dof` or `_pos` behind."""
    word = re.sub(r"([_.](dof|pos|position|angle|q))$", "", name.strip())
    for each in (name, word, f"{word}_joint"):
        if each in known:
            return each
    return None
