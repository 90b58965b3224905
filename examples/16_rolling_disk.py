"""Why does a rolling coin stay upright, and how long does a sliding coin keep sliding?

An upright coin (A = m r^2 / 4, C = m r^2 / 2) that rolls with w = v / r and is tipped by a small x0 turns into its lean x, with
the rate w C / A (x - x0), which rights it:

    (A + m r^2) x'' = m g r x - C (C + m r^2) / A w^2 (x - x0)

So faster than v = sqrt(g r / 3) it wobbles, and slower it falls. We tip it by a degree and let it roll, without slip. Then the
same coin with friction: thrown at v0 without spin it slides until t = v0 / (3 mu g), and rolls on with 2/3 v0.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

GRAVITY, LEAN, FRICTION, THROWN = 9.81, np.radians(1.0), 0.25, 3.0


@dataclass(frozen=True)
class Result:
    """The rolling coins and their leans, simulated and linear, how errors fall with the step, and the coin that slides."""

    runs: dict[str, rbd.Trajectory]
    lean: dict[str, np.ndarray]
    linear: dict[str, np.ndarray]
    ratio: float
    thrown: rbd.Trajectory
    off_m: float


def main(show: bool = True) -> Result:
    coin = rbd.load_robot("rolling_disk")
    critical = np.sqrt(GRAVITY * (r := coin.wheels()[0].radius) / 3.0)
    print(f"A coin of radius {r} m stays up above {critical:.4f} m/s.")
    print("  speed over that   lean after 0.2 s     0.4 s       0.6 s   linear:    0.2 s      0.4 s      0.6 s")
    runs, lean, linear = {}, {}, {}
    for name, part in (("fast", 1.5), ("slow", 0.5)):
        runs[name] = roll(coin, part * critical, 2e-3)
        lean[name] = leans(runs[name])
        linear[name] = small_lean(runs[name].t, part, r)
        shown = ["".join(f"{np.degrees(x[name][i]):11.3f}" for i in (100, 200, 300)) for x in (lean, linear)]
        print(f"{part:13.1f}         {shown[0]} deg     {shown[1]} deg")
    off = [np.abs(roll(coin, 1.5 * critical, step).q[-1] - runs["fast"].q[-1]).max() for step in (2e-2, 1e-2)]
    print(f"Its energy moves by {np.ptp(runs['fast'].energy):.0e} J; half the step divides the error by {off[0] / off[1]:.0f}.")

    stops, final = THROWN / (3.0 * FRICTION * GRAVITY), 2.0 / 3.0 * THROWN
    place = THROWN * stops - 0.5 * FRICTION * GRAVITY * stops**2 + final * (0.5 - stops)
    thrown = throw(coin, 1e-2)
    sticks, speed = next(e.t for e in thrown.events if e.kind == "sticks"), thrown.momentum[-1, 0] / coin.mass
    off_m = abs(thrown.com[-1, 0] - place)
    print(f"Thrown at {THROWN} m/s, mu = {FRICTION}: rolls from {stops:.6f} s on with {final:.4f} m/s (closed form).")
    print(f"  Simulated, at steps of 10 ms: from {sticks:.6f} s on with {speed:.4f} m/s; its place is off by {off_m:.0e} m.")
    result = Result(runs, lean, linear, off[0] / off[1], thrown, off_m)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        plot_lean((figure := Figure(figsize=(7.0, 4.0), layout="constrained")).subplots(), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/16_rolling_disk.png", dpi=150)
        print(f"See out/16_rolling_disk.png and {runs['slow'].export('out/16_rolling_disk.html')}.")
    return result


def roll(coin: rbd.Robot, speed: float, step: float) -> rbd.Trajectory:
    """0.8 s of rolling along x without slip, from a lean of a degree."""
    r = coin.wheels()[0].radius
    q = [0.0, 0.0, r * np.cos(LEAN), np.sin(0.5 * LEAN), 0.0, 0.0, np.cos(0.5 * LEAN)]
    state = rbd.State(coin, q, [speed, 0.0, 0.0, 0.0, speed / r, 0.0])
    return rbd.simulate(state, coin.wheels(), duration=0.8, step=step, progress=False)


def throw(coin: rbd.Robot, step: float) -> rbd.Trajectory:
    """0.5 s of the upright coin, with friction, thrown along x without spin."""
    rim = rbd.RollingDisk("rim", "disk", radius=coin.wheels()[0].radius, friction=FRICTION)
    return rbd.simulate(coin.at("upright", [THROWN, 0.0, 0.0, 0.0, 0.0, 0.0]), [rim], duration=0.5, step=step, progress=False)


def leans(way: rbd.Trajectory) -> np.ndarray:
    """Angle between the coin and the vertical over time [rad]."""
    return np.arcsin(np.abs(2.0 * (way.q[:, 4] * way.q[:, 5] + way.q[:, 3] * way.q[:, 6])))


def small_lean(t: np.ndarray, part: float, r: float) -> np.ndarray:
    """x(t) of the linear equation, from LEAN at rest, at so many times the critical speed."""
    rate = np.sqrt(4.0 * GRAVITY / (5.0 * r) * (1.0 - part**2) + 0.0j)  # imaginary where it wobbles
    middle = LEAN * part**2 / (part**2 - 1.0)
    return middle + (LEAN - middle) * np.real(np.cosh(rate * t))


def plot_lean(ax, result: Result) -> list:
    """The lean over time at both speeds, and by the linear equation; returns the artists."""
    artists = []
    for name, color in (("fast", "#0072b2"), ("slow", "#d55e00")):
        t = result.runs[name].t
        artists += ax.plot(t, np.degrees(result.lean[name]), color=color, lw=3, alpha=0.5, label=name)
        artists += ax.plot(t, np.degrees(result.linear[name]), "k--", lw=1)
    ax.set(xlabel="time [s]", ylabel="lean [deg]", ylim=(0.0, 30.0), title="A coin tipped by a degree; dashed: linear")
    ax.legend()
    return artists


def check(result: Result) -> None:
    """The wobble and the fall by the linear equation, energy, order 4, and where sliding ends."""
    for name, way in result.runs.items():
        apart = np.abs(result.lean[name] / result.linear[name] - 1.0)[result.linear[name] < np.radians(5.0)]
        assert apart.max() < 0.06, "linear, of small leans"
        assert np.ptp(way.energy) < 1e-6 and way.residuals["drift"].max() < 1e-11
    assert result.lean["fast"].max() < np.radians(3.0) and result.ratio > 12.0, "it stays up; errors of h^4"
    assert result.off_m < 1e-8, "forces are constant before and after, and the step is split where it comes to roll"
    (sticks,) = (e for e in result.thrown.events if e.kind == "sticks")
    assert abs(sticks.t - THROWN / (3.0 * FRICTION * GRAVITY)) < 1e-7


if __name__ == "__main__":
    check(main())
