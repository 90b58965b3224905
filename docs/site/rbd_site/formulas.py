"""Formulas of docstrings as mathematics: what stands after `::` in plain letters, M v+ = M v + J^T p, is set by MathJax."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

GREEK = "alpha|beta|gamma|delta|lambda|mu|omega|phi|psi|rho|sigma|tau|theta|xi|zeta"
FUNCTIONS = "sin|cos|tan|det|rank|min|max|argmin"
TOKEN = re.compile(
    rf"(?P<dot>\b([A-Za-z])_dot\b)|(?P<root>\bsqrt\((?P<under>[^()]*)\))|(?P<greek>\b(?:{GREEK})(?=\b|_))"
    rf"|(?P<angle>\bth(?P<number>\d?)\b)|(?P<function>\b(?:{FUNCTIONS})\b)|(?P<half>\b1/2\b)"
    r"|(?P<rate>\bd/dt\b)|(?P<unit>\[m2\])|(?P<sign>(?<=[A-Za-z])[+-](?=[ ,)]|$))|(?P<cross>(?<=\w) x (?=\w))"
    r"|(?P<index>\b[A-Z]\d\b)|(?P<power>\^(?:T|-?\d+|\+))|(?P<sub>_(?:\w+))|(?P<word>[a-z][a-z]+(?:[ -][a-z]{2,})*)"
    r"|(?P<most><=)|(?P<least>>=)|(?P<dual>\bK\*)|(?P<gap> {2,})|(?P<times> \. )|(?P<rest>.)"
)
"""What a formula in plain letters is made of; words of two letters and more are words, others are symbols."""
FORMULA = re.compile(r"\^|_dot|_free|\|.*\||''|\bmu\b|\bdet\b|K\*")
NOT_ONE = re.compile(r"[`\":;]|'s | / dt| {8,}[a-z]{3,} [a-z]|^\d |\(also")
"""What tables have, and lists in words."""


def tex(line: str) -> str:
    """A line in TeX."""
    made = []
    for found in TOKEN.finditer(line):
        kind, text = found.lastgroup, found[0]
        kind = "angle" if found["angle"] else "root" if found["root"] else kind
        match kind:
            case "dot":
                made.append(rf"\dot {text[0]}")
            case "root":
                made.append(rf"\sqrt{{{tex(found['under'])}}}")
            case "greek":
                made.append(rf"\{text} ")
            case "angle":
                made.append(rf"\theta_{{{found['number']}}}" if found["number"] else r"\theta")
            case "function":
                made.append(rf"\operatorname{{{text}}}")
            case "half":
                made.append(r"\tfrac12 ")
            case "rate":
                made.append(r"\tfrac{d}{dt} ")
            case "unit":
                made.append(r"\;[\mathrm{m}^2]")
            case "sign":
                made.append(f"^{{{text}}}")
            case "cross":
                made.append(r" \times ")
            case "index":
                made.append(f"{text[0]}_{text[1]}")
            case "power":
                made.append({"^T": r"^{\top}"}.get(text, f"^{{{text[1:]}}}"))
            case "sub":
                inside = text[1:]
                made.append(f"_{{{inside}}}" if len(inside) == 1 else rf"_{{\rm {inside.replace('_', ' ')}}}")
            case "word":
                made.append(rf"\text{{ {text} }}")
            case "most" | "least":
                made.append(r"\le " if kind == "most" else r"\ge ")
            case "dual":
                made.append(r"K^{*}")
            case "gap":
                made.append(r"\qquad ")
            case "times":
                made.append(r"\cdot ")
            case _:
                made.append({"*": r"^{*}", "|": r"\vert "}.get(text, text))
    return "".join(made)


def set_formulas(app: Sphinx, doctree: nodes.document) -> None:
    """Set the blocks of a page of the API whose lines are all formulas."""
    if not app.env.docname.startswith("api/"):
        return
    for block in list(doctree.findall(nodes.literal_block)):
        lines = [line.strip() for line in block.astext().splitlines() if line.strip()]
        if block.get("language", "none") not in ("none", "default") or not lines:
            continue
        if all("=" in line or " in K*" in line for line in lines) and FORMULA.search(block.astext()):
            if any(NOT_ONE.search(line) for line in lines):
                continue
            body = r" \\ ".join(tex(re.sub(r" +=+ +", " = ", line)) for line in lines)
            text = body if len(lines) == 1 else rf"\begin{{gathered}} {body} \end{{gathered}}"
            block.replace_self(nodes.math_block(text, text, nowrap=False, number=None, label=None))


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("doctree-read", set_formulas, priority=80)
