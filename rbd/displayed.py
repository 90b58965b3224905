"""What a notebook shows of a record at the end of a cell: one method, which all records of the package share."""

from __future__ import annotations


class Displayed:
    """A record that notebooks show as a table: the result first, then numbers with units, then the proof, folded."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """The record as HTML, for Jupyter and its kin; see `rbd.visual.notebook`."""
        from rbd.visual.notebook.shown import html_of

        return html_of(self)
