"""`Worlds`: many worlds of one robot, stepped together; what acts in each may differ."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import KW_ONLY, dataclass
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.answers.many.states import Friction, ManyStates
from rbd.arrays import Array, as_array, check_flag, check_positive, check_whole
from rbd.constraints.constraint import Constraint
from rbd.control.schedules import Push
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, check_known, listed_items
from rbd.installation import cores
from rbd.kernels import prepare
from rbd.model.checked_model import CheckedModel
from rbd.problem.gauss_problem import Law
from rbd.solvers.default import slip_law
from rbd.worlds import layout as rows
from rbd.worlds.advance_kernel import advance, size_of
from rbd.worlds.contact_kernel import law_size
from rbd.worlds.hard_steps import solve_left
from rbd.worlds.lanes import LANES
from rbd.worlds.packing import Packed, Touching
from rbd.worlds.spatial_kernel import rotation

EachWorld: TypeAlias = float | Sequence[float] | Array
"""A number, or one a world, shape (n,)."""
FASTEST = 1.8
"""Largest product of a step and the frequency of a stiffness."""


@dataclass(frozen=True, eq=False)
class Servo(Displayed):
    """Motors that pull their joints to targets: tau = torque + stiffness (target - q) - damping q', within the effort limits.

    The damping is taken implicitly, as is that of the joints; the stiffness is not: steps must be shorter than 1.8 / omega of
    its fastest oscillation.

    Attributes:
        stiffness: Of each motor: a number, shape (nu,), or (n, nu) of each world [N/m, N m/rad].
        damping: Likewise [N s/m, N m s/rad].
        target: Angles or positions, shape (nu,) or (n, nu) [rad, m].
        torque: Shape (nu,) or (n, nu) [N, N m].
        limited: Whether the effort limits of the robot's motors hold.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> standing = solo.standing()
        >>> servo = rbd.worlds.Servo(3.0, 0.05, target=standing.q[7:])
        >>> worlds = rbd.simulate_many([standing] * 8, solo.feet(), duration=0.1, step=1e-3, controller=servo)
        >>> worlds.q.shape, bool(worlds.residual.max() < 1e-8)
        ((8, 2, 19), True)
    """

    stiffness: EachWorld
    damping: EachWorld
    _: KW_ONLY
    target: Sequence[float] | Array
    torque: EachWorld = 0.0
    limited: bool = True


@dataclass(frozen=True, eq=False)
class WorldPushes(Displayed):
    """A constant force from one time to another in each world.

    Attributes:
        frame: Frame of the robot.
        force: In world axes, shape (3,) or (n, 3) [N].
        start: When it begins, a number or (n,) [s].
        duration: How long it lasts, a number or (n,) [s].
        moment: In world axes, in addition, shape (3,) or (n, 3) [N m].
        offset: Where it acts, from the frame's origin in the frame's axes, shape (3,) [m].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> pushes = rbd.worlds.WorldPushes("box", np.outer([0, 10, 20], [1, 0, 0]), start=0.0, duration=0.1)
        >>> start = rbd.State(box, [0, 0, 1, 0, 0, 0, 1])
        >>> rbd.simulate_many(start, [], duration=0.2, step=1e-2, pushes=pushes).v[:, -1, 0].round(6)
        array([0. , 0.1, 0.2])
    """

    frame: str
    force: Sequence[float] | Array
    _: KW_ONLY
    start: EachWorld
    duration: EachWorld
    moment: Sequence[float] | Array = (0.0, 0.0, 0.0)
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)


class Worlds(Displayed):
    """n worlds of one robot in time, for controllers and environments; `simulate_many` is a loop over it.

    Args:
        robot: The robot: hinges, slides, and at most one floating base.
        contacts: Points, edges and soles on planes or terrain at rest, with friction; `JointLimit` and `JointFriction`.
        q: Configurations, shape (n, nq), or (nq,).
        v: Velocities, shape (n, nv), or (nv,); None: at rest.
        step: Length of a step [s].
        law: "coulomb" or "convex".
        controller: A `Servo`, or None.
        friction: Coefficients in place of the contacts' own, as of `rbd.solve_many`.
        mass: Factor of all masses and inertias, a number or (n,); or {link: factor}, with what is fixed to the link.
        gravity: Shape (3,) or (n, 3) [m/s2]; None: the robot's.
        ground: Height added to all ground, a number or (n,) [m].
        damping: {joint: viscous damping, a number or (n,)} [N s/m, N m s/rad].
        pushes: `WorldPushes` and `rbd.control.Push`.
        threads: How many; None: one a core. The numbers are the same, bit by bit.
        loops: As of `rbd.simulate`; loops are not supported, and a robot that has some is refused.

    Raises:
        InputError: arrays of wrong sizes, numbers that are not finite, steps that are too long for a stiffness.
        Unsupported: joints or constraints that are not covered, by name.
        UnknownName: links, joints, frames that the robot does not have.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> standing = solo.standing()
        >>> servo = rbd.worlds.Servo(3.0, 0.05, target=standing.q[7:])
        >>> worlds = rbd.worlds.Worlds(solo, solo.feet(), np.tile(standing.q, (16, 1)), step=1e-3, controller=servo)
        >>> worlds.advance(50)
        >>> worlds.drive(target=standing.q[7:] + 0.01)
        >>> worlds.advance(50)
        >>> worlds.t, worlds.q.shape, bool(worlds.residual.max() < 1e-8)
        (0.1, (16, 19), True)
    """

    def __init__(
        self,
        robot: CheckedModel,
        contacts: Sequence[Constraint],
        q: Array,
        v: Array | None = None,
        *,
        step: float,
        law: Law | str = "coulomb",
        controller: Servo | None = None,
        friction: Friction = None,
        mass: EachWorld | Mapping[str, EachWorld] | None = None,
        gravity: Sequence[float] | Array | None = None,
        ground: EachWorld = 0.0,
        damping: Mapping[str, EachWorld] | None = None,
        pushes: WorldPushes | Push | Sequence[WorldPushes | Push] = (),
        threads: int | None = 1,
        loops: bool = True,
    ) -> None:
        prepare(advance)  # fused multiplications and additions round otherwise than NumPy's: no first steps without them
        check_positive("step", step, 10.0, "s")
        given = ManyStates.of(robot, q, v, contacts, friction=friction, loops=loops)
        self.robot, self.step, self.coulomb = robot, float(step), slip_law(law).kind == "coulomb"
        self.packed, start = Packed.of(robot), next((i for i in range(len(given)) if i not in given.refused), None)
        if start is None:
            given.refuse(0)
            raise InputError("there are no worlds: give one state or more, and arrays with one row or more.")
        self.touching = Touching.of(self.packed, given.constraints, given.state(start))
        one = all(np.ndim(x) < 2 or len(x) == 1 for x in (q, v) if x is not None)
        tables = _Tables(len(given), "friction" if one and given.friction else "the array of states")
        tree, sites = self.packed.tree, self.touching.sites
        n, free, k, l = len(tree.parent), tree.free, len(sites.arm), len(sites.single)
        joint = np.zeros((n - free, rows.JOINT, 1))
        joint[:, rows.LIMIT], joint[:, rows.LOW], joint[:, rows.HIGH] = np.inf, -np.inf, np.inf
        inverse = pin.computeMinverse(robot.model, robot.model.createData(), given.q[start])
        joint[:, rows.MOBILE, 0] = np.diag(inverse)[6 * free :]
        for b, (low, high, rubs) in self.touching.joints.items():
            joint[b - free, [rows.LOW, rows.HIGH, rows.RUBS], 0] = low, high, rubs
        masses = self._masses(tables, mass)
        acts = dict(
            joint=self._driven(tables, joint, controller, damping),
            world=_beside([
                tables.vectors("gravity", robot.model.gravity.linear if gravity is None else gravity, 3),
                tables.numbers("ground", ground)[None],
            ]),
            friction=self._friction(tables, given), push=self._pushes(tables, pushes), inertia=masses,
        )  # fmt: skip
        self.n, threads = tables.n, cores() if threads is None else check_whole("threads", threads, 1024)
        self.blocks = -(-self.n // LANES)
        self._given = {name: self._packed_in(x.reshape(-1, x.shape[-1])) for name, x in acts.items()}
        self._given["checked"] = self._given["inertia"].copy()
        shape = lambda size: np.zeros((self.blocks, size, LANES))  # noqa: E731
        self._q, self._v, self._before = shape(n + 6 * free), shape(robot.nv), shape(2 * robot.nv + 1)
        self._impulse, self._told = shape(3 * (3 * k + l)), shape(rows.TOLD)
        size, marks = size_of(n, free, sites), rows.ACTIVE + 2 * len(sites.site)
        self._spaces = [(np.zeros((size, LANES)), np.zeros(marks, int)) for _ in range(min(threads, self.blocks))]
        self._law = size - law_size(n, sites)
        self._pool = ThreadPoolExecutor(len(self._spaces)) if len(self._spaces) > 1 else None
        self.steps, self.refused = 0, dict(given.refused)
        self.set(np.broadcast_to(given.q, (self.n, robot.nq)), np.broadcast_to(given.v, (self.n, robot.nv)))
        self._check_stiffness(controller)

    @property
    def t(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.step

    @property
    def q(self) -> Array:
        """Configurations, shape (n, nq)."""
        free, x = self.packed.tree.free, self._unpacked(self._q)
        out = np.empty((self.n, self.robot.nq))
        if free:
            out[:, :7] = x[:, :7]
        angles = x[:, 7 * free :]
        plain, turning = self.packed.at
        out[:, plain[1]] = angles[:, plain[0]]
        out[:, turning[1]], out[:, turning[1] + 1] = np.cos(angles[:, turning[0]]), np.sin(angles[:, turning[0]])
        return out

    @property
    def v(self) -> Array:
        """Velocities, shape (n, nv), a base's in its own axes."""
        x = self._unpacked(self._v)
        if self.packed.tree.free:
            R = _rotations(self._unpacked(self._q)[:, 3:7])
            x[:, :3], x[:, 3:6] = np.einsum("nji,nj->ni", R, x[:, :3]), np.einsum("nji,nj->ni", R, x[:, 3:6])
        return x

    @property
    def residual(self) -> Array:
        """The largest scaled residual of equation of motion and contact law since `forget`, shape (n,)."""
        return np.asarray(self._unpacked(self._told)[:, [rows.EQUATION, rows.CONTACT]].max(axis=1))

    @property
    def depth(self) -> Array:
        """How deep a point was below its surface since `forget`, shape (n,) [m]."""
        return self._unpacked(self._told)[:, rows.DEPTH]

    @property
    def turn(self) -> Array:
        """The largest angle by which a body turned in a step since `forget`, shape (n,) [rad]; from 1 on a world stops."""
        return self._unpacked(self._told)[:, rows.TURN]

    @property
    def stopped(self) -> Array:
        """The step before which each world stopped: it has no solution, is not finite, or turns too fast; -1: it goes on.

        Shape (n,).
        """
        return self._unpacked(self._told)[:, rows.STOPPED].astype(int) - 1

    @property
    def rescued(self) -> Array:
        """How many steps of each world were solved alone, by the method for one world, shape (n,)."""
        return self._unpacked(self._told)[:, rows.RESCUED].astype(int)

    @property
    def forces(self) -> dict[str, Array]:
        """{contact: mean force on the robot in the last step, world axes, shape (n, 3)} [N]."""
        f = self.point_forces
        return {name: f[:, own].sum(axis=1) for name, own in self.touching.points.items()}

    @property
    def point_forces(self) -> Array:
        """Mean forces on the robot at all points in the last step, world axes, shape (n, k, 3) [N]."""
        k = len(self.touching.sites.arm)
        f = self._unpacked(self._impulse)[:, : 3 * k].reshape(self.n, k, 3) / self.step
        return np.asarray(f[:, np.argsort(self.touching.order)])

    def only(self, world: int) -> Worlds:
        """One of the worlds alone, as it is now: its steps are the same, bit by bit, as lanes do not depend on each other."""
        out = copy.copy(self)
        block, lane = divmod(world, LANES)

        def cut(x: Array) -> Array:
            return np.repeat(x[min(block, len(x) - 1)][None, :, lane, None], LANES, axis=2)

        out.n, out.blocks, out._pool, out._spaces = 1, 1, None, [(self._spaces[0][0].copy(), self._spaces[0][1].copy())]
        out._given = {name: cut(x) for name, x in self._given.items()}
        out._q, out._v, out._before, out._impulse, out._told = map(
            cut, (self._q, self._v, self._before, self._impulse, self._told)
        )
        return out

    def forget(self) -> None:
        """Begin anew with the largest residuals and depths."""
        self._told[:, [rows.EQUATION, rows.CONTACT, rows.DEPTH, rows.TURN]] = 0.0

    def set(self, q: Array, v: Array, which: Array | None = None) -> None:
        """Put some worlds, given by number, or all, into states; they go on if they had stopped."""
        which = np.arange(self.n) if which is None else np.asarray(which)
        free = self.packed.tree.free
        q, v = np.asarray(q, float), np.array(v, float)
        x = np.empty((len(which), self._q.shape[1]))
        plain, turning = self.packed.at
        if free:
            x[:, :7] = q[:, :7]
            R = _rotations(q[:, 3:7])
            v[:, :3], v[:, 3:6] = np.einsum("nij,nj->ni", R, v[:, :3]), np.einsum("nij,nj->ni", R, v[:, 3:6])
        x[:, 7 * free + plain[0]] = q[:, plain[1]]
        x[:, 7 * free + turning[0]] = np.arctan2(q[:, turning[1] + 1], q[:, turning[1]])
        good = np.isfinite(x).all(axis=1) & np.isfinite(v).all(axis=1)
        x[~good], v[~good] = x[good][0] if good.any() else 0.0, 0.0
        blocks, lanes = which // LANES, which % LANES
        for table, value in ((self._q, x), (self._v, v), (self._before, 0.0), (self._impulse, 0.0), (self._told, 0.0)):
            table[blocks, :, lanes] = value
        self._told[blocks[~good], rows.STOPPED, lanes[~good]] = self.steps + 1.0
        for table in (self._q, self._v):  # lanes that no world has
            table[-1, :, (self.n - 1) % LANES + 1 :] = table[-1, :, (self.n - 1) % LANES, None]

    def drive(self, *, tau: Array | None = None, target: Array | None = None) -> None:
        """Set the motors' torques, or the servo's targets, shape (n, nu) or (nu,), for the steps to come."""
        for row, value in ((rows.FEED, tau), (rows.TARGET, target)):
            if value is not None:
                table = np.broadcast_to(np.asarray(value, float), (self.n, self.robot.nu)).T
                self._given["joint"] = self._each("joint")
                self._given["joint"].reshape(self.blocks, -1, rows.JOINT, LANES)[:, self.packed.driven, row] = self._packed_in(
                    table
                )

    def vary(
        self, which: Array, *, friction: Array | None = None, mass: Array | None = None, force: Array | None = None,
        start: Array | None = None, end: Array | None = None,
    ) -> None:  # fmt: skip
        """Change what acts in some worlds from now on. An argument that is None changes nothing; values are not checked.

        Args:
            which: Numbers of the m worlds.
            friction: Coefficient of all their contacts, shape (m,).
            mass: Factor of all their masses and inertias, in place of the one before, shape (m,).
            force: Of the first push, in world axes, shape (m, 3) [N].
            start: When it begins, shape (m,) [s].
            end: When it ends, shape (m,) [s].
        """
        if friction is not None:
            self._put("friction", np.arange(len(self.touching.friction)), which, friction[:, None])
        if mass is not None:
            inertia = self.packed.inertia.reshape(-1, rows.INERTIA)
            own = np.arange(inertia.size).reshape(inertia.shape)[:, [0, *range(4, 10)]].ravel()
            for name in ("inertia", "checked"):
                self._put(name, own, which, mass[:, None] * inertia.ravel()[own])
        for first, value in ((3, force), (9, start), (10, end)):
            if value is not None:
                columns = value.reshape(len(which), -1)
                self._put("push", first + np.arange(columns.shape[1]), which, columns)

    def _put(self, name: str, own: Array, which: Array, values: Array) -> None:
        """Rows of a table in some worlds."""
        self._given[name] = table = self._each(name)
        table[which[:, None] // LANES, own, which[:, None] % LANES] = values
        table[-1, :, (self.n - 1) % LANES + 1 :] = table[-1, :, (self.n - 1) % LANES, None]  # lanes that no world has

    def advance(self, steps: int = 1) -> None:
        """Take some steps."""
        parts = np.linspace(0, self.blocks, len(self._spaces) + 1).astype(int)
        jobs = [(*own, a, b, steps) for own, a, b in zip(self._spaces, parts, parts[1:], strict=False)]
        if self._pool is None:
            self._advance(*jobs[0])
        else:
            list(self._pool.map(lambda job: self._advance(*job), jobs))
        self.steps += steps

    def _advance(self, space: Array, whole: Array, first: int, last: int, steps: int) -> None:
        """Steps of some blocks; a world that is not solved with the others of its block is solved alone."""
        given, touching, tree = self._given, self.touching, self.packed.tree
        whole[:] = 0
        whole[rows.BLOCK] = first
        while True:
            advance(
                *tree, *touching.sites, *touching.ground, self._push_bodies,
                given["inertia"], given["checked"], given["joint"], given["world"], given["friction"], given["push"],
                self._q, self._v, self._before, self._impulse, self._told, space, whole,
                last, self.steps, steps, self.t, self.step, self.coulomb,
            )  # fmt: skip
            if not whole[rows.PART]:
                return
            block = whole[rows.BLOCK]
            solve_left(touching.sites, self._told[block], space[self._law :], whole, len(tree.parent), self.coulomb)

    def _packed_in(self, x: Array) -> Array:
        """Rows by worlds, shape (rows, n) or (rows, 1), as blocks of lanes: one block where all worlds are alike."""
        if x.shape[1] == 1:
            return np.repeat(x[None], LANES, axis=2)
        padded = np.concatenate([x, np.repeat(x[:, -1:], self.blocks * LANES - x.shape[1], axis=1)], axis=1)
        return np.ascontiguousarray(padded.reshape(len(x), self.blocks, LANES).transpose(1, 0, 2))

    def _unpacked(self, x: Array) -> Array:
        """Blocks of lanes as an array with a row a world."""
        return x.transpose(0, 2, 1).reshape(self.blocks * LANES, x.shape[1])[: self.n].copy()

    def _each(self, name: str) -> Array:
        """What acts, with a block for each eight worlds."""
        x = self._given[name]
        return x if len(x) == self.blocks else np.repeat(x, self.blocks, axis=0)

    def _masses(self, tables: _Tables, mass: EachWorld | Mapping[str, EachWorld] | None) -> Array:
        inertia = self.packed.inertia.reshape(-1, rows.INERTIA, 1)
        if mass is None:
            return inertia
        model = self.robot.model
        bodies = {name: j - 1 for j, name in enumerate(model.names) if j}
        for frame in model.frames:  # links that move: those that are fixed to others have no masses of their own
            if frame.type == pin.FrameType.BODY and model.frames[frame.parentFrame].type == pin.FrameType.JOINT:
                bodies[frame.name] = frame.parentJoint - 1
        given = mass if isinstance(mass, Mapping) else {name: mass for j, name in enumerate(model.names) if j}
        factors = np.ones((len(inertia), 1))
        for name, factor in given.items():
            check_known("mass", name, bodies)
            value = tables.numbers(f"mass of {name!r:.80}", factor)
            if not (value > 0.0).all():
                raise InputError(f"the mass of {name!r:.80} is multiplied by {value.min():g}; expected a number above 0.")
            factors = np.broadcast_to(factors, (len(inertia), max(factors.shape[1], len(value)))).copy()
            factors[bodies[name]] *= value
        out = np.repeat(inertia, factors.shape[1], axis=2)
        for row in (0, *range(4, 10)):
            out[:, row] *= factors
        return out

    def _driven(
        self, tables: _Tables, joint: Array, servo: Servo | None, damping: Mapping[str, EachWorld] | None
    ) -> Array:  # fmt: skip
        nu, driven = self.robot.nu, self.packed.driven
        named = {}
        if servo is not None:
            check_kind("controller", servo, Servo, "an rbd.worlds.Servo")
            check_flag("limited of the servo", servo.limited)
            named = {rows.STIFF: ("stiffness", servo.stiffness), rows.DAMP: ("damping", servo.damping),
                     rows.TARGET: ("target", servo.target), rows.FEED: ("torque", servo.torque)}  # fmt: skip
        found = {row: tables.vectors(f"{name} of the servo", value, nu) for row, (name, value) in named.items()}
        viscous = {}
        damping = {} if damping is None else damping
        check_kind("damping", damping, Mapping, "{joint: damping}")
        for name, value in damping.items():
            check_known("damping", name, self.packed.names)
            viscous[self.packed.names.index(name)] = tables.numbers(f"damping of {name!r:.80}", value)
        width = max([x.shape[-1] for x in (*found.values(), *viscous.values())], default=1)
        out = np.repeat(joint, width, axis=2)
        for row, x in found.items():
            out[driven, row] = x
        for j, x in viscous.items():
            out[j, rows.VISCOUS] = x
        if (out[:, [rows.STIFF, rows.DAMP, rows.VISCOUS]] < 0.0).any():
            raise InputError("stiffness and damping are negative; expected numbers of 0 or more.")
        if servo is not None and servo.limited:
            out[driven, rows.LIMIT] = self.robot.effort_limit[:, None]
        return out

    def _friction(self, tables: _Tables, given: ManyStates) -> Array:
        tables.take("friction", 1 if not given.friction else len(given))
        mu = np.repeat(self.touching.friction[:, None], len(given) if given.friction else 1, axis=1)
        for name, value in given.friction.items():
            mu[self.touching.sorted_points(name)] = value
        return mu

    def _pushes(self, tables: _Tables, pushes: WorldPushes | Push | Sequence[WorldPushes | Push]) -> Array:
        bodies, parts = [], []
        pushes = (pushes,) if isinstance(pushes, WorldPushes | Push) else pushes
        for i, push in enumerate(listed_items("pushes", pushes, "a list of rbd.worlds.WorldPushes and rbd.control.Push")):
            check_kind(f"push {i}", push, WorldPushes | Push, "rbd.worlds.WorldPushes or rbd.control.Push")
            what = f"push {i} at {push.frame!r:.80}"
            joint, X = self.robot.site(push.frame)
            if joint == 0:
                raise InputError(f"{what} acts on the world, which does not move; name a frame of the robot.")
            bodies.append(joint - 1)
            place = self.packed.turns[joint].T @ (
                X.translation + X.rotation @ tables.vectors(f"offset of {what}", push.offset, 3)[:, 0]
            )
            start = tables.numbers(f"start of {what}", push.start)
            each = [
                place[:, None], tables.vectors(f"force of {what}", push.force, 3),
                tables.vectors(f"moment of {what}", push.moment, 3),
                start[None], (start + tables.numbers(f"duration of {what}", push.duration))[None], np.zeros((1, 1)),
            ]  # fmt: skip
            parts += each
        self._push_bodies = np.array(bodies, int)
        return _beside(parts) if parts else np.zeros((0, 1))

    def _check_stiffness(self, servo: Servo | None) -> None:
        """Refuse a step that is too long for the servo: of each joint alone, with all else free."""
        if servo is None:
            return
        joint = self._given["joint"].reshape(len(self._given["joint"]), -1, rows.JOINT, LANES)[:, self.packed.driven]
        speed = self.step * np.sqrt(joint[:, :, rows.STIFF].max(axis=(0, 2)) * joint[0, :, rows.MOBILE, 0])
        worst = int(speed.argmax()) if len(speed) else 0
        if len(speed) and speed[worst] > FASTEST:
            raise InputError(
                f"the step of {self.step:g} s is too long for the stiffness at {self.robot.actuated_names[worst]!r}, which "
                f"oscillates at {speed[worst] / self.step:.3g} rad/s; expected at most "
                f"{self.step * FASTEST / speed[worst]:.2g} s."
            )


class _Tables:
    """Arguments with a number for all worlds or one a world: how many worlds there are."""

    def __init__(self, n: int, first: str) -> None:
        self.n, self.first = n, first

    def take(self, what: str, n: int) -> None:
        """An argument for n worlds, or one for all."""
        if n == 0:
            raise InputError(f"{what} has no entries; give one for all worlds, or one a world.")
        if n == 1 or n == self.n:
            return
        if self.n != 1:
            raise InputError(
                f"{what} has {n} entries, and {self.first} {self.n}: world {min(n, self.n)} has no entry in "
                f"{what if n < self.n else self.first}; give one for all worlds, or one a world."
            )
        self.n, self.first = n, what

    def numbers(self, what: str, value: Any) -> Array:
        """One number a world, shape (n,), or (1,)."""
        x = as_array(what, value)
        if x.ndim > 1:
            raise InputError(f"{what} has shape {x.shape}; expected a number, or (n,), one a world.")
        return self._checked(what, x.reshape(-1))

    def vectors(self, what: str, value: Any, size: int) -> Array:
        """Vectors by worlds, shape (size, n), or (size, 1)."""
        x = as_array(what, value)
        x = np.broadcast_to(x, (size,)) if x.ndim == 0 else x
        if x.ndim > 2 or x.shape[-1] != size:
            raise InputError(f"{what} has shape {x.shape}; expected ({size},), or (n, {size}), one a world.")
        return self._checked(what, x.reshape(-1, size).T)

    def _checked(self, what: str, x: Array) -> Array:
        self.take(what, x.shape[-1])
        bad = np.flatnonzero(~np.isfinite(x.reshape(-1, x.shape[-1])).all(axis=0))
        if len(bad):
            where = f" in world {bad[0]}" if x.shape[-1] > 1 else ""
            raise InputError(f"{what} is not finite{where}; expected finite numbers.")
        return np.asarray(x, float)


def _beside(parts: Sequence[Array]) -> Array:
    """Rows by worlds one below the other, those of one world as in all."""
    width = max(x.shape[1] for x in parts)
    return np.concatenate([np.broadcast_to(x, (len(x), width)) for x in parts])


def _rotations(quaternions: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), of quaternions (x, y, z, w), shape (n, 4)."""
    return np.array(rotation(*quaternions.T)).reshape(3, 3, -1).transpose(2, 0, 1)
