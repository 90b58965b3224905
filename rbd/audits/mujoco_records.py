"""Records of MuJoCo: its contacts, forces and accelerations in its states, as it computes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import as_finite, lazy
from rbd.audits.record import Record
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.meshes import mjcf_geometry
from rbd.model.mjcf import Mjcf, build, of_compiled
from rbd.modules import of_extra

_FREE, _BALL = 0, 1


class MujocoRobot(CheckedModel):
    """A compiled model of MuJoCo as a robot: its bodies, joints, inertias and shapes; motors at the joints of its actuators.

    Args:
        model: `mujoco.MjModel`.
        name: Its name.
    """

    def __init__(self, model: Any, name: str = "MuJoCo model") -> None:
        self.names: Mjcf = of_compiled(model, name)
        driven = {
            int(joint) for kind, joint in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True) if kind == 0
        }
        passive = [joint for j, joint in enumerate(self.names.joints) if j not in driven and model.jnt_type[j] != _FREE]
        super().__init__(build(self.names), passive=passive, name=name)

    @lazy
    def visual_model(self) -> pin.GeometryModel:
        """What MuJoCo's viewer shows."""
        return mjcf_geometry(self.model, self.names, pin.GeometryType.VISUAL)[0]

    @lazy
    def collision_model(self) -> pin.GeometryModel:
        """What can collide."""
        return mjcf_geometry(self.model, self.names, pin.GeometryType.COLLISION)[0]


def from_mujoco(model: Any, data: Any, *, control: object = None, robot: CheckedModel | None = None) -> Record:
    """The record of MuJoCo's own contact forces, in one state or along a rollout.

    In each state `mj_forward` computes qacc and the contact forces; M and h are Pinocchio's. Forces of motors, springs,
    damping, limits, equalities and dry friction are among the known ones. The law is judged at v + h qacc, as its Euler step
    has it.

    Args:
        model: `mujoco.MjModel`.
        data: `mujoco.MjData`; several of them; or states, shape (n, nstate), as `mujoco.rollout` returns them
            (mjSTATE_FULLPHYSICS), or with all inputs and the start of the solver (mjSTATE_INTEGRATION).
        control: Of states: the controls, shape (n, nu), or one for all.
        robot: The same robot, with joints of the same names; None: what MuJoCo's model says.

    Raises:
        InputError: MuJoCo is not installed, states of another size, a robot without the model's joints.

    Example:
        >>> import mujoco
        >>> xml = '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .1"><freejoint/>'
        >>> xml += '<geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>'
        >>> model = mujoco.MjModel.from_xml_string(xml)
        >>> data = mujoco.MjData(model)
        >>> mujoco.mj_step(model, data, nstep=500)
        >>> report = rbd.audit(rbd.audits.from_mujoco(model, data))
        >>> report.of_cause("balance").any(), report.obeys
        (np.False_, 'both')
    """
    mujoco = of_extra("mujoco", "mujoco")
    if not isinstance(model, mujoco.MjModel):
        raise InputError(f"model is {model!r:.80}; expected a mujoco.MjModel.")
    own = MujocoRobot(model)
    frames = list(_frames(mujoco, model, _states(mujoco, model, data, control), own.names))
    arrays: dict[str, Any] = {name: np.array([frame[name] for frame in frames]) for name in ("t", "q", "v", "a", "tau")}
    counts = [len(frame["points"]) for frame in frames]
    points = {name: np.concatenate([frame[name] for frame in frames]) for name in _POINTS}
    pushes = {name: np.concatenate([frame[name] for frame in frames]) for name in _PUSHES}
    notes = ["moments of contacts with condim 4 or 6 are among the known forces"] if (points.pop("condim") > 3).any() else []
    if model.ntendon and np.asarray(model.tendon_armature).any():
        notes.append("inertia of tendons is not in M")
    record = Record.of_arrays(
        own, **arrays, **points, **pushes, contact_at=np.repeat(np.arange(len(frames)), counts),
        push_at=np.repeat(np.arange(len(frames)), [len(frame["push_points"]) for frame in frames]),
        step=float(model.opt.timestep), quaternion="wxyz", base_velocity="mixed",
        engine=f"MuJoCo {mujoco.__version__}", notes=notes,
    )  # fmt: skip
    return record if robot is None else record.on(robot)


_POINTS = ("contact_bodies", "points", "axes", "friction", "forces", "gaps", "condim")
_PUSHES = ("push_bodies", "push_points", "push_forces", "push_moments")


def _states(mujoco: Any, model: Any, data: Any, control: object) -> Iterator[Any]:
    """MuJoCo's data in each state, one after the other, the same object each time."""
    if isinstance(data, mujoco.MjData) or isinstance(data, Sequence) and data and isinstance(data[0], mujoco.MjData):
        every = [data] if isinstance(data, mujoco.MjData) else data
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        states = np.empty((len(every), mujoco.mj_stateSize(model, spec)))
        for row, each in zip(states, every, strict=True):
            mujoco.mj_getState(model, each, row, spec)
    else:
        states = as_finite("data", np.squeeze(np.asarray(data, float)) if np.ndim(data) == 3 else data, ("n", "nstate"))
        kinds = [getattr(mujoco.mjtState, f"mjSTATE_{name}") for name in ("FULLPHYSICS", "INTEGRATION")]
        sizes = {mujoco.mj_stateSize(model, kind): kind for kind in reversed(kinds)}
        if states.shape[1] not in sizes:
            raise InputError(
                f"data has states of {states.shape[1]} numbers; expected {' or '.join(map(str, sorted(sizes)))} here: "
                "mjSTATE_FULLPHYSICS, as mujoco.rollout returns them, or mjSTATE_INTEGRATION."
            )
        spec = sizes[states.shape[1]]
    inputs = None
    if control is not None:
        given = as_finite("control", control, (len(states), model.nu), (model.nu,))
        inputs = np.broadcast_to(given, (len(states), model.nu))
    work = mujoco.MjData(model)
    for i, state in enumerate(states):
        mujoco.mj_setState(model, work, state, spec)
        if inputs is not None:
            work.ctrl[:] = inputs[i]
        mujoco.mj_forward(model, work)
        yield work


def _frames(mujoco: Any, model: Any, states: Iterator[Any], names: Mjcf) -> Iterator[dict[str, Any]]:
    jacobian, wrench = np.zeros((3, model.nv)), np.zeros(6)
    for d in states:
        known = d.qfrc_passive + d.qfrc_actuator + d.qfrc_applied + d.qfrc_constraint
        active = [i for i in range(d.ncon) if d.contact.efc_address[i] >= 0]
        bodies = [[int(model.geom_bodyid[max(g, 0)]) for g in d.contact.geom[i][::-1]] for i in active]
        forces = np.zeros((len(active), 3))
        for j, i in enumerate(active):
            mujoco.mj_contactForce(model, d, i, wrench)
            forces[j] = wrench[:3]
            f = d.contact.frame[i].reshape(3, 3).T @ forces[j]
            for body, sign in zip(bodies[j], (1.0, -1.0), strict=True):
                mujoco.mj_jac(model, d, jacobian, None, d.contact.pos[i], body)
                known -= sign * (jacobian.T @ f)
        pushed = [b for b in range(1, model.nbody) if d.xfrc_applied[b].any()]
        sliding = [d.contact.dim[i] > 1 for i in active]
        yield {
            "t": d.time, "q": d.qpos.copy(), "v": d.qvel.copy(), "a": d.qacc.copy(), "tau": known,
            "contact_bodies": np.array([[names.bodies[b] for b in pair] for pair in bodies], str).reshape(-1, 2),
            "points": d.contact.pos[active].reshape(-1, 3), "axes": d.contact.frame[active].reshape(-1, 3, 3), "forces": forces,
            "friction": np.where(sliding, d.contact.friction[active].reshape(-1, 5)[:, 0], 0.0), "gaps": d.contact.dist[active],
            "condim": d.contact.dim[active], "push_bodies": np.array([names.bodies[b] for b in pushed], str),
            "push_points": d.xipos[pushed].reshape(-1, 3), "push_forces": d.xfrc_applied[pushed, :3].reshape(-1, 3),
            "push_moments": d.xfrc_applied[pushed, 3:].reshape(-1, 3),
        }  # fmt: skip
