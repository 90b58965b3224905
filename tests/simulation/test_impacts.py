"""Impacts: bounces until rest, collisions of two bodies, ends and corners that strike, stops of joints, Painleve's shock."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from closed_forms import bounces
from contact_cases import bouncing_ball, painleve_rod, rocking_block, stopped_pendulum
from courses import G, OnePoint
from flat_bodies import chain, flat_body, flat_motion, flat_state, floor_point, free_state
from scipy.optimize import brentq

import rbd

CORNERS = [(0.2, 0.2, -0.1), (-0.2, 0.2, -0.1), (-0.2, -0.2, -0.1), (0.2, -0.2, -0.1)]


def touched(trajectory: rbd.Trajectory, name: str | None = None) -> list[rbd.simulation.Event]:
    """Events of touch with a speed, of one constraint or of all."""
    return [e for e in trajectory.events if e.kind == "touches" and e.speed > 0.0 and name in (None, e.name)]


class TestBounces:
    """A ball dropped from 1 m with e = 0.8."""

    def test_each_bounce_is_at_its_time_and_height(self):
        """T_k = sqrt(2 h / g) (1 + 2 e + .. + 2 e^k), speed e^k sqrt(2 g h), to rounding at 8 ms: free fall is exact."""
        case = bouncing_ball(0.8)
        trajectory = case.run(3.0, 8e-3)
        told = touched(trajectory)
        assert [e.t for e in told] == pytest.approx(list(bounces(1.0, 0.8, len(told))), abs=1e-10) and len(told) == 6
        speeds = math.sqrt(2.0 * G) * 0.8 ** np.arange(6)
        assert [e.speed for e in told] == pytest.approx(list(speeds), abs=1e-10)
        assert [e.impulse for e in told] == pytest.approx(list(2.0 * 1.8 * speeds), abs=1e-10)
        assert max(case.error(trajectory, k) for k in range(0, len(trajectory), 10)) < 1e-10

    def test_after_infinitely_many_it_rests_without_jitter(self):
        """The last is at sqrt(2 h / g) (1 + e) / (1 - e) = 4.0637 s; from then on nothing moves, and nothing more is told."""
        case = bouncing_ball(0.8)
        trajectory = case.run(4.4, 4e-3)
        last = math.sqrt(2.0 / G) * 1.8 / 0.2
        after = trajectory.t > last + 4e-3
        assert after.sum() > 50
        assert np.abs(trajectory.q[after][:, :3] - [0.0, 0.0, 0.1]).max() < 1e-9 and np.abs(trajectory.v[after]).max() < 1e-12
        assert trajectory.forces["ball"][after][:, 2] == pytest.approx(np.full(after.sum(), 2.0 * G))
        assert max(e.t for e in trajectory.events) < last + 4e-3 and len(trajectory.events) < 60

    def test_a_brick_dropped_flat_rises_flat(self, brick):
        """Four corners strike at once: v_n+ = -e v_n- of all, and no turn; without bounce all is over at once."""
        corners = [floor_point(f"corner{i}", p, friction=0.4, frame="box") for i, p in enumerate(CORNERS)]
        start = free_state(brick, (0.0, 0.0, 0.3))
        hit, speed = math.sqrt(0.4 / G), math.sqrt(0.4 * G)
        for e in (0.0, 0.5):
            trajectory = rbd.simulate(start, corners, duration=0.3, step=4e-3, restitution=e, progress=False)
            told = touched(trajectory)
            assert [x.t for x in told] == pytest.approx([hit] * 4, abs=1e-12)
            assert sum(x.impulse for x in told) == pytest.approx(10.0 * (1.0 + e) * speed, rel=1e-12)
            s = 0.3 - hit
            height, v = (0.5 * speed * s - G * s * s / 2.0, 0.5 * speed - G * s) if e else (0.0, 0.0)
            assert trajectory.q[-1, :3] == pytest.approx([0.0, 0.0, 0.1 + height], abs=1e-9)
            assert trajectory.v[-1] == pytest.approx([0.0, 0.0, v, 0.0, 0.0, 0.0], abs=1e-10)


class TestTwoBodies:
    """Balls in a row, on sliders along x."""

    def row(self, masses) -> tuple[rbd.model.checked_model.CheckedModel, list[rbd.PointContact]]:
        """Balls of 0.1 m, each touching the next."""
        n = len(masses)
        joints = [(f"slide{i}", pin.JointModelPX(), m, [1.0, 1.0, 1.0]) for i, m in enumerate(masses)]
        robot = chain(joints, names=[f"ball{i}" for i in range(n)], name="row")
        hits = [
            rbd.PointContact(
                f"hit{i}", f"ball{i}", offset=(0.1, 0.0, 0.0), on=rbd.Body(f"ball{i + 1}", normal=(-1.0, 0.0, 0.0)),
                anchor=(-0.1, 0.0, 0.0), friction=0.0,
            )
            for i in range(n - 1)
        ]  # fmt: skip
        return robot, hits

    @pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
    @pytest.mark.parametrize("heavy", [1.0, 3.0])
    def test_a_central_impact_shares_the_momentum(self, heavy, e):
        """V1+ = (m1 - e m2) / (m1 + m2) v, v2+ = (1 + e) m1 / (m1 + m2) v, at 0.15 s."""
        robot, hits = self.row((1.0, heavy))
        start = rbd.State(robot, np.array([0.0, 0.5]), np.array([2.0, 0.0]))
        trajectory = rbd.simulate(start, hits, duration=0.2, step=8e-3, restitution=e, progress=False)
        (told,) = touched(trajectory)
        assert told.t == pytest.approx(0.15, abs=1e-12) and told.speed == pytest.approx(2.0)
        expected = 2.0 / (1.0 + heavy) * np.array([1.0 - e * heavy, 1.0 + e])
        assert trajectory.v[-1] == pytest.approx(expected, abs=1e-12)
        assert trajectory.q[-1] == pytest.approx(np.array([0.3, 0.5]) + 0.05 * expected, abs=1e-12)

    @pytest.mark.parametrize("struck", [1, 2])
    def test_newtons_cradle_passes_on_as_many_balls_as_arrive(self, struck):
        """Five balls 0.1 mm apart, e = 1: what arrives on the left leaves on the right, the others stay."""
        robot, hits = self.row((1.0,) * 5)
        q, v = 0.2001 * np.arange(5), np.zeros(5)
        q[:struck] -= 0.1
        v[:struck] = 1.0
        trajectory = rbd.simulate(rbd.State(robot, q, v), hits, duration=0.2, step=4e-3, restitution=1.0, progress=False)
        expected = np.zeros(5)
        expected[5 - struck :] = 1.0
        assert trajectory.v[-1] == pytest.approx(expected, abs=1e-9)
        assert len(touched(trajectory)) == struck * (5 - struck)

    def test_balls_that_touch_are_struck_at_once(self):
        """Newton's law for all contacts together: (-0.6, 0.4, 0.4, 0.4, 0.4), and no cradle.

        Only the one that approaches rebounds. Momentum 1 and energy 1/2 are kept by both answers; the law of a rigid instant
        cannot see the wave that decides.
        """
        robot, hits = self.row((1.0,) * 5)
        q, v = 0.2 * np.arange(5), np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        q[0] -= 0.1
        trajectory = rbd.simulate(rbd.State(robot, q, v), hits, duration=0.2, step=4e-3, restitution=1.0, progress=False)
        assert trajectory.v[-1] == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4], abs=1e-9)


class TestOneEnd:
    """A rod of 1 kg and 2 m, raised by 0.6 rad, whose lower end strikes a rough floor as it turns and flies."""

    start = np.array([0.0, math.sin(0.6) + 0.2, -0.6, 1.0, -2.0, 0.5])

    @pytest.mark.parametrize("e", [0.0, 0.5])
    @pytest.mark.parametrize("friction", [0.1, 0.3, 1.0])
    def test_an_oblique_impact_is_newtons_and_coulombs(self, friction, e):
        """The impulse (p_t, p_n) stops the end's tangent if it is within the cone, else it is (-+mu, 1) p_n.

        Both happen here. The flight before is free, so that time, speed and impulse are exact.
        """
        body = OnePoint(1.0, 1.0 / 3.0, (-1.0, 0.0), friction)
        course = body.course(self.start, 2.0, "open", {"hits": lambda t, y: float(y[1] + body.arm(y[2])[1])})
        (hit,) = course.when("hits")
        before = course.at(hit)
        after, impulse, mode = body.impact(before, e)
        state = flat_state(flat_body(1.0, 1.0 / 3.0), self.start[:3], self.start[3:])
        tip = floor_point("tip", (-1.0, 0.0), friction=friction)
        trajectory = rbd.simulate(state, [tip], duration=hit + 1e-6, step=4e-3, restitution=e, progress=False)
        (told,) = touched(trajectory)
        assert told.t == pytest.approx(hit, abs=1e-12) and told.speed == pytest.approx(-body.velocity(before)[1], abs=1e-11)
        assert told.impulse == pytest.approx(impulse[1], rel=1e-11)
        assert flat_motion(trajectory.state(-1)) == pytest.approx(after, abs=1e-4)  # a millionth of a second later
        assert mode == {(0.1, 0.0): "slips", (0.1, 0.5): "slips", (0.3, 0.5): "slips"}.get((friction, e), "sticks")


class TestOneCorner:
    """The brick strikes the floor with one corner, turned and spinning, in space."""

    turn, v, w = np.array([0.3, 0.5, 0.2]), np.array([1.0, 0.3, 0.0]), np.array([1.0, 2.0, 3.0])

    def before(self, brick) -> tuple[rbd.State, np.ndarray, np.ndarray, int]:
        """(a state a hair above the floor, the corners' Jacobian there, their velocities, which corner is lowest)."""
        state = free_state(brick, (0.0, 0.0, 1.0), self.turn, self.v - [0.0, 0.0, 2.0], self.w)
        places = [state.frame("box", p) for p in CORNERS]
        low = int(np.argmin([f.X_WF.translation[2] for f in places]))
        down = places[low].X_WF.translation[2] - 1e-6
        state = free_state(brick, (0.0, 0.0, 1.0 - down), self.turn, self.v - [0.0, 0.0, 2.0], self.w)
        J = state.frame("box", CORNERS[low]).J[:3]
        return state, J, J @ state.v, low

    def impulse(self, D, u, friction, e) -> tuple[np.ndarray, bool]:
        """(impulse (3,), whether it slips): by hand, the direction of slip after it as the root of one equation."""
        need = np.array([0.0, 0.0, -e * u[2]]) - u
        p = np.linalg.solve(D, need)
        if np.hypot(*p[:2]) <= friction * p[2]:
            return p, False

        def slid(x: float) -> tuple[np.ndarray, float, float]:
            """(impulse, speed across, speed along) where the friction is against the direction x."""
            c, s = math.cos(x), math.sin(x)
            ray = np.array([-friction * c, -friction * s, 1.0])
            p = ray * (need[2] / (D[2] @ ray))
            v = u + D @ p
            return p, c * v[1] - s * v[0], c * v[0] + s * v[1]

        grid = np.linspace(-math.pi, math.pi, 101)
        roots = [brentq(lambda x: slid(x)[1], a, b) for a, b in pairwise(grid) if slid(a)[1] * slid(b)[1] < 0.0]
        (found,) = [slid(x)[0] for x in roots if slid(x)[2] > 0.0]
        return found, True

    @pytest.mark.parametrize("e", [0.0, 0.6])
    @pytest.mark.parametrize(("friction", "slips"), [(0.2, True), (2.0, False)])
    def test_it_sticks_or_slips_in_the_cone(self, brick, friction, slips, e):
        """M (v+ - v-) = J^T p with p in the cone, against the slip after it; u_n+ = -e u_n-. Measured 2 us after it."""
        state, J, u, low = self.before(brick)
        p, slipped = self.impulse(J @ np.linalg.solve(state.M, J.T), u, friction, e)
        assert slipped == slips
        corners = [floor_point(f"corner{i}", c, friction=friction, frame="box") for i, c in enumerate(CORNERS)]
        trajectory = rbd.simulate(state, corners, duration=2e-6, step=2e-6, restitution=e, progress=False)
        (told,) = touched(trajectory)
        assert told.name == f"corner{low}" and told.t == pytest.approx(1e-6 / -u[2], rel=1e-3)
        assert told.impulse == pytest.approx(p[2], rel=1e-4)
        assert trajectory.v[-1] == pytest.approx(state.v + np.linalg.solve(state.M, J.T @ p), abs=5e-4)

    def test_it_tumbles_to_rest_on_a_face(self, brick):
        """Impacts and friction only take energy; in the end it lies on its face at m g times half its height, and stays."""
        state = free_state(brick, (0.0, 0.0, 0.6), self.turn, self.v, self.w)
        corners = [floor_point(f"corner{i}", c, friction=0.4, frame="box") for i, c in enumerate(CORNERS)]
        trajectory = rbd.simulate(state, corners, duration=2.0, step=4e-3, progress=False)
        assert np.diff(trajectory.energy).max() < 1e-4  # J of 66: second order in the step
        assert trajectory.energy[-1] == pytest.approx(10.0 * G * 0.1, abs=1e-7)
        assert np.abs(trajectory.v[-1]).max() < 1e-12 and trajectory.residuals["penetration"].max() < 1e-7


class TestTheOtherEnd:
    """A body on two feet at -b and b, the left one down, tilts down until the right one strikes; radius of gyration k."""

    def fall(self, half, gyration, step=2e-3, duration=0.4) -> tuple[rbd.Trajectory, float]:
        """From rest with the right foot up by 0.1 rad; the rate at which it strikes, from energy."""
        m, tilt = 10.0, 0.1
        robot = flat_body(m, m * gyration**2)
        state = flat_state(robot, (half * math.cos(tilt), half * math.sin(tilt), -tilt))
        feet = [floor_point(name, (x, 0.0), friction=0.0) for name, x in (("left", -half), ("right", half))]
        # The left foot slides back as the middle comes straight down: w^2 (k^2 + b^2) / 2 = g b sin(tilt) when flat
        rate = math.sqrt(2.0 * G * half * math.sin(tilt) / (gyration**2 + half**2))
        return rbd.simulate(state, feet, duration=duration, step=step, progress=False), rate

    def test_it_lifts_where_the_feet_are_within_the_radius_of_gyration(self):
        """B < k: the right foot's impulse alone, 2 b w m k^2 / (k^2 + b^2), leaves the left one rising: it has left."""
        half, gyration = 0.5, 1.0 / math.sqrt(3.0)
        trajectory, rate = self.fall(half, gyration)
        first, second = trajectory.events[:2]
        impulse = 10.0 * 2.0 * half * rate * gyration**2 / (gyration**2 + half**2)
        assert (first.name, first.kind, second.name, second.kind) == ("right", "touches", "left", "leaves")
        assert first.t == second.t and first.speed == pytest.approx(2.0 * half * rate, rel=1e-5)
        assert first.impulse == pytest.approx(impulse, rel=1e-5)
        again = touched(trajectory, "left")[0]  # the left foot comes down once more, slower by (k^2 - b^2) / (k^2 + b^2)
        slower = (gyration**2 - half**2) / (gyration**2 + half**2)
        assert again.speed == pytest.approx(slower * first.speed, rel=1e-4)

    def test_it_is_pressed_down_where_they_are_beyond_it(self):
        """A rod on its ends, b > k: both have impulses, pA = m v / 6 and pB = m v / 3 for v = 2 l w, and the rod lies still."""
        half = 1.0
        trajectory, rate = self.fall(half, half / math.sqrt(3.0))
        told = touched(trajectory)
        assert [e.name for e in told] == ["right"]
        assert told[0].speed == pytest.approx(2.0 * rate, rel=1e-5)
        assert told[0].impulse == pytest.approx(10.0 * 2.0 * rate / 3.0, rel=1e-5)
        assert np.abs(trajectory.v[-1]).max() < 1e-12
        assert [trajectory.forces[n][-1][2] for n in ("left", "right")] == pytest.approx([5.0 * G, 5.0 * G])

    def test_a_slender_block_rocks_as_housner_says(self):
        """Each impact leaves 1 - 3/2 sin^2(al) of the rate; times of the first four, and rest on both edges in the end.

        Source: Housner 1963, see `closed_forms`; the swing between impacts is integrated apart.
        """
        case, course = rocking_block()
        trajectory = case.run(2.6, 4e-3)
        told, expected = touched(trajectory), course.when("impact")
        assert [e.t for e in told[:4]] == pytest.approx(expected[:4], abs=1.2e-4)
        kept = [b.speed / a.speed for a, b in zip(told, told[1:4], strict=False)]
        assert kept == pytest.approx([1.0 - 1.5 * 0.04 / (0.04 + 0.25)] * 3, rel=1e-4)
        assert case.error(trajectory) < 5e-5
        assert np.abs(trajectory.v[-1]).max() < 1e-10 and trajectory.t[-1] > expected[-1] + 0.1


class TestStopsOfJoints:
    """A pendulum, 1 kg on 1 m, released at 1 rad, that runs into a stop."""

    @pytest.mark.parametrize(("stop", "e"), [(0.3, 0.5), (0.3, 0.0), (-0.3, 0.0)])
    def test_it_bounces_or_stays_or_swings_back(self, stop, e):
        """W_+ = -e w_-; the force of the stop that it rests on is m g l sin(stop)."""
        case, course = stopped_pendulum(stop, e)
        trajectory = case.run(1.2, 2e-3)
        told, expected = touched(trajectory), course.when("impact")
        assert len(told) == {0.5: 2, 0.0: 1}[e]
        assert [x.t for x in told] == pytest.approx(expected[: len(told)], abs=4e-6)
        before = math.sqrt(2.0 * G * (math.cos(stop) - math.cos(1.0)))
        assert told[0].speed == pytest.approx(before, rel=1e-5)
        assert told[0].impulse == pytest.approx((1.0 + e) * before, rel=1e-5)
        assert case.error(trajectory) < 1.3e-5
        rests = stop > 0.0 and e == 0.0
        assert (trajectory.modes["stop"][-1] == "pushes") == rests
        if rests:
            assert np.abs(trajectory.v[trajectory.t > expected[0] + 2e-3]).max() < 1e-12
            assert trajectory.forces["stop"][-1] == pytest.approx([G * math.sin(stop)], abs=1e-6)

    def test_restitution_is_each_constraints_own(self):
        """{name: e} gives the bounce to that one alone."""
        case, course = stopped_pendulum(0.3, 0.5)
        own = case.run(1.2, 4e-3, restitution={"stop": 0.5})
        assert np.array_equal(own.q, case.run(1.2, 4e-3).q)
        assert len(touched(case.run(1.2, 4e-3, restitution={}))) == 1


class TestPainlevesRod:
    """Pushed ahead of itself on ground with mu > 4/3 at tan th = 2, no acceleration is possible: [Painleve1895]."""

    @pytest.mark.parametrize("friction", [2.0, 4.0])
    def test_it_jams_and_is_stopped_as_by_a_blow(self, friction):
        """A tangential shock: the impulse -D^-1 u that stops the tip, within the cone; 1/2 u D^-1 u = 0.2 J are gone at once.

        Then it turns about the tip, which sticks. The blow takes one step: first order. Sources: [GenotBrogliato1999].
        """
        state, contacts, body, start = painleve_rod(friction, math.atan(2.0))
        D, u = body.delassus(start[2]), body.velocity(start)
        p = -np.linalg.solve(D, u)
        assert p == pytest.approx([0.4, 0.3]) and u @ np.linalg.solve(D, u) / 2.0 == pytest.approx(0.2)
        ax, az = body.arm(start[2])
        after = start + np.array([0.0, 0.0, 0.0, p[0], p[1], (az * p[0] - ax * p[1]) / body.inertia])
        truth = body.course(after, 0.3, "sticks")
        errors = []
        for step in (4e-3, 2e-3):
            trajectory = rbd.simulate(state, contacts, duration=0.2, step=step, progress=False)
            assert np.isfinite(trajectory.q).all() and np.isfinite(trajectory.v).all()
            assert trajectory.energy[0] - trajectory.energy[1] == pytest.approx(0.2, abs=2.0 * step)
            errors.append(np.abs(flat_motion(trajectory.state(-1)) - truth.at(0.2)).max())
        assert errors[1] < 2e-3 and errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)

    def test_below_four_thirds_it_slides_to_a_stop(self):
        """Mu = 1.2: a large force, then it sticks at 5.7 ms; 0.208 J go."""
        state, contacts, body, start = painleve_rod(1.2, math.atan(2.0))
        truth = body.course(start, 0.2, "slips-")
        trajectory = rbd.simulate(state, contacts, duration=0.1, step=5e-4, progress=False)
        told = [e for e in trajectory.events if e.kind == "sticks"]
        assert told[0].t == pytest.approx(truth.when("sticks")[0], abs=5e-6)
        assert np.abs(flat_motion(trajectory.state(-1)) - truth.at(0.1)).max() < 1e-5


class TestWhatHolds:
    """Constraints that hold, in time stepping, at the start and against others."""

    def test_a_velocity_that_it_does_not_allow_is_struck_off_at_the_start(self):
        """The nearest velocity in |.|_M on the loop, v - M^-1 J^T (J M^-1 J^T)^-1 J v; nothing else has struck."""
        robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)
        state = robot.at("assembled").with_velocity(np.array([1.0, 2.0, -3.0]))
        J = np.vstack([c.rows(state).J for c in robot.loops()])
        back = np.linalg.solve(state.M, J.T)
        expected = state.v - back @ np.linalg.solve(J @ back, J @ state.v)
        by = rbd.TimeStepping()
        trajectory = rbd.simulate(state, robot.loops(), duration=0.01, step=1e-3, integrator=by, progress=False)
        assert np.abs(J @ state.v).max() > 0.1
        assert trajectory.v[0] == pytest.approx(expected, abs=1e-12)
        assert trajectory.events == ()
        assert np.abs(trajectory.energy - trajectory.energy[0]).max() < 1e-4 * trajectory.kinetic[0]

    def test_a_floor_that_rises_under_what_is_locked_has_no_motion(self):
        """Both are named."""
        lift = floor_point("lift", (0.0, -0.1), friction=0.0, on=rbd.Ground(velocity=(0.0, 0.0, 0.5)), anchor=(0.0, 0.0, -0.1))
        state = rbd.State(flat_body(1.0, 0.1), np.zeros(3))
        with pytest.raises(
            rbd.errors.SimulationStopped, match="no velocity satisfies the contact law together with lock, lift: "
        ):
            rbd.simulate(state, [rbd.JointLock("lock", "z", position=0.0), lift], duration=0.1, step=0.01, progress=False)

    def test_rows_of_which_one_holds_and_one_pushes_do_each_their_part(self):
        """A constraint of the user: x stays under 5 N, z rests until 30 N lift it, and then z'' = 30 / m - g."""

        class Wire:
            name = "wire"

            def rows(self, state):
                cone = rbd.problem.Product([rbd.problem.Free(1), rbd.problem.NonNegative(1)])
                return rbd.Rows(self.name, np.eye(3)[:2], np.zeros(2), cone, error=state.q[:2].copy())

        trajectory = rbd.simulate(
            rbd.State(flat_body(2.0, 0.1), np.zeros(3)), [Wire()], duration=0.4, step=0.01, progress=False,
            external=lambda state, t: np.array([5.0, 30.0 if t >= 0.2 - 1e-9 else 0.0, 0.0]),
        )  # fmt: skip
        assert trajectory.forces["wire"][10] == pytest.approx([-5.0, 2.0 * G])
        assert trajectory.forces["wire"][-1] == pytest.approx([-5.0, 0.0])
        assert trajectory.q[-1] == pytest.approx([0.0, 0.5 * (15.0 - G) * 0.2**2, 0.0], abs=1e-12)

    def test_a_velocity_beyond_all_numbers_is_told_with_what_it_would_strike(self):
        """1e-38 N on 1e-200 kg against a stop."""
        robot = chain([("x", pin.JointModelPX(), 1e-200, [0.0] * 3)], names=("dust",), name="dust")
        with pytest.raises(rbd.errors.SimulationStopped, match="the velocity of stop is not finite at this state"):
            rbd.simulate(
                rbd.State(robot, np.zeros(1)), [rbd.JointLimit("stop", "x", upper=0.0)], duration=0.1, step=0.01,
                external=lambda state, t: np.array([1e-38]), progress=False,
            )  # fmt: skip
