"""Constraints given by a function of the configuration; its derivatives by differences.

Differences are of sixth order, along curves on the manifold of configurations. The step is chosen by comparison:
those of fourth and of sixth order, on the same seven nodes, agree where the function is smooth over the step, and the
step shrinks until they do. With noise, a jump or a kink they never agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_finite, is_finite
from rbd.constraints.surface import check_state, check_words
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError
from rbd.model.dynamics import polarised
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, NonNegative
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
    orders agree; a phi without a derivative here, or with noise above 1e-8, is refused. Twelve calls of phi a coordinate
    are slow: give `jacobian`, and `bias`, where time matters. Both are trusted; `rbd.testing.check_constraint` checks them.

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
        error = self._phi(state.q)
        m = len(error)
        if not m:
            none = Free(0) if self.cone is None or self.cone.bilateral else NonNegative(0)
            return Rows(self.name, np.zeros((0, state.robot.nv)), np.zeros(0), none)
        J = self._derivative(state, error)
        bias = self._bias(state, error, J, state.v)
        return Rows(self.name, J, bias, Free(m) if self.cone is None else self.cone, J @ state.v, error)

    def hessian(self, state: State) -> Array:
        """H(q) with J_dot v = v @ H @ v, shape (m, nv, nv): see `rbd.dynamics.constraint_hessian`.

        From `bias` where that is given, from derivatives of `jacobian` along each coordinate of v, or from second derivatives
        of phi along these and along the sum of each two, at six calls a direction. Exact as J_dot v is: to 1e-9 of the largest
        of phi and J.

        Raises:
            InputError: as `rows`; a bias that is not zero at v = 0, so that it is not quadratic in v.
        """
        check_state(state, self.name)
        error, nv = self._phi(state.q), state.robot.nv
        if not len(error):
            return np.zeros((0, nv, nv))
        J = self._derivative(state, error)
        if self.bias is None and self.jacobian is not None:
            return hessian_by_rates(self.name, "jacobian", state.robot.model, self._jacobian(state, len(error)), state.q)
        return polarised(lambda v: self._bias(state, error, J, v), nv, self.name)

    def _phi(self, q: Array, m: int | None = None) -> Array:
        return vector_of(self.name, "phi", self.phi, (q,), m)

    def _jacobian(self, state: State, m: int) -> Callable[[Array], Array]:
        return lambda at: matrix_of(self.name, "jacobian", self.jacobian, at, (m, state.robot.nv))

    def _derivative(self, state: State, error: Array) -> Array:
        """J at a state where phi is `error`, shape (m, nv)."""
        if not is_finite(error):
            found = np.array2string(error, threshold=6)
            raise InputError(f"phi of {self.name!r:.80} is {found} at this state; expected finite numbers.")
        if self.jacobian is not None:
            return self._jacobian(state, len(error))(state.q)
        J, apart = jacobian(state.robot.model, lambda at: self._phi(at, len(error)), state.q, error)
        check_smooth(self.name, "phi", apart)
        return J

    def _bias(self, state: State, error: Array, J: Array, v: Array) -> Array:
        """J_dot v at a velocity, shape (m,)."""
        model, q, m = state.robot.model, state.q, len(error)
        if self.bias is not None:
            return vector_of(self.name, "bias", self.bias, (q, v), m)
        if not v.any():
            return np.zeros(m)
        if self.jacobian is not None:
            return rate(self.name, "jacobian", model, self._jacobian(state, m), J, q, v)
        size = float(np.abs(J).max(initial=0.0))
        second = second_derivative(model, lambda at: self._phi(at, m), q, v, error, size=size)
        check_smooth(self.name, "phi", second.apart)
        return second.value


def check_function(name: str, what: str, value: object, *, optional: bool = False) -> None:
    """Refuse a name that is not a string, and an object that is not callable.

    Raises:
        InputError: naming the value.
    """
    check_words("a constraint", name=name)
    if not callable(value) and not (optional and value is None):
        raise InputError(f"{what} of {name!r:.80} is {value!r:.80}; expected a function of q.")


def vector_of(name: str, what: str, f: Callable[..., Any] | None, given: tuple[Array, ...], m: int | None) -> Array:
    """The result of a user's function, as an array (m,); a number counts as (1,).

    Args:
        name: The constraint's.
        what: The function's, for messages.
        f: The function; it gets copies.
        given: Its arguments.
        m: Expected size; None for any.

    Raises:
        InputError: the function raises, or returns another type.
    """
    out = np.atleast_1d(_called(name, what, f, given))
    if out.ndim != 1 or (m is not None and len(out) != m):
        expected = "a number or an array (m,)" if m is None else f"({m},), as phi has at this state"
        raise InputError(f"{what} of {name!r:.80} gave an array of shape {out.shape}; expected {expected}.")
    return out


def matrix_of(name: str, what: str, f: Callable[..., Any] | None, q: Array, shape: tuple[int | None, int]) -> Array:
    """The result of a user's function, as an array of this shape; (nv,) counts as one row.

    Raises:
        InputError: the function raises, returns another type, or numbers that are not finite.
    """
    out, m = _called(name, what, f, (q,)), "m" if shape[0] is None else shape[0]
    out = out[None] if out.ndim == 1 else out
    return as_finite(f"{what} of {name!r:.80}", out, (m, shape[1]), meaning=", one column an entry of v")


def _called(name: str, what: str, f: Callable[..., Any] | None, given: tuple[Array, ...]) -> Array:
    assert f is not None
    try:
        out = f(*(x.copy() for x in given))
    except RbdError:
        raise
    except Exception as error:
        raise InputError(f"{what} of {name!r:.80} raised {type(error).__name__}: {str(error):.200}.") from error
    return as_array(f"{what} of {name!r:.80}", out)


def rate(name: str, what: str, model: pin.Model, f: Callable[[Array], Array], J: Array, q: Array, v: Array) -> Array:
    """J_dot v of a matrix J = f(q) along q (+) t v, by differences, shape (m,).

    Raises:
        InputError: f has no derivative here.
    """
    found = first_derivative(model, lambda at: f(at) @ v, q, v, J @ v, size=float(np.abs(J).max(initial=0.0)))
    check_smooth(name, what, found.apart)
    return found.value


def hessian_by_rates(name: str, what: str, model: pin.Model, f: Callable[[Array], Array], q: Array) -> Array:
    """H with J_dot v = v @ H @ v of a matrix J = f(q), from its derivatives along each coordinate of v, shape (m, nv, nv).

    Raises:
        InputError: f has no derivative here.
    """
    J = f(q)
    size, rates = float(np.abs(J).max(initial=0.0)), []
    for e in np.eye(model.nv):
        found = first_derivative(model, lambda at: f(at).ravel(), q, e, J.ravel(), size=size)
        check_smooth(name, what, found.apart)
        rates.append(found.value.reshape(J.shape))
    H = np.array(rates).transpose(1, 0, 2)
    return 0.5 * (H + H.transpose(0, 2, 1))


def check_smooth(name: str, what: str, apart: float) -> None:
    """Refuse differences of fourth and sixth order that do not agree.

    Raises:
        InputError: they differ by more than `ROUGH` at every step.
    """
    if not apart <= ROUGH:
        raise InputError(
            f"{what} of {name!r:.80} has no derivative here that differences can find (two orders are apart by "
            f"{min(apart, 1.0):.1g}, expected {ROUGH:g}): a kink, a jump, noise, or the end of where it is defined? Give its "
            "derivatives, or another state."
        )


SHRINK, TRIES = 0.25, 9
FIRST_AGREED, SECOND_AGREED = 3e-8, 1e-7
"""Errors of fourth and sixth order are h^4 and h^6: if they agree to this, relative, the sixth is exact to 1e-11 and 5e-11."""


_FIRST_4 = np.array([0.0, 1.0, -8.0, 8.0, -1.0, 0.0]) / 12.0
_SECOND, _MIDDLE = np.array([2.0, -27.0, 270.0, 270.0, -27.0, 2.0]) / 180.0, -490.0 / 180.0
_SECOND_4, _MIDDLE_4 = np.array([0.0, -1.0, 16.0, 16.0, -1.0, 0.0]) / 12.0, -30.0 / 12.0


@dataclass(frozen=True, eq=False)
class Difference:
    """A derivative along a curve.

    Attributes:
        value: Shape (m,).
        gap: Difference between two orders, along the unit vector.
        scale: Its scale.
    """

    value: Array
    gap: float
    scale: float

    @property
    def apart(self) -> float:
        """The gap, relative."""
        return self.gap / self.scale


def jacobian(model: pin.Model, f: Callable[[Array], Array], q: Array, middle: Array) -> tuple[Array, float]:
    """(J, apart): f's derivatives by the coordinates of v, shape (m, nv), where `middle` is f(q)."""
    unit = np.eye(model.nv)
    found = [first_derivative(model, f, q, e, middle, tries=1) for e in unit]
    # Rounding in a column of zeros is small against the other columns, and needs no smaller step.
    size = max([_size(c.value) for c in found if c.gap <= FIRST_AGREED * c.scale], default=0.0)
    found = [
        c if c.gap <= FIRST_AGREED * max(c.scale, size) else first_derivative(model, f, q, e, middle, size=size)
        for e, c in zip(unit, found, strict=True)
    ]
    size = max(_size(c.value) for c in found)
    return np.column_stack([c.value for c in found]), max(c.gap / max(c.scale, size) for c in found)


def first_derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, *, size: float = 0.0, tries: int = TRIES
) -> Difference:
    """d/dt of f(q (+) t v) at t = 0.

    Args:
        model: Model of the manifold.
        f: Function of q with values (m,).
        q: Configuration.
        v: Velocity, not zero.
        middle: f(q).
        size: Size of f's derivatives along unit vectors, if known.
        tries: Largest number of steps tried.
    """
    return _derivative(model, f, q, v, middle, _first, max(size, 1e-6), tries)


def second_derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, *, size: float
) -> Difference:
    """d2/dt2 of f(q (+) t v) at t = 0; arguments as of `first_derivative`."""
    return _derivative(model, f, q, v, middle, _second, max(size, 1e-4), TRIES)


_Rule = Callable[[Array, Array, float, float], tuple[Difference, float]]


def _derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, rule: _Rule, size: float, tries: int
) -> Difference:
    """The derivative along the unit vector of v, scaled back."""
    length = float(np.linalg.norm(v))
    best, h = Difference(np.full(middle.shape, np.nan), np.inf, 1.0), STEP
    for _ in range(tries):
        values = np.array([f(pin.integrate(model, q, (node * h / length) * v)) for node in NODES])
        if np.isfinite(values).all():  # else the step left the function's domain
            found, agreed = rule(values, middle, h, size)
            if found.apart < best.apart:
                best = found
            if best.apart <= agreed:
                break
        h *= SHRINK
    return replace(best, value=best.value * (length if rule is _first else length**2))


def _first(values: Array, middle: Array, h: float, size: float) -> tuple[Difference, float]:
    first = FIRST @ values / h
    scale = max(_size(first), _size(middle), size)
    # A kink at the middle does not affect first differences and appears in second ones, as 1/h.
    second, second_4 = _SECOND @ values + _MIDDLE * middle, _SECOND_4 @ values + _MIDDLE_4 * middle
    gap = max(_size(first - _FIRST_4 @ values / h), _size(second - second_4) / h)
    return Difference(first, gap, scale), FIRST_AGREED


def _second(values: Array, middle: Array, h: float, size: float) -> tuple[Difference, float]:
    second = (_SECOND @ values + _MIDDLE * middle) / h**2
    scale = max(_size(second), _size(FIRST @ values) / h, _size(middle), size)
    return Difference(second, _size(second - (_SECOND_4 @ values + _MIDDLE_4 * middle) / h**2), scale), SECOND_AGREED


def _size(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
