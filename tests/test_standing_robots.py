from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest

import rbd

NINE = ("talos", "g1", "romeo", "icub", "human", "solo12", "anymal_c", "go2", "bolt")
PUSHED_STATES = 300
"""A fifth of them but in `make exhaustive`."""


@pytest.fixture(scope="module", params=NINE)
def robot(request: pytest.FixtureRequest) -> rbd.Robot:
    """Each of the robots that stand as they are loaded."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        return rbd.load_robot(request.param)


def test_a_standing_robot_is_carried_by_its_feet(robot: rbd.Robot):
    """Newton: the forces on a robot at rest add up to its weight, upwards; no motor is beyond its limit."""
    state, feet = robot.standing(), robot.feet(0.7)
    held = rbd.hold(state, feet)
    solution = rbd.solve(state, held.tau, feet)
    weight_N = np.array([0.0, 0.0, robot.mass * 9.81])
    for forces in (held.forces, solution.forces):
        assert np.abs(sum(f[:3] for f in forces.values()) - weight_N).max() < 1e-9
    assert np.abs(solution.a).max() < 1e-9
    assert (np.abs(held.tau) <= robot.effort_limit).all()
    assert solution.status == "solved"


def test_pushed_states_are_solved_or_refused_never_wrong(robot: rbd.Robot, exhaustive: bool):
    """Of 60 or 300 states with noise on posture and torques (2 to 60 N m), friction .05 to 1, at least 99 % are solved.

    What is called solved is checked here by other code: the equations of motion, each ray of each foot's pyramids.
    """
    rng = np.random.default_rng(2)
    standing = robot.standing()
    tau = rbd.hold(standing, robot.feet()).tau
    solved, count = 0, PUSHED_STATES if exhaustive else PUSHED_STATES // 5
    for _ in range(count):
        q = pin.integrate(robot.model, standing.q, rng.choice([0.0, 0.02, 0.2]) * rng.normal(size=robot.nv))
        feet = robot.feet(rng.uniform(0.05, 1.0), on=None)
        state = rbd.State(robot, q)
        noisy = tau + rng.uniform(2.0, 60.0) * rng.normal(size=robot.nu)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rbd.errors.EffortLimitWarning)
            s = rbd.solve(state, noisy, feet, check=False, solver=rbd.ProxQP())
        if s.status != "solved":
            continue
        solved += 1
        J = np.vstack([foot.rows(state).J for foot in feet])
        motion = state.M @ s.a + state.h - robot.actuation.T @ noisy - J.T @ s.multipliers
        assert np.abs(motion).max() < 1e-9 * max(1.0, np.abs(state.M @ s.a).max(), np.abs(s.multipliers).max())
        c = np.concatenate([s.accelerations[foot.name] for foot in feet])
        opening, scale = s.problem.force_set.pyramids.G.T @ c, max(1.0, (np.abs(J) @ np.abs(s.a)).max())
        assert s.weights is not None and s.weights.min() >= 0.0 and opening.min() > -1e-8 * scale
        assert np.abs(s.weights * opening).max() < 1e-8 * scale * max(1.0, s.weights.max())
    assert solved >= 0.99 * count


def test_every_robot_of_the_catalogue_stands_on_the_ground_to_a_nanometre():
    """All corners of all feet, in the catalogue's posture: iCub's soles, whose file has five digits, lay 2.2 um off it."""
    stood = 0
    for name in rbd.robots.catalogue.robots():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rbd.errors.ModelWarning)
            each = rbd.load_robot(name)
        if not each.source.feet or each.source.posture is None:
            continue
        standing = each.standing()
        heights = np.concatenate([np.atleast_1d(foot.points(standing).gaps) for foot in each.feet()])
        moved = pin.difference(each.model, each.posture(each.source.posture), standing.q)[6:]
        assert np.abs(heights).max() < 1e-9 and np.abs(moved).max() < 1e-4, name
        stood += 1
    assert stood >= len(NINE)


def test_icub_starts_to_stand_without_events():
    """Held by its torques: no corner falls 2 um onto the ground, of which there were 22 events in 0.1 s."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        icub = rbd.load_robot("icub")
    state, feet = icub.standing(), icub.feet(0.7)
    tau = rbd.hold(state, feet).tau
    trajectory = rbd.simulate(state, feet, duration=0.05, step=0.001, controller=lambda *_: tau, progress=False)
    assert len(trajectory.events) == 0
