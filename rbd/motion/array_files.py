"""The named arrays of a file, of one motion of those that it holds: of an .npz, an .npy, a pickle or a file of joblib."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from stat import S_ISREG
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.model.array_file import FREE, TIMES, npy_array, npz_arrays
from rbd.motion.pickled_data import unpickled

LARGEST = 1e15
"""Numbers beyond this are none of a motion: their squares would overflow further on."""
LISTED = 20
"""Names of motions, or of arrays, in a message."""


@dataclass(frozen=True, eq=False)
class NamedArrays:
    """The arrays of a motion in a file.

    Attributes:
        path: The file.
        arrays: By name, numbers and text.
        others: Names of what is no array.
        motion: Name of the motion, in a file of several; else empty.
        used: Names that were asked for.
    """

    path: Path
    arrays: Mapping[str, Array]
    others: tuple[str, ...] = ()
    motion: str = ""
    used: set[str] = field(default_factory=set)

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def first(self, *names: str) -> str:
        """The first of some names that it has; empty if none."""
        return next((name for name in names if name in self.arrays), "")

    def numbers(self, name: str) -> Array:
        """An array of numbers, of one axis at least.

        Raises:
            InputError: it is text, or not finite.
        """
        self.used.add(name)
        x = self.arrays[name]
        if x.dtype.kind in "US":
            raise InputError(f"{self.path.name}: {name} is text; expected numbers.")
        with np.errstate(invalid="ignore"):  # of a signalling NaN
            x = np.atleast_1d(x.astype(float))
        odd = ~(np.abs(x) <= LARGEST)
        if odd.any():
            where = tuple(int(i) for i in np.argwhere(odd)[0])
            raise InputError(f"{self.path.name}: {name}{list(where)} is {x[where]:g}; expected a finite number.")
        return x

    def texts(self, name: str) -> list[str] | None:
        """An array of text as a list; None where there is none."""
        self.used.add(name)
        x = self.arrays.get(name)
        return None if x is None or x.dtype.kind != "U" else [str(each) for each in x.ravel()]

    def text(self, name: str) -> str:
        """The first text of an array; empty where there is none."""
        return (self.texts(name) or [""])[0]

    def unread(self) -> list[str]:
        """A note of what was not asked for, that of objects first."""
        left = {name: f"{name} {x.shape}" for name, x in self.arrays.items() if name not in self.used}
        left |= {name: name for name in self.others}
        if not left:
            return []
        names = sorted(left, key=lambda name: ("obj" not in name.lower(), name))
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        told = ", ".join(left[name] for name in names[:LISTED])
        objects = "; what it tells of an object is left out" if "obj" in names[0].lower() else ""
        return [f"not read: {told:.600}{more}{objects}."]


def named_arrays(path: Path, motion: str | None) -> NamedArrays:
    """The arrays of one motion of a file.

    Args:
        path: The file.
        motion: Its name, of a file that holds several.

    Raises:
        InputError: no such file or motion; several motions, and none was named; what cannot be read.
    """
    stored = _motions(path)
    names = list(stored)
    if motion is None and len(names) != 1:
        told = ", ".join(map(repr, names[:LISTED]))
        raise InputError(
            f"{path.name} holds {len(names)} motions{': ' if told else ''}{told:.600}; name one, motion={names[0]!r}, "
            "or read all by rbd.motion.read_all(path)."
            if names
            else f"{path.name} holds nothing; expected a motion."
        )
    if motion is not None:
        check_known(f"{path.name} holds no motion", motion, names)
    name = names[0] if motion is None else motion
    arrays, others = {}, []
    for key, value in stored[name].items():
        x = _as_array(value, FREE + TIMES * path.stat().st_size)
        if x is None:
            others.append(str(key))
        else:
            arrays[str(key)] = x
    return NamedArrays(path, arrays, tuple(others), name)


def motion_names(path: Path) -> list[str]:
    """Names of the motions of a file that `named_arrays` reads; one that is empty, where it holds just one without a name.

    Raises:
        InputError: what cannot be read.
    """
    return list(_motions(path))


def _motions(path: Path) -> dict[str, Mapping[str, Any]]:
    """{name of a motion: what is stored of it, by name}."""
    try:
        stat = path.stat()
        if not S_ISREG(stat.st_mode):
            raise OSError("it is no file")
    except OSError as error:
        raise InputError(f"{str(path)!r:.200} cannot be read: {error.strerror or error}.") from error
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=1)
def _read(path: Path, changed: int, size: int) -> dict[str, Mapping[str, Any]]:
    """The same; the last file is kept, of which the motions are often read one after the other."""
    try:
        data = path.read_bytes()
    except (OSError, MemoryError) as error:
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    value: Any
    if data.startswith(b"PK") and b"data.pkl" in data[:200]:
        raise InputError(
            f"{path.name} is a file of PyTorch, which is not read; save arrays instead: numpy.savez(path, qpos=...)."
        )
    if data.startswith(b"PK"):
        value = npz_arrays(path, "biufUS", lambda held: unpickled(held, path.name))
    elif data.startswith(b"\x93NUMPY"):
        value = npy_array(path, lambda held: unpickled(held, path.name))
    else:
        value = unpickled(data, path.name)
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2:
        return {"": {"qpos": value}}
    if isinstance(value, list | tuple) and value and all(isinstance(each, Mapping) for each in value):
        return {str(i): each for i, each in enumerate(value)}
    if not isinstance(value, Mapping):
        raise InputError(f"{path.name} holds a {type(value).__name__}; expected arrays by name, or motions by name.")
    if value and all(isinstance(each, Mapping) for each in value.values()):
        return {str(name): each for name, each in value.items()}
    return dict(_pieces(value)) or {"": value}


def _pieces(value: Mapping[Any, Any]) -> Iterator[tuple[str, Mapping[Any, Any]]]:
    """Motions, by their number, of a file that says where each of several begins and ends, as LocoMuJoCo's."""
    ends = value.get("split_points")
    if not isinstance(ends, np.ndarray) or ends.dtype.kind not in "iu" or ends.ndim != 1 or not 2 < len(ends) < 1e6:
        return
    n, at = int(ends[-1]), ends.tolist()
    for i, (start, end) in enumerate(zip(at[:-1], at[1:], strict=True)):
        cut = {k: x[start:end] if isinstance(x, np.ndarray) and x.shape[:1] == (n,) else x for k, x in value.items()}
        yield str(i), {k: x for k, x in cut.items() if k != "split_points"}


def _as_array(value: Any, most: int) -> Array | None:
    """A number, a text, an array, or a list of them, as an array; None of what is no array, or one of more bytes."""
    if isinstance(value, np.ndarray):
        return value
    if isinstance(value, bool | int | float | str):
        return np.asarray(value)
    if not isinstance(value, list | tuple) or not value:
        return None
    for kinds, each in (((str,), max((len(x) for x in value if isinstance(x, str)), default=0)), ((bool, int, float), 2)):
        if all(isinstance(x, kinds) for x in value):
            return np.array(value) if 4 * len(value) * each <= most else None
    rows = [_as_array(x, most // len(value)) if isinstance(x, list | tuple | np.ndarray) else None for x in value[:100_000]]
    shapes = {None if x is None or x.dtype.kind not in "biuf" else x.shape for x in rows}
    fits = len(rows) == len(value) and len(shapes) == 1 and None not in shapes
    return np.array(rows) if fits and sum(x.nbytes for x in rows if x is not None) <= most else None
