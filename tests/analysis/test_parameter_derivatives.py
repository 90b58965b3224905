"""Derivatives of an answer by friction, mass, inertia, gravity and stiffness: closed forms, and differences of new solves."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.inertial import body_names, inertial_parameters
from rbd.testing import box

G = 9.81
SOLVERS = {"pyramids": rbd.ProxQP(), "convex": rbd.ConeSolver(law="convex"), "coulomb": rbd.ConeSolver()}
DOWN = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))


def slope(f: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Differences of the fourth order."""
    return (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)


def answer(solution: rbd.Solution) -> np.ndarray:
    return np.concatenate([solution.a, *solution.forces.values()])


def column(found: rbd.answers.analysis.Derivatives, parameter: str, label: str) -> np.ndarray:
    """(da, dforces) by one label."""
    by = found.parameters[parameter]
    return np.concatenate([by.of(label), *[by.force_of(label, name) for name in by.forces]])


def changed(robot: rbd.Robot, body: int, change: np.ndarray) -> rbd.Robot:
    """A copy with other inertial parameters of one body."""
    out = copy.deepcopy(robot)
    theta = inertial_parameters(robot)[body] + change
    out.model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(theta)
    return out


def agree(given: np.ndarray, expected: np.ndarray, tolerance: float = 1e-6) -> None:
    assert np.abs(given - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


class TestClosedForms:
    """One box of 10 kg."""

    def test_a_sliding_box_brakes_with_mu_g(self):
        """The derivative of -mu g by mu is -g, of mu m g by m is mu g, and by gravity a_x changes by -mu per m/s2 of -z."""
        floor = rbd.PointContact("floor", "box", friction=0.5)
        state = rbd.State(box(10.0), [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        found = rbd.solve(state, [], [floor]).derivatives(parameters=("friction", "mass", "gravity"))
        assert found.active == {"floor": ("slides",)}
        agree(column(found, "friction", "floor"), np.array([-G, 0, 0, 0, 0, 0, -10.0 * G, 0, 0]), 1e-12)
        agree(column(found, "mass", "box"), np.array([0, 0, 0, 0, 0, 0, -0.5 * G, 0, G]), 1e-12)
        agree(column(found, "gravity", "z"), np.array([0.5, 0, 0, 0, 0, 0, 5.0, 0, -10.0]), 1e-12)

    @pytest.mark.parametrize("law", ["coulomb", "convex"])
    def test_a_block_slips_down_an_incline(self, law: str):
        """Coulomb: a = g (sin - mu cos) along it; the convex law lifts it with mu times that, at a / (1 + mu^2)."""
        angle, mu = 0.6, 0.3
        down, up = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
        plane = rbd.PointContact("plane", "box", friction=mu, on=rbd.Ground(normal=up))
        solution = rbd.solve(rbd.State(box(10.0), [0, 0, 0, 0, 0, 0, 1]), [], [plane], law=law)
        by = solution.derivatives(parameters="friction").parameters["friction"].of("plane")[:3]
        along = G * (np.sin(angle) - mu * np.cos(angle))
        if law == "coulomb":
            agree(by, -G * np.cos(angle) * down, 1e-9)
        else:  # a = along / (1 + mu^2) (down + mu up)
            size = along / (1.0 + mu**2)
            by_mu = -G * np.cos(angle) / (1.0 + mu**2) - 2.0 * mu * size / (1.0 + mu**2)
            agree(solution.a[:3], size * (down + mu * up), 1e-9)
            agree(by, by_mu * (down + mu * up) + size * up, 1e-9)

    @pytest.mark.parametrize("law", ["coulomb", "convex"])
    @pytest.mark.parametrize("v", [[1.0, 0.3, 0.0, 0.0, 0.0, 0.5], [0.0] * 6], ids=["slides and turns", "begins to slip"])
    def test_an_edge_that_slides_turns_and_slips_agrees_with_differences(self, v: list[float], law: str):
        """Two points with different directions of friction; a pushed edge under both laws."""
        if law == "convex" and any(v):
            return  # it solves no sliding contact
        state = rbd.State(box(10.0), [0, 0, 0.1, 0, 0, 0, 1], v)
        push = None if any(v) else rbd.ExternalForce("box", (80.0, 10.0, 0.0))

        def solved(mu: float) -> rbd.Solution:
            edge = rbd.LineContact("edge", "box", half_length=0.2, placement=DOWN, friction=mu)
            return rbd.solve(state, [], [edge], law=law, external=push)

        found = solved(0.5).derivatives(parameters="friction")
        assert found.active == {"edge": (("slides",) if any(v) else ("slips",)) * 2}
        agree(column(found, "friction", "edge"), slope(lambda h: answer(solved(0.5 + h)), 1e-3))

    def test_a_sole_that_slides_brakes_with_mu_g_however_its_corners_share(self):
        """Four corners, one direction: the share does not matter."""
        patch = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=DOWN, friction=0.5)
        solution = rbd.solve(rbd.State(box(10.0), [0, 0, 0.1, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0]), [], [patch])
        by = solution.derivatives(parameters="friction").parameters["friction"].of("floor")
        agree(by, np.array([-G, 0, 0, 0, 0, 0]), 1e-9)

    def test_what_sticks_does_not_feel_more_friction(self):
        """Zero to the last bit, of motion and force; by mass the floor carries g per kilogram."""
        patch = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=DOWN, friction=0.6)
        push = rbd.ExternalForce("box", (20.0, 0, 0))
        solution = rbd.solve(rbd.State(box(10.0), [0, 0, 0.1, 0, 0, 0, 1]), [], [patch], external=push)
        found = solution.derivatives(parameters=("friction", "mass"))
        assert not column(found, "friction", "floor").any()
        agree(found.parameters["mass"].force_of("box", "floor"), np.array([0, 0, G, 0, 0, 0]), 1e-12)

    def test_a_mass_on_a_spring_in_a_joint(self):
        """da/dk = -x / J and da/dk of the rest is k / J, J the inertia about the joint."""
        arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        state, name = arm.at([0.1]), arm.actuated_names[0]

        class Wound:
            """A spring with its parameters' forces."""

            name, parameters = "wound", ("stiffness", "rest")

            def generalised(self, state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
                return -20.0 * state.q, np.zeros(6)

            def derivatives(self, state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
                return np.array([[-20.0]]), np.zeros((1, 1))

            def energy(self, state: rbd.State) -> float:
                return 10.0 * float(state.q @ state.q)

            def dissipation(self, state: rbd.State) -> float:
                return 0.0

            def parameter_force(self, state: rbd.State, parameter: str) -> np.ndarray:
                return -state.q if parameter == "stiffness" else np.array([20.0])

        solution = rbd.solve(state, np.zeros(1), [], external=[Wound()])
        found = solution.derivatives(parameters=("stiffness", "rest")).parameters
        inertia = state.M[0, 0]
        assert found["stiffness"].labels == ("wound",) and name
        agree(found["stiffness"].of("wound"), np.array([-0.1 / inertia]), 1e-12)
        agree(found["rest"].of("wound"), np.array([20.0 / inertia]), 1e-12)
        with pytest.raises(rbd.InputError, match="no preload to differentiate by: external has wound"):
            solution.derivatives(parameters="preload")


def test_springs_of_every_kind_agree_with_differences(talos: rbd.Robot):
    """Stiffness, damping, rest and preload of a spring, a damper, a bushing and two joints on a moving Talos on its soles."""
    state = rbd.State(talos, talos.standing().q, np.random.default_rng(2).normal(size=talos.nv) * 0.2)
    soles, tau = talos.soles(None), np.zeros(talos.nu)

    def elements(spring=300.0, rest=0.4, preload=5.0, damper=20.0, joint=15.0, damping=3.0, bushing=200.0) -> list[Any]:
        return [
            rbd.Spring("gripper_left_base_link", (0.5, 0.5, 1.2), stiffness=spring, rest=rest, preload=preload),
            rbd.Damper("gripper_right_base_link", "torso_2_link", damping=damper),
            rbd.Bushing("gripper_left_base_link", "torso_2_link", stiffness=[100.0, 100.0, bushing, 5.0, 5.0, 5.0]),
            rbd.JointSpring("arm_left_4_joint", stiffness=joint, rest=-0.3),
            rbd.JointDamping({"arm_right_4_joint": damping, "torso_1_joint": 2.0}),
        ]

    def solved(**changed: float) -> np.ndarray:
        return answer(rbd.solve(state, tau, soles, external=elements(**changed)))

    given = rbd.solve(state, tau, soles, external=elements())
    found = given.derivatives(parameters=("stiffness", "damping", "rest", "preload"))
    bushing, damping = (names for names in (found.parameters["stiffness"].labels, found.parameters["damping"].labels))
    names = [e.name for e in elements()]
    for parameter, label, which, value in (
        ("stiffness", names[0], "spring", 300.0),
        ("rest", names[0], "rest", 0.4),
        ("preload", names[0], "preload", 5.0),
        ("damping", names[1], "damper", 20.0),
        ("stiffness", names[3], "joint", 15.0),
        ("stiffness", next(x for x in bushing if x == f"{names[2]}.z"), "bushing", 200.0),
        ("damping", next(x for x in damping if x.endswith("arm_right_4_joint")), "damping", 3.0),
    ):
        expected = slope(lambda h, which=which, value=value: solved(**{which: value + h}), 1e-2 * value)
        agree(column(found, parameter, label), expected)
        assert np.abs(expected).max() > 1e-4, label
    assert "by stiffness of" in str(found) and "by preload of" in str(found)


def talos_at_a_wall(talos: rbd.Robot, law: str) -> tuple[rbd.State, np.ndarray, list[Any], Any]:
    """On its soles, torques off balance, a hand that slips along a wall in front of it; (state, tau, contacts, pushes)."""
    state = talos.standing().with_joints({"arm_left_4_joint": -1.4, "arm_left_1_joint": 0.3})
    hand = state.frame("gripper_left_base_link").X_WF.translation
    wall = rbd.Ground(point=hand, normal=(-1.0, 0.0, 0.0))
    contacts = [*talos.soles(0.8), rbd.PointContact("hand", "gripper_left_base_link", friction=0.25, on=wall)]
    held = rbd.hold(talos.standing(), talos.soles()).tau
    push = [rbd.ExternalForce("gripper_left_base_link", (120.0, 30.0, -60.0))]
    return state, held, contacts, push


@pytest.mark.parametrize("name", SOLVERS)
def test_a_hand_that_slips_along_a_wall_agrees_with_differences(name: str, talos: rbd.Robot):
    """Friction of hand and sole, masses of torso and forearm, one inertia, a component of gravity: new solves of copies."""
    solver = SOLVERS[name]
    state, tau, contacts, push = talos_at_a_wall(talos, name)

    def solved(robot: rbd.Robot = talos, hand: float = 0.25) -> np.ndarray:
        acting = [*contacts[:2], rbd.PointContact("hand", "gripper_left_base_link", friction=hand, on=contacts[2].on)]
        return answer(rbd.solve(rbd.State(robot, state.q, state.v), tau, acting, external=push, solver=solver))

    solution = rbd.solve(state, tau, contacts, external=push, solver=solver)
    found = solution.derivatives(parameters=("friction", "mass", "inertia", "gravity"))
    assert found.active["hand"] == ("slips",) and not found.not_unique, found.active
    agree(column(found, "friction", "hand"), slope(lambda h: solved(hand=0.25 + h), 1e-4))
    assert np.abs(column(found, "friction", "hand")).max() > 10.0
    bodies, theta = body_names(talos), inertial_parameters(talos)
    for body in ("torso_2_link", "arm_left_5_link"):
        i = bodies.index(body)
        by_mass = slope(lambda h, i=i: solved(changed(talos, i, h * theta[i] / theta[i, 0])), 1e-3)
        agree(column(found, "mass", body), by_mass)
    i = bodies.index("arm_left_5_link")
    by_inertia = slope(lambda h: solved(changed(talos, i, h * np.eye(10)[1])), 1e-4)
    agree(column(found, "inertia", "arm_left_5_link.mc_x"), by_inertia)

    def pulled(h: float) -> np.ndarray:
        robot = copy.deepcopy(talos)
        robot.model.gravity.linear = talos.gravity + np.array([h, 0.0, 0.0])
        return solved(robot)

    agree(column(found, "gravity", "x"), slope(pulled, 1e-3))


def test_forces_that_are_not_unique_have_no_derivatives(talos: rbd.Robot):
    """Bilateral corners on a sole: motion by mass, no forces."""
    state, corners = talos.standing(), talos.soles(None)
    twice = [*corners, rbd.PointContact("heel", "left_sole_link", offset=(-0.05, 0.0, 0.0), on=None)]
    found = rbd.solve(state, np.zeros(talos.nu), twice).derivatives(parameters="mass")
    by = found.parameters["mass"]
    assert by.df is None and by.forces["heel"] is None and by.forces["right_sole"] is not None
    assert np.isfinite(by.da).all() and by.force_of("torso_2_link", "heel") is None


def test_bad_requests_are_named(talos: rbd.Robot):
    """Unknown parameters, labels and constraints; a problem of arrays has no body."""
    solution = rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles())
    with pytest.raises(rbd.errors.UnknownName, match="no parameter 'frction'; nearest: 'friction'"):
        solution.derivatives(parameters="frction")
    with pytest.raises(rbd.InputError, match="parameters is 3"):
        solution.derivatives(parameters=3)  # type: ignore[arg-type]
    with pytest.raises(rbd.InputError, match="no stiffness to differentiate by: external has no springs or dampers"):
        solution.derivatives(parameters="stiffness")
    found = solution.derivatives(parameters="mass").parameters["mass"]
    with pytest.raises(rbd.errors.UnknownName, match="torso_2_link"):
        found.of("torso_2_lnk")
    with pytest.raises(rbd.errors.UnknownName, match="no constraint"):
        found.force_of("torso_2_link", "left")
    assert "by mass of" in str(found) and str(pickle.loads(pickle.dumps(found))) == str(found)
