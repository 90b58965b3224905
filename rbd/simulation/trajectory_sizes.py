"""How much a trajectory's file says that it holds, told before any memory is taken for it."""

from __future__ import annotations

import math
import struct
import zipfile
from dataclasses import dataclass

import numpy as np
from numpy.lib import format as npy

FREE, TIMES = 16_000_000, 64
"""What a file holds takes at most so many bytes, and so many more for each of its own: real motions do not compress further."""
OBJECTS = 100_000
"""So many lists, numbers and words may stand in a header, and one more for each byte of the file."""
_TYPES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8}
"""Bytes of the types of netCDF 3: byte, char, short, int, float, double."""
_DIMENSIONS, _VARIABLES, _ATTRIBUTES = 10, 11, 12


@dataclass(frozen=True)
class Member:
    """An array of an .npz, as its own header describes it.

    Attributes:
        info: Its place in the archive.
        shape: Of the array.
        by_columns: Whether it is stored in Fortran's order.
        kind: Its type, numbers or text.
        start: Where its data begin in the member [bytes].
        size: Of its data [bytes].
    """

    info: zipfile.ZipInfo
    shape: tuple[int, ...]
    by_columns: bool
    kind: np.dtype[np.generic]
    start: int
    size: int


def npz_members(archive: zipfile.ZipFile, file_size: int) -> dict[str, Member]:
    """{array: what it says it is}; of each member only the first bytes are unpacked.

    Raises:
        ValueError: sizes that do not agree, types that are neither numbers nor text, more than such a file can hold.
    """
    infos = archive.infolist()
    _check_total(sum(info.file_size for info in infos), file_size)
    members = {info.filename.removesuffix(".npy"): _member(archive, info) for info in infos}
    if len(members) != len(infos):
        raise ValueError("two of its arrays have one name")
    return members


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Member:
    with archive.open(info) as file:
        version = npy.read_magic(file)
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(f"{info.filename!r:.80} is an array of version {version}")
        shape, by_columns, kind = read(file)
        start = file.tell()
    size = math.prod(shape) * kind.itemsize
    if kind.hasobject or kind.kind not in "fU" or any(k < 0 for k in shape) or start + size != info.file_size:
        raise ValueError(f"{info.filename!r:.80} says that it is {kind} of shape {shape}, which it is not")
    return Member(info, shape, by_columns, kind, start, size)


def check_netcdf(data: bytes) -> None:
    """Refuse a netCDF 3 file whose variables together are larger than the file: several would be read from one place.

    Raises:
        ValueError: that, or bytes that are no such file.
    """
    if data[:3] != b"CDF" or data[3:4] not in (b"\x01", b"\x02"):
        raise ValueError("it does not begin as netCDF 3 does")
    reader = _Reader(data)
    records = reader.number()
    lengths = [reader.dimension() for _ in range(reader.count(_DIMENSIONS))]
    reader.attributes()
    total = 0
    for _ in range(reader.count(_VARIABLES)):
        shape, width = reader.variable(lengths, long=data[3] == 2)
        total += math.prod(records if i == 0 and k == 0 else k for i, k in enumerate(shape)) * width
        if total > len(data):
            raise ValueError("its variables are larger than the file")


def check_header(text: str, file_size: int) -> None:
    """Refuse JSON that would make more objects than a motion of such a file has words and numbers.

    Raises:
        ValueError: that.
    """
    most = OBJECTS + file_size
    if sum(text.count(mark) for mark in ",[{:") > most:
        raise ValueError(f"its header has more than {most:,} entries")


def _check_total(total: int, file_size: int) -> None:
    most = FREE + TIMES * file_size
    if total > most:
        raise ValueError(f"it says that it holds {total:,} bytes; a file of {file_size:,} bytes may hold {most:,} at most")


class _Reader:
    """The header of a netCDF 3 file, item after item; everything in it is padded to four bytes."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 4

    def number(self) -> int:
        """A whole number from 0."""
        return self._unpacked(">I", 4)

    def count(self, kind: int) -> int:
        """How many dimensions, variables or attributes follow."""
        tag, count = self.number(), self.number()
        if tag != (kind if count else tag) or tag not in (0, kind) or 4 * count > len(self._data):
            raise ValueError("its header is damaged")
        return count

    def dimension(self) -> int:
        """Length of a dimension; zero of the one that grows."""
        self._name()
        return self.number()

    def attributes(self) -> None:
        """Pass over attributes."""
        for _ in range(self.count(_ATTRIBUTES)):
            self._name()
            width = self._width()
            self._skip(self.number() * width)

    def variable(self, lengths: list[int], *, long: bool) -> tuple[list[int], int]:
        """(shape, bytes of an entry) of a variable."""
        self._name()
        ids = [self.number() for _ in range(self._few(self.number()))]
        self.attributes()
        width = self._width()
        self._skip(12 if long else 8)  # its size, which readers do not use, and its place
        try:
            return [lengths[i] for i in ids], width
        except IndexError:
            raise ValueError("a variable has a dimension that is not there") from None

    def _name(self) -> None:
        self._skip(self.number())

    def _width(self) -> int:
        kind = self.number()
        if kind not in _TYPES:
            raise ValueError(f"it holds numbers of the type {kind}, which netCDF 3 has not")
        return _TYPES[kind]

    def _few(self, count: int) -> int:
        if count > 32:
            raise ValueError(f"a variable has {count} dimensions")
        return count

    def _skip(self, size: int) -> None:
        self._at += -(-size // 4) * 4
        if self._at > len(self._data):
            raise ValueError("its header is cut short")

    def _unpacked(self, form: str, size: int) -> int:
        try:
            value = struct.unpack_from(form, self._data, self._at)[0]
        except struct.error:
            raise ValueError("its header is cut short") from None
        self._at += size
        return int(value)
