"""A base that slides in a plane: every term is that of a floating base moved in this plane."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError, ModelError
from rbd.robots.posture import corner_points

_Z, _X, _Y = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
AXES = {"xy": np.array([_X, _Y, _Z]).T, "xz": np.array([_X, _Z, (0.0, -1.0, 0.0)]).T, "yz": np.array([_Y, _Z, _X]).T}
"""{plane: its two axes and its normal in W, as columns}; of "xz" the normal is -y."""
URDF = """<robot name="walker">
  <link name="trunk"><inertial><origin xyz="0.03 0.05 0.2" rpy="0.3 0.2 0.1"/><mass value="3"/>
    <inertia ixx="0.05" ixy="0.002" ixz="0.001" iyy="0.04" iyz="0.003" izz="0.03"/></inertial>
    <visual><origin xyz="0 0.1 0.2" rpy="0.1 0 0"/><geometry><box size="0.1 0.2 0.4"/></geometry></visual>
    <collision><origin xyz="0 0.1 0.2" rpy="0.1 0 0"/><geometry><box size="0.1 0.2 0.4"/></geometry></collision></link>
  <link name="mark"/>
  <joint name="at" type="fixed"><parent link="trunk"/><child link="mark"/><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/></joint>
  <link name="leg"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/>
    <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.001"/></inertial>
    <visual><origin xyz="0 0 -0.3"/><geometry><cylinder radius="0.02" length="0.6"/></geometry></visual></link>
  <joint name="hip" type="continuous"><parent link="trunk"/><child link="leg"/><origin xyz="0.02 0 0.1" rpy="0.1 0.2 0.3"/>
    <axis xyz="0.2 1 0.1"/></joint>
  <link name="foot"><inertial><mass value="0.2"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="ankle" type="prismatic"><parent link="leg"/><child link="foot"/><origin xyz="0 0 -0.6"/><axis xyz="0 0 1"/>
    <limit lower="-0.1" upper="0.1" effort="10" velocity="1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("planar") / "walker.urdf"
    file.write_text(URDF)
    return file


def pairs(path: Path, plane: str, robot: str = "") -> tuple[rbd.State, rbd.State, np.ndarray]:
    """(a state on a planar base, the same on a floating one, S: v of the second is S times that of the first)."""
    name = robot or path
    flat, free = rbd.load_robot(name, root="planar", plane=plane), rbd.load_robot(name)
    rng, T = np.random.default_rng(3), AXES[plane]
    u, angle = rng.uniform(-1.0, 1.0, 2), 0.7
    rest = pin.integrate(free.model, free.neutral(), np.r_[np.zeros(6), rng.uniform(-0.5, 0.5, free.nv - 6)])[7:]
    q = np.r_[u, np.cos(angle), np.sin(angle), rest]
    X = pin.SE3(pin.exp3(angle * T[:, 2]), T[:, :2] @ u)
    S = np.zeros((free.nv, flat.nv))
    S[:3, :2], S[3:6, 2], S[6:, 3:] = T[:, :2], T[:, 2], np.eye(free.nv - 6)
    v = rng.uniform(-1.0, 1.0, flat.nv)
    return flat.at(q, v), free.at(np.r_[pin.SE3ToXYZQUAT(X), rest], S @ v), S


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
@pytest.mark.parametrize("robot", ["", "solo12"])
def test_terms_are_those_of_a_floating_base(path: Path, plane: str, robot: str) -> None:
    """M, h, the centre of mass, momentum, base pose; poses, velocities and J_dot v of all frames."""
    flat, free, S = pairs(path, plane, robot)
    assert flat.robot.plane == plane
    assert np.abs(flat.M - S.T @ free.M @ S).max() < 1e-12
    assert np.abs(flat.h - S.T @ free.h).max() < 1e-12
    assert np.abs(flat.com - free.com).max() < 1e-12
    assert np.abs(flat.base_pose().homogeneous - free.base_pose().homogeneous).max() < 1e-12
    assert np.abs(flat.centroidal()[0] - free.centroidal()[0] @ S).max() < 1e-12
    for name in free.robot.frames():
        if name != "universe":
            one, other = flat.frame(name, (0.1, 0.2, 0.3)), free.frame(name, (0.1, 0.2, 0.3))
            assert np.abs(one.X_WF.homogeneous - other.X_WF.homogeneous).max() < 1e-12, name
            assert np.abs(one.J - other.J @ S).max() < 1e-12
            assert np.abs(one.v - other.v).max() < 1e-12
            assert np.abs(one.bias - other.bias).max() < 1e-11


@pytest.mark.parametrize("plane", ["xz", "yz"])
def test_shapes_are_where_the_links_are(path: Path, plane: str) -> None:
    """To draw and to touch with."""
    flat, free, _ = pairs(path, plane)
    for kind in ("visual_model", "collision_model"):
        poses = []
        for state in (flat, free):
            geometry, data = getattr(state.robot, kind), state.robot.model.createData()
            made = geometry.createData()
            pin.updateGeometryPlacements(state.robot.model, data, geometry, made, state.q)
            poses.append({g.name: X.homogeneous for g, X in zip(geometry.geometryObjects, made.oMg, strict=True)})
        assert len(poses[0]) == 2
        for name, X in poses[0].items():
            assert np.abs(X - poses[1][name]).max() < 1e-12


@pytest.mark.parametrize(("plane", "names"), [
    ("xy", (["x", "y", "cos", "sin"], ["vx", "vy", "wz"])),
    ("xz", (["x", "z", "cos", "sin"], ["vx", "vz", "w"])),
    ("yz", (["y", "z", "cos", "sin"], ["vy", "vz", "wx"])),
])  # fmt: skip
def test_its_coordinates_are_named_by_the_plane(path: Path, plane: str, names: tuple[list[str], list[str]]) -> None:
    """In the joint table: q and v."""
    table = rbd.load_robot(path, root="planar", plane=plane).joints
    assert [c.name for c in table.positions[:4]] == [f"root_joint.{x}" for x in names[0]]
    assert [c.name for c in table.velocities[:3]] == [f"root_joint.{x}" for x in names[1]]
    assert [c.unit for c in table.velocities[:3]] == ["m", "m", "rad"]


def test_its_angle_is_that_of_link_angles(path: Path) -> None:
    """Counter-clockwise seen from -y: a body pitched up at its front has a positive angle."""
    robot = rbd.load_robot(path, root="planar", plane="xz")
    state = robot.at().with_joints({"root_joint": [0.0, 0.0, np.cos(0.3), np.sin(0.3)]})
    assert np.abs(state.frame("trunk").X_WF.rotation[:, 0] - [np.cos(0.3), 0.0, np.sin(0.3)]).max() < 1e-12


def test_it_moves_as_a_floating_body_does_in_its_plane(path: Path) -> None:
    """Thrown: energy is kept, the centre of mass is on a parabola, and the base stays in the plane."""
    flat, _, _ = pairs(path, "xz")
    motion = rbd.simulate(flat, duration=0.5, step=5e-3, integrator=rbd.DormandPrince8(rtol=1e-12, atol=1e-12))
    assert np.ptp(motion.energy) < 1e-11
    assert all(abs(rbd.State(flat.robot, q).base_pose().translation[1]) < 1e-12 for q in motion.q[::20])
    # What holds it in the plane carries no force along the plane: the centre of mass falls freely there.
    fall = np.polynomial.polynomial.polyfit(motion.t, motion.com[:, [0, 2]], 2)
    assert np.abs(2.0 * fall[2] - [0.0, -9.81]).max() < 1e-6


def test_a_point_contact_holds_it_upright(path: Path) -> None:
    """The foot's forces in the plane are those of the weight's moment; the solver's certificate is met."""
    robot = rbd.load_robot(path, root="planar", plane="xz")
    state = robot.at([0.0, 0.55, 1.0, 0.0, 1.0, 0.0, 0.0])
    solution = rbd.solve(state, np.zeros(robot.nu), [rbd.PointContact("toe", "foot", friction=None, on=None)])
    assert solution.status == "solved"
    held = state.frame("foot")
    assert np.abs(held.J[:3] @ solution.a + held.bias[:3]).max() < 1e-9


def test_it_travels(path: Path, tmp_path: Path) -> None:
    """In pickles, copies and trajectory files, from users' files and from the catalogue."""
    for name in (path, "solo12"):
        robot = rbd.load_robot(name, root="planar", plane="xz", gravity=(0.0, 0.0, -1.62))
        for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
            assert other.plane == "xz"
            assert other.is_like(robot)
            assert other.gravity[2] == -1.62
        motion = rbd.simulate(robot.at(), duration=0.01, step=5e-3)
        motion.save(tmp_path / "motion.npz")
        back = rbd.Trajectory.load(tmp_path / "motion.npz").robot
        assert back.is_like(robot)


def test_a_loop_file_states_the_plane(path: Path, tmp_path: Path) -> None:
    """By default; the argument replaces it, and other words are refused."""
    closing = rbd.robots.LoopFile.of_text("{root: planar, plane: xz}")
    assert rbd.load_robot(path, loops=closing).plane == "xz"
    assert rbd.load_robot(path, loops=closing, plane="yz").plane == "yz"
    assert rbd.load_robot(path, loops=closing, root="free_flyer").plane is None
    for text in ("{root: planar, plane: zx}", "{plane: xz}", "{root: fixed, plane: xz}", "{root: planar, plane: [1]}"):
        with pytest.raises(ModelError, match="Expected one of xy, xz, yz|of a base that slides: root=.planar"):
            rbd.robots.LoopFile.of_text(text)


@pytest.mark.parametrize("plane", ["xz", "yz"])
@pytest.mark.parametrize("name", ["solo12", "talos", "bolt"])
def test_upright_robots_stand_on_their_feet(plane: str, name: str) -> None:
    """Their feet are level on z = 0; Bolt's centre of mass is over its two points, also along gravity that leans."""
    axis = 0 if plane == "xz" else 1
    tilt = np.zeros(3)
    tilt[axis] = 1.0
    robot = rbd.load_robot(name, root="planar", plane=plane)
    for gravity in (robot.gravity, robot.gravity + tilt):
        world = robot.with_gravity(gravity)
        state, feet = world.standing(), world.feet(friction=None)
        points = corner_points(state, feet)
        assert abs(points[:, 2].min()) < 1e-12
        assert points[:, 2].max() < 1e-3  # Talos' posture has soles that are not quite parallel
        assert state.base_pose().rotation[2, 2] > 0.9
        if name == "bolt" and plane == "xz":
            middle = points.mean(axis=0)
            assert abs(np.cross(state.com - middle, gravity)[1]) < 1e-12
            assert world.standing().q[4:].tolist() == robot.standing().q[4:].tolist()  # joints stay


def test_other_planes_are_refused(path: Path) -> None:
    """With the names of those there are; and a plane of a base that does not slide."""
    with pytest.raises(InputError, match="Expected one of xy, xz, yz"):
        rbd.load_robot(path, root="planar", plane="zx")
    with pytest.raises(InputError, match="root='planar'"):
        rbd.load_robot(path, plane="xz")
    with pytest.raises(InputError, match="plane"):
        rbd.load_robot(path, root="planar", plane=3)
    assert rbd.load_robot(path).plane is None
