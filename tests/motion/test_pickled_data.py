"""Pickles as data: what the commonest tools write is read right; all else is refused by name, and nothing is ever run."""

from __future__ import annotations

import array
import collections
import datetime
import decimal
import fractions
import io
import os
import pickle
import resource
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from rbd.errors import InputError
from rbd.motion.pickled_data import unpickled

RNG = np.random.default_rng(3)
DATA = {
    "root_pos": RNG.normal(size=(7, 3)).astype(np.float32),
    "root_rot": RNG.normal(size=(7, 4)),
    "dof_pos": np.asfortranarray(RNG.normal(size=(7, 29))),
    "fps": 30.0,
    "count": np.int64(30),
    "share": np.float32(2.5),
    "flag": True,
    "nothing": None,
    "names": np.array(["left_hip", "right_hip"]),
    "none": np.array(None, dtype=object),
    "big": np.arange(4, dtype=">i4"),
    "bools": np.array([True, False]),
    "scalar": np.array(30),
    "empty": np.empty((0, 3)),
    "list": [1, 2.5, "x", (1, 2), -(2**40)],
}
DATA["twice"] = DATA["root_pos"]


def same(x: object, y: object) -> bool:
    """Whether values, and types of arrays, are those written."""
    if isinstance(x, np.ndarray) and x.dtype == object:
        return y is None
    if isinstance(x, np.ndarray):
        return isinstance(y, np.ndarray) and x.shape == y.shape and bool((x == y).all()) and x.dtype.kind == y.dtype.kind
    if isinstance(x, dict):
        return isinstance(y, dict) and x.keys() == y.keys() and all(same(x[k], y[k]) for k in x)
    return bool(x == y)


def joblib_bytes(arrays: dict[str, np.ndarray], align: bool) -> bytes:
    """A dict of arrays as joblib writes it: each wrapper's state, then the array's bytes, aligned to 16 bytes or not."""
    names = [name for name in sorted(arrays)]
    out = io.BytesIO(b"\x80\x03}")
    out.seek(0, 2)
    for name in names:
        x = arrays[name]
        state = {"subclass": np.ndarray, "shape": x.shape, "order": "C", "dtype": x.dtype, "allow_mmap": True}
        state |= {"numpy_array_alignment_bytes": 16} if align else {}
        out.write(pickle.dumps(name, 3)[2:-1].split(b"q\x00")[0] + b"cjoblib.numpy_pickle\nNumpyArrayWrapper\n)\x81")
        inner = pickle.Pickler(out, 3)
        inner.fast = True
        at = out.tell()
        inner.dump(state)
        whole = out.getvalue()
        out.seek(at)
        out.truncate()
        out.write(whole[at + 2 : -1] + b"b")
        if align:
            padding = 16 - (out.tell() + 1) % 16
            out.write(bytes([padding]) + b"\xff" * padding)
        out.write(np.ascontiguousarray(x).tobytes() + b"s")
    out.write(b".")
    return out.getvalue()


@pytest.mark.parametrize("protocol", range(6))
def test_each_protocol_gives_what_was_written(protocol):
    """Dicts, lists, tuples, strings, numbers and arrays of all kinds, to the last bit."""
    assert same(DATA, unpickled(pickle.dumps(DATA, protocol), "x.pkl"))


@pytest.mark.parametrize("align", [False, True])
def test_arrays_of_joblib_follow_inside_the_stream(align):
    """With padding and without; compressed as a whole or not."""
    arrays = {name: DATA[name] for name in ("root_pos", "root_rot", "big")}
    data = joblib_bytes(arrays, align)
    assert same(arrays, unpickled(data, "x.pkl")) and same(arrays, unpickled(zlib.compress(data), "x.pkl"))


def test_it_is_what_joblib_writes(tmp_path):
    """Where joblib is installed: its own files, with each of its compressions."""
    joblib = pytest.importorskip("joblib")
    held = {"walk": {name: x for name, x in DATA.items() if name != "none"}}
    for kind in (0, 3, ("gzip", 3), ("bz2", 3), ("xz", 3), ("lzma", 3)):
        joblib.dump(held, tmp_path / "x.pkl", compress=kind)
        assert same(held, unpickled((tmp_path / "x.pkl").read_bytes(), "x.pkl"))


class Call:
    """A pickle of it calls a function when it is loaded."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


CANARY = Path(os.environ.get("TMPDIR", "/tmp")) / f"pickle_canary_{os.getpid()}"


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (Call(os.system, f"touch {CANARY}"), "(posix|nt).system"),
        (Call(eval, f"open({str(CANARY)!r}, 'w')"), "built.*.eval"),
        (Call(getattr, os, "system"), "built.*.getattr"),
        (Call(open, str(CANARY), "w"), "io.open"),
        (Call(np.load, "x.npy"), "numpy.load"),
        (datetime.date(2026, 1, 1), "datetime.date"),
        (decimal.Decimal(1), "decimal.Decimal"),
        (fractions.Fraction(1, 3), "fractions.Fraction"),
        (collections.Counter("aab"), "collections.Counter"),
        (array.array("d", [1.0]), "array.(_array_reconstructor|array)"),
        ({1, 2}, "set|built.*.set"),
        (3 + 4j, "built.*.complex"),
        (np.zeros(2, dtype="f4,f4"), "an array of"),
        (np.zeros(2, dtype=complex), "an array of"),
        (np.array(["2026-01-01"], dtype="M8[D]"), "an array of"),
        (Path("x"), "pathlib"),
        (len, "built.*.len"),
        ({(1, 2): 3}, "tuple as a key"),
        (2**70, "more than 64 bits"),
        (np.random.default_rng(0), "numpy.random"),
    ],
)
def test_all_else_is_refused_by_its_name(value, named):
    """In each protocol that can write it, and nothing of it is run."""
    for protocol in range(6):
        try:
            data = pickle.dumps({"q": [value]}, protocol)
        except TypeError:
            continue
        with pytest.raises(InputError, match=rf"x\.pkl (is a pickle that holds .*({named})|is no pickle)"):
            unpickled(data, "x.pkl")
    assert not CANARY.exists()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b".",
        b"\x80\x04",
        b"\x80\x04]\x94q.",
        b"\x80\x04" + b"\x85" * 100_000 + b".",
        b"\x80\x04N" + b"\x85" * 100_000 + b"N\x8c\x01as.",
        b"\x80\x04}N" + b"\x85" * 100_000 + b"Ns.",
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x7f.",
        b"\x80\x04B\xff\xff\xff\x7f.",
        b"\x80\x04\x8b\xff\xff\xff\x7f1.",
        b"\x80\x04(" + b"2" * 50,
        b"I" + b"9" * 10_000 + b"\n.",
        zlib.compress(b"0" * 50_000_000),
        zlib.compress(b"0" * 1000)[:-3],
    ],
)
def test_odd_bytes_are_refused_fast(data):
    """Cut short, deep, long on paper, an index of four thousand millions, a bomb."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError):
        unpickled(data, "x.pkl")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def test_an_index_of_four_thousand_millions_takes_no_memory():
    """What the memory of a pickle is asked to hold is held by its key, not in a list as long."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert unpickled(b"\x80\x04]r\xff\xff\xff\xff.", "x.pkl") == []
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def test_five_thousand_broken_pickles_are_refused_or_read():
    """Bytes changed, left out, doubled, exchanged between files: no other error, no file written, no memory, no waiting."""
    calls = [Call(os.system, f"touch {CANARY}"), Call(eval, f"open({str(CANARY)!r}, 'w')")]
    small = {name: DATA[name] for name in ("root_pos", "fps", "list", "names", "twice")}
    seeds = [pickle.dumps(each, protocol) for protocol in range(6) for each in (small, {"a": small, "b": calls[0]}, calls)]
    seeds += [joblib_bytes({"root_pos": DATA["root_pos"], "big": DATA["big"]}, align) for align in (False, True)]
    rng, read, before = np.random.default_rng(1), 0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    for i in range(5000):
        data = bytearray(seeds[i % len(seeds)])
        for _ in range(rng.integers(1, 4)):
            at, n = int(rng.integers(len(data))), int(rng.integers(1, 12))
            other = seeds[int(rng.integers(len(seeds)))]
            there = int(rng.integers(len(other)))
            what = rng.integers(4)
            new = [bytes(rng.integers(0, 256, 1, dtype=np.uint8)), b"", bytes(data[at : at + n]) * 2, other[there : there + n]]
            data[at : at + (1 if what == 0 else n)] = new[what]
            data = data or bytearray(b".")
        try:
            unpickled(bytes(data), "x.pkl")
            read += 1
        except InputError as error:
            assert str(error).startswith("x.pkl") and len(str(error)) < 1000
    assert not CANARY.exists() and 0 < read < 3000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000
    assert time.perf_counter() - start < 120.0
