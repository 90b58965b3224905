"""Rows: a constraint at one state, as arrays, before any solver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import hypot, inf

import numpy as np

from rbd.arrays import Array, as_array, as_finite, is_finite, zeros
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.problem.cones import Cone
from rbd.problem.ground import TOUCHES, Ground

_NOT_GIVEN = np.empty(0)


def _not_given() -> Array:
    return _NOT_GIVEN


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """Where a contact acts, for resultants, tables and pictures.

    Attributes:
        point: Contact point or patch centre, in W, shape (3,) [m].
        axes: R_WP, columns tangent, tangent, normal in W, shape (3, 3).
        corners: Corner points from `point`, in contact axes, shape (k, 3) [m]; one zero row for a point contact.
        friction: Coefficient, or the set of a point's forces; None for a bilateral contact.
        against: Frame of the robot that it touches, of a contact between two bodies; None for the ground. Its force is the
            one on the first body, and the second feels the opposite.
        on: The plane that it touches, or None where that is not known.
        reach: No corner is farther than this from `point` [m]; it speeds up `touches`.
        within: A corner that is no farther than this from the plane touches it [m].
        turned: Of a contact on planes of different normals the axes of each corner, R_PC from these to the contact's, shape
            (k, 3, 3), normals as third columns; None: all corners have the contact's axes.
    """

    point: Array
    axes: Array
    corners: Array
    friction: float | Cone | None
    against: str | None = None
    on: Ground | None = None
    reach: float = inf
    within: float = TOUCHES
    turned: Array | None = None

    @property
    def corners_W(self) -> Array:
        """The corner points in W, shape (k, 3) [m]."""
        return self.point + self.corners @ self.axes.T

    @property
    def corner_axes(self) -> Array:
        """R_WC of the corners, shape (k, 3, 3); (3, 3) where all have the contact's axes."""
        return self.axes if self.turned is None else self.axes @ self.turned

    @property
    def gaps(self) -> Array | None:
        """Height of each corner above its plane, negative below, shape (k,) [m]; None where no plane is known."""
        return None if self.on is None else self.on.distances(self.corners_W)

    @property
    def touches(self) -> bool:
        """Whether all corners are within `within` of the plane; True where no plane is known."""
        on = self.on
        if on is None or not len(self.corners):
            return True
        if on.level:  # a bound first, in Python floats: a tenth of the cost of the gaps
            p, R = self.point, self.axes
            if abs(p.item(2) - on.height) + hypot(R.item(2, 0), R.item(2, 1)) * self.reach <= self.within:
                return True
        return bool(np.abs(on.distances(self.corners_W)).max() <= self.within)


@dataclass(frozen=True, eq=False, repr=False)
class Rows(Displayed):
    """A constraint at one state, in arrays: m rows y = J a + bias + feedback, with forces in a cone.

    Attributes:
        name: The constraint's name.
        J: Jacobian, shape (m, nv).
        bias: J_dot v (classical acceleration), shape (m,) [m/s2, rad/s2].
        cone: Set K of the row forces, of dimension m.
        velocity: J v less the surface's velocity, shape (m,) [m/s, rad/s]; zero if not given.
        error: Position residual, shape (m,), or None where position is not constrained.
        feedback: Stabilisation, shape (m,), separate from the physics; zero if not given.
        resultant: Maps row forces to the force (k = 3) or wrench (k = 6) on the robot in world axes, shape (k, m), or
            None where the rows have none.
        patch: Where the contact acts, or None.
        holonomic: Which rows are the second derivative of their `error`, shape (m,), of truth values; None: all of them, where
            there is an error. A ball that rolls has a height, and no position along the plane: its error is zero there.
        period: The error is known up to whole multiples of this, shape (m,); zero where it is known. None: known everywhere. Of
            a screw on a continuous joint it is the pitch: turns are not counted.
        overlaps: (name of a point, depth [m]) of the points at which two bodies are inside each other by more than they may be.

    Raises:
        InputError: on sizes that do not fit.

    Example:
        >>> slope = rbd.Rows("slope", J=np.array([[0.6, 0.8]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
        >>> problem = rbd.GaussProblem(M=2.0 * np.eye(2), rhs=np.array([0.0, -19.62]), rows=[slope])  # a bead of 2 kg
        >>> rbd.solve_problem(problem).forces["slope"]
        array([15.696])
    """

    name: str
    J: Array
    bias: Array
    cone: Cone
    velocity: Array = field(default_factory=_not_given)
    error: Array | None = None
    feedback: Array = field(default_factory=_not_given)
    resultant: Array | None = None
    patch: Patch | None = None
    holonomic: Array | None = None
    period: Array | None = None
    overlaps: tuple[tuple[str, float], ...] = ()

    @classmethod
    def unchecked(
        cls,
        name: str,
        J: Array,
        bias: Array,
        cone: Cone,
        velocity: Array,
        error: Array | None,
        resultant: Array | None,
        patch: Patch | None,
    ) -> Rows:
        """The same without the checks, a third of what two contacts cost: for float arrays that fit by construction."""
        self = object.__new__(cls)
        self.__dict__.update(
            name=name, J=J, bias=bias, cone=cone, velocity=velocity, error=error, feedback=zeros(len(bias)),
            resultant=resultant, patch=patch, holonomic=None, period=None,
        )  # fmt: skip
        return self

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"the name of rows is {self.name!r:.80}; expected a string, e.g. 'left_sole'.")
        if type(self.J) is not np.ndarray or self.J.dtype != float:
            object.__setattr__(self, "J", as_array(f"J of rows {self.name!r}", self.J))
        if self.J.ndim != 2:
            raise InputError(f"rows {self.name!r}: J has shape {self.J.shape}; expected (m, nv).")
        m = self.J.shape[0]
        shape = (m,)
        given = (("bias", self.bias), ("velocity", self.velocity), ("feedback", self.feedback), ("error", self.error))
        for what, value in given:
            if value is _NOT_GIVEN:
                object.__setattr__(self, what, zeros(m))
            elif value is None and what == "error":
                continue
            elif not (type(value) is np.ndarray and value.shape == shape and value.dtype == float):
                object.__setattr__(self, what, self._vector(what, value, m))
        # J, bias and feedback are checked where they are stacked, in GaussProblem; a patch's velocity is its state's.
        if self.patch is None and not (is_finite(self.velocity) and (self.error is None or is_finite(self.error))):
            raise InputError(f"rows {self.name!r}: velocity or error is not finite.")
        if not hasattr(self.cone, "generators"):
            raise InputError(f"rows {self.name!r}: the cone is {self.cone!r:.80}; expected e.g. rbd.problem.Free({m}).")
        if self.cone.dim != m:
            raise InputError(f"rows {self.name!r}: the cone has dimension {self.cone.dim}, J has {m} rows.")
        if self.resultant is not None:
            meaning = ": a column a row of J"
            object.__setattr__(
                self, "resultant", as_finite(f"rows {self.name!r}: resultant", self.resultant, ("k", m), meaning=meaning)
            )
        if self.holonomic is not None:
            self._check_holonomic(m)
        if self.period is not None:
            object.__setattr__(self, "period", self._vector("period", self.period, m))
            if self.error is None or not (is_finite(self.period) and (self.period >= 0.0).all()):
                raise InputError(
                    f"rows {self.name!r}: period is {self.period!r:.80}; expected {m} numbers >= 0, and an error with them."
                )

    def _vector(self, what: str, value: object, m: int) -> Array:
        out = as_array(f"{what} of rows {self.name!r}", value)
        if out.shape != (m,):
            raise InputError(f"rows {self.name!r}: {what} has shape {out.shape}; expected ({m},), one entry a row of J.")
        return out

    def _check_holonomic(self, m: int) -> None:
        given = np.asarray(self.holonomic)
        if given.dtype != bool or given.shape != (m,) or self.error is None:
            raise InputError(
                f"rows {self.name!r}: holonomic is {self.holonomic!r:.80}; expected {m} truth values, and an error with them."
            )
        object.__setattr__(self, "holonomic", given)

    def __repr__(self) -> str:
        return f"Rows({self.name!r}, m={len(self)}, nv={self.J.shape[1]}, cone={type(self.cone).__name__})"

    def __len__(self) -> int:
        return self.J.shape[0]

    def force_of(self, f: Array) -> Array:
        """Row forces (m,) as the force or wrench on the robot in world axes, shape (k,); as they are without a resultant."""
        return f.copy() if self.resultant is None else self.resultant @ f

    @property
    def stabilised(self) -> bool:
        """Whether a feedback was given."""
        return self.feedback is not zeros(len(self))

    def kept_still(self, feedback: Array) -> Rows:
        """The same rows as if they were at rest, with this feedback, shape (m,), unchecked."""
        out = object.__new__(type(self))
        out.__dict__.update(self.__dict__, velocity=zeros(len(feedback)), feedback=feedback)
        return out

    @property
    def touches(self) -> bool:
        """Whether its corners are on their plane, to `Patch.within`, and no bodies are inside each other."""
        return not self.overlaps and (self.patch is None or self.patch.touches)

    @property
    def gaps_off_plane(self) -> Array | None:
        """Heights of corners above the plane that they are off [m]; None if they touch, or feedback pulls them back."""
        if self.patch is None or self.patch.touches or (self.stabilised and self.error is not None):
            return None
        return self.patch.gaps

    @property
    def speed(self) -> float:
        """Largest entry of `|velocity|`."""
        return float(np.abs(self.velocity).max(initial=0.0))


def by_rows(rows: Sequence[Rows], stacked: Array) -> Iterator[tuple[Rows, Array]]:
    """(rows, part): each constraint's rows, with its part of what is stacked over all of them along the first axis."""
    at = 0
    for r in rows:
        yield r, stacked[at : at + len(r)]
        at += len(r)
