"""The modules of each room, listed on a page of the site; docs/architecture.md has the rooms alone."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from docutils import nodes

from rbd_site.pages import TOP

FOLDER = "modules"
AT_HOME = "architecture"
"""The page in whose table a room leads to the list of its modules."""


def first_line(file: Path) -> str:
    """The first paragraph of a module's docstring, on one line; no more of the file is parsed."""
    text = file.read_text(encoding="utf-8")
    return " ".join(str(ast.literal_eval(text[: text.index('"""', 4) + 3])).split("\n\n")[0].split())


@cache
def packages() -> dict[str, Path]:
    """{package: its folder}, `rbd` first, each before its sub-packages."""
    folders = sorted(file.parent for file in (TOP / "rbd").rglob("__init__.py"))
    return {folder.relative_to(TOP).as_posix().replace("/", "."): folder for folder in folders}


def room_of(package: str) -> str:
    """The room on whose page a package stands: `rbd.answers` for `rbd.answers.many`."""
    return ".".join(package.split(".")[:2])


def address(package: str) -> str:
    """Where the modules of a package are listed, from the top of the site."""
    room = room_of(package)
    return f"{FOLDER}/{room}.html" + ("" if package == room else f"#{nodes.make_id(package)}")


def listed(package: str) -> str:
    """A line for each module of a package: its name and the first line of its docstring."""
    files = sorted(file for file in packages()[package].glob("*.py") if not file.name.startswith("__"))
    return "\n".join(f"- `{package}.{file.stem}`: {first_line(file)}" for file in files)


def room_page(room: str) -> str:
    """The modules of a room, and those of its sub-packages."""
    parts = [f"---\norphan: true\n---\n\n# {room}\n\n[All rooms](/{AT_HOME}.md)"]
    for package, folder in packages().items():
        if room_of(package) == room:
            parts += [*([] if package == room else [f"## {package}"]), first_line(folder / "__init__.py"), listed(package)]
    return "\n\n".join(part for part in parts if part) + "\n"


def pages() -> dict[str, str]:
    """{file: text} of the lists of modules."""
    return {f"{FOLDER}/{room}.md": room_page(room) for room in dict.fromkeys(map(room_of, packages()))}
