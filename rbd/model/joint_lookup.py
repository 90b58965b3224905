"""Parts of q, v and tau of several joints by their names or a pattern, and the joint of an entry."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from rbd.arrays import Array, as_array
from rbd.errors import DuplicateName, InputError, JointNotFound, nearest

if TYPE_CHECKING:
    Names = str | Iterable[str]
    """Names of joints or of single entries, or patterns of such names with *, ? and [...]."""


class PlacedCoordinates(Protocol):
    """What is known of a joint here."""

    name: str
    q: slice
    v: slice
    positions: tuple[Any, ...]
    velocities: tuple[Any, ...]

    def coordinate(self, q: Array) -> float:
        """Its angle or displacement."""


J = TypeVar("J", bound=Any)


class JointLookup(Mapping[str, J]):
    """The part of the joint table that finds entries of q, v, a and tau by name, and names by entry.

    Attributes:
        actuated: Indices in v of the entries with a motor, in the order of tau, shape (nu,).
    """

    actuated: Array = np.zeros(0, int)
    _robot: str

    def q_of(self, names: Names) -> Array:
        """Indices in q of some joints, in the order of the names, shape (k,): `q[robot.joints.q_of(["hip", "knee"])]`.

        A continuous joint has two entries, its cosine and sine: see `coordinates`, and `State.with_joints` to set its angle.

        Args:
            names: Joints; single entries, "root_joint.z"; or patterns of such names with *, ? and [...], "left_leg_*", which
                stand for all that match, in the order of the table. What is found twice counts once.

        Raises:
            JointNotFound: a name or a pattern that nothing has, with the nearest names.
            DuplicateName: a name is given twice.
            InputError: not names.

        Example:
            >>> solo = rbd.load_robot("solo12")
            >>> state = solo.standing()
            >>> state.q[solo.joints.q_of(["FL_HFE", "FL_KFE"])], solo.joints.q_of("root_joint.z")
            (array([ 0.8, -1.6]), array([2]))
        """
        return self._indices(names, "q", "positions")

    def v_of(self, names: Names) -> Array:
        """Indices in v of some joints, shape (k,), also of accelerations and generalised forces; arguments as `q_of`.

        Example:
            >>> solo = rbd.load_robot("solo12")
            >>> v = np.zeros(solo.nv)
            >>> v[solo.joints.v_of("*_KFE")] = 0.5  # all four knees
            >>> solo.joints.v_of("*_KFE")
            array([ 8, 11, 14, 17])
        """
        return self._indices(names, "v", "velocities")

    def tau_of(self, names: Names) -> Array:
        """Indices in tau of some joints' motors, shape (k,); arguments as `q_of`. Patterns leave out joints without a motor.

        Raises:
            InputError: a joint without a motor, by its name.

        Example:
            >>> solo = rbd.load_robot("solo12")
            >>> tau = np.zeros(solo.nu)
            >>> tau[solo.joints.tau_of(["FL_KFE", "FR_KFE"])] = 1.0, -1.0
            >>> solo.joints.tau_of("F?_KFE")
            array([2, 5])
        """
        given = _listed(names)
        entries = self._indices(given, "v", "velocities")
        motor = {int(i): k for k, i in enumerate(self.actuated)}
        plain = {int(i) for i in self._indices([n for n in given if not _is_pattern(n)], "v", "velocities")}
        idle = [int(i) for i in entries if i not in motor]
        for i in idle:
            if i in plain or len(idle) == len(entries):
                raise InputError(
                    f"joint {self.at_v(i).name!r:.80} of {self._robot} has no motor, and so no entry in tau; expected "
                    "joints of robot.actuated_names."
                )
        return np.array([motor[int(i)] for i in entries if int(i) in motor], int)

    def matching(self, names: Names) -> tuple[str, ...]:
        """Names of the joints that names or patterns stand for, in order; arguments and errors as `q_of`.

        Example:
            >>> rbd.load_robot("solo12").joints.matching("FL_*")
            ('FL_HAA', 'FL_HFE', 'FL_KFE')
        """
        return tuple(dict.fromkeys(self.at_v(int(i)).name for i in self.v_of(names)))

    def coordinates(self, q: Array, names: Names = "*") -> Array:
        """Angles [rad] and displacements [m] of joints with one degree of freedom at q, in order, shape (k,).

        Of a continuous joint the angle in (-pi, pi], where q has its cosine and sine.

        Args:
            q: Configuration, shape (nq,).
            names: As `q_of`; a pattern leaves out joints with several degrees of freedom.

        Raises:
            JointNotFound, DuplicateName, InputError: as `q_of`; a q of another size; a named joint with several.

        Example:
            >>> solo = rbd.load_robot("solo12")
            >>> solo.joints.coordinates(solo.standing().q, "FL_*")
            array([ 0. ,  0.8, -1.6])
        """
        q, size = as_array("q", q), max((joint.q.stop for joint in self.values()), default=0)
        if q.shape != (size,):
            raise InputError(f"q has shape {q.shape}; expected ({size},), of {self._robot}.")
        given = _listed(names)
        plain = {n for n in given if not _is_pattern(n)}
        found = [self[name] for name in self.matching(given)]
        return np.array([joint.coordinate(q) for joint in found if len(joint.velocities) == 1 or joint.name in plain])

    def at_q(self, i: int) -> J:
        """The joint that has q[i]; its entry's own name is `joints.positions[i].name`.

        Raises:
            InputError: not an index of q.

        Example:
            >>> joints = rbd.load_robot("solo12").joints
            >>> joints.at_q(9).name, joints.positions[6].name, joints.at_v(8).name, joints.at_tau(2).name
            ('FL_KFE', 'root_joint.qw', 'FL_KFE', 'FL_KFE')
        """
        return self._at("q", i, max((joint.q.stop for joint in self.values()), default=0))

    def at_v(self, i: int) -> J:
        """The joint that has v[i]; its entry's own name is `joints.velocities[i].name`.

        Raises:
            InputError: not an index of v.
        """
        return self._at("v", i, max((joint.v.stop for joint in self.values()), default=0))

    def at_tau(self, i: int) -> J:
        """The joint whose motor has tau[i].

        Raises:
            InputError: not an index of tau.
        """
        return self.at_v(int(self.actuated[_index("tau", i, len(self.actuated))]))

    def velocity(self, name: str) -> slice:
        """Indices of a velocity in v: all of a joint, by its name, or one of its entries, by that of `velocities`.

        Raises:
            JointNotFound: with the nearest names.
        """
        found = self.get(name) if isinstance(name, str) else None
        if found is not None:
            return slice(found.v.start, found.v.stop)
        names = [c.name for joint in self.values() for c in joint.velocities]
        if name in names:
            at = names.index(name)
            return slice(at, at + 1)
        raise self._unknown(name, names)

    def _indices(self, names: Names, part: str, entries: str) -> Array:
        single = [c.name for joint in self.values() for c in getattr(joint, entries)]
        given, out = _listed(names), dict[int, None]()
        for k, name in enumerate(given):
            if name in given[:k]:
                raise DuplicateName(f"{name!r:.80} is named twice; expected each joint once.")
            found = self.get(name)
            if found is not None:
                own = getattr(found, part)
                out.update(dict.fromkeys(range(own.start, own.stop)))
            elif name in single:
                out[single.index(name)] = None
            elif _is_pattern(name) and (all_of := self._matching(name, part, single)):
                out.update(dict.fromkeys(all_of))
            else:
                raise self._unknown(name, single)
        return np.array(list(out), int)

    def _matching(self, pattern: str, part: str, single: Sequence[str]) -> list[int]:
        joints = [getattr(joint, part) for joint in self.values() if fnmatchcase(joint.name, pattern)]
        return [i for own in joints for i in range(own.start, own.stop)] or [
            i for i, name in enumerate(single) if fnmatchcase(name, pattern)
        ]

    def _unknown(self, name: object, single: Iterable[str]) -> JointNotFound:
        what = "no joint matches" if isinstance(name, str) and _is_pattern(name) else "no joint"
        near = nearest(str(name).replace("*", ""), dict.fromkeys([*self, *single]))
        return JointNotFound(f"{what} {name!r:.80} in {self._robot}; {near}. See robot.joints.")

    def _at(self, part: str, i: int, size: int) -> J:
        at = _index(part, i, size)
        return next(joint for joint in self.values() if getattr(joint, part).start <= at < getattr(joint, part).stop)


def _index(part: str, i: int, size: int) -> int:
    try:
        at = -1 if isinstance(i, bool) else operator.index(i)
    except TypeError:
        at = -1
    if not 0 <= at < size:
        raise InputError(f"{part}[{i!r:.40}] is no entry; expected a whole number from 0 to {size - 1}.")
    return at


def _is_pattern(name: str) -> bool:
    return any(letter in name for letter in "*?[")


def _listed(names: Names) -> list[str]:
    try:
        out = [names] if isinstance(names, str) else list(names)
    except TypeError:
        out = [None]  # type: ignore[list-item]
    if not all(isinstance(name, str) for name in out):
        raise InputError(f"names is {names!r:.80}; expected a joint's name, a pattern like 'left_*', or a list of these.")
    return out
