"""Which tests `make test` leaves out: those that took longest, and each of them is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from long_list import long_tests, slow_tests


def test_every_long_test_exists():
    """A test that was renamed or removed leaves the list."""
    root, gone = Path(__file__).parent.parent, []
    for name in long_tests():
        path, *parts = re.split("::", name)
        nodes: list[ast.stmt] = ast.parse((root / path).read_text()).body if (root / path).exists() else []
        for part in parts:
            found = [node for node in nodes if getattr(node, "name", "") == part]
            nodes = getattr(found[0], "body", []) if found else []
            if not found:
                gone.append(name)
                break
    assert not gone


def test_a_slow_test_that_nobody_listed_is_found():
    """It takes more than a hundredth of its run; a run of a few tests says nothing."""
    took = {f"tests/test_x.py::test_{i}": 0.1 for i in range(1100)}
    assert slow_tests(took) == []
    assert slow_tests(took | {"tests/test_x.py::test_a": 2.0, "tests/test_x.py::test_b": 5.0}) == [
        "tests/test_x.py::test_b",
        "tests/test_x.py::test_a",
    ]
    assert slow_tests({"tests/test_x.py::test_a": 2.0}) == []
