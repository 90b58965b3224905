"""Identification: a G1 whose inertias are not its model's, from simulated motions; arms with friction; what data leave open."""

from __future__ import annotations

import copy
import pickle
import warnings
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from true_robots import g1, in_the_air, on_its_feet

import rbd
from rbd.errors import InaccurateWarning, PoorExcitationWarning
from rbd.model.inertial import body_names, inertial_parameters
from rbd.motion.identification import Identification, MeasuredMotion
from rbd.motion.identification.possible import Prior, minimise, pseudo_inertia

ARM = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 0.8]), masses=[1.0, 2.0])


def true_base(found: Identification, robot: rbd.Robot) -> np.ndarray:
    return found.base.values(inertial_parameters(robot).ravel())


@lru_cache(maxsize=1)
def flown() -> tuple[Identification, rbd.Robot, rbd.Robot]:
    """G1 in the air, without noise."""
    model, true = g1()
    return rbd.identify(in_the_air(true, model, 2, 60)), model, true


def waving(robot: rbd.Robot, frames: int = 60) -> tuple[rbd.Motion, np.ndarray]:
    """An arm of two links, and its torques."""
    motion = rbd.Motion.from_function(
        robot, lambda t: np.array([1.2 * np.sin(3.0 * t), 0.9 * np.cos(5.0 * t)]), np.linspace(0.0, 4.0, frames)
    )
    return motion, np.array([rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(frames)])


class TestG1InTheAir:
    """Sixty frames without noise: everything that can be known is known to rounding."""

    def test_base_parameters_and_total_mass_are_found(self):
        """All 213, to a millionth of their size; the model's are off by more than a hundredth."""
        found, model, true = flown()
        miss = np.abs(found.base_values - true_base(found, true)) / found.unit
        assert found.base.rank == found.certificate.rank == 213 and miss.max() < 1e-6
        assert np.abs(true_base(found, model) - true_base(found, true)).max() > 1e-2
        assert found.mass == pytest.approx(true.mass, rel=1e-8) and abs(model.mass - true.mass) > 0.3

    def test_torques_of_an_unseen_motion_are_predicted(self):
        """By the equations, and by the robot that is given back."""
        found, model, true = flown()
        unseen = in_the_air(true, model, 5, 10)
        new, old = found.residuals(unseen)
        assert new.max() < 1e-8 and old.max() > 0.5
        np.testing.assert_allclose(found.predicted(unseen)[:, 6:], unseen.tau, atol=1e-8)
        robot, state, a = found.robot(), unseen.motion.state(3), unseen.motion.a[3]
        tau = rbd.dynamics.inverse_dynamics(rbd.State(robot, state.q, state.v), a)
        np.testing.assert_allclose(tau, np.concatenate([np.zeros(6), unseen.tau[3]]), atol=1e-8)
        assert model.mass == pytest.approx(33.341, abs=1e-3), "the model is as it was"

    def test_it_says_which_masses_stay_open_and_how_far(self):
        """No body's mass is told alone; the true one and the one given lie in its range, and another robot shows the range."""
        found, _, true = flown()
        assert found.open_bodies == body_names(true)
        theta = inertial_parameters(true)
        for name in ("pelvis", "left_knee_link", "right_wrist_yaw_link"):
            low, high = found.mass_range(name)
            mass = theta[body_names(true).index(name), 0]
            assert 0.0 <= low < mass < high < true.mass and low < found.bodies[name].mass < high
            assert not found.bodies[name].mass_alone

    def test_every_body_is_possible_and_the_record_is_complete(self):
        """Pseudo-inertias are positive definite; the record prints, pickles and copies."""
        found, _, _ = flown()
        for body in found.bodies.values():
            assert body.mass > 0.0 and np.linalg.eigvalsh(body.inertia)[0] > 0.0
            moments = np.linalg.eigvalsh(body.inertia)
            assert moments[0] + moments[1] > moments[2]
        assert found.certificate.least_eigenvalue > 0.1 and found.certificate.decrement < 1e-5
        told = str(found)
        assert "213 base parameters of g1, 213 of them told" in told and "masses that are not told alone: all 30" in told
        again = pickle.loads(pickle.dumps(found))
        assert np.array_equal(again.theta, found.theta) and str(again) == told and repr(copy.deepcopy(found)) == repr(found)
        assert found.parameter("pelvis.m") == found.bodies["pelvis"].mass


@pytest.fixture(scope="module")
def walked() -> tuple[rbd.Motion, rbd.Trajectory]:
    """The motion on its feet, as that of the model, and what was simulated."""
    model, true = g1()
    x = on_its_feet(true, 3, 0.8)
    return rbd.Motion.of_arrays(model, x.t, x.q, x.v, x.a), x


class TestG1OnItsFeet:
    """A trajectory of rbd.simulate, both soles held."""

    @pytest.mark.parametrize("measured", ["forces", "no forces", "no torques"])
    def test_what_is_told_is_right(self, walked, measured: str):
        """Soles that rest tell nothing of themselves; unknown forces are eliminated; momentum alone needs no torques."""
        model, true = g1()
        motion, x = walked
        soles = model.soles(None)
        tau = None if measured == "no torques" else x.tau
        forces = {} if measured == "no forces" else x.forces
        with pytest.warns(PoorExcitationWarning, match="not at all"):
            found = rbd.identify(MeasuredMotion(motion, tau, soles, forces=forces))
        assert found.certificate.rank < 213 and np.isinf(found.certificate.condition)
        told = found.untold < 1e-6
        assert (found.relative_deviations >= 0.3 * found.untold).all()
        miss = np.abs(found.base_values - true_base(found, true)) / found.unit
        assert told.sum() > 20 and miss[told].max() < 1e-5
        assert np.isfinite(found.mass_deviation) == (measured != "no forces")
        if measured != "no forces":
            assert found.mass == pytest.approx(true.mass, rel=1e-7)

    def test_with_noise_it_is_within_the_deviations_it_states(self, walked):
        """Forces and torques with noise, together with a flight: chi-square of all 213, and of the total mass."""
        model, true = g1()
        motion, x = walked
        rng, soles = np.random.default_rng(4), model.soles(None)
        noisy = {name: f + rng.normal(size=f.shape) * [2, 2, 4, 0.3, 0.3, 0.1] for name, f in x.forces.items()}
        stand = MeasuredMotion(motion, x.tau + 0.1 * rng.normal(size=x.tau.shape), soles, forces=noisy)
        flight = in_the_air(true, model, 6, 100)
        flight = MeasuredMotion(flight.motion, flight.tau + 0.1 * rng.normal(size=flight.tau.shape))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PoorExcitationWarning)
            found = rbd.identify([stand, flight])
        miss = (found.least_squares - true_base(found, true)) / found.deviations
        assert 0.3 < np.mean(miss**2) < 2.0 and np.abs(miss).max() < 5.0
        assert abs(found.mass - true.mass) < 4.0 * found.mass_deviation < 0.5
        assert found.residual[-14:].max() < 0.11, "of the arms, where only the torques have noise"
        new, old = found.residuals(in_the_air(true, model, 7, 10))
        assert new[6:].max() < 0.3 * old[6:].max()

    def test_a_motion_whose_contacts_are_forgotten_is_refused(self, walked):
        """The data then ask for a robot without weight."""
        motion, x = walked
        with pytest.raises(rbd.InputError, match="the data ask for a total mass of .* a force that carried it is not given"):
            rbd.identify(MeasuredMotion(motion, x.tau))
        part = {name: f * [1.0, 1.0, 0.7, 1.0, 1.0, 1.0] for name, f in x.forces.items()}  # scales of a force plate are wrong
        lifted = {name: f + np.where(motion.t < 0.4, 150.0, 0.0)[:, None] * np.eye(6)[2] for name, f in part.items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PoorExcitationWarning)
            with pytest.warns(
                rbd.errors.InaccurateWarning, match="explained badly: the root mean square residual at root_joint"
            ):
                rbd.identify(MeasuredMotion(motion, x.tau, g1()[0].soles(None), forces=lifted))

    def test_a_trajectory_with_contacts_that_are_not_given_is_refused(self, walked):
        """Silently it would explain their forces by masses."""
        with pytest.raises(
            rbd.InputError, match="the trajectory has forces of 'left_sole', which is none of the contacts given"
        ):
            rbd.identify(walked[1])
        assert str(MeasuredMotion(walked[1], contacts=g1()[1].soles(None))).endswith("forces of left_sole, right_sole unknown")


class TestOpenMasses:
    """The range of a mass in closed form."""

    def test_a_pendulum_has_a_least_mass_and_no_largest(self):
        """(m c)^2 <= m I about the joint, as no body is lighter than a point; more mass at the joint is never felt."""
        link = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        swing = rbd.Motion.from_function(link, lambda t: np.array([np.sin(4.0 * t)]), np.linspace(0.0, 3.0, 61))
        tau = np.array([rbd.dynamics.inverse_dynamics(swing.state(i), swing.a[i]) for i in range(61)])
        found = rbd.identify(MeasuredMotion(swing, tau))
        low, high = found.mass_range("link_1")
        moment, inertia = found.parameter("link_1.mc_x"), found.parameter("link_1.I_yy")
        assert low == pytest.approx(moment**2 / inertia, rel=1e-4) == pytest.approx(0.75, rel=1e-3) and high == np.inf
        with pytest.raises(rbd.errors.UnknownName, match="no body with a mass is named 'link_2'"):
            found.mass_range("link_2")

    def test_a_mass_that_is_told_has_no_range(self):
        """A box in the air: all ten parameters but their scale; with a measured push the mass too."""
        box = rbd.testing.box(mass=10.0)
        rng, frames = np.random.default_rng(0), 30
        q = np.array([pin.integrate(box.model, pin.neutral(box.model), rng.normal(size=6)) for _ in range(frames)])
        v, push = rng.normal(size=(frames, 6)), np.array([5.0, 7.0, 50.0, 1.0, 2.0, 3.0])
        a = np.array([rbd.solve(rbd.State(box, x, w), [], external=push).a for x, w in zip(q, v, strict=True)])
        motion = rbd.Motion.of_arrays(box, np.arange(float(frames)), q, v, a, trust=True)  # samples, not a motion
        found = rbd.identify(MeasuredMotion(motion, external=push))
        assert found.base.rank == 10 and found.mass == pytest.approx(10.0, rel=1e-7) and found.bodies["box"].mass_alone
        assert found.mass_range("box") == (found.bodies["box"].mass,) * 2 and not found.open_bodies


class TestOtherColumns:
    """Rotor inertia, damping and dry friction beside the inertia."""

    def test_an_arm_with_friction_and_rotors(self):
        """All four kinds at once: base parameters and friction to a millionth."""
        motion, tau = waving(ARM)
        d, c, rotor = np.array([0.3, 0.1]), np.array([0.2, 0.5]), np.array([0.05, 0.02])
        tau = tau + d * motion.v + c * np.sign(motion.v) + rotor * motion.a
        columns = ("inertia", "rotor_inertia", "damping", "dry_friction")
        found = rbd.identify(MeasuredMotion(motion, tau), columns=columns)
        names = ARM.actuated_names
        for i, name in enumerate(names):
            assert found.parameter(f"{name}.damping") == pytest.approx(d[i], abs=1e-6)
            assert found.parameter(f"{name}.dry_friction") == pytest.approx(c[i], abs=1e-6)
        assert found.residual.max() < 1e-7
        robot = found.robot()
        i = list(np.flatnonzero(found.base.columns >= 20))
        assert len(i) >= 4 and robot.model.armature[1] == found.parameter(f"{names[1]}.rotor_inertia")

    def test_negative_friction_is_told(self):
        """Torques that drive: the number is given, and said to be impossible."""
        motion, tau = waving(ARM)
        found = rbd.identify(MeasuredMotion(motion, tau - 0.3 * motion.v), columns=["damping"])
        assert "negative, which no joint is: " in str(found) and found.theta[0] == pytest.approx(-0.3)
        assert "negative" not in str(rbd.identify(MeasuredMotion(motion, tau + 0.3 * motion.v), columns=["damping"]))

    def test_friction_alone_takes_the_masses_from_the_model(self):
        """Two columns, two numbers."""
        motion, tau = waving(ARM)
        found = rbd.identify(MeasuredMotion(motion, tau + 0.3 * motion.v), columns=["damping"])
        np.testing.assert_allclose(found.theta, [0.3, 0.3], atol=1e-8)
        assert found.bodies == {} and found.mass == pytest.approx(3.0) and not found.open_bodies


class TestWithOtherParts:
    """Robots and forces of the rest of the package."""

    def test_a_built_robot_with_a_spring_a_rotor_and_another_gravity(self):
        """A pendulum of the builder on the Moon: the spring is known, its rotor is known, the mass moment is found."""
        builder = rbd.RobotBuilder("swing", root="fixed")
        builder.body("bob", mass=2.0, com=(0.0, 0.0, -0.5), inertia=(0.05, 0.05, 0.01))
        builder.joint("hinge", "ground", "bob", axis=(0, 1, 0), motor=True, armature=0.03)
        robot = builder.robot(gravity=(0.0, 0.0, -1.62))
        spring = [rbd.JointSpring("hinge", stiffness=4.0)]
        torque = rbd.control.TorqueSchedule([0.0, 0.5, 1.0, 2.0], np.array([[0.0], [2.0], [-3.0], [1.0]]))
        moves = rbd.simulate(robot.at([0.4]), duration=2.0, step=0.01, controller=torque, external=spring, progress=False)
        with pytest.raises(
            rbd.InputError, match="springs or dampers acted in the trajectory .spring in hinge., and external is not given"
        ):
            rbd.identify(moves)
        found = rbd.identify(MeasuredMotion(moves, external=spring))
        assert found.residual.max() < 1e-9
        np.testing.assert_allclose(found.base_values, found.base.values(found.model_theta), atol=1e-8)
        assert robot.model.armature[0] == 0.03 and found.robot().model.gravity.linear[2] == -1.62


class TestTheProgram:
    """The minimiser is that of the objective, whoever computes it."""

    def test_the_gradient_of_the_objective_is_zero_by_differences(self):
        """The objective written out, at the answer and around it."""
        rng = np.random.default_rng(0)
        theta = inertial_parameters(ARM).ravel()
        A, z = rng.normal(size=(8, 20)), rng.normal(size=8)
        prior = Prior(theta, np.arange(2), np.zeros(0), 2.0)
        found = minimise(A, z, prior)

        def objective(x: np.ndarray) -> float:
            out = 0.5 * float(np.sum((A @ x - z) ** 2))
            for b in range(2):
                own = slice(10 * b, 10 * b + 10)
                ratio = np.linalg.solve(pseudo_inertia(theta[own]), pseudo_inertia(x[own]))
                out += 2.0 * (np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 4.0)
            return out

        least = objective(found.theta)
        assert least < objective(theta) - 0.1
        for _ in range(40):
            step = 1e-4 * rng.normal(size=20) * np.abs(theta).clip(1e-4)
            up, down = objective(found.theta + step), objective(found.theta - step)
            assert up >= least - 1e-12 and down >= least - 1e-12 and abs(up - down) <= 1e-2 * (up + down - 2.0 * least) + 1e-11

    def test_noise_that_asks_for_impossible_bodies_gets_possible_ones(self):
        """Least squares alone wants a negative inertia; the answer has none."""
        motion, tau = waving(ARM, 12)
        rng = np.random.default_rng(6)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PoorExcitationWarning)
            found = rbd.identify(MeasuredMotion(motion, tau + 40.0 * rng.normal(size=tau.shape)), prior=10.0)
        second = found.base.labels.index("link_2.I_yy")
        assert found.least_squares[second] < 0.0 < found.base_values[second]
        assert found.certificate.least_eigenvalue > 0.0

    def test_accelerations_derived_from_positions_are_good_enough(self):
        """Positions alone at 100 Hz, v and a by `rbd.Motion`: within a thousandth away from the ends."""
        exact, tau = waving(ARM, 401)
        derived = rbd.Motion.of_arrays(ARM, exact.t, exact.q)
        inner = (derived.t > 0.2) & (derived.t < 3.8)
        found = rbd.identify(MeasuredMotion(derived.cut(0.2001, 3.7999), tau[inner]))
        assert np.abs(found.base_values - true_base(found, ARM)).max() < 1e-3 * found.unit.max()

    def test_sensor_noise_gives_the_weights(self):
        """Of q, v, a and tau: deviations are finite, and the truth is within four of them."""
        motion, tau = waving(ARM)
        rng, noise = np.random.default_rng(5), rbd.motion.SensorNoise(tau=0.05)
        found = rbd.identify(MeasuredMotion(motion, tau + 0.05 * rng.normal(size=tau.shape)), noise=noise)
        miss = np.abs(found.least_squares - true_base(found, ARM)) / found.deviations
        assert miss.max() < 4.0 and found.deviations.max() < 0.5


class TestExcitation:
    """What motions would tell."""

    def test_it_is_that_of_the_identification(self):
        """The same condition number, without torques; of columns of friction too."""
        motion, tau = waving(ARM)
        found = rbd.motion.identification.excitation(motion)
        assert found.rank == 6 and found.condition == pytest.approx(
            rbd.identify(MeasuredMotion(motion, tau)).certificate.condition, rel=1e-6
        )
        assert rbd.motion.identification.excitation(motion, columns=["inertia", "damping"]).rank == 8

    def test_it_names_what_a_still_link_does_not_tell(self):
        """Joint 1 never moves: its torques tell the weight of link 1 in one posture, and nothing of its inertia."""
        still = rbd.Motion.from_function(ARM, lambda t: np.array([0.3, np.sin(3.0 * t)]), np.linspace(0.0, 4.0, 60))
        found = rbd.motion.identification.excitation(still)
        assert found.rank == 4 and found.condition == np.inf and "condition inf" in str(found)
        assert set(found.weakest) <= {"link_1.mc_x", "link_1.mc_z", "link_1.I_yy"}


class TestBadInput:
    """Named errors and warnings."""

    def test_no_motion_and_other_things(self):
        """With what was expected."""
        motion, tau = waving(ARM, 12)
        with pytest.raises(rbd.InputError, match="expected one motion or more"):
            rbd.identify([])
        with pytest.raises(rbd.InputError, match="motion is 3; expected an rbd.Motion"):
            rbd.identify([3])
        with pytest.raises(rbd.InputError, match="tau has shape"):
            MeasuredMotion(motion, tau[:5])
        with pytest.raises(rbd.InputError, match="every coordinate of .* has a motor, and no torques were given"):
            rbd.identify(motion)
        with pytest.raises(rbd.InputError, match="prior is 0.001"):
            rbd.identify(MeasuredMotion(motion, tau), prior=0.001)
        with pytest.raises(rbd.InputError, match="a group of columns is 'dampng'; nearest: 'damping'"):
            rbd.identify(MeasuredMotion(motion, tau), columns=["dampng"])
        with pytest.raises(rbd.InputError, match="too few samples"):
            rbd.identify(MeasuredMotion(motion.cut(0.0, 0.5), tau[:2]))
        with pytest.raises(rbd.errors.UnknownName, match="forces names a contact that is not given, 'foot'"):
            MeasuredMotion(motion, tau, forces={"foot": np.zeros((12, 3))})

    def test_a_motion_without_accelerations_says_how_to_derive_them(self):
        """A user's own record."""

        class Bare:
            """Without a."""

            robot, t, q, v = ARM, np.arange(3.0), np.zeros((3, 2)), np.zeros((3, 2))

        with pytest.raises(rbd.InputError, match="no accelerations. rbd.Motion.of_arrays"):
            rbd.identify(Bare())

    def test_different_robots_are_refused(self):
        """Two arms."""
        other = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 0.9]), masses=[1.0, 2.0])
        both = [MeasuredMotion(*waving(robot, 12)) for robot in (ARM, other)]
        with pytest.raises(rbd.InputError, match="motions are of different robots"):
            rbd.identify(both)
        with pytest.raises(rbd.InputError, match="the motions are of"):
            rbd.identify(both[0]).residuals(both[1])

    def test_an_arm_at_rest_is_poorly_excited(self):
        """Two combinations of six: weights about the joints; the others stay the model's."""
        q = np.tile([0.3, 0.4], (8, 1))
        rest = rbd.Motion.of_arrays(ARM, np.arange(8.0), q, 0.0 * q, 0.0 * q)
        tau = np.array([rbd.dynamics.inverse_dynamics(rest.state(i), rest.a[i]) for i in range(8)])
        with pytest.warns(PoorExcitationWarning, match="the data tell 2 of 6 combinations"):
            found = rbd.identify(MeasuredMotion(rest, 1.2 * tau))
        assert found.certificate.rank == 2 and found.residual.max() < 1e-6

    def test_an_impossible_body_of_the_model_is_named(self):
        """Its second moments are raised; its mass and centre stay."""
        bad = copy.deepcopy(ARM)
        I = bad.model.inertias[2]
        bad.model.inertias[2] = pin.Inertia(I.mass, I.lever, np.diag([1e-3, 1e-3, 1.0]))
        motion, tau = waving(bad, 20)
        with pytest.warns(rbd.errors.ModelWarning, match="no body can have the inertia of link_2"):
            rbd.identify(MeasuredMotion(motion, tau))


def test_a_push_that_is_not_given_is_told():
    """Trajectories do not record pushes, so their parameters would be wrong without a word."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    push = np.array([0.7])
    for external in (push, lambda state, t: push, [rbd.ExternalForce("link_1", (0.0, 0.0, 1.0))]):
        run = rbd.simulate(arm.at([0.3]), [], duration=0.1, step=1e-2, external=external)
        assert run.pushed
        with pytest.raises(rbd.InputError, match="external forces acted in the trajectory, which it does not record"):
            rbd.motion.identification.MeasuredMotion(run)
    rbd.motion.identification.MeasuredMotion(run, external=external)
    assert not rbd.simulate(arm.at([0.3]), [], duration=0.1, step=1e-2, external=lambda state, t: []).pushed


@pytest.fixture(scope="module")
def swing() -> tuple[rbd.Motion, np.ndarray]:
    """Two links of 1 and 2 kg that wave, and their torques."""
    wave, t = lambda t: np.array([1.2 * np.sin(3.0 * t), 0.9 * np.cos(5.0 * t)]), np.linspace(0.0, 4.0, 81)
    motion = rbd.Motion.from_function(ARM, wave, t)
    return motion, np.array([rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(81)])


class TestTorquesOfAnother:
    """Torques that are zero, in another unit, of another sign: masses would follow them."""

    @pytest.mark.parametrize(
        ("factor", "told"),
        [
            (0.0, "all torques are zero"),
            (1e3, r"1e\+03 times .*N mm"),
            (1e-3, "0.001 times .* another unit"),
            (-1.0, "other sign"),
        ],
    )
    def test_they_are_refused(self, swing, factor: float, told: str):
        """Zeros gave masses of 0.25 kg and 4e-9 kg without a word."""
        motion, tau = swing
        with pytest.raises(rbd.InputError, match=f"the torques are .*{told}"):
            rbd.identify(MeasuredMotion(motion, factor * tau))

    def test_a_lighter_and_a_heavier_robot_are_not(self, swing):
        """Three times the masses, and a third."""
        motion, tau = swing
        for factor in (3.0, 1.0 / 3.0):
            found = rbd.identify(MeasuredMotion(motion, factor * tau))
            assert found.base_values == pytest.approx(factor * (found.base.B @ found.model_theta), rel=1e-6, abs=1e-9)

    def test_one_motor_without_torque_is_told(self, swing):
        """By its name; one that swings freely needs none."""
        motion, tau = swing
        with pytest.warns(InaccurateWarning, match="the torque of joint_2 is zero in all frames"), warnings.catch_warnings():
            warnings.simplefilter("ignore", PoorExcitationWarning)
            rbd.identify(MeasuredMotion(motion, tau * [1.0, 0.0]))

        def push(state: rbd.State, t: float) -> list[float]:
            return [5.0 * np.sin(7.0 * t), 0.0]

        free = rbd.simulate(ARM.at([0.5, 0.3]), duration=2.0, step=2e-3, controller=push, progress=False)
        rbd.identify(MeasuredMotion(free[::5]))

    def test_a_robot_on_its_feet_without_torques(self, walked):
        """Zeros of motors that carry it, contacts unknown."""
        motion, x = walked
        with pytest.raises(rbd.InputError, match="all torques are zero"):
            rbd.identify(MeasuredMotion(motion, 0.0 * x.tau, motion.robot.soles(None)))


@pytest.mark.parametrize("columns", [3, 5, 7])
def test_forces_of_another_width_are_refused(columns: int) -> None:
    """Three of a sole leave its moment open, and a seventh was cut off without a word."""
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
    rest = rbd.simulate(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [face], duration=0.02, step=1e-2)
    given = MeasuredMotion(rest, contacts=[face], forces={"face": np.zeros((3, columns))})
    with pytest.raises(rbd.InputError, match=f"forces of 'face' have {columns} columns; expected 6"):
        rbd.motion.identification.identify(given)
