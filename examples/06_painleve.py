"""Why does chalk that is pushed across a board chatter, when chalk that is drawn does not?

A uniform rod slides on rough ground, its lower end ahead (pushed) or behind (drawn). Friction turns it: pushed, it turns the
tip into the ground. If it does so faster than the normal force pushes the tip up, Coulomb's law with rigid bodies has no
solution, or two (Painleve, 1895). A solver has to detect that.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

GRAVITY = 9.81
HALF_m, MASS_kg = 0.5, 2.0
WORST = float(np.arctan(2.0))  # the angle from the ground at which the least friction will do
FRICTIONS = np.array([0.3, 0.8, 1.2, 4 / 3 - 0.01, 4 / 3 + 0.01, 1.6, 2.0, 3.0])
RATES = np.array([0.0, 4.0, 5.0, 8.0])  # turning [rad/s]: fast enough, its tip would lift off anyway


@dataclass(frozen=True, eq=False)
class Result:
    """Numbers of motions by rate and friction, and three answers in full."""

    pushed: np.ndarray
    drawn: np.ndarray
    one: rbd.problem.Answer
    two: rbd.problem.Answer
    none: rbd.problem.Answer


def main(show: bool = True) -> Result:
    count = {way: [[motions(rod(mu, rate, way)) for mu in FRICTIONS] for rate in RATES] for way in ("pushed", "drawn")}
    print(f"A rod at {np.degrees(WORST):.1f} deg from the ground; how many motions satisfy Coulomb's law?")
    print(f"{'turning':>14}   friction" + "".join(f"{mu:7.3f}" for mu in FRICTIONS))
    for way, rows in count.items():
        for rate, row in zip(RATES, rows, strict=True):
            print(f"{way:>7}{rate:4.0f} rad/s       " + "".join(f"{('none', 'one', 'two')[n]:>7}" for n in row))

    solver = rbd.ConeSolver()
    one, two, none = (solver.solve(rod(mu, rate, "pushed")) for mu, rate in ((1.2, 0.0), (1.6, 8.0), (1.6, 0.0)))
    print(f"mu = 1.2, 0 rad/s: the ground pushes with {one.multipliers[2]:.1f} N; the rod weighs {MASS_kg * GRAVITY} N.")
    print(f"mu = 1.6, 8 rad/s: {two.reason}.")
    print(f"mu = 1.6, 0 rad/s: {none.reason}.")
    result = Result(np.array(count["pushed"]), np.array(count["drawn"]), one, two, none)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        plot_pressing(figure.subplots())
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/06_painleve.png", dpi=150)
        print("See out/06_painleve.png.")
    return result


def rod(mu: float, rate: float = 0.0, way: str = "pushed", angle: float = WORST) -> rbd.GaussProblem:
    """The rod as arrays: x, z of its middle and its angle; the tip is its lower left end and goes at 1 m/s."""
    c, s = HALF_m * np.cos(angle), HALF_m * np.sin(angle)
    tip = rbd.Rows(
        "tip",
        J=[[1.0, 0.0, s], [0.0, 0.0, 0.0], [0.0, 1.0, -c]],  # tangent, tangent, normal
        bias=[c * rate**2, 0.0, s * rate**2],
        cone=rbd.problem.FrictionCone(mu),
        velocity=[-1.0 if way == "pushed" else 1.0, 0.0, 0.0],
    )
    M = np.diag([MASS_kg, MASS_kg, MASS_kg * HALF_m**2 / 3.0])
    return rbd.GaussProblem(M, np.array([0.0, -MASS_kg * GRAVITY, 0.0]), [tip])


def motions(problem: rbd.GaussProblem) -> int:
    """How many accelerations satisfy Coulomb's law."""
    solution = rbd.ConeSolver().solve(problem)
    return 1 + len(solution.others) if solution.status == "solved" else 0


def pressing(mu: float, angle: float) -> float:
    """Acceleration of the tip, upwards, for each newton of normal force [1/kg]: (1 + 3 c (c - mu s)) / m."""
    return (1.0 + 3.0 * np.cos(angle) * (np.cos(angle) - mu * np.sin(angle))) / MASS_kg


def plot_pressing(ax) -> list:
    """How the normal force moves the tip, against the rod's angle, for several frictions; returns the artists."""
    angle, artists = np.radians(np.linspace(1.0, 89.0, 200)), []
    for mu, color in ((0.5, "#0072b2"), (4 / 3, "0.3"), (2.0, "#d55e00")):
        artists += ax.plot(np.degrees(angle), [pressing(mu, th) for th in angle], color=color, label=f"mu = {mu:.3g}")
    artists.append(ax.axhline(0.0, ls="--", color="0.5"))
    ax.set(xlabel="angle from the ground [deg]", ylabel="tip's acceleration per force [1/kg]", title="A pushed rod")
    ax.legend(frameon=False)
    return artists


def check(result: Result) -> None:
    """Verdicts from the sign of two numbers, forces from their ratio."""
    assert (result.drawn == 1).all(), "drawn, friction lifts the tip: always one motion"
    for row, rate in zip(result.pushed, RATES, strict=True):
        free = HALF_m * rate**2 * np.sin(WORST) - GRAVITY  # the tip's acceleration without the ground
        for n, mu in zip(row, FRICTIONS, strict=True):
            assert n == (1 if pressing(mu, WORST) > 0.0 else 2 if free > 0.0 else 0)
    assert abs(pressing(4.0 / 3.0, WORST)) < 1e-15, "the critical friction is 4/3, at tan th = 2"
    assert abs(result.one.multipliers[2] - GRAVITY / pressing(1.2, WORST)) < 1e-9
    leaves, presses = result.two, result.two.others[0]
    assert leaves.multipliers[2] == 0.0 and presses.multipliers[2] > 0.0
    assert "Painleve" in result.none.reason


if __name__ == "__main__":
    check(main())
