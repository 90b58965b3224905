"""The catalogue's claims, checked against the files themselves: with Pinocchio alone, no other room of `rbd`."""

from __future__ import annotations

import math
import pickle
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from rbd.errors import ModelError, RbdError, UnknownRobot
from rbd.robots import catalogue

SOLES = ["talos", "talos_full", "talos_box", "talos_full_box", "talos_corrected", "g1", "g1_hands", "romeo", "human"]
ROUNDED = ["icub", "icub_full"]  # their files round angles to five digits
POINTS = ["bolt", "solo8", "solo12", "anymal_b", "anymal_c", "go1", "go2", "a1", "b1", "hyq"]
STANDING = SOLES + ROUNDED + POINTS
MM = 1e-3


class Standing:
    """A robot of the catalogue in its posture, its first patch put at the world's origin, upright and facing x."""

    def __init__(self, name: str) -> None:
        self.source = source = catalogue.find(name)
        self.model = pin.buildModelFromUrdf(str(source.urdf), pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        self.q = pin.neutral(self.model)
        if source.posture in source.postures:
            for joint, angle in source.postures[source.posture].items():
                assert self.model.existJointName(joint), joint
                self.q[self.model.joints[self.model.getJointId(joint)].idx_q] = angle
        else:
            pin.loadReferenceConfigurations(self.model, str(source.srdf), False)
            self.q[7:] = self.model.referenceConfigurations[source.posture][7:]
        pin.framesForwardKinematics(self.model, self.data, self.q)
        self.q[:7] = pin.SE3ToXYZQUAT(self.patches[0].inverse())
        self.com_W = pin.centerOfMass(self.model, self.data, self.q)
        pin.framesForwardKinematics(self.model, self.data, self.q)

    @property
    def patches(self) -> list[pin.SE3]:
        """X_WP of each foot."""
        return [
            self.data.oMf[self.model.getFrameId(foot.frame)] * pin.SE3(foot.rotation, np.array(foot.translation))
            for foot in self.source.feet
        ]

    @property
    def corners_W(self) -> list[tuple[str, np.ndarray]]:
        """Frame and position of every corner of every foot; a point is its own corner."""
        return [
            (foot.frame, patch.act(np.array([x, y, 0.0])))
            for foot, patch in zip(self.source.feet, self.patches, strict=True)
            for x, y in foot.corners or ((0.0, 0.0),)
        ]

    def collision_shapes(self) -> tuple[pin.GeometryModel, pin.GeometryData]:
        """The file's collision geometry, meshes found through the source's package folders, placed in the world."""
        urdf, folders = str(self.source.urdf), [str(folder) for folder in self.source.package_dirs]
        shapes = pin.buildGeomFromUrdf(self.model, urdf, pin.GeometryType.COLLISION, package_dirs=folders)
        placements = pin.GeometryData(shapes)
        pin.updateGeometryPlacements(self.model, self.data, shapes, placements)
        return shapes, placements

    def load_of_motors(self, friction: float) -> float:
        """The smallest share of the motors' effort limits that holds the robot still, inside the friction cones."""
        columns = []
        for frame, p_WC in self.corners_W:
            frame_id = self.model.getFrameId(frame)
            J = pin.computeFrameJacobian(self.model, self.data, self.q, frame_id, pin.LOCAL_WORLD_ALIGNED)
            J_C = J[:3] - pin.skew(p_WC - self.data.oMf[frame_id].translation) @ J[3:]
            for k in range(8):
                c, s = math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)
                columns.append(J_C.T @ np.array([friction * c, friction * s, 1.0]))
        G = np.column_stack(columns)
        weight = pin.computeGeneralizedGravity(self.model, self.data, self.q)
        limited = np.flatnonzero(self.model.upperEffortLimit[6:] > 0) + 6  # Romeo's file leaves some at zero
        effort = self.model.upperEffortLimit[limited][:, None]
        A = np.block([[G[limited], -effort], [-G[limited], -effort]])
        b = np.concatenate([weight[limited], -weight[limited]])
        A_eq, cost = np.hstack([G[:6], np.zeros((6, 1))]), np.zeros(G.shape[1] + 1)
        cost[-1] = 1.0
        result = linprog(cost, A_ub=A, b_ub=b, A_eq=A_eq, b_eq=weight[:6])
        return float(result.fun) if result.status == 0 else math.inf


@pytest.fixture(params=STANDING)
def standing(request: pytest.FixtureRequest) -> Standing:
    return Standing(request.param)


def test_every_sole_is_flat_on_one_floor(standing: Standing) -> None:
    """In its posture, all of a robot's patches have vertical normals, one heading and one height."""
    tolerance = 5e-5 if standing.source.name in ROUNDED else 1e-10
    for patch in standing.patches:
        assert np.abs(patch.rotation - np.eye(3)).max() < tolerance
    assert np.ptp([p_WC[2] for _, p_WC in standing.corners_W]) < tolerance


@pytest.mark.parametrize("name", ["talos", "talos_full", "g1", "g1_hands"])
def test_flagships_soles_are_flat_to_rounding(name: str) -> None:
    """The sums of hip, knee and ankle pitch are zero: sole normals are vertical to 1e-12."""
    for patch in Standing(name).patches:
        assert np.abs(patch.rotation[:, 2] - [0.0, 0.0, 1.0]).max() < 1e-12


def test_every_posture_is_inside_the_joint_limits(standing: Standing) -> None:
    """The file's position limits admit the posture."""
    q, model = standing.q[7:], standing.model
    assert np.all(model.lowerPositionLimit[7:] <= q) and np.all(q <= model.upperPositionLimit[7:])


def test_motors_hold_every_posture(standing: Standing) -> None:
    """Static equilibrium with friction 0.5 needs at most two fifths of any motor's effort limit (measured: 0.36)."""
    assert standing.load_of_motors(friction=0.5) < 0.4


@pytest.mark.parametrize(
    ("name", "offset_mm"),
    [("talos", 12), ("talos_full", 13), ("g1", 1), ("g1_hands", 2), ("romeo", 1), ("icub", 1), ("human", 4)],
)
def test_centre_of_mass_is_over_the_middle_of_the_soles(name: str, offset_mm: float) -> None:
    """Horizontal distance from the centre of mass to the mean of the patches' origins, less than a stated number."""
    robot = Standing(name)
    middle_W = np.mean([patch.translation for patch in robot.patches], axis=0)
    assert np.linalg.norm((robot.com_W - middle_W)[:2]) < offset_mm * MM


def test_bolt_balances_on_the_line_of_its_feet() -> None:
    """Two points hold a robot only if its centre of mass is over their line."""
    robot = Standing("bolt")
    (_, left_W), (_, right_W) = robot.corners_W
    along = (left_W - right_W)[:2] / np.linalg.norm((left_W - right_W)[:2])
    offset = (robot.com_W - right_W)[:2]
    assert abs(offset[0] * along[1] - offset[1] * along[0]) < 1e-12


@pytest.mark.parametrize("name", STANDING)
def test_left_feet_are_on_the_left(name: str) -> None:
    """A foot named left is at larger y than its right namesake, a front one at larger x, the robot facing x."""
    robot = Standing(name)
    at = {foot.name: patch.translation for foot, patch in zip(robot.source.feet, robot.patches, strict=True)}
    for foot, p_WP in at.items():
        if "left" in foot:
            assert p_WP[1] > at[foot.replace("left", "right")][1]
        if "front" in foot:
            assert p_WP[0] > at[foot.replace("front", "hind")][0]


@pytest.mark.parametrize("name", ["g1", "g1_hands"])
def test_g1_soles_touch_the_lowest_points_of_their_spheres(name: str) -> None:
    """Each of the four collision spheres of a foot has its lowest point at a corner of the patch."""
    robot = Standing(name)
    shapes, placements = robot.collision_shapes()
    lowest_W = [
        placements.oMg[index].translation - [0.0, 0.0, shape.geometry.radius]
        for index, shape in enumerate(shapes.geometryObjects)
        if "ankle_roll" in shape.name and hasattr(shape.geometry, "radius")
    ]
    assert len(lowest_W) == 8
    for p_W in lowest_W:
        assert min(np.linalg.norm(p_W - p_WC) for _, p_WC in robot.corners_W) < 1e-9


@pytest.mark.parametrize(("name", "joint"), [("talos", "leg_left_6_joint"), ("romeo", "LAnkleRoll")])
def test_soles_do_not_reach_past_the_flat_of_the_mesh(name: str, joint: str) -> None:
    """The mesh within 3 mm of the patch's plane reaches each corner to 2 mm, and at most 8 mm further."""
    robot = Standing(name)
    shapes, placements = robot.collision_shapes()
    vertices_W = np.vstack(
        [
            shape.geometry.vertices() @ placements.oMg[i].rotation.T + placements.oMg[i].translation
            for i, shape in enumerate(shapes.geometryObjects)
            if robot.model.names[shape.parentJoint] == joint
        ]
    )
    flat = vertices_W[np.abs(vertices_W[:, 2]) < 3 * MM]
    hull = ConvexHull(flat[:, :2])
    for _, p_WC in robot.corners_W[:4]:
        outside = (hull.equations[:, :2] @ p_WC[:2] + hull.equations[:, 2]).max()
        assert -8 * MM < outside < 2 * MM


@pytest.mark.parametrize("name", ["anymal_b", "anymal_c", "go1", "a1", "b1", "hyq"])
def test_points_are_the_lowest_points_of_the_collision_spheres(name: str) -> None:
    """Where the file gives a foot a sphere, the point of contact is the bottom of it."""
    robot = Standing(name)
    shapes, placements = robot.collision_shapes()
    for frame, p_WC in robot.corners_W:
        parent = robot.model.getFrameId(frame)
        bottoms = [
            placements.oMg[i].translation - [0.0, 0.0, shape.geometry.radius]
            for i, shape in enumerate(shapes.geometryObjects)
            if shape.parentFrame == parent and type(shape.geometry).__name__ == "Sphere"
        ]
        assert len(bottoms) == 1
        assert np.linalg.norm(bottoms[0] - p_WC) < 1e-9


def test_srdf_of_talos_fits_both_joint_sets() -> None:
    """half_sitting is read by joint name: the legs of the reduced and the full robot get the same angles."""
    for name in ("talos", "talos_full"):
        source = catalogue.find(name)
        model = pin.buildModelFromUrdf(str(source.urdf), pin.JointModelFreeFlyer())
        pin.loadReferenceConfigurations(model, str(source.srdf), False)
        q = model.referenceConfigurations["half_sitting"]
        assert q[model.joints[model.getJointId("leg_left_4_joint")].idx_q] == 0.859395
        ours = dict(source.postures["standing"])
        for joint in model.names[2:]:
            if joint not in ("leg_left_6_joint", "leg_right_6_joint"):
                assert q[model.joints[model.getJointId(joint)].idx_q] == ours.get(joint, 0.0)


def test_rotation_of_a_foot_is_that_of_urdf() -> None:
    """Roll, pitch and yaw mean what Pinocchio and URDF mean by them."""
    foot = catalogue.Foot("f", "frame", "point", (0.0, 0.0, 0.0), (0.3, -0.7, 1.1))
    assert np.abs(foot.rotation - pin.rpy.rpyToMatrix(0.3, -0.7, 1.1)).max() < 1e-15


def all_files() -> list[str]:
    folder = catalogue.robots_folder()
    return sorted(path.relative_to(folder).as_posix() for path in folder.glob("**/*.urdf"))


@pytest.mark.parametrize("file", all_files())
def test_every_file_of_the_data_loads_or_is_refused_by_name(file: str) -> None:
    """By its path inside the data a file is found, and Pinocchio reads it; broken ones are refused with the reason."""
    if file in catalogue.BROKEN:
        with pytest.raises(ModelError, match=catalogue.BROKEN[file].split(";")[0]):
            catalogue.find(file)
        return
    source = catalogue.find(file)
    assert source.urdf == catalogue.robots_folder() / file
    assert source.srdf is None or source.srdf.is_file()
    assert pin.buildModelFromUrdf(str(source.urdf), pin.JointModelFreeFlyer()).nv >= 6


@pytest.mark.parametrize("file", all_files())
def test_every_file_goes_by_its_own_name(file: str) -> None:
    """The bare file name finds the file, or is refused with the choices where two files share it."""
    name = Path(file).name
    if sum(Path(other).name == name for other in all_files()) > 1:
        with pytest.raises(UnknownRobot, match="2 files go by the name 'anymal.urdf': 'anymal_b' is "):
            catalogue.find(name)
    elif file in catalogue.BROKEN:
        with pytest.raises(ModelError, match="is broken"):
            catalogue.find(name)
    else:
        assert catalogue.find(name).urdf == catalogue.robots_folder() / file


def test_every_name_that_is_offered_is_found() -> None:
    """`names` holds nothing that `find` refuses, and all short names."""
    offered = catalogue.names()
    assert {"talos", "g1", "panda", "ur10", "xarm7", "tiago_dual"} <= set(offered)
    for name in offered:
        assert catalogue.find(name).urdf.is_file()


def test_a_mistyped_name_is_answered_with_the_nearest() -> None:
    """An unknown robot's error holds the name that came and the one that was meant."""
    with pytest.raises(UnknownRobot, match="no robot 'tallos'.*'talos'"):
        catalogue.find("tallos")


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    """A path that leads nowhere is an error about a file, for strings and for path objects."""
    for missing in (tmp_path / "robot.urdf", str(tmp_path / "robot.urdf"), "robot.urdf", "folder/robot.xml"):
        with pytest.raises(ModelError, match="no file"):
            catalogue.find(missing)


def test_a_file_of_ones_own_is_found_by_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any file on disk is taken as it is: its folder and the user's are searched, its SRDF is found beside it."""
    (tmp_path / "mine.urdf").write_text("<robot name='mine'><link name='base'/></robot>")
    (tmp_path / "mine.srdf").write_text("<robot name='mine'/>")
    meshes = tmp_path / "meshes"
    source = catalogue.find(str(tmp_path / "mine.urdf"), package_dirs=[meshes])
    assert (source.name, source.srdf, source.feet, source.posture) == ("mine", tmp_path / "mine.srdf", (), None)
    assert source.package_dirs[:2] == (meshes, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert catalogue.find("mine.urdf").urdf.resolve() == tmp_path / "mine.urdf"


def test_a_file_without_an_ending_is_found_where_no_robot_goes_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bare name is a robot's first, and then a file's."""
    (tmp_path / "mine").write_text("<robot name='mine'><link name='base'/></robot>")
    monkeypatch.chdir(tmp_path)
    assert catalogue.find("mine").urdf.resolve() == tmp_path / "mine"
    with pytest.raises(UnknownRobot, match="mime"):
        catalogue.find("mime")


def test_the_data_file_by_path_is_the_robot_by_name() -> None:
    """A path into the data brings the same feet and postures as the short name."""
    by_path, by_name = catalogue.find(catalogue.find("g1").urdf), catalogue.find("g1")
    assert (by_path.name, by_path.feet, by_path.postures) == ("g1", by_name.feet, by_name.postures)


def test_a_folder_here_does_not_hide_a_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Short names win over whatever lies in the working directory under the same bare word."""
    (tmp_path / "talos").mkdir()
    (tmp_path / "g1").write_text("notes")
    monkeypatch.chdir(tmp_path)
    assert catalogue.find("talos").urdf.name == "talos_reduced.urdf"
    assert catalogue.find("g1").urdf.name == "g1_29dof_rev_1_0.urdf"


def test_without_the_data_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the data package names fail with what to install; a file of one's own still works."""

    def absent(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(catalogue, "distribution", absent)
    with pytest.raises(ModelError, match="pip install example-robot-data"):
        catalogue.find("talos")
    (tmp_path / "mine.urdf").write_text("<robot name='mine'><link name='base'/></robot>")
    assert catalogue.find(tmp_path / "mine.urdf").package_dirs == (tmp_path,)
    with pytest.raises(RbdError, match="no file"):
        catalogue.find("other.urdf")


def test_the_data_of_a_conda_package_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Below the environment's `share`, where pip knows of no such package, or of one without its folder."""
    (tmp_path / "share" / "example-robot-data").mkdir(parents=True)
    (place := tmp_path / "share" / "example-robot-data" / "robots").symlink_to(catalogue.robots_folder())
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(catalogue, "distribution", lambda name: SimpleNamespace(locate_file=lambda inside: tmp_path / "none"))
    assert catalogue.find("talos").urdf.is_relative_to(place)


def test_data_packed_another_way_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package of that name without the folder of pip's own: what is missing, and what to install."""
    monkeypatch.setattr(catalogue, "distribution", lambda name: SimpleNamespace(locate_file=lambda place: tmp_path / "none"))
    with pytest.raises(ModelError, match="is installed, but without the folder .* try: pip install example-robot-data"):
        catalogue.find("talos")


def test_a_source_can_be_sent_to_a_worker() -> None:
    """A source pickles: other processes build their own model from it."""
    source = pickle.loads(pickle.dumps(catalogue.find("talos")))
    assert source.feet == catalogue.find("talos").feet


class TestLicences:
    """Under which licence a robot's files come."""

    def test_each_robot_of_the_data_states_one(self):
        """In the README of its folder: free ones, shared alike, and one that forbids changes."""
        told = {name: catalogue.licence(catalogue.find(name)) for name in catalogue.robots()}
        assert {name: told[name] for name in ("talos", "g1", "panda", "icub")} == {
            "talos": "Apache-2.0", "g1": "BSD-3-Clause", "panda": "Apache-2.0", "icub": "CC-BY-SA-4.0"
        }  # fmt: skip
        assert [name for name in told if not told[name]] == ["iris", "iris_simple", "quadruped"]  # their READMEs state none

    def test_of_our_own_mechanisms_it_is_ours_and_of_your_file_nothing_is_known(self, tmp_path):
        """No licence is made up."""
        assert catalogue.licence(catalogue.find("four_bar")) == "BSD-2-Clause"
        (tmp_path / "mine.urdf").write_text("<robot name='mine'><link name='a'/></robot>")
        assert catalogue.licence(catalogue.find(tmp_path / "mine.urdf")) == ""


class TestDescribedRobots:
    """H1 and H1-2, whose files another package downloads; here a package of its shape stands for it."""

    @staticmethod
    def package(folder: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
        """A package robot_descriptions with a module of H1."""
        (folder / "robot_descriptions").mkdir()
        (folder / "robot_descriptions" / "__init__.py").write_text("")
        (folder / "robot_descriptions" / "h1_description.py").write_text(body)
        monkeypatch.syspath_prepend(folder)
        for name in ("robot_descriptions", "robot_descriptions.h1_description"):
            monkeypatch.delitem(sys.modules, name, raising=False)

    def test_h1_has_soles_and_stands(self, tmp_path, monkeypatch):
        """The catalogue adds posture and soles to the file; both soles are on one level, below the centre of mass."""
        mass = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        joint = '<joint name="{0}_joint" type="revolute"><parent link="{1}"/><child link="{0}_link"/><origin xyz="{2}"/>'
        joint += (
            '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="99" velocity="9"/></joint><link name="{0}_link">' + mass
        )
        text = '<robot name="h1"><link name="pelvis">' + mass
        for side, y in (("left", 0.2), ("right", -0.2)):
            hip, knee, ankle = (f"{side}_{part}" for part in ("hip_pitch", "knee", "ankle"))
            text += joint.format(hip, "pelvis", f"0.04 {y} -0.17") + joint.format(knee, f"{hip}_link", "0 0 -0.4")
            text += joint.format(ankle, f"{knee}_link", "0 0 -0.4")
        (tmp_path / "h1.urdf").write_text(text + "</robot>")
        path = str(tmp_path / "h1.urdf")
        self.package(tmp_path, monkeypatch, f"PACKAGE_PATH, URDF_PATH = {str(tmp_path)!r}, {path!r}\n")
        stands = Standing("h1")
        assert stands.source.name == "h1" and str(stands.source.urdf) == path and "h1" not in catalogue.names()
        heights = []
        for foot in stands.source.feet:
            M = stands.data.oMf[stands.model.getFrameId(foot.frame)]
            heights += [(M.act(foot.rotation @ [x, y, 0.0] + np.array(foot.translation)))[2] for x, y in foot.corners]
        assert len(heights) == 8 and np.ptp(heights) < 1e-9

    def test_without_the_package_or_a_network_the_way_is_told(self, tmp_path, monkeypatch):
        """What to install, or the path to give."""
        monkeypatch.setitem(sys.modules, "robot_descriptions", None)
        with pytest.raises(ModelError, match="pip install robot_descriptions; or give the path of its URDF"):
            catalogue.find("h1_2")
        monkeypatch.delitem(sys.modules, "robot_descriptions")
        self.package(tmp_path, monkeypatch, "raise OSError('Could not resolve host')\n")
        with pytest.raises(ModelError, match="cannot download 'h1' by git: Could not resolve host; try again with a network"):
            catalogue.find("h1")
