"""Random mixtures of constraints on random robots: the prepared way of `rbd.solve` against its general way.

    python tests/fuzz_prepared.py --n 10000 --seed 0

Draws are those of `tests/random_problems.py`. Both answers are judged by the problem in arrays; where the motion is unique they
agree.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter

import numpy as np
import pinocchio as pin
import random_problems as R

import rbd
from rbd.answers.analysis.uniqueness import motion_freedom
from rbd.problem.residuals import residuals_of
from rbd.solvers.admm import ConeSolver
from rbd.solvers.default import GaussFirst

PREPARED = "ContactDynamics"
SAME = 1e-9


def related(rng: np.random.Generator, robot: rbd.Robot, contact: rbd.constraints.Contact) -> rbd.constraints.Contact:
    """The same contact on ground that moves, or on another body."""
    normal, bodies = contact.normal, [f.name for f in robot.model.frames if f.parentJoint != robot.site(contact.frame)[0]]
    if rng.random() < 0.5 and bodies:
        turn = R.unit(rng) if normal is not None and len(contact.corners) == 1 else normal
        on: rbd.Ground | rbd.Body = rbd.Body(bodies[rng.integers(len(bodies))], normal=turn)
    else:
        about = R.pick(rng, (None, rng.normal(size=3)))
        on = rbd.Ground(normal=normal, velocity=rng.normal(size=6), acceleration=rng.normal(size=6), about=about)
    return rbd.constraints.Contact(
        contact.name, contact.frame, corners=contact.corners, placement=contact.placement, friction=contact.friction,
        facets=contact.facets, on=on,
    )  # fmt: skip


def drawn(seed: int, i: int):
    """State, torques, constraints, law."""
    rng = np.random.default_rng([seed, i])
    kind = R.pick(rng, ("ground", "ground", "related", "loops"))
    if kind == "loops":
        story, made, given = R.polygon(rng, root=R.pick(rng, ("fixed", "free_flyer")))
        q, touching = pin.neutral(made.robot.model), "closed"
    else:
        story, made = R.tree(rng, most=8)
        q = R.posture(rng, made.robot)
        touching, given = R.contacts(rng, made, q)
    given = given + R.joints(rng, made, q)
    moves = R.pick(rng, ("rest", "still", "slides"))
    constraints = [g.constraint for g in given]
    if kind == "related":
        contact = rbd.constraints.Contact
        constraints = [
            related(rng, made.robot, c) if isinstance(c, contact) and not i else c for i, c in enumerate(constraints)
        ]
    v = np.zeros(made.robot.nv)
    if moves != "rest":
        v = R.still_velocity(rng, made.robot, q, given, slide=moves == "slides")
    if kind == "related":  # only what makes all rows slow: motions of grounds and bodies are drawn at will
        rows = [c.rows(rbd.State(made.robot, q, v)) for c in constraints]
        if rows:
            v -= np.linalg.lstsq(np.concatenate([r.J for r in rows]), np.concatenate([r.velocity for r in rows]), rcond=None)[0]
    law = "coulomb" if moves == "slides" or rng.random() < 0.6 else "convex"
    return (
        f"{kind}: {story}; {touching}; {moves}; {law}",
        rbd.State(made.robot, q, v),
        R.torques(rng, made.robot),
        constraints,
        law,
    )


def compared(seed: int, i: int) -> tuple[str, str, float]:
    """(outcome, story, difference)."""
    try:
        story, state, tau, constraints, law = drawn(seed, i)
    except rbd.RbdError as error:
        return f"draw {type(error).__name__}", "", 0.0
    try:
        s = rbd.solve(state, tau, constraints, law=law)
    except rbd.RbdError as error:
        return type(error).__name__, story, 0.0
    if s.solver != PREPARED:
        return f"general {s.solver}", story, 0.0
    worst = residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).worst
    if not residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).within(1e-7):
        return "BAD", story, worst
    solver = GaussFirst() if law == "coulomb" else ConeSolver(law="convex")
    try:
        g = rbd.solve(state, tau, constraints, solver=solver)
    except rbd.RbdError as error:
        return f"prepared alone ({type(error).__name__})", story, 0.0
    apart = float(np.abs(s.a - g.a).max(initial=0.0)) / max(1.0, float(np.abs(g.a).max(initial=0.0)))
    if apart > 1e-6:
        if g.others or motion_freedom(s) or motion_freedom(g):
            return "several motions", story, 0.0
        if law == "coulomb" and g.residuals.worst < 1e-7 and s.gauss < g.gauss:
            return "another motion, less constrained", story, 0.0
        return f"APART {g.residuals.worst:.0e} {worst:.0e}", story, apart
    if g.force_choice.startswith("as "):
        return "same, forces chosen", story, apart
    f = float(np.abs(s.multipliers - g.multipliers).max(initial=0.0)) / max(1.0, float(np.abs(g.multipliers).max(initial=0.0)))
    if f > 1e-5:
        return "FORCES", story, f
    return f"same {s.method}{' redundant' if s.redundant else ''}", story, apart


def main() -> int:
    """Print what came of them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--n", type=int, default=1000)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    begin = time.monotonic()
    for i in range(given.start, given.start + given.n):
        outcome, story, apart = compared(given.seed, i)
        kinds[f"{story.split(':')[0]} {outcome.split(' ')[0]}"] += 1
        counts[outcome.split(" ")[0] if outcome[0:5] in ("APART",) else outcome] += 1
        if outcome[:3] in ("BAD", "APA", "FOR"):
            print(i, outcome, f"{apart:.1e}", story, flush=True)
    print(f"{time.monotonic() - begin:.0f} s", counts, kinds)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
