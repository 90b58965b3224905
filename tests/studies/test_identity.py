"""A function's identity counts what the function would take along to another process; what cannot be counted is refused."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

import rbd
from rbd.errors import InputError, StudyWarning
from rbd.model.content_hash import digest
from rbd.studies import open_study, provenance

LOG: list[float] = []


class Part:
    """An object within an object."""

    def __init__(self, length: float) -> None:
        self._length = length


class Push:
    """A study whose function is a method."""

    scale = 1.0

    def __init__(self, mu: float = 0.5, length: float = 0.2, masses: tuple[float, ...] = (1.0,)) -> None:
        self._mu, self.part, self.robot = mu, Part(length), rbd.testing.box()
        self._by_name = {"masses": list(masses), "names": {"a", "b", "c"}}

    def push(self, x: float) -> float:
        """A number that depends on all attributes."""
        return x * self._mu * self.part._length * self.scale * sum(self._by_name["masses"])

    def heavier(self) -> Push:
        """The same with another mass of its robot."""
        self.robot.model.inertias[1].mass *= 2.0
        return self


def with_scale(value: float) -> Push:
    """A `Push` of a class whose class attribute was set."""
    made = Push()
    made.__class__ = type("Push", (Push,), {"scale": value, "__module__": __name__})
    return made


def around(value: Any) -> Any:
    """A function that encloses a value, and appends to a list."""

    def enclosing(x: float) -> Any:
        LOG.append(x)
        return value

    return enclosing


def spline(height: float) -> CubicSpline:
    """A cubic spline."""
    return CubicSpline([0.0, 1.0, 2.0, 3.0], [0.0, height, 1.0, 0.0])


def b_spline(height: float) -> BSpline:
    """A B-spline, with all of its numbers in private attributes."""
    return make_interp_spline(np.arange(5.0), [0.0, height, 1.0, 0.0, 2.0])


@pytest.mark.parametrize(
    ("one", "same", "other"),
    [
        (Push().push, Push().push, Push(mu=0.6).push),
        (Push().push, Push().push, Push(length=0.3).push),
        (Push().push, Push().push, Push(masses=(1.0, 2.0)).push),
        (Push().push, Push().push, Push().heavier().push),
        (with_scale(1.0).push, with_scale(1.0).push, with_scale(2.0).push),
        (around(spline(1.0)), around(spline(1.0)), around(spline(2.0))),
        (around(b_spline(1.0)), around(b_spline(1.0)), around(b_spline(2.0))),
        (around([1.0]), around([1.0]), around([2.0])),
        (around({"k": 1.0}), around({"k": 1.0}), around({"k": 2.0})),
        (around([Part(1.0)]), around([Part(1.0)]), around([Part(2.0)])),
        (around(around(1.0)), around(around(1.0)), around(around(2.0))),
        (spline(1.0).__call__, spline(1.0).__call__, spline(2.0).__call__),
    ],
)
def test_what_a_function_takes_along_is_counted(one: Any, same: Any, other: Any):
    """Private attributes, objects among attributes, robots, class attributes, splines and collections, whatever is appended."""
    assert digest(one) == digest(same) != digest(other)


def test_a_class_attribute_that_is_set_later_is_counted(monkeypatch: pytest.MonkeyPatch):
    """The source of the class is the same."""
    before = digest(Push().push)
    monkeypatch.setattr(Push, "scale", 3.0)
    assert digest(Push().push) != before


def test_a_list_of_the_module_counts_by_what_it_holds_at_the_start(monkeypatch: pytest.MonkeyPatch):
    """So a function that fills it in this process is another one afterwards."""
    f = around(1.0)
    monkeypatch.setitem(globals(), "LOG", [])
    before = digest(f)
    LOG.append(1.0)
    assert digest(f) != before


def test_functions_among_samples_count_as_those_of_studies(monkeypatch: pytest.MonkeyPatch):
    """By what they use: a class attribute that a method reads was not seen."""
    digest = rbd.grid(f=[Push().push, Push(mu=0.6).push]).digest()
    assert rbd.grid(f=[Push().push, Push(mu=0.6).push]).digest() == digest
    monkeypatch.setattr(Push, "scale", 2.0)
    assert rbd.grid(f=[Push().push, Push(mu=0.6).push]).digest() != digest


def test_what_is_computed_when_it_is_read_is_not_counted():
    """A state's frames, a contact's rows: they follow from what is counted."""
    state = rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1])
    f = around((state, rbd.PointContact("p", "box", friction=0.5)))
    before = digest(f)
    _ = state.M, state.com if hasattr(state, "com") else None
    assert digest(f) == before


class Holding:
    """Has what only this process has."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def push(self, x: float) -> float:
        """A number."""
        with self._lock:
            return x


class Outer:
    """Has an object that has what only this process has."""

    def __init__(self) -> None:
        self.inner = {"first": [Holding()]}

    def push(self, x: float) -> float:
        """A number."""
        return x


@pytest.mark.parametrize(
    ("function", "path"),
    [
        (Holding().push, r"push\.self\._lock is a _thread\.lock"),
        (Outer().push, r"push\.self\.inner\['first'\]\[0\]\._lock is a _thread\.lock"),
        (around(x for x in range(3)), r"enclosing\.value is a builtins\.generator"),
    ],
)
def test_a_store_is_refused_where_something_cannot_be_counted(function: Any, path: str, tmp_path: Path):
    """By the way to it; without a store the study runs, and its attributes say so."""
    samples = rbd.grid(x=[1.0, 2.0])
    with pytest.raises(InputError, match=path):
        rbd.study(function, samples, executor=0, out=tmp_path / "s.zarr")
    assert not (tmp_path / "s.zarr").exists()
    if "value" not in path:
        assert "cannot be counted" in rbd.study(function, samples, executor=0).attrs["function_sha256"]


def test_a_store_goes_on_with_the_same_object_and_refuses_another(tmp_path: Path):
    """An object's private number decides."""
    samples, out = rbd.grid(x=[1.0, 2.0]), tmp_path / "s.zarr"
    rbd.study(Push().push, samples, executor=0, out=out)
    rbd.study(Push().push, samples, executor=0, out=out)
    with pytest.raises(InputError, match="another study"):
        rbd.study(Push(mu=0.6).push, samples, executor=0, out=out)
    assert open_study(out).value.values[1] == 2.0 * 0.5 * 0.2


def test_an_identity_is_the_same_in_another_process(tmp_path: Path):
    """Whatever the order of hashes: methods, splines, sets, constants of code without a source."""
    code = f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import test_identity as t
        from rbd.model.content_hash import digest
        typed = {{}}
        exec("def f(x): return x in {{'a', 'b', 'c', 'd'}}", typed)
        for f in (t.Push().push, t.around(t.b_spline(1.0)), t.around({{"a", "b", ("c", 1)}}), typed["f"]):
            print(digest(f))
    """
    call = [sys.executable, "-c", textwrap.dedent(code)]
    found = {
        subprocess.run(call, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, text=True, check=True).stdout
        for seed in ("1", "2", "3")
    }
    assert len(found) == 1 and len(found.pop().split()) == 4


@pytest.mark.parametrize("edit", ["FACTOR = 2.0", "def scaled(x): return 2.0 * x", "class Arm:\n    length = 2.0"])
@pytest.mark.parametrize(
    "study",
    [
        "from mine.parts import scaled, Arm, FACTOR\ndef f(x): return scaled(x) * Arm.length * FACTOR",
        "from mine import parts as p\ndef f(x): return p.scaled(x) * p.Arm.length * p.FACTOR",
        "import mine.parts\ndef f(x): return mine.parts.scaled(x) * mine.parts.Arm.length * mine.parts.FACTOR",
    ],
)
def test_other_modules_of_the_user_are_counted(study: str, edit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A helper in a file of its own, edited between two runs; a comment there changes nothing."""
    text, found = "import mine\nFACTOR = 1.0\ndef scaled(x): return x\nclass Arm:\n    length = 1.0\n", []
    for k, more in enumerate(("", "# a remark", edit)):
        folder = tmp_path / str(k) / "mine"
        folder.mkdir(parents=True)
        for name, content in (("__init__", ""), ("parts", text + more), ("push", study)):
            (folder / f"{name}.py").write_text(content)
        with monkeypatch.context() as patch:
            patch.syspath_prepend(folder.parent)
            function = importlib.import_module("mine.push").f
            found.append((digest(function), function(3.0)))
            for name in [name for name in sys.modules if name.partition(".")[0] == "mine"]:
                del sys.modules[name]
    assert found[0] == found[1] and found[0][0] != found[2][0] and found[2][1] == 6.0


def ends_at_two(x: float) -> float:
    """Ends the study as Ctrl-C does, unless the environment says otherwise."""
    if x == 2.0 and "RBD_TEST_GOES_ON" not in os.environ:
        raise KeyboardInterrupt
    return x


def test_whether_arithmetic_was_compiled_stands_in_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A store that goes on with the other arithmetic says so, as of another version."""
    samples, out = rbd.grid(x=[1.0, 2.0, 3.0]), tmp_path / "s.zarr"
    with pytest.warns(StudyWarning, match="Ctrl-C"):
        rbd.study(ends_at_two, samples, executor=0, out=out, chunk=1)
    monkeypatch.setenv("RBD_TEST_GOES_ON", "1")
    monkeypatch.setattr(provenance, "in_use", lambda: False)
    with pytest.warns(StudyWarning, match="compiled arithmetic, and the rest with .*not compiled arithmetic"):
        whole = rbd.study(ends_at_two, samples, executor=0, out=out)
    assert "compiled arithmetic; then" in whole.attrs["versions"]
