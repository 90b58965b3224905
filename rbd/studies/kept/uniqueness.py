"""What is kept of `solution.uniqueness()`: dimensions of what is open, and ranges of normal forces."""

from __future__ import annotations

from rbd.answers.analysis.uniqueness import Uniqueness
from rbd.answers.many import naming
from rbd.answers.many.naming import Named
from rbd.studies.kept.registry import Kept, Kind, number, one


def _ranges(unique: Uniqueness) -> list[Named]:
    found: list[Named] = []
    for name, contact in unique.contacts.items():
        for end in ("lowest", "highest"):
            about = f"{end} normal force of {name}"
            found += number(f"normal_{end}_{naming.key(name)}", getattr(contact.normal, end), "N", about)
    return found


KINDS = {
    "rbd.answers.analysis.uniqueness.Uniqueness": Kind(
        {
            **one(
                "row_freedom", "dimension of the row forces of the same motion; 0: unique", lambda unique: unique.row_freedom
            ),
            **one("corner_freedom", "the same of the forces at corners", lambda unique: unique.corner_freedom),
            **one("motion_freedom", "dimension of the family of motions; 0: one motion", lambda unique: unique.motion_freedom),
            "normal_ranges": Kept("lowest and highest normal force of each contact with the same motion", _ranges),
            **one("limits_exact", "whether the ranges are exact, to 1e-9", lambda unique: unique.exact, ""),
            **one("limits_found", "whether all ranges were found", lambda unique: unique.found, ""),
        },
        ("limits_exact", "limits_found"),
    ),
}
"""What is kept of each class."""
