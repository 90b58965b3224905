"""What an answer of `rbd.solve` costs, from State on to its certificate, as multiples of one `constraintDynamics` call."""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from bench_draws import MANY, Draw, Draws, stacked
from bench_peers import ConstraintDynamics, PlainProxQP, PlainScript, raw_terms
from bench_timing import Column, Row, once, turns

import rbd
from rbd.constraints.constraint import Constraint
from rbd.errors import RbdWarning
from rbd.solvers import Solver
from rbd.solvers.default import GaussFirst

UNIT = "constraintDynamics, unchecked"
CALLS = "x constraintDynamics"
HELD, STICKING, CONVEX, COULOMB = "held", "frictional, sticking", "slipping, convex law", "slipping, Coulomb's law"
GENERAL = "the general way, "
"""Beginning of rows that do not take the prepared form."""
MEAN = "mean of all calls, "
MARKS = {
    HELD: (2.5, 2.0),
    STICKING: (2.8, 2.3),
    CONVEX: (5.0, 4.0),
    COULOMB: (7.0, 5.5),
    "sticking, and an external force": (3.5, 3.0),
    "sticking, the eight corners as points": (4.0, 3.0),
    "sticking, and a joint at its limit": (6.0, 4.0),
    "sticking, and a locked joint": (6.0, 4.0),
    "sticking, and dry friction in a joint": (6.0, 4.0),
    "sticking, limits and dry friction of all joints": (15.0, 8.0),
    "without friction": (5.0,),
    "sliding at 0.3 m/s": (8.0, 6.0),
    "without contact": (),
}
"""First mark, and second where there is one."""
MANY_MARKS = {STICKING: (1.5,), CONVEX: (2.8,), COULOMB: (4.5,)}
POINTS_MARKS = (2.5, 1.7)
SOLVER_MARKS: dict[str, tuple[float, ...]] = {
    "held, ProxQP()": (10.0, 8.0),
    "frictional, sticking, ProxQP()": (25.0, 18.0),
    'frictional, sticking, ConeSolver(law="coulomb")': (25.0, 18.0),
    'frictional, sticking, ConeSolver(law="convex")': (25.0, 18.0),
    'frictional, slipping, ConeSolver(law="coulomb")': (60.0, 40.0),
    'frictional, slipping, ConeSolver(law="convex")': (60.0, 40.0),
    "inverse dynamics, no cone at its limit": (8.0, 5.0),
    "inverse dynamics, a cone at its limit": (20.0, 12.0),
    "inverse dynamics, and an external force": (8.0, 5.0),
    "inverse dynamics, other weights of torques and forces": (8.0, 5.0),
    "inverse dynamics, and a locked joint": (8.0, 5.0),
    "hold": (8.0, 5.0),
}


def solving(
    d: Draws, draws: Sequence[Draw], contacts: Sequence[Constraint], *, law: str | None = None, solver: Solver | None = None
) -> Column:
    """The whole way from (q, v, tau) to a certified answer."""

    def run(i: int) -> rbd.Solution:
        q, v, tau = draws[i]
        return rbd.solve(rbd.State(d.robot, q, v), tau, contacts, law=law, solver=solver)

    return run


def commanded(d: Draws, draws: Sequence[Draw], contacts: Sequence[Constraint] = (), **settings: object) -> Column:
    """Torques and forces of least effort from (q, v, a), with their residuals; on both soles if no contacts are given."""

    def run(i: int) -> rbd.Actuation:
        q, v, a = draws[i]
        return rbd.inverse_dynamics(rbd.State(d.robot, q, v), a, contacts or d.frictional, **settings)  # type: ignore[arg-type]

    return run


def commands_of(d: Draws) -> dict[str, Column]:
    """Inverse dynamics, and its neighbours: a push, other weights, a locked joint, poses that are held."""
    inside, at_limit = d.wanted()
    joint = [j for j in d.robot.joints.values() if j.nv == 1 and ("arm" in j.name or "shoulder" in j.name)][0]
    push, uneven = rbd.ExternalForce(d.frictional[0].frame, (5.0, 0.0, 0.0)), rbd.statics.Effort({joint.name: 5.0}, 1e-3)
    others, lock = np.arange(d.robot.nv) != joint.v.start, rbd.JointLock("lock", joint.name)
    locked = [(q, v * others, a * others) for q, v, a in inside]

    def holding(i: int) -> rbd.Actuation:
        return rbd.hold(rbd.State(d.robot, inside[i][0]), d.frictional)

    return {
        "inverse dynamics, no cone at its limit": commanded(d, inside),
        "inverse dynamics, a cone at its limit": commanded(d, at_limit),
        "inverse dynamics, and an external force": commanded(d, inside, external=[push]),
        "inverse dynamics, other weights of torques and forces": commanded(d, inside, objective=uneven),
        "inverse dynamics, and a locked joint": commanded(d, locked, [*d.frictional, lock]),
        "hold": holding,
    }


def answers_of(d: Draws) -> dict[str, Column]:
    """The columns of the first table: the default solver of both laws."""
    stick = d.sticking()
    return {
        HELD: solving(d, stick, d.held),
        STICKING: solving(d, stick, d.frictional),
        CONVEX: solving(d, d.slipping("convex"), d.frictional, law="convex"),
        COULOMB: solving(d, d.slipping("coulomb"), d.frictional),
    }


def mixtures_of(d: Draws) -> dict[str, Column]:
    """Neighbours of sticking soles: what else touches, slides, locks or is pushed."""
    stick, soles, robot = d.sticking(), d.frictional, d.robot
    slide, still = [(q, slid(d, q), tau) for q, _, tau in stick], [(q, 0.0 * v, tau) for q, v, tau in stick]
    corners = [
        rbd.PointContact(f"{s.name} {i}", s.frame, offset=s.placement.act(x), friction=s.friction)
        for s in soles
        for i, x in enumerate(s.corners)
    ]
    joint = [j for j in robot.joints.values() if j.nv == 1 and ("arm" in j.name or "shoulder" in j.name)][0]
    every = [j for j in robot.joints.values() if j.nv == 1]
    dry = [rbd.JointFriction(f"{j.name} friction", j.name, 1.0) for j in every]
    more: dict[str, Sequence[Constraint]] = {
        "the eight corners as points": corners,
        "and a joint at its limit": [*soles, rbd.JointLimit("stop", joint.name, lower=-np.inf, margin=10.0)],
        "and a locked joint": [*soles, rbd.JointLock("lock", joint.name)],
        "and dry friction in a joint": [*soles, rbd.JointFriction("dry", joint.name, 1.0)],
        "limits and dry friction of all joints": [*soles, *rbd.constraints.joint_limits(robot), *dry],
    }
    push = rbd.ExternalForce(soles[0].frame, (5.0, 0.0, 0.0), offset=(0.0, 0.0, 0.5))

    def pushed(i: int) -> rbd.Solution:
        q, v, tau = stick[i]
        return rbd.solve(rbd.State(robot, q, v), tau, soles, external=[push])

    return {
        "sticking, and an external force": pushed,
        **{f"sticking, {what}": solving(d, still, given) for what, given in more.items()},
        "without friction": solving(d, stick, [sole.with_friction(0.0) for sole in soles]),
        "sliding at 0.3 m/s": solving(d, slide, [sole.with_friction(0.3) for sole in soles]),
        "without contact": solving(d, stick, []),
    }


def slid(d: Draws, q: np.ndarray) -> np.ndarray:
    """A velocity at which both soles slide forward in their planes, and do not turn."""
    rows = [sole.rows(rbd.State(d.robot, q)) for sole in d.frictional]
    J, wanted = np.concatenate([r.J for r in rows]), np.tile([0.3, 0.0, 0.0, 0.0, 0.0, 0.0], len(rows))
    v = J.T @ np.linalg.solve(J @ J.T, wanted)
    return np.asarray(v + J.T @ np.linalg.solve(J @ J.T, wanted - J @ v))


def quiet(columns: dict[str, Column], **kwargs: int) -> dict[str, float]:
    """As `interleaved`, without the warnings that random torques and several motions cause; means by `MEAN` + label."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        times = turns(columns, **kwargs)
    means = {MEAN + label: statistics.fmean(each) for label, each in times.items()}
    return means | {label: statistics.median(each) for label, each in times.items()}


def in_units(medians: dict[str, dict[str, float]], labels: Sequence[str], marks: dict[str, tuple[float, ...]]) -> list[Row]:
    """Rows of {robot: {label: seconds}} over each robot's unit."""
    return [
        Row(label, {name: of[label] / of[UNIT] for name, of in medians.items()}, CALLS, marks.get(label, ()))
        for label in labels
    ]


def answer_rows(everyone: Sequence[Draws]) -> list[Row]:
    """`rbd.solve` with its default solver."""
    medians = {}
    for d in everyone:
        columns = {UNIT: ConstraintDynamics(d).column(d.sticking())} | answers_of(d) | mixtures_of(d)
        medians[d.robot.name] = quiet(columns)
    rows = in_units(medians, (*MARKS, MEAN + COULOMB), MARKS)
    return [replace(row, what=f"rbd.solve, {row.what}") for row in rows]


def peer_rows(everyone: Sequence[Draws]) -> list[Row]:
    """Pinocchio's own calls, and scripts around them."""
    medians = {}
    for d in everyone:
        stick, slip = d.sticking(), d.slipping("convex")
        held = {
            UNIT: ConstraintDynamics(d).column(stick),
            "raw terms (M, h, J, drift)": raw_terms(d, stick),
            "plain Pinocchio + NumPy script, held, unchecked": PlainScript(d).column(stick),
            "plain Pinocchio + ProxQP script, sticking, unchecked": PlainProxQP(d).column(stick),
            "plain Pinocchio + ProxQP script, slipping, unchecked": PlainProxQP(d).column(slip),
        }
        medians[d.robot.name] = quiet(held)
    return [*in_microseconds(medians), *in_units(medians, list(held)[1:], {})]


def agreement(d: Draws, count: int = 20) -> str:
    """Largest relative differences in a between ours and theirs: all are asked for the same motion."""
    stick, slip = d.sticking()[:count], d.slipping("convex")[:count]
    pairs = {
        "constraintDynamics": (ConstraintDynamics(d).column(stick), solving(d, stick, d.held)),
        "NumPy script": (PlainScript(d).column(stick), solving(d, stick, d.held)),
        "ProxQP script": (PlainProxQP(d).column(slip), solving(d, slip, d.frictional, solver=rbd.ProxQP())),
    }
    told = []
    for name, (theirs, ours) in pairs.items():
        worst = 0.0
        for i in range(count):
            a = ours(i).a  # type: ignore[attr-defined]
            worst = max(worst, float(np.abs(theirs(i) - a).max() / max(1.0, np.abs(a).max())))  # type: ignore[operator]
        told.append(f"{name} {worst:.0e}")
    return f"{d.robot.name}: largest relative difference in a: {', '.join(told)}"


def in_microseconds(medians: dict[str, dict[str, float]]) -> list[Row]:
    """The unit itself."""
    return [Row(UNIT, {name: 1e6 * of[UNIT] for name, of in medians.items()}, "us")]


def solver_rows(everyone: Sequence[Draws]) -> list[Row]:
    """Solvers that are asked for by name, from State on, and inverse dynamics."""
    medians = {}
    for d in everyone:
        stick = d.sticking()
        columns = {
            UNIT: ConstraintDynamics(d).column(stick),
            "held, KKT()": solving(d, stick, d.held, solver=rbd.KKT()),
            "held, ProxQP()": solving(d, stick, d.held, solver=rbd.ProxQP()),
        }
        for mode in ("sticking", "slipping"):
            given = stick if mode == "sticking" else d.slipping("convex")
            columns[f"frictional, {mode}, ProxQP()"] = solving(d, given, d.frictional, solver=rbd.ProxQP())
            for law in ("coulomb", "convex"):
                given = stick if mode == "sticking" else d.slipping(law)
                label = f'frictional, {mode}, ConeSolver(law="{law}")'
                columns[label] = solving(d, given, d.frictional, solver=rbd.ConeSolver(law=law))
        columns[GENERAL + STICKING] = solving(d, stick, d.frictional, solver=GaussFirst())
        columns[GENERAL + COULOMB] = solving(d, d.slipping("coulomb"), d.frictional, solver=GaussFirst())
        columns |= commands_of(d)
        medians[d.robot.name] = quiet(columns, rounds=2)
    return in_units(medians, list(columns)[1:], SOLVER_MARKS)


def point_rows(everyone: Sequence[Draws]) -> list[Row]:
    """64 points in place of 8, over the cost of 8 on the same draws."""
    values: dict[str, dict[str, float]] = {"sticking": {}, "slipping, convex law": {}}
    for d in everyone:
        stick, slip = d.sticking(), d.slipping("convex")
        columns = {
            "sticking 8": solving(d, stick, d.frictional),
            "sticking 64": solving(d, stick, d.rounded),
            "slipping, convex law 8": solving(d, slip, d.frictional, law="convex"),
            "slipping, convex law 64": solving(d, slip, d.rounded, law="convex"),
        }
        medians = quiet(columns, draws=100, rounds=2)
        for kind in values:
            values[kind][d.robot.name] = medians[f"{kind} 64"] / medians[f"{kind} 8"]
    return [
        Row(f"rbd.solve, 64 points in place of 8, {kind}", found, "x 8 points", POINTS_MARKS) for kind, found in values.items()
    ]


def many_rows(everyone: Sequence[Draws]) -> list[Row]:
    """`rbd.solve_many` on `MANY` states, a state."""
    values: dict[str, dict[str, float]] = {kind: {} for kind in MANY_MARKS}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        for d in everyone:
            drawn = {STICKING: d.sticking(MANY), CONVEX: d.slipping("convex", MANY), COULOMB: d.slipping("coulomb", MANY)}
            raw = ConstraintDynamics(d).column(drawn[STICKING])
            arrays = {kind: stacked(draws) for kind, draws in drawn.items()}
            times: dict[str, list[float]] = {kind: [] for kind in (UNIT, *drawn)}
            for turn in range(3):
                seconds = once(lambda raw=raw: [raw(i) for i in range(MANY)])
                times[UNIT].append(seconds)
                for kind, (q, v, tau) in arrays.items():
                    law = "convex" if kind == CONVEX else "coulomb"
                    call = _call_many(d, q, v, tau, law)
                    if not turn:
                        call(slice(0, 100))  # what is compiled or prepared on first use
                    times[kind].append(once(lambda call=call: call(slice(None))))
            for kind, found in values.items():
                found[d.robot.name] = float(np.median(times[kind]) / np.median(times[UNIT]))
    return [
        Row(f"rbd.solve_many, {MANY:,} states, a state: {kind}", found, CALLS, MANY_MARKS[kind])
        for kind, found in values.items()
    ]


def _call_many(d: Draws, q: np.ndarray, v: np.ndarray, tau: np.ndarray, law: str) -> object:
    return lambda some: rbd.solve_many(d.robot, q[some], v[some], tau[some], d.frictional, law=law)
