"""The acceleration of a chain's end point in the text's three parts: tangential, centripetal, Coriolis.

With r(q) the position, the chain rule gives a = J qdd + sum_ij r_ij qd_i qd_j, where r_ij is the second derivative of r:

- tangential: J qdd, the terms in qdd_i;
- centripetal: sum_i r_ii qd_i^2. In joint angles r_ii = -(P - joint i - 1), so each term points from P to the joint that turns;
- Coriolis: 2 sum_{i<j} r_ij qd_i qd_j. In joint angles r_ij = -(P - joint j - 1), the later joint of the two.

The parts depend on how angles are measured, their sum does not. In segment angles, and from the vertical, every link's
direction is a function of its own angle alone: r_ij = 0 for i != j, and there is no Coriolis part; what it was in joint angles
is then in the centripetal one, (th1' + th2')^2 being the square of one segment's rate.

Source: [Duarte2021], two links, after "Linear acceleration"; here for n.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Generic, TypeVar

from rbd.arrays import Array
from rbd.planar import expressions
from rbd.planar.angles import JOINT, Symbols, to_segments
from rbd.planar.kinematics import check_joint, jacobian, segment_vectors, total

if TYPE_CHECKING:
    from rbd.planar.chain import Chain

Value = TypeVar("Value", Symbols, Array)


@dataclass(frozen=True, eq=False)
class Split(Generic[Value]):
    """An acceleration in three parts [m/s^2]; in symbols (2, 1), in numbers (2,) or (samples, 2).

    Attributes:
        tangential: Terms in the angular accelerations.
        centripetal: Terms in the square of one angular velocity.
        coriolis: Terms in the product of two; zero in segment angles and from the vertical, and of a single link.
        angles: The convention that the parts belong to.
    """

    tangential: Value
    centripetal: Value
    coriolis: Value
    angles: str

    @property
    def total(self) -> Value:
        """The acceleration itself, the sum of the parts."""
        return self.tangential + self.centripetal + self.coriolis

    @property
    def note(self) -> str:
        """Why there is a Coriolis part or not, in words."""
        if self.angles == JOINT:
            return "In joint angles a link turns with every joint before it: products of two rates remain, the Coriolis part."
        return (
            f"In {self.angles} angles every link turns by its own angle alone: no product of two rates occurs, so there is no "
            "Coriolis part."
        )

    def _repr_latex_(self) -> str:
        """The three parts below each other, for notebooks."""
        return expressions.in_dollars(expressions.latex(self))


def split_acceleration(chain: Chain, i: int | None = None) -> Split[Symbols]:
    """The acceleration of joint i in its three parts, in symbols [m/s^2].

    Raises:
        InputError: if i is none of 0..n.
    """
    last, qd = check_joint(chain, i), chain.qd
    moved_by, _ = to_segments(chain.n, chain.angles)
    turned_again = [-vector for vector in segment_vectors(chain, 0)[:last]]

    def second_derivative(j: int, k: int) -> Symbols:
        return total([vector for m, vector in enumerate(turned_again) if moved_by[m, j] and moved_by[m, k]])

    return Split(
        tangential=jacobian(chain, last) * chain.qdd,
        centripetal=total([second_derivative(j, j) * qd[j] ** 2 for j in range(chain.n)]),
        coriolis=total([second_derivative(j, k) * (2 * qd[j] * qd[k]) for j, k in combinations(range(chain.n), 2)]),
        angles=chain.angles,
    )
