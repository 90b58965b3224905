"""What all elements between two places have in common: generalised force, derivatives, energy, from their coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.forces.coordinates import Anchor, Coordinates, Offset, Pair, Place, other_place, place_on
from rbd.constraints.forces.element_numbers import ByValue
from rbd.constraints.surface import check_words
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State


@dataclass(frozen=True, eq=False)
class ElementPicture(Displayed):
    """What a drawing of a force element needs.

    Attributes:
        kind: "spring", "damper", "torsion spring", "torsion damper", "bushing", "joint spring" or "joint damping".
        points: Its two ends in W, shape (2, 3) [m]; for one in a joint twice the joint's origin.
        axis: Of what turns, in W, shape (3,); None of what does not, and where there are several.
        value: The force along the line or the moment about the axis [N, N m], positive where it pushes the ends apart or
            turns the second end forward; None where there are several.

    Example:
        >>> box = rbd.testing.box()
        >>> spring = rbd.Spring("box", to=(0, 0, 2), stiffness=10.0, rest=1.0)
        >>> drawn = spring.picture(rbd.State(box, [0, 0, 0.5, 0, 0, 0, 1]))
        >>> drawn.kind, drawn.points.tolist(), drawn.value  # it is stretched by half a metre, and pulls
        ('spring', [[0.0, 0.0, 2.0], [0.0, 0.0, 0.5]], -5.0)
    """

    kind: str
    points: Array
    axis: Array | None
    value: float | None


class BetweenPlaces(ByValue, Displayed):
    """An element with coordinates x of two places, and the force F = preload - K (x - rest) - C x_dot conjugate to x.

    It adds J^T D^T F to tau_ext, with x_dot = D J v; its energy is 1/2 (x - rest)^T K (x - rest) - preload^T (x - rest).
    """

    frame: str
    name: str
    parameters: tuple[str, ...] = ()
    """Names of the parameters that `parameter_force` takes."""

    def _places(self) -> tuple[Place, Place]:
        """(to, frame)."""
        return self.__dict__["_ends"]

    def _coordinates(self, pair: Pair) -> Coordinates:
        raise NotImplementedError

    def _law(self, m: int) -> tuple[Array, Array, Array]:
        """(K (m, m), C (m, m), preload (m,))."""
        raise NotImplementedError

    def _stretch(self, x: Array) -> Array:
        """The coordinates less their rest, shape (m,)."""
        return x

    def _settle(self, kind: str, to: Anchor, offset: Offset, to_offset: Offset) -> str:
        """Check where it acts, and give it a name; what it is called in messages."""
        what = f"a {kind} at {self.frame!r:.80}"
        places = other_place(what, to, to_offset), place_on(what, self.frame, offset)
        given = f"{kind} from {places[1]} to {places[0]}" if self.name is None else self.name
        check_words(what, name=given)
        self.__dict__.update(_ends=places, name=given)
        return repr(given)[:82]

    def check_on(self, robot: CheckedModel) -> None:
        """Refuse a robot without the frames of its ends.

        Raises:
            FrameNotFound: with the nearest names.
        """
        for place in self._places():
            if place.frame is not None:
                robot.site(place.frame)

    def _at(self, state: State) -> tuple[Pair, Coordinates, Array]:
        """(the ends, the coordinates, F)."""
        pair = Pair(state, *self._places())
        found = self._coordinates(pair)
        K, C, preload = self._law(len(found.x))
        return pair, found, preload - K @ self._stretch(found.x) - C @ (found.D @ pair.u)

    def force(self, state: State) -> Array:
        """F at a state, conjugate to the element's coordinates, on `frame`; shape (1,), of a bushing (6,) [N, N m]."""
        return self._at(state)[2]

    def generalised(self, state: State) -> tuple[Array, Array]:
        """(tau, wrench): tau = J^T D^T F, shape (nv,), and the wrench of the ground about the centre of mass, shape (6,).

        The wrench is zero if both ends are on the robot.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: where the element has no force, e.g. at zero length.
        """
        pair, found, F = self._at(state)
        w = found.D.T @ F
        return pair.J.T @ w, pair.outside(w)

    def derivatives(self, state: State) -> tuple[Array, Array]:
        """(dtau/dq on the tangent space, dtau/dv), shapes (nv, nv).

        dtau/dv = -(D J)^T C (D J), symmetric and negative semidefinite. dtau/dq has the same with K, the change of D and J
        under the present force (geometric stiffness), and that of the damper's rate.
        """
        pair, found, F = self._at(state)
        J, (K, C, _) = pair.J, self._law(len(found.x))
        A, change = found.D @ J, found.change()
        dF = -K @ A
        if C.any() and state.v.any():
            dF -= C @ (pair.u @ change @ J + found.D @ pair.velocity_dq())
        by_q = pair.geometric(found.D.T @ F) + J.T @ (np.einsum("k,kij", F, change) @ J) + A.T @ dF
        return by_q, -A.T @ C @ A

    def energy(self, state: State) -> float:
        """1/2 (x - rest)^T K (x - rest) - preload^T (x - rest) [J]; zero of a damper."""
        x = self._at(state)[1].x
        y, (K, _, preload) = self._stretch(x), self._law(len(x))
        return float(0.5 * y @ K @ y - preload @ y)

    def dissipation(self, state: State) -> float:
        """x_dot^T C x_dot [W]; zero of a spring."""
        pair, found, _ = self._at(state)
        rate = found.D @ pair.u
        return float(rate @ self._law(len(rate))[1] @ rate)

    def parameter_force(self, state: State, parameter: str) -> Array | dict[str, Array]:
        """Derivative of tau by one of its `parameters`, shape (nv,); of several numbers {label: (nv,)}.

        Raises:
            InputError: it has no such parameter; or none that the force depends on smoothly at this state.
        """
        check_parameter(self.name, parameter, self.parameters)
        pair, found, _ = self._at(state)
        A = found.D @ pair.J
        by = self._by_parameter(parameter, found.x, found.D @ pair.u)
        return {label: A.T @ dF for label, dF in by.items()} if isinstance(by, dict) else A.T @ by

    def _by_parameter(self, parameter: str, x: Array, rate: Array) -> Array | dict[str, Array]:
        """The derivative of F by a parameter, shape (m,)."""
        raise NotImplementedError

    def picture(self, state: State) -> ElementPicture:
        """Its ends, axis and force at a state, for drawings."""
        raise NotImplementedError


def check_parameter(name: str, parameter: str, known: Sequence[str]) -> None:
    """Refuse a parameter that an element does not have.

    Raises:
        InputError: with those that it has.
    """
    if not isinstance(parameter, str) or parameter not in known:
        raise InputError(f"{name!r:.80} has no parameter {parameter!r:.80}; {nearest(parameter, known)}.")
