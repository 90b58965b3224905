"""Other engines in the audit: one box launched in five ways, MuJoCo's and Drake's robots, and what is refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from launched_box import FRICTION, HALF, STOP, WAYS, by_mujoco

import rbd
from rbd.audits import audit, from_drake, from_mujoco
from rbd.audits.mujoco_records import MujocoRobot

G1 = """
<mujoco><option timestep="0.002" tolerance="1e-14" iterations="300" ls_iterations="100"/>
<worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="trunk" pos="0 0 0.52"><freejoint name="root"/><geom type="box" size=".2 .1 .05" mass="8"/>
    <body name="thigh" pos=".1 .1 0"><joint name="hip" axis="0 1 0" damping="0.2" armature="0.01" range="-60 60"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass="1"/>
      <body name="shank" pos="0 0 -.2"><joint name="knee" axis="0 1 0" stiffness="5" frictionloss="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".5"/></body></body>
    <body name="arm" pos="-.2 0 0"><joint name="slide" type="slide" axis="0 0 1"/>
      <geom type="sphere" size=".06" mass="1" condim="4" friction="0.8 0.02 0.001"/></body>
    <body name="wrist" pos="0 -.2 0"><joint name="ball" type="ball"/><geom type="box" size=".03 .1 .03" mass="1"/></body>
  </body>
  <body name="crate" pos="0.1 0.1 0.9"><freejoint/><geom type="box" size=".1 .1 .1" mass="2" friction="0.4"/></body>
</worldbody><actuator><motor joint="hip" gear="2"/><position joint="knee" kp="20"/></actuator></mujoco>"""
"""Bodies on all kinds of joints that fall onto the floor and onto each other, with all kinds of forces."""


@pytest.fixture(scope="module")
def launched():
    """{way: its record}."""
    return {name: make() for name, make in WAYS.items()}


@pytest.fixture(scope="module")
def run():
    """(model, states): falls, touches, limits, springs, motors and a push."""
    model = mujoco.MjModel.from_xml_string(G1)
    data = mujoco.MjData(model)
    data.qvel[:] = 0.3 * np.random.default_rng(0).normal(size=model.nv)
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    states = np.empty((400, mujoco.mj_stateSize(model, spec)))
    for i, state in enumerate(states):
        data.ctrl[:] = (3.0 * np.sin(0.02 * i), 0.5)
        data.xfrc_applied[1] = (10.0, 0.0, 5.0, 0.0, 0.3, 0.0) if 100 < i < 200 else np.zeros(6)
        mujoco.mj_getState(model, data, state, spec)
        mujoco.mj_step(model, data)
    return model, states


@pytest.fixture(scope="module")
def kept():
    """(plant, contexts, roots) of a pendulum on a slide that a sphere hits."""
    pytest.importorskip("pydrake")
    from pydrake.geometry import Box, Sphere
    from pydrake.math import RigidTransform, RollPitchYaw
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, DiscreteContactApproximation
    from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, SpatialInertia, WeldJoint
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    solid = SpatialInertia.SolidBoxWithMass(2.0, 0.2, 0.1, 0.3)
    cart, rod, tip, ball = (plant.AddRigidBody(name, solid) for name in ("cart", "rod", "tip", "ball"))
    tilted = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), (0.1, 0.0, 0.5))
    world = plant.world_body()
    plant.AddJoint(PrismaticJoint("slide", plant.world_frame(), cart.body_frame(), (1.0, 0.0, 0.0), damping=3.0))
    turn = (
        RevoluteJoint("hinge", cart, tilted, rod, RigidTransform((0.0, 0.0, 0.2)), (0.0, 1.0, 0.0), damping=0.1)
        if False
        else None
    )
    turn = plant.AddJoint(RevoluteJoint("hinge", cart.body_frame(), rod.body_frame(), (0.0, 1.0, 0.0), damping=0.1))
    plant.AddJoint(WeldJoint("fixed", rod.body_frame(), tip.body_frame(), tilted))
    motor = plant.AddJointActuator("motor", turn)
    motor.set_default_rotor_inertia(0.01)
    motor.set_default_gear_ratio(5.0)
    rough = CoulombFriction(0.4, 0.4)
    plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(0.1), "ball", rough)
    plant.RegisterCollisionGeometry(world, RigidTransform((0.0, 0.0, -1.2)), Box(9.0, 9.0, 0.2), "floor", rough)
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyContextFromRoot(root)
    plant.SetFreeBodyPose(context, ball, RigidTransform(RollPitchYaw(0.5, 0.6, 0.7), (1.0, 0.0, -0.99)))
    plant.SetVelocities(context, np.arange(1.0, 1.0 + plant.num_velocities()))
    plant.SetFreeBodySpatialVelocity(context, ball, SpatialVelocity(np.array([3.0, 2.0, 1.0]), np.array([0.5, 0.2, -0.4])))
    plant.get_actuation_input_port().FixValue(context, [1.5])
    simulator, roots = Simulator(diagram, root), []
    for i in range(60):
        simulator.AdvanceTo(0.001 * (i + 1))
        roots.append(root.Clone())
    return plant, [plant.GetMyContextFromRoot(each) for each in roots], roots


class TestLaunchedBox:
    """Exact: no lift, a normal force of one weight, and a stop after v^2 / (2 mu g)."""

    def test_ours_is_exact(self, launched):
        """To the last digits of the closed form."""
        record = launched["rbd"]
        report = audit(record)
        assert report.ok and report.obeys == "coulomb"
        assert record.q[-1, 0] == pytest.approx(STOP, abs=1e-8) and np.ptp(record.q[:, 2]) < 1e-12
        assert report.largest_push[1] == pytest.approx(9.81, abs=1e-9)

    @pytest.mark.parametrize("way", [name for name in WAYS if name != "rbd"])
    def test_the_equation_of_motion_holds_in_all(self, launched, way):
        """So their models are translated rightly; Lagged iterates to its own tolerance."""
        assert audit(launched[way]).missing_scaled.max() < (1e-4 if "Lagged" in way else 1e-11)

    @pytest.mark.parametrize("way", sorted({"MuJoCo, pyramidal", "MuJoCo, elliptic", "Drake, SAP"} & {*WAYS}))
    def test_convex_ones_lift_and_press(self, launched, way):
        """What the law gives instead is told beside it."""
        record = launched[way]
        report = audit(record)
        assert report.of_cause("lifts").any() and record.q[:, 2].max() - HALF > 0.04
        frame, push, by_law = report.largest_push
        assert push > 25.0 * 9.81 and by_law <= 9.81 * (1.0 + 1e-9)
        assert f"largest push: {push:.4g} N" in str(report)

    def test_sap_obeys_the_convex_law_everywhere(self, launched):
        """By its own law it has no fault but its depth."""
        pytest.importorskip("pydrake")
        report = audit(launched["Drake, SAP"], law="convex")
        assert report.obeys == "convex" and not report.of_cause("lifts").any()

    def test_soft_ones_creep_and_are_described(self, launched):
        """Stiffness and creep, by numbers."""
        for way in ("MuJoCo, pyramidal", "MuJoCo, elliptic"):
            report = audit(launched[way])
            assert report.of_cause("creeps").any() and "creeps by" in str(report.softness[0])
        pytest.importorskip("pydrake")
        lagged = audit(launched["Drake, Lagged"])
        assert lagged.of_cause("creeps").any() and not lagged.of_cause("lifts").any()
        assert lagged.softness[0].stiffness == pytest.approx(5e5, rel=0.05)  # two materials of 1e6 N/m in series

    def test_the_table_of_the_docs(self, launched):
        """`docs/reference/audit.md` has these figures."""
        text = (Path(__file__).parents[2] / "docs/reference/audit.md").read_text(encoding="utf-8")
        rows = {cells[0]: cells for line in text.splitlines() if (cells := [x.strip() for x in line.strip("| ").split("|")])}
        for way, record in launched.items():
            report = audit(record)
            stop, lift, push, told = rows[way][1:5]
            assert float(stop.split()[0]) == pytest.approx(record.q[-1, 0], abs=0.02 * STOP if "MuJoCo" in way else 5e-4)
            assert float(lift.split()[0]) == pytest.approx(1e3 * (record.q[:, 2].max() - HALF), rel=0.05, abs=0.1)
            assert float(push.split()[0]) == pytest.approx(report.largest_push[1] / 9.81, rel=0.05)
            assert [cause for cause in told.split(", ") if cause != "none"] == list(report.ranked)


class TestMujoco:
    """A model with everything."""

    def test_its_equation_of_motion_is_ours(self, run):
        """Pinocchio's M and h at MuJoCo's accelerations balance MuJoCo's forces to rounding."""
        record = from_mujoco(*run)
        report = audit(record)
        assert report.missing_scaled.max() < 1e-11
        assert len(record.contact_at) > 100 and len(record.push_at) == 99
        assert {record.pair(i) for i in range(len(record.contact_at))} >= {"crate on trunk", "crate", "shank"}
        assert any("condim 4" in note for note in record.notes)

    def test_a_state_is_a_frame(self, run):
        """One state gives the same as within many."""
        model, states = run
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, states[250], mujoco.mjtState.mjSTATE_INTEGRATION)
        one, whole = from_mujoco(model, data), from_mujoco(model, states[240:260])
        some = whole.some([10])
        for name in ("q", "v", "a", "tau", "forces", "contact_bodies"):
            assert np.array_equal(getattr(one, name), getattr(some, name)), name

    def test_a_rollout_with_controls(self, run):
        """As `mujoco.rollout` gives them."""
        model, states = run
        from mujoco import rollout

        spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
        first = np.empty(mujoco.mj_stateSize(model, spec))
        mujoco.mj_getState(model, mujoco.MjData(model), first, spec)
        control = np.full((30, 2), 0.4)
        found, _ = rollout.rollout(model, mujoco.MjData(model), first, control)
        assert audit(from_mujoco(model, found, control=control)).missing_scaled.max() < 1e-11

    def test_a_robot_of_a_file_has_the_joints_by_name(self, run, tmp_path):
        """Joints of other names are refused."""
        path = tmp_path / "bodies.xml"
        path.write_text(G1)
        robot = rbd.load_robot(path, leave_out=["springs"])
        assert audit(from_mujoco(*run, robot=robot)).missing_scaled.max() < 1e-11
        with pytest.raises(rbd.errors.JointNotFound, match="no joint 'root'"):
            from_mujoco(*run, robot=rbd.load_robot("panda", root="fixed"))

    def test_what_is_refused(self, run):
        """By name."""
        model, states = run
        with pytest.raises(rbd.InputError, match="model is 3"):
            from_mujoco(3, states)
        with pytest.raises(rbd.InputError, match="states of 5 numbers"):
            from_mujoco(model, states[:, :5])

    def test_its_shapes_can_be_drawn(self, run):
        """From the compiled model."""
        robot = MujocoRobot(run[0])
        assert robot.visual_model.ngeoms == robot.collision_model.ngeoms == 7


class TestDrake:
    """A plant with joints."""

    def test_its_equation_of_motion_is_ours(self, kept):
        """Free, sliding, turning and welded bodies, damping, a geared motor, and a ball that bounces and rolls."""
        record = from_drake(*kept[:2])
        assert len(record.contact_at) > 5 and record.robot.nv == 8
        assert audit(record).missing_scaled.max() < 1e-9

    def test_what_is_refused(self):
        """By name."""
        pytest.importorskip("pydrake")
        from pydrake.multibody.plant import MultibodyPlant

        with pytest.raises(rbd.InputError, match="expected a MultibodyPlant"):
            from_drake("plant", None)
        with pytest.raises(rbd.errors.Unsupported, match="continuous in time"):
            from_drake(MultibodyPlant(0.0), None)


def test_two_engines_on_one_robot(launched):
    """By the names of joints and bodies; the same residual."""
    ours = launched["rbd"].robot
    for way in sorted({"MuJoCo, elliptic", "Drake, SAP"} & {*WAYS}):
        record = launched[way].on(ours)
        assert record.robot is ours and record.pair(0) == "box"
        assert audit(record).missing_scaled == pytest.approx(audit(launched[way]).missing_scaled, abs=1e-12)
    with pytest.raises(rbd.errors.JointNotFound, match="no joint 'box_free' in panda"):
        launched["MuJoCo, elliptic"].on(rbd.load_robot("panda", root="fixed"))
    with pytest.raises(rbd.InputError, match="of solo12 is not in MuJoCo model"):
        launched["MuJoCo, elliptic"].on(rbd.load_robot("solo12"))


def test_friction_of_another_coefficient_is_judged():
    """The same record, judged by half its friction: forces outside of the cone."""
    record = by_mujoco("elliptic").some(range(80))
    assert not audit(record).of_cause("outside the cone").any()
    assert audit(record, friction=0.5 * FRICTION).of_cause("outside the cone").any()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_lines_for_newton(tmp_path, monkeypatch, exhaustive):
    """Those of the docs, on a CPU; where Newton is installed, as its kernels compile for minutes."""
    if not exhaustive:
        pytest.skip("an exhaustive test")
    newton, wp = pytest.importorskip("newton"), pytest.importorskip("warp")
    monkeypatch.chdir(tmp_path)
    builder = newton.ModelBuilder()
    builder.default_shape_cfg.mu = FRICTION
    builder.add_shape_box(
        builder.add_body(xform=wp.transform((0, 0, HALF), wp.quat_identity()), label="box"), hx=HALF, hy=HALF, hz=HALF
    )
    builder.add_ground_plane()
    model = builder.finalize(device="cpu")
    model.request_contact_attributes("force")
    solver = newton.solvers.SolverMuJoCo(model)
    state, after = model.state(), model.state()
    speed = state.joint_qd.numpy().copy()
    speed[0] = 6.0
    state.joint_qd.assign(speed)
    newton.eval_fk(model, state.joint_q, state.joint_qd, state)
    contacts = newton.Contacts(solver.get_max_contact_count(), 0, device="cpu", requested_attributes={"force"})
    names = ("t", "q", "v", "v_next", *(f"contact_{x}" for x in ("at", "body", "point", "normal", "force")))
    text = (Path(__file__).parents[2] / "docs/reference/audit.md").read_text(encoding="utf-8")
    lines = text.partition("### Newton")[2].partition("```{code-block} python\n")[2].partition("```")[0]
    given = {"solver": solver, "state": state, "after": after, "control": model.control(), "dt": 0.002, "mu": FRICTION}
    exec(lines, given | {"model": model, "contacts": contacts, "wp": wp, "np": np, "rows": {name: [] for name in names}})
    report = audit(rbd.audits.Record.read("run.npz", rbd.testing.box(mass=1.0, size=(2 * HALF,) * 3)))
    assert report.missing_scaled.max() < 1e-3 and report.of_cause("lifts").any()
