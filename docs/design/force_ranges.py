"""How far can a corner's normal force go, with circular cones: cutting planes against proximal steps. Talos on two soles.

Prints rounds, seconds and how far the last answer is outside its cones [N]. Run by hand; it takes a minute.
"""

from __future__ import annotations

import math
import time

import numpy as np
from scipy.optimize import linprog

import rbd
from rbd.answers.analysis.admissible_forces import admissible
from rbd.answers.analysis.extent import Reach
from rbd.problem.programs import ENDS_WORK, Work

ROUNDS = 120


def cutting_planes(reach: Reach, function: np.ndarray) -> tuple[float, int, float]:
    """(largest value, rounds, how far outside): planes that touch the cones, one more wherever the answer is outside."""
    adm, q = reach.adm, function @ reach.basis
    normals, offsets = reach._planes()
    normals, offsets = list(normals), list(offsets)
    outside, value = math.inf, math.inf
    for k in range(ROUNDS):
        A = np.array(normals)
        b = np.array(offsets) - A @ reach.start
        found = linprog(-q, A_ub=-A @ reach.basis, b_ub=-b, bounds=(None, None), method="highs")
        x = reach.start + reach.basis @ found.x
        value, outside = float(function @ x) * adm.size, 0.0
        for at, mu in zip(adm.cone_at, adm.mu, strict=True):
            t = math.hypot(x[at], x[at + 1])
            beyond = (t - mu * x[at + 2]) / math.hypot(1.0, mu)
            outside = max(outside, beyond * adm.size)
            if beyond > 1e-10:
                plane = np.zeros(len(x))
                plane[at : at + 3] = np.array([-x[at] / t, -x[at + 1] / t, mu]) / math.hypot(1.0, mu)
                normals.append(plane)
                offsets.append(0.0)
        if outside <= 1e-10 * adm.size:
            return value, k + 1, outside
    return value, ROUNDS, outside


if __name__ == "__main__":
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.5)
    s = rbd.solve(state, rbd.hold(state, soles).tau, soles, solver=rbd.ConeSolver(law="coulomb"))
    reach = Reach(admissible(s.problem, s.a, s.multipliers, s.weights, s.law), Work(ENDS_WORK))
    for corner in range(4):
        function = reach.adm.corners[3 * corner + 2]
        start = time.perf_counter()
        inside = reach.largest(function).value
        middle = time.perf_counter()
        around, rounds, outside = cutting_planes(reach, function)
        took = time.perf_counter() - middle
        print(f"corner {corner}: proximal steps {inside:.9f} N in {middle - start:.4f} s; ", end="")
        print(f"planes {around:.9f} N in {took:.2f} s, {rounds} rounds, {outside:.1e} N outside")
