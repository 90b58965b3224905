"""Source files as pages, with an anchor at every function and class; the browser highlights them, by `source.js`."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from html import escape
from keyword import kwlist
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.display import status_iterator

from rbd_site.pages import TOP
from rbd_site.public import place_of

FOLDER = "source"


@cache
def beginnings(file: Path) -> dict[str, int]:
    """{name: line where it begins} of each class, function and method (`Class.method`) of a Python file."""
    return dict(_within(ast.parse(file.read_text(encoding="utf-8")), "")) if file.suffix == ".py" else {}


def _within(tree: ast.AST, prefix: str) -> Iterator[tuple[str, int]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield prefix + node.name, min([node.lineno, *(d.lineno for d in node.decorator_list)])
        if isinstance(node, ast.ClassDef):
            yield from _within(node, f"{prefix}{node.name}.")


def page_of(file: Path) -> str:
    """The address of a source file's page from the top of the site."""
    return f"{FOLDER}/{file.relative_to(TOP).as_posix()}.html"


def address(file: Path, name: str | None = None) -> str:
    """The address of a function, a class or `Class.method` in a source file's page; names stay when lines move."""
    names = beginnings(file)
    at = name if name in names else next((n for n in names if name and n.endswith(f".{name}")), None)
    return page_of(file) + (f"#{at}" if at else "")


def asked(env: BuildEnvironment, docname: str, file: Path) -> None:
    """Remember that a page links to this file."""
    env.__dict__.setdefault("rbd_sources", {}).setdefault(docname, set()).add(str(file.relative_to(TOP)))


def forget(app: Sphinx, env: BuildEnvironment, docname: str) -> None:
    """A page that is read again names its files again."""
    env.__dict__.setdefault("rbd_sources", {}).pop(docname, None)


PYTHON = re.compile(
    r"""(?P<s>[rbfu]{0,2}(?:\"\"\".*?\"\"\"|'''.*?'''|"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'))"""
    r"""|(?P<c1>\#[^\n]*)|(?P<nd>^[ ]*@[\w.]+)|(?P<nf>(?<=def )\w+|(?<=class )\w+)"""
    rf"""|(?P<k>\b(?:{"|".join(kwlist)})\b)|(?P<mi>\b\d[\w.]*)""",
    re.DOTALL | re.MULTILINE | re.IGNORECASE,
)
"""Strings, comments, decorators, names defined, keywords and numbers, by the class that the site's style colours.

A lexer knows more, and takes ten times longer for three million letters."""


def script() -> str:
    """What colours a source page in the browser: spans of a colour for each letter of code would take twice the code's size."""
    pattern = PYTHON.pattern.replace("(?P<", "(?<")
    return f'const PYTHON = new RegExp({json.dumps(pattern)}, "gims");\n' + SCRIPT


SCRIPT = """
for (const part of [...document.querySelector("pre.python").childNodes].filter((node) => node.nodeType === Node.TEXT_NODE)) {
  const text = part.data, made = document.createDocumentFragment();
  let end = 0;
  for (const found of text.matchAll(PYTHON)) {
    const kind = Object.keys(found.groups).find((name) => found.groups[name] !== undefined);
    const span = Object.assign(document.createElement("span"), {className: kind, textContent: found[0]});
    made.append(text.slice(end, found.index), span);
    end = found.index + found[0].length;
  }
  made.append(text.slice(end));
  part.replaceWith(made);
}
"""


def html_of(file: Path) -> str:
    """The file as a page, in the colours of the other pages, light and dark."""
    text = file.read_text(encoding="utf-8")
    lines = escape(text, quote=False).split("\n")
    for anchor, line in beginnings(file).items():
        lines[line - 1] = f'<i id="{anchor}"></i>{lines[line - 1]}'
    name = file.relative_to(TOP).as_posix()
    up = "../" * page_of(file).count("/")
    kind, colours = (' class="python"', f'<script src="{up}_static/source.js"></script>') if file.suffix == ".py" else ("", "")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(name)} - rbd</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="stylesheet" href="{up}_static/pygments.css"><link rel="stylesheet" href="{up}_static/source.css"></head>\n'
        f'<body data-theme="auto"><script>document.body.dataset.theme = localStorage.getItem("theme") || "auto";</script>\n'
        f'<header><a href="{up}index.html">rbd</a> <code>{escape(name)}</code></header>\n'
        f'<div class="highlight"><pre{kind}>{chr(10).join(lines)}</pre></div>{colours}</body></html>\n'
    )


def write_sources(app: Sphinx, error: Exception | None) -> None:
    """Write the pages of all modules, which `rbd_site.modules` lists by rooms, and of files that pages link to, if new."""
    if error is not None or app.builder.format != "html":
        return
    named = set().union(*app.env.__dict__.get("rbd_sources", {}).values(), ())
    modules = {file for file in (TOP / "rbd").rglob("*.py") if not file.name.startswith("__")}
    files = {*(TOP / name for name in named), *modules}
    this, out = Path(__file__).stat().st_mtime, Path(app.outdir)
    (out / "_static" / "source.js").write_text(script(), encoding="utf-8")
    pages = {out / page_of(file): file for file in sorted(files)}
    old = [page for page, file in pages.items() if not page.is_file() or page.stat().st_mtime < max(file.stat().st_mtime, this)]
    for page in status_iterator(
        old, "writing source files... ", "brown", len(old), app.verbosity, stringify_func=lambda page: page.stem
    ):
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(html_of(pages[page]), encoding="utf-8")


def linkcode_resolve(domain: str, info: dict[str, str]) -> str | None:
    """Where the [source] link of a name leads, from a page of the API."""
    place = place_of(f"{info['module']}.{info['fullname']}") if domain == "py" and info["module"] else None
    if place is None or not place[0].is_relative_to(TOP):
        return None
    return "../" + address(*place)


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("env-purge-doc", forget)
    app.connect("build-finished", write_sources)
