"""A study that ended early goes on where it was, and nowhere else: not with another function, other samples or another seed."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import studied
import xarray as xr

import rbd
from rbd.errors import InputError, StudyWarning
from rbd.model.content_hash import digest, name_of
from rbd.studies import open_study
from rbd.studies.evaluation import BATCH
from rbd.studies.processes import Chunks

GRID = {"x": np.linspace(0, 1, 5), "y": np.linspace(0, 1, 6)}
OTHER = ("command", "started", "finished")


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    """Bit for bit, but for what differs from run to run."""
    xr.testing.assert_identical(*(x.assign_attrs(dict.fromkeys(OTHER, "")) for x in (one, other)))


class Stops:
    """A function that computes some samples, and then ends the study as Ctrl-C does."""

    def __init__(self, after: int = 10**9) -> None:
        self._calls, self._after = 0, after

    def __reduce__(self) -> tuple[Any, ...]:
        """When it ends the study is no part of what it computes."""
        return Stops, ()

    def __call__(self, x: float, y: float) -> dict[str, float]:
        """As `studied.sums`."""
        self._calls += 1
        if self._calls > self._after:
            raise KeyboardInterrupt
        return studied.sums(x, y)


def test_a_study_goes_on_after_ctrl_c(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """What was computed is kept, and not computed again; in the end the dataset is that of one run."""
    with pytest.warns(StudyWarning, match="Ctrl-C after 13 of 30 samples"):
        part = rbd.study(Stops(13), rbd.grid(**GRID), executor=0, out=tmp_path / "sums.zarr", chunk=1)
    assert part.attrs["interrupted"] == "13 of 30 samples are done" and part.attrs["summary"].endswith("17 not run")
    assert_same(part, open_study(tmp_path / "sums.zarr"))
    rest = Stops()
    whole = rbd.study(rest, rbd.grid(**GRID), executor=0, out=tmp_path / "sums.zarr", chunk=4)
    assert rest._calls == 17 and "13 of 30 samples were done; going on" in capsys.readouterr().err
    assert_same(whole, rbd.study(Stops(), rbd.grid(**GRID), executor=0))
    assert "interrupted" not in whole.attrs
    rbd.study(Stops(0), rbd.grid(**GRID), executor=0, out=tmp_path / "sums.zarr", progress=False)
    assert capsys.readouterr().err == ""


def test_a_study_goes_on_elsewhere_in_other_chunks(workers: rbd.studies.Workers, tmp_path: Path):
    """Begun in this process, ended in two others; with random numbers."""
    samples = rbd.grid(x=np.arange(40.0))
    with pytest.warns(StudyWarning, match="Ctrl-C after 18 of 40 samples"):
        rbd.study(studied.Drawn(20), samples, executor=0, out=tmp_path / "drawn.zarr", chunk=3)
    f = studied.Drawn()
    again = rbd.study(f, samples, executor=workers, out=tmp_path / "drawn.zarr", chunk=7)
    assert_same(again, rbd.study(f, samples, executor=0))


def test_a_study_goes_on_after_its_process_was_killed(tmp_path: Path):
    """As by a power cut: what was written a second ago is there."""
    code = """
        import sys, time, rbd

        def slow(x):
            time.sleep(0.01)
            return x * x

        if __name__ == "__main__":
            found = rbd.study(slow, rbd.grid(x=range(int(sys.argv[1]))), executor=0, out="slow.zarr", chunk=2)
            print(found.attrs["summary"], float(found.value.sum()))
    """
    (tmp_path / "slow.py").write_text(textwrap.dedent(code))
    call = [sys.executable, "slow.py", "150"]
    running = subprocess.Popen(call, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    till = time.monotonic() + 30
    while not any((tmp_path / "slow.zarr.parts").glob("[0-9]*.part")):
        assert time.monotonic() < till and running.poll() is None
        time.sleep(0.02)
    running.send_signal(signal.SIGKILL)
    running.wait()
    done = 150 - int((open_study(tmp_path / "slow.zarr").reason == 99).sum())
    assert 0 < done < 150
    again = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert again.stdout == f"150 samples: 150 ok {float(sum(i * i for i in range(150)))}\n"
    assert f"{done} of 150 samples were done; going on" in again.stderr


@pytest.mark.parametrize("damage", ["missing", "cut", "changed", "empty", "nonsense"])
def test_damaged_parts_are_computed_again(damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Only those; the others stay. What is opened alone has the others."""
    monkeypatch.setattr("rbd.studies.stores.OFTEN", 0.0)
    monkeypatch.setattr("rbd.studies.stores.SELDOM", 0.0)
    path = tmp_path / "sums.zarr"
    with pytest.warns(StudyWarning):
        rbd.study(Stops(24), rbd.grid(**GRID), executor=0, out=path, chunk=6)
    file = sorted(path.with_name("sums.zarr.parts").glob("*.part"))[2]
    content = file.read_bytes()
    if damage == "missing":
        file.unlink()
    else:
        changed = content[:-5] + bytes([content[-5] ^ 1]) + content[-4:]
        file.write_bytes({"cut": content[:-7], "changed": changed, "empty": b"", "nonsense": b"nonsense"}[damage])
    assert open_study(path).attrs["interrupted"] == "18 of 30 samples are done"
    rest = Stops()
    assert_same(rbd.study(rest, rbd.grid(**GRID), executor=0, out=path), rbd.study(Stops(), rbd.grid(**GRID), executor=0))
    assert rest._calls == 12


def test_only_the_whole_store_is_left(tmp_path: Path):
    """Neither its parts nor files that a killed process left."""
    path = tmp_path / "sums.zarr"
    with pytest.warns(StudyWarning):
        rbd.study(Stops(7), rbd.grid(**GRID), executor=0, out=path, chunk=1)
    (path.with_name("sums.zarr.parts") / ".00ff.part").write_bytes(b"half")
    rbd.study(Stops(), rbd.grid(**GRID), executor=0, out=path)
    assert [x.name for x in tmp_path.iterdir()] == ["sums.zarr"] and not list(path.rglob(".*"))


def test_a_process_that_was_killed_while_the_whole_was_written_goes_on(tmp_path: Path):
    """The half of it that is there is written again."""
    path, parts = tmp_path / "sums.zarr", tmp_path / "sums.zarr.parts"
    with pytest.warns(StudyWarning):
        rbd.study(Stops(7), rbd.grid(**GRID), executor=0, out=path, chunk=1)
    (parts / "whole" / "sum").mkdir(parents=True)
    whole = rbd.study(Stops(), rbd.grid(**GRID), executor=0, out=path)
    assert_same(whole, rbd.study(Stops(), rbd.grid(**GRID), executor=0))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"function": studied.drawn}, r"the function is studied\.drawn, and was functools|the function is studied\.drawn"),
        (
            {"samples": rbd.grid(x=GRID["x"], y=GRID["y"][:-1])},
            r"the samples are others \(5 x x 5 y; the store has 5 x x 6 y\)",
        ),
        ({"samples": rbd.grid(x=GRID["x"] + 1e-16, y=GRID["y"])}, "the samples are others"),
        ({"seed": 1}, "seed is 1, and was 0"),
        ({"keep": ("sum",)}, "keep is 'sum', and was 'default'"),
        ({"keep": {"sum": studied.drawn}}, "keep is 'sum by studied.drawn"),
        ({"batched": True}, "batched is 'yes', and was 'no'"),
    ],
)
def test_another_study_is_refused(changed: dict[str, Any], message: str, tmp_path: Path):
    """With what differs and what can be done; the store stays as it is."""
    call: dict[str, Any] = {"function": studied.sums, "samples": rbd.grid(**GRID), "executor": 0, "out": tmp_path / "sums.zarr"}
    whole = rbd.study(**call)
    if changed.get("function") is studied.drawn:
        changed = {**changed, "samples": rbd.grid(x=GRID["x"])}
    with pytest.raises(InputError, match=message) as raised:
        rbd.study(**{**call, **changed})
    assert "is the store of another study" in str(raised.value) and "open_study(" in str(raised.value)
    xr.testing.assert_identical(open_study(tmp_path / "sums.zarr"), whole)


SOURCE = """
import functools
SCALE, NAMES = 2.0, ["a"]
seen = []
def half(x):
    "A half."
    return x / 2  # exactly
class Law:
    power = 2
@functools.cache
def table(k):
    return k + 1
def f(x, offset=1.0):
    seen.append(x)
    return half(x) * SCALE + offset + Law.power + table(2) + len(NAMES)
def made(k):
    def inner(x):
        return k * x
    return inner
g = made(3)
h = functools.partial(f, offset=2.0)
low = lambda x: x + 1
"""


def module_of(source: str, folder: Path, name: str = "own_study") -> dict[str, Any]:
    """The names of a module with this source."""
    file = folder / f"{name}_{len(list(folder.iterdir()))}.py"
    file.write_text(source)
    found: dict[str, Any] = {"__name__": name}
    exec(compile(source, str(file), "exec"), found)
    return found


@pytest.mark.parametrize(
    ("old", "new", "differing"),
    [
        ("# exactly", "# about", ""),
        ('"A half."', '"Half of it."', ""),
        ("x / 2", "x / 2.5", "f h"),
        ("SCALE, NAMES = 2.0", "SCALE, NAMES = 2.5", "f h"),
        ("offset=1.0)", "offset=1.5)", "f h"),
        ("offset=2.0)", "offset=2.5)", "h"),
        ("power = 2", "power = 3", "f h"),
        ("k + 1", "k + 2", "f h"),
        ("made(3)", "made(4)", "g"),
        ("k * x", "k + x", "g"),
        ("x + 1\n", "x + 2\n", "low"),
        ("seen = []", "seen = [1]", "f h"),
    ],
)
def test_a_function_is_known_by_what_it_computes(old: str, new: str, differing: str, tmp_path: Path):
    """Source, functions and values that it uses, defaults, closures and bound arguments; not comments and docstrings."""
    assert old in SOURCE
    one, other = module_of(SOURCE, tmp_path), module_of(SOURCE.replace(old, new), tmp_path)
    names = ["f", "g", "h", "low"]
    assert [name for name in names if digest(one[name]) != digest(other[name])] == differing.split()


def test_names_of_functions():
    """Of functions, methods, partials, objects and classes."""
    assert name_of(studied.sums) == name_of(functools.partial(studied.sums, y=1)) == "studied.sums"
    assert name_of(Stops(3)).endswith("test_resume.Stops") and name_of(np.sin) == "numpy.sin" or name_of(np.sin)


def test_a_hash_is_the_same_in_another_process(tmp_path: Path):
    """Also of functions that use a robot, a state, a set; whatever the order of hashes."""
    code = """
        import rbd
        from rbd.model.content_hash import digest
        box = rbd.testing.box()
        state, words, floor = rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), {"a", "b", "c"}, rbd.PointContact("p", "box", friction=0.5)

        def f(x, law=floor):
            return rbd.hold(state, [law]), words

        print(digest(f))
    """
    (tmp_path / "hashed.py").write_text(textwrap.dedent(code))
    found = {
        subprocess.run(
            [sys.executable, "hashed.py"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1 and len(found.pop()) == 65


def test_another_version_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As a warning that names both; the attributes name all that took part."""
    path = tmp_path / "sums.zarr"
    with pytest.warns(StudyWarning, match="Ctrl-C"):
        rbd.study(Stops(7), rbd.grid(**GRID), executor=0, out=path, chunk=1)
    monkeypatch.setattr("rbd.studies.provenance.versions", lambda: "rbd 9.0, python 3.11")
    with pytest.warns(StudyWarning, match=r"A part was computed with .*rbd 0\.1.*the rest with .*rbd 9\.0.* last bits"):
        whole = rbd.study(Stops(), rbd.grid(**GRID), executor=0, out=path)
    assert whole.attrs["versions"].endswith("; then rbd 9.0, python 3.11")


def test_a_finished_study_is_returned_without_computing(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """No process is started."""
    out = tmp_path / "sums.zarr"
    whole = rbd.study(studied.sums, rbd.grid(**GRID), executor=0, out=out)
    began = time.perf_counter()
    xr.testing.assert_identical(rbd.study(studied.sums, rbd.grid(**GRID), out=out), whole)
    assert time.perf_counter() - began < 2 and "30 of 30 samples were done; nothing is left" in capsys.readouterr().err


def test_a_store_with_nonsense_in_its_list_is_refused(tmp_path: Path):
    """Whatever is changed there: an error that names the store, or the whole study."""
    path = tmp_path / "sums.zarr"

    def run() -> xr.Dataset:
        return rbd.study(studied.sums, rbd.grid(**GRID), executor=0, out=path, progress=False)

    run()
    listed = path / "zarr.json"
    content = listed.read_text()
    changes: list[Callable[[dict[str, Any]], Any]] = [
        lambda root: root["attributes"].pop("rbd_files"),
        lambda root: root["consolidated_metadata"]["metadata"].pop("ok"),
        lambda root: root["consolidated_metadata"]["metadata"]["reason"].pop("chunk_grid"),
    ]
    for change in changes:
        root = json.loads(content)
        change(root)
        listed.write_text(json.dumps(root))
        with pytest.raises(InputError, match=r"sums\.zarr"):
            run()
    listed.write_text(content[:100])
    with pytest.raises(InputError, match="no store of a study, or a damaged one"):
        run()
    listed.write_text(content)
    run()


def test_what_is_left_is_taken_in_whole_batches() -> None:
    """Batches of which a part is missing are computed again as a whole; the last one may be shorter."""
    done = np.ones(5 * BATCH + 3, bool)
    done[[BATCH, 2 * BATCH - 1, 4 * BATCH + 1, 5 * BATCH + 2]] = False
    chunks = Chunks(done, BATCH, batched=True)
    taken = list(iter(chunks.take, None))
    assert taken == [(BATCH, 2 * BATCH), (4 * BATCH, 5 * BATCH), (5 * BATCH, 5 * BATCH + 3)]
