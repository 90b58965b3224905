"""Springs and dampers in joints, and those of robot files."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import ForceElementWarning, InputError, JointNotFound, ModelWarning
from rbd.model.external import generalised


def pendulum() -> rbd.Robot:
    """A bar of 1 m and 1 kg."""
    return rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])


def test_a_spring_in_a_joint_pulls_back():
    """Torque -k q over the inertia m l^2 / 3, beside gravity."""
    arm = pendulum()
    state = arm.at([-np.pi / 2 + 0.2])
    spring = rbd.JointSpring("joint_1", stiffness=20.0, rest=-np.pi / 2)
    a = rbd.solve(state, [0.0], external=[spring]).a
    assert a == pytest.approx([(-20.0 * 0.2 - 0.5 * 9.81 * np.sin(0.2)) * 3.0], rel=1e-12)
    wound = rbd.JointSpring("joint_1", stiffness=20.0, preload=3.0)
    assert wound.force(arm.at([7.0])) == pytest.approx([3.0 - 140.0])  # a joint that counts turns
    assert wound.energy(arm.at([7.0])) == pytest.approx(0.5 * 20.0 * 49.0 - 21.0)


def test_derivatives_know_the_spring():
    """The derivative da/dq has -k / I beside that of gravity."""
    arm = pendulum()
    state = arm.at([-np.pi / 2], [0.3])
    spring = rbd.JointSpring("joint_1", stiffness=20.0, rest=-np.pi / 2)
    damper = rbd.JointDamping({"joint_1": 0.5})
    found = rbd.solve(state, [0.0], external=[spring, damper]).derivatives()
    assert found.da_dq[0, 0] == pytest.approx(-3.0 * (20.0 + 0.5 * 9.81), rel=1e-12)
    assert found.da_dv[0, 0] == pytest.approx(-1.5, rel=1e-12)


MJCF = """
<mujoco><worldbody>
  <body name="base"><freejoint name="root"/><geom size=".1"/>
    <body name="thigh" pos="0 0 -.3"><joint name="hip" axis="0 1 0" ref="20" stiffness="30" springref="-35" damping="2"/>
      <geom type="capsule" size=".05 .2"/>
      <body name="shin" pos="0 0 -.4"><joint name="knee" type="slide" axis="0 0 1" stiffness="90" springref=".1" damping="3"/>
        <geom size=".1"/>
        <body name="foot" pos="0 0 -.2"><joint name="ankle" type="ball" stiffness="7" damping=".5"/>
          <geom type="box" size=".1 .2 .3"/></body></body></body></body>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def sprung(tmp_path_factory) -> tuple[rbd.Robot, Path]:
    """A floating robot with springs and damping in a hinge, a slide and a ball joint."""
    path = tmp_path_factory.mktemp("sprung") / "sprung.xml"
    path.write_text(MJCF)
    with pytest.warns(ModelWarning, match="3 joints have springs, which act where external=robot.joint_springs.. is given"):
        return rbd.load_robot(path), path


def test_springs_and_damping_of_an_mjcf_are_mujocos(sprung):
    """The passive forces of MuJoCo at random states are those of `joint_springs` and `joint_damping`."""
    robot, path = sprung
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    elements = [*robot.joint_springs(), robot.joint_damping()]
    assert [e.name for e in elements] == ["spring in hip", "spring in knee", "spring in ankle", "joint_damping"]
    for _ in range(5):
        state = rbd.State(
            robot, pin.integrate(robot.model, robot.neutral(), rng.uniform(-0.8, 0.8, robot.nv)), rng.normal(size=robot.nv)
        )
        data.qpos[:], data.qvel[:] = state.q, state.v
        for at in (3, len(state.q) - 4):
            data.qpos[at : at + 4] = np.roll(state.q[at : at + 4], 1)
        mujoco.mj_forward(model, data)
        ours, wrench = generalised(state, elements)
        assert np.abs(ours - data.qfrc_passive).max() < 1e-12 and not wrench.any() and np.abs(ours[6:]).min() > 1e-3
        springs = sum(spring.energy(state) for spring in robot.joint_springs())
        mujoco.mj_energyPos(model, data)
        without = -robot.mass * robot.gravity @ state.com
        assert springs == pytest.approx(data.energy[0] - without, rel=1e-9)


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
def test_springs_of_a_file_travel_with_the_robot(sprung):
    """In copies and pickles, under another gravity, in a pair with prefixes; not where they were left out."""
    robot, path = sprung
    expected = [(s.joint, s.stiffness, s.rest) for s in robot.joint_springs()]
    assert [j for j, _, _ in expected] == ["hip", "knee", "ankle"] and expected[0][2] == pytest.approx(math.radians(-35.0))
    in_memory = rbd.load_robot(text=MJCF)
    for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot), robot.with_gravity((0, 0, -1.62)), in_memory):
        assert [(s.joint, s.stiffness, s.rest) for s in other.joint_springs()] == expected
        assert dict(other.joint_damping().damping) == {"hip": 2.0, "knee": 3.0, "ankle": 0.5}
    pair = rbd.robots.merge_robots(robot, rbd.testing.box())
    assert [s.joint for s in pair.joint_springs()] == ["a_hip", "a_knee", "a_ankle"]
    assert dict(pair.joint_damping().damping) == {"a_hip": 2.0, "a_knee": 3.0, "a_ankle": 0.5}
    assert rbd.load_robot(path, leave_out=["springs"]).joint_springs() == []


def test_damping_of_a_urdf(talos: rbd.Robot):
    """Of each joint that states one, as one element; a file without damping has none."""
    damping = talos.joint_damping()
    d = np.array(talos.model.damping)
    assert len(damping.damping) == np.count_nonzero(d) > 10 and np.array_equal(damping.diagonal(talos), d)
    state = rbd.State(talos, talos.standing().q, np.random.default_rng(0).normal(size=talos.nv))
    assert np.array_equal(generalised(state, damping)[0], -d * state.v)
    assert damping.dissipation(state) == pytest.approx(state.v @ (d * state.v), rel=1e-14) and damping.energy(state) == 0.0
    bare = rbd.testing.box()
    assert rbd.load_robot("solo12").joint_damping().damping == {} and bare.nv == 6
    assert "act only where they are given: external=robot.joint_damping()" in str(rbd.doctor(talos))


def test_a_ball_joint_pulls_back_by_its_rotation_vector(sprung):
    """-k times the vector, from a rest that may be turned; at 172 degrees it is refused."""
    robot, _ = sprung
    at = robot.joints["ankle"].q
    rest = np.array([0.0, 0.6, 0.0, 0.8])
    for angle in (0.4, 2.9):
        turned = pin.Quaternion(rest) * pin.Quaternion(pin.AngleAxis(angle, np.array([0.0, 0.0, 1.0])))
        state = robot.at().with_joints({"ankle": turned.coeffs()})
        spring = rbd.JointSpring("ankle", stiffness=7.0, rest=rest)
        assert spring.generalised(state)[0][robot.joints["ankle"].v] == pytest.approx([0, 0, -7.0 * angle], abs=1e-12)
        assert spring.energy(state) == pytest.approx(3.5 * angle**2) and spring.picture(state).axis is None
    turned = pin.Quaternion(pin.AngleAxis(3.0, np.array([1.0, 0.0, 0.0]))).coeffs()
    with pytest.raises(InputError, match="'spring in ankle' is 172 degrees from its rest"):
        rbd.JointSpring("ankle", stiffness=7.0).force(robot.at().with_joints({"ankle": turned}))
    assert at.stop - at.start == 4


def test_a_continuous_joint_is_taken_near_the_rest():
    """Its angle is (cos, sin), known up to turns."""
    robot = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "unicycle.urdf")
    joint = next(j for j in robot.joints.values() if j.is_continuous)
    spring = rbd.JointSpring(joint.name, stiffness=2.0, rest=3.0)
    assert spring.force(robot.at().with_joints({joint.name: -3.0})) == pytest.approx([-2.0 * (2 * math.pi - 6.0)], rel=1e-12)
    with pytest.raises(InputError, match="172 degrees from its rest"):
        spring.force(robot.at())


def test_what_is_no_joint_spring(sprung, talos: rbd.Robot):
    """Refused by name, with the nearest joints; a negative stiffness is warned of, a negative damping is an error."""
    robot, _ = sprung
    rest = robot.at()

    def ask(element: object) -> None:
        rbd.solve(rest, np.zeros(robot.nu), external=element)

    for make, error, says in (
        (lambda: ask(rbd.JointSpring("hipp", stiffness=1.0)), JointNotFound, "nearest: 'hip'"),
        (lambda: ask(rbd.JointSpring("root", stiffness=1.0)), InputError, "'root' has 6 degrees of freedom .* rbd.Bushing"),
        (lambda: ask(rbd.JointSpring("ankle", stiffness=1.0, rest=0.3)), InputError, "in a ball joint; expected no preload"),
        (lambda: ask(rbd.JointSpring("ankle", stiffness=1.0, preload=0.3)), InputError, "in a ball joint; expected no preload"),
        (
            lambda: ask(rbd.JointSpring("hip", stiffness=1.0, rest=(0, 0, 0, 1))),
            InputError,
            "is a quaternion, and the joint has",
        ),
        (lambda: rbd.JointSpring("hip", stiffness=1.0, rest=(0, 0, 1)), InputError, r"rest of .* has shape \(3,\)"),
        (lambda: rbd.JointSpring("hip", stiffness=1.0, rest=(0, 0, 0, 2)), InputError, "norm 2; expected norm 1"),
        (lambda: rbd.JointSpring("hip", stiffness=math.nan), InputError, "stiffness of the spring in 'hip' is nan"),
        (lambda: rbd.JointSpring("hip", stiffness=1.0, rest=math.nan), InputError, "rest of .* is not finite"),
        (lambda: rbd.JointSpring(3, stiffness=1.0), InputError, "expected the name of a joint"),
        (lambda: rbd.JointSpring("hip", stiffness=1.0, name=3), InputError, "name of .* is 3"),
        (
            lambda: rbd.JointDamping({"hip": -0.1}),
            InputError,
            "damping of joint 'hip' is -0.1; expected a finite number from 0",
        ),
        (lambda: rbd.JointDamping({"hip": math.nan}), InputError, "damping of joint 'hip' is nan"),
        (lambda: rbd.JointDamping([0.1]), InputError, r"damping is \[0.1\]; expected a joint and its damping"),
        (lambda: rbd.JointDamping({"hip": 1.0}, name=""), InputError, "name of joint damping"),
        (lambda: ask(rbd.JointDamping({"hipp": 0.1})), JointNotFound, "nearest: 'hip'"),
    ):
        with pytest.raises(error, match=says):
            make()
    with pytest.warns(ForceElementWarning, match="stiffness of the spring in 'hip' is -1"):
        rbd.JointSpring("hip", stiffness=-1.0)
    part = rbd.JointDamping({"root.wz": 2.0, "hip": 1.0})  # of one velocity of a joint
    assert part.diagonal(robot).tolist() == [0, 0, 0, 0, 0, 2.0, 1.0, 0, 0, 0, 0]


def test_pictures_of_joint_elements(sprung):
    """At the joint's origin, about its axis in W, with the torque."""
    robot, _ = sprung
    state = robot.at().with_joints({"hip": 0.5, "knee": 0.2})
    hip, knee = (rbd.JointSpring(j, stiffness=10.0).picture(state) for j in ("hip", "knee"))
    assert hip.kind == "joint spring" and hip.value == pytest.approx(-5.0) and np.abs(hip.axis - [0, 1, 0]).max() < 1e-12
    assert np.abs(hip.points - [0, 0, -0.3]).max() < 1e-12 and np.linalg.norm(knee.axis) == pytest.approx(1.0)
    assert knee.axis[0] == pytest.approx(math.sin(0.5 - math.radians(20.0)))
