"""A state is complete when it exists, never changes, and borrows its workspace."""

from __future__ import annotations

import copy
import gc
import itertools
import pickle
import sys
import threading

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.errors import FrameNotFound, InputError, JointNotFound
from rbd.model.checked_model import CheckedModel

FRAMES = ["left_sole_link", "arm_right_7_link", "torso_2_link", "base_link"]
OFFSET = (0.11, -0.07, 0.23)  # [m], off every axis


def drawn(robot: rbd.Robot, seed: int, *, speed: float = 1.0) -> tuple[Array, Array]:
    """A (q, v) anywhere: joints within a radian of the standing posture, the base turned and moved."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, rng.uniform(-1.0, 1.0, robot.nv))
    return q, speed * rng.normal(size=robot.nv)


def answer(state: rbd.State, name: str = "left_sole_link") -> tuple[Array, ...]:
    """All that a state says of itself and of a frame."""
    at = state.frame(name, OFFSET)
    return state.M, state.h, state.com, at.X_WF.homogeneous, at.J, at.v, at.bias, rbd.dynamics.momentum(state)


def expected(robot: rbd.Robot, q: Array, v: Array, name: str = "left_sole_link") -> tuple[Array, ...]:
    """The same by Pinocchio's own functions, on a Data of its own."""
    model, data = robot.model, robot.model.createData()
    frame = pin.Frame("P", robot.frame(name).parentJoint, robot.frame(name).placement * pin.SE3(np.eye(3), np.array(OFFSET)),
                      pin.FrameType.OP_FRAME)  # fmt: skip
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    X_WP = data.oMi[frame.parentJoint] * frame.placement
    R6 = np.zeros((6, 6))
    R6[:3, :3] = R6[3:, 3:] = X_WP.rotation
    X_PJ = frame.placement.inverse()
    pin.computeJointJacobians(model, data, q)
    J = R6 @ X_PJ.action @ pin.getJointJacobian(model, data, frame.parentJoint, pin.LOCAL)
    twist = X_PJ.action @ data.v[frame.parentJoint].vector
    spatial = X_PJ.action @ data.a[frame.parentJoint].vector
    classical = spatial + np.concatenate([np.cross(twist[3:], twist[:3]), np.zeros(3)])
    com = pin.centerOfMass(model, data, q)
    M = pin.crba(model, model.createData(), q)
    h = pin.rnea(model, model.createData(), q, v, np.zeros(model.nv))
    momentum = pin.computeCentroidalMomentum(model, data, q, v).vector.copy()
    return M, h, com.copy(), X_WP.homogeneous, J, R6 @ twist, R6 @ classical, momentum


def close(one: tuple[Array, ...], other: tuple[Array, ...], tolerance: float = 1e-12) -> bool:
    """Whether all arrays agree, to a share of the largest entry."""
    return all(np.abs(a - b).max() <= tolerance * max(1.0, np.abs(b).max()) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(("name", "seed"), list(itertools.product(FRAMES, range(3))))
def test_a_state_says_what_pinocchio_says_by_other_routes(talos: rbd.Robot, name: str, seed: int) -> None:
    """M by crba, h by rnea, frames from the joint's own axes (spatial plus w x v): to 1e-12 of the largest entry."""
    q, v = drawn(talos, seed)
    assert close(answer(rbd.State(talos, q, v), name), expected(talos, q, v, name))


@pytest.mark.parametrize("name", FRAMES)
def test_velocity_of_a_frame_is_the_rate_of_its_pose(talos: rbd.Robot, name: str) -> None:
    """J v and v: the point's velocity and the turning rate, by central differences of X_WF along q (+) v t, to 1e-8."""
    q, v = drawn(talos, 7)
    at, dt = rbd.State(talos, q, v).frame(name, OFFSET), 1e-5
    X = [rbd.State(talos, pin.integrate(talos.model, q, v * t)).frame(name, OFFSET).X_WF for t in (-dt, dt)]
    rate = np.concatenate([X[1].translation - X[0].translation, pin.log3(X[1].rotation @ X[0].rotation.T)]) / (2 * dt)
    assert np.abs(at.v - rate).max() < 1e-8
    assert np.abs(at.J @ v - at.v).max() < 1e-12


@pytest.mark.parametrize("name", FRAMES)
def test_every_column_of_J_is_the_motion_of_one_coordinate(talos: rbd.Robot, name: str) -> None:
    """J by central differences of X_WF along each tangent direction, linear then angular in world axes, to 1e-8."""
    q, _ = drawn(talos, 8)
    J, dt = rbd.State(talos, q).frame(name, OFFSET).J, 1e-5
    for k, e in enumerate(np.eye(talos.nv)):
        X = [rbd.State(talos, pin.integrate(talos.model, q, e * t)).frame(name, OFFSET).X_WF for t in (-dt, dt)]
        column = np.concatenate([X[1].translation - X[0].translation, pin.log3(X[1].rotation @ X[0].rotation.T)]) / (2 * dt)
        assert np.abs(J[:, k] - column).max() < 1e-8


@pytest.mark.parametrize("name", FRAMES)
def test_bias_is_the_classical_acceleration_without_v_dot(talos: rbd.Robot, name: str) -> None:
    """J_dot v = d/dt (J v) along q (+) v t with v constant, by central differences, to 1e-7 of its size."""
    q, v = drawn(talos, 9)
    at, dt = rbd.State(talos, q, v).frame(name, OFFSET), 1e-5
    moved = [rbd.State(talos, pin.integrate(talos.model, q, v * t), v).frame(name, OFFSET).v for t in (-dt, dt)]
    rate = (moved[1] - moved[0]) / (2 * dt)
    assert np.abs(at.bias - rate).max() < 1e-7 * max(1.0, np.abs(rate).max())


def test_bias_is_quadratic_in_v(talos: rbd.Robot) -> None:
    """Twice the velocity, four times J_dot v; none at rest."""
    q, v = drawn(talos, 10)
    one, two, none = (rbd.State(talos, q, s * v).frame("arm_right_7_link").bias for s in (1.0, 2.0, 0.0))
    assert np.abs(two - 4.0 * one).max() < 1e-12 * np.abs(two).max()
    assert not none.any()


def test_an_offset_is_in_the_frame_and_moves_the_point(talos: rbd.Robot) -> None:
    """p_WP = p_WF + R_WF p_FP; v_WP = v_WF + w x r; the axes stay the frame's."""
    q, v = drawn(talos, 11)
    state = rbd.State(talos, q, v)
    F, P = state.frame("torso_2_link"), state.frame("torso_2_link", OFFSET)
    r = F.X_WF.rotation @ OFFSET
    assert np.abs(P.X_WF.translation - F.X_WF.translation - r).max() < 1e-14
    assert np.array_equal(P.X_WF.rotation, F.X_WF.rotation)
    assert np.abs(P.v[:3] - F.v[:3] - np.cross(F.v[3:], r)).max() < 1e-12
    assert np.abs(P.J[:3] - F.J[:3] - np.cross(F.J[3:], r, axisa=0, axisc=0)).max() < 1e-12
    assert np.array_equal(P.J[3:], F.J[3:])


def test_a_state_keeps_what_it_was_given(talos: rbd.Robot) -> None:
    """The user's own q and v may change afterwards: the state answers as it did."""
    q, v = drawn(talos, 12)
    given = q.copy(), v.copy()
    state = rbd.State(talos, q, v)
    before = tuple(np.copy(a) for a in answer(state))
    q[:] = v[:] = 7.0
    assert np.array_equal(state.q, given[0]) and np.array_equal(state.v, given[1])
    assert close(answer(state), before, 0.0)


def test_what_a_state_holds_cannot_be_written(talos: rbd.Robot) -> None:
    """Arrays q, v, M, h and com of a state are read-only: nothing can make its later answers wrong in silence."""
    state = talos.standing()
    for array in (state.q, state.v, state.M, state.h, state.com):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_answers_stay_as_they_were(talos: rbd.Robot) -> None:
    """Arrays given out are no windows into Pinocchio's data: other states and other frames do not change them."""
    q, v = drawn(talos, 13)
    state = rbd.State(talos, q, v)
    given = answer(state)
    kept = tuple(np.copy(a) for a in given)
    others = [rbd.State(talos, *drawn(talos, seed)) for seed in range(20, 28)]
    for other in others:
        answer(other, "arm_right_7_link")
        rbd.solve(other, np.zeros(talos.nu), [rbd.PointContact("toe", "left_sole_link")], solver=rbd.KKT())
    state.frame("torso_2_link")
    gc.collect()
    assert close(given, kept, 0.0)


def test_spoiling_an_answer_spoils_no_other(talos: rbd.Robot) -> None:
    """What `frame` returns is the caller's own: writing into it changes no later answer."""
    state = rbd.State(talos, *drawn(talos, 14))
    at = state.frame("left_sole_link")
    kept = at.J.copy(), at.v.copy(), at.bias.copy(), at.X_WF.homogeneous
    at.J[:], at.v[:], at.bias[:] = 7.0, 7.0, 7.0
    at.X_WF.translation = np.full(3, 7.0)
    again = state.frame("left_sole_link")
    assert close((again.J, again.v, again.bias, again.X_WF.homogeneous), kept, 0.0)


def test_many_live_states_all_answer_right(talos: rbd.Robot) -> None:
    """Ten states of one robot, more than there are workspaces, asked in turns and in a mixed order."""
    draws = [drawn(talos, seed) for seed in range(10)]
    states = [rbd.State(talos, q, v) for q, v in draws]
    truth = [expected(talos, q, v) for q, v in draws]
    for i in [*range(10), *range(9, -1, -1), *np.random.default_rng(3).integers(0, 10, 40)]:
        assert close(answer(states[i]), truth[i])


def test_two_live_states_of_one_robot_both_answer_right(talos: rbd.Robot) -> None:
    """One more state of the same robot does not disturb the first, moving or at rest."""
    (q1, v1), (q2, _) = drawn(talos, 1), drawn(talos, 2)
    first, second = rbd.State(talos, q1, v1), rbd.State(talos, q2)
    assert close(answer(first), expected(talos, q1, v1))
    assert close(answer(second), expected(talos, q2, np.zeros(talos.nv)))
    assert close(answer(first), expected(talos, q1, v1))


def test_solving_does_not_disturb_a_state(talos: rbd.Robot) -> None:
    """Contacts, the certificate's centroidal terms, tensors and energies leave frames, momentum and M as they were."""
    q, v = drawn(talos, 15)
    state = rbd.State(talos, q, v)
    truth = expected(talos, q, v)
    held = [rbd.SurfaceContact("sole", "left_sole_link", half_lengths=(0.1, 0.06))]
    for disturb in (
        lambda: rbd.solve(state, np.zeros(talos.nu), held, external=[rbd.ExternalForce("torso_2_link", (1, 2, 3))]),
        lambda: state.centroidal(),
        lambda: rbd.dynamics.coriolis_matrix(state),
        lambda: rbd.dynamics.gravity_torque(state),
        lambda: rbd.dynamics.momentum(state),
        lambda: rbd.dynamics.potential_energy(state),
        lambda: rbd.dynamics.free_acceleration(state, np.zeros(talos.nu)),
    ):
        disturb()
        assert close(answer(state), truth)


def test_no_workspace_is_made_per_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pool of at most four pin.Data serves any number of states, frames and terms."""
    robot, made = rbd.load_robot("talos"), []

    class CountingModel:
        def createData(self) -> pin.Data:  # noqa: N802  Pinocchio's name
            made.append(1)
            return robot.model.createData()

    monkeypatch.setattr(robot.pool, "_model", CountingModel())
    soles, tau = robot.soles(), np.zeros(robot.nu)
    alive = []
    for seed in range(12):
        state = robot.standing()
        alive.append(rbd.State(robot, *drawn(robot, seed)))
        rbd.solve(state, tau, soles)
        rbd.hold(state, soles)
        for term in (rbd.dynamics.gravity_torque, rbd.dynamics.coriolis_tensor, rbd.dynamics.momentum):
            term(alive[seed // 2])
        alive[0].frame("torso_2_link")
    assert 1 <= len(made) <= 4


def test_a_state_that_is_gone_gives_its_workspace_back() -> None:
    """A thousand states one after another use one pin.Data."""
    robot = rbd.load_robot("panda", root="fixed")
    q = robot.neutral()
    for _ in range(1000):
        assert len(rbd.State(robot, q).h)
    assert len(robot.pool._lent) == 0
    assert len(robot.pool._free) == 1
    kept = [rbd.State(robot, q) for _ in range(3)]
    assert (len(robot.pool._lent), len(robot.pool._free)) == (0, 1)  # terms are computed when they are asked for
    assert all(len(state.h) for state in kept)
    assert (len(robot.pool._lent), len(robot.pool._free)) == (3, 0)
    del kept
    gc.collect()
    assert (len(robot.pool._lent), len(robot.pool._free)) == (0, 3)


def test_states_in_reference_cycles_give_back_too() -> None:
    """The garbage collector may end a state at any time, in the midst of another's loan: answers stay right."""
    robot = rbd.load_robot("panda", root="fixed")
    rng = np.random.default_rng(4)
    old = gc.get_threshold()
    gc.set_threshold(5)
    try:
        for _ in range(200):
            v = rng.normal(size=robot.nv)
            ring: list[object] = [rbd.State(robot, robot.neutral(), v)]
            ring.append(ring)
            state = ring[0]
            assert isinstance(state, rbd.State)
            at = state.frame("panda_hand")
            assert np.abs(at.J @ v - at.v).max() < 1e-12
            del state, ring
    finally:
        gc.set_threshold(*old)
    gc.collect()
    assert len(robot.pool._lent) == 0 and len(robot.pool._free) <= 4


def test_threads_share_a_robot(talos: rbd.Robot) -> None:
    """Four threads make, ask and drop states of one robot; every answer is the single thread's."""
    draws = [drawn(talos, seed) for seed in range(8)]
    truth = [expected(talos, q, v) for q, v in draws]
    shared = rbd.State(talos, *draws[0])
    wrong: list[str] = []

    def work(seed: int) -> None:
        rng = np.random.default_rng(seed)
        alive: list[tuple[int, rbd.State]] = []
        try:
            for _ in range(60):
                i = int(rng.integers(8))
                alive = [*alive[-2:], (i, rbd.State(talos, *draws[i]))]
                for j, state in [*alive, (0, shared)]:
                    if not close(answer(state), truth[j]):
                        wrong.append(f"thread {seed}, draw {j}")
                rbd.dynamics.coriolis_matrix(alive[0][1])
        except Exception as error:  # noqa: BLE001  told by the main thread
            wrong.append(repr(error))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(usual)
    assert not wrong


def test_without_v_a_state_is_at_rest(talos: rbd.Robot) -> None:
    """No velocity given is v = 0; `with_velocity` keeps q."""
    state = rbd.State(talos, talos.standing().q)
    assert state.v.shape == (talos.nv,) and not state.v.any()
    moving = state.with_velocity(np.ones(talos.nv))
    assert np.array_equal(moving.q, state.q) and moving.v.all() and not state.v.any()


def test_M_is_whole_and_symmetric(talos: rbd.Robot) -> None:
    """Both triangles are filled, to rounding alike, and M is positive definite."""
    state = rbd.State(talos, *drawn(talos, 16))
    assert np.abs(state.M - state.M.T).max() < 1e-12
    assert np.linalg.eigvalsh(state.M)[0] > 0.0


@pytest.mark.parametrize("robot", [None, "talos", 3, rbd.Robot])
def test_a_state_wants_a_robot(robot: object) -> None:
    """Anything else is refused with the remedy."""
    with pytest.raises(InputError, match=r"State wants a robot first, .*load_robot"):
        rbd.State(robot, np.zeros(3))  # type: ignore[arg-type]


@pytest.mark.parametrize("offset", [(0.0, 0.0), 1.0, (0.0, 0.0, np.nan), (0.0, np.inf, 0.0), "abc", None, np.zeros((3, 1))])
def test_a_bad_offset_is_refused(talos: rbd.Robot, offset: object) -> None:
    """Three finite numbers, or an error that says so."""
    with pytest.raises(InputError, match="offset"):
        talos.standing().frame("left_sole_link", offset)  # type: ignore[arg-type]


def test_an_unknown_frame_of_a_state_is_refused(talos: rbd.Robot) -> None:
    """Before Pinocchio sees it."""
    with pytest.raises(FrameNotFound, match="'left_sole_link'"):
        talos.standing().frame("left_sole")


def test_a_robot_with_one_joint_has_matrices_too():
    """A pendulum: J is (6, 1), M (1, 1), and a tip lying flat on the floor carries m g / 2."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pin")
    model.appendBodyToJoint(1, pin.Inertia(3.0, np.array([0.5, 0.0, 0.0]), 0.25 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", 1, 0, pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])), pin.FrameType.OP_FRAME))
    robot = CheckedModel(model)
    state = rbd.State(robot, np.zeros(1), np.array([2.0]))
    assert state.M.shape == (1, 1) and state.h.shape == (1,) and state.frame("tip").J.shape == (6, 1)
    assert state.frame("tip").J[:, 0] == pytest.approx([0.0, 0.0, -1.0, 0.0, 1.0, 0.0])
    tip = rbd.PointContact("tip", "tip", friction=0.0)
    s = rbd.solve(rbd.State(robot, np.zeros(1)), np.zeros(1), [tip])
    assert s.forces["tip"] == pytest.approx([0.0, 0.0, 3.0 * 9.81 / 2.0]) and np.abs(s.a).max() < 1e-12
    assert s.derivatives().da_dq.shape == (1, 1)


class TestJointsByName:
    """`with_joints` places joints by name, and refuses what is none."""

    def test_named_joints_move_and_nothing_else(self, talos: rbd.Robot):
        """The value stands at the joint's place in q; base, other joints and v stay, to the last bit."""
        q, v = drawn(talos, 3)
        state = rbd.State(talos, q, v)
        moved = state.with_joints({"arm_left_4_joint": -1.2, "leg_right_4_joint": [0.5]})
        expected = state.q.copy()
        expected[talos.joints["arm_left_4_joint"].q], expected[talos.joints["leg_right_4_joint"].q] = -1.2, 0.5
        assert np.array_equal(moved.q, expected) and np.array_equal(moved.v, state.v)
        assert moved is not state and np.array_equal(state.with_joints({}).q, state.q)

    def test_a_continuous_joint_takes_its_angle(self):
        """As (cos, sin); two numbers of norm one are taken as they are."""
        robot = rbd.load_robot("tiago_dual", root="fixed")
        joint = next(j for j in robot.joints.values() if j.is_continuous)
        circle = np.array([np.cos(2.5), np.sin(2.5)])
        for given in (2.5, circle):
            moved = robot.at().with_joints({joint.name: given})
            assert np.abs(moved.q[joint.q] - circle).max() < 1e-15 and abs(joint.coordinate(moved.q) - 2.5) < 1e-15

    def test_a_base_takes_its_seven_numbers(self, talos: rbd.Robot):
        """Position and unit quaternion; nothing else."""
        base = np.array([0.1, 0.2, 0.9, 0.0, 0.6, 0.0, 0.8])
        assert np.array_equal(talos.standing().with_joints({"root_joint": base}).q[:7], base)

    @pytest.mark.parametrize(
        ("values", "kind", "says"),
        [
            ({"arm_left_44_joint": 0.1}, JointNotFound, "nearest: 'arm_left_4_joint'"),
            ({"arm_left_4_joint": (0.1, 0.2)}, InputError, "'arm_left_4_joint' has 2 numbers; expected one"),
            ({"arm_left_4_joint": np.nan}, InputError, "value of joint 'arm_left_4_joint' is not finite"),
            ({"arm_left_4_joint": [[0.1]]}, InputError, "a number, or its part of q"),
            ({"root_joint": 0.1}, InputError, "expected 7 numbers"),
            ({"root_joint": np.ones(7)}, InputError, "quaternion .* of norm 2"),
            ([("arm_left_4_joint", 0.1)], InputError, "expected a mapping"),
        ],
    )
    def test_what_is_no_value_is_refused(self, talos: rbd.Robot, values: object, kind: type, says: str):
        """With the joint's name, and what was expected."""
        with pytest.raises(kind, match=says):
            talos.standing().with_joints(values)  # type: ignore[arg-type]


def test_a_state_keeps_its_time_wherever_it_is_made_from_a_state(talos):
    """Copies, pickles, other velocities, joints and robots, samples of a trajectory and states between them."""
    state = talos.standing().at_time(0.25)
    made = [
        state.with_velocity(np.ones(talos.nv)), state.with_joints({"torso_2_joint": 0.1}), state.on(talos),
        state.with_joint_velocities({"torso_2_joint": 0.1}), pickle.loads(pickle.dumps(state)), copy.deepcopy(state),
        copy.copy(state), rbd.mechanism.project_velocity(state, talos.soles()),
    ]  # fmt: skip
    assert [each.t for each in made] == [0.25] * len(made)
    assert (talos.standing().t, rbd.State(talos, state.q, t=2).t) == (0.0, 2.0)
    assert "t = 0.25 s" in repr(state)
    assert "t =" not in repr(talos.standing())


def test_a_simulation_begins_at_the_time_of_its_state():
    """Its samples, its controller, the states of its trajectory and those between samples have one time."""
    box, asked = rbd.testing.box(mass=2.0), []
    start = rbd.State(box, [0, 0, 1.0, 0, 0, 0, 1], t=0.5)
    fall = rbd.simulate(start, duration=0.1, step=1e-2, external=lambda state, t: asked.append((state.t, t)), progress=False)
    assert abs(fall.t[0] - 0.5) + abs(fall.t[-1] - 0.6) < 1e-12
    assert all(a == b for a, b in asked)
    assert [fall.state(3).t, fall.at(0.555).t, fall[4].state.t] == [fall.t[3], 0.555, fall.t[4]]
