"""Pages that do not stand in docs/: files of the repository, and pages that the build writes.

Sphinx reads them where they are, so that no generated file stands beside the sources.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.project import Project

from rbd_site.public import PACKAGES

TOP = Path(__file__).resolve().parents[3]
FILES = {"changelog": "CHANGELOG.md", "contributing": "CONTRIBUTING.md", "reference/mechanism_files": "urdf/README.md"}
"""{page of the site: file of the repository}."""
INSTEAD = {"README.md": "index", "examples/README.md": "gallery/index"}
"""{file of the repository: page of the site that a link to it opens}."""


class SiteProject(Project):
    """The pages of docs/, those of `FILES` and the generated ones."""

    top: Path
    generated: dict[str, Path]

    def discover(self, exclude_paths: Iterable[str] = (), include_paths: Iterable[str] = ("**",)) -> set[str]:
        """All page names; fills the maps between names and files."""
        super().discover(exclude_paths, include_paths)
        for name, path in {**{name: self.top / file for name, file in FILES.items()}, **self.generated}.items():
            self.docnames.add(name)
            self._docname_to_path[name] = path
            self._path_to_docname[path] = name
        for file, name in INSTEAD.items():
            self._path_to_docname[self.top / file] = name
        return self.docnames


def write(path: Path, text: str) -> None:
    """Write a generated page, unless it is there already: Sphinx reads again what is new."""
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def add_pages(app: Sphinx) -> None:
    """Tell Sphinx of the pages from outside docs/."""
    project = SiteProject(app.srcdir, app.config.source_suffix)
    project.restore(app.project)
    project.top, project.generated = Path(app.confdir).resolve().parent, {}
    from rbd_site import api, bibliography, gallery, modules, notebooks  # they import this module's TOP

    made = {**api.pages(), **modules.pages(), **gallery.pages(), **notebooks.pages(), "bibliography.rst": bibliography.page()}
    for name, text in made.items():
        path = Path(app.doctreedir) / "generated" / name
        write(path, text)
        project.generated[name.rsplit(".", 1)[0]] = path
    app.project = app.env.project = project


def shorten_navigation(app: Sphinx, pagename: str, templatename: str, context: dict[str, Any], doctree: object) -> None:
    """The sidebar lists the sections, and the pages of the one that is open: all of them would be longer than most pages.

    A name of the API has the sections alone, made once: its page leads to its package, which lists all names.
    """
    whole = context.get("toctree")
    if whole is None:
        return
    kept = app.__dict__.setdefault("rbd_sidebars", {})
    name = pagename.startswith("api/rbd.") and pagename.removeprefix("api/") not in PACKAGES

    def sidebar(**options: Any) -> str:
        if not name:
            return str(whole(**{**options, "maxdepth": 2, "collapse": True}))
        if "api" not in kept:
            kept["api"] = whole(**{**options, "maxdepth": 1, "collapse": True})
        return kept["api"]

    context["toctree"] = sidebar


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("builder-inited", add_pages)
    app.connect("html-page-context", shorten_navigation, priority=100)
