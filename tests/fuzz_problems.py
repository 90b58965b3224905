"""Random problems, each answer judged by a certificate that shares no code with what made it.

    python tests/fuzz_problems.py --n 5000 --seed 0 --jobs 2        (problem 1234 alone: --start 1234 --n 1)

Problem i of seed s is always the same. Each runs in a fork of its own with 10 s of processor time, and counts as
    solved        the answer says so, and every equation is met within 1e-7 of its own terms (1e-5: the law of contacts in the
                  record of time stepping)
    inaccurate    the answer says so, and every equation is met within 1e-5
    refused       one of our own errors; of `NoSolution`, a linear program tells whether there are accelerations at all
    failure       a certificate that is exceeded, an error that is not ours, a proof that is none, a crash, a time-out
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import certificate as C
import numpy as np
import random_problems as R
from forked import child, ended
from numpy.typing import NDArray

import rbd

Array = NDArray[np.float64]

TIME_LIMIT = 10.0
"""Of processor time [s]; a problem that waits, of ten times as much time."""
SOLVED, INACCURATE = 1e-7, 1e-5
STEPPED = 1e-5
"""Of the law of points in the record of time stepping: it is solved for velocities, to 1e-10 of those of all points."""
EMPTY = 1e-6
"""Least violation, over the rows' own size, above which a linear program says that there is no acceleration."""
KINDS = ("arrays", "robot", "robot", "loop", "hold", "steps", "smooth")


@dataclass
class Verdict:
    """What came of a problem.

    Attributes:
        kind: Of problem.
        story: What it is.
        outcome: "solved", "inaccurate", "refused" or "failure".
        why: Class of the refusal, or what is wrong.
        worst: Largest ratio of a miss to its own terms; NaN where there is no answer.
        seconds: Processor time.
    """

    kind: str
    story: str
    outcome: str
    why: str = ""
    worst: float = math.nan
    seconds: float = 0.0


class _Fault(Exception):
    """A certificate that is exceeded."""


def _solver(rng: R.Rng, bilateral: bool) -> rbd.ProxQP | rbd.ConeSolver | rbd.KKT:
    if bilateral and rng.random() < 0.5:
        return rbd.KKT()
    return R.pick(rng, (rbd.ProxQP(), rbd.ConeSolver(), rbd.ConeSolver(law="convex")))


def _judged(certificate: C.Certificate, status: str, what: str, *, stepped: bool = False) -> tuple[str, str, float]:
    limit = SOLVED if status == "solved" else INACCURATE
    of_law = max(limit, STEPPED) if stepped else limit
    laws = ("point", "bound", "holds")
    if not all(ratio <= (of_law if equation in laws else limit) for equation, (ratio, _) in certificate.found.items()):
        raise _Fault(f"{what} says {status!r}, and its equations are missed: {certificate}")
    return status, "", certificate.worst


def _local_corners(problem: rbd.GaussProblem, solution: rbd.Solution) -> dict[str, Array]:
    out = {}
    for r in problem.rows:
        if r.name in solution.corner_forces:
            axes = np.eye(3) if r.patch is None else r.patch.axes
            out[r.name] = solution.corner_forces[r.name] @ axes
    return out


def _of_arrays(P: rbd.GaussProblem, s: rbd.Solution) -> C.Certificate:
    return C.of_arrays(P.M, P.rhs, P.rows, s.a, s.multipliers, _local_corners(P, s), str(s.law))


def _refused(error: rbd.RbdError, problem: rbd.GaussProblem | None) -> tuple[str, str, float]:
    """A refusal, and whether it is right."""
    text = str(error)
    if not 0 < len(text) <= 1500:
        raise _Fault(f"a message of {len(text)} letters: {text[:80]}")
    why = type(error).__name__
    if isinstance(error, rbd.NoSolution) and problem is not None:
        proved = error.contradiction is not None
        least = C.least_miss(problem.M, problem.rows)
        if proved and least <= 1e-10:
            raise _Fault(f"no acceleration, with a proof, and there is one (least miss {least:.1e}): {text:.200}")
        why += ": proved" if proved else ": there is none" if least > EMPTY else ": hard" if least <= 1e-10 else ": in doubt"
    return "refused", why, math.nan


def arrays(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A problem in arrays, by any solver that takes it."""
    story, P = R.arrays(rng)
    solver = _solver(rng, all(isinstance(r.cone, rbd.problem.Free) for r in P.rows))
    yield f"{story}; {solver!r:.30}"
    if (reason := solver.reason_unsupported(P)) is not None:
        yield "refused", f"Unsupported: {reason:.40}", math.nan
        return
    s = rbd.Solution.of(solver.solve(P))
    if s.status in ("solved", "inaccurate"):
        for other in s.others:
            _judged(_of_arrays(P, other), other.status, "another motion")
        yield _judged(_of_arrays(P, s), s.status, solver.__class__.__name__)
    else:
        yield _refused(rbd.NoSolution(s.worst, problem=P, result=s, contradiction=s.contradiction), P)


def _force(state: rbd.State, tau: Array) -> Array:
    out = np.zeros(state.robot.nv)
    out[state.robot.actuated] = tau
    return out


def _things(given: list[R.Given], state: rbd.State, forces: R.Forces, corners: R.Forces) -> list[R.Thing]:
    return [g.thing(state, forces, corners) for g in given]


def _solved(rng: R.Rng, made: R.Tree, given: list[R.Given], q: Array, v: Array, solver) -> tuple[str, str, float]:
    state, tau = rbd.State(made.robot, q, v), R.torques(rng, made.robot)
    constraints = [g.constraint for g in given]
    try:
        s = rbd.solve(state, tau, constraints, solver=solver)  # type: ignore[arg-type]
    except rbd.RbdError as error:
        if isinstance(error, rbd.errors.ContactMoves) and not v.any():
            raise _Fault(f"a robot at rest, and {error}") from error
        if isinstance(error, rbd.InputError):
            raise _Fault(f"{type(error).__name__}: {error}") from error
        return _refused(error, error.problem if isinstance(error, rbd.NoSolution) else None)
    worst = _judged(_of_arrays(s.problem, s), s.status, f"{s.solver}, arrays,")[2]
    for answer in (s, *s.others):
        things = _things(given, state, answer.forces, answer.corner_forces)
        one = C.of_robot(made.robot.model, state.q, state.v, answer.a, _force(state, tau), things, str(answer.law))
        worst = max(worst, _judged(one, answer.status, f"{answer.solver}, robot,")[2])
    return str(s.status), "", worst


def robot(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A random tree with contacts and joint rows, at rest, moving with its contacts at rest, or sliding."""
    story, made = R.tree(rng)
    q = R.posture(rng, made.robot)
    touching, given = R.contacts(rng, made, q)
    given = given + R.joints(rng, made, q)
    solver = _solver(rng, all(g.holds for g in given))
    moves = R.pick(rng, ("rest", "still", "slides"))
    yield f"{story}; {touching}; {moves}; {solver!r:.30}"
    v = np.zeros(made.robot.nv)
    if moves != "rest":
        v = R.still_velocity(rng, made.robot, q, given, slide=moves == "slides" and solver == rbd.ConeSolver())
    yield _solved(rng, made, given, q, v, solver)


def loop(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A planar loop, closed once or twice, moving along itself, sometimes on contacts."""
    root = R.pick(rng, ("fixed", "free_flyer"))
    story, made, given = R.polygon(rng, root=root)
    q = pin_neutral(made)
    touching = "alone"
    if rng.random() < 0.4:
        touching, more = R.contacts(rng, made, q, unlimited=False)
        given = given + more
    solver = _solver(rng, all(g.holds for g in given))
    yield f"{story}; {touching}; {solver!r:.30}"
    v = R.still_velocity(rng, made.robot, q, given) if rng.random() < 0.6 else np.zeros(made.robot.nv)
    yield _solved(rng, made, given, q, v, solver)


def pin_neutral(made: R.Tree) -> Array:
    """The configuration in which the file's loop is closed."""
    return np.array(made.robot.neutral())


def hold(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A random tree that is to stand still."""
    story, made = R.tree(rng)
    q = R.posture(rng, made.robot)
    touching, given = R.contacts(rng, made, q)
    yield f"{story}; {touching}; hold"
    robot, state = made.robot, rbd.State(made.robot, q)
    constraints = [g.constraint for g in given]
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("error")
        warnings.simplefilter("always", rbd.errors.RbdWarning)
        try:
            held = rbd.hold(state, constraints)  # type: ignore[arg-type]
        except rbd.CannotHold as error:
            yield "refused", f"CannotHold: {_can_be_held(state, given)}", math.nan
            if not 0 < len(str(error)) <= 1500:
                raise _Fault(f"a message of {len(str(error))} letters") from error
            return
    status = "inaccurate" if any(issubclass(w.category, rbd.errors.InaccurateWarning) for w in seen) else "solved"
    over = float((np.abs(held.tau) / robot.effort_limit).max(initial=0.0))
    if over > 1.0 + (1e-9 if status == "solved" else 1e-7):
        raise _Fault(f"hold takes {over} of a motor's limit")
    things = _things(given, state, held.forces, held.corner_forces)
    zero = np.zeros(robot.nv)
    found = C.of_robot(robot.model, state.q, zero, zero, _force(state, held.tau), things, "coulomb", laws=False, still=True)
    yield _judged(found, status, "hold")


def _can_be_held(state: rbd.State, given: list[R.Given]) -> str:
    """What an own linear program says: forces in pyramids of 16 facets inside the cones, torques in their limits."""
    import pinocchio as pin
    from scipy.optimize import linprog

    model, robot = state.robot.model, state.robot
    data = model.createData()
    nle = np.array(pin.rnea(model, data, state.q, np.zeros(model.nv), np.zeros(model.nv)))
    columns, free = [], []
    for g in given:
        r = g.constraint.rows(state)  # type: ignore[attr-defined]
        kind = type(r.cone).__name__
        if kind == "Free":
            columns += list(r.J)
            free += [True] * len(r.J)
            continue
        corners = np.zeros((1, 3)) if kind in ("FrictionCone", "NonNegative") else r.cone.corners
        mu = getattr(r.cone, "mu", 0.0)
        for p in corners:
            G = np.hstack([np.eye(3), -C._cross(p)]) if len(r.J) > 3 else np.eye(3)
            J = r.J if len(r.J) != 5 else np.insert(r.J, 3, 0.0, axis=0)
            if kind == "NonNegative":
                columns.append(r.J[0])
                free.append(False)
                continue
            n = 16
            angle = math.pi * (2.0 * np.arange(n) + 1.0) / n
            rays = np.array([mu * np.cos(angle), mu * np.sin(angle), np.ones(n)]) if mu else np.array([[0.0], [0.0], [1.0]])
            rays = rays / np.linalg.norm(rays, axis=0)
            columns += list((G.T @ rays).T @ J)
            free += [False] * rays.shape[1]
    weight = robot.mass * 9.81
    S = np.zeros((model.nv, robot.nu))
    S[robot.actuated, np.arange(robot.nu)] = 1.0
    W = np.hstack([np.array(columns).T.reshape(model.nv, -1) if columns else np.zeros((model.nv, 0)), S])
    one = np.ones((model.nv, 1))
    lines = np.vstack([np.hstack([W, -one]), np.hstack([-W, -one])])
    limit = 0.999999 * robot.effort_limit / weight
    bounds = [(None, None) if x else (0.0, None) for x in free]
    bounds += [(-x, x) if math.isfinite(x) else (None, None) for x in limit] + [(0.0, None)]
    b = nle / weight
    cost = np.r_[np.zeros(W.shape[1]), 1.0]
    found = linprog(cost, lines, np.r_[b, -b], bounds=bounds, method="highs", options={"time_limit": 5.0})
    if found.status != 0:
        return "unknown"
    return "hard" if found.x[-1] <= 1e-12 else "in doubt" if found.x[-1] <= 1e-8 else "there is nothing"


def steps(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A motion by time stepping; its recorded moments."""
    story, made = R.tree(rng, most=4, spread=R.pick(rng, (0.0, 2.0, 4.0)))
    q = R.posture(rng, made.robot)
    touching, given = R.contacts(rng, made, q, unlimited=False)
    given = given + R.joints(rng, made, q)
    law = R.pick(rng, ("coulomb", "coulomb", "convex"))
    yield f"{story}; {touching}; time stepping, {law}"
    v = R.still_velocity(rng, made.robot, q, given) if rng.random() < 0.5 else np.zeros(made.robot.nv)
    step = float(R.pick(rng, (1e-3, 5e-3)))
    yield _moved(rng, made, given, q, v, law=law, integrator=rbd.TimeStepping(), step=step, duration=10 * step)


def smooth(rng: R.Rng) -> Iterator[str | tuple[str, str, float]]:
    """A motion of constraints that hold, by Runge and Kutta's steps or adaptive ones; its recorded moments."""
    if rng.random() < 0.6:
        story, made, given = R.polygon(rng, root=R.pick(rng, ("fixed", "free_flyer")))
        q = pin_neutral(made)
    else:
        story, made = R.tree(rng, most=4, spread=R.pick(rng, (0.0, 2.0)))
        q = R.posture(rng, made.robot)
        touching, given = R.contacts(rng, made, q, held=True, unlimited=False)
        story += f"; {touching}"
    integrator = R.pick(rng, (rbd.RungeKutta4(), rbd.DormandPrince8()))
    yield f"{story}; {integrator!r:.20}"
    v = R.still_velocity(rng, made.robot, q, given)
    size = float(np.abs(v).max(initial=1e-9))
    yield _moved(rng, made, given, q, v / max(1.0, size), law="coulomb", integrator=integrator, step=2e-3, duration=2e-2)


def _moved(rng: R.Rng, made: R.Tree, given: list[R.Given], q: Array, v: Array, *, integrator, law, step, duration):
    robot, tau = made.robot, R.torques(rng, made.robot)
    contacts, start = [g.constraint for g in given], rbd.State(robot, q, v)
    try:
        motion = rbd.simulate(
            start, contacts, duration=duration, step=step, controller=lambda state, t: tau, law=law,
            integrator=integrator,
        )  # fmt: skip
    except rbd.RbdError as error:
        if isinstance(error, rbd.InputError):
            raise _Fault(f"{type(error).__name__}: {error}") from error
        return _refused(error, None)
    worst, smooth = 0.0, not isinstance(integrator, rbd.TimeStepping)
    for i in range(len(motion)):
        sample = motion[i]
        state = rbd.State(robot, sample.q, sample.v)
        things: list[R.Thing] = []
        for g in given:
            things.append(_recorded(g, start, state, sample, smooth))
        limit = "solved" if motion.residuals["law"][i] <= 1e-9 else "inaccurate" if motion.residuals["law"][i] <= 1e-7 else ""
        if not limit:
            continue  # said aloud in the record
        force = _force(state, sample.tau)
        # At a start from rest the law of velocities at the end of half a step is that of accelerations.
        exact = smooth or (i == 0 and not v.any())
        found = C.of_robot(robot.model, state.q, state.v, sample.a, force, things, law, laws=exact)
        worst = max(worst, _judged(found, limit, f"moment {i} at t = {sample.t:.4g} s", stepped=not smooth)[2])
    return "solved" if max(motion.residuals["law"]) <= 1e-9 else "inaccurate", "", worst


def _recorded(g: R.Given, start: rbd.State, state: rbd.State, sample, smooth: bool) -> R.Thing:
    if smooth or g.holds or g.name not in sample.point_forces:
        return g.thing(state, {g.name: sample.forces[g.name]}, {})
    thing = g.thing(state, {}, {g.name: sample.point_forces[g.name]})
    ground = g.thing(start, {}, {g.name: sample.point_forces[g.name]})
    return replace(thing, axes=ground.axes)  # a plane, as it stood under the sole at the start


# -- running --------------------------------------------------------------------------------------------------------------


def judge(seed: int, i: int) -> Verdict:
    """What comes of problem i of a seed."""
    rng = np.random.default_rng([seed, i])
    kind = R.pick(rng, KINDS)
    story, begin = "", time.process_time()
    outcome: tuple[str, str, float]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", rbd.errors.RbdWarning)
        try:
            for said in globals()[kind](rng):
                if isinstance(said, str):
                    story = said
                else:
                    outcome = said
        except _Fault as fault:
            outcome = "failure", str(fault), math.nan
        except rbd.RbdError as error:
            outcome = "refused", f"{type(error).__name__} outside: {error!s:.120}", math.nan
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(where.filename).name}:{where.lineno}"
            outcome = "failure", f"{type(error).__name__} at {place}: {error!s:.200}", math.nan
    return Verdict(kind, story, *outcome, seconds=time.process_time() - begin)


def told(seed: int, i: int) -> tuple[str, str]:
    """(kind, story) of problem i of a seed, unsolved."""
    rng = np.random.default_rng([seed, i])
    kind = R.pick(rng, KINDS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return kind, str(next(globals()[kind](rng)))


def load() -> None:
    """Import what most problems need: each fork would import it anew, which takes longer than its problem."""
    for name in ("solvers.law_kernel", "solvers.newton_kernel", "constraints.plane_kernel"):
        importlib.import_module(f"rbd.{name}")
    for name in ("rbd.simulation", "rbd.mechanism", "rbd.statics", "scipy.optimize", "clarabel"):
        importlib.import_module(name)


def run(seed: int, numbers: Iterable[int], jobs: int = 1) -> Iterator[tuple[int, Verdict]]:
    """(i, verdict) of each problem, as it ends."""
    load()

    def judged(i: int) -> dict[str, object]:
        limit = math.ceil(time.process_time() + TIME_LIMIT)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        return asdict(judge(seed, i))

    def start(i: int) -> tuple[int, int]:
        return child(lambda: judged(i), _failed, {})

    for one in ended(start, numbers, jobs, 10.0 * TIME_LIMIT):
        over = one.late or one.signal in (signal.SIGXCPU, signal.SIGKILL)
        why = f"more than {TIME_LIMIT:g} s" if over else f"crash by signal {one.signal}"
        yield (
            one.i,
            Verdict(**json.loads(one.said)) if one.said else Verdict(*told(seed, one.i), "failure", why, seconds=TIME_LIMIT),
        )


def _failed(error: BaseException) -> dict[str, object]:
    return asdict(Verdict("judge", "", "failure", f"the judge failed: {error!r:.300}"))


def main() -> int:
    """Run, show progress, print the figures; 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("n", 5000), ("seed", 0), ("start", 0), ("jobs", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    counts, reasons, kinds = Counter[str](), Counter[str](), defaultdict[str, Counter[str]](Counter)
    worst, slowest, begin = (0.0, -1, ""), (0.0, -1, ""), time.monotonic()
    for i, found in run(given.seed, range(given.start, given.start + given.n), given.jobs):
        counts[found.outcome] += 1
        kinds[found.kind][found.outcome] += 1
        if found.outcome == "refused":
            reasons[f"{found.kind}: {found.why[:60]}"] += 1
        if found.outcome == "solved" and found.worst > worst[0]:
            worst = found.worst, i, found.story
        if found.seconds > slowest[0]:
            slowest = found.seconds, i, found.story
        if found.outcome == "failure" or given.n == 1:
            print(f"\n{i}: {found.outcome} {found.why}\n  {found.story}\n  worst {found.worst:.1e}, {found.seconds:.2f} s; "
                  f"again: python tests/fuzz_problems.py --seed {given.seed} --start {i} --n 1", flush=True)  # fmt: skip
        if counts.total() % 50 == 0:
            print(f"\r{counts.total()} of {given.n}: {dict(counts)}", end="", file=sys.stderr, flush=True)
    print("", *[f"{n:6} refused, {what}" for what, n in reasons.most_common(30)], sep="\n")
    for kind, each in sorted(kinds.items()):
        print(f"{kind:>8}: " + ", ".join(f"{n} {what}" for what, n in each.most_common()))
    print(f"worst of what is solved: {worst[0]:.1e} of its own terms ({worst[1]}: {worst[2]})")
    print(f"slowest: {slowest[0]:.2f} s ({slowest[1]}: {slowest[2]})")
    told = ", ".join(f"{counts[outcome]} {outcome}" for outcome in ("solved", "inaccurate", "refused", "failure"))
    print(f"{counts.total()} problems in {time.monotonic() - begin:.0f} s: {told}")
    return int(counts["failure"] > 0)


if __name__ == "__main__":
    sys.exit(main())
