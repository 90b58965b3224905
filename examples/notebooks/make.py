"""Runs the notebooks beside this file and stores what their cells show: `python examples/notebooks/make.py [NAME ...]`.

Jupyter is not needed. A cell is run as Jupyter runs it: all cells in one namespace, what is printed first, then the value of
the last expression, as text and as HTML, unless it is None or a semicolon follows it.
"""

import ast
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
NOTEBOOKS = tuple(sorted(HERE.glob("*.ipynb")))


def read(path: Path) -> dict[str, Any]:
    """A notebook as plain data."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """The same notebook with the outputs of a fresh run."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    count, cells = 0, []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            count += 1
            cell = {**cell, "execution_count": count, "outputs": outputs("".join(cell["source"]), namespace, count)}
        cells.append(cell)
    return {**notebook, "cells": cells}


def outputs(source: str, namespace: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """What a cell prints and shows, in the form of a notebook's file; names it defines are added to the namespace."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"<cell {count}>", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"<cell {count}>", "eval"), namespace)
    made: list[dict[str, Any]] = []
    if printed.getvalue():
        made.append({"name": "stdout", "output_type": "stream", "text": lines(printed.getvalue())})
    if value is not None and not source.rstrip().endswith(";"):
        made.append({"data": shown(value), "execution_count": count, "metadata": {}, "output_type": "execute_result"})
    return made


def shown(value: object) -> dict[str, list[str]]:
    """{kind of text: its lines} of a value at the end of a cell."""
    found = {"text/plain": lines(repr(value))}
    if hasattr(value, "_repr_html_"):
        found = {"text/html": lines(value._repr_html_()), **found}
    return found


def lines(text: str) -> list[str]:
    """Lines with their ends, as notebooks store text."""
    return text.splitlines(keepends=True)


def main(names: list[str]) -> None:
    """Run the notebooks of these names, or all, and store them."""
    for path in NOTEBOOKS:
        if not names or path.stem in names:
            made = json.dumps(executed(read(path)), indent=1, ensure_ascii=False) + "\n"
            path.write_text(made, encoding="utf-8")
            print(f"{path.name}: {len(made) / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
