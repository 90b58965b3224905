"""`Curve`: a motion of a robot as cubics in time of its coordinates, with what bounds their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times
from rbd.errors import Unsupported
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import exponential, flat_coordinates, from_flat, own_rates, product
from rbd.motion.frame_terms import placements


@dataclass(frozen=True, eq=False)
class Curve:
    """Cubics of the coordinates: place of the base in W, its turns about z, y and x from a fixed orientation, joints.

    Twice continuously differentiable, at rest at both ends. A base that turns about three hinges in a row has a motion whose
    derivatives can be bounded joint by joint, as those of all other joints.

    Attributes:
        robot: The robot, with one floating base.
        t: Times of the knots, shape (n,) [s].
        middle: Quaternion of the orientation from which the base's turns count.
        spline: SciPy's cubic spline of the coordinates, shape (nv,) at a time.
    """

    robot: CheckedModel
    t: Array
    middle: Array
    spline: Any

    @classmethod
    def of(cls, robot: CheckedModel, t: Array, q: Array) -> Curve:
        """Through configurations q (n, nq) at times t.

        Raises:
            Unsupported: other joints than hinges and slides, beside the base.
        """
        from scipy.interpolate import CubicSpline

        odd = [p for p in robot.joints.pieces[1:] if p.nv != 1]
        if odd:
            raise Unsupported(f"{robot.name} has joints with several axes, and plans take a floating base, hinges and slides.")
        middle = q[len(q) // 2, 3:7]
        x = flat_coordinates(robot, q)
        R = pin.Quaternion(*middle[[3, 0, 1, 2]]).matrix().T @ placements(robot, q)[0][:, 1]
        x[:, 3] = np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
        x[:, 4] = -np.arcsin(R[:, 2, 0].clip(-1.0, 1.0))
        x[:, 5] = np.unwrap(np.arctan2(R[:, 2, 1], R[:, 2, 2]))
        still = np.zeros(robot.nv)
        return cls(robot, t, middle, CubicSpline(t, x, bc_type=((1, still), (1, still))))

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """(q, v, a) at times, shapes (n, nq), (n, nv), (n, nv)."""
        x, dx, ddx = (self.spline(t, i) for i in range(3))
        turn = self.middle
        for axis, i in zip(np.eye(3)[::-1], (3, 4, 5), strict=True):
            turn = product(np.broadcast_to(turn, (len(t), 4)), exponential(x[:, i, None] * axis))
        q = from_flat(self.robot, x, [turn])
        E, dE = _spins(x[:, 3:6], dx[:, 3:6])
        v, a = dx.copy(), ddx.copy()
        v[:, 3:6] = each_times(E, dx[:, 3:6])
        a[:, 3:6] = each_times(E, ddx[:, 3:6]) + each_times(dE, dx[:, 3:6])
        return (q, *own_rates(self.robot, q, v, a))

    def extremes(self, order: int) -> tuple[Array, Array]:
        """(least, most) of coordinates (order 0) or of their rates (1) between two knots, shapes (n - 1, nv): exact."""
        c, h = self.spline.c, np.diff(self.t)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = -c[1] / (3.0 * c[0])
            off = np.sqrt(turn**2 - c[2] / (3.0 * c[0]))
            straight = -c[2] / (2.0 * c[1])
        stops = [turn] if order else [turn - off, turn + off, straight]
        at = [0.0 * h, h, *(np.nan_to_num(s).clip(0.0, h) for s in stops)]  # where the next derivative is zero, if inside
        values = np.array([
            3.0 * c[0] * s**2 + 2.0 * c[1] * s + c[2] if order else ((c[0] * s + c[1]) * s + c[2]) * s + c[3] for s in at
        ])  # fmt: skip
        return values.min(axis=0), values.max(axis=0)

    def sizes(self, start: Array, end: Array) -> Array:
        """Largest derivatives of order 1, 2 and 3 from starts to ends, by Bernstein's form, shape (3, m, nv).

        No knot is inside of an interval. A polynomial is nowhere beyond its coefficients in Bernstein's form.
        """
        h, inside = (end - start)[:, None], 0.5 * (start + end)
        third, second = self.spline(inside, 3), self.spline(inside, 2)
        ends = [second - 0.5 * h * third, second + 0.5 * h * third]
        middle = self.spline(inside, 1)
        first = [middle + 0.5 * h * (sign * second + 0.25 * h * third) for sign in (-1.0, 1.0)]
        control = [first[0], first[0] + 0.5 * h * ends[0], first[1]]
        return np.array([np.abs(control).max(axis=0), np.abs(ends).max(axis=0), np.abs(third)])


def _spins(angles: Array, rates: Array) -> tuple[Array, Array]:
    """(E, E'): spin in the base's axes is E times the rates of the turns about z, y and x; shapes (n, 3, 3)."""
    (_, b, c), (_, db, dc) = angles.T, rates.T
    zero, one = np.zeros_like(b), np.ones_like(b)
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    E = np.array([[-sb, zero, one], [cb * sc, cc, zero], [cb * cc, -sc, zero]])
    dE = np.array([
        [-cb * db, zero, zero], [cb * cc * dc - sb * sc * db, -sc * dc, zero], [-cb * sc * dc - sb * cc * db, -cc * dc, zero],
    ])  # fmt: skip
    return E.transpose(2, 0, 1), dE.transpose(2, 0, 1)


def of_product(one: Array, other: Array) -> Array:
    """Bounds of derivatives 0, 1, ... of a product by those of its factors (Leibniz's rule)."""
    n = min(len(one), len(other))
    return np.array([sum(comb(k, j) * one[j] * other[k - j] for j in range(k + 1)) for k in range(n)])
