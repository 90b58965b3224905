"""How often, and how fast, does one cold run of ProxSuite solve a pushed humanoid? In which coordinates?

Usage: python docs/design/whitened_qp.py [states a robot, 1000 by default]
"""

import sys
import time

import numpy as np
import proxsuite

import rbd
from rbd.problem.residuals import SOLVED, residuals_of
from rbd.solvers import qp

ROBOTS = ("talos", "talos_full", "g1", "g1_hands")


def pushed(name, count, seed=0):
    """Two-footed problems: holding torques plus noise of 2 to 60 N m, friction 0.05 to 1."""
    rng, robot = np.random.default_rng(seed), rbd.load_robot(name)
    state = robot.standing()
    held = rbd.hold(state, robot.soles()).tau
    for _ in range(count):
        noise_Nm, mu = np.exp(rng.uniform(np.log(2.0), np.log(60.0))), rng.uniform(0.05, 1.0)
        tau = held + noise_Nm * rng.standard_normal(robot.nu)
        tau = np.clip(tau, -robot.effort_limit, robot.effort_limit)
        yield rbd.gauss_problem(state, tau, robot.soles(friction=mu))


def in_a(P, *, precondition, infeasibility):
    """Gauss's QP posed in the acceleration itself: H = M, one inequality a ray. Worst scaled residual."""
    rows, opening = P.force_set.pyramids.G.T @ P.J, P.force_set.pyramids.G.T @ P.offset
    problem = proxsuite.proxqp.dense.QP(P.nv, 0, len(rows))
    s = problem.settings
    s.eps_abs, s.eps_rel, s.max_iter = 1e-10, 0.0, 1000
    s.initial_guess = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
    s.eps_dual_inf = infeasibility
    problem.init(
        P.M, -P.rhs, None, None, rows, -opening, np.full(len(rows), 1e20),
        compute_preconditioner=precondition, rho=1e-9, mu_eq=1e-8, mu_in=1e-1,
    )  # fmt: skip
    problem.solve()
    weights = np.maximum(-np.array(problem.results.z), 0.0)
    f = P.force_set.pyramids.G @ weights
    answers = (np.array(problem.results.x), P.a_free + P.solve_M(P.J.T @ f))  # its own x, or a from its forces
    return min(residuals_of(P, a, f, weights).worst for a in answers)


WAYS = {
    "a": lambda P: in_a(P, precondition=False, infeasibility=1e-4),
    "a, preconditioned": lambda P: in_a(P, precondition=True, infeasibility=1e-4),
    "a, no verdict": lambda P: in_a(P, precondition=False, infeasibility=1e-16),
    "z, one run": lambda P: rbd.ProxQP(policy=qp.POLICY[:1]).solve(P).residuals.worst,
    "z, as shipped": lambda P: rbd.ProxQP().solve(P).residuals.worst,
}


def main(count=1000):
    """Print, for each robot and way, the share solved to 1e-9 (scaled) and the median time with its certificate."""
    print(f"{'robot':<12}{'cond M':>10}" + "".join(f"{way:>21}" for way in WAYS))
    for name in ROBOTS:
        solved, seconds = {w: 0 for w in WAYS}, {w: [] for w in WAYS}
        for P in pushed(name, count):
            P.delassus, P.force_set.pyramids, P.a_free  # noqa: B018  cached: shared by all ways
            for way, run in WAYS.items():
                start = time.perf_counter()
                solved[way] += run(P) <= SOLVED
                seconds[way].append(time.perf_counter() - start)
        cells = [f"{100 * solved[w] / count:>11.1f} % {1e6 * np.median(seconds[w]):>5.0f} us" for w in WAYS]
        print(f"{name:<12}{np.linalg.cond(P.M):>10.1e}" + "".join(cells))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
