"""The momentum observer: the low-pass of the contact force that it says, at steps, sinusoids, impacts and noise."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

import rbd
from rbd.motion import MomentumObserver, SensorNoise

PUSH_N = 10.0
HAND = "panda_hand"


@pytest.fixture(scope="module")
def arm() -> rbd.Robot:
    return rbd.load_robot("panda", root="fixed")


@pytest.fixture(scope="module")
def box() -> rbd.Robot:
    return rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")


def pushed(arm: rbd.Robot, external: object, duration: float, step: float) -> rbd.Trajectory:
    """The arm, its posture held by its motors, pushed at its hand."""
    hold = rbd.control.HoldPosture(arm.at(), frequency=30.0)
    return rbd.simulate(
        arm.at(), duration=duration, step=step, controller=hold, external=external,
        integrator=rbd.DormandPrince8(), progress=False,
    )  # fmt: skip


def hand_force(arm: rbd.Robot, motion: rbd.Trajectory, bandwidth: float) -> np.ndarray:
    """What the observer says of the force on the hand, shape (n, 3)."""
    observer = MomentumObserver(arm, [rbd.PointContact("hand", HAND)], bandwidth=bandwidth)
    return observer.run(motion, motion.tau).forces["hand"]


@pytest.fixture(scope="module")
def step(arm: rbd.Robot) -> rbd.Trajectory:
    """Pushed along y from 0.05 s on."""
    pushes = rbd.control.Pushes([rbd.control.Push(HAND, (0.0, PUSH_N, 0.0), start=0.05, duration=1.0)])
    return pushed(arm, pushes, 0.12, 5e-4)


@pytest.mark.parametrize("bandwidth", [20.0, 50.0, 100.0])
def test_a_step_is_seen_as_one_minus_exp(arm: rbd.Robot, step: rbd.Trajectory, bandwidth: float):
    """To 1e-3 of the step, at all times; K = 2 pi bandwidth."""
    seen = hand_force(arm, step, bandwidth)
    since = np.maximum(step.t - 0.05, 0.0)
    expected = PUSH_N * (1.0 - np.exp(-2.0 * math.pi * bandwidth * since))
    assert np.abs(seen[:, 1] - expected).max() < 1e-4 * PUSH_N
    assert np.abs(seen[:, [0, 2]]).max() < 1e-3 * PUSH_N  # it turns a little within 1 / K
    assert np.abs(seen[:, 1] - np.roll(expected, 1)).max() > 0.01 * PUSH_N  # half a millisecond of delay would not pass


def test_a_constant_force_is_exact_while_the_robot_moves(arm: rbd.Robot):
    """Without a controller the push drives the hand away, at 0.7 m/s in the end: J changes, and the force does not.

    J goes through the low-pass with r; with the J of now the error would be a thousand times as large.
    """
    gravity = -rbd.dynamics.gravity_torque(arm.at())
    push = rbd.ExternalForce(HAND, (0.0, PUSH_N, 0.0))
    motion = rbd.simulate(
        arm.at(), duration=0.3, step=5e-4, controller=lambda state, t: gravity, external=push,
        integrator=rbd.DormandPrince8(), progress=False,
    )  # fmt: skip
    before, last = motion.at(motion.t[-1] - 1.0 / (2.0 * math.pi * 25.0)).frame(HAND), motion.state(-1).frame(HAND)
    assert np.linalg.norm(last.v[:3]) > 0.7 and np.abs(last.J - before.J).max() > 0.02
    seen = hand_force(arm, motion, 25.0)
    assert np.abs(seen[-60:] - [0.0, PUSH_N, 0.0]).max() < 1e-5 * PUSH_N


@pytest.mark.parametrize("frequency", [5.0, 20.0, 60.0])
def test_a_sinusoid_is_smaller_and_later_as_a_first_order_low_pass_says(arm: rbd.Robot, frequency: float):
    """Half the power at the bandwidth, 45 degrees late: amplitude and phase of the force found, to 2e-3."""
    bandwidth, turn = 20.0, 2.0 * math.pi * frequency

    def sway(state: rbd.State, t: float) -> rbd.ExternalForce:
        return rbd.ExternalForce(HAND, (0.0, PUSH_N * math.sin(turn * t), 0.0))

    motion = pushed(arm, sway, 0.06 + 1.0 / frequency, 2.5e-4)
    seen = hand_force(arm, motion, bandwidth)[:, 1]
    late = motion.t > 0.06  # seven time constants: the start is forgotten to 5e-4
    waves = np.column_stack([np.sin(turn * motion.t), np.cos(turn * motion.t), np.ones(len(motion))])
    sine, cosine, mean = np.linalg.lstsq(waves[late], seen[late], rcond=None)[0] / PUSH_N
    ratio = frequency / bandwidth
    assert math.hypot(sine, cosine) == pytest.approx(1.0 / math.sqrt(1.0 + ratio**2), abs=2e-3)
    assert math.atan2(-cosine, sine) == pytest.approx(math.atan(ratio), abs=5e-3)
    assert abs(mean) < 2e-3


def test_the_soles_of_a_pushed_g1_are_the_low_pass_of_the_true_forces(g1: rbd.Robot):
    """Twelve force components, filtered as said from the recorded ones; without torques their sum."""
    state, soles, bandwidth, h = g1.standing(), g1.soles(0.7), 15.0, 1e-3
    push = rbd.control.Pushes([rbd.control.Push("torso_link", (0.0, 25.0, 0.0), start=0.05, duration=0.1)])
    motion = rbd.simulate(
        state, soles, duration=0.25, step=h, controller=rbd.control.HoldPosture(state, soles), external=push, progress=False
    )
    torso = rbd.PointContact("torso", "torso_link")
    observer = MomentumObserver(g1, [*soles, torso], bandwidth=bandwidth)
    seen = observer.run(motion, motion.tau)
    kept = math.exp(-2.0 * math.pi * bandwidth * h)
    acting = ((motion.t >= 0.05 - 1e-9) & (motion.t < 0.15 - 1e-9)).astype(float)
    true = {**motion.forces, "torso": acting[:, None] * np.array([0.0, 25.0, 0.0])}
    weight = float(np.linalg.norm(g1.weight))
    for name, force in true.items():
        # The mean force of a step goes through the low-pass; samples are at its ends.
        between = 0.5 * (force[1:] + force[:-1]) if name != "torso" else force[:-1]
        filtered = lfilter([1.0 - kept], [1.0, -kept], between - force[0], axis=0) + force[0]
        off = np.abs(seen.forces[name][1:] - filtered).max(axis=0)
        assert off[:3].max() < 1e-3 * weight, name
        assert off[3:].max(initial=0.0) < 1e-4 * weight, name
    assert seen[0].degrees == g1.nv - 15 and not seen[0].open
    told = MomentumObserver(g1, soles, bandwidth=bandwidth, torques=False)
    alone = told.run(motion)
    both = MomentumObserver(g1, soles, bandwidth=bandwidth).run(motion, motion.tau)
    assert [str(x) for x in alone[0].open] == ["left_sole and right_sole: 6 internal components unknown"]
    assert np.abs(alone.net[:20] - both.net[:20]).max() < 1e-3 * weight  # until the push, which neither was told of


def test_any_step_is_stable_and_exact_for_a_constant_force(box: rbd.Robot):
    """A box that falls on a soft floor of constant force: samples ten time constants apart, and a hundredth of one."""
    floor = rbd.PointContact("floor", "box")
    g, m = float(np.linalg.norm(box.gravity)), box.mass
    lift = 0.4 * m * g
    for h in (1.0, 1e-3):
        observer = MomentumObserver(box, [floor], bandwidth=10.0 / (2.0 * math.pi), torques=False)
        assert observer.gain == pytest.approx(10.0)
        for k in range(6):
            v = np.zeros(6)
            v[2] = (lift / m - g) * k * h
            found = observer.update(k * h, rbd.State(box, box.neutral(), v))
            expected = lift + (m * g - lift) * math.exp(-10.0 * k * h)  # it starts as if it were at rest
            assert found.forces["floor"][2] == pytest.approx(expected, rel=1e-12)


def test_an_impact_is_seen_with_its_impulse(box: rbd.Robot):
    """The sum of r over time is the momentum that the floor gave, though the force has no finite value."""
    corners = [[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]
    placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    side = rbd.SurfaceContact("side", "box", corners=corners, placement=placement, friction=0.5, on=0.0)
    start = box.at(np.array([0.0, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0]))
    motion = rbd.simulate(start, [side], duration=0.3, step=1e-3, progress=False)
    touches = (motion.q[:, 2] < 0.1005)[:, None]  # half a millimetre from the floor
    observer = MomentumObserver(box, [side], bandwidth=50.0, torques=False)
    seen = observer.run(motion, touches=touches)
    g = float(np.linalg.norm(box.gravity))
    # From the first sample's r = m g, forgotten as exp(-K t), to the last: r = m g, its own impulse still within 1 / K.
    gain = observer.gain
    kept = math.exp(-gain * 1e-3)
    force = np.array([e.generalised[2] for e in seen.estimates])
    mean = (force[1:] - kept * force[:-1]) / (1.0 - kept)  # the low-pass undone
    given = float(mean.sum()) * 1e-3
    assert given == pytest.approx(box.mass * (motion.v[-1, 2] - motion.v[0, 2] + g * 0.3), rel=1e-9)
    assert force.max() > 10.0 * box.mass * g and force[-1] == pytest.approx(box.mass * g, rel=1e-3)


@pytest.mark.parametrize("held", [False, True])
def test_noise_of_velocity_and_torques_has_the_stated_variance(arm: rbd.Robot, held: bool):
    """Squared errors over the covariance have the mean of chi-square, 3; of 310 samples it is known to 5 % or so."""
    rng = np.random.default_rng(3)
    state, hand = arm.at(), rbd.PointContact("hand", HAND)
    s, tau, h = {"v": 1e-3, "tau": 0.2}, rbd.dynamics.gravity_torque(arm.at()), 2e-3
    for noise in (SensorNoise(v=s["v"]), SensorNoise(tau=s["tau"]), SensorNoise(**s)):
        observer = MomentumObserver(arm, [hand], bandwidth=20.0, held=held, noise=noise)
        found = []
        for k in range(1600):
            v = rng.normal(0.0, 1.0, arm.nv) * noise.of("v", arm.nv)
            given = -tau[arm.actuated] + rng.normal(0.0, 1.0, arm.nu) * noise.of("tau", arm.nu)
            estimate = observer.update(k * h, rbd.State(arm, state.q, v), given)
            if k > 50 and k % 5 == 0:  # independent but for exp(-K 5 h) = 0.28
                off = estimate.forces["hand"]
                found.append(off @ np.linalg.solve(estimate.covariance["hand"], off))
        assert np.mean(found) == pytest.approx(3.0, rel=0.17)


def test_torques_of_a_digital_controller_are_held_between_samples(arm: rbd.Robot):
    """Torques that jump at each sample: held they explain the motion; their means are a sample late, and look like a push."""
    rng, h = np.random.default_rng(4), 2e-3
    gravity = -rbd.dynamics.gravity_torque(arm.at())[arm.actuated]
    torques = gravity + rng.uniform(-0.02, 0.02, (60, arm.nu)) * arm.effort_limit
    script = rbd.control.TorqueSchedule(h * np.arange(60), torques, held=True)
    motion = rbd.simulate(arm.at(), duration=0.1, step=h, controller=script, integrator=rbd.DormandPrince8(), progress=False)
    seen = {}
    for held in (True, False):
        observer = MomentumObserver(arm, [rbd.PointContact("hand", HAND)], bandwidth=30.0, held=held)
        given = torques[: len(motion)]
        seen[held] = np.abs([e.generalised for e in observer.run(motion, given).estimates][20:]).max()
    assert seen[True] < 0.02 and seen[False] > 10.0 * seen[True]


def test_it_counts_known_forces_and_other_contacts(box: rbd.Robot):
    """A known push is no contact force; contacts may be given anew at each sample; `reset` forgets."""
    floor = rbd.PointContact("floor", "box")
    observer = MomentumObserver(box, [floor], bandwidth=5.0, torques=False)
    up = rbd.ExternalForce("box", (0.0, 0.0, 3.0))
    weight = float(np.linalg.norm(box.weight))
    for t in (0.0, 0.1):
        found = observer.update(t, box.at(), external=up)
        assert found.forces["floor"][2] == pytest.approx(weight - 3.0)
    found = observer.update(0.2, box.at(), contacts=[], external=up)
    assert not found.forces and found.residual[2] == pytest.approx(weight - 3.0)
    assert observer.force[2] == pytest.approx(weight - 3.0)
    observer.reset()
    assert not observer.force.any()
    assert observer.update(0.0, box.at()).forces["floor"][2] == pytest.approx(weight)


def test_impossible_input_is_refused(arm: rbd.Robot, box: rbd.Robot):
    """Each with what came and what was expected."""
    hand = rbd.PointContact("hand", HAND)
    with pytest.raises(rbd.InputError, match="bandwidth is 0"):
        MomentumObserver(arm, [hand], bandwidth=0.0)
    with pytest.raises(rbd.InputError, match="every coordinate of panda has a motor"):
        MomentumObserver(arm, [hand], bandwidth=5.0, torques=False)
    with pytest.raises(rbd.InputError, match="noise of v and tau only"):
        MomentumObserver(arm, [hand], bandwidth=5.0, noise=SensorNoise(q=1e-4))
    with pytest.raises(rbd.errors.FrameNotFound, match="panda_hnd"):
        MomentumObserver(arm, [rbd.PointContact("hand", "panda_hnd")], bandwidth=5.0)
    with pytest.raises(rbd.InputError, match="expected True or False"):
        MomentumObserver(arm, [hand], bandwidth=5.0, held="yes")
    with pytest.raises(rbd.InputError, match="expected a robot"):
        MomentumObserver("panda", [hand], bandwidth=5.0)
    observer = MomentumObserver(arm, [hand], bandwidth=5.0)
    with pytest.raises(rbd.InputError, match="made with torques=True"):
        observer.update(0.0, arm.at())
    with pytest.raises(rbd.InputError, match="got a state of box"):
        observer.update(0.0, box.at(), [])
    observer.update(1.0, arm.at(), np.zeros(arm.nu))
    for t in (1.0, 0.5, math.nan, "now"):
        with pytest.raises(rbd.InputError, match="expected a time after"):
            observer.update(t, arm.at(), np.zeros(arm.nu))
