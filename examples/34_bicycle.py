"""At which speeds does a bicycle without hands stay upright by itself, and what are weave and capsize?

The benchmark of Meijaard, Papadopoulos, Ruina and Schwab (2007): a frame with a rigid rider, a fork, two wheels with knife
edges that roll without slip. It is built in memory, set rolling upright and straight at many speeds v, and linearised there:
x' = A x on what the wheels leave free, seen from the moving frame. Its modes:

    weave       lean and steer swing, out of step; slower than 4.3 m/s the swing grows
    capsize     lean and steer grow together, slowly, faster than 6.0 m/s
    castering   the front wheel turns into its track at once
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

import rbd

TILT, WHEELBASE, TRAIL, REAR, FRONT = np.pi / 10.0, 1.02, 0.08, 0.3, 0.35
NONE = complex(np.nan, np.nan)
PUBLISHED = {"capsize": -0.322866429004087, "weave": -0.775341882195845 + 4.464867713788229j, "castering": -14.078389692798218}
"""Their table 2: eigenvalues at 5 m/s [1/s]."""


@dataclass(frozen=True)
class Result:
    """Speeds and eigenvalues, small motion at 5 m/s, the ends of the stable range, and a turn without hands."""

    speeds: np.ndarray
    eigenvalues: list[np.ndarray]
    at_5: rbd.mechanism.small_motion.Linearised
    off: dict[str, float]
    weave_speed: float
    capsize_speed: float
    turn: rbd.mechanism.small_motion.SteadyState


def main(show: bool = True) -> Result:
    bicycle = build()
    small = rbd.linearise(rolling(bicycle, 5.0))
    print(small.verdict)
    modes = {mode.words: mode for mode in small.modes()}
    off = {name: float(np.abs(small.eigenvalues - value).min()) for name, value in PUBLISHED.items()}
    for mode in small.modes():
        real, imaginary = np.round([mode.eigenvalue.real, mode.eigenvalue.imag], 6) + 0.0
        print(f"  {real:10.6f} +- {imaginary:.6f} i 1/s   {mode.title}: {mode.words}")
    print(f"Published eigenvalues are met to {'1e-11' if max(off.values()) < 1e-11 else max(off.values())} 1/s.")

    weave = brentq(lambda v: max(z.real for z in values(bicycle, v) if abs(z.imag) > 1.0), 4.0, 5.0, xtol=1e-8)
    capsize = brentq(lambda v: sorted(values(bicycle, v), key=abs)[1].real, 5.9, 6.2, xtol=1e-8)  # the first is of the speed
    print(f"It stays upright by itself from {weave:.6f} m/s (weave) to {capsize:.6f} m/s (capsize).")

    turn = rbd.find_steady_motion(rolling(bicycle, 6.0), fixed={"steer": 0.05})
    v = turn.state.v
    lean, radius = 2.0 * np.degrees(np.arcsin(abs(turn.state.q[3]))), v[0] / v[5]
    print(f"Steered by 2.9 deg and without hands it turns at {v[0]:.4f} m/s, leaning {lean:.3f} deg, radius {radius:.2f} m.")

    speeds = np.linspace(0.0, 10.0, 26)
    result = Result(speeds, [values(bicycle, v) for v in speeds], small, off, weave, capsize, turn)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(10.0, 4.5), layout="constrained")
        plot(figure, result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/34_bicycle.png", dpi=150)
        page = modes["oscillates and decays"].export("out/34_bicycle.html")
        print(f"See out/34_bicycle.png, and the weave in {page}.")
    return result


def build() -> rbd.Robot:
    """The benchmark bicycle; its frame's origin is where the rear wheel touches when upright; z is up, in the paper down."""
    foot = WHEELBASE + TRAIL  # where the steering axis meets the ground
    up = np.array([-np.sin(TILT), 0.0, np.cos(TILT)])
    head, hub, seat, bars = up * 0.75 + (foot, 0, 0), (0, 0, REAR), (0.2, 0, 0.85), up * 0.95
    b = rbd.RobotBuilder("whipple", about="The bicycle of Meijaard and others (2007).")
    pins = [
        rbd.robots.Rod(p, q, radius=0.02) for p, q in ((hub, seat), (seat, head), (hub, (0.45, 0, 0.3)), ((0.45, 0, 0.3), head))
    ]
    rider = rbd.robots.Capsule(0.11, 0.45, at=(0.25, 0.0, 1.15), rpy=(0.0, 0.4, 0.0), color="green")
    b.body("frame", *pins, rider, mass=85.0, com=(0.3, 0.0, 0.9), inertia=(9.2, 0.0, -2.4, 11.0, 0.0, 2.8))
    tips = (WHEELBASE - foot, 0.0, FRONT), (bars[0], -0.25, bars[2]), (bars[0], 0.25, bars[2])
    fork = [rbd.robots.Rod(tips[0], bars, radius=0.02, color="orange"), rbd.robots.Rod(*tips[1:], radius=0.015, color="orange")]
    b.body("fork", *fork, mass=4.0, com=(0.9 - foot, 0.0, 0.7), inertia=(0.05892, 0.0, 0.00756, 0.06, 0.0, 0.00708))
    for name, radius, mass, across, about in (("rear", REAR, 2.0, 0.0603, 0.12), ("front", FRONT, 3.0, 0.1405, 0.28)):
        tyre = rbd.robots.Cylinder(radius, 0.01, rpy=(np.pi / 2.0, 0.0, 0.0), color="grey")
        mark = rbd.robots.Box((0.04, 0.02, 1.6 * radius), color="red")
        b.body(f"{name}_wheel", tyre, mark, mass=mass, inertia=(across, about, across))
        b.wheel(f"{name}_tyre", f"{name}_wheel", kind="rolling_disk", radius=radius, axis=(0, 1, 0))
    b.joint("rear_hub", "frame", "rear_wheel", "continuous", at=hub, axis=(0, 1, 0))
    b.joint("steer", "frame", "fork", at=(foot, 0, 0), axis=up)
    b.joint("front_hub", "fork", "front_wheel", "continuous", at=tips[0], axis=(0, 1, 0))
    return b.robot()


def rolling(bicycle: rbd.Robot, speed: float) -> rbd.State:
    """Upright and straight at a speed."""
    v = np.zeros(bicycle.nv)
    v[0], v[bicycle.joints["rear_hub"].v], v[bicycle.joints["front_hub"].v] = speed, speed / REAR, speed / FRONT
    return bicycle.at(None, v)


def values(bicycle: rbd.Robot, speed: float) -> np.ndarray:
    """Eigenvalues at a speed."""
    return rbd.linearise(rolling(bicycle, speed)).eigenvalues


def named(found: np.ndarray) -> dict[str, complex]:
    """Eigenvalues by their names in the literature; below 0.7 m/s there are four real ones, and no weave."""
    pair, single = (
        [z for z in found if z.imag > 1e-6],
        sorted(z for z in found.real[np.abs(found.imag) <= 1e-6] if abs(z) > 1e-9),
    )
    return {"weave": pair[0], "castering": single[0] + 0j, "capsize": single[-1] + 0j} if pair and len(single) > 1 else {}


def plot(figure, result: Result) -> None:
    """Real and imaginary parts over the speed, and the shape of the weave."""
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    left.axvspan(result.weave_speed, result.capsize_speed, color="#d9ead3", label="upright by itself")
    names = [named(found) for found in result.eigenvalues]
    for name, color in (("weave", "#0072b2"), ("capsize", "#009e73"), ("castering", "#cc5fa0")):
        left.plot(result.speeds, [found.get(name, np.nan).real for found in names], color=color, label=name)
    left.plot(
        result.speeds,
        [found.get("weave", NONE).imag for found in names],
        "--",
        color="#0072b2",
        label="weave, imaginary",
    )
    points = [(v, z.real) for v, found in zip(result.speeds, result.eigenvalues, strict=True) for z in found]
    left.plot(*np.transpose(points), ".", color="black", ms=3, label="real parts")
    left.axhline(0.0, color="black", lw=0.6)
    left.set(xlabel="speed [m/s]", ylabel="eigenvalue [1/s]", ylim=(-15.0, 16.0), title="A bicycle without hands")
    left.legend(loc="upper left", ncols=2)
    next(mode for mode in result.at_5.modes() if mode.frequency).plot(right)


def check(result: Result) -> None:
    """The published eigenvalues and critical speeds, the certificate of A, and the steady turn."""
    assert max(result.off.values()) < 1e-9, "their table 2"
    assert abs(result.weave_speed - 4.292382536) < 1e-6 and abs(result.capsize_speed - 6.024262015) < 1e-6
    assert max(result.at_5.difference, result.at_5.invariance, result.at_5.variation) < 1e-9
    assert result.turn.residual < 1e-9 and not result.turn.stable, "a steady turn, which a rider has to balance"


if __name__ == "__main__":
    check(main())
