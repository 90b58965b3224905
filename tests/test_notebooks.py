"""The notebooks of the examples: all cells run, what is stored is what a fresh run shows, and files stay small."""

from __future__ import annotations

import importlib.util
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from test_readme import TOP, assert_same_text

from rbd.visual import find_browser

FOLDER = TOP / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MOST_BYTES = 1_500_000
NAMES = ["a_mechanism", "a_motion_checked", "standing_and_pushing"]


def runner() -> Any:
    """examples/notebooks/make.py, as a module."""
    spec = importlib.util.spec_from_file_location("notebooks_make", FOLDER / "make.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Words(HTMLParser):
    """The words of an output: rows of tables and paragraphs in lines, without drawings, pages and folded parts."""

    LEFT_OUT = ("svg", "details")

    def __init__(self) -> None:
        super().__init__()
        self.inside = 0
        self.lines = [""]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """A new line, or a part that is left out."""
        self.inside += tag in self.LEFT_OUT
        if tag in ("tr", "p", "div"):
            self.lines.append("")

    def handle_endtag(self, tag: str) -> None:
        """The end of a part that is left out."""
        self.inside -= tag in self.LEFT_OUT

    def handle_data(self, data: str) -> None:
        """Words."""
        if not self.inside:
            self.lines[-1] += f" {data}"


def words(output: dict[str, Any]) -> str:
    """The words of an output, of its HTML where it has that; residuals, which have exponents, are all the same."""
    if output["output_type"] == "stream":
        return "".join(output["text"])
    data = output["data"]
    if "text/html" not in data:
        return "".join(data["text/plain"])
    reader = Words()
    reader.feed("".join(data["text/html"]))
    text = "\n".join(line.strip() for line in reader.lines if line.strip())
    return re.sub(r"\d(\.\d+)?e-\d+", "1e-15", text)


def code(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Its cells with code."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_the_three_notebooks_are_there_and_listed() -> None:
    """In examples/README.md and in the docs."""
    assert [path.stem for path in NOTEBOOKS] == NAMES
    for page in (TOP / "examples" / "README.md", TOP / "docs" / "tasks" / "use_it_in_a_notebook.md"):
        text = page.read_text(encoding="utf-8")
        assert all(f"notebooks/{name}.ipynb" in text for name in NAMES), page


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_fresh_run_shows_what_is_stored(path: Path) -> None:
    """Every cell runs, and shows the same words and numbers as the stored one, residuals and pictures aside."""
    if find_browser() is None:
        pytest.skip("no Chromium on this machine, and the notebooks have pictures")
    stored = runner().read(path)
    fresh = runner().executed(stored)
    for i, (old, new) in enumerate(zip(code(stored), code(fresh), strict=True)):
        assert len(old["outputs"]) == len(new["outputs"]), f"cell {i}: {''.join(old['source'])}"
        for was, found in zip(old["outputs"], new["outputs"], strict=True):
            assert_same_text(words(found), words(was), f"{path.name}, cell {i}")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_a_notebook_of_its_form_and_small(path: Path) -> None:
    """Version 4.5, numbered cells with their own ids, outputs stored, prose before the first code, no place of a machine."""
    notebook = runner().read(path)
    text = path.read_text(encoding="utf-8")
    assert len(text.encode()) < MOST_BYTES
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids) and all(re.fullmatch(r"[\w-]{1,64}", each) for each in ids)
    assert [cell["execution_count"] for cell in code(notebook)] == list(range(1, len(code(notebook)) + 1))
    assert all(cell["outputs"] for cell in code(notebook))
    first = notebook["cells"][0]
    assert first["cell_type"] == "markdown" and first["source"][0].startswith("# ") and "?" in first["source"][0]
    assert str(TOP) not in text and "/tmp/" not in text and "/home/" not in text
    assert json.dumps(notebook, indent=1, ensure_ascii=False) + "\n" == text


def test_the_runner_shows_what_jupyter_shows() -> None:
    """Text and HTML of values are those of IPython's own formatter; prints come first; a semicolon hides the value."""
    formatters = pytest.importorskip("IPython.core.formatters")
    pretty = pytest.importorskip("IPython.lib.pretty")
    make, space = runner(), {"__name__": "__main__"}
    setup = "import rbd\nbox = rbd.load_robot(rbd.robots.catalogue.names()[0])"
    assert make.outputs(setup, space, 1) == []
    for source in ("box", "box.at()", "box.mass", "'a'", "(1, 2)", "rbd.JointLock('a', 'b', position=0.0)"):
        [got] = make.outputs(source, space, 2)
        value = eval(source, space)
        assert "".join(got["data"]["text/plain"]) == pretty.pretty(value)
        html = formatters.HTMLFormatter()(value)
        assert "".join(got["data"].get("text/html", [])) == (html or "")
    assert make.outputs("1 + 1;", space, 3) == [] and make.outputs("None", space, 3) == []
    printed, value = make.outputs("print('x')\n3", space, 4)
    assert printed["text"] == ["x\n"] and value["data"] == {"text/plain": ["3"]}
