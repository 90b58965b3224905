"""Letters of formulas in running text: a_free, f_n and J^T, as pages write them in Markdown, get true sub- and superscripts."""

from __future__ import annotations

import re
from collections.abc import Callable

from docutils import nodes
from sphinx.application import Sphinx

LETTER = r"(?:(?<![A-Za-z0-9_.\u0300-\u036f])[^\W\d_]|(?<=[0-9a-z])[α-ω])[\u0300-\u036f]*['⁺⁻]?"
"""A letter that no word ends with: f, q̈, and of Greek ones also those after a number or another letter, 2θ, iθ."""
SUBSCRIPT = re.compile(
    rf"({LETTER}|[‖|]²)"  # one letter, perhaps dotted, or the end of a norm
    r"_([A-Za-zα-ω0-9]{1,7}(?:,[A-Za-z0-9]{1,3})?)(?![A-Za-zα-ω0-9_])"
)
"""One letter, perhaps with dots or a prime, an underscore and a short index: a_free, τ_g, r̈_k, ‖x‖²_M, but not test_docs."""
SUPERSCRIPT = re.compile(r"(?<=[^\W_]|[)|‖\]])\^(?:(T|-?\d+)(?![A-Za-z0-9_])|\(([^()]+)\)|\{([^{}]+)\})")
"""After a letter, a digit or a bracket: J^T, x^2, M^-1, e^(iθ), e^{iθ_k}."""
DOT = "\u0307"


def split(text: str) -> list[nodes.Node]:
    """The text with its sub- and superscripts as nodes; J_dot is J with a dot above."""
    made: list[nodes.Node] = []
    end = 0
    for found in sorted([*SUBSCRIPT.finditer(text), *SUPERSCRIPT.finditer(text)], key=lambda found: found.start()):
        if found.start() < end:
            continue  # an index inside an exponent, already set
        if found.re is SUPERSCRIPT:
            exponent = next(group for group in found.groups() if group is not None)
            inner = split(exponent.replace("-", "−")) or [nodes.Text(exponent.replace("-", "−"))]
            made += [nodes.Text(text[end : found.start()]), nodes.superscript("", "", *inner)]
        elif found[2] == "dot":
            made.append(nodes.Text(text[end : found.end(1)] + DOT))
        else:
            made += [nodes.Text(text[end : found.end(1)]), nodes.subscript("", found[2])]
        end = found.end()
    return [*made, nodes.Text(text[end:])] if made else []


def replace_texts(doctree: nodes.document, kept: tuple[type, ...], split: Callable[[str], list[nodes.Node]]) -> None:
    """Put what `split` makes of each text in its place, but within nodes of the kept kinds, or where it makes nothing."""
    for text in list(doctree.findall(nodes.Text)):
        above = text.parent
        while above is not None and not isinstance(above, kept):
            above = above.parent
        if above is None and (made := split(str(text))):
            text.parent.replace(text, made)


def lower_indices(app: Sphinx, doctree: nodes.document) -> None:
    """Set the indices and exponents of a page that was read."""
    if not app.env.docname.startswith("api/"):  # docstrings name arguments and fields
        kept = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.FixedTextElement, nodes.Invisible)
        replace_texts(doctree, kept, split)


def setup(app: Sphinx) -> None:
    """Read each page's text once it is linked."""
    app.connect("doctree-read", lower_indices, priority=900)
