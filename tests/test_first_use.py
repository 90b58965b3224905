"""What a process loads for its first answers, and where what Numba compiled is kept."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rbd
from rbd import installation, kernels
from rbd.cli import robot_reports
from rbd.cli.app import app

PACKAGE = Path(rbd.__file__).parent
NOT_LOADED = (
    *("numba", "llvmlite", "scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.spatial"),
    *("proxsuite", "yaml", "xarray", "mujoco", "matplotlib", "meshcat", "sympy", "typer", "rich", "numpy.ma", "urllib.request"),
    *("rbd.visual", "rbd.robots.building.builder", "rbd.mechanism", "rbd.simulation", "rbd.control"),
)


def python(code: str, *folders: Path, **env: str) -> tuple[str, str]:
    """(what a new process prints, what it says on stderr), compiling after the first calls unless told otherwise."""
    inherited = {name: value for name, value in os.environ.items() if name not in ("RBD_COMPILED", "NUMBA_CACHE_DIR")}
    path = os.pathsep.join([*map(str, folders), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**inherited, "PYTHONPATH": path, **env},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return done.stdout, done.stderr


@pytest.mark.parametrize("robot, feet", [("talos", "soles"), ("solo12", "feet")])
def test_a_first_answer_loads_neither_numba_nor_what_draws_nor_most_of_scipy(robot, feet):
    """The robot's loading included; points that slip too; `make bench` has the time."""
    code = f"import sys, rbd; r = rbd.load_robot({robot!r}); rbd.solve(r.standing(), [0.0] * r.nu, r.{feet}(friction=0.7))"
    out, told = python(f"{code}; print(*[m for m in {NOT_LOADED} if m in sys.modules])")
    assert (out.split(), told) == ([], "")


def test_the_list_of_robots_is_answered_in_python(monkeypatch):
    """Beside a thread, as one that draws a bar, all would be compiled; and twenty stances are a few calls more than others."""
    seen = []

    def lines(names):
        seen.append((threading.active_count(), kernels._Process.few / len(names)))
        yield robot_reports.RobotLine("one", 7, 1.0, (), "2 soles", "yes")

    monkeypatch.setattr(robot_reports, "robot_lines", lines)
    monkeypatch.setattr(kernels._Process, "few", 1)
    threads = threading.active_count()
    assert CliRunner().invoke(app, ["robots"]).exit_code == 0
    ((beside, calls),) = seen
    assert beside == threads and calls > 130
    monkeypatch.setattr(kernels._Process, "few", 0)  # as with RBD_COMPILED=1
    kernels.few_more(100)
    assert kernels._Process.few == 0


ANSWERS = """
import hashlib, sys, warnings
import numpy as np, rbd
warnings.simplefilter("ignore")
for name in ("talos", "solo12", "g1"):
    robot, rng = rbd.load_robot(name), np.random.default_rng(1)
    start = robot.standing()
    for friction in (None, 0.7, 0.2):
        for speed in (0.0, 0.3):
            v = np.zeros(robot.nv)
            v[:2] = speed * (friction == 0.2)
            for law in ("coulomb", "convex") if speed == 0.0 else ("coulomb",):
                tau = rng.normal(size=robot.nu) * 20.0
                found = rbd.solve(rbd.State(robot, start.q, v), tau, robot.feet(friction=friction), law=law, check=False)
                print(hashlib.sha256(found.a.tobytes()).hexdigest(), found.method.replace(" ", "_"))
"""


def test_answers_in_python_and_compiled_are_the_same_bit_by_bit():
    """So it does not matter when a process begins to compile: all that holds, sticks and slips, at rest and moving."""
    by_python, compiled = (python(ANSWERS, RBD_COMPILED=how)[0] for how in ("0", "1"))
    assert by_python == compiled
    assert len({line.split()[1] for line in compiled.splitlines()}) >= 2  # ways in which they were found
    changing, _ = python(ANSWERS)
    assert changing == compiled


def test_after_the_first_calls_what_is_called_is_compiled_for_its_types_alone():
    """What was made before goes on with the compiled functions, and asks for none of another type of argument."""
    code = """
import json, sys, numpy as np, rbd
from rbd import kernels
talos = rbd.load_robot("talos")
state, soles = talos.standing(), talos.soles(friction=0.7)
tau, loaded = rbd.hold(state, soles).tau, []
for _ in range(60):
    rbd.solve(state, tau, soles)
    loaded.append("numba" in sys.modules)
ready = {k.function.__name__: len(k.made.signatures) for k in kernels._kernels if k.ready}
print(json.dumps({"loaded": loaded, "ready": ready}))
"""
    found = json.loads(python(code)[0])
    assert not any(found["loaded"][:10]) and found["loaded"][-1]
    assert found["loaded"] == sorted(found["loaded"])
    assert set(found["ready"].values()) == {1}


def test_beside_other_threads_large_arrays_and_when_asked_it_is_compiled_at_once():
    """In Python one call at a time is run, and a large one would take seconds; a loop that must not pause asks for it."""
    code = "import sys, threading, numpy as np\nfrom rbd import kernels\nfrom rbd.simulation.step_kernel import turned\n"
    call = "x = np.ones({n}); turned(x, x, 0.1, np.zeros((0, 2), int), x); print('numba' in sys.modules)\n"
    assert python(code + call.format(n=3))[0].split() == ["False"]
    assert python(code + call.format(n=6_000))[0].split() == ["True"]
    assert python(code + "kernels.prepare(turned)\n" + call.format(n=3))[0].split() == ["True"]
    assert python(code + call.format(n=3), RBD_COMPILED="1")[0].split() == ["True"]
    two = "end = threading.Event(); threading.Thread(target=end.wait).start()\n"
    assert python(code + two + call.format(n=3) + "end.set()\n")[0].split() == ["True"]


@pytest.fixture
def sums(tmp_path) -> Path:
    """A folder with two modules of kernels: `total_kernel` calls one of `part_kernel`, and names its number."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "part_kernel.py").write_text(
        "from rbd.kernels import compiled\nOFFSET = 1.0\n@compiled\ndef part(x):\n    return 2.0 * x\n"
    )
    (folder / "total_kernel.py").write_text(
        "from rbd.kernels import NUMBER, compiled, signature\nfrom part_kernel import OFFSET, part\n"
        "def _total(x):\n    return part(x) + OFFSET\ntotal = compiled(_total, signature(NUMBER, NUMBER))\n"
    )
    return folder


SUM = """
from rbd import kernels
kernels.modules = lambda: []  # those of the package are not compiled here
import total_kernel
print(total_kernel.total(3.0), len(kernels.folders()))
"""


def test_compiling_is_told_once_and_kept(sums):
    """One line on stderr, and `rbd warm-up` in it; the next process says nothing."""
    out, told = python(SUM, sums, RBD_COMPILED="1")
    assert out.split() == ["7.0", "1"]
    assert re.fullmatch(r"rbd: compiling, once on this machine, up to a minute; `rbd warm-up` does it ahead\.\n", told)
    assert list((sums / "__pycache__").glob("*.nbc"))
    assert python(SUM, sums, RBD_COMPILED="1") == (out, "")


BAR = """
import contextlib
from rbd import kernels
@contextlib.contextmanager
def bar(count):
    yield lambda done: print(f"{done} of {count}")
kernels.show_progress(bar)
"""


def test_a_bar_is_told_of_what_is_compiled_and_not_of_what_is_loaded(sums):
    """As `rbd` shows on a terminal; the second process only loads."""
    assert [python(BAR + SUM, sums, RBD_COMPILED="1")[0].split("\n")[:-1] for _ in range(2)] == [["1 of 1", "7.0 1"], ["7.0 1"]]


def test_a_part_has_no_machine_code_and_runs_as_it_is_written(sums):
    """A function without types of arguments, called from Python beside what is compiled: the same number, and nothing kept."""
    out, _ = python(SUM + "import part_kernel\nprint(part_kernel.part(3.0))", sums, RBD_COMPILED="1")
    assert out.split() == ["7.0", "1", "6.0"]
    assert [path.name.split(".")[1][:6] for path in (sums / "__pycache__").glob("*.nbc")] == ["_total"]


def test_a_call_compiles_what_it_reaches_and_prepare_all_if_some_was_not_kept(sums):
    """Functions that are imported but not called cost nothing; a loop that must not pause asks for all before."""
    (sums / "other_kernel.py").write_text((sums / "total_kernel.py").read_text())
    code = SUM.replace("[]", '["other_kernel"]')
    names = lambda: sorted(path.name.split("_kernel")[0] for path in sums.rglob("*.nbc"))  # noqa: E731
    assert python("import other_kernel\n" + code, sums, RBD_COMPILED="1")[0].split()[0] == "7.0"
    assert names() == ["total"]
    asks = code.replace("print(", "kernels.prepare()\nprint(") + "import sys; print('other_kernel' in sys.modules)"
    assert python(asks, sums)[0].split()[-1] == "False"
    for path in sums.rglob("*.nb?"):
        path.unlink()
    assert python(asks, sums)[0].split()[-1] == "True"
    assert names() == ["other", "total"]


def test_a_part_is_compiled_once_for_all_integers(sums):
    """Numba takes 0 and 3 for two types, and compiled a part of a vector's rows for each row where one begins."""
    (sums / "total_kernel.py").write_text(
        "from rbd.kernels import NUMBER, compiled, signature\nfrom part_kernel import part\n"
        "def _total(x):\n    return part(0) + part(3) + x\ntotal = compiled(_total, signature(NUMBER, NUMBER))\n"
    )
    out, _ = python(SUM + "print(*kernels._Process.compiled)", sums, RBD_COMPILED="1")
    assert out.split() == ["9.0", "1", "total_kernel._total", "part_kernel.part"]


def test_a_package_that_cannot_be_written_is_kept_in_the_users_cache(sums, tmp_path):
    """A read-only installation; here its `__pycache__` is a file, since nothing is read-only for root."""
    (sums / "__pycache__").write_text("")
    env = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path), "RBD_COMPILED": "1"}
    out, told = python(SUM, sums, **env)
    assert out.split() == ["7.0", "1"] and "once on this machine" in told
    assert list(tmp_path.rglob("*.nbc"))
    assert python(SUM, sums, **env) == (out, "")
    named = tmp_path / "named"
    assert python(SUM, sums, **env, NUMBA_CACHE_DIR=str(named))[0] == out
    assert list(named.rglob("*.nbc"))


def test_what_was_compiled_where_it_cannot_be_written_is_read(sums, tmp_path):
    """An image whose root ran `rbd warm-up`, and whose user may not write into it; here by a name for another folder."""
    env, other = {"RBD_COMPILED": "1"}, tmp_path / "other"
    assert "compiling" in python(SUM, sums, **env)[1]
    out, told = python("import os; os.access = lambda *_: False\n" + SUM, sums, **env, NUMBA_CACHE_DIR=str(other))
    assert (out.split()[0], told, list(other.rglob("*.nbc"))) == ("7.0", "", [])


def test_where_nothing_can_be_written_each_process_compiles_and_says_so(sums, tmp_path):
    """It works, and names the way out."""
    (sums / "__pycache__").write_text("")
    (tmp_path / "cache").write_text("")
    env = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path / "cache"), "RBD_COMPILED": "1"}
    for _ in range(2):
        out, told = python(SUM, sums, **env)
        assert out.split() == ["7.0", "0"]
        assert told.count("\n") == 1 and "in every process" in told and "NUMBA_CACHE_DIR" in told


@pytest.mark.parametrize("before, after, found", [("2.0 *", "5.0 *", "16.0"), ("= 1.0", "= 4.0", "10.0")])
def test_what_is_kept_is_compiled_anew_where_a_function_or_number_of_another_module_changes(sums, before, after, found):
    """Numba looks at a function's own file, and would go on with those that it calls as they were."""
    assert python(SUM, sums, RBD_COMPILED="1")[0].split()[0] == "7.0"
    part = sums / "part_kernel.py"
    part.write_text(part.read_text().replace(before, after))
    out, told = python(SUM, sums, RBD_COMPILED="1", PYTHONDONTWRITEBYTECODE="1")
    assert out.split()[0] == found and "compiling" in told


def test_all_modules_with_types_of_arguments_are_known_by_their_names():
    """`rbd warm-up` compiles those whose files end in `_kernel.py`."""
    files = [path for path in PACKAGE.rglob("*.py") if "signature(" in path.read_text() and path.name != "kernels.py"]
    users = [path for path in files if "rbd.kernels import" in path.read_text()]
    names = {"rbd." + ".".join(path.relative_to(PACKAGE).with_suffix("").parts) for path in users}
    assert names and names <= set(kernels.modules())


def test_the_command_compiles_all_and_the_next_process_nothing():
    """It says how much, how long and where."""
    assert CliRunner().invoke(app, ["warm-up"]).exit_code == 0
    out, told = python("import sys; sys.argv = ['rbd', 'warm-up']; from rbd.cli.app import main; main()")
    assert re.match(r"nothing is left to compile; kept in .*__pycache__", out) and told == ""


def test_the_command_refuses_where_nothing_is_to_be_compiled(monkeypatch):
    """Exit code 2, and what to unset."""
    monkeypatch.setattr(installation, "in_use", lambda: False)
    answer = CliRunner().invoke(app, ["warm-up"])
    assert answer.exit_code == 2 and "RBD_COMPILED=0" in answer.stderr
