"""Contact motion with a published or closed-form course; g = 9.81 unless said. Source: the project's cases."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from closed_forms import Ladder, RimlessWheel
from contact_cases import (
    billiard_ball,
    block_thrown_up,
    ladder,
    rimless_wheel,
    rod_on_rough_table,
    sole,
    toppling_crate,
)
from courses import G, OnePoint, rod_inertia
from flat_bodies import ball, flat_motion, floor_point, free_motion, free_state

import rbd


def told(trajectory: rbd.Trajectory, name: str, kind: str) -> list[float]:
    """Times of events."""
    return [e.t for e in trajectory.events if (e.name, e.kind) == (name, kind)]


class TestLadder:
    """A thin rod of 10 kg and 2 m slides down a wall from rest at 60 deg."""

    def test_the_truth_is_the_published_one(self):
        """It leaves the wall at .45966283 s, at sin th = 2/3 sin th0; the floor then bears m g / 4."""
        truth = Ladder(10.0, 1.0, rod_inertia(10.0, 1.0), math.pi / 3.0)
        assert truth.time_to(truth.leaving_angle) == pytest.approx(0.45966283, abs=5e-9)
        assert truth.course(1.0).when("leaves") == pytest.approx([truth.time_to(truth.leaving_angle)], abs=1e-11)

    @pytest.mark.parametrize("spatial", [False, True])
    def test_it_leaves_the_wall_when_and_where_it_must(self, spatial):
        """At 1 ms, in the plane and free in space: time, height, floor force, and the way on the floor alone."""
        case = ladder(spatial=spatial)
        trajectory = case.run(0.6, 1e-3)
        assert told(trajectory, "wall", "leaves") == pytest.approx([0.45966283], abs=5e-6)
        assert not told(trajectory, "floor", "leaves")
        before = np.flatnonzero(trajectory.t < 0.45966283)[-4:]  # the floor's force has a kink there: from one side
        t = trajectory.t[before]
        height = np.polyval(np.polyfit(t - 0.45966283, [flat_motion(trajectory.state(k))[1] for k in before], 2), 0.0)
        floor = np.polyval(np.polyfit(t - 0.45966283, trajectory.forces["floor"][before, 2], 2), 0.0)
        assert height == pytest.approx(2.0 / 3.0 * math.sin(math.pi / 3.0), abs=6e-6)
        assert floor == pytest.approx(10.0 * G / 4.0, abs=3e-4)
        assert case.error(trajectory) < 1.2e-5

    def test_its_wall_force_falls_to_zero_and_never_pulls(self):
        """W = m x'' >= 0, to the figures of the order's table at every step."""
        trajectory = ladder().run(0.6, 4e-3)
        wall = trajectory.forces["wall"][:, 0]
        assert wall.min() >= 0.0 and wall[0] == pytest.approx(0.75 * 10.0 * G * math.sin(math.pi / 3.0) / 2.0, rel=1e-9)
        assert not wall[trajectory.t > 0.464].any()

    def test_rough_at_both_ends_it_slides_as_two_equations_say(self):
        """Mu .1 below, .15 at the wall: floor and wall force by hand in the plane; it leaves the wall later."""
        case = ladder(floor=0.1, wall=0.15)
        trajectory = case.run(0.56, 2e-3)
        assert case.error(trajectory) < 4e-5
        assert set(trajectory.modes["floor"][1:]) == set(trajectory.modes["wall"][1:]) == {"slips"}


class TestIncline:
    """The brick thrown up 25 deg at 3 m/s, on its sole."""

    @pytest.mark.parametrize("step", [4e-3, 3e-2])
    def test_at_one_half_it_stops_and_stays(self, brick, step):
        """After .3491895 s and .5237842 m; over the next second it moves less than 1e-9 m. Exact at any step."""
        case = block_thrown_up(brick, 0.5)
        trajectory = case.run(1.35, step)
        assert told(trajectory, "sole", "sticks") == pytest.approx([0.3491895] * 4, abs=5e-8)
        way = np.array([case.read(trajectory.state(k))[0] for k in np.flatnonzero(trajectory.t > 0.35)])
        assert way == pytest.approx(np.full(len(way), 0.5237842), abs=5e-8)
        assert np.ptp(way) < 1e-9 and np.abs(trajectory.v[-1]).max() < 1e-12
        assert case.error(trajectory) < 1e-9

    def test_at_three_tenths_it_comes_back(self, brick):
        """At -1.3975772 m/s where it was thrown."""
        case = block_thrown_up(brick, 0.3)
        braked, back = (G * (math.sin(math.radians(25.0)) + s * 0.3 * math.cos(math.radians(25.0))) for s in (1.0, -1.0))
        returns = 3.0 / braked * (1.0 + math.sqrt(braked / back))
        trajectory = case.run(returns, 4e-3)
        assert case.read(trajectory.state(-1)) == pytest.approx([0.0, -1.3975772], abs=5e-8)
        assert case.error(trajectory) < 1e-9


class TestBall:
    """A solid ball, thrown without spin or put on a slope."""

    def test_it_slides_then_rolls(self):
        """T = 2 v0 / (7 mu g), then v = 5/7 v0, for ever."""
        case = billiard_ball((2.0, 0.0, 0.0))
        trajectory = case.run(0.4, 4e-3)
        rolls = 4.0 / (7.0 * 0.3 * G)
        assert told(trajectory, "ball", "sticks") == pytest.approx([rolls], abs=1e-12)
        rolling = np.flatnonzero(trajectory.t > rolls + 4e-3)
        assert np.ptp(trajectory.v[rolling, 4]) < 1e-11 and set(trajectory.modes["ball"][rolling]) == {"sticks"}
        X, v, w = free_motion(trajectory.state(-1))
        assert v[0] == pytest.approx(10.0 / 7.0, abs=1e-12) and v[0] == pytest.approx(0.1 * w[1], abs=1e-12)

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_on_a_slope_it_rolls_while_friction_is_two_sevenths_of_it(self, sign):
        """At 60 deg, 1e-3 above .494872 it rolls with 5/7 g sin; 1e-3 below it slips, with g (sin - mu cos)."""
        slope, r = math.radians(60.0), 0.1
        mu = 2.0 / 7.0 * math.tan(slope) * (1.0 + 1e-3 * sign)
        assert mu == pytest.approx(0.494872, rel=2e-3)
        out, down = np.array([math.sin(slope), 0.0, math.cos(slope)]), np.array([math.cos(slope), 0.0, -math.sin(slope)])
        touch = rbd.RollingBall("ball", "body", radius=r, friction=mu, on=rbd.Ground(normal=out, point=(0.0, 0.0, 0.0)))
        trajectory = rbd.simulate(free_state(ball(2.0, r), r * out), [touch], duration=0.2, step=4e-3, progress=False)
        X, v, w = free_motion(trajectory.state(-1))
        a = 5.0 / 7.0 * G * math.sin(slope) if sign > 0 else G * (math.sin(slope) - mu * math.cos(slope))
        assert down @ v == pytest.approx(a * 0.2, rel=1e-11) and down @ X.translation == pytest.approx(a * 0.02, rel=1e-11)
        assert (abs(down @ v - r * w[1]) < 1e-9) == (sign > 0)
        assert trajectory.modes["ball"][-1] == ("sticks" if sign > 0 else "slips")

    def test_a_point_of_the_ball_is_not_a_ball(self):
        """`PointContact` is one point of the material: it turns with the ball and rises, and the ball sinks into the floor.

        `RollingBall` touches where the ball is lowest.
        """
        state = free_state(ball(2.0, 0.1), (0.0, 0.0, 0.1), v=(2.0, 0.0, 0.0), w=(0.0, 20.0, 0.0))
        point = rbd.PointContact("ball", "body", offset=(0.0, 0.0, -0.1), friction=0.3)
        rolling = rbd.RollingBall("ball", "body", radius=0.1, friction=0.3)
        sinks, rolls = (rbd.simulate(state, [c], duration=0.1, step=4e-3, progress=False) for c in (point, rolling))
        assert sinks.q[-1, 2] < 0.09 and rolls.q[-1, 2] == pytest.approx(0.1, abs=1e-9)


class TestPushed:
    """The brick of 10 kg at mu = .6, and the crate of 20 kg, b .4, h 1, pushed at their middles."""

    @pytest.mark.parametrize(("law", "a"), [("coulomb", (2.114, 0.0)), ("convex", ((80.0 - 0.6 * 107.4265) / 10.0, 0.93265))])
    def test_how_the_brick_slips_is_the_law(self, brick, law, a):
        """80 N. Coulomb: it slides at 2.114 m/s2 under 98.1 N. Convex: it starts to lift off at .933 m/s2, with 107.4 N."""
        push = rbd.ExternalForce("box", (80.0, 0.0, 0.0))
        contact = [sole("box", (0.2, 0.2), 0.1, 0.6)]
        start = free_state(brick, (0.0, 0.0, 0.1))
        trajectory = rbd.simulate(start, contact, duration=0.2, step=4e-3, law=law, external=push, progress=False)
        assert trajectory.a[0][[0, 2]] == pytest.approx(a, abs=5e-5)
        if law == "coulomb":
            assert trajectory.v[-1] == pytest.approx([0.2 * 2.114, 0, 0, 0, 0, 0], abs=1e-10)
            assert trajectory.q[-1, 0] == pytest.approx(0.02 * 2.114, abs=1e-10)
            assert trajectory.forces["sole"][:, 2] == pytest.approx(np.full(len(trajectory), 98.1), abs=1e-7)
        else:
            assert (
                trajectory.forces["sole"][0, 2] == pytest.approx(107.4265, abs=1e-3) and trajectory.q[:, 2].max() > 0.1 + 1e-6
            )

    @pytest.mark.parametrize("law", ["coulomb", "convex"])
    def test_the_brick_sticks_under_30_N(self, brick, law):
        """Both laws; nothing moves."""
        push = rbd.ExternalForce("box", (30.0, 0.0, 0.0))
        start = free_state(brick, (0.0, 0.0, 0.1))
        contact = [sole("box", (0.2, 0.2), 0.1, 0.6)]
        trajectory = rbd.simulate(start, contact, duration=0.2, step=1e-2, law=law, external=push, progress=False)
        assert np.abs(trajectory.v).max() < 1e-13 and trajectory.forces["sole"][-1, :3] == pytest.approx([-30.0, 0.0, 98.1])
        assert not trajectory.events

    @pytest.mark.parametrize(("push_N", "a"), [(58.8, 0.0), (58.9, 0.002), (80.0, 1.057)])
    def test_the_crate_slides_at_58_86_N(self, crate, push_N, a):
        """Mu = .3: (F - 58.86) / m; under 80 N the front corners bear 171.675 N and the rear ones 24.525 N."""
        push = rbd.ExternalForce("crate", (push_N, 0.0, 0.0))
        contact = [sole("crate", (0.2, 0.2), 0.5, 0.3)]
        start = free_state(crate, (0.0, 0.0, 0.5))
        trajectory = rbd.simulate(start, contact, duration=0.2, step=1e-2, external=push, progress=False)
        assert trajectory.v[-1] == pytest.approx([0.2 * a, 0, 0, 0, 0, 0], abs=1e-11)
        if push_N == 80.0:
            front = trajectory.points["sole"][-1][:, 0] > trajectory.q[-1, 0]
            corners = trajectory.point_forces["sole"][-1][:, 2]
            assert [corners[front].sum(), corners[~front].sum()] == pytest.approx([171.675, 24.525], abs=1e-6)

    @pytest.mark.parametrize("push_N", [78.4, 110.0])
    def test_the_crate_topples_at_78_48_N(self, crate, push_N):
        """Rough floor: at less it stands; at more it turns about its front edge as I0 th'' = F h - m g x says."""
        case = toppling_crate(crate, push_N)
        trajectory = case.run(0.4, 4e-3)
        if push_N < 78.48:
            assert np.abs(trajectory.v).max() < 1e-12
        else:
            assert case.error(trajectory) < 1.6e-4 and set(trajectory.modes["sole"]) == {"sticks"}


class TestRimlessWheel:
    """McGeer's: m = l = 1, a = 22.5 deg, slope .08, g = 9.8; here with j = I / m l^2 small, since M must not be singular."""

    def test_the_truth_is_the_published_one(self):
        """W* = 1.0949043574 rad/s for j = 0, the rate after an impact."""
        assert RimlessWheel(g=9.8).cycle == pytest.approx(1.0949043574, abs=5e-11)
        assert RimlessWheel(g=9.8, j=1e-6).cycle == pytest.approx(1.0949043574, abs=2e-6)

    def test_it_stays_on_its_limit_cycle(self):
        """Started at w*, each impact is at w* / eta, a period apart; the old foot leaves as the new one strikes."""
        wheel = RimlessWheel(g=9.8, j=1e-4)
        case, course = rimless_wheel(wheel.cycle, 3, wheel)
        trajectory = case.run(2.2, 4e-3)
        hits = [e for e in trajectory.events if e.kind == "touches"]
        chord = 2.0 * math.sin(wheel.half_angle)
        assert [e.t for e in hits] == pytest.approx(course.when("impact")[: len(hits)], abs=2e-4) and len(hits) == 2
        assert [wheel.eta * e.speed / chord for e in hits] == pytest.approx([wheel.cycle] * 2, rel=4e-5)
        assert told(trajectory, "foot0", "leaves") == [hits[0].t] and told(trajectory, "foot1", "leaves") == [hits[1].t]

    def test_off_its_cycle_it_converges_to_it(self):
        """W+^2 - w*^2 shrinks by eta^2 at each impact."""
        wheel = RimlessWheel(g=9.8, j=0.01)
        case, course = rimless_wheel(1.6, 5, wheel)
        trajectory = case.run(2.4, 4e-3)
        hits = [e for e in trajectory.events if e.kind == "touches"]
        after = (
            wheel.eta
            * np.array([1.6 / wheel.eta, *(e.speed for e in hits)])
            / np.array([1.0, *[2.0 * math.sin(wheel.half_angle)] * len(hits)])
        )
        away = after**2 - wheel.cycle**2
        assert len(hits) == 3 and away[1:] / away[:-1] == pytest.approx([wheel.eta**2] * 3, rel=3.6e-4)
        assert case.error(trajectory) < 2.2e-4

    def test_the_model_in_space_takes_its_step_upright(self):
        """urdf/rimless_wheel.urdf, two rows of feet: the motion of the plane, and not a nanometre sideways."""
        wheel = RimlessWheel(j=0.01)
        flat, course = rimless_wheel(1.3, 2, wheel)
        robot = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "rimless_wheel.urdf")
        a, slope = wheel.half_angle, wheel.slope
        hub, rate = flat.state.q, flat.state.v
        # The first of its feet, at a ahead of -z, stands; the second comes next.
        start = free_state(robot, (hub[0], 0.0, hub[1]), (0.0, slope, 0.0), (rate[0], 0.0, rate[1]), (0.0, rate[2], 0.0))
        out = (math.sin(slope), 0.0, math.cos(slope))
        feet = [
            floor_point(
                f"foot{k} {y}", (math.sin(at), y, -math.cos(at)), friction=1.0, frame="wheel", on=rbd.Ground(normal=out)
            )
            for k, at in enumerate((a, 3.0 * a))
            for y in (0.2, -0.2)
        ]
        trajectory = rbd.simulate(start, feet, duration=0.8, step=4e-3, progress=False)
        hits = [e for e in trajectory.events if e.kind == "touches"]
        assert [e.t for e in hits] == pytest.approx(course.when("impact")[:1] * 2, abs=2e-5)
        x, z, _, w = flat.truth(0.8)
        X, _, turning = free_motion(trajectory.state(-1))
        assert X.translation == pytest.approx([x, 0.0, z], abs=5e-5) and abs(X.translation[1]) < 1e-9
        assert turning == pytest.approx([0.0, w, 0.0], abs=1.5e-4)


class TestFallingRod:
    """A thin rod falls from 10 deg from the vertical, its foot on a rough table."""

    @pytest.mark.parametrize("start_deg", [10.0, 0.01])
    def test_held_its_foot_force_turns_at_48_and_vanishes_at_70_degrees(self, start_deg):
        """From upright fx = 3/4 m g sin (3 cos - 2): zero at 48.19 deg; fz = m g (3 cos - 1)^2 / 4: zero at 70.53 deg.

        From rest at th0, energy gives fx = 3/4 m g sin (3 cos - 2 cos th0), and fz is a parabola in cos with its least value
        at cos th = cos(th0) / 3. A foot that is held may be pulled.
        """
        start = math.radians(start_deg)
        case, _ = rod_on_rough_table(1.0) if start_deg == 10.0 else (None, None)
        turns, least = math.degrees(math.acos(2.0 / 3.0 * math.cos(start))), math.degrees(math.acos(math.cos(start) / 3.0))
        if case is None:
            assert [turns, least] == pytest.approx([48.1897, 70.5288], abs=5e-5)
            return
        foot = rbd.PointContact("foot", "body", offset=(-1.0, 0.0, 0.0))
        trajectory = rbd.simulate(case.state, [foot], duration=1.0, step=2e-3, integrator=rbd.TimeStepping(), progress=False)
        lean = np.degrees([flat_motion(trajectory.state(k))[2] for k in range(len(trajectory))]) + 90.0
        fx, fz = trajectory.forces["foot"][:, 0], trajectory.forces["foot"][:, 2]
        assert np.interp(0.0, -fx, lean) == pytest.approx(turns, abs=1e-3)
        assert lean[np.argmin(fz)] == pytest.approx(least, abs=0.4)

    @pytest.mark.parametrize(
        ("friction", "kinds"), [(1.0, ["slips"]), (0.36, ["slips", "sticks", "slips"]), (0.3, ["slips", "sticks", "slips"])]
    )
    def test_with_friction_it_slips_before(self, friction, kinds):
        """Mu 1 slips forwards at 54.8 deg, after the force has turned; mu < .3706 slips back first, and then forwards.

        At .36 it sticks in between; at .3 the slip turns round, told as sticking and slipping at one time. Truth: reduced
        equations, event by event.
        """
        case, course = rod_on_rough_table(friction)
        trajectory = case.run(1.04, 2e-3)
        expected = [t for t, _ in course.events if t < 1.04]
        expected += expected[-1:] * (len(kinds) - len(expected))
        assert [e.kind for e in trajectory.events] == kinds
        assert [e.t for e in trajectory.events] == pytest.approx(expected, abs=2e-4)
        assert case.error(trajectory) < 1e-4

    def test_slipping_feet_feel_coulombs_force(self):
        """|f| = mu N against the slip at every recorded moment, and N of the reduced equations."""
        case, course = rod_on_rough_table(1.0)
        trajectory = case.run(1.04, 2e-3)
        body = OnePoint(10.0, rod_inertia(10.0, 1.0), (-1.0, 0.0), 1.0)
        for k in np.flatnonzero(trajectory.t > 0.89):
            expected = body.force(course.at(float(trajectory.t[k])), "slips+")
            assert trajectory.forces["foot"][k][[0, 2]] == pytest.approx(expected, abs=6e-4)
