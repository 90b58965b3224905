"""What is kept of the answer at one state: of `rbd.solve`, of `rbd.hold` and `rbd.inverse_dynamics`."""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.naming import Named, Variable
from rbd.answers.many.status import StateStatus
from rbd.arrays import Array
from rbd.problem.answer import Answer
from rbd.statics.actuation import Actuation
from rbd.studies.kept.registry import Kept, Kind, Verdict, number, one

ABOUT = {
    "status": "solved, inaccurate, failed, ...: a code of rbd.answers.many.StateStatus",
    "worst_residual": "largest scaled residual: the certificate of the answer",
    "residuals": "scaled residual of each equation",
    "a": "accelerations, by velocity coordinate",
    "tau": "motor torques, by motor",
    "q": "configuration",
    "v": "velocities",
    "forces": "force or wrench of each constraint, on the robot, world axes",
    "corner_forces": "forces at the corners of each contact, world axes",
    "normal_force": "normal force of each contact",
    "friction_used": "|f_t| / (mu f_n) of each contact; NaN without load or coefficient",
    "centre_of_pressure": "centre of pressure of each contact in W; NaN without load",
    "method": "method that found it",
    "used_torque": "share of each motor's limit that is used",
    "worst_torque": "largest share of a motor limit that is used",
    "worst_motor": "the motor with the largest share",
    "margins": "margin of each contact: share of its friction, and distance of its centre of pressure from the edge",
    "least": "whether the effort is the least, to nine digits",
    "margin": "share of friction that was kept unused",
}
"""What each name is, of one state and of many."""


def _status(found: Any) -> list[Named]:
    return [naming.status(StateStatus[found.status.name])]


def _residuals(found: Any) -> list[Named]:
    return [naming.residual(name, value) for name, value in found.residuals.scaled.items()]


def _a(found: Answer) -> list[Named]:
    origin = getattr(found.problem.origin, "state", None)
    if origin is not None:
        return [naming.coordinates("a", found.a, origin.robot)]
    return [("a", Variable(found.a, ("velocity",), "", "acceleration"))]  # of a problem in arrays


def _forces(found: Any) -> list[Named]:
    contacts = found.contacts
    return [naming.force(name, value, contact=name in contacts) for name, value in found.forces.items()]


def _corners(found: Any) -> list[Named]:
    return [naming.corner_forces(name, value) for name, value in found.corner_forces.items()]


def _normal(found: Any) -> list[Named]:
    return [naming.of_contact("normal_force", name, contact.normal) for name, contact in found.contacts.items()]


def _friction(found: Any) -> list[Named]:
    return [naming.of_contact("friction_used", name, contact.friction_used) for name, contact in found.contacts.items()]


def _pressure(found: Any) -> list[Named]:
    return [naming.centre_of_pressure(name, contact.centre_of_pressure) for name, contact in found.contacts.items()]


def _used(found: Actuation) -> Array:
    return np.asarray(found.state.robot.torque_use(found.tau, found.state.v))


def _worst_torque(found: Actuation) -> list[Named]:
    return number("worst_torque", _used(found).max(initial=0.0), "1", ABOUT["worst_torque"])


def _worst_motor(found: Actuation) -> list[Named]:
    robot = found.state.robot
    name = robot.motor_coordinates[int(np.argmax(_used(found)))].name if robot.nu else ""
    return number("worst_motor", name, "", ABOUT["worst_motor"])


def _margins(found: Actuation) -> list[Named]:
    margins = found.margins
    friction = [naming.of_contact("margin_friction", name, margins.friction.get(name)) for name in found.contacts]
    return friction + [naming.of_contact("margin_pressure", name, x) for name, x in margins.centre_of_pressure.items()]


def _gauss(found: Any) -> list[Named]:
    return number("gauss", float(found.gauss), "N m/s2", "1/2 |a - a_free|_M^2")


def verdict_of(found: Answer | Actuation) -> Verdict:
    """Why an answer is none: it was asked for without a check of its residuals."""
    status = StateStatus[found.status.name]
    if status <= StateStatus.INACCURATE:
        return None
    answer = found if isinstance(found, Answer) else found.answer
    return status.reason, answer.reason or answer.impact or answer.worst


_CERTIFICATE = ("status", "worst_residual")
_COMMON = {
    "status": Kept(ABOUT["status"], _status),
    "worst_residual": Kept(ABOUT["worst_residual"], lambda found: [naming.worst_residual(found.residuals.worst)]),
    "residuals": Kept(ABOUT["residuals"], _residuals, False),
}
_FORCES = {
    "forces": Kept(ABOUT["forces"], _forces),
    "corner_forces": Kept(ABOUT["corner_forces"], _corners, False),
    "normal_force": Kept(ABOUT["normal_force"], _normal, False),
    "friction_used": Kept(ABOUT["friction_used"], _friction),
    "centre_of_pressure": Kept(ABOUT["centre_of_pressure"], _pressure, False),
}
KINDS = {
    "rbd.problem.answer.Answer": Kind(
        {
            **_COMMON,
            "a": Kept(ABOUT["a"], _a),
            **_FORCES,
            "gauss": Kept("Gauss's function 1/2 |a - a_free|_M^2", _gauss, False),
            **one("method", ABOUT["method"], lambda found: found.method or found.solver, "", default=False),
            **one("law", "law of the contact forces", lambda found: str(found.law), "", default=False),
        },
        _CERTIFICATE,
        verdict_of,
    ),
    "rbd.statics.actuation.Actuation": Kind(
        {
            **_COMMON,
            "tau": Kept(ABOUT["tau"], lambda held: [naming.coordinates("tau", held.tau, held.state.robot)]),
            "used_torque": Kept(
                ABOUT["used_torque"], lambda held: [naming.coordinates("used_torque", _used(held), held.state.robot)], False
            ),
            "worst_torque": Kept(ABOUT["worst_torque"], _worst_torque),
            "worst_motor": Kept(ABOUT["worst_motor"], _worst_motor, False),
            **_FORCES,
            "margins": Kept(ABOUT["margins"], _margins, False),
            "a": Kept(ABOUT["a"], lambda held: [naming.coordinates("a", held.a, held.state.robot)], False),
            **one("least", ABOUT["least"], lambda held: held.least, "", default=False),
            **one("margin", ABOUT["margin"], lambda held: held.margin, default=False),
            **one("method", ABOUT["method"], lambda held: held.method, "", default=False),
        },
        _CERTIFICATE,
        verdict_of,
    ),
}
"""What is kept of each class."""
