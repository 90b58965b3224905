"""Planar loops whose plane is tilted: their redundant rows are not zero but rounding, and must not count."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel

CORNERS = np.array([[0.0, 0.0], [0.1, 0.6], [0.9, 0.8], [1.0, 0.1]])  # of a four-bar [m]


def _four_bar(normal: np.ndarray, *, floats: bool) -> CheckedModel:
    """A four-bar in the plane across a normal; its last bar ends at "tip", where the first begins, "pivot"."""
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal).toRotationMatrix()
    P = np.column_stack([CORNERS, np.zeros(4)]) @ R.T
    model = pin.Model()
    root, at = 0, pin.SE3.Identity()
    if floats:
        root = model.addJoint(0, pin.JointModelFreeFlyer(), at, "root_joint")
        model.appendBodyToJoint(root, pin.Inertia.FromSphere(2.0, 0.2), at)
    joint, last = root, np.zeros(3)
    for k, here in enumerate((*P[1:],)):
        joint = model.addJoint(joint, pin.JointModelRevoluteUnaligned(normal), pin.SE3(np.eye(3), here - last), f"j{k}")
        onward = (P[(k + 2) % 4] - here) / 2.0
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0 + k, 0.1), pin.SE3(np.eye(3), onward))
        last = here
    model.addBodyFrame("tip", joint, pin.SE3(np.eye(3), P[0] - P[3]), 0)
    model.addBodyFrame("pivot", root, pin.SE3(np.eye(3), P[0]), 0)
    return CheckedModel(model, name="tilted four-bar")


NORMALS = (np.array([0.36, 0.48, 0.8]), np.array([-0.6, 0.0, 0.8]), np.array([1.0, 2.0, -3.0]) / np.sqrt(14.0))


@pytest.mark.parametrize("floats", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("normal", NORMALS, ids=["one", "two", "three"])
@pytest.mark.parametrize("twice", [False, True], ids=["once", "twice"])
def test_a_tilted_loop_moves_as_its_independent_rows_say(normal: np.ndarray, floats: bool, twice: bool) -> None:
    """Five rows of rank 2, given once or twice, against the two independent ones, at rest and moving as a rigid body."""
    robot = _four_bar(normal, floats=floats)
    q, v = pin.neutral(robot.model), np.zeros(robot.nv)
    v[:6] = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6] if floats else 0.0  # of the base alone: the loop does not move in itself
    start = rbd.State(robot, q, v)

    def moved(kinds: list[str]) -> rbd.Trajectory:
        loops = [rbd.LoopClosure(f"{kind}{i}", "pivot", "tip", kind=kind, axis=normal) for i, kind in enumerate(kinds)]
        return rbd.simulate(start, loops, duration=0.02, step=0.005, integrator=rbd.DormandPrince8())

    redundant, independent = moved(["revolute"] * (1 + twice)), moved(["planar"])
    assert np.abs(redundant.q - independent.q).max() < 1e-9
    assert np.abs(redundant.a - independent.a).max() < 1e-7 * np.abs(independent.a).max()
    weight = 9.81 * robot.mass
    assert max(np.abs(f).max() for f in redundant.forces.values()) < 100.0 * weight
    assert redundant.residuals["law"].max() < 1e-9
