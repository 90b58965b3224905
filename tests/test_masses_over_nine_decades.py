"""Chains of 1 kg to 1e-9 kg: every row and every point is judged by its own terms, by equations written down here once more.

`python tests/test_masses_over_nine_decades.py 500 3` puts 500 chains of seed 3 to every solver.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd

SOLVERS = {
    "KKT": rbd.KKT(),
    "ProxQP": rbd.ProxQP(),
    "ConeSolver, convex": rbd.ConeSolver(law="convex"),
    "ConeSolver, coulomb": rbd.ConeSolver(),
}
_LINK = '<link name="l{0}"><inertial><origin xyz="{1}"/><mass value="{2!r}"/><inertia ixx="{3!r}" iyy="{4!r}" izz="{5!r}" '
_LINK += 'ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
_JOINT = '<joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/><origin xyz="{3}" rpy="{4}"/><axis xyz="{5}"/>'
_JOINT += '<limit effort="1e6" velocity="100" lower="-3" upper="3"/></joint>\n'


def _words(x) -> str:
    return " ".join(repr(float(each)) for each in x)


def chain(rng: np.random.Generator, root: str) -> rbd.Robot:
    """4 to 9 links of 1 to 1e-9 kg and 5 to 40 cm, the heavy ones first, last or anywhere; hinges, and some slides."""
    links, joints = [], []
    n = int(rng.integers(3, 9))
    masses = 10.0 ** rng.uniform(-9.0, 0.0, n + 1)
    masses = (masses, np.sort(masses), np.sort(masses)[::-1])[rng.integers(3)]
    for i, mass in enumerate(masses.tolist()):
        size = rng.uniform(0.05, 0.4)
        inertia = mass * size**2 * rng.uniform(0.2, 0.3, 3)
        links.append(_LINK.format(i, _words(0.3 * size * rng.normal(size=3)), mass, *map(float, inertia)))
        if i:
            kind, axis = ("prismatic" if rng.random() < 0.15 else "revolute"), rng.normal(size=3)
            place = _words(rng.normal(size=3) * size), _words(rng.uniform(-1.0, 1.0, 3))
            joints.append(_JOINT.format(i, kind, i - 1, *place, _words(axis / np.linalg.norm(axis))))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "chain.urdf"
        file.write_text(f'<robot name="chain">\n{"".join(links + joints)}</robot>\n')
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return rbd.load_robot(file, root=root)


def contacts_on(rng: np.random.Generator, robot: rbd.Robot, held: bool) -> list[rbd.PointContact]:
    """Up to 10 contacts at points of any links; some in pairs at one place with opposed normals."""
    frames = [f for f in robot.frames() if f.startswith("l")]
    out: list[rbd.PointContact] = []
    for i in range(int(rng.integers(1, 3) if held else rng.integers(3, 9))):
        normal = rng.normal(size=3) + [0.0, 0.0, rng.choice([0.0, 3.0])]
        normal /= np.linalg.norm(normal)
        friction = None if held else rng.choice([0.0, 0.3, 0.7, 1.5]) if rng.random() < 0.9 else None
        where = dict(frame=str(rng.choice(frames)), offset=0.1 * rng.normal(size=3), friction=friction)
        out.append(rbd.PointContact(f"c{i}", on=rbd.Ground(normal=normal), **where))
        if not held and friction is not None and rng.random() < 0.15:
            out.append(rbd.PointContact(f"c{i}_opposed", on=rbd.Ground(normal=-normal), **where))
    return out


def problems(count: int, seed: int) -> Iterator[tuple[str, rbd.GaussProblem]]:
    """(what it is, problem) of chains at rest: no torques, what moves each joint at 10 rad/s2, a newton metre, or 1e-3.

    A chain of which the doctor says that nothing in it has inertia is drawn again.
    """
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        root = str(rng.choice(["fixed", "free_flyer"]))
        robot = None
        while robot is None:
            with contextlib.suppress(rbd.errors.ModelError):
                robot = chain(rng, root)
        q = pin.integrate(robot.model, pin.neutral(robot.model), rng.uniform(-1.0, 1.0, robot.nv))
        state = rbd.State(robot, q)
        own = state.M.diagonal()[robot.nv - robot.nu :]
        tau = (0.0 * own, 10.0 * own, 1.0 + 0.0 * own, 1e-3 + 0.0 * own)[rng.integers(4)] * rng.normal(size=robot.nu)
        held = bool(rng.random() < 0.2)
        yield f"{i} ({root})", rbd.gauss_problem(state, tau, contacts_on(rng, robot, held))


@cache
def drawn(count: int, seed: int) -> list[tuple[str, rbd.GaussProblem]]:
    """The same problems for all solvers, made once."""
    return list(problems(count, seed))


def misses(P: rbd.GaussProblem, s: rbd.Solution) -> dict[str, float]:
    """Largest share of its own terms by which each kind of equation is missed, of any row and any point.

    In extended precision. Terms below 1 m/s2, and forces that give a coordinate or a row 1 m/s2 (or 1 N if that is less),
    count as such.
    """
    wide = np.longdouble
    M, rhs, J, offset, a, f = (np.asarray(x, wide) for x in (P.M, P.rhs, P.J, P.offset, s.a, s.multipliers))
    out = dict.fromkeys(("momentum", "sinks", "moves", "pulls", "leaves its cone", "works"), 0.0)

    def put(what, miss, terms) -> None:
        out[what] = max(out[what], float(miss / terms))

    force_terms = np.abs(M) @ np.abs(a) + np.abs(rhs) + np.abs(J.T) @ np.abs(f)
    for miss, terms, own in zip(np.abs(M @ a - rhs - J.T @ f), force_terms, M.diagonal(), strict=True):
        put("momentum", miss, max(terms, min(own, 1.0)))
    c, row_terms = J @ a + offset, np.maximum(np.abs(J) @ np.abs(a) + np.abs(offset), 1.0)
    mobility = np.einsum("ij,ji->i", P.J, np.linalg.solve(P.M, P.J.T))
    rows_at = 0
    for r in P.rows:
        span = slice(rows_at, rows_at + len(r))
        rows_at += len(r)
        u, x, terms = c[span], f[span], row_terms[span]
        floor = 1.0 / max(1.0, mobility[span].max())
        if isinstance(r.cone, rbd.problem.Free):
            for miss, own in zip(np.abs(u), terms, strict=True):
                put("moves", miss, own)
            continue
        x_n, u_n, own = x[-1], u[-1], terms[-1]
        force = max(np.abs(x).max(), floor)
        put("sinks", max(-u_n, 0.0), own)
        put("pulls", max(-x_n, 0.0), force)
        if len(r) == 1:
            put("works", abs(x_n * u_n), force * own)
            continue
        mu, slip = r.cone.mu, np.hypot(*u[:2])
        own = terms.max()
        if s.law.facets:
            rub = np.abs(x[:2]).max()
            across = np.abs(u[:2]).sum() * mu
        else:
            rub, across = np.hypot(*x[:2]), mu * slip
        put("leaves its cone", max(rub - mu * x_n, 0.0), force)
        if s.law.kind == "coulomb":
            put("works", abs(x_n * u_n), force * own)
            put("works", abs(x[:2] @ u[:2] + mu * x_n * slip), force * own)
        else:
            put("moves", max(across - u_n, 0.0) / np.hypot(1.0, mu), own)
            put("works", abs(x @ u), force * own)
    return out


def judged(P: rbd.GaussProblem, solver: rbd.ProxQP | rbd.ConeSolver | rbd.KKT) -> tuple[rbd.Solution, float, str]:
    """(answer, largest miss, of what)."""
    s = rbd.Solution.of(solver.solve(P))
    found = misses(P, s)
    what = max(found, key=lambda name: found[name])
    return s, found[what], what


@pytest.mark.parametrize("name", SOLVERS)
def test_what_is_solved_holds_in_every_row_by_its_own_terms(name: str) -> None:
    """A link of a milligram sinks as seldom as one of a kilogram: nothing that is `solved` misses 1e-8 of its own terms."""
    solver, solved, taken = SOLVERS[name], 0, 0
    for what, P in drawn(120, 2):
        if solver.reason_unsupported(P):
            continue
        s, miss, of = judged(P, solver)
        taken += s.status != "infeasible"
        if s.status == "solved":
            solved += 1
            assert miss < 1e-8, f"{what}: {of} by {miss:.2g} of its own terms"
    assert taken > 15 and solved >= 0.97 * taken


def statistics(count: int, seed: int) -> None:
    """Prints a line for each solver: statuses, and how far what is solved misses."""
    for name, solver in SOLVERS.items():
        statuses: Counter[str] = Counter()
        wrong: list[str] = []
        worst, longest = 0.0, 0.0
        for what, P in problems(count, seed):
            if solver.reason_unsupported(P):
                continue
            start = time.perf_counter()
            s, miss, of = judged(P, solver)
            longest = max(longest, time.perf_counter() - start)
            statuses[str(s.status)] += 1
            if s.status == "solved":
                worst = max(worst, miss)
                if miss > 1e-8:
                    wrong.append(f"{what}: {of} by {miss:.1e}")
            elif s.status != "infeasible":
                wrong.append(f"{what}: {s.status} {s.residuals.worst:.0e}")
        print(f"{name:14} {dict(statuses)}, worst of solved {worst:.1e}, longest {longest:.1f} s; {len(wrong)} wrong: {wrong}")


if __name__ == "__main__":
    statistics(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
