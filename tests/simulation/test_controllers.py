"""Controllers: the torques that hold a posture, a table of torques, and a controller that is asked once a period."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rbd
from rbd.control.posture_control import HoldPosture
from rbd.control.schedules import AcceptedStep, TorqueSchedule, ZeroOrderHold
from rbd.model.checked_model import CheckedModel

W, ZETA = 7.0, 0.8
STANDING = ["talos", "g1", "solo12", "anymal_c"]


def pendulum(mass: float = 2.0, length: float = 0.5) -> CheckedModel:
    """A point mass (and a little inertia) that stands on a hinge, upright at q = 0."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([0.0, 0.0, length]), 1e-3 * np.eye(3)), pin.SE3.Identity())
    return CheckedModel(model, name="pendulum")


@pytest.fixture(scope="module", params=STANDING)
def standing(request) -> tuple[rbd.Robot, rbd.State]:
    """A robot on its feet."""
    robot = rbd.load_robot(request.param)
    return robot, robot.standing()


def test_at_the_start_nothing_accelerates(standing):
    """The posture is in equilibrium with the torques, whose contact forces are within their cones, and the motors' limits."""
    robot, state = standing
    controller = HoldPosture(state, robot.feet(0.7))
    tau = controller(state, 0.0)
    for feet, solver in ((robot.feet(None), rbd.KKT()), (robot.feet(0.7, facets=8), rbd.ProxQP())):
        assert np.abs(rbd.solve(state, tau, feet, solver=solver).a).max() < 1e-8 * 9.81
    assert (np.abs(tau) <= robot.effort_limit).all()


def test_every_motion_that_the_feet_allow_is_the_oscillator_that_was_asked_for(standing):
    """Small motions obey y'' + 2 zeta w y' + w^2 y = 0; what hangs is stiffer. By differences of what `rbd.solve` finds."""
    robot, state = standing
    held = robot.feet(None)
    controller = HoldPosture(state, robot.feet(0.7), frequency=W, damping_ratio=ZETA)
    J = np.concatenate([foot.rows(state).J for foot in held])
    Z = scipy.linalg.null_space(J, rcond=1e-9)
    U = scipy.linalg.cholesky(Z.T @ state.M @ Z)
    Z = Z @ np.linalg.inv(U)  # of unit inertia
    read = Z.T @ state.M

    def acceleration(z: np.ndarray, v: np.ndarray) -> np.ndarray:
        moved = rbd.State(robot, pin.integrate(robot.model, state.q, z), v)
        return read @ rbd.solve(moved, controller(moved, 0.0), held, solver=rbd.KKT()).a

    none, eps = np.zeros(robot.nv), 1e-5
    stiffness = np.array([acceleration(eps * z, none) - acceleration(-eps * z, none) for z in Z.T]).T / (2.0 * eps)
    damping = np.array([acceleration(none, eps * z) - acceleration(none, -eps * z) for z in Z.T]).T / (2.0 * eps)
    n = len(Z.T)
    assert np.abs(damping + 2.0 * ZETA * W * np.eye(n)).max() < 1e-6 * W
    squares = -np.linalg.eigvals(stiffness)
    assert np.abs(squares.imag).max() < 1e-2 and squares.real.min() > W**2 * (1.0 - 1e-3)
    whole = np.block([[np.zeros((n, n)), np.eye(n)], [stiffness, damping]])
    assert np.linalg.eigvals(whole).real.max() < -0.99 * ZETA * W


def test_an_inverted_pendulum_gets_the_stiffness_that_gravity_takes_away():
    """K = m l^2 w^2 + m g l, D = 2 zeta w m l^2, no torque upright; hanging, gravity's own stiffness is left to it."""
    robot = pendulum()
    inertia, tipping = 2.0 * 0.25 + 1e-3, 2.0 * 9.81 * 0.5
    gains = HoldPosture(rbd.State(robot, np.zeros(1)), frequency=W, damping_ratio=ZETA).gains(rbd.State(robot, np.zeros(1)))
    assert abs(gains.torque[0]) < 1e-12
    assert gains.stiffness[0, 0] == pytest.approx(inertia * W**2 + tipping, rel=1e-6)
    assert gains.damping[0, 0] == pytest.approx(2.0 * ZETA * W * inertia, rel=1e-12)
    hanging = rbd.State(robot, np.array([np.pi]))
    assert HoldPosture(hanging, frequency=W).gains(hanging).stiffness[0, 0] == pytest.approx(inertia * W**2, rel=1e-6)


def test_a_stop_that_is_touched_holds_nothing():
    """Gains are those of the free pendulum: a stop lets go of a joint that the motor pulls away from it."""
    robot, free = pendulum(), rbd.State(pendulum(), np.zeros(1))
    there = rbd.State(robot, np.zeros(1))
    stop = rbd.JointLimit("stop", "hinge", lower=0.0)
    found = HoldPosture(there, [stop], frequency=W, damping_ratio=ZETA).gains(there)
    expected = HoldPosture(free, frequency=W, damping_ratio=ZETA).gains(free)
    assert np.abs(found.stiffness - expected.stiffness).max() < 1e-9
    assert np.abs(found.damping - expected.damping).max() < 1e-12
    assert found.stiffness[0, 0] > 2.0 * 0.25 * W**2


def test_of_a_fixed_arm_the_motors_feel_the_inertia_and_carry_the_weight():
    """D = 2 zeta w M and tau_0 = tau of gravity, closed forms."""
    arm = rbd.load_robot("ur5", root="fixed")
    state = rbd.State(arm, np.array([0.3, -1.0, 0.8, 0.2, -0.4, 0.1]))
    gains = HoldPosture(state, frequency=W, damping_ratio=ZETA).gains(state)
    assert np.abs(gains.damping - 2.0 * ZETA * W * state.M).max() < 1e-9
    assert np.abs(gains.torque + rbd.dynamics.gravity_torque(state)).max() < 1e-9


def test_in_free_fall_no_torque_is_asked_for(talos):
    """A robot that falls keeps its posture by itself; its motors feel (S M^-1 S^T)^-1, the base following."""
    state = talos.standing()
    controller = HoldPosture(state, talos.feet(0.7), frequency=W, damping_ratio=ZETA)
    q = state.q.copy()
    q[2] += 0.3
    aloft = talos.at(q)
    gains = controller.gains(aloft)
    assert np.abs(gains.torque).max() < 1e-8
    S = talos.actuation
    felt = np.linalg.inv(S @ np.linalg.solve(state.M, S.T))
    assert np.abs(gains.damping - 2.0 * ZETA * W * felt).max() < 1e-8
    assert np.abs(rbd.solve(aloft, controller(aloft, 0.0)).a[6:]).max() < 1e-8


def test_points_that_come_and_go_are_those_of_now(talos):
    """On collision shapes: standing, as stiff as on its soles; aloft no point is left, and the motors feel the base follow."""
    state = talos.standing()
    shapes, soles = (
        HoldPosture(state, on, frequency=W, damping_ratio=ZETA)
        for on in ([rbd.CollisionContacts("ground", talos)], talos.feet(0.7))
    )
    there, expected = shapes.gains(state), soles.gains(state)
    assert np.abs(there.damping - expected.damping).max() < 1e-6 * np.abs(expected.damping).max()
    q = state.q.copy()
    q[2] += 0.3
    aloft = talos.at(q)
    gains, S = shapes.gains(aloft), talos.actuation
    felt = np.linalg.inv(S @ np.linalg.solve(state.M, S.T))
    assert np.abs(gains.torque).max() < 1e-8
    assert np.abs(gains.damping - 2.0 * ZETA * W * felt).max() < 1e-8


def test_it_knows_which_foot_is_in_the_air(talos):
    """A leg in the air is light: the damping of its ankle is hundreds of times less than that of the one that stands."""
    state = talos.standing()
    controller = HoldPosture(state, talos.feet(0.7))
    q = state.q.copy()
    knee = talos.model.joints[talos.joint_id("leg_left_4_joint")]
    q[knee.idx_q] += 0.3  # the left knee bends, and its foot comes off the ground
    gains = controller.gains(talos.at(q))
    ankle = {side: talos.actuated_names.index(f"leg_{side}_5_joint") for side in ("left", "right")}
    left, right = (gains.damping[i, i] for i in ankle.values())
    assert left < right / 100.0
    both = controller.gains(state).damping
    assert both[ankle["left"], ankle["left"]] == pytest.approx(both[ankle["right"], ankle["right"]], rel=0.02)


def test_it_remembers_nothing(talos):
    """The same state gets the same bits, whatever was asked in between, and from another controller of the same making."""
    state = talos.standing()
    q = state.q.copy()
    q[2] += 0.1
    aloft, moved = talos.at(q), talos.at(state.q, 0.01 * np.ones(talos.nv))
    one, other = HoldPosture(state, talos.feet(0.7)), HoldPosture(state, talos.feet(0.7))
    first = [one(s, 0.0) for s in (state, moved, aloft)]
    again = [other(s, 1.0) for s in (aloft, moved, state)][::-1]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_torques_are_clipped_at_the_limits(talos):
    """A joint far from its place gets its limit and no more."""
    state = talos.standing()
    v = np.zeros(talos.nv)
    v[6:] = 50.0
    tau = HoldPosture(state, talos.feet(0.7))(state.with_velocity(v), 0.0)
    assert (np.abs(tau) <= talos.effort_limit).all() and (np.abs(tau) == talos.effort_limit).any()


def test_loops_are_held_by_their_own_rows():
    """A five-bar's two motors carry it through its loop: the posture stays, with the loop closed."""
    robot = rbd.load_robot("urdf/five_bar.urdf")
    state = robot.at(next(iter(robot.postures)))
    tau = HoldPosture(state, robot.loops())(state, 0.0)
    assert np.abs(rbd.solve(state, tau, robot.loops(), solver=rbd.KKT()).a).max() < 1e-8


def test_a_posture_that_cannot_be_held_is_refused_with_the_reason(talos):
    """`rbd.hold` says which limit is in the way; wrong arguments are named."""
    state = talos.standing()
    with pytest.raises(rbd.CannotHold, match="talos cannot be held"):
        HoldPosture(state, talos.feet(0.7)[:1])
    with pytest.raises(rbd.InputError, match="frequency of HoldPosture is 0"):
        HoldPosture(state, talos.feet(0.7), frequency=0)
    with pytest.raises(rbd.InputError, match="damping_ratio of HoldPosture is nan"):
        HoldPosture(state, talos.feet(0.7), damping_ratio=float("nan"))
    with pytest.raises(rbd.InputError, match="state of HoldPosture is .*; expected a State"):
        HoldPosture(talos, talos.feet(0.7))
    with pytest.raises(rbd.InputError, match="single constraint"):
        HoldPosture(state, talos.feet(0.7)[0])
    with pytest.raises(rbd.InputError, match="was made for talos"):
        HoldPosture(state, talos.feet(0.7))(rbd.load_robot("g1").standing(), 0.0)


def test_a_script_goes_in_straight_lines_or_in_steps():
    """Between the rows of the table; before the first and after the last it stands."""
    robot = pendulum()
    state = rbd.State(robot, np.zeros(1))
    script = TorqueSchedule([0.5, 1.0, 2.0], [[0.0], [4.0], [2.0]])
    given = [script(state, t)[0] for t in (0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 9.0)]
    assert np.allclose(given, [0.0, 0.0, 2.0, 4.0, 3.0, 2.0, 2.0], atol=1e-15)
    steps = TorqueSchedule([0.5, 1.0, 2.0], [[0.0], [4.0], [2.0]], held=True)
    assert [steps(state, t)[0] for t in (0.0, 0.75, 1.0 - 1e-12, 1.0, 1.99, 2.0)] == [0.0, 0.0, 4.0, 4.0, 4.0, 2.0]


def test_a_script_that_does_not_fit_is_refused():
    """What came, what was expected."""
    with pytest.raises(rbd.InputError, match="increasing"):
        TorqueSchedule([0.0, 0.0], [[1.0], [2.0]])
    with pytest.raises(rbd.InputError, match=r"shape \(2,\); expected \(2, nu\)"):
        TorqueSchedule([0.0, 1.0], [1.0, 2.0])
    with pytest.raises(rbd.InputError, match="not finite"):
        TorqueSchedule([0.0], [[np.nan]])
    with pytest.raises(rbd.InputError, match="2 columns; pendulum has 1 motors"):
        TorqueSchedule([0.0], [[1.0, 2.0]])(rbd.State(pendulum(), np.zeros(1)), 0.0)


def test_a_sampled_controller_is_asked_once_a_period_and_again_in_a_new_run():
    """Torques are held for a period; stages that run ahead into the next change nothing; a second run gives the same."""
    robot = pendulum()
    seen: list[float] = []

    def record(state: rbd.State, t: float) -> np.ndarray:
        seen.append(round(t, 9))
        return np.array([state.q[0]])

    slow = ZeroOrderHold(record, period=2e-3)
    stages = (0.0, 5e-4, 1e-3)  # of steps of 1 ms, their ends guessed before they are reached
    for _ in range(2):
        seen.clear()
        given = []
        slow.reset()
        for k in range(4):
            slow.accepted(AcceptedStep(rbd.State(robot, np.array([1e-3 * k])), 1e-3 * k, 1e-3, {}))
            for stage in stages:
                guess = 1e-3 * (k + stage / 1e-3) + (0.5 if stage == 1e-3 else 0.0)
                given.append(slow(rbd.State(robot, np.array([guess])), 1e-3 * k + stage)[0])
        assert given == pytest.approx([0.0] * 6 + [2e-3] * 6, abs=1e-15)
        assert seen == [0.0, 0.002]
    with pytest.raises(rbd.InputError, match="period of ZeroOrderHold is 0"):
        ZeroOrderHold(record, period=0)
    with pytest.raises(rbd.InputError, match="expected a function"):
        ZeroOrderHold(HoldPosture, period=1e-3)
