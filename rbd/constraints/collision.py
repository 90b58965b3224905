"""Contacts found from a robot's collision shapes, by the names of links and shapes: on a plane, and between bodies."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_number, cross_matrix, locked
from rbd.constraints.contact_kinematics import Between, OnPlane, Touching, joined
from rbd.constraints.contact_points import MARGIN, ContactPoints, Measured, Structure
from rbd.constraints.convex.convex_shapes import ConvexShape, convex_shape
from rbd.constraints.surface import (
    On,
    check_own_friction,
    check_state,
    check_words,
    cone_of,
    contact_axes,
    jump_of,
    out_along,
    plane_of,
)
from rbd.constraints.terrain.shapes import OnPieces
from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed
from rbd.errors import InputError, ModelError, nearest
from rbd.errors.inputs import listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.data_pool import RenewedLock
from rbd.model.state import State
from rbd.problem.cones import Cone, NonNegative, Product, check_friction
from rbd.problem.ground import FLOOR, TOUCHES, Ground, motion_of
from rbd.problem.rows import Patch, Rows

TOUCHES_M = 1e-4
"""Points with a gap up to this count as touching, by default: the residual gap of an iterated posture."""
_ON_PIECES = 10**9
"""Points between bodies are numbered from here on beside terrain, whose points get numbers as they appear."""
_MOST_STRUCTURES = 1000
"""Number of cached sets of points; tumbling shapes can have a new one at every step."""


@dataclass(frozen=True, eq=False)
class CollisionContacts(Displayed):
    """Contacts at all points where a robot's collision shapes touch a plane or each other, three rows a point.

    The points are computed at each state; where none is within the margin there are no rows. Boxes and meshes touch
    with their corners; balls, capsules and ellipsoids at their lowest points; cylinders and cones at the lowest points of their
    rims, and with eight corners of a nearly horizontal rim. A mesh counts as its convex hull. Of a hull with many corners
    near the plane the eight lowest get rows, and up to eight around them over which it could tip; of its flat faces with more
    than eight corners, eight. Two bodies touch at the corners of the intersection of two faces, or of a face and an edge, or at
    their nearest points.

    Row `error` is the gap along the normal, zero along tangents; `holonomic` marks the normals. `bias` is the second derivative
    of the gap and the first of the velocity along the plane, of round shapes too, whose contact point moves over the
    body. (Between bodies it is exact where a face, a ball or a corner of a ball's partner gives the normal; for crossing edges
    or sliding ones the contact point is taken as material, which neglects terms of sliding speed times angular velocity.)

    With the plane alone all points share its axes: `resultant` gives the wrench on the robot about the plane's point (by
    default W's origin), `patch` the corners. With `pairs` there is neither, and `solution.forces` has row forces; to have both
    kinds use one constraint for the ground and one, `ground=False`, for the pairs.

    Attributes:
        name: The role of all these contacts.
        robot: The robot whose `collision_model` is used; also a `Pair`.
        friction: Coulomb's coefficient; 0 gives one row a point.
        facets: Facets of each point's pyramid in a QP.
        ground: Whether there is a plane; or names of the only links or shapes that can touch it.
        pairs: Pairs of names of links or shapes that can touch each other; True: the collision pairs of
            `robot.collision_model`, or all bodies that no single joint connects where it has none.
        on: The plane of a ground that is at rest or moves without turning: `rbd.Ground(point=..., normal=..., motion=...)`, the
            height of a level one [m]; or `rbd.Terrain`.
        margin: Largest gap of points that get rows [m]. In `rbd.solve` all of them touch; a simulation uses a larger margin.
            Bodies that are inside each other by more than it, and more than 1 mm, get a `DistantContactWarning`; a simulation
            does not start from more than 1 cm.

    Raises:
        InputError: unknown names, with the nearest; a robot without shapes; a mesh that cannot be loaded; a friction
            that is negative or None; a plane without direction; a ground that turns.

    Example:
        >>> g1 = rbd.load_robot("g1")
        >>> ankles = ["left_ankle_roll_link", "right_ankle_roll_link"]
        >>> ground = rbd.CollisionContacts("ground", g1, friction=0.7, ground=ankles)
        >>> state = g1.standing()
        >>> ground.points(state).names[:2], ground.rows(state).J.shape  # eight balls touch, with three rows each
        (('left_ankle_roll_link_0:0', 'left_ankle_roll_link_1:0'), (24, 35))
    """

    name: str
    robot: CheckedModel
    friction: float
    facets: int
    ground: bool | tuple[str, ...]
    pairs: bool | tuple[tuple[str, str], ...]
    on: Ground | Terrain
    margin: float
    _point: Array = field(init=False, repr=False)
    _axes: Array = field(init=False, repr=False)
    _turn: Array = field(init=False, repr=False)
    _finder: _Finder = field(init=False, repr=False)
    _cone: Cone = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        robot: CheckedModel,
        *,
        friction: float = 0.7,
        facets: int = 4,
        ground: bool | Sequence[str] = True,
        pairs: bool | Sequence[tuple[str, str]] = False,
        on: On = 0.0,
        margin: float = TOUCHES_M,
    ) -> None:
        check_words("CollisionContacts", name=name)
        if friction is None:
            raise InputError(
                f"friction of {name!r:.80} is None; expected a number >= 0: contacts found from shapes are unilateral."
            )
        check_friction(friction, facets)
        terrain = on if isinstance(on, Terrain) else None
        plane_on = FLOOR if terrain else plane_of(name, on)
        if any(x[3:].any() for x in motion_of(plane_on)):
            raise InputError(
                f"the ground of {name!r:.80} turns; expected one at rest, or that moves without turning. On a turntable give "
                "contacts at points, rbd.PointContact, or soles."
            )
        margin, shapes = _checked_margin(name, margin), CollisionShapes(name, robot)
        low, both = shapes.on_ground(ground), shapes.pairs(pairs)
        if not low and not both:
            raise InputError(f"CollisionContacts {name!r:.80} has neither ground nor pairs: nothing can touch.")
        point, axes = np.asarray(plane_on.point), contact_axes(np.asarray(plane_on.normal))
        moving = plane_on if plane_on.moves else None
        plane = OnPlane(robot, low, axes, point, moving) if low and not terrain else None
        pieces = OnPieces(robot, low, terrain) if low and terrain else None
        first = len(plane.points.body) if plane is not None else _ON_PIECES if pieces is not None else 0
        if terrain and terrain.friction is not None:
            friction = terrain.friction
        finder = _Finder(plane, Between(robot, both, first) if both else None, pieces)
        self.__dict__.update(
            name=name, robot=robot, friction=float(friction), facets=int(facets), on=terrain or plane_on, margin=margin,
            ground=ground if isinstance(ground, bool) else tuple(ground),
            pairs=pairs if isinstance(pairs, bool) else tuple(tuple(pair) for pair in pairs),
            _point=point, _axes=axes, _turn=np.hstack([cross_matrix(e) for e in axes.T]),  # maps r to r x e of the three axes
            _finder=finder, _cone=_cone(float(friction), int(facets)),
        )  # fmt: skip

    def with_margin(self, margin: float) -> CollisionContacts:
        """The same contacts with another margin.

        Raises:
            InputError: a negative margin, or not a number.
        """
        return self._changed(margin=_checked_margin(self.name, margin), _finder=self._finder.another())

    def with_friction(self, mu: float) -> CollisionContacts:
        """The same contacts with another coefficient.

        Raises:
            InputError: on a terrain with a coefficient of its own.
        """
        check_own_friction(self.name, self.on, mu)
        return self._changed(friction=float(mu), _cone=_cone(float(mu), self.facets))

    def _changed(self, **changes: object) -> CollisionContacts:
        """The same with other fields, all of them given; the prepared shapes are reused."""
        out = object.__new__(CollisionContacts)
        out.__dict__.update(self.__dict__ | changes)
        return out

    def rows(self, state: State) -> Rows:
        """Three rows a point (tangent, tangent, normal), or the normal one alone without friction; none where no point is near.

        Raises:
            InputError: a state of another robot.
        """
        found = self._touching(state)
        k = len(found.gaps)
        error = np.zeros(3 * k)
        error[2::3] = found.gaps
        patch, kept, within, deep = None, self._kept, max(TOUCHES, self.margin), list[tuple[str, float]]()
        if self._scattered:
            some = np.flatnonzero(found.gaps < -within)
            ways = [out_along(found.each_axes[i][:, 2]) if found.pieces and found.pieces[i] else "" for i in some]
            deep = [(found.names[i] + way, -float(found.gaps[i])) for i, way in zip(some, ways, strict=True)]
        else:
            assert isinstance(self.on, Ground)
            r, on = found.positions - self._point, self.on.at(state.t)
            if self.on.carries and state.t:
                on = Ground(point=np.asarray(on.point) + self.on.shift(state.t), normal=on.normal, velocity=on.velocity)
            patch = Patch(self._point, self._axes, r @ self._axes, self.friction, on=on, within=within)
        J, bias, velocity = found.J[kept], found.bias[kept], found.velocity[kept]
        cone, held, resultant = _stacked(self._cone, k), _normals(k, bool(self.friction)), self._resultant(found)
        return Rows(
            self.name, J, bias, cone, velocity, error[kept], resultant=resultant, patch=patch, holonomic=held,
            overlaps=tuple(deep),
        )  # fmt: skip

    def points(self, state: State, t: float = 0.0) -> ContactPoints:
        """The points themselves, in the order of the rows; ground that moves is taken at the time of the state, whatever `t`.

        Raises:
            InputError: a state of another robot.
        """
        found, kept = self._touching(state), self._kept
        return ContactPoints(
            found.names, found.positions, found.each_axes, found.gaps, found.J[kept], found.velocity[kept], found.bias[kept],
            (self._cone,) * len(found.gaps), self._resultant(found),
        )  # fmt: skip

    @property
    def jump(self) -> Callable[[float, float], float | None] | None:
        """Gives a time in an interval at which its ground's motion jumps [s], None if there is none; None without a motion."""
        return jump_of(self.on)

    def source(self, start: State) -> CollisionPoints:
        """The points during a motion: all that are nearer than `MARGIN`.

        Raises:
            InputError: a state of another robot.
        """
        self._check(start)
        return CollisionPoints(self.with_margin(MARGIN))

    @property
    def _scattered(self) -> bool:
        """Whether points have axes of their own: with pairs, and on terrain."""
        return bool(self.pairs) or isinstance(self.on, Terrain)

    @property
    def _kept(self) -> slice:
        """Which of a point's three rows are used."""
        return slice(None) if self.friction else slice(2, None, 3)

    def _resultant(self, found: Touching) -> Array | None:
        """Map from row forces to the wrench on the robot about the plane's point; None with pairs and on terrain."""
        if self._scattered:
            return None
        k = len(found.gaps)
        resultant = np.empty((6, 3 * k))
        resultant[:3].reshape(3, k, 3)[:] = self._axes[:, None]
        resultant[3:] = ((found.positions - self._point) @ self._turn).reshape(3 * k, 3).T
        return resultant[:, self._kept]

    def _touching(self, state: State) -> Touching:
        self._check(state)
        return self._finder.at(state, self.margin)

    def _check(self, state: State) -> None:
        check_state(state, self.name)
        if not self.robot.is_like(state.robot):
            raise InputError(f"contacts {self.name!r:.80} are of {self.robot.name}; the state is of {state.robot.name}.")

    def __reduce__(self) -> tuple[object, ...]:
        """Copies are constructed by the class, in another process too."""
        words = ("friction", "facets", "ground", "pairs", "on", "margin")
        return _made, (self.name, self.robot, {word: getattr(self, word) for word in words})


class _Finder:
    """Computes the points at a state, one thread at a time; the last result is cached, for rows and points."""

    def __init__(self, plane: OnPlane | None, between: Between | None, pieces: OnPieces | None = None) -> None:
        self.plane, self.between, self.pieces = plane, between, pieces
        self._lock = RenewedLock()
        self._last: tuple[weakref.ref[State], float, Touching] | None = None

    def another(self) -> _Finder:
        """A copy with separate caches."""
        parts = (part and part.another() for part in (self.plane, self.between, self.pieces))
        return _Finder(*parts)  # type: ignore[arg-type]

    def at(self, state: State, margin: float) -> Touching:
        """All points within the margin."""
        last = self._last
        if last is not None and last[0]() is state and last[1] == margin:
            return last[2]
        with self._lock:
            low = None if self.plane is None else self.plane.at(state, margin)
            parts = [] if low is None else [low]
            parts += [] if self.pieces is None else self.pieces.at(state, margin)
            parts += [] if self.between is None else self.between.at(state, margin)
        found = joined(parts, self.label, state.robot.nv)
        self._last = weakref.ref(state), margin, found
        return found

    def label(self, number: int) -> str:
        """The name of a point."""
        if self.between is not None and number >= self.between.first_number:
            return self.between.label(number)
        if self.pieces is not None:
            return self.pieces.label(number)
        assert self.plane is not None
        return self.plane.label(number)


class CollisionPoints:
    """Source of the points near each other in a motion; each keeps its number, from 0 in the order of appearance."""

    group = None

    def __init__(self, contacts: CollisionContacts) -> None:
        self.contacts = contacts
        self._numbers: dict[int, int] = {}  # by the contacts' number
        self._seen: dict[tuple[bytes, tuple[str, ...]], Structure] = {}

    def at(self, state: State, t: float) -> Measured:
        """Its points at a state and its time."""
        contacts = self.contacts
        found, kept = contacts._touching(state), contacts._kept
        J = found.J[kept]
        return Measured(
            self._structure(found), J, found.velocity[kept], found.bias[kept], found.gaps, np.zeros(len(J)), None,
            None if contacts._scattered else found.positions - contacts._point, found.positions, found.axes,
        )  # fmt: skip

    def gaps(self, state: State, t: float) -> Array:
        """The gaps of `at`."""
        return self.contacts._touching(state).gaps

    def label(self, number: int) -> str:
        """The name of a point, which begins with its link, by its number in this motion."""
        return self.contacts._finder.label(list(self._numbers)[number])

    def _structure(self, found: Touching) -> Structure:
        """The same object for the same points on the same pieces."""
        points, key = found.numbers, (found.numbers.tobytes(), found.pieces)
        known = self._seen.get(key)
        if known is None:
            if len(self._seen) >= _MOST_STRUCTURES:
                self._seen.clear()
            contacts, k = self.contacts, len(points)
            own = tuple(self._numbers.setdefault(n, len(self._numbers)) for n in points.tolist())
            known = self._seen[key] = Structure((contacts.name,) * k, own, (contacts._cone,) * k, found.pieces)
        return known


def _made(name: str, robot: CheckedModel, given: dict[str, object]) -> CollisionContacts:
    return CollisionContacts(name, robot, **given)  # type: ignore[arg-type]


def _checked_margin(name: str, margin: float) -> float:
    return check_number(f"margin of {name!r:.80}", margin, 0.0, 1e6, expected="a length >= 0 [m]")


def _cone(friction: float, facets: int) -> Cone:
    """Force set of one point."""
    return cone_of("", np.zeros((1, 3)), friction, facets)


@lru_cache(maxsize=256)
def _stacked(cone: Cone, k: int) -> Cone:
    return NonNegative(k) if isinstance(cone, NonNegative) or not k else Product([cone] * k)


@lru_cache(maxsize=256)
def _normals(k: int, friction: bool) -> Array:
    return locked(np.tile([False, False, True], k) if friction else np.ones(k, bool))


class CollisionShapes:
    """The collision shapes of a robot, made convex on first use.

    Raises:
        InputError: not a robot, or one without collision shapes.
    """

    def __init__(self, name: str, robot: CheckedModel) -> None:
        found = getattr(robot, "collision_model", None) if isinstance(robot, CheckedModel) else None
        if not isinstance(found, pin.GeometryModel):
            raise InputError(f"CollisionContacts {name!r:.80} wants a robot second, got {robot!r:.80}: rbd.load_robot(name).")
        self.name, self.robot, self.model = name, robot, found
        self.objects = list(found.geometryObjects)
        self.stand_ins = frozenset(getattr(robot, "collision_stand_ins", frozenset()))
        self._made: dict[int, ConvexShape] = {}
        self._by_name: dict[str, list[int]] = {}
        for i, shape in enumerate(self.objects):
            for known in {str(shape.name), robot.model.frames[shape.parentFrame].name}:
                self._by_name.setdefault(known, []).append(i)
        if not self.objects:
            raise InputError(
                f"{robot.name} has no collision shapes, so it cannot touch anything. Give <collision> shapes in its file, or "
                "contacts at points: rbd.PointContact, rbd.SurfaceContact."
            )

    def on_ground(self, given: bool | Sequence[str]) -> list[ConvexShape]:
        """The shapes that can touch the ground, in the order of their joints.

        Args:
            given: True: those of all moving bodies; or names of links or shapes.

        Raises:
            InputError: unknown names, or shapes that cannot be loaded or are fixed to the world.
        """
        if given is False:
            return []
        if given is True:
            chosen = [i for i, shape in enumerate(self.objects) if shape.parentJoint > 0]
            if not chosen:
                raise InputError(f"all collision shapes of {self.robot.name} are fixed to the world; give ground=False.")
        else:
            chosen = sorted({i for known in self._words("ground", given) for i in self._named(known)})
            for i in chosen:
                if self.objects[i].parentJoint == 0:
                    raise InputError(f"{self.objects[i].name!r:.80} is fixed to the world and cannot move to the ground.")
        return sorted((self._shape(i) for i in chosen), key=lambda shape: shape.joint)

    def pairs(self, given: bool | Sequence[tuple[str, str]]) -> list[tuple[ConvexShape, ConvexShape]]:
        """The pairs of shapes that can touch each other.

        Args:
            given: Pairs of names of links or shapes; True: the collision pairs of `robot.collision_model` where it has some,
                else all shapes of bodies that no single joint connects.

        Raises:
            InputError: unknown names, shapes that cannot be loaded, shapes of one body.
        """
        if given is False:
            return []
        if given is True:
            listed = [(int(p.first), int(p.second)) for p in self.model.collisionPairs]
            every = listed or [pair for pair in combinations(range(len(self.objects)), 2) if not self._neighbours(*pair)]
        else:
            every = []
            for pair in self._listed("pairs", given):
                words = self._words("a pair", pair)
                if len(words) != 2:
                    raise InputError(f"a pair of contacts {self.name!r:.80} is {pair!r:.80}; expected two names.")
                one, other = (self._named(known) for known in words)
                for i in one:
                    for j in other:
                        if self.objects[i].parentJoint == self.objects[j].parentJoint:
                            raise InputError(
                                f"{words[0]!r:.80} and {words[1]!r:.80} are of one body of {self.robot.name}; expected "
                                "names of two that move against each other."
                            )
                        every.append((i, j))
        return [(self._shape(i), self._shape(j)) for i, j in dict.fromkeys(every)]

    def _neighbours(self, i: int, j: int) -> bool:
        one, other = int(self.objects[i].parentJoint), int(self.objects[j].parentJoint)
        parents = self.robot.model.parents
        return one == other or (one > 0 and parents[one] == other) or (other > 0 and parents[other] == one)

    def _named(self, known: str) -> list[int]:
        found = self._by_name.get(known)
        if found is None:
            raise InputError(
                f"no link or collision shape {known!r:.80} in {self.robot.name}; {nearest(known, self._by_name)}. See "
                "[s.name for s in robot.collision_model.geometryObjects]."
            )
        return found

    def _shape(self, i: int) -> ConvexShape:
        if i not in self._made:
            shape = self.objects[i]
            without = "Leave it out: ground=[names of links that may touch], pairs=[(name, name)]."
            if shape.name in self.stand_ins:
                raise InputError(
                    f"the mesh of collision shape {shape.name!r:.80} of {self.robot.name} was not found, and the box in its "
                    "place is no shape to touch. Give the folder of its packages, load_robot(..., package_dirs=[folder]). "
                    f"{without}"
                )
            try:
                self._made[i] = convex_shape(shape)
            except ModelError as error:
                raise InputError(f"collision shape {shape.name!r:.80} of {self.robot.name} {error}. {without}") from None
        return self._made[i]

    def _words(self, what: str, given: Iterable[str]) -> list[str]:
        out = self._listed(what, given)
        if not all(isinstance(known, str) for known in out):
            raise InputError(f"{what} of contacts {self.name!r:.80} is {given!r:.80}; expected names of links or shapes.")
        return out

    def _listed(self, what: str, given: Iterable[str] | Iterable[tuple[str, str]]) -> list[Any]:
        expected = "a list" if isinstance(given, str | bytes) else "True or a list"
        return listed_items(f"{what} of contacts {self.name!r:.80}", given, expected)
