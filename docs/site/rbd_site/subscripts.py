"""Letters of formulas in running text: a_free and f_n, as pages write them in plain Markdown, get true subscripts."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

SUBSCRIPT = re.compile(
    r"((?<![A-Za-z0-9_.\u0300-\u036f])[^\W\d_][\u0300-\u036f]*['⁺⁻]?|[‖|]²)"  # one letter, perhaps dotted, or the end of a norm
    r"_([A-Za-zα-ω0-9]{1,7}(?:,[A-Za-z0-9]{1,3})?)(?![A-Za-zα-ω0-9_])"
)
"""One letter, perhaps with dots or a prime, an underscore and a short index: a_free, τ_g, r̈_k, ‖x‖²_M, but not test_docs."""


def split(text: str) -> list[nodes.Node]:
    """The text with its subscripts as nodes."""
    made: list[nodes.Node] = []
    end = 0
    for found in SUBSCRIPT.finditer(text):
        made += [nodes.Text(text[end : found.end(1)]), nodes.subscript("", found[2])]
        end = found.end()
    return [*made, nodes.Text(text[end:])] if made else []


def lower_indices(app: Sphinx, doctree: nodes.document) -> None:
    """Set the indices of a page that was read."""
    kept = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.FixedTextElement, nodes.Invisible)
    if app.env.docname.startswith("api/"):
        return  # docstrings name arguments and fields
    for text in list(doctree.findall(nodes.Text)):
        above = text.parent
        while above is not None and not isinstance(above, kept):
            above = above.parent
        if above is None and (made := split(str(text))):
            text.parent.replace(text, made)


def setup(app: Sphinx) -> None:
    """Read each page's text once it is linked."""
    app.connect("doctree-read", lower_indices, priority=900)
