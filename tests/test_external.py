"""Pushes and loads: the same force said in different words moves the robot alike."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import FrameNotFound, InputError
from rbd.model.dynamics import External, generalised

OFFSET = (0.11, -0.07, 0.23)  # [m], off every axis
FORCE, MOMENT = np.array([3.0, -80.0, 20.0]), np.array([1.0, 5.0, -7.0])


@pytest.fixture(scope="module")
def moving(talos: rbd.Robot) -> rbd.State:
    """Talos in the air, turned and moving."""
    rng = np.random.default_rng(0)
    q = pin.integrate(talos.model, talos.standing().q, rng.uniform(-1.0, 1.0, talos.nv))
    return rbd.State(talos, q, rng.normal(size=talos.nv))


def test_a_push_is_its_power(moving: rbd.State) -> None:
    """tau_ext . v = F . v_P + m . w for the push at P, in world axes: whatever v is."""
    tau_ext, _ = generalised(moving, [rbd.ExternalForce("arm_left_7_link", FORCE, MOMENT, OFFSET)])
    for v in np.random.default_rng(1).normal(size=(5, moving.robot.nv)):
        at = moving.with_velocity(v).frame("arm_left_7_link", OFFSET)
        assert abs(tau_ext @ v - FORCE @ at.v[:3] - MOMENT @ at.v[3:]) < 1e-11


def test_a_push_and_its_generalised_force_move_alike(moving: rbd.State) -> None:
    """External given as J^T (F, m) or as ExternalForce: same free motion, same held motion, same certificate."""
    robot, tau = moving.robot, np.zeros(moving.robot.nu)
    push = rbd.ExternalForce("arm_left_7_link", FORCE, MOMENT, OFFSET)
    tau_ext = moving.frame("arm_left_7_link", OFFSET).J.T @ np.concatenate([FORCE, MOMENT])
    one, other = (rbd.dynamics.free_acceleration(moving, tau, e) for e in ([push], tau_ext))
    assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()
    sole = rbd.SurfaceContact("sole", "left_sole_link", half_lengths=(0.1, 0.06))
    held = [rbd.solve(moving, tau, [sole], external=e) for e in ([push], tau_ext, list(tau_ext))]
    for solution in held:
        assert np.abs(solution.a - held[0].a).max() < 1e-10 * np.abs(held[0].a).max()
        assert solution.residuals.centroidal is not None and solution.residuals.centroidal.scaled < 1e-12
    assert robot.floating


def test_both_ways_give_one_wrench_about_the_centre_of_mass(moving: rbd.State) -> None:
    """Force F, and moment r x F + m with r from the centre of mass to P; a generalised force's is in its base part."""
    at = moving.frame("arm_left_7_link", OFFSET)
    r = at.X_WF.translation - moving.com
    expected = np.concatenate([FORCE, MOMENT + np.cross(r, FORCE)])
    push = rbd.ExternalForce("arm_left_7_link", FORCE, MOMENT, OFFSET)
    for external in ([push], push, at.J.T @ np.concatenate([FORCE, MOMENT])):
        assert np.abs(generalised(moving, external)[1] - expected).max() < 1e-12


def test_an_offset_is_an_arm(moving: rbd.State) -> None:
    """A force off the frame's origin is the force at it with the moment R_WF p_FP x F."""
    arm = moving.frame("torso_2_link").X_WF.rotation @ OFFSET
    off = generalised(moving, [rbd.ExternalForce("torso_2_link", FORCE, offset=OFFSET)])
    at = generalised(moving, [rbd.ExternalForce("torso_2_link", FORCE, np.cross(arm, FORCE))])
    for one, other in zip(off, at, strict=True):
        assert np.abs(one - other).max() < 1e-11


def test_pushes_add_up(moving: rbd.State) -> None:
    """Two pushes in one list are the sum of each; one alone needs no list; none is zero."""
    a = rbd.ExternalForce("torso_2_link", FORCE)
    b = rbd.ExternalForce("left_sole_link", (0.0, 0.0, 0.0), MOMENT)
    both, parts = generalised(moving, (a, b)), [generalised(moving, a), generalised(moving, [b])]
    for k in range(2):
        assert np.abs(both[k] - parts[0][k] - parts[1][k]).max() < 1e-12
    for nothing in (None, (), []):
        assert not generalised(moving, nothing)[0].any() and not generalised(moving, nothing)[1].any()


def test_a_push_through_the_centre_of_mass_only_shifts_the_fall(moving: rbd.State) -> None:
    """Rate of momentum = weight + F: the centre of mass of a falling robot gains F / m, here from a push at a hand."""
    robot, tau = moving.robot, np.zeros(moving.robot.nu)
    free, pushed = (
        rbd.dynamics.free_acceleration(moving, tau, e) for e in (None, [rbd.ExternalForce("arm_left_7_link", FORCE)])
    )
    J_com = pin.jacobianCenterOfMass(robot.model, robot.model.createData(), moving.q)
    assert np.abs(J_com @ (pushed - free) - FORCE / robot.mass).max() < 1e-11


def test_on_a_fixed_base_a_load_is_torque_at_the_joints() -> None:
    """A 2 kg load in Panda's hand: solve without contacts feels J^T (0, 0, -2 g)."""
    robot = rbd.load_robot("panda", root="fixed")
    state = robot.standing()
    load = [rbd.ExternalForce("panda_hand", (0.0, 0.0, -2 * 9.81))]
    a = rbd.solve(state, np.zeros(robot.nu), external=load).a
    expected = np.linalg.solve(state.M, state.frame("panda_hand").J.T[:, 2] * (-2 * 9.81) - state.h)
    assert np.abs(a - expected).max() < 1e-10 * np.abs(expected).max()


def test_the_base_is_joint_one_whatever_links_are_called(tmp_path: Path) -> None:
    """A link far down the tree named as the base's joint does not take its place in the certificate."""
    body = '<inertial pos="0 0 0" mass="2" diaginertia="0.1 0.2 0.3"/>'
    arm = f'<body name="floating" pos="0 0 0.7"><joint name="k" type="hinge" axis="1 0 0"/>{body}</body>'
    path = tmp_path / "m.xml"
    path.write_text(
        f'<mujoco model="m"><worldbody><body name="b"><freejoint name="floating"/>{body}{arm}</body></worldbody></mujoco>'
    )
    robot = rbd.load_robot(path)
    state = rbd.State(robot, pin.integrate(robot.model, robot.neutral(), np.arange(7) * 0.1))
    at = state.frame("b")
    tau_ext = at.J.T @ np.concatenate([FORCE, MOMENT])
    expected = np.concatenate([FORCE, MOMENT + np.cross(at.X_WF.translation - state.com, FORCE)])
    assert np.abs(generalised(state, tau_ext)[1] - expected).max() < 1e-12


def test_a_push_keeps_what_it_was_given() -> None:
    """The user's arrays may change afterwards."""
    force = FORCE.copy()
    push = rbd.ExternalForce("torso_2_link", force)
    force[:] = 7.0
    assert np.array_equal(push.force, FORCE)


BAD_VECTORS = [
    (0.0, 0.0),
    80.0,
    (0.0, np.nan, 0.0),
    (0.0, 0.0, np.inf),
    "0,80,0",
    None,
    [[1.0, 2.0, 3.0]],
    ("1", "2", "3"),
    (1j, 0, 0),
]


@pytest.mark.parametrize(
    ("what", "bad"),
    list(itertools.product(["force", "moment", "offset"], BAD_VECTORS)),
)
def test_a_bad_vector_of_a_push_is_refused(what: str, bad: object) -> None:
    """Three finite numbers each; the message says which and at which frame."""
    arguments = {"force": (0.0, 0.0, 1.0), what: bad}
    with pytest.raises(InputError, match=rf"{what} of the external force at 'torso_2_link'"):
        rbd.ExternalForce("torso_2_link", **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("frame", ["torso", None, 4, ["torso_2_link"]])
def test_a_push_at_no_frame_is_refused(moving: rbd.State, frame: str) -> None:
    """By the robot, which knows its frames."""
    with pytest.raises(FrameNotFound, match="no frame"):
        generalised(moving, [rbd.ExternalForce(frame, FORCE)])


PUSH = rbd.ExternalForce("torso_2_link", FORCE)


@pytest.mark.parametrize(
    "external",
    [80.0, "push", b"push", object(), {"torso_2_link": FORCE}, {1.0}, [PUSH, 1.0], [1.0, PUSH], [[PUSH]], [None],
     FORCE, list(FORCE), np.zeros(6), np.zeros(37), np.zeros((38, 1)), np.array(3.0), np.full(38, np.nan), [np.inf] * 38,
     ["a"] * 38, np.zeros(38) + 1j, (PUSH for _ in range(2)), True, [10**400] * 38],
)  # fmt: skip
def test_external_that_is_neither_is_refused(moving: rbd.State, external: External) -> None:
    """Scalars, words, generators, mixtures, wrong sizes, NaN: an InputError, by every function that takes external."""
    tau = np.zeros(moving.robot.nu)
    rest = moving.robot.standing()
    for ask in (
        lambda: generalised(moving, external),
        lambda: rbd.dynamics.free_acceleration(moving, tau, external),
        lambda: rbd.solve(moving, tau, external=external),
        lambda: rbd.hold(rest, moving.robot.soles(), external=external),
    ):
        with pytest.raises(InputError, match="external"):
            ask()


def test_three_numbers_are_told_what_they_should_be(moving: rbd.State) -> None:
    """A bare force vector is the likeliest mistake: the message shows ExternalForce."""
    with pytest.raises(InputError, match=r"external has 3 entries, and a generalised force 38; .*rbd\.ExternalForce\(frame"):
        generalised(moving, (0.0, 80.0, 0.0))
