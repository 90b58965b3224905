"""Formulas of docstrings as mathematics: M v+ = M v + J^T p, after `::` or in a sentence, is set by MathJax."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.addnodes import desc_signature
from sphinx.application import Sphinx

from rbd_site.subscripts import replace_texts

GREEK = "alpha|beta|gamma|delta|eta|lambda|mu|nu|omega|phi|psi|rho|sigma|tau|theta|xi|zeta"
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

_WORDS = "argmin|bias|error|feedback|limit|margin|offset|rhs|velocity"
_SYMBOL = rf"(?:{GREEK}|{_WORDS}|[A-Za-z]|[A-Z]\d)(?:_(?:ext|free|dot|[A-Za-z0-9]{{1,2}}))?(?![A-Za-z0-9_])(?!\.\w)"
_ATOM = rf"(?:\d+(?:\.\d+)?(?![\w.])|{_SYMBOL})(?:\^(?:T|-?\d+|\+)|['*]+|[+-](?=[ ,)=]))*"
_TERM = rf"-?[(|]*{_ATOM}[)|]*(?:_[A-Za-z](?![A-Za-z0-9_]))?(?:\^(?:T|-?\d+))?"
INLINE = re.compile(rf"(?<![\w`.^|(\[/'-]){_TERM}(?:(?:\s?(?:<=|>=|[=<>+/*-]|\bx\b)\s?|\s){_TERM})*(?![\w(\['|^.-]\w|[(\[|^)])")
"""Letters, numbers and signs in a sentence that may be a formula."""
_OPERATOR = re.compile(r"\s*[=+*/<>@~]|\s+-\s")
"""Beside it: then it is part of a formula that has words in it."""
_SURE = re.compile(r"\^|_dot|_free|\|.*\||''|\b(?:mu|tau) [a-z]\b")
"""What no sentence has: in which case it is one."""


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
                made.append(rf"\mathrm{{{text}}}" if text in _WORDS.split("|") else rf"\text{{ {text} }}")
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


def inline(text: str) -> list[nodes.Node]:
    """A sentence with its formulas as nodes; empty if it has none. What stands in square brackets is a unit."""
    made: list[nodes.Node] = []
    end = 0
    for found in INLINE.finditer(text):
        line = " ".join(found[0].split())
        before, after = text[: found.start()], text[found.end() :]
        part = _OPERATOR.match(after) or _OPERATOR.match(before[::-1]) or before.count("[") > before.count("]")
        if part or not _SURE.search(line) or line.count("(") != line.count(")") or line.count("|") % 2 or line[:2] == "a ":
            continue
        made += [nodes.Text(text[end : found.start()]), nodes.math(line, tex(line).strip())]
        end = found.end()
    return [*made, nodes.Text(text[end:])] if made else []


def set_inline(app: Sphinx, doctree: nodes.document) -> None:
    """Set the formulas in sentences of a page of the API, and those in backquotes."""
    if not app.env.docname.startswith("api/"):
        return
    for code in list(doctree.findall(nodes.literal)):
        if INLINE.fullmatch(line := code.astext()) and _SURE.search(line) and (" " in line or "|" in line):
            code.replace_self(nodes.math(line, tex(line).strip()))
    kept = (nodes.literal, nodes.FixedTextElement, nodes.math, nodes.Invisible, nodes.title, desc_signature)
    replace_texts(doctree, kept, inline)


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("doctree-read", set_formulas, priority=80)
    app.connect("doctree-read", set_inline, priority=900)
