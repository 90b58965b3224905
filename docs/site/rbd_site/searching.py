"""The search: each word's stem is found once for all pages, and what pages say, from which a result shows its sentence.

Sphinx fetches each page that it found, which a browser refuses from a disk; here the sentences come along with the index.
"""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.search.en import SearchEnglish

STEMMER = SearchEnglish({})


@cache
def stem_of(word: str) -> str:
    """The stem of an English word."""
    return STEMMER.stem(word)


class English(SearchEnglish):
    """English with stems remembered."""

    def stem(self, word: str) -> str:
        """The stem of a word."""
        return stem_of(word)


SILENT = (nodes.literal_block, nodes.doctest_block, nodes.math_block, nodes.raw, nodes.image, nodes.row, nodes.comment)
TESTS = re.compile(r"\s*\(?(?:Tests: )?tests/[\w/.:]+(?:, tests/[\w/.:]+)*\)?\.?")
MOST = 500
"""Letters that are remembered of a page of the API, whose first lines say what it is."""


def remember(app: Sphinx, doctree: nodes.document) -> None:
    """What the page says, section by section: running text and rows of tables, without code."""
    docname, said = app.env.docname, dict[str, list[str]]()
    for text in doctree.findall(lambda node: isinstance(node, nodes.paragraph | nodes.row)):
        above = _above(text)
        if any(isinstance(one, SILENT) for one in above):
            continue
        parts = [cell.astext() for cell in text] if isinstance(text, nodes.row) else [text.astext()]
        section = next((one for one in above if isinstance(one, nodes.section)), None)
        words = TESTS.sub("", " ".join(", ".join(parts).split()))
        said.setdefault(section["ids"][0] if section and section["ids"] else "", []).append(words)
    texts = [[anchor, "\n".join(parts)] for anchor, parts in said.items()]
    if docname.startswith("api/"):
        texts = [["", " ".join(text for _, text in texts)[:MOST]]]
    app.env.__dict__.setdefault("rbd_texts", {})[docname] = texts


def forget(app: Sphinx, env: BuildEnvironment, docname: str) -> None:
    """A page that is read again says something else."""
    env.__dict__.setdefault("rbd_texts", {}).pop(docname, None)


def write_texts(app: Sphinx, error: Exception | None) -> None:
    """What all pages say, for the page of the search."""
    if error is None and app.builder.format == "html":
        said = json.dumps(app.env.__dict__.get("rbd_texts", {}), ensure_ascii=False, separators=(",", ":"))
        target = Path(app.outdir) / "_static" / "texts.js"
        target.write_text("window.pageTexts = " + re.sub("</", "<\\\\/", said) + ";\n", encoding="utf-8")


def on_search_page(app: Sphinx, pagename: str, templatename: str, context: dict[str, Any], doctree: object) -> None:
    """The page of the search loads them, and what shows a sentence of them."""
    if pagename == "search":
        app.add_js_file("texts.js")
        app.add_js_file("sentences.js")


def _above(node: nodes.Node) -> list[nodes.Node]:
    return [] if node.parent is None else [node.parent, *_above(node.parent)]


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("doctree-read", remember, priority=900)
    app.connect("env-purge-doc", forget)
    app.connect("html-page-context", on_search_page)
    app.connect("build-finished", write_texts)
    app.add_search_language(English)
