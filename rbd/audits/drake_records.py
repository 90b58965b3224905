"""Records of Drake: its contact results and accelerations in one state, as its plant computes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.audits.record import WORLD, Record, unit_of
from rbd.errors import InputError, Unsupported
from rbd.model.checked_model import CheckedModel
from rbd.modules import of_extra

_KINDS = {"quaternion_floating": "FreeFlyer", "revolute": "RevoluteUnaligned", "prismatic": "PrismaticUnaligned", "weld": ""}
"""{Drake's type of a joint: Pinocchio's}."""


class DrakeRobot(CheckedModel):
    """A plant of Drake as a robot: its bodies, joints, inertias and gravity, without shapes.

    Args:
        plant: A finalized `pydrake.multibody.plant.MultibodyPlant`.

    Raises:
        Unsupported: joints that are neither free, revolute, prismatic nor welded, by name.
    """

    def __init__(self, plant: Any) -> None:
        model = pin.Model()
        model.name = "Drake's plant"
        model.gravity.linear = plant.gravity_field().gravity_vector()
        carriers: dict[int, tuple[int, pin.SE3]] = {int(plant.world_body().index()): (0, pin.SE3.Identity())}
        self.columns = np.zeros(plant.num_positions(), int), np.zeros(plant.num_velocities(), int)
        below: dict[int, list[Any]] = {}
        for joint in map(plant.get_joint, plant.GetJointIndices()):
            below.setdefault(int(joint.parent_body().index()), []).append(joint)
        to_do = [*below.pop(0, [])]  # the world is body 0; depth first, as Pinocchio's algorithms want it
        while to_do:
            joint = to_do.pop()
            child = int(joint.child_body().index())
            carriers[child] = self._hung(model, joint, carriers[int(joint.parent_body().index())])
            to_do += below.pop(child, [])
        bodies = {index: plant.get_body(_index(plant, index)) for index in carriers}
        short = [body.name() for body in bodies.values()]
        self.names = {
            index: body.name() if short.count(body.name()) == 1 else body.scoped_name().get_full()
            for index, body in bodies.items()
        }
        self.names[int(plant.world_body().index())] = WORLD
        for index, (joint_id, X) in carriers.items():
            if index == int(plant.world_body().index()):
                continue
            model.addFrame(pin.Frame(self.names[index], joint_id, 0, X, pin.FrameType.BODY))
            if joint_id:
                inertia = plant.get_body(_index(plant, index)).default_spatial_inertia()
                about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
                model.appendBodyToJoint(joint_id, pin.Inertia(inertia.get_mass(), inertia.get_com(), about_com), X)
        armature, driven = np.zeros(model.nv), set()
        for i in plant.GetJointActuatorIndices():
            actuator = plant.get_joint_actuator(i)
            driven.add(actuator.joint().name())
            at = self.columns[1][actuator.joint().velocity_start()]
            armature[at] += actuator.default_rotor_inertia() * actuator.default_gear_ratio() ** 2
        model.armature = armature
        passive = [name for i, name in enumerate(model.names) if i and model.joints[i].nv == 1 and name not in driven]
        super().__init__(model, passive=passive, name=model.name)

    def _hung(self, model: pin.Model, joint: Any, parent: tuple[int, pin.SE3]) -> tuple[int, pin.SE3]:
        """(joint of the child body, X from its axes to the body's) of a joint that is added."""
        kind = joint.type_name()
        if kind not in _KINDS:
            raise Unsupported(
                f"joint {joint.name()!r:.80} of Drake's plant is of type {kind!r}; expected {', '.join(_KINDS)}. "
                "Give a Record its arrays: docs, Audit of other engines."
            )
        number, X = parent
        at = X * _pose(joint.frame_on_parent().GetFixedPoseInBodyFrame())
        back = _pose(joint.frame_on_child().GetFixedPoseInBodyFrame()).inverse()
        if not _KINDS[kind]:
            return number, at * _pose(joint.X_FM()) * back
        axis = (
            ()
            if kind == "quaternion_floating"
            else (joint.revolute_axis() if kind == "revolute" else joint.translation_axis(),)
        )
        made = getattr(pin, f"JointModel{_KINDS[kind]}")(*axis)
        added = model.addJoint(number, made, at, joint.name())
        q, v = model.idx_qs[added], model.idx_vs[added]
        first, speed = joint.position_start(), joint.velocity_start()
        if kind == "quaternion_floating":  # w, x, y, z, then the position; angular velocity first
            self.columns[0][first : first + 7] = q + np.array([6, 3, 4, 5, 0, 1, 2])
            self.columns[1][speed : speed + 6] = v + np.array([3, 4, 5, 0, 1, 2])
        else:
            self.columns[0][first], self.columns[1][speed] = q, v
        return added, back


def from_drake(plant: Any, context: Any, *, robot: CheckedModel | None = None) -> Record:
    """The record of Drake's contact forces in the step that a discrete plant has taken, or will take, at a context.

    Outputs of a discrete plant are sampled, unless `plant.SetUseSampledOutputPorts(False)` was called: they belong to the step
    that led to the context. The record then has the state before it: v - h a, and q - h N(q) v by Drake's own rule. Else they
    belong to the step that begins there. Motors and damping of joints are among the known forces; limits and other constraints
    are not, and are missing in the balance where they act.

    Args:
        plant: A finalized `pydrake.multibody.plant.MultibodyPlant`, discrete in time.
        context: Its context, within that of a diagram with a scene graph; several of them for several frames.
        robot: The same robot, with joints and bodies of the same names; None: what the plant says.

    Raises:
        InputError: pydrake is not installed, or no such plant.
        Unsupported: a continuous plant; joints that are neither free, revolute, prismatic nor welded, by name.

    Example:
        >>> from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        >>> from pydrake.multibody.tree import SpatialInertia
        >>> from pydrake.systems.framework import DiagramBuilder
        >>> builder = DiagramBuilder()
        >>> plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        >>> ball = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        >>> plant.SetUseSampledOutputPorts(False)
        >>> plant.Finalize()
        >>> diagram = builder.Build()
        >>> context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
        >>> rbd.audits.from_drake(plant, context).a[0].round(9) + 0.0
        array([ 0.  ,  0.  , -9.81,  0.  ,  0.  ,  0.  ])
    """
    of_extra("pydrake", "drake")
    if not hasattr(plant, "get_contact_results_output_port"):
        raise InputError(f"plant is {plant!r:.80}; expected a MultibodyPlant of pydrake.")
    if not plant.time_step() > 0.0:
        raise Unsupported("the plant is continuous in time; expected a discrete one: MultibodyPlant(time_step=0.001).")
    own, h, sampled = DrakeRobot(plant), plant.time_step(), plant.has_sampled_output_ports()
    contexts = list(context) if isinstance(context, Sequence) else [context]
    n = len(contexts)
    t, q, (v, a, tau) = np.zeros(n), np.zeros((n, own.nq)), np.zeros((3, n, own.nv))
    lists: dict[str, list[Any]] = {
        name: [] for name in ("contact_at", "contact_bodies", "points", "normals", "friction", "forces", "gaps")
    }
    damping = np.zeros(own.nv)
    for i in plant.GetJointIndices():
        joint = plant.get_joint(i)
        if joint.num_velocities() == 1 and hasattr(joint, "default_damping"):
            damping[own.columns[1][joint.velocity_start()]] = joint.default_damping()
    B, (at_q, at_v), work = plant.MakeActuationMatrix(), own.columns, plant.CreateDefaultContext()
    for frame, each in enumerate(contexts):
        q_now, v_now = np.array(plant.GetPositions(each)), np.array(plant.GetVelocities(each))
        rate = np.array(plant.get_generalized_acceleration_output_port().Eval(each))
        after = v_now
        if sampled:
            q_now, v_now = _before(plant, work, q_now, v_now, h), v_now - h * rate
        else:
            after = v_now + h * rate
        t[frame], q[frame, at_q], v[frame, at_v], a[frame, at_v] = each.get_time() - sampled * h, q_now, v_now, rate
        for piece in own.joints.pieces:  # steps of 2 ms leave quaternions of another length
            unit = q[frame, unit_of(piece)]
            unit /= max(float(np.linalg.norm(unit)), 1e-300) if unit.size else 1.0
        tau[frame, at_v] = B @ plant.get_net_actuation_output_port().Eval(each)
        tau[frame, at_v] -= damping[at_v] * after
        _add_contacts(plant, each, own, frame, lists)
    points: dict[str, Any] = {name: np.array(x) for name, x in lists.items()} if lists["contact_at"] else {}
    limits = "limits and constraints of joints, where they act, are missing in the balance"
    record = Record.of_arrays(
        own, t=t, q=q, v=v, a=a, tau=tau, step=h, base_velocity="world", engine=_engine(plant), notes=[limits], **points
    )  # fmt: skip
    return record if robot is None else record.on(robot)


def _before(plant: Any, work: Any, q: Array, v: Array, h: float) -> Array:
    """The positions before a step: q = before + h N(before) v, by fixed points, as N changes little."""
    before = q
    for _ in range(20):
        plant.SetPositions(work, before)
        last, before = before, q - h * plant.MapVelocityToQDot(work, v)
        if np.abs(before - last).max(initial=0.0) < 1e-15:
            break
    return before


def _add_contacts(plant: Any, context: Any, robot: DrakeRobot, frame: int, lists: dict[str, list[Any]]) -> None:
    found = plant.get_contact_results_output_port().Eval(context)
    if found.num_hydroelastic_contacts():
        raise Unsupported("the plant has hydroelastic contact, whose pressure is spread; expected point contact (kPoint).")
    inspector = plant.get_geometry_query_input_port().Eval(context).inspector() if found.num_point_pair_contacts() else None
    for k in range(found.num_point_pair_contacts()):
        info = found.point_pair_contact_info(k)
        pair = info.point_pair()
        mu = [_friction(inspector, pair.id_A), _friction(inspector, pair.id_B)]
        lists["contact_at"].append(frame)
        lists["contact_bodies"].append([robot.names[int(body)] for body in (info.bodyB_index(), info.bodyA_index())])
        lists["points"].append(info.contact_point())
        lists["normals"].append(-np.array(pair.nhat_BA_W))  # Drake's is from B to A
        lists["friction"].append(2.0 * mu[0] * mu[1] / (mu[0] + mu[1]) if sum(mu) > 0.0 else 0.0)
        lists["forces"].append(info.contact_force())  # on B
        lists["gaps"].append(-pair.depth)


def _friction(inspector: Any, geometry: Any) -> float:
    """Dynamic friction, the only one that discrete plants use."""
    given = inspector.GetProximityProperties(geometry)
    return float(given.GetProperty("material", "coulomb_friction").dynamic_friction())


def _pose(X: Any) -> pin.SE3:
    return pin.SE3(X.rotation().matrix(), X.translation())


def _index(plant: Any, index: int) -> Any:
    return type(plant.world_body().index())(index)


def _engine(plant: Any) -> str:
    kind = str(plant.get_discrete_contact_approximation()).rpartition(".k")[2]
    return f"Drake, {kind}"
