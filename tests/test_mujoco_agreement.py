"""Two independent engines agree on every term of M a + h = f, and on how a held robot moves."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import rbd
from rbd.model.checked_model import CheckedModel

pytest.importorskip("mujoco", minversion="4.0", reason="compares with MuJoCo; before 4.0 it rounds inertias, by 1e-8")

from mujoco_bridge import MujocoTwin, TwinState, physical_urdf  # noqa: E402

Array = NDArray[np.float64]
Draw = Callable[[str, int], tuple[rbd.State, TwinState]]

# Shares of the largest entry. Measured: 1e-15, 1e-14 and 1e-13; rounding, and rounding times the condition of M.
TERM = 1e-13
FREE_MOTION = 1e-12
HELD_MOTION = 1e-11
SOLVED = 1e-9  # what the package calls solved: all that is promised of an iterative solver

ROOTS = {"talos": "free_flyer", "g1": "free_flyer", "panda": "fixed"}
HELD = {
    "talos": ("left_sole_link", "right_sole_link"),
    "g1": ("left_ankle_roll_link", "right_ankle_roll_link"),
    "panda": ("panda_hand_tcp",),
}
SEEDS = range(4)
TORQUE_NM = 30.0
OFFSET = (0.11, -0.07, 0.23)  # [m], off every axis
PATCH = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.3, 0.8), np.array(OFFSET))
ROTORS = np.array([0.1, 0.2, 0.3])  # [kg, kg m2], in Pinocchio's order of the joints: alpha, zeta, spin
WRIST, HEAVIER_KG = "wrist_right_ft_link", 1e-6

# Siblings out of alphabetical order, an endless and a sliding joint, dissipation, turned inertias on a moving and on a
# welded link; and one principal inertia of the hand, 0.05, exceeds the sum of the others.
TREE = """<robot name="tree">
  <link name="trunk"><inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 0.2 0.1"/><mass value="3"/>
    <inertia ixx="0.2" ixy="0.01" ixz="-0.02" iyy="0.25" iyz="0.03" izz="0.3"/></inertial></link>
  <joint name="zeta" type="revolute"><parent link="trunk"/><child link="arm"/><axis xyz="0.6 0 0.8"/>
    <origin xyz="0 0.2 0.1" rpy="0.1 0.5 -0.4"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
    <dynamics damping="5" friction="3"/></joint>
  <link name="arm"><inertial><origin xyz="0.1 0 0.3" rpy="-0.3 0 1"/><mass value="1"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.02" iyz="0.002" izz="0.03"/></inertial></link>
  <joint name="alpha" type="prismatic"><parent link="trunk"/><child link="slide"/><axis xyz="0 1 0"/>
    <origin xyz="0.1 0 0" rpy="0 0.2 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <link name="slide"><inertial><origin xyz="0 0.1 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.02"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="arm"/><child link="hand"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.5" rpy="0 0 0.7"/><limit effort="9" velocity="9"/></joint>
  <link name="hand"><inertial><origin xyz="0.05 0 0.1"/><mass value="0.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.05"/></inertial></link>
  <joint name="weld" type="fixed"><parent link="hand"/><child link="tool"/>
    <origin xyz="0 0.1 0.1" rpy="1 0.5 0.2"/></joint>
  <link name="tool"><inertial><origin xyz="0.1 0.1 0" rpy="0 0 0.5"/><mass value="0.3"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
</robot>"""


@pytest.fixture(scope="module")
def draw(tmp_path_factory: pytest.TempPathFactory) -> Draw:
    """Both engines' account of a robot at a seed's q, inside the joint limits, and v, of order 1."""
    folder = tmp_path_factory.mktemp("tree")
    robots = {name: rbd.load_robot(name, root=root) for name, root in ROOTS.items()}
    (folder / "tree.urdf").write_text(TREE)
    physical, _ = physical_urdf(folder / "tree.urdf", tmp_path_factory.mktemp("physical"))
    for root in ("free_flyer", "fixed"):
        robots[f"tree, {root}"] = rbd.load_robot(physical, root=root)
    twins = {name: MujocoTwin(robot) for name, robot in robots.items()}

    def both(name: str, seed: int) -> tuple[rbd.State, TwinState]:
        q, v = _random_motion(robots[name].model, seed)
        return rbd.State(robots[name], q, v), twins[name].at(q, v)

    return both


MACHINES = (*ROOTS, "tree, free_flyer", "tree, fixed")


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", SEEDS)
def test_both_engines_weigh_a_robot_the_same(draw: Draw, name: str, seed: int) -> None:
    """The mass matrix M(q) is the same."""
    state, twin = draw(name, seed)
    assert _apart(state.M, twin.M) < TERM
    assert _apart(rbd.dynamics.mass_matrix(state), twin.M) < TERM


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", SEEDS)
def test_both_engines_feel_the_same_weight_and_inertia_forces(draw: Draw, name: str, seed: int) -> None:
    """The bias force h = C(q, v) v + g(q) is the same, and its parts are; damping and friction are in neither."""
    state, twin = draw(name, seed)
    assert _apart(state.h, twin.h) < TERM
    assert _apart(rbd.dynamics.bias_force(state), twin.h) < TERM
    assert _apart(rbd.dynamics.gravity_torque(state), -twin.gravity) < TERM


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", SEEDS[:2])
def test_both_engines_move_every_link_the_same(draw: Draw, name: str, seed: int) -> None:
    """Place, J, J v and the classical J_dot v of a point off each link's origin are the same, in world axes."""
    state, twin = draw(name, seed)
    for link in twin.links():
        ours, theirs = state.frame(link, offset=OFFSET), twin.frame(link, OFFSET)
        assert _apart(ours.X_WF.translation, theirs.p_WP) < TERM
        assert _apart(ours.J, theirs.J) < TERM
        assert _apart(ours.v, theirs.J @ state.v) < TERM
        assert _apart(ours.bias, theirs.bias) < TERM


@pytest.mark.parametrize("name", MACHINES)
def test_both_engines_have_the_same_coriolis_tensor(draw: Draw, name: str) -> None:
    """C_ijk, symmetric in j and k: MuJoCo's follows from forces alone, at n (n + 1) / 2 velocities."""
    state, twin = draw(name, 0)
    theirs = twin.coriolis_tensor()
    assert _apart(rbd.dynamics.coriolis_tensor(state), theirs) < TERM
    assert _apart(state.v @ theirs @ state.v, twin.h - twin.gravity) < TERM


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", SEEDS)
def test_both_engines_let_go_of_a_robot_the_same(draw: Draw, name: str, seed: int) -> None:
    """M a + h = S^T tau: the acceleration of the free robot is the same."""
    state, twin = draw(name, seed)
    tau, force = _motors(state, seed)
    assert _apart(rbd.dynamics.free_acceleration(state, tau), twin.acceleration(force)) < FREE_MOTION


@pytest.mark.parametrize(("solver", "tolerance"), [(rbd.KKT(), HELD_MOTION), (None, SOLVED)], ids=["KKT", "default"])
@pytest.mark.parametrize("name", HELD)
@pytest.mark.parametrize("seed", SEEDS)
def test_both_engines_move_a_held_robot_the_same(
    draw: Draw, name: str, seed: int, solver: rbd.KKT | None, tolerance: float
) -> None:
    """Gauss's principle with J a + J_dot v = 0: MuJoCo's M, h, J and J_dot v at the held points, and NumPy's LU.

    The links turn, so where on a link the point is makes a difference of omega x (omega x offset); how the patch lies
    on the link makes none.
    """
    state, twin = draw(name, seed)
    tau, force = _motors(state, seed)
    contacts = [rbd.SurfaceContact(link, link, half_lengths=(0.1, 0.05), placement=PATCH) for link in HELD[name]]
    settings = {} if solver is None else {"solver": solver}
    expected = twin.acceleration(force, [twin.frame(link, OFFSET) for link in HELD[name]])
    assert _apart(rbd.solve(state, tau, contacts, **settings).a, expected) < tolerance


def test_both_engines_add_a_rotors_inertia_to_its_own_joint(tmp_path: Path) -> None:
    """Rotor inertia seen through the gear is a diagonal term of M and in no term of h."""
    (tmp_path / "tree.urdf").write_text(TREE)
    urdf, _ = physical_urdf(tmp_path / "tree.urdf", tmp_path)
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    bare = pin.crba(model, model.createData(), pin.neutral(model))
    model.armature[6:] = ROTORS
    q, v = _random_motion(model, 0)
    state, twin = rbd.State(CheckedModel(model), q, v), MujocoTwin(Loaded(model, urdf, "free_flyer")).at(q, v)
    assert _apart(state.M, twin.M) < TERM
    assert _apart(state.h, twin.h) < TERM
    assert _apart(rbd.dynamics.free_acceleration(state, np.zeros(3)), twin.acceleration(np.zeros(9))) < FREE_MOTION
    with_rotors = pin.crba(model, model.createData(), pin.neutral(model))
    assert _apart(np.diag(with_rotors - bare)[6:], ROTORS) < TERM


def test_a_milligram_more_at_the_wrist_is_seen(draw: Draw, tmp_path: Path) -> None:
    """The comparison can fail: 1e-6 kg on a 90 kg robot stands out of M by a thousand times the tolerance."""
    state, _ = draw("talos", 0)
    tree = ElementTree.parse(state.robot.urdf)
    mass = tree.find(f"link[@name='{WRIST}']/inertial/mass")
    mass.set("value", repr(float(mass.get("value")) + HEAVIER_KG))
    tree.write(tmp_path / "heavier.urdf")
    heavier = MujocoTwin(Loaded(state.robot.model, tmp_path / "heavier.urdf", "free_flyer"))
    assert _apart(state.M, heavier.at(state.q, state.v).M) > 1000.0 * TERM


def test_an_inertia_that_no_body_has_is_made_physical_for_both_engines(tmp_path: Path) -> None:
    """Principal inertias a <= b <= c of a body satisfy a + b >= c: MuJoCo refuses others, Pinocchio computes on."""
    (tmp_path / "tree.urdf").write_text(TREE)
    (tmp_path / "physical").mkdir()
    original, (copy, changed) = tmp_path / "tree.urdf", physical_urdf(tmp_path / "tree.urdf", tmp_path / "physical")
    model = pin.buildModelFromUrdf(str(original))
    with pytest.raises(ValueError, match="inertia must satisfy A \\+ B >= C"):
        MujocoTwin(Loaded(model, original, "fixed"))
    assert changed == ["hand"]
    assert physical_urdf(copy, tmp_path)[1] == []
    repaired = pin.buildModelFromUrdf(str(copy))
    q = pin.neutral(model)
    difference = pin.crba(repaired, repaired.createData(), q) - pin.crba(model, model.createData(), q)
    spin = model.joints[model.getJointId("spin")].idx_v
    assert 0.02 < difference[spin, spin] < 0.02 * (1.0 + 1e-5)  # c - a - b of the hand, and the margin [kg m2]


@dataclass(frozen=True)
class Loaded:
    """A model and the file of which MuJoCo makes the twin."""

    model: pin.Model
    urdf: Path
    root: str


def _apart(ours: Array, theirs: Array) -> float:
    """Largest difference, as a share of the largest entry; where all are below 1, in SI units."""
    return float(np.abs(ours - theirs).max() / max(1.0, np.abs(theirs).max()))


def _random_motion(model: pin.Model, seed: int) -> tuple[Array, Array]:
    """Draw q inside the joint limits, the base anywhere within 1 m and turned any way; v of standard deviation 1."""
    random = np.random.default_rng(seed)
    low, high = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    for joint in model.joints:
        if joint.shortname() == "JointModelFreeFlyer" or joint.nq > joint.nv:  # q on a sphere or a circle, no limits
            low[joint.idx_q : joint.idx_q + joint.nq] = -1.0
            high[joint.idx_q : joint.idx_q + joint.nq] = 1.0
    q = pin.normalize(model, random.uniform(low, high))
    return q, random.normal(size=model.nv)


def _motors(state: rbd.State, seed: int) -> tuple[Array, Array]:
    """Random motor torques within the limits, and the generalised force S^T tau; no force on a floating base."""
    robot = state.robot
    tau = np.random.default_rng(seed).uniform(-1.0, 1.0, robot.nu) * np.minimum(robot.effort_limit, TORQUE_NM)
    force = np.zeros(robot.nv)
    force[robot.actuated] = tau
    return tau, force
