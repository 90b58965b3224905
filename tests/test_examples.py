"""The examples run headless, their checks hold, and they print what examples/README.md shows."""

import contextlib
import importlib
import io
import re
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from test_readme import TOP, assert_same_text

EXAMPLES = sorted((TOP / "examples").glob("[0-9][0-9]_*.py"))


def shown(page: Path) -> dict[str, str]:
    """{example: the text block in its section of examples/README.md}."""
    sections = re.split(r"^## ", page.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    found = {}
    for section in sections:
        file, text = re.search(r"(\d\d_\w+)\.py", section), re.search(r"```text\n(.*?)```", section, flags=re.DOTALL)
        if file and text:
            found[file[1]] = text[1]
    return found


@cache
def run(example: Path) -> tuple[ModuleType, Any, str]:
    """(module, result, what it printed) of an example run once, without pictures."""
    sys.path.insert(0, str(example.parent))
    try:
        module = importlib.import_module(example.stem)
    finally:
        sys.path.remove(str(example.parent))
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        result = module.main(show=False)
    return module, result, printed.getvalue()


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_prints_its_answer_and_checks_it(example):
    """main(show=False) opens and writes nothing; check(result) raises where a law is broken."""
    module, result, printed = run(example)
    module.check(result)
    page = TOP / "examples" / "README.md"
    assert_same_text(printed, shown(page)[example.stem], f"examples/README.md, {example.stem}")


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_is_short_and_asks_a_question(example):
    """40 to 150 lines, the question in the docstring."""
    text = example.read_text(encoding="utf-8")
    assert 40 <= len(text.splitlines()) <= 150
    assert "?" in text.split('"""')[1]


def test_the_plot_of_the_push_is_drawn_on_the_axes_given():
    """Axes in, artists out: two feet and the force at which the robot tips, no global state."""
    from matplotlib.figure import Figure

    module, result, _ = run(TOP / "examples" / "02_push.py")
    axes = Figure().subplots()
    artists = module.plot_push(axes, result)
    assert len(artists) == 3 and all(artist.axes is axes for artist in artists)
    assert "[N]" in axes.get_xlabel() and "[N]" in axes.get_ylabel()
    assert "pyplot" not in Path(module.__file__).read_text(encoding="utf-8")


def test_the_torques_of_the_crouch_are_drawn(tmp_path, monkeypatch):
    """main(show=True) writes one picture, into out/."""
    module, _, _ = run(TOP / "examples" / "25_torques_of_a_crouch.py")
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(io.StringIO()):
        module.main(show=True)
    (picture,) = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert picture.read_bytes().startswith(b"\x89PNG")
