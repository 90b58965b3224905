"""The same robot in MuJoCo: a second implementation of the terms of motion, in Pinocchio's conventions.

MuJoCo reads the URDF file with its own parser, keeps welded links as bodies of their own, holds inertias about
principal axes and sums the motion about the centre of mass of the whole tree: it shares no line with Pinocchio. What
agrees here is therefore neither a bug of one library nor of our use of it.

With a floating base MuJoCo counts other velocities than Pinocchio. Let R turn body axes into world axes:

    v_mj = T v        T = diag(R, 1, P)              base: linear velocity in world axes, not in the body's
    a_mj = T a + k    k = (dT/dt) v = (R (omega x v_linear), 0, 0)
    power is the same:             f = T^T f_mj
    M a + h = f       therefore    M = T^T M_mj T,         h = T^T (h_mj + M_mj k)
    J a + bias        therefore    J = J_mj T,             bias = (dJ_mj/dt) v_mj + J_mj k

P orders the joints: MuJoCo keeps the order of the file, Pinocchio sorts siblings by name; both are matched by name.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]

TENSOR_AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
TRIANGLE_MARGIN = 1e-6  # relative; MuJoCo compares rounded eigenvalues, so stand clear of equality


class Loaded(Protocol):
    """What the bridge asks of a robot: the Pinocchio model, the file it came from, and how its root moves."""

    @property
    def model(self) -> pin.Model: ...  # noqa: D102

    @property
    def urdf(self) -> Path: ...  # noqa: D102

    @property
    def root(self) -> str: ...  # noqa: D102


def physical_urdf(urdf: Path, folder: Path) -> tuple[Path, list[str]]:
    """A copy of the URDF that MuJoCo accepts, and the names of the links whose inertia had to be changed.

    The principal inertias a <= b <= c [kg m2] of a body satisfy a > 0 and a + b >= c. Where a link breaks this, the
    same amount is added to all three, which keeps the principal axes: the least such amount, and a margin. Shapes are
    left out: nothing here touches anything, and MuJoCo wants mesh files that it can find and read.
    """
    root = _without_shapes(urdf)
    changed = []
    for link in root.iter("link"):
        tensor = link.find("inertial/inertia")
        if tensor is not None and _made_physical(tensor):
            changed.append(link.attrib["name"])
    copy = folder / urdf.name
    ElementTree.ElementTree(root).write(copy)
    return copy, changed


def _made_physical(tensor: ElementTree.Element) -> bool:
    """Whether the inertia had to be changed, which is done in place."""
    xx, xy, xz, yy, yz, zz = (float(tensor.get(axis, "0")) for axis in TENSOR_AXES)
    a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    lacking = max(c - a - b, -a)
    if a > 0.0 and lacking <= 0.0:
        return False
    added = lacking + TRIANGLE_MARGIN * max(abs(a), abs(c), lacking)
    if added == 0.0:
        return False  # no inertia at all: a link that only carries a frame
    for axis, value in (("ixx", xx), ("iyy", yy), ("izz", zz)):
        tensor.set(axis, repr(float(value + added)))
    return True


class MujocoTwin:
    """A robot in MuJoCo, asked and answering in Pinocchio's coordinates.

    Damping and dry friction of the file are zero here, since they are in no term of Pinocchio's equation of motion;
    rotor inertias and gravity are Pinocchio's. Joints of one freedom and a free root only.

    Args:
        robot: Loaded from a URDF file whose inertias MuJoCo accepts, see `physical_urdf`.
        add: Adds what the file has not, e.g. shapes that touch, before MuJoCo compiles the model.

    Raises:
        ValueError: if a joint of one model is not in the other, or has other freedoms there.
    """

    def __init__(self, robot: Loaded, add: Callable[[mujoco.MjSpec], None] = lambda spec: None) -> None:
        """Compile the MuJoCo model and match its joints with Pinocchio's by name."""
        self.robot = robot
        root_link = next(frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY)
        self.model = _compiled(robot.urdf, add, floating=root_link if robot.root == "free_flyer" else "")
        self.model.opt.gravity = robot.model.gravity.linear
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        self.joints = _joint_pairs(robot.model, self.model)
        for theirs, ours in self.joints:
            first, columns = self.model.jnt_dofadr[theirs], _columns(robot.model, ours)
            self.model.dof_armature[first : first + _size(columns)] = robot.model.armature[columns]

    def at(self, q: Array, v: Array) -> "TwinState":
        """The robot at Pinocchio's q (nq,) and v (nv,)."""
        data = mujoco.MjData(self.model)
        for theirs, ours in self.joints:
            _put_position(data.qpos[self.model.jnt_qposadr[theirs] :], self._position(ours, q))
        mujoco.mj_fwdPosition(self.model, data)
        T, k = self.velocity_map(data, v)
        self.set_velocity(data, T @ v)
        return TwinState(self, data, np.array(v, float), T, k)

    def _position(self, joint: int, q: Array) -> Array:
        """The entries of Pinocchio's q that belong to a joint."""
        first = self.robot.model.idx_qs[joint]
        return q[first : first + self.robot.model.nqs[joint]]

    def set_velocity(self, data: mujoco.MjData, v_mj: Array) -> None:
        """Give the data MuJoCo's velocities (nv,), and the motion that follows from them."""
        data.qvel[:] = v_mj
        mujoco.mj_comVel(self.model, data)

    def velocity_map(self, data: mujoco.MjData, v: Array) -> tuple[Array, Array]:
        """T (nv, nv) of v_mj = T v, and k = (dT/dt) v (nv,)."""
        T, k = np.zeros((self.model.nv, v.size)), np.zeros(v.size)
        for theirs, ours in self.joints:
            columns, first = _columns(self.robot.model, ours), self.model.jnt_dofadr[theirs]
            T[first : first + _size(columns), columns] = np.eye(_size(columns))
            if _size(columns) == 6:
                R_WB = data.xmat[self.model.jnt_bodyid[theirs]].reshape(3, 3)
                linear, omega = np.split(v[columns], 2)
                T[first : first + 3, columns.start : columns.start + 3] = R_WB
                k[first : first + 3] = R_WB @ np.cross(omega, linear)
        return T, k


@dataclass(frozen=True, eq=False)
class TwinState:
    """MuJoCo's terms of motion at one q and v, in Pinocchio's coordinates and order; frames in world axes.

    Attributes:
        twin: Whose state it is.
        data: MuJoCo's data, kinematics and inertias computed.
        v: Pinocchio's velocities (nv,).
        T: v_mj = T v (nv, nv).
        k: (dT/dt) v (nv,), so that a_mj = T a + k.
    """

    twin: MujocoTwin
    data: mujoco.MjData
    v: Array
    T: Array
    k: Array

    @cached_property
    def M_mj(self) -> Array:
        """MuJoCo's mass matrix (nv, nv), rotor inertias included."""
        columns = np.eye(self.v.size)
        for column, unit in zip(columns, np.eye(self.v.size), strict=True):
            mujoco.mj_mulM(self.twin.model, self.data, column, unit)
        return columns.T

    @cached_property
    def h_mj(self) -> Array:
        """MuJoCo's bias force (nv,)."""
        return self._bias_force(self.v)

    @cached_property
    def gravity_mj(self) -> Array:
        """MuJoCo's bias force at rest (nv,)."""
        return self._bias_force(np.zeros(self.v.size))

    @property
    def M(self) -> Array:
        """Mass matrix (nv, nv)."""
        return self.T.T @ self.M_mj @ self.T

    @property
    def h(self) -> Array:
        """Bias force C(q, v) v + g(q) (nv,) of M a + h = f."""
        return self.T.T @ (self.h_mj + self.M_mj @ self.k)

    @property
    def gravity(self) -> Array:
        """The force g(q) (nv,) that holds the robot at rest, opposite to what its weight does."""
        return self.T.T @ self.gravity_mj

    def coriolis_tensor(self) -> Array:
        """C (nv, nv, nv), symmetric in its last two indices, with C(q, v) v = sum_jk C[:, j, k] v_j v_k.

        The force is quadratic in v, so its values at e_j and e_j + e_k determine it: with c(v) the bias force less
        gravity, 2 C[:, j, k] = c(e_j + e_k) - c(e_j) - c(e_k).
        """
        unit, size = np.eye(self.v.size), self.v.size
        single = np.array([self._coriolis(e) for e in unit])
        C = np.empty((size, size, size))
        for j in range(size):
            C[:, j, j] = single[j]
            for k in range(j):
                C[:, j, k] = C[:, k, j] = (self._coriolis(unit[j] + unit[k]) - single[j] - single[k]) / 2.0
        return C

    def _coriolis(self, v: Array) -> Array:
        """C(q, v) v (nv,) at another velocity."""
        _, k = self.twin.velocity_map(self.data, v)
        return self.T.T @ (self._bias_force(v) - self.gravity_mj + self.M_mj @ k)

    def _bias_force(self, v: Array) -> Array:
        """MuJoCo's bias force (nv,) at Pinocchio's v; leaves the data at this state's own velocity."""
        force = np.empty(v.size)
        self.twin.set_velocity(self.data, self.T @ v)
        mujoco.mj_rne(self.twin.model, self.data, 0, force)
        self.twin.set_velocity(self.data, self.T @ self.v)
        return force

    def links(self) -> list[str]:
        """Names of all links; of a fixed root only what MuJoCo has not made its world."""
        return [name for i in range(1, self.twin.model.nbody) if (name := self.twin.model.body(i).name)]

    def frame(self, link: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> "TwinFrame":
        """A point fixed to a link, at an offset (3,) [m] from its origin in the link's axes."""
        model, body = self.twin.model, self.twin.model.body(link).id
        p_WP = self.data.xpos[body] + self.data.xmat[body].reshape(3, 3) @ np.asarray(offset, float)
        J_mj, dJ_mj = np.zeros((6, self.v.size)), np.zeros((6, self.v.size))
        mujoco.mj_jac(model, self.data, J_mj[:3], J_mj[3:], p_WP, body)
        mujoco.mj_jacDot(model, self.data, dJ_mj[:3], dJ_mj[3:], p_WP, body)
        return TwinFrame(p_WP, J_mj @ self.T, dJ_mj @ self.data.qvel + J_mj @ self.k)

    def acceleration(self, force: Array, held: Sequence["TwinFrame"] = ()) -> Array:
        """The acceleration (nv,) under a generalised force (nv,) while frames are held: Gauss's principle.

        Each held frame adds the six rows J a + bias = 0. Solved by one dense factorisation:

            [M  J^T] [ a]   [force - h]
            [J   0 ] [-f] = [  -bias  ]
        """
        J = np.vstack([np.zeros((0, self.v.size)), *(frame.J for frame in held)])
        bias = np.concatenate([np.zeros(0), *(frame.bias for frame in held)])
        K = np.block([[self.M, J.T], [J, np.zeros((bias.size, bias.size))]])
        return np.linalg.solve(K, np.concatenate([force - self.h, -bias]))[: self.v.size]


@dataclass(frozen=True, eq=False)
class TwinFrame:
    """Motion of a point fixed to a link, in world axes, linear first.

    Attributes:
        p_WP: Where the point is (3,) [m].
        J: Its velocity is J v (6, nv).
        bias: Its classical acceleration is J a + bias (6,).
    """

    p_WP: Array
    J: Array
    bias: Array


def _compiled(urdf: Path, add: Callable[[mujoco.MjSpec], None], *, floating: str) -> mujoco.MjModel:
    """The file as MuJoCo reads it, changed nowhere: no welded link fused, no inertia balanced or bounded.

    MuJoCo welds the root to the world. `floating` names the link to set free, nothing where the weld is meant. `add` adds what
    the file has not.
    """
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(_without_shapes(urdf), encoding="unicode"))
    spec.compiler.fusestatic = False
    spec.compiler.balanceinertia = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.compiler.alignfree = False
    if floating:
        base = {body.name: body for body in spec.worldbody.bodies}.get(floating)
        if base is None:  # a link called "world" is MuJoCo's world, and what it carries would float in its place
            raise ValueError(f"MuJoCo cannot free the root {floating!r} of {urdf.name}")
        base.add_freejoint()
    add(spec)
    return spec.compile()


def _without_shapes(urdf: Path) -> ElementTree.Element:
    """A URDF file less its visual and collision shapes."""
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                link.remove(shape)
    return root


def _joint_pairs(pin_model: pin.Model, model: mujoco.MjModel) -> list[tuple[int, int]]:
    """(MuJoCo's, Pinocchio's) index of every joint, matched by name; a free root by being the first."""
    theirs = {model.joint(i).name: i for i in range(model.njnt)}
    ours = {name: i for i, name in enumerate(pin_model.names) if i > 0}
    if model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        theirs = {pin_model.names[1]: 0} | {name: i for name, i in theirs.items() if i > 0}
    if theirs.keys() != ours.keys() or model.nv != pin_model.nv:
        alone = sorted(theirs.keys() ^ ours.keys())
        raise ValueError(f"joints in one model only: {alone}; freedoms: {model.nv} and {pin_model.nv}")
    return [(theirs[name], ours[name]) for name in ours]


def _columns(pin_model: pin.Model, joint: int) -> slice:
    """The entries of Pinocchio's v that belong to a joint."""
    return slice(pin_model.idx_vs[joint], pin_model.idx_vs[joint] + pin_model.nvs[joint])


def _size(columns: slice) -> int:
    return columns.stop - columns.start


def _put_position(qpos: Array, q: Array) -> None:
    """Write Pinocchio's q of one joint where MuJoCo's begins."""
    if q.size == 7:
        qpos[:7] = [*q[:3], q[6], *q[3:6]]  # x, y, z, w -> w, x, y, z
    else:
        qpos[0] = q[0] if q.size == 1 else np.arctan2(q[1], q[0])  # an endless joint: cosine, sine
