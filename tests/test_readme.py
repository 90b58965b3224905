"""The README runs: its code prints what it says, its commands exist, its links lead somewhere.

Also the tools for `test_docs` and `test_examples`: `blocks`, `run_page`, `assert_same_text`.
"""

import contextlib
import io
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parent.parent
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
NOISE = 1e-8
"""Numbers printed with an exponent are residuals: both sides must be below this."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page and the line it starts on."""

    language: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a Markdown page, in order."""
    found, language, start, lines = [], None, 0, []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if line.startswith("```") and language is None:
            language, start, lines = line[3:].strip(), number, []
        elif line.startswith("```"):
            found.append(Block(language, "\n".join(lines), start))
            language = None
        elif language is not None:
            lines.append(line)
    assert language is None, f"{page.name}: the block of line {start} is not closed"
    return found


def run_page(page: Path) -> int:
    """Run a page's Python blocks in one namespace, comparing each with the text block right after it; how many ran."""
    names, found, ran = {"__name__": page.stem}, blocks(page), 0
    for i, block in enumerate(found):
        if block.language != "python":
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * block.line + block.text, str(page), "exec"), names)
        ran += 1
        if i + 1 < len(found) and found[i + 1].language == "text":
            assert_same_text(printed.getvalue(), found[i + 1].text, f"{page.name}, line {found[i + 1].line}")
    return ran


def assert_same_text(printed: str, expected: str, where: str) -> None:
    """The same words, and numbers that agree to one and a half units of the last digit shown.

    Spaces and rounding may differ between machines; a number with an exponent is a residual and has to be small.
    """
    got, want = printed.strip().splitlines(), expected.strip().splitlines()
    for given, shown in zip(got, want, strict=False):
        skeletons = [" ".join(NUMBER.sub("#", line).split()) for line in (given, shown)]
        assert skeletons[0] == skeletons[1], f"{where}: prints\n  {given}\nwhere the page shows\n  {shown}"
        for a, b in zip(NUMBER.findall(given), NUMBER.findall(shown), strict=True):
            assert _agree(a, b), f"{where}: prints {a} where the page shows {b}, in\n  {given}"
    assert len(got) == len(want), f"{where}: prints {len(got)} lines, the page shows {len(want)}:\n{printed}"


def _agree(a: str, b: str) -> bool:
    if "e" in a or "e" in b:
        tolerance = a == b and re.fullmatch(r"1e-\d+", a)  # what was given, and no residual
        return bool(tolerance) or abs(float(a)) < NOISE and abs(float(b)) < NOISE
    digits = len(b.partition(".")[2])
    return abs(float(a) - float(b)) <= 1.5 * 10.0**-digits if digits else abs(float(a) - float(b)) <= 1.0


def headings(page: Path) -> set[str]:
    """Anchors that GitHub makes of a page's headings."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}


def broken_links(page: Path) -> list[str]:
    """Relative links of a page that lead nowhere."""
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.is_file() or (anchor and anchor not in headings(file)):
            broken.append(target)
    return broken


def test_the_readme_prints_what_it_shows():
    """The blocks run in order, in one namespace, and their output is the one on the page."""
    assert run_page(TOP / "README.md") >= 1


def test_the_first_screen_comes_first():
    """A moving picture of 2 MB at most, how to install, ten lines of code with their answer, what to call, limits, speed."""
    text = (TOP / "README.md").read_text(encoding="utf-8")
    marks = ("docs/pictures/walking.gif", "## Install", "make demo", "make test", "```python", "```text")
    order = [text.index(mark) for mark in (*marks, "| you want to | call |", "## Limits", "## Speed")]
    assert order == sorted(order)
    first = next(block for block in blocks(TOP / "README.md") if block.language == "python")
    assert len([line for line in first.text.splitlines() if line.strip()]) <= 10
    assert (TOP / "docs" / "pictures" / "walking.gif").stat().st_size <= 2_000_000


def test_the_readme_is_short():
    """At most 700 words beside its code, tables counted."""
    text = re.sub(r"```.*?```", "", (TOP / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(text.split()) <= 700


def test_the_limits_are_those_of_the_site():
    """README has five of them and a link to docs/reference/limits.md, which has all: what README sets in bold stands there."""
    readme = (TOP / "README.md").read_text(encoding="utf-8")
    few = readme.split("\n## Limits\n")[1].split("\n## ")[0]
    page = (TOP / "docs" / "reference" / "limits.md").read_text(encoding="utf-8").lower()
    assert few.count("\n- ") == 5 and "](docs/reference/limits.md)" in few
    missing = [bold for bold in re.findall(r"\*\*(.+?)\*\*", few) if bold.lower() not in page]
    assert missing == [] and page.count("\n- ") > 5


def test_the_readme_links_lead_somewhere():
    """Every page and picture named is in the repository."""
    assert broken_links(TOP / "README.md") == []


def commands() -> list[str]:
    """The README's shell commands."""
    lines = [line for block in blocks(TOP / "README.md") if block.language == "sh" for line in block.text.splitlines()]
    return [command for line in lines if (command := line.partition("#")[0].strip())]


def test_the_make_targets_exist():
    """`make demo`, `make test` and what else the README names are rules of the Makefile."""
    text = (TOP / "README.md").read_text(encoding="utf-8")
    wanted = re.findall(r"(?:^|`)make (\w+)", text, flags=re.MULTILINE)
    rules = re.findall(r"^([\w-]+)\s*:", (TOP / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert {"demo", "test"} <= set(wanted) <= set(rules)


def test_the_command_line_knows_the_options():
    """Every option that the README uses is in the command's help."""
    from typer.testing import CliRunner

    from rbd.cli.app import app

    lines = [command.split() for command in commands() if command.startswith("rbd ")]
    assert lines
    for _, verb, *rest in lines:
        shown = CliRunner().invoke(app, [verb, "--help"], env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
        assert shown.exit_code == 0, shown.output
        text = re.sub(r"\x1b\[[0-9;]*m", "", shown.output)
        for option in (word for word in rest if word.startswith("--")):
            assert option in text, f"rbd {verb} has no {option}"


@pytest.mark.parametrize(
    ("printed", "expected", "same"),
    [
        ("1.2340 N", "1.2341 N", True),
        ("1.2340 N", "1.2344 N", False),
        ("-0.000 m", "0.000 m", True),
        ("r 1.0e-13", "r 7.1e-12", True),
        ("r 1.0e-3", "r 7.1e-12", False),
        ("left 1.0", "right 1.0", False),
        ("12 rows", "14 rows", False),
        ("a\nb", "a", False),
    ],
)
def test_texts_are_compared_as_a_reader_would(printed, expected, same):
    """Words must agree, numbers to their last digit, residuals must be small."""
    if same:
        assert_same_text(printed, expected, "here")
    else:
        with pytest.raises(AssertionError):
            assert_same_text(printed, expected, "here")
