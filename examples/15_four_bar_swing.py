"""A linkage is released and swings: does its loop stay closed, does its energy stay, and what if it passes a singular pose?

A four-bar swings about its lowest pose: energy and loop error over time, at two steps, and with the loop kept by projection,
by Baumgarte's feedback, or not at all. Then two square four-bars in a row, the benchmark A02 of IFToMM's library: at every
swing all of their bars lie in one line, where the loops lose rank and other motions branch off. Its one degree of freedom is a
pendulum's,

    [(N + 1) / 3 + N] phi'' = -[(N + 1) / 2 + N] g cos phi        (bars of 1 m and 1 kg)
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import rbd
from rbd.mechanism import four_bar, n_four_bar, velocity_partition

GRAVITY, N = 9.81, 2
KEPT = {"projection": rbd.simulation.Projection(), "Baumgarte": rbd.constraints.Baumgarte(50.0), "nothing": None}


@dataclass(frozen=True)
class Result:
    """Swings by how the loop is kept, the energy they miss at two steps, and the row of four-bars beside its pendulum."""

    swings: dict[str, rbd.Trajectory]
    missed_J: tuple[float, float]
    row: rbd.Trajectory
    phi: np.ndarray
    phi_pendulum: np.ndarray
    crossings: int


def main(show: bool = True) -> Result:
    bars = four_bar(0.4, 1.2, 0.8, 1.0)
    start = bars.at("assembled")

    def swing(step: float, kept=rbd.simulation.Projection()) -> rbd.Trajectory:  # noqa: B008
        return rbd.simulate(start, bars.loops(), duration=1.5, step=step, stabilisation=kept, progress=False)

    swings = {name: swing(5e-3, kept) for name, kept in KEPT.items()}
    missed_J = energy_moves(swing(1e-2)), energy_moves(swings["projection"])
    one = swings["projection"]
    print(f"A four-bar of {bars.mass:.1f} kg falls from rest; at most it has {one.kinetic.max():.3f} J of motion.")
    print("loop kept by    opens by at most     energy moves by")
    for name, way in swings.items():
        print(f"{name:<13}{way.residuals['drift'].max() * 1e3:16.6f} mm{energy_moves(way) * 1e3:17.6f} mJ")
    print(f"Half the step divides the energy's error by {missed_J[0] / missed_J[1]:.0f}.")

    row = n_four_bar(N)
    upright = row.at("assembled")
    moving = upright.with_velocity(velocity_partition(upright, row.loops(), {"crank_0_joint": -1.0}).v)  # B0 at +1 m/s
    swung = rbd.simulate(moving, row.loops(), duration=2.5, step=2.5e-3, progress=False)
    phi = np.unwrap(np.arctan2(swung.q[:, 1], swung.q[:, 0]))
    phi_pendulum = pendulum(swung.t)
    crossings = int(np.count_nonzero(np.diff(np.sign(np.sin(phi)))))
    print(f"{N} four-bars in a row, {swung.duration} s: all {2 * N + 1} bars in one line {crossings} times.")
    print(f"  crank at {np.degrees(phi[-1]):.4f} deg, the pendulum at {np.degrees(phi_pendulum[-1]):.4f} deg")
    print(f"  loops open by {swung.residuals['drift'].max():.0e} m at most, energy moves by {energy_moves(swung) * 1e6:.1f} uJ")
    result = Result(swings, missed_J, swung, phi, phi_pendulum, crossings)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 6.0), layout="constrained")
        plot_swing(figure.subplots(2, 1), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/15_four_bar_swing.png", dpi=150)
        print(f"See out/15_four_bar_swing.png and {one.export('out/15_four_bar_swing.html')}.")
    return result


def energy_moves(way: rbd.Trajectory) -> float:
    """Between its largest and its smallest value [J]."""
    return float(np.ptp(way.energy))


def pendulum(times: np.ndarray) -> np.ndarray:
    """Angle of the row of four-bars: its equation of motion, integrated to twelve digits."""
    k = ((N + 1) / 2 + N) * GRAVITY / ((N + 1) / 3 + N)
    found = solve_ivp(
        lambda t, y: [y[1], -k * np.cos(y[0])], (0.0, times[-1]), [np.pi / 2, -1.0],
        method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    return found.y[0]


def plot_swing(axes, result: Result) -> list:
    """Energies of the swing above, the row's crank beside its pendulum below; returns the artists."""
    from rbd.visual import plot_energy

    above, below = axes
    artists = plot_energy(above, result.swings["projection"])
    t = result.row.t
    artists += below.plot(t, np.degrees(result.phi), color="#0072b2", lw=3, alpha=0.4, label="two four-bars in a row")
    artists += below.plot(t, np.degrees(result.phi_pendulum), color="k", lw=1, ls="--", label="one pendulum")
    artists += [below.axhline(angle, color="0.6", lw=0.8) for angle in (0.0, -180.0)]
    below.set(xlabel="time [s]", ylabel="crank [deg]", title="Singular where a grey line is crossed")
    below.legend(loc="upper right")
    return artists


def check(result: Result) -> None:
    """Energy and loops of what is kept by projection, order 4, and the pendulum through the singular poses."""
    one = result.swings["projection"]
    assert one.residuals["drift"].max() < 1e-11 and energy_moves(one) < 1e-4 * one.kinetic.max()
    drifts = [result.swings[name].residuals["drift"].max() for name in KEPT]
    assert drifts[0] < drifts[1] and drifts[0] < drifts[2]
    assert 11.0 < result.missed_J[0] / result.missed_J[1] < 40.0, "an error of h^4"
    assert result.crossings >= 2
    assert np.abs(result.phi - result.phi_pendulum).max() < 1e-6
    assert energy_moves(result.row) < 1e-5 and result.row.residuals["drift"].max() < 1e-10


if __name__ == "__main__":
    check(main())
