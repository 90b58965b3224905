"""Shafts of capsules across edges and beside corners of terrain: where they rest, how their points move, that none sinks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull

import rbd
from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import convex_shape
from rbd.constraints.terrain.pieces import polytope
from rbd.constraints.terrain.shapes import OnPieces

RADIUS, HALF, G = 0.05, 0.2, 9.81
LEVEL = pin.rpy.rpyToMatrix(0.0, np.pi / 2.0, 0.0)
WALL = rbd.Terrain.boxes([(-0.02, -1, -1), (0.02, 1, 0)])
APEX = rbd.Terrain({"peak": polytope("peak", np.array([[0.0, 0, 0], [-1, -1, -1], [-1, 1, -1], [1, -1, -1], [1, 1, -1]]))})


@pytest.fixture(scope="module")
def capsule(tmp_path_factory: pytest.TempPathFactory) -> rbd.Robot:
    """A free capsule of 1 kg along its z axis."""
    path: Path = tmp_path_factory.mktemp("capsules") / "capsule.urdf"
    path.write_text(
        f"""<robot name="capsule"><link name="body"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.002"
        ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><capsule radius="{RADIUS}" length="{2 * HALF}"/></geometry>
        </collision></link></robot>"""
    )
    return rbd.load_robot(path)


def at(capsule: rbd.Robot, R: Array, p: Array, v: Array | None = None) -> rbd.State:
    return rbd.State(capsule, np.concatenate([p, pin.Quaternion(R).coeffs()]), v)


def distance(q: Array, low: Array, high: Array) -> float:
    """Of a capsule from a box: the least over its axis, which is convex along it, less the radius."""
    X = pin.XYZQUATToSE3(q)

    def of(s: float) -> float:
        x = X.act(np.array([0.0, 0.0, s]))
        return float(np.linalg.norm(x - np.clip(x, low, high)))

    return float(minimize_scalar(of, bounds=(-HALF, HALF), method="bounded", options={"xatol": 1e-13}).fun) - RADIUS


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_capsule_lies_across_a_wall(capsule: rbd.Robot, turn: float) -> None:
    """Dropped level it is stopped on both edges of the wall's top at once, and stays; both bear half of its weight."""
    state = at(capsule, pin.rpy.rpyToMatrix(0.0, 0.0, turn) @ LEVEL, np.array([0.0, 0.0, RADIUS + 0.02]))
    contacts = [rbd.CollisionContacts("c", capsule, friction=0.5, on=WALL)]
    run = rbd.simulate(state, contacts, duration=0.3, step=1e-3, progress=False)
    assert [event.kind for event in run.events] == ["touches", "touches"]
    assert [event.t for event in run.events] == pytest.approx([np.sqrt(2.0 * 0.02 / G)] * 2, abs=1e-12)
    np.testing.assert_allclose(run.q[-1], [0.0, 0.0, RADIUS, *state.q[3:]], atol=1e-12)
    forces = rbd.solve(run.state(-1), [], contacts).forces["c"].reshape(-1, 3)
    np.testing.assert_allclose(forces[:, 2], 0.5 * G, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_thrown_capsule_is_never_inside(capsule: rbd.Robot, seed: int) -> None:
    """It tumbles over a wall and a step: the least distance of its axis from each box is its radius or more, to 1e-9 m."""
    rng = np.random.default_rng(seed)
    ends = [(-0.02, -1, -1), (0.02, 1, 0)], [(-0.3, -1, -1), (-0.02, 1, -0.15)], [(0.02, -1, -1), (0.4, 1, -0.1)]
    on = rbd.Terrain.boxes(*ends)
    start = at(capsule, pin.rpy.rpyToMatrix(*rng.uniform(-3.0, 3.0, 3)), np.array([0.03, 0.0, 0.3]), rng.uniform(-1.5, 1.5, 6))
    contacts = [rbd.CollisionContacts("c", capsule, friction=0.4, on=on)]
    run = rbd.simulate(start, contacts, duration=0.6, step=1e-3, progress=False, may_sink=True)
    assert run.events
    for q in run.q[::4]:
        for piece in on.pieces:
            assert distance(q, piece.box[:3], piece.box[3:]) > -1e-9


@pytest.mark.parametrize(("on", "kind"), [(WALL, 3), (APEX, 2)])
def test_rates_of_points_of_shafts(capsule: rbd.Robot, on: rbd.Terrain, kind: int) -> None:
    """J v is the rate of the gap and J_dot v the derivative of J v along the motion, on an edge and on a corner."""
    rng, h, met = np.random.default_rng(3), 1e-6, 0
    shape = convex_shape(capsule.collision_model.geometryObjects[0])
    pieces = OnPieces(capsule, [shape], on)
    for _ in range(20):
        R = pin.rpy.rpyToMatrix(0.0, *rng.uniform(-0.3, 0.3, 2)) @ LEVEL
        p = np.array([0.02 * (kind == 3), 0.0, RADIUS]) + 0.05 * (R[:, 2] * rng.uniform(-1.0, 1.0))
        (part,) = pieces.at(at(capsule, R, p), 0.2)
        near = [i for i, name in enumerate(part.names) if f":{kind}-" in name]
        k = near[int(np.argmin(part.gaps[near]))]
        p, v = p - part.gaps[k] * part.axes[k][:, 2], rng.normal(size=6)
        q, name = at(capsule, R, p).q, part.names[k]
        found = []
        for t in (-h, 0.0, h):
            (part,) = pieces.at(rbd.State(capsule, pin.integrate(capsule.model, q, t * v), v), 0.2)
            k = part.names.index(name)
            found.append((part.gaps[k], part.velocity.reshape(-1, 3)[k], part.bias.reshape(-1, 3)[k]))
        (gap_0, u_0, _), (gap, u, bias), (gap_1, u_1, _) = found
        if abs(gap) < 1e-6:
            met += 1
            assert (gap_1 - gap_0) / (2.0 * h) == pytest.approx(u[2], abs=1e-6)
            np.testing.assert_allclose((u_1 - u_0) / (2.0 * h), bias, atol=1e-4, rtol=1e-5)
    assert met > 10


@pytest.mark.parametrize("z", [0.02, 0.0, -0.03, -0.2])
@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_a_capsule_through_a_wall_is_named(capsule: rbd.Robot, z: float, lean: float) -> None:
    """With both ends outside: depth and way out are those of the nearest face of the Minkowski difference of axis and wall."""
    R, low, high = pin.rpy.rpyToMatrix(0.0, lean, 0.0) @ LEVEL, *(np.array(x) for x in ((-0.02, -1, -1), (0.02, 1, 0)))
    state, contacts = at(capsule, R, np.array([0.0, 0.0, z])), rbd.CollisionContacts("c", capsule, friction=0.5, on=WALL)
    ends = np.array([0.0, z]) + HALF * np.outer([-1.0, 1.0], R[[0, 2], 2])  # the wall is endless along y
    box = np.array([[x, y] for x in (low[0], high[0]) for y in (low[2], high[2])])
    faces = ConvexHull((ends[:, None] - box).reshape(-1, 2)).equations  # N x + d <= 0 inside
    inside = faces[:, 2].max() < 0.0
    out = -faces[faces[:, 2].argmax(), :2]
    depth = RADIUS - (faces[:, 2].max() if inside else distance(state.q, low, high) + RADIUS)
    gaps = contacts.with_margin(0.05).rows(state).error
    assert gaps is not None and -gaps[2::3].min() == pytest.approx(depth, abs=1e-12 if inside else 1e-9)
    with pytest.warns(rbd.errors.DistantContactWarning), pytest.raises(rbd.InputError) as caught:
        rbd.simulate(state, [contacts], duration=0.1, step=1e-3, progress=False)
    said = re.search(r"'c' ([.\d]+) mm at '.*box 0.* \(out along \((.*), (.*), (.*)\)\)'", str(caught.value))
    assert said and float(said[1]) == pytest.approx(1e3 * depth, rel=1e-3) and float(said[3]) == 0.0
    assert inside == (z <= 0.0)
    if inside:
        assert [float(said[2]), float(said[4])] == pytest.approx(out, abs=1e-3)


def test_an_axis_that_pierces_a_wall_pushes_out() -> None:
    """A needle whose axis is in a wall by less than a simulation accepts is let out, and lies on the wall then."""
    b = rbd.RobotBuilder("needle")
    b.body("body", rbd.robots.Capsule(0.002, 0.4, mass=1.0, rpy=(0, np.pi / 2, 0)))
    needle = b.robot()
    state = needle.at([0.0, 0.0, -0.004, 0, 0, 0, 1])
    with pytest.warns(rbd.errors.DistantContactWarning, match="6 mm at .*box 0.* .out along .0, 0, 1.."):
        run = rbd.simulate(
            state, [rbd.CollisionContacts("c", needle, friction=0.5, on=WALL)], duration=0.05, step=1e-3, progress=False
        )
    assert run.q[-1, 2] == pytest.approx(0.002, abs=1e-8)
