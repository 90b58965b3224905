"""Accelerations put onto constraints: Gauss's least constraint with the given one in place of the free acceleration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import DuplicateName, InputError
from rbd.mechanism import project_acceleration, project_velocity

URDF = Path(__file__).parents[2] / "urdf"


def least_constraint(state: rbd.State, a: np.ndarray, constraints: list) -> rbd.Solution:
    """Gauss's problem with a_free = a, by its closed form."""
    rows = [c.rows(state) for c in constraints]
    return rbd.solve_problem(rbd.GaussProblem(state.M, state.M @ a, rows), solver=rbd.KKT())


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_it_is_gauss_with_the_acceleration_given(name: str, rng: np.random.Generator) -> None:
    """a+ and the multipliers are those of the closed form; J a+ + J_dot v = 0; what is left of both equations is told."""
    robot = rbd.load_robot(name)
    standing, feet = robot.standing(), robot.feet(friction=None)
    for _ in range(10):
        q = pin.integrate(robot.model, standing.q, 0.3 * rng.normal(size=robot.nv))
        state = project_velocity(robot.at(q, rng.normal(size=robot.nv)), feet)
        a = 5.0 * rng.normal(size=robot.nv)
        found, expected = project_acceleration(state, a, feet), least_constraint(state, a, feet)
        assert np.abs(found.a - expected.a).max() < 1e-9 * max(1.0, np.abs(expected.a).max())
        for foot in feet:
            rows = foot.rows(state)
            assert np.abs(rows.J @ found.a + rows.bias).max() < 1e-10 * max(1.0, np.abs(rows.J @ a + rows.bias).max())
        multipliers = np.concatenate([found.forces[foot.name] for foot in feet])
        assert np.abs(multipliers - expected.multipliers).max() < 1e-9 * max(1.0, np.abs(expected.multipliers).max())
        assert found.residual < 1e-9 * max(1.0, np.abs(state.M @ (found.a - a)).max())
        assert found.missed < 1e-10 * max(1.0, np.abs(a).max())
        again = project_acceleration(state, found.a, feet)
        assert np.abs(again.a - found.a).max() < 1e-10 and np.abs(list(again.forces.values())).max() < 1e-7


def test_none_other_is_nearer(talos: rbd.Robot, rng: np.random.Generator) -> None:
    """Any acceleration that keeps the soles is farther from the given one, in the metric of inertia."""
    soles = talos.soles()
    state = project_velocity(talos.at(talos.standing().q, rng.normal(size=talos.nv)), soles)
    a = rng.normal(size=talos.nv)
    found = project_acceleration(state, a, soles)
    J = np.concatenate([sole.rows(state).J for sole in soles])
    allowed = np.linalg.svd(J)[2][len(J) :]
    least = (found.a - a) @ state.M @ (found.a - a)
    for _ in range(50):
        other = found.a + rng.normal(size=len(allowed)) @ allowed
        assert (other - a) @ state.M @ (other - a) > least


def test_redundant_rows_do_no_harm(talos: rbd.Robot, rng: np.random.Generator) -> None:
    """A sole held twice is held once; its forces are shared evenly, the shortest there are."""
    sole = talos.soles(friction=None)[0]
    twin = rbd.SurfaceContact("twin", sole.frame, corners=sole.corners, placement=sole.placement)
    state = project_velocity(talos.at(talos.standing().q, rng.normal(size=talos.nv)), [sole])
    a = rng.normal(size=talos.nv)
    once, twice = project_acceleration(state, a, [sole]), project_acceleration(state, a, [sole, twin])
    assert np.abs(once.a - twice.a).max() < 1e-10
    for name in ("left_sole", "twin"):
        assert np.abs(2.0 * twice.forces[name] - once.forces["left_sole"]).max() < 1e-8 * np.abs(once.forces["left_sole"]).max()
    assert twice.residual < 1e-8


def test_rows_that_contradict_each_other_are_refused_by_name(talos: rbd.Robot) -> None:
    """Four held corners of a foot that turns at w: each one's w x w x p points inwards, so no acceleration keeps all."""
    sole = talos.soles(friction=None)[0]
    corners = [
        rbd.PointContact(f"corner {i}", sole.frame, offset=sole.placement.act(np.array([x, y, 0.0])))
        for i, (x, y, _) in enumerate(sole.corners)
    ]
    v = np.zeros(talos.nv)
    v[5] = 1.0  # about the vertical
    state = talos.at(talos.standing().q, v)
    with pytest.raises(InputError, match=r"no acceleration of talos satisfies all constraints: 'corner \d' is missed by"):
        project_acceleration(state, np.zeros(talos.nv), corners)
    assert project_acceleration(talos.at(talos.standing().q), np.zeros(talos.nv), corners).missed < 1e-12


def test_loops_are_the_default() -> None:
    """Of the robot's file: the four-bar's, in motion, as Gauss's closed form has it."""
    robot = rbd.load_robot(URDF / "four_bar.urdf")
    q = robot.at("assembled").q
    moving = rbd.mechanism.velocity_partition(robot.at(q), None, {"crank_joint": 2.0})
    state, a = robot.at(q, moving.v), np.array([1.0, -2.0, 0.5])
    found = project_acceleration(state, a)
    expected = least_constraint(state, a, list(robot.loops()))
    assert np.abs(found.a - expected.a).max() < 1e-10 and list(found.forces) == [robot.loops()[0].name]
    assert np.abs(robot.loops()[0].rows(state).bias).max() > 0.1  # there is something to keep


def test_a_ground_that_accelerates_takes_the_robot_along() -> None:
    """A box on a lift: at rest under free fall it is carried up with the lift, moments zero."""
    box = rbd.load_robot(URDF / "box.urdf")
    lift = rbd.SurfaceContact(
        "lift", "box", half_lengths=(0.1, 0.1), on=rbd.Ground(velocity=np.zeros(6), acceleration=(0.0, 0.0, 2.0))
    )
    found = project_acceleration(box.at(), np.zeros(6), [lift])
    assert found.a == pytest.approx([0.0, 0.0, 2.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert found.forces["lift"][2] == pytest.approx(2.0 * box.mass, rel=1e-12)


def test_without_rows_it_stays(talos: rbd.Robot) -> None:
    """No constraints, or dry friction alone: the acceleration as it was given."""
    a = np.linspace(-1.0, 1.0, talos.nv)
    rub = rbd.JointFriction("rub", "arm_left_4_joint", torque=1.0)
    for constraints in ([], [rub]):
        found = project_acceleration(talos.standing(), a, constraints)
        assert np.array_equal(found.a, a) and found.forces == {} and found.residual == found.missed == 0.0


def test_what_is_none_is_refused(talos: rbd.Robot) -> None:
    """Sizes, numbers that are not finite, two of one name, no state."""
    soles, state = talos.soles(), talos.standing()
    for a in (np.zeros(3), np.full(talos.nv, np.nan), "fast"):
        with pytest.raises(InputError, match="a of talos"):
            project_acceleration(state, a, soles)  # type: ignore[arg-type]
    for project in (lambda c: project_acceleration(state, np.zeros(talos.nv), c), lambda c: project_velocity(state, c)):
        with pytest.raises(DuplicateName, match="two constraints are named 'left_sole'"):
            project([soles[0], soles[0]])
        with pytest.raises(InputError, match="single constraint"):
            project(soles[0])
    with pytest.raises(InputError, match="State of a robot was expected"):
        project_acceleration(talos, np.zeros(talos.nv), soles)  # type: ignore[arg-type]
