"""Contacts found from a robot's collision shapes: on a plane, and between bodies."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, as_float, as_vector3, cross_matrix
from rbd.constraints.collision_shapes import CollisionShapes
from rbd.constraints.contact_geometry import check_state, contact_axes, unit_normal
from rbd.constraints.touching import Between, Bodies, OnPlane, Touching, joined
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.forks import renewed_after_fork
from rbd.model.state import State
from rbd.problem.cones import Cone, FrictionCone, NonNegative, Product, check_friction
from rbd.problem.ground import TOUCHES, Ground
from rbd.problem.rows import Patch, Rows

TOUCHES_M = 1e-4
"""Points with a gap up to this count as touching, by default: what a posture found by iteration leaves open."""


class ContactPoints(NamedTuple):
    """k points where shapes touch, or are within the margin.

    Attributes:
        names: What stays with a point over time, "left_sole_link_0:3": corner 3 of that shape.
        positions: In W, shape (k, 3) [m].
        axes: R_WC (tangent, tangent, normal) of each, shape (k, 3, 3); the normal pushes the (first) body away.
        gaps: Distance along the normal, shape (k,) [m]; negative where shapes overlap.
    """

    names: tuple[str, ...]
    positions: Array
    axes: Array
    gaps: Array


@dataclass(frozen=True, eq=False)
class CollisionContacts:
    """Every point where a robot's collision shapes touch a plane or each other: three rows a point, in a friction cone.

    Which points there are is found at each state; where nothing is within the margin there are no rows. Boxes and meshes touch
    with their corners; balls, capsules and ellipsoids at their lowest points; cylinders and cones at the lowest points of their
    rims, and with eight corners of a rim that lies nearly flat. A mesh counts as its convex hull. Of a hull with many corners
    near the plane the eight lowest get rows, and up to eight around them that it would tip onto; of its flat faces with more
    than eight corners, eight. Two bodies touch at the corners of what two faces, or a face and an edge, have in common, or at
    their nearest points.

    Row `error` is the gap along the normal, zero along tangents; `holonomic` marks the normals. `bias` is the second derivative
    of the gap and the first of the velocity along the plane, of round shapes too: there the place of contact wanders over the
    body. (Between bodies it is exact where a face, a ball or a corner of a ball's partner gives the normal; of edges that cross
    or slide over each other it takes the place for material, which leaves out terms of sliding speed times angular velocity.)

    With the plane alone all points share its axes: `resultant` gives the wrench on the robot about `point` (by default W's
    origin), `patch` the corners. With `pairs` there is neither, and `solution.forces` has row forces: for both kinds give one
    constraint for the ground and one, `ground=False`, for the pairs.

    Attributes:
        name: The role of all these contacts together.
        robot: The robot whose `collision_model` is used; a `Pair` is one too.
        friction: Coulomb's coefficient; 0 gives one row a point.
        facets: Facets of each point's pyramid in a QP.
        ground: Whether there is a plane; or names of the links or shapes that alone may touch it.
        pairs: Pairs of names of links or shapes that may touch each other; True: the collision pairs of
            `robot.collision_model`, or all bodies that no single joint connects where it has none.
        point: Of the plane, in W, shape (3,) [m].
        normal: Of the plane, out of the ground, a unit vector in W, shape (3,).
        margin: Largest gap of points that get rows [m]. At an acceleration all of them touch; a simulation sees farther.

    Raises:
        InputError: names that are not there, with the nearest; a robot without shapes; a mesh that cannot be had; a friction
            that is negative or None; a plane without direction.

    >>> solution = rbd.solve(state, tau, [rbd.CollisionContacts("ground", robot, friction=0.7)])
    """

    name: str
    robot: CheckedModel
    friction: float
    facets: int
    ground: bool | tuple[str, ...]
    pairs: bool | tuple[tuple[str, str], ...]
    point: Array
    normal: Array
    margin: float
    _axes: Array = field(repr=False)
    _ground: Ground = field(repr=False)
    _turn: Array = field(repr=False)
    _finder: _Finder = field(repr=False)
    _cone: Cone = field(repr=False)

    def __init__(
        self,
        name: str,
        robot: CheckedModel,
        *,
        friction: float = 0.7,
        facets: int = 4,
        ground: bool | Sequence[str] = True,
        pairs: bool | Sequence[tuple[str, str]] = False,
        point: Sequence[float] | Array = (0.0, 0.0, 0.0),
        normal: Sequence[float] | Array = (0.0, 0.0, 1.0),
        margin: float = TOUCHES_M,
    ) -> None:
        if not isinstance(name, str) or not name:
            raise InputError(f"the name of CollisionContacts is {name!r:.80}; expected a word, e.g. 'ground'.")
        if friction is None:
            raise InputError(f"friction of {name!r:.80} is None; expected a number >= 0: shapes that collide do not hold on.")
        check_friction(friction, facets)
        put = object.__setattr__
        put(self, "name", name)
        put(self, "robot", robot)
        put(self, "friction", float(friction))
        put(self, "facets", int(facets))
        put(self, "point", as_vector3(f"point of {name!r:.80}", point))
        put(self, "normal", unit_normal(name, normal))
        put(self, "margin", _checked_margin(name, margin))
        shapes = CollisionShapes(name, robot)
        low, both = shapes.on_ground(ground), shapes.pairs(pairs)
        if not low and not both:
            raise InputError(f"CollisionContacts {name!r:.80} has neither ground nor pairs: nothing can touch.")
        put(self, "ground", ground if isinstance(ground, bool) else tuple(ground))
        put(self, "pairs", pairs if isinstance(pairs, bool) else tuple(tuple(pair) for pair in pairs))
        bodies = Bodies(robot)
        put(self, "_axes", contact_axes(np.asarray(self.normal)))
        put(self, "_ground", Ground(point=self.point, normal=self.normal))
        put(self, "_turn", np.hstack([cross_matrix(e) for e in self._axes.T]))  # takes r to r x e of the three axes
        plane = OnPlane(robot, bodies, low, self._axes, np.asarray(self.point)) if low else None
        put(self, "_finder", _Finder(robot, plane, Between(robot, bodies, both) if both else None))
        put(self, "_cone", FrictionCone(self.friction, self.facets) if self.friction else NonNegative(1))

    def with_margin(self, margin: float) -> CollisionContacts:
        """The same contacts seen from farther off, or less far.

        Raises:
            InputError: a margin that is no length.
        """
        out = object.__new__(CollisionContacts)
        out.__dict__.update(self.__dict__ | {"margin": _checked_margin(self.name, margin)})
        out.__dict__["_finder"] = self._finder.another()
        return out

    def rows(self, state: State) -> Rows:
        """Three rows a point (tangent, tangent, normal), or the normal one alone without friction; none where nothing is near.

        Raises:
            InputError: a state of another robot.
        """
        found = self._touching(state)
        k = len(found.gaps)
        if not k:
            return self._nothing(state)
        error = np.zeros(3 * k)
        error[2::3] = found.gaps
        resultant, patch = None, None
        if not self.pairs:
            r = found.positions - self.point
            resultant = np.empty((6, 3 * k))
            resultant[:3].reshape(3, k, 3)[:] = self._axes[:, None]
            resultant[3:] = (r @ self._turn).reshape(3 * k, 3).T
            within = max(TOUCHES, self.margin)
            patch = Patch(self.point, self._axes, r @ self._axes, self.friction, on=self._ground, within=within)
        J, bias, velocity = found.J, found.bias, found.velocity
        if not self.friction:
            J, bias, velocity, error = J[2::3], bias[2::3], velocity[2::3], error[2::3]
            resultant = None if resultant is None else resultant[:, 2::3]
        cone, held = _stacked(self._cone, k), _normals(k, bool(self.friction))
        return Rows(self.name, J, bias, cone, velocity, error, resultant=resultant, patch=patch, holonomic=held)

    def points(self, state: State) -> ContactPoints:
        """The points themselves, in the order of the rows.

        Raises:
            InputError: a state of another robot.
        """
        found = self._touching(state)
        return ContactPoints(found.names, found.positions, found.axes, found.gaps)

    def _touching(self, state: State) -> Touching:
        check_state(state, self.name)
        if state.robot is not self.robot and state.robot.model != self.robot.model:
            raise InputError(f"contacts {self.name!r:.80} are of {self.robot.name}; the state is of {state.robot.name}.")
        return self._finder.at(state, self.margin)

    def _nothing(self, state: State) -> Rows:
        nv = state.robot.nv
        if self.pairs:
            return Rows(self.name, np.zeros((0, nv)), np.zeros(0), NonNegative(0))
        patch = Patch(self.point, self._axes, np.zeros((0, 3)), self.friction)
        return Rows(self.name, np.zeros((0, nv)), np.zeros(0), NonNegative(0), resultant=np.zeros((6, 0)), patch=patch)

    def __reduce__(self) -> tuple[object, ...]:
        """Copies are made anew, in another process too."""
        words = ("friction", "facets", "ground", "pairs", "point", "normal", "margin")
        return _made, (self.name, self.robot, {word: getattr(self, word) for word in words})


class _Finder:
    """Finds the points at a state; one thread at a time. What it found last it gives again: rows, then points."""

    def __init__(self, robot: CheckedModel, plane: OnPlane | None, between: Between | None) -> None:
        self.robot, self.plane, self.between = robot, plane, between
        self._lock = threading.Lock()
        self._data = (robot.model if plane is None else plane.model).createData()
        self._last: tuple[weakref.ref[State], float, Touching] | None = None
        renewed_after_fork(self)

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock."""
        self._lock = threading.Lock()

    def another(self) -> _Finder:
        """One that remembers on its own."""
        return _Finder(self.robot, self.plane, self.between)

    def at(self, state: State, margin: float) -> Touching:
        """All points within the margin."""
        last = self._last
        if last is not None and last[0]() is state and last[1] == margin:
            return last[2]
        with self._lock:
            parts = [] if self.plane is None else self.plane.at(state, self._data, margin)
            parts += [] if self.between is None else self.between.at(state, self._data, margin)
        found = joined(parts, state.robot.nv)
        self._last = weakref.ref(state), margin, found
        return found


def _made(name: str, robot: CheckedModel, given: dict[str, object]) -> CollisionContacts:
    return CollisionContacts(name, robot, **given)  # type: ignore[arg-type]


def _checked_margin(name: str, margin: float) -> float:
    if not 0.0 <= as_float(margin) < 1e6:
        raise InputError(f"margin of {name!r:.80} is {margin!r:.80}; expected a length >= 0 [m].")
    return float(margin)


@lru_cache(maxsize=256)
def _stacked(cone: Cone, k: int) -> Cone:
    return NonNegative(k) if isinstance(cone, NonNegative) else Product([cone] * k)


@lru_cache(maxsize=256)
def _normals(k: int, rubs: bool) -> Array:
    out = np.tile([False, False, True], k) if rubs else np.ones(k, bool)
    out.flags.writeable = False
    return out
