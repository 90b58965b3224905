"""Derivatives by differences, with an error where there is none; those of force elements by configuration and velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_array, check_finite
from rbd.errors import InputError, NotDifferentiable
from rbd.model.chart import Charts
from rbd.model.external import External, ForceElement, applied, elements_of
from rbd.model.state import State

SMOOTH = 1e-7
"""Largest error of a difference, over max(1, largest entry); up to 1e3 times as much if no step does better."""


@dataclass(frozen=True, eq=False)
class _Rule:
    """Differences from seven nodes: the slope, and two combinations of the values that vanish for smooth functions."""

    nodes: Array
    slope: Array
    lower_order: Array  # the fourth-order slope, less `slope`
    kink: Array  # half the jump of the slope at zero, of a function that is smooth on both sides


def _rules() -> tuple[_Rule, _Rule, _Rule]:
    both = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60.0
    ahead = np.array([-147, 360, -450, 400, -225, 72, -10]) / 60.0
    fourth, near = np.array([0, 1, -8, 0, 8, -1, 0]) / 12.0, np.array([-25, 48, -36, 16, -3, 0, 0]) / 12.0
    kink = np.array([1, -6, 15, -20, 15, -6, 1]) / 12.0  # 12 for |x|, 0 for x, x^2, ... x^5
    here = np.zeros(7)
    x = np.arange(7.0)
    return (
        _Rule(x - 3.0, both, fourth - both, kink),
        _Rule(x, ahead, near - ahead, here),
        _Rule(-x, -ahead, ahead - near, here),
    )


_RULES = _rules()
"""On both sides; ahead and behind, where the rows differ on the other side."""
STEP = 0.005 * 5.0**0.5
"""First step tried [rad, m]; irrational, so that it is no whole number of periods of the function."""


def slope(sample: Callable[[float], Array], here: Array, step: float, what: str) -> Array:
    """Derivative of a sample at zero, by differences of the sixth order with a step reduced until it converges.

    Raises:
        NotDifferentiable: if it has a kink, or different rows on the two sides.
    """
    best, miss = here, np.inf
    for _ in range(6):
        for rule in _RULES:
            values = [here if x == 0.0 else sample(step * x) for x in rule.nodes]
            if any(v.shape != here.shape for v in values):
                continue
            F = (np.array(values) - here) / step  # constant entries then have a slope of exactly zero
            found = rule.slope @ F
            off = np.maximum(np.abs(rule.lower_order @ F), np.abs(rule.kink @ F))
            worst = float((off / np.maximum(np.abs(found).max(initial=1.0), np.abs(here))).max(initial=0.0))
            if worst < miss:
                best, miss = found, worst
            break
        if miss <= SMOOTH:
            return best
        step /= 8.0
    if miss <= 1e3 * SMOOTH:
        return best
    raise NotDifferentiable(
        f"the constraints do not change smoothly with {what}: "
        + ("their rows appear and disappear." if miss == np.inf else f"its slopes on the two sides differ by {miss:.1e}.")
        + " Leave out the constraint (or its feedback), or move the state a little."
    )


def derivatives_of(external: External, state: State) -> tuple[Array, Array]:
    """(dtau_ext/dq on the tangent space, dtau_ext/dv) of all force elements among external forces, shapes (nv, nv).

    Those of pushes, whose point moves, are not in it: see `rbd.model.pose_derivatives`.

    Raises:
        InputError: derivatives of a wrong size or not finite, with the element's name.
        NotDifferentiable: an element without derivatives of its own has a kink here.
    """
    nv = state.robot.nv
    by_q, by_v = np.zeros((nv, nv)), np.zeros((nv, nv))
    for element in elements_of(external):
        for total, found in zip((by_q, by_v), element_derivatives(element, state), strict=True):
            total += found
    return by_q, by_v


def element_derivatives(element: ForceElement, state: State) -> tuple[Array, Array]:
    """(dtau/dq on the tangent space, dtau/dv) of one element; by differences of the sixth order if it has none of its own.

    Raises:
        InputError: derivatives of a wrong size or not finite, with the element's name.
        NotDifferentiable: an element without derivatives of its own has a kink here.
    """
    nv = state.robot.nv
    own = getattr(element, "derivatives", None)
    if not callable(own):
        return _differences(element, state)
    found = own(state)
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError(f"derivatives(state) of {element.name!r:.80} is {found!r:.80}; expected (dtau/dq, dtau/dv).")
    for what, value in zip(("dtau/dq", "dtau/dv"), found, strict=True):
        array = as_array(f"{what} of {element.name!r:.80}", value)
        if array.shape != (nv, nv):
            raise InputError(f"{what} of {element.name!r:.80} has shape {array.shape}; expected ({nv}, {nv}).")
        check_finite(f"{what} of {element.name!r:.80}", array)
    return found[0], found[1]


def _differences(element: ForceElement, state: State) -> tuple[Array, Array]:
    robot, q, v = state.robot, state.q, state.v
    here, unit = applied(element, state)[0], np.eye(robot.nv)

    def along(moved: Callable[[Array], State], step: float, what: str) -> Array:
        def by(i: int) -> Array:
            text = f"{what}[{i}] (force element {element.name!r:.80})"
            return slope(lambda h: applied(element, moved(h * unit[i]))[0], here, step, text)

        return np.column_stack([by(i) for i in range(robot.nv)])

    chart = Charts(robot).at(q)
    by_q = along(lambda dq: State(robot, chart.q(dq), v), STEP, "q")
    return by_q, along(lambda dv: State(robot, q, v + dv), 10.0 * STEP, "v")
