"""The collision shapes of a robot, by the names of links and shapes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import pinocchio as pin

from rbd.constraints.convex.solids import ConvexShape, convex_shape
from rbd.errors import InputError, ModelError, nearest
from rbd.model.checked_model import CheckedModel


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
        if isinstance(given, str | bytes):
            raise InputError(f"{what} of contacts {self.name!r:.80} is {given!r:.80}; expected a list.")
        try:
            return list(given)
        except TypeError:
            raise InputError(f"{what} of contacts {self.name!r:.80} is {given!r:.80}; expected True or a list.") from None
