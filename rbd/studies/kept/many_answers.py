"""What is kept of answers at many states, row by row: of `rbd.solve_many`, `hold_many` and `inverse_dynamics_many`."""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.answers import ManyAnswers
from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.studies.kept.answers import ABOUT
from rbd.studies.kept.registry import Kept, Kind, Rows


def _rows(found: ManyAnswers) -> Rows:
    return found.reason_codes, found.reasons


def _coordinates(what: str) -> Kept:
    def of(found: Any) -> list[Named]:
        values = getattr(found.states if what in ("q", "v") else found, what)
        return [naming.coordinates(what, values, found.states.robot)]

    return Kept(ABOUT[what], of, what in ("a", "tau"))


def _forces(found: ManyAnswers) -> list[Named]:
    return [naming.force(name, x, contact=name in found.friction_used) for name, x in found.forces.items()]


def _used(found: Any) -> Array:
    return np.asarray(found.states.robot.torque_use(found.tau, found.states.v))


def _worst_torque(found: Any) -> list[Named]:
    used = _used(found)
    worst = used.max(axis=1) if used.shape[1] else np.zeros(len(used))
    return [("worst_torque", Variable(worst, (), "1", ABOUT["worst_torque"]))]


_CERTIFICATE = ("status", "worst_residual")
_NAMES = {
    "status": Kept(ABOUT["status"], lambda found: [naming.status(found.status)]),
    "worst_residual": Kept(ABOUT["worst_residual"], lambda found: [naming.worst_residual(found.worst)]),
    "residuals": Kept(ABOUT["residuals"], lambda found: [naming.residual(x, y) for x, y in found.residuals.items()], False),
    "a": _coordinates("a"),
    "forces": Kept(ABOUT["forces"], _forces),
    "corner_forces": Kept(
        ABOUT["corner_forces"], lambda found: [naming.corner_forces(x, y) for x, y in found.corner_forces.items()], False
    ),
    "friction_used": Kept(
        ABOUT["friction_used"],
        lambda found: [naming.of_contact("friction_used", x, y) for x, y in found.friction_used.items()],
    ),
    "centre_of_pressure": Kept(
        ABOUT["centre_of_pressure"],
        lambda found: [naming.centre_of_pressure(x, y) for x, y in found.centre_of_pressure.items()],
        False,
    ),
    "q": _coordinates("q"),
    "v": _coordinates("v"),
    "method": Kept(ABOUT["method"], lambda found: [("method", Variable(found.method, (), "", ABOUT["method"]))], False),
}
KINDS = {
    "rbd.answers.many.answers.ManyAnswers": Kind(_NAMES, _CERTIFICATE, rows=_rows),
    "rbd.statics.actuations.Actuations": Kind(
        {name: kept for name, kept in _NAMES.items() if name != "a"}
        | {
            "tau": _coordinates("tau"),
            "used_torque": Kept(
                ABOUT["used_torque"], lambda f: [naming.coordinates("used_torque", _used(f), f.states.robot)], False
            ),
            "worst_torque": Kept(ABOUT["worst_torque"], _worst_torque),
            "a": Kept(ABOUT["a"], _coordinates("a").of, False),
            "least": Kept(ABOUT["least"], lambda f: [("least", Variable(f.least, (), "", ABOUT["least"]))], False),
            "margin": Kept(ABOUT["margin"], lambda f: [("margin", Variable(f.margin, (), "1", ABOUT["margin"]))], False),
        },
        _CERTIFICATE,
        rows=_rows,
    ),
}
"""What is kept of each class."""
