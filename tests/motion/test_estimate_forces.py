"""Contact forces from measured q, v, a and torques: the true ones without noise, within their covariance with it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy import stats

import rbd
from rbd.arrays import add_wrench
from rbd.motion import ForceEstimate, SensorNoise, estimate_forces, estimate_forces_along
from rbd.problem.cones import project_cones

PUSH = (0.0, 25.0, 0.0)
EXACT = 1e-9
"""Of the body weight: without noise the forces are those of the simulation."""
DRAWS = 300


@pytest.fixture(scope="module")
def box() -> rbd.Robot:
    return rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")


@pytest.fixture(scope="module")
def pushed(g1: rbd.Robot) -> rbd.Trajectory:
    """G1 on its feet, its posture held by its motors, pushed to the left from 0.05 s on."""
    state, soles = g1.standing(), g1.soles(0.7)
    push = rbd.control.Push("torso_link", PUSH, start=0.05, duration=1.0)
    hold = rbd.control.HoldPosture(state, soles)
    pushes = rbd.control.Pushes([push])
    return rbd.simulate(
        state, soles, duration=0.2, step=1e-3, controller=hold, external=pushes, record_every=20, progress=False
    )


def frames(motion: rbd.Trajectory) -> Iterator[tuple[int, rbd.State, rbd.ExternalForce | None]]:
    """(number, state, push) of the samples."""
    for i, t in enumerate(motion.t):
        yield i, motion.state(i), rbd.ExternalForce("torso_link", PUSH) if t >= 0.05 - 1e-9 else None


def true_net(motion: rbd.Trajectory, i: int, estimate: ForceEstimate) -> np.ndarray:
    """The wrench of the simulation's forces about the centre of mass."""
    total = [0.0] * 6
    for r in estimate.rows:
        add_wrench(total, motion.forces[r.name][i].tolist(), r.patch.point.tolist(), estimate.state.com.tolist())
    return np.array(total)


def test_with_torques_the_force_of_each_sole_is_that_of_the_simulation(g1: rbd.Robot, pushed: rbd.Trajectory):
    """Two feet on the ground: twelve unknowns, thirty-five equations, and nothing is left of them."""
    unit = float(np.linalg.norm(g1.weight))
    for i, state, push in frames(pushed):
        found = rbd.estimate_forces(state, pushed.a[i], g1.soles(0.7), pushed.tau[i], external=push)
        for name, force in pushed.forces.items():
            assert np.abs(found.forces[name] - force[i]).max() < EXACT * unit
        assert np.abs(found.residual).max() < EXACT * unit and not found.open and found.fit.least_norm
        assert found.degrees == g1.nv - 12


def test_without_torques_the_net_force_is_that_of_the_simulation(g1: rbd.Robot, pushed: rbd.Trajectory):
    """Six equations for two wrenches: their sum is known, six internal components are not, and it says so."""
    unit = float(np.linalg.norm(g1.weight))
    noise = SensorNoise(a=0.1)
    for i, state, push in frames(pushed):
        found = rbd.estimate_forces(state, pushed.a[i], g1.soles(0.7), external=push)
        assert np.abs(found.net - true_net(pushed, i, found)).max() < EXACT * unit
        assert [str(x) for x in found.open] == ["left_sole and right_sole: 6 internal components unknown"]
        J = np.concatenate([r.J for r in found.rows])
        assert found.unknown.shape == (12, 6) and np.abs(J.T[:6] @ found.unknown).max() < 1e-9 * np.abs(found.unknown).max()
    noisy = rbd.estimate_forces(state, pushed.a[i], g1.soles(0.7), external=push, noise=noise)
    assert all(np.isinf(s).all() for s in noisy.deviations.values()) and np.isfinite(noisy.net_covariance).all()
    # The torques told are those that go with the motion and these forces.
    back = state.M @ pushed.a[i] + state.h - sum(r.J.T @ found.row_forces[found.slices[r.name]] for r in found.rows)
    moved = back - rbd.dynamics.generalised(state, push)[0]
    assert np.abs(moved[g1.actuated] - found.tau).max() < 1e-9 * unit and np.abs(moved[:6]).max() < 1e-9 * unit


def test_one_foot_is_known_without_torques(g1: rbd.Robot, rng: np.random.Generator):
    """Where one sole carries, its wrench follows from the motion alone, at any velocity that it allows."""
    sole = g1.soles(friction=None)[0]
    unit = float(np.linalg.norm(g1.weight))
    for _ in range(5):
        q = pin.integrate(g1.model, g1.standing().q, rng.uniform(-0.2, 0.2, g1.nv) * (np.arange(g1.nv) > 5))
        state = rbd.State(g1, q, rng.uniform(-0.5, 0.5, g1.nv))
        loose = rbd.SurfaceContact("left_sole", sole.frame, corners=sole.corners, placement=sole.placement)
        true = rbd.solve(state, rng.uniform(-4.0, 4.0, g1.nu), [loose])
        found = rbd.estimate_forces(state, true.a, [loose])
        assert np.abs(found.forces["left_sole"] - true.forces["left_sole"]).max() < EXACT * max(
            unit, np.abs(true.forces["left_sole"]).max()
        )
        assert not found.open and np.abs(found.residual).max() < EXACT * unit


def test_points_joints_and_loops_are_explained_too(rng: np.random.Generator):
    """Solo12 on four points with torques; a four-bar's loop, whose joints but one have no motor."""
    solo = rbd.load_robot("solo12")
    state, feet = solo.standing(), solo.feet(0.7)
    tau = rbd.hold(state, feet).tau + rng.uniform(-0.05, 0.05, solo.nu)
    true = rbd.solve(state, tau, feet)
    found = rbd.estimate_forces(state, true.a, feet, tau)
    for name, force in true.forces.items():
        assert np.abs(found.forces[name] - force).max() < 1e-9 * np.linalg.norm(solo.weight)
    assert not found.open
    alone = rbd.estimate_forces(state, true.a, feet)
    assert [x.count for x in alone.open] == [6] and set(alone.open[0].names) == {c.name for c in feet}
    bar = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    linked = bar.at("assembled")
    given = rng.uniform(-1.0, 1.0, bar.nu)
    moved = rbd.solve(linked, given, bar.loops())
    estimate = rbd.estimate_forces(linked, moved.a, bar.loops(), given)
    explained = sum(r.J.T @ estimate.row_forces[estimate.slices[r.name]] for r in estimate.rows)
    assert np.abs(explained - moved.problem.J.T @ moved.multipliers).max() < 1e-9
    assert bool(estimate.open) == (moved.rank < moved.problem.m)


def test_the_forces_stay_in_their_cones_and_fit_best(g1: rbd.Robot, rng: np.random.Generator):
    """On slippery ground, from motions that no friction allows: the gradient of the squares is in the normal cone."""
    state, soles = g1.standing(), g1.soles(0.2)
    unit = float(np.linalg.norm(g1.weight))
    active = 0
    for torques in (True, False):
        for _ in range(6):
            a = rng.normal(0.0, 3.0, g1.nv)
            tau = rng.uniform(-10.0, 10.0, g1.nu) if torques else None
            found = rbd.estimate_forces(state, a, soles, tau)
            rows = found.rows
            scale = rbd.motion.sensor_noise.force_scale(state)
            assert scale[:3] == pytest.approx(unit) and (scale[g1.actuated] == g1.effort_limit).all()
            W = found.measured / scale
            need = state.M @ a + state.h
            if tau is not None:
                need[g1.actuated] -= tau
            w = [found.corner_forces[r.name] @ r.patch.axes for r in rows]  # contact axes
            left, slopes = need.copy(), []
            maps = []
            for r, corners in zip(rows, w, strict=True):
                lever = np.concatenate([np.vstack([np.eye(3), rbd.arrays.cross_matrix(c)]) for c in r.patch.corners], axis=1)
                maps.append(r.J.T @ lever)
                left -= maps[-1] @ corners.ravel()
            slopes = [-(m.T * W**2) @ left for m in maps]
            step = unit**2 / max(np.linalg.norm(W[:, None] * m * unit, 2) ** 2 for m in maps)
            for corners, slope in zip(w, slopes, strict=True):
                normal = corners[:, 2]
                assert (np.hypot(corners[:, 0], corners[:, 1]) <= 0.2 * normal + 1e-12 * unit).all()
                moved = project_cones(corners - step * slope.reshape(-1, 3), np.full(len(corners), 0.2))
                assert np.abs(moved - corners).max() < 1e-8 * unit
                active += int(np.abs(slope).max() * step > 1e-6 * unit)
            assert np.abs(np.where(found.measured, left, 0.0) - found.residual).max() < 1e-9 * unit
    assert active > 5


@pytest.fixture(scope="module")
def draws(g1: rbd.Robot, pushed: rbd.Trajectory) -> list[tuple[ForceEstimate, np.ndarray, np.ndarray]]:
    """Estimates from noisy sensors, with the true forces and net wrench."""
    rng = np.random.default_rng(5)
    s = {"q": 1e-4, "v": 2e-3, "a": 0.05, "tau": 0.3}
    noise, i = SensorNoise(**s), len(pushed) - 1
    push = rbd.ExternalForce("torso_link", PUSH)
    out = []
    for _ in range(DRAWS):
        q = pin.integrate(g1.model, pushed.q[i], rng.normal(0.0, s["q"], g1.nv))
        state = rbd.State(g1, q, pushed.v[i] + rng.normal(0.0, s["v"], g1.nv))
        a = pushed.a[i] + rng.normal(0.0, s["a"], g1.nv)
        tau = pushed.tau[i] + rng.normal(0.0, s["tau"], g1.nu)
        found = rbd.estimate_forces(state, a, g1.soles(0.7), tau, noise=noise, external=push)
        true = np.concatenate([pushed.forces[name][i] for name in found.slices])
        out.append((found, true, true_net(pushed, i, found)))
        assert not found.open
    return out


def of_all(found: ForceEstimate) -> tuple[np.ndarray, np.ndarray]:
    """(forces, covariance) of both soles in world axes, stacked."""
    R = rbd.arrays.block_diagonal([r.resultant for r in found.rows])
    return R @ found.row_forces, R @ found.row_covariance @ R.T


def test_with_noise_the_errors_are_within_the_stated_covariance(draws):
    """Squared errors over the covariance are chi-square with 12 degrees of freedom; of the net wrench, and of one sole, with 6.

    Their mean over 300 draws is known to 2.4 % (3.3 % of 6): a covariance that is 30 % off is refused, as the last line says.
    """
    both, net, left = [], [], []
    for found, true, true_wrench in draws:
        forces, C = of_all(found)
        off = forces - true
        both.append(off @ np.linalg.solve(C, off))
        off = found.net - true_wrench
        net.append(off @ np.linalg.solve(found.net_covariance, off))
        off = found.forces["left_sole"] - true[:6]
        left.append(off @ np.linalg.solve(found.covariance["left_sole"], off))
        assert np.allclose(found.deviations["left_sole"] ** 2, found.covariance["left_sole"].diagonal())
    for values, size in ((both, 12), (net, 6), (left, 6)):
        assert abs(np.mean(values) / size - 1.0) < 4.0 * np.sqrt(2.0 / size / DRAWS)
        assert stats.kstest(values, stats.chi2(size).cdf).pvalue > 1e-3
        assert stats.kstest(1.3 * np.array(values), stats.chi2(size).cdf).pvalue < 1e-3


def test_what_is_left_is_what_the_noise_explains(draws):
    """`chi_square` has the mean and the spread of its degrees of freedom: 35 equations less 12 forces."""
    values = [found.chi_square for found, _, _ in draws]
    assert {found.degrees for found, _, _ in draws} == {23}
    assert stats.kstest(values, stats.chi2(23).cdf).pvalue > 1e-3
    assert stats.kstest(1.2 * np.array(values), stats.chi2(23).cdf).pvalue < 1e-3


def test_a_wrong_model_shows_in_chi_square(g1: rbd.Robot, pushed: rbd.Trajectory):
    """A push that nobody told of leaves hundreds of times what the noise explains."""
    noise = SensorNoise(q=1e-4, v=2e-3, a=0.05, tau=0.3)
    i = len(pushed) - 1
    found = rbd.estimate_forces(pushed.state(i), pushed.a[i], g1.soles(0.7), pushed.tau[i], noise=noise)
    assert found.chi_square > stats.chi2(found.degrees).ppf(1.0 - 1e-9)


def test_a_limit_that_holds_the_estimate_back_has_no_spread(box: rbd.Robot):
    """A box that seems to be pulled down: nothing pulls, the force is zero, and its spread with the limit kept is zero."""
    floor = rbd.PointContact("floor", "box", friction=0.5)
    state = box.at()
    a = np.zeros(6)
    a[2] = -12.0
    found = rbd.estimate_forces(state, a, [floor], noise=SensorNoise(a=0.1))
    assert not found.forces["floor"].any() and not found.covariance["floor"].any()
    assert found.residual[2] == pytest.approx(box.mass * (rbd.dynamics.gravity_torque(state)[2] / -box.mass - 12.0))
    a[2], a[0] = 0.0, 8.0  # more friction than there is: on the edge of the cone, spread along it and across alone
    edge = rbd.estimate_forces(state, a, [floor], noise=SensorNoise(a=0.1))
    f = edge.forces["floor"]
    assert f[0] == pytest.approx(0.5 * f[2]) and edge.residual[0] > 1.0
    out_of_it = np.array([1.0, 0.0, -0.5])
    assert out_of_it @ edge.covariance["floor"] @ out_of_it == pytest.approx(0.0, abs=1e-12)
    assert edge.covariance["floor"][1, 1] == pytest.approx((0.1 * box.mass) ** 2, rel=1e-6)


def test_closed_forms_of_a_box(box: rbd.Robot):
    """At rest the floor carries the weight; in free fall nothing is left without a contact; held in the air its weight is."""
    corners = [[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]
    floor = rbd.SurfaceContact("floor", "box", corners=corners, friction=0.5)
    state, g = box.at(), float(np.linalg.norm(box.gravity))
    found = rbd.estimate_forces(state, np.zeros(6), [floor])
    assert found.forces["floor"][2] == pytest.approx(box.mass * g, rel=1e-12)
    assert np.abs(found.net - box.mass * g * np.eye(6)[2]).max() < 1e-9
    assert np.allclose(found.corner_forces["floor"].sum(axis=0), found.forces["floor"][:3])
    fall = np.zeros(6)
    fall[2] = -g
    assert np.abs(rbd.estimate_forces(state, fall, []).residual).max() < 1e-12
    held = rbd.estimate_forces(state, np.zeros(6), [])
    assert held.residual[2] == pytest.approx(box.mass * g) and not held.net.any()


def test_over_time_feet_in_the_air_carry_nothing(g1: rbd.Robot, pushed: rbd.Trajectory):
    """`touches` says which contacts are there: the same as one by one."""
    soles = g1.soles(0.7)
    touches = np.ones((len(pushed), 2), bool)
    touches[3:5, 1] = False
    found = estimate_forces_along(pushed, soles, pushed.tau, touches=touches)
    assert len(found) == len(pushed) and found.forces["right_sole"].shape == (len(pushed), 6)
    assert not found.forces["right_sole"][3:5].any() and found.forces["right_sole"][5, 2] > 10.0
    one = estimate_forces(pushed.state(4), pushed.a[4], soles[:1], pushed.tau[4])
    assert np.array_equal(found.forces["left_sole"][4], one.forces["left_sole"])
    assert np.array_equal(found[4].residual, found.residual[4]) and found.deviations is None
    noisy = estimate_forces_along(pushed, soles, a=pushed.a, noise=SensorNoise(a=0.1), touches=touches)
    assert np.isfinite(noisy.deviations["left_sole"][3:5]).all() and np.isinf(noisy.deviations["left_sole"][:3]).all()
    assert np.abs(noisy.net - found.net)[:2].max() < 1e-6 * np.linalg.norm(g1.weight)


def test_impossible_input_is_refused(g1: rbd.Robot, pushed: rbd.Trajectory):
    """Each with what came and what was expected."""
    state, soles, a = pushed.state(0), g1.soles(0.7), pushed.a[0]
    arm = rbd.load_robot("panda", root="fixed")
    with pytest.raises(rbd.InputError, match="every coordinate of panda has a motor"):
        estimate_forces(arm.at(), np.zeros(arm.nv), [])
    with pytest.raises(rbd.InputError, match="noise of tau was given without torques"):
        estimate_forces(state, a, soles, noise=SensorNoise(tau=1.0))
    with pytest.raises(rbd.InputError, match="not finite"):
        estimate_forces(state, np.full(g1.nv, np.nan), soles)
    with pytest.raises(rbd.errors.DuplicateName, match="left_sole"):
        estimate_forces(state, a, [soles[0], soles[0]])
    with pytest.raises(rbd.InputError, match="zero everywhere"):
        SensorNoise()
    with pytest.raises(rbd.InputError, match="standard deviations of 0 or more"):
        SensorNoise(q=-1.0)
    with pytest.raises(rbd.InputError, match=r"noise of v has shape \(3,\)"):
        estimate_forces(state, a, soles, noise=SensorNoise(v=[0.1, 0.1, 0.1]))
    with pytest.raises(rbd.InputError, match="expected rbd.motion.SensorNoise"):
        estimate_forces(state, a, soles, noise=0.1)
    with pytest.raises(rbd.InputError, match=r"tau has shape \(2, 3\)"):
        estimate_forces_along(pushed, soles, np.zeros((2, 3)))
    with pytest.raises(rbd.InputError, match="touches has shape"):
        estimate_forces_along(pushed, soles, touches=np.ones((len(pushed), 3), bool))


def test_it_is_printed(g1: rbd.Robot, pushed: rbd.Trajectory):
    """Forces, what is open, and deviations where there is noise."""
    told = str(estimate_forces(pushed.state(0), pushed.a[0], g1.soles(0.7), noise=SensorNoise(a=0.1)))
    assert "6 of 35 coordinates" in told and "6 internal components unknown (taken: least norm)" in told
    assert "+-" in told and "of 0 degrees of freedom" in told
    assert "at the motors" in str(estimate_forces(pushed.state(0), pushed.a[0], g1.soles(0.7), pushed.tau[0]))


def test_four_steps_of_g1(g1: rbd.Robot, four_steps: rbd.Trajectory):
    """While it walks: each sole with torques, the only one without; sums where both carry, and the swinging foot nothing."""
    unit, motion = float(np.linalg.norm(g1.weight)), four_steps[::20]
    soles = {c.name: c for c in g1.soles(0.7)}
    touches = np.array([np.abs(motion.point_forces[name]).max(axis=(1, 2)) > 0.0 for name in soles]).T
    alone = np.flatnonzero(touches.sum(axis=1) == 1)
    assert len(alone) > 10 and (touches.sum(axis=1) == 2).sum() > 10
    known = estimate_forces_along(motion, list(soles.values()), motion.tau, touches=touches)
    told = estimate_forces_along(motion, list(soles.values()), touches=touches)
    for i in range(len(motion)):
        assert np.abs(known.net[i] - true_net(motion, i, known[i])).max() < EXACT * unit
        assert np.abs(told.net[i] - known.net[i]).max() < EXACT * unit
    for name, column in zip(soles, touches.T, strict=True):
        assert np.abs(known.forces[name] - motion.forces[name]).max() < EXACT * unit
        assert np.abs((told.forces[name] - motion.forces[name])[alone]).max() < EXACT * unit
        assert not known.forces[name][~column].any()
    assert np.abs(known.residual).max() < EXACT * unit
    # Listed as touching all the time, the foot in the air is found to carry nothing, by the torques.
    listed = estimate_forces_along(motion, g1.soles(0.7, on=None), motion.tau)
    for name in soles:
        assert np.abs(listed.forces[name] - motion.forces[name]).max() < 1e-8 * unit
