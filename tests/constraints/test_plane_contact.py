"""Contact points of shapes with a plane: shape by shape, by Pinocchio's frames, and by differences along a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.convex.polygons import LOWEST, MOST_POINTS, RIM_CORNERS, TIPS, TOWARDS, across

ROUNDING = 1e-12
"""Over the size of the largest entry."""
STEP = 1e-6
"""Of differences in time [s]."""
SHAPES = (
    '<sphere radius="0.1"/>',
    '<cylinder radius="0.1" length="0.3"/>',
    '<box size="0.2 0.3 0.1"/>',
)
PLANES = ((0.0, 0.0, 1.0), (0.36, -0.48, 0.8), (0.96, 0.0, 0.28))


def chain(tmp: Path) -> rbd.Robot:
    """Links with a ball, a cylinder and a box in a row, and an ellipsoid and a capsule of MJCF at the end of it."""
    links, joints = "", ""
    for i, shape in enumerate(SHAPES):
        inertia = '<inertia ixx=".02" iyy=".03" izz=".02" ixy="0" ixz="0" iyz="0"/>'
        inertial = f'<inertial><mass value="2"/>{inertia}</inertial>'
        collision = f'<collision><origin xyz="0.02 0.01 0.03" rpy="0.3 0.2 0.1"/><geometry>{shape}</geometry></collision>'
        links += f'<link name="l{i}">{inertial}{collision}</link>'
        if i:
            joints += (
                f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="0.2 0 0.05"/>'
                '<axis xyz="0.6 0 0.8"/><limit effort="1" velocity="1" lower="-3" upper="3"/></joint>'
            )
    path = tmp / "chain.urdf"
    path.write_text(f'<robot name="chain">{links}{joints}</robot>')
    return rbd.load_robot(path)


def egg(tmp: Path) -> rbd.Robot:
    """A free ellipsoid."""
    body = '<body name="egg"><freejoint/><inertial pos="0 0 0" mass="2" diaginertia=".02 .02 .02"/>'
    path = tmp / "egg.xml"
    path.write_text(
        f'<mujoco model="egg"><worldbody>{body}<geom type="ellipsoid" size="0.1 0.2 0.15"/></body></worldbody></mujoco>'
    )
    return rbd.load_robot(path)


def chosen(points: np.ndarray, height: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Indices of the lowest points (k, 3), and of the farthest in each direction, those that are too steep left out."""
    lowest = int(np.argmin(height))
    low = np.argsort(height, kind="stable")[:LOWEST]
    rise, arm = height - height[lowest], ((points - points[lowest]) ** 2).sum(axis=1)
    flat = np.flatnonzero(rise**2 <= TIPS**2 * (1.0 + 1e-9) * arm)
    away = TOWARDS @ (across(up) @ points[flat].T) - rise[flat] / TIPS
    return np.unique([*low, *flat[away.argmax(axis=1)]])


def by_shapes(contacts: rbd.CollisionContacts, state: rbd.State, margin: float) -> dict[int, np.ndarray]:
    """{number: place in W (3,)} of the near points, shape by shape, all of each looked at."""
    plane, found = contacts._finder.plane, {}
    assert plane is not None
    data, n = plane.model.createData(), plane.axes[:, 2]
    pin.forwardKinematics(plane.model, data, state.q)
    for shape, first in zip(plane.points.shapes, plane.points.first.tolist(), strict=True):
        X, points = data.oMi[shape.joint], shape.vertices
        up, height = n @ X.rotation, float(X.translation @ n - plane.height)
        above = np.add.reduce(points.T * up[:, None], axis=0) + height
        for r in shape.rounds:
            if r.rim >= 0 and r.stands(up):
                above[r.rim : r.rim + RIM_CORNERS] = np.inf
        near = np.flatnonzero(above <= margin)
        if len(points) > MOST_POINTS and len(near):
            near = near[chosen(points[near], above[near], up)]
        lowest = [(len(points) + i, r.lowest(up)) for i, r in enumerate(shape.rounds)]
        for i, p in [*((i, points[i]) for i in near.tolist()), *((i, p) for i, p in lowest if p @ up + height <= margin)]:
            found[first + i] = X.act(p)
    return found


def jacobian(contacts: rbd.CollisionContacts, state: rbd.State, number: int, P: np.ndarray) -> np.ndarray:
    """Of a point fixed to its body, in the plane's axes, by Pinocchio's frames, shape (3, nv)."""
    plane = contacts._finder.plane
    joint = plane.joints[plane.points.body[number]]
    model, data = plane.model, plane.model.createData()
    pin.computeJointJacobians(model, data, state.q)
    J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    arm = P - data.oMi[joint].translation
    return plane.axes.T @ (J[:3] - pin.skew(arm) @ J[3:])


def drift(contacts: rbd.CollisionContacts, state: rbd.State, number: int, P: np.ndarray) -> np.ndarray:
    """J_dot v of one point, a_0 + alpha x P + w x (v_0 + w x P + c) in the plane's axes, from Pinocchio's velocities."""
    plane = contacts._finder.plane
    each = zip(plane.points.shapes, plane.points.first.tolist(), strict=True)
    shape, first = next((s, at) for s, at in reversed([*each]) if at <= number)
    model, data = plane.model, plane.model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, np.zeros(model.nv))
    X, V = data.oMi[shape.joint], data.oMi[shape.joint].act(data.v[shape.joint])
    A = X.act(data.a[shape.joint])
    R, w = X.rotation, V.angular
    up, rate = R.T @ plane.axes[:, 2], -R.T @ np.cross(w, plane.axes[:, 2])
    moved = R @ shape.wander(number - first, up, rate)
    return plane.axes.T @ (A.linear + np.cross(A.angular, P) + np.cross(w, V.linear + np.cross(w, P) + moved))


@pytest.mark.parametrize("name", ["chain", "egg", "talos", "g1", "solo12"])
def test_points_and_their_motion(name, tmp_path):
    """Poses of all kinds on level and inclined planes, also at rest.

    Numbers and places as found shape by shape; J by Pinocchio's frames; J_dot v as the difference of velocities.
    """
    robot = {"chain": chain, "egg": egg}[name](tmp_path) if name in ("chain", "egg") else rbd.load_robot(name)
    rng, seen, compared = np.random.default_rng(8), 0, 0
    for k in range(24):
        plane = rbd.Ground(point=(0.1, -0.2, 0.3), normal=PLANES[k % len(PLANES)])
        q = pin.integrate(robot.model, pin.neutral(robot.model), 0.6 * rng.normal(size=robot.nv))
        v = rng.normal(size=robot.nv) * (k % 4 > 0)
        lowest = rbd.CollisionContacts("ground", robot, on=plane, margin=10.0).points(robot.at(q)).gaps.min()
        q[:3] -= (lowest - 0.01) * np.array(plane.normal)
        contacts, state = rbd.CollisionContacts("ground", robot, on=plane, margin=0.3), rbd.State(robot, q, v)
        found, expected = contacts._touching(state), by_shapes(contacts, state, 0.3)
        assert found.numbers.tolist() == sorted(expected)
        before, after = (contacts._touching(rbd.State(robot, pin.integrate(robot.model, q, h * v), v)) for h in (-STEP, STEP))
        for i, number in enumerate(found.numbers.tolist()):
            P, J = found.positions[i], found.J[3 * i : 3 * i + 3]
            assert np.abs(P - expected[number]).max() < ROUNDING
            assert abs(found.gaps[i] - plane.distances(P[None])[0]) < ROUNDING
            assert np.abs(J - jacobian(contacts, state, number, P)).max() < ROUNDING * max(1.0, np.abs(J).max())
            assert np.abs(found.velocity[3 * i : 3 * i + 3] - J @ v).max() < ROUNDING * max(1.0, np.abs(v).max())
            alone = drift(contacts, state, number, P)
            assert np.abs(found.bias[3 * i : 3 * i + 3] - alone).max() < ROUNDING * max(1.0, np.abs(alone).max())
            rates = [at.velocity.reshape(-1, 3)[np.flatnonzero(at.numbers == number)] for at in (before, after)]
            if all(len(rate) for rate in rates) and v.any():
                compared += 1
                bias = found.bias[3 * i : 3 * i + 3]
                assert np.abs((rates[1] - rates[0])[0] / (2.0 * STEP) - bias).max() < 1e-5 * max(1.0, np.abs(bias).max())
        seen += len(found.numbers)
    assert seen >= 24 and compared >= 15


def test_a_flat_rim_and_equal_heights(tmp_path):
    """A cylinder upright, with a rim that is level; a box whose corners are equally low; turned by a hair and not at all."""
    robot = chain(tmp_path)
    for turn in (0.0, 1e-9, 1e-7, 1e-3, 0.2):
        for flat in range(3):
            q = pin.neutral(robot.model)
            own = robot.collision_model.geometryObjects[flat]
            R = np.asarray(own.placement.rotation)  # in its joint's axes
            q[3:7] = pin.Quaternion(pin.exp3(np.array([turn, 0.0, 0.0])) @ R.T).coeffs()
            contacts, state = (
                rbd.CollisionContacts("ground", robot, on=-0.5, margin=2.0),
                rbd.State(robot, q, np.ones(robot.nv)),
            )
            found, expected = contacts._touching(state), by_shapes(contacts, state, 2.0)
            assert found.numbers.tolist() == sorted(expected) and len(expected) > 8
            alone = [drift(contacts, state, n, P) for n, P in zip(found.numbers.tolist(), found.positions, strict=True)]
            assert np.abs(found.bias - np.concatenate(alone)).max() <= 1e-9 * max(1.0, float(np.abs(found.bias).max()))
            assert np.abs(found.positions - [expected[i] for i in sorted(expected)]).max() < ROUNDING
