"""The quick tests on every Python that is installed, each in an environment of its own; for `make pythons`.

Printed is a table: the version, what was installed, how many tests passed. The exit code is 1 where a test fails, or where a
version that `pyproject.toml` names was not run: its classifiers claim no more than this shows.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
MINORS = range(11, 16)
NEEDED = ("pytest>=8", "pytest-xdist>=3.6", "sympy>=1.13", "mujoco>=4", "matplotlib>=3.9", "gymnasium>=1.1")
"""Besides the package itself; what has no wheel for a Python is left out, and said."""
_VERSION = "import sys; print(*sys.version_info[:3], sep='.')"
_PASSED = re.compile(r"\b(\d+) (passed|failed|error|skipped)")


@dataclass(frozen=True)
class Ran:
    """What one Python did.

    Attributes:
        version: As "3.12.1".
        outcome: The last line of pytest, or why it was not run.
        ok: Whether all tests passed.
        seconds: Of the tests [s].
    """

    version: str
    outcome: str
    ok: bool
    seconds: float = 0.0

    @property
    def minor(self) -> str:
        """As "3.12"."""
        return ".".join(self.version.split(".")[:2])

    def __str__(self) -> str:
        """A line of the table."""
        return f"{self.version:8} {'ran' if self.ok else 'FAILED':7} {self.outcome}, {self.seconds:.0f} s"


def installed() -> dict[str, Path]:
    """{version: interpreter}, the newest of each minor version, from PATH and from pyenv's folder of versions."""
    pyenv = Path(os.environ.get("PYENV_ROOT", "~/.pyenv")).expanduser() / "versions"
    folders = [*map(Path, os.environ.get("PATH", "").split(os.pathsep)), *sorted(pyenv.glob("*/bin"))]
    found: dict[str, tuple[tuple[int, ...], Path]] = {}
    for path in (folder / f"python3.{minor}" for minor in MINORS for folder in folders):
        version = version_of(path)
        if version:
            minor, order = version.rpartition(".")[0], tuple(map(int, version.split(".")))
            if minor not in found or order > found[minor][0]:
                found[minor] = order, path
    return {".".join(map(str, order)): path for order, path in found.values()}


def version_of(python: Path) -> str:
    """As "3.12.1"; empty where it does not run, as pyenv's links to versions that are not chosen, or has no `venv`."""
    if not os.access(python, os.X_OK):
        return ""
    done = subprocess.run([python, "-c", f"import ensurepip, venv; {_VERSION}"], capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else ""


def claimed(project: Path = TOP / "pyproject.toml") -> list[str]:
    """Minor versions in the classifiers, as "3.12"."""
    listed = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["classifiers"]
    return [line.rpartition(" ")[2] for line in listed if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", line)]


def run(python: Path, version: str, folder: Path, tests: Sequence[str], workers: str) -> Ran:
    """Run the tests in the environment of a version, which is made and kept in the folder."""
    own = folder / version.rpartition(".")[0]
    bin_ = own / "bin" / "python"
    if version_of(bin_) != version:
        subprocess.run([python, "-m", "venv", "--clear", own], check=True)
    pip = [bin_, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    made = subprocess.run([*pip, "-e", str(TOP), *NEEDED[:2]], capture_output=True, text=True)
    if made.returncode:
        return Ran(version, f"not installed: {(made.stderr.strip().splitlines() or ['?'])[-1]:.160}", False)
    one = [*pip, "--only-binary", ":all:"]
    left = [name for name in NEEDED[2:] if subprocess.run([*one, name], capture_output=True).returncode]
    start = time.perf_counter()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [bin_, "-m", "pytest", "-p", "no:cacheprovider", "-n", workers, *tests]
    done = subprocess.run(command, cwd=TOP, env=environment, capture_output=True, text=True)
    counts = ", ".join(f"{n} {what}" for n, what in _PASSED.findall(done.stdout.strip().rpartition("\n")[2]))
    if done.returncode:
        sys.stderr.write(done.stdout[-6000:] + done.stderr[-2000:])
    without = f" (no wheel of {', '.join(left)})" if left else ""
    return Ran(version, (counts or "no test ran") + without, done.returncode == 0, time.perf_counter() - start)


def judged(ran: Iterable[Ran], claims: Sequence[str]) -> list[str]:
    """What is wrong: versions that failed, that are claimed and were not run, and that ran and are not claimed."""
    known = {each.minor: each.ok for each in ran}
    wrong = [f"{minor}: tests fail" for minor, ok in known.items() if not ok]
    wrong += [f"{minor}: claimed by a classifier, and not run here" for minor in claims if minor not in known]
    return wrong + [f"{minor}: runs, and no classifier says so" for minor, ok in known.items() if ok and minor not in claims]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tests", nargs="+", help="files of tests")
    parser.add_argument("--folder", type=Path, default=TOP / ".venv" / "pythons", help="where the environments are kept")
    parser.add_argument("--only", nargs="+", metavar="3.N", help="these versions alone")
    parser.add_argument("-n", "--workers", default="auto", help="processes of pytest")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    there = installed().items()
    pythons = {version: path for version, path in there if not given.only or version.rpartition(".")[0] in given.only}
    print(f"{platform.system()} {platform.machine()}; found {', '.join(pythons) or 'no Python'}", flush=True)
    ran = []
    for version, path in sorted(pythons.items(), key=lambda each: int(each[0].split(".")[1])):
        ran.append(run(path, version, folder, given.tests, given.workers))
        print(ran[-1], flush=True)
    wrong = judged(ran, [minor for minor in claimed() if not given.only or minor in given.only])
    print(*wrong, sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
