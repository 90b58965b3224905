"""The pages hold: their code runs, and every function, test, link and reference they name exists."""

import importlib
import importlib.util
import re
import runpy
import sys
from pathlib import Path

import pytest
from test_readme import TOP, blocks, broken_links, run_page

PAGES = sorted(page for page in (TOP / "docs").rglob("*.md") if "_build" not in page.parts)
PAGES += [TOP / "examples" / "README.md", TOP / "CHANGELOG.md"]
COURSES = ("least_constraint", "planar_chains", "velocity_constraints")
DERIVED = [TOP / "docs" / "reference" / page for page in ("theory.md", "control.md", "walking.md")]
"""Pages whose equations name what computes and what tests them: theory, control, walking, and all pages of the courses."""
for course in COURSES:
    DERIVED += [page for page in sorted((TOP / "docs" / "courses" / course).glob("*.md")) if page.stem != "index"]
WITH_CODE = [page for page in PAGES if any(block.language == "python" for block in blocks(page))]


def name_of(page: Path) -> str:
    return str(page.relative_to(TOP))


def in_code(page: Path) -> set[str]:
    """What a page sets in backquotes outside its fenced blocks, and all of it in its Tests lines."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return set(re.findall(r"`([^`\n]+)`", text))


def prose(text: str) -> int:
    """Words of a page that are read: without code, formulas and addresses of links."""
    text = re.sub(r"^(`{3,})[^\n]*\n.*?^\1\s*$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$", "", text, flags=re.DOTALL)
    text = re.sub(r"`[^`]*`|\$[^$]*\$", "x", re.sub(r"\]\([^)]*\)", "]", text))
    return len(re.findall(r"[A-Za-z][A-Za-z'’-]*", text))


def test_the_pages_are_as_short_as_they_are_meant_to_be():
    """80,000 words together, with what is not a page of the site: who reads one, finds what is said once."""
    assert prose("One `two` $three$ [four](five.md)\n```python\nsix\n```\n$$ seven $$ eight's") == 5
    pages = [*PAGES, TOP / "README.md", TOP / "CONTRIBUTING.md", TOP / "urdf" / "README.md"]
    assert sum(prose(page.read_text(encoding="utf-8")) for page in pages) <= 80_000


@pytest.mark.parametrize("page", WITH_CODE, ids=name_of)
def test_the_code_of_the_page_prints_what_it_shows(page):
    """Python blocks run in order, in one namespace, and print the text block that follows them."""
    assert run_page(page) > 0


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_names_on_the_page_exist(page):
    """Every `rbd.some.name` is a module, a function, a class, or a member or field of one."""
    wrong = [name for name in in_code(page) if re.fullmatch(r"rbd(\.\w+)+", name) and not resolves(name)]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_tests_on_the_page_exist(page):
    """Every `tests/file.py::test_name` is a test in that file."""
    missing = []
    for named in in_code(page):
        if found := re.fullmatch(r"(tests/[\w/]+\.py)(?:::(\w+))?", named):
            file, test = TOP / found[1], found[2]
            text = file.read_text(encoding="utf-8") if file.is_file() else ""
            if not re.search(rf"^\s*def {test or 'test_'}", text, flags=re.MULTILINE):
                missing.append(named)
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_links_of_the_page_lead_somewhere(page):
    """Relative links lead to files and headings of the repository."""
    assert broken_links(page) == []


def unnamed(text: str) -> list[str]:
    """Paragraphs after a block of mathematics that name no function and test, nor say what it follows from or defines."""
    missing = []
    parts = re.split(r"^```math\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)[1:]
    for equation, after in zip(parts[::2], parts[1::2], strict=True):
        paragraph = after.strip().split("\n\n")[0].replace("\n", " ")
        named = re.match(r"In code: `rbd\.[\w.]+`", paragraph) and re.search(r"Tests: `tests/[\w/]+\.py::test_\w+`", paragraph)
        # A definition has the symbol that it defines on the left of the block's first equals sign.
        symbol = re.match(r"This defines \$([^$]+)\$", paragraph)
        defined = symbol and equation.split("=")[0].strip() == symbol[1]
        if not named and not defined and not re.match(r"It follows (from|by|that) \S", paragraph):
            missing.append(paragraph)
    return missing


@pytest.mark.parametrize("page", DERIVED, ids=name_of)
def test_every_equation_names_its_function_and_its_test(page: Path):
    """After a block of mathematics come `In code:` and `Tests:`, or in a derivation what it follows from."""
    assert unnamed(page.read_text(encoding="utf-8")) == []


def test_the_theory_names_more_than_it_derives():
    """All equations of the reference are computed somewhere; pages of courses name one at least."""
    for page in DERIVED:
        text = page.read_text(encoding="utf-8")
        named, equations = text.count("\nIn code: `rbd."), len(re.findall("^```math$", text, flags=re.MULTILINE))
        assert named >= (equations if page.stem == "theory" else 1), page


def test_equations_that_name_nothing_are_noticed():
    """The check of equations can fail: neither a name alone, nor a derivation without a reason, is enough."""
    named = "In code: `rbd.solve`. Tests: `tests/test_docs.py::test_x`."
    for after in (named, "It follows from the first.", "It follows\nby the chain rule.", "This defines\n$a$, a length."):
        assert unnamed(f"```math\na = b\n```\n\n{after}\n") == []
    half = ("In code: `rbd.solve`.", "Tests: `tests/test_docs.py::test_x`.")
    for after in (*half, "It follows.", "So it is.", "Then. It follows from it.", "This defines it.", "This defines $b$."):
        assert unnamed(f"```math\na = b\n```\n\n{after}\n\n{named}\n") == [after]


def test_every_reference_is_in_the_bibliography():
    """Keys cited in pages and docstrings are in docs/references.bib, each once, and none is there for nothing."""
    bibliography = (TOP / "docs" / "references.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),", bibliography, flags=re.MULTILINE)
    assert len(keys) == len(set(keys))
    cited = set()
    for file in [*PAGES, TOP / "README.md", *(TOP / "rbd").rglob("*.py")]:
        cited |= set(re.findall(r"\[([A-Z][A-Za-z]+(?:\d{4}|Motion|Multiplier))\]", file.read_text(encoding="utf-8")))
    assert cited == set(keys)


def test_the_notation_opens_with_the_conventions():
    """The title, then three lines: the world's axes, the order of vectors, the sign of a force."""
    title, blank, *first = (TOP / "docs" / "reference" / "notation.md").read_text(encoding="utf-8").splitlines()[:5]
    assert (title, blank) == ("# Notation", "")
    for line, words in zip(first, (("World", "z up"), ("linear first", "x, y, z, w"), ("to the robot",)), strict=True):
        assert all(word in line for word in words), line


def resolves(name: str) -> bool:
    """Whether a dotted name leads to something, through modules, attributes and documented fields."""
    first, *rest = name.split(".")
    value = importlib.import_module(first)
    for i, part in enumerate(rest):
        if hasattr(value, part):
            value = getattr(value, part)
        elif hasattr(value, "__path__") and importlib.util.find_spec(".".join([first, *rest[: i + 1]])):
            value = importlib.import_module(".".join([first, *rest[: i + 1]]))
        else:
            # Fields without a default and what __init__ sets are no attributes of a class: its docstring lists them.
            listed = [re.findall(r"^ +(\w+):", c.__doc__ or "", re.MULTILINE) for c in getattr(value, "__mro__", ())]
            fields = [list(getattr(c, "__annotations__", ())) for c in getattr(value, "__mro__", ())]
            return i == len(rest) - 1 and part in {n for names in listed + fields for n in names}
    return True


def test_names_that_do_not_exist_are_noticed():
    """The check of names above can fail."""
    assert resolves("rbd.State.q") and resolves("rbd.dynamics.coriolis_tensor") and resolves("rbd.Rows.J")
    assert not resolves("rbd.dynamics.coriolis_tensors") and not resolves("rbd.State.quaternion_of_nobody")


def test_the_table_of_rooms_is_that_of_the_code(monkeypatch: pytest.MonkeyPatch):
    """docs/architecture.md lists every room with the first line of its docstring: `python docs/pictures/architecture.py`."""
    script = TOP / "docs" / "pictures" / "architecture.py"
    monkeypatch.setattr(sys, "argv", [str(script), "--check"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(script), run_name="__main__")
    assert end.value.code == 0, "the table is not that of the code: python docs/pictures/architecture.py"
