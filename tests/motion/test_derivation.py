"""Velocities and accelerations of sampled configurations, against motions whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rbd.errors import InputError
from rbd.model.sampled_motion import exponential, logarithm, product, rotated
from rbd.motion import Motion, derivatives


def flight(robot, t, w=(1.0, 2.0, -0.5)):
    """A base that flies and spins at a constant rate, joints that swing; (q, v, a)."""
    w = np.array(w)
    q, v, a = np.tile(pin.neutral(robot.model), (len(t), 1)), np.zeros((len(t), robot.nv)), np.zeros((len(t), robot.nv))
    q[:, :3] = np.outer(t, [1.0, 2.0, 3.0]) + np.outer(t**2, [0.0, 0.0, -4.905])
    q[:, 3:7] = exponential(np.outer(t, w))
    back = q[:, 3:7] * [-1.0, -1.0, -1.0, 1.0]
    v[:, :3] = rotated(back, np.array([1.0, 2.0, 3.0]) + np.outer(t, [0.0, 0.0, -9.81]))
    v[:, 3:6] = w
    a[:, :3] = rotated(back, np.broadcast_to([0.0, 0.0, -9.81], (len(t), 3))) - np.cross(w, v[:, :3])
    q[:, 7:], v[:, 6:], a[:, 6:] = 0.3 * np.sin(t)[:, None], 0.3 * np.cos(t)[:, None], -0.3 * np.sin(t)[:, None]
    return q, v, a


def test_a_flight_with_a_constant_spin_is_exact(g1):
    """Polynomials of order 3 hold a parabola, and the logarithm of a constant spin; one-sided windows at the ends too."""
    t = np.arange(90) / 30.0
    q, v, a = flight(g1, t)
    found_v, found_a, _ = derivatives(g1, t, q)
    assert np.abs(found_v - v)[:, :6].max() < 1e-11
    assert np.abs(found_a - a)[:, :6].max() < 1e-9


def test_errors_of_a_swing_are_of_the_stated_order(g1):
    """Half the window, with as many frames: 1 / 8 of the error of v and 1 / 4 of that of a, for polynomials of order 3."""
    errors = []
    for rate in (30.0, 60.0):
        t = np.arange(round(4 * rate)) / rate
        q, v, a = flight(g1, t)
        found_v, found_a, how = derivatives(g1, t, q, window=6.0 / rate, order=3)
        inside = slice(4, -4)
        errors.append([np.abs(found_v - v)[inside, 6:].max(), np.abs(found_a - a)[inside, 6:].max()])
        assert how.window == pytest.approx(6.0 / rate)
    ratio = np.array(errors[0]) / errors[1]
    assert 14.0 < ratio[0] < 17.0, "the window is symmetric, so v is of order 4"
    assert 3.8 < ratio[1] < 4.2


def test_velocities_are_those_of_pinocchio(g1):
    """On the manifold, q + v dt is the next q."""
    t = np.arange(300) / 300.0
    q, _, _ = flight(g1, t)
    v, a, _ = derivatives(g1, t, q, window=0.02)
    h = 1.0 / 300.0
    mid = np.array([pin.difference(g1.model, q[i - 1], q[i + 1]) / (2.0 * h) for i in range(1, 299)])
    assert np.abs(mid - v[1:-1]).max() < 2e-3  # h^2 / 6 times the third derivative of the path along the old axes
    step = np.array([pin.difference(g1.model, q[i], q[i + 1]) / h for i in range(299)])
    assert np.abs(step - (v + 0.5 * h * a)[:-1]).max() < 2e-3


def test_unequal_times_are_taken_as_they_are(g1):
    """A parabola is exact at any times."""
    t = np.sort(np.random.default_rng(1).uniform(0.0, 3.0, 80))
    t += 1e-3 * np.arange(80)
    q, v, a = flight(g1, t)
    found_v, found_a, _ = derivatives(g1, t, q)
    assert np.abs(found_v - v)[:, :6].max() < 1e-6 * np.abs(found_v).max()
    inside = slice(4, -4)
    assert np.abs(found_a - a)[inside, :6].max() < 1e-5


@pytest.mark.parametrize("rate", [30, 60])
@pytest.mark.parametrize("name", ["squat", "four_steps"])
def test_net_forces_of_simulated_motions_come_out_of_their_files(g1, request, tmp_path, name: str, rate: int):
    """Six decimals: within 0.5 % of the weight in 95 % of the frames, 3 % in all, half a window from switches and ends."""
    motion = Motion.of_trajectory(trajectory := request.getfixturevalue(name))
    every = slice(None, None, 300 // rate)
    known = [getattr(motion, field)[every] for field in ("t", "q", "v", "a")]
    Motion.of_arrays(g1, *known).save(tmp_path / "file.csv")
    found = Motion.read(tmp_path / "file.csv", robot=g1)
    half = 0.5 * found.derivation.window
    away = (found.t > half) & (found.t < found.t[-1] - half)
    for event in trajectory.events:
        away &= np.abs(found.t - event.t) > half + 1.0 / rate
    assert away.mean() > 0.5
    data, off = g1.model.createData(), []
    for i in np.flatnonzero(away):
        pin.centerOfMass(g1.model, data, known[1][i], known[2][i], known[3][i])
        true = data.acom[0].copy()
        pin.centerOfMass(g1.model, data, found.q[i], found.v[i], found.a[i])
        off.append(np.linalg.norm(data.acom[0] - true) / 9.81)
    assert np.quantile(off, 0.95) < 5e-3 and max(off) < 0.03


@pytest.mark.parametrize("how", [{}, {"method": "low-pass", "cutoff": 5.0}])
def test_the_stated_noise_is_that_of_draws(g1, how):
    """Standard deviation of v and a over a motion with noise in q, half a window from the ends: within 3 % of what is told."""
    rng, n, sigma = np.random.default_rng(3), 20_000, 1e-4
    t = np.arange(n) / 60.0
    still = np.tile(pin.neutral(g1.model), (n, 1))
    noise = sigma * rng.standard_normal((n, g1.nv))
    q = still.copy()
    q[:, :3] += noise[:, :3]
    q[:, 3:7] = product(still[:, 3:7], exponential(noise[:, 3:6]))
    q[:, 7:] += noise[:, 6:]
    v, a, told = derivatives(g1, t, q, noise=sigma, **how)
    inside = slice(100, -100)
    for found, stated in ((v, told.noise_v), (a, told.noise_a)):
        spread = found[inside].std(axis=0)
        assert np.abs(spread / stated - 1.0).max() < 0.1
        assert np.sqrt((spread**2).mean() / (stated**2).mean()) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("how", [{}, {"method": "low-pass", "cutoff": 5.0}, {"order": 5, "window": 0.4}])
def test_half_of_an_acceleration_at_the_cutoff_is_left(g1, how):
    """A joint that swings at the stated frequency shows half of its acceleration."""
    t = np.arange(1200) / 60.0
    q = np.tile(pin.neutral(g1.model), (len(t), 1))
    _, _, told = derivatives(g1, t, q, **how)
    omega = 2.0 * np.pi * told.cutoff
    q[:, 7] = np.sin(omega * t)
    _, a, _ = derivatives(g1, t, q, **how)
    inside = slice(200, -200)
    wave = np.sin(omega * t[inside])
    assert -(a[inside, 6] @ wave) / (wave @ wave) / omega**2 == pytest.approx(0.5, abs=0.01)


def test_a_low_pass_keeps_a_spin_and_slow_swings(g1):
    """Zero phase: a swing at a tenth of the cut-off is where it was, to (1 / 10)^6."""
    t = np.arange(1200) / 60.0
    q, v, a = flight(g1, t)
    found_v, found_a, told = derivatives(g1, t, q, method="low-pass", cutoff=6.0)
    inside = slice(60, -60)
    assert np.abs(found_v - v)[inside].max() < 2e-4
    assert np.abs(found_a - a)[inside, 3:].max() < 2e-4
    assert told.cutoff == pytest.approx(6.0, abs=0.1)


def test_rotations_agree_with_pinocchio():
    """Product, logarithm and rotated vectors, at all angles."""
    rng = np.random.default_rng(5)
    w = rng.standard_normal((40, 3)) * rng.uniform(0.0, 1.2, (40, 1))
    x = exponential(w)
    R = [pin.exp3(each) for each in w]
    assert np.abs(logarithm(x) - [pin.log3(each) for each in R]).max() < 1e-12
    both = product(x[:-1], x[1:])
    for i in range(39):
        assert np.abs(pin.Quaternion(both[i]).toRotationMatrix() - R[i] @ R[i + 1]).max() < 1e-14
    p = rng.standard_normal((40, 3))
    assert np.abs(rotated(x, p) - np.einsum("ijk,ik->ij", R, p)).max() < 1e-14
    assert np.abs(logarithm(-x) - logarithm(x)).max() < 1e-12


class TestMotion:
    """`Motion.of_arrays`."""

    def test_given_velocities_are_kept(self, g1):
        """To the last bit; accelerations that are not given are their derivatives."""
        t = np.arange(60) / 30.0
        q, v, a = flight(g1, t)
        motion = Motion.of_arrays(g1, t, q, v, a)
        assert (motion.v == v).all() and (motion.a == a).all() and motion.derivation is None and not motion.notes
        half = Motion.of_arrays(g1, t, q, v)
        assert np.abs(half.a - a)[4:-4].max() < 0.05 and "accelerations" in half.notes[0]
        assert (motion.n, motion.duration, len(motion)) == (60, pytest.approx(59 / 30), 60)
        assert motion.rate == pytest.approx(30.0) and motion.joints == tuple(g1.joints)[1:]
        assert (motion.state(-1).v == v[-1]).all()

    def test_quaternions_nearly_unit_are_normalised_and_it_is_said(self, g1):
        """Beyond 5 % they are refused, by frame."""
        t = np.arange(10) / 30.0
        q, _, _ = flight(g1, t)
        q[4, 3:7] *= 1.0004
        motion = Motion.of_arrays(g1, t, q)
        assert np.linalg.norm(motion.q[4, 3:7]) == pytest.approx(1.0, abs=1e-15)
        assert "normalised" in motion.notes[0] and "0.0004" in motion.notes[0]
        q[6, 3:7] *= 1.06
        with pytest.raises(InputError, match="frame 6: the quaternion .* norm 1.06"):
            Motion.of_arrays(g1, t, q)
        q[6, 3:7] = 0.0
        with pytest.raises(InputError, match="frame 6: the quaternion .* norm 0;"):
            Motion.of_arrays(g1, t, q)

    def test_bad_arrays_are_refused_by_place(self, g1):
        """Rows, columns and numbers are named."""
        t = np.arange(10) / 30.0
        q, v, a = flight(g1, t)
        bad = q.copy()
        bad[3, 8] = np.nan
        with pytest.raises(InputError, match="frame 3, column 8 is nan"):
            Motion.of_arrays(g1, t, bad)
        with pytest.raises(InputError, match=r"shape \(9, 36\); expected \(10, 36\)"):
            Motion.of_arrays(g1, t, q[:9])
        again = t.copy()
        again[5] = again[4]
        with pytest.raises(InputError, match=r"times do not increase: t\[4\]"):
            Motion.of_arrays(g1, again, q)
        with pytest.raises(InputError, match="without v"):
            Motion.of_arrays(g1, t, q, None, a)
        with pytest.raises(InputError, match="cutoff"):
            Motion.of_arrays(g1, t, q, cutoff=16.0)
        with pytest.raises(InputError, match="order"):
            Motion.of_arrays(g1, t, q, order=1)
        with pytest.raises(InputError, match="two frames"):
            Motion.of_arrays(g1, t[:1], q[:1])
        with pytest.raises(InputError, match="from -10 to 9"):
            Motion.of_arrays(g1, t, q, v, a).state(10)


def test_long_motions_are_derived_part_by_part(g1, monkeypatch):
    """The same to the last bits, windows across the seams, even times and uneven ones."""
    t = np.arange(300) / 60.0
    for times in (t, t + 1e-3 * np.sin(np.arange(300))):
        q, _, _ = flight(g1, times)
        whole = derivatives(g1, times, q)
        with monkeypatch.context() as patch:
            patch.setattr("rbd.motion.derivation.CHUNK", 37)
            parts = derivatives(g1, times, q)
        assert np.abs(whole[0] - parts[0]).max() < 1e-10 and np.abs(whole[1] - parts[1]).max() < 1e-8
