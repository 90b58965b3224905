"""Friction over time: what stops and stays, is carried along, curves, spins and lifts off, and what energy friction takes."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from contact_cases import (
    billiard_ball,
    block_on_belt,
    rubbed_oscillator,
    sliding_disk,
    sole,
    spinning_tripod,
    symmetric_flight,
)
from courses import G
from flat_bodies import chain, flat_body, flat_state, floor_point, free_body, free_motion, free_state, pendulum

import rbd


class TestJoints:
    """Dry friction in a joint."""

    def test_a_sliding_mass_stops_at_its_time_and_holds(self):
        """M v0 / f = 0.4 s, v0^2 m / 2 f = 0.4 m, exactly, at any step; pushed with less than f it stays."""
        robot = chain([("slide", pin.JointModelPX(), 2.0, [1.0, 1.0, 1.0])], names=("body",), name="slider")
        rub = rbd.JointFriction("rub", "slide", 10.0)
        for step in (1e-3, 3e-2):
            trajectory = rbd.simulate(rbd.State(robot, [0.0], [2.0]), [rub], duration=0.6, step=step, progress=False)
            assert trajectory.q[-1] == pytest.approx([0.4], abs=1e-12) and abs(trajectory.v[-1, 0]) < 1e-14
            assert not np.ptp(trajectory.q[trajectory.t >= 0.43])
        push = {"external": np.array([9.9]), "duration": 0.2, "step": 1e-2, "progress": False}
        held = rbd.simulate(rbd.State(robot, [0.0]), [rub], **push)
        assert np.abs(held.v).max() < 1e-15 and held.forces["rub"][-1] == pytest.approx([-9.9])

    def test_an_oscillator_loses_two_f_over_k_each_half_swing_and_stops(self):
        """Half cosines about +-f / k: amplitudes .33, .23, .13, .03 = within f / k: there it stays, off its middle."""
        case = rubbed_oscillator()
        trajectory = case.run(1.3, 4e-3)
        half = math.pi / 10.0
        turns = [trajectory.q[np.argmin(np.abs(trajectory.t - k * half)), 0] for k in range(4)]
        assert turns == pytest.approx([0.33, -0.23, 0.13, -0.03], abs=1e-3)
        rests = trajectory.t > 3.0 * half + 8e-3
        assert trajectory.q[rests][:, 0] == pytest.approx(np.full(rests.sum(), -0.03), abs=1e-6)
        assert not np.ptp(trajectory.q[rests]) and np.abs(trajectory.v[rests]).max() < 1e-12

    def test_a_pendulum_with_dry_friction_stops_where_its_weight_is_less(self):
        """Each swing from a to b: m g l (cos b - cos a) = f (a - b), and it stays once m g l |sin| <= f."""
        robot = pendulum(1.0, 1.0)
        f, a, swings = 1.0, 1.2, [1.2]
        while G * math.sin(abs(a)) > f:
            lo, hi = -a, 0.0  # of the other end, on the other side
            b = hi
            for _ in range(100):
                b = 0.5 * (lo + hi)
                lo, hi = (b, hi) if G * (math.cos(b) - math.cos(a)) < f * (a - b) else (lo, b)
            swings.append(b * (-1) ** len(swings) * -1)
            a = abs(b)
        rub = rbd.JointFriction("rub", "hinge", f)
        trajectory = rbd.simulate(rbd.State(robot, [1.2]), [rub], duration=9.0, step=1e-2, progress=False)
        q = trajectory.q[:, 0]
        inner = np.flatnonzero((q[1:-1] - q[:-2]) * (q[2:] - q[1:-1]) < 0.0) + 1
        assert np.abs(q[inner][: len(swings) - 2]) == pytest.approx(
            np.abs(swings[1 : len(inner) + 1])[: len(swings) - 2], abs=2e-3
        )
        assert abs(q[-1]) == pytest.approx(abs(swings[-1]), abs=2e-3) and not np.ptp(q[-20:])


class TestBelt:
    """The brick put on a belt that runs at 2 m/s, mu = .25."""

    def test_it_speeds_up_to_the_belt_and_rides_along(self, brick):
        """Mu g until v = 2 m/s at .8155 s, then with the belt for good and no force along it: exact."""
        case = block_on_belt(brick)
        trajectory = case.run(1.2, 1e-2)
        assert max(case.error(trajectory, k) for k in range(0, len(trajectory), 5)) < 1e-11
        sticks = [e.t for e in trajectory.events if e.kind == "sticks"]
        assert sticks == pytest.approx([2.0 / (0.25 * G)] * 4, abs=1e-9)
        along = sum(trajectory.forces[f"c{i}"][:, 0] for i in range(4))
        riding = trajectory.t > 0.83
        assert along[~riding][:80] == pytest.approx(np.full(80, 2.5 * G)) and np.abs(along[riding]).max() < 1e-8

    def test_on_a_belt_up_a_slope_that_is_too_steep_it_slides_back(self, brick):
        """Mu < tan: the belt running up at 1 m/s slows it, and g (sin - mu cos) wins."""
        slope, mu = math.radians(30.0), 0.4
        up, out = np.array([math.cos(slope), 0.0, math.sin(slope)]), np.array([-math.sin(slope), 0.0, math.cos(slope)])
        start = free_state(brick, 0.1 * out, (0.0, -slope, 0.0))
        belt = sole("box", (0.2, 0.2), 0.1, mu, on=rbd.Ground(point=(0, 0, 0), normal=tuple(out), velocity=tuple(up)))
        trajectory = rbd.simulate(start, [belt], duration=0.5, step=1e-2, progress=False)
        X, v, w = free_motion(trajectory.state(-1))
        assert up @ v == pytest.approx(-0.5 * G * (math.sin(slope) - mu * math.cos(slope)), abs=1e-10)
        assert np.abs(w).max() < 1e-10 and set(trajectory.modes["sole"]) == {"slips"}


class TestSpin:
    """What slides and turns."""

    def test_a_disk_on_three_feet_slides_along_a_curve_and_loses_what_friction_takes(self):
        """Loads by moments, friction by loads: reduced equations. Its energy is what it had less the work of the feet."""
        case, tripod = spinning_tripod()
        trajectory = case.run(0.8, 2e-3)
        assert case.error(trajectory, 160) < 1e-3 and case.error(trajectory) < 6e-4
        assert abs(trajectory.q[-1, 1]) > 0.01  # it was thrown along x
        feet = tripod.points
        power = np.zeros(len(trajectory))
        for k in range(len(trajectory)):
            X, v, w = free_motion(trajectory.state(k))
            for i, p in enumerate(feet):
                arm = X.rotation @ np.array([*p, -0.05])
                power[k] += trajectory.forces[f"foot{i}"][k] @ (v + np.cross(w, arm))
        work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * 2e-3])
        assert np.abs(trajectory.energy - trajectory.energy[0] - work).max() < 6e-6 * trajectory.kinetic[0]
        assert np.diff(trajectory.energy).max() < 0.0

    def test_it_ends_at_rest_for_good(self):
        """All the energy is gone within the second, and nothing creeps."""
        case, _ = spinning_tripod()
        trajectory = case.run(1.2, 4e-3)
        assert trajectory.kinetic[-1] < 1e-30 and np.ptp(trajectory.q[-20:], axis=0).max() < 1e-15
        assert {trajectory.modes[f"foot{i}"][-1] for i in range(3)} == {"sticks"}

    def test_a_ball_struck_aslant_runs_a_parabola_then_a_line(self):
        """Friction keeps its direction until it rolls: Coriolis's billiard, with side and back spin."""
        case = billiard_ball((2.0, 0.5, 0.0), (-3.0, -30.0, 5.0))
        trajectory = case.run(0.56, 4e-3)
        assert case.error(trajectory, 60) < 1e-11 and case.error(trajectory) < 1e-11
        sideways = np.array([free_motion(trajectory.state(k))[0].translation[1] for k in range(0, len(trajectory), 20)])
        assert np.abs(np.diff(sideways, 2)[:5]).min() > 1e-4  # no line

    def test_a_ball_with_back_spin_comes_back(self):
        """V = (5 v0 - 2 r w0) / 7 < 0 when rolling."""
        case = billiard_ball((1.0, 0.0, 0.0), (0.0, -60.0, 0.0))
        trajectory = case.run(1.0, 4e-3)
        X, v, w = free_motion(trajectory.state(-1))
        assert v[0] == pytest.approx((5.0 - 12.0) / 7.0, abs=1e-11) and trajectory.q[:, 0].max() > trajectory.q[-1, 0] + 0.1

    def test_a_disk_thrown_upright_rolls_at_two_thirds(self):
        """V = 2/3 v0 at t = v0 / (3 mu g)."""
        case = sliding_disk()
        trajectory = case.run(0.4, 2e-3)
        sticks = [e.t for e in trajectory.events if e.kind == "sticks"]
        assert sticks[0] == pytest.approx(2.0 / (0.9 * G), abs=1e-12)
        assert case.error(trajectory) < 1e-11 and trajectory.modes["rim"][-1] == "sticks"

    def test_a_disk_spun_on_its_edge_spins_on(self):
        """Upright about the vertical at 20 rad/s: one point of contact, so no torque; its place, lean and rate stay."""
        r = 0.25
        robot = free_body(2.0, [r * r / 2.0, r * r, r * r / 2.0])
        start = free_state(robot, (0.0, 0.0, r), w=(0.0, 0.0, 20.0))
        rim = rbd.RollingDisk("rim", "body", radius=r, friction=0.5)
        trajectory = rbd.simulate(start, [rim], duration=1.0, step=4e-3, progress=False)
        X, v, w = free_motion(trajectory.state(-1))
        assert X.translation == pytest.approx([0.0, 0.0, r], abs=1e-9) and w == pytest.approx([0.0, 0.0, 20.0], abs=1e-8)
        assert math.remainder(math.atan2(X.rotation[1, 0], X.rotation[0, 0]) - 20.0, 2.0 * math.pi) == pytest.approx(
            0.0, abs=1e-8
        )
        assert trajectory.forces["rim"][-1] == pytest.approx([0.0, 0.0, 2.0 * G], abs=1e-6)

    def test_a_leaning_disk_that_grips_rolls_as_one_that_is_held(self):
        """Friction that suffices is no friction law: the same motion as `friction=None` under `RungeKutta4`."""
        r = 0.25
        robot = free_body(2.0, [r * r / 2.0, r * r, r * r / 2.0])
        lean, spin = 0.3, 12.0
        turn = np.array([lean, 0.0, 0.0])
        R = pin.exp3(turn)
        centre, w = R @ [0.0, 0.0, r], spin * R[:, 1]
        start = free_state(robot, centre, turn, v=np.cross(w, centre), w=w)
        grips, held = (rbd.RollingDisk("rim", "body", radius=r, friction=f) for f in (2.0, None))
        truth = rbd.simulate(start, [held], duration=0.4, step=4e-3, progress=False)  # of order 4
        off = []
        for step in (4e-3, 2e-3):
            rolls = rbd.simulate(start, [grips], duration=0.4, step=step, progress=False)
            assert set(rolls.modes["rim"]) == {"sticks"}
            off.append(np.abs(rolls.q[-1, :3] - truth.q[-1, :3]).max())
        assert off[1] < 1.2e-5 and off[0] / off[1] == pytest.approx(4.0, abs=0.1)


class TestLiftOff:
    """What leaves the ground is free."""

    def test_a_brick_pulled_up_by_a_growing_force_leaves_when_it_bears_the_weight(self, brick):
        """F = k t: off at m g / k, then z = k (t - t0)^3 / 6 m."""
        k = 400.0
        off = 10.0 * G / k
        start = free_state(brick, (0.0, 0.0, 0.1))
        trajectory = rbd.simulate(
            start,
            [sole("box", (0.2, 0.2), 0.1, 0.5)],
            duration=0.6,
            step=2e-3,
            external=lambda state, t: rbd.ExternalForce("box", (0.0, 0.0, k * t)),
            progress=False,
        )
        assert [e.t for e in trajectory.events] == pytest.approx([off] * 4, abs=1e-6)
        s = 0.6 - off
        assert trajectory.q[-1, 2] == pytest.approx(0.1 + k * s**3 / 60.0, abs=4e-5)
        assert trajectory.modes["sole"][-1] == "open" and not trajectory.forces["sole"][-1].any()

    def test_a_top_thrown_up_turns_as_a_free_body(self):
        """Its centre flies a parabola, and its rate is Kane's torque-free one."""
        case = symmetric_flight()
        trajectory = case.run(0.8, 2e-3)
        assert case.error(trajectory) < 4e-4
        X, v, w = free_motion(trajectory.state(-1))
        assert X.translation == pytest.approx([0.8, 0.0, 0.1 + 4.0 - G * 0.32], abs=1e-11)
        assert not trajectory.point_forces["tip"][1:].any()


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@pytest.mark.parametrize("extrapolate", [False, True])
@pytest.mark.parametrize("lean", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("step", [0.04, 0.02, 5e-3])
def test_a_foot_that_a_rod_turns_about_does_not_slip(lean, step, extrapolate):
    """Mu = 1, and friction is at most 0.62 of the load: it sticks, no event says other, and forces are m (a + g) of the rod.

    J v of a foot that is closed is off by h^2: that is no sliding.
    """
    m, g = 2.0, 9.81
    robot = flat_body(m, m / 3.0)
    start = flat_state(robot, (math.sin(lean), math.cos(lean), lean - 0.5 * math.pi))
    foot = floor_point("foot", (-1.0, 0.0), friction=1.0)
    by = rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, [foot], duration=0.2, step=step, integrator=by, progress=False)
    assert found.events == ()
    assert set(found.modes["foot"]) == {"sticks"}
    for i in range(len(found)):
        angle, rate = found.q[i, 2] + 0.5 * math.pi, found.v[i, 2]
        along, out = np.array([math.cos(angle), -math.sin(angle)]), np.array([math.sin(angle), math.cos(angle)])
        a = 0.75 * g * math.sin(angle) * along - rate**2 * out
        assert np.abs(found.forces["foot"][i][[0, 2]] - m * (a + [0.0, g])).max() < 20.0 * step
