"""Impulses that hold rows still, and velocities of a step beside the accelerations of `rbd.solve`."""

from dataclasses import replace

import numpy as np
import pytest
from flat_bodies import slider

import rbd
from rbd.arrays import cross_matrix
from rbd.constraints.contact_points import sources_of
from rbd.problem.cones import FrictionCone, Product
from rbd.problem.force_set import at_rest
from rbd.simulation import velocity_problem
from rbd.simulation.stacked_points import Points
from rbd.simulation.velocity_problem import active_rows, point_impulses, solve_velocity
from rbd.solvers.kkt import StickingSolver
from rbd.solvers.newton import scaled, steps_from

Array = np.ndarray
EXACT = 1e-13


def corners(mu: float, k: int) -> StickingSolver:
    """Of k points with friction."""
    cone = rbd.problem.FrictionCone(mu, 4)
    return StickingSolver(at_rest(*[cone] * k))


def four_points(rng: np.random.Generator) -> Array:
    """D of four points on one rigid body: twelve rows of rank six."""
    J = rng.normal(size=(6, 12))
    return J.T @ J


def test_of_impulses_that_hold_it_takes_those_nearest_to_the_guess():
    """Least squares in closed form: w = guess - D^+ (D guess + u), where the points are pressed hard enough."""
    rng = np.random.default_rng(0)
    D = four_points(rng)
    pressed = np.tile([0.0, 0.0, 10.0], 4)
    u, guess = -D @ (pressed + 0.1 * rng.normal(size=12)), pressed + rng.normal(size=12)
    found = corners(5.0, 4).impulses(D, u, guess, EXACT)
    assert found is not None
    w, merit, shortest = found
    assert merit <= EXACT and not shortest
    assert np.abs(D @ w + u).max() < 1e-11 * np.abs(u).max()
    assert np.abs(w - (guess - np.linalg.pinv(D, rcond=1e-10) @ (D @ guess + u))).max() < 1e-6  # damping, over D's spread


@pytest.mark.parametrize("pressed", [[3.0, 0.0, 1.0], [0.0, 0.0, -1.0]], ids=["must slip", "must part"])
def test_what_cannot_hold_is_left_to_others(pressed: list[float]):
    """The only impulse that holds the point lies outside its cone, guessed or not."""
    D = np.diag([1.0, 2.0, 3.0])
    for guess in (np.zeros(3), np.array(pressed)):
        assert corners(0.5, 1).impulses(D, -D @ pressed, guess, EXACT) is None


def test_where_the_nearest_impulses_would_pull_or_slip_others_hold():
    """Four corners of a box that some share holds: of the shares nearest to a guess few push and stick, others are found."""
    rng, mu = np.random.default_rng(0), 0.6
    arms = [np.array([x, y, 0.0]) for x in (-0.1, 0.1) for y in (-0.05, 0.05)]
    P = np.hstack([np.vstack([np.eye(3), cross_matrix(arm)]) for arm in arms])
    D, near, found = P.T @ np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0]) @ P, 0, 0
    for _ in range(200):
        angle, load = rng.uniform(0.0, 2.0 * np.pi, 4), rng.uniform(0.05, 3.0, 4)
        rubs = mu * load * rng.uniform(0.0, 0.9, 4)
        u = -D @ np.column_stack([rubs * np.cos(angle), rubs * np.sin(angle), load]).ravel()
        guess = rng.normal(size=12)
        near += corners(mu, 4).impulses(D, u, guess, EXACT, others=False) is not None
        other = corners(mu, 4).impulses(D, u, guess, EXACT)
        if other is not None:
            found += 1
            x, y, n = other[0].reshape(4, 3).T
            assert (np.hypot(x, y) <= mu * n).all() and np.abs(D @ other[0] + u).max() < 1e-11 * np.abs(u).max()
    assert found > 3 * near > 0


@pytest.mark.parametrize("name", ["talos", "solo12"])
@pytest.mark.parametrize("noise", [0.01, 0.3], ids=["sticks", "slips"])
def test_a_step_from_rest_gains_the_acceleration_of_solve_times_its_length(name: str, noise: float):
    """From rest J_dot v is zero: the velocity problem is the acceleration problem times h, and v+ = h a."""
    robot, h = rbd.load_robot(name), 1e-3
    standing, feet = robot.standing(), robot.feet(0.6)
    points = Points(sources_of(feet, standing))
    at = points.at(standing, 0.0)
    everything, nothing = np.ones(len(at.gap), bool), np.zeros(len(at.velocity))
    hold = rbd.hold(standing, feet).tau
    scale, rng = np.abs(hold).max(), np.random.default_rng(1)
    for _ in range(5):
        tau = np.clip(hold + noise * scale * rng.normal(size=robot.nu), -robot.effort_limit, robot.effort_limit)
        solution = rbd.solve(standing, tau, feet, solver=rbd.ConeSolver())
        if solution.reason:
            continue  # one of a family of motions
        force = robot.actuation.T @ tau - standing.h
        answer = solve_velocity(at, everything, h * force, nothing, h, nothing, law="coulomb")
        assert answer.law < 1e-10
        assert np.abs(answer.v - h * solution.a).max() < 1e-8 * h * max(1.0, np.abs(solution.a).max())


def test_points_that_nearly_depend_on_each_other_are_solved_by_steps_alone(monkeypatch):
    """Six points of a plate that yields by 3e-5: Newton's steps stall at first; nine draws in ten need no other method."""

    def other(*given: object, **settings: object) -> None:
        pytest.fail("another method was asked")

    monkeypatch.setattr(velocity_problem, "admm", other)
    rows = active_rows(Points([]).layout(()), np.zeros(0, bool), 1.0)
    rows = replace(rows, sets=at_rest(Product([FrictionCone(0.6)] * 6)), index=slice(None))
    arms = np.array([[x, y, 0.0] for x in (-0.1, 0.0, 0.1) for y in (-0.05, 0.05)])
    plate = np.concatenate([np.hstack([0.3 * np.eye(3), -2.0 * cross_matrix(x)]) for x in arms])
    solved = stalls = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        J = np.hstack([plate, 3e-5 * rng.normal(size=(18, 18))])
        u = plate @ (rng.normal(size=6) * [1.0, 1.0, 0.3, 1.0, 1.0, 1.0] - [0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        S = scaled(J @ J.T, u, rows.sets)
        stalls += steps_from(S, np.zeros(18), coulomb=True, iterations=10)[1] > 1e-10
        try:
            f, merit, _ = point_impulses(rows, J @ J.T, u, np.zeros(18), None, 1e-3, "coulomb", other)
        except pytest.fail.Exception:
            continue
        solved += 1
        y, f = (J @ J.T @ f + u).reshape(-1, 3), f.reshape(-1, 3)
        assert merit <= 1e-10 and y[:, 2].min() > -1e-9 and np.abs(f[:, 2] * y[:, 2]).max() < 1e-9
        assert (np.hypot(f[:, 0], f[:, 1]) <= 0.6 * f[:, 2] + 1e-12).all()
        along = (f[:, :2] * y[:, :2]).sum(axis=1) + 0.6 * f[:, 2] * np.hypot(y[:, 0], y[:, 1])
        assert np.abs(along).max() < 1e-9
    assert stalls >= 5 and solved >= 36


def test_what_is_no_delassus_matrix_has_no_impulses():
    """With a direction in which an impulse works backwards."""
    D = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 0.0], [3.0, 0.0, 1.0]])
    assert corners(0.5, 1).impulses(D, np.array([0.0, 0.0, -1.0]), np.zeros(3), EXACT) is None


def test_steps_of_a_thousand_lengths_are_each_solved_as_the_first():
    """Bounded forces make impulses that go with the step's length: dry friction of 5 N under 7 N leaves 2 N h / m, of any h."""
    robot = slider(2.0)
    state = rbd.State(robot, np.zeros(1))
    at = Points(sources_of([rbd.JointFriction("rub", "slide", 5.0)], state)).at(state, 0.0)
    on = np.ones(1, bool)
    for h in [*np.linspace(1e-4, 1e-2, 600), 1e-4]:
        answer = solve_velocity(at, on, np.array([7.0 * h]), np.zeros(1), h, np.zeros(1), law="coulomb")
        assert answer.v == pytest.approx([2.0 * h / 2.0], rel=1e-9)
        assert answer.impulse == pytest.approx([-5.0 * h], rel=1e-9)
