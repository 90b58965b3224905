"""Force elements that are too stiff for explicit steps are named, with the cure."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rbd
from rbd.errors import InaccurateWarning, SimulationStopped

H = 0.01
STEPS = rbd.TimeStepping()


@pytest.fixture(scope="module")
def start() -> rbd.State:
    """A box of 1 kg without weight, at 1 m/s."""
    return rbd.State(rbd.testing.box(mass=1.0).with_gravity((0, 0, 0)), [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])


def damper(d: float) -> rbd.Damper:
    return rbd.Damper("box", to=(10, 0, 0), damping=d, name="brake")


def spring(k: float) -> rbd.Spring:
    return rbd.Spring("box", to=(10, 0, 0), stiffness=k, rest=10.0, name="band")


def run(start: rbd.State, external: object, **options: object) -> rbd.Trajectory:
    return rbd.simulate(start, duration=0.1, step=H, external=external, progress=False, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("element", "rate"), [(damper(1e4), "1e.04"), (spring(1e8), "1e.04")], ids=["damper", "spring"])
def test_one_that_stops_the_default_is_named_with_the_cure(start: rbd.State, element: rbd.constraints.forces.Spring, rate: str):
    said = rf"stiff force elements \('{element.name}'\): their fastest rate is {rate} per second, 100 times 1 / step"
    with pytest.warns(InaccurateWarning, match=said), pytest.raises(SimulationStopped, match=f"{said}.*rbd.TimeStepping"):
        run(start, element)
    kept = run(start, element, integrator=STEPS)
    np.testing.assert_allclose(kept.energy + kept.dissipated, 0.5, atol=1e-9)


def test_one_of_a_function_is_named_where_it_stops(start: rbd.State):
    """It is not asked before the motion: the message of the stop alone has it."""
    with pytest.raises(SimulationStopped, match=r"stiff force elements \('brake'\).*integrator=rbd.TimeStepping"):
        run(start, lambda state, t: [damper(1e4)])


def test_one_that_costs_accuracy_is_warned_of_and_a_soft_one_is_not(start: rbd.State):
    """A damper of h d / m = 1 takes 4 % more than there is."""
    with pytest.warns(InaccurateWarning, match=r"'brake'.*100 per second, 1 times 1 / step.*steps below 0.008 s"):
        wrong = run(start, [spring(1.0), damper(100.0)])
    assert wrong.dissipated[-1] > 0.52
    for external, options in (
        (damper(40.0), {}),
        (spring(1600.0), {}),
        (damper(1e4), {"integrator": STEPS}),
        (damper(300.0), {"integrator": rbd.DormandPrince8()}),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert run(start, external, **options).dissipated[-1] < 0.502


def test_the_rate_is_that_of_the_motion_which_constraints_leave(start: rbd.State):
    """A damper along a direction that is held does nothing; two in one direction add up, and both are named."""
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.1, 0.1), friction=None)
    still = rbd.State(start.robot, start.q)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(still, rbd.Damper("box", to=(10, 0, 0), damping=1e4), constraints=[face])
    with pytest.warns(InaccurateWarning, match=r"\('one', 'two'\): their fastest rate is 120 per second"):
        run(still, [rbd.Damper("box", to=(10, 0, 0), damping=60.0, name=name) for name in ("one", "two")])


def test_joints_of_an_arm_have_the_rate_of_its_lightest_motion():
    """Damping over the joint's inertia, seen with the other joints free: 1/s of M^-1 D, by its eigenvalues."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(3, lengths=[1.0, 1.0, 0.5]), masses=[1.0, 1.0, 0.5])
    state, damping = arm.at([0.3, 0.4, -0.2]), {name: 2.0 for name in ("joint_1", "joint_2", "joint_3")}
    rate = np.linalg.eigvals(np.linalg.solve(state.M, 2.0 * np.eye(3))).real.max()
    for h, heard in ((0.85 / rate, True), (0.75 / rate, False)):
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            rbd.simulate(state, duration=2 * h, step=h, external=rbd.JointDamping(damping), progress=False)
        assert [f"fastest rate is {rate:.3g} per second" in str(w.message) for w in seen] == [True] * heard


@pytest.mark.parametrize("element", [damper(1e8), spring(1e12)], ids=["damper", "spring"])
def test_adaptive_steps_on_one_of_1e8_are_warned_of_and_given_up(start: rbd.State, element: rbd.constraints.forces.Spring):
    """They would be some 1e5 between two samples; a motion is given up after `most_steps` of them."""
    said = rf"stiff force elements \('{element.name}'\).*some [\d.e+]+ steps between samples"
    by = rbd.DormandPrince8(most_steps=200)
    moving = start.with_velocity(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.warns(InaccurateWarning, match=said), pytest.raises(SimulationStopped, match="200 steps since.*TimeStepping"):
        run(moving, element, integrator=by)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(moving, spring(3600.0), integrator=by)  # 200 between two samples, not in all


@pytest.mark.parametrize("most", [0, 2.5, True])
def test_the_number_of_adaptive_steps_is_a_whole_one(most: object):
    with pytest.raises(rbd.errors.InputError, match="most_steps of DormandPrince8 is .*expected a whole number from 1"):
        rbd.DormandPrince8(most_steps=most)  # type: ignore[arg-type]
