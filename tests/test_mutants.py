"""The mutants themselves: every kind is drawn, always the same ones, and one that matters is caught."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import mutants
import pytest
from mutants_drawn import Drawer, drawn, mutated

SCRIPT = Path(mutants.__file__)


def changed_lines(source: str) -> set[str]:
    """All first lines that changes of a module lead to."""
    made = (mutated("module.py", source, change) for change in Drawer(source).found)
    return {mutant.after for mutant in made if mutant}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("x = a + b", {"x = a - b", "x = a", "x = b"}),
        ("x = a - b", {"x = a + b", "x = b - a", "x = a", "x = b"}),
        ("x = (a + b) * c", {"x = (a - b) * c", "x = (a) * c", "x = (b) * c", "x = (a + b) / c", "x = (a + b)", "x = c"}),
        ("x = A @ b", {"x = b @ A", "x = A", "x = b"}),
        ("x = a ** b", {"x = b ** a", "x = a", "x = b"}),
        ("x = -a", {"x = a"}),
        ("x = not a", {"x = a"}),
        ("x = R.T", {"x = R"}),
        ("x = a < 1e-9", {"x = a > 1e-9"}),
        ("x = len(a) <= n", {"x = len(a) > n", "x = len(a) < n"}),
        ("x = a == b", {"x = a != b"}),
        ("x = a is None", {"x = a is not None"}),
        ("x = a and b", {"x = (a or b)", "x = a", "x = b"}),
        ("x = a[1]", {"x = a[2]", "x = a[0]"}),
        ("x = a[:n]", {"x = a[:n - 1]", "x = a[:n + 1]"}),
        ("x = 2.5", {"x = 5.0"}),
        ("x = True", {"x = False"}),
        ("x = min(a)", {"x = max(a)"}),
        ("x = np.abs(a)", {"x = a"}),
        ("x = f(a, b)", {"x = f(b, a)"}),
        ("x = a if b else c", {"x = c if b else a"}),
        ("x += a", {"pass", "x -= a"}),
        ("f(a)", {"pass"}),
    ],
)
def test_every_kind_of_slip_is_made(line: str, expected: set[str]) -> None:
    """Of one line all the changes that the docstring lists, and no others."""
    assert changed_lines(f"def f():\n    {line}\n") == expected


def test_messages_annotations_and_tolerances_are_left_alone() -> None:
    """A change there is none of behaviour."""
    source = """
@cache(maxsize=3)
def f(x: Array[3]) -> Array[3]:
    assert x > 0, "more than 1"
    y: list[3]
    if g():
        raise ValueError(f"{x + 1} of {2 * x}")
    return 1e-9, zip(x, strict=True)
"""
    assert changed_lines(source) == set()


def test_a_mutant_is_always_the_same_and_is_code() -> None:
    """By seed; those of a larger number begin with those of a smaller one; the lines of a statement are known."""
    sources = {str(path.relative_to(mutants.ROOT)): path.read_text() for path in (mutants.ROOT / "rbd" / "planar").glob("*.py")}
    once, more, other = drawn(30, 4, sources), drawn(60, 4, sources), drawn(30, 5, sources)
    assert list(once.items()) == list(more.items())[:30] and once.keys() != other.keys()
    for mutant in more.values():
        ast.parse(mutant.text)
        assert mutant.text != sources[mutant.file] and mutant.before != mutant.after
        inside = sources[mutant.file].splitlines()[mutant.lines.start - 1 : mutant.lines.stop - 1]
        assert not mutant.lines or mutant.before in {line.strip() for line in inside}


def test_judgements_are_of_code_that_is_there() -> None:
    """Each has a reason, and a line that stands in the function it names; remove it when the line changes."""
    for key, why in mutants.equivalents().items():
        file, function, before, _ = key.split(" | ")
        source = (mutants.ROOT / file).read_text()
        assert before in {line.strip() for line in source.splitlines()}, f"no longer there: {key}"
        assert not function or f"{function.split('.')[-1]}" in source
        assert len(why) > 10, key


def test_mutants_are_caught_and_kept(tmp_path: Path, exhaustive: bool) -> None:
    """Four of the cones by one test file: most are caught, the verdicts are kept, and a second run has nothing to do."""
    if not exhaustive:
        pytest.skip("two thirds of a minute: run by `make exhaustive`")
    command = [sys.executable, str(SCRIPT), "--n", "4", "--seed", "1", "--jobs", "1", "--places", "problem/cones.py"]
    command += ["--tests", "test_cones", "--keep", str(tmp_path)]
    first = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "4 of 4 " in first.stdout and "4 mutants: " in first.stdout, first.stdout + first.stderr
    assert int(first.stdout.split("4 mutants: ")[1].split()[0]) >= 2, first.stdout
    again = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "4 of 4 " not in again.stdout and "4 mutants: " in again.stdout, again.stdout + again.stderr
    assert "covered" not in again.stdout.replace("uncovered", "")
