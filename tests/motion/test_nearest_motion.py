"""The nearest possible motion: possible at each frame, near its reference, and the reference itself where that is possible."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.errors import InputError, NoSolution
from rbd.motion import CAUSES, Motion, MotionDifference, check_motion, find_contacts, minimum_jerk
from rbd.motion.balanced_com import REST_FRAMES, com_shift, held_places, nearest_inside
from rbd.motion.frame_terms import FrameTerms
from rbd.motion.nearest import standing, stretches

GRAVITY = 9.81


@pytest.fixture(scope="module")
def talos() -> rbd.Robot:
    return rbd.load_robot("talos")


def way(u: float) -> float:
    """From 0 to 1 for u from 0 to 1, at rest at both ends."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def on_soles(robot: rbd.Robot, com: Callable[[float], Array], duration: float) -> Motion:
    """Talos on its soles, the torso upright, with a centre of mass that moves from where it stands."""
    start, frames = robot.standing(), [sole.frame for sole in robot.soles()]
    at = [start.frame(name).X_WF for name in frames]

    def q(t: float) -> Array:
        state = start
        for _ in range(8):
            Ag, _, mass = state.centroidal()
            J = np.concatenate([*(state.frame(name).J for name in frames), Ag[:3] / mass, np.eye(robot.nv)[3:6]])
            feet = [
                np.concatenate([goal.translation - X.translation, pin.log3(goal.rotation @ X.rotation.T)])
                for goal, X in zip(at, [state.frame(name).X_WF for name in frames], strict=True)
            ]
            off = np.concatenate([*feet, start.com + com(t) - state.com, -pin.log3(state.base_pose().rotation)])
            W = np.linalg.inv(np.linalg.cholesky(state.M)).T
            state = rbd.State(robot, pin.integrate(robot.model, state.q, W @ np.linalg.lstsq(J @ W, off, rcond=1e-9)[0]))
        return state.q

    return Motion.from_function(robot, q, np.linspace(0.0, duration, round(60 * duration) + 1))


def wave(direction: Array, times: int, duration: float) -> Callable[[float], Array]:
    """There and back."""
    return lambda t: np.array(direction) * (way(2.0 * times * t / duration) - way(2.0 * times * t / duration - 1.0))


def causes(report: rbd.MotionReport) -> set[str]:
    return {cause for cause in CAUSES if report.of_cause(cause).any()}


class TestPossible:
    """A reference that is possible is its own nearest motion."""

    def test_a_squat_stays_as_it_is(self, squat: rbd.Trajectory) -> None:
        """Down by 6 cm and up: a fifth of a millimetre off, by the steps of the integration."""
        reference = Motion.of_trajectory(squat[::5])
        nearest = check_motion(reference).nearest_motion()
        off = MotionDifference.of(nearest, reference)
        assert np.array_equal(nearest.t, reference.t)
        assert np.linalg.norm(off.base, axis=1).max() < 2e-4  # m, of 60 mm
        assert np.abs(off.joints).max() < 1e-3
        assert check_motion(nearest).share_possible == 1.0

    def test_four_steps_stay_as_they_are(self, four_steps: rbd.Trajectory) -> None:
        """Its feet lift a frame late, and are back within a step."""
        reference = Motion.of_trajectory(four_steps[::5])
        report = check_motion(reference)
        nearest = report.nearest_motion()
        off = MotionDifference.of(nearest, reference)
        assert np.linalg.norm(off.base, axis=1).max() < 4e-3  # m, of 0.45 m
        assert np.linalg.norm(off.base[-1]) < 5e-4
        again = check_motion(nearest)
        assert causes(report) == {"slides"}
        assert again.share_possible == 1.0
        lifted = [nearest.contacts.of_contact(name) for name in ("left_sole", "right_sole")]
        assert [len(stretches(~on)) for on in lifted] == [2, 2]
        # The centre of pressure that was not on the soles' edges is where it was.
        assert again.missing_scaled.max() < 1e-9

class TestFaults:
    """References that are not possible, each for a known cause."""

    def test_a_walk_that_is_too_fast(self, four_steps: rbd.Trajectory) -> None:
        """At 1.6 times its speed four steps tip in every other frame; a sway of 25 mm to the side balances them."""
        slow = Motion.of_trajectory(four_steps[::5])
        reference = Motion.of_arrays(slow.robot, slow.t / 1.6, slow.q)
        report = check_motion(reference)
        nearest = report.nearest_motion()
        assert "tips" in causes(report)
        assert report.share_possible < 0.5
        assert check_motion(nearest).share_possible == 1.0
        off = MotionDifference.of(nearest, reference)
        assert 0.01 < np.linalg.norm(off.com[:, :2], axis=1).max() < 0.05
        assert np.linalg.norm(nearest.q[-1, :2] - reference.q[-1, :2]) < 0.01  # it arrives
        assert any("shifted by up to" in note for note in nearest.notes)

    def test_too_little_friction(self, talos: rbd.Robot) -> None:
        """A sway by 4 cm within 0.8 s uses friction 0.1 to its limit, and not beyond."""
        reference = on_soles(talos, wave([0.0, 0.04, 0.0], 1, 0.8), 0.8)
        report = check_motion(reference, friction=0.1)
        again = check_motion(report.nearest_motion(), friction=0.1)
        assert "friction" in causes(report)
        assert again.share_possible == 1.0
        assert 0.7 < np.nanmax(again.used_friction) <= 1.0 + 1e-6  # pyramids inside the cones
        assert 5e-3 < np.abs(MotionDifference.of(again.motion, reference).com[:, 1]).max() < 0.04

    def test_a_crouch_that_is_too_fast(self, talos: rbd.Robot) -> None:
        """The reference falls faster than gravity lets it; the nearest motion falls with gravity at most."""
        reference = on_soles(talos, wave([0.0, 0.0, -0.2], 1, 0.5), 0.5)
        report = check_motion(reference)
        nearest = report.nearest_motion()
        again = check_motion(nearest)
        assert "floats" in causes(report)
        assert again.share_possible == 1.0
        down = [com_acceleration(nearest, i)[2] for i in range(nearest.n)]
        assert min(com_acceleration(reference, i)[2] for i in range(reference.n)) < -1.2 * GRAVITY
        assert -GRAVITY - 1e-6 <= min(down) < -0.7 * GRAVITY
        assert (np.abs(again.tau) <= talos.effort_limit * 1.001).all()

    @pytest.mark.parametrize("duration", [0.6, 2.0])
    def test_a_centre_of_mass_outside_the_feet(self, talos: rbd.Robot, duration: float) -> None:
        """A lean by 16 cm, slow and fast, ends over the toes: the zero-moment point stays within the soles."""
        reference = on_soles(talos, wave([0.16, 0.0, 0.0], 1, duration), duration)
        report = check_motion(reference)
        nearest = report.nearest_motion()
        again = check_motion(nearest)
        assert "tips" in causes(report)
        assert again.share_possible == 1.0
        assert nearest.n == reference.n
        assert np.nanmin(again.edge_margin) > -1e-9
        assert nearest.a[:, 0].max() > 0.01  # it leans as far as it can

    def test_motors_that_are_too_weak(self, four_steps: rbd.Trajectory) -> None:
        """With a third of its torques G1 cannot walk so: it falls, ends there, and says when and why."""
        reference = Motion.of_trajectory(four_steps[::5])
        report = check_motion(reference, torque_limits=0.3)
        nearest = report.nearest_motion()
        assert "motor" in causes(report)
        assert nearest.n < reference.n
        assert np.array_equal(nearest.t, reference.t[: nearest.n])
        [told] = [note for note in nearest.notes if "it falls" in note]
        assert f"ends after {nearest.t[-1]:.3f} s" in told
        again = check_motion(nearest, torque_limits=0.3)
        assert causes(again) <= {"self-collision"}  # it does not know of its own bodies
        assert "before its reference" in str(MotionDifference.of(nearest, reference))

    def test_joints_beyond_their_limits_begin_at_them(self, squat: rbd.Trajectory) -> None:
        """A joint that is beyond its limit all the time stays at it."""
        reference = Motion.of_trajectory(squat[::5])
        robot = reference.robot
        elbow = robot.joints["left_elbow_joint"]
        top = float(robot.model.upperPositionLimit[elbow.q][0])
        q = reference.q.copy()
        q[:, elbow.q] = top + 0.1
        report = check_motion(Motion.of_arrays(robot, reference.t, q), self_collision=False)
        nearest = report.nearest_motion()
        assert causes(report) == {"joint limit"}
        assert check_motion(nearest, self_collision=False).share_possible == 1.0
        assert nearest.q[:, elbow.q] == pytest.approx(top, abs=1e-3)

    def test_without_limits_of_torque(self, squat: rbd.Trajectory) -> None:
        """As with them, where they are not reached."""
        reference = Motion.of_trajectory(squat[::5]).cut(0.0, 0.2)
        free = check_motion(reference, torque_limits=False).nearest_motion()
        assert np.abs(MotionDifference.of(free, reference).base).max() < 2e-4

def com_acceleration(motion: Motion, i: int) -> Array:
    Ag, bias, mass = motion.state(i).centroidal()
    return (Ag[:3] @ motion.a[i] + bias[:3]) / mass


class TestItself:
    """What holds of every nearest motion."""

    def test_velocities_and_accelerations_belong_to_it(self, four_steps: rbd.Trajectory) -> None:
        """Between frames without a change of contacts q changes by v, and v by a, to the order of the step."""
        reference = Motion.of_trajectory(four_steps[:150:5])
        m = check_motion(reference).nearest_motion()
        h = m.t[1] - m.t[0]
        moved = np.array([pin.difference(m.robot.model, m.q[i], m.q[i + 1]) for i in range(m.n - 1)])
        assert np.abs(moved - 0.5 * h * (m.v[1:] + m.v[:-1])).max() < 1e-4
        assert np.abs(m.v[1:] - m.v[:-1] - 0.5 * h * (m.a[1:] + m.a[:-1])).max() < 1e-2

    def test_it_repeats_bit_by_bit(self, squat: rbd.Trajectory) -> None:
        """The same report gives the same bits."""
        report = check_motion(Motion.of_trajectory(squat[::5]).cut(0.0, 0.3))
        one, other = report.nearest_motion(), report.nearest_motion()
        assert np.array_equal(one.q, other.q)
        assert np.array_equal(one.a, other.a)

    def test_a_shorter_step_comes_nearer(self, squat: rbd.Trajectory) -> None:
        """What is left of a possible motion is the integration's."""
        reference = Motion.of_trajectory(squat[::5]).cut(0.0, 0.8)
        report = check_motion(reference)
        coarse, fine = (
            np.abs(MotionDifference.of(report.nearest_motion(step=step), reference).joints).max() for step in (0.02, 0.005)
        )
        assert fine < 0.5 * coarse

    @pytest.mark.parametrize(("way_", "friction"), [([0.16, 0.0, 0.0], 0.7), ([0.0, 0.04, 0.0], 0.1)])
    def test_a_simulation_follows_it(self, talos: rbd.Robot, way_: list[float], friction: float) -> None:
        """The reference falls over its toes, or slips; this one is tracked to 0.2 mm, its soles stay within a millimetre."""
        reference = on_soles(talos, wave(way_, 1, 0.8), 0.8)
        nearest = check_motion(reference, friction=friction).nearest_motion()
        soles = talos.soles(friction=friction)
        follow = rbd.control.TrackingController(nearest, soles, torques="nearest")
        run = rbd.simulate(nearest.state(0), soles, duration=0.8, step=4e-3, controller=follow, progress=False)
        off = pin.difference(talos.model, nearest.q[-1], run.q[-1])
        assert np.abs(off[:3]).max() < 2e-4  # m
        moved = [np.ptp(run.points[sole.name], axis=0).max() for sole in soles]
        assert max(moved) < 1e-3  # m
        assert not follow.clipped

    @pytest.mark.parametrize("margin", [0.0, 0.2])
    def test_its_margin_is_not_used(self, talos: rbd.Robot, margin: float) -> None:
        """Soles are smaller by it: the centre of pressure is as far from their edges, and on them without it."""
        reference = on_soles(talos, wave([0.16, 0.0, 0.0], 1, 0.6), 0.6)
        nearest = check_motion(reference).nearest_motion(margin=margin)
        again = check_motion(nearest)
        half = 0.5 * float(np.ptp(talos.soles()[0].corners[:, 0]))  # from a sole's middle to its toes
        # The check shares the same wrench otherwise between the feet, so that each is a little nearer to its edge.
        assert 0.9 * margin * half - 1e-6 < np.nanmin(again.edge_margin) < margin * half + 1e-4

    @pytest.mark.parametrize("margin", [-0.1, 1.0, np.nan, "x"])
    def test_bad_margins_are_refused(self, squat: rbd.Trajectory, margin: object) -> None:
        """No share, or one that leaves nothing."""
        report = check_motion(Motion.of_trajectory(squat[:20:5]))
        with pytest.raises(InputError, match="margin"):
            report.nearest_motion(margin=margin)  # type: ignore[arg-type]

    @pytest.mark.parametrize("step", [0.0, -1.0, 1.0, np.nan, "x"])
    def test_bad_steps_are_refused(self, squat: rbd.Trajectory, step: object) -> None:
        """No step, or one that no controller has."""
        report = check_motion(Motion.of_trajectory(squat[:20:5]))
        with pytest.raises(InputError, match="step"):
            report.nearest_motion(step=step)  # type: ignore[arg-type]

    def test_torques_above_the_limits_of_the_file_are_refused(self, squat: rbd.Trajectory) -> None:
        """The program of a step knows shares of the limits up to 1."""
        report = check_motion(Motion.of_trajectory(squat[:20:5]), torque_limits=1.5)
        with pytest.raises(InputError, match="at most 1"):
            report.nearest_motion()

    def test_a_robot_that_lies_where_nothing_carries_it(self) -> None:
        """In the air from its first frame on it falls freely, and ends when it is far below the reference."""
        solo = rbd.load_robot("solo12")
        high = solo.standing().q + 1.0 * np.eye(solo.nq)[2]
        low = solo.standing().q
        reference = minimum_jerk(solo, [high, high, low, low], [0.0, 0.45, 0.5, 1.0])  # it stands in half of the frames
        nearest = check_motion(reference).nearest_motion()
        t = nearest.t[-1]
        assert "it falls" in nearest.notes[-1]
        fell = reference.state(0).com[2] - nearest.state(-1).com[2]
        assert fell == pytest.approx(0.5 * GRAVITY * t**2, abs=1e-4)  # its legs move: to the order of the step
        assert 0.3 < t < 0.4  # to half the height of the reference

    def test_contacts_do_not_begin_before_their_feet_are_down(self, four_steps: rbd.Trajectory) -> None:
        """A timeline lets a point touch up to 10 mm above the floor; what is followed stands within a millimetre of it."""
        lanes = find_contacts(Motion.of_trajectory(four_steps[::5]))
        stands = standing(lanes)
        assert lanes.heights[lanes.touches].max() > 3e-3
        low = np.where(stands.touches[:, :4].any(axis=1), lanes.heights[:, :4].min(axis=1), 0.0)
        assert low.max() < 1.1e-3
        assert (stands.touches <= lanes.touches).all()


class TestShift:
    """The shift of the centre of mass, in closed form."""

    @pytest.fixture
    def terms(self, talos: rbd.Robot) -> tuple[Array, FrameTerms, Array, Array]:
        """(t, terms, places of the soles' corners, touches) of Talos at rest for 2 s."""
        q = np.repeat(talos.standing().q[None], 121, axis=0)
        zero = np.zeros((121, talos.nv))
        motion = Motion.of_arrays(talos, np.linspace(0.0, 2.0, 121), q, zero, zero)
        lanes = find_contacts(motion)
        return motion.t, FrameTerms.of(talos, q, zero, zero, None), lanes.places, lanes.touches

    def test_a_robot_that_balances_is_not_shifted(self, terms: tuple[Array, FrameTerms, Array, Array]) -> None:
        """Exactly zero."""
        t, found, places, touches = terms
        shift = com_shift(t, found, places, touches, 0.0)
        assert not shift.s.any()
        assert not shift.acceleration.any()

    def test_feet_elsewhere_shift_it_by_as_much(self, terms: tuple[Array, FrameTerms, Array, Array]) -> None:
        """At rest the zero-moment point is below the centre of mass: both move alike, and stay."""
        t, found, places, touches = terms
        far = places + [0.5, 0.0, 0.0]
        shift = com_shift(t, found, far, touches, 0.0)
        inside = nearest_inside(found.com[0, :2], far[0][touches[0], :2]) - found.com[0, :2]
        assert shift.s == pytest.approx(np.tile(inside, (len(t), 1)), abs=1e-9)
        assert np.abs(shift.acceleration).max() < 1e-9

    def test_it_looks_ahead_as_an_inverted_pendulum(self, terms: tuple[Array, FrameTerms, Array, Array]) -> None:
        """Feet that step aside by d at a time T: s = d/2 exp(w (t - T)) before, d - d/2 exp(-w (t - T)) after [Kajita2003]."""
        t, found, places, touches = terms
        moved = places + np.where(t > 1.0, 0.5, 0.0)[:, None, None] * [1.0, 0.0, 0.0]
        shift = com_shift(t, found, moved, touches, 0.0)
        d = shift.zmp[-1, 0]
        assert d > 0.3
        w, T = np.sqrt(GRAVITY / found.com[0, 2]), 1.0 + 0.5 / 60.0
        expected = np.where(t < T, 0.5 * d * np.exp(w * (t - T)), d - 0.5 * d * np.exp(-w * (t - T)))
        assert shift.s[:, 0] == pytest.approx(expected, abs=0.01 * d)
        assert len(t) > REST_FRAMES

    def test_the_nearest_point_inside(self) -> None:
        """Of a square, an edge and a corner."""
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        assert nearest_inside(np.array([0.3, 0.95]), square) == pytest.approx([0.3, 0.95])
        assert nearest_inside(np.array([0.3, 5.0]), square) == pytest.approx([0.3, 0.9])  # a tenth inside
        assert nearest_inside(np.array([5.0, 5.0]), square) == pytest.approx([0.9, 0.9])
        assert nearest_inside(np.array([0.5, 3.0]), square[:2]) == pytest.approx([0.5, -1.0])
        assert nearest_inside(np.array([0.5, 3.0]), square[:1]) == pytest.approx([-1.0, -1.0])

    def test_contacts_are_held_where_they_came_down(self) -> None:
        """All points of a contact from its first touch on."""
        places = np.arange(5.0)[:, None, None] * np.ones((1, 2, 3))
        touches = np.array([[1, 0], [1, 1], [0, 0], [0, 1], [1, 1]], bool)
        held = held_places(places, touches, [0, 0])
        assert held[:, 0, 0].tolist() == [0.0, 0.0, 2.0, 3.0, 3.0]
        assert held_places(places, touches, [0, 1])[:, 1, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 3.0]


class TestDifference:
    """How far two motions are from each other."""

    def test_of_a_motion_from_itself(self, squat: rbd.Trajectory) -> None:
        """Nothing, to rounding."""
        m = Motion.of_trajectory(squat[::50])
        off = MotionDifference.of(m, m)
        assert not off.joints.any()
        assert max(size for _, size, _ in off.worst()) < 1e-7
        assert "base" in str(off)

    def test_known_differences(self, squat: rbd.Trajectory) -> None:
        """A joint, the place of the base and its turn, each in its frame."""
        m = Motion.of_trajectory(squat[::50])
        q = m.q.copy()
        q[3, m.robot.joints["waist_yaw_joint"].q] += 0.25
        q[5, :3] += [0.03, 0.04, 0.0]
        q[6, 3:7] = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 0.1])) @ pin.Quaternion(m.q[6, 3:7]).matrix()).coeffs()
        off = MotionDifference.of(Motion.of_arrays(m.robot, m.t, q, m.v, m.a), m)
        table = {name: (size, t) for name, size, t in off.worst()}
        assert table["waist_yaw_joint"] == (pytest.approx(0.25), m.t[3])
        assert table["base"] == (pytest.approx(0.05), m.t[5])
        assert table["turn of the base"] == (pytest.approx(0.1), m.t[6])
        assert off.worst()[3][0] == "waist_yaw_joint"
        assert "14.32 deg" in str(off)
        assert "base up to 50.0 mm" in repr(off)

    def test_what_cannot_be_compared(self, squat: rbd.Trajectory, talos: rbd.Robot) -> None:
        """Other robots, a reference that ends earlier, other things; a motion that ends earlier can."""
        m = Motion.of_trajectory(squat[::50])
        other = minimum_jerk(talos, [talos.standing().q] * 2, [0.0, 1.0])
        for motion, reference in ((m, other), (m, m.cut(0.0, 0.5)), (m, 3), ("x", m)):
            with pytest.raises(InputError):
                MotionDifference.of(motion, reference)  # type: ignore[arg-type]
        assert MotionDifference.of(m.cut(0.0, 0.5), m).left_out == pytest.approx(m.t[-1] - 0.5)


def test_a_step_without_an_answer_ends_it(squat: rbd.Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the program of a step has no answer the motion ends with its words; at the first frame there is none."""
    reference = Motion.of_trajectory(squat[::5]).cut(0.0, 0.3)
    report = check_motion(reference)
    module = __import__("rbd.motion.nearest", fromlist=["silent_step"])
    real, count = module.silent_step, [0]

    def fails(*args: object, **given: object) -> object:
        count[0] += 1
        if count[0] > last:
            raise NoSolution("the program is empty.")
        return real(*args, **given)

    monkeypatch.setattr(module, "silent_step", fails)
    last = 40
    nearest = report.nearest_motion()
    assert "the program is empty" in nearest.notes[-1]
    assert nearest.n == 10  # four steps a frame
    count[0], last = 0, 0
    with pytest.raises(NoSolution, match="before its first frame"):
        report.nearest_motion()
