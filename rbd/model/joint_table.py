"""The joint table of a robot, by name: its limits and lengths; entries of q, v and tau by names or patterns, and by number."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, lazy
from rbd.displayed import Displayed
from rbd.errors import DuplicateName, InputError, JointNotFound, nearest
from rbd.model.joints import ANGLE, AT_LIMIT, Coordinate, Joint, Piece, joint_of

if TYPE_CHECKING:
    Names = str | Iterable[str]
    """Names of joints or of single entries, or patterns of such names with *, ? and [...]."""


class Joints(Mapping[str, Joint], Displayed):
    """The joints of a robot by name, in the order of its model: `robot.joints["knee"].v`.

    Of several joints at once: `q_of`, `v_of` and `tau_of` give indices by names or a pattern, `at_q`, `at_v` and `at_tau` the
    joint of an index, `coordinates` the angles.

    Args:
        model: The Pinocchio model.
        robot: The robot's name, for messages.
    """

    actuated: Array = np.zeros(0, int)
    """Indices in v of the entries with a motor, in the order of tau, shape (nu,)."""

    def __init__(self, model: pin.Model, robot: str) -> None:
        self._model, self._robot = model, robot
        self._joints = {name: joint_of(model, i, name) for i, name in enumerate(model.names) if i > 0}

    def __getitem__(self, name: str) -> Joint:
        """The joint of this name.

        Raises:
            JointNotFound: with the nearest names.
        """
        try:
            return self._joints[name]
        except (KeyError, TypeError):
            raise JointNotFound(f"no joint {name!r:.80} in {self._robot}; {nearest(name, self)}. See robot.joints.") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._joints)

    def __len__(self) -> int:
        return len(self._joints)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._joints

    def get(self, name: str, default: Any = None) -> Any:
        """The joint of this name, or the default given."""
        return self._joints.get(name, default) if isinstance(name, str) else default

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        rows = [joint._cells() for joint in self.values()]
        widths = [max(len(row[k]) for row in rows) for k in range(7)] if rows else []
        lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
        return "\n".join([f"{len(self)} joint{'s' * (len(self) != 1)} of {self._robot}", *(f"  {line}" for line in lines)])

    def with_one_freedom(self, name: str, asked_by: str) -> Joint:
        """The joint of this name, which must have one degree of freedom.

        Raises:
            JointNotFound: with the nearest names.
            InputError: it has several; with the caller's name.
        """
        joint = self[name]
        if joint.nv != 1:
            raise InputError(
                f"{asked_by!r:.80}: joint {name!r:.80} has {joint.nv} degrees of freedom; expected a joint with one."
            )
        return joint

    def carrying(self, joint: int) -> Array:
        """Which velocities move the body of a joint, by its index, shape (nv,), of ones and zeros."""
        out = np.zeros(self._model.nv)
        for above in list(self._model.supports[joint])[1:]:
            first = self._model.idx_vs[above]
            out[first : first + self._model.nvs[above]] = 1.0
        return out

    @lazy
    def limits(self) -> tuple[Array, Array]:
        """(lower, upper) of each entry of q, shapes (nq,); infinite where there is none, as `Joint.lower` and `Joint.upper`."""
        low, high = np.full(self._model.nq, -math.inf), np.full(self._model.nq, math.inf)
        for joint in self.values():
            if joint.nq == 1:
                low[joint.q], high[joint.q] = joint.lower, joint.upper
        return low, high

    @lazy
    def _ranges(self) -> tuple[Array, Array, bytes]:
        """The limits, `AT_LIMIT` wider, and the bytes of as many times False."""
        low, high = self.limits
        return low - AT_LIMIT, high + AT_LIMIT, bytes(len(low))

    def within_limits(self, q: Array) -> bool:
        """Whether no joint is beyond its limits by more than 1e-6 [rad, m]: of a configuration, shape (nq,)."""
        low, high, none = self._ranges
        return bool((q < low).tobytes() == none == (q > high).tobytes())  # half the time of `any`, on each `rbd.solve`

    @lazy
    def pieces(self) -> tuple[Piece, ...]:
        """Of all joints, in order."""
        return tuple(piece for joint in self.values() for piece in joint.pieces)

    @lazy
    def positions(self) -> tuple[Coordinate, ...]:
        """The entries of q, in order: of a floating base x, y, z, then the quaternion."""
        return tuple(c for joint in self.values() for c in joint.positions)

    @lazy
    def velocities(self) -> tuple[Coordinate, ...]:
        """The entries of v, in order, as they are of a, of h and of generalised forces."""
        return tuple(c for joint in self.values() for c in joint.velocities)

    @lazy
    def angular(self) -> Array:
        """Which velocities are angular, shape (nv,), bool; those of screws are."""
        return np.array([c.unit == ANGLE for c in self.velocities], bool)

    @lazy
    def periodic(self) -> Array:
        """Which velocities belong to an angle stored as a number, shape (nv,), bool: q and q + 2 pi are the same pose."""
        return np.array([p.periodic for p in self.pieces for _ in range(p.nv)], bool)

    @lazy
    def length(self) -> float:
        """Characteristic length: the largest distance from a joint to the next, or to a frame on it [m]; 1 if all are zero."""
        model = self._model
        joints = [np.linalg.norm(model.jointPlacements[j].translation) for j in range(1, model.njoints) if model.parents[j]]
        frames = [np.linalg.norm(f.placement.translation) for f in model.frames if f.parentJoint]
        most = float(max([*joints, *frames], default=0.0))
        return most if most > 1e-9 else 1.0

    @lazy
    def reach(self) -> float:
        """How far the robot could stretch: all its bodies in a row, by joints and frames [m]; 1 if they have no length."""
        longest = np.zeros(self._model.njoints)
        for frame in self._model.frames:
            longest[frame.parentJoint] = max(longest[frame.parentJoint], np.linalg.norm(frame.placement.translation))
        total = sum(float(np.linalg.norm(X.translation)) for X in self._model.jointPlacements) + float(longest.sum())
        return total if total > 0.0 else 1.0

    @lazy
    def scale(self) -> Array:
        """Unit of each velocity, shape (nv,): one where it turns, the robot's length where it slides."""
        return np.where(self.angular, 1.0, self.length)

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
        return self._entries(names, "q")

    def v_of(self, names: Names) -> Array:
        """Indices in v of some joints, shape (k,), also of accelerations and generalised forces; arguments as `q_of`.

        Example:
            >>> solo = rbd.load_robot("solo12")
            >>> v = np.zeros(solo.nv)
            >>> v[solo.joints.v_of("*_KFE")] = 0.5  # all four knees
            >>> solo.joints.v_of("*_KFE")
            array([ 8, 11, 14, 17])
        """
        return self._entries(names, "v")

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
        entries = self.v_of(given).tolist()
        motor = {i: k for k, i in enumerate(self.actuated.tolist())}
        plain = self.v_of([name for name in given if not _is_pattern(name)]).tolist()
        idle = [i for i in entries if i not in motor]
        for i in idle:
            if i in plain or len(idle) == len(entries):
                raise InputError(
                    f"joint {self.velocities[i].joint!r:.80} of {self._robot} has no motor, and so no entry in tau; expected "
                    "joints of robot.actuated_names."
                )
        return np.array([motor[i] for i in entries if i in motor], int)

    def matching(self, names: Names) -> tuple[str, ...]:
        """Names of the joints that names or patterns stand for, in order; arguments and errors as `q_of`.

        Example:
            >>> rbd.load_robot("solo12").joints.matching("FL_*")
            ('FL_HAA', 'FL_HFE', 'FL_KFE')
        """
        return tuple(dict.fromkeys(self.velocities[i].joint for i in self.v_of(names)))

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
        q = as_finite("q", q, (self._model.nq,), meaning=f", of {self._robot}")
        given = _listed(names)
        plain = {n for n in given if not _is_pattern(n)}
        found = [self[name] for name in self.matching(given)]
        return np.array([joint.coordinate(q) for joint in found if len(joint.velocities) == 1 or joint.name in plain])

    def at_q(self, i: int) -> Joint:
        """The joint that has q[i]; its entry's own name is `joints.positions[i].name`.

        Raises:
            InputError: not an index of q.

        Example:
            >>> joints = rbd.load_robot("solo12").joints
            >>> joints.at_q(9).name, joints.positions[6].name, joints.at_v(8).name, joints.at_tau(2).name
            ('FL_KFE', 'root_joint.qw', 'FL_KFE', 'FL_KFE')
        """
        return self[self.positions[_index("q", i, len(self.positions))].joint]

    def at_v(self, i: int) -> Joint:
        """The joint that has v[i]; its entry's own name is `joints.velocities[i].name`.

        Raises:
            InputError: not an index of v.
        """
        return self[self.velocities[_index("v", i, len(self.velocities))].joint]

    def at_tau(self, i: int) -> Joint:
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
        at = self._find(name, "v") if isinstance(name, str) and (name in self or not _is_pattern(name)) else ()
        if not at:
            raise self._unknown(name, "v")
        return slice(at[0], at[-1] + 1)

    def _entries(self, names: Names, part: Literal["q", "v"]) -> Array:
        given, out = _listed(names), dict[int, None]()
        for k, name in enumerate(given):
            if name in given[:k]:
                raise DuplicateName(f"{name!r:.80} is named twice; expected each joint once.")
            if not (found := self._find(name, part)):
                raise self._unknown(name, part)
            out.update(dict.fromkeys(found))
        return np.array(list(out), int)

    def _find(self, name: str, part: Literal["q", "v"]) -> Sequence[int]:
        """Entries of a joint of this name, else of this name themselves, else of joints or by themselves like this pattern."""
        if name in self:
            own: slice = getattr(self[name], part)
            return range(own.start, own.stop)
        entries = self.positions if part == "q" else self.velocities
        found = [i for i, entry in enumerate(entries) if entry.name == name]
        if _is_pattern(name):
            found = found or [i for i, entry in enumerate(entries) if fnmatchcase(entry.joint, name)]
            found = found or [i for i, entry in enumerate(entries) if fnmatchcase(entry.name, name)]
        return found

    def _unknown(self, name: object, part: Literal["q", "v"]) -> JointNotFound:
        what = "no joint matches" if isinstance(name, str) and _is_pattern(name) else "no joint"
        entries = self.positions if part == "q" else self.velocities
        near = nearest(str(name).replace("*", ""), dict.fromkeys([*self, *(entry.name for entry in entries)]))
        return JointNotFound(f"{what} {name!r:.80} in {self._robot}; {near}. See robot.joints.")


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
