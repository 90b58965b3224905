"""`Record`: a motion with contact forces as an engine reports it, checked, in Pinocchio's conventions; its file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from rbd.arrays import Array, as_array, lazy, locked
from rbd.displayed import Displayed
from rbd.errors import FrameNotFound, InputError, nearest
from rbd.errors.inputs import check_choice, check_kind, listed_items
from rbd.model.array_file import a_path, npz_arrays
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import Piece
from rbd.model.output_files import write_file
from rbd.motion.array_files import LARGEST
from rbd.robots.loading import load_robot
from rbd.simulation.trajectory_contents import recipe, robot_numbers, robot_of

WORLD = "world"
UNIT, ROUNDED = 1e-3, 1e-12
"""By how much a normal, or a quaternion, may differ from unit length; and up to which it is left as it is."""
_CONTACT = ("points", "normals", "friction", "forces", "gaps")
_PUSH = ("push_points", "push_forces", "push_moments")
KEYS = {
    "contact_at": "contact_at", "contact_body": "contact_bodies", "contact_point": "points", "contact_normal": "normals",
    "contact_friction": "friction", "contact_force": "forces", "contact_gap": "gaps", "contact_axes": "axes",
    "push_at": "push_at", "push_body": "push_bodies", "push_point": "push_points", "push_force": "push_forces",
    "push_moment": "push_moments",
}  # fmt: skip
"""{name in the file: argument of `Record.of_arrays`}."""
_TEXTS = ("robot", "text", "recipe", "engine", "quaternion", "base_velocity", "notes")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Record(Displayed):
    """A motion of n frames with its contact forces, from any engine: what `rbd.audit` judges. SI units, W: world axes.

    Its k contact points are listed one after the other, over all frames; p pushes are other forces on bodies.

    Attributes:
        robot: The robot, or several bodies in one model.
        t: Times, shape (n,) [s], increasing.
        q: Configurations, shape (n, nq), quaternions x, y, z, w.
        v: Velocities, shape (n, nv); those of a free body in its own axes, as Pinocchio has them.
        a: Accelerations, shape (n, nv): those of the frame, or (v after a step - v) over its length.
        step: Length of the step that began at each frame, shape (n,) [s]; zero where a is a true acceleration.
        tau: Known generalised forces: motors, springs, damping, limits; shape (n, nv) [N, N m].
        contact_at: Frame of each point, shape (k,), not decreasing.
        contact_bodies: The body that feels the force and the one that gives it, shape (k, 2), numbers in `bodies`. The world,
            number 0, gives.
        points: In W, shape (k, 3) [m].
        normals: From the giving body to the feeling one, in W, shape (k, 3), of unit length.
        friction: Coulomb's coefficient, shape (k,); NaN where it is not known.
        forces: On the first body, in W, shape (k, 3) [N].
        gaps: Distance of the two surfaces, negative in depth, shape (k,) [m]; NaN where it is not known.
        push_at: Frame of each push, shape (p,).
        push_bodies: Its body, shape (p,), numbers in `bodies`.
        push_points: Where it acts, in W, shape (p, 3) [m].
        push_forces: In W, shape (p, 3) [N].
        push_moments: In W, besides the force's lever arm, shape (p, 3) [N m].
        engine: Name of the engine.
        notes: What a reader left out or changed.

    Raises:
        InputError: by the name of the field: shapes that do not fit, numbers that are not finite, times that go back, frames or
            bodies that there are not, normals and quaternions that have no unit length.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> record = rbd.audits.Record.of_arrays(
        ...     box, t=[0.0], q=[[0, 0, 1, 0, 0, 0, 1]], v=np.zeros((1, 6)), a=[[0, 0, -9.81, 0, 0, 0]]
        ... )
        >>> print(record)
        box, 1 frame at 0 s, 0 contact points, from an engine without a name
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array
    step: Array
    tau: Array
    contact_at: Array
    contact_bodies: Array
    points: Array
    normals: Array
    friction: Array
    forces: Array
    gaps: Array
    push_at: Array
    push_bodies: Array
    push_points: Array
    push_forces: Array
    push_moments: Array
    engine: str = ""
    notes: tuple[str, ...] = field(default=())

    @classmethod
    def of_arrays(
        cls,
        robot: CheckedModel,
        *,
        t: object,
        q: object,
        v: object,
        a: object = None,
        v_next: object = None,
        step: float | Array | None = None,
        tau: Any = None,
        contact_at: object = (),
        contact_bodies: object = (),
        points: Any = None,
        normals: Any = None,
        axes: object = None,
        friction: Any = None,
        forces: object = None,
        gaps: Any = None,
        push_at: object = (),
        push_bodies: object = (),
        push_points: Any = None,
        push_forces: Any = None,
        push_moments: Any = None,
        quaternion: str = "xyzw",
        base_velocity: str = "body",
        engine: str = "",
        notes: tuple[str, ...] | list[str] = (),
    ) -> Record:
        """A record of an engine's arrays, in its conventions.

        Args:
            robot: The robot.
            t: Times, shape (n,) [s].
            q: Configurations, shape (n, nq), joints in the robot's order.
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv); or give `v_next` and `step`.
            v_next: Velocities after the step that began at each frame, in the axes of `v`, shape (n, nv).
            step: Its length, a number or shape (n,) [s]. With `a`: the forces are those of such a step, and the law is
                judged at v + step a.
            tau: Known generalised forces, in the axes of `v`, shape (n, nv), or of the motors, shape (n, nu); None: none.
            contact_at: Frame of each contact point, shape (k,).
            contact_bodies: Bodies, by name, shape (k,), or (k, 2) with the one that gives the force; "world" is the world.
            points: Shape (k, 3) [m].
            normals: Shape (k, 3), towards the body that feels the force.
            axes: In place of normals: the axes in which the forces are given, as rows, the normal first, shape (k, 3, 3).
            friction: One coefficient, or shape (k,).
            forces: On the first body, shape (k, 3) [N]; in W, or in `axes`.
            gaps: Shape (k,) [m].
            push_at: Frame of each push, shape (p,).
            push_bodies: Bodies, by name, shape (p,).
            push_points: Shape (p, 3) [m].
            push_forces: Shape (p, 3) [N].
            push_moments: Shape (p, 3) [N m]; None: none.
            quaternion: "xyzw" or "wxyz": order of the quaternions in q.
            base_velocity: "body": velocities of free bodies in their own axes; "world": both parts in world axes, and that of
                the body's origin; "mixed": the linear part in world axes, the angular one in the body's, as MuJoCo has it.
                Their accelerations are then the derivatives of these numbers.
            engine: Name of the engine.
            notes: What was left out.

        Raises:
            InputError: as the class.
        """
        check_kind("robot", robot, CheckedModel, "rbd.load_robot('g1')")
        check_choice("quaternion", quaternion, ("xyzw", "wxyz"))
        check_choice("base_velocity", base_velocity, ("body", "mixed", "world"))
        given = partial(_floats, robot)
        times = given("t", t, ("n",))
        n = len(times)
        Q, V = given("q", q, (n, robot.nq)), given("v", v, (n, robot.nv))
        if quaternion == "wxyz":
            Q = Q.copy()
            for piece in robot.joints.pieces:
                if piece.kind in ("space", "sphere"):
                    Q[:, unit_of(piece)] = np.roll(Q[:, unit_of(piece)], -1, axis=1)
        Q = _of_unit_length(robot, Q)
        h = np.zeros(n) if step is None else np.broadcast_to(given("step", step, (), (n,)), n)
        if (a is None) == (v_next is None):
            raise InputError(
                "a record has accelerations a, or velocities after a step v_next, with its length step: one of the two."
            )
        if v_next is not None and not (step is not None and (h > 0.0).all()):
            raise InputError(f"step is {step!r:.80}; expected the length of the step that led to v_next, above zero [s].")
        A = given("a", a, (n, robot.nv)) if v_next is None else (given("v_next", v_next, (n, robot.nv)) - V) / h[:, None]
        T = np.zeros((n, robot.nv))
        if tau is not None:
            torques = given("tau", tau, (n, robot.nv), (n, robot.nu))
            T[:, slice(None) if torques.shape[1] == robot.nv else robot.actuated] = torques
        V, A, T = to_body_axes(robot, Q, V, A, T, base_velocity)
        at, push = (given(what, x, ("k",)) for what, x in (("contact_at", contact_at), ("push_at", push_at)))
        k, p = len(at), len(push)
        F = given("contact_force", forces, (k, 3)) if k else np.zeros((0, 3))
        if axes is not None and k:
            if normals is not None:
                raise InputError(
                    "contact_normal and contact_axes both came; expected one: forces in W with normals, or in axes."
                )
            R = given("contact_axes", axes, (k, 3, 3))
            F, normals = np.einsum("kij,ki->kj", R, F), R[:, 0]
        bodies = _numbers(robot, "contact_body", contact_bodies, k)
        N = given("contact_normal", normals, (k, 3)) if k else F
        turned = (bodies[:, 0] == 0)[:, None]  # the world gives, and a body feels
        bodies, N, F = np.where(turned, bodies[:, ::-1], bodies), np.where(turned, -N, N), np.where(turned, -F, F)
        mu = np.broadcast_to(given("contact_friction", np.nan if friction is None else friction, (), (k,), nan=True), k)
        gap = np.full(k, np.nan) if gaps is None else gaps
        return cls(
            robot=robot, t=times, q=Q, v=V, a=A, step=h, tau=T, contact_at=at,
            contact_bodies=bodies, points=points if k else F, normals=N, friction=mu, forces=F, gaps=gap, push_at=push,
            push_bodies=_numbers(robot, "push_body", push_bodies, p)[:, 0], push_points=push_points if p else np.zeros((0, 3)),
            push_forces=push_forces if p else np.zeros((0, 3)),
            push_moments=np.zeros((p, 3)) if push_moments is None else push_moments, engine=engine,
            notes=tuple(listed_items("notes", notes, "a list of texts")),
        )  # fmt: skip

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, CheckedModel, "rbd.load_robot('g1')")
        robot, n = self.robot, len(_floats(self.robot, "t", self.t, ("n",)))
        k, p = len(self.contact_at), len(self.push_at)
        shapes: dict[str, tuple[int, ...]] = {
            "t": (n,), "q": (n, robot.nq), "v": (n, robot.nv), "a": (n, robot.nv), "step": (n,), "tau": (n, robot.nv),
            **{name: (k, 3) for name in ("points", "normals", "forces")}, "friction": (k,), "gaps": (k,),
            **{name: (p, 3) for name in _PUSH},
        }  # fmt: skip
        for name, shape in shapes.items():
            x = _floats(robot, name, getattr(self, name), shape, nan=name in ("friction", "gaps"))
            object.__setattr__(self, name, locked(np.array(x)))
        if not n:
            raise InputError("a record has one frame or more; t is empty.")
        check_kind("engine", self.engine, str, "the name of an engine")
        object.__setattr__(self, "notes", tuple(map(str, self.notes)))
        back = np.flatnonzero(np.diff(self.t) <= 0.0)
        if len(back):
            i = int(back[0])
            raise InputError(f"t goes back: t[{i + 1}] = {self.t[i + 1]:g} s follows t[{i}] = {self.t[i]:g} s.")
        for name in ("contact_at", "push_at"):
            at = _whole(name, getattr(self, name), n)
            object.__setattr__(self, name, locked(at))
            if name == "contact_at" and len(at) and (np.diff(at) < 0).any():
                raise InputError("contact_at goes back; expected the points in the order of the frames.")
        for name, count in (("contact_bodies", (k, 2)), ("push_bodies", (p,))):
            numbers = np.asarray(getattr(self, name), int)
            if numbers.shape != count or numbers.size and not 0 <= numbers.min() <= numbers.max() < len(self.bodies):
                raise InputError(f"{name} has shape {numbers.shape}; expected {count}, numbers of bodies.")
            object.__setattr__(self, name, locked(numbers))
        odd = np.flatnonzero(np.abs(np.linalg.norm(self.normals, axis=1) - 1.0) > UNIT)
        if len(odd):
            raise InputError(f"contact_normal[{odd[0]}] is {self.normals[odd[0]].tolist()}; expected a vector of unit length.")
        if (low := np.flatnonzero(self.friction < 0.0)).size:
            raise InputError(f"contact_friction[{low[0]}] is {self.friction[low[0]]:g}; expected a number of 0 or more.")
        object.__setattr__(self, "q", locked(_of_unit_length(robot, self.q)))

    @property
    def n(self) -> int:
        """Number of frames."""
        return len(self.t)

    @lazy
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies; `contact_bodies` are numbers in it. The first is the world."""
        return bodies_of(self.robot)

    @lazy
    def joints(self) -> Array:
        """The joint that carries each body, shape (bodies,); 0 is the world."""
        frames = self.robot.model.frames
        return np.array(
            [0] + [frames[self.robot.model.getFrameId(name, pin.BODY)].parentJoint for name in self.bodies[1:]], int
        )

    @lazy
    def starts(self) -> Array:
        """Where the points of each frame begin among the k, and k at the end, shape (n + 1,)."""
        return np.searchsorted(self.contact_at, np.arange(self.n + 1))

    def of_frame(self, frame: int) -> range:
        """Numbers of the points of a frame."""
        return range(int(self.starts[frame]), int(self.starts[frame + 1]))

    def pair(self, i: int) -> str:
        """The two bodies of a contact point, in words."""
        first, second = (self.bodies[b] for b in self.contact_bodies[i])
        return first if second == WORLD else f"{first} on {second}"

    def some(self, frames: Sequence[int] | Array) -> Record:
        """Some frames, in order of time."""
        chosen = np.asarray(frames, int)
        new = np.full(self.n, -1)
        new[chosen] = np.arange(len(chosen))
        fields = {name: getattr(self, name)[chosen] for name in ("t", "q", "v", "a", "step", "tau")}
        for at, names in (("contact_at", (*_CONTACT, "contact_bodies")), ("push_at", (*_PUSH, "push_bodies"))):
            number = new[getattr(self, at)]
            order = np.argsort(number, kind="stable")
            kept = order[number[order] >= 0]
            fields |= {name: getattr(self, name)[kept] for name in names} | {at: number[kept]}
        return replace(self, **fields)

    def on(self, robot: CheckedModel) -> Record:
        """The same motion on another model of the robot, by the names of its joints and bodies.

        A free body of another name becomes the floating base. For two engines side by side, or an engine's model and a URDF.

        Raises:
            InputError: joints, or bodies that touch, that the other model does not have, or has of another kind.
        """
        check_kind("robot", robot, CheckedModel, "rbd.load_robot('g1')")
        q, v = np.zeros(robot.nq, int), np.zeros(robot.nv, int)
        taken: set[str] = set()
        for name, joint in self.robot.joints.items():
            base = joint.kind == "FreeFlyer" and name not in robot.joints and robot.floating
            other = robot.joints[next(iter(robot.joints)) if base else name]
            if (other.nq, other.nv) != (joint.nq, joint.nv):
                raise InputError(f"joint {name!r:.80} has {joint.nq} numbers in q, and {other.nq} in {robot.name}.")
            q[other.q], v[other.v] = np.arange(joint.q.start, joint.q.stop), np.arange(joint.v.start, joint.v.stop)
            taken.add(other.name)
        if left := [name for name in robot.joints if name not in taken]:
            raise InputError(f"joint {left[0]!r:.80} of {robot.name} is not in {self.robot.name}; expected the same joints.")
        names = np.array(self.bodies)
        arrays = {name: getattr(self, name) for name in ("t", "step", "contact_at", "push_at", *_CONTACT, *_PUSH)}
        return Record.of_arrays(
            robot, q=self.q[:, q], v=self.v[:, v], a=self.a[:, v], tau=self.tau[:, v], **arrays, engine=self.engine,
            contact_bodies=names[self.contact_bodies], push_bodies=names[self.push_bodies], notes=self.notes,
        )  # fmt: skip

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as .npz, in the layout that `Record.read` and other engines use (docs: *Audit of other engines*).

        Raises:
            InputError: a path that does not end in .npz, or that cannot be written.
        """
        place = _npz(path)
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ("t", "q", "v", "a", "step", "tau")}
        names = np.array(self.bodies)
        arrays |= {key: getattr(self, name) for key, name in KEYS.items() if hasattr(self, name)}
        arrays["contact_body"], arrays["push_body"] = names[self.contact_bodies], names[self.push_bodies]
        texts = {"recipe": json.dumps(recipe(self.robot)), "engine": self.engine, "notes": json.dumps(self.notes)}
        arrays |= {"robot_numbers": robot_numbers(self.robot)} | {key: np.array(text) for key, text in texts.items()}
        write_file(place, lambda file: np.savez(file, allow_pickle=False, **arrays))

    @classmethod
    def read(cls, path: str | os.PathLike[str], robot: CheckedModel | str | None = None) -> Record:
        """Read a record that any engine wrote as .npz.

        Args:
            path: The file.
            robot: The robot, or its name or file; None: the one that the file names.

        Raises:
            InputError: no such file, arrays that are missing, unknown or do not fit, by name; and as the class.
        """
        place = _npz(path)
        arrays = npz_arrays(place)
        texts = {key: str(np.ravel(arrays.pop(key))[0]) for key in _TEXTS if key in arrays and arrays[key].size}
        known = ("t", "q", "v", "a", "v_next", "step", "tau", *KEYS)
        if missing := [key for key in ("t", "q", "v") if key not in arrays]:
            raise InputError(
                f"{place.name} has no {missing[0]}; expected {', '.join(known[:7])} and contacts: {', '.join(KEYS)}."
            )
        for key in arrays:
            if key not in (*known, "robot_numbers"):
                raise InputError(f"{place.name} has the array {key!r:.80}, which no record has; {nearest(key, known)}.")
        if "contact_at" in arrays:
            for key in ("contact_body", "contact_point", "contact_force"):
                if key not in arrays:
                    raise InputError(f"{place.name} has contact_at and no {key}; expected one for each point.")
        owner = _robot_of(place, texts, arrays.pop("robot_numbers", None), robot)
        told = texts.get("notes", "[]")
        try:
            notes = tuple(str(note) for note in json.loads(told))
        except (json.JSONDecodeError, TypeError):
            notes = (told,)
        more: dict[str, Any] = {key: texts[key] for key in ("quaternion", "base_velocity", "engine") if key in texts}
        given = {KEYS.get(key, key): x for key, x in arrays.items()}
        try:
            return cls.of_arrays(owner, **given, **more, notes=notes)
        except InputError as error:
            raise InputError(f"{place.name}: {error}") from None

    def __str__(self) -> str:
        frames = f"{self.n} frame{'s' * (self.n > 1)} " + (
            f"at {self.t[0]:g} s" if self.n == 1 else f"from {self.t[0]:g} to {self.t[-1]:g} s"
        )
        by = self.engine or "an engine without a name"
        told = f"{self.robot.name}, {frames}, {len(self.contact_at)} contact points, from {by}"
        return "\n".join([told, *(f"  note: {note}" for note in self.notes)])


def bodies_of(robot: CheckedModel) -> tuple[str, ...]:
    """The world, then the names of the robot's bodies, in the order of its frames."""
    return (WORLD, *(f.name for f in robot.model.frames[1:] if f.type == pin.BODY))


def unit_of(piece: Piece) -> slice:
    """Which entries of q hold the quaternion, or the cosine and sine, of a piece."""
    return slice(piece.q + piece.unit.start, piece.q + piece.unit.stop)


def to_body_axes(robot: CheckedModel, q: Array, v: Array, a: Array, tau: Array, axes: str) -> tuple[Array, Array, Array]:
    """(v, a, tau) of free bodies in their own axes, as Pinocchio has them, from those of an engine.

    With R from body to world axes and w the angular velocity in the body's axes, the linear velocity in W is R u, and its
    derivative R (du/dt + w x u). That of R w is R dw/dt.

    Args:
        robot: The robot.
        q: Shape (n, nq).
        v: Shape (n, nv).
        a: Derivatives of the numbers in v, shape (n, nv).
        tau: Generalised forces that go with v, shape (n, nv).
        axes: "body", "mixed" or "world", see `Record.of_arrays`.
    """
    if axes == "body":
        return v, a, tau
    v, a, tau = v.copy(), a.copy(), tau.copy()
    for piece in [piece for piece in robot.joints.pieces if piece.kind == "space"]:
        linear, angular = slice(piece.v, piece.v + 3), slice(piece.v + 3, piece.v + 6)
        R = Rotation.from_quat(q[:, unit_of(piece)]).as_matrix()
        for part in (linear, angular)[: 2 if axes == "world" else 1]:
            for x in (v, a, tau):
                x[:, part] = np.einsum("nji,nj->ni", R, x[:, part])
        a[:, linear] -= np.cross(v[:, angular], v[:, linear])
    return v, a, tau


def _floats(robot: CheckedModel, what: str, value: object, *shapes: tuple[int | str, ...], nan: bool = False) -> Array:
    """An array of one of some shapes, letters standing for any number, with its name in the message."""
    told = " or ".join(map(_told, shapes))
    if value is None:
        raise InputError(f"{what} is missing; expected shape {told} for {robot.name}.")
    x = as_array(what, value)
    fitting = (zip(shape, x.shape, strict=True) for shape in shapes if len(shape) == x.ndim)
    if not any(all(isinstance(m, str) or m == size for m, size in pairs) for pairs in fitting):
        raise InputError(f"{what} has shape {x.shape}; expected {told} for {robot.name}.")
    bad = np.argwhere((np.abs(x) > LARGEST) | (np.isnan(x) & (not nan)))
    if len(bad):
        where = [int(i) for i in bad[0]]
        raise InputError(f"{what}{where} is {x[tuple(where)]:g}; expected a finite number, up to {LARGEST:g}.")
    return x


def _told(shape: tuple[int | str, ...]) -> str:
    return f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"


def _whole(what: str, value: Array, n: int) -> Array:
    numbers = np.asarray(value).astype(int)
    bad = np.flatnonzero((numbers != value) | (numbers < 0) | (numbers >= n))
    if len(bad):
        raise InputError(f"{what}[{bad[0]}] is {value[bad[0]]:g}; expected the number of a frame, 0 to {n - 1}.")
    return numbers


def _numbers(robot: CheckedModel, what: str, names: Any, k: int) -> Array:
    """Names of bodies, shape (k,) or (k, 2), as numbers, shape (k, 2)."""
    known = {name: i for i, name in enumerate(bodies_of(robot))}
    known |= {name: 0 for name in ("", "universe", "ground") if name not in known}
    try:
        given = np.array(names, dtype=str) if k else np.zeros((0, 2), str)
    except (ValueError, TypeError):
        raise InputError(f"{what} is {names!r:.80}; expected ({k},) or ({k}, 2) names of bodies.") from None
    given = np.stack([given, np.full(given.shape, WORLD)], axis=1) if given.ndim == 1 else given
    if given.shape != (k, 2):
        raise InputError(f"{what} has shape {given.shape}; expected ({k},) or ({k}, 2), names of bodies.")
    frames = {f.name: f.parentJoint for f in robot.model.frames}
    carriers = {f.parentJoint: f.name for f in reversed(list(robot.model.frames[1:])) if f.type == pin.BODY}
    out = np.zeros((k, 2), int)
    unique, index = np.unique(given, return_inverse=True)
    for j, name in enumerate(unique.tolist()):
        if name not in known and name in frames:  # another frame of a body
            known[name] = known.get(carriers.get(frames[name], ""), 0)
        if name not in known:
            raise FrameNotFound(f"{what}: no body {name!r:.80} in {robot.name}; {nearest(name, list(known))}.")
        out[index.reshape(k, 2) == j] = known[name]
    return out


def _of_unit_length(robot: CheckedModel, q: Array) -> Array:
    """Q with quaternions, cosines and sines of unit length, as far as single precision left them."""
    q = q.copy()
    for piece in robot.joints.pieces:
        unit = q[:, unit_of(piece)]
        if not unit.shape[1]:
            continue
        norm = np.linalg.norm(unit, axis=1)
        odd = np.flatnonzero(np.abs(norm - 1.0) > UNIT)
        if len(odd):
            raise InputError(
                f"q[{odd[0]}] has {unit[odd[0]].round(6).tolist()} of length {norm[odd[0]]:.4g} where a quaternion, or cosine "
                "and sine, stands; expected unit length. Are its columns in the robot's order?"
            )
        q[:, unit_of(piece)] = np.where(np.abs(norm - 1.0) > ROUNDED, 1.0 / norm, 1.0)[:, None] * unit
    return q


def _npz(path: str | os.PathLike[str]) -> Path:
    place = a_path(path, "the path of a record, e.g. 'run.npz'")
    if place.suffix != ".npz":
        raise InputError(f"path is {str(place)!r:.200}; expected one that ends in .npz.")
    return place


def _robot_of(path: Path, texts: Mapping[str, str], numbers: Array | None, robot: CheckedModel | str | None) -> CheckedModel:
    """The robot given, else that of the file: as `Record.save` wrote it, or by its name, its path or its text."""
    if isinstance(robot, str):
        return load_robot(robot)
    if "recipe" in texts and numbers is not None:
        try:
            given = json.loads(texts["recipe"])
        except (json.JSONDecodeError, RecursionError):
            given = None
        if not isinstance(given, dict):
            raise InputError(f"{path.name}: recipe is no JSON of Record.save; give the robot: Record.read(path, robot='g1').")
        return robot_of(given, numbers, path.parent, robot)
    if robot is not None:
        return robot
    if "text" in texts:
        return load_robot(text=texts["text"])
    if "robot" in texts:
        return load_robot(texts["robot"])
    raise InputError(f"{path.name} does not name its robot; give it: rbd.audits.Record.read(path, robot='g1').")
