"""`ZarrStore`: results of a study in a folder that zarr and xarray read, written chunk by chunk so that nothing is lost."""

from __future__ import annotations

import json
import math
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.errors.stopped import StudyStopped
from rbd.studies.dataset import MESSAGE, OK, OUTCOME, OWN, REASON, coordinates
from rbd.studies.kept.variable import Block, Variable, missing
from rbd.studies.provenance.provenance import LAYOUT, check_same, continued, finished, format_of, others_of
from rbd.studies.sampling.samples import Samples
from rbd.studies.stores.pacing import Pacing, why
from rbd.studies.stores.pieces import Pieces, piece_size
from rbd.studies.stores.places import Lock
from rbd.studies.stores.store import Buffer, Seen, empty_of, variable_of
from rbd.studies.stores.zarr_reading import LOADED, read_zarr

if TYPE_CHECKING:
    import xarray

MOST_BUFFERS = 8
"""Chunks in memory beyond which they are written at once."""


class ZarrStore:
    """A study in a folder; one array for each variable, of the shape of the samples' grid.

    Files are replaced whole, after their contents are on the disk. `reason` of a chunk is written after all other variables:
    what it marks as computed is there. Blocks are collected, and written once a second or less often (`Pacing`).

    Args:
        path: The folder; a store of the same study goes on.
        samples: The samples.
        attributes: Provenance.

    Raises:
        InputError: a folder that is no store, or one of another study, damaged, of a newer `rbd`, or being filled now.
    """

    def __init__(self, path: Path, samples: Samples, attributes: Mapping[str, Any]) -> None:
        self.path, self.samples = path, samples
        self._root = path.resolve()
        self.done = np.zeros(len(samples), bool)
        self.seen = Seen(samples)
        self.attributes = dict(attributes)
        self.others = ""
        self._pieces: Pieces | None = None
        self._forms: dict[str, Variable] = {}
        self._arrays: dict[str, Any] = {}
        self._labels: dict[str, tuple[Any, ...]] = {}
        self._listed: list[str] = []
        self._buffers: dict[int, Buffer] = {}
        self._dirty: set[int] = set()
        self._stored: set[int] = set()
        self._computed = False
        self._outcome: dict[str, str] = {}
        self._stale = False
        self._count = self._written = 0
        self._pacing = Pacing(self._write_all, self._told)
        self.made = not (self._root.is_dir() and any(self._root.iterdir()))
        if self.made:
            self._make()
            self._lock = Lock(path, self._root)
        else:
            self._lock = Lock(path, self._root)
            try:
                self._load()
            except BaseException:
                self._lock.close()
                raise

    def put(self, block: Block) -> None:
        """As `Store.put`."""
        with self._pacing.guard:
            self._pacing.check()
            block = self.seen.checked(block)
            if self._pieces is None:
                self._pieces = Pieces.of(tuple(self.samples.dims.values()), piece_size(block, len(self.samples)))
            for name, v in block.variables.items():
                if name not in self._forms:
                    self._forms[name] = empty_of(v, 0)
                    self._labels |= {dim: tuple(labels) for dim, labels in v.labels.items()}
            for piece in range(self._pieces.number(block.start), self._pieces.number(block.stop - 1) + 1):
                self._buffer(piece).put(block)
                self._dirty.add(piece)
            self._count += int(np.count_nonzero(~self.done[block.start : block.stop]))
            self.done[block.start : block.stop], self._computed = True, True
            self._pacing.changed(now=len(self._buffers) > MOST_BUFFERS)

    def dataset(self) -> xarray.Dataset:
        """As `Store.dataset`; read from the disk, into memory if it is small."""
        with self._pacing.guard:
            self._pacing.write()
            found = self.kept()
            if self._computed:
                self.attributes = finished(self.attributes)
                self._outcome = {name: found.attrs[name] for name in OUTCOME if name in found.attrs}
                self._write_root()
                found.attrs = {**self.attributes, **self._outcome}
        return found

    def kept(self) -> xarray.Dataset:
        """As `Store.kept`."""
        return read_zarr(self.path)

    def _write_root(self) -> None:
        from rbd.studies.stores import zarr_files

        try:
            zarr_files.write_root(self._root, self._whole_attributes(), self._listed)
        except (OSError, StudyStopped) as error:
            raise self._told(error) from error

    def close(self) -> None:
        """As `Store.close`; a new store in which nothing is done is removed."""
        try:
            with self._pacing.guard:
                self._pacing.write()
        finally:
            self._pacing.stop()
            if self.made and not self.done.any():
                shutil.rmtree(self._root, ignore_errors=True)
            self._lock.close()

    # Opening

    def _make(self) -> None:
        from rbd.studies.stores import zarr_files

        part = self._root.with_name(f".{self._root.name}.{time.time_ns():x}.part")
        try:
            part.mkdir()
            self._listed = zarr_files.write_coordinates(part, coordinates(self.samples))
            zarr_files.write_root(part, self._whole_attributes(), self._listed)
            part.replace(self._root)
        except (OSError, StudyStopped) as error:
            shutil.rmtree(part, ignore_errors=True)
            raise InputError(f"out {str(self.path)!r:.300} cannot be written: {why(error)}.") from error

    def _load(self) -> None:
        from rbd.studies.stores import zarr_files

        path = str(self.path)
        try:
            old, arrays = zarr_files.read_root(self._root)
            format_of(old, path)
            layout = json.loads(old[LAYOUT])
            first = {str(name): (int(a), int(b)) for name, (a, b) in layout["first"].items()}
            labelled = [str(dim) for dim in layout["labels"]]
        except FileNotFoundError:
            raise InputError(
                f"out {path!r:.300} is a folder with other contents, and no store of a study. Give another path."
            ) from None
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"out {path!r:.300} is a damaged store: its {zarr_files.ROOT} is not as rbd writes it ({error!s:.100}). "
                "Delete it, or give another path."
            ) from error
        check_same(old, self.attributes, path)
        self.others = others_of(old, self.attributes)
        self.attributes = continued(old, self.attributes)
        zarr_files.write_coordinates(self._root, coordinates(self.samples))
        self._listed = list(arrays)
        self._stale = any(name in old for name in OUTCOME)
        for part in self._root.rglob(".*.part"):
            with suppress(OSError):
                part.unlink()
        if REASON not in arrays:
            return
        try:
            self._load_arrays(arrays, first, labelled)
        except (KeyError, TypeError, ValueError, OSError, RuntimeError) as error:
            raise InputError(
                f"out {path!r:.300} is a damaged store: {error!s:.200}. Delete it, or give another path."
            ) from error

    def _load_arrays(self, arrays: Mapping[str, Any], first: Mapping[str, tuple[int, int]], labelled: Iterable[str]) -> None:
        from rbd.studies.stores import zarr_files

        shape = tuple(self.samples.dims.values())
        self._pieces = Pieces(shape, tuple(arrays[REASON]["chunk_grid"]["configuration"]["chunk_shape"]))
        self._arrays = {name: zarr_files.array(self._root, name) for name in (OK, MESSAGE, REASON, *first)}
        for dim in labelled:
            if not zarr_files.chunk_file(self._root, dim, (0,)).is_file():
                raise ValueError(f"the labels of {dim!r:.80} are missing")
            self._labels[dim] = tuple(zarr_files.labels_of(zarr_files.array(self._root, dim)[...]))
        for name in first:
            a = self._arrays[name]
            dims = tuple(a.metadata.dimension_names)[len(shape) :]
            values = np.empty((0, *a.shape[len(shape) :]), object if a.dtype.kind in "TO" else a.dtype)
            labels = {dim: self._labels[dim] for dim in dims if dim in self._labels}
            self._forms[name] = variable_of(values, dims, labels, arrays[name].get("attributes", {}))
        self.seen.begin(first, self._forms)
        reason = self._reasons()
        self.done = reason != Reason.NOT_RUN.code
        starts = [self._pieces.span(k) for k in range(len(self._pieces))]
        self._stored = {k for k, (start, stop) in enumerate(starts) if self.done[start:stop].any()}
        damaged = self._damaged()
        for piece in sorted(damaged):
            start, stop = starts[piece]
            self.done[start:stop] = False
            self._write(REASON, piece, np.full(stop - start, Reason.NOT_RUN.code, np.int16))
        self._stored -= damaged
        self._count = self._written = int(np.count_nonzero(self.done))

    def _reasons(self) -> Array:
        """Codes of all samples; `NOT_RUN` in chunks that cannot be read."""
        assert self._pieces is not None
        a = self._arrays[REASON]
        try:
            return np.asarray(a[...]).ravel()
        except (RuntimeError, ValueError, OSError):
            found = np.full(len(self.samples), Reason.NOT_RUN.code, np.int16)
            for piece in range(len(self._pieces)):
                start, stop = self._pieces.span(piece)
                with suppress(RuntimeError, ValueError, OSError):
                    found[start:stop] = np.asarray(a[self._pieces.place(piece)]).ravel()
            return found

    def _damaged(self) -> set[int]:
        """Chunks with results whose files are missing or, in stores that are not large, damaged: computed again."""
        from rbd.studies.stores import zarr_files

        assert self._pieces is not None
        found, check = set(), self._bytes() <= LOADED
        for piece in self._stored:
            index = self._pieces.index(piece)
            for name, form in {OK: None, MESSAGE: None, **self._forms}.items():
                inner = () if form is None else (0,) * (form.values.ndim - 1)
                try:
                    if not zarr_files.chunk_file(self._root, name, index + inner).is_file():
                        raise OSError("no such file")
                    if check:
                        self._arrays[name][self._pieces.place(piece)]
                except (RuntimeError, ValueError, OSError):
                    found.add(piece)
                    break
        return found

    def _bytes(self) -> int:
        """Size of all variables in memory."""
        each = 16 + sum(math.prod(v.values.shape[1:]) * v.values.dtype.itemsize for v in self._forms.values())
        return each * len(self.samples)

    # Writing

    def _buffer(self, piece: int) -> Buffer:
        """The samples of a chunk in memory; what is on the disk is read first."""
        assert self._pieces is not None
        if piece in self._buffers:
            return self._buffers[piece]
        start, stop = self._pieces.span(piece)
        found = self._buffers[piece] = Buffer(start, stop)
        if piece in self._stored:
            place = self._pieces.place(piece)
            for name, form in self._forms.items():
                if name in self._arrays:
                    new = empty_of(form, stop - start)
                    new.values[...] = np.asarray(self._arrays[name][place]).reshape(new.values.shape)
                    found.variables[name] = new
            found.ok[:] = np.asarray(self._arrays[OK][place]).ravel()
            found.reason[:] = np.asarray(self._arrays[REASON][place]).ravel()
            texts = np.asarray(self._arrays[MESSAGE][place]).ravel()
            found.messages |= {start + i: str(text) for i, text in enumerate(texts) if text}
        return found

    def _told(self, error: Exception) -> StudyStopped:
        return StudyStopped(
            f"{str(self.path)!r:.300} cannot be written: {why(error)}. At least {self._written:,} of {len(self.samples):,} "
            "samples are stored; make room, and the same call goes on from there."
        )

    def _write_all(self) -> None:
        from rbd.studies.stores import zarr_files

        assert self._pieces is not None
        new = [name for name in self._forms if name not in self._arrays]
        if OK not in self._arrays:
            self._new_own()
        for name in new:
            self._new_variable(name)
        dirty = sorted(self._dirty)
        folders: set[Path] = set()
        for piece in dirty:
            buffer = self._buffers[piece]
            n = buffer.stop - buffer.start
            messages = np.full(n, "", object)
            for i, text in buffer.messages.items():
                messages[i - buffer.start] = text
            folders |= self._write(OK, piece, buffer.ok) | self._write(MESSAGE, piece, messages)
            for name, form in self._forms.items():
                values = buffer.variables[name].values if name in buffer.variables else empty_of(form, n).values
                folders |= self._write(name, piece, values)
        if new or REASON not in self._listed or self._stale:
            extra = (OK, REASON, MESSAGE, *self.seen.in_order(), *self._labels)
            self._listed = [*(name for name in self._listed if name not in extra), *extra]
            zarr_files.write_root(self._root, self._whole_attributes(), self._listed)
            self._stale = False
        zarr_files.sync_folders(folders | {self._root})
        folders = set()
        for piece in dirty:
            folders |= self._write(REASON, piece, self._buffers[piece].reason)
        zarr_files.sync_folders(folders)
        self._stored |= self._dirty
        self._written = self._count
        self._dirty.clear()
        complete = [k for k, b in self._buffers.items() if self.done[b.start : b.stop].all()]
        spare = [k for k in self._buffers if k not in complete]
        for piece in (*complete, *spare[:-4]):
            del self._buffers[piece]

    def _new_own(self) -> None:
        """The arrays that every study has."""
        from rbd.studies.stores import zarr_files

        assert self._pieces is not None
        kinds = {
            OK: (np.dtype(bool), False),
            MESSAGE: (np.dtype(object), ""),
            REASON: (np.dtype(np.int16), Reason.NOT_RUN.code),
        }
        for name, (kind, fill) in kinds.items():
            p = self._pieces
            zarr_files.new_array(self._root, name, self.samples.dims, p.shape, p.chunk, kind, fill)
            zarr_files.set_attributes(self._root, name, OWN[name])
            self._arrays[name] = zarr_files.array(self._root, name)

    def _new_variable(self, name: str) -> None:
        """The array of a variable, and of its labels; chunks that are stored already get one without values."""
        from rbd.studies.stores import zarr_files

        assert self._pieces is not None
        v, p = self._forms[name], self._pieces
        inner = v.values.shape[1:]
        fill = missing(v.values.dtype)
        dims = (*self.samples.dims, *v.dims)
        zarr_files.new_array(self._root, name, dims, (*p.shape, *inner), (*p.chunk, *inner), v.values.dtype, fill)
        zarr_files.set_attributes(self._root, name, v.attributes)
        self._arrays[name] = zarr_files.array(self._root, name)
        for piece in self._stored - self._dirty:
            start, stop = p.span(piece)
            self._write(name, piece, empty_of(v, stop - start).values)
        for dim, labels in v.labels.items():
            if dim not in self._listed:
                x = zarr_files.as_array(labels)
                zarr_files.new_array(self._root, dim, (dim,), x.shape, x.shape, x.dtype, np.zeros(1, x.dtype)[0])
                zarr_files.array(self._root, dim)[...] = x

    def _write(self, name: str, piece: int, values: Array) -> set[Path]:
        """Write a chunk; the folders in which its name stands."""
        from rbd.studies.stores import zarr_files

        assert self._pieces is not None
        place = self._pieces.place(piece)
        inner = values.shape[1:]
        self._arrays[name][place] = values.reshape(tuple(s.stop - s.start for s in place) + inner)
        file = zarr_files.chunk_file(self._root, name, self._pieces.index(piece) + (0,) * len(inner))
        return {folder for folder in file.parents if self._root in folder.parents}

    def _whole_attributes(self) -> dict[str, Any]:
        plain = [
            name
            for name, (dims, _, _) in self.samples.coords().items()
            if tuple(dims) != (name,) and not re.search(r"\s", name)
        ]
        layout = json.dumps(
            {
                "first": self.seen.first,
                "labels": list(self._labels),
                "dims": dict(self.samples.dims),
                "coords": list(self.samples.coords()),
            }
        )
        return {**self.attributes, **self._outcome, LAYOUT: layout} | ({"coordinates": " ".join(plain)} if plain else {})
