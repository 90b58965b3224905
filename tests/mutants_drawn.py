"""Small faults drawn by seed: one expression of one module is changed, as a slip of the pen would.

    + and -, * and / exchanged            a term, a factor or a power dropped           operands or two arguments swapped
    a sign or `not` dropped               comparisons reversed, and their boundary      `and` and `or`; one of the two alone
    whole numbers, indices and the ends   numbers doubled, True and False exchanged     .T, abs and sqrt dropped
      of slices one more or less          min and max, any and all, sin and cos ...     a call or an update left out

Left out are messages (`raise`, `warn`, f-strings, how numbers are printed), `assert`, annotations, decorators, and floats below
1e-3 (tolerances).
"""
# ruff: noqa: D102

from __future__ import annotations

import ast
import bisect
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

SWAPPED = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all", "sin": "cos", "floor": "ceil"}
SWAPPED |= {b: a for a, b in SWAPPED.items()}
SYMBOL = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.MatMult: "@", ast.Pow: "**", ast.FloorDiv: "//"}
INVERSE = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
OPPOSITE = {ast.Lt: ">", ast.Gt: "<", ast.LtE: ">", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="}
OPPOSITE |= {ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in"}
BOUNDARY = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
DROPPED_CALLS = ("abs", "sqrt")
SYMMETRIC = ("min", "max", "minimum", "maximum", "dot", "hypot", "zip", "isinstance", "getattr", "partial", "cast")
ATOMS = (ast.Name, ast.Constant, ast.Attribute, ast.Call, ast.Subscript, ast.List, ast.Tuple, ast.Dict, ast.ListComp)
UNSEEN = ("strict", "maxsize", "precision", "max_line_width", "threshold", "stacklevel")  # checks of our own code, and print
SILENT = (ast.Raise, ast.Assert, ast.JoinedStr, ast.arg, ast.Import, ast.ImportFrom)


@dataclass(frozen=True)
class Mutant:
    """A module with one change.

    Attributes:
        file: The module's path from the root.
        function: The qualified name of the function or class that is changed, "" outside.
        before, after: The first line that differs.
        lines: Those of the changed statement, none where it is executed at import.
        text: The whole module.
    """

    file: str
    function: str
    before: str
    after: str
    lines: range = field(repr=False)
    text: str = field(repr=False)

    @property
    def key(self) -> str:
        """What a mutant is known by, whatever is written elsewhere in its file."""
        return f"{self.file} | {self.function} | {self.before} | {self.after}"


class Change(NamedTuple):
    """New text for the bytes from `first` to `last`."""

    function: str
    lines: range
    first: int
    last: int
    new: str


class Drawer(ast.NodeVisitor):
    """All changes that can be made to a module, in `found`."""

    def __init__(self, source: str) -> None:
        self.source, self.starts = source.encode(), [0]
        for line in self.source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.scopes: list[str] = []
        self.inside, self.lines = 0, range(0)
        self.found: list[Change] = []
        self.visit(ast.parse(source))

    def ends(self, node: Any) -> tuple[int, int]:
        """The first byte and the one after the last."""
        return self.starts[node.lineno - 1] + node.col_offset, self.starts[node.end_lineno - 1] + node.end_col_offset

    def code(self, node: ast.AST) -> str:
        first, last = self.ends(node)
        return self.source[first:last].decode()

    def atom(self, node: ast.AST) -> str:
        return self.code(node) if isinstance(node, ATOMS) else f"({self.code(node)})"

    def change(self, first: ast.AST, *texts: str, last: ast.AST | None = None) -> None:
        at = self.ends(first)[0], self.ends(last or first)[1]
        self.found += [Change(".".join(self.scopes), self.lines, *at, text) for text in texts]

    def visit(self, node: ast.AST) -> None:
        """Know the lines of the statement (of a compound one those of its head), and pass over what is left out."""
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            after = body[0].lineno if body else (node.end_lineno or node.lineno) + 1
            self.lines = range(node.lineno, after) if self.inside else range(0)
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            self._visit_scope(node)
        elif not isinstance(node, SILENT):
            super().visit(node)

    def _visit_scope(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        function = isinstance(node, ast.FunctionDef)
        self.scopes.append(node.name)
        for default in filter(None, [*node.args.defaults, *node.args.kw_defaults] if isinstance(node, ast.FunctionDef) else []):
            self.visit(default)
        self.inside += function
        for child in node.body:
            self.visit(child)
        self.inside -= function
        self.scopes.pop()

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in UNSEEN:
            self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.change(node, "pass")
            if self.code(node.value.func).endswith("warn"):
                return
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.change(node, "pass")
        if type(node.op) in INVERSE:
            self.change(node, f"{self.code(node.target)} {INVERSE[type(node.op)]}= {self.code(node.value)}")
        self.generic_visit(node)

    def visit_Continue(self, node: ast.Continue) -> None:
        self.change(node, "break")

    def visit_Break(self, node: ast.Break) -> None:
        self.change(node, "continue")

    def visit_BinOp(self, node: ast.BinOp) -> None:
        left, right, kind = self.atom(node.left), self.atom(node.right), type(node.op)
        words = any(isinstance(side, ast.JoinedStr | ast.List | ast.Tuple) for side in (node.left, node.right))
        if kind in SYMBOL and not words:
            self.change(node, left, right)
            if kind in INVERSE:
                self.change(node, f"{left} {INVERSE[kind]} {right}")
            if kind not in (ast.Add, ast.Mult):
                self.change(node, f"{right} {SYMBOL[kind]} {left}")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not):
            self.change(node, self.atom(node.operand))
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        values = [self.atom(value) for value in node.values]
        self.change(node, f"({(' or ' if isinstance(node.op, ast.And) else ' and ').join(values)})", values[0], values[-1])
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if len(node.ops) == 1:
            kind, left, right = type(node.ops[0]), self.code(node.left), self.code(node.comparators[0])
            self.change(node, f"{left} {OPPOSITE[kind]} {right}")
            counts = "len(" in left + right or any(isinstance(x, ast.Constant) and type(x.value) is int for x in ast.walk(node))
            if kind in BOUNDARY and counts:  # between real numbers the boundary is never met
                self.change(node, f"{left} {BOUNDARY[kind]} {right}")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self.change(node, str(not value))
        elif isinstance(value, int):
            self.change(node, str(value + 1), *([str(value - 1)] if value else []))
        elif isinstance(value, float) and (value == 0.0 or 1e-3 <= value < 1e6):
            self.change(node, repr(2.0 * value if value else 1.0))

    def visit_Slice(self, node: ast.Slice) -> None:
        for bound in (node.lower, node.upper):
            if bound is not None and not isinstance(bound, ast.Constant):
                self.change(bound, f"{self.atom(bound)} - 1", f"{self.atom(bound)} + 1")
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr == "T":
            self.change(node, self.code(node.value))
        if node.attr in SWAPPED:
            self.change(node, f"{self.code(node.value)}.{SWAPPED[node.attr]}")
        self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        if node.id in SWAPPED and isinstance(node.ctx, ast.Load):
            self.change(node, SWAPPED[node.id])

    def visit_Call(self, node: ast.Call) -> None:
        name = self.code(node.func).split(".")[-1]
        if name in DROPPED_CALLS and node.args:
            self.change(node, self.atom(node.args[0]))
        if len(node.args) == 2 and name not in SYMMETRIC and not any(isinstance(each, ast.Starred) for each in node.args):
            one, two = node.args
            self.change(one, f"{self.code(two)}, {self.code(one)}", last=two)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self.change(node, f"{self.atom(node.orelse)} if {self.code(node.test)} else {self.atom(node.body)}")
        self.generic_visit(node)


def mutated(file: str, source: str, change: Change) -> Mutant | None:
    """The mutant of a change, or None where it is no code, or the same."""
    data = source.encode()
    text = (data[: change.first] + change.new.encode() + data[change.last :]).decode()
    try:
        if ast.dump(ast.parse(text)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    pairs = zip([*source.splitlines(), ""], [*text.splitlines(), ""], strict=False)
    before, after = next((old.strip(), new.strip()) for old, new in pairs if old != new)
    return Mutant(file, change.function, before, after, change.lines, text)


def drawn(n: int, seed: int, sources: Mapping[str, str], line: int = 0) -> dict[str, Mutant]:
    """{key: mutant} of n mutants; of one line, where it is given.

    Each change has its own number, drawn from the seed and its line alone; the n least are taken. So those of a larger n begin
    with those of a smaller one, and code that changes elsewhere changes few of them.
    """
    numbered = []
    for file, source in sources.items():
        drawer = Drawer(source)
        for change in drawer.found:
            at = bisect.bisect_right(drawer.starts, change.first)
            begin, end = drawer.starts[at - 1], drawer.starts[at]
            told = f"{seed} {file} {change.function} {change.first - begin} {change.new} ".encode() + drawer.source[begin:end]
            if not line or at == line:
                numbered.append((hashlib.sha256(told).digest(), file, change))
    out: dict[str, Mutant] = {}
    for _, file, change in sorted(numbered, key=lambda each: each[0]):
        if len(out) == n:
            break
        mutant = mutated(file, sources[file], change)
        if mutant:
            out.setdefault(mutant.key, mutant)
    return out
