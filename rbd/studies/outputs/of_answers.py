"""What a study keeps of answers, at one state and at many, of their uniqueness, and of steps of control."""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.answers.analysis.uniqueness import Uniqueness
from rbd.answers.comparison import LawComparison
from rbd.answers.many import naming
from rbd.answers.many.many_answers import ManyAnswers
from rbd.answers.many.naming import Named, StateStatus, Variable
from rbd.arrays import Array, max_abs
from rbd.control.step_problem import TaskActuation
from rbd.problem.answer import Answer
from rbd.statics.actuation import Actuation
from rbd.studies.outputs.fields import OutputField, ResultType, Rows, Verdict, number, one

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
    "status": OutputField(ABOUT["status"], _status),
    "worst_residual": OutputField(ABOUT["worst_residual"], lambda found: [naming.worst_residual(found.residuals.worst)]),
    "residuals": OutputField(ABOUT["residuals"], _residuals, False),
}
_FORCES = {
    "forces": OutputField(ABOUT["forces"], _forces),
    "corner_forces": OutputField(ABOUT["corner_forces"], _corners, False),
    "normal_force": OutputField(ABOUT["normal_force"], _normal, False),
    "friction_used": OutputField(ABOUT["friction_used"], _friction),
    "centre_of_pressure": OutputField(ABOUT["centre_of_pressure"], _pressure, False),
}
_ONE_STATE = {
    "rbd.problem.answer.Answer": ResultType(
        {
            **_COMMON,
            "a": OutputField(ABOUT["a"], _a),
            **_FORCES,
            "gauss": OutputField("Gauss's function 1/2 |a - a_free|_M^2", _gauss, False),
            **one("method", ABOUT["method"], lambda found: found.method or found.solver, "", default=False),
            **one("law", "law of the contact forces", lambda found: str(found.law), "", default=False),
        },
        _CERTIFICATE,
        verdict_of,
    ),
    "rbd.statics.actuation.Actuation": ResultType(
        {
            **_COMMON,
            "tau": OutputField(ABOUT["tau"], lambda held: [naming.coordinates("tau", held.tau, held.state.robot)]),
            "used_torque": OutputField(
                ABOUT["used_torque"], lambda held: [naming.coordinates("used_torque", _used(held), held.state.robot)], False
            ),
            "worst_torque": OutputField(ABOUT["worst_torque"], _worst_torque),
            "worst_motor": OutputField(ABOUT["worst_motor"], _worst_motor, False),
            **_FORCES,
            "margins": OutputField(ABOUT["margins"], _margins, False),
            "a": OutputField(ABOUT["a"], lambda held: [naming.coordinates("a", held.a, held.state.robot)], False),
            **one("least", ABOUT["least"], lambda held: held.least, "", default=False),
            **one("margin", ABOUT["margin"], lambda held: held.margin, default=False),
            **one("method", ABOUT["method"], lambda held: held.method, "", default=False),
        },
        _CERTIFICATE,
        verdict_of,
    ),
}
"""What is kept of each class."""


def _rows(found: ManyAnswers) -> Rows:
    return found.reason_codes, found.reasons


def _coordinates(what: str) -> OutputField:
    def of(found: Any) -> list[Named]:
        values = getattr(found.states if what in ("q", "v") else found, what)
        return [naming.coordinates(what, values, found.states.robot)]

    return OutputField(ABOUT[what], of, what in ("a", "tau"))


def _forces_by_state(found: ManyAnswers) -> list[Named]:
    return [naming.force(name, x, contact=name in found.friction_used) for name, x in found.forces.items()]


def _used_by_state(found: Any) -> Array:
    return np.asarray(found.states.robot.torque_use(found.tau, found.states.v))


def _worst_torque_by_state(found: Any) -> list[Named]:
    used = _used_by_state(found)
    worst = used.max(axis=1) if used.shape[1] else np.zeros(len(used))
    return [("worst_torque", Variable(worst, (), "1", ABOUT["worst_torque"]))]


_NAMES = {
    "status": OutputField(ABOUT["status"], lambda found: [naming.status(found.status)]),
    "worst_residual": OutputField(ABOUT["worst_residual"], lambda found: [naming.worst_residual(found.worst)]),
    "residuals": OutputField(
        ABOUT["residuals"], lambda found: [naming.residual(x, y) for x, y in found.residuals.items()], False
    ),
    "a": _coordinates("a"),
    "forces": OutputField(ABOUT["forces"], _forces_by_state),
    "corner_forces": OutputField(
        ABOUT["corner_forces"], lambda found: [naming.corner_forces(x, y) for x, y in found.corner_forces.items()], False
    ),
    "friction_used": OutputField(
        ABOUT["friction_used"],
        lambda found: [naming.of_contact("friction_used", x, y) for x, y in found.friction_used.items()],
    ),
    "centre_of_pressure": OutputField(
        ABOUT["centre_of_pressure"],
        lambda found: [naming.centre_of_pressure(x, y) for x, y in found.centre_of_pressure.items()],
        False,
    ),
    "q": _coordinates("q"),
    "v": _coordinates("v"),
    "method": OutputField(ABOUT["method"], lambda found: [("method", Variable(found.method, (), "", ABOUT["method"]))], False),
}
_MANY_STATES = {
    "rbd.answers.many.many_answers.ManyAnswers": ResultType(_NAMES, _CERTIFICATE, rows=_rows),
    "rbd.statics.actuations.Actuations": ResultType(
        {name: kept for name, kept in _NAMES.items() if name != "a"}
        | {
            "tau": _coordinates("tau"),
            "used_torque": OutputField(
                ABOUT["used_torque"], lambda f: [naming.coordinates("used_torque", _used_by_state(f), f.states.robot)], False
            ),
            "worst_torque": OutputField(ABOUT["worst_torque"], _worst_torque_by_state),
            "a": OutputField(ABOUT["a"], _coordinates("a").of, False),
            "least": OutputField(ABOUT["least"], lambda f: [("least", Variable(f.least, (), "", ABOUT["least"]))], False),
            "margin": OutputField(ABOUT["margin"], lambda f: [("margin", Variable(f.margin, (), "1", ABOUT["margin"]))], False),
        },
        _CERTIFICATE,
        rows=_rows,
    ),
}
"""What is kept of each class."""


def _missed(found: TaskActuation) -> list[Named]:
    return [
        each
        for name, off in found.missed.items()
        for each in number(f"missed_{naming.key(name)}", max_abs(off), "m/s2 or rad/s2", f"largest entry of what {name} missed")
    ]


def _violation(found: TaskActuation) -> Any:
    return 0.0 if found.violation is None else found.violation.worst


_ACTUATION = _ONE_STATE["rbd.statics.actuation.Actuation"]
_CONTROL_STEPS = {
    "rbd.control.step_problem.TaskActuation": ResultType(
        {
            **{name: _ACTUATION.names[name] for name in _ACTUATION.certificate},
            **one(
                "worst_certificate", "largest error of the step: equations, limits, least cost", lambda x: x.certificate.worst
            ),
            **_ACTUATION.names,
            "missed": OutputField("largest entry of what each task missed", _missed),
            **one("violation", "by how much contacts and joint limits are violated", _violation, "m/s2 or rad/s2"),
        },
        (*_ACTUATION.certificate, "worst_certificate"),
        _ACTUATION.verdict,
    )
}
"""What is kept of each class."""


def _ranges(unique: Uniqueness) -> list[Named]:
    found: list[Named] = []
    for name, contact in unique.contacts.items():
        for end in ("lowest", "highest"):
            about = f"{end} normal force of {name}"
            found += number(f"normal_{end}_{naming.key(name)}", getattr(contact.normal, end), "N", about)
    return found


_UNIQUENESS = {
    "rbd.answers.analysis.uniqueness.Uniqueness": ResultType(
        {
            **one(
                "row_freedom", "dimension of the row forces of the same motion; 0: unique", lambda unique: unique.row_freedom
            ),
            **one("corner_freedom", "the same of the forces at corners", lambda unique: unique.corner_freedom),
            **one("motion_freedom", "dimension of the family of motions; 0: one motion", lambda unique: unique.motion_freedom),
            "normal_ranges": OutputField("lowest and highest normal force of each contact with the same motion", _ranges),
            **one("limits_exact", "whether the ranges are exact, to 1e-9", lambda unique: unique.exact, ""),
            **one("limits_found", "whether all ranges were found", lambda unique: unique.found, ""),
        },
        ("limits_exact", "limits_found"),
    ),
}
"""What is kept of each class."""


def _worst(both: LawComparison) -> list[Named]:
    return [naming.worst_residual(np.fmax(both.convex.residuals.worst, both.coulomb.residuals.worst))]


def _ratios(both: LawComparison) -> list[Named]:
    return [
        found
        for name, ratio in both.normal_ratio.items()
        for found in number(
            f"normal_ratio_{naming.key(name)}", ratio, "1", f"normal force of {name}, convex over Coulomb's law"
        )
    ]


def _lift_off(both: LawComparison) -> list[Named]:
    return [
        found
        for name, contact in both.under_convex.items()
        for found in number(
            f"lift_off_{naming.key(name)}", contact.lift_off, "m/s2", f"normal acceleration of {name} under the convex law"
        )
    ]


def _verdict(both: LawComparison) -> Verdict:
    return verdict_of(both.convex) or verdict_of(both.coulomb)


_COMPARISONS = {
    "rbd.answers.comparison.LawComparison": ResultType(
        {
            "worst_residual": OutputField("largest scaled residual of both answers", _worst),
            **one("difference", "difference of the accelerations, relative", lambda both: both.difference),
            **one("agree", "whether both laws give one motion, to 1e-7, and no other", lambda both: both.agree, ""),
            "normal_ratio": OutputField("normal force of each contact, convex over Coulomb's law", _ratios),
            "lift_off": OutputField("normal acceleration of each loaded contact under the convex law", _lift_off, False),
            **one("motions", "number of motions under Coulomb's law", lambda both: 1 + len(both.coulomb.others), default=False),
        },
        ("worst_residual",),
        _verdict,
    ),
    "rbd.mechanism.degrees_of_freedom.Mobility": ResultType(
        {
            **one("counted", "degrees of freedom that Gruebler and Kutzbach count", lambda found: found.count.value),
            **one("instantaneous", "degrees of freedom of the velocities that J allows", lambda found: found.instantaneous),
            **one("finite", "degrees of freedom of finite motions", lambda found: found.finite),
            **one("rank", "rank of J", lambda found: found.rank),
            **one("singular", "whether the rank of J is lower here than nearby", lambda found: found.singular, ""),
            **one("verdict", "the conclusion, in words", lambda found: found.verdict, "", default=False),
        }
    ),
}
"""What is kept of each class."""

KINDS = _ONE_STATE | _MANY_STATES | _CONTROL_STEPS | _UNIQUENESS | _COMPARISONS
