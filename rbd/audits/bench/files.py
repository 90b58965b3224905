"""Files of friction problems: FCLIB's HDF5 and Siconos' text forms, read and written. Nothing in them is executed.

Sizes come first: a file of more than `LARGEST` bytes is not opened, and every count is compared with what the file can hold
before memory is taken. Text: dimension, number of contacts, W (of a global problem M, then H), q (f, then w), mu, and mu_r of
rolling; a number may follow. A matrix is dense or of blocks. HDF5: groups `fclib_local` and `fclib_global`, here with
`vectors/mu_r` for rolling, `solution`, `guesses`.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.audits.bench.friction import FrictionAnswer, FrictionProblem
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.array_file import a_path
from rbd.model.input_files import file_bytes
from rbd.model.output_files import write_file

LARGEST = 1 << 28
"""Bytes of a file, and entries of what it holds, at most."""
_MOST_ROWS = 1_000_000
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MOST_GUESSES = 100


def read(path: str | os.PathLike[str]) -> FrictionProblem:
    """The friction problem of a file, FCLIB's HDF5 or Siconos' text, by its first bytes.

    Args:
        path: The file.

    Raises:
        ModelError: no regular file.
        InputError: one that is too large; a field that is missing, of another size, or no number: by its name.
            h5py is not installed (extra `bench`).

    Example:
        >>> problem = rbd.audits.bench.FrictionProblem("drop", 3, mu=[0.5], W=np.eye(3), q=[-1.0, 0.1, 0.0])
        >>> rbd.audits.bench.read(rbd.audits.bench.write("drop.dat", problem))
        FrictionProblem('drop.dat', local, dim=3, contacts=1)
    """
    path = a_path(path, "the name of a file, e.g. 'problem.hdf5'")
    data = file_bytes(path, LARGEST, "a friction problem")
    if len(data) > LARGEST:
        raise InputError(f"{path.name} has more than {LARGEST} bytes; expected fewer.")
    try:
        return _of_hdf5(path.name, data) if data.startswith(_SIGNATURE) else _of_text(path.name, data.decode("ascii"))
    except InputError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError) as error:  # no ASCII; of HDF5's library
        raise InputError(f"{path.name} cannot be read: {error}.") from error


# ----------------------------------------------------------------------------------------------------------------------- text


class _Words:
    """The words of a text, taken in order, each with the name of its field."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.words, self.at = name, text.split(), 0

    def numbers(self, what: str, count: int) -> Array:
        if count > len(self.words) - self.at:
            raise InputError(f"{self.name}: {what} has {count} numbers, and {len(self.words) - self.at} are left in the file.")
        try:
            out = np.array(self.words[self.at : self.at + count], dtype=float)
        except ValueError as error:
            raise InputError(f"{self.name}: {what}: {error}.") from error
        self.at += count
        return out

    def counts(self, what: str, count: int, most: int = _MOST_ROWS) -> Array:
        out = self.numbers(what, count)
        if not ((out >= 0) & (out <= most) & (out == np.floor(out))).all():
            raise InputError(f"{self.name}: {what} is {out[:4].tolist()}; expected whole numbers from 0 to {most}.")
        return out.astype(int)

    def count(self, what: str, most: int = _MOST_ROWS) -> int:
        return int(self.counts(what, 1, most)[0])

    def matrix(self, what: str) -> Any:
        """A dense matrix by rows, or one of blocks, each by columns, which are numbered row by row."""
        from scipy.sparse import coo_array, csr_array

        kind, m, n = self.counts(f"{what}: kind of storage, rows, columns", 3)
        if kind == 0:
            again = self.counts(f"{what}: rows and columns", 2)
            if again.tolist() != [m, n]:
                raise InputError(f"{self.name}: {what} has {m} x {n} entries, and then {again[0]} x {again[1]}.")
            return csr_array(self.numbers(f"{what}: entries", int(m) * int(n)).reshape(m, n))
        if kind != 1:
            raise InputError(f"{self.name}: {what} is stored as kind {kind}; expected 0, dense, or 1, of blocks.")
        count, *sides = self.counts(f"{what}: blocks, block rows, block columns", 3).tolist()
        ends = []
        for part, side, size in zip(("rows", "columns"), sides, (m, n), strict=True):
            end = np.r_[0, self.counts(f"{what}: ends of block {part}", side)]
            if end[-1] != size or (np.diff(end) < 0).any():
                raise InputError(f"{self.name}: {what}: blocks of {part} end at {end[-1]}; expected to ascend to {size}.")
            ends.append(end)
        filled, entries = self.counts(f"{what}: row pointers, blocks", 2).tolist()
        first = self.counts(f"{what}: row pointers", filled)
        column = self.counts(f"{what}: block columns", entries, max(sides[1] - 1, 0))
        if entries != count or filled != sides[0] + 1 or first[0] != 0 or first[-1] != count or (np.diff(first) < 0).any():
            raise InputError(f"{self.name}: {what}: row pointers do not ascend from 0 to {count} blocks.")
        row = np.repeat(np.arange(sides[0]), np.diff(first))
        parts: list[tuple[Array, Array, Array]] = [(np.zeros(0), np.zeros(0, int), np.zeros(0, int))]
        for k, (i, j) in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
            if self.count(f"{what}: number of block {k}") != k:
                raise InputError(f"{self.name}: {what}: block {k} has another number.")
            high, wide = (int(end[at + 1] - end[at]) for end, at in zip(ends, (i, j), strict=True))
            values = self.numbers(f"{what}: block {k}", high * wide)
            I, J = np.meshgrid(ends[0][i] + np.arange(high), ends[1][j] + np.arange(wide))  # by columns
            parts.append((values, I.ravel(), J.ravel()))
        data, I, J = (np.concatenate(each) for each in zip(*parts, strict=True))
        return csr_array(coo_array((data, (I, J)), (m, n)))


def _of_text(name: str, content: str) -> FrictionProblem:
    text = _Words(name, content)
    dim = text.count("dimension", 5)
    k = text.count("number of contacts")
    first = text.matrix("W or M")
    size, left, given = dim * k, len(text.words) - text.at, dict[str, Any]()
    rolling = k if dim == 5 else 0
    # A local problem ends after q, mu, mu_r and perhaps a number; a global one has H, f and w.
    if first.shape == (size, size) and left <= size + k + rolling + 1:
        given.update(W=first, q=text.numbers("q", size))
    else:
        H = text.matrix("H")
        if H.shape != (first.shape[0], size):
            raise InputError(f"{name}: H has shape {H.shape}; expected {(first.shape[0], size)}.")
        given.update(M=first, H=H, f=text.numbers("f", first.shape[0]), w=text.numbers("w", size))
    given["mu"] = text.numbers("mu", k)
    if rolling:
        given["mu_r"] = text.numbers("mu_r", k)
    if len(text.words) - text.at > 1:
        raise InputError(f"{name}: {len(text.words) - text.at} words follow mu; expected one number at most.")
    return FrictionProblem(name, dim, **given)


def _of_text_matrix(A: Any) -> list[str]:
    m, n = A.shape
    return ["0", str(m), str(n), f"{m}\t{n}", *(_line(row) for row in A.toarray())]


def _line(values: Array) -> str:
    return " ".join(f"{x:.17g}" for x in values)


# ----------------------------------------------------------------------------------------------------------------------- HDF5


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            "h5py is not installed here, and FCLIB's HDF5 files need it. Install the extra: pip install 'rbd-contact[bench]'"
        ) from error
    return h5py


class _Group:
    """A group of an HDF5 file: datasets by name, their sizes checked before they are read."""

    def __init__(self, name: str, group: Any) -> None:
        self.name, self.group = name, group

    def item(self, what: str, kind: str) -> Any:
        """A group or dataset that is in this file itself, and no link to elsewhere."""
        link = self.group.get(what, getlink=True)
        item = self.group[what] if type(link).__name__ == "HardLink" else None
        if type(item).__name__ != kind:
            raise InputError(f"{self.name}: {self.group.name}/{what} is missing; expected a {kind.lower()} in the file itself.")
        return item

    def numbers(self, what: str, kinds: str = "iuf") -> Array:
        data = self.item(what, "Dataset")
        stored = data.id.get_create_plist()
        filters = {stored.get_filter(i)[0] for i in range(stored.get_nfilters())}
        if data.dtype.kind not in kinds or data.ndim > 1 or data.size > LARGEST // 8 or data.external or data.is_virtual:
            raise InputError(f"{self.name}: {data.name} is {data.dtype} of shape {data.shape}; expected a list of numbers.")
        if not filters <= _FILTERS:
            raise InputError(f"{self.name}: {data.name} is compressed by filters {sorted(filters)}; expected gzip, or none.")
        return np.atleast_1d(data[()])

    def count(self, what: str, least: int = 0, most: int = _MOST_ROWS) -> int:
        found = self.numbers(what, "iu")
        if found.shape != (1,) or not least <= found[0] <= most:
            raise InputError(f"{self.name}: {self.group.name}/{what} is {found[:4]}; expected a number from {least} to {most}.")
        return int(found[0])

    def below(self, what: str) -> _Group:
        return _Group(self.name, self.item(what, "Group"))

    def matrix(self, what: str) -> Any:
        """Of compressed rows (nz = -2) or columns (-1), or of nz triplets; p and i are numbers of columns and rows then."""
        from scipy.sparse import coo_array, csr_array

        own = self.below(what)
        m, n, nz = own.count("m"), own.count("n"), own.count("nz", -2, LARGEST)
        p, i, x = own.numbers("p", "iu"), own.numbers("i", "iu"), own.numbers("x")
        if nz < 0:
            lines = m if nz == -2 else n
            if len(p) != lines + 1 or p[0] != 0 or (np.diff(p) < 0).any() or p[-1] > len(i):
                raise InputError(
                    f"{self.name}: {own.group.name}/p has {len(p)} entries; expected {lines + 1} that ascend from 0."
                )
            p, of = np.repeat(np.arange(lines), np.diff(p)), nz
            nz = len(p)
            if of == -2:
                p, i = i[:nz], p
        if min(len(p), len(i), len(x)) < nz:
            raise InputError(
                f"{self.name}: {own.group.name} has {len(p)}, {len(i)} and {len(x)} entries; expected {nz} of each."
            )
        p, i, x = p[:nz], i[:nz], x[:nz]
        if nz and not (0 <= i.min() and i.max() < m and 0 <= p.min() and p.max() < n):
            raise InputError(f"{self.name}: {own.group.name} has an entry outside of its {m} rows and {n} columns.")
        return csr_array(coo_array((x.astype(float), (i, p)), (m, n)))

    def text(self, what: str) -> str:
        """A text of at most 64 kB; empty where there is none."""
        data = self.item(what, "Dataset") if what in self.group else None
        if data is None or data.dtype.kind != "S" or data.size != 1 or data.dtype.itemsize > 1 << 16:
            return ""
        raw = data[()]
        return raw.decode("utf-8", "replace").strip("\0 \n") if isinstance(raw, bytes) else ""


def _of_hdf5(title: str, data: bytes) -> FrictionProblem:
    with _h5py().File(io.BytesIO(data), "r") as file:
        top = _Group(title, file)
        kinds = [name for name in _KINDS if name in file]
        if not kinds:
            raise InputError(f"{title} holds {list(file)[:5]}; expected one of {', '.join(_KINDS)}.")
        own = top.below(kinds[0])
        for what in ("G", "R", "V"):
            if what in own.group:
                raise InputError(f"{title}: {own.group.name}/{what}: equations beside those of contacts are not read.")
        vectors, given = own.below("vectors"), dict[str, Any]()
        if "M" in own.group:
            given.update(M=own.matrix("M"), H=own.matrix("H"), f=vectors.numbers("f"), w=vectors.numbers("w"))
        else:
            q = "q" if "q" in vectors.group else "a"  # as FCLIB's first writer named it
            given.update(W=own.matrix("W"), q=vectors.numbers(q))
        given.update({name: vectors.numbers(name) for name in ("mu", "mu_r") if name == "mu" or name in vectors.group})
        dim, known = own.count("spacedim"), dict[str, Array]()
        if "info" in own.group:
            info = own.below("info")
            given["about"] = "\n".join(filter(None, (info.text("title"), info.text("description"))))
        places = [("solution", top)] if "solution" in file else []
        if "guesses" in file:
            guesses = top.below("guesses")
            places += [(f"{i + 1}", guesses) for i in range(min(guesses.count("number_of_guesses"), _MOST_GUESSES))]
        for name, place in places:
            r, size = place.below(name).numbers("r"), dim * len(given["mu"])
            if r.shape != (size,):
                raise InputError(f"{title}: {place.group.name}/{name}/r has {len(r)} numbers; expected {size}.")
            known[name if place is top else f"guess {name}"] = r.astype(float)
        return FrictionProblem(title, dim, known=known, **given)


_KINDS = ("fclib_local", "fclib_global", "fclib_local_rolling", "fclib_global_rolling")
_FILTERS = {1, 2, 3}  # deflate, shuffle, checksum: HDF5's own, so that no plug-in is loaded


# -------------------------------------------------------------------------------------------------------------------- writing


def write(path: str | os.PathLike[str], problem: FrictionProblem, answer: FrictionAnswer | None = None) -> Path:
    """The path of a problem written to a new file: HDF5 if its name ends in .hdf5 or .h5, else text.

    Args:
        path: The file; an existing one is replaced.
        problem: The problem.
        answer: Stored as the group `solution`, with r, u, and v of a global problem; a text has no place for it.

    Raises:
        InputError: an answer for a text, or one of another problem; a file that cannot be written.

    Example:
        >>> problem = next(rbd.audits.bench.humanoid_problems(1))
        >>> print(rbd.audits.bench.write("stand.dat", problem))
        stand.dat
    """
    path = a_path(path, "the name of a file, e.g. 'problem.hdf5'")
    check_kind("problem", problem, FrictionProblem, "a FrictionProblem")
    hdf5 = path.suffix in (".hdf5", ".h5")
    if answer is not None:
        check_kind("answer", answer, FrictionAnswer, "a FrictionAnswer, or None")
        if answer.problem is not problem or not hdf5:
            raise InputError(f"{path.name}: an answer is stored with its own problem, in an .hdf5 file.")
    data = _hdf5(problem, answer) if hdf5 else _text(problem).encode("ascii")
    write_file(path, lambda file: file.write(data))
    return path


def _text(P: FrictionProblem) -> str:
    if P.M is None:
        parts = [*_of_text_matrix(P.W), _line(P.free)]
    else:
        assert P.f is not None and P.w is not None
        parts = [*_of_text_matrix(P.M), *_of_text_matrix(P.H), _line(P.f), _line(P.w)]
    rolling = [] if P.mu_r is None else [_line(P.mu_r)]
    return "\n".join([str(P.dim), str(len(P.mu)), *parts, _line(P.mu), *rolling]) + "\n"


def _hdf5(P: FrictionProblem, answer: FrictionAnswer | None) -> bytes:
    out = io.BytesIO()
    with _h5py().File(out, "w") as file:
        kind = ("fclib_local" if P.M is None else "fclib_global") + ("" if P.mu_r is None else "_rolling")
        own = file.create_group(kind)
        own["spacedim"] = np.array([P.dim], np.int32)
        for what in ("W",) if P.M is None else ("M", "H"):
            A, group = getattr(P, what).tocsr(), own.create_group(what)
            for name, value in (("m", A.shape[0]), ("n", A.shape[1]), ("nz", -2), ("nzmax", A.nnz)):
                group[name] = np.array([value], np.int32)
            group["p"], group["i"], group["x"] = A.indptr.astype(np.int32), A.indices.astype(np.int32), A.data
        for what in ("q", "f", "w", "mu", "mu_r"):
            if getattr(P, what) is not None:
                own[f"vectors/{what}"] = getattr(P, what)
        own["info/title"], own["info/description"] = np.bytes_(P.name.encode()), np.bytes_(P.about.encode() or b" ")
        if answer is not None:
            file["solution/r"], file["solution/u"] = answer.r, answer.u
            if P.M is not None:
                file["solution/v"] = answer.v
    return out.getvalue()
