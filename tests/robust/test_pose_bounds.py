"""Bounds over poses: random members lie inside, and the remainder falls with the square of the box."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.robust.pose_bounds import Taylor, bounds_over_poses
from rbd.robust.poses import posed

ROUNDED = 1e-11
"""Far above the rounding of Pinocchio's own evaluation, in m and N m, far below the remainders that are tested."""


def boxed(
    robot: rbd.Robot, count: int, half: float, rng: np.random.Generator
) -> tuple[rbd.State, dict[str, tuple[float, float]]]:
    """A random pose, and a box around random joints of it."""
    state = robot.at()
    single = [name for name in robot.joints if robot.model.joints[robot.model.getJointId(name)].nq == 1]
    q = state.q.copy()
    for name in single:
        q[robot.model.joints[robot.model.getJointId(name)].idx_q] += rng.uniform(-0.3, 0.3)
    names = rng.choice(single, min(count, len(single)), replace=False)
    at = {str(name): float(q[robot.model.joints[robot.model.getJointId(name)].idx_q]) for name in names}
    return rbd.State(robot, q), {name: (x - half, x + half) for name, x in at.items()}


def outside(found: Taylor, d: np.ndarray, value: np.ndarray) -> float:
    """How far a value is beyond the form's bounds."""
    given = found.at(d)
    return float((np.abs(value - given.mid) - given.rad).max())


def check_members(
    robot: rbd.Robot, draws: int, half: float, seed: int, points: dict[str, tuple[str, tuple[float, ...]]]
) -> None:
    """Positions, Jacobians, centre of mass and gravity torques of random members, by Pinocchio."""
    rng = np.random.default_rng(seed)
    state, box = boxed(robot, 12, half, rng)
    bounds = bounds_over_poses(state, box, points)
    model, data = robot.model, robot.model.createData()
    places = [model.joints[model.getJointId(name)].idx_q for name in bounds.joints]
    for i in range(draws):
        q = state.q.copy()
        corner = i % 4 == 0
        q[places] = [rng.choice(ends) if corner else rng.uniform(*ends) for ends in (box[name] for name in bounds.joints)]
        d = bounds.difference(dict(zip(bounds.joints, q[places], strict=True)))
        assert (np.abs(d) <= bounds.reach).all()
        assert outside(bounds.gravity, d, pin.computeGeneralizedGravity(model, data, q)) <= ROUNDED
        assert outside(bounds.com, d, pin.centerOfMass(model, data, q)) <= ROUNDED
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name, (frame, offset) in points.items():
            number, arm = model.getFrameId(frame), data.oMf[model.getFrameId(frame)].rotation @ np.array(offset)
            J = pin.getFrameJacobian(model, data, number, pin.LOCAL_WORLD_ALIGNED)
            assert outside(bounds.points[name], d, data.oMf[number].translation + arm) <= ROUNDED
            assert outside(bounds.jacobians[name], d, J[:3] - pin.skew(arm) @ J[3:]) <= ROUNDED


def test_random_members_lie_inside(exhaustive: bool):
    """Of a robot on legs, and of an arm with prismatic fingers; 10^4 members, of a humanoid too, in the exhaustive run."""
    draws = 5000 if exhaustive else 24
    if exhaustive:
        check_members(rbd.load_robot("talos"), draws, 0.05, 1, {"left": ("left_sole_link", (0.1, 0.05, 0.0))})
    check_members(rbd.load_robot("solo12"), draws, 0.2, 1, {"toe": ("FL_FOOT", (0.0, 0.0, -0.01))})
    check_members(rbd.load_robot("panda", root="fixed"), draws, 0.2, 2, {"hand": ("panda_hand", (0.0, 0.0, 0.1))})


@pytest.mark.parametrize("name", ["solo12", "panda"])
def test_the_remainder_falls_with_the_cube_of_the_box(name: str):
    """A tenth of the box leaves a thousandth of the remainder; a box of no width leaves rounding."""
    robot = rbd.load_robot(name)
    found = {}
    for half in (0.05, 0.005, 0.0):
        state, box = boxed(robot, 12, half, np.random.default_rng(3))
        bounds = bounds_over_poses(state, box, {"end": (robot.frames()[-1], (0.0, 0.0, 0.1))})
        found[half] = np.array([bounds.gravity.rad.max(), bounds.com.rad.max(), bounds.jacobians["end"].rad.max()])
    ratio = found[0.05] / found[0.005]
    assert (ratio > 900.0).all() and (ratio < 1300.0).all()
    assert (found[0.0] < 1e-12 * np.array([1e2, 1.0, 1.0])).all()


def test_slopes_are_derivatives():
    """The linear parts are those of central differences."""
    robot = rbd.load_robot("solo12")
    state, box = boxed(robot, 3, 0.1, np.random.default_rng(4))
    bounds = bounds_over_poses(state, box)
    for i, name in enumerate(bounds.joints):
        g = []
        for step in (1e-5, -1e-5):
            q = state.q.copy()
            q[robot.model.joints[robot.model.getJointId(name)].idx_q] += step
            g.append(pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q))
        assert np.abs((g[0] - g[1]) / 2e-5 - bounds.gravity.slopes[i]).max() < 1e-8


def test_the_range_holds_what_every_member_has():
    """A pendulum of two links: the range of its height over the box is within a remainder of the true one."""
    robot = rbd.load_robot("double_pendulum", root="fixed")
    name = robot.model.names[1]
    bounds = bounds_over_poses(robot.at(), {name: (0.4, 0.6)})
    heights = []
    for angle in np.linspace(0.4, 0.6, 21):
        q = robot.at().q.copy()
        q[0] = angle
        heights.append(robot.at(q).com[2])
    found = bounds.com.range
    assert found.lower[2] <= min(heights) and max(heights) <= found.upper[2]
    assert found.width[2] <= (max(heights) - min(heights)) + 4.0 * (bounds.com.bend + bounds.com.rad)[2]


def test_joints_without_end_are_angles():
    """Continuous joints have (cos, sin) among their coordinates; boxes are of their angles, in any turn."""
    robot = rbd.load_robot("kinova", root="fixed")
    box = {"j2s6s200_joint_1": (3.0, 3.3), "j2s6s200_joint_4": (-0.2, 0.1), "j2s6s200_joint_2": (2.9, 3.0)}
    rng = np.random.default_rng(7)
    state = robot.at()
    bounds = bounds_over_poses(state, box, {"hand": ("j2s6s200_end_effector", (0.0, 0.0, 0.1))})
    for _ in range(8):
        values = {name: float(rng.choice(ends) if rng.random() < 0.3 else rng.uniform(*ends)) for name, ends in box.items()}
        pose = posed(state, values)
        d = bounds.difference(values)
        hand = pose.frame("j2s6s200_end_effector", (0.0, 0.0, 0.1))
        assert outside(bounds.points["hand"], d, hand.X_WF.translation) <= ROUNDED
        assert outside(bounds.jacobians["hand"], d, hand.J[:3]) <= ROUNDED
        assert outside(bounds.gravity, d, pose.h) <= ROUNDED


def test_boxes_and_joints_that_make_no_sense_are_refused():
    """Each names what came."""
    solo = rbd.load_robot("solo12")
    state = solo.standing()
    for bad in ({"FL_KFE": (0.1, -0.1)}, {"FL_KFE": (0.0, np.inf)}, {"FL_KFE": 0.1}, {"FL_KFA": (0.0, 0.1)}, [("FL_KFE", 0.1)]):
        with pytest.raises(rbd.InputError):
            bounds_over_poses(state, bad)  # type: ignore[arg-type]
    with pytest.raises(rbd.errors.Unsupported, match="'root_joint' is a FreeFlyer"):
        bounds_over_poses(state, {"root_joint": (0.0, 0.1)})
    with pytest.raises(rbd.InputError, match="expected \\(frame, offset"):
        bounds_over_poses(state, {"FL_KFE": (0.0, 0.1)}, {"toe": "FL_FOOT"})  # type: ignore[dict-item]
