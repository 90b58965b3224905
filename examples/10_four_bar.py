"""A crank turns: where do the other links of a four-bar go, how fast, and is the text's loop the same as the robot's?

First the rhombus of the text, all links 1 m, crank at 30 deg and 1 rad/s: its loop L1 e^(i th1) + L2 e^(i th2) + L3 e^(i th3) +
L4 = 0 as a function of q, its two branches, rates, and det J2 = L2 L3 sin(th3 - th2). The text draws the ground to the left:
turned by half a turn it is the robot here, th1 = crank - pi, th2 = coupler - pi, th3 = rocker. Then Norton's four-bar, with
accelerations and the force in its pin.
"""

from dataclasses import dataclass
from math import radians
from pathlib import Path

import numpy as np

import rbd
from rbd.mechanism import (
    acceleration_partition,
    branches,
    four_bar,
    link_angles,
    link_jacobians,
    link_rates,
    velocity_partition,
)


@dataclass(frozen=True)
class Result:
    """Text's angles [deg], rates [rad/s] and det J2 of both branches; Norton's angles, rates and accelerations."""

    angles: list[tuple[float, float]]
    rates: list[tuple[float, float]]
    det_J2: list[float]
    apart: float
    norton: tuple[np.ndarray, np.ndarray, np.ndarray]
    pin_N: float


def main(show: bool = True) -> Result:
    rhombus = four_bar(1.0, 1.0, 1.0, 1.0, crank_angle=radians(30.0 - 180.0))
    text = rbd.FunctionConstraint("text", lambda q: loop_of_the_text(rbd.State(rhombus, q)))
    found = branches(rhombus.at(), rhombus.loops(), fixed={"crank_joint": radians(30.0 - 180.0)})
    angles, rates, det_J2, apart = [], [], [], 0.0
    print("The text's rhombus, crank at 30 deg and 1 rad/s:  th2     th3     th2'    th3'    det J2")
    for branch in found.found:
        state = rbd.State(rhombus, branch.q)
        by_robot = velocity_partition(state, rhombus.loops(), {"crank_joint": 1.0})
        by_text = velocity_partition(state, [text], {"crank_joint": 1.0})
        apart = max(apart, float(np.abs(by_robot.v - by_text.v).max()))
        th2, th3 = text_angles(state)[1:]
        w2, w3 = rates_of(state, by_robot.v)
        angles.append((float(np.degrees(th2)), float(np.degrees(th3))))
        rates.append((w2, w3))
        det_J2.append(link_jacobians(state, known=["crank"]).determinant)
        apart = max(apart, abs(det_J2[-1] - np.sin(th3 - th2)))
        print(f"{'':46}{angles[-1][0]:6.1f}{angles[-1][1]:8.1f}{w2 + 0.0:8.3f}{w3 + 0.0:8.3f}{det_J2[-1]:10.3f}")
    print(f"The text's loop and the robot's pin give the same rates and det J2, to {apart:.0e}.")

    norton = four_bar(40.0, 120.0, 80.0, 100.0, crank_angle=radians(40.0))
    still = norton.at("assembled")
    moving = still.with_velocity(velocity_partition(still, norton.loops(), {"crank_joint": 25.0}).v)
    a = acceleration_partition(moving, norton.loops(), {"crank_joint": 15.0}).a
    here = np.degrees([link_angles(still)[link] for link in ("coupler", "rocker")])
    w, alpha = np.array(rates_of(still, moving.v)), np.array(rates_of(still, a))
    for name, x, unit in (("angles", here, "deg"), ("rates", w, "rad/s"), ("accelerations", alpha, "rad/s2")):
        print(f"Norton's coupler and rocker, {name}: {x[0]:.4f} and {x[1]:.4f} {unit}")
    solution = rbd.solve(still, np.zeros(1), norton.loops(), solver=rbd.KKT())
    pin_N = float(np.linalg.norm(solution.forces["coupler_pin"]))
    print(f"Released at rest, its pin carries {pin_N / (norton.mass * 9.81):.4f} of its weight; {solution.status}.")
    if show:
        from rbd.visual import Scene

        Path("out").mkdir(exist_ok=True)
        with Scene(rhombus) as scene:
            scene.show(rbd.State(rhombus, found.found[0].q))
            scene.beside({"the other branch": rbd.State(rhombus, found.found[1].q)})
            print(f"See {scene.export('out/10_four_bar.html')}.")
    return Result(angles, rates, det_J2, apart, (here, w, alpha), pin_N)


def text_angles(state: rbd.State) -> tuple[float, float, float]:
    """(th1, th2, th3) of the text, in [0, 2 pi)."""
    links = link_angles(state)
    th = np.array([links["crank"] - np.pi, links["coupler"] - np.pi, links["rocker"]]) % (2.0 * np.pi)
    return float(th[0]), float(th[1]), float(th[2])


def loop_of_the_text(state: rbd.State) -> np.ndarray:
    """L1 e^(i th1) + L2 e^(i th2) + L3 e^(i th3) + L4, its real and its imaginary part, all lengths 1."""
    z = np.exp(1j * np.array([*text_angles(state), 0.0])).sum()
    return np.array([z.real, z.imag])


def rates_of(state: rbd.State, v: np.ndarray) -> tuple[float, float]:
    """Rates of coupler and rocker from the ground; accelerations likewise."""
    rates = link_rates(state, v)
    return rates["coupler"], rates["rocker"]


def check(result: Result) -> None:
    """The text's angles, rates and determinant on both branches; Norton's published numbers."""
    both = sorted(zip(result.angles, result.rates, strict=True))
    assert np.allclose([angles for angles, _ in both], [(180.0, 210.0), (210.0, 180.0)], atol=1e-9), "open, folded"
    assert np.allclose([rates for _, rates in both], [(0.0, 1.0), (1.0, 0.0)], atol=1e-9), "rocker, or coupler, as the crank"
    assert np.allclose(sorted(result.det_J2), [-0.5, 0.5]) and result.apart < 1e-9
    here, w, alpha = result.norton
    assert np.allclose(here, (20.298, 57.325), atol=5e-4) and np.allclose(w, (-4.1209, 6.9980), atol=5e-5)
    assert np.allclose(alpha, (296.089, 470.134), atol=5e-4)


if __name__ == "__main__":
    check(main())
