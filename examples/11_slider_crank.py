"""A piston engine turns: how do piston and torque follow the crank, and where is it stuck?

A slider-crank with crank r and rod l, its slider in line with the crank's pivot. The piston's position, speed and acceleration
against the textbook's closed form; the torque that holds a pressure on the piston, by virtual work through the loop's own
Jacobian; and the two poses where no pressure turns the crank.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd
from rbd.mechanism import acceleration_partition, assemble, singularities, slider_crank, trace, velocity_partition

CRANK, ROD = 0.045, 0.15  # [m]
SPEED, PRESSURE_N = 30.0, 500.0  # of the crank [rad/s]; on the piston, towards the crank


@dataclass(frozen=True)
class Result:
    """Over a turn: crank angle, piston's place, speed and acceleration, torque that holds the pressure; dead centres."""

    angle: np.ndarray
    piston: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    dead: list[float]


def main(show: bool = True) -> Result:
    engine = slider_crank(CRANK, ROD)
    start = engine.at("assembled")
    turn = trace(start, engine.loops(), joint="crank_joint", values=(0.0, 2.0 * np.pi), steps=72)
    rows = [over_a_turn(engine, q) for q in turn.q]
    piston, speed, acceleration, torque = np.array(rows).T
    result = Result(turn.input, piston, speed, acceleration, torque, dead_centres(engine, start))
    print(f"Crank {CRANK} m, rod {ROD} m, {SPEED:.0f} rad/s; {len(turn)} poses, closed to {turn.residual.max():.0e} m.")
    print("crank [deg]   piston [m]   speed [m/s]   acceleration [m/s2]   torque against 500 N [N m]")
    for i in range(0, 73, 9):
        row = (np.degrees(turn.input[i]), piston[i], speed[i], acceleration[i], torque[i])
        print("{:9.0f}{:14.4f}{:13.3f}{:18.1f}{:22.2f}".format(*row).replace("-0.000", " 0.000").replace("-0.00", " 0.00"))
    print(f"Driven by its piston it is stuck at {', '.join(f'{np.degrees(x):.1f}' for x in result.dead)} deg: dead centres.")
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 6.0), layout="constrained")
        plot_turn(figure.subplots(3, 1, sharex=True), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/11_slider_crank.png", dpi=150)
        print("See out/11_slider_crank.png.")
    return result


def over_a_turn(engine: rbd.Robot, q: np.ndarray) -> tuple[float, float, float, float]:
    """Piston's place, speed, acceleration, and the torque at the crank that holds the pressure still."""
    v = velocity_partition(rbd.State(engine, q), engine.loops(), {"crank_joint": SPEED}).v
    moving = rbd.State(engine, q, v)
    a = acceleration_partition(moving, engine.loops(), {"crank_joint": 0.0}).a
    # Virtual work: torque times the crank's rate and pressure times the piston's add up to nothing.
    return float(q[-1]), float(v[-1]), float(a[-1]), PRESSURE_N * float(v[-1]) / SPEED


def dead_centres(engine: rbd.Robot, start: rbd.State) -> list[float]:
    """Crank angles where the piston's rate does not decide the crank's: singular with the piston as input."""
    found = []
    for angle in (0.0, np.pi):
        q = assemble(start, engine.loops(), fixed={"crank_joint": angle}).q
        if singularities(rbd.State(engine, q), engine.loops(), inputs=["slider_joint"]).kinds["output"].singular:
            found.append(angle)
    return found


def plot_turn(axes, result: Result) -> list:
    """Piston's place, speed and acceleration over a turn; returns the artists."""
    deg, artists = np.degrees(result.angle), []
    for ax, y, label in zip(
        axes,
        (result.piston, result.speed, result.acceleration),
        ("piston [m]", "speed [m/s]", "acceleration [m/s²]"),
        strict=True,
    ):
        artists += ax.plot(deg, y, color="#0072b2")
        artists += [ax.axvline(np.degrees(a), ls="--", color="0.5") for a in result.dead]
        ax.set_ylabel(label)
    axes[-1].set_xlabel("crank [deg]; dashed: dead centres")
    return artists


def check(result: Result) -> None:
    """Piston: x = r cos + sqrt(l^2 - r^2 sin^2), differentiated; no torque at the dead centres."""
    th, r, l = result.angle, CRANK, ROD
    s, c, root = np.sin(th), np.cos(th), np.sqrt(l**2 - r**2 * np.sin(th) ** 2)
    assert np.abs(result.piston - (r * c + root)).max() < 1e-11
    slope = -r * s - r**2 * s * c / root
    assert np.abs(result.speed - SPEED * slope).max() < 1e-9
    curve = -r * c - r**2 * (c**2 - s**2) / root - r**4 * s**2 * c**2 / root**3
    assert np.abs(result.acceleration - SPEED**2 * curve).max() < 1e-7
    assert len(result.dead) == 2 and abs(result.torque[0]) < 1e-8 and abs(result.torque[36]) < 1e-8


if __name__ == "__main__":
    check(main())
