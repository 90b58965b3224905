"""Warnings of contacts that do not fit a state: those that separate, and those that are off their planes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from rbd.errors import DistantContactWarning, OpeningContactWarning
from rbd.model.checked_model import CheckedModel
from rbd.problem.contact_motion import Opening, opening_words
from rbd.problem.force_set import at_rest
from rbd.problem.rows import Rows


def warn_of_opening(robot: CheckedModel, openings: Sequence[Opening], rest_speed: float, *, stacklevel: int) -> None:
    """Name the contacts that move away from what they touch; nothing where none does."""
    if openings:
        warnings.warn(
            f"contacts of {robot.name} separate, and carry no force: {opening_words(openings)} "
            f"(at rest is up to rest_speed = {rest_speed:g} m/s). Of contacts that stay, put the velocity onto them, "
            "state = rbd.mechanism.project_velocity(state, contacts), or give a larger rest_speed=.",
            OpeningContactWarning,
            stacklevel=stacklevel + 1,
        )


def warn_of_distant(robot: CheckedModel, rows: Sequence[Rows], *, below_only: bool = False, stacklevel: int) -> None:
    """Warn of contacts that are off their planes, by name.

    Args:
        robot: Whose.
        rows: Of contacts; those whose feedback pulls them back are left out.
        below_only: Of unilateral contacts, name only those below their planes: others fall onto them.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    told = distant(rows, below_only=below_only)
    if told:
        more = f" and {len(told) - 6} more" if len(told) > 6 else ""
        warnings.warn(
            f"contacts of {robot.name} are off the ground that they stand on: {', '.join(told[:6])}{more}. Move the robot "
            "(robot.standing() puts its feet on z = 0), leave out what does not touch, or give the plane: robot.feet(on=0.75), "
            "robot.feet(on={'left_sole': 0.17}), on=rbd.Ground(point=..., normal=...); on=None where it is not known.",
            DistantContactWarning,
            stacklevel=stacklevel,
        )


def distant(rows: Sequence[Rows], *, below_only: bool = False) -> list[str]:
    """Contacts that are off their planes, by how much, in words; see `warn_of_distant`."""
    told = []
    for r in rows:
        gaps = r.gaps_off_plane
        if gaps is None:
            continue
        assert r.patch is not None
        within = r.patch.within
        far = np.abs(gaps) > within
        if below_only and not at_rest(r.cone).bilateral:
            far = gaps < -within
        if far.any():
            worst = float(gaps[np.argmax(np.abs(gaps) * far)])
            which = "" if len(gaps) == 1 or far.all() else f" ({int(far.sum())} of {len(gaps)} points)"
            told.append(f"{r.name!r:.80}{which} {1e3 * abs(worst):.4g} mm {'above' if worst > 0.0 else 'below'}")
    return told
