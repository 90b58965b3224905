"""Derivatives of force elements by configuration and velocity: their own, or by differences on the manifold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rbd.answers.analysis.differences import STEP, slope
from rbd.arrays import Array, as_array, check_finite
from rbd.errors import InputError
from rbd.model.chart import Charts
from rbd.model.external import External, ForceElement, applied, elements_of
from rbd.model.state import State


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
