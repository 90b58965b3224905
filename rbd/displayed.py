"""The drawings of records, asked for by name: what has one imports no pictures; and what a notebook shows of a record."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

_pictures: list[Callable[[], ModuleType]] = []


def drawn_by(pictures: Callable[[], ModuleType]) -> None:
    """Name the module that draws, given as what imports it: only the first drawing loads it."""
    _pictures[:] = [pictures]


def drawing(name: str) -> Callable[..., Any]:
    """A function of the module that draws, `rbd.visual`, by its name there."""
    return getattr(_pictures[0](), name)


class Displayed:
    """A record that notebooks show as a table: the result first, then numbers with units, then the certificate, folded."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Its class, and the first line of what it prints."""
        if type(self).__str__ in (object.__str__, BaseException.__str__):
            return super().__repr__()
        return f"{type(self).__name__}({str(self).partition(chr(10))[0]})"

    def _repr_html_(self) -> str:
        """The record as HTML, for Jupyter and its kin; see `rbd.visual.notebook`."""
        return str(drawing("html_of")(self))
