"""Scenes in three dimensions beside the pages; a picture of a scene has a link that opens it, or shows it in its place."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.display import status_iterator

from rbd_site.pages import TOP
from rbd_site.shared_scenes import write_shared


def wanted(app: Sphinx) -> list[str]:
    """Names of the scenes to build: all of docs/pictures/scenes.py, or those of the setting `rbd_scenes`."""
    table: dict[str, object] = importlib.import_module("scenes").SCENES
    setting = app.config.rbd_scenes
    return list(table) if setting == "all" else [name for name in setting.split(",") if name]


def link_scenes(app: Sphinx, doctree: nodes.document) -> None:
    """Put a link below each picture that is a photograph of a scene; not on cards, which are links already."""
    docname = app.env.docname
    if docname == "gallery/index":
        return
    for image in list(doctree.findall(nodes.image)):
        path = Path(image["uri"])
        if path.parent.name == "pictures" and path.stem in wanted(app):
            uri = "../" * docname.count("/") + f"scenes/{path.stem}.html"
            here = docname == "index"  # site.js shows it in place of the picture
            link = nodes.reference("", "Turn it in 3-D" if here else "Open in 3-D", internal=True, refuri=uri)
            below = nodes.paragraph("", "", link, classes=["scene-link", *(["live"] if here else [])])
            block = image.parent if isinstance(image.parent, nodes.paragraph) else image
            block.parent.insert(block.parent.index(block) + 1, below)


def write_scenes(app: Sphinx, error: Exception | None) -> None:
    """Write scenes that are missing or older than the package, and all without what they share."""
    if error is not None or app.builder.format != "html":
        return
    makers, raw = importlib.import_module("scenes"), Path(app.doctreedir) / "scenes"
    newest = max(file.stat().st_mtime for file in [*(TOP / "rbd").rglob("*.py"), Path(str(makers.__file__))])
    pages = [raw / f"{name}.html" for name in wanted(app)]
    old = [page for page in pages if not page.is_file() or page.stat().st_mtime < newest]
    raw.mkdir(parents=True, exist_ok=True)
    for page in {*raw.glob("*.html")} - {*pages}:
        page.unlink()
    for page in status_iterator(
        old, "drawing scenes... ", "brown", len(old), app.verbosity, stringify_func=lambda page: page.stem
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # faults of robots' files; each example's page is the place to hear of them
            makers.SCENES[page.stem](page)
    write_shared(raw, Path(app.outdir) / "scenes")


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.add_config_value("rbd_scenes", "all", "env", types=frozenset({str}))
    app.connect("doctree-read", link_scenes, priority=100)
    app.connect("build-finished", write_scenes)
