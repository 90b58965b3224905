"""A sleigh on one knife edge, pushed off and left alone: why does it end up gliding straight ahead?

Chaplygin's sleigh: a knife edge under a rigid body, its centre of mass ahead of the edge by a. Nothing drives it, and the
edge does no work. Yet v' = a w^2 >= 0 and w' = -(m a / (I + m a^2)) v w: turning becomes gliding ahead, and gliding
backwards is unstable. The accelerations of `rbd.solve` at many states against that, and the edge's power.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd
from rbd.mechanism import Integrability, integrability


@dataclass(frozen=True)
class Result:
    """Speeds v along the edge, turning rates w, both accelerations found and in closed form, and the power of all forces."""

    v: np.ndarray
    w: np.ndarray
    found: np.ndarray
    closed_form: np.ndarray
    power: np.ndarray
    frobenius: Integrability
    a: float


def main(show: bool = True) -> Result:
    sleigh = rbd.load_robot("chaplygin_sleigh")
    blade = sleigh.wheels()
    m, inertia, a = body(sleigh)
    v, w = (grid.ravel() for grid in np.meshgrid(np.linspace(-2.0, 2.0, 9), np.linspace(-3.0, 3.0, 9)))
    found, power = [], []
    for speed, rate in zip(v, w, strict=True):
        state = rbd.State(sleigh, sleigh.neutral(), np.array([speed, 0.0, rate]))
        solution = rbd.solve(state, np.zeros(sleigh.nu), blade, solver=rbd.KKT())
        found.append(solution.a[[0, 2]])
        power.append(float(solution.multipliers @ (solution.problem.J @ state.v)))
    closed_form = np.column_stack([a * w**2, -m * a / (inertia + m * a**2) * v * w])
    frobenius = integrability(sleigh.at(), blade)
    print(f"m = {m:.2f} kg, I = {inertia:.4f} kg m2, the centre of mass {a:.3f} m ahead of the knife edge.")
    print(*str(frobenius).splitlines()[:2], sep="\n")
    print("    v [m/s]   w [rad/s]    v' [m/s2]   w' [rad/s2]      closed form")
    for i in (14, 20, 24, 60):
        x, y = found[i], closed_form[i]
        print(f"{v[i]:10.2f}{w[i]:12.2f}{x[0]:13.5f}{x[1]:14.5f}{y[0]:13.5f}{y[1]:10.5f}")
    worst = float(np.abs(np.array(found) - closed_form).max())
    print(f"{len(v)} states: largest difference {worst:.0e}; the edge's power is {np.abs(power).max():.0e} W.")
    total = np.pi * np.sqrt(1.0 + inertia / (m * a**2))
    print(f"From backwards to forwards it turns by pi sqrt(1 + I / (m a^2)) = {np.degrees(total):.1f} deg in all.")
    result = Result(v, w, np.array(found), closed_form, np.array(power), frobenius, a)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(6.4, 5.0), layout="constrained")
        plot_flow(figure.subplots(), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/13_sleigh.png", dpi=150)
        print("See out/13_sleigh.png.")
    return result


def body(sleigh: rbd.Robot) -> tuple[float, float, float]:
    """Mass, inertia about the vertical through the centre of mass, and its distance ahead of the edge."""
    whole = sleigh.model.inertias[1]
    return float(whole.mass), float(whole.inertia[2, 2]), float(whole.lever[0])


def plot_flow(ax, result: Result) -> list:
    """Arrows of (v', w') over (v, w), and ellipses of constant energy; returns the artists."""
    arrows = ax.quiver(result.v, result.w, *result.found.T, color="#0072b2", angles="xy")
    rest = ax.plot([0.0, 2.2], [0.0, 0.0], color="#009e73", lw=3, label="gliding ahead: stable")
    rest += ax.plot([-2.2, 0.0], [0.0, 0.0], color="#d55e00", lw=3, label="gliding backwards: unstable")
    ax.set(xlabel="speed along the edge v [m/s]", ylabel="turning rate w [rad/s]", title="Chaplygin's sleigh")
    ax.legend(loc="upper right")
    return [arrows, *rest]


def check(result: Result) -> None:
    """Bloch's equations of the sleigh; the edge does no work; one knife edge is not holonomic."""
    assert result.a > 0.0 and np.abs(result.found - result.closed_form).max() < 1e-10
    assert np.abs(result.power).max() < 1e-10
    assert result.frobenius.growth == (2, 3) and not result.frobenius.holonomic
    assert (result.found[:, 0] >= -1e-12).all(), "its speed along the edge never falls"


if __name__ == "__main__":
    check(main())
