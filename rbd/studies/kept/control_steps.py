"""What is kept of a step of whole-body control: an actuation, what its tasks missed, and the proof of least cost."""

from __future__ import annotations

from typing import Any

from rbd.answers.many import naming
from rbd.answers.many.naming import Named
from rbd.arrays import max_abs
from rbd.control.task_actuation import TaskActuation
from rbd.studies.kept import answers
from rbd.studies.kept.registry import Kept, Kind, number, one


def _missed(found: TaskActuation) -> list[Named]:
    return [
        each
        for name, off in found.missed.items()
        for each in number(f"missed_{naming.key(name)}", max_abs(off), "m/s2 or rad/s2", f"largest entry of what {name} missed")
    ]


def _violation(found: TaskActuation) -> Any:
    return 0.0 if found.violation is None else found.violation.worst


_ACTUATION = answers.KINDS["rbd.statics.actuation.Actuation"]
KINDS = {
    "rbd.control.task_actuation.TaskActuation": Kind(
        {
            **{name: _ACTUATION.names[name] for name in _ACTUATION.certificate},
            **one(
                "worst_certificate", "largest error of the step: equations, limits, least cost", lambda x: x.certificate.worst
            ),
            **_ACTUATION.names,
            "missed": Kept("largest entry of what each task missed", _missed),
            **one("violation", "by how much contacts and joint limits are violated", _violation, "m/s2 or rad/s2"),
        },
        (*_ACTUATION.certificate, "worst_certificate"),
        _ACTUATION.verdict,
    )
}
"""What is kept of each class."""
