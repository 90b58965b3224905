"""The checked `pin.Model`: names, motors, limits, and a pool of `pin.Data`.

Pinocchio crashes on unknown frame and joint ids, and computes on with NaN or with quaternions off the unit sphere; nothing
reaches it here unchecked.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Self, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_finite, blas, check_finite, check_flag, lazy, locked, max_abs
from rbd.displayed import Displayed
from rbd.errors import FrameNotFound, InputError, ModelError, nearest
from rbd.errors.inputs import check_kind, listed_items
from rbd.installation import check_whole
from rbd.model.data_pool import DataPool
from rbd.model.joint_table import Joints
from rbd.model.joints import FORCE_OF, ROUNDED, UNIT_TOLERANCE, Coordinate, normalise
from rbd.model.motors import Motor, Motors, TorqueLines, checked_motors, motors_of_plain, put_motors, torque_use
from rbd.model.pickling import Parcel, Recipe, arrived, packed, put_numbers, unpacked
from rbd.model.world import Plane, base_turn, checked_gravity, plane_of_base
from rbd.records import AXES, Axis

Model = TypeVar("Model", bound="CheckedModel")


check_whole()  # the version of the installed Pinocchio

FARTHEST = 1e5
"""Largest entry of q and of v: at 100 km from the origin M is right to 3e-11 of its largest entry, beyond it gets worse."""
_TOGETHER = 200
"""Joints of the copies of a robot that are moved in one call: an addition to a larger model takes longer."""


class CheckedModel(Displayed):
    """A pin.Model whose names, sizes and numbers are checked before Pinocchio sees them.

    Args:
        model: The Pinocchio model; it is not to be changed afterwards.
        passive: Names of joints without a motor. A floating base never has one.
        name: Name for messages; the model's own by default.

    Attributes:
        name: The robot's name.
        model: The pin.Model.
        joints: Joint table: indices in q and v, units and limits, by name: `robot.joints["knee"].v`.
        actuation: S of the equations of motion, shape (nu, nv): S v are the motor rates, S^T tau the joint torques.
        actuated: Indices in v of the actuated coordinates, shape (nu,).
        motors: The same as a slice where they follow each other, which is faster.
        idle: Those of `unactuated`, likewise.
        unactuated: The other indices in v, of bases and passive joints, ascending.
        actuated_names: Their joints' names, in the order of tau.
        effort_limit: Largest `|tau|` at rest, of the robot's file or of `with_motors`, shape (nu,) [N, N m]; inf where none is
            stated. See `torque_limits` for a moving robot.
        motor_data: {joint: `rbd.Motor`, or None for no motor}, as `with_motors` was given.
        bases: Indices of the free-flyers at the roots of all bodies, one a robot; empty if any body is fixed to the world.
        floating: Whether all bodies hang from one free-flyer joint.
        sound: False where the doctor found errors and the robot was loaded all the same: its M is then checked each time.
        zero_v: A velocity of zero, shape (nv,), read-only.
        kept: Prepared forms of sets of contacts, see `rbd.answers.prepared`.
        kept_bodies: Those of the bodies in contact, also of `rbd.simulation`.
    """

    motor_data: Motors = MappingProxyType({})
    _parcel: Parcel | None = None

    def __init__(self, model: pin.Model, *, passive: Iterable[str] = (), name: str | None = None) -> None:
        self.model = model
        self.name = name or model.name
        _check_order(model)
        self.nq: int = model.nq
        self.nv: int = model.nv
        self.joints = Joints(model, self.name)
        self._frames = _frame_ids(model)
        self._links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        self._sites: dict[str, tuple[int, pin.SE3]] = {}
        listed = listed_items("passive", passive, "a list of joints' names", alone=True)
        self.passive = frozenset(self.joints[n].name for n in listed)
        roots = tuple(i for i in range(1, model.njoints) if model.parents[i] == 0)
        floating = {joint.id for joint in self.joints.values() if joint.kind == "FreeFlyer"}
        self.bases = roots if all(i in floating for i in roots) else ()
        self.floating = self.bases == (1,)
        self._place_motors()
        pieces = [p for p in self.joints.pieces if p.unit.start < p.unit.stop]
        self._unit_blocks = [(p.q + p.unit.start, p.q + p.unit.stop) for p in pieces]
        circles = [begin for begin, end in self._unit_blocks if end - begin == 2]
        #: Circles to normalise together, and the blocks that then remain; of a few circles that would be slower.
        self._circles = np.array([circles, circles]) + [[0], [1]] if len(circles) >= 4 else None
        self._spheres = [(begin, end) for begin, end in self._unit_blocks if end - begin != 2]
        self.zero_v = locked(np.zeros(self.nv))
        self.sound = True
        self._as_made = model.copy()
        self.pool = DataPool(model)
        self.kept: dict[object, Any] = {}
        self.kept_bodies: dict[object, Any] = {}

    @property
    def mass(self) -> float:
        """Total mass of the moving bodies [kg]."""
        return float(pin.computeTotalMass(self.model))  # not cached: the equations of motion, too, read the present model

    @lazy
    def base_turn(self) -> pin.SE3 | None:
        """X_JB from the axes of a planar base's joint to those of its link; None where they are the same."""
        return base_turn(self.model)

    @lazy
    def least_inertia(self) -> Array:
        """Of min(1, M_ii), shape (nv,): a quarter of the least of a few random postures. A scale of residuals, no bound."""
        data, rng = self.model.createData(), np.random.default_rng(0)
        q, least = pin.neutral(self.model), np.ones(self.nv)
        for _ in range(8):
            pin.crba(self.model, data, q, pin.Convention.WORLD)
            least = np.minimum(least, 0.25 * data.M.diagonal())
            q = pin.integrate(self.model, q, rng.uniform(-2.0, 2.0, self.nv))
        return least

    def moved(self, q: Array, steps: Array) -> Array:
        """Configurations q (+) step, for steps (k, nv), shape (k, nq): bit by bit those of `pin.integrate`, in a few calls."""
        many, copies = self._copies
        blocks = -(-len(steps) // copies)
        padded = np.zeros((blocks, copies * self.nv))
        padded.reshape(-1, self.nv)[: len(steps)] = steps
        start = np.empty((copies, self.nq))
        start[:] = q
        out = np.concatenate([pin.integrate(many, start.ravel(), block) for block in padded])
        return out.reshape(-1, self.nq)[: len(steps)]

    @lazy
    def _copies(self) -> tuple[pin.Model, int]:
        """(one model with the joints of several such robots, their number)."""
        out, own = pin.Model(), range(1, self.model.njoints)
        copies = max(1, _TOGETHER // self.model.njoints)
        for k in range(copies):
            for joint in own:
                out.addJoint(0, self.model.joints[joint], pin.SE3.Identity(), f"{k} {joint}")
        return out, copies

    @property
    def plane(self) -> Plane | None:
        """The plane of W in which its base slides, "xy", "xz" or "yz"; None where the base is no planar joint."""
        return plane_of_base(self.model)

    @property
    def gravity(self) -> Array:
        """In W, shape (3,) [m/s2]."""
        return np.array(self.model.gravity.linear)

    def with_gravity(self, gravity: Sequence[float] | Array) -> Self:
        """The same robot in a world with another gravity; this one is not changed.

        Planes and normals of contacts stay where they are: under a gravity that leans, level ground is an incline. Weight,
        balance, `potential_energy`, `standing` of robots on two points, support regions and simulations follow.

        Args:
            gravity: In W, shape (3,) [m/s2]; zero too.

        Raises:
            InputError: not three finite numbers, or more than 1e4 m/s2.

        Example:
            >>> solo = rbd.load_robot("solo12").with_gravity((0.0, 0.0, -1.62))  # on the Moon
            >>> print(f"{rbd.hold(solo.standing(), solo.feet()).forces['front_left'][2]:.3f} N")
            1.013 N
        """
        given = checked_gravity(gravity)
        out = copy.deepcopy(self)
        out.model.gravity.linear = given
        return out

    @property
    def force_unit(self) -> float:
        """The body weight [N], which scales forces; 1 without gravity or mass."""
        return self.mass * math.hypot(*self.model.gravity.linear.tolist()) or 1.0

    @property
    def weight(self) -> Array:
        """Wrench of gravity about the centre of mass, in W, shape (6,) [N, N m]."""
        wrench = np.zeros(6)  # used by each answer: two microseconds less than joined arrays
        wrench[:3] = self.mass * self.model.gravity.linear
        return wrench

    @property
    def digest(self) -> str:
        """A digest of the robot in hexadecimal digits: equal for robots with equal numbers, names, feet and postures."""
        return self._sent().key

    def __reduce__(self) -> tuple[object, ...]:
        """A recipe of a few hundred bytes for robots of the catalogue, a few kilobytes for others."""
        sent = self._sent()
        return arrived, (sent.key, sent.recipe, sent.changed, sent.extras, self._files())

    def __copy__(self) -> Self:
        out = self._with_model(self.model, None)
        out._as_made = self._as_made
        out._take_extras(self._extras())
        return out

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        out = self._with_model(self._as_made.copy(), memo)
        memo[id(self)] = out
        out._take_extras(self._extras())
        if not self._is_as_made():
            put_numbers(out.model, packed(self.model))
        return out

    def _sent(self) -> Parcel:
        """The parcel, made anew if the robot changed since the last one."""
        last, now, same = self._parcel, self._extras(), self._is_as_made()
        if last is None or last.extras != now or (last.changed is None) != same or not (same or last.model == self.model):
            changed = None if same else packed(self.model)
            recipe = self._recipe()
            key = hashlib.sha256(f"{self._content()}{now!r}".encode())
            key.update(self.model.saveToString().encode())
            self._parcel = last = Parcel(key.hexdigest()[:32], recipe, self.model.copy(), changed, now)
        return last

    def _is_as_made(self) -> bool:
        """Whether the model has the numbers that it had when the robot was made."""
        return bool(self.model == self._as_made)

    def _recipe(self) -> Recipe:
        """For the robot as it was made: of the model's numbers."""
        return partial(_remade, packed(self._as_made), pin.__version__, sorted(self.passive), self.name)

    def _content(self) -> str:
        """What the digest covers besides the model's numbers."""
        return repr((self.name, sorted(self.passive)))

    def _with_model(self, model: pin.Model, memo: dict[int, object] | None) -> Any:
        """The same robot with another model, without extras; its parts copied with the memo of a deep copy, or shared."""
        return CheckedModel(model, passive=self.passive, name=self.name)

    def _extras(self) -> tuple[Any, ...]:
        """What is put on again after the robot is made: whether its inertia is sound, what the user changed; comparable."""
        return self.sound, *self.motor_data.items()

    def _take_extras(self, extras: tuple[Any, ...]) -> None:
        """Have what the user changed on the other side."""
        self.sound, *motors = extras
        self._take_motors(dict(motors))

    def _files(self) -> dict[str, bytes] | None:
        """Files that travel with the robot; None if there are none."""
        return None

    def _take_files(self, files: dict[str, bytes]) -> None:
        """Keep files that came with the robot."""

    def is_like(self, other: CheckedModel) -> bool:
        """Whether another robot is this one, or has the same model and motors, as one from another process has.

        Raises:
            InputError: if `other` is no robot.
        """
        check_kind("other", other, CheckedModel, "a robot: rbd.load_robot(...)")
        same = other.passive == self.passive and other.motor_data == self.motor_data
        return other is self or bool(same and other.model == self.model)

    def frames(self) -> list[str]:
        """Names of all frames: links, joints and fixed marks."""
        return list(self._frames)

    def links(self) -> list[str]:
        """Names of the links, in the order of the model's frames."""
        return list(self._links)

    def loops(self) -> tuple[Any, ...]:
        """Constraints that close its tree; none of a bare model, see `rbd.Robot.loops`."""
        return ()

    def wheels(self) -> tuple[Any, ...]:
        """Wheels on the ground; none of a bare model, see `rbd.Robot.wheels`."""
        return ()

    def drives(self) -> tuple[Any, ...]:
        """Driven joints; none of a bare model, see `rbd.Robot.drives`."""
        return ()

    @property
    def motor_coordinates(self) -> tuple[Coordinate, ...]:
        """A name and a unit for each entry of tau; `rbd.model.joints.FORCE_OF[unit]` is the force's."""
        return tuple(self.joints.velocities[i] for i in self.actuated)

    @lazy
    def coordinate_axes(self) -> dict[str, Axis]:
        """{"position", "velocity", "motor": names and units of the entries of q, of v (per second), of tau}, and `AXES`."""
        q, v, tau = self.joints.positions, self.joints.velocities, self.motor_coordinates
        return AXES | {
            "position": Axis(tuple(c.name for c in q), tuple(c.unit for c in q)),
            "velocity": Axis(tuple(c.name for c in v), tuple(c.unit for c in v)),
            "motor": Axis(tuple(c.name for c in tau), tuple(FORCE_OF[c.unit] for c in tau)),
        }

    @property
    def unit_coordinates(self) -> dict[str, tuple[str, Array]]:
        """{"position_unit", "velocity_unit", "motor_unit": (dimension, unit of each entry)}, as xarray takes coordinates."""
        units = {dim: axis.units for dim, axis in self.coordinate_axes.items() if dim not in AXES}
        units["velocity"] = tuple(f"{unit}/s" for unit in units["velocity"])
        return {f"{dim}_unit": (dim, np.array(own, str)) for dim, own in units.items()}

    def frame(self, name: str) -> pin.Frame:
        """The Pinocchio frame of this name; a link takes precedence over a joint of the same name.

        Raises:
            FrameNotFound: with the nearest names.
        """
        return self.model.frames[self.frame_id(name)]

    def frame_id(self, name: str) -> int:
        """Index of the frame in the model.

        Raises:
            FrameNotFound: with the nearest names.
        """
        try:
            return self._frames[name]
        except (KeyError, TypeError):
            raise FrameNotFound(
                f"no frame {name!r:.80} in {self.name}; {nearest(name, self._frames)}. See robot.frames()."
            ) from None

    def site(self, frame: str) -> tuple[int, pin.SE3]:
        """(joint, X_JF): the joint whose body carries the frame, and where on it; looked up once a name.

        Raises:
            FrameNotFound: with the nearest names.
        """
        found = self._sites.get(frame) if isinstance(frame, str) else None
        if found is None:
            f = self.frame(frame)
            found = self._sites[frame] = (int(f.parentJoint), pin.SE3(f.placement))
        return found

    def joint_id(self, name: str) -> int:
        """Index of the joint in the model.

        Raises:
            JointNotFound: with the nearest names.
        """
        return self.joints[name].id

    def check_q(self, q: Array) -> Array:
        """A configuration, copied, its unit quaternions (and unit circles) normalised; refused if far from unit.

        Raises:
            InputError: wrong size, not finite, or a quaternion off the unit sphere by more than 1e-6.
        """
        q = self._vector("q", q, self.nq, "nq", FARTHEST)
        blocks = self._unit_blocks if self._circles is None or not self._put_on_circles(q, self._circles) else self._spheres
        for begin, end in blocks:
            block = q[begin:end]
            if not abs(math.hypot(*block.tolist()) - 1.0) <= ROUNDED:
                normalise(f"q[{begin}:{end}]", block)
        return q

    def _has_state(self, q: Array, v: Array) -> bool:
        """Whether arrays of the right sizes are a checked configuration and velocity, to rounding: a quick test."""
        if not (q.dot(q) < FARTHEST * FARTHEST and v.dot(v) < FARTHEST * FARTHEST):
            return False
        for begin, end in self._unit_blocks:
            if not abs(math.hypot(*q[begin:end].tolist()) - 1.0) <= ROUNDED:
                return False
        return True

    def check_v(self, v: Array, what: str = "v") -> Array:
        """A velocity, an acceleration or a generalised force, copied, shape (nv,).

        Raises:
            InputError: wrong size or not finite.
        """
        return self._vector(what, v, self.nv, "nv", FARTHEST if what == "v" else math.inf)

    def check_tau(self, tau: Array | Sequence[float] | None) -> Array:
        """Motor torques, copied, shape (nu,); zero for None.

        Raises:
            InputError: wrong size (the floating base and passive joints have no entry) or not finite.
        """
        if tau is None:
            return np.zeros(self.nu)
        return self._vector("tau", tau, self.nu, "nu, one entry an actuated joint")

    def _put_on_circles(self, q: Array, circles: Array) -> bool:
        """Normalise all unit circles of a configuration in place; False, and nothing done, if one is far off."""
        points = q[circles]
        norms = np.hypot(*points)
        off = np.abs(norms - 1.0)
        if not off.max() <= UNIT_TOLERANCE:
            return False
        far = off > ROUNDED
        q[circles[:, far]] = points[:, far] / norms[far]
        return True

    def _vector(self, what: str, value: Array | Sequence[float], size: int, meaning: str, most: float = math.inf) -> Array:
        out = as_array(f"{what} of {self.name}", value)
        if out.shape != (size,):
            hint = " tau has no entry for the floating base." if what == "tau" and out.shape == (self.nv,) else ""
            raise InputError(f"{what} of {self.name} has shape {out.shape}; expected ({size},): {meaning}.{hint}")
        # One pass for both: NaN fails the comparison, and a norm within `most` has entries within it.
        if size and not blas.ddot(out, out) < most * most:
            check_finite(f"{what} of {self.name}", out)
            if max_abs(out) > most:
                raise InputError(
                    f"{what} of {self.name} reaches {max_abs(out):.3g}; at most {most:g} is taken [m, rad, and per second]: "
                    "so far away, rounding eats the millimetres between links."
                )
        return out

    def _place_motors(self) -> None:
        """Make the tables of the motors: of all joints but free-flyers and passive ones."""
        driven = [joint for joint in self.joints.values() if joint.kind != "FreeFlyer" and joint.name not in self.passive]
        motors = [(joint.name, i) for joint in driven for i in range(joint.v.start, joint.v.stop)]
        self.actuated = self.joints.actuated = np.array([i for _, i in motors], dtype=int)
        self.unactuated = np.delete(np.arange(self.nv), self.actuated)
        self.actuated_names = tuple(n for n, _ in motors)
        self.nu = len(motors)
        self.motors, self.idle = _as_slice(self.actuated), _as_slice(self.unactuated)
        self.actuation = np.eye(self.nv)[self.actuated]
        limit = np.array(self.model.effortLimit, float)[self.actuated]
        # Zero, missing and +-DBL_MAX all mean that the file states no limit.
        self.effort_limit = np.where((limit <= 0.0) | (limit > 1e100) | ~np.isfinite(limit), np.inf, limit)
        given = [self.motor_data.get(name) for name in self.actuated_names]
        for i, motor in enumerate(given):
            if motor is not None and motor.standstill is not None:
                self.effort_limit[i] = motor.standstill
        speeds = [np.inf if motor is None or motor.speed_limit is None else motor.speed_limit for motor in given]
        self._motor_speeds = np.array(speeds, float)
        self.torque_lines = TorqueLines(self.actuated, self.actuated_names, self.motor_data)

    def with_motors(self, motors: Mapping[str, Motor | None], *, others_passive: bool = False) -> Self:
        """The same robot with other motors; this one stays as it is.

        Args:
            motors: {joint: `rbd.Motor(limit=..., gear=..., ...)`}, at joints with one degree of freedom; None takes a joint's
                motor away. A passive joint that is named gets a motor. A joint's earlier `Motor` is replaced.
            others_passive: Whether joints that are not named lose their motors; by default they keep what they have.

        Returns:
            A new robot. Its `nu`, `effort_limit`, speed limits and M follow; it pickles and copies as any other.

        Raises:
            JointNotFound: an unknown joint, with the nearest names.
            InputError: what is no motor; a motor at a floating base, or at a joint with several degrees of freedom.

        Example:
            >>> solo = rbd.load_robot("solo12").with_motors({"FL_KFE": rbd.Motor(limit=1.5), "FR_KFE": None})
            >>> solo.nu, solo.effort_limit[:3], "FR_KFE" in solo.passive
            (11, array([1000. , 1000. ,    1.5]), True)
        """
        given = checked_motors(self.joints, motors, self.name)
        check_flag("others_passive", others_passive)
        rest = [name for name in self.actuated_names if name not in given] if others_passive else []
        out = copy.deepcopy(self)
        put_motors(out.model, out._as_made, out.joints, given)
        out._take_motors({**self.motor_data, **dict.fromkeys(rest), **given})
        return out

    def _take_motors(self, motors: Mapping[str, Motor | None]) -> None:
        """Have motors whose numbers are in the model already."""
        if not motors:
            return
        self.motor_data = MappingProxyType(dict(sorted(motors.items())))
        without = {name for name, motor in motors.items() if motor is None}
        self.passive = frozenset((self.passive - motors.keys()) | without)
        self._place_motors()

    def torque_limits(self, v: Array | None = None) -> tuple[Array, Array]:
        """(least, most) torques of the motors at a velocity: the effort limits, less where a torque-speed line limits driving.

        A motor drives its joint where tau and the joint's speed have one sign; in braking it has its torque at rest.

        Args:
            v: Velocity, shape (nv,), or several, (n, nv) [m/s, rad/s]; None: at rest.

        Returns:
            Two arrays (nu,), or (n, nu) [N, N m]; -inf and inf where there is no limit. Zero is between them.

        Raises:
            InputError: another shape, or numbers that are not finite.

        Example:
            >>> line = rbd.Motor(torque_speed=[(0.0, 3.0), (10.0, 0.0)])
            >>> solo = rbd.load_robot("solo12").with_motors({"FL_HAA": line})
            >>> [limit[0].item() for limit in solo.torque_limits(4.0 * np.ones(solo.nv))]
            [-3.0, 1.8]
        """
        if v is not None:
            v = as_finite(f"v of {self.name}", v, (self.nv,), ("n", self.nv))
        least, most = self.limits_at(v)
        return least, most.copy()

    def limits_at(self, v: Array | None) -> tuple[Array, Array]:
        """`torque_limits` of a checked velocity; not to be changed in place."""
        return self.torque_lines.limits(v, self.effort_limit)

    def too_fast(self, v: Array) -> Array:
        """Which motors' joints are faster than the `speed_limit` of their `Motor`, of shape (nu,) or (n, nu), truth values.

        Speed limits that only the robot's file states do not count here: those are for controllers and `rbd.check_motion`.
        """
        return np.asarray(np.abs(v[..., self.actuated]) > self._motor_speeds)

    def torque_use(self, tau: Array | None, v: Array | None = None) -> Array:
        """Torques over their limits at a velocity, of shape (nu,) or (n, nu): 1 is at the limit, 0 where there is none.

        Args:
            tau: Motor torques, shape (nu,) or (n, nu) [N, N m]; None: zero.
            v: Velocity, shape (nv,) or (n, nv) [m/s, rad/s]; None: at rest.
        """
        return torque_use(np.zeros(self.nu) if tau is None else tau, *self.limits_at(v))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, nq={self.nq}, nv={self.nv}, nu={self.nu}, mass={self.mass:.3f} kg)"


def with_plain_motors(robot: Model, plain: object) -> Model:
    """The robot with the motors of `plain_motors`; the same where there are none.

    Raises:
        InputError: what is no such data.
    """
    motors = motors_of_plain(plain)
    return robot.with_motors(motors) if motors else robot


def on_its_line(robot: CheckedModel, motor: int, tau: float, v: Array) -> str:
    """A torque beyond a torque-speed line, in words: "35 N m at 12 rad/s, where its torque-speed line leaves 20 N m".

    Empty for a motor without a line, and for one that brakes or is at rest.
    """
    speed = float(v[robot.actuated[motor]])
    if not robot.torque_lines.has(motor) or tau * speed <= 0.0:
        return ""
    joint = robot.joints[robot.actuated_names[motor]]
    unit, most = FORCE_OF[joint.unit], abs(float(robot.torque_limits(v)[tau > 0.0][motor]))
    return f"{abs(tau):.4g} {unit} at {abs(speed):.4g} {joint.unit}/s, where its torque-speed line leaves {most:.4g} {unit}"


def beyond_limit(robot: CheckedModel, motor: int, tau: float, v: Array) -> str:
    """A torque that is beyond its limit, in words."""
    limit = f"{tau:.4g}, beyond its effort limit of {robot.effort_limit[motor]:.4g} N m"
    return on_its_line(robot, motor, tau, v) or limit


def _as_slice(indices: Array) -> slice | Array:
    if len(indices) and (np.diff(indices) == 1).all():
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices


def _remade(model: bytes, version: str, passive: list[str], name: str) -> CheckedModel:
    return CheckedModel(unpacked(model, version), passive=passive, name=name)


def _check_order(model: pin.Model) -> None:
    """Refuse joints that are not depth-first: Pinocchio's M and Jacobians take subtrees for blocks, and are silently wrong."""
    for i in range(1, model.njoints):
        below = sorted(model.subtrees[i])
        if below != list(range(i, i + len(below))):
            raise ModelError(
                f"the joints of {model.name!r} are not numbered depth-first: below {model.names[i]!r} stand the numbers "
                f"{str(below)[:80]}. Add each branch of the tree in one piece, then the next."
            )


def _frame_ids(model: pin.Model) -> dict[str, int]:
    ids: dict[str, int] = {}
    for i, f in enumerate(model.frames):
        if f.name not in ids or f.type == pin.FrameType.BODY:
            ids[f.name] = i
    return ids
