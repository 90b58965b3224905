"""Surfaces that a contact touches: ground, at rest or moving, or another body of the robot; distances to a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_array, as_vector3, check_finite, filled, zeros
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.problem.motions import Motion, Prescribed

TOUCHES = 1e-3
"""A contact whose points are all within this of its plane touches it [m]."""
RUNS_ALONG = 1e-9
"""A surface that runs along its plane has no larger speed across it [m/s, rad/s]."""
_UP = np.array([0.0, 0.0, 1.0])


def unit_normal(what: str, normal: Sequence[float] | Array) -> Array:
    """The normal, normalised.

    Raises:
        InputError: if it is not of unit length to 1e-6.
    """
    n = as_vector3(what, normal)
    length = float(np.linalg.norm(n))
    if abs(length - 1.0) > 1e-6:
        raise InputError(f"{what} has length {length:.6g}; expected a unit vector.")
    return n / length


@dataclass(frozen=True, eq=False)
class Ground(Displayed):
    """The ground that a contact touches, for `on=`: a floor, a step, a ramp, a belt, a lift, a turntable, a cart.

    Attributes:
        normal: Out of the ground, a unit vector in W, shape (3,). Not given: z where `point` is, else the contact's
            (z of a point contact, z of the placement of an edge or a patch).
        point: Any point of its plane, in W, shape (3,) [m]. None: its position is not known, and a contact touches it
            in any pose.
        velocity: Of its surface, world axes: linear (3,), or linear and angular (6,) [m/s, rad/s]; stored as (6,). None: it
            is at rest. A contact's rows are relative to it: a point that moves with the surface is at rest.
        acceleration: Of the same material point of the surface, (3,) or (6,) [m/s2, rad/s2]. Both hold for one
            instant: another instant needs another ground.
        about: Point in W, shape (3,) [m], at which `velocity` and `acceleration` are given, e.g. a point on a
            turntable's axis. Not given: the contact's point; for rolling bodies, `point`.
        motion: How far the ground and its material have moved at a time, in place of `velocity`: t -> (3,) in W [m], or with
            its two derivatives (3, 3), or `rbd.Speed`; as of `rbd.DrivenJoint`. It counts from where `point` and anchors are
            given, and is taken at the time of the state, `State.t`: a lift, a shaker, an earthquake.

    Raises:
        InputError: numbers that are not finite, a normal that is not of unit length, `about` without a velocity; a motion and a
            velocity.

    Example:
        >>> step = rbd.Ground(point=(0, 0, 0.17))            # 17 cm up
        >>> turntable = rbd.Ground(velocity=(0, 0, 0, 0, 0, 1.7), about=(0, 0, 0))
        >>> lift = rbd.Ground(point=(0, 0, 0), motion=lambda t: (0, 0, 0.1 * np.sin(t)))
        >>> lift.at(np.pi / 2).point
        array([0. , 0. , 0.1])
        >>> step.distances(np.array([[0.3, 0.1, 0.2]])).round(3), step.moves, turntable.moves
        (array([0.03]), False, True)
    """

    normal: Sequence[float] | Array | None = field(default=None, kw_only=True)
    point: Sequence[float] | Array | None = field(default=None, kw_only=True)
    velocity: Sequence[float] | Array | None = field(default=None, kw_only=True)
    acceleration: Sequence[float] | Array | None = field(default=None, kw_only=True)
    about: Sequence[float] | Array | None = field(default=None, kw_only=True)
    motion: Motion | None = field(default=None, kw_only=True)
    height: float = field(init=False, repr=False)
    level: bool = field(init=False, repr=False)
    moved: Prescribed | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        given = _UP if self.normal is None and self.point is not None else self.normal
        n = None if given is None else unit_normal("normal of the ground", given)
        point = None if self.point is None else as_vector3("point of the ground", self.point)
        about = None if self.about is None else as_vector3("about of the ground", self.about)
        for what in ("velocity", "acceleration"):
            if (motion := getattr(self, what)) is not None:
                object.__setattr__(self, what, _twist(f"{what} of the ground", motion))
        if self.motion is not None and (self.velocity is not None or self.acceleration is not None):
            raise InputError("the ground has motion= and velocity= or acceleration=; expected one of them.")
        moved = None if self.motion is None else Prescribed("motion of the ground", self.motion, (3,))
        if about is not None and self.velocity is None and self.acceleration is None:
            raise InputError("the ground has about= without velocity= or acceleration=: these are given at that point.")
        height = np.nan if n is None or point is None else float(n @ point)
        level = point is not None and n is not None and bool(np.array_equal(n, _UP))
        self.__dict__.update(normal=n, point=point, about=about, height=height, level=level, moved=moved)

    def shift(self, t: float) -> Array:
        """How far its plane has moved at a time [s], in W, shape (3,) [m]: by its motion, or at its velocity."""
        if self.moved is not None:
            return self.moved.at(t)[0]
        return zeros(3) if self.velocity is None else np.asarray(self.velocity)[:3] * t

    def at(self, t: float) -> Ground:
        """The ground as it is at a time [s]: where it is, with its velocity and acceleration then; itself without a motion."""
        if self.moved is None:
            return self
        s, velocity, acceleration = (np.append(x, zeros(3)) for x in self.moved.at(t))
        point, n = (None if self.point is None else self.point + s[:3]), self.normal
        height = self.height if n is None else self.height + float(s[:3] @ n)
        return filled(
            Ground, normal=n, point=point, velocity=velocity, acceleration=acceleration, about=None, motion=None, height=height,
            level=self.level, moved=None,
        )  # fmt: skip

    @property
    def carries(self) -> bool:
        """Whether it has a velocity, and so takes along what stands on it, from no place of its own."""
        return self.velocity is not None

    @property
    def moves(self) -> bool:
        """Whether it has a motion, or a velocity or an acceleration that is not zero."""
        given = (self.velocity, self.acceleration)
        return self.motion is not None or any(each is not None and np.any(each) for each in given)

    @property
    def stays(self) -> bool:
        """Whether its plane is known and stays where it is, at rest or with a surface that runs along it or turns about n."""
        if self.motion is not None or self.normal is None or self.point is None:
            return False
        n = np.asarray(self.normal)
        across = [max(abs(float(x[:3] @ n)), float(np.abs(np.cross(x[3:], n)).max())) for x in motion_of(self)]
        return max(across) < RUNS_ALONG

    def distances(self, points: Array) -> Array:
        """How far points are above the plane, negative below, shape (k,) [m]; NaN where the plane is not known.

        Args:
            points: In W, shape (k, 3) [m].
        """
        return np.full(len(points), np.nan) if self.normal is None else np.asarray(points @ self.normal) - self.height

    def below(self, x: float, y: float) -> float:
        """Height of the plane in W at (x, y) [m]; of a vertical plane, that of its `point`."""
        nx, ny, nz = np.asarray(self.normal).tolist()
        assert self.point is not None
        return (self.height - nx * x - ny * y) / nz if abs(nz) > 1e-3 else float(self.point[2])

    def same(self, other: Ground) -> bool:
        """Whether both are the same plane, to a micrometre at the points given."""
        if np.abs(np.asarray(self.normal) - np.asarray(other.normal)).max() > 1e-9:
            return False
        return bool(abs(self.distances(np.asarray(other.point)[None])[0]) < 1e-6)


@dataclass(frozen=True, eq=False)
class Body(Displayed):
    """Another body of the same model that a contact touches, for `on=` in place of the ground.

    The contact's force is the one on the contact's body; the other body receives the opposite.

    Attributes:
        frame: A frame of that body.
        normal: Out of it, a unit vector in the frame's axes, shape (3,); the contact's if not given, as in `Ground`.
            Rolling bodies take the plane through the frame's origin.

    Raises:
        InputError: a frame that is not a string, a normal that is not of unit length.

    Example:
        >>> boxes = rbd.robots.merge_robots(rbd.testing.box(mass=10.0), rbd.testing.box(mass=2.0))
        >>> floor = rbd.SurfaceContact("floor", "a_box", half_lengths=(0.2, 0.2), friction=0.6)
        >>> stacked = rbd.SurfaceContact("stacked", "b_box", half_lengths=(0.2, 0.2), on=rbd.Body("a_box"), friction=0.6)
        >>> solution = rbd.solve(boxes.at([0, 0, 0.1, 0, 0, 0, 1, 0, 0, 0.3, 0, 0, 0, 1]), [], [floor, stacked])
        >>> print(solution.forces["floor"][:3].round(2), solution.forces["stacked"][:3].round(2))  # both weights, and one
        [  0.     0.   117.72] [ 0.    0.   19.62]
    """

    frame: str
    normal: Sequence[float] | Array | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if not isinstance(self.frame, str) or not self.frame:
            raise InputError(f"rbd.Body is of {self.frame!r:.80}; expected a frame of the other body, e.g. 'table'.")
        if self.normal is not None:
            object.__setattr__(self, "normal", unit_normal(f"normal of the body {self.frame!r:.80}", self.normal))


FLOOR = Ground(point=(0.0, 0.0, 0.0))
"""The plane z = 0."""


def motion_of(ground: Ground) -> tuple[Array, Array]:
    """(velocity, acceleration) of a ground, shapes (6,); zero where none is given."""
    u, s = (zeros(6) if given is None else np.asarray(given) for given in (ground.velocity, ground.acceleration))
    return u, s


def _twist(what: str, value: Sequence[float] | Array) -> Array:
    """Linear and angular parts, shape (6,); a missing angular part is zero."""
    given = as_array(what, value)
    if given.shape not in ((3,), (6,)):
        raise InputError(
            f"{what} has shape {given.shape}; expected (3,), linear, or (6,), linear then angular, in world axes: how the "
            "surface moves."
        )
    check_finite(what, given)
    out = np.zeros(6)
    out[: len(given)] = given
    return out
