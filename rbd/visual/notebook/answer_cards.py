"""Cards of answers: a motion with its forces, torques that hold, residuals, what is unique, what contradicts."""

from __future__ import annotations

import math

import numpy as np

from rbd.answers.analysis.infeasibility import Contradiction
from rbd.answers.analysis.uniqueness import Range, Uniqueness
from rbd.answers.solution import Solution
from rbd.arrays import Array, largest_first, max_abs
from rbd.control.step_problem import TaskActuation
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import FORCE_OF
from rbd.problem.answer import Answer, ContactForce, Status
from rbd.problem.contact_motion import opening_words
from rbd.problem.force_set import at_rest
from rbd.problem.residuals import Residuals
from rbd.statics.actuation import Actuation
from rbd.visual.notebook.card import Card, CardTable, Fold, card_of, fixed, joined, number, share, vector, words

CONTACT_HEADS = ("contact", "normal force [N]", "tangential force [N]", "friction used", "centre of pressure [m]")
RESIDUAL_HEADS = ("equation", "largest residual", "unit", "scaled", "what it says")
STILL = 1e-6
"""Accelerations up to this are none [m/s2, rad/s2]."""
LOADED_N = 1e-6
"""Points with less normal force carry nothing."""
MOTORS = 5
"""Motors that a table of torques lists: those nearest to their limits."""
_EQUATIONS = {
    "stationarity": ("N", "equations of motion, M a - rhs - J^T f"),
    "feasibility": ("m/s2", "no contact sinks, no constraint is violated"),
    "cone": ("N", "forces are within friction"),
    "complementarity": ("N m/s2", "what opens carries nothing; friction opposes slip"),
    "centroidal": ("N", "all forces together make the centroidal momentum change"),
}


def contact_table(contacts: dict[str, ContactForce], does: dict[str, str] | None = None) -> CardTable:
    """Normal and tangential forces, friction used, centre of pressure; with a column of what each contact does."""
    rows = []
    for name, c in contacts.items():
        place = "-" if c.centre_of_pressure is None else vector(c.centre_of_pressure)
        row = (name, fixed(c.normal, 2), fixed(c.tangential, 2), share(c.friction_used), place)
        rows.append((*row, does.get(name, "")) if does is not None else row)
    return CardTable(rows, (*CONTACT_HEADS, *(["it"] if does is not None else [])))


def residual_table(residuals: Residuals) -> CardTable:
    """The residuals of an answer with their units, and what each equation says."""
    rows = []
    for name, scaled in residuals.scaled.items():
        unit, what = _EQUATIONS[name]
        rows.append((name, f"{float(getattr(residuals, name)):.1e}", unit, f"{scaled:.1e}", what))
    return CardTable(rows, RESIDUAL_HEADS)


@card_of.register
def _residuals(record: Residuals) -> Card:
    within = record.within(1e-9)
    said = f"largest scaled residual {record.worst:.1e}: {'solved, at most 1e-9' if within else 'above 1e-9'}"
    return Card(said, within, [residual_table(record)])


@card_of.register
def _contact_force(record: ContactForce) -> Card:
    used = "" if record.friction_used is None else f"; {share(record.friction_used)} of the friction is used"
    said = f"normal force {fixed(record.normal, 2)} N, tangential {fixed(record.tangential, 2)} N{used}"
    return Card(said, tables=[CardTable([("centre of pressure", words(record.centre_of_pressure), "m")])])


def _does(answer: Answer) -> dict[str, str]:
    """{contact: "holds", "sticks", "slips at ... m/s2", ...} by the accelerations of its points."""
    P = answer.problem
    T = P.force_set_of(answer.law)
    y = T.accelerations(P.J @ answer.a + P.offset)
    sliding, opening = {point.rows for point in P.force_set.sliding}, set(answer.opening)
    out = {}
    for i, rows in enumerate(P.rows):
        if rows.patch is None:
            continue
        if rows.name in opening:
            out[rows.name] = "separates"
        elif not len(rows) or at_rest(rows.cone).bilateral:
            out[rows.name] = "is held"
        elif rows.name in sliding:
            out[rows.name] = "slides"
        else:
            motion = T.point_accelerations(y, i)
            slip, lift = np.hypot(motion[:, 0], motion[:, 1]), motion[:, 2]
            slip = slip[lift <= STILL]
            if (lift > STILL).all():
                out[rows.name] = f"lifts off, {number(lift.max(), 3)} m/s2"
            elif slip.max(initial=0.0) > STILL:
                out[rows.name] = f"starts to slip, {number(slip.max(), 3)} m/s2"
            else:
                out[rows.name] = "sticks" if (lift <= STILL).all() else f"tips, {number(lift.max(), 3)} m/s2"
    return out


def _happens(answer: Answer, does: dict[str, str]) -> str:
    if answer.impact:
        return answer.impact
    if max_abs(answer.a) <= STILL:
        return "nothing accelerates: it stays as it is"
    groups: dict[str, list[str]] = {}
    for name, what in does.items():
        groups.setdefault(what.split(",")[0], []).append(name)
    told = [f"{joined(names, 4)} {_plural(what) if len(names) > 1 else what}" for what, names in groups.items()]
    return "it accelerates" + (f"; {'; '.join(told)}" if told else "")


def _plural(what: str) -> str:
    several = {"is held": "are held", "lifts off": "lift off", "starts to slip": "start to slip"}
    return several.get(what, what.removesuffix("s"))


@card_of.register
def _answer(record: Answer) -> Card:
    answers = record.status in (Status.SOLVED, Status.INACCURATE)
    does = _does(record) if answers else {}
    method = f"{record.law} law, by {record.method or record.solver}"
    if answers:
        said = f"{_happens(record, does)} ({record.status}, {method})"
    else:
        said = f"no answer: {record.status} ({method})" + (f": {record.reason or record.worst}")
    tables = [contact_table(record.contacts, does)] if record.contacts else []
    others = [rows for rows in record.problem.rows if rows.patch is None and len(rows)]
    forces = [(rows.name, words(record.forces[rows.name]), "N, N m") for rows in others]
    if forces:
        tables.append(CardTable(forces, ("constraint", "force or torque", "unit")))
    whole = [
        ("acceleration a, largest entry", number(max_abs(record.a), 4), "m/s2, rad/s2"),
        ("1/2 |a - a_free|_M^2, Gauss's function", number(record.gauss), "N m/s2"),
        ("constraint rows", f"{record.problem.m}, of rank {record.rank}", ""),
    ]
    tables.append(CardTable(whole, ("of the whole", "value", "unit")))
    notes = [f"Separate already, and carry no force: {opening_words(record.problem.openings)}."] if record.opening else []
    notes += [f"One of several motions: {record.reason}"] if record.others else []
    if isinstance(record, Solution) and not answers and not record.impact and record.contradiction is not None:
        notes.append(str(record.contradiction.claim) + ".")
    folds = [Fold(f"Proof: residuals, the largest scaled {record.residuals.worst:.1e}", [residual_table(record.residuals)])]
    return Card(said, answers, tables, notes, folds)


def torque_table(robot: CheckedModel, tau: Array, v: Array | None = None, most: int = MOTORS) -> CardTable:
    """The motors nearest to their limits at a velocity; where none are stated, those with the largest torques."""
    names, limit = robot.actuated_names, robot.effort_limit
    units = [FORCE_OF.get(c.unit, "") for c in robot.motor_coordinates]
    shares = robot.torque_use(tau, v)
    used = shares if np.isfinite(limit).any() else np.abs(tau)
    rows = []
    for i in largest_first(used)[:most]:
        most_used = share(shares[i]) if math.isfinite(limit[i]) else "no limit stated"
        rows.append((names[i], fixed(tau[i], 3), units[i], most_used))
    return CardTable(rows, ("motor", "torque or force", "unit", "of its limit"), whole=len(names), rest="tau")


def _held(record: Actuation) -> str:
    robot, limit = record.state.robot, record.state.robot.effort_limit
    does = "it can be held" if record.still else "the motion is possible"
    if isinstance(record, TaskActuation):
        does = (
            "the step is possible" if record.violation is None else f"contacts or joint limits are violated: {record.violation}"
        )
    if robot.nu and np.isfinite(limit).any():
        used = record.torque_use
        worst = int(np.argmax(used))
        does += f"; nearest to its limit is {robot.actuated_names[worst]}, {share(used[worst])} of its torque"
    return does


@card_of.register
def _actuation(record: Actuation) -> Card:
    margins, robot = record.margins, record.state.robot
    solved = record.status in (Status.SOLVED, Status.INACCURATE)
    tables = [contact_table(record.contacts)] if record.contacts else []
    tables.append(torque_table(robot, record.tau, record.state.v))
    rows = [(f"friction left, {name}", share(left), "of the cone") for name, left in margins.friction.items()]
    rows += [
        (f"centre of pressure to the edge, {name}", fixed(1e3 * d, 1), "mm") for name, d in margins.centre_of_pressure.items()
    ]
    notes = [] if record.least else ["Other torques may need less effort: the least was not found to nine digits."]
    good = solved
    folds = [Fold("What is left of each limit", [CardTable(rows, ("limit", "left", "unit"))])] if rows else []
    if isinstance(record, TaskActuation):
        good = solved and record.violation is None
        missed = [(name, number(max_abs(off), 3), "m/s2, rad/s2") for name, off in record.missed.items()]
        tables.insert(0, CardTable(missed, ("task", "missed by", "unit")))
        notes += [f"At a limit ({kind}): {joined(names)}." for kind, names in record.at_limit.items()]
        folds.append(Fold("Proof: certificate of the step", list(card_of(record.certificate).tables)))
    folds.append(Fold(f"Proof: residuals, the largest scaled {record.residuals.worst:.1e}", [residual_table(record.residuals)]))
    said = f"{robot.name}: {_held(record)}" + ("" if solved else f" ({record.status})")
    return Card(said, good, tables, notes, folds)


def _range(x: Range) -> tuple[str, str]:
    return number(x.lowest, 5), number(x.highest, 5)


@card_of.register
def _uniqueness(record: Uniqueness) -> Card:
    free = record.row_freedom or record.corner_freedom or record.motion_freedom
    what = record.quantity
    said = f"all {what}s are unique" if not free else f"the motion is unique, not all {what}s are"
    if record.motion_freedom:
        said = f"the motion is one of a family of dimension {record.motion_freedom}"
    elif free and not record.row_freedom:
        said = f"motion and contact {what}s are unique; how corners share them is not"
    rows = [(name, *_range(c.normal), "yes" if c.unique_wrench else "no") for name, c in record.contacts.items()]
    table = CardTable(rows, ("contact", "normal force from [N]", "to [N]", "force and moment unique"))
    counts = [
        (f"internal {what}s of the rows", str(record.row_freedom)),
        (f"internal {what}s of the corners", str(record.corner_freedom)),
        ("rows", f"{record.rows} of rank {record.rank}"),
    ]
    notes = [f"Returned: {record.force_choice}."]
    return Card(said, None, [table, CardTable(counts, ("number of", ""))], notes, [Fold("As printed", [str(record)])])


@card_of.register
def _contradiction(record: Contradiction) -> Card:
    rows = [(name, words(record.certificate[name]), joined(record.rows[name]) or "all") for name in record.rows]
    table = CardTable(rows, ("constraint", "force that proves it", "rows"))
    size = "No smaller set contradicts itself." if record.smallest else "A smaller set was not excluded."
    said = f"not possible: {record.claim} (law {record.law})"
    proof = [
        ("violation", number(record.violation, 4), "m/s2, rad/s2"),
        ("largest entry of |J^T f|, zero for a proof", f"{record.unbalanced:.1e}", "N, N m"),
    ]
    return Card(said, False, [table], [size], [Fold("Proof", [CardTable(proof), str(record)])])
