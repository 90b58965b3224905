"""The regressor against inverse dynamics, base parameters against textbooks, pseudo-inertias against clouds of points."""

from __future__ import annotations

import copy

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.inertial import COLUMNS, body_names, inertial_parameters
from rbd.motion.identification.possible import is_possible, made_possible, pseudo_inertia, whitened_basis


@pytest.mark.parametrize("name", ["talos", "g1", "panda"])
def test_y_theta_is_inverse_dynamics(name: str, rng: np.random.Generator):
    """To 1e-12 of its largest entry, at any q, v, a; with rotors as known or as columns; with other gravity."""
    robot = copy.deepcopy(rbd.load_robot(name))
    robot.model.armature = rng.uniform(0.0, 0.1, robot.nv) * (np.arange(robot.nv) >= 6 * robot.floating)
    robot.model.gravity.linear = np.array([1.0, 2.0, -5.0])
    for _ in range(5):
        q = pin.integrate(robot.model, robot.neutral(), rng.uniform(-1.0, 1.0, robot.nv))
        state, a = rbd.State(robot, q, rng.normal(size=robot.nv)), rng.normal(size=robot.nv)
        expected = rbd.dynamics.inverse_dynamics(state, a)
        for columns in (("inertia",), COLUMNS, ("damping",)):
            found = rbd.dynamics.regressor(state, a, columns=columns)
            assert found.Y.shape == (robot.nv, len(found.names)) and len(set(found.names)) == len(found.names)
            np.testing.assert_allclose(found.Y @ found.theta + found.known, expected, atol=1e-12 * np.abs(expected).max())
        d = rng.uniform(0.0, 1.0, robot.nv - 6 * robot.floating)
        found = rbd.dynamics.regressor(state, a, columns=["damping"])
        np.testing.assert_allclose(found.Y @ d, np.concatenate([np.zeros(6 * robot.floating), d]) * state.v, atol=1e-14)


def test_contact_forces_are_eliminated(talos: rbd.Robot, rng: np.random.Generator):
    """P J^T = 0, and the equations of motion hold without the forces of a solved state."""
    state, soles = talos.standing(), talos.soles()
    tau = rbd.hold(state, soles).tau + rng.normal(size=talos.nu)
    tau = np.clip(tau, -0.9 * talos.effort_limit, 0.9 * talos.effort_limit)
    solution = rbd.solve(state, tau, soles)
    found = rbd.dynamics.regressor(state, solution.a, soles)
    assert found.P.shape == (26, 38) and "26 equations in 330 parameters of 33 bodies, without contact forces" in str(found)
    np.testing.assert_allclose(found.P @ found.P.T, np.eye(26), atol=1e-12)
    np.testing.assert_allclose(found.P @ solution.problem.J.T, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.Y @ found.theta, found.P @ talos.actuation.T @ tau, atol=1e-8)
    with pytest.raises(rbd.InputError, match="is no constraint"):
        rbd.dynamics.regressor(state, solution.a, [3])  # type: ignore[list-item]


def test_names_and_order_of_the_columns():
    """Ten a body, in the order of the tree, about the origin of the joint's frame."""
    box = rbd.testing.box(mass=10.0)
    I = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    box = copy.deepcopy(box)
    box.model.inertias[1] = I
    theta = inertial_parameters(box)[0]
    body = pin.Inertia.FromDynamicParameters(theta)
    np.testing.assert_allclose(theta[:4], [2.0, 0.2, 0.4, 0.6])
    np.testing.assert_allclose([theta[4], theta[6]], [0.1 + 2.0 * (0.04 + 0.09), 0.2 + 2.0 * (0.01 + 0.09)])
    np.testing.assert_allclose(body.inertia, np.diag([0.1, 0.2, 0.25]), atol=1e-15)
    assert body.mass == 2.0 and body.lever == pytest.approx([0.1, 0.2, 0.3])
    assert rbd.dynamics.body_names(rbd.load_robot("g1"))[:2] == ("pelvis", "left_hip_pitch_link")


class TestBaseParameters:
    """Which combinations can be known."""

    def test_a_planar_arm_is_the_textbooks(self):
        """Of two links of lengths l: m_1 c_1 + l m_2, I_1 + l^2 m_2, m_2 c_2, I_2, and centres off the links' lines."""
        arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[0.7, 1.0]), masses=[1.0, 1.0])
        base = rbd.motion.identification.base_parameters(arm)
        assert base.labels == ("link_1.mc_x", "link_1.mc_z", "link_1.I_yy", "link_2.mc_x", "link_2.mc_z", "link_2.I_yy")
        expected = np.zeros((6, 20))
        for i, column in enumerate(base.columns):
            expected[i, column] = 1.0
        expected[0, 10], expected[2, 10] = 0.7, 0.49
        np.testing.assert_allclose(base.B, expected, atol=1e-12)
        assert base.expression(0) == "link_1.mc_x  + 0.7 link_2.m" and not base.tells("link_2.m") and base.tells("link_2.I_yy")
        with pytest.raises(rbd.InputError, match="no parameter 'mass'"):
            base.tells("mass")

    def test_a_floating_tree_has_ten_and_seven_a_hinge(self):
        """213 of G1's 300; the total mass is one of them, no single mass is."""
        robot = rbd.load_robot("g1")
        base = rbd.motion.identification.base_parameters(robot)
        assert base.rank == 10 + 7 * robot.nu == 213
        total = np.tile(np.eye(10)[0], 30)
        assert base.reaches(total) and base.labels[0] == "pelvis.m"
        np.testing.assert_allclose(base.B[0], total, atol=1e-10)
        assert not any(base.tells(f"{name}.m") for name in body_names(robot))

    def test_rounding_is_no_parameter(self):
        """A Panda on a table has 43 of its arm, and four of each finger: one less than by columns of 1e-16."""
        assert rbd.motion.identification.base_parameters(rbd.load_robot("panda", root="fixed")).rank == 51

    def test_bodies_without_mass_have_none(self):
        """The human model joins hinges by bodies without mass: they are in no combination."""
        human = rbd.load_robot("human")
        base, massless = rbd.motion.identification.base_parameters(human), inertial_parameters(human)[:, 0] == 0.0
        assert massless.sum() == 19 and not base.B[:, np.repeat(massless, 10)].any() and base.rank == 155

    def test_the_reduced_equations_are_the_whole_ones(self, rng: np.random.Generator):
        """Y theta = Y_1 B theta for any parameters at states that were not used to find B."""
        robot = rbd.load_robot("panda")
        base = rbd.motion.identification.base_parameters(robot, columns=COLUMNS)
        assert len(str(base).splitlines()) == 14 and "and" in str(base) and repr(base).startswith("BaseParameters(")
        for _ in range(5):
            q = pin.integrate(robot.model, robot.neutral(), rng.uniform(-1.0, 1.0, robot.nv))
            Y = rbd.dynamics.regressor(
                rbd.State(robot, q, rng.normal(size=robot.nv)), rng.normal(size=robot.nv), columns=COLUMNS
            ).Y
            theta = rng.normal(size=Y.shape[1])
            np.testing.assert_allclose(Y[:, base.columns] @ base.values(theta), Y @ theta, atol=1e-9)


class TestPseudoInertia:
    """P of a cloud of points is its matrix of second moments."""

    def test_a_cloud_of_points(self, rng: np.random.Generator):
        """The sum of m (x, 1) (x, 1)^T, and back to the ten parameters."""
        points, masses = rng.normal(size=(6, 3)), rng.uniform(0.1, 1.0, 6)
        whole = sum((pin.Inertia(m, x, np.zeros((3, 3))) for m, x in zip(masses, points, strict=True)), pin.Inertia.Zero())
        theta = whole.toDynamicParameters()
        ones = np.column_stack([points, np.ones(6)])
        np.testing.assert_allclose(pseudo_inertia(theta), (ones.T * masses) @ ones, atol=1e-12)
        np.testing.assert_allclose(pin.PseudoInertia.FromMatrix(pseudo_inertia(theta)).toDynamicParameters(), theta, atol=1e-12)
        np.testing.assert_allclose(np.tensordot(theta, whitened_basis(pseudo_inertia(theta)), axes=1), np.eye(4), atol=1e-10)
        assert is_possible(theta)

    def test_what_no_body_can_have(self):
        """Moments that break the triangle inequality, a negative mass, a point; and the nearest that is possible."""
        broken = pin.Inertia(2.0, np.array([0.1, 0.0, 0.2]), np.diag([0.01, 0.01, 0.05])).toDynamicParameters()
        point = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))).toDynamicParameters()
        assert not is_possible(broken) and not is_possible(point) and not is_possible(-broken)
        for theta in (broken, point):
            better = made_possible(theta)
            assert is_possible(better)
            np.testing.assert_allclose(better[:4], theta[:4], atol=1e-15)
