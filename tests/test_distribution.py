"""What is said of installing: extras, classifiers, the recipe for conda, and the script that tries every Python."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pythons
import yaml

import rbd

TOP = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
_NAME = re.compile(r"[\w.-]+")
CONDA = {"pin": "pinocchio"}
"""Names that conda-forge has for packages of pip's."""


def test_condas_recipe_asks_for_what_pyproject_asks_for():
    """The same packages, bounds, version, command and licence."""
    recipe = yaml.safe_load((TOP / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    asked = [line for line in recipe["requirements"]["run"] if not line.startswith("python ")]
    wanted = {_NAME.match(line)[0]: line for line in PROJECT["dependencies"]}  # type: ignore[index]
    assert [line.replace(" ", "") for line in asked] == [
        line.replace(name, CONDA.get(name, name), 1) for name, line in wanted.items()
    ]
    assert f"python {PROJECT['requires-python']}" in recipe["requirements"]["run"]
    assert recipe["context"]["version"] == rbd.__version__ and recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["about"]["license"] == PROJECT["license"] and all(
        (TOP / f).is_file() for f in recipe["about"]["license_file"]
    )
    assert recipe["build"]["python"]["entry_points"] == [f"rbd = {PROJECT['scripts']['rbd']}"]


def test_every_extra_that_a_message_or_a_page_names_is_there():
    """And `all` has what users may want, without tools of developers and without Drake, which has wheels for few machines."""
    extras = PROJECT["optional-dependencies"]
    texts = [path.read_text(encoding="utf-8") for where in ("rbd", "docs") for path in (TOP / where).rglob("*.py")]
    texts += [path.read_text(encoding="utf-8") for path in (TOP / "docs").rglob("*.md")]
    named = {name for text in texts for names in re.findall(r"rbd-contact\[([a-z,]+)\]", text) for name in names.split(",")}
    assert {"plot", "symbolic", "study"} <= named <= set(extras)
    (everything,) = extras["all"]
    assert set(everything.partition("[")[2].rstrip("]").split(",")) == set(extras) - {"all", "drake", "docs", "test", "dev"}


def test_classifiers_are_what_ran(tmp_path: Path):
    """A failure, a version that is claimed and missing, and one that runs unclaimed are each told."""
    ran = [pythons.Ran("3.11.7", "300 passed", True), pythons.Ran("3.12.1", "1 failed", False), pythons.Ran("3.14.0", "", True)]
    assert pythons.judged(ran[:1], ["3.11"]) == []
    assert pythons.judged(ran, ["3.11", "3.13"]) == [
        "3.12: tests fail", "3.13: claimed by a classifier, and not run here", "3.14: runs, and no classifier says so",
    ]  # fmt: skip
    project = tmp_path / "pyproject.toml"
    project.write_text(
        '[project]\nclassifiers = ["Programming Language :: Python :: 3", "Programming Language :: Python :: 3.12"]\n'
    )
    assert pythons.claimed(project) == ["3.12"]
    assert "3.11" in pythons.claimed()


def test_a_python_is_told_by_running_it(tmp_path: Path):
    """Pyenv's links to versions that are not chosen fail, and are none."""
    fake = tmp_path / "python3.12"
    fake.write_text("#!/bin/sh\nexit 127\n")
    fake.chmod(0o755)
    assert pythons.version_of(fake) == "" and pythons.version_of(tmp_path / "none") == ""
