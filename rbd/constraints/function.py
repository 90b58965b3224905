"""Constraints given by a function of the configuration; its derivatives by differences.

Differences are of sixth order, along curves on the manifold of configurations, all of a state together. The step is chosen
by comparison: those of fourth and of sixth order, on the same seven nodes, agree where the function is smooth over the step,
and the step shrinks until they do. With noise, a jump or a kink they never agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rbd.arrays import Array, as_array, as_finite, identity, is_finite, lazy, max_abs, zeros
from rbd.constraints.surface import check_state, check_words
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError
from rbd.model.dynamics import polarised
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, NonNegative
from rbd.problem.difference_kernel import judged
from rbd.problem.rows import Rows

STEP = 0.01
"""First step tried on the tangent space [m, rad]: there rounding and truncation of a function of unit length balance."""
ROUGH = 1e-6
"""If they never agree to this, relative, the function counts as not differentiable."""
NODES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
FIRST = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
"""Weights of the values at the nodes in a first derivative of sixth order, over the step."""


@dataclass(frozen=True, eq=False)
class FunctionConstraint(Displayed):
    """Constraint phi(q) = 0, or >= 0, for any function of the configuration: loops, distances, couplings, a wire on a path.

    Its rows::

        error = phi(q)        J v = d phi / dt        J_dot v = d2 phi / dt2 along q (+) t v, where v_dot = 0

    Without `jacobian` J is taken by differences of sixth order on the manifold, along each coordinate of v, exact to 1e-10 of
    the largest of phi and J for a smooth phi; J_dot v to 1e-9. The step starts at 0.01 m or rad and shrinks until two
    orders agree; a phi without a derivative here, or with noise above 1e-8, is refused.

    Time goes into phi: six configurations a coordinate of v, and six for J_dot v. A phi that also takes many at once, as the
    columns of q, shape (nq, k), and then gives (m, k), is called once for all of them: one of array operations on the entries
    of q, `np.hypot(q[0], q[1]) - l` and not `math.hypot(q[0], q[1]) - l`; likewise a `jacobian` that then gives (m, nv, k).
    This is found out at the first state, where all are given one by one as well: with an error, or other values, that remains
    so. Both should be functions of q alone. Where time matters and phi is not of this kind, give `jacobian` and `bias`: both
    are trusted; `rbd.testing.check_constraint` checks them.

    q has unit quaternions (x, y, z, w) and, of continuous joints, (cos, sin): phi receives q itself, shape
    (nq,). J has one column an entry of v, shape (m, nv): for a joint with one degree of freedom dphi/dq_i, for a floating
    base by velocities in the base's axes. Row forces are in units of work over phi (newtons where phi is in metres);
    `J^T f` is the generalised force.

    Attributes:
        name: The constraint's role, e.g. "four_bar".
        phi: Takes q, gives a number or an array (m,); an empty one where the constraint is inactive.
        jacobian: Takes q, gives (m, nv); or (nv,) where m = 1. None: by differences.
        bias: Takes q and v, gives J_dot v, shape (m,). None: by differences, of `jacobian` where that is given.
        cone: Force set; `rbd.problem.Free(m)` by default. `rbd.problem.NonNegative(m)`: phi >= 0 with a
            force that only pushes.

    Raises:
        InputError: if one of them is not a function.

    Example:
        >>> bead = rbd.testing.box(mass=2.0)
        >>> rod = rbd.FunctionConstraint("rod", lambda q: np.linalg.norm(q[:3]) - 1.0)  # 1 m from the origin
        >>> solution = rbd.solve(rbd.State(bead, [0.6, 0, -0.8, 0, 0, 0, 1]), [], [rod])
        >>> solution.a[:3].round(3), solution.forces["rod"].round(3)
        (array([-4.709,  0.   , -3.532]), array([-15.696]))
    """

    name: str
    phi: Callable[[Array], Any]
    jacobian: Callable[[Array], Any] | None = field(default=None, kw_only=True)
    bias: Callable[[Array, Array], Any] | None = field(default=None, kw_only=True)
    cone: Cone | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_function(self.name, "phi", self.phi)
        check_function(self.name, "jacobian", self.jacobian, optional=True)
        check_function(self.name, "bias", self.bias, optional=True)
        if self.cone is not None and (isinstance(self.cone, type) or not hasattr(self.cone, "generators")):
            raise InputError(
                f"cone of {self.name!r:.80} is {self.cone!r:.80}; expected rbd.problem.Free(m) or rbd.problem.NonNegative(m)."
            )

    def rows(self, state: State) -> Rows:
        """One row an entry of phi.

        Raises:
            InputError: phi, `jacobian` or `bias` raises, does not return an array of real numbers, changes its size or is not
                finite; phi has no derivative here.
        """
        check_state(state, self.name)
        error, v = self._values.vector(None, state.q), state.v
        m = len(error)
        if not m:
            none = Free(0) if self.cone is None or self.cone.bilateral else NonNegative(0)
            return Rows(self.name, np.zeros((0, state.robot.nv)), np.zeros(0), none)
        near, turns = self._near(state, error), self.bias is None
        if self.jacobian is None:
            J, bias = self._derivatives(near, v if turns else state.robot.zero_v)
        else:
            J = self._jacobians.matrix(m, state.robot.nv, state.q)
            bias = rate(self._jacobians, state, J) if turns else zeros(m)
        if self.bias is not None:
            bias = self._biases.vector(m, state.q, v)
        if self.cone is not None:
            return Rows(self.name, J, bias, self.cone, J @ v, error)
        return Rows.unchecked(self.name, J, bias, Free(m), J @ v, error, None, None)

    def hessian(self, state: State) -> Array:
        """H(q) with J_dot v = v @ H @ v, shape (m, nv, nv): see `rbd.dynamics.constraint_hessian`.

        From `bias` where that is given, from derivatives of `jacobian` along each coordinate of v, or from second derivatives
        of phi along these and along the sum of each two, at six calls a direction. Exact as J_dot v is: to 1e-9 of the largest
        of phi and J.

        Raises:
            InputError: as `rows`; a bias that is not zero at v = 0, so that it is not quadratic in v.
        """
        check_state(state, self.name)
        error, nv = self._values.vector(None, state.q), state.robot.nv
        if not len(error):
            return np.zeros((0, nv, nv))
        near = self._near(state, error)
        if self.bias is not None:
            return polarised(lambda v: self._biases.vector(len(error), state.q, v), nv, self.name)
        if self.jacobian is not None:
            J = self._jacobians.matrix(len(error), nv, state.q)
            return hessian_by_rates(self._jacobians, state, J)
        size = _largest(self._derivatives(near, state.robot.zero_v)[0])
        return polarised(lambda v: self._second(near, v, size), nv, self.name)

    @lazy
    def _values(self) -> UserFunction:
        return UserFunction(self.name, "phi", self.phi)

    @lazy
    def _jacobians(self) -> UserFunction:
        return UserFunction(self.name, "jacobian", self.jacobian)

    @lazy
    def _biases(self) -> UserFunction:
        return UserFunction(self.name, "bias", self.bias)

    def _near(self, state: State, error: Array) -> Neighbourhood:
        """Around a state where phi is `error`."""
        if not is_finite(error):
            found = np.array2string(error, threshold=6)
            raise InputError(f"phi of {self.name!r:.80} is {found} at this state; expected finite numbers.")
        return Neighbourhood(state, lambda at: self._values.many(at, state.q, error), error)

    def _derivatives(self, near: Neighbourhood, v: Array) -> tuple[Array, Array]:
        """(J (m, nv), J_dot v (m,)) by differences."""
        nv, square = len(v), float(v @ v)
        if not square:
            return near.derivatives(self._values, identity(nv), nv).T, zeros(len(near.middle))
        found = near.derivatives(self._values, np.concatenate([identity(nv), v[None] / math.sqrt(square)]), nv)
        return found[:nv].T, found[nv] * square

    def _second(self, near: Neighbourhood, v: Array, size: float) -> Array:
        """J_dot v alone, where J has a size, shape (m,)."""
        if not v.any():
            return np.zeros(len(near.middle))
        return near.derivatives(self._values, v[None] / np.linalg.norm(v), 0, size)[0] * (v @ v)


def check_function(name: str, what: str, value: object, *, optional: bool = False) -> None:
    """Refuse a name that is not a string, and an object that is not callable.

    Raises:
        InputError: naming the value.
    """
    check_words("a constraint", name=name)
    if not callable(value) and not (optional and value is None):
        raise InputError(f"{what} of {name!r:.80} is {value!r:.80}; expected a function of q.")


class UserFunction:
    """A user's function of q: its values at one configuration, checked, and at many.

    Many are given in one call, as columns of q, shape (nq, k), to a function that takes them: its values then have one more
    axis, the last, shape (m, k) or (m, nv, k). Whether it does is found out at the first need, by its values one by one. Each
    later call has the configuration in the middle as one of its columns, whose value is known: if that comes out otherwise,
    or the function raises, configurations are given one by one from then on.

    Args:
        name: The constraint's.
        what: The function's, for messages.
        f: The function; it gets copies.

    Attributes:
        name: The constraint's.
        what: The function's, for messages.
        takes_columns: Whether it takes many configurations; None: not found out yet.
    """

    def __init__(self, name: str, what: str, f: Callable[..., Any] | None) -> None:
        assert f is not None
        self.name, self.what, self._f = name, what, f
        self.takes_columns: bool | None = None

    def vector(self, m: int | None, *given: Array) -> Array:
        """Its value as an array (m,), None for any m; a number counts as (1,).

        Raises:
            InputError: the function raises, or returns another type.
        """
        out = np.atleast_1d(self._called(given))
        if out.ndim != 1 or (m is not None and len(out) != m):
            expected = "a number or an array (m,)" if m is None else f"({m},), as phi has at this state"
            raise InputError(f"{self.what} of {self.name!r:.80} gave an array of shape {out.shape}; expected {expected}.")
        return out

    def matrix(self, m: int | None, nv: int, q: Array) -> Array:
        """Its value as an array (m, nv), None for any m; (nv,) counts as one row.

        Raises:
            InputError: the function raises, returns another type, or numbers that are not finite.
        """
        out = self._called((q,))
        out, meaning = out[None] if out.ndim == 1 else out, ", one column an entry of v"
        if out.ndim == 2 and out.shape == (len(out) if m is None else m, nv) and is_finite(out):
            return out
        return as_finite(f"{self.what} of {self.name!r:.80}", out, ("m" if m is None else m, nv), meaning=meaning)

    def many(self, at: Array, q: Array, middle: Array) -> Array:
        """Its values at configurations, shape (k, nq), along the first axis; not all need be finite.

        Args:
            at: The configurations.
            q: That in the middle.
            middle: The value there, as `vector` or `matrix` gave it.

        Raises:
            InputError: the function raises, or returns another type.
        """
        together = None if self.takes_columns is False else self._by_columns(at, q, middle)
        if together is None or self.takes_columns is None:
            alone = self._one_by_one(at, middle)
            self.takes_columns = together is not None and np.allclose(
                together, alone, rtol=0.0, atol=SAME * _largest(alone), equal_nan=True
            )
            return alone if together is None or not self.takes_columns else together
        return together

    def _by_columns(self, at: Array, q: Array, middle: Array) -> Array | None:
        """The values by one call; None if it does not take columns, or gives another value in the middle."""
        shape, k = middle.shape, len(at) + 1
        columns = np.empty((len(q), k))
        columns[:, 0], columns[:, 1:] = q, at.T
        try:
            out = np.asarray(self._f(columns))
        except Exception:  # whatever a function raises that is not made for columns
            return None
        if out.dtype != float or out.shape not in ((*shape, k), (*shape[1:], k)) or out.size != k * middle.size:
            return None
        values = np.ascontiguousarray(out.reshape(-1, k).T).reshape(k, *shape)
        known = values[0].tobytes() == middle.tobytes() or _largest(values[0] - middle) <= SAME * _largest(values)
        return values[1:] if known else None

    def _one_by_one(self, at: Array, middle: Array) -> Array:
        shape, k = middle.shape, len(at)
        try:
            out = np.array([self._f(q.copy()) for q in at])
        except Exception:
            out = np.zeros(0)
        if out.dtype == float and out.shape in ((k, *shape), (k, *shape[1:])) and out.size == k * middle.size:
            return out.reshape(k, *shape)
        return np.array([self.vector(*shape, q) if len(shape) == 1 else self.matrix(shape[0], shape[1], q) for q in at])

    def _called(self, given: tuple[Array, ...]) -> Array:
        try:
            out = self._f(*(x.copy() for x in given))
        except RbdError:
            raise
        except Exception as error:
            raise InputError(f"{self.what} of {self.name!r:.80} raised {type(error).__name__}: {str(error):.200}.") from error
        return as_array(f"{self.what} of {self.name!r:.80}", out)


def rate(f: UserFunction, state: State, J: Array) -> Array:
    """J_dot v of a matrix J = f(q) along q (+) t v, by differences, shape (m,).

    Raises:
        InputError: f has no derivative here.
    """
    q, v = state.q, state.v
    length = math.sqrt(v @ v)
    if not length:
        return zeros(len(J))
    near = Neighbourhood(state, lambda at: f.many(at, q, J) @ v, J @ v)
    return near.derivatives(f, v[None] / length, 1, max_abs(J.ravel()))[0] * length


def hessian_by_rates(f: UserFunction, state: State, J: Array) -> Array:
    """H with J_dot v = v @ H @ v of a matrix J = f(q), from its derivatives along each coordinate of v, shape (m, nv, nv).

    Raises:
        InputError: f has no derivative here.
    """
    nv, near = state.robot.nv, Neighbourhood(state, lambda at: f.many(at, state.q, J), J.ravel())
    H = near.derivatives(f, identity(nv), nv, _largest(J)).reshape(nv, *J.shape).transpose(1, 0, 2)
    return 0.5 * (H + H.transpose(0, 2, 1))


STEPS = STEP * 0.25 ** np.arange(9)
"""The steps that are tried, in order."""
_REACH = np.outer(STEPS, NODES)
SAME = 1e-12
"""A function's values in one call with many configurations, and one by one, agree to this, over the largest of them."""


class Neighbourhood(NamedTuple):
    """The configurations around that of a state, and a function there.

    Attributes:
        state: That in the middle.
        f: Values at configurations (k, nq), with k along the first axis.
        middle: f(q), shape (m,).
    """

    state: State
    f: Callable[[Array], Array]
    middle: Array

    def derivatives(self, of: UserFunction, along: Array, slopes: int, size: float = 0.0) -> Array:
        """Derivatives of f(q (+) t e) at t = 0 for unit vectors e, shape (n, m), by steps that shrink until two orders agree.

        Args:
            of: What f computes, for messages; where it takes columns, two steps are evaluated together.
            along: The unit vectors, shape (n, nv).
            slopes: How many directions, the first ones, want the first derivative; the others want the second.
            size: Size of f's first derivatives, if known.

        Raises:
            InputError: the orders differ by more than `ROUGH` at every step.
        """
        n, m, robot = len(along), len(self.middle), self.state.robot

        def moved(left: Array, steps: slice) -> Array:
            reach = _REACH[steps]
            nodes = (along if len(left) == n else along[left])[:, None] * reach.reshape(-1, 1)
            return self.f(robot.moved(self.state.q, nodes.reshape(-1, robot.nv))).reshape(-1, len(reach), len(NODES), m)

        found, left = differences(moved, self.middle, n, slopes, size, 2 if of.takes_columns else 1)
        apart = float((found[:, m] / np.maximum(found[:, m + 1], _largest(found[:slopes, :m]))).max()) if len(left) else 0.0
        if not apart <= ROUGH:
            raise InputError(
                f"{of.what} of {of.name!r:.80} has no derivative here that differences can find (two orders are apart by "
                f"{min(apart, 1.0):.1g}, expected {ROUGH:g}): a kink, a jump, noise, or the end of where it is defined? Give "
                "its derivatives, or another state."
            )
        return found[:, :m]


def differences(
    moved: Callable[[Array, slice], Array], middle: Array, n: int, slopes: int, size: float = 0.0, together: int = 1
) -> tuple[Array, Array]:
    """(derivatives and how far their two orders are apart, shape (n, m + 2); directions in which they did not agree).

    Args:
        moved: Values at the nodes of some directions, given by their numbers, with some of `STEPS`, shape
            (directions, steps, nodes, m).
        middle: The value between them, shape (m,).
        n: How many directions.
        slopes: How many of them, the first ones, want the first derivative; the others want the second.
        size: Size of the first derivatives, if known.
        together: Steps that are evaluated together.
    """
    left, done, found = np.arange(n), 0, np.ones((n, len(middle) + 2))
    found[:, len(middle)] = np.inf
    while len(left) and done < len(STEPS):
        steps = slice(done, done + together)
        left, size = judged(moved(left, steps), middle, STEPS[steps], left, slopes, size, found)
        done += together
    return found, left


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
