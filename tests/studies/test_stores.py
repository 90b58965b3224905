"""Stores of studies: what is in them is the dataset, in the same form from memory and from zarr."""

from __future__ import annotations

import errno
import itertools
import json
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import rbd
from rbd.errors import InputError, Reason, StudyStopped, StudyWarning
from rbd.records import Variable
from rbd.studies import open_study, stores
from rbd.studies.provenance import SAME
from rbd.studies.results import Block, own_variables
from rbd.studies.stores import Store

OTHER = ("command", "started", "finished")
"""Attributes that differ from run to run."""


def held(friction: float, push: float) -> float:
    """What fails by the reason "cannot_hold: friction", and what fails for a reason of its own."""
    if push > 1.0:
        raise ValueError("too much")
    if friction < 0.5:
        raise rbd.CannotHold("it slips", reason=Reason.CANNOT_HOLD_FRICTION)
    return friction


def test_the_reason_is_in_words_beside_its_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In memory, from a store, and of a store that is read as it is used, also in part; it is not stored."""
    told = [["cannot_hold: friction", "other_error"], ["", "other_error"]]
    found = rbd.study(held, rbd.grid(friction=[0.1, 0.9], push=[0.0, 2.0]), executor=0, out=tmp_path / "held.zarr")
    assert list(found.data_vars)[:4] == ["ok", "reason", "reason_text", "message"]
    assert found.reason_text.values.tolist() == told and not (tmp_path / "held.zarr" / "reason_text").exists()
    assert [[str(Reason.of_code(code)) for code in row] for row in found.reason.values] == told
    assert open_study(tmp_path / "held.zarr").identical(found)
    monkeypatch.setattr(stores, "LOADED", 10)
    lazy = open_study(tmp_path / "held.zarr")
    assert not lazy.reason_text.variable._in_memory
    assert lazy.reason_text.sel(friction=0.1).isel(push=[1, 0]).values.tolist() == told[0][::-1]
    assert lazy.identical(found)


def mixed(a: float, b: float) -> dict[str, Any]:
    """Numbers, arrays with labels, truth values and text; a variable that only some samples have; errors."""
    if a + b > 3:
        raise ValueError("too much: é")
    found: dict[str, Any] = {"total": a + b, "vector": np.array([a, b, 1.0]), "text": f"a is {a:g}", "more": bool(a > b)}
    found["labelled"] = xr.DataArray([a, b], dims="part", coords={"part": ["first", "second"]}, attrs={"units": "m"})
    return found | ({"late": 1.0} if a > 1 else {})


ATTRIBUTES = {"format": "rbd study 2", **dict.fromkeys((*SAME, "versions", "machine", "command", "started"), "")}
GRID = {"a": np.arange(4.0), "b": [0.0, 1.0, 2.0]}


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    """Bit for bit, with attributes and types."""
    one, other = (
        x.drop_attrs(deep=False).assign_attrs({k: v for k, v in x.attrs.items() if k not in OTHER}) for x in (one, other)
    )
    xr.testing.assert_identical(one, other)
    assert {n: x.dtype for n, x in one.variables.items()} == {n: x.dtype for n, x in other.variables.items()}


def test_a_stored_study_is_the_one_in_memory(tmp_path: Path):
    """Bit for bit, at once and when it is opened later; a second call computes nothing."""
    path = tmp_path / "push.zarr"
    stored = rbd.study(mixed, rbd.grid(**GRID), executor=0, out=path, chunk=5)
    assert_same(stored, rbd.study(mixed, rbd.grid(**GRID), executor=0))
    xr.testing.assert_identical(stored, open_study(path))
    xr.testing.assert_identical(stored, rbd.study(mixed, rbd.grid(**GRID), executor=0, out=path))
    assert stored.total.dims == ("a", "b") and stored.labelled.sel(a=2, b=1, part="second") == 1.0
    assert (
        stored.attrs["summary"] == "12 samples: 9 ok; 3 other_error"
        and stored.message.sel(a=3, b=1) == "ValueError: too much: é"
    )


def test_actuations_are_stored_with_their_labels(tmp_path: Path):
    """Motors and rows of forces by name, status with its codes."""
    box = rbd.testing.box()
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5)

    def held(force: float) -> rbd.Actuation:
        return rbd.hold(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [floor], external=rbd.ExternalForce("box", (force, 0, 0)))

    found = rbd.study(held, rbd.grid(force=[0.0, 40.0, 80.0]), executor=0, out=tmp_path / "push.zarr")
    assert_same(found, rbd.study(held, rbd.grid(force=[0.0, 40.0, 80.0]), executor=0))
    assert found.force_floor.sel(force=40, floor_row="fx") == pytest.approx(-40) and not found.ok.sel(force=80)


def test_a_table_is_stored_with_its_columns(tmp_path: Path):
    """Text, numbers and truth values over `sample`; xarray reads the store alone, without a warning."""
    rows = [{"name": "left", "x": 1.5, "k": 2, "up": True}, {"name": "right foot", "x": 2.0, "k": 3, "up": False}]

    def f(name: str, x: float, k: int, up: bool) -> float:
        return len(name) + x + k + up

    stored = rbd.study(f, rows, executor=0, out=tmp_path / "table.zarr")
    assert_same(stored, rbd.study(f, rows, executor=0))
    alone = xr.open_zarr(tmp_path / "table.zarr")
    assert sorted(map(str, alone.coords)) == ["k", "name", "sample", "up", "x"] and alone.value.values.tolist() == [8.5, 15.0]
    assert alone.name.values.tolist() == ["left", "right foot"]


def test_users_write_the_dataset_as_they_like(tmp_path: Path):
    """`to_netcdf` and `to_zarr` take it, and give the same values back."""
    for found in (rbd.study(mixed, rbd.grid(**GRID), executor=0, out=out) for out in (None, tmp_path / "push.zarr")):
        found.to_netcdf(tmp_path / "own.nc", engine="scipy")
        found.to_zarr(tmp_path / "own.zarr", mode="w", consolidated=False)
        for again in (
            xr.load_dataset(tmp_path / "own.nc", engine="scipy"),
            xr.open_zarr(tmp_path / "own.zarr", consolidated=False),
        ):
            assert again.vector.identical(found.vector) and again.message.values.tolist() == found.message.values.tolist()
            assert again.ok.values.tolist() == found.ok.values.tolist()


def test_an_unfinished_store_can_be_read(tmp_path: Path):
    """What is not done has the reason not_run; also of a store without any result."""
    samples = rbd.grid(**GRID)
    attributes = {"format": "rbd study 2", "versions": "", "title": "push"}
    store = Store(tmp_path / "part.zarr", samples, attributes)
    empty = open_study(tmp_path / "part.zarr")
    assert empty.attrs["interrupted"] == "0 of 12 samples are done" and (empty.reason == Reason.NOT_RUN.code).all()
    store.put(block(3, 7))
    assert store.dataset().attrs["interrupted"] == "4 of 12 samples are done"
    store.close()
    part = open_study(tmp_path / "part.zarr")
    assert part.value.values.ravel()[3:7].tolist() == [3, 4, 5, 6] and np.isnan(part.value.values.ravel()[[2, 7]]).all()
    assert part.reason.values.ravel().tolist() == [99] * 3 + [0] * 4 + [99] * 5
    assert part.value.dims == ("a", "b")


def block(start: int, stop: int, **more: Any) -> Block:
    """Results of some samples: their numbers."""
    n = stop - start
    values = {"value": np.arange(start, stop, dtype=float), **more}
    variables = {name: Variable(x, tuple(f"{name}_{i}" for i in range(x.ndim - 1))) for name, x in values.items()}
    own = own_variables(n)
    own["ok"].values[:], own["reason"].values[:] = True, 0
    return Block(np.arange(start, stop), own | variables)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each block is written as it comes."""
    monkeypatch.setattr(stores, "OFTEN", 0.0)
    monkeypatch.setattr(stores, "SELDOM", 0.0)


def test_blocks_of_any_size_in_any_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: None):
    """Blocks end anywhere, and each is written at once; the whole is written a row of the grid at a time."""
    monkeypatch.setattr(stores, "SLAB", 1)
    rng = np.random.default_rng(0)
    for trial in range(2):
        samples = rbd.grid(**{"a": np.arange(3.0), "b": np.arange(20.0)})
        store = Store(tmp_path / f"{trial}.zarr", samples, {"format": "rbd study 2", "versions": ""})
        cuts = [0, *sorted(rng.choice(np.arange(1, 60), 9, replace=False)), 60]
        spans = list(itertools.pairwise(int(c) for c in cuts))
        rng.shuffle(spans)
        for a, b in spans:
            store.put(block(a, b, **({"late": np.ones((b - a, 2))} if 30 <= a < 50 else {})))
        found = store.dataset()
        store.close()
        assert found.value.values.ravel().tolist() == list(range(60)) and found.ok.all()
        late = np.concatenate([np.full(b - a, 30 <= a < 50) for a, b in sorted(spans)])
        if late.any():
            assert (np.isnan(found.late.values.reshape(60, 2)[:, 0]) == ~late).all()


class FillsDisk:
    """A function after whose sixth call no file can be written."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch | None = None) -> None:
        self.calls: list[float] = []
        self.monkeypatch = monkeypatch

    def __reduce__(self) -> tuple[Any, ...]:
        """Its calls are no part of what it computes."""
        return FillsDisk, ()

    def __call__(self, x: float) -> float:
        """Twice the argument."""
        self.calls.append(x)
        if len(self.calls) == 6 and self.monkeypatch is not None:
            self.monkeypatch.setattr(stores, "_write", full)
        return 2 * x


def full(path: Path, dataset: xr.Dataset) -> None:
    """Writes nothing: the disk is full."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_ends_a_study_with_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: None):
    """It says so, carries the dataset of what is stored, and the same call goes on."""
    real, path = stores._write, tmp_path / "push.zarr"
    f = FillsDisk(monkeypatch)
    samples = rbd.grid(x=np.arange(10.0))
    with pytest.raises(
        StudyStopped, match=r"cannot be written: No space left on device.*make room, and the same call"
    ) as raised:
        rbd.study(f, samples, executor=0, out=path, chunk=1)
    assert raised.value.reason is Reason.STUDY_STOPPED
    kept = raised.value.dataset
    assert kept.attrs["interrupted"].startswith("6 of 10")
    assert kept.value.values[:5].tolist() == [0, 2, 4, 6, 8]
    monkeypatch.setattr(stores, "_write", real)
    f.calls[:] = [0.0] * 10
    again = rbd.study(f, samples, executor=0, out=path)
    assert again.ok.all() and f.calls[10:] == [5, 6, 7, 8, 9] and "interrupted" not in again.attrs


def test_results_that_change_shape_end_a_study_and_keep_what_is_done(tmp_path: Path):
    """The variable, both shapes and the sample are named."""

    def f(x: float) -> dict[str, Any]:
        return {"path": np.zeros(3 if x < 4 else 2)}

    with pytest.raises(InputError, match=r"'path' has the shape \(2,\) in sample.* 4.*\(3,\) in sample.* 0"):
        rbd.study(f, rbd.grid(x=np.arange(6.0)), executor=0, out=tmp_path / "path.zarr", chunk=2)
    assert open_study(tmp_path / "path.zarr").attrs["interrupted"] == "4 of 6 samples are done"


def test_a_study_without_any_result_leaves_no_store(tmp_path: Path):
    """A name in `keep` that no result has ends it at the first sample."""
    with pytest.raises(InputError, match="forcs"):
        rbd.study(mixed, rbd.grid(**GRID), executor=0, keep=("forcs",), out=tmp_path / "none.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("push.txt", r"expected a path that ends in \.zarr"),
        ("push.nc", r"written in other formats by xarray: dataset\.to_netcdf"),
        ("s3://bucket/push.zarr", "expected the path of a store in a file system"),
        ("", "expected the path of a store"),
        (3, "expected the path of a store"),
        ("nowhere/push.zarr", "there is no folder"),
        ("file.zarr", r"is a file; a \.zarr is a folder"),
        ("foreign.zarr", "no store of a study"),
        ("strange.zarr", "damaged store|not the store of a study"),
        ("newer.zarr", "written by another version of rbd"),
    ],
)
def test_paths_where_no_store_can_be_are_refused_before_work(
    out: Any, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With what was expected; nothing is computed, and what is there stays as it is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.zarr").write_text("x")
    for name, content in {
        "foreign": None,
        "strange": {"attributes": {}},
        "newer": {"attributes": {"format": "rbd study 99"}},
    }.items():
        (tmp_path / f"{name}.zarr").mkdir()
        (tmp_path / f"{name}.zarr" / ("zarr.json" if content else "thesis.tex")).write_text(
            json.dumps(content and {**content, "consolidated_metadata": {"metadata": {}}})
        )
    before = sorted(map(str, tmp_path.rglob("*")))

    def never(x: float) -> float:
        raise AssertionError

    with pytest.raises(InputError, match=message):
        rbd.study(never, rbd.grid(x=[1.0]), executor=0, out=out)
    assert sorted(map(str, tmp_path.rglob("*"))) == before


def test_what_is_not_a_study_cannot_be_opened(tmp_path: Path):
    """Missing, foreign and damaged ones, each with what is wrong."""
    (tmp_path / "text.zarr").write_text("x")
    for name in ("none.zarr", "text.zarr"):
        with pytest.raises(InputError, match="is no store of a study"):
            open_study(tmp_path / name)


def test_a_store_is_filled_by_one_study_at_a_time(tmp_path: Path):
    """A second one is refused; the first one's end gives it free."""
    attributes = {"format": "rbd study 2", "versions": ""}
    first = Store(tmp_path / "push.zarr", rbd.grid(**GRID), attributes)
    first.put(block(0, 3))
    with pytest.raises(InputError, match="is being filled by another study now"):
        Store(tmp_path / "push.zarr", rbd.grid(**GRID), attributes)
    first.close()
    assert [p.name for p in tmp_path.iterdir()] == ["push.zarr.parts"]


def test_a_large_dataset_is_read_as_it_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its values are on the disk until they are needed."""
    monkeypatch.setattr(stores, "LOADED", 10)
    found = rbd.study(mixed, rbd.grid(**GRID), executor=0, out=tmp_path / "push.zarr")
    assert not found["vector"].variable._in_memory and found["vector"].dims == ("a", "b", "vector_0")
    assert found["vector"].sel(a=2, b=1).values.tolist() == [2, 1, 1]


@pytest.mark.parametrize("name", [None, "push.zarr"])
def test_text_that_cannot_be_stored_is_escaped(name: str | None, tmp_path: Path):
    """NUL, and what UTF-8 has not: in text, messages, labels, units and arguments; the same in memory and in zarr."""

    def f(word: str) -> dict[str, Any]:
        if word == "c":
            raise OSError("no file bad\udc80")
        part = xr.DataArray([1.0, 2.0], dims="part", coords={"part": ["p\udc80", "q"]}, attrs={"units": "\udc80"})
        return {"text": f"{word}\0", "several": ["x", "y\udc81"], "part_length": part}

    out = None if name is None else tmp_path / "push.zarr"
    found = rbd.study(f, rbd.grid(word=["a\udc80", "b", "c"]), executor=0, out=out)
    assert found.word.values.tolist() == ["a\\udc80", "b", "c"]
    assert found.text.values.tolist() == ["a\\udc80\\x00", "b\\x00", ""] and found.several.values[1].tolist() == [
        "x",
        "y\\udc81",
    ]
    assert found.message.values.tolist() == ["", "", "OSError: no file bad\\udc80"]
    if out is not None:
        xr.testing.assert_identical(found, open_study(out))


def test_a_dataset_that_xarray_wrote_is_no_store(tmp_path: Path):
    """It is refused as out= and by open_study, with what reads it, and stays as it is."""
    whole, path = rbd.study(mixed, rbd.grid(**GRID), executor=0), tmp_path / "push.zarr"
    whole.to_zarr(path, consolidated=False)
    for use in (lambda: rbd.study(mixed, rbd.grid(**GRID), executor=0, out=path), lambda: open_study(path)):
        with pytest.raises(InputError, match=r"written by xarray, which reads it, and is no store that rbd\.study wrote"):
            use()
    assert xr.open_zarr(path, consolidated=False).total.identical(whole.total)


def test_the_unit_of_a_store_is_that_of_all_samples(tmp_path: Path):
    """Also when it goes on in a later call."""
    path, samples = tmp_path / "push.zarr", rbd.grid(**GRID)
    for start, unit in ((0, "m"), (3, "mm")):
        store = Store(path, samples, ATTRIBUTES)
        one = block(start, start + 3)
        one.variables["value"] = Variable(one.variables["value"].values, (), unit)  # type: ignore[index]
        if start:
            with pytest.raises(InputError, match="'value' has the unit 'mm' in samples 3 to 5, and 'm' in the store"):
                store.put(one)
        else:
            store.put(one)
        store.close()
    assert open_study(path).value.attrs["units"] == "m"


def test_the_outcome_stands_in_the_store_itself(tmp_path: Path):
    """As an attribute that xarray alone reads."""
    path = tmp_path / "push.zarr"
    for start, stop in ((0, 3), (3, 12)):
        store = Store(path, rbd.grid(**GRID), ATTRIBUTES)
        store.put(block(start, stop))
        found = store.dataset()
        store.close()
        assert_same(found, open_study(path))
    alone = xr.open_zarr(path)
    assert alone.attrs["summary"] == "12 samples: 12 ok" and "interrupted" not in alone.attrs


@pytest.mark.parametrize("name", [None, "push.zarr"])
def test_records_without_entries_are_left_out_whatever_the_chunks(name: str | None, tmp_path: Path):
    """Their shape is compared before: an array is either always empty or never."""
    store = Store(name and tmp_path / name, rbd.grid(**GRID), {"format": "rbd study 2", "versions": ""})  # type: ignore[arg-type]
    store.put(block(0, 3, tau=np.zeros((3, 0))))
    assert "tau" not in store.dataset()
    with pytest.raises(InputError, match=r"'tau' has the shape \(2,\) in samples 3 to 5, and \(0,\) in samples 0 to 2"):
        store.put(block(3, 6, tau=np.zeros((3, 2))))
    store.close()


def test_how_often_a_store_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each second, up to 5 s where writing takes more than 0.05 s."""
    now, each = [100.0], [0.01]
    monkeypatch.setattr(stores.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(stores, "_write", lambda file, dataset: now.__setitem__(0, now[0] + each[0]))
    store, pauses = Store(tmp_path / "push.zarr", rbd.grid(**GRID), ATTRIBUTES), []
    store.layout.add(block(0, 3))
    for each[0] in (0.01, 0.1, 1.0):
        store.blocks.append(block(0, 3))
        store.write()
        pauses.append(store._pause)
    assert pauses == pytest.approx([1, 2, 5])


def test_ctrl_c_while_the_dataset_is_made_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It is returned, whole, with a StudyWarning; a second one ends at once."""
    whole, presses = rbd.study(mixed, rbd.grid(**GRID), executor=0), ["first"]
    made = Store.dataset

    def pressed(self: Store) -> xr.Dataset:
        if presses:
            presses.pop()
            signal.raise_signal(signal.SIGINT)
        return made(self)

    monkeypatch.setattr(Store, "dataset", pressed)
    with pytest.warns(StudyWarning, match="Ctrl-C after all 12 of 12 samples; none is missing"):
        assert_same(rbd.study(mixed, rbd.grid(**GRID), executor=0), whole)
    presses += ["first", "second"]
    with pytest.raises(KeyboardInterrupt):
        rbd.study(mixed, rbd.grid(**GRID), executor=0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("file", ["a/c/0", "total/c/0/0", "ok/c/0/0", "message/c/0/0", "text/c/0/0", "part/c/0"])
def test_a_store_that_lacks_a_file_is_damaged(file: str, tmp_path: Path):
    """Opening it says so, whatever stands there by default; a changed one does not pass the checksum."""
    path = tmp_path / "push.zarr"
    rbd.study(mixed, rbd.grid(**GRID), executor=0, out=path)
    content = (path / file).read_bytes()
    (path / file).unlink()
    for use in (lambda: open_study(path), lambda: rbd.study(mixed, rbd.grid(**GRID), executor=0, out=path)):
        with pytest.raises(InputError, match="is damaged: 1 of its files are missing. Delete it, or give another path"):
            use()
    (path / file).write_bytes(content[:-5] + bytes([content[-5] ^ 1]) + content[-4:])
    with pytest.raises(InputError, match="damaged"):
        open_study(path)


def test_a_full_disk_says_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What was finished since the last writing is not counted."""
    store = Store(tmp_path / "push.zarr", rbd.grid(**GRID), {"format": "rbd study 2", "versions": ""})
    store.put(block(0, 3))

    monkeypatch.setattr(stores, "_write", full)
    store.put(block(3, 9))
    with pytest.raises(StudyStopped, match=r"No space left on device\. 3 of 12 samples are stored"):
        store.dataset()
    with pytest.raises(StudyStopped):
        store.close()


def test_dates_and_large_whole_numbers_come_back_as_they_were(tmp_path: Path):
    """As coordinates."""
    days, far = ["2020-01-01", "2020-01-02"], ["0001-01-01", "9000-01-01"]
    axes = (np.array(days, "M8[D]"), np.array(far, "M8[D]"), np.array([1, 7], "m8[ns]"), [1, 2**40])
    for k, axis in enumerate(axes):
        path = tmp_path / f"{k}.zarr"
        found = rbd.study(lambda at: 1.0, rbd.grid(at=axis), executor=0, out=path)
        assert_same(found, rbd.study(lambda at: 1.0, rbd.grid(at=axis), executor=0))
        assert found["at"].values.tolist() == open_study(path)["at"].values.tolist() != [0, 1]


def test_extras_are_named_where_they_are_missing(tmp_path: Path):
    """Without zarr the extra is named, before work."""
    code = (
        "import sys; sys.modules['zarr'] = None\nimport rbd\n"
        "try:\n    rbd.study(lambda x: x, rbd.grid(x=[1.0]), executor=0, out='a.zarr')\n"
        "except rbd.InputError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert "rbd-contact[study]" in done.stdout, done.stderr


@pytest.fixture(autouse=True)
def _without_model_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_what_became_of_all_samples_is_counted():
    """Of none, some, and all that have a result."""
    solved, none, not_run = Reason.NONE.code, Reason.CONTACT_MOVES_SLIDES.code, Reason.NOT_RUN.code
    assert stores.outcome_of(np.array([none, none])) == {"summary": f"2 samples: 0 ok; 2 {Reason.of_code(none)}"}
    assert stores.outcome_of(np.array([solved])) == {"summary": "1 sample: 1 ok"}
    assert stores.outcome_of(np.array([solved, not_run, not_run])) == {
        "summary": "3 samples: 1 ok; 2 not run", "interrupted": "1 of 3 samples are done",
    }  # fmt: skip
