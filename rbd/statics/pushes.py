"""The pushes in each direction that a robot can withstand with torques within limits, and the limits reached at the largest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rbd.arrays import Array, as_array, check_finite, check_positive, check_whole, lazy, rank_of
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed, drawing
from rbd.errors import CannotHold, InputError, NoSolution
from rbd.model.state import State
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import at_rest
from rbd.problem.programs import Outcome
from rbd.records import Field, vector
from rbd.statics.force_balance import ForceBalance, contact_forces, outside, place, standing_loads, torques_left
from rbd.statics.force_program import Support, bound, farthest
from rbd.statics.limits import Limit

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

MOST_DIRECTIONS = 10_000
_EVERY = 8
"""Of pushes in one plane, each so many-th is solved first; those between two whose limit is one and the same follow."""
_SAME = 1e-9
"""Limits that differ by less than this, over the robot's weight, are one."""
_MOVES = 1e-6
"""A point or a motor takes part in the motion that begins where it has more than this of the largest part."""
_CARRIES = 1e-7
"""A point that carries less than this, over the robot's weight, carries nothing."""
_NONE = 1e-7
"""A push of less than this, over the robot's weight, is none."""


@dataclass(frozen=True, eq=False)
class PushLimits(Displayed):
    """The pushes that a robot withstands, torques within limits and contact forces within friction: from `least` to `forces`.

    A robot that is held without a push withstands all up to the largest. One that is not, as on one sole beside its centre of
    mass, may be held by a push: along each direction by those in an interval.

    Attributes:
        loads: The pose, its contacts, and what their forces do.
        frame: Frame of the robot that is pushed.
        offset: Where, from the frame's origin in the frame's axes, shape (3,) [m].
        directions: Unit vectors in W, shape (k, 3).
        forces: Largest push in each direction, shape (k,) [N]: `at_most` where no limit is met up to there, NaN where no push
            holds the robot.
        bounds: What no push in each direction can exceed, by multipliers, shape (k,) [N].
        weights: Contact forces at these pushes, as weights of `loads.sets` over the robot's weight, shape (k, p).
        motions: The motion that begins there, shape (k, nv), of any size: the multipliers, read as a virtual velocity.
        least: Smallest push in each direction that holds the robot, shape (k,) [N]: zero where it is `held` without one.
        least_bounds: What no push that holds it falls below, by multipliers, shape (k,) [N].
        least_weights: Contact forces at the smallest pushes, as `weights`.
        at_most: Larger pushes were not looked for [N].
        programs: How many programs that took.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> sideways = [(1, 0, 0), (0, 1, 0), (0, 0, -1)]
        >>> limits = rbd.statics.push_limits(solo.standing(), solo.feet(friction=0.7), "base_link", sideways, at_most=200.0)
        >>> limits.forces.round(2), limits.point.round(3)  # down, no limit is met up to 200 N
        (array([ 17.17,  17.17, 200.  ]), array([0.   , 0.   , 0.232]))
    """

    loads: ForceBalance
    frame: str
    offset: Array
    directions: Array
    forces: Array
    bounds: Array
    weights: Array
    motions: Array
    least: Array
    least_bounds: Array
    least_weights: Array
    at_most: float
    programs: int

    fields: ClassVar[tuple[Field, ...]] = (
        Field(
            "residual", (), "N, N m", "largest error of all pushes: of balance, forces outside cones, torques", certificate=True
        ),
        Field(
            "push_limit", ("direction",), "N", "largest push in each direction; NaN where none holds it", lambda x: x.forces
        ),
        Field(
            "push_least", ("direction",), "N",
            "smallest push in each direction that holds it; zero where it is held without one", lambda x: x.least,
        ),
        Field("push_bound", ("direction",), "N", "what no push in each direction can exceed", lambda x: x.bounds),
        Field(
            "push_direction", ("direction", "axis"), "1", "unit vector of each direction, in W",
            lambda x: x.directions, default=False,
        ),
        Field(
            "gives_way", ("direction",), "", "the limits that give way first in each direction",
            lambda x: np.array([", ".join(map(str, limits)) for limits in x.gives_way], str), default=False,
        ),
    )  # fmt: skip

    @property
    def held(self) -> bool:
        """Whether the robot is held without a push."""
        return not self.least.any()

    @property
    def state(self) -> State:
        """The pose."""
        return self.loads.state

    @property
    def point(self) -> Array:
        """Where the push acts, in W, shape (3,) [m]."""
        return np.array(self.state.frame(self.frame, self.offset).X_WF.translation)

    @lazy
    def gives_way(self) -> tuple[tuple[Limit, ...], ...]:
        """The limits that give way first, direction by direction; none where no limit is met up to `at_most`.

        Motors that would yield; "friction" of contacts that would slip or turn at a point that carries a force; the "edge" of
        contacts that would turn over an edge or a corner; where nothing but contacts opens, these, which only "push"; and
        where nothing withstands, the "base" or the joints without motors that would move.
        """
        return tuple(_gives_way(self.loads, motion, x) for motion, x in zip(self.motions, self.weights, strict=True))

    def tau(self, number: int) -> Array:
        """Torques that withstand the largest push of a direction, shape (nu,) [N, N m]."""
        i = self._number(number)
        return torques_left(self.loads, self.weights[i], self._generalised(i, self.forces))[0]

    def contact_forces(self, number: int) -> dict[str, Array]:
        """{contact: force or wrench, world axes} beside these torques [N, N m]."""
        return contact_forces(self.loads, self.weights[self._number(number)])

    @lazy
    def residual(self) -> float:
        """Largest error of all answers, recomputed [N, N m]: of balance, of forces outside cones, of torques beyond limits."""
        worst = 0.0
        for i in np.flatnonzero(np.isfinite(self.forces)).tolist():
            for weights, forces in ((self.weights, self.forces), (self.least_weights, self.least)):
                worst = max(worst, self._error(weights[i], self._generalised(i, forces)))
        return worst

    def _error(self, x: Array, push: Array) -> float:
        tau, left = torques_left(self.loads, x, push)
        beyond = float((np.abs(tau) - self.state.robot.effort_limit).max(initial=0.0))
        return max(float(np.abs(left).max(initial=0.0)), outside(self.loads, x), beyond)

    def plot(self, ax: Axes) -> list[Artist]:
        """Draw the largest horizontal pushes from above: see `rbd.visual.plot_pushes`."""
        return drawing("plot_pushes")(ax, self)

    def __str__(self) -> str:
        count, i = len(self.forces), int(np.nanargmin(self.forces if self.held else self.least))
        way = vector(self.directions[i], 2)
        limits = ", ".join(map(str, self.gives_way[i]))
        what = f"limited by {limits}" if limits else f"no limit met up to {self.at_most:.4g} N"
        at, end = f"pushed at {self.frame}", f"residual {self.residual:.1e} N."
        if self.held and count == 1:
            return f"{at} along {way}: withstands {self.forces[i]:.4g} N, {what}; {end}"
        if self.held:
            least = f"withstands at least {self.forces[i]:.4g} N, the least along {way}"
            return f"{at} in {count} directions: {least}, {what}; {end}"
        some = "" if count == 1 else f", the smallest of those of {int(np.isfinite(self.least).sum())} of {count} directions"
        size = f"{self.least[i]:.4g} to {self.forces[i]:.4g} N" if limits else f"{self.least[i]:.4g} N or more"
        return f"{at}: cannot be held without a push; one of {size} along {way} holds it{some}, {what}; {end}"

    def _generalised(self, number: int, forces: Array) -> Array:
        return _point_jacobian(self.state, self.frame, self.offset).T @ (forces[number] * self.directions[number])

    def _number(self, number: int) -> int:
        i = check_whole("number", number, len(self.forces) - 1, least=0)
        if np.isnan(self.forces[i]):
            raise InputError(f"number is {number}, and no push along this direction holds the robot; expected one of another.")
        return i


def push_limits(
    state: State,
    contacts: Sequence[Constraint],
    frame: str,
    directions: Sequence[Sequence[float]] | Sequence[float] | Array,
    *,
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
    at_most: float = 1e4,
    friction: str = "cone",
    margin: float = 0.0,
    loops: bool = True,
) -> PushLimits:
    """The largest push in each direction that the robot can withstand without moving, and the limit that is reached first.

    Where it cannot be held without a push the answer is, for each direction, the interval of pushes that hold it, from
    `limits.least` to `limits.forces`.

    Maximises s over torques and contact forces with S^T tau + J^T f + s J_P^T d = h(q, 0), `|tau| <= limit`, f in the friction
    cones: motors know of the push and answer as well as they can. What fixed torques do is another question: `rbd.solve`.

    Each answer is certified from both sides: by forces and torques, and by multipliers. These are a virtual motion that the
    push drives against nothing but limits, so they tell what would give way.

    Args:
        state: The pose; v must be zero.
        contacts: What the robot stands on and holds to, at least one.
        frame: Frame of the robot that is pushed.
        directions: In W, shape (3,) or (k, 3); their lengths do not count.
        offset: Where the push acts, from the frame's origin in the frame's axes [m].
        at_most: Larger pushes are not looked for [N].
        friction: "cone", the circular cones; "inscribed" or "circumscribed", the pyramids inside or around them.
        margin: Share of each coefficient of friction that is left unused.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
        CannotHold: neither without a push nor with one along these directions can it be held; `rbd.hold` says why.
        FrameNotFound: with the nearest names.
        InputError: no contacts, directions of no length, numbers that are not finite.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> for friction in (0.3, 0.7):
        ...     limits = rbd.statics.push_limits(solo.standing(), solo.feet(friction), "base_link", (1, 0, 0))
        ...     print(f"{limits.forces[0]:.2f} N")  # of 24.53 N of weight
        7.36 N
        17.17 N
    """
    most = check_positive("at_most", at_most, 1e9)
    at, ways = place("offset", offset), unit_directions(directions)
    loads = standing_loads(state, contacts, friction, margin, loops)
    search = _PushSearch(loads, _point_jacobian(state, frame, at), ways, most / loads.unit)
    search.run()
    found, least = ([answers[i] for i in range(len(ways))] for answers in (search.answers, search.least))
    (forces, bounds), (smallest, not_less) = (
        loads.unit * np.maximum(0.0, [[a.size for a in some], [a.bound for a in some]]) for some in (found, least)
    )
    return PushLimits(
        loads, frame, at, ways, forces, bounds, np.array([a.x for a in found]), np.array([a.motion for a in found]),
        smallest, not_less, np.array([a.x for a in least]), most, search.programs,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Answer:
    """A largest or smallest push, over the weight, or NaN; of a largest one the half-space of all, a . F <= b."""

    size: float
    bound: float
    x: Array
    motion: Array
    a: Array
    b: float


class _PushSearch:
    """Largest pushes in all directions, each solved, or between two others at one and the same limit."""

    def __init__(self, loads: ForceBalance, J: Array, ways: Array, most: float) -> None:
        robot = loads.state.robot
        self.loads, self.ways, self.most, self.programs = loads, ways, most, 0
        self.B = J.T[robot.unactuated] / loads.row_size[:, None]
        self.P = (J.T[robot.motors] * (loads.unit / loads.limit)[:, None])[loads.limited]
        self.own = Conic.of({"forces": loads.block()}, [({"forces": loads.A}, loads.b)], [loads.torque_rows])
        self.answers: dict[int, _Answer] = {}
        self.least: dict[int, _Answer] = {}

    def run(self) -> None:
        """Answer all.

        Raises:
            CannotHold: no push along any direction holds it, nor none.
        """
        count = len(self.ways)
        smallest = self._smallest(self.ways[0])
        if not smallest.size <= _NONE:
            self._run_intervals(smallest)
            return
        self.least = dict.fromkeys(range(count), replace(smallest, size=0.0, bound=0.0))
        if count > 4 and rank_of(self.ways) == 2:
            U = np.linalg.svd(self.ways)[2][:2]
            order = np.argsort(np.arctan2(*(U @ self.ways.T)[::-1]), kind="stable").tolist()
            first = [*order[::_EVERY], order[0]]
            for start, i, j in zip(range(0, count, _EVERY), first[:-1], first[1:], strict=True):
                self._between(i, order[start + 1 : start + _EVERY], j)
        for i in range(count):
            self._answer(i)

    def _run_intervals(self, first: _Answer) -> None:
        """Answer all of a robot that is not held without a push."""
        for i, way in enumerate(self.ways):
            self.least[i] = smallest = self._smallest(way) if i else first
            self.answers[i] = smallest if math.isnan(smallest.size) else self._solved(way)
        if all(math.isnan(each.size) for each in self.least.values()):
            robot = self.loads.state.robot
            raise CannotHold(
                f"{robot.name} cannot be held on these contacts without a push, nor by one along "
                f"{'this direction' if len(self.ways) == 1 else 'these directions'}; rbd.hold says why."
            )

    def _between(self, i: int, others: list[int], j: int) -> None:
        """Answer the directions between two, in order."""
        one, two = self._answer(i), self._answer(j)
        if not others:
            return
        found = [self._on_the_way(one, self.ways[i], two, self.ways[j], self.ways[k]) for k in others]
        if all(answer is not None for answer in found):
            self.answers.update(zip(others, found, strict=True))  # type: ignore[arg-type]
            return
        middle = len(others) // 2
        self._between(i, others[:middle], others[middle])
        self._between(others[middle], others[middle + 1 :], j)

    def _on_the_way(self, one: _Answer, d: Array, two: _Answer, e: Array, way: Array) -> _Answer | None:
        """The answer where the straight line between two others is a limit; None where that is not certified."""
        p, q = one.size * d, two.size * e
        D = np.array([p, q]).T
        shares = np.linalg.lstsq(D, way, rcond=1e-9)[0]
        total = float(shares.sum())
        if shares.min() < -1e-12 or not total > 0.0 or np.abs(D @ shares - way).max() > 1e-9:
            return None
        size, shares = 1.0 / total, shares / total
        for side in (one, two):
            slope = float(side.a @ way)
            if slope > 0.0 and side.b / slope - size <= _SAME:
                return _Answer(size, side.b / slope, shares @ np.array([one.x, two.x]), side.motion, side.a, side.b)
        return None

    def _answer(self, i: int) -> _Answer:
        if i not in self.answers:
            self.answers[i] = self._solved(self.ways[i])
        return self.answers[i]

    def _program(self, way: Array, which: str) -> Support:
        """The "largest" or "smallest" push along a direction, as a program over weights and its size.

        Raises:
            NoSolution: it was not found, or there is no largest one.
        """
        self.programs += 1
        loads, (rows, low, high) = self.loads, self.loads.torque_rows
        program = Conic.of(
            {"forces": loads.block(), "push": Unknowns(1, lower=0.0, upper=self.most)},
            [({"forces": loads.A, "push": (self.B @ way)[:, None]}, loads.b)],
            [(rows | {"push": (self.P @ way)[:, None]}, low, high)],
        )
        found = farthest(program, np.append(np.zeros(loads.sets.size), 1.0 if which == "largest" else -1.0))
        if not (found.answer.solved or (which == "smallest" and found.answer.outcome is Outcome.INFEASIBLE)):
            raise NoSolution(f"{loads.state.robot.name}: the {which} push along {np.round(way, 3)} was not found.")
        return found

    def _smallest(self, way: Array) -> _Answer:
        found, still, none = self._program(way, "smallest"), np.zeros(self.loads.state.robot.nv), np.zeros(3)
        if not found.answer.solved:
            return _Answer(math.nan, math.nan, np.full(len(self.own.lower), math.nan), still, none, 0.0)
        return _Answer(float(found.answer["push"][0]), -found.value, found.answer["forces"], still, none, 0.0)

    def _solved(self, way: Array) -> _Answer:
        own, loads, robot = self.own, self.loads, self.loads.state.robot
        largest = self._program(way, "largest")
        found, motion = largest.answer, np.zeros(robot.nv)
        size, x = float(found["push"][0]), found["forces"]
        if size >= self.most - _SAME:  # nothing but the end of the search stops it
            return _Answer(self.most, self.most, x, motion, np.zeros(3), 0.0)
        motion[robot.unactuated] = -found.y / loads.row_size
        motion[robot.actuated[loads.limited]] = -found.z * loads.unit / loads.limit[loads.limited]
        a = -(self.B.T @ found.y) - self.P.T @ found.z
        b = bound(own, np.zeros(len(own.lower)), found.y, found.z)
        return _Answer(size, min(largest.value, self.most), x, motion, a, b)


def _gives_way(loads: ForceBalance, motion: Array, x: Array) -> tuple[Limit, ...]:
    robot = loads.state.robot
    whole = at_rest(*[r.cone for r in loads.rows])  # of which pyramids are made: velocities of its points are vectors
    velocity, rates = whole.G.T @ (loads.J @ motion), np.abs(motion[robot.actuated])
    if not motion.any():
        return ()
    largest = max(float(np.abs(velocity).max(initial=0.0)), float(rates.max(initial=0.0)), _MOVES * float(np.abs(motion).max()))
    found = [Limit("motor", robot.actuated_names[i]) for i in np.flatnonzero(rates > _MOVES * largest)]
    points: dict[int, list[tuple[bool, bool]]] = {}
    for e, ours in zip(whole.elements, loads.sets.elements, strict=True):
        if whole.is_line[e.columns].all() and not e.is_cone:
            continue  # held, whatever force that takes
        force = x[ours.columns] @ loads.sets.push[ours.columns] if e.is_cone else x[ours.columns]
        moves = bool(np.abs(velocity[e.columns]).max() > _MOVES * largest)
        points.setdefault(e.rows, []).append((moves, bool(np.abs(force[-1]) > _CARRIES)))
    opens = []
    for i, each in points.items():
        name = loads.rows[i].name
        if any(moves and carries for moves, carries in each):
            found.append(Limit("friction", name))
        elif all(moves for moves, _ in each):
            opens.append(Limit("push", name))
        elif any(moves for moves, _ in each):
            found.append(Limit("edge", name))
    if found or opens:
        return tuple(found or opens)
    moves = np.abs(motion) > _MOVES * np.abs(motion).max()  # against nothing: along smooth ground, say
    base = [joint for joint in robot.bases if moves[robot.model.joints[joint].idx_v :][:6].any()]
    idle = {joint.name for joint in robot.joints.values() if joint.name in robot.passive and moves[joint.v].any()}
    return tuple([Limit("base", robot.name)] * bool(base) + [Limit("passive", name) for name in sorted(idle)])


def _point_jacobian(state: State, frame: str, offset: Array) -> Array:
    return np.asarray(state.frame(frame, offset).J[:3])


def unit_directions(directions: Sequence[Sequence[float]] | Sequence[float] | Array) -> Array:
    """The directions with length one, shape (k, 3).

    Raises:
        InputError: what are none, or have no length.
    """
    given = np.atleast_2d(as_array("directions", directions))
    if given.ndim != 2 or given.shape[1] != 3 or not 0 < len(given) <= MOST_DIRECTIONS:
        raise InputError(f"directions have shape {given.shape}; expected (k, 3), 1 to {MOST_DIRECTIONS:,} of them, in W.")
    check_finite("directions", given)
    largest = np.abs(given).max(axis=1, keepdims=True)
    if not (largest > 0.0).all():
        raise InputError("a direction has no length; expected vectors in W, e.g. (0, 1, 0).")
    ways = given / largest
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))
