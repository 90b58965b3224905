"""`Law`: which forces go with which accelerations at a contact."""

from __future__ import annotations

import re
from dataclasses import dataclass

from rbd.errors import InputError

KINDS = ("bilateral", "convex", "coulomb")


@dataclass(frozen=True)
class Law:
    """A contact law, and what stands for its circular cones; printed e.g. as "convex, 4 facets".

    Attributes:
        kind: "bilateral" (no contact can break or slip), "convex" (Gauss's principle with cones of forces) or "coulomb"
            (maximal dissipation, which is not a minimum).
        facets: Of the pyramids that replace the circular cones, ascending; empty where cones are circular, or there are none.

    Raises:
        InputError: another kind; facets of another law than the convex one, or fewer than three.
    """

    kind: str
    facets: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise InputError(f"law is {self.kind!r:.80}; expected 'bilateral', 'convex', 'convex, 4 facets' or 'coulomb'.")
        fits = isinstance(self.facets, tuple) and all(type(n) is int and n >= 3 for n in self.facets)
        if not fits or (self.facets and self.kind != "convex"):
            raise InputError(
                f"facets of the {self.kind} law are {self.facets!r:.80}; expected e.g. (4,) of the convex law, or ()."
            )

    @classmethod
    def of(cls, given: Law | str) -> Law:
        """The law itself, or the one that prints as given.

        Raises:
            InputError: if there is none.
        """
        if isinstance(given, Law):
            return given
        facets = re.fullmatch(r"convex, (\d{1,4}(?: and \d{1,4})*) facets", given) if isinstance(given, str) else None
        return cls(given) if facets is None else cls("convex", tuple(sorted(map(int, facets[1].split(" and ")))))

    def __repr__(self) -> str:
        return f"Law({self.kind!r}{f', facets={self.facets}' if self.facets else ''})"

    def __str__(self) -> str:
        return self.kind + (f", {' and '.join(map(str, self.facets))} facets" if self.facets else "")


BILATERAL, CONVEX, COULOMB = map(Law, KINDS)
