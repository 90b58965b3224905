"""What a pickle holds, read as data: nothing is imported and nothing is called, whatever its bytes say.

The opcodes are taken one by one from `pickletools`, and only those for dicts, lists, tuples, strings, numbers and arrays of
NumPy are carried out. An array is bytes, a type and a shape; they are put together here, not by what the pickle names. Files of
joblib hold the bytes of arrays between the opcodes.
"""

from __future__ import annotations

import bz2
import io
import lzma
import math
import pickletools
import re
import struct
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.array_file import FREE, TIMES

INVALID: tuple[type[Exception], ...] = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, EOFError, OSError)
INVALID += (MemoryError, struct.error, zlib.error, lzma.LZMAError)
"""Exceptions of `pickletools`, of decompressors and of this module on invalid bytes."""
_TYPE = re.compile(r"[<>=|]?(?:b1|[iu][1248]|f[248]|[SU]\d{1,5}|O8?)$")
_PUSHED = frozenset(
    "INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT BINFLOAT STRING BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES "
    "BINBYTES8 BYTEARRAY8 UNICODE BINUNICODE SHORT_BINUNICODE BINUNICODE8".split()
)
_ARRAY, _BUFFER, _SCALAR, _NDARRAY, _KIND, _JOBLIB, _TEXT, _DICT, _BYTES = range(9)
_NUMPY = {"multiarray _reconstruct": _ARRAY, "numeric _frombuffer": _BUFFER, "multiarray scalar": _SCALAR}
_KNOWN = {f"numpy.{core}.{name}": what for core in ("core", "_core") for name, what in _NUMPY.items()}
_KNOWN |= {"numpy ndarray": _NDARRAY, "numpy dtype": _KIND, "joblib.numpy_pickle NumpyArrayWrapper": _JOBLIB}
_KNOWN |= {"_codecs encode": _TEXT, "collections OrderedDict": _DICT, "__builtin__ bytes": _BYTES}
"""{module and name in a pickle: what is understood by it}."""
_PACKED: dict[bytes, Callable[[], Any]] = {
    b"x": lambda: zlib.decompressobj(15),
    b"\x1f\x8b": lambda: zlib.decompressobj(31),
    b"BZh": bz2.BZ2Decompressor,
    b"\xfd7zXZ": lambda: lzma.LZMADecompressor(memlimit=200_000_000),
    b"]\0": lambda: lzma.LZMADecompressor(memlimit=200_000_000),
}
"""{how a compressed file of joblib begins: what unpacks it}."""


@dataclass(eq=False)
class _Named:
    """A name in a pickle, or what it becomes once its state is known."""

    what: int
    kind: str = ""
    value: Any = None
    places: list[int] = field(default_factory=list)  # in the memory


def unpickled(data: bytes, name: str) -> Any:
    """The dicts, lists, tuples, strings, numbers and arrays of a pickle, or of a file of joblib; bytes where it has bytes.

    Args:
        data: The file.
        name: Of the file, for messages.

    Raises:
        InputError: anything else in it, by name; what is cut short, or no pickle.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd escapes in odd strings
            return _Reading(_unpacked(data)).run()
    except InputError as error:
        raise InputError(
            f"{name} is a pickle that holds {error}; only dicts, lists, strings, numbers and NumPy arrays are read. Nothing in "
            "it was run. Save arrays instead: numpy.savez(path, root_pos=..., root_rot=..., dof_pos=..., fps=...)."
        ) from None
    except INVALID as error:
        raise InputError(f"{name} is no pickle that can be read: {str(error)[:200] or type(error).__name__}.") from None


def _unpacked(data: bytes) -> bytes:
    make = next((make for magic, make in _PACKED.items() if data.startswith(magic)), None)
    if make is None:
        return data
    unpacker, most = make(), FREE + TIMES * len(data)
    out: bytes = unpacker.decompress(data, most)
    if not unpacker.eof:
        raise ValueError(f"it is cut short, or unpacks to more than {most:,} bytes")
    return out


class _Reading:
    """The stack, the marks and the memory of a pickle that is read."""

    def __init__(self, data: bytes) -> None:
        self.file, self.size = io.BytesIO(data), len(data)
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memory: dict[int, Any] = {}

    def run(self) -> Any:
        for opcode, argument, _ in pickletools.genops(self.file):
            name = opcode.name
            if name in _PUSHED:
                if isinstance(argument, int) and argument.bit_length() > 64:
                    raise InputError("an integer of more than 64 bits")
                self.stack.append(argument)
            elif name == "STOP":
                return _finished(self.pop())
            elif name not in ("PROTO", "FRAME"):
                act = _ACTS.get(name)
                if act is None:
                    raise InputError(f"{name.lower()}, an object")
                act(self, argument)
        raise EOFError("it has no end")

    def pop(self) -> Any:
        """The last value, above the last mark."""
        if len(self.stack) <= (self.marks[-1] if self.marks else 0):
            raise ValueError("a value is missing")
        return self.stack.pop()

    def top(self, kind: type) -> Any:
        """The last value, which stays."""
        value = self.pop()
        self.stack.append(value)
        if not isinstance(value, kind):
            raise ValueError(f"a {kind.__name__} is missing")
        return value

    def marked(self) -> list[Any]:
        """The values since the last mark, which goes."""
        at = self.marks.pop()
        values = self.stack[at:]
        del self.stack[at:]
        return values

    def popped(self, n: int) -> list[Any]:
        """So many values, in order."""
        return [self.pop() for _ in range(n)][::-1]

    def fill(self, pairs: list[Any]) -> None:
        """Keys and values in turn, into the dict below them."""
        into = self.top(dict)
        for key, value in zip(pairs[::2], pairs[1::2], strict=True):
            if not isinstance(key, str | int | float):
                raise InputError(f"a {type(key).__name__} as a key")
            into[key] = value if isinstance(value, _Named) and value.what in (_NDARRAY, _KIND) else _finished(value)

    def find(self, module: Any, name: Any) -> None:
        """A name that is understood."""
        what = _KNOWN.get(f"{module} {name}")
        if what is None:
            raise InputError(f"{module}.{name}"[:200])
        self.stack.append(_Named(what))

    def call(self, argument: Any) -> None:
        """What a name and its arguments stand for."""
        named, given = self.popped(2)
        if not isinstance(named, _Named) or named.value is not None or not isinstance(given, tuple):
            raise ValueError("something is called that is no name")
        out: Any = None
        if named.what == _ARRAY:
            out = _Named(_ARRAY, value=())
        elif named.what == _JOBLIB:
            out = _Named(_JOBLIB, value=())
        elif named.what in (_DICT, _BYTES) and not given:
            out = {} if named.what == _DICT else b""
        elif named.what == _KIND and isinstance(given[0], str) and _TYPE.match(given[0]):
            out = _Named(_KIND, kind=given[0].lstrip("<>=|"), value="=")
        elif named.what == _KIND:
            raise InputError(f"an array of {given[0]!r:.80}")
        elif named.what == _TEXT and given[1] in ("latin1", "latin-1"):
            out = given[0].encode("latin1")
        elif named.what == _SCALAR:
            found = _array(given[1], given[0], (), False)
            out = found if isinstance(found, list) else found.item()
        elif named.what == _BUFFER:
            out = _array(given[0], given[1], given[2], given[3] == "F")
        else:
            raise ValueError("something is called with arguments that it does not have")
        self.stack.append(out)

    def build(self, argument: Any) -> None:
        """The state of an array or of its type."""
        named, state = self.popped(2)
        if not isinstance(named, _Named) or named.value is None:
            raise InputError("an object with a state")
        out: Any = named
        if named.what == _KIND and state[1] in ("<", ">", "|", "=") and not any(state[2:5]):
            named.value = state[1]
        elif named.what == _ARRAY:
            out = _array(state[4], state[2], state[1], bool(state[3]))
        elif named.what == _JOBLIB:
            out = self.inline(state)
        else:
            raise InputError("an array of records")
        self.stack.append(out)
        for place in named.places:  # what is in the memory is the array, too
            self.memory[place] = out

    def inline(self, state: Any) -> Any:
        """An array of joblib, whose bytes follow in the file, behind a padding where it is aligned."""
        kind, shape = state["dtype"], state["shape"]
        if state.get("numpy_array_alignment_bytes") is not None:
            self.file.read(self.file.read(1)[0])
        if not isinstance(kind, _Named) or "O" in kind.kind:
            raise InputError("an array of objects")
        count = _count(shape) * np.dtype(kind.kind).itemsize
        return _array(self.file.read(min(count, self.size)), kind, shape, state["order"] == "F")


def _count(shape: Any) -> int:
    if not isinstance(shape, tuple) or len(shape) > 8 or not all(isinstance(n, int) and 0 <= n < 2**40 for n in shape):
        raise ValueError("a shape is no shape")
    return math.prod(shape)


def _array(data: Any, kind: Any, shape: Any, fortran: bool) -> Array | list[Any]:
    """Bytes as an array; objects as a list, or the only one as it is."""
    if not isinstance(kind, _Named) or kind.what != _KIND:
        raise ValueError("an array has no type")
    count = _count(shape)
    if "O" in kind.kind:
        if not isinstance(data, list) or len(data) != count:
            raise ValueError("an array of objects has other sizes than it says")
        return data if shape else _finished(data[0])
    dtype = np.dtype(kind.kind).newbyteorder(kind.value if kind.value != "|" else "=")
    raw = data.encode("latin1") if isinstance(data, str) else data
    if not isinstance(raw, bytes | bytearray) or not dtype.itemsize or len(raw) != count * dtype.itemsize:
        raise ValueError("an array has other sizes than it says")
    out = np.frombuffer(raw, dtype).reshape(shape, order="F" if fortran else "C")
    out = out.astype(dtype.newbyteorder("="))
    if dtype.kind == "U":
        out.tolist()  # raises on invalid characters
    return out


def _finished(value: Any) -> Any:
    """A value that is none of a pickle's names."""
    if isinstance(value, _Named):
        raise InputError("the name of a type" if value.value is None or value.what == _KIND else "an array without numbers")
    return value


def _list(reading: _Reading, values: list[Any]) -> None:
    reading.stack.append([_finished(value) for value in values])


def _dict(reading: _Reading, values: list[Any]) -> None:
    reading.stack.append({})
    reading.fill(values)


def _put(reading: _Reading, at: int | None) -> None:
    value, place = reading.top(object), len(reading.memory) if at is None else at
    reading.memory[place] = value
    if isinstance(value, _Named):
        value.places.append(place)


_ACTS: dict[str, Callable[[_Reading, Any], Any]] = {
    "MARK": lambda r, x: r.marks.append(len(r.stack)),
    "POP": lambda r, x: r.pop(),
    "POP_MARK": lambda r, x: r.marked(),
    "DUP": lambda r, x: r.stack.append(r.top(object)),
    "NONE": lambda r, x: r.stack.append(None),
    "NEWTRUE": lambda r, x: r.stack.append(True),
    "NEWFALSE": lambda r, x: r.stack.append(False),
    "EMPTY_LIST": lambda r, x: r.stack.append([]),
    "EMPTY_DICT": lambda r, x: r.stack.append({}),
    "EMPTY_TUPLE": lambda r, x: r.stack.append(()),
    "LIST": lambda r, x: _list(r, r.marked()),
    "DICT": lambda r, x: _dict(r, r.marked()),
    "TUPLE": lambda r, x: r.stack.append(tuple(r.marked())),
    "TUPLE1": lambda r, x: r.stack.append(tuple(r.popped(1))),
    "TUPLE2": lambda r, x: r.stack.append(tuple(r.popped(2))),
    "TUPLE3": lambda r, x: r.stack.append(tuple(r.popped(3))),
    "APPEND": lambda r, x: (value := _finished(r.pop()), r.top(list).append(value)),
    "APPENDS": lambda r, x: (values := [_finished(v) for v in r.marked()], r.top(list).extend(values)),
    "SETITEM": lambda r, x: r.fill(r.popped(2)),
    "SETITEMS": lambda r, x: r.fill(r.marked()),
    "PUT": _put,
    "BINPUT": _put,
    "LONG_BINPUT": _put,
    "MEMOIZE": _put,
    "GET": lambda r, x: r.stack.append(r.memory[x]),
    "BINGET": lambda r, x: r.stack.append(r.memory[x]),
    "LONG_BINGET": lambda r, x: r.stack.append(r.memory[x]),
    "GLOBAL": lambda r, x: r.find(*x.split(" ", 1)),
    "STACK_GLOBAL": lambda r, x: r.find(*r.popped(2)),
    "REDUCE": _Reading.call,
    "NEWOBJ": _Reading.call,
    "BUILD": _Reading.build,
}
"""{opcode: what it does to a reading}; others are refused."""
