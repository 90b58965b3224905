"""Tests behind a formula, folded: a reader sees "2 tests", and opens them."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

OPENS = re.compile(r"\s*Tests:\s*$")
TEST = re.compile(r"tests/[\w/]+\.py")
BETWEEN = re.compile(r",?\s*(?:and\s+)?")


def fold_tests(app: Sphinx, doctree: nodes.document) -> None:
    """Put the tests that a paragraph names at its end into a block that opens on a click."""
    for paragraph in list(doctree.findall(nodes.paragraph)):
        at = next((i for i, child in enumerate(paragraph) if isinstance(child, nodes.Text) and OPENS.search(child)), None)
        if at is None:
            continue
        rest, n = list(paragraph[at + 1 :]), 0
        for i, node in enumerate(rest):
            if TEST.match(node.astext()):
                n = i + 1
            elif not isinstance(node, nodes.Text) or not BETWEEN.fullmatch(node.astext()):
                break
        tests, rest = rest[:n], rest[n:]
        count = sum(isinstance(node, nodes.literal) for node in tests)
        if not count:
            continue
        after = re.sub(r"^\s*\.\s*", "", rest.pop(0).astext()) if rest and isinstance(rest[0], nodes.Text) else ""
        before = [
            *paragraph[:at],
            nodes.Text(OPENS.sub("", paragraph[at].astext()) + (" " if after or rest else "")),
            nodes.Text(after),
            *rest,
        ]
        opened = f'<details class="tests"><summary>{count} test{"s" if count > 1 else ""}</summary>'
        block = [
            nodes.raw("", opened, format="html"),
            nodes.paragraph("", "", *tests),
            nodes.raw("", "</details>", format="html"),
        ]
        kept = [node for node in before if node.astext()]
        paragraph.replace_self([nodes.paragraph("", "", *kept), *block] if kept else block)


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("doctree-read", fold_tests, priority=90)
