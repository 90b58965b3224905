"""Robots by name and by path, with their feet under them."""

from __future__ import annotations

import shutil
import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError, JointNotFound, ModelError, ModelWarning, UnknownRobot
from rbd.robots import catalogue
from rbd.robots.posture import corner_points

ROUNDED = {"icub": 1e-5}  # [m]: its file rounds angles to five digits
SOLES = ["talos", "talos_full", "talos_box", "talos_full_box", "talos_corrected", "g1", "g1_hands", "romeo", "human"]
SINGULAR = {"icub_full": "neck_roll", "romeo_full": "RThumb3"}  # what moves there, at q = 0 or in any pose, has no inertia
BODIES = {"hector", "quadrotor_base", "iris_simple"}  # nothing moves in them but their base
POINTS = ["bolt", "solo8", "solo12", "anymal_b", "anymal_c", "go1", "go2", "a1", "b1", "hyq"]
STANDING = [*SOLES, *ROUNDED, *POINTS]

INERTIAL = '<inertial><mass value="{m}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="1"/>'


def link(name: str, m: float = 1.0, inside: str = "") -> str:
    return f'<link name="{name}">{INERTIAL.format(m=m)}{inside}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = LIMIT) -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def write(folder: Path, *parts: str, name: str = "mine.urdf") -> Path:
    path = folder / name
    path.write_text(f'<robot name="mine">{"".join(parts)}</robot>')
    return path


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A model file of a user's own: two links and a hinge, no feet, no posture."""
    return write(tmp_path, link("base", 2.0), link("arm", 3.0), joint("shoulder", "base", "arm"))


# ------------------------------------------------------------------------------------------------ names and paths


@pytest.mark.parametrize(
    ("name", "known_as", "file"),
    [
        ("talos", "talos", "talos_reduced.urdf"),
        ("g1", "g1", "g1_29dof_rev_1_0.urdf"),
        ("talos_reduced", "talos", "talos_reduced.urdf"),
        ("talos_full_v2.urdf", "talos_full", "talos_full_v2.urdf"),
        ("panda", "panda", "panda.urdf"),
        ("tiago_dual", "tiago_dual", "tiago_dual.urdf"),
        ("ur_description/urdf/ur5_robot.urdf", "ur5", "ur5_robot.urdf"),
        ("solo12", "solo12", "solo12.urdf"),
    ],
)
def test_a_robot_goes_by_short_name_file_name_and_path_in_the_data(name: str, known_as: str, file: str) -> None:
    """The catalogue's word, the file's stem, the file, and the path inside the data all find it."""
    robot = rbd.load_robot(name)
    assert (robot.name, robot.urdf.name) == (known_as, file)
    assert robot.nv == robot.model.nv and robot.nq == robot.model.nq


def test_robots_of_the_catalogue_do_not_warn_of_their_own_files(tmp_path: Path) -> None:
    """What the doctor finds of them is known; a copy of the file, which is a user's, says it each time."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        talos = rbd.load_robot("talos")
    assert len(rbd.doctor(talos).warnings) > 4
    copy = tmp_path / "mine.urdf"
    copy.write_bytes(talos.urdf.read_bytes())
    with pytest.warns(rbd.errors.ModelWarning, match="mine: 5 links have inertias that no body has"):
        rbd.load_robot(copy, package_dirs=talos.source.package_dirs)
    loops = tmp_path / "hands.loops.yaml"
    hands = "frame_a: gripper_left_base_link, frame_b: gripper_right_base_link"
    loops.write_text(f"loops:\n  - {{name: hands, kind: point, {hands}}}\n")
    with pytest.warns(rbd.errors.ModelWarning, match=r"1 loop is open in every posture \('hands'\)"):
        rbd.load_robot("talos", loops=loops)


@pytest.mark.parametrize("name", SINGULAR)
def test_a_robot_of_the_data_without_inertia_loads_with_its_fault_told(name: str) -> None:
    """Its kinematics are there; its accelerations are refused, though rounding leaves M with positive pivots."""
    known = name == "icub_full"  # its M is regular where its neck is turned: no error, and no news
    with nullcontext() if known else pytest.warns(rbd.errors.ModelWarning, match=SINGULAR[name]):
        robot = rbd.load_robot(name)
    assert rbd.doctor(robot).ok == known and SINGULAR[name] in str(rbd.doctor(robot))
    state = robot.standing()
    assert np.isfinite(state.frame(robot.source.feet[0].frame).J).all()
    with pytest.raises(rbd.errors.SingularInertia):
        rbd.solve(state, np.zeros(robot.nu), robot.feet())
    with pytest.raises(rbd.errors.SingularInertia):
        rbd.dynamics.free_acceleration(state, np.zeros(robot.nu))


ON_BOTH_ROOTS = sorted(set(catalogue.names()) - SINGULAR.keys() - BODIES - set(catalogue.mechanisms()))


@pytest.mark.parametrize("name", ON_BOTH_ROOTS)
def test_every_robot_of_the_data_loads_on_both_roots(name: str) -> None:
    """Free flying it has six coordinates more, which no motor moves; M is finite and positive definite."""
    free, fixed = rbd.load_robot(name), rbd.load_robot(name, root="fixed")
    assert (free.nv, free.nq, free.nu) == (fixed.nv + 6, fixed.nq + 7, fixed.nu)
    assert (free.root, fixed.root, free.floating) == ("free_flyer", "fixed", True)
    assert free.actuated_names == fixed.actuated_names
    for robot in (free, fixed):
        assert np.linalg.eigvalsh(robot.at().M)[0] > 0.0


@pytest.mark.parametrize("kind", [str, Path])
def test_a_file_of_ones_own_is_a_robot(mine: Path, kind: type) -> None:
    """By path, as a string or as a Path; its stem is its name."""
    robot = rbd.load_robot(kind(mine))
    assert (robot.name, robot.nq, robot.nv, robot.nu, robot.mass) == ("mine", 8, 7, 1, 5.0)
    assert robot.actuated_names == ("shoulder",)
    assert robot.effort_limit.tolist() == [5.0]
    fixed = rbd.load_robot(kind(mine), root="fixed")
    assert (fixed.nq, fixed.nv, fixed.nu, fixed.mass) == (1, 1, 1, 3.0)


def test_a_copy_of_talos_elsewhere_moves_as_talos(tmp_path: Path, talos: rbd.Robot) -> None:
    """The same file by another path: the same terms, though the catalogue knows neither its feet nor its posture."""
    robot = rbd.load_robot(shutil.copy(talos.urdf, tmp_path / "copy.urdf"))
    assert robot.name == "copy"
    state, own = rbd.State(robot, talos.standing().q), talos.standing()
    assert np.array_equal(state.M, own.M) and np.array_equal(state.h, own.h)
    soles = [
        rbd.SurfaceContact(sole.name, sole.frame, corners=sole.corners, placement=sole.placement, friction=0.7)
        for sole in talos.soles()
    ]
    assert np.abs(rbd.hold(state, soles).tau - rbd.hold(own, talos.soles()).tau).max() < 1e-9


def test_the_srdf_beside_a_file_gives_its_postures(mine: Path) -> None:
    """A file of the same stem with the ending srdf: its group states are the robot's postures."""
    mine.with_suffix(".srdf").write_text(
        "<robot name='mine'><group_state name='up'><joint name='shoulder' value='0.5'/></group_state></robot>"
    )
    robot = rbd.load_robot(mine, root="fixed")
    assert {name: q.tolist() for name, q in robot.postures.items()} == {"up": [0.5]}
    assert robot.standing().q.tolist() == [0.5]


def test_half_sitting_of_talos_is_a_posture(talos: rbd.Robot) -> None:
    """The SRDF's own posture stands beside ours; ours is the one it stands in by default."""
    assert {"half_sitting", "standing"} <= set(talos.postures)
    knee = talos.model.joints[talos.joint_id("leg_left_4_joint")].idx_q
    assert talos.posture("half_sitting")[knee] == 0.859395
    assert np.array_equal(talos.standing().q[7:], talos.posture("standing")[7:])
    assert rbd.hold(talos.standing("half_sitting"), talos.soles()).residuals.stationarity < 1e-9


def test_postures_given_out_are_copies(talos: rbd.Robot) -> None:
    """A posture may be changed by its taker: the robot keeps its own, which cannot be written."""
    q = talos.posture("standing")
    q[:] = 0.0
    assert talos.posture("standing").any()
    with pytest.raises(ValueError, match="read-only"):
        talos.postures["standing"][0] = 1.0
    with pytest.raises(TypeError):
        talos.postures["standing"] = q  # type: ignore[index]


def test_at_takes_q_a_name_or_nothing(talos: rbd.Robot) -> None:
    """The state at a configuration, at a named posture, and at the neutral one; at rest unless v is given."""
    assert np.array_equal(talos.at().q, talos.neutral())
    assert np.array_equal(talos.at("standing").q, talos.posture("standing"))
    assert np.array_equal(talos.at(talos.posture("standing")).q, talos.posture("standing"))
    assert talos.at("standing", np.ones(talos.nv)).v.all() and not talos.at().v.any()


def test_passive_joints_by_load_robot() -> None:
    """Talos with free ankles: two motors fewer, and the other motors keep their order."""
    ankles = ["leg_left_5_joint", "leg_right_5_joint"]
    whole, robot = rbd.load_robot("talos"), rbd.load_robot("talos", passive=ankles)
    assert robot.nu == whole.nu - 2
    assert robot.actuated_names == tuple(name for name in whole.actuated_names if name not in ankles)
    assert robot.passive == set(ankles)
    with pytest.raises(JointNotFound, match="'leg_left_5_joint'"):
        rbd.load_robot("talos", passive=["leg_left_5"])


# ---------------------------------------------------------------------------------------------------------- MJCF


def mjcf(folder: Path, joint: str, more: str = "") -> Path:
    path = folder / "arm.xml"
    body = '<inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.1 0.1"/><geom type="sphere" size="0.1"/>'
    world = f'<worldbody><body name="b" pos="0 0 2">{joint}{body}</body></worldbody>'
    path.write_text(f'<mujoco model="arm">{world}{more}</mujoco>')
    return path


def test_an_mjcf_file_says_itself_whether_it_floats(tmp_path: Path) -> None:
    """With a freejoint it floats, without it is fixed, whatever the default of `root`; its shapes are drawn."""
    fixed = rbd.load_robot(mjcf(tmp_path, '<joint name="j" type="hinge" axis="0 1 0"/>'))
    assert (fixed.root, fixed.nv, fixed.nu, fixed.floating) == ("fixed", 1, 0, False)
    assert fixed.at().frame("b").X_WF.translation.tolist() == [0.0, 0.0, 2.0]
    assert fixed.visual_model.ngeoms == 1
    free = rbd.load_robot(mjcf(tmp_path, "<freejoint/>"))
    assert (free.root, free.nv, free.nu, free.floating) == ("free_flyer", 6, 0, True)
    with pytest.raises(InputError, match="root='fixed' cannot weld arm.xml"):
        rbd.load_robot(mjcf(tmp_path, "<freejoint/>"), root="fixed")


def test_keyframes_of_an_mjcf_file_are_postures(tmp_path: Path) -> None:
    """A key's qpos, by its name."""
    keys = '<keyframe><key name="bent" qpos="0.5"/></keyframe>'
    robot = rbd.load_robot(mjcf(tmp_path, '<joint name="j" type="hinge" axis="0 1 0"/>', keys))
    assert robot.posture("bent").tolist() == [0.5]


def test_what_an_mjcf_file_loses_is_said(tmp_path: Path) -> None:
    """Equalities of kinds that are not read are left out, with a warning; a weld is a loop (tests/test_loop_file.py)."""
    tendon = '<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>'
    both = f'{tendon}<equality><weld body1="b"/><tendon tendon1="t"/></equality>'
    with pytest.warns(ModelWarning, match="1 equality constraint is left out"):
        robot = rbd.load_robot(mjcf(tmp_path, '<joint name="j" type="hinge" axis="0 1 0"/>', both))
    assert [loop.name for loop in robot.loops()] == ["weld_b"]


# ------------------------------------------------------------------------------------------------------ standing


@pytest.mark.parametrize("name", STANDING)
def test_every_robot_of_the_catalogue_stands(name: str) -> None:
    """At rest, its feet flat on z = 0 to 1e-9 m (iCub's file is rounded), and motors hold it there: forces sum to m g."""
    robot = rbd.load_robot(name)
    state, feet = robot.standing(), robot.feet()
    assert np.abs(corner_points(state, feet)[:, 2]).max() < ROUNDED.get(name, 1e-9)
    assert not state.v.any()
    held = rbd.hold(state, feet)
    total = sum(force[:3] for force in held.forces.values())
    assert np.abs(total - [0.0, 0.0, robot.mass * 9.81]).max() < 1e-9
    assert held.margins.torque.min() > 0.5


@pytest.mark.parametrize("name", [*SOLES, *ROUNDED])
def test_soles_point_down_and_lie_apart(name: str) -> None:
    """When standing every sole's normal is vertical, left is left of right as it faces, and patches are feet-sized."""
    robot = rbd.load_robot(name)
    state = robot.standing()
    at = {}
    for sole in robot.soles():
        patch = sole.rows(state).patch
        assert patch is not None
        assert np.abs(patch.axes[:, 2] - [0.0, 0.0, 1.0]).max() < ROUNDED.get(name, 1e-9) * 10
        assert 0.1 < np.ptp(sole.corners[:, 0]) < 0.3 and 0.04 < np.ptp(sole.corners[:, 1]) < 0.15
        at[sole.name] = patch
    forward = at["left_sole"].axes[:, 0]
    across = at["left_sole"].point - at["right_sole"].point
    assert np.cross(forward, across)[2] > 0.05


def test_soles_take_friction_and_facets(talos: rbd.Robot) -> None:
    """`soles()` rubs with 0.7 in four facets; None holds; fresh contacts at each call."""
    assert [(s.friction, s.facets) for s in talos.soles()] == [(0.7, 4)] * 2
    assert [(s.friction, s.facets) for s in talos.soles(0.3, facets=8)] == [(0.3, 8)] * 2
    assert [s.friction for s in talos.soles(friction=None)] == [None, None]
    assert [s.name for s in talos.soles()] == ["left_sole", "right_sole"]
    assert [s.frame for s in talos.soles()] == ["left_sole_link", "right_sole_link"]
    assert all(isinstance(s, rbd.SurfaceContact) for s in talos.soles())


def test_a_robot_on_points_has_feet_in_place_of_soles() -> None:
    """Solo12 has four point contacts; asking for soles names `feet`."""
    robot = rbd.load_robot("solo12")
    feet = robot.feet(0.4)
    assert [foot.name for foot in feet] == ["front_left", "front_right", "hind_left", "hind_right"]
    assert all(isinstance(foot, rbd.PointContact) and foot.friction == 0.4 for foot in feet)
    with pytest.raises(ModelError, match=r"solo12 stands on points; use robot\.feet\(\)"):
        robot.soles()


def test_a_robot_on_a_fixed_base_stands_in_its_posture() -> None:
    """Its base is where it is: the named posture, or the only one, or the neutral one."""
    panda = rbd.load_robot("panda", root="fixed")
    assert np.array_equal(panda.standing().q, panda.posture("default"))
    ur5 = rbd.load_robot("ur5", root="fixed")
    assert np.array_equal(ur5.standing().q, ur5.neutral())
    talos = rbd.load_robot("talos", root="fixed")
    assert np.array_equal(talos.standing("half_sitting").q, talos.posture("half_sitting"))


def test_of_a_robot_without_feet_one_is_told_what_to_give(mine: Path) -> None:
    """Neither soles, feet nor standing are known of a user's own file: the message shows how to name a contact."""
    robot = rbd.load_robot(mine)
    for ask in (robot.soles, robot.feet, robot.standing):
        with pytest.raises(ModelError, match=r"no feet are known for mine.*rbd\.SurfaceContact\(name, frame, half_lengths="):
            ask()
    state = robot.at()
    held = rbd.hold(state, [rbd.SurfaceContact("base", "base", half_lengths=(0.1, 0.1), friction=0.5)])
    assert abs(held.forces["base"][2] - 5.0 * 9.81) < 1e-9


@pytest.mark.parametrize("name", ["half_siting", "", "STANDING", None, 3, ["standing"], np.zeros(3)])
def test_an_unknown_posture_is_refused_with_the_nearest(talos: rbd.Robot, name: object) -> None:
    """By `posture`, and by `standing` and `at` where the name is a word."""
    with pytest.raises(InputError, match="no posture .* of talos; ") as caught:
        talos.posture(name)  # type: ignore[arg-type]
    if isinstance(name, str) and name == "half_siting":
        assert "'half_sitting'" in str(caught.value)
        with pytest.raises(InputError, match="'half_sitting'"):
            talos.at(name)
    if name is not None:
        with pytest.raises(InputError, match="no posture"):
            talos.standing(name)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------------ geometry


def test_shapes_of_a_robot_of_the_data_are_found(talos: rbd.Robot) -> None:
    """Visual and collision geometry come without a warning, and once."""
    assert talos.visual_model.ngeoms > 30
    assert talos.collision_model.ngeoms > 30
    assert talos.visual_model is talos.visual_model


def test_missing_meshes_are_a_warning(tmp_path: Path) -> None:
    """A robot whose meshes are elsewhere computes all the same; drawing it warns, with the remedy, and does not fail."""
    mesh = '<visual><geometry><mesh filename="package://mine_description/base.stl"/></geometry></visual>'
    path = write(tmp_path, link("base", inside=mesh), link("arm"), joint("shoulder", "base", "arm"))
    robot = rbd.load_robot(path, root="fixed")
    assert rbd.dynamics.mass_matrix(robot.at()).shape == (1, 1)
    with pytest.warns(ModelWarning, match=r"visual geometry of mine .*package_dirs="):
        assert isinstance(robot.visual_model, pin.GeometryModel)


@pytest.mark.parametrize("kind", [str, Path])
def test_package_dirs_say_where_meshes_are(tmp_path: Path, kind: type) -> None:
    """The folder above the package of `package://` meshes, as a string or a Path."""
    place = tmp_path / "far" / "mine_description"
    place.mkdir(parents=True)
    triangle = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    (place / "base.stl").write_text(f"solid t\n{triangle}endsolid t\n")
    mesh = '<visual><geometry><mesh filename="package://mine_description/base.stl"/></geometry></visual>'
    path = write(tmp_path, link("base", inside=mesh), link("arm"), joint("shoulder", "base", "arm"))
    robot = rbd.load_robot(path, package_dirs=[kind(tmp_path / "far")])
    assert robot.visual_model.ngeoms == 1


# -------------------------------------------------------------------------------------------------- broken files


@pytest.mark.parametrize("name", ["tallos", "", "g 1", "panda.", pytest.param("x" * 300, id="long")])
def test_an_unknown_robot_is_refused(name: str) -> None:
    """With the nearest names where there are any."""
    with pytest.raises(UnknownRobot, match="no robot") as caught:
        rbd.load_robot(name)
    if name == "tallos":
        assert "'talos'" in str(caught.value)


@pytest.mark.parametrize(
    "name",
    ["no/such.urdf", "/no/such/robot.urdf", "no.xml", Path("no.urdf"), Path("talos"), "~/no.urdf", "~nobody-here/no.urdf"],
)
def test_a_missing_file_is_refused(name: str | Path) -> None:
    """A path is no name: the message speaks of a file."""
    with pytest.raises(ModelError, match="no file"):
        rbd.load_robot(name)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    """A folder in place of a file, under a model's ending or not."""
    (tmp_path / "robot.urdf").mkdir()
    for folder in (tmp_path, tmp_path / "robot.urdf", str(tmp_path), str(tmp_path / "robot.urdf")):
        with pytest.raises(ModelError, match="no file"):
            rbd.load_robot(folder)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not XML at all",
        b"\x00\x01\x02\xff\xfe" * 100,
        b"<robot name='r'><link name='a'",
        b"<?xml version='1.0' encoding='no-such'?><robot name='r'/>",
        b"<html><body/></html>",
        b"<sdf version='1.7'><model name='m'/></sdf>",
        b"<robot name='r'/>",
        b"<mujoco/>",
        b"<mujoco model='m'><worldbody/></mujoco>",
        b"<mujoco><worldbody><body name='b'><joint type='wobbly'/></body></worldbody></mujoco>",
    ],
)
@pytest.mark.parametrize("root", ["free_flyer", "fixed"])
def test_a_file_that_is_no_robot_is_refused(tmp_path: Path, content: bytes, root: rbd.robots.loop_file.Root) -> None:
    """Empty, binary, cut off, another format: an error of ours with the file's name."""
    path = tmp_path / "r.urdf"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"r\.urdf"):
        rbd.load_robot(path, root=root)


BASE, ARM, HINGE = link("a"), link("b"), joint("j", "a", "b")


@pytest.mark.parametrize(
    ("parts", "culprit"),
    [
        ((BASE, link("b", -1.0), HINGE), "b"),
        ((BASE, link("b", np.nan), HINGE), "b"),
        ((BASE, link("b", np.inf), HINGE), "b"),
        ((BASE, ARM.replace('value="1.0"', 'value="${m}"'), HINGE), "b"),
        ((BASE, ARM.replace('ixx="1"', 'ixx="nan"'), HINGE), "b"),
        ((BASE, ARM, joint("j", "a", "b", inside='<axis xyz="0 0 0"/>' + LIMIT)), "j"),
        ((BASE, ARM, joint("j", "a", "b", inside='<axis xyz="nan 0 0"/>' + LIMIT)), "j"),
        ((BASE, ARM, joint("j", "a", "bb")), "bb"),
        ((BASE, ARM, link("c"), HINGE), "c"),
        ((BASE, ARM, joint("j", "b", "b")), "b"),
        ((BASE, ARM, link("c"), link("d"), HINGE, joint("k", "c", "d"), joint("l", "d", "c")), "c"),
        ((BASE, ARM, link("c"), link("d"), HINGE, joint("k", "a", "c"), joint("l", "b", "d"), joint("m", "c", "d")), "d"),
    ],
)
@pytest.mark.parametrize("root", ["free_flyer", "fixed"])
def test_what_pinocchio_would_take_for_another_robot_is_refused(
    tmp_path: Path, parts: tuple[str, ...], culprit: str, root: rbd.robots.loop_file.Root
) -> None:
    """Masses, axes and trees that are none: refused, with the file and the link or joint at fault, on either root."""
    with pytest.raises(ModelError, match=rf"mine\.urdf.*'{culprit}'"):
        rbd.load_robot(write(tmp_path, *parts), root=root)


@pytest.mark.parametrize(
    "parts",
    [
        (BASE, ARM, joint("j", "a", "b", inside="")),
        (BASE, ARM, joint("j", "a", "b", kind="wobbly")),
        (BASE, ARM, HINGE, joint("k", "b", "a")),
        (BASE, BASE, ARM, HINGE),
        (BASE, ARM, link("c"), HINGE, joint("j", "b", "c")),
        (),
    ],
)
@pytest.mark.parametrize("root", ["free_flyer", "fixed"])
def test_what_the_parser_refuses_is_an_error_of_ours(
    tmp_path: Path, parts: tuple[str, ...], root: rbd.robots.loop_file.Root
) -> None:
    """No limit where one must be, an unknown kind of joint, a circle, names given twice, nothing at all."""
    with pytest.raises(ModelError, match=r"mine\.urdf"):
        rbd.load_robot(write(tmp_path, *parts), root=root)


def test_an_inertia_that_no_body_has_is_said(tmp_path: Path) -> None:
    """A negative principal moment, which no body has, is not taken in silence: the link is named."""
    path = write(tmp_path, BASE, ARM.replace('ixx="1"', 'ixx="-1"'), HINGE)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            rbd.load_robot(path)
            said = str(caught[0].message)
        except ModelError as error:
            said = str(error)
    assert "'b'" in said


def test_a_body_without_inertia_is_refused(tmp_path: Path) -> None:
    """A moving link without an inertial makes M singular: said by name on loading, not answered with infinities."""
    with pytest.raises(ModelError, match="'j' .'b'. have no inertia"):
        rbd.load_robot(write(tmp_path, BASE, '<link name="b"/>', HINGE))


def test_a_joint_called_as_the_bases_own_is_refused(tmp_path: Path) -> None:
    """Pinocchio would mix up a user's `root_joint` and the floating base's; on a fixed base there is only the user's."""
    path = write(tmp_path, BASE, ARM, link("c"), joint("root_joint", "a", "b"), joint("k", "b", "c"))
    with pytest.raises(ModelError, match="'root_joint'"):
        rbd.load_robot(path)
    assert rbd.load_robot(path, root="fixed").actuated_names == ("root_joint", "k")


def test_a_link_may_be_called_universe(tmp_path: Path) -> None:
    """Pinocchio's name for the world is no reserved word in a file."""
    path = write(tmp_path, link("universe"), ARM, joint("j", "universe", "b"))
    assert rbd.load_robot(path).at().frame("universe").J.any()


def chain(folder: Path, n: int, kind: str) -> Path:
    bars = [link(f"l{i + 1}") + joint(f"j{i}", f"l{i}", f"l{i + 1}", kind) for i in range(n)]
    return write(folder, link("l0"), *bars)


@pytest.mark.parametrize(("n", "kind"), [(4000, "revolute"), (4000, "fixed"), (450, "revolute")])
def test_a_chain_without_end_is_refused(tmp_path: Path, n: int, kind: str) -> None:
    """Four thousand links in a row end the process inside the parser, 450 hinges fill gigabytes: neither is tried."""
    with pytest.raises(ModelError, match="at most|more than|limit"):
        rbd.load_robot(chain(tmp_path, n, kind))


def test_a_long_chain_loads(tmp_path: Path) -> None:
    """Within the bounds: 900 welded links and 60 hinges fall as one body when nothing is bent."""
    robot = rbd.load_robot(chain(tmp_path, 900, "fixed"))
    assert (robot.nv, robot.mass) == (6, 901.0)
    robot = rbd.load_robot(chain(tmp_path, 60, "revolute"))
    a = rbd.dynamics.free_acceleration(robot.at(), np.zeros(60))
    assert np.abs(a[:3] - [0.0, 0.0, -9.81]).max() < 1e-9 and np.abs(a[3:]).max() < 1e-9


@pytest.mark.parametrize("root", ["floating", "", True, 1, ["fixed"], np.array(["fixed", "fixed"])])
def test_an_unknown_root_is_refused(root: object) -> None:
    """Three words are known; None leaves it to the loop file."""
    with pytest.raises(InputError, match="expected 'free_flyer', 'planar' or 'fixed'"):
        rbd.load_robot("panda", root=root)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["hector", "iris_simple"])
def test_a_body_without_joints_is_a_robot_only_in_the_air(name: str) -> None:
    """A quadrotor's body has no motors but falls; welded to the world nothing moves."""
    robot = rbd.load_robot(name)
    assert (robot.nv, robot.nu) == (6, 0)
    assert np.abs(rbd.solve(robot.at(), np.zeros(0)).a - [0, 0, -9.81, 0, 0, 0]).max() < 1e-12
    with pytest.raises(ModelError, match="nothing moves"):
        rbd.load_robot(name, root="fixed")


def test_a_robot_says_what_it_is(talos: rbd.Robot) -> None:
    """Its repr has name, sizes and mass."""
    assert repr(talos) == f"Robot('talos', nq=39, nv=38, nu=32, mass={talos.mass:.3f} kg)"


def test_the_model_is_pinocchios(talos: rbd.Robot) -> None:
    """`robot.model` is the pin.Model, for whatever is not wrapped here."""
    assert isinstance(talos.model, pin.Model)
    assert np.abs(pin.neutral(talos.model) - talos.neutral()).max() == 0.0


def test_a_robot_with_feet_and_several_postures_is_told_to_be_given_one(monkeypatch):
    """Nothing says in which it stands: the remedy is named."""
    robot = rbd.load_robot("bolt")
    monkeypatch.setattr(robot, "source", replace(robot.source, posture=None))
    monkeypatch.setattr(robot, "postures", dict.fromkeys(("up", "down"), robot.posture("standing")))
    with pytest.raises(ModelError, match="no standing posture is known for bolt; .*Name one, standing.posture."):
        robot.standing()


def test_a_robot_with_feet_and_no_posture_stands_with_its_joints_at_zero(monkeypatch):
    """There is no other: its base is placed as in any posture."""
    robot = rbd.load_robot("solo12")
    monkeypatch.setattr(robot, "source", replace(robot.source, posture=None))
    monkeypatch.setattr(robot, "postures", {})
    state = robot.standing()
    assert not state.q[7:].any()
    assert np.abs([foot.rows(state).patch.gaps for foot in robot.feet()]).max() < 1e-12
