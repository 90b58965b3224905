"""Contact points of shapes with a plane: compiled arithmetic finds those of NumPy's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd import compiled

ROUNDING = 1e-12
"""Over the size of the largest entry."""
SHAPES = (
    '<sphere radius="0.1"/>',
    '<cylinder radius="0.1" length="0.3"/>',
    '<box size="0.2 0.3 0.1"/>',
)
PLANES = ((0.0, 0.0, 1.0), (0.36, -0.48, 0.8), (0.96, 0.0, 0.28))


@pytest.fixture(autouse=True)
def fast():
    """Only where the extra `fast` is installed."""
    if not compiled.installed():
        pytest.skip("the extra `fast` is not installed")


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


@pytest.mark.parametrize("name", ["chain", "egg", "talos", "g1", "solo12"])
def test_both_find_the_same_points_and_their_motion(name, tmp_path):
    """Poses of all kinds on level and inclined planes: numbers, places, gaps, J, velocities and J_dot v; also at rest."""
    robot = {"chain": chain, "egg": egg}[name](tmp_path) if name in ("chain", "egg") else rbd.load_robot(name)
    rng, seen = np.random.default_rng(8), 0
    for k in range(24):
        plane = rbd.Ground(point=(0.1, -0.2, 0.3), normal=PLANES[k % len(PLANES)])
        q = pin.integrate(robot.model, pin.neutral(robot.model), 0.6 * rng.normal(size=robot.nv))
        v = rng.normal(size=robot.nv) * (k % 4 > 0)
        lowest = rbd.CollisionContacts("ground", robot, on=plane, margin=10.0).points(robot.at(q)).gaps.min()
        q[:3] -= (lowest - 0.01) * np.array(plane.normal)
        contacts, state = rbd.CollisionContacts("ground", robot, on=plane, margin=0.3), rbd.State(robot, q, v)
        found = []
        for use in (True, False):
            with compiled.use(use):
                found.append(contacts.with_margin(0.3)._touching(rbd.State(robot, state.q, state.v)))
        one, other = found
        seen += len(other.numbers)
        assert np.array_equal(one.numbers, other.numbers)
        for what in ("positions", "gaps", "J", "velocity", "bias"):
            a, b = getattr(one, what), getattr(other, what)
            assert a.shape == b.shape and np.abs(a - b).max() <= ROUNDING * max(1.0, float(np.abs(b).max())), what
    assert seen >= 24


def test_a_flat_rim_and_equal_heights_are_decided_alike(tmp_path):
    """A cylinder upright, with a rim that is level; a box whose corners are equally low; turned by a hair and not at all."""
    robot = chain(tmp_path)
    for turn in (0.0, 1e-9, 1e-7, 1e-3, 0.2):
        for flat in range(3):
            q = pin.neutral(robot.model)
            own = robot.collision_model.geometryObjects[flat]
            R = np.asarray(own.placement.rotation)  # in its joint's axes
            q[3:7] = pin.Quaternion(pin.exp3(np.array([turn, 0.0, 0.0])) @ R.T).coeffs()
            found = []
            for use in (True, False):
                with compiled.use(use):
                    contacts = rbd.CollisionContacts("ground", robot, on=-0.5, margin=2.0)
                    found.append(contacts._touching(rbd.State(robot, q, np.ones(robot.nv))))
            assert np.array_equal(found[0].numbers, found[1].numbers) and len(found[0].numbers) > 8
            assert np.abs(found[0].gaps - found[1].gaps).max() < ROUNDING
            assert np.abs(found[0].bias - found[1].bias).max() <= 1e-9 * max(1.0, float(np.abs(found[1].bias).max()))
