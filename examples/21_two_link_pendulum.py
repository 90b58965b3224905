"""How does a pendulum of two links move, its angles measured from the vertical?

Problem 4 of the text [Duarte2021]: the kinematics, and then what they are needed for: Lagrange's equations, their small
swings in closed form, and a large swing twice: these equations integrated by SciPy, and the same chain as a robot, simulated.
"""

from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import msprint

import rbd
import rbd.planar

G = 9.81
START = np.radians([120.0, 100.0])
"""Released from here, both links above the horizontal [rad from the downward vertical]."""
CLOSED = {"points": (2.0 - sqrt(2.0), 2.0 + sqrt(2.0)), "rods": (3.0 - 6.0 / sqrt(7.0), 3.0 + 6.0 / sqrt(7.0))}
"""Squared rates of the small swings over g/l, of textbooks."""


@dataclass(frozen=True)
class Result:
    """Squared rates of the small swings over g/l, {bodies: (2,)}; times [s], angles of both ways [rad], energies [J]."""

    squares: dict[str, np.ndarray]
    times: np.ndarray
    by_lagrange: np.ndarray
    by_robot: np.ndarray
    energy: np.ndarray


def main(show: bool = True) -> Result:
    pendulum = rbd.planar.Chain(2, angles="vertical")
    for what in ("position", "velocity", "acceleration"):
        for axis, row in zip("xy", getattr(pendulum, what)(), strict=True):
            print(f"{what} {axis}: {short(row)}")
    points = rbd.planar.dynamics(pendulum, bodies="points")
    print("Lagrange, masses at the ends, tau =")
    for row in points.equations:
        print(f"  {short(row)}")
    metre = pendulum.with_lengths((1.0, 1.0))
    squares = {}
    for bodies, closed in CLOSED.items():
        modes = rbd.planar.dynamics(metre, bodies=bodies, masses=(1, 1), gravity=G).linearised().modes()
        squares[bodies] = np.array(modes.squared, dtype=float) / G
        shown = " and ".join(f"{x:.9f}" for x in squares[bodies])
        print(f"Small swings, two equal {bodies}: w^2 = {shown} g/l; closed form {closed[0]:.9f} and {closed[1]:.9f}")

    rods = rbd.planar.dynamics(metre, bodies="rods", masses=(1, 1), gravity=G)
    times = np.linspace(0.0, 2.0, 201)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], rods.forward(x[:2], x[2:])])

    path = solve_ivp(rate, (0.0, 2.0), np.concatenate([START, np.zeros(2)]), "DOP853", times, rtol=1e-12, atol=1e-12).y.T
    robot = rbd.planar.to_robot(rods)
    coordinates = rbd.planar.robot_coordinates(metre)
    way = rbd.simulate(robot.at(coordinates(START)), duration=2.0, step=5e-4)
    by_robot = coordinates.inverse(way.q[::20])
    energy = rods.function(rods.energy)(path[:, :2], path[:, 2:])
    print(f"Two rods of 1 m and 1 kg, released at ({', '.join(f'{x:.0f}' for x in np.degrees(START))}) deg from the vertical:")
    for k in (0, 50, 100, 150, 200):
        a, b = np.degrees(path[k, :2]), np.degrees(by_robot[k])
        print(f"  {times[k]:.1f} s: {a[0]:9.3f} {a[1]:9.3f} deg by Lagrange, {b[0]:9.3f} {b[1]:9.3f} deg by rbd.simulate")
    result = Result(squares, times, path[:, :2], by_robot, energy)
    print(f"Largest difference {np.abs(result.by_lagrange - by_robot).max():.0e} rad; energy moves by {np.ptp(energy):.0e} J.")
    if show:
        Path("out").mkdir(exist_ok=True)
        print(f"See {way.export('out/21_two_link_pendulum.html')}.")
    return result


def short(expression) -> str:
    """Write th1 for theta_1, l1 for ell_1, m1 for m_1."""
    return msprint(expression).replace("theta_", "th").replace("ell_", "l").replace("m_", "m")


def check(result: Result) -> None:
    """Small swings as in textbooks; both ways are the same motion, and energy stays."""
    assert all(np.allclose(result.squares[bodies], closed, rtol=1e-12) for bodies, closed in CLOSED.items())
    assert np.abs(result.by_lagrange - result.by_robot).max() < 1e-8
    assert np.ptp(result.energy) < 1e-9


if __name__ == "__main__":
    check(main())
