"""Linear equations of small motion: against published eigenvalues, closed forms, and the true motion."""

from __future__ import annotations

import math
import pickle
import warnings

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
from bicycle_benchmark import AT_5, published, tyres, upright, whipple
from flat_bodies import free_body, pendulum

import rbd
from rbd.arrays import Array

DOWN = -0.5 * math.pi


def nearest(found: Array, wanted: complex) -> float:
    """Distance from a number to the nearest eigenvalue."""
    return float(np.abs(np.asarray(found) - wanted).min())


def test_the_bicycle_has_the_published_weave_and_capsize_at_five_metres_a_second():
    """Meijaard and others (2007), table 2, to 1e-9; the other directions are symmetries, and the speed stays as it is."""
    small = rbd.linearise(upright(whipple(), 5.0), tyres())
    for wanted in (*AT_5, np.conj(AT_5[1])):
        assert nearest(small.eigenvalues, wanted) < 1e-9
    assert len(small.eigenvalues) == 5 and nearest(small.eigenvalues, 0.0) < 1e-9
    assert (len(small.positions), len(small.velocities), small.symmetries.shape) == (7, 3, (9, 5))
    assert (small.space.rank_q, small.space.rank_v, small.space.m) == (2, 6, 6)
    assert small.stable and small.verdict.startswith("Stable: all modes decay but the neutral ones; 1 eigenvalue is zero")
    weave = next(mode for mode in small.modes() if mode.frequency)
    assert weave.title.startswith("steer ") and weave.words == "oscillates and decays"
    assert abs(weave.damping_ratio - 0.775341882195845 / abs(AT_5[1])) < 1e-9
    assert max(small.invariance, small.difference, small.variation) < 1e-9 and small.acceleration < 1e-12


@pytest.mark.parametrize("speed", [0.0, 1.0, 4.0, 4.6, 7.0, 10.0])
def test_the_bicycle_follows_the_published_matrices_at_every_speed(speed: float):
    """All four eigenvalues of M, C1, K0, K2; it is stable from 4.292 to 6.024 m/s only."""
    small = rbd.linearise(upright(whipple(), speed), tyres())
    for wanted in published(speed):
        assert nearest(small.eigenvalues, wanted) < 1e-9
    assert small.stable == (4.292 < speed < 6.024)


def test_the_bicycles_small_motion_is_that_of_the_true_simulation():
    """exp(A t) x against DormandPrince8 about the moving base: what differs is of the second order."""
    state, wheels, t = upright(whipple(), 5.0), tyres(), 0.3
    small = rbd.linearise(state, wheels)
    x = np.zeros(small.n)
    roll, steer = small.positions.index("root_joint.wx"), small.positions.index("steer")
    off = []
    for size in (2e-3, 1e-3):
        x[roll], x[steer] = size, -0.5 * size
        moved = rbd.mechanism.project_velocity(_assembled(small, x), wheels)
        start = _coordinates(small, state, moved)
        way = rbd.simulate(moved, wheels, duration=t, step=0.01, integrator=rbd.DormandPrince8(), progress=False)
        end = _coordinates(small, _carried(state, t), rbd.State(state.robot, way.q[-1], way.v[-1]))
        off.append(np.abs(end - scipy.linalg.expm(small.A * t) @ start).max())
    assert off[0] < 2e-5 and 3.5 < off[0] / off[1] < 9.0


def _assembled(small: rbd.mechanism.small_motion.Linearised, x: Array) -> rbd.State:
    """A state x away, put back onto the wheels' ground."""
    near = small.changed(x)
    return rbd.State(near.robot, rbd.mechanism.assemble(near, tyres()).q, near.v)


def _carried(state: rbd.State, t: float) -> rbd.State:
    return rbd.State(state.robot, pin.integrate(state.robot.model, state.q, t * state.v), state.v)


def _coordinates(small: rbd.mechanism.small_motion.Linearised, about: rbd.State, state: rbd.State) -> Array:
    """The x of a state, about one of the steady motion."""
    names = [c.name for c in state.robot.joints.velocities]
    dq, dv = pin.difference(state.robot.model, about.q, state.q), state.v - about.v
    return np.array([*(dq[names.index(n)] for n in small.positions), *(dv[names.index(n)] for n in small.velocities)])


@pytest.mark.parametrize(
    ("bodies", "squares"),
    [
        ("points", (2.0 - math.sqrt(2.0), 2.0 + math.sqrt(2.0))),
        ("rods", (3.0 - 6.0 / math.sqrt(7.0), 3.0 + 6.0 / math.sqrt(7.0))),
    ],
)
def test_double_pendula_swing_at_the_closed_form(bodies: str, squares: tuple[float, float]):
    """w^2 = (2 -/+ sqrt 2) g / L of points, (3 -/+ 6 / sqrt 7) g / L of uniform rods; upside down they fall at as much."""
    length = 0.7
    chain = rbd.planar.Chain(2, lengths=[length, length], angles="vertical")
    double = rbd.planar.to_robot(chain, bodies=bodies, masses=[1.3, 1.3])
    modes = rbd.linearise(double.at([DOWN, 0.0])).modes()
    found = sorted((2.0 * math.pi * mode.frequency) ** 2 for mode in modes)
    assert np.allclose(found, [s * 9.81 / length for s in squares], rtol=1e-11)
    assert all(np.isrealobj(mode.dq) and abs(mode.damping_ratio) < 1e-12 for mode in modes)
    slow = min(modes, key=lambda mode: mode.frequency)
    if bodies == "points":
        assert abs(slow.dq[1] / slow.dq[0] - (math.sqrt(2.0) - 1.0)) < 1e-10  # absolute angles 1 and sqrt 2
    over = rbd.linearise(double.at([-DOWN, 0.0]))
    assert np.allclose(sorted(over.eigenvalues.real**2), sorted(2 * [s * 9.81 / length for s in squares]), rtol=1e-11)
    assert over.stable is False and over.verdict.startswith("Unstable: 2 modes grow")


def test_damping_makes_a_pendulum_decay_as_its_formula_says():
    """It is lambda = -d / (2 m L^2) +/- ...: an external element's derivatives are in A."""
    bob, mass, length, d = pendulum(2.0, 0.5), 2.0, 0.5, 0.3
    element = rbd.constraints.forces.JointDamping({"hinge": d})
    small = rbd.linearise(rbd.State(bob, np.zeros(1)), [], external=[element])
    (mode,) = small.modes()
    decay = d / (2.0 * mass * length**2)
    assert abs(mode.eigenvalue - (-decay + 1j * math.sqrt(9.81 / length - decay**2))) < 1e-10
    assert small.stable and abs(mode.time_constant - 1.0 / decay) < 1e-9 and small.difference < 1e-9


def test_a_four_bar_hangs_and_swings_as_its_energy_says():
    """w^2 = V'' / m along its one freedom, V and the kinetic energy by the robot's terms at assembled poses nearby."""
    bars = rbd.mechanism.four_bar(4.0, 4.0, 4.0, 2.0, masses=(20.0, 20.0, 20.0), crank_angle=-1.9)
    found = rbd.find_equilibrium(bars.at("crossed"))
    angles = {name: math.degrees(angle) for name, angle in rbd.mechanism.link_angles(found.state).items()}
    assert found.acceleration < 1e-10 and abs(angles["coupler"]) < 1e-9
    assert abs(angles["crank"] + 104.4775) < 1e-4 and abs(angles["rocker"] + 75.5225) < 1e-4  # as Drake's example
    (mode,) = found.linearised.modes()

    def height(angle: float) -> float:
        fixed = {"crank_joint": bars.joints["crank_joint"].coordinate(found.state.q) + angle}
        q = rbd.mechanism.assemble(found.state, fixed=fixed).q
        return 60.0 * 9.81 * float(rbd.State(bars, q).com[2])

    h = 1e-3
    stiffness = (-height(2 * h) + 16 * height(h) - 30 * height(0.0) + 16 * height(-h) - height(-2 * h)) / (12 * h * h)
    along = mode.dq / mode.dq[bars.joints["crank_joint"].v]
    inertia = float(along.real @ found.state.M @ along.real)
    assert abs((2.0 * math.pi * mode.frequency) ** 2 / (stiffness / inertia) - 1.0) < 1e-6


def test_redundant_rows_change_nothing_and_their_rank_is_said():
    """A planar loop closed by three point rows: the third is zero."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    found = rbd.find_equilibrium(bars.at("assembled"))
    frame_a, frame_b = bars.loops()[0].frames
    point = rbd.LoopClosure("pin", frame_a, frame_b, kind="point")
    small = rbd.linearise(found.state, [point], loops=False)
    assert (small.space.m, small.space.rank_q, small.n) == (3, 2, 2)
    assert np.allclose(np.sort(small.eigenvalues), np.sort(found.linearised.eigenvalues), rtol=1e-9)


def test_talos_on_held_feet_by_derivatives_and_by_differences():
    """At its hold torques: A by derivatives() against differences of the true motion, entry by entry, and the eigenvalues."""
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=None)
    tau = rbd.hold(state, soles).tau
    small = rbd.linearise(state, soles, tau)
    again = rbd.linearise(state, soles, tau, differences=True)
    assert small.method == "derivatives" and again.method.startswith("differences")
    with pytest.warns(rbd.errors.NotSteadyWarning, match="accelerates by up to 6"):
        assert rbd.linearise(state, soles).verdict.startswith("Not a steady state")
    size = np.abs(small.A).max()
    assert np.abs(small.A - again.A).max() < 1e-9 * size and np.abs(small.B - again.B).max() < 1e-9 * np.abs(small.B).max()
    assert (small.n, small.space.rank_q, small.controllable) == (52, 12, 52)
    assert max(small.invariance, small.difference) < 1e-9 and small.acceleration < 1e-9
    assert max(nearest(again.eigenvalues, value) for value in small.eigenvalues) < 1e-6
    sticking = rbd.linearise(state, talos.soles(), tau)  # the same, as nothing slips
    assert np.abs(sticking.A - small.A).max() < 1e-9 * size
    assert set(sum(sticking.modes_of_contacts.values(), ())) == {"sticks"}
    assert small.stable is False and len(small.modes()[0].shares) > 5


def test_a_spinning_body_tumbles_about_its_middle_axis():
    """Euler: lambda^2 = w^2 (I2 - I1)(I3 - I2) / (I1 I3) about the middle axis, grows; about the others it oscillates."""
    moments, rate = np.array([1.0, 2.0, 3.5]), 4.0
    body = free_body(3.0, moments)
    weightless = rbd.ExternalForce("body", (0.0, 0.0, 3.0 * 9.81))
    for axis in range(3):
        v = np.zeros(6)
        v[3 + axis] = rate
        small = rbd.linearise(rbd.State(body, pin.neutral(body.model), v), [], external=[weightless])
        I, J, K = moments[axis], *np.delete(moments, axis)
        square = rate**2 * (I - J) * (K - I) / (J * K)
        found = np.abs(small.eigenvalues**2 - square)
        assert np.sort(found)[1] < 1e-9
        assert small.stable is (False if axis == 1 else None)
        assert small.difference < 1e-9 and small.variation < 1e-12


def test_chaplygins_sleigh_is_stable_with_its_mass_ahead_of_the_blade():
    """The sleigh turns back at lambda = -m a u / (I + m a^2); backwards it turns round."""
    sleigh = rbd.load_robot("chaplygin_sleigh")
    mass, inertia, a, u = 5.0, 0.4, 0.3, 2.0
    wanted = -mass * a * u / (inertia + mass * a**2)
    for sign in (1.0, -1.0):
        small = rbd.linearise(sleigh.at(None, [sign * u, 0.0, 0.0]))
        assert nearest(small.eigenvalues, sign * wanted) < 1e-12 and nearest(small.eigenvalues, 0.0) < 1e-12
        assert (small.stable is True) == (sign > 0.0)
        assert (small.space.rank_q, small.space.rank_v) == (0, 1)


def test_a_rolling_coin_wobbles_at_the_closed_form_and_falls_below_the_critical_speed():
    """lambda^2 = 4 g / (5 r) (1 - v^2 / v_c^2), v_c = sqrt(g r / 3), though the coin's own axes turn with it."""
    coin = rbd.load_robot("rolling_disk")
    r = coin.wheels()[0].radius
    for part in (0.6, 1.5):
        speed = part * math.sqrt(9.81 * r / 3.0)
        small = rbd.linearise(coin.at("upright", [speed, 0.0, 0.0, 0.0, speed / r, 0.0]))
        square = 4.0 * 9.81 / (5.0 * r) * (1.0 - part**2)
        assert np.sort(np.abs(small.eigenvalues**2 - square))[1] < 1e-8
        assert small.stable is (False if part < 1.0 else None)
        assert small.symmetries.shape == (6, 4) and max(small.difference, small.variation, small.invariance) < 1e-9
        assert abs(small.spin[4] - speed / r) < 1e-12


def test_motors_that_do_not_reach_a_mode_are_said():
    """Two pendula side by side, one motor: it reaches two of four dimensions, and moves one of two modes."""
    model = pin.Model()
    for name, length in (("driven", 1.0), ("free", 0.5)):
        at = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(at, pin.Inertia(1.0, np.array([0.0, 0.0, -length]), np.zeros((3, 3))), pin.SE3.Identity())
    pair = rbd.model.checked_model.CheckedModel(model, passive=("free",), name="pair")
    small = rbd.linearise(rbd.State(pair, np.zeros(2)), [])
    assert small.controllable == 2 and small.B.shape == (4, 1)
    assert {mode.title: mode.motors_move_it for mode in small.modes()} == {"driven 100 %": True, "free 100 %": False}
    assert "no motor changes it" in str(small) and "1 motor reaches 2 of 4 dimensions" in str(small)


def test_a_rest_on_a_belt_and_moving_bases_are_not_taken_for_equilibria():
    """What accelerates gets a warning with the size, and so does a motion along which A changes."""
    bob = pendulum(1.0, 1.0)
    with pytest.warns(rbd.errors.NotSteadyWarning, match=r"no equilibrium: it accelerates by up to 4.7"):
        small = rbd.linearise(rbd.State(bob, [0.5]), [])
    assert str(small).startswith("Not a steady state: it accelerates by up to 4.7") and small.difference < 1e-9
    for ask in (small.modes, lambda: small.stable):
        with pytest.raises(rbd.errors.Unsupported, match="Not a steady state"):
            ask()
    with pytest.warns(rbd.errors.NotSteadyWarning, match=r"flat_body .* no steady motion"):
        from flat_bodies import flat_body

        rbd.linearise(rbd.State(flat_body(1.0, 1.0), np.zeros(3), [1.0, 0.0, 0.0]), [])


def test_what_slips_or_is_off_its_constraints_is_refused_by_name():
    """A contact mode that changes has no linear law; a state off its rows is no base point."""
    box = rbd.testing.box(mass=2.0)
    corner = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.3)
    pushed = rbd.ExternalForce("box", (20.0, 0.0, 0.0))
    state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    with pytest.raises(rbd.errors.Unsupported, match=r"'floor' slips at this state"):
        rbd.linearise(state, [corner], external=[pushed])
    with pytest.raises(rbd.errors.Unsupported, match=r"'floor' opens"):
        rbd.linearise(state, [corner], external=[rbd.ExternalForce("box", (0.0, 0.0, 40.0))])
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    with pytest.raises(rbd.InputError, match=r"row 0 of 'coupler_pin' is off by 0.478 .* rbd.mechanism.assemble"):
        rbd.linearise(bars.at([1.0, 0.1, 1.0, 0.0, 1.0, 0.0] / np.sqrt([1.01, 1.01, 1, 1, 1, 1])), bars.loops())
    with pytest.raises(rbd.InputError, match=r"moves at .*project_velocity"):
        rbd.linearise(upright(whipple(), 5.0).with_velocity(np.eye(9)[0]), tyres())
    with pytest.raises(rbd.InputError, match=r"tau of box has shape \(3,\)"):
        rbd.linearise(state, [], [0.0, 0.0, 0.0])


def test_records_travel_and_changed_states_are_those_of_x():
    """A pickle has the same modes; x moves the coordinates that it names."""
    small = rbd.linearise(upright(whipple(), 5.0), tyres())
    again = pickle.loads(pickle.dumps(small))
    assert np.array_equal(again.eigenvalues, small.eigenvalues)
    x = 1e-3 * np.eye(small.n)[small.positions.index("steer")]
    moved = small.changed(x)
    assert abs(moved.robot.joints["steer"].coordinate(moved.q) - 1e-3) < 1e-12
    with pytest.raises(rbd.InputError, match=r"x has shape \(3,\)"):
        small.changed([1.0, 2.0, 3.0])
    mode = small.modes()[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        later = mode.at(0.2, 1e-3)
    assert np.abs(later.v[0] - 5.0) < 1e-2


def test_a_mode_draws_itself(tmp_path):
    """`mode.scene`, `mode.plot` and `mode.export` are those of `rbd.visual`."""
    from matplotlib.figure import Figure

    mode = rbd.find_equilibrium(rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5).at("assembled")).linearised.modes()[0]
    bars = mode.plot(Figure().add_subplot())
    assert len(bars) >= 3 and max(abs(bar.get_width()) + abs(bar.get_height()) for bar in bars) > 0.0
    assert any(mark.path for mark in mode.scene().drawn)
    assert "Hz" in mode.export(tmp_path / "mode.html").read_text(encoding="utf-8")
