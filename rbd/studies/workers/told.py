"""The warnings of a user's function at many samples, counted: one is issued at the end for each kind."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rbd.errors.warned import StudyWarning, stacklevel_of_user

Kind = tuple[str, str]
"""Module and name of the class of a warning: the class itself may be unknown in another process."""


@dataclass(eq=False)
class Told:
    """Warnings by their kind.

    Attributes:
        counts: {kind: number of samples that gave such a warning}; of a batched function, of calls.
        first: {kind: number of the first of these samples}.
        texts: {kind: its message}.
    """

    counts: dict[Kind, int] = field(default_factory=dict)
    first: dict[Kind, int] = field(default_factory=dict)
    texts: dict[Kind, str] = field(default_factory=dict)

    def add(self, i: int, caught: list[warnings.WarningMessage]) -> None:
        """The warnings of sample i."""
        for warning in reversed(caught):
            self._count((warning.category.__module__, warning.category.__qualname__), 0, i, str(warning.message))
        for kind in {(w.category.__module__, w.category.__qualname__) for w in caught}:
            self.counts[kind] += 1

    def join(self, other: Told) -> None:
        """Count the warnings of other samples too."""
        for kind, n in other.counts.items():
            self._count(kind, n, other.first[kind], other.texts[kind])

    def _count(self, kind: Kind, n: int, i: int, text: str) -> None:
        self.counts[kind] = self.counts.get(kind, 0) + n
        if i <= self.first.get(kind, i):  # whatever the order of the chunks, the message of the first sample is told
            self.first[kind], self.texts[kind] = i, text

    def warn(self, total: int) -> None:
        """Issue one warning for each kind, of the kind's own class where it is known here.

        Args:
            total: Number of all samples.
        """
        for (module, name), n in sorted(self.counts.items()):
            found = getattr(sys.modules.get(module), name, None)
            known = isinstance(found, type) and issubclass(found, Warning)
            first = self.first[module, name]
            where = f"sample {first:,}" if n == 1 else f"{n:,} of {total:,} calls warn so, the first of them sample {first:,}"
            text = f"{self.texts[module, name]} [{where}]"
            category = found if known and found is not None else StudyWarning
            warnings.warn(
                text if known else f"{name}: {text}",
                category,
                stacklevel=stacklevel_of_user(),
            )


@contextmanager
def recorded() -> Iterator[list[warnings.WarningMessage]]:
    """A list of the warnings that are issued within, all of them, whatever filters are set; none is shown or raised.

    The filters are those of the whole process, so this is used by one thread at a time.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield caught
