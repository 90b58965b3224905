"""`push_limits`: an inner and an outer bound of how large pushes may be so that every member of a set is held.

Each inner end is a set that is proved to be held, each outer one a member that is proved not to be: the truth is between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rbd.arrays import Array, check_number, check_positive, check_whole, lazy
from rbd.constraints.constraint import Constraint, listed
from rbd.displayed import Displayed, drawing
from rbd.errors import CannotHold, NoSolution
from rbd.errors.inputs import check_choice
from rbd.model.state import State, checked
from rbd.records import Field, counted, vector
from rbd.robust.holding import BEHIND, TORQUES, Counterexample, RobustHold, at_pose, counterexample, decided, held_behind
from rbd.robust.pose_bounds import Boxed
from rbd.robust.poses import GivenSet
from rbd.robust.program import Repair, Way, largest
from rbd.robust.proofs import Prover, worst_along
from rbd.robust.sets import Boxes, Masses, PushSet
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.statics.pushes import unit_directions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_BEYOND = (1e-8, 1e-6, 1e-4)
"""Shares by which what is refuted is beyond what a program in floating point finds, tried one after the other."""
_HALVINGS = 8
"""Of what is between both ends, where the set may be split."""
_NEAR = 1e-3
"""Of the outer end: nearer ends are not halved."""


@dataclass(frozen=True, eq=False)
class RobustPushLimits(Displayed):
    """The pushes in each direction that every member of a set withstands, from inside and from outside.

    Attributes:
        state: The pose.
        frame: Frame of the robot that is pushed.
        offset: Where, from the frame's origin in the frame's axes, shape (3,) [m].
        directions: Unit vectors in W, shape (k, 3).
        inner: Pushes from none to this are proved to be withstood by every member, shape (k,) [N].
        outer: Beyond this a member is proved not to withstand it, shape (k,) [N]; `at_most` where none was found.
        holds: The proof of each inner end; where that is zero, of the robot without a push.
        counterexamples: The proof of each outer end; None where it is `at_most`.
        at_most: Larger pushes were not looked for [N].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), friction=0.5)
        >>> state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        >>> limits = rbd.robust.push_limits(state, [sole], "box", [(1, 0, 0), (0, 1, 0)], mass={"box": 0.1})
        >>> limits.inner.round(3), limits.outer.round(3)  # 0.5 x 9 kg x 9.81 m/s2
        (array([44.145, 44.145]), array([44.145, 44.145]))
    """

    state: State
    frame: str
    offset: Array
    directions: Array
    inner: Array
    outer: Array
    holds: tuple[RobustHold, ...]
    counterexamples: tuple[Counterexample | None, ...]
    at_most: float

    fields: ClassVar[tuple[Field, ...]] = (
        Field("inner", ("direction",), "N", "every member withstands pushes up to this: proved"),
        Field("outer", ("direction",), "N", "beyond this a member does not: proved"),
        Field(
            "push_direction", ("direction", "axis"), "1", "unit vector of each direction, in W",
            lambda x: x.directions, default=False,
        ),
    )  # fmt: skip

    @property
    def point(self) -> Array:
        """Where the push acts, in W, shape (3,) [m]."""
        return np.array(self.state.frame(self.frame, self.offset).X_WF.translation)

    def plot(self, ax: Axes) -> list[Artist]:
        """Draw both outlines from above: see `rbd.visual.plot_pushes`."""
        return drawing("plot_pushes")(ax, self)

    def __str__(self) -> str:
        i, size = int(np.argmin(self.inner)), float(self.inner.min())
        return (
            f"pushed at {self.frame} in {counted(len(self.inner), 'direction')}: every member withstands {size:.5g} N, "
            f"the least along {vector(self.directions[i], 2)}; there a member withstands no more than {self.outer[i]:.5g} N."
        )


def push_limits(
    state: State,
    contacts: Sequence[Constraint],
    frame: str,
    directions: Sequence[Sequence[float]] | Sequence[float] | Array,
    *,
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
    at_most: float = 1e4,
    friction: float | Mapping[str, float] | None = None,
    mass: Masses = None,
    com: Boxes = None,
    joints: Boxed | None = None,
    torques: str = "each",
    margin: float = 0.0,
    loops: bool = True,
    most_parts: int = 1,
) -> RobustPushLimits:
    """The largest push in each direction that every member of a set withstands, with proofs of both sides.

    The inner end is what one affine correction of forces proves, so that it may stay behind the truth; with `most_parts` the
    set may be split, and the inner end is halved towards the outer one. The outer end is the largest push of the worst member
    that a search over corners finds.

    Args:
        state: The pose; v must be zero.
        contacts: What the robot stands on, at least one.
        frame: Frame of the robot that is pushed.
        directions: In W, shape (3,) or (k, 3); their lengths do not count.
        offset: Where the push acts, from the frame's origin in the frame's axes [m].
        at_most: Larger pushes are not looked for [N].
        friction: As of `rbd.robust.hold`.
        mass: As of `rbd.robust.hold`.
        com: As of `rbd.robust.hold`.
        joints: As of `rbd.robust.hold`: a box of poses.
        torques: As of `rbd.robust.hold`: "one" is sent along a direction whatever the push, "affine" is a law of its size, for
            each direction another one.
        margin: What every member keeps to each limit [N, N m].
        loops: Whether the robot's own loops hold.
        most_parts: Into how many parts the set may be split, for torques of each. More take longer: each of up to eight steps
            towards the outer end is a proof of `rbd.robust.hold`.

    Raises:
        CannotHold: a member cannot be held without a push; `rbd.robust.hold` returns it.
        NoSolution: a program was not solved, or a proof not found.
        InputError: as of `rbd.robust.hold`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> limits = rbd.robust.push_limits(solo.standing(), solo.feet(friction=0.7), "base_link", (1, 0, 0), mass=0.05)
        >>> rbd.statics.push_limits(solo.standing(), solo.feet(friction=0.7), "base_link", (1, 0, 0)).forces.round(2)
        array([17.17])
        >>> limits.inner.round(2), limits.outer.round(2)
        (array([16.31]), array([16.31]))
    """
    most, ways = check_positive("at_most", at_most, 1e9), unit_directions(directions)
    kept = check_number("margin", margin, 0.0, 1e9, expected="a force [N], zero or more")
    check_choice("torques", torques, TORQUES)
    parts = check_whole("most_parts", most_parts, 100_000, least=1)
    given = GivenSet(state, listed(contacts), None, friction, mass, com, joints, loops)
    at = np.asarray(PushSet(frame, np.zeros(3), offset).offset)
    checked(state).frame(frame, at)  # refuse one that is not there
    alone = decided(given, torques, kept, parts)
    if isinstance(alone, Counterexample):
        one = f"a member cannot be held without a push, {alone.members[0]}."
        raise CannotHold(f"{state.robot.name}: {one if torques == 'each' else f'without a push, {alone}'}")
    inner, outer, holds, against = list[float](), list[float](), list[RobustHold](), list[Counterexample | None]()
    for way in ways:
        line = _Line(given, frame, way, at, torques, kept)
        (size, proof), (end, found) = line.inner(most), line.outer(most)
        if torques == "each" and parts > 1:
            size, proof, end, found = line.halved(size, proof, end, found, parts)
        inner.append(size)
        holds.append(proof or alone)
        outer.append(end)
        against.append(found)
    return RobustPushLimits(state, frame, at, ways, np.array(inner), np.array(outer), tuple(holds), tuple(against), most)


@dataclass(frozen=True, eq=False)
class _Line:
    """Pushes along one direction, from none on.

    Attributes:
        given: The set without a push.
        frame: Where it acts.
        way: Direction in W, shape (3,).
        offset: From the frame's origin [m].
        torques: As of `push_limits`.
        margin: What is kept.
    """

    given: GivenSet
    frame: str
    way: Array
    offset: Array
    torques: str
    margin: float

    def at(self, size: float) -> GivenSet:
        """The set with pushes from none to this size [N]."""
        return replace(self.given, pushes=PushSet(self.frame, np.outer([0.0, size], self.way), self.offset))

    @lazy
    def _ends(self) -> tuple[UncertainLoads, Way, Array]:
        """(loads without a push, what one as large as the weight adds, the pushes of both ends then)."""
        still = self.at(0.0).whole
        pushed = self.at(still.balance.unit).whole
        return still, Way.between(still, pushed), pushed.components

    def inner(self, most: float) -> tuple[float, RobustHold | None]:
        """(how far every member is proved to be held in one part, the proof); (0, None) where nothing is."""
        (L, way, pushes), U = self._ends, self._ends[0].balance.unit
        corners, turns = L.corners, L.turns
        if self.torques == "each":  # no push has nothing in common with one
            corners, way, turns = corners[1:], way.of_corner(1), {i: (S, own[1:]) for i, (S, own) in turns.items()}
        found = U * largest(
            L, corners, L.columns, self.torques, components=pushes, margin=self.margin, ways=way, at_most=most / U,
            turns=turns, repair=Repair.of(L, turns),
        ).value  # fmt: skip
        if not found > 0.0:
            return 0.0, None

        def less(share: float) -> float:
            return max(found * (1.0 - share) - share * U, 0.0)

        shares = [share for share in BEHIND if less(share) > 0.0]
        proved = held_behind(lambda share: self.at(less(share)), self.torques, self.margin, shares=shares)
        return (0.0, None) if proved is None else (less(proved[0]), proved[1])

    def outer(self, most: float) -> tuple[float, Counterexample | None]:
        """(beyond what a member is not held, the proof); (most, None) where none is found."""
        (L, way, pushes), U = self._ends, self._ends[0].balance.unit
        members, found = worst_along(L, np.ones(1, int), self.margin, way, None, most / U, self.torques, pushes)
        if L.turns and self.torques == "each":  # a pose alone has no bounds over a box
            where = self.given.pose_of(L.member(*members[0]))
            size, against = replace(self, given=self.given.at_pose(where)).outer(most)
            return size, None if against is None else at_pose(against, where)
        for share in _BEYOND:
            size = found.value * U * (1.0 + share) + share * U
            if not 0.0 <= size <= most:
                break
            prover = Prover(self.at(size).whole, self.torques)
            if (proof := prover.contradiction(members, found.velocities, self.margin)) is not None:
                return size, counterexample(prover, proof, self.margin)
        return most, None

    def halved(
        self, size: float, proof: RobustHold | None, end: float, found: Counterexample | None, parts: int
    ) -> tuple[float, RobustHold | None, float, Counterexample | None]:
        """Both ends, nearer to each other by what is proved, or refuted, between them in some parts."""
        undecided = end
        for _ in range(_HALVINGS):
            if undecided - size <= _NEAR * end:
                break
            middle = 0.5 * (size + undecided)
            undecided_before, undecided = undecided, middle
            with suppress(NoSolution):
                answer = decided(self.at(middle), self.torques, self.margin, parts)
                if isinstance(answer, Counterexample):
                    end, found = middle, answer
                else:
                    size, proof, undecided = middle, answer, undecided_before
        return size, proof, end, found
