"""Two equal links with 2 th1 + th2 = pi: why does the end point move along a line through the base, and what accelerates it?

Problem 3 of the text [Duarte2021], the polar manipulator of [MussaIvaldi1986]. Base, elbow and end point make a
triangle with two equal sides, and the elbow opens twice as fast as the shoulder turns: the third side stays upright. On this
line the Jacobian has a zero off its diagonal: the shoulder moves the end point across it, and only the elbow along it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy as sp
from sympy.physics.mechanics import msprint

import rbd.planar

ELL = sp.Symbol("ell", positive=True)


@dataclass(frozen=True)
class Result:
    """The manipulator, the free arm, and the free arm's three parts with the relation put in."""

    polar: "rbd.planar.ConstrainedChain"
    arm: "rbd.planar.Chain"
    standard: dict[str, sp.Matrix]


def main(show: bool = True) -> Result:
    arm = rbd.planar.Chain(2, lengths=(ELL, ELL))
    th1, th2 = arm.q
    polar = rbd.planar.constrained(arm, sp.Eq(2 * th1 + th2, sp.pi))
    print("J of the free arm       ", short(arm.jacobian().tolist()))
    print("J of the free arm there ", short(simple(polar.full_jacobian()).tolist()))
    print("J of the manipulator    ", short(simple(polar.jacobian()).tolist()))
    for what in ("position", "velocity", "acceleration"):
        print(f"{what:24}", short(simple(getattr(polar, what)()).T.tolist()[0]))
    own, free, standard = polar.split(), arm.split(), {}
    print("Its parts, and those of the free arm with the relation put in:")
    for part in ("tangential", "centripetal", "coriolis"):
        standard[part] = simple(polar.on(getattr(free, part)))
        print(f"  {part:12}", short(simple(getattr(own, part)).T.tolist()[0]), "  and  ", short(standard[part].T.tolist()[0]))

    half = rbd.planar.Chain(2, lengths=(0.5, 0.5))
    angles = np.radians(np.linspace(10.0, 80.0, 8))
    q = np.column_stack([angles, np.pi - 2.0 * angles])
    heights = half.numeric.position(q)[:, 1]
    pairs = (f"{np.degrees(a):.0f} deg {y:.4f} m" for a, y in zip(angles[::2], heights[::2], strict=True))
    print("Links of 0.5 m:", ", ".join(pairs))
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        from rbd.visual.figures.planar_figures import plot_sticks

        figure = Figure(figsize=(4.5, 5.0), layout="constrained")
        plot_sticks(figure.subplots(), half, q, count=8)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/20_polar_manipulator.png", dpi=150)
        print("See out/20_polar_manipulator.png.")
    return Result(polar, arm, standard)


def simple(matrix: sp.Matrix) -> sp.Matrix:
    """Every entry simplified."""
    return sp.Matrix(matrix).applyfunc(sp.simplify)


def short(expression) -> str:
    """Write th1 for theta_1, l for ell."""
    return msprint(expression).replace("theta_", "th").replace("ell", "l")


def check(result: Result) -> None:
    """The line x = 0, y = 2 l sin th1; its derivatives; and what the free arm's centripetal and Coriolis parts are there."""
    polar, th1, t = result.polar, result.arm.q[0], result.arm.t
    rate, y = th1.diff(t), 2 * ELL * sp.sin(th1)
    for k, found in enumerate((polar.position(), polar.velocity(), polar.acceleration())):
        assert simple(found - sp.Matrix([0, y.diff(t, k) if k else y])).is_zero_matrix
    assert all(left.is_zero_matrix for left in polar.agreement().values()), "as the free arm moves with the relation put in"
    assert simple(polar.jacobian() - sp.Matrix([0, 2 * ELL * sp.cos(th1)])).is_zero_matrix
    there = simple(polar.full_jacobian())
    assert there[1, 0] == 0 and there[0, 1] == -ELL * sp.sin(th1), "off the diagonal"
    parts = result.standard
    second = ELL * sp.Matrix([-sp.cos(th1), sp.sin(th1)])  # the second link, on the relation
    assert simple(parts["coriolis"] - 4 * rate**2 * second).is_zero_matrix, "away from the elbow, as the rates are opposite"
    assert simple(parts["centripetal"] + rate**2 * sp.Matrix([0, y]) + 4 * rate**2 * second).is_zero_matrix
    assert simple(parts["centripetal"] + parts["coriolis"] - polar.split().centripetal).is_zero_matrix
    assert polar.split().coriolis.is_zero_matrix


if __name__ == "__main__":
    check(main())
