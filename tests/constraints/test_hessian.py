"""Hessians of constraints given by functions, against those of contacts and against the bias along any velocity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.dynamics import constraint_hessian

FOOT = "left_sole_link"


@pytest.fixture(scope="module")
def state(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose, moving."""
    rng = np.random.default_rng(0)
    return talos.at(pin.integrate(talos.model, talos.neutral(), 0.5 * rng.normal(size=talos.nv)), rng.normal(size=talos.nv))


def foot(robot: rbd.Robot) -> tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]:
    """(position of a foot, its Jacobian), by forward kinematics alone; every call is counted in their `calls`."""
    data, frame = robot.model.createData(), robot.frame_id(FOOT)

    def position(q: np.ndarray) -> np.ndarray:
        calls.append(1)
        pin.framesForwardKinematics(robot.model, data, q)
        return data.oMf[frame].translation.copy()

    def J(q: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(robot.model, data, q)
        pin.updateFramePlacements(robot.model, data)
        return pin.getFrameJacobian(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]

    calls: list[int] = []
    position.calls = calls  # type: ignore[attr-defined]
    return position, J


@pytest.mark.parametrize("given", ["phi", "jacobian", "bias", "velocity"])
def test_hessian_of_a_foots_position_is_that_of_its_contact(state: rbd.State, given: str) -> None:
    """By differences of phi to 1e-9 of J; of J to 1e-10; of a given bias to rounding."""
    robot, contact = state.robot, rbd.PointContact("foot", FOOT)
    phi, J = foot(robot)

    def bias(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return contact.rows(rbd.State(robot, q, v)).bias

    if given == "velocity":
        constraint = rbd.VelocityConstraint("foot", J)
    else:
        given_too = {"phi": {}, "jacobian": {"jacobian": J}, "bias": {"jacobian": J, "bias": bias}}[given]
        constraint = rbd.FunctionConstraint("foot", phi, **given_too)
    H, expected = constraint_hessian(state, constraint), constraint_hessian(state, contact)
    assert H.shape == (3, robot.nv, robot.nv) and np.array_equal(H, H.transpose(0, 2, 1))
    size = np.abs(contact.rows(state).J).max()
    assert np.abs(H - expected).max() < {"phi": 1e-9, "jacobian": 1e-10, "velocity": 1e-10, "bias": 1e-13}[given] * size
    v = np.random.default_rng(1).normal(size=robot.nv)
    assert np.abs(v @ H @ v - contact.rows(state.with_velocity(v)).bias).max() < 1e-7 * np.abs(v @ expected @ v).max()


def test_the_jacobian_is_differenced_once_and_not_for_each_two_coordinates(state: rbd.State) -> None:
    """Six calls a direction, 38 x 39 / 2 directions, and the Jacobian's own: it was that Jacobian 780 times."""
    phi, _ = foot(state.robot)
    constraint_hessian(state, rbd.FunctionConstraint("foot", phi))
    nv = state.robot.nv
    assert len(phi.calls) < 2 * (6 * nv * (nv + 1) // 2)  # type: ignore[attr-defined]


def test_hessian_is_the_bias_along_each_two_coordinates() -> None:
    """The arm's own polarised bias, from its rows, bit by bit."""
    robot = rbd.load_robot("panda", root="fixed")
    state = rbd.State(robot, pin.integrate(robot.model, robot.neutral(), np.full(robot.nv, 0.3)))
    constraint = rbd.FunctionConstraint("waves", lambda q: [np.sin(q[0] + 2.0 * q[1]) * q[2], q[3] * q[4] * q[5]])

    class Plain:
        name = "waves"

        def rows(self, at: rbd.State) -> rbd.Rows:
            return constraint.rows(at)

    assert np.array_equal(constraint_hessian(state, constraint), constraint_hessian(state, Plain()))


def test_feedback_is_no_part_of_a_hessian(state: rbd.State) -> None:
    """Stabilised, a function and a contact have the Hessians that they have without."""
    for constraint in (rbd.FunctionConstraint("foot", *foot(state.robot)[:1]), rbd.PointContact("foot", FOOT)):
        pulled = rbd.constraints.Baumgarte(10.0).of(constraint)
        assert np.array_equal(constraint_hessian(state, pulled), constraint_hessian(state, constraint))


def test_a_constant_matrix_and_a_function_that_is_inactive_have_no_second_derivative(state: rbd.State) -> None:
    """Zeros, of the right shape."""
    nv = state.robot.nv
    constant = rbd.VelocityConstraint("slide", np.eye(nv)[:2])
    inactive = rbd.FunctionConstraint("none", lambda q: np.zeros(0))
    assert constraint_hessian(state, constant).shape == (2, nv, nv) and not constraint_hessian(state, constant).any()
    assert constraint_hessian(state, inactive).shape == (0, nv, nv)
    by_bias = rbd.VelocityConstraint("slide", np.eye(nv)[:1], bias=lambda q, v: [v[0] * v[1]])
    H = constraint_hessian(state, by_bias)
    assert H[0, 0, 1] == H[0, 1, 0] == 0.5 and np.count_nonzero(H) == 2


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        (rbd.FunctionConstraint("kink", lambda q: abs(q[7])), "phi of 'kink' has no derivative"),
        (rbd.FunctionConstraint("lost", lambda q: np.nan), "phi of 'lost' is .*nan.* expected finite numbers"),
        (
            rbd.FunctionConstraint("moved", lambda q: q[7], bias=lambda q, v: 1.0),
            "what 'moved' touches moves, so its J_dot v is not quadratic",
        ),
        (rbd.VelocityConstraint("step", lambda q: np.sign(q[7]) * np.eye(38)[0]), "A of 'step' has no derivative"),
    ],
    ids=["kink", "nan", "bias at rest", "jump"],
)
def test_what_has_no_hessian_is_refused(talos: rbd.Robot, constraint: object, words: str) -> None:
    """By name, as its rows are."""
    with pytest.raises(rbd.InputError, match=words):
        constraint_hessian(rbd.State(talos, talos.neutral()), constraint)
