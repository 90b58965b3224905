"""Velocity constraints: rows as given, blades, sleighs and skates with known motions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import ConstraintWrong, box, check_constraint

G = 9.81
HERE = pin.SE3.Identity()
SOLVERS = [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()]
EACH_SOLVER = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)


def planar(body: pin.Inertia, placement: pin.SE3 = HERE) -> CheckedModel:
    """A body on a plane, z its normal: q = (x, y, cos, sin), v = (vx, vy, w) in the body's axes. Its frame is "body"."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), placement, "plane")
    model.appendBodyToJoint(joint, body, HERE)
    model.addFrame(pin.Frame("body", joint, 0, HERE, pin.FrameType.OP_FRAME))
    return CheckedModel(model, passive=["plane"], name="sleigh")


def pose(x: float, y: float, th: float) -> np.ndarray:
    """Configuration of a planar joint."""
    return np.array([x, y, np.cos(th), np.sin(th)])


@pytest.fixture(scope="module")
def bent(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose, moving."""
    rng = np.random.default_rng(1)
    q = pin.integrate(talos.model, talos.standing().q, 0.5 * rng.normal(size=talos.nv))
    return talos.at(q, rng.normal(size=talos.nv))


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.6, 0, 0.8), (0, -1, 0)])
def test_a_blade_describes_its_motion(bent, normal):
    """J_dot v against the change of its own J; J against the velocity of the point across the blade, by differences."""
    blade = rbd.KnifeEdge("blade", "left_sole_link", direction=(1, 0.3, 0.1), normal=normal, offset=(0.1, 0, -0.1))
    assert check_constraint(blade, bent).jdot_v < 1e-7  # its sixth order on a blade that whirls at 10 rad/s
    model, h = bent.robot.model, 1e-5
    n, rows = np.array(normal, float), blade.rows(bent)
    X, v = bent.frame("left_sole_link").X_WF, bent.v
    d = X.rotation @ [1.0, 0.3, 0.1]
    l = np.cross(n, d) / np.linalg.norm(np.cross(n, d))
    ends = [
        rbd.State(bent.robot, pin.integrate(model, bent.q, s * h * v)).frame("left_sole_link", (0.1, 0, -0.1)).X_WF.translation
        for s in (1.0, -1.0)
    ]
    assert abs(rows.velocity[0] - l @ (ends[0] - ends[1]) / (2.0 * h)) < 1e-8
    assert np.abs(rows.patch.axes - np.column_stack([np.cross(l, n), l, n])).max() < 1e-15


def test_rows_as_given_describe_their_motion(bent):
    """A(q) by a function: A_dot v against the change of A along the motion; its J is what was given."""

    def A(q: np.ndarray) -> np.ndarray:
        return np.outer(np.sin(q[:3]), np.tile(np.r_[q[3:7], q[10]], 8)[:38])

    row = rbd.VelocityConstraint("row", A)
    assert check_constraint(row, bent).jdot_v < 1e-9 and np.array_equal(row.rows(bent).J, A(bent.q))
    assert row.rows(bent).error is None


def test_a_wrong_bias_is_caught(bent):
    """It is believed by `rows`, and not by `check_constraint`."""

    def A(q: np.ndarray) -> np.ndarray:
        return np.r_[np.sin(q[7]), np.zeros(37)]

    def bias(q: np.ndarray, v: np.ndarray) -> float:
        return np.cos(q[7]) * v[6] * v[0]

    assert check_constraint(rbd.VelocityConstraint("row", A, bias=bias), bent).jdot_v < 1e-9
    with pytest.raises(ConstraintWrong, match="J_dot v of row 0"):
        check_constraint(rbd.VelocityConstraint("row", A, bias=lambda q, v: 0.0), bent)


def test_rows_on_the_derivative_of_q_are_converted_as_told():
    """The row x' + x th' = 0 on a planar joint: along its motions x e^th stays, to the order of the integrator."""
    row = rbd.VelocityConstraint("row", lambda q: [q[2], -q[3], q[0]])
    model = planar(pin.Inertia(1.0, np.zeros(3), np.eye(3)))
    state = rbd.State(model, pose(0.8, 0.1, 0.3))
    v = np.linalg.svd(row.rows(state).J)[2][1:].T @ [0.7, -0.4]
    h = 1e-4
    ends = [pin.integrate(model.model, state.q, s * h * v) for s in (1.0, -1.0)]
    kept = [q[0] * np.exp(np.arctan2(q[3], q[2])) for q in ends]
    assert np.abs(v).min() > 0.1 and abs(kept[0] - kept[1]) / (2.0 * h) < 1e-8


@EACH_SOLVER
@pytest.mark.parametrize("by", ["blade", "row"])
def test_a_chaplygin_sleigh_turns_and_speeds_up(by, solver):
    """It has v' = a w^2, w' = -(m a / (I + m a^2)) v w, and the blade carries m (v w + a w') sideways (Bloch)."""
    m, a, I, v, w, th = 2.0, 0.3, 0.4, 1.1, -0.9, 0.8
    model = planar(pin.Inertia(m, np.array([a, 0.0, 0.0]), np.diag([0.1, 0.1, I])))
    blade = rbd.KnifeEdge("blade", "body") if by == "blade" else rbd.VelocityConstraint("blade", [0.0, 1.0, 0.0])
    s = rbd.solve(rbd.State(model, pose(0.4, -0.2, th), np.array([v, 0.0, w])), np.zeros(0), [blade], solver=solver)
    turn = -m * a * v * w / (I + m * a**2)
    assert np.abs(s.a - [a * w**2, 0.0, turn]).max() < 1e-9
    sideways = m * (v * w + a * turn)
    expected = sideways * np.array([-np.sin(th), np.cos(th), 0.0]) if by == "blade" else [sideways]
    assert np.abs(s.forces["blade"] - expected).max() < 1e-8


@EACH_SOLVER
@pytest.mark.parametrize("t", [0.0, 0.4, 1.3, 2.9])
def test_a_skate_on_an_incline_drifts_sideways(t, solver):
    """At (g sin b / 2 w^2) (sin^2 wt, wt - sin(2wt) / 2): its acceleration at four instants."""
    b, w = 0.35, 1.4
    down = pin.SE3(pin.exp3(np.array([0.0, b, 0.0])), np.array([0.0, 0.0, 2.0]))  # x points downhill
    model = planar(pin.Inertia(3.0, np.zeros(3), 0.2 * np.eye(3)), down)
    speed = G * np.sin(b) / w * np.sin(w * t)
    k = G * np.sin(b) / (2.0 * w**2)
    q = pose(k * np.sin(w * t) ** 2, k * (w * t - 0.5 * np.sin(2.0 * w * t)), w * t)
    state = rbd.State(model, q, np.array([speed, 0.0, w]))
    blade = rbd.KnifeEdge("skate", "body", normal=down.rotation[:, 2])
    s = rbd.solve(state, np.zeros(0), [blade], solver=solver)
    assert np.abs(s.a - [G * np.sin(b) * np.cos(w * t), 0.0, 0.0]).max() < 1e-9
    R = pin.exp3(np.array([0.0, 0.0, w * t]))
    in_plane = R @ (s.a + np.cross([0.0, 0.0, w], [speed, 0.0, 0.0]))
    expected = 2.0 * k * w**2 * np.array([np.cos(2.0 * w * t), np.sin(2.0 * w * t)])
    assert np.abs(in_plane[:2] - expected).max() < 1e-9


def test_a_blade_of_a_free_box_is_in_the_momentum_balance():
    """Its patch tells where the side force acts: a check that uses no Jacobian."""
    rng = np.random.default_rng(3)
    robot = box()
    state = rbd.State(robot, pin.integrate(robot.model, pin.neutral(robot.model), rng.normal(size=6)), rng.normal(size=6))
    s = rbd.solve(state, np.zeros(0), [rbd.KnifeEdge("blade", "box", offset=(0.2, 0.1, -0.1))], solver=rbd.KKT())
    assert np.linalg.norm(s.forces["blade"]) > 1.0 and s.residuals.centroidal < 1e-12
    assert s.contacts["blade"].normal == pytest.approx(0.0, abs=1e-12)


def test_a_blade_that_stands_on_end_is_refused():
    """Its direction is the plane's normal, so it has no side."""
    state = rbd.State(box(), pin.neutral(box().model))
    with pytest.raises(rbd.InputError, match="is normal to its plane"):
        rbd.KnifeEdge("blade", "box", direction=(0, 0, 1)).rows(state)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rbd.VelocityConstraint("", np.eye(3)), "the name of a constraint is ''"),
        (lambda: rbd.VelocityConstraint("row", "A"), "A of 'row'"),
        (lambda: rbd.VelocityConstraint("row", np.zeros((2, 2, 3))), r"has shape \(2, 2, 3\)"),
        (lambda: rbd.VelocityConstraint("row", [1.0, np.nan]), "not finite"),
        (lambda: rbd.VelocityConstraint("row", [1.0], bias=0.0), "bias of 'row' is 0.0"),
        (lambda: rbd.KnifeEdge("blade", ""), "the frame of what rolls or glides"),
        (lambda: rbd.KnifeEdge("blade", "body", direction=(0, 0, 0)), "direction of 'blade' has length 0"),
        (lambda: rbd.KnifeEdge("blade", "body", normal=(0, 0, 2)), "expected a unit vector"),
        (lambda: rbd.KnifeEdge("blade", "body", offset=(0, 0)), "three numbers"),
    ],
)
def test_constraints_that_say_nothing_are_refused(make, words):
    """At once, before any state is seen."""
    with pytest.raises(rbd.InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("A", "words"),
    [
        (np.eye(4), "has 4 columns; expected nv = 3"),
        (lambda q: np.eye(4), r"shape \(4, 4\); expected \(m, 3\)"),
        (lambda q: np.eye(3)[: 1 + (q[0] > 0.1)], r"expected \(1, 3\)"),
        (lambda q: [abs(q[0] - 0.1), 1.0, 0.0], "A of 'row' has no derivative here"),
        (lambda q: [np.inf, 1.0, 0.0], "A of 'row' is not finite"),
        (lambda q: [1j, 1.0, 0.0], "real numbers"),
        (lambda q: 1 / 0, "A of 'row' raised ZeroDivisionError"),
    ],
)
def test_rows_that_do_not_fit_the_robot_are_refused(A, words):
    """With the constraint's name."""
    state = rbd.State(planar(pin.Inertia(1.0, np.zeros(3), np.eye(3))), pose(0.1, 0.0, 0.0), np.ones(3))
    with pytest.raises(rbd.InputError, match=words):
        rbd.VelocityConstraint("row", A).rows(state)
