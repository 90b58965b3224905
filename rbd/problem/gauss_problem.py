"""Gauss's least-constraint problem, in arrays, and the contact laws under which it is solved: no robot, no solver."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from typing import Any, Protocol

import numpy as np

from rbd.arrays import Array, as_array, as_float, blas, check_finite, inertia_factor, is_finite, lapack, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_different, check_kind, listed_items
from rbd.problem.cones import Cone, Product
from rbd.problem.contact_motion import REST_SPEED, Opening
from rbd.problem.force_set import ForceSet
from rbd.problem.rows import Rows

KINDS = ("bilateral", "convex", "coulomb")


@dataclass(frozen=True)
class Law:
    """A contact law, and the pyramids that replace its circular cones; printed e.g. as "convex, 4 facets".

    Attributes:
        kind: "bilateral" (no contact can break or slip), "convex" (Gauss's principle with cones of forces) or "coulomb"
            (maximal dissipation, which is not a minimum).
        facets: Of the pyramids that replace the circular cones, ascending; empty where cones are circular, or there are none.

    Raises:
        InputError: an unknown kind; facets with a law other than the convex one, fewer than three, or not ascending.
    """

    kind: str
    facets: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise InputError(f"law is {self.kind!r:.80}; expected 'bilateral', 'convex', 'convex, 4 facets' or 'coulomb'.")
        fits = isinstance(self.facets, tuple) and all(type(n) is int and n >= 3 for n in self.facets)
        if not fits or list(self.facets) != sorted(set(self.facets)) or (self.facets and self.kind != "convex"):
            raise InputError(
                f"facets of the {self.kind} law are {self.facets!r:.80}; expected e.g. (4,), or (4, 8), "
                "ascending, of the convex law, or ()."
            )

    @classmethod
    def of(cls, given: Law | str) -> Law:
        """The law itself, or the one that prints as given.

        Raises:
            InputError: if there is none.
        """
        if isinstance(given, Law):
            return given
        facets = re.fullmatch(r"convex, (\d{1,4}(?: and \d{1,4})*) facets", given) if isinstance(given, str) else None
        return cls(given) if facets is None else cls("convex", tuple(sorted(map(int, facets[1].split(" and ")))))

    def __repr__(self) -> str:
        return f"Law({self.kind!r}{f', facets={self.facets}' if self.facets else ''})"

    def __str__(self) -> str:
        return self.kind + (f", {' and '.join(map(str, self.facets))} facets" if self.facets else "")


BILATERAL, CONVEX, COULOMB = map(Law, KINDS)


@dataclass(frozen=True, eq=False)
class MomentumBalance:
    """What the rate of centroidal momentum must equal, in arrays, without any contact Jacobian.

    The rate is A_g a + rate_bias, linear then angular, about the centre of mass, in world axes.

    Attributes:
        A_g: Centroidal momentum matrix, shape (6, nv).
        rate_bias: A_g_dot v, shape (6,) [N, N m].
        wrench: Weight and external forces about the centre of mass, shape (6,) [N, N m].
        com: Centre of mass in W, shape (3,) [m].
        base: (origin in W (3,), R_WB (3, 3)) of the floating base; needed only for rows without a resultant, whose wrench
            is the base's part of J^T f.
    """

    A_g: Array
    rate_bias: Array
    wrench: Array
    com: Array
    base: tuple[Array, Array] | None = None


class Origin(Protocol):
    """What a problem was assembled from: it gives derivatives of the answer with respect to the state."""

    def derivatives(self, solution: Any, parameters: Any = ()) -> Any:
        """Derivatives of the answer with respect to state, torques and external forces."""


@dataclass(frozen=True, eq=False, repr=False)
class GaussProblem(Displayed):
    """The least-constraint problem in arrays: `argmin 1/2 |a - a_free|_M^2` for y = J a + offset in K*, forces f in K.

    M a = rhs + J^T f are the equations of motion; rhs = S^T tau + tau_ext - h. It can be built by hand, without a robot.

    Attributes:
        M: Joint-space inertia, shape (nv, nv), symmetric positive definite.
        rhs: Generalised force of free motion, shape (nv,).
        rows: The constraints.
        balance: What the centroidal residual is computed from, or None.
        origin: What it was assembled from, used by `Solution.derivatives`; None for a problem built by hand.
        rest_speed: A contact that can break or slip, and a joint with dry friction, counts as at rest up to this speed
            [m/s, rad/s]: faster along its normal it is inactive, or impacts; faster along the ground it slides.

    Args:
        M: Stored as the attribute.
        rhs: Stored as the attribute.
        rows: Stored as the attribute.
        balance: Stored as the attribute.
        origin: Stored as the attribute.
        rest_speed: Stored as the attribute.
        from_state: M and rhs come from a `State`, which has checked them.
        stacked: (J, offset) of the rows, where they are known already.

    Raises:
        InputError: on sizes that do not fit, entries that are not finite, or an M that is not symmetric.
        DuplicateName: if two rows share a name.
        SingularInertia: if M is not positive definite; of an M from a `State`, when it is first factorised.

    Example:
        >>> slope = rbd.Rows("slope", J=np.array([[0.6, 0.8]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
        >>> problem = rbd.GaussProblem(M=2.0 * np.eye(2), rhs=np.array([0.0, -19.62]), rows=[slope])
        >>> problem.a_free, rbd.solve_problem(problem).a
        (array([ 0.  , -9.81]), array([ 4.7088, -3.5316]))
    """

    M: Array
    rhs: Array
    rows: Sequence[Rows] = ()
    balance: MomentumBalance | None = None
    origin: Origin | None = None
    rest_speed: float = REST_SPEED
    from_state: InitVar[bool] = False
    stacked: InitVar[tuple[Array, Array] | None] = None

    def __post_init__(self, from_state: bool, stacked: tuple[Array, Array] | None) -> None:
        if stacked is not None:
            self.__dict__["J"], self.__dict__["offset"] = stacked
        if not from_state:
            self._check_inertia()
        if self.rest_speed is not REST_SPEED:
            if not 0.0 <= as_float(self.rest_speed) < 1e100:
                raise InputError(f"rest_speed is {self.rest_speed!r:.80}; expected a speed of 0 or more [m/s, rad/s].")
            object.__setattr__(self, "rest_speed", float(self.rest_speed))
        rows = _rows(self.rows)
        object.__setattr__(self, "rows", rows)
        check_different([r.name for r in rows], "constraints")
        for r in rows:
            if r.J.shape[1] != self.nv:
                raise InputError(f"rows {r.name!r}: J has {r.J.shape[1]} columns; expected nv = {self.nv}.")
        if not (is_finite(self.J) and is_finite(self.offset)):
            for r in rows:
                check_finite(f"J of rows {r.name!r}", r.J)
                check_finite(f"bias of rows {r.name!r}", r.bias)
                check_finite(f"feedback of rows {r.name!r}", r.feedback)

    def _check_inertia(self) -> None:
        M, rhs = as_array("M", self.M), as_array("rhs", self.rhs)
        object.__setattr__(self, "M", M)
        object.__setattr__(self, "rhs", rhs)
        if M.ndim != 2 or M.shape[0] != M.shape[1] or M.shape[0] == 0:
            raise InputError(f"M has shape {M.shape}; expected a square (nv, nv).")
        n = M.shape[0]
        if rhs.shape != (n,):
            raise InputError(f"rhs has shape {rhs.shape}; expected ({n},), as M is {M.shape}.")
        check_finite("M", M)
        check_finite("rhs", rhs)
        if np.abs(M - M.T).max() > 1e-9 * np.abs(M).max():
            raise InputError(f"M is not symmetric: |M - M^T| reaches {np.abs(M - M.T).max():.2g}.")
        self.__dict__["factor"] = inertia_factor(M, strict=True)

    def __repr__(self) -> str:
        return f"GaussProblem(nv={self.nv}, m={self.m}, rows={[r.name for r in self.rows]})"

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return len(self.rhs)

    @property
    def m(self) -> int:
        """Number of scalar rows."""
        return self.J.shape[0]

    @lazy
    def slices(self) -> dict[str, slice]:
        """Slice of each constraint's rows in the stack."""
        out, at = {}, 0
        for r in self.rows:
            out[r.name] = slice(at, at + len(r))
            at += len(r)
        return out

    @lazy
    def J(self) -> Array:
        """Stacked Jacobian, shape (m, nv)."""
        return np.concatenate([r.J for r in self.rows]) if self.rows else np.zeros((0, self.nv))

    @lazy
    def bias(self) -> Array:
        """Stacked J_dot v, shape (m,)."""
        return np.concatenate([r.bias for r in self.rows]) if self.rows else np.zeros(0)

    @lazy
    def offset(self) -> Array:
        """Stacked bias + feedback, shape (m,)."""
        if not any(r.stabilised for r in self.rows):
            return self.bias
        return self.bias + np.concatenate([r.feedback for r in self.rows])

    @lazy
    def offset_size(self) -> Array:
        """`|bias| + |feedback|`, shape (m,): the sizes of the offset's terms."""
        if not any(r.stabilised for r in self.rows):
            return np.abs(self.bias)
        return np.abs(self.bias) + np.abs(np.concatenate([r.feedback for r in self.rows]))

    @lazy
    def cone(self) -> Cone:
        """The product of the rows' sets."""
        return Product([r.cone for r in self.rows])

    @lazy
    def force_set(self) -> ForceSet:
        """The stacked sets as weights on columns, circular cones as they are, and what the rows' velocities decide."""
        return ForceSet.of(self.rows, self.rest_speed)

    def force_set_of(self, law: Law) -> ForceSet:
        """The sets that a law's weights belong to: with pyramids in place of circular cones where it has facets."""
        return self.force_set.pyramids if law.facets else self.force_set

    @property
    def bilateral(self) -> bool:
        """Whether every row is bilateral."""
        return self.force_set.bilateral

    @property
    def openings(self) -> tuple[Opening, ...]:
        """Points that separate faster than `rest_speed`: their forces are zero."""
        return self.force_set.openings

    @lazy
    def factor(self) -> Array:
        """Lower Cholesky factor L of M = L L^T (the upper triangle is undefined), shape (nv, nv)."""
        return inertia_factor(self.M)

    def solve_M(self, b: Array) -> Array:
        """M^-1 b."""
        return lapack.dpotrs(self.factor, b, lower=1)[0]

    @lazy
    def least_inertia(self) -> float:
        """Smallest diagonal entry of M, 1 at most: a lower bound of the scales of the equations of motion."""
        return min(1.0, *self.M.diagonal().tolist())

    @lazy
    def least_momentum(self) -> float:
        """Momentum rate that some coordinate's unit acceleration causes in every component, 1 at most; needs a balance.

        A lower bound: of positive entries alone.
        """
        assert self.balance is not None
        return max(0.0, min(1.0, *map(max, self.balance.A_g[:, :6].tolist())))

    @lazy
    def a_free(self) -> Array:
        """Acceleration without constraints, M^-1 rhs, shape (nv,)."""
        return self.solve_M(self.rhs)

    @lazy
    def whitened(self) -> Array:
        """W = L^-1 J^T, shape (nv, m): J in coordinates where the inertia metric is the Euclidean one."""
        # dtrtrs starts threads even at this size, dtrsm at 36 columns: 8 ms in place of 5 us on a busy machine of two cores.
        return blas.dtrsm(1.0, self.factor, self.J.T, lower=1) if self.m else np.zeros((self.nv, 0))

    @lazy
    def delassus(self) -> Array:
        """J M^-1 J^T = W^T W, shape (m, m)."""
        return self.whitened.T @ self.whitened

    @lazy
    def free_row_acceleration(self) -> Array:
        """J a_free + offset, shape (m,): row accelerations without constraint forces."""
        return self.J @ self.a_free + self.offset


def _rows(rows: Sequence[Rows]) -> tuple[Rows, ...]:
    if isinstance(rows, Rows):
        raise InputError(f"rows are a single Rows, {rows.name!r}; give a list, [rows].")
    out = tuple(listed_items("rows", rows, "a list of rbd.Rows"))
    for r in out:
        check_kind("an entry of rows", r, Rows, "rbd.Rows")
    return out


def checked(problem: GaussProblem) -> GaussProblem:
    """The problem, if it is one.

    Raises:
        InputError: if it is not one.
    """
    check_kind("problem", problem, GaussProblem, "a GaussProblem. For a robot, use rbd.solve(state, tau, ...)")
    return problem
