"""Velocity and force ellipses of a chain's end point: how freely it moves in each direction, how strongly it pushes.

Joint velocities of |qd| <= 1 rad/s make end-point velocities in {v : v^T (J J^T)^-1 v <= 1}: an ellipse whose semi-axes are
the singular values of J. Joint torques of |tau| <= 1 N m balance forces in {f : f^T J J^T f <= 1}, tau = J^T f being the
virtual work: the same axes, the reciprocal lengths. Where the chain moves easily it pushes weakly. Manipulability is
sqrt(det J J^T), the velocity ellipse's area over pi [Yoshikawa1985]. The unit ball of rates depends on how angles are
measured, and so do the ellipses: robots measure joint angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError, nearest
from rbd.planar.angles import samples
from rbd.planar.kinematics import check_joint
from rbd.planar.numeric import ChainNumbers

VELOCITY, FORCE = "velocity", "force"


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse about a point of a chain.

    Attributes:
        kind: "velocity" or "force".
        centre: The point, shape (2,) [m].
        semi_axes: Their lengths, longest first, shape (2,) [m/s per rad/s, or N per N m]; at a singular configuration the
            velocity ellipse has a zero, the force ellipse an infinite one.
        directions: Unit vectors along them as columns, shape (2, 2); x not negative.
        manipulability: sqrt(det J J^T) [m^2], zero where singular; the same of both kinds.
    """

    kind: str
    centre: Array
    semi_axes: Array
    directions: Array
    manipulability: float

    @property
    def is_singular(self) -> bool:
        """Whether one direction is lost."""
        return self.manipulability == 0.0

    def points(self, count: int = 100, *, scale: float = 1.0, longest: float = np.inf) -> Array:
        """The closed outline about the centre, shape (count, 2) [m], semi-axes times `scale` and cut at `longest`.

        Raises:
            InputError: if an axis is infinite and `longest` is too, or numbers are not positive.
        """
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 3 <= count <= 100_000:
            raise InputError(f"count is {count!r:.80}; expected a whole number of points, 3 to 100000.")
        if not (0.0 < as_float(scale) < np.inf and as_float(longest) > 0.0):
            raise InputError(f"scale is {scale!r:.80}, longest is {longest!r:.80}; expected positive numbers.")
        axes = np.minimum(scale * self.semi_axes, longest)
        if not np.isfinite(axes).all():
            raise InputError("at a singular configuration the force ellipse has an infinite axis; give `longest` to cut it.")
        around = np.linspace(0.0, 2.0 * np.pi, int(count))
        return self.centre + np.column_stack([axes[0] * np.cos(around), axes[1] * np.sin(around)]) @ self.directions.T


def end_point_ellipse(chain: ChainNumbers, q: Sequence[float] | Array, kind: str, i: int | None) -> Ellipse:
    """The velocity or force ellipse of joint i; see `Chain.ellipse`.

    Raises:
        InputError: on another kind, shape or joint.
    """
    if not isinstance(kind, str) or kind not in (VELOCITY, FORCE):
        raise InputError(f"no ellipse is called {kind!r:.80}; {nearest(kind, (VELOCITY, FORCE))}.")
    joint, given = check_joint(chain.n, i, first=1), samples("q", q, chain.n)
    if given.ndim != 1:
        raise InputError(f"q came with shape {given.shape}; expected one configuration, ({chain.n},).")
    U, sigma, _ = np.linalg.svd(chain.jacobian(given, joint))
    axes = np.array([sigma[0], sigma[1] if len(sigma) == 2 else 0.0])
    # Rounding leaves a link on a line 1e-16 off it: below that, the direction is lost.
    if axes[1] <= 8 * chain.n * np.finfo(float).eps * axes[0]:
        axes[1] = 0.0
    manipulability = float(axes[0] * axes[1])
    if kind == FORCE:
        with np.errstate(divide="ignore"):
            axes, U = 1.0 / axes[::-1], U[:, ::-1]
    signs = np.where((U[0] < 0.0) | ((U[0] == 0.0) & (U[1] < 0.0)), -1.0, 1.0)
    return Ellipse(kind, chain.position(given, joint), axes, U * signs, manipulability)
