"""The wheel that is built from this tree: what is in it, and that it works away from the checkout."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import rbd

TOP = Path(__file__).resolve().parents[1]
EXAMPLES = sorted(path.stem for path in (TOP / "examples").glob("[0-9][0-9]_*.py"))
FEW = ("01_stand", "12_unicycle")
"""Examples that are run in every test; the others by `make exhaustive`."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    build = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    run = subprocess.run([sys.executable, "-c", build, str(folder)], cwd=TOP, capture_output=True, text=True, check=True)
    return folder / run.stdout.split()[-1]


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """A folder with what the wheel installs, the examples beside it, and no checkout above it.

    Functions that are compiled in the checkout are not compiled again: they are known by their content.
    """
    folder = wheel.parent / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    for path in (TOP / "rbd").rglob("*.nb[ic]"):
        copy = folder / path.relative_to(TOP)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(path, copy)
    (folder / "examples").symlink_to(TOP / "examples")
    return folder


def run(installed: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Python in a folder of its own, where only the wheel's `rbd` is found."""
    own = installed / "work"
    own.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(installed), "COLUMNS": "120"}
    return subprocess.run([sys.executable, *command], cwd=own, env=environment, capture_output=True, text=True)


def test_the_wheel_holds_the_package_and_its_mechanisms(wheel: Path):
    """And no tests, under the distribution's name; the version is that of the code."""
    assert wheel.name.startswith(f"rbd_contact-{rbd.__version__}-py3-none-any")
    assert f"\nversion: {rbd.__version__}\n" in (TOP / "CITATION.cff").read_text(encoding="utf-8")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"rbd/py.typed", "rbd/robots/data/robots.toml", "rbd/robots/urdf/four_bar.urdf"} <= names
    models = [path for path in (TOP / "urdf").iterdir() if path.suffix in (".urdf", ".yaml", ".md")]
    assert {f"rbd/robots/urdf/{path.name}" for path in models} <= names and "rbd/robots/urdf/make.py" not in names
    assert not [name for name in names if not re.match(r"rbd(_contact-[^/]*)?/", name)]


def test_wheel_and_sdist_hold_all_that_the_package_reads(wheel: Path, tmp_path: Path):
    """Every file of the package but caches is in both; the viewer's licences are in the wheel's metadata."""
    build = "import sys; from hatchling.build import build_sdist; print(build_sdist(sys.argv[1]))"
    run = subprocess.run([sys.executable, "-c", build, str(tmp_path)], cwd=TOP, capture_output=True, text=True, check=True)
    with tarfile.open(tmp_path / run.stdout.split()[-1]) as archive:
        inside = {name.partition("/")[2]: name for name in archive.getnames()}
    files = {path.relative_to(TOP).as_posix() for path in (TOP / "rbd").rglob("*") if path.is_file()}
    needed = {name for name in files if "__pycache__" not in name}
    names = set(zipfile.ZipFile(wheel).namelist())
    assert "rbd/visual/pages/web/viewer/viewer.min.js" in needed and needed <= names and needed <= set(inside)
    assert {"pyproject.toml", "README.md", "urdf/four_bar.urdf", "tests/test_wheel.py"} <= set(inside)
    licences = [name for name in names if ".dist-info/licenses/" in name]
    assert len(licences) == 3 and [sum(f"web/{of}" in name for name in licences) for of in ("viewer", "uplot")] == [1, 1]


def test_mechanisms_load_by_name_from_the_wheel(installed: Path):
    """From the wheel's own folder."""
    code = "import rbd; r = rbd.load_robot('four_bar'); print(rbd.__file__, r.urdf, len(r.loops()), sep='\\n')"
    found = run(installed, "-c", code)
    package, urdf, loops = found.stdout.split("\n")[:3]
    assert Path(package).is_relative_to(installed) and Path(urdf).is_relative_to(installed) and loops == "1", found.stderr


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_runs_away_from_the_checkout(example: str, installed: Path, exhaustive: bool):
    """It prints something and ends well."""
    if example not in FEW and not exhaustive:
        pytest.skip("run by `make exhaustive`")
    code = f"import sys; sys.path.insert(0, {str(installed / 'examples')!r}); import importlib; "
    code += f"m = importlib.import_module({example!r}); m.check(m.main(show=False))"
    found = run(installed, "-W", "ignore", "-c", code)
    assert found.returncode == 0 and found.stdout.strip(), found.stderr
