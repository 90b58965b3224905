"""Springs and dampers in motion: exact energies, order two and stability of time steps, and the record of a trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.forces import Bushing, Damper, JointDamping, JointSpring, Spring
from rbd.model.checked_model import CheckedModel

EXACT = rbd.DormandPrince8(rtol=1e-12, atol=1e-13)
STEPS = rbd.TimeStepping()
M = 2.0


@pytest.fixture(scope="module")
def box() -> CheckedModel:
    return rbd.testing.box(mass=M)


@pytest.fixture(scope="module")
def in_space() -> CheckedModel:
    """The box without weight."""
    return boxes(box=M, gravity=0.0)


def boxes(gravity: float = 9.81, **masses: float) -> CheckedModel:
    """Free boxes in one model."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    for name, mass in masses.items():
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"{name}_joint")
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(mass, 0.4, 0.4, 0.2), pin.SE3.Identity())
        model.addBodyFrame(name, joint, pin.SE3.Identity(), 0)
    return CheckedModel(model, name="boxes")


@pytest.fixture(scope="module")
def arm() -> rbd.Robot:
    return rbd.planar.to_robot(rbd.planar.Chain(3, lengths=[1.0, 1.0, 0.5]), masses=[1.0, 1.0, 0.5])


def spring_to_origin(k: float, d: float = 0.0) -> list[object]:
    """The same stiffness and damping in all directions, relaxed at the origin."""
    return [Bushing("box", to=(0, 0, 0), stiffness=(k, k, k, 0, 0, 0), damping=(d, d, d, 0, 0, 0))]


def balance(run: rbd.Trajectory) -> np.ndarray:
    """Energy with what dampers took less the work of the motors: constant."""
    return run.energy + run.dissipated - run.motor_work


def swinging(box: CheckedModel) -> rbd.State:
    return rbd.State(box, [0.1, 0.2, 1.05, 0, 0, 0, 1], [0, 0.3, 0, 1.0, 0.5, 2.0])


def test_a_mass_on_springs_keeps_its_energy_to_1e_9_with_dormand_prince(box: CheckedModel) -> None:
    springs = [
        Spring("box", to=(0, 0, 2), stiffness=200.0, rest=0.8, offset=(0.1, 0.1, 0.1)),
        Spring("box", to=(1, 0, 1), stiffness=80.0, rest=0.5, offset=(0.1, -0.1, 0.1), name="second"),
    ]
    run = rbd.simulate(swinging(box), external=springs, duration=3.0, step=0.05, integrator=EXACT)
    assert np.ptp(run.kinetic) > 5.0 and np.ptp(run.elastic) > 5.0
    assert np.ptp(run.energy) < 1e-9 * np.ptp(run.kinetic) and not run.dissipated.any()


def test_a_double_spring_pendulum_keeps_its_energy_to_1e_9() -> None:
    """Two masses, each on a spring: the second hangs on the first."""
    two = boxes(first=1.0, second=1.5)
    springs = [
        Spring("first", to=(0, 0, 3), stiffness=60.0, rest=0.8),
        Spring("second", to="first", stiffness=40.0, rest=0.9),
    ]
    q = [0.6, 0.0, 2.2, 0, 0, 0, 1, 1.2, 0.2, 1.3, 0, 0, 0, 1]
    run = rbd.simulate(rbd.State(two, q), external=springs, duration=3.0, step=0.05, integrator=EXACT)
    assert np.ptp(run.kinetic) > 5.0
    assert np.ptp(run.energy) < 1e-9 * np.ptp(run.kinetic)


def test_a_body_on_a_damped_bushing_loses_what_its_damper_takes(box: CheckedModel) -> None:
    mount = Bushing(
        "box", to=(0, 0, 1), stiffness=(400, 500, 981, 20, 30, 25), damping=(5, 5, 5, 0.5, 0.5, 0.5), offset=(0.1, 0.1, 0.1)
    )
    run = rbd.simulate(swinging(box), external=mount, duration=1.0, step=0.02, integrator=EXACT)
    assert run.dissipated[-1] > 30.0 and (np.diff(run.dissipated) >= 0.0).all()
    assert np.ptp(balance(run)) < 1e-9 * np.ptp(run.kinetic)
    kutta = rbd.simulate(swinging(box), external=mount, duration=1.0, step=1e-3, integrator=rbd.RungeKutta4())
    assert kutta.dissipated[-1] == pytest.approx(run.dissipated[-1], rel=1e-7)
    assert np.ptp(balance(kutta)) < 1e-6


@pytest.mark.parametrize("integrator", [EXACT, STEPS])
def test_frequency_of_a_mass_on_springs_is_the_root_of_stiffness_over_mass(box: CheckedModel, integrator: object) -> None:
    """Zeros of the motion are half a period pi / w apart; time stepping has w (1 - (h w)^2 / 12)."""
    k, h = 200.0, 1e-3
    w = np.sqrt(k / M)
    start = rbd.State(box, [0.0, 0.0, 0.05 - M * 9.81 / k, 0, 0, 0, 1])
    run = rbd.simulate(start, external=spring_to_origin(k), duration=2.0, step=h, integrator=integrator)
    z = run.q[:, 2] + M * 9.81 / k
    at = np.flatnonzero(z[:-1] * z[1:] < 0.0)
    # Cubic interpolation of z, v at both ends of the step would be exact to h^4; a line between is exact to h^3 near a zero.
    zeros = run.t[at] + h * z[at] / (z[at] - z[at + 1])
    found = np.pi * (len(zeros) - 1) / (zeros[-1] - zeros[0])
    expected = w if integrator is EXACT else w * (1.0 - (h * w) ** 2 / 12.0)
    assert found == pytest.approx(expected, rel=2e-7)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@pytest.mark.parametrize("case", ["spring", "spring and damper", "bushing", "joints"])
def test_time_steps_with_elements_are_of_order_two(box: CheckedModel, arm: rbd.Robot, case: str) -> None:
    state = swinging(box)
    spring = Spring("box", to=(0, 0, 2), stiffness=200.0, rest=0.8, offset=(0.1, 0.1, 0.1))
    elements: list[object] = [spring]
    if case == "spring and damper":
        elements.append(Damper("box", to=(0, 0, 2), damping=5.0, offset=(0.1, 0.1, 0.1)))
    if case == "bushing":
        stiffness, damping = (400, 500, 981, 20, 30, 25), (5, 5, 5, 0.5, 0.5, 0.5)
        elements = [Bushing("box", to=(0, 0, 1), stiffness=stiffness, damping=damping, offset=(0.1, 0.1, 0.1))]
    if case == "joints":
        state = arm.at([0.5, 0.3, 0.2], [1.0, 0.0, 2.0])
        one, two, three = arm.actuated_names
        elements = [JointSpring(one, stiffness=20.0, rest=0.1), JointSpring(three, stiffness=2.0)]
        elements.append(JointDamping({one: 1.0, two: 0.5, three: 0.2}))
    T = 0.4
    true = rbd.simulate(state, external=elements, duration=T, step=T, integrator=EXACT)
    errors, work = [], []
    for n in (40, 80, 160):
        run = rbd.simulate(state, external=elements, duration=T, step=T / n, integrator=STEPS)
        errors.append(np.abs(run.q[-1] - true.q[-1]).max())
        work.append(np.ptp(balance(run)))
    assert 3.6 < errors[0] / errors[1] < 4.4 and 3.8 < errors[1] / errors[2] < 4.2
    assert 3.5 < work[1] / work[2] < 4.5 and errors[-1] < 2e-3


@pytest.mark.parametrize("h_w", [0.1, 1.0, 10.0])
def test_a_linear_spring_keeps_its_energy_at_any_step(in_space: CheckedModel, h_w: float) -> None:
    """The midpoint rule keeps a quadratic energy exactly."""
    k = 200.0
    start = rbd.State(in_space, [0.1, 0.0, 0.05, 0, 0, 0, 1], [0, 0.3, 0, 0, 0, 0])
    h = h_w / np.sqrt(k / M)
    run = rbd.simulate(start, external=spring_to_origin(k), duration=300 * h, step=h, integrator=STEPS)
    assert np.ptp(run.energy) < 1e-12 * run.energy[0] and np.ptp(run.elastic) > 0.5


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
def test_a_pendulum_on_a_very_stiff_spring_swings_like_one_on_a_rod(box: CheckedModel) -> None:
    """At h w = 7 the spring is not resolved: it stays about as long as it is, and the energy does not grow."""
    spring = Spring("box", to=(0, 0, 2), stiffness=1e6, rest=1.0)
    run = rbd.simulate(rbd.State(box, [1, 0, 2, 0, 0, 0, 1]), external=spring, duration=2.5, step=1e-2, integrator=STEPS)
    length = np.linalg.norm(run.q[:, :3] - [0, 0, 2], axis=1)
    assert np.abs(length - 1.0).max() < 4e-4 and run.q[:, 0].min() < -0.99
    swing = M * 9.81 * 1.0
    assert np.ptp(run.energy) < 1.2e-3 * swing and run.energy.max() < run.energy[0] + 1e-6 * swing


def test_a_stiff_damper_stops_a_mass_without_ringing(in_space: CheckedModel) -> None:
    """At h d / m = 1000 the velocity does not change its sign by more than a tenth, and does not come back."""
    h, d = 1e-2, 2e5
    start = rbd.State(in_space, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
    damper = spring_to_origin(0.0, d)
    run = rbd.simulate(start, external=damper, duration=30 * h, step=h, integrator=STEPS)
    v = run.v[:, 0]
    assert (np.abs(v[1:]) <= 0.11 * np.abs(v[:-1])).all()
    assert (np.diff(run.energy) <= 0.0).all() and np.ptp(balance(run)) < 1e-12


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_a_damper_about_an_axis_slows_the_turn_of_a_floating_body(in_space: CheckedModel, tilt: float) -> None:
    """About the vertical: w = exp(-d t / I) of a level box; of a tilted one as by Dormand and Prince, to the order of steps."""
    start = rbd.State(in_space, [0, 0, 0, np.sin(0.5 * tilt), 0, 0, np.cos(0.5 * tilt)], [0, 0, 0, 0, 0, 1.0])
    about_z = Damper("box", to=(0.0, 0.0, 0.0), damping=0.1, axis=(0.0, 0.0, 1.0))
    steps, exact = (rbd.simulate(start, duration=0.1, step=1e-3, external=about_z, integrator=by) for by in (STEPS, EXACT))
    assert np.abs(steps.v[-1] - exact.v[-1]).max() < 1e-6
    lost = steps.kinetic[0] - steps.kinetic[-1]
    assert 0.0 < lost == pytest.approx(steps.dissipated[-1], rel=1e-6)
    if not tilt:
        assert steps.v[-1, 5] == pytest.approx(np.exp(-0.1 * 0.1 / start.M[5, 5]), rel=1e-8)


def test_under_a_stiff_damper_a_weight_sinks_at_weight_over_damping(box: CheckedModel) -> None:
    h, d = 1e-2, 2e5
    run = rbd.simulate(
        rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), external=spring_to_origin(0.0, d), duration=0.5, step=h, integrator=STEPS
    )
    assert run.v[-1, 2] == pytest.approx(-M * 9.81 / d, rel=1e-9)


@pytest.mark.parametrize("h_w", [0.3, 3.0, 10.0])
@pytest.mark.parametrize("h_d", [0.3, 30.0, 1e3])
def test_dampers_never_put_energy_into_a_motion(in_space: CheckedModel, h_w: float, h_d: float) -> None:
    """A spring and a damper beside it, both as stiff as can be: no step gains energy, from any start."""
    h = 1e-2
    k, d = M * (h_w / h) ** 2, M * h_d / h
    rng = np.random.default_rng(3)
    for _ in range(4):
        q, v = 0.1 * rng.normal(size=3), rng.normal(size=3) * rng.choice([0.01, 1.0, 30.0])
        start = rbd.State(in_space, [*q, 0, 0, 0, 1], [*v, 0, 0, 0])
        run = rbd.simulate(start, external=spring_to_origin(k, d), duration=40 * h, step=h, integrator=STEPS)
        assert np.diff(run.energy).max() <= 1e-12 * run.energy[0] and run.energy[-1] < run.energy[0]
        assert np.ptp(balance(run)) < 1e-10 * run.energy[0]


def test_recorded_accelerations_and_forces_are_those_of_the_elements_as_they_are(box: CheckedModel) -> None:
    """At every sample they are those of `rbd.solve` with the true forces, at a step that is 200 m / d of the damper."""
    h = 2e-2
    stiffness, damping = (5e3, 5e3, 2e3, 50, 50, 50), (2e2, 2e2, 2e4, 10, 10, 10)
    mount = Bushing("box", to=(0, 0, -0.005), stiffness=stiffness, damping=damping)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
    start = rbd.State(box, [0.1, 0, 0, 0, 0, 0, 1], [0.2, 0, 0, 0, 0, 0])
    run = rbd.simulate(start, [face], external=mount, duration=10 * h, step=h, integrator=STEPS)
    assert run.residuals["law"].max() < 1e-9 and {"slips", "sticks"} <= set(run.modes["face"])
    for sample in run:
        solved = rbd.solve(sample.state, np.zeros(0), [face], external=mount)
        assert np.abs(sample.a - solved.a).max() < 1e-9 * max(1.0, np.abs(solved.a).max())
        assert np.abs(sample.forces["face"] - solved.forces["face"]).max() < 1e-9


def test_joint_elements_of_talos_step_on_the_ground_as_they_do_in_general(talos: rbd.Robot) -> None:
    """Elements in joints alone take the prepared dynamics of the ground: the same numbers as by M, J and h."""
    from rbd.simulation.implicit_forces import ImplicitElements
    from rbd.simulation.velocity_problem import EXACT as EXACT_STEP

    state, feet = talos.at("half_sitting"), talos.feet(friction=0.6)
    place = talos.joints
    springs: list[object] = [JointSpring(n, stiffness=200.0, rest=float(state.q[place[n].q][0])) for n in talos.actuated_names]
    elements = [*springs, JointDamping(dict.fromkeys(talos.actuated_names, 3.0))]
    fast = rbd.simulate(state, feet, external=elements, duration=0.05, step=1e-3, integrator=STEPS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ImplicitElements, "is_light", lambda self, terms: terms is None)
        slow = rbd.simulate(state, feet, external=elements, duration=0.05, step=1e-3, integrator=STEPS)
    assert np.abs(fast.a[0] - slow.a[0]).max() < 1e-9 * np.abs(fast.a[0]).max()
    # Impulses are accepted at a merit of EXACT m/s, of a mean inertia; the lightest joint turns faster by the root of cond M.
    speed = 2.0 * EXACT_STEP * np.sqrt(np.linalg.cond(state.M))
    assert np.abs(fast.v - slow.v).max() < speed and np.abs(fast.q - slow.q).max() < speed * fast.t[-1]
    assert fast.residuals["law"].max() < 1e-9 and fast.dissipated[-1] > 1e-3


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
def test_talos_with_very_stiff_joint_damping_sinks_slowly(talos: rbd.Robot) -> None:
    """Step times damping over inertia is 1e5 in the wrists; without damping it would be on its knees."""
    state, feet = talos.at("half_sitting"), talos.feet(friction=0.6)
    damping = JointDamping(dict.fromkeys(talos.actuated_names, 1e4))
    run = rbd.simulate(state, feet, external=damping, duration=0.3, step=1e-2)
    assert (np.diff(run.energy) < 0.0).all() and np.abs(run.v).max() < 0.02
    assert run.residuals["law"].max() < 1e-9


def test_talos_in_the_air_with_joint_springs_keeps_its_energy(talos: rbd.Robot) -> None:
    state = talos.at("half_sitting")
    springs = [JointSpring(n, stiffness=300.0, rest=float(state.q[talos.joints[n].q][0])) for n in talos.actuated_names]
    rng = np.random.default_rng(1)
    v = np.concatenate([np.zeros(6), 0.5 * rng.normal(size=talos.nv - 6)])
    run = rbd.simulate(rbd.State(talos, state.q, v), external=springs, duration=0.1, step=0.02, integrator=EXACT)
    assert np.ptp(run.elastic) > 0.4
    assert np.ptp(run.energy) < 1e-9 * max(np.ptp(run.kinetic), np.ptp(run.elastic))


@pytest.mark.parametrize("by", [EXACT, STEPS, rbd.RungeKutta4()])
def test_elements_of_a_function_are_those_of_the_trajectory_if_they_stay(box: CheckedModel, by: object) -> None:
    """The same each time: as without a function. Let go, or made anew: none, as no sample says which acted."""
    springs = spring_to_origin(200.0, 3.0)
    start = rbd.State(box, [0, 0, 0.1, 0, 0, 0, 1])

    def run(external: object) -> rbd.Trajectory:
        return rbd.simulate(start, external=external, duration=0.1, step=0.02, integrator=by)

    assert run(lambda state, t: springs).elements == run(springs).elements == tuple(springs)
    assert run(lambda state, t: springs if t < 0.05 else []).elements == ()
    assert run(lambda state, t: spring_to_origin(200.0, 3.0)).elements == ()
    assert run(lambda state, t: np.zeros(6)).elements == ()


def test_a_function_of_time_may_give_elements(box: CheckedModel) -> None:
    """Their energy is that of those given at the sample; here the spring is let go at 0.1 s."""
    springs = spring_to_origin(200.0, 3.0)

    def external(state: rbd.State, t: float) -> list[object]:
        return springs if t < 0.1 else []

    start = rbd.State(box, [0.1, 0, 0.05, 0, 0, 0, 1])
    for integrator in (STEPS, rbd.RungeKutta4(), rbd.DormandPrince8(longest=1e-2)):
        run = rbd.simulate(start, external=external, duration=0.2, step=2e-3, integrator=integrator)
        assert run.elastic[:50].all() and not run.elastic[51:].any()
        assert run.dissipated[-1] == pytest.approx(run.dissipated[52], rel=1e-6) and run.dissipated[-1] > 0.01
        assert run.elements == ()


def test_an_element_without_derivatives_acts_explicitly(box: CheckedModel) -> None:
    class Wind:
        """Quadratic drag of the origin."""

        name = "wind"

        def generalised(self, state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
            at = state.frame("box")
            v = at.J[:3] @ state.v
            f = -0.5 * np.linalg.norm(v) * v
            return at.J[:3].T @ f, np.concatenate([f, np.zeros(3)])

        def energy(self, state: rbd.State) -> float:
            return 0.0

        def dissipation(self, state: rbd.State) -> float:
            return 0.5 * float(np.linalg.norm(state.frame("box").J[:3] @ state.v) ** 3)

    start = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [3.0, 0, 0, 0, 0, 0])
    true = rbd.simulate(start, external=Wind(), duration=0.5, step=0.1, integrator=EXACT)
    assert np.ptp(balance(true)) < 1e-9 and true.dissipated[-1] > 1.0
    run = rbd.simulate(start, external=Wind(), duration=0.5, step=1e-3, integrator=STEPS)
    assert run.q[-1] == pytest.approx(true.q[-1], abs=1e-6)


def test_dampers_work_is_counted_of_elements_without_derivatives_too(box: CheckedModel) -> None:
    class Plain:
        """A damper by its bare methods."""

        name = "plain"
        damper = Damper("box", to=(0, 0, 2), damping=4.0)

        def generalised(self, state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
            return self.damper.generalised(state)

        def energy(self, state: rbd.State) -> float:
            return 0.0

        def dissipation(self, state: rbd.State) -> float:
            return self.damper.dissipation(state)

    start = swinging(box)
    known = rbd.simulate(start, external=Plain.damper, duration=0.2, step=1e-3, integrator=STEPS)
    plain = rbd.simulate(start, external=Plain(), duration=0.2, step=1e-3, integrator=STEPS)
    assert plain.dissipated[-1] == pytest.approx(known.dissipated[-1], rel=1e-5) and known.dissipated[-1] > 0.1


def test_a_trajectory_carries_energies_and_elements(box: CheckedModel, tmp_path: object) -> None:
    elements = [Spring("box", to=(0, 0, 2), stiffness=200.0, rest=0.8), Damper("box", to=(0, 0, 2), damping=5.0)]
    run = rbd.simulate(swinging(box), external=elements, duration=0.2, step=1e-2)
    assert run.elements == tuple(elements)
    assert run.energy == pytest.approx(run.kinetic + run.potential + run.elastic, abs=0.0)
    assert run.elastic[3] == elements[0].energy(run.state(3)) == run[3].elastic and run[3].dissipated == run.dissipated[3]
    assert np.array_equal(run[5:9].elastic, run.elastic[5:9]) and run[5:9].elements == run.elements
    for name in ("run.npz", "run.nc"):
        run.save(tmp_path / name)  # type: ignore[operator]
        back = rbd.Trajectory.load(tmp_path / name, box)  # type: ignore[operator]
        assert np.array_equal(back.elastic, run.elastic) and np.array_equal(back.dissipated, run.dissipated)
    assert "in springs" in str(run) and f"taken by dampers {run.dissipated[-1]:.4g} J" in str(run)
    assert run.to_xarray().elastic.attrs["units"] == "J"
    plain = rbd.simulate(swinging(box), duration=0.1, step=1e-2)
    assert "spring" not in str(plain) and "damper" not in str(plain)
    assert not replace(plain, elastic=np.zeros(0)).elastic.any()


@pytest.mark.parametrize(("damping", "least", "most"), [(40.0, 1.9, 2.1), (4e4, 1.0, 1.75)])
def test_on_a_stiff_damper_the_order_is_below_two(damping: float, least: float, most: float) -> None:
    """A slider of 2 kg with a pendulum: where h d / m is 20 and more its creep is of order one to 1.75."""
    model = pin.Model()
    slider = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "slider")
    turns = model.addJoint(slider, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(slider, pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    model.appendBodyToJoint(turns, pin.Inertia(1.0, np.array([0.5, 0, 0]), 0.1 * np.eye(3)), pin.SE3.Identity())
    start = rbd.State(CheckedModel(model, name="governor"), [0.0, 0.3], [0.0, 4.0])
    elements = [JointSpring("slider", stiffness=1e3, rest=0.0), JointDamping({"slider": damping})]

    def creep(h: float) -> float:
        return float(rbd.simulate(start, external=elements, duration=0.48, step=h, integrator=STEPS).q[-1, 0])

    true, (one, two) = creep(2.5e-5), (creep(h) for h in (2e-3, 1e-3))
    order = np.log2(abs(one - true) / abs(two - true))
    assert least < order < most
    assert abs(two - true) < 1e-5
