"""Bushings: closed forms, the six modes of a body on one, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.state_changes import derivatives_of
from rbd.errors import ForceElementWarning, FrameNotFound, InputError
from rbd.model.external import generalised

K = (400.0, 900.0, 1600.0, 5.0, 6.0, 7.0)


def box(x=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), v=None) -> rbd.State:
    """A box of 10 kg with its centre of mass at x, turned by a rotation vector."""
    q = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array(turn)), np.array(x)))
    return rbd.State(rbd.testing.box(mass=10.0), q, v)


def test_six_springs_of_a_body_in_its_place():
    """Displaced along x, y, z: -k d; turned about one axis: -k angle, at large angles too; the work is the energy."""
    mount = rbd.Bushing("box", to=(0, 0, 0), stiffness=K)
    for i in range(3):
        d = 0.3 * np.eye(3)[i]
        assert mount.force(box(d)) == pytest.approx(np.concatenate([-K[i] * d, np.zeros(3)]), abs=1e-12)
        for angle in (0.2, 2.5):
            state = box(turn=angle * np.eye(3)[i])
            wrench = generalised(state, mount)[1]
            assert wrench[3:] == pytest.approx(-K[3 + i] * angle * np.eye(3)[i], abs=1e-12) and not wrench[:3].any()
            assert mount.energy(state) == pytest.approx(0.5 * K[3 + i] * angle**2, rel=1e-12)


def test_a_box_sags_on_a_bushing():
    """By its weight over the stiffness, with `hold` and no contact; a preload carries it in place."""
    weight = 10.0 * 9.81
    sagged = rbd.hold(box((0, 0, -weight / K[2])), [], external=rbd.Bushing("box", to=(0, 0, 0), stiffness=K, damping=3.0))
    carried = rbd.Bushing("box", to=(0, 0, 0), stiffness=K, preload=(0, 0, weight, 0, 0, 0))
    for held in (sagged, rbd.hold(box(), [], external=carried)):
        assert held.residuals.worst < 1e-9
    assert np.abs(rbd.solve(box(), [], external=carried).a).max() < 1e-12


def test_six_modes_of_a_body_on_a_bushing():
    """Eigenvalues of -M^-1 dtau/dq are k/m and k/I; the bushing's matrix may be full, and off the centre of mass."""
    robot = rbd.testing.box(mass=10.0)
    state = rbd.State(robot, pin.neutral(robot.model))
    found = -np.linalg.solve(state.M, derivatives_of(rbd.Bushing("box", to=(0, 0, 0), stiffness=K), state)[0])
    assert np.sort(np.linalg.eigvals(found).real) == pytest.approx(np.sort(K / state.M.diagonal()), rel=1e-12)
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6))
    r, full = np.array([0.1, -0.2, 0.3]), A @ A.T + np.eye(6)
    mount = rbd.Bushing("box", to=r, offset=r, stiffness=full)
    S = np.eye(6)  # displacement of the point r of a body that moves by (d, turn)
    S[:3, 3:] = -pin.skew(r)
    by_q = derivatives_of(mount, state)[0]
    assert np.abs(by_q + S.T @ full @ S).max() < 1e-12 * np.abs(full).max()
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(state.M, S.T @ full @ S)).real)
    a = rbd.solve(state, [], external=[mount, rbd.ExternalForce("box", (0, 0, 98.1))]).derivatives()
    assert np.sort(np.sqrt(np.linalg.eigvals(-a.da_dq).real)) == pytest.approx(np.sort(omega), rel=1e-10)


def test_damping_is_in_the_axes_of_the_other_place():
    """Between a turned ground pose and the box: the velocity's part along each axis, times its damping."""
    turn = np.array([0.0, 0.0, math.pi / 2])
    v = np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])  # of the box's axes, which are those of the pose
    mount = rbd.Bushing("box", to=pin.SE3(pin.exp3(turn), np.zeros(3)), stiffness=0.0, damping=(3, 50, 0, 0, 0, 0))
    state = box(turn=turn, v=v)
    assert mount.force(state) == pytest.approx([-0.6, 0, 0, 0, 0, 0], abs=1e-14)
    assert generalised(state, mount)[1] == pytest.approx([0, -0.6, 0, 0, 0, 0], abs=1e-14)
    assert mount.dissipation(state) == pytest.approx(0.12, rel=1e-12)


def test_relaxed_where_it_was_made(talos: rbd.Robot):
    """`relaxed_at` has no force at that state, between links and to the ground, and pulls back elsewhere."""
    state = talos.standing()
    for to in ("torso_2_link", None):
        mount = rbd.Bushing.relaxed_at(state, "arm_left_7_link", to, stiffness=(100.0,) * 3 + (5.0,) * 3, offset=(0, 0, 0.1))
        assert np.abs(mount.displacement(state)).max() < 1e-14 and mount.energy(state) < 1e-24
        bent = state.with_joints({"arm_left_4_joint": state.q[talos.joints["arm_left_4_joint"].q][0] + 0.2})
        assert mount.generalised(bent)[0][talos.joints["arm_left_4_joint"].v][0] < -0.1


@pytest.mark.parametrize(
    ("constants", "says"),
    [
        ({"stiffness": (1, 2, 3)}, r"stiffness of 'bushing from box .* has shape \(3,\); expected .*six numbers"),
        ({"stiffness": np.eye(3)}, r"has shape \(3, 3\); expected six numbers, or a symmetric matrix"),
        ({"stiffness": np.triu(np.ones((6, 6)))}, "differs from its transpose by 1"),
        ({"stiffness": (1, 2, 3, 4, 5, math.nan)}, "stiffness of .* is not finite"),
        ({"stiffness": 1.0, "damping": (1, 1, 1, 1, 1, -1)}, "negative eigenvalue -1, which would drive"),
        ({"stiffness": 1.0, "damping": np.full((6, 6), 1.0) - np.eye(6)}, "negative eigenvalue -1"),
        ({"stiffness": 1.0, "preload": (1, 2)}, "preload of .* has shape"),
        ({"stiffness": 1.0, "to": pin.SE3(2.0 * np.eye(3), np.zeros(3))}, "axes that are not orthonormal"),
        ({"stiffness": 1.0, "name": ""}, "expected a string"),
    ],
)
def test_bad_matrices_are_refused(constants: dict, says: str):
    """With the bushing's name."""
    with pytest.raises(InputError, match=says):
        rbd.Bushing("box", **{"to": (0, 0, 0), **constants})


def test_an_indefinite_stiffness_is_warned_of():
    """By its least eigenvalue."""
    with pytest.warns(ForceElementWarning, match="not positive semidefinite .least eigenvalue -3"):
        rbd.Bushing("box", to=(0, 0, 0), stiffness=(1, 2, 3, 4, 5, -3))


def test_a_ball_mount_takes_any_rotation():
    """Without numbers against rotation: a box that tumbles over on it keeps its energy, less its damper's; D is -C's."""
    k = 500.0
    mount = rbd.Bushing("box", to=(0, 0, 0), offset=(0, 0.1, 0.2), stiffness=[k] * 3 + [0.0] * 3, damping=[1.0] * 3 + [0.0] * 3)
    over = box(turn=(math.radians(175.0), 0, 0))
    tau, _ = mount.generalised(over)
    spring = rbd.Spring("box", to=(0, 0, 0), offset=(0, 0.1, 0.2), stiffness=k, rest=0.0)
    assert np.abs(tau - spring.generalised(over)[0]).max() < 1e-9
    assert np.abs(mount.derivatives(over)[0] - spring.derivatives(over)[0]).max() < 1e-9
    start = rbd.State(over.robot, over.q, [0, 0, 0, 9.0, 3.0, 1.0])
    tumbles = rbd.simulate(start, duration=0.5, step=0.05, external=mount, integrator=rbd.DormandPrince8())
    assert np.abs(tumbles.energy + tumbles.dissipated - tumbles.energy[0]).max() < 1e-7
    for bad in (lambda: mount.displacement(over), lambda: mount.parameter_force(over, "stiffness")):
        with pytest.raises(InputError, match="175 degrees from its rest; at most 170"):
            bad()


def test_half_a_turn_and_unknown_frames():
    """Refused at the state, by name."""
    mount = rbd.Bushing("box", to=(0, 0, 0), stiffness=1.0)
    with pytest.raises(InputError, match="'bushing from box to the ground .* is 175 degrees from its rest; at most 170"):
        rbd.solve(box(turn=(math.radians(175.0), 0, 0)), [], external=mount)
    with pytest.raises(FrameNotFound, match="nearest: 'box'"):
        rbd.hold(box(), [], external=rbd.Bushing("boxx", to=(0, 0, 0), stiffness=1.0))
    with pytest.raises(FrameNotFound, match="no frame 'lid'"):
        rbd.hold(box(), [], external=rbd.Bushing("box", to="lid", stiffness=1.0))
