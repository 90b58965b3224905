"""Constraints by functions of the configuration, against closed forms and against loops."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import ConstraintWrong, box, check_constraint

HERE = pin.SE3.Identity()
SOLVERS = [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()]


def _slider(n: int = 2) -> CheckedModel:
    """A point of 1 kg on n sliders, along x, y and z, gravity along -y."""
    model, joint = pin.Model(), 0
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    for i in range(n):
        kind = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)[i]
        joint = model.addJoint(joint, kind(), HERE, "xyz"[i])
        model.appendBodyToJoint(joint, pin.Inertia(float(i == n - 1), np.zeros(3), 1e-3 * np.eye(3)), HERE)
    return CheckedModel(model, passive=list(model.names)[1:], name="point")


def _four_bar(lengths: tuple[float, float, float, float]) -> tuple[CheckedModel, rbd.LoopClosure]:
    """Crank a, coupler b, rocker c on a ground of d; joints' angles from the bar before."""
    a, b, c, d = lengths
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    for name, parent, length, x in (("crank", 0, a, 0.0), ("coupler", 1, b, a), ("rocker", 0, c, d)):
        joint = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), name)
        rod = pin.Inertia(length, np.array([0.5 * length, 0.0, 0.0]), np.diag([1e-3, 1.0, 1.0]) * length**3 / 12.0)
        model.appendBodyToJoint(joint, rod, HERE)
        tip = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        model.addFrame(pin.Frame(f"{name}_tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    loop = rbd.LoopClosure("loop", "rocker_tip", "coupler_tip", kind="planar")
    return CheckedModel(model, passive=["crank", "coupler", "rocker"], name="four bar"), loop


@pytest.fixture(scope="module")
def bent(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose, moving."""
    rng = np.random.default_rng(0)
    q = pin.integrate(talos.model, talos.standing().q, 0.5 * rng.normal(size=talos.nv))
    return talos.at(q, rng.normal(size=talos.nv))


def _way(robot: CheckedModel, frame_a: str, frame_b: str):
    """The point closure's error, by forward kinematics alone."""
    data, ids = robot.model.createData(), [robot.frame_id(f) for f in (frame_a, frame_b)]

    def phi(q: np.ndarray) -> np.ndarray:
        pin.framesForwardKinematics(robot.model, data, q)
        return data.oMf[ids[0]].actInv(data.oMf[ids[1]].translation)

    return phi


def test_differences_find_the_jacobian_and_jdot_v_of_a_loop(bent):
    """Talos' feet: 38 columns on the manifold, to 1e-10 of those by the body Jacobians, J_dot v to 1e-9."""
    frames = "left_sole_link", "right_sole_link"
    found = rbd.FunctionConstraint("way", _way(bent.robot, *frames)).rows(bent)
    exact = rbd.LoopClosure("loop", *frames).rows(bent)
    assert np.abs(exact.J).max() > 0.5 and np.abs(found.J - exact.J).max() < 1e-12
    assert np.abs(exact.bias).max() > 1.0 and np.abs(found.bias - exact.bias).max() < 1e-9
    assert np.abs(found.error - exact.error).max() < 1e-15 and np.abs(found.velocity - exact.velocity).max() < 1e-11


@pytest.mark.parametrize("given", ["phi", "jacobian"])
def test_a_function_describes_its_motion(bent, given):
    """By differences, and with its Jacobian given."""
    phi = _way(bent.robot, "left_sole_link", "right_sole_link")
    loop = rbd.LoopClosure("loop", "left_sole_link", "right_sole_link")
    jacobian = (lambda q: loop.rows(rbd.State(bent.robot, q)).J) if given == "jacobian" else None
    report = check_constraint(rbd.FunctionConstraint("way", phi, jacobian=jacobian), bent, draws=2)
    assert report.against == "motion of the error" and max(report.jacobian, report.velocity, report.jdot_v) < 1e-8


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("lengths", [(1.0, 1.0, 1.0, 1.0), (0.4, 1.2, 0.8, 1.0)])
@pytest.mark.parametrize("crank", [0.5, 2.3])
def test_the_texts_planar_loop_is_the_four_bar(lengths, crank, solver):
    """L1 e^(i th1) + L2 e^(i th2) + L3 e^(i th3) + L4 e^(i th4) = 0 and the closure of two frames: one motion, one force.

    In the text's convention four vectors sum to zero: th3 points from the rocker's tip to its foot, th4 = pi back along
    the ground.
    """
    L1, L2, L3, L4 = lengths
    model, loop = _four_bar(lengths)

    def phi(q: np.ndarray) -> np.ndarray:
        th1, th2, th3 = q[0], q[0] + q[1], q[2] + math.pi
        z = L1 * cmath.exp(1j * th1) + L2 * cmath.exp(1j * th2) + L3 * cmath.exp(1j * th3) + L4 * cmath.exp(1j * math.pi)
        return np.array([z.real, z.imag])

    tip = L1 * cmath.exp(1j * crank)
    far, way = abs(L4 - tip), cmath.phase(L4 - tip)
    coupler = way + math.acos((L2**2 + far**2 - L3**2) / (2 * L2 * far))  # the open branch
    rocker = cmath.phase(tip + L2 * cmath.exp(1j * coupler) - L4)
    q = np.array([crank, coupler - crank, rocker])
    assert np.abs(phi(q)).max() < 1e-14
    text = rbd.FunctionConstraint("text", phi)
    still = text.rows(rbd.State(model, q))
    v = np.r_[1.5, np.linalg.solve(still.J[:, 1:], -1.5 * still.J[:, 0])]
    state = rbd.State(model, q, v)
    s, other = (rbd.solve(state, np.zeros(0), [c], solver=solver) for c in (text, loop))
    assert np.abs(s.a).max() > 1.0 and np.abs(s.a - other.a).max() < 1e-7 * np.abs(s.a).max()
    assert np.abs(s.problem.J.T @ s.multipliers - other.problem.J.T @ other.multipliers).max() < 1e-7
    assert np.abs(s.forces["text"] - other.forces["loop"][:2]).max() < 1e-7  # both along x and y, on the coupler


@pytest.mark.parametrize("posture", ["assembled", "crossed"])
def test_the_texts_planar_loop_is_the_four_bar_of_the_file(posture):
    """The same of `urdf/four_bar.urdf`, 40/120/80/100 mm, both branches; its q holds cosines and sines."""
    robot = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "four_bar.urdf")

    def phi(q: np.ndarray) -> tuple[float, float]:
        crank, rocker = complex(q[0], q[1]), complex(q[4], q[5])
        z = 0.040 * crank + 0.120 * crank * complex(q[2], q[3]) - 0.080 * rocker - 0.100
        return z.real, z.imag

    text = rbd.FunctionConstraint("text", phi)
    J = text.rows(robot.at(robot.postures[posture])).J
    state = robot.at(robot.postures[posture], np.r_[25.0, np.linalg.solve(J[:, 1:], -25.0 * J[:, 0])])
    rates = state.v[0], state.v[0] + state.v[1], state.v[2]
    if posture == "assembled":  # Norton's: crank 25 rad/s at 40 deg
        assert rates == pytest.approx((25.0, -4.1209, 6.9980), abs=5e-5)
    for solver in SOLVERS:
        s, other = (rbd.solve(state, [0.01], c, solver=solver) for c in ([text], robot.loops()))
        assert np.abs(other.a).max() > 10.0 and np.abs(s.a - other.a).max() < 1e-7 * np.abs(other.a).max()


def test_columns_that_vanish_are_found_to_vanish_where_the_loop_is_closed(talos):
    """Here phi is rounding, 1e-17, and does not depend on the base: what rounding leaves is no kink."""
    phi = _way(talos, "left_sole_link", "right_sole_link")
    state = talos.standing()
    there = phi(state.q)
    J = rbd.FunctionConstraint("way", lambda q: phi(q) - there).rows(state).J
    assert np.abs(J[:, :6]).max() < 1e-12 < 0.5 < np.abs(J).max()


def test_functions_of_a_floating_base_go_by_its_own_velocities():
    """Height of a box: J = (0, 0, 1) R in the base's axes, and J_dot v = (R (w x u))_z."""
    robot = box()
    q = pin.integrate(robot.model, pin.neutral(robot.model), np.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6]))
    v = np.array([0.3, -0.2, 0.5, 1.0, 0.7, -0.4])
    rows = rbd.FunctionConstraint("height", lambda q: q[2] - 0.1).rows(rbd.State(robot, q, v))
    R = pin.XYZQUATToSE3(q).rotation
    assert np.abs(rows.J - [[*R[2], 0, 0, 0]]).max() < 1e-12 and rows.error[0] == q[2] - 0.1
    assert abs(rows.bias[0] - (R @ np.cross(v[3:], v[:3]))[2]) < 1e-10


def test_functions_of_a_continuous_joint_get_its_cosine_and_sine():
    """In q stand (cos, sin), in v the rate: phi = sin has J = cos, J_dot v = -sin w^2."""
    model = pin.Model()
    model.appendBodyToJoint(model.addJoint(0, pin.JointModelRUBZ(), HERE, "wheel"), pin.Inertia.Random(), HERE)
    state = rbd.State(CheckedModel(model), np.array([np.cos(0.6), np.sin(0.6)]), np.array([2.0]))
    rows = rbd.FunctionConstraint("pin", lambda q: q[1]).rows(state)
    assert abs(rows.J[0, 0] - np.cos(0.6)) < 1e-13 and abs(rows.bias[0] + 4.0 * np.sin(0.6)) < 1e-10


@pytest.mark.parametrize(
    ("f", "first", "second"),
    [
        (lambda x: math.exp(x / 1e-3), lambda x: 1e3 * math.exp(x / 1e-3), lambda x: 1e6 * math.exp(x / 1e-3)),
        (lambda x: math.sin(3e3 * x), lambda x: 3e3 * math.cos(3e3 * x), lambda x: -9e6 * math.sin(3e3 * x)),
        (lambda x: 1e7 * math.sin(x), lambda x: 1e7 * math.cos(x), lambda x: -1e7 * math.sin(x)),
        (lambda x: math.sqrt(x + 1e-4), lambda x: 0.5 / math.sqrt(x + 1e-4), lambda x: -0.25 * (x + 1e-4) ** -1.5),
        (lambda x: 1e-9 * math.sin(x), lambda x: 1e-9 * math.cos(x), lambda x: -1e-9 * math.sin(x)),
        (lambda x: 1.0 / x, lambda x: -1.0 / x**2, lambda x: 2.0 / x**3),
    ],
    ids=["millimetres", "a fine wave", "large", "at the end of its domain", "small", "a pole nearby"],
)
def test_steps_find_the_length_over_which_a_function_changes(f, first, second):
    """Closed forms: J to 1e-9 of its size, J_dot v to 1e-6, with lengths from 0.1 mm to 1 m."""
    x, speed = 0.012, 1.7
    rows = rbd.FunctionConstraint("f", lambda q: f(q[0]) if q[0] > -1e-4 else math.nan).rows(
        rbd.State(_slider(1), np.array([x]), np.array([speed]))
    )
    assert abs(rows.J[0, 0] - first(x)) < 1e-9 * max(abs(first(x)), abs(f(x)))
    assert abs(rows.bias[0] - second(x) * speed**2) < 1e-6 * speed**2 * max(abs(second(x)), abs(first(x)))


def test_a_bob_on_a_rod_and_a_bead_on_a_hill_carry_what_they_should():
    """|p| = l: tension m (v^2 / l - g . n) on the rod; on a hill the bead leaves where v^2 / l > g . n."""
    l, angle = 0.5, 0.7
    n, along = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    rod = rbd.FunctionConstraint("rod", lambda q: math.hypot(q[0], q[1]) - l)
    hill = rbd.FunctionConstraint("hill", lambda q: math.hypot(q[0], q[1]) - l, cone=rbd.problem.NonNegative(1))
    for speed, rides in ((0.5, True), (3.0, False)):
        state = rbd.State(_slider(), l * n, speed * along)
        ride = along * 9.81 * np.sin(angle) - n * speed**2 / l
        push = 9.81 * np.cos(angle) - speed**2 / l
        s = rbd.solve(state, np.zeros(0), [rod])
        assert np.abs(s.a - ride).max() < 1e-8 and abs(s.forces["rod"][0] - push) < 1e-8
        for solver in (rbd.ProxQP(), rbd.ConeSolver()):
            s = rbd.solve(state, np.zeros(0), [hill], solver=solver)
            assert np.abs(s.a - (ride if rides else [0.0, -9.81])).max() < 1e-8
            assert abs(s.forces["hill"][0] - max(push, 0.0)) < 1e-8 and rides == (push > 0.0)


def test_a_wrong_jacobian_and_a_wrong_bias_are_caught():
    """They are believed by `rows`, and not by `check_constraint`."""
    state = rbd.State(_slider(), np.array([0.3, 0.4]))

    def phi(q: np.ndarray) -> float:
        return q[0] ** 2 + q[1] ** 2 - 0.25

    right = {"jacobian": lambda q: 2.0 * q, "bias": lambda q, v: 2.0 * v @ v}
    assert check_constraint(rbd.FunctionConstraint("rod", phi, **right), state).jdot_v < 1e-9
    for wrong, what in (({"jacobian": lambda q: q}, "J v of row 0"), ({"bias": lambda q, v: v @ v}, "J_dot v of row 0")):
        with pytest.raises(ConstraintWrong, match=what):
            check_constraint(rbd.FunctionConstraint("rod", phi, **(right | wrong)), state)


def test_an_inactive_function_has_no_rows():
    """An empty array: the constraint is not there at this state."""
    far = rbd.FunctionConstraint("wall", lambda q: q[:1] if q[0] < 0.1 else q[:0], cone=rbd.problem.NonNegative(1))
    assert [len(far.rows(rbd.State(_slider(), np.array([x, 0.0])))) for x in (0.05, 0.3)] == [1, 0]
    assert rbd.solve(rbd.State(_slider(), np.array([0.3, 0.0])), np.zeros(0), [far]).a == pytest.approx([0.0, -9.81])


def test_phi_may_do_what_it_likes_with_its_q():
    """It gets a copy."""

    def phi(q: np.ndarray) -> float:
        q *= 2.0
        return q[0]

    state = rbd.State(_slider(), np.array([0.3, 0.4]))
    assert rbd.FunctionConstraint("f", phi).rows(state).J == pytest.approx(np.array([[2.0, 0.0]]))


def _calls(f):
    """(f, the shapes of q with which it is called)."""
    shapes: list[tuple[int, ...]] = []

    def counted(q: np.ndarray) -> object:
        shapes.append(q.shape)
        return f(q)

    return counted, shapes


@pytest.mark.parametrize(
    ("f", "one_by_one"),
    [
        (lambda q: np.hypot(q[0], q[1]) - 0.5, lambda q: math.hypot(q[0], q[1]) - 0.5),
        (lambda q: [np.sin(q[0]) * q[1], q[1] ** 3], lambda q: [math.sin(q[0]) * q[1], float(q[1]) ** 3]),
    ],
)
def test_a_function_of_arrays_is_called_once_for_all_configurations(f, one_by_one):
    """At the first state it is compared with itself; then one call for the value, and one for all differences."""
    (phi, shapes), state = _calls(f), rbd.State(_slider(), np.array([0.3, 0.4]), np.array([0.7, -0.2]))
    constraint = rbd.FunctionConstraint("f", phi)
    first = constraint.rows(state)
    del shapes[:]
    again, other = constraint.rows(state), rbd.FunctionConstraint("f", one_by_one).rows(state)
    assert len(shapes) == 2 and shapes[0] == (2,) and shapes[1][0] == 2 < shapes[1][1]
    assert np.array_equal(again.J, first.J) and np.array_equal(again.bias, first.bias)
    assert np.abs(again.J - other.J).max() < 1e-13 and np.abs(again.bias - other.bias).max() < 1e-10


def test_a_matrix_function_of_arrays_is_called_once_for_all_configurations():
    """A of a velocity constraint, and a Jacobian that is given, alike; A_dot v is that by closed form."""
    A, shapes = _calls(lambda q: np.array([[np.sin(q[1]), q[0] * q[1]]]))
    q, v = np.array([0.3, 0.4]), np.array([0.7, -0.2])
    row = rbd.VelocityConstraint("row", A)
    exact = np.cos(q[1]) * v[1] * v[0] + (v[0] * q[1] + q[0] * v[1]) * v[1]
    for calls in (8, 2):  # those of the first state are compared one by one
        del shapes[:]
        assert abs(row.rows(rbd.State(_slider(), q, v)).bias[0] - exact) < 1e-12 and len(shapes) == calls
    given, shapes = _calls(lambda q: 2.0 * q)
    rod = rbd.FunctionConstraint("rod", lambda q: q[0] ** 2 + q[1] ** 2 - 0.25, jacobian=given)
    for _ in range(2):
        del shapes[:]
        assert abs(rod.rows(rbd.State(_slider(), q, v)).bias[0] - 2.0 * v @ v) < 1e-12
    assert len(shapes) == 2


@pytest.mark.parametrize(
    "f",
    [
        lambda q: q[0] - q[1].mean(),
        lambda q: np.linalg.norm(q) - 0.5,
        lambda q: q[0] + np.arange(np.size(q[0])),
        lambda q: np.max(np.abs(q[0])) + 0.0 * q[1],
        lambda q: q[0] if q.ndim == 1 else 2.0 * q[0],
    ],
)
def test_a_function_that_mixes_configurations_gets_them_one_by_one(f):
    """Its values by columns are others than its own, or have another shape: they are not used."""
    (phi, shapes), state = _calls(f), rbd.State(_slider(), np.array([0.3, 0.4]), np.array([0.7, -0.2]))
    constraint = rbd.FunctionConstraint("f", phi)
    first, known = constraint.rows(state), rbd.FunctionConstraint("f", lambda q: float(np.ravel(f(q))[0])).rows(state)
    del shapes[:]
    again = constraint.rows(state)
    assert set(shapes) == {(2,)} and np.array_equal(first.J, again.J) and np.array_equal(first.bias, again.bias)
    assert np.array_equal(first.J, known.J) and np.array_equal(first.bias, known.bias)


@pytest.mark.parametrize("then", [lambda q: q[2], lambda q: q[0] ** 2 + 1.0])
def test_a_function_that_no_longer_takes_columns_is_noticed(then):
    """Each call with many has the state itself in it, whose value is known."""
    late: list[bool] = []

    def phi(q: np.ndarray) -> object:
        return then(q) if late and q.ndim == 2 else q[0] ** 2

    state, constraint = rbd.State(_slider(), np.array([0.3, 0.4]), np.array([0.7, -0.2])), rbd.FunctionConstraint("f", phi)
    before = constraint.rows(state)
    late.append(True)
    after = constraint.rows(state)
    assert np.abs(after.J - before.J).max() < 1e-13 and np.abs(after.bias - before.bias).max() < 1e-10
    assert after.J[0, 0] == pytest.approx(0.6)


def test_many_configurations_are_moved_as_each_alone(talos):
    """Bit by bit those of `pin.integrate`: floating, planar and continuous joints, few and many steps."""
    rng, four_bar = np.random.default_rng(0), rbd.load_robot(Path(__file__).parents[2] / "urdf" / "four_bar.urdf")
    for robot in (talos, four_bar, box(), _slider()):
        q = pin.integrate(robot.model, pin.neutral(robot.model), rng.normal(size=robot.nv))
        for k in (1, 7, 250):
            steps = rng.normal(size=(k, robot.nv))
            assert np.array_equal(robot.moved(q, steps), [pin.integrate(robot.model, q, step) for step in steps])


def _noisy(q: np.ndarray) -> float:
    return q[0] + 1e-5 * np.random.default_rng(int(1e15 * q[0])).normal()


@pytest.mark.parametrize(
    ("phi", "words"),
    [
        (lambda q: abs(q[0] - 0.3), "phi of 'f' has no derivative here.*kink"),
        (lambda q: float(q[0] >= 0.3), "phi of 'f' has no derivative here"),
        (_noisy, "phi of 'f' has no derivative here"),
        (lambda q: math.nan, "phi of 'f' is .*nan.*expected finite"),
        (lambda q: q[0] if q[0] == 0.3 else math.inf, "phi of 'f' has no derivative here"),
        (lambda q: 1j * q[0], "real numbers"),
        (lambda q: "far", "real numbers"),
        (lambda q: None, "real numbers"),
        (lambda q: np.eye(2), r"phi of 'f' gave an array of shape \(2, 2\)"),
        (lambda q: q if q[0] == 0.3 else q[:1], r"expected \(2,\), as phi has at this state"),
        (lambda q: 1 // 0, "phi of 'f' raised ZeroDivisionError"),
        (lambda: 0.0, "phi of 'f' raised TypeError"),
        (lambda q: q[7], "phi of 'f' raised IndexError"),
    ],
)
def test_a_phi_that_is_no_function_of_q_is_refused(phi, words):
    """By the constraint's name, and what phi gave."""
    with pytest.raises(rbd.InputError, match=words):
        rbd.FunctionConstraint("f", phi).rows(rbd.State(_slider(), np.array([0.3, 0.4]), np.ones(2)))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"jacobian": lambda q: np.eye(2)}, r"jacobian of 'f' has shape \(2, 2\); expected \(1, 2\)"),
        ({"jacobian": lambda q: [math.nan, 0.0]}, "jacobian of 'f' is not finite"),
        ({"jacobian": lambda q: [abs(q[0] - 0.3), 0.0]}, "jacobian of 'f' has no derivative here"),
        ({"bias": lambda q, v: v}, r"bias of 'f' gave an array of shape \(2,\); expected \(1,\)"),
        ({"cone": rbd.problem.Free(2)}, "cone has dimension 2, J has 1 rows"),
    ],
)
def test_derivatives_and_cones_that_do_not_fit_are_refused(given, words):
    """Where they are used."""
    with pytest.raises(rbd.InputError, match=words):
        rbd.FunctionConstraint("f", lambda q: q[0], **given).rows(rbd.State(_slider(), np.array([0.3, 0.4]), np.ones(2)))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"phi": 3.0}, "phi of 'f' is 3.0; expected a function of q"),
        ({"name": ""}, "the name of a constraint"),
        ({"jacobian": np.eye(2)}, "jacobian of 'f'"),
        ({"bias": 0.0}, "bias of 'f'"),
        ({"cone": rbd.problem.Free}, "cone of 'f'"),
    ],
)
def test_what_is_no_function_is_refused_at_once(given, words):
    """Before any state is seen."""
    with pytest.raises(rbd.InputError, match=words):
        rbd.FunctionConstraint(**({"name": "f", "phi": lambda q: q[0]} | given))


def test_functions_have_derivatives_of_the_answer():
    """`Solution.derivatives` differences any rows: d a / d q of a bob on a rod, against the differences of its answer."""
    l = 0.5
    rod = rbd.FunctionConstraint("rod", lambda q: math.hypot(q[0], q[1]) - l)
    q, v, model = np.array([0.3, -0.4]), np.array([0.4, 0.3]), _slider()
    d = rbd.solve(rbd.State(model, q, v), np.zeros(0), [rod], solver=rbd.KKT()).derivatives()
    h = 1e-4
    for i, e in enumerate(np.eye(2)):
        ends = [rbd.solve(rbd.State(model, q + s * h * e, v), np.zeros(0), [rod], solver=rbd.KKT()).a for s in (1.0, -1.0)]
        assert np.abs(d.da_dq[:, i] - (ends[0] - ends[1]) / (2.0 * h)).max() < 1e-5
