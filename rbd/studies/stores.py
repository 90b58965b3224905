"""`Store`: the results of a study while they come in, in memory or on disk; and the dataset of a study that was stored."""

from __future__ import annotations

import fcntl
import io
import itertools
import json
import math
import os
import re
import shutil
import time
import warnings
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, StudyStopped
from rbd.model.output_files import check_place, write_file
from rbd.modules import xarray_or_error, zarr_or_error
from rbd.simulation.trajectory_file import BytesReadOnce
from rbd.studies.dataset import LAYOUT, block_of, empty_dataset, filled, netcdf, outcome_of, restored
from rbd.studies.outputs.fields import REASON, Block, joined
from rbd.studies.outputs.layout import Layout
from rbd.studies.provenance.study_attributes import check_same, continued, finished, format_of, others_of
from rbd.studies.sampling.draws import grid
from rbd.studies.sampling.samples import ONE, Samples

if TYPE_CHECKING:
    import xarray

ZARR, NETCDF = ".zarr", ".nc"
PARTS, PART, OF = ".parts", ".part", "study"
"""Endings of the folder with the parts of a study and of its files, and the file with its samples and attributes."""
FIRST, FILES = "first", "rbd_files"
"""Attributes: of a part where its variables first came, of a zarr store how many files it has."""
OFTEN, SELDOM, SHARE = 1.0, 5.0, 20.0
"""The shortest and the longest time between two writings [s]; between them it is so many times as long as a writing takes."""
LOADED = 1_000_000_000
"""Datasets up to so many bytes are read into memory, larger ones as they are used."""
LARGEST = 200_000_000
"""Bytes of the largest study that is written as netCDF, which is written whole."""
SLAB = 100_000_000
"""Bytes of the results that are in memory at once while a finished zarr store is written."""


class Parts:
    """What is done of a study: blocks in memory, and files of a folder, each with some samples, written whole or not at all.

    Args:
        empty: The samples' coordinates, and the study's attributes.
        layout: The variables so far.
        folder: Where the files are; None: in memory only.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.
    """

    def __init__(self, empty: xarray.Dataset, layout: Layout, folder: Path | None) -> None:
        self.empty, self.layout, self.folder = empty, layout, folder
        self.dims: dict[str, int] = json.loads(empty.attrs[LAYOUT])["dims"]
        self.done = np.zeros(math.prod(self.dims.values()), bool)
        self.blocks: list[Block] = []
        self.files: dict[Path, tuple[int, int]] = {}

    def load(self) -> list[Path]:
        """Find the files of the folder; those that cannot be read are returned."""
        damaged = []
        for file in sorted(self.folder.glob("*" + PART)) if self.folder else ():
            try:
                part = _read_part(file)
                block = block_of(part)
                self.layout.begin(block, json.loads(part.attrs[FIRST]))
            except (OSError, ValueError, KeyError, TypeError, zlib.error):
                damaged.append(file)
                continue
            self._found(file, block)
            self.empty.attrs["finished"] = max(part.attrs["finished"], self.empty.attrs.get("finished", ""))
        return damaged

    def write(self) -> None:
        """Write the blocks in memory, as one file."""
        assert self.folder is not None
        numbers = np.sort(np.concatenate([each.numbers for each in self.blocks]))
        numbers = numbers[np.append(np.diff(numbers) > 0, True)]  # batches that are computed again overlap
        block = joined(numbers, self.blocks, self.layout.forms)
        attributes = {FIRST: json.dumps(self.layout.first), "finished": self.empty.attrs.get("finished", "")}
        empty = xarray_or_error().Dataset(coords={ONE: numbers.astype(float)}, attrs=attributes)
        content = netcdf(filled(empty, {ONE: len(numbers)}, block))
        file = self.folder / f"{len(self.files):06}-{time.time_ns():x}{PART}"
        write_file(file, lambda out: out.write(zlib.compress(content, 0)), StudyStopped)
        self._found(file, block)
        self.blocks = []

    def _found(self, file: Path, block: Block) -> None:
        self.files[file] = int(block.numbers[0]), int(block.numbers[-1])
        self.done[block.numbers] = True

    def dataset(self, rows: slice = slice(None)) -> xarray.Dataset:
        """The dataset of what is done, all of it or some places along the first dimension."""
        n = next(iter(self.dims.values()))
        start, stop = (k * (len(self.done) // n) for k in rows.indices(n)[:2])
        files = [file for file, (low, high) in self.files.items() if low < stop and high >= start]
        blocks = itertools.chain((block_of(_read_part(file)) for file in files), self.blocks)
        return filled(self.empty, self.dims, joined(np.arange(start, stop), blocks, self.layout.forms), rows)

    def whole(self) -> xarray.Dataset:
        """The dataset as a user gets it: of all samples, with how many have a result."""
        found = restored(self.dataset().assign_attrs(self._attributes()))
        return found.assign_attrs(outcome_of(found[REASON].values))

    def finish(self, path: Path) -> None:
        """Write the dataset to a path; then the parts go."""
        assert self.folder is not None
        made = self.folder / "whole"
        if path.suffix == NETCDF:
            found = self.dataset().assign_attrs(self._attributes())
            content = netcdf(found.assign_attrs(outcome_of(found[REASON].values)))
            write_file(made, lambda file: file.write(content), StudyStopped)
        else:
            shutil.rmtree(made, ignore_errors=True)
            self._write_zarr(made)
        os.sync()
        os.replace(made, path)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _write_zarr(self, made: Path) -> None:
        """The dataset as a folder, written some rows at a time, so that it need not fit into memory."""
        import zarr
        from zarr.codecs import ZstdCodec

        first, n = next(iter(self.dims.items()))
        each = 100 + sum(v.values[:1].nbytes for block in self.blocks for v in block.variables.values())
        step, reasons = max(1, SLAB * n // (len(self.done) * each)), list[Array]()
        for k in range(0, n, step):
            slab = self.dataset(slice(k, k + step))
            reasons.append(slab[REASON].values.ravel())
            if k:
                slab = slab.drop_vars([name for name, x in slab.coords.items() if first not in x.dims])
                slab.to_zarr(made, append_dim=first, consolidated=False)
            else:
                how = {"compressors": ZstdCodec(level=1, checksum=True)}
                slab.to_zarr(made, zarr_format=3, consolidated=False, encoding=dict.fromkeys(slab.variables, how))
        attributes = {**self._attributes(), **outcome_of(np.concatenate(reasons)), FILES: len(list(made.rglob("*")))}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the list of arrays is not in the specification of zarr 3 yet
            zarr.open_group(made).attrs.put(attributes)
            zarr.consolidate_metadata(made)

    def _attributes(self) -> dict[str, Any]:
        layout = {**json.loads(self.empty.attrs[LAYOUT]), "order": list(self.layout.forms)}
        return {**self.empty.attrs, LAYOUT: json.dumps(layout)}


def _read_part(file: Path) -> xarray.Dataset:
    found: xarray.Dataset = xarray_or_error().load_dataset(
        io.BytesIO(zlib.decompress(file.read_bytes())), engine="scipy", decode_times=False
    )
    return found


class Store:
    """Results of n samples, filled block by block, and put together at the end.

    Without a path they are in memory. With one, finished blocks are written about once a second, each time as one new file of
    the folder `<path>.parts`: whole, or not at all. When all samples are done, xarray writes the dataset to the path, and the
    folder is removed. A process that is killed, or a machine without power, loses what was finished since the last writing.

    Args:
        path: Ends in .zarr or .nc; None: in memory.
        samples: The samples.
        attributes: Provenance, which stands in the dataset.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.
        others: A sentence on other versions that computed a part of it; empty where there are none.

    Raises:
        InputError: the path has the store of another study, a damaged one, or something else; or another study fills it now.
    """

    def __init__(self, path: Path | None, samples: Samples, attributes: Mapping[str, Any]) -> None:
        self.path, self.samples, self.others = path, samples, ""
        folder = None if path is None else Path(f"{path}{PARTS}")
        self.parts = Parts(empty_dataset(samples, attributes), Layout(samples.taken), folder)
        self.done = self.parts.done
        self._failed: StudyStopped | None = None
        self._last, self._pause, self._held = time.monotonic() - OFTEN, OFTEN, -1
        if path is not None and path.exists():
            self._check_same(read(path).attrs)
            self.done[:] = True
        elif folder is not None:
            self._open(folder)

    def _open(self, folder: Path) -> None:
        """Take over the parts that are there, or begin."""
        folder.mkdir(exist_ok=True)
        self._held, file = _locked(folder), folder / OF
        try:
            if file.exists():
                self._check_same(_read_part(file).attrs)
                for damaged in self.parts.load():
                    damaged.unlink()
            elif any(folder.iterdir()):
                raise InputError(f"{str(folder)!r:.300} has other files than the parts of a study. Give another path as out=.")
            content = netcdf(self.parts.empty)
            write_file(file, lambda out: out.write(zlib.compress(content, 0)), StudyStopped)
        except (OSError, ValueError, KeyError, TypeError, zlib.error, StudyStopped) as error:
            self._end()
            raise InputError(f"out {str(self.path)!r:.300} cannot be written, or is damaged: {error!s:.300}.") from error
        except BaseException:
            self._end()
            raise

    def _check_same(self, old: Mapping[str, Any]) -> None:
        """Refuse another study; of this one remember what else computed it."""
        new = self.parts.empty.attrs
        check_same(old, new, str(self.path))
        self.others = others_of(old, new)
        self.parts.empty.attrs = continued(old, new)

    def put(self, block: Block) -> None:
        """Keep a finished block; a store on disk writes it within a second, in 5 s where writing takes long, or at the end.

        Raises:
            InputError: a variable that does not agree with that of earlier samples; a study too large for netCDF.
            StudyStopped: it cannot be written.
        """
        self.parts.layout.check(block)
        kept = {name: v for name, v in block.variables.items() if v.values.size}  # no torques of a robot without motors
        size = sum(v.values[:1].nbytes for v in kept.values())
        if self.path is not None and self.path.suffix == NETCDF and size * len(self.done) > LARGEST:
            raise InputError(
                f"{len(self.done):,} samples of {size:,} bytes each are too large for {str(self.path)!r:.200}, which is "
                f"written whole (at most {LARGEST:,} bytes). Give out= a path that ends in .zarr."
            )
        self.parts.blocks.append(replace(block, variables=kept))
        self.done[block.numbers] = True
        self.parts.empty.attrs = finished(self.parts.empty.attrs)
        if time.monotonic() - self._last >= self._pause:
            self.write()

    def write(self) -> None:
        """Write what is not yet written.

        Raises:
            StudyStopped: it cannot be.
        """
        if self.path is None or not self.parts.blocks:
            return
        began = time.monotonic()
        self._tried(self.parts.write)
        self._last = time.monotonic()
        self._pause = min(SELDOM, max(OFTEN, SHARE * (self._last - began)))

    def dataset(self) -> xarray.Dataset:
        """All that is kept; what is not done has `Reason.NOT_RUN`.

        Raises:
            StudyStopped: what is not yet written cannot be written.
        """
        path = self.path
        if path is not None and not path.exists():
            self.write()
            if self.done.all():
                self._tried(lambda: self.parts.finish(path))
        return self.kept()

    def kept(self) -> xarray.Dataset:
        """The same without writing: of a store that cannot be written, what is there."""
        return self.parts.whole() if self.path is None or not self.path.exists() else read(self.path)

    def close(self) -> None:
        """Write what is not yet written, and give the store free; one in which nothing is done is removed."""
        try:
            self.write()
        finally:
            self._end()

    def _end(self) -> None:
        if self._held < 0:
            return
        if self.parts.folder is not None and not self.done.any():
            shutil.rmtree(self.parts.folder, ignore_errors=True)
        os.close(self._held)
        self._held = -1

    def _tried(self, write: Callable[[], None]) -> None:
        if self._failed is not None:
            raise self._failed
        try:
            write()
        except (OSError, StudyStopped) as error:
            cause = error if isinstance(error, OSError) else error.__cause__
            stored = int(np.count_nonzero(self.done)) - sum(len(each.numbers) for each in self.parts.blocks)
            self._failed = StudyStopped(
                f"{str(self.path)!r:.300} cannot be written: {getattr(cause, 'strerror', None) or error}. {stored:,} of "
                f"{len(self.done):,} samples are stored; make room, and the same call goes on from there."
            )
            raise self._failed from error


def _locked(folder: Path) -> int:
    """A folder that this process fills, open; the system gives it free when the process ends, however it does.

    Raises:
        InputError: another study fills it now.
    """
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        raise InputError(
            f"{str(folder)!r:.300} is being filled by another study now. Wait for its end, or give another path as out=."
        ) from None
    except OSError:  # a file system without locks
        pass
    return held


def checked_path(out: object) -> Path | None:
    """The path of a store, after a check that one can be there; None without one.

    Raises:
        InputError: no path that ends in .zarr or .nc; no folder to hold it, no right to write there, a file where a folder must
            be, or the reverse; xarray or zarr are not installed.
    """
    xarray_or_error()
    _import_all()
    if out is None:
        return None
    path = _store_path(out)
    place = Path(os.path.realpath(path))
    if path.suffix == ZARR and place.exists() and not place.is_dir():
        raise InputError(f"out {str(path)!r:.300} is a file; a .zarr is a folder. Give another path, or move it away.")
    if path.suffix == NETCDF or not place.exists():
        check_place(place, what="out")
    return path


@cache
def _import_all() -> None:
    """Make a dataset: xarray imports dask, among others, when the first one is made; it is to fail before work."""
    Store(None, grid(x=[0.0]), {}).dataset()


def is_stored(path: Path) -> bool:
    """Whether a store is there, finished or not."""
    return path.exists() or Path(f"{path}{PARTS}").exists()


def _store_path(given: object) -> Path:
    """A path that ends in .zarr or .nc, "~" resolved, and what it needs.

    Raises:
        InputError: it does not; or zarr is not installed.
    """
    text = os.fspath(given) if isinstance(given, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"out is {given!r:.80}; expected the path of a store, e.g. 'push.zarr'.")
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", text) and not Path(Path(text).parts[0]).is_dir():
        raise InputError(
            f"out is {text!r:.200}, a URL; expected a path in a file system. Give one of this machine, or a mounted one, and "
            "copy the store when the study is done."
        )
    path = Path(os.path.expanduser(text))
    if path.suffix not in (ZARR, NETCDF):
        raise InputError(f"out is {text!r:.200}; expected a path that ends in .zarr, or in .nc for a small study as netCDF.")
    if path.suffix == ZARR:
        zarr_or_error()
    return path


def open_study(path: object) -> xarray.Dataset:
    """The dataset of a stored study, finished or not, as `rbd.study` returns it; nothing is computed.

    A dataset up to 1 GB is read into memory, a larger one as it is used. Samples that are not yet computed have the reason
    "not_run".

    Args:
        path: What was given as `out=`.

    Raises:
        InputError: no store of a study there.

    Example:
        >>> import tempfile
        >>> folder = tempfile.mkdtemp()
        >>> def twice(x):
        ...     return {"twice": 2.0 * x}
        >>> swept = rbd.study(twice, rbd.grid(x=[1.0, 2.0]), executor=0, out=f"{folder}/twice.zarr")
        >>> print(rbd.studies.open_study(f"{folder}/twice.zarr").identical(swept))
        True
    """
    return read(_store_path(path))


def read(path: Path) -> xarray.Dataset:
    """The dataset of a store, finished or not.

    Raises:
        InputError: no store of a study, or a damaged one.
    """
    xarray, folder = xarray_or_error(), Path(f"{path}{PARTS}")
    try:
        if not path.exists() and folder.is_dir():
            found = _read_part(folder / OF)
        elif path.suffix == NETCDF:
            found = xarray.load_dataset(BytesReadOnce(path.read_bytes()), engine="scipy", decode_times=False)
        else:
            format_of(json.loads((path / "zarr.json").read_bytes())["attributes"], str(path))
            found = xarray.open_zarr(path, chunks=None, consolidated=True)
    except InputError:
        raise
    except Exception as error:  # readers can raise any exception on invalid bytes
        raise InputError(
            f"{str(path)!r:.300} is no store of a study, or a damaged one: {error!s:.200}. Give another path, or move it away."
        ) from error
    format_of(found.attrs, str(path))
    try:
        if not path.exists():
            parts = Parts(found, Layout(), folder)
            parts.load()
            return parts.whole()
        if path.suffix == ZARR:
            lacks = found.attrs.pop(FILES) - len(list(path.rglob("*")))
            if lacks:
                raise ValueError(f"{lacks} of its files are missing")
            found = found.load() if found.nbytes <= LOADED else found
        return restored(found)
    except (RuntimeError, ValueError, OSError, KeyError, TypeError) as error:
        raise InputError(f"{str(path)!r:.300} is damaged: {error!s:.200}. Delete it, or give another path.") from error
