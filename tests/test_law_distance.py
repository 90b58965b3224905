"""Each point is judged by its own distance to the law: no product of two middling numbers passes as a small one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import nnls

import rbd
from rbd.problem.cones import pyramid
from rbd.problem.law_distance import largest_distance, nearest_in_pyramids
from rbd.problem.residuals import SOLVED, residuals_of
from rbd.problem.rows import Rows


def _point(f, c, cone, law: str) -> rbd.problem.Answer:
    """1 kg on which the force f of a point makes the acceleration c, exactly, whatever the law says of the two."""
    f, c = np.array(f, float), np.array(c, float)
    n = len(f)
    P = rbd.GaussProblem(np.eye(n), c - f, [Rows("tip", np.eye(n), np.zeros(n), cone)])
    T = P.force_set_of(rbd.problem.gauss_problem.Law.of(law))
    weights = T.weights_of(f) if law != "convex, 4 facets" else nnls(T.G, f)[0]
    return rbd.problem.Answer(P, c, f, weights, law, "by hand", 1, 0.0)


CONE, STEEP = rbd.problem.FrictionCone(0.5), rbd.problem.FrictionCone(1e6)


@pytest.mark.parametrize(
    ("f", "c", "cone", "law", "far"),
    [
        ([1e-5], [1e-5], rbd.problem.NonNegative(1), "convex", 1e-5),  # a stop that pushes a little, and opens a little
        ([3.0 - 1e-5], [-1e-5], rbd.problem.Bounds([-3.0], [3.0]), "convex", 1e-5 / 3.0),  # friction not quite at its limit
        ([0.0, 0.0, 1e-5], [0.0, 0.0, 1e-5], CONE, "coulomb", 1e-5),
        ([-0.5, 0.0, 1.0], [2.0, 0.0, 1e-6], CONE, "coulomb", 1e-6),  # slips, and lifts off with 1e-6 m/s2 while it pushes
        ([0.0, 0.1, 1.0], [1e-6, 0.0, 0.0], CONE, "coulomb", 1e-6),  # creeps with a tenth of its friction used
        ([0.0, 0.1, 1.0], [0.0, 0.0, 1e-6], CONE, "convex", 1e-6),
        ([0.0, 0.1, 1.0], [0.0, 0.0, 1e-6], CONE, "convex, 4 facets", 1e-6),
        ([0.0, 8.0, 1.5], [0.0, 0.0, 2e-2], STEEP, "convex", 2e-2),  # hardly any of its friction used
        ([0.0, 8.0, 1.5], [0.0, 0.0, 2e-2], STEEP, "convex, 4 facets", 2e-2),  # rays a million long hide the gap
        ([0.0, 1e-2, 1e-8], [0.0, 0.0, 1.0], STEEP, "coulomb", 1e-2),  # rubs with a million times what it pushes, in the air
    ],
)
def test_a_force_across_a_gap_is_no_answer_however_small_their_product(f, c, cone, law, far) -> None:
    """The scaled residual is what the smaller of both must change by; none of these is called solved."""
    found = _point(f, c, cone, law)
    assert found.residuals.complementarity.scaled == pytest.approx(far, rel=0.5)
    assert found.status == "failed" and not found.residuals.within(SOLVED)


@pytest.mark.parametrize(
    ("f", "c", "cone", "law"),
    [
        ([2.0], [0.0], rbd.problem.NonNegative(1), "convex"),
        ([3.0], [-7.0], rbd.problem.Bounds([-3.0], [3.0]), "convex"),
        ([0.0, 0.0, 0.0], [5.0, 3.0, 1.0], CONE, "coulomb"),
        ([-0.3, -0.4, 1.0], [3.0, 4.0, 0.0], CONE, "coulomb"),
        ([-0.3, -0.4, 1.0], [3.0, 4.0, 2.5], CONE, "convex"),
        ([-0.5, 0.25, 1.0], [3.0, 0.0, 1.5], CONE, "convex, 4 facets"),  # on the facet across x
        ([-0.5, 0.5, 1.0], [3.0, -1.0, 2.0], CONE, "convex, 4 facets"),  # on a ray
        ([0.1, 0.0, 1.0], [0.0, 0.0, 0.0], STEEP, "convex, 4 facets"),
    ],
)
def test_what_obeys_the_law_has_no_distance(f, c, cone, law) -> None:
    """Pushing, at a bound, open, slipping under each law, on a facet and on a ray."""
    found = _point(f, c, cone, law)
    assert found.residuals.complementarity.scaled < 1e-14 and found.status == "solved"


def test_the_direction_of_little_slip_does_not_count_for_much() -> None:
    """Friction a hundredth off its direction at 1e-8 m/s2: the slip would have to turn by 1e-10 m/s2, which is nothing."""
    turned = [-0.5 * math.cos(0.01), 0.5 * math.sin(0.01), 1.0]
    assert _point(turned, [1e-8, 0.0, 0.0], CONE, "coulomb").status == "solved"
    assert _point(turned, [1.0, 0.0, 0.0], CONE, "coulomb").residuals.complementarity.scaled == pytest.approx(3.1e-3, rel=0.1)


def test_one_direction_of_a_point_is_not_measured_by_another_where_it_slips() -> None:
    """Dragged sideways at 1e6 m/s2 it may not lift off at 1e-4 while it pushes: the normal has its own terms."""
    c = _point([-0.5, 0.0, 1.0], [1e6, 0.0, 1e-4], CONE, "coulomb").residuals.complementarity
    assert c.scaled == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("law", ["coulomb", "convex", "convex, 4 facets"])
def test_numbers_of_all_sizes_are_judged_without_a_warning(law) -> None:
    """Slip of 1e-290 m/s2, of 1e100: told by the status, though quotients of such numbers overflow."""
    assert _point([0.0, 0.0, 1.0], [1e-290, 0.0, 0.0], CONE, law).status == "solved"
    assert _point([0.0, 0.0, 1e50], [1e100, 0.0, 0.0], STEEP, law).status == "failed"


@pytest.mark.parametrize("facets", [3, 4, 5, 16])
@pytest.mark.parametrize("mu", [1e-3, 0.7, 50.0])
def test_the_nearest_force_of_a_pyramid(mu, facets, rng) -> None:
    """That of nonnegative least squares on its rays: inside, on facets, on rays, at the apex."""
    given = rng.normal(size=(200, 3)) * np.array([mu, mu, 1.0])
    found = nearest_in_pyramids(given, np.full(200, mu), facets)
    rays = pyramid(mu, facets)
    rays = rays / np.linalg.norm(rays, axis=0)
    expected = np.array([rays @ nnls(rays, one)[0] for one in given])
    assert found == pytest.approx(expected, abs=1e-12 * max(1.0, mu))


def test_what_passes_without_scales_passes_with_them(rng) -> None:
    """The cheap bound is not below the distances: of near answers of every law, each off by a little of its own."""
    cones = [CONE, rbd.problem.FrictionCone(2.0, facets=8), rbd.problem.NonNegative(1), rbd.problem.Bounds([-1.0], [2.0])]
    told = 0
    for law in ("coulomb", "convex", "convex, 4 and 8 facets"):
        for _ in range(60):
            A = rng.normal(size=(9, 9))
            rows = [Rows(f"r{i}", rng.normal(size=(c.dim, 9)), np.zeros(c.dim), c) for i, c in enumerate(cones)]
            P = rbd.GaussProblem(A @ A.T + np.eye(9), 10.0 * rng.normal(size=9), rows)
            solver = rbd.ProxQP() if "facets" in law else rbd.ConeSolver(law=law)
            s = solver.solve(P)
            for size in (0.0, 1e-10, 1e-6):
                a = s.a + size * rng.normal(size=9)
                T = P.force_set_of(s.law)
                w = T.project(s.weights + size * rng.normal(size=T.size) * (s.weights != 0.0))
                y = T.accelerations(P.J @ a + P.offset)
                exact = residuals_of(P, a, T.G @ w, w, s.law).complementarity.scaled
                bound = largest_distance(
                    T, w, y, T.slack(w, y) if law != "coulomb" else np.abs(w * y), coulomb=law == "coulomb"
                )
                sinks = np.maximum(-y, 0.0).max()  # what pierces is told as such
                assert exact <= 1.001 * bound + 10.0 * sinks + 1e-15
                told += 0.0 < exact <= bound
    assert told > 300
