"""Small faults put into the code, one at a time: the tests must notice each of them.

    python tests/mutants.py --n 300 --seed 0 --jobs 2                     (`make mutants N=300 SEED=0`)

1. Each test file is run once under coverage: which lines does each test execute, and how long does it take?
2. N mutants are drawn from `PLACES` (`mutants_drawn.py` lists the kinds).
3. Each is loaded in a fork of its own, in place of the real module (nothing is written into the tree), and the tests that
   execute the changed statement are run, the quickest first, until one fails.

A mutant is
    caught      a test fails, or the process crashes
    timed out   a test takes 20 times as long as it did, and half a minute more; this counts as caught
    uncovered   no test executes the statement
    survived    all tests that execute it pass, as far as `BUDGET_SECONDS` go

A survivor that no test could notice is equivalent: `mutants_equivalent.txt` lists those with the reason, by file, function and
changed line, so that a judgement outlives changes elsewhere in the file. Printed at the end: each of the others that is not
caught, as a difference, and the share that is. The exit code is 1 below 95 %.

What was found is kept in `--keep`, outside git, and an interrupted run goes on where it stopped. It is used again while the
files that it depends on are the same: of a test file's lines, itself and the modules that it executes; of a caught mutant, its
module and the test file that caught it; of a survivor, all modules and all tests.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import hashlib
import importlib
import json
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mutants_drawn import Mutant, drawn

ROOT = Path(__file__).resolve().parents[1]
PLACES = """model/dynamics.py model/state.py model/mjcf problem constraints solvers answers statics control simulation motion
mechanism planar studies""".split()
EQUIVALENT = Path(__file__).with_name("mutants_equivalent.txt")
LOADED_ONCE = """coverage hypothesis numpy scipy.linalg scipy.optimize scipy.spatial scipy.integrate scipy.sparse pinocchio coal
tornado sympy mujoco matplotlib.figure xarray typer rich.console yaml""".split()
QUIET = ["-q", "--tb=no", "-p", "no:cacheprovider", "--assert=plain"]
BATCHES = (15, 60, 10**6)  # tests run at a time: the quickest need few files collected
BUDGET_SECONDS = 240.0  # of tests per mutant, by the times that were recorded
MEMORY_LIMIT = 12 << 30
ENOUGH = 0.95
KERNELS = "from rbd.kernels import"

# ------------------------------------------------------------------------------------------------- processes of their own

Tell = Callable[..., None]
Task = Callable[[Tell], None]


@dataclass
class Fork:
    """A task in a process of its own; `told` is what it said, `fault` how it failed ("late", a crash or an exception)."""

    name: str
    process: int
    folder: str
    told: list[dict[str, Any]] = field(default_factory=list)
    until: float = field(default_factory=lambda: time.monotonic() + 120.0)
    fault: str = ""

    def end(self, pipe: int, late: bool) -> None:
        """End the process and all that it started, and clear its folder."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process, signal.SIGKILL)
        status = os.waitpid(self.process, 0)[1]
        os.close(pipe)
        shutil.rmtree(self.folder, ignore_errors=True)
        errors = [word["error"] for word in self.told if "error" in word]
        self.fault = "late" if late else errors[0] if errors else f"crash by signal {status & 127}" if status & 127 else ""


def forks(tasks: Iterable[tuple[str, Task]], jobs: int) -> Iterator[Fork]:
    """The forks of (name, task), as they end.

    A task is given a function: `tell(limit, **what)` says what it found, and that the next word comes within `limit` seconds.
    """
    waiting, running = iter(tasks), dict[int, Fork]()
    try:
        while (task := next(waiting, None) if len(running) < jobs else None) is not None or running:
            if task is not None:
                pipe, started = fork(*task)
                running[pipe] = started
                continue
            ready = select.select(list(running), [], [], 0.2)[0]
            for pipe, one in list(running.items()):
                words = os.read(pipe, 1 << 16) if pipe in ready else b""  # lines are written at once: only whole ones are read
                for line in words.splitlines():
                    one.told.append(json.loads(line))
                    one.until = time.monotonic() + one.told[-1]["limit"]
                late = time.monotonic() > one.until
                if late or (pipe in ready and not words):
                    del running[pipe]
                    one.end(pipe, late)
                    yield one
    finally:
        for pipe, one in running.items():
            one.end(pipe, True)


def fork(name: str, task: Task) -> tuple[int, Fork]:
    """(pipe of its words, the fork) of a silent child that does the task, with a folder of its own for what it writes."""
    folder = tempfile.mkdtemp(prefix="rbd_mutant_")
    read, write = os.pipe()
    if process := os.fork():
        os.close(write)
        return read, Fork(name, process, folder)
    try:
        os.setsid()  # what it starts ends with it
        os.close(read)
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.chdir(ROOT)
        tempfile.tempdir = os.environ["TMPDIR"] = folder
        os.environ["PYTHONPATH"] = os.pathsep.join([folder, str(ROOT)])
        sys.path[:0] = [folder, str(ROOT)]
        task(lambda limit, **what: _say(write, limit, what))
    except BaseException as error:
        _say(write, 60.0, {"error": repr(error)[:1000]})
    finally:
        os._exit(0)


def _say(pipe: int, limit: float, what: dict[str, Any]) -> None:
    os.write(pipe, json.dumps(what | {"limit": limit}).encode() + b"\n")


# ------------------------------------------------------------------------------------------- which tests execute which lines


class Watch:
    """A plugin of pytest: tells which test runs and which fails; of `chosen` {test: seconds} only those, the quickest first.

    Under coverage a line is counted for the test that executes it, and for all of the file where a fixture of wider scope does.
    """

    def __init__(
        self, tell: Tell, *, chosen: dict[str, float] | None = None, file: str = "", cover: Any = None, more: float = 30.0
    ) -> None:
        self.tell, self.chosen, self.file, self.cover, self.more = tell, chosen, file, cover, more
        self.seconds, self.failed, self.now = dict[str, float](), list[str](), file

    def _count_for(self, name: str) -> None:
        if self.cover is not None:
            self.cover.switch_context(name)
            self.cover.set_option("run:context", name)  # of the processes that a test starts
            os.environ["COVERAGE_PROCESS_CONFIG"] = self.cover.config.serialize()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Keep the chosen tests."""
        if self.chosen is not None:
            items[:] = sorted((i for i in items if i.nodeid in self.chosen), key=lambda i: self.chosen[i.nodeid])

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        """Name the test that begins."""
        self.now = item.nodeid
        self.tell(600.0 if self.chosen is None else self.more + 20.0 * self.chosen[self.now], test=self.now)
        self._count_for(self.now)
        result = yield
        self._count_for(self.file)
        return result

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Any:
        """Count what is shared for all."""
        if fixturedef.scope == "function":
            return (yield)
        self._count_for(self.file)
        result = yield
        self._count_for(self.now)
        return result

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note time and failure."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed.append(report.nodeid)
            self.tell(120.0, failed=report.nodeid)


def observe(file: str, folder: Path, tell: Tell) -> None:
    """Run a test file under coverage, and keep {test: seconds}, the failures and {module: {line: tests}} as JSON."""
    import coverage

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    settings = {"data_file": str(folder / "data"), "config_file": str(ROOT / "pyproject.toml")}
    (cover := coverage.Coverage(data_suffix=True, **settings)).start()
    importlib.import_module("rbd")
    watch = Watch(tell, file=file, cover=cover)
    watch._count_for(file)
    pytest.main([file, *QUIET], plugins=[watch])
    cover.stop()
    cover.save()
    whole = coverage.Coverage(**settings)  # with the processes that the tests started
    whole.combine([str(folder)])
    whole.save()
    data = whole.get_data()
    lines = {os.path.relpath(path, ROOT): data.contexts_by_lineno(path) for path in data.measured_files()}
    executed = [path for path, names in lines.items() if any(any(each) for each in names.values())]  # and not imported alone
    found = {"digest": digest(file), "sources": {path: digest(path) for path in executed}, "lines": lines}
    (folder / "map.json").write_text(json.dumps(found | {"seconds": watch.seconds, "failed": watch.failed}))


def digest(*paths: str | Path) -> str:
    """A fingerprint of files, of which those that are not there are left out."""
    there = [ROOT / path for path in sorted(map(str, paths)) if (ROOT / path).is_file()]
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in there)).hexdigest()[:16]


class Map:
    """What each passing test executes and how long it takes; test files that are new or changed are run.

    Attributes:
        seconds: {test: seconds}.
        lines: {module: {line: tests}}, of lines that are executed at import no tests.
    """

    def __init__(self, keep: Path, jobs: int, words: list[str]) -> None:
        self.seconds: dict[str, float] = {}
        self.lines: dict[str, dict[int, set[str]]] = {}
        names = [str(path.relative_to(ROOT)) for path in sorted((ROOT / "tests").glob("**/test_*.py"))]
        folders = {name: keep / name.replace("/", ".") for name in names if not words or any(word in name for word in words)}
        stale = [name for name, folder in folders.items() if not self._read(name, folder)]
        for i, one in enumerate(forks(((name, functools.partial(observe, name, folders[name])) for name in stale), jobs), 1):
            failed = [word["failed"] for word in one.told if "failed" in word]
            well = self._read(one.name, folders[one.name])
            told = [one.fault, *(["not usable"] if not well else []), *(f"fails: {test}" for test in failed)]
            print(f"covered {i} of {len(stale)}: {one.name}", *told, flush=True)

    def _read(self, file: str, folder: Path) -> bool:
        """Take what is known of a test file; False if it is not, or no longer so."""
        path = folder / "map.json"
        found = json.loads(path.read_text()) if path.exists() else {"digest": ""}
        if found["digest"] != digest(file) or any(digest(source) != was for source, was in found["sources"].items()):
            return False
        passing = {test: seconds for test, seconds in found["seconds"].items() if test not in found["failed"]}
        self.seconds |= passing
        for module, lines in found["lines"].items():
            known = self.lines.setdefault(module, {})
            for line, names in lines.items():
                tests = passing if file in names else [name for name in names if name in passing]
                known.setdefault(int(line), set()).update(tests)
        return True

    def tests(self, mutant: Mutant) -> dict[str, float]:
        """{test: seconds} that execute the statement (the module, where it is done at import); the quickest in the budget."""
        names, places = set[str](), reached(mutant)
        for file, wanted in places.items():
            here = self.lines.get(file, {}).items()
            names.update(*(tests for line, tests in here if line in wanted or not wanted))
        if KERNELS in mutant.text:  # thousands: those of the files that name what calls it
            stems = {Path(file).stem for file in places}
            files = {name.split("::")[0] for name in names}
            close = {file for file in files if any(stem in (ROOT / file).read_text(encoding="utf-8") for stem in stems)}
            names = {name for name in names if name.split("::")[0] in close}
        out, total = dict[str, float](), 0.0
        for name in sorted(names, key=lambda name: (self.seconds[name], name)):
            total += self.seconds[name]
            if total < BUDGET_SECONDS:
                out[name] = self.seconds[name]
        return out


def reached(mutant: Mutant) -> dict[str, Any]:
    """{module: lines} whose execution reaches the mutant; no lines: all.

    Coverage does not see compiled functions: for a module of those they are the modules that import it, from others.
    """
    if KERNELS not in mutant.text:
        return {mutant.file: mutant.lines}
    out, kernels = dict[str, Any](), [Path(mutant.file)]
    while kernels:
        name = kernels.pop().stem
        for path in sorted((ROOT / "rbd").glob("**/*.py")):
            file, text = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
            if path.stem != name and file not in out and re.search(rf"import .*\b{name}\b|from rbd\S*\.{name} import", text):
                out[file] = ()
                if KERNELS in text:
                    kernels.append(path)
    return out


# --------------------------------------------------------------------------------------------------------- running the tests

# Found as `sitecustomize` by the processes that tests start, too.
LOADER = """
import importlib.machinery, importlib.util, sys
class Loader(importlib.machinery.SourceFileLoader):
    def get_code(self, name):
        with open({text!r}, encoding="utf-8") as stream:
            return compile(stream.read(), {path!r}, "exec")
class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == {name!r}:
            return importlib.util.spec_from_file_location(name, {path!r}, loader=Loader(name, {path!r}))
sys.meta_path.insert(0, Finder)
"""


def attempt(mutant: Mutant, tests: dict[str, float], tell: Tell) -> None:
    """Load the mutant in place of its module and run the tests until one fails, which is told."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    folder = Path(tempfile.gettempdir())
    (folder / "mutant.txt").write_text(mutant.text, encoding="utf-8")
    name = mutant.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    loader = LOADER.format(text=str(folder / "mutant.txt"), path=str(ROOT / mutant.file), name=name)
    (folder / "sitecustomize.py").write_text(loader, encoding="utf-8")
    if kernel := KERNELS in mutant.text:  # a caller that was compiled before holds the function as it was
        os.environ["NUMBA_CACHE_DIR"] = str(folder / "numba")
    exec(loader, {})
    for first, last in zip((0, *BATCHES), BATCHES, strict=False):
        if batch := list(tests)[first:last]:
            watch = Watch(tell, chosen={name: tests[name] for name in batch}, more=300.0 if kernel else 30.0)
            code = pytest.main(["-x", *QUIET, *dict.fromkeys(name.split("::")[0] for name in batch)], plugins=[watch])
            if code and not watch.failed:
                tell(60.0, failed="the import")
            if code:
                return


def judgement(one: Fork, n: int) -> dict[str, str]:
    """The verdict on a mutant, and the test that it is from."""
    now = next((word["test"] for word in reversed(one.told) if "test" in word), "the import")
    failed = next((word["failed"] for word in one.told if "failed" in word), "")
    if failed or one.fault:
        return {"verdict": "timed out" if one.fault == "late" and not failed else "caught", "by": failed or now}
    return {"verdict": "survived" if n else "uncovered", "by": f"{n} tests"}


def equivalents() -> dict[str, str]:
    """{key: why it is equivalent} of `mutants_equivalent.txt`: blocks of where, "- line", "+ line" and the reason."""
    out = {}
    for block in EQUIVALENT.read_text(encoding="utf-8").split("\n\n")[1:]:
        where, before, after, *why = block.strip().splitlines()
        file, _, function = where.partition(" |")  # of a line of the module itself no function stands there
        out[f"{file} | {function.strip()} | {before[2:]} | {after[2:]}"] = " ".join(why)
    return out


def state(found: dict[str, str]) -> str:
    """The fingerprint of what a verdict depends on."""
    caught = found["verdict"] in ("caught", "timed out")
    every = [*(ROOT / "rbd").glob("**/*.py"), *(ROOT / "tests").glob("**/*.py")]
    return digest(found["file"], found["by"].split("::")[0]) if caught else digest(*every)


def report(mutants: dict[str, Mutant], results: dict[str, dict[str, str]]) -> int:
    """Print each mutant that nothing catches, and the counts; 1 if too few are caught."""
    equivalent = equivalents()
    for key, found in results.items():
        if found["verdict"] in ("survived", "uncovered") and key not in equivalent:
            one = mutants[key]
            print(f"\n{found['verdict']} ({found['by']})\n{one.file} | {one.function}\n- {one.before}\n+ {one.after}")
    counts = Counter(found["verdict"] for found in results.values())
    passed = {key for key, found in results.items() if found["verdict"] in ("survived", "uncovered")}
    caught, same = len(results) - len(passed), len(passed & equivalent.keys())
    told = ", ".join(f"{counts[what]} {what}" for what in ("caught", "timed out", "survived", "uncovered"))
    share = caught / max(len(results) - same, 1)
    print(f"\n{len(results)} mutants: {told}; {same} of them equivalent; of the others {share:.1%} are caught")
    return int(share < ENOUGH)


def main() -> int:
    """Draw, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("n", 300), ("seed", 0), ("jobs", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--places", nargs="+", default=PLACES, help="modules and folders of rbd to draw from")
    parser.add_argument("--tests", nargs="+", default=[], help="only test files whose names hold one of these words")
    parser.add_argument("--line", type=int, default=0, help="only mutants of this line, of the one module in --places")
    parser.add_argument("--keep", type=Path, default=ROOT / ".mutants", help="folder of what was found")
    given = parser.parse_args()
    keep, begin = given.keep.resolve(), time.monotonic()
    keep.mkdir(parents=True, exist_ok=True)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = str(keep / "pycache")
    for name in LOADED_ONCE:
        importlib.import_module(name)
    known = Map(keep, given.jobs, given.tests)
    print(f"{len(known.seconds)} tests of {sum(known.seconds.values()):.0f} s; known after {time.monotonic() - begin:.0f} s")

    whole = [ROOT / "rbd" / place for place in given.places]
    if gone := [str(place) for place in whole if not place.exists()]:
        parser.error(f"there is no {', '.join(gone)}")
    paths = sorted(path for place in whole for path in ([place] if place.suffix else place.glob("**/*.py")))
    sources = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}
    mutants = drawn(given.n, given.seed, sources, given.line)
    results, kept = dict[str, dict[str, str]](), keep / "results.jsonl"
    for found in map(json.loads, kept.read_text().splitlines() if kept.exists() else []):
        if found["key"] in mutants and found["state"] == state(found):
            results[found["key"]] = found
    tests = {key: known.tests(mutant) for key, mutant in mutants.items() if key not in results}
    tasks = ((key, functools.partial(attempt, mutants[key], chosen)) for key, chosen in tests.items())
    try:
        for one in forks(tasks, given.jobs):
            found = {"key": one.name, "file": mutants[one.name].file} | judgement(one, len(tests[one.name]))
            results[one.name] = found | {"state": state(found)}
            with kept.open("a") as stream:
                print(json.dumps(results[one.name]), file=stream)
            print(f"{len(results)} of {len(mutants)} {found['verdict']:9} {one.name:.120}  [{found['by']:.80}]", flush=True)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on from here")
    print(f"after {time.monotonic() - begin:.0f} s")
    return report(mutants, results)


if __name__ == "__main__":
    sys.exit(main())
