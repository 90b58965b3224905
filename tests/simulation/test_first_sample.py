"""`simulate` and `solve` answer one question alike: the first recorded acceleration and forces are those of `solve`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest

import rbd

G = 9.81
Case = tuple[rbd.State, np.ndarray, list, rbd.ExternalForce]
FRAMES = {"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link"}


def boxes(brick: rbd.Robot) -> Iterator[Case]:
    """10 kg on a floor with friction 0.6: it sticks, slips, slips on a diagonal, tips over an edge, leaves."""
    sole = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=sole, friction=0.6)
    state = brick.at(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
    for force, at in [
        ((30.0, 0.0, 0.0), 0.0),
        ((80.0, 0.0, 0.0), 0.0),
        ((56.6, 56.6, 0.0), -0.1),
        ((0.0, 0.0, -200.0), 0.35),
        ((5.0, 0.0, 150.0), 0.0),
    ]:
        yield state, np.zeros(0), [floor], rbd.ExternalForce("box", force, offset=(at if force[2] else 0.0, 0.0, 0.0))


def robots(name: str, count: int) -> Iterator[Case]:
    """Standing, its torques noisy and itself pushed: feet stick, slip, turn, lift."""
    rng, robot = np.random.default_rng(11), rbd.load_robot(name)
    state, limit = robot.standing(), robot.effort_limit
    tau = rbd.hold(state, robot.feet(0.7)).tau
    for _ in range(count):
        push = rng.normal(size=3) * robot.mass * G * rng.choice([0.05, 0.3, 0.8])
        noise = (0.1 if name == "solo12" else 1.0) * rng.choice([0.0, 10.0, 60.0]) * rng.normal(size=robot.nu)
        feet = robot.feet(rng.choice([0.1, 0.3, 0.7]))
        yield state, np.clip(tau + noise, -limit, limit), feet, rbd.ExternalForce(FRAMES[name], push)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # random torques and velocities, one step
@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize("name", ["box", "talos", "g1", "solo12"])
def test_the_first_sample_is_what_solve_says(brick: rbd.Robot, name: str, law: str) -> None:
    """To 1e-8 of the largest acceleration, where the motion is unique and nothing approaches."""
    told = {"sticks": 0, "moves": 0}
    for state, tau, contacts, push in boxes(brick) if name == "box" else robots(name, 40):
        s = rbd.solve(state, tau, contacts, law=law, external=push)
        if s.reason or rbd.solve(state, tau, contacts, external=push, solver=rbd.ConeSolver(law=law)).reason:
            continue  # a family of motions: a sole that slips and turns on four corners
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rbd.errors.DistantContactWarning)
            first = rbd.simulate(
                state, contacts, duration=1e-3, step=1e-3, controller=lambda _, t, tau=tau: tau, external=push, law=law
            )
        size = max(1.0, np.abs(s.a).max())
        assert np.abs(first.a[0] - s.a).max() < 1e-8 * size
        for contact, force in s.forces.items():
            assert np.abs(first.forces[contact][0] - force).max() < 1e-6 * max(1.0, np.abs(s.multipliers).max())
        told["moves" if max(np.abs(c).max() for c in s.accelerations.values()) > 1e-6 else "sticks"] += 1
    assert min(told.values()) >= (1 if name == "box" else 5), told
