"""The centroid's program against closed forms: a fall, the edge of a sole, friction, feet that shift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rbd.arrays import Array
from rbd.centroid import CentroidCosts, CentroidPlan, CentroidProgram
from rbd.errors import NoSolution

MASS, G, DT, N = 35.0, 9.81, 1.0 / 60.0, 60
SOLE = np.array([[0.1, 0.05, 0.0], [-0.1, 0.05, 0.0], [-0.1, -0.05, 0.0], [0.1, -0.05, 0.0]])
DOWN = np.array([0.0, 0.0, -G])
FIRM = CentroidCosts(momentum=1e-5, force=1e3, force_rate=1e3)
"""Angular momentum stays as it is; forces may be as uneven as they like."""


def program(com: Array, on: Array | bool = True, friction: float = 0.6, costs: CentroidCosts = FIRM) -> CentroidProgram:
    """One sole at the origin."""
    n = len(com)
    touches = np.broadcast_to(np.asarray(on), (n,))[:, None] & np.ones(4, bool)
    return CentroidProgram(DT, MASS, DOWN, np.tile(SOLE, (n, 1, 1)), touches, friction, com, np.zeros((n, 3)), costs=costs)


def solved(problem: CentroidProgram) -> CentroidPlan:
    """Solved from its own answer until nothing is left."""
    plan = problem.solve()
    for _ in range(8):
        plan = problem.solve(plan)
    assert plan.residual < 1e-4
    forces = plan.forces
    assert (np.hypot(forces[..., 0], forces[..., 1]) <= problem.friction * forces[..., 2] + 1e-5 * problem.weight).all()
    assert not forces[~problem.touches].any()
    return plan


def at(x: float, y: float = 0.0) -> Array:
    """A centre of mass at rest, half a metre above the floor."""
    return np.tile([x, y, 0.5], (N, 1))


def test_what_stands_inside_stays() -> None:
    """Over the sole nothing moves, and the forces carry the weight where it is."""
    plan = solved(program(at(0.04)))
    assert plan.com == pytest.approx(at(0.04), abs=1e-5)
    total = plan.forces.sum(axis=1)
    assert total == pytest.approx(np.tile([0.0, 0.0, MASS * G], (N, 1)), abs=1e-2)
    pressure = (plan.forces[..., 2] @ SOLE[:, 0]) / total[:, 2]
    assert pressure == pytest.approx(0.04, abs=1e-5)


def test_a_firm_height_is_kept() -> None:
    """Where the height costs little it is given up to stop a motion sooner; a firm one is kept."""
    costs = CentroidCosts(com=0.01, momentum=1e-5, force=1e3, force_rate=1e3, acceleration=1e2, jerk=1e4)
    start = (np.array([0.03, 0.0, 0.5]), np.array([0.2, 0.0, 0.0]), np.zeros(3))
    left = []
    for height in (None, 1e-5):
        some = replace(program(at(0.0), costs=replace(costs, height=height)), start=start)
        left.append(float(np.abs(solved(some).com[:, 2] - 0.5).max()))
    assert left[1] < 1e-5 < 1e-3 < left[0]


def test_what_stands_outside_comes_to_the_edge() -> None:
    """At rest outside the sole: the nearest at rest is over its edge; it would tip farther out."""
    calm = CentroidCosts(momentum=1e-4, force=10.0, force_rate=100.0, acceleration=1e-2)
    plan = solved(program(at(0.13), costs=calm))
    assert plan.com[:, 0] == pytest.approx(0.1, abs=2e-3)
    assert plan.com[:, 1] == pytest.approx(0.0, abs=1e-6)


def test_what_rests_at_its_ends_is_in_balance_there() -> None:
    """Free ends sway; at rest three places are the same, over the sole."""
    base = program(at(0.13), costs=CentroidCosts())
    plan = solved(CentroidProgram(**(vars(base) | {"rests": (True, True)})))
    for ends in (plan.com[:3], plan.com[-3:]):
        assert np.ptp(ends, axis=0).max() < 1e-5
        assert ends[0, 0] < 0.1 + 2e-2 < solved(base).com[0, 0]


def test_without_contact_it_falls() -> None:
    """In the air the acceleration is gravity and the angular momentum stays."""
    on = np.ones(N, bool)
    on[25:35] = False
    plan = solved(program(at(0.0), on))
    acceleration = np.diff(plan.com, 2, axis=0) / DT**2
    assert acceleration[24:34] == pytest.approx(np.tile(DOWN, (10, 1)), abs=1e-4)
    assert plan.moment == pytest.approx(0.0, abs=1e-2)


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_friction_limits_acceleration(friction: float) -> None:
    """A wish to accelerate at 4 m/s2 on the spot, moments free: the most is mu g where the height is kept."""
    t = DT * np.arange(N)
    com = at(0.0)
    com[:, 0] = 2.0 * t**2
    free = CentroidCosts(com=1.0, momentum=1.0, acceleration=0.1, jerk=100.0)
    plan = solved(program(com, friction=friction, costs=free))
    acceleration = np.diff(plan.com, 2, axis=0)[5:-5] / DT**2
    assert (acceleration[:, 0] <= friction * (G + acceleration[:, 2]) + 1e-4).all()
    assert acceleration[:, 0].mean() == pytest.approx(friction * G, rel=0.2)


def test_stances_shift_under_what_must_be_carried() -> None:
    """A foot that may move comes under the centre of mass; no farther than it is allowed to."""
    stance = np.zeros((N, 4), int)
    base = program(at(0.3), costs=CentroidCosts(com=1e-2, momentum=1e-4, acceleration=1e-2, shift=10.0))
    free = CentroidProgram(**(vars(base) | {"stance": stance}))
    assert solved(free).shifts[0, 0] > 0.18
    held = CentroidProgram(**(vars(base) | {"stance": stance, "bounds": (np.array([[-1.0, 0.0]]), np.array([-0.1]))}))
    plan = solved(held)
    assert plan.shifts[0, 0] == pytest.approx(0.1, abs=1e-4)
    assert plan.com[20:40, 0] == pytest.approx(0.2, abs=5e-3)


def test_what_has_no_answer_is_said() -> None:
    """Shifts that contradict each other."""
    bounds = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0])
    base = program(at(0.0))
    with pytest.raises(NoSolution, match="centroid's program of 60 times"):
        CentroidProgram(**(vars(base) | {"stance": np.zeros((N, 4), int), "bounds": bounds})).solve()


def test_cones_about_the_normals_of_slopes():
    """On a slope steeper than friction nothing rests; on a flatter one the weight is carried, in cones about the normal."""
    slope = np.tan(np.deg2rad(12.0))
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(1.0, slope)
    points = SOLE + [0.0, 0.0, 1.0] * (slope * SOLE[:, :1])
    com = np.tile([0.0, 0.0, 0.5], (N, 1))
    base = CentroidProgram(
        DT, MASS, DOWN, np.tile(points, (N, 1, 1)), np.ones((N, 4), bool), 1.1 * slope, com, np.zeros((N, 3)),
        rests=(True, True), normals=np.tile(normal, (N, 4, 1)),
    )  # fmt: skip
    plan = base.solve()
    for _ in range(8):
        plan = base.solve(plan)
    total = plan.forces.sum(axis=1)
    np.testing.assert_allclose(total[N // 2], -MASS * DOWN, atol=0.02 * MASS * 9.81)
    along = plan.forces @ normal
    assert (np.linalg.norm(plan.forces - along[..., None] * normal, axis=2) <= 1.1 * slope * along + 1e-3).all()
    with pytest.raises(NoSolution):
        CentroidProgram(**(vars(base) | {"friction": 0.9 * slope})).solve()
    level = CentroidProgram(
        **(vars(base) | {"points": np.tile(SOLE, (N, 1, 1)), "normals": np.tile([0.0, 0.0, 1.0], (N, 4, 1))})
    )
    plain = CentroidProgram(**(vars(level) | {"normals": None}))
    np.testing.assert_allclose(solved(level).com, solved(plain).com, atol=1e-5)


def test_a_start_is_kept() -> None:
    """Centre of mass, velocity and angular momentum at the first time are as given; it comes to rest over its foot."""
    at_0, v, L = np.array([0.0, 0.0, 0.5]), np.array([0.2, -0.05, 0.0]), np.array([0.3, -0.4, 0.1])
    base = program(at(0.0), costs=CentroidCosts(turning=1e-3))
    plan = solved(CentroidProgram(**(vars(base) | {"rests": (False, True), "start": (at_0, v, L)})))
    c = plan.com
    assert c[0] == pytest.approx(at_0, abs=1e-6)
    assert (-1.5 * c[0] + 2.0 * c[1] - 0.5 * c[2]) / DT == pytest.approx(v, abs=1e-4)
    assert c[-1] == pytest.approx(c[-2], abs=1e-5)
    x = c[0, 0] + v[0] * np.sqrt(0.5 / G)  # the capture point: where a centre of pressure would stop it
    assert x > 0.04 and c[:, 0].max() < 0.1
    momentum = L + np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * DT * (plan.moment[1:] + plan.moment[:-1]), axis=0)])
    assert np.abs(momentum[-1]).max() < 0.1 * np.abs(L).max()  # what turns is brought to rest


def test_a_turn_that_costs_is_small() -> None:
    """Beyond the edge for a while: with free angular momentum it is used, where it costs the centre of mass moves instead."""
    t = DT * np.arange(N)
    com = at(0.0)
    com[:, 0] = 0.2 * np.sin(2.0 * np.pi * t / t[-1])
    sizes = []
    for turning in (np.inf, 1e-4):
        costs = CentroidCosts(momentum=1.0, com=5e-3, acceleration=1e2, jerk=1e4, turning=turning)
        base = program(com, costs=costs)
        plan = solved(CentroidProgram(**(vars(base) | {"start": (com[0], np.zeros(3), np.zeros(3))})))
        sizes.append(np.abs(np.cumsum(DT * plan.moment, axis=0)).max())
    assert sizes[1] < 0.1 * sizes[0]


def test_a_load_that_is_asked_for_is_carried() -> None:
    """Over the front edge two corners of the sole carry all; with a least load of the others the body is moved back by it."""
    least = np.zeros((N, 4))
    least[:, SOLE[:, 0] < 0.0] = share = 0.1 * MASS * G
    plan = solved(replace(program(at(SOLE[:, 0].max())), rests=(True, True), least=least))
    assert (plan.forces[..., 2] >= least - 1e-5 * MASS * G).all()
    back = SOLE[:, 0].max() - (2.0 * share / (MASS * G)) * np.ptp(SOLE[:, 0])
    assert (plan.com[[0, -1], 0] <= back + 1e-3).all()
