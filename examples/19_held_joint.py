"""One joint of a two-link arm is locked at zero: what is left of its Jacobian, and how does its end point move?

Problem 2 of the text [Duarte2021]. With the first joint held the second link turns about an elbow that stands still; with the
second held both links are one. Either way what is left is a single link, known by its Jacobian of one column. The second case
is a singular pose of the free arm, where both columns are parallel: the constrained arm is regular there.
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp
from sympy.physics.mechanics import msprint

import rbd.planar


@dataclass(frozen=True)
class Result:
    """{joint held: the constrained chain}, and {joint held: largest difference from one link alone [m/s2]}."""

    held: dict[int, "rbd.planar.ConstrainedChain"]
    apart: dict[int, float]


def main(show: bool = True) -> Result:
    arm = rbd.planar.Chain(2)
    print("Free:        J =", short(arm.jacobian().tolist()))
    held, apart = {}, {}
    for joint, ordinal in ((1, "first"), (2, "second")):
        chain = held[joint] = rbd.planar.constrained(arm, {joint: 0})
        print(f"With the {ordinal} joint held at 0:")
        J = chain.full_jacobian()
        print("  the free J =", short(J.tolist()), " det J =", short(sp.simplify(J.det())))
        for what in ("jacobian", "position", "velocity", "acceleration"):
            print(f"  {what:12}", short(getattr(chain, what)().applyfunc(sp.factor).T.tolist()[0]))
        parts = chain.split()
        for what in ("tangential", "centripetal", "coriolis"):
            print(f"    {what:12}", short(getattr(parts, what).applyfunc(sp.factor).T.tolist()[0]))
        apart[joint] = against_one_link(chain, joint)
        print(f"  one link alone accelerates the same way, to {apart[joint]:.0e} m/s2")
    return Result(held, apart)


def against_one_link(chain: "rbd.planar.ConstrainedChain", joint: int) -> float:
    """The largest difference, over random motions, from a link of ell_2 about a fixed elbow, or of ell_1 + ell_2 [m/s2]."""
    rng = np.random.default_rng(0)
    acceleration = chain.function(chain.acceleration(), parameters={"ell_1": 0.4, "ell_2": 0.3})
    alone = rbd.planar.Chain(1, lengths=[0.3 if joint == 1 else 0.7])
    q, qd, qdd = rng.uniform(-3.0, 3.0, (3, 50, 1))
    return float(np.abs(acceleration(q, qd, qdd) - alone.numeric.acceleration(q, qd, qdd)).max())


def short(expression) -> str:
    """Write th1 for theta_1, l1 for ell_1."""
    return msprint(expression).replace("theta_", "th").replace("ell_", "l")


def check(result: Result) -> None:
    """A circle of ell_2 about (ell_1, 0), a circle of ell_1 + ell_2 about the base; both ways to differentiate agree."""
    arm = rbd.planar.Chain(2)
    l1, l2 = arm.lengths
    th1, th2 = arm.q
    first, second = result.held[1], result.held[2]
    assert first.position() == sp.Matrix([l1 + l2 * sp.cos(th2), l2 * sp.sin(th2)])
    assert sp.simplify(second.position() - (l1 + l2) * sp.Matrix([sp.cos(th1), sp.sin(th1)])).is_zero_matrix
    assert first.jacobian() == l2 * sp.Matrix([-sp.sin(th2), sp.cos(th2)])
    assert sp.simplify(first.full_jacobian().det() - l1 * l2 * sp.sin(th2)) == 0
    assert sp.simplify(second.full_jacobian().det()) == 0, "stretched: the free arm is singular"
    for chain in result.held.values():
        assert chain.mobility == 1 and all(left.is_zero_matrix for left in chain.agreement().values())
        assert chain.split().coriolis.is_zero_matrix, "one rate has no product with another"
    assert max(result.apart.values()) < 1e-12


if __name__ == "__main__":
    check(main())
