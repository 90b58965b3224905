"""`Store`: the results of a study while they come in, in memory or on disk; and the dataset of a study that was stored."""

from __future__ import annotations

import fcntl
import itertools
import json
import math
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, StudyStopped
from rbd.errors.reasons import Reason
from rbd.model.output_files import check_place
from rbd.modules import of_extra, xarray_or_error
from rbd.records import Variable
from rbd.studies.provenance import check_format, continued, now, storable
from rbd.studies.results import REASON, Block, Layout, joined, labelled
from rbd.studies.samples import ONE, OWN, RESERVED, Samples

if TYPE_CHECKING:
    import xarray

ZARR, PARTS, PART, OF = ".zarr", ".parts", ".part", "study"
"""Endings of a store, of the folder with its parts and of its files, and the file with its samples and attributes."""
FILES = "rbd_files"
"""Attribute of a store: how many files it has, as zarr reads a missing one as missing values."""
ORDER = "rbd_order"
"""Attribute of a store: its variables in order, as zarr sorts them by name."""
OFTEN, SELDOM, SHARE = 1.0, 5.0, 20.0
"""The shortest and the longest time between two writings [s]; between them it is so many times as long as a writing takes."""
DIMS = "rbd_dims"
"""Attribute of the samples of a study: their dimensions, as JSON."""
LOADED = 1_000_000_000
"""Datasets up to so many bytes are read into memory, larger ones as they are used."""
QUIETLY = partial(warnings.catch_warnings, action="ignore")
"""Without zarr's warnings of what is not in the specification of its format 3 yet: text, the list of arrays."""
SLAB = 100_000_000
"""Bytes of the results that are in memory at once while a finished store is written."""


def filled(
    coords: Mapping[str, Any], dims: Mapping[str, int], attributes: Mapping[str, Any], variables: Mapping[str, Variable]
) -> xarray.Dataset:
    """What is kept, over the dimensions of the samples.

    Args:
        coords: Coordinates of the samples.
        dims: {dimension of the samples: its length}.
        attributes: Of the dataset.
        variables: Results of all samples.
    """
    labels = {dim: ((dim,), _stored(np.asarray(x))) for v in variables.values() for dim, x in v.labels.items()}
    values = {
        name: ((*dims, *v.dims), v.values.reshape(*dims.values(), *v.values.shape[1:]), v.attributes)
        for name, v in variables.items()
    }
    return xarray_or_error().Dataset(values, {**coords, **labels}, attributes)


def with_texts(found: xarray.Dataset) -> xarray.Dataset:
    """A dataset with `reason_text` after `reason`: the reason of each sample in words, empty where there is a result.

    It is made of the codes, in memory or as they are read, and is not stored.
    """
    codes = found[REASON].variable
    known = dict(zip(np.atleast_1d(codes.attrs["flag_values"]).tolist(), codes.attrs["flag_meanings"].split(), strict=True))
    known |= {reason.code: str(reason) for reason in Reason}

    def texts(some: Array) -> Array:
        numbers, where = np.unique(some, return_inverse=True)
        return np.array([known.get(number, str(number)) for number in numbers.tolist()], object)[where].reshape(some.shape)

    text = RESERVED[-1]
    values = texts(codes.values) if codes._in_memory else _lazily(codes, texts)
    whole = found.assign({text: (codes.dims, values, {"long_name": "why there is none, in words"})})
    own = [*OWN[:2], text, *OWN[2:]]
    return whole[[*own, *(name for name in found.data_vars if name not in own)]]


def _lazily(codes: xarray.Variable, texts: Callable[[Array], Array]) -> Any:
    """What is made of an array as parts of it are read."""
    from xarray.backends import BackendArray
    from xarray.core import indexing

    class Texts(BackendArray):
        shape, dtype = codes.shape, np.dtype(object)

        def __getitem__(self, key: Any) -> Any:
            outer = indexing.IndexingSupport.OUTER
            return indexing.explicit_indexing_adapter(key, self.shape, outer, lambda some: texts(codes[some].values))

    return indexing.LazilyIndexedArray(Texts())


def outcome_of(reason: Array) -> dict[str, str]:
    """`summary`, how many samples have a result, from the codes of all; and `interrupted` where some were not computed."""
    codes, counts = np.unique(reason, return_counts=True)
    found = dict(zip(codes.tolist(), counts.tolist(), strict=True))
    n, not_run, good = reason.size, found.pop(Reason.NOT_RUN.code, 0), found.pop(Reason.NONE.code, 0)
    failed = sorted(found.items(), key=lambda pair: (-pair[1], pair[0]))
    parts = [f"{good:,} ok", *(f"{count:,} {Reason.of_code(code)}" for code, count in failed)]
    parts += [f"{not_run:,} not run"] if not_run else []
    told = {"summary": f"{n:,} sample{'s' if n > 1 else ''}: {'; '.join(parts)}"}
    return told | ({"interrupted": f"{n - not_run:,} of {n:,} samples are done"} if not_run else {})


def _write(file: Path, dataset: xarray.Dataset) -> None:
    """Write a dataset as one file, a zip of zarr's: whole, or not at all."""
    import zarr

    made = file.with_name(f".{file.name}")
    with QUIETLY(), zarr.storage.ZipStore(made, mode="w") as store:
        dataset.assign_attrs({ORDER: list(dataset.variables)}).to_zarr(store, zarr_format=3, consolidated=False)
    with open(made, "rb") as written:
        os.fsync(written.fileno())
    os.replace(made, file)


def _read(file: Path) -> xarray.Dataset:
    import zarr

    with zarr.storage.ZipStore(file, mode="r") as store:
        return _opened(store, consolidated=False).load()


def _opened(store: Any, *, consolidated: bool) -> xarray.Dataset:
    """A dataset of zarr, as it was in memory; dates in seconds or finer, as those in nanoseconds end in 2262."""
    times = {"decode_times": xarray_or_error().coders.CFDatetimeCoder(time_unit="s"), "decode_timedelta": True}
    read: xarray.Dataset = xarray_or_error().open_zarr(store, chunks=None, consolidated=consolidated, **times)
    found = {name: read.variables[name] for name in read.attrs.pop(ORDER)}
    values = {k: (x.dims, x.values.astype(object), x.attrs) if x.dtype.kind in "UT" else x for k, x in found.items()}
    return read.drop_vars(found).assign(values).set_coords(list(read.coords)).drop_encoding()


class Store:
    """Results of n samples, filled block by block, and put together at the end.

    Without a path they are in memory. With one, finished blocks are written about once a second, each time as one new file of
    the folder `<path>.parts`: whole, or not at all. When all samples are done, xarray writes the dataset to the path, and the
    folder is removed. A process that is killed, or a machine without power, loses what was finished since the last writing.

    Args:
        path: Ends in .zarr; None: in memory.
        samples: The samples.
        attributes: Provenance, which stands in the dataset.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.

    Raises:
        InputError: the path has the store of another study, a damaged one, or something else; or another study fills it now.
    """

    path: Path | None
    folder: Path | None
    attributes: dict[str, Any]
    done: Array

    def __init__(self, path: Path | None, samples: Samples, attributes: Mapping[str, Any]) -> None:
        coords = {name: (dims, _stored(x), attrs) for name, (dims, x, attrs) in samples.coords().items()}
        self._begin(path, coords, samples.dims, attributes)
        folder = self.folder
        if path is not None and path.exists():
            self.attributes = continued(read(path).attrs, self.attributes, str(path))
            self.done[:] = True
        elif folder is not None:
            folder.mkdir(exist_ok=True)
            self._held = _locked(folder)
            try:
                if (folder / OF).exists():
                    self.attributes = continued(_read(folder / OF).attrs, self.attributes, str(path))
                    for damaged in self.load():
                        damaged.unlink()
                elif any(folder.iterdir()):
                    raise InputError(
                        f"{str(folder)!r:.300} has other files than the parts of a study. Give another path as out=."
                    )
                _write(folder / OF, filled(coords, self.dims, {**self.attributes, DIMS: json.dumps(self.dims)}, {}))
            except BaseException as error:
                self._end()
                if isinstance(error, InputError) or not isinstance(error, Exception):
                    raise
                raise InputError(f"out {str(path)!r:.300} cannot be written, or is damaged: {error!s:.300}.") from error

    def _begin(
        self, path: Path | None, coords: Mapping[str, Any], dims: Mapping[str, int], attributes: Mapping[str, Any]
    ) -> None:
        self.path, self.coords, self.dims, self.attributes = path, coords, dict(dims), dict(attributes)
        self.done, self.blocks = np.zeros(math.prod(dims.values()), bool), list[Block]()
        self.layout = Layout({*coords, *(dim for x in coords.values() for dim in x[0])})
        self.folder = None if path is None else Path(f"{path}{PARTS}")
        self.files, self._held = dict[Path, tuple[int, int]](), -1
        self._failed: StudyStopped | None = None
        self._last, self._pause = time.monotonic() - OFTEN, OFTEN

    def load(self) -> list[Path]:
        """Find the files of the folder; those that cannot be read are returned."""
        damaged = []
        for file in sorted(self.folder.glob(f"[!.]*{PART}")) if self.folder else ():
            try:
                block = _block_in(file)
                self.layout.add(block, "the store")
                self._found(file, block)
            except Exception:  # whatever a damaged file makes zarr raise
                damaged.append(file)
        return damaged

    def _found(self, file: Path, block: Block) -> None:
        self.files[file] = int(block.numbers[0]), int(block.numbers[-1])
        self.done[block.numbers] = True

    def put(self, block: Block) -> None:
        """Keep a finished block; a store on disk writes it within a second, in 5 s where writing takes long, or at the end.

        Raises:
            InputError: a variable that does not agree with that of earlier samples.
            StudyStopped: it cannot be written.
        """
        self.layout.add(block)
        some = {name: v for name, v in block.variables.items() if v.values.size}  # no torques of a robot without motors
        self.blocks.append(replace(block, variables=some))
        self.done[block.numbers] = True
        self.attributes["finished"] = now()
        if time.monotonic() - self._last >= self._pause:
            self.write()

    def write(self) -> None:
        """Write what is not yet written, as one file.

        Raises:
            StudyStopped: it cannot be.
        """
        if self.folder is None or not self.blocks:
            return
        began = time.monotonic()
        numbers = np.unique(np.concatenate([each.numbers for each in self.blocks]))  # batches computed again overlap
        block = joined(numbers, self.blocks, self.layout.forms)
        file = self.folder / f"{len(self.files):06}-{time.time_ns():x}{PART}"
        with self._tried():
            _write(file, filled({ONE: numbers}, {ONE: len(numbers)}, {}, block.variables))
        self._found(file, block)
        self.blocks, self._last = [], time.monotonic()
        self._pause = min(SELDOM, max(OFTEN, SHARE * (self._last - began)))

    @contextmanager
    def _tried(self) -> Iterator[None]:
        if self._failed is not None:
            raise self._failed
        try:
            yield
        except OSError as error:
            stored = int(np.count_nonzero(self.done)) - sum(len(each.numbers) for each in self.blocks)
            self._failed = StudyStopped(
                f"{str(self.path)!r:.300} cannot be written: {error.strerror or error}. {stored:,} of {len(self.done):,} "
                "samples are stored; make room, and the same call goes on from there."
            )
            raise self._failed from error

    def dataset(self) -> xarray.Dataset:
        """All that is kept; what is not done has `Reason.NOT_RUN`.

        Raises:
            StudyStopped: what is not yet written cannot be written.
        """
        if self.path is not None and not self.path.exists():
            self.write()
            if self.done.all():
                with self._tried():
                    self._finish(self.path)
        return self.kept()

    def kept(self) -> xarray.Dataset:
        """The same without writing: of a store that cannot be written, what is there."""
        if self.path is not None and self.path.exists():
            return read(self.path)
        found = self._rows(0, next(iter(self.dims.values())))
        return with_texts(found.assign_attrs(outcome_of(found[REASON].values)))

    def _rows(self, start: int, stop: int) -> xarray.Dataset:
        """The dataset of some places along the first dimension."""
        first, n = next(iter(self.dims.items()))
        low, high = start * (len(self.done) // n), stop * (len(self.done) // n)
        files = [file for file, (a, b) in self.files.items() if a < high and b >= low]
        block = joined(np.arange(low, high), itertools.chain(map(_block_in, files), self.blocks), self.layout.forms)
        coords = {name: (x[0], x[1][start:stop], x[2]) if first in x[0][:1] else x for name, x in self.coords.items()}
        return filled(coords, {**self.dims, first: stop - start}, self.attributes, block.variables)

    def _finish(self, path: Path) -> None:
        """Write the dataset to the path, some rows at a time, so that it need not fit into memory; then the parts go."""
        import zarr
        from zarr.codecs import ZstdCodec

        assert self.folder is not None
        made, (first, n) = self.folder / "whole", next(iter(self.dims.items()))
        shutil.rmtree(made, ignore_errors=True)
        each = 100 + sum(v.values[:1].nbytes for v in self.layout.forms.values())
        step, reasons = max(1, SLAB * n // (len(self.done) * each)), list[Array]()
        with QUIETLY():
            for k in range(0, n, step):
                slab = self._rows(k, min(k + step, n))
                reasons.append(slab[REASON].values.ravel())
                how: dict[str, Any] = {"append_dim": first}
                if not k:
                    codecs = {"compressors": ZstdCodec(level=1, checksum=True)}
                    how = {"zarr_format": 3, "encoding": dict.fromkeys(slab.variables, codecs)}
                fixed = [name for name, x in slab.coords.items() if k and first not in x.dims]
                slab.drop_vars(fixed).to_zarr(made, consolidated=False, **how)
            outcome = outcome_of(np.concatenate(reasons))
            zarr.open_group(made).attrs.update(
                {**outcome, FILES: len(list(made.rglob("*"))), ORDER: list(map(str, slab.variables))}
            )
            zarr.consolidate_metadata(made)
        os.sync()
        os.replace(made, path)
        shutil.rmtree(self.folder, ignore_errors=True)

    def close(self) -> None:
        """Write what is not yet written, and give the store free; one in which nothing is done is removed."""
        try:
            self.write()
        finally:
            self._end()

    def _end(self) -> None:
        if self._held >= 0:
            if self.folder is not None and not self.done.any():
                shutil.rmtree(self.folder, ignore_errors=True)
            os.close(self._held)
            self._held = -1


def _stored(values: Array) -> Array:
    """Values as xarray has them in memory, and zarr on disk: dates in seconds, text as objects, which has any length."""
    if values.dtype.kind in "mM" and np.datetime_data(values.dtype)[0] in ("Y", "M", "W", "D", "h", "m"):
        return values.astype(f"{values.dtype.kind}8[s]")
    if values.dtype.kind not in "OUT":
        return values
    found = values.astype(object)
    found.ravel()[:] = [storable(x) if isinstance(x, str) else x for x in found.flat]
    return found


def _block_in(file: Path) -> Block:
    """The block of a part."""
    dataset = _read(file)
    return Block(dataset[ONE].values, {str(name): labelled(x, x.values, 1) for name, x in dataset.data_vars.items()})


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
        InputError: no path that ends in .zarr; a file; no folder to hold it, no right to write there; xarray or zarr are not
            installed.
    """
    xarray_or_error().Dataset()
    if out is None:
        return None
    path = _store_path(out)
    place = Path(os.path.realpath(path))
    if place.is_file():
        raise InputError(f"out {str(path)!r:.300} is a file; a .zarr is a folder. Give another path, or move it away.")
    if not place.exists():
        check_place(place, what="out")
    return path


def is_stored(path: Path) -> bool:
    """Whether a store is there, finished or not."""
    return path.exists() or Path(f"{path}{PARTS}").exists()


def _store_path(given: object) -> Path:
    """A path that ends in .zarr, "~" resolved, and what it needs.

    Raises:
        InputError: it does not; or zarr is not installed.
    """
    text = os.fspath(given) if isinstance(given, str | os.PathLike) else ""
    if not isinstance(text, str) or not text or "\0" in text or "://" in text:
        raise InputError(f"out is {given!r:.200}; expected the path of a store in a file system, e.g. 'push.zarr'; no URL.")
    path = Path(os.path.expanduser(text))
    if path.suffix != ZARR:
        raise InputError(
            f"out is {text!r:.200}; expected a path that ends in .zarr. The dataset that rbd.study returns is written in other "
            "formats by xarray: dataset.to_netcdf('push.nc')."
        )
    of_extra("zarr", "study")
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
    folder, known = Path(f"{path}{PARTS}"), False
    try:
        if not path.exists() and folder.is_dir():
            begun = _read(folder / OF)
            check_format(begun.attrs, str(path))
            store, coords = Store.__new__(Store), {str(name): (x.dims, x.values, x.attrs) for name, x in begun.coords.items()}
            store._begin(path, coords, json.loads(begun.attrs.pop(DIMS)), begun.attrs)
            store.load()
            return store.kept()
        attributes = json.loads((path / "zarr.json").read_bytes())["attributes"]
        check_format(attributes, str(path))
        known = FILES in attributes
        if not known:
            raise ValueError("it was written by xarray, which reads it, and is no store that rbd.study wrote as out=")
        found = _opened(path, consolidated=True)
        if not set(OWN) <= set(found.data_vars):
            raise ValueError(f"it lacks {', '.join(OWN)}")
        if lacks := found.attrs.pop(FILES) - len(list(path.rglob("*"))):
            raise ValueError(f"{lacks} of its files are missing")
        return with_texts(found.load() if found.nbytes <= LOADED else found)
    except InputError:
        raise
    except Exception as error:  # readers can raise any exception on invalid bytes
        told = "is damaged" if known else "is no store of a study, or a damaged one"
        raise InputError(f"{str(path)!r:.300} {told}: {error!s:.200}. Delete it, or give another path.") from error
