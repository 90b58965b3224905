"""A box of 0.1 m and 1 kg, launched flat at 6 m/s with friction 0.5, in five ways: exactly, it stops at 3.66972477 m."""

from __future__ import annotations

from importlib.util import find_spec

import mujoco
import numpy as np
import pinocchio as pin

import rbd
from rbd.audits import Record, from_drake, from_mujoco, from_trajectory

SPEED, FRICTION, HALF, STEP, TIME = 6.0, 0.5, 0.05, 0.002, 1.4
STOP = SPEED**2 / (2.0 * FRICTION * 9.81)


def by_rbd() -> Record:
    """`rbd.simulate`."""
    box = rbd.testing.box(mass=1.0, size=(2 * HALF,) * 3)
    place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -HALF]))
    face = rbd.SurfaceContact("face", "box", half_lengths=(HALF, HALF), placement=place, friction=FRICTION, on=0.0)
    start = rbd.State(box, [0, 0, HALF, 0, 0, 0, 1], [SPEED, 0, 0, 0, 0, 0])
    run = rbd.simulate(start, [face], duration=TIME, step=STEP, progress=False)
    return from_trajectory(run, [face])


def by_mujoco(cone: str) -> Record:
    """MuJoCo as it comes, but for its cone: "pyramidal" or "elliptic"."""
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option cone="{cone}" timestep="{STEP}"/><worldbody>
          <geom type="plane" size="9 9 1" friction="{FRICTION} 0 0"/>
          <body name="box" pos="0 0 {HALF}"><freejoint/>
            <geom type="box" size="{HALF} {HALF} {HALF}" mass="1" friction="{FRICTION} 0 0"/></body>
        </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = SPEED
    states = np.empty((round(TIME / STEP), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)))
    for state in states:
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_step(model, data)
    return from_mujoco(model, states)


def by_drake(approximation: str) -> Record:
    """Drake with one of its approximations of contact: "kSap" or "kLagged"."""
    from pydrake.geometry import HalfSpace, Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, DiscreteContactApproximation
    from pydrake.multibody.tree import SpatialInertia
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, STEP)
    plant.set_discrete_contact_approximation(getattr(DiscreteContactApproximation, approximation))
    box = plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(1.0, 2 * HALF, 2 * HALF, 2 * HALF))
    rough = CoulombFriction(FRICTION, FRICTION)
    corners = [(x, y, -HALF) for x in (-HALF, HALF) for y in (-HALF, HALF)]
    for i, corner in enumerate(corners):
        plant.RegisterCollisionGeometry(box, RigidTransform(corner), Sphere(1e-6), f"corner {i}", rough)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", rough)
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyContextFromRoot(root)
    plant.SetFreeBodyPose(context, box, RigidTransform((0.0, 0.0, HALF)))
    plant.SetFreeBodySpatialVelocity(context, box, SpatialVelocity(np.zeros(3), np.array([SPEED, 0.0, 0.0])))
    simulator, kept = Simulator(diagram, root), []
    for i in range(round(TIME / STEP)):
        simulator.AdvanceTo((i + 1) * STEP)
        kept.append(root.Clone())
    return from_drake(plant, [plant.GetMyContextFromRoot(each) for each in kept])


WAYS = {
    "rbd": by_rbd,
    "MuJoCo, pyramidal": lambda: by_mujoco("pyramidal"),
    "MuJoCo, elliptic": lambda: by_mujoco("elliptic"),
}
if find_spec("pydrake"):  # there are no wheels for all machines
    WAYS |= {"Drake, SAP": lambda: by_drake("kSap"), "Drake, Lagged": lambda: by_drake("kLagged")}
