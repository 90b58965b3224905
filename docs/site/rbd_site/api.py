"""The pages of the API: one a sub-package, with a table of first lines, and one a public name."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

from rbd.arrays import lazy
from rbd.displayed import Displayed
from rbd_site.pages import TOP
from rbd_site.public import GROUPS, PACKAGES, Public, homes, module_of, names_of

STOP = "BaseException, Enum, IntEnum, StrEnum, Protocol, VectorEnv, Env, str, int, float, tuple, dict, list"
"""Members of these bases are not repeated on the page of a class."""


def heading(text: str, mark: str = "=") -> str:
    """A heading of reStructuredText."""
    return f"{text}\n{mark * len(text)}\n"


def toctree(names: Iterable[str]) -> str:
    """A table of contents that the sidebar does not show, but that orders the pages."""
    return ".. toctree::\n   :hidden:\n\n" + "".join(f"   {name}\n" for name in names)


def table(names: Iterable[Public]) -> str:
    """Names with their first lines."""
    rows = []
    for public in names:
        short = public.name.rsplit(".", 1)[1]
        rows.append(f"   * - :doc:`{short} <{home_page(public)}>`\n     - {plain(public.first_line)}\n")
    return ".. list-table::\n   :class: summary\n   :widths: 30 70\n\n" + "".join(rows)


def home_page(public: Public) -> str:
    """The page on which a name is documented; that of `rbd.State` for `rbd.model.State`."""
    return public.name if public.kind == "module" else homes()[public.name]


def first_paragraph(package: str) -> str:
    """What a sub-package is for."""
    return (inspect.getdoc(module_of(package)) or "").split("\n", 1)[0]


def package_page(package: str) -> str:
    """A sub-package: what it is for, its names, and a page each for those that are documented here."""
    names = names_of(package)
    made = [heading(package), first_paragraph(package) + "\n"]
    if package == "rbd":
        grouped = " ".join(GROUPS.values()).split()
        if sorted(grouped) != sorted(names):
            raise ValueError(f"GROUPS and rbd.__all__ differ by {sorted(set(grouped) ^ set(names))}; set them in public.GROUPS")
        for title, group in GROUPS.items():
            made += [heading(title, "-"), table(names[name] for name in group.split())]
    else:
        made.append(table(names.values()))
        if package == "rbd.errors":
            doc = inspect.getdoc(module_of(package)) or ""
            made.append(doc.split("\n", 1)[1] + "\n")
    file = Path(str(module_of(package).__file__))
    made.append(f"Source: `{file.relative_to(TOP).as_posix()}`.\n")
    return "\n".join(made)


def name_page(public: Public) -> str:
    """A public name, by autodoc."""
    package = public.name.rsplit(".", 1)[0]
    made = [":orphan:\n", heading(public.name), f"In :doc:`{package}`.\n", f".. auto{public.kind}:: {public.name}"]
    if public.kind in ("class", "exception"):
        made += ["   :members:", f"   :inherited-members: {STOP}"]
        if not set(getattr(public.value, "__bases__", ())) <= {object, Displayed}:
            made.append("   :show-inheritance:")
    return "\n".join(made) + "\n"


def index_page() -> str:
    """All sub-packages, with what each is for."""
    rows = [f"   * - :doc:`{package}`\n     - {first_paragraph(package)}\n" for package in ("rbd", *PACKAGES)]
    text = (
        "Public names, by the sub-package from which one imports them. What one needs first stands on top, in :doc:`rbd`: "
        "robots, constraints, solvers, the verbs. Numbers are in SI units and radians; signs and frames: "
        ":doc:`/reference/notation`.\n"
    )
    lists = ".. list-table::\n   :class: summary\n   :widths: 30 70\n\n" + "".join(rows)
    return "\n".join([heading("API"), text, lists, toctree(("rbd", *PACKAGES)), ":ref:`genindex` lists every name.\n"])


def pages() -> dict[str, str]:
    """{file: text} of all pages of the API."""
    made = {"api/index.rst": index_page()}
    for package in ("rbd", *PACKAGES):
        made[f"api/{package}.rst"] = package_page(package)
        for public in names_of(package).values():
            if is_home(public):
                made[f"api/{public.name}.rst"] = name_page(public)
    return made


def is_home(public: Public) -> bool:
    """Whether this name has a page of its own."""
    return public.kind != "module" and homes()[public.name] == public.name


def neighbours(app: Sphinx, pagename: str, templatename: str, context: dict[str, Any], doctree: object) -> None:
    """Previous and next name of the package: no table of contents lists 240 names, as every sidebar would resolve it."""
    package, _, name = pagename.removeprefix("api/").rpartition(".")
    if not pagename.startswith("api/") or package not in ("rbd", *PACKAGES) or name not in names_of(package):
        return
    if not is_home(names_of(package)[name]):
        return
    order = [package, *(public.name for public in names_of(package).values() if is_home(public))]
    at = order.index(pagename.removeprefix("api/"))
    context["prev"] = {"link": f"{order[at - 1]}.html", "title": order[at - 1]}
    if at + 1 < len(order):
        context["next"] = {"link": f"{order[at + 1]}.html", "title": order[at + 1]}


CODE = re.compile(r"(``.*?``|`[^`]*`)")
MARKS = re.compile(r"\\.|(?<![\w*])(\*{1,2})(?=\w)[^*]*\w\1(?![\w*])|[|*]")
"""What is escaped already, emphasis, and marks that stand for themselves."""


def plain(line: str) -> str:
    """A line of a docstring in which | and * stand for themselves, and `Rows`s is code with an s."""
    parts = CODE.split(line)
    for i in range(0, len(parts), 2):
        parts[i] = MARKS.sub(lambda mark: mark[0] if len(mark[0]) > 1 else "\\" + mark[0], parts[i])
        if i and parts[i] and (parts[i][0].isalnum()):
            parts[i] = "\\ " + parts[i]
    return "".join(parts)


COLON = "\ue000"


def keep_colons(app: Sphinx, kind: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Hide colons that napoleon would read as the end of a type: types stand in signatures here, not in docstrings."""
    for i, line in enumerate(lines):
        if (i == 0 and kind in ("attribute", "data", "property")) or (i and lines[i - 1].strip() in ("Returns:", "Yields:")):
            lines[i] = line.replace(":", COLON)


def read_as_written(app: Sphinx, kind: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Escape what reStructuredText would take for markup: |v| is a size; literal blocks and examples are left alone."""
    lines[:] = [line.replace(COLON, ":") for line in lines]
    literal: int | None = None
    example = False  # with what it prints, up to the next empty line
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        if example:
            literal = None
            continue
        if literal is not None and (not line.strip() or indent > literal):
            continue
        literal = indent if line.rstrip().endswith("::") or line.lstrip().startswith("..") else None
        if literal is None:
            lines[i] = plain(line)


SWAPPED: list[tuple[type, str, lazy[Any, Any]]] = []
"""Members that are properties while the API is read, and what they are else."""


def show_lazies(app: Sphinx) -> None:
    """Let autodoc see a value computed on first use as the property that it is for users, with its type."""
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] == "rbd"]
    classes = {c for module in modules for c in vars(module).values() if inspect.isclass(c) and c.__module__.startswith("rbd")}
    for owner in classes:
        for name, value in list(vars(owner).items()):
            if isinstance(value, lazy):
                SWAPPED.append((owner, name, value))
                setattr(owner, name, property(value.compute))


def restore_lazies(app: Sphinx, *_: object) -> None:
    """Undo `show_lazies`: the scenes are computed by the same process."""
    while SWAPPED:
        setattr(*SWAPPED.pop())


def name_attributes(app: Sphinx, doctree: nodes.document) -> None:
    """Head the list of a class's attributes by that word."""
    for field in doctree.findall(nodes.field_name):
        if field.astext() == "Variables":
            field.children[:] = [nodes.Text("Attributes")]


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("builder-inited", show_lazies, priority=700)
    app.connect("env-updated", restore_lazies)
    app.connect("build-finished", restore_lazies, priority=100)
    app.connect("doctree-read", name_attributes)
    app.connect("html-page-context", neighbours)
    app.connect("autodoc-process-docstring", keep_colons, priority=100)
    app.connect("autodoc-process-docstring", read_as_written, priority=700)
