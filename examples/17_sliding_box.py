"""A box is sent across a floor: where does it stop, and does it tip over its front edge before?

A flat box slides with -mu g and stops after v0^2 / (2 mu g), at any step. The floor's force on a tall crate acts ahead of its
middle, by mu times its height: from mu = 0.2 / 0.5 on it tips. Last, the crate set turning about its front edge, which sticks:
with enough energy to bring its middle over the edge it falls, with less it comes back, and when is a quadrature,

    th'^2 = w0^2 - 2 m g (z(th) - z(0)) / I        t(th) = integral of d th / th'
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.integrate import quad

import rbd

GRAVITY, V0, FRICTION = 9.81, 2.0, 0.4
SENT = [V0, 0.0, 0.0, 0.0, 0.0, 0.0]
LENGTH, HEIGHT = 0.2, {"box": 0.1, "crate": 0.5}  # halves [m]


@dataclass(frozen=True)
class Result:
    """The box that stops, the crate at several frictions, what falls, and the error of an angle at halved steps."""

    stopped: rbd.Trajectory
    tipped: dict[float, rbd.Trajectory]
    falls: dict[float, bool]
    errors: np.ndarray


def main(show: bool = True) -> Result:
    box, crate = rbd.load_robot("box"), rbd.load_robot("crate")
    stopped = simulated(box, FRICTION, SENT, 0.6, 0.01)
    far, sticks = stopped.q[-1, 0], next(e.t for e in stopped.events if e.kind == "sticks")
    print(f"A flat box at {V0} m/s, mu = {FRICTION}: stops after {sticks:.6f} s and {far:.6f} m.")
    print(f"By the closed form: {V0 / (FRICTION * GRAVITY):.6f} s, {V0**2 / (2.0 * FRICTION * GRAVITY):.6f} m.")

    print("A tall crate at the same speed:")
    tipped = {mu: simulated(crate, mu, SENT, 0.6, 0.005) for mu in (0.39, 0.41, 0.6)}
    for mu, way in tipped.items():
        end = next(e.t for e in way.events if e.kind == "sticks")
        print(f"  mu = {mu:.2f}: slides for {end:.3f} s, and tilts by {np.degrees(tilt(way)[-1]):.2f} deg after 0.6 s")

    inertia, arm, start = edge(crate)
    needed = np.sqrt(2.0 * crate.mass * GRAVITY * arm * (1.0 - np.sin(start)) / inertia)
    top = np.pi / 2.0 - start
    falls = {part: bool(tilt(turn(crate, part * needed, 1.5, 150)).max() > top + 0.1) for part in (0.99, 1.01)}
    outcomes = ", ".join(f"at {part} times that it {'falls' if falls[part] else 'comes back'}" for part in falls)
    print(f"Set turning about its edge it needs {needed:.4f} rad/s to fall: {outcomes}.")

    w0, angle, k = 1.2 * needed, np.radians(25.0), 2.0 * crate.mass * GRAVITY * arm / inertia
    end = quad(lambda th: (w0**2 - k * (np.sin(start + th) - np.sin(start))) ** -0.5, 0.0, angle)[0]
    print(f"At {w0:.4f} rad/s it tilts by 25 deg after {end:.6f} s (quadrature). Simulated till then:")
    errors = []
    for steps in (25, 50, 100, 200):
        errors.append(abs(tilt(turn(crate, w0, end, steps))[-1] - angle))
        better = f", {errors[-2] / errors[-1]:.2f} times less" if len(errors) > 1 else ""
        print(f"  {steps:3} steps: off by {np.degrees(errors[-1]):.6f} deg{better}")
    result = Result(stopped, tipped, falls, np.array(errors))
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 6.0), layout="constrained")
        plot_slide(figure.subplots(2, 1), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/17_sliding_box.png", dpi=150)
        print(f"See out/17_sliding_box.png and {tipped[0.6].export('out/17_sliding_box.html')}.")
    return result


def simulated(body: rbd.Robot, friction: float, v: list, duration: float, step: float) -> rbd.Trajectory:
    """The body on its bottom, at velocity v."""
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -(z := HEIGHT[body.name])]))
    sole = rbd.SurfaceContact("sole", body.name, half_lengths=(LENGTH, LENGTH), placement=below, friction=friction)
    state = rbd.State(body, [0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0], v)
    return rbd.simulate(state, [sole], duration=duration, step=step, progress=False)


def turn(crate: rbd.Robot, w0: float, duration: float, steps: int) -> rbd.Trajectory:
    """Set turning about its front edge, which sticks."""
    return simulated(crate, 2.0, [w0 * HEIGHT["crate"], 0.0, w0 * LENGTH, 0.0, w0, 0.0], duration, duration / steps)


def tilt(way: rbd.Trajectory) -> np.ndarray:
    """How far it has turned about y over time [rad]."""
    return 2.0 * np.arctan2(way.q[:, 4], way.q[:, 6])


def edge(crate: rbd.Robot) -> tuple[float, float, float]:
    """Inertia about the front edge, distance to the middle, and the angle of the line to it from the floor."""
    arm = np.hypot(LENGTH, HEIGHT["crate"])
    inertia = crate.model.inertias[1].inertia[1, 1] + crate.mass * arm**2
    return float(inertia), float(arm), float(np.arctan2(HEIGHT["crate"], LENGTH))


def plot_slide(axes, result: Result) -> list:
    """Forces on the box that stops and on the crate that tips; returns the artists."""
    from rbd.visual import plot_forces

    artists = plot_forces(axes[0], result.stopped) + plot_forces(axes[1], result.tipped[0.6])
    for ax, title in zip(axes, ("A flat box slides and stops", "A tall crate tips, mu = 0.6"), strict=True):
        artists.append(ax.text(0.99, 0.7, title, ha="right", transform=ax.transAxes))
    return artists


def check(result: Result) -> None:
    """Where it stops, when it tips, what falls, order 2."""
    assert abs(result.stopped.q[-1, 0] - V0**2 / (2.0 * FRICTION * GRAVITY)) < 1e-9
    assert np.abs(tilt(result.tipped[0.39])).max() < 1e-9 < 1e-2 < tilt(result.tipped[0.41]).max()
    assert result.falls == {0.99: False, 1.01: True}
    assert np.abs(result.errors[:-1] / result.errors[1:] - 4.0).max() < 0.3, "half the step, a quarter of the error"


if __name__ == "__main__":
    check(main())
