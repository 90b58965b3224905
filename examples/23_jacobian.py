"""What is the Jacobian matrix of f(x, y) = (x^2 y, 5 x + sin y), and what is it good for?

Problem 6 of the text [Duarte2021]. It is the best linear approximation near a point: the error is quadratic in the step.
And so Newton's method, which follows it, finds where f has a wanted value, doubling its digits at each step. Inverse
kinematics of chains of many links is the same: f is where the hand is.
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp

import rbd.planar


@dataclass(frozen=True)
class Result:
    """J in symbols, what is left beyond it at steps of 1e-1 to 1e-4, and Newton's distances from the wanted value."""

    J: sp.Matrix
    x: sp.Symbol
    y: sp.Symbol
    left: np.ndarray
    newton: np.ndarray


def main(show: bool = True) -> Result:
    x, y = sp.symbols("x y", real=True)
    f = sp.Matrix([x**2 * y, 5 * x + sp.sin(y)])
    J = rbd.planar.jacobian(f, (x, y))
    print("J =", J.tolist())
    print("det J =", sp.factor(J.det()))
    value, slope = sp.lambdify((x, y), f.T.tolist()[0]), sp.lambdify((x, y), J.tolist())

    here, direction = np.array([1.0, 2.0]), np.array([0.6, -0.8])
    print("  step      f(p + step) - f(p) - J step")
    left = []
    for step in (1e-1, 1e-2, 1e-3, 1e-4):
        beyond = np.array(value(*here + step * direction)) - value(*here) - slope(*here) @ (step * direction)
        left.append(float(np.linalg.norm(beyond)))
        print(f"{step:8.4f}      {left[-1]:.12f}")

    wanted, point, newton = np.array([1.5, 4.0]), here, []
    print(f"Newton's method to f = ({wanted[0]}, {wanted[1]}):")
    for k in range(6):
        miss = wanted - value(*point)
        newton.append(float(np.linalg.norm(miss)))
        print(f"  {k}: x = {point[0]:.12f}, y = {point[1]:.12f}, misses by {newton[-1]:.12f}")
        point = point + np.linalg.solve(slope(*point), miss)
    return Result(J, x, y, np.array(left), np.array(newton))


def check(result: Result) -> None:
    """((2 x y, x^2), (5, cos y)); the rest falls with the square of the step, the miss of Newton's method with its own."""
    x, y = result.x, result.y
    assert sp.Matrix(result.J) == sp.Matrix([[2 * x * y, x**2], [5, sp.cos(y)]])
    assert np.allclose(result.left[:-1] / result.left[1:], 100.0, rtol=0.1)
    assert result.newton[-1] < 1e-12


if __name__ == "__main__":
    check(main())
