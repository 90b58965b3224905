"""`push_limits`: an inner and an outer bound of how large pushes may be so that every member of a set is held.

Each inner end is a set that is proved to be held, each outer one a member that is proved not to be: the truth is between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rbd.arrays import Array, check_number, check_positive
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed, drawing
from rbd.errors import CannotHold, NoSolution
from rbd.model.state import State
from rbd.records import Field, vector
from rbd.robust.holding import Counterexample, RobustHold, counterexample, decided, held_behind
from rbd.robust.program import largest
from rbd.robust.proofs import Prover, worst_along
from rbd.robust.sets import Boxes, Masses, PushSet
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.statics.pushes import unit_directions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_BEYOND = (1e-8, 1e-6, 1e-4)
"""Shares by which what is refuted is beyond what a program in floating point finds, tried one after the other."""


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
        i = int(np.argmin(self.inner))
        return (
            f"pushed at {self.frame} in {len(self.inner)} directions: every member withstands at least {self.inner[i]:.4g} N, "
            f"the least along {vector(self.directions[i], 2)}, where beyond {self.outer[i]:.4g} N a member does not."
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
    margin: float = 0.0,
    loops: bool = True,
) -> RobustPushLimits:
    """The largest push in each direction that every member of a set withstands, with proofs of both sides.

    Each member has torques of its own. The inner end is what one affine correction of forces proves, so that it may stay behind
    the truth; the outer end is the largest push of the worst member that a search over corners finds.

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
        margin: What every member keeps to each limit [N, N m].
        loops: Whether the robot's own loops hold.

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
    still = UncertainLoads.of(state, contacts, None, friction, mass, com, loops)
    J = state.frame(frame, offset).J[:3]
    alone = decided(Prover(still, "each"), kept, 1)
    if isinstance(alone, Counterexample):
        raise CannotHold(f"{state.robot.name}: a member cannot be held without a push, {alone.members[0]}.")
    inner, outer, holds, against = list[float](), list[float](), list[RobustHold](), list[Counterexample | None]()
    for way in ways:
        line = _Line(still, J.T @ way, PushSet(frame, np.vstack([np.zeros(3), way]), offset), kept)
        size, proof = line.inner(most)
        inner.append(size)
        holds.append(proof or alone)
        end, found = line.outer(most)
        outer.append(end)
        against.append(found)
    at = np.asarray(PushSet(frame, np.zeros((1, 3)), offset).offset)
    return RobustPushLimits(state, frame, at, ways, np.array(inner), np.array(outer), tuple(holds), tuple(against), most)


@dataclass(frozen=True, eq=False)
class _Line:
    """Pushes along one direction, from none on.

    Attributes:
        still: The loads without a push.
        pushed: Generalised force of a push of one newton, shape (nv,).
        unit: No push and that one, as a set.
        margin: What is kept.
    """

    still: UncertainLoads
    pushed: Array
    unit: PushSet
    margin: float

    def inner(self, most: float) -> tuple[float, RobustHold | None]:
        """(how far every member is proved to be held, the proof)."""
        L, U = self.still, self.still.balance.unit
        corners = np.repeat(L.corners, 2, axis=0)
        way = np.vstack([np.zeros_like(self.pushed), -self.pushed * U]), np.zeros_like(L.columns)
        found = largest(L, corners, L.columns, margin=self.margin, ways=way, at_most=most / U).value * U
        if not np.isfinite(found):
            raise NoSolution(f"{L.state.robot.name}: the largest push along a direction was not found.")

        def less(share: float) -> float:
            return max(found * (1.0 - share) - share * U, 0.0)

        proved = held_behind(lambda share: self.at([0.0, less(share)]), self.margin)
        return (0.0, None) if proved is None or not less(proved[0]) else (less(proved[0]), proved[1])

    def outer(self, most: float) -> tuple[float, Counterexample | None]:
        """(beyond what a member is not held, the proof); (most, None) where none is found."""
        L, U = self.still, self.still.balance.unit
        t, found = worst_along(L, np.zeros(1, int), self.margin, (-self.pushed * U)[None], None, most / U)[1:]
        for share in _BEYOND:
            size = found.value * U * (1.0 + share) + share * U
            if size > most:
                break
            prover = Prover(self.at([0.0, size]), "each")
            if (proof := prover.contradiction([(1, t)], found.velocities, self.margin)) is not None:
                return size, counterexample(prover, proof, self.margin)
        return most, None

    def at(self, sizes: list[float]) -> UncertainLoads:
        """The set of loads with pushes of these sizes [N]."""
        components = np.outer(sizes, np.asarray(self.unit.corners)[1])
        corners = self.still.corners - np.outer(sizes, self.pushed)
        pushes = (PushSet(self.unit.frame, components, self.unit.offset),)
        return replace(self.still, corners=corners, components=components, pushes=pushes)
