"""Every public name says in one line what it is or gives, and shows it in an example that prints what stands below it."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest

import rbd
from rbd.robots import loop_file

PACKAGES = [
    "rbd",
    *(f"rbd.{module.name}" for module in iter_modules(rbd.__path__) if module.ispkg),
    *("rbd.answers.analysis", "rbd.answers.many", "rbd.answers.prepared", "rbd.constraints.forces"),
    *("rbd.audits.bench", "rbd.mechanism.small_motion", "rbd.motion.identification"),
    "rbd.dynamics",
]
SHOWN = [package for package in PACKAGES if package not in ("rbd.answers", "rbd.cli", "rbd.answers.prepared")]
"""Those that list names for users; the last is a module."""
BROWSER = {
    *("Browser", "contact_sheet", "export_video", "find_browser", "motion_sheet", "replay"),
    "screenshot",
}
"""Of `rbd.visual`: what wants a browser on this machine, whose calls are not run here but in `tests/visual`."""
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
SECTION = re.compile(r"^(Args|Attributes|Example|Raises|Returns|Source|Yields):", re.MULTILINE)


@cache
def documented(package: str) -> dict[str, object]:
    """{full name: class or function} of a package's `__all__`; what another package lists too is the first one's."""
    module = rbd.dynamics if package == "rbd.dynamics" else importlib.import_module(package)
    listed = {f"{package}.{name}": getattr(module, name) for name in getattr(module, "__all__", ())}
    earlier = [each for other in PACKAGES[: PACKAGES.index(package)] for each in documented(other).values()]
    return {
        name: each
        for name, each in listed.items()
        if (inspect.isclass(each) or inspect.isfunction(each)) and not any(each is other for other in earlier)
    }


def text(each: object) -> str:
    """Its own docstring, and not that of a base class or of a dataclass without one."""
    own = vars(each).get("__doc__") if inspect.isclass(each) else getattr(each, "__doc__", None)
    return inspect.cleandoc(own or "")


def example(each: object) -> str:
    """The section `Example:` of its docstring, without the heading; empty without one."""
    _, heading, rest = text(each).partition("\nExample:\n")
    after = SECTION.search(rest)
    return textwrap.dedent(rest[: after.start()] if heading and after else rest)


def plain(printed: str) -> str:
    """Without the signs of zeros, and spaces inside brackets that make room for them."""
    return re.sub(r"(?<=\[)\s+|\s+(?=\])", "", re.sub(r"-(0\.0*)(?![0-9e])", r"\1", printed))


class Checker(doctest.OutputChecker):
    """Compares what is printed with zeros of either sign as equal."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        """Whether what was printed is what the example shows."""
        return super().check_output(plain(want), plain(got), optionflags)


def faults(name: str, each: object) -> Iterator[str]:
    """What is wrong with an example: nothing shown, or something else printed."""
    lines = doctest.DocTestParser().get_doctest(example(each), {"rbd": rbd, "np": np}, name, None, 0)
    skipped = [line for line in lines.examples if doctest.SKIP in line.options]
    if bool(skipped) != (name.rpartition(".")[2] in BROWSER):
        yield f"{name}: lines are skipped where, and only where, they want a browser"
    if not any(line.want for line in lines.examples if line not in skipped) and not skipped:
        yield f"{name} has no `Example:` with a result"
    if inspect.isclass(each) and issubclass(each, Exception) and each.__name__ not in example(each):
        yield f"{name}: its example neither raises nor catches it"
    report: list[str] = []
    doctest.DocTestRunner(Checker(), optionflags=FLAGS).run(lines, out=report.append)
    if report:
        yield "".join(report)


@pytest.mark.parametrize("package", SHOWN)
def test_every_public_name_has_an_example_that_prints_what_it_shows(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of them, errors and warnings too: each example raises its own, or shows that it warns."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(loop_file, "KINDS", dict(loop_file.KINDS))
    wrong = [fault for name, each in documented(package).items() for fault in faults(name, each)]
    assert not wrong, "\n".join(wrong)


def test_all_that_lists_names_is_looked_at() -> None:
    """A package without names for users says so by listing none."""
    assert {package for package in PACKAGES if documented(package)} == set(SHOWN)


def test_every_public_name_says_in_a_line_what_it_is_for() -> None:
    """One line, a sentence of some words: not a dataclass's signature, not the name again."""
    named = {name: each for package in PACKAGES for name, each in documented(package).items()}
    wrong = []
    for name, each in named.items():
        first, _, rest = text(each).partition("\n")
        if not first.endswith(".") or len(first.split()) < 5 or rest.partition("\n")[0].strip():
            wrong.append(f"{name}: {first!r}")
    assert not wrong, "\n".join(wrong)


def test_an_example_that_prints_something_else_is_noticed() -> None:
    """A wrong digit, a missing result and a missing example are faults; the sign of a zero is none."""

    def halves() -> None:
        """Half of some numbers, as an array.

        Example:
            >>> np.array([1.0, -0.0]) / 2
            array([0.5, 0. ])
        """

    assert not list(faults("halves", halves))
    for old, new in (("0.5", "0.6"), ("array([0.5, 0. ])", ""), (">>> np", "np"), ("Example:", "")):
        halves.__doc__ = text(halves)
        assert old in halves.__doc__
        changed = halves.__doc__.replace(old, new)

        def other() -> None: ...

        other.__doc__ = changed
        assert list(faults("other", other)), changed


def test_an_error_whose_example_shows_another_is_noticed() -> None:
    """An example that raises something else is a fault."""

    class Refused(ValueError):
        """An argument is wrong, and is refused.

        Example:
            >>> int("one")
            Traceback (most recent call last):
                ...
            ValueError: invalid literal for int() with base 10: 'one'
        """

    assert list(faults("Refused", Refused)) == ["Refused: its example neither raises nor catches it"]
